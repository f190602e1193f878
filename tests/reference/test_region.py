"""RegionWorld against exact fractions, and against the world of convex workspaces."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from tests.reference import region as slow

from shoal.core.errors import InvalidInputError
from shoal.steering import ContactWorld, polygon, region
from shoal.steering.contact.world import RegionWorld

# Corners with few binary digits: where a move along an edge is to be exact, it is.
PLACES = {
    "yard": (
        [(0, 0), (8, 0), (8, 8), (0, 8)],
        [[(2, 2), (4, 2), (4, 4), (2, 4)], [(5, 5), (7, 4), (6, 7)]],
    ),
    "L": ([(0, 0), (8, 0), (8, 3), (3, 3), (3, 8), (0, 8)], []),
    "star": (
        [(0, 0), (4, 2), (8, 0), (6, 4), (8, 8), (4, 6), (0, 8), (2, 4)],
        [[(3, 4), (4, 3), (5, 4), (4, 5)]],
    ),
    "straight corners": (
        [(0, 0), (4, 0), (8, 0), (8, 8), (4, 4), (0, 8), (0, 4)],
        [[(3, 1), (5, 1), (5, 2), (4, 2), (3, 2)]],
    ),
    "touching": (
        [(0, 0), (8, 0), (8, 8), (0, 8)],
        [[(0, 4), (3, 3), (3, 5)], [(8, 8), (6, 5), (5, 6)]],
    ),
    "slit": (
        [(0, 0), (8, 0), (8, 8), (0, 8)],
        [[(1, 4), (7, Fraction(4) + Fraction(1, 1024)), (7, 4)]],
    ),
}


def world_of(outline, obstacles):
    return RegionWorld(
        region(np.array(outline, dtype=float), [np.array(ring, dtype=float) for ring in obstacles])
    )


def corners_of(rings):
    return [corner for ring in rings for corner in ring]


def free_point(world, rng):
    while True:
        point = rng.integers(0, 8 * 1024, 2) / 1024
        if world.workspace.depth(point) > 1e-3:
            return point


def draw_move(rings, points, rng):
    """A random move, or one along an edge, or one that takes a particle exactly into a corner, or
    through it.
    """
    kind = rng.integers(4)
    ring = rings[rng.integers(len(rings))]
    k = int(rng.integers(len(ring)))
    scale = Fraction(int(rng.choice([-8, -4, -1, 1, 2, 4, 8])), 4)
    if kind == 0:
        return slow.exact(rng.normal(scale=3, size=2))
    if kind == 1:
        way = slow.minus(ring[k], ring[k - 1])
        return way[0] * scale, way[1] * scale
    way = slow.minus(ring[k], points[rng.integers(len(points))])
    return (way[0] * abs(scale), way[1] * abs(scale)) if kind == 2 else way


@pytest.mark.parametrize("name", PLACES)
def test_as_exact_fractions_say(name):
    outline, obstacles = PLACES[name]
    world, rings = world_of(outline, obstacles), slow.rings_of(outline, obstacles)
    rng = np.random.default_rng(len(name))
    held = 0
    for _run in range(50):
        points = [slow.exact(free_point(world, rng)) for _ in range(2)] + [
            corners_of(rings)[rng.integers(len(corners_of(rings)))]
        ]
        state = np.array(points, dtype=float)
        for _move in range(6):
            move = draw_move(rings, points, rng)
            # a corner that a particle is in: rounding has no direction
            if max(abs(move[0]), abs(move[1])) < 1e-6:
                continue
            vector = np.array(move, dtype=float)
            held += int(world.are_held(state, vector).sum())
            points, state = slow.step(rings, points, move), world.step(state, vector)
            np.testing.assert_allclose(state, np.array(points, dtype=float), atol=2e-9 * 8, rtol=0)
            assert world.workspace.contains(state).all()
            # Fractions grow; those of points on slanted walls are cut off where exactness is not at
            # stake.
            if max(abs(x.denominator) for point in points for x in point) > 10**60:
                break
    assert held > 50


def test_random_outlines():
    rng = np.random.default_rng(5)
    for _run in range(60):
        angles = np.sort(rng.random(9)) * 2 * np.pi
        if np.diff(angles, append=angles[0] + 2 * np.pi).max() > np.pi / 2:
            continue
        outline = np.stack([np.cos(angles), np.sin(angles)], 1) * rng.uniform(1, 3, 9)[:, None]
        turn = rng.random() + np.arange(3) * 2
        hole = np.stack([np.cos(turn), np.sin(turn)], 1) * 0.4
        world, rings = world_of(outline, [hole]), slow.rings_of(outline.tolist(), [hole.tolist()])
        state = np.array([(0.41 * np.cos(turn[0]), 0.41 * np.sin(turn[0])), (0.5, 0.1), hole[1]])
        if not world.workspace.contains(state).all():
            continue
        for _move in range(5):
            points = [slow.exact(point) for point in state]
            vector = rng.normal(scale=1.5, size=2)
            wanted = np.array(slow.step(rings, points, slow.exact(vector)), dtype=float)
            # rounding has moved the others off slanted walls
            inside = world.workspace.depth(state) > 1e-8
            state = world.step(state, vector)
            np.testing.assert_allclose(state[inside], wanted[inside], atol=1e-8)
            assert world.workspace.contains(state).all()


@pytest.mark.parametrize(
    "corners",
    [[(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 0), (2, 0.1), (2.4, 1.1), (1, 2), (-0.3, 0.7)]],
)
def test_convex_ones_as_the_convex_world(corners):
    here, there = RegionWorld(region(corners)), ContactWorld(polygon(corners))
    rng = np.random.default_rng(1)
    edges = np.roll(corners, -1, axis=0) - np.array(corners)
    for _run in range(60):
        start = np.array([[0.3, 0.4], [0.6, 0.45]]) + rng.uniform(-0.1, 0.1, (2, 2))
        moves = np.where(
            rng.random((12, 1)) < 0.7,
            rng.normal(size=(12, 2)),
            edges[rng.integers(len(edges), size=12)],
        )
        np.testing.assert_allclose(here.play(start, moves), there.play(start, moves), atol=1e-8)
        last = here.play(start, moves)[-1]
        for move in moves:
            np.testing.assert_array_equal(here.are_held(last, move), there.are_held(last, move))


def test_no_way_through_thin_walls_and_corners():
    """Paths aimed at corners from everywhere, off by rounding, end on the side on which
    they began.
    """
    thin = [(2.0, 1.0), (2.0, 3.0), (2.0 + 1e-6, 3.0), (2.0 + 1e-6, 1.0)]
    world = world_of([(0, 0), (4, 0), (4, 4), (0, 4)], [thin])
    rng = np.random.default_rng(2)
    for _run in range(300):
        start = rng.uniform([0.1, 1.1], [1.9, 2.9], (2, 2))
        after = world.step(start, (4.0, rng.uniform(-0.05, 0.05)))
        near = (after[:, 1] > 1) & (after[:, 1] < 3)
        assert (after[near, 0] <= 2.0).all()
        corner = np.array([[0.0, 0.0], [4, 0], [4, 4], [0, 4]])[rng.integers(4)]
        stopped = world.step(start, (corner - start[0]) * 3)
        assert world.workspace.contains(stopped).all()


def test_reflex_corner_lets_go():
    world = world_of([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1, 1), (2, 1), (2, 2), (1, 2)]])
    corner = [(1.0, 1.0), (1.0, 1.0)]
    for move, moved in [
        ((1, -1), True),
        ((-1, 1), True),
        ((-1, 0), True),
        ((0, -1), True),
        ((1, 0), False),
        ((0, 1), False),
    ]:
        assert world.are_held(corner, move).all() != moved
        assert (world.step(corner, move)[0] != 1).any() == moved


def test_refusals():
    world = world_of([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1, 1), (2, 1), (2, 2), (1, 2)]])
    with pytest.raises(
        InvalidInputError,
        match=r"start: expected points inside the region, got \(1.5, 1.5\) at point 1",
    ):
        world.initial([(1.5, 1.5), (0, 0)])
    with pytest.raises(InvalidInputError, match="goal: expected points inside"):
        world.check_state([(0, 0), (5, 0)], what="goal")
    with pytest.raises(InvalidInputError, match="move: expected"):
        world.step([(0, 0), (1, 1)], (1, 2, 3))
    with pytest.raises(InvalidInputError, match="finite"):
        world.play([(0, 0), (1, 1)], [(1, np.nan)])
    assert world.play([(0, 0), (1, 1)], []).shape == (1, 2, 2)


def test_both_sides_of_a_wall_thinner_than_the_tolerance():
    world = world_of([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1, 2), (3, 2), (3, 2 + 1e-8)]])
    below, above = (1.5, 2.0), (1.5, 2 + 2.5e-9)
    for side, point in [(-1, below), (1, above)]:
        away, into = (
            world.step([point, point], (0.1, 0.5 * side)),
            world.step([point, point], (0.1, -0.5 * side)),
        )
        np.testing.assert_allclose(away[0], (1.6, 2 + 0.5 * side), atol=1e-8)
        np.testing.assert_array_equal(into[0], point)
