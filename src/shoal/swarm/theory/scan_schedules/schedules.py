"""Scan schedules on a line: the numbers of moves after which a particle is scanned on its way to a wall at unknown distance.

The particle is scanned once at the start. A wall at distance D stops the particle after D moves. A scan after x moves detects a
wall at distance D if x > D. For a known distance D, the optimum is D + 1 moves and 2 scans.
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
    """The numbers of moves and scans until the wall is found, as exact integers.

    Parameters
    ----------
    distance : int
        Distance D of the wall.
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
        """Return the total price divided by the price of the optimum.

        Raises
        ------
        InvalidInputError
            If a price is negative or not finite, or both prices are zero.
        """
        scan, move = check_prices(scan_cost, move_cost)
        return (scan * self.scans + move * self.moves) / (2 * scan + move * (self.distance + 1))


@dataclass(frozen=True)
class Worst:
    """The worst case of a schedule over all distances up to a limit.

    Parameters
    ----------
    ratio : Fraction
        The largest weighted ratio.
    distance : int
        The smallest distance with this ratio.
    """

    ratio: Fraction
    distance: int


class ScanSchedule(ABC):
    """An increasing sequence of scan positions, in moves from the start.

    A subclass has a ``name`` and yields its `positions`.
    """

    name: str

    @abstractmethod
    def positions(self) -> Iterator[int]:
        """Yield the number of moves before each scan, in increasing order, without the scan at the start."""

    def cost(self, distance: int) -> Cost:
        """Return the number of moves and scans until a wall at the given distance is found.

        Parameters
        ----------
        distance : int
            Distance of the wall, of any size, because the integers are exact.

        Raises
        ------
        InvalidInputError
            If the distance is negative, or the schedule ends before this distance.
        """
        distance, last = check_distance(distance), 0
        for scans, last in enumerate(self.positions(), start=2):
            if last > distance:
                return Cost(distance, last, scans)
        raise InvalidInputError(f"schedule {self.name}: expected a distance below its last position, {last}, got {distance}")

    def worst(self, *, scan_cost: Price, move_cost: Price, max_distance: int) -> Worst:
        """Return the largest weighted ratio over all distances 0 .. max_distance.

        Between two scans, the cost is constant while the optimum grows with the distance. Therefore only the smallest distance
        after each scan matters.

        Raises
        ------
        InvalidInputError
            If a price or the distance is out of range, or the schedule ends before the distance.
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
        k, at least 1.

    Raises
    ------
    InvalidInputError
        If the step is out of range.

    Examples
    --------
    >>> EqualSteps(15).cost(100)
    Cost(distance=100, moves=105, scans=8)
    """

    def __init__(self, step: int) -> None:
        self.step = check_integer(step, what="step", least=1)
        self.name = f"every {step} steps"

    def positions(self) -> Iterator[int]:
        """Yield k, 2k, 3k, ..."""
        return count(self.step, self.step)

    def cost(self, distance: int) -> Cost:
        """Return moves and scans; see `ScanSchedule.cost`."""
        jumps = check_distance(distance) // self.step + 1
        return Cost(distance, jumps * self.step, jumps + 1)

    def worst(self, *, scan_cost: Price, move_cost: Price, max_distance: int) -> Worst:
        """Return the worst ratio.

        The worst distance is 0, or the position of the last scan up to the maximum distance; see `ScanSchedule.worst`.
        """
        check_distance(max_distance)
        ends = (0, max_distance // self.step * self.step)
        ratios = [self.cost(end).weighted_ratio(scan_cost=scan_cost, move_cost=move_cost) for end in ends]
        return Worst(ratios[0], 0) if ratios[0] >= ratios[1] else Worst(ratios[1], ends[1])


class EveryStep(EqualSteps):
    """The schedule with a scan after each move. For a wall at distance D, this schedule costs D + 1 moves and D + 2 scans.

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

    A wall at distance D > 0 costs at most k D moves and about log D / log k scans.

    Parameters
    ----------
    base : int
        k, at least 2. A base of 2 doubles the distance before each scan.

    Raises
    ------
    InvalidInputError
        If the base is out of range.

    Notes
    -----
    Source: paper M, section III.A.3. The paper counts log_k D scans. With the scan at the start and the first move, the number is
    up to ceil(log_k(D + 1)) + 2.

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
        """Yield 1, k, k^2, ..."""
        position = 1
        while True:
            yield position
            position *= self.base


class Hyperexponential(ScanSchedule):
    """The schedule with the i-th scan after i^i moves: 1, 4, 27, 256, ...

    The move ratio and the scan ratio of this schedule grow as log D / log log D with the distance D. No schedule lets both ratios
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
        """Yield 1, 4, 27, 256, ..."""
        return (i**i for i in count(1))


class Custom(ScanSchedule):
    """A schedule with scans after given numbers of moves. The schedule ends after the last scan.

    Parameters
    ----------
    scans_after : sequence of int
        Numbers of moves in increasing order, at least 1.
    name : str

    Raises
    ------
    InvalidInputError
        If the sequence is invalid.

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
        """Yield the given positions."""
        return iter(self.scans_after)


class OneJump(Custom):
    """The schedule with one scan after M moves, which are enough to reach the wall. The cost is M moves and 2 scans.

    Parameters
    ----------
    length : int
        M, the number of moves. The schedule finds walls at distances below M.

    Notes
    -----
    Source: paper M, section III.A.3. The paper requires M >= D, but a particle that has moved exactly D = M cells has not yet met
    the wall.
    """

    def __init__(self, length: int) -> None:
        super().__init__([length], name="one jump")


def check_distance(distance: int) -> int:
    """Return a distance after checking that it is a whole number of at least 0. Other values raise InvalidInputError."""
    return check_integer(distance, what="distance", least=0)


def check_prices(scan_cost: Price, move_cost: Price) -> tuple[Fraction, Fraction]:
    """Return both prices as fractions. A float counts as its printed decimal value, so 0.1 is a tenth.

    Raises
    ------
    InvalidInputError
        If a price is not a number, not finite or negative, or both prices are zero.
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
