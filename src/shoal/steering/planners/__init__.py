"""The built-in planners of steering, which `make_planner` finds by name."""

from __future__ import annotations

from typing import Any, cast

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError
from shoal.core.registry import configured
from shoal.steering.planners import fewest_moves, greedy, robust, sampling, shortest
from shoal.steering.planners.task import PLANNERS, Planner

__all__ = [
    "PLANNERS",
    "Planner",
    "fewest_moves",
    "greedy",
    "make_planner",
    "robust",
    "sampling",
    "shortest",
]


def make_planner(planner: str | Planner) -> Planner:
    """Return the planner that a name or a text ``module:attribute`` denotes; a planner object is
    returned unchanged.

    Raises
    ------
    InvalidInputError
        If the object is not a planner.
    UnknownNameError
    """
    found: Any = configured(PLANNERS, planner) if isinstance(planner, str) else planner
    made = found() if isinstance(found, type) and callable(getattr(found, "plan", None)) else found
    if isinstance(made, type) or not callable(getattr(made, "plan", None)):
        raise InvalidInputError(
            "planner: expected a name, or an object with a name and plan(task), got"
            f" {shortened(made)}"
        )
    return cast("Planner", made)
