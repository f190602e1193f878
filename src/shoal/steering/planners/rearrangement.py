"""More than two particles: which relative positions one shared input can reach, with plans.

Paper W leaves more than two particles to future work (section VIII). Two theorems hold for walls
that hold particles (infinite friction), and one for walls without friction.

**Theorem 1.** In a parallelogram, any number of particles can be brought from any pairwise
different positions to any pairwise different positions, all of them off the walls.

**Theorem 2.** In any convex polygon, the same holds for starts and goals that each fit into a
corner: translated into the corner, the bounding parallelogram of the particles, with sides along
the two walls there, lies in the polygon with room to spare.

Proof. Let s and t be coordinates along the two walls of a corner, so that the walls are t = 0 and
s = 0. If all particles move towards t = 0, the lowest ones touch it first. A move along the wall
then changes their s relative to all others, and nothing else. How far it can lead depends on the
room of the others; but after a contact further along the wall it goes on, so that every *shift* of
the lowest particles along t = 0 is possible. Likewise, the leftmost particles can be shifted along
s = 0. Every shift can be undone by the opposite one, because the particles are still the lowest, or
the leftmost. *Peeling* takes the lowest particle (among several, the one with the smallest s),
shifts it to the left of all others, and then, as it is the leftmost, above all others. After n
such steps every particle has been the lowest. All particles then lie at equal distances in s, in
the order in which they were taken, and at distances in t that can be chosen freely. Peel the start,
with heights in the order in which peeling takes the particles of the goal; peel the result; undo
the peeling of the goal. The spreads of the particles grow by an arbitrarily small amount only.

These are 6 n shifts. Two of them are one, so that 12 n - 1 moves are enough for particles that one
contact can shift by any amount: those with spreads below half the walls. Others need up to about
spread / room contacts a shift.

Particles at the same place never separate, so that different positions are necessary, too.

**Theorem 3.** In a rectangle without friction, the coordinates along both sides are independent,
and every sequence of moves changes those of all particles to clip(x, a, b) + c with the same
a <= b and c. Hence no distance along a side ever grows, and no order is ever reversed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_points
from shoal.core.errors import InvalidInputError
from shoal.steering.contact.world import ContactWorld
from shoal.steering.workspaces.convex import ConvexWorkspace, Points

__all__ = ["corner_room", "is_reachable_without_friction", "rearrange"]

_LEAST_ROOM = 1e-3  # of the walls at a corner; the number of moves grows with its reciprocal


class _Corner(NamedTuple):
    """A corner of a polygon with the coordinates along its walls, from 0 to 1 on each wall."""

    vertex: int
    origin: Points  # (2,)
    axes: Points  # (2, 2): rows along the walls t = 0 and s = 0
    normals: Points  # (walls, 2)
    slack: NDArray[np.float64]  # (walls,): distances of the origin from all walls

    def coordinates(self, points: Points) -> Points:
        """Return the coordinates (s, t) of points, shape (n, 2)."""
        coordinates = np.linalg.solve(self.axes.T, (points - self.origin).T).T
        return np.asarray(coordinates, dtype=np.float64)

    def room(self, coordinates: Points) -> float:
        """Return by how much the bounding parallelogram of particles may grow along both walls
        without leaving the polygon; below 0 if it does not fit.
        """
        spread = np.ptp(coordinates, axis=0)
        far = self.slack + self.normals @ (spread @ self.axes)
        rate = self.normals @ self.axes.sum(axis=0)
        falling = rate < 0
        room = far[falling] / -rate[falling]
        return float(min(room.min(initial=np.inf), (1 - spread).min()))

    def reach(self, axis: int, across: float) -> float:
        """Return how far a parallelogram in the corner extends along one wall, if it extends by
        ``across`` along the other.
        """
        far = self.slack + self.normals @ (across * self.axes[1 - axis])
        rate = self.normals @ self.axes[axis]
        falling = rate < 0
        return float(min((far[falling] / -rate[falling]).min(initial=np.inf), 1.0))

    def depth(self, points: Points, axis: int) -> float:
        """Return how far particles can all move in the direction of an axis, in its lengths."""
        far = self.slack + (points - self.origin) @ self.normals.T
        rate = self.normals @ self.axes[axis]
        falling = rate < 0
        return float((far[:, falling] / -rate[falling]).min(initial=np.inf))


class _Shift(NamedTuple):
    """A shift of the particles that touch a wall of a corner first, along this wall and relative to
    all other particles.
    """

    corner: _Corner
    axis: int  # coordinate that changes: 0 on the wall t = 0, 1 on the wall s = 0
    members: frozenset[int]
    amount: float

    @property
    def wall(self) -> int:
        """Index of the wall, as that of its first vertex."""
        return (self.corner.vertex - self.axis) % len(self.corner.normals)

    def applied(self, coordinates: Points) -> Points:
        """Return the coordinates after the shift."""
        after = coordinates.copy()
        after[sorted(self.members), self.axis] += self.amount
        return after


def _corners(workspace: ConvexWorkspace) -> list[_Corner]:
    vertices = np.asarray(workspace.vertices)
    count = len(vertices)
    corners = []
    for k, origin in enumerate(vertices):
        axes = np.array([vertices[(k + 1) % count] - origin, vertices[k - 1] - origin])
        slack = np.maximum(workspace.normals @ origin - workspace.offsets, 0.0)
        corners.append(_Corner(k, origin, axes, workspace.normals, slack))
    return corners


def _check_polygon(workspace: ConvexWorkspace) -> None:
    if workspace.round or workspace.dimensions != 2:
        raise InvalidInputError("workspace: expected a convex polygon, got a disk or a solid")


def corner_room(workspace: ConvexWorkspace, points: ArrayLike) -> float:
    """Return the largest room that particles have in a corner of a polygon, as a fraction of the
    walls there: above 0 if theorem 2 holds for their relative positions.

    Parameters
    ----------
    workspace : ConvexWorkspace
        A convex polygon.
    points : array_like of float, shape (n, 2)

    Raises
    ------
    InvalidInputError
        If the workspace is no polygon.

    Examples
    --------
    >>> from shoal.steering import polygon
    >>> triangle = polygon([(0, 0), (1, 0), (0, 1)])
    >>> round(corner_room(triangle, [(0.1, 0.1), (0.3, 0.2), (0.2, 0.4)]), 3)
    0.25
    """
    _check_polygon(workspace)
    state = check_points(points, what="points", dimensions=2)
    return max(corner.room(corner.coordinates(state)) for corner in _corners(workspace))


def _peel(
    coordinates: Points, corner: _Corner, step: float, ranks: Sequence[int] | None
) -> tuple[list[_Shift], Points, list[int]]:
    """Return the shifts that peel a configuration, the configuration after them, and the particles
    in the order in which they are taken.

    With ``ranks``, the heights at the end are in their order; by default, in the order of taking.
    """
    state = coordinates
    shifts: list[_Shift] = []
    order: list[int] = []
    base = float(state[:, 1].max()) + step
    left = set(range(len(state)))
    while left:
        lowest = min(state[k, 1] for k in left)
        level = frozenset(k for k in left if state[k, 1] - lowest <= 1e-12)
        taken = min(level, key=lambda k: state[k, 0])
        most_left = float(state[:, 0].min()) - step
        first = _Shift(corner, 0, level, most_left - float(state[taken, 0]))
        state = first.applied(state)
        rank = len(order) if ranks is None else ranks[taken]
        height = base + step * rank - float(state[taken, 1])
        second = _Shift(corner, 1, frozenset([taken]), height)
        state = second.applied(state)
        shifts += [first, second]
        order.append(taken)
        left.remove(taken)
    return shifts, state, order


def _merged(shifts: Sequence[_Shift]) -> list[_Shift]:
    """Return shifts without successive shifts of the same particles along the same wall."""
    merged: list[_Shift] = []
    for shift in shifts:
        last = merged[-1] if merged else None
        if last is not None and last[:3] == shift[:3]:
            merged[-1] = last._replace(amount=last.amount + shift.amount)
        else:
            merged.append(shift)
    return merged


def rearrange(workspace: ConvexWorkspace, start: ArrayLike, goal: ArrayLike) -> Points:
    """Return moves that bring particles from a start to a goal in a convex polygon, by the proof of
    theorem 2; shape (moves, 2).

    The plan is far from the shortest one, and has more moves the less room the particles have. The
    moves aim at exact contacts, and are checked by simulation.

    Parameters
    ----------
    workspace : ConvexWorkspace
        A convex polygon, whose walls hold particles (infinite friction).
    start, goal : array_like of float, shape (n, 2)
        Positions of the particles, off the walls and pairwise different.

    Raises
    ------
    InvalidInputError
        If the workspace is no polygon, if a position lies on a wall or outside, if two particles
        are at the same place, or if the start or the goal fits into no corner with a room of 0.001.

    Examples
    --------
    >>> from shoal.steering import ContactWorld, polygon
    >>> square = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])
    >>> start, goal = [(0.2, 0.2), (0.5, 0.6), (0.9, 0.4)], [(0.9, 0.8), (0.1, 0.1), (0.5, 0.3)]
    >>> moves = rearrange(square, start, goal)
    >>> ContactWorld(square).play(start, moves)[-1].round(9).tolist()
    [[0.9, 0.8], [0.1, 0.1], [0.5, 0.3]]
    """
    _check_polygon(workspace)
    ends = {}
    for what, points in (("start", start), ("goal", goal)):
        state = check_points(points, what=what, dimensions=2)
        if float(workspace.depth(state).min()) <= 1e-9 * workspace.size:
            raise InvalidInputError(f"{what}: expected all particles inside, off the walls")
        apart = np.linalg.norm(state[:, None] - state[None], axis=2)
        np.fill_diagonal(apart, np.inf)
        if float(apart.min(initial=np.inf)) <= 1e-8 * workspace.size:
            raise InvalidInputError(
                f"{what}: expected pairwise different positions, got two particles at one place"
            )
        ends[what] = state
    first, last = ends["start"], ends["goal"]
    if first.shape != last.shape:
        raise InvalidInputError(f"goal: expected {len(first)} positions, got {len(last)}")
    moves = _moves(workspace, first, _shifts(workspace, first, last), last)
    missed = float(np.abs(ContactWorld(workspace).final(first, moves) - last).max())
    if missed > 1e-7 * workspace.size:
        raise InvalidInputError(
            "start and goal: expected particles that touch a wall together, or apart by more than"
            " the contact tolerance; the plan misses by"
            f" {missed:.2g}"
        )
    return moves


def _shifts(workspace: ConvexWorkspace, start: Points, goal: Points) -> list[_Shift]:
    """Return the shifts of the proof of theorem 2."""
    corners = _corners(workspace)
    rooms = {
        what: [corner.room(corner.coordinates(state)) for corner in corners]
        for what, state in (("start", start), ("goal", goal))
    }
    for what, room in rooms.items():
        if max(room) < _LEAST_ROOM:
            raise InvalidInputError(
                f"{what}: expected particles whose bounding parallelogram along two neighbouring"
                " walls fits into their corner"
            )
    count = len(start)
    both = np.minimum(rooms["start"], rooms["goal"])
    shifts: list[_Shift] = []
    if both.max() >= _LEAST_ROOM:
        corner = corners[int(both.argmax())]
        step = float(both.max()) / (20 * count)
        state = corner.coordinates(start)
    else:  # shrink the start in its own corner first, until it fits beside the goal's
        corner = corners[int(np.argmax(rooms["goal"]))]
        step = max(rooms["goal"]) / (20 * count)
        own = corners[int(np.argmax(rooms["start"]))]
        small = max(rooms["start"]) / (20 * count)
        while True:
            shifts, peeled, _ = _peel(own.coordinates(start), own, small, None)
            state = corner.coordinates(own.origin + peeled @ own.axes)
            if corner.room(state) >= 20 * count * step:
                break
            small /= 2
    undone, _, order = _peel(corner.coordinates(goal), corner, step, None)
    ranks = np.argsort(order).tolist()
    one, state, _ = _peel(state, corner, step, ranks)
    other, _, _ = _peel(state, corner, step, ranks)
    back = [shift._replace(amount=-shift.amount) for shift in reversed(undone)]
    return _merged([*shifts, *one, *other, *back])


def _moves(
    workspace: ConvexWorkspace, start: Points, shifts: Sequence[_Shift], goal: Points
) -> Points:
    """Return the moves that carry out shifts, and then lead to the goal."""
    world, state = ContactWorld(workspace), np.array(start, order="C")
    moves: list[Points] = []

    def go(move: Points) -> None:
        moves.append(move)
        world.moved(state, np.ascontiguousarray(move))  # in place

    wall = -1
    for corner, axis, members, amount, own_wall in ((*shift, shift.wall) for shift in shifts):
        others = np.array([k not in members for k in range(len(state))])
        left = amount
        while left and others.any():  # all together are not shifted relative to any
            before = corner.coordinates(state)
            along, across = before[:, axis], before[:, 1 - axis]
            free = corner.reach(axis, float(np.ptp(across))) - float(np.ptp(along))
            # the others pass from one side of the held particles to the other only as far as
            # the walls let them: what is left of the shift follows after another contact
            if left > 0:
                part = min(left, 0.9 * free + along[others].min() - along.min())
            else:
                part = max(left, -(0.9 * free + along.max() - along[others].max()))
            left = 0.0 if part == left else left - part
            places = np.concatenate([along, along[others] - part])
            margin = (corner.reach(axis, float(np.ptp(across))) - float(np.ptp(places))) / 2
            to = np.empty(2)
            to[axis], to[1 - axis] = margin - places.min(), -across.min()
            if own_wall == wall:  # off the wall, which would hold the particles of the last shift
                up = np.zeros(2)
                up[1 - axis] = lift = min(corner.depth(state, 1 - axis) / 2, margin)
                go(up @ corner.axes)
                to[1 - axis] -= lift
            go(to @ corner.axes)
            aside = np.zeros(2)
            aside[axis] = -part
            go(aside @ corner.axes)
            wall = own_wall
    go((goal - state).mean(axis=0))
    return np.array(moves)


def is_reachable_without_friction(start: ArrayLike, goal: ArrayLike) -> bool:
    """Return whether particles in a large enough rectangle without friction can reach a goal up to
    a translation: theorem 3, exact but for a tolerance of 1e-9.

    Parameters
    ----------
    start, goal : array_like of float, shape (n, 2)
        Positions with axes along the sides.

    Examples
    --------
    >>> is_reachable_without_friction([(0, 0), (2, 1)], [(0, 0), (1, 1)])
    True
    >>> is_reachable_without_friction([(0, 0), (2, 1)], [(0, 0), (3, 1)])
    False
    """
    first = check_points(start, what="start", dimensions=2)
    last = check_points(goal, what="goal", dimensions=2, count=len(first))
    return all(_is_clipped(x, y) for x, y in zip(first.T, last.T, strict=True))


def _is_clipped(before: Points, after: Points) -> bool:
    """Return whether clip(before, a, b) + c equals ``after`` for some a <= b and c.

    If any clip does, one does that leaves a particle where it is.
    """
    tolerance = 1e-9 * max(float(np.ptp(before)), 1e-300)
    return any(
        np.abs(np.clip(before, after.min() - c, after.max() - c) + c - after).max() <= tolerance
        for c in after - before
    )
