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
    """Find the shortest path from any particle to any frontier cell, send the commands of the path, and repeat.

    The commands of a path always classify the frontier cell at its end. If another particle blocks the moving particle, the
    blocking particle follows the rest of the path. In 2-D, the policy needs at most m(3m + 1) moves, where m is the number of free
    cells. Theorem 2 of paper M states a bound of m(m+1)/2 moves, which ignores the moves that probe walls. Source: paper M,
    algorithm 3. The page docs/concepts/policies.md explains the choice between equally short paths.
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
