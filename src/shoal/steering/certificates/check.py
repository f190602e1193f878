"""Check certificates of steering in exact arithmetic, without any code of the search.

The module uses whole numbers only: all coordinates are scaled so that they are whole, and the
multipliers of a certificate are multiples of a power of two. The formulas are those of
docs/concepts/steering/certificates.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from math import floor, isfinite, lcm
from typing import Any

from shoal.core.episode import Verification

STEP = 2**36  # multipliers are multiples of 1 / STEP
Pair = tuple[int, int]
Vector = tuple[dict[int, int], dict[int, int]]
_ONE = -1  # key of the constant of an expression

# An item of a pattern is a hold (wall, particle), or a gap: a tuple of its holds in a list, or None.
Item = Pair | list[Pair] | None


class _WrongError(Exception):
    """A certificate that proves nothing."""


class _Task:
    """One assignment of goals to particles, in whole numbers."""

    def __init__(
        self,
        corners: Sequence[Sequence[float]],
        start: Sequence[Sequence[float]],
        goal: Sequence[Sequence[float]],
        tolerance: float,
        limit: float,
        unit: float,
    ) -> None:
        origin = [Fraction(x) for x in corners[0]]

        def scaled(points: Sequence[Sequence[float]]) -> list[list[Fraction]]:
            return [
                [
                    (Fraction(x) - least) / Fraction(unit)
                    for x, least in zip(point, origin, strict=True)
                ]
                for point in points
            ]

        places = [scaled(points) for points in (corners, start, goal)]
        sizes = [Fraction(tolerance) / Fraction(unit), Fraction(limit) / Fraction(unit)]
        numbers = [x for points in places for point in points for x in point]
        self.whole = lcm(*(x.denominator for x in [*numbers, *sizes]))
        self.unit = Fraction(unit)
        if min(self.unit, *sizes) < 0:
            raise _WrongError("the unit, the tolerance or the limit is negative")
        self.corners, self.start, self.goal = (
            [(int(x * self.whole), int(y * self.whole)) for x, y in points] for points in places
        )
        self.tolerance, self.limit = (int(size * self.whole) for size in sizes)
        following = self.corners[1:] + self.corners[:1]
        self.along = [
            (q[0] - p[0], q[1] - p[1]) for p, q in zip(self.corners, following, strict=True)
        ]
        if len(corners) < 3 or any(
            _cross(self.along[k - 1], self.along[k]) <= 0 for k in range(len(self.along))
        ):
            raise _WrongError("the corners are not those of a convex polygon")
        if self._turns() != 1:
            raise _WrongError("the corners go around more than once")
        self.normals = [(-y, x) for x, y in self.along]
        self.every = [(wall, particle) for wall in range(len(corners)) for particle in (0, 1)]
        xs, ys = zip(*self.corners, strict=True)
        self.extent = (max(xs) - min(xs), max(ys) - min(ys))

    def _turns(self) -> int:
        """How often the sides turn around: changes of the sides from down to up."""
        ups = [y > 0 or (y == 0 and x > 0) for x, y in self.along]
        return sum(one and not before for before, one in zip([ups[-1], *ups], ups, strict=False))

    def follows(self, first: Pair, second: Pair) -> bool:
        """Whether the second hold can change the difference directly after the first."""
        if first == second:
            return False
        one, other = self.normals[first[0]], self.normals[second[0]]
        sign = 1 if first[1] == second[1] else -1
        return _cross(one, other) != 0 or sign * _dot(one, other) > 0

    def value(self, pattern: Sequence[Item], leaf: Mapping[str, Any]) -> Fraction:
        """Return the bound that the multipliers of a leaf prove for all plans of a pattern."""
        norms, rows, bounds = self.program(pattern)
        vectors, slacks = leaf["norms"], leaf["slacks"]
        if len(vectors) != len(norms):
            raise _WrongError(f"expected {len(norms)} norms, got {len(vectors)}")
        total: dict[int, int] = {}
        for vector, norm in zip(vectors, norms, strict=True):
            x, y = (_multiple(part) for part in vector)
            if x * x + y * y > STEP * STEP:
                raise _WrongError("the multiplier of a norm is longer than 1")
            for factor, part in ((x, norm[0]), (y, norm[1])):
                for key, number in part.items():
                    total[key] = total.get(key, 0) + factor * number * self.whole
        for index, given in slacks:
            slack = _multiple(given)
            if slack < 0:
                raise _WrongError("the multiplier of a constraint is negative")
            if not (isinstance(index, int) and 0 <= index < len(rows)):
                raise _WrongError(f"no constraint has the number {index}")
            for key, number in rows[index].items():
                total[key] = total.get(key, 0) - slack * number
        value = total.pop(_ONE, 0)
        for key, number in total.items():
            low, high = bounds[key]
            value += min(number * low, number * high)
        proven = Fraction(value, STEP * self.whole * self.whole) * self.unit
        return min(proven, Fraction(self.limit, self.whole) * self.unit)

    def program(
        self, pattern: Sequence[Item]
    ) -> tuple[list[Vector], list[dict[int, int]], list[Pair]]:
        """Return the norms, the constraints and the bounds of the variables of a pattern."""
        bounds: list[Pair] = []
        norms: list[Vector] = []
        rows: list[dict[int, int]] = []

        def vector(low: Pair, high: Pair) -> Vector:
            bounds.extend(zip(low, high, strict=True))
            return {len(bounds) - 2: 1}, {len(bounds) - 1: 1}

        def around(reach: Pair) -> Vector:
            return vector((-reach[0], -reach[1]), reach)

        def equal(one: Vector, other: Vector) -> None:
            # times the number that all other rows contain through their normals
            for first, second in ((one, other), (other, one)):
                rows.extend(
                    {key: number * self.whole for key, number in part.items()}
                    for part in _minus(first, second)
                )

        far, tolerance = (self.limit, self.limit), self.tolerance
        goals = [
            vector((x - tolerance, y - tolerance), (x + tolerance, y + tolerance))
            for x, y in self.goal
        ]
        places = [_constant(point) for point in self.start]
        if not pattern:
            apart = _minus(_minus(goals[1], goals[0]), _minus(places[1], places[0]))
            equal(apart, ({}, {}))
            return [_minus(goals[0], places[0])], rows, bounds
        reached: list[Vector] | None = None
        for number, item in enumerate(pattern):
            final = number == len(pattern) - 1
            if not isinstance(item, tuple):
                free = around(far)
                before: Vector = ({}, {}) if final else around(self.extent)
                norms.append(free)
                reached = [_plus(place, free) for place in places]
                for wall, particle in [(-1, 0), (-1, 1)] if item is None else sorted(item):
                    change = around(far)
                    norms.append(change)
                    reached[1 - particle] = _plus(reached[1 - particle], change)
                    if item is not None:
                        rows.append(_along(self.normals[wall], change, -1))
                continue
            wall, particle = item
            sign = 1 if particle == 0 else -1
            contacts = []
            for _ in range(2):
                bounds.append((0, 1))
                contacts.append(_constant(self.corners[wall]))
                for axis in (0, 1):
                    contacts[-1][axis][len(bounds) - 1] = self.along[wall][axis]
            first, last = contacts
            if reached is None:
                before = _minus(places[1], places[0])
                norms.append(_minus(first, places[particle]))
            else:
                now = (
                    [first, _plus(first, before)]
                    if particle == 0
                    else [_minus(first, before), first]
                )
                equal(reached[0], now[0])
                equal(reached[1], now[1])
                reached = None
            after = _minus(goals[1], goals[0]) if final else around(self.extent)
            norms += [_minus(last, first), _minus(after, before)]
            for contact, apart in ((first, before), (last, after)):
                other = _plus(contact, apart) if sign == 1 else _minus(contact, apart)
                for normal, corner in zip(self.normals, self.corners, strict=True):
                    rows.append(_along(normal, _minus(other, _constant(corner)), 1))
            rows.append(_along(self.normals[wall], _minus(before, after), sign))
            places = [last, _plus(last, after)] if particle == 0 else [_minus(last, after), last]
            if final:
                norms.append(_minus(goals[particle], last))
        if reached is not None:
            equal(reached[0], goals[0])
            equal(reached[1], goals[1])
        return norms, rows, bounds

    def parts(self, pattern: Sequence[Item], node: Mapping[str, Any]) -> list[list[Item]]:
        """Return the patterns into which a node must divide its own."""
        place = node["place"]
        if not (isinstance(place, int) and 0 <= place < len(pattern)):
            raise _WrongError(f"a pattern has no gap at {place}")
        gap = pattern[place]
        if isinstance(gap, tuple):
            raise _WrongError(f"a pattern has no gap at {place}")
        known = [(wall, particle) for wall, particle in node["known"]]
        if not set(known) <= set(self.every):
            raise _WrongError("a gap has an unknown hold")
        within: list[Item] = [known] if known else []
        middles: list[list[Item]] = [within]
        middles += [
            [gap, hold, *within] if node["side"] == "last" else [*within, hold, gap]
            for hold in (self.every if gap is None else sorted(gap))
            if hold not in known
        ]
        before, after = list(pattern[:place]), list(pattern[place + 1 :])
        return [
            [*before, *middle, *after]
            for middle in middles
            if all(
                not isinstance(one, tuple)
                or not isinstance(other, tuple)
                or self.follows(one, other)
                for one, other in pairwise([*before[-1:], *middle, *after[:1]])
            )
        ]


def _leaves(
    task: _Task, proof: Sequence[Mapping[str, Any]]
) -> Iterator[tuple[list[Item], Mapping[str, Any]]]:
    """Yield the leaves of a proof with their patterns, and check that no case is missing."""
    stack: list[list[Item]] = [[None]]  # all plans
    for node in proof:
        if not stack:
            raise _WrongError("the proof goes on after its last case")
        pattern = stack.pop()
        if "norms" in node:
            yield pattern, node
        else:
            stack += task.parts(pattern, node)[::-1]
    if stack:
        raise _WrongError(f"{len(stack)} cases are missing")


def _polygon_leaves(
    certificate: Mapping[str, Any],
) -> Iterator[tuple[_Task, list[Item], Mapping[str, Any]]]:
    for tree in certificate["trees"]:
        task = _Task(
            certificate["corners"],
            certificate["start"],
            [certificate["goal"][k - 1] for k in tree["order"]],
            certificate["tolerance"],
            certificate["limit"],
            certificate["unit"],
        )
        for pattern, leaf in _leaves(task, tree["proof"]):
            yield task, pattern, leaf


def check_certificate(certificate: Mapping[str, Any]) -> Verification:
    """Check in exact arithmetic that no plan is shorter than the bound of a certificate.

    The check uses only the certificate, which holds the workspace, the starts, the goals and the
    tolerance for which it is valid. The check computes the bound of every leaf of the proof again
    from its multipliers, and derives all cases that a proof must treat.

    Parameters
    ----------
    certificate : mapping
        The JSON object that `shoal.steering.certify` returns as `Certificate.proof`.
    """
    from shoal.steering.certificates.check_routes import route_leaves  # which uses this module

    try:
        bound = Fraction(certificate["lower_bound"])
        cells = "rings" in certificate or "height" in certificate
        orders = [tree["order"] for tree in certificate["orders" if cells else "trees"]]
        needed = [[1, 2], [2, 1]] if certificate["interchangeable"] else [[1, 2]]
        if sorted(orders) != needed:
            raise _WrongError(f"expected proofs for the orders {needed}, got {orders}")
        count = 0
        for task, pattern, leaf in (route_leaves if cells else _polygon_leaves)(certificate):
            value = task.value(pattern, leaf)
            count += 1
            if value < bound:
                raise _WrongError(f"a leaf proves {float(value):.9g}, less than {float(bound):.9g}")
    except _WrongError as error:
        return Verification(False, f"the certificate is wrong: {error}")
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError) as error:
        return Verification(False, f"the certificate is incomplete: {error!r}")
    return Verification(
        True, f"{count} cases prove that no plan is shorter than {float(bound):.9g}"
    )


def _multiple(given: float) -> int:
    if not isfinite(given) or floor(given * STEP) != given * STEP:
        raise _WrongError(f"a multiplier is no multiple of 2**-36: {given!r}")
    return int(given * STEP)


def _cross(one: Pair, other: Pair) -> int:
    return one[0] * other[1] - one[1] * other[0]


def _dot(one: Pair, other: Pair) -> int:
    return one[0] * other[0] + one[1] * other[1]


def _constant(point: Pair) -> Vector:
    return {_ONE: point[0]}, {_ONE: point[1]}


def _combined(one: Vector, other: Vector, sign: int) -> Vector:
    first, second = (
        {key: a.get(key, 0) + sign * b.get(key, 0) for key in a.keys() | b.keys()}
        for a, b in zip(one, other, strict=True)
    )
    return first, second


def _plus(one: Vector, other: Vector) -> Vector:
    return _combined(one, other, 1)


def _minus(one: Vector, other: Vector) -> Vector:
    return _combined(one, other, -1)


def _along(normal: Pair, vector: Vector, sign: int) -> dict[int, int]:
    x, y = vector
    return {
        key: sign * (normal[0] * x.get(key, 0) + normal[1] * y.get(key, 0))
        for key in x.keys() | y.keys()
    }
