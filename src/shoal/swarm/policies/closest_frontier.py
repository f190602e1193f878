"""Policy closest-frontier: move the nearest particle to the nearest frontier cell."""

from __future__ import annotations

from typing import Any, ClassVar

from numpy.random import Generator

from shoal.core.dataclass import dataclass
from shoal.swarm.policies.compiled_policy import Searching
from shoal.swarm.policies.paths import path_to_frontier
from shoal.swarm.policies.protocol import Decision, View


@dataclass(frozen=True)
class ClosestFrontier(Searching):
    """Find the shortest path from any particle to a frontier cell, send its commands, and repeat.

    A path always classifies its target cell: if another particle blocks the moving particle, the other particle follows the rest of
    the path. The number of moves is at most m(3m + 1) in 2-D, where m is the number of free cells. Theorem 2 of paper M states
    m(m+1)/2, because the theorem ignores the walls. Source: paper M, algorithm 3. Rules for ties: docs/concepts/policies.md.
    """

    kind: ClassVar[str] = "closest-frontier"
    code: ClassVar[int] = 2

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the commands of the path to the nearest frontier cell."""
        path = path_to_frontier(
            view.belief,
            view.occupied,
            rule=view.rule,
            mapping=view.mapping,
            ties=self.ties,
            neighbours=self.neighbours,
        )
        return path, None
