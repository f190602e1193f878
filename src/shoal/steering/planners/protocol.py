"""Planner: what finds the inputs of a steering problem; PLANNERS has the built-in ones by name."""

from __future__ import annotations

from typing import Protocol

from shoal.core.registry import Registry
from shoal.steering.planners.task import SteeringTask
from shoal.steering.workspaces.convex_geometry import Points


class Planner(Protocol):
    """An object that finds moves.

    Attributes
    ----------
    name : str

    Notes
    -----
    Three attributes more are looked for, and need not be there:

    - ``general``: true if regions with obstacles and more than two particles are taken, too; else they are refused.
    - ``prefers``: "length" or "moves", which of two plans is better where goals are interchangeable.
    - ``control(task, apparatus)``: plays in a closed loop instead of planning; see `shoal.steering.simulation.apparatus`.
    """

    name: str

    def plan(self, task: SteeringTask) -> Points | None:
        """Return moves, float64, shape (moves, d), that bring the particles to the goal, or near it; None if it finds none."""
        ...


PLANNERS: Registry[type[Planner]] = Registry("planner")
