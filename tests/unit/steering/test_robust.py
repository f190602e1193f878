"""Steering in noise, around obstacles and in convex workspaces."""

from __future__ import annotations

import numpy as np
import pytest
from tests.steering import steer

from shoal.core.errors import InvalidInputError
from shoal.steering import SteeringProblem, disk, polygon, region
from shoal.steering.planners import annealing, robust, sampling

SQUARE = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])
ROOM = region(
    [(0, 0), (1, 0), (1, 0.9), (0, 0.9)],
    [[(0.65, 0.42), (0.62, 0.33), (0.45, 0.37), (0.45, 0.42), (0.55, 0.5)]],
)
PROBLEMS = [
    SteeringProblem(ROOM, [(0.32, 0.75), (0.1, 0.37)], [(0.3, 0.12), (0.8, 0.66)], 0.05),
    SteeringProblem(ROOM, [(0.2, 0.2), (0.3, 0.2)], [(0.85, 0.2), (0.8, 0.8)], 0.05),
]


@pytest.fixture(autouse=True)
def _few_changes(monkeypatch):
    """Plans that only have to arrive."""
    monkeypatch.setattr(robust, "CHANGES", 100)
    monkeypatch.setattr(robust, "SHORTENED", 1000)


def test_noise_around_obstacles_is_survived():
    """Of plans that are sent as they are, 2 of 8 arrived."""
    for noise in (
        {"execution": 0.005},
        {"execution": 0.03},
        {"execution": 0.01, "measurement": 0.01},
    ):
        for seed, problem in enumerate(PROBLEMS):
            episode = steer(problem, **noise, seed=seed)
            assert episode.planner == "robust"
            assert episode.status == "solved", (noise, episode.reason)
            assert episode.error <= problem.tolerance
            assert episode.verify()


def test_the_same_seed_makes_the_same_moves():
    first, again, other = (
        steer(PROBLEMS[1], execution=0.01, seed=seed).inputs for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert first.shape != other.shape or not np.array_equal(first, other)


def test_no_more_moves_than_allowed_and_time_is_kept():
    episode = steer(PROBLEMS[0], execution=0.05, max_moves=2, tolerance=0.01)
    assert (episode.moves, str(episode.status)) == (2, "limit")
    assert steer(PROBLEMS[1], execution=0.005, time=0.01).moves > 0


def test_a_tolerance_below_the_noise_is_named_as_the_cause():
    failed = steer(PROBLEMS[1], execution=0.005, max_moves=8, tolerance=1e-6)
    assert failed.reason.endswith(
        "tolerance of 1e-06; a tolerance of 0.05, ten times the noise, is easier to reach"
    )
    assert steer(PROBLEMS[1], execution=0.005, max_moves=8, tolerance=0.05)


@pytest.mark.parametrize("room", [SQUARE, disk(0.5, center=(0.5, 0.5))])
def test_strong_noise_in_convex_workspaces(room, monkeypatch):
    """With noise of 0.4 tolerances the loop of cycles arrived in 7 of 12 runs."""
    problem = SteeringProblem(room, [(0.3, 0.3), (0.6, 0.5)], [(0.7, 0.4), (0.4, 0.7)], 0.05)
    for noise in ({"execution": 0.02}, {"execution": 0.02, "measurement": 0.01}):
        assert steer(problem, **noise, seed=3, max_moves=60)


def test_without_noise_it_sends_a_plan_and_says_what_noise_it_stands(monkeypatch):
    monkeypatch.setattr(robust, "STOOD_RUNS", 1)
    monkeypatch.setattr(sampling, "MORE_TREES", 3)  # a plan, not the shortest
    monkeypatch.setattr(annealing, "STAGES", ((4, 500), (2, 2000)))
    episode = steer(PROBLEMS[1], planner="robust")
    assert episode.status == "solved"
    assert "execution noise" in episode.reason


def test_more_than_two_particles_are_left_to_sampling():
    three = SteeringProblem(
        ROOM,
        [(0.1, 0.1), (0.2, 0.1), (0.3, 0.1)],
        [(0.1, 0.2), (0.2, 0.2), (0.3, 0.2)],
        execution=0.01,
    )
    assert three.chosen_planner.name == "sampling"
    with pytest.raises(InvalidInputError, match="planner robust: expected 2 particles, got 3"):
        three.replaced(planner="robust")


def test_no_move_pushes_particles_that_walls_hold_already():
    """After the first move, both particles are at the inner wall: the loop pushed them against it
    three times more.
    """
    outline, hole = (
        [(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)],
        [(2, 0.3), (2.3, 0.3), (2.3, 0.6), (2, 0.6)],
    )
    start, goal = [(0.2, 2.8), (0.8, 2.4)], [(3.7, 0.2), (3.0, 0.5)]
    found = steer(
        SteeringProblem(region(outline, [hole]), start, goal, 0.1, execution=0.01), seed=1
    )
    assert found.status == "solved"
    assert (np.abs(np.diff(found.states, axis=0)).max(axis=(1, 2)) > 0.01).all()
