"""SteeringEpisode: one run of steering with its problem, its inputs and the paths of
its particles.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import (
    FARTHEST,
    check_choice,
    check_integer,
    check_number,
    check_text,
    parse_json,
    read_text,
    shortened,
)
from shoal.core.dataclass import dataclass
from shoal.core.episode import Episode, Status, Verification
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.core.files import check_suffix, write_json
from shoal.steering.contact.clearance import why_sensitive
from shoal.steering.problem import SteeringProblem
from shoal.steering.simulation import condition, executed_moves, replay
from shoal.steering.workspaces.convex import EXACT_TOUCH, Points

STATUSES = (Status.SOLVED, Status.SENSITIVE, Status.APPROACHABLE, Status.UNREACHABLE, Status.LIMIT)
_STORED = (
    "kind",
    "problem",
    "planner",
    "status",
    "reason",
    "inputs",
    "states",
    "order",
    "seed",
    "lower_bound",
    "seconds",
    "versions",
)
_EQUAL = 1e-9  # relative to the size: states that differ by less are equal


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SteeringEpisode(Episode):
    """One run of a steering problem, with its metrics and all data for a replay of its plan.

    ``bool(episode)`` is true if all particles end within the tolerance of their goals.

    Parameters
    ----------
    problem : SteeringProblem
        The problem as the user declared it.
    planner : str
        Name of the planner that made the plan: the requested planner, or the planner that ``auto``
        chose.
    status : Status
        ``solved``: all particles are within the tolerance of their goals, and the plan stands the
        disturbances of the option ``clearance``. ``sensitive``: the plan reaches the goals, but
        only in exact arithmetic. ``approachable``: moves can come arbitrarily close to the goals
        but never reach them, and the stored plan ends outside the tolerance or is sensitive.
        ``unreachable``: a proof shows that no plan exists. ``limit``: the planner found no plan
        that ends within the tolerance, although a plan may exist.
    reason : str
        One sentence that explains the status.
    inputs : ndarray of float64, shape (moves, d)
        The moves (displacements) that were sent to all particles.
    states : ndarray of float64, shape (moves + 1, n, d)
        Positions of the particles at the start and after each move.
    order : ndarray of int64, shape (n,)
        For each particle, the index of its goal in the goals of the problem, counted from 0.
    seed : int
    lower_bound : float or None
        Lower bound on the total length of every plan that ends within the tolerance, or None if no
        lower bound is known.
    seconds : float
        Planning time in seconds, without the time for compiling and loading kernels (compiled
        functions). For closed-loop planners, ``seconds`` is the duration of the whole run.
    versions : dict
        Versions of Shoal and of the libraries that Shoal uses.
    """

    part: ClassVar[str] = "steering"

    problem: SteeringProblem
    planner: str
    status: Status
    reason: str = ""
    inputs: Points
    states: Points
    order: NDArray[np.int64]
    seed: int
    lower_bound: float | None
    seconds: float
    versions: Mapping[str, str]

    @property
    def moves(self) -> int:
        """Number of moves in the plan."""
        return len(self.inputs)

    @cached_property
    def length(self) -> float:
        """Sum of the lengths of all moves, in the workspace's unit of length."""
        return float(np.linalg.norm(self.inputs, axis=1).sum())

    @property
    def final(self) -> Points:
        """Final positions of the particles; float64, shape (n, d)."""
        return np.asarray(self.states[-1])

    @cached_property
    def goal(self) -> Points:
        """The assigned goal of each particle, in the order of the particles; float64,
        shape (n, d).
        """
        return np.asarray(self.problem.endpoints(self.seed)[1][self.order])

    @cached_property
    def error(self) -> float:
        """The largest distance between a particle's final position and its goal."""
        return float(np.linalg.norm(self.final - self.goal, axis=1).max())

    @cached_property
    def condition(self) -> float:
        """Amplification of errors: the largest ratio of an error of the final positions to the
        small error that causes it.

        The small error is a displacement of a particle's start, or a change of the contact
        tolerance. For most plans, the ratio is between a few and a few hundred.
        """
        return condition(self.problem, self.inputs, seed=self.seed)

    @cached_property
    def sensitive(self) -> bool:
        """Whether the plan reaches its goals in the simulation, but not with the disturbances of
        the option ``clearance``.

        With the clearance 0, a contact tolerance of 1e-12 of the size and turned coordinates are
        the only disturbances.
        """
        problem, clearance = self.problem, self.problem.clearance or EXACT_TOUCH
        if self.error > problem.tolerance:
            return False
        moves = executed_moves(problem, self.inputs, seed=self.seed)
        world = problem.world(seed=self.seed)
        return (
            why_sensitive(world, self.states[0], self.goal, moves, problem.tolerance, clearance)
            is not None
        )

    @property
    def metrics(self) -> dict[str, Any]:
        """The metrics of the run, by name."""
        return {
            "status": str(self.status),
            "moves": self.moves,
            "length": self.length,
            "error": self.error,
            "lower_bound": self.lower_bound,
            "condition": self.condition,
            "planner": self.planner,
            "seconds": self.seconds,
        }

    @cached_property
    def holding_share(self) -> float | None:
        """Share of 1000 simulations with the stated errors in which all particles end within the
        tolerance of their goals; None if no errors are stated, or without a plan.
        """
        if self.problem.bounds is None or not self.moves:
            return None
        from shoal.steering.planners.pressing import holding_share

        return holding_share(self._task(), self.inputs, within=self.problem.tolerance)

    @cached_property
    def unreachable_share(self) -> float | None:
        """Share of 200 random goals that provably no plan reaches from the starts with the least
        friction stated; None if no errors are stated, and with obstacles.
        """
        if self.problem.bounds is None:
            return None
        from shoal.steering.planners.pressing import unreachable_share

        return unreachable_share(self._task())

    def _task(self) -> Any:
        from shoal.steering.planners.task import SteeringTask

        problem = self.problem
        return SteeringTask(
            problem.world(gain=0.0),
            self.states[0],
            self.goal,
            problem.tolerance,
            problem.max_moves,
            self.seed,
            bounds=problem.bounds,
        )

    def report(self) -> dict[str, Any]:
        """Return the JSON object that ``shoal steer`` prints."""
        stated = self.problem.bounds is not None
        shares = {
            "tolerance": self.problem.tolerance,
            "holding_share": self.holding_share,
            "unreachable_share": self.unreachable_share,
        }
        return {
            "status": str(self.status),
            "reason": self.reason,
            "planner": self.planner,
            "moves": self.moves,
            "length": self.length,
            "inputs": self.inputs.tolist(),
            "final": self.final.tolist(),
            "error": self.error,
            "lower_bound": self.lower_bound,
            "condition": self.condition,
            "sensitive": self.sensitive,
            "order": (self.order + 1).tolist(),
            "seed": self.seed,
            "seconds": self.seconds,
        } | (shares if stated else {})

    def verify(self) -> Verification:
        """Check the episode with a replay of its inputs.

        The method compares the replayed positions with the stored positions, and checks that the
        status agrees with the positions.
        """
        near = _EQUAL * self.problem.place.size
        try:
            states = replay(self.problem, self.inputs, seed=self.seed)
        except ShoalError as error:  # invalid positions of particles in the file
            return Verification(False, str(error))
        if states.shape != self.states.shape:
            return Verification(
                False, f"expected states of shape {states.shape}, got {self.states.shape}"
            )
        away = np.linalg.norm(states - self.states, axis=2)
        if not away.max() <= near:
            move = int(np.argmax(~(away.max(axis=1) <= near)))
            particle = int(np.argmax(away[move]))
            return Verification(
                False,
                f"after move {move} particle {particle + 1} is {away[move, particle]:.3g} from its"
                " position in the episode",
            )
        reached = self.error <= self.problem.tolerance
        if self.status in (Status.SOLVED, Status.SENSITIVE) and not reached:
            far = (
                f"a particle ends {self.error:.3g} from its goal, tolerance"
                f" {self.problem.tolerance:g}"
            )
            return Verification(False, f"the status is {self.status}, and {far}")
        if (
            self.status == Status.SOLVED
            and self.problem.clearance
            and not self.problem.noisy
            and self.problem.bounds is None
            and self.sensitive
        ):
            return Verification(
                False,
                "the status is solved, and the plan reaches its goals only in exact arithmetic",
            )
        # With noise, a planner knows the positions only roughly and may not notice that it has
        # reached the goal.
        exact = not self.problem.noisy and self.problem.bounds is None
        if self.status in (Status.LIMIT, Status.UNREACHABLE) and reached and exact:
            return Verification(
                False,
                f"the status is {self.status}, and all particles end within the tolerance of their"
                " goals",
            )
        bound = self.lower_bound
        solved = self.status == Status.SOLVED
        if solved and exact and bound is not None and bound > self.length * (1 + _EQUAL):
            return Verification(
                False, f"the lower bound is {bound:g}, and the plan has the length {self.length:g}"
            )
        return Verification(True, "in the replay, all particles have the positions of the episode")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the episode as JSON.

        If the workspace was read from a file, the JSON contains the walls of the workspace instead
        of the name of the file.

        Raises
        ------
        InvalidInputError
            If the suffix is not ``.json``.
        OutputError
        """
        target = check_suffix(path, ".json")
        problem = self.problem
        if problem.place_is_file():
            problem = problem.replaced(workspace=problem.place)
        stored = {
            "kind": self.part,
            "problem": problem.to_dict(),
            "status": str(self.status),
            "inputs": self.inputs.tolist(),
            "states": self.states.tolist(),
            "order": self.order.tolist(),
            "versions": dict(self.versions),
        }
        data = {name: stored[name] if name in stored else getattr(self, name) for name in _STORED}
        write_json(target, data, indent=None)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, trust: bool = False) -> SteeringEpisode:
        """Read an episode from a JSON file, without a new run of its planner."""
        where = os.fspath(path)
        data = parse_json(read_text(Path(path), what="steering episode"), where=where)
        if not isinstance(data, dict) or set(data) != set(_STORED) or data["kind"] != cls.part:
            raise InvalidInputError(
                f"{where}: expected a steering episode with the fields {', '.join(_STORED)}, got"
                f" {shortened(data)}"
            )
        try:
            problem = SteeringProblem.from_dict(data["problem"])
            d = problem.place.dimensions
            inputs = _array(data["inputs"], "inputs", (None, d), empty=(0, d))
            states = _array(data["states"], "states", (len(inputs) + 1, problem.n_particles, d))
            order = _array(data["order"], "order", (problem.n_particles,))
            if sorted(order.tolist()) != list(range(problem.n_particles)):
                raise InvalidInputError(
                    f"order: expected a goal for each particle, got {shortened(data['order'])}"
                )
            if not isinstance(data["versions"], dict):
                raise InvalidInputError(
                    f"versions: expected names with versions, got {shortened(data['versions'])}"
                )
            bound = data["lower_bound"]
            return cls(
                problem=problem,
                inputs=inputs,
                states=states,
                order=order.astype(np.int64),
                planner=check_text(data["planner"], what="planner"),
                status=Status(check_choice(data["status"], what="status", choices=STATUSES)),
                reason=check_text(data["reason"], what="reason"),
                seed=check_integer(data["seed"], what="seed", least=0),
                lower_bound=None if bound is None else check_number(bound, what="lower_bound"),
                seconds=check_number(data["seconds"], what="seconds"),
                versions=data["versions"],
            )
        except InvalidInputError as error:
            raise InvalidInputError(f"{where}: {error}") from None


def _array(
    numbers: Any, what: str, shape: tuple[int | None, ...], *, empty: tuple[int, ...] = ()
) -> NDArray[np.float64]:
    """Return ``numbers`` as an array of the shape ``shape``, in which None stands for
    any length.
    """
    try:
        array = np.array(numbers, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        array = np.zeros(0)
    if empty and array.size == 0 and array.ndim == 1:
        array = array.reshape(empty)
    fits = array.ndim == len(shape) and all(
        expected in (None, real) for expected, real in zip(shape, array.shape, strict=True)
    )
    if not fits or not (np.abs(array) <= FARTHEST).all():
        expected = " x ".join("any" if length is None else str(length) for length in shape)
        raise InvalidInputError(
            f"{what}: expected {expected} finite numbers, got an array of shape {array.shape}"
        )
    return array
