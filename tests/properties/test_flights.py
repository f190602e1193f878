"""What mission files make vehicles do, judged from the files alone: time, turns, height above
ground.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
import shapely
from tests.properties.flights import judged, missions_of_plan, random_problem
from tests.reference.flight import dubins_path, narrow_turns, way_of_plan
from tests.soak import often

from shoal.core import notices
from shoal.core.errors import InvalidInputError
from shoal.missions import check_missions, write_missions
from shoal.search import LocalFrame, open_region
from shoal.search.flight.dubins import (
    NEAR,
    WORDS,
    NoRoomError,
    dubins_parts,
    dubins_paths,
    plan_dubins_path,
)
from shoal.search.planning.plan import (
    SearchPlan,
    least_price,
    plan_search,
    plans_along,
    price_of_turns,
)
from shoal.search.problem import SearchProblem
from shoal.search.regions.margin import grow

# a plan in whose file rounding turns a leg of 1.4 m by .04 degrees, so that a bend of 1 degree
# becomes a turn
TURNED = 773


@pytest.mark.parametrize("seed", range(often(9, 60)))
def test_plans_that_are_not_flown_are_no_better_than_the_chosen_one(seed):
    problem, _ = random_problem(seed)
    prefer = ("time", "rows")[seed % 2]
    problem = problem.replaced(angle="auto" if seed % 4 == 1 else problem.angle, prefer=prefer)
    problem.check_at_place()
    plans = [plan for plan in plans_along(problem, seed) if plan.refusal is None]
    prices = [price_of_turns(plan, problem) for plan in plans]
    for plan, price in zip(plans, prices, strict=True):
        assert 0 < least_price(plan, problem) <= price
    chosen = plan_search(problem, seed=seed)
    assert not plans or price_of_turns(chosen, problem) == min(prices)


def test_no_mission_is_longer_than_its_battery_and_no_turn_narrower_than_its_radius(tmp_path):
    """A thousand: python -m benchmarks.endurance."""
    shares, narrow, refused = [], [], 0
    for seed in (*range(often(3, 7)), TURNED):
        found = judged(seed, tmp_path / str(seed))
        refused += found is None
        if found is not None:
            shares += found[0]
            narrow += found[1]
    assert refused < 2
    assert max(shares) <= 1
    assert np.mean(np.array(shares) > 0.98) > 0.2, "batteries are used"
    assert not narrow


def test_a_fixed_wing_sees_all_beside_no_go_zones_and_crosses_none(tmp_path):
    """Rows end at zones nearer than any turn: there what they would see is passed in other
    directions.
    """
    zones = [shapely.box(120, 90, 200, 150), shapely.box(-260, -60, -180, 200)]
    frame = LocalFrame(8.5, 47.4)
    shapes = [
        shapely.transform(shape, frame.to_degrees)
        for shape in (shapely.box(-400, -200, 400, 200), *zones)
    ]
    features = [
        {
            "type": "Feature",
            "properties": {"no_go": number > 0},
            "geometry": json.loads(shapely.to_geojson(shape)),
        }
        for number, shape in enumerate(shapes)
    ]
    (tmp_path / "zones.json").write_text(
        json.dumps({"type": "FeatureCollection", "features": features})
    )
    region = open_region(tmp_path / "zones.json")
    plan = plan_search(
        SearchProblem(region, robots=1, footprint=40.0, vehicle="fixed-wing,turn_radius=30"), seed=1
    )
    missions = missions_of_plan(plan, blocked=region.no_go)
    write_missions(missions, tmp_path / "m", formats=["plan"])
    result = check_missions(tmp_path / "m", region, 40.0)
    assert not result.errors
    assert result.coverage.covered_fraction > 0.99999
    assert len(missions) == 1
    assert not narrow_turns(way_of_plan(tmp_path / "m" / "robot-01.plan"), 30.0)


def test_a_path_of_curves_ends_at_home_even_if_home_is_almost_at_the_last_viewpoint():
    """A last leg of less than 5 cm is no leg, but a path that ends before home would turn back by
    180 degrees there.
    """
    way = np.array([(0.0, 0.0), (0.0, 400.0), (40.0, 400.0), (40.0, 0.0), (40.0, 0.8 * NEAR)])
    (flown,) = plan_dubins_path(way, 30.0, link=20.0)
    assert flown[0].tolist() == way[0].tolist()
    assert flown[-1].tolist() == way[-1].tolist()


def between_zones(folder, *boxes):
    """Return the problem of a fixed wing in a field of 360 m x 280 m with no-go zones (west, south,
    east, north) in metres.
    """
    frame = LocalFrame(8.5, 47.4)
    shapes = [
        shapely.transform(shapely.box(*box), frame.to_degrees) for box in ((0, 0, 360, 280), *boxes)
    ]
    features = [
        {
            "type": "Feature",
            "properties": {"no_go": number > 0},
            "geometry": json.loads(shapely.to_geojson(shape)),
        }
        for number, shape in enumerate(shapes)
    ]
    (folder / "zones.json").write_text(
        json.dumps({"type": "FeatureCollection", "features": features})
    )
    return SearchProblem(
        str(folder / "zones.json"),
        robots=1,
        footprint=40.0,
        vehicle="fixed-wing,turn_radius=30,cruise_speed=15",
        angle=0.0,
        tour="boustrophedon",
        allocation="stay",
    )


@pytest.fixture
def told(monkeypatch):
    """The notices of one test."""
    texts = []
    monkeypatch.setattr(notices, "listeners", [texts.append])
    monkeypatch.setattr(notices, "_told", set())
    return texts


@pytest.mark.parametrize(
    "boxes",
    [
        ((118, 88, 189, 123), (192, 157, 231, 190)),
        ((198, 184, 267, 225), (126, 180, 156, 251)),
        ((88, 120, 148, 151), (93, 189, 127, 225)),
    ],
)
def test_a_fixed_wing_flies_out_of_a_gap_between_zones_before_it_turns(boxes, tmp_path, told):
    problem = between_zones(tmp_path, *boxes)
    plan = plan_search(problem)
    region = plan.grid.region
    assert not plan.refusal
    assert region.margin == problem.place.margin > 8
    missions = missions_of_plan(plan, blocked=grow(region.no_go, region.margin))
    write_missions(missions, tmp_path / "m", formats=["plan"])
    way = region.frame.to_metres(np.asarray(missions[0].waypoints))
    assert shapely.distance(region.no_go, shapely.linestrings(way)) > region.margin - 0.02
    assert not narrow_turns(way_of_plan(tmp_path / "m" / "robot-01.plan"), 30.0)
    assert not [text for text in told if not text.startswith("footprint: the region is")]


def test_plans_without_missions_take_a_narrower_margin_too_and_say_so(tmp_path, told):
    problem = between_zones(tmp_path, (251, 86, 311, 155), (218, 186, 291, 262))
    plan = plan_search(problem)
    assert not plan.refusal
    assert 0 < plan.grid.region.margin < problem.place.margin
    assert [
        text
        for text in told
        if text.startswith("margin: 4 m in place of 8.01 m") and "no room for its turns" in text
    ]


def test_a_plan_that_no_vehicle_can_fly_is_never_silent(tmp_path, told):
    plan = plan_search(
        between_zones(tmp_path, (243, 98, 308, 171), (201, 128, 269, 194)).replaced(margin=8.0)
    )
    assert isinstance(plan.refusal, NoRoomError)
    assert str(plan.refusal).startswith("turn_radius: expected room")
    assert [text for text in told if "cannot fly its path: turn_radius" in text]


def test_a_plan_that_cannot_be_flown_is_not_the_fastest(monkeypatch):
    """It has no time of its own: the estimate in its place leaves out curves and climbs, so it
    would often win.
    """
    flights = SearchPlan.flown_sorties

    def refused(plan, robot, stops, detours):
        if plan.allocation.allocator != "hop":
            raise InvalidInputError("turn_radius: expected room for turns, got none")
        return flights(plan, robot, stops, detours)

    monkeypatch.setattr(SearchPlan, "flown_sorties", refused)
    problem = SearchProblem(
        "rectangle:300x200", robots=2, footprint=50.0, vehicle="multirotor", tour="boustrophedon"
    )
    plan = plan_search(problem, seed=3)
    assert plan.allocation.allocator == "hop"
    assert not plan.refusal


def test_many_curves_at_once_are_those_of_the_curves_one_by_one():
    rng = np.random.default_rng(4)
    starts, ends = (
        np.column_stack([rng.uniform(-200, 200, (60, 2)), rng.uniform(-9, 9, 60)]) for _ in range(2)
    )
    parts = dubins_parts(starts, ends, 40.0)
    pairs, words = np.nonzero(np.isfinite(parts).all(axis=-1))
    points, numbers = dubins_paths(starts[pairs], words, parts[pairs, words], 40.0)
    for number, (pair, word) in enumerate(zip(pairs.tolist(), words.tolist(), strict=True)):
        alone = dubins_path(starts[pair], WORDS[word], parts[pair, word], 40.0)
        np.testing.assert_allclose(points[numbers == number], alone, atol=1e-8)
