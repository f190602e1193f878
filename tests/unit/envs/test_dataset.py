"""Policies played into datasets of Minari: they open again, hold what the environment told, and are
written whole or not at all.
"""

from __future__ import annotations

import gymnasium
import minari
import numpy as np
import pytest

import shoal
import shoal.envs
from shoal.core.errors import OutputError
from shoal.swarm import GridWorkspace

SMALL = {"map": "vessels:100", "particles": 20}


def mapping(**options):
    return gymnasium.make("shoal/Mapping-v0", **(SMALL | options))


def test_what_is_stored_is_what_the_environment_told(tmp_path):
    env = mapping(observation="window", window=9)
    shoal.envs.record_episodes(env, "closest-frontier", tmp_path / "data", episodes=2, seed=4)
    dataset = minari.MinariDataset(tmp_path / "data")
    assert dataset.total_episodes == 2
    assert dataset.observation_space == env.observation_space
    for k, episode in enumerate(dataset):
        played = shoal.run(env.unwrapped.problem.replaced(policy="closest-frontier"), seed=4 + k)
        assert len(episode) == played.moves
        observation, info = env.reset(seed=4 + k)
        for step, action in enumerate(episode.actions):
            assert (episode.observations[step] == observation).all()
            assert (episode.infos["action_mask"][step] == info["action_mask"]).all()
            observation, reward, terminated, truncated, info = env.step(action)
            told = (episode.rewards[step], episode.terminations[step], episode.truncations[step])
            assert told == (reward, terminated, truncated)
        assert (episode.observations[-1] == observation).all()
        assert episode.terminations[-1]
    again = dataset.recover_environment()
    assert again.observation_space == env.observation_space


def test_planners_of_steering(tmp_path):
    env = gymnasium.make("shoal/Steering-v0")
    dataset = shoal.envs.record_episodes(env, "shortest", tmp_path / "data", episodes=2)
    for episode in dataset:
        assert episode.terminations[-1]
        assert set(episode.observations) == {"particles", "delta", "goals", "goal_delta"}
        assert episode.observations["delta"].shape == (len(episode) + 1, 1, 2)


def test_any_function_is_a_policy(tmp_path):
    rng = np.random.default_rng(1)

    def choose(observation, info):
        return int(rng.choice(np.flatnonzero(info["action_mask"])))

    dataset = shoal.envs.record_episodes(
        mapping(max_moves=5), choose, tmp_path / "data", episodes=1, name="mine/some-v0"
    )
    assert dataset.id == "mine/some-v0"
    assert dataset[0].truncations.tolist() == [False] * 4 + [True]


def test_a_policy_that_gives_up_is_truncated(tmp_path):
    dataset = shoal.envs.record_episodes(mapping(), "manual:lurd", tmp_path / "data", episodes=1)
    assert dataset[0].actions.tolist() == [0, 1, 2, 3]
    assert dataset[0].truncations.tolist() == [False, False, False, True]


def test_maps_that_have_no_name_are_no_part_of_the_spec(tmp_path):
    dataset = shoal.envs.record_episodes(
        mapping(map=GridWorkspace([[1] * 9]), particles=1),
        "closest-frontier",
        tmp_path / "data",
        episodes=1,
    )
    assert dataset.env_spec is None
    assert dataset[0].observations.shape[1:] == (4, 3, 11)


def test_nothing_is_left_of_a_recording_that_fails(tmp_path):
    for policy, words in [
        ("no-such", "unknown policy"),
        (lambda observation, info: 7, "actions: expected"),
    ]:
        with pytest.raises(gymnasium.error.Error, match=words):
            shoal.envs.record_episodes(mapping(), policy, tmp_path / "data", episodes=1)
    with pytest.raises(shoal.envs.OptionError, match="scan_every: expected 1"):
        shoal.envs.record_episodes(
            mapping(scan_every=3), "closest-frontier", tmp_path / "data", episodes=1
        )
    with pytest.raises(shoal.envs.OptionError, match="expected a swarm or steering environment"):
        shoal.envs.record_episodes(
            gymnasium.make("CartPole-v1"), "closest-frontier", tmp_path / "data"
        )
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "data").mkdir()
    with pytest.raises(OutputError, match="does not exist yet"):
        shoal.envs.record_episodes(mapping(), "closest-frontier", tmp_path / "data")
