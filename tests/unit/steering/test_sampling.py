"""Planning by sampling: regions with obstacles, and more than two particles."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.soak import often
from tests.steering import steer

from shoal.core.errors import InvalidInputError
from shoal.steering import (
    ContactWorld,
    SteeringProblem,
    SteeringTask,
    disk,
    polygon,
    prism,
    region,
    regular_polygon,
)
from shoal.steering.contact.world import RegionWorld
from shoal.steering.planners import annealing, sampling
from shoal.steering.planners.sampling import Sampling
from shoal.steering.planners.sampling import _are_visible as sees

SQUARE = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])
YARD = region([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1.5, 1.5), (2.5, 1.5), (2.5, 2.5), (1.5, 2.5)]])
CORNER = region([(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)])
TURNS = np.arange(60) * np.pi / 30
STAR = region(
    np.stack([np.cos(TURNS), np.sin(TURNS)], axis=1)
    * np.where(np.arange(60) % 2, 0.6, 1.0)[:, None]
)
POSTS = region(
    [(0, 0), (6, 0), (6, 4), (0, 4)],
    [[(1, 1), (2, 0.8), (2.2, 2.5)], [(3.5, 1.5), (5, 1.2), (4.6, 2.9), (3.8, 3)]],
)


@pytest.fixture
def few_trees(monkeypatch):
    """Plans that only have to arrive are made short for a moment only."""
    monkeypatch.setattr(sampling, "MORE_TREES", 2)
    monkeypatch.setattr(annealing, "STAGES", ((1, 1000),))


quick = pytest.mark.usefixtures("few_trees")


def planned(world, start, goal, tolerance=1e-6, *, max_moves=100, seed=0):
    """The moves, replayed by the stepper alone."""
    task = SteeringTask(
        world, np.array(start, dtype=float), np.array(goal, dtype=float), tolerance, max_moves, seed
    )
    moves = Sampling().plan(task)
    assert moves is not None
    assert len(moves) <= max_moves
    state = world.initial(start)
    for move in moves:
        state = world.step(state, move)
    assert np.linalg.norm(state - task.goal, axis=1).max() <= tolerance
    return moves


@quick
@pytest.mark.parametrize(
    ("room", "start", "goal"),
    [
        (YARD, [(0.5, 0.5), (0.7, 0.5)], [(3.5, 3.5), (3.5, 3.7)]),
        (YARD, [(1.2, 2.0), (2.8, 2.0)], [(2.8, 2.0), (1.2, 2.0)]),
        (YARD, [(1.5, 1.5), (2.5, 2.5)], [(2.5, 2.5), (1.5, 1.5)]),
        (CORNER, [(2.5, 0.3), (2.7, 0.8)], [(0.3, 2.5), (0.9, 2.6)]),
        (CORNER, [(0.0, 0.0), (3.0, 0.0)], [(0.2, 2.9), (0.4, 0.1)]),
        (POSTS, [(0.5, 0.5), (2.8, 2.0)], [(5.5, 2.0), (0.5, 3.5)]),
    ],
)
def test_two_particles_around_obstacles(room, start, goal):
    planned(RegionWorld(room), start, goal)


@pytest.mark.parametrize(
    ("room", "points", "best_known"),
    [
        # were 8.1 to 10.7 long
        (YARD, [(0.01, 3.89), (1.19, 1.26), (3.57, 2.34), (1.89, 3.09)], 5.83),
        # 6.9: one wall after the other holds
        (POSTS, [(0.142, 1.191), (1.69, 2.687), (2.924, 0.372), (0.077, 2.417)], 5.425),
        (YARD, [(1.19, 2.97), (2.89, 0.87), (3.32, 2.63), (2.73, 3.28)], 5.42),  # 9.6
        (POSTS, [(2.652, 1.23), (4.217, 0.943), (5.461, 0.828), (2.122, 2.578)], 6.208),  # 9.1
    ][: often(2, 4)],
)
def test_plans_around_obstacles_come_near_to_the_best_known(room, points, best_known):
    """Best known: the shortest of searches ten times as long."""
    moves = planned(RegionWorld(room), points[:2], points[2:], 1e-6 * room.size)
    assert np.linalg.norm(moves, axis=1).sum() < 1.05 * best_known


def test_a_mere_translation_goes_around():
    """Particles that are right but for a translation take a way on which none meets a wall."""
    moves = planned(RegionWorld(YARD), [(0.5, 0.5), (0.5, 0.7)], [(3.2, 3.2), (3.2, 3.4)])
    assert len(moves) == 2
    assert np.linalg.norm(moves, axis=1).sum() < 1.1 * np.hypot(2.7, 2.7)


@quick
@pytest.mark.parametrize("room", [SQUARE, disk(), regular_polygon(5)])
def test_two_particles_in_convex_workspaces(room):
    start, goal = [
        np.array(pair) * 0.4 + room.center
        for pair in ([(0.1, 0.2), (0.5, 0.4)], [(-0.3, 0.1), (0.4, -0.5)])
    ]
    planned(ContactWorld(room), start, goal)


@quick
@pytest.mark.parametrize("tolerance", [1e-2, 1e-6])
def test_three_particles(tolerance):
    start, goal = [(0.2, 0.3), (0.7, 0.4), (0.5, 0.8)], [(0.6, 0.2), (0.3, 0.5), (0.9, 0.7)]
    planned(ContactWorld(SQUARE), start, goal, tolerance)
    planned(RegionWorld(YARD), np.array(start) * 1.4, np.array(goal) * 1.4, tolerance)


@quick
def test_four_particles():
    start = [(0.2, 0.3), (0.7, 0.4), (0.5, 0.8), (0.1, 0.9)]
    goal = [(0.6, 0.2), (0.3, 0.5), (0.9, 0.7), (0.4, 0.1)]
    planned(ContactWorld(SQUARE), start, goal, 1e-2)


@quick
def test_friction_and_goals_on_walls():
    planned(ContactWorld(SQUARE, friction=0.5), [(0.2, 0.2), (0.6, 0.3)], [(0.4, 0.4), (0.7, 0.45)])
    planned(ContactWorld(SQUARE), [(0.0, 0.2), (1.0, 0.3)], [(1.0, 1.0), (0.0, 0.0)])


@quick
def test_few_moves_are_enough_or_nothing_is_found():
    world, pairs = ContactWorld(SQUARE), ([(0.2, 0.5), (0.4, 0.5)], [(0.3, 0.5), (0.4, 0.5)])
    assert len(planned(world, *pairs, max_moves=3)) <= 3
    assert (
        Sampling().plan(SteeringTask(world, *(np.array(pair) for pair in pairs), 1e-6, 1)) is None
    )


@quick
def test_seeds():
    world, pairs = RegionWorld(YARD), ([(0.5, 0.5), (0.7, 0.5)], [(3.5, 3.5), (3.5, 3.7)])
    first, again, other = (planned(world, *pairs, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


@quick
def test_size_changes_nothing():
    world = [
        RegionWorld(region(scale * YARD.outline, [scale * YARD.obstacles[0]]))
        for scale in (1.0, 1024.0)
    ]
    start, goal = np.array([(1.2, 2.0), (2.8, 2.0)]), np.array([(2.8, 2.0), (1.2, 2.0)])
    small = planned(world[0], start, goal)
    np.testing.assert_allclose(
        planned(world[1], 1024 * start, 1024 * goal, 1024e-6), 1024 * small, rtol=1e-9
    )


def test_edges_that_are_left_out_would_not_have_been_met():
    """As if each particle had a look at every edge, where it only does at those in boxes that it
    comes near.
    """
    chance = np.random.default_rng(3)
    for room in (YARD, CORNER, POSTS, STAR):
        world, other = RegionWorld(room), RegionWorld(room)
        everywhere = np.tile([-np.inf, np.inf, -np.inf, np.inf], (1, 1))
        other.__dict__["edges"] = world.edges._replace(boxes=everywhere)
        center = np.mean([room.outline.min(axis=0), room.outline.max(axis=0)], axis=0)
        spots = chance.uniform(-0.5, 0.5, (400, 2)) * room.size + center
        state = np.concatenate([spots[room.contains(spots)], *room.rings])
        once = state.copy()
        for move in chance.normal(size=(40, 2)) * room.size * chance.random((40, 1)) ** 3:
            np.testing.assert_array_equal(world.advance(state, move), other.advance(once, move))


def test_many_corners_are_looked_from_as_they_are_needed(monkeypatch):
    """Not from each to each: 600 corners took 78 CPU seconds, most of them before the clock was
    looked at.
    """
    asked = []
    monkeypatch.setattr(
        sampling, "_are_visible", lambda *given: asked.append(given) or sees(*given)
    )
    start, goal = np.array([(-0.5, 0.3), (-0.5, 0.1)]), np.array([(0.5, 0.1), (0.5, -0.1)])
    task = SteeringTask(RegionWorld(STAR), start, goal, 1e-6)
    way = next(sampling.Translations(task).around(start[0] - goal[0]))
    assert 1.0 < np.linalg.norm(way, axis=1).sum() < 1.03
    assert len(asked) < 5
    late = replace(task, deadline=0.0)
    assert Sampling().plan(late) is None
    assert not [*sampling.Translations(late).around(start[0] - goal[0])]
    assert len(asked) < 5


def test_what_cannot_be(monkeypatch):
    """Particles at one point stay together, and goals in parts that no way joins are
    not reached.
    """
    monkeypatch.setattr(sampling, "TREES", 1)
    monkeypatch.setattr(sampling, "ROUNDS", 10_000)
    apart = region([(0, 0), (9, 0), (9, 1), (5, 1), (4.5, 1e-3), (4, 1), (0, 1)])
    task = SteeringTask(
        RegionWorld(CORNER),
        np.array([(0.5, 0.5), (0.5, 0.5)]),
        np.array([(0.5, 0.5), (0.6, 0.5)]),
        1e-6,
        100,
        0,
    )
    assert Sampling().plan(task) is None
    few = SteeringTask(
        RegionWorld(apart),
        np.array([(0.5, 0.5), (0.7, 0.5)]),
        np.array([(8.5, 0.5), (0.3, 0.2)]),
        1e-6,
        2,
        0,
    )
    assert Sampling().plan(few) is None
    space = prism(SQUARE, 1.0)
    high = np.array([(0.2, 0.2, 0.2), (0.4, 0.4, 0.4)])
    with pytest.raises(
        InvalidInputError, match="planner sampling: expected a plane workspace, got a prism"
    ):
        Sampling().plan(SteeringTask(ContactWorld(space), high, high[::-1], 1e-6))


@quick
def test_steer_with_it():
    problem = SteeringProblem(
        YARD, [(0.5, 0.5), (0.7, 0.5)], [(3.5, 3.7), (3.5, 3.5)], interchangeable=True
    )
    episode = steer(problem, planner="sampling")
    assert episode
    assert episode.planner == "sampling"
    assert steer(problem).planner == "sampling"
    with pytest.raises(InvalidInputError, match="expected no gain"):
        steer(problem, planner="sampling", gain=0.5)
    with pytest.raises(
        InvalidInputError, match="planner greedy: expected a convex workspace, got a region"
    ):
        steer(problem, planner="greedy")


@pytest.mark.parametrize(
    ("start", "goal", "known", "before"),
    [
        ([(3.7722, 2.0453), (3.905, 0.3233)], [(3.2076, 0.6981), (3.4865, 2.1758)], 5.621, 8.25),
        ([(3.6089, 1.9086), (1.722, 3.1558)], [(3.9366, 1.4789), (3.8757, 3.7161)], 2.703, 5.299),
    ],
)
def test_plans_around_obstacles_are_made_short(start, goal, known, before):
    """The best known of 60 trees and 100,000 changes, and what the first plans were."""
    episode = steer(SteeringProblem(YARD, start, goal))
    assert episode.planner == "sampling"
    assert episode.length <= 1.05 * known < before
    assert episode.verify()
