"""The scan schedule with the smallest competitive ratio, for given prices of scans and moves and a maximum wall distance."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from functools import cached_property
from math import lcm

from shoal.core.errors import InvalidInputError
from shoal.swarm.theory.scan_schedules.schedules import (
    Cost,
    Custom,
    EqualSteps,
    Price,
    ScanSchedule,
    Worst,
    check_distance,
    check_prices,
)

MAX_SCANS = 20_000
"""Maximum number of scan positions in an optimal schedule, except a schedule with equal steps."""

_PRECISION = 64  # bits of the bisection, after which the final steps are exact
_LAST_STEPS = 50


class OptimalSchedule(ScanSchedule):
    """The scan schedule with the smallest competitive ratio, as computed by the function `optimal_schedule`.

    Parameters
    ----------
    schedule : ScanSchedule
    scan_cost, move_cost : Fraction
    max_distance : int
    """

    name = "optimal"

    def __init__(self, schedule: ScanSchedule, *, scan_cost: Fraction, move_cost: Fraction, max_distance: int) -> None:
        self.scan_cost, self.move_cost, self.max_distance = scan_cost, move_cost, max_distance
        self.schedule = schedule

    def positions(self) -> Iterator[int]:
        """Yield the scan positions of the schedule, up to the first position beyond the maximum distance of the wall."""
        for position in self.schedule.positions():
            yield min(position, self.max_distance + 1)
            if position > self.max_distance:
                return

    def cost(self, distance: int) -> Cost:
        """Return the number of moves and scans until the schedule detects a wall at the given distance."""
        check_distance(distance)
        if distance > self.max_distance:
            raise InvalidInputError(f"schedule optimal: expected a distance up to {self.max_distance}, got {distance}")
        cost = self.schedule.cost(distance)
        return Cost(distance, min(cost.moves, self.max_distance + 1), cost.scans)

    @cached_property
    def guarantee(self) -> Worst:
        """The largest ratio of the schedule's price to the optimal price, and the wall distance at which the ratio is largest."""
        return self.worst(scan_cost=self.scan_cost, move_cost=self.move_cost, max_distance=self.max_distance)

    def worst(self, *, scan_cost: Price, move_cost: Price, max_distance: int) -> Worst:
        """Return the largest ratio of the schedule's price to the optimal price, over all distances from 0 to ``max_distance``."""
        if isinstance(self.schedule, EqualSteps):
            return self.schedule.worst(scan_cost=scan_cost, move_cost=move_cost, max_distance=max_distance)
        return super().worst(scan_cost=scan_cost, move_cost=move_cost, max_distance=max_distance)


def optimal_schedule(*, scan_cost: Price, move_cost: Price, max_distance: int) -> OptimalSchedule:
    """Return the scan schedule with the smallest competitive ratio, for walls at distances from 0 to ``max_distance`` moves.

    The competitive ratio of a schedule is the largest ratio of the schedule's price to the optimal price, over all wall distances.
    Let c be the price of a scan, v the price of a move, x_1, x_2, ... the scan positions of a schedule, and x_0 = 0. The schedule
    has a competitive ratio of at most r if every x_j is at most ``(r (v (x_(j-1) + 1) + 2c) - c (j + 1)) / v``. A later scan allows
    later positions for all following scans. A competitive ratio r is therefore possible if and only if the schedule with the latest
    allowed scans reaches the maximum distance. A bisection finds an interval that contains the smallest possible competitive ratio.
    Inside the interval, the function computes schedules with smaller and smaller ratios in exact fractions, until no schedule has a
    smaller ratio.

    Parameters
    ----------
    scan_cost, move_cost : number
        Prices of a scan and of a move, in the same unit, at least 0. At least one price must exceed 0. A price given as a float
        counts as its printed decimal value.
    max_distance : int
        Maximum distance of the wall, in moves.

    Returns
    -------
    OptimalSchedule
        The schedule is optimal if at most `MAX_SCANS` positions are enough, and if the distance and the prices have up to nine
        digits. If more than `MAX_SCANS` positions or more than nine digits are necessary, the function returns the better one
        of two schedules: the best schedule with equal steps, and the best schedule with at most `MAX_SCANS` positions, whose ratio
        is optimal to 19 digits.

    Raises
    ------
    InvalidInputError
        Raised if a price or the maximum distance is out of range.

    Notes
    -----
    The computation extends section III.A.3 of paper M, which assumes unknown prices of scans and moves. If a scan costs 10 times as
    much as a move, the best schedule has equal steps of 15 moves, unless the maximum distance is small.

    Examples
    --------
    >>> best = optimal_schedule(scan_cost=10, move_cost=1, max_distance=100)
    >>> list(best.positions())
    [15, 30, 45, 60, 75, 90, 101]
    >>> best.guarantee
    Worst(ratio=Fraction(5, 3), distance=0)
    """
    scan, move = check_prices(scan_cost, move_cost)
    max_distance = check_distance(max_distance)
    candidates: list[ScanSchedule] = [_best_equal_steps(scan, move, max_distance)]
    if scan and move:
        candidates.insert(0, Custom(least_worst(scan, move, max_distance, MAX_SCANS)))
    made = [OptimalSchedule(one, scan_cost=scan, move_cost=move, max_distance=max_distance) for one in candidates]
    return min(made, key=lambda schedule: schedule.guarantee.ratio)


