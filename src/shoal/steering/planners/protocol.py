"""The interface of planners, which find the inputs of a steering problem. PLANNERS contains the built-in planners by name."""

from __future__ import annotations

from typing import Protocol

from shoal.core.registry import Registry
from shoal.steering.planners.task import SteeringTask
from shoal.steering.workspaces.convex_geometry import Points


class Planner(Protocol):
    """An object that finds moves for a steering task.

    Attributes
    ----------
    name : str

    Notes
    -----
    A planner may have four more attributes:

    - ``general``: true if the planner supports regions with obstacles and more than two particles. Without ``general``, a planner
      gets only problems with two particles in a convex workspace.
    - ``obstacles``: true if the planner supports regions with obstacles, for two particles.
    - ``prefers``: "length" or "moves": the measure by which two plans are compared if goals are interchangeable.
    - ``control(task, apparatus)``: a method that sends moves and observes in a closed loop, in place of a plan. See
      `shoal.steering.simulation.apparatus`.
    """

    name: str

    def plan(self, task: SteeringTask) -> Points | None:
        """Return moves, as a float64 array of shape (moves, d), that bring the particles to the goal or near it.

        The result is None if the planner finds no plan.
        """
        ...


PLANNERS: Registry[type[Planner]] = Registry("planner")
