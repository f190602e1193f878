"""Policy random-moves: draw each command uniformly at random."""

from __future__ import annotations

from typing import Any, ClassVar

from numpy.random import Generator

from shoal.core.dataclass import dataclass
from shoal.swarm.grid.commands import letters_of
from shoal.swarm.policies.compiled_policy import Compiled
from shoal.swarm.policies.protocol import Decision, View


@dataclass(frozen=True)
class RandomMoves(Compiled):
    """Send uniformly random commands. Source: paper M, algorithm 1."""

    kind: ClassVar[str] = "random-moves"
    code: ClassVar[int] = 1

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return one random command."""
        letters = letters_of(view.occupied.layout.ndim)
        return letters[rng.integers(0, len(letters))], None
