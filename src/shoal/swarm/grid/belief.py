"""Belief: the known state of each cell and the frontier cells of the task."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.swarm.grid.board import Board
from shoal.swarm.maps.raster import FREE, FRONTIER, OBSTACLE, PARTICLE, UNKNOWN, raster_of


@dataclass(frozen=True)
class Belief:
    """The belief: the known state of each cell.

    Parameters
    ----------
    open : Board
        Cells known to be free because a particle has been there.
    known : Board
        Cells known to be free or known to be obstacles.
    frontier : Board
        Mapping: unknown cells beside known free cells. Coverage: target cells that no particle has visited. A task is complete when
        its frontier is empty.

    Notes
    -----
    Source: paper M, section III.B; docs/concepts/belief.md. The rim around the workspace is unknown at first, like all other cells.
    """

    open: Board
    known: Board
    frontier: Board

    @property
    def obstacles(self) -> Board:
        """The cells that are known to be obstacles, including cells of the rim."""
        return self.known - self.open

    @property
    def complete(self) -> bool:
        """Whether the frontier is empty."""
        return not self.frontier

    @property
    def states(self) -> NDArray[np.uint8]:
        """Codes of the cells of the window (UNKNOWN, FRONTIER, FREE or OBSTACLE); uint8, with a rim of one cell on each side."""
        states = np.full(self.open.layout.window, UNKNOWN, dtype=np.uint8)
        states[self.known.mask] = OBSTACLE
        states[self.open.mask] = FREE
        states[self.frontier.mask] = FRONTIER
        return states

    def picture(self, occupied: Board) -> NDArray[np.uint8]:
        """Return a picture of the belief and the particles, one pixel per cell, including the rim; uint8, shape (H, W, 3)."""
        codes = self.states
        codes[occupied.mask] = PARTICLE
        return raster_of(codes)

    def observed(self, command: str, before: Board, after: Board) -> Belief:
        """Return the belief after one push moved the particles from ``before`` to ``after``.

        The push classifies the unknown cells that particles tried to enter. A cell that a particle tried to enter is free if
        it holds a particle after the push, and an obstacle otherwise.
        """
        tried = before.shifted(command) - self.known
        if not tried:
            return self
        found = tried & after
        known = self.known | tried
        return Belief(self.open | found, known, (self.frontier | found.dilated()) - known)

    def covered(self, after: Board) -> Belief:
        """Return the belief after removing the cells of ``after`` from the frontier."""
        return Belief(self.open, self.known, self.frontier - after)
