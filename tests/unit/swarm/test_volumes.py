"""Three dimensions: volumes read and written, bad ones refused, vessel trees, films, figures and
the player's data.
"""

from __future__ import annotations

import gzip
import json

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage
from tests.swarm_runs import run

from shoal import GridWorkspace, InvalidInputError, open_map, read_map, write_map
from shoal.cli import run as shoal
from shoal.swarm import SwarmEpisode
from shoal.swarm.grid import state as belief_states
from shoal.swarm.grid.board import offsets_of
from shoal.swarm.kernels.search import nearest_cells
from shoal.swarm.maps.generators import generate
from shoal.swarm.maps.generators.vessels3d import grow_tree, murray_radius
from shoal.swarm.maps.workspace import FREE
from shoal.views import film
from shoal.views.drawing.encoding import LONGEST
from shoal.views.swarm.colours import PLAIN, VOLUME, codes_of
from shoal.views.swarm.figures import map_figure
from shoal.views.swarm.page import page_data
from shoal.views.swarm.volume import (
    Fit,
    Slices,
    rotated_view,
    sheet,
    sheet_width,
    slice_pictures,
)

nibabel = pytest.importorskip("nibabel")  # an extra
BLOCK = np.random.default_rng(3).random((4, 5, 6)) < 0.7


def workspace_codes(workspace):
    """What each cell looks like of a workspace of which everything is known, with one cell of rim
    on each side.
    """
    return np.pad(
        np.where(workspace.free, belief_states.FREE, belief_states.OBSTACLE).astype(np.uint8),
        1,
        constant_values=belief_states.OBSTACLE,
    )


def whole(codes, elevation):
    """The fit of a whole array, rim included."""
    z, y, x = (np.array(codes.shape) / 2).tolist()
    wide = float(np.hypot(codes.shape[0], codes.shape[2]))
    return Fit((z, y, x), wide, codes.shape[1] * np.cos(elevation) + wide * np.sin(elevation), 0.0)


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz", ".npy", ".tif"])
def test_a_volume_comes_back(tmp_path, suffix):
    spacing = (0.5, 0.25, 2.0) if suffix.startswith(".nii") else None
    write_map(GridWorkspace(BLOCK, spacing=spacing), tmp_path / f"block{suffix}")
    again = read_map(tmp_path / f"block{suffix}")
    np.testing.assert_array_equal(again.free, BLOCK)
    assert (again.name, again.spacing) == ("block", spacing)


def test_nifti_is_turned_to_what_is_seen_from_the_front(tmp_path):
    data = np.zeros((3, 4, 5), np.uint8)
    data[2, 3, 4] = 1  # the right, the front, the head of the body
    data[0, 0, 0] = 1
    for flip in ([1, 1, 1], [-1, -1, 1]):  # the same body, stored the other way round
        stored = data[:: flip[0], :: flip[1], :: flip[2]]
        nibabel.save(
            nibabel.Nifti1Image(stored, np.diag([*(np.array(flip) * (2.0, 3.0, 4.0)), 1.0])),
            tmp_path / "a.nii.gz",
        )
        read = read_map(tmp_path / "a.nii.gz")
        assert read.shape == (4, 5, 3)
        assert read.cells.tolist() == [[0, 0, 0], [3, 4, 2]]
        assert read.spacing == (3.0, 4.0, 2.0)


def test_level_and_label(tmp_path):
    data = np.arange(24, dtype=np.float32).reshape(2, 3, 4)
    # a fourth dimension of one is none
    nibabel.save(nibabel.Nifti1Image(data[..., None], np.eye(4)), tmp_path / "a.nii")
    np.save(tmp_path / "a.npy", data)
    for name in ("a.nii", "a.npy"):
        assert read_map(tmp_path / name, level=20).n_free == 4
        assert read_map(tmp_path / name, label=7).n_free == 1
        with pytest.raises(
            InvalidInputError, match="expected 0 for obstacles and one number above 0"
        ):
            read_map(tmp_path / name)
        with pytest.raises(InvalidInputError, match="expected cells of label 99, got none"):
            read_map(tmp_path / name, label=99)
    with pytest.raises(InvalidInputError, match="expected a level or a label"):
        read_map(tmp_path / "a.npy", level=1, label=2)
    with pytest.raises(InvalidInputError, match="level: expected a number, got"):
        read_map(tmp_path / "a.npy", level=float("nan"))


