"""The work of a job: what its process runs, and what it stores."""

from __future__ import annotations

import os
import tempfile
import time
import warnings
import zipfile
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

import shoal
from shoal.core.checks import check_choice, check_integer, check_text, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, ShoalError, describe_error
from shoal.core.files import as_json, atomic, write_json, write_text
from shoal.lab.batches import MixedVersionsWarning, SweepProgress
from shoal.lab.coordinator import run_sweep
from shoal.lab.exchange import SUFFIXES, export
from shoal.lab.statistics import summarise
from shoal.lab.store import Store
from shoal.lab.sweep import Sweep
from shoal.missions.mission_set import MissionSet
from shoal.missions.options import MissionOptions
from shoal.search.problem import SearchProblem
from shoal.studio.folder import MISSIONS_PAGE, PAPERS, Folder, episode_in
from shoal.studio.forms import (
    as_command,
    checked_problem,
    checked_seed,
    checked_sweep,
    command_beside,
    mission_options,
    mission_words,
)
from shoal.studio.requests import (
    LIST,
    MAYBE_BOOL,
    MAYBE_INTEGER,
    MAYBE_NUMBER,
    MAYBE_OBJECT,
    MAYBE_TEXT,
    OBJECT,
    SEED,
    TEXT,
    Field,
)
from shoal.studio.searching import planned_search
from shoal.studio.words import fault_of

Say = Callable[[str, Any], None]
"""Function with which a job reports an event. The arguments are the kind and the content of the
event.
"""

MOST_COMPARED = 4
MOST_TRIALS = 1000
_FIGURES = ("png", "svg", "pdf")
FORMATS = (*_FIGURES, "mp4", "gif", "html")


def do_job(
    connection: Connection, root: str, kind: str, spec: dict[str, Any], processors: int
) -> None:
    """Run a job in the current process. Some jobs can use several processors.

    The last message of the process is "done" with the result of the job, or "failed" with an error
    message.
    """
    os.chdir(root)

    def say(word: str, what: Any) -> None:
        connection.send((word, what))

    try:
        say("done", as_json(JOBS[kind].run(Folder(root), spec | {"processors": processors}, say)))
    except ShoalError as error:
        say("failed", fault_of(error, spec))
    except MemoryError:
        say(
            "failed",
            {
                "error": (
                    "the job needs more memory than the studio allows; the command has no such"
                    " limit"
                )
            },
        )
    except OSError as error:
        say(
            "failed",
            {
                "error": (
                    f"cannot read or write {error.filename or 'a file'}: {error.strerror or error}"
                )
            },
        )
    except Exception as error:  # as a last resort, the browser gets any exception as text
        say("failed", {"error": describe_error(error, most=300)})


def play(folder: Folder, spec: dict[str, Any], say: Say) -> dict[str, Any]:
    """Run an episode, and report the moves of the episode during the run.

    A search with the entry "missions", the options of its missions, follows the plan of the missions.
    """
    problem, seed = checked_problem(spec["problem"], folder), checked_seed(spec)
    # a swarm's problem has it
    if problem.part == "swarm" and problem.noise is None:  # type: ignore[attr-defined]
        episode: Any = play_live(problem, seed, say)
    elif isinstance(problem, SearchProblem):
        say("progress", (0.0, "planning"))
        options = mission_options(spec, folder)
        episode = planned_search(problem.opened(), options, seed=seed).run(seed=seed)
    else:
        say("progress", (0.0, "planning"))
        episode = shoal.run(problem, seed=seed)
    suffix = ".npz" if problem.part == "swarm" else ".episode.json"
    what = str(
        getattr(episode, "policy", getattr(episode, "planner", getattr(episode, "allocation", "")))
    )
    place = Path(str(spec["problem"].get(next(iter(problem.declarations())), ""))).name
    name = folder.new_name(
        "-".join(filter(None, (place[:30], what.partition(":")[0], f"seed{seed}"))), suffix
    )
    episode.save(folder.path(name))
    return {"file": name, "sentence": episode.sentence, "report": episode.report()}


