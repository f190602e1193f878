"""The generators of random numbers of a trial: they depend on nothing but (seed, trial)."""

from __future__ import annotations

import numpy as np
from numpy.random import Generator


def trial_rng(seed: int, trial: int = 0) -> Generator:
    """Return the generator of a trial: of its start, its targets and its policy."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(trial,)))


def noise_rng(seed: int, trial: int = 0) -> Generator:
    """Return the generator of a trial's noise."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(trial, 1)))
