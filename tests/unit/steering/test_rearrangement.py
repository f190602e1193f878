"""More than two particles: plans at two walls against an own simulation, and the law of clipped
distances against all that moves on a small line can do.
"""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from shoal.core.errors import InvalidInputError
from shoal.steering import ContactWorld, SteeringProblem, disk, polygon, regular_polygon
from shoal.steering.planners import sampling
from shoal.steering.planners.rearrangement import (
    is_reachable_without_friction,
    rearrange,
    room_to_rearrange,
)
from shoal.steering.run import run

SQUARE = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])


def pushed(points, moves):
    """Move particles in the unit square, each up to the first wall that it meets; a particle on a
    wall stays there unless the move leads off all walls that it touches.
    """
    points = np.array(points, dtype=float)
    for move in moves:
        for point in points:
            share = 1.0
            for axis, side in itertools.product((0, 1), (0, 1)):
                off = move[axis] * (1 - 2 * side)  # along the inward normal
                distance = abs(point[axis] - side)
                if distance < 1e-11 and off <= 1e-13:
                    share = 0.0
                elif off < 0:
                    share = min(share, distance / -off)
            point[:] = point + share * move
    return points


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8])
def test_any_positions_in_a_square_are_reached(count):
    rng = np.random.default_rng(count)
    for _ in range(5):
        start, goal = rng.uniform(0.01, 0.99, (2, count, 2))
        moves = rearrange(SQUARE, start, goal)
        assert pushed(start, moves) == pytest.approx(goal, abs=1e-9)


def test_small_groups_take_twelve_moves_a_particle():
    rng = np.random.default_rng(0)
    for count in (2, 3, 6):
        for _ in range(5):
            start, goal = rng.uniform(0.3, 0.7, (2, count, 2))
            moves = rearrange(SQUARE, start, goal)
            assert len(moves) <= 12 * count - 1
            assert pushed(start, moves) == pytest.approx(goal, abs=1e-9)


@pytest.mark.parametrize(
    "points",
    [
        [(0.1, 0.1), (0.9, 0.1), (0.1, 0.9), (0.9, 0.9)],  # no corner of the square is nearest
        [(0.1, 0.5), (0.3, 0.5), (0.6, 0.5), (0.9, 0.5)],
        [(0.5, 0.2), (0.5, 0.4), (0.5, 0.6), (0.2, 0.4), (0.8, 0.4)],
    ],
)
def test_particles_that_touch_walls_together_are_told_apart(points):
    start, goal = np.array(points), np.array(points)[::-1]
    assert pushed(start, rearrange(SQUARE, start, goal)) == pytest.approx(goal, abs=1e-9)
    turned = start[:, ::-1].copy()
    assert pushed(start, rearrange(SQUARE, start, turned)) == pytest.approx(turned, abs=1e-9)


@pytest.mark.parametrize("sides", [3, 5, 6])
def test_what_has_room_at_two_walls_is_reached(sides):
    """Also if the walls of the start are not those of the goal."""
    workspace, rng = regular_polygon(sides), np.random.default_rng(sides)
    low, high = workspace.bounds
    tried = with_room = 0
    while tried < 12:
        points = rng.uniform(low, high, (6, 2))
        if float(workspace.depth(points).min()) < 0.01:
            continue
        tried += 1
        start, goal = points[:3], points[3:]
        room = min(room_to_rearrange(workspace, start), room_to_rearrange(workspace, goal)) > 0
        with_room += room
        moves = rearrange(workspace, start, goal)
        found = ContactWorld(workspace).play(start, moves)[-1]
        assert found == pytest.approx(goal, abs=1e-9)
    assert 0 < with_room < tried or sides < 6


