"""Image filters that find vessels: background subtraction, line detectors of several lengths, and ridge filters of several widths.

The constants of the filters suit eye photographs with a field of view 540 pixels wide and vessels up to ten pixels wide. To find
vessels more than ten pixels wide, the filters also run on pictures reduced to 1/2, 1/4, 1/8, ... of the size.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce

import numpy as np
import scipy
from numpy.typing import NDArray

from shoal.swarm.maps.generators.components import Mask

Grey = NDArray[np.float64]

ANGLES = 12  # number of line angles over half a turn
LINE_WINDOW = 15  # window width in pixels (Nguyen et al. 2013); the line lengths are 1, 3, ... 15 pixels
THICKEST_VESSEL = 10  # pixels, from the published filters
FLATTENING = 19  # pixels, standard deviation of the Gaussian for the background
RIDGES = tuple((width, 3 * width + 4) for width in (1.2, 1.7, 2.4, 3.4))  # standard deviations across and along a vessel, in pixels
RIDGE_WEIGHT = 0.5  # weight of the ridge filters relative to the line detector


def vessel_response(flat: Grey, view: Mask, levels: int) -> Grey:
    """Return the vessel response of each pixel: how much the pixel looks like part of a vessel.

    Background pixels have a response of about 0.

    Parameters
    ----------
    flat : ndarray of float64, shape (H, W)
        A picture with a flat background, in which vessels are brighter than the background.
    view : ndarray of bool, shape (H, W)
        Mask of the pixels for which the response is computed.
    levels : int
        Number of picture sizes: 1 for vessels up to 10 pixels wide, and one more for each doubling of the vessel width.
    """
    answers = []
    for level in range(levels):
        step = 2**level
        small = scipy.ndimage.uniform_filter(flat, step)[::step, ::step]
        inside = view[::step, ::step]
        lines, ridges = standardised(_line_strength(small, inside), inside), standardised(_ridge_strength(small), inside)
        answer = standardised(lines + RIDGE_WEIGHT * ridges, inside)
        if level:
            answer = _enlarged(answer, view.shape, step)
        answers.append(answer)
    return _highest(answers)


def without_ground(grey: Grey, view: Mask, deviation: float) -> Grey:
    """Return a picture without its background, which is the median over a wide window around each pixel.

    The window is three times ``deviation`` pixels wide. Before the function computes the median, mirror images of pixels inside the
    field of view replace the pixels outside the field of view.
    """
    reach = int(3 * deviation)
    grey = np.pad(_mirrored(grey, view), reach, mode="symmetric")
    step = max(1, int(deviation / 5))
    coarse = scipy.ndimage.median_filter(scipy.ndimage.uniform_filter(grey, step)[::step, ::step], int(3 * deviation / step))
    ground = _enlarged(coarse, grey.shape, step)
    return np.asarray((grey - scipy.ndimage.gaussian_filter(ground, deviation / 4))[reach:-reach, reach:-reach])


def _enlarged(coarse: Grey, shape: tuple[int, ...], step: int) -> Grey:
    places = (np.minimum(np.arange(n) / step, m - 1) for n, m in zip(shape, coarse.shape, strict=True))
    return np.asarray(scipy.ndimage.map_coordinates(coarse, np.meshgrid(*places, indexing="ij"), order=1))


def standardised(values: Grey, view: Mask) -> Grey:
    """Scale the pixel values to mean 0 and standard deviation 1 over the field of view."""
    inside = values[view]
    return np.asarray((values - inside.mean()) / (inside.std() + 1e-12))


def _mirrored(grey: Grey, view: Mask) -> Grey:
    if view.all():
        return grey
    nearest = scipy.ndimage.distance_transform_edt(~view, return_distances=False, return_indices=True)
    across = tuple(
        np.clip(2 * near - here, 0, side - 1) for near, here, side in zip(nearest, np.indices(grey.shape), grey.shape, strict=True)
    )
    return np.asarray(np.where(view[across], grey[across], grey[tuple(nearest)]))


def _line_strength(grey: Grey, view: Mask) -> Grey:
    """Return the response of a line detector: the mean of the brightest line through a pixel, minus the mean around the pixel.

    The response is averaged over lines of several lengths.
    """
    total = standardised(grey, view)
    around = scipy.ndimage.uniform_filter(grey, LINE_WINDOW)
    lengths = range(1, LINE_WINDOW + 1, 2)
    for length in lengths:
        total = total + standardised(strongest_line(grey, length) - around, view)
    return total / (len(lengths) + 1)


def strongest_line(grey: Grey, length: int = LINE_WINDOW) -> Grey:
    """Return, for each pixel, the highest mean value along a line through the pixel.

    The function tries lines at `ANGLES` different angles.
    """
    angles = np.pi * np.arange(ANGLES if length > 1 else 1) / ANGLES
    return _highest(scipy.ndimage.convolve(grey, _line(length, angle)) for angle in angles)


def _line(length: int, angle: float) -> Grey:
    """Return the pixel weights of a straight line. A point between pixels adds weight to all neighbouring pixels."""
    weights = np.zeros((length + 2, length + 2))
    for step in np.arange(length) - (length - 1) / 2:
        row, column = (length + 1) / 2 + step * np.sin(angle), (length + 1) / 2 + step * np.cos(angle)
        top, left = int(row), int(column)
        down, right = row - top, column - left
        weights[top : top + 2, left : left + 2] += np.outer([1 - down, down], [1 - right, right])
    return weights / length


def _ridge_strength(grey: Grey) -> Grey:
    """Return, for each pixel, the maximum response of ridge filters of all widths and angles.

    Each ridge filter is the second derivative of a Gaussian. The Gaussian is stretched along a vessel, and the derivative is taken
    across the vessel. Each ridge filter is scaled to energy 1, so that all ridge filters respond equally to noise.
    """
    reach = int(2.5 * max(length for _, length in RIDGES))
    padded = np.pad(grey, reach, mode="symmetric")
    shape = tuple(scipy.fft.next_fast_len(side, real=True) for side in padded.shape)
    spectrum = scipy.fft.rfft2(padded, shape)
    down, right = scipy.fft.fftfreq(shape[0])[:, None], scipy.fft.rfftfreq(shape[1])

    def answers() -> Iterable[Grey]:
        for width, length in RIDGES:
            for angle in np.pi * np.arange(ANGLES) / ANGLES:
                along, across = right * np.cos(angle) + down * np.sin(angle), down * np.cos(angle) - right * np.sin(angle)
                weights = across**2 * np.exp(-2 * np.pi**2 * (width**2 * across**2 + length**2 * along**2))
                yield scipy.fft.irfft2(spectrum * weights / np.sqrt((weights**2).sum()), shape)

    return _highest(answers())[reach:][: grey.shape[0], reach : reach + grey.shape[1]]


def _highest(pictures: Iterable[Grey]) -> Grey:
    """Return the maximum of several pictures at each pixel."""
    return reduce(np.maximum, pictures)