def _best_equal_steps(scan: Fraction, move: Fraction, max_distance: int) -> EqualSteps:
    """Return the schedule of equal steps with the smallest competitive ratio.

    The competitive ratio is the larger one of two ratios of the schedule's price to the optimal price. The ratio for a wall at the
    start grows with the length of the steps. The ratio for a wall near the maximum distance falls with the length of the steps.
    """

    def too_short(step: int) -> bool:
        worst = EqualSteps(step).worst(scan_cost=scan, move_cost=move, max_distance=max_distance)
        return worst.distance > 0

    low, high = 1, max_distance + 1
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if too_short(middle) else (low, middle)
    steps = [EqualSteps(step) for step in (low - 1, low) if step > 0]
    return min(steps, key=lambda one: one.worst(scan_cost=scan, move_cost=move, max_distance=max_distance).ratio)


def least_worst(scan: Fraction, move: Fraction, max_distance: int, max_scans: int) -> list[int]:
    """Return up to ``max_scans`` scan positions with the smallest competitive ratio. The price of a move must exceed 0."""
    unit = lcm(scan.denominator, move.denominator)
    latest = _Latest(int(scan * unit), int(move * unit), max_distance, max_scans)
    low, high = Fraction(1), Fraction(2)
    best = latest(low) or latest(high)
    while best is None:
        low, high = high, 2 * high
        best = latest(high)
    high = latest.ratio(best)
    while high - low > high / 2**_PRECISION:
        middle = (low + high) / 2
        middle = Fraction((middle.numerator << 2 * _PRECISION) // middle.denominator, 1 << 2 * _PRECISION)
        found = latest(middle)
        if found is None:
            low = middle
        else:
            best, high = found, latest.ratio(found)
    for _ in range(_LAST_STEPS):  # enough whenever the limit on scans has no effect
        better = latest(high, below=True)
        if better is None:
            break
        best, high = better, latest.ratio(better)
    return best


class _Latest:
    """Computes the schedule with the latest scans that a competitive ratio allows, for integer prices of a scan and a move."""

    def __init__(self, scan: int, move: int, max_distance: int, max_scans: int) -> None:
        self.scan, self.move, self.end, self.max_scans = scan, move, max_distance + 1, max_scans

    def __call__(self, ratio: Fraction, *, below: bool = False) -> list[int] | None:
        """Return scan positions with a competitive ratio of at most ``ratio``, or None if no such positions exist.

        If ``below`` is true, the competitive ratio of the scan positions must be smaller than ``ratio``.
        """
        p, q, scan, move = ratio.numerator, ratio.denominator, self.scan, self.move
        positions: list[int] = []
        last = 0
        while last < self.end:
            spent = scan * (len(positions) + 2)
            allowed = p * (move * (last + 1) + 2 * scan) - q * spent - (1 if below else 0)
            position = min(allowed // (q * move), self.end)
            if position <= last or len(positions) == self.max_scans:
                return None
            positions.append(position)
            last = position
        return positions

    def ratio(self, positions: list[int]) -> Fraction:
        """Return the competitive ratio of scan positions that reach the maximum distance."""
        best, below = (0, 1), 0
        for scans, position in enumerate(positions, start=2):
            over, under = self.scan * scans + self.move * position, self.move * (below + 1) + 2 * self.scan
            if over * best[1] > best[0] * under:
                best = (over, under)
            below = position
        return Fraction(*best)
