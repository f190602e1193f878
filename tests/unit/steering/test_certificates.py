"""Certificates: bounds below all plans, proofs that are checked apart, and wrong ones refused."""

from __future__ import annotations

import copy
import json
import sys
from fractions import Fraction
from itertools import count
from time import process_time

import numpy as np
import pytest

from shoal.cli import run as command
from shoal.core.errors import InvalidInputError, MissingExtraError, ShoalError
from shoal.steering import (
    SteeringProblem,
    certify,
    check_certificate,
    cylinder,
    disk,
    polygon,
    prism,
    regular_polygon,
)
from shoal.steering.certificates import _with_bound, check_certificate_of
from shoal.steering.certificates.check import _BITS, _angle, _RoundWalls
from shoal.steering.certificates.geodesics import geodesic_bound
from shoal.steering.run import run

pytest.importorskip("clarabel")

START, GOAL = [(0.2, 0.3), (0.5, 0.35)], [(0.8, 0.2), (0.3, 0.75)]


@pytest.fixture(scope="module")
def certificate():
    return certify(run(SteeringProblem("square", START, GOAL)), seconds=60)


def test_a_plan_in_the_square_is_proven_optimal(certificate):
    assert certificate.certified
    assert certificate.gap < 2e-4
    assert certificate.episode.lower_bound == certificate.lower_bound
    assert certificate.bound == "certificate"
    assert check_certificate(json.loads(json.dumps(certificate.proof)))


def test_a_bound_above_a_plan_is_an_error_and_without_a_proof_nothing_is_certified(certificate):
    episode = certificate.episode
    with pytest.raises(ShoalError, match=r"'shortest' of .* is above the length of a plan"):
        _with_bound(episode, {"certificate": 1.0, "shortest": 1.01 * episode.length}, None, 0)
    bounds = {"shortest paths": episode.length}
    assert _with_bound(episode, bounds, None, 0).gap == 0
    assert not _with_bound(episode, bounds, None, 0).certified
    assert not _with_bound(episode, bounds, {"lower_bound": 0.9 * episode.length}, 0).certified


def test_a_certificate_is_none_of_a_problem_whose_plans_have_no_least_length(certificate):
    for fields in ({"execution": 0.01}, {"angle_error": 1.0, "friction_at_least": 1.0}):
        problem = SteeringProblem("square", START, GOAL, **fields)
        checked = check_certificate_of(problem, certificate.proof)
        assert not checked
        assert "without sliding" in checked.message
    assert check_certificate_of(SteeringProblem("square", START, GOAL), certificate.proof)


@pytest.mark.parametrize(("name", "seed"), [("triangle", 1), ("hexagon", 0), ("square", 6)])
def test_no_plan_is_shorter_than_a_bound(name, seed):
    episode = run(SteeringProblem(name), seed=seed)
    proven = certify(episode, seconds=60)
    assert proven.certified
    for planner in ("greedy", "fewest-moves"):
        other = run(SteeringProblem(name, planner=planner), seed=seed)
        assert not other or other.length >= proven.lower_bound


def test_interchangeable_particles_need_both_proofs():
    proven = certify(run(SteeringProblem("triangle", interchangeable=True), seed=3), seconds=60)
    assert proven.certified
    assert check_certificate(proven.proof)
    half = copy.deepcopy(proven.proof)
    half["trees"].pop()
    assert "orders" in check_certificate(half).message


def _leaves(proof):
    return [node for node in proof["trees"][0]["proof"] if "norms" in node]


def _scaled(proof, factor):
    for leaf in _leaves(proof):
        leaf["norms"] = [[x * factor, y * factor] for x, y in leaf["norms"]]


def _negative(proof):
    for leaf in _leaves(proof):
        leaf["slacks"] = [[k, -value] for k, value in leaf["slacks"]]


def _all_known(proof):
    every = [[wall, particle] for wall in range(4) for particle in (0, 1)]
    proof["trees"][0]["proof"][0]["known"] = every


