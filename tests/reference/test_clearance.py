"""Plans of every planner in every class of workspace, in a replay that shares no code with the
planners.
"""

from __future__ import annotations

import numpy as np
import pytest
from tests.reference import replay
from tests.reference.test_steering import random_polygon
from tests.soak import often
from tests.steering import steer

from shoal.steering import (
    ContactWorld,
    Region,
    SteeringProblem,
    cylinder,
    disk,
    polygon,
    prism,
    region,
    regular_polygon,
)
from shoal.steering.contact.clearance import why_sensitive
from shoal.steering.planners import annealing, sampling
from shoal.steering.planners.task import worthwhile
from shoal.steering.workspaces.formats import describe

SQUARE = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])
TURNS = [
    replay.Turned(),
    replay.Turned(0.7, 37.3, (1.1, -5.0)),
    replay.Turned(-1.234, 1e-3, (0.2, 0.1)),
]
TOUCHES = (1e-9, 1e-8, 1e-7, 3e-7, 1e-6)  # relative to the size
LEAVINGS = (replay.LEAVING, 0.0)  # with 0, rounding decides whether a move along a wall holds
INSTANCES = often(1, 2)  # of each class
U_SHAPE = region([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)])
YARD = region([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1.5, 1.5), (2.5, 1.5), (2.5, 2.5), (1.5, 2.5)]])
CHAINS = ("greedy", "shortest", "fewest-moves")
CLASSES = {
    "square": (lambda _rng: SQUARE, (*CHAINS, "robust", "sampling"), {}),
    "triangle": (lambda _rng: regular_polygon(3), CHAINS, {}),
    "many sides": (lambda rng: regular_polygon(int(rng.integers(13, 61))), CHAINS, {}),
    "polygon": (random_polygon, (*CHAINS, "sampling"), {}),
    "disk": (lambda _rng: disk(0.5), (*CHAINS, "sampling"), {}),
    "prism": (lambda _rng: prism(regular_polygon(5), 1.0), CHAINS, {}),
    "cylinder": (lambda _rng: cylinder(0.5, 0.8), CHAINS, {}),
    "friction": (lambda _rng: SQUARE, ("greedy", "shortest"), {"friction": 1.0, "max_moves": 1000}),
    "friction on a disk": (
        lambda _rng: disk(0.5),
        ("greedy", "shortest"),
        {"friction": 1.0, "max_moves": 1000},
    ),
    "radius": (lambda _rng: SQUARE, ("sampling",), {"particle_radius": 0.02}),
    "a U": (lambda _rng: U_SHAPE, ("sampling", "robust"), {}),
    "an obstacle": (lambda _rng: YARD, ("sampling",), {}),
    "walls": (lambda _rng: SQUARE, CHAINS, {}),
    "three particles": (lambda _rng: SQUARE, ("sampling",), {}),
}


def random_problem(rng, name):
    """A random problem of a class."""
    make, _, fields = CLASSES[name]
    space, radius = make(rng), fields.get("particle_radius", 0.0)
    count = 3 if name == "three particles" else 2
    while True:
        points = np.array([place(rng, space, name == "walls", radius) for _ in range(2 * count)])
        start, goal = points[:count], points[count:]
        if all(np.linalg.norm(two[1] - two[0]) > 2 * radius for two in (start, goal)):
            return SteeringProblem(space, start, goal, 1e-6 * space.size).replaced(**fields)


def worst_error(episode):
    """The largest error of all replays with other contact tolerances and another bound between
    holding and leaving, turned and scaled.
    """
    problem = episode.problem
    form = describe(problem.place)
    rules = {"friction": problem.friction, "radius": problem.particle_radius}
    start, goal, moves = problem.start.tolist(), episode.goal.tolist(), episode.inputs.tolist()
    return max(
        replay.error_of(
            form, start, goal, moves, touch=touch, turned=turned, leaving=leaving, **rules
        )
        for turned in TURNS
        for touch in TOUCHES
        for leaving in LEAVINGS
    )


