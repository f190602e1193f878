"""Theorem 1 of paper M in numbers: the smallest common bound on the competitive ratios of moves and scans."""

from __future__ import annotations

from fractions import Fraction
from itertools import count

from shoal.core.dataclass import dataclass
from shoal.swarm.theory.scan_schedules.optimal import least_worst
from shoal.swarm.theory.scan_schedules.schedules import Custom, ScanSchedule, check_distance


@dataclass(frozen=True)
class Bracket:
    """The smallest common bound on the competitive ratios of moves and scans, for walls up to a maximum distance.

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
    """Return the smallest common bound on the competitive ratios of moves and of scans that some schedule can keep.

    For a schedule with j scans after the scan at the start, the competitive ratio of scans is (j + 1) / 2, because the optimum has
    two scans. The smallest possible competitive ratio of moves falls as the number of scans grows. A schedule reaches this smallest
    ratio of moves if each jump is as long as the ratio allows. The smallest common bound lies where the falling ratio of moves and
    the growing ratio of scans meet. The function searches for the number of scans at this point.

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
    Source: the asymptotic argument after the proof of theorem 1 in paper M, according to which fewer scans need longer jumps.

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
        ratio = max(*(Fraction(position, before + 1) for position, before in pairs), Fraction(len(positions) + 1, 2))
        if best is None or ratio < best.ratio:
            best = Bracket(ratio, Custom(positions, name="best in both"))
    raise AssertionError("count() does not end")


def worst_of_both(schedule: ScanSchedule, max_distance: int) -> Fraction:
    """Return the larger of a schedule's competitive ratios of moves and of scans, for wall distances from 0 to ``max_distance``.

    Raises
    ------
    InvalidInputError
        Raised if the maximum distance is negative, or if the schedule ends before the maximum distance.

    Examples
    --------
    >>> from shoal.swarm.theory.scan_schedules import Hyperexponential
    >>> worst_of_both(Hyperexponential(), 10**6), least_simultaneous_ratio(10**6).ratio
    (Fraction(2097152, 102943), Fraction(5, 1))
    """
    moves = schedule.worst(scan_cost=0, move_cost=1, max_distance=max_distance).ratio
    return max(moves, schedule.cost(max_distance).scan_ratio)
