"""How right a map is that was made with noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board
from shoal.swarm.maps.workspace import GridWorkspace


@dataclass(frozen=True)
class MapErrors:
    """How right a map is, over the cells that a mapping without noise would classify.

    Parameters
    ----------
    free, walls : int
        Cells that particles can reach, and the obstacles beside them.
    false_free : int
        Obstacles classified as free.
    false_obstacles : int
        Free cells classified as obstacles.
    undecided : int
        Cells that are not classified.
    """

    free: int
    walls: int
    false_free: int
    false_obstacles: int
    undecided: int

    @classmethod
    def of(cls, workspace: GridWorkspace, start: NDArray[np.int64], belief: Belief) -> MapErrors:
        """Compare the belief at the end with the workspace in which particles started at ``start``."""
        labels = workspace.components
        reached = Board.of_mask(workspace.free & np.isin(labels, np.unique(labels[tuple(start.T)])))
        walls = reached.dilated() - reached
        return cls(
            free=len(reached),
            walls=len(walls),
            false_free=len(belief.open & walls),
            false_obstacles=len(belief.obstacles & reached),
            undecided=len((reached | walls) - belief.known),
        )

    @property
    def right(self) -> float:
        """Share of the cells that are classified as what they are."""
        cells = self.free + self.walls
        return 1 - (self.false_free + self.false_obstacles + self.undecided) / cells

    @property
    def false_free_rate(self) -> float:
        """Share of the walls that are classified as free."""
        return self.false_free / max(1, self.walls)

    @property
    def false_obstacle_rate(self) -> float:
        """Share of the free cells that are classified as obstacles."""
        return self.false_obstacles / max(1, self.free)
