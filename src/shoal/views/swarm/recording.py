"""The moments of an episode with noise as the player takes them: particles, and what looks otherwise than before."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm.noise import Moment, moments

HEAVIEST = 40_000_000
"""Bytes of moments that a page still loads within a moment."""


def packed_moments(frames: Iterable[Moment]) -> bytes:
    """Return moments as bytes: of each its particles, then the cells that look otherwise than before, each with its look.

    Both lists begin with their length; cells are indices into the grid with its rim, each written as the difference from the one
    before. Lengths and differences have seven bits a byte, the lowest first, and the highest bit set if more follow. At first all
    cells look unknown.

    Raises
    ------
    InvalidInputError
        If there are more of them than a browser takes.

    Examples
    --------
    >>> looks = np.array([[8, 16, 8]], dtype=np.uint8)
    >>> list(packed_moments([Moment(looks == 16, looks), Moment(looks == 16, looks)]))
    [1, 1, 1, 1, 16, 1, 1, 0]
    """
    written, before = bytearray(), None
    for moment in frames:
        looks = moment.looks.ravel()
        if before is None:
            before = np.full_like(looks, moments.UNKNOWN)
        changed = np.flatnonzero(looks != before)
        _write(written, np.flatnonzero(moment.particles.ravel()))
        _write(written, changed, looks[changed])
        before = looks
        if len(written) > HEAVIEST:
            raise InvalidInputError(
                f"the HTML player: expected at most {HEAVIEST // 10**6} MB of moments with noise, got more (use .gif or .mp4)"
            )
    return bytes(written)


def _write(written: bytearray, cells: NDArray[np.int64], looks: NDArray[np.uint8] | None = None) -> None:
    written += bytes(_seven_bits(len(cells)))
    steps = np.diff(cells, prepend=0).tolist()
    for i, step in enumerate(steps):
        if step < 128:
            written.append(step)
        else:
            written += bytes(_seven_bits(step))
        if looks is not None:
            written.append(looks[i])


def _seven_bits(number: int) -> Iterator[int]:
    while number > 127:
        yield number & 127 | 128
        number >>= 7
    yield number
