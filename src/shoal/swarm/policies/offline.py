"""offline: a whole plan for a known map before the first move."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from numpy.random import Generator

from shoal.errors import InvalidInputError
from shoal.swarm.policies.protocol import Decision, View

PLAN_BUDGET = 32_000.0  # imagined moves for each command: nobody waits between two of them


@dataclass(frozen=True)
class Offline:
    """Send the plan of `shoal.swarm.plans.plan_coverage`; for coverages alone, since it has to know the map.

    Parameters
    ----------
    budget : float
        Moves that may be imagined for each command of the plan, on average.
    """

    kind: ClassVar[str] = "offline"
    budget: float = PLAN_BUDGET

    def __post_init__(self) -> None:
        if not 0 < self.budget <= 1e12:
            raise InvalidInputError(f"budget: expected imagined moves a command, above 0 and at most 1e12, got {self.budget:g}")

    @property
    def name(self) -> str:
        """The registered name, and the budget if it is not the default."""
        return self.kind if self.budget == PLAN_BUDGET else f"{self.kind}:budget={self.budget:g}"

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the whole plan at the first call, none afterwards."""
        from shoal.swarm.grid.state import SwarmState
        from shoal.swarm.plans import plan_from

        if memory is not None:
            return "", memory
        if view.mapping:
            raise InvalidInputError("policy offline: expected a task whose map is known, such as coverage, got a mapping")
        # Particles that share a cell share it for ever, so one for each cell will do.
        state = SwarmState.of_cells(view.occupied.layout, view.occupied.cells, shared=view.rule == "merge")
        return plan_from(view.belief, state, view.rule, self.budget, rng), "sent"
