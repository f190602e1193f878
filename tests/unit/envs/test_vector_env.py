"""Vectors of environments: exactly what as many single ones give, in all of Gymnasium's autoreset
modes.
"""

from __future__ import annotations

import re

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import shoal.envs
from shoal.envs import swarm as observations
from shoal.steering import prism, region, regular_polygon
from shoal.swarm.grid.paths import path_to_frontier

SMALL = {"map": "vessels:60", "particles": 12, "max_moves": 15}
MAPS = ["vessels:60", "vessels:40"]
VARIANTS = {
    "mapping": ("Mapping", {}),
    "coverage": ("Coverage", {"rule": "merge", "maps": MAPS}),
    "subset": ("SubsetCoverage", {"particles": 30, "observation": "compact", "maps": MAPS}),
    "window": ("Mapping", {"observation": "window", "window": 5, "maps": MAPS, "particles": 5}),
    "frontier": ("Mapping", {"observation": "window", "window": 25, "center": "frontier"}),
    "tilt": ("Mapping", {"rule": "tilt", "observation": "compact"}),
    "runs": ("Mapping", {"scan_every": 4}),
    "doubling": ("Coverage", {"scan_every": "doubling", "rule": "merge"}),
    "noise": ("Mapping", {"slip": 0.1, "misplace": 0.05, "miss": 0.05, "observation": "compact"}),
    "3-d": ("Mapping", {"map": "vessels3d:60", "observation": "window", "window": 5}),
    "3-d-compact": ("Coverage", {"map": "vessels3d:60", "observation": "compact"}),
    "image": ("Mapping", {"observation": "image", "maps": MAPS, "particles": 5}),
    "image-merge": ("Coverage", {"observation": "image", "rule": "merge"}),
    "image-3-d": ("Mapping", {"map": "vessels3d:60", "observation": "image"}),
    "flat": ("Mapping", {"observation": "flat"}),
    "done-at-once": ("Coverage", {"map": "line:9", "particles": 9}),
}
STEERING = {
    "square": {},
    "disk": {"workspace": "disk", "longest_move": 0.1},
    "flat": {"workspace": "disk", "observation": "flat"},
    "slides": {"workspace": "hexagon", "friction": 0.5},
    "gain": {"execution": 0.01, "measurement": 0.01, "gain": 0.2},
    "spheres": {"particle_radius": 0.1, "final_bonus": 5.0},
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
}


def same(one, other):
    """Compare observations and infos, Gymnasium's nested dictionaries of arrays and objects."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            same(one[key], other[key])
    elif isinstance(one, tuple) or (isinstance(one, np.ndarray) and one.dtype == object):
        for mine, theirs in zip(one, other, strict=True):
            same(mine, theirs)
    elif one is None:
        assert other is None
    else:
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)


def pair(name, mode, count=3, **options):
    """Return a vector of our own and Gymnasium's of as many single environments."""
    ours = gymnasium.make_vec(f"shoal/{name}-v0", num_envs=count, autoreset_mode=mode, **options)

    def one():
        return gymnasium.make(f"shoal/{name}-v0", disable_env_checker=True, **options).unwrapped

    return ours, SyncVectorEnv([one] * count, autoreset_mode=mode)


def compare(name, mode, options, *, steps, least_ends):
    """Play the same actions in both vectors, past the ends of episodes."""
    ours, theirs = pair(name, mode, **options)
    assert ours.single_observation_space == theirs.single_observation_space
    assert ours.observation_space == theirs.observation_space
    assert ours.action_space == theirs.action_space
    assert ours.metadata["autoreset_mode"] is mode
    same(ours.reset(seed=3), theirs.reset(seed=3))
    ours.action_space.seed(1)
    ends = 0
    for _ in range(steps):
        actions = ours.action_space.sample()
        got = ours.step(actions)
        same(got, theirs.step(actions))
        assert ours.observation_space.contains(got[0])
        ended = got[2] | got[3]
        ends += int(ended.sum())
        if mode is AutoresetMode.DISABLED and ended.any():
            same(
                ours.reset(options={"reset_mask": ended}),
                theirs.reset(options={"reset_mask": ended}),
            )
    assert ends > least_ends
    same(ours.reset(seed=[7, None, 2]), theirs.reset(seed=[7, None, 2]))


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("mode", AutoresetMode)
def test_a_vector_gives_what_as_many_single_ones_give(mode, variant):
    name, options = VARIANTS[variant]
    compare(name, mode, SMALL | options, steps=40, least_ends=3)


