"""The panels of a search drawing, one for each layer of cells, labelled with the altitude of the layer."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from math import ceil, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.search.allocation.layers import layers_of
from shoal.search.allocation.plan import SearchPlan
from shoal.search.cells.clipping import rotated_shape
from shoal.search.cells.grid import CellGrid
from shoal.views.drawing.polygon_paths import rings_of

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]
_GAP = 0.12  # distance between panels, relative to a panel's longer side
_FINE = 2  # squares per side of the smallest cell, if layers have different cells


class LayerPanels:
    """A drawing of the cells of all layers, one panel for each layer. The drawing consists of rows of squares.

    Usually each square of the drawing is a cell. If the layers differ in cell size or orientation, the squares of the drawing are
    smaller than cells.

    The drawing is rotated by at most 90 degrees, so that the rows of cells in the lowest layer are horizontal, and north points up
    as far as possible. The panels of the layers follow each other from left to right and then downwards, beginning with the lowest
    layer.
    """

    def __init__(self, plan: SearchPlan) -> None:
        self.plan, self.layers = plan, layers_of(plan.grid)
        first = self.layers[0]
        self.angle = 90 - (90 - plan.grid.angle) % 180
        self._lattice = replace(first.lattice, angle=self.angle)
        self.alike = all(layer is first for layer in self.layers)
        self.step = first.size if self.alike else plan.grid.size / _FINE
        boxes = np.array([self._box(layer) for layer in dict.fromkeys(self.layers)])
        self.largest = max(layer.size for layer in self.layers)
        low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
        self._panel = np.rint(np.ceil((high - low) / self.step - 1e-6)).astype(np.int64)[::-1]  # rows and columns
        self._low_left = np.array([low[0], high[1] - self.step * self._panel[0]])
        gap = max(1, ceil(_GAP * int(self._panel.max()))) if len(self.layers) > 1 else 0
        wide = float(self._panel[1] + gap) / float(self._panel[0] + gap)
        self.columns = min(len(self.layers), max(1, round(sqrt(1.5 * len(self.layers) / wide))))
        self._apart = self._panel + gap

    def _box(self, layer: CellGrid) -> tuple[Floats, Floats]:
        """Return the lower left and upper right corner of a box around a layer's cells, in drawing coordinates in metres."""
        (left, top), (rows, columns) = layer.corner, layer.shape
        across, down = columns * layer.size, rows * layer.size
        corners = np.array([(left, top), (left + across, top), (left, top - down), (left + across, top - down)])
        turned = self._turned(layer.lattice.to_region(corners))
        return turned.min(axis=0), turned.max(axis=0)

    def _turned(self, points: Floats) -> Floats:
        return np.asarray(self._lattice.from_region(points))

    def _offsets(self, layers: Numbers) -> Floats:
        """Return the displacement of the panel of each given layer from the first panel, in metres; float64, shape (n, 2)."""
        return np.stack([layers % self.columns * self._apart[1], -(layers // self.columns) * self._apart[0]], axis=1) * self.step

    def place(self, points: Floats, layers: Floats | Numbers) -> Floats:
        """Convert points of the region in given layers to drawing coordinates in metres; float64, shape (n, 2)."""
        turned = self._turned(points)
        return turned if len(self.layers) == 1 else turned + self._offsets(layers.astype(np.int64))

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Number of rows and number of columns of squares in the whole drawing."""
        down = ceil(len(self.layers) / self.columns)
        rows, columns = (self._apart * (down - 1, self.columns - 1) + self._panel).tolist()
        return rows, columns

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """The left, right, bottom and top edges of all squares of the drawing, in metres."""
        left, top = float(self._low_left[0]), float(self._low_left[1] + self.step * self._panel[0])
        return left, left + self.shape[1] * self.step, top - self.shape[0] * self.step, top

    @cached_property
    def numbers(self) -> Numbers:
        """For each square of the drawing, the tour index of the cell that contains the square, or -1; int64, of shape `shape`."""
        found = np.full(self.shape, -1, dtype=np.int64)
        position = self.plan.tour.position
        rows, columns = self._panel.tolist()
        left, top = self.extent[0], self.extent[3]
        for number, layer in enumerate(self.layers):
            down, right = divmod(number, self.columns)
            y, x = np.indices((rows, columns)) + 0.5
            x, y = left + self.step * x, top - self.step * y
            middles = layer.lattice.from_region(self._lattice.to_region(np.column_stack([x.ravel(), y.ravel()])))
            row = np.floor((layer.corner[1] - middles[:, 1]) / layer.size).astype(np.int64)
            col = np.floor((middles[:, 0] - layer.corner[0]) / layer.size).astype(np.int64)
            inside = (row >= 0) & (col >= 0) & (row < layer.shape[0]) & (col < layer.shape[1])
            own = position if position.ndim == 2 else position[number]
            cells = np.full(len(middles), -1, dtype=np.int64)
            cells[inside] = own[row[inside], col[inside]]
            begin = self._apart * (down, right)
            found[begin[0] : begin[0] + rows, begin[1] : begin[1] + columns] = cells.reshape(rows, columns)
        return found

    @cached_property
    def parts(self) -> list[list[Floats]]:
        """The closed border lines of each part of the region in each layer, the outer line first, in drawing coordinates."""
        shapes = [(self.shape_of(layer.region.area, number)) for number, layer in enumerate(self.layers)]
        return [rings for shape in shapes for rings in rings_of(shape)]

    def shape_of(self, shape: Any, layer: int) -> Any:
        """Convert a Shapely geometry from region coordinates to the drawing coordinates of a layer."""
        from shapely.affinity import translate

        return translate(rotated_shape(shape, -self.angle), *self._offsets(np.array([layer]))[0].tolist())

    @property
    def labels(self) -> list[tuple[str, float, float]]:
        """The label of each panel, and the x and y of its upper left corner in metres. For a single layer, the list is empty."""
        if len(self.layers) == 1:
            return []
        ups, tour, (left, _, _, top) = self.plan.altitudes, self.plan.tour, self.extent
        words = [f"{up:.4g} m" for up in ups]
        if len({*ups}) < len(ups):
            turned = [f"rows at {tour.row_angle(one.angle, k):.4g}\N{DEGREE SIGN}" for k, one in enumerate(self.layers)]
            words = [f"{word}, {rows}" if len({*ups}) > 1 else rows for word, rows in zip(words, turned, strict=True)]
        offsets = self._offsets(np.arange(len(ups)))
        return [(word, left + float(x), top + float(y)) for word, (x, y) in zip(words, offsets, strict=True)]


def sizes_text(plan: SearchPlan) -> str:
    """Return the side of the cells, or the range of sides, as a text such as "8.8 to 14.7 m"."""
    low, high = (choose(layer.size for layer in layers_of(plan.grid)) for choose in (min, max))
    return f"{low:.3g} m" if low == high else f"{low:.3g} to {high:.3g} m"