def test_each_corner_has_a_particle():
    """It takes the more moves the nearer to the corners, and is given up in the end."""
    triangle = polygon([(0, 0), (1, 0), (0, 1)])
    middle = triangle.vertices.mean(axis=0)
    start = middle + np.array([(0.1, 0), (0, 0.1), (-0.1, -0.05)])
    counts = []
    for near in (0.3, 0.1, 0.03):
        goal = middle + (1 - near) * (triangle.vertices - middle)
        moves = rearrange(triangle, start, goal)
        found = ContactWorld(triangle).play(start, moves)[-1]
        assert found == pytest.approx(goal, abs=1e-9)
        counts.append(len(moves))
    assert counts == sorted(counts)
    hexagon = regular_polygon(6)
    with pytest.raises(InvalidInputError, match="goal: expected particles that can be drawn"):
        rearrange(hexagon, 0.2 * hexagon.vertices, 0.99 * hexagon.vertices)


def test_the_planner_sampling_falls_back_on_it(monkeypatch):
    """Where its trees find nothing, as it happens with five particles."""
    monkeypatch.setattr(sampling, "_grow_trees", lambda *_, **__: ([], []))
    start = [(0.2, 0.3), (0.5, 0.8), (0.7, 0.2), (0.4, 0.5), (0.8, 0.6)]
    goal = [(0.6, 0.7), (0.3, 0.2), (0.2, 0.6), (0.7, 0.4), (0.5, 0.3)]
    episode = run(SteeringProblem(SQUARE, start, goal))
    assert (episode.status, bool(episode.verify())) == ("solved", True)
    assert pushed(start, episode.inputs) == pytest.approx(np.array(goal), abs=1e-6)
    for changed in ({"friction": 2.0}, {"particle_radius": 0.01}, {"max_moves": 20}):
        assert run(SteeringProblem(SQUARE, start, goal, **changed)).status == "limit"


def test_room():
    """In a triangle, both spreads and twice the room are one side."""
    triangle = polygon([(0, 0), (1, 0), (0, 1)])
    points = np.array([(0.1, 0.2), (0.4, 0.3)])
    assert room_to_rearrange(triangle, points) == pytest.approx((1 - 0.3 - 0.1) / 2)
    assert room_to_rearrange(SQUARE, points) == pytest.approx(1 - 0.3)
    assert room_to_rearrange(SQUARE, [(0.1, 0), (0.1, 1)]) == pytest.approx(0)


def test_without_friction_what_is_reached_is_clipped():
    """All ends of all moves on a line of six cells, for three particles, and no others."""
    cells = 6
    for start in ((0, 1, 3), (0, 2, 5), (1, 1, 4), (2, 0, 2)):
        seen, queue = {start}, [start]
        for state in queue:
            for step in (-1, 1):
                after = tuple(min(max(x + step, 0), cells - 1) for x in state)
                if after not in seen:
                    seen.add(after)
                    queue.append(after)
        for goal in itertools.product(range(cells), repeat=3):
            flat = [[(x, 0) for x in places] for places in (start, goal)]
            assert is_reachable_without_friction(*flat) == (goal in seen)


def test_without_friction_in_a_square():
    rng = np.random.default_rng(4)
    world, start = ContactWorld(SQUARE, friction=0.0), rng.uniform(size=(4, 2))
    for state in world.play(start, rng.normal(scale=0.3, size=(30, 2))):
        assert is_reachable_without_friction(start, state)
    assert not is_reachable_without_friction(start, start[::-1])
    assert not is_reachable_without_friction(start, 1.01 * start)


@pytest.mark.parametrize(
    ("workspace", "start", "goal", "wanted"),
    [
        (disk(), [(0, 0)], [(0, 0.1)], "expected a convex polygon"),
        (SQUARE, [(0, 0.5)], [(0.5, 0.5)], "start: expected all particles inside"),
        (SQUARE, [(0.5, 0.5)] * 2, [(0.2, 0.5), (0.5, 0.5)], "start: expected pairwise different"),
        (SQUARE, [(0.2, 0.5), (0.5, 0.5)], [(0.5, 0.5)] * 2, "goal: expected pairwise different"),
        (SQUARE, [(0.5, 0.5)], [(0.2, 0.5), (0.5, 0.5)], "goal: expected 1 positions, got 2"),
    ],
)
def test_refusals(workspace, start, goal, wanted):
    with pytest.raises(InvalidInputError, match=wanted):
        rearrange(workspace, start, goal)
