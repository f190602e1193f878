"""Cycles of two moves: how a wall contact changes the position difference Δ of two particles.

The position difference Δ is the position of particle 2 minus the position of particle 1. The first move of a cycle brings one
particle, the toucher, into contact with a wall. The second move of a cycle displaces the other particle while the wall holds the
toucher. Moves without wall contact do not change the position difference Δ.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_points
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.steering.workspaces.convex import ConvexWorkspace
from shoal.steering.workspaces.convex_geometry import Points, clipped, hull


@dataclass(frozen=True)
class Crossing:
    """A cycle of two moves: the toucher moves to a wall, and then the other particle moves while the wall holds the toucher.

    Parameters
    ----------
    toucher : int
        The particle that touches the wall, 1 or 2.
    wall : int
        Index of the polygon's side that holds the toucher, or -1 for the round wall of a disk.
    first, last : ndarray of float64, shape (2,)
        Ends of the section of the wall that the toucher may touch.
    contact : ndarray of float64, shape (2,)
        Midpoint of the section from ``first`` to ``last``.
    slack : float
        Margin of feasibility, which is 0 at the boundary of the set of reachable position differences. For a polygon, the margin is
        a length, as a fraction of the workspace's size. For a disk, the margin is half of the angle between ``first`` and ``last``,
        in radians.
    """

    toucher: int
    wall: int
    first: Points
    last: Points
    contact: Points
    slack: float

    def moves(self, points: ArrayLike, change: ArrayLike) -> Points:
        """Return the two moves, shape (2, 2), that change the position difference Δ by ``change``.

        The particles start at ``points``, away from all walls.
        """
        start = check_points(points, what="points", dimensions=2, count=2)
        sign = 1.0 if self.toucher == 1 else -1.0
        return np.stack([self.contact - start[self.toucher - 1], sign * np.asarray(change, dtype=np.float64)])


def reached_in_two_moves(workspace: ConvexWorkspace, before: ArrayLike, after: ArrayLike) -> Crossing | None:
    """Return a cycle of two moves that changes the position difference from ``before`` to ``after``, or None if no cycle exists.

    If several cycles exist, the function returns the cycle with the largest margin of feasibility (`Crossing.slack`).

    Parameters
    ----------
    workspace : ConvexWorkspace
        A polygon or a disk.
    before, after : array_like of float, shape (2,)
        Position differences before and after the cycle: the position of particle 2 minus the position of particle 1.

    Raises
    ------
    InvalidInputError
        If the workspace is neither a polygon nor a disk, or if ``before`` or ``after`` is not the difference of two points in the
        workspace.

    Notes
    -----
    Source: paper W, algorithms 2 and 3, corrected. Let N be the inward normal of a polygon's side. Let the sign σ be 1 if particle
    1 touches the side, and -1 if particle 2 touches the side. A cycle at this side needs ``0 <= σN·after <= σN·before`` and
    ``σN·before > 0``. It also needs a point c of the side for which both ``c + σ before`` and ``c + σ after`` lie in the workspace.
    On a disk around the origin, a contact c of particle 1 needs ``c·before <= -|before|²/2``, ``c·after <= -|after|²/2`` and
    ``c·(after - before) >= 0``.

    Examples
    --------
    >>> from shoal.steering import ContactWorld, polygon
    >>> square = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])
    >>> crossing = reached_in_two_moves(square, (0.5, 0.0), (0.25, 0.25))
    >>> start = [(0.25, 0.5), (0.75, 0.5)]
    >>> _, _, end = ContactWorld(square).play(start, crossing.moves(start, (-0.25, 0.25)))
    >>> (end[1] - end[0]).tolist()
    [0.25, 0.25]
    >>> reached_in_two_moves(square, (0.5, 0.0), (0.75, 0.0)) is None
    True
    """
    start, goal = (_check_difference(workspace, value, what) for value, what in ((before, "before"), (after, "after")))
    crossings = _disk_crossings(workspace, start, goal) if workspace.round else _polygon_crossings(workspace, start, goal)
    return max(crossings, key=lambda crossing: crossing.slack, default=None)


def _check_difference(workspace: ConvexWorkspace, value: ArrayLike, what: str) -> Points:
    space = workspace.differences
    difference = check_points([value], what=what, dimensions=2, count=1)[0]
    if not space.contains(difference):
        raise InvalidInputError(
            f"{what}: expected the difference of two points of the {workspace.kind}, got {tuple(difference.tolist())}"
        )
    return np.asarray(difference)


def _polygon_crossings(workspace: ConvexWorkspace, before: Points, after: Points) -> list[Crossing]:
    crossings = []
    corners, ends = workspace.vertices, np.roll(workspace.vertices, -1, axis=0)
    for toucher, sign in ((1, 1.0), (2, -1.0)):
        depth = sign * (workspace.normals @ before)
        target = sign * (workspace.normals @ after)
        low, high = toucher_shares(workspace, (sign * before, sign * after))
        lengths = np.hypot(*(ends - corners).T)
        room = np.minimum(np.minimum(target, depth - target), (high - low) * lengths)
        for wall in np.flatnonzero((depth > 0) & (room >= 0)):
            first, last = (corners[wall] + share * (ends[wall] - corners[wall]) for share in (low[wall], high[wall]))
            crossings.append(Crossing(toucher, int(wall), first, last, (first + last) / 2, float(room[wall]) / workspace.size))
    return crossings


def toucher_shares(workspace: ConvexWorkspace, shifts: Sequence[Points]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the part of each side of a polygon from which every vector of ``shifts`` leads to a point of the polygon.

    The two arrays of the result hold the starts and the ends of the parts, as fractions of the sides' lengths. For a side without
    such a part, the end is smaller than the start.
    """
    corners = workspace.vertices
    along = np.roll(corners, -1, axis=0) - corners
    low, high = np.zeros(len(corners)), np.ones(len(corners))
    rates = along @ workspace.normals.T  # (side, wall): change of the distance to each wall along the side
    flat = np.abs(rates) <= 1e-14 * workspace.size
    for shift in shifts:
        clear = workspace.wall_distances(corners + shift)
        with np.errstate(divide="ignore", invalid="ignore"):
            limits = -clear / rates
        low = np.maximum(low, np.max(np.where(~flat & (rates > 0), limits, 0.0), axis=1))
        high = np.minimum(high, np.min(np.where(~flat & (rates < 0), limits, 1.0), axis=1))
        # A wall parallel to the side has a constant distance. The caller has checked the side's own normal.
        lost = np.min(np.where(flat, clear, 0.0), axis=1) < -1e-12 * workspace.size
        high = np.where(lost, -1.0, high)
    return low, high


