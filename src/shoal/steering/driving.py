"""Closed-loop steering of a rig: any object that looks at its particles and sends inputs."""

from __future__ import annotations

import json
import os
from abc import ABC, abstractmethod
from collections.abc import Callable
from itertools import permutations
from math import atan, inf, tan
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_function, check_integer, check_points
from shoal.core.dataclass import dataclass
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError, OutputError, RigError
from shoal.steering.contact.friction import friction_limit
from shoal.steering.contact.world import ContactWorld, RegionWorld
from shoal.steering.estimation import (
    LESS,
    STEP,
    UNKNOWN,
    FaultEstimate,
    FrictionEstimate,
    GainEstimate,
)
from shoal.steering.kernels import pressing as kernels
from shoal.steering.planners.bounds import Bounds
from shoal.steering.planners.pressing import PressingSearch, pressing_of
from shoal.steering.planners.robust import _project_inside
from shoal.steering.planners.sampling import free_offsets, world_of
from shoal.steering.planners.task import SteeringTask, path_length
from shoal.steering.problem import SteeringProblem
from shoal.steering.workspaces.convex import Points
from shoal.steering.workspaces.region import Region

LOOKS = 3  # at the start, which show the error of the camera
ALIKE = 3e-3  # relative to the size: errors of two orders of the particles that are alike
SAME = 2e-4  # relative to the size: error of a camera whose looks are all the same
AGAIN = 5  # looks in which particles are missing, until the drive ends
ANGLE, GAIN = np.radians(1.0), 0.01  # assumed standard deviations of the errors of a move
LEVELS = (0.1, 0.3, 0.5, 0.8, 0.95)  # quantiles of the friction, with which plans are tried in turn
SURE = 0.97  # quantile of the friction with which a goal is proved unreachable
FAST, SLOW, WANTED = (4_000, 30_000, 12)  # manoeuvres of a search, and plans of it
SCENARIOS = 64  # of errors, in which plans are compared
SOON = 3  # moves of a plan, after which the errors are compared
UNSURE = 0.05  # standard deviation of the gains, above which a move ends before the walls
STEEPEST = 5.0  # tangent of the largest angle between a push and the normal of a wall
NO_PLAN = 4  # moves without any plan until the drive ends
OFTEN = 0.7  # share of the moves with which more friction than needed is risked
LONG = 30.0  # moves to the goals, up to which a plan leads there
FEW = 3  # moves of a plan that is carried out without a search for a shorter one
CAREFUL = 2.0  # standard deviations of a move that a careful input allows for
SLIPPERY = 3.0  # friction below which moves to walls are careful
STRIDE = 0.2  # relative to the size: longest move along a path
PATH_MARGINS = (0.02, 0.01, 1e-3)  # relative to the size: distance of paths from walls
PATIENCE = 40  # moves without progress until the drive ends
SLOW_GAIN = 0.75  # below which the gain is told
STILL = 3  # moves of which no particle makes a fifth, until the drive ends
NEAR = 2e-3  # relative to the size: distance up to which a particle is taken to touch a wall
MOST = 100  # default of the largest number of moves
WITHIN = 0.02  # default of the tolerance, relative to the size


class SteeringRig(Protocol):
    """A rig for steering.

    The positions are float64 of shape (particles, 2) in the unit of the problem, or an object with
    such an array in its attribute ``points``. If particles change their order from one look to the
    next, the drive follows them.
    """

    def look(self) -> Any:
        """Return the observed positions of all particles."""

    def send(self, move: NDArray[np.float64], /) -> None:
        """Move all particles by one shared input, float64 of shape (2,), and wait until it is
        done.
        """


@dataclass(frozen=True, eq=False)
class SteeringDrive:
    """The result of a drive. ``bool(drive)`` is true if a look has shown all particles at their
    goals.

    Parameters
    ----------
    problem : SteeringProblem
    status : Status
        ``arrived``: the last look showed all particles within the tolerance of their goals.
        ``slipping``: the walls slip more than stated, and the drive ended without success.
        ``unreachable``: a proof shows that no plan exists, with the friction observed. ``stalled``:
        no plan was found, or many moves brought no progress. ``limit``: the maximum number of moves
        was made. ``alarm``: the particles do not follow the inputs, or were lost.
    reason : str
    inputs : ndarray of float64, shape (moves, 2)
    seen : ndarray of float64, shape (moves + 1, particles, 2)
        Observed positions at the start and after each move.
    goal : ndarray of float64, shape (particles, 2)
        The goal of each particle.
    estimates : dict
        What the drive learnt: ``friction`` with ``friction_low`` and ``friction_high`` (between
        which 90 % of the probability lies; None: so high that nothing slips), ``gain`` and ``angle``
        in degrees of each particle, ``look_error`` (the standard deviation of the camera), and
        ``slips`` and ``holds``: whether the walls surely hold less, or more, than stated.
    seconds : float
    """

    problem: SteeringProblem
    status: Status
    reason: str
    inputs: Points
    seen: Points
    goal: Points
    estimates: dict[str, Any]
    seconds: float

    def __bool__(self) -> bool:
        return self.status is Status.ARRIVED

    @property
    def moves(self) -> int:
        """Number of inputs sent."""
        return len(self.inputs)

    @property
    def error(self) -> float:
        """Largest observed distance of a particle from its goal at the end."""
        return float(np.linalg.norm(self.seen[-1] - self.goal, axis=1).max())

    def report(self) -> dict[str, Any]:
        """Return the JSON object that ``shoal drive --steer`` prints."""
        return {
            "status": str(self.status),
            "reason": self.reason,
            "policy": "robust",
            "moves": self.moves,
            "error": self.error,
            "tolerance": self.problem.tolerance,
            "estimates": self.estimates,
            "inputs": self.inputs.tolist(),
            "seen": self.seen.tolist(),
            "goal": self.goal.tolist(),
            "seconds": round(self.seconds, 4),
        }


