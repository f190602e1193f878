"""Potentials between the first and the last contact: bounds are right, and wrong ones are refused."""

from concurrent.futures import ThreadPoolExecutor
from copy import deepcopy
from fractions import Fraction
from itertools import count, pairwise
from time import process_time

import numpy as np
import pytest

from shoal.steering import SteeringProblem, certify, check_certificate
from shoal.steering.certificates import search
from shoal.steering.certificates.check_contacts import (
    Contacts,
    Sector,
    changed_at_last_contact,
    contact_values,
    cross_product,
    flat_monomials,
)
from shoal.steering.certificates.check_potential import WrongPotentialError, monomials
from shoal.steering.certificates.contacts import ContactSearch
from shoal.steering.run import run

NEAR = 1e-6


def _random_plan(rng):
    """Return the states of a plan in the unit disk, with the number of the first and the last state
    with a contact, its particles, and the length. Its inputs are translations and holds in turn.
    """
    while True:
        places = rng.uniform(-1, 1, size=(2, 2))
        if np.hypot(*places.T).max() < 1:
            break
    states, contacts, length = [places], [], 0.0
    for _ in range(int(rng.integers(1, 4))):
        angle = rng.uniform(0, 2 * np.pi)
        heading = np.array([np.cos(angle), np.sin(angle)])
        along = places @ heading
        reach = -along + np.sqrt(along**2 + 1 - np.sum(places**2, axis=1))
        held = int(np.argmin(reach))
        places = places + reach[held] * heading
        length += float(reach[held])
        contacts.append((len(states), held))
        states.append(places)
        away = rng.normal(size=2) * 0.4
        away *= np.sign(away @ places[held])
        after = places.copy()
        after[1 - held] += away
        if np.hypot(*after[1 - held]) < 1:
            places = after
            length += float(np.hypot(*away))
            contacts.append((len(states), held))
            states.append(places)
    last = places * rng.uniform(0.5, 1)
    move = last.mean(axis=0) - places.mean(axis=0)
    places = places + move
    return [*states, places], contacts, length + float(np.hypot(*move))


def _plans(number):
    """Yield plans that change the difference by more than a little, and begin and end in the disk."""
    rng = np.random.default_rng(5)
    while number:
        states, contacts, length = _random_plan(rng)
        moved = np.diff(states[-1] - states[0], axis=0)
        changes = [
            k
            for k, (a, b) in enumerate(pairwise(states))
            if np.abs(np.diff(b - a, axis=0)).max() > 1e-12
        ]
        if np.hypot(*moved.T)[0] < 0.05 or np.hypot(*states[-1].T).max() > 1:
            continue
        held = dict(contacts)
        yield (
            states,
            (changes[0], held[changes[0]]),
            (changes[-1] + 1, held[changes[-1] + 1]),
            length,
        )
        number -= 1


def _contacts(states, limit):
    ends = [[Fraction(x) for x in states[k].ravel().tolist()] for k in (0, -1)]
    return Contacts(*ends, Fraction(NEAR), Fraction(limit), Fraction(0))


def _is_in(sector, particle, point):
    x = Fraction(float(point[0])), Fraction(float(point[1]))
    return sector.particle == particle and cross_product(sector.first, x) >= 0 <= cross_product(
        x, sector.last
    )


def test_the_first_and_the_last_contact_are_in_a_pair_of_sectors_whose_region_has_the_states():
    met = 0
    for states, first, last, length in _plans(60):
        contacts = _contacts(states, length * 1.0001)
        if not contacts.possible:
            continue
        pairs = [
            pair
            for pair in contacts.roots()
            if all(
                _is_in(sector, held, states[number][held])
                for sector, (number, held) in zip(pair, (first, last), strict=True)
            )
        ]
        assert len(pairs) == 1
        # narrow sectors around both contacts
        narrow = []
        for number, held in (first, last):
            x, y = states[number][held]
            around = [
                Fraction(float(z)) for z in (x + 0.1 * y, y - 0.1 * x, x - 0.1 * y, y + 0.1 * x)
            ]
            narrow.append(Sector(held, (around[0], around[1]), (around[2], around[3])))
        for pair in (pairs[0], tuple(narrow)):
            region = contacts.region(*pair)
            assert region is not None
            for state in states[first[0] : last[0] + 1]:
                for one in region:
                    value = sum(
                        x * float(np.prod(state.ravel() ** np.array(powers)))
                        for powers, x in one.items()
                    )
                    assert value >= -(2.0**8)  # times 2**40
                    met += 1
    assert met > 300


