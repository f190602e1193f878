"""Signed tasks: what the process of each robot must know before a search.

A task is a JSON file with the search problem, its seed, and what follows from them: the cells along
the tour and each robot's start, speed and height. A key file lies beside it. Who reads a task plans
the search again, and refuses the task if anything differs from what the file says, so that all
robots of a search work with the same cells.
"""

from __future__ import annotations

import hmac
import json
import math
import os
import secrets
from collections.abc import Mapping
from dataclasses import replace
from errno import EEXIST
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from shoal.core.checks import check_number, describe_missing_file, parse_json, read_text, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, OutputError
from shoal.core.files import write_json
from shoal.search import SearchEpisode, SearchPlan
from shoal.search.planning.plan import plan_search
from shoal.search.problem import SearchProblem
from shoal.search.problem.fields import read_key
from shoal.search.problem.network import RadioNetwork
from shoal.search.regions.outline import LARGEST_FILE, Points
from shoal.search.regions.projection import LocalFrame
from shoal.search.simulation.live.radio import LiveTask
from shoal.search.simulation.scenario import Scenario, scenario_of

FORMAT = "shoal task 2"
TASK, KEY, MISSIONS = "task.json", "task.key", "missions"
"""Names in the folder of a prepared search."""

_HELLO, _BEAT = 3.0, 0.5  # seconds: least time of listening, and between two beacons
_NOWHERE = LocalFrame(0.0, 0.0)  # where a rehearsal places a region without a place on Earth
_NEAR = 0.2  # share of a cell within which a vehicle has arrived
_NEAREST, _FARTHEST = 0.5, 3.0  # metres
# what a search simulates, and a robot in the field finds out by itself
_SIMULATED = ("faults", "crashes", "targets", "obstacles", "loss", "network", "live", "key")


@dataclass(frozen=True)
class RobotLimits:
    """What ends a robot's part of the search.

    Parameters
    ----------
    battery : float
        Fraction of the battery below which the robot returns. With 0, the autopilot need not tell
        the charge.
    autopilot_s, position_s, radio_s : float
        Seconds without a message of the autopilot or without the charge of the battery, without a
        position, or with a radio that cannot send, after which the robot gives up.
    vertical_m : float
        Difference between the heights of two robots with neighbouring numbers.
    horizontal_m : float
        Distance that two robots must keep while their heights differ by less than that.
    apart_s : float
        Seconds between the take-offs, and between the returns, of two robots with neighbouring
        numbers.
    """

    battery: float = 0.2
    autopilot_s: float = 5.0
    position_s: float = 5.0
    radio_s: float = 10.0
    vertical_m: float = 5.0
    horizontal_m: float = 5.0
    apart_s: float = 15.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            most = 1.0 if name == "battery" else math.inf
            check_number(value, what=f"limits: {name}", least=0, most=most)


def read_limits(text: str) -> RobotLimits:
    """Read limits from a text such as ``battery=0.3,apart_s=20``. Others are as by default.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> read_limits("battery=0.3").battery
    0.3
    """
    names, limits = list(vars(RobotLimits())), dict[str, float]()
    for part in text.split(","):
        name, _, value = (piece.strip() for piece in part.partition("="))
        if name not in names or name in limits:
            raise InvalidInputError(
                f"limits: expected each of {', '.join(names)} once at most, got {part.strip()!r}"
            )
        try:
            limits[name] = float(value)
        except ValueError:
            raise InvalidInputError(
                f"limits: expected a number as {name}, got {shortened(value)}"
            ) from None
    return RobotLimits(**limits)


