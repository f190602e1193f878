"""Built-in regions: simple shapes whose names contain their sizes in metres."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable

import numpy as np

from shoal.core.errors import InvalidInputError, UnknownNameError
from shoal.search.regions.outline_checks import Points, RegionOutline, RegionOutlines, Ring

_CORNERS = 360  # corners of the polygon that approximates a circle

Shape = Callable[[str, list[float]], list[Points]]


def builtin_region(text: str) -> RegionOutlines:
    """Return the outline of a built-in region from its name with sizes, such as ``square:100``; see `shoal.search.open_region`.

    Raises
    ------
    InvalidInputError, UnknownNameError
    """
    name, _, option = text.partition(":")
    if name not in SHAPES:
        near = difflib.get_close_matches(name, SHAPES, n=1, cutoff=0.5)
        guess = f"did you mean {near[0]!r}? " if near else ""
        known = ", ".join(f"{known}:{form}" for known, (form, _) in SHAPES.items())
        raise UnknownNameError(f"unknown region {text[:80]!r}: {guess}(known: {known}, or a file)")
    form, shape = SHAPES[name]
    numbers = option.lower().removesuffix("m").split("x")
    expected = f"{name}:{form}"
    try:
        sizes = [float(part) for part in numbers]
    except ValueError:
        sizes = []
    if len(sizes) != form.count("x") + 1 or not all(0 < size <= 1e6 for size in sizes):
        raise InvalidInputError(
            f"region {text[:80]!r}: expected {expected} with lengths in metres, above 0 and at most 1000000, got {option!r}"
        )
    rings = [Ring(np.vstack([points, points[:1]]), f"region {text!r}") for points in shape(text, sizes)]
    height = sizes[2] if name == "box" else 0.0
    return RegionOutlines((RegionOutline(rings[0], tuple(rings[1:])),), f"region {text!r}", geographic=False, height=height)


def is_builtin(text: str) -> bool:
    """Return whether a text has the form of a built-in region's name, such as ``square:100``, and therefore names no file."""
    return re.fullmatch(r"\w+(:[\w.+-]*)?", text) is not None and not re.search(r"\.[A-Za-z]\w*$", text)


def _rectangle(width: float, height: float) -> list[Points]:
    return [np.array([(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)])]


def _circle(radius: float) -> Points:
    angles = 2 * np.pi * np.arange(_CORNERS) / _CORNERS
    return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _annulus(text: str, sizes: list[float]) -> list[Points]:
    if not sizes[1] < sizes[0]:
        raise InvalidInputError(f"region {text!r}: expected an inner radius below the outer one, {sizes[0]:g}, got {sizes[1]:g}")
    return [_circle(sizes[0]), _circle(sizes[1])]


SHAPES: dict[str, tuple[str, Shape]] = {
    "square": ("SIDE", lambda _, sizes: _rectangle(sizes[0], sizes[0])),
    "rectangle": ("WIDTHxHEIGHT", lambda _, sizes: _rectangle(*sizes)),
    "circle": ("RADIUS", lambda _, sizes: [_circle(sizes[0])]),
    "ring": ("OUTERxINNER", _annulus),
    "box": ("WIDTHxDEPTHxHEIGHT", lambda _, sizes: _rectangle(*sizes[:2])),
}
