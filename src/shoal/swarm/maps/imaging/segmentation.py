"""Vessel segmentation: find the vessels in a photograph, and compute a confidence that the photograph shows vessels."""

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
"""Minimum and maximum fraction of pixels above the threshold: for photographs with a surround (True) and without one (False).

In photographs with a surround, experts mark on average 12 % of the pixels as vessels.
"""
THICKEST = {True: 0.0185, False: 0.035}
"""Width of the thickest vessel as a fraction of the photograph's larger side: with a surround (True) and without one (False)."""
CLEARLY_BRIGHTER = 3.0  # if bright lines are this much stronger than dark lines, dark lines are not tried
SMALLEST_PART = 40  # pixels
LEAST_CONFIDENCE, SURE = 0.25, 0.45
NOISE, CLEAR = 1.04, 1.44  # strength of lines relative to noise of the same spectrum, for confidence 0 and for confidence 1
EDGE = 0.2  # minimum step at a vessel's edge, as a fraction of the vessel's depth
FAINT = 3.0  # contrast of a network to its background, in standard deviations of the background, that noise does not reach
EDGES, LINES = 0.5, 0.9  # fraction of the network that differs from both of its sides, for confidence 0 and for confidence 1
SPECKS, TREES = 0.2, 0.65  # mean extent of a connected part relative to the picture's larger side, for confidence 0 and 1
WOVEN = 0.2  # alignment of all lines with one direction, from 0 to 1; above this limit the confidence is reduced
STRAIGHT = 60  # length in pixels over which a line keeps its direction: short networks are aligned by chance


@dataclass(frozen=True)
class Vessels:
    """The vessels found in a photograph.

    Parameters
    ----------
    mask : ndarray of bool, shape (H, W)
        True at vessel pixels. The mask of vessel pixels has the resolution of the photograph.
    confidence : float
        Confidence that the photograph shows vessels: from 0 (noise, or edges of other objects) to 1 (vessels).
    bright : bool
        Whether vessels are brighter than the surrounding pixels.
    """

    mask: Mask
    confidence: float
    bright: bool

    @property
    def warning(self) -> str | None:
        """A warning that the photograph may show no vessels, or None if the confidence is high."""
        if self.confidence >= SURE:
            return None
        return f"the picture may show no vessels: confidence {self.confidence:.2f} of 1 (compare the overlay)"


def find_vessels(
    image: ArrayLike, *, low: float = LOW, high: float = HIGH, bright: bool | None = None, thickest: float | None = None
) -> Vessels:
    """Find the vessels in a picture, and return the mask of vessel pixels with a confidence.

    Parameters
    ----------
    image : array_like, shape (H, W), (H, W, 3) or (H, W, 4)
        Greyscale or colour picture with any range of values. The function ignores a fourth channel (opacity).
    low, high : float
        Thresholds of the filter response, as multiples of Otsu's threshold between vessels and background. A vessel consists of
        connected pixels with a response above ``low``. At least one of these pixels has a response above ``high``. Lower thresholds
        give more and finer vessels.
    bright : bool, optional
        Whether vessels are brighter than the surrounding pixels. By default, the clearer lines count as vessels: the bright lines
        or the dark lines.
    thickest : float, optional
        Width of the thickest vessel as a fraction of the picture's larger side. The default is 0.0185 for a photograph with a
        surround, such as a photograph of an eye, and 0.035 for a photograph without a surround.

    Raises
    ------
    InvalidInputError
        Raised if the array is not a picture, if an option is out of range, or if the picture shows no vessels.
    MissingExtraError
        Raised if scikit-image is not installed.

    Notes
    -----
    The filter response of a pixel is the sum of two standardized responses. The first response comes from the multi-scale line
    detector by Nguyen and others (Pattern Recognition 46, 2013). The second response comes from elongated second derivatives of
    Gaussians. The second derivatives are similar to the Gabor filters by Soares and others (IEEE Transactions on Medical Imaging
    25, 2006). The second response has half the weight of the first response. The command `python -m
    benchmarks.vessels_from_photographs` measures the accuracy of the vessel finder on synthetic photographs of eyes.
    """
    return VesselFinder(image, bright=bright, thickest=thickest).find(low=low, high=high)


