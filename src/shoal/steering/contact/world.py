"""Worlds of steering: particles that move with one shared input, stop at walls, slide along them
and leave them.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from itertools import combinations
from math import ceil, inf, sqrt
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_kind, check_number, check_points
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import cross, left_of
from shoal.steering.contact.clearance import PLANNED
from shoal.steering.kernels import contact as kernels
from shoal.steering.kernels import region_contact as region_kernels
from shoal.steering.workspaces.convex import TOUCH, ConvexWorkspace, Points
from shoal.steering.workspaces.region import Region

PUSHED = kernels.PUSHED


class SteeringWorld(ABC):
    """Base class of the simulated worlds of steering, in which one shared displacement moves all
    particles in a workspace.
    """

    workspace: Any
    friction: float

    @property
    def free_space(self) -> Any:
        """The set of possible positions of the particles' centres, as a workspace."""
        return self.workspace

    def initial(self, points: ArrayLike) -> Points:
        """Return ``points`` as the initial positions of the particles; float64, shape (n,
        dimensions).

        Raises
        ------
        InvalidInputError
            If a particle is outside the workspace, or two particles overlap.
        """
        return self.check_state(points, what="start")

    def check_state(self, points: ArrayLike, *, what: str) -> Points:
        """Return valid particle positions as float64, shape (n, dimensions), or raise
        InvalidInputError for invalid positions.
        """
        state: Points = self.free_space.check_inside(points, what=what)
        return state

    def step(self, points: ArrayLike, move: ArrayLike) -> Points:
        """Return the positions of particles after one straight move from ``points``; float64, shape
        (n, dimensions).

        Raises
        ------
        InvalidInputError
            If the move is not a vector of finite numbers.
        """
        dimensions = self.workspace.dimensions
        state = np.array(check_points(points, what="points", dimensions=dimensions), order="C")
        vector = check_points([move], what="move", dimensions=dimensions, count=1)[0]
        return self.advance(state, np.ascontiguousarray(vector))

    def play(self, points: ArrayLike, moves: ArrayLike) -> Points:
        """Return the positions of the particles at the start and after each move; float64, shape
        (moves + 1, n, dimensions).
        """
        d = self.workspace.dimensions
        vectors = np.asarray(moves, dtype=np.float64)
        vectors = check_points(
            vectors.reshape(-1, d) if vectors.size == 0 else vectors, what="moves", dimensions=d
        )
        states = [self.initial(points)]
        for move in vectors:
            states.append(self.advance(np.array(states[-1], order="C"), np.ascontiguousarray(move)))
        return np.array(states)

    def final(self, points: Points, moves: Points) -> Points:
        """Return the positions of the particles after all moves, float64, shape (n, dimensions),
        without checks of the input.
        """
        state = np.array(points, dtype=np.float64, order="C")
        for move in np.ascontiguousarray(moves):
            self.advance(state, move)
        return state

    def finals(self, points: Points, plans: Points) -> Points:
        """Return the same for several plans, each from its own positions; float64, shape (plans, n,
        dimensions).

        Parameters
        ----------
        points : ndarray of float64, shape (plans, n, dimensions)
        plans : ndarray of float64, shape (plans, moves, dimensions)
        """
        return np.stack([self.final(*each) for each in zip(points, plans, strict=True)])

    def are_held(self, points: ArrayLike, move: ArrayLike) -> NDArray[np.bool_]:
        """Return which particles a wall with infinite friction would hold at the start of ``move``;
        bool, shape (n,).
        """
        state = np.ascontiguousarray(
            check_points(points, what="points", dimensions=self.workspace.dimensions)
        )
        vector = check_points([move], what="move", dimensions=self.workspace.dimensions, count=1)[0]
        return np.array([self.is_held(point, vector) for point in state])

    @abstractmethod
    def advance(self, state: Points, move: Points) -> Points:
        """Apply the displacement ``move`` to the positions in the array ``state`` in place, without
        checks.
        """

    @abstractmethod
    def is_held(self, point: Points, move: Points) -> bool:
        """Return whether a wall holds a particle at ``point`` at the start of the displacement
        ``move``.
        """


