"""Answers about files that any page may show: episodes for the player, a problem as Python code,
command or file, and the reproduced figures of the papers.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np

from shoal.core.checks import parse_json, read_text
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.core.files import atomic
from shoal.parts import LARGEST_PROBLEM
from shoal.search.episode import SearchEpisode
from shoal.search.problem import SearchProblem
from shoal.studio.answers.search import drawing_in, placed_problem
from shoal.studio.folder import PAPERS, Folder, episode_in
from shoal.studio.forms import checked_problem, checked_seed, copies_of, mission_options
from shoal.studio.searching import is_same_plan, planned_search


def page(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Read an episode file in the folder, and return the episode as data for the player."""
    from shoal.views import page_data

    name = str(about["file"])
    episode: Any = episode_in(folder.path(name))
    data = page_data(episode)
    fields = episode.problem.to_dict()
    return {
        "part": episode.part,
        "data": data,
        "problem": fields,
        "seed": episode.seed,
        "sentence": episode.sentence,
    }


def settings(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the problem of an episode file and its seed, as a page takes them up.

    An episode holds its map, region or workspace, and somebody else may have the file that it was
    read from. A region is returned as a drawing, and a workspace as text. Cells of a map that the
    problem does not open here are written to a new file (``written``), which takes the place of
    the map. Random points of a steering problem are returned as the episode has drawn them: with
    another field, such as the radius of the particles, the same seed draws others. Of a search,
    there are also the settings of its missions (``missions``), and a ``note`` if all these settings
    do not give its plan.
    """
    name = str(about["file"])
    episode: Any = episode_in(folder.path(name))
    fields = episode.problem.to_dict()
    answer: dict[str, Any] = {"seed": str(episode.seed or 0), "written": None, "drawing": None}
    if episode.part == "search":
        return answer | _settings_of_search(folder, episode, answer | {"problem": fields})
    if episode.part == "steering":
        workspace = fields.setdefault("workspace", episode.problem.workspace)
        if isinstance(workspace, dict) and workspace.get("type") == "polygon":
            corners = workspace["vertices"]
            pairs = ", ".join(f"{x!r} {y!r}" for x, y in [*corners, corners[0]])
            fields["workspace"] = f"POLYGON (({pairs}))"
        start, goal = episode.problem.endpoints(episode.seed)
        fields |= {"start": start.tolist(), "goal": goal.tolist()}
    elif episode.part == "swarm" and not _opens(folder, fields, episode.workspace):
        fields, answer["written"] = _with_cells(folder, fields, episode.workspace)
    return answer | {"problem": fields}


CHOSEN = ("margin", "cross_track", "delays")
"""Fields of a search that missions choose, unless they are given."""


def _settings_of_search(
    folder: Folder, episode: SearchEpisode, about: dict[str, Any]
) -> dict[str, Any]:
    """Return the settings of the page Search that give the plan of an episode, as few as
    possible, with a ``note`` if none were found that do.

    What missions choose is in the problem of their episode, and need not be set.
    """
    plan, fields = episode.plan, about["problem"]
    if isinstance(fields["region"], dict):
        about["drawing"] = drawing_in(episode.problem.place)
        del fields["region"]
    if plan.schedule is None:  # without a vehicle, the page plans no missions anyway
        return about | {"missions": None if plan.flies else {}}
    for kept in ((), ("margin",), ("cross_track",), ("margin", "cross_track"), CHOSEN):
        some = {name: fields[name] for name in fields if name in kept or name not in CHOSEN}
        settings = about | {"problem": some, "missions": {}}
        with suppress(ShoalError, OSError):
            found = planned_search(
                placed_problem(folder, settings),
                mission_options(settings, folder),
                seed=checked_seed(settings),
            )
            if is_same_plan(plan, found.plan):
                return settings
    return settings | {
        "note": (
            "The plan of these settings is not that of the episode, which was made with other"
            " settings of missions, or by another version of Shoal."
        )
    }


def _with_cells(
    folder: Folder, fields: dict[str, Any], workspace: Any
) -> tuple[dict[str, Any], str]:
    """Write the cells of a map to a file, new unless an earlier call wrote the same. Return the
    problem with this map, and the file.
    """
    from shoal.swarm.maps.files import write_map
    from shoal.swarm.problem import READING

    stem = workspace.name.rpartition("/")[2].partition(".")[0].replace(":", "-")
    end = ".map" if workspace.ndim == 2 else ".npy"
    sides = {"cell_size": workspace.spacing[0]} if workspace.spacing else {}
    kept = {key: value for key, value in fields.items() if key not in READING} | sides
    written = f"{stem}-map{end}"
    if not _opens(folder, kept | {"map": written}, workspace):
        written = folder.new_name(f"{stem}-map", end)
        write_map(workspace, folder.path(written))
    return kept | {"map": written}, written


def _opens(folder: Folder, fields: dict[str, Any], workspace: Any) -> bool:
    """Return whether a problem opens the cells of a map in this folder."""
    try:
        place: Any = checked_problem(fields, folder, part="swarm").opened().place
    except (ShoalError, OSError):
        return False
    return np.array_equal(place.free, workspace.free)


def copies(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return a problem, or the problem of an episode file, in three forms: as Python code, as a
    command and as the text of a file.

    The seed of an episode is the episode's own. A search with ``missions``, the options of its
    missions, follows their plan, as on its page.
    """
    if (about.get("file") is None) == (about.get("problem") is None):
        raise InvalidInputError(
            "copies: expected either a problem or the file of an episode, got both or none"
        )
    missions = None
    if about.get("file") is None:
        problem, seed = checked_problem(about["problem"], folder), checked_seed(about)
        options = mission_options(about, folder)
        if options is not None and isinstance(problem, SearchProblem):
            found = planned_search(problem.opened(), options, seed=seed)
            missions = None if found.missions is None else options
    else:
        episode = episode_in(folder.path(about["file"]))
        problem, seed = episode.problem, episode.seed
        if seed is None or getattr(episode, "observations", None) is not None:
            raise InvalidInputError(
                f"{about['file']}: expected an episode with a seed, got one that no seed repeats"
            )
    copies = copies_of(problem, seed=seed, missions=missions)
    return copies | {"problem": problem.to_dict(), "seed": str(seed)}


def save_problem(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Write a problem file, and return the name of the file."""
    problem = checked_problem(about["problem"], folder)
    name = folder.new_name(str(about.get("name") or problem.part), ".json")
    with atomic(folder.path(name)) as temporary:
        temporary.write_text(copies_of(problem, seed=checked_seed(about))["file"], encoding="utf-8")
    return {"file": name}


def papers(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the figures of the papers, each with its result, or with None if the figure was not
    reproduced in the folder.
    """
    from shoal.papers.reproduce import recipes

    answer = []
    for name in recipes():
        recipe = recipes().get(name)
        one: dict[str, Any] = {
            "name": name,
            "source": recipe.source,
            "title": recipe.title,
            "result": None,
        }
        summary = folder.path(f"{PAPERS}/{name}.json")
        if summary.is_file():
            found = parse_json(
                read_text(summary, what="summary", most=LARGEST_PROBLEM), where=str(summary)
            )
            if isinstance(found, dict) and found.get("figure") == name:
                one["result"] = {
                    key: found.get(key) for key in ("verdict", "claims", "sentence", "files")
                }
        answer.append(one)
    page_file = folder.path(f"{PAPERS}/index.html")
    return {"figures": answer, "page": f"{PAPERS}/index.html" if page_file.is_file() else None}
