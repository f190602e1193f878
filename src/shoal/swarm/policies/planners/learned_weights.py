"""Weights of the learned occupancy prior, a neural network trained on maps, in the form that
kernels expect.

The file of weights is under the licence of Shoal (MIT): only maps that Shoal generated were used
for the training.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from shoal.swarm.kernels.planning.learned_prior import SPAN, LearnedPrior

WEIGHTS = Path(__file__).with_name("learned_weights.npz")
TURNS = (
    3,
    0,
    1,
    2,
)  # anticlockwise quarter turns that bring the entry side to the bottom, for l, u, r, d
CHANCES = 2**16  # stored value for the probability 1


@cache
def weights() -> dict[str, Any]:
    """Return the stored weights of the neural network, and the cell indices of its square input
    window after each quarter turn.
    """
    cells = np.arange(SPAN * SPAN).reshape(SPAN, SPAN)
    places = np.array([np.argsort(np.rot90(cells, turns).ravel()) for turns in TURNS])
    with np.load(WEIGHTS) as archive:
        arrays = {name: np.ascontiguousarray(archive[name]) for name in archive.files}
    return arrays | {"places": places, "chances": arrays["chances"] / CHANCES}


def learned_prior_of(inner: Any, width: int, *, used: bool) -> LearnedPrior:
    """Return the neural network with an empty cache of predictions. If ``used`` is false, the cache
    has size 0.
    """
    size = 64 * len(inner) if used else 0
    return LearnedPrior(
        **weights(),
        inner=inner,
        opened=np.zeros(SPAN, dtype=np.uint64),
        walls=np.zeros(SPAN, dtype=np.uint64),
        used=np.zeros(SPAN * SPAN, dtype=np.int64),
        sums=np.zeros(len(weights()["first_bias"]), dtype=np.int16),
        marks=np.zeros(size, dtype=np.uint64),
        outputs=np.zeros(size, dtype=np.uint8),
        bias=np.zeros(1),
        width=width,
    )
