"""Runs of any policy under noise: it is asked again after each scan, and ended when nothing comes of it any more."""

from __future__ import annotations

from typing import Any

from numpy.random import Generator

from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.commands import encode, letters_of
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.kernels.noisy_play import PATIENCE, TIMES
from shoal.swarm.policies import Policy, View
from shoal.swarm.stepwise import decided

LONG = 20


class AskedRuns:
    """One command at a time; ``due`` says whether a scan is to follow it.

    It does after ``every`` commands, and where a plan ends. A plan without memory is dropped then, as the scan may change it.
    A policy that settles no new cell for `LONG` times the moves that closest-frontier may take across all free cells known is
    stopped, so that every episode ends.
    """

    def __init__(self, policy: Policy, rng: Generator, every: int = 1) -> None:
        self.policy, self.rng, self.every = policy, rng, every
        self.unseen, self.due = 0, True
        self.memory: Any = None
        self.plan, self.in_vain, self.wakes = "", 0, 0

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the next command; see `shoal.swarm.stepwise.Runs`."""
        self.in_vain = 0 if view.done else self.in_vain + 1
        if self.in_vain > LONG * (PATIENCE + TIMES * len(view.belief.open)):
            return None
        if not view.belief.open:  # scans that are often wrong need a few moves to be sure of a first free cell
            self.wakes, self.unseen, self.due = self.wakes + 1, 0, True
            letters = letters_of(view.occupied.layout.ndim)
            return (letters[(self.wakes - 1) % len(letters)], 1) if self.wakes <= PATIENCE else None
        if view.belief.complete:
            return None
        if not self.plan:
            self.plan, self.memory = decided(self.policy, view, self.memory, self.rng)
            if not self.plan:
                return None
            encode(self.plan, ndim=view.occupied.layout.ndim)
        command, self.plan = self.plan[0], self.plan[1:]
        self.due = self.unseen + 1 >= self.every or not self.plan
        self.unseen = 0 if self.due else self.unseen + 1
        if self.due and self.memory is None:
            self.plan = ""
        return command, 1

    def scan_after(self, belief: Belief, state: SwarmState, learnt: int) -> bool:
        """Tell whether the scan after the last command was due."""
        return self.due
