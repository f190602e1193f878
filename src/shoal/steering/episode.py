"""SteeringEpisode: a problem, the inputs that were sent, and where the particles went."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import FARTHEST, check_choice, check_integer, check_number, check_text, parse_json, read_text, shortened
from shoal.core.dataclass import dataclass
from shoal.core.episode import Episode, Status, Verification
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.core.files import write_json
from shoal.steering.problem import SteeringProblem
from shoal.steering.simulation.apparatus import condition, replay
from shoal.steering.workspaces.convex import TOUCH
from shoal.steering.workspaces.convex_geometry import Points

STATUSES = (Status.SOLVED, Status.APPROACHABLE, Status.UNREACHABLE, Status.LIMIT)
_STORED = (
    "kind", "problem", "planner", "status", "reason", "inputs", "states", "order", "seed", "lower_bound", "seconds", "versions",
)  # fmt: skip
_EQUAL = 1e-9  # of the size: states that differ by less are the same


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SteeringEpisode(Episode):
    """Everything that is needed to play a plan again, and its figures.

    ``bool(episode)`` says if the problem is solved.

    Parameters
    ----------
    problem : SteeringProblem
        As it was asked for.
    planner : str
        The planner that planned: what was asked for, or what ``auto`` chose.
    status : Status
        ``solved``: all particles are within the tolerance of their goals. ``approachable``: they are not, and the
        goal itself cannot be reached, only what is near to it; ``error`` says how near the plan comes. ``unreachable``: no plan
        exists. ``limit``: none was found.
    reason : str
        Why the status is what it is, in one sentence.
    inputs : ndarray of float64, shape (moves, d)
        The moves that were sent.
    states : ndarray of float64, shape (moves + 1, n, d)
        At the start and after each move.
    order : ndarray of int64, shape (n,)
        Which goal each particle went to.
    seed : int
    lower_bound : float or None
        No plan that ends within the tolerance is shorter; None where none is known.
    seconds : float
        Time for planning, without what goes by compiling and loading kernels; in a closed loop for all of it.
    versions : dict
        What it was computed with.
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
        """Number of moves."""
        return len(self.inputs)

    @cached_property
    def length(self) -> float:
        """Length of all moves."""
        return float(np.linalg.norm(self.inputs, axis=1).sum())

    @property
    def final(self) -> Points:
        """Where the particles end; float64, shape (n, d)."""
        return np.asarray(self.states[-1])

    @cached_property
    def goal(self) -> Points:
        """The goal of each particle, in the order of the particles; float64, shape (n, d)."""
        return np.asarray(self.problem.endpoints(self.seed)[1][self.order])

    @cached_property
    def error(self) -> float:
        """The largest distance of a particle to its goal at the end."""
        return float(np.linalg.norm(self.final - self.goal, axis=1).max())

    @cached_property
    def condition(self) -> float:
        """How many times as large the error at the end is as one of the start, or as the tolerance of contacts, 1e-9 of the size.

        Of a few to some hundreds for most plans. If it times that tolerance is more than that of the goals, the plan is sensitive:
        it holds only in this arithmetic.
        """
        return condition(self.problem, self.inputs, seed=self.seed)

    @property
    def sensitive(self) -> bool:
        """Whether an error as small as the tolerance of contacts would miss a goal."""
        return bool(self.condition * TOUCH * self.problem.place.size > self.problem.tolerance)

    @property
    def metrics(self) -> dict[str, Any]:
        """The numbers by name."""
        return {
            "status": str(self.status), "moves": self.moves, "length": self.length, "error": self.error,
            "lower_bound": self.lower_bound, "condition": self.condition, "planner": self.planner, "seconds": self.seconds,
        }  # fmt: skip

    def report(self) -> dict[str, Any]:
        """Return the JSON object of ``shoal steer``."""
        return {
            "status": str(self.status), "reason": self.reason, "planner": self.planner, "moves": self.moves,
            "length": self.length, "inputs": self.inputs.tolist(), "final": self.final.tolist(), "error": self.error,
            "lower_bound": self.lower_bound, "condition": self.condition, "sensitive": self.sensitive,
            "order": (self.order + 1).tolist(), "seed": self.seed, "seconds": self.seconds,
        }  # fmt: skip

    def verify(self) -> Verification:
        """Play the inputs again; compare where the particles go, and whether the status fits that."""
        near = _EQUAL * self.problem.place.size
        try:
            states = replay(self.problem, self.inputs, seed=self.seed)
        except ShoalError as error:  # particles that do not fit where the episode puts them
            return Verification(False, str(error))
        if states.shape != self.states.shape:
            return Verification(False, f"expected states of shape {states.shape}, got {self.states.shape}")
        away = np.linalg.norm(states - self.states, axis=2)
        if not away.max() <= near:
            move = int(np.argmax(~(away.max(axis=1) <= near)))
            particle = int(np.argmax(away[move]))
            return Verification(
                False, f"after move {move} particle {particle + 1} is {away[move, particle]:.3g} from where the episode says"
            )
        reached = self.error <= self.problem.tolerance
        if self.status == Status.SOLVED and not reached:
            far = f"a particle ends {self.error:.3g} from its goal, tolerance {self.problem.tolerance:g}"
            return Verification(False, f"it says solved, and {far}")
        # With noise a planner sees only roughly where the particles are, and may not know that it has reached the goal.
        if self.status in (Status.LIMIT, Status.UNREACHABLE) and reached and not self.problem.noisy:
            return Verification(False, f"it says {self.status}, and all particles end within the tolerance of their goals")
        return Verification(True, "played again, all particles go where the episode says")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the episode as JSON; a workspace that was read from a file goes with it.

        Raises
        ------
        InvalidInputError
            If the suffix is not .json.
        OutputError
        """
        target = Path(path)
        if target.suffix != ".json":
            raise InvalidInputError(f"{target}: expected the suffix .json, got {target.suffix!r}")
        problem = self.problem
        if problem.place_is_file():
            problem = problem.replaced(workspace=problem.place)
        made = {
            "kind": self.part, "problem": problem.to_dict(), "status": str(self.status), "inputs": self.inputs.tolist(),
            "states": self.states.tolist(), "order": self.order.tolist(), "versions": dict(self.versions),
        }  # fmt: skip
        data = {name: made[name] if name in made else getattr(self, name) for name in _STORED}
        write_json(target, data, indent=None)

    @classmethod
    def load(cls, path: str | os.PathLike[str], *, trust: bool = False) -> SteeringEpisode:
        """Read an episode; its planner is not run.

        Raises
        ------
        InvalidInputError
        """
        where = os.fspath(path)
        data = parse_json(read_text(Path(path), what="steering episode"), where=where)
        if not isinstance(data, dict) or set(data) != set(_STORED) or data["kind"] != cls.part:
            raise InvalidInputError(
                f"{where}: not a steering episode: expected the fields {', '.join(_STORED)}, got {shortened(data)}"
            )
        try:
            problem = SteeringProblem.from_dict(data["problem"])
            d = problem.place.dimensions
            inputs = _array(data["inputs"], "inputs", (None, d), empty=(0, d))
            states = _array(data["states"], "states", (len(inputs) + 1, problem.n_particles, d))
            order = _array(data["order"], "order", (problem.n_particles,))
            if sorted(order.tolist()) != list(range(problem.n_particles)):
                raise InvalidInputError(f"order: expected a goal for each particle, got {shortened(data['order'])}")
            if not isinstance(data["versions"], dict):
                raise InvalidInputError(f"versions: expected names with versions, got {shortened(data['versions'])}")
            bound = data["lower_bound"]
            return cls(
                problem=problem, inputs=inputs, states=states, order=order.astype(np.int64),
                planner=check_text(data["planner"], what="planner"),
                status=Status(check_choice(data["status"], what="status", choices=STATUSES)),
                reason=check_text(data["reason"], what="reason"),
                seed=check_integer(data["seed"], what="seed", least=0),
                lower_bound=None if bound is None else check_number(bound, what="lower_bound"),
                seconds=check_number(data["seconds"], what="seconds"), versions=data["versions"],
            )  # fmt: skip
        except InvalidInputError as error:
            raise InvalidInputError(f"{where}: {error}") from None


def _array(given: Any, what: str, shape: tuple[int | None, ...], *, empty: tuple[int, ...] = ()) -> NDArray[np.float64]:
    """Return numbers as an array of a shape, in which None stands for any length."""
    try:
        array = np.array(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        array = np.zeros(0)
    if empty and array.size == 0 and array.ndim == 1:
        array = array.reshape(empty)
    fits = array.ndim == len(shape) and all(wanted in (None, real) for wanted, real in zip(shape, array.shape, strict=True))
    if not fits or not (np.abs(array) <= FARTHEST).all():
        wanted = " x ".join("any" if length is None else str(length) for length in shape)
        raise InvalidInputError(f"{what}: expected {wanted} finite numbers, got an array of shape {array.shape}")
    return array