def play_live(problem: Any, seed: int, say: Say) -> Any:
    """Run an episode of a swarm. Report the start, each piece of moves, and the end of the episode
    immediately.
    """
    from shoal.core.episode import Status
    from shoal.swarm.episode import SwarmEpisode
    from shoal.swarm.grid.board import decode, trial_rng
    from shoal.swarm.grid.scans import Trace
    from shoal.swarm.run import run
    from shoal.views.swarm.page import page_data

    setup = problem.setup
    start, targets = setup.draw_start(trial_rng(seed, 0))
    begun = SwarmEpisode(
        problem, start, Trace.empty(0), Status.LIMIT, setup.policy_name, 0, targets, seed
    )
    every = problem.scanning.every_move
    say("piece", {"begin": page_data(begun) | {"status": ""}})
    goal = max(1, cells_to_classify(problem.place.free) if targets is None else int(targets.sum()))
    counts = {"moves": 0, "classified": len(start)}
    if begun.task == "gathering":
        goal, counts["classified"] = max(1, begun.replay.end.first_frontier), 0

    def on_trace(trace: Trace) -> None:
        scans = None if every else "".join("01"[scan] for scan in trace.scanned.tolist())
        say("piece", {"commands": decode(trace.commands), "scans": scans})
        counts["moves"] += trace.moves
        counts["classified"] += int(trace.classified.sum())
        say(
            "progress", (max(0, min(0.99, counts["classified"] / goal)), f"{counts['moves']} moves")
        )

    episode = run(problem, seed=seed, on_trace=on_trace)
    say("piece", {"end": str(episode.status), "unreachable": episode.unreachable})
    return episode


def cells_to_classify(free: Any) -> int:
    """Return the maximum number of cells that a mapping can classify: all free cells, and the walls
    beside free cells.
    """
    from scipy import ndimage

    return int(ndimage.binary_dilation(np.pad(free, 1)).sum())


def compare_policies(folder: Folder, spec: dict[str, Any], say: Say) -> dict[str, Any]:
    """Run trials of several policies with common start cells. Save the first episode of each
    policy.
    """
    from shoal.swarm.run import run

    policies = spec["policies"]
    trials = check_integer(spec.get("trials", 10), what="trials", least=2, most=MOST_TRIALS)
    seed = checked_seed(spec)
    if not isinstance(policies, list) or not 2 <= len(policies) <= MOST_COMPARED:
        raise InvalidInputError(
            f"policies: expected 2 to {MOST_COMPARED} policies, got {shortened(policies)}"
        )
    problems = [
        checked_problem(spec["problem"] | {"policy": policy}, folder, part="swarm")
        for policy in policies
    ]
    place = problems[0].place
    problems = [problem.at_place(place) for problem in problems]
    rows: list[list[Any]] = [[] for _ in policies]
    files: list[str] = []
    for trial in range(trials):
        for row, problem in zip(rows, problems, strict=True):
            # made of a swarm's fields
            episode = run(problem, seed=seed, trial=trial)  # type: ignore[arg-type]
            row.append((episode.moves, str(episode.status)))
            if trial == 0:
                files.append(folder.new_name(f"compared-{episode.policy}-seed{seed}", ".npz"))
                episode.save(folder.path(files[-1]))
            done = (trial * len(rows) + len([one for one in rows if len(one) > trial])) / (
                trials * len(rows)
            )
            say("progress", (done, f"trial {trial + 1} of {trials}"))
        if trial:
            say("piece", {"compared": _compared(policies, rows)})
    result = {"compared": _compared(policies, rows), "files": files, "trials": trials}
    name = folder.new_name(f"compared-{Path(str(spec['problem']['map'])).name}", ".comparison.json")
    write_json(folder.path(name), as_json(result | {"problem": spec["problem"], "seed": seed}))
    return result | {"file": name}


