"""The angle of the rows, the tour along them, and what is seen and drawn of it."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest
import shapely
from tests.reference.regions import county, random_polygon

import shoal
from shoal.cli import run as command
from shoal.core.errors import InvalidInputError
from shoal.missions.checking import angle_of
from shoal.missions.mission_set import MissionSet
from shoal.search import (
    SearchProblem,
    TourCost,
    coverage_check,
    make_tour,
    open_region,
    plan_search,
)
from shoal.search.allocation.allocate import ALLOCATORS
from shoal.search.cells.clipping import rotate, rotate_shape
from shoal.search.cells.grid import cells_of
from shoal.search.episode import SearchEpisode
from shoal.search.flight.dubins import NoRoomError
from shoal.search.flight.timing import turns_of
from shoal.search.kernels import runs as run_order
from shoal.search.kernels.windows import fewest_links
from shoal.search.planning.orientation import compared_allocations, grid_tour, ranked_grid_tours
from shoal.search.planning.plan import plan_at_margin, turns_by_robot
from shoal.search.problem import AUTO_TOURS, TURN_PRICES
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import region_of
from shoal.search.tours.rows import CombTour
from shoal.views.search.history import SearchHistory


def blob(seed, *, corners=14, holes=1, size=400.0):
    """Return a random region of sharp corners with a hole."""
    rng = np.random.default_rng(seed)
    way = np.sort(rng.uniform(0, 2 * np.pi, corners))
    far = size * rng.uniform(0.5, 1.0, corners)
    area = shapely.Polygon(np.stack([far * np.cos(way), far * np.sin(way)], axis=1)).buffer(0)
    area = max(shapely.get_parts(area), key=lambda part: part.area)
    for _ in range(holes):
        area = area.difference(shapely.box(-60, -20, 50, 30))
    return region_of(
        max(shapely.get_parts(area), key=lambda part: part.area), frame=None, name=f"blob {seed}"
    )


def test_turning():
    points = np.array([(3.0, 1.0), (-2.0, 5.0)])
    np.testing.assert_allclose(rotate(rotate(points, 33.3), -33.3), points, atol=1e-12)
    assert rotate(points, 180).tolist() == (-points).tolist()
    assert rotate(points, -90).tolist() == [[1.0, -3.0], [5.0, 2.0]]
    assert rotate_shape(shapely.box(0, 0, 2, 1), 90).bounds == (-1.0, 0.0, 0.0, 2.0)


@pytest.mark.parametrize(("angle", "offset"), [(0.0, 0.0), (33.0, 0.5), (90.0, 0.3), (127.3, 0.9)])
@pytest.mark.parametrize("tour", ["boustrophedon", "spanning-tree"])
@pytest.mark.parametrize("seed", range(4))
def test_at_any_angle_all_is_seen_from_inside(tour, angle, offset, seed):
    region = blob(seed)
    laid = grid_tour(region, 37.0, tour, angle=angle, offset=offset)
    route = laid.paths.route(np.concatenate([laid.tour.cells, laid.tour.cells[:1]]))
    seen = coverage_check(region, [route.points], 37.0, angle=angle)
    assert (seen.covered_fraction, seen.outside_m) == (1.0, 0.0)
    grid = laid.grid
    assert sum(
        piece.area for piece in grid.clipped.pieces
    ) + grid.clipped.whole.sum() * 37.0**2 == pytest.approx(region.area_m2)
    np.testing.assert_array_equal(
        grid.cell_of(grid.lattice.to_region(grid.lattice.centers(*grid.cells.T))), grid.cells
    )


def test_turning_the_region_and_the_rows_changes_nothing_else():
    region = blob(7)
    other = region_of(rotate_shape(region.area, 25), frame=None, name="turned")
    one, two = (
        grid_tour(place, 37.0, "boustrophedon", angle=angle)
        for place, angle in ((region, 0.0), (other, 25.0))
    )
    assert (one.grid.mask == two.grid.mask).all()
    assert one.once_round(1.0) == pytest.approx(two.once_round(1.0), rel=1e-6)


def test_the_best_angle_is_along_a_long_field():
    field = shapely.affinity.rotate(shapely.box(0, 0, 600, 95), 38, origin=(0, 0))
    region = region_of(field, frame=None, name="field")
    best = ranked_grid_tours(region, 20.0, ["boustrophedon", "spanning-tree"], turn_cost=2.0)[0]
    assert best.grid.angle == pytest.approx(38.0)
    assert best.once_round(2.0) < 0.8 * grid_tour(
        region, 20.0, "spanning-tree", angle=0.0
    ).once_round(2.0)
    assert best.once_round(2.0) <= min(
        grid_tour(region, 20.0, tour, angle=38.0).once_round(2.0)
        for tour in ("boustrophedon", "spanning-tree")
    )


def test_rows_of_a_real_region_bend_about_twice_each():
    """Places to see cut cells from were chosen one by one: 229 turns in 59 rows, and links between
    rows 15 cells longer.
    """
    region = county("AK", "Sitka", area_m2=9e6)
    laid = grid_tour(region, 40.0, "boustrophedon", angle=110.0)
    route = laid.paths.route(np.concatenate([laid.tour.cells, laid.tour.cells[:1]]))
    assert turns_of(route.points).sum() <= 175
    assert route.length / 40.0 <= 1.053 * region.area_m2 / 1600
    seen = coverage_check(region, [route.points], 40.0, angle=110.0)
    assert (seen.covered_fraction, seen.outside_m) == (1.0, 0.0)


def test_each_cut_cell_is_seen_alone_from_its_place():
    region = blob(2, corners=30)
    grid = grid_tour(region, 30.0, "boustrophedon", angle=20.0).grid
    starts, places = grid.viewpoint_starts, grid.lattice.from_region(grid.viewpoints)
    assert region.contains(grid.viewpoints).all()
    single = [k for k in range(grid.n_cells) if starts[k + 1] - starts[k] == 1]
    cut = [k for k in single if not grid.clipped.whole[tuple(grid.cells[k])]]
    assert len(cut) > 40
    for k in cut:
        low, high = np.reshape(grid.clipped.pieces[grid.own[tuple(grid.cells[k])]].bounds, (2, 2))
        assert (np.maximum(high - places[starts[k]], places[starts[k]] - low) <= 15.0 + 1e-6).all()


def test_a_way_of_few_links_crosses_all_windows():
    """Five windows that one line crosses, beside places that lead up and down."""
    points = np.array(
        [(0.0, 0), *((x, y) for x in range(1, 6) for y in (-0.4, 0.0, 0.4)), (6.0, 0)]
    )
    starts = np.array([0, 1, 4, 7, 10, 13, 16, 17])
    boxes = np.array(
        [(0.0, 0, 0, 0), *((float(x), -0.4, float(x), 0.4) for x in range(1, 6)), (6.0, 0, 6, 0)]
    )
    none = np.zeros(0, dtype=np.int64)

    def links(banned, boxes, points):
        # a second chain of the same windows is not asked
        twice = np.concatenate([points, points]), np.append(starts, starts[1:] + starts[-1])
        boxes = np.concatenate([boxes, boxes])
        nodes, counts = np.full(14, -1), np.array([-1, -1])
        chains, asked = np.array([0, 7, 14]), np.array([0])
        fewest_links(*twice, boxes, chains, asked, 1.0, 24, banned, nodes, counts)
        assert (nodes[7:] == -1).all()
        assert counts[1] == -1
        return nodes[: counts[0]].tolist()

    assert links(none, boxes, points) == [0, 16]
    boxes[3], points[7:10, 1] = (3.0, 0.3, 3.0, 0.4), (0.3, 0.35, 0.4)
    assert links(none, boxes, points) == [0, 7, 16]
    assert links(np.array([7 * 34 + 16]), boxes, points) == [0, 8, 16]
    every = (np.arange(17)[:, None] * 34 + np.arange(17)).ravel()
    assert links(every, boxes, points) == []


def test_the_allocation_is_the_one_done_first_flights_home_included():
    tour_cost = TourCost(make_tour("moore", (8, 8)))
    team = {
        "rates": np.ones(2),
        "places": tour_cost.points[[0, 30]],
        "widths": np.ones(2, dtype=np.int64),
    }
    found = compared_allocations(tour_cost, np.array([0, 30]), ALLOCATORS, **team)
    given, times = found[0][0], {allocation.allocator: time for allocation, time in found}
    assert given.allocator == next(iter(times))
    assert given.makespan == min(times.values())
    found = compared_allocations(
        tour_cost, np.array([0, 30]), ALLOCATORS, **team, energy=25.0, recharge=10.0
    )
    longer = {allocation.allocator: time for allocation, time in found}
    assert all(longer[name] >= times[name] + 10.0 for name in times)


def test_where_turns_take_time_the_sooner_tour_is_taken_and_said():
    problem = SearchProblem("rectangle:200x90", robots=2, footprint=15)
    assert plan_search(problem).tour.name == "spanning-tree"
    plan = plan_search(problem.replaced(vehicle="ideal,turn_time=30"), seed=1)
    tours = [one for one in plan.compared if one.allocation is None]
    # the routes along the spanning tree alone take longer, so they are not flown
    assert {one.tour for one in tours} == {"headland", "boustrophedon"}
    assert (plan.tour.name, plan.grid.angle) == (tours[0].tour, 0.0)
    assert tours[0].cells == min(one.cells for one in tours)


def test_turns_that_cost_nothing_still_count_when_angles_are_compared():
    region = blob(5)
    free, dear = (
        ranked_grid_tours(region, 30.0, ["boustrophedon"], turn_cost=cost)[0]
        for cost in (0.0, TURN_PRICES["time"])
    )
    problem = SearchProblem(
        region, robots=1, footprint=30.0, angle="auto", tour="boustrophedon", vehicle="ideal"
    )
    plan = plan_search(problem)
    assert plan.grid.angle == dear.grid.angle != free.grid.angle
    routes = [free.route.points, dear.route.points, plan.route(0, plan.stops(0)).points]
    turns = [int(turns_of(route).sum()) for route in routes]
    assert max(turns[1:]) < turns[0]


def test_the_check_of_coverage_loses_no_footprints():
    """Many with nearly the same sides: united without a grid, some were not there, and 9,693 square
    metres "not seen".
    """
    region = blob(0, corners=40)
    laid = grid_tour(region, 25.0, "spanning-tree", angle=33.0)
    route = laid.paths.route(np.concatenate([laid.tour.cells, laid.tour.cells[:1]]))
    assert coverage_check(region, [route.points], 25.0, angle=33.0).uncovered_m2 == 0.0


def length_of_runs(ends, order, backwards):
    ways = [ends[run, [back, 1 - back]] for run, back in zip(order, backwards, strict=True)]
    return sum(float(np.hypot(*(ways[k][0] - ways[k - 1][1]))) for k in range(len(ways)))


def changed_orders(order, backwards):
    """Yield what one exchange makes of an order: a part the other way round, or up to three runs at
    another place.
    """
    n, pairs = len(order), list(zip(order.tolist(), backwards.tolist(), strict=True))
    for i in range(n):
        for j in range(i + 1, n):
            yield (
                pairs[:i]
                + [(run, 1 - back) for run, back in reversed(pairs[i : j + 1])]
                + pairs[j + 1 :]
            )
    for i, count in product(range(n), (1, 2, 3)):
        turned = pairs[i:] + pairs[:i]
        moved, rest = turned[:count], turned[count:]
        for k in range(1, len(rest)):
            for part in (moved, [(run, 1 - back) for run, back in reversed(moved)]):
                yield rest[:k] + part + rest[k:]


@pytest.mark.parametrize("seed", range(20))
def test_no_exchange_of_runs_is_left(seed):
    rng = np.random.default_rng(seed)
    n = 6 + seed % 7
    ends = rng.integers(0, 9, (n, 2, 2)).astype(float)
    ends[:, 1, 0] = ends[:, 0, 0]
    order, backwards = rng.permutation(n), rng.integers(0, 2, n)
    before = length_of_runs(ends, order, backwards[order])
    run_order.shorten(ends, np.zeros((2 * len(ends),) * 2), order, backwards, 0.0, 300)
    after = length_of_runs(ends, order, backwards[order])
    assert sorted(order) == list(range(n))
    assert after <= before + 1e-9
    for changed in changed_orders(order, backwards[order]):
        runs, flips = zip(*changed, strict=True)
        assert length_of_runs(ends, runs, flips) >= after - 1e-6


def test_random_exchanges_shorten_what_no_exchange_does():
    """From here exchanges of links and moves of runs lead to 39.82 cells between runs, and no
    further.
    """
    rng = np.random.default_rng(43)
    ends = rng.integers(0, 12, (24, 2, 2)).astype(float)
    ends[:, 1, 0] = ends[:, 0, 0]
    order, backwards = rng.permutation(24), rng.integers(0, 2, 24)
    run_order.shorten(ends, np.zeros((2 * len(ends),) * 2), order, backwards, 0.0, 300)
    assert length_of_runs(ends, order, backwards[order]) < 30


def test_boustrophedon_turns_twice_a_row():
    tour = make_tour("boustrophedon", (7, 30))
    assert tour.metrics().turns == 14
    mask = np.random.default_rng(1).random((40, 50)) < 0.8
    assert (
        make_tour("boustrophedon", mask).metrics().length < make_tour("comb", mask).metrics().length
    )


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("auto", "auto"),
        (370, None),
        (190.0, 10.0),
        (-45, 135.0),
        ("north", None),
        (float("nan"), None),
    ],
)
def test_the_field(given, kept):
    if kept is None:
        with pytest.raises(InvalidInputError, match="angle: expected"):
            SearchProblem("square:100", angle=given)
    else:
        assert SearchProblem("square:100", angle=given).angle == kept


def test_search_at_an_angle(tmp_path):
    """Robots at all angles see all, through losses and crashes; the episode is saved and verified;
    metres are the region's.
    """
    episode = shoal.run(
        "ring:120x50", robots=3, footprint=15, angle="auto", loss=0.2, crashes=1, targets=3, seed=2
    )
    assert episode.status.done
    assert episode.coverage.covered_fraction == 1.0
    assert episode.report()["tour"] in AUTO_TOURS
    turned_by = shoal.run("rectangle:200x90", robots=2, footprint=15, angle=30, seed=1)
    turned_by.save(tmp_path / "search.json")
    assert shoal.load(tmp_path / "search.json").verify()
    assert turned_by.report()["region"]["angle_degrees"] == 30.0
    region = open_region("rectangle:200x90")
    assert all(region.contains(route.points).all() for route in turned_by.routes)


def test_rows_on_the_earth_have_the_best_angle_unless_one_is_given(tmp_path):
    """A region on the earth as an operator has it; the same in metres, and one with an angle of its
    own, keep that.
    """
    field = rotate_shape(shapely.box(0, 0, 400, 60), 38)
    frame = LocalFrame(8.5, 47.4)
    earth, plane = (
        region_of(field, frame=frame, name="field"),
        region_of(field, frame=None, name="field"),
    )
    chosen = plan_search(SearchProblem(earth, robots=2, footprint=20), seed=1)
    assert chosen.row_angle == pytest.approx(38.0)
    assert {one.tour for one in chosen.compared if one.allocation is None} == {*AUTO_TOURS}
    level = [
        SearchProblem(plane, robots=2, footprint=20),
        SearchProblem(earth, robots=2, footprint=20, angle=0),
    ]
    turns = [
        turns_of(plan.route(0, plan.stops(0)).points).sum()
        for plan in (plan_search(one, seed=1) for one in level)
    ]
    assert [plan_search(one, seed=1).grid.angle for one in level] == [0.0, 0.0]
    assert turns_of(chosen.route(0, chosen.stops(0)).points).sum() < min(turns) / 1.5
    episode = shoal.run(SearchProblem(earth, robots=2, footprint=20), seed=1)
    assert episode.report()["region"]["angle_degrees"] == pytest.approx(chosen.row_angle)
    episode.save(tmp_path / "field.json")
    assert shoal.load(tmp_path / "field.json").verify()


def test_missions_are_checked_at_the_angle_of_their_rows(tmp_path, capfd):
    outline = [
        [13.40, 52.50],
        [13.406, 52.501],
        [13.4055, 52.503],
        [13.3995, 52.5022],
        [13.40, 52.50],
    ]
    feature = {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "Polygon", "coordinates": [outline]},
    }
    place = tmp_path / "field.geojson"
    place.write_text(json.dumps(feature))
    words = [
        "search",
        str(place),
        "--robots",
        "2",
        "--footprint",
        "25",
        "--angle",
        "21.37",
        "--missions",
        str(tmp_path / "out"),
    ]
    assert command(words) == 0
    check = ["missions", "check", str(tmp_path / "out"), str(place), "--footprint", "25", "--json"]
    capfd.readouterr()
    assert command([*check, "--least", "0.99999"]) == 0
    assert command([*check, "--angle", "66", "--least", "0.99999"]) == 1


def test_the_angle_of_ways():
    rows = np.array([(0.0, 0.0), (100.0, 0.0), (100.0, 10.0), (0.0, 10.0)])
    assert angle_of([rotate(rows, 37.0)]) == pytest.approx(37.0, abs=1e-9)
    assert angle_of([rotate(rows, 89.99)]) == pytest.approx(89.99)
    assert angle_of([rows[:1]]) == angle_of([]) == 0.0


def test_pictures_hold_all_ways_of_turned_rows():
    episode = shoal.run("rectangle:200x90", robots=2, footprint=15, angle=30, targets=2, seed=1)
    history = SearchHistory(episode)
    left, right, bottom, top = history.extent
    for trajectory in history.trajectories:
        assert ((trajectory.points >= (left, bottom)) & (trajectory.points <= (right, top))).all()
    middle = history.on_picture(np.array([(100.0, 45.0)]))[0]
    assert tuple(middle) == (100.0, 45.0)
    assert history.north is None
    assert cells_of(episode.plan.grid.region, 15, angle=30).angle == 30


@pytest.mark.parametrize("tour", ["auto", "boustrophedon", "spanning-tree", "comb"])
@pytest.mark.parametrize("angle", [0.0, 45.0, 90.0, 120.0])
def test_rows_run_along_the_angle_that_was_asked_for(tour, angle):
    """A spanning tree took the axis with more neighbouring blocks: rows at 135 degrees for --angle
    45.
    """
    problem = SearchProblem(
        "rectangle:150x300", robots=1, footprint=15, angle=angle, tour=tour, vehicle="multirotor"
    )
    plan = plan_search(problem, seed=1)
    legs = np.diff(plan.route(0, plan.stops(0)).points, axis=0)
    lengths, ways = np.hypot(*legs.T), np.degrees(np.arctan2(legs[:, 1], legs[:, 0]))
    beside = np.abs((ways - angle + 90) % 180 - 90)
    assert lengths[beside < 1].sum() > 1.5 * lengths[beside > 89].sum()
    assert plan.row_angle == angle
    assert {one.angle for one in plan.compared} <= {angle}


def test_the_angle_told_is_the_direction_of_the_rows():
    episode = shoal.run("rectangle:90x240", robots=1, footprint=15, tour="spanning-tree", seed=1)
    assert episode.plan.grid.angle == 0.0
    told = episode.report()
    assert (told["region"]["angle_degrees"], told["layers"][0]["angle_degrees"]) == (90.0, 90.0)
    assert make_tour("hilbert", (8, 8)).row_angle(30.0) in (30.0, 120.0)


@pytest.mark.parametrize("tour", ["boustrophedon", "spanning-tree", "comb"])
def test_rows_of_a_second_pass_cross_those_of_the_first(tour):
    plan = plan_search(
        SearchProblem("rectangle:100x40", robots=1, footprint=10, passes=2, tour=tour), seed=1
    )
    one, other = (
        plan.tour.row_angle(layer.angle, number) for number, layer in enumerate(plan.grid.layers)
    )
    assert abs(one - other) == 90.0


@pytest.mark.parametrize("shape", [(6, 9), (9, 6), (5, 7), (4, 4), (1, 5), (5, 1), (2, 3)])
@pytest.mark.parametrize("along", [True, False])
def test_lanes_of_a_comb_run_as_asked(shape, along):
    tour = make_tour(CombTour(along), shape)
    assert sorted(map(tuple, tour.cells.tolist())) == list(np.ndindex(shape))
    if min(shape) > 1:
        assert tour.steps.max() < 1.5
    if min(shape) > 2:
        assert tour.runs_along_rows == along


def test_wind_counts_along_the_real_rows():
    wind = "multirotor,wind_speed=3,wind_from=0"
    plan = plan_search(
        SearchProblem(
            "rectangle:90x240", robots=1, footprint=15, tour="spanning-tree", vehicle=wind
        ),
        seed=1,
    )
    assert plan.row_angle == 90.0
    assert plan.cell_seconds == pytest.approx(15 / plan.vehicle.mean_speed(90.0))
    assert plan.cell_seconds != pytest.approx(15 / plan.vehicle.mean_speed(0.0))


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


@pytest.mark.parametrize("seed", range(6))
def test_everything_is_seen_and_nothing_outside_in_any_region(seed):
    """Regions with spikes, corridors, holes and thin walls."""
    region = region_of(random_polygon(np.random.default_rng(seed), 400.0), frame=None, name="any")
    part = region_of(max(region.parts, key=lambda one: one.area), frame=None, name="part")
    for tour in ("boustrophedon", "spanning-tree"):
        laid = grid_tour(part, 20.0, tour, angle=30.0 * seed)
        checked = coverage_check(part, [laid.route.points], 20.0, angle=30.0 * seed)
        assert checked.covered_fraction >= 1 - 1e-7
        assert checked.outside_m == 0.0


def test_a_wall_hides_what_is_behind_it():
    """A thin wall between two fields: no cell is left to a path on the other side."""
    wall = shapely.Polygon([(150, 30), (152, 30), (190, 200), (188, 200)])
    region = region_of(
        shapely.Polygon([(0, 0), (330, 40), (300, 200), (30, 180)]).difference(wall),
        frame=None,
        name="wall",
    )
    laid = grid_tour(region, 20.0, "spanning-tree", angle=0.0)
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
    """With complete rows, the tour is about 5 % longer than the area over the footprint."""
    region = county("AK", "Sitka", area_m2=9e6)
    plan = plan_search(SearchProblem(region, robots=1, footprint=40.0, angle="auto"))
    route = plan.paths.route(np.concatenate([plan.tour.cells, plan.tour.cells[:1]]))
    assert route.length / 40.0 <= 1.056 * region.area_m2 / 1600
    assert turns_of(route.points).sum() <= 171


def test_other_angles_are_tried_before_a_fixed_wing_without_room_is_refused(tmp_path):
    """At the best angle of this U, the zone leaves no room for a turn; at others, there is room."""
    outlines = (
        "0,0 2545,467 1931,2035 1549,1965 2061,658 279,331 -232,1638 -614,1568 0,0",
        "-142,1094 -181,1106 -198,1132 -232,1115 -274,1118 -269,1090 -295,1066 -256,1055 -239,1028"
        " -205,1045 -162,1042 -167,1071 -142,1094",
    )
    features = [
        {
            "type": "Feature",
            "properties": {"role": "no-go"} if zone else {},
            "geometry": {
                "type": "Polygon",
                "coordinates": [
                    [
                        [8 + float(x) / 1e6, 47 + float(y) / 1e6]
                        for x, y in (pair.split(",") for pair in outline.split())
                    ]
                ],
            },
        }
        for zone, outline in enumerate(outlines)
    ]
    file = tmp_path / "u.json"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    problem = SearchProblem(
        str(file),
        robots=1,
        footprint=20.0,
        vehicle="fixed-wing",
        tour="boustrophedon",
        allocation="loop",
        transit=True,
        margin=3.0,
    )
    best = plan_at_margin(problem, 0)
    assert isinstance(best.refusal, NoRoomError)
    plan = plan_search(problem)
    assert plan.refusal is None
    assert plan.grid.angle != best.grid.angle
    missions = MissionSet.from_problem(problem)
    assert missions.plan.planned_seconds == plan.planned_seconds
    assert missions.problem.angle == plan.grid.angle
    with pytest.raises(NoRoomError, match="turn_radius: expected room for turns"):
        MissionSet.from_problem(problem.replaced(angle=best.grid.angle))


def test_missions_of_another_plan_are_planned_again_by_its_names(tmp_path):
    """The plan of one orientation was kept under names by which that of another one is planned."""
    zone = shapely.Polygon([(65, -35), (60, 35), (5, 45), (-10, -40)])
    outline = [(-230, -145), (-210, 90), (0, 170), (185, 125), (230, -45), (100, -170)]
    region = region_of(shapely.Polygon(outline).difference(zone), frame=LocalFrame(8.5, 47.4))
    problem = SearchProblem(
        region, robots=4, footprint=20, vehicle="multirotor", launch=[(-239.0, -150.0)]
    )
    missions = MissionSet.from_problem(problem)
    assert missions.problem.allocation != "auto", "another plan than without waiting"
    missions.run().save(tmp_path / "episode.json")
    assert SearchEpisode.load(tmp_path / "episode.json").verify()


@pytest.mark.parametrize(
    ("robots", "footprint", "launch", "changes"),
    [(2, 30.0, (100.0, -30.0), False), (4, 20.0, (100.0, 75.0), True)],
)
def test_missions_are_those_of_the_plan_that_is_best_once_vehicles_are_kept_apart(
    robots, footprint, launch, changes, tmp_path
):
    """With one launch point, the best flights may wait the longest for one another."""
    problem = SearchProblem(
        "rectangle:200x150",
        robots=robots,
        vehicle="multirotor",
        footprint=footprint,
        cross_track=0.0,
        launch=[launch],
    )
    missions = MissionSet.from_problem(problem)
    planned = plan_search(missions.problem.replaced(tour="auto", allocation="auto"))
    sets = [
        MissionSet.from_plan(plan, missions.options) for plan in (planned, *planned.alternatives)
    ]
    assert missions.end <= sets[0].end
    assert (missions.end != sets[0].end) == changes
    assert missions.run().verify()
    if changes:  # more turns, but earlier
        assert missions.end < 0.95 * sets[0].end
    else:  # nearly as early as the earliest, with fewer turns
        earliest = min(sets, key=lambda one: one.end)
        assert earliest.end < missions.end < 1.1 * earliest.end
        assert turns_by_robot(missions.plan).sum() < turns_by_robot(earliest.plan).sum()
    episode = missions.run()
    episode.save(tmp_path / "episode.json")
    again = SearchEpisode.load(tmp_path / "episode.json")
    assert again.plan.allocation.allocator == missions.plan.allocation.allocator
    assert again.verify()
