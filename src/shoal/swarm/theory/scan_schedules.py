"""Scan schedules for the search for a wall at an unknown distance, with exact costs. Source: paper
M, section III.A.3.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from decimal import Decimal
from fractions import Fraction
from functools import cached_property
from itertools import count
from math import lcm

from shoal.core.checks import check_integer
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError

__all__ = [
    "Bracket",
    "Cost",
    "Custom",
    "EqualSteps",
    "EveryStep",
    "Hyperexponential",
    "OneJump",
    "OptimalSchedule",
    "Powers",
    "ScanSchedule",
    "Worst",
    "check_prices",
    "least_simultaneous_ratio",
    "optimal_schedule",
    "worst_of_both",
]


_LONGEST_PRICE = 300
# exponents are small, because they are multiplied out
_PRICE = re.compile(r"[+-]?(\d+/\d+|(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,2})?)", re.ASCII)

Price = int | float | str | Decimal | Fraction


@dataclass(frozen=True)
class Cost:
    """The numbers of moves and scans until a schedule detects the wall, as exact integers.

    Parameters
    ----------
    distance : int
        Distance D of the wall, in moves.
    moves : int
    scans : int
        Number of scans, including the scan at the start.
    """

    distance: int
    moves: int
    scans: int

    @property
    def move_ratio(self) -> Fraction:
        """Number of moves divided by the optimum D + 1, for a wall at distance D."""
        return Fraction(self.moves, self.distance + 1)

    @property
    def scan_ratio(self) -> Fraction:
        """Number of scans divided by the optimum of 2 scans."""
        return Fraction(self.scans, 2)

    def weighted_ratio(self, *, scan_cost: Price, move_cost: Price) -> Fraction:
        """Return the price of all moves and scans, divided by the price of the optimum: D + 1 moves
        and 2 scans for distance D.

        Raises
        ------
        InvalidInputError
            Raised if a price is negative or not finite, or if the prices of moves and scans are
            both zero.
        """
        scan, move = check_prices(scan_cost, move_cost)
        return (scan * self.scans + move * self.moves) / (2 * scan + move * (self.distance + 1))


@dataclass(frozen=True)
class Worst:
    """The worst case of a scan schedule over all distances of the wall up to a limit.

    Parameters
    ----------
    ratio : Fraction
        The largest ratio of the schedule's price to the optimal price, over all distances of the
        wall.
    distance : int
        The smallest distance of the wall at which the ratio is largest, in moves.
    """

    ratio: Fraction
    distance: int


class ScanSchedule(ABC):
    """An increasing sequence of scan positions, in moves from the start.

    Every subclass defines the attribute ``name`` and the method `positions`.
    """

    name: str

    @abstractmethod
    def positions(self) -> Iterator[int]:
        """Yield the number of moves from the start to each scan, in increasing order, without the
        scan at the start.
        """

    def cost(self, distance: int) -> Cost:
        """Return the number of moves and scans until the schedule detects a wall at the given
        distance.

        Parameters
        ----------
        distance : int
            Distance of the wall, in moves. The distance may have any size, because Python integers
            are exact.

        Raises
        ------
        InvalidInputError
            Raised if the distance is negative, or if the schedule ends before the distance.
        """
        distance, last = check_distance(distance), 0
        for scans, last in enumerate(self.positions(), start=2):
            if last > distance:
                return Cost(distance, last, scans)
        raise InvalidInputError(
            f"schedule {self.name}: expected a distance below its last position, {last}, got"
            f" {distance}"
        )

    def worst(self, *, scan_cost: Price, move_cost: Price, max_distance: int) -> Worst:
        """Return the largest ratio of the schedule's price to the optimal price, over all distances
        from 0 to ``max_distance``.

        Between two scan positions, the cost of the schedule is constant, but the cost of the
        optimum grows with the distance. The method therefore checks only the smallest distance
        after each scan position.

        Raises
        ------
        InvalidInputError
            Raised if a price or the maximum distance is out of range, or if the schedule ends
            before the maximum distance.
        """
        scan, move = check_prices(scan_cost, move_cost)
        check_distance(max_distance)
        worst, before = Worst(Fraction(0), 0), 0
        for scans, position in enumerate(self.positions(), start=2):
            ratio = (scan * scans + move * position) / (2 * scan + move * (before + 1))
            if ratio > worst.ratio:
                worst = Worst(ratio, before)
            if position > max_distance:
                return worst
            before = position
        raise InvalidInputError(
            f"schedule {self.name}: expected a distance below its last position, {before}, got"
            f" {max_distance}"
        )

    def __repr__(self) -> str:
        return f"<Schedule {self.name}>"


class EqualSteps(ScanSchedule):
    """The schedule with a scan after every k moves.

    Parameters
    ----------
    step : int
        Number k of moves between two scans, at least 1.

    Raises
    ------
    InvalidInputError
        Raised if the number of moves between two scans is less than 1.

    Examples
    --------
    >>> EqualSteps(15).cost(100)
    Cost(distance=100, moves=105, scans=8)
    """

    def __init__(self, step: int) -> None:
        self.step = check_integer(step, what="step", least=1)
        self.name = f"every {step} steps"

    def positions(self) -> Iterator[int]:
        """Yield the scan positions k, 2k, 3k, ..., in moves from the start."""
        return count(self.step, self.step)

    def cost(self, distance: int) -> Cost:
        """Return the number of moves and scans until the schedule detects a wall at the given
        distance.
        """
        jumps = check_distance(distance) // self.step + 1
        return Cost(distance, jumps * self.step, jumps + 1)

    def worst(self, *, scan_cost: Price, move_cost: Price, max_distance: int) -> Worst:
        """Return the largest ratio of the schedule's price to the optimal price, over all distances
        from 0 to ``max_distance``.

        The largest ratio occurs for a wall at the distance 0, or at the last scan position up to
        the maximum distance.
        """
        check_distance(max_distance)
        ends = (0, max_distance // self.step * self.step)
        ratios = [
            self.cost(end).weighted_ratio(scan_cost=scan_cost, move_cost=move_cost) for end in ends
        ]
        return Worst(ratios[0], 0) if ratios[0] >= ratios[1] else Worst(ratios[1], ends[1])


class EveryStep(EqualSteps):
    """The schedule with a scan after each move. The schedule detects a wall at distance D with D +
    1 moves and D + 2 scans.

    Examples
    --------
    >>> EveryStep().cost(10**100) == Cost(10**100, 10**100 + 1, 10**100 + 2)
    True
    """

    def __init__(self) -> None:
        super().__init__(1)
        self.name = "every step"


class Powers(ScanSchedule):
    """The schedule with scans after 1, k, k^2, ... moves.

    The schedule detects a wall at distance D > 0 with at most k D moves and about log D / log k
    scans.

    Parameters
    ----------
    base : int
        Base k of the powers, at least 2. With the base 2, each scan position is twice the previous
        scan position.

    Raises
    ------
    InvalidInputError
        Raised if the base is less than 2.

    Notes
    -----
    Source: paper M, section III.A.3. For a wall at distance D, paper M counts log_k D scans of the
    schedule with powers of k. With the scan at the start and the scan after the first move, the
    schedule with powers of k needs up to ceil(log_k(D + 1)) + 2 scans.

    Examples
    --------
    >>> cost = Powers(2).cost(1000)
    >>> cost.moves, cost.scans
    (1024, 12)
    """

    def __init__(self, base: int = 2) -> None:
        self.base = check_integer(base, what="base", least=2)
        self.name = f"powers of {base}"

    def positions(self) -> Iterator[int]:
        """Yield the scan positions 1, k, k^2, ..., in moves from the start."""
        position = 1
        while True:
            yield position
            position *= self.base


class Hyperexponential(ScanSchedule):
    """The schedule with the i-th scan after i^i moves: after 1, 4, 27, 256, ... moves.

    For a wall at distance D, the number of moves divided by its optimum, and the number of scans
    divided by its optimum, both grow as log D / log log D. No schedule exists for which both ratios
    grow more slowly.

    Notes
    -----
    Source: paper M, theorem 1.

    Examples
    --------
    >>> cost = Hyperexponential().cost(10**6)
    >>> cost.moves, cost.scans
    (16777216, 9)
    """

    name = "i^i"

    def positions(self) -> Iterator[int]:
        """Yield the scan positions 1, 4, 27, 256, ..., in moves from the start."""
        return (i**i for i in count(1))


class Custom(ScanSchedule):
    """A schedule with scans after given numbers of moves. The schedule ends after the last scan.

    Parameters
    ----------
    scans_after : sequence of int
        Numbers of moves from the start to each scan, in increasing order. The first scan must
        follow after at least 1 move.
    name : str

    Raises
    ------
    InvalidInputError
        Raised if ``scans_after`` is empty or not an increasing sequence of positive whole numbers.

    Examples
    --------
    >>> Custom([3, 10]).cost(5)
    Cost(distance=5, moves=10, scans=3)
    """

    def __init__(self, scans_after: Sequence[int], *, name: str = "custom") -> None:
        before = 0
        for number, position in enumerate(scans_after, start=1):
            before = check_integer(
                position,
                what=f"schedule {name}: position {number}, after {before}",
                least=before + 1,
            )
        if not before:
            raise InvalidInputError(f"schedule {name}: expected one position at least, got none")
        self.scans_after = tuple(int(position) for position in scans_after)
        self.name = name

    def positions(self) -> Iterator[int]:
        """Yield the given scan positions, in moves from the start."""
        return iter(self.scans_after)


class OneJump(Custom):
    """The schedule with a single jump of L moves past the distance of the wall, and one scan after
    the jump.

    With the scan at the start, the schedule costs L moves and 2 scans.

    Parameters
    ----------
    length : int
        Number L of moves in the jump. The schedule detects a wall at a distance of fewer than L
        moves.

    Notes
    -----
    Source: paper M, section III.A.3. For a wall at distance D, paper M requires L >= D. The jump
    must have more than D moves, because a particle that has moved exactly D cells has not yet met
    the wall at distance D.
    """

    def __init__(self, length: int) -> None:
        super().__init__([length], name="one jump")


def check_distance(distance: int) -> int:
    """Check that a distance is a whole number of at least 0, and return the distance."""
    return check_integer(distance, what="distance", least=0)


def check_prices(scan_cost: Price, move_cost: Price) -> tuple[Fraction, Fraction]:
    """Return the price of a scan and the price of a move as fractions. The float 0.1 counts as
    exactly one tenth.

    Raises
    ------
    InvalidInputError
        Raised if a price is negative or not a finite number, or if the prices of a scan and of a
        move are both zero.
    """
    prices = []
    for name, price in (("scan cost", scan_cost), ("move cost", move_cost)):
        try:
            text = str(price)
            if (
                isinstance(price, bool)
                or len(text) > _LONGEST_PRICE
                or not _PRICE.fullmatch(text.strip())
            ):
                raise ValueError
            value = Fraction(text)
        except (ValueError, ZeroDivisionError):
            raise InvalidInputError(
                f"{name}: expected a number of at most 300 digits, got {str(price)[:80]!r}"
            ) from None
        if value < 0:
            raise InvalidInputError(f"{name}: expected 0 or more, got {str(price)[:80]}")
        prices.append(value)
    if not any(prices):
        raise InvalidInputError(
            "prices: expected a price above 0 for a scan or a move, got 0 for both"
        )
    return prices[0], prices[1]


MAX_SCANS = 20_000
"""Maximum number of scan positions in an optimal schedule, except a schedule with equal steps."""

_PRECISION = 64  # bits of the bisection, after which the final steps are exact
_LAST_STEPS = 50


class OptimalSchedule(ScanSchedule):
    """The scan schedule with the smallest competitive ratio, as computed by the function
    `optimal_schedule`.

    Parameters
    ----------
    schedule : ScanSchedule
    scan_cost, move_cost : Fraction
    max_distance : int
    """

    name = "optimal"

    def __init__(
        self, schedule: ScanSchedule, *, scan_cost: Fraction, move_cost: Fraction, max_distance: int
    ) -> None:
        self.scan_cost, self.move_cost, self.max_distance = scan_cost, move_cost, max_distance
        self.schedule = schedule

    def positions(self) -> Iterator[int]:
        """Yield the scan positions of the schedule, up to the first position beyond the maximum
        distance of the wall.
        """
        for position in self.schedule.positions():
            yield min(position, self.max_distance + 1)
            if position > self.max_distance:
                return

    def cost(self, distance: int) -> Cost:
        """Return the number of moves and scans until the schedule detects a wall at the given
        distance.
        """
        check_distance(distance)
        if distance > self.max_distance:
            raise InvalidInputError(
                f"schedule optimal: expected a distance up to {self.max_distance}, got {distance}"
            )
        cost = self.schedule.cost(distance)
        return Cost(distance, min(cost.moves, self.max_distance + 1), cost.scans)

    @cached_property
    def guarantee(self) -> Worst:
        """The largest ratio of the schedule's price to the optimal price, and the wall distance at
        which the ratio is largest.
        """
        return self.worst(
            scan_cost=self.scan_cost, move_cost=self.move_cost, max_distance=self.max_distance
        )

    def worst(self, *, scan_cost: Price, move_cost: Price, max_distance: int) -> Worst:
        """Return the largest ratio of the schedule's price to the optimal price, over all distances
        from 0 to ``max_distance``.
        """
        if isinstance(self.schedule, EqualSteps):
            return self.schedule.worst(
                scan_cost=scan_cost, move_cost=move_cost, max_distance=max_distance
            )
        return super().worst(scan_cost=scan_cost, move_cost=move_cost, max_distance=max_distance)


def optimal_schedule(*, scan_cost: Price, move_cost: Price, max_distance: int) -> OptimalSchedule:
    """Return the scan schedule with the smallest competitive ratio, for walls at distances from 0
    to ``max_distance`` moves.

    The competitive ratio of a schedule is the largest ratio of the schedule's price to the optimal
    price, over all wall distances. Let c be the price of a scan, v the price of a move, x_1, x_2,
    ... the scan positions of a schedule, and x_0 = 0. The schedule has a competitive ratio of at
    most r if every x_j is at most ``(r (v (x_(j-1) + 1) + 2c) - c (j + 1)) / v``. A later scan
    allows later positions for all following scans. A competitive ratio r is therefore possible if
    and only if the schedule with the latest allowed scans reaches the maximum distance. A bisection
    finds an interval that contains the smallest possible competitive ratio. Inside the interval,
    the function computes schedules with smaller and smaller ratios in exact fractions, until no
    schedule has a smaller ratio.

    Parameters
    ----------
    scan_cost, move_cost : number
        Prices of a scan and of a move, in the same unit, at least 0. At least one price must exceed
        0. A price given as a float counts as its printed decimal value.
    max_distance : int
        Maximum distance of the wall, in moves.

    Returns
    -------
    OptimalSchedule
        The schedule is optimal if at most `MAX_SCANS` positions are enough, and if the distance and
        the prices have up to nine digits. If more than `MAX_SCANS` positions or more than nine
        digits are necessary, the function returns the better one of two schedules: the best
        schedule with equal steps, and the best schedule with at most `MAX_SCANS` positions, whose
        ratio is optimal to 19 digits.

    Raises
    ------
    InvalidInputError
        Raised if a price or the maximum distance is out of range.

    Notes
    -----
    The computation extends section III.A.3 of paper M, which assumes unknown prices of scans and
    moves. If a scan costs 10 times as much as a move, the best schedule has equal steps of 15
    moves, unless the maximum distance is small.

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
    schedules = [
        OptimalSchedule(candidate, scan_cost=scan, move_cost=move, max_distance=max_distance)
        for candidate in candidates
    ]
    return min(schedules, key=lambda schedule: schedule.guarantee.ratio)


