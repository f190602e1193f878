"""Random number generators of a trial. The generators depend only on the seed and the trial number."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator


def trial_rng(seed: int, trial: int = 0) -> Generator:
    """Return the generator for a trial's start cells, targets and policy."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(trial,)))


def noise_rng(seed: int, trial: int = 0) -> Generator:
    """Return the generator for a trial's noise."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(trial, 1)))
