"""Random numbers: which generator a world gets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_integer
from shoal.core.errors import InvalidInputError

if TYPE_CHECKING:
    from numpy.random import Generator

LARGEST = 2**62  # seed of a world; arrays hold seeds as int64


def world_generators(
    seed: Any, chosen: NDArray[np.int64], worlds: int, own: list[Generator]
) -> list[tuple[int | None, Generator]]:
    """Return the seed and the random generator of each world whose index is in ``chosen``.

    ``seed`` is None, a number, or a sequence with a number or None for each world. If ``seed`` is a
    number, the seed of each world is the sum of ``seed`` and the world's index. A world with the
    seed None keeps its generator from the list ``own``, or gets a new generator if ``own`` is
    empty.
    """
    several = isinstance(seed, Sequence | np.ndarray)
    if several and len(seed) != worlds:
        raise InvalidInputError(f"seed: expected {worlds} seeds, one per world, got {len(seed)}")
    streams: list[tuple[int | None, Generator]] = []
    for world in chosen.tolist():
        given = seed[world] if several else seed
        if given is None:
            streams.append((None, own[world] if own else np.random.default_rng()))
            continue
        given = check_integer(given, what="seed", least=0, most=LARGEST) + (0 if several else world)
        streams.append((given, np.random.default_rng(given)))
    return streams
