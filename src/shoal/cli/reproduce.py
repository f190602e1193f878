"""shoal reproduce: reproduce the figures of the papers on which Shoal is based."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.output import check_folder, print_json, print_table, say, warnings_said
from shoal.cli.sweep import live
from shoal.core.errors import InvalidInputError

if TYPE_CHECKING:
    from shoal.papers import Result

EXAMPLE = "Example: shoal reproduce h-fig5 --quick --trials 20 --out figures"


def reproduce(
    figure: Annotated[
        str | None,
        typer.Argument(
            metavar="[FIGURE]",
            help="Figure to reproduce, such as m-fig7. Without a name, Shoal lists all figures.",
        ),
    ] = None,
    all_: Annotated[
        bool,
        typer.Option(
            "--all",
            help=(
                "Reproduce all figures, check the listed errors of the papers, and write a page of"
                " results."
            ),
        ),
    ] = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="Use fewer trials and coarser maps than by default.")
    ] = False,
    trials: Annotated[
        int | None,
        typer.Option(
            "--trials", help="Number of trials at each point, in place of the default number."
        ),
    ] = None,
    map_: Annotated[
        str | None,
        typer.Option(
            "--map",
            metavar="PATH",
            help='Picture or name of a map, in place of the "complex" map of the papers.',
        ),
    ] = None,
    seed: options.Seed = 0,
    workers: options.Processes = None,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help=(
                "Folder for figures, data and results.sqlite. A later call with the same folder"
                " reuses finished trials."
            ),
        ),
    ] = Path("figures"),
    json_: options.Json = False,
) -> None:
    """Reproduce figures of the papers, and compare the numbers printed in the papers with Shoal's
    numbers.

    For each figure, Shoal states whether the printed numbers and Shoal's numbers agree, differ, or
    are not comparable.

    The exit code is 1 if Shoal could not make a figure. Differences from the numbers in a paper do
    not change the exit code.
    """
    from shoal.lab.batches import MixedVersionsWarning
    from shoal.papers import reproduce as reproduce_one

    if figure is not None and all_:
        raise InvalidInputError(f"--all: expected no figure beside this option, got {figure!r}")
    if figure is None and not all_:
        for name, given in (
            ("quick", quick),
            ("trials", trials),
            ("map", map_),
            ("workers", workers),
        ):
            if given not in (None, False):
                raise InvalidInputError(
                    f"--{name}: expected a figure beside it, or --all, got none"
                )
        _list(json_)
        return
    check_folder(out)
    chosen: dict[str, Any] = {
        "quick": quick,
        "trials": trials,
        "on_map": map_,
        "seed": seed,
        "workers": workers,
    }
    results: list[Result] = []
    page: Path | None = None
    if figure is not None:
        with live(figure) as tell, warnings_said(MixedVersionsWarning):
            results.append(reproduce_one(figure, out, on_progress=tell, **chosen))
    else:
        page = _all(out, chosen, results)
    if json_:
        print_json(
            {
                "figures": [_described(result) for result in results],
                "page": None if page is None else str(page),
            }
        )
    else:
        for result in results:
            print_table(_rows(result), title=f"{result.recipe.name}: {_answer(result)}")
        if page is not None:
            print_table([], title=f"all {len(results)} figures", written=[page])
    failed = [result for result in results if result.outcome is None]
    if failed:
        say(
            "shoal: could not reproduce"
            f" {'; '.join(f'{result.recipe.name}: {result.error}' for result in failed)}"
        )
        raise typer.Exit(1)


def _answer(result: Result) -> str:
    return "could not be made" if result.outcome is None else str(result.outcome.verdict)


def _rows(result: Result) -> list[tuple[str, str]]:
    rows = [("figure", f"{result.recipe.source}: {result.recipe.title}")]
    if result.outcome is None:
        return [*rows, ("error", result.error)]
    rows += [
        (one.verdict, f"{one.what}: printed {one.printed}, ours {one.ours} ({one.criterion})")
        for one in result.outcome.claims
    ]
    rows += [("finding", result.outcome.sentence)] * bool(result.outcome.sentence)
    rows.append(("work", f"{result.trials} trials, {result.seconds:.0f} s"))
    return [*rows, ("written", ", ".join(map(str, result.files)))]


def _all(out: Path, chosen: dict[str, Any], found: list[Result]) -> Path:
    from shoal.lab.batches import MixedVersionsWarning
    from shoal.papers import reproduce_all

    with live("figures") as tell, warnings_said(MixedVersionsWarning):

        def done(result: Result) -> None:
            found.append(result)
            if tell is None:
                say(f"{result.recipe.name}: {result.seconds:.0f} s")

        return reproduce_all(out, on_result=done, on_progress=tell, **chosen)


def _list(json_: bool) -> None:
    from shoal.papers import recipes

    registry = recipes()
    known = [registry.get(name) for name in registry]
    if json_:
        print_json(
            {
                "figures": [
                    {"name": r.name, "source": r.source, "title": r.title, "takes_a_map": r.on_map}
                    for r in known
                ]
            }
        )
        return
    print_table(
        [(r.name, f"{r.source}{'; also ' * bool(r.also)}{r.also}. {r.title}") for r in known],
        title="Figures of the papers",
    )


def _described(result: Result) -> dict[str, Any]:
    found: dict[str, Any] = {
        "name": result.recipe.name,
        "source": result.recipe.source,
        "verdict": None,
        "error": result.error or None,
    }
    if result.outcome is not None:
        found |= {
            "verdict": result.outcome.verdict,
            "claims": [asdict(one) for one in result.outcome.claims],
        }
        found["sentence"] = result.outcome.sentence
    return found | {
        "trials": result.trials,
        "seconds": result.seconds,
        "files": [str(path) for path in result.files],
    }
