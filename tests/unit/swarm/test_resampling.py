"""Masks in files, thinned by --width and --scale, joined by --join-diagonals, and what is said
about dropped parts.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from shoal import cli
from shoal.core import notices
from shoal.core.errors import InvalidInputError
from shoal.swarm import GridWorkspace, SwarmProblem
from shoal.swarm.maps.files import fit_width, open_map
from shoal.swarm.maps.generators import generate
from shoal.swarm.maps.resampling import diagonal_contacts


@pytest.fixture
def told(monkeypatch):
    texts: list[str] = []
    monkeypatch.setattr(notices, "listeners", [texts.append])
    monkeypatch.setattr(notices, "_told", set())
    return texts


def traced_tree():
    """A tree of lines, one pixel wide, as a person traces it: connected at corners, too."""
    free = np.zeros((160, 200), dtype=bool)
    free[80, :] = True
    for column in range(10, 190, 30):
        for step in range(70):
            free[80 - step, min(column + step // 2, 199)] = free[
                80 + step, min(column + step, 199)
            ] = True
    return free


def share_of_largest(free):
    labels, _ = ndimage.label(free)
    sizes = np.bincount(labels.ravel())[1:]
    return sizes.max() / sizes.sum()


def save(free, path):
    np.save(path, free) if path.suffix == ".npy" else Image.fromarray(
        free.astype(np.uint8) * 255
    ).save(path)
    return path


@pytest.mark.parametrize("scale", [0.5, 0.25, 0.125, 1 / 3])
def test_a_traced_tree_that_is_joined_and_scaled_stays_whole(tmp_path, scale):
    tree = traced_tree()
    assert share_of_largest(tree) < 0.6
    path = save(tree, tmp_path / "tree.png")
    free = open_map(path, scale=scale, join_diagonals=True).free
    assert free.shape == tuple(round(side * scale) for side in tree.shape)
    assert share_of_largest(free) == 1
    assert free.sum() < 2.5 * scale * tree.sum() + 10  # lines, no blobs


@pytest.mark.parametrize("suffix", ["png", "tif", "npy", "txt", "csv"])
def test_width_makes_any_mask_smaller(tmp_path, suffix):
    from shoal import write_map

    vessels = GridWorkspace(generate("vessels:2000:1"))
    path = tmp_path / f"mask.{suffix}"
    write_map(vessels, path)
    small = open_map(path, width=40)
    assert max(small.shape) == 40
    assert small.components.max() == 1
    assert open_map(path, width=4000) == vessels


def test_width_of_a_stack_keeps_layers_and_of_a_volume_keeps_cubes(tmp_path):
    free = np.zeros((6, 40, 60), dtype=bool)
    free[:, 20, :] = free[3, :, 7] = True
    np.save(tmp_path / "stack.npy", free)
    small = open_map(tmp_path / "stack.npy", width=15)
    assert small.shape == (6, 10, 15)
    assert small.components.max() == 1
    volume = fit_width(GridWorkspace(free, spacing=(5.0, 1.0, 1.0)), 15)
    assert volume.shape == (6, 10, 15)
    assert volume.spacing == (5.0, 4.0, 4.0)
    assert fit_width(GridWorkspace(free, spacing=(1.0, 1.0, 1.0)), 15).shape == (2, 10, 15)


def test_layers_of_a_stack_are_joined_and_scaled_together(tmp_path):
    """One vessel that climbs diagonally through the layers."""
    for layer in range(8):
        free = np.zeros((32, 32), dtype=bool)
        free[16, 4 * layer : 4 * layer + 4] = True
        save(free, tmp_path / f"slice{layer}.png")
    assert open_map(tmp_path).components.max() == 8
    small = open_map(tmp_path, join_diagonals=True, scale=0.25)
    assert small.shape == (8, 8, 8)
    assert small.components.max() == 1


def test_diagonal_contacts_and_dropped_parts_are_said(tmp_path, told):
    path = save(np.kron(np.eye(3, dtype=bool), np.ones((2, 2), dtype=bool)), tmp_path / "steps.png")
    assert SwarmProblem(str(path), largest_component=True, particles=1).place.n_free == 4
    assert any(
        "2 diagonal contacts separate parts of the map" in text and "--join-diagonals" in text
        for text in told
    )
    assert any(
        "the largest of 3 parts is kept, 33.33 % of 12 free cells; 8 free cells are dropped" in text
        for text in told
    )
    told.clear()
    assert open_map(path, join_diagonals=True).components.max() == 1
    assert not told
    small = np.zeros((64, 64), dtype=bool)
    small[5, 5], small[:, 40] = True, True
    open_map(save(small, tmp_path / "dust.png"), scale=0.125)
    assert any("1 part is smaller than half a cell" in text for text in told)


def test_the_command_joins_and_thins(tmp_path, capsys):
    path = save(traced_tree(), tmp_path / "tree.png")
    given = [
        "map",
        str(path),
        "-n",
        "3",
        "--width",
        "25",
        "--join-diagonals",
        "--policy",
        "closest-frontier",
        "--json",
    ]
    assert cli.run(given) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["map"]["shape"] == [20, 25]
    assert result["unreachable_cells"] == 0
    assert result["status"] == ["complete"]


def test_the_command_says_what_it_drops(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr(notices, "_told", set())
    (tmp_path / "steps.txt").write_text("..#\n##.\n")
    assert cli.run(["map", str(tmp_path / "steps.txt"), "-n", "1", "--largest-component"]) == 0
    said = capfd.readouterr().err
    assert "1 diagonal contact separates parts of the map" in said
    assert "the largest of 2 parts is kept, 66.67 % of 3 free cells; 1 free cell is dropped" in said


def test_options_without_effect_are_refused():
    for options in ({"width": 5}, {"join_diagonals": True}):
        with pytest.raises(InvalidInputError, match="for a finished workspace"):
            open_map(GridWorkspace([[1, 1]]), **options)
        with pytest.raises(InvalidInputError, match="for a finished workspace"):
            assert SwarmProblem(GridWorkspace([[1, 1]]), **options).place


@pytest.mark.parametrize("option", [{"scale": 0.5}, {"width": 40}])
def test_contacts_are_counted_before_scaling(tmp_path, told, option):
    free = np.zeros((60, 80), dtype=bool)
    steps = np.arange(50)
    free[steps + 2, steps + 5] = free[steps + 2, 70 - steps] = True
    contacts = diagonal_contacts(free)
    path = save(free, tmp_path / "cross.png")
    open_map(path, **option)
    assert [
        f"before scaling, {contacts} diagonal contacts separate parts of the map" in text
        for text in told
    ].count(True) == 1
    told.clear()
    assert open_map(path, **option, join_diagonals=True).components.max() == 1
    assert not told


@pytest.mark.parametrize("suffix", [".png", ".npy"])
def test_a_map_does_not_vanish(tmp_path, told, suffix):
    tree = np.zeros((120, 120), dtype=bool)
    tree[60, 20:100] = tree[30:90, 60] = True
    path = save(tree, tmp_path / f"tree{suffix}")
    small = open_map(path, width=3)
    assert small.shape == (3, 3)
    assert small.components.max() == 1
    assert any(
        f"{path}: the only part is smaller than half a cell" in text and "--width" in text
        for text in told
    )
    told.clear()
    dust = np.zeros((120, 120), dtype=bool)
    dust[[5, 5, 60, 110], [5, 110, 60, 5]] = True
    dust[60, 61] = True
    open_map(save(dust, tmp_path / f"dust{suffix}"), width=3)
    assert any(
        "all 4 parts are smaller than half a cell of the scaled map, and the largest is kept"
        in text
        for text in told
    )
    assert np.argwhere(open_map(tmp_path / f"dust{suffix}", width=3).free).tolist() == [[1, 1]]


@pytest.mark.parametrize("suffix", [".png", ".tif"])
@pytest.mark.parametrize(
    "option",
    [
        {"scale": 0.3},
        {"scale": 0.05},
        {"width": 17},
        {"scale": 0.5, "width": 7},
        {"scale": 0.3, "level": 9},
    ],
)
def test_large_pictures_become_smaller_while_they_are_read(tmp_path, monkeypatch, suffix, option):
    """The cells are those of a picture that is in memory as a whole, which a small
    picture shows.
    """
    from shoal.swarm.maps import pictures

    rng = np.random.default_rng(4)
    free = (rng.random((3 if suffix == ".tif" else 1, 61, 83)) < 0.4) | traced_tree()[:61, :83]
    pages = [Image.fromarray(page.astype(np.uint8) * 9) for page in free]
    path = tmp_path / f"large{suffix}"
    pages[0].save(
        path, **({"save_all": True, "append_images": pages[1:]} if suffix == ".tif" else {})
    )
    whole = open_map(path, **option)
    packed = []
    monkeypatch.setattr(pictures, "MOST_COUNTED", 1000)
    monkeypatch.setattr(pictures, "PIECE", 700)
    shares = pictures.shares_of_bands
    monkeypatch.setattr(
        pictures, "shares_of_bands", lambda *given: packed.append(given) or shares(*given)
    )
    read = open_map(path, **option)
    assert packed or ("scale" not in option and suffix == ".tif")
    if "width" not in option or suffix == ".tif":
        np.testing.assert_array_equal(read.free, whole.free)
    else:
        assert read.shape == whole.shape


def test_width_has_the_limit_of_scale(tmp_path, monkeypatch):
    from shoal.swarm.maps import pictures, reading

    monkeypatch.setattr(reading, "MAX_CELLS", 5000)
    monkeypatch.setattr(pictures, "MAX_CELLS", 5000)
    monkeypatch.setattr(pictures, "MOST_COUNTED", 5000)
    for suffix in (".png", ".tif"):
        path = save(traced_tree(), tmp_path / f"large{suffix}")
        with pytest.raises(InvalidInputError, match="expected at most 5000 cells"):
            open_map(path)
        height, width = traced_tree().shape
        small = open_map(path, width=40)
        assert small.shape == (round(height * 40 / width), 40)
        assert small == open_map(path, scale=40 / width)


@pytest.mark.parametrize(
    ("options", "rows", "where"),
    [
        ([], [20, 39], "picture"),
        (["--scale", "0.1"], [20, 39], "picture"),
        (["--width", "20"], [2, 3], "map of --width 20"),
    ],
)
def test_the_place_of_a_map_names_what_is_counted(tmp_path, capsys, options, rows, where):
    free = np.zeros((100, 200), dtype=bool)
    free[20:40, 50:150] = True
    path = save(free, tmp_path / "block.png")
    assert cli.run(["maps", str(path), *options, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["place"]["rows"] == rows
    assert cli.run(["maps", str(path), *options]) == 0
    assert f"of the {where}, counted from 0" in " ".join(capsys.readouterr().out.split())


def test_very_large_pictures_are_not_joined(tmp_path, monkeypatch):
    from shoal.swarm.maps import pictures

    path = save(traced_tree(), tmp_path / "large.png")
    monkeypatch.setattr(pictures, "MOST_JOINED", traced_tree().size)
    assert open_map(path, join_diagonals=True, scale=0.5).n_free
    monkeypatch.setattr(pictures, "MOST_JOINED", traced_tree().size - 1)
    with pytest.raises(
        InvalidInputError, match=r"join-diagonals: expected at most .* pixels before scaling"
    ):
        open_map(path, join_diagonals=True, scale=0.5)
    assert open_map(path, scale=0.5).n_free
