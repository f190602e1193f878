"""The policy of a learnt neural network, without ONNX Runtime; tests/clients has it."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest

import shoal.envs
from shoal.core.errors import InvalidInputError, MissingExtraError
from shoal.lab import Sweep, run_sweep
from shoal.swarm.policies import Model
from shoal.swarm.policies import model as module
from shoal.swarm.policies.model import PATIENCE, RANDOM, planes_of, useful_commands


class Session:
    """A network that rates the commands by how many particles would enter a frontier cell."""

    def get_inputs(self):
        return [SimpleNamespace(name="planes")]

    def run(self, _, given):
        particles, _, _, frontier = given["planes"][0]
        return [
            [
                np.roll(particles, step, axis=axis)[frontier > 0].sum()
                for step, axis in ((-1, 1), (-1, 0), (1, 1), (1, 0))
            ]
        ]


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_session", lambda *_: Session())
    path = tmp_path / "a.onnx"
    path.write_bytes(b"first")
    return path


def test_it_sees_what_environments_show(file):
    env = gymnasium.make("shoal/Mapping-v0", map="vessels:60:1", particles=5).unwrapped
    rng = np.random.default_rng(0)
    _, info = env.reset(seed=0)
    for _ in range(40):
        np.testing.assert_array_equal(planes_of(env.view), env.planes)
        np.testing.assert_array_equal(useful_commands(env.view), info["action_mask"])
        *_, info = env.step(rng.choice(np.flatnonzero(info["action_mask"])))


def test_it_ends_by_chance_where_the_ratings_lead_nowhere(file, monkeypatch):
    monkeypatch.setattr(Session, "run", lambda *_: [[1, 1, 1, 1]])
    episode = shoal.run("maze:5x5:1", particles=1, policy=f"model:{file}", seed=1, max_moves=5000)
    assert str(episode.status) == "complete"
    assert episode.policy == f"model:{file}"
    assert episode.verify()
    # Of equal commands, the first that has an effect, until nothing new was found for a while.
    idle = episode.trace.classified.tolist().index(0) + 1
    assert "d" not in episode.commands[: idle + PATIENCE - 1]
    assert set(episode.commands) == set("lurd")


def test_a_sweep_refuses_a_changed_file(file, tmp_path):
    problem = {"kind": "swarm", "map": "line:5", "particles": 2, "policy": f"model:{file}"}
    first, more = (
        Sweep(name="s", problem=problem, axes={}, trials=trials, seed=1) for trials in (1, 2)
    )
    store = tmp_path / "s.sqlite"
    run_sweep(first, store, workers=0)
    file.write_bytes(b"second")
    with pytest.raises(InvalidInputError, match=r"content\.model:"):
        run_sweep(first, store, workers=0)
    with pytest.raises(InvalidInputError, match=r"content\.model:"):
        run_sweep(more, store, workers=0, extend=True)


@pytest.mark.parametrize("operator", RANDOM)
def test_a_network_with_random_numbers_is_refused(file, operator):
    file.write_bytes(b"first" + bytes([0x22, len(operator)]) + operator.encode() + b"last")
    with pytest.raises(InvalidInputError, match=f"the operator {operator}, whose results"):
        Model(str(file))


def test_a_dropout_is_refused_if_it_is_random(file, monkeypatch):
    file.write_bytes(b"\x22\x07Dropout")
    assert shoal.run("rectangle:4x4", policy=Model(str(file)), particles=2).verify()
    rng = np.random.default_rng(0)
    monkeypatch.setattr(Session, "run", lambda *_: [rng.random(4)])
    with pytest.raises(InvalidInputError, match="the operator Dropout in the mode for training"):
        shoal.run("rectangle:4x4", policy=Model(str(file)), particles=2)


def test_what_is_refused(tmp_path, monkeypatch):
    with pytest.raises(InvalidInputError, match=r"policy model: cannot read '.*none.onnx'"):
        Model(str(tmp_path / "none.onnx"))
    path = tmp_path / "a.onnx"
    path.write_bytes(b"first")
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'shoal\[onnx\]'"):
        Model(str(path))
    monkeypatch.setattr(module, "_session", lambda *_: Session())
    for options, words in (
        ({"rule": "merge"}, "expected rule block or tilt, got merge"),
        ({"task": "gathering"}, "gathering"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            shoal.run("rectangle:4x4", policy=Model(str(path)), particles=2, **options)
    monkeypatch.setattr(Session, "run", lambda *_: [[np.nan] * 4])
    with pytest.raises(InvalidInputError, match="one rating for each of four commands"):
        shoal.run("rectangle:4x4", policy=Model(str(path)), particles=2)
