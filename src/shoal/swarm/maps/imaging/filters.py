"""Filters that answer to vessels: a flat ground, line detectors of many lengths, B-COSFIRE.

The published parameters are for photographs of an eye whose field of view is 540 pixels wide and whose vessels are up to ten pixels
wide. For thicker vessels the filters also run on the picture in half its size, and so on.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce

import numpy as np
import scipy
from numpy.typing import NDArray

from shoal.swarm.maps.generators.components import Mask

Grey = NDArray[np.float64]

ANGLES = 12  # of lines, over half a turn
LINE_WINDOW = 15  # pixels (Nguyen et al. 2013), as are the lengths of the lines: 1, 3, ... 15
THICKEST_VESSEL = 10  # pixels, of the published filters
FLATTENING = 19  # pixels, deviation of the Gaussian that is the ground
BAR = (2.4, (0, 2, 4, 6, 8), 3.0, 0.7)  # B-COSFIRE (Azzopardi et al. 2015): deviation, radii, tolerance and its growth
BAR_END = (1.8, tuple(range(0, 23, 2)), 2.0, 0.1)  # the same of the filter that answers to the ends of vessels


def vessel_response(flat: Grey, view: Mask, levels: int, deviation: float) -> Grey:
    """Return how much each pixel looks like a part of a vessel: about 0 on the ground.

    Parameters
    ----------
    flat : ndarray of float64, shape (H, W)
        A flattened picture, high in vessels.
    view : ndarray of bool, shape (H, W)
        Where to look.
    levels : int
        1 for vessels up to 10 pixels wide, and one more for each doubling of that.
    deviation : float
        Pixels over which contrast is evened.
    """
    power = scipy.ndimage.gaussian_filter(flat**2, 2 * deviation)
    flat = flat / (np.sqrt(power + 0.3 * power.mean()) + 1e-12)
    answers = []
    for level in range(levels):
        step = 2**level
        small = scipy.ndimage.uniform_filter(flat, step)[::step, ::step]
        inside = view[::step, ::step]
        answer = (standardised(_line_strength(small, inside), inside) + standardised(_bar_strength(small), inside)) / 2
        if level:
            answer = _enlarged(answer, view.shape, step)
        answers.append(answer)
    return reduce(np.maximum, answers)


def without_ground(grey: Grey, view: Mask, deviation: float) -> Grey:
    """Return a picture less its ground, a wide median; what is outside the field of view mirrors what is inside."""
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
    """Return values with mean 0 and deviation 1 over the field of view."""
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
    """Return the multi-scale line detector: the brightest line through each pixel against the window around it."""
    total = standardised(grey, view)
    around = scipy.ndimage.uniform_filter(grey, LINE_WINDOW)
    lengths = range(1, LINE_WINDOW + 1, 2)
    for length in lengths:
        total = total + standardised(strongest_line(grey, length) - around, view)
    return total / (len(lengths) + 1)


def strongest_line(grey: Grey, length: int = LINE_WINDOW) -> Grey:
    """Return the highest mean along a line through each pixel, of any angle."""
    angles = np.pi * np.arange(ANGLES if length > 1 else 1) / ANGLES
    return _highest(scipy.ndimage.convolve(grey, _line(length, angle)) for angle in angles)


def _line(length: int, angle: float) -> Grey:
    """Return the weights of a line's pixels, spread over the pixels that it passes between."""
    weights = np.zeros((length + 2, length + 2))
    for step in np.arange(length) - (length - 1) / 2:
        row, column = (length + 1) / 2 + step * np.sin(angle), (length + 1) / 2 + step * np.cos(angle)
        top, left = int(row), int(column)
        down, right = row - top, column - left
        weights[top : top + 2, left : left + 2] += np.outer([1 - down, down], [1 - right, right])
    return weights / length


def _bar_strength(grey: Grey) -> Grey:
    """Return B-COSFIRE: the geometric mean of what a row of small receptive fields sees along a vessel, of bars and of bar ends."""
    whole, end = (
        _highest(_along(grey, *parameters, turns=turns, both=both))
        for parameters, turns, both in ((BAR, 0.5, True), (BAR_END, 1.0, False))
    )
    return whole + end


def _along(
    grey: Grey, deviation: float, radii: tuple[int, ...], tolerance: float, growth: float, *, turns: float, both: bool
) -> Iterable[Grey]:
    """Yield the answer of one B-COSFIRE filter at each of its angles."""
    reach = radii[-1] + 1
    padded = np.pad(grey, reach, mode="symmetric")
    fields = np.maximum(scipy.ndimage.gaussian_filter(padded, deviation / 2) - scipy.ndimage.gaussian_filter(padded, deviation), 0)
    seen = [np.log(scipy.ndimage.gaussian_filter(fields, (tolerance + growth * radius) / 3) + 1e-6) for radius in radii]
    weights = np.exp(-4.5 * (np.array(radii) / radii[-1]) ** 2)
    rows, columns = grey.shape
    for angle in 2 * np.pi * turns * np.arange(count := round(2 * turns * ANGLES)) / count:
        total, weighed = np.zeros(grey.shape), 0.0
        for radius, field, weight in zip(radii, seen, weights, strict=True):
            for way in (1, -1) if both and radius else (1,):
                row, column = (reach + round(way * radius * turn) for turn in (np.sin(angle), np.cos(angle)))
                total += weight * field[row : row + rows, column : column + columns]
                weighed += weight
        yield np.exp(total / weighed)


def _highest(pictures: Iterable[Grey]) -> Grey:
    """Return the highest value at each pixel."""
    return reduce(np.maximum, pictures)