def test_negative_numbers_are_no_free_cells(tmp_path):
    data = np.zeros((2, 3, 4), np.int16)
    data[0, 0, 0] = -1
    nibabel.save(nibabel.Nifti1Image(data, np.eye(4)), tmp_path / "a.nii")
    with pytest.raises(InvalidInputError, match="one number above 0 for free cells, got -1 "):
        read_map(tmp_path / "a.nii")
    assert read_map(tmp_path / "a.nii", label=-1).n_free == 1


def test_a_volume_oblique_to_the_body_says_so(tmp_path, capsys):
    for angle in (3, 20):
        cosine, sine = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        affine = np.array([[cosine, -sine, 0, 0], [sine, cosine, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
        path = tmp_path / f"turned{angle}.nii"
        nibabel.save(nibabel.Nifti1Image(np.ones((2, 2, 2), np.uint8), affine), path)
        assert shoal(["maps", str(path)]) == 0
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "turned20.nii: the axes of the volume differ" in said
    assert "by up to 20 degrees" in said


def test_units_other_than_millimetres(tmp_path):
    image = nibabel.Nifti1Image(np.ones((2, 2, 2), np.uint8), np.diag([50.0, 50.0, 50.0, 1.0]))
    image.header.set_xyzt_units("micron")
    nibabel.save(image, tmp_path / "a.nii")
    assert read_map(tmp_path / "a.nii").spacing == pytest.approx((0.05, 0.05, 0.05))


def test_a_folder_of_slices(tmp_path):
    for layer, cells in enumerate(BLOCK):
        # 8, 9, 10, 11
        Image.fromarray(cells.astype(np.uint8) * 255).save(tmp_path / f"slice{layer + 8}.png")
    (tmp_path / "notes.txt").write_text("about the slices")
    np.testing.assert_array_equal(read_map(tmp_path).free, BLOCK)
    np.testing.assert_array_equal(open_map(str(tmp_path), invert=True).free, ~BLOCK)
    Image.fromarray(np.ones((3, 3), np.uint8)).save(tmp_path / "slice9.png")
    with pytest.raises(
        InvalidInputError, match=r"slice9.png: expected 6x5 pixels as in the first layer, got 3x3"
    ):
        read_map(tmp_path)
    Image.fromarray(np.ones((5, 6), np.uint8)).save(tmp_path / "slice9.bmp")
    with pytest.raises(
        InvalidInputError, match=r"expected slices of one kind, got \.bmp and \.png"
    ):
        read_map(tmp_path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(InvalidInputError, match="expected a map file, got a folder without slices"):
        read_map(tmp_path / "empty")


def nifti(data, **options):
    return nibabel.Nifti1Image(np.asarray(data), np.eye(4), **options).to_bytes()


def archive(*, trailer=None, more=b""):
    whole = gzip.compress(nifti(np.ones((5, 5, 5), np.uint8)) + more)
    return whole if trailer is None else whole[: -len(trailer)] + trailer


def header_with(at, dtype, number):
    image = bytearray(nifti(np.ones((2, 2, 2), np.uint8)))
    image[at : at + np.dtype(dtype).itemsize] = np.array(number, dtype).tobytes()
    return bytes(image)


def huge():
    image = bytearray(nifti(np.ones((2, 2, 2), np.uint8)))
    image[40:48] = np.array([3, 30000, 30000, 30000], "<i2").tobytes()
    return bytes(image)


BAD = {
    "flat.nii": (
        nifti(np.ones((4, 5), np.uint8)),
        "expected a volume of numbers in 3 dimensions, got uint8 (4, 5)",
    ),
    "film.nii": (
        nifti(np.ones((4, 5, 6, 7), np.uint8)),
        "expected the choice of one frame (--frame), got 7",
    ),
    "colour.nii": (
        nifti(np.ones((2, 2, 2), [("R", "u1"), ("G", "u1"), ("B", "u1")])),
        "one channel (--channel), got 3: 1 (R)",
    ),
    "nothing.nii": (b"", "expected a map, got an empty file"),
    "zeros.nii": (
        nifti(np.zeros((3, 3, 3), np.uint8)),
        "expected at least one free cell, got 27 obstacles only",
    ),
    "nan.nii": (
        nifti(np.full((3, 3, 3), np.nan, np.float32)),
        "expected at least one free cell, got 27 obstacles only",
    ),
    "inf.nii": (nifti(np.full((3, 3, 3), np.inf, np.float32)), "expected finite numbers, got inf"),
    "huge.nii": (huge(), "expected at most 268435456 cells, got 30000x30000x30000"),
    "cut.nii.gz": (
        gzip.compress(nifti(np.random.default_rng(1).random((20, 20, 20))))[:4000],
        "got a damaged or truncated file",
    ),
    "flipped.nii.gz": (
        archive(trailer=bytes(8)),
        "got a damaged or truncated file: CRC check failed",
    ),
    "long.nii.gz": (
        archive(more=bytes(3_000_000)),
        "expected 477 bytes of a volume according to the header, got more",
    ),
    "kind.nii": (
        header_with(70, "<i2", 9999),
        "got a damaged or truncated file: data code 9999 not recognized",
    ),
    "place.nii": (header_with(108, "<f4", np.nan), "got a damaged or truncated file"),
    "cut.nii": (
        nifti(np.random.default_rng(1).random((20, 20, 20)))[:4000],
        "got a damaged or truncated file",
    ),
    "noise.nii": (
        bytes(range(256)) * 4,
        "expected a NIfTI volume, got a damaged, truncated or other file",
    ),
    "noise.nii.gz": (
        bytes(range(256)) * 4,
        "expected a NIfTI volume, got a damaged or truncated file",
    ),
    "short.nii": (nifti(np.ones((2, 2, 2), np.uint8))[:100], "expected a NIfTI volume"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_volumes(name, tmp_path, capsys):
    content, words = BAD[name]
    (tmp_path / name).write_bytes(content)
    assert shoal(["map", str(tmp_path / name), "-n", "1"]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert name in said
    said = [line for line in said.strip().splitlines() if "(NaN)" not in line]
    assert len(said) == 1


def test_bad_spacing_and_formats(tmp_path):
    with pytest.raises(InvalidInputError, match="spacing: expected 3 sizes above 0"):
        GridWorkspace(BLOCK, spacing=(1.0, 0.0, 1.0))
    with pytest.raises(
        InvalidInputError,
        match=r"expected .tif, .tiff, .npy, .nii, .nii.gz for a 3-D workspace, got '.png'",
    ):
        write_map(GridWorkspace(BLOCK), tmp_path / "a.png")
    with pytest.raises(
        InvalidInputError, match=r"expected .png, .* for a 2-D workspace, got '.nii'"
    ):
        write_map(GridWorkspace(BLOCK[0]), tmp_path / "a.nii")


@pytest.mark.parametrize(
    "spec", ["vessels3d:30", "vessels3d:1500", "vessels3d:1500:4", "vessels3d-loops:1500:4"]
)
def test_vessel_trees(spec):
    free = generate(spec)
    assert int(free.sum()) == int(spec.split(":")[1])
    assert ndimage.label(free)[1] == 1
    assert all(free.any(axis=tuple({0, 1, 2} - {axis}))[[0, -1]].all() for axis in range(3))
    np.testing.assert_array_equal(generate(spec), free)


def test_cells_in_the_order_of_their_paths():
    """The kernel against a plain search, which may order cells of one distance otherwise."""
    free = np.pad(np.random.default_rng(6).random((5, 6, 7)) < 0.6, 1)
    start = tuple(np.argwhere(free)[0].tolist())
    distance, wave = {start: 0}, [start]
    for cell in wave:
        for axis in range(3):
            for step in (-1, 1):
                near = tuple(place + step * (axis == k) for k, place in enumerate(cell))
                if free[near] and near not in distance:
                    distance[near] = distance[cell] + 1
                    wave.append(near)
    flat = [int(np.ravel_multi_index(cell, free.shape)) for cell in wave]
    order = nearest_cells(free.ravel(), offsets_of(free.shape), flat[0], free.size).tolist()
    assert sorted(order) == sorted(flat)
    lengths = [
        distance[tuple(int(i) for i in np.unravel_index(cell, free.shape))] for cell in order
    ]
    assert lengths == sorted(lengths)


def cycles(free):
    """Return the number of independent tunnels of a volume without closed hollows: 1 less its Euler
    characteristic.
    """
    vertices = free.sum()
    edges = sum((free & np.roll(free, 1, axis)).sum() for axis in range(3))
    pairs = [free & np.roll(free, 1, axis) for axis in range(3)]
    squares = sum((pairs[a] & np.roll(pairs[a], 1, b)).sum() for a, b in ((0, 1), (0, 2), (1, 2)))
    cube = free.copy()
    for axis in range(3):
        cube &= np.roll(cube, 1, axis)
    return int(1 - (vertices - edges + squares - cube.sum()))


def test_loops_are_there_if_wanted():
    tree, net = (np.pad(generate(f"{name}:4000:2"), 1) for name in ("vessels3d", "vessels3d-loops"))
    assert cycles(net) > cycles(tree)


def test_branches_follow_murrays_law():
    rng = np.random.default_rng(2)
    start, end, fed = grow_tree(rng.uniform(-1, 1, (200, 3)), rng)
    radius = murray_radius(fed)
    assert len(start) == 2 * 200 - 1
    children = {}
    for branch, place in enumerate(start):
        children.setdefault(tuple(place), []).append(branch)
    forks = 0
    for branch, place in enumerate(end):
        behind = children.get(tuple(place), [])
        if behind:
            assert len(behind) == 2
            assert radius[branch] ** 3 == pytest.approx((radius[behind] ** 3).sum())
            forks += 1
    assert forks == 199


@pytest.mark.parametrize(
    "policy", ["closest-frontier", "elect-particle", "random-moves", "depth-first"]
)
def test_policies_map_a_tree(policy):
    workspace = open_map("vessels3d:150")
    episode = run(workspace, particles=1 if policy == "depth-first" else 30, policy=policy, seed=1)
    assert episode.status == "complete"
    assert len(episode.final()[1].open) == 150
    assert episode.verify()
    assert (
        run(workspace, particles=30, task="coverage", policy="closest-frontier").status
        == "complete"
    )


def test_films_figures_and_data(tmp_path, monkeypatch):
    monkeypatch.setitem(LONGEST, ".gif", 8)
    workspace = GridWorkspace(generate("vessels3d:120"), name="tree", spacing=(1.0, 0.5, 2.0))
    episode = run(workspace, particles=10)
    episode.save(tmp_path / "e.npz")
    assert SwarmEpisode.load(tmp_path / "e.npz").workspace.spacing == (1.0, 0.5, 2.0)
    for suffix in (".gif", ".mp4", ".html"):
        film(episode, tmp_path / f"film{suffix}")
        assert (tmp_path / f"film{suffix}").stat().st_size > 1000
    assert map_figure(episode).axes[0].get_title(loc="left").startswith("tree after")
    assert map_figure(episode, moves=3).axes[0].images[0].get_array().shape[0] == 900
    data = page_data(episode)
    assert data["shape"] == list(workspace.shape)
    assert data["spacing"] == [1.0, 0.5, 2.0]
    assert "volume.js" not in (tmp_path / "film.html").read_text()
    assert "drawCloud" in (tmp_path / "film.html").read_text()


def test_a_view_from_the_front_shows_the_nearest_cell():
    free = np.zeros((3, 3, 3), bool)
    free[0, 0, 0] = free[2, 2, 2] = True
    codes = workspace_codes(GridWorkspace(free))
    picture = rotated_view(codes, azimuth=0.0, elevation=0.0, side=100, fit=whole(codes, 0.0))
    near, blue = int(VOLUME.rgb[FREE, 2]), picture[..., 2]  # on white
    assert blue[:45, :45].min() == near  # row 0, column 0, and nearest
    assert blue[55:, 55:].min() == int(0.6 * near)  # far away
    behind = rotated_view(codes, azimuth=np.pi, elevation=0.0, side=100, fit=whole(codes, 0.0))
    assert behind[:45, 55:, 2].min() < behind[55:, :45, 2].min() == near
    hidden = np.zeros((3, 3, 3), bool)
    hidden[:, 1, 1] = True  # one behind the other: only the first is seen
    codes = workspace_codes(GridWorkspace(hidden))
    picture = rotated_view(codes, azimuth=0.0, elevation=0.0, side=60, fit=whole(codes, 0.0))
    assert set(np.unique(picture[..., 2])) == {near, 255}


def test_slices_cut_where_most_is_free():
    free = np.zeros((3, 4, 5), bool)
    free[1, 2, :] = True
    workspace = GridWorkspace(free)
    slices = Slices.of(workspace)
    assert (slices.layer, slices.row) == (1, 2)
    front, above, right = slice_pictures(workspace_codes(workspace), slices)
    assert (front.shape[:2], above.shape[:2], right.shape[:2]) == ((6, 7), (5, 7), (6, 5))
    assert (front[3, 1:-1] == VOLUME.rgb[FREE]).all()
    state, belief = run(workspace, particles=5).final()
    assert sheet(
        codes_of(state, belief), slices, azimuth=0.3, side=120, fit=Fit.of(workspace)
    ).shape == (
        120,
        sheet_width((5, 6, 7), 120),
        3,
    )


@pytest.mark.parametrize("spacing", [None, (3.0, 1.0, 1.0)])
def test_a_fitted_view_shows_all_from_every_side_as_large_as_it_can(spacing):
    free = np.zeros((12, 30, 40), bool)
    free[3, 5:25, 4] = free[3:9, 24, 4] = free[8, 24, 4:9] = True  # in a corner of the array
    workspace = GridWorkspace(free, spacing=spacing)
    codes, fit = workspace_codes(workspace), Fit.of(workspace)
    largest = 0
    for azimuth in np.linspace(0, 2 * np.pi, 9):
        picture = rotated_view(codes, azimuth=azimuth, side=300, spacing=spacing, fit=fit)
        lit = np.argwhere(picture.min(axis=2) < 255)  # not the background
        assert lit.min() > 0
        assert lit.max() < 299
        largest = max(largest, *np.ptp(lit, axis=0))
    assert largest > 225


def test_command_line(tmp_path, capsys):
    assert shoal(["maps", "vessels3d:200", "--out", str(tmp_path / "tree.nii.gz"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["free_cells"] == 200
    words = [
        "map",
        str(tmp_path / "tree.nii.gz"),
        "-n",
        "20",
        "--label",
        "1",
        "--out",
        str(tmp_path / "out"),
        "--json",
    ]
    assert shoal(words) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["status"], result["map"]["free_cells"]) == (["complete"], 200)
    assert (tmp_path / "out" / "map.png").exists()


def test_particles_inside_a_wide_vessel_shine_through_its_wall():
    codes = np.zeros((11, 11, 11), dtype=np.uint8)
    codes[1:-1, 1:-1, 1:-1] = 2  # free
    fit = Fit.of(GridWorkspace(np.ones((9, 9, 9), dtype=np.bool_)))
    without = rotated_view(codes, azimuth=0.6, side=120, fit=fit)
    codes[5, 5, 5] = PLAIN.particle
    within = rotated_view(codes, azimuth=0.6, side=120, fit=fit)
    changed = (without != within).any(axis=2)
    assert 20 < changed.sum() < 2000
    red, green, blue = within[changed].mean(axis=0)
    assert red > green > blue  # some of the particle's orange


def test_a_map_with_known_cells_has_a_scale_bar():
    for shape, spacing in (((20, 30), (0.5, 0.5)), ((4, 20, 30), (1.0, 0.5, 0.5))):
        known = GridWorkspace(np.ones(shape, dtype=np.bool_), spacing=spacing)
        for workspace, found in ((known, True), (GridWorkspace(known.free), False)):
            episode = run(workspace, particles=5, policy="closest-frontier", max_moves=3)
            texts = [text.get_text() for text in map_figure(episode).axes[0].texts]
            assert any(text.endswith(" mm") for text in texts) is found
