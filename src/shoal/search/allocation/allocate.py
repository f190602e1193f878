"""Allocation: which part of the tour each robot searches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_array, check_kind, check_points, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.registry import Registry, configured
from shoal.search.allocation.costs import Floats, TourCost
from shoal.search.allocation.likely import likely_first
from shoal.search.allocation.viewpoints import gain_of, select_viewpoints
from shoal.search.cells.footprint import check_widths
from shoal.search.kernels import shares
from shoal.search.kernels.shares import Team as Team  # noqa: PLC0414 - an argument of allocators
from shoal.search.tours.masks import arc_bits, rotate_bits, runs


@dataclass(frozen=True)
class Arc:
    """Consecutive cells of the tour that a robot searches in order.

    Parameters
    ----------
    first : int
        Tour index of the cell that the robot searches first.
    count : int
        Number of cells in the arc.
    step : int
        Direction of the search: 1 for forwards along the tour, -1 for backwards.
    """

    first: int
    count: int
    step: int = 1

    def bits(self, n: int) -> int:
        """Return the bitset of the arc's cells, for a tour of n cells."""
        return arc_bits(
            (self.first if self.step > 0 else self.first - self.count + 1) % n, self.count, n
        )

    def stretches(self, cells: int, n: int) -> list[tuple[int, int]]:
        """Return the sections of the arc whose cells are in the bitset ``cells``, on a tour of n
        cells.

        A section is a pair: the tour index of the cell that the robot searches first, and the
        number of cells. The sections are in the order of the search.

        Examples
        --------
        >>> Arc(3, 4, -1).stretches(0b001101, 8)
        [(3, 2), (0, 1)]
        """
        low = self.first if self.step > 0 else self.first - self.count + 1
        spans = list(runs(self.bits(n) & cells, low, n))
        return (
            spans
            if self.step > 0
            else [((first + count - 1) % n, count) for first, count in reversed(spans)]
        )

    def next_of(self, cells: int, n: int) -> int | None:
        """Return the tour index of the arc's first cell that is in the bitset ``cells``, for a
        tour of n cells.

        The first cell is the cell that the robot searches first. The result is None if no cell of
        the arc is in the bitset.

        Examples
        --------
        >>> Arc(3, 4, -1).next_of(0b100101, 8)
        2
        """
        if self.step > 0:
            candidates = rotate_bits(cells, self.first, n) & ((1 << self.count) - 1)
            return (
                ((candidates & -candidates).bit_length() - 1 + self.first) % n
                if candidates
                else None
            )
        low = self.first - self.count + 1
        candidates = rotate_bits(cells, low, n) & ((1 << self.count) - 1)
        return (candidates.bit_length() - 1 + low) % n if candidates else None


def approach_cost(tour_cost: TourCost, first: int, place: Floats, start: int | None) -> float:
    """Return the straight distance, in cell sides, from the position ``place`` to the cell
    ``first``.

    If a cell ``start`` is given, the function also computes the length of the path around walls
    from ``start`` to ``first``. The result is the larger of this length and the straight distance.
    """
    straight = float(np.linalg.norm(tour_cost.points[first] - place))
    return (
        straight
        if start is None or start == first
        else max(straight, tour_cost.length(start, first))
    )


def work_time(
    tour_cost: TourCost, arcs: Sequence[Arc], place: Floats, start: int | None = None
) -> float:
    """Return the cost, in cells, of searching arcs one after another, for a robot at the position
    ``place``.

    The cost contains the path to the first arc, as computed by `approach_cost`.
    """
    total, n = 0.0, len(tour_cost)
    position: int | None = None
    for arc in arcs:
        first = arc.first % n
        total += (
            approach_cost(tour_cost, first, place, start)
            if position is None
            else tour_cost.move_cost(position, first)
        )
        total += tour_cost.search_cost(arc.first, arc.count, arc.step)
        position = (arc.first + arc.step * (arc.count - 1)) % n
    return total


def numbers_of(arcs: Sequence[Arc], n: int) -> NDArray[np.int64]:
    """Return the cells of arcs in the order of the search, as indices on a tour of n cells; int64,
    shape (k,).
    """
    pieces = [(arc.first + arc.step * np.arange(arc.count)) % n for arc in arcs]
    return np.concatenate([np.zeros(0, dtype=np.int64), *pieces])


