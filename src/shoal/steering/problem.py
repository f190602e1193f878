"""SteeringProblem: all settings of a steering run except its random seed."""

from __future__ import annotations

import json
import os
import re
from functools import cached_property
from math import inf, radians
from typing import Any, ClassVar, Self

import numpy as np

from shoal.core.checks import check_integer, check_number, check_points, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.problem import Problem, option
from shoal.steering.planners import PLANNERS, make_planner
from shoal.steering.planners.bounds import Bounds
from shoal.steering.workspaces.convex import Points
from shoal.steering.workspaces.formats import describe, open_workspace, workspace_of
from shoal.steering.workspaces.region import Region

# Worlds call kernels, whose compiler takes a second to load. They are imported when a problem is
# checked, so that commands, which only read the declarations below, start fast.

DRAWS = 10_000  # draws of a random point before the workspace counts as too small
FINEST = 1e-8  # relative to the size: contacts are not more accurate
RANDOM = "random"


def _check_workspace(value: Any) -> Any:
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, dict):
        return workspace_of(value, where="workspace")
    if not isinstance(value, str) and not hasattr(value, "check_inside"):
        raise InvalidInputError(
            "workspace: expected a name, a path, a workspace or its JSON form, got"
            f" {shortened(value)}"
        )
    return value


def _dump_workspace(value: Any) -> Any:
    return value if isinstance(value, str) else describe(value)


def _check_places(what: str) -> Any:
    def check(value: Any) -> Points | str:
        if isinstance(value, str) and value == RANDOM:
            return RANDOM
        try:
            spatial = np.ndim(value) == 2 and np.shape(value)[1] == 3
        except ValueError:  # points of different lengths
            spatial = False
        points = check_points(value, what=what, dimensions=3 if spatial else 2).copy()
        if len(points) < 2:
            raise InvalidInputError(f"{what}: expected 2 points or more, got {len(points)}")
        return points

    return check


def _parse_places(text: str) -> Any:
    if text == RANDOM:
        return RANDOM
    if re.search(r"[(\[]", text):
        groups = re.findall(r"[(\[]([^()\[\]]+)[)\]]", text)
    elif ";" in text:
        groups = text.split(";")
    elif any("," in word.strip(",") for word in text.split()):  # 0.1,0.2 0.3,0.4
        groups = text.split()
    else:  # 0.1 0.2, 0.3 0.4
        groups = text.split(",")
    points = [re.findall(r"[^\s,]+", group) for group in groups]
    sizes = {len(point) for point in points if len(point) > 1} if len(points) > 1 else set()
    # the same mark between all numbers: points of the plane
    size = sizes.pop() if len(sizes) == 1 else 2
    numbers = [number for point in points for number in point]
    try:
        if sizes or len(numbers) % size:
            raise ValueError
        return [
            [float(number) for number in numbers[k : k + size]]
            for k in range(0, len(numbers), size)
        ]
    except ValueError:
        raise ValueError(
            f"expected points, as in '0.1,0.2 0.3,0.4', got {shortened(text)}"
        ) from None


def _dump_places(value: Any) -> Any:
    return value if isinstance(value, str) else value.tolist()


def _check_planner(value: Any) -> Any:
    if value == "auto":
        return value
    if isinstance(value, str) and ":" in value and value.partition(":")[0] not in PLANNERS:
        return value  # objects in third-party modules are not imported yet
    make_planner(value)
    return value


def _dump_planner(value: Any) -> str:
    if isinstance(value, str):
        return value
    return (
        str(value.name)
        if value.name in PLANNERS
        else f"{type(value).__module__}:{type(value).__qualname__}"
    )


def _check_friction(value: Any) -> float:
    return inf if value is None else check_number(value, what="friction", least=0, finite=False)


def _dump_friction(value: float) -> float | None:
    return None if value == inf else value


