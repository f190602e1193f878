"""Theorem 1 of paper M as numbers: how small both ratios of a schedule can be at once."""

from __future__ import annotations

from fractions import Fraction
from itertools import count

from shoal.core.dataclass import dataclass
from shoal.swarm.theory.scan_schedules.optimal import least_worst
from shoal.swarm.theory.scan_schedules.schedules import Custom, ScanSchedule, check_distance


@dataclass(frozen=True)
class Bracket:
    """The best simultaneous ratio for distances up to a limit.

    Parameters
    ----------
    ratio : Fraction
        No schedule keeps both ratios below it; `schedule` keeps both at most there.
    schedule : Custom
    """

    ratio: Fraction
    schedule: Custom


def least_simultaneous_ratio(max_distance: int) -> Bracket:
    """Return the smallest c such that some schedule has move ratio and scan ratio at most c for all distances 0 .. max_distance.

    With j scans after the first one the scan ratio is (j + 1) / 2, and the least possible move ratio falls as j grows: it is
    that of jumps as long as the ratio allows. So the best j lies where they cross, and a search over j is exact.

    Parameters
    ----------
    max_distance : int
        0 or more.

    Raises
    ------
    InvalidInputError
        For another distance.

    Notes
    -----
    Source: the argument after the proof of theorem 1, paper M: fewer scans need longer jumps. There it is asymptotic.

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
    """Return the largest of move ratio and scan ratio over the distances 0 .. max_distance.

    Raises
    ------
    InvalidInputError
        For a distance that does not fit, or if the schedule ends before it.

    Examples
    --------
    >>> from shoal.swarm.theory.scan_schedules import Hyperexponential
    >>> worst_of_both(Hyperexponential(), 10**6), least_simultaneous_ratio(10**6).ratio
    (Fraction(2097152, 102943), Fraction(5, 1))
    """
    moves = schedule.worst(scan_cost=0, move_cost=1, max_distance=max_distance).ratio
    return max(moves, schedule.cost(max_distance).scan_ratio)