Indices = NDArray[np.int64]
_HALVINGS = 40
_STRIDES = 96  # maximum number of first borders that are tried
# maximum number of trials: a cut of the tour into equal arcs, and a rotation of the robots
_TRIALS = 8_000
_EITHER = 200_000  # cells times robots: above this, the arcs are those of ``hop``
_CUTS = 24  # number of dear steps, and of equally distant cells, at which the first arc may begin
_LATER = 1.02  # time that may be lost for a border between rows
_WHOLE = 0.08  # the same if all borders are between rows, as a share of the cells of a robot
_PAIRS = 200_000  # pairs of rows times robots: above this, borders move one by one
_CANDIDATES = 12  # number of trials whose borders are improved


Allocator = Callable[[TourCost, Team], list[list[Arc]]]
ALLOCATORS: Registry[Allocator] = Registry("allocation", functions=True)
"""All rules, from the simplest to the one that is most often the fastest. Help and `auto` begin with
the last.
"""


@ALLOCATORS.register("stay")
def stay(tour_cost: TourCost, team: Team) -> list[list[Arc]]:
    """Assign to each robot the cells from its own start to the cell before the next
    robot's start.
    """
    gaps = np.diff(np.append(team.starts, team.starts[0] + len(tour_cost)))
    return [[Arc(int(first), int(count))] for first, count in zip(team.starts, gaps, strict=True)]


@ALLOCATORS.register("common-shift")
def common_shift(tour_cost: TourCost, team: Team) -> list[list[Arc]]:
    """Let each robot move at most a distance D along the tour, and then search at most G cells.

    The limits D and G are equal for all robots. The allocator minimizes D + G, and ignores that
    robots may differ in speed.
    """
    starts = team.starts
    n, m = len(tour_cost), len(starts)
    at = tour_cost.ahead[np.concatenate([starts, starts + n])]
    # the largest sum of k consecutive gaps
    largest_sums = np.array([(at[k : k + m] - at[:m]).max() for k in range(1, m)])
    share = tour_cost.whole / m
    counts = np.arange(1, m)

    def gap(shift: float) -> float:
        return (
            max(share, float(((largest_sums - 2 * shift) / counts).max()))
            if m > 1
            else tour_cost.whole
        )

    low, high = 0.0, tour_cost.whole
    for _ in range(100):  # D + G is convex in D
        lower_third, upper_third = low + (high - low) / 3, high - (high - low) / 3
        low, high = (
            (low, upper_third)
            if lower_third + gap(lower_third) <= upper_third + gap(upper_third)
            else (lower_third, high)
        )
    shift, span = low, gap(low)
    # The farthest borders that the limits allow: s + D, and G after the previous border.
    rounds = np.concatenate([at[:m] - tour_cost.whole, at]) + shift
    fronts = np.minimum.accumulate(rounds - span * np.arange(3 * m)) + span * np.arange(3 * m)
    borders = (
        np.searchsorted(tour_cost.ahead, fronts[m : 2 * m] + tour_cost.whole + 1e-6, side="right")
        - 1
    )
    return _arcs_between(np.append(borders, borders[0] + n))


@ALLOCATORS.register("individual-shift")
def individual_shift(tour_cost: TourCost, team: Team) -> list[list[Arc]]:
    """Let each robot move along the tour before it searches, by a distance chosen for this robot.

    The allocator minimizes the time until the last robot finishes.
    """
    return _arcs_between(_bisect(False, tour_cost, team))


@ALLOCATORS.register("two-way")
def two_way(tour_cost: TourCost, team: Team) -> list[list[Arc]]:
    """Let each robot search cells behind its start and cells ahead of its start, in whichever order
    is cheaper.
    """
    n = len(tour_cost)
    borders = _bisect(True, tour_cost, team)
    allocations = []
    for start, low, high in zip(team.starts + n, borders[:-1], borders[1:], strict=True):
        if not low <= start < high:
            allocations.append([Arc(int(low % n), int(high - low))])
            continue
        back = [
            Arc(int(start % n), int(start - low + 1), -1),
            Arc(int((start + 1) % n), int(high - start - 1)),
        ]
        forth = [
            Arc(int(start % n), int(high - start)),
            Arc(int((start - 1) % n), int(start - low), -1),
        ]
        place = tour_cost.points[start % n]
        allocations.append(
            min(
                back,
                forth,
                key=lambda work: work_time(tour_cost, [arc for arc in work if arc.count], place),
            )
        )
    return allocations


