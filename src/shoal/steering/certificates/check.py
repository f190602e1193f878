"""Check certificates of steering in exact arithmetic, without any code of the search.

The module uses whole numbers and fractions only: all coordinates are scaled so that they are whole,
and the multipliers of a certificate are multiples of a power of two. Roots, sines, cosines and
angles are rounded outward. The formulas are those of docs/concepts/steering/certificates.md.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from functools import cached_property, partial
from itertools import pairwise
from math import floor, isfinite, isqrt, lcm
from typing import Any, NamedTuple

from shoal.steering.certificates.check_contacts import Contacts, contact_values
from shoal.steering.certificates.check_potential import (
    BITS,
    WrongPotentialError,
    potential_value,
    whole,
)

STEP = 2**36  # multipliers are multiples of 1 / STEP
Pair = tuple[int, int]
Vector = tuple[dict[int, int], dict[int, int]]
_CONSTANT = -1  # key of the constant of an expression

WallArc = tuple[int, int, int]  # first wall, wall after the last, particle


class _Hold(NamedTuple):
    """Contacts of one particle; the ranges are those of their first, last, least and most walls.

    ``maximal`` says for the gap before and the gap after a run whether the next contact in it is one
    of the other particle.
    """

    particle: int
    first: Pair
    last: Pair
    least: Pair
    most: Pair
    order: int = 0
    maximal: tuple[bool, bool] = (False, False)


# An item of a pattern is a hold, or a gap: a list of its arcs, or None for all contacts.
Item = _Hold | list[WallArc] | None


class _WrongError(Exception):
    """A certificate that proves nothing."""


class _FlatWalls:
    """The walls of a convex polygon, in whole numbers."""

    radius = 0

    def __init__(self, corners: list[Pair]) -> None:
        following = corners[1:] + corners[:1]
        self.corners = corners
        self.count = len(corners)
        self.along = [(q[0] - p[0], q[1] - p[1]) for p, q in zip(corners, following, strict=True)]
        if len(corners) < 3 or any(
            _cross(self.along[k - 1], self.along[k]) <= 0 for k in range(self.count)
        ):
            raise _WrongError("the corners are not those of a convex polygon")
        if _turns(self.along) != 1:
            raise _WrongError("the corners go around more than once")
        self.normals = [(-y, x) for x, y in self.along]
        # all corners are at most R from a centre, and all walls at least q
        self.middle = tuple(
            sum(coordinates) // self.count for coordinates in zip(*corners, strict=True)
        )
        out = [(x - self.middle[0], y - self.middle[1]) for x, y in corners]
        near = min(
            -_dot(normal, corner) // _root(_dot(normal, normal))
            for normal, corner in zip(self.normals, out, strict=True)
        )
        self.far = _root(max(_dot(corner, corner) for corner in out))
        self.ring = self.far**2 - max(near, 0) ** 2
        xs, ys = zip(*corners, strict=True)
        self.low, self.high = (min(xs), min(ys)), (max(xs), max(ys))
        self.sides = [
            (normal, _dot(normal, corner))
            for normal, corner in zip(self.normals, corners, strict=True)
        ]

    def axis(self, first: int, end: int) -> tuple[Pair, int]:
        """Return m and s with m . u <= s |u| for each adjustment u of a contact with the walls.

        With w the greatest angle between m and an inward normal N of the walls, N . u <= 0 means an
        angle of 90 degrees or more between N and u, so of 90 degrees - w or more between m and u.
        """
        walls = [self.normals[k % self.count] for k in range(first, end)]
        axis = sum(x for x, _ in walls), sum(y for _, y in walls)
        if any(_dot(axis, normal) <= 0 for normal in walls):
            return axis, _root(_dot(axis, axis))
        # |m| sin w = max |m x N| / |N|, rounded up; 0 for one wall
        return axis, max(
            _ratio(abs(_cross(axis, normal)), isqrt(_dot(normal, normal))) for normal in walls
        )

    def arc(self, first: int, end: int) -> list[tuple[Pair, int]]:
        """Return normals N and numbers b with N . c >= b for all points c of the walls."""
        walls = [k % self.count for k in range(first, end)]
        chord = (
            -sum(self.normals[k][0] for k in walls),
            -sum(self.normals[k][1] for k in walls),
        )
        return [
            *(self.sides[k] for k in walls),
            (chord, _dot(chord, self.corners[first % self.count])),
        ]


class _RoundWalls:
    """The wall of a disk around the origin, as arcs between directions, in whole numbers."""

    def __init__(self, radius: int, directions: list[Pair]) -> None:
        following = directions[1:] + directions[:1]
        if (
            len(directions) < 3
            or radius <= 0
            or any(_cross(p, q) <= 0 for p, q in zip(directions, following, strict=True))
            or _turns(directions) != 1
        ):
            raise _WrongError("the directions do not go around the disk once")
        self.radius, self.directions = radius, directions
        self.far, self.ring, self.middle = radius, 0, (0, 0)
        self.count = len(directions)
        self.low, self.high = (-radius, -radius), (radius, radius)
        self.sides: list[tuple[Pair, int]] = []

    def _cone(self, first: int, end: int) -> tuple[Pair, list[Pair], bool]:
        """Return the sum of the directions at the ends of an arc, these directions, and whether the
        arc is small.
        """
        ends = [self.directions[first % self.count], self.directions[end % self.count]]
        middle = ends[0][0] + ends[1][0], ends[0][1] + ends[1][1]
        small = end - first <= self.count // 3
        if small and (
            _cross(*ends) <= 0 or any(_dot(middle, direction) <= 0 for direction in ends)
        ):
            raise _WrongError("a third of the directions goes around half of the disk")
        return middle, ends, small

    def axis(self, first: int, end: int) -> tuple[Pair, int]:
        """As that of flat walls; the normals are the opposite directions."""
        (x, y), ends, small = self._cone(first, end)
        if not small:
            return (-x, -y), _root(x * x + y * y)
        return (-x, -y), max(
            _ratio(abs(_cross((x, y), direction)), isqrt(_dot(direction, direction)))
            for direction in ends
        )

    def turn(self, first: int, end: int) -> int:
        """Return t with m . u <= (s + t d / r) |u| for each adjustment u of a contact at most d
        from a contact with an arc of at most a third of a turn, with m and s of its axis.

        Let the contact be the angle b beyond the end of the arc, so that 2 r sin(b / 2) <= d, and w
        the angle between m and the normal there. If w + b <= 90 degrees, m . u <= |m| |u| sin(w + b),
        and sin(w + b) - sin w = 2 sin(b / 2) cos(w + b / 2) <= 2 sin(b / 2) cos w. Otherwise this
        holds with the lesser angle b = 90 degrees - w. t is |m| cos w, rounded up.
        """
        middle, ends, _ = self._cone(first, end)
        return max(
            _ratio(_dot(middle, direction), isqrt(_dot(direction, direction))) for direction in ends
        )

    def arc(self, first: int, end: int) -> list[tuple[Pair, int]]:
        """As that of flat walls: with M the sum of the directions d at the ends, the contacts have
        M . c >= r M . d / |d| for one of these, rounded down.
        """
        middle, ends, small = self._cone(first, end)
        if not small:
            return []
        least = min(
            self.radius * _dot(middle, direction) // _root(_dot(direction, direction))
            for direction in ends
        )
        return [(middle, least)]


def check_unit(unit: Fraction, extent: Fraction) -> None:
    """Refuse a unit other than the least power of two above the extent of the workspace, which is
    given in this unit. Proofs may hold in other units, too, but a changed file is none of a search.
    """
    whole = unit.numerator * unit.denominator  # one of both is 1 for a power of two
    power = not whole & (whole - 1) and 1 in (unit.numerator, unit.denominator)
    if not (power and _LEAST_EXTENT <= extent < 1):
        raise _WrongError(
            "the unit is not the least power of two above the extent of the workspace"
        )


class _Task:
    """One assignment of goals to particles, in whole numbers."""

    def __init__(self, certificate: Mapping[str, Any], order: Sequence[int]) -> None:
        disk = "radius" in certificate
        flat = [] if disk else certificate["corners"]
        round_ = certificate["directions"] if disk else []
        origin = [Fraction(x) for x in (certificate["center"] if disk else flat[0])]
        unit = Fraction(certificate["unit"])
        if unit <= 0:
            raise _WrongError("the unit is not positive")

        def scaled(points: Sequence[Sequence[float]]) -> list[list[Fraction]]:
            return [
                [(Fraction(x) - least) / unit for x, least in zip(point, origin, strict=True)]
                for point in points
            ]

        goal = [certificate["goal"][k - 1] for k in order]
        places = [scaled(points) for points in (flat, certificate["start"], goal)]
        around = [[Fraction(x) for x in direction] for direction in round_]
        sizes = [
            Fraction(certificate[name]) / unit
            for name in ("tolerance", "limit", *(["radius"] if disk else []))
        ]
        numbers = [x for points in (*places, around) for point in points for x in point]
        self.whole = lcm(*(x.denominator for x in [*numbers, *sizes]))
        self.unit = unit
        if min(sizes) < 0:
            raise _WrongError("the tolerance or the limit is negative")
        corners, self.start, self.goal, directions = (
            [(int(x * self.whole), int(y * self.whole)) for x, y in points]
            for points in (*places, around)
        )
        self.tolerance, self.limit, *radius = (int(size * self.whole) for size in sizes)
        self.walls = _RoundWalls(radius[0], directions) if disk else _FlatWalls(corners)
        self.runs = certificate["runs"]
        # a proof by potentials does not read it
        if self.runs is not (disk or self.walls.count > _FEW_WALLS):
            raise _WrongError(
                f"holds are runs in disks and in polygons of more than {_FEW_WALLS} sides, and only"
                " there"
            )
        self.extent = (
            self.walls.high[0] - self.walls.low[0],
            self.walls.high[1] - self.walls.low[1],
        )
        check_unit(unit, Fraction(max(self.extent), self.whole))

    @cached_property
    def growth(self) -> tuple[int, int, list[tuple[int, int]]]:
        """The laws of growth of a disk up to the goals; see `_Program._add_growth`.

        The first number is the least sum of all adjustments, the second one the least sum of the
        translations if nothing is known of the first contact. The pairs have numbers s and t: this
        sum is at least t - s h / 8, where h is the depth at the first contact. All are rounded down.
        """
        radius = self.walls.radius
        start, goal = (_apart(end) for end in (self.start, self.goal))
        size = max(isqrt(_dot(goal, goal)) - 3 * self.tolerance, 0)
        # the angle a with sin(a / 2) = |D| / 2 r
        first, last = (
            _times_angle(radius, 2 * radius * radius - square, 2 * radius * radius)
            for square in (_dot(start, start), size * size)
        )
        most = min(_root(_dot(start, start)), 2 * radius)
        above = _times_angle(radius, radius - most, radius)[1]
        lines = []
        for slope in _SLOPES:
            # the straight line that touches r arccos(1 - h / r), or a higher one
            cosine = isqrt((slope * slope - 64) << (2 * _BITS)) // slope
            touching = _ratio(
                radius
                * (
                    _angle(cosine, 1)[1]
                    + (isqrt((slope * slope - 64) << (2 * _BITS)) + 1 - (slope << _BITS)) // 8
                    + 1
                ),
                1 << _BITS,
            )
            lines.append((slope, last[0] - max(touching, above - slope * most // 8)))
        return last[0] - first[1], last[0] - above, lines

    def are_opposite(self, first: _Hold, second: _Hold) -> bool:
        """Whether the second of two holds by flat walls always finds both particles on its wall."""
        walls = self.walls
        if self.runs or isinstance(walls, _RoundWalls):
            return False
        earlier, later = (walls.normals[hold.first[0] % walls.count] for hold in (first, second))
        sign = 1 if first.particle == second.particle else -1
        return _cross(earlier, later) == 0 and sign * _dot(earlier, later) < 0

    def are_one_hold(self, first: _Hold, second: _Hold) -> bool:
        """Whether two holds without contacts between them would be one hold."""
        if self.runs:
            return first.particle == second.particle
        count = self.walls.count
        return (first.particle, first.first[0] % count) == (
            second.particle,
            second.first[0] % count,
        )

    def value(self, pattern: Sequence[Item], leaf: Mapping[str, Any]) -> Fraction:
        """Return the bound that the multipliers of a leaf prove for all plans of a pattern."""
        program = _Program(self, pattern)
        vectors = leaf["norms"]
        if len(vectors) != len(program.norms):
            raise _WrongError(f"expected {len(program.norms)} norms, got {len(vectors)}")
        unit = self.whole * program.share
        total = dict.fromkeys(program.costs, STEP * unit)
        for vector, norm in zip(vectors, program.norms, strict=True):
            x, y = (_multiple(number) for number in vector)
            if x * x + y * y > STEP * STEP:
                raise _WrongError("the multiplier of a norm is longer than 1")
            for factor, expression in ((x, norm[0]), (y, norm[1])):
                _add(total, expression, factor * unit)
        for index, multiplier in leaf["slacks"]:
            slack = _multiple(multiplier)
            if slack < 0:
                raise _WrongError("the multiplier of a constraint is negative")
            _add(total, _numbered(program.rows, index)(), -slack * program.share)
        for index, *multipliers in leaf["cones"]:
            factors = [_multiple(number) for number in multipliers]
            length, vectors, scale = _numbered(program.cones, index)
            # t >= |v| and n >= |z| mean n t - z . v >= 0
            size = _root(sum(factor * factor for factor in factors))
            _add(total, length, -size * self.whole * scale)
            # fewer parts of z than of v, or more, are 0
            for factor, expression in zip(factors, vectors, strict=False):
                _add(total, expression, factor * self.whole * scale)
        value = total.pop(_CONSTANT, 0)
        for key, number in total.items():
            low, high = program.bounds[key]
            value += min(number * low, number * high)
        proven = Fraction(value, STEP * self.whole * unit) * self.unit
        return min(proven, Fraction(self.limit, self.whole) * self.unit)

    def children(self, pattern: Sequence[Item], node: Mapping[str, Any]) -> list[list[Item]]:
        """Return the patterns into which a node must divide its own."""
        place = node["place"]
        if not (isinstance(place, int) and 0 <= place < len(pattern)):
            raise _WrongError(f"a pattern has no item at {place}")
        before, item, after = list(pattern[:place]), pattern[place], list(pattern[place + 1 :])
        if isinstance(item, _Hold):
            return [[*before, half, *after] for half in _halves(item, node)]
        excluded = [_arc(numbers) for numbers in node["known"]]
        backwards = is_last(node["side"])
        beside = after[:1] if backwards else before[-1:]
        neighbour = beside[0] if beside and isinstance(beside[0], _Hold) else None
        holds = []
        for particle, begin, end in node["choices"]:
            _arc((begin, end, particle))
            holds.append(self._hold(particle, (begin, end), item, backwards=backwards))
        covered = [
            self._mask(arc, 0) | self._mask(arc, 1)
            for arc in [*excluded, *((*choice[1:], choice[0]) for choice in node["choices"])]
        ]
        missing = self._needed(item, excluded, neighbour, backwards=backwards)
        for mask in covered:
            missing &= ~mask
        if missing:
            raise _WrongError("a contact that a gap may have is missing")
        near_gap: list[Item] = [excluded] if excluded else []
        middles: list[list[Item]] = [near_gap]
        middles += [
            [item, hold, *near_gap] if backwards else [*near_gap, hold, item] for hold in holds
        ]

        def possible(earlier: Item, later: Item) -> bool:
            if not isinstance(earlier, _Hold) or not isinstance(later, _Hold):
                return True
            if self.are_opposite(earlier, later):
                return False
            # a hold beside a gap of all contacts has all contacts up to the gap that it may have
            return item is not None or not self.are_one_hold(earlier, later)

        return [
            [*before, *middle, *after]
            for middle in middles
            if all(
                possible(earlier, later)
                for earlier, later in pairwise([*before[-1:], *middle, *after[:1]])
            )
        ]

    def _hold(self, particle: int, between: Pair, gap: Item, *, backwards: bool) -> _Hold:
        """Return the hold of a gap that begins (or ends) with a range of walls.

        A run has all contacts of its particle up to the first contact of the other one, or up to
        the end of the gap; all are with the arcs of the gap.
        """
        if not self.runs:
            if between[1] - between[0] != 1:
                raise _WrongError("a hold that is no run has several walls")
            return _Hold(particle, between, between, between, between)
        arcs = [arc for arc in gap if arc[2] == particle] if isinstance(gap, list) else []
        if len(arcs) == 1:
            every = arcs[0][:2]
        else:  # numbers of all walls, from half a turn before the range
            first = (between[0] + between[1]) // 2 - self.walls.count // 2
            every = first, first + self.walls.count
        if not every[0] <= between[0] < between[1] <= every[1]:
            raise _WrongError("a range is more than a turn, or more than its arc")
        begins, ends = (every, between) if backwards else (between, every)
        return _Hold(particle, begins, ends, every, every, 0, (backwards, not backwards))

    def _mask(self, arc: WallArc, particle: int) -> int:
        """Return the walls of an arc of a particle as bits, those of particle 1 after all of 0."""
        first, end, owner = arc
        count = self.walls.count
        if owner != particle or end <= first:
            return 0
        if end - first >= count:
            bits = (1 << count) - 1
        else:
            bits = ((1 << (end - first)) - 1) << (first % count)
            bits = (bits | bits >> count) & ((1 << count) - 1)
        return bits << (count * particle)

    def _needed(
        self, gap: Item, excluded: list[WallArc], neighbour: _Hold | None, *, backwards: bool
    ) -> int:
        """Return the contacts with which a gap may begin (or end), as bits."""
        count = self.walls.count
        arcs = [(0, count, 0), (0, count, 1)] if gap is None else gap
        assert not isinstance(arcs, _Hold)
        needed = 0
        for arc in arcs:
            needed |= self._mask(arc, 0) | self._mask(arc, 1)
        if excluded or neighbour is None:
            return needed
        if self.runs:
            if neighbour.maximal[not backwards]:
                needed &= ~self._mask((0, count, neighbour.particle), neighbour.particle)
            return needed
        for wall in range(count):
            for particle in (0, 1):
                hold = self._hold(particle, (wall, wall + 1), gap, backwards=backwards)
                pair = (hold, neighbour) if backwards else (neighbour, hold)
                if self.are_opposite(*pair) or self.are_one_hold(*pair):
                    needed &= ~self._mask((wall, wall + 1, particle), particle)
        return needed


class _Program:
    """The convex program of a pattern: its norms, rows, cones, costs, and bounds of variables.

    A row is a function that returns the row, because most rows have no multiplier.
    """

    def __init__(self, task: _Task, pattern: Sequence[Item]) -> None:
        self.task = task
        self.bounds: list[Pair] = []
        self.norms: list[Vector] = []
        self.rows: list[Callable[[], dict[int, int]]] = []
        # with a number by which the cone must still be multiplied: all have the factor ``share``
        self.cones: list[tuple[Mapping[int, int], tuple[Mapping[int, int], ...], int]] = []
        self.costs: list[int] = []
        (x, y), (other_x, other_y) = task.start
        walls = task.walls
        # of the law of growth, times R: sqrt(k), and g
        self.share = walls.far if task.runs else 1
        self.slope = _root(walls.ring) if task.runs else 0
        self.grown = {
            _CONSTANT: _root((other_x - x) ** 2 + (other_y - y) ** 2) * walls.far + walls.ring
        }
        # of the laws of growth of a disk: lengths of translations from the first contact on, and of
        # all adjustments, and r times the depth at the first contact, if it is known
        self.translations: list[int] = []
        self.adjustments: list[int] = []
        self.depth: Mapping[int, int] | None = None
        self._build(pattern)
        if walls.radius and pattern:
            self._add_growth()

    def _add_vector(self, low: Pair, high: Pair) -> Vector:
        self.bounds.extend(zip(low, high, strict=True))
        return {len(self.bounds) - 2: 1}, {len(self.bounds) - 1: 1}

    def _add_box(self, reach: Pair) -> Vector:
        return self._add_vector((-reach[0], -reach[1]), reach)

    def _equal(self, left: Vector, right: Vector) -> None:
        # times the number that all other rows contain through their normals
        factor = self.task.whole
        for u, v in ((left, right), (right, left)):
            for expression in _minus(u, v):
                self.rows.append(
                    partial(
                        lambda expression: {
                            key: number * factor for key, number in expression.items()
                        },
                        expression,
                    )
                )

    def _above(self, normal: Pair, vector: Vector, offset: int) -> None:
        """Add the row normal . vector - offset."""

        def row() -> dict[int, int]:
            expression = _along(normal, vector, 1)
            expression[_CONSTANT] = expression.get(_CONSTANT, 0) - offset
            return expression

        self.rows.append(row)

    def _keep_inside(self, point: Vector) -> None:
        for normal, offset in self.task.walls.sides:
            self._above(normal, point, offset)
        if self.task.walls.radius:
            self.cones.append(({_CONSTANT: self.task.walls.radius}, point, self.share))

    def _add_contact(self, between: Pair) -> Vector:
        walls = self.task.walls
        first = between[0] % walls.count
        if isinstance(walls, _FlatWalls) and between[1] - between[0] == 1:
            self.bounds.append((0, 1))
            point = _constant(walls.corners[first])
            for axis in (0, 1):
                point[axis][len(self.bounds) - 1] = walls.along[first][axis]
            return point
        point = self._add_vector(walls.low, walls.high)
        for normal, offset in walls.arc(*between):
            self._above(normal, point, offset)
        if walls.radius:
            self.cones.append(({_CONSTANT: walls.radius}, point, self.share))
        return point

    def _add_length(self, change: Vector) -> int:
        """Return a variable that is at least the norm of a vector and part of the length."""
        self.bounds.append((0, self.task.limit))
        length = len(self.bounds) - 1
        self.costs.append(length)
        self.cones.append(({length: 1}, change, self.share))
        return length

    def _add_translations(self, change: Vector) -> int | None:
        """Count free translations; with the law of growth, remember the sum of their lengths.

        Return the variable of the length, if there is one.
        """
        if not self.task.runs:
            self.norms.append(change)
            return None
        length = self._add_length(change)
        self.translations.append(length)
        self.grown[length] = self.share + self.slope
        return length

    def _add_adjustments(self, change: Vector) -> None:
        """Count adjustments; with the law of growth, remember the sum of their lengths."""
        if self.task.runs:
            self._add_adjustment_length(change)
        else:
            self.norms.append(change)

    def _add_adjustment_length(self, change: Vector) -> int:
        """Return a variable for the length of adjustments with a sum, in the laws of growth."""
        length = self._add_length(change)
        self.adjustments.append(length)
        if self.slope:
            self.grown[length] = self.slope
        return length

    def _begin_growth(self, contact: Vector, item: _Hold) -> None:
        """Begin the law of growth with a first contact, from the middle."""
        walls, (p, q) = self.task.walls, self.task.start
        sign = 1 - 2 * item.particle
        apart = sign * (q[0] - p[0]), sign * (q[1] - p[1])
        grown = {_CONSTANT: walls.ring}
        for expression, factor in zip(contact, apart, strict=True):
            for key, number in expression.items():
                grown[key] = grown.get(key, 0) - number * factor
        self.grown = grown
        self.depth = dict(grown)

    def _bound_growth(self, apart: Vector) -> None:
        """Add the law of growth.

        All places p are in a disk of radius R around a middle, and each wall has a distance of at
        least q from it. With k = R² - q², the outward normal of a wall is at most a = asin(sqrt(k)
        / R) from the direction of each of its points. Let p and o be the places of both particles
        from the middle, D = o - p, and f = -p . o. So |D|² = |p|² + |o|² + 2 f <= 2 R² + 2 f.

        An adjustment u moves o while a wall with the outward normal n holds p, and n . u >= 0. So
        p . u >= -|p| sin a |u|, and f rises by at most sqrt(k) |u|.
        A translation t to the next contact, of p + t (as well as of o + t), has n . t >= 0 for the
        wall of this contact, and f rises by -t . (o + (p + t)) <= R |t| + sqrt(k) |t|.
        At the first contact, f = -|p|² - p . D <= -q² - p . D, and D is that of the start.
        Together, |D|² <= 2 R g, where g is k / R - p . D / R at the first contact + (1 + sqrt(k) /
        R) (sum of the translations) + sqrt(k) / R (sum of the adjustments). In a disk, k = 0. If
        the first contact is in a gap, -p . D / R <= |D|.
        """
        if self.task.runs:
            # |v|² <= a b as |(2 v, a - b)| <= a + b
            far = self.share
            doubled = tuple(
                {key: 2 * far * number for key, number in expression.items()}
                for expression in apart
            )
            least, most = dict(self.grown), dict(self.grown)
            least[_CONSTANT] -= 2 * far * far
            most[_CONSTANT] += 2 * far * far
            self.cones.append((most, (*doubled, least), 1))

    def _add_growth(self) -> None:
        """Add the laws of growth of a disk between its first contact and the goals.

        Let p and o be the places of both particles from the middle, and D = o - p. At a contact with
        p on the wall, let n = p / r, h = -n . D the depth of the other particle, and cos a = 1 - h /
        r, which is p . o / r². Both are in the disk, so |D|² <= 2 r h, or 2 r sin(a / 2) >= |D|. Let
        A = 2 r arcsin(|D| / 2 r). So r a >= A.

        Adjustments: u moves o, and n . u >= 0, so h does not rise. With s the part of D along the
        wall, D . u <= |s| |u|, and s² = |D|² - h² <= |D|² (1 - |D|² / 4 r²). So |D| rises by at most
        sqrt(1 - |D|² / 4 r²) |u|, and A by at most |u|. A translation does not change D. The sum of
        all adjustments is at least A at the goals - A at the start.

        Translations: t leads from one contact to the next. If p is on the wall at both, it turns by
        an angle d, and |t| = 2 r sin(d / 2). In its frame, (h, s) becomes at most h' = h cos d + |s|
        sin d <= r (cos d - cos(a + d)), because s² <= 2 r h - h². Let c = |t| / r. If a + c < pi,
        cos(a + c) - cos(a + d) <= d - c <= c² / 2 = 1 - cos d, because x <= sin x + sin² x up to 90
        degrees. So 1 - cos a' <= 1 - cos(a + c), and a rises by at most c.
        If o is on the wall at the next contact, let the axis x point along D. The place of p has x =
        -r h / |D| before, and o has x' = r h' / |D| after, so t has the part r (h + h') / |D| -
        |D| >= r (h' - h) / |D| along D, as |D|² <= 2 r h. The other particle's mirror image would
        touch with this depth, too, after a translation that is not longer; so a rises by at most c.
        From the first contact, with the angle a1, the sum of the translations is at least A at the
        goals - r a1. For each s, r a1 is at most a straight line t + s h.
        """
        whole, radius = self.task.whole, self.task.walls.radius
        least, free, lines = self.task.growth
        self.rows.append(
            lambda: dict.fromkeys(self.adjustments, whole) | {_CONSTANT: -least * whole}
        )
        depth = self.depth
        if depth is None:
            self.rows.append(
                lambda: dict.fromkeys(self.translations, whole) | {_CONSTANT: -free * whole}
            )
            return

        def row(slope: int, least: int) -> dict[int, int]:
            coefficients = dict.fromkeys(self.translations, whole)
            for key, number in depth.items():
                # rounded down by less than 1, and a coordinate of a contact is at most r
                coefficients[key] = coefficients.get(key, 0) + slope * number * whole // (
                    8 * radius
                )
            coefficients[_CONSTANT] = (
                coefficients.get(_CONSTANT, 0) - least * whole + 2 * radius + 1
            )
            return coefficients

        self.rows += [partial(row, *line) for line in lines]

    def _most_adjustment(self, hold: _Hold) -> int:
        """Return the greatest sum of the adjustments of a run at a round wall, in plans within the
        limit, rounded up.

        The adjustments do not move the held particle. By other inputs, it comes from its start to
        all contacts, and from there to its goal.
        """
        task = self.task
        (to_first, from_first), (to_last, from_last) = (
            [self._distance(between, points[hold.particle]) for points in (task.start, task.goal)]
            for between in (hold.first, hold.last)
        )
        path = (
            max(to_first + from_first, to_first + from_last, to_last + from_last)
            - 2 * task.tolerance
        )
        return max(task.limit - path, 0)

    def _distance(self, between: Pair, point: Pair) -> int:
        """Return a lower bound on the distance of a point from a contact with a round wall."""
        walls = self.task.walls
        return max(
            0,
            walls.radius - _root(_dot(point, point)),
            *(
                (offset - _dot(normal, point)) // _root(_dot(normal, normal))
                for normal, offset in walls.arc(*between)
            ),
        )

    def _bound_turn(self, hold: _Hold, travels: Sequence[int], length: int, change: Vector) -> None:
        """Add that the adjustments of a run turn only as far as its contacts are from an arc.

        Each contact is at most the travel of the run, T, from its first contact, as well as from
        its last one, and at most T / 2 from one of them, which counts if both are with one arc.
        With d the greatest distance, M the greatest sum L of the adjustments, and their sum y,
        m . y <= (s + t d / r) L <= s L + t d M / r.
        """
        walls = self.task.walls
        if not isinstance(walls, _RoundWalls):
            return
        every = hold.least[0], hold.most[1]
        share = 2 if hold.first == hold.last else 1
        for between in dict.fromkeys((hold.first, hold.last)):
            if between == every or between[1] - between[0] > walls.count // 3:
                continue
            self.rows.append(partial(self._turn_row, hold, between, share, travels, length, change))

    def _turn_row(
        self,
        hold: _Hold,
        between: Pair,
        share: int,
        travels: Sequence[int],
        length: int,
        change: Vector,
    ) -> dict[int, int]:
        walls = self.task.walls
        assert isinstance(walls, _RoundWalls)
        axis, sine = walls.axis(*between)
        turn = _ratio(walls.turn(*between) * self._most_adjustment(hold), share * walls.radius)
        return _along(axis, change, -1) | {length: sine} | dict.fromkeys(travels, turn)

    def _add_hold(self, first: int, end: int, change: Vector) -> int | None:
        """Count the length of adjustments whose sum is a vector, by a hold of some walls.

        Return the variable of the length, or None for one flat wall.
        """
        walls = self.task.walls
        axis, sine = walls.axis(first, end)
        if isinstance(walls, _FlatWalls) and end - first == 1:
            self._add_adjustments(change)
            self.rows.append(lambda: _along(axis, change, -1))
            return None
        length = self._add_adjustment_length(change)

        def row() -> dict[int, int]:
            return _along(axis, change, -1) | {length: sine}

        self.rows.append(row)
        return length

    def _build(self, pattern: Sequence[Item]) -> None:
        task, norms = self.task, self.norms
        far, tolerance = (task.limit, task.limit), task.tolerance
        goals = [
            self._add_vector((x - tolerance, y - tolerance), (x + tolerance, y + tolerance))
            for x, y in task.goal
        ]
        places = [_constant(point) for point in task.start]
        if not pattern:
            self._equal(_minus(_minus(goals[1], goals[0]), _minus(places[1], places[0])), ({}, {}))
            norms.append(_minus(goals[0], places[0]))
            return
        reached: list[Vector] | None = None
        before: Vector = ({}, {})
        for number, item in enumerate(pattern):
            final = number == len(pattern) - 1
            if not isinstance(item, _Hold):
                free = self._add_box(far)
                self._add_translations(free)
                reached = [_plus(place, free) for place in places]
                for first, end, particle in (
                    [(0, 0, 0), (0, 0, 1)] if item is None else sorted(item)
                ):
                    change = self._add_box(far)
                    if item is None:
                        self._add_adjustments(change)
                    else:
                        self._add_hold(first, end, change)
                    reached[1 - particle] = _plus(reached[1 - particle], change)
                if not final:
                    before = self._add_box(task.extent)
                self._bound_growth(_minus(goals[1], goals[0]) if final else before)
                continue
            first_contact, last_contact = (
                self._add_contact(item.first),
                self._add_contact(item.last),
            )

            def partner(
                contact: Vector, apart: Vector, sign: int = 1 - 2 * item.particle
            ) -> Vector:
                return _combined(contact, apart, sign)

            if reached is None:
                before = _minus(places[1], places[0])
                travel = _minus(first_contact, places[item.particle])
                if number:
                    self._add_translations(travel)
                else:
                    norms.append(travel)
                    if task.runs:
                        self._begin_growth(
                            _minus(first_contact, _constant(task.walls.middle)), item
                        )
            else:
                positions = [first_contact, partner(first_contact, before)]
                for position, expected in zip(
                    reached, positions[:: 1 - 2 * item.particle], strict=True
                ):
                    self._equal(position, expected)
                reached = None
            after = _minus(goals[1], goals[0]) if final else self._add_box(task.extent)
            contacts = [
                first_contact,
                *(self._add_contact(between) for between in _between(item)),
                last_contact,
            ]
            travels = [
                self._add_translations(_minus(later, earlier))
                for earlier, later in pairwise(contacts)
            ]
            self._bound_growth(after)
            change = partner(({}, {}), _minus(after, before))
            length = self._add_hold(item.least[0], item.most[1], change)
            if length is not None:
                self._bound_turn(
                    item, [variable for variable in travels if variable is not None], length, change
                )
            self._keep_inside(partner(first_contact, before))
            self._keep_inside(partner(last_contact, after))
            places = [last_contact, partner(last_contact, after)][:: 1 - 2 * item.particle]
            if final:
                norms.append(_minus(goals[item.particle], last_contact))
        if reached is not None:
            self._equal(reached[0], goals[0])
            self._equal(reached[1], goals[1])


def _between(hold: _Hold) -> list[Pair]:
    """Return the walls of contacts that a hold certainly has between its first and its last."""
    if hold.order:
        return [hold.least, hold.most][:: hold.order]
    if hold.least[1] <= max(hold.first[0], hold.last[0]):
        return [hold.least]
    if hold.most[0] >= min(hold.first[1], hold.last[1]):
        return [hold.most]
    return []


def _halves(hold: _Hold, node: Mapping[str, Any]) -> list[_Hold]:
    """Return the two cases into which a node divides a hold, without those that cannot be."""
    if node["name"] == "order":
        if hold.order:
            raise _WrongError("the order of a hold is divided again")
        return [hold._replace(order=1), hold._replace(order=-1)]
    names = ("first", "last", "least", "most")
    place, wall = names.index(node["name"]), node["wall"]
    ranges = [hold.first, hold.last, hold.least, hold.most]
    first, end = ranges[place]
    if not (isinstance(wall, int) and first < wall < end):
        raise _WrongError(f"a hold has no wall {wall} to be divided at")
    holds = []
    for between in ((first, wall), (wall, end)):
        ranges[place] = between
        low, high = ranges[2][0], ranges[3][1]
        inner = [(max(lower, low), min(upper, high)) for lower, upper in ranges]
        if all(lower < upper for lower, upper in inner):
            first_, last, least, most = inner
            holds.append(_Hold(hold.particle, first_, last, least, most, hold.order, hold.maximal))
    return holds


_FEW_WALLS = 8  # of a polygon in which a hold is by one wall
_LEAST_EXTENT = Fraction(1, 2) - Fraction(1, 1 << 20)  # with the rounding of an extent
_PIECES = 256  # of the least distance, in the law of growth
_BITS = 240  # of cosines and angles
_HALVES = 20  # of an angle
_SLOPES = (8, 9, 12, 16, 24)  # of straight lines above an angle, times 8


def _growth(task: _Task) -> Fraction:
    """Return a bound for a disk from the law of growth, where a plan cannot be a translation.

    Let d be the least |D| of a plan, D the vector between the particles. The sum of the adjustments
    is at least as long as a path of D from the start to the goal that stays outside the disk of
    radius d: two tangents and an arc. From then on, the depth at the next contact is at most d, so
    that the translations are at least as long as by the law of growth from there (`_Program._add_growth`).
    Each piece of the interval of d has the path of its lower and the translations of its upper end.

    A goal within the tolerance changes D by less than 3 tolerances.
    """
    walls, slack = task.walls, 3 * task.tolerance
    if not walls.radius:
        raise _WrongError("the law of growth is for disks")
    ends = [(q[0] - p[0], q[1] - p[1]) for p, q in (task.start, task.goal)]
    start, goal = (isqrt(_dot(end, end)) for end in ends)
    apart = ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]
    straight = isqrt(_dot(apart, apart)) - slack
    if straight <= 0:
        raise _WrongError("the law of growth is not for a translation")
    scale, low = 1 << _BITS, max(goal - slack, 0)
    turn = _angle(_dot(*ends) * scale, start * goal)[0] if start and goal else 0
    grown = _times_angle(walls.radius, 2 * walls.radius**2 - low * low, 2 * walls.radius**2)[0]
    most, least = min(start, goal + slack) + 1, None  # no plan has a greater d
    for number in range(_PIECES):
        inner = most * number // _PIECES - slack
        outer = most * (number + 1) // _PIECES + 1
        path = straight
        if 0 < inner < min(start, goal):
            between = turn - sum(_angle(inner * scale, end)[1] for end in (start, goal))
            if between > 0:
                tangents = sum(isqrt(end * end - inner * inner) for end in (start, goal))
                path = max(path, tangents + inner * between // scale - slack)
        depth = min(outer, 2 * walls.radius)
        path += max(grown - _times_angle(walls.radius, walls.radius - depth, walls.radius)[1], 0)
        least = path if least is None else min(least, path)
    assert least is not None
    return Fraction(least, task.whole) * task.unit


def _angle(numerator: int, denominator: int) -> Pair:
    """Return the angle with the cosine part / whole / 2**_BITS, rounded down and up; times 2**_BITS.

    The chord c of an angle is sqrt(2 - 2 cos), that of half of it sqrt(2 - sqrt(4 - c²)). A small
    angle a is between its chord 2 sin(a / 2) and c (1 + c² / 20).
    """
    scale = 1 << _BITS
    angles = []
    for cosine, up in ((-(-numerator // denominator), 0), (numerator // denominator, 1)):
        square = 2 * scale - 2 * max(min(cosine, scale), -scale)  # of the chord
        for _ in range(_HALVES):
            inner = (4 * scale - square) * scale
            square = 2 * scale - (isqrt(inner) if up else _root(inner))
        chord = _root(square * scale) if up else isqrt(square * scale)
        if up:
            chord += chord * square // (20 * scale) + 1
        angles.append(chord << _HALVES)
    return angles[0], angles[1]


def _times_angle(size: int, numerator: int, denominator: int) -> Pair:
    """Return a size times the angle with the cosine numerator / denominator, rounded down and up."""
    low, high = _angle(numerator << _BITS, denominator)
    return size * low >> _BITS, _ratio(size * high, 1 << _BITS)


def _potentials(task: _Task, proof: Mapping[str, Any]) -> Iterator[Fraction]:
    """Yield the bounds of potentials for a disk or a polygon, each at most the limit."""
    walls, radius = task.walls, task.walls.far
    start, goal = (
        [
            Fraction(x - middle, radius)
            for point in points
            for x, middle in zip(point, walls.middle, strict=True)
        ]
        for points in (task.start, task.goal)
    )
    near, ring = Fraction(task.tolerance, radius), Fraction(walls.ring, radius**2)
    most = Fraction(task.limit, radius)
    try:
        if "parts" in proof:
            most = min(most, Fraction(whole(proof["limit"]), 1 << BITS))
            values = contact_values(Contacts(start, goal, near, most, ring), proof)
        else:
            values = iter([potential_value(start, goal, near, most, ring, proof)])
        for value in values:
            yield min(value, most) * radius / task.whole * task.unit
    except WrongPotentialError as error:
        raise _WrongError(str(error)) from error
    yield most * radius / task.whole * task.unit


def _apart(ends: Sequence[Pair]) -> Pair:
    return ends[1][0] - ends[0][0], ends[1][1] - ends[0][1]


def _leaves(
    task: Any, proof: Sequence[Mapping[str, Any]]
) -> Iterator[tuple[list[Any], Mapping[str, Any]]]:
    """Yield the leaves of a proof with their patterns, and check that no case is missing.

    The task has the method ``children``.
    """
    stack: list[list[Any]] = [[None]]  # all plans
    for number, node in enumerate(proof):
        if not stack:
            raise _WrongError("the proof goes on after its last case")
        if len(stack) > len(proof) - number:
            break
        pattern = stack.pop()
        if "norms" in node:
            yield pattern, node
        else:
            stack += task.children(pattern, node)[::-1]
    if stack:
        raise _WrongError(f"{len(stack)} cases are missing")


def _values(task: _Task, proof: Any) -> Iterator[Fraction]:
    """Yield the bound of each leaf of a proof."""
    if proof == "growth":
        yield _growth(task)
        return
    if isinstance(proof, Mapping):
        yield from _potentials(task, proof)
        return
    for pattern, leaf in _leaves(task, proof):
        yield task.value(pattern, leaf)


def is_last(side: Any) -> bool:
    """Return whether a side is "last", and refuse what is none of both sides."""
    if side not in ("first", "last"):
        raise _WrongError(f"no side is {str(side)[:40]!r}")
    return bool(side == "last")


def _multiple(number: float) -> int:
    if not isfinite(number) or floor(number * STEP) != number * STEP:
        raise _WrongError(f"a multiplier is no multiple of 2**-36: {number!r}")
    return int(number * STEP)


def _arc(numbers: Sequence[int]) -> WallArc:
    first, end, particle = numbers
    if not all(isinstance(x, int) for x in numbers) or particle not in (0, 1) or first >= end:
        raise _WrongError(f"no arc is {list(numbers)}")
    return first, end, particle


def _numbered(values: Sequence[Any], index: Any) -> Any:
    if not (isinstance(index, int) and 0 <= index < len(values)):
        raise _WrongError(f"no constraint has the number {index}")
    return values[index]


def _turns(vectors: Sequence[Pair]) -> int:
    """How often vectors turn around: changes from down to up."""
    ups = [y > 0 or (y == 0 and x > 0) for x, y in vectors]
    return sum(up and not before for before, up in zip([ups[-1], *ups], ups, strict=False))


def _root(square: int) -> int:
    """Return the root of a whole number, rounded up."""
    root = isqrt(square)
    return root + (root * root < square)


def _ratio(numerator: int, denominator: int) -> int:
    """Return a ratio of whole numbers, rounded up."""
    return -(-numerator // denominator)


def _add(total: dict[int, Any], expression: Mapping[int, Any], factor: int) -> None:
    for key, number in expression.items():
        total[key] = total.get(key, 0) + factor * number


def _cross(u: Pair, v: Pair) -> int:
    return u[0] * v[1] - u[1] * v[0]


def _dot(u: Pair, v: Pair) -> int:
    return u[0] * v[0] + u[1] * v[1]


def _constant(point: Pair) -> Vector:
    return {_CONSTANT: point[0]}, {_CONSTANT: point[1]}


def _combined(u: Vector, v: Vector, sign: int) -> Vector:
    first, second = (
        {key: a.get(key, 0) + sign * b.get(key, 0) for key in a.keys() | b.keys()}
        for a, b in zip(u, v, strict=True)
    )
    return first, second


def _plus(u: Vector, v: Vector) -> Vector:
    return _combined(u, v, 1)


def _minus(u: Vector, v: Vector) -> Vector:
    return _combined(u, v, -1)


def _along(normal: Pair, vector: Vector, sign: int) -> dict[int, int]:
    x, y = vector
    return {
        key: sign * (normal[0] * x.get(key, 0) + normal[1] * y.get(key, 0))
        for key in x.keys() | y.keys()
    }