@dataclass(frozen=True)
class RobotTask:
    """A task that was read and checked.

    Parameters
    ----------
    path : Path
    search : str
        Identifier of the search.
    plan : SearchPlan
    scenario : Scenario
        The brief of the robots, their starts, speeds and footprints.
    limits : RobotLimits
    loss : float
        Share of messages that a rehearsal loses.
    key : bytes
        Key of the search's messages.
    """

    path: Path
    search: str
    plan: SearchPlan
    scenario: Scenario
    limits: RobotLimits
    loss: float
    key: bytes

    @property
    def kind(self) -> str:
        """Kind of the vehicles."""
        return self.plan.vehicle.kind

    @property
    def geographic(self) -> bool:
        """Whether the region has a place on Earth."""
        return self.plan.grid.region.frame is not None

    @property
    def frame(self) -> LocalFrame:
        """The local frame of the region; for a region without one, a frame for rehearsals."""
        return self.plan.grid.region.frame or _NOWHERE

    @property
    def speed(self) -> float:
        """Number of cells that a robot of speed 1 searches in a second."""
        return 1.0 / self.plan.cell_seconds

    @cached_property
    def cells(self) -> Points:
        """Viewpoint of each cell along the tour in metres; float64, shape (N, 2) or (N, 3)."""
        return self.plan.positions(np.arange(len(self.plan.tour)))

    @property
    def arrival_m(self) -> float:
        """Distance in metres from a viewpoint within which a vehicle has arrived."""
        return min(max(_NEAR * self.plan.grid.size, _NEAREST), _FARTHEST)

    def height(self, number: int) -> float:
        """Height above its start in metres at which a robot flies and returns; 0 for a rover."""
        if self.kind == "rover":
            return 0.0
        return self.plan.vehicle.height + (number - 1) * self.limits.vertical_m

    def live(self, number: int, *, loss: float = 0.0) -> LiveTask:
        """Return what the agent of a robot needs."""
        if not 1 <= number <= len(self.scenario.starts):
            raise InvalidInputError(
                f"id: expected a robot from 1 to {len(self.scenario.starts)}, got {number}"
            )
        network = RadioNetwork()
        if loss:
            from shoal.search.problem.network import network_of

            network = network_of("", loss=loss)
        return LiveTask(replace(self.scenario, network=network), self.speed, "unicast", 0, self.key)


