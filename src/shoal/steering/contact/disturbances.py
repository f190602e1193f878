"""What a real apparatus adds to the ideal world: friction that gives way, a field that is not uniform, noise."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike

from shoal.errors import InvalidInputError
from shoal.steering.contact.world import ContactWorld
from shoal.steering.problem import SteeringProblem
from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.region import Region


@dataclass(frozen=True)
class Disturbance:
    """How a world differs from the ideal one.

    Parameters
    ----------
    execution : float
        Standard deviation of what is added to each coordinate of each move, the same for all particles.
    measurement : float
        Standard deviation of what the camera adds to each coordinate of each particle.
    gain : float
        By how much of itself the response to the input varies over the workspace: 0.2 is from 0.9 to 1.1, along a direction that
        the seed draws. 0 is a uniform field.
    friction : float
        Coefficient of friction between particle and wall; infinite if nothing that is pushed into a wall slides.
    radius : float
        Of the particles.

    Raises
    ------
    InvalidInputError
        For negative numbers, and a gain of 2 or more.
    """

    execution: float = 0.0
    measurement: float = 0.0
    gain: float = 0.0
    friction: float = inf
    radius: float = 0.0

    def __post_init__(self) -> None:
        for name in ("execution", "measurement", "gain", "radius"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not 0 <= value < inf:
                raise InvalidInputError(f"{name}: expected a number, 0 or more, got {value!r}")
        if self.gain >= 2:
            raise InvalidInputError(f"gain: expected a variation below 2, so that no particle goes backwards, got {self.gain:g}")

    @property
    def random(self) -> bool:
        """Whether two runs differ."""
        return bool(self.execution or self.measurement or self.gain)

    def world(self, problem: SteeringProblem, *, seed: int = 0) -> Any:
        """Return the world in which a problem is played."""
        workspace = problem.workspace
        if isinstance(workspace, Region):
            from shoal.steering.contact.region_world import RegionWorld

            if self.friction < inf or self.gain or self.radius:
                raise InvalidInputError(
                    "a region with obstacles: expected no friction, gain or particle radius; those are for convex ones"
                )
            return RegionWorld(workspace)
        gradient = None
        if self.gain:
            direction = generators(seed)[0].normal(size=workspace.dimensions)
            gradient = direction * (self.gain / 2 / workspace.extent(direction))
        return ContactWorld(workspace, friction=self.friction, gradient=gradient, radius=self.radius)

    def execute(self, world: Any, points: Points, move: ArrayLike, rng: Generator) -> Points:
        """Return the state after a move that is sent, with the noise of its execution."""
        vector = np.asarray(move, dtype=np.float64)
        if self.execution:
            vector = vector + rng.normal(scale=self.execution, size=vector.shape)
        return np.asarray(world.step(points, vector))

    def observe(self, points: Points, rng: Generator) -> Points:
        """Return what the camera sees."""
        return points + rng.normal(scale=self.measurement, size=points.shape) if self.measurement else points.copy()

    def replay(self, problem: SteeringProblem, moves: Points, *, seed: int) -> Points:
        """Return all states when moves are sent again with the same seed; float64, shape (moves + 1, n, d)."""
        world = self.world(problem, seed=seed)
        rng = generators(seed)[1]
        states = [world.initial(problem.start)]
        for move in moves:
            states.append(self.execute(world, states[-1], move, rng))
        return np.array(states)


IDEAL = Disturbance()


def generators(seed: int) -> tuple[Generator, Generator, Generator, Generator]:
    """Return the generators of the field, of execution, of the camera and of the planner."""
    spawned = np.random.SeedSequence(seed).spawn(4)
    return tuple(np.random.default_rng(child) for child in spawned)  # type: ignore[return-value]  # four children, four generators