@dataclass(frozen=True, eq=False)
class ContactWorld(SteeringWorld):
    """The dynamics of particles under one shared displacement, between walls with friction.

    With infinite friction, a particle stops at the first wall that it meets, and stays at this wall
    until the end of the straight move. If the displacement u satisfies ``N u <= 0``, a wall with
    the inward normal N holds each particle that touches the wall, even if u is parallel to the
    wall. In a corner, each wall alone can hold a particle. Particles without a radius do not stop
    each other.

    With finite friction, a particle that the displacement u pushes into a wall slides along the
    wall by ``|T u| - friction |N u|``, where N is the normal and T the tangent of the wall. If this
    number is negative, the particle does not slide.

    The displacement u moves a particle at the point p by ``g(p) u``. The gain ``g(p) = 1 + gradient
    (p - c)`` can describe, for example, that particles near a coil move faster. The point c is the
    centre of the workspace.

    Particles with a radius above 0 are spheres. The centre of a sphere stays at least one radius
    away from each wall. A moving sphere stops when it meets a stopped sphere.

    Parameters
    ----------
    workspace : ConvexWorkspace
    friction : float
        Coefficient of Coulomb friction, at least 0. With infinite friction, a particle that is
        pushed into a wall never slides.
    gradient : array_like of float, shape (dimensions,), optional
        Gradient of the gain (displacement of a particle divided by the input), per unit of length
        of the workspace.
    radius : float
        Radius of each particle, in the workspace's unit of length.
    touch : float
        Contact tolerance, as a fraction of the workspace's size: a particle at most this far from a
        wall touches the wall.
    pushed : float
        Fraction of the length of a move: a wall holds a particle that touches it unless the move
        leads off the wall by more.

    Raises
    ------
    InvalidInputError
        If a number is out of range, the gain is not positive everywhere, or a particle does not fit
        into the workspace; or if a radius above 0 is combined with finite friction or with
        ``gradient``.

    Notes
    -----
    Source: equation 1 in section III of paper W, and section VII.A of paper W for the gain. Finite
    friction, the linear gain and the radius of particles are extensions by Shoal.

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
    touch: float = TOUCH
    pushed: float = PUSHED

    def __post_init__(self) -> None:
        check_kind(self.workspace, ConvexWorkspace, what="workspace")
        check_number(self.friction, what="friction", least=0, finite=False)
        check_number(self.radius, what="particle radius", least=0)
        if self.radius and (self.friction < inf or self.gradient is not None):
            raise InvalidInputError(
                "particle radius: expected no friction coefficient and no gain, which only"
                " particles without a radius allow"
            )
        _ = self.free_space, self.gain  # raises an error if a particle does not fit

    @cached_property
    def free_space(self) -> ConvexWorkspace:
        """The set of possible positions of the particles' centres, as a workspace."""
        if not self.radius:
            return self.workspace
        return self.workspace.inset(self.radius, what="particle radius")

    @cached_property
    def gain(self) -> NDArray[np.float64]:
        """Coefficients (g, gx, gy, ...) of the gain, which is ``g + (gx, gy, ...) p`` at the point
        p.
        """
        d = self.workspace.dimensions
        if self.gradient is None:
            return np.asarray(np.eye(d + 1)[0])
        gradient = check_points([self.gradient], what="gain", dimensions=d, count=1)[0]
        reach = self.workspace.extent(gradient)
        if reach >= 1:
            raise InvalidInputError(
                "gain: expected a gain that is positive everywhere, got variations of"
                f" {100 * reach:.3g} % of its mean"
            )
        return np.concatenate([[1 - gradient @ self.workspace.middle], gradient])

    def check_state(self, points: ArrayLike, *, what: str) -> Points:
        """Return valid particle positions as float64, shape (n, dimensions), or raise
        InvalidInputError for invalid positions.
        """
        state: Points = self.workspace.check_inside(points, what=what)
        if self.radius:
            near = ~self.free_space.contains(state)
            if near.any():
                index = int(np.argmax(near))
                raise InvalidInputError(
                    f"{what}: expected points at least the particle radius of {self.radius:g} from"
                    f" the walls, got {float(self.workspace.depth(state[index])):.3g} at point"
                    f" {index + 1}"
                )
            away = (
                np.linalg.norm(state[:, None] - state[None], axis=-1)
                + np.eye(len(state)) * 4 * self.radius
            )
            if away.min() < 2 * self.radius * (1 - 1e-12):
                i, j = np.unravel_index(int(away.argmin()), away.shape)
                raise InvalidInputError(
                    f"{what}: expected particles that do not overlap, {2 * self.radius:g} apart or"
                    f" more, got {away.min():.3g} between points {i + 1} and {j + 1}"
                )
        return state

    @cached_property
    def walls(self) -> kernels.Walls:
        """The walls of the workspace, as arrays for the compiled functions."""
        space = self.free_space
        normals, circle = (
            np.ascontiguousarray(space.normals),
            np.array([*space.center, space.radius]),
        )
        near = float(self.workspace.size) * self.touch / kernels.TOUCH
        return kernels.Walls(
            normals, space.offsets, circle, near, float(self.friction), self.gain, self.pushed
        )

    def is_held(self, point: Points, move: Points) -> bool:
        """Return whether a wall holds a particle at ``point`` at the start of the displacement
        ``move``.
        """
        return bool(kernels.is_held(point, move, self.walls))

    def final(self, points: Points, moves: Points) -> Points:
        """Return the positions of the particles after all moves, float64, shape (n, dimensions),
        without checks of the input.
        """
        if self.radius or not len(moves):
            return super().final(points, moves)
        state: Points = self.finals(np.asarray(points)[None], np.asarray(moves)[None])[0]
        return state

    def finals(self, points: Points, plans: Points) -> Points:
        """Return the positions of the particles after all moves of each plan, without checks of the
        input.
        """
        if self.radius:
            return super().finals(points, plans)
        states = np.array(points, dtype=np.float64, order="C")
        kernels.advance_plans(
            states,
            np.ascontiguousarray(plans, dtype=np.float64),
            self.walls,
            np.empty(states.shape[2]),
        )
        return states

    def advance(self, state: Points, move: Points) -> Points:
        """Apply the displacement ``move`` to the positions in the array ``state`` in place, without
        checks.
        """
        spare = np.empty_like(move)
        if not self.radius:
            kernels.advance_plans(state[None], move[None, None], self.walls, spare)
            return state
        before = state.copy()
        shares = np.array([kernels.advance(point, move, self.walls, spare) for point in state])
        stop_at_others(before, move, shares, 2 * self.radius, state)
        return state


