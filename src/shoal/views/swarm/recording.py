"""Encoding of an episode with noise for the player page: after each move, the particles and the changed cells."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm.noise import Moment, moments

HEAVIEST = 40_000_000
"""Maximum size, in bytes, of the encoded moments of an episode. A page loads moments of this size quickly."""


def packed_moments(frames: Iterable[Moment]) -> bytes:
    """Return the moments of an episode as bytes.

    For each moment, the bytes contain two lists: the cells of the particles, and the cells whose colour code changed. In the second
    list, the new colour code follows each cell. Each list begins with its length. A cell is an index into the grid with its rim,
    encoded as the difference from the previous index of the list. Lengths and index differences are base-128 numbers, with the
    lowest bits first. The high bit of a byte is set if another byte of the same number follows. Before the first moment, all cells
    have the colour code of unknown cells.

    Raises
    ------
    InvalidInputError
        If the encoded moments are too large for a browser.

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
