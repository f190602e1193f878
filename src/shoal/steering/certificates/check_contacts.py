"""Check the bound of potentials between the first and the last contact, in exact arithmetic.

The formulas are those of docs/concepts/steering/certificates.md; units as in `check_potential`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from math import comb, floor, isqrt, lcm
from typing import Any, NamedTuple

from shoal.steering.certificates.check_potential import (
    BITS,
    Polynomial,
    WrongPotentialError,
    changed_by,
    check_positive,
    degree_of,
    ellipse,
    excess,
    whole,
)

Point = tuple[Fraction, Fraction]
Flat = dict[tuple[int, int], Fraction]
"""A polynomial of the two coordinates of a contact."""

_ROOT = 1 << 64
MOST_PARTS = 10_000  # of a proof


class Sector(NamedTuple):
    """Contacts of one particle between two directions, less than half a turn from each other."""

    particle: int
    first: Point
    last: Point


def dot(u: Point, v: Point) -> Fraction:
    """Return the dot product."""
    return u[0] * v[0] + u[1] * v[1]


def cross_product(u: Point, v: Point) -> Fraction:
    """Return the cross product."""
    return u[0] * v[1] - u[1] * v[0]


def root(x: Fraction, *, up: bool = False) -> Fraction:
    """Return a square root, rounded to a multiple of 2**-64."""
    return Fraction(isqrt(floor(x * _ROOT * _ROOT)) + up, _ROOT)


def flat_monomials(degree: int) -> list[tuple[int, int]]:
    """Return all monomials of two coordinates up to a degree, the constant first."""
    return sorted(
        ((a, b) for a in range(degree + 1) for b in range(degree + 1 - a)),
        key=lambda powers: (sum(powers), powers),
    )


class Contacts:
    """What is known of the first and the last contact of the plans within a limit.

    Parameters
    ----------
    start, goal : sequence of Fraction
        Four coordinates each.
    tolerance, limit, ring : Fraction
        As in `check_potential.potential_value`.
    """

    def __init__(
        self,
        start: Sequence[Fraction],
        goal: Sequence[Fraction],
        tolerance: Fraction,
        limit: Fraction,
        ring: Fraction,
    ) -> None:
        self.ends = [tuple(start), tuple(goal)]
        self.near, self.limit, self.ring = tolerance, limit, ring
        self.apart = [(x[2] - x[0], x[3] - x[1]) for x in self.ends]
        self.inner = root(1 - ring)
        moved = (self.apart[1][0] - self.apart[0][0], self.apart[1][1] - self.apart[0][1])
        self._moved = max(root(dot(moved, moved)) - 3 * tolerance, Fraction(0))
        # the other particle is in the disk, so that contacts are so far on its other side at least
        self._back = [
            (dot(way, way) - ring - slack * (2 + slack)) / (2 * root(dot(way, way), up=True))
            for way, slack in zip(self.apart, (Fraction(0), 3 * tolerance), strict=True)
        ]

    @property
    def possible(self) -> bool:
        """Whether each plan has a contact, and its first and last ones are in `roots`."""
        return self._moved > 0 and all(x > 0 for x in self._back)

    def place(self, end: int, particle: int) -> Point:
        """Return the place of a particle at the start or the goal."""
        x = self.ends[end]
        return x[2 * particle], x[2 * particle + 1]

    def to_other(self, end: int, particle: int) -> Point:
        """Return the vector from a particle to the other one at the start or the goal."""
        x, y = self.apart[end]
        return (x, y) if particle == 0 else (-x, -y)

    def roots(self) -> list[tuple[Sector, Sector]]:
        """Return pairs of sectors that hold the first and the last contact of each plan."""
        sectors: list[list[Sector]] = [[], []]
        for end, far in enumerate(self._back):
            for particle in (0, 1):
                x, y = self.to_other(end, particle)
                size = root(x * x + y * y, up=True)
                back = -x / size * far, -y / size * far
                side = -y / size, x / size
                first = side[0] + back[0], side[1] + back[1]
                sectors[end].append(Sector(particle, first, (back[0] - side[0], back[1] - side[1])))
        return [(first, last) for first in sectors[0] for last in sectors[1]]

    def least(self, sector: Sector, vector: Point) -> Fraction:
        """Return a lower bound on the dot product of a vector and a contact."""
        size = root(dot(vector, vector), up=True)
        if cross_product(sector.first, vector) <= 0 <= cross_product(sector.last, vector):
            return -size  # the opposite direction is in the sector
        values = []
        for direction in sector[1:]:
            along = dot(direction, vector)
            length = dot(direction, direction)
            values += [along * far / root(length, up=along * far > 0) for far in (self.inner, 1)]
        return min(values)

    def center(self, sector: Sector) -> Point:
        """Return a point near the middle of a sector."""
        x, y = sector.first[0] + sector.last[0], sector.first[1] + sector.last[1]
        size = root(x * x + y * y, up=True)
        return x / size, y / size

    def width(self, sector: Sector) -> Fraction:
        """Return an upper bound on the distance of contacts of a sector from its `center`."""
        center = self.center(sector)
        square = 1 + dot(center, center) - 2 * self.least(sector, center)
        return root(max(square, Fraction(0)), up=True)

    def region(self, first: Sector, last: Sector) -> list[Polynomial] | None:
        """Return quadratic polynomials, times 2**40, that are at least 0 at all states between the
        first and the last contact; None if there are no plans within the limit.

        The states are on a path from one contact to the other. A particle moves by the translations
        and the adjustments of the other one's holds, and the difference by all adjustments, so that
        the lengths of the three paths are together at most twice that of the plan.
        """
        slack, known, wide, left = 3 * self.near, [], Fraction(0), self.limit + 3 * self.near
        for end, sector in enumerate((first, last)):
            other = self.to_other(end, sector.particle)
            outside = 1 - self.ring + dot(other, other) + 2 * self.least(sector, other)
            if outside > (1 + (slack if end else 0)) ** 2:
                return None
            center = self.center(sector)
            wide += self.width(sector)
            place = self.place(end, sector.particle)
            apart = (center[0] - place[0], center[1] - place[1])
            size = root(dot(apart, apart), up=True)
            if size:
                normal = (apart[0] / size, apart[1] / size)
                left -= max(self.least(sector, normal) - dot(normal, place), Fraction(0))
            there = (center[0] + other[0], center[1] + other[1])
            known.append((center, there) if sector.particle == 0 else (there, center))
        if left <= 0:
            return None
        wide += slack
        paths = []
        for particle in (0, 1):
            u, v = known[0][particle], known[1][particle]
            way = (v[0] - u[0], v[1] - u[1])
            paths.append(max(root(dot(way, way)) - wide, Fraction(0)))
        paths.append(self._moved)
        found = []
        before, after = ([*pair[0], *pair[1]] for pair in known)
        for number, path in enumerate(paths):
            most = min(left, 2 * left - sum(paths) + path)
            if most <= path:
                return None
            one = ellipse(before, after, number, most + (slack if number == 2 else wide))
            if one is None:
                return None
            found.append(one)
        return found

    def positive(self, end: int, sector: Sector) -> list[Flat]:
        """Return polynomials that are at least 0 at the contacts of a sector, the first one of which is
        1 - |c|².
        """
        one, zero = Fraction(1), (0, 0)
        disk: Flat = {zero: one, (2, 0): -one, (0, 2): -one}
        lines: list[Flat] = []
        for (x, y), sign in ((sector.first, 1), (sector.last, -1)):
            lines.append({(1, 0): -sign * y, (0, 1): sign * x})
        x, y = self.to_other(end, sector.particle)
        far = (1 + (3 * self.near if end else 0)) ** 2
        lens = {
            zero: far - x * x - y * y,
            (1, 0): -2 * x,
            (0, 1): -2 * y,
            (2, 0): -one,
            (0, 2): -one,
        }
        found = [disk, *lines, flat_product(*lines), lens]
        if self.ring:
            found.append({zero: self.ring - 1, (2, 0): one, (0, 2): one})
        return found


def flat_product(u: Flat, v: Flat) -> Flat:
    """Return the product of two polynomials."""
    total: Flat = {}
    for (a, b), x in u.items():
        for (c, d), y in v.items():
            total[a + c, b + d] = total.get((a + c, b + d), Fraction(0)) + x * y
    return total


def at_contact(
    powers: Sequence[int], particle: int, other: Sequence[Any], unit: int = 1
) -> dict[tuple[int, int], Any]:
    """Return the value of a monomial where one particle is at c, and the other one at c + ``other`` /
    ``unit``, times the power of the unit with the degree in the coordinates of the other one.
    """
    own, its = powers[2 * particle :][:2], powers[2 - 2 * particle :][:2]
    return {
        (own[0] + i, own[1] + j): comb(its[0], i)
        * other[0] ** (its[0] - i)
        * comb(its[1], j)
        * other[1] ** (its[1] - j)
        * unit ** (i + j)
        for i in range(its[0] + 1)
        for j in range(its[1] + 1)
    }


def degree_of_squares(degree: int, number: int) -> int:
    """Return the degree of the squares that are multiplied with a polynomial of a sector, for a
    potential of some degree.
    """
    return (degree + 1) // 2 - bool(number)


def contact_values(contacts: Contacts, proof: Mapping[str, Any]) -> Iterator[Fraction]:
    """Yield the lower bound of each part of a proof, in units of the radius.

    A plan goes from the start to its first contact c, along |c - p| at least, with the difference of the
    start; and from its last contact c' to the goal, with that of the goal. If V falls by at most the
    length of each input between both contacts, no plan is shorter than the least n.(c - p) + V at c,
    plus the least n'.(p' - c') - V at c', for any n and n' no longer than 1. Both are shown by sums
    of squares.
    """
    if not contacts.possible:
        raise WrongPotentialError("plans need no contact, or places are too near each other")
    stack, parts = contacts.roots()[::-1], iter(proof["parts"])
    for number, part in enumerate(parts):
        if not stack or number >= MOST_PARTS:
            raise WrongPotentialError("a proof has too many parts")
        pair = stack.pop()
        if "direction" in part:
            stack += split(pair, part["side"], part["direction"])[::-1]
            continue
        around = contacts.region(*pair)
        if around is not None:
            if "potential" not in part:
                raise WrongPotentialError("plans with some first and last contacts have no bound")
            yield part_value(contacts, pair, around, part)
    if stack:
        raise WrongPotentialError(f"{len(stack)} first and last contacts are missing")


def split(
    pair: tuple[Sector, Sector], side: Any, direction: Sequence[float]
) -> list[tuple[Sector, Sector]]:
    """Return both parts of a pair of sectors, of which one is cut at a direction."""
    if side not in ("first", "last"):
        raise WrongPotentialError(f"no side is {side!r}")
    sector = pair[side == "last"]
    x, y = (Fraction(whole(z), 1 << BITS) for z in direction)
    middle = x, y
    if not (cross_product(sector.first, middle) > 0 and cross_product(middle, sector.last) > 0):
        raise WrongPotentialError("a direction is not in its sector")
    halves = [sector._replace(last=middle), sector._replace(first=middle)]
    return [(half, pair[1]) if side == "first" else (pair[0], half) for half in halves]


def part_value(
    contacts: Contacts,
    pair: tuple[Sector, Sector],
    around: Sequence[Polynomial],
    part: Mapping[str, Any],
) -> Fraction:
    """Return the lower bound for the plans with their first and last contacts in two sectors."""
    if len(part["ends"]) != 2:
        raise WrongPotentialError("a potential has another number of ends")
    potential, rest = excess(around, contacts.ring, part)
    total = -2 * contacts.near - changed_at_last_contact(contacts, pair[1], potential)
    for end, (sector, given) in enumerate(zip(pair, part["ends"], strict=True)):
        total += _end(contacts, end, sector, potential, given)
    return max(total, Fraction(0)) / (1 + rest)


def changed_at_last_contact(
    contacts: Contacts, sector: Sector, potential: Mapping[Any, int]
) -> Fraction:
    """Return how much a potential changes at most at the last contact, if the difference of the
    particles there is not that of the goals, but one within the tolerance.
    """
    other, middle = contacts.to_other(1, sector.particle), contacts.center(sector)
    there = middle[0] + other[0], middle[1] + other[1]
    still, moved = (Fraction(0),) * 2, (2 * contacts.near,) * 2
    places, moves = [middle, there], [still, moved]
    if sector.particle == 1:
        places, moves = places[::-1], moves[::-1]
    return changed_by(
        potential, [*places[0], *places[1]], contacts.width(sector), [*moves[0], *moves[1]]
    )


def _end(
    contacts: Contacts,
    end: int,
    sector: Sector,
    potential: Mapping[Any, int],
    given: Mapping[str, Any],
) -> Fraction:
    """Return a lower bound on n.(c - p) + V at the first contact, or n.(p - c) - V at the last one."""
    x, y = (Fraction(whole(z), 1 << BITS) for z in given["direction"])
    if x * x + y * y > 1:
        raise WrongPotentialError("a direction is longer than 1")
    sign, degree = -1 if end else 1, degree_of(potential)
    place, other = contacts.place(end, sector.particle), contacts.to_other(end, sector.particle)
    # with whole numbers, this is much faster
    unit = lcm(other[0].denominator, other[1].denominator)
    ways = [int(z * unit) for z in other]
    sums: dict[tuple[int, int], int] = {}
    for powers, z in potential.items():
        rest = sign * z * unit ** (degree - sum(powers[2 - 2 * sector.particle :][:2]))
        for key, factor in at_contact(powers, sector.particle, ways, unit).items():
            sums[key] = sums.get(key, 0) + factor * rest
    total: Flat = {key: Fraction(z, unit**degree << BITS) for key, z in sums.items()}
    for key, size in {(1, 0): x, (0, 1): y, (0, 0): -dot((x, y), place)}.items():
        total[key] = total.get(key, Fraction(0)) + sign * size
    positive = contacts.positive(end, sector)
    squares = given["squares"]
    factors: list[Flat] = [{(0, 0): Fraction(1)}, *positive[0 if contacts.ring else 1 :]]
    if len(squares) != len(factors):
        raise WrongPotentialError("an end has another number of squares")
    for number, (numbers, factor) in enumerate(zip(squares, factors, strict=True)):
        basis = flat_monomials(degree_of_squares(degree, number))
        if len(numbers) != len(basis) * (len(basis) + 1) // 2:
            raise WrongPotentialError("a matrix of squares has another size")
        entries = iter(whole(z) for z in numbers)
        matrix = [[0] * len(basis) for _ in basis]
        square: Flat = {}
        for j, (a, b) in enumerate(basis):
            for i, (c, d) in enumerate(basis[: j + 1]):
                z = next(entries)
                matrix[i][j] = matrix[j][i] = z
                key = a + c, b + d
                square[key] = square.get(key, Fraction(0)) + Fraction(z << (i < j), 1 << BITS)
        check_positive(matrix)
        _subtract(total, square, factor)
    if not contacts.ring:
        powers_of = flat_monomials(degree - 1)
        multipliers = [Fraction(whole(z), 1 << BITS) for z in given["zero"]]
        _subtract(total, dict(zip(powers_of, multipliers, strict=True)), positive[0])
    return total.pop((0, 0)) - sum(map(abs, total.values()))


def _subtract(total: Flat, u: Flat, v: Flat) -> None:
    for key, x in flat_product(u, v).items():
        total[key] = total.get(key, Fraction(0)) - x
