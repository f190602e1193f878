"""The learned examples: their gradients are right, they learn, and they run as they stand with a
tiny budget.
"""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[3] / "examples"


def loaded(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def example():
    return loaded("learn_mapping")


@pytest.fixture(scope="module")
def trial_and_error():
    return loaded("reinforce_mapping")


def states(example, count, rng):
    """Return states at random, and the command whose entry in the last shared number but two is
    largest as their label.
    """
    patches = rng.integers(0, 9, (count, 3, 5, example.SIDE, example.SIDE)).astype(np.uint8)
    shared = rng.normal(size=(count, 4, example.SHARED)).astype(np.float32)
    return patches, shared, shared[:, :, 2].argmax(axis=1)


def test_gradients_are_those_of_the_loss(example):
    rng = np.random.default_rng(1)
    network = example.Network(rng)
    given = states(example, 5, rng)
    weights = {name: weight.astype(np.float64) for name, weight in network.weights.items()}

    def loss(name, place, change):
        moved = {key: value.copy() for key, value in weights.items()}
        moved[name][place] += change
        network.weights = moved
        return network.learn(*given, rate=0.0, mirrored=False)

    network.weights = {name: weight.copy() for name, weight in weights.items()}
    network.means = {name: np.zeros_like(weight) for name, weight in weights.items()}
    network.updates = 0
    network.learn(*given, rate=0.0, mirrored=False)
    # after one step the mean is a tenth of the slope
    slopes = {name: 10 * mean for name, mean in network.means.items()}
    for name, weight in weights.items():
        place = np.unravel_index(np.abs(slopes[name]).argmax(), weight.shape)
        change = 1e-4
        measured = (loss(name, place, change) - loss(name, place, -change)) / (2 * change)
        assert slopes[name][place] == pytest.approx(measured, rel=0.02, abs=1e-5)


def test_it_learns_what_it_is_shown(example):
    rng = np.random.default_rng(2)
    network = example.Network(rng)
    data = list(zip(*states(example, 128, rng), strict=True))
    before = example.train(network, data, 1, rng)
    assert example.train(network, data, 40, rng, rate=5e-3) < before / 2


def test_a_turned_map_has_the_same_ratings_turned(example):
    rng = np.random.default_rng(3)
    network = example.Network(rng)
    patches, shared, _ = states(example, 2, rng)
    ratings = network.forward(patches, shared)[0]
    turned = np.rot90(patches, 1, axes=(3, 4))  # what was up is left now
    assert np.allclose(
        network.forward(turned, np.roll(shared, -1, axis=1))[0],
        np.roll(ratings, -1, axis=1),
        atol=1e-4,
    )


def test_it_runs_as_it_stands(example, capsys):
    budget = (
        "--cells 60 --particles 5 --maps 1 --rounds 1 --epochs 1 --tests 1 --large 0 --max-moves 15"
    )
    example.main(budget.split())
    told = capsys.readouterr().out
    policies = re.findall(r"^\| ([a-z()-]+(?: \(this script\))?) \| [\d.]+ \|", told, re.M)
    assert policies == [
        "random-moves",
        "closest-frontier",
        "greedy-classify",
        "learned (this script)",
        "best",
    ]


def test_gradients_of_trial_and_error_are_those_of_its_loss(trial_and_error):
    rng = np.random.default_rng(1)
    network = trial_and_error.Network(rng)
    network.weights = {
        name: 3 * weight.astype(np.float64) for name, weight in network.weights.items()
    }
    inputs, mask = rng.normal(size=(6, 4, trial_and_error.INPUTS)), np.array([[1, 1, 1, 0]] * 6)
    actions, old, gains, returns = (
        rng.integers(0, 3, 6),
        rng.uniform(0.1, 0.9, 6),
        rng.normal(size=6),
        rng.normal(size=6),
    )

    def loss():
        chances, values, _ = network.forward(inputs, mask)
        ratio = chances[np.arange(6), actions] / old
        clipped = ratio.clip(1 - trial_and_error.CLIP, 1 + trial_and_error.CLIP)
        entropy = -(chances * np.log(chances + 1e-12)).sum(axis=1)
        worth = np.minimum(ratio * gains, clipped * gains) + trial_and_error.ENTROPY * entropy
        return (-worth + 0.25 * (values - returns) ** 2).mean()

    chances, values, kept = network.forward(inputs, mask)
    slopes = network.slopes(
        kept, *trial_and_error.slopes_of_loss(chances, values, actions, old, gains, returns)
    )
    for name, weight in network.weights.items():
        place = np.unravel_index(np.abs(slopes[name]).argmax(), weight.shape)
        weight[place] += 1e-5
        above = loss()
        weight[place] -= 2e-5
        assert slopes[name][place] == pytest.approx((above - loss()) / 2e-5, rel=1e-3)
        weight[place] += 1e-5


def test_a_turned_swarm_has_the_same_chances_turned(trial_and_error):
    """A quarter turn makes what was up left: the 21 numbers change places, and so do the chances of
    the commands.
    """
    rng = np.random.default_rng(2)
    seen, last = rng.uniform(-1, 1, (3, 21)).astype(np.float32), np.array([0, 2, -1])
    turned = seen.copy()
    for first in (0, 4, 8):
        turned[:, first : first + 4] = np.roll(seen[:, first : first + 4], -1, axis=1)
    turned[:, 13], turned[:, 14] = -seen[:, 14], seen[:, 13]  # row and column of a way
    turned[:, 15], turned[:, 16] = 1 - seen[:, 16], seen[:, 15]  # of a place
    turned[:, 17], turned[:, 18] = seen[:, 18], seen[:, 17]  # of a spread
    network, mask = trial_and_error.Network(rng), np.ones((3, 4))
    chances = network.forward(trial_and_error.turned(seen, last), mask)[0]
    again = network.forward(
        trial_and_error.turned(turned, np.where(last < 0, last, (last - 1) % 4)), mask
    )[0]
    assert np.allclose(again, np.roll(chances, -1, axis=1), atol=1e-5)


def test_trial_and_error_runs_as_it_stands(trial_and_error, capsys, tmp_path, monkeypatch):
    monkeypatch.setattr(trial_and_error, "ENVIRONMENTS", 4)
    monkeypatch.setattr(trial_and_error, "STEPS", 8)
    budget = "--cells 60 --particles 5 --maps 1 --commands 64 --longest 5 --tests 1 --max-moves 15"
    trial_and_error.main([*budget.split(), "--plot", str(tmp_path / "curve.png")])
    assert len(re.findall(r"^\| ([a-z() -]+) \| [\d.]+ \|", capsys.readouterr().out, re.M)) == 5
    assert (tmp_path / "curve.png").stat().st_size > 1000
