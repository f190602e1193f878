"""Searches in compiled code as Gymnasium environments: exactly the numbers of the PettingZoo
environment, and Gymnasium's own checks.
"""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from tests.unit.envs.test_search_env import SMALL, VARIANTS

import shoal.envs
from shoal.envs import OptionError, SearchEnv, SearchVectorEnv, search_v0

PLAIN = (
    "footprints",
    "obstacles",
    "obstacles-cell",
    "prior",
    "moving",
    "image",
    "flat",
)  # simulated by the PettingZoo environment only, or compared elsewhere
COMPILED = {name: options for name, options in VARIANTS.items() if name not in PLAIN} | {
    "launch": {"robots": 2, "launch": "5,5;-9,45"},
    "packets": {"packet": 64, "network": "replays:0.2,delay:1", "loss": 0.1},
    "bands": {"region": "square:40", "bands": (30, 50), "robots": 2},
    "all-die": {"faults": [f"crash:{robot}@{robot}.5" for robot in range(1, 5)]},
}


def options_of(variant):
    return SMALL | {name: value for name, value in COMPILED[variant].items() if name != "reward"}


@pytest.mark.parametrize("variant", COMPILED)
def test_all_numbers_are_those_of_the_pettingzoo_environment(variant):
    options = options_of(variant)
    agents, env = search_v0.parallel_env(**options), SearchEnv(**options)
    observations, infos = agents.reset(seed=3)
    observation, info = env.reset(seed=3)
    rng = np.random.default_rng(3)
    while agents.agents:
        actions = np.zeros(agents.problem.robots, dtype=np.int64)
        there = list(agents.agents)
        for agent in there:
            i, mask = int(agent[6:]) - 1, infos[agent]["action_mask"]
            for name, values in observations[agent].items():
                np.testing.assert_array_equal(values, observation[name][i], f"{agent}: {name}")
            np.testing.assert_array_equal(mask, info["action_mask"][i])
            # now and then an action that the mask excludes
            some = np.arange(len(mask)) if rng.random() < 0.1 else np.flatnonzero(mask)
            actions[i] = rng.choice(some)
        observations, rewards, _, stopped, infos = agents.step(
            {agent: int(actions[int(agent[6:]) - 1]) for agent in there}
        )
        observation, reward, terminated, truncated, info = env.step(actions)
        assert reward == pytest.approx(np.mean(list(rewards.values())), abs=1e-12)
        assert env.observation_space.contains(observation)
        assert {f"robot_{i + 1}" for i in np.flatnonzero(info["alive"])} >= set(agents.agents)
        assert terminated == (not agents.agents and not any(stopped.values()))
        assert truncated == any(stopped.values())
        assert env._worlds.characters(0) == search_v0.search_text(
            agents._codes(), agents.problem.robots
        )


def test_gymnasiums_own_checks_pass():
    env = gymnasium.make("shoal/Search-v0", **SMALL)
    check_env(env.unwrapped, skip_render_check=True)
    assert env.reset(seed=1)[1]["action_mask"].shape == (4, 6)


@pytest.mark.parametrize("form", ["image", "flat"])
def test_forms_are_those_of_the_pettingzoo_environment(form):
    options = SMALL | {"loss": 0.3, "observation": form}
    agents, env = search_v0.parallel_env(**options), SearchEnv(**options)
    plain = SearchEnv(**SMALL | {"loss": 0.3})
    observation, seen = env.reset(seed=3)[0], plain.reset(seed=3)[0]
    observations, infos = agents.reset(seed=3)
    for _ in range(6):
        assert env.observation_space.contains(observation)
        if form == "flat":
            space = plain.observation_space
            np.testing.assert_array_equal(
                observation, gymnasium.spaces.flatten(space, seen).astype(np.float32)
            )
            own = {name: values[0] for name, values in seen.items()}
            own = gymnasium.spaces.flatten(gymnasium.spaces.Dict(plain_spaces(own)), own)
            np.testing.assert_array_equal(observations["robot_1"], own.astype(np.float32))
        else:
            rows = observation.reshape(4, 5, *observation.shape[1:])
            for i, agent in enumerate(agents.agents):
                np.testing.assert_array_equal(rows[i], observations[agent])
        actions = [int(np.flatnonzero(infos[agent]["action_mask"])[-1]) for agent in agents.agents]
        observation, seen = env.step(actions)[0], plain.step(actions)[0]
        observations, _, _, _, infos = agents.step(dict(zip(agents.agents, actions, strict=True)))


