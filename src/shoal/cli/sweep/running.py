"""shoal sweep run, status: run the trials of a sweep, store the results, and show the progress."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from shoal.cli import options
from shoal.cli.output import (
    cell,
    check_folder,
    print_drawn,
    print_json,
    print_table,
    quiet,
    say,
    visible,
    warnings_said,
)
from shoal.cli.sweep.results import StoreFile, check_table
from shoal.core.errors import InvalidInputError
from shoal.core.files import write_json

if TYPE_CHECKING:
    from rich.table import Table

    from shoal.lab import Store, SweepProgress, SweepStatus

RUN_EXAMPLE = "Example: shoal sweep run sweep.toml --store results.sqlite"
STATUS_EXAMPLE = "Example: shoal sweep status results.sqlite"

_EVERY = 2.0  # seconds between two updates of --watch
_APART, _SLOW = (
    4.0,
    60.0,
)  # seconds between two lines of progress, with and without a new tenth of the trials


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
    from shoal.lab.versions import MixedVersionsWarning

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
    from shoal.lab.versions import parsed

    wrote = [parsed(text) | {"rows": count} for text, count in status.versions.items()]
    more = {
        "complete": status.complete,
        "left": status.left,
        "versions": wrote,
        "other_versions": bool(_provenance(status)),
    }
    return asdict(status) | more


def _provenance(status: SweepStatus) -> str:
    from shoal.lab.versions import mixture

    return mixture(status.versions)


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
        found = [opened.status(name) for name in opened.names]
    result = {"store": str(store), "sweeps": [_described(one) for one in found]}
    if out is not None:
        write_json(out, result)
    if json_:
        print_json(result)
    elif not watch or not sys.stdout.isatty():
        print_drawn(_table(found))
        for one in found:
            if _provenance(one):
                print(visible(f"{one.name}: {_provenance(one)}"))


def _table(found: list[SweepStatus]) -> Table:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for column in ("sweep", "done", "of", "failures", "state", "pace"):
        table.add_column(
            column,
            justify="right" if column in {"done", "of", "failures"} else "left",
            header_style="bold",
        )
    for one in found:
        state = "complete" if one.complete else "running" if one.running else "stopped"
        pace = _pace(one.rate, one.left) if one.rate and not one.complete else ""
        table.add_row(cell(one.name), str(one.done), str(one.total), str(one.failures), state, pace)
    return table


def _watch(store: Store) -> None:
    """Show the table of sweeps again and again until no sweep is running."""
    found = [store.status(name) for name in store.names]
    if not sys.stdout.isatty():
        while any(one.running for one in found):
            time.sleep(_EVERY)
            found = [store.status(name) for name in store.names]
        return
    from rich.live import Live

    with Live(_table(found), auto_refresh=False) as shown:
        while any(one.running for one in found):
            time.sleep(_EVERY)
            found = [store.status(name) for name in store.names]
            shown.update(_table(found), refresh=True)
