"""Delta space: the differences of two particles that few moves reach (papers S and W)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import pi

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_integer, check_kind, check_number, check_points
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import angles_of, unit_vectors
from shoal.steering.kernels.reach import (
    FLAT,
    SAME,
    WallSamples,
    piece_radii,
    star_depths,
    star_radii,
)
from shoal.steering.planners.chains import ChainQuery, kinds_of
from shoal.steering.workspaces.convex import (
    ConvexWorkspace,
    Points,
    clip_polygon,
    disk,
    hull,
    signed_area,
)
from shoal.steering.workspaces.walls import normalize_walls


@dataclass(frozen=True)
class Crossing:
    """A cycle of two moves: the toucher moves to a wall, and then the other particle moves while
    the wall holds the toucher.

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
        Margin of feasibility, which is 0 at the boundary of the set of reachable position
        differences. For a polygon, the margin is a length, as a fraction of the workspace's size.
        For a disk, the margin is half of the angle between ``first`` and ``last``, in radians.
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
        return np.stack(
            [self.contact - start[self.toucher - 1], sign * np.asarray(change, dtype=np.float64)]
        )


def reached_in_two_moves(
    workspace: ConvexWorkspace, before: ArrayLike, after: ArrayLike
) -> Crossing | None:
    """Return a cycle of two moves that changes the position difference from ``before`` to
    ``after``, or None if no cycle exists.

    If several cycles exist, the function returns the cycle with the largest margin of feasibility
    (`Crossing.slack`).

    Parameters
    ----------
    workspace : ConvexWorkspace
        A polygon or a disk.
    before, after : array_like of float, shape (2,)
        Position differences before and after the cycle: the position of particle 2 minus the
        position of particle 1.

    Raises
    ------
    InvalidInputError
        If the workspace is neither a polygon nor a disk, or if ``before`` or ``after`` is not the
        difference of two points in the workspace.

    Notes
    -----
    Source: paper W, algorithms 2 and 3, corrected. Let N be the inward normal of a polygon's side.
    Let the sign σ be 1 if particle 1 touches the side, and -1 if particle 2 touches the side. A
    cycle at this side needs ``0 <= σN·after <= σN·before`` and ``σN·before > 0``. It also needs a
    point c of the side for which both ``c + σ before`` and ``c + σ after`` lie in the workspace. On
    a disk around the origin, a contact c of particle 1 needs ``c·before <= -|before|²/2``,
    ``c·after <= -|after|²/2`` and ``c·(after - before) >= 0``.

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
    check_kind(workspace, ConvexWorkspace, what="workspace")
    start, goal = (
        _check_difference(workspace, value, what)
        for value, what in ((before, "before"), (after, "after"))
    )
    crossings = (
        _disk_crossings(workspace, start, goal)
        if workspace.round
        else _polygon_crossings(workspace, start, goal)
    )
    return max(crossings, key=lambda crossing: crossing.slack, default=None)


def _check_difference(workspace: ConvexWorkspace, value: ArrayLike, what: str) -> Points:
    space = workspace.differences
    difference = check_points([value], what=what, dimensions=2, count=1)[0]
    if not space.contains(difference):
        raise InvalidInputError(
            f"{what}: expected the difference of two points of the {workspace.kind}, got"
            f" {tuple(difference.tolist())}"
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
        slack = np.minimum(np.minimum(target, depth - target), (high - low) * lengths)
        for wall in np.flatnonzero((depth > 0) & (slack >= 0)):
            first, last = (
                corners[wall] + share * (ends[wall] - corners[wall])
                for share in (low[wall], high[wall])
            )
            crossings.append(
                Crossing(
                    toucher,
                    int(wall),
                    first,
                    last,
                    (first + last) / 2,
                    float(slack[wall]) / workspace.size,
                )
            )
    return crossings


def toucher_shares(
    workspace: ConvexWorkspace, shifts: Sequence[Points]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the part of each side of a polygon from which every vector of ``shifts`` leads to a
    point of the polygon.

    The two arrays of the result hold the starts and the ends of the parts, as fractions of the
    sides' lengths. For a side without such a part, the end is smaller than the start.
    """
    corners = workspace.vertices
    along = np.roll(corners, -1, axis=0) - corners
    low, high = np.zeros(len(corners)), np.ones(len(corners))
    # (side, wall): change of the distance to each wall along the side
    rates = along @ workspace.normals.T
    flat = np.abs(rates) <= 1e-14 * workspace.size
    for shift in shifts:
        clear = workspace.wall_distances(corners + shift)
        with np.errstate(divide="ignore", invalid="ignore"):
            limits = -clear / rates
        low = np.maximum(low, np.max(np.where(~flat & (rates > 0), limits, 0.0), axis=1))
        high = np.minimum(high, np.min(np.where(~flat & (rates < 0), limits, 1.0), axis=1))
        # A wall parallel to the side has a constant distance. The caller has checked the side's own
        # normal.
        lost = np.min(np.where(flat, clear, 0.0), axis=1) < -1e-12 * workspace.size
        high = np.where(lost, -1.0, high)
    return low, high


