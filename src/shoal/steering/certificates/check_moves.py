"""Check in exact arithmetic that no plan in a convex polygon has fewer moves than a certificate
says, without any code of the search.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import lcm
from typing import Any

from shoal.steering.certificates.check import (
    Pair,
    Vector,
    _add,
    _along,
    _constant,
    _FlatWalls,
    _minus,
    _multiple,
    _numbered,
    _plus,
    _WrongError,
)

_FREE, _UNKNOWN = -1, -2
_CONSTANT = -1  # key of the constant of an expression
_MOST = 100  # moves
_CLEAR = 10**9  # a contradiction is at least 1 / _CLEAR of its multipliers, in the unit

Sector = tuple[Pair, Pair] | None
Move = tuple[tuple[int, int], Sector]  # the wall that stops each particle, and the directions


class _Moves:
    """One assignment of goals to particles, in whole numbers."""

    def __init__(self, certificate: Mapping[str, Any], order: Sequence[int]) -> None:
        unit = Fraction(certificate["unit"])
        if unit <= 0:
            raise _WrongError("the unit is not positive")
        corners = certificate["corners"]
        origin = [Fraction(x) for x in corners[0]]
        goal = [certificate["goal"][k - 1] for k in order]
        places = [
            [
                [(Fraction(x) - least) / unit for x, least in zip(spot, origin, strict=True)]
                for spot in spots
            ]
            for spots in (corners, certificate["start"], goal)
        ]
        tolerance = Fraction(certificate["tolerance"]) / unit
        numbers = [x for spots in places for spot in spots for x in spot]
        self.whole = lcm(*(x.denominator for x in [*numbers, tolerance]))
        outline, self.start, self.goal = (
            [(int(x * self.whole), int(y * self.whole)) for x, y in spots] for spots in places
        )
        self.tolerance = int(tolerance * self.whole)
        self.walls = _FlatWalls(outline)

    def check(self, moves: Sequence[Move], leaf: Mapping[str, Any]) -> None:
        """Refuse multipliers that do not show that the constraints contradict each other."""
        rows, bounds = self._program(moves)
        total: dict[int, int] = {}
        size = 0
        for index, multiplier in leaf["slacks"]:
            slack = _multiple(multiplier)
            if slack < 0:
                raise _WrongError("the multiplier of a constraint is negative")
            _add(total, _numbered(rows, index), -slack)
            size += slack
        value = total.pop(_CONSTANT, 0)
        for key, number in total.items():
            low, high = bounds[key]
            value += min(number * low, number * high)
        if value * _CLEAR <= size * self.whole**2:
            raise _WrongError(f"{len(moves)} moves are not excluded by a leaf")

    def _program(self, moves: Sequence[Move]) -> tuple[list[dict[int, int]], list[Pair]]:
        """Return the constraints of moves, which are at least 0, and the bounds of the variables.

        A move is the displacement u, at most as long as one of the particles moves, and what each
        stopped particle loses of it, y. Both, and u - y, have the direction of the move. With the
        inward normal N of the wall that stops a particle, N . y <= 0 and N . (u - y) <= 0.
        """
        bounds: list[Pair] = []
        rows: list[dict[int, int]] = []
        walls, scale = self.walls, self.whole

        def vector(low: Pair, high: Pair) -> Vector:
            bounds.extend(zip(low, high, strict=True))
            return {len(bounds) - 2: 1}, {len(bounds) - 1: 1}

        def scaled(expression: Mapping[int, int], factor: int) -> dict[int, int]:
            return {key: number * factor for key, number in expression.items()}

        far = self.tolerance
        goals = [vector((x - far, y - far), (x + far, y + far)) for x, y in self.goal]
        places = [_constant(spot) for spot in self.start]
        extent = walls.high[0] - walls.low[0], walls.high[1] - walls.low[1]
        least = -extent[0], -extent[1]
        for stops, sector in moves:
            displacement = vector(least, extent)
            directed = [displacement]
            for particle, wall in enumerate(stops):
                translation, loss = displacement, None
                if wall != _FREE:
                    loss = vector(least, extent)
                    translation = _minus(displacement, loss)
                    directed += [loss, translation]
                places[particle] = _plus(places[particle], translation)
                inside = []
                for normal, offset in walls.sides:
                    row = _along(normal, places[particle], 1)
                    row[_CONSTANT] = row.get(_CONSTANT, 0) - offset
                    inside.append(row)
                rows += inside
                if wall >= 0 and loss is not None:
                    rows.append(scaled(inside[wall], -1))
                    rows += [
                        _along(walls.normals[wall], lost_or_moved, -1)
                        for lost_or_moved in (loss, translation)
                    ]
            if sector is not None:
                (a, b), (c, d) = sector
                for along in directed:
                    for normal in ((-b, a), (d, -c)):
                        rows.append(scaled(_along(normal, along, 1), scale))
        for place, goal in zip(places, goals, strict=True):
            for difference in (_minus(place, goal), _minus(goal, place)):
                rows += [scaled(expression, scale) for expression in difference]
        return rows, bounds

    def children(self, moves: Sequence[Move], node: Mapping[str, Any]) -> list[list[Move]]:
        """Return the cases into which a node divides its own."""
        number = node["move"]
        if not (isinstance(number, int) and 0 <= number < len(moves)):
            raise _WrongError(f"there is no move {number}")
        stops, sector = moves[number]
        children: list[Move] = []
        if "particle" in node:
            particle = node["particle"]
            if particle not in (0, 1) or stops[particle] != _UNKNOWN:
                raise _WrongError("the wall that stops a particle is known already")
            for wall in range(_FREE, self.walls.count):
                divided = (wall, stops[1]) if particle == 0 else (stops[0], wall)
                children.append((divided, sector))
        elif sector is None:
            around = [(1, 0), (0, 1), (-1, 0), (0, -1), (1, 0)]
            children += [(stops, (around[k], around[k + 1])) for k in range(4)]
        else:
            begin, end = sector
            middle = begin[0] + end[0], begin[1] + end[1]
            children += [(stops, (begin, middle)), (stops, (middle, end))]
        return [[*moves[:number], case, *moves[number + 1 :]] for case in children]


def proven_moves(certificate: Mapping[str, Any]) -> int:
    """Return the number of moves that a certificate proves to be the least, after the check."""
    least, proofs = certificate["moves"]["lower_bound"], certificate["moves"]["proofs"]
    orders = [entry["order"] for entry in proofs]
    needed = [[1, 2], [2, 1]] if certificate["interchangeable"] else [[1, 2]]
    if not isinstance(least, int) or sorted(orders) != needed:
        raise _WrongError("expected a number of moves, and a proof for each order")
    if not 1 <= least <= _MOST:
        raise _WrongError(f"expected at least 1 and at most {_MOST} moves, got {least}")
    for entry in proofs:
        task = _Moves(certificate, entry["order"])
        # A plan with fewer moves has more with moves of length 0.
        unknown: Move = ((_UNKNOWN, _UNKNOWN), None)
        stack = [[unknown] * (least - 1)]
        for number, node in enumerate(entry["proof"]):
            if not stack:
                raise _WrongError("the proof goes on after its last case")
            if len(stack) > len(entry["proof"]) - number:
                break
            moves = stack.pop()
            if "slacks" in node:
                task.check(moves, node)
            else:
                stack += task.children(moves, node)[::-1]
        if stack:
            raise _WrongError(f"{len(stack)} cases are missing")
    return least
