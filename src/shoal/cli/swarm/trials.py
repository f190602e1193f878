"""Several drives after one another, with the success rate, as laboratories report it."""

from __future__ import annotations

import csv
import io
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from shoal.cli.output import print_json, print_table, say
from shoal.core.errors import InvalidInputError, RigError
from shoal.core.interruption import patient

if TYPE_CHECKING:
    from shoal.rigs import Drive
    from shoal.swarm import SwarmEpisode

COLUMNS = ("trial", "seed", "status", "success", "moves", "scans", "seconds", "free_cells")
WRONG = ("false_free", "false_obstacles")
LEVEL = 0.95
PANELS = 6  # pictures of the first trial


class Trials:
    """The results of several drives.

    Attributes
    ----------
    rows : list of dict
        The row of each drive in the table of trials.
    episodes : list of SwarmEpisode
        The drives that found free cells.
    """

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []
        self.episodes: list[SwarmEpisode] = []
        self.first: dict[str, Any] = {}

    def take(self, result: Drive, about: dict[str, Any]) -> None:
        """Add the result of a drive, and what `shoal drive` prints of it."""
        wrong = about["wrong"] or {}
        row = {"trial": len(self.rows) + 1, "success": bool(result) and not sum(wrong.values())}
        row |= {name: about[name] for name in COLUMNS if name not in row}
        self.rows.append(row | {name: wrong.get(name) for name in WRONG if wrong})
        self.first = self.first or about
        if result.episode is not None:
            self.episodes.append(result.episode)

    def summary(self) -> dict[str, Any]:
        """Return the success rate with its interval, and the means of moves and time of the
        successful drives with their intervals (95 %).
        """
        from scipy.stats import binomtest

        from shoal.core.files import as_json
        from shoal.lab.statistics import estimate

        done = [row for row in self.rows if row["success"]]
        rate = binomtest(len(done), len(self.rows)).proportion_ci(LEVEL, method="exact")
        found: dict[str, Any] = {
            "rig": self.first["rig"],
            "policy": self.first["policy"],
            "particles": self.first["particles"],
            "trials": len(self.rows),
            "successes": len(done),
            "success_rate": len(done) / len(self.rows),
            "success_interval": [float(rate.low), float(rate.high)],
        }
        for name in ("moves", "scans", "seconds"):
            if done:
                mean = estimate([row[name] for row in done], level=LEVEL)
                found[name] = {"mean": mean.mean, "low": mean.low, "high": mean.high}
            else:
                found[name] = None
        return dict(as_json(found | {"level": LEVEL, "each": self.rows}))

    def write(self, out: Path) -> list[Path]:
        """Write the table of trials, the summary and the figures into a folder."""
        from shoal.core.files import write_json, write_text
        from shoal.views import figure, save_figure
        from shoal.views.swarm.figures import map_panels

        text = io.StringIO()
        table = csv.DictWriter(text, list(self.rows[0]), lineterminator="\n")
        table.writeheader()
        table.writerows(self.rows)
        write_text(out / "trials.csv", text.getvalue())
        write_json(out / "summary.json", self.summary())
        written = [out / "trials.csv", out / "summary.json"]
        if self.episodes:
            save_figure(figure(self.episodes, kind="frontier"), out / "frontier.png")
            written.append(out / "frontier.png")
        first = self.episodes[0] if self.episodes else None
        if first is not None and first.workspace.ndim == 2:
            steps = sorted({first.moves * part // (PANELS - 1) for part in range(PANELS)})
            shown = map_panels([(first, moves) for moves in steps], columns=3)
            save_figure(shown, out / "frames.png")
            written.append(out / "frames.png")
        return written

    def show(self, written: list[Path]) -> None:
        """Print the table of all trials."""
        about = self.summary()
        low, high = about["success_interval"]
        rows = [
            (
                "success",
                f"{about['successes']} of {about['trials']} trials"
                f" ({100 * about['success_rate']:.0f} %, 95 % interval {100 * low:.0f} to"
                f" {100 * high:.0f} %)",
            )
        ]
        for name, unit in (("moves", ""), ("scans", ""), ("seconds", " s")):
            mean = about[name]
            if mean is not None:
                between = (
                    ""
                    if mean["low"] is None
                    else f" (95 % interval {mean['low']:.4g} to {mean['high']:.4g})"
                )
                rows.append((name, f"{mean['mean']:.4g}{unit} a successful trial{between}"))
        rows += [
            (
                f"trial {row['trial']}",
                f"{row['status']} after {row['moves']} moves, {row['seconds']:.3g} s",
            )
            for row in self.rows
        ]
        print_table(rows, title=f"{about['trials']} drives of {about['rig']}", written=written)


def run_trials(
    run: Callable[[dict[str, Any]], None],
    ctx: Any,
    trials: int,
    *,
    between: str | None,
    local: bool,
    seed: int,
    out: Path | None,
    film: list[Path] | None,
    json_: bool,
    ended: Callable[[Path], tuple[Drive, dict[str, Any]] | None] | None = None,
) -> bool:
    """Run several drives after one another, of which trial k has the seed ``seed`` + k - 1, and
    report them. Return whether all succeeded.

    Between two drives, a simulated rig is made anew, and the command ``between`` resets a real rig.
    Without a command, the user resets it and presses Enter.

    If ``ended`` is given, trials that were begun in the folder ``out`` are not driven again: of a
    log, the function returns the result of its drive, or None if it was interrupted and goes on.

    Raises
    ------
    InvalidInputError
        Raised if nobody can reset the rig.
    """
    words = _command(between)
    if not local and not words and not sys.stdin.isatty():
        raise InvalidInputError(
            "trials: expected --between COMMAND, which resets the rig, or a terminal on which"
            " somebody presses Enter after that, got neither"
        )
    begun = {} if ended is None or out is None else begun_trials(out)
    found = ctx.obj = Trials()
    failure: BaseException | None = None
    for number in range(1, trials + 1):
        try:
            log = begun.get(number)
            if log is not None and ended is not None and (result := ended(log)) is not None:
                found.take(*result)
                continue
            if number > 1 and log is None:
                _reset(words, number, trials, local=local)
            folder = None if out is None else out / f"trial-{number:03d}"
            run(
                {
                    "trials": 1,
                    "between": None,
                    "seed": seed + number - 1,
                    "out": folder,
                    "film": film if number == 1 else None,
                    "resume": log,
                }
            )
        except BaseException as error:
            failure = error
            break
        row = found.rows[-1]
        say(f"shoal: trial {number} of {trials}: {row['status']} after {row['moves']} moves")
    ctx.obj = None
    if found.rows:
        with patient():
            written = [] if out is None else found.write(out)
            if json_:
                print_json(found.summary())
            else:
                found.show(written)
    if failure is not None:
        raise failure
    return all(row["success"] for row in found.rows)


def begun_trials(folder: Path) -> dict[int, Path]:
    """Return the log of each trial that was begun in a folder, by the number of the trial.

    Raises
    ------
    InvalidInputError
        Raised if there is no first trial.
    """
    # of several drives into the folder of one trial, the last one counts
    logs = sorted(folder.glob("trial-*/log*.jsonl"), key=lambda log: (len(log.name), log.name))
    begun = {int(log.parent.name.removeprefix("trial-")): log for log in logs}
    if 1 not in begun:
        raise InvalidInputError(
            f"resume: expected the folder of --out of several --trials, got {folder}, in which no"
            " trial was begun"
        )
    return begun


def _command(between: str | None) -> list[str]:
    try:
        words = [] if between is None else shlex.split(between)
    except ValueError as error:
        raise InvalidInputError(
            f"between: expected a command, got {between!r:.80}: {error}"
        ) from None
    if between is not None and not words:
        raise InvalidInputError("between: expected a command, got an empty text")
    return words


def _reset(words: list[str], number: int, trials: int, *, local: bool) -> None:
    """Let the rig be reset before a trial."""
    if words:
        try:
            code = subprocess.run(words, check=False).returncode
        except OSError as error:
            raise InvalidInputError(
                f"between: the program {words[0]!r} cannot be started: {error.strerror or error}"
            ) from None
        if code:
            raise RigError(
                f"between: expected that {words[0]!r} resets the rig before trial {number}, but it"
                f" ended with exit code {code}"
            )
    elif not local:
        say(f"shoal: trial {number} of {trials}: reset the particles, then press Enter")
        if not sys.stdin.readline():
            raise KeyboardInterrupt