@dataclass(frozen=True, eq=False)
class SteeringProblem(Problem):
    """The problem of steering two or more particles to their goals with one shared input.

    Each field of the class is an option of the command ``shoal steer``, a field of sweeps, and a
    field of problem files. In Python, the field ``workspace`` may be a workspace object, and the
    field ``planner`` may be a third-party planner object. The fields ``start`` and ``goal`` are
    float64 arrays of shape (particles, dimensions), or the word ``random``.

    Raises
    ------
    InvalidInputError, UnknownNameError
        If a value has the wrong type or range, or if fields contradict each other. If the workspace
        is an object, the constructor refuses points outside the workspace, particles with different
        goals at the same start, and unsuitable planners. If the workspace is a name or a file,
        `run` checks the points and the planner.

    Notes
    -----
    Source: paper W; docs/concepts/steering.md.

    Examples
    --------
    >>> problem = SteeringProblem("hexagon", [(0.1, 0.2), (0.2, 0.3)], [(0.0, 0.1), (0.3, 0.2)])
    >>> problem.canonical()
    '{"goal":[[0.0,0.1],[0.3,0.2]],"kind":"steering","start":[[0.1,0.2],[0.2,0.3]],"workspace":"hexagon"}'
    >>> problem.place
    <ConvexWorkspace polygon, 6 corners>
    """

    part: ClassVar[str] = "steering"
    headings: ClassVar = {
        "start": "Task",
        "planner": "Planner",
        "friction": "Contacts and noise",
        "goal_x": "Varied goal",
    }
    measures: ClassVar[tuple[str, ...]] = ("status", "moves", "length", "error", "lower_bound")

    workspace: Any = option(
        "square",
        help=(
            "Workspace: square, triangle, pentagon, hexagon, heptagon, octagon, regular:SIDES,"
            " disk, disk:RADIUS, a file (.json, .geojson, .wkt, .svg) or POLYGON ((...))."
        ),
        argument=True,
        metavar="WORKSPACE",
        check=_check_workspace,
        dump=_dump_workspace,
    )
    start: Any = option(
        RANDOM,
        help="Start points of the particles, or random (the seed determines the points).",
        metavar="'X,Y X,Y'",
        parse=_parse_places,
        check=_check_places("start"),
        dump=_dump_places,
    )
    goal: Any = option(
        RANDOM,
        help="Goal points of the particles, or random (the seed determines the points).",
        metavar="'X,Y X,Y'",
        parse=_parse_places,
        check=_check_places("goal"),
        dump=_dump_places,
    )
    tolerance: float = option(
        1e-6,
        help=(
            "Maximum distance of a particle from its goal at the end; at least 1e-8 times the size"
            " of the workspace. With noise, state a tolerance of at least ten times the noise."
        ),
        least=0,
    )
    interchangeable: bool = option(False, help="Any particle may go to any goal.")
    planner: Any = option(
        "auto",
        help=(
            f"Planner: auto, {', '.join(PLANNERS)} or MODULE:ATTRIBUTE. auto means the planner"
            " conformant if one of --friction-at-least, --angle-error and --gain-error is given, the"
            " planner robust for two particles with noise or an uneven field, the planner shortest for two"
            " particles in a convex workspace, and the planner sampling in all other cases."
        ),
        check=_check_planner,
        dump=_dump_planner,
        names=tuple(PLANNERS),
    )
    time: float | None = option(
        None,
        help="Time limit of the planner. At the time limit, Shoal takes the best plan so far.",
        unit="s",
        above=0,
        metavar="SECONDS",
    )
    max_moves: int = option(100, help="Maximum number of moves of a plan.", least=1)
    friction: float = option(
        inf,
        help=(
            "Coefficient of friction of the walls. With infinite friction, a particle that is"
            " pushed into a wall never slides."
        ),
        check=_check_friction,
        dump=_dump_friction,
    )
    friction_at_least: float | None = option(
        None,
        help=(
            "Plan for all coefficients of friction of at least this number, such as the lowest that"
            " is credible. The plan, which uses no observations, then keeps a least angle between"
            " walls and pushes."
        ),
        least=0,
        metavar="MU",
    )
    angle_error: float = option(
        0.0,
        help=(
            "Plan for moves whose angles have errors of this standard deviation, without"
            " observations."
        ),
        unit="degrees",
        least=0,
        below=30,
    )
    gain_error: float = option(
        0.0,
        help=(
            "Plan for moves whose lengths have relative errors of this standard deviation, and for"
            " particles whose own gains differ as much, without observations: 0.01 means 1 %."
        ),
        least=0,
        below=0.3,
    )
    particle_radius: float = option(
        0.0, help="Radius of the particles, in the unit of the workspace.", least=0
    )
    execution: float = option(
        0.0,
        help="Input noise: standard deviation of the error of each coordinate of a move.",
        least=0,
    )
    measurement: float = option(
        0.0,
        help="Camera noise: standard deviation of the error of each observed coordinate.",
        least=0,
    )
    gain: float = option(
        0.0,
        help=(
            "Variation of the gain (displacement divided by input) over the workspace, along a"
            " direction that the seed determines: 0.2 means a gain from 0.9 to 1.1."
        ),
        least=0,
        below=2,
    )
    clearance: float = option(
        1e-6,
        help=(
            "Clearance, as a fraction of the size of the workspace: a plan counts as solved only if"
            " it also reaches the goals with contact tolerances up to this number, and in turned"
            " coordinates. With noise, nothing is checked. With 0, a plan may reach its goals only"
            " in Shoal's own arithmetic."
        ),
        least=0,
        below=0.01,
    )
    goal_x: float | None = option(
        None,
        help=(
            "X coordinate of a new goal for the particle that the field varied names. The new goal"
            " may lie outside the workspace."
        ),
    )
    goal_y: float | None = option(
        None, help="Y coordinate of the new goal; goal_x is its x coordinate."
    )
    varied: int = option(
        2,
        help=(
            "Number, from 1, of the particle that gets the new goal with the coordinates goal_x and"
            " goal_y."
        ),
        least=1,
    )

    def check_together(self) -> None:
        """Raise an error if fields contradict each other."""
        if not isinstance(self.start, str) and not isinstance(self.goal, str):
            check_points(
                self.goal, what="goal", dimensions=self.start.shape[1], count=len(self.start)
            )
        if (self.goal_x is None) != (self.goal_y is None):
            raise InvalidInputError("goal_x, goal_y: expected both or none, got one")
        if self.goal_x is not None and isinstance(self.goal, str):
            raise InvalidInputError(
                "goal_x: expected a given goal for each particle, one of which goal_x replaces, got"
                " random goals"
            )
        if "varied" in self.given and not self.given & {"goal_x", "goal_y"}:
            raise InvalidInputError(
                f"varied: expected goal_x and goal_y together with varied, got only {self.varied}"
            )
        if self.goal_x is not None and self.varied > self.n_particles:
            raise InvalidInputError(
                f"varied: expected a particle, 1 to {self.n_particles}, got {self.varied}"
            )
        least = self.friction_at_least
        if least is not None and self.friction < least:
            raise InvalidInputError(
                f"friction at least: expected at most the friction, {self.friction:g}, got {least:g}"
            )
        if self.bounds is not None and (self.noisy or self.particle_radius):
            raise InvalidInputError(
                "friction at least, angle error, gain error: expected no execution, measurement,"
                " gain and particle radius, for which a plan without observations is not made"
            )
        if not isinstance(self.workspace, str):
            self.check_at_place()

    @property
    def n_particles(self) -> int:
        """Number of particles, which is 2 if both ``start`` and ``goal`` are random."""
        return next(
            (len(points) for points in (self.start, self.goal) if not isinstance(points, str)), 2
        )

    @property
    def noisy(self) -> bool:
        """Whether the moves or the camera have noise, or the gain (displacement divided by input)
        varies over the workspace.
        """
        return bool(self.execution or self.measurement or self.gain)

    @cached_property
    def bounds(self) -> Any:
        """The errors for which a plan must hold (`shoal.steering.planners.bounds.Bounds`), or None
        if none are stated.
        """
        if self.friction_at_least is None and not self.angle_error and not self.gain_error:
            return None
        least = self.friction if self.friction_at_least is None else self.friction_at_least
        return Bounds(least, radians(self.angle_error), self.gain_error)

    @property
    def chosen_planner(self) -> Any:
        """The planner as an object: the requested planner, or the planner that ``auto`` chooses.

        Raises
        ------
        InvalidInputError, UnknownNameError
            If the planner is unknown or does not support the task.
        """
        two, obstacles = self.n_particles == 2, isinstance(self.place, Region)
        if self.bounds is not None and self.planner not in ("auto", "conformant"):
            raise InvalidInputError(
                "planner: expected auto or conformant with friction at least, angle error or gain"
                f" error, got {_dump_planner(self.planner)}"
            )
        if self.bounds is not None:
            if not two:
                raise InvalidInputError(
                    "friction at least, angle error, gain error: expected 2 particles, got"
                    f" {self.n_particles}"
                )
            return make_planner("conformant")
        if isinstance(self.planner, str) and self.planner == "auto":
            simple = "robust" if self.noisy else "sampling" if obstacles else "shortest"
            return make_planner(simple if two else "sampling")
        planner = make_planner(self.planner)
        able = getattr(planner, "general", False) or (
            two and (not obstacles or getattr(planner, "obstacles", False))
        )
        if not able:
            lacking = (
                "a convex workspace, got a region"
                if two
                else f"2 particles, got {self.n_particles}"
            )
            raise InvalidInputError(
                f"planner {planner.name}: expected {lacking} (use the planner sampling)"
            )
        return planner

    @classmethod
    def from_file(cls, data: Any, path: str, *, trust: bool) -> Self:
        """Return the problem that the JSON data of the file ``path`` describes.

        A relative path of a workspace file is relative to the folder of the problem file if the
        workspace file exists there. Otherwise, the path is relative to the working directory.
        """
        problem = super().from_file(data, path, trust=trust)
        if isinstance(problem.workspace, str):
            beside = os.path.join(os.path.dirname(path), problem.workspace)
            if os.path.isfile(beside):
                problem = problem.replaced(workspace=beside)
        return problem

    def open_place(self) -> Any:
        """Return the workspace as an object."""
        return open_workspace(self.workspace) if isinstance(self.workspace, str) else self.workspace

    def place_key(self) -> str | None:
        """Return the name or path of the workspace, or None if the workspace is given
        as an object.
        """
        return self.workspace if isinstance(self.workspace, str) else None

    def place_files(self) -> tuple[str, ...]:
        """Return the file that the field ``workspace`` names, if it names one."""
        name = self.workspace
        return (name,) if isinstance(name, str) and os.path.exists(name) else ()

    def place_digest(self) -> bytes:
        """Return the JSON description of the workspace as bytes."""
        return json.dumps(describe(self.place), sort_keys=True).encode()

    def check_at_place(self) -> None:
        """Raise an error if the tolerance, a point or the planner does not suit the workspace.

        The method also raises an error if particles with different goals start at the same point.
        """
        workspace = self.place
        least = FINEST * workspace.size
        if self.tolerance < least:
            raise InvalidInputError(
                f"tolerance: expected a number of at least {least:g}, 1e-8 of the size, got"
                f" {self.tolerance:g}"
            )
        world = self.world()
        for what, points in (("start", self.start), ("goal", self.goal)):
            if isinstance(points, str):
                if workspace.dimensions != 2:
                    raise InvalidInputError(
                        f"{what}: expected points, because random points are drawn only in the"
                        " plane, got random"
                    )
            else:
                world.check_state(points, what=what)
        if not isinstance(self.start, str) and not isinstance(self.goal, str):
            check_can_part(*self.endpoints(0), self.tolerance)
        assert self.chosen_planner

    def world(self, *, seed: int = 0, gain: float | None = None) -> Any:
        """Return the simulated world of the problem; ``seed`` determines the direction in which the
        gain grows.
        """
        from shoal.steering.contact.world import make_world

        variation = self.gain if gain is None else gain
        return make_world(
            self.place,
            friction=self.friction,
            radius=self.particle_radius,
            gain=variation,
            seed=seed,
        )

    def endpoints(self, seed: int) -> tuple[Points, Points]:
        """Return the start and the goal of each particle; each float64, shape (particles,
        dimensions).

        If the starts or the goals are random, ``seed`` determines the random points.
        """
        rng = np.random.default_rng([check_integer(seed, what="seed", least=0), 1])
        start, goal = (
            self._draw_points(rng) if isinstance(points, str) else points.copy()
            for points in (self.start, self.goal)
        )
        if self.goal_x is not None:
            goal[self.varied - 1, :2] = self.goal_x, self.goal_y
        return start, goal

    def _draw_points(self, rng: np.random.Generator) -> Points:
        """Return one random point of the workspace for each particle; particles with a radius do
        not overlap at these points.
        """
        workspace, space, apart = self.place, self.world().free_space, 2 * self.particle_radius
        low, high = workspace.bounds
        points: list[Points] = []
        for _ in range(DRAWS):
            point = rng.uniform(low, high)
            if space.contains(point) and all(
                np.linalg.norm(point - other) >= apart for other in points
            ):
                points.append(point)
            if len(points) == self.n_particles:
                return np.array(points)
        raise InvalidInputError(
            f"particle radius: expected room for {self.n_particles} particles, got none for a"
            f" radius of {self.particle_radius:g} after {DRAWS} draws"
        )


def check_can_part(start: Points, goal: Points, tolerance: float) -> None:
    """Raise an error if particles with different goals start at the same point, because no shared
    move separates such particles.
    """
    for i in range(len(start)):
        for j in range(i):
            if np.array_equal(start[i], start[j]) and np.abs(goal[i] - goal[j]).max() > tolerance:
                raise InvalidInputError(
                    "start: expected particles at different points, got"
                    f" {tuple(start[i].tolist())} for particles {j + 1} and {i + 1}, which"
                    " a shared input never separates"
                )
