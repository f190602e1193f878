"""Find vessels in a photograph: a picture of a vascular tree becomes a map of free cells.

The steps, each a function below: one grey channel; the field of view (a fundus photograph has a dark
surround); what is darker than its surroundings and narrow; a ridge filter over several vessel widths;
thresholds with hysteresis; the largest connected network; cells. Needs scikit-image, the extra
``shoal[imaging]``.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.errors import InvalidInputError, MissingExtraError
from shoal.swarm.maps.generators.components import Mask, crop, largest_part

Grey = NDArray[np.float64]

DEFAULT_WIDTH = 160  # cells
LOW, HIGH = 0.24, 0.42  # thresholds of the ridge response, as fractions of that of clear vessels
THICKEST = 0.035  # width of the thickest vessel, as a fraction of the larger side of the picture
PIXELS_PER_CELL = 4  # larger pictures are shrunk to this before the slow steps
SMALLEST_SIDE, LARGEST_SIDE = 16, 960  # pixels that the slow steps see
LUMA = (0.2125, 0.7154, 0.0721)  # mostly green, the channel in which blood stands out
FAINTEST = 0.01  # difference between vessels and ground, as a share of the range of grey
SURROUND = 0.08  # a surround differs from black or white by at most this share of the range of grey


def segment_vessels(
    image: ArrayLike,
    *,
    width: int | None = None,
    low: float = LOW,
    high: float = HIGH,
    bright: bool | None = None,
    thickest: float = THICKEST,
) -> Mask:
    """Return the main vascular network of a picture as a map.

    Parameters
    ----------
    image : array_like, shape (H, W), (H, W, 3) or (H, W, 4)
        Grey or colour picture with any range of values; a fourth channel (opacity) is ignored.
    width : int, optional
        Larger side of the map in cells (160 if not given); less if the vessels cover fewer pixels than that.
    low, high : float
        Thresholds of the ridge response, as fractions of the response of clear vessels. A vessel goes on
        while it is above ``low``, and counts if it is above ``high`` somewhere. Lower values give more and
        finer vessels.
    bright : bool, optional
        Whether vessels are brighter than what is around them; if not given, the stronger of the two networks
        decides.
    thickest : float
        Width of the thickest vessel, as a fraction of the larger side of the picture.

    Returns
    -------
    ndarray, bool, shape (H, W)
        True where free: one 4-connected network, no empty rim.

    Raises
    ------
    InvalidInputError
        If the array is no picture, an option is out of range, or no vessels are found.
    MissingExtraError
        If scikit-image is not installed.
    """
    _check_options(width, low, high, thickest)
    grey = _check_image(image)
    cells = DEFAULT_WIDTH if width is None else width
    grey = _shrink(grey, min(PIXELS_PER_CELL * cells, LARGEST_SIDE))
    view = _field_of_view(grey)
    if bright is None:
        bright = _strength(1 - grey, view, thickest) > _strength(grey, view, thickest)
    depth = _narrow_and_dark(1 - grey if bright else grey, view, thickest)
    ridges = _ridges(depth, view, thickest)
    return _to_cells(_network(ridges, depth, view, low, high), cells)


def _check_options(width: int | None, low: float, high: float, thickest: float) -> None:
    if width is not None and width < 1:
        raise InvalidInputError(f"expected a width of at least 1 cell, got {width}")
    if not 0 < low <= high <= 1:
        raise InvalidInputError(f"expected thresholds with 0 < low <= high <= 1, got low={low} and high={high}")
    if not 0 < thickest <= 0.5:
        raise InvalidInputError(f"expected thickest as a fraction above 0 and at most 0.5, got {thickest}")


def _check_image(image: ArrayLike) -> Grey:
    """Return the picture in grey, from 0 to 1, float64, shape (H, W)."""
    array = np.asarray(image)
    if array.ndim not in (2, 3) or (array.ndim == 3 and array.shape[2] not in (3, 4)):
        raise InvalidInputError(f"expected a picture of shape (H, W), (H, W, 3) or (H, W, 4), got shape {array.shape}")
    if min(array.shape[:2]) < SMALLEST_SIDE:
        raise InvalidInputError(f"expected a picture of at least {SMALLEST_SIDE}x{SMALLEST_SIDE} pixels, got shape {array.shape}")
    if array.dtype.kind not in "buif":
        raise InvalidInputError(f"expected a picture of real numbers, got an array of {array.dtype}")
    grey = array[..., :3] @ np.array(LUMA) if array.ndim == 3 else array.astype(np.float64)
    if not np.isfinite(grey).all():
        raise InvalidInputError("expected a picture of finite numbers, got NaN or infinity in it")
    darkest, brightest = float(grey.min()), float(grey.max())
    if brightest - darkest <= 1e-9 * max(abs(brightest), abs(darkest)):
        raise InvalidInputError("expected a picture with vessels in it, got one in a single colour")
    return np.asarray((grey - darkest) / (brightest - darkest))


def _skimage(module: str) -> Any:
    """Return a module of scikit-image, which ships no types and takes long to import."""
    try:
        return importlib.import_module(f"skimage.{module}")
    except ImportError:
        raise MissingExtraError(
            "expected scikit-image to find vessels in a picture, and it is not installed: run pip install 'shoal[imaging]'"
        ) from None


def _shrink(grey: Grey, side: int) -> Grey:
    """Return the picture with its larger side at most ``side`` pixels."""
    resize = _skimage("transform").resize
    factor = side / max(grey.shape)
    if factor >= 1:
        return grey
    shape = [max(SMALLEST_SIDE, round(length * factor)) for length in grey.shape]
    return np.asarray(resize(grey, shape, anti_aliasing=True), dtype=np.float64)


def _field_of_view(grey: Grey) -> Mask:
    """Return where to look for vessels: not in a black or white surround, nor at its rim."""
    from scipy import ndimage

    rim = max(1, max(grey.shape) // 60)
    for plain in (grey < SURROUND, grey > 1 - SURROUND):
        parts = ndimage.label(np.pad(plain, 1, constant_values=True))[0]
        surround = parts == parts[0, 0]
        inside = ndimage.binary_opening(ndimage.binary_fill_holes(~surround), iterations=rim)
        view = ndimage.distance_transform_edt(inside)[1:-1, 1:-1] > rim
        # Vessels drawn on an empty ground have no solid inside: there the whole picture is the field of view.
        if surround.mean() > 0.05 and view.mean() > 0.35:
            return np.asarray(view)
    return np.ones(grey.shape, dtype=np.bool_)


def _strength(grey: Grey, view: Mask, thickest: float) -> float:
    """Return how clear the dark vessels are: the mean of the strongest twentieth of all responses."""
    grey, view = grey[::2, ::2], view[::2, ::2]
    depth = _narrow_and_dark(grey, view, thickest)
    sigmas = _sigmas(grey, thickest)[1::2]
    response: Grey = _skimage("filters").sato(depth, sigmas=sigmas, black_ridges=False)[view]
    return float(np.sort(response)[-max(1, len(response) // 20) :].mean())


def _ridges(depth: Grey, view: Mask, thickest: float) -> Grey:
    """Return how much each pixel looks like the middle of a deep line, 0 or more."""
    from scipy import ndimage

    if depth[view].max() < FAINTEST:
        raise InvalidInputError("expected a picture with vessels in it, found no line that stands out")
    # The same vessel counts the same in dull and in crisp parts of the picture.
    reach = max(depth.shape) / 20
    weight = ndimage.gaussian_filter(view.astype(np.float64), reach) + 1e-9
    relative = (depth - ndimage.gaussian_filter(depth * view, reach) / weight) * view
    spread = np.sqrt(np.maximum(ndimage.gaussian_filter(relative**2, reach) / weight, 0))
    relative /= spread + 0.3 * spread[view].mean()
    sigmas = _sigmas(depth, thickest)
    return np.asarray(_skimage("filters").sato(relative, sigmas=sigmas, black_ridges=False) * view)


def _narrow_and_dark(grey: Grey, view: Mask, thickest: float) -> Grey:
    """Return by how much each pixel is darker than its surroundings, wide dark areas left out.

    A closing, unlike a local mean, leaves no dark halo around a bright area such as the optic disc.
    """
    from scipy import ndimage

    if not view.all():
        nearest = ndimage.distance_transform_edt(~view, return_distances=False, return_indices=True)
        grey = grey[tuple(nearest)]
    size = max(3, round(1.3 * thickest * max(grey.shape)))
    # Carry on the edges outwards: else a picture that darkens towards its edge would have a dark line there.
    grey = ndimage.gaussian_filter(np.pad(grey, size, mode="edge"), _sigmas(grey, thickest)[0])
    depth = ndimage.grey_closing(grey, size=size) - grey
    return np.asarray(depth[size:-size, size:-size])


def _sigmas(grey: Grey, thickest: float) -> list[float]:
    """Return the scales of the ridge filter in pixels, from thin vessels to the thickest."""
    side = max(grey.shape)
    finest = max(0.6, side / 640)
    return [float(sigma) for sigma in np.geomspace(finest, max(finest, thickest * side / 4), 4)]


def _network(ridges: Grey, depth: Grey, view: Mask, low: float, high: float) -> Mask:
    """Return the largest connected part of what is above the thresholds."""
    from scipy import ndimage

    # Where vessels are rare, the quantile is that of the ground between them: then the strongest counts.
    clear = max(float(np.quantile(ridges[view], 0.995)), float(ridges.max()) / 2)
    vessels: Mask = _skimage("filters").apply_hysteresis_threshold(ridges, low * clear, high * clear)
    vessels = ndimage.binary_closing(np.pad(vessels, 2))[2:-2, 2:-2]
    return largest_part(_fill_crossings(vessels, depth), np.ones((3, 3)))


def _fill_crossings(vessels: Mask, depth: Grey) -> Mask:
    """Return the vessels without holes as deep as they are: a ridge filter is blind in a crossing."""
    from scipy import ndimage

    holes, number = ndimage.label(~vessels)
    deep = ndimage.mean(depth, holes, np.arange(number + 1)) > depth[vessels].mean() / 2
    return np.asarray(vessels | (deep[holes] & (holes > 0)))


def _to_cells(vessels: Mask, width: int) -> Mask:
    """Return the vessels on cells, the larger side at most ``width`` cells; a thin vessel stays connected."""
    vessels = crop(vessels)
    factor = min(1.0, width / max(vessels.shape))
    rows, columns = (np.floor(np.arange(length) * factor).astype(np.int64) for length in vessels.shape)
    shape = (int(rows[-1]) + 1, int(columns[-1]) + 1)
    cell = rows[:, None] * shape[1] + columns
    pixels = np.bincount(cell.ravel(), minlength=shape[0] * shape[1])
    share = (np.bincount(cell.ravel(), vessels.ravel(), shape[0] * shape[1]) / pixels).reshape(shape)
    free = (share >= 0.5) | _trace(_skimage("morphology").skeletonize(vessels), rows, columns, share)
    return crop(largest_part(free))


def _trace(skeleton: Mask, rows: NDArray[np.int64], columns: NDArray[np.int64], share: Grey) -> Mask:
    """Return the cells that a skeleton passes through, with a corner cell at each diagonal step."""
    free = np.zeros(share.shape, dtype=np.bool_)
    at = np.argwhere(skeleton)
    free[rows[at[:, 0]], columns[at[:, 1]]] = True
    padded = np.pad(skeleton, 1)
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        one = at[padded[at[:, 0] + 1 + down, at[:, 1] + 1 + right]]
        row_one, column_one = rows[one[:, 0]], columns[one[:, 1]]
        row_two, column_two = rows[one[:, 0] + down], columns[one[:, 1] + right]
        # When only one of them changes, both corners are one of the two cells.
        upper = share[row_one, column_two] >= share[row_two, column_one]
        free[np.where(upper, row_one, row_two), np.where(upper, column_two, column_one)] = True
    return free
