"""When vehicles look: the times of first looks beside those of their flights, sample by sample."""

import numpy as np
import pytest

from shoal.missions import MissionSet
from shoal.search import SearchProblem
from shoal.search.cells.layers import layers_of
from shoal.search.flight.timing import trajectory
from shoal.search.planning import sightings
from shoal.search.planning.plan import plan_search
from shoal.search.planning.sightings import first_seen, sightings_of, success_of
from shoal.search.problem.target import Ground
from shoal.search.run import run

FIELD = {
    "region": "rectangle:160x100",
    "robots": 2,
    "footprint": 20,
    "prior": ["ring:120,80:0.5=20,0.9=60"],
    "launch": ((-5.0, -5.0),),
}


@pytest.mark.parametrize(
    "vehicle", ["multirotor", "multirotor,endurance=100,recharge=30", "fixed-wing"]
)
def test_first_looks_are_those_of_the_flown_missions(vehicle):
    missions = MissionSet.from_problem(SearchProblem(**FIELD, vehicle=vehicle), seed=1)
    episode, plan = missions.run(), missions.plan
    cells = plan.positions(np.arange(len(plan.tour)))
    first = np.full(len(cells), np.inf)
    for mission in missions.missions:
        way = mission.path_in(None)
        flown = trajectory(way, plan.vehicle, rate=mission.rates(plan.vehicle))
        ends = mission.waypoints[mission.searched][[0, -1]]
        moments = np.arange(0.0, flown.duration, 0.1)
        track = flown.at(moments)[:, :2]
        begin, end = (
            np.flatnonzero(np.hypot(*(track - place).T) < 2.0)[which]
            for place, which in zip(ends, (0, -1), strict=True)
        )
        for moment, place in zip(moments[begin:end], track[begin:end], strict=True):
            seen = (np.abs(cells - place) <= 10.0).all(axis=1)
            first[seen] = np.minimum(first[seen], mission.start + moment)
    # those on the border of a footprint's way may be seen by one of both alone
    off = episode.visits.times - first
    assert np.quantile(np.abs(off), 0.9) < 1.5
    odds = plan.tour_cost.odds
    assert odds @ episode.visits.times == pytest.approx(odds @ first, rel=0.03)
    assert episode.expected_find == pytest.approx(odds @ first, rel=0.1)


def test_a_vehicle_sees_while_it_searches_and_not_on_its_way_out():
    plan = plan_search(SearchProblem(**FIELD | {"robots": 1}, vehicle="multirotor"), seed=1)
    own = sightings_of(plan, 0, plan.stops(0))
    assert (np.diff(own.times) > 0).all()
    assert own.moments[0] > plan.vehicle.height / plan.vehicle.climb_speed
    robots, times = first_seen(plan, [own], 20.0)
    assert (robots == 0).all()
    assert (times[plan.stops(0), 0] <= own.times + 1e-9).all()
    assert np.isinf(first_seen(plan, [sightings_of(plan, 0, [])], 20.0)[1]).all()


@pytest.mark.parametrize("fields", [{"passes": 2}, {"detection": 0.7, "at_most": 1.4}])
def test_the_first_of_several_looks_counts_from_when_the_footprint_reaches_a_place(fields):
    problem = SearchProblem(**FIELD, vehicle="multirotor", angle=20, **fields)
    episode = run(problem, seed=1)
    plan, prior = episode.plan, problem.open_prior()
    assert len(layers_of(plan.grid)) > 1
    axis = np.arange(1.0, 160, 2)
    places = np.stack(np.meshgrid(axis, axis[:50]), axis=-1).reshape(-1, 2)
    weights = sum(weight * part.density(places, 2.0) for weight, part in prior.parts)
    turn = np.radians(20)
    axes = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    first = np.full(len(places), np.inf)
    for own in episode.sightings:
        for moment, at in zip(own.moments, own.track, strict=True):
            seen = (np.abs((places - at) @ axes) <= 10).all(axis=1)
            first[seen] = np.minimum(first[seen], moment)
    if episode.problem.detection == 1:
        stated = episode.expected_find
    else:  # of the first look alone
        sure = success_of(
            plan, episode.sightings, episode.visible_cells, view=20.0, detection=1.0, limit=1e4
        )
        stated = sure.mean
    assert np.isfinite(first[weights > 0]).mean() > 0.999
    known = np.isfinite(first)
    flown = weights[known] @ first[known] / weights[known].sum()
    assert stated == pytest.approx(flown, rel=0.015)


@pytest.mark.parametrize("detection", [1.0, 1e-9, 1e-17, 1e-300])
def test_tiny_detections_have_a_finite_time(detection):
    """After k looks in vain, of which each finds the target with the tiny probability d, the search
    begins anew: the mean time is about the period over k d.
    """
    ground = Ground(np.array([0.25, 0.75]), np.array([[0], [1]]))
    looks = ground.looks(np.array([0, 1, 1]), np.array([1.0, 2.0, 3.0]))
    with np.errstate(all="raise", under="ignore"):
        mean = ground.expected_time(looks, detection, 10.0)
    many = 0.25 * 10 / detection + 0.75 * 10 / (2 * detection)
    assert mean == pytest.approx(1.75 if detection == 1 else many)


def test_a_probability_of_success_is_at_most_1():
    plan = plan_search(SearchProblem(**FIELD, angle=17), seed=1)
    looks = [sightings_of(plan, robot, plan.stops(robot)) for robot in range(2)]
    seen = [plan.visible_cells(robot, plan.stops(robot)) for robot in range(2)]
    success = success_of(plan, looks, seen, view=20.0, detection=1.0, limit=1e4)
    assert success.probability == pytest.approx(1)
    assert success.probabilities.max() <= 1


def test_long_tracks_are_followed_stop_by_stop(monkeypatch):
    problem = SearchProblem(**FIELD, vehicle="multirotor,endurance=100,recharge=30")
    plan = plan_search(problem, seed=1)
    stops = plan.stops(0)
    together = sightings_of(plan, 0, stops).times
    monkeypatch.setattr(sightings, "_TOGETHER", 0)
    np.testing.assert_allclose(sightings_of(plan, 0, stops).times, together, atol=2.0)
