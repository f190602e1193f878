"""shoal drive: map the workspace of a rig (a real or simulated apparatus), or carry out another
task in it, in a closed loop, with a log for replays.
"""

from __future__ import annotations

import json
import re
import shlex
from contextlib import contextmanager
from dataclasses import replace
from itertools import count
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from shoal.cli import options
from shoal.cli.options import is_given, takes_problem
from shoal.cli.output import check_outputs, check_seed, print_json, print_table, report_moves, say
from shoal.cli.steering_drive import (
    check_steering,
    local_steering_rig,
    steer_rig,
    steering_bench,
    steering_problem,
)
from shoal.cli.swarm.calibrating import (
    CalibrateInto,
    CalibrationFile,
    Frequencies,
    Marks,
    PixelSize,
    Trim,
    calibrate_bench,
    check_calibrating,
)
from shoal.core.checks import check_integer, check_number, count_text, shape_text
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError, MissingExtraError, RigError
from shoal.core.interruption import patient
from shoal.swarm.grid.tasks import Inlet
from shoal.swarm.problem import DRIVEN, SwarmProblem

if TYPE_CHECKING:
    from collections.abc import Iterator

    from shoal.cli.swarm.trials import Trials
    from shoal.core.episode import Verification
    from shoal.rigs import Drive, DriveLog, RecordedRig, Rig
    from shoal.rigs.calibration import BenchCalibration
    from shoal.rigs.physics import PlantProperties
    from shoal.rigs.ports import Actuator, Sensor
    from shoal.swarm import GridWorkspace, SwarmEpisode

SECONDS = {"repeat_after": 5.0, "end_after": 60.0}
EXAMPLE = "Example: shoal drive maze:9x7 --rig simulated --particles 4 --log drive.jsonl"


RigName = Annotated[
    str | None,
    typer.Option(
        "--rig",
        metavar="RIG",
        help=(
            "Rig: simulated, physics:KIND[,NAME=NUMBER...] (a physical plant; KIND is roll, pull or"
            " exact), serial:DEVICE[@BAUD], tcp:HOST:PORT, exec:COMMAND (a program that"
            " uses the protocol on its standard input and output), or MODULE:ATTRIBUTE (an object"
            " of your own)."
        ),
        show_default="simulated",
    ),
]
ActuatorName = Annotated[
    str | None,
    typer.Option(
        "--actuator",
        metavar="ACTUATOR",
        help=(
            "Device that moves the particles, instead of --rig: coils:FILE (coils that an actuation"
            " file describes), physics:KIND[,NAME=NUMBER...],"
            " serial:DEVICE[@BAUD], tcp:HOST:PORT, exec:COMMAND, or MODULE:ATTRIBUTE."
        ),
    ),
]
SensorName = Annotated[
    str | None,
    typer.Option(
        "--sensor",
        metavar="SENSOR",
        help=(
            "Device that sees the particles which --actuator moves: physics (the camera of the"
            " actuator physics), opencv:INDEX|FILE|ADDRESS or pymmcore:CONFIG (a camera;"
            " ,NAME=VALUE... says how particles look), serial:DEVICE[@BAUD], tcp:HOST:PORT, exec:COMMAND, or"
            " MODULE:ATTRIBUTE."
        ),
    ),
]
Size = Annotated[
    str | None,
    typer.Option(
        "--size",
        metavar="ROWSxCOLUMNS",
        help=(
            "Size of the rig's field of view in cells, such as 40x60; in three dimensions"
            " LAYERSxROWSxCOLUMNS. Shoal refuses a rig with another size."
        ),
    ),
]


