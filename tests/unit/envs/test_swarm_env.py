"""The environments of swarms: Gymnasium's own checks for every option, the same episodes as
`shoal.run`, errors.
"""

from __future__ import annotations

import re

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import shoal
import shoal.envs
from shoal.envs import swarm as observations
from shoal.swarm.grid.board import LETTERS

IDS = ["shoal/Mapping-v0", "shoal/Coverage-v0", "shoal/SubsetCoverage-v0"]
SMALL = {"map": "vessels:100", "particles": 20}
VARIANTS = {
    "planes": {},
    "window": {"observation": "window", "window": 9},
    "frontier": {"observation": "window", "window": 9, "center": "frontier"},
    "compact": {"observation": "compact"},
    "compact-3d": {"map": "vessels3d:100", "observation": "compact"},
    "window-3d": {"map": "vessels3d:100", "observation": "window", "window": 5},
    "merge": {"rule": "merge"},
    "tilt": {"rule": "tilt", "observation": "compact"},
    "runs": {"scan_every": 4},
    "doubling": {"scan_every": "doubling"},
    "maps": {"maps": ["vessels:100", "vessels:100:1"], "observation": "window", "window": 41},
    "start": {"map": "line:9", "start": [(0, 3), (0, 4)], "particles": 2},
}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("name", IDS)
def test_gymnasiums_own_checks_pass(name, variant):
    check_env(gymnasium.make(name, **(SMALL | VARIANTS[variant])).unwrapped)


def test_gymnasiums_own_checks_pass_with_noise():
    check_env(
        gymnasium.make(
            IDS[0], **SMALL, slip=0.1, misplace=0.1, miss=0.1, observation="compact"
        ).unwrapped
    )


@pytest.mark.parametrize("rule", ["block", "merge", "tilt"])
@pytest.mark.parametrize("name", IDS)
def test_an_episode_is_that_of_run_with_the_same_seed(name, rule):
    env = gymnasium.make(name, **SMALL, rule=rule).unwrapped
    episode = shoal.run(env.problem.replaced(policy="closest-frontier", max_moves=10_000), seed=5)
    env.reset(seed=5)
    rewards = []
    for letter in episode.commands:
        observation, reward, terminated, truncated, info = env.step(LETTERS.index(letter))
        rewards.append(reward)
    assert terminated == episode.status.done  # under tilt some walls cannot be reached
    assert terminated == (info["frontier"] == 0)
    assert not truncated
    assert info["moves"] == episode.moves
    state, belief = episode.final()
    assert env.view.occupied == state.occupied
    assert env.view.belief == belief
    options = env.options
    classified = int(episode.trace.classified.sum())
    assert sum(
        rewards
    ) == options.classified_reward * classified - options.move_price * episode.moves + (
        options.final_bonus * terminated
    )
    inner = (slice(1, -1),) * 2
    assert (observation[observations.FREE][inner] == belief.open.inner).all()


@pytest.mark.parametrize("rule", ["block", "merge", "tilt"])
@pytest.mark.parametrize("name", IDS)
def test_masked_are_just_the_commands_that_change_nothing(name, rule):
    env = gymnasium.make(name, map="vessels:100", particles=1, rule=rule, max_moves=150).unwrapped
    _, info = env.reset(seed=2)
    rng, seen = np.random.default_rng(1), set()
    terminated = truncated = False
    while not (terminated or truncated):
        before, mask = env.planes, info["action_mask"]
        action = int(rng.integers(4))
        observation, _, terminated, truncated, info = env.step(action)
        assert (before != observation).any() == bool(mask[action])
        seen.add(int(mask[action]))
    assert seen == {0, 1}


def test_a_window_is_a_cut_of_the_planes():
    env = gymnasium.make(IDS[0], **SMALL, observation="window", window=7).unwrapped
    observation, _ = env.reset(seed=3)
    planes = env.planes
    middle = np.rint(np.argwhere(planes[observations.PARTICLES]).mean(axis=0)).astype(int)
    padded = np.pad(planes, ((0, 0), (7, 7), (7, 7)))
    padded[observations.OBSTACLES] = np.pad(planes[observations.OBSTACLES], 7, constant_values=1)
    row, column = middle + 7
    assert (observation == padded[:, row - 3 : row + 4, column - 3 : column + 4]).all()


def test_each_episode_draws_a_map_and_options_choose_one():
    env = gymnasium.make(
        IDS[0], maps=["vessels:100", "vessels:100:1", "vessels:100:2"], particles=5
    ).unwrapped
    env.reset(seed=1)
    assert {env.reset()[1]["map"] for _ in range(30)} == {0, 1, 2}
    assert env.reset(options={"map": 2})[1]["map"] == 2


def test_render_modes():
    env = gymnasium.make(IDS[0], map="line:3", start=[(0, 1)], particles=1, render_mode="ansi")
    env.reset(seed=1)
    env.step(0)
    assert env.render().splitlines() == [" ??  ", "?o.? ", " ??  "]
    env = gymnasium.make(IDS[0], **SMALL, render_mode="rgb_array")
    env.reset(seed=1)
    assert env.render().shape == (24 * 20, 21 * 20, 3)
    env = gymnasium.make(IDS[0], map="vessels3d:100", particles=20, render_mode="rgb_array")
    env.reset(seed=1)
    assert env.render().shape[0] == 480, "a view of the volume with slices beside it"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"particles": 0}, "particles: expected"),
        ({"particles": 1000}, "particles: expected 1 to 100"),
        ({"observation": "picture"}, "observation: expected"),
        ({"observation": "window", "window": 4}, "window: expected an odd number"),
        ({"partikles": 4}, "partikles: expected no such option, got 4 (did you mean 'particles'?)"),
        ({"policy": "best"}, "policy: expected no such option"),
        ({"scan_every": "adaptive"}, "scan_every: expected"),
        ({"map": "no/such.png"}, "no/such.png"),
        ({"maps": "vessels:100"}, "maps: expected a list"),
        ({"maps": ["vessels:100", "vessels3d:100"]}, "maps: expected all of 2"),
    ],
)
def test_bad_options(options, words):
    with pytest.raises(shoal.envs.OptionError, match=re.escape(words)) as caught:
        gymnasium.make(IDS[0], **(SMALL | options))
    assert isinstance(caught.value, ValueError)
    assert isinstance(caught.value, gymnasium.error.Error)
    assert "\n" not in str(caught.value)


def test_wrong_steps_and_resets():
    with pytest.raises(gymnasium.error.UnsupportedMode, match="render_mode: expected"):
        shoal.envs.SwarmEnv(**SMALL, render_mode="film")
    env = gymnasium.make(IDS[0], **SMALL, max_moves=2).unwrapped
    for method in (lambda: env.step(0), env.render):
        with pytest.raises(gymnasium.error.ResetNeeded):
            method()
    env.reset(seed=1)
    for action in (4, -1, 0.5, "l", None, np.zeros(2, dtype=int)):
        with pytest.raises(gymnasium.error.InvalidAction, match="whole number from 0 to 3"):
            env.step(action)
    with pytest.raises(gymnasium.error.UnsupportedMode, match="render: expected"):
        env.render()
    for options in ({"map": 1}, {"start": 3}):
        with pytest.raises(shoal.envs.OptionError, match="reset"):
            env.reset(options=options)
    env.reset(seed=1)
    assert not env.step(0)[3]
    assert env.step(1)[3], "truncated by max_moves"
    with pytest.raises(gymnasium.error.ResetNeeded, match="expected a reset first"):
        env.step(0)