@pytest.mark.filterwarnings("ignore:.*infinity")  # what a camera with noise sees has no bounds
@pytest.mark.parametrize("variant", STEERING)
@pytest.mark.parametrize("mode", AutoresetMode)
def test_a_vector_of_steering_gives_what_as_many_single_ones_give(mode, variant):
    compare("Steering", mode, {"max_moves": 3, **STEERING[variant]}, steps=9, least_ends=3)


def test_copies_and_a_buffer_that_is_written_again():
    envs = gymnasium.make_vec("shoal/Mapping-v0", num_envs=2, **SMALL)
    first, _ = envs.reset(seed=1)
    before = first.copy()
    assert not np.shares_memory(first, envs.step([0, 0])[0])
    assert (first == before).all()
    shared = gymnasium.make_vec("shoal/Mapping-v0", num_envs=2, copy=False, **SMALL)
    first, _ = shared.reset(seed=1)
    assert shared.step([0, 0])[0] is first


def test_pictures_and_texts():
    for mode, kind in (("rgb_array", np.ndarray), ("ansi", str)):
        envs, alone = (
            make("shoal/Mapping-v0", render_mode=mode, **SMALL)
            for make in (gymnasium.make_vec, gymnasium.make)
        )
        envs.reset(seed=4)
        alone.reset(seed=4)
        (shown,) = envs.render()
        assert isinstance(shown, kind)
        assert np.array_equal(shown, alone.render())


def plain_compact(planes, view, moved):
    """Return the compact observation from planes, slowly: the definition."""
    particles, stopped = planes[0].astype(float), (planes[2] > 0) | (planes[0] > 0)
    ndim, total = particles.ndim, particles.sum()
    steps = [(-1, -1), (-2, -1), (-1, 1), (-2, 1), (-3, -1), (-3, 1)][: 2 * ndim]
    entered = [np.roll(particles, step, axis=axis) for axis, step in steps]
    path = path_to_frontier(view.belief, view.occupied)
    cells = np.argwhere(particles)
    weights = particles[tuple(cells.T)]
    middle = (cells * weights[:, None]).sum(axis=0) / total
    spread = np.sqrt(np.maximum((cells**2 * weights[:, None]).sum(axis=0) / total - middle**2, 0))
    size = np.array(planes.shape[1:])
    known = planes[1:].max(axis=0).sum()
    numbers = [(one * planes[3]).sum() / total for one in entered] + [
        (one * ~stopped).sum() / total for one in entered
    ]
    numbers += [float(letter == path[:1]) for letter in "lurdio"[: 2 * ndim]] + [
        1 / len(path) if path else 0
    ]
    rest = [*(middle / size), *(spread / size), planes[3].sum() / known, moved]
    return np.array(numbers), np.array(rest)


@pytest.mark.parametrize(
    "options", [{}, {"rule": "merge", "particles": 60}, {"map": "vessels3d:60"}], ids=str
)
def test_compact_numbers_are_those_of_the_planes(options):
    env = gymnasium.make("shoal/Mapping-v0", **(SMALL | options), observation="compact").unwrapped
    observed, _ = env.reset(seed=1)
    rng, ndim = np.random.default_rng(0), env.planes.ndim - 1
    for move in range(10):
        first, rest = plain_compact(env.planes, env.view, move / 15)
        np.testing.assert_allclose(observed[: len(first)], first, rtol=1e-6)
        np.testing.assert_allclose(observed[len(first) + ndim :], rest, rtol=1e-5, atol=1e-7)
        observed, *_ = env.step(rng.integers(env.action_space.n))


