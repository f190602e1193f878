"""GridWorkspace: the free cells of a map."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_array, check_text, shortened
from shoal.core.dataclass import dataclass
from shoal.core.display import displayed
from shoal.core.errors import InvalidInputError
from shoal.jit.kernels.connected import connected_parts
from shoal.swarm.maps.reading import MAX_CELLS

UNKNOWN, FRONTIER, FREE, OBSTACLE, PARTICLE = range(5)
"""Codes for the content of a cell: the states that `Belief.states` returns, and the code of a free
cell with a particle.
"""

# The colours differ for all common kinds of colour blindness and in greyscale: particles vermilion,
# frontier sky blue.
PALETTE: dict[str, str] = {
    "unknown": "#8f96a1",
    "frontier": "#62c4f7",
    "free": "#ffffff",
    "obstacle": "#1b222c",
    "particle": "#d55e00",
}
COLOURS = np.array(
    [tuple(bytes.fromhex(colour[1:])) for colour in PALETTE.values()], dtype=np.uint8
)
MOST_LINES = 200  # a map with more rows, counted over all layers, is not printed as rows of text
_WIDEST = 12  # maps with a larger ratio of width to height are drawn in several strips


def raster_of(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a picture of cells with one pixel per cell. The layers of a 3-D map stand side by side
    in the picture.

    Parameters
    ----------
    codes : ndarray of uint8, shape (H, W) or (D, H, W)
        Code of each cell: UNKNOWN, FRONTIER, FREE, OBSTACLE or PARTICLE.

    Returns
    -------
    ndarray of uint8, shape (H, W, 3)
    """
    if codes.ndim == 3:
        gap = np.full((codes.shape[1], 1), FREE, dtype=codes.dtype)  # white columns between layers
        codes = np.hstack([strip for layer in codes for strip in (layer, gap)][:-1])
    return COLOURS[codes]


def text_rows(cells: NDArray[np.bool_], letters: str) -> str:
    """Return cells as rows of text. The first letter in ``letters`` stands for True cells, and the
    second letter for False cells.

    In 3-D, an empty line separates two layers of cells.

    Examples
    --------
    >>> text_rows(np.array([[True, False]]), ".#")
    '.#'
    """
    layers = np.where(cells, letters[0], letters[1]).reshape(-1, *cells.shape[-2:])
    return "\n\n".join("\n".join("".join(row) for row in layer) for layer in layers)