@ALLOCATORS.register("either-end")
def either_end(tour_cost: TourCost, team: Team) -> list[list[Arc]]:
    """Let each robot move straight to the nearer end of an arc of the tour, and search this arc
    towards the other end.

    A robot inside its arc searches backwards to one end, crosses to the other end, and searches
    back to its start, if both ends are nearer to each other than to the robot.

    The tour is cut where its steps are dear, so that no robot flies a long way back to the first
    row. Where turns cost something, all arcs are whole rows if that takes little longer; otherwise,
    each border moves to the nearest end of a row, as far as that takes at most 2 % longer. Along
    the tour, the robots' arcs have the same order as the robots' starts.
    """
    return _sections(tour_cost, team, home=False)


@ALLOCATORS.register("loop")
def loop(tour_cost: TourCost, team: Team) -> list[list[Arc]]:
    """Let each robot search an arc as `either_end` does, but balance the times until robots are
    back at their starts.
    """
    return _sections(tour_cost, team, home=True)


def _sections(tour_cost: TourCost, team: Team, *, home: bool) -> list[list[Arc]]:
    """Return the arcs that `either_end` and `loop` describe; ``home`` tells whether the path back
    counts.
    """
    n, m = len(tour_cost), len(team.starts)
    if n * m > _EITHER or m > n:
        return [
            _from_nearer_end(tour_cost, team, k, work, home=home)
            for k, work in enumerate(hop(tour_cost, team))
        ]
    far = (
        team.far
        if len(team.far)
        else np.linalg.norm(tour_cost.points[None] - team.places[:, None], axis=2)
    )
    powers = _powers(team)
    around = np.argsort(-tour_cost.costs, kind="stable")[:_CUTS]
    firsts = np.unique(np.concatenate([around, np.linspace(0, n - 1, _CUTS).astype(np.int64)]))
    candidates = []
    for first in firsts.tolist():
        levels = tour_cost.priced[first + 1 : first + n + 1] - tour_cost.priced[first + 1] + 1.0
        shares = levels[-1] * np.cumsum(powers) / powers.sum()
        ends = np.minimum(np.searchsorted(levels, shares - 1e-9), n - 1)
        begins = np.append(0, ends[:-1] + 1) % n
        low, high = (first + begins) % n, (first + ends) % n
        travel = far[:, low] + far[:, high] if home else np.minimum(far[:, low], far[:, high])
        across = np.linalg.norm(tour_cost.points[high] - tour_cost.points[low], axis=1)
        inside = (team.starts[:, None] - low) % n < (high - low) % n
        travel = np.where(inside, np.minimum(travel, across), travel) / team.rates[:, None]
        for turn in range(m):
            robots = (np.arange(m) + turn) % m
            latest = float(travel[robots, np.arange(m)].max() + levels[-1] / powers.sum())
            candidates.append((latest, first, turn))
    best, best_cut = np.inf, (np.arange(m + 1), 0)
    for latest, first, turn in sorted(candidates)[:_CANDIDATES]:
        low, high = n / float(powers.sum()) / 2, min(2 * latest, best)
        borders = _either_pass(tour_cost, team, far, high, first, turn, home)
        while borders is None and best == np.inf:
            high *= 2
            borders = _either_pass(tour_cost, team, far, high, first, turn, home)
        while borders is not None and high - low > 1e-3:
            middle = (low + high) / 2
            trial = _either_pass(tour_cost, team, far, middle, first, turn, home)
            low, high = (middle, high) if trial is None else (low, middle)
            borders = borders if trial is None else trial
        if borders is not None and high < best:
            best, best_cut = high, (borders, turn)
    borders, turn = best_cut
    whole = None
    if tour_cost.turn_cost + tour_cost.turn_price and m > 1:
        latest = best + _WHOLE * n / float(powers.sum())
        whole = _in_whole_rows(tour_cost, team, far, latest, home)
    if whole is None:
        borders = _between_rows(tour_cost, team, far, best * _LATER, borders, turn, home)
    else:
        borders, turn = whole
    arcs = _arcs_between(borders)
    return [
        _from_nearer_end(tour_cost, team, robot, arcs[(robot - turn) % m], home=home)
        for robot in range(m)
    ]


