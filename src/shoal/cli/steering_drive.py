"""shoal drive --steer: steer the particles of a rig in a closed loop."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from shoal.cli.options import is_given
from shoal.cli.output import check_folder, print_json, print_table, say
from shoal.core.errors import InvalidInputError
from shoal.core.interruption import patient
from shoal.steering.problem import SteeringProblem

if TYPE_CHECKING:
    from shoal.steering.driving import SteeringDrive

TAKEN = ("steer", "waypoints", "follow", "friction_at_least", "rig", "seed", "log", "out", "json_")
BENCH = ("actuator", "sensor", "calibration", "size", "repeat_after", "end_after", "map_name")


def check_steering(ctx: typer.Context, **own: Any) -> None:
    """Refuse options that have no effect: of steering without ``--steer``, and of grids with it."""
    given = [name for name in ctx.params if is_given(ctx, name)]
    if own["steer"] is None:
        for name in ("waypoints", "follow", "friction_at_least"):
            if own[name] is not None:
                raise InvalidInputError(
                    f"{name.replace('_', '-')}: expected --steer PROBLEM beside it, got none"
                )
        return
    taken = TAKEN + (BENCH if "actuator" in given else ())
    for name in given:
        if name not in taken:
            raise InvalidInputError(
                f"{name.replace('_', '-').rstrip('-')}: expected no such option with --steer, whose"
                " problem file states the task"
            )
    if own["follow"] is not None and own["waypoints"] is None:
        raise InvalidInputError("follow: expected --waypoints beside it, got none")


def steering_problem(name: str, friction_at_least: float | None) -> SteeringProblem:
    """Return the problem of a file, or of a workspace's name."""
    from shoal.parts import read_problem

    if name.endswith(".json"):
        loaded = SteeringProblem.from_file(read_problem(name), name, trust=False)
    else:
        loaded = SteeringProblem(name)
    if friction_at_least is not None:
        loaded = loaded.replaced(friction_at_least=friction_at_least)
    return loaded


def steer_rig(
    problem: SteeringProblem,
    rig: Any,
    *,
    seed: int,
    waypoints: str | None,
    particle: int,
    log: Path | None,
    out: Path | None,
    json_: bool,
) -> None:
    """Steer an opened rig, and report the drive."""
    from shoal.steering.driving import SteeringDriveError, follow, steer_rig

    if out is not None:
        check_folder(out)
    common: dict[str, Any] = {"seed": seed, "log": log}
    failure = None
    with patient():
        try:
            if waypoints is None:
                result = steer_rig(problem, rig, **common)
            else:
                points = SteeringProblem.declarations()["goal"].option.parse
                assert points is not None
                try:
                    places = points(waypoints)
                except ValueError as error:
                    raise InvalidInputError(f"waypoints: {error}") from None
                result = follow(problem, rig, places, particle=particle, **common)
        except SteeringDriveError as error:
            failure, result = error, error.drive
        finally:
            with suppress(Exception):
                getattr(rig, "stop", lambda: None)()
            getattr(rig, "close", lambda: None)()
    _report(result, str(getattr(rig, "name", type(rig).__name__)), log, out, json_)
    if failure is not None:
        raise failure
    if not result:
        say(f"shoal: {result.status}: {result.reason}")
        raise typer.Exit(1)


def _report(
    result: SteeringDrive, rig: str, log: Path | None, out: Path | None, json_: bool
) -> None:
    report = {"rig": rig} | result.report()
    written = [] if log is None else [log]
    if out is not None:
        from shoal.core.files import write_json
        from shoal.views.drawing.charts import save_figure
        from shoal.views.steering.figures import drive_figure

        write_json(out / "drive.json", report)
        save_figure(drive_figure(result), out / "drive.png")
        written += [out / "drive.json", out / "drive.png"]
    if json_:
        print_json(report)
        return
    learnt = result.estimates
    gains = ", ".join(
        f"{gain:.3f} at {angle:+.1f}°"
        for gain, angle in zip(learnt["gain"], learnt["angle"], strict=True)
    )
    friction = learnt["friction"]
    rows = [
        ("rig", rig),
        ("result", f"{result.status}: {result.reason}"),
        ("moves", str(result.moves)),
        ("error", f"{result.error:.3g}, tolerance {result.problem.tolerance:g}"),
        ("gains", gains),
        ("friction", "not observed" if friction is None else f"about {friction:g}"),
    ]
    print_table(rows, title=f"robust in a {result.problem.place.kind}", written=written)


def local_steering_rig(problem: SteeringProblem, rig: str, seed: int) -> Any:
    """Return a rig that Shoal simulates: ``simulated`` or ``physics:...``; a rig behind a
    connection, if it can push and look; or a user's object.
    """
    import numpy as np

    kind, _, text = rig.partition(":")
    if rig == "simulated":
        from shoal.steering.simulation import Apparatus

        return Apparatus(problem, problem.endpoints(seed)[0], seed=seed)
    if kind == "physics":
        from shoal.rigs.physics import PlantProperties
        from shoal.rigs.steering_plant import SteeringPlant

        return SteeringPlant(
            problem.place,
            problem.endpoints(seed)[0],
            PlantProperties.parse(text),
            np.random.default_rng([seed, 7]),
            radius=problem.particle_radius,
        )
    from shoal.rigs.ports import is_connection

    if is_connection(rig):
        from shoal.rigs.calibration import Responses
        from shoal.rigs.remote import open_rig
        from shoal.rigs.steering_bench import SteeringBench

        remote = open_rig(rig)
        try:
            return SteeringBench(remote, Responses.from_pulses(remote.pulses))
        except BaseException:
            remote.close()
            raise
    from shoal.core.registry import Registry, configured

    found: Any = configured(Registry[Any]("rig"), rig)
    return found() if isinstance(found, type) or not hasattr(found, "look") else found


def steering_bench(devices: Any, view: tuple[int, ...] | None, calibration: Any) -> Any:
    """Return a rig for steering of two devices. Its unit of length is the cell."""
    from shoal.rigs.calibration import Responses
    from shoal.rigs.measuring import pulses_of
    from shoal.rigs.ports import BenchRig
    from shoal.rigs.steering_bench import SteeringBench

    moves, sees = devices
    if calibration is None:
        bench = BenchRig(moves, sees, shape=getattr(sees, "shape", view))
        stated = Responses.from_pulses(pulses_of(moves), only=bool(getattr(moves, "only", False)))
        return SteeringBench(bench, stated)
    simulated = hasattr(sees, "frame_rate")  # its clock is not that of this computer
    latency = 0.0 if simulated else calibration.latency
    bench = BenchRig(moves, sees, calibration, shape=calibration.shape, latency=latency)
    return SteeringBench(bench, calibration.responses)
