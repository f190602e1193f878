"""Lines of sight and coverage, beside Shapely's exact predicates."""

import numpy as np
import pytest
import shapely

from shoal.search import coverage_check, region_of
from shoal.search.regions.border import Border
from shoal.search.regions.boxes import uncovered
from shoal.search.regions.coverage import Image, footprints_along


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


def test_what_rectangles_leave_of_a_box():
    parts = np.array([(0, 0, 4, 10), (4, 0, 10, 3), (4, 3, 7, 10), (7, 3, 10, 10)], dtype=float)
    box = np.array([0.0, 0.0, 10.0, 10.0])
    assert len(uncovered(parts, box, 1e-7)) == 0
    for k in range(len(parts)):
        fields = shapely.box(*uncovered(np.delete(parts, k, axis=0), box, 1e-7).T)
        apart = shapely.union_all(fields).symmetric_difference(shapely.box(*parts[k]))
        assert apart.area < 1e-4
    parts[3, 0] += 1e-5  # a gap above the rounding error
    gap = uncovered(parts, box, 1e-7)
    assert gap == pytest.approx(np.array([(7, 3, 7 + 1e-5, 10)]), abs=1e-5)
    assert uncovered(parts[:0], box, 1e-7).tolist() == [[0, 0, 10, 10]]
    rng = np.random.default_rng(3)
    low = rng.uniform(0, 9, (20, 2))
    many = np.hstack([low, low + rng.uniform(0.5, 3, (20, 2))])
    left = shapely.box(*box).difference(shapely.union_all(shapely.box(*many.T)))
    fields = shapely.union_all(shapely.box(*uncovered(many, box, 1e-7).T))
    assert left.symmetric_difference(fields).area < 1e-4


@pytest.mark.parametrize("angle", [0.0, 30.0])
@pytest.mark.parametrize("image", [None, Image(1.2, 0.8)])
def test_what_a_track_leaves_beside_one_union_of_footprints(angle, image):
    rng = np.random.default_rng(7)
    region = region_of(shapely.Point(0, 0).buffer(100).difference(shapely.box(0, 0, 30, 200)))
    track = np.concatenate(
        [
            np.column_stack([np.linspace(-100, 100, 40)[::way], np.full(40, y)])
            for y, way in zip(np.arange(-95.0, 100, 11), [1, -1] * 9, strict=True)
        ]
    ) + rng.normal(0, 0.5, (720, 2))
    seen = coverage_check(region, [track], 10, angle=angle, image=image)
    along = (track[:-1], track[1:])
    swept = (
        footprints_along(*along, 5, angle) if image is None else image.along_legs(*along, 10, angle)
    )
    left = region.area.difference(shapely.union_all(swept, grid_size=1e-9))
    assert seen.uncovered_m2 == pytest.approx(left.area, abs=1e-3)
    assert seen.uncovered.symmetric_difference(left).area < 1e-2
    assert left.area > 10