def place(rng, space, on_wall, radius):
    while True:
        if on_wall and rng.random() < 0.5:
            edge = space.edges[int(rng.integers(len(space.edges)))]
            return edge[:2] + rng.choice([0.0, 0.5, rng.random()]) * (edge[2:] - edge[:2])
        low, high = space.bounds
        point = rng.uniform(low, high)
        flat = space.base if space.dimensions == 3 else space
        if flat.contains(point) and flat.depth(point) > 1.1 * radius:
            return np.append(point, rng.random() * space.height) if space.dimensions == 3 else point


@pytest.fixture
def small_searches(monkeypatch):
    monkeypatch.setattr(sampling, "MORE_TREES", 3)
    monkeypatch.setattr(annealing, "STAGES", ((4, 500), (2, 2000)))


@pytest.mark.parametrize("name", CLASSES)
def test_solved_plans_arrive_in_another_arithmetic(name, small_searches):
    rng = np.random.default_rng(5)
    solved = 0
    for _ in range(INSTANCES):
        problem = random_problem(rng, name)
        for planner in CLASSES[name][1]:
            episode = steer(problem, planner=planner)
            if episode.status == "solved":
                solved += 1
                assert worst_error(episode) <= episode.problem.tolerance * 1.0001, (
                    planner,
                    problem,
                )
            else:
                assert episode.status in ("unreachable", "approachable") or planner == "sampling", (
                    planner,
                    episode.reason,
                )
    assert solved >= 1


# Today's failures before the clearance: found among random problems.
FAILED = [
    (
        regular_polygon(57, radius=1.0),
        [(0.027, -0.259), (0.02, -0.416)],
        [(-0.117, -0.358), (0.468, 0.504)],
        "shortest",
    ),
    (
        U_SHAPE,
        [(0.3716414746830746, 1.912577993748702), (0.484592080959802, 2.5593477054200813)],
        [(1.3560441118368618, 0.5171030540034162), (2.292866737523144, 2.630409063870139)],
        "sampling",
    ),
    (
        SQUARE,
        [(0.2, 0.4), (0.85, 0.5)],
        [(0.9444444444444444, 0.05555555555555558), (0.15, 0.55)],
        "greedy",
    ),
    (
        cylinder(0.5, 0.8),
        [
            (-0.39768480006450047, 0.2256257677157506, 0.6237654588015336),
            (-0.3645140325480277, 0.10093113103280638, 0.3964557080882199),
        ],
        [
            (0.11755861390150302, -0.36865815767198784, 0.7294650523088938),
            (-0.1595901221714333, 0.003501272156628321, 0.5435900478403983),
        ],
        "shortest",
    ),
]


@pytest.mark.parametrize(
    ("space", "start", "goal", "planner"), FAILED, ids=["60 sides", "U", "slide", "one tolerance"]
)
def test_plans_that_were_sensitive_arrive_now(space, start, goal, planner, small_searches):
    episode = steer(SteeringProblem(space, start, goal, planner=planner))
    assert episode.status == "solved"
    assert episode.verify()
    assert worst_error(episode) <= episode.problem.tolerance


def test_particles_keep_away_from_corners_that_they_pass(small_searches):
    episode = steer(SteeringProblem(U_SHAPE, *FAILED[1][1:3], planner="sampling", clearance=1e-4))
    assert episode.status == "solved"
    corners = np.array([(1.0, 1.0), (2.0, 1.0)])
    for before, after in zip(episode.states, episode.states[1:], strict=False):
        for share in np.linspace(0, 1, 2001)[:, None, None]:
            path = before + share * (after - before)
            assert (
                np.linalg.norm(path[:, :, None] - corners.T[None], axis=1).min()
                > 0.9e-4 * U_SHAPE.size
            )


