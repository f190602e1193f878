"""shoal sweep run, status, summary, plot, export, merge, check: sweeps and their results."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.output import (
    cell,
    check_folder,
    print_columns,
    print_drawn,
    print_json,
    print_table,
    say,
    visible,
    warnings_said,
)
from shoal.core.checks import count_text
from shoal.core.errors import InvalidInputError
from shoal.core.files import as_json, check_suffix, write_json
from shoal.core.notices import quiet

if TYPE_CHECKING:
    from rich.table import Table

    from shoal.lab import Store, SweepProgress, SweepStatus
    from shoal.lab.statistics import Comparison, Row

RUN_EXAMPLE = "Example: shoal sweep run sweep.toml --store results.sqlite"
STATUS_EXAMPLE = "Example: shoal sweep status results.sqlite"

_EVERY = 2.0  # seconds between two updates of --watch
# seconds between two lines of progress, with and without a new tenth of the trials
_APART = 4.0
_SLOW = 60.0
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
PLOT_EXAMPLE = "Example: shoal sweep plot results.sqlite --measure moves --out moves.png"


def run(
    spec: Annotated[
        Path, typer.Argument(metavar="SPEC", help="TOML file that describes the sweep.")
    ],
    store: Annotated[
        Path,
        typer.Option(
            "--store",
            metavar="FILE",
            help="Store: file for the results. Shoal creates the file if it does not exist.",
        ),
    ],
    workers: options.Processes = None,
    dask: Annotated[
        str | None,
        typer.Option(
            "--dask", metavar="ADDRESS", help="Use the workers of the Dask scheduler at HOST:PORT."
        ),
    ] = None,
    trials: Annotated[
        int | None,
        typer.Option(
            "--trials", help="Number of trials at each point, in place of the number in the file."
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option("--seed", help="Seed of the sweep, in place of the seed in the file."),
    ] = None,
    extend: Annotated[
        bool,
        typer.Option(
            "--extend", help="Add trials or points to a sweep that is already in the store."
        ),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE",
            help="File for a table of the results, written at the end: .csv or .parquet.",
        ),
    ] = None,
    json_: options.Json = False,
) -> None:
    """Run the trials of a sweep that its store does not yet contain. To continue a stopped sweep,
    repeat the same command.

    The exit code is 1 if at least one trial failed.
    """
    from shoal.lab import Store, Sweep, run_sweep
    from shoal.lab.batches import MixedVersionsWarning

    sweep = Sweep.load(spec)
    changes: dict[str, Any] = {
        name: value for name, value in (("trials", trials), ("seed", seed)) if value is not None
    }
    sweep = replace(sweep, **changes)
    if out is not None:
        check_table(out)
    with quiet():
        from shoal.lab.coordinator import prepare

        prepare(sweep)
    with live(sweep.name) as tell, warnings_said(MixedVersionsWarning):
        status = run_sweep(
            sweep, store, workers=workers, dask=dask, extend=extend, on_progress=tell
        )
    written = None
    with Store(store) as opened:
        if out is not None:
            from shoal.lab.exchange import export

            export(opened, sweep.name, out)
            written = out
        failed = opened.failures(sweep.name, limit=3)
    if json_:
        print_json(
            _described(status)
            | {
                "store": str(store),
                "out": None if written is None else str(written),
            }
        )
    else:
        rows = [*_rows(status), ("store", str(store))]
        print_table(
            [*rows, *([("written", str(written))] if written else [])], title=f"sweep {sweep.name}"
        )
    if status.failures:
        for values, trial, number, error in failed:
            where = "".join(f"{name} = {value}, " for name, value in values.items())
            say(f"shoal: {where}trial {trial}, seed {number}: {error}")
        say(f"shoal: {status.failures} trials failed; the same command tries them again")
        raise typer.Exit(1)


@contextmanager
def live(name: str) -> Iterator[Callable[[SweepProgress], None] | None]:
    """Show the progress of a sweep on stderr while the ``with`` block runs: finished trials, rate,
    remaining time and failures.

    On a terminal, the progress is one line that changes. Elsewhere, the function prints a line
    after every tenth of the trials (but at most one line in four seconds), and also after a minute
    without a line.
    """
    if sys.stderr is None:
        yield None
        return
    if not sys.stderr.isatty():
        yield _lines(name)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[pace]}"),
        TimeElapsedColumn(),
        TextColumn("{task.fields[trouble]}", style="red"),
    )
    with Bar(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(name, total=None, pace="starting workers", trouble="")

        def tell(progress: SweepProgress) -> None:
            bar.update(
                task,
                total=progress.total,
                completed=progress.done,
                trouble=_trouble(progress),
                pace=_pace_of(progress),
            )

        yield tell


def _lines(name: str) -> Callable[[SweepProgress], None]:
    """Return a function that prints the progress of a sweep as lines of text on stderr."""
    tenths, last = 0, time.monotonic()

    def tell(progress: SweepProgress) -> None:
        nonlocal tenths, last
        reached, now = 10 * progress.done // max(1, progress.total), time.monotonic()
        if progress.seconds and now - last >= (_APART if reached > tenths else _SLOW):
            tenths, last = reached, now
            parts = (
                f"{progress.done} of {progress.total} trials",
                _pace_of(progress),
                _trouble(progress),
            )
            say(f"sweep {name}: {', '.join(filter(None, parts))}")

    return tell


def _trouble(progress: SweepProgress) -> str:
    counts = ((progress.failures, "failures"), (progress.deaths, "workers died"))
    return ", ".join(f"{count} {what}" for count, what in counts if count)


def _pace_of(progress: SweepProgress) -> str:
    return _pace(
        progress.rate, (progress.total - progress.done) / progress.rate if progress.rate else None
    )


def _pace(rate: float, left: float | None) -> str:
    if not rate:
        return "starting workers"
    return f"{rate:.3g} a second" + (f", {_duration(left)} left" if left else "")


def _duration(seconds: float) -> str:
    whole = round(seconds)
    return (
        f"{whole} s"
        if whole < 120
        else f"{whole // 60} min"
        if whole < 7200
        else f"{whole / 3600:.1f} h"
    )


def _described(status: SweepStatus) -> dict[str, Any]:
    from shoal.lab.batches import parse_versions

    wrote = [parse_versions(text) | {"rows": count} for text, count in status.versions.items()]
    more = {
        "complete": status.complete,
        "left": status.left,
        "versions": wrote,
        "other_versions": bool(_provenance(status)),
    }
    return asdict(status) | more


def _provenance(status: SweepStatus) -> str:
    from shoal.lab.batches import describe_mixture

    return describe_mixture(status.versions)


def _rows(status: SweepStatus) -> list[tuple[str, str]]:
    state = (
        "complete"
        if status.complete
        else "running"
        if status.running
        else "stopped: the same command continues"
    )
    rows = [
        ("done", f"{status.done} of {status.total} trials at {status.points} points"),
        ("state", state),
        ("failures", str(status.failures)),
        ("work", f"{_duration(status.seconds)} of all workers together"),
    ]
    if not status.complete and status.rate:
        rows.append(("pace", _pace(status.rate, status.left)))
    if _provenance(status):
        rows.append(("versions", _provenance(status)))
    return rows


def status(
    store: StoreFile,
    watch: Annotated[
        bool,
        typer.Option(
            "--watch", help="Repeat the output every two seconds until no sweep is running."
        ),
    ] = False,
    seed: options.UnusedSeed = 0,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="Also write the result as JSON.")
    ] = None,
    json_: options.Json = False,
) -> None:
    """Show the progress of the sweeps in a store. The command status works even while another
    process runs the sweeps.
    """
    from shoal.lab import Store

    if watch and json_:
        raise InvalidInputError(
            "--watch: expected no --json beside this option, because --json prints only one object,"
            " got both"
        )
    if out is not None:
        check_folder(out.parent)
    with Store(store) as opened:
        if watch:
            _watch(opened)
        statuses = [opened.status(name) for name in opened.names]
    result = {"store": str(store), "sweeps": [_described(sweep) for sweep in statuses]}
    if out is not None:
        write_json(out, result)
    if json_:
        print_json(result)
    elif not watch or not sys.stdout.isatty():
        print_drawn(_table(statuses))
        for sweep in statuses:
            if _provenance(sweep):
                print(visible(f"{sweep.name}: {_provenance(sweep)}"))


def _table(statuses: list[SweepStatus]) -> Table:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for column in ("sweep", "done", "of", "failures", "state", "pace"):
        table.add_column(
            column,
            justify="right" if column in {"done", "of", "failures"} else "left",
            header_style="bold",
        )
    for sweep in statuses:
        state = "complete" if sweep.complete else "running" if sweep.running else "stopped"
        pace = _pace(sweep.rate, sweep.left) if sweep.rate and not sweep.complete else ""
        table.add_row(
            cell(sweep.name), str(sweep.done), str(sweep.total), str(sweep.failures), state, pace
        )
    return table


def _watch(store: Store) -> None:
    """Show the table of sweeps again and again until no sweep is running."""
    statuses = [store.status(name) for name in store.names]
    if not sys.stdout.isatty():
        while any(sweep.running for sweep in statuses):
            time.sleep(_EVERY)
            statuses = [store.status(name) for name in store.names]
        return
    from rich.live import Live

    with Live(_table(statuses), auto_refresh=False) as shown:
        while any(sweep.running for sweep in statuses):
            time.sleep(_EVERY)
            statuses = [store.status(name) for name in store.names]
            shown.update(_table(statuses), refresh=True)


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
    interval_method: Any = check_choice(method, what="--method", choices=METHODS)
    with Store(store) as opened:
        chosen = opened.only(name)
        wanted = measure or first_measure(opened.stored(chosen).measures)
        say_if_mixed(opened, chosen)
        rows = summarise(opened, chosen, wanted, level=level, method=interval_method)
        pairs = (
            compare_along(opened, chosen, wanted, compare, level=level, method=interval_method)
            if compare
            else []
        )
    result = {
        "sweep": chosen,
        "measure": wanted,
        "level": level,
        "method": method,
        "points": [as_json(row.report()) for row in rows],
        "comparisons": [
            {
                "axes": others,
                compare: [first, second],
                "comparison": comparison and as_json(asdict(comparison)),
            }
            for others, first, second, comparison in pairs
        ],
    }
    if out is not None:
        write_json(out, result)
    if json_:
        print_json(result)
        return
    title = f"{wanted} along {compare}, on the same seeds"
    _print_summary(
        rows,
        pairs,
        compare,
        means=f"{wanted} of {chosen}",
        along=title,
        level=level,
        method=interval_method,
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
                [*map(str, others.values()), *_compared(f"{second} less {first}", comparison)]
                for others, first, second, comparison in pairs
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


def say_if_mixed(store: Store, name: str) -> None:
    """Print a warning on stderr if several versions of Shoal or its libraries wrote the rows of a
    sweep.
    """
    from shoal.lab.batches import short_names

    rows = store.versions(name)
    if len(rows) > 1:
        names = short_names(rows)
        counted = ", ".join(f"{count} rows by {names[text]}" for text, count in rows.items())
        say(
            f"shoal: warning: {store.path}: sweep {name}: expected rows of one version, got"
            f" {counted}"
        )


def plot(
    store: StoreFile,
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="File for the figure: .png, .svg or .pdf.")
    ],
    name: SweepName = None,
    measure: Annotated[
        str | None, typer.Option("--measure", help="Measure to draw, such as moves.")
    ] = None,
    seed: options.UnusedSeed = 0,
    json_: options.Json = False,
) -> None:
    """Plot means with 95 % intervals over the first numeric axis, one line for each combination of
    the other axes' values.
    """
    from shoal.views.drawing.charts import FIGURES

    check_folder(check_suffix(out, *FIGURES).parent)
    from shoal.lab import Store
    from shoal.lab.statistics import first_measure, summarise
    from shoal.views import save_figure
    from shoal.views.drawing.curves import means_figure

    with Store(store) as opened:
        chosen = opened.only(name)
        wanted = measure or first_measure(opened.stored(chosen).measures)
        points = summarise(opened, chosen, wanted)
    rows = [row for row in points if row.estimate is not None]
    if not rows:
        raise InvalidInputError(
            f"{store}: sweep {chosen}: expected finished trials to draw, got none"
        )
    save_figure(means_figure(rows, title=chosen, measure=wanted), out)
    if left_out := len(points) - len(rows):
        say(f"shoal: notice: {left_out} of {len(points)} points without a mean are not drawn")
    if json_:
        print_json(
            {
                "sweep": chosen,
                "measure": wanted,
                "points": len(rows),
                "left_out": left_out,
                "out": str(out),
            }
        )
    else:
        print_table([("points", str(len(rows)))], title=f"{wanted} of {chosen}", written=[out])


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
        say_if_mixed(opened, chosen)
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
        statuses = [opened.status(name) for name in names]
    if json_:
        print_json(
            {
                "out": str(out),
                "sweeps": [
                    {"name": sweep.name, "done": sweep.done, "total": sweep.total}
                    for sweep in statuses
                ],
            }
        )
    else:
        print_table(
            [(sweep.name, f"{sweep.done} of {sweep.total} trials") for sweep in statuses],
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
    names: list[str] = []
    with Store(store, damaged=True) as opened:
        faults = faults_of(opened)
        with suppress(InvalidInputError):  # a damaged name is one of the faults
            names = opened.names
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
        say(f"shoal: {store}: {count_text(len(faults), 'fault')}")
        raise typer.Exit(1)


def check_table(out: Path) -> None:
    """Raise an error if Shoal cannot write the table file ``out``."""
    from shoal.lab.exchange import SUFFIXES

    check_folder(check_suffix(out, *SUFFIXES).parent)
