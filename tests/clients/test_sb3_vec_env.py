"""SB3VecEnv gives what Stable-Baselines3's own vector of single environments gives."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from sb3_contrib.common.maskable.utils import get_action_masks, is_masking_supported
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecMonitor

from shoal.envs import OptionError, SB3VecEnv

SWARM = {"map": "vessels:60", "particles": 12, "max_moves": 15}
SEARCH = {"region": "square:40", "robots": 3, "max_cycles": 12, "loss": 0.3}
VARIANTS = {
    "planes": ("Mapping", SWARM),
    "image": ("Coverage", SWARM | {"rule": "merge", "observation": "image"}),
    "compact": ("Mapping", SWARM | {"observation": "compact"}),
    "maps": ("Mapping", SWARM | {"maps": ["vessels:60", "vessels:40"], "observation": "flat"}),
    "steering": ("Steering", {"max_moves": 4}),
    "steering-flat": ("Steering", {"max_moves": 4, "observation": "flat"}),
    "search": ("Search", SEARCH),
    "search-image": ("Search", SEARCH | {"observation": "image"}),
}


def same(one, other):
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for name in one:
            same(one[name], other[name])
    else:
        np.testing.assert_array_equal(one, other)
        assert np.asarray(one).dtype == np.asarray(other).dtype


@pytest.mark.parametrize("variant", VARIANTS)
def test_all_is_as_in_a_vector_of_single_environments(variant):
    name, options = VARIANTS[variant]
    ours = SB3VecEnv(f"shoal/{name}-v0", num_envs=3, **options)
    theirs = DummyVecEnv([lambda: Monitor(gymnasium.make(f"shoal/{name}-v0", **options))] * 3)
    assert isinstance(ours, VecEnv)
    assert isinstance(ours, SB3VecEnv)
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.seed(5) == theirs.seed(5)
    same(ours.reset(), theirs.reset())
    same_infos(ours.reset_infos, theirs.reset_infos)
    ends = 0
    for _ in range(40):
        actions = np.array([ours.action_space.sample() for _ in range(3)])
        mine, others = ours.step(actions), theirs.step(actions)
        for one, other in zip(mine[:3], others[:3], strict=True):
            same(one, other)
        same_infos(mine[3], others[3])
        same_infos(ours.reset_infos, theirs.reset_infos)
        if is_masking_supported(theirs):
            np.testing.assert_array_equal(get_action_masks(ours), get_action_masks(theirs))
        ends += int(mine[2].sum())
    assert ends > 3
    assert is_masking_supported(ours) == is_masking_supported(theirs) == (name != "Steering")


def same_infos(ours, theirs):
    for one, other in zip(ours, theirs, strict=True):
        assert one.keys() == other.keys()
        for name in one:
            if name == "episode":
                assert one[name]["r"] == pytest.approx(other[name]["r"], abs=1e-5)
                assert one[name]["l"] == other[name]["l"]
            else:
                same(one[name], other[name])


@pytest.mark.parametrize("form", ["planes", "window", "compact", "image", "flat"])
@pytest.mark.filterwarnings("ignore:It seems that your observation space  is an image")
def test_checks_of_stable_baselines(form):
    check_env(gymnasium.make("shoal/Mapping-v0", **SWARM, observation=form))


@pytest.mark.parametrize("name", ["Steering", "Search"])
@pytest.mark.parametrize("form", ["dict", "flat"])
@pytest.mark.filterwarnings("ignore:Your observation .* has an unconventional shape")
def test_checks_of_stable_baselines_for_dicts(name, form):
    check_env(gymnasium.make(f"shoal/{name}-v0", observation=form))


def test_some_environments():
    envs = SB3VecEnv("shoal/Mapping-v0", num_envs=3, **SWARM)
    assert envs.get_attr("problem", [0, 2]) == [envs.envs.problem] * 2
    assert not envs.has_attr("no_such")
    assert envs.env_is_wrapped(Monitor) == [False] * 3
    envs.reset()
    masks = envs.env_method("action_masks")
    np.testing.assert_array_equal(envs.env_method("action_masks", indices=1), masks[1:2])
    assert VecMonitor(envs).reset().shape == envs.reset().shape


def test_pictures():
    envs = SB3VecEnv("shoal/Mapping-v0", num_envs=2, render_mode="rgb_array", **SWARM)
    envs.reset()
    assert len(envs.get_images()) == 2
    assert envs.render().ndim == 3


def test_a_map_for_each_environment():
    envs = SB3VecEnv(
        "shoal/Mapping-v0", num_envs=2, **SWARM | {"maps": ["vessels:60", "vessels:40"]}
    )
    envs.set_options([{"map": 1}, {"map": 0}])
    envs.reset()
    assert [info["map"] for info in envs.reset_infos] == [1, 0]
    envs.set_options([{"map": 1}, {}])
    with pytest.raises(OptionError, match="reset: options: expected the same names"):
        envs.reset()


def test_what_is_wrong_is_said_in_one_sentence():
    vector = gymnasium.make_vec("shoal/Mapping-v0", num_envs=2, **SWARM)
    assert SB3VecEnv(vector).num_envs == 2
    wrapped = gymnasium.wrappers.vector.RecordEpisodeStatistics(vector)
    for given, options, words in (
        (vector, {"num_envs": 2}, "envs: expected the id of an environment together with"),
        (wrapped, {}, "envs: expected a vector environment without wrappers"),
        (3, {}, "envs: expected the id of an environment or a vector environment of Shoal, got 3"),
        ("shoal/Mapping-v0", {"maps": 3}, "maps: expected"),
    ):
        with pytest.raises(OptionError, match=words) as caught:
            SB3VecEnv(given, **options)
        assert "\n" not in str(caught.value)
    envs = SB3VecEnv(vector)
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.step(np.zeros(2, dtype=int))
    for call in (
        lambda: envs.set_attr("map", 1),
        lambda: envs.env_method("no_such"),
        lambda: envs.get_attr("no_such"),
    ):
        with pytest.raises(AttributeError):
            call()