def test_the_replay_itself_follows_the_rules():
    square, yard = describe(SQUARE), describe(YARD)
    assert replay.end_of(square, [(0.25, 0.5), (0.5, 0.5)], [(-0.5, 0.25)]) == [
        (0.0, 0.625),
        (0.0, 0.75),
    ]
    slid = replay.end_of(square, [(0.0, 0.5), (0.5, 0.5)], [(-0.25, 0.25)], friction=0.25)
    assert np.allclose(slid, [(0.0, 0.6875), (0.25, 0.75)])
    assert replay.end_of(yard, [(1.0, 2.0), (0.5, 0.5)], [(2.0, 0.0)]) == [(1.5, 2.0), (2.5, 0.5)]
    assert replay.end_of(yard, [(1.5, 1.5), (2.0, 1.5)], [(0.25, -0.5)]) == [
        (1.75, 1.0),
        (2.25, 1.0),
    ]
    # Within the contact tolerance of a wall, a particle is held.
    assert replay.end_of(square, [(5e-7, 0.5)], [(0.0, 0.25)], touch=1e-6) == [(5e-7, 0.5)]
    assert replay.end_of(square, [(5e-7, 0.5)], [(0.0, 0.25)], touch=1e-7) == [(5e-7, 0.75)]
    balls = replay.end_of(square, [(0.1, 0.5), (0.3, 0.5)], [(-0.5, 0.0)], radius=0.1)
    assert np.allclose(balls, [(0.1, 0.5), (0.3, 0.5)])


def test_more_moves_are_worth_a_thousandth():
    assert worthwhile([(3, 1.0), (5, 0.9995)]) == 0
    assert worthwhile([(3, 1.0), (5, 0.9985)]) == 1
    assert worthwhile([(5, 0.9), (3, 1.0)], by_moves=True) == 1
    rng = np.random.default_rng(2)
    for _ in range(200):
        sizes = [(int(rng.integers(1, 9)), 1 + 0.004 * rng.random()) for _ in range(6)]
        best = sizes[worthwhile(sizes)]
        assert all(best[1] <= length * 0.999 for moves, length in sizes if moves < best[0])


def test_two_contacts_of_one_particle_with_one_wall_are_not_always_one():
    """A wall of length 1: the other particle goes from far right of the toucher to far
    left of it.
    """
    # of the contacts on the floor, for which the other particle is inside
    low = [max(0.0, -delta) for delta in (0.9, 0.0, -0.9)]
    high = [min(1.0, 1 - delta) for delta in (0.9, 0.0, -0.9)]
    assert max(low[0], low[2]) > min(high[0], high[2])  # no contact suits the start and the goals
    assert max(low[:2]) <= min(high[:2])
    assert max(low[1:]) <= min(high[1:])


def test_a_planner_that_plans_without_room_is_not_believed():
    class Blunt:
        name = "blunt"

        def plan(self, task):
            return np.array([(-0.2 + 5e-10, 0.0), (0.0, 0.25), (0.3, 0.0)])

    problem = SteeringProblem(
        SQUARE, [(0.2, 0.5), (0.4, 0.5)], [(0.3 + 5e-10, 0.5), (0.5 + 5e-10, 0.75)]
    )
    episode = steer(problem, planner=Blunt())
    assert episode.status == "sensitive"
    assert episode.report()["sensitive"]
    assert steer(problem, planner=Blunt(), clearance=0.0).status == "solved"
    assert isinstance(U_SHAPE, Region)


# The clearance excludes the shortest chain, although the plan of this chain keeps it: found among
# random places on walls.
NEAR_WALLS = [
    (
        regular_polygon(3),
        [(0.0, 0.5), (-0.00957336592610708, -0.25)],
        [(0.0, -0.25), (-0.377042583776407, -0.15305691171778124)],
        0.5,
    ),
    (
        regular_polygon(5),
        [(-0.47552825814757677, 0.15450849718747375), (0.47552825814757677, 0.1545084971874737)],
        [(-0.21698134489520554, -0.1527953939721971), (-0.2938926261462366, -0.40450849718747367)],
        2.0,
    ),
    (
        regular_polygon(5),
        [(-0.2938926261462366, -0.40450849718747367), (-0.4503113053857528, 0.07689869681468205)],
        [(0.2377641290737884, 0.32725424859373686), (0.29389262614623657, -0.4045084971874737)],
        2.0,
    ),
    (
        SQUARE,
        [(1.0, 0.49372641345088586), (0.30010250109333725, 1.0)],
        [(0.5, 0.0), (1.0, 1.0)],
        2.0,
    ),
]


