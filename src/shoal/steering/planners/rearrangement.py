"""More than two particles: which relative positions one shared input can reach, with plans.

Paper W leaves more than two particles to future work (section VIII). Two theorems hold for walls
that hold particles (infinite friction), and one for walls without friction.

**Theorem 1.** In a parallelogram, any number of particles can be brought from any pairwise
different positions to any pairwise different positions, all of them off the walls.

**Theorem 2.** In any convex polygon, the same holds for starts and goals that each have room at two
walls that are not parallel: the bounding parallelogram of the particles, with sides along both
walls, can be translated in the polygon so that it touches the first wall, and so that it touches
the second one, with room to spare.

Proof. Let s and t be coordinates along the two walls, which lie at t = 0 and s = 0, with the
polygon above and to the right. If all particles move towards t = 0, the lowest ones touch it first.
A move along the wall then changes their s relative to all others, and nothing else. How far it can
lead depends on the room of the others; but after a contact further along the wall it goes on, so
that every *shift* of the lowest particles along t = 0 is possible. Likewise, the leftmost particles
can be shifted along s = 0. Every shift can be undone by the opposite one, because the particles are
still the lowest, or the leftmost. *Peeling* takes the lowest particle (among several, the one with
the smallest s), shifts it to the left of all others, and then, as it is the leftmost, above all
others. After n such steps every particle has been the lowest. All particles then lie at equal
distances in s, in the order in which they were taken, and at distances in t that can be chosen
freely. Peel the start, with heights in the order in which peeling takes the particles of the goal;
peel the result; undo the peeling of the goal. The spreads of the particles grow by an arbitrarily
small amount only. If the goal has its room at other walls, peel the start at its own walls first:
the result is small enough for all.

These are 6 n shifts. Two of them are one, so that 12 n - 1 moves are enough for particles that one
contact can shift by any amount: those with spreads below half the walls. Others need up to about
spread / room contacts a shift.

Particles without room at two walls are first drawn together by shifts, the start forwards and the
goal backwards. That is a search: its plan proves that a goal can be reached, and nothing is known
where it finds none.

Particles at the same place never separate, so that different positions are necessary, too.

**Theorem 3.** In a rectangle without friction, the coordinates along both sides are independent,
and every sequence of moves changes those of all particles to clip(x, a, b) + c with the same
a <= b and c. Hence no distance along a side ever grows, and no order is ever reversed.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_points
from shoal.core.errors import InvalidInputError
from shoal.steering.contact.world import ContactWorld
from shoal.steering.workspaces.convex import ConvexWorkspace, Points

__all__ = ["is_reachable_without_friction", "rearrange", "room_to_rearrange"]

_LEAST_ROOM = 1e-3  # of the walls; the number of moves grows with its reciprocal
_DRAWN = 200  # shifts that draw particles together, at most
_MOST_MOVES = 5_000
_OFF_WALLS = 1e-5  # of the walls; contacts are found to 1e-9 of the workspace


class _Walls(NamedTuple):
    """Two walls of a polygon that are not parallel, with coordinates in lengths of the walls."""

    numbers: tuple[int, int]  # of the walls at t = 0 and s = 0
    origin: Points  # (2,): where their lines meet, perhaps outside
    axes: Points  # (2, 2): rows along the walls t = 0 and s = 0, away from the other one
    normals: Points  # (walls, 2)
    slack: NDArray[np.float64]  # (walls,): how far the origin lies inside all walls

    def coordinates(self, points: Points) -> Points:
        """Return the coordinates (s, t) of points, shape (n, 2)."""
        coordinates = np.linalg.solve(self.axes.T, (points - self.origin).T).T
        return np.asarray(coordinates, dtype=np.float64)

    def places(self, axis: int, along: Points, across: Points) -> tuple[float, float]:
        """Return how far particles with given coordinates can be moved along a wall, backwards and
        forwards, if they are in the polygon; the first number is the larger one if they never are.
        """
        rate = self.normals @ self.axes[axis]
        inside = (
            self.slack[:, None]
            + rate[:, None] * along
            + (self.normals @ self.axes[1 - axis])[:, None] * across
        ).min(axis=1)
        size = float(np.abs(self.axes).max())
        flat = np.abs(rate) < 1e-12 * size
        if np.any(inside[flat] < -1e-9 * size):
            return np.inf, -np.inf
        rising, falling = ~flat & (rate > 0), ~flat & (rate < 0)
        return (
            float((-inside[rising] / rate[rising]).max()),
            float((-inside[falling] / rate[falling]).min()),
        )

    def has_room(self, spread: Points) -> bool:
        """Return whether a parallelogram with two sides ``spread`` can touch either wall."""
        along, across = np.array([(0, 0), (0, 1), (1, 0), (1, 1)]).T * spread[:, None]
        ends = [self.places(0, along, across), self.places(1, across, along)]
        return all(low <= high for low, high in ends)

    def room(self, coordinates: Points) -> float:
        """Return by how much the bounding parallelogram of particles may grow along both walls and
        still touch either in the polygon; 0 if that is less than the least room.
        """
        spread = np.ptp(coordinates, axis=0)
        low, high = _LEAST_ROOM, 2.0
        if not self.has_room(spread + low):
            return 0.0
        while self.has_room(spread + high):
            high *= 2
        for _ in range(24):
            middle = (low + high) / 2
            low, high = (middle, high) if self.has_room(spread + middle) else (low, middle)
        return low

    def lift(self, points: Points, axis: int) -> float:
        """Return how far particles can all move in the direction of an axis, in its lengths."""
        far = self.slack + (points - self.origin) @ self.normals.T
        rate = self.normals @ self.axes[axis]
        falling = rate < -1e-12 * np.abs(self.axes).max()
        return float((far[:, falling] / -rate[falling]).min())


class _Shift(NamedTuple):
    """A shift of the particles that touch a wall first, along this wall and relative to all other
    particles.
    """

    walls: _Walls
    axis: int  # coordinate that changes: 0 on the wall t = 0, 1 on the wall s = 0
    members: frozenset[int]
    amount: float

    def apply(self, coordinates: Points) -> Points:
        """Return the coordinates after the shift."""
        after = coordinates.copy()
        after[sorted(self.members), self.axis] += self.amount
        return after


def _pairs_of_walls(workspace: ConvexWorkspace) -> list[_Walls]:
    vertices, normals = np.asarray(workspace.vertices), workspace.normals
    along = np.roll(vertices, -1, axis=0) - vertices
    pairs = []
    for i, j in combinations(range(len(vertices)), 2):
        if abs(normals[i] @ along[j]) < 0.05 * np.hypot(*along[j]):
            continue  # parallel, or nearly so
        axes = np.array(
            [
                along[i] * np.sign(normals[j] @ along[i]),
                along[j] * np.sign(normals[i] @ along[j]),
            ]
        )
        lines = normals[[i, j]]
        origin = np.asarray(np.linalg.solve(lines, workspace.offsets[[i, j]]), dtype=np.float64)
        slack = normals @ origin - workspace.offsets
        slack[[i, j]] = 0.0
        pairs.append(_Walls((i, j), origin, axes, normals, slack))
    return pairs


def _check_polygon(workspace: ConvexWorkspace) -> None:
    if workspace.round or workspace.dimensions != 2:
        raise InvalidInputError("workspace: expected a convex polygon, got a disk or a solid")


def room_to_rearrange(workspace: ConvexWorkspace, points: ArrayLike) -> float:
    """Return the largest room that particles have at two walls of a polygon, as a fraction of the
    walls; 0 if it is less than .001. If it is above 0, theorem 2 holds for their relative
    positions.

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
    >>> round(room_to_rearrange(triangle, [(0.1, 0.1), (0.3, 0.2), (0.2, 0.4)]), 3)
    0.25
    """
    _check_polygon(workspace)
    state = check_points(points, what="points", dimensions=2)
    return max(walls.room(walls.coordinates(state)) for walls in _pairs_of_walls(workspace))


def _draw_together(
    pairs: Sequence[_Walls], points: Points
) -> tuple[list[_Shift], Points, NDArray[np.float64]]:
    """Return shifts that draw particles together until they have room at some pair of walls, the
    positions after them up to a translation, and the room at each pair, which is 0 if they never
    have room.
    """
    at_wall = {
        walls.numbers[axis]: (walls, axis)
        # the last pair that is kept is the one whose walls are nearest to a right angle
        for walls in sorted(pairs, key=lambda walls: abs(_sine(walls.axes)))
        for axis in (0, 1)
    }
    shifts: list[_Shift] = []
    state, stalled, rng = points, 0, np.random.default_rng(0)
    for _ in range(_DRAWN):
        rooms = np.array([walls.room(walls.coordinates(state)) for walls in pairs])
        if rooms.any():
            break
        choices = [
            choice for at in at_wall.values() if (choice := _drawing_shift(*at, state)) is not None
        ]
        if not choices:
            break
        if not stalled:
            after, shift = min(
                ((_after(shift, state), shift) for shift, _ in choices),
                key=lambda pair: float(np.sum(np.var(pair[0], axis=0))),
            )
            if np.sum(np.var(after, axis=0)) > 0.999 * np.sum(np.var(state, axis=0)):
                stalled = 3  # some shifts at random lead out of here
        if stalled:
            shift, (low, high) = choices[rng.integers(len(choices))]
            shift = shift._replace(amount=float(rng.uniform(low, high)))
            after, stalled = _after(shift, state), stalled - 1
        shifts.append(shift)
        state = after
    return shifts, state, rooms


def _drawing_shift(
    walls: _Walls, axis: int, points: Points
) -> tuple[_Shift, tuple[float, float]] | None:
    """Return the shift along a wall by one contact that brings the particles there nearest to the
    others, with the least and the largest possible amount, or None if there is none.
    """
    coordinates = walls.coordinates(points)
    along, across = coordinates[:, axis], coordinates[:, 1 - axis]
    touching = across - across.min() <= 1e-12
    if touching.all():
        return None
    low, high = _shift_range(walls, axis, along, across, touching)
    if low > high:
        return None
    amount = float(along[~touching].mean() - along[touching].mean())
    members = frozenset(np.flatnonzero(touching).tolist())
    return _Shift(walls, axis, members, float(np.clip(amount, low, high))), (low, high)


def _after(shift: _Shift, points: Points) -> Points:
    """Return positions after a shift, up to a translation."""
    walls = shift.walls
    after: Points = walls.origin + shift.apply(walls.coordinates(points)) @ walls.axes
    return after


def _sine(axes: Points) -> float:
    return float(axes[0, 0] * axes[1, 1] - axes[0, 1] * axes[1, 0]) / float(
        np.prod(np.linalg.norm(axes, axis=1))
    )


def _shift_range(
    walls: _Walls, axis: int, along: Points, across: Points, touching: NDArray[np.bool_]
) -> tuple[float, float]:
    """Return the least and the largest shift along a wall by one contact."""
    across = across - across.min()
    low, high = walls.places(axis, along[touching], across[touching])
    others_low, others_high = walls.places(axis, along[~touching], across[~touching])
    others_low, others_high = others_low + _OFF_WALLS, others_high - _OFF_WALLS
    # all are moved to the contact by x, and the others then by the shift in the other direction
    least, most = max(low, others_low), min(high, others_high)
    if least > most:
        return 0.0, -1.0
    return least - others_high, most - others_low


def _peel(
    coordinates: Points, walls: _Walls, step: float, ranks: Sequence[int] | None
) -> tuple[list[_Shift], Points, list[int]]:
    """Return the shifts that peel a configuration, the configuration after them, and the particles
    in the order in which they are peeled.

    With ``ranks``, the heights at the end are in their order; by default, in the order of taking.
    """
    state = coordinates
    shifts: list[_Shift] = []
    order: list[int] = []
    base = float(state[:, 1].max()) + step
    remaining = set(range(len(state)))
    while remaining:
        lowest = min(state[k, 1] for k in remaining)
        level = frozenset(k for k in remaining if state[k, 1] - lowest <= 1e-12)
        particle = min(level, key=lambda k: state[k, 0])
        leftmost = float(state[:, 0].min()) - step
        shift_left = _Shift(walls, 0, level, leftmost - float(state[particle, 0]))
        state = shift_left.apply(state)
        rank = len(order) if ranks is None else ranks[particle]
        height = base + step * rank - float(state[particle, 1])
        shift_up = _Shift(walls, 1, frozenset([particle]), height)
        state = shift_up.apply(state)
        shifts += [shift_left, shift_up]
        order.append(particle)
        remaining.remove(particle)
    return shifts, state, order


def _merge(shifts: Sequence[_Shift]) -> list[_Shift]:
    """Return shifts without successive shifts of the same particles along the same wall."""
    merged: list[_Shift] = []
    for shift in shifts:
        last = merged[-1] if merged else None
        if last is not None and last[:3] == shift[:3]:
            merged[-1] = last._replace(amount=last.amount + shift.amount)
        else:
            merged.append(shift)
    return merged


def rearrange(
    workspace: ConvexWorkspace, start: ArrayLike, goal: ArrayLike, *, push: float = 0.0
) -> Points:
    """Return moves that bring particles from a start to a goal in a convex polygon, by the proof of
    theorem 2 and a search where particles have no room; shape (moves, 2).

    The plan is far from the shortest one, and has more moves the less room the particles have. The
    moves aim at exact contacts, and are checked by simulation.

    Parameters
    ----------
    workspace : ConvexWorkspace
        A convex polygon, whose walls hold particles (infinite friction).
    start, goal : array_like of float, shape (n, 2)
        Positions of the particles, off the walls and pairwise different.
    push : float
        How far moves to a wall and along it lead into the wall, as a fraction of the workspace's
        size. With 0, contacts are exact, and so is the end. The end is off by up to this fraction
        for each move.

    Raises
    ------
    InvalidInputError
        If the workspace is no polygon, if a position lies on a wall or outside, if two particles
        are at the same place, if the start or the goal has a room of less than .001 and the search
        finds none, or if the plan would have more than 5000 moves.

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
    start_state, goal_state = ends["start"], ends["goal"]
    if start_state.shape != goal_state.shape:
        raise InvalidInputError(
            f"goal: expected {len(start_state)} positions, got {len(goal_state)}"
        )
    moves = _moves(
        workspace,
        start_state,
        _shifts(workspace, start_state, goal_state),
        goal_state,
        push * workspace.size,
    )
    missed = float(np.abs(ContactWorld(workspace).final(start_state, moves) - goal_state).max())
    if missed > (1e-7 + push * len(moves)) * workspace.size:
        raise InvalidInputError(
            "start and goal: expected particles that touch a wall together, or apart by more than"
            " the contact tolerance; the plan misses by"
            f" {missed:.2g}"
        )
    return moves


