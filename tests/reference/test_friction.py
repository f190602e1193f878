"""Friction: steps against plain simulation, links and barriers against plain sampling and plain
pushing, plans played again.
"""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference import contact
from tests.reference.test_planners import SHAPES, SQUARE, instance, replayed_error
from tests.reference.test_steering import random_point, random_polygon, walls_of
from tests.soak import often
from tests.steering import steer

from shoal.steering import ContactWorld, disk
from shoal.steering.contact.friction import friction_limit, largest_turn
from shoal.steering.kernels.cycles import CycleModel, fewest_cycles, find_cycle
from shoal.steering.planners.chain_search import backward_nodes
from shoal.steering.workspaces.walls import normalize_walls


@pytest.mark.parametrize("kind", ["polygon", "disk"])
def test_steps_with_friction_are_those_of_the_plain_simulation(kind):
    rng = np.random.default_rng(41)
    for _ in range(20):
        space = random_polygon(rng) if kind == "polygon" else disk(0.5)
        friction = float(rng.choice([0.0, 0.5, 2.0]))
        world, walls = ContactWorld(space, friction=friction), walls_of(space)
        points = np.array([random_point(rng, space) for _ in range(2)])
        for _ in range(6):
            move = rng.normal(size=2) * space.size * rng.choice([0.05, 0.5])
            plain = contact.step_with_friction(
                walls,
                [tuple(point) for point in points.tolist()],
                move.tolist(),
                space.size,
                friction,
            )
            points = world.step(points, move)
            np.testing.assert_allclose(
                points, plain, atol=(1e-11 if kind == "polygon" else 4e-3) * space.size
            )


def ground_of(walls, friction):
    return CycleModel(
        walls.frames,
        walls.reaches,
        walls.normals,
        walls.offsets,
        walls.circle,
        friction,
        1e-9,
        1e-9,
    )


def best_room(walls, before, after, friction, count=600):
    """The most that contacts among so many have left of all limits of a cycle; by what a finer grid
    could add, too.
    """
    best = -np.inf
    frames, radius = walls.frames, walls.circle[2]
    for wall in range(max(1, len(walls.normals))):
        if walls.round:
            angles = 2 * np.pi * np.arange(count) / count
            contacts = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
            inward = -contacts / radius
        else:
            places = np.linspace(-1, 1, count) * walls.reaches[wall]
            contacts = frames[wall, 0] + places[:, None] * frames[wall, 1]
            inward = np.broadcast_to(walls.normals[wall], contacts.shape)
        for sign in (1, -1):
            change = sign * (after - before)
            push = -inward @ change
            along = np.abs(inward[:, 0] * change[1] - inward[:, 1] * change[0])
            room = np.minimum(push, friction * push - along)
            for delta in (before, after):
                other = contacts + sign * delta
                depth = (
                    radius - np.hypot(*other.T)
                    if walls.round
                    else (other @ walls.normals.T - walls.offsets).min(axis=1)
                )
                room = np.minimum(room, depth)
            best = max(best, float(room.max()))
    return best


@pytest.mark.parametrize("kind", ["polygon", "disk"])
def test_links_are_those_of_sampled_contacts(kind):
    rng = np.random.default_rng(42)
    step, counts = np.empty(3), [0, 0]
    for _ in range(60):
        space = random_polygon(rng) if kind == "polygon" else disk(0.5)
        walls, friction = normalize_walls(space), float(rng.choice([0.3, 1.0, 3.0]))
        points = walls.normalized(np.array([random_point(rng, space) for _ in range(4)]))
        before = points[1] - points[0]
        after = before + (points[3] - points[2] - before) * rng.random()
        room = best_room(walls, before, after, friction)
        found = find_cycle(before, after, ground_of(walls, friction), step)
        if room > 1e-6:
            assert found
        if found:
            assert room > -1e-2
        counts[found] += 1
    assert min(counts) > 8


def test_fewest_cycles_are_those_of_plain_layers():
    rng = np.random.default_rng(43)
    walls = normalize_walls(random_polygon(rng, sides=7))
    ground, step = ground_of(walls, 0.8), np.empty(3)
    for _ in range(6):
        nodes = (rng.random((40, 2)) - 0.5) * 0.8
        parents, order = np.empty(40, dtype=np.int64), np.empty(40, dtype=np.int64)
        reached = fewest_cycles(nodes, ground, parents, order)
        layer, seen, depth = {0}, {0}, 0
        while layer and 1 not in seen:
            layer = {
                b
                for a in layer
                for b in range(40)
                if b not in seen and find_cycle(nodes[a], nodes[b], ground, step)
            }
            seen |= layer
            depth += 1
        assert reached == (1 in seen)
        if reached:
            node, cycles = 1, 0
            while node:
                assert find_cycle(nodes[parents[node]], nodes[node], ground, step)
                node, cycles = parents[node], cycles + 1
            assert cycles == depth


