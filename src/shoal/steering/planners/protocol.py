"""What a planner is."""

from __future__ import annotations

from typing import Protocol

from shoal.registry import Registry
from shoal.steering.planners.task import SteeringTask
from shoal.steering.workspaces.convex_geometry import Points


class Planner(Protocol):
    """An object that finds moves.

    Attributes
    ----------
    name : str
    """

    name: str

    def plan(self, task: SteeringTask) -> Points | None:
        """Return moves, float64, shape (moves, d), that bring the particles to the goal, or near it; None if it finds none."""
        ...


PLANNERS: Registry[type[Planner]] = Registry("planner")
