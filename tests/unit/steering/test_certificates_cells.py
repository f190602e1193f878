"""Certificates for regions and in three dimensions: cells, routes, bounds below all plans, wrong ones refused."""

from __future__ import annotations

import ast
import copy
import json
from dataclasses import replace
from pathlib import Path
from time import process_time

import numpy as np
import pytest

from shoal.steering import (
    SteeringProblem,
    certificates,
    certify,
    check_certificate,
    cylinder,
    polygon,
    prism,
    region,
)
from shoal.steering.certificates import check_certificate_of
from shoal.steering.certificates.cells import cells_of_place
from shoal.steering.certificates.geodesics import geodesic_bound
from shoal.steering.certificates.route_search import RouteSearch
from shoal.steering.run import run
from shoal.steering.workspaces.convex import signed_area

pytest.importorskip("clarabel")

ELL = region([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)])
BLOCK = [(0.8, 0.5), (1.2, 0.5), (1.2, 0.9), (0.8, 0.9)]
ONE = region([(0, 0), (2, 0), (2, 1.4), (0, 1.4)], [BLOCK])


@pytest.fixture(scope="module")
def around():
    """A certificate with an obstacle, which both particles can pass on both sides."""
    problem = SteeringProblem(ONE, [(0.2, 0.3), (0.5, 0.35)], [(1.6, 1.2), (1.4, 0.8)], time=0.5)
    return problem, certify(run(problem), seconds=1, clock=process_time)


def test_an_obstacle_has_a_proof(around):
    problem, found = around
    alone = geodesic_bound(problem, problem.start, problem.goal)
    assert found.lower_bound > 1.005 * alone
    assert found.episode.length >= found.lower_bound
    proof = json.loads(json.dumps(found.proof))
    assert len(proof["trees"][0]["proof"]["ways"]) > 1  # ways around both sides
    assert check_certificate_of(problem, proof)
    assert not check_certificate_of(SteeringProblem(ELL, problem.start, problem.start), proof)