def _best_equal_steps(scan: Fraction, move: Fraction, max_distance: int) -> EqualSteps:
    """Return the schedule of equal steps with the smallest competitive ratio.

    The competitive ratio is the larger one of two ratios of the schedule's price to the optimal
    price. The ratio for a wall at the start grows with the length of the steps. The ratio for a
    wall near the maximum distance falls with the length of the steps.
    """

    def too_short(step: int) -> bool:
        worst = EqualSteps(step).worst(scan_cost=scan, move_cost=move, max_distance=max_distance)
        return worst.distance > 0

    low, high = 1, max_distance + 1
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if too_short(middle) else (low, middle)
    steps = [EqualSteps(step) for step in (low - 1, low) if step > 0]
    return min(
        steps,
        key=lambda schedule: (
            schedule.worst(scan_cost=scan, move_cost=move, max_distance=max_distance).ratio
        ),
    )


def least_worst(scan: Fraction, move: Fraction, max_distance: int, max_scans: int) -> list[int]:
    """Return up to ``max_scans`` scan positions with the smallest competitive ratio. The price of a
    move must exceed 0.
    """
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
        middle = Fraction(
            (middle.numerator << 2 * _PRECISION) // middle.denominator, 1 << 2 * _PRECISION
        )
        time = latest(middle)
        if time is None:
            low = middle
        else:
            best, high = time, latest.ratio(time)
    for _ in range(_LAST_STEPS):  # enough whenever the limit on scans has no effect
        better = latest(high, below=True)
        if better is None:
            break
        best, high = better, latest.ratio(better)
    return best


