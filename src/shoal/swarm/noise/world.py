"""NoisyWorld: particles that slip, and scans that show wrong positions, in a known workspace."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from shoal.swarm.grid.board import encode
from shoal.swarm.kernels import noise as kernels
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise.belief import inner_of, truth_of
from shoal.swarm.noise.model import CONFIDENCE, Noise


class NoisyWorld:
    """The true state of a simulation with noise, under the move rule block.

    Parameters
    ----------
    workspace : GridWorkspace
    start : array_like of int, shape (n, ndim)
    noise : Noise
    rng : Generator

    Examples
    --------
    >>> world = NoisyWorld(GridWorkspace([[1, 1, 1]]), [(0, 0)], Noise(slip=0.5), np.random.default_rng(1))
    >>> [world.step("r") or world.scan().tolist() for _ in range(3)]
    [[[0, 1]], [[0, 1]], [[0, 1]]]
    """

    def __init__(
        self, workspace: GridWorkspace, start: ArrayLike, noise: Noise, rng: Generator
    ) -> None:
        cells = np.asarray(start, dtype=np.int64)
        self.shape, self.rng = workspace.shape, rng
        self.state = truth_of(workspace, cells, noise, CONFIDENCE)

    def step(self, command: str) -> None:
        """Move the particles by one command. Each particle may slip."""
        kernels.move_noisy(self.state, encode(command, ndim=len(self.shape))[0], self.rng)

    def scan(self) -> NDArray[np.int64]:
        """Return the cells in which a new scan shows particles (int64, shape (k, ndim)).

        Because of the noise, particles may appear in rim cells outside the workspace. In a
        workspace of H rows and W columns, a rim cell has the row -1 or H, or the column -1 or W.
        """
        kernels.look(self.state, self.rng)
        return np.argwhere(inner_of(self.state.seen, self.shape, rim=1)) - 1
