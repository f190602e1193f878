"""Vessel segmentation: find the vessels in a photograph, and compute a confidence that the
photograph shows vessels.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_number
from shoal.core.dataclass import dataclass, one_line
from shoal.core.errors import InvalidInputError, import_extra
from shoal.swarm.maps.reading import HIGH, LOW, Mask

Grey = NDArray[np.float64]

ANGLES = 12  # number of line angles over half a turn
LINE_WINDOW = (
    15  # window width in pixels (Nguyen et al. 2013); the line lengths are 1, 3, ... 15 pixels
)
LONGER = range(3, LINE_WINDOW + 1, 2)
DIRECTIONS = np.pi * np.arange(ANGLES) / ANGLES
THICKEST_VESSEL = 10  # pixels, from the published filters
FLATTENING = 19  # pixels, standard deviation of the Gaussian for the background
# standard deviations across and along a vessel, in pixels
RIDGES = tuple((width, 3 * width + 4) for width in (1.2, 1.7, 2.4, 3.4))
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
        Number of picture sizes: 1 for vessels up to 10 pixels wide, and one more for each doubling
        of the vessel width.
    """
    responses = []
    for level in range(levels):
        step = 2**level
        small = scipy.ndimage.uniform_filter(flat, step)[::step, ::step]
        inside = view[::step, ::step]
        lines = standardise(_line_strength(small, inside), inside)
        ridges = standardise(_ridge_strength(small), inside)
        response = standardise(lines + RIDGE_WEIGHT * ridges, inside)
        if level:
            response = _enlarge(response, view.shape, step)
        responses.append(response)
    return _highest(responses)


def without_ground(grey: Grey, view: Mask, deviation: float) -> Grey:
    """Return a picture without its background, which is the median over a wide window around each
    pixel.

    The window is three times ``deviation`` pixels wide. Before the function computes the median,
    mirror images of pixels inside the field of view replace the pixels outside the field of view.
    """
    reach = int(3 * deviation)
    grey = np.pad(_mirror(grey, view), reach, mode="symmetric")
    step = max(1, int(deviation / 5))
    coarse = scipy.ndimage.median_filter(
        scipy.ndimage.uniform_filter(grey, step)[::step, ::step], int(3 * deviation / step)
    )
    ground = _enlarge(coarse, grey.shape, step)
    return np.asarray(
        (grey - scipy.ndimage.gaussian_filter(ground, deviation / 4))[reach:-reach, reach:-reach]
    )


def _enlarge(coarse: Grey, shape: tuple[int, ...], step: int) -> Grey:
    places = (
        np.minimum(np.arange(n) / step, m - 1) for n, m in zip(shape, coarse.shape, strict=True)
    )
    return np.asarray(
        scipy.ndimage.map_coordinates(coarse, np.meshgrid(*places, indexing="ij"), order=1)
    )


def standardise(values: Grey, view: Mask) -> Grey:
    """Scale the pixel values to mean 0 and standard deviation 1 over the field of view."""
    inside = values[view]
    return np.asarray((values - inside.mean()) / (inside.std() + 1e-12))


def _mirror(grey: Grey, view: Mask) -> Grey:
    if view.all():
        return grey
    nearest = scipy.ndimage.distance_transform_edt(
        ~view, return_distances=False, return_indices=True
    )
    across = tuple(
        np.clip(2 * near - index, 0, side - 1)
        for near, index, side in zip(nearest, np.indices(grey.shape), grey.shape, strict=True)
    )
    return np.asarray(np.where(view[across], grey[across], grey[tuple(nearest)]))


def _line_strength(grey: Grey, view: Mask) -> Grey:
    """Return the response of a line detector: the mean of the brightest line through a pixel, minus
    the mean around the pixel.

    The response is averaged over lines of several lengths.
    """
    around = scipy.ndimage.uniform_filter(grey, LINE_WINDOW)
    strongest = [grey, *(np.full_like(grey, -np.inf) for _ in LONGER)]
    for angle in DIRECTIONS:
        sums = grey
        for highest, length in zip(strongest[1:], LONGER, strict=True):
            # a line is the line shorter by two points, and its ends
            half = (length - 1) / 2
            sums = sums + scipy.ndimage.convolve(grey, _points(np.array([-half, half]), angle))
            np.maximum(highest, sums / length, out=highest)
    total = standardise(grey, view)
    for highest in strongest:
        total = total + standardise(highest - around, view)
    return total / (len(strongest) + 1)


