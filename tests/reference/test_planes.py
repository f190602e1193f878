"""Pictures of videos, against the formulas of the standard BT.709."""

from __future__ import annotations

import numpy as np
import pytest
from tests.without_compiler import printed

from shoal.views.drawing.encoding import VideoPlanes


def planes_of(picture):
    """Return the brightness of each pixel, and both differences of colour of each square of four
    pixels, as a television expects them.
    """
    red, green, blue = np.moveaxis(picture.astype(float), -1, 0)
    bright = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    height, width = bright.shape
    differences = [
        difference.reshape(height // 2, 2, width // 2, 2).mean(axis=(1, 3))
        for difference in ((blue - bright) / 1.8556, (red - bright) / 1.5748)
    ]
    return np.concatenate(
        [
            (16 + 219 / 255 * bright).ravel(),
            *(128 + 224 / 255 * difference.ravel() for difference in differences),
        ]
    )


def compare(height, width):
    rng = np.random.default_rng(height)
    planes = VideoPlanes(height, width)
    picture = np.zeros((height, width, 3), np.uint8)
    for _ in range(12):
        row, col = rng.integers(0, height), rng.integers(0, width)
        # from one pixel to all those below and right of it; at times, nothing changes
        part = picture[row : row + rng.integers(0, height), col : col + rng.integers(0, width)]
        part[...] = rng.integers(0, 256, part.shape)
        picture[-1, -1] = rng.integers(0, 256, 3)
        planes.show(picture)
        assert np.abs(planes.data - planes_of(picture)).max() < 0.51


# bytes in a row, and in the picture: multiples of a word, and not
@pytest.mark.parametrize(("height", "width"), [(2, 2), (6, 10), (8, 16), (10, 6), (4, 30)])
def test_pictures_of_videos(height, width):
    compare(height, width)


def test_pictures_of_videos_without_the_compiler():
    script = "from tests.reference.test_planes import compare; compare(6, 10); print('equal')"
    assert printed(script) == "equal\n"


def test_pictures_of_another_size_are_refused():
    with pytest.raises(ValueError, match=r"expected a picture of shape \(2, 4, 3\)"):
        VideoPlanes(2, 4).show(np.zeros((4, 2, 3), np.uint8))
