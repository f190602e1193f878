"""Chains: sequences of contacts that change the difference of two particles to that of
their goals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import field, replace
from functools import cached_property
from itertools import islice
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_number, check_points
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import unit_vectors
from shoal.jit import working_time
from shoal.steering.kernels.chain import ChainKind, new_work, shorten_chain
from shoal.steering.kernels.cycles import CycleModel
from shoal.steering.workspaces.convex import Points
from shoal.steering.workspaces.walls import NormalizedWalls, with_few_sides, with_round_wall

_AROUND = np.exp(2j * np.pi * np.arange(48) / 48)


@dataclass(frozen=True)
class ReflectedPath:
    """The shortest path from one point to another via a circle around the origin.

    Parameters
    ----------
    contact : tuple of float
        The point (x, y) at which the path meets the circle.
    length : float
        Length of both straight parts of the path.
    """

    contact: tuple[float, float]
    length: float


def reflection_quartic(start: Points, goal: Points, radius: float = 1.0) -> NDArray[np.complex128]:
    """Return the coefficients of the quartic whose roots on the unit circle are the points of
    reflection from ``start`` to ``goal``; complex128, shape (5,), highest power first.

    Notes
    -----
    Let S and G be the two points as complex numbers in units of the radius. At a contact z with |z|
    = 1, the angles of incidence and reflection are equal if (S - z)(G - z) / z^2 is real. Since 1/z
    is conj(z) on the circle, this is A z^4 - B z^3 + conj(B) z - conj(A) = 0 with A = conj(S G) and
    B = conj(S + G). This is Alhazen's problem. Paper W, section V.B, has the same equation in real
    numbers.
    """
    radius = check_number(radius, what="radius", above=0)
    ends = check_points([start, goal], what="start and goal", dimensions=2, count=2)
    return _quartic(ends[0], ends[1], radius)


def _quartic(start: Points, goal: Points, radius: float) -> NDArray[np.complex128]:
    """Return what `reflection_quartic` returns, for points of two dimensions or more."""
    s, g = complex(*start[:2]) / radius, complex(*goal[:2]) / radius
    a, b = np.conj(s * g), np.conj(s + g)
    return np.array([a, -b, 0, np.conj(b), -np.conj(a)])


def shortest_reflected_path(
    start: ArrayLike, goal: ArrayLike, radius: float = 1.0
) -> ReflectedPath:
    """Return the shortest path from one point of a disk to another that touches the disk's circle.

    Parameters
    ----------
    start, goal : array_like of float, shape (2,)
        Two points of the disk around the origin.
    radius : float
        Radius of the disk, above 0.

    Raises
    ------
    InvalidInputError
        If the radius is not above 0, or if a point is no finite point of the disk.

    Examples
    --------
    >>> path = shortest_reflected_path((0.5, 0.0), (0.0, 0.5))
    >>> [round(x, 4) for x in path.contact], round(path.length, 4)
    ([0.7071, 0.7071], 1.4736)
    """
    radius = check_number(radius, what="radius", above=0)
    ends = check_points([start, goal], what="start and goal", dimensions=2, count=2)
    for what, point in zip(("start", "goal"), ends, strict=True):
        if np.hypot(*point) > radius * (1 + 1e-12):
            raise InvalidInputError(
                f"{what}: expected a point at most {radius:g} from the origin, got"
                f" {tuple(point.tolist())}"
            )
    spot, length = _over_circle(ends[0], ends[1], radius)
    return ReflectedPath((radius * spot.real, radius * spot.imag), length)


def _over_circle(start: Points, goal: Points, radius: float) -> tuple[complex, float]:
    """Return the contact of the shortest path over a circle, in units of the radius, and the length
    of the path.

    For points near the circle, several roots of the quartic lie close together, so the function
    also tries the points of the circle nearest to both points, and 48 evenly spaced points.
    """
    s, g = complex(*start[:2]) / radius, complex(*goal[:2]) / radius
    spots = np.concatenate([np.roots(_quartic(start, goal, radius)), [s, g], _AROUND])
    spots = spots[spots != 0]
    spots = spots / np.abs(spots)
    lengths = np.abs(spots - s) + np.abs(spots - g)
    best = int(np.argmin(lengths))
    return complex(spots[best]), radius * float(lengths[best])


def length_over_circle(start: Points, goal: Points, radius: float) -> float:
    """Return the length of the shortest path from one point via a circle around the origin to the
    other point; a third coordinate lengthens the path.
    """
    flat = _over_circle(start, goal, radius)[1]
    return float(np.hypot(flat, np.linalg.norm(start[2:] - goal[2:])))


def lengths_over_walls(start: Points, goal: Points, walls: NormalizedWalls) -> NDArray[np.float64]:
    """Return, for each particle and wall, the length of the particle's shortest path to its goal
    via the wall.

    The result is a float64 array of the shape (2, walls + 1), whose last column belongs to the
    round wall.
    """
    high = np.maximum(start @ walls.normals.T - walls.offsets, 0)
    low = np.maximum(goal @ walls.normals.T - walls.offsets, 0)
    # to the mirror image of the goal in the wall: (high + low)² = (high - low)² + 4 high low
    flat = np.sqrt(np.sum((start - goal) ** 2, axis=1)[:, None] + 4 * high * low)
    round_ = [
        length_over_circle(s, g, walls.circle[2]) if walls.round else inf
        for s, g in zip(start, goal, strict=True)
    ]
    return np.column_stack([flat, round_])


def bounds_of(
    touchers: NDArray[np.int64],
    on: NDArray[np.int64],
    start: Points,
    goal: Points,
    walls: NormalizedWalls,
    lengths: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return, for each kind of chain, a lower bound on the length of all chains of this kind;
    float64, shape (kinds,).

    A kind of chain is a sequence of touching particles (a row of ``touchers``) and walls (a row of
    ``on``).

    Parameters
    ----------
    touchers, on : ndarray of int64, shape (kinds, cycles)
    start, goal : ndarray of float64, shape (2, d)
    walls : NormalizedWalls
    lengths : ndarray of float64, shape (2, walls + 1)
        The result of `lengths_over_walls`.
    """
    apart = float(np.linalg.norm((start[1] - start[0]) - (goal[1] - goal[0])))
    # no change for mirror images in the circle
    normals = np.vstack([walls.normals, np.zeros((1, walls.dimensions))])
    offsets = np.append(walls.offsets, 0.0)
    least, used = np.empty((2, len(on))), np.empty((2, len(on)), dtype=np.bool_)
    for p in (0, 1):
        own = touchers == p
        used[p] = own.any(axis=1)
        image = np.repeat(goal[p][None], len(on), axis=0)
        for m in range(on.shape[1] - 1, -1, -1):
            normal = normals[on[:, m]] * own[:, m, None]
            over = np.einsum("ij,ij->i", normal, image) - offsets[on[:, m]]
            image -= 2 * over[:, None] * normal
        flat = ~(own & (on == len(walls.normals))).any(axis=1)
        direct = np.maximum(
            np.where(flat, np.linalg.norm(image - start[p], axis=1), 0.0),
            np.linalg.norm(goal[p] - start[p]),
        )
        least[p] = np.maximum(direct, np.where(own, lengths[p][on], 0.0).max(axis=1))
    two_touchers = np.maximum((least.sum(axis=0) + apart) / 2, least.max(axis=0))
    return np.asarray(
        np.where(used.all(axis=0), two_touchers, np.where(used[0], least[0], least[1]) + apart)
    )


