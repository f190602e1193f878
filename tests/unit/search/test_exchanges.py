"""Tours that exchanges of cells and viewpoints on shorter paths make shorter."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import shapely
from tests.reference import tours as reference
from tests.reference.regions import county, random_polygon
from tests.unit.search.test_orientation import blob

from shoal.search import SearchProblem, coverage_check, make_tour, plan_search
from shoal.search.cells.grid import cells_of
from shoal.search.cells.routing import RegionPaths
from shoal.search.cells.shortening.border_paths import along_border
from shoal.search.cells.shortening.exchanging import beside_on_tour, exchanged
from shoal.search.cells.visibility_graph import along_tour
from shoal.search.flight.timing import turns_of
from shoal.search.kernels.shortening import cell_exchanges, path_changes
from shoal.search.planning import orientation
from shoal.search.planning.orientation import can_exchange, grid_tour
from shoal.search.regions.region import region_of


def around(laid, cells):
    """Return the closed route through cells."""
    return laid.paths.route(np.concatenate([cells, cells[:1]]))


def seen_cell_by_cell(grid):
    """Return what the footprint sweeps between the viewpoints of each cell, united over all cells,
    in the lattice's frame.
    """
    points, half = grid.lattice.from_region(grid.viewpoints), grid.footprint / 2
    corners = half * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    found = []
    for begin, end in zip(grid.viewpoint_starts, grid.viewpoint_starts[1:], strict=False):
        views = points[begin:end]
        for one, other in pairwise(views) if len(views) > 1 else [(views[0], views[0])]:
            found.append(
                shapely.MultiPoint(np.vstack([one + corners, other + corners])).convex_hull
            )
    return shapely.union_all(found)


@pytest.mark.parametrize(("tour", "least_saved"), [("boustrophedon", 1.0), ("spanning-tree", 20.0)])
def test_exchanges_of_cells_save_length_and_turns(tour, least_saved):
    """The cost of the order follows from its cells alone; no cell is lost, and no door
    is invented.
    """
    grid = cells_of(blob(5, corners=24), 20.0, angle=15.0, on_rows=True)
    made = make_tour(tour, grid.mask)
    better, _ = exchanged(grid, made, 1.0)
    assert sorted(map(tuple, better.cells)) == sorted(map(tuple, made.cells))
    centres = made.cells.astype(float)
    order = np.arange(len(made.cells))
    cell_exchanges.shorten(centres, made.cells, beside_on_tour(grid, made.cells), order, 1.0)
    before, after = made.metrics(), replace(made, cells=made.cells[order]).metrics()
    assert after.length + after.turns <= before.length + before.turns - least_saved


@pytest.mark.parametrize("seed", range(8))
def test_no_exchange_of_cells_is_left(seed):
    """The plain reference computes the cost of the whole tour after each exchange."""
    rng = np.random.default_rng(seed)
    mask = np.ones((5, 6), dtype=bool)
    mask[rng.integers(5, size=3), rng.integers(6, size=3)] = False
    grid = cells_of(
        region_of(
            shapely.union_all([shapely.box(c, -r, c + 1, 1 - r) for r, c in np.argwhere(mask)]),
            name="mask",
        ),
        1.0,
    )
    cells = make_tour("spanning-tree", grid.mask).cells
    points, beside, order = (
        cells + rng.uniform(-0.2, 0.2, cells.shape),
        beside_on_tour(grid, cells),
        np.arange(len(cells)),
    )
    for _ in range(5):  # each time, all cells are active again
        cell_exchanges.shorten(points, cells, beside, order, 0.6)
    cost = reference.cost_of_round(points, order, 0.6)
    assert sorted(order) == list(range(len(cells)))
    assert cost <= reference.cost_of_round(points, np.arange(len(cells)), 0.6)

    def straight(one, other):
        return bool(cell_exchanges.in_sight(cells, beside, one, other))

    left = [
        reference.cost_of_round(points, changed, 0.6)
        for changed in reference.exchanges_of_cells(order, beside, straight)
    ]
    assert min(left) >= cost - 1e-6


def test_exchanges_pass_no_walls():
    """Two halls with a wall between them: only the cells beside the passage are neighbours across
    it.
    """
    region = region_of(
        shapely.box(0, 0, 80, 60).difference(shapely.box(39, 15, 41, 60)), frame=None, name="halls"
    )
    grid = cells_of(region, 10.0, on_rows=True)
    cells = grid.cells
    beside = beside_on_tour(grid, cells)
    across = [
        (a, b)
        for a in range(len(cells))
        for b in beside[a]
        if b >= 0 and cells[a, 1] < 4 <= cells[b, 1]
    ]
    assert across
    assert all(
        cells[list(pair), 0].min() >= 3 and cells[list(pair), 0].max() >= 4 for pair in across
    )
    number = grid.ordinals([(0, 3), (0, 4), (5, 3), (5, 4)])
    assert not cell_exchanges.in_sight(cells, beside, number[0], number[1])
    assert cell_exchanges.in_sight(cells, beside, number[2], number[3])


@pytest.mark.parametrize("seed", range(30))
def test_changed_paths_are_those_of_the_reference(seed):
    rng = np.random.default_rng(seed)
    path = rng.uniform(0, 3, (int(rng.integers(5, 9)), 2))
    targets = path[1:-1] + rng.uniform(-0.5, 0.5, (len(path) - 2, 2))
    boxes, steps = np.hstack([targets - 0.7, targets + 0.7]), np.array([1.0, 0.25, -0.25])
    room = len(path) * (3 + 3 * len(steps))
    paths, counts, costs = (
        np.empty((room, *path.shape)),
        np.empty(room, dtype=np.int64),
        np.empty(room),
    )
    found = path_changes.changed_paths(path, boxes, 0.5, steps, paths, counts, costs)
    expected = reference.shorter_paths(path, targets, 0.7, 0.5, steps)
    assert found == len(expected)
    order = np.argsort(costs[:found])
    np.testing.assert_allclose(costs[:found][order], [cost for cost, _ in expected], atol=1e-9)
    for k, (_, points) in zip(order, expected, strict=True):
        np.testing.assert_allclose(paths[k, : counts[k]], points, atol=1e-9)


@pytest.mark.parametrize(("tour", "angle"), [("boustrophedon", 20.0), ("spanning-tree", 67.0)])
@pytest.mark.parametrize("seed", range(5))
def test_shorter_paths_still_see_each_cell_from_its_own_viewpoints(tour, angle, seed):
    """Whichever robot searches a cell, and in whichever order: between the viewpoints of all cells
    everything is seen.
    """
    region = blob(seed, corners=14 + 4 * seed)
    grid = cells_of(region, 23.0, angle=angle, on_rows=True)
    made, _ = exchanged(grid, make_tour(tour, grid.mask), 0.8)
    straight = along_tour(grid, made.cells, 0.8)
    swept = along_border(straight, made.cells, 0.8)
    assert region.contains(swept.viewpoints).all()
    assert grid.area.difference(seen_cell_by_cell(swept)).area <= 1e-6 * region.area_m2
    route, before = (
        RegionPaths(one).route(np.concatenate([made.cells, made.cells[:1]]))
        for one in (swept, straight)
    )
    checked = coverage_check(region, [route.points], 23.0, angle=angle)
    assert (checked.covered_fraction, checked.outside_m) == (1.0, 0.0)
    costs = [one.length + 0.8 * 23.0 * turns_of(one.points).sum() for one in (route, before)]
    assert costs[0] < costs[1]


def test_paths_along_the_border_leave_to_one_another_what_they_see_twice():
    """Without the second look at chains of cells, these eight tours save 63 cells on their paths
    along the border.
    """
    saved = 0.0
    for tour, angle in (("boustrophedon", 20.0), ("spanning-tree", 67.0)):
        for seed in range(4):
            grid = cells_of(blob(seed, corners=14 + 4 * seed), 23.0, angle=angle, on_rows=True)
            cells = exchanged(grid, make_tour(tour, grid.mask), 0.8)[0].cells
            straight = along_tour(grid, cells, 0.8)
            ways = [
                RegionPaths(one).route(np.concatenate([cells, cells[:1]]))
                for one in (straight, along_border(straight, cells, 0.8))
            ]
            costs = [way.length / 23.0 + 0.8 * turns_of(way.points).sum() for way in ways]
            saved += costs[0] - costs[1]
    assert saved > 67.0


@pytest.mark.parametrize("seed", range(6))
def test_everything_is_seen_and_nothing_outside_in_any_region(seed):
    """Regions with spikes, corridors, holes and thin walls."""
    region = region_of(random_polygon(np.random.default_rng(seed), 400.0), frame=None, name="any")
    part = region_of(max(region.parts, key=lambda one: one.area), frame=None, name="part")
    for tour in ("boustrophedon", "spanning-tree"):
        laid = grid_tour(part, 20.0, tour, angle=30.0 * seed, exchange=True)
        checked = coverage_check(part, [laid.route.points], 20.0, angle=30.0 * seed)
        assert checked.covered_fraction >= 1 - 1e-7
        assert checked.outside_m == 0.0


def test_the_best_finalist_of_either_kind_gets_paths_along_the_border(monkeypatch):
    """Drafts of one kind gain more from further exchanges than drafts of the other kind, so each
    kind has two finalists.
    """
    finalists, completed = [], []

    def exchange(grid, tour, turn):
        finalists.append(tour.name)
        return grid, tour

    def border(grid, cells, turn):
        completed.append(cells)
        return along_border(grid, cells, turn)

    monkeypatch.setattr(orientation, "_exchanged", exchange)
    monkeypatch.setattr(orientation, "along_border", border)
    kinds = ["boustrophedon", "spanning-tree"]
    best = orientation.best_grid_tour(
        blob(5, corners=24), 20.0, kinds, turn_cost=0.0, exchange=True
    )
    assert sorted(finalists) == [name for name in kinds for _ in range(2)]
    assert len(completed) == 1
    assert np.array_equal(completed[0], best.tour.cells)
    assert next(one.tour for one in best.compared) == best.tour.name
    assert {one.tour for one in best.compared} == set(kinds)


def test_a_tour_is_searched_backwards_on_the_same_path():
    laid = grid_tour(blob(3, corners=30), 20.0, "spanning-tree", angle=40.0, exchange=True)
    assert (np.diff(laid.grid.viewpoint_starts) > 1).any()
    ahead, back = around(laid, laid.tour.cells), around(laid, laid.tour.cells[::-1])
    assert back.length <= 1.02 * ahead.length
    checked = coverage_check(laid.grid.region, [back.points], 20.0, angle=40.0)
    assert (checked.covered_fraction, checked.outside_m) == (1.0, 0.0)


def test_a_wall_hides_what_is_behind_it():
    """A thin wall between two fields: no cell is left to a path on the other side."""
    wall = shapely.Polygon([(150, 30), (152, 30), (190, 200), (188, 200)])
    region = region_of(
        shapely.Polygon([(0, 0), (330, 40), (300, 200), (30, 180)]).difference(wall),
        frame=None,
        name="wall",
    )
    laid = grid_tour(region, 20.0, "spanning-tree", angle=0.0, exchange=True)
    west = shapely.box(-10, -10, 171, 210).difference(
        shapely.Polygon([(150, 0), (150, 30), (190, 200), (400, 200), (400, 0)])
    )
    grid = laid.grid
    starts = grid.viewpoint_starts
    number = np.repeat(np.arange(grid.n_cells), np.diff(starts))
    inside = shapely.contains_xy(west, *grid.viewpoints.T)
    kept = np.unique(number[inside])
    points = [grid.viewpoints[starts[k] : starts[k + 1]] for k in kept]
    sides = replace(
        grid, viewpoints=np.concatenate(points), viewpoint_starts=np.cumsum([0, *map(len, points)])
    )
    hidden = region.area.intersection(west.buffer(-1e-6)).difference(seen_cell_by_cell(sides))
    assert hidden.area <= 1e-6 * region.area_m2


def test_rows_and_returns_of_a_real_region_are_short():
    """With complete rows, the tour is 4.9 % longer than the area over the footprint."""
    region = county("AK", "Sitka", area_m2=9e6)
    plan = plan_search(SearchProblem(region, robots=1, footprint=40.0, angle="auto"))
    route = plan.paths.route(np.concatenate([plan.tour.cells, plan.tour.cells[:1]]))
    assert route.length / 40.0 <= 1.043 * region.area_m2 / 1600


def test_tours_are_exchanged_for_equal_footprints_and_few_cells():
    region = blob(1)
    assert can_exchange(region, 20.0, [20.0, 20.0])
    assert not can_exchange(region, 20.0, [20.0, 60.0])
    assert not can_exchange(region, 1.0, [1.0])