def _shifts(workspace: ConvexWorkspace, start: Points, goal: Points) -> list[_Shift]:
    """Return the shifts of the proof of theorem 2."""
    pairs = _pairs_of_walls(workspace)
    drawn = {
        what: _draw_together(pairs, points) for what, points in (("start", start), ("goal", goal))
    }
    for what, (_, _, rooms) in drawn.items():
        if not rooms.any():
            raise InvalidInputError(
                f"{what}: expected particles that can be drawn together until their bounding"
                " parallelogram along two walls has room at both; these have none"
            )
    shifts, state, rooms = drawn["start"]
    apart, end, end_rooms = drawn["goal"]
    common_rooms = np.minimum(rooms, end_rooms)
    best = int((common_rooms if common_rooms.any() else end_rooms).argmax())
    walls, room = pairs[best], float((common_rooms if common_rooms.any() else end_rooms)[best])
    if (
        not common_rooms.any()
    ):  # peel the start at its own walls until it has that room at the goal's
        own = pairs[int(rooms.argmax())]
        small = float(rooms.max()) / (20 * len(start))
        while True:
            own_peel, peeled, _ = _peel(own.coordinates(state), own, small, None)
            peeled = own.origin + peeled @ own.axes
            if walls.has_room(np.ptp(walls.coordinates(peeled), axis=0) + room):
                break
            small /= 2
        shifts, state = [*shifts, *own_peel], peeled
    step = room / (20 * len(start))
    goal_peel, _, order = _peel(walls.coordinates(end), walls, step, None)
    ranks = np.argsort(order).tolist()
    first_peel, coordinates, _ = _peel(walls.coordinates(state), walls, step, ranks)
    second_peel, _, _ = _peel(coordinates, walls, step, ranks)
    reversed_shifts = [
        shift._replace(amount=-shift.amount) for shift in reversed([*apart, *goal_peel])
    ]
    return _merge([*shifts, *first_peel, *second_peel, *reversed_shifts])


