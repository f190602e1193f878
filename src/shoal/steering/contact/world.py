"""ContactWorld: motion of particles under one shared displacement, between walls that hold particles."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from math import inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_number, check_points
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.steering.kernels import contact as kernels
from shoal.steering.workspaces.convex import ConvexWorkspace
from shoal.steering.workspaces.convex_geometry import Points

PUSHED = kernels.PUSHED


class SteeringWorld(ABC):
    """Base class of the simulated worlds of steering, in which one shared displacement moves all particles in a workspace."""

    workspace: Any
    friction: float

    @property
    def room(self) -> Any:
        """The set of possible positions of the particles' centres, as a workspace."""
        return self.workspace

    def initial(self, points: ArrayLike) -> Points:
        """Return ``points`` as the initial positions of the particles; float64, shape (n, dimensions).

        Raises
        ------
        InvalidInputError
            If a particle is outside the workspace, or two particles overlap.
        """
        return self.check_state(points, what="start")

    def check_state(self, points: ArrayLike, *, what: str) -> Points:
        """Return valid particle positions as float64, shape (n, dimensions), or raise InvalidInputError for invalid positions."""
        state: Points = self.room.check_inside(points, what=what)
        return state

    def step(self, points: ArrayLike, move: ArrayLike) -> Points:
        """Return the positions of particles after one straight move from ``points``; float64, shape (n, dimensions).

        Raises
        ------
        InvalidInputError
            If the move is not a vector of finite numbers.
        """
        dimensions = self.workspace.dimensions
        state = np.array(check_points(points, what="points", dimensions=dimensions), order="C")
        vector = check_points([move], what="move", dimensions=dimensions, count=1)[0]
        return self.moved(state, np.ascontiguousarray(vector))

    def play(self, points: ArrayLike, moves: ArrayLike) -> Points:
        """Return the positions of the particles at the start and after each move; float64, shape (moves + 1, n, dimensions)."""
        d = self.workspace.dimensions
        vectors = np.asarray(moves, dtype=np.float64)
        vectors = check_points(vectors.reshape(-1, d) if vectors.size == 0 else vectors, what="moves", dimensions=d)
        states = [self.initial(points)]
        for move in vectors:
            states.append(self.moved(np.array(states[-1], order="C"), np.ascontiguousarray(move)))
        return np.array(states)

    def final(self, points: Points, moves: Points) -> Points:
        """Return the positions of the particles after all moves, float64, shape (n, dimensions), without checks of the input."""
        state = np.array(points, dtype=np.float64, order="C")
        for move in np.ascontiguousarray(moves):
            self.moved(state, move)
        return state

    def held(self, points: ArrayLike, move: ArrayLike) -> NDArray[np.bool_]:
        """Return which particles a wall with infinite friction would hold at the start of ``move``; bool, shape (n,)."""
        state = np.ascontiguousarray(check_points(points, what="points", dimensions=self.workspace.dimensions))
        vector = check_points([move], what="move", dimensions=self.workspace.dimensions, count=1)[0]
        return np.array([self.is_held(point, vector) for point in state])

    @abstractmethod
    def moved(self, state: Points, move: Points) -> Points:
        """Apply the displacement ``move`` to the positions in the array ``state`` in place, without checks."""

    @abstractmethod
    def is_held(self, point: Points, move: Points) -> bool:
        """Return whether a wall holds a particle at ``point`` at the start of the displacement ``move``."""