WRONG = {
    "higher": lambda proof: proof.update(lower_bound=proof["lower_bound"] * 1.001),
    "less": lambda proof: proof["trees"][0]["proof"].pop(),
    "more": lambda proof: proof["trees"][0]["proof"].append(_leaves(proof)[0]),
    "no case": lambda proof: proof["trees"][0].update(proof=[]),
    "long": lambda proof: _scaled(proof, 2),
    "inexact": lambda proof: _scaled(proof, 1 / 3),
    "negative": _negative,
    "known": _all_known,
    "goal": lambda proof: proof.update(goal=[[0.7, 0.2], [0.3, 0.75]]),
    "not convex": lambda proof: proof["corners"].insert(1, [0.5, 0.1]),
    "not a number": lambda proof: proof.update(lower_bound=float("nan")),
    "nothing": lambda proof: proof.clear(),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_certificates_are_refused(certificate, name):
    proof = copy.deepcopy(certificate.proof)
    WRONG[name](proof)
    assert not check_certificate(proof)


@pytest.fixture(scope="module")
def round_certificate():
    found = certify(run(SteeringProblem("disk"), seed=14), seconds=60)
    assert check_certificate(found.proof)
    return found


@pytest.mark.parametrize(("name", "seed"), [("disk", 14), ("regular:60", 13)])
def test_plans_at_round_walls_are_proven_optimal(name, seed):
    episode = run(SteeringProblem(name), seed=seed)
    proven = certify(episode, seconds=60)
    assert proven.certified
    assert proven.proof["runs"]
    assert check_certificate(json.loads(json.dumps(proven.proof)))
    for planner in ("greedy", "fewest-moves"):
        other = run(SteeringProblem(name, planner=planner), seed=seed)
        assert not other or other.length >= proven.lower_bound


def _first(proof, key):
    return next(node for node in proof["trees"][0]["proof"] if key in node)


def _first_division(proof, *names):
    nodes = proof["trees"][0]["proof"]
    return next(node for node in nodes if node.get("name") in names)


ROUND_WRONG = {
    "missing contacts": lambda proof: _first(proof, "choices")["choices"].pop(),
    "shorter range": lambda proof: _first(proof, "choices")["choices"][0].__setitem__(2, 3),
    "too long a range": lambda proof: _first(proof, "choices")["choices"][0].__setitem__(2, 2000),
    "no runs": lambda proof: proof.update(runs=False),
    "smaller disk": lambda proof: proof.update(radius=0.49),
    "clockwise": lambda proof: proof["directions"].reverse(),
    "twice around": lambda proof: proof.update(directions=proof["directions"][::2] * 2),
    "few directions": lambda proof: proof.update(directions=proof["directions"][::200]),
    "outside": lambda proof: _first_division(proof, "least", "most").update(wall=-1000),
    "no contact": lambda proof: _first_division(proof, "least", "most").update(name="middle"),
    "negative": _negative,
    "long": lambda proof: _scaled(proof, 2),
    "unknown cone": lambda proof: _leaves(proof)[0]["cones"].append([1000, 1.0, 0.0]),
    "other cone": lambda proof: _leaves(proof)[0].update(cones=[[0, 1.0, 0.0]]),
}


@pytest.mark.parametrize("name", ROUND_WRONG)
def test_wrong_certificates_of_disks_are_refused(round_certificate, name):
    proof = copy.deepcopy(round_certificate.proof)
    ROUND_WRONG[name](proof)
    assert not check_certificate(proof)


@pytest.fixture(scope="module")
def growth_certificate():
    """Return a certificate of two particles that must part."""
    start, goal = [(0.05, 0.1), (0.1, 0.02)], [(-0.45, 0.1), (0.43, 0.0)]
    episode = run(SteeringProblem("disk", start, goal))
    # a budget of readings, not of time: the same work on every machine
    found = certify(episode, seconds=1000, clock=count(0.0).__next__, workers=1)
    assert check_certificate(found.proof)
    return found


def test_a_contact_that_slides_is_many_contacts(growth_certificate):
    episode = growth_certificate.episode
    before = run(episode.problem, seed=episode.seed)
    assert episode.length < 0.975 * before.length
    assert episode.moves > 20
    assert episode.verify()


def _laws(proof):
    """Yield the multipliers of the last constraint of each leaf that is one of the laws of growth."""
    last = max(row for leaf in _leaves(proof) for row, _ in leaf["slacks"])
    for leaf in _leaves(proof):
        yield from (one for one in leaf["slacks"] if one[0] > last - 6)


def _change_laws(proof, change):
    for one in _laws(proof):
        one[:] = change(*one)


GROWTH_WRONG = {
    "apart at the start": lambda proof: proof["start"].__setitem__(0, [-0.1, 0.1]),
    "near at the goals": lambda proof: proof["goal"].__setitem__(0, [0.2, 0.1]),
    "greater tolerance": lambda proof: proof.update(tolerance=0.05),
    "greater disk": lambda proof: proof.update(radius=0.6),
    "twice": lambda proof: _change_laws(proof, lambda row, factor: [row, 2 * factor]),
    "negative": lambda proof: _change_laws(proof, lambda row, factor: [row, -factor]),
    "other constraints": lambda proof: _change_laws(proof, lambda row, factor: [0, factor]),
    "no constraints": lambda proof: _change_laws(proof, lambda row, factor: [row + 6, factor]),
    "higher": lambda proof: proof.update(lower_bound=1.001 * proof["lower_bound"]),
}


@pytest.mark.parametrize("name", GROWTH_WRONG)
def test_wrong_laws_of_growth_are_refused(growth_certificate, name):
    proof = copy.deepcopy(growth_certificate.proof)
    GROWTH_WRONG[name](proof)
    assert proof != growth_certificate.proof
    assert not check_certificate(proof)


@pytest.fixture(scope="module")
def disk_certificate():
    """Return a certificate of the same starts and goals in a disk within the square."""
    place = disk(0.5, center=(0.5, 0.5))
    return certify(run(SteeringProblem(place, START, GOAL)), seconds=0.02, clock=process_time)


def _of_disk(proof, other):
    """Replace the proof by that for the disk, and keep the square as the stated workspace."""
    proof.update(
        {name: value for name, value in other.items() if name not in proof or name in SWAPPED}
    )


SWAPPED = ("trees", "lower_bound", "limit", "unit", "runs")
PLANTED = {
    # each proof is right, but one of another problem than the stated one
    "disk": _of_disk,
    "radius alone": lambda proof, other: proof.update(radius=0.5),
    "height": lambda proof, other: proof.update(height=1.0),
    "rings": lambda proof, other: proof.update(rings=[proof["corners"]]),
    "directions": lambda proof, other: proof.update(directions=other["directions"]),
    "runs": lambda proof, other: proof.update(runs=True),
    # windows: the same tree for walls, starts or a tolerance that are not those of the problem
    "wall moved": lambda proof, other: proof["corners"].__setitem__(1, [0.99, 0.0]),
    "corner cut": lambda proof, other: proof["corners"].insert(1, [0.999, 0.0]),
    "walls turned": lambda proof, other: proof["corners"].append(proof["corners"].pop(0)),
    "starts changed over": lambda proof, other: proof["start"].reverse(),
    "goals changed over": lambda proof, other: proof["goal"].reverse(),
    "backwards": lambda proof, other: proof.update(start=proof["goal"], goal=proof["start"]),
    "tolerance": lambda proof, other: proof.update(tolerance=0.0),
    "goals for both": lambda proof, other: proof.update(interchangeable=True),
    "three points": lambda proof, other: proof["start"].append([0.5, 0.5]),
    # bounds: just above what is proven, by one unit of the last place or by its limit
    "last place": lambda proof, other: proof.update(lower_bound=2 * proof["limit"]),
    "limit": lambda proof, other: proof.update(
        limit=proof["limit"] * 0.9, lower_bound=proof["lower_bound"]
    ),
    "unit": lambda proof, other: proof.update(unit=2 * proof["unit"]),
    "unknown field": lambda proof, other: proof.update(note=1),
    "no truth value": lambda proof, other: proof.update(runs=""),
    "negative unit": lambda proof, other: proof.update(unit=-proof["unit"]),
    "kind": lambda proof, other: proof.update(kind="plan"),
    # the tree: a case twice in place of another, and a proof for one order in place of two
    "case twice": lambda proof, other: proof["trees"][0]["proof"].__setitem__(
        -1, copy.deepcopy(proof["trees"][0]["proof"][-2])
    ),
    "order twice": lambda proof, other: proof["trees"].append(proof["trees"][0]),
    "side": lambda proof, other: _first(proof, "choices").update(side="last"),
    "choice for the other": lambda proof, other: _first(proof, "choices")["choices"][0].__setitem__(
        0, 1 - _first(proof, "choices")["choices"][0][0]
    ),
    "place": lambda proof, other: _first(proof, "choices").update(place=1),
    "no place": lambda proof, other: _first(proof, "choices").update(place=-1),
    "negative number": lambda proof, other: _leaves(proof)[0]["slacks"].append([-1, 1.0]),
    "infinite": lambda proof, other: _leaves(proof)[0].update(
        norms=[[float("inf"), 0.0] for _ in _leaves(proof)[0]["norms"]]
    ),
}


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_certificate_is_refused(certificate, disk_certificate, name):
    problem = SteeringProblem("square", START, GOAL)
    proof = copy.deepcopy(certificate.proof)
    PLANTED[name](proof, disk_certificate.proof)
    assert proof != certificate.proof
    assert not check_certificate_of(problem, proof)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda proof: proof.update(unit=proof["unit"] / 2), "the unit is not the least power"),
        (lambda proof: proof.update(unit=proof["unit"] * 2), "the unit is not the least power"),
        (lambda proof: proof.update(unit=proof["unit"] * 1.001), "the unit is not the least power"),
        (lambda proof: proof.update(limit=0.9 * proof["lower_bound"]), "is above the limit"),
        (lambda proof: proof.update(runs=not proof["runs"]), "holds are runs in disks and"),
        (lambda proof: proof.update(extra=1), "expected no field 'extra'"),
        (lambda proof: proof.update(cells=[]), "expected no field 'cells'"),
        (lambda proof: proof.update(kind="plan"), "expected the kind 'steering certificate'"),
        (lambda proof: proof["trees"][0].update(note=1), "expected no field 'note'"),
        (lambda proof: proof["goal"].append([0, 0]), "goal: expected two places of 2 coordinates"),
        (lambda proof: proof["start"][0].append(0), "start: expected two places of 2 coordinates"),
    ],
)
@pytest.mark.parametrize("place", ["disk", "regular:60"])
def test_what_has_no_effect_on_a_bound_is_checked_as_well(place, damage, words, whole_proofs):
    """Potentials are in units of the radius, and know no holds: whatever stood there was taken."""
    proof = copy.deepcopy(whole_proofs[place])
    damage(proof)
    assert words in check_certificate(proof).message