def plain_spaces(values):
    """Return a space for each array, so that Gymnasium can flatten it."""
    return {
        name: gymnasium.spaces.Box(-np.inf, np.inf, array.shape, np.float64)
        for name, array in values.items()
    }


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("form", ["dict", "image", "flat"])
def test_a_vector_does_what_single_environments_do(mode, form):
    options = SMALL | {"max_cycles": 7, "loss": 0.3, "observation": form}
    vector = gymnasium.make_vec("shoal/Search-v0", num_envs=3, autoreset_mode=mode, **options)
    assert isinstance(vector.unwrapped, SearchVectorEnv)
    singles = gymnasium.vector.SyncVectorEnv(
        [lambda: SearchEnv(**options)] * 3, autoreset_mode=gymnasium.vector.AutoresetMode(mode)
    )
    pairs = [vector.reset(seed=5)[0], singles.reset(seed=5)[0]]
    named = (lambda one: one) if form == "dict" else (lambda one: {"all": one})
    rng = np.random.default_rng(5)
    for _ in range(20):
        for name, values in named(pairs[0]).items():
            np.testing.assert_array_equal(values, named(pairs[1])[name])
            assert values.dtype == named(pairs[1])[name].dtype
        np.testing.assert_array_equal(vector.action_masks(), singles.call("action_masks"))
        actions = rng.integers(0, 6, size=(3, 4))
        one, other = vector.step(actions), singles.step(actions)
        np.testing.assert_allclose(one[1], other[1])
        for k in (2, 3):
            np.testing.assert_array_equal(one[k], other[k])
        pairs = [one[0], other[0]]


def test_worlds_do_not_depend_on_each_other():
    """A world plays the same game alone, and beside worlds that need more memory."""
    options = {"region": "square:120", "robots": 5, "network": "delay:3,duplicates:0.4"}
    alone, many = SearchVectorEnv(1, **options), SearchVectorEnv(4, **options)
    alone.reset(seed=[11])
    many.reset(seed=[7, 8, 11, 9])
    rng = np.random.default_rng(1)
    for _ in range(60):
        actions = rng.integers(0, 6, size=(4, 5))
        one, *_ = alone.step(actions[2:3])
        other, *_ = many.step(actions)
        for name, values in one.items():
            np.testing.assert_array_equal(values[0], other[name][2])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"obstacles": 2}, "search: expected footprints of one cell and no obstacles"),
        ({"footprint": (10, 10, 30, 10)}, "search: expected footprints of one cell"),
        ({"reward": "own"}, "reward: expected shared"),
        ({"max_steps": 7}, "max_steps: expected no such option"),
        ({"robots": 52, "observation": "image"}, "observation: expected an image of at most 256"),
        ({"loss": 2}, "loss: expected"),
        ({"live": 3.0}, "live: expected no such option"),
    ],
)
def test_bad_options(options, words):
    with pytest.raises(OptionError, match=words) as caught:
        SearchEnv(**(SMALL | options))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("actions", [0, [0, 0], [0, 0, 0, 6], [0, -1, 0, 0], [0.0] * 4, "up"])
def test_bad_actions(actions):
    env = SearchEnv(**SMALL)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step([0, 0, 0, 0])
    env.reset(seed=1)
    with pytest.raises(gymnasium.error.InvalidAction, match="actions: expected 4 whole numbers"):
        env.step(actions)


def test_pictures():
    env = SearchEnv(render_mode="rgb_array", **SMALL)
    env.reset(seed=1)
    assert env.render().shape == (480, 480, 3)
    assert "shoal/Search-v0" in shoal.envs.REGISTERED