@takes_problem(
    SwarmProblem, only=("particles", "placement", "start", "rule", "cell_size", *DRIVEN), map="rig"
)
def drive(
    problem: SwarmProblem,
    ctx: typer.Context,
    map_name: Annotated[
        str | None,
        typer.Argument(
            metavar="[MAP]",
            help=(
                "True map, in which the particles of a simulated rig or of a physical plant move. For"
                " a real rig, Shoal compares the result with the true map. A task such as coverage"
                " takes this map as known, if --known gives no other one."
            ),
        ),
    ] = None,
    rig: RigName = None,
    actuator: ActuatorName = None,
    sensor: SensorName = None,
    calibrate: CalibrateInto = None,
    mark: Marks = None,
    pixel_size: PixelSize = None,
    frequency: Frequencies = None,
    calibration: CalibrationFile = None,
    trim: Trim = None,
    size: Size = None,
    known: Annotated[
        str | None,
        typer.Option(
            "--known",
            metavar="MAP",
            help=(
                "Map that is known beforehand, as of an earlier drive or of an MRI. A mapping begins"
                " with it as prior knowledge, and checks every cell of it; other tasks rest on it"
                " until scans contradict."
            ),
        ),
    ] = None,
    enter_every: Annotated[
        int | None,
        typer.Option(
            "--enter-every",
            metavar="N",
            min=1,
            help=(
                "With --start inlet:ROW,COLUMN and a rig that Shoal simulates: particles come in at"
                " the inlet, one after every N commands, until there are --particles."
            ),
        ),
    ] = None,
    exact: Annotated[
        bool,
        typer.Option(
            "--exact",
            help=(
                "The rig makes no errors: end the drive at the first contradiction. By default so"
                " for the rigs simulated and physics:exact."
            ),
        ),
    ] = False,
    seed: options.Seed = 0,
    repeat_after: Annotated[
        float | None,
        typer.Option(
            "--repeat-after",
            help="Time without an answer after which Shoal repeats a request, in seconds.",
            show_default=str(SECONDS["repeat_after"]),
        ),
    ] = None,
    end_after: Annotated[
        float | None,
        typer.Option(
            "--end-after",
            help=(
                "Time without an answer to repeated requests after which the run ends, in seconds."
            ),
            show_default=str(SECONDS["end_after"]),
        ),
    ] = None,
    test_move: Annotated[
        bool,
        typer.Option(
            "--test-move/--no-test-move",
            help=(
                "Before the policy begins, send commands until a particle moves, and at the end"
                " show once more that the rig acts. "
                "With --no-test-move, Shoal sends only the commands of the policy; with noise, "
                "also the moves that show the rig still acts."
            ),
        ),
    ] = True,
    log: Annotated[
        Path | None,
        typer.Option(
            "--log",
            metavar="FILE",
            help="Log file (JSON lines), which Shoal writes during the run.",
        ),
    ] = None,
    resume: Annotated[
        Path | None,
        typer.Option(
            "--resume",
            metavar="LOG",
            help=(
                "Go on with the drive of a log that was interrupted. All other options are those of"
                " the log. The log is continued, or copied to the file of --log and continued there."
                " With --trials: the folder of several drives, of which the rest are driven."
            ),
        ),
    ] = None,
    trials: Annotated[
        int,
        typer.Option(
            "--trials",
            help=(
                "Number of drives after one another, with the seeds SEED, SEED + 1, ..., and with"
                " the success rate and its interval at the end. --out gets a folder for each."
            ),
        ),
    ] = 1,
    between: Annotated[
        str | None,
        typer.Option(
            "--between",
            metavar="COMMAND",
            help=(
                "Command that resets a real rig between two of several --trials. Without it, Shoal"
                " asks on the terminal. A simulated rig or a plant is made anew."
            ),
        ),
    ] = None,
    steer: Annotated[
        str | None,
        typer.Option(
            "--steer",
            metavar="PROBLEM",
            help=(
                "Steer two particles to their goals instead: a problem file of shoal steer, or a"
                " workspace. Its friction_at_least, or else friction, is what is stated of the"
                " walls. The rig is simulated, physics:KIND[,NAME=NUMBER...] (in cells of a 40th of the"
                " size), MODULE:ATTRIBUTE (look and send), a rig behind a connection that can push and"
                " look, or --actuator and --sensor (the unit of the workspace is then the cell)."
            ),
        ),
    ] = None,
    friction_at_least: Annotated[
        float | None,
        typer.Option(
            "--friction-at-least",
            metavar="MU",
            help="With --steer: least coefficient of friction of the walls.",
        ),
    ] = None,
    waypoints: Annotated[
        str | None,
        typer.Option(
            "--waypoints",
            metavar="'X,Y X,Y'",
            help="With --steer: lead one particle along these points instead of two to their goals.",
        ),
    ] = None,
    follow: Annotated[
        int | None,
        typer.Option(
            "--follow",
            metavar="PARTICLE",
            help="With --waypoints: number of the particle, from 1.",
            show_default="1",
        ),
    ] = None,
    out: options.Out = None,
    film: options.Film = None,
    json_: options.Json = False,
) -> None:
    """Control a rig (an apparatus with particles): map its space, cover a known map, bring a
    particle to a target, or steer two particles. At the end and after Ctrl-C, Shoal stops the rig.

    Of a real rig, --particles and --rule are the expected values: if its first scan shows another
    number of particles (fewer than chance allows, or more), or if it reports another rule, the
    command ends before the first move. The options --placement and --start apply to a simulated rig
    or a physical plant only. The options --slip, --misplace and --miss state the error
    probabilities of a rig, and a simulated rig makes such errors. Without them, a real rig or a
    plant is expected to make no errors until scans contradict, and from then on those of slip .05,
    misplace .05 and miss .01; with --exact, the first contradiction ends the drive. If the rig
    contradicts the commands, or if no particle moves, the drive ends with the status alarm. The
    exit code is 0 only if the task is complete. The page docs/concepts/rigs.md describes the
    checks, and the messages between Shoal and a rig.
    """
    from shoal.cli.swarm.keyboard import keyboard, stop_until_confirmed
    from shoal.cli.swarm.trials import begun_trials, run_trials
    from shoal.rigs.calibration import BenchCalibration
    from shoal.rigs.driving import drive as drive_rig
    from shoal.rigs.driving import load_drive_kernels
    from shoal.rigs.log import read_log
    from shoal.rigs.ports import is_connection, open_own_rig
    from shoal.rigs.remote import open_rig
    from shoal.rigs.resume import check_resumable, is_finished, rebuild
    from shoal.swarm.grid.board import letters_of
    from shoal.swarm.maps.files import open_map
    from shoal.swarm.problem import spacing_of

    check_steering(
        ctx, steer=steer, friction_at_least=friction_at_least, waypoints=waypoints, follow=follow
    )
    if steer is not None:
        asked = steering_problem(steer, friction_at_least)
        name, devices = _named(rig, actuator, sensor)
        if devices is None:
            steered: Any = local_steering_rig(asked, name, seed)
        else:
            view = None if size is None else _size(size)
            measured = None if calibration is None else BenchCalibration.load(calibration)
            truth = None if map_name is None else open_map(map_name)
            waits = {"repeat_after": repeat_after, "end_after": end_after}
            quiet: dict[str, Any] = {"on_event": None} | SECONDS
            quiet |= {key: value for key, value in waits.items() if value is not None}
            two = problem.replaced(particles=asked.n_particles)
            pair = _open_devices(devices, truth, two, seed, _apparatus(name), **quiet)
            with _closed_after(pair, always=False):
                steered = steering_bench(pair, view, measured)
        steer_rig(
            asked,
            steered,
            seed=seed,
            waypoints=waypoints,
            particle=follow or 1,
            log=log,
            out=out,
            json_=json_,
        )
        return
    check_outputs(out, film)
    past = None
    if resume is not None and trials > 1:
        first = read_log(begun_trials(resume)[1])
        named = _missing(ctx, first) or {}
        if again := {name: named[name] for name in named if name not in ("out", "film")}:
            _run_again(ctx, again)
            return
        if out is not None and out.resolve() != resume.resolve():
            raise InvalidInputError(f"out: expected {resume}, where the trials go on, got {out}")
        out = resume
    elif resume is not None:
        past = read_log(resume)
        if (missing := _missing(ctx, past)) is not None:
            _run_again(ctx, missing)
            return
        check_resumable(past, problem.max_moves)
        if is_finished(past):
            say(f"shoal: {resume}: the drive was finished, so that nothing is left to do")
            _show_finished(past, map_name, out, film, json_)
            return
    check_integer(trials, what="trials", least=1)
    rig, devices = _named(rig, actuator, sensor)
    if trials > 1:
        _check_trials(log=log, calibrate=calibrate)
        about: dict[str, Any] = {"out": out, "film": film, "json_": json_, "seed": seed}
        about |= {"between": between, "local": _is_local(rig)}
        if resume is not None:
            about["ended"] = lambda log: _ended(log, map_name)
        if not run_trials(lambda changed: _run_again(ctx, changed), ctx, trials, **about):
            raise typer.Exit(1)
        return
    if between is not None:
        raise InvalidInputError(f"between: expected several --trials beside it, got {trials}")
    apparatus = _apparatus(rig)
    truth = None if map_name is None else open_map(map_name)
    knowledge = None if known is None else open_map(known)
    if knowledge is None and problem.task_name != "mapping":
        knowledge = truth
    shape = None if size is None else _size(size)
    given = {"repeat_after": repeat_after, "end_after": end_after}
    patience = {name: seconds for name, seconds in given.items() if seconds is not None}
    for what, seconds in patience.items():
        check_number(seconds, what=what, above=0)
    _check_effect(rig, devices, problem, enter_every, **patience)
    without = {"log": log, "out": out, "film": film, "trim": trim, "calibration": calibration}
    check_calibrating(calibrate, mark, pixel_size, frequency, resume=resume, **without)
    if devices is None:
        for name, value in (("calibrate", calibrate), ("calibration", calibration), ("trim", trim)):
            if value is not None:
                raise InvalidInputError(
                    f"{name}: expected --actuator and --sensor beside it, got the rig {rig}"
                )
    if apparatus is not None:
        _check_local(truth, "physics")
        if problem.rule != "block":
            raise InvalidInputError(
                f"rule: expected block, as a plant's particles push each other, got {problem.rule}"
            )
    measured = None if calibration is None else BenchCalibration.load(calibration)
    if calibrate is not None:
        assert devices is not None
        with patient():
            quiet = {"on_event": None, **SECONDS, **patience}
            pair = _open_devices(devices, truth, problem, seed, apparatus, **quiet)
            with _closed_after(pair, always=True):
                calibrate_bench(
                    pair,
                    calibrate,
                    marks=mark,
                    pixel_size=pixel_size,
                    frequencies=frequency,
                    cell_size=spacing_of(problem.cell_size, 2),
                    shape=shape,
                    truth=truth if knowledge is None else knowledge,
                    json_=json_,
                )
        return
    book = _book(log, past, ctx, out)
    load_drive_kernels(problem)  # nobody waits for the compiler once the rig is connected
    spacing = None if truth is None else truth.spacing
    with patient():
        opened: Any
        link: dict[str, Any] = {
            "on_event": None if book is None else book.event,
            **SECONDS,
            **patience,
        }
        if devices is not None:
            pair = _open_devices(devices, truth, problem, seed, apparatus, past=past, **link)
            with _closed_after(pair, always=False):
                view = shape or (None if truth is None else truth.shape)
                opened = _bench(pair, view, measured, trim)
        elif _is_local(rig):
            opened = _local_rig(truth, problem, seed, apparatus, enter_every)
        elif is_connection(rig):
            opened = open_rig(rig, **link, resume=None if past is None else past.session)
        else:
            opened = open_own_rig(rig)
        if past is not None and _is_local(rig):
            rebuild(opened, past)
        if problem.cell_size is not None:
            spacing = spacing_of(problem.cell_size, len(opened.shape))
        fields = {name: getattr(problem, name) for name in DRIVEN if name in problem.given}
        if not _is_local(rig):  # what the user expects of it
            fields |= {
                name: getattr(problem, name)
                for name in ("particles", "rule")
                if name in problem.given
            }
        options: dict[str, Any] = {
            "seed": seed,
            "log": book,
            "on_moves": report_moves(opened.name),
            "test_move": test_move,
            "spacing": spacing,
            "resume": past,
            "known": knowledge,
            "inlet": _inlet(rig, problem, enter_every),
            "exact": exact or rig == "simulated" or rig.startswith("physics:exact") or None,
        }
        if problem.noise is not None and not exact:
            options["exact"] = False
        if book is not None and out is not None:
            book.pictures = out / "pictures"
        failure: BaseException | None = None
        try:
            _check_shape(opened, shape, truth)
            with keyboard(letters_of(len(opened.shape))) as keys:
                options["on_rest"] = None if keys is None else keys.rest
                try:
                    result = drive_rig(opened, **options, **fields)
                except BaseException as error:
                    if not hasattr(error, "drive"):  # nothing was scanned
                        raise
                    failure, result = error, error.drive
                if keys is not None and any(alarm.kind == "stop" for alarm in result.alarms):
                    stop_until_confirmed(opened)
        finally:
            getattr(opened, "close", lambda: None)()
        outputs: dict[str, Any] = {"out": out, "film": film, "json_": json_}
        outputs["trials"] = ctx.obj
        book_path = None if book is None else book.path
        outputs["options"] = options_given = _given(ctx)
        _report(result, opened, seed=seed, spacing=spacing, truth=truth, log=book_path, **outputs)
        if isinstance(failure, KeyboardInterrupt | SystemExit) and ctx.obj is None:
            say(_how_to_go_on(result, book_path, out, options_given))
        if failure is not None:
            raise failure
    unstopped = [alarm for alarm in result.alarms if alarm.kind == "stop"]
    if unstopped:
        raise RigError(unstopped[0].text)
    if not result and ctx.obj is None:
        raise typer.Exit(1)


