"""Cells, viewpoints, ways inside, and the check of what was seen."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import shapely
from tests.reference.regions import back_and_forth

from shoal.core.errors import InvalidInputError
from shoal.search import (
    RegionPaths,
    cells_of,
    coverage_check,
    make_tour,
    merge_collinear,
    open_region,
    region_of,
)
from shoal.search.cells import routing
from shoal.search.cells.distances import CellDistances
from shoal.search.cells.visibility_graph import VisibilityGraph
from shoal.search.regions.boxes import clip_to_boxes
from shoal.search.regions.margin import with_margin


def length(way):
    return float(np.hypot(*np.diff(way, axis=0).T).sum())


# Cells


def test_a_square_of_whole_cells():
    grid = cells_of(open_region("square:100"), 10)
    assert grid.mask.shape == (10, 10)
    assert grid.mask.all()
    assert grid.corner == (0, 100)
    assert np.array_equal(
        grid.viewpoints, grid.lattice.to_region(grid.lattice.centers(*grid.cells.T))
    )
    assert grid.waypoint((0, 0)).tolist() == [5, 95]
    assert grid.cell_of([(0, 0), (100, 100), (34.9, 50.1)]).tolist() == [[9, 0], [0, 9], [4, 3]]
    assert grid.doors_east.all()
    assert grid.doors_south.all()


def test_a_third_of_a_metre_has_no_cells_by_rounding():
    assert cells_of(open_region("square:0.3"), 0.1).shape == (3, 3)


def test_a_footprint_larger_than_the_region_is_one_cell():
    grid = cells_of(open_region("circle:3"), 100)
    assert (grid.shape, len(grid.viewpoints)) == ((1, 1), 1)
    assert grid.region.contains(grid.viewpoints).all()


def test_smaller_cells_stand_nearer():
    grid = cells_of(open_region("square:100"), 20, size=10)
    assert (grid.n_cells, grid.footprint, grid.size) == (100, 20, 10)


def test_a_corner_whose_cell_has_its_centre_outside():
    triangle = region_of(shapely.Polygon([(0, 0), (30, 0), (0, 30)]))
    grid = cells_of(triangle, 10)
    assert grid.n_cells == 6
    assert triangle.contains(grid.viewpoints).all()
    assert np.allclose(grid.waypoint((1, 1)), [15, 15])
    ell = region_of(shapely.Polygon([(0, 0), (30, 0), (30, 2), (2, 2), (2, 30), (0, 30)]))
    assert coverage_check(
        ell, [[p] for p in cells_of(ell, 10).viewpoints], 10
    ).covered_fraction == pytest.approx(1, abs=1e-9)


def test_a_wall_through_a_cell_gives_its_far_side_to_a_neighbour():
    # The wall stands in the left third of the middle column and is open at no end but the lower
    # one, far away.
    wall = shapely.box(12, 5, 13, 300)
    region = region_of(shapely.box(0, 0, 30, 300), no_go=wall)
    grid = cells_of(region, 10)
    assert grid.viewpoints_in((10, 0)).tolist()[0] == [5, 195]
    assert len(grid.viewpoints_in((10, 0))) == 2
    assert grid.viewpoints_in((10, 0))[1][0] == pytest.approx(12)
    assert grid.waypoint((10, 1)).tolist() == [15, 195]
    assert not grid.doors_east[10, 0]
    assert grid.doors_east[10, 1]
    assert grid.doors_south[:-2].all()
    assert RegionPaths(grid).route([(10, 0)]).length == pytest.approx(7)


def test_parts_and_what_is_left_in_a_cell_of_another_part():
    region = region_of(shapely.MultiPolygon([shapely.box(0, 0, 40, 38), shapely.box(0, 39, 3, 40)]))
    grid = cells_of(region, 10)
    assert len(region.parts) == 2
    assert set(np.unique(grid.components)) == {0}
    assert len(grid.viewpoints_in((0, 0))) == 2
    route = RegionPaths(grid, transit=True).route([(0, 0), (0, 1)])
    assert route.transit.tolist() == [True, True]
    with pytest.raises(InvalidInputError, match="expected two places in one part of the region"):
        RegionPaths(grid).route([(0, 0), (0, 1)])
    apart = cells_of(
        region_of(shapely.MultiPolygon([shapely.box(0, 0, 40, 40), shapely.box(60, 0, 80, 20)])), 10
    )
    assert apart.components[-1].tolist() == [0, 0, 0, 0, -1, -1, 1, 1]


def test_many_cells_on_a_fine_border_stay_few_shapes():
    grid = cells_of(open_region("circle:1000"), 4)
    assert grid.n_cells == pytest.approx(np.pi * 250**2, rel=0.02)
    assert len(grid.clipped.pieces) < 4 * 500 + 400


def star(spikes):
    """A region with narrow spikes all around."""
    angles = np.arange(2 * spikes) * np.pi / spikes
    radius = np.where(np.arange(2 * spikes) % 2, 100.0, 60.0)
    corners = np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1)
    return region_of(shapely.Polygon(corners))


def corners_cut(monkeypatch, spikes):
    """The number of corners of all shapes that are cut for the cells of a star with a margin."""
    cut, intersection = [0], shapely.intersection

    def counted(shape, other, **given):
        pair = np.broadcast_arrays(shape, other)[0]
        cut[0] += int(shapely.get_num_coordinates(pair).sum())
        return intersection(shape, other, **given)

    kept = with_margin(star(spikes), 0.1)
    with monkeypatch.context() as patched:
        patched.setattr(shapely, "intersection", counted)
        cells_of(kept, 2000 / spikes / 4)
    return cut[0]


def test_no_cell_is_cut_out_of_the_whole_area(monkeypatch):
    # 4 times as many corners, and 16 times as many cells on the border
    assert corners_cut(monkeypatch, 120) < 20 * corners_cut(monkeypatch, 30)


def test_many_boxes_cut_a_shape_as_one_box_does():
    shape, rng = star(60).area, np.random.default_rng(3)
    low = rng.uniform(-110, 90, (200, 2))
    high = low + rng.uniform(1, 30, (200, 2))
    for whole in (shape, shape.boundary):
        cut = clip_to_boxes(whole, low, high)
        expected = shapely.intersection(whole, shapely.box(*low.T, *high.T))
        assert shapely.area(shapely.symmetric_difference(cut, expected)).max() < 1e-9
        assert shapely.length(cut) == pytest.approx(shapely.length(expected), abs=1e-9)
        assert (shapely.get_dimensions(cut) == shapely.get_dimensions(expected)).all()


# Ways


def test_corners_near_a_place():
    graph, (low, high) = VisibilityGraph(star(60)), np.array([[-50.0, 10.0], [20.0, 70.0]])
    places = np.array([[60.0, 0.0], [0.0, 55.0]])
    away = np.hypot(*(graph.corners[:, None] - places).T).min(axis=0)
    inner = ((graph.corners >= low) & (graph.corners <= high)).all(axis=1)
    assert graph.within(low, high).tolist() == np.flatnonzero(inner).tolist() != []
    few = graph.within(low, high, 3).tolist()
    assert few == sorted({*few} & {*np.flatnonzero(inner).tolist()})
    assert len(few) == 3
    assert graph.around(places, 15.0).tolist() == np.flatnonzero(away <= 15).tolist() != []
    assert graph.around(places[:0], 15.0).tolist() == []


def test_from_spike_to_spike():
    kept = with_margin(star(60), 0.1)
    graph, grid = VisibilityGraph(kept), cells_of(kept, 2)
    along = grid.viewpoints[:, 0]
    ends = grid.viewpoints[[np.argmax(along), np.argmax(along * (grid.viewpoints[:, 1] > 30))]]
    way = RegionPaths(grid).leg(*ends)
    shortest = graph.shortest(*ends, np.arange(len(graph.corners)))
    assert len(way) > 2
    assert kept.contains(way).all()
    assert length(way) <= 1.01 * length(shortest)


def test_paths_in_cells_that_stand_on_a_corner(monkeypatch):
    # a path from portal to portal may bend a cell's diagonal away
    monkeypatch.setattr(routing, "_MOST_CORNERS", 0)
    region = star(60)
    grid = cells_of(region, 20, angle=45)
    there = grid.cells.repeat(2, axis=0)
    there[1::2] = grid.cells[::-1]
    route = RegionPaths(grid).route(there)
    assert coverage_check(region, [route.points], 20).legs_outside == 0


def test_straight_where_it_can_be():
    paths = RegionPaths(cells_of(open_region("square:100"), 10))
    assert paths.leg((0, 0), (100, 100)).tolist() == [[0, 0], [100, 100]]
    assert paths.leg((0, 0), (100, 0)).tolist() == [[0, 0], [100, 0]]  # along the border


def test_shortest_around_a_corner():
    yard = region_of(shapely.box(0, 0, 100, 100), no_go=shapely.box(40, 0, 60, 70))
    paths = RegionPaths(cells_of(yard, 10))
    way = paths.leg((30, 60), (70, 60))
    assert way.tolist() == [[30, 60], [40, 70], [60, 70], [70, 60]]
    assert length(paths.leg((10, 0), (90, 0))) == pytest.approx(2 * np.hypot(30, 70) + 20)


def test_the_shorter_side_of_a_hole():
    yard = region_of(shapely.box(0, 0, 200, 100), no_go=shapely.box(50, 10, 150, 95))
    way = RegionPaths(cells_of(yard, 10)).leg((45, 50), (155, 50))
    assert way[1:-1].tolist() == [[50, 10], [150, 10]]


def spiral(turns, *, gap=10.0):
    """A corridor that winds inward, its walls of many corners."""
    angles = np.linspace(0, 2 * np.pi * turns, 120 * turns)
    radius = 20 + gap * angles / (2 * np.pi)
    line = shapely.LineString(np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1))
    return (
        region_of(line.buffer(gap * 0.35, quad_segs=4), name="spiral"),
        np.array([line.coords[0], line.coords[-1]]),
        line.length,
    )


def test_far_through_a_winding_corridor():
    region, ends, along = spiral(6)
    way = RegionPaths(cells_of(region, 6)).leg(*ends)
    assert coverage_check(region, [way], 6).legs_outside == 0
    assert 0.85 * along < length(way) < along


def test_route_visits_all_places_in_order():
    region, _, _ = spiral(2)
    grid = cells_of(region, 6)
    route = RegionPaths(grid).route(grid.cells)
    assert np.array_equal(route.points[route.stops], grid.viewpoints)
    assert coverage_check(region, [route.points], 6).legs_outside == 0
    assert length(route.waypoints()) == pytest.approx(route.length)


def test_one_stop_and_none():
    grid = cells_of(open_region("square:20"), 10)
    assert RegionPaths(grid).route([(0, 0)]).points.tolist() == [[5, 15]]
    assert RegionPaths(grid).route(np.zeros((0, 2), dtype=int)).points.shape == (0, 2)


def test_merge_collinear_keeps_the_way_back():
    way = np.array([(0, 0), (1, 1), (2, 2), (2, 2), (0, 0), (0, 5), (0, 9)], dtype=float)
    assert merge_collinear(way).tolist() == [[0, 0], [2, 2], [0, 0], [0, 9]]
    assert merge_collinear(np.array([(1, 2), (1, 2)])).tolist() == [[1, 2]]
    assert merge_collinear(np.zeros((0, 2))).shape == (0, 2)


# The check


def test_the_check_finds_a_missing_cell():
    grid = cells_of(open_region("square:100"), 10)
    rows = [[(5, y), (95, y)] for y in range(5, 100, 10)]
    assert coverage_check(grid.region, rows, 10).covered_fraction == 1
    seen = coverage_check(grid.region, rows[:3] + rows[4:], 10)
    assert seen.uncovered_m2 == pytest.approx(1000)
    assert seen.uncovered.equals(shapely.box(0, 30, 100, 40))
    assert coverage_check(grid.region, rows, 9.9).uncovered_m2 == pytest.approx(
        1e4 - 99.8 * 99.0 + 0.2 * 0, rel=0.2
    )
    assert coverage_check(grid.region, [], 10).covered_fraction == 0


def test_the_check_agrees_with_one_union():
    grid = cells_of(region_of(open_region("ring:200x60").area), 9)
    rng = np.random.default_rng(3)
    stops = grid.viewpoints[rng.permutation(len(grid.viewpoints))[:300]]
    way = RegionPaths(grid).legs(stops).points
    legs = [
        shapely.MultiPoint(
            [p + d for p in leg for d in ((-4.5, -4.5), (4.5, -4.5), (4.5, 4.5), (-4.5, 4.5))]
        )
        for leg in pairwise(way)
    ]
    plain = grid.region.area.difference(shapely.union_all([leg.convex_hull for leg in legs]))
    seen = coverage_check(grid.region, [way], 9)
    assert seen.uncovered_m2 == pytest.approx(plain.area, rel=1e-9)
    assert seen.length_m == pytest.approx(length(way))


def test_the_check_finds_what_leaves_the_region():
    region = open_region("ring:50x40")
    seen = coverage_check(region, [[(45, 0), (-45, 0)], [(0, 45), (0, 46)]], 10)
    assert seen.outside_m == pytest.approx(80, rel=1e-3)
    assert seen.legs_outside == 1
    # a vehicle that stands in the hole
    assert coverage_check(region, [[(0, 0)]], 10).legs_outside == 1
    assert coverage_check(region, [[(45, 0), (50.01, 0)]], 10, tolerance=0.02).legs_outside == 0


def test_a_sweep_sees_everything():
    grid = cells_of(open_region("ring:300x120"), 12)
    route = back_and_forth(grid)
    seen = coverage_check(grid.region, [route.points], 12)
    assert seen.covered_fraction == pytest.approx(1, abs=1e-9)
    assert seen.legs_outside == 0


def test_a_path_between_two_parts_is_as_long_as_given():
    mask = np.array([[True, True, False, False, True]])
    tour = make_tour("comb", mask)
    here, cell = int(tour.position[0, 1]), int(tour.position[0, 4])
    assert (cell - here) % len(tour) == 1
    distances = CellDistances(tour, steps=np.full(len(tour), 3.5))
    assert distances.length(here, cell) == 3.5
    assert distances.length(cell, here) == 3.5
    assert distances.length(here, cell, closed=1 << cell) == np.inf
