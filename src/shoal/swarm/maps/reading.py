"""Code that all map readers use: options, size limits, and one-sentence errors for damaged files."""

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
"""Maximum size of a map in cells (16384 x 16384)."""

MAX_LAYERS = 2**13
"""Maximum number of layers: pages of a TIFF, or slices in a folder."""


@dataclass(frozen=True)
class MapOptions:
    """Options for converting a file to a map.

    Parameters
    ----------
    threshold : float
        For pictures: brightness from 0 (black) to 1 (white) from which pixels are free.
    invert : bool
        For pictures: dark pixels are free instead of bright ones.
    scale : float
        For pictures: cells per pixel along each side, above 0 and at most 64. A scale of 0.5 halves both sides.
    level : float, optional
        For arrays and volumes: cells with at least this value are free.
    label : int, optional
        For arrays and volumes: cells with exactly this value are free. Without level and label, the data may contain only 0 for
        obstacles and one other value for free cells.

    Raises
    ------
    InvalidInputError
        If a value is out of range, or both a level and a label are given.
    """

    threshold: float = 0.5
    invert: bool = False
    scale: float = 1.0
    level: float | None = None
    label: int | None = None

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
    """Refuse more than `MAX_LAYERS` layers.

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
    """Convert any exception that a library raises for a damaged file into an error of one sentence. Hide the library's warnings.

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
