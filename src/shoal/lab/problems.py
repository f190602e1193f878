"""What a sweep plays: one class a kind of problem, with the measures of a trial.

A problem holds nothing but what a text can say, so that it has one canonical form and goes to any worker. What it names (a map, a
workspace, a region) is opened once a process.
"""

from __future__ import annotations

import hashlib
import inspect
import json
from collections.abc import Callable
from math import isfinite
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, StrictInt, TypeAdapter, ValidationError

from shoal.errors import InvalidInputError
from shoal.registry import Registry

Values = list[Any]
Place = tuple[FiniteFloat, ...]


class Problem(BaseModel):
    """One problem, whole; a subclass is a kind.

    Notes
    -----
    Sources of what trials do: `shoal.swarm.run`, `shoal.swarm.line.sample`, `shoal.swarm.scanning.Schedule.cost`,
    `shoal.steering.steer`, `shoal.search.search`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    measures: ClassVar[tuple[str, ...]] = ()

    kind: str

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of what a trial measures."""
        return self.measures

    def canonical(self, without: tuple[str, ...] = ()) -> str:
        """Return the problem as JSON that is the same for equal problems; what has its default is left out.

        Examples
        --------
        >>> SwarmProblem(kind="swarm", map="line:9", particles=3, rule="block").canonical()
        '{"kind":"swarm","map":"line:9","particles":3}'
        """
        fields = {name: value for name, value in self.model_dump(mode="json", exclude_defaults=True).items() if name not in without}
        return json.dumps(fields | {"kind": self.kind}, sort_keys=True, separators=(",", ":"), allow_nan=False)

    def source(self) -> str | None:
        """Return the name of the map, workspace or region that it opens; None if there is none."""
        return None

    def opened(self) -> Any:
        """Return what `source` names."""
        return None

    def check(self, opened: Any) -> None:
        """Refuse what no trial could play."""

    def play(self, opened: Any, seed: int) -> Values:
        """Play one trial; return what `columns` names: texts, whole numbers, finite floats, truth values or None."""
        raise NotImplementedError


class SwarmProblem(Problem):
    """Mapping or coverage of a map by a swarm: the arguments of `shoal.swarm.run` and of `shoal.swarm.maps.open_map`."""

    measures = ("status", "moves", "scans", "cost", "distance")

    kind: Literal["swarm"]
    map: str
    particles: StrictInt = Field(default=100, ge=1)
    task: str = "mapping"
    policy: str = "closest-frontier"
    placement: str = "uniform"
    rule: str = "block"
    max_moves: StrictInt = Field(default=1_000_000, ge=1)
    scan_every: StrictInt | str = 1
    scan_cost: FiniteFloat = 10.0
    move_cost: FiniteFloat = 1.0
    vessels: bool = False
    width: StrictInt | None = None
    threshold: FiniteFloat = 0.5
    invert: bool = False
    scale: FiniteFloat = 1.0
    largest_component: bool = False

    def source(self) -> str:
        """Return the map, and how it is read."""
        fields = ("map", "vessels", "width", "threshold", "invert", "scale", "largest_component")
        return json.dumps(self.model_dump(include={*fields}, exclude_defaults=True), sort_keys=True)

    def opened(self) -> Any:
        """Return the workspace."""
        from shoal.swarm.maps import open_map

        workspace = open_map(
            self.map, vessels=self.vessels, width=self.width, threshold=self.threshold, invert=self.invert, scale=self.scale
        )
        return workspace.largest_component() if self.largest_component else workspace

    def check(self, opened: Any) -> None:
        """Refuse unknown names, and more particles than cells."""
        from shoal.swarm import PLACEMENTS, RULES, make_policy, make_task
        from shoal.swarm.scanning import ScanRule

        make_policy(self.policy), make_task(self.task)
        PLACEMENTS.get(self.placement)
        ScanRule.parse(self.scan_every, scan_cost=self.scan_cost, move_cost=self.move_cost)
        if self.rule not in RULES:
            raise InvalidInputError(f"rule: expected one of {', '.join(RULES)}, got {self.rule!r}")
        if self.rule != "merge" and self.particles > opened.n_free:
            raise InvalidInputError(
                f"particles: expected at most {opened.n_free}, the free cells of {opened.name}, got {self.particles}"
            )

    def play(self, opened: Any, seed: int) -> Values:
        """Play an episode; ``shoal map`` with this seed plays the same one."""
        from shoal.swarm import run

        episode = run(
            opened, task=self.task, policy=self.policy, particles=self.particles, placement=self.placement, rule=self.rule,
            seed=seed, max_moves=self.max_moves, scan_every=self.scan_every, scan_cost=self.scan_cost, move_cost=self.move_cost,
        )  # fmt: skip
        return [episode.status, episode.moves, episode.scans, episode.cost, episode.distance]


