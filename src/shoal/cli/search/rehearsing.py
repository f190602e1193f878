"""shoal rehearse: a prepared search, with all robots and their autopilots on this computer."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from shoal.cli.options import Json, UnusedSeed
from shoal.cli.output import check_folder, print_json, print_table, progress, say
from shoal.core.checks import check_number
from shoal.core.errors import InvalidInputError
from shoal.core.interruption import patient

if TYPE_CHECKING:
    from shoal.robots.rehearsal import Happening, Rehearsal, RehearsalResult

REHEARSE_EXAMPLE = "Example: shoal rehearse field --autopilot ardupilot"

_STATES = "rehearsal"  # folder of the robots' states and outputs
_FASTEST, _PER_CORE = 10.0, 18.0  # simulated seconds in a second, and times robots for each core
_SLOWEST, _LIMIT = 0.1, 20.0
_DEAD_AT = 0.3  # fraction of the cells that are searched when a program is killed


def rehearse(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="FOLDER",
            help="Folder of a prepared search (shoal search --prepare), or its task file.",
        ),
    ],
    autopilot: Annotated[
        Literal["px4", "ardupilot"],
        typer.Option("--autopilot", help="Autopilot that is simulated."),
    ] = "px4",
    loss: Annotated[
        float | None,
        typer.Option(
            "--loss",
            help="Share of the messages that each radio loses. Default: that of the search.",
        ),
    ] = None,
    without: Annotated[
        int | None,
        typer.Option(
            "--without",
            help="Robot whose program is killed in the second run. Default: the middle one.",
        ),
    ] = None,
    speed_up: Annotated[
        float | None,
        typer.Option(
            "--speed-up",
            help=(
                "Number of simulated seconds in a second. The rehearsal fails if this computer is"
                " too slow for it. Default: at most 10, and less for many robots or if this"
                " computer is too slow."
            ),
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FOLDER",
            help="Folder for the check list and the robots' logs. Default: FOLDER itself.",
        ),
    ] = None,
    seed: UnusedSeed = 0,
    json_: Json = False,
) -> None:
    """Rehearse a prepared search on this computer, and write a check list for the operator.

    Each robot is the process that will run on its companion computer (shoal robot), with an
    autopilot of its own that is simulated and speaks MAVLink over UDP. All robots search first;
    then the program of one of them is killed on the way. The results are read from the robots' logs
    and from the positions of the simulated vehicles. The exit code is 0 only if everything was
    searched and nothing was wrong in both runs.
    """
    from shoal.robots.checklist import report_of, write_checklist
    from shoal.robots.rehearsal import Happening, Rehearsal
    from shoal.robots.tasks import read_task

    if loss is not None:
        check_number(loss, what="loss", least=0, most=1)
    if speed_up is not None:
        check_number(speed_up, what="speed-up", least=_SLOWEST, most=_LIMIT)
    task = read_task(folder)
    own_speed = speed_up is None
    if speed_up is None:
        most = _PER_CORE * (os.cpu_count() or 1) / len(task.scenario.starts)
        speed_up = min(_FASTEST, max(1.0, most))
    home = task.path.parent if out is None else out
    check_folder(home)
    rehearsal = Rehearsal(task, home / _STATES, loss=loss, speed_up=speed_up, autopilot=autopilot)
    count = len(rehearsal.numbers)
    dead = (count + 1) // 2 if without is None else without
    if not 1 <= dead <= count:
        raise InvalidInputError(f"without: expected a robot from 1 to {count}, got {dead}")
    plans: list[tuple[str, list[Happening]]] = [("all robots", [])]
    if count > 1:
        plans.append((f"without robot {dead}", [Happening(_DEAD_AT, "kill", dead)]))
    runs = []
    for name, some in plans:
        result = _run(rehearsal, name, some, shown=not json_)
        while result.late and own_speed and rehearsal.speed_up > 1:
            rehearsal.speed_up = max(1.0, rehearsal.speed_up / 2)
            say(
                f"this computer was {result.late_s:.1f} s late: again with --speed-up"
                f" {rehearsal.speed_up:g}"
            )
            result = _run(rehearsal, name, some, shown=not json_)
        runs.append(result)
    written = write_checklist(rehearsal, runs, home)
    if json_:
        print_json(report_of(rehearsal, runs))
    else:
        rows = [(run.name, _summary(run)) for run in runs]
        print_table(rows, title="rehearsal", written=written)
    faults = [f"{run.name}: {fault}" for run in runs for fault in run.faults]
    if faults:
        say(f"shoal: rehearsal: {'; '.join(faults)}")
        raise typer.Exit(1)


def _run(
    rehearsal: Rehearsal, name: str, happenings: list[Happening], *, shown: bool
) -> RehearsalResult:
    with patient(), progress(f"rehearsal, {name}", 100, shown=shown) as advance:
        return rehearsal.run(
            name,
            happenings,
            on_progress=lambda fraction, _seconds: advance(int(100 * fraction)),
            on_event=say if shown else lambda _text: None,
        )


def _summary(run: RehearsalResult) -> str:
    record = run.record
    least = min(record.battery.values())
    return (
        f"{100 * record.covered_fraction:.4g} % of {record.cells} cells in"
        f" {record.seconds / 60:.1f} min, battery left at least {100 * least:.0f} %:"
        f" {'passed' if not run.faults else 'not passed'}"
    )
