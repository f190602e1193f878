"""Commands that complete a mapping where a policy has no commands: they look for the particles, and push weak walls again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board
from shoal.swarm.grid.commands import encode
from shoal.swarm.kernels.noise.noisy_episode import PATIENCE, TIMES
from shoal.swarm.noise.belief import NoisyBelief
from shoal.swarm.policies.paths import path_to_frontier


class Lookout:
    """Chooses commands where a policy has none although the mapping is not complete.

    A policy sees a particle only where the belief is surer than 0.5, and plans only through cells that are classified as free. If
    errors are frequent or particles are few, it may therefore find no path although particles may still enter unclassified cells.
    Commands in all directions in turn then show where the particles are. If every cell in reach is classified, the nearest particle
    pushes the nearest of the weak walls, behind which more unclassified cells may lie than the confidence allows. If no
    particle can reach one, particles push the walls between them and the rest of the map.

    After `PATIENCE` commands that neither classify a further cell nor leave fewer weak walls, and `TIMES` more for each cell of the
    longest path to a wall, the lookout gives up, so that every episode ends.

    Parameters
    ----------
    noisy : NoisyBelief

    Examples
    --------
    >>> from shoal.swarm.grid.board import GridLayout
    >>> from shoal.swarm.noise.model import Noise
    >>> belief = NoisyBelief((1, 3), Board.of_cells(GridLayout((1, 3)), [(0, 0)]), Noise(slip=0.05))
    >>> lookout = Lookout(belief)
    >>> [lookout.next() for _ in range(5)]
    [0, 1, 2, 3, 0]
    >>> sum(lookout.next() is not None for _ in range(1000))
    45
    """

    def __init__(self, noisy: NoisyBelief) -> None:
        self.noisy = noisy
        self._known, self._weak = -1, 0
        self._sent, self._budget = 0, PATIENCE

    def next(self) -> int | None:
        """Return the number of the next command, or None to give up."""
        noisy, belief = self.noisy, self.noisy.belief
        known, path = len(belief.known), ""
        if known > self._known:  # looking for the particles was worth it
            self._known, self._weak, self._sent, self._budget = known, known, 0, PATIENCE
        if noisy.closed:
            weak = noisy.weak_walls
            if len(weak) < self._weak:
                self._weak, self._sent, self._budget = len(weak), 0, PATIENCE
            path = path_to_frontier(replace(belief, frontier=weak), noisy.occupied)
            path = path or path_to_frontier(replace(belief, frontier=self._between(belief)), noisy.occupied)
            self._budget = max(self._budget, PATIENCE + TIMES * len(path))
        if self._sent >= self._budget:
            return None
        self._sent += 1
        ndim = noisy.layout.ndim
        return int(encode(path[0], ndim=ndim)[0]) if path else (self._sent - 1) % (2 * ndim)

    def _between(self, belief: Belief) -> Board:
        """Return the weakest walls between the part of the map with particles and the rest of the map: one of them may be none."""
        reached = layer = self.noisy.occupied & belief.open
        while layer:
            layer = (layer.dilated() & belief.open) - reached
            reached = reached | layer
        between = (belief.obstacles & reached.dilated() & (belief.open - reached).dilated()).mask
        odds = np.where(between, self.noisy.logit, -np.inf)
        return Board(reached.layout, reached.layout.pack(between & (odds > odds.max() - 1)))  # the next push changes more
