"""Images and vectors of observations, masks as methods, videos, and Stable-Baselines3's form
without Stable-Baselines3.
"""

from __future__ import annotations

import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import shoal.envs
from shoal.core.errors import InvalidInputError, MissingExtraError
from shoal.envs import search_v0
from shoal.envs.forms import ImageForm

SMALL = {"map": "vessels:60", "particles": 12, "max_moves": 15}


def both(name, form, **options):
    """Return observations of the same state in the form of the simulation, and in another form."""
    forms = ({}, {"observation": form})
    envs = [gymnasium.make(f"shoal/{name}-v0", **options, **other) for other in forms]
    seen = [env.reset(seed=2)[0] for env in envs]
    for env in envs:
        env.action_space.seed(1)
    for _ in range(3):
        seen = [env.step(env.action_space.sample())[0] for env in envs]
    assert envs[1].observation_space.contains(seen[1])
    return (*seen, envs[0].observation_space)


@pytest.mark.parametrize("name", ["Mapping", "Coverage", "Steering", "Search"])
def test_a_vector_has_the_numbers_of_gymnasiums_flatten(name):
    options = SMALL if name in ("Mapping", "Coverage") else {}
    plain, flat, space = both(name, "flat", **options)
    expected = gymnasium.spaces.flatten(space, plain)
    assert flat.dtype == np.float32
    np.testing.assert_array_equal(flat, expected.astype(np.float32))


def test_an_image_has_the_planes_in_its_corner_and_obstacles_around_them():
    planes, image, _ = both("Mapping", "image", **SMALL)
    height, width = planes.shape[1:]
    assert image.dtype == np.uint8
    assert image.shape == (4, 36, 36)
    np.testing.assert_array_equal(image[:, :height, :width], planes * 255)
    around = image.copy()
    around[:, :height, :width] = 0
    assert (around[[0, 1, 3]] == 0).all()
    assert (around[2, height:] == 255).all()
    assert (around[2, :, width:] == 255).all()


def test_an_image_keeps_numbers_of_particles():
    planes, image, _ = both("Mapping", "image", **SMALL | {"rule": "merge", "particles": 60})
    height, width = planes.shape[1:]
    assert planes[0].max() > 1
    np.testing.assert_array_equal(image[0, :height, :width], planes[0])
    np.testing.assert_array_equal(image[1:, :height, :width], planes[1:] * 255)


def test_layers_are_channels_of_an_image():
    planes, image, _ = both("Mapping", "image", **SMALL | {"map": "vessels3d:60"})
    kinds, layers, height, width = planes.shape
    assert image.shape == (kinds * layers, *[max(36, kinds * layers)] * 2)
    stacked = image[:, :height, :width].reshape(planes.shape)
    np.testing.assert_array_equal(stacked, planes * 255)


def test_shares_of_a_plane_become_shades():
    source = gymnasium.spaces.Box(0.0, 1.0, (1, 2, 2), np.float32)
    form = ImageForm(source, 2, (0,))
    seen = form(np.array([[[[0.0, 0.5], [0.999, 1.0]]]], dtype=np.float32))
    assert seen[0, 0, :2, :2].tolist() == [[0, 128], [255, 255]]
    assert seen.sum() == 128 + 255 + 255


@pytest.mark.parametrize("name", ["Mapping", "Search"])
@pytest.mark.parametrize("form", ["image", "flat"])
def test_gymnasiums_own_checks_pass(name, form):
    env = gymnasium.make(f"shoal/{name}-v0", observation=form, **SMALL if name != "Search" else {})
    check_env(env.unwrapped, skip_render_check=True)


def test_masks_are_those_of_the_info():
    for name, options in (("Mapping", SMALL), ("Search", {})):
        env = gymnasium.make(f"shoal/{name}-v0", **options)
        info = env.reset(seed=3)[1]
        masks = env.unwrapped.action_masks()
        assert masks.dtype == np.bool_
        np.testing.assert_array_equal(masks, info["action_mask"])
        envs = gymnasium.make_vec(f"shoal/{name}-v0", num_envs=2, **options)
        infos = envs.reset(seed=3)[1]
        np.testing.assert_array_equal(envs.action_masks(), infos["action_mask"])
        np.testing.assert_array_equal(envs.call("action_masks"), infos["action_mask"])
    steering = gymnasium.make_vec("shoal/Steering-v0", num_envs=2)
    assert not hasattr(steering, "action_masks")
    for call in ("action_masks", "step"):
        with pytest.raises(AttributeError, match="call: expected the name of a method of env"):
            steering.call(call)


def test_classes_have_gymnasiums_classes_as_direct_bases():
    """Skrl looks for them."""
    for name in ("Mapping", "Steering", "Search"):
        assert gymnasium.Env in type(gymnasium.make(f"shoal/{name}-v0").unwrapped).__bases__
        envs = gymnasium.make_vec(f"shoal/{name}-v0", num_envs=1)
        assert gymnasium.vector.VectorEnv in type(envs).__bases__


def test_a_video_of_each_episode(tmp_path):
    env = gymnasium.make("shoal/Mapping-v0", render_mode="rgb_array", **SMALL | {"max_moves": 2})
    folder = tmp_path / "videos"
    env = shoal.envs.RecordVideo(env, str(folder), episode_trigger=lambda episode: True)
    for _ in range(2):
        env.reset(seed=1)
        while not any(env.step(0)[2:4]):
            pass
    env.close()
    videos = sorted(folder.iterdir())
    assert [video.name for video in videos] == [f"rl-video-episode-{k}.mp4" for k in range(2)]
    assert all(b"ftyp" in video.read_bytes()[:12] for video in videos)
    with pytest.raises(InvalidInputError, match="disable_logger: expected True"):
        shoal.envs.RecordVideo(env, str(folder), disable_logger=False)
    shoal.envs.RecordVideo(env, str(folder), disable_logger=True)


def test_without_stable_baselines(monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(MissingExtraError, match="SB3VecEnv needs Stable-Baselines3: pip install"):
        shoal.envs.SB3VecEnv("shoal/Mapping-v0")


def test_where_a_target_is_likely_is_a_channel_of_an_image():
    options = {"region": "square:60", "robots": 2, "prior": ["ring:20,30:0.5=15"], "targets": 1}
    plain, image = (
        search_v0.parallel_env(**options, **form).reset(seed=1)[0]["robot_2"]
        for form in ({}, {"observation": "image"})
    )
    height, width = plain["likely"].shape
    expected = np.rint(255 * (plain["likely"] / plain["likely"].max()))
    np.testing.assert_array_equal(image[-1, :height, :width], expected)
    np.testing.assert_array_equal(image[:-1, :height, :width], plain["planes"] * 255)
    assert image[-1].sum() == expected.sum()
