"""The planners of steering by name. A line in `PLANNERS` makes a planner known to commands, help,
studio and docs; a planner's module is imported when the planner is used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any, cast

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError
from shoal.core.registry import Registry, configured

if TYPE_CHECKING:
    from shoal.steering.planners.task import Planner

__all__ = ["PLANNERS", "make_planner"]


class PlannerRegistry(Registry[Any]):
    """A registry of planners, in which ``module:class`` may stand for a class of this package."""

    def get(self, name: str) -> Any:
        """Return the class that is registered as ``name``, or the third-party object for a name
        like ``module:attribute``.

        Raises
        ------
        UnknownNameError
            If no planner has the given name.
        """
        planner = super().get(name)
        if isinstance(planner, str):  # planners call kernels, whose compiler takes a second to load
            module, _, attribute = planner.partition(":")
            planner = getattr(importlib.import_module(f"{__name__}.{module}"), attribute)
        return planner


PLANNERS = PlannerRegistry("planner")
PLANNERS.add("shortest", "shortest:Shortest")
PLANNERS.add("greedy", "greedy:Greedy")
PLANNERS.add("fewest-moves", "fewest_moves:FewestMoves")
PLANNERS.add("robust", "robust:Robust")
PLANNERS.add("sampling", "sampling:Sampling")
PLANNERS.add("conformant", "pressing:Conformant")


def make_planner(planner: str | Planner) -> Planner:
    """Return the planner that a name or a text ``module:attribute`` denotes; a planner object is
    returned unchanged.

    Raises
    ------
    UnknownNameError
        If no planner has the given name.
    InvalidInputError
        If the object is not a planner.
    """
    named: Any = configured(PLANNERS, planner) if isinstance(planner, str) else planner
    instance = (
        named() if isinstance(named, type) and callable(getattr(named, "plan", None)) else named
    )
    if isinstance(instance, type) or not callable(getattr(instance, "plan", None)):
        raise InvalidInputError(
            "planner: expected a name, or an object with a name and plan(task), got"
            f" {shortened(instance)}"
        )
    return cast("Planner", instance)