def test_what_has_no_effect_in_a_node_is_refused(certificate):
    for change, words in (
        ({"note": 1}, "expected no field 'note'"),
        ({"side": "left"}, "no side is 'left'"),
    ):
        proof = copy.deepcopy(certificate.proof)
        node = next(node for node in proof["trees"][0]["proof"] if "side" in node)
        node.update(change)
        assert words in check_certificate(proof).message
        if "note" in change:
            del node["note"]
            proof["moves"]["proofs"][0]["proof"][0]["note"] = 1
            assert words in check_certificate(proof).message


def test_the_check_says_up_to_which_limit_a_proof_was_checked(whole_proofs):
    """With a greater limit, multipliers prove less or as much: what they still prove is true."""
    proof = copy.deepcopy(whole_proofs["disk"])
    stated = f"of all plans up to the limit {proof['limit']:.9g}, prove"
    assert stated in check_certificate(proof).message
    proof["limit"] *= 1 + 1e-6
    checked = check_certificate(proof)
    assert stated not in checked.message
    assert not checked or f"the limit {proof['limit']:.9g}" in checked.message


@pytest.fixture(scope="module")
def whole_proofs():
    """Return certificates whose proofs are potentials."""
    ticks = count()
    proofs = {
        place: certify(
            run(SteeringProblem(place), seed=seed), seconds=1, clock=lambda: 0.002 * next(ticks)
        ).proof
        for place, seed in (("disk", 2), ("regular:60", 3))
    }
    assert all(check_certificate(proof) for proof in proofs.values())
    return proofs


