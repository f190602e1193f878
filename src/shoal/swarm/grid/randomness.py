"""Random number generators of a trial. The seed and the trial number determine all random numbers of a trial."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator


def trial_rng(seed: int, trial: int = 0) -> Generator:
    """Return the random number generator for the start cells, the targets and the policy of a trial."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(trial,)))


def noise_rng(seed: int, trial: int = 0) -> Generator:
    """Return the random number generator for the noise of a trial."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(trial, 1)))