@pytest.mark.parametrize(("workers", "most"), [(1, 18), (3, 9)])
def test_no_plan_is_shorter_than_the_bound_for_where_it_ends(workers, most):
    compared = 0
    for states, _, _, length in _plans(2):
        with ThreadPoolExecutor(workers) as pool:
            found = ContactSearch(pool, states[0], states[-1], NEAR, 1.2 * length, 0.0)
            while found.possible and found.tried < most and found.lower < found.limit:
                found.step(workers, patient=True)
                assert found.lower <= length + 4 * NEAR
        if found.possible and found.lower:
            compared += found.lower > 0.5 * length
            values = [
                float(value) for value in contact_values(found.contacts, found.proof(found.lower))
            ]
            assert min(values) >= found.lower
    assert compared


@pytest.mark.parametrize("particle", [0, 1])
def test_a_tolerance_changes_the_potential_at_the_last_contact_by_at_most_its_bound(particle):
    rng, near = np.random.default_rng(11), 0.01
    goal = np.array([[0.3, -0.2], [-0.1, 0.25]])
    ends = [[Fraction(x) for x in place.ravel().tolist()] for place in (goal[::-1], goal)]
    contacts = Contacts(*ends, Fraction(near), Fraction(9), Fraction(0))
    powers = np.array(monomials(5)[1:])
    for width in (0.02, 0.5):
        angle = rng.uniform(0, 2 * np.pi)
        turns = angle + np.array([-width, width])
        directions = [(Fraction(float(np.cos(x))), Fraction(float(np.sin(x)))) for x in turns]
        sector = Sector(particle, *directions)
        numbers = rng.integers(-(1 << 36), 1 << 36, size=len(powers))
        potential = {tuple(key): int(x) for key, x in zip(powers.tolist(), numbers, strict=True)}
        bound = float(changed_at_last_contact(contacts, sector, potential))

        def value(contact, other, coefficients=numbers / 2**36):
            place = [contact, other] if particle == 0 else [other, contact]
            return float(np.prod(np.ravel(place) ** powers, axis=1) @ coefficients)

        apart = (goal[1] - goal[0]) * (1 - 2 * particle)
        greatest = 0.0
        for _ in range(400):
            turn = rng.uniform(*turns)
            contact = np.array([np.cos(turn), np.sin(turn)])
            moved = contact + apart + rng.choice([-2 * near, 2 * near], size=2)
            greatest = max(greatest, abs(value(contact, moved) - value(contact, contact + apart)))
        assert 0 < greatest <= bound
        assert width > 0.1 or bound < 3 * greatest


@pytest.fixture(scope="module", params=["disk", "regular:60"])
def certificate(request):
    patch, ticks = pytest.MonkeyPatch(), count()
    patch.setattr(search, "_DOUBLED", 8)
    patch.setattr(search, "_STALLED", (-1.0, -1.0))
    patch.setattr(search, "potential_bound", lambda relaxation: (0.0, None))
    # as many steps as give potentials of degree 5, on any computer
    seed, tick = {"disk": (570671312, 0.01), "regular:60": (536368455, 0.02)}[request.param]
    found = certify(
        run(SteeringProblem(request.param), seed=seed),
        seconds=1,
        clock=lambda: tick * next(ticks),
        workers=1,
    )
    patch.undo()
    assert "parts" in found.proof["trees"][0]["proof"]
    assert check_certificate(found.proof)
    return found.proof


def _some(proof):
    """Return a part with a potential of degree 5."""
    return next(
        part for part in proof["parts"] if len(part.get("potential", [])) == len(monomials(5)) - 1
    )


