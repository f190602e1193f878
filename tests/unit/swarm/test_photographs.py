"""Vessels in photographs drawn from known ones, in noise, and in pictures of other things."""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage
from tests.unit.swarm.photographs import angiogram, dice, fundus
from typer.testing import CliRunner

from shoal.cli import app
from shoal.core.errors import InvalidInputError
from shoal.swarm.maps.imaging import find_vessels

pytest.importorskip("skimage")  # an extra


@pytest.mark.parametrize(
    ("seed", "options"),
    [(2, {"exudates": 20}), (3, {"contrast": 45.0, "texture": 2.2})],
    ids=["exudates", "texture"],
)
def test_vessels_of_an_eye(seed, options):
    picture, truth = fundus(seed, **options)
    found = find_vessels(picture)
    assert found.mask.shape == truth.shape
    assert not found.bright
    assert found.confidence > 0.5
    assert dice(found.mask, truth) > 0.7


@pytest.mark.parametrize("bright", [False, True], ids=["dark", "bright"])
@pytest.mark.parametrize(("shape", "widest"), [((120, 160), 5), ((240, 320), 10)])
def test_a_noisy_angiogram_keeps_its_tree(shape, widest, bright):
    picture, truth = angiogram(3, shape, widest=widest)
    found = find_vessels(255 - picture if bright else picture)
    assert found.bright == bright
    assert found.confidence > 0.6
    clear = ndimage.binary_opening(truth, iterations=1)
    assert (found.mask & clear).sum() > 0.85 * clear.sum()
    assert (
        found.mask & ndimage.binary_dilation(truth, iterations=2)
    ).sum() > 0.95 * found.mask.sum()


def imread(path):
    with Image.open(path) as picture:
        return np.asarray(picture)


def noise(kind):
    rng = np.random.default_rng(5)
    if kind == "surround":
        row, column = np.mgrid[:160, :160] - 80
        return np.where(np.hypot(row, column) < 74, rng.normal(110, 9, (160, 160)), 0)
    if kind == "colour":
        return rng.integers(0, 255, (120, 160, 3))
    return ndimage.gaussian_filter(
        rng.normal(128, 9, (120, 160)), {"white": 0, "soft": 1.5, "smooth": 5}[kind]
    )


@pytest.mark.parametrize("kind", ["white", "soft", "smooth", "colour", "surround"])
def test_noise_alone_is_refused(kind):
    with pytest.raises(InvalidInputError, match="got no network of lines that stands out"):
        find_vessels(noise(kind))


def test_a_cat_is_refused():  # other pictures: test_imaging
    data = pytest.importorskip("skimage.data")
    try:
        picture = data.chelsea()
    except (OSError, ModuleNotFoundError):
        pytest.skip("a picture that this scikit-image does not ship")
    with pytest.raises(InvalidInputError, match="got no network of lines that stands out"):
        find_vessels(picture)


def test_the_command_writes_mask_overlay_and_map(tmp_path):
    picture, truth = angiogram(3, (120, 160), widest=5)
    Image.fromarray(picture).save(tmp_path / "photo.png")
    done = CliRunner().invoke(
        app,
        [
            "maps",
            str(tmp_path / "photo.png"),
            "--vessels",
            "--out",
            str(tmp_path / "out"),
            "--json",
        ],
    )
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert told["confidence"] > 0.6
    mask, overlay, cells = (
        imread(tmp_path / "out" / name) for name in ("mask.png", "overlay.png", "map.png")
    )
    assert mask.shape == truth.shape
    assert set(np.unique(mask)) == {0, 255}
    assert dice(mask > 0, truth) > 0.8
    assert overlay.shape == (120, 160, 3)
    assert list(cells.shape) == told["shape"]
    Image.fromarray(noise("white").astype(np.uint8)).save(tmp_path / "noise.png")
    done = CliRunner().invoke(
        app, ["maps", str(tmp_path / "noise.png"), "--vessels", "--out", str(tmp_path / "none")]
    )
    assert isinstance(done.exception, InvalidInputError)
    assert not (tmp_path / "none").exists()


def test_a_mapping_of_a_photograph_leaves_the_overlay(tmp_path):
    Image.fromarray(angiogram(3, (120, 160), widest=5)[0]).save(tmp_path / "photo.png")
    arguments = [
        "map",
        str(tmp_path / "photo.png"),
        "--vessels",
        "--policy",
        "closest-frontier",
        "-n",
        "5",
        "--out",
        str(tmp_path),
    ]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert imread(tmp_path / "overlay.png").shape == (120, 160, 3)
