"""Simulation of particles with noise: a rig with noise, and the belief at the start of an episode."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from shoal.core.errors import RigError
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.commands import encode
from shoal.swarm.grid.world import check_start
from shoal.swarm.kernels.noise import noisy_state
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise.belief import NoisyBelief, inner_of, noisy_state_of
from shoal.swarm.noise.model import CONFIDENCE, Noise


class NoisyRig:
    """A simulated rig with noise under the move rule block. Particles may slip, be missed, or appear in a neighbouring cell.

    Each scan draws new errors.

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

    def __init__(self, workspace: GridWorkspace, start: ArrayLike, noise: Noise, rng: Generator) -> None:
        self.workspace, self.noise, self.rng = workspace, noise, rng
        self.state = truth_of(workspace, check_start(workspace, start), noise, CONFIDENCE)
        self._stopped = False

    @property
    def name(self) -> str:
        """Name of the workspace."""
        return self.workspace.name

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the workspace."""
        return self.workspace.shape

    @property
    def rule(self) -> str:
        """The move rule, always block."""
        return "block"

    def send(self, command: str) -> None:
        """Carry out one command."""
        if self._stopped:
            raise RigError("the simulated rig has been stopped")
        noisy_state.move_noisy(self.state, encode(command, ndim=self.workspace.ndim)[0], self.rng)

    def observe(self) -> NDArray[np.int64]:
        """Return the cells in which particles are observed; int64, shape (k, ndim).

        Cells of the rim have the row -1 or H, or the column -1 or W.
        """
        noisy_state.look(self.state, self.rng)
        return np.argwhere(inner_of(self.state.seen, self.shape, rim=1)) - 1

    def stop(self) -> None:
        """Refuse all further commands."""
        self._stopped = True


def truth_of(workspace: GridWorkspace, start: NDArray[np.int64], about: Noise, confidence: float) -> noisy_state.NoisyState:
    """Return the kernels' arrays for a workspace with particles and an empty belief."""
    noisy = noisy_state_of(GridLayout(workspace.shape), about, confidence)
    inner_of(noisy.truth, workspace.shape)[...] = workspace.free
    inner_of(noisy.there, workspace.shape)[tuple(start.T)] = True
    return noisy


def noisy_belief(
    workspace: GridWorkspace, start: NDArray[np.int64], about: Noise, confidence: float, rng: Generator
) -> NoisyBelief:
    """Return the belief after the first scan of a simulation. The arrays of this belief also hold the true state."""
    noisy, layout = truth_of(workspace, start, about, confidence), GridLayout(workspace.shape)
    noisy_state.look(noisy, rng)
    seen = Board(layout, layout.pack(np.array(inner_of(noisy.seen, layout.shape, rim=1), dtype=np.bool_)))
    return NoisyBelief(layout.shape, seen, about, confidence, noisy=noisy)