def _cut(proof):
    return next(part for part in proof["parts"] if "direction" in part)


DAMAGES = {
    "a greater bound": lambda whole, proof: whole.update(lower_bound=1.001 * whole["lower_bound"]),
    "a lower limit": lambda whole, proof: proof.update(limit=0.99 * whole["lower_bound"]),
    "no limit": lambda whole, proof: proof.update(limit=float("nan")),
    "a part less": lambda whole, proof: proof["parts"].pop(),
    "a part more": lambda whole, proof: proof["parts"].append(_some(proof)),
    "no potential": lambda whole, proof: _some(proof).pop("potential"),
    "only potentials": lambda whole, proof: proof.update(parts=[_some(proof)] * 4),
    "another side": lambda whole, proof: _cut(proof).update(side="both"),
    "a direction outside": lambda whole, proof: _cut(proof).update(
        direction=[-x for x in _cut(proof)["direction"]]
    ),
    "a greater potential": lambda whole, proof: _some(proof).update(
        potential=[1.25 * x for x in _some(proof)["potential"]]
    ),
    "one end": lambda whole, proof: _some(proof)["ends"].pop(),
    "a long direction": lambda whole, proof: _some(proof)["ends"][0].update(direction=[1.0, 0.5]),
    "a square less": lambda whole, proof: _some(proof)["ends"][1]["squares"].pop(),
    "a negative square": lambda whole, proof: _some(proof)["ends"][0]["squares"][0].__setitem__(
        0, -1.0
    ),
    "another square": lambda whole, proof: _some(proof)["ends"][1]["squares"][1].__setitem__(
        0, 9.0
    ),
    "a hold that draws": lambda whole, proof: _some(proof)["cases"][1]["holds"][0].__setitem__(
        0, -0.5
    ),
    "a word": lambda whole, proof: _cut(proof).update(direction=["1e9", "1"]),
    "another start": lambda whole, proof: whole["start"][0].__setitem__(
        0, whole["start"][0][0] + 0.01
    ),
    "another goal": lambda whole, proof: whole["goal"][1].__setitem__(
        1, whole["goal"][1][1] + 0.01
    ),
    "a wide tolerance": lambda whole, proof: whole.update(tolerance=0.01),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_proof_is_refused(certificate, damage):
    wrong = deepcopy(certificate)
    DAMAGES[damage](wrong, wrong["trees"][0]["proof"])
    checked = check_certificate(wrong)
    assert not checked
    assert "certificate" in checked.message


def test_other_processors_look_for_potentials_while_patterns_are_divided(monkeypatch):
    monkeypatch.setattr(search, "_EASY", 2)
    monkeypatch.setattr(search, "_BETTER", -1.0)  # patterns are never given up
    monkeypatch.setattr(search, "_STALLED", (9.0, 9.0))
    monkeypatch.setattr(search, "potential_bound", lambda relaxation: (0.0, None))
    steps = []
    step = ContactSearch.step

    def noted(self, workers, *, patient):
        step(self, workers, patient=patient)
        steps.append((workers, patient, self.tried))

    monkeypatch.setattr(ContactSearch, "step", noted)
    episode = run(SteeringProblem("disk"), seed=570671312)
    for workers, used in ((3, {(2, False)}), (1, set())):
        steps.clear()
        found = certify(episode, seconds=1.5, clock=process_time, workers=workers)
        assert check_certificate(found.proof)
        assert found.lower_bound <= episode.length
        assert {first[:2] for first in steps} == used
        assert (max(steps)[2] > 0) if used else not steps


def test_plans_without_contacts_have_no_such_proof():
    places = np.array([(0.1, 0.2), (-0.3, 0.4)])
    found = ContactSearch(ThreadPoolExecutor(1), places, places + 0.1, NEAR, 1.0, 0.0)
    assert not found.possible
    assert found.lower == 0
    with pytest.raises(WrongPotentialError):
        list(contact_values(found.contacts, {"parts": []}))


def test_flat_monomials_begin_with_the_constant():
    assert flat_monomials(1) == [(0, 0), (0, 1), (1, 0)]
