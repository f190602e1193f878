"""The kernels that keep the clearance, against the plain simulation of `tests.reference.replay`
with each contact tolerance.
"""

from __future__ import annotations

from itertools import pairwise
from math import dist, hypot, inf

import numpy as np
import pytest
from tests.reference import replay
from tests.reference.test_steering import random_polygon
from tests.soak import often

from shoal.steering import ContactWorld, cylinder, disk, polygon, prism, region, regular_polygon
from shoal.steering.contact.clearance import PLANNED, STRICT
from shoal.steering.contact.world import RegionWorld
from shoal.steering.kernels import annealing, sampling, shooting
from shoal.steering.planners.fewest_moves import directions
from shoal.steering.planners.sampling import world_of
from shoal.steering.planners.task import SteeringTask
from shoal.steering.workspaces.formats import describe

CLEARANCE = 1e-4  # wide, so that random particles are often between the two contact tolerances
SQUARE = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])
U_SHAPE = region([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)])
YARD = region([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1.5, 1.5), (2.5, 1.5), (2.5, 2.5), (1.5, 2.5)]])
ROOMS = {
    "square": lambda _rng: SQUARE,
    "polygon": random_polygon,
    "disk": lambda _rng: disk(0.5),
    "a U": lambda _rng: U_SHAPE,
    "a yard": lambda _rng: YARD,
}
SOLIDS = {
    "prism": lambda _rng: prism(regular_polygon(5), 1.0),
    "cylinder": lambda _rng: cylinder(0.5, 0.8),
}


def inside(rng, room):
    """A point inside, half of the time nearer to a wall than twice the clearance."""
    while True:
        point = rng.uniform(*room.bounds)
        if room.dimensions == 3:
            flat = inside(rng, room.base)
            return np.append(flat, rng.choice([rng.random(), 1e-4 * rng.random()]) * room.height)
        if not room.contains(point):
            continue
        if rng.random() < 0.5:
            return point
        if room.round:
            off = point - room.center
            return room.center + off / np.hypot(*off) * (
                room.radius - 2 * CLEARANCE * room.size * rng.random()
            )
        edge = room.edges[int(rng.integers(len(room.edges)))]
        along = edge[2:] - edge[:2]
        inward = np.array([-along[1], along[0]]) / np.hypot(*along)
        near = edge[:2] + rng.random() * along + 2 * CLEARANCE * room.size * rng.random() * inward
        if room.contains(near):
            return near


def way(rng, room):
    """A move, now and then along an axis, where walls are."""
    move = rng.normal(size=room.dimensions) * rng.choice([0.05, 0.5, 2e-4])
    if rng.random() < 0.3:
        move[int(rng.integers(room.dimensions))] = 0.0
    return move * float(room.size)


def simulated(room, touch=1e-9, friction=inf):
    return (
        RegionWorld(room, touch=touch)
        if room in (U_SHAPE, YARD)
        else ContactWorld(room, friction=friction, touch=touch)
    )


def played(room, points, moves, touch=1e-9, friction=inf, leaving=replay.LEAVING):
    ends = replay.end_of(
        describe(room),
        np.asarray(points).tolist(),
        np.asarray(moves).tolist(),
        touch=touch,
        friction=friction,
        leaving=leaving,
    )
    return np.array(ends)


@pytest.mark.parametrize("friction", [inf, 0.7])
@pytest.mark.parametrize("name", [*ROOMS, *SOLIDS])
def test_whole_plans_are_those_of_the_plain_simulation(name, friction):
    if friction < inf and name in ("a U", "a yard"):
        pytest.skip("no friction coefficient around obstacles")
    rng = np.random.default_rng(51)
    # The plain simulation slides along short chords of circles, and at the distance from a flat
    # wall at which it touched the wall.
    rough, close = (
        (4e-3 if name in ("disk", "cylinder") else 0.0, 5.0) if friction < inf else (0.0, 0.0)
    )
    for _ in range(6):
        room = (ROOMS | SOLIDS)[name](rng)
        start = np.array([inside(rng, room) for _ in range(3)])
        moves = np.array([way(rng, room) for _ in range(5)])
        for touch in (1e-12, 1e-9, 1e-6, CLEARANCE):
            end = simulated(room, touch, friction).final(start, moves)
            limit = max(rough, close * touch, 1e-10) * room.size
            np.testing.assert_allclose(end, played(room, start, moves, touch, friction), atol=limit)