def in_strips(raster: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Cut a very wide picture into strips, and stack the strips like lines of text.

    Examples
    --------
    >>> in_strips(np.zeros((3, 5002, 3), np.uint8)).shape
    (111, 179, 3)
    """
    height, width = raster.shape[:2]
    if width <= _WIDEST * height:
        return raster
    strip = round(float(np.sqrt(1.6 * width * (height + 1))))
    count = -(-width // strip)
    sheet = np.full((count * (height + 1) - 1, strip, 3), 255, dtype=np.uint8)
    for i in range(count):
        segment = raster[:, i * strip : (i + 1) * strip]
        sheet[i * (height + 1) : i * (height + 1) + height, : segment.shape[1]] = segment
    return sheet


def png_bytes(raster: NDArray[np.uint8], *, side: int = 640) -> bytes:
    """Return a picture as the bytes of a PNG file with sides of at most ``side`` pixels.

    A larger picture loses rows and columns at regular intervals. A smaller picture is enlarged by a
    whole-number factor.
    """
    from PIL import Image

    sheet = in_strips(raster)
    largest = max(sheet.shape[:2])
    every, times = max(1, -(-largest // side)), max(1, side // largest)
    sheet = np.repeat(np.repeat(sheet[::every, ::every], times, axis=0), times, axis=1)
    buffer = io.BytesIO()
    Image.fromarray(sheet).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()


def check_free(free: ArrayLike) -> NDArray[np.bool_]:
    """Return ``free`` as a read-only boolean array with at least one free cell.

    Parameters
    ----------
    free : array_like of bool, shape (H, W) or (D, H, W)
        Array that is True where a particle can be. Nonzero numbers count as free.

    Raises
    ------
    InvalidInputError
        Raised if the array has neither 2 nor 3 dimensions, has no free cell, contains NaN or masked
        cells, or has more than ``MAX_CELLS`` cells.
    """
    array = check_array(free, expected="workspace: expected rows of booleans or numbers")
    if array.ndim not in (2, 3):
        raise InvalidInputError(
            f"workspace: expected a 2-D or 3-D array of cells, got {array.ndim} dimensions"
        )
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        cell = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
        raise InvalidInputError(
            f"workspace: expected finite numbers, got {array[cell]} at cell {cell}"
        )
    if array.size == 0:
        raise InvalidInputError(f"workspace: expected at least one cell, got shape {array.shape}")
    if array.size > MAX_CELLS:
        raise InvalidInputError(
            f"workspace: expected at most {MAX_CELLS} cells, got {array.size} {array.shape}"
        )
    checked = np.array(
        array if array.dtype == np.bool_ else array != 0,
        order="C",
        copy=array.dtype == np.bool_ or None,
    )
    if not checked.any():
        raise InvalidInputError(
            f"workspace: expected at least one free cell, got {checked.size} obstacles only"
        )
    checked.setflags(write=False)
    return checked


@dataclass(frozen=True, eq=False)
class GridWorkspace:
    """The free cells of a 2-D or 3-D grid. All cells outside the array are obstacles.

    Parameters
    ----------
    free : array_like of bool, shape (H, W) or (D, H, W)
        Array that is True where a particle can be. Row 0 is at the top of the map, and layer 0 is
        at the front. The free cells may form several disconnected parts, and corridors may be one
        cell wide. The workspace stores a read-only copy of the array.
    name : str
        Name of the workspace, as written in summaries and files.
    spacing : tuple of float, optional
        Size of a cell along each axis in millimetres, if known. Shoal uses the spacing for the
        scale bars of figures, and stores it in NIfTI files. The simulation measures all distances
        in cells.

    Raises
    ------
    InvalidInputError
        Raised if `check_free` refuses ``free``, or if a spacing is not above 0.

    Notes
    -----
    Sources: paper M, section III, and docs/concepts/world.md.

    Examples
    --------
    >>> workspace = GridWorkspace([[1, 1, 0], [0, 1, 1]], name="stairs")
    >>> workspace.shape, workspace.n_free
    ((2, 3), 4)
    >>> print(workspace)
    ..#
    #..
    """

    free: NDArray[np.bool_]
    name: str = field(default="workspace", kw_only=True)
    spacing: tuple[float, ...] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "free", check_free(self.free))
        if self.spacing is not None:
            try:
                sides = tuple(float(side) for side in self.spacing)
            except (TypeError, ValueError):
                sides = ()
            if len(sides) != self.free.ndim or not all(0 < side < float("inf") for side in sides):
                raise InvalidInputError(
                    f"spacing: expected {self.free.ndim} sizes above 0, got {self.spacing}"
                )
            object.__setattr__(self, "spacing", sides)

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of ``free``, which is (rows, columns) or (layers, rows, columns)."""
        return self.free.shape

    @property
    def ndim(self) -> int:
        """Number of dimensions of the workspace: 2 or 3."""
        return self.free.ndim

    @cached_property
    def n_free(self) -> int:
        """Number of free cells in the workspace (m in the papers)."""
        return int(np.count_nonzero(self.free))

    @cached_property
    def cells(self) -> NDArray[np.int64]:
        """All free cells in row-major order (int64, shape (m, 2) or (m, 3))."""
        return np.argwhere(self.free)

    @cached_property
    def components(self) -> NDArray[np.int32]:
        """The label of each cell's connected component, or 0 for obstacles (int32, with the shape
        of ``free``).
        """
        return connected_parts(self.free)[0]

    def largest_component(self) -> GridWorkspace:
        """Return the largest connected component of the workspace.

        Of several equally large components, return the component with the smallest label in
        `components`.
        """
        sizes = np.bincount(self.components.ravel())
        sizes[0] = 0
        return GridWorkspace(
            self.components == int(np.argmax(sizes)), name=self.name, spacing=self.spacing
        )

    @property
    def text(self) -> str:
        """The map as rows of text, with ``.`` for free cells and ``#`` for obstacles. In 3-D, an
        empty line separates two layers.

        The function ``print`` shows a small workspace as rows of text.
        """
        return text_rows(self.free, ".#")

    def to_dict(self) -> dict[str, Any]:
        """Return the workspace as JSON data, with rows of ``.`` and ``#``. In 3-D, an empty row
        precedes each layer.
        """
        rows = self.text.split("\n")
        data: dict[str, Any] = {"name": self.name, "rows": ["", *rows] if self.ndim == 3 else rows}
        return data if self.spacing is None else data | {"spacing": list(self.spacing)}

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> GridWorkspace:
        """Return the workspace for JSON data that `to_dict` returned."""
        rows: Any = data.get("rows")
        if (
            not isinstance(rows, list)
            or set(data) - {"name", "rows", "spacing"}
            or not all(isinstance(row, str) for row in rows)
        ):
            raise InvalidInputError(
                "map: expected a name, a path, an array, or an object with name, rows and spacing,"
                f" got {shortened(data)}"
            )
        for row in rows:
            if set(row) - {".", "#"}:
                raise InvalidInputError(f"map: expected rows of . and #, got {shortened(row)}")
        layers = [layer.split("\n") for layer in "\n".join(rows).strip("\n").split("\n\n")]
        free: Any = [[[letter == "." for letter in row] for row in layer] for layer in layers]
        name = check_text(data.get("name", "workspace"), what="map")
        return cls(
            free if rows and not rows[0] else free[0], name=name, spacing=data.get("spacing")
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, GridWorkspace) and np.array_equal(self.free, other.free)

    def __hash__(self) -> int:
        return hash((self.shape, self.free.tobytes()))

    def __str__(self) -> str:
        return self.text if int(np.prod(self.shape[:-1])) <= MOST_LINES else repr(self)

    def __repr__(self) -> str:
        size = "x".join(map(str, self.shape))
        return f"<GridWorkspace {self.name!r}: {size}, {self.n_free} free cells>"

    @property
    def picture(self) -> NDArray[np.uint8]:
        """A picture of the workspace with one pixel per cell (uint8, shape (H, W, 3)). In 3-D, all
        layers stand side by side.
        """
        return raster_of(np.where(self.free, FREE, OBSTACLE).astype(np.uint8))

    def _repr_png_(self) -> object:
        return png_bytes(self.picture) if self.ndim == 2 else displayed("png", self)
