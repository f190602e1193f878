"""The decision which cells are free: by the numbers of a file, or by the brightness of
its pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError
from shoal.core.notices import tell_once
from shoal.swarm.maps.reading import PIECE, WHITE, MapOptions, Mask

Numbers = NDArray[Any]
Pieces = Callable[[], Iterable[Numbers]]
"""A function that returns the numbers of a file piece by piece. Each call starts again with the
first piece.
"""

MIDDLE = 0.8  # width of the range of brightness, around 0.5, that counts as neither black nor white
SHOWN = 8  # numbers that an error message lists


def free_by_number(
    pieces: Pieces, options: MapOptions, *, where: str, packed: bool = False
) -> Bands:
    """Return the free cells of each piece of an array of numbers.

    If ``level`` is given, a cell is free if its number is at least ``level``. If ``label`` is
    given, a cell is free if its number equals ``label``. If neither ``level`` nor ``label`` is
    given, all obstacles must have the number 0, and all free cells must have one common number
    other than 0. NaN is never free, and a notice gives the number of NaN cells.

    Raises
    ------
    InvalidInputError
        Raised if a number is infinite, or if no cell has the number ``label``. InvalidInputError is
        raised if neither ``level`` nor ``label`` is given for an array of more than two different
        numbers, such as intensities or probabilities.
    """
    free = Bands(packed=packed)
    missing, extremes = 0, Extremes()
    for piece in pieces():
        nan = _not_a_number(piece, pieces, where)
        missing += 0 if nan is None else int(np.count_nonzero(nan))
        if options.level is not None:
            cells = piece >= options.level
        elif options.label is not None:
            cells = piece == options.label
        else:
            cells = piece != 0
            if nan is not None:
                cells &= ~nan
            extremes.add(piece[cells] if piece.dtype.kind != "b" else np.zeros(0))
            below = extremes.low is not None and extremes.low < 0
            if extremes.low != extremes.high or below:
                several = f"{extremes.low} and " if extremes.low != extremes.high else ""
                raise InvalidInputError(
                    f"{where}: expected 0 for obstacles and one number above 0 for free cells, got"
                    f" {several}{extremes.high}{_cell_of(pieces, extremes.high)} (choose the level"
                    " from which cells are free, or the label of free cells)"
                )
        free.add(_free_of(np.asarray(cells), nan, options))
    _tell_of_missing(missing, where)
    if options.label is not None and free.free == (free.size if options.invert else 0):
        raise InvalidInputError(
            f"{where}: expected cells of label {shortened(options.label)}, got none"
            f" ({_label_list(pieces)})"
        )
    return free


def free_in_array(array: Numbers, options: MapOptions, *, where: str) -> Mask:
    """Return the free cells of an array in memory: `free_by_number` for each piece."""
    none = np.zeros((0, *array.shape[1:]), np.bool_)
    return np.concatenate([none, *free_by_number(lambda: in_pieces(array), options, where=where)])


def free_by_brightness(
    pieces: Pieces,
    white: float | None,
    options: MapOptions,
    *,
    where: str,
    all_masks: Callable[[], bool] = lambda: False,
    number_of: Callable[[Any], Any] = lambda brightness: brightness,
    packed: bool = False,
) -> Bands:
    """Return the free pixels of each piece of a grey picture.

    Parameters
    ----------
    pieces : callable
        Function that returns arrays of brightness, with the number 0 for black.
    white : float, optional
        Brightness of white. If ``white`` is None, as in a picture of floats, the largest number of
        the picture is white.
    options : MapOptions
    where : str
        Name of the file in error messages and notices.
    all_masks : callable
        Function that says, after the last piece, whether each picture of a stack is a mask of 0 and
        of one brightness of its own.
    number_of : callable
        Function that returns the number by which the file stores a brightness, for messages. It is
        asked after the last piece. By default, files store the brightness.
    packed : bool
        Whether each cell takes one bit in memory.

    Raises
    ------
    InvalidInputError
        Raised if a number is infinite, or if no pixel is as bright as the threshold.

    Notes
    -----
    Without a threshold, a picture of exactly two brightnesses is a mask: the brighter pixels are
    free. Masks with the values 0 and 1, as other programs write them, are almost black, so that
    half of white is no boundary for them.
    """
    white_known = white is not None
    white = _largest(pieces, where) if white is None else white
    threshold = WHITE if options.threshold is None else options.threshold
    # An exactly equal brightness is free: rounded to 32 bits, 100 / 255 of 255 is 100.
    least: Any = np.float32(threshold * white) if threshold * white < 2**23 else threshold * white
    free = Bands(packed=packed)
    extremes, missing, middle, looked_at = Extremes(), 0, 0, 0
    for numbers in pieces():
        piece = numbers.view(np.uint8) if numbers.dtype == np.bool_ else numbers
        if white_known and piece.dtype.kind == "u" and not isinstance(least, int):
            least = int(np.ceil(least))  # whole numbers are compared without conversion
        nan = _not_a_number(piece, pieces, where)
        missing += 0 if nan is None else int(np.count_nonzero(nan))
        extremes.add(piece if nan is None else piece[~nan])
        free.add(_free_of(np.asarray(piece >= least), nan, options))
        sample = piece[tuple(slice(None, None, max(1, side // 256)) for side in piece.shape)]
        middle += int(np.count_nonzero(np.abs(sample / max(white, 1e-30) - 0.5) < MIDDLE / 2))
        looked_at += sample.size
    _tell_of_missing(missing, where)
    if options.threshold is None and extremes.has_two:
        if not extremes.low < least <= extremes.high:
            dark, light = number_of(extremes.low), number_of(extremes.high)
            of_white = f" of {white:g}" if white_known else ""
            tell_once(
                f"shoal: {where}: the picture has two brightnesses,"
                f" {min(dark, light):g} and {max(dark, light):g}{of_white}; it is read as a mask,"
                f" in which {dark if options.invert else light:g} is free"
            )
            free = _of_pieces(
                pieces, lambda piece: piece == extremes.high, options, where=where, packed=packed
            )
        return free
    if options.threshold is None and all_masks():
        black = number_of(0)
        condition = f"every brightness {'below' if number_of(1) < black else 'above'} {black:g}"
        tell_once(
            f"shoal: {where}: each picture has at most two brightnesses, {black:g} and one that"
            " differs between the pictures; they are read as masks, in which"
            f" {f'{black:g}' if options.invert else condition} is free (--threshold,"
            " --level or --label decide otherwise)"
        )
        return _of_pieces(pieces, lambda piece: piece > 0, options, where=where, packed=packed)
    if not white_known and extremes.low != extremes.high:
        if options.threshold is None and piece.dtype.kind in "iu":
            raise InvalidInputError(
                f"{where}: expected a picture whose white is known, got {piece.dtype} values from"
                f" {extremes.low} to {extremes.high} (--level N takes the values from N as free,"
                " --label N the value N, --threshold a share of the largest value)"
            )
        if extremes.high > 0:
            free_numbers = "the largest counts as white, and " + (
                f"less than {least:g}" if options.invert else f"{least:g} or more"
            )
        else:  # no share of the largest number is a boundary
            free_numbers = "0 or less" if options.invert else "only a number above 0"
        tell_once(
            f"shoal: {where}: the numbers from {extremes.low:g} to {extremes.high:g} have no white"
            f" of their own; {free_numbers} is free"
        )
    if extremes.high is not None and extremes.high < least and extremes.high > 0:
        first, last = sorted((number_of(extremes.low), number_of(extremes.high)))
        raise InvalidInputError(
            f"{where}: expected pixels with a brightness of at least {threshold:g}"
            f" ({number_of(least):g} of {white:g}), got values from {first:g} to {last:g}"
            " (--threshold takes a smaller share of white, --level N the values from N, and"
            " --label N the value N as free)"
        )
    share = 100 * free.free / max(1, free.size)
    if middle > 0.5 * looked_at:
        tell_once(
            f"shoal: warning: {where}: most pixels are neither black nor white, as in a photograph;"
            f" {share:.3g} % of them count as free (--vessels finds the vessels of a photograph)"
        )
    return free


def _of_pieces(
    pieces: Pieces,
    test: Callable[[Numbers], Any],
    options: MapOptions,
    *,
    where: str,
    packed: bool,
) -> Bands:
    free = Bands(packed=packed)
    for piece in pieces():
        free.add(_free_of(np.asarray(test(piece)), _not_a_number(piece, pieces, where), options))
    return free


class Bands(list[Numbers]):
    """Masks of consecutive rows. If ``packed`` is set, each cell takes one bit, and `unpacked`
    gives the masks one by one.
    """

    def __init__(self, *, packed: bool = False) -> None:
        super().__init__()
        self.packed, self.free, self.size = packed, 0, 0
        self._width = 0

    def add(self, cells: Mask) -> None:
        """Add the mask of the next rows."""
        self.free += int(np.count_nonzero(cells))
        self.size += cells.size
        self._width = cells.shape[-1]
        self.append(np.packbits(cells, axis=-1) if self.packed else cells)

    def unpacked(self) -> Iterator[Mask]:
        """Return the masks one after the other."""
        for mask in self:
            yield (
                np.unpackbits(mask, axis=-1, count=self._width).view(np.bool_)
                if self.packed
                else mask
            )


class Extremes:
    """The smallest and the largest of all numbers added, and whether there are no others."""

    def __init__(self) -> None:
        self.low: Any = None
        self.high: Any = None
        self._only_two = True

    @property
    def has_two(self) -> bool:
        """Whether exactly two different numbers were added."""
        return bool(self._only_two and self.low is not None and self.low != self.high)

    def add(self, numbers: Numbers) -> None:
        """Add an array of numbers that are not NaN."""
        if not numbers.size:
            return
        low, high = numbers.min(), numbers.max()
        if self._only_two:
            values = {*(() if self.low is None else (self.low, self.high)), low, high}
            self._only_two = len(values) <= 2 and bool(((numbers == low) | (numbers == high)).all())
        self.low = low if self.low is None else min(self.low, low)
        self.high = high if self.high is None else max(self.high, high)


def in_pieces(array: Numbers) -> Iterator[Numbers]:
    """Return an array in pieces of whole layers or rows, with at most about `PIECE`
    numbers each.
    """
    step = max(1, PIECE // max(1, int(np.prod(array.shape[1:]))))
    for first in range(0, len(array), step):
        yield array[first : first + step]


def _free_of(cells: Mask, nan: Mask | None, options: MapOptions) -> Mask:
    """Exchange free cells and obstacles if ``invert`` is set. What has no number is an obstacle in
    both cases.
    """
    if not options.invert:
        return cells
    return ~cells if nan is None else ~cells & ~nan


def _not_a_number(piece: Numbers, pieces: Pieces, where: str) -> Mask | None:
    """Return the mask of NaN cells, or None if there are none. Refuse infinite numbers."""
    if piece.dtype.kind != "f":
        return None
    finite = np.isfinite(piece)
    if finite.all():
        return None
    nan = np.isnan(piece)
    if (finite | nan).all():
        return nan
    infinite = piece[~finite & ~nan].flat[0]
    raise InvalidInputError(
        f"{where}: expected finite numbers, got {infinite}{_cell_of(pieces, infinite)}"
    )


def _tell_of_missing(count: int, where: str) -> None:
    if count:
        cells, count_as = (
            ("1 cell has no number", "counts")
            if count == 1
            else (f"{count} cells have no number", "count")
        )
        tell_once(f"shoal: {where}: {cells} (NaN) and {count_as} as not free")


def _largest(pieces: Pieces, where: str) -> float:
    extremes = Extremes()
    for piece in pieces():
        nan = _not_a_number(piece, pieces, where)
        extremes.add(piece if nan is None else piece[~nan])
    return max(float(extremes.high or 0), 1e-30)


def _label_list(pieces: Pieces) -> str:
    """Return a text that lists the first numbers of a file."""
    labels: set[Any] = set()
    for piece in pieces():
        labels.update(np.unique(piece)[: SHOWN + 1].tolist())
        if len(labels) > SHOWN:
            break
    numbers = sorted(number for number in labels if not np.isnan(number))[:SHOWN]
    return (
        "the labels in the map are"
        f" {', '.join(f'{number:g}' for number in numbers)}{', …' * (len(labels) > SHOWN)}"
    )


def _cell_of(pieces: Pieces, number: Any) -> str:
    """Return the place of the first cell with a number as text. A file in several pieces, or
    without rows, gives no place.
    """
    parts = [*islice(pieces(), 2)]
    if len(parts) > 1 or parts[0].ndim < 2:
        return ""
    return f" at cell {tuple(int(i) for i in np.argwhere(parts[0] == number)[0])}"
