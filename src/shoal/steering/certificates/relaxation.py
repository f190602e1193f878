"""Lower bounds by second-order cones: all plans whose chain of holds has a given pattern."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from math import frexp, inf
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import import_extra

Hold = tuple[int, ...]  # wall, and the particle that it holds, 0 or 1

STEP = 2.0**-36  # multipliers are multiples of this


@dataclass(frozen=True)
class HoldGap:
    """A place of a pattern where any number of holds may be: of ``holds``, or of all holds if it is
    None.
    """

    holds: frozenset[Hold] | None = None


Pattern = tuple[Hold | HoldGap, ...]
"""All plans whose holds, repeats counted once, are those of the pattern, with any in its gaps.
Between two gaps is a hold."""


@dataclass(frozen=True)
class Bound:
    """A lower bound of a pattern, with the multipliers of norms, float64 (n, 2), and of
    constraints, float64 (m,), that prove it; and the length of the inputs in each gap.
    """

    value: float
    norms: NDArray[np.float64]
    slacks: NDArray[np.float64]
    loads: dict[int, float]

    def proof(self) -> dict[str, Any]:
        """Return the multipliers as JSON."""
        slacks = [[int(k), float(self.slacks[k])] for k in np.flatnonzero(self.slacks)]
        return {"norms": self.norms.tolist(), "slacks": slacks}


class Programs(Protocol):
    """The convex programs of all patterns of one task."""

    scale: float
    limit: float
    holds: list[Hold]

    def follows(self, first: Hold, second: Hold) -> bool:
        """Return whether ``second`` can come directly after ``first``."""

    def bound(self, pattern: Pattern) -> Bound:
        """Return the lower bound of all plans of a pattern, at most the limit."""


class Relaxation:
    """The convex programs of all patterns of one task.

    The programs, with the order of their variables, norms and constraints, are those of
    docs/concepts/steering/certificates.md. Their unit is a power of two.

    Parameters
    ----------
    corners : ndarray of float64, shape (n, 2)
        Corners of a convex polygon, counter-clockwise.
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
        self,
        corners: NDArray[np.float64],
        start: NDArray[np.float64],
        goal: NDArray[np.float64],
        tolerance: float,
        limit: float,
    ) -> None:
        clarabel = import_extra("clarabel", "certificates need Clarabel", extra="certify")
        self._clarabel = clarabel
        self.scale = 2.0 ** frexp(float(np.ptp(corners, axis=0).max()))[1]
        origin = corners[0]
        self.corners = (corners - origin) / self.scale
        self.along = np.roll(self.corners, -1, axis=0) - self.corners
        self.normals = np.stack([-self.along[:, 1], self.along[:, 0]], axis=1)
        self.offsets = np.sum(self.normals * self.corners, axis=1)
        self.start, self.goal = (start - origin) / self.scale, (goal - origin) / self.scale
        self.tolerance, self.limit = tolerance / self.scale, limit / self.scale
        self.extent = np.ptp(self.corners, axis=0)
        self.holds: list[Hold] = [(k, particle) for k in range(len(corners)) for particle in (0, 1)]
        self._useless = _useless(corners)
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.presolve_enable = False, False
        settings.chordal_decomposition_enable, settings.max_threads = False, 1
        self._settings = settings

    def follows(self, first: Hold, second: Hold) -> bool:
        """Return whether ``second`` can come directly after ``first``, and change the difference
        of the particles.
        """
        return first != second and (first, second) not in self._useless

    def bound(self, pattern: Pattern) -> Bound:
        """Return the lower bound of all plans of a pattern, at most the limit."""
        from scipy.sparse import csc_matrix

        norms, rows, low, high = self.program(pattern)
        count, size = len(low), len(norms)
        clarabel = self._clarabel
        # the variables of the program, then the length of each norm
        system = np.zeros((len(rows) + 2 * count + 3 * size, count + size + 1))
        system[: len(rows), :count], system[: len(rows), -1] = rows[:, :-1], rows[:, -1]
        box = system[len(rows) : len(rows) + 2 * count]
        box[:count, :count], box[:count, -1] = np.eye(count), -low
        box[count:, :count], box[count:, -1] = -np.eye(count), high
        cones = system[len(rows) + 2 * count :].reshape(size, 3, -1)
        cones[:, 0, count:-1] = np.eye(size)
        cones[:, 1:, :count], cones[:, 1:, -1] = norms[:, :, :-1], norms[:, :, -1]
        solution = clarabel.DefaultSolver(
            csc_matrix((count + size, count + size)),
            np.concatenate([np.zeros(count), np.ones(size)]),
            csc_matrix(-system[:, :-1]),
            system[:, -1],
            [
                clarabel.NonnegativeConeT(len(rows) + 2 * count),
                *(clarabel.SecondOrderConeT(3) for _ in range(size)),
            ],
            self._settings,
        ).solve()
        dual = np.array(solution.z)
        slacks = np.maximum(dual[: len(rows)], 0.0)
        vectors = -dual[len(rows) + 2 * count :].reshape(size, 3)[:, 1:]
        if not np.isfinite(dual).all():
            vectors, slacks = np.zeros_like(vectors), np.zeros_like(slacks)
        if "Infeasible" in str(solution.status):
            vectors = np.zeros_like(vectors)
            worth = _worth(norms, rows, low, high, vectors, slacks)
            slacks *= 2 * self.limit / worth if worth > 0 else 0.0
        vectors /= np.maximum(np.hypot(*vectors.T), 1)[:, None]
        # multiples of STEP, which exact arithmetic takes; towards 0, so that no norm exceeds 1
        vectors = np.trunc(vectors * (1 - 1e-15) / STEP) * STEP
        slacks = np.round(slacks / STEP) * STEP
        value = min(_worth(norms, rows, low, high, vectors, slacks), self.limit)
        lengths = np.array(solution.x)[count:]
        loads, number = {}, 0
        for place, item in enumerate(pattern):
            more = (
                3
                if not isinstance(item, HoldGap)
                else 3
                if item.holds is None
                else 1 + len(item.holds)
            )
            if isinstance(item, HoldGap):
                loads[place] = float(lengths[number : number + more].sum())
            number += more - (place > 0 and isinstance(pattern[place - 1], HoldGap))
        return Bound(max(value, 0.0) * self.scale, vectors, slacks, loads)

    def program(
        self, pattern: Pattern
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Return the norms (n, 2, variables + 1) whose sum is least, the rows (m, variables + 1) of
        expressions that are at least 0, and the bounds of the variables.
        """
        far = (
            4
            + 4 * len(pattern)
            + 2
            * sum(
                2 + (2 if item.holds is None else len(item.holds))
                for item in pattern
                if isinstance(item, HoldGap)
            )
        )
        low, high = np.zeros(far), np.zeros(far)
        used = 0

        def vector(least: NDArray[np.float64], most: NDArray[np.float64]) -> NDArray[np.float64]:
            nonlocal used
            new = np.zeros((2, far + 1))
            new[0, used] = new[1, used + 1] = 1
            low[used : used + 2], high[used : used + 2] = least, most
            used += 2
            return new

        def constant(value: NDArray[np.float64]) -> NDArray[np.float64]:
            new = np.zeros((2, far + 1))
            new[:, -1] = value
            return new

        reach = np.full(2, self.limit)
        goals = [vector(one - self.tolerance, one + self.tolerance) for one in self.goal]
        places = [constant(one) for one in self.start]
        norms, rows = [], []
        if not pattern:
            apart = (goals[1] - goals[0]) - (places[1] - places[0])
            norms, rows = [goals[0] - places[0]], [apart, -apart]
        gap: list[NDArray[np.float64]] | None = None
        for number, item in enumerate(pattern):
            if isinstance(item, HoldGap):
                free = vector(-reach, reach)
                if number < len(pattern) - 1:
                    before = vector(-self.extent, self.extent)
                norms.append(free)
                gap = [places[0] + free, places[1] + free]
                for hold in [(-1, 0), (-1, 1)] if item.holds is None else sorted(item.holds):
                    change = vector(-reach, reach)
                    norms.append(change)
                    gap[1 - hold[1]] = gap[1 - hold[1]] + change
                    if item.holds is not None:
                        rows.append(-self.normals[hold[0] : hold[0] + 1] @ change)
                continue
            wall, particle = item
            sign = 1.0 if particle == 0 else -1.0
            first, last = constant(self.corners[wall]), constant(self.corners[wall])
            first[:, used] = last[:, used + 1] = self.along[wall]
            high[used : used + 2] = 1
            used += 2
            if gap is None:
                before = places[1] - places[0]
                norms.append(first - places[particle])
            else:
                now = [first, first + before] if particle == 0 else [first - before, first]
                rows += [gap[0] - now[0], now[0] - gap[0], gap[1] - now[1], now[1] - gap[1]]
                gap = None
            after = (
                goals[1] - goals[0]
                if number == len(pattern) - 1
                else vector(-self.extent, self.extent)
            )
            norms += [last - first, after - before]
            for contact, apart in ((first, before), (last, after)):
                inside = self.normals @ (contact + sign * apart)
                inside[:, -1] -= self.offsets
                rows.append(inside)
            rows.append(sign * self.normals[wall : wall + 1] @ (before - after))
            places = [last, last + after] if particle == 0 else [last - after, last]
            if number == len(pattern) - 1:
                norms.append(goals[particle] - last)
        if gap is not None:
            rows += [gap[0] - goals[0], goals[0] - gap[0], gap[1] - goals[1], goals[1] - gap[1]]
        keep = [*range(used), far]
        return np.stack(norms)[:, :, keep], np.concatenate(rows)[:, keep], low[:used], high[:used]


def _useless(corners: NDArray[np.float64]) -> set[tuple[Hold, Hold]]:
    """Return the pairs of holds of which the second finds both particles on its wall, and so
    holds both: those with opposite normals times signs, in exact arithmetic.
    """
    points = [[Fraction(x) for x in corner] for corner in corners.tolist()]
    along = [
        (following[0] - point[0], following[1] - point[1])
        for point, following in zip(points, points[1:] + points[:1], strict=True)
    ]
    found: set[tuple[Hold, Hold]] = set()
    for one, first in enumerate(along):
        for other, second in enumerate(along):
            if first[0] * second[1] == first[1] * second[0]:
                same = first[0] * second[0] + first[1] * second[1] > 0
                for particle in (0, 1):
                    found.add(((one, particle), (other, 1 - particle if same else particle)))
    return found


def _worth(
    norms: NDArray[np.float64],
    rows: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
    vectors: NDArray[np.float64],
    slacks: NDArray[np.float64],
) -> float:
    total: Any = np.einsum("ni,nij->j", vectors, norms) - slacks @ rows
    rest = total[:-1]
    value = float(total[-1] + np.minimum(rest * low, rest * high).sum())
    return value if np.isfinite(value) else -inf


@dataclass(frozen=True)
class Branching:
    """How the plans of a pattern are divided: by the hold of a gap that is the first (or, from the
    right, the last) not to be in ``known``.
    """

    place: int
    known: frozenset[Hold] = frozenset()
    right: bool = False

    def proof(self) -> dict[str, Any]:
        """Return the division as JSON."""
        known = [list(hold) for hold in sorted(self.known)]
        return {"place": self.place, "known": known, "side": "last" if self.right else "first"}


def branches(relaxation: Programs, pattern: Pattern, how: Branching) -> list[Pattern]:
    """Return the patterns into which a branching divides a pattern."""
    before, gap, after = pattern[: how.place], pattern[how.place], pattern[how.place + 1 :]
    assert isinstance(gap, HoldGap)
    known = (HoldGap(how.known),) if how.known else ()

    def fits(*middle: Hold | HoldGap) -> bool:
        whole = (*before[-1:], *middle, *after[:1])
        return all(
            isinstance(one, HoldGap) or isinstance(other, HoldGap) or relaxation.follows(one, other)
            for one, other in pairwise(whole)
        )

    middles: list[Pattern] = [known]
    middles += [
        (gap, hold, *known) if how.right else (*known, hold, gap)
        for hold in (relaxation.holds if gap.holds is None else sorted(gap.holds))
        if hold not in how.known
    ]
    return [(*before, *middle, *after) for middle in middles if fits(*middle)]