def lines_through(grey: Grey) -> Iterable[Grey]:
    """Yield, for each angle of `DIRECTIONS`, the mean value along the line through each pixel."""
    steps = np.arange(LINE_WINDOW, dtype=np.float64) - (LINE_WINDOW - 1) / 2
    for angle in DIRECTIONS:
        yield scipy.ndimage.convolve(grey, _points(steps, angle) / LINE_WINDOW)


def _points(steps: NDArray[np.float64], angle: float) -> Grey:
    """Return the pixel weights of the points at some distances from a pixel along a line. A point
    between pixels adds weight to all neighbouring pixels.
    """
    middle = int(steps.max()) + 1
    weights = np.zeros((2 * middle + 1, 2 * middle + 1))
    for step in steps:
        row, column = middle + step * np.sin(angle), middle + step * np.cos(angle)
        top, left = int(row), int(column)
        down, right = row - top, column - left
        weights[top : top + 2, left : left + 2] += np.outer([1 - down, down], [1 - right, right])
    return weights


def _ridge_strength(grey: Grey) -> Grey:
    """Return, for each pixel, the maximum response of ridge filters of all widths and angles.

    Each ridge filter is the second derivative of a Gaussian. The Gaussian is stretched along a
    vessel, and the derivative is taken across the vessel. Each ridge filter is scaled to energy 1,
    so that all ridge filters respond equally to noise.
    """
    reach = int(2.5 * max(length for _, length in RIDGES))
    padded = np.pad(grey, reach, mode="symmetric")
    shape = tuple(scipy.fft.next_fast_len(side, real=True) for side in padded.shape)
    spectrum = scipy.fft.rfft2(padded, shape)
    down, right = scipy.fft.fftfreq(shape[0])[:, None], scipy.fft.rfftfreq(shape[1])

    def answers() -> Iterable[Grey]:
        for width, length in RIDGES:
            for angle in np.pi * np.arange(ANGLES) / ANGLES:
                along = right * np.cos(angle) + down * np.sin(angle)
                across = down * np.cos(angle) - right * np.sin(angle)
                weights = across**2 * np.exp(
                    -2 * np.pi**2 * (width**2 * across**2 + length**2 * along**2)
                )
                yield scipy.fft.irfft2(spectrum * weights / np.sqrt((weights**2).sum()), shape)

    return _highest(answers())[reach:][: grey.shape[0], reach : reach + grey.shape[1]]


def _highest(pictures: Iterable[Grey]) -> Grey:
    """Return the maximum of several pictures at each pixel."""
    return reduce(np.maximum, pictures)