class _Latest:
    """Computes the schedule with the latest scans that a competitive ratio allows, for integer
    prices of a scan and a move.
    """

    def __init__(self, scan: int, move: int, max_distance: int, max_scans: int) -> None:
        self.scan, self.move, self.end, self.max_scans = scan, move, max_distance + 1, max_scans

    def __call__(self, ratio: Fraction, *, below: bool = False) -> list[int] | None:
        """Return scan positions with a competitive ratio of at most ``ratio``, or None if no such
        positions exist.

        If ``below`` is true, the competitive ratio of the scan positions must be smaller than
        ``ratio``.
        """
        p, q, scan, move = ratio.numerator, ratio.denominator, self.scan, self.move
        positions: list[int] = []
        last = 0
        while last < self.end:
            scan_price = scan * (len(positions) + 2)
            allowed = p * (move * (last + 1) + 2 * scan) - q * scan_price - (1 if below else 0)
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
            over = self.scan * scans + self.move * position
            under = self.move * (below + 1) + 2 * self.scan
            if over * best[1] > best[0] * under:
                best = (over, under)
            below = position
        return Fraction(*best)


@dataclass(frozen=True)
class Bracket:
    """The smallest common bound on the competitive ratios of moves and scans, for walls up to a
    maximum distance.

    Parameters
    ----------
    ratio : Fraction
        The smallest common bound on the competitive ratios of moves and scans.
    schedule : Custom
        A schedule whose competitive ratios of moves and scans are at most ``ratio``.
    """

    ratio: Fraction
    schedule: Custom