def _disk_crossings(workspace: ConvexWorkspace, before: Points, after: Points) -> list[Crossing]:
    angles = contact_angles(workspace.radius, before, after)
    if angles is None:
        return []
    first, last, slack = angles
    points = [
        workspace.center + workspace.radius * unit_vectors(a)
        for a in (first, last, (first + last) / 2)
    ]
    return [Crossing(1, -1, points[0], points[1], points[2], slack)]


def contact_angles(
    radius: float, before: Points, after: Points
) -> tuple[float, float, float] | None:
    """Return start, end and half-width (in radians) of the arc on which particle 1 can touch a
    disk's wall, or None if it is empty.

    From each contact on the arc, the vectors ``before`` and ``after`` both lead to points inside
    the disk, and the wall holds particle 1 while the position difference changes from ``before`` to
    ``after``. A contact of particle 2 has the same effect as a contact of particle 1 on the
    opposite side.
    """
    # |c + delta| <= r for a contact c with |c| = r: its angle to -delta has a cosine of |delta| / 2r
    # or more
    arcs = [
        (_angle(-delta), np.arccos(np.clip(np.hypot(*delta) / (2 * radius), -1, 1)))
        for delta in (before, after)
    ]
    if not np.any(before):
        return None  # both particles touch at once
    if np.any(after != before):
        arcs.append((_angle(after - before), pi / 2))
    center, half = arcs[0]
    low, high = -half, half
    for angle, width in arcs[1:]:
        turn = (angle - center + pi) % (2 * pi) - pi
        low, high = max(low, turn - width), min(high, turn + width)
    # An arc is at most half a turn, so two arcs intersect in one piece, which the shorter turn
    # finds.
    return (center + low, center + high, float(high - low) / 2) if high >= low else None


def _angle(vector: Points) -> float:
    return float(np.arctan2(vector[1], vector[0]))


def two_move_pieces(workspace: ConvexWorkspace, before: ArrayLike) -> list[Points]:
    """Return convex polygons for drawing; their union is the set of position differences that two
    moves reach.

    Each piece is a float64 array of shape (n, 2). For a polygon, the function returns one piece for
    each pair of a side and a particle that can touch the side. For a disk, the function returns one
    piece for each sampled contact.

    Raises
    ------
    InvalidInputError
        If the workspace is not plane, or if ``before`` is not the difference of two points in the
        workspace.
    """
    start = _check_difference(workspace, before, "before")
    return (
        _disk_pieces(workspace.radius, start)
        if workspace.round
        else _polygon_pieces(workspace, start)
    )


def _polygon_pieces(workspace: ConvexWorkspace, before: Points) -> list[Points]:
    pieces = []
    corners, ends = workspace.vertices, np.roll(workspace.vertices, -1, axis=0)
    for sign in (1.0, -1.0):
        low, high = toucher_shares(workspace, (sign * before,))
        for wall in range(len(corners)):
            depth = sign * float(workspace.normals[wall] @ before)
            if depth <= 0 or high[wall] < low[wall]:
                continue
            slab = clip_polygon(
                corners, workspace.normals[wall], float(workspace.offsets[wall]) + depth
            )
            contacts = [
                corners[wall] + share * (ends[wall] - corners[wall])
                for share in (low[wall], high[wall])
            ]
            sums = np.concatenate([sign * (slab - contact) for contact in contacts])
            pieces.append(hull(sums))
    return pieces