def _moves(
    workspace: ConvexWorkspace,
    start: Points,
    shifts: Sequence[_Shift],
    goal: Points,
    push: float,
) -> Points:
    """Return the moves that carry out shifts, and then lead to the goal."""
    world, state = ContactWorld(workspace), np.array(start, order="C")
    moves: list[Points] = []

    def go(move: Points) -> None:
        moves.append(move)
        world.advance(state, np.ascontiguousarray(move))  # in place

    pressed = -1
    for walls, axis, members, amount in shifts:
        touching = np.array([k in members for k in range(len(state))])
        remaining = amount
        while remaining and not touching.all():  # all together are not shifted relative to any
            if len(moves) > _MOST_MOVES:
                raise InvalidInputError(
                    f"start and goal: expected a plan of at most {_MOST_MOVES} moves; the"
                    " particles have too little room"
                )
            coordinates = walls.coordinates(state)
            along, across = coordinates[:, axis], coordinates[:, 1 - axis]
            # the others pass from one side of the held particles to the other only as far as
            # the walls let them: what is left of the shift follows after another contact
            step = float(np.clip(remaining, *_shift_range(walls, axis, along, across, touching)))
            remaining = 0.0 if step == remaining else remaining - step
            places = np.concatenate([along, along[~touching] - step])
            depths = np.concatenate([across, across[~touching]]) - across.min()
            approach = np.empty(2)
            approach[axis], approach[1 - axis] = (
                np.mean(walls.places(axis, places, depths)),
                -across.min(),
            )
            if walls.numbers[axis] == pressed:  # off the wall, which would hold the particles
                lift = np.zeros(2)
                lift[1 - axis] = walls.lift(state, 1 - axis) / 2
                go(lift @ walls.axes)
                approach -= lift
            pressed = walls.numbers[axis]
            into = -push * walls.normals[pressed]
            go(approach @ walls.axes + into)
            adjustment = np.zeros(2)
            adjustment[axis] = -step
            go(adjustment @ walls.axes + into)
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
    before = check_points(start, what="start", dimensions=2)
    after = check_points(goal, what="goal", dimensions=2, count=len(before))
    return all(_is_clipped(x, y) for x, y in zip(before.T, after.T, strict=True))


def _is_clipped(before: Points, after: Points) -> bool:
    """Return whether clip(before, a, b) + c equals ``after`` for some a <= b and c.

    If any clip does, one does that leaves a particle where it is.
    """
    tolerance = 1e-9 * max(float(np.ptp(before)), 1e-300)
    return any(
        np.abs(np.clip(before, after.min() - c, after.max() - c) + c - after).max() <= tolerance
        for c in after - before
    )
