"""Long straight rows: the fewest strips, links with few turns, and what is preferred."""

import numpy as np
import pytest
import shapely

from shoal.core.errors import InvalidInputError
from shoal.core.geometry import cross
from shoal.search import SearchProblem, coverage_check, make_tour, plan_search, region_of
from shoal.search.cells.bends import with_fewer_bends
from shoal.search.flight.timing import turns_of
from shoal.search.kernels import runs
from shoal.search.tours.strips import fewest_strips


def strips_with(mask, along):
    """Return the number of strips if the given cells lie in rows and the others in columns."""
    across = mask & ~along
    steps = (along[:, 1:] & along[:, :-1]).sum() + (across[1:] & across[:-1]).sum()
    return mask.sum() - steps


@pytest.mark.parametrize("seed", range(30))
def test_no_other_division_has_fewer_strips(seed):
    rng = np.random.default_rng(seed)
    mask = rng.random((3, 4)) < 0.75
    mask[1, 1] = True
    count = int(mask.sum())
    least = mask.sum()
    for bits in range(2**count):
        along = np.zeros(mask.shape, dtype=bool)
        along[mask] = [bits >> k & 1 for k in range(count)]
        least = min(least, strips_with(mask, along))
    strips = fewest_strips(mask)
    assert len(strips) == least
    seen = np.zeros(mask.shape, dtype=int)
    for (row, col), (last_row, last_col) in strips:
        seen[row : last_row + 1, col : last_col + 1] += 1
    assert (seen == mask).all()


def comb():
    mask = np.zeros((24, 40), dtype=bool)
    mask[:8] = True
    for left in (0, 11, 22, 34):
        mask[:, left : left + 6] = True
    return mask


def test_arms_in_two_directions_have_fewer_turns():
    strips, rows = (make_tour(name, comb()).metrics() for name in ("strips", "boustrophedon"))
    assert strips.turns < 0.6 * rows.turns
    assert strips.cells == comb().sum()


def test_a_link_costs_the_turns_at_its_ends():
    ends = np.array([[[0, 0], [0, 5]], [[0, 8], [0, 9]], [[1, 5], [1, 0]], [[2, 2], [2, 2]]], float)
    cost = runs.step
    assert cost(ends, 2.0, 0, 1, 1, 0) == 3.0  # straight on
    assert cost(ends, 2.0, 0, 1, 2, 0) == 1.0 + 4.0  # to the next row and back
    assert cost(ends, 0.0, 0, 1, 2, 0) == 1.0
    assert cost(ends, 2.0, 0, 1, 1, 1) == 4.0 + 2.0  # straight on, but from the wrong end
    assert cost(ends, 2.0, 2, 1, 3, 0) == pytest.approx(5**0.5 + 4.0)


def test_a_path_around_a_round_lake_bends_seldom():
    lake = shapely.Point(0, 0).buffer(50, quad_segs=32)
    region = region_of(shapely.box(-100, -100, 100, 100).difference(lake), frame=None)
    arc = np.radians(np.linspace(160, 20, 51))
    way = np.vstack([[-60.0, 0.0], 50.05 * np.stack([np.cos(arc), np.sin(arc)], 1), [60.0, 0.0]])
    for price, most in ((0.0, 51), (20.0, 6), (60.0, 4)):
        found = with_fewer_bends(region, way, price)
        long = sum(
            np.hypot(*np.diff(path, axis=0).T).sum() * sign
            for path, sign in ((found, 1), (way, -1))
        )
        assert 1 <= turns_of(found).sum() <= most
        assert long <= price * (turns_of(way).sum() - turns_of(found).sum()) + 1e-9
        assert (found[[0, -1]] == way[[0, -1]]).all()
        assert coverage_check(region, [found], 1.0).outside_m == 0.0
    narrow = region_of(shapely.LineString(way).buffer(0.5), frame=None)
    kept = with_fewer_bends(narrow, way, 60.0)
    assert len(kept) > 5
    assert coverage_check(narrow, [kept], 1.0).outside_m == 0.0


def plans(region, robots, **fields):
    found = [
        plan_search(
            SearchProblem(
                region,
                robots=robots,
                footprint=20,
                angle="auto",
                vehicle="ideal",
                **fields,
                prefer=one,
            ),
            seed=1,
        )
        for one in ("time", "rows")
    ]
    return [
        (
            plan,
            sum(
                int(turns_of(plan.route(robot, plan.stops(robot)).points).sum())
                for robot in range(robots)
            ),
        )
        for plan in found
    ]


@pytest.mark.parametrize("robots", [1, 3])
def test_rows_have_fewer_turns_and_time_takes_less_time(robots):
    region = region_of(
        shapely.Polygon([(0, 0), (400, 0), (400, 130), (150, 130), (110, 300), (0, 300)]),
        frame=None,
    )
    (sooner, more), (straight, fewer) = plans(region, robots)
    assert fewer <= more
    assert sooner.planned_seconds <= straight.planned_seconds + 1e-6
    free = plan_search(
        SearchProblem(region, robots=robots, footprint=20, angle="auto", tour="spanning-tree"),
        seed=1,
    )
    turns = sum(
        int(turns_of(free.route(robot, free.stops(robot)).points).sum()) for robot in range(robots)
    )
    assert fewer < 0.8 * turns


def test_a_plain_rectangle_has_plain_rows():
    """Teeth of a spanning tree stood in it: turns in no time cost nothing when flights were compared."""
    plan = plan_search(
        SearchProblem("rectangle:203x145", robots=1, footprint=20, vehicle="ideal"), seed=1
    )
    route = plan.route(0, plan.stops(0)).points
    assert turns_of(route).sum() <= 2 * 8 + 2
    corners = np.concatenate([[0], 1 + np.flatnonzero(turns_of(route)), [len(route) - 1]])
    legs = np.diff(route[corners], axis=0)
    sides = np.sign(cross(legs[:-1], legs[1:]))
    short = np.hypot(*legs[1:-1].T) < 2 * 20
    assert short.sum() >= 6
    assert (sides[:-1][short] == sides[1:][short]).all()  # to the next row and back, no Z


def test_what_is_preferred_is_time_or_rows():
    with pytest.raises(InvalidInputError, match="prefer: expected"):
        SearchProblem("square:100", prefer="speed")
    camera = SearchProblem(
        "square:100",
        vehicle="multirotor,sensor_width=13,sensor_height=9,focal_length=9,altitude=40",
    )
    assert camera.turn_price(0.1) == 3.0
    assert camera.replaced(prefer="time").turn_price(0.1) == 0.85
    assert SearchProblem("square:100").turn_price(0.1) == 0.85
    assert SearchProblem("square:100").turn_price(2.0) == 2.0