def _disk_crossings(workspace: ConvexWorkspace, before: Points, after: Points) -> list[Crossing]:
    angles = contact_angles(workspace.radius, before, after)
    if angles is None:
        return []
    first, last, slack = angles
    points = [workspace.center + workspace.radius * np.array([np.cos(a), np.sin(a)]) for a in (first, last, (first + last) / 2)]
    return [Crossing(1, -1, points[0], points[1], points[2], slack)]


def contact_angles(radius: float, before: Points, after: Points) -> tuple[float, float, float] | None:
    """Return start, end and half-width (in radians) of the arc on which particle 1 can touch a disk's wall, or None if it is empty.

    From each contact on the arc, the vectors ``before`` and ``after`` both lead to points inside the disk, and the wall holds
    particle 1 while the position difference changes from ``before`` to ``after``. A contact of particle 2 has the same effect as a
    contact of particle 1 on the opposite side.
    """
    arcs = [(_angle(-delta), np.arccos(np.clip(np.hypot(*delta) / (2 * radius), -1, 1))) for delta in (before, after)]
    if not np.any(before):
        return None  # both particles touch at once
    if np.any(after != before):
        arcs.append((_angle(after - before), pi / 2))
    center, half = arcs[0]
    low, high = -half, half
    for other, width in arcs[1:]:
        turn = (other - center + pi) % (2 * pi) - pi
        low, high = max(low, turn - width), min(high, turn + width)
    # An arc is at most half a turn, so two arcs intersect in one piece, which the shorter turn finds.
    return (center + low, center + high, float(high - low) / 2) if high >= low else None


def _angle(vector: Points) -> float:
    return float(np.arctan2(vector[1], vector[0]))


def two_move_pieces(workspace: ConvexWorkspace, before: ArrayLike) -> list[Points]:
    """Return convex polygons for drawing; their union is the set of position differences that two moves reach.

    Each piece is a float64 array of shape (n, 2). For a polygon, the function returns one piece for each pair of a side and a
    particle that can touch the side. For a disk, the function returns one piece for each sampled contact.

    Raises
    ------
    InvalidInputError
        If the workspace is not plane, or if ``before`` is not the difference of two points in the workspace.
    """
    start = _check_difference(workspace, before, "before")
    return _disk_pieces(workspace.radius, start) if workspace.round else _polygon_pieces(workspace, start)


def _polygon_pieces(workspace: ConvexWorkspace, before: Points) -> list[Points]:
    pieces = []
    corners, ends = workspace.vertices, np.roll(workspace.vertices, -1, axis=0)
    for sign in (1.0, -1.0):
        low, high = toucher_shares(workspace, (sign * before,))
        for wall in range(len(corners)):
            depth = sign * float(workspace.normals[wall] @ before)
            if depth <= 0 or high[wall] < low[wall]:
                continue
            slab = clipped(corners, workspace.normals[wall], float(workspace.offsets[wall]) + depth)
            contacts = [corners[wall] + share * (ends[wall] - corners[wall]) for share in (low[wall], high[wall])]
            sums = np.concatenate([sign * (slab - contact) for contact in contacts])
            pieces.append(hull(sums))
    return pieces


def _disk_pieces(radius: float, before: Points, *, contacts: int = 181, corners: int = 60) -> list[Points]:
    distance = float(np.hypot(*before))
    if distance == 0:
        return []
    half = float(np.arccos(np.clip(distance / (2 * radius), -1, 1)))
    pieces = []
    for angle in np.linspace(_angle(-before) - half, _angle(-before) + half, contacts):
        contact = radius * np.array([np.cos(angle), np.sin(angle)])
        depth = -float(before @ contact) / radius
        chord = float(np.arccos(np.clip(1 - depth / radius, -1, 1)))
        around = np.linspace(angle - chord, angle + chord, corners)
        piece = radius * np.stack([np.cos(around), np.sin(around)], axis=1) - contact
        pieces.append(piece)
    return pieces
