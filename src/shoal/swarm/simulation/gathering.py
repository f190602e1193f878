"""The closed loop of a gathering, with commands of any policy and moves in compiled code."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.random import Generator

from shoal.core.episode import Status
from shoal.swarm.grid.board import Board, encode
from shoal.swarm.grid.scans import Trace
from shoal.swarm.grid.state import RULE_CODES, Belief, SwarmState, board_of, field_of, state_of
from shoal.swarm.kernels import gathering as kernels
from shoal.swarm.kernels.moves import RUNNING, STALLED
from shoal.swarm.policies.protocol import Policy, View
from shoal.swarm.simulation.compiled import largest_piece
from shoal.swarm.simulation.loop import PATIENCE, decided
from shoal.swarm.simulation.swarms import ExactSwarm


class GatheringGame:
    """An episode of a gathering, for `shoal.swarm.simulation.compiled.compiled_loop`.

    Parameters
    ----------
    policy : Policy
    swarm : ExactSwarm
        The swarm at the start. The game changes no part of it.
    targets : Board or None
        The region.
    rng : Generator
    """

    def __init__(
        self, policy: Policy, swarm: ExactSwarm, targets: Board | None, rng: Generator
    ) -> None:
        self.policy, self.rng, self.targets = policy, rng, targets
        self.rule, self.layout = swarm.rule, swarm.state.occupied.layout
        self.field = field_of(swarm.world.free.words, swarm.state, swarm.belief)
        self.largest = largest_piece(self.field)
        self.region = np.zeros(0, np.uint64) if targets is None else targets.words.flatten()
        self.left = np.array([len(swarm.belief.frontier), 0])
        self.memory: Any = None
        self.plan, self.at, self.moves, self.last = np.zeros(0, np.int8), 0, 0, (0, 0)

    def play_on(self, trace: Trace, limit: int) -> tuple[int, int]:
        """Compute one piece of the episode, as `Game` describes. A scan follows each command."""
        moves, status = 0, RUNNING
        while moves < trace.moves and status == RUNNING:
            if self.at >= self.plan.size and not self._decide():
                return moves, STALLED
            section = trace.part(moves, trace.moves)
            played, status = kernels.follow(
                self.field,
                RULE_CODES[self.rule],
                self.region,
                self.plan,
                self.at,
                section,
                self.left,
            )
            self.at, moves, self.moves = self.at + played, moves + played, self.moves + played
            end = trace.part(moves - 1, moves)
            self.last = int(end.travelled[0]), int(end.classified[0])
        return moves, int(status)

    def _decide(self) -> bool:
        """Let the policy choose the next commands. Return whether there are any."""
        state, belief = self.final
        mapping, about = False, (self.moves, *self.last, self.targets)
        view = View(belief, state.occupied, self.rule, mapping, *about)
        plan, self.memory = decided(self.policy, view, self.memory, self.rng)
        self.plan, self.at = encode(plan, ndim=self.layout.ndim), 0
        return bool(plan) and self.left[1] < PATIENCE

    @property
    def remaining(self) -> int:
        """Number of cells with particles that are not gathered yet."""
        return int(self.left[0])

    def cut(self, trace: Trace) -> Status:
        """Return the status ``limit``, because a scan follows each command."""
        return Status.LIMIT

    @property
    def final(self) -> tuple[SwarmState, Belief]:
        """Return the current state of the swarm and the current belief."""
        field = self.field._replace(occupied=self.field.occupied.copy())
        boards = (field.open, field.known, field.frontier.copy())
        return state_of(self.layout, field), Belief(
            *(board_of(self.layout, words) for words in boards)
        )