SMALLEST_SIDE = 16
# larger side in pixels of the picture that is filtered; the published field of view has 540 pixels
SIDE = 565
FIELD = 540
# A photograph is not resized if the logarithm of the scale is smaller than this, because resizing
# blurs. A larger limit would leave photographs of 620 to 720 pixels as they are, whose widest
# vessels the filters for one size of picture tear.
CLOSE = 0.1
LUMA = (0.2125, 0.7154, 0.0721)
SURROUND = (
    0.08  # a surround differs from black or white by at most this fraction of the brightness range
)
# RIM: width in pixels of the border of the field of view that a mirror image replaces. MIRRORED:
# width of the inner part of this border, in which vessels are searched.
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

    The grey channel of a colour picture is its green channel, because green shows blood with the
    best contrast. If the green channel has little contrast, the grey channel is the brightness of
    the picture.

    Raises
    ------
    InvalidInputError
        Raised if the array is not a picture, or if all pixels have a single colour.
    """
    array = np.asarray(image)
    if array.ndim not in (2, 3) or (array.ndim == 3 and array.shape[2] not in (3, 4)):
        raise InvalidInputError(
            f"expected a picture of shape (H, W), (H, W, 3) or (H, W, 4), got shape {array.shape}"
        )
    if min(array.shape[:2]) < SMALLEST_SIDE:
        raise InvalidInputError(
            f"expected a picture of at least {SMALLEST_SIDE}x{SMALLEST_SIDE} pixels, got shape"
            f" {array.shape}"
        )
    if array.dtype.kind not in "buif":
        raise InvalidInputError(
            f"expected a picture of real numbers, got an array of {array.dtype}"
        )
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


def resize(picture: NDArray[np.generic], shape: tuple[int, ...]) -> Grey:
    """Return a picture scaled to another size. Smooth the picture before reducing its size."""
    from PIL import Image

    floats = Image.fromarray(np.asarray(picture, dtype=np.float32))
    return np.asarray(
        floats.resize((shape[1], shape[0]), Image.Resampling.BILINEAR), dtype=np.float64
    )


def _from_0_to_1(values: NDArray[Any]) -> NDArray[np.float32]:
    """Scale pixel values to the range from 0 to 1. If all values are almost equal, return zeros."""
    darkest, brightest = float(values.min()), float(values.max())
    if not brightest - darkest > 1e-9 * max(abs(brightest), abs(darkest)):
        return np.zeros(values.shape, dtype=np.float32)
    return np.asarray((values - darkest) / (brightest - darkest), dtype=np.float32)


def _scaled_shape(shape: tuple[int, ...], factor: float) -> tuple[int, ...]:
    return tuple(max(SMALLEST_SIDE, round(side * factor)) for side in shape)


def _field_of_view(light: NDArray[np.float32]) -> Mask:
    """Return the mask of the pixels outside a black or white surround. The larger side of the mask
    is at most `SIDE` pixels.
    """
    from scipy import ndimage

    small = resize(light, _scaled_shape(light.shape, min(1.0, SIDE / max(light.shape))))
    rim = max(1, max(small.shape) // 60)
    for plain in (small < SURROUND, small > 1 - SURROUND):
        parts = ndimage.label(np.pad(plain, 1, constant_values=True))[0]
        surround = parts == parts[0, 0]
        view = ndimage.binary_opening(ndimage.binary_fill_holes(~surround), iterations=rim)[
            1:-1, 1:-1
        ]
        # A drawing of vessels on an empty background has no solid interior. Then the whole picture
        # is the field of view.
        if surround[1:-1, 1:-1].mean() > 0.05 and view.mean() > 0.35 and plain[view].mean() < 0.25:
            return np.asarray(view)
    return np.ones(small.shape, dtype=np.bool_)


def _at_size_of_filters(grey: NDArray[np.float32], view: Mask) -> Photograph:
    from scipy import ndimage

    if view.all():
        small = resize(grey, _scaled_shape(grey.shape, min(1.0, SIDE / max(grey.shape))))
        view = np.ones(small.shape, dtype=np.bool_)
        return Photograph(small, view, view)
    extent = max(int(np.ptp(np.flatnonzero(view.any(axis=axis)))) + 1 for axis in (0, 1))
    factor = FIELD / (extent * max(grey.shape) / max(view.shape))
    if abs(np.log(factor)) < CLOSE:
        factor = 1.0
    small = resize(grey, _scaled_shape(grey.shape, factor))
    inside = np.pad(resize(view, small.shape) > 0.5, 1)
    depth = ndimage.distance_transform_edt(inside)[1:-1, 1:-1]
    return Photograph(small, depth > RIM, depth > RIM - MIRRORED)


SHARES = {True: (0.09, 0.16), False: (0.02, 0.4)}
"""Minimum and maximum fraction of pixels above the threshold: for photographs with a surround
(True) and without one (False).

In photographs with a surround, experts mark on average 12 % of the pixels as vessels.
"""
THICKEST = {True: 0.0185, False: 0.035}
"""Width of the thickest vessel as a fraction of the photograph's larger side: with a surround
(True) and without one (False).
"""
CLEARLY_BRIGHTER = (
    3.0  # if bright lines are this much stronger than dark lines, dark lines are not tried
)
SMALLEST_PART = 40  # pixels
LEAST_CONFIDENCE, SURE = 0.25, 0.45
# strength of lines relative to noise of the same spectrum, for confidence 0 and for confidence 1
NOISE, CLEAR = 1.04, 1.44
EDGE = 0.2  # minimum step at a vessel's edge, as a fraction of the vessel's depth
# contrast of a network to its background, in standard deviations of the background, that noise does
# not reach
FAINT = 3.0
# fraction of the network that differs from both of its sides, for confidence 0 and for confidence 1
EDGES, LINES = 0.5, 0.9
# mean extent of a connected part relative to the picture's larger side, for confidence 0 and 1
SPECKS, TREES = 0.2, 0.65
# alignment of all lines with one direction, from 0 to 1; above this limit the confidence is reduced
WOVEN = 0.2
# length in pixels over which a line keeps its direction: short networks are aligned by chance
STRAIGHT = 60


@dataclass(frozen=True)
class Vessels:
    """The vessels found in a photograph.

    Parameters
    ----------
    mask : ndarray of bool, shape (H, W)
        True at vessel pixels. The mask of vessel pixels has the resolution of the photograph.
    confidence : float
        Confidence that the photograph shows vessels: from 0 (noise, or edges of other objects) to 1
        (vessels).
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
        return (
            f"the picture may show no vessels: confidence {self.confidence:.2f} of 1 (compare the"
            " overlay)"
        )


