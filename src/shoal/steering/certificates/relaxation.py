"""Lower bounds by second-order cones: all plans whose chain of holds has a given pattern."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from functools import cache, cached_property
from itertools import pairwise
from math import acos, asin, frexp, hypot, inf, sqrt
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import import_extra
from shoal.steering.certificates.programs import solver_settings
from shoal.steering.workspaces.convex import ConvexWorkspace

Floats = NDArray[np.float64]

STEP = 2.0**-36  # multipliers are multiples of this
ROUND_WALLS = 512  # arcs into which the wall of a disk is divided at most
NARROW = 16  # part of a turn, of arcs that may take turns in a gap
_FEW = 9  # rows of an arc that are not rare
_RARE = 60  # rows of a program that are tried only if a solution does not meet them
_OUTSIDE = 1e-7
_SLOPES = (1, 9 / 8, 3 / 2, 2, 3)  # of the straight lines above an angle, as those of the checker
_FINE = 2.0**-30  # directions of arcs are multiples of this


Range = tuple[int, int]
"""Walls from the first number up to, but without, the second; counted on after a whole turn."""


class WallArc(NamedTuple):
    """Contacts of one particle, 0 or 1, with walls that follow each other.

    The walls of a disk are `ROUND_WALLS` arcs.
    """

    first: int
    end: int
    particle: int


class Hold(NamedTuple):
    """A run: one or more contacts of one particle, with no contact of the other between them.

    With few flat walls, a hold has contacts with one wall only, and more holds of the same particle
    may follow. Otherwise, the hold has all contacts of the run.

    ``first`` and ``last`` are ranges of the walls of the first and of the last contact, ``least``
    and ``most`` of the walls with the lowest and the highest number. ``order`` is 1 if the contact
    with the lowest number comes before that with the highest, -1 if after it, 0 if unknown.

    ``maximal`` says for both sides whether the run has all contacts of its particle up to the gap
    there, so that the first contact of this gap is one of the other particle.
    """

    particle: int
    first: Range
    last: Range
    least: Range
    most: Range
    order: int = 0
    maximal: tuple[bool, bool] = (False, False)

    def range(self, name: str) -> Range:
        """Return the range of a contact by its name."""
        walls: Range = getattr(self, name)
        return walls

    def certain_contacts(self) -> list[str]:
        """Return the contacts that the run certainly has, in their order."""
        if self.order:
            return ["first", *("least", "most")[:: self.order], "last"]
        if self.least[1] <= max(self.first[0], self.last[0]):
            return ["first", "least", "last"]
        if self.most[0] >= min(self.first[1], self.last[1]):
            return ["first", "most", "last"]
        return ["first", "last"]

    @property
    def arc(self) -> WallArc:
        """All walls of the contacts."""
        return WallArc(self.least[0], self.most[1], self.particle)

    @property
    def single(self) -> bool:
        """Whether all contacts are with one wall."""
        return self.most[1] - self.least[0] == 1


@dataclass(frozen=True)
class HoldGap:
    """A place of a pattern where any number of contacts may be: with the arcs ``holds``, or with all
    walls if it is None.
    """

    holds: frozenset[WallArc] | None = None


Pattern = tuple[Hold | HoldGap, ...]
"""All plans whose chain of contacts divides into those of the items, in their order. Between two
gaps is a hold."""


@dataclass(frozen=True)
class Bound:
    """A lower bound of a pattern, with the multipliers of norms, float64 (n, 2), of constraints,
    float64 (m,), and of cones, float64 (k, 3), that prove it.

    ``errors`` has, for each place of the pattern that can be divided, how much might be lost there,
    as a length, and for a hold also what to divide, and where.
    """

    value: float
    norms: Floats
    slacks: Floats
    cones: Floats
    errors: dict[int, tuple[float, str, int]]


_CONSTANT = -1  # key of the constant of an expression; a solution has a 1 at this index
Expression = dict[int, float]
"""Coefficients by variable, and the constant. Programs have few coefficients and are made some
hundred times in a second, so that dictionaries are several times as fast as arrays."""
Vector = tuple[Expression, Expression]


@dataclass(frozen=True)
class Program:
    """A convex program: the least sum of norms and of variables with costs.

    Parameters
    ----------
    norms : list of Vector
    costs : list of int
        Variables with the cost 1; all others have none.
    rows : list of (int, Expression)
        Expressions that are at least 0, with their numbers.
    equal : list of (int, int, Expression)
        Expressions that are 0, each with the numbers of the rows that it and its opposite are.
    rare : list of (int, Vector, ndarray, ndarray)
        Points inside of flat walls, each with the number of its first row, and the normals and
        offsets of the walls. These are many rows, of which few matter.
    size : int
        How many rows there are, with those of ``rare``.
    cones : list of list of Expression
        The first expression is at least the norm of the others, two or three.
    low, high : list of float
        Bounds of the variables.
    boxed : list of int
        Variables whose ``low`` and ``high`` do not follow from the rest.
    contacts : list of tuple
        For each hold: place in the pattern, and its contacts and adjustments by name.
    gaps : list of tuple
        For each gap: place in the pattern, numbers of its norms, its variables with costs.
    """

    norms: list[Vector]
    costs: list[int]
    rows: list[tuple[int, Expression]]
    equal: list[tuple[int, int, Expression]]
    rare: list[tuple[int, Vector, Floats, Floats]]
    size: int
    cones: list[list[Expression]]
    low: list[float]
    high: list[float]
    boxed: list[int]
    contacts: list[tuple[int, dict[str, Vector]]]
    gaps: list[tuple[int, range, list[int]]]


@dataclass(frozen=True)
class _System:
    """The rows of a program in the order of the solver, as triplets sorted by column: the constants,
    then the variables of the program, then the length of each norm.

    ``columns`` begins with 0 for constants. For the solver, the first ``known`` variables, which are
    the goals, are constants, too: what their tolerance takes is part of the bound that is proven.
    """

    columns: NDArray[np.int64]
    rows: NDArray[np.int64]
    values: Floats
    height: int
    width: int
    known: Floats

    @classmethod
    def of(cls, expressions: list[Expression], width: int, known: Floats) -> _System:
        """Return the system of expressions in ``width`` variables."""
        columns = np.array([key for expression in expressions for key in expression]) + 1
        values = np.array([x for expression in expressions for x in expression.values()])
        rows = np.repeat(np.arange(len(expressions)), [len(one) for one in expressions])
        order = np.argsort(columns, kind="stable")
        return cls(columns[order], rows[order], values[order], len(expressions), width, known)

    def matrix_and_constants(self) -> tuple[Any, Floats]:
        """Return the coefficients, negative, as a sparse matrix, and the constants."""
        from scipy.sparse import csc_matrix

        first = 1 + len(self.known)
        ends = np.searchsorted(self.columns, np.arange(first, self.width + 2))
        begin = ends[0]
        factors = np.concatenate([[1.0], self.known])[self.columns[:begin]]
        constants: Any = np.bincount(
            self.rows[:begin], self.values[:begin] * factors, minlength=self.height
        )
        matrix = csc_matrix(
            (-self.values[begin:], self.rows[begin:], ends - begin),
            (self.height, self.width - len(self.known)),
        )
        return matrix, constants

    def total(self, weights: Floats) -> Floats:
        """Return the weighted sum of all rows: its constant, then its coefficients."""
        weighted = self.values * weights[self.rows]
        return np.asarray(np.bincount(self.columns, weighted, minlength=self.width + 1), np.float64)


class Walls(Protocol):
    """Walls of a workspace, in a unit and with an origin of their own.

    Attributes
    ----------
    count : int
    radius : float
        Radius of the round wall around the origin; 0 if all walls are flat.
    rings : tuple of float or None
        For the law of growth with runs: the radius R of a circle around all walls, and R² - q²,
        where all walls are at least q from its centre, ``middle``.
    middle : ndarray of float64, shape (2,)
    low, high : ndarray of float64, shape (2,)
        Bounds of the workspace.
    base : list of tuple of int
        Ranges of walls that begin the search, each wall in one.
    runs : bool
        Whether a hold is a whole run.
    """

    count: int
    radius: float
    rings: tuple[float, float] | None
    middle: Floats
    low: Floats
    high: Floats
    base: list[Range]
    runs: bool

    def axis(self, first: int, end: int) -> tuple[Floats, float]:
        """Return an inward direction m of an arc, and s: each adjustment u has m @ u <= s |u|."""
        ...

    def turn_bounds(self, hold: Hold) -> list[tuple[Range, float]]:
        """Return arcs of a round wall, each with a number t: with the axis m and s of the arc, an
        adjustment u of a run with the travel T has m @ u <= (s + t T) |u|.
        """
        return []

    def segment(self, first: int, end: int) -> tuple[Floats, Floats] | None:
        """Return the corner and the vector of a flat wall; None for an arc."""
        ...

    def arc_rows(self, first: int, end: int) -> tuple[Floats, Floats]:
        """Return normals (n, 2) and offsets (n,) that bound the hull of an arc."""
        ...

    def inside_rows(self) -> tuple[Floats, Floats]:
        """Return normals (n, 2) and offsets (n,) of the flat walls."""
        ...

    def hold(
        self, particle: int, between: Range, *, right: bool, gap: Iterable[WallArc] | None = None
    ) -> Hold:
        """Return the hold that begins (or, from the right, ends) with a range of walls. If it is a
        run, it may have all walls of its particle in the gap.

        These are the only arc of its particle, or all walls, from half a turn before the middle of
        the range on.
        """
        every = between
        if self.runs:
            arcs = [arc for arc in gap or () if arc.particle == particle]
            first = (between[0] + between[1]) // 2 - self.count // 2
            every = arcs[0][:2] if len(arcs) == 1 else (first, first + self.count)
        begins, ends = (every, between) if right else (between, every)
        maximal = (right, not right) if self.runs else (False, False)
        return Hold(particle, begins, ends, every, every, 0, maximal)

    def inward(
        self, first: int, end: int, point: tuple[float, float]
    ) -> tuple[Sequence[float], float]:
        """Return the inward unit normal of the wall of an arc nearest a point, and the distance."""
        ...


class _FlatWalls(Walls):
    """The walls of a convex polygon with ``corners``, counter-clockwise."""

    radius = 0.0

    def __init__(self, corners: Floats, base: int) -> None:
        self.corners = corners
        self.count = len(corners)
        self.along = np.roll(corners, -1, axis=0) - corners
        self.normals = np.stack([-self.along[:, 1], self.along[:, 0]], axis=1)
        self.offsets = np.sum(self.normals * corners, axis=1)
        self.lengths = np.hypot(*self.normals.T)
        self.low, self.high = corners.min(axis=0), corners.max(axis=0)
        self.base = _arcs(self.count, base)
        self.runs = self.count > base
        self.rings = None
        self.middle = corners.mean(axis=0)
        if self.runs:
            out = corners - self.middle
            near = -np.sum(self.normals * out, axis=1) / self.lengths
            far = float(np.max(np.sum(out * out, axis=1)))
            self.rings = far**0.5, far - float(np.min(near)) ** 2

    def segment(self, first: int, end: int) -> tuple[Floats, Floats] | None:
        if end - first > 1:
            return None
        return self.corners[first % self.count], self.along[first % self.count]

    def axis(self, first: int, end: int) -> tuple[Floats, float]:
        if end - first == 1:
            return self.normals[first % self.count], 0.0
        walls = np.arange(first, end) % self.count
        # the normal of the chord of the arc; the sum of the normals of its walls
        axis = self.normals[walls].sum(axis=0)
        if (self.normals[walls] @ axis <= 0).any():
            return axis, float(np.hypot(*axis))
        x, y = self.normals[walls].T
        return axis, float(np.max(np.abs(axis[0] * y - axis[1] * x) / self.lengths[walls]))

    def arc_rows(self, first: int, end: int) -> tuple[Floats, Floats]:
        walls = np.arange(first, end) % self.count
        chord = -self.normals[walls].sum(axis=0)
        return (
            np.concatenate([self.normals[walls], [chord]]),
            np.append(self.offsets[walls], chord @ self.corners[first % self.count]),
        )

    def inside_rows(self) -> tuple[Floats, Floats]:
        return self.normals, self.offsets

    def inward(
        self, first: int, end: int, point: tuple[float, float]
    ) -> tuple[Sequence[float], float]:
        walls = np.arange(first, end) % self.count
        depths = (self.normals[walls] @ point - self.offsets[walls]) / self.lengths[walls]
        nearest = int(np.argmin(depths))
        wall = walls[nearest]
        return (self.normals[wall] / self.lengths[wall]).tolist(), float(depths[nearest])


class _RoundWalls(Walls):
    """The wall of a disk around the origin, as arcs between ``directions``, shape (n, 2)."""

    def __init__(self, radius: float, directions: Floats, base: int) -> None:
        self.radius = radius
        self.directions = directions
        self.rings = radius, 0.0
        self.middle = np.zeros(2)
        self.count = len(directions)
        self.high = np.full(2, radius)
        self.low = -self.high
        self.base = _arcs(self.count, base)
        self.runs = True

    def segment(self, first: int, end: int) -> tuple[Floats, Floats] | None:
        return None

    def _ends(self, first: int, end: int) -> Floats:
        return self.directions[[first % self.count, end % self.count]]

    def axis(self, first: int, end: int) -> tuple[Floats, float]:
        ends = self._ends(first, end)
        axis = -ends.sum(axis=0)
        if end - first > self.count // 3:
            return axis, float(np.hypot(*axis))
        x, y = ends.T
        return axis, float(np.max(np.abs(axis[0] * y - axis[1] * x) / np.hypot(x, y)))

    def turn_bounds(self, hold: Hold) -> list[tuple[Range, float]]:
        bounds = []
        for between in dict.fromkeys((hold.first, hold.last)):
            if between != hold.arc[:2] and between[1] - between[0] <= self.count // 3:
                ends = self._ends(*between)
                cosine = float(np.max(ends @ ends.sum(axis=0) / np.hypot(*ends.T)))
                # a contact is at most T from the first, and T / 2 from the first or the last
                share = 0.5 if hold.first == hold.last else 1.0
                bounds.append((between, share * cosine / self.radius))
        return bounds

    def arc_rows(self, first: int, end: int) -> tuple[Floats, Floats]:
        if end - first > self.count // 3:
            return np.zeros((0, 2)), np.zeros(0)
        ends = self._ends(first, end)
        axis = ends.sum(axis=0)
        least = np.min(ends @ axis / np.hypot(*ends.T))
        return axis[None], np.array([self.radius * least])

    def inside_rows(self) -> tuple[Floats, Floats]:
        return np.zeros((0, 2)), np.zeros(0)

    def inward(
        self, first: int, end: int, point: tuple[float, float]
    ) -> tuple[Sequence[float], float]:
        x, y = point
        far = hypot(x, y)
        normal = (-x / far, -y / far) if far > 0 else self.axis(first, end)[0].tolist()
        return normal, self.radius - far


def _arcs(count: int, number: int) -> list[Range]:
    """Return about ``number`` ranges of ``count`` walls."""
    ends = np.round(np.linspace(0, count, min(number, count) + 1)).astype(int).tolist()
    return list(pairwise(ends))


def round_directions(count: int = ROUND_WALLS) -> Floats:
    """Return directions around a disk, counter-clockwise; float64, shape (count, 2)."""
    angles = 2 * np.pi * np.arange(count) / count
    return np.round(np.stack([np.cos(angles), np.sin(angles)], axis=1) / _FINE) * _FINE


class Relaxation:
    """The convex programs of all patterns of one task.

    The programs, with the order of their variables, norms, constraints and cones, are those of
    docs/concepts/steering/certificates.md. Their unit is a power of two.

    Parameters
    ----------
    place : ConvexWorkspace
        A polygon or a disk.
    start, goal : ndarray of float64, shape (2, 2)
    tolerance : float
        Largest error of each coordinate at the end.
    limit : float
        Plans that are longer than this length are not considered.

    Raises
    ------
    MissingExtraError
        If Clarabel is not installed.
    """

    def __init__(
        self, place: ConvexWorkspace, start: Floats, goal: Floats, tolerance: float, limit: float
    ) -> None:
        clarabel = import_extra("clarabel", "certificates need Clarabel", extra="certify")
        self._clarabel = clarabel
        self.scale = 2.0 ** frexp(place.size)[1]
        self.walls: Walls
        if place.round:
            origin = place.center
            self.walls = _RoundWalls(place.radius / self.scale, round_directions(), 8)
            self._redundant_pairs: set[tuple[Range, Range]] = set()
        else:
            origin = place.vertices[0]
            self.walls = _FlatWalls((place.vertices - origin) / self.scale, 8)
            self._redundant_pairs = _redundant_pairs(place.vertices)
        self.start, self.goal = (start - origin) / self.scale, (goal - origin) / self.scale
        self.tolerance, self.limit = tolerance / self.scale, limit / self.scale
        self._settings = settings = solver_settings(clarabel)
        # a bound needs multipliers near the best ones only, and two thirds of the time are less
        settings.iterative_refinement_enable = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-6
        # of a narrow run around its first or last contact
        self.margin = max(self.walls.count // (4 * NARROW), 1)
        self._distances: dict[tuple[Range, int, bool], float] = {}
        self._no_squares: dict[int, Any] = {}
        self._cones = {number: clarabel.SecondOrderConeT(number) for number in (3, 4)}
        self._inside = self.walls.inside_rows()

        # of the same few arcs again and again, as numbers of Python, which are faster one by one
        @cache
        def axis(first: int, end: int) -> tuple[list[float], float, bool]:
            axis, sine = self.walls.axis(first, end)
            return axis.tolist(), sine, self.walls.segment(first, end) is not None

        self._axis, self._arc_rows = axis, cache(self.walls.arc_rows)

    def follows(self, first: Hold, second: Hold, *, maximal: bool) -> bool:
        """Return whether ``second`` can come directly after ``first``, and change the difference
        of the particles.

        If ``maximal``, one of them is beside a gap that contained the other, and has all contacts up
        to it that it may have.
        """
        count = self.walls.count
        if self.walls.runs:
            return not maximal or first.particle != second.particle
        before, after = ((hold.arc.first % count, hold.particle) for hold in (first, second))
        return (before, after) not in self._redundant_pairs and not (maximal and before == after)

    def bound(self, pattern: Pattern) -> Bound:
        """Return the lower bound of all plans of a pattern, at most the limit."""
        program = self.program(pattern)
        count, size = len(program.low), len(program.norms)
        goals = self.goal.ravel()
        ends = [expression for _, _, expression in program.equal]
        boxes = [{k: 1.0, _CONSTANT: -program.low[k]} for k in program.boxed]
        boxes += [{k: -1.0, _CONSTANT: program.high[k]} for k in program.boxed]
        tail = [
            part
            for number, (x, y) in enumerate(program.norms)
            for part in ({count + number: 1.0}, x, y)
        ]
        tail += [part for cone in program.cones for part in cone]
        clarabel = self._clarabel
        sizes = [3] * size + [len(cone) for cone in program.cones]
        costs = np.ones(count + size)
        costs[:count] = 0.0
        costs[program.costs] = 1.0
        rows = list(program.rows)
        used = {number for number, _ in rows}
        # most walls of a polygon with many sides are far from a solution
        if sum(len(offsets) for *_, offsets in program.rare) <= _RARE:
            rows += _rare_rows(program, used)
        while True:
            linear = len(ends) + len(rows) + len(boxes)
            inequalities = [row for _, row in rows]
            system = _System.of(ends + inequalities + boxes + tail, count + size, goals)
            matrix, constants = system.matrix_and_constants()
            solution = clarabel.DefaultSolver(
                self._zeros(count + size - len(goals)),
                costs[len(goals) :],
                matrix,
                constants,
                [
                    clarabel.ZeroConeT(len(ends)),
                    clarabel.NonnegativeConeT(linear - len(ends)),
                    *(self._cones[number] for number in sizes),
                ],
                self._settings,
            ).solve()
            solved = [*goals.tolist(), *solution.x]
            point: list[float] = [*solved[:count], 1.0]
            infeasible = "Infeasible" in str(solution.status)
            outside = [] if infeasible else _rare_rows(program, used, point)
            if not outside:
                break
            rows += outside
        dual = np.array(solution.z)
        if not np.isfinite(dual).all():
            dual = np.zeros_like(dual)
        # of the equalities, of any sign, and of the other rows
        slacks = dual[: len(ends) + len(rows)]
        slacks[len(ends) :] = np.maximum(slacks[len(ends) :], 0.0)
        split = linear + 3 * size
        vectors = -dual[linear:split].reshape(size, 3)[:, 1:]
        turns = np.zeros((len(program.cones), 3))
        # which of the parts of all cones are which multipliers
        firsts = split + np.cumsum([0, *sizes[size:-1]]) if program.cones else np.zeros(0, np.int64)
        three = np.array(sizes[size:]) == 4
        turns[:, 0], turns[:, 1] = -dual[firsts + 1], -dual[firsts + 2]
        turns[three, 2] = -dual[firsts[three] + 3]

        def proven() -> float:
            """Return the lower bound that the multipliers prove, or minus infinity."""
            weights = np.zeros(system.height)
            weights[: len(slacks)] = -slacks
            weights[linear + 1 : split : 3], weights[linear + 2 : split : 3] = vectors.T
            # the checker, too, rounds up
            weights[firsts] = -np.ceil(np.sqrt(np.sum(turns * turns, axis=1)) / STEP) * STEP
            weights[firsts + 1], weights[firsts + 2] = turns[:, 0], turns[:, 1]
            weights[firsts[three] + 3] = turns[three, 2]
            total = system.total(weights)
            reduced = total[1 : count + 1] + costs[:count]
            value = float(total[0] + np.minimum(reduced * low, reduced * high).sum())
            return value if np.isfinite(value) else -inf

        low, high = np.array(program.low), np.array(program.high)
        if infeasible:
            vectors = np.zeros_like(vectors)
            refuted = proven()
            factor = 2 * self.limit / refuted if refuted > 0 else 0.0
            slacks, turns = slacks * factor, turns * factor
        vectors = vectors / np.maximum(np.hypot(*vectors.T), 1)[:, None]
        # multiples of STEP, which exact arithmetic takes; towards 0, so that no norm exceeds 1
        vectors = np.trunc(vectors * (1 - 1e-15) / STEP) * STEP
        slacks, turns = np.round(slacks / STEP) * STEP, np.round(turns / STEP) * STEP
        value = min(proven(), self.limit)
        if value < 0:  # without multipliers, the bound is 0
            value, vectors, slacks, turns = 0.0, 0 * vectors, 0 * slacks, 0 * turns
        by_number = np.zeros(program.size)
        by_number[[number for number, _ in rows]] = slacks[len(ends) :]
        by_number[[forth for forth, _, _ in program.equal]] = np.maximum(slacks[: len(ends)], 0.0)
        by_number[[back for _, back, _ in program.equal]] = np.maximum(-slacks[: len(ends)], 0.0)
        errors = self._errors(pattern, program, solved, point)
        return Bound(value * self.scale, vectors, by_number, turns, errors)

    def _zeros(self, width: int) -> Any:
        """Return a sparse matrix of zeros."""
        from scipy.sparse import csc_matrix

        if width not in self._no_squares:
            self._no_squares[width] = csc_matrix((width, width))
        return self._no_squares[width]

    def _errors(
        self, pattern: Pattern, program: Program, solution: list[float], point: list[float]
    ) -> dict[int, tuple[float, str, int]]:
        count = len(program.low)
        errors = {
            place: (
                sum(solution[count + k] for k in norms) + sum(point[k] for k in costs),
                "gap",
                0,
            )
            for place, norms, costs in program.gaps
        }
        for place, by_name in program.contacts:
            hold = pattern[place]
            assert isinstance(hold, Hold)
            if hold.single:
                continue
            error = self._error(
                hold,
                {name: (_value(x, point), _value(y, point)) for name, (x, y) in by_name.items()},
            )
            if error is not None:
                errors[place] = error
        return errors

    def _error(
        self, hold: Hold, by_name: dict[str, tuple[float, float]]
    ) -> tuple[float, str, int] | None:
        """Return how far the solution of a hold is from one contact, and how to divide it."""
        inward = {
            name: self.walls.inward(*hold.range(name), by_name[name])
            for name in ("first", "last", "least", "most")
            if name in by_name
        }
        x, y = by_name["change"]
        against = max(min(normal[0] * x + normal[1] * y for normal, _ in inward.values()), 0.0)
        depths = {
            name: depth
            for name, (_, depth) in inward.items()
            if hold.range(name)[1] - hold.range(name)[0] > 1
        }
        total = against + sum(depths.values())
        least, most, arc = hold.least, hold.most, hold.arc
        if arc.end - arc.first > self.walls.count // 3:  # most runs stay near their first contact
            near = min(hold.first, hold.last, key=lambda between: between[1] - between[0])
            margin = self.walls.count // len(self.walls.base)
            for name, wall in (("least", near[0] - margin), ("most", near[1] + margin)):
                first, end = hold.range(name)
                if first < wall < end:
                    return total, name, wall
        deepest = max(depths, key=lambda name: depths[name], default=None)
        if deepest is not None and depths[deepest] > against:
            first, end = hold.range(deepest)
            return total, deepest, (first + end) // 2
        if not hold.order and least[1] <= most[0]:
            return total, "order", 0
        if most[0] < least[1] < most[1]:
            return total, "most", least[1]
        name = "least" if least[1] - least[0] >= most[1] - most[0] else "most"
        first, end = hold.range(name)
        return None if end - first == 1 else (total, name, (first + end) // 2)

    def narrowing(self, hold: Hold) -> tuple[str, int] | None:
        """Return the contact of a run to divide, and where, so that in the end the run either stays
        within about a sixteenth of a turn or certainly travels; None if it does.
        """
        margin = self.margin
        near = min(hold.first, hold.last, key=lambda between: between[1] - between[0])
        if near[1] - near[0] > 2 * margin:
            return ("first" if near is hold.first else "last"), (near[0] + near[1]) // 2
        for name, wall in (("least", near[0] - margin), ("most", near[1] + margin)):
            first, end = hold.range(name)
            if first < wall < end:
                return name, wall
        for name, away in (
            ("least", hold.least[1] <= near[0]),
            ("most", hold.most[0] >= near[1]),
        ):
            first, end = hold.range(name)
            if away and end - first > self.walls.count // 3:  # a range without a hull
                return name, (first + end) // 2
        return None

    def _most_adjustment(self, hold: Hold) -> float:
        """Return the greatest sum of the adjustments of a run, in plans within the limit.

        The adjustments do not move the held particle. By other inputs, it comes from its start to
        all contacts, and from there to its goal.
        """
        particle = hold.particle
        (to_first, from_first), (to_last, from_last) = (
            [self._distance(between, particle, goal=goal) for goal in (False, True)]
            for between in (hold.first, hold.last)
        )
        path = (
            max(to_first + from_first, to_first + from_last, to_last + from_last)
            - 2 * self.tolerance
        )
        return float(max(self.limit - path, 0.0))

    def _distance(self, between: Range, particle: int, *, goal: bool) -> float:
        """Return a lower bound on the distance of an end from a contact with a round wall."""
        cached = self._distances.get((between, particle, goal))
        if cached is not None:
            return cached
        point = (self.goal if goal else self.start)[particle]
        normals, offsets = self.walls.arc_rows(*between)
        depths = (offsets - normals @ point) / np.hypot(*normals.T)
        distance = float(max(self.walls.radius - np.hypot(*point), 0.0, *depths))
        self._distances[between, particle, goal] = distance
        return distance

    @cached_property
    def _growth(self) -> tuple[float, float, list[tuple[float, float]]]:
        """The laws of growth of a disk up to the goals.

        The first number is the least sum of all adjustments, the second one the least sum of the
        translations if nothing is known of the first contact. The pairs have numbers s and t: this
        sum is at least t - s h, where h is the depth at the first contact.
        """
        radius = self.walls.radius
        start, goal = (float(np.hypot(*(end[1] - end[0]))) for end in (self.start, self.goal))
        most = min(start, 2 * radius)  # of the depth
        first, last = (
            2 * radius * asin(min(size / (2 * radius), 1.0))
            for size in (start, max(goal - 3 * self.tolerance, 0.0))
        )
        above = radius * acos(max(1 - most / radius, -1.0))
        lines = [
            (
                slope,
                last
                - max(
                    radius * (asin(1 / slope) - slope + sqrt(slope * slope - 1)),
                    above - slope * most,
                ),
            )
            for slope in _SLOPES
        ]
        return last - first, last - above, lines

    def program(self, pattern: Pattern) -> Program:
        """Return the convex program of a pattern."""
        walls, limit, tolerance = self.walls, self.limit, self.tolerance
        low: list[float] = []
        high: list[float] = []
        boxed: list[int] = []
        costs: list[int] = []
        norms: list[Vector] = []
        rows: list[tuple[int, Expression]] = []
        equalities: list[tuple[int, int, Expression]] = []
        rare: list[tuple[int, Vector, Floats, Floats]] = []
        cones: list[list[Expression]] = []
        size = 0  # numbers of rows
        # the law of growth: |difference|² <= 2 R grown, where grown is |difference at the start|
        # + k / R + (1 + a) (sum of the translations) + a (sum of the adjustments), a = sqrt(k) / R
        outer, ring = walls.rings or (0.0, 0.0)
        grown: Expression = {}
        slope = 0.0
        if walls.rings:
            apart = self.start[1] - self.start[0]
            grown = {_CONSTANT: hypot(*apart) + ring / outer}
            slope = sqrt(ring) / outer
        contacts: list[tuple[int, dict[str, Vector]]] = []
        gaps: list[tuple[int, range, list[int]]] = []
        # the lengths of all translations from the first contact on, and of all adjustments
        translations: list[int] = []
        adjustments: list[int] = []
        depth: Expression | None = (
            None  # of the other particle at the first contact, if it is known
        )

        def add_row(row: Expression) -> None:
            nonlocal size
            rows.append((size, row))
            size += 1

        def vector(lows: Sequence[float], highs: Sequence[float]) -> Vector:
            """Add a vector between two bounds."""
            number = len(low)
            low.extend(lows)
            high.extend(highs)
            return {number: 1.0}, {number + 1: 1.0}

        def add_length(change: Vector) -> int:
            """Return a variable that is at least the norm of a vector and part of the length."""
            number = len(low)
            low.append(0.0)
            high.append(limit)
            costs.append(number)
            cones.append([{number: 1.0}, *change])
            return number

        def add_translations(change: Vector) -> list[int]:
            """Count the length of free translations; with a law of growth, remember their sum."""
            if not walls.rings:
                norms.append(change)
                return []
            length = add_length(change)
            translations.append(length)
            grown[length] = 1 + slope
            return [length]

        def add_adjustments(change: Vector, *, arc: bool = False) -> int:
            """Count the length of adjustments; with a law of growth, remember their sum."""
            if not arc and not walls.rings:
                norms.append(change)
                return -1
            length = add_length(change)
            adjustments.append(length)
            if ring:
                grown[length] = slope
            return length

        def add_hold(arc: WallArc, change: Vector) -> int:
            """Count the length of the adjustments with an arc whose sum is ``change``."""
            axis, sine, flat = self._axis(arc.first, arc.end)
            length = add_adjustments(change, arc=not flat)
            row = _along(axis, change, -1.0)
            if not flat:  # one wall: axis @ change <= 0
                row[length] = row.get(length, 0.0) + sine
            add_row(row)
            return length

        def bound_growth(apart: Vector) -> None:
            """Add the law of growth to a program."""
            if walls.rings:
                # |v|² <= a b as |(2 v, a - b)| <= a + b
                constant = grown.get(_CONSTANT, 0.0)
                doubled = [{key: 2 * x for key, x in part.items()} for part in apart]
                cones.append(
                    [
                        grown | {_CONSTANT: constant + 2 * outer},
                        *doubled,
                        grown | {_CONSTANT: constant - 2 * outer},
                    ]
                )

        def add_rare(point: Vector, normals: Floats, offsets: Floats) -> None:
            nonlocal size
            if len(offsets):
                rare.append((size, point, normals, offsets))
                size += len(offsets)

        def keep_inside(point: Vector) -> None:
            add_rare(point, *self._inside)
            if walls.radius:
                cones.append([{_CONSTANT: walls.radius}, *point])

        def add_contact(between: Range) -> Vector:
            segment = walls.segment(*between)
            if segment is not None:
                (x, y), (along_x, along_y) = segment[0].tolist(), segment[1].tolist()
                number = len(low)
                low.append(0.0)
                high.append(1.0)
                boxed.append(number)
                return {number: along_x, _CONSTANT: x}, {number: along_y, _CONSTANT: y}
            point = vector(lowest, highest)
            normals, offsets = self._arc_rows(*between)
            few = len(offsets) if len(offsets) <= _FEW else 1  # the last one is that of the chord
            split = len(offsets) - few
            add_rare(point, normals[:split], offsets[:split])
            for normal, offset in zip(
                normals[split:].tolist(), offsets[split:].tolist(), strict=True
            ):
                row = _along(normal, point, 1.0)
                row[_CONSTANT] = -offset
                add_row(row)
            if walls.radius:
                cones.append([{_CONSTANT: walls.radius}, *point])
            return point

        def equal(left: Sequence[Vector], right: Sequence[Vector]) -> None:
            """Add that points are equal to others."""
            nonlocal size
            for u, v in zip(left, right, strict=True):
                for number, difference in enumerate(_minus(u, v)):
                    equalities.append((size + number, size + number + 2, difference))
                size += 4

        far, near = (limit, limit), (-limit, -limit)
        lowest, highest = walls.low.tolist(), walls.high.tolist()
        wide = (walls.high - walls.low).tolist()
        narrow = [-x for x in wide]
        goals = [
            vector((x - tolerance, y - tolerance), (x + tolerance, y + tolerance))
            for x, y in self.goal.tolist()
        ]
        places = [_point(point) for point in self.start.tolist()]
        if not pattern:
            norms.append(_minus(goals[0], places[0]))
            change = _minus(_minus(goals[1], goals[0]), _minus(places[1], places[0]))
            equal([change], [({}, {})])
        gap: list[Vector] | None = None
        before: Vector = ({}, {})
        for number, item in enumerate(pattern):
            final = number == len(pattern) - 1
            if isinstance(item, HoldGap):
                begun = len(norms), len(costs)
                free = vector(near, far)
                add_translations(free)
                gap = [_plus(place, free) for place in places]
                if item.holds is None:
                    for particle in (0, 1):
                        change = vector(near, far)
                        add_adjustments(change)
                        gap[1 - particle] = _plus(gap[1 - particle], change)
                else:
                    for hold in sorted(item.holds):
                        change = vector(near, far)
                        add_hold(hold, change)
                        gap[1 - hold.particle] = _plus(gap[1 - hold.particle], change)
                gaps.append((number, range(begun[0], len(norms)), costs[begun[1] :]))
                if not final:
                    before = vector(narrow, wide)
                bound_growth(_minus(goals[1], goals[0]) if final else before)
                continue
            particle = item.particle
            sign = 1.0 if particle == 0 else -1.0
            first, last = add_contact(item.first), add_contact(item.last)
            if gap is None:
                before = _minus(places[1], places[0])
                travel = _minus(first, places[particle])
                if number:
                    add_translations(travel)
                else:
                    norms.append(travel)
                    if walls.rings:  # instead of |difference at the start|, its depth there
                        apart = self.start[1] - self.start[0]
                        axis = (-sign * apart / outer).tolist()
                        grown = _along(axis, first, 1.0)
                        grown[_CONSTANT] = (
                            grown.get(_CONSTANT, 0.0)
                            - float(np.dot(axis, walls.middle))
                            + ring / outer
                        )
                        depth = dict(grown)
            else:
                other = _combined(first, before, sign)
                equal(gap, [first, other] if particle == 0 else [other, first])
                gap = None
            after = _minus(goals[1], goals[0]) if final else vector(narrow, wide)
            change = _combined(({}, {}), _minus(after, before), sign)
            by_name = {"first": first, "last": last, "change": change}
            names = item.certain_contacts()
            for name in names[1:-1]:
                by_name[name] = add_contact(item.range(name))
            travels = [
                length
                for earlier, later in pairwise(names)
                for length in add_translations(_minus(by_name[later], by_name[earlier]))
            ]
            bound_growth(after)
            length = add_hold(item.arc, change)
            for between, turn in walls.turn_bounds(item):
                axis, sine, _ = self._axis(*between)
                row = _along(axis, change, -1.0)
                row[length] = sine
                most = turn * self._most_adjustment(item)
                for travelled in travels:
                    row[travelled] = most
                add_row(row)
            keep_inside(_combined(first, before, sign))
            other = _combined(last, after, sign)
            keep_inside(other)
            contacts.append((number, by_name))
            places = [last, other] if particle == 0 else [other, last]
            if final:
                norms.append(_minus(goals[particle], last))
        if gap is not None:
            equal(gap, goals)
        if walls.radius and pattern:
            least, angle, lines = self._growth
            add_row(dict.fromkeys(adjustments, 1.0) | {_CONSTANT: -least})
            if depth is None:
                add_row(dict.fromkeys(translations, 1.0) | {_CONSTANT: -angle})
            else:
                for factor, offset in lines:
                    row = {key: factor * x for key, x in depth.items()}
                    row[_CONSTANT] = row.get(_CONSTANT, 0.0) - offset
                    add_row(row | dict.fromkeys(translations, 1.0))
        return Program(
            norms, costs, rows, equalities, rare, size, cones, low, high, boxed, contacts, gaps
        )


def _rare_rows(
    program: Program, used: set[int], point: list[float] | None = None
) -> list[tuple[int, Expression]]:
    """Return the rare rows that a solution does not meet, or all, and add their numbers to ``used``,
    without those that are there already.
    """
    rows = []
    for first, place, normals, offsets in program.rare:
        if point is None:
            outside: Any = range(len(offsets))
        else:
            depths = normals @ [_value(part, point) for part in place] - offsets
            if depths.min() >= -_OUTSIDE:
                continue
            outside = np.flatnonzero(depths < -_OUTSIDE).tolist()
        for k in outside:
            if first + k not in used:
                used.add(first + k)
                row = _along(normals[k].tolist(), place, 1.0)
                row[_CONSTANT] = row.get(_CONSTANT, 0.0) - float(offsets[k])
                rows.append((first + k, row))
    return rows


def _point(point: Sequence[float]) -> Vector:
    return {_CONSTANT: point[0]}, {_CONSTANT: point[1]}


def _combined(u: Vector, v: Vector, sign: float) -> Vector:
    """Return u + sign v."""
    first, second = dict(u[0]), dict(u[1])
    for total, part in ((first, v[0]), (second, v[1])):
        for key, number in part.items():
            total[key] = total.get(key, 0.0) + sign * number
    return first, second


def _plus(u: Vector, v: Vector) -> Vector:
    return _combined(u, v, 1.0)


def _minus(u: Vector, v: Vector) -> Vector:
    return _combined(u, v, -1.0)


def _along(normal: Sequence[float], vector: Vector, sign: float) -> Expression:
    """Return sign normal . vector."""
    x, y = sign * normal[0], sign * normal[1]
    total = {key: x * number for key, number in vector[0].items()}
    for key, number in vector[1].items():
        total[key] = total.get(key, 0.0) + y * number
    return total


def _value(expression: Expression, point: list[float]) -> float:
    return sum(number * point[key] for key, number in expression.items())


def _redundant_pairs(corners: Floats) -> set[tuple[Range, Range]]:
    """Return the pairs of holds, each a wall and a particle, of which the second finds both
    particles on its wall, and so holds both: those with opposite normals times signs, in exact
    arithmetic.
    """
    points = [[Fraction(x) for x in corner] for corner in corners.tolist()]
    along = [
        (following[0] - point[0], following[1] - point[1])
        for point, following in zip(points, points[1:] + points[:1], strict=True)
    ]
    pairs = set()
    for k, edge in enumerate(along):
        for j, following_edge in enumerate(along):
            if edge[0] * following_edge[1] == edge[1] * following_edge[0]:
                same = edge[0] * following_edge[0] + edge[1] * following_edge[1] > 0
                for particle in (0, 1):
                    pairs.add(((k, particle), (j, particle if not same else 1 - particle)))
    return pairs


@dataclass(frozen=True)
class GapBranching:
    """How the plans of a pattern are divided: by the contact of a gap that is the first (or, from
    the right, the last) not to be in ``excluded``. It begins (or ends) one of ``choices``.
    """

    place: int
    excluded: frozenset[WallArc]
    right: bool
    choices: tuple[Hold, ...]


@dataclass(frozen=True)
class HoldBranching:
    """How the plans of a pattern are divided: by whether the contact ``name`` of a hold ("first",
    "last", "least", "most") is with a wall before ``wall`` or not; or by the "order" of its least
    and most contact.
    """

    place: int
    name: str
    wall: int


Branching = GapBranching | HoldBranching


def gap_branching(
    relaxation: Relaxation,
    pattern: Pattern,
    place: int,
    excluded: frozenset[WallArc],
    *,
    right: bool,
) -> GapBranching:
    """Return the branching of a gap, with as few choices as possible."""
    gap, walls = pattern[place], relaxation.walls
    assert isinstance(gap, HoldGap)
    beside = pattern[place + 1 : place + 2] if right else pattern[max(place - 1, 0) : place]
    neighbour = beside[0] if beside else None
    assert not isinstance(neighbour, HoldGap)
    removed = set(excluded)
    if not excluded and not walls.runs and isinstance(neighbour, Hold):
        removed = {neighbour.arc}  # the gap begins after the last contact with that wall
    if gap.holds is None:
        every = [WallArc(*between, particle) for between in walls.base for particle in (0, 1)]
    else:
        every = sorted(gap.holds)
    choices = []
    for arc in every:
        for between in _without(arc, removed, walls.count):
            hold = walls.hold(arc.particle, between, right=right, gap=gap.holds)
            if not excluded and isinstance(neighbour, Hold):
                pair = (hold, neighbour) if right else (neighbour, hold)
                # the neighbour has all contacts up to the gap that it may have
                maximal = neighbour.maximal[not right] if walls.runs else gap.holds is None
                if not relaxation.follows(*pair, maximal=maximal):
                    continue
            choices.append(hold)
    return GapBranching(place, excluded, right, tuple(choices))


def use_branchings(
    relaxation: Relaxation, pattern: Pattern, place: int, *, right: bool
) -> Iterator[GapBranching]:
    """Yield branchings of a gap by whether it has contacts outside some arcs.

    These arcs are all of the gap but one.
    """
    gap, walls = pattern[place], relaxation.walls
    assert isinstance(gap, HoldGap)
    every = gap.holds or frozenset(
        WallArc(*between, particle) for between in walls.base for particle in (0, 1)
    )
    for arc in sorted(every) if len(every) > 1 else []:
        hold = walls.hold(arc.particle, arc[:2], right=right, gap=gap.holds)
        yield GapBranching(place, every - {arc}, right, (hold,))


def _without(arc: WallArc, excluded: Iterable[WallArc], count: int) -> list[Range]:
    """Return the parts of an arc outside some others; ``count`` walls are a whole turn."""
    parts = [(arc.first, arc.end)]
    for removed in excluded:
        if removed.particle == arc.particle:
            for turn in (-count, 0, count):
                begin, end = removed.first + turn, removed.end + turn
                parts = [
                    (least, most)
                    for first, last in parts
                    for least, most in ((first, min(last, begin)), (max(first, end), last))
                    if least < most
                ]
    return parts


def branches(relaxation: Relaxation, pattern: Pattern, branching: Branching) -> list[Pattern]:
    """Return the patterns into which a branching divides a pattern."""
    before, item, after = (
        pattern[: branching.place],
        pattern[branching.place],
        pattern[branching.place + 1 :],
    )
    if isinstance(branching, HoldBranching):
        assert isinstance(item, Hold)
        return [(*before, half, *after) for half in halves(item, branching)]
    assert isinstance(item, HoldGap)
    near_gap = (HoldGap(branching.excluded),) if branching.excluded else ()
    middles: list[Pattern] = [near_gap]
    middles += [
        (item, hold, *near_gap) if branching.right else (*near_gap, hold, item)
        for hold in branching.choices
    ]
    every = item.holds is None
    return [
        (*before, *middle, *after)
        for middle in middles
        if all(
            isinstance(first, HoldGap)
            or isinstance(second, HoldGap)
            or relaxation.follows(first, second, maximal=every)
            for first, second in pairwise((*before[-1:], *middle, *after[:1]))
        )
    ]


def halves(hold: Hold, branching: HoldBranching) -> list[Hold]:
    """Return the holds into which a branching divides a hold."""
    if branching.name == "order":
        return [hold._replace(order=1), hold._replace(order=-1)]
    first, end = hold.range(branching.name)
    holds = []
    for between in ((first, branching.wall), (branching.wall, end)):
        parts: dict[str, Any] = {branching.name: between}
        half = hold._replace(**parts)
        low, high = half.least[0], half.most[1]
        ranges = [
            (max(between[0], low), min(between[1], high))
            for between in (half.first, half.last, half.least, half.most)
        ]
        if all(lower < upper for lower, upper in ranges):
            begins, ends, least, most = ranges
            holds.append(Hold(hold.particle, begins, ends, least, most, hold.order, hold.maximal))
    return holds
