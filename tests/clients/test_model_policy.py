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
import tune_mapping


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
        seen = learn_mapping.features(env.unwrapped.planes[None], np.array([last]))
        ratings = network.forward(*seen)[0][0]
        np.testing.assert_allclose(
            policy.rate(planes_of(env.unwrapped.view), last), ratings, rtol=1e-4, atol=1e-5
        )
        last = int(rng.choice(np.flatnonzero(info["action_mask"])))
        *_, info = env.step(last)
    episode = shoal.run("vessels:60", particles=5, policy=f"model:{path}", seed=1)
    assert str(episode.status) == "complete"
    assert episode.verify()


def test_the_actor_rates_as_the_network_that_it_begins_with(network):
    import torch

    rng = np.random.default_rng(2)
    patches = rng.integers(0, 256, (3, 4, 5, *[learn_mapping.SIDE] * 2)).astype(np.uint8)
    shared = rng.normal(size=(3, 4, learn_mapping.SHARED)).astype(np.float32)
    actor = tune_mapping.Actor(network.weights)
    ratings, _ = actor(torch.from_numpy(patches), torch.from_numpy(shared))
    expected = network.forward(patches, shared)[0]
    np.testing.assert_allclose(
        ratings.detach(), tune_mapping.SHARPER * expected, rtol=1e-4, atol=1e-4
    )
    after = actor.network().forward(patches, shared)[0]
    np.testing.assert_allclose(after, ratings.detach(), rtol=1e-4, atol=1e-4)


def test_trial_and_error_changes_the_network_and_repeats_itself(network, monkeypatch):
    monkeypatch.setattr(tune_mapping, "GROUPS", ((60, 5, 4, 30), (100, 8, 2, 30)))
    monkeypatch.setattr(tune_mapping, "STEPS", 8)
    commands = 8 * 6 * (tune_mapping.WARM + 2)
    tuned = [
        tune_mapping.tune(network, commands=commands, maps=range(2), seed=seed)
        for seed in (1, 1, 2)
    ]
    first, again, other = (one.weights["a"] for one in tuned)
    assert np.isfinite(first).all()
    assert not np.array_equal(first, network.weights["a"])
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


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


@pytest.mark.parametrize(
    ("operator", "refused"),
    [("RandomUniform", True), ("Multinomial", True), ("training", True), ("Dropout", False)],
)
def test_networks_that_rate_at_random_are_refused(operator, refused, tmp_path):
    """Also in the branch of an If."""
    from onnx import TensorProto, helper, numpy_helper, save

    def made(name, *inputs, output="rated", **attributes):
        return helper.make_node(name, inputs, [output], **attributes)

    constants = [
        numpy_helper.from_array(np.ones((1, 4), np.float32), "four"),
        numpy_helper.from_array(np.array(0.5, np.float32), "half"),
        numpy_helper.from_array(np.array(operator == "training"), "training"),
        numpy_helper.from_array(np.array(True), "yes"),
    ]
    if operator in ("training", "Dropout"):
        nodes = [made("Dropout", "four", "half", "training")]
    else:
        inner = (
            [made("RandomUniform", shape=[1, 4])]
            if operator == "RandomUniform"
            else [
                made("Multinomial", "four", output="drawn", sample_size=4),
                made("Cast", "drawn", to=TensorProto.FLOAT),
            ]
        )
        rated = helper.make_tensor_value_info("rated", TensorProto.FLOAT, [1, 4])
        branch = helper.make_graph(inner, "branch", [], [rated])
        nodes = [made("If", "yes", output="out", then_branch=branch, else_branch=branch)]
    name = nodes[-1].output[0]
    planes = helper.make_tensor_value_info("planes", TensorProto.FLOAT, [1, 4, None, None])
    graph = helper.make_graph(
        nodes,
        "network",
        [planes],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 4])],
        constants,
    )
    path = tmp_path / "a.onnx"
    opsets = [helper.make_opsetid("", 18)]
    save(helper.make_model(graph, opset_imports=opsets, ir_version=9), path)

    def run():
        return shoal.run("rectangle:4x4", policy=f"model:{path}", particles=2, seed=1)

    if not refused:
        assert run().verify()
        return
    with pytest.raises(InvalidInputError, match=f"operator .*({operator}|for training)"):
        run()
