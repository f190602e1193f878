"""The planners, one a file, and their names."""

from __future__ import annotations

from shoal.steering.planners import fewest_moves, greedy, robust, sampling, shortest
from shoal.steering.planners.protocol import PLANNERS, Planner

__all__ = ["PLANNERS", "Planner", "fewest_moves", "greedy", "make_planner", "robust", "sampling", "shortest"]


def make_planner(planner: str | Planner) -> Planner:
    """Return a planner by name or ``module:attribute``, or the given object itself.

    Raises
    ------
    UnknownNameError
    """
    if not isinstance(planner, str):
        return planner
    found = PLANNERS.get(planner)
    return found() if isinstance(found, type) else found