def scenes(name, count, seed):
    """Random tasks, their worlds for the compiled functions, the random state of each, and the
    scene of the replay.
    """
    rng = np.random.default_rng(seed)
    for _ in range(count):
        room = ROOMS[name](rng)
        points = np.array([inside(rng, room) for _ in range(4)])
        task = SteeringTask(
            simulated(room),
            points[:2],
            points[2:],
            1e-6 * room.size,
            clearance=CLEARANCE,
            margin=CLEARANCE,
        )
        scene = replay.Scene(describe(room), replay.Turned())
        yield rng, room, task, world_of(task.world, task), scene


def corners_to_avoid(scene, task):
    """The corners that stick out and are no start or goal themselves."""
    ends = [*task.start.tolist(), *task.goal.tolist()]
    places = [scene.segments[k][0] for k in scene.reflex]
    return [
        place for place in places if all(dist(place, end) > CLEARANCE * scene.size for end in ends)
    ]


def nearest(place, after, corner):
    """The distance of a corner from a path: the minimum of a convex function, found by thirds."""
    low, high = 0.0, 1.0

    def away(share):
        return dist(corner, [a + share * (b - a) for a, b in zip(place, after, strict=True)])

    for _ in range(200):
        one, other = low + (high - low) / 3, high - (high - low) / 3
        low, high = (low, other) if away(one) < away(other) else (one, high)
    return min(away(low), away(0.0), away(1.0))


@pytest.mark.parametrize("name", ["a U", "a yard"])
def test_paths_near_corners(name):
    found = [0, 0]
    for rng, _, task, world, scene in scenes(name, 60, 52):
        corners = corners_to_avoid(scene, task)
        assert sorted(map(tuple, world.corners.tolist())) == sorted(corners)
        corner = np.array(corners[int(rng.integers(len(corners)))])
        one, other = rng.normal(size=(2, 2))
        place = corner + rng.choice([1, 2, 4]) * CLEARANCE * scene.size * one - rng.random() * other
        after = place + rng.choice([0.0, 1.0, 0.5]) * other
        plain = (
            min(nearest(place.tolist(), after.tolist(), corner) for corner in corners)
            < 1.5 * CLEARANCE * scene.size
        )
        assert sampling.passes_corner(*place, *after, world) == plain
        found[plain] += 1
    assert min(found) > 5


@pytest.mark.parametrize("name", ROOMS)
def test_moves_that_keep_the_clearance(name):
    found = [0, 0]
    for rng, room, task, world, scene in scenes(name, often(35, 60), 53):
        corners, moves = corners_to_avoid(scene, task), np.array([way(rng, room) for _ in range(2)])
        states, plain = task.start, True
        for move in moves:
            after = played(room, states, [move], leaving=STRICT)
            wide = played(room, states, [move], 1.25 * CLEARANCE)
            for p in range(2):
                near = min(
                    (nearest(states[p].tolist(), after[p].tolist(), corner) for corner in corners),
                    default=inf,
                )
                plain = plain and near >= 1.5 * CLEARANCE * scene.size
            plain = plain and np.abs(after - wide).max() <= 1e-11 * scene.size
            states = after
        assert sampling.keeps_clear(task.start.copy(), moves, 2, world) == plain
        found[bool(plain)] += 1
    assert min(found) > 5


