"""elect-particle: plan for one particle only, and let whoever is in its way take over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from numpy.random import Generator

from shoal.swarm.boards import Board
from shoal.swarm.policies.compiled import Searching
from shoal.swarm.policies.driven import step_from
from shoal.swarm.policies.protocol import Decision, View


@dataclass(frozen=True)
class _Elected:
    cell: tuple[int, ...]
    plan: str
    target: tuple[int, ...]


@dataclass(frozen=True)
class ElectParticle(Searching):
    """Elect a random particle; go to the frontier cell nearest to it; replan as soon as that is settled.

    If another particle holds the elected one up, that particle stands where the elected one should be and becomes the elected one.
    Without this handover the literal algorithm can cycle for ever. Source: paper M, algorithm 2; spec/swarm.md, section 3.
    """

    kind: ClassVar[str] = "elect-particle"
    code: ClassVar[int] = 3
    rules: ClassVar[frozenset[str]] = frozenset({"block", "merge"})

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next command of the elected particle's path."""
        if memory is None:
            cells = view.occupied.cells
            cell, plan, target = tuple(cells[rng.integers(0, len(cells))].tolist()), "", ()
        else:
            intended = step_from(memory.cell, memory.plan[0])
            cell = intended if intended in view.occupied else memory.cell
            plan, target = memory.plan[1:], memory.target
        if not plan or target not in view.belief.frontier:
            plan, target = self._plan(view, cell)
        return plan[:1], _Elected(cell, plan, target)

    def _plan(self, view: View, cell: tuple[int, ...]) -> tuple[str, tuple[int, ...]]:
        from shoal.swarm.engine import path_to_frontier

        source = Board.of_cells(view.occupied.frame, [cell])
        plan = path_to_frontier(view.belief, source, ties=self.ties, neighbours=self.neighbours)
        for command in plan:
            cell = step_from(cell, command)
        return plan, cell
