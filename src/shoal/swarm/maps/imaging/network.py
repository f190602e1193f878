"""Conversion of a photograph's vessels to a map: the largest connected vessel network on a grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm.maps.generators.components import Mask, crop, largest_part
from shoal.swarm.maps.imaging.segmentation import HIGH, LOW, find_vessels, imaging_module
from shoal.swarm.maps.parts import box_of

DEFAULT_WIDTH = 160  # cells
MUCH = 0.1  # share of the vessel pixels outside the map from which a notice is a warning


def segment_vessels(
    image: ArrayLike,
    *,
    width: int | None = None,
    low: float = LOW,
    high: float = HIGH,
    bright: bool | None = None,
    thickest: float | None = None,
) -> Mask:
    """Return the largest connected vessel network of a picture as a map.

    Parameters
    ----------
    image : array_like, shape (H, W), (H, W, 3) or (H, W, 4)
        Greyscale or colour picture with any range of values.
    width : int, optional
        Larger side of the map in cells. The default is 160 cells. If the vessels extend over fewer than ``width`` pixels, each cell
        of the map is one pixel.
    low, high, bright, thickest
        Options ``low``, ``high``, ``bright`` and ``thickest`` of the function `find_vessels`.

    Returns
    -------
    ndarray, bool, shape (H, W)
        True at free cells. The map contains one 4-connected network, and has no border rows or columns of obstacles.

    Raises
    ------
    InvalidInputError
        Raised if the array is not a picture, if an option is out of range, or if the picture shows no vessels.
    MissingExtraError
        Raised if scikit-image is not installed.
    """
    return map_of_vessels(find_vessels(image, low=low, high=high, bright=bright, thickest=thickest).mask, width=width)


def map_of_vessels(mask: Mask, *, width: int | None = None) -> Mask:
    """Return the largest connected network of a mask of shape (H, W) as a map of cells. Thin vessels stay connected.

    The map covers the bounding box of the vessel network. The longer side of the map has at most ``width`` cells, or at most 160
    cells if ``width`` is None.

    Raises
    ------
    InvalidInputError
        Raised if ``width`` is less than 1 cell.
    """
    vessels = crop(_joined(mask))
    factor = 1 / _pixels_a_cell(vessels, width)
    rows, columns = (np.floor(np.arange(length) * factor).astype(np.int64) for length in vessels.shape)
    shape = (int(rows[-1]) + 1, int(columns[-1]) + 1)
    cell = rows[:, None] * shape[1] + columns
    pixels = np.bincount(cell.ravel(), minlength=shape[0] * shape[1])
    share = (np.bincount(cell.ravel(), vessels.ravel(), shape[0] * shape[1]) / pixels).reshape(shape)
    free = (share > 0.5) | _trace(imaging_module("morphology").skeletonize(vessels), rows, columns, share)
    return crop(largest_part(free))


def pixels_a_cell(mask: Mask, *, width: int | None = None) -> float:
    """Return the side of one cell, in pixels, of the map that `map_of_vessels` makes from a mask of shape (H, W).

    Raises
    ------
    InvalidInputError
        Raised if ``width`` is less than 1 cell.
    """
    return _pixels_a_cell(crop(_joined(mask)), width)


def dropped_parts(mask: Mask) -> tuple[int, float]:
    """Return what `map_of_vessels` drops from a mask: the number of connected parts, and their share of the vessel pixels.

    The function counts parts after the bridging of gaps, and cells that share only a corner as connected.
    """
    from shoal.jit.kernels.connected import connected_parts

    dropped = mask & ~_joined(mask)
    pixels = int(np.count_nonzero(mask)) or 1
    return connected_parts(dropped, corners=True)[1], int(np.count_nonzero(dropped)) / pixels


def dropped_text(name: str, mask: Mask) -> str:
    """Return a notice about the vessels that are not in the map of a photograph. If all vessels are in the map, return ''."""
    parts, share = dropped_parts(mask)
    if not parts:
        return ""
    which = (
        f"1 other part with {100 * share:.2g} % of the vessel pixels is"
        if parts == 1
        else (f"{parts} other parts with {100 * share:.2g} % of the vessel pixels are")
    )
    kind = "warning" if share > MUCH else "notice"
    return f"shoal: {kind}: {name}: the map has the largest network of vessels; {which} dropped (a smaller --low connects more)"


def place_of_network(mask: Mask) -> tuple[tuple[tuple[int, int], ...], float]:
    """Return the first and last row and column of the network that `map_of_vessels` maps, and its share of all vessel pixels."""
    network = _joined(mask)
    return box_of(network), float((mask & network).sum() / max(1, mask.sum()))


def _pixels_a_cell(network: Mask, width: int | None) -> float:
    if width is not None and width < 1:
        raise InvalidInputError(f"expected a width of at least 1 cell, got {width}")
    return max(1.0, float(max(network.shape)) / (DEFAULT_WIDTH if width is None else width))


def _joined(mask: Mask) -> Mask:
    """Bridge gaps of up to 1 % of the mask's larger side, and return the largest connected network of the mask."""
    from scipy import ndimage

    reach = max(mask.shape) / 200
    wide = np.pad(mask, int(reach) + 2)
    wide = ndimage.distance_transform_edt(~wide) <= reach
    part = largest_part(wide, corners=True)
    inner = slice(int(reach) + 2, -int(reach) - 2)
    closed = (ndimage.distance_transform_edt(part) > reach)[inner, inner]
    return largest_part(
        (mask & part[inner, inner]) | imaging_module("morphology").skeletonize(closed | mask) & part[inner, inner], corners=True
    )


def _trace(skeleton: Mask, rows: NDArray[np.int64], columns: NDArray[np.int64], share: NDArray[np.float64]) -> Mask:
    """Return the cells through which a skeleton passes. A corner cell at each diagonal step makes the cells 4-connected."""
    free = np.zeros(share.shape, dtype=np.bool_)
    at = np.argwhere(skeleton)
    free[rows[at[:, 0]], columns[at[:, 1]]] = True
    padded = np.pad(skeleton, 1)
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        one = at[padded[at[:, 0] + 1 + down, at[:, 1] + 1 + right]]
        row_one, column_one = rows[one[:, 0]], columns[one[:, 1]]
        row_two, column_two = rows[one[:, 0] + down], columns[one[:, 1] + right]
        # If only the row or only the column changes, the corner cell equals one of the two cells.
        upper = share[row_one, column_two] >= share[row_two, column_one]
        free[np.where(upper, row_one, row_two), np.where(upper, column_two, column_one)] = True
    return free
