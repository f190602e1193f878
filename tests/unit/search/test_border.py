"""Lines of sight and coverage, beside Shapely's exact predicates."""

import numpy as np
import pytest
import shapely

from shoal.search.regions.border import Border
from shoal.search.regions.coverage import _cover


def areas():
    rng = np.random.default_rng(3)
    angles = np.linspace(0, 2 * np.pi, 3000, endpoint=False)
    star = shapely.Polygon(
        (50 + rng.uniform(-3, 3, 3000))[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    )
    square = shapely.box(0, 0, 10, 10).difference(shapely.box(2, 2, 4, 8))
    far = shapely.affinity.translate(square, 4e5, -3e6)
    two = shapely.MultiPolygon([*square.geoms] if square.geom_type != "Polygon" else [square])
    sliver = shapely.box(0, 0, 10_000, 1e-3)
    return [star.buffer(0), square, far, two.union(shapely.box(20, 0, 21, 1)), sliver]


@pytest.mark.parametrize("area", areas())
def test_segments_that_meet_a_border(area):
    rng = np.random.default_rng(5)
    border, corners = Border(area), shapely.get_coordinates(area)
    low, high = np.reshape(area.bounds, (2, 2))
    starts, ends = rng.uniform(low - 2, high + 2, (2, 4000, 2))
    # through corners, along sides, upright, level, of no length, and far outside
    starts[::3] = corners[rng.integers(0, len(corners), len(starts[::3]))]
    ends[::6] = corners[rng.integers(0, len(corners), len(ends[::6]))]
    ends[1::7, 0], ends[2::7, 1] = starts[1::7, 0], starts[2::7, 1]
    ends[3::50] = starts[3::50]
    ends[4::90] = 1e7
    lines = shapely.linestrings(np.stack([starts, ends], axis=1))
    line = shapely.boundary(area)
    shapely.prepare(line)  # unprepared, a segment of no length meets nothing
    expected = shapely.intersects(line, lines)
    assert (border.is_met(starts, ends) == expected).all()
    assert expected.any()
    assert not expected.all()


def test_rectangles_that_cover_a_box_together():
    parts = np.array([(0, 0, 4, 10), (4, 0, 10, 3), (4, 3, 7, 10), (7, 3, 10, 10)], dtype=float)
    box = (0.0, 0.0, 10.0, 10.0)
    assert _cover(parts, box)
    for k in range(len(parts)):
        assert not _cover(np.delete(parts, k, axis=0), box)
    parts[3, 0] += 1e-5  # a gap above the rounding error
    assert not _cover(parts, box)
    assert not _cover(parts[:0], box)
