"""The search for a polynomial potential at a round wall, whose fall is a bound for all plans."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import import_extra
from shoal.steering.certificates.check_potential import (
    DEGREE,
    ONE,
    Monomial,
    WrongPotentialError,
    ellipses,
    inside_disk,
    monomials,
    on_wall,
    potential_value,
    times,
    turn,
)
from shoal.steering.certificates.programs import solver_settings

_STEP = 2.0**-36  # numbers of the proof are multiples of this
_MARGIN = (
    2.0**-26
)  # added to the diagonals of matrices, so that the rounded ones stay positive definite
_HALF = DEGREE // 2
_AXES: list[Monomial] = [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)]

# for each monomial, the coefficients of the variables
_Linear = defaultdict[Monomial, defaultdict[int, float]]


def _linear() -> _Linear:
    return defaultdict(lambda: defaultdict(float))


class _Program:
    """The semidefinite program of a potential, as `check_potential` states it."""

    def __init__(self, positive: Sequence[Mapping[Monomial, float]], ring: Fraction) -> None:
        self.count = 0
        self.matrices: list[tuple[int, int]] = []  # first variable and size
        self.rows: list[dict[int, float]] = []
        self.constants: list[float] = []
        self.around = list(positive)
        self.basis = monomials(DEGREE)[1:]
        self.potential = dict(zip(self.basis, self._add(len(self.basis)), strict=True))
        disks = [_scaled(inside_disk(k)) for k in (0, 1)]
        rings = [_scaled(on_wall(k, ring)) for k in (0, 1)]
        self.cases: list[dict[str, Any]] = []
        one: _Linear = _linear()
        self._add_case([self._slope((0, 2)), self._slope((1, 3))], one, disks, None, [])
        for held, other in ((0, 1), (1, 0)):
            hold: dict[tuple[int, int], _Linear] = {(0, 0): _linear()}
            holds = self._add_squares(hold, 1, (2 * _HALF - 1) // 2, [disks[other]])
            slopes = [self._slope((2 * other + axis,), -1.0) for axis in (0, 1)]
            for axis in (0, 1):
                for power, row in hold[0, 0].items():
                    target = slopes[axis][times(power, _AXES[2 * held + axis])]
                    for variable, x in row.items():
                        target[variable] += x
            lost = _linear()
            for power, row in hold[0, 0].items():
                for variable, x in row.items():
                    lost[power][variable] = x * turn(ring) * 2.0**-40
            if ring:
                self._add_case(slopes, lost, [disks[other], disks[held], rings[held]], None, holds)
            else:
                self._add_case(slopes, lost, [disks[other]], disks[held], holds)

    def _add(self, number: int) -> range:
        self.count += number
        return range(self.count - number, self.count)

    def _slope(self, axes: Sequence[int], sign: float = 1.0) -> _Linear:
        slope = _linear()
        for powers, variable in self.potential.items():
            for axis in axes:
                if powers[axis]:
                    less = list(powers)
                    less[axis] -= 1
                    slope[less[0], less[1], less[2], less[3]][variable] += sign * powers[axis]
        return slope

    def _add_squares(
        self,
        entries: dict[tuple[int, int], _Linear],
        size: int,
        degree: int,
        positive: Sequence[Mapping[Monomial, float]],
    ) -> list[int]:
        """Add matrices of squares to a matrix of polynomials; return the numbers of the matrices."""
        numbers = []
        for number, factor in enumerate([{ONE: 1.0}, *positive, *self.around]):
            basis = [
                (power, part) for power in monomials(degree - bool(number)) for part in range(size)
            ]
            variables = iter(self._add(len(basis) * (len(basis) + 1) // 2))
            numbers.append(len(self.matrices))
            for j, (power, part) in enumerate(basis):
                for i, (other, other_part) in enumerate(basis[: j + 1]):
                    variable = next(variables)
                    if i == j == 0:
                        self.matrices.append((variable, len(basis)))
                    # the solver has entries off the diagonal times sqrt(2)
                    share = 1.0 if i == j else (sqrt(2) if part == other_part else 1 / sqrt(2))
                    target = entries[min(part, other_part), max(part, other_part)]
                    for one_of, x in factor.items():
                        target[times(times(power, other), one_of)][variable] += share * x
        return numbers

    def _add_case(
        self,
        slope: Sequence[_Linear],
        lost: _Linear,
        positive: Sequence[Mapping[Monomial, float]],
        zero: Mapping[Monomial, float] | None,
        holds: list[int],
    ) -> None:
        """Add that a slope is at most 1 - ``lost``."""
        entries = {key: _linear() for key in ((0, 0), (0, 1), (1, 1))}
        squares = self._add_squares(entries, 2, _HALF, positive)
        multipliers = []
        for key in entries if zero is not None else ():
            factors = monomials(2 * _HALF - 2)
            multipliers.append(self._add(len(factors)))
            for power, variable in zip(factors, multipliers[-1], strict=True):
                for one_of, x in (zero or {}).items():
                    entries[key][times(power, one_of)][variable] += x
        self.cases.append({"squares": squares, "zero": multipliers, "holds": holds})
        for key, part, sign in (
            ((0, 0), slope[0], 1),
            ((0, 1), slope[1], 1),
            ((1, 1), slope[0], -1),
        ):
            less = lost if key[0] == key[1] else {}
            for power in sorted(entries[key].keys() | part.keys() | less.keys()):
                row = dict(entries[key].get(power, {}))
                for variable, x in part.get(power, {}).items():
                    row[variable] = row.get(variable, 0.0) - sign * x
                for variable, x in less.get(power, {}).items():
                    row[variable] = row.get(variable, 0.0) + x
                self.rows.append(row)
                self.constants.append(float(power == ONE and key[0] == key[1]))

    def solve(self, start: NDArray[np.float64], goal: NDArray[np.float64]) -> dict[str, Any] | None:
        """Return the proof with the greatest fall, or None."""
        from scipy.sparse import csc_matrix

        clarabel = import_extra("clarabel", "certificates need Clarabel", extra="certify")
        settings = solver_settings(clarabel)
        powers = np.array(self.basis)
        costs = np.zeros(self.count)
        costs[: len(powers)] = np.prod(goal**powers, axis=1) - np.prod(start**powers, axis=1)
        height = len(self.rows)
        rows = [k for k, row in enumerate(self.rows) for _ in row]
        columns = [key for row in self.rows for key in row]
        values = [x for row in self.rows for x in row.values()]
        firsts, cones = [], [clarabel.ZeroConeT(height)]
        for variable, size in self.matrices:
            firsts.append(height)
            entries = size * (size + 1) // 2
            rows += range(height, height + entries)
            columns += range(variable, variable + entries)
            values += [-1.0] * entries
            height += entries
            cones.append(clarabel.PSDTriangleConeT(size))
        constants = np.zeros(height)
        constants[: len(self.constants)] = self.constants
        solution = clarabel.DefaultSolver(
            csc_matrix((self.count, self.count)),
            costs,
            csc_matrix((values, (rows, columns)), (height, self.count)),
            constants,
            cones,
            settings,
        ).solve()
        x, slacks = np.array(solution.x), np.array(solution.s)
        if not (np.isfinite(x).all() and np.isfinite(slacks).all()):
            return None
        matrices = []
        for (_, size), first in zip(self.matrices, firsts, strict=True):
            # the slacks are inside of the cone, and equal to the variables but for rounding errors
            triangle = slacks[first : first + size * (size + 1) // 2].copy()
            diagonal = np.cumsum(np.arange(1, size + 1)) - 1
            off = np.ones(len(triangle), np.bool_)
            off[diagonal] = False
            triangle[off] /= sqrt(2)
            triangle[diagonal] += _MARGIN
            matrices.append(_rounded(triangle))
        return {
            "potential": _rounded(x[: len(powers)]),
            "cases": [
                {
                    "squares": [matrices[k] for k in case["squares"]],
                    "zero": [_rounded(x[part.start : part.stop]) for part in case["zero"]],
                    "holds": [matrices[k] for k in case["holds"]],
                }
                for case in self.cases
            ],
        }


def _scaled(polynomial: Mapping[Monomial, int]) -> dict[Monomial, float]:
    return {key: x * 2.0**-40 for key, x in polynomial.items()}


def _rounded(numbers: NDArray[np.float64]) -> list[float]:
    rounded: list[float] = (np.round(numbers / _STEP) * _STEP).tolist()
    return rounded


def find_potential(
    start: NDArray[np.float64],
    goal: NDArray[np.float64],
    tolerance: float,
    limit: float,
    ring: float,
) -> tuple[float, dict[str, Any] | None]:
    """Return the bound of a potential, in units of the radius, around the middle, with its proof;
    0 and None if there is none. The arguments are those of `potential_value`.
    """
    first, last = ([Fraction(x) for x in point.ravel().tolist()] for point in (start, goal))
    near, most, width = Fraction(tolerance), Fraction(limit), Fraction(ring)
    around = ellipses(first, last, most + 3 * near)
    if around is None:
        return 0.0, None
    program = _Program([_scaled(one) for one in around], width)
    proof = program.solve(start.ravel(), goal.ravel())
    if proof is None:
        return 0.0, None
    try:
        value = potential_value(first, last, near, most, width, proof)
    except WrongPotentialError:  # the solver stopped early
        return 0.0, None
    return float(value), proof
