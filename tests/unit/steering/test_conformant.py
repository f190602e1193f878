"""Plans without observations for stated errors, and friction in regions with obstacles."""

import json

import numpy as np
import pytest
from tests.without_compiler import printed

from shoal.core.errors import InvalidInputError
from shoal.steering import SteeringProblem, open_workspace, polygon, region
from shoal.steering.contact.world import ContactWorld, RegionWorld
from shoal.steering.planners.bounds import Bounds
from shoal.steering.run import run
from shoal.steering.workspaces.region import Region

START, GOAL = [(0.2, 0.3), (0.5, 0.35)], [(0.6, 0.2), (0.7, 0.4)]
STATED = {"friction_at_least": 1.0, "angle_error": 1.0, "gain_error": 0.01}


@pytest.mark.parametrize("friction", [0.0, 0.3, 1.0, 4.0])
def test_a_region_without_obstacles_slides_like_a_convex_workspace(friction):
    rng = np.random.default_rng(3)
    for _ in range(60):
        angles = np.sort(rng.uniform(0, 2 * np.pi, 6))
        if np.diff(angles).max() > np.pi or np.diff(angles).min() < 0.05:
            continue
        space = polygon(np.column_stack([np.cos(angles), np.sin(angles)]))
        points = np.stack([space.middle, 0.9 * space.middle + 0.1 * space.vertices[0]])
        moves = rng.normal(size=(4, 2))
        same = RegionWorld(Region(space.vertices, ()), friction=friction).final(points, moves)
        assert same == pytest.approx(
            ContactWorld(space, friction=friction).final(points, moves), abs=1e-9
        )


def test_a_particle_slides_off_the_end_of_an_obstacle():
    yard = region([(0, 0), (4, 0), (4, 4), (0, 4)], [[(1, 1), (3, 1), (3, 2), (1, 2)]])
    world = RegionWorld(yard, friction=0.5)
    # it slides by |T u| - .5 |N u|: of (2, -1), 3/4 of the way along the top, 1.5 per input; after
    # 2/3 of the input it leaves the corner (3, 2) and makes the last third freely
    end = world.step([(2.0, 2.0)], (2.0, -1.0))[0]
    assert end == pytest.approx((3 + 2 / 3, 2 - 1 / 3))
    # it meets the top after half of the input and is held: the push is steeper than the cone
    assert world.step([(2.0, 2.5)], (0.2, -1.0))[0] == pytest.approx((2.1, 2.0))
    # it slides into the corner of the yard, where both walls hold it
    assert world.step([(0.5, 0.4)], (-1.0, -1.0))[0] == pytest.approx((0.0, 0.0))


def simulated(problem, episode, *, friction, seed):
    """Where the particles end with errors, by the world of the problem, one particle at a time."""
    rng = np.random.default_rng(seed)
    world = problem.replaced(friction_at_least=None, friction=friction).world()
    points, own = episode.states[0].copy(), 1 + problem.gain_error * rng.normal(size=2)
    for move in episode.inputs:
        length = 1 + problem.gain_error * rng.normal()
        angle = np.radians(problem.angle_error * rng.normal())
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        sent = length * turn @ move
        for k in range(2):
            points[k] = world.step(points[k : k + 1], own[k] * sent)[0]
    return float(np.linalg.norm(points - episode.goal, axis=1).max())


@pytest.mark.parametrize("obstacles", [False, True])
def test_a_plan_holds_for_all_friction_above_the_bound_and_for_errors(obstacles):
    place = open_workspace("square")
    if obstacles:
        place = region(place.vertices, [[(0.45, 0.75), (0.55, 0.75), (0.55, 0.85), (0.45, 0.85)]])
    problem = SteeringProblem(place, START, GOAL, **STATED)
    episode = run(problem)
    assert episode.status == "solved", episode.reason
    assert episode.verify()
    errors = [
        simulated(problem, episode, friction=friction, seed=seed)
        for friction in (1.0, 2.5)
        for seed in range(60)
    ]
    assert np.mean(np.array(errors) <= 0.05 * place.size) >= 0.9
    report = episode.report()
    assert report["holding_share"] >= 0.9
    # the check can fail: a world with less friction than stated
    slippery = [simulated(problem, episode, friction=0.1, seed=seed) for seed in range(20)]
    assert np.mean(np.array(slippery) <= 0.05 * place.size) < 0.9