class VesselFinder:
    """A photograph with its filter responses. The method `find` finds the vessels in the photograph for any thresholds.

    The vessel finder stores the filter responses, so that finding the vessels for further thresholds is fast.

    Parameters
    ----------
    image, bright, thickest
        Arguments ``image``, ``bright`` and ``thickest`` of the function `find_vessels`.
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
        """Return the vessels in the photograph for two thresholds. The function `find_vessels` explains the thresholds."""
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
        """Return the mask of the photograph's vessels for the thresholds ``low`` and ``high``, resized to ``shape``.

        The method is fast, because it reuses the filter responses of the last call of `find` and computes no confidence.
        """
        _check_thresholds(low, high)
        if self._clearest is None:
            self.find(low=low, high=high)
        assert self._clearest is not None
        return self._clearest.mask(low, high, shape)

    def _clearest_at(self, levels: int, low: float, high: float) -> tuple[float, bool, _Filtered]:
        """Find bright lines and dark lines, and return the result with the higher confidence.

        The vessel filters run on ``levels`` sizes of the picture.
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
    """A picture with a flat background, the filter response of each pixel, and the threshold between vessels and background."""

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
    """Return the vessel response, shape (H, W), of each pixel of a photograph with dark vessels, such as a photograph of an eye."""
    picture = read_photograph(image)
    levels = _levels(picture, THICKEST[picture.has_surround])
    flat = without_ground(picture.grey, picture.view, FLATTENING * 2 ** (levels - 1))
    return resized(vessel_response(_without_opposite(-flat, picture.view), picture.view, levels), np.shape(image)[:2])


def _filter(flat: Grey, picture: Photograph, levels: int) -> _Filtered:
    """Return the filter response of a picture on ``levels`` picture sizes, and the threshold between vessels and background."""
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
    """Clip the low values of a picture with a flat background.

    Without clipping, the vessel filters would respond to pixels beside very dark structures.
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
    """Return the number of picture sizes on which the vessel filters must run to detect the thickest vessel."""
    width = thickest * max(picture.grey.shape) / THICKEST_VESSEL
    return 1 + max(0, int(np.ceil(np.log2(width) - 0.2)))


def _strength(flat: Grey, view: Mask, share: float = 0.05) -> float:
    """Return the strength of bright lines: the mean of the highest responses.

    The mean includes the fraction ``share`` of all pixels.
    """
    lines: NDArray[np.float64] = strongest_line(flat)[view]
    kept = max(1, int(share * lines.size))
    return float(np.partition(lines, -kept)[-kept:].mean())


def _without_small(found: Mask, least: float) -> Mask:
    """Remove connected parts with fewer than ``least`` pixels. If all parts are smaller, keep the largest parts."""
    from scipy import ndimage

    parts, _ = ndimage.label(found, np.ones((3, 3)))
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    return np.asarray(sizes[parts] >= max(1, min(least, int(sizes.max()))))


def _confidence(flat: Grey, view: Mask, network: Mask) -> float:
    """Return the confidence, from 0 to 1, that a network of lines consists of vessels.

    The confidence combines four criteria. Vessels give stronger lines than random noise that has the spectrum of the picture. A
    vessel differs in brightness from the background on both sides, but the edge of an object differs on one side only. Vessels
    are connected over long distances, but letters and stars are not. Vessels run in all directions, but the joints of a brick
    wall run in two directions.
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
    """Return the mean extent of a network's connected parts, as a fraction of the larger side of the picture.

    The extent of a connected part is the diagonal of its bounding box. In the mean, the weight of a connected part is its number of
    centre line pixels.
    """
    from scipy import ndimage

    parts, _ = ndimage.label(network, np.ones((3, 3)))
    sides = [[one.stop - one.start for one in part] for part in ndimage.find_objects(parts)]
    return float(np.hypot(*np.array(sides).T)[parts[middle] - 1].mean() / max(network.shape))


def _shape_of_lines(flat: Grey, network: Mask, middle: Mask) -> tuple[float, float]:
    """Return two measures of the centre lines of a network, each between 0 and 1.

    The first measure is the fraction of centre line pixels with similar contrasts to both sides of the vessel: the lower contrast
    is more than half the higher contrast. The second measure is the alignment of all centre lines with one direction or with the
    perpendicular direction.
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
    """Return a vessel network at the photograph's resolution.

    The edges of the vessels lie where the filter response crosses the threshold.
    """
    if network.shape == shape:
        return network
    from scipy import ndimage

    near = ndimage.binary_dilation(network, np.ones((3, 3)))
    found = resized(np.where(near, response, np.minimum(response, low)), shape) > low
    return _without_small(found, SMALLEST_PART * found.size / network.size)