def _compared(policies: list[str], rows: list[list[Any]]) -> dict[str, Any]:
    """Return each policy's mean number of moves with a confidence interval, and its paired
    difference from the best policy.
    """
    from shoal.lab.statistics import compare as paired
    from shoal.lab.statistics import estimate

    whole = min(map(len, rows))
    moves = [[one[0] for one in row[:whole]] for row in rows]
    best = min(range(len(rows)), key=lambda k: float(np.mean(moves[k])))
    compared_policies = []
    for k, policy in enumerate(policies):
        mean, against = estimate(moves[k]), paired(moves[best], moves[k])
        compared_policies.append(
            {
                "policy": policy,
                "mean": mean.mean,
                "low": mean.low,
                "high": mean.high,
                "values": moves[k],
                "unfinished": sum(status != "complete" for _, status in rows[k][:whole]),
                "more": against.difference.mean,
                "moreLow": against.difference.low,
                "moreHigh": against.difference.high,
                "p": against.p_value,
            }
        )
    compared: dict[str, Any] = as_json(
        {"policies": compared_policies, "best": best, "trials": whole}
    )
    return compared


def export_episode(folder: Folder, spec: dict[str, Any], say: Say) -> dict[str, Any]:
    """Write a figure, a film or a player page of an episode, and return the name of the file.

    A figure with the entry "width" (millimetres) is one for print, with a caption beside it. The
    entries "font_size" (points) and "at" (moves, or of a search seconds) may go with it. A film with
    the entry "size" is one for presentations; the entry "rate" may go with it.
    """
    from shoal.views import MOMENTS, caption, figure, figure_kinds, film, save_figure
    from shoal.views.drawing.charts import PRINT_DPI

    suffix = check_choice(spec.get("format"), what="format", choices=FORMATS)
    for name in ("width", "font_size", "at"):
        if suffix not in _FIGURES and spec.get(name) is not None:
            raise InvalidInputError(
                f"{name}: expected none for a film or a page, got {shortened(spec[name])}"
            )
    for name in ("size", "rate"):
        if suffix in _FIGURES and spec.get(name) is not None:
            raise InvalidInputError(f"{name}: expected none for a figure, got {spec[name]}")
    source = folder.path(str(spec.get("episode")))
    say("progress", (0.0, f"reading {source.name}"))
    episode = episode_in(source)
    stem = source.name.removesuffix(".json").removesuffix(".episode")
    stem = stem.removesuffix(".npz").removesuffix(".jsonl")
    name = folder.new_name(f"{stem}-figure" if suffix in _FIGURES else stem, f".{suffix}")
    if suffix in _FIGURES:
        width, at = spec.get("width"), spec.get("at")
        kind = figure_kinds(episode)[0]
        moment = {} if at is None else {MOMENTS[kind]: at}
        drawn = figure(episode, width=width, font_size=spec.get("font_size"), **moment)
        save_figure(drawn, folder.path(name), dpi=None if width is None else PRINT_DPI)
        if width is not None:
            text = caption(
                episode,
                kind=kind,
                moment=None if at is None else f"{at:g}",
                command=None
                if episode.seed is None
                else command_beside(episode.problem, folder.path(name), seed=episode.seed)[0],
            )
            write_text(folder.path(name).with_suffix(".caption.txt"), text)
    else:
        film(
            episode,
            folder.path(name),
            size=spec.get("size"),
            rate=spec.get("rate"),
            on_frame=lambda done, total: say("progress", (done / total, f"frame {done}")),
        )
    return {"file": name}


def reproduce_figures(folder: Folder, spec: dict[str, Any], say: Say) -> dict[str, Any]:
    """Reproduce one figure of the papers; or, without the name of a figure, reproduce all figures
    and write a page of results.
    """
    from shoal.papers.reproduce import recipes, reproduce, reproduce_all

    name, quick, out = spec.get("name"), spec.get("quick") is not False, folder.path(PAPERS)
    if name is None:
        done: list[str] = []

        def on_result(result: Any) -> None:
            done.append(result.recipe.name)
            say(
                "progress",
                (len(done) / (len(list(recipes())) + 1), f"{result.recipe.name} is done"),
            )

        page = reproduce_all(out, quick=quick, workers=1, on_result=on_result)
        return {"file": f"{PAPERS}/{page.name}"}
    recipe = recipes().get(check_text(name, what="name"))
    said = [0.0]

    def on_progress(now: Any) -> None:
        if time.monotonic() - said[0] > 0.2:
            said[0] = time.monotonic()
            say("progress", (now.done / max(1, now.total), f"{now.done} of {now.total} trials"))

    result = reproduce(recipe.name, out, quick=quick, workers=1, on_progress=on_progress)
    return {"file": f"{PAPERS}/{result.files[0].name}"}