class LineProblem(Problem):
    """Random placements on a line: means over ``placements`` of them (paper M, section III.A)."""

    measures = ("first", "last", "largest_gap", "spread", "boundary", "coverage", "printed_coverage")

    kind: Literal["line"]
    cells: StrictInt
    particles: StrictInt
    placements: StrictInt = Field(default=1, ge=1)

    def opened(self) -> Any:
        """Return the line."""
        from shoal.swarm.line import Line

        return Line(self.cells, self.particles)

    def play(self, opened: Any, seed: int) -> Values:
        """Draw the placements; ``shoal line`` with this seed draws the same."""
        from shoal.swarm.line import sample

        drawn = sample(opened, self.placements, seed=seed, workers=1)
        return [float(getattr(drawn, name).mean()) for name in self.measures]


class ScheduleProblem(Problem):
    """A wall at an unknown distance on a line, and a schedule of scans (paper M, section III.A.3)."""

    measures = ("distance", "moves", "scans", "move_ratio", "scan_ratio", "weighted_ratio")

    kind: Literal["schedule"]
    schedule: str = "i^i"
    max_distance: StrictInt = Field(default=1000, ge=0, le=10**15)
    distance: StrictInt | None = Field(default=None, ge=0, le=10**15)
    scan_cost: FiniteFloat = Field(default=10.0, ge=0)
    move_cost: FiniteFloat = Field(default=1.0, ge=0)

    def opened(self) -> Any:
        """Return the schedule."""
        from shoal.swarm.scanning import EveryStep, Hyperexponential, OneJump, Powers

        made = {"every-step": EveryStep, "i^i": Hyperexponential}.get(self.schedule)
        if made is not None:
            return made()
        name, _, number = self.schedule.partition(":")
        if name in {"powers", "one-jump"} and number.isdecimal():
            return Powers(int(number)) if name == "powers" else OneJump(int(number))
        raise InvalidInputError(f"schedule: expected every-step, i^i, powers:K or one-jump:M, got {self.schedule!r}")

    def check(self, opened: Any) -> None:
        """Refuse prices that are both zero, and schedules that end before the wall."""
        farthest = self.max_distance if self.distance is None else self.distance
        opened.cost(farthest).weighted_ratio(scan_cost=self.scan_cost, move_cost=self.move_cost)

    def play(self, opened: Any, seed: int) -> Values:
        """Draw a distance from 0 to ``max_distance``, if none is given, and find the wall."""
        import numpy as np

        at = self.distance
        cost = opened.cost(int(np.random.default_rng(seed).integers(self.max_distance + 1)) if at is None else at)
        weighted = cost.weighted_ratio(scan_cost=self.scan_cost, move_cost=self.move_cost)
        return [cost.distance, cost.moves, cost.scans, float(cost.move_ratio), float(cost.scan_ratio), float(weighted)]