def test_goals_that_no_plan_reaches_with_the_least_friction_are_refused():
    problem = SteeringProblem("square", START, [(0.1, 0.1), (0.9, 0.9)], friction_at_least=0.5)
    episode = run(problem)
    assert (episode.status, episode.moves) == ("unreachable", 0)
    assert "friction 0.5" in episode.reason
    report = episode.report()
    assert report["holding_share"] is None
    assert 0.5 < report["unreachable_share"] < 1
    json.dumps(report)


def test_goals_that_can_only_be_approached_have_a_plan_within_the_tolerance():
    goal = [(0.5, 0.4), (0.5, 0.64)]
    exact = run(SteeringProblem("square", [(0.3, 0.4), (0.6, 0.45)], goal, friction=0.5))
    assert exact.status == "unreachable"  # as near as 1e-3 of the size
    stated = {"friction_at_least": 0.5, "angle_error": 0.2, "gain_error": 0.002}
    problem = SteeringProblem("square", [(0.3, 0.4), (0.6, 0.45)], goal, **stated)
    episode = run(problem)
    assert episode.status == "solved", episode.reason
    errors = [simulated(problem, episode, friction=0.5, seed=seed) for seed in range(20)]
    assert np.mean(np.array(errors) <= 0.05) >= 0.9
    assert min(errors) > 0.005


def test_a_narrower_cone_leaves_room_for_errors_of_the_angle():
    assert Bounds(1.0).cone() == pytest.approx(1.0)
    assert Bounds(1.0, np.radians(1)).cone(2) == pytest.approx(np.tan(np.radians(43)))
    assert Bounds(np.inf, np.radians(1)).cone(2) == pytest.approx(np.tan(np.radians(86)))
    assert Bounds(0.01, np.radians(1)).cone(2) == 0


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"friction_at_least": 1, "friction": 0.5}, "at most the friction, 0.5, got 1"),
        ({"angle_error": 1, "planner": "shortest"}, "planner: expected auto or conformant"),
        ({"gain_error": 0.01, "execution": 0.1}, "expected no execution"),
        ({"gain_error": 0.01, "start": [(0.1, 0.1)] * 3, "goal": "random"}, "expected 2 particles"),
    ],
)
def test_stated_errors_that_contradict_other_fields_are_refused(fields, message):
    with pytest.raises(InvalidInputError, match=message):
        run(SteeringProblem("square", **fields))


COMPARED = """
import numpy as np
from shoal.steering import region
from shoal.steering.contact.world import RegionWorld
from shoal.steering.planners.bounds import Bounds
from shoal.steering.planners import pressing
from shoal.steering.planners.pressing import PressingSearch, pressing_of

pressing.CELLS = 10
yard = region([(0, 0), (1, 0), (1, 0.5), (0.5, 0.5), (0.5, 1), (0, 1)])
bounds = Bounds(1.0, 0.02, 0.01)
search = PressingSearch(
    RegionWorld(yard, friction=1.0), pressing_of(bounds, 1.0), np.random.default_rng(1)
)
start, goal = np.array([[0.2, 0.3], [0.3, 0.8]]), np.array([[0.3, 0.3], [0.35, 0.6]])
plans = search.plans(start, goal, tolerance=0.01, moves=20, rounds=400, most=1)
scenarios = bounds.scenarios(4, 3, np.random.default_rng(2))
moves = np.array([[-0.4, 0.1], [0.2, -0.5], [0.6, 0.3]])
print([plan.round(9).tolist() for plan in plans])
print(search.ends(start, moves, scenarios).round(9).tolist())
"""


def test_the_search_is_the_same_without_the_compiler():
    assert printed(COMPARED, compiled=True) == printed(COMPARED, compiled=False)
