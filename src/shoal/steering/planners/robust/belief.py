"""The position estimate of a closed loop: a particle filter over the positions of both particles."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.steering.kernels import shortening as kernels
from shoal.steering.workspaces.convex_geometry import Points

STATES = 256
LIKELY = 16  # effective states: with fewer what is seen counts alone
SURE, SATISFIED = 0.95, 0.5  # share of the states that have arrived: of a run that has just begun, and of one at its end


class PositionBelief:
    """A particle filter: many possible positions of both particles, all equally likely.

    Attributes
    ----------
    states : ndarray of float64, shape (states, 2, 2)
        The possible states. A state holds one row of coordinates for each particle.
    state : ndarray of float64, shape (2, 2)
        The possible state that is nearest to the mean of all possible states.
    """

    def __init__(self, room: Any, world: Any, noise: Any, seen: Points, rng: np.random.Generator) -> None:
        self.room, self.world, self.noise, self.rng = room, world, noise, rng
        self._settle(self._anew(seen))

    def update(self, move: Points, seen: Points) -> None:
        """Update the particle filter after the move ``move``, with the positions ``seen`` that the camera then observed."""
        states = self._followed(move, seen) if self.noise.measurement else None
        self._settle(self._anew(seen) if states is None else states)

    def _followed(self, move: Points, seen: Points) -> NDArray[np.float64] | None:
        """Return possible states after a move, or None if hardly any state agrees with the observed positions ``seen``.

        The method draws states at random. A state that agrees better with the observed positions has a larger probability.
        """
        moves = move + self.rng.normal(scale=self.noise.execution, size=(STATES, 2))
        states = self.states.copy()
        kernels.step_all(states, moves, self.world)
        unlikely = np.sum((states - seen) ** 2, axis=(1, 2)) / (2 * self.noise.measurement**2)
        weights = np.exp(unlikely.min() - unlikely)
        weights /= weights.sum()
        return None if 1 / np.sum(weights**2) < LIKELY else states[self.rng.choice(STATES, STATES, p=weights)]

    def arrived(self, goal: Points, tolerance: float, *, share: float) -> bool:
        """Return whether enough possible states are within the tolerance of the goals.

        ``share`` is the fraction of the maximum number of moves that the loop has used. The larger this fraction is, the fewer
        states need to be within the tolerance.
        """
        near = np.mean(np.linalg.norm(self.states - goal, axis=2).max(axis=1) <= tolerance)
        return bool(near >= SURE - (SURE - SATISFIED) * share)

    def _anew(self, seen: Points) -> NDArray[np.float64]:
        """Return new possible states, drawn around the observed positions ``seen``."""
        if not self.noise.measurement:
            return np.repeat(seen[None], STATES, axis=0)
        states = seen + self.rng.normal(scale=self.noise.measurement, size=(STATES, 2, 2))
        outside = ~self.room.contains(states)
        states[outside] = _nearest(self.room, states[outside])
        return states

    def _settle(self, states: NDArray[np.float64]) -> None:
        self.states = np.ascontiguousarray(states)
        self.state = self.states[int(np.argmin(np.sum((states - states.mean(axis=0)) ** 2, axis=(1, 2))))].copy()


def _nearest(room: Any, points: Points) -> Points:
    """Return, for each point outside a plane workspace, the nearest point of the workspace; float64, shape (n, 2)."""
    import shapely

    if room.round:
        away = points - room.center
        return np.asarray(room.center + room.radius * away / np.linalg.norm(away, axis=1, keepdims=True))
    lines = shapely.shortest_line(room.shape, shapely.points(points))
    return np.asarray(shapely.get_coordinates(shapely.get_point(lines, 0)))
