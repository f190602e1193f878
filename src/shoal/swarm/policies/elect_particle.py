"""Policy elect-particle: plan the moves of one elected particle.

If another particle blocks the path, elect the blocking particle.
"""

from __future__ import annotations

from typing import Any, ClassVar

from numpy.random import Generator

from shoal.core.dataclass import dataclass
from shoal.swarm.grid.board import Board
from shoal.swarm.policies.compiled_policy import Searching
from shoal.swarm.policies.paths import route_to_frontier, step_from
from shoal.swarm.policies.protocol import Decision, View


@dataclass(frozen=True)
class _Elected:
    cell: tuple[int, ...]
    plan: str
    target: tuple[int, ...]


@dataclass(frozen=True)
class ElectParticle(Searching):
    """Elect a random particle and move it along the shortest path to a frontier cell.

    The policy plans a new path when the frontier cell at the end of the path is classified. If another particle blocks the elected
    particle, the other particle becomes the elected particle. The algorithm of paper M never changes the elected particle, and can
    therefore repeat a sequence of moves forever. Sources: paper M, algorithm 2, and docs/concepts/policies.md.
    """

    kind: ClassVar[str] = "elect-particle"
    code: ClassVar[int] = 3
    runs: ClassVar[bool] = False
    rules: ClassVar[frozenset[str]] = frozenset({"block", "merge"})

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next command of the elected particle's path."""
        plan = ""
        target: tuple[int, ...] = ()
        if memory is None and not view.occupied:  # only with noise
            return "", None
        if memory is None:
            cells = view.occupied.cells
            cell = tuple(cells[rng.integers(0, len(cells))].tolist())
        else:
            intended = step_from(memory.cell, memory.plan[0])
            entered = intended in view.occupied
            cell = intended if entered else memory.cell
            plan, target = memory.plan[1:] if entered else "", memory.target
            if cell not in view.occupied:  # only with noise: the particle was lost from view
                cells = view.occupied.cells
                cell = tuple(cells[rng.integers(0, len(cells))].tolist()) if len(cells) else cell
                plan = ""
        if not plan or target not in view.belief.frontier:
            plan, cell = self._plan(view, cell)
            target = cell
            for command in plan:
                target = step_from(target, command)
        return plan[:1], _Elected(cell, plan, target)

    def _plan(self, view: View, cell: tuple[int, ...]) -> tuple[str, tuple[int, ...]]:
        """Return a path to a frontier cell, and the start cell of the path.

        If the particle at ``cell`` can reach no frontier cell, return the path of the particle that is nearest to the frontier.
        """
        plan, start = "", cell
        for sources in (Board.of_cells(view.occupied.layout, [cell]), view.occupied):
            plan, start = route_to_frontier(
                view.belief, sources, rule="block", mapping=view.mapping, ties=self.ties, neighbours=self.neighbours
            )
            if plan:
                break
        return plan, start
