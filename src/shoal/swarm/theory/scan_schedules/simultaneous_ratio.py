"""Theorem 1 of paper M in numbers: the smallest bound that the move ratio and the scan ratio of one schedule can both keep."""

from __future__ import annotations

from fractions import Fraction
from itertools import count

from shoal.core.dataclass import dataclass
from shoal.swarm.theory.scan_schedules.optimal import least_worst
from shoal.swarm.theory.scan_schedules.schedules import Custom, ScanSchedule, check_distance


@dataclass(frozen=True)
class Bracket:
    """The smallest possible bound on the move ratio and the scan ratio of a schedule, for distances up to a limit.

    Parameters
    ----------
    ratio : Fraction
        The smallest bound that both ratios of one schedule can keep.
    schedule : Custom
        A schedule whose two ratios keep this bound.
    """

    ratio: Fraction
    schedule: Custom


def least_simultaneous_ratio(max_distance: int) -> Bracket:
    """Return the smallest c for which one schedule keeps its move ratio and its scan ratio at or below c.

    With j scans after the first one, the scan ratio is (j + 1) / 2. The smallest possible move ratio falls as j grows. Jumps that
    are as long as the ratio allows reach the smallest move ratio. The best bound lies at the j at which the two ratios cross.
    Therefore a search over j gives the exact result.

    Parameters
    ----------
    max_distance : int
        Maximum distance, at least 0.

    Raises
    ------
    InvalidInputError
        If the distance is out of range.

    Notes
    -----
    Source: the argument after the proof of theorem 1 in paper M, which is asymptotic: fewer scans need longer jumps.

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
    """Return the larger one of the move ratio and the scan ratio, maximized over the distances 0 .. max_distance.

    Raises
    ------
    InvalidInputError
        If the distance is out of range, or the schedule ends before this distance.

    Examples
    --------
    >>> from shoal.swarm.theory.scan_schedules import Hyperexponential
    >>> worst_of_both(Hyperexponential(), 10**6), least_simultaneous_ratio(10**6).ratio
    (Fraction(2097152, 102943), Fraction(5, 1))
    """
    moves = schedule.worst(scan_cost=0, move_cost=1, max_distance=max_distance).ratio
    return max(moves, schedule.cost(max_distance).scan_ratio)
