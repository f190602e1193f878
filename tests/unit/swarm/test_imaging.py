"""Vessels out of pictures: drawn ones, whose answer is known, and a photograph of a retina."""

from __future__ import annotations

import re
import sys

import numpy as np
import pytest
from benchmarks.vessels_from_photographs import Eye, angiogram, measured
from PIL import Image
from scipy import ndimage

from shoal.core import notices
from shoal.core.errors import InvalidInputError, MissingExtraError
from shoal.swarm.maps.files import open_map
from shoal.swarm.maps.generators import generate
from shoal.swarm.maps.imaging import (
    VesselFinder,
    VesselMap,
    find_vessels,
    map_of_vessels,
    segment_vessels,
)

pytest.importorskip("skimage")  # an extra


def parts(free):
    return ndimage.label(free)[1]


def assert_is_map(free):
    assert free.dtype == np.bool_
    assert free.flags["C_CONTIGUOUS"]
    assert parts(free) == 1
    assert free[0].any()
    assert free[-1].any()
    assert free[:, 0].any()
    assert free[:, -1].any()


def bars():
    """A frame of four bars, 4 to 8 pixels wide, that reaches over 160 rows and 180 columns."""
    picture = np.zeros((200, 240))
    picture[20:180, 40:46] = 1
    picture[20:180, 150:158] = 1
    picture[60:64, 40:158] = 1
    picture[140:145, 40:220] = 1
    return picture


def overlap(found, drawn):
    """Return the share of drawn cells that were found, and of found cells that were drawn.

    One cell off counts: the ends of a line come out a little thick, which moves the edge of the
    map.
    """
    near = [ndimage.binary_dilation(mask) for mask in (found, drawn)]
    return (near[0] & drawn).sum() / drawn.sum(), (near[1] & found).sum() / found.sum()


def shrunk(picture, shape):
    """Return the drawing, cropped and shrunk to the shape of a map."""
    rows, columns = np.flatnonzero(picture.any(axis=1)), np.flatnonzero(picture.any(axis=0))
    pick = [
        low + (np.arange(count) + 0.5) * (high + 1 - low) / count
        for low, high, count in ((rows[0], rows[-1], shape[0]), (columns[0], columns[-1], shape[1]))
    ]
    return picture[np.ix_(pick[0].astype(int), pick[1].astype(int))] > 0.5


@pytest.mark.parametrize(
    "paint",
    [
        lambda picture: picture,
        lambda picture: 1 - picture,
        lambda picture: (60 + 120 * picture).astype(np.uint8),
        lambda picture: np.stack([200 * picture, 100 * picture, 50 * picture], axis=-1).astype(
            np.uint8
        ),
        lambda picture: np.dstack([picture] * 3 + [np.ones_like(picture)]),
        lambda picture: picture > 0.5,
    ],
    ids=["bright", "dark", "bytes", "colour", "opacity", "bool"],
)
def test_drawn_bars_are_found(paint):
    mask = find_vessels(paint(bars())).mask
    for width in (90, 180):
        free = map_of_vessels(mask, width=width)
        assert_is_map(free)
        assert max(free.shape) == width
        found, right = overlap(free, shrunk(bars(), free.shape))
        assert found > 0.9
        assert right > 0.97
        assert 0.8 < free.sum() / shrunk(bars(), free.shape).sum() < 1.25


def test_noise_and_uneven_light_do_not_matter():
    light = np.linspace(0, 1.5, 240) + np.linspace(0, 1, 200)[:, None]
    picture = light - bars() + np.random.default_rng(1).normal(0, 0.15, (200, 240))
    free = segment_vessels(picture)
    assert_is_map(free)
    found, right = overlap(free, shrunk(bars(), free.shape))
    assert found > 0.95
    assert right > 0.9


