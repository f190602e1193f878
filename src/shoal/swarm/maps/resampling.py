"""Masks of cells in another size: scaling that keeps connected cells connected, diagonal contacts,
and connected parts.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import combinations, product
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core import notices
from shoal.core.dataclass import one_line
from shoal.core.notices import tell_once
from shoal.jit.kernels.connected import connected_parts
from shoal.swarm.maps.reading import Mask

MOST_COUNTED = 2**25
"""Maximum number of cells of a map whose parts are counted: the count needs nine bytes a cell."""

Box = tuple[tuple[int, int], ...]
"""First and last index along each axis."""


class Parts(NamedTuple):
    """The connected parts of the free cells of a map.

    Attributes
    ----------
    number : int
        Number of parts.
    share : float
        Share of the largest part among all free cells, from 0 to 1.
    largest : tuple
        First and last layer, row and column of the largest part.
    whole : tuple
        First and last layer, row and column of all free cells.
    """

    number: int
    share: float
    largest: Box
    whole: Box

    def __repr__(self) -> str:
        return one_line(self)


def parts_of(free: Mask, *, corners: bool = False) -> Parts | None:
    """Return the connected parts of a map, or None for a map of more than `MOST_COUNTED` cells.

    Parameters
    ----------
    free : ndarray, bool, shape (H, W) or (D, H, W)
        True at free cells, of which there is at least one.
    corners : bool
        Whether cells that share only a corner are connected. Particles do not move diagonally, so
        that the cells of a map are not.

    Examples
    --------
    >>> parts_of(np.array([[1, 1, 0, 1]], dtype=bool))
    Parts(number=2, share=0.6666666666666666, largest=((0, 0), (0, 1)), whole=((0, 0), (0, 3)))
    """
    if free.size > MOST_COUNTED:
        return None
    labels, number = connected_parts(free, corners=corners)
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    return Parts(
        number, float(sizes.max() / sizes.sum()), box_of(labels == np.argmax(sizes)), box_of(free)
    )


def box_of(free: Mask) -> Box:
    """Return the first and the last index of the free cells along each axis."""
    axes = range(free.ndim)
    filled = [
        np.flatnonzero(free.any(axis=tuple(other for other in axes if other != axis)))
        for axis in axes
    ]
    return tuple((int(indices[0]), int(indices[-1])) for indices in filled)


def largest_part(free: Mask, *, corners: bool = False) -> Mask:
    """Return the largest connected part of the free cells of a map. If the map has no free cells,
    return the map unchanged.

    Parameters
    ----------
    free : ndarray, bool, shape (H, W)
        True at free cells.
    corners : bool
        Whether cells that share only a corner count as connected.
    """
    parts, number = connected_parts(free, corners=corners)
    if number <= 1:
        return free
    size = np.bincount(parts.ravel())
    size[0] = 0
    return np.asarray(parts == np.argmax(size))


def crop(free: Mask) -> Mask:
    """Cut off the outer rows, columns and layers of a map that contain no free cell. The map must
    have at least one free cell.
    """
    return np.ascontiguousarray(free[tuple(slice(first, last + 1) for first, last in box_of(free))])


Shares = NDArray[np.float32]
Indices = NDArray[np.int64]

HALF = 0.5  # a cell is free in any case if at least this share of its pixels is free
LEVELS = (0.125, 0.25, 0.375, HALF)  # cells with a small share of free pixels are removed first


def scale_cells(free: Mask, scale: float | Sequence[float], *, where: str = "map") -> Mask:
    """Return a mask with ``scale`` cells for each cell of ``free`` along each axis, so that
    connected cells stay connected.

    A cell of a smaller mask stands for a block of cells of ``free``. The new cell is free if at
    least half of its block is free. Thin vessels never fill half of a block. Other cells with at
    least one free cell in their block are therefore free, too, where a connection needs them, so
    that a thin vessel becomes a line of cells that is one cell wide.

    The result has three properties. Each connected part of ``free`` gives one connected part of the
    result; only a part that fills less than half of a block vanishes, and the largest part never
    does. Every free cell of the result has a free cell in its block, so that two parts stay apart
    if along some axis the distance between them is at least the length of two blocks. Cells are
    only added where a block is less than half free and a connection needs it, so that the result
    does not swell.

    Parameters
    ----------
    free : ndarray of bool, shape (H, W) or (D, H, W)
        True at free cells. Cells that share a side are connected.
    scale : float or sequence of float
        One factor above 0 for all axes, or one factor for each axis.
    where : str
        Name of the map in the notice about parts that vanish.

    Examples
    --------
    >>> line = np.zeros((16, 16), dtype=bool)
    >>> line[5, :] = line[5:, 9] = True
    >>> scale_cells(line, 0.25).astype(int)
    array([[0, 0, 0, 0],
           [1, 1, 1, 1],
           [0, 0, 1, 0],
           [0, 0, 1, 0]])
    """
    factors = (
        [float(scale)] * free.ndim
        if isinstance(scale, int | float)
        else [float(factor) for factor in scale]
    )
    shape = scaled_shape(free.shape, factors)
    if shape == free.shape:
        return free
    if min(factors) >= 1:
        return enlarge_cells(free, shape)
    tell_of_contacts(
        free[0] if free.ndim == 3 and len(free) == 1 else free,
        f"{where}: before scaling,",
        "parts of the map; the smaller map may connect such parts (--join-diagonals connects them in"
        " any case)",
    )
    return cells_of_shares(block_shares(free, shape), where=where)


def scaled_shape(shape: Sequence[int], factors: Sequence[float]) -> tuple[int, ...]:
    """Return the shape of a map after scaling. Each side has at least one cell."""
    return tuple(max(1, round(side * factor)) for side, factor in zip(shape, factors, strict=True))


def enlarge_cells(free: Mask, shape: Sequence[int]) -> Mask:
    """Return a mask of a larger or equal ``shape``, in which each cell equals the nearest cell of
    ``free``.
    """
    for axis, side in enumerate(shape):
        if side != free.shape[axis]:
            free = np.take(free, np.arange(side) * free.shape[axis] // side, axis=axis)
    return free


def block_shares(free: Mask, shape: Sequence[int]) -> Shares:
    """Return the share of free cells in each block, if ``shape`` blocks of almost equal size divide
    a mask.

    An axis with more blocks than cells is enlarged.
    """
    free = enlarge_cells(
        free, [max(side, blocks) for side, blocks in zip(free.shape, shape, strict=True)]
    )
    counts: NDArray[Any] = free
    largest = prod(-(-side // blocks) for side, blocks in zip(free.shape, shape, strict=True))
    # a count of four bytes for each of 2^28 pixels would take 1 GiB
    number = np.min_scalar_type(largest)
    pixels = np.ones((), dtype=np.float32)
    for axis, blocks in enumerate(shape):
        if blocks == free.shape[axis]:  # nothing to add
            pixels = np.multiply.outer(pixels, np.ones(blocks, dtype=np.float32))
            continue
        # cell i belongs to block i * blocks // side
        begins = -(-np.arange(blocks) * free.shape[axis] // blocks)
        counts = np.add.reduceat(counts, begins, axis=axis, dtype=number)
        sizes = np.diff([*begins, free.shape[axis]]).astype(np.float32)
        pixels = np.multiply.outer(pixels, sizes)
    return np.asarray(counts / pixels, dtype=np.float32)


def shares_of_bands(
    bands: Iterable[Mask], sides: tuple[int, int, int], shape: Sequence[int]
) -> Shares:
    """Return what `block_shares` returns for a mask of layers whose rows come in bands, which need
    not be in memory together.

    Parameters
    ----------
    bands : iterable of ndarray of bool, shape (rows, columns)
        The rows of all layers.
    sides : tuple of int
        Numbers of layers, rows and columns of the mask.
    shape : sequence of int
        Shape of the result. It has as many layers as the mask, and at most as many rows and
        columns.
    """
    _, rows, columns = sides
    _, high, wide = shape
    begins = -(-np.arange(wide) * columns // wide)
    counts = np.zeros((sides[0] * high, wide), dtype=np.int64)
    row = 0
    for cells in bands:
        at = np.arange(row, row + len(cells))
        block = at // rows * high + at % rows * high // rows
        first = np.flatnonzero(np.diff(block, prepend=-1))
        below = np.add.reduceat(cells, first, axis=0, dtype=np.int32)
        counts[block[first]] += np.add.reduceat(below, begins, axis=1)
        row += len(cells)
    heights, widths = (
        np.diff([*-(-np.arange(new) * old // new), old])
        for new, old in ((high, rows), (wide, columns))
    )
    return np.asarray(counts.reshape(shape) / np.multiply.outer(heights, widths), dtype=np.float32)


def cells_of_shares(share: Shares, *, where: str = "map") -> Mask:
    """Return the free cells of a scaled map, given the share of free pixels in each cell.
    `scale_cells` states the properties.

    All cells with a free pixel form the largest possible map, in which everything stays connected
    that was connected. The function removes cells without which their neighbours stay connected to
    each other.
    """
    free = share > 0
    parts, count = connected_parts(free)
    large = np.bincount(parts.ravel(), share.ravel()) >= HALF
    if count and not large[1:].any():
        large[1 + int(np.argmax(np.bincount(parts.ravel(), share.ravel())[1:]))] = True
        which, pronoun = (
            ("the only part is smaller", "it")
            if count == 1
            else (f"all {count} parts are smaller", "the largest")
        )
        tell_once(
            f"shoal: warning: {where}: {which} than half a cell of the scaled map, and {pronoun} is"
            " kept (a larger --scale or --width keeps more)"
        )
    elif dropped := count - int(np.count_nonzero(large[1:])):
        which = "1 part is smaller" if dropped == 1 else f"{dropped} parts are smaller"
        tell_once(
            f"shoal: notice: {where}: {which} than half a cell of the scaled map and dropped"
            " (--scale, --width)"
        )
    free &= large[parts]
    _thin(free, np.where(free, share, 0))
    return free


def _thin(free: Mask, share: Shares) -> None:
    """Remove cells with a share below `HALF` from ``free``, in place, without separating any two
    remaining cells.

    The removal follows the thinning of pictures by directions: each pass removes cells from one
    side, so that strips of two cells lose the thinner half and no comb remains. The end of a line
    stays.
    """
    padded, core = np.pad(free, 1), np.pad(share >= HALF, 1).ravel()
    cells = padded.ravel()
    sides = [stride // padded.itemsize for stride in padded.strides]
    steps = np.array([sign * side for side in sides for sign in (-1, 1)])
    shares = np.pad(share, 1).ravel()
    outside = tuple(int(step) for step in steps)
    # last the cells inside, which are holes of the picture; before, they would open a grid of holes
    # in a spotted picture
    for level, passes in (*((level, outside) for level in LEVELS), (HALF, (0, *outside))):
        candidates = np.flatnonzero(cells & ~core & (shares < level))
        before = -1
        while len(candidates) != before:
            before = len(candidates)
            for step in passes:
                near = cells[candidates[:, None] + steps]
                degree = near.sum(axis=1)
                # beside a thick vessel: no end of a line
                stump = (degree == 1) & core[candidates + steps[near.argmax(axis=1)]]
                fit = (
                    ~cells[candidates + step] & ((degree > 1) | stump) if step else near.all(axis=1)
                )
                _remove_simple(cells, candidates[fit], steps, padded.shape)
                candidates = candidates[cells[candidates]]
    free[...] = padded[(slice(1, -1),) * free.ndim]


def _remove_simple(
    cells: Mask, candidates: Indices, steps: Indices, shape: tuple[int, ...]
) -> None:
    """Remove the chosen cells one after the other, if the neighbours of a cell stay connected
    beside the cell.

    Cells with equal parities of all coordinates do not change each other's neighbourhoods, so they
    are removed at once.
    """
    parity = sum(
        (place % 2) << axis for axis, place in enumerate(np.unravel_index(candidates, shape))
    )
    corners = [pair for pair in combinations(range(len(steps)), 2) if pair[0] // 2 != pair[1] // 2]
    for group in range(1 << len(shape)):
        at = candidates[parity == group]
        near = cells[at[:, None] + steps]
        reached = near & (np.arange(len(steps)) == near.argmax(axis=1)[:, None])
        joined = [
            near[:, first] & near[:, second] & cells[at + steps[first] + steps[second]]
            for first, second in corners
        ]
        for _ in range(len(steps) - 1):
            for (first, second), open_ in zip(corners, joined, strict=True):
                connected = open_ & (reached[:, first] | reached[:, second])
                reached[:, first] |= connected
                reached[:, second] |= connected
        cells[at[(reached == near).all(axis=1) & near.any(axis=1)]] = False


def factors_of_width(
    shape: Sequence[int], width: int, spacing: Sequence[float] | None
) -> list[float]:
    """Return the factor along each axis that gives a map at most ``width`` cells along its largest
    side.

    With a known size of a cell, the new cells are cubes as far as possible: an axis whose cells are
    larger already keeps them. In a stack without a known size of a cell, rows and columns are
    scaled, and layers stay.
    """
    if spacing is None:
        factor = min(1.0, width / max(shape[-2:]))
        return [1.0] * (len(shape) - 2) + [factor] * 2
    side = max(size * cells for size, cells in zip(spacing, shape, strict=True)) / width
    return [min(1.0, size / side) for size in spacing]


def diagonal_contacts(free: Mask) -> int:
    """Return the number of places at which two parts of a map touch with a corner or, in 3-D, an
    edge.

    Particles cannot pass a diagonal contact.
    """
    return sum(len(cells) for cells, _ in _contacts(connected_parts(free)[0]))


def tell_of_contacts(free: Mask, where: str, what: str) -> None:
    """Tell how many diagonal contacts separate ``what``, if somebody listens and the map is small
    enough to count them.
    """
    if not notices.listeners or free.size > MOST_COUNTED:
        return
    if contacts := diagonal_contacts(free):
        separate = (
            "1 diagonal contact separates"
            if contacts == 1
            else f"{contacts} diagonal contacts separate"
        )
        tell_once(f"shoal: warning: {where} {separate} {what}")


def join_diagonals(free: Mask) -> Mask:
    """Return a map in which parts that touch diagonally are connected. At each diagonal contact,
    one corner becomes free, until no contacts are left: a corner may touch a further part, which is
    then connected as well.

    Contacts inside one part stay as they are.

    Examples
    --------
    >>> join_diagonals(np.eye(3, dtype=bool)).astype(int)
    array([[1, 1, 0],
           [0, 1, 1],
           [0, 0, 1]])
    """
    joined = free.copy()
    filled = -1
    while filled != (filled := int(np.count_nonzero(joined))):
        # contacts at edges first: they may connect parts that also touch at a corner
        for axes in range(2, free.ndim + 1):
            for contact, step in _contacts(connected_parts(joined)[0], axes):
                at = contact.copy()
                for axis in reversed(np.flatnonzero(step)[1:]):
                    at[:, axis] += step[axis]
                    joined[tuple(at.T)] = True
    return joined


def _contacts(
    parts: NDArray[np.int32], axes: int | None = None
) -> Iterator[tuple[Indices, Indices]]:
    """Yield the diagonal contacts of different parts: the first cells of all contacts in a
    direction, and the direction.

    With ``axes``, yield only directions along so many axes. A contact of two parts at an edge of
    3-D cells counts once.
    """
    for direction in product((-1, 0, 1), repeat=parts.ndim):
        step = np.array(direction)
        count = np.count_nonzero(step)
        if count < 2 or step[np.flatnonzero(step)[0]] < 0 or (axes is not None and count != axes):
            continue
        first = tuple(
            slice(max(0, -offset), side - max(0, offset))
            for offset, side in zip(direction, parts.shape, strict=True)
        )
        second = tuple(
            slice(max(0, offset), side - max(0, -offset))
            for offset, side in zip(direction, parts.shape, strict=True)
        )
        apart = (parts[first] > 0) & (parts[second] > 0) & (parts[first] != parts[second])
        at = np.argwhere(apart) + np.array([window.start for window in first])
        if len(at):
            yield at, step
