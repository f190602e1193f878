"""Launch and landing points anywhere: how they are read, and transits that keep out of
no-go zones.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
import shapely

from shoal.core.errors import InvalidInputError
from shoal.missions import MissionOptions, MissionSet
from shoal.missions.deconfliction import plan_missions
from shoal.search import SearchEpisode, open_region
from shoal.search.cells.routing import Transits
from shoal.search.problem import SearchProblem
from shoal.search.regions.margin import with_margin
from shoal.search.regions.places import places_of
from shoal.search.regions.region import region_of
from shoal.search.run import run
from shoal.views.search.history import SearchHistory

FIELD = shapely.box(0, 0, 200, 100)
ZONES = shapely.MultiPolygon([shapely.box(-60, -20, -20, 120), shapely.box(80, 40, 110, 60)])


@pytest.mark.parametrize("margin", [0.0, 7.0])
def test_transits_lead_round_no_go_zones_outside_and_inside(margin):
    region = with_margin(region_of(FIELD, no_go=ZONES), margin)
    transits = Transits(region, [(-100, 50)])
    for end in ((20.0, 50.0), (190.0, 50.0), (73.0, 50.0)):
        way = transits.path((-100.0, 50.0), end)
        assert shapely.distance(shapely.linestrings(way), ZONES) >= margin * (1 - 1e-3)
        assert len(way) < 8  # few bends, not an arc of many
        shortest = np.hypot(120, 70 + margin)  # not even that short
        assert np.hypot(*np.diff(way, axis=0).T).sum() > min(shortest, 140)
    with pytest.raises(InvalidInputError, match="launch: expected places outside of no-go zones"):
        Transits(region, [(-40, 50)])
    with pytest.raises(InvalidInputError, match=r"^land: expected places outside of no-go zones"):
        Transits(region, [(-100, 50)], [(-40, 50)])


def test_a_launch_point_in_a_hole_may_leave_it_and_others_go_round_it():
    ring = open_region("ring:100x60")
    assert len(Transits(ring, [(0, 0)]).path((0, 0), (80, 0))) == 2
    round_it = Transits(ring, [(-120, 0)]).path((-120, 0), (80, 0))
    assert shapely.distance(shapely.linestrings(round_it), shapely.Point(0, 0)) > 59


def test_places_are_one_for_all_one_each_or_along_a_line(tmp_path):
    square = open_region("square:20")
    assert places_of("5,-5", square, 3, what="launch").tolist() == [[5, -5]] * 3
    assert places_of([(0, 1), (2, 3)], square, 2, what="launch").tolist() == [[0, 1], [2, 3]]
    (tmp_path / "points.csv").write_text("x,y\n0,-5\n10,-5\n")
    assert places_of(str(tmp_path / "points.csv"), square, 2, what="launch").tolist() == [
        [0, -5],
        [10, -5],
    ]
    (tmp_path / "points.csv").write_text("robot,x,y\n2,10,-5\n1,0,-5\n")
    assert places_of(str(tmp_path / "points.csv"), square, 2, what="launch").tolist() == [
        [0, -5],
        [10, -5],
    ]
    (tmp_path / "points.csv").write_text("robot,x,y\n2,10,-5\n2,0,-5\n")
    with pytest.raises(InvalidInputError, match=r"line 2: expected the numbers 1 to 2 .* got '2'"):
        places_of(str(tmp_path / "points.csv"), square, 2, what="launch")
    with pytest.raises(
        InvalidInputError, match="launch: expected one point for all, or 3, one per robot, got 2"
    ):
        places_of("1,2;3,4", square, 3, what="launch")
    (tmp_path / "road.geojson").write_text('{"type": "Point", "coordinates": [8.5, 47.4]}')
    with pytest.raises(
        InvalidInputError, match="expected metres, because the region 'square:20' has no position"
    ):
        places_of(str(tmp_path / "road.geojson"), square, 3, what="launch")


def test_robots_space_themselves_along_a_road(tmp_path):
    outline = [[8.5, 47.4], [8.504, 47.4], [8.504, 47.402], [8.5, 47.402], [8.5, 47.4]]
    (tmp_path / "field.json").write_text(json.dumps({"type": "Polygon", "coordinates": [outline]}))
    road = {
        "type": "Feature",
        "properties": {},
        "geometry": {"type": "LineString", "coordinates": [[8.499, 47.4], [8.499, 47.402]]},
    }
    (tmp_path / "road.geojson").write_text(json.dumps(road))
    region = open_region(tmp_path / "field.json")
    places = places_of(str(tmp_path / "road.geojson"), region, 4, what="launch")
    assert np.allclose(
        region.frame.to_degrees(places)[:, 1], 47.4 + 0.002 * np.array([1, 3, 5, 7]) / 8, atol=1e-6
    )
    (tmp_path / "road.geojson").write_text(
        json.dumps({"type": "Polygon", "coordinates": [outline]})
    )
    with pytest.raises(
        InvalidInputError,
        match=r"road\.geojson: expected a Point, MultiPoint or LineString, got 'Polygon'",
    ):
        places_of(str(tmp_path / "road.geojson"), region, 4, what="launch")
    assert len(places_of("8.499,47.401", region, 2, what="launch")) == 2
    with pytest.raises(InvalidInputError, match="if the two numbers are swapped"):
        places_of("47.401,8.502", region, 2, what="launch")


def test_a_search_from_outside_is_planned_verified_and_saved(tmp_path):
    region = region_of(FIELD, no_go=ZONES)
    problem = SearchProblem(
        region, robots=3, footprint=20, margin=4, launch="-100,50", land="-100,40;-100,50;-100,60"
    )
    episode = run(problem, seed=1)
    assert episode
    assert episode.coverage.outside_m == 0
    assert [route["landing"] for route in episode.report()["routes"]] == [
        [-100, 40],
        [-100, 50],
        [-100, 60],
    ]
    for route in episode.routes:
        assert route.points[0].tolist() == [-100, 50]
        assert shapely.distance(shapely.linestrings(route.points), ZONES) > 4 * (1 - 1e-3)
    episode.save(tmp_path / "episode.json")
    again = SearchEpisode.load(tmp_path / "episode.json")
    assert again.verify()
    assert again.plan.landing.tolist() == episode.plan.landing.tolist()


def test_simulated_time_holds_the_way_out_and_the_delay():
    """A robot sees its first cell no sooner than it can have come there from its launch point, and
    so does the player.
    """
    near = SearchProblem(region_of(FIELD), robots=3, footprint=20, launch="-1,50", rates=(1, 1, 2))
    far = near.replaced(launch="-300,50")
    delayed = far.replaced(delays=(0, 100, 250))
    found = [run(problem, seed=1) for problem in (near, far, delayed)]
    assert found[1].makespan > found[0].makespan + 290 / 2
    for episode in found:
        assert episode.status.done
        for robot, (log, route, rate) in enumerate(
            zip(episode.trace.robots, episode.routes, (1, 1, 2), strict=True)
        ):
            first = (
                np.hypot(*np.diff(route.points[: route.stops[1] + 1], axis=0).T).sum()
                / episode.plan.grid.size
            )
            # listening, delay, way, the cell
            out = 1.0 + episode.plan.delays[robot] / episode.cell_time + (first + 1.0) / rate
            assert log.times[0] == pytest.approx(out, abs=1e-9)
            shown = SearchHistory(episode).trajectories[robot]
            assert not np.hypot(*(shown.at(out - (first + 1.0) / rate - 0.01) - shown.at(0.0)))
    planned = run(delayed.replaced(simulate=False), seed=1)
    simulated = [log.times[0] for log in found[2].trace.robots]
    np.testing.assert_allclose(
        [log.times[0] + 1.0 for log in planned.trace.robots], simulated, atol=1e-9
    )
    with pytest.raises(InvalidInputError, match="delays: expected 3 times, one per robot, got 2"):
        SearchProblem("square:20", robots=3, delays=(1, 2))


def test_sorties_from_outside_fly_there_and_back_and_faults_stay_mended():
    """Each sortie's way out and home counts; the search ends although a robot dies on the ground
    and another far away.
    """
    problem = SearchProblem(
        region_of(FIELD), robots=3, footprint=10, launch="-60,50", faults="crash:2@1,crash:3@40"
    )
    brief = run(problem, seed=1)
    tired = run(problem.replaced(vehicle="ideal,endurance=9,reserve=0,recharge=1"), seed=1)
    assert brief.status.done
    assert tired.status.done
    assert tired.makespan > brief.makespan + 2 * 60


def test_missions_kept_apart_by_delays_make_the_simulation_late(tmp_path):
    options = MissionOptions(format=("csv",))
    problem = SearchProblem(
        region_of(FIELD), robots=3, footprint=20, launch="-20,50", vehicle="multirotor"
    )
    missions = MissionSet.from_problem(problem, options, seed=1)
    episode = missions.run()
    delays = [mission.start for mission in missions.missions]
    assert max(delays) > 0
    assert episode.problem.delays == tuple(delays)
    ends = [
        mission.start
        for mission in plan_missions(episode.plan, separation=options.required_separation)
    ]
    assert ends == delays
    assert (
        min(
            log.times[0] * episode.cell_time - late
            for log, late in zip(episode.trace.robots, delays, strict=True)
        )
        > 0
    )
    episode.save(tmp_path / "search.json")
    assert SearchEpisode.load(tmp_path / "search.json").verify()