def test_no_random_damage_raises_a_bound(certificate):
    """A damaged proof may still be one, but never of a bound above the plan."""
    rng = np.random.default_rng(0)
    length, accepted = certificate.episode.length, 0
    problem = SteeringProblem("square", START, GOAL)
    for _ in range(16):
        proof = copy.deepcopy(certificate.proof)
        nodes = proof["trees"][0]["proof"]
        node = nodes[rng.integers(len(nodes))]
        name = str(rng.choice(list(node)))
        if isinstance(node[name], list) and node[name]:
            one = int(rng.integers(len(node[name])))
            if rng.integers(2):
                node[name].pop(one)
            else:
                node[name].append(node[name][one])
        else:
            node[name] = int(rng.integers(-2, 9))
        if rng.integers(2):
            proof["lower_bound"] = length * float(rng.uniform(0.9, 1.1))
        if check_certificate_of(problem, proof):
            accepted += 1
            assert proof["lower_bound"] <= length
    assert accepted


def test_antipodes_have_a_bound_from_the_law_of_growth():
    start, goal = [(-0.48, 0.02), (0.47, 0)], [(0.46, 0.03), (-0.48, -0.01)]
    episode = run(SteeringProblem("disk", start, goal))
    ticks = count()
    found = certify(episode, seconds=0.2, clock=lambda: 0.002 * next(ticks))
    assert found.gap < 0.25
    assert found.proof["trees"][0]["proof"] == "growth"
    assert check_certificate(json.loads(json.dumps(found.proof)))
    higher = found.proof | {"lower_bound": found.lower_bound * 1.0001}
    assert "proves" in check_certificate(higher).message
    for other in ({"radius": 0.6}, {"tolerance": 0.01}, {"goal": start}):
        assert not check_certificate(found.proof | other)


