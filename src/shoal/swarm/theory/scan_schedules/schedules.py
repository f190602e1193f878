"""Scan schedules on a line: after how many moves to scan a particle that moves towards a wall at an unknown distance.

Every schedule scans the particle once at the start. A wall at distance D stops the particle after D moves. A scan after x moves
detects a wall at distance D if x > D. The optimum is the cost for a known distance D of the wall: D + 1 moves and 2 scans.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from decimal import Decimal
from fractions import Fraction
from itertools import count

from shoal.core.checks import check_integer
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError

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
        """Return the price of all moves and scans, divided by the price of the optimum: D + 1 moves and 2 scans for distance D.

        Raises
        ------
        InvalidInputError
            Raised if a price is negative or not finite, or if the prices of moves and scans are both zero.
        """
        scan, move = check_prices(scan_cost, move_cost)
        return (scan * self.scans + move * self.moves) / (2 * scan + move * (self.distance + 1))


@dataclass(frozen=True)
class Worst:
    """The worst case of a scan schedule over all distances of the wall up to a limit.

    Parameters
    ----------
    ratio : Fraction
        The largest ratio of the schedule's price to the optimal price, over all distances of the wall.
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
        """Yield the number of moves from the start to each scan, in increasing order, without the scan at the start."""

    def cost(self, distance: int) -> Cost:
        """Return the number of moves and scans until the schedule detects a wall at the given distance.

        Parameters
        ----------
        distance : int
            Distance of the wall, in moves. The distance may have any size, because Python integers are exact.

        Raises
        ------
        InvalidInputError
            Raised if the distance is negative, or if the schedule ends before the distance.
        """
        distance, last = check_distance(distance), 0
        for scans, last in enumerate(self.positions(), start=2):
            if last > distance:
                return Cost(distance, last, scans)
        raise InvalidInputError(f"schedule {self.name}: expected a distance below its last position, {last}, got {distance}")

    def worst(self, *, scan_cost: Price, move_cost: Price, max_distance: int) -> Worst:
        """Return the largest ratio of the schedule's price to the optimal price, over all distances from 0 to ``max_distance``.

        Between two scan positions, the cost of the schedule is constant, but the cost of the optimum grows with the distance. The
        method therefore checks only the smallest distance after each scan position.

        Raises
        ------
        InvalidInputError
            Raised if a price or the maximum distance is out of range, or if the schedule ends before the maximum distance.
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
        raise InvalidInputError(f"schedule {self.name}: expected a distance below its last position, {before}, got {max_distance}")

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
        """Return the number of moves and scans until the schedule detects a wall at the given distance."""
        jumps = check_distance(distance) // self.step + 1
        return Cost(distance, jumps * self.step, jumps + 1)

    def worst(self, *, scan_cost: Price, move_cost: Price, max_distance: int) -> Worst:
        """Return the largest ratio of the schedule's price to the optimal price, over all distances from 0 to ``max_distance``.

        The largest ratio occurs for a wall at the distance 0, or at the last scan position up to the maximum distance.
        """
        check_distance(max_distance)
        ends = (0, max_distance // self.step * self.step)
        ratios = [self.cost(end).weighted_ratio(scan_cost=scan_cost, move_cost=move_cost) for end in ends]
        return Worst(ratios[0], 0) if ratios[0] >= ratios[1] else Worst(ratios[1], ends[1])


class EveryStep(EqualSteps):
    """The schedule with a scan after each move. The schedule detects a wall at distance D with D + 1 moves and D + 2 scans.

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

    The schedule detects a wall at distance D > 0 with at most k D moves and about log D / log k scans.

    Parameters
    ----------
    base : int
        Base k of the powers, at least 2. With the base 2, each scan position is twice the previous scan position.

    Raises
    ------
    InvalidInputError
        Raised if the base is less than 2.

    Notes
    -----
    Source: paper M, section III.A.3. For a wall at distance D, paper M counts log_k D scans of the schedule with powers of k. With
    the scan at the start and the scan after the first move, the schedule with powers of k needs up to ceil(log_k(D + 1)) + 2 scans.

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

    For a wall at distance D, the number of moves divided by its optimum, and the number of scans divided by its optimum, both grow
    as log D / log log D. No schedule exists for which both ratios grow more slowly.

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
        Numbers of moves from the start to each scan, in increasing order. The first scan must follow after at least 1 move.
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
            before = check_integer(position, what=f"schedule {name}: position {number}, after {before}", least=before + 1)
        if not before:
            raise InvalidInputError(f"schedule {name}: expected one position at least, got none")
        self.scans_after = tuple(int(position) for position in scans_after)
        self.name = name

    def positions(self) -> Iterator[int]:
        """Yield the given scan positions, in moves from the start."""
        return iter(self.scans_after)


class OneJump(Custom):
    """The schedule with a single jump of L moves past the distance of the wall, and one scan after the jump.

    With the scan at the start, the schedule costs L moves and 2 scans.

    Parameters
    ----------
    length : int
        Number L of moves in the jump. The schedule detects a wall at a distance of fewer than L moves.

    Notes
    -----
    Source: paper M, section III.A.3. For a wall at distance D, paper M requires L >= D. The jump must have more than D moves,
    because a particle that has moved exactly D cells has not yet met the wall at distance D.
    """

    def __init__(self, length: int) -> None:
        super().__init__([length], name="one jump")


def check_distance(distance: int) -> int:
    """Check that a distance is a whole number of at least 0, and return the distance."""
    return check_integer(distance, what="distance", least=0)


def check_prices(scan_cost: Price, move_cost: Price) -> tuple[Fraction, Fraction]:
    """Return the price of a scan and the price of a move as fractions. The float 0.1 counts as exactly one tenth.

    Raises
    ------
    InvalidInputError
        Raised if a price is negative or not a finite number, or if the prices of a scan and of a move are both zero.
    """
    prices = []
    for name, price in (("scan cost", scan_cost), ("move cost", move_cost)):
        try:
            text = str(price)
            if isinstance(price, bool) or len(text) > _LONGEST_PRICE or not _PRICE.fullmatch(text.strip()):
                raise ValueError
            value = Fraction(text)
        except (ValueError, ZeroDivisionError):
            raise InvalidInputError(f"{name}: expected a number of at most 300 digits, got {str(price)[:80]!r}") from None
        if value < 0:
            raise InvalidInputError(f"{name}: expected 0 or more, got {str(price)[:80]}")
        prices.append(value)
    if not any(prices):
        raise InvalidInputError("prices: expected a price above 0 for a scan or a move, got 0 for both")
    return prices[0], prices[1]
