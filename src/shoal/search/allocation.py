"""Who searches which part of a tour: each robot computes the same answer from the same broadcast starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.errors import InvalidInputError
from shoal.registry import Registry
from shoal.search.bits import turned
from shoal.search.course import Course, Floats
from shoal.search.kernels import shares

Indices = NDArray[np.int64]
_HALVINGS = 40
_STRIDES = 96  # how many first borders are tried at the most
_TRIALS = 8_000  # cuts into equal arcs that are tried at the most, once for each turn of the robots
_CANDIDATES = 12  # cuts into equal arcs that are made better


@dataclass(frozen=True)
class Sweep:
    """Cells to search one after another: ``count`` of them from number ``first`` of the tour on, forwards (1) or backwards (-1)."""

    first: int
    count: int
    step: int = 1

    def next_of(self, wanted: int, n: int) -> int | None:
        """Return the first of its cells that is in a set, given as bits, of a tour of n cells; None if none is.

        Examples
        --------
        >>> Sweep(3, 4, -1).next_of(0b100101, 8)
        2
        """
        if self.step > 0:
            here = turned(wanted, self.first, n) & ((1 << self.count) - 1)
            return ((here & -here).bit_length() - 1 + self.first) % n if here else None
        low = self.first - self.count + 1
        here = turned(wanted, low, n) & ((1 << self.count) - 1)
        return (here.bit_length() - 1 + low) % n if here else None


@dataclass(frozen=True, eq=False)
class Allocation:
    """What each robot is to search.

    Parameters
    ----------
    method : str
    sweeps : tuple of tuple of Sweep
        By robot, in the order of its work; no sweeps for a robot in reserve.
    times : ndarray of float64, shape (m,)
        When each robot is done, the way to its first cell included; in the time that speed 1 takes for a cell.
    lower_bound : float
        No allocation is done earlier: the number of cells over the sum of the speeds.
    """

    method: str
    sweeps: tuple[tuple[Sweep, ...], ...]
    times: Floats
    lower_bound: float

    @property
    def makespan(self) -> float:
        """When the last robot is done."""
        return float(self.times.max())


Method = Callable[[Course, Indices, Floats, Floats], list[list[Sweep]]]
METHODS: Registry[Method] = Registry("allocation")


def allocate(
    course: Course, starts: ArrayLike, *, method: str = "hop", rates: ArrayLike | None = None, places: ArrayLike | None = None
) -> Allocation:
    """Share the cells of a tour among robots.

    Parameters
    ----------
    course : Course
    starts : array_like of int, shape (m,)
        The number on the tour of the cell in which each robot starts, m at least 1; several may start in one.
    method : str
        "stay": each robot searches from its start to the next robot's (paper H). "common-shift": all move along the tour first,
        none farther than a common way, then search. "individual-shift": each moves along the tour as far as suits it. "two-way":
        each searches what lies behind and ahead of it. "hop": each goes straight to the beginning of an arc.
    rates : array_like of float, shape (m,), optional
        How fast each robot moves and searches; 1 if not given.
    places : array_like of float, shape (m, d), optional
        Where the robots are, as `Course.points`; in the middles of their cells if not given.

    Raises
    ------
    InvalidInputError
    UnknownNameError

    Notes
    -----
    "stay" is paper H, p. 5; the others answer what it leaves open ("slightly more initial configuration movement").

    Examples
    --------
    >>> from shoal.search import make_tour
    >>> course = Course(make_tour("moore", (8, 8)))
    >>> allocate(course, [0, 1, 2, 3], method="stay").makespan
    61.0
    >>> allocate(course, [0, 1, 2, 3], method="hop").makespan < 24
    True
    """
    n = len(course)
    first = np.asarray(starts)
    if first.ndim != 1 or not len(first) or first.dtype.kind not in "iu" or (first < 0).any() or (first >= n).any():
        raise InvalidInputError(f"starts: expected one or more numbers of cells from 0 to {n - 1}, got {first.tolist()!r:.200}")
    first = first.astype(np.int64)
    speeds = np.ones(len(first)) if rates is None else np.asarray(rates, dtype=np.float64)
    if speeds.shape != first.shape or not (np.isfinite(speeds) & (speeds > 0)).all():
        raise InvalidInputError(f"rates: expected {len(first)} speeds above 0, got {speeds.tolist()!r:.200}")
    at = course.points[first] if places is None else np.asarray(places, dtype=np.float64)
    if at.shape != (len(first), course.points.shape[1]):
        raise InvalidInputError(f"places: expected shape ({len(first)}, {course.points.shape[1]}), got {at.shape}")
    order = np.argsort(first, kind="stable")  # of several in a cell the last one goes on
    found = METHODS.get(method)(course, first[order], speeds[order], at[order])
    sweeps: list[tuple[Sweep, ...]] = [()] * len(first)
    for robot, work in zip(order, found, strict=True):
        sweeps[robot] = tuple(sweep for sweep in work if sweep.count > 0)
    times = np.array([work_time(course, work, place) for work, place in zip(sweeps, at, strict=True)]) / speeds
    return Allocation(method, tuple(sweeps), times, n / float(speeds.sum()))


def work_time(course: Course, sweeps: Sequence[Sweep], place: Floats) -> float:
    """Return what sweeps cost a robot at a place; it goes straight to each."""
    total, n = 0.0, len(course)
    here: int | None = None
    for sweep in sweeps:
        first = sweep.first % n
        total += float(np.linalg.norm(course.points[first] - place)) if here is None else course.way(here, first)
        total += course.search_cost(sweep.first, sweep.count, sweep.step)
        here = (sweep.first + sweep.step * (sweep.count - 1)) % n
    return total


@METHODS.register("stay")
def stay(course: Course, starts: Indices, rates: Floats, places: Floats) -> list[list[Sweep]]:
    """From the start to the next one's."""
    gaps = np.diff(np.append(starts, starts[0] + len(course)))
    return [[Sweep(int(first), int(count))] for first, count in zip(starts, gaps, strict=True)]