@pytest.mark.parametrize(
    ("space", "start", "goal", "friction"),
    NEAR_WALLS,
    ids=["3 sides", "5 sides", "corner", "square"],
)
def test_the_clearance_does_not_make_plans_needlessly_longer(space, start, goal, friction):
    episode = steer(
        SteeringProblem(space, start, goal, planner="shortest", friction=friction, max_moves=1000)
    )
    assert episode.status == "solved"
    assert worst_error(episode) <= episode.problem.tolerance * 1.0001
    exact = steer(episode.problem, clearance=0.0)
    assert episode.length <= 1.002 * exact.length


@pytest.mark.parametrize("seed", [1006, 1018])
def test_sampling_with_friction_keeps_the_plans_that_it_finds_without_the_clearance(seed):
    rng, space, points = np.random.default_rng(seed), regular_polygon(6), []
    while len(points) < 4:
        point = rng.uniform(*space.bounds)
        if space.contains(point) and space.depth(point) > 0.02:
            points.append(point)
    fields = {"planner": "sampling", "friction": 1.0, "max_moves": 1000}
    episode = steer(SteeringProblem(space, points[:2], points[2:], **fields))
    assert episode.status == "solved"
    assert worst_error(episode) <= episode.problem.tolerance * 1.0001
    assert episode.length <= 1.1 * steer(episode.problem, clearance=0.0).length


CORRIDOR = region(
    [
        (0, 0),
        (0.9, 0),
        (0.9, 0.37),
        (1.1, 0.37),
        (1.1, 0),
        (2, 0),
        (2, 1),
        (1.1, 1),
        (1.1, 0.45),
        (0.9, 0.45),
        (0.9, 1),
        (0, 1),
    ]
)
TRIANGLE_INSIDE = region(
    [(0, 0), (4, 0), (4, 4), (0, 4)], [[(2.707, 2.0634), (3.0538, 1.973), (2.9587, 2.3185)]]
)
# of two places near walls, no move leads both off all walls that they are within the clearance of
NEAR_CORNERS = [
    (TRIANGLE_INSIDE, [(8e-7, 3.999996), (2.93, 2.289471)], [(1.67, 0.007), (2.28, 1.7)]),
    (U_SHAPE, [(0.999999, 2.999997), (2.775, 1e-8)], [(1.3189, 0.9999995), (0.999999996, 2.9982)]),
    (CORRIDOR, [(0.72, 0.797), (0.303, 0.53)], [(1.547, 0.85), (1.595, 0.49)]),
]


@pytest.mark.parametrize(
    ("space", "start", "goal"), NEAR_CORNERS, ids=["an obstacle", "a U", "a corridor"]
)
def test_sampling_finds_plans_between_walls(space, start, goal, small_searches):
    episode = steer(SteeringProblem(space, start, goal, planner="sampling"))
    assert episode.status == "solved", episode.reason
    assert worst_error(episode) <= episode.problem.tolerance * 1.0001


FLAT = [
    (
        [
            (0.9983, 0.0124),
            (0.8279, 0.12),
            (-0.108, 0.2128),
            (-0.7874, -0.1319),
            (-0.6488, -0.1629),
            (-0.5876, -0.1732),
            (0.9739, -0.0486),
        ],
        [(-0.38, 0.042), (-0.07, 0.146)],
        [(0.201, 0.125), (0.107, 0.009)],
    ),
    (
        [
            (0.804, 0.0621),
            (0.4418, 0.0937),
            (0.3772, 0.0968),
            (-0.4162, 0.095),
            (-0.8976, 0.0461),
            (0.6076, -0.083),
        ],
        [(0.098, 0.005), (-0.166, 0.037)],
        [(0.153, 0.059), (0.226, -0.039)],
    ),
]