def test_a_surround_and_its_rim_are_no_vessels():
    row, column = np.mgrid[:300, :300]
    disc = np.hypot(row - 150, column - 150) < 140
    picture = np.where(disc, 0.7, 0.0)
    picture[disc & (abs(row - column) < 4)] = 0.4
    free = segment_vessels(picture)
    assert_is_map(free)
    # Nothing but the one line across, from corner to corner.
    assert np.count_nonzero(free) < 8 * max(free.shape)
    assert min(free.shape) > 0.9 * max(free.shape)
    assert not free[: len(free) // 3, -len(free) // 3 :].any()


def test_the_picture_of_a_map_gives_the_map_back():
    drawn = generate("vessels:2000:3")
    picture = ndimage.gaussian_filter(np.pad(np.kron(drawn, np.ones((5, 5))), 30), 1.5)
    free = segment_vessels(picture, width=max(drawn.shape))
    assert_is_map(free)
    assert 1500 < np.count_nonzero(free) < 3000
    assert np.count_nonzero(
        free & ~ndimage.binary_erosion(free, np.ones((5, 5)))
    ) > 0.9 * np.count_nonzero(free)


def test_the_polarity_can_be_given():
    picture = 0.5 + bars() / 2
    picture[100:103, 50:150] = 0.0  # one fainter, dark line besides
    assert np.count_nonzero(segment_vessels(picture, bright=True)) > 1000
    dark = segment_vessels(picture, bright=False)
    assert max(dark.shape) < 120


def test_cells_have_so_many_pixels():
    mask = np.zeros((60, 200), dtype=bool)
    mask[20:26, 30:180] = True
    assert VesselMap(mask, width=50).pixels_a_cell == 3
    assert map_of_vessels(mask, width=50).shape == (2, 50)
    assert VesselMap(mask).pixels_a_cell == 1
    assert map_of_vessels(mask).shape == (6, 150)


def test_thin_vessels_stay_connected_in_a_coarse_map():
    picture = np.zeros((400, 400))
    line = np.arange(40, 360)
    for offset in (-1, 0, 1):
        picture[line, line // 2 + 100 + offset] = 1
        picture[400 - line, line // 2 + 100 + offset] = 1
    free = segment_vessels(picture, width=30)
    assert_is_map(free)
    assert max(free.shape) == 30


@pytest.fixture(scope="module")
def retina():
    from skimage.data import retina

    return retina()


def test_retina(retina):
    free = segment_vessels(retina)
    assert_is_map(free)
    assert max(free.shape) == 160
    assert min(free.shape) > 140
    assert 2200 <= np.count_nonzero(free) <= 5000
    # The fovea, in the middle of the picture, has no vessels; the arcs above and below it have.
    middle = slice(65, 95)
    assert not free[74:86, middle].any()
    assert free[:74, middle].any(axis=0).all()
    assert free[86:, middle].any(axis=0).all()


@pytest.mark.parametrize("side", [640, 700])
def test_a_retina_of_middle_size_keeps_both_arcs(retina, side):
    """With filters for two sizes, the optic disc cut these photographs into halves, and the map
    lost 54 % of the vessels.
    """
    picture = np.asarray(Image.fromarray(retina).resize((side, side), Image.Resampling.LANCZOS))
    parts, share = VesselMap(find_vessels(picture).mask).dropped
    assert share < 0.1
    assert parts > 0


def test_dropped_vessels_are_said(retina, tmp_path, monkeypatch):
    told = []
    monkeypatch.setattr(notices, "listeners", [told.append])
    monkeypatch.setattr(notices, "_told", set())
    Image.fromarray(retina[::4, ::4]).save(tmp_path / "eye.png")
    open_map(tmp_path / "eye.png", vessels=True)
    (text,) = told
    assert re.search(
        r"eye\.png: the map has the largest network of vessels; \d+ other parts with \S+ % of the"
        r" vessel pixels",
        text,
    )


def test_retina_in_other_sizes_and_with_other_thresholds(retina):
    small = retina[::7, ::7]
    finder = VesselFinder(small)  # its filters run once for all thresholds
    found = [map_of_vessels(finder.find(low=low).mask, width=80) for low in (0.18, 0.24, 0.35)]
    counts = [np.count_nonzero(free) for free in found]
    assert sorted(counts, reverse=True) == counts
    assert len(set(counts)) == 3
    np.testing.assert_array_equal(segment_vessels(small, width=80, low=0.24), found[1])


def test_a_drawn_eye_and_a_noisy_angiogram():
    """What `benchmarks.vessels_from_photographs` measures on many."""
    eye = Eye(1)
    vessels = find_vessels(eye.picture)
    assert vessels.warning is None
    assert not vessels.bright
    assert measured(vessels.mask, eye.truth, eye.view)["dice"] > 0.75
    for bright in (True, False):
        picture, truth = angiogram(1, bright=bright)
        vessels = find_vessels(picture)
        assert vessels.bright is bright
        assert measured(vessels.mask, truth, np.ones_like(truth))["dice"] > 0.85


@pytest.mark.parametrize(
    "name",
    ["page", "text", "brick", "hubble_deep_field", "cell", "coffee", "camera", "coins", "grass"],
)
def test_pictures_of_other_things_are_refused_or_warned_of(name):
    from skimage import data

    picture = getattr(data, name)()[:300, :400]
    if name in ("text", "brick", "cell"):
        assert "may show no vessels" in find_vessels(picture).warning
    else:
        with pytest.raises(InvalidInputError, match="got no network of lines"):
            find_vessels(picture)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros(100), r"expected a picture of shape .* got shape \(100,\)"),
        (np.zeros((40, 40, 2)), r"got shape \(40, 40, 2\)"),
        (np.zeros((4, 40, 40, 3)), "expected a picture of shape"),
        (np.zeros((0, 0)), r"expected a picture of at least 16x16 pixels, got shape \(0, 0\)"),
        (np.zeros((10, 100)), "expected a picture of at least 16x16 pixels"),
        (np.full((50, 50), 7, np.uint8), "got a picture of a single colour"),
        (np.full((50, 50, 3), 0.3), "got a picture of a single colour"),
        (np.full((50, 50), np.nan), "got NaN or infinity"),
        (np.where(bars() > 0, np.inf, 0), "got NaN or infinity"),
        (np.full((50, 50), 1j), "expected a picture of real numbers, got an array of complex128"),
        (np.full((50, 50), "a"), "expected a picture of real numbers"),
        (np.add.outer(np.arange(90.0), np.arange(90.0)), "got no network of lines that stands out"),
    ],
)
def test_what_is_no_picture_of_vessels_is_refused(image, message):
    with pytest.raises(InvalidInputError, match=message):
        segment_vessels(image)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"width": 0}, "expected a width of at least 1 cell, got 0"),
        ({"low": 0.0}, "expected thresholds with 0 < low <= high <= 10, got low=0.0"),
        ({"low": 0.5, "high": 0.4}, "expected thresholds"),
        ({"high": 15}, "expected thresholds"),
        ({"low": float("nan")}, "expected thresholds"),
        ({"thickest": 0.0}, "thickest: expected a number, above 0 and at most 0.5"),
        ({"thickest": 0.9}, "thickest: expected a number, above 0 and at most 0.5"),
    ],
)
def test_options_out_of_range_are_refused(options, message):
    with pytest.raises(InvalidInputError, match=message):
        segment_vessels(bars(), **options)


def test_without_scikit_image_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "skimage.filters", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'shoal\[imaging\]'"):
        segment_vessels(bars())


def test_a_finder_answers_for_one_pair_of_thresholds_after_the_other():
    picture = np.random.default_rng(0).normal(0, 0.05, (200, 240)) + ndimage.gaussian_filter(
        bars(), 1
    )
    finder = VesselFinder(picture)
    for low, high in ((0.6, 1.2), (0.9, 1.3)):
        found, expected = finder.find(low=low, high=high), find_vessels(picture, low=low, high=high)
        assert np.array_equal(found.mask, expected.mask)
        assert (found.confidence, found.bright) == (expected.confidence, expected.bright)
        assert np.array_equal(finder.mask(low=low, high=high, shape=(200, 240)), expected.mask)
    assert finder.mask(low=0.9, high=1.3, shape=(100, 120)).shape == (100, 120)
