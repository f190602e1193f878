"""The cost of looking: when to scan while a swarm moves.

One dimension (paper M, section III.A.3): schedules for a wall at an unknown distance, with exact costs. Two and three
dimensions, which the paper leaves open: what one scan tells after a run of equal commands, and how long to run before each scan.
"""

from __future__ import annotations

from shoal.swarm.scanning.bounds import Bracket, least_simultaneous_ratio, theorem_rate, worst_of_both
from shoal.swarm.scanning.optimal import OptimalSchedule, optimal_schedule
from shoal.swarm.scanning.runs import ScanRule, states_of_run
from shoal.swarm.scanning.schedules import (
    Cost,
    Custom,
    EqualSteps,
    EveryStep,
    Hyperexponential,
    OneJump,
    Powers,
    Schedule,
    Worst,
    check_prices,
)

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
    "ScanRule",
    "Schedule",
    "Worst",
    "check_prices",
    "least_simultaneous_ratio",
    "optimal_schedule",
    "states_of_run",
    "theorem_rate",
    "worst_of_both",
]