def _check_effect(
    rig: str,
    devices: tuple[str, str] | None,
    problem: SwarmProblem,
    enter_every: int | None,
    **seconds: float,
) -> None:
    """Refuse options that have no effect on the kind of rig."""
    from shoal.rigs.ports import is_connection

    without: dict[str, tuple[Any, str]] = {}
    if not any(map(is_connection, devices or (rig,))):
        expected = "a rig behind a connection, whose answers may be late"
        without |= {name: (value, expected) for name, value in seconds.items()}
    if not _is_local(rig):
        expected = (
            "the rig simulated or physics, because the particles of a real rig are where they are"
        )
        without |= {
            name: (getattr(problem, name), expected)
            for name in ("start", "placement")
            if name in problem.given and not isinstance(getattr(problem, name), Inlet)
        }
    if _is_local(rig) and not isinstance(problem.start, Inlet) and enter_every is not None:
        without["enter_every"] = enter_every, "a start such as inlet:3,4"
    if not _is_local(rig) and enter_every is not None:
        without["enter_every"] = enter_every, "the rig simulated or physics"
    for name, (value, expected) in without.items():
        raise InvalidInputError(
            f"{name.replace('_', '-')}: expected {expected}, got {value!r} for the rig {rig}"
        )


DEVICES = ("actuator", "sensor")
NOT_LOGGED = ("log", "json_", "resume", "trials", "between", "calibrate")
MAY_CHANGE = ("rig", "repeat_after", "end_after", "max_moves", "out", "film")
"""Options that may differ when a drive goes on: the way to the rig may be another, but the rig's
name, shape and rule must be those of the log.
"""


