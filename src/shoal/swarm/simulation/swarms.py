"""Simulated swarms, with and without noise."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.swarm.grid.board import encode, noise_rng
from shoal.swarm.grid.scans import AXES, Row, states_of_run
from shoal.swarm.grid.state import Belief, SwarmState
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.kernels import noise as noisy_state
from shoal.swarm.noise import NoisyBelief, noisy_belief
from shoal.swarm.problem import SwarmSetup


class ExactSwarm:
    """A simulated swarm without noise, for the closed loop: particles in a world, with the belief
    of a task.

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
                # the previous command moved no particle either, and it found the walls
                if still and stuck:
                    continue
                travelled += distance_of_push(self.state, after, command)
                updated = self.task.update(
                    self.belief, command, self.state.occupied, after.occupied
                )
                classified += newly_classified(self.belief, updated)
                self.state, self.belief = after, updated
            rows.append((classified, len(self.belief.frontier), travelled))
        return rows, True

    def _pushes(self, command: str, steps: int) -> Iterator[Iterator[SwarmState]]:
        """Yield, for each command of a run, the states of the swarm after the command's pushes.

        If a run has several commands, the method infers the states from the states before and after
        the run.
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

    The number of moved particles equals the change of the sum of all particle coordinates along the
    direction of the command.
    """
    axis, sign = AXES[command]
    return sign * int(after.cells[:, axis].sum() - before.cells[:, axis].sum())


def newly_classified(before: Belief, after: Belief) -> int:
    """Return the number of cells that a push classified: newly known cells in a mapping, newly
    covered cells in a coverage, or in a gathering by how many the cells to gather became fewer,
    which is negative if particles leave the region.
    """
    learnt = len(after.known) - len(before.known)
    return learnt if learnt else len(before.frontier) - len(after.frontier)


class NoisySwarm:
    """A simulated swarm with noise, for the closed loop. The arrays of the swarm's belief contain
    the true state of the particles.

    Parameters
    ----------
    noisy : NoisyBelief
        The belief of the swarm. Commands and scans change the belief object in place.
    rng : Generator
        Generator of the random numbers for the noise.
    """

    rule = "block"

    def __init__(self, noisy: NoisyBelief, rng: Generator) -> None:
        self.noisy, self.rng = noisy, rng
        self._take_over()

    def _take_over(self) -> None:
        self.belief, self.state = self.noisy.belief, SwarmState(self.noisy.occupied)

    @property
    def finished(self) -> bool:
        """Whether no frontier cell is in reach of the particles, and the policy has given up no
        cell as undecidable.
        """
        return self.noisy.finished

    def carry_out(self, command: str, steps: int, *, scan: bool) -> tuple[list[Row], bool]:
        """Send the command ``steps`` times. Scan after the last command if ``scan`` is true."""
        code, rows = encode(command, ndim=self.noisy.layout.ndim)[0], []
        for step in range(1, steps + 1):
            travelled, classified = int(noisy_state.move_noisy(self.noisy.state, code, self.rng)), 0
            if scan and step == steps:
                noisy_state.look(self.noisy.state, self.rng)
                classified = self.noisy.learn(code)
            else:
                self.noisy.spread_code(code)
            rows.append((classified, self.noisy.remaining, travelled))
        self._take_over()
        return rows, scan


def begin_swarm(
    setup: SwarmSetup,
    start: NDArray[np.int64],
    targets: NDArray[np.bool_] | None,
    seed: int,
    trial: int = 0,
) -> ExactSwarm | NoisySwarm:
    """Return the swarm at the start of an episode. ``seed`` and ``trial`` determine the noise."""
    problem = setup.problem
    if problem.noise is not None:
        rng = noise_rng(seed, trial)
        return NoisySwarm(
            noisy_belief(setup.workspace, start, problem.noise, problem.confidence, rng), rng
        )
    world = GridWorld(setup.workspace, problem.rule)
    state = world.initial(start)
    return ExactSwarm(world, setup.task, state, setup.task.begin(world, state, targets))