@pytest.mark.parametrize("name", ["square", "regular:20", "disk"])
@pytest.mark.parametrize("shift", [0.0, 0.1])
def test_translations_are_proven_optimal(name, shift):
    start = np.array([(0.1, 0.2), (0.15, 0.3)])
    episode = run(SteeringProblem(name, start, start + np.array([shift, 0])))
    found = certify(episode, seconds=20)
    assert found.lower_bound <= episode.length
    assert found.lower_bound == pytest.approx(shift, abs=0.003)  # the tolerance
    assert check_certificate(found.proof)


def test_the_law_of_growth_is_for_disks(certificate):
    proof = copy.deepcopy(certificate.proof)
    proof["trees"][0]["proof"] = "growth"
    assert "disks" in check_certificate(proof).message


@pytest.mark.parametrize("cosine", [-1, -0.999, -0.3, 0, 0.5, 0.9999, 1])
def test_angles_are_rounded_outward(cosine):
    one = 1 << _BITS
    low, high = (Fraction(angle, one) for angle in _angle(int(cosine * 2**60) * one, 2**60))
    angle = Fraction(np.arccos(int(cosine * 2**60) / 2**60))
    assert abs(float(low - angle)) < 1e-11
    assert low <= angle + Fraction(1, 10**15)
    assert high >= angle - Fraction(1, 10**15)
    assert low <= high