def least_simultaneous_ratio(max_distance: int) -> Bracket:
    """Return the smallest common bound on the competitive ratios of moves and of scans that some
    schedule can keep.

    For a schedule with j scans after the scan at the start, the competitive ratio of scans is (j +
    1) / 2, because the optimum has two scans. The smallest possible competitive ratio of moves
    falls as the number of scans grows. A schedule reaches this smallest ratio of moves if each jump
    is as long as the ratio allows. The smallest common bound lies where the falling ratio of moves
    and the growing ratio of scans meet. The function searches for the number of scans at this
    point.

    Parameters
    ----------
    max_distance : int
        Maximum distance of the wall, in moves, at least 0.

    Raises
    ------
    InvalidInputError
        Raised if the maximum distance is negative.

    Notes
    -----
    Source: the asymptotic argument after the proof of theorem 1 in paper M, according to which
    fewer scans need longer jumps.

    Examples
    --------
    >>> best = least_simultaneous_ratio(1000)
    >>> best.ratio, best.schedule.scans_after
    (Fraction(7, 2), (3, 12, 39, 120, 363, 1001))
    """
    check_distance(max_distance)
    best: Bracket | None = None
    for scans in count(1):
        if best is not None and Fraction(scans + 1, 2) >= best.ratio:
            return best
        positions = least_worst(Fraction(0), Fraction(1), max_distance, scans)
        pairs = zip(positions, [0, *positions], strict=False)
        ratio = max(
            *(Fraction(position, before + 1) for position, before in pairs),
            Fraction(len(positions) + 1, 2),
        )
        if best is None or ratio < best.ratio:
            best = Bracket(ratio, Custom(positions, name="best in both"))
    raise AssertionError("count() does not end")


def worst_of_both(schedule: ScanSchedule, max_distance: int) -> Fraction:
    """Return the larger of a schedule's competitive ratios of moves and of scans, for wall
    distances from 0 to ``max_distance``.

    Raises
    ------
    InvalidInputError
        Raised if the maximum distance is negative, or if the schedule ends before the maximum
        distance.

    Examples
    --------
    >>> from shoal.swarm.theory.scan_schedules import Hyperexponential
    >>> worst_of_both(Hyperexponential(), 10**6), least_simultaneous_ratio(10**6).ratio
    (Fraction(2097152, 102943), Fraction(5, 1))
    """
    moves = schedule.worst(scan_cost=0, move_cost=1, max_distance=max_distance).ratio
    return max(moves, schedule.cost(max_distance).scan_ratio)
