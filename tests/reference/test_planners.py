"""Planners against plain simulation, plain optimization and plain sampling."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, linprog, minimize
from tests.reference import contact
from tests.reference.test_steering import random_point, random_polygon, walls_of
from tests.soak import often
from tests.steering import steer

from shoal.steering import (
    ContactWorld,
    SteeringProblem,
    SteeringTask,
    cylinder,
    disk,
    polygon,
    prism,
    reached_in_two_moves,
    regular_polygon,
)
from shoal.steering.kernels.chain import ChainKind, chain_length, new_work, objective
from shoal.steering.planners.chain_search import nearest_cycles, roadmap_chain, shortest_chain
from shoal.steering.planners.chains import ChainQuery, length_over_circle
from shoal.steering.planners.fewest_moves import shooting_plan
from shoal.steering.planners.shortest import Shortest, planar_task, with_vertical_moves
from shoal.steering.workspaces.walls import normalize_walls

SQUARE = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])
SHAPES = {
    "square": lambda _rng: SQUARE,
    "disk": lambda _rng: disk(0.5),
    "hexagon": lambda _rng: regular_polygon(6),
    "7-gon": partial(random_polygon, sides=7),
}
INSTANCES = often(2, 10)  # of each kind


def replayed_error(space, episode):
    points = [tuple(point) for point in episode.problem.start.tolist()]
    walls = walls_of(space)
    friction = episode.problem.friction
    for move in episode.inputs.tolist():
        if friction < np.inf:
            points = contact.step_with_friction(walls, points, move, space.size, friction)
        else:
            points = contact.step(walls, points, move, space.size)
    return float(np.hypot(*(np.array(points) - episode.goal).T).max())


def instance(rng, space, tolerance=1e-6):
    points = np.array([random_point(rng, space) for _ in range(4)])
    return SteeringProblem(space, points[:2], points[2:], tolerance)


@pytest.mark.parametrize("shape", SHAPES)
def test_plans_arrive_in_the_plain_simulation(shape):
    rng = np.random.default_rng(31)
    lengths = {"greedy": [], "shortest": [], "fewest-moves": []}
    moves = {name: [] for name in lengths}
    for _ in range(INSTANCES):
        space = SHAPES[shape](rng)
        problem = instance(rng, space)
        for planner, found in lengths.items():
            episode = steer(problem, planner=planner)
            assert episode.status == "solved"
            assert replayed_error(space, episode) <= problem.tolerance
            assert episode.length >= episode.lower_bound
            assert episode.verify()
            found.append(episode.length)
            moves[planner].append(episode.moves)
    assert (np.array(lengths["shortest"]) <= np.array(lengths["greedy"]) + 1e-6).all()
    assert (np.array(moves["fewest-moves"]) <= np.minimum(moves["shortest"], moves["greedy"])).all()
    assert np.mean(lengths["shortest"]) < 0.97 * np.mean(lengths["greedy"])


def test_plans_that_graze_walls_beside_corners_arrive_in_the_plain_simulation():
    """Drawn with seed 1: their shortest chains graze two walls beside a corner, so roundings grew
    to 1e-4 and 1e-2.
    """
    rng = np.random.default_rng(1)
    problems = [instance(rng, SHAPES["7-gon"](rng)) for _ in range(306)]
    for number in (174, 305):
        space = problems[number].workspace
        episode = steer(problems[number])
        assert replayed_error(space, episode) <= 1e-6
        moved = steer(problems[number], start=problems[number].start + 1e-14).length
        assert episode.length == pytest.approx(moved, abs=1e-5)


def test_plans_of_four_to_six_moves_arrive_in_the_plain_simulation():
    rng = np.random.default_rng(37)
    found = dict.fromkeys((4, 5, 6), 0)
    for shape in ("disk", "hexagon", "7-gon", "disk", "square"):
        space = SHAPES[shape](rng)
        problem = instance(rng, space)
        task = SteeringTask(ContactWorld(space), problem.start, problem.goal, problem.tolerance)
        for count in found:
            plan = shooting_plan(task, count)
            if plan is None:
                continue
            found[count] += 1
            assert len(plan) == count
            points = [tuple(point) for point in problem.start.tolist()]
            for move in plan.tolist():
                points = contact.step(walls_of(space), points, move, space.size)
            assert np.hypot(*(np.array(points) - problem.goal).T).max() <= problem.tolerance
    assert min(found.values()) >= 3


def adversarial(rng):
    """Corners, near walls, tiny separations."""
    kinds = [
        lambda: rng.choice([0.0, 1.0], size=2),
        lambda: np.array([rng.choice([0.0, 1e-7, 1e-4, 1 - 1e-4, 1.0]), rng.random()])[
            :: rng.choice([-1, 1])
        ],
        lambda: rng.random(2),
    ]
    while True:
        points = np.array([kinds[rng.integers(3)]() for _ in range(4)])
        if rng.random() < 0.3:
            points[1] = np.clip(points[0] + rng.normal(size=2) * 10.0 ** rng.integers(-5, -1), 0, 1)
        if (
            np.abs(points[0] - points[1]).max() > 1e-6
            and np.abs(points[2] - points[3]).max() > 1e-6
        ):
            return points


def test_worst_cases_of_the_square():
    rng = np.random.default_rng(32)
    for _ in range(often(8, 20)):
        points = adversarial(rng)
        episode = steer(SteeringProblem(SQUARE, points[:2], points[2:]))
        # Only where something is nearer to a wall or to the other particle than the clearance has
        # room, a plan may be sensitive.
        apart = np.concatenate([points[[0, 2]] - points[[1, 3]], points, 1 - points])
        narrow = ((np.abs(apart) > 0) & (np.abs(apart) < 3e-6)).any()
        assert episode.status in ("solved", "approachable", *(["sensitive"] if narrow else []))
        assert episode.error <= 1e-6
        assert replayed_error(SQUARE, episode) <= 1e-6
        assert episode.length < np.sqrt(2) + 2 + 1e-6


def plain_length(query, touchers, walls, x):
    """Length and limits of a chain on flat walls in the plane, written out."""
    frames, normals, offsets, *_ = query.walls.shape
    cycles = len(walls)
    contacts = [frames[w, 0] + x[m] * frames[w, 1] for m, w in enumerate(walls)]
    deltas = [query.before, *x[cycles:].reshape(-1, 2), query.after]
    here, total, limits = query.start.copy(), 0.0, []
    for m, (toucher, wall, spot) in enumerate(zip(touchers, walls, contacts, strict=True)):
        sign = 1 if toucher == 0 else -1
        total += np.linalg.norm(spot - here[toucher]) + np.linalg.norm(deltas[m + 1] - deltas[m])
        limits += [-normals[wall] @ (sign * (deltas[m + 1] - deltas[m]))]
        for point in (spot, spot + sign * deltas[m], spot + sign * deltas[m + 1]):
            limits += list(normals @ point - offsets)
        here = np.stack(
            [spot, spot + deltas[m + 1]] if toucher == 0 else [spot - deltas[m + 1], spot]
        )
    return total + np.linalg.norm(query.goal[0] - here[0]), np.array(limits)


def limits_of(value, unknowns):
    """The limits of a chain over flat walls, which are linear: rows and least products."""
    least = value(np.zeros(unknowns))[1]
    return np.stack([value(one)[1] - least for one in np.eye(unknowns)], axis=1), -least


def room_in(limits):
    """By how much all limits can hold at the most, by a linear program."""
    rows, least = limits.A, limits.lb
    found = linprog(
        np.eye(rows.shape[1] + 1)[-1] * -1,
        A_ub=np.column_stack([-rows, np.ones(len(rows))]),
        b_ub=-least,
        bounds=[(None, None)] * rows.shape[1] + [(None, 1)],
    )
    return -found.fun


def test_shortest_chains_are_those_of_a_general_optimizer():
    rng = np.random.default_rng(33)
    compared = 0
    while compared < often(4, 8):
        space = random_polygon(rng, sides=int(rng.integers(3, 7)))
        walls = normalize_walls(space)
        points = walls.normalized(np.array([random_point(rng, space) for _ in range(4)]))
        query = ChainQuery(
            walls, np.ascontiguousarray(points[:2]), np.ascontiguousarray(points[2:])
        )
        cycles = int(rng.integers(1, 4))
        touchers, on = (
            rng.integers(0, 2, size=cycles),
            rng.integers(0, len(walls.normals), size=cycles),
        )
        guess = query.guess(cycles)
        length = query.optimize(guess, touchers, on)
        value = partial(plain_length, query, touchers, on)
        inside = LinearConstraint(*limits_of(value, len(guess)), np.inf)
        if length == np.inf:
            assert room_in(inside) < 1e-6
            continue
        found = minimize(
            lambda x, value=value: value(x)[0],
            guess + 0.02 * rng.normal(size=len(guess)),
            method="SLSQP",
            constraints=inside,
            options={"maxiter": 300, "ftol": 1e-12},
        )
        assert length == pytest.approx(value(guess)[0], abs=1e-9)
        assert value(guess)[1].min() >= -1e-12
        kind = ChainKind(
            touchers,
            on,
            query.start,
            query.goal,
            walls.shape,
            query.friction,
            query.margin,
            query.push,
        )
        assert chain_length(guess, kind, new_work(cycles, 2)) == pytest.approx(length)
        assert length <= found.fun + 1e-5 or value(found.x)[1].min() < -1e-9
        compared += 1


@pytest.mark.parametrize("friction", [3.0, np.inf])
@pytest.mark.parametrize(
    "space", [regular_polygon(6), disk(0.5), prism(regular_polygon(5), 0.7), cylinder(0.5, 0.8)]
)
def test_gradients_and_hessians_of_chains_are_those_of_differences(space, friction):
    """Of the length with its barriers, and of the slack with its barriers, near a chain inside its
    limits.
    """
    rng, compared = np.random.default_rng(39), 0
    step = 1e-8
    for _ in range(400):
        if compared == often(2, 3):
            break
        points = np.array([random_point(rng, space.base) for _ in range(4)])
        if space.dimensions == 3:
            points = np.column_stack([points, 0.1 + 0.5 * rng.random(4)])
        task = SteeringTask(
            ContactWorld(space, friction=friction),
            points[:2],
            points[2:],
            1e-6,
        )
        query, cycles = task.chain_query(), 3
        on = rng.integers(0, len(query.walls.normals) + query.walls.round, cycles)
        touchers = rng.integers(0, 2, cycles)
        x = query.guess(cycles)
        if query.optimize(x, touchers, on, enough=1e-3, rounds=np.array([20.0])) == np.inf:
            continue
        compared += 1
        work = new_work(cycles, query.walls.dimensions)
        kind = ChainKind(
            touchers,
            on,
            query.start,
            query.goal,
            query.walls.shape,
            query.friction,
            query.margin,
            query.push,
        )
        for phase in (False, True):
            at = np.append(x, 0.02) if phase else x

            def value(at, order=0, phase=phase, kind=kind, work=work):
                slack = at[-1] if phase else np.nan
                return objective(at, slack, 50.0, 1e-3, kind, work, order)

            def gradient(at, value=value, work=work):
                value(at, 1)
                return work.derivatives[-1, : len(at)].copy()

            slopes = gradient(at)
            hessian = work.derivatives[: len(at), : len(at)].copy()
            around = [(at + step * unit, at - step * unit) for unit in np.eye(len(at))]
            plain = [(value(up) - value(down)) / (2 * step) for up, down in around]
            size = max(np.abs(slopes).max(), 1.0)
            np.testing.assert_allclose(slopes, plain, atol=1e-4 * size)
            bends = [(gradient(up) - gradient(down)) / (2 * step) for up, down in around]
            np.testing.assert_allclose(hessian, bends, atol=1e-4 * max(np.abs(hessian).max(), 1.0))
    assert compared


@pytest.mark.parametrize("shape", ["7-gon", "disk"])
def test_nearest_differences_are_members_and_none_is_nearer(shape):
    rng = np.random.default_rng(34)
    for _ in range(12):
        space = SHAPES[shape](rng)
        points = np.array([random_point(rng, space) for _ in range(4)])
        task = SteeringTask(ContactWorld(space), points[:2], points[2:], 1e-6)
        query = task.chain_query()
        cycle = min(nearest_cycles(query, query.before, query.after), key=lambda one: one.distance)
        away, delta = cycle.distance, cycle.after
        assert away == pytest.approx(float(np.linalg.norm(delta - query.after)), abs=1e-9)
        around = [
            delta * query.walls.scale + 2e-7 * np.array([np.cos(a), np.sin(a)])
            for a in np.linspace(0, 6, 16)
        ]
        around = [point for point in around if space.differences.contains(point)]
        assert any(reached_in_two_moves(space, task.before, point) is not None for point in around)
        for angle in np.linspace(0, 2 * np.pi, 24, endpoint=False):
            nearer = query.after + 0.98 * away * rng.random() * np.array(
                [np.cos(angle), np.sin(angle)]
            )
            if away > 1e-6 and space.differences.contains(nearer * query.walls.scale):
                crossing = reached_in_two_moves(space, task.before, nearer * query.walls.scale)
                assert crossing is None or crossing.slack < 1e-6


@pytest.mark.parametrize("friction", [0.7, 1.5, np.inf])
def test_grown_chains_obey_walls_and_friction(friction):
    rng = np.random.default_rng(35)
    found, tries = 0, often(6, 12)
    for _ in range(tries):
        space = random_polygon(rng, sides=6)
        points = np.array([random_point(rng, space) for _ in range(4)])
        task = SteeringTask(ContactWorld(space, friction=friction), points[:2], points[2:], 1e-6)
        query = task.chain_query()
        chain = roadmap_chain(query)
        if chain is None:
            continue
        found += 1
        _, limits = plain_length(query, chain.touchers, chain.walls, chain.unknowns)
        assert limits.min() >= -1e-9
        deltas = chain.differences(query.before, query.after)
        for (before, after), wall, toucher in zip(
            pairwise(deltas), chain.walls, chain.touchers, strict=True
        ):
            push = (1 if toucher == 0 else -1) * (after - before)
            normal = query.walls.normals[wall]
            along = abs(push @ [-normal[1], normal[0]])
            assert (
                along <= friction * -(normal @ push) + 1e-9
                if friction < np.inf
                else -(normal @ push) >= -1e-9
            )
        moves = task.moves_of(chain, query)
        assert moves is not None
        assert task.error(task.world.play(task.start, moves)[-1]) < 1e-6
    assert found >= tries // 2


@pytest.mark.parametrize(
    "space", [prism(regular_polygon(5), 1.0), cylinder(0.5, 0.8)], ids=["prism", "cylinder"]
)
def test_plans_in_space(space):
    rng = np.random.default_rng(36)
    base, no_more, tries = space.base, 0, often(4, 8)
    for _ in range(tries):
        points = np.array(
            [[*random_point(rng, base), rng.random() * space.height] for _ in range(4)]
        )
        episode = steer(SteeringProblem(space, points[:2], points[2:]), planner="greedy")
        assert episode
        flat = steer(SteeringProblem(base, points[:2, :2], points[2:, :2]), planner="greedy")
        no_more += episode.moves <= flat.moves
        assert steer(SteeringProblem(space, points[:2], points[2:])).length <= episode.length + 1e-6
    assert no_more >= tries * 3 // 4


def test_plans_of_the_plane_take_heights():
    rng = np.random.default_rng(39)
    space, raised = prism(SQUARE, 1.0), 0
    for _ in range(12):
        points = np.array([[*random_point(rng, SQUARE), rng.random()] for _ in range(4)])
        task = SteeringTask(ContactWorld(space), points[:2], points[2:], 1e-6)
        below = planar_task(task)
        flat = Shortest().plan(below)
        moves = with_vertical_moves(task, flat)
        if moves is None:
            continue
        raised += 1
        np.testing.assert_array_equal(moves[:, :2], flat)
        assert np.abs(task.world.play(task.start, moves)[-1] - task.goal).max() <= 1e-6
    assert raised >= 9


def test_chains_over_a_circle_beat_random_ones():
    rng = np.random.default_rng(37)
    space = disk(0.5)
    walls = normalize_walls(space)
    for _ in range(4):
        points = walls.normalized(np.array([random_point(rng, space) for _ in range(4)]))
        query = ChainQuery(
            walls, np.ascontiguousarray(points[:2]), np.ascontiguousarray(points[2:])
        )
        best = shortest_chain(query)
        length = np.inf if best is None else best.length
        for _ in range(60):
            cycles = int(rng.integers(1, 4))
            guess = query.guess(cycles)
            guess[:cycles] = rng.random(cycles) * 2 * np.pi * walls.circle[2]
            tried = query.optimize(
                guess,
                rng.integers(0, 2, size=cycles),
                np.zeros(cycles, dtype=np.int64),
                enough=1e-4,
            )
            assert tried >= length - 1e-4


def test_no_way_over_a_circle_is_shorter():
    """Against contacts all around, ever closer to the feet of both points and between them."""
    rng = np.random.default_rng(38)
    for number in range(300):
        near = 10.0 ** -rng.integers(1, 7) if number % 2 else 1.0
        radii = 0.5 - near * 0.5 * rng.random(2)
        s, g = radii * np.exp(
            2j * np.pi * np.array([rng.random(), rng.random() * 10.0 ** -rng.integers(0, 4)])
        )
        best = np.inf
        for foot in (np.angle(s), np.angle(g), np.angle(s + g)):
            for width in 10.0 ** -np.arange(8):
                contacts = 0.5 * np.exp(1j * (foot + np.linspace(-4, 4, 401) * width))
                best = min(best, float(np.min(np.abs(contacts - s) + np.abs(contacts - g))))
        found = length_over_circle(np.array([s.real, s.imag]), np.array([g.real, g.imag]), 0.5)
        assert abs(s - g) - 1e-12 <= found <= best + 1e-9