@pytest.mark.parametrize("name", ROOMS)
def test_moves_that_a_wall_may_hold_begin_with_a_lift(name):
    found = [0, 0]
    for rng, room, task, world, scene in scenes(name, 60, 54):
        move = way(rng, room)
        touches = (1e-9, 1.25 * CLEARANCE)
        plain = any(
            replay.moved(scene, tuple(point), tuple(move), touch * scene.size)[1] == 0.0
            for point in task.start
            for touch in touches
        )
        assert sampling.is_blocked(task.start, *move, world) == plain
        moves, state = np.zeros((8, 2)), task.start.copy()
        count = sampling.translate(state, *move, world, moves, 0, True)
        np.testing.assert_allclose(
            state,
            played(room, task.start, moves[:count], leaving=STRICT),
            atol=1e-10 * room.size,
        )
        np.testing.assert_allclose(moves[:count].sum(axis=0), move, atol=1e-12 * room.size)
        assert plain or count == 1
        if count == 2:
            assert np.isclose(hypot(*moves[0]), PLANNED * CLEARANCE * room.size)
            lifted = [world.lift * n for n in moves[0] / hypot(*moves[0])]
            assert np.allclose(moves[0], lifted)
        found[bool(plain)] += 1
    assert min(found) > 5


@pytest.mark.parametrize("name", ROOMS)
def test_steps_of_plans_are_played_with_both_tolerances(name):
    """A contact, an adjustment and a translation to where the plain simulation ends with one
    tolerance or the other.
    """
    found = [0, 0]
    for rng, room, task, world, scene in scenes(name, often(25, 40), 55):
        steps = annealing.Steps(
            np.array([0, 0, 1, 2]), np.array([0, 1, 1, 0]), *np.zeros((3, 4, 2))
        )
        steps.targets[:2] = [inside(rng, room) for _ in range(2)]
        moves, state = [], task.start
        for k in range(2):
            moves.append(steps.targets[k] - state[steps.particles[k]])
            state = played(room, state, moves[-1:], leaving=STRICT)
        moves += [way(rng, room), way(rng, room)]
        middle = played(room, state, moves[2:3], leaving=STRICT)
        end = played(room, middle, moves[3:], leaving=STRICT)
        # The last adjustment aims at the difference of the goals, and the translation at their
        # middle.
        goal = end
        moves[2] = -((goal[1] - goal[0]) - (state[1] - state[0]))
        middle = played(room, state, moves[2:3], leaving=STRICT)
        moves[3] = goal.mean(axis=0) - middle.mean(axis=0)
        path = [task.start]
        for move in moves:
            path.append(played(room, path[-1], [move], leaving=STRICT))
        corners = corners_to_avoid(scene, task)
        near = min(
            (
                nearest(a.tolist(), b.tolist(), corner)
                for before, after in pairwise(path)
                for a, b in zip(before, after, strict=True)
                for corner in corners
            ),
            default=inf,
        )
        wide = played(room, task.start, moves, 1.25 * CLEARANCE)
        limit = 1e-6 * room.size
        arrives = all(
            max(dist(a, b) for a, b in zip(state, goal, strict=True)) <= limit
            for state in (path[-1], wide)
        )
        plain = arrives and near >= 1.5 * CLEARANCE * scene.size
        ends = annealing.PlanTask(task.start, goal, limit, 4)
        length = annealing.play(steps, 4, ends, inf, world, task.start.copy())
        assert (length < inf) == plain
        if plain:
            assert np.isclose(length, sum(hypot(*move) for move in moves), rtol=1e-9)
            assert annealing.play(steps, 4, ends, 0.99 * length, world, task.start.copy()) == inf
        found[bool(plain)] += 1
    assert min(found) > 2


def plain_shortage(scene, places, goal, toucher):
    """The direction and the length of the second-last move, and by how much the way of the other
    particle is too short.
    """
    sign = 1 if toucher == 0 else -1
    change = [sign * ((q - p) - (b - a)) for p, q, a, b in zip(*goal, *places, strict=True)]
    length = replay.length_of(change)
    unit = tuple(part / length for part in change)
    before, room = (
        0.0
        if replay.moved(scene, tuple(place), unit, 1e-9 * scene.size)[1] == 0.0
        else scene.meeting(tuple(place), unit)
        for place in (places[toucher], places[1 - toucher])
    )
    return unit, before + length, before + length - room


