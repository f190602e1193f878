"""Functions that run the sweeps of a recipe, draw its figure, and store its data."""

from __future__ import annotations

import csv
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

from shoal.core.checks import check_function, check_integer
from shoal.core.errors import InvalidInputError, describe_error
from shoal.core.files import atomic, write_json
from shoal.core.registry import Registry
from shoal.lab.coordinator import OnProgress, run_sweep
from shoal.lab.store import Store
from shoal.lab.sweep import Sweep
from shoal.papers.errata import check_errata
from shoal.papers.mapping import curves, exploration, instances, line, two_dimensions
from shoal.papers.page import write_page
from shoal.papers.recipe import Outcome, Recipe, Result, Settings
from shoal.papers.search import baselines, expected_time, wishes
from shoal.papers.steering import constructions, illustrations, many, shortest_paths
from shoal.papers.steering import recipes as steering
from shoal.swarm.maps.files import open_map
from shoal.views.drawing.charts import save_figure
from shoal.views.drawing.curves import add_note

STORE = "results.sqlite"
PARTS = (
    instances,
    line,
    exploration,
    two_dimensions,
    curves,
    steering,
    constructions,
    shortest_paths,
    illustrations,
    many,
    expected_time,
    baselines,
    wishes,
)


@cache
def recipes() -> Registry[Recipe]:
    """Return the registry of all recipes by name, in the order of the papers."""
    recipes: Registry[Recipe] = Registry("figure")
    for recipe in chain(*(part.RECIPES for part in PARTS)):
        recipes.add(recipe.name, recipe)
    return recipes


def reproduce(
    name: str,
    out: str | os.PathLike[str],
    *,
    quick: bool = False,
    trials: int | None = None,
    on_map: str | None = None,
    seed: int = 0,
    workers: int | None = None,
    on_progress: OnProgress | None = None,
) -> Result:
    """Reproduce one figure or theorem of a paper.

    Parameters
    ----------
    name : str
        Name of the figure, such as "m-fig7"; `recipes` returns all names.
    out : path
        Output folder for NAME.png, NAME.json, the data NAME*.csv, and results.sqlite. A later call
        of the function continues with the stored results in results.sqlite.
    quick : bool
        Whether to save time by fewer trials and coarser maps.
    trials : int, optional
        Number of trials for each point of a sweep.
    on_map : str, optional
        A picture or the name of a map. This map replaces the unpublished "complex" map of paper M.
    seed, workers : int
        Seed of the sweeps, and number of worker processes, as in `shoal.lab.coordinator`.
    on_progress : callable, optional
        Function that Shoal calls with the progress of each sweep.
    """
    check_function(on_progress, what="on_progress")
    recipe, folder = recipes().get(name), Path(out)
    if on_map is not None and not recipe.on_map:
        raise InvalidInputError(
            f"map: expected a figure that is computed on the complex map, got {name}, which uses"
            " other maps"
        )
    if trials is not None:
        trials = check_integer(trials, what="trials", least=1)
    if workers is not None:
        check_integer(workers, what="workers", least=0)
    settings = Settings(
        quick, trials, on_map, check_integer(seed, what="seed", least=0, most=2**63 - 1)
    )
    began, sweeps = time.perf_counter(), []
    planned = list(recipe.sweeps(settings))
    folder.mkdir(parents=True, exist_ok=True)  # once nothing can be refused
    for sweep in planned:
        kept = _no_fewer(folder / STORE, sweep)
        status = run_sweep(
            kept, folder / STORE, workers=workers, extend=True, on_progress=on_progress
        )
        if status.failures:
            raise InvalidInputError(
                f"{name}: expected every trial to end, got {_failures(folder / STORE, kept)}"
            )
        sweeps.append(kept)
    with Store(folder / STORE, write=not sweeps) as store:  # figures without sweeps have none
        outcome = recipe.view(store, sweeps, settings)
    seconds = time.perf_counter() - began
    files = _write(folder, recipe, outcome, sweeps)
    return Result(recipe, outcome, files, seconds, sum(sweep.total for sweep in sweeps))


def _failures(path: Path, sweep: Sweep) -> str:
    """Return a text with the number of failed trials of a sweep, and the error of the first failed
    trial.
    """
    with Store(path) as store:
        failed = store.failures(sweep.name)
    values, trial, _, error = failed[0]
    where = ", ".join([*(f"{name} = {value}" for name, value in values.items()), f"trial {trial}"])
    return f"{len(failed)} of {sweep.total} failed, the first at {where}: {error}"


def _no_fewer(path: Path, sweep: Sweep) -> Sweep:
    """Return a copy of a sweep with at least as many trials as the stored sweep of the
    same name.
    """
    if not path.exists():
        return sweep
    with Store(path) as store:
        stored = store.sweep(sweep.name).trials if sweep.name in store.names else 0
    return replace(sweep, trials=max(sweep.trials, stored))


def _write(
    folder: Path, recipe: Recipe, outcome: Outcome, sweeps: Sequence[Sweep]
) -> tuple[Path, ...]:
    files = [folder / f"{recipe.name}.png"]
    add_note(outcome.figure, outcome.note)
    save_figure(outcome.figure, files[0])
    for k, table in enumerate(outcome.tables):
        path = folder / f"{recipe.name}{f'-{k + 1}' * bool(k)}.csv"
        with atomic(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow([column or "name" for column in table.columns])
            writer.writerows(table.rows)
        files.append(path)
    summary = {
        "figure": recipe.name,
        "source": recipe.source,
        "title": recipe.title,
        "verdict": outcome.verdict,
        "claims": [asdict(claim) for claim in outcome.claims],
        "sentence": outcome.sentence,
        "sweeps": [sweep.describe() for sweep in sweeps],
        "files": [path.name for path in files],
        "tables": [table.title for table in outcome.tables],
    }
    files.append(folder / f"{recipe.name}.json")
    write_json(files[-1], summary)
    return tuple(files)


def reproduce_all(
    out: str | os.PathLike[str],
    *,
    on_result: Callable[[Result], None] | None = None,
    on_map: str | None = None,
    **options: Any,
) -> Path:
    """Reproduce every figure, run the checks of all errata, and write the page of results; return
    the path of the page.

    A failed figure does not stop the other figures. For a failed figure, the page of results gives
    the reason.

    Parameters
    ----------
    out : path
        Output folder for the page of results and the files of all figures.
    on_result : callable, optional
        Function that Shoal calls with the `Result` of each figure.
    on_map : str, optional
        A picture, or the name of a map, for all figures on the "complex" map of paper M.
    **options
        Other options of the function `reproduce`.

    Raises
    ------
    InvalidInputError, OutputError
        If an option is invalid for every figure, or if writing the page of results fails.
    """
    check_function(on_result, what="on_result")
    if on_map is not None:
        open_map(on_map)
    if options.get("trials") is not None:
        check_integer(options["trials"], what="trials", least=1)
    results = []
    for name in recipes():
        recipe, began = recipes().get(name), time.perf_counter()
        try:
            result = reproduce(name, out, on_map=on_map if recipe.on_map else None, **options)
        except Exception as error:  # any exception: the other figures are still made
            said = describe_error(error)
            result = Result(recipe, None, (), time.perf_counter() - began, 0, said)
        results.append(result)
        if on_result is not None:
            on_result(result)
    return write_page(results, check_errata(), Path(out) / "index.html")