def _disk_pieces(
    radius: float, before: Points, *, contacts: int = 181, corners: int = 60
) -> list[Points]:
    distance = float(np.hypot(*before))
    if distance == 0:
        return []
    half = float(np.arccos(np.clip(distance / (2 * radius), -1, 1)))
    pieces = []
    for angle in np.linspace(_angle(-before) - half, _angle(-before) + half, contacts):
        contact = radius * unit_vectors(angle)
        depth = -float(before @ contact) / radius
        chord = float(np.arccos(np.clip(1 - depth / radius, -1, 1)))
        around = np.linspace(angle - chord, angle + chord, corners)
        outline = radius * unit_vectors(around) - contact
        pieces.append(outline)
    return pieces


DIRECTIONS = 720
_LEVEL = 1e-12


@dataclass(frozen=True, eq=False)
class DiskReach:
    """The set of position differences Δ that two particles on a disk can reach with an even number
    of moves.

    The x axis points in the direction of the initial position difference Δ.

    Parameters
    ----------
    radius : float
        Radius of the disk, in any unit of length.
    distance : float
        Distance between the two particles at the start, in the same unit as ``radius``.
    moves : int
        Number of moves: 2, 4, 6, ...
    radii : ndarray of float64, shape (n,)
        For each of n directions, how far the set of position differences extends from the zero
        vector. The angles of the n directions are the midpoints of n equal intervals between 0 and
        π radians. The set is symmetrical about the x axis, so ``radii`` also holds for the negative
        angles.
    """

    radius: float
    distance: float
    moves: int
    radii: NDArray[np.float64]

    @property
    def workspace(self) -> ConvexWorkspace:
        """The disk as a workspace, with its centre at the origin."""
        return disk(self.radius)

    @property
    def before(self) -> NDArray[np.float64]:
        """The position difference Δ at the start; float64, shape (2,)."""
        return np.array([self.distance, 0.0])

    @property
    def outline(self) -> Points:
        """Points on the boundary of the set of position differences; float64, shape (2 n, 2) for n
        radii.
        """
        ahead = _ahead(len(self.radii))
        angles = np.concatenate([ahead, 2 * pi - ahead[::-1]])
        radii = np.concatenate([self.radii, self.radii[::-1]])
        return np.asarray(radii[:, None] * unit_vectors(angles))

    def contains(self, differences: ArrayLike) -> NDArray[np.bool_]:
        """Return for each position difference, shape (..., 2), whether the particles can reach it;
        bool, shape (...).
        """
        points = np.asarray(differences, dtype=np.float64)
        angles = np.abs(angles_of(points))
        return np.asarray(
            np.hypot(points[..., 0], points[..., 1])
            <= np.interp(angles, _ahead(len(self.radii)), self.radii)
        )

    def fraction(self) -> float:
        """Return the area of the reachable set divided by the area of the set of all position
        differences in the disk.
        """
        return float(np.mean(self.radii**2)) / (2 * self.radius) ** 2


MAX_MOVES = 10_000  # far more than any set of differences needs to fill the workspace


def check_moves(moves: int) -> int:
    """Return the number ``moves`` if it is even, at least 2 and at most `MAX_MOVES`, or raise
    InvalidInputError.
    """
    if check_integer(moves, what="moves", least=2, most=MAX_MOVES) % 2:
        raise InvalidInputError(f"moves: expected an even number, 2 or more, got {moves}")
    return int(moves)