@pytest.mark.parametrize("name", ["square", "polygon", "disk"])
def test_last_moves_leave_the_other_particle_its_clearance(name):
    rng = np.random.default_rng(56)
    found, clear = [0, 0], 0.05  # wide, so that it decides
    for _ in range(60):
        room = ROOMS[name](rng)
        places, goal = np.array([[inside(rng, room) for _ in range(2)] for _ in range(2)])
        scene = replay.Scene(describe(room), replay.Turned())
        for toucher in (0, 1):
            unit, length, short = plain_shortage(scene, places.tolist(), goal.tolist(), toucher)
            moves = np.zeros((2, 2))
            shot = shooting.Shot(
                places, goal, simulated(room).walls, clear * room.size, np.zeros((0, 2))
            )
            error = shooting.finish(places, shot, toucher, moves)
            assert np.isfinite(error) == (short <= -clear * room.size)
            if np.isfinite(error):
                np.testing.assert_allclose(
                    moves[0], np.multiply(unit, length), atol=1e-12 * room.size
                )
                end = played(room, places, moves)
                assert np.isclose(error, np.hypot(*(end - goal).T).max(), atol=1e-10 * room.size)
            found[bool(np.isfinite(error))] += 1
    assert min(found) > 5


@pytest.mark.parametrize("name", ["square", "polygon", "disk"])
def test_plans_of_few_moves_keep_their_clearance(name):
    """What the searches, the changes and the repair return is feasible in the plain simulation."""
    rng = np.random.default_rng(57)
    clear, shares, solved = 1e-3, np.linspace(0.05, 0.95, 4), 0
    for count in (3, 4, 4, 5):
        room = ROOMS[name](rng)
        start, goal = (
            rng.permutation(
                [room.middle + 0.3 * room.size * (rng.random(2) - 0.5) for _ in range(2)]
            )
            for _ in range(2)
        )
        walls, scene = simulated(room).walls, replay.Scene(describe(room), replay.Turned())
        wide, trials = clear * room.size, shooting.Trials(directions(2, 24), shares)
        nudges = wide * np.vstack([np.eye(2), -np.eye(2)])
        shot = shooting.Shot(start, goal, walls, wide, nudges)
        plan = np.zeros((count, 2))
        if count == 3:
            records = shooting.search(shot, trials, 100, plan)
        else:
            picks = rng.integers(0, 2**31, (60, 5, count - 2, 2))
            records = shooting.search_guided(shot, trials, picks, 4, plan)
        trial = rng.normal(size=(count, 2)) * 0.4 * room.size
        before = trial.copy()
        left = shooting.repair(shot, trial)
        short = min(
            plain_shortage(scene, played(room, start, trial[:-2]).tolist(), goal.tolist(), t)[2]
            for t in (0, 1)
        )
        assert np.isclose(left, short, atol=1e-9 * room.size)
        assert (
            left
            <= min(
                plain_shortage(scene, played(room, start, before[:-2]).tolist(), goal.tolist(), t)[
                    2
                ]
                for t in (0, 1)
            )
            + 1e-9
        )
        if not records:
            continue
        solved += 1
        for changed in (False, True):
            if changed:
                longer = sum(hypot(*move) for move in plan)
                length = shooting.improve(shot, 0.05, plan)
                assert np.isclose(length, sum(hypot(*move) for move in plan))
                assert length <= longer + 1e-12
            for nudge in (np.zeros(2), *nudges):
                # After a small change of the third-last move, other last two moves still lead to
                # the goals.
                first = plan[:-2] + nudge * (np.arange(count - 2) == count - 3)[:, None]
                states = played(room, start, first)
                assert (
                    min(plain_shortage(scene, states.tolist(), goal.tolist(), t)[2] for t in (0, 1))
                    <= -wide + 1e-10
                )
            assert np.hypot(*(played(room, start, plan) - goal).T).max() <= 1e-6 * room.size
    assert solved >= 1
