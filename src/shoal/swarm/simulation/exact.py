"""A simulated swarm without noise.

Each command makes a new state and a new belief. The old state and the old belief stay unchanged.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.scans import AXES, states_of_run
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.grid.trace import Row
from shoal.swarm.grid.world import GridWorld


class ExactSwarm:
    """A simulated swarm without noise, for the closed loop: particles in a world, with the belief of a task.

    Parameters
    ----------
    world : GridWorld
    task : Task
    state : SwarmState
    belief : Belief
        The belief at the start of the episode.
    """

    def __init__(self, world: GridWorld, task: Any, state: SwarmState, belief: Belief) -> None:
        self.world, self.task, self.state, self.belief = world, task, state, belief

    @property
    def rule(self) -> str:
        """Name of the move rule: "block", "merge" or "tilt"."""
        return self.world.rule

    @property
    def finished(self) -> bool:
        """Whether the belief has no frontier cells left."""
        return self.belief.complete

    def carry_out(self, command: str, steps: int, *, scan: bool = True) -> tuple[list[Row], bool]:
        """Send the command ``steps`` times, and update the state and the belief."""
        rows, stuck = [], False
        for pushes in self._pushes(command, steps):
            travelled = classified = 0
            for after in pushes:
                still, stuck = stuck, after is self.state
                if still and stuck:  # the previous command moved no particle either, and it found the walls
                    continue
                travelled += distance_of_push(self.state, after, command)
                updated = self.task.update(self.belief, command, self.state.occupied, after.occupied)
                classified += newly_classified(self.belief, updated)
                self.state, self.belief = after, updated
            rows.append((classified, len(self.belief.frontier), travelled))
        return rows, True

    def _pushes(self, command: str, steps: int) -> Iterator[Iterator[SwarmState]]:
        """Yield, for each command of a run, the states of the swarm after the command's pushes.

        If a run has several commands, the method infers the states from the states before and after the run.
        """
        if steps == 1:
            yield self.world.pushes(self.state, command)
            return
        after = self.state
        for _ in range(steps):
            before, after = after, self.world.step(after, command)
            if after == before:  # the same holds for the rest of the run
                break
        for between in states_of_run(self.state, after, command, steps):
            yield iter([between])


def distance_of_push(before: SwarmState, after: SwarmState, command: str) -> int:
    """Return the number of particles that a push moved by one cell.

    The number of moved particles equals the change of the sum of all particle coordinates along the direction of the command.
    """
    axis, sign = AXES[command]
    return sign * int(after.cells[:, axis].sum() - before.cells[:, axis].sum())


def newly_classified(before: Belief, after: Belief) -> int:
    """Return the number of cells that a push classified: newly known cells in a mapping, or newly covered cells in a coverage."""
    learnt = len(after.known) - len(before.known)
    return learnt if learnt else len(before.frontier - after.frontier)