def stop_at_others(
    before: Points, move: Points, shares: NDArray[np.float64], apart: float, after: Points
) -> None:
    """Stop each sphere that collides with a stopped sphere, in the order of the collisions.

    Until a wall stops the first sphere, all spheres move by the same vector and cannot collide.
    ``shares`` holds, for each sphere, the fraction of the move after which a wall stopped the
    sphere, or 1 if no wall stopped it. The function changes the end positions ``after`` in place.
    """
    if shares.min() == shares.max():  # no sphere moves on after another has stopped
        return
    shares = shares.copy()
    length = float(move @ move)
    while length > 0:
        earliest, collider = 1.0, None
        for mover in range(len(before)):
            for stopped in np.flatnonzero(shares < shares[mover]):
                # Solve |before + share move - after[stopped]| = apart for the smaller share.
                gap = before[mover] - after[stopped]
                half, excess = float(gap @ move), float(gap @ gap) - apart * apart
                discriminant = half * half - length * excess
                if half >= 0 or discriminant < 0:
                    continue
                share = max((-half - np.sqrt(discriminant)) / length, 0.0)
                if max(share, shares[stopped]) < min(shares[mover], earliest):
                    earliest, collider = max(share, float(shares[stopped])), mover
        if collider is None:
            return
        shares[collider] = earliest
        after[collider] = before[collider] + earliest * move


