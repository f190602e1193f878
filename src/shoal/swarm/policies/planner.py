"""What the planners share: they see every move, and remember in arrays that kernels work in."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any, ClassVar

from numpy.random import Generator

from shoal.swarm.policies.compiled import Compiled
from shoal.swarm.policies.protocol import Decision, View


@dataclass(frozen=True)
class PlannerPolicy(Compiled):
    """Base of the policies that imagine moves before they choose one."""

    runs: ClassVar[bool] = False
    rules: ClassVar[frozenset[str]] = frozenset({"block", "merge"})

    @property
    def settings(self) -> tuple[float, ...]:
        """Options as kernels know them."""
        return ()

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next command; memory is the planner with all that it has learnt, and the last command."""
        from shoal.swarm import planning

        return planning.decide(self, view, copy.deepcopy(memory), rng)