def _given(ctx: typer.Context) -> dict[str, Any]:
    """Return the options of the drive on the command line, by name, as JSON."""
    return {
        name: json.loads(json.dumps(value, default=str))
        for name, value in ctx.params.items()
        if name not in NOT_LOGGED and is_given(ctx, name) and value is not None
    }


def _missing(ctx: typer.Context, past: RecordedRig) -> dict[str, Any] | None:
    """Return the options of the log that the user has not repeated, or None if there are none.

    Raises
    ------
    InvalidInputError
        Raised if an option contradicts the log.
    """
    given = _given(ctx)
    logged = {name: value for name, value in (past.options or {}).items() if name not in NOT_LOGGED}
    usual = {param.name: param.default for param in ctx.command.params}
    usual |= {name: one.default for name, one in SwarmProblem.declarations().items()}
    for name, value in given.items():
        expected = logged.get(name, usual[name])
        contradicts = name not in MAY_CHANGE and not _is_same(value, expected)
        if past.options is not None and contradicts:
            raise InvalidInputError(
                f"{name.replace('_', '-')}: expected {expected} as in {past.path}, got {value}"
            )
    unrepeated = {name: value for name, value in logged.items() if name not in given}
    for name, value, what in _to_type(unrepeated, past.path):
        raise InvalidInputError(
            f"{name}: expected --{name} {shlex.quote(value)} beside --resume, as no file alone makes"
            f" Shoal {what}, got none"
        )
    missing = {
        param.name: param.process_value(ctx, logged[param.name])
        for param in ctx.command.params
        if param.name is not None and param.name in logged and param.name not in given
    }
    return missing or None


