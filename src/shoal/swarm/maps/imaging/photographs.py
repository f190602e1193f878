"""Photographs as numeric arrays: one grey channel and the field of view, scaled to the size that the vessel filters expect."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import one_line
from shoal.core.errors import InvalidInputError
from shoal.swarm.maps.generators.components import Mask

Grey = NDArray[np.float64]

SMALLEST_SIDE = 16
SIDE = 565  # larger side in pixels of the picture that is filtered; the published field of view has 540 pixels
FIELD = 540
# A photograph is not resized if the logarithm of the scale is smaller than this, because resizing blurs. A larger limit would
# leave photographs of 620 to 720 pixels as they are, whose widest vessels the filters for one size of picture tear.
CLOSE = 0.1
LUMA = (0.2125, 0.7154, 0.0721)
SURROUND = 0.08  # a surround differs from black or white by at most this fraction of the brightness range
# RIM: width in pixels of the border of the field of view that a mirror image replaces. MIRRORED: width of the inner part of this
# border, in which vessels are searched.
RIM, MIRRORED = 6, 2


class Photograph(NamedTuple):
    """A photograph, scaled to the size that the vessel filters expect."""

    grey: Grey
    view: Mask
    """Mask of the pixels inside the field of view, without the border of the field of view."""

    within: Mask
    """Mask of the pixels in which the vessel finder searches for vessels."""

    def __repr__(self) -> str:
        return one_line(self)

    @property
    def has_surround(self) -> bool:
        """Whether the photograph has a surround: pixels outside the field of view."""
        return not self.view.all()


def read_photograph(image: ArrayLike) -> Photograph:
    """Return the field of view of a picture, and one grey channel with values from 0 to 1.

    The grey channel of a colour picture is its green channel, because green shows blood with the best contrast. If the green
    channel has little contrast, the grey channel is the brightness of the picture.

    Raises
    ------
    InvalidInputError
        Raised if the array is not a picture, or if all pixels have a single colour.
    """
    array = np.asarray(image)
    if array.ndim not in (2, 3) or (array.ndim == 3 and array.shape[2] not in (3, 4)):
        raise InvalidInputError(f"expected a picture of shape (H, W), (H, W, 3) or (H, W, 4), got shape {array.shape}")
    if min(array.shape[:2]) < SMALLEST_SIDE:
        raise InvalidInputError(f"expected a picture of at least {SMALLEST_SIDE}x{SMALLEST_SIDE} pixels, got shape {array.shape}")
    if array.dtype.kind not in "buif":
        raise InvalidInputError(f"expected a picture of real numbers, got an array of {array.dtype}")
    if not np.isfinite(array).all():
        raise InvalidInputError("expected a picture of finite numbers, got NaN or infinity in it")
    channels = np.atleast_3d(array)[..., :3]
    if channels.dtype == np.bool_:
        channels = channels.astype(np.uint8)
    light = _from_0_to_1(channels.max(axis=2))
    green = channels[..., channels.shape[2] // 2]
    if np.ptp(green) < 0.1 * np.ptp(channels) and channels.shape[2] == 3:
        green = channels @ np.array(LUMA)
    grey = _from_0_to_1(green)
    if not grey.any():
        raise InvalidInputError("expected a picture with vessels, got a picture of a single colour")
    return _at_size_of_filters(grey, _field_of_view(light))


def resized(picture: NDArray[np.generic], shape: tuple[int, ...]) -> Grey:
    """Return a picture scaled to another size. Smooth the picture before reducing its size."""
    from PIL import Image

    floats = Image.fromarray(np.asarray(picture, dtype=np.float32))
    return np.asarray(floats.resize((shape[1], shape[0]), Image.Resampling.BILINEAR), dtype=np.float64)


def _from_0_to_1(values: NDArray[Any]) -> NDArray[np.float32]:
    """Scale pixel values to the range from 0 to 1. If all values are almost equal, return zeros."""
    darkest, brightest = float(values.min()), float(values.max())
    if not brightest - darkest > 1e-9 * max(abs(brightest), abs(darkest)):
        return np.zeros(values.shape, dtype=np.float32)
    return np.asarray((values - darkest) / (brightest - darkest), dtype=np.float32)


def _scaled(shape: tuple[int, ...], factor: float) -> tuple[int, ...]:
    return tuple(max(SMALLEST_SIDE, round(side * factor)) for side in shape)


def _field_of_view(light: NDArray[np.float32]) -> Mask:
    """Return the mask of the pixels outside a black or white surround. The larger side of the mask is at most `SIDE` pixels."""
    from scipy import ndimage

    small = resized(light, _scaled(light.shape, min(1.0, SIDE / max(light.shape))))
    rim = max(1, max(small.shape) // 60)
    for plain in (small < SURROUND, small > 1 - SURROUND):
        parts = ndimage.label(np.pad(plain, 1, constant_values=True))[0]
        surround = parts == parts[0, 0]
        view = ndimage.binary_opening(ndimage.binary_fill_holes(~surround), iterations=rim)[1:-1, 1:-1]
        # A drawing of vessels on an empty background has no solid interior. Then the whole picture is the field of view.
        if surround[1:-1, 1:-1].mean() > 0.05 and view.mean() > 0.35 and plain[view].mean() < 0.25:
            return np.asarray(view)
    return np.ones(small.shape, dtype=np.bool_)


def _at_size_of_filters(grey: NDArray[np.float32], view: Mask) -> Photograph:
    from scipy import ndimage

    if view.all():
        small = resized(grey, _scaled(grey.shape, min(1.0, SIDE / max(grey.shape))))
        view = np.ones(small.shape, dtype=np.bool_)
        return Photograph(small, view, view)
    extent = max(int(np.ptp(np.flatnonzero(view.any(axis=axis)))) + 1 for axis in (0, 1))
    factor = FIELD / (extent * max(grey.shape) / max(view.shape))
    if abs(np.log(factor)) < CLOSE:
        factor = 1.0
    small = resized(grey, _scaled(grey.shape, factor))
    inside = np.pad(resized(view, small.shape) > 0.5, 1)
    depth = ndimage.distance_transform_edt(inside)[1:-1, 1:-1]
    return Photograph(small, depth > RIM, depth > RIM - MIRRORED)