@pytest.mark.parametrize("corners_start_goal", FLAT, ids=["7 sides", "6 sides"])
@pytest.mark.parametrize("planner", ["shortest", "auto", "fewest-moves", "sampling"])
def test_no_time_limit_makes_a_plan_longer_than_that_of_greedy(planner, corners_start_goal):
    corners, start, goal = corners_start_goal
    problem = SteeringProblem(polygon(corners), start, goal)
    greedy = steer(problem, planner="greedy")
    hurried = steer(problem, planner=planner, time=1e-6)  # over when planning begins
    assert greedy.status == hurried.status == "solved"
    assert (
        hurried.moves <= greedy.moves
        if planner == "fewest-moves"
        else hurried.length <= 1.001 * greedy.length
    )


# The clearance added a tiny move off a wall: a move more than a plan that is as long, or a longer
# plan with as many moves.
HEXAGON = polygon(
    [
        (0.43784298800144994, -0.8990514545107873),
        (0.9975228929164164, -0.07034257677725414),
        (0.559679904914967, 0.8287088777335335),
        (-0.43784298800144994, 0.8990514545107873),
        (-0.9975228929164164, 0.07034257677725414),
        (-0.559679904914967, -0.8287088777335335),
    ]
)
TINY_MOVES = [
    (
        polygon([(0, 0), (10, 0), (10, 10), (0, 10)]),
        [(3.4546, 3.5625), (6.8272, 1.4666)],
        [(6.9485, 4.8186), (3.1624, 8.2891)],
        1e-5,
    ),
    (
        prism(HEXAGON, 0.5),
        [
            (0.53576395168198, 0.43772471937826873, 0.11057476701202051),
            (0.18152258476536265, 0.4881322690831891, 0.033250274399370894),
        ],
        [
            (-0.5033041763597434, -0.046689767434167306, 0.05453537406979708),
            (0.4193549544687264, 0.6960395178487455, 0.39590972496526167),
        ],
        1e-6,
    ),
]


@pytest.mark.parametrize(
    ("space", "start", "goal", "tolerance"), TINY_MOVES, ids=["square", "prism"]
)
def test_the_clearance_adds_no_tiny_moves(space, start, goal, tolerance):
    problem = SteeringProblem(space, start, goal, tolerance)
    shortest, fewest = (steer(problem, planner=planner) for planner in ("shortest", "fewest-moves"))
    exact = steer(problem, planner="fewest-moves", clearance=0.0)
    for episode in (shortest, fewest):
        assert worst_error(episode) <= tolerance * 1.0001
        assert episode.moves == exact.moves == 4
        assert episode.length <= 1.001 * exact.length


def test_moves_that_can_be_merged_are_merged():
    class Slow:
        name = "slow"

        def plan(self, task):
            return np.array(
                [
                    (-0.1, 0.0),
                    (-0.05, 0.0),
                    (-0.05, 0.0),
                    (-1e-8, 0.25),
                    (0.1, 0.0),
                    (0.1, 0.1),
                    (0.1, -0.1),
                ]
            )

    problem = SteeringProblem(SQUARE, [(0.2, 0.5), (0.4, 0.5)], [(0.3, 0.5), (0.5, 0.75)])
    episode = steer(problem, planner=Slow())
    assert episode.status == "solved"
    assert episode.moves == 3


def test_a_particle_that_hardly_leaves_a_round_wall_is_sensitive():
    world = ContactWorld(disk(0.5))
    start = np.array([(0.0, -0.5), (0.0, 0.1)])
    for slope, sensitive in ((1e-8, True), (1e-5, False)):
        moves = np.array([(0.3, 0.3 * slope)])
        goal = world.final(start, moves)
        reason = why_sensitive(world, start, goal, moves, 1e-6, 1e-6)
        assert (reason is not None and "slope" in reason) == sensitive, reason