def test_adjustments_turn_only_as_far_as_contacts_are_from_an_arc():
    relaxation = pytest.importorskip("shoal.steering.certificates.relaxation")
    rng = np.random.default_rng(0)
    radius, tightest = 2**30, 0.0
    directions = [(int(x * radius), int(y * radius)) for x, y in relaxation.round_directions(64)]
    walls = _RoundWalls(radius, directions)
    for _ in range(400):
        first, end = sorted(rng.choice(22, size=2, replace=False).tolist())
        near = 2 * np.pi * (first + rng.choice([0, 0.5, 1]) * (end - first)) / 64
        angle = near + rng.normal() * rng.choice([0.1, 2])
        contacts = np.stack([np.cos([near, angle]), np.sin([near, angle])], axis=1)
        turned = angle + rng.choice([-1, -0.5, 0.5, 1]) * np.pi / 2  # from the outward normal
        (x, y), sine = walls.axis(first, end)
        pushed = x * np.cos(turned) + y * np.sin(turned)
        most = sine + walls.turn(first, end) * np.hypot(*(contacts[1] - contacts[0]))
        assert pushed <= most * (1 + 1e-9)
        tightest = max(tightest, pushed / most)
    assert tightest > 0.95


def test_the_search_finds_a_shorter_plan():
    rng = np.random.default_rng([4, 77])
    thin = polygon([(0, 0), (1, 0), (rng.uniform(0, 1), rng.uniform(0.03, 0.2))])
    episode = run(SteeringProblem(thin, planner="greedy"), seed=4)
    proven = certify(episode, seconds=60)
    assert proven.certified
    assert proven.episode.length < episode.length * 0.999
    assert proven.episode.verify()


def test_obstacles_have_a_bound():
    region = {
        "type": "region",
        "outline": [[0, 0], [2, 0], [2, 1], [0, 1]],
        "obstacles": [[[0.9, 0.2], [1.1, 0.2], [1.1, 0.9], [0.9, 0.9]]],
    }
    problem = SteeringProblem(region, [(0.5, 0.5), (0.6, 0.5)], [(1.5, 0.5), (1.6, 0.5)])
    found = certify(run(problem), seconds=1)
    # particle 2 below the obstacle, by (0.9, 0.2) and (1.1, 0.2)
    around = np.hypot(0.3, 0.3) + 0.2 + np.hypot(0.5, 0.3)
    assert found.lower_bound == pytest.approx(around, abs=1e-5)
    assert found.gap is not None


def test_command(tmp_path, capsys):
    words = ["square", "--start", "0.2,0.3 0.5,0.35", "--goal", "0.8,0.2 0.3,0.75"]

    def shown(*arguments):
        code = command(["steer", *arguments])
        return code, capsys.readouterr().out

    code, text = shown(*words, "--certify", "60", "--out", str(tmp_path / "plan"), "--json")
    result = json.loads(text)
    assert code == 0
    assert result["certified"]
    assert result["gap"] == result["length"] / result["lower_bound"] - 1
    assert len(result["inputs"]) == result["moves"]
    path = result["certificate"]
    code, text = shown(*words, "--check", path, "--json")
    assert (code, json.loads(text)["valid"]) == (0, True)
    code, text = shown("square", "--check", path, "--json")
    assert (code, json.loads(text)["valid"]) == (1, False)
    assert shown(*words, "--check", path, "--certify", "1")[0] == 2


