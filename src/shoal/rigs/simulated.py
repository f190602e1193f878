"""Simulated rigs with noise and without noise."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from shoal.core.errors import RigError
from shoal.swarm.grid.board import encode
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.kernels import noise as noisy_state
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise.belief import inner_of, truth_of
from shoal.swarm.noise.model import CONFIDENCE, Noise


class SimulatedRig:
    """A simulated rig without noise, which makes no errors when it moves and observes particles in
    a workspace.

    Parameters
    ----------
    workspace : GridWorkspace
    start : array_like of int, shape (n, ndim)
    rule : str

    Raises
    ------
    InvalidInputError, UnknownNameError

    Examples
    --------
    >>> rig = SimulatedRig(GridWorkspace([[1, 1, 1]]), [(0, 0)])
    >>> rig.send("r")
    >>> rig.observe().tolist()
    [[0, 1]]
    """

    def __init__(self, workspace: GridWorkspace, start: ArrayLike, *, rule: str = "block") -> None:
        self._world = GridWorld(workspace, rule)
        self._state = self._world.initial(start)
        self._stopped = False

    @property
    def name(self) -> str:
        """Name of the rig: the name of the simulated workspace."""
        return self._world.workspace.name

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the simulated workspace, in cells."""
        return self._world.workspace.shape

    @property
    def rule(self) -> str:
        """Name of the move rule: "block", "merge" or "tilt"."""
        return self._world.rule

    def send(self, command: str) -> None:
        """Move all particles by one command."""
        if self._stopped:
            raise RigError("the simulated rig has been stopped")
        self._move(command)

    def _move(self, command: str) -> None:
        self._state = self._world.step(self._state, command)

    def observe(self) -> NDArray[np.int64]:
        """Return the cells of all particles (int64, shape (n, ndim))."""
        return self._state.cells

    def stop(self) -> None:
        """Stop the rig. A stopped rig refuses all further commands."""
        self._stopped = True


class NoisyRig(SimulatedRig):
    """A simulated rig with noise, under the move rule block. Particles may slip, remain unseen, or
    appear in a neighbouring cell.

    Each call of `observe` draws new random errors.

    Parameters
    ----------
    workspace : GridWorkspace
    start : array_like of int, shape (n, ndim)
    noise : Noise
    rng : Generator

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> rig = NoisyRig(GridWorkspace([[1, 1, 1]]), [(0, 0)], Noise(miss=0.5), np.random.default_rng(1))
    >>> rig.send("r")
    >>> [len(rig.observe()) for _ in range(6)]
    [1, 0, 1, 0, 0, 1]
    """

    def __init__(
        self, workspace: GridWorkspace, start: ArrayLike, noise: Noise, rng: Generator
    ) -> None:
        super().__init__(workspace, start)
        self._noisy, self._rng = truth_of(workspace, self._state.cells, noise, CONFIDENCE), rng

    def _move(self, command: str) -> None:
        noisy_state.move_noisy(self._noisy, encode(command, ndim=len(self.shape))[0], self._rng)

    def observe(self) -> NDArray[np.int64]:
        """Return the cells in which the rig observes particles (int64, shape (k, ndim)).

        Because of the noise, particles may appear in rim cells outside the workspace. In a
        workspace of H rows and W columns, a rim cell has the row -1 or H, or the column -1 or W.
        """
        noisy_state.look(self._noisy, self._rng)
        return np.argwhere(inner_of(self._noisy.seen, self.shape, rim=1)) - 1
