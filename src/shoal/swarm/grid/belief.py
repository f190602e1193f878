"""Belief: the known state of each cell and the frontier cells of the task."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.swarm.grid.board import Board
from shoal.swarm.maps.raster import FREE, FRONTIER, OBSTACLE, PARTICLE, UNKNOWN, raster_of


@dataclass(frozen=True)
class Belief:
    """The belief of a task: the known state of each cell.

    Parameters
    ----------
    open : Board
        Cells that are known to be free. In a mapping, these are the cells in which a particle has been. In a coverage, these are
        all free cells.
    known : Board
        All classified cells: cells that are known to be free, and cells that are known to be obstacles.
    frontier : Board
        In a mapping, the unknown cells beside known free cells. In a coverage, the target cells that no particle has visited. A
        task is complete when its belief has no frontier cells left.

    Notes
    -----
    At the start of a mapping, the rim cells around the workspace are unknown, like all cells without a particle. Sources: paper M,
    section III.B, and docs/concepts/belief.md.
    """

    open: Board
    known: Board
    frontier: Board

    @property
    def obstacles(self) -> Board:
        """The cells that are known to be obstacles, including rim cells outside the workspace."""
        return self.known - self.open

    @property
    def complete(self) -> bool:
        """Whether the belief has no frontier cells left, so that the task is complete."""
        return not self.frontier

    @property
    def states(self) -> NDArray[np.uint8]:
        """The code of each cell of the workspace and its rim: UNKNOWN, FRONTIER, FREE or OBSTACLE (uint8)."""
        states = np.full(self.open.layout.window, UNKNOWN, dtype=np.uint8)
        states[self.known.mask] = OBSTACLE
        states[self.open.mask] = FREE
        states[self.frontier.mask] = FRONTIER
        return states

    def picture(self, occupied: Board) -> NDArray[np.uint8]:
        """Return a picture of the belief and the particles, with one pixel per cell, including the rim (uint8, shape (H, W, 3))."""
        codes = self.states
        codes[occupied.mask] = PARTICLE
        return raster_of(codes)

    def observed(self, command: str, before: Board, after: Board) -> Belief:
        """Return the belief of a mapping after one push, in which all particles try to move by one cell.

        ``before`` and ``after`` are the cells that hold particles before and after the push. The push classifies each unknown cell
        that a particle tries to enter. The cell is free if it holds a particle after the push, and otherwise an obstacle.
        """
        tried = before.shifted(command) - self.known
        if not tried:
            return self
        found = tried & after
        known = self.known | tried
        return Belief(self.open | found, known, (self.frontier | found.dilated()) - known)

    def covered(self, after: Board) -> Belief:
        """Return the belief of a coverage after one push. The cells ``after``, which now hold particles, leave the frontier."""
        return Belief(self.open, self.known, self.frontier - after)
