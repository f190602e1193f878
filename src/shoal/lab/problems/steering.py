"""Trials of steering: given problems, or random ones."""

from __future__ import annotations

import json
from typing import Any, Literal

from pydantic import Field, FiniteFloat, StrictInt

from shoal.lab.problems.base import Problem, Values, is_file

Place = tuple[FiniteFloat, ...]


class SteeringTrials(Problem):
    """Two particles or more, one shared input: the fields of `shoal.steering.SteeringProblem`.

    ``start`` and ``goal`` are points, or "random": then each trial draws them, uniformly in a plane workspace.
    """

    measures = ("status", "moves", "length", "error", "lower_bound")

    kind: Literal["steering"]
    workspace: str = "square"
    start: tuple[Place, ...] | Literal["random"] = "random"
    goal: tuple[Place, ...] | Literal["random"] = "random"
    goal_x: FiniteFloat | None = None
    goal_y: FiniteFloat | None = None
    varied: Literal[1, 2] = 2
    planner: str = "auto"
    tolerance: FiniteFloat = 1e-6
    interchangeable: bool = False
    max_moves: StrictInt = Field(default=100, ge=1)
    execution: FiniteFloat = 0.0
    measurement: FiniteFloat = 0.0
    gain: FiniteFloat = 0.0
    friction: FiniteFloat | None = None
    radius: FiniteFloat = 0.0

    def source(self) -> str:
        """Return the workspace."""
        return self.workspace

    def opened(self) -> Any:
        """Return the workspace."""
        from shoal.steering import open_workspace

        return open_workspace(self.workspace)

    def digest(self, opened: Any) -> bytes:
        """Return the corners."""
        from shoal.steering.workspaces.formats import describe

        return json.dumps(describe(opened), sort_keys=True).encode()

    def is_file(self) -> bool:
        """Tell whether the workspace is a file."""
        return is_file(self.workspace)

    def check(self, opened: Any) -> None:
        """Refuse what no run could do."""
        self._asked(opened)

    def _asked(self, opened: Any) -> Any:
        from math import inf

        from shoal.steering import SteeringProblem

        fields = {name: getattr(self, name) for name in SteeringProblem.declarations() if hasattr(self, name)}
        friction = inf if self.friction is None else self.friction
        return SteeringProblem(**fields | {"workspace": opened, "friction": friction, "particle_radius": self.radius})

    def play(self, opened: Any, seed: int) -> Values:
        """Plan and play; ``shoal steer`` with this problem and seed does the same."""
        from shoal.steering.run import run

        metrics = run(self._asked(opened), seed=seed).metrics
        return [metrics[name] for name in self.measures]
