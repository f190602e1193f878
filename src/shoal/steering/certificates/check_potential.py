"""Check the bound of a potential at a round wall, in exact arithmetic, without any code of the search.

The formulas are those of docs/concepts/steering/certificates.md. Lengths are in units of the radius
of a circle around all walls, so that all coordinates are between -1 and 1, and numbers are multiples of 1 / 2**36.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from itertools import product
from math import ceil, comb, floor, isfinite, isqrt, prod
from typing import Any

DEGREE = 5  # of a potential
DEGREES = (3, DEGREE)  # of one between contacts
BITS = 36  # of a number of the proof
_FINE = 40  # bits of the coefficients of an ellipse

Monomial = tuple[int, int, int, int]
"""Exponents of the coordinates of the first, then the second particle."""

Polynomial = dict[Monomial, int]


class WrongPotentialError(Exception):
    """A potential that proves nothing."""


def monomials(degree: int) -> list[Monomial]:
    """Return all monomials up to a degree, the constant first."""
    numbers = range(degree + 1)
    every: list[Monomial] = [
        (a, b, c, d) for a, b, c, d in product(numbers, repeat=4) if a + b + c + d <= degree
    ]
    return sorted(every, key=lambda powers: (sum(powers), powers))


ONE: Monomial = (0, 0, 0, 0)
_AXES: list[Monomial] = [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)]


def times(u: Monomial, v: Monomial) -> Monomial:
    """Return the product of two monomials."""
    return u[0] + v[0], u[1] + v[1], u[2] + v[2], u[3] + v[3]


def inside_disk(particle: int) -> Polynomial:
    """Return 1 - |p|² of a particle p, times 2**40."""
    whole = 1 << _FINE
    return {ONE: whole} | {times(axis, axis): -whole for axis in _AXES[2 * particle :][:2]}


def on_wall(particle: int, ring: Fraction) -> Polynomial:
    """Return |p|² - 1 + k of a particle p, times 2**40, rounded up, where k is the width of the
    ``ring`` in which all walls are: 1 - the square of the least distance of a wall from the middle.
    """
    constant = -floor((1 - ring) * (1 << _FINE))
    return {ONE: constant} | {key: -x for key, x in inside_disk(particle).items() if key != ONE}


def turn(ring: Fraction) -> int:
    """Return the root of the width of a ring, times 2**40, rounded up."""
    return isqrt(ceil(ring * (1 << 2 * _FINE))) + 1 if ring else 0


_AXES_OF: list[tuple[dict[int, int], dict[int, int]]] = [
    ({0: 1}, {1: 1}),
    ({2: 1}, {3: 1}),
    ({2: 1, 0: -1}, {3: 1, 1: -1}),
]  # of the first particle, of the second one, and of the difference


def ellipses(
    start: Sequence[Fraction], goal: Sequence[Fraction], limit: Fraction
) -> list[Polynomial] | None:
    """Return quadratic polynomials, times 2**40, that are at least 0 at all states of plans of at
    most the length ``limit``; None if the length is not above the least one.

    Each particle, as well as the difference, moves along a path of at most this length.
    """
    found = []
    for number in range(len(_AXES_OF)):
        one = ellipse(start, goal, number, limit)
        if one is None:
            return None
        found.append(one)
    return found


def ellipse(
    start: Sequence[Fraction], goal: Sequence[Fraction], number: int, limit: Fraction
) -> Polynomial | None:
    """Return a quadratic polynomial, times 2**40, that is at least 0 on paths of at most the length
    ``limit`` of a particle, or of the difference with ``number`` 2; None if there are none.

    The points x of a path from a to b of length l have |x - a| + |x - b| <= l, so 2 l |x - a| <= l² +
    |x - a|² - |x - b|², which is linear in x. With both sides squared, this is a quadratic polynomial.
    It is divided by l² (l² - |a - b|²), and rounded up by less than 2**-34.
    """
    axes = _AXES_OF[number]
    a, b = (
        [sum((sign * point[k] for k, sign in axis.items()), Fraction(0)) for axis in axes]
        for point in (start, goal)
    )
    between = sum(((y - x) ** 2 for x, y in zip(a, b, strict=True)), Fraction(0))
    scale = limit**2 * (limit**2 - between)
    if scale <= 0:
        return None
    # linear: l² + |a|² - |b|² + 2 (b - a) . x
    linear: dict[Monomial, Fraction] = {
        ONE: limit**2 + sum(x * x for x in a) - sum(x * x for x in b)
    }
    square: dict[Monomial, Fraction] = {}

    def put(target: dict[Monomial, Fraction], key: Monomial, number: Fraction) -> None:
        target[key] = target.get(key, Fraction(0)) + number

    for axis, x, y in zip(axes, a, b, strict=True):
        part = {_AXES[k]: Fraction(sign) for k, sign in axis.items()}
        for key, sign in part.items():
            put(linear, key, 2 * (y - x) * sign)
        part[ONE] = -x
        for u, v in product(part.items(), repeat=2):
            put(square, times(u[0], v[0]), -4 * limit**2 * u[1] * v[1])
    for u, v in product(linear.items(), repeat=2):
        put(square, times(u[0], v[0]), u[1] * v[1])
    rounded = {key: floor(x / scale * (1 << _FINE)) for key, x in square.items()}
    rounded[ONE] += 1 << (_FINE - 34)
    return rounded


def potential_value(
    start: Sequence[Fraction],
    goal: Sequence[Fraction],
    tolerance: Fraction,
    limit: Fraction,
    ring: Fraction,
    proof: Mapping[str, Any],
) -> Fraction:
    """Return the lower bound that a potential proves, in units of the radius.

    Let V be a polynomial of both places p and q. If a plan is not longer than the limit, its states
    are in the disk and in the ellipses. Let K be these states. If

    - |dV/dp + dV/dq| <= 1 in K, and
    - |l p - dV/dq| <= 1 - l sqrt(k) where p is on the wall, and the same with p and q exchanged,
      with l >= 0 in K,

    V falls by at most the length of any input: a translation t changes it by (dV/dp + dV/dq) . t, and
    an adjustment u of q, with p . u >= -sqrt(k) |u| (see `_bound_growth` of the checker), by
    dV/dq . u >= (dV/dq - l p) . u - l sqrt(k) |u|. So no plan is shorter than V at the start - V at the
    goal.

    |g| <= s if the matrix [[s + g1, g2], [g2, s - g1]] has no negative eigenvalue. It is a sum of
    matrices of squares times polynomials that are at least 0 in K, in a disk of a matrix times 1 -
    |p|² on the wall, and of a rest. Coordinates are at most 1, so that the rest is at most the sum e
    of its coefficients, and |g| <= s + e.
    """
    around = ellipses(start, goal, limit + 3 * tolerance)
    if around is None:
        raise WrongPotentialError("the limit of a potential is not above the least length")
    potential, rest = excess(around, ring, proof)
    # places within the tolerance of the goals
    fall = (_at(potential, start) - _at(potential, goal)) / Fraction(1 << BITS)
    change = changed_by(potential, goal, Fraction(0), [tolerance] * 4)
    return max(fall - change, Fraction(0)) / (1 + rest)


def degree_of(numbers: Collection[Any]) -> int:
    """Return the degree of a potential with some coefficients."""
    for degree in DEGREES:
        if len(numbers) == len(monomials(degree)) - 1:
            return degree
    raise WrongPotentialError("a potential has another number of coefficients")


def changed_by(
    potential: Mapping[Monomial, int],
    middle: Sequence[Fraction],
    width: Fraction,
    moved: Sequence[Fraction],
) -> Fraction:
    """Return how much a potential changes at most if each coordinate moves by the number in ``moved``,
    from a place whose coordinates are within ``width`` of those of ``middle``.

    For this, the potential becomes a polynomial of the vector from the middle, whose coefficients say
    how steep it is there. Those from the origin are far larger, because many take each other away.
    """
    degree, unit = degree_of(potential), 1 << BITS
    total = {powers: x * unit ** (degree - sum(powers)) for powers, x in potential.items()}
    for axis, place in enumerate(middle):
        begin = floor(place * unit)
        shifted: Polynomial = {}
        for powers, x in total.items():
            own, key = powers[axis], list(powers)
            for power in range(own + 1):
                key[axis] = power
                part = comb(own, power) * begin ** (own - power) * x
                at = key[0], key[1], key[2], key[3]
                shifted[at] = shifted.get(at, 0) + part
        total = shifted
    near = [ceil(width * unit) + 1] * 4
    far = [x + ceil(size * unit) for x, size in zip(near, moved, strict=True)]
    change = sum(
        abs(x) * (prod(map(pow, far, powers)) - prod(map(pow, near, powers)))
        for powers, x in total.items()
    )
    return Fraction(change, unit**degree << BITS)


def excess(
    around: Sequence[Polynomial], ring: Fraction, proof: Mapping[str, Any]
) -> tuple[Polynomial, Fraction]:
    """Return a potential, times 2**36, and how much it falls at most beyond the length of an input,
    relative, at the states in the disk where some polynomials, times 2**40, are at least 0.
    """
    numbers = [whole(x) for x in proof["potential"]]
    basis, half = monomials(degree_of(numbers))[1:], degree_of(numbers) // 2
    cases = proof["cases"]
    if len(cases) != 3:
        raise WrongPotentialError("a potential has another number of cases")
    potential = dict(zip(basis, numbers, strict=True))
    slopes = [_derivative(potential, axis) for axis in range(4)]
    rest = 0
    for number, case in enumerate(cases):
        one = {ONE: 1 << (BITS + _FINE)}
        zero, rounded = None, 0
        if number == 0:
            slope = [
                {key: x << _FINE for key, x in _sum(slopes[axis], slopes[2 + axis]).items()}
                for axis in (0, 1)
            ]
            positive = [inside_disk(0), inside_disk(1)]
        else:
            held, other = number - 1, 2 - number
            positive = [inside_disk(other)]
            factors = [*positive, *around] if half > 1 else []
            hold = _sums_of_squares(case["holds"], 1, half - 1, factors)[0, 0]
            if ring:
                positive += [inside_disk(held), on_wall(held, ring)]
            else:
                zero = inside_disk(held)
            # each coefficient is rounded by less than 1
            one = _sum(one, {key: -turn(ring) * x >> _FINE for key, x in hold.items()})
            rounded = len(hold)
            slope = [
                {key: -(x << _FINE) for key, x in slopes[2 * other + axis].items()}
                for axis in (0, 1)
            ]
            for axis in (0, 1):
                for key, x in hold.items():
                    place = times(key, _AXES[2 * held + axis])
                    slope[axis][place] = slope[axis].get(place, 0) + x
        rests = {
            (0, 0): _sum(one, slope[0]),
            (0, 1): dict(slope[1]),
            (1, 1): _sum(one, {key: -x for key, x in slope[0].items()}),
        }
        squares = _sums_of_squares(case["squares"], 2, half, [*positive, *around])
        for entry, part in squares.items():
            rests[entry] = _sum(rests[entry], {power: -x for power, x in part.items()})
        if zero is not None:
            powers = monomials(2 * half - 2)
            for entry, multipliers in zip(rests, case["zero"], strict=True):
                for power, x in zip(powers, multipliers, strict=True):
                    taken = {times(power, key): -whole(x) * y for key, y in zero.items()}
                    rests[entry] = _sum(rests[entry], taken)
        sizes = {entry: sum(abs(x) for x in part.values()) for entry, part in rests.items()}
        rest = max(rest, max(sizes[0, 0], sizes[1, 1]) + sizes[0, 1] + rounded)
    return potential, Fraction(rest, 1 << (BITS + _FINE))


def _sums_of_squares(
    given: Any, size: int, degree: int, positive: Sequence[Polynomial]
) -> dict[tuple[int, int], Polynomial]:
    """Return the upper triangle of a matrix of polynomials, times 2**76: the first matrix of squares,
    and each of the others times a polynomial that is at least 0.

    A matrix of squares is given by the upper triangle of a matrix over the monomials of a degree, one
    less for all but the first. It must be positive definite.
    """
    factors = [{ONE: 1 << _FINE}, *positive]
    if len(given) != len(factors):
        raise WrongPotentialError("a potential has another number of squares")
    total: dict[tuple[int, int], Polynomial] = {
        (i, j): {} for i in range(size) for j in range(i, size)
    }
    for number, (numbers, factor) in enumerate(zip(given, factors, strict=True)):
        basis = [
            (power, part) for power in monomials(degree - bool(number)) for part in range(size)
        ]
        count = len(basis)
        if len(numbers) != count * (count + 1) // 2:
            raise WrongPotentialError("a matrix of squares has another size")
        entries = iter(whole(x) for x in numbers)
        matrix = [[0] * count for _ in range(count)]
        products: dict[tuple[int, int], Polynomial] = {key: {} for key in total}
        for j, (power, part) in enumerate(basis):
            for i, (other, other_part) in enumerate(basis[: j + 1]):
                x = next(entries)
                matrix[i][j] = matrix[j][i] = x
                key = min(part, other_part), max(part, other_part)
                target, place = products[key], times(power, other)
                # an entry off the diagonal of the matrix counts in both triangles of its own part
                target[place] = target.get(place, 0) + (
                    2 * x if part == other_part and i < j else x
                )
        check_positive(matrix)
        for key, polynomial in products.items():
            target = total[key]
            for powers, x in polynomial.items():
                for by, y in factor.items():
                    place = times(powers, by)
                    target[place] = target.get(place, 0) + x * y
    return total


def check_positive(matrix: list[list[int]]) -> None:
    """Refuse a matrix that is not positive definite: a leading minor is not above 0."""
    rows, previous = [list(row) for row in matrix], 1
    for k in range(len(rows)):
        pivot = rows[k][k]
        if pivot <= 0:
            raise WrongPotentialError("a matrix of squares is not positive definite")
        for i in range(k + 1, len(rows)):
            factor = rows[i][k]
            rows[i] = [0] * (k + 1) + [
                (pivot * rows[i][j] - factor * rows[k][j]) // previous
                for j in range(k + 1, len(rows))
            ]
        previous = pivot


def _derivative(polynomial: Polynomial, axis: int) -> Polynomial:
    found: Polynomial = {}
    for powers, x in polynomial.items():
        if powers[axis]:
            less = list(powers)
            less[axis] -= 1
            found[less[0], less[1], less[2], less[3]] = x * powers[axis]
    return found


def _sum(u: Mapping[Monomial, int], v: Mapping[Monomial, int]) -> Polynomial:
    total = dict(u)
    for key, x in v.items():
        total[key] = total.get(key, 0) + x
    return total


def _at(polynomial: Polynomial, place: Sequence[Fraction]) -> Fraction:
    total = Fraction(0)
    for powers, x in polynomial.items():
        value = Fraction(x)
        for coordinate, power in zip(place, powers, strict=True):
            value *= coordinate**power
        total += value
    return total


def whole(number: float) -> int:
    """Return a number times 2**36; refuse one that is no multiple of 2**-36."""
    if not isfinite(number) or floor(number * 2**BITS) != number * 2**BITS:
        raise WrongPotentialError(f"a number is no multiple of 2**-36: {number!r}")
    return int(number * 2**BITS)