_EPOCH = (1980, 1, 1, 0, 0, 0)  # so that equal missions give equal archives


def missions_zip(folder: Folder, spec: dict[str, Any], say: Say) -> dict[str, Any]:
    """Plan a search, and write and check its missions. Return the names of the archive and the map,
    and the linter's report.

    The archive also holds the files that the problem and the options name, so that the command in
    the result runs in the unpacked archive.
    """
    from shoal.missions.profile import height_profiles
    from shoal.views.search.missions import MAP, save_missions_map

    problem, seed = checked_problem(spec["problem"], folder, part="search"), checked_seed(spec)
    assert isinstance(problem, SearchProblem)
    if problem.vehicle is None:
        raise InvalidInputError(
            "vehicle: expected one, for whose speed and turns missions are planned, got none"
        )
    options = mission_options(spec, folder) or MissionOptions()
    command = " ".join(
        [as_command(problem, seed=seed), "--missions=missions", *mission_words(options)]
    )
    with tempfile.TemporaryDirectory() as place:
        inside, checked = Path(place, "missions"), Path(place, "check")
        say("progress", (0.1, "planning"))
        made = MissionSet.from_problem(problem, options, seed=seed)
        say("progress", (0.4, "writing missions"))
        made.write(inside)
        save_missions_map(made, inside)
        say("progress", (0.7, "checking missions"))
        result = made.check()
        result.write(checked)
        found = {
            "missions": made.report(),
            "check": result.report(),
            "command": command,
            "profiles": [
                {
                    "robot": one.robot,
                    "sortie": one.sortie,
                    "times": np.round(one.times, 1).tolist(),
                    "heights": np.round(one.heights, 2).tolist(),
                    "ground": None if one.ground is None else np.round(one.ground, 2).tolist(),
                }
                for one in height_profiles(made)
            ],
        }
        asked = {"problem": spec["problem"], "missions": spec.get("missions") or {}, "seed": seed}
        write_json(Path(place, MISSIONS_PAGE), as_json(asked | {"written": found}))
        stem = Path(str(problem.region)).name.partition(".")[0].replace(":", "-")
        name = folder.new_name(stem, ".missions.zip")
        with (
            atomic(folder.path(name)) as temporary,
            zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive,
        ):
            for path in sorted(file for file in Path(place).rglob("*") if file.is_file()):
                archive.writestr(
                    zipfile.ZipInfo(path.relative_to(place).as_posix(), _EPOCH), path.read_bytes()
                )
            for own in folder.named_in(spec["problem"], asked["missions"]):
                archive.writestr(zipfile.ZipInfo(own, _EPOCH), folder.path(own).read_bytes())
        picture = folder.new_name(f"{stem}-missions-figure", ".png")
        with atomic(folder.path(picture)) as temporary:
            temporary.write_bytes((inside / MAP).read_bytes())
    return {"file": name, "map": picture, **found}


FIGURES = ("png", "svg")
"""File suffixes for the figures of a sweep."""


def run_missing_trials(folder: Folder, spec: dict[str, Any], say: Say) -> dict[str, Any]:
    """Run the missing trials of a sweep.

    The job first records the sweep in the store, and then writes the sweep file beside the store.
    """
    text = check_text(spec.get("toml"), what="toml")
    sweep = checked_sweep(text, folder)
    store = check_text(spec.get("store", f"{sweep.name}.sqlite"), what="store")
    path = folder.path(store)
    if spec.get("sweep") not in (None, sweep.name):
        raise InvalidInputError(f"sweep: expected {sweep.name}, got {shortened(spec['sweep'])}")
    if path.suffix != ".sqlite":
        raise InvalidInputError(f"store: expected a name that ends with .sqlite, got {store!r}")
    _check_sweep_file(path.with_suffix(".toml"), sweep.name)
    begun = False

    def tell(progress: SweepProgress) -> None:
        nonlocal begun
        if not begun:
            begun = True
            write_text(path.with_suffix(".toml"), text)
        failed = f", {progress.failures} failed" * bool(progress.failures)
        say(
            "progress",
            (progress.done / progress.total, f"{progress.done} of {progress.total} trials{failed}"),
        )

    processors = spec.get("processors", 1)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", MixedVersionsWarning)
        status = run_sweep(
            sweep, path, workers=0 if processors == 1 else processors, extend=True, on_progress=tell
        )
    mixed = next(
        (str(one.message) for one in said if issubclass(one.category, MixedVersionsWarning)), None
    )
    return {
        "file": store,
        "sweep": sweep.name,
        "done": status.done,
        "failures": status.failures,
        "warning": mixed,
    }


