"""NoisyEpisode: an episode with noise, and how right its map is."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.swarm.episode import Episode, Verification
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.kernels import noise, noisy_play
from shoal.swarm.noise.belief import NoisyBelief, inner_of
from shoal.swarm.noise.model import CONFIDENCE, Noise
from shoal.swarm.noise.moments import Moment, looks_of
from shoal.swarm.noise.plant import seen_board, truth_of

NONE = Noise()


@dataclass(frozen=True)
class MapErrors:
    """How right a map is, over the cells that a mapping without noise would classify.

    Parameters
    ----------
    free, walls : int
        Cells that particles can reach, and the obstacles beside them.
    false_free : int
        Obstacles settled as free.
    false_obstacles : int
        Free cells settled as obstacles.
    undecided : int
        Cells that are not settled.
    """

    free: int
    walls: int
    false_free: int
    false_obstacles: int
    undecided: int

    @property
    def right(self) -> float:
        """Share of the cells that are settled as what they are."""
        cells = self.free + self.walls
        return 1 - (self.false_free + self.false_obstacles + self.undecided) / cells

    @property
    def false_free_rate(self) -> float:
        """Share of the walls that are settled as free."""
        return self.false_free / max(1, self.walls)

    @property
    def false_obstacle_rate(self) -> float:
        """Share of the free cells that are settled as obstacles."""
        return self.false_obstacles / max(1, self.free)


@dataclass(frozen=True, eq=False)
class NoisyEpisode(Episode):
    """One run of a policy on a mapping with noise; see `shoal.swarm.Episode` for what both have.

    ``done`` counts the cells that a move settles for the first time. ``status`` is "complete" if every cell is settled that
    lies beside a free one and that a particle could get to; "stalled" if some had to be left undecided.

    Parameters
    ----------
    noise : Noise
        Its randomness was ``default_rng(SeedSequence(seed, spawn_key=(trial, 1)))``.
    confidence : float
    """

    noise: Noise = NONE
    confidence: float = CONFIDENCE

    @cached_property
    def probability(self) -> NDArray[np.float64]:
        """Probability at the end that each cell is free; float64, the shape of the workspace with one cell of rim."""
        return self._end[0].probability

    @cached_property
    def errors(self) -> MapErrors:
        """How right the map is at the end."""
        world, belief = self.workspace, self._end[0].belief
        labels = world.components
        reached = Board.of_mask(world.free & np.isin(labels, np.unique(labels[tuple(self.start.T)])))
        walls = reached.dilated() - reached
        return MapErrors(
            free=len(reached),
            walls=len(walls),
            false_free=len(belief.open & walls),
            false_obstacles=len(belief.obstacles & reached),
            undecided=len((reached | walls) - belief.known),
        )

    def frames(self) -> Iterator[tuple[SwarmState, Belief]]:
        """Yield at the start and after each move where particles are believed to be, and the belief."""
        for belief in self._beliefs():
            yield SwarmState(belief.occupied), belief.belief

    def moments(self) -> Iterator[Moment]:
        """Yield at the start and after each move where the particles are, and what the belief holds of each cell."""
        shape, truth = self.workspace.shape, np.pad(self.workspace.free, 1)
        for belief in self._beliefs():
            particles = np.array(inner_of(belief.haze.there, shape, rim=1), dtype=np.bool_)
            yield Moment(particles, looks_of(belief, truth))

    def _beliefs(self) -> Iterator[NoisyBelief]:
        """Yield the belief, which changes in place, at the start and after each move."""
        belief, rng = self._begin()
        yield belief
        for code, scanned in zip(self.codes, self.scanned.tolist(), strict=True):
            noise.move_hazy(belief.haze, code, rng)
            if scanned:
                noise.look(belief.haze, rng)
                belief.learn(code)
            else:
                belief.foretell(code)
            yield belief

    def final(self) -> tuple[SwarmState, Belief]:
        """Return where particles are believed to be at the end, and the belief."""
        belief = self._end[0]
        return SwarmState(belief.occupied), belief.belief

    def verify(self) -> Verification:
        """Replay the commands and scans with the same noise; compare all metrics."""
        log = self._end[1]
        for name in ("done", "frontier", "travelled"):
            mine, theirs = getattr(self, name), getattr(log, name)
            if (mine != theirs).any():
                move = int(np.argmax(mine != theirs))
                return Verification(False, f"{name} differs at move {move + 1}: {mine[move]} stored, {theirs[move]} replayed")
        wrong = self._wrong_scan()
        if wrong is not None:
            return Verification(False, wrong)
        return Verification(True, f"{self.moves} moves of {self.n_particles} particles with noise replayed: all the same")

    def _wrong_scan(self) -> str | None:
        """Return what is wrong with the scans, None if they fit the rule; unlike without noise a plan may turn before its scan."""
        unseen, most = 0, self.scanning.step
        for move, scan in enumerate(self.scanned.tolist(), start=1):
            unseen = 0 if scan else unseen + 1
            if unseen == most:
                return f"no scan after move {move}, {most} moves after the one before"
        return f"no scan after the last move, {self.moves}" if unseen else None

    @cached_property
    def _end(self) -> tuple[NoisyBelief, noisy_play.Log]:
        """The belief at the end, and the metrics as replayed."""
        belief, rng = self._begin()
        log = new_log(self.moves)
        log.commands[:], log.scanned[:] = self.codes, self.scanned
        belief.follow(rng, log)
        return belief, log

    def _begin(self) -> tuple[NoisyBelief, Generator]:
        rng = noise_rng(self.seed, self.trial)
        haze = truth_of(self.workspace, self.start, self.noise, self.confidence)
        noise.look(haze, rng)
        layout = GridLayout(self.workspace.shape)
        return NoisyBelief(layout.shape, seen_board(haze, layout), self.noise, self.confidence, haze=haze), rng


def noise_rng(seed: int, trial: int) -> Generator:
    """Return the generator of a trial's noise."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(trial, 1)))


def new_log(moves: int) -> noisy_play.Log:
    """Return an empty log with room for that many moves."""
    return noisy_play.Log(
        commands=np.zeros(moves, np.int8),
        done=np.zeros(moves, np.int32),
        frontier=np.zeros(moves, np.int32),
        travelled=np.zeros(moves, np.int64),
        scanned=np.zeros(moves, np.bool_),
    )
