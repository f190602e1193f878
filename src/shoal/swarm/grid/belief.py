"""Belief: what is known of the workspace, and what is left to do."""

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
        Cells known to be free: a particle has stood there.
    known : Board
        Cells known to be free or obstacle.
    frontier : Board
        Mapping: unknown cells next to a known-free one. Coverage: cells that no particle has stood in yet. A task is complete
        when it is empty.

    Notes
    -----
    Source: paper M, section III.B; docs/concepts/belief.md. The rim around the workspace is unknown at first, as any other cell.
    """

    open: Board
    known: Board
    frontier: Board

    @property
    def obstacles(self) -> Board:
        """Cells known to be obstacles, those of the rim included."""
        return self.known - self.open

    @property
    def complete(self) -> bool:
        """True when nothing is left to do."""
        return not self.frontier

    @property
    def states(self) -> NDArray[np.uint8]:
        """UNKNOWN, FRONTIER, FREE or OBSTACLE of each cell of the window; uint8, one cell of rim on each side."""
        states = np.full(self.open.layout.window, UNKNOWN, dtype=np.uint8)
        states[self.known.mask] = OBSTACLE
        states[self.open.mask] = FREE
        states[self.frontier.mask] = FRONTIER
        return states

    def picture(self, occupied: Board) -> NDArray[np.uint8]:
        """Return a picture of what is known and where the particles are, one pixel a cell, rim included; uint8, (H, W, 3)."""
        codes = self.states
        codes[occupied.mask] = PARTICLE
        return raster_of(codes)

    def observed(self, command: str, before: Board, after: Board) -> Belief:
        """Return the belief after particles that stood at ``before`` were pushed once and then stand at ``after``.

        Each unknown cell that some particle tried to enter is free if a particle stands in it now, else obstacle.
        """
        tried = before.shifted(command) - self.known
        if not tried:
            return self
        found = tried & after
        known = self.known | tried
        return Belief(self.open | found, known, (self.frontier | found.dilated()) - known)

    def covered(self, after: Board) -> Belief:
        """Return the belief without the cells of ``after`` on the frontier."""
        return Belief(self.open, self.known, self.frontier - after)
