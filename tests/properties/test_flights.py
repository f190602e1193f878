"""What mission files make vehicles do, judged from the files alone: time, turns, height above ground."""

from __future__ import annotations

import json

import numpy as np
import shapely
from tests.properties.flights import judged, missions_of_plan
from tests.reference.flight import narrow_turns, way_of_plan

from shoal.search import LocalFrame, open_region
from shoal.search.allocation.plan import plan_search
from shoal.search.flight.turning import NEAR, turned_way
from shoal.search.missions import check_missions, write_missions
from shoal.search.problem import SearchProblem

TURNED = 773  # a plan in whose file rounding turns a leg of 1.4 m by .04 degrees, so that a bend of 1 degree becomes a turn


def test_no_mission_is_longer_than_its_battery_and_no_turn_narrower_than_its_radius(tmp_path):
    """A thousand: python -m benchmarks.endurance."""
    shares, narrow, refused = [], [], 0
    for seed in (*range(7), TURNED):
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
    """Rows end at zones nearer than any turn: there what they would see is passed in other directions."""
    zones = [shapely.box(120, 90, 200, 150), shapely.box(-260, -60, -180, 200)]
    frame = LocalFrame(8.5, 47.4)
    shapes = [shapely.transform(shape, frame.to_degrees) for shape in (shapely.box(-400, -200, 400, 200), *zones)]
    features = [
        {"type": "Feature", "properties": {"no_go": number > 0}, "geometry": json.loads(shapely.to_geojson(shape))}
        for number, shape in enumerate(shapes)
    ]
    (tmp_path / "zones.json").write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    region = open_region(tmp_path / "zones.json")
    plan = plan_search(SearchProblem(region, robots=1, footprint=40.0, vehicle="fixed-wing,turn_radius=30"), seed=1)
    missions = missions_of_plan(plan, blocked=region.no_go)
    write_missions(missions, tmp_path / "m", formats=["plan"])
    result = check_missions(tmp_path / "m", region, 40.0)
    assert not result.errors
    assert result.coverage.covered_fraction > 0.99999
    assert len(missions) == 1
    assert not narrow_turns(way_of_plan(tmp_path / "m" / "robot-01.plan"), 30.0)


def test_a_path_of_curves_ends_at_home_even_if_home_is_almost_at_the_last_viewpoint():
    """A last leg of less than 5 cm is no leg, but a path that ends before home would turn back by 180 degrees there."""
    way = np.array([(0.0, 0.0), (0.0, 400.0), (40.0, 400.0), (40.0, 0.0), (40.0, 0.8 * NEAR)])
    (flown,) = turned_way(way, 30.0, link=20.0)
    assert flown[0].tolist() == way[0].tolist()
    assert flown[-1].tolist() == way[-1].tolist()