def _either_time(
    tour_cost: TourCost,
    team: Team,
    far: Floats,
    robot: int,
    first: int | Indices,
    ends: Indices,
    home: bool,
) -> Floats:
    """Return the times in which a robot searches the arcs from a cell to each of the given cells,
    beginning at the nearer end or, if that is sooner done, in the middle. Turns have their price.
    """
    n, levels, points = len(tour_cost), tour_cost.priced, tour_cost.points
    # a turn into the first cell, unless it is one of the tour, and one home
    turns = 1.0 + (tour_cost.turns[first % n] == 0)
    price = tour_cost.turn_cost + tour_cost.turn_price
    work = levels[ends + 1] - levels[first + 1] + 1.0 + price * turns
    work = work / team.gains[robot]
    to_first, to_last = far[robot, first % n], far[robot, ends % n]
    travel = to_first + to_last if home else np.minimum(to_first, to_last)
    inside = (int(team.starts[robot]) - first) % n < ends - first
    across = np.linalg.norm(points[ends % n] - points[first % n], axis=-1)
    travel = np.where(inside, np.minimum(travel, across), travel)
    return np.asarray((work + travel) / team.rates[robot])


def _either_pass(
    tour_cost: TourCost, team: Team, far: Floats, time: float, first: int, turn: int, home: bool
) -> Indices | None:
    """Return the borders of arcs that robots search within a time, or None if they cannot. Robot
    ``turn`` has the arc that begins with the cell ``first``.
    """
    n, m = len(tour_cost), len(team.starts)
    borders = np.full(m + 1, first + n)
    begin = first
    for k in range(m):
        borders[k] = begin
        robot = (k + turn) % m
        # arcs that take longer without the way to them
        work = (1 + 1e-9) * (time + 1e-9) * float(team.rates[robot] * team.gains[robot])
        after = int(np.searchsorted(tour_cost.priced, tour_cost.priced[begin + 1] + work, "right"))
        ends = np.arange(begin, min(after + 1, first + n))
        times = _either_time(tour_cost, team, far, robot, begin, ends, home)
        within = np.flatnonzero(times <= time + 1e-9)
        if len(within):
            begin = int(ends[within[-1]]) + 1
        if begin >= first + n:
            return borders
    return None


def _in_whole_rows(
    tour_cost: TourCost, team: Team, far: Floats, latest: float, home: bool
) -> tuple[Indices, int] | None:
    """Return the borders of arcs of whole rows that robots search within the shortest time, and the
    robot of the first arc, or None if that takes longer than ``latest``.
    """
    n, m = len(tour_cost), len(team.starts)
    turning = tour_cost.turns > 0
    begins = np.flatnonzero(np.roll(turning, 1) & turning)
    rows = len(begins)
    if rows < m or rows * rows * m > _PAIRS:
        return None
    numbers = np.arange(rows)
    around = np.concatenate([begins, begins + n, begins + 2 * n])
    # for each robot, the time for 1 to all rows behind the begin of each row
    lasts = around[numbers[:, None] + 1 + numbers] - 1
    times = np.array(
        [
            _either_time(tour_cost, team, far, robot, begins[:, None], lasts, home)
            for robot in range(m)
        ]
    )
    robots = (np.arange(m)[:, None] + np.arange(m)) % m  # of each arc, by that of the first one
    found, low, time = None, float(times.min()), latest
    while found is None or latest - low > 1e-3:
        counts = np.where(times <= time, numbers + 1, 0).max(axis=2)
        done = np.zeros((m + 1, m, rows), dtype=np.int64)  # rows, by the first robot and row
        for k in range(m):
            counted = counts[robots[:, k, None], (numbers + done[k]) % rows]
            done[k + 1] = np.minimum(done[k] + counted, rows)
        complete = np.argwhere(done[m] == rows)
        if len(complete):
            turn, first = complete[0].tolist()
            found, latest = (around[first + done[:, turn, first]], turn), time
        elif found is None:
            return None
        else:
            low = time
        time = (low + latest) / 2
    return found


def _between_rows(
    tour_cost: TourCost,
    team: Team,
    far: Floats,
    time: float,
    borders: Indices,
    turn: int,
    home: bool,
) -> Indices:
    """Return borders moved to the nearest ends of rows, as far as no robot then needs longer than
    ``time``.
    """
    m = len(team.starts)
    turning = np.concatenate([tour_cost.turns] * 3) > 0
    # the tour turns in the last cell of a row, or on the way from it, and in the first of the next
    ends = np.flatnonzero(turning[:-1] & turning[1:]) + 1
    moved = borders.copy()
    for k in range(1, m):
        if not len(ends) or not borders[k - 1] < borders[k] < borders[k + 1]:
            continue
        border = int(ends[np.argmin(np.abs(ends - borders[k]))])
        if not moved[k - 1] < border < moved[k + 1]:
            continue
        parts = ((k - 1, int(moved[k - 1]), border), (k, border, int(moved[k + 1])))
        if all(
            _either_time(tour_cost, team, far, (part + turn) % m, low, np.array([high - 1]), home)[
                0
            ]
            <= time
            for part, low, high in parts
        ):
            moved[k] = border
    return moved


