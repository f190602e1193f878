"""SeenEpisode: what was seen of a rig that slips or is seen wrongly, as an episode to draw and film."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError
from shoal.swarm.episode import Episode, Verification
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.noise.belief import NoisyBelief
from shoal.swarm.noise.episode import NONE
from shoal.swarm.noise.model import CONFIDENCE, Noise
from shoal.swarm.noise.moments import Moment, looks_of


@dataclass(frozen=True, eq=False)
class SeenEpisode(Episode):
    """A drive with noise: the commands, and what the scans showed. The workspace is the free cells that were found.

    Parameters
    ----------
    noise : Noise
        As the drive was told.
    confidence : float
    sights : tuple of ndarray of int64, shape (k, ndim)
        What each scan showed, that before the first command included.
    truth : ndarray of bool, optional
        The free cells, of the shape of the workspace, if they are known: then it can be shown what was settled wrongly.
    """

    noise: Noise = NONE
    confidence: float = CONFIDENCE
    sights: tuple[NDArray[np.int64], ...] = ()
    truth: NDArray[np.bool_] | None = None

    def moments(self) -> Iterator[Moment]:
        """Yield what there is to see at the start and after each command."""
        truth = None if self.truth is None else np.pad(self.truth, 1)
        for belief, seen in self._beliefs():
            yield Moment(seen.mask, looks_of(belief, truth))

    def frames(self) -> Iterator[tuple[SwarmState, Belief]]:
        """Yield at the start and after each command where particles are believed to be, and the belief."""
        for belief, _ in self._beliefs():
            yield SwarmState(belief.occupied), belief.belief

    def final(self) -> tuple[SwarmState, Belief]:
        """Return where particles are believed to be at the end, and the belief."""
        *_, (belief, _) = self._beliefs()
        return SwarmState(belief.occupied), belief.belief

    def verify(self) -> Verification:
        """Take in all sights again; compare the frontier after each command."""
        again = [belief.remaining for belief, _ in self._beliefs()][1:]
        if again != self.frontier.tolist():
            move = int(np.argmax(np.array(again) != self.frontier))
            return Verification(False, f"frontier differs at move {move + 1}: {self.frontier[move]} stored, {again[move]} replayed")
        return Verification(True, f"{self.scans} scans taken in again: the same belief")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Refuse: a drive is kept in its log."""
        raise InvalidInputError(f"{path}: expected an episode of a simulation, got a drive with noise, which its log keeps")

    def _beliefs(self) -> Iterator[tuple[NoisyBelief, Board]]:
        layout = GridLayout(self.workspace.shape)
        sights = (Board.of_cells(layout, cells) for cells in self.sights)
        seen = next(sights)
        belief = NoisyBelief(self.workspace.shape, seen, self.noise, self.confidence)
        yield belief, seen
        for command, scanned in zip(self.commands, self.scanned.tolist(), strict=True):
            if scanned:
                seen = next(sights)
                belief.update(command, seen)
            else:
                belief.spread(command)
            yield belief, seen
