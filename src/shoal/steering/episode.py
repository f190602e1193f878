"""SteeringEpisode: a problem, the moves that were sent, and where the particles went."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from functools import cached_property
from math import inf
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, FiniteFloat, NonNegativeFloat, NonNegativeInt, ValidationError

from shoal.errors import InvalidInputError
from shoal.files import atomic
from shoal.steering.contact.disturbances import Disturbance
from shoal.steering.problem import SteeringProblem, problem_of
from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.formats import read_json, read_text, said

FORMAT: Literal[1] = 1


class EpisodeForm(BaseModel):
    """A steering episode on disk."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal[1]
    version: str
    problem: dict[str, Any]
    planner: str
    status: Literal["solved", "approachable", "unreachable", "limit"]
    reason: str
    moves: list[list[FiniteFloat]]
    states: list[list[list[FiniteFloat]]]
    order: list[NonNegativeInt]
    friction: NonNegativeFloat | None
    radius: NonNegativeFloat
    execution: NonNegativeFloat
    measurement: NonNegativeFloat
    gain: NonNegativeFloat
    seed: NonNegativeInt
    lower_bound: FiniteFloat | None
    seconds: FiniteFloat


@dataclass(frozen=True, eq=False)
class SteeringEpisode:
    """Everything that is needed to play a plan again, and its figures. True as a bool if the problem is solved.

    Parameters
    ----------
    problem : SteeringProblem
    planner : str
    status : str
        "solved": all particles are within the tolerance of their goals. "approachable": the goal itself can not be reached, only
        what is near to it; ``error`` says how near the plan comes. "unreachable": no plan exists. "limit": none was found.
    reason : str
        Why the status is none of "solved", in one sentence; else empty.
    moves : ndarray of float64, shape (moves, d)
    states : ndarray of float64, shape (moves + 1, n, d)
        At the start and after each move.
    order : ndarray of int64, shape (n,)
        Which goal each particle went to.
    disturbance : Disturbance
        Friction, gain and noise.
    seed : int
    lower_bound : float or None
        No plan that ends within the tolerance is shorter; None where none is known.
    seconds : float
        Time for planning; in a closed loop for all of it.
    version : str
        Of Shoal.
    """

    problem: SteeringProblem
    planner: str
    status: str
    reason: str
    moves: Points
    states: Points
    order: NDArray[np.int64]
    disturbance: Disturbance
    seed: int
    lower_bound: float | None
    seconds: float
    version: str

    def __bool__(self) -> bool:
        return self.status == "solved"

    @property
    def n_moves(self) -> int:
        """Number of moves."""
        return len(self.moves)

    @cached_property
    def path_length(self) -> float:
        """Length of all moves."""
        return float(np.linalg.norm(self.moves, axis=1).sum())

    @property
    def final(self) -> Points:
        """Where the particles end; float64, shape (n, d)."""
        return np.asarray(self.states[-1])

    @property
    def goal(self) -> Points:
        """The goal of each particle, in the order of the particles; float64, shape (n, d)."""
        return np.asarray(self.problem.goal[self.order])

    @cached_property
    def error(self) -> float:
        """The largest distance of a particle to its goal at the end."""
        return float(np.linalg.norm(self.final - self.goal, axis=1).max())

    @property
    def sentence(self) -> str:
        """What came out, for people."""
        what = f"{self.status}: {self.n_moves} moves, length {self.path_length:.4g}, error {self.error:.2g}"
        return f"{what}; {self.reason}" if self.reason else what

    def report(self) -> dict[str, Any]:
        """Return the JSON object of ``shoal steer``."""
        return {
            "status": self.status,
            "reason": self.reason,
            "planner": self.planner,
            "moves": self.moves.tolist(),
            "n_moves": self.n_moves,
            "path_length": self.path_length,
            "final": self.final.tolist(),
            "error": self.error,
            "lower_bound": self.lower_bound,
            "order": (self.order + 1).tolist(),
            "seed": self.seed,
            "seconds": self.seconds,
        }

    def verify(self) -> bool:
        """Play the moves again and tell whether the particles go where the episode says, and whether the status fits that."""
        states = self.disturbance.replay(self.problem, self.moves, seed=self.seed)
        if states.shape != self.states.shape or not np.allclose(
            states, self.states, rtol=0, atol=1e-9 * self.problem.workspace.size
        ):
            return False
        reached = self.error <= self.problem.tolerance
        # With noise a planner sees where the particles are only roughly, and may not know that it has reached the goal.
        return reached if self.status == "solved" else not reached or self.disturbance.random

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the episode as JSON.

        Raises
        ------
        InvalidInputError
            If the suffix is not .json.
        OutputError
        """
        target = Path(path)
        if target.suffix != ".json":
            raise InvalidInputError(f"{target}: expected the suffix .json, got {target.suffix!r}")
        data = {
            "format": FORMAT,
            "version": self.version,
            "problem": self.problem.describe(),
            "planner": self.planner,
            "status": self.status,
            "reason": self.reason,
            "moves": self.moves.tolist(),
            "states": self.states.tolist(),
            "order": self.order.tolist(),
            "friction": None if self.disturbance.friction == inf else self.disturbance.friction,
            "radius": self.disturbance.radius,
            "execution": self.disturbance.execution,
            "measurement": self.disturbance.measurement,
            "gain": self.disturbance.gain,
            "seed": self.seed,
            "lower_bound": self.lower_bound,
            "seconds": self.seconds,
        }
        with atomic(target) as temporary:
            temporary.write_text(json.dumps(data, allow_nan=False) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> SteeringEpisode:
        """Read an episode.

        Raises
        ------
        InvalidInputError
        """
        source = Path(path)
        try:
            form = EpisodeForm.model_validate(read_json(read_text(source), where=str(source)))
        except ValidationError as error:
            raise InvalidInputError(f"not a steering episode: {said(error, where=str(source))}") from None
        problem = problem_of(form.problem, where=str(source))
        n, d = problem.start.shape
        moves, states = np.array(form.moves).reshape(-1, d), np.array(form.states)
        order = np.array(form.order, dtype=np.int64)
        if states.shape != (len(moves) + 1, n, d) or sorted(form.order) != list(range(n)):
            raise InvalidInputError(
                f"{source}: expected states of {n} particles before and after each move, got shape {states.shape}"
            )
        disturbance = Disturbance(
            friction=inf if form.friction is None else form.friction,
            radius=form.radius,
            execution=form.execution,
            measurement=form.measurement,
            gain=form.gain,
        )
        return cls(
            problem,
            form.planner,
            form.status,
            form.reason,
            moves,
            states,
            order,
            disturbance,
            form.seed,
            form.lower_bound,
            form.seconds,
            form.version,
        )
