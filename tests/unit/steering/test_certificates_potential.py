"""Potentials at round walls: V falls by at most the length of each input, and wrong ones are refused."""

from copy import deepcopy
from fractions import Fraction
from itertools import count

import numpy as np
import pytest

from shoal.steering import SteeringProblem, certify, check_certificate, regular_polygon
from shoal.steering.certificates import search
from shoal.steering.certificates.check_potential import (
    DEGREE,
    WrongPotentialError,
    check_positive,
    ellipses,
    monomials,
)
from shoal.steering.certificates.potential import find_potential
from shoal.steering.run import run

START, GOAL = np.array([(-0.56, -0.26), (-0.38, -0.83)]), np.array([(-0.08, -0.69), (0.87, -0.32)])
SIDES = regular_polygon(60)
FAR = float(np.max(np.linalg.norm(SIDES.vertices - SIDES.vertices.mean(axis=0), axis=1)))
CORNERS = (SIDES.vertices - SIDES.vertices.mean(axis=0)) / FAR
RING = 1 - float(np.linalg.norm((CORNERS[0] + CORNERS[1]) / 2)) ** 2 + 1e-12


def _contact(rng, *, polygon):
    """Return a point of the wall, and the outward normal there."""
    if not polygon:
        angle = rng.uniform(0, 2 * np.pi)
        point = np.array([np.cos(angle), np.sin(angle)])
        return point, point
    side = int(rng.integers(len(CORNERS)))
    first, second = CORNERS[side], CORNERS[(side + 1) % len(CORNERS)]
    along = second - first
    return first + rng.uniform() * along, np.array([along[1], -along[0]])


def _is_inside(point, *, polygon):
    along = np.roll(CORNERS, -1, axis=0) - CORNERS
    sides = along[:, 0] * (point - CORNERS)[:, 1] - along[:, 1] * (point - CORNERS)[:, 0]
    return bool(np.all(sides >= 0)) if polygon else float(np.hypot(*point)) <= 1


@pytest.mark.parametrize("polygon", [False, True])
def test_a_potential_falls_by_at_most_the_length_of_each_input(polygon):
    # with a long limit, all states are in the ellipses
    _, proof = find_potential(START, GOAL, 1e-6, 9.0, RING if polygon else 0.0)
    powers = np.array(monomials(DEGREE)[1:])
    coefficients = np.array(proof["potential"])

    def value(places):
        return float(np.prod(places.ravel() ** powers, axis=1) @ coefficients)

    rng, tried, steepest = np.random.default_rng(3), 0, 0.0
    while tried < 3000:
        places = rng.uniform(-1, 1, size=(2, 2))
        held, size = int(rng.integers(3)), 10 ** rng.uniform(-4, 0)
        move = size * rng.normal(size=2)
        after = places + move
        if held < 2:
            places[held], normal = _contact(rng, polygon=polygon)
            move *= np.sign(normal @ move)  # against the wall
            after = places.copy()
            after[1 - held] += move
        free = [k for k in (0, 1) if k != held]
        if all(_is_inside(state[k], polygon=polygon) for state in (places, after) for k in free):
            tried += 1
            steepest = max(steepest, (value(places) - value(after)) / float(np.linalg.norm(move)))
    assert 0.9 < steepest < 1 + 1e-4


@pytest.fixture(scope="module", params=["disk", "regular:60"])
def certificate(request):
    seed, ticks = {"disk": 570671312, "regular:60": 536368455}[request.param], count()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search, "_EASY", 2)  # a potential after two divisions
        # without potentials between contacts
        patch.setattr(search, "_BETTER", 0.0)
        patch.setattr(search, "_STALLED", (9.0, 9.0))
        found = certify(
            run(SteeringProblem(request.param), seed=seed),
            seconds=1,
            clock=lambda: 0.01 * next(ticks),
            workers=1,
        )
    assert isinstance(found.proof["trees"][0]["proof"], dict)
    assert check_certificate(found.proof)
    return found.proof


DAMAGES = {
    "a greater bound": lambda proof, potential: proof.update(
        lower_bound=1.001 * proof["lower_bound"]
    ),
    "a longer limit": lambda proof, potential: proof.update(limit=1.5 * proof["limit"]),
    "a limit below the least length": lambda proof, potential: proof.update(limit=0.01),
    "a greater potential": lambda proof, potential: potential.update(
        potential=[1.25 * x for x in potential["potential"]]
    ),
    "no potential": lambda proof, potential: potential.update(potential=[]),
    "a case less": lambda proof, potential: potential["cases"].pop(),
    "a square less": lambda proof, potential: potential["cases"][1]["squares"].pop(),
    "a negative square": lambda proof, potential: potential["cases"][2]["squares"][0].__setitem__(
        0, -1.0
    ),
    "another square": lambda proof, potential: potential["cases"][0]["squares"][0].__setitem__(
        0, 9.0
    ),
    "a hold that draws": lambda proof, potential: potential["cases"][1]["holds"][0].__setitem__(
        0, -0.5
    ),
    "no number": lambda proof, potential: potential["potential"].__setitem__(0, float("nan")),
    "a fine number": lambda proof, potential: potential["potential"].__setitem__(0, 1e-15),
    "a word": lambda proof, potential: potential.update(cases="none"),
    "another start": lambda proof, potential: proof["start"][0].__setitem__(
        0, proof["start"][0][0] + 0.01
    ),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_potential_is_refused(certificate, damage):
    wrong = deepcopy(certificate)
    DAMAGES[damage](wrong, wrong["trees"][0]["proof"])
    checked = check_certificate(wrong)
    assert not checked
    assert "certificate" in checked.message


def test_a_matrix_with_a_negative_eigenvalue_is_refused():
    check_positive([[2, 1], [1, 2]])
    for wrong in ([[1, 2], [2, 1]], [[0]], [[1, 1], [1, 1]], [[3, 0, 0], [0, 1, 2], [0, 2, 3]]):
        with pytest.raises(WrongPotentialError):
            check_positive(wrong)


def test_ellipses_hold_all_states_of_short_plans():
    ends = [[Fraction(x) for x in points.ravel().tolist()] for points in (START, GOAL)]
    assert ellipses(*ends, Fraction(1, 10)) is None
    rng, limit, met = np.random.default_rng(1), 1.6, 0
    around = ellipses(*ends, Fraction(limit))
    for places in rng.uniform(-1, 1, size=(3000, 2, 2)):
        sums = [
            np.linalg.norm(x - a) + np.linalg.norm(x - b)
            for x, a, b in (
                (places[0], START[0], GOAL[0]),
                (places[1], START[1], GOAL[1]),
                (places[1] - places[0], START[1] - START[0], GOAL[1] - GOAL[0]),
            )
        ]
        values = [
            sum(x * float(np.prod(places.ravel() ** np.array(powers))) for powers, x in one.items())
            for one in around
        ]
        for length, x in zip(sums, values, strict=True):
            assert (length <= limit) == (x >= 0)
            met += length <= limit
    assert 1000 < met < 8000