def _to_type(options: dict[str, Any], log: Path) -> Iterator[tuple[str, str, str]]:
    """Yield the options of a log that must be typed again when the drive goes on, with their values
    and the reason: a log may be a stranger's, and must not alone make Shoal run programs or modules,
    or write files outside its folder.
    """
    from shoal.rigs.ports import runs_code

    here = log.resolve().parent
    for name, value in options.items():
        if name in ("rig", *DEVICES):
            if runs_code(str(value)):
                yield name, str(value), "run a program or a module"
        elif name in ("out", "film"):
            for file in value if isinstance(value, list) else [value]:
                if not Path(str(file)).resolve().is_relative_to(here):
                    yield name, str(file), "write outside the file's folder"
        elif name in SwarmProblem.declarations() and SwarmProblem.names_code(name, value):
            yield name, str(value), "run a program or a module"


def _is_same(value: Any, expected: Any) -> bool:
    """Return whether two values of an option are equal, or name one file."""
    if value == expected:
        return True
    files = [Path(one) for one in (value, expected) if isinstance(one, str)]
    return len(files) == 2 and all(one.is_file() for one in files) and files[0].samefile(files[1])


def _run_again(ctx: typer.Context, changed: dict[str, Any]) -> None:
    """Run the command again in its context, with some options as if they had been given."""
    source = ctx.get_parameter_source(next(name for name in ctx.params if is_given(ctx, name)))
    assert source is not None
    assert ctx.command.callback is not None
    for name, value in changed.items():
        ctx.set_parameter_source(name, source)
        ctx.params[name] = value
    ctx.command.callback(**ctx.params)


def _check_trials(**given: Path | None) -> None:
    """Refuse options that concern one drive."""
    for name, path in given.items():
        if path is not None:
            raise InvalidInputError(
                f"{name}: expected one drive, got several --trials (with --out, each has a log)"
            )


def _book(
    log: Path | None, past: RecordedRig | None, ctx: typer.Context, out: Path | None
) -> DriveLog | None:
    """Return the log of a drive: that of --log, that of the drive that goes on, or a new one in the
    folder of --out.
    """
    from shoal.rigs.log import DriveLog

    if past is not None:
        same = log is None or (log.exists() and log.samefile(past.path))
        return DriveLog(past.path, append=True) if same or log is None else DriveLog(log)
    if log is None and out is not None:
        names = (f"log{'' if number == 1 else f'-{number}'}.jsonl" for number in count(1))
        log = next(out / name for name in names if not (out / name).exists())
        return DriveLog(log, options=_given(ctx), make_folder=True)
    return None if log is None else DriveLog(log, options=_given(ctx))


def _show_finished(
    past: RecordedRig,
    map_name: str | None,
    out: Path | None,
    film: list[Path] | None,
    json_: bool,
) -> None:
    """Report the drive of a log that has ended of its own accord."""
    from shoal.rigs.driving import replay_log
    from shoal.swarm.maps.files import open_map

    truth = None if map_name is None else open_map(map_name)
    result, verified = replay_log(past)
    if not verified:
        raise InvalidInputError(f"{past.path}: {verified.message}")
    outputs: dict[str, Any] = {"out": out, "film": film, "json_": json_}
    about: dict[str, Any] = {"seed": past.seed, "spacing": past.spacing, "truth": truth}
    _report(result, past, log=past.path, verified=verified, **about, **outputs)


def _ended(log: Path, map_name: str | None) -> tuple[Drive, dict[str, Any]] | None:
    """Return the result of the drive of a log that was not interrupted, and what `shoal drive` prints
    of it, or None.
    """
    from shoal.rigs.driving import replay_log
    from shoal.rigs.log import read_log
    from shoal.swarm.maps.files import open_map

    past = read_log(log)
    if past.ended is None or past.ended["status"] == Status.INTERRUPTED:
        return None
    truth = None if map_name is None else open_map(map_name)
    result, _ = replay_log(past)
    result = replace(result, status=Status(past.ended["status"]))
    about = summary(result, past, truth, seed=past.seed, spacing=past.spacing)
    return result, about | {"seconds": round(past.lasted, 4)}


def _command_to_go_on(log: Path, options: dict[str, Any]) -> str:
    """Return the command that goes on with a drive that was begun with these options."""
    again = (f" --{name} {shlex.quote(value)}" for name, value, _ in _to_type(options, log))
    return f"shoal drive --resume {log}{''.join(again)}"


