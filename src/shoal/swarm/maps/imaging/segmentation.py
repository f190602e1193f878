"""Vessel segmentation of a photograph, with a confidence that the picture shows vessels."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, MissingExtraError
from shoal.swarm.maps.generators.components import Mask
from shoal.swarm.maps.imaging.filters import FLATTENING, THICKEST_VESSEL, strongest_line, vessel_response, without_ground
from shoal.swarm.maps.imaging.photographs import Grey, Photograph, read_photograph, resized

LOW, HIGH = 0.6, 1.2  # thresholds, as multiples of the threshold that best splits the responses
SHARES = {True: (0.09, 0.16), False: (0.02, 0.4)}
"""Minimum and maximum fraction of pixels above the threshold, with and without a field of view.

In photographs with one, experts mark 12 % on average.
"""
THICKEST = {True: 0.0185, False: 0.035}
"""Width of the thickest vessel relative to the larger side, with a field of view and without."""
CLEARLY_BRIGHTER = 3.0  # if bright lines are this much stronger than dark lines, dark lines are not tried
SMALLEST_PART = 40  # pixels
LEAST_CONFIDENCE, SURE = 0.25, 0.45
NOISE, CLEAR = 1.04, 1.44  # strength of lines relative to noise of the same spectrum
EDGE = 0.2  # minimum step at a vessel's edge, as a fraction of the vessel's depth
FAINT = 3.0  # contrast of a network to its background, in standard deviations of the background, that noise does not reach
EDGES, LINES = 0.5, 0.9  # fraction of the network that differs from both of its sides
SPECKS, TREES = 0.2, 0.65  # mean extent of a connected part relative to the larger side of the network
WOVEN = 0.2  # alignment of all lines with one direction, from 0 to 1; above this limit the confidence is reduced
STRAIGHT = 60  # length in pixels over which a line keeps its direction: short networks are aligned by chance


@dataclass(frozen=True)
class Vessels:
    """The vessels found in a photograph.

    Parameters
    ----------
    mask : ndarray of bool, shape (H, W)
        True at vessel pixels, at the photograph's own resolution.
    confidence : float
        Confidence from 0 (noise, or edges of other objects) to 1 (vessels).
    bright : bool
        Whether vessels are brighter than their surroundings.
    """

    mask: Mask
    confidence: float
    bright: bool

    @property
    def warning(self) -> str | None:
        """A warning that the picture may show no vessels. The value is None if the confidence is high."""
        if self.confidence >= SURE:
            return None
        return f"the picture may show no vessels: confidence {self.confidence:.2f} of 1 (compare the overlay)"


def find_vessels(
    image: ArrayLike, *, low: float = LOW, high: float = HIGH, bright: bool | None = None, thickest: float | None = None
) -> Vessels:
    """Return the vessel pixels of a picture.

    Parameters
    ----------
    image : array_like, shape (H, W), (H, W, 3) or (H, W, 4)
        Greyscale or colour picture with any range of values. A fourth channel (opacity) is ignored.
    low, high : float
        Thresholds of the filter response, as multiples of Otsu's threshold between vessels and background. A vessel continues while
        its response is above ``low``, and counts if its response exceeds ``high`` somewhere. Lower values give more and finer
        vessels.
    bright : bool, optional
        Whether vessels are brighter than their surroundings. By default, the clearer lines (bright or dark) are taken as vessels.
    thickest : float, optional
        Width of the thickest vessel as a fraction of the picture's larger side. The default is 0.0185 for a photograph with a
        surround, such as a photograph of an eye, and 0.035 otherwise.

    Raises
    ------
    InvalidInputError
        If the array is not a picture, an option is out of range, or no vessels are found.
    MissingExtraError
        If scikit-image is not installed.

    Notes
    -----
    The response is the sum of two standardized filters. The first is the multi-scale line detector (U. T. V. Nguyen et al., Pattern
    Recognition 46, 2013). The second, with half the weight, consists of elongated second derivatives of Gaussians, similar to Gabor
    filters (J. V. B. Soares et al., IEEE Transactions on Medical Imaging 25, 2006). `python -m benchmarks.vessels_from_photographs`
    measures the accuracy on synthetic photographs of eyes.
    """
    return VesselFinder(image, bright=bright, thickest=thickest).find(low=low, high=high)


class VesselFinder:
    """A photograph with its filter responses.

    The filters run once, and then the finder can find vessels for many pairs of thresholds.

    Parameters
    ----------
    image, bright, thickest
        Options of `find_vessels`.
    """

    def __init__(self, image: ArrayLike, *, bright: bool | None = None, thickest: float | None = None) -> None:
        if thickest is not None:
            check_number(thickest, what="thickest", above=0, most=0.5)
        self.picture, self.shape, self.bright = read_photograph(image), np.shape(image)[:2], bright
        levels = _levels(self.picture, THICKEST[self.picture.has_surround] if thickest is None else thickest)
        self.tried = (levels,) if thickest is not None else (levels, levels + 1)
        self._filtered: dict[tuple[int, bool], _Filtered] = {}
        self._clearest: _Filtered | None = None

    def find(self, *, low: float = LOW, high: float = HIGH) -> Vessels:
        """Return the vessels; see `find_vessels`."""
        _check_thresholds(low, high)
        first = 0.0
        for levels in self.tried:
            confidence, way, clearest = self._clearest_at(levels, low, high)
            # Vessels wider than usual must have a clear response.
            if confidence >= (LEAST_CONFIDENCE if levels == self.tried[0] else SURE):
                self._clearest = clearest
                return Vessels(clearest.mask(low, high, self.shape), confidence, way)
            first = confidence if levels == self.tried[0] else first
        raise InvalidInputError(
            "expected a picture with vessels, got no network of lines that stands out "
            f"(confidence {first:.2f}, at least {LEAST_CONFIDENCE} is needed)"
        )

    def mask(self, *, low: float, high: float, shape: tuple[int, int]) -> Mask:
        """Return the mask of vessels for other thresholds, resized to ``shape``.

        The method is fast, because it reuses the filter responses of the last `find` and computes no confidence.
        """
        _check_thresholds(low, high)
        if self._clearest is None:
            self.find(low=low, high=high)
        assert self._clearest is not None
        return self._clearest.mask(low, high, shape)

    def _clearest_at(self, levels: int, low: float, high: float) -> tuple[float, bool, _Filtered]:
        """Return the result for bright or for dark lines, whichever has the higher confidence.

        The filters run at ``levels`` sizes of the picture.
        """
        view = self.picture.view
        flat = without_ground(self.picture.grey, view, FLATTENING * 2 ** (levels - 1))
        if self.bright is not None:
            ways = [self.bright]
        else:
            ratio = _strength(flat, view) / (_strength(-flat, view) + 1e-12)
            ways = [ratio > 1] if ratio > CLEARLY_BRIGHTER or ratio <= 1 else [False, True]  # an optic disc is also bright
        for way in ways:
            if (levels, way) not in self._filtered:
                self._filtered[levels, way] = _filter(flat if way else -flat, self.picture, levels)
        found = [(bool(way), self._filtered[levels, way]) for way in ways]
        return max(
            ((_confidence(one.flat, view, one.network(low, high)), way, one) for way, one in found), key=lambda entry: entry[0]
        )


@dataclass(frozen=True)
class _Filtered:
    """A picture with a flat background, without structures of opposite brightness; with its response and threshold."""

    flat: Grey
    response: Grey
    split: float
    levels: int

    def network(self, low: float, high: float) -> Mask:
        passed = imaging_module("filters").apply_hysteresis_threshold(self.response, low * self.split, high * self.split)
        return _without_small(passed, SMALLEST_PART * self.levels)

    def mask(self, low: float, high: float, shape: tuple[int, ...]) -> Mask:
        return _in_own_pixels(self.network(low, high), self.response, low * self.split, shape)


def photograph_response(image: ArrayLike) -> Grey:
    """Return the vessel response of each pixel of a photograph with dark vessels, such as a photograph of an eye; shape (H, W)."""
    picture = read_photograph(image)
    levels = _levels(picture, THICKEST[picture.has_surround])
    flat = without_ground(picture.grey, picture.view, FLATTENING * 2 ** (levels - 1))
    return resized(vessel_response(_without_opposite(-flat, picture.view), picture.view, levels), np.shape(image)[:2])


def _filter(flat: Grey, picture: Photograph, levels: int) -> _Filtered:
    """Return the filter response of a flat picture over ``levels`` sizes, and the threshold that divides it best."""
    from scipy.ndimage import gaussian_filter, grey_dilation

    filters, view = imaging_module("filters"), picture.view
    flat = _without_opposite(flat, view)
    response = vessel_response(flat, view, levels)
    shares = SHARES[picture.has_surround]
    least, most = np.quantile(response[view], [1 - share for share in shares])[::-1]
    split = float(np.clip(filters.threshold_otsu(response[view]), least, most))
    response = np.where(picture.within, response, response.min())
    smooth = gaussian_filter(flat, 0.7)
    response[smooth <= EDGE * grey_dilation(smooth, THICKEST_VESSEL * 2 ** (levels - 1))] = response.min()
    return _Filtered(flat, response, split, levels)


def _without_opposite(flat: Grey, view: Mask) -> Grey:
    """Return a flat picture with its low values clipped.

    With the low values, the filters would respond beside structures of opposite brightness.
    """
    return np.maximum(flat, -3 * 1.4826 * float(np.median(np.abs(flat[view]))))


def _check_thresholds(low: float, high: float) -> None:
    if not 0 < low <= high <= 10:
        raise InvalidInputError(f"expected thresholds with 0 < low <= high <= 10, got low={low} and high={high}")


def imaging_module(module: str) -> Any:
    """Import a module of scikit-image, which has no type annotations and is slow to import."""
    try:
        return importlib.import_module(f"skimage.{module}")
    except ImportError:
        raise MissingExtraError("finding vessels in a picture needs scikit-image: pip install 'shoal[imaging]'") from None


def _levels(picture: Photograph, thickest: float) -> int:
    """Return the number of picture sizes at which the filters must run to detect the thickest vessel."""
    width = thickest * max(picture.grey.shape) / THICKEST_VESSEL
    return 1 + max(0, int(np.ceil(np.log2(width) - 0.2)))


def _strength(flat: Grey, view: Mask, share: float = 0.05) -> float:
    """Return the strength of bright lines: the mean of the strongest responses, of which a given fraction is taken."""
    lines: NDArray[np.float64] = strongest_line(flat)[view]
    kept = max(1, int(share * lines.size))
    return float(np.partition(lines, -kept)[-kept:].mean())


def _without_small(found: Mask, least: float) -> Mask:
    """Remove parts with fewer than ``least`` pixels. If all parts are smaller, keep the largest ones."""
    from scipy import ndimage

    parts, _ = ndimage.label(found, np.ones((3, 3)))
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    return np.asarray(sizes[parts] >= max(1, min(least, int(sizes.max()))))


def _confidence(flat: Grey, view: Mask, network: Mask) -> float:
    """Return the confidence that a network consists of vessels.

    The confidence combines four criteria. First, vessels give stronger lines than noise of the same spectrum. Second, a vessel
    differs in brightness from both of its sides, but an edge differs from only one side. Third, vessels are connected over long
    distances, but letters and stars are not. Fourth, vessels have all directions, but the joints of a wall do not.
    """
    spectrum = np.fft.rfft2(flat)
    phase = np.angle(np.fft.rfft2(np.random.default_rng(0).standard_normal(flat.shape)))
    noise = np.fft.irfft2(np.abs(spectrum) * np.exp(1j * phase), flat.shape)
    ratio = _strength(flat, view, 0.02) / (_strength(noise, view, 0.02) + 1e-12)
    ground = flat[view & ~network]
    contrast = (flat[network].mean() - ground.mean()) / (ground.std() + 1e-12) if network.any() and ground.size else 0.0
    stands_out = max((ratio - NOISE) / (CLEAR - NOISE), (contrast - FAINT) / FAINT)
    middle: Mask = imaging_module("morphology").skeletonize(network)
    if not middle.any():
        return 0.0
    two_sided, woven = _shape_of_lines(flat, network, middle)
    lines, connected = (two_sided - EDGES) / (LINES - EDGES), (_mean_extent(network, middle) - SPECKS) / (TREES - SPECKS)
    by_chance = np.sqrt(STRAIGHT / np.count_nonzero(middle))
    most = 1.0 if woven < WOVEN + by_chance else (LEAST_CONFIDENCE + SURE) / 2
    return float(np.clip(min(stands_out, lines, connected), 0, most))


def _mean_extent(network: Mask, middle: Mask) -> float:
    """Return the mean diagonal of the network's connected parts relative to the larger side, averaged over the centre lines."""
    from scipy import ndimage

    parts, _ = ndimage.label(network, np.ones((3, 3)))
    sides = [[one.stop - one.start for one in part] for part in ndimage.find_objects(parts)]
    return float(np.hypot(*np.array(sides).T)[parts[middle] - 1].mean() / max(network.shape))


