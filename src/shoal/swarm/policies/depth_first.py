"""Policy depth-first: one particle explores the cells by depth-first search with backtracking."""

from __future__ import annotations

from dataclasses import field
from typing import Any, ClassVar

from numpy.random import Generator

from shoal.core.dataclass import dataclass
from shoal.swarm.grid.commands import letters_of
from shoal.swarm.policies.compiled_policy import Compiled
from shoal.swarm.policies.paths import OPPOSITE, step_from
from shoal.swarm.policies.protocol import Decision, View


@dataclass
class _Trail:
    cell: tuple[int, ...]
    visited: set[tuple[int, ...]]
    commands: list[str] = field(default_factory=list)
    last: str = ""
    backtracking: bool = False


@dataclass(frozen=True)
class DepthFirst(Compiled):
    """Move one particle through the workspace: the first particle in row-major order.

    The particle tries to enter each neighbouring cell that is unknown, or that is free and not yet visited. If the particle has
    visited all free neighbours of its cell, the particle goes back by one cell.

    In a workspace of m free cells, the particle makes at most 2(m - 1) moves between cells, and one blocked move for each wall that
    the particle finds. The number of moves between cells is at most twice the number of moves of the optimal tour of all free
    cells. On general grid graphs, no strategy has a better competitive ratio than 2. All particles obey the commands, and each
    particle can classify cells. Source: paper M, section III.B.1.
    """

    kind: ClassVar[str] = "depth-first"
    code: ClassVar[int] = 4
    runs: ClassVar[bool] = False
    rules: ClassVar[frozenset[str]] = frozenset({"block", "merge"})

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next command: a probe of a neighbour, a step, or a step back."""
        if memory is None and not view.occupied:  # only with noise
            return "", None
        if memory is None:
            cell = tuple(view.occupied.cells[0].tolist())
            trail = _Trail(cell, {cell})
        else:
            trail = self._noticed(memory, view)
        for command in letters_of(view.occupied.layout.ndim):
            ahead = step_from(trail.cell, command)
            unknown = ahead not in view.belief.known
            if unknown or (ahead in view.belief.open and ahead not in trail.visited):
                return command, _Trail(trail.cell, trail.visited, trail.commands, command)
        if not trail.commands:
            return "", trail
        back = OPPOSITE[trail.commands[-1]]
        return back, _Trail(trail.cell, trail.visited, trail.commands, back, backtracking=True)

    @staticmethod
    def _noticed(trail: _Trail, view: View) -> _Trail:
        intended = step_from(trail.cell, trail.last)
        if intended not in view.occupied:
            return trail
        if trail.backtracking:
            trail.commands.pop()
        else:
            trail.commands.append(trail.last)
            trail.visited.add(intended)
        return _Trail(intended, trail.visited, trail.commands)
