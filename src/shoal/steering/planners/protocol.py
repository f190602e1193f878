"""The interface `Planner` of objects that find the inputs of a steering problem, and the registry PLANNERS of all planners."""

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
    A planner may have four optional attributes: ``general``, ``obstacles``, ``prefers`` and ``control``. The attribute ``general``
    is true if the planner supports any number of particles, also in regions with obstacles. The attribute ``obstacles`` is true if
    the planner supports two particles in a region with obstacles. A planner with neither attribute gets only problems with two
    particles in a convex workspace.

    The attribute ``prefers`` is "length" or "moves", the measure by which Shoal compares the plans for different assignments of
    interchangeable goals. The method ``control(task, apparatus)`` runs a closed loop. The method sends moves and observes the
    particles instead of making a plan in advance. The argument ``apparatus`` is a
    `shoal.steering.simulation.apparatus.Apparatus`.
    """

    name: str

    def plan(self, task: SteeringTask) -> Points | None:
        """Return moves that bring the particles to their goals, or near their goals; float64, shape (moves, d).

        The result is None if the planner finds no plan.
        """
        ...


PLANNERS: Registry[type[Planner]] = Registry("planner")
