"""What `shoal robot --watch` shows: who does what, from what is on the air."""

from __future__ import annotations

import select
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shoal.cli.output import print_json, say
from shoal.core.files import write_json

if TYPE_CHECKING:
    from shoal.robots.watching import SearchWatch

_EVERY = 1.0  # seconds between two pictures
_SAID = 10.0  # seconds between two lines, if the output is no terminal
SNAPSHOT = "watch.json"


def watch_search(
    watch: SearchWatch, *, seconds: float | None, out: Path | None, json_: bool
) -> bool:
    """Show a search until it is complete, for a time, or until Ctrl-C. Return whether it is
    complete.

    Parameters
    ----------
    watch : SearchWatch
    seconds : float, optional
        How long at most.
    out : Path, optional
        Folder in which ``watch.json`` is written again every second.
    json_ : bool
        Whether to print what is known at the end as JSON, and nothing before.
    """
    begin = time.monotonic()
    report = watch.report(0.0)
    with ExitStack() as stack:
        show = _ignore if json_ else _live(stack) if sys.stdout.isatty() else _said()
        while seconds is None or time.monotonic() - begin < seconds:
            select.select([watch.radio], [], [], 0.1)
            watch.listen(time.monotonic())
            if time.monotonic() - begin < report.get("at", -_EVERY) + _EVERY:
                continue
            report = _told(watch, begin, out)
            show(report)
            if report["complete"]:
                break
    report = _told(watch, begin, out)
    if json_:
        print_json(report)
    return bool(report["complete"])


def _told(watch: SearchWatch, begin: float, out: Path | None) -> dict[str, Any]:
    now = time.monotonic()
    report = watch.report(now) | {"at": round(now - begin, 1)}
    if out is not None:
        write_json(out / SNAPSHOT, report)
    return report


def _ignore(_report: dict[str, Any]) -> None:
    pass


def _live(stack: ExitStack) -> Callable[[dict[str, Any]], None]:
    from rich.live import Live

    live = stack.enter_context(Live(auto_refresh=False))
    return lambda report: live.update(table_of(report), refresh=True)


def _said() -> Callable[[dict[str, Any]], None]:
    last = [-_SAID]

    def tell(report: dict[str, Any]) -> None:
        if report["at"] - last[0] >= _SAID or report["complete"]:
            last[0] = report["at"]
            say(f"{title_of(report)}: " + "; ".join(_words(row) for row in report["robots"]))

    return tell


def title_of(report: dict[str, Any]) -> str:
    """Return one line about the whole search."""
    refused, success = sum(report["refused"].values()), report["success"]
    return (
        f"{100 * report['covered_fraction']:.4g} % of {report['cells']} cells searched"
        f"{'' if success is None else f', target found with {100 * success:.3g} %'}"
        f"{f', {refused} messages refused' if refused else ''}"
        f"{', found in ' + ', '.join(map(str, report['found'])) if report['found'] else ''}"
    )


def _words(row: dict[str, Any]) -> str:
    return f"robot {row['robot']} {row['status']}" + (
        "" if row["cell"] is None else f" at cell {row['cell']}, {row['searched']} searched"
    )


def table_of(report: dict[str, Any]) -> Any:
    """Return a table of all robots, with the reasons of refused messages below it."""
    from rich.table import Table

    table = Table(title=title_of(report), caption=_refused(report))
    for name in ("robot", "status", "heard", "cell", "place", "late", "searched", "messages"):
        table.add_column(name)
    for row in report["robots"]:
        place = "-"
        if row["cell"] is not None:
            place = f"{row['x']:g}, {row['y']:g} m"
            if row["longitude"] is not None:
                place = f"{row['longitude']:.6f}, {row['latitude']:.6f}"
        table.add_row(
            str(row["robot"]),
            row["status"],
            "-" if row["heard_s"] is None else f"{row['heard_s']:.0f} s ago",
            "-" if row["cell"] is None else str(row["cell"]),
            place,
            "-" if row["late_s"] is None else f"{row['late_s']:.0f} s",
            str(row["searched"]),
            str(row["messages"]),
        )
    return table


def _refused(report: dict[str, Any]) -> str | None:
    if not report["refused"]:
        return None
    return "refused: " + ", ".join(f"{n} {why}" for why, n in sorted(report["refused"].items()))
