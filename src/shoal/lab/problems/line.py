"""Problems in one dimension: random placements of particles, and the search for a wall at an unknown distance."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.problem import option
from shoal.lab.problems.base import MeasuredProblem
from shoal.swarm.theory.one_dimension import Line, sample
from shoal.swarm.theory.scan_schedules import EveryStep, Hyperexponential, OneJump, Powers, ScanSchedule


@dataclass(frozen=True, eq=False)
class LineProblem(MeasuredProblem):
    """Random placements of particles on a line. A trial computes means over many placements (paper M, section III.A)."""

    part = "line"
    measures = ("first", "last", "largest_gap", "spread", "boundary", "coverage", "printed_coverage")

    cells: int = option(help="Number of cells of the line.", least=1)
    particles: int = option(help="Number of particles.", least=1)
    placements: int = option(1, help="Number of random placements in each trial.", least=1)

    @cached_property
    def line(self) -> Line:
        """The line of the problem, with its numbers of cells and particles."""
        return Line(self.cells, self.particles)

    def check_at_place(self) -> None:
        """Refuse a problem with more particles than cells."""
        _ = self.line

    def trial(self, seed: int) -> dict[str, Any]:
        """Draw random placements, and return the mean of each measure.

        The command ``shoal line`` draws the same placements from the same seed.
        """
        drawn = sample(self.line, self.placements, seed=seed, workers=1)
        return {name: float(getattr(drawn, name).mean()) for name in self.measures}


@dataclass(frozen=True, eq=False)
class ScheduleProblem(MeasuredProblem):
    """The search for a wall at an unknown distance on a line, with a scan schedule (paper M, section III.A.3)."""

    part = "schedule"
    measures = ("distance", "moves", "scans", "move_ratio", "scan_ratio", "weighted_ratio")

    schedule: str = option("i^i", help="Schedule of scans: every-step, i^i, powers:K or one-jump:M.")
    max_distance: int = option(1000, help="Maximum of the random distance of the wall (the minimum is 0).", least=0, most=10**15)
    distance: int | None = option(None, help="Distance of the wall, in place of a random distance.", least=0, most=10**15)
    scan_cost: float = option(10.0, help="Price of a scan, in any unit.", least=0)
    move_cost: float = option(1.0, help="Price of a move, in the same unit as the price of a scan.", least=0)

    @cached_property
    def scans(self) -> ScanSchedule:
        """The scan schedule that the field ``schedule`` names."""
        made = {"every-step": EveryStep, "i^i": Hyperexponential}.get(self.schedule)
        if made is not None:
            return made()
        name, _, number = self.schedule.partition(":")
        if name in {"powers", "one-jump"} and number.isdecimal():
            return Powers(int(number)) if name == "powers" else OneJump(int(number))
        raise InvalidInputError(f"schedule: expected every-step, i^i, powers:K or one-jump:M, got {self.schedule!r}")

    def check_at_place(self) -> None:
        """Refuse prices of scans and moves that are both 0, and a schedule whose last scan comes before the farthest wall."""
        farthest = self.max_distance if self.distance is None else self.distance
        self.scans.cost(farthest).weighted_ratio(scan_cost=self.scan_cost, move_cost=self.move_cost)

    def trial(self, seed: int) -> dict[str, Any]:
        """Return the measures of the search for a wall at the distance ``distance``, in moves.

        If ``distance`` is None, draw a random distance from 0 to ``max_distance``.
        """
        at = self.distance
        cost = self.scans.cost(int(np.random.default_rng(seed).integers(self.max_distance + 1)) if at is None else at)
        weighted = cost.weighted_ratio(scan_cost=self.scan_cost, move_cost=self.move_cost)
        ratios = {"move_ratio": float(cost.move_ratio), "scan_ratio": float(cost.scan_ratio), "weighted_ratio": float(weighted)}
        return {"distance": cost.distance, "moves": cost.moves, "scans": cost.scans} | ratios