class SteeringProblemKind(Problem):
    """Two particles or more, one shared input: the arguments of `shoal.steering.steer`.

    ``start`` and ``goal`` are points, or "random": then each trial draws them, uniformly in a plane workspace.
    """

    measures = ("status", "moves", "length", "error", "lower_bound")

    kind: Literal["steering"]
    workspace: str = "square"
    start: tuple[Place, ...] | Literal["random"] = "random"
    goal: tuple[Place, ...] | Literal["random"] = "random"
    goal_x: FiniteFloat | None = None
    goal_y: FiniteFloat | None = None
    varied: Literal[1, 2] = 2
    planner: str = "shortest"
    tolerance: FiniteFloat = 1e-6
    interchangeable: bool = False
    max_moves: StrictInt = Field(default=100, ge=1)
    execution: FiniteFloat = 0.0
    measurement: FiniteFloat = 0.0
    gain: FiniteFloat = 0.0
    friction: FiniteFloat | None = None
    radius: FiniteFloat = 0.0

    def source(self) -> str:
        """Return the workspace."""
        return self.workspace

    def opened(self) -> Any:
        """Return the workspace."""
        from shoal.steering import open_workspace

        return open_workspace(self.workspace)

    def check(self, opened: Any) -> None:
        """Refuse unknown planners, and a goal that is varied but not given."""
        from shoal.steering import make_planner

        make_planner(self.planner)
        self._disturbance()
        if (self.goal_x is None) != (self.goal_y is None):
            raise InvalidInputError("goal_x, goal_y: expected both or none, got one")
        if self.goal_x is not None and self.goal == "random":
            raise InvalidInputError(
                "goal_x: expected it with a goal for each particle, of which it replaces one, got a random goal"
            )

    def _disturbance(self) -> Any:
        from math import inf

        from shoal.steering import Disturbance

        friction = inf if self.friction is None else self.friction
        return Disturbance(self.execution, self.measurement, self.gain, friction, self.radius)

    def play(self, opened: Any, seed: int) -> Values:
        """Plan and play; ``shoal steer`` with this problem and seed does the same.

        A goal outside the workspace, as in a sweep over a square around a disk, has the status "outside".
        """
        import numpy as np

        from shoal.steering import SteeringProblem, steer

        rng = np.random.default_rng([seed, 1])
        start = _drawn(opened, rng) if self.start == "random" else np.array(self.start)
        goal = _drawn(opened, rng) if self.goal == "random" else np.array(self.goal)
        if self.goal_x is not None:
            goal[self.varied - 1] = self.goal_x, self.goal_y
            if not opened.contains(goal[self.varied - 1]):
                return ["outside", None, None, None, None]
        problem = SteeringProblem(opened, start, goal, self.tolerance, self.interchangeable)
        episode = steer(
            problem, planner=self.planner, disturbance=self._disturbance(), seed=seed, max_moves=self.max_moves
        )  # fmt: skip
        return [episode.status, episode.n_moves, episode.path_length, episode.error, episode.lower_bound]


def _drawn(workspace: Any, rng: Any) -> Any:
    """Return two points, uniform in a plane workspace."""
    import numpy as np

    if workspace.dimensions != 2:
        raise InvalidInputError("start, goal: expected points, as random ones are drawn in the plane only, got random")
    if getattr(workspace, "round", False):
        low, high = workspace.center - workspace.radius, workspace.center + workspace.radius
    else:
        low, high = workspace.vertices.min(axis=0), workspace.vertices.max(axis=0)
    points: list[Any] = []
    while len(points) < 2:
        point = rng.uniform(low, high)
        if workspace.contains(point):
            points.append(point)
    return np.array(points)


class SearchProblem(Problem):
    """Robots that search a region: the arguments of `shoal.search.search`; ``crashes`` robots die at random times."""

    measures = ("complete", "cells", "time", "share", "planned", "lower_bound", "sent", "lost", "takeovers")

    kind: Literal["search"]
    region: str
    robots: StrictInt = Field(default=4, ge=1)
    footprint: FiniteFloat = Field(default=10.0, gt=0)
    starts: str = "random"
    tour: str = "spanning-tree"
    allocation: str = "hop"
    turn_cost: FiniteFloat = 0.0
    transit: bool = False
    loss: FiniteFloat = 0.0
    network: str = ""
    crashes: StrictInt = Field(default=0, ge=0)
    fold: StrictInt = 1
    targets: StrictInt = 0
    detection: FiniteFloat = 1.0
    false_alarm: FiniteFloat = 0.0
    simulate: bool | None = None

    def source(self) -> str:
        """Return the region."""
        return self.region

    def opened(self) -> Any:
        """Return the region."""
        from shoal.search import open_region

        return open_region(self.region)

    def check(self, opened: Any) -> None:
        """Refuse more crashes than robots."""
        if self.crashes > self.robots:
            raise InvalidInputError(f"crashes: expected at most {self.robots}, one a robot, got {self.crashes}")

    def play(self, opened: Any, seed: int) -> Values:
        """Search; ``share`` is the time as a share of what one robot needs, T/T_UB."""
        import numpy as np

        from shoal.search import search
        from shoal.search.faults import Crash

        rng = np.random.default_rng([seed, 2])
        dead = rng.choice(self.robots, size=self.crashes, replace=False) + 1
        cells_each = opened.area_m2 / self.footprint**2 / self.robots
        faults = [Crash(int(robot), float(rng.uniform(0, 2 * cells_each))) for robot in np.sort(dead)]
        episode = search(
            opened, robots=self.robots, footprint=self.footprint, starts=self.starts, tour=self.tour, allocation=self.allocation,
            turn_cost=self.turn_cost, transit=self.transit, loss=self.loss, network=self.network, faults=faults, fold=self.fold,
            targets=self.targets, detection=self.detection, false_alarm=self.false_alarm, simulate=self.simulate, seed=seed,
        )  # fmt: skip
        cells, time = episode.plan.grid.n_cells, episode.covered_at if isfinite(episode.covered_at) else None
        allocation = episode.plan.allocation
        share = None if time is None else float(time) / cells
        numbers = [share, float(allocation.makespan), float(allocation.lower_bound), episode.sent, episode.lost, episode.takeovers]
        return [episode.complete, cells, None if time is None else float(time), *numbers]


