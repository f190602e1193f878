"""closest-frontier: bring the nearest particle to the nearest frontier cell."""

from __future__ import annotations

from typing import Any, ClassVar

from numpy.random import Generator

from shoal.core.dataclass import dataclass
from shoal.swarm.policies.compiled_policy import Searching
from shoal.swarm.policies.paths import path_to_frontier
from shoal.swarm.policies.protocol import Decision, View


@dataclass(frozen=True)
class ClosestFrontier(Searching):
    """Search from all particles to the nearest frontier cell, play the whole path, repeat.

    Playing the path always classifies its target: a particle that is held up on the way is held up by one that stands where it
    should be. At most m(3m + 1) moves in 2-D, m the number of free cells (theorem 2 of paper M says m(m+1)/2, which leaves out
    the walls). Source: paper M, algorithm 3; ties: docs/concepts/policies.md.
    """

    kind: ClassVar[str] = "closest-frontier"
    code: ClassVar[int] = 2

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the path to the nearest frontier cell."""
        path = path_to_frontier(
            view.belief,
            view.occupied,
            rule=view.rule,
            mapping=view.mapping,
            ties=self.ties,
            neighbours=self.neighbours,
        )
        return path, None