@METHODS.register("common-shift")
def common_shift(course: Course, starts: Indices, rates: Floats, places: Floats) -> list[list[Sweep]]:
    """All go as far as D at the most, and then search G: the least D + G; speeds are those of the slowest."""
    n, m = len(course), len(starts)
    at = course.ahead[np.concatenate([starts, starts + n])]
    ways = np.array([(at[k : k + m] - at[:m]).max() for k in range(1, m)])  # the largest sum of k gaps
    share = course.whole / m
    counts = np.arange(1, m)

    def gap(shift: float) -> float:
        return max(share, float(((ways - 2 * shift) / counts).max())) if m > 1 else course.whole

    low, high = 0.0, course.whole
    for _ in range(100):  # D + G is convex in D
        one, other = low + (high - low) / 3, high - (high - low) / 3
        low, high = (low, other) if one + gap(one) <= other + gap(other) else (one, high)
    shift, arc = low, gap(low)
    # The foremost borders that the limits allow: s + D, and G after the border before.
    rounds = np.concatenate([at[:m] - course.whole, at]) + shift
    fronts = np.minimum.accumulate(rounds - arc * np.arange(3 * m)) + arc * np.arange(3 * m)
    borders = np.searchsorted(course.ahead, fronts[m : 2 * m] + course.whole + 1e-6, side="right") - 1
    return _arcs(np.append(borders, borders[0] + n))


@METHODS.register("individual-shift")
def individual_shift(course: Course, starts: Indices, rates: Floats, places: Floats) -> list[list[Sweep]]:
    """Each goes along the tour to the beginning of its cells."""
    return _arcs(_bisected(partial(_passed, 0, course, starts, rates), course, starts, rates))