@pytest.mark.parametrize("friction", [0.2, 0.5, 1.0])
def test_no_pushing_crosses_a_barrier(friction):
    rng = np.random.default_rng(44)
    for number in range(4):
        space = disk(0.5) if number == 0 else random_polygon(rng, sides=int(rng.integers(3, 9)))
        walls = walls_of(space)
        points = [tuple(random_point(rng, space).tolist()) for _ in range(2)]
        first = np.subtract(points[1], points[0])
        for count in range(16):
            # the outermost reactions: the walls' normals, turned by the angle of friction
            if rng.random() < 0.6:
                who, wall = rng.integers(2), walls[rng.integers(len(walls))]
                nx, ny = contact.normal(wall, points[who])
                turn = float(rng.choice([-1, 1])) * np.arctan(friction) * 0.999
                move = (
                    -rng.random()
                    * 0.7
                    * np.array(
                        [
                            nx * np.cos(turn) - ny * np.sin(turn),
                            nx * np.sin(turn) + ny * np.cos(turn),
                        ]
                    )
                )
            else:
                move = rng.normal(size=2) * 0.4
            points = contact.step_with_friction(walls, points, move.tolist(), space.size, friction)
            if count % 4 < 3:
                continue
            delta = np.subtract(points[1], points[0])
            assert friction_limit(space, friction, first, delta, near=1e-4 * space.size) is None


def test_the_barrier_of_the_square_is_as_near_as_can_be():
    """From (a, b), both positive: (0, b + friction a) and (a + friction b, 0), and that times the
    friction on the next axis.
    """
    rng, friction = np.random.default_rng(45), 0.5
    for _ in range(20):
        a, b = rng.random(2) * 0.55 + 0.05
        x, y = rng.random(2) + 0.01
        top, right = b + friction * a, a + friction * b
        same = min(top / (y + friction * x), right / (x + friction * y))
        # or the other way around, through three quadrants
        after = friction * max(top, friction**2 * right) / (x + friction * y)
        for goal, reach in (((x, y), same), ((-x, y), after)):
            for share, possible in ((0.98, True), (1.02, False)):
                wanted = np.array(goal) * (reach * share)
                assert (
                    friction_limit(SQUARE, friction, np.array([a, b]), wanted) is None
                ) == possible


def test_turns_while_shrinking_are_those_of_small_steps():
    cone, radius, size, turn = 0.4, 0.5, 0.9, 0.0
    while size > 0.55:
        way = np.arccos(size / (2 * radius)) + cone
        turn += 1e-5 * np.sin(way) / size
        size -= 1e-5 * np.cos(way)
    assert largest_turn(0.9, size, radius, cone) == pytest.approx(turn, rel=1e-3)
    assert largest_turn(0.9, 0.3, radius, cone) == np.inf
    assert largest_turn(0.9, 0.6, radius, 0.0) == pytest.approx(
        largest_turn(0.9, 0.6, radius, 1e-5), rel=1e-3
    )


def test_rungs_of_a_ladder_lead_up():
    walls, step = normalize_walls(disk(0.5)), np.empty(3)
    after = np.array([0.5, 0.2])
    nodes = backward_nodes(after, radius=float(walls.circle[2]), friction=1.0, margin=2e-9)
    for way in np.split(nodes, 4):
        for lower, upper in zip(way, [after, *way[:-1]], strict=True):
            assert np.hypot(*lower) < np.hypot(*upper)
            assert find_cycle(lower, upper, ground_of(walls, 1.0), step)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("friction", [0.5, 1.0, 2.0])
def test_plans_with_friction_arrive_in_the_plain_simulation(shape, friction):
    rng = np.random.default_rng(46)
    solved, may = 0, 0
    for _ in range(often(1, 2)):
        space = SHAPES[shape](rng)
        episode = steer(instance(rng, space), planner="greedy", friction=friction, max_moves=1000)
        may += episode.status != "unreachable"
        if episode.status == "solved":
            solved += 1
            assert replayed_error(space, episode) <= 1e-6
    assert solved >= may - 1
