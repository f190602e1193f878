"""The policy of a learnt neural network, with ONNX Runtime."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import shoal
from shoal.core.errors import InvalidInputError
from shoal.swarm.policies import Model
from shoal.swarm.policies.model import planes_of

sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
import learn_mapping


@pytest.fixture(scope="module")
def network():
    return learn_mapping.Network(np.random.default_rng(0))


def test_the_exported_network_rates_as_the_trained_one(network, tmp_path):
    path = tmp_path / "a.onnx"
    learn_mapping.export(network, str(path))
    policy = Model(str(path))
    env = learn_mapping.environment(["vessels:300:5"], 30, 1000)
    rng, last = np.random.default_rng(1), -1
    _, info = env.reset(seed=0)
    for _ in range(40):
        patches, shared = learn_mapping.features(env.unwrapped, last)
        ratings = network.forward(patches[None], shared[None])[0][0]
        np.testing.assert_allclose(
            policy.rate(planes_of(env.unwrapped.view), last), ratings, rtol=1e-4, atol=1e-5
        )
        last = int(rng.choice(np.flatnonzero(info["action_mask"])))
        *_, info = env.step(last)
    episode = shoal.run("vessels:60", particles=5, policy=f"model:{path}", seed=1)
    assert str(episode.status) == "complete"
    assert episode.verify()


def test_other_files_are_refused(network, tmp_path):
    import onnx

    path = tmp_path / "a.onnx"
    path.write_bytes(b"no network")
    with pytest.raises(InvalidInputError, match="expected a file with an ONNX network"):
        Model(str(path))
    learn_mapping.export(network, str(path))
    graph = onnx.load(path)
    for node in graph.graph.node:
        node.input[:] = ["other" if name == "last" else name for name in node.input]
    graph.graph.input[1].name = "other"
    onnx.save(graph, path)
    with pytest.raises(InvalidInputError, match=r"got .*: the inputs planes, other"):
        Model(str(path))
