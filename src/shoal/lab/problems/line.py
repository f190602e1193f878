"""Trials in one dimension: random placements, and walls at unknown distances."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, FiniteFloat, StrictInt

from shoal.errors import InvalidInputError
from shoal.lab.problems.base import Problem, Values


class LineProblem(Problem):
    """Random placements on a line: means over ``placements`` of them (paper M, section III.A)."""

    measures = ("first", "last", "largest_gap", "spread", "boundary", "coverage", "printed_coverage")

    kind: Literal["line"]
    cells: StrictInt
    particles: StrictInt
    placements: StrictInt = Field(default=1, ge=1)

    def opened(self) -> Any:
        """Return the line."""
        from shoal.swarm.theory.one_dimension import Line

        return Line(self.cells, self.particles)

    def play(self, opened: Any, seed: int) -> Values:
        """Draw the placements; ``shoal line`` with this seed draws the same."""
        from shoal.swarm.theory.one_dimension import sample

        drawn = sample(opened, self.placements, seed=seed, workers=1)
        return [float(getattr(drawn, name).mean()) for name in self.measures]


class ScheduleProblem(Problem):
    """A wall at an unknown distance on a line, and a schedule of scans (paper M, section III.A.3)."""

    measures = ("distance", "moves", "scans", "move_ratio", "scan_ratio", "weighted_ratio")

    kind: Literal["schedule"]
    schedule: str = "i^i"
    max_distance: StrictInt = Field(default=1000, ge=0, le=10**15)
    distance: StrictInt | None = Field(default=None, ge=0, le=10**15)
    scan_cost: FiniteFloat = Field(default=10.0, ge=0)
    move_cost: FiniteFloat = Field(default=1.0, ge=0)

    def opened(self) -> Any:
        """Return the schedule."""
        from shoal.swarm.theory.scan_schedules import EveryStep, Hyperexponential, OneJump, Powers

        made = {"every-step": EveryStep, "i^i": Hyperexponential}.get(self.schedule)
        if made is not None:
            return made()
        name, _, number = self.schedule.partition(":")
        if name in {"powers", "one-jump"} and number.isdecimal():
            return Powers(int(number)) if name == "powers" else OneJump(int(number))
        raise InvalidInputError(f"schedule: expected every-step, i^i, powers:K or one-jump:M, got {self.schedule!r}")

    def check(self, opened: Any) -> None:
        """Refuse prices that are both zero, and schedules that end before the wall."""
        farthest = self.max_distance if self.distance is None else self.distance
        opened.cost(farthest).weighted_ratio(scan_cost=self.scan_cost, move_cost=self.move_cost)

    def play(self, opened: Any, seed: int) -> Values:
        """Draw a distance from 0 to ``max_distance``, if none is given, and find the wall."""
        import numpy as np

        at = self.distance
        cost = opened.cost(int(np.random.default_rng(seed).integers(self.max_distance + 1)) if at is None else at)
        weighted = cost.weighted_ratio(scan_cost=self.scan_cost, move_cost=self.move_cost)
        return [cost.distance, cost.moves, cost.scans, float(cost.move_ratio), float(cost.scan_ratio), float(weighted)]