def _how_to_go_on(
    result: Drive, log: Path | None, out: Path | None, options: dict[str, Any]
) -> str:
    """Return what can be done after an interruption. A new drive begins with the particles where
    they are.
    """
    stopped = f"shoal: stopped after {count_text(result.moves, 'move')}"
    shown = f"the map so far is in {out}" if out is not None and result.episode is not None else ""
    if log is not None:
        replay = f"'shoal replay {log} --out FOLDER' writes the map so far"
        shown = f"{shown}, and {replay}" if shown else replay
        again = f"to go on: '{_command_to_go_on(log, options)}'"
    else:
        again = (
            "to go on, start the drive again, with --log: it begins with the particles where they"
            " are now"
        )
    return "; ".join(part for part in (stopped, shown, again) if part)


def _named(
    rig: str | None, actuator: str | None, sensor: str | None
) -> tuple[str, tuple[str, str] | None]:
    """Return the name of the rig, and those of its two devices if it is named by them."""
    if actuator is None and sensor is None:
        return rig or "simulated", None
    if actuator is None or sensor is None:
        given, missing = ("actuator", "sensor") if sensor is None else ("sensor", "actuator")
        raise InvalidInputError(f"{missing}: expected one beside the option --{given}, got none")
    if rig is not None:
        raise InvalidInputError(f"rig: expected either --rig or two devices, got also {rig!r}")
    plant = actuator.partition(":")[0] == "physics"
    if plant != (sensor == "physics"):
        raise InvalidInputError(
            "sensor: expected physics with an actuator physics:KIND, and only with it, got"
            f" {sensor!r} with {actuator!r}"
        )
    return actuator, (actuator, sensor)


def _bench(
    devices: tuple[Actuator, Sensor],
    view: tuple[int, ...] | None,
    measured: BenchCalibration | None,
    trim: bool | None,
) -> Rig:
    """Return a rig of two devices."""
    from shoal.rigs.calibration import Responses
    from shoal.rigs.measuring import pulses_of
    from shoal.rigs.ports import BenchRig
    from shoal.rigs.trim import PulseTrim

    moves, sees = devices
    whole = bool(getattr(moves, "whole", False))
    if whole and trim:
        raise InvalidInputError(
            f"trim: expected an actuator whose pulses can be changed, got {moves.name}, which"
            " carries out whole commands"
        )
    longest = getattr(moves, "longest", inf)
    if measured is None:
        only = bool(getattr(moves, "only", False))
        responses = Responses.from_pulses(pulses_of(moves), only=only) if trim else None
        trimmed = None if responses is None else PulseTrim(responses, longest=longest)
        return BenchRig(moves, sees, shape=getattr(sees, "shape", view), trim=trimmed)
    if measured.whole != whole:
        raise InvalidInputError(
            f"calibration: expected that of the actuator {moves.name}, got one of an actuator that"
            f" {'carries out whole commands' if measured.whole else 'takes pulses of any length'}"
        )
    trimmed = None
    if trim is not False and not whole:
        noise = 2**0.5 * measured.noise / measured.pixels_per_cell
        trimmed = PulseTrim(measured.responses, noise=noise, longest=longest)
    simulated = hasattr(sees, "frame_rate")  # its clock is not that of this computer
    return BenchRig(
        moves,
        sees,
        measured,
        shape=measured.shape,
        pulses=measured.pulses,
        latency=0.0 if simulated else measured.latency,
        trim=trimmed,
    )


@contextmanager
def _closed_after(devices: tuple[Actuator, Sensor], *, always: bool) -> Iterator[None]:
    """Close two devices after a block, always or if it raises an exception."""
    failed = True
    try:
        yield
        failed = False
    finally:
        if failed or always:
            try:
                devices[0].close()
            finally:
                devices[1].close()


def _open_devices(
    devices: tuple[str, str],
    truth: GridWorkspace | None,
    problem: SwarmProblem,
    seed: int,
    apparatus: PlantProperties | None,
    *,
    past: RecordedRig | None = None,
    **link: Any,
) -> tuple[Actuator, Sensor]:
    """Open two devices, which may be one."""
    from shoal.rigs.physics import PhysicsRig
    from shoal.rigs.ports import PlantPorts, Sensor, is_connection, open_actuator, open_sensor

    if apparatus is not None:
        rig = _local_rig(truth, problem, seed, apparatus, None)
        assert isinstance(rig, PhysicsRig)
        ports = PlantPorts(rig.plant)
        return ports, ports
    moved_by, seen_by = devices
    if moved_by == seen_by and is_connection(moved_by):
        raise InvalidInputError(
            f"sensor: expected another device than the actuator (or --rig {moved_by}), got"
            f" {seen_by!r} for both"
        )
    session = None if past is None else past.session
    moves = open_actuator(
        moved_by, **{**link, "resume": session} if is_connection(moved_by) else {}
    )
    if moved_by == seen_by and isinstance(moves, Sensor):
        return moves, moves
    try:
        return moves, open_sensor(seen_by, **link if is_connection(seen_by) else {})
    except BaseException:
        moves.close()
        raise


def _is_local(rig: str) -> bool:
    """Return whether Shoal itself simulates the rig, in the map given."""
    return rig == "simulated" or rig.partition(":")[0] == "physics"


def _apparatus(rig: str) -> PlantProperties | None:
    """Return the apparatus that ``physics:...`` describes, or None for another rig."""
    kind, _, text = rig.partition(":")
    if kind != "physics":
        return None
    from shoal.rigs.physics import PlantProperties

    return PlantProperties.parse(text)