@dataclass(frozen=True, eq=False)
class RegionWorld(SteeringWorld):
    """The dynamics of particles under one shared displacement, in a region of any shape whose walls
    hold particles.

    If the displacement u satisfies ``N u <= 0``, an edge with the inward normal N holds each
    particle that touches the edge. At a corner with less than 180 degrees of free space, each of
    the two edges alone can hold a particle. At a corner with more than 180 degrees of free space,
    such as most corners of obstacles, the two edges hold a particle only together, because
    otherwise the space in the direction of the displacement is free. During a straight move, a
    particle stops at the first edge that holds the particle, and stays at this edge until the end
    of the move. Particles do not collide with each other.

    With finite friction, a particle that is pushed into an edge slides along it as in a
    `ContactWorld`, and leaves the edge where it ends.

    Parameters
    ----------
    workspace : Region
    friction : float
        Coefficient of Coulomb friction, at least 0.
    touch : float
        Contact tolerance, as a fraction of the workspace's size: a particle at most this far from
        an edge touches the edge.
    pushed : float
        Fraction of the length of a move: an edge holds a particle that touches it unless the move
        leads off the edge by more.

    Notes
    -----
    Source: an extension by Shoal, after the outlook of paper W, section VIII. In a convex region,
    the dynamics follow equation 1 of paper W, section III.

    Examples
    --------
    >>> from shoal.steering import region
    >>> yard = region([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1, 1), (2, 1), (2, 2), (1, 2)]])
    >>> RegionWorld(yard).step([(0.5, 1.5), (0.5, 0.5)], (2.0, 0.0)).tolist()
    [[1.0, 1.5], [2.5, 0.5]]
    >>> RegionWorld(yard).step([(1.0, 1.0), (1.5, 1.0)], (0.25, -0.5)).tolist()
    [[1.25, 0.5], [1.75, 0.5]]
    """

    workspace: Region
    touch: float = TOUCH
    pushed: float = PUSHED
    friction: float = inf

    @cached_property
    def edges(self) -> region_kernels.Edges:
        """The edges of the region, as arrays for the compiled functions."""
        edges = np.ascontiguousarray(self.workspace.edges)
        along = edges[:, 2:] - edges[:, :2]
        lengths = np.hypot(*along.T)
        normals = left_of(along) / lengths[:, None]
        links = np.empty((len(edges), 2), dtype=np.int64)
        offset = 0
        for ring in self.workspace.rings:
            places = offset + np.arange(len(ring))
            links[places] = np.stack([np.roll(places, 1), np.roll(places, -1)], axis=1)
            offset += len(ring)
        before = along[links[:, 0]]
        reflex = cross(before, along) < 0
        size = float(self.workspace.size) * self.touch / TOUCH
        return region_kernels.Edges(
            edges,
            normals,
            lengths,
            links,
            reflex,
            size,
            _boxes_of_runs(edges),
            self.pushed,
            float(self.friction),
        )

    def is_held(self, point: Points, move: Points) -> bool:
        """Return whether an edge holds a particle at ``point`` at the start of the displacement
        ``move``.
        """
        return bool(region_kernels.is_held(point, move, self.edges))

    def final(self, points: Points, moves: Points) -> Points:
        """Return the positions of the particles after all moves, float64, shape (n, dimensions),
        without checks of the input.
        """
        state = np.array(points, dtype=np.float64, order="C")
        if len(moves):
            region_kernels.advance_plan(
                state, np.ascontiguousarray(moves, dtype=np.float64), self.edges
            )
        return state

    def advance(self, state: Points, move: Points) -> Points:
        """Apply the displacement ``move`` to the positions in the array ``state`` in place, without
        checks.
        """
        for point in state:
            region_kernels.advance(point, move, self.edges)
        return state


