"""Trials of searches."""

from __future__ import annotations

from math import isfinite
from typing import Any, Literal

from pydantic import Field, FiniteFloat, StrictInt

from shoal.errors import InvalidInputError
from shoal.lab.problems.base import Problem, Values, is_file


class SearchProblem(Problem):
    """Robots that search a region: the arguments of `shoal.search.search`; ``crashes`` robots die at random times."""

    measures = ("complete", "cells", "time", "share", "planned", "lower_bound", "sent", "lost", "takeovers")

    kind: Literal["search"]
    region: str
    robots: StrictInt = Field(default=4, ge=1)
    footprint: FiniteFloat = Field(default=10.0, gt=0)
    starts: str = "random"
    tour: str = "spanning-tree"
    allocation: str = "hop"
    turn_cost: FiniteFloat = 0.0
    transit: bool = False
    loss: FiniteFloat = 0.0
    network: str = ""
    crashes: StrictInt = Field(default=0, ge=0)
    fold: StrictInt = 1
    targets: StrictInt = 0
    detection: FiniteFloat = 1.0
    false_alarm: FiniteFloat = 0.0
    simulate: bool | None = None

    def source(self) -> str:
        """Return the region."""
        return self.region

    def opened(self) -> Any:
        """Return the region."""
        from shoal.search import open_region

        return open_region(self.region)

    def digest(self, opened: Any) -> bytes:
        """Return the outline."""
        return bytes(opened.area.wkb)

    def is_file(self) -> bool:
        """Tell whether the region is a file."""
        return is_file(self.region)

    def check(self, opened: Any) -> None:
        """Refuse more crashes than robots."""
        if self.crashes > self.robots:
            raise InvalidInputError(f"crashes: expected at most {self.robots}, one a robot, got {self.crashes}")

    def play(self, opened: Any, seed: int) -> Values:
        """Search; ``share`` is the time as a share of what one robot needs, T/T_UB."""
        import numpy as np

        from shoal.search import search
        from shoal.search.simulation.faults import Crash

        rng = np.random.default_rng([seed, 2])
        dead = rng.choice(self.robots, size=self.crashes, replace=False) + 1
        cells_each = opened.area_m2 / self.footprint**2 / self.robots
        faults = [Crash(int(robot), float(rng.uniform(0, 2 * cells_each))) for robot in np.sort(dead)]
        episode = search(
            opened, robots=self.robots, footprint=self.footprint, starts=self.starts, tour=self.tour, allocation=self.allocation,
            turn_cost=self.turn_cost, transit=self.transit, loss=self.loss, network=self.network, faults=faults, fold=self.fold,
            targets=self.targets, detection=self.detection, false_alarm=self.false_alarm, simulate=self.simulate, seed=seed,
        )  # fmt: skip
        cells, time = episode.plan.grid.n_cells, episode.covered_at if isfinite(episode.covered_at) else None
        allocation = episode.plan.allocation
        share = None if time is None else float(time) / cells
        numbers = [share, float(allocation.makespan), float(allocation.lower_bound), episode.sent, episode.lost, episode.takeovers]
        return [episode.complete, cells, None if time is None else float(time), *numbers]
