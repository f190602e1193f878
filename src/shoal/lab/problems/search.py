"""Trials of searches."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, FiniteFloat, StrictInt

from shoal.errors import InvalidInputError
from shoal.lab.problems.base import Problem, Values, is_file


class SearchProblem(Problem):
    """Robots that search a region; see `shoal.search.problem.SearchProblem`."""

    measures = ("status", "cells", "makespan", "share", "planned", "lower_bound", "sent", "lost", "takeovers")

    kind: Literal["search"]
    region: str
    robots: StrictInt = Field(default=4, ge=1)
    footprint: FiniteFloat = Field(default=10.0, gt=0)
    starts: str = "random"
    tour: str = "auto"
    allocation: str = "auto"
    turn_cost: FiniteFloat = 0.0
    speed: FiniteFloat = Field(default=1.0, gt=0)
    transit: bool = False
    loss: FiniteFloat = 0.0
    network: str = "perfect"
    crashes: StrictInt = Field(default=0, ge=0)
    multiplicity: StrictInt = 1
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
        from shoal.search.problem import SearchProblem as Declared
        from shoal.search.run import run

        metrics = run(Declared(**self.model_dump(exclude={"kind"})).at_place(opened), seed=seed).metrics
        return [metrics[name] for name in self.measures]
