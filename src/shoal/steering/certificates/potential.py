"""The search for a polynomial potential at a round wall, whose fall is a bound for all plans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import cache
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import import_extra
from shoal.steering.certificates.check_contacts import (
    Contacts,
    Flat,
    Sector,
    at_contact,
    degree_of_squares,
    flat_monomials,
    part_value,
)
from shoal.steering.certificates.check_potential import (
    DEGREE,
    ONE,
    Monomial,
    Polynomial,
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
_ACCURACY = 1e-5  # of the solver
_AXES: list[Monomial] = [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)]
_ENTRIES = [(0, 0), (0, 1), (1, 1)]  # of a matrix of two rows
_PLACE = {powers: number for number, powers in enumerate(monomials(DEGREE - 1))}
_FLAT_PLACE = {powers: number for number, powers in enumerate(flat_monomials(DEGREE + 1))}

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


def _off_diagonal(i: int, j: int, *, alike: bool) -> float:
    # the solver has entries off the diagonal times sqrt(2)
    return 1.0 if i == j else (sqrt(2) if alike else 1 / sqrt(2))


@cache
def _squares(
    degree: int, size: int, moved: tuple[Monomial, ...], height: int
) -> tuple[int, Ints, Ints, Floats]:
    """Return the size of a matrix of squares of polynomials, and for each of its entries and each
    monomial in ``moved``, with which it is multiplied: the entry, the row of the program and a share.
    The entries of a matrix of polynomials have ``height`` rows each.
    """
    basis = [(power, part) for power in monomials(degree) for part in range(size)]
    entries, rows, shares = [], [], []
    number = 0
    for j, (power, part) in enumerate(basis):
        for i, (other, other_part) in enumerate(basis[: j + 1]):
            entry = _ENTRIES.index((min(part, other_part), max(part, other_part)))
            share = _off_diagonal(i, j, alike=part == other_part)
            product = times(power, other)
            for by in moved:
                entries.append(number)
                rows.append(entry * height + _PLACE[times(product, by)])
                shares.append(share)
            number += 1
    return len(basis), np.array(entries), np.array(rows), np.array(shares)


@cache
def _slope(degree: int, axes: tuple[int, ...]) -> tuple[Ints, Ints, Floats]:
    """Return rows, columns and values of the sum of derivatives of a potential along axes."""
    rows, columns, values = [], [], []
    for column, powers in enumerate(monomials(degree)[1:]):
        for axis in axes:
            if powers[axis]:
                less = list(powers)
                less[axis] -= 1
                rows.append(_PLACE[less[0], less[1], less[2], less[3]])
                columns.append(column)
                values.append(float(powers[axis]))
    return np.array(rows), np.array(columns), np.array(values)


class _Program:
    """A semidefinite program with a potential, as `check_potential` states it.

    The first variables are the coefficients of the potential.

    Parameters
    ----------
    positive : sequence of mapping
        Quadratic polynomials that are at least 0 at all states.
    ring : Fraction
    degree : int
    """

    def __init__(
        self, positive: Sequence[Mapping[Monomial, float]], ring: Fraction, degree: int
    ) -> None:
        self.degree, self._half = degree, degree // 2
        self._entry = len(monomials(degree - 1))  # rows of an entry of a matrix of polynomials
        self.basis = monomials(degree)[1:]
        self.count = len(self.basis)
        self.costs: dict[int, float] = {}
        self.matrices: list[tuple[int, int]] = []  # first variable and size
        self.norms: list[tuple[int, int]] = []  # pairs of variables with a norm of at most 1
        self.height = 0
        self._rows: list[Ints] = []
        self._columns: list[Ints] = []
        self._values: list[Floats] = []
        self._constants: list[Floats] = []
        self.around = list(positive)
        disks = [_scaled(inside_disk(k)) for k in (0, 1)]
        rings = [_scaled(on_wall(k, ring)) for k in (0, 1)]
        self.cases: list[dict[str, Any]] = []
        self._add_case([_slope(degree, (0, 2)), _slope(degree, (1, 3))], 1.0, disks, None)
        for held, other in ((0, 1), (1, 0)):
            slopes = [_slope(degree, (2 * other + axis,)) for axis in (0, 1)]
            begin = self.height
            if ring:
                self._add_case(slopes, -1.0, [disks[other], disks[held], rings[held]], None)
            else:
                self._add_case(slopes, -1.0, [disks[other]], disks[held])
            holds = []
            factors = [disks[other], *self.around] if self._half > 1 else []
            for number, factor in enumerate([{ONE: 1.0}, *factors]):
                holds.append(len(self.matrices))
                shifts = [(_AXES[2 * held], 0, -1.0), (_AXES[2 * held], 2, 1.0)]
                shifts.append((_AXES[2 * held + 1], 1, -1.0))
                lost = turn(ring) * 2.0**-40
                shifts += [(ONE, 0, lost), (ONE, 2, lost)] if lost else []
                self._put_squares(begin, self._half - 1 - bool(number), 1, factor, shifts)
            self.cases[-1]["holds"] = holds

    def add(self, number: int) -> int:
        """Add variables and return the first one."""
        self.count += number
        return self.count - number

    def put(self, rows: Any, columns: Any, values: Any) -> None:
        """Add entries of the matrix."""
        self._rows.append(np.asarray(rows))
        self._columns.append(np.asarray(columns))
        self._values.append(np.asarray(values, np.float64))

    def equal(self, constants: Floats) -> int:
        """Add rows that are equal to constants, and return the first one."""
        self._constants.append(constants)
        self.height += len(constants)
        return self.height - len(constants)

    def matrix(self, size: int) -> int:
        """Add a positive semidefinite matrix and return its first variable."""
        first = self.add(size * (size + 1) // 2)
        self.matrices.append((first, size))
        return first

    def _put_squares(
        self,
        begin: int,
        degree: int,
        size: int,
        factor: Mapping[Monomial, float],
        shifts: Sequence[tuple[Monomial, int, float]] = ((ONE, 0, 1.0),),
    ) -> None:
        """Add a matrix of squares times a polynomial, and times each shift to the rows of its entry."""
        first = None
        for shift, entry, sign in shifts:
            moved = tuple(times(power, shift) for power in factor)
            count, entries, rows, shares = _squares(degree, size, moved, self._entry)
            if first is None:
                first = self.matrix(count)
            weights = sign * np.tile(list(factor.values()), len(shares) // len(factor)) * shares
            self.put(begin + entry * self._entry + rows, first + entries, weights)

    def _add_case(
        self,
        slope: Sequence[tuple[Ints, Ints, Floats]],
        sign: float,
        positive: Sequence[Mapping[Monomial, float]],
        zero: Mapping[Monomial, float] | None,
    ) -> None:
        """Add that a slope times a sign is at most 1."""
        high = self._entry
        constants = np.zeros(3 * high)
        constants[[0, 2 * high]] = 1.0
        begin = self.equal(constants)
        squares = []
        for number, factor in enumerate([{ONE: 1.0}, *positive, *self.around]):
            squares.append(len(self.matrices))
            self._put_squares(begin, self._half - bool(number), 2, factor)
        multipliers = []
        for entry in range(3) if zero is not None else ():
            powers = monomials(2 * self._half - 2)
            first = self.add(len(powers))
            multipliers.append(range(first, first + len(powers)))
            for one_of, x in (zero or {}).items():
                rows = [begin + entry * high + _PLACE[times(power, one_of)] for power in powers]
                self.put(rows, multipliers[-1], np.full(len(powers), x))
        for entry, part, turned in ((0, slope[0], 1), (1, slope[1], 1), (2, slope[0], -1)):
            rows_of, columns, values = part
            self.put(begin + entry * high + rows_of, columns, -sign * turned * values)
        self.cases.append({"squares": squares, "zero": multipliers, "holds": []})

    def solve(self, accuracy: float = _ACCURACY) -> tuple[Floats, list[list[float]]] | None:
        """Return the variables and the positive definite matrices with the least cost, or None."""
        from scipy.sparse import csc_matrix, diags

        clarabel = import_extra("clarabel", "certificates need Clarabel", extra="certify")
        settings = solver_settings(clarabel)
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = accuracy
        settings.iterative_refinement_enable = False
        starts, sizes = np.array(self.matrices).T
        firsts = np.cumsum([0, *(sizes * (sizes + 1) // 2)])
        inside = np.concatenate(
            [
                start + np.arange(end - first)
                for start, first, end in zip(starts, firsts, firsts[1:], strict=False)
            ]
        )
        cones = [clarabel.PSDTriangleConeT(size) for size in sizes.tolist()]
        cones += [clarabel.SecondOrderConeT(3)] * len(self.norms)
        # the rows of a cone are a constant, then two variables for a norm, or the variables of a matrix
        height = int(firsts[-1]) + 3 * len(self.norms)
        constants = np.zeros(height)
        constants[firsts[-1] :: 3] = 1.0
        rows = np.delete(np.arange(height), np.flatnonzero(constants))
        columns = np.append(inside, np.array(self.norms, np.int64))
        in_cones = csc_matrix((np.ones(len(rows)), (rows, columns)), (height, self.count))
        costs = np.zeros(self.count)
        costs[list(self.costs)] = list(self.costs.values())
        places = (np.concatenate(self._rows), np.concatenate(self._columns))
        equations = csc_matrix((np.concatenate(self._values), places), (self.height, self.count))
        # each equation gives an entry of a matrix that is in no other one: without both, the solver
        # takes two thirds of the time, and leaves nothing of the equations
        single = inside[np.diff(equations.indptr)[inside] == 1]
        given = np.zeros(self.height, np.int64)
        given[equations.indices[equations.indptr[single]]] = single
        rest = np.delete(np.arange(self.count), given)
        scale = diags(1 / equations.data[equations.indptr[given]])
        known, others = scale @ np.concatenate(self._constants), scale @ equations[:, rest]
        solution = clarabel.DefaultSolver(
            csc_matrix((len(rest), len(rest))),
            costs[rest],
            csc_matrix(in_cones[:, given] @ others - in_cones[:, rest]),
            constants + in_cones[:, given] @ known,
            cones,
            settings,
        ).solve()
        x, slacks = np.zeros(self.count), np.array(solution.s)
        x[rest] = solution.x
        x[given] = known - others @ x[rest]
        if not (np.isfinite(x).all() and np.isfinite(slacks).all()):
            return None
        matrices = []
        for (_, size), first in zip(self.matrices, firsts[:-1], strict=True):
            # the slacks are inside of the cone, and equal to the variables but for rounding errors
            triangle = slacks[first : first + size * (size + 1) // 2].copy()
            diagonal = np.cumsum(np.arange(1, size + 1)) - 1
            off = np.ones(len(triangle), np.bool_)
            off[diagonal] = False
            triangle[off] /= sqrt(2)
            triangle[diagonal] += _MARGIN
            matrices.append(_rounded(triangle))
        return x, matrices

    def proof(self, x: Floats, matrices: list[list[float]]) -> dict[str, Any]:
        """Return the potential and its matrices as JSON."""
        return {
            "potential": _rounded(x[: len(self.basis)]),
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


def _rounded(numbers: Floats) -> list[float]:
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
    program = _Program([_scaled(one) for one in around], width, DEGREE)
    powers = np.array(program.basis)
    fall = np.prod(goal.ravel() ** powers, axis=1) - np.prod(start.ravel() ** powers, axis=1)
    program.costs = dict(enumerate(fall.tolist()))
    found = program.solve()
    if found is None:
        return 0.0, None
    proof = program.proof(*found)
    try:
        value = potential_value(first, last, near, most, width, proof)
    except WrongPotentialError:  # the solver stopped early
        return 0.0, None
    return float(value), proof


class _ContactProgram(_Program):
    """The program of a potential between the first and the last contact, as `check_contacts` states it.

    Parameters
    ----------
    contacts : Contacts
    pair : tuple of Sector
    around : sequence of mapping
        What `Contacts.region` returns, scaled.
    most : float
        A bound that is enough.
    degree : int
    """

    def __init__(
        self,
        contacts: Contacts,
        pair: tuple[Sector, Sector],
        around: Sequence[Mapping[Monomial, float]],
        most: float,
        degree: int,
    ) -> None:
        super().__init__(around, contacts.ring, degree)
        least = self.add(2)
        self.costs = {least: -1.0, least + 1: -1.0}
        self.ends: list[dict[str, Any]] = []
        for end, sector in enumerate(pair):
            self._add_end(contacts, end, sector, least + end)
        row = self.equal(np.array([most]))
        spare = self.matrix(1)
        self.put([row] * 3, [least, least + 1, spare], [1.0] * 3)

    def _add_end(self, contacts: Contacts, end: int, sector: Sector, least: int) -> None:
        begin = self.equal(np.zeros(len(flat_monomials(self.degree + 1))))
        sign = -1.0 if end else 1.0
        normal = self.add(2)
        self.norms.append((normal, normal + 1))
        place = [float(x) for x in contacts.place(end, sector.particle)]
        other = [float(x) for x in contacts.to_other(end, sector.particle)]
        # the squares - sign (n . (c - p) + V) + least = 0
        self.put([begin], [least], [1.0])
        for axis, key in enumerate([(1, 0), (0, 1)]):
            at = begin + _FLAT_PLACE[key]
            self.put([at, begin], [normal + axis] * 2, [-sign, sign * place[axis]])
        for column, powers in enumerate(self.basis):
            terms = at_contact(powers, sector.particle, other)
            rows = [begin + _FLAT_PLACE[key] for key in terms]
            self.put(rows, [column] * len(rows), -sign * np.array(list(terms.values())))
        positive = [_real(one) for one in contacts.positive(end, sector)]
        squares = []
        for number, factor in enumerate([{(0, 0): 1.0}, *positive[0 if contacts.ring else 1 :]]):
            basis = flat_monomials(degree_of_squares(self.degree, number))
            squares.append(len(self.matrices))
            first = self.matrix(len(basis))
            rows, columns, values = [], [], []
            for j, (a, b) in enumerate(basis):
                for i, (c, d) in enumerate(basis[: j + 1]):
                    for (e, f), x in factor.items():
                        rows.append(begin + _FLAT_PLACE[a + c + e, b + d + f])
                        columns.append(first)
                        values.append(x * _off_diagonal(i, j, alike=True))
                    first += 1
            self.put(rows, columns, values)
        zero = range(0)
        if not contacts.ring:
            multipliers = flat_monomials(self.degree - 1)
            begin_zero = self.add(len(multipliers))
            zero = range(begin_zero, self.count)
            for (e, f), x in positive[0].items():
                rows = [begin + _FLAT_PLACE[a + e, b + f] for a, b in multipliers]
                self.put(rows, zero, [x] * len(rows))
        self.ends.append({"normal": normal, "squares": squares, "zero": zero})

    def proof(self, x: Floats, matrices: list[list[float]]) -> dict[str, Any]:
        """Return the potential, its matrices and those of both ends as JSON."""
        ends = []
        for one in self.ends:
            normal = x[one["normal"] :][:2]
            normal = normal * min(1.0, (1 - 1e-9) / max(float(np.hypot(*normal)), 1e-9))
            ends.append(
                {
                    "direction": _rounded(normal),
                    "squares": [matrices[k] for k in one["squares"]],
                    "zero": _rounded(x[one["zero"].start : one["zero"].stop]),
                }
            )
        return super().proof(x, matrices) | {"ends": ends}


def _real(polynomial: Flat) -> dict[tuple[int, int], float]:
    return {key: float(x) for key, x in polynomial.items()}


def contact_potential(
    contacts: Contacts,
    pair: tuple[Sector, Sector],
    around: Sequence[Polynomial],
    degree: int,
    accuracy: float,
) -> tuple[float, dict[str, Any] | None]:
    """Return the bound of a potential for the plans with their first and last contacts in two sectors,
    in units of the radius, with its proof; 0 and None if there is none.

    What the solver leaves of its equations is lost for the bound.
    """
    most = 1.01 * float(contacts.limit)
    program = _ContactProgram(contacts, pair, [_scaled(one) for one in around], most, degree)
    found = program.solve(accuracy)
    if found is None:
        return 0.0, None
    proof = program.proof(*found)
    try:
        value = part_value(contacts, pair, around, proof)
    except WrongPotentialError:  # the solver stopped early
        return 0.0, None
    return float(value) * (1 - 1e-12), proof
