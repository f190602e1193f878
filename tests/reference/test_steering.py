"""The contact world and two-move sets against brute force: plain simulation of every way that could
matter.
"""

from __future__ import annotations

from itertools import pairwise
from math import atan2, cos, pi, sin

import numpy as np
import pytest
from tests.reference import contact
from tests.reference import polygon_reach as reference
from tests.soak import often

from shoal.steering import (
    ContactWorld,
    disk,
    disk_reach,
    polygon,
    polygon_reach,
    reached_in_two_moves,
    regular_polygon,
)
from shoal.steering.delta_space import two_move_pieces

PAIRS = often(200, 400)  # of each kind; acceptance runs used 10,000
BAND = 1e-9  # of the size: pairs so near to the border of a set are not compared


def random_polygon(rng, sides=None):
    sides = int(rng.integers(3, 13)) if sides is None else sides
    angles = np.sort(rng.random(sides)) * 2 * pi
    while np.diff([*angles, angles[0] + 2 * pi]).max() > 0.95 * pi or np.diff(angles).min() < 0.05:
        angles = np.sort(rng.random(sides)) * 2 * pi
    return polygon(np.stack([np.cos(angles), 0.4 + rng.random() * np.sin(angles)], axis=1))


def walls_of(space):
    if space.round:
        return [("circle", *space.center.tolist(), space.radius)]
    return contact.lines_of([tuple(corner) for corner in space.vertices.tolist()])


def random_point(rng, space):
    while True:
        point = space.center + (rng.random(2) * 2 - 1) * 2 * space.size
        if space.contains(point):
            return point


def random_pair(rng, space):
    first, second = random_point(rng, space), random_point(rng, space)
    return second - first


@pytest.mark.parametrize("kind", ["polygon", "disk"])
def test_steps_are_those_of_the_plain_simulation(kind):
    rng = np.random.default_rng(1)
    for _ in range(100):
        space = (
            random_polygon(rng)
            if kind == "polygon"
            else disk(0.2 + rng.random(), center=rng.random(2))
        )
        world, walls = ContactWorld(space), walls_of(space)
        points = np.array([random_point(rng, space) for _ in range(3)])
        plain = [tuple(point) for point in points.tolist()]
        for _ in range(8):
            move = rng.normal(size=2) * space.size * rng.choice([0.05, 0.5, 2])
            if rng.random() < 0.3 and not space.round:  # along a wall, or straight into it
                move = rng.choice([-1, 1]) * (
                    space.normals[0] if rng.random() < 0.5 else space.normals[0][::-1] * [1, -1]
                )
            held = world.are_held(points, move)
            assert held.tolist() == [
                contact.is_held(walls, point, move, space.size) for point in plain
            ]
            points = world.step(points, move)
            plain = contact.step(walls, plain, move.tolist(), space.size)
            np.testing.assert_allclose(points, plain, atol=1e-12 * space.size)
            assert space.contains(points).all()
            # snapped onto the wall, so that neither drifts
            plain = [tuple(point) for point in points.tolist()]


def contacts_on_polygon(space, before, after, sign):
    """Between any two of these the answer cannot change: ends of sides, and where a shifted outline
    crosses them.
    """
    found = []
    corners = space.vertices
    for side, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        shares = [0.0, 1.0]
        for shift in (sign * before, sign * after):
            rates = space.normals @ (end - side)
            with np.errstate(divide="ignore", invalid="ignore"):
                crossings = -(space.wall_distances(side + shift)) / rates
            shares += [float(s) for s in crossings[np.isfinite(crossings)] if 0 < s < 1]
        shares.sort()
        middles = [(a + b) / 2 for a, b in pairwise(shares)]
        found += [side + share * (end - side) for share in middles]
    return np.array(found)


def brute_polygon(space, before, after):
    """The most room that any contact leaves: simulate the second move from the middle of every
    piece of every side.
    """
    best = -np.inf
    walls = walls_of(space)
    for sign in (1, -1):
        contacts = contacts_on_polygon(space, before, after, sign)
        move = sign * (after - before)
        inside = np.minimum(
            space.depth(contacts + sign * before), space.depth(contacts + sign * after)
        )
        for touching, room in zip(contacts[inside > 0], inside[inside > 0], strict=True):
            other = touching + sign * before
            (here, there) = contact.step(
                walls, [tuple(touching), tuple(other)], tuple(move), space.size
            )
            if np.allclose(np.subtract(there, here), sign * after, atol=1e-12):
                best = max(best, room)
    return best


def test_membership_on_polygons_is_that_of_brute_force():
    rng = np.random.default_rng(2)
    yes = no = band = 0
    while yes + no + band < PAIRS:
        space = random_polygon(rng)
        for _ in range(25):
            before = random_pair(rng, space) * rng.choice([0.05, 1.0])
            after = (
                random_pair(rng, space)
                if rng.random() < 0.5
                else before * rng.random() + 0.2 * random_pair(rng, space)
            )
            if not space.differences.contains(after):
                continue
            crossing, room = (
                reached_in_two_moves(space, before, after),
                brute_polygon(space, before, after),
            )
            if crossing is not None and crossing.slack <= BAND:
                band += 1
            elif crossing is None:
                assert room <= BAND * space.size
                no += 1
            else:
                assert room > 0
                yes += 1
    assert min(yes, no) > PAIRS // 10
    assert band < PAIRS // 100


