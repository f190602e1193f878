"""ContactWorld: what a shared displacement does to particles between walls that hold what is pushed into them."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.steering.outline import Points, check_points
from shoal.steering.workspace import TOUCH, ConvexWorkspace

PUSHED = 1e-9  # of the length of a move: who is moved away from a wall by less than this is held


@dataclass(frozen=True)
class ContactWorld:
    """The dynamics of point particles under one shared displacement, with non-slip walls.

    A particle on a wall does not move while that wall has ``N u <= 0``, N its inward normal; so a push along the wall is held,
    too, and in a corner either wall holds. During a straight move a particle stops where it first meets a wall and stays there
    for the rest of that move; the others go on.

    Parameters
    ----------
    workspace : ConvexWorkspace

    Notes
    -----
    Source: paper W, section III, eq. 1.

    Examples
    --------
    >>> from shoal.steering import polygon
    >>> world = ContactWorld(polygon([(0, 0), (1, 0), (1, 1), (0, 1)]))
    >>> world.step([(0.25, 0.5), (0.5, 0.5)], (-0.5, 0.25)).tolist()
    [[0.0, 0.625], [0.0, 0.75]]
    """

    workspace: ConvexWorkspace

    def initial(self, points: ArrayLike) -> Points:
        """Return the state with particles at ``points``, float64, shape (n, dimensions).

        Raises
        ------
        InvalidInputError
            If one is outside.
        """
        return self.workspace.check_inside(points, what="start")

    def step(self, points: ArrayLike, move: ArrayLike) -> Points:
        """Return where particles at ``points`` are after one straight move, float64, shape (n, dimensions).

        Raises
        ------
        InvalidInputError
            If the move is no vector of finite numbers.
        """
        dimensions = self.workspace.dimensions
        state = check_points(points, what="points", dimensions=dimensions)
        vector = check_points([move], what="move", dimensions=dimensions, count=1)[0]
        length = float(np.linalg.norm(vector))
        if length == 0:
            return state.copy()
        return np.array([self._moved(point, vector, length) for point in state])

    def play(self, points: ArrayLike, moves: ArrayLike) -> Points:
        """Return the states at the start and after each move; float64, shape (moves + 1, n, dimensions)."""
        states = [self.initial(points)]
        for move in np.asarray(moves, dtype=np.float64).reshape(-1, self.workspace.dimensions):
            states.append(self.step(states[-1], move))
        return np.array(states)

    def held(self, points: ArrayLike, move: ArrayLike) -> NDArray[np.bool_]:
        """Tell which particles a wall would hold at the start of a move; bool, shape (n,)."""
        state = check_points(points, what="points", dimensions=self.workspace.dimensions)
        vector = check_points([move], what="move", dimensions=self.workspace.dimensions, count=1)[0]
        return np.array([self._is_held(point, vector, float(np.linalg.norm(vector))) for point in state])

    def _moved(self, point: Points, move: Points, length: float) -> Points:
        if self._is_held(point, move, length):
            return point.copy()
        share, wall = self._first_contact(point, move, length)
        if share >= 1:
            return point + move
        return self._snapped(point + share * move, wall)

    def _is_held(self, point: Points, move: Points, length: float) -> bool:
        space, touching = self.workspace, TOUCH * self.workspace.size
        pushed = space.normals @ move <= PUSHED * length
        if bool(np.any(pushed & (space.wall_distances(point) <= touching))):
            return True
        if not space.round or float(space.circle_distance(point)) > touching:
            return False
        outward = point[:2] - space.center
        return float(outward @ move[:2]) >= -PUSHED * length * float(np.hypot(*outward))

    def _first_contact(self, point: Points, move: Points, length: float) -> tuple[float, int]:
        """Return the share of the move at which a free particle meets a wall, and which: -1 is the circle."""
        space = self.workspace
        speeds = space.normals @ move
        distances = np.maximum(space.wall_distances(point), 0.0)
        shares = np.divide(distances, -speeds, out=np.full(len(speeds), inf), where=speeds < -PUSHED * length)
        wall = int(np.argmin(shares)) if len(shares) else 0
        share = float(shares[wall]) if len(shares) else inf
        if space.round:
            at_circle = _exit_share(point[:2] - space.center, move[:2], space.radius)
            if at_circle < share:
                return at_circle, -1
        return share, wall

    def _snapped(self, point: Points, wall: int) -> Points:
        """Return a point that has met a wall put exactly onto it."""
        space = self.workspace
        if wall >= 0:
            return np.asarray(point - (space.normals[wall] @ point - space.offsets[wall]) * space.normals[wall])
        outward = point[:2] - space.center
        onto = space.center + outward * (space.radius / float(np.hypot(*outward)))
        return np.concatenate([onto, point[2:]])


def _exit_share(point: Points, move: Points, radius: float) -> float:
    """Return the share of a move at which a point inside a circle around the origin leaves it."""
    a, b, c = float(move @ move), float(point @ move), min(float(point @ point) - radius * radius, 0.0)
    if a == 0:
        return inf
    root = float(np.sqrt(b * b - a * c))
    # Of the two forms of the larger root the one that does not subtract nearly equal numbers.
    return (root - b) / a if b <= 0 else -c / (b + root)
