"""Code for all readers of map files: options, size limits, and one-sentence error messages for
damaged files.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_integer, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.core.problem import Problem, option

Mask = NDArray[np.bool_]

Cells = tuple[Mask, tuple[float, ...] | None]
"""The content of a map file: the free cells, and the size of a cell along each axis (mm), or None
if the file does not contain the size.
"""

MAX_CELLS = 2**28
"""Maximum number of cells in a map (16384 x 16384)."""

MAX_LAYERS = 2**13
"""Maximum number of layers in a map: pages of a TIFF file, or pictures in a folder."""

LARGEST_DATA = 2**30
"""Maximum number of bytes to which the data of a map file unfold. Shoal checks the number before it
unfolds the data.
"""

LARGEST_PICTURE = 2**29
"""Maximum number of bytes of one decoded picture or page."""

PIECE = 1 << 22
"""Number of values that a reader converts at a time, so that a file of wide numbers costs no more
memory than its map.
"""

LOW, HIGH = 0.6, 1.2
"""Usual thresholds of vessels in a photograph, as multiples of the threshold that best splits the
responses of the filters.
"""

WHITE = 0.5
"""Smallest brightness of a free pixel if no ``threshold`` is given."""


@dataclass(frozen=True)
class Kind:
    """A kind of map source, and the reading options that have a meaning for it.

    Parameters
    ----------
    words : str
        The kind in the words of an error message, such as "a picture".
    options : frozenset of str
        Names of the reading options that the reader uses. `check_used` refuses the others.
    """

    words: str
    options: frozenset[str] = frozenset()


_SIZE = ("width", "join_diagonals")
_NUMBERS = ("invert", "level", "label", *_SIZE)
_PICTURES = ("threshold", "scale", "channel", "frame", *_NUMBERS)
_VESSELS = ("vessels", "width", "low", "high", "bright", "thickest")

KINDS: dict[str, Kind] = {
    "generated": Kind("a generated map"),
    "workspace": Kind("a finished workspace"),
    "numbers": Kind("an array", frozenset(_NUMBERS)),
    "picture": Kind("a picture", frozenset((*_PICTURES, "vessels"))),
    "slices": Kind("a folder of slices", frozenset(_PICTURES)),
    "photograph": Kind("a photograph", frozenset((*_VESSELS, "channel", "frame"))),
    "letters": Kind("a map of letters", frozenset(("invert", *_SIZE))),
    "table": Kind("a table of numbers", frozenset(_NUMBERS)),
    "array": Kind("an array file", frozenset((*_NUMBERS, "channel"))),
    "volume": Kind("a volume", frozenset((*_NUMBERS, "channel", "frame"))),
}
"""All kinds of map sources. A reading option that is not among the options of a kind is refused for
each map of the kind.
"""

REASONS: dict[str, str] = {
    "vessels": "vessels are found in a photograph",
    "width": "the size of a map file can be changed",
    **dict.fromkeys(
        ("low", "high", "bright", "thickest"),
        "it belongs to the option vessels, which finds vessels in a photograph",
    ),
    "threshold": (
        "a threshold is a share of the brightness of white in a picture; --level gives a number"
    ),
    "invert": "invert exchanges the free cells and the obstacles of a map file",
    "scale": "a scale gives the number of cells for each pixel of a picture",
    "level": "a level needs one number for each cell",
    "label": "a label needs one number for each cell",
    "channel": "only pictures, arrays and volumes have channels",
    "frame": "only pictures and volumes have several points in time",
    "join_diagonals": "diagonal contacts are joined in map files",
}
"""All reading options, each with the reason for which a kind of map does not take it."""

PHOTOGRAPH_REASONS: dict[str, str] = {
    "threshold": "--low and --high are the thresholds of vessels",
    "invert": "--bright and --no-bright say which lines are vessels",
    "scale": "--width gives the size of the map of vessels",
    "level": "--low and --high are the thresholds of vessels",
    "label": "vessels are found by their shape",
    "join_diagonals": "the network of vessels is connected",
}
"""The reasons for which the option ``vessels`` excludes another reading option."""


def check_used(kind: Kind, options: Mapping[str, Any], *, where: str = "") -> None:
    """Refuse reading options that have no effect on a kind of map.

    Parameters
    ----------
    kind : Kind
    options : mapping
        Name and value of each option that the user has set.
    where : str
        Name of the map in the error message.
    """
    for name, value in options.items():
        if name not in kind.options:
            reasons = REASONS | (PHOTOGRAPH_REASONS if kind is KINDS["photograph"] else {})
            place = f"{where}: " if where else ""
            if name == "vessels" and value:
                raise InvalidInputError(f"{place}vessels: expected a photograph, got {kind.words}")
            of_vessels = (
                kind.words != "a photograph"
                and name in _VESSELS
                and name not in {"vessels", "width"}
            )
            expected = "without the option vessels" if of_vessels else f"for {kind.words}"
            flag = name.replace("_", "-")
            raise InvalidInputError(
                f"{place}{flag}: expected no {flag} {expected}, got {shortened(value)}"
                f" ({reasons[name]})"
            )


def check_channel(channel: Any) -> int | str | None:
    """Check the name or the number of a channel. A text of digits is a number.

    Examples
    --------
    >>> check_channel("2"), check_channel("green")
    (2, 'green')
    """
    if channel is None:
        return None
    if isinstance(channel, str) and channel.strip() and not channel.strip().isdecimal():
        return channel.strip()
    number = (
        int(channel)
        if isinstance(channel, str)
        and channel.strip().isdecimal()
        and channel.isascii()
        and len(channel) < 10
        else channel
    )
    if isinstance(number, str):
        raise InvalidInputError(
            "channel: expected the name of a channel or its number from 1, got"
            f" {shortened(channel)}"
        )
    return check_integer(number, what="channel", least=1)


@dataclass(frozen=True, eq=False)
class MapOptions(Problem):
    """Options for the conversion of a file to a map.

    Parameters
    ----------
    threshold : float, optional
        For pictures: the smallest brightness of a free pixel, on a scale from 0 (black) to 1
        (white). By default, a picture of two colours is a mask, whose brighter colour is free, and
        the threshold of every other picture is 0.5.
    invert : bool
        Whether the free cells and the obstacles are exchanged. In an inverted picture, dark pixels
        are free.
    scale : float
        For pictures: the number of cells per pixel along each side, above 0 and at most 64. A scale
        of 0.5 halves both sides of the picture.
    level : float, optional
        The smallest number of a free cell, for grey pictures, tables, arrays and volumes.
    label : int, optional
        The exact number of all free cells, for grey pictures, pictures with a palette, tables,
        arrays and volumes.
    channel : int or str, optional
        The channel of a picture, array or volume that is read: a number from 1, or a name such as
        "red" or "alpha".
    frame : int, optional
        The point in time that is read, from 1, in a file with a time axis.
    join_diagonals : bool
        Whether parts of the map that touch only diagonally are joined, by one more free cell at
        each contact.

    Raises
    ------
    InvalidInputError
        Raised if an option is out of range, or if more than one of ``threshold``, ``level`` and
        ``label`` is given.
    """

    part: ClassVar[str] = "map"

    threshold: float | None = option(
        None,
        help=(
            "For pictures: minimum brightness of a free pixel, from 0 (black) to 1 (white). By"
            " default, a picture of two brightnesses is a mask, whose brighter pixels are free, and"
            " every other picture has the threshold 0.5."
        ),
        least=0,
        most=1,
    )
    invert: bool = option(
        False,
        help=(
            "For map files: exchange free cells and obstacles. In a picture, dark pixels are free."
        ),
    )
    scale: float = option(
        1.0,
        help=(
            "For pictures: number of cells for each pixel along each side; what was connected stays"
            " connected."
        ),
        above=0,
        most=64,
    )
    level: float | None = option(
        None,
        help=(
            "For grey pictures, tables, arrays and volumes: minimum number of a free cell, as the"
            " file stores it."
        ),
    )
    label: int | None = option(
        None,
        help=(
            "Number (label) of all free cells. For grey pictures, pictures with a palette, tables,"
            " arrays and volumes."
        ),
    )
    channel: int | str | None = option(
        None,
        help=(
            "For pictures, arrays and volumes of several channels: the channel that is read, by its"
            " number from 1 or by its name, such as red, green, blue or alpha."
        ),
        metavar="CHANNEL",
        parse=check_channel,
        check=check_channel,
    )
    frame: int | None = option(
        None,
        help="For pictures and volumes with a time axis: the point in time that is read, from 1.",
        least=1,
    )
    join_diagonals: bool = option(
        False,
        help=(
            "For files: where parts of the map touch only diagonally, open one cell, because"
            " particles cannot move diagonally."
        ),
    )

    def check_together(self) -> None:
        """Refuse more than one of a threshold, a level and a label."""
        decided = [
            (name, value)
            for name in ("threshold", "level", "label")
            if (value := getattr(self, name)) is not None
        ]
        if len(decided) > 1:
            (first, value), (second, second_value) = decided[:2]
            raise InvalidInputError(
                f"{first}: expected a {first} or a {second}, got both: {value:g} and"
                f" {second_value:g}"
            )

    @property
    def given_values(self) -> dict[str, Any]:
        """Name and value of each option that the user has given, also at its default."""
        return {name: getattr(self, name) for name in self.declarations() if name in self.given}

    @property
    def by_number(self) -> bool:
        """Whether a level or a label decides about each number of the file."""
        return self.level is not None or self.label is not None


def map_options(options: Mapping[str, Any]) -> MapOptions:
    """Return the options for reading a map. An option that is None is not given."""
    return MapOptions(**{name: value for name, value in options.items() if value is not None})


def index_of(
    names: list[str], channel: int | str | None, *, where: str, axis: str = "channel"
) -> int:
    """Return the index of the chosen entry of an axis, such as the channels or the points in time.

    Parameters
    ----------
    names : list of str
        Name of each entry of the axis, or empty texts for entries without a name.
    channel : int or str, optional
        The chosen entry: its name, or its number from 1. For an axis with one entry, the choice may
        be None.
    where : str
        Name of the file in error messages.
    axis : str
        Word for an entry of the axis, and name of the option that chooses it.

    Raises
    ------
    InvalidInputError
        Raised if the axis has several entries and none is chosen, or if the axis does not contain
        the chosen entry.
    """
    entries = [
        f"{number} ({name})" if name else str(number)
        for number, name in enumerate(names[:8], start=1)
    ]
    choices = ", ".join(entries) + (f", … {len(names)}" if len(names) > 8 else "")
    if channel is None:
        if len(names) == 1:
            return 0
        raise InvalidInputError(
            f"{where}: expected the choice of one {axis} (--{axis}), got {len(names)}: {choices}"
        )
    number = check_channel(channel)
    if len(names) == 1 and not names[0] and number == 1:
        return 0
    if isinstance(number, int) and number <= len(names):
        return number - 1
    lower = [name.lower() for name in names]
    if isinstance(number, str) and number.lower() in lower:
        return lower.index(number.lower())
    raise InvalidInputError(f"{where}: {axis}: expected one of {choices}, got {shortened(channel)}")


AXES = {"frame": "a time axis", "channel": "channels"}
"""The axis of a file of which a reading option chooses an entry."""


class AxisChoices:
    """The entries of the axes of one file that the reading options choose. Each option must find
    its axis.

    Parameters
    ----------
    path : path
    options : MapOptions
    """

    def __init__(self, path: Path, options: MapOptions) -> None:
        self.path = path
        self._unused: dict[str, int | str] = {
            name: value for name in AXES if (value := getattr(options, name)) is not None
        }

    def index(self, axis: str, names: list[str]) -> int:
        """Return the index of the chosen entry of an axis, with ``names`` as in `index_of`.

        Raises
        ------
        InvalidInputError
            Raised if there are several entries and none is chosen, or if a choice has no effect.
        """
        if names == [""] and self._unused.get(axis, 1) != 1:
            self.check_used(axis)
        return index_of(names, self._unused.pop(axis, None), where=str(self.path), axis=axis)

    def check_used(self, axis: str = "") -> None:
        """Refuse a choice that was not taken, of the given axis or of any."""
        for name, value in self._unused.items():
            if axis in ("", name):
                raise InvalidInputError(
                    f"{self.path}: {name}: expected no {name} for a file without {AXES[name]}, got"
                    f" {value}"
                )


def check_layers(where: Path, count: int) -> None:
    """Refuse a map of more than `MAX_LAYERS` layers."""
    if count > MAX_LAYERS:
        raise InvalidInputError(f"{where}: expected at most {MAX_LAYERS} layers, got more")


def check_size(where: Path | str, *sides: int) -> None:
    """Refuse a map of more than `MAX_CELLS` cells."""
    if prod(int(side) for side in sides) > MAX_CELLS:
        raise InvalidInputError(
            f"{where}: expected at most {MAX_CELLS} cells, got {'x'.join(map(str, sides))}"
        )


def check_data(where: Path | str, size: int, *, most: int | None = None) -> None:
    """Refuse a file whose data unfold to more than ``most`` bytes (by default, `LARGEST_DATA`)."""
    most = LARGEST_DATA if most is None else most
    if size > most:
        raise InvalidInputError(f"{where}: expected at most {most} bytes of data, got {size}")


@contextmanager
def reading(path: Path, what: str) -> Iterator[None]:
    """Convert exceptions that a library raises for damaged files into one-sentence errors. Hide the
    warnings of the library.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        except ShoalError:
            raise
        except Exception as error:  # file readers raise many kinds of exceptions
            if isinstance(error, OSError) and error.filename is not None:
                raise  # the file cannot be opened, which says nothing about its content
            why = " ".join(str(error).split())[:160] or type(error).__name__
            raise InvalidInputError(
                f"{path}: expected {what}, got a damaged or truncated file: {why}"
            ) from None


_MILLIMETRES = {
    "nm": 1e-6,
    "nanometer": 1e-6,
    "nanometre": 1e-6,
    "um": 1e-3,
    "µm": 1e-3,
    "μm": 1e-3,
    "\\u00b5m": 1e-3,
    "micron": 1e-3,
    "microns": 1e-3,
    "micrometer": 1e-3,
    "micrometre": 1e-3,
    "mm": 1.0,
    "millimeter": 1.0,
    "millimetre": 1.0,
    "cm": 10.0,
    "centimeter": 10.0,
    "centimetre": 10.0,
    "m": 1000.0,
    "meter": 1000.0,
    "metre": 1000.0,
    "inch": 25.4,
    "in": 25.4,
}


def millimetres(unit: str) -> float | None:
    """Return a unit of length in millimetres, or None for a text that is no unit of length, such as
    "pixel".

    Examples
    --------
    >>> millimetres("micron"), millimetres("µm"), millimetres("pixel")
    (0.001, 0.001, None)
    """
    return _MILLIMETRES.get(unit.strip().lower())