def kinds_of(
    start: Points,
    goal: Points,
    walls: NormalizedWalls,
    *,
    cycles: int,
    push: float,
    bound: float = inf,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return the kinds of chains with ``cycles`` contacts on flat walls that may be shorter than
    ``bound``, the best kind first.

    A kind of chain is a sequence of touching particles and walls. The best kind is the kind with
    the smallest lower bound on the length.

    Returns
    -------
    touchers, on : ndarray of int64, shape (kinds, cycles)
    bounds : ndarray of float64, shape (kinds,)
    """
    options = np.arange(2 * len(walls.normals))
    firsts, lasts = (
        _feasible_pairs(delta, walls, least)
        for delta, least in ((start[1] - start[0], push), (goal[1] - goal[0], -1e-12))
    )
    choices = (
        [firsts, *[options] * (cycles - 2), lasts]
        if cycles > 1
        else [np.intersect1d(firsts, lasts)]
    )
    kinds = np.stack(np.meshgrid(*choices, indexing="ij"), axis=-1).reshape(-1, cycles)
    kinds = kinds[
        (kinds[:, 1:] != kinds[:, :-1]).all(axis=1)
    ]  # mostly one contact; `improvement` inserts the others
    touchers, on = kinds % 2, kinds // 2
    bounds = bounds_of(touchers, on, start, goal, walls, lengths_over_walls(start, goal, walls))
    order = np.argsort(bounds, kind="stable")
    order = order[: np.searchsorted(bounds[order], bound)]
    return touchers[order], on[order], bounds[order]


def _feasible_pairs(delta: Points, walls: NormalizedWalls, least: float) -> NDArray[np.int64]:
    """Return the pairs of a wall and a touching particle that may be feasible, each as the number 2
    · wall + particle.

    The test is fast, and never excludes a feasible pair. For each wall, the test computes the
    largest distance of the other particle from this wall over the bounding box of all possible
    contacts. A pair passes the test only if none of these distances is negative.
    """
    heights = walls.normals @ delta
    middle = walls.frames[:, 0] @ walls.normals.T - walls.offsets  # wall, other wall
    most = middle + walls.reaches[:, None] * np.abs(walls.frames[:, 1:] @ walls.normals.T).sum(
        axis=1
    )
    fits = np.stack(
        [
            ((most + sign * heights) >= -1e-9).all(axis=1) & (sign * heights > least)
            for sign in (1, -1)
        ],
        axis=1,
    )
    return np.flatnonzero(fits)


MARGIN = 1e-8  # relative to the size: distance of the other particle from the walls
ENOUGH = 1e-7  # distance from all limits of a first guess on flat walls
ROOM = 1e-4  # distance from all limits of a first guess on a circle
REFINING = np.array([20.0 * 12.0**k for k in range(8)])
_DEEPEST = 12  # cycles of a chain that is refined without search


@dataclass(frozen=True, eq=False)
class Chain:
    """A sequence of cycles (a wall contact, then an adjustment by the other particle), in the units
    of `NormalizedWalls`.

    Parameters
    ----------
    touchers : ndarray of int64, shape (cycles,)
        Index, 0 or 1, of the particle that a wall holds in each cycle (the toucher).
    walls : ndarray of int64, shape (cycles,)
        Index of the wall that holds the touching particle in each cycle.
    unknowns : ndarray of float64, shape (cycles (d - 1) + (cycles - 1) d,)
        Positions of the contacts along their walls, followed by the position differences of the
        particles between the cycles.
    length : float
        Total length of the moves; infinite if the length has not been computed.
    last : ndarray of float64, shape (d,), optional
        The position difference after the last cycle, if it is not the position difference of the
        goals.
    """

    touchers: NDArray[np.int64]
    walls: NDArray[np.int64]
    unknowns: NDArray[np.float64]
    length: float
    last: Points | None = None

    @property
    def cycles(self) -> int:
        """Number of cycles, each with one wall contact."""
        return len(self.walls)

    def contacts(self, walls: NormalizedWalls) -> Points:
        """Return the positions of the wall contacts; float64, shape (cycles, d)."""
        d, flat = walls.dimensions, self.walls < len(walls.frames)
        along, contacts = (
            self.unknowns[: self.cycles * (d - 1)].reshape(-1, d - 1),
            np.empty((self.cycles, d)),
        )
        frames = walls.frames[self.walls[flat]]
        contacts[flat] = frames[:, 0] + np.einsum("mk,mki->mi", along[flat], frames[:, 1:])
        if not flat.all():
            angles = along[~flat, 0] / walls.circle[2]
            contacts[~flat, :2] = walls.circle[2] * unit_vectors(angles)
            contacts[~flat, 2:] = along[~flat, 1:]
        return contacts

    def differences(self, before: Points, after: Points) -> Points:
        """Return the position difference of the particles at the start and after each cycle;
        float64, shape (cycles + 1, d).
        """
        d = len(before)
        between = self.unknowns[self.cycles * (d - 1) :].reshape(-1, d)
        return np.concatenate(
            [before[None], between, (after if self.last is None else self.last)[None]]
        )


class StartAndGoal:
    """Base class of a query: start and goal of two particles, and the time at which the search for
    a plan must stop.
    """

    start: Points
    goal: Points
    deadline: float
    clock: Callable[[], float]

    @property
    def late(self) -> bool:
        """Whether the deadline of the search has passed."""
        return self.clock() > self.deadline

    @property
    def before(self) -> Points:
        """The position difference Δ of the particles at the start."""
        return np.asarray(self.start[1] - self.start[0])

    @property
    def after(self) -> Points:
        """The position difference Δ of the goals."""
        return np.asarray(self.goal[1] - self.goal[0])


@dataclass(frozen=True, eq=False)
class ChainQuery(StartAndGoal):
    """A request for a chain of wall contacts: start, goal, walls and friction, in the units of
    `NormalizedWalls`.

    Parameters
    ----------
    walls : NormalizedWalls
    start, goal : ndarray of float64, shape (2, d)
    friction : float
        Coefficient of friction of the walls. With infinite friction, a particle that is pushed into
        a wall never slides.
    margin : float
        Minimum distance between the walls and the particle that touches no wall, in the units of
        `NormalizedWalls`.
    push : float
        Minimum component of each adjustment into the wall that holds the touching particle, in the
        units of `NormalizedWalls`.
    rounds : ndarray of float64
        For each round of the optimization, the sharpness of the barrier function that keeps a chain
        inside its limits. The lower the last sharpness is, the farther from its limits the chain
        stays.
    deadline : float
        Time at which the search stops, in seconds on ``clock``.
    clock : callable
        Returns seconds.
    """

    walls: NormalizedWalls
    start: Points
    goal: Points
    friction: float = inf
    margin: float = MARGIN
    push: float = 1e-9
    rounds: NDArray[np.float64] = field(default_factory=lambda: REFINING)
    deadline: float = inf
    clock: Callable[[], float] = working_time

    def model(self, inside: float = 1.0) -> CycleModel:
        """Return the walls and constants for kernels that compute cycles, with ``margin`` and
        ``push`` multiplied by ``inside``.
        """
        return self.walls.cycle_model(self.friction, self.margin * inside, self.push * inside)

    def flat(self) -> ChainQuery:
        """Return the query in the plane, without vertical coordinates."""
        assert self.walls.base is not None
        return replace(
            self,
            walls=self.walls.base,
            start=self.start[:, :2].copy(),
            goal=self.goal[:, :2].copy(),
        )

    def optimize(
        self,
        guess: NDArray[np.float64],
        touchers: NDArray[np.int64],
        on: NDArray[np.int64],
        *,
        enough: float = ENOUGH,
        rounds: NDArray[np.float64] | None = None,
        bound: float = inf,
    ) -> float:
        """Change the unknowns ``guess`` of a chain in place, so that the chain becomes feasible and
        short.

        ``touchers`` and ``on`` hold the touching particle and the wall of each cycle. The method
        returns the length of the resulting chain, or infinity if the optimization finds no feasible
        chain.
        """
        kind = ChainKind(
            touchers,
            on,
            self.start,
            self.goal,
            self.walls.shape,
            self.friction,
            self.margin,
            self.push,
        )
        work = new_work(len(on), self.walls.dimensions)
        return float(
            shorten_chain(
                guess, enough, self.rounds if rounds is None else rounds, bound, kind, work
            )
        )

    @cached_property
    def _lengths_over_walls(self) -> NDArray[np.float64]:
        return lengths_over_walls(self.start, self.goal, self.walls)

    def bounds_of(self, touchers: NDArray[np.int64], on: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return, for each kind of chain, a lower bound on the length of all chains of this kind;
        float64, shape (kinds,).

        A kind of chain is a sequence of touching particles (a row of ``touchers``) and walls (a row
        of ``on``); both arrays have the shape (kinds, cycles).
        """
        return bounds_of(touchers, on, self.start, self.goal, self.walls, self._lengths_over_walls)

    def guess(self, cycles: int) -> NDArray[np.float64]:
        """Return initial unknowns: contacts at the midpoints of walls, and a position difference
        after each cycle except the last.

        The guessed position differences are equally spaced on the straight line from the start's
        difference to the goals' difference, and then divided by 2.
        """
        between = (
            self.before + (self.after - self.before) * np.arange(1, cycles)[:, None] / cycles
        ) / 2
        return np.concatenate((np.zeros(cycles * (self.walls.dimensions - 1)), between.ravel()))


def refine_chain(query: ChainQuery, chain: Chain) -> Chain:
    """Return the shortest chain that has the same touching particles and walls as ``chain``.

    If ``chain`` has more than 12 cycles, or if the optimization fails, the result is ``chain``
    itself.
    """
    if chain.cycles > _DEEPEST:
        return chain
    if chain.last is not None:  # use the difference that the chain really reaches
        off = (chain.last - query.after) / 2
        query = replace(query, goal=query.goal + np.stack([-off, off]))
    guess = chain.unknowns.copy()
    length = query.optimize(guess, chain.touchers, chain.walls)
    return replace(chain, unknowns=guess, length=length) if length < inf else chain


FEW = 9  # maximum number of sides for which all kinds of chains are tried
MANY = 12  # number of sides from which this reduction is used
_WORTH = 1e-4  # relative to the length: gain that justifies a change of sides
_BESIDE = 100  # most choices of sides for a chain that is feasible in a disk
_END = 0.98  # relative to a side: a contact farther out may move to the next side


def reduce_sides(query: ChainQuery) -> ChainQuery:
    """Return a copy of the query in which the polygon has at most `FEW` of its sides.

    If the polygon has at most `MANY` sides, or if the chosen sides enclose no area, the function
    returns ``query`` unchanged.
    """
    walls = with_few_sides(query.walls, FEW) if query.walls.sides > MANY else None
    return query if walls is None else replace(query, walls=walls)


def round_query(query: ChainQuery) -> ChainQuery | None:
    """Return a copy of the query in a disk around the polygon, or None if the polygon has at most
    `MANY` sides or is not nearly round.
    """
    walls = with_round_wall(query.walls) if query.walls.sides > MANY else None
    return None if walls is None else replace(query, walls=walls)


def restore_sides(query: ChainQuery, few: ChainQuery, chain: Chain) -> Chain:
    """Return a chain whose contacts have moved from the walls of the query ``few``, a polygon with
    fewer sides or a disk, to the nearest walls of the whole polygon.

    The attribute ``length`` of the result is a copy of the length of ``chain``, not the exact
    length after the contacts have moved.
    """
    walls, d = query.walls, query.walls.dimensions
    sides, on = walls.sides, chain.walls.copy()
    unknowns = chain.unknowns.copy()
    for m, contact in enumerate(chain.contacts(few.walls)):
        if few.walls.sides <= chain.walls[m] < len(few.walls.normals):  # an end cap
            on[m] += sides - few.walls.sides
            continue
        outward = -(walls.normals[:sides, :2] @ contact[:2]) / -walls.offsets[:sides]
        on[m] = int(np.argmax(outward))
        unknowns[m * (d - 1)] = _along_side(walls, int(on[m]), contact)
    return replace(chain, walls=on, unknowns=unknowns)


def feasible_sides(query: ChainQuery, chain: Chain) -> Chain:
    """Return ``chain``, or a copy with some contacts on the sides beside its own if only the copy is
    feasible: a chain of a disk may press a little more steeply than the nearest side allows.
    """
    walls, d = query.walls, query.walls.dimensions
    contacts = chain.contacts(walls)
    steps = (step for moved in range(chain.cycles + 1) for step in _steps(chain.cycles, moved))
    for step in islice(steps, _BESIDE):
        on, unknowns = chain.walls.copy(), chain.unknowns.copy()
        for m in np.flatnonzero(step):
            if on[m] < walls.sides:
                on[m] = (on[m] + step[m]) % walls.sides
                unknowns[m * (d - 1)] = _along_side(walls, int(on[m]), contacts[m])
        guess = unknowns.copy()
        if query.optimize(guess, chain.touchers, on, rounds=REFINING[:3]) < inf:
            return replace(chain, walls=on, unknowns=unknowns)
    return chain


def _steps(count: int, moved: int) -> Iterator[tuple[int, ...]]:
    """Yield all tuples of ``count`` numbers -1, 0 and 1, of which ``moved`` are not 0."""
    if moved > count:
        return
    if count == 0:
        yield ()
        return
    for rest in _steps(count - 1, moved):
        yield (0, *rest)
    for sign in (-1, 1) if moved else ():
        for rest in _steps(count - 1, moved - 1):
            yield (sign, *rest)


def _along_side(walls: NormalizedWalls, side: int, point: Points) -> float:
    """Return the point of a side that is nearest to ``point``, as its signed distance from the
    midpoint of the side.
    """
    frame, end = walls.frames[side], np.linalg.norm(walls.frames[side, 0, :2] - walls.corners[side])
    return float(np.clip(frame[1] @ (point - frame[0]), -0.9 * end, 0.9 * end))


def _neighbours(query: ChainQuery, chain: Chain, step: int) -> Iterator[Chain]:
    """Yield copies of ``chain``, each with one contact on another side of the polygon.

    In ``chain``, the contact is at an end of its side. In the copy, the contact is on the
    ``step``-th side beyond this end.

    The attribute ``length`` of each yielded chain is still the length of ``chain``.
    """
    walls, d = query.walls, query.walls.dimensions
    contacts = chain.contacts(walls)
    for m, side in enumerate(chain.walls.tolist()):
        if side >= walls.sides:
            continue
        end = float(np.linalg.norm(walls.frames[side, 0, :2] - walls.corners[side]))
        along = float(chain.unknowns[m * (d - 1)])
        if abs(along) < _END * end:
            continue
        on, unknowns = chain.walls.copy(), chain.unknowns.copy()
        on[m] = (side + (step if along > 0 else -step)) % walls.sides
        unknowns[m * (d - 1)] = _along_side(walls, int(on[m]), contacts[m])
        yield replace(chain, walls=on, unknowns=unknowns)


def slide_contacts(query: ChainQuery, chain: Chain) -> Chain:
    """Return the chain that results if contacts move to neighbouring sides of the polygon as long
    as this shortens the chain.
    """
    step = query.walls.sides // FEW if query.walls.sides > MANY else 0
    while step > 0 and not query.late:
        shorter = None
        for neighbour in _neighbours(query, chain, step):
            length = query.optimize(
                neighbour.unknowns,
                neighbour.touchers,
                neighbour.walls,
                rounds=REFINING[:3],
                bound=chain.length,
            )
            if length < chain.length * (1 - _WORTH):
                shorter = replace(neighbour, length=length)
                break
        chain, step = (chain, step // 2) if shorter is None else (shorter, step)
    return chain