def _shape_of_lines(flat: Grey, network: Mask, middle: Mask) -> tuple[float, float]:
    """Return two measures of the network's centre lines, each from 0 to 1.

    The first is the fraction of centre lines whose contrast on one side is at least half the contrast on the other. The second is
    the alignment of all centre lines with one direction or its perpendicular.
    """
    from scipy import ndimage

    smooth = ndimage.gaussian_filter(network.astype(np.float64), 1)
    rows, across, columns = (part[middle] for part in imaging_module("feature").structure_tensor(smooth, sigma=3, order="rc"))
    angle = np.arctan2(2 * across, rows - columns) / 2  # across the vessel
    reach = (ndimage.distance_transform_edt(network)[middle] + 2.5) * np.array([np.cos(angle), np.sin(angle)])
    flat = ndimage.gaussian_filter(flat, 1)
    sides = [ndimage.map_coordinates(flat, np.nonzero(middle) + way * reach, order=1, mode="nearest") for way in (1, -1)]
    more, less = flat[middle] - np.minimum(*sides), flat[middle] - np.maximum(*sides)
    return float(np.mean(less > more / 2)), float(np.abs(np.exp(4j * angle).mean()))


def _in_own_pixels(network: Mask, response: Grey, low: float, shape: tuple[int, ...]) -> Mask:
    """Return a network at the photograph's resolution. Its edges lie where the response crosses the threshold."""
    if network.shape == shape:
        return network
    from scipy import ndimage

    near = ndimage.binary_dilation(network, np.ones((3, 3)))
    found = resized(np.where(near, response, np.minimum(response, low)), shape) > low
    return _without_small(found, SMALLEST_PART * found.size / network.size)
