"""Simulated particles with noise: the true state, and the belief after the first scan."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.kernels.noise import noisy_state
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise.belief import NoisyBelief, inner_of, noisy_state_of
from shoal.swarm.noise.model import Noise


def truth_of(workspace: GridWorkspace, start: NDArray[np.int64], about: Noise, confidence: float) -> noisy_state.NoisyState:
    """Return the arrays with which kernels simulate noise: the workspace, the start cells of the particles, and an empty belief."""
    noisy = noisy_state_of(GridLayout(workspace.shape), about, confidence)
    inner_of(noisy.truth, workspace.shape)[...] = workspace.free
    inner_of(noisy.there, workspace.shape)[tuple(start.T)] = True
    return noisy


def noisy_belief(
    workspace: GridWorkspace, start: NDArray[np.int64], about: Noise, confidence: float, rng: Generator
) -> NoisyBelief:
    """Return the belief after the first scan of a simulation with noise.

    The arrays of the returned belief contain the true state of the simulation.
    """
    noisy, layout = truth_of(workspace, start, about, confidence), GridLayout(workspace.shape)
    noisy_state.look(noisy, rng)
    seen = Board(layout, layout.pack(np.array(inner_of(noisy.seen, layout.shape, rim=1), dtype=np.bool_)))
    return NoisyBelief(layout.shape, seen, about, confidence, noisy=noisy)
