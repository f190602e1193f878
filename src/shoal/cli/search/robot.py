"""shoal robot: the program of a robot's companion computer, and who does what on the air."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from shoal.cli.options import Json, UnusedSeed
from shoal.cli.output import check_folder, print_json, print_table, say
from shoal.core.checks import check_number
from shoal.core.errors import InvalidInputError
from shoal.core.interruption import patient

if TYPE_CHECKING:
    from shoal.robots.guided import GuidedVehicle
    from shoal.robots.tasks import RobotTask

ROBOT_EXAMPLE = (
    "Example: shoal robot field --id 1 --radio udp:127.0.0.1:9001,127.0.0.1:9002 --check"
)


class _Pace(NamedTuple):
    """How fast time passes: the number of seconds in a second, and a clock if it is uneven."""

    speed_up: float
    clock: Callable[[], float] | None


def robot(
    task: Annotated[
        Path,
        typer.Argument(
            metavar="TASK",
            help="Folder of a prepared search (shoal search --prepare), or its task file.",
        ),
    ],
    radio: Annotated[
        str,
        typer.Option(
            "--radio",
            metavar="RADIO",
            help=(
                "udp:OWN:PORT,HOST:PORT,... with the address or interface of this computer, then"
                " the addresses of the other robots, or one broadcast address or multicast group;"
                " or serial:DEVICE[,BAUD][,duty=FRACTION] (57600 baud; a robot sends at most 0.1 of"
                " the time, and all robots together 0.5, by default)."
            ),
        ),
    ],
    number: Annotated[
        int | None, typer.Option("--id", help="Number of this robot, from 1.", min=1)
    ] = None,
    vehicle: Annotated[
        str,
        typer.Option(
            "--vehicle",
            metavar="VEHICLE",
            help=(
                "mavlink:LINK with udpin:HOST:PORT (or udp:), udpout:HOST:PORT, tcp:HOST:PORT or"
                " serial:DEVICE[@BAUD]; or simulated: (a moving point)."
            ),
        ),
    ] = "simulated:",
    system: Annotated[
        int | None,
        typer.Option(
            "--system", help="MAVLink system id of the vehicle. Default: the only one.", min=1
        ),
    ] = None,
    arm: Annotated[
        bool,
        typer.Option(
            "--arm", help="Arm the vehicle. Without it, the robot waits until the pilot has armed."
        ),
    ] = False,
    accept: Annotated[
        list[str] | None,
        typer.Option(
            "--accept",
            metavar="CHECK",
            help=(
                "A check of the autopilot that you have made yourself: failsafe, fence or return."
                " The option can be repeated."
            ),
        ),
    ] = None,
    state: Annotated[
        Path | None,
        typer.Option(
            "--state",
            metavar="FOLDER",
            help="Folder of the robot's state. Default: the folder of the task.",
        ),
    ] = None,
    check: Annotated[
        bool,
        typer.Option("--check", help="Only check the task, the radio and the autopilot."),
    ] = False,
    watch: Annotated[
        bool,
        typer.Option(
            "--watch", help="Show who does what, from what is on the air, and send nothing."
        ),
    ] = False,
    seconds: Annotated[
        float | None, typer.Option("--seconds", help="With --watch: how long at most.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FOLDER", help="With --watch: folder for watch.json, each second."
        ),
    ] = None,
    loss: Annotated[
        float,
        typer.Option("--loss", help="Share of the messages to discard, for rehearsals."),
    ] = 0.0,
    speed_up: Annotated[
        float,
        typer.Option("--speed-up", help="Seconds that pass in a second, for rehearsals."),
    ] = 1.0,
    clock: Annotated[
        Path | None,
        typer.Option("--clock", metavar="FILE", help="Clock of a rehearsal (shoal rehearse)."),
    ] = None,
    seed: UnusedSeed = 0,
    json_: Json = False,
) -> None:
    """Search with the other robots of a prepared search, as the program of a companion computer.

    The state is on disk after each event: if the program is started again, the robot goes on. It
    never arms the vehicle without --arm. Before the take-off, it checks the failsafes, the fence
    and the return settings of the autopilot. After Ctrl-C, the vehicle returns. The exit code is 0
    if the search is complete and the vehicle has landed.
    """
    from shoal.robots.clock import SharedClock
    from shoal.robots.companion import journal_path
    from shoal.robots.journal import Journal
    from shoal.robots.radios import open_radio
    from shoal.robots.tasks import read_task

    check_number(loss, what="loss", least=0, most=1)
    check_number(speed_up, what="speed-up", least=0.1, most=20)
    read = read_task(task)
    if watch:
        sends = {"id": number, "arm": arm, "accept": accept, "system": system, "state": state}
        for name, value in (sends | {"check": check}).items():
            if value:
                raise InvalidInputError(
                    f"{name}: expected none beside --watch, which sends nothing, got {value}"
                )
        _watch(read, radio, seconds=seconds, out=out, json_=json_)
        return
    for name, given in (("seconds", seconds), ("out", out)):
        if given is not None:
            raise InvalidInputError(f"{name}: expected --watch together with it, got none")
    if number is None:
        raise InvalidInputError("id: expected the number of this robot, got none")
    read.live(number)
    home = _made(read.path.parent if state is None else state)
    with ExitStack() as stack:
        stack.enter_context(patient())
        waves = open_radio(radio, robots=len(read.scenario.starts), give_up=read.limits.radio_s)
        stack.callback(waves.close)
        pace = _Pace(speed_up, None if clock is None else SharedClock(clock).now)
        guided = stack.enter_context(
            _vehicle(read, number, vehicle, system, accept or [], arm=arm, pace=pace)
        )
        if guided is not None and (faults := guided.prepare()):
            for fault in faults:
                say(f"shoal: robot {number}: {fault}")
            raise typer.Exit(1)
        others = len(read.scenario.starts) - 1
        if waves.recipients < others:
            say(
                f"shoal: robot {number}: the radio sends to {waves.recipients:g} of {others} other"
                " robots; the others hear it only if something passes its messages on"
            )
        if check:
            state_file = journal_path(home, number)
            if state_file.exists():  # a broken one would stop the start
                Journal(state_file, read.search, number, read_only=True).close()
            _print({"robot": number, "ready": True}, json_=json_)
            return
        _search(stack, read, number, waves, guided, home, loss, pace, json_=json_)


def _search(
    stack: ExitStack,
    task: RobotTask,
    number: int,
    waves: Any,
    guided: GuidedVehicle | None,
    home: Path,
    loss: float,
    pace: _Pace,
    *,
    json_: bool,
) -> None:
    from shoal.robots.companion import Companion, journal_path
    from shoal.robots.journal import Journal

    epoch = None if pace.clock is None else pace.clock()
    journal = Journal(journal_path(home, number), task.search, number, epoch=epoch)
    stack.callback(journal.close)
    if journal.events:
        say(f"robot {number}: goes on after {len(journal.events)} events")
    companion = Companion(
        task, number, waves, journal, guided, loss=loss, speed_up=pace.speed_up, clock=pace.clock
    )
    if companion.agent.robot.status == "complete":
        say(
            f"robot {number}: knows from {journal.path} that everything is searched; prepare the"
            " search again to search it once more"
        )
    result = companion.run(lambda text: say(f"robot {number}: {text}"))
    _print(result.report(), json_=json_)
    if not result.complete or not result.landed:
        raise typer.Exit(1)


@contextmanager
def _vehicle(
    task: RobotTask,
    number: int,
    text: str,
    system: int | None,
    accepted: list[str],
    *,
    arm: bool,
    pace: _Pace,
) -> Iterator[GuidedVehicle | None]:
    """Open the vehicle that a text names; None stands for a moving point."""
    from shoal.robots.guided import GuidedVehicle
    from shoal.robots.mavlink import FastLink, Station, open_link
    from shoal.robots.settings import CHECKS

    for one in accepted:
        if one not in CHECKS:
            raise InvalidInputError(f"accept: expected {', '.join(CHECKS)}, got {one!r}")
    kind, _, link = text.partition(":")
    if kind == "simulated" and not link:
        for name, given in (("arm", arm), ("system", system), ("accept", accepted)):
            if given:
                raise InvalidInputError(f"{name}: expected --vehicle mavlink:..., got {text}")
        yield None
        return
    if kind != "mavlink":
        raise InvalidInputError(f"vehicle: expected mavlink:LINK or simulated:, got {text!r}")
    if link.startswith("udp:"):  # an autopilot speaks first, on its companion computer
        link = link.replace("udp", "udpin", 1)
    with Station(FastLink(open_link(link), *pace)) as station:
        yield GuidedVehicle(
            station,
            task,
            number,
            system=system,
            arm=arm,
            accepted=accepted,
            say=lambda told: say(f"robot {number}: {told}"),
        )


def _watch(
    task: RobotTask, radio: str, *, seconds: float | None, out: Path | None, json_: bool
) -> None:
    from shoal.cli.search.watching import watch_search
    from shoal.robots.radios import open_radio
    from shoal.robots.watching import SearchWatch

    if seconds is not None:
        check_number(seconds, what="seconds", above=0)
    if out is not None:
        _made(out)
    ear = open_radio(radio)
    try:
        complete = watch_search(SearchWatch(task, ear), seconds=seconds, out=out, json_=json_)
    finally:
        ear.close()
    if not complete:
        raise typer.Exit(1)


def _made(folder: Path) -> Path:
    """Return a folder that exists and can be written into."""
    check_folder(folder)
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _print(report: dict[str, Any], *, json_: bool) -> None:
    if json_:
        print_json(report)
    else:
        print_table([(name, str(value)) for name, value in report.items()], title="robot")
