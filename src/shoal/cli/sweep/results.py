"""shoal sweep summary, export, merge, check: commands for the results of sweeps in a store."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.output import check_folder, print_columns, print_json, print_table, say
from shoal.core.files import check_suffix, write_json

if TYPE_CHECKING:
    from shoal.lab import Store
    from shoal.lab.statistics import Comparison, Row

SUMMARY_EXAMPLE = "Example: shoal sweep summary results.sqlite --measure moves --compare policy"
EXPORT_EXAMPLE = "Example: shoal sweep export results.sqlite --out results.csv"
MERGE_EXAMPLE = "Example: shoal sweep merge results.sqlite --out merged.sqlite"
CHECK_EXAMPLE = "Example: shoal sweep check results.sqlite"

StoreFile = Annotated[
    Path, typer.Argument(metavar="STORE", help="File with the results of sweeps.")
]
SweepName = Annotated[
    str | None,
    typer.Option(
        "--sweep",
        metavar="NAME",
        help="Name of the sweep, required if the store contains several sweeps.",
    ),
]


def check_table(out: Path) -> None:
    """Raise an error if Shoal cannot write the table file ``out``."""
    from shoal.lab.exchange import SUFFIXES

    check_folder(check_suffix(out, *SUFFIXES).parent)


Method = Annotated[
    str,
    typer.Option(
        "--method",
        help=(
            "Method of the confidence intervals: t (Student), log (Student on a log scale, never"
            " below 0; in comparisons, an interval of the ratio) or bootstrap. auto means log for"
            " means of counts, and t for differences."
        ),
    ),
]


def summary(
    store: StoreFile,
    name: SweepName = None,
    measure: Annotated[
        str | None, typer.Option("--measure", help="Measure to summarise, such as moves.")
    ] = None,
    compare: Annotated[
        str | None,
        typer.Option(
            "--compare",
            metavar="AXIS",
            help=(
                "Name of a paired axis. The summary compares each value of the axis with the first"
                " value."
            ),
        ),
    ] = None,
    level: Annotated[
        float, typer.Option("--level", help="Confidence level of the intervals.")
    ] = 0.95,
    method: Method = "auto",
    seed: options.UnusedSeed = 0,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Also write the result as JSON.")
    ] = None,
    json_: options.Json = False,
) -> None:
    """Show means with confidence intervals, and compare the values of a paired axis.

    If some trials ended before their task was complete, the summary states the number of unfinished
    trials. For a measure that grows until the end of a trial, unfinished trials turn the mean into
    a restricted mean. In a restricted mean, every value above a cutoff counts as the cutoff. The
    cutoff of a restricted mean is the smallest value at which a trial ended unfinished.
    """
    from shoal.core.checks import check_choice
    from shoal.lab import Store
    from shoal.lab.statistics import METHODS, compare_along, first_measure, summarise

    if out is not None:
        check_folder(out.parent)
    way: Any = check_choice(method, what="--method", choices=METHODS)
    with Store(store) as opened:
        chosen = opened.only(name)
        wanted = measure or first_measure(opened.stored(chosen).measures)
        _say_if_mixed(opened, chosen)
        rows = summarise(opened, chosen, wanted, level=level, method=way)
        pairs = (
            compare_along(opened, chosen, wanted, compare, level=level, method=way)
            if compare
            else []
        )
    result = {
        "sweep": chosen,
        "measure": wanted,
        "level": level,
        "method": method,
        "points": [
            {
                "axes": row.values,
                "trials": row.counted,
                "missing": row.missing,
                "completed": row.completed,
                "bound": row.bound,
                "estimate": row.estimate and _numbers(asdict(row.estimate)),
            }
            for row in rows
        ],
        "comparisons": [
            {
                "axes": others,
                compare: [first, second],
                "comparison": None if found is None else _numbers(asdict(found)),
            }
            for others, first, second, found in pairs
        ],
    }
    if out is not None:
        write_json(out, result)
    if json_:
        print_json(result)
        return
    title = f"{wanted} along {compare}, on the same seeds"
    _print_summary(
        rows, pairs, compare, means=f"{wanted} of {chosen}", along=title, level=level, method=way
    )


def _print_summary(
    rows: Sequence[Row],
    pairs: Sequence[Any],
    compare: str | None,
    *,
    means: str,
    along: str,
    level: float,
    method: str,
) -> None:
    print_columns(
        [*rows[0].values] if rows else [],
        [f"mean [{100 * level:g} % interval]"],
        [[*map(str, row.values.values()), str(row)] for row in rows],
        title=means,
    )
    if pairs:
        print_columns(
            [*pairs[0][0], str(compare)],
            [
                "difference",
                f"ratio [{100 * level:g} % interval]" if method == "log" else "ratio",
                "effect",
                "p",
            ],
            [
                [*map(str, others.values()), *_compared(f"{second} less {first}", found)]
                for others, first, second, found in pairs
            ],
            title=along,
        )


def _compared(names: str, found: Comparison | None) -> list[str]:
    if found is None:
        return [
            names,
            "not comparable, fewer than two trials of both, or none of them finished",
            *3 * ["-"],
        ]
    return [
        f"{names}{found.note}",
        str(found.difference),
        found.ratio_text,
        f"{found.effect:.3g}",
        f"{found.p_value:.2g}",
    ]


def _say_if_mixed(store: Store, name: str) -> None:
    """Print a warning on stderr if several versions of Shoal or its libraries wrote the rows of a
    sweep.
    """
    from shoal.lab.versions import told_apart

    rows = store.versions(name)
    if len(rows) > 1:
        names = told_apart(rows)
        counted = ", ".join(f"{count} rows by {names[text]}" for text, count in rows.items())
        say(
            f"shoal: warning: {store.path}: sweep {name}: expected rows of one version, got"
            f" {counted}"
        )


def _numbers(found: Any) -> Any:
    """Return values as JSON data, in which None replaces infinite values and NaN."""
    if isinstance(found, dict):
        return {name: _numbers(value) for name, value in found.items()}
    return None if isinstance(found, float) and not isfinite(found) else found


def export_(
    store: StoreFile,
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="File for the table: .csv or .parquet.")
    ],
    name: SweepName = None,
    seed: options.UnusedSeed = 0,
    json_: options.Json = False,
) -> None:
    """Write a table with one row for each trial of a sweep: axes, trial, seed and measures."""
    from shoal.lab import Store
    from shoal.lab.exchange import export

    check_table(out)
    with Store(store) as opened:
        chosen = opened.only(name)
        _say_if_mixed(opened, chosen)
        count = export(opened, chosen, out)
    if json_:
        print_json({"sweep": chosen, "rows": count, "out": str(out)})
    else:
        print_table([("rows", str(count))], title=f"sweep {chosen}", written=[out])


def merge(
    stores: Annotated[
        list[Path], typer.Argument(metavar="STORES", help="Files with the results of sweeps.")
    ],
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="File for the merged results.")
    ],
    seed: options.UnusedSeed = 0,
    json_: options.Json = False,
) -> None:
    """Merge the results of the same sweeps in several stores, for example from several machines,
    into a new store.

    If several stores contain the same trial, its result must be the same in all these stores.
    """
    from shoal.lab import Store
    from shoal.lab.exchange import merge_stores

    check_folder(out.parent)
    names = merge_stores(stores, out)
    with Store(out) as opened:
        found = [opened.status(name) for name in names]
    if json_:
        print_json(
            {
                "out": str(out),
                "sweeps": [
                    {"name": one.name, "done": one.done, "total": one.total} for one in found
                ],
            }
        )
    else:
        print_table(
            [(one.name, f"{one.done} of {one.total} trials") for one in found],
            title=f"merged into {out}",
        )


def check(
    store: StoreFile,
    seed: options.UnusedSeed = 0,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Also write the result as JSON.")
    ] = None,
    json_: options.Json = False,
) -> None:
    """Check that a store is intact: its structure, keys, seeds and results. The exit code is 1 if a
    check fails.
    """
    from shoal.lab import Store
    from shoal.lab.store import faults_of

    if out is not None:
        check_folder(out.parent)
    with Store(store) as opened:
        faults, names = faults_of(opened), opened.names
    result = {"store": str(store), "sweeps": names, "faults": faults, "whole": not faults}
    if out is not None:
        write_json(out, result)
    if json_:
        print_json(result)
    else:
        print_table(
            [
                ("store", str(store)),
                ("sweeps", ", ".join(names) or "none"),
                ("faults", "; ".join(faults) or "none"),
            ],
            title="check",
        )
    if faults:
        say(f"shoal: {store}: {len(faults)} faults")
        raise typer.Exit(1)