def _from_nearer_end(
    tour_cost: TourCost, team: Team, robot: int, work: list[Arc], *, home: bool
) -> list[Arc]:
    """Return the arcs of a robot that searches an arc as `either_end` describes."""
    n, (arc,) = len(tour_cost), work
    if not arc.count:
        return work
    first, last, start = arc.first % n, (arc.first + arc.count - 1) % n, int(team.starts[robot])
    distances = [
        float(team.far[robot, cell])
        if len(team.far)
        else float(np.linalg.norm(tour_cost.points[cell] - team.places[robot]))
        for cell in (first, last)
    ]
    behind = (start - first) % n
    direct = sum(distances) if home else min(distances)
    if behind < arc.count - 1 and tour_cost.between(first, last) < direct:
        return [Arc(start, behind + 1, -1), Arc(last, arc.count - 1 - behind, -1)]
    return [Arc(last, arc.count, -1)] if distances[1] < distances[0] else work


@ALLOCATORS.register("hop")
def hop(tour_cost: TourCost, team: Team) -> list[list[Arc]]:
    """Let each robot move straight to an arc of the tour, and search this arc.

    A robot that is far from its arc gets a shorter arc. Along the tour, the robots' arcs have the
    same order as the robots' starts.
    """
    n, m = len(tour_cost), len(team.starts)
    rows = min(4 * _STRIDES, max(8, _TRIALS // m))
    firsts = (
        np.unique(np.linspace(0, min(n, int(2 * n / m)) - 1, rows).astype(np.int64))
        if m > 1
        else team.starts
    )
    latest = np.empty((len(firsts), m))
    shares.hop_costs(tour_cost.arrays, team, firsts, latest)
    best, borders, chosen = np.inf, np.arange(m + 1), 0
    for number in np.argsort(latest, axis=None, kind="stable")[:_CANDIDATES]:
        row, turn = np.unravel_index(int(number), latest.shape)
        low, high = n / float(_powers(team).sum()), float(min(latest[row, turn], best)) + 1.0
        trial = np.empty(m + 1, dtype=np.int64)
        while best == np.inf:  # with fewer cells than robots, an equal arc is shorter than a cell
            if shares.hop_pass(tour_cost.arrays, team, high, firsts[row], turn, trial):
                best, borders, chosen = high, np.minimum(trial, firsts[row] + n), int(turn)
            high *= 2
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            feasible = shares.hop_pass(tour_cost.arrays, team, middle, firsts[row], turn, trial)
            if feasible and middle < best:
                best, borders, chosen = middle, np.minimum(trial, firsts[row] + n), int(turn)
            low, high = (low, middle) if feasible else (middle, high)
            if high - low < 1e-3:
                break
    arcs = _arcs_between(borders)
    return [arcs[(robot - chosen) % m] for robot in range(m)]


def _arcs_between(borders: Indices) -> list[list[Arc]]:
    n = int(borders[-1] - borders[0])
    return [[Arc(int(low % n), int(high - low))] for low, high in pairwise(borders)]


def _powers(team: Team) -> Floats:
    """Return the search rate of each robot: its speed times the gain from its footprint width."""
    return team.rates * team.gains


def _is_feasible(
    two_ways: bool, tour_cost: TourCost, team: Team, time: float, borders: Indices
) -> bool:
    reach = min(len(tour_cost), int(time * _powers(team)[0]) + 1)
    return bool(
        shares.best_start(
            two_ways, tour_cost.arrays, team, time, max(1, reach // _STRIDES), borders
        )
    )


def _bisect(two_ways: bool, tour_cost: TourCost, team: Team) -> Indices:
    """Return the first cell of each robot's part, followed by the end of the last part; int64,
    shape (m + 1,).

    The parts minimize the time until the last robot finishes, which the function finds by
    bisection. The numbers of cells continue beyond N - 1 after each round of the tour.
    """
    n, starts = len(tour_cost), team.starts
    best = np.append(starts, starts[0] + n) + n  # the borders that the allocator ``stay`` chooses
    gaps = np.diff(tour_cost.priced[best]) / _powers(team)
    low, high = n / float(_powers(team).sum()), float(gaps.max())
    trial = np.empty(len(starts) + 1, dtype=np.int64)
    for _ in range(_HALVINGS):
        if high - low < 1e-3:
            break
        middle = (low + high) / 2
        if _is_feasible(two_ways, tour_cost, team, middle, trial):
            best, high = np.minimum(trial, trial[0] + n), middle
        else:
            low = middle
    return best


@dataclass(frozen=True, eq=False)
class Allocation:
    """The part of a tour that each robot searches, and the time at which each robot finishes.

    Parameters
    ----------
    allocator : str
        Name of the allocator that divided the tour.
    arcs : tuple of tuple of Arc
        Arcs of the tour for each robot, in the order in which the robot searches them. A robot may
        have no arcs.
    times : ndarray of float64, shape (m,)
        Completion time of each robot, including its path to its first cell. The unit of time is the
        time in which a robot of speed 1 searches one cell.
    work : tuple of tuple of Arc
        All arcs that each robot searches, in the order of the search. If several robots must search
        each cell, a robot first searches its own arcs. Then the robot searches the arcs of the next
        robots along the tour.
    """

    allocator: str
    arcs: tuple[tuple[Arc, ...], ...]
    times: Floats
    work: tuple[tuple[Arc, ...], ...]

    @property
    def makespan(self) -> float:
        """Time at which the last robot finishes."""
        return float(self.times.max())


def allocate(
    tour_cost: TourCost,
    starts: ArrayLike,
    *,
    allocator: str = "hop",
    rates: ArrayLike | None = None,
    places: ArrayLike | None = None,
    widths: ArrayLike | None = None,
    plain_arcs: Sequence[Sequence[Arc]] | None = None,
) -> Allocation:
    """Divide the cells of a tour among robots.

    Parameters
    ----------
    tour_cost : TourCost
    starts : array_like of int, shape (m,)
        Tour index of each robot's start cell, for at least one robot. Several robots may start in
        the same cell.
    allocator : str
        "stay": each robot searches the cells from its start to the next robot's start (paper H).
        "common-shift": each robot first moves along the tour, and the upper limit of the distance
        is equal for all robots. "individual-shift": each robot first moves along the tour, by a
        distance chosen for this robot. "two-way": each robot searches cells behind its start and
        cells ahead of its start. "hop": each robot moves straight to the first cell of its arc. A
        text of the form ``module:attribute`` names a function with the same arguments as the
        functions in `shoal.search.allocation.allocate`.
    rates : array_like of float, shape (m,), optional
        Speed of each robot, for motion and search alike. By default, all robots have the speed 1.
    places : array_like of float, shape (m, d), optional
        Positions of the robots in cell sides, as in `TourCost.points`. By default, each robot is at
        the viewpoint of its start cell.
    widths : array_like of int, shape (m,), optional
        Footprint width of each robot, as an odd number of cells. By default, all footprints are one
        cell wide. A robot with a wide footprint gets about `gain_of` times as many cells as an
        equally fast robot with a footprint of one cell.
    plain_arcs : sequence of sequence of Arc, optional
        The arcs of each robot by this allocator without `TourCost.odds`, if they are known.

    Raises
    ------
    InvalidInputError
    UnknownNameError

    Notes
    -----
    The allocator "stay" follows page 5 of paper H. All allocators except "stay" answer an open
    question of paper H: how much time does "slightly more initial configuration movement" save?

    Examples
    --------
    >>> from shoal.search import make_tour
    >>> tour_cost = TourCost(make_tour("moore", (8, 8)))
    >>> allocate(tour_cost, [0, 1, 2, 3], allocator="stay").makespan
    61.0
    >>> allocate(tour_cost, [0, 1, 2, 3], allocator="hop").makespan < 24
    True
    """
    team, order = _team(tour_cost, starts, rates, places, widths)
    arcs = _allot(tour_cost, allocator, team, order, plain_arcs)
    back = np.argsort(order)
    speeds, at, numbers = team.rates[back], team.places[back], team.starts[back]
    wide = np.ones(len(back), dtype=np.int64) if widths is None else np.asarray(widths)
    times = np.array(
        [
            time_of(tour_cost, work, place, int(start) if len(team.far) else None, int(width))
            for work, place, start, width in zip(arcs, at, numbers, wide, strict=True)
        ]
    )
    return Allocation(allocator, arcs, times / speeds, arcs)


def arcs_of(
    tour_cost: TourCost, allocator: str, starts: ArrayLike, rates: ArrayLike, widths: ArrayLike
) -> tuple[tuple[Arc, ...], ...]:
    """Return the arcs that `allocate` assigns to each robot, without computing completion times."""
    return _allot(tour_cost, allocator, *_team(tour_cost, starts, rates, None, widths))


def _allot(
    tour_cost: TourCost,
    allocator: str,
    team: Team,
    order: Indices,
    plain_arcs: Sequence[Sequence[Arc]] | None = None,
) -> tuple[tuple[Arc, ...], ...]:
    share = configured(ALLOCATORS, allocator)
    arcs: list[tuple[Arc, ...]] = [()] * len(order)
    try:
        works = (
            share(tour_cost, team) if plain_arcs is None else [plain_arcs[robot] for robot in order]
        )
        shared = [[arc for arc in work if arc.count > 0] for work in works]
        if tour_cost.odds is not None and tour_cost.at_most:
            shared = _likely_first(tour_cost, team, shared)
        for robot, work in zip(order, shared, strict=True):
            arcs[robot] = tuple(work)
    except (Exception, SystemExit) as error:
        if ":" not in allocator:
            raise
        reason = f"{type(error).__name__}: {shortened(str(error))}"
        raise InvalidInputError(
            f"allocation {allocator}: expected arcs for each of {len(order)} robots, got {reason}"
        ) from error
    return tuple(arcs)


def _likely_first(tour_cost: TourCost, team: Team, shared: list[list[Arc]]) -> list[list[Arc]]:
    """Return the work of all robots in an order in which they search likely cells early.

    The longest time of a robot may become `TourCost.at_most` times as long.
    """
    key = (
        *(array.tobytes() for array in (team.starts, team.rates, team.places, team.gains)),
        tuple(map(tuple, shared)),
    )
    if key in tour_cost.orders:
        return list(tour_cost.orders[key])
    ready = max(
        work_time(tour_cost, work, place, int(start) if len(team.far) else None) / power
        for work, place, start, power in zip(
            shared, team.places, team.starts, _powers(team), strict=True
        )
    )
    ordered = likely_first(
        tour_cost,
        team,
        [[(arc.first, arc.count, arc.step) for arc in work] for work in shared],
        tour_cost.at_most * ready * team.rates,
    )
    tour_cost.orders[key] = [[Arc(*run) for run in runs] for runs in ordered]
    return list(tour_cost.orders[key])


def _team(
    tour_cost: TourCost,
    starts: ArrayLike,
    rates: ArrayLike | None,
    places: ArrayLike | None,
    widths: ArrayLike | None,
) -> tuple[Team, Indices]:
    """Check the robots. Return the robots in the order of their start cells, and the given index of
    each of these robots.
    """
    n = len(check_kind(tour_cost, TourCost, what="tour_cost"))
    expected = f"starts: expected one or more numbers of cells from 0 to {n - 1}"
    first = check_array(starts, expected=expected)
    if (
        first.ndim != 1
        or not len(first)
        or first.dtype.kind not in "iu"
        or (first < 0).any()
        or (first >= n).any()
    ):
        raise InvalidInputError(f"{expected}, got {first.tolist()!r:.200}")
    first = first.astype(np.int64)
    expected = f"rates: expected {len(first)} speeds above 0"
    speeds = (
        np.ones(len(first))
        if rates is None
        else check_array(rates, expected=expected).astype(np.float64)
    )
    if speeds.shape != first.shape or not (np.isfinite(speeds) & (speeds > 0)).all():
        raise InvalidInputError(f"{expected}, got {speeds.tolist()!r:.200}")
    at = tour_cost.points[first]
    if places is not None:
        at = check_points(places, what="places", dimensions=at.shape[1], count=len(first))
    wide = (
        np.ones(len(first), dtype=np.int64)
        if widths is None
        else check_array(widths, expected=f"widths: expected {len(first)} whole numbers")
    )
    check_widths(wide, len(first))
    # if several robots start in a cell, ``stay`` gives cells only to the last one
    order = np.argsort(first, kind="stable")
    gains = np.array([gain_of(tour_cost, int(width)) for width in wide])
    return (
        Team(first[order], speeds[order], at[order], gains[order], tour_cost.far(first[order])),
        order,
    )


def time_of(
    tour_cost: TourCost, work: Sequence[Arc], place: Floats, start: int | None, width: int
) -> float:
    """Return the cost, in cells, of the path to the first arc and of the search of all arcs, with a
    footprint of ``width`` cells.

    The arguments ``place`` and ``start`` have the same meaning as in `approach_cost`.
    """
    if width == 1 or not work:
        return work_time(tour_cost, work, place, start)
    cells = numbers_of(work, len(tour_cost))
    stops, cost = select_viewpoints(tour_cost, width, cells)
    return cost + approach_cost(tour_cost, int(stops[0]), place, start)


@dataclass(frozen=True, slots=True)
class Part:
    """The part of a tour that one robot searches: its arcs, and the bitset of the cells in these
    arcs.

    The attribute ``first`` is the first cell of the part along the tour. If a robot has no arcs,
    ``first`` is its start cell.
    """

    robot: int
    first: int
    arcs: tuple[Arc, ...]
    bits: int


@lru_cache(maxsize=256)
def partition(
    tour_cost: TourCost, allocator: str, robots: tuple[tuple[int, int, float, int], ...]
) -> tuple[Part, ...]:
    """Return the parts of all robots, sorted by the first cell of each part on the tour.

    Parameters
    ----------
    tour_cost : TourCost
    allocator : str
        Name of the allocator, as in `allocate`.
    robots : tuple of (number, start, rate, width)
        The robots, sorted by number so that all robots compute equal partitions. The start is the
        tour index of a robot's start cell, the rate is the robot's speed, and the width is the
        width of the robot's footprint in cells.
    """
    n = len(tour_cost)
    _, starts, rates, widths = zip(*robots, strict=True)
    parts = []
    for (number, start, *_), arcs in zip(
        robots, arcs_of(tour_cost, allocator, starts, rates, widths), strict=True
    ):
        bits, lows = 0, []
        for arc in arcs:
            bits |= arc.bits(n)
        # Two arcs of a robot meet at its start. The part begins with the run of cells that no other
        # cell of the part precedes.
        lows = [first for first, _ in runs(bits, start, n) if not bits >> ((first - 1) % n) & 1]
        first = lows[0] if lows else start
        parts.append((first, bool(bits), number, Part(number, first, arcs, bits)))
    return tuple(part for *_, part in sorted(parts, key=lambda entry: entry[:3]))


def in_passes(
    tour_cost: TourCost,
    allocation: Allocation,
    robots: tuple[tuple[int, int, float, int], ...],
    places: Floats,
    count: int,
) -> Allocation:
    """Return an allocation in which ``count`` different robots search each cell.

    After its own part, each robot also searches the parts of the next ``count`` - 1 robots along
    the tour.

    Parameters
    ----------
    tour_cost : TourCost
    allocation : Allocation
        The allocation in which one robot searches each cell.
    robots : tuple of (number, start, rate, width)
        The robots as in `partition`, numbered from 1.
    places : ndarray of float64, shape (m, d)
        Positions of the robots in cell sides, as in `TourCost.points`.
    count : int
        Number of different robots that search each cell.
    """
    parts = partition(tour_cost, allocation.allocator, robots)
    work = {
        part.robot: tuple(arc for k in range(count) for arc in (parts[k:] + parts[:k])[index].arcs)
        for index, part in enumerate(parts)
    }
    times = [
        time_of(tour_cost, work[number], place, start, width) / rate
        for (number, start, rate, width), place in zip(robots, places, strict=True)
    ]
    return replace(
        allocation,
        times=np.array(times),
        work=tuple(work[number] for number, *_ in robots),
    )


def cost_of_all(
    tour_cost: TourCost, cells: int, position: int, fresh: bool, closed: int = 0
) -> float:
    """Return the cost, in cells, of searching all cells of the bitset ``cells`` in tour order,
    starting from the cell ``position``.

    The parameters ``fresh`` and ``closed`` have the same meaning as in `TourCost.move_cost`.
    """
    total, n = 0.0, len(tour_cost)
    for first, count in runs(cells, position, n):
        total += tour_cost.move_cost(position, first, fresh=fresh, closed=closed)
        total += tour_cost.search_cost(first, count)
        position, fresh = (first + count - 1) % n, False
    return total
