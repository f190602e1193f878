"""The environment of steering: Gymnasium's own checks for every option, the same episodes as
`shoal.run`, errors.
"""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import shoal
import shoal.envs
from shoal.steering import SteeringProblem, prism, region, regular_polygon

NAME = "shoal/Steering-v0"
PAIR = {"start": [(0.2, 0.5), (0.4, 0.5)], "goal": [(0.3, 0.5), (0.4, 0.5)]}
VARIANTS = {
    "square": {},
    "disk": {"workspace": "disk", "longest_move": 0.1},
    "friction": {"workspace": "hexagon", "friction": 0.5},
    "noise": {"execution": 0.01, "gain": 0.2},
    "spheres": {"particle_radius": 0.1},
    "three": {
        "start": [(0.2, 0.5), (0.4, 0.5), (0.3, 0.1)],
        "goal": [(0.2, 0.3), (0.4, 0.5), (0.1, 0.1)],
        "interchangeable": True,
    },
    "space": {
        "workspace": prism(regular_polygon(4), 1.0),
        "start": [(0, 0.1, 0.5), (0.1, 0.1, 0.5)],
        "goal": [(0, 0.1, 0.5), (0.1, 0.1, 0.3)],
    },
    "obstacle": {
        "workspace": region(
            [(0, 0), (1, 0), (1, 1), (0, 1)], [[(0.4, 0.4), (0.6, 0.4), (0.6, 0.6), (0.4, 0.6)]]
        )
    },
    "goal-outside": {**PAIR, "goal_x": 1.5, "goal_y": 0.5},
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_gymnasiums_own_checks_pass(variant):
    check_env(gymnasium.make(NAME, **VARIANTS[variant]).unwrapped)


@pytest.mark.filterwarnings("ignore:.*infinity")  # what a camera with noise sees has no bounds
def test_gymnasiums_own_checks_pass_with_a_noisy_camera():
    check_env(gymnasium.make(NAME, measurement=0.01).unwrapped)


@pytest.mark.parametrize("fields", [{}, {"execution": 0.001, "gain": 0.1}])
def test_an_episode_is_that_of_run_with_the_same_seed(fields):
    episode = shoal.run(SteeringProblem(planner="greedy", **fields), seed=3)
    env = gymnasium.make(NAME, tolerance=1e-6, **fields).unwrapped
    observation, info = env.reset(seed=3)
    assert (observation["particles"] == episode.states[0].astype(np.float32)).all()
    start_error, rewards = info["error"], []
    for move, state in zip(episode.inputs, episode.states[1:], strict=True):
        observation, reward, terminated, truncated, info = env.step(move)
        rewards.append(reward)
        exact = env._worlds.batch.states[0]
        assert np.abs(exact - state).max() < 1e-9
        assert (observation["particles"] == exact.astype(np.float32)).all()
        assert (observation["delta"] == (exact[1:] - exact[0]).astype(np.float32)).all()
    assert terminated == (episode.error <= 1e-6)
    assert not truncated
    options = env.options
    expected = (
        start_error
        - info["error"]
        - options.move_price * episode.moves
        + options.final_bonus * terminated
    )
    assert sum(rewards) == pytest.approx(expected)


def test_the_actions_of_an_expert_solve_it():
    env = gymnasium.make(NAME).unwrapped
    for seed in range(3):
        env.reset(seed=seed)
        ends = [env.step(action)[2] for action in env.expert_actions("shortest") if env._running]
        assert ends[-1]
    env.reset(seed=0)
    with pytest.raises(shoal.envs.OptionError, match="planner"):
        env.expert_actions("no-such")
    short = gymnasium.make(NAME, **PAIR, longest_move=0.1).unwrapped
    short.reset()
    with pytest.raises(
        shoal.envs.OptionError,
        match=(
            r"longest_move: expected 0\.\d+ or more for the moves of the planner shortest, got 0.1"
        ),
    ):
        short.expert_actions("shortest")


def test_interchangeable_particles_take_the_best_matching():
    swapped = {
        "start": [(0.2, 0.5), (0.4, 0.5)],
        "goal": [(0.4, 0.5), (0.2, 0.6)],
        "interchangeable": True,
    }
    assert gymnasium.make(NAME, **swapped).reset()[1]["error"] == pytest.approx(0.1)


def test_a_vector_of_gymnasiums_own_kind():
    envs = gymnasium.make_vec(NAME, num_envs=3, workspace="disk", max_moves=2)
    observations, infos = envs.reset(seed=5)
    assert infos["seed"].tolist() == [5, 6, 7]
    for _ in range(4):  # past the end, where they begin anew
        observations, *_ = envs.step(envs.action_space.sample())
    assert observations["delta"].shape == (3, 1, 2)


def test_render_modes():
    env = gymnasium.make(NAME, **PAIR, render_mode="ansi")
    env.reset()
    env.step(np.array([0.1, 0.0]))
    assert env.render().splitlines()[-1] == "after 1 moves 0.1 from the goals"
    env = gymnasium.make(NAME, **PAIR, render_mode="rgb_array")
    env.reset()
    still = env.render()
    env.step(np.array([0.1, 0.0]))
    assert still.shape == env.render().shape == (432, 768, 3)
    assert (still != env.render()).any()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tolerance": -1.0}, "tolerance: expected"),
        ({"planner": "greedy"}, "planner: expected no such option"),
        ({"gain_error": 0.1}, "gain_error: expected no such option, because it has no effect"),
        ({"friction_at_least": 1.0}, "friction_at_least: expected no such option"),
        ({"longest_move": 0}, "longest_move: expected"),
        ({**PAIR, "goal": [(2.0, 0.5), (0.4, 0.5)]}, "goal: expected"),
        ({"particle_radius": 2.0}, "expected"),
        ({"observation": "image"}, "observation: expected one of dict, flat, got 'image'"),
    ],
)
def test_bad_options(options, words):
    with pytest.raises(shoal.envs.OptionError, match=words) as caught:
        gymnasium.make(NAME, **options)
    assert "\n" not in str(caught.value)


def test_no_room_for_random_particles():
    env = gymnasium.make(NAME, particle_radius=0.45).unwrapped
    with pytest.raises(
        shoal.envs.OptionError, match="particle radius: expected room for 2 particles"
    ):
        env.reset(seed=1)


def test_wrong_steps_and_resets():
    env = gymnasium.make(NAME, **PAIR, max_moves=1).unwrapped
    for method in (lambda: env.step([0, 0]), env.render):
        with pytest.raises(gymnasium.error.ResetNeeded):
            method()
    env.reset()
    for action in ([0, 0, 0], 1.0, [2, 0], [np.nan, 0], "l", None, [[0, 0]]):
        with pytest.raises(gymnasium.error.InvalidAction, match="2 numbers from -1 to 1"):
            env.step(action)
    with pytest.raises(
        shoal.envs.OptionError, match="reset: options: expected no option, got 'map'"
    ):
        env.reset(options={"map": 1})
    assert env.step([0.0, 0.0])[3], "truncated by max_moves"
    with pytest.raises(gymnasium.error.ResetNeeded, match="expected a reset first"):
        env.step([0.0, 0.0])