def _boxes_of_runs(edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the bounding box of each group of consecutive edges; float64, shape (groups, 4).

    The number of groups is about equal to the number of edges in a group.
    """
    runs = ceil(sqrt(len(edges)))
    length = -(-len(edges) // runs)
    ends = edges[np.minimum(np.arange(runs * length), len(edges) - 1)].reshape(runs, 2 * length, 2)
    return np.stack([ends.min(axis=1), ends.max(axis=1)], axis=2).reshape(runs, 4)


# relative to the size: lengths of a lift if there is no room for the clearance; the first length
# that takes no particle into another wall is used
RELEASE_LENGTHS = (1e-6, 1e-7, 2e-8)
RELEASED = 5e-9  # relative to a move's length: minimum distance away from a wall for a safe release
_STEEP = 0.01  # minimum slope of a lift


def touched_normals(
    workspace: ConvexWorkspace, point: Points, *, within: float = 2 * TOUCH
) -> Points:
    """Return the inward unit normals of the walls near a particle at ``point``; float64, shape
    (walls, d).

    A wall is near if its distance from the particle is at most ``within`` times the workspace's
    size.
    """
    near = within * workspace.size
    normals = workspace.normals[workspace.wall_distances(point) <= near]
    if workspace.round and float(workspace.circle_distance(point)) <= near:
        inward = np.zeros(len(point))
        inward[:2] = workspace.center - point[:2]
        normals = np.vstack([normals, inward / np.linalg.norm(inward)])
    return normals


def is_released(
    workspace: ConvexWorkspace, points: Points, move: Points, *, clearance: float = 0.0
) -> bool:
    """Return whether a move leads each particle away from all walls that the particle touches, with
    a safety margin.

    Walls within ``clearance`` times the size count as touched, so that the move does not depend on
    the contact tolerance.
    """
    length, within = float(np.linalg.norm(move)), max(2 * TOUCH, 1.25 * clearance)
    slope = max(RELEASED, 2 * clearance)
    return all(
        (touched_normals(workspace, point, within=within) @ move > slope * length).all()
        for point in points
    )


def released_translation(
    workspace: ConvexWorkspace,
    points: Points,
    move: Points,
    *,
    clearance: float = 0.0,
    least: float = 0.0,
) -> list[Points] | None:
    """Return one or two moves that together translate all particles by ``move``, or None if walls
    prevent the translation.

    If a wall blocks the direct move, the function returns a small move off the walls and the rest
    of the translation. After the small move, all particles are farther from the walls than
    ``clearance`` times the size, where there is room for that. If there is room, the small move has
    a length of at least ``least`` times the size.
    """
    if is_released(workspace, points, move, clearance=clearance):
        return [move]
    lift = _lift_off(workspace, points, clearance=clearance, least=least)
    return None if lift is None else [lift, move - lift]


def _lift_off(
    workspace: ConvexWorkspace,
    points: Points,
    directions: Points | None = None,
    *,
    clearance: float = 0.0,
    least: float = 0.0,
) -> Points | None:
    """Return a small move off all walls that the particles at ``points`` touch, or None if no
    direction leads off all of them.

    The move also has a positive component along each row of ``directions``.
    """

    def direction_off(length: float) -> tuple[Points, Points | None]:
        """Return the normals of the walls that a lift of this length must leave, and its
        direction.
        """
        rows = np.vstack(
            [touched_normals(workspace, point, within=1.5 * length) for point in points]
        )
        return rows, direction_away_from(
            rows if directions is None else np.vstack([rows, directions])
        )

    if least > PLANNED * clearance > 0:
        rows, away = direction_off(least)
        if away is not None and (
            not len(rows) or least * float((rows @ away).min()) >= PLANNED * clearance
        ):
            return np.asarray(least * workspace.size * away)
    length = PLANNED * clearance
    for _longer in range(4 if clearance else 0):
        rows, away = direction_off(length)
        if away is None:
            break
        needed = PLANNED * clearance / float((rows @ away).min()) if len(rows) else length
        if length >= needed * (1 - 1e-9):
            return np.asarray(length * workspace.size * away)
        length = needed
    for length in RELEASE_LENGTHS:
        _, away = direction_off(length)
        if away is not None:
            return np.asarray(length * workspace.size * away)
    return None


def separations(
    workspace: ConvexWorkspace, points: Points, *, clearance: float = 0.0
) -> list[tuple[Points, Points]]:
    """Return pairs (move, later positions): each move takes one particle off its walls while a wall
    holds the other particle.

    A planner needs a small move of one particle alone if no translation leads both particles off
    their walls, for example if the particles touch opposite walls.
    """
    departures = []
    for held in (0, 1):
        for wall in touched_normals(workspace, points[held]):
            away = _lift_off(
                workspace, points[1 - held : 2 - held], -wall[None], clearance=clearance
            )
            if away is not None:
                after = points.copy()
                after[1 - held] += away
                departures.append((away, after))
    return departures


def direction_away_from(rows: Points) -> Points | None:
    """Return the unit vector whose smallest scalar product with the unit vectors ``rows`` is as
    large as possible.

    The result is None if no unit vector has a scalar product above 0.01 with every row. In d
    dimensions, the best vector is a linear combination of at most d rows, so the function tries all
    sets of up to d rows.
    """
    d = rows.shape[1]
    if not len(rows):
        return np.asarray(np.eye(d)[0])
    best, most = None, _STEEP
    for count in range(1, min(d, len(rows)) + 1):
        for some in combinations(rows, count):
            vector = np.linalg.lstsq(np.array(some), np.ones(count), rcond=None)[0]
            length = float(np.linalg.norm(vector))
            least = float((rows @ vector).min()) / length if length > 0 else 0.0
            if least > most * (1 + 1e-12):
                best, most = vector / length, least
    return best


def make_world(
    workspace: Any, *, friction: float = inf, radius: float = 0.0, gain: float = 0.0, seed: int = 0
) -> Any:
    """Return the simulated world for a workspace: a `ContactWorld`, or a `RegionWorld` if the
    workspace has obstacles.

    Parameters
    ----------
    workspace : ConvexWorkspace or Region
    friction : float
        Coefficient of friction between particles and walls. With an infinite friction coefficient,
        a particle that is pushed into a wall never slides.
    radius : float
        Radius of each particle, in the workspace's unit of length.
    gain : float
        Largest gain minus smallest gain in the workspace, divided by the mean gain. The gain of a
        particle is its displacement divided by the input. The gain grows along a random direction,
        which ``seed`` determines.
    seed : int
    """
    if isinstance(workspace, Region):
        if gain or radius:
            raise InvalidInputError(
                "a region with obstacles: expected no gain and no particle radius, which only"
                " convex workspaces allow"
            )
        return RegionWorld(workspace, friction=friction)
    gradient = None
    if gain:
        direction = generators(seed)[0].normal(size=workspace.dimensions)
        gradient = direction * (gain / 2 / workspace.extent(direction))
    return ContactWorld(workspace, friction=friction, gradient=gradient, radius=radius)


def generators(seed: int) -> tuple[Generator, Generator, Generator, Generator]:
    """Return four random generators: for the direction of the gain's growth, for noise of moves,
    for camera noise, for planners.
    """
    spawned = np.random.SeedSequence(seed).spawn(4)
    return tuple(np.random.default_rng(child) for child in spawned)  # type: ignore[return-value]
