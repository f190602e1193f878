"""The learned example: its gradients are right, it learns what it is shown, and it runs as it stands with a tiny budget."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

PATH = Path(__file__).parents[3] / "examples" / "learn_mapping.py"


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("learn_mapping", PATH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def states(example, count, rng):
    """Return states at random, and the command whose entry in the last shared number but two is largest as their label."""
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
    slopes = {name: 10 * mean for name, mean in network.means.items()}  # after one step the mean is a tenth of the slope
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
    assert np.allclose(network.forward(turned, np.roll(shared, -1, axis=1))[0], np.roll(ratings, -1, axis=1), atol=1e-4)


def test_it_runs_as_it_stands(example, capsys):
    budget = "--cells 60 --particles 5 --maps 1 --rounds 1 --epochs 1 --tests 1 --large 0 --max-moves 15"
    example.main(budget.split())
    told = capsys.readouterr().out
    policies = re.findall(r"^\| ([a-z()-]+(?: \(this script\))?) \| [\d.]+ \|", told, re.M)
    assert policies == ["random-moves", "closest-frontier", "greedy-classify", "learned (this script)", "best"]