@dataclass(frozen=True, eq=False)
class ContactWorld(SteeringWorld):
    """The dynamics of particles under one shared displacement, between walls with friction.

    With infinite friction, a particle stops at the first wall that it meets, and stays at this wall until the end of the straight
    move. If the displacement u satisfies ``N u <= 0``, a wall with the inward normal N holds each particle that touches the wall,
    even if u is parallel to the wall. In a corner, each wall alone can hold a particle. Particles without a radius do not stop each
    other.

    With finite friction, a particle that the displacement u pushes into a wall slides along the wall by ``|T u| - friction |N u|``,
    where N is the normal and T the tangent of the wall. If this number is negative, the particle does not slide.

    The displacement u moves a particle at the point p by ``g(p) u``. The gain ``g(p) = 1 + gradient (p - c)`` can describe, for
    example, that particles near a coil move faster. The point c is the centre of the workspace.

    Particles with a radius above 0 are spheres. The centre of a sphere stays at least one radius away from each wall. A moving
    sphere stops when it meets a stopped sphere.

    Parameters
    ----------
    workspace : ConvexWorkspace
    friction : float
        Coefficient of Coulomb friction, at least 0. With infinite friction, a particle that is pushed into a wall never slides.
    gradient : array_like of float, shape (dimensions,), optional
        Gradient of the gain (displacement of a particle divided by the input), per unit of length of the workspace.
    radius : float
        Radius of each particle, in the workspace's unit of length.
    touch : float
        Contact tolerance, as a fraction of the workspace's size: a particle at most this far from a wall touches the wall.

    Raises
    ------
    InvalidInputError
        If a number is out of range, the gain is not positive everywhere, or a particle does not fit into the workspace; or if a
        radius above 0 is combined with finite friction or with ``gradient``.

    Notes
    -----
    Source: equation 1 in section III of paper W, and section VII.A of paper W for the gain. Finite friction, the linear gain and
    the radius of particles are extensions by Shoal.

    Examples
    --------
    >>> from shoal.steering import polygon
    >>> square = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])
    >>> ContactWorld(square).step([(0.25, 0.5), (0.5, 0.5)], (-0.5, 0.25)).tolist()
    [[0.0, 0.625], [0.0, 0.75]]
    >>> ContactWorld(square, friction=0.25).step([(0.0, 0.5), (0.5, 0.5)], (-0.25, 0.25)).tolist()
    [[0.0, 0.6875], [0.25, 0.75]]
    """

    workspace: ConvexWorkspace
    friction: float = inf
    gradient: Any = None
    radius: float = 0.0
    touch: float = kernels.TOUCH

    def __post_init__(self) -> None:
        check_number(self.friction, what="friction", least=0, finite=False)
        check_number(self.radius, what="particle radius", least=0)
        if self.radius and (self.friction < inf or self.gradient is not None):
            raise InvalidInputError(
                "particle radius: expected no friction coefficient and no gain, which only particles without a radius allow"
            )
        _ = self.room, self.gain  # raises an error if a particle does not fit

    @cached_property
    def room(self) -> ConvexWorkspace:
        """The set of possible positions of the particles' centres, as a workspace."""
        return self.workspace.inset(self.radius) if self.radius else self.workspace

    @cached_property
    def gain(self) -> NDArray[np.float64]:
        """Coefficients (g, gx, gy, ...) of the gain, which is ``g + (gx, gy, ...) p`` at the point p."""
        d = self.workspace.dimensions
        if self.gradient is None:
            return np.asarray(np.eye(d + 1)[0])
        gradient = check_points([self.gradient], what="gain", dimensions=d, count=1)[0]
        reach = self.workspace.extent(gradient)
        if reach >= 1:
            raise InvalidInputError(
                f"gain: expected a gain that is positive everywhere, got variations of {100 * reach:.3g} % of its mean"
            )
        return np.concatenate([[1 - gradient @ self.workspace.middle], gradient])

    def check_state(self, points: ArrayLike, *, what: str) -> Points:
        """Return valid particle positions as float64, shape (n, dimensions), or raise InvalidInputError for invalid positions."""
        state = super().check_state(points, what=what)
        if self.radius:
            away = np.linalg.norm(state[:, None] - state[None], axis=-1) + np.eye(len(state)) * 4 * self.radius
            if away.min() < 2 * self.radius * (1 - 1e-12):
                one, other = np.unravel_index(int(away.argmin()), away.shape)
                raise InvalidInputError(
                    f"{what}: expected particles that do not overlap, {2 * self.radius:g} apart or more, "
                    f"got {away.min():.3g} between points {one + 1} and {other + 1}"
                )
        return state

    @cached_property
    def walls(self) -> kernels.Walls:
        """The walls of the workspace, as arrays for the compiled functions."""
        room = self.room
        normals, circle = np.ascontiguousarray(room.normals), np.array([*room.center, room.radius])
        near = float(self.workspace.size) * self.touch / kernels.TOUCH
        return kernels.Walls(normals, room.offsets, circle, near, float(self.friction), self.gain)

    def is_held(self, point: Points, move: Points) -> bool:
        """Return whether a wall holds a particle at ``point`` at the start of the displacement ``move``."""
        return bool(kernels.is_held(point, move, self.walls))

    def final(self, points: Points, moves: Points) -> Points:
        """Return the positions of the particles after all moves, float64, shape (n, dimensions), without checks of the input."""
        if self.radius or not len(moves):
            return super().final(points, moves)
        state = np.array(points, dtype=np.float64, order="C")
        kernels.advance_plan(state, np.ascontiguousarray(moves, dtype=np.float64), self.walls, np.empty(state.shape[1]))
        return state

    def moved(self, state: Points, move: Points) -> Points:
        """Apply the displacement ``move`` to the positions in the array ``state`` in place, without checks."""
        before, spare = state.copy(), np.empty_like(move)
        shares = np.array([kernels.advance(point, move, self.walls, spare) for point in state])
        if self.radius:
            stop_at_others(before, move, shares, 2 * self.radius, state)
        return state


def stop_at_others(before: Points, move: Points, shares: NDArray[np.float64], apart: float, after: Points) -> None:
    """Stop each sphere that collides with a stopped sphere, in the order of the collisions.

    Until a wall stops the first sphere, all spheres move by the same vector and cannot collide. ``shares`` holds, for each sphere,
    the fraction of the move after which a wall stopped the sphere, or 1 if no wall stopped it. The function changes the end
    positions ``after`` in place.
    """
    if shares.min() == shares.max():  # no sphere moves on after another has stopped
        return
    shares = shares.copy()
    length = float(move @ move)
    while length > 0:
        first, who = 1.0, None
        for mover in range(len(before)):
            for stopped in np.flatnonzero(shares < shares[mover]):
                # Solve |before + share move - after[stopped]| = apart for the smaller share.
                gap = before[mover] - after[stopped]
                half, rest = float(gap @ move), float(gap @ gap) - apart * apart
                under = half * half - length * rest
                if half >= 0 or under < 0:
                    continue
                share = max((-half - np.sqrt(under)) / length, 0.0)
                if max(share, shares[stopped]) < min(shares[mover], first):
                    first, who = max(share, float(shares[stopped])), mover
        if who is None:
            return
        shares[who] = first
        after[who] = before[who] + first * move
