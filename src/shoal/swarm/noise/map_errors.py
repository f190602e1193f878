"""Errors in a map that a swarm built from noisy observations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board
from shoal.swarm.maps.workspace import GridWorkspace


@dataclass(frozen=True)
class MapErrors:
    """The number of cells that a mapping with noise classified wrongly, and the number of cells that it left undecided.

    The numbers include only cells that a mapping without noise would classify.

    Parameters
    ----------
    free, walls : int
        ``free`` is the number of free cells that particles can reach. ``walls`` is the number of obstacle cells beside the
        reachable free cells.
    false_free : int
        Number of obstacle cells that the swarm classified as free.
    false_obstacles : int
        Number of free cells that the swarm classified as obstacles.
    undecided : int
        Number of cells that the swarm did not classify.
    """

    free: int
    walls: int
    false_free: int
    false_obstacles: int
    undecided: int

    @classmethod
    def of(cls, workspace: GridWorkspace, start: NDArray[np.int64], belief: Belief) -> MapErrors:
        """Return the errors in the final belief of a mapping. ``start`` contains the start cells of the particles."""
        labels = workspace.components
        reached = Board.of_mask(workspace.free & np.isin(labels, labels[tuple(start.T)]))
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
        """Number of correctly classified cells divided by ``free + walls``."""
        cells = self.free + self.walls
        return 1 - (self.false_free + self.false_obstacles + self.undecided) / cells

    @property
    def false_free_rate(self) -> float:
        """Fraction of the obstacle cells that the swarm classified as free."""
        return self.false_free / max(1, self.walls)

    @property
    def false_obstacle_rate(self) -> float:
        """Fraction of the free cells that the swarm classified as obstacles."""
        return self.false_obstacles / max(1, self.free)
