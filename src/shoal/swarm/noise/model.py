"""The noise model: random failures of motion and of observation."""

from __future__ import annotations

from math import log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_number
from shoal.core.dataclass import dataclass
from shoal.swarm.grid.board import Board
from shoal.swarm.grid.state import Belief
from shoal.swarm.maps.workspace import GridWorkspace

CONFIDENCE = 0.99
PRIOR = 0.25  # prior probability that an unknown cell is free: about the fraction in vascular maps
MOST = 0.5  # upper limit of each probability
SUREST = 0.99999
LOSS = 0.02
"""On a rig: prior probability that a particle disappears for good at a move, because it sticks,
dissolves or leaves the field.

Without it, a particle that no scan shows any more stays in the belief for ever. Of the values
0.0005, 0.005 and 0.02, the largest gives the fewest wrong cells if particles disappear, and as few
as the others if none does (`python -m benchmarks.rigs`).
"""


@dataclass(frozen=True)
class Noise:
    """Probabilities of failed motions and observations. Failures of different particles or at
    different moves are independent.

    Parameters
    ----------
    slip : float
        Probability, from 0 to 0.5, that a command does not move a particle (the particle slips). A
        slipping particle blocks the particles behind it.
    misplace : float
        Probability that a scan shows a particle in a neighbouring cell instead of its true cell.
        All neighbouring cells (4 in 2-D, 6 in 3-D) are equally likely.
    miss : float
        Probability that a scan does not show a particle.

    Raises
    ------
    InvalidInputError

    Notes
    -----
    The page docs/concepts/noise.md explains the noise model.
    """

    slip: float = 0.0
    misplace: float = 0.0
    miss: float = 0.0

    def __post_init__(self) -> None:
        for name in ("slip", "misplace", "miss"):
            object.__setattr__(
                self, name, check_number(getattr(self, name), what=name, least=0, most=MOST)
            )

    def __bool__(self) -> bool:
        return bool(self.slip or self.misplace or self.miss)


def bound_of(confidence: Any) -> float:
    """Return the log-odds of a confidence. The confidence must exceed the prior probability that an
    unknown cell is an obstacle.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> round(bound_of(0.99), 2)
    4.6
    """
    sure = check_number(confidence, what="confidence", above=1 - PRIOR, most=SUREST)
    return log(sure / (1 - sure))


@dataclass(frozen=True)
class MapErrors:
    """The number of cells that a mapping with noise classified wrongly, and the number of cells
    that it left undecided.

    The numbers include only cells that a mapping without noise would classify.

    Parameters
    ----------
    free, walls : int
        ``free`` is the number of free cells that particles can reach. ``walls`` is the number of
        obstacle cells beside the reachable free cells.
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
        """Return the errors in the final belief of a mapping. ``start`` contains the start cells of
        the particles.
        """
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