@pytest.mark.parametrize("unit", [1.0, 1e-9])
@pytest.mark.parametrize(
    ("start", "goal", "least"),
    [
        ([(1.95, 0.5), (0.5, 0.5)], [(1.95, 0.5), (0.3, 0.5)], 0.2),
        ([(0.0, 0.0), (0.5, 0.5)], [(0.0, 0.0), (0.45, 0.45)], 0.05 * 2**0.5),
        ([(1.8, 0.5), (0.1, 0.2)], [(1.8, 0.5), (0.1, 0.2)], 0.0),
    ],
)
def test_a_particle_that_stays_needs_no_path(unit, start, goal, least):
    """The bounds of these problems counted a way there and back, through some corner."""
    place = region(unit * np.array([(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]))
    start, goal = unit * np.array(start), unit * np.array(goal)
    problem = SteeringProblem(place, start, goal, friction=5.0, tolerance=1e-6 * unit)
    assert geodesic_bound(problem, start, goal) == pytest.approx(least * unit, abs=2e-6 * unit)
    if unit == 1.0 and least < 0.1:
        found = certify(run(problem), seconds=1)
        assert found.lower_bound <= found.episode.length + 1e-12


def test_a_bound_of_nothing_needs_no_proof():
    """If goals are nearer than the tolerance, multipliers prove a little less than 0."""
    place = region([(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)])
    start = [(3.0, 1.7315788553558673), (2.0, 3.0)]
    goal = [(2.75075847285828, 2.276882060253171), (2.184149362801606, 2.428333365199679)]
    found = certify(run(SteeringProblem(place, start, goal, tolerance=0.6, time=0.5)), seconds=1)
    assert found.lower_bound == 0
    proof = json.loads(json.dumps(found.proof))
    assert check_certificate(proof)
    assert not check_certificate(proof | {"lower_bound": 1e-6})


def _first_leaf(proof):
    return next(node for node in proof["trees"][0]["proof"]["ways"][0]["proof"] if "norms" in node)


_DIVISION = {"place": 0, "known": [], "side": "first"}


def _way(proof):
    return proof["trees"][0]["proof"]["ways"][0]


def _cover(proof):
    return proof["trees"][0]["proof"]["covers"][0]


def _turned(proof):
    return [[x + 2.0, y] for x, y in _first_leaf(proof)["norms"]]


def _without_tree(proof):
    proof["trees"][0]["proof"]["ways"].pop()


def _without_closed(proof):
    proof["trees"][0]["proof"]["covers"][0]["closed"].pop()


def _closed_short(proof):
    for leaf in proof["trees"][0]["proof"]["covers"][0]["closed"]:
        leaf["norms"] = [[0.0, 0.0] for _ in leaf["norms"]]


def _heavy_leg(proof):
    leaf = _first_leaf(proof)
    leaf["legs"] = [weight + 0.5 for weight in leaf["legs"]]


def _without_cell(proof):
    proof["cells"].pop()


def _other_start(proof):
    proof["trees"][0]["proof"]["covers"][0]["cell"] = (
        proof["trees"][0]["proof"]["covers"][0]["cell"] + 1
    ) % 4


def _free_door(proof):
    """An obstacle less, with its place in a cell."""
    proof["rings"].pop()
    proof["cells"] = [[0, 1, 2, 3]]


def _only_closed(proof):
    """No plan goes through a closed door within the limit; with limit 0, this says nothing."""
    proof.update(limit=0.0, start=[[0.2, 0.3], [0.2, 0.3]], goal=[[1.9, 1.3], [1.9, 1.3]])
    cells = cells_of_place(ONE, np.zeros(1), 0.0)
    cell = cells.cell_of(np.array([0.2, 0.3]))
    nothing = {"norms": [[0.0, 0.0]] * 5, "slacks": [], "legs": [0.0]}
    closed = [{"node": 0, "door": door, **nothing} for door in cells.doors_of[cell]]
    cover = {"cell": cell, "nodes": [], "closed": closed}
    proof["trees"] = [{"order": [1, 2], "proof": {"covers": [cover, cover], "ways": []}}]


WRONG = {
    "only closed doors": _only_closed,
    "unit": lambda proof: proof.update(unit=0.0),
    "text": lambda proof: proof.update(lower_bound="1e999999999"),
    "not a number": lambda proof: proof.update(limit=float("nan")),
    "deep": lambda proof: proof.update(start=[[[[[0.0]]]]]),
    "no limit": lambda proof: proof.pop("limit"),
    "corners": lambda proof: proof["rings"].append([[9 + k / 4096, k % 2] for k in range(2000)]),
    "numbers": lambda proof: proof.update(directions=[[0.0] * 100_001]),
    "cover": lambda proof: _cover(proof).update(nodes=[[0, 0]] * 1001),
    "orders": lambda proof: proof["trees"][0].update(order=[2, 1]),
    "missing cases": lambda proof: _way(proof).update(proof=[_DIVISION] * 1000),
    "one norm": lambda proof: _first_leaf(proof)["norms"].pop(),
    "long norm": lambda proof: _first_leaf(proof).update(norms=_turned(proof)),
    "negative": lambda proof: _first_leaf(proof)["slacks"].append([0, -1.0]),
    "no constraint": lambda proof: _first_leaf(proof)["slacks"].append([10**9, 1.0]),
    "fine": lambda proof: _first_leaf(proof)["slacks"].append([0, 2.0**-40]),
    "no item": lambda proof: _way(proof).update(proof=[_DIVISION | {"place": 7}]),
    "no hold": lambda proof: _way(proof).update(proof=[_DIVISION | {"known": [[999, 0]]}]),
    "no node": lambda proof: _way(proof).update(proof=[5]),
    "end": lambda proof: _way(proof).update(ends=[0, 999]),
    "higher": lambda proof: proof.update(lower_bound=proof["lower_bound"] * 1.001),
    "limit": lambda proof: proof.update(limit=proof["limit"] * 1.5),
    "no tree": _without_tree,
    "no closed door": _without_closed,
    "closed though short": _closed_short,
    "leg": _heavy_leg,
    "no cell": _without_cell,
    "start": _other_start,
    "no obstacle": _free_door,
    "hull": lambda proof: proof["hull"].append([2, 1]),
    "tolerance": lambda proof: proof.update(tolerance=-1.0),
    "dimensions": lambda proof: proof.update(height=1.0),
    "no case": lambda proof: proof["trees"][0]["proof"]["ways"][0].update(proof=[]),
    "nothing": lambda proof: proof["trees"].clear(),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_certificates_are_refused(around, name):
    proof = copy.deepcopy(around[1].proof)
    WRONG[name](proof)
    checked = check_certificate(proof)
    assert not checked
    assert checked.message.startswith("the certificate is ")


def test_the_checkers_use_nothing_of_the_search():
    folder = Path(certificates.__file__).parent
    checkers = "check", "check_contacts", "check_moves", "check_potential", "check_routes"
    for name in (*checkers, "verdict"):
        tree = ast.parse((folder / f"{name}.py").read_text())
        used = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
        used |= {
            x.name for node in ast.walk(tree) if isinstance(node, ast.Import) for x in node.names
        }
        shoal = {module for module in used if module.startswith("shoal")}
        assert shoal <= {
            "shoal.core.episode",
            *(f"shoal.steering.certificates.{x}" for x in checkers),
        }


@pytest.mark.parametrize(("place", "seed"), [(ELL, 0), (ONE, 2)])
def test_no_plan_is_shorter_than_a_bound(place, seed):
    found = certify(run(SteeringProblem(place, time=0.5), seed=seed), seconds=1)
    start, goal = SteeringProblem(place).endpoints(seed)
    assert check_certificate(found.proof)
    other = run(SteeringProblem(place, start, goal, time=0.4), seed=1)
    assert not other or other.length >= found.lower_bound


@pytest.mark.parametrize("place", [ELL, ONE])
def test_random_moves_are_not_shorter_than_a_bound_for_where_they_end(place):
    rng = np.random.default_rng(3)
    problem, cells, compared = SteeringProblem(place), cells_of_place(place, np.zeros(1), 0.0), 0
    world = problem.world(gain=0.0)
    for number in range(5):
        start, _ = problem.endpoints(number)
        moves = rng.normal(size=(rng.integers(1, 5), 2)) * 0.5
        length = float(np.linalg.norm(moves, axis=1).sum())
        search = RouteSearch(cells, start, world.play(start, moves)[-1], 1e-6, 1.3 * length)
        for _ in range(6 if search.trees else 0):
            search.step(lambda: 0.0)
            compared += search.lower > 0.5 * length
            assert search.lower <= length * (1 + 1e-9)
    assert compared


def test_a_bound_is_not_above_a_plan_that_goes_around():
    """Both particles go around one obstacle without any contact: the bound is the way."""
    problem = SteeringProblem(ONE, [(0.3, 0.7), (0.4, 0.7)], [(1.6, 0.7), (1.7, 0.7)], time=0.5)
    found = certify(run(problem), seconds=1)
    way = np.hypot(0.4, 0.2) + 0.4 + np.hypot(0.5, 0.2)  # of particle 2, past the lower side
    assert way - 1e-5 <= found.lower_bound <= found.episode.length


def test_a_longer_plan_around_an_obstacle_becomes_shorter(around):
    problem, found = around
    way = np.array([[0.05, 0.0], [-0.05, 0.0]])
    moves = np.concatenate([way, found.episode.inputs])
    states = problem.world(gain=0.0).play(problem.start, moves)
    longer = replace(found.episode, inputs=moves, states=states)
    assert longer.length > 0.1 + found.episode.length - 1e-9
    shorter = certify(longer, seconds=1.2, clock=process_time)
    assert shorter.episode.length < longer.length
    assert shorter.episode.reason.endswith("found by the search for a bound")
    ends = problem.world(gain=0.0).play(problem.start, shorter.episode.inputs)[-1]
    assert np.abs(ends - problem.goal).max() <= problem.tolerance
    assert shorter.gap < longer.length / shorter.lower_bound - 1


def test_a_region_divides_into_convex_cells():
    cells = cells_of_place(ONE, np.zeros(1), 0.0)
    assert sum(signed_area(corners) for corners in cells.corners) == pytest.approx(2.8 - 0.16)
    assert all(
        np.all(inside[:, :2] @ corner >= inside[:, 2] - 1e-12)
        for inside, corners in zip(cells.insides, cells.corners, strict=True)
        for corner in corners
    )
    touching = region([(0, 0), (2, 0), (2, 2), (0, 2)], [[(0, 1), (1, 0.5), (1, 1.5)]])
    assert cells_of_place(touching, np.zeros(1), 0.0) is None
    start, goal = [(1.3, 1), (1.5, 1)], [(1.4, 1.2), (1.6, 1.2)]
    found = certify(run(SteeringProblem(touching, start, goal, time=0.5)))
    assert found.proof is None
    assert found.gap is not None


def test_a_translation_in_a_prism_keeps_its_plan():
    """The shortest plan of the search has no hold, and is shorter only by the tolerance."""
    box = prism(polygon([(0, 0), (1, 0), (1, 1), (0, 1)]), 0.8)
    start = np.array([(0.3, 0.6, 0.5), (0.7, 0.4, 0.2)])
    goal = start + np.array([0.01, 0.012, 0.005])
    goal[1, 0] -= 0.001  # which only a wall could change
    plan = run(SteeringProblem(box, start, goal, tolerance=0.01, time=0.5))
    found = certify(plan, seconds=1)
    assert found.episode.status == "solved"
    assert found.lower_bound <= found.episode.length <= plan.length


def test_a_plan_in_a_prism_is_proven_optimal():
    rng = np.random.default_rng(2)
    start, goal = rng.uniform(0.05, 0.6, (2, 2, 3))
    box = prism(polygon([(0, 0), (1, 0), (1, 1), (0, 1)]), 0.7)
    problem = SteeringProblem(box, start, goal)
    found = certify(run(problem), seconds=20)
    assert found.certified
    assert check_certificate_of(problem, found.proof)
    other = run(SteeringProblem(box, start, goal, planner="greedy"))
    assert not other or other.length >= found.lower_bound
    moves = np.concatenate([[[0, 0, 0.01], [0, 0, -0.01]], found.episode.inputs])
    longer = replace(found.episode, inputs=moves, states=problem.world().play(start, moves))
    again = certify(longer, seconds=20)
    assert again.episode.length == pytest.approx(found.episode.length, rel=1e-3)
    assert again.certified
    lower = copy.deepcopy(found.proof)
    lower["height"] = 0.9
    assert not check_certificate(lower)


@pytest.fixture(scope="module")
def in_cylinder():
    """A certificate of a cylinder, with contacts on its round wall and with halves of arcs."""
    start, goal = (
        [(-0.42, -0.22, 0.14), (0.08, -0.01, 0.07)],
        [(-0.37, -0.06, 0.23), (0.13, 0.06, 0.43)],
    )
    problem = SteeringProblem(cylinder(0.5, 0.81), start, goal)
    return problem, certify(run(problem), seconds=5, clock=process_time)


def test_a_cylinder_has_a_proof_that_is_better_than_the_bound_of_the_planner(in_cylinder):
    problem, found = in_cylinder
    assert found.bound == "certificate"
    assert found.lower_bound > 1.002 * run(problem).lower_bound
    assert found.certified
    proof = json.loads(json.dumps(found.proof))
    assert check_certificate_of(problem, proof)
    nodes = _way(proof)["proof"]
    assert any(set(node) == {"place"} for node in nodes)
    assert any(node.get("rounds") for node in nodes)
    tube = SteeringProblem(cylinder(0.5, 0.81, open_ends=True), problem.start, problem.goal)
    assert not check_certificate_of(tube, proof)


def _halved_again(proof):
    """A hold by the smallest arc is halved."""
    halves = [{"place": 0}] * 8
    _way(proof)["proof"] = [_DIVISION, *[_first_leaf(proof)] * 3, *halves, *_way(proof)["proof"]]


def _few_directions(proof):
    proof["directions"] = proof["directions"][::64]


WRONG_ROUND = {
    "radius": lambda proof: proof.update(radius=0.4),
    "height": lambda proof: proof.update(height=1.2),
    "no height": lambda proof: proof.pop("height"),
    "center": lambda proof: proof.update(center=[0.1, 0.0]),
    "tube": lambda proof: proof.update(open_ends=True),
    "not said": lambda proof: proof.update(open_ends=1),
    "prism": lambda proof: proof.update(corners=[[0, 0], [1, 0], [0, 1]]),
    "few directions": _few_directions,
    "not a power of 2": lambda proof: proof["directions"].pop(),
    "wrong way around": lambda proof: proof["directions"].reverse(),
    "twice around": lambda proof: proof.update(
        directions=[[np.cos(x), np.sin(x)] for x in np.arange(16) * np.pi / 4 + 1e-3]
    ),
    "smallest arc": _halved_again,
    "no half": lambda proof: _way(proof)["proof"].pop(),
    "no round": lambda proof: _first_leaf(proof)["rounds"].append([10**9, 1.0, 0.0]),
    "three numbers": lambda proof: _first_leaf(proof)["rounds"].append([0, 0.1, 0.1, 0.1]),
    "outside": lambda proof: [
        node["rounds"].append([0, 5.0, 0.0]) for node in _way(proof)["proof"] if node.get("rounds")
    ],
    "higher": lambda proof: proof.update(lower_bound=proof["lower_bound"] * 1.001),
    "start": lambda proof: proof["start"][0].__setitem__(0, -0.1),
    "goal": lambda proof: proof["goal"][1].__setitem__(2, 0.4),
}


@pytest.mark.parametrize("name", WRONG_ROUND)
def test_wrong_certificates_of_cylinders_are_refused(in_cylinder, name):
    proof = copy.deepcopy(in_cylinder[1].proof)
    WRONG_ROUND[name](proof)
    checked = check_certificate(proof)
    assert not checked
    assert checked.message.startswith("the certificate is ")


@pytest.mark.parametrize("open_ends", [False, True])
def test_random_moves_in_a_cylinder_are_not_shorter_than_a_bound(open_ends):
    rng = np.random.default_rng(4)
    place = cylinder(0.5, 0.6, open_ends=open_ends)
    nearest = np.inf
    for _ in range(6):
        start = rng.uniform([-0.3, -0.3, 0.0], [0.3, 0.3, 0.6], (2, 3))
        moves = rng.normal(size=(rng.integers(1, 4), 3)) * 0.3
        length = float(np.linalg.norm(moves, axis=1).sum())
        goal = SteeringProblem(place, start, start).world(gain=0.0).play(start, moves)[-1]
        cells = cells_of_place(place, start[:, 2], 1.3 * length)
        search = RouteSearch(cells, start, goal, 1e-6, 1.3 * length)
        for _ in range(5):
            search.step(lambda: 0.0)
            assert search.lower <= length * (1 + 1e-9)
        nearest = min(nearest, length / search.lower)
    assert nearest < 1.01


def test_an_input_against_a_point_of_an_arc_goes_against_one_of_its_ends():
    """Each adjustment that a contact with an arc allows, one normal of its wall allows."""
    cells, rng = cells_of_place(cylinder(0.5, 1.0), np.zeros(1), 0.0), np.random.default_rng(5)
    round_ = cells.round
    for wall in rng.integers(2, len(cells.walls), size=200).tolist():
        arc = cells.walls[wall]
        ends = -arc.normals[:, :2]
        first, turn = np.arctan2(*ends[0][::-1]), np.arccos(np.clip(ends[0] @ ends[1], -1, 1))
        out = first + rng.uniform(0, 1) * turn
        contact = np.array([0.5 * np.cos(out), 0.5 * np.sin(out), rng.uniform()])
        assert arc.inside[0, :3] @ contact >= arc.inside[0, 3] - 1e-9
        inputs = rng.normal(size=3)
        if inputs[:2] @ contact[:2] > 1e-6:
            assert (arc.normals @ inputs < 1e-6).any()
        if wall in round_.halves:
            one, other = (cells.walls[half].normals for half in round_.halves[wall])
            np.testing.assert_array_equal(arc.normals, [one[0], other[1]])
            np.testing.assert_array_equal(one[1], other[0])
            below = cells.without(wall, {round_.halves[wall][0]})
            assert below == [round_.halves[wall][1]]


def test_a_tube_over_a_polygon_has_a_proof():
    start, goal = [(0.2, 0.3, 0.1), (0.5, 0.35, 0.4)], [(0.8, 0.2, 0.6), (0.3, 0.75, 0.2)]
    tube = prism(polygon([(0, 0), (1, 0), (1, 1), (0, 1)]), 0.7, open_ends=True)
    problem = SteeringProblem(tube, start, goal)
    found = certify(run(problem), seconds=3, clock=process_time)
    assert found.gap < 0.05
    assert check_certificate_of(problem, found.proof)
    closed = SteeringProblem(prism(tube.base, 0.7), start, goal)
    assert not check_certificate_of(closed, found.proof)