def _check_local(truth: GridWorkspace | None, name: str) -> GridWorkspace:
    if truth is None:
        raise InvalidInputError(f"rig {name}: expected a map, such as vessels:500, got none")
    if name == "physics" and truth.ndim != 2:
        raise InvalidInputError(
            f"rig physics: expected a map in two dimensions, got {truth.name} in {truth.ndim}"
        )
    return truth


def _inlet(rig: str, problem: SwarmProblem, enter_every: int | None) -> tuple[int, ...] | None:
    """Return the cell at which particles may come in during the drive, or None."""
    if not isinstance(problem.start, Inlet) or (_is_local(rig) and enter_every is None):
        return None
    return problem.start.cell


def _local_rig(
    truth: GridWorkspace | None,
    problem: SwarmProblem,
    seed: int,
    apparatus: PlantProperties | None,
    enter_every: int | None,
) -> Rig:
    from shoal.rigs.physics import PhysicsRig
    from shoal.rigs.rig import EnteringRig, NoisyRig, SimulatedRig
    from shoal.swarm.grid.board import noise_rng, trial_rng
    from shoal.swarm.grid.tasks import place

    truth = _check_local(truth, "simulated")
    if isinstance(problem.start, tuple):
        start = np.array(problem.start)
    else:
        n = problem.particles if enter_every is None else 1
        start = place(truth, n, problem.start or problem.placement, trial_rng(seed))
    if apparatus is not None:
        rig: Any = PhysicsRig(truth, start, apparatus, noise_rng(seed))
    elif problem.noise is not None:
        rig = NoisyRig(truth, start, problem.noise, noise_rng(seed))
    else:
        rig = SimulatedRig(truth, start, rule=problem.rule)
    if enter_every is None:
        plain: Rig = rig
        return plain
    assert isinstance(problem.start, Inlet)
    most = problem.particles - 1
    return EnteringRig(rig, problem.start.cell, every=enter_every, most=most)


def _size(text: str) -> tuple[int, ...]:
    if not re.fullmatch("[1-9][0-9]{0,8}([xX][1-9][0-9]{0,8}){1,2}", text):
        raise InvalidInputError(
            f"size: expected ROWSxCOLUMNS or LAYERSxROWSxCOLUMNS, got {text[:60]!r}"
        )
    return tuple(int(part) for part in re.split("[xX]", text))


def _check_shape(rig: Rig, shape: tuple[int, ...] | None, truth: GridWorkspace | None) -> None:
    for expected, what in ((shape, "size"), (None if truth is None else truth.shape, "map")):
        if expected is not None and expected != rig.shape:
            raise InvalidInputError(
                f"{what}: expected a rig of {shape_text(expected)}, got {rig.name}, which sees"
                f" {shape_text(rig.shape)}"
            )


def summary(
    result: Drive,
    rig: Any,
    truth: GridWorkspace | None,
    *,
    seed: int,
    spacing: tuple[float, ...] | None,
) -> dict[str, Any]:
    """Return the data that ``shoal drive`` prints as JSON."""
    from shoal.rigs.checks import alarms_as_json

    link = result.link
    free = len(result.belief.open)
    return {
        "rig": rig.name,
        "shape": list(rig.shape),
        "rule": rig.rule,
        "policy": result.policy,
        "particles": len(result.cells),
        "seed": seed,
        "status": result.status,
        "reason": result.reason,
        "trust": dict(vars(result.trust)),
        "alarms": alarms_as_json(result.alarms),
        "rates": {name: dict(vars(rate)) for name, rate in result.rates.items()},
        "notes": list(result.notes),
        "task": result.task,
        "targets": result.targets,
        "visited": result.visited,
        "moves": result.moves,
        "scans": result.scans,
        "free_cells": free,
        "obstacles": len(result.belief.obstacles),
        "link": None if link is None else dict(vars(link)),
        "wrong": None if truth is None else result.compared(truth),
        "cell_mm": None if spacing is None else list(spacing),
        "cell_m": None if spacing is None else [size / 1000 for size in spacing],
        "seconds_per_command": _rounded(result.seconds_per_command),
        "seconds_per_scan": _rounded(result.seconds_per_scan),
        "seconds": round(result.seconds, 4),
        "commands": result.commands,
    }


def _rounded(seconds: float | None) -> float | None:
    return None if seconds is None else round(seconds, 6)


