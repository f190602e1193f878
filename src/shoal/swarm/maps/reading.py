"""Code for all readers of map files: options, size limits, and one-sentence error messages for damaged files."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from math import prod
from pathlib import Path

from shoal.core.checks import check_integer, check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, ShoalError

MAX_CELLS = 2**28
"""Maximum number of cells in a map (16384 x 16384)."""

MAX_LAYERS = 2**13
"""Maximum number of layers in a map: pages of a TIFF file, or pictures in a folder."""


@dataclass(frozen=True)
class MapOptions:
    """Options for the conversion of a file to a map.

    Parameters
    ----------
    threshold : float
        For pictures: the smallest brightness of a free pixel, on a scale from 0 (black) to 1 (white).
    invert : bool
        For pictures: whether dark pixels are free, instead of bright pixels.
    scale : float
        For pictures: the number of cells per pixel along each side, above 0 and at most 64. A scale of 0.5 halves both sides of the
        picture.
    level : float, optional
        For arrays and volumes: the smallest value of a free cell.
    label : int, optional
        For arrays and volumes: the exact value of all free cells. If neither ``level`` nor ``label`` is given, all obstacles
        must have the value 0, and all free cells must have one common value other than 0.
    join_diagonals : bool
        Whether parts of the map that touch only diagonally are joined, by one more free cell at each contact.

    Raises
    ------
    InvalidInputError
        Raised if an option is out of range, or if both ``level`` and ``label`` are given.
    """

    threshold: float = 0.5
    invert: bool = False
    scale: float = 1.0
    level: float | None = None
    label: int | None = None
    join_diagonals: bool = False

    def __post_init__(self) -> None:
        check_number(self.threshold, what="threshold", least=0, most=1)
        check_number(self.scale, what="scale", above=0, most=64)
        if self.level is not None:
            check_number(self.level, what="level")
        if self.label is not None:
            check_integer(self.label, what="label")
        if self.level is not None and self.label is not None:
            raise InvalidInputError(f"level: expected a level or a label, got both: {self.level:g} and {self.label}")


def check_layers(where: Path, count: int) -> None:
    """Refuse a map of more than `MAX_LAYERS` layers.

    Raises
    ------
    InvalidInputError
    """
    if count > MAX_LAYERS:
        raise InvalidInputError(f"{where}: expected at most {MAX_LAYERS} layers, got more")


def check_size(where: Path, *sides: int) -> None:
    """Refuse a map of more than `MAX_CELLS` cells.

    Raises
    ------
    InvalidInputError
    """
    if prod(int(side) for side in sides) > MAX_CELLS:
        raise InvalidInputError(f"{where}: expected at most {MAX_CELLS} cells, got {'x'.join(map(str, sides))}")


@contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Convert exceptions that a library raises for damaged files into one-sentence errors. Hide the warnings of the library.

    Raises
    ------
    InvalidInputError
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        except ShoalError:
            raise
        except Exception as error:  # file readers raise many kinds of exceptions
            why = " ".join(str(error).split())[:160] or type(error).__name__
            raise InvalidInputError(f"{path}: expected {what}, got a damaged or truncated file: {why}") from None
