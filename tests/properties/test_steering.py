"""What holds for every workspace, move and plan of steering."""

from __future__ import annotations

import json

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.steering import steer

from shoal.steering import (
    ContactWorld,
    SteeringEpisode,
    SteeringProblem,
    disk,
    polygon,
    regular_polygon,
)

SPACES = st.sampled_from(
    [
        regular_polygon(3),
        regular_polygon(5),
        polygon([(0, 0), (3, 0), (3, 1), (0, 1)]),
        disk(0.7, center=(1, 2)),
    ]
)
UNIT = st.floats(0, 1, allow_nan=False)
NUMBER = st.floats(-3, 3, allow_nan=False)


def inside(space, across, up):
    """A point of the workspace from two numbers of the unit interval."""
    low = space.center - space.size
    point = low + 2 * space.size * np.array([across, up])
    away = point - space.center
    while not space.contains(point):
        away = away * 0.8
        point = space.center + away
    return point


@given(
    SPACES,
    st.lists(st.tuples(UNIT, UNIT), min_size=2, max_size=4),
    st.lists(st.tuples(NUMBER, NUMBER), max_size=8),
    st.sampled_from([0.0, 0.3, 2.0, np.inf]),
    UNIT,
)
def test_particles_stay_inside_and_held_ones_stay(space, places, moves, friction, slope):
    world = ContactWorld(space, friction=friction, gradient=(0.8 * slope / space.size, 0))
    state = np.array([inside(space, *place) for place in places])
    for move in moves:
        before = state.copy()
        held = world.are_held(state, move)
        state = world.step(state, move)
        assert space.contains(state).all()
        if friction == np.inf:
            assert (state[held] == before[held]).all()
        # No particle goes further than the field at its strongest takes it.
        assert (np.linalg.norm(state - before, axis=1) <= np.linalg.norm(move) * 2 + 1e-9).all()


@given(
    SPACES,
    st.lists(st.tuples(UNIT, UNIT), min_size=4, max_size=4),
    st.sampled_from(["greedy", "shortest"]),
)
def test_plans_end_where_they_say(space, places, planner):
    points = np.array([inside(space, *place) for place in places])
    if np.linalg.norm(points[0] - points[1]) < 1e-5 * space.size:
        return
    episode = steer(SteeringProblem(space, points[:2], points[2:]), planner=planner)
    assert episode.status in ("solved", "approachable", "limit")
    assert episode.verify()
    if episode:
        assert episode.error <= 1e-6
        assert episode.length >= episode.lower_bound
        again = SteeringProblem.from_dict(json.loads(json.dumps(episode.problem.to_dict())))
        assert again == episode.problem
        assert (again.start == episode.problem.start).all()
        assert again.place.size == space.size


@settings(max_examples=6)
@given(st.integers(0, 30), UNIT, UNIT)
def test_noise_depends_on_the_seed_alone(seed, execution, gain):
    problem = SteeringProblem(
        regular_polygon(6), [(-0.1, 0), (0.1, 0.1)], [(0.3, 0.1), (-0.2, -0.3)], 0.01
    )
    noise = {"execution": 0.01 * execution, "measurement": 1e-3, "gain": gain}
    first, second = (
        steer(problem, planner="robust", **noise, seed=seed, max_moves=3) for _ in range(2)
    )
    assert (first.inputs == second.inputs).all()
    assert (first.states == second.states).all()


def test_episodes_survive_the_disk(tmp_path):
    problem = SteeringProblem(
        regular_polygon(6), [(-0.1, 0), (0.1, 0.1)], [(0.3, 0.1), (-0.2, -0.3)], 0.01
    )
    episode = steer(problem, planner="robust", execution=1e-3, measurement=1e-3, gain=0.2, seed=4)
    episode.save(tmp_path / "episode.json")
    loaded = SteeringEpisode.load(tmp_path / "episode.json")
    assert loaded.verify()
    assert loaded.report() == episode.report()