class FunctionProblem(Problem):
    """Anybody's function, "module:attribute": called with ``seed`` and ``arguments``, it returns a dict of what it measured.

    The function names its measures: it has an attribute ``measures``, a tuple of the keys of what it returns.
    """

    kind: Literal["function"]
    function: str
    arguments: dict[str, Any] = Field(default_factory=dict)

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of what the function measures."""
        found = getattr(self.opened(), "measures", ())
        if not found or not all(isinstance(name, str) for name in found):
            raise InvalidInputError(
                f"function {self.function}: expected an attribute measures that names what it returns, got none"
            )
        return tuple(found)

    def opened(self) -> Callable[..., Any]:
        """Return the function."""
        found = Registry[Callable[..., Any]]("function").get(self.function)
        if not callable(found):
            raise InvalidInputError(f"function {self.function}: expected something to call, got {found!r:.80}")
        return found

    def check(self, opened: Any) -> None:
        """Refuse arguments that the function does not take."""
        try:
            inspect.signature(opened).bind(seed=0, **self.arguments)
        except TypeError as error:
            raise InvalidInputError(f"function {self.function}: {error}") from None

    def play(self, opened: Any, seed: int) -> Values:
        """Call it."""
        found = opened(seed=seed, **self.arguments)
        if not isinstance(found, dict) or {*found} != {*self.columns}:
            raise InvalidInputError(f"function {self.function}: expected a dict of {', '.join(self.columns)}, got {found!r:.80}")
        return [found[name] for name in self.columns]


AnyProblem = Annotated[
    SwarmProblem | LineProblem | ScheduleProblem | SteeringProblemKind | SearchProblem | FunctionProblem,
    Field(discriminator="kind"),
]
_READER: TypeAdapter[Problem] = TypeAdapter(AnyProblem)
KINDS = ("swarm", "line", "schedule", "steering", "search", "function")


def problem_of(fields: dict[str, Any], *, where: str = "problem") -> Problem:
    """Return the problem that fields describe.

    Raises
    ------
    InvalidInputError
        In one sentence that says where.
    """
    try:
        return _READER.validate_python(fields)
    except ValidationError as error:
        raise InvalidInputError(said(error, where=where)) from None
    except RecursionError:
        raise InvalidInputError(f"{where}: expected fields of modest depth, got more") from None


def said(error: ValidationError, *, where: str) -> str:
    """Return the first thing that is wrong, in one sentence."""
    first = error.errors()[0]
    if first["type"] in {"union_tag_not_found", "union_tag_invalid"}:
        given = first["input"].get("kind") if isinstance(first["input"], dict) else first["input"]
        return f"{where}: expected a kind, one of {', '.join(KINDS)}, got {given!r:.80}"
    at = ".".join(str(part) for part in first["loc"] if part not in KINDS)
    what = {"extra_forbidden": "expected no such field", "missing": "expected this field"}.get(first["type"], first["msg"])
    came = "none" if first["type"] == "missing" else repr(first["input"])[:80]
    return f"{where}{': ' * bool(at)}{at}: {what[0].lower()}{what[1:]}, got {came}"


def fingerprint(problem: Problem, opened: Any) -> str | None:
    """Return a digest of what a problem opens, None if it opens nothing: a file may hold another map tomorrow."""
    if problem.source() is None:
        return None
    digest = hashlib.blake2b(digest_size=8)
    if isinstance(problem, SwarmProblem):
        digest.update(repr(opened.shape).encode() + opened.free.tobytes())
    elif isinstance(problem, SteeringProblemKind):
        from shoal.steering.formats import describe

        digest.update(json.dumps(describe(opened), sort_keys=True).encode())
    elif isinstance(problem, SearchProblem):
        digest.update(opened.area.wkb)
    return digest.hexdigest()


def is_file(problem: Problem) -> bool:
    """Tell whether a problem opens a file: then what it opens must be sent to workers, who may not have it."""
    names = {SwarmProblem: "map", SteeringProblemKind: "workspace", SearchProblem: "region"}
    name = getattr(problem, names.get(type(problem), "kind"))
    try:
        return Path(name).is_file()
    except (OSError, ValueError):  # a name too long for a file
        return False