def find_vessels(
    image: ArrayLike,
    *,
    low: float = LOW,
    high: float = HIGH,
    bright: bool | None = None,
    thickest: float | None = None,
) -> Vessels:
    """Find the vessels in a picture, and return the mask of vessel pixels with a confidence.

    Parameters
    ----------
    image : array_like, shape (H, W), (H, W, 3) or (H, W, 4)
        Greyscale or colour picture with any range of values. The function ignores a fourth channel
        (opacity).
    low, high : float
        Thresholds of the filter response, as multiples of Otsu's threshold between vessels and
        background. A vessel consists of connected pixels with a response above ``low``. At least
        one of these pixels has a response above ``high``. Lower thresholds give more and finer
        vessels.
    bright : bool, optional
        Whether vessels are brighter than the surrounding pixels. By default, the clearer lines
        count as vessels: the bright lines or the dark lines.
    thickest : float, optional
        Width of the thickest vessel as a fraction of the picture's larger side. The default is
        0.0185 for a photograph with a surround, such as a photograph of an eye, and 0.035 for a
        photograph without a surround.

    Raises
    ------
    InvalidInputError
        Raised if the array is not a picture, if an option is out of range, or if the picture shows
        no vessels.
    MissingExtraError
        Raised if scikit-image is not installed.

    Notes
    -----
    The filter response of a pixel is the sum of two standardized responses. The first response
    comes from the multi-scale line detector by Nguyen and others (Pattern Recognition 46, 2013).
    The second response comes from elongated second derivatives of Gaussians. The second derivatives
    are similar to the Gabor filters by Soares and others (IEEE Transactions on Medical Imaging 25,
    2006). The second response has half the weight of the first response. The command `python -m
    benchmarks.vessels_from_photographs` measures the accuracy of the vessel finder on synthetic
    photographs of eyes.
    """
    return VesselFinder(image, bright=bright, thickest=thickest).find(low=low, high=high)