RING = {
    "type": "region",
    "outline": [[0, 0], [3, 0], [3, 3], [0, 3]],
    "obstacles": [[[1, 1], [2, 1], [2, 2], [1, 2]]],
}
THREE = [(0.2, 0.3), (0.5, 0.35), (0.7, 0.7)]
SPATIAL = [(-0.2, 0, 0.3), (0.1, 0.1, 0.5)], [(0.2, 0, 0.3), (0.1, -0.2, 0.5)]
KINDS = {
    "ring": (RING, [(0.5, 0.5), (0.6, 0.9)], [(0.4, 1.5), (0.5, 1.9)], {}, "certificate"),
    "cylinder": (cylinder(0.5, 1.0), *SPATIAL, {}, "certificate"),
    "tube": (cylinder(0.5, 1.0, open_ends=True), *SPATIAL, {}, "certificate"),
    "prism": (prism(regular_polygon(4), 1.0), *SPATIAL, {}, "certificate"),
    "three": ("square", THREE, np.array(THREE) + 0.1, {}, "shortest paths"),
    "radius": ("square", START, GOAL, {"particle_radius": 0.02}, "shortest"),
    "at the goal": ("square", START, START, {}, "certificate"),
    # a translation by the tolerance: the search for a bound has no hold of which to make a plan
    "near the goal": (
        "square", START, [(0.2011, 0.3), (0.5, 0.3505)], {"tolerance": 0.001}, "shortest"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", KINDS)
def test_each_kind_of_problem_has_a_gap(name):
    place, start, goal, fields, bound = KINDS[name]
    episode = run(SteeringProblem(place, start, goal, **fields))
    assert episode
    ticks = count()
    found = certify(episode, seconds=0.3, clock=lambda: 0.0025 * next(ticks))
    assert found.gap is not None
    assert found.bound == bound
    assert found.proof is not None or bound != "certificate"
    assert 0 <= found.lower_bound <= found.episode.length


@pytest.mark.parametrize("name", ["square", "disk"])
def test_random_moves_of_three_particles_are_not_shorter_than_their_bound(name):
    rng, nearest = np.random.default_rng(2), np.inf
    for _ in range(30):
        start = rng.uniform(-0.3, 0.3, size=(3, 2)) + (0.5 if name == "square" else 0)
        moves = rng.normal(size=(rng.integers(1, 5), 2)) * rng.choice([0.1, 0.5])
        length = float(np.linalg.norm(moves, axis=1).sum())
        goal = SteeringProblem(name, start, start).world(gain=0.0).play(start, moves)[-1]
        for any_goal in (False, True):
            goals = goal[rng.permutation(3)] if any_goal else goal
            problem = SteeringProblem(name, start, goals, interchangeable=any_goal)
            least = geodesic_bound(problem, start, goals)
            assert least <= length * (1 + 1e-9)
            nearest = min(nearest, length / max(least, 1e-9))
    assert nearest < 1.01


def test_all_parts_of_a_search_have_the_time_of_one_clock():
    """With a clock that runs out at once, the search makes no plans, however fast the computer is;
    with one that hardly moves, it finds a shorter plan, however slow it is.
    """
    episode = run(SteeringProblem("disk"), seed=9)
    for step, is_shorter in ((1.0, False), (1e-6, True)):
        ticks = count()
        found = certify(episode, seconds=1e-3, clock=lambda: step * next(ticks))  # noqa: B023
        assert (found.episode.length < 0.999 * episode.length) == is_shorter


def test_noise_has_no_certificate():
    with pytest.raises(InvalidInputError, match="without noise"):
        certify(run(SteeringProblem("square", execution=1e-3, tolerance=0.05)), seconds=1)


def test_a_missing_solver_is_named(monkeypatch):
    episode = run(SteeringProblem("square"), seed=6)
    monkeypatch.setitem(sys.modules, "clarabel", None)
    with pytest.raises(MissingExtraError, match=r"shoal\[certify\]"):
        certify(episode, seconds=1)


def test_a_bound_without_proof_needs_no_solver(monkeypatch):
    episode = run(SteeringProblem("square", START, GOAL, particle_radius=0.02))
    monkeypatch.setitem(sys.modules, "clarabel", None)
    found = certify(episode, seconds=1)
    assert found.proof is None
    assert 0 < found.lower_bound <= episode.length
    assert found.report()["bound"] == "shortest"
    assert "by the bound of the planner shortest (" in found.sentence


def test_a_bound_is_never_weaker_than_that_of_shortest():
    """Without time, the proof of a disk shows less than the planner; both are said."""
    episode = run(SteeringProblem("disk"), seed=6)
    found = certify(episode, seconds=1e-6)
    assert check_certificate(found.proof)
    assert found.proof["lower_bound"] < found.lower_bound == episode.lower_bound
    assert found.bound == "shortest"
    assert f"checked shows {found.proof['lower_bound']:.6g}" in found.sentence