def _check_sweep_file(path: Path, name: str) -> None:
    """Refuse to replace a file other than that of an earlier form of a sweep."""
    try:
        earlier = Sweep.load(path).name if path.exists() else name
    except ShoalError:
        earlier = "no sweep"
    if earlier != name:
        raise InvalidInputError(
            f"store: expected one whose file {path.name} is free, or is that of the sweep {name},"
            f" got {earlier} there; take another store or name"
        )


def write_results(folder: Folder, spec: dict[str, Any], say: Say) -> dict[str, Any]:
    """Write the table of a sweep, or a figure of one measure of the sweep."""
    kind = check_choice(
        spec.get("format"), what="format", choices=(*(suffix[1:] for suffix in SUFFIXES), *FIGURES)
    )
    path, measure = folder.path(str(spec.get("store"))), spec.get("measure")
    if (measure is None) == (kind in FIGURES):
        expected = (
            "a measure for a figure" if measure is None else "none for a table, of all measures"
        )
        raise InvalidInputError(f"measure: expected {expected}, got {shortened(measure)}")
    say("progress", (0.0, f"reading {path.name}"))
    with Store(path) as store:
        name = store.only(spec.get("sweep"))
        if kind not in FIGURES:
            file = folder.new_name(name, f".{kind}")
            export(store, name, folder.path(file))
            return {"file": file}
        from shoal.views import save_figure
        from shoal.views.drawing.curves import means_figure

        rows = [row for row in summarise(store, name, str(measure)) if row.estimate]
        file = folder.new_name(f"{name}-{measure}-figure", f".{kind}")
        save_figure(means_figure(rows, title=name, measure=str(measure)), folder.path(file))
    return {"file": file}


@dataclass(frozen=True)
class Job:
    """A kind of job: the function that does it, and the fields of its description."""

    run: Callable[[Folder, dict[str, Any], Say], dict[str, Any]]
    fields: dict[str, Field]
    part: str | None = None
    """The part of Shoal whose problems the job takes; None if it takes problems of every part."""
    long: bool = False
    """Whether the queue keeps one processor free for interactive jobs while such a job runs."""


JOBS: dict[str, Job] = {
    "play": Job(play, {"problem": OBJECT, "missions": MAYBE_OBJECT, "seed": SEED}),
    "compare": Job(
        compare_policies,
        {"problem": OBJECT, "policies": LIST, "trials": MAYBE_INTEGER, "seed": SEED},
        part="swarm",
    ),
    "export": Job(
        export_episode,
        {
            "episode": TEXT,
            "format": TEXT,
            "width": MAYBE_NUMBER,
            "font_size": MAYBE_NUMBER,
            "at": MAYBE_NUMBER,
            "size": MAYBE_TEXT,
            "rate": MAYBE_INTEGER,
        },
    ),
    "reproduce": Job(reproduce_figures, {"name": MAYBE_TEXT, "quick": MAYBE_BOOL}, long=True),
    "sweep": Job(
        run_missing_trials, {"toml": TEXT, "store": MAYBE_TEXT, "sweep": MAYBE_TEXT}, long=True
    ),
    "table": Job(
        write_results, {"store": TEXT, "sweep": MAYBE_TEXT, "measure": MAYBE_TEXT, "format": TEXT}
    ),
    "missions": Job(
        missions_zip, {"problem": OBJECT, "missions": MAYBE_OBJECT, "seed": SEED}, part="search"
    ),
}
"""The kinds of jobs."""