def _report(
    result: Drive,
    rig: Any,
    *,
    out: Path | None,
    film: list[Path] | None,
    json_: bool,
    seed: int,
    spacing: tuple[float, ...] | None,
    truth: GridWorkspace | None = None,
    log: Path | None = None,
    verified: Verification | None = None,
    trials: Trials | None = None,
    options: dict[str, Any] | None = None,
) -> None:
    from shoal.cli.swarm.exploration import write_outputs

    about = summary(result, rig, truth, seed=seed, spacing=spacing)
    for note in result.notes:
        say(f"shoal: {note}")
    written = [log] if log is not None and verified is None else []
    if out is not None and log is not None:
        from shoal.rigs.records import write_frames

        written.append(write_frames(log, out / "frames.csv"))
        about["log"] = str(log)
    if result.episode is not None:
        if out is not None:
            film = film or [out / "film.html"]
            written.append(_write_map(result.episode.workspace, out))
            written += _write_camera_film(result, rig, out, log)
        written += write_outputs([_with_truth(result.episode, truth)], about, out, film)
    elif out or film:
        say("shoal: the rig found no free cell, so there is nothing to draw or film")
    if trials is not None:
        trials.take(result, about)
        return
    if json_:
        print_json(
            about
            if verified is None
            else about | {"verified": verified.ok, "message": verified.message}
        )
        return
    rows = [
        (
            "rig",
            (
                f"{rig.name}, {shape_text(rig.shape)},"
                f" {count_text(about['particles'], 'particle')}, rule {rig.rule}"
            ),
        ),
        ("policy", result.policy),
        ("result", f"{result.status}: {result.reason}"),
        ("trust", f"{result.trust.level}: {result.trust.why}"),
        *(
            [
                (
                    "found",
                    f"{about['free_cells']} free cells and {about['obstacles']} wall cells around"
                    " them",
                )
            ]
            if result.targets is None
            else [("visited", f"{result.visited} of {count_text(result.targets, 'target cell')}")]
        ),
        ("scans", str(result.scans)),
        *(("alarm", alarm.text) for alarm in result.alarms),
    ]
    for name, rate in result.rates.items():
        text = (
            f"stated {rate.stated:g}, observed {rate.observed:.3f} (99.9 % interval {rate.low:.3f}"
            f" to {rate.high:.3f})"
        )
        rows.append((name, text))
    if spacing is not None:
        rows.append(("cell", f"{' × '.join(f'{size:g}' for size in spacing)} mm"))
    if result.link is not None:
        counts = (
            "{requests} requests, {resent} sent again, {damaged} lines damaged, {reconnects}"
            " reconnections"
        )
        rows.append(("link", counts.format(**vars(result.link))))
    if truth is not None:
        wrong = about["wrong"]
        rows.append(
            (
                "compared",
                (
                    f"{wrong['false_free']} walls classified as free, {wrong['false_obstacles']}"
                    " free cells classified as walls"
                ),
            )
        )
    if result.status is Status.INTERRUPTED and log is not None and verified is None:
        rows.append(("go on", _command_to_go_on(log, options or {})))
    if verified is not None:
        rows.append(("verified", f"{'yes' if verified else 'NO'}: {verified.message}"))
    print_table([*rows, ("time", _time_of(result))], title=f"drive of {rig.name}", written=written)


def _write_camera_film(result: Drive, rig: Any, out: Path, log: Path | None) -> list[Path]:
    """Write the film of the camera's pictures, if there are any."""
    to_pixels = getattr(getattr(rig, "calibration", None), "to_pixels", None)
    if to_pixels is None or log is None or not (out / "pictures").is_dir():
        return []
    from shoal.cli.swarm.camera_film import write_camera_film
    from shoal.rigs.log import read_log

    assert result.episode is not None
    scans = read_log(log, trust=True).scans
    try:
        film = out / "camera.mp4"
        return [write_camera_film(out / "pictures", film, result.episode, scans, to_pixels)]
    except MissingExtraError as error:
        say(f"shoal: no film of the camera: {error}")
        return []


def _write_map(workspace: GridWorkspace, out: Path) -> Path:
    """Write the free cells that were found, for another drive or another program."""
    from shoal.swarm.maps.files import write_map

    path = out / ("map.txt" if workspace.ndim == 2 else "map.npy")
    write_map(workspace, path)
    return path


def _time_of(result: Drive) -> str:
    """Return the time of a drive, and how long the rig took for a command and for a scan."""
    parts = [(result.seconds_per_command, "a command"), (result.seconds_per_scan, "a scan")]
    means = [f"{seconds:.3g} s {what}" for seconds, what in parts if seconds is not None]
    return f"{result.seconds:.2f} s" + (f" ({', '.join(means)})" if means else "")


def _with_truth(episode: SwarmEpisode, truth: GridWorkspace | None) -> SwarmEpisode:
    """Return a copy of a noisy rig's episode with the true map, so that figures show wrongly
    classified cells.
    """
    return (
        replace(episode, truth=truth.free)
        if episode.observations is not None and truth is not None
        else episode
    )


def replay_drive(
    log: Path,
    seed: int | None,
    out: Path | None,
    film: list[Path] | None,
    json_: bool,
    *,
    trust: bool,
) -> None:
    """Replay the log that ``shoal drive`` has written: ``shoal replay LOG.jsonl``."""
    from shoal.rigs.driving import replay_log
    from shoal.rigs.log import read_log

    rig = read_log(log, trust=trust)
    check_seed(log, seed, rig.seed)
    result, verified = replay_log(log, trust=trust)
    _report(
        result,
        rig,
        out=out if verified else None,
        film=film if verified else None,
        json_=json_,
        seed=rig.seed,
        spacing=rig.spacing,
        log=log,
        verified=verified,
    )
    if not verified:
        say(f"shoal: {log}: {verified.message}")
        raise typer.Exit(1)