@METHODS.register("two-way")
def two_way(course: Course, starts: Indices, rates: Floats, places: Floats) -> list[list[Sweep]]:
    """Each begins with the shorter part of its cells, behind it or ahead, and comes back for the other."""
    n = len(course)
    borders = _bisected(partial(_passed, 1, course, starts, rates), course, starts, rates)
    found = []
    for start, low, high in zip(starts + n, borders[:-1], borders[1:], strict=True):
        if not low <= start < high:
            found.append([Sweep(int(low % n), int(high - low))])
            continue
        back = [Sweep(int(start % n), int(start - low + 1), -1), Sweep(int((start + 1) % n), int(high - start - 1))]
        forth = [Sweep(int(start % n), int(high - start)), Sweep(int((start - 1) % n), int(start - low), -1)]
        place = course.points[start % n]
        found.append(min(back, forth, key=lambda work: work_time(course, [one for one in work if one.count], place)))
    return found


@METHODS.register("hop")
def hop(course: Course, starts: Indices, rates: Floats, places: Floats) -> list[list[Sweep]]:
    """Each goes straight to an arc, the order kept round the tour; who has farther to go searches less."""
    n, m = len(course), len(starts)
    rows = min(4 * _STRIDES, max(8, _TRIALS // m))
    firsts = np.unique(np.linspace(0, min(n, int(2 * n / m)) - 1, rows).astype(np.int64)) if m > 1 else starts
    latest = np.empty((len(firsts), m))
    shares.hop_costs(course.ahead, course.points, places, rates, firsts, latest)
    best, borders, chosen = np.inf, np.arange(m + 1), 0
    for number in np.argsort(latest, axis=None, kind="stable")[:_CANDIDATES]:
        row, turn = np.unravel_index(int(number), latest.shape)
        low, high = n / float(rates.sum()), float(min(latest[row, turn], best)) + 1.0
        trial = np.empty(m + 1, dtype=np.int64)
        while best == np.inf:  # with fewer cells than robots no equal arcs are whole cells
            if shares.hop_pass(course.ahead, course.points, places, rates, high, firsts[row], turn, trial):
                best, borders, chosen = high, np.minimum(trial, firsts[row] + n), int(turn)
            high *= 2
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            done = shares.hop_pass(course.ahead, course.points, places, rates, middle, firsts[row], turn, trial)
            if done and middle < best:
                best, borders, chosen = middle, np.minimum(trial, firsts[row] + n), int(turn)
            low, high = (low, middle) if done else (middle, high)
            if high - low < 1e-3:
                break
    arcs = _arcs(borders)
    return [arcs[(robot - chosen) % m] for robot in range(m)]


def _arcs(borders: Indices) -> list[list[Sweep]]:
    n = int(borders[-1] - borders[0])
    return [[Sweep(int(low % n), int(high - low))] for low, high in pairwise(borders)]


def _passed(kind: int, course: Course, starts: Indices, rates: Floats, time: float, borders: Indices) -> bool:
    reach = min(len(course), int(time * rates[0]) + 1)
    stride = max(1, reach // _STRIDES)
    return bool(shares.best_start(kind, course.ahead, course.points, starts, rates, len(course), time, stride, borders))


def _bisected(passed: Callable[[float, Indices], bool], course: Course, starts: Indices, rates: Floats) -> Indices:
    """Return the borders of the least time in which a pass succeeds, int64, shape (m + 1,)."""
    n = len(course)
    best = np.append(starts, starts[0] + n) + n  # as they stay
    gaps = np.diff(course.ahead[best]) / rates
    low, high = n / float(rates.sum()), float(gaps.max())
    trial = np.empty(len(starts) + 1, dtype=np.int64)
    for _ in range(_HALVINGS):
        if high - low < 1e-3:
            break
        middle = (low + high) / 2
        if passed(middle, trial):
            best, high = np.minimum(trial, trial[0] + n), middle
        else:
            low = middle
    return best
