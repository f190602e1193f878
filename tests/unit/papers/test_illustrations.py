"""Figures 2, 3, 10 and 13 of paper W, each against an own small computation: a particle stops where
it meets a wall, and stays there while it is pushed into the wall.
"""

from __future__ import annotations

import numpy as np
import pytest

from shoal.papers.steering.illustrations import (
    CASES,
    FOUR,
    FRAMES,
    _moves,
    _translated_hull,
    _two_d,
)
from shoal.steering import SteeringProblem, cylinder, polygon, reached_in_two_moves
from shoal.steering.run import run

NEAR = 1e-8


def walls_of(vertices):
    """Return the inward normals and offsets of a polygon with corners counter-clockwise."""
    along = np.roll(vertices, -1, axis=0) - vertices
    normals = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    return normals, (normals * vertices).sum(axis=1)


def share_in_polygon(walls, point, move):
    normals, offsets = walls
    depths, rates = normals @ point - offsets, normals @ move
    if np.any((depths < NEAR) & (rates <= 1e-12)):
        return 0.0
    return min([1.0, *(d / -r for d, r in zip(depths, rates, strict=True) if r < -1e-15)])


def share_in_disk(radius, point, move):
    if np.hypot(*point) > radius - NEAR and point @ move >= -1e-12:
        return 0.0
    a, b, c = move @ move, 2 * point @ move, point @ point - radius**2
    return min(1.0, (-b + np.sqrt(max(b * b - 4 * a * c, 0.0))) / (2 * a)) if a else 1.0


def replayed(points, moves, share):
    points = np.array(points)
    for move in moves:
        points = np.array([point + share(point, move) * move for point in points])
    return points


def touches(delta, after, corners=None, radius=0.5):
    """Whether two moves change one difference into another, by a contact at one of many points of
    the boundary: the toucher is there, the other one is inside before and after, and the second
    move pushes into the wall.
    """
    if corners is None:
        angles = np.linspace(0, 2 * np.pi, 4001)
        contacts = radius * np.column_stack([np.cos(angles), np.sin(angles)])
        normals = -contacts / radius
    else:
        own, offsets = walls_of(corners)
        shares = np.linspace(0, 1, 1001)[:, None]
        pairs = zip(corners, np.roll(corners, -1, axis=0), strict=True)
        contacts = np.concatenate([a + shares * (b - a) for a, b in pairs])
        normals = np.repeat(own, 1001, axis=0)

    def inside(places):
        if corners is None:
            return np.hypot(*places.T) <= radius + 1e-9
        return np.all(places @ own.T >= offsets - 1e-9, axis=1)

    return any(
        np.any(
            inside(contacts + sign * delta)
            & inside(contacts + sign * after)
            & ((normals @ (sign * (after - delta))) <= 1e-9)
        )
        for sign in (1, -1)
    )


@pytest.mark.parametrize(("start", "goal"), CASES)
def test_plans_in_a_square_by_an_own_simulation(start, goal):
    episode = _two_d("square", start, goal)
    walls = walls_of(np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=float))
    ends = replayed(start, episode.inputs, lambda *at: share_in_polygon(walls, *at))
    assert ends == pytest.approx(np.array(goal), abs=2e-3)
    assert _moves(episode) <= 5
    assert episode.length == pytest.approx(np.hypot(*episode.inputs.T).sum())


def test_the_space_of_differences_by_its_area_and_by_differences():
    """Of a triangle it has 6 times the area, of a parallelogram 4 times."""

    def area(corners):
        x, y = corners.T
        return abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))) / 2

    for corners, times in (
        ([(0, 0), (1, 0.2), (0.3, 0.9)], 6),
        ([(0, 0), (1, 0.2), (1.3, 0.9), (0.3, 0.7)], 4),
    ):
        vertices = polygon(corners).vertices
        assert area(_translated_hull(vertices)) == pytest.approx(times * area(vertices))
    outline = _translated_hull(FOUR.vertices)[::-1]  # counter-clockwise
    normals, offsets = walls_of(outline)
    mixed = np.random.default_rng(0).dirichlet(np.full(4, 0.3), (2000, 2)) @ FOUR.vertices
    heights = (mixed[:, 1] - mixed[:, 0]) @ normals.T - offsets
    assert heights.min() > -1e-12
    assert (heights.min(axis=0) < 0.1).all()  # every side is reached by some difference
    ends = (FOUR.vertices[None] - FOUR.vertices[:, None]).reshape(-1, 2)
    assert all(np.isclose(ends, corner).all(axis=1).any() for corner in outline)


def test_a_plan_in_a_tube_by_an_own_simulation():
    """The wall stops and holds by the part of a move across the tube, and stops the height, too."""
    start = np.array([(-0.2, 0.0, 0.3), (0.2, 0.1, 0.4)])
    goal = np.array([(0.1, -0.1, 0.8), (0.25, 0.2, 0.2)])
    episode = run(SteeringProblem(cylinder(0.5, 1.0), start, goal))
    ends = replayed(start, episode.inputs, lambda at, move: share_in_disk(0.5, at[:2], move[:2]))
    assert ends == pytest.approx(goal, abs=2e-3)
    rng = np.random.default_rng(1)
    before = np.array([0.4, 0.0])
    agreed = 0
    for after in rng.uniform(-0.7, 0.7, (60, 2)):
        found = reached_in_two_moves(cylinder(0.5, 1.0).base, before, after) is not None
        agreed += found == touches(before, after)
    assert agreed >= 59  # a set of contacts may fall between two of the 4000 points


@pytest.mark.parametrize(("name", "place", "start", "goal"), FRAMES)
def test_frames_of_a_plan_by_an_own_simulation(name, place, start, goal):
    episode = _two_d(place, start, goal)
    corners = None if name == "disk" else place.vertices
    walls = None if corners is None else walls_of(corners)

    def share(point, move):
        return (
            share_in_disk(0.5, point, move)
            if walls is None
            else share_in_polygon(walls, point, move)
        )

    assert replayed(start, episode.inputs, share) == pytest.approx(np.array(goal), abs=2e-3)
    before, after = np.diff(start, axis=0)[0], np.diff(goal, axis=0)[0]
    assert touches(before, after, corners)
    assert not touches(before, -3 * before, corners)