def write_task(
    episode: SearchEpisode, folder: str | os.PathLike[str], limits: RobotLimits | None = None
) -> list[Path]:
    """Write the task of a planned search and its key into a folder, and return their paths.

    The key is that of the search problem or, if it names none, a new one.

    Raises
    ------
    InvalidInputError
        If robots cannot carry out the plan as its vehicles are.
    OutputError
    """
    home = Path(folder)
    contained, plan = episode.self_contained(), episode.plan
    secret = contained.key
    key = read_key(secret) if secret is not None else secrets.token_hex(32).encode()
    plain = {
        name: SearchProblem.declarations()[name].default
        for name in _SIMULATED
        if name in contained.given
    }
    problem = contained.replaced(
        **plain,
        tour=plan.tour.name,
        allocation=plan.allocation.allocator,
        angle=plan.grid.angle if contained.along is None else None,
        **({"starts": tuple(map(tuple, plan.places.tolist()))} if contained.launch is None else {}),
    )
    problem = _reproducible_problem(problem, contained, plan, episode.seed)
    limits = limits or RobotLimits()
    body = {
        "format": FORMAT,
        "search": secrets.token_hex(8),
        "problem": problem.to_dict(),
        "seed": episode.seed,
        "loss": contained.loss,
        "limits": dict(vars(limits)),
        **_derive_fields(plan, scenario_of(problem, plan, episode.seed)),
    }
    body["signature"] = _sign(key, body)
    task, key_file = home / TASK, home / KEY
    try:
        there = describe_missing_file(key_file)
        if there not in ("", "no such file"):
            raise FileExistsError(EEXIST, f"it is {there}")
        if not there and key_file.read_bytes() != key + b"\n":
            raise FileExistsError(EEXIST, "it is the key of another search, whose robots need it")
        home.mkdir(parents=True, exist_ok=True)
        handle = os.open(key_file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(handle, "wb") as file:
            os.fchmod(file.fileno(), 0o600)
            file.write(key + b"\n")
    except OSError as error:
        raise OutputError(f"cannot write {key_file}: {error.strerror or error}") from None
    write_json(task, body)
    return [task, key_file]


def _reproducible_problem(
    problem: SearchProblem, contained: SearchProblem, plan: SearchPlan, seed: int
) -> SearchProblem:
    """Return the problem with whose plan a robot gets the same cells and starts."""
    for candidate in (problem, contained.replaced(live=None, key=None, faults=(), crashes=0)):
        try:
            candidate_plan = plan_search(candidate, seed=seed)
        except InvalidInputError:
            continue
        if _agree(_derive_fields(plan, None), _derive_fields(candidate_plan, None)):
            return candidate
    raise InvalidInputError(
        "prepare: expected a search that robots can plan again from its problem, got one whose"
        " plan depends on something else"
    )


def _derive_fields(plan: SearchPlan, scenario: Scenario | None) -> dict[str, Any]:
    """Return what follows from the problem, as the file says it."""
    cells = plan.positions(np.arange(len(plan.tour)))
    frame = plan.grid.region.frame
    if frame is not None:
        degrees = frame.to_degrees(cells[:, :2]).round(7)
        cells = np.column_stack([degrees, cells[:, 2:]])
    stops = [plan.stops(robot) for robot in range(len(plan.places))]
    values = {
        "geographic": frame is not None,
        "cells": cells.round(7).tolist(),
        "seconds_per_cell": plan.cell_seconds,
        "starts": plan.starts.tolist(),
        "rates": plan.rates.tolist(),
        "widths": plan.widths.tolist(),
        "stops": np.concatenate(stops).tolist(),
        "counts": [len(own) for own in stops],
    }
    if scenario is not None:
        values["allocator"] = scenario.brief.allocator
    return values


def _agree(first: Mapping[str, Any], second: Mapping[str, Any]) -> bool:
    return all(
        np.shape(first[name]) == np.shape(second[name])
        and np.allclose(first[name], second[name], atol=2e-7, rtol=1e-9)
        for name in ("cells", "seconds_per_cell", "starts", "rates", "widths", "stops", "counts")
    )


def _sign(key: bytes, body: Mapping[str, Any]) -> str:
    fields = {name: value for name, value in body.items() if name != "signature"}
    text = json.dumps(fields, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hmac.new(key, text.encode(), "sha256").hexdigest()


def read_task(path: str | os.PathLike[str], *, trust: bool = False) -> RobotTask:
    """Read a task, check its signature with the key file beside it, and plan the search again.

    Parameters
    ----------
    path : path-like
        A task file, or the folder of a prepared search.
    trust : bool
        Whether the task may name tours and allocations that are code of a third party.

    Raises
    ------
    InvalidInputError
        If the file is no task, if its signature is not by the key, or if the plan made here differs
        from the one in the file.
    """
    source = Path(path)
    if source.is_dir():
        source = source / TASK
    body = parse_json(read_text(source, what="task", most=LARGEST_FILE), where=str(source))
    if not isinstance(body, dict) or body.get("format") != FORMAT:
        raise InvalidInputError(
            f"{source}: expected a task of the format {FORMAT!r}, got {shortened(body)}"
        )
    secret = read_key(str(source.with_suffix(".key")))
    signature = body.get("signature")
    try:
        expected = _sign(secret, body)
    except ValueError:
        expected = ""
    if not isinstance(signature, str) or not hmac.compare_digest(
        signature.encode(errors="replace"), expected.encode()
    ):
        raise InvalidInputError(
            f"{source}: expected a signature by the key in {source.with_suffix('.key').name},"
            " got another: the file was changed, or the key belongs to another task"
        )
    try:
        return _plan_again(source, body, secret, trust=trust)
    except InvalidInputError:
        raise
    except (KeyError, TypeError, ValueError) as error:  # signed, but by another version
        raise InvalidInputError(
            f"{source}: expected a task of this version of Shoal, got another:"
            f" {type(error).__name__}: {error}"
        ) from None


def _plan_again(source: Path, body: dict[str, Any], secret: bytes, *, trust: bool) -> RobotTask:
    """Return a task whose signature is right, after planning the search again."""
    if not trust:
        SearchProblem.refuse_code(body["problem"], where=str(source))
    problem = SearchProblem.from_dict(body["problem"], where=str(source))
    plan = plan_search(problem, seed=body["seed"])
    scenario = scenario_of(problem, plan, body["seed"])
    if not _agree(body, _derive_fields(plan, scenario)):
        raise InvalidInputError(
            f"{source}: expected the cells, starts, speeds and stops in the file, got others from planning"
            " the search on this computer: use the same version of Shoal on all computers"
        )
    speed = 1.0 / plan.cell_seconds
    brief = replace(
        scenario.brief,
        hello=max(scenario.brief.hello, _HELLO * speed),
        beat=min(scenario.brief.beat, _BEAT * speed),
        helping=True,
    )
    key = hmac.digest(secret, f"messages {body['signature']}".encode(), "sha256")
    limits = RobotLimits(**body["limits"])
    return RobotTask(
        source, body["search"], plan, replace(scenario, brief=brief), limits, body["loss"], key
    )