class VesselFinder:
    """A photograph with its filter responses. The method `find` finds the vessels in the photograph
    for any thresholds.

    The vessel finder stores the filter responses, so that finding the vessels for further
    thresholds is fast.

    Parameters
    ----------
    image, bright, thickest
        Arguments ``image``, ``bright`` and ``thickest`` of the function `find_vessels`.
    """

    def __init__(
        self, image: ArrayLike, *, bright: bool | None = None, thickest: float | None = None
    ) -> None:
        if thickest is not None:
            check_number(thickest, what="thickest", above=0, most=0.5)
        self.picture, self.shape, self.bright = read_photograph(image), np.shape(image)[:2], bright
        levels = levels_of(
            self.picture, THICKEST[self.picture.has_surround] if thickest is None else thickest
        )
        self.tried = (levels,) if thickest is not None else (levels, levels + 1)
        self._filtered: dict[tuple[int, bool], _Filtered] = {}
        self._clearest: _Filtered | None = None

    def find(self, *, low: float = LOW, high: float = HIGH) -> Vessels:
        """Return the vessels in the photograph for two thresholds. The function `find_vessels`
        explains the thresholds.
        """
        _check_thresholds(low, high)
        first = 0.0
        for levels in self.tried:
            confidence, bright, clearest = self._clearest_at(levels, low, high)
            # Vessels wider than usual must have a clear response.
            if confidence >= (LEAST_CONFIDENCE if levels == self.tried[0] else SURE):
                self._clearest = clearest
                return Vessels(clearest.mask(low, high, self.shape), confidence, bright)
            first = confidence if levels == self.tried[0] else first
        raise InvalidInputError(
            "expected a picture with vessels, got no network of lines that stands out "
            f"(confidence {first:.2f}, at least {LEAST_CONFIDENCE} is needed)"
        )

    def mask(self, *, low: float, high: float, shape: tuple[int, int]) -> Mask:
        """Return the mask of the photograph's vessels for the thresholds ``low`` and ``high``,
        resized to ``shape``.

        The method is fast, because it reuses the filter responses of the last call of `find` and
        computes no confidence.
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
            polarities = [self.bright]
        else:
            lines = [line[view] for line in lines_through(flat)]
            dark = _mean_of_highest(_highest(-line for line in lines), 0.05)
            ratio = _mean_of_highest(_highest(lines), 0.05) / (dark + 1e-12)
            # an optic disc is also bright
            polarities = [ratio > 1] if ratio > CLEARLY_BRIGHTER or ratio <= 1 else [False, True]
        for bright in polarities:
            if (levels, bright) not in self._filtered:
                self._filtered[levels, bright] = _filter(
                    flat if bright else -flat, self.picture, levels
                )
        candidates = [(bool(bright), self._filtered[levels, bright]) for bright in polarities]
        return max(
            (
                (_confidence(filtered.flat, view, filtered.network(low, high)), bright, filtered)
                for bright, filtered in candidates
            ),
            key=lambda entry: entry[0],
        )


@dataclass(frozen=True)
class _Filtered:
    """A picture with a flat background, the filter response of each pixel, and the threshold
    between vessels and background.
    """

    flat: Grey
    response: Grey
    split: float
    levels: int

    def network(self, low: float, high: float) -> Mask:
        mask = imaging_module("filters").apply_hysteresis_threshold(
            self.response, low * self.split, high * self.split
        )
        return _without_small(mask, SMALLEST_PART * self.levels)

    def mask(self, low: float, high: float, shape: tuple[int, ...]) -> Mask:
        return _in_own_pixels(self.network(low, high), self.response, low * self.split, shape)


def _filter(flat: Grey, picture: Photograph, levels: int) -> _Filtered:
    """Return the filter response of a picture on ``levels`` picture sizes, and the threshold
    between vessels and background.
    """
    from scipy.ndimage import gaussian_filter, grey_dilation

    filters, view = imaging_module("filters"), picture.view
    flat = without_opposite(flat, view)
    response = vessel_response(flat, view, levels)
    shares = SHARES[picture.has_surround]
    least, most = np.quantile(response[view], [1 - share for share in shares])[::-1]
    split = float(np.clip(filters.threshold_otsu(response[view]), least, most))
    response = np.where(picture.within, response, response.min())
    smooth = gaussian_filter(flat, 0.7)
    response[smooth <= EDGE * grey_dilation(smooth, THICKEST_VESSEL * 2 ** (levels - 1))] = (
        response.min()
    )
    return _Filtered(flat, response, split, levels)


def without_opposite(flat: Grey, view: Mask) -> Grey:
    """Clip the low values of a picture with a flat background.

    Without clipping, the vessel filters would respond to pixels beside very dark structures.
    """
    return np.maximum(flat, -3 * 1.4826 * float(np.median(np.abs(flat[view]))))


def _check_thresholds(low: float, high: float) -> None:
    if not 0 < low <= high <= 10:
        raise InvalidInputError(
            f"expected thresholds with 0 < low <= high <= 10, got low={low} and high={high}"
        )


def imaging_module(module: str) -> Any:
    """Import a module of scikit-image, which has no type annotations and is slow to import."""
    needed = "finding vessels in a picture needs scikit-image"
    return import_extra(f"skimage.{module}", needed, extra="imaging")


def levels_of(picture: Photograph, thickest: float) -> int:
    """Return the number of picture sizes on which the vessel filters must run to detect the
    thickest vessel.
    """
    width = thickest * max(picture.grey.shape) / THICKEST_VESSEL
    return 1 + max(0, int(np.ceil(np.log2(width) - 0.2)))


def _strength(flat: Grey, view: Mask) -> float:
    """Return the strength of bright lines: the mean of the highest responses."""
    return _mean_of_highest(_highest(line[view] for line in lines_through(flat)), 0.02)


def _mean_of_highest(values: Grey, share: float) -> float:
    """Return the mean of the highest values, which are the fraction ``share`` of all."""
    count = max(1, int(share * values.size))
    return float(np.partition(values, -count)[-count:].mean())


def _without_small(mask: Mask, least: float) -> Mask:
    """Remove connected parts with fewer than ``least`` pixels. If all parts are smaller, keep the
    largest parts.
    """
    from scipy import ndimage

    parts, _ = ndimage.label(mask, np.ones((3, 3)))
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0
    return np.asarray(sizes[parts] >= max(1, min(least, int(sizes.max()))))


def _confidence(flat: Grey, view: Mask, network: Mask) -> float:
    """Return the confidence, from 0 to 1, that a network of lines consists of vessels.

    The confidence combines four criteria. Vessels give stronger lines than random noise that has
    the spectrum of the picture. A vessel differs in brightness from the background on both sides,
    but the edge of an object differs on one side only. Vessels are connected over long distances,
    but letters and stars are not. Vessels run in all directions, but the joints of a brick wall run
    in two directions.
    """
    spectrum = np.fft.rfft2(flat)
    phase = np.angle(np.fft.rfft2(np.random.default_rng(0).standard_normal(flat.shape)))
    noise = np.fft.irfft2(np.abs(spectrum) * np.exp(1j * phase), flat.shape)
    ratio = _strength(flat, view) / (_strength(noise, view) + 1e-12)
    ground = flat[view & ~network]
    contrast = (
        (flat[network].mean() - ground.mean()) / (ground.std() + 1e-12)
        if network.any() and ground.size
        else 0.0
    )
    stands_out = max((ratio - NOISE) / (CLEAR - NOISE), (contrast - FAINT) / FAINT)
    middle: Mask = imaging_module("morphology").skeletonize(network)
    if not middle.any():
        return 0.0
    two_sided, woven = _shape_of_lines(flat, network, middle)
    lines = (two_sided - EDGES) / (LINES - EDGES)
    connected = (_mean_extent(network, middle) - SPECKS) / (TREES - SPECKS)
    by_chance = np.sqrt(STRAIGHT / np.count_nonzero(middle))
    most = 1.0 if woven < WOVEN + by_chance else (LEAST_CONFIDENCE + SURE) / 2
    return float(np.clip(min(stands_out, lines, connected), 0, most))


def _mean_extent(network: Mask, middle: Mask) -> float:
    """Return the mean extent of a network's connected parts, as a fraction of the larger side of
    the picture.

    The extent of a connected part is the diagonal of its bounding box. In the mean, the weight of a
    connected part is its number of centre line pixels.
    """
    from scipy import ndimage

    parts, _ = ndimage.label(network, np.ones((3, 3)))
    sides = [
        [extent.stop - extent.start for extent in slices] for slices in ndimage.find_objects(parts)
    ]
    return float(np.hypot(*np.array(sides).T)[parts[middle] - 1].mean() / max(network.shape))


def _shape_of_lines(flat: Grey, network: Mask, middle: Mask) -> tuple[float, float]:
    """Return two measures of the centre lines of a network, each between 0 and 1.

    The first measure is the fraction of centre line pixels with similar contrasts to both sides of
    the vessel: the lower contrast is more than half the higher contrast. The second measure is the
    alignment of all centre lines with one direction or with the perpendicular direction.
    """
    from scipy import ndimage

    smooth = ndimage.gaussian_filter(network.astype(np.float64), 1)
    rows, across, columns = (
        component[middle]
        for component in imaging_module("feature").structure_tensor(smooth, sigma=3, order="rc")
    )
    angle = np.arctan2(2 * across, rows - columns) / 2  # across the vessel
    reach = (ndimage.distance_transform_edt(network)[middle] + 2.5) * np.array(
        [np.cos(angle), np.sin(angle)]
    )
    flat = ndimage.gaussian_filter(flat, 1)
    sides = [
        ndimage.map_coordinates(flat, np.nonzero(middle) + side * reach, order=1, mode="nearest")
        for side in (1, -1)
    ]
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
    mask = resize(np.where(near, response, np.minimum(response, low)), shape) > low
    return _without_small(mask, SMALLEST_PART * mask.size / network.size)