class SteeringDriveError(RigError):
    """Raised if a rig fails during a drive. The attribute ``steer_rig`` holds the result so far."""

    def __init__(self, text: str, drive: SteeringDrive) -> None:
        super().__init__(text)
        self.drive = drive


class SteeringLog:
    """A log of a drive as JSON lines, each written at once.

    Raises
    ------
    OutputError
        If the file exists already, or cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        try:
            self._file = Path(path).open("x", encoding="utf-8")  # noqa: SIM115
        except FileExistsError:
            raise OutputError(f"{path}: exists already; a log is never overwritten") from None
        except OSError as error:
            raise OutputError(f"{path}: {error.strerror}") from None

    def write(self, **event: Any) -> None:
        """Write one event."""
        self._file.write(json.dumps(event) + "\n")
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def steer_rig(
    problem: SteeringProblem,
    rig: Any,
    *,
    seed: int = 0,
    log: str | os.PathLike[str] | None = None,
    on_move: Callable[[int, float], None] | None = None,
) -> SteeringDrive:
    """Steer the two particles of a rig to their goals in a closed loop: the policy ``robust``.

    The loop uses ``rig.look()`` and ``rig.send(input)`` only. It learns the gain and the angle of
    each particle's motion and the friction of the walls from what it sees, and plans anew after
    each move.

    Parameters
    ----------
    problem : SteeringProblem
        Workspace, goals and tolerance (2 % of the size unless given). The field ``start`` names
        which particle is which, and is otherwise not used: the particles are where the first look
        shows them. ``friction_at_least``, else ``friction``, is the least friction of the walls
        that the user states.
    rig : SteeringRig
    seed : int
        Seed of the random decisions of the planner.
    log : path, optional
        New file for the log.
    on_move : callable, optional
        Function called after each move with the number of moves and the largest distance from a
        goal.

    Raises
    ------
    InvalidInputError
        If the problem does not have two particles in a plane workspace.
    SteeringDriveError
        If the rig fails; its attribute ``steer_rig`` holds the result so far.
    OutputError
        If the log exists already, or cannot be written.

    Examples
    --------
    >>> from shoal.steering.simulation import Apparatus
    >>> problem = SteeringProblem("square", [(0.2, 0.3), (0.5, 0.35)], [(0.6, 0.2), (0.7, 0.4)])
    >>> rig = Apparatus(problem.replaced(friction=2.0), problem.start, seed=1)
    >>> steer_rig(problem, rig).status
    <Status.ARRIVED: 'arrived'>
    """
    check_function(on_move, what="on_move")
    seed = check_integer(seed, what="seed", least=0)
    problem = _check_drive(problem, rig)
    if problem.n_particles != 2:
        raise InvalidInputError(f"a drive: expected two particles, got {problem.n_particles}")
    return _run(_Loop(problem, rig, seed, None, on_move), log)


def _check_drive(problem: SteeringProblem, rig: Any) -> SteeringProblem:
    """Return the problem with its tolerance, if a rig can be driven by it."""
    for name in ("look", "send"):
        if not callable(getattr(rig, name, None)):
            raise InvalidInputError(
                f"rig: expected an object with look() and send(input), got {type(rig).__name__}"
            )
    if problem.place.dimensions != 2:
        raise InvalidInputError(f"a drive: expected a plane workspace, got a {problem.place.kind}")
    if "tolerance" not in problem.given:
        problem = problem.replaced(tolerance=WITHIN * float(problem.place.size))
    problem.check_at_place()
    return problem


def _run(session: _Session, log: str | os.PathLike[str] | None) -> SteeringDrive:
    """Run a drive with a new log."""
    session.log = None if log is None else SteeringLog(log)
    try:
        return session.run()
    finally:
        if session.log is not None:
            session.log.close()


def follow(
    problem: SteeringProblem,
    rig: Any,
    waypoints: ArrayLike,
    *,
    particle: int = 1,
    seed: int = 0,
    log: str | os.PathLike[str] | None = None,
    on_move: Callable[[int, float], None] | None = None,
) -> SteeringDrive:
    """Lead one particle of a rig along way-points, in a closed loop.

    Between two way-points, the particle follows the shortest path, in strides that a look
    corrects. All other particles receive the same inputs.

    Parameters
    ----------
    problem : SteeringProblem
        Workspace, number of particles and tolerance of the way-points (2 % of the size unless
        given).
    rig : SteeringRig
    waypoints : array_like of float, shape (n, 2)
    particle : int
        Number of the particle, from 1, in the order of ``problem.start`` or of the first look.
    seed, log, on_move
        As for `steer_rig`.

    Returns
    -------
    SteeringDrive
        Its arrays hold the followed particle only, and ``goal`` is the last way-point. The status
        ``arrived`` means that looks have shown the particle at all way-points in turn. ``estimates``
        also holds ``waypoints_reached``, and ``largest_deviation`` from the path.

    Raises
    ------
    InvalidInputError, SteeringDriveError, OutputError
        As for `steer_rig`, and for way-points outside the workspace.
    """
    check_function(on_move, what="on_move")
    problem = _check_drive(problem, rig)
    check_integer(particle, what="particle", least=1, most=problem.n_particles)
    points = check_points(waypoints, what="waypoints", dimensions=2)
    if not len(points):
        raise InvalidInputError("waypoints: expected one way-point or more, got none")
    common = (problem, rig, check_integer(seed, what="seed", least=0), None, on_move)
    path = _Path(*common, waypoints=points, particle=particle - 1)
    path.space.check_inside(points, what="waypoints")
    return _run(path, log)


class _Ended(Exception):  # noqa: N818
    """Raised inside a loop when it ends."""

    def __init__(self, status: Status, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, reason


class _Session(ABC):
    """What all drives do: look, follow the particles, send inputs, learn, and log."""

    def __init__(
        self,
        problem: SteeringProblem,
        rig: Any,
        seed: int,
        log: SteeringLog | None,
        on_move: Callable[[int, float], None] | None,
    ) -> None:
        self.problem, self.rig, self.log, self.on_move = problem, rig, log, on_move
        place, radius = problem.place, problem.particle_radius
        if radius and isinstance(place, Region):
            raise InvalidInputError(
                "particle radius: expected 0 in a region with obstacles, whose walls are where the"
                " centres of the particles stop"
            )
        self.space = place.inset(radius, what="particle radius") if radius else place
        self.size = float(place.size)
        self.world = (RegionWorld if isinstance(place, Region) else ContactWorld)(self.space)
        self.kernel_world = world_of(self.world)._replace(flat=not self.space.round)
        self.count = problem.n_particles
        self.rng = np.random.default_rng([seed, 6])
        least = problem.friction_at_least
        stated = problem.given & {"friction", "friction_at_least"}
        self.friction = FrictionEstimate(
            problem.friction if least is None else least, LESS if stated else UNKNOWN
        )
        self.gains, self.faults, self.deviation = GainEstimate(self.count), FaultEstimate(), 0.0
        self.goal = np.ascontiguousarray(problem.endpoints(seed)[1])
        self.inputs: list[Points] = []
        self.seen: list[Points] = []
        self.still, self.begun = 0, perf_counter()
        self.doubtful = 0  # the last move after which the order of the particles is in doubt

    def run(self) -> SteeringDrive:
        """Run the loop until it ends."""
        status, reason = Status.INTERRUPTED, "the user stopped the drive"
        try:
            self._begin()
            while True:
                self._send(self._next_move())
        except _Ended as ended:
            status, reason = ended.status, ended.reason
        except RigError as error:
            if not self.seen:
                raise
            raise SteeringDriveError(str(error), self._result(Status.ALARM, str(error))) from error
        return self._result(status, reason)

    @abstractmethod
    def _next_move(self) -> Points:
        """Return the next input, or raise _Ended."""

    def _result(self, status: Status, reason: str) -> SteeringDrive:
        slow = np.abs(self.gains.mean[:, 0] + 1j * self.gains.mean[:, 1])
        if self.gains.moves and slow.max() < SLOW_GAIN and status is not Status.ALARM:
            reason += f"; the particles move only by {slow.mean():.2g} of the inputs"
        if self.friction.slips:
            is_stated = self.problem.given & {"friction", "friction_at_least"}
            stated = (
                f"the stated friction was at least {self.friction.stated:g}"
                if is_stated and self.friction.stated < inf
                else "no friction was stated, which means that nothing slips"
            )
            reason += (
                "; the walls slip more than was stated: a coefficient of friction of about"
                f" {self.friction.best:g} agrees with the moves, and {stated}"
            )
        if self.friction.holds:
            reason += (
                "; the walls hold more than was stated: a coefficient of friction of at least"
                f" {self.friction.quantile(0.05):g} agrees with the moves, and the stated friction"
                f" was at least {self.friction.stated:g}"
            )
        gains = self.gains.mean[:, 0] + 1j * self.gains.mean[:, 1]
        quantiles = [self.friction.quantile(share) for share in (0.5, 0.05, 0.95)]
        median, low, high = (None if value > 1e8 else value for value in quantiles)
        result = SteeringDrive(
            self.problem,
            status,
            reason,
            np.array(self.inputs).reshape(-1, 2),
            np.array(self.seen),
            self.goal,
            {
                "friction": median if self.friction.contacts else None,
                "friction_low": low,
                "friction_high": high,
                "slips": self.friction.slips,
                "holds": self.friction.holds,
                "gain": np.abs(gains).tolist(),
                "angle": np.degrees(np.angle(gains)).tolist(),
                "look_error": self.deviation,
            },
            perf_counter() - self.begun,
        )
        if self.log is not None:
            self.log.write(end=str(status), reason=reason, estimates=result.estimates)
        return result

    def _begin(self) -> None:
        """Look a few times, and find out which particle is which."""
        looks = [self._look(None) for _ in range(LOOKS)]
        first = looks[0]
        if not isinstance(self.problem.start, str):
            first = _match(first, self.problem.start)
        looks = [_match(points, first) for points in looks]
        self.deviation = max(float(np.std(looks, axis=0).mean()) * 1.2, self.problem.measurement)
        if np.ptp(looks, axis=0).max() == 0.0:  # the same picture, which tells nothing
            self.deviation = self.problem.measurement or SAME * self.size
        self.seen.append(np.mean(looks, axis=0))
        outside = ~self.space.contains(self.seen[0])
        for point in self.seen[0][outside]:
            inside = _project_inside(self.space, point[None])[0]
            if float(np.linalg.norm(inside - point)) > max(0.05 * self.size, 6 * self.deviation):
                x, y = point.round(4).tolist()
                raise InvalidInputError(
                    "the first look: expected particles inside the workspace, got one at"
                    f" ({x:g}, {y:g}); is the camera calibrated in the unit of the problem?"
                )
        if self.log is not None:
            self.log.write(
                log="shoal steering",
                problem=json.loads(self.problem.canonical()),
                rig=str(getattr(self.rig, "name", type(self.rig).__name__)),
                seen=self.seen[0].tolist(),
            )

    def _look(self, expected: Points | None) -> Points:
        """Return the positions of all particles. Particles that are not seen, or not told apart
        from others, are looked for again.
        """
        for _ in range(AGAIN):
            seen = self.rig.look()
            points = np.asarray(getattr(seen, "points", seen), dtype=np.float64)
            if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
                raise RigError(
                    "look: expected finite positions of shape (particles, 2), got shape"
                    f" {points.shape}"
                )
            if len(points) == self.count:
                return points if expected is None else self._identify(points, expected)
            if len(points) > self.count and expected is not None:  # the others are ghosts
                return _match(points, expected)
        raise _Ended(
            Status.ALARM,
            f"{AGAIN} looks in a row did not show {self.count} particles; the last showed {len(points)}",
        )

    def _identify(self, points: Points, expected: Points) -> Points:
        """Return the points in the order of the particles.

        That is the order of the rig, which may know the particles from each other, unless another
        order explains the look clearly better. Where it does not, as after two particles have been
        at one place, the order is in doubt.
        """
        orders = [points, _match(points, expected), points[::-1]]
        unchanged, matched, swapped = (
            float(np.linalg.norm(order - expected, axis=1).max()) for order in orders
        )
        apart = ALIKE * self.size + 6 * self.deviation
        if unchanged > 3 * matched + apart:
            return orders[1]
        if self.count == 2 and swapped <= 3 * unchanged + apart:
            self.doubtful = len(self.inputs)
        return points

    @property
    def state(self) -> Points:
        """Where the particles are, as far as is known: inside, and on a wall if they are near."""
        points = self.seen[-1].copy()
        outside = ~self.space.contains(points)
        if outside.any():
            points[outside] = _project_inside(self.space, points[outside])
        near, normal = max(2 * self.deviation, NEAR * self.size), np.zeros(2)
        for p in range(self.count):
            if kernels.nearest_wall(points[p], self.kernel_world, normal) <= near:
                points[p] = _foot(self.space, points[p])
        return np.ascontiguousarray(points)

    @property
    def error(self) -> float:
        """Largest observed distance of a particle from its goal."""
        return float(np.linalg.norm(self.seen[-1] - self.goal, axis=1).max())

    def _predict(self, state: Points, move: Points) -> None:
        """Move particles in place as the loop expects it."""
        spare, vector = np.empty(2), np.empty(2)
        believed = kernels.with_friction(self.kernel_world, self.friction.best)
        for point, gain in zip(state, self.gains.mean, strict=True):
            kernels.send_to(point, *move.tolist(), gain, believed, vector, spare)

    def _send(self, move: Points) -> None:
        """Send an input, look, and learn."""
        before = self.state
        move = np.ascontiguousarray(move, dtype=np.float64)
        self.rig.send(move.copy())
        self.inputs.append(move)
        expected = before.copy()
        self._predict(expected, move)
        seen = self._look(expected)
        self.seen.append(seen)
        after, normal = self.state, np.zeros(2)
        near = max(4 * self.deviation, 2 * NEAR * self.size)
        free = np.array(
            [
                kernels.nearest_wall(before[p], self.kernel_world, normal) > near
                and kernels.nearest_wall(after[p], self.kernel_world, normal) > near
                for p in range(self.count)
            ]
        )
        self.faults.learn(
            before, move, seen, self.gains.mean, self.kernel_world, error=self.deviation
        )
        self.gains.learn(move, seen - self.seen[-2], free, self.deviation)
        if not free.all() and self.count == 2:
            self.friction.learn(
                before,
                move,
                seen,
                self.gains.mean,
                self.kernel_world,
                error=self.deviation,
                deviation=min(self.gains.deviation, 0.1),
            )
        moved = np.linalg.norm(seen - self.seen[-2], axis=1).max()
        should = np.linalg.norm(expected - before, axis=1).max()
        if should > 8 * self.deviation + 0.01 * self.size:
            self.still = self.still + 1 if moved < 0.2 * should else 0
        if self.log is not None:
            self.log.write(input=move.tolist(), seen=seen.tolist())
        if self.on_move is not None:
            self.on_move(len(self.inputs), self.error)
        if self.still >= STILL:
            same = all(np.array_equal(seen, look) for look in self.seen[-STILL:])
            why = (
                "and all looks show exactly the same: the camera is frozen, or"
                if same
                else "which the looks still show anew:"
            )
            raise _Ended(
                Status.ALARM,
                f"no particle followed the last {STILL} inputs, {why} the field is off",
            )
        if self.faults.named:
            raise _Ended(Status.ALARM, f"after {len(self.inputs)} moves: {self.faults.named}")


MOVE, TOUCH, PRESS, RAW = range(4)


class _Step(NamedTuple):
    """What a move of a plan is for: to bring the middle of the particles to a point, a particle to
    a point behind a wall, the difference of the particles to a value while a wall holds one of them,
    or the move itself.
    """

    kind: int
    held: int
    target: Points


class _Loop(_Session):
    """One run of the closed loop of the policy robust."""

    planless = progress = 0
    least_missing = shortest = inf  # length of the shortest plan so far
    leads = False  # whether the steps lead to the goals
    chosen: PressingSearch | None = None  # the search of the last plan

    def __init__(self, *common: Any) -> None:
        super().__init__(*common)
        self.steps: list[_Step] = []  # what is left of the plan
        self._tables: dict[tuple[float, ...], kernels.Values] = {}

    def _choose_goals(self) -> None:
        """Choose the order of interchangeable goals with the shorter plan."""
        orders = [np.ascontiguousarray(self.goal[list(order)]) for order in permutations(range(2))]
        counts = []
        for self.goal in orders:
            self.shortest = inf
            self._plan()
            counts.append(self.shortest)
        self.shortest = inf
        self.goal = orders[int(np.argmin(counts))]

    def _check_end(self) -> None:
        tolerance, moves = self.problem.tolerance, len(self.inputs)
        if self.error <= tolerance:
            # of many looks, one that errs would end the drive: others must show the same
            looks = [self.seen[-1], *(self._look(self.seen[-1]) for _ in range(LOOKS))]
            self.seen[-1] = np.median(looks, axis=0)
        if self.error <= max(tolerance - 2.5 * self.deviation, 0.5 * tolerance):
            text = f"after {moves} moves looks show all particles within {self.error:.3g} of their goals"
            if self.doubtful and not self.problem.interchangeable:
                text += (
                    f"; at move {self.doubtful} they were so near to each other that only a rig that"
                    " knows them from each other tells which is which"
                )
            raise _Ended(Status.ARRIVED, text)
        slips = self.friction.slips
        text = f"after {moves} moves the particles are {self.error:.3g} from their goals"
        if moves >= self.problem.max_moves:
            text += ": another drive goes on from here, or more moves (max_moves) in one"
            raise _Ended(Status.SLIPPING if slips else Status.LIMIT, text)
        if self.friction.contacts and not self.faults.raised:
            proof = self._why_unreachable()
            if proof is not None:
                raise _Ended(Status.UNREACHABLE, f"{text}: {proof}")
        missing = float(
            np.hypot(*kernels.missing_change(self.state, self.goal, self._pressing(1.0)))
        )
        missing += 0.1 * self.error
        if missing < 0.95 * self.least_missing:
            self.least_missing, self.progress = missing, moves
        if self.chosen is not None:
            # by one table, because what was learnt since may have made the way longer
            moves_left = np.array([self.chosen.moves_left(seen, self.goal) for seen in self.seen])
            self.progress = max(self.progress, int(np.argmax(moves_left <= moves_left.min() + 0.5)))
        if moves - self.progress > PATIENCE or self.planless > NO_PLAN:
            if self.planless:
                why = (
                    "no plan was found; rougher walls, other goals or a larger tolerance would help,"
                    " or another start, because walls bring particles together more easily than apart"
                )
            else:
                why = (
                    f"{PATIENCE} moves brought no progress; another drive may go on from here, above"
                    " all if its friction_at_least is what the walls surely have, and smaller errors"
                    " of the inputs would help"
                )
            raise _Ended(Status.SLIPPING if slips else Status.STALLED, f"{text}: {why}")

    def _why_unreachable(self) -> str | None:
        """Return why no plan exists with the largest credible friction, or None."""
        if isinstance(self.space, Region) or not self.friction.contacts:
            return None
        state, most = self.state, STEP * self.friction.quantile(SURE)
        return friction_limit(
            self.space,
            most if most < 1e8 else inf,
            state[1] - state[0],
            self.goal[1] - self.goal[0],
            near=2 * self.problem.tolerance + 4 * self.deviation,
        )

    def _pressing(self, friction: float) -> Any:
        gain = float(np.hypot(GAIN, min(self.gains.deviation, 0.1)))
        bounds = Bounds(friction, ANGLE, gain)
        own = pressing_of(
            bounds,
            self.size,
            certain=1.5,
            gains=self.gains.mean,
            apart=2.1 * self.problem.particle_radius,
        )
        over = max(own.over, 3 * self.deviation)
        return own._replace(
            over=min(over, 0.02 * self.size) if self.deviation < 5e-3 * self.size else over,
            off=max(0.01 * self.size, 4 * self.deviation),
            near=max(3 * self.deviation, 1.5 * NEAR * self.size),
        )

    def _plan(self) -> Points | None:
        """Return the next moves, or None if nothing leads to the goals.

        They are the rest of the last plan, with inputs computed anew, or the plan with the fewest
        moves; or the manoeuvre after which the fewest moves are left, where a plan would have to
        press so often that its errors add up.
        """
        state = self.state
        levels: list[tuple[float, PressingSearch]] = []
        for share in LEVELS:
            friction = self.friction.quantile(share)
            if any(friction == level for level, _ in levels):
                continue
            pressing = self._pressing(min(tan(atan(friction) * 0.97), STEEPEST))
            search = PressingSearch(self.world, pressing, self.rng, self._tables)
            levels.append((friction, search))
        direct = levels[0][1].translation(state, self.goal, 0.6 * self.problem.tolerance)
        if direct is not None:
            self.leads = True
            return direct
        first, least = 0, inf
        for k, (friction, search) in enumerate(levels):
            # with more friction than there is, presses must be made again, or end elsewhere
            often = self.friction.least(friction) ** 2
            if kernels.CYCLE / often < OFTEN * least:  # else no table needs to be made
                cost = search.moves_left(state, self.goal) / often
                if cost < OFTEN * least:
                    first, least = k, cost
        levels.insert(0, levels.pop(first))
        for rounds in (FAST, SLOW):
            for _, search in levels:
                self.chosen = search
                continuation = self._continuation(search.pressing) if self.leads else None
                if continuation is not None and len(continuation) <= FEW:
                    return continuation
                moves_left = search.moves_left(state, self.goal)
                if moves_left >= kernels.MOST_LEFT - 1:
                    continue
                if rounds == FAST and moves_left > LONG and not isinstance(self.space, Region):
                    moves = self._manoeuvre(search)
                    if len(moves):
                        return moves
                plans = search.plans(
                    state,
                    self.goal,
                    tolerance=0.6 * self.problem.tolerance,
                    moves=min(self.problem.max_moves - len(self.inputs), 40),
                    rounds=rounds,
                    most=WANTED,
                    shorter=True,
                )
                if plans:
                    best = self._surest(search, plans)
                    self._note_progress(len(best))
                    self.leads = True
                    return (
                        best
                        if continuation is None or len(best) < len(continuation) - 1
                        else continuation
                    )
                if continuation is not None:
                    return continuation
                moves = self._manoeuvre(search)
                if len(moves):
                    return moves
        return None

    def _manoeuvre(self, search: PressingSearch) -> Points:
        """Return the moves of the manoeuvre after which the fewest moves are left."""
        begun = None if self.leads else self._replay_steps(search.pressing)[0]
        moves, moves_left = search.best_manoeuvre(
            self.state, self.goal, self.problem.tolerance, self._scenarios(search), begun
        )
        if len(moves):
            self.leads = False
            self._note_progress(moves_left)
        return moves

    def _scenarios(self, search: PressingSearch) -> tuple[Points, Points, Points]:
        """Draw errors of moves, gains and frictions as likely as they are."""
        rng = np.random.default_rng(len(self.inputs))
        bounds = Bounds(search.pressing.friction, ANGLE, GAIN)
        turns, _, _ = bounds.scenarios(SCENARIOS, kernels.STEPS, rng)
        frictions = rng.choice(self.friction.values, SCENARIOS, p=self.friction.shares)
        return turns, self.gains.draw(SCENARIOS, rng), frictions

    def _note_progress(self, moves_left: float) -> None:
        """Remember how few moves were left at least."""
        if moves_left < self.shortest - 0.5:
            self.shortest, self.progress = moves_left, len(self.inputs)

    def _continuation(self, pressing: Any) -> Points | None:
        """Return the rest of the last plan from here, or None if it no longer leads to the goals."""
        if not self.steps:
            return None
        moves, state = self._replay_steps(pressing)
        error = float(np.linalg.norm(state - self.goal, axis=1).max())
        return moves if error <= 0.8 * self.problem.tolerance else None

    def _replay_steps(self, pressing: Any) -> tuple[Points, Points]:
        """Return the moves of the steps that are left, from here, and where they lead."""
        state, moves = self.state, []
        world = kernels.with_friction(self.kernel_world, pressing.friction)
        last_press = max((k for k, step in enumerate(self.steps) if step.kind == PRESS), default=-1)
        spare, vector = np.empty(2), np.empty(2)
        for k, step in enumerate(self.steps):
            final = self.leads and k == len(self.steps) - 1
            move = self._move_of(step, state, self.leads and k == last_press, final)
            kernels.send_both(state, *move.tolist(), self.gains.mean, world, vector, spare)
            moves.append(move)
        return np.array(moves).reshape(-1, 2), state

    def _move_of(self, step: _Step, state: Points, last_press: bool, final: bool) -> Points:
        """Return the input that leads from a state to the target of a step."""
        gains = self.gains.mean[:, 0] + 1j * self.gains.mean[:, 1]
        if step.kind == MOVE and final:
            return np.array(kernels.to_goal(state, self.goal, self._pressing(1.0)))
        if step.kind == MOVE:
            displacement, gain = step.target - state.mean(axis=0), gains.mean()
        elif step.kind == TOUCH:
            displacement, gain = step.target - state[step.held], gains[step.held]
        elif step.kind == PRESS:
            sign = 1.0 if step.held == 0 else -1.0
            change = step.target - (state[1] - state[0])
            if last_press:
                change = np.array(kernels.missing_change(state, self.goal, self._pressing(1.0)))
            displacement, gain = sign * change, gains[1 - step.held]
        else:
            return step.target
        sent = complex(*displacement) / gain
        return np.array([sent.real, sent.imag])

    def _steps_of(self, plan: Points) -> list[_Step]:
        """Return what each move of a plan is for, so that later it can be computed anew."""
        state, steps = self.state, []
        spare, vector = np.empty(2), np.empty(2)
        gains = self.gains.mean[:, 0] + 1j * self.gains.mean[:, 1]
        for move in plan:
            before = state.copy()
            kernels.send_both(
                state, *move.tolist(), self.gains.mean, self.kernel_world, vector, spare
            )
            free = gains * complex(*move)
            fractions = np.linalg.norm(state - before, axis=1) / np.maximum(np.abs(free), 1e-300)
            held = int(np.argmin(fractions))
            if fractions[held] > 1 - 1e-6:
                steps.append(_Step(MOVE, 0, state.mean(axis=0)))
            elif fractions[1 - held] < 1 - 1e-6:  # a wall stops the other particle, too
                steps.append(_Step(RAW, held, np.array(move)))
            elif fractions[held] < 1e-3:
                steps.append(_Step(PRESS, held, state[1] - state[0]))
            else:
                aim = before[held] + np.array([free[held].real, free[held].imag])
                steps.append(_Step(TOUCH, held, aim))
        return steps

    def _surest(self, search: PressingSearch, plans: list[Points]) -> Points:
        """Return a plan with few moves, which often ends at the goals in spite of errors."""
        state, values = self.state, search.values(self.goal)
        scenarios, costs = self._scenarios(search), []
        for plan in plans:
            soon = plan[:SOON]
            ends = search.ends(state, soon, scenarios)
            exact = search.ends(state, soon, self._without_errors(search))
            more = kernels.mean_moves_left(ends, values) - kernels.mean_moves_left(exact, values)
            # the shorter way ahead, so that the loop does not turn from one wall to another
            costs.append(len(plan) + path_length(plan) / self.size + more)
        return plans[int(np.argmin(costs))]

    def _without_errors(self, search: PressingSearch) -> tuple[Points, Points, Points]:
        """Return the scenario in which the search has found its plans."""
        turns = np.tile([1.0, 0.0], (1, kernels.STEPS, 1))
        return turns, self.gains.mean[None].copy(), np.array([float(search.pressing.friction)])

    def _limit_move(self, move: Points) -> Points:
        """Return a shorter input where the error of a long one could not be taken back.

        Before the gains are known, no particle shall touch a wall.

        A wall can only bring the particles nearer to each other in its direction, and with little
        friction nothing else brings them apart again. A long press therefore ends before the
        difference wanted, and the next one is short. With little friction, so does a long move to a
        wall, behind which it would press.
        """
        before, after = self.state, self.state
        self._predict(after, move)
        free = np.hypot(*self.gains.mean.T) * float(np.hypot(*move))
        fractions = np.linalg.norm(after - before, axis=1) / np.maximum(free, 1e-300)
        held = int(np.argmin(fractions))
        if self.gains.deviation > UNSURE:
            return self._free_move(move)
        share = (
            CAREFUL * float(np.hypot(ANGLE, GAIN)) * max(self.gains.deviation / GAIN, 1.0) ** 0.5
        )
        length = float(free.max())
        if fractions[1 - held] < 1 - 1e-6 or fractions[held] > 1 - 1e-6:
            return move  # a translation, or both meet walls
        if share * length < 0.5 * self.problem.tolerance:
            return move
        if fractions[held] < 1e-3:
            return np.asarray(move * max(1 - 1.5 * share, 0.5))
        if self.friction.quantile(0.8) < SLIPPERY:
            return np.asarray(move * max(fractions[held] - 1.5 * share, 0.3 * fractions[held]))
        return move

    def _free_move(self, move: Points) -> Points:
        """Return an input that shows the gains, because both particles are free all the while."""
        low, high = self.space.bounds
        inward = (np.asarray(low) + high) / 2 - self.state.mean(axis=0)
        for direction in (move, inward):
            share = kernels.free_share(
                self.state, *direction.tolist(), self._pressing(1.0), self.kernel_world
            )
            short = np.asarray(direction * 0.7 * share)  # a gain may be larger than assumed
            if float(np.hypot(*short)) > 0.05 * self.size:
                return short
        return move

    def _next_move(self) -> Points:
        if not self.inputs and self.problem.interchangeable:
            self._choose_goals()
        self._check_end()
        plan = self._plan()
        if plan is not None and len(plan):
            self.planless = 0
            self.steps = self._steps_of(plan)
            move = self._limit_move(plan[0])
            if move is plan[0] or np.array_equal(move, plan[0]):
                del self.steps[0]  # else the next input goes on to the same target
            return move
        self.steps = []
        # another state may have a plan, and the move shows more of the walls
        self.planless += 1
        low, high = self.space.bounds
        towards = (np.asarray(low) + high) / 2 - self.state.mean(axis=0)
        return np.asarray(0.5 * towards + self.rng.normal(scale=0.1 * self.size, size=2))


class _Path(_Session):
    """One particle on its way along way-points."""

    def __init__(self, *common: Any, waypoints: Points, particle: int) -> None:
        super().__init__(*common)
        self.waypoints, self.particle, self.reached = waypoints, particle, 0
        self.goal = np.tile(waypoints[-1], (self.count, 1))
        self.corners: list[Points] = []  # of the path to the next way-point
        self.deviation_most, self._leg = 0.0, (waypoints[0], waypoints[0])

    @property
    def error(self) -> float:
        """Observed distance of the particle from the last way-point."""
        return float(np.linalg.norm(self.seen[-1][self.particle] - self.waypoints[-1]))

    def _result(self, status: Status, reason: str) -> SteeringDrive:
        self.count, only = 1, slice(self.particle, self.particle + 1)
        self.seen, self.goal = [seen[only] for seen in self.seen], self.waypoints[-1:]
        result = super()._result(status, reason)
        result.estimates.update(
            waypoints_reached=self.reached, largest_deviation=self.deviation_most
        )
        return result

    def _next_move(self) -> Points:
        position, tolerance = self.seen[-1][self.particle], self.problem.tolerance
        if self.inputs:
            self.deviation_most = max(self.deviation_most, _distance(position, *self._leg))
        while self.corners and float(np.linalg.norm(self.corners[0] - position)) <= tolerance:
            del self.corners[0]
            if not self.corners:
                self.reached += 1
                self._leg = (self.waypoints[self.reached - 1],) * 2
        if self.reached == len(self.waypoints):
            raise _Ended(
                Status.ARRIVED,
                f"after {len(self.inputs)} moves looks have shown the particle within"
                f" {tolerance:.3g} of all {self.reached} way-points, and at most"
                f" {self.deviation_most:.3g} beside the path",
            )
        if len(self.inputs) >= self.problem.max_moves:
            raise _Ended(
                Status.LIMIT,
                f"after {len(self.inputs)} moves the particle has reached {self.reached} of"
                f" {len(self.waypoints)} way-points",
            )
        if not self.corners:
            self.corners = self._shortest_path(position, self.waypoints[self.reached])
            self._leg = (position, self.corners[0])
        elif not np.array_equal(self._leg[1], self.corners[0]):
            self._leg = (self._leg[1], self.corners[0])
        displacement = self.corners[0] - position
        length = float(np.hypot(*displacement))
        displacement = displacement * min(1.0, STRIDE * self.size / length)
        re, im = self.gains.mean[self.particle]
        x, y = displacement / (re * re + im * im)
        return np.array([re * x + im * y, re * y - im * x])

    def _shortest_path(self, position: Points, waypoint: Points) -> list[Points]:
        """Return the corners of the shortest path to a way-point."""
        if not isinstance(self.space, Region):
            return [waypoint]
        task = SteeringTask(self.world, position[None], waypoint[None], self.problem.tolerance)
        for margin in PATH_MARGINS:
            free = free_offsets(self.space, waypoint[None], margin * self.size)
            path = None if free is None else free.path(position - waypoint, task)
            if path is not None:
                corners = [corner + waypoint for corner in path]
                return [
                    *(
                        corner
                        for corner in corners
                        if float(np.hypot(*(corner - position))) > 1e-3 * self.size
                    ),
                    waypoint,
                ]
        x, y = waypoint.tolist()
        raise _Ended(Status.UNREACHABLE, f"no free path leads to the way-point ({x:g}, {y:g})")


def _match(points: Points, expected: Points) -> Points:
    """Return as many of the points as expected, each the nearest to where it is expected."""
    from scipy.optimize import linear_sum_assignment

    away = np.linalg.norm(points[None] - expected[:, None], axis=2)
    _, columns = linear_sum_assignment(away**2)
    return np.asarray(points[columns])


def _foot(space: Any, point: Points) -> Points:
    """Return the nearest point of the walls."""
    if space.round:
        away = point - space.center
        return np.asarray(
            space.center + away * (space.radius / max(float(np.hypot(*away)), 1e-300))
        )
    import shapely

    line = shapely.shortest_line(space.shape.boundary, shapely.Point(point))
    return np.array(line.coords[0])


def _distance(point: Points, begin: Points, end: Points) -> float:
    """Return the distance of a point from a straight line between two points."""
    along, offset = end - begin, point - begin
    square = float(along @ along)
    share = min(max(float(offset @ along) / square, 0.0), 1.0) if square > 0 else 0.0
    return float(np.linalg.norm(offset - share * along))
