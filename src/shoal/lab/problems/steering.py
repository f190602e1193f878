"""Trials of steering: given problems, or random ones."""

from __future__ import annotations

import json
from typing import Any, Literal

from pydantic import Field, FiniteFloat, StrictInt

from shoal.errors import InvalidInputError
from shoal.lab.problems.base import Problem, Values, is_file

Place = tuple[FiniteFloat, ...]


class SteeringTrials(Problem):
    """Two particles or more, one shared input: the arguments of `shoal.steering.steer`.

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
    planner: str = "shortest"
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
        """Refuse unknown planners, and a goal that is varied but not given."""
        from shoal.steering import make_planner

        make_planner(self.planner)
        self._disturbance()
        if (self.goal_x is None) != (self.goal_y is None):
            raise InvalidInputError("goal_x, goal_y: expected both or none, got one")
        if self.goal_x is not None and self.goal == "random":
            raise InvalidInputError(
                "goal_x: expected it with a goal for each particle, of which it replaces one, got a random goal"
            )

    def _disturbance(self) -> Any:
        from math import inf

        from shoal.steering import Disturbance

        friction = inf if self.friction is None else self.friction
        return Disturbance(self.execution, self.measurement, self.gain, friction, self.radius)

    def play(self, opened: Any, seed: int) -> Values:
        """Plan and play; ``shoal steer`` with this problem and seed does the same.

        A goal outside the workspace, as in a sweep over a square around a disk, has the status "outside".
        """
        import numpy as np

        from shoal.steering import SteeringProblem, steer

        rng = np.random.default_rng([seed, 1])
        start = _drawn(opened, rng) if self.start == "random" else np.array(self.start)
        goal = _drawn(opened, rng) if self.goal == "random" else np.array(self.goal)
        if self.goal_x is not None:
            goal[self.varied - 1] = self.goal_x, self.goal_y
            if not opened.contains(goal[self.varied - 1]):
                return ["outside", None, None, None, None]
        problem = SteeringProblem(opened, start, goal, self.tolerance, self.interchangeable)
        episode = steer(
            problem, planner=self.planner, disturbance=self._disturbance(), seed=seed, max_moves=self.max_moves
        )  # fmt: skip
        return [episode.status, episode.n_moves, episode.path_length, episode.error, episode.lower_bound]


def _drawn(workspace: Any, rng: Any) -> Any:
    """Return two points, uniform in a plane workspace."""
    import numpy as np

    if workspace.dimensions != 2:
        raise InvalidInputError("start, goal: expected points, as random ones are drawn in the plane only, got random")
    if getattr(workspace, "round", False):
        low, high = workspace.center - workspace.radius, workspace.center + workspace.radius
    else:
        low, high = workspace.vertices.min(axis=0), workspace.vertices.max(axis=0)
    points: list[Any] = []
    while len(points) < 2:
        point = rng.uniform(low, high)
        if workspace.contains(point):
            points.append(point)
    return np.array(points)
