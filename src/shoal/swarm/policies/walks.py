"""Policies that follow a fixed rule: depth-first, sweep and manual."""

from __future__ import annotations

from dataclasses import field
from typing import Any, ClassVar

from numpy.random import Generator

from shoal.core.dataclass import dataclass
from shoal.swarm.grid.board import GridLayout, encode, letters_of
from shoal.swarm.policies.compiled import Compiled
from shoal.swarm.policies.protocol import OPPOSITE, Decision, View, step_from


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

    The particle tries to enter each neighbouring cell that is unknown, or that is free and not yet
    visited. If the particle has visited all free neighbours of its cell, the particle goes back by
    one cell.

    In a workspace of m free cells, the particle makes at most 2(m - 1) moves between cells, and one
    blocked move for each wall that the particle finds. The number of moves between cells is at most
    twice the number of moves of the optimal tour of all free cells. On general grid graphs, no
    strategy has a better competitive ratio than 2. All particles obey the commands, and each
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


@dataclass(frozen=True)
class _Phase:
    phase: int = (
        0  # phase: 0 towards the left wall, 1 up and right, 2 down and left, 3 one cycle finished
    )
    second: bool = False
    gain: int = 0


@dataclass(frozen=True)
class WallSweep(Compiled):
    """Sweep a column of particles across a rectangle, to the right and back to the left.

    The policy first pushes all particles to the left, against the wall. On the way to the right,
    the policy alternates the commands up and right until no particle moves right. On the way back,
    the policy alternates the commands down and left. The way to the right and the way back form one
    cycle. The policy repeats the cycle until a whole cycle classifies no cell. The episode then
    ends as stalled.

    Consider a rectangle with m free cells and a height of k cells. If k particles start along the
    left wall (placement left-wall), the policy needs 4m/k moves. The policy sweep is suitable for
    rectangles only. Source: paper D, section III.B.2.
    """

    kind: ClassVar[str] = "sweep"
    code: ClassVar[int] = 5
    runs: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (2,)

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next command of the sweep's cycle."""
        now = _Phase() if memory is None else self._noticed(memory, view)
        if now.phase == 3:
            if now.gain == 0:
                return "", now
            now = _Phase(phase=1)
        return ("l", "ur", "dl")[now.phase][now.second], now

    @staticmethod
    def _noticed(now: _Phase, view: View) -> _Phase:
        gain = now.gain + view.classified
        if now.phase == 0 or now.second:
            return _Phase(now.phase + (view.travelled == 0), False, gain)
        return _Phase(now.phase, True, gain)


@dataclass(frozen=True)
class Manual(Compiled):
    """Send the given commands. If the commands end before the task is complete, the episode is
    stalled.

    Parameters
    ----------
    commands : str
        Command letters, for example "llurr".
    """

    kind: ClassVar[str] = "manual"
    code: ClassVar[int] = 0
    commands: str = ""

    def check(self, layout: GridLayout, rule: str) -> None:
        """Refuse a text with letters that are not commands."""
        super().check(layout, rule)
        encode(self.commands, ndim=layout.ndim)

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return all commands at the first decision, and no commands at later decisions."""
        return (self.commands if memory is None else ""), "sent"
