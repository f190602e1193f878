"""Scan schedules for the search for a wall at an unknown distance, with exact costs. Source: paper M, section III.A.3."""

from __future__ import annotations

from shoal.swarm.theory.scan_schedules.optimal import OptimalSchedule, optimal_schedule
from shoal.swarm.theory.scan_schedules.schedules import (
    Cost,
    Custom,
    EqualSteps,
    EveryStep,
    Hyperexponential,
    OneJump,
    Powers,
    ScanSchedule,
    Worst,
    check_prices,
)
from shoal.swarm.theory.scan_schedules.simultaneous_ratio import Bracket, least_simultaneous_ratio, worst_of_both

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
