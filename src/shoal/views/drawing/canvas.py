"""A fast antialiased canvas for film frames, which uses the renderer of matplotlib but not its
figures and artists.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.colors import to_rgb
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import TextPath
from matplotlib.transforms import Affine2D
from numpy.typing import ArrayLike, NDArray
from PIL import Image

Colour = str
_CIRCLE = Path.unit_circle()


class Canvas:
    """A canvas of pixels, on which x points to the right and y points down, both in pixels."""

    def __init__(self, width: int, height: int, *, background: Colour = "#ffffff") -> None:
        self.width, self.height = width, height
        machine: Any = RendererAgg  # which has no type annotations
        self._renderer = machine(width, height, 72)  # a point is a pixel
        self._pixels = np.asarray(self._renderer.buffer_rgba())
        self._flip = Affine2D().scale(1, -1).translate(0, height)
        self._words: dict[tuple[str, float, bool], tuple[Path, float]] = {}
        self._pixels[...] = [*(round(255 * channel) for channel in to_rgb(background)), 255]
        self._kept = self._pixels.copy()

    def keep(self) -> None:
        """Store the current drawing as the background of all following frames."""
        self._kept[...] = self._pixels

    def clear(self) -> None:
        """Replace the drawing by the stored background."""
        self._pixels[...] = self._kept

    def frame(self) -> NDArray[np.uint8]:
        """Return a copy of the drawing as RGB pixels; uint8, shape (height, width, 3)."""
        # several times as fast as a slice
        return np.asarray(Image.fromarray(self._pixels).convert("RGB"))

    def paint(self, pixels: NDArray[np.uint8]) -> None:
        """Replace the drawing by the RGB picture ``pixels``; uint8, shape (height, width, 3)."""
        self._pixels[..., :3] = pixels

    def line(
        self,
        points: ArrayLike,
        colour: Colour,
        width: float,
        *,
        alpha: float = 1.0,
        closed: bool = False,
        dashes: tuple[float, ...] | None = None,
    ) -> None:
        """Draw a line through ``points``, an array of shape (n, 2), in pixels."""
        self._draw(_path([np.asarray(points)], closed=closed), None, colour, width, alpha, dashes)

    def lines(
        self, pieces: Sequence[ArrayLike], colour: Colour, width: float, *, alpha: float = 1.0
    ) -> None:
        """Draw several lines at once.

        One call of `lines` is faster than a call of `line` for each line. At a crossing of
        transparent lines, `lines` paints the colour once. Several calls of `line` paint the colour
        once for each line, so that the crossing is darker.
        """
        if pieces:
            self._draw(
                _path([np.asarray(piece) for piece in pieces], closed=False),
                None,
                colour,
                width,
                alpha,
                None,
            )

    def area(
        self,
        rings: Sequence[ArrayLike],
        fill: Colour,
        *,
        alpha: float = 1.0,
        edge: Colour | None = None,
        width: float = 0,
    ) -> None:
        """Fill the area inside closed lines (rings).

        The first ring is the outer border, and rings with the opposite orientation are holes.
        """
        outlines = [np.asarray(ring) for ring in rings if len(np.asarray(ring))]
        if outlines:
            self._draw(_path(outlines, closed=True), fill, edge, width, alpha, None)

    def disc(
        self,
        place: ArrayLike,
        radius: float,
        fill: Colour | None,
        *,
        edge: Colour | None = None,
        width: float = 0,
        alpha: float = 1.0,
    ) -> None:
        """Draw a disc, or only its border if ``fill`` is None."""
        x, y = np.asarray(place)
        self._draw(
            _CIRCLE.transformed(Affine2D().scale(radius).translate(x, y)),
            fill,
            edge,
            width,
            alpha,
            None,
        )

    def text(
        self,
        place: ArrayLike,
        words: str,
        colour: Colour,
        size: float,
        *,
        bold: bool = False,
        align: float = 0.0,
    ) -> float:
        """Write a text with its baseline at ``place``, and return the width of the text in pixels.

        The text is left-aligned if ``align`` is 0, centred if ``align`` is 0.5, and right-aligned
        if ``align`` is 1.
        """
        if not words:
            return 0.0
        path, width = self._outline(words, size, bold)
        x, y = np.asarray(place)
        transformed = path.transformed(
            Affine2D().scale(1, -1).translate(float(x) - align * width, float(y))
        )
        self._draw(transformed, colour, None, 0, 1.0, None)
        return width

    def _outline(self, words: str, size: float, bold: bool) -> tuple[Path, float]:
        """Return the outline of a text as a path, and the width of the text in pixels; a cache
        keeps known outlines.
        """
        outline = self._words.get((words, size, bold))
        if outline is None:
            font = FontProperties(family="DejaVu Sans", weight="bold" if bold else "normal")
            path: Path = TextPath((0, 0), words, size=size, prop=font)
            outline = path, float(np.asarray(path.vertices)[:, 0].max())
            if len(self._words) < 2000:
                self._words[words, size, bold] = outline
        return outline

    def _draw(
        self,
        path: Path,
        fill: Colour | None,
        edge: Colour | None,
        width: float,
        alpha: float,
        dashes: tuple[float, ...] | None,
    ) -> None:
        pen = self._renderer.new_gc()
        pen.set_alpha(alpha)
        pen.set_linewidth(width if edge else 0)
        pen.set_capstyle("butt" if dashes else "round")
        pen.set_joinstyle("round")
        pen.set_snap(False)
        if edge:
            pen.set_foreground(edge)
        if dashes:
            pen.set_dashes(0, dashes)
        self._renderer.draw_path(pen, path, self._flip, None if fill is None else to_rgb(fill))
        pen.restore()


def _path(rings: Sequence[NDArray[np.float64]], *, closed: bool) -> Path:
    corners, codes = [], []
    for ring in rings:
        corners.append(np.concatenate([ring, ring[:1]]) if closed else ring)
        codes += [
            Path.MOVETO,
            *[Path.LINETO] * (len(ring) - 1),
            *([Path.CLOSEPOLY] if closed else []),
        ]
    return Path(np.concatenate(corners), codes)


Ring = NDArray[np.float64]


def rings_of(area: Any) -> list[list[Ring]]:
    """Return the closed border lines (rings) of each part of an area, the outer ring first; each
    float64, shape (n, 2).
    """
    return [
        [np.asarray(ring.coords)[:, :2] for ring in (polygon.exterior, *polygon.interiors)]
        for polygon in getattr(area, "geoms", [area])
        if polygon.geom_type == "Polygon" and not polygon.is_empty
    ]


def path_of_rings(rings: Iterable[Ring]) -> Any:
    """Return several closed lines (rings) as one matplotlib path."""
    from matplotlib.path import Path

    return Path.make_compound_path(
        *(Path(np.vstack([ring, ring[:1]]), closed=True) for ring in rings)
    )


def hole_in(frame: Ring, ring: Ring) -> Ring:
    """Return the closed line ``ring`` with the orientation opposite to ``frame``. In drawings, this
    line is a hole in ``frame``.
    """
    areas = [float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) for x, y in (ring.T, frame.T)]
    return ring if areas[0] * areas[1] < 0 else ring[::-1]