@pytest.mark.parametrize(
    ("does", "error", "words"),
    [
        (
            lambda envs: envs.step([0]),
            gymnasium.error.InvalidAction,
            "actions: expected 2 whole numbers from 0 to 3, one per",
        ),
        (lambda envs: envs.step([0.5, 1]), gymnasium.error.InvalidAction, "got [0.5, 1]"),
        (
            lambda envs: envs.step([0, 4]),
            gymnasium.error.InvalidAction,
            "actions: expected 2 whole numbers from 0 to 3, one per environment, got [0, 4]",
        ),
        (
            lambda envs: envs.reset(seed=[1]),
            shoal.envs.OptionError,
            "reset: seed: expected 2 seeds, one per world, got 1",
        ),
        (
            lambda envs: envs.reset(options={"mask": 1}),
            shoal.envs.OptionError,
            "reset: options: expected one of map, got 'mask'",
        ),
        (
            lambda envs: envs.reset(options={"reset_mask": [True]}),
            shoal.envs.OptionError,
            "reset: reset_mask: expected an array of 2 booleans, got [True]",
        ),
        (
            lambda envs: envs.reset(options={"reset_mask": np.ones(2)}),
            shoal.envs.OptionError,
            "reset: reset_mask: expected an array of 2 booleans, got float64 (2,)",
        ),
        (lambda envs: envs.reset(seed=2**70), shoal.envs.OptionError, "seed: expected"),
        (lambda envs: envs.render(), gymnasium.error.UnsupportedMode, "render: expected"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(does, error, words):
    envs = gymnasium.make_vec("shoal/Mapping-v0", num_envs=2, **SMALL)
    with pytest.raises(gymnasium.error.ResetNeeded, match="expected a reset first"):
        envs.step([0, 0])
    envs.reset(seed=1)
    with pytest.raises(error, match=re.escape(words)):
        does(envs)


def test_wrong_options():
    for options, words in (
        ({"num_envs": 0}, "num_envs: expected a whole number from 1 to 1000000, got 0"),
        (
            {"num_envs": 10**12},
            "num_envs: expected a whole number from 1 to 1000000, got 1000000000000",
        ),
        (
            {"autoreset_mode": "never"},
            "autoreset_mode: expected one of NextStep, SameStep, Disabled, got 'never'",
        ),
        ({"autoreset_mode": ["x"]}, "autoreset_mode: expected one of"),
        ({"partikles": 1}, "partikles: expected no such option"),
        ({"move_seconds": 1.0}, "move_seconds: expected no such option"),
        ({"window": 5}, "window: expected the observation window together with it"),
        ({"observation": "window", "window": 10001}, "window: expected"),
        ({"maps": ["vessels:60", "vessels3d:60"]}, "maps: expected all of 2"),
        ({"maps": 3}, "maps: expected a list of names or paths, got 3"),
        ({"observation": "picture"}, "observation: expected one of planes, window, compact,"),
    ):
        with pytest.raises(shoal.envs.OptionError, match=re.escape(words)):
            gymnasium.make_vec("shoal/Mapping-v0", **(SMALL | {"num_envs": 2} | options))
    with pytest.raises(
        gymnasium.error.UnsupportedMode,
        match="render_mode: expected one of rgb_array, ansi, got 'human'",
    ):
        gymnasium.make_vec("shoal/Mapping-v0", render_mode="human", **SMALL)


def test_an_ended_environment_is_not_stepped_when_autoreset_is_disabled():
    envs = gymnasium.make_vec(
        "shoal/Mapping-v0", num_envs=2, autoreset_mode="Disabled", **(SMALL | {"max_moves": 1})
    )
    envs.reset(seed=1)
    assert envs.step([0, 0])[3].all()
    with pytest.raises(
        gymnasium.error.ResetNeeded, match="expected a reset of environment 0 first"
    ):
        envs.step([0, 0])
    envs.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(
        gymnasium.error.ResetNeeded, match="expected a reset of environment 1 first"
    ):
        envs.step([0, 0])


def test_spaces_bound_what_is_observed():
    envs = gymnasium.make_vec("shoal/Mapping-v0", num_envs=2, **SMALL)
    assert envs.observation_space.shape == (2, len(observations.PLANES), *envs.batch.layout.window)
