"""Least numbers of moves: proofs in polygons, checked apart; wrong ones are refused."""

from __future__ import annotations

import copy
import json

import numpy as np
import pytest

from shoal.steering import SteeringProblem, certify, check_certificate
from shoal.steering.certificates.moves import MovePrograms, prove_more_moves
from shoal.steering.run import run

pytest.importorskip("clarabel")


@pytest.fixture(scope="module")
def certificate():
    return certify(run(SteeringProblem("triangle", planner="fewest-moves"), seed=5), seconds=60)


def test_a_plan_has_as_few_moves_as_possible(certificate):
    assert certificate.moves_lower_bound == certificate.episode.moves == 3
    proof = json.loads(json.dumps(certificate.proof))
    assert "none has fewer than 3 moves" in check_certificate(proof).message
    assert certificate.report()["moves_lower_bound"] == 3


@pytest.mark.parametrize("seed", [0, 4])
def test_as_few_moves_as_possible_in_the_square(seed):
    problem = SteeringProblem("square", planner="fewest-moves")
    episode = run(problem, seed=seed)
    start, goal = problem.endpoints(seed)
    programs = MovePrograms(problem.place.vertices, start, goal, problem.tolerance)
    assert prove_more_moves(programs, episode.moves - 1, 4, lambda: False) is not None
    assert prove_more_moves(programs, episode.moves - 1, 4, lambda: True) is None  # no time


@pytest.mark.parametrize("name", ["square", "triangle", "regular:7"])
def test_moves_that_end_at_the_goals_are_never_excluded(name):
    """Random moves from random starts, with the places where they end as goals."""
    rng = np.random.default_rng(5)
    problem = SteeringProblem(name)
    place, world = problem.place, problem.world(gain=0.0)
    for number in range(12):
        start, _ = problem.endpoints(number)
        moves = rng.normal(size=(rng.integers(1, 3), 2)) * 0.5
        goal = world.play(start, moves)[-1]
        programs = MovePrograms(place.vertices, start, goal, problem.tolerance)
        assert prove_more_moves(programs, len(moves), len(place.vertices), lambda: False) is None


def _negative(moves):
    leaf = next(node for node in moves["proofs"][0]["proof"] if "slacks" in node)
    leaf["slacks"] = [[k, -value] for k, value in leaf["slacks"]]


def _no_multipliers(moves):
    next(node for node in moves["proofs"][0]["proof"] if "slacks" in node)["slacks"] = []


WRONG = {
    "more": lambda moves: moves.update(lower_bound=moves["lower_bound"] + 1),
    "none": lambda moves: moves.update(lower_bound=0),
    "less cases": lambda moves: moves["proofs"][0]["proof"].pop(),
    "no case": lambda moves: moves["proofs"][0].update(proof=[]),
    "no order": lambda moves: moves["proofs"].clear(),
    "negative": _negative,
    "no multipliers": _no_multipliers,
    "nothing": lambda moves: moves.clear(),
    "many": lambda moves: moves.update(lower_bound=10**9),
    "missing cases": lambda moves: moves["proofs"][0].update(
        proof=[{"move": 0, "particle": 0}] * 9
    ),
    "no move": lambda moves: moves["proofs"][0].update(proof=[{"move": 5}]),
    "no particle": lambda moves: moves["proofs"][0].update(proof=[{"move": 0, "particle": 2}]),
    "orders": lambda moves: moves["proofs"][0].update(order=[2, 1]),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_proofs_of_moves_are_refused(certificate, name):
    proof = copy.deepcopy(certificate.proof)
    WRONG[name](proof["moves"])
    checked = check_certificate(proof)
    assert not checked
    assert checked.message.startswith("the certificate is ")


def test_without_a_proof_a_move_is_needed_if_particles_are_not_at_their_goals():
    found = certify(run(SteeringProblem("square", friction=0.5, time=1), seed=1), seconds=1)
    assert found.proof is None
    assert found.moves_lower_bound == 1
