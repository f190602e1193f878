"""The choices of a user that decide what a region file means, such as the layer of a GeoPackage."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import field

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.regions.outline_checks import Points

HIDDEN = ("use", "skip")
"""Possible meanings of a polygon that a KML file hides."""


@dataclass
class Reading:
    """How to read a region file. A reader adds the name of each choice that had an effect to ``effects``.

    Parameters
    ----------
    layer : str, optional
        Name of the layer of a GeoPackage, or the part of a plan of QGroundControl.
    hidden : "use" or "skip", optional
        Meaning of polygons that a KML file hides. By default, a reader refuses hidden polygons.
    closed_lines : bool
        Whether closed lines are polygons.
    effects : set of str
    """

    layer: str | None = None
    hidden: str | None = None
    closed_lines: bool = False
    effects: set[str] = field(default_factory=set)

    def is_polygon(self, points: Points) -> bool:
        """Return whether a line with the given vertices is a polygon, because it is closed and the user wants closed lines."""
        closed = self.closed_lines and len(points) > 3 and bool((points[0] == points[-1]).all())
        if closed:
            self.effects.add("closed_lines")
        return closed

    def check_effects(self, where: Iterable[str]) -> None:
        """Refuse choices without an effect on any of the files ``where``.

        Raises
        ------
        InvalidInputError
        """
        files = ", ".join(where)
        if self.closed_lines and "closed_lines" not in self.effects:
            raise InvalidInputError(f"--closed-lines: expected a file with a closed line, got none in {files}")
        if self.hidden is not None and "hidden" not in self.effects:
            raise InvalidInputError(f"--hidden: expected a KML file with a hidden polygon, got none in {files}")


def only_lines_text(kinds: Iterable[str], *, closed_lines: bool) -> str:
    """Return what a file without polygons contains, for error messages, with the option that reads closed lines as polygons."""
    told = "only " + " and ".join(sorted(kinds)) if kinds else "none"
    lines = any("Line" in kind for kind in kinds)
    return told + ("; --closed-lines reads closed lines as polygons" if lines and not closed_lines else "")


def points_of(pairs: Iterable[tuple[float, float]]) -> Points:
    """Return pairs of numbers as an array; float64, shape (n, 2)."""
    return np.array([*pairs], dtype=np.float64).reshape(-1, 2)