def brute_disk(space, before, after):
    """Simulate from the middle of every arc between angles at which the answer may change."""
    radius, best = space.radius, -np.inf
    angles = []
    for delta in (before, after):
        half = np.arccos(np.clip(np.hypot(*delta) / (2 * radius), -1, 1))
        away = atan2(-delta[1], -delta[0])
        angles += [away - half, away + half]
    turn = atan2(after[1] - before[1], after[0] - before[0])
    angles = np.sort(np.mod([*angles, turn - pi / 2, turn + pi / 2], 2 * pi))
    middles = [(a + b) / 2 for a, b in zip(angles, [*angles[1:], angles[0] + 2 * pi], strict=True)]
    for angle in middles:
        touching = space.center + radius * np.array([cos(angle), sin(angle)])
        other = touching + before
        room = float(min(space.depth(other), space.depth(touching + after)))
        here, there = contact.step(
            walls_of(space), [tuple(touching), tuple(other)], tuple(after - before), space.size
        )
        if room > 0 and np.allclose(np.subtract(there, here), after, atol=1e-9):
            best = max(best, room)
    return best


def test_membership_on_disks_is_that_of_brute_force():
    rng = np.random.default_rng(3)
    counts = {True: 0, False: 0}
    for _ in range(PAIRS):
        space = disk(0.1 + rng.random(), center=rng.normal(size=2))
        before = random_pair(rng, space) * rng.choice([0.05, 1.0])
        after = random_pair(rng, space) * rng.choice([0.3, 1.0])
        crossing, room = (
            reached_in_two_moves(space, before, after),
            brute_disk(space, before, after),
        )
        if crossing is not None and crossing.slack <= 1e-7:
            continue
        assert (crossing is not None) == (room > 0) or room <= BAND * space.size
        counts[crossing is not None] += 1
    assert min(counts.values()) > PAIRS // 10


@pytest.mark.parametrize("kind", ["polygon", "disk"])
def test_the_two_moves_do_what_they_promise(kind):
    rng = np.random.default_rng(4)
    done = 0
    while done < 100:
        space = random_polygon(rng) if kind == "polygon" else disk(0.5)
        start = np.array([random_point(rng, space), random_point(rng, space)])
        before, after = start[1] - start[0], random_pair(rng, space) * 0.7
        crossing = reached_in_two_moves(space, before, after)
        if crossing is None or crossing.slack < 1e-6:
            continue
        moves = crossing.moves(start, after - before)
        walls, points = walls_of(space), [tuple(point) for point in start.tolist()]
        for move in moves.tolist():
            points = contact.step(walls, points, move, space.size)
        np.testing.assert_allclose(np.subtract(points[1], points[0]), after, atol=1e-12)
        end = ContactWorld(space).play(start, moves)[-1]
        np.testing.assert_allclose(end[1] - end[0], after, atol=1e-12)
        done += 1


def inside_convex(corners, points):
    edges = np.roll(corners, -1, axis=0) - corners
    towards = points[:, None] - corners[None]
    crosses = edges[None, :, 0] * towards[..., 1] - edges[None, :, 1] * towards[..., 0]
    return np.maximum(crosses.min(axis=1), -crosses.max(axis=1))


def test_pieces_that_are_drawn_are_the_set():
    rng = np.random.default_rng(5)
    for number in range(often(8, 16)):
        space = random_polygon(rng) if number % 4 else disk(0.5)
        before = random_pair(rng, space)
        pieces = two_move_pieces(space, before)
        points = np.array([random_pair(rng, space) for _ in range(60)])
        margin = np.max(
            [inside_convex(piece, points) for piece in pieces if len(piece) > 2], axis=0
        )
        for point, most in zip(points, margin, strict=True):
            crossing = reached_in_two_moves(space, before, point)
            if most > 1e-9:
                assert crossing is not None
            if crossing is not None and crossing.slack > (1e-3 if space.round else 1e-9):
                assert most > -1e-3 if space.round else most > 0


def test_sets_of_many_moves_are_those_of_intersected_polygons():
    rng = np.random.default_rng(3)
    for sides in range(3, 8):
        space = random_polygon(rng, sides)
        # far from the origin, and in other units
        space = polygon(1e3 * (space.vertices + 10 * rng.random(2)))
        sets = polygon_reach(space, random_pair(rng, space), moves=4, contacts=9)
        np.testing.assert_allclose(reference.deeper(sets[0]), sets[1].depths, atol=1e-8)
        # Corners between two directions are left out, and nothing is included that is not reached.
        for reach in sets:
            missing = reference.area(reach) - reach.fraction()
            assert -1e-9 < missing < 1e-4


def test_polygons_with_many_sides_are_almost_disks():
    most = [reach.fraction() for reach in disk_reach(0.05**0.5, moves=6)]
    for sides, near in ((64, 0.06), (1000, 0.005)):
        sets = polygon_reach(regular_polygon(sides), (0.2, 0.1), moves=6)
        np.testing.assert_allclose([reach.fraction() for reach in sets], most, rtol=near)


def test_particles_at_one_place_stay_together():
    reach = polygon_reach(regular_polygon(5), (0, 0), moves=4)[1]
    assert reach.fraction() == 0
    assert reach.contains([(0, 0), (0.1, 0)]).tolist() == [True, False]