def disk_reach(
    distance: float, *, moves: int, radius: float = 0.5, directions: int = DIRECTIONS
) -> list[DiskReach]:
    """Return the sets of position differences that two particles on a disk can reach after 2, 4,
    ..., ``moves`` moves.

    Particle 2 starts to the right of particle 1. If the initial position difference has another
    angle to the x axis, rotate the sets by this angle.

    Parameters
    ----------
    distance : float
        Distance between the particles at the start, above 0 and at most twice the radius of the
        disk.
    moves : int
        Number of moves, even and at least 2.
    radius : float
        Radius of the disk, in the same unit as ``distance``.
    directions : int
        Number of sampled contacts, and number of sampled directions of the position difference; at
        least 16.

    Raises
    ------
    InvalidInputError
        If a number is out of range.

    Notes
    -----
    Source: paper W, section IV.F and figures 8 and 9.

    Examples
    --------
    >>> [round(100 * reach.fraction(), 1) for reach in disk_reach(0.1, moves=6)]
    [6.3, 30.1, 55.8]
    """
    size = 2 * check_number(radius, what="radius", above=0)
    check_number(distance, what="distance", above=0, most=size)
    check_moves(moves)
    check_integer(directions, what="directions", least=16)
    ahead = _ahead(directions // 2)
    half = np.arccos(min(1.0, distance / size))
    # rotated by π: contacts lie on the side opposite to Δ
    contacts = np.linspace(-half, half, directions)
    depths = distance / size * np.cos(contacts)
    sets: list[DiskReach] = []
    for count in range(2, moves + 1, 2):
        if sets:
            contacts = np.linspace(-pi, pi, directions)
            depths = _deepest(ahead, sets[-1].radii / size, contacts)
        sets.append(DiskReach(radius, distance, count, size * _furthest(ahead, contacts, depths)))
    return sets


def _ahead(count: int) -> NDArray[np.float64]:
    """Return the angles of the directions to which the radii of a `DiskReach` belong, between 0 and
    π radians.
    """
    return pi * (np.arange(count) + 0.5) / count


def _furthest(
    ahead: NDArray[np.float64], contacts: NDArray[np.float64], depths: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how far the reachable set extends in each direction of ``ahead``, in diameters of the
    disk.

    For each contact, ``depths`` holds the largest depth of the other particle below the wall's
    tangent at the contact.
    """
    # length of each chord, and its inward component per unit of length
    slope = np.cos(ahead[:, None] - contacts)
    with np.errstate(divide="ignore", invalid="ignore"):
        allowed = np.where(slope > _LEVEL, depths / slope, 0.0)
    reached = np.where(slope > _LEVEL, np.minimum(slope, allowed), 0.0)
    # The longest extent is often between two contacts, where chord and depth limit it equally.
    excess = slope - allowed
    crossed = (
        (excess[:, :-1] * excess[:, 1:] < 0) & (slope[:, :-1] > _LEVEL) & (slope[:, 1:] > _LEVEL)
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(crossed, excess[:, :-1] / (excess[:, :-1] - excess[:, 1:]), 0.0)
    between = np.where(crossed, slope[:, :-1] + share * (slope[:, 1:] - slope[:, :-1]), 0.0)
    return np.asarray(np.maximum(reached.max(axis=1), between.max(axis=1)))


def _deepest(
    ahead: NDArray[np.float64], radii: NDArray[np.float64], contacts: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return, for each contact of one particle, the largest depth of the other particle below the
    wall's tangent at the contact.
    """
    around, far = np.concatenate([-ahead[::-1], ahead]), np.concatenate([radii[::-1], radii])
    slope = np.maximum(np.cos(around - contacts[:, None]), 0.0)
    return np.asarray((np.minimum(far, slope) * slope).max(axis=1))


_CLOSE = 1e-9
_RAYS = 2048  # equally spaced directions in which the outline of a `PolygonReach` has corners


@dataclass(frozen=True, eq=False)
class PolygonReach:
    """The set of position differences Δ that two particles in a polygon can reach with an even
    number of moves.

    Parameters
    ----------
    workspace : ConvexWorkspace
    before : ndarray of float64, shape (2,)
        The position difference Δ at the start.
    moves : int
        Number of moves: 2, 4, 6, ...
    contacts : ndarray of float64, shape (contacts, 2)
        Sample points on the walls, in counter-clockwise order.
    walls : ndarray of int64, shape (contacts,)
        Index of the wall on which each sample point in ``contacts`` lies.
    depths : ndarray of float64, shape (2, contacts)
        For each contact of one particle, the largest depth of the other particle below the wall of
        the contact, before the last two moves. Row 0 is for contacts of particle 1, and row 1 for
        contacts of particle 2. The depth is negative if the particle cannot come to the contact.
    """

    workspace: ConvexWorkspace
    before: Points
    moves: int
    contacts: Points
    walls: NDArray[np.int64]
    depths: NDArray[np.float64]

    def contains(self, differences: ArrayLike) -> NDArray[np.bool_]:
        """Return for each position difference, shape (..., 2), whether the particles can reach it;
        bool, shape (...).

        For two moves, the result is exact. For more than two moves, the result can be wrongly False
        near the boundary of the reachable set. The reason is that the method knows the depths only
        at sample points of the walls. Between two neighbouring sample points, the method uses the
        smaller of the two depths. The method `reaches` is exact for any number of moves.
        """
        points = np.asarray(differences, dtype=np.float64)
        lengths = np.hypot(points[..., 0], points[..., 1])
        with np.errstate(invalid="ignore"):
            ahead = np.where(lengths[..., None] > 0, points / lengths[..., None], (1.0, 0.0))
        radii = self._extents(ahead.reshape(-1, 2))[0].reshape(lengths.shape)
        return np.asarray(lengths <= radii + _CLOSE * self.workspace.size)

    def reaches(self, after: ArrayLike) -> bool:
        """Return whether the particles can reach the position difference ``after``; exact for any
        number of moves.

        The method tries all sequences of wall contacts, each by particle 1 or particle 2. Use the
        method for up to six moves only, because for n walls the computing time grows as ``(2 n) **
        (moves / 2)``.

        Raises
        ------
        InvalidInputError
            If ``after`` is not the difference of two points of the workspace.
        """
        goal = check_points([after], what="after", dimensions=2, count=1)[0]
        if not self.workspace.differences.contains(goal):
            raise InvalidInputError(
                "after: expected the difference of two points of the polygon, got"
                f" {tuple(goal.tolist())}"
            )
        walls = normalize_walls(self.workspace)
        start, end = (
            np.stack([-delta / 2, delta / 2]) / walls.scale for delta in (self.before, goal)
        )
        query = ChainQuery(walls, start, end, margin=0.0, push=0.0, rounds=np.empty(0))
        for cycles in range(1, self.moves // 2 + 1):
            touchers, on, _ = kinds_of(start, end, walls, cycles=cycles, push=0.0)
            if any(
                query.optimize(query.guess(cycles), *kind, enough=1e-12) < np.inf
                for kind in zip(touchers, on, strict=True)
            ):
                return True
        return False

    @cached_property
    def outline(self) -> Points:
        """Corners of the reachable set, counter-clockwise around the zero vector; float64, shape
        (n, 2).

        Straight lines connect the corners. They leave out a little of the set where its boundary
        is curved or has a corner between two of some 2,000 directions, and include nothing else.
        """
        from shapely import LinearRing

        rays, radii = self._star
        ring = LinearRing(radii[:, None] * rays).simplify(_CLOSE * self.workspace.size)
        return np.asarray(ring.coords)[:-1]

    @cached_property
    def _star(self) -> tuple[Points, NDArray[np.float64]]:
        """The directions of the corners of `outline` as unit vectors, counter-clockwise from the
        angle -π, and their distances from the zero vector; float64, shapes (n, 2) and (n,).
        """
        # Along the walls, the radius jumps.
        along = np.roll(self.workspace.vertices, -1, axis=0) - self.workspace.vertices
        rays = _rays(
            -pi + 2 * pi * (np.arange(_RAYS) + 0.5) / _RAYS,
            angles_of(np.concatenate([self.workspace.differences.vertices, along, -along])),
        )
        corners = _corners(self._extents(rays)[0][:, None] * rays)
        rays = _rays(angles_of(rays), angles_of(corners))
        radii, pieces = self._extents(rays)
        # Between two directions, a convex set of `star_radii` contains the line between its own
        # points. Where another set begins to extend further, the two lines cross.
        following = np.roll(np.arange(len(rays)), -1)
        change = np.flatnonzero(pieces != pieces[following])
        later = following[change]
        points = radii[:, None] * rays
        before, after = points[change], points[later]
        own_later = self._extents_of(rays[later], pieces[change])[:, None] * rays[later]
        other_earlier = self._extents_of(rays[change], pieces[later])[:, None] * rays[change]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = _across(other_earlier - before, after - other_earlier) / _across(
                own_later - before, after - other_earlier
            )
        share = np.clip(np.nan_to_num(share), 0.0, 1.0)
        crossing = before + share[:, None] * (own_later - before)
        length = np.hypot(*crossing.T)
        away = length > _CLOSE * self.workspace.size
        middle = rays[change] + rays[later]
        ahead = np.where(away[:, None], crossing, middle)
        ahead /= np.hypot(*ahead.T)[:, None]
        places = (change + 1) % len(rays)
        return (
            np.insert(rays, places, ahead, axis=0),
            np.insert(radii, places, np.where(away, length, 0.0)),
        )

    def _extents(self, rays: Points) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return how far the set extends along each unit vector, and the index of the convex set
        that extends so far, as in `star_radii`.

        Neighbouring contacts of equal depth have one convex set in common.
        """
        radii, pieces = np.empty(len(rays)), np.empty(len(rays), dtype=np.int64)
        star_radii(np.ascontiguousarray(rays), self._samples, self.depths, radii, pieces)
        firsts, lasts = self._runs
        contacts = pieces // 2
        first = firsts[contacts]
        shared = (pieces >= 0) & (lasts[first] > first) & (contacts + pieces % 2 <= lasts[first])
        return radii, np.where(shared, 2 * first + 1, pieces)

    def _extents_of(self, rays: Points, pieces: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return how far the convex set of each index extends along the unit vector in the same
        row.
        """
        firsts, lasts = self._runs
        numbers = np.arange(len(firsts))
        ends = np.where((firsts == numbers) & (lasts > numbers), lasts, numbers + 1)
        radii = np.empty(len(rays))
        piece_radii(rays, pieces, ends % len(self.contacts), self._samples, self.depths, radii)
        return radii

    @cached_property
    def _runs(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """For each contact, the first and the last contact of the neighbours on its wall with the
        same depth; int64, shape (2 contacts,), particle 1 first.
        """
        walls = np.concatenate([self.walls, self.walls + len(self.workspace.vertices)])
        depths = self.depths.ravel()
        begins = np.diff(walls, prepend=-1) != 0
        begins |= np.abs(np.diff(depths, prepend=-1.0)) > FLAT * self.workspace.size
        starts = np.flatnonzero(begins)
        run = np.cumsum(begins) - 1
        return starts[run], np.append(starts[1:], len(depths))[run] - 1

    @cached_property
    def _samples(self) -> WallSamples:
        """The walls and the sample points, as the kernels take them."""
        sides = len(self.workspace.vertices)
        return WallSamples(
            np.ascontiguousarray(self.workspace.vertices),
            np.ascontiguousarray(self.workspace.normals),
            self.workspace.offsets,
            self.contacts,
            np.searchsorted(self.walls, np.arange(sides + 1)),
        )

    def deepen(self) -> NDArray[np.float64]:
        """Return ``depths`` for the set of two more moves; float64, shape (2, contacts)."""
        rays, radii = self._star
        depths = np.empty_like(self.depths)
        star_depths(rays, radii, self._samples, depths[0])
        # The contacts of particle 2 see the differences with the opposite sign.
        half = -np.searchsorted(angles_of(rays), 0.0)
        opposite, lengths = np.roll(rays, half, axis=0), np.roll(radii, half)
        star_depths(-opposite, lengths, self._samples, depths[1])
        return np.where(depths > _CLOSE * self.workspace.size, depths, -1.0)

    def fraction(self) -> float:
        """Return the area of the reachable set divided by the area of the set of all position
        differences in the polygon.

        The reachable set is the polygon `outline`.
        """
        rays, radii = self._star
        area = signed_area(radii[:, None] * rays)
        return float(min(area / signed_area(self.workspace.differences.vertices), 1.0))


def _rays(*angles: NDArray[np.float64]) -> Points:
    """Return the unit vectors of all angles and of π, in ascending order and without doubles."""
    ordered = np.concatenate(angles)
    ordered = np.append(np.unique(ordered[np.abs(ordered) < pi - SAME]), pi)
    return unit_vectors(ordered[np.diff(ordered, prepend=-pi) > SAME])


def _corners(points: Points) -> Points:
    """Return where a closed outline through the points probably has corners: the crossing of the
    lines before and after each pair of neighbours, if it is between them as seen from zero.
    """
    previous, following, last = (np.roll(points, k, axis=0) for k in (1, -1, -2))
    before, after = points - previous, last - following
    turn = _across(before, after)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(turn != 0, _across(following - points, after) / turn, 0.0)
    corners = points + share[:, None] * before
    return corners[(_across(points, corners) > 0) & (_across(corners, following) > 0)]


def _across(a: Points, b: Points) -> NDArray[np.float64]:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def polygon_reach(
    workspace: ConvexWorkspace, before: ArrayLike, *, moves: int, contacts: int = 512
) -> list[PolygonReach]:
    """Return the sets of position differences that two particles in a polygon can reach after 2, 4,
    ..., ``moves`` moves.

    The computing time of a cycle is proportional to the number of sample points times the number of
    the polygon's sides and of some 2,000 directions.

    Parameters
    ----------
    workspace : ConvexWorkspace
        The polygon.
    before : array_like of float, shape (2,)
        The position difference Δ at the start.
    moves : int
        Number of moves, even and at least 2.
    contacts : int
        Number of sample points on the boundary of the polygon, but at least three on each side.

    Notes
    -----
    Source: paper W, section IV.C and figure 4, corrected.

    Examples
    --------
    >>> from shoal.steering import regular_polygon
    >>> sets = polygon_reach(regular_polygon(3), (0.2, 0.1), moves=6)
    >>> [round(100 * reach.fraction()) for reach in sets]
    [29, 100, 100]
    """
    if check_kind(workspace, ConvexWorkspace, what="workspace").kind != "polygon":
        raise InvalidInputError(f"reach: expected a polygon, got {workspace!r}")
    start = check_points([before], what="before", dimensions=2, count=1)[0]
    if not workspace.differences.contains(start):
        raise InvalidInputError(
            "before: expected the difference of two points of the polygon, got"
            f" {tuple(start.tolist())}"
        )
    check_moves(moves)
    points, walls = _sample_walls(
        workspace, start, check_integer(contacts, what="contacts", least=3)
    )
    depths = np.full((2, len(points)), -1.0)
    for row, sign in enumerate((1.0, -1.0)):
        depth = sign * (workspace.normals @ start)[walls]
        fits = workspace.contains(points + sign * start) & (depth > _CLOSE * workspace.size)
        depths[row] = np.where(fits, depth, -1.0)
    sets = [PolygonReach(workspace, start, 2, points, walls, depths)]
    for count in range(4, moves + 1, 2):
        deeper = sets[-1].deepen()
        sets.append(PolygonReach(workspace, start, count, points, walls, deeper))
    return sets


def _sample_walls(
    workspace: ConvexWorkspace, start: Points, contacts: int
) -> tuple[Points, NDArray[np.int64]]:
    """Return sample points on all sides, shape (n, 2), and the index of the side of each.

    They are equally spaced on a side, plus the ends of the start's contact range, where depths
    jump.
    """
    corners = workspace.vertices
    along = np.roll(corners, -1, axis=0) - corners
    jumps = np.concatenate(
        [np.stack(toucher_shares(workspace, (sign * start,))) for sign in (1.0, -1.0)]
    )
    even = np.linspace(0, 1, max(3, -(-contacts // len(corners))))
    shares = [np.unique(np.r_[even, row[(row > 0) & (row < 1)]]) for row in jumps.T]
    walls = np.repeat(np.arange(len(corners)), [len(share) for share in shares])
    return corners[walls] + np.concatenate(shares)[:, None] * along[walls], walls
