"""Map files: what is written comes back the same, and every kind of picture and text is read as it
should be.
"""

from __future__ import annotations

import gzip
import struct

import numpy as np
import PIL
import pytest
from PIL import Image

from shoal.cli import run
from shoal.core import notices
from shoal.core.errors import InvalidInputError, OutputError
from shoal.core.files import atomic
from shoal.swarm import GridWorkspace
from shoal.swarm.maps.files import open_map, read_map, write_map
from shoal.swarm.maps.pictures import read_pixels

WRITABLE = [".png", ".tif", ".tiff", ".bmp", ".txt", ".map", ".npy", ".csv"]
STAIRS = np.array([[1, 1, 0, 1, 0], [0, 1, 1, 1, 1], [1, 0, 0, 0, 1]], dtype=bool)
FULL = 65535


def cells(path, **options):
    return read_map(path, **options).free.astype(int).tolist()


def tiff(values, *, bits, kind):
    """Return the bytes of a plain grey TIFF in big-endian order, which Pillow cannot write for all
    types.
    """
    data = values.tobytes()
    height, width = values.shape
    tags = [
        (256, 4, width),
        (257, 4, height),
        (258, 3, bits),
        (259, 3, 1),
        (262, 3, 1),
        (273, 4, 8),
        (277, 3, 1),
        (278, 4, height),
        (279, 4, len(data)),
        (339, 3, kind),
    ]
    entries = b"".join(
        struct.pack(">HHI", tag, size, 1)
        + (struct.pack(">HH", value, 0) if size == 3 else struct.pack(">I", value))
        for tag, size, value in tags
    )
    return (
        struct.pack(">2sHI", b"MM", 42, 8 + len(data))
        + data
        + struct.pack(">H", len(tags))
        + entries
        + bytes(4)
    )


# Round trips


@pytest.mark.parametrize("suffix", [*WRITABLE, ".PNG", ".Txt"])
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (3, 5), (65, 64), (2, 129)])
def test_what_is_written_comes_back_the_same(tmp_path, suffix, shape):
    free = np.random.default_rng(shape).random(shape) < 0.6
    free[-1, -1] = True
    path = tmp_path / f"cells{suffix}"
    write_map(GridWorkspace(free), path)
    again = read_map(path)
    np.testing.assert_array_equal(again.free, free)
    assert again.name == "cells"
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_three_dimensions_come_back_where_a_format_takes_them(tmp_path):
    workspace = GridWorkspace(np.random.default_rng(3).random((3, 4, 5)) < 0.7)
    write_map(workspace, tmp_path / "cube.npy")
    assert read_map(tmp_path / "cube.npy") == workspace
    for suffix in WRITABLE:
        if suffix not in {".npy", ".tif", ".tiff"}:
            with pytest.raises(
                InvalidInputError,
                match=r"cube\.\w+: expected \.tif, \.tiff, \.npy, .* for a 3-D workspace",
            ):
                write_map(workspace, tmp_path / f"cube{suffix}")
    assert [file.name for file in tmp_path.iterdir()] == ["cube.npy"]


@pytest.mark.parametrize("suffix", [".gif", ".npz", ""])
def test_formats_that_would_not_come_back_are_refused(tmp_path, suffix):
    with pytest.raises(InvalidInputError, match=r"expected one of the suffixes \.png \.tif"):
        write_map(GridWorkspace([[1]]), tmp_path / f"cells{suffix}")
    assert not list(tmp_path.iterdir())


# Pictures


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({}, [[0, 0, 1, 1]]),
        ({"threshold": 0.0}, [[1, 1, 1, 1]]),
        ({"threshold": 1.0}, [[0, 0, 0, 1]]),
        # exactly as bright as a pixel: that one is free
        ({"threshold": 100 / 255}, [[0, 1, 1, 1]]),
        ({"invert": True}, [[1, 1, 0, 0]]),
        ({"threshold": 1.0, "invert": True}, [[1, 1, 1, 0]]),
        ({"scale": 2}, [[0, 0, 0, 0, 1, 1, 1, 1]] * 2),
        ({"scale": 0.5}, [[0, 1]]),
        ({"scale": 0.01}, [[1]]),
    ],
)
def test_threshold_invert_and_scale(tmp_path, options, expected):
    path = tmp_path / "grey.png"
    Image.fromarray(np.array([[0, 100, 200, 255]], dtype=np.uint8)).save(path)
    assert cells(path, **options) == expected


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_sixteen_bits_use_their_full_range(tmp_path, suffix):
    path = tmp_path / f"deep{suffix}"
    Image.fromarray(np.array([[0, 300, 32767, 32768, FULL]], dtype=np.uint16)).save(path)
    assert cells(path) == [[0, 0, 0, 1, 1]]
    assert read_pixels(path).tolist() == [[0, 1, 127, 128, 255]]


def test_big_endian_tiff_is_no_brighter(tmp_path):
    path = tmp_path / "big.tif"
    path.write_bytes(tiff(np.array([[0, 300, 32767, 32768, FULL]], dtype=">u2"), bits=16, kind=1))
    assert cells(path) == [[0, 0, 0, 1, 1]]
    assert read_pixels(path).tolist() == [[0, 1, 127, 128, 255]]


def test_float_pictures_use_the_range_of_their_data(tmp_path):
    path = tmp_path / "float.tif"
    Image.fromarray(np.array([[0, 1.9, 2.1, 4]], dtype=np.float32)).save(path)
    assert cells(path) == [[0, 0, 1, 1]]
    Image.fromarray(np.array([[0, 1.9], [2.1, np.nan]], dtype=np.float32)).save(path)
    assert cells(path) == [[0, 1], [1, 0]]  # where there is no number, there is no free cell
    assert cells(path, invert=True) == [[1, 0], [0, 0]]
    Image.fromarray(np.array([[0, 1.9], [2.1, np.inf]], dtype=np.float32)).save(path)
    with pytest.raises(
        InvalidInputError, match=r"float.tif: expected finite numbers, got inf at cell \(1, 1\)"
    ):
        read_map(path)


def test_an_older_pillow_is_named_for_colours_that_it_takes_for_truncated(tmp_path, monkeypatch):
    path = tmp_path / "stairs.tif"
    Image.new("YCbCr", (5, 3)).save(path)
    monkeypatch.setattr(PIL, "__version__", "12.3.0")
    with pytest.raises(
        InvalidInputError, match=r"stairs\.tif: expected Pillow 13 or newer .* got Pillow 12\.3\.0"
    ):
        read_map(path)


@pytest.mark.parametrize(
    ("suffix", "mode"),
    [
        *((".png", mode) for mode in ("1", "L", "LA", "P", "RGB", "RGBA", "I;16")),
        *(
            (".tif", mode)
            for mode in (
                "1",
                "L",
                "LA",
                "P",
                "RGB",
                "RGBA",
                "I;16",
                "I",
                "F",
                "CMYK",
                "LAB",
                "YCbCr",
            )
        ),
        *((".bmp", mode) for mode in ("1", "L", "P", "RGB", "RGBA")),
    ],
)
def test_every_mode_of_picture_shows_the_same_cells(tmp_path, suffix, mode):
    grey = np.where(STAIRS, 255, 0).astype(np.uint8)
    if mode in {"I", "I;16"}:
        image = Image.fromarray(
            (grey.astype(np.uint16) * 257).astype(np.uint16 if mode == "I;16" else np.int32)
        )
    elif mode == "LAB":
        image = Image.merge("LAB", [Image.fromarray(grey), *[Image.new("L", (5, 3), 128)] * 2])
    else:
        image = Image.fromarray(grey).convert("RGB").convert(mode)
    path = tmp_path / f"stairs{suffix}"
    image.save(path)
    if mode == "YCbCr" and int(PIL.__version__.split(".")[0]) < 13:
        with pytest.raises(InvalidInputError, match="expected Pillow 13 or newer"):
            read_map(path)
        return
    np.testing.assert_array_equal(read_map(path).free, STAIRS)
    pixels = read_pixels(path)
    assert pixels.dtype == np.uint8
    assert pixels.shape in {(3, 5), (3, 5, 3)}


def test_jpeg_comes_back_the_same(tmp_path):
    """At its best quality even the finest pattern survives: single cells, checkerboards, noise."""
    rng = np.random.default_rng(3)
    checkers = np.indices((33, 70)).sum(axis=0) % 2 == 0
    for suffix, free in (
        (".jpg", checkers),
        (".jpeg", rng.random((61, 47)) < 0.5),
        (".jpg", rng.random((120, 130)) < 0.05),
    ):
        write_map(GridWorkspace(free), tmp_path / f"map{suffix}")
        np.testing.assert_array_equal(read_map(tmp_path / f"map{suffix}").free, free)


def test_jpeg_is_read(tmp_path):
    Image.fromarray(np.kron(STAIRS, np.ones((16, 16))).astype(np.uint8) * 255).save(
        tmp_path / "stairs.jpg", quality=95
    )
    np.testing.assert_array_equal(read_map(tmp_path / "stairs.jpg", scale=1 / 16).free, STAIRS)


def test_transparent_is_white(tmp_path):
    rgba = np.zeros((1, 4, 4), dtype=np.uint8)
    rgba[0, :, 3] = [0, 100, 200, 255]  # black, more and more opaque
    Image.fromarray(rgba).save(tmp_path / "rgba.png")
    assert cells(tmp_path / "rgba.png") == [[1, 1, 0, 0]]

    palette = Image.fromarray(np.array([[0, 1, 2]], dtype=np.uint8)).convert("P")
    palette.putpalette([0, 0, 0, 10, 10, 10, 250, 250, 250])
    palette.save(tmp_path / "palette.png", transparency=0)
    assert cells(tmp_path / "palette.png") == [[1, 0, 1]]

    grey = Image.fromarray(np.array([[0, 1]], dtype=np.uint8))
    grey.save(tmp_path / "key.png", transparency=0)  # one shade of grey stands for "nothing here"
    assert cells(tmp_path / "key.png") == [[1, 0]]


def test_pages_are_layers(tmp_path):
    pages = [
        Image.fromarray(STAIRS.astype(np.uint8) * 255),
        Image.fromarray(255 - STAIRS.astype(np.uint8) * 255),
    ]
    pages[0].save(tmp_path / "pages.tif", save_all=True, append_images=pages[1:])
    np.testing.assert_array_equal(read_map(tmp_path / "pages.tif").free, [STAIRS, ~STAIRS])
    pages[0].save(
        tmp_path / "pages.tif", save_all=True, append_images=[Image.new("L", (9, 9), 255)]
    )
    with pytest.raises(
        InvalidInputError, match=r"page 2: expected .* pixels as in the first layer, got 9x9"
    ):
        read_map(tmp_path / "pages.tif")


def test_the_limit_of_pillow_is_left_as_it_was(tmp_path):
    before = Image.MAX_IMAGE_PIXELS
    write_map(GridWorkspace([[1]]), tmp_path / "one.png")
    read_map(tmp_path / "one.png")
    (tmp_path / "bad.png").write_bytes(b"no picture")
    with pytest.raises(InvalidInputError):
        read_map(tmp_path / "bad.png")
    assert before == Image.MAX_IMAGE_PIXELS


# Text


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("plain.txt", b"..#.#\n#....\n.###.\n"),
        ("unfinished.txt", b"..#.#\n#....\n.###."),
        ("trailing.txt", b"..#.#\n#....\n.###.\n\n\n"),
        ("dos.txt", b"..#.#\r\n#....\r\n.###.\r\n"),
        ("mac.txt", b"..#.#\r#....\r.###.\r"),
        ("bom.txt", b"\xef\xbb\xbf..#.#\r\n#....\r\n.###.\r\n"),
        ("plain.csv", b"1,1,0,1,0\n0,1,1,1,1\n1,0,0,0,1\n"),
        ("spaces.csv", b" 1, 1,0 ,1,0\n0,1,1,1,1\n1,0,0,0,1"),
        ("bom.csv", b"\xef\xbb\xbf1,1,0,1,0\r\n0,1,1,1,1\r\n1,0,0,0,1\r\n"),
        ("usual.map", b"type octile\nheight 3\nwidth 5\nmap\n..@.@\n@....\n.@@@.\n"),
        ("letters.map", b"type octile\nheight 3\nwidth 5\nmap\n.GT.O\nWSS..\n.@OT.\n"),
        ("order.map", b"width 5\ntype tile\nheight 3\nmap\n..@.@\n@....\n.@@@.\n"),
        ("bare.map", b"map\n..@.@\n@....\n.@@@."),
        ("dos.map", b"type octile\r\nheight 3\r\nwidth 5\r\nmap\r\n..@.@\r\n@....\r\n.@@@.\r\n"),
    ],
)
def test_texts_are_read(tmp_path, name, text):
    (tmp_path / name).write_bytes(text)
    np.testing.assert_array_equal(read_map(tmp_path / name).free, STAIRS)


def test_movingai_is_written_as_others_write_it(tmp_path):
    write_map(GridWorkspace(STAIRS), tmp_path / "stairs.map")
    assert (
        tmp_path / "stairs.map"
    ).read_text() == "type octile\nheight 3\nwidth 5\nmap\n..@.@\n@....\n.@@@.\n"


# Arrays


@pytest.mark.parametrize("dtype", [bool, np.uint8, np.int64, ">i4", np.float32, np.float16])
@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_of_any_number(tmp_path, dtype, order):
    np.save(tmp_path / "stairs.npy", np.asarray(STAIRS * 3, dtype=dtype, order=order))
    np.testing.assert_array_equal(read_map(tmp_path / "stairs.npy").free, STAIRS)


@pytest.mark.parametrize("version", [(1, 0), (2, 0), (3, 0)])
def test_arrays_of_any_version(tmp_path, version):
    with (tmp_path / "stairs.npy").open("wb") as file:
        np.lib.format.write_array(file, STAIRS, version=version)
    np.testing.assert_array_equal(read_map(tmp_path / "stairs.npy").free, STAIRS)


# What a user types


def test_open_map_takes_names_and_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_map(GridWorkspace(STAIRS), "stairs.txt")
    assert open_map("stairs.txt").name == "stairs"
    assert open_map(str(tmp_path / "stairs.txt")) == GridWorkspace(STAIRS)
    assert open_map("line:7").shape == (1, 7)
    assert open_map("line:7").name == "line:7"
    Image.fromarray(np.array([[0, 100, 200, 255]], dtype=np.uint8)).save("grey.png")
    assert open_map("grey.png", threshold=1.0).n_free == 1
    assert open_map("grey.png", invert=True).n_free == 2
    assert open_map("grey.png", scale=2.0).shape == (2, 8)


def test_open_map_prefers_a_file_to_a_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "line:7").write_bytes(b"...")
    # it is there, and has no suffix of a map
    with pytest.raises(InvalidInputError, match="expected a map file"):
        open_map("line:7")


def test_open_map_finds_vessels_in_a_photograph(tmp_path):
    pytest.importorskip("skimage")  # an extra
    photograph = np.full((120, 160), 220, dtype=np.uint8)
    photograph[20:100, 60:66] = photograph[55:60, 20:140] = 60
    Image.fromarray(photograph).save(tmp_path / "eye.png")
    workspace = open_map(str(tmp_path / "eye.png"), vessels=True, width=40)
    assert (workspace.name, max(workspace.shape)) == ("eye", 40)


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        ("line:7", {"threshold": 1.5}, "threshold: expected a number from 0 to 1, got 1.5"),
        ("line:7", {"scale": 0.0}, "scale: expected a number, above 0 and at most 64"),
        (
            "line:7",
            {"width": 40},
            "width: expected no width for the generated map 'line:7', got 40",
        ),
        (
            "line:7",
            {"join_diagonals": True},
            "join-diagonals: expected no join-diagonals for the generated map 'line:7'",
        ),
        (
            "line:7",
            {"vessels": True},
            "vessels: expected a photograph, got the generated map 'line:7'",
        ),
        ("lime:7", {}, "did you mean 'line'"),
        ("x" * 5000, {}, "unknown map generator"),
        ("line:" + "1" * 900, {}, "expected from 1 to 268435456 cells"),
        ("", {}, "expected a map file"),
    ],
)
def test_open_map_refuses(text, options, words):
    with pytest.raises((InvalidInputError, LookupError), match=words):
        open_map(text, **options)


def test_names_that_are_no_text_are_made_so(tmp_path):
    path = tmp_path / "caf\udce9.txt"  # a byte that is no UTF-8, as files from old disks have it
    path.write_bytes(b"..\n")
    assert read_map(path).name == "caf?"


# Files that are whole or not there


def test_atomic_writes_whole_files(tmp_path):
    target = tmp_path / "new" / "file.txt"
    with atomic(target) as temporary:
        assert temporary.parent == target.parent
        assert temporary.suffix == ".txt"
        temporary.write_text("all of it")
        assert not target.exists()
    assert target.read_text() == "all of it"
    assert list(target.parent.iterdir()) == [target]


@pytest.mark.parametrize(
    "error", [ValueError("no"), KeyboardInterrupt(), OSError(28, "No space left on device")]
)
@pytest.mark.parametrize("old", [None, "old"])
def test_atomic_keeps_what_was_there(tmp_path, error, old):
    target = tmp_path / "file.txt"
    if old:
        target.write_text(old)
    expected = OutputError if isinstance(error, OSError) else type(error)
    # a block that fails half-way
    with pytest.raises(expected), atomic(target) as temporary:  # noqa: PT012
        temporary.write_text("half of")
        raise error
    assert [file.read_text() for file in tmp_path.iterdir()] == ([old] if old else [])


def test_atomic_says_what_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("in the way")
    for target, why in (
        (tmp_path, "it is a folder"),
        (tmp_path / "file" / "x.txt", "File exists|Not a directory"),
    ):
        with pytest.raises(OutputError, match=f"cannot write {target}: ({why})"), atomic(target):
            pytest.fail("the block must not run")


def test_atomic_takes_the_longest_names_and_the_usual_permissions(tmp_path):
    import os

    target = tmp_path / ("n" * 251 + ".txt")  # 255 bytes, the most that file systems take
    mask = os.umask(0o027)
    try:
        with atomic(target) as temporary:
            temporary.write_text("")
    finally:
        os.umask(mask)
    assert target.stat().st_mode & 0o777 == 0o640


# Arrays as maps


@pytest.mark.parametrize(
    "array",
    [
        STAIRS,
        STAIRS.astype(np.int64),
        STAIRS.astype(np.float32),
        STAIRS.tolist(),
        np.stack([STAIRS, STAIRS]),
        GridWorkspace(STAIRS),
    ],
    ids=["bool", "int", "float", "rows", "3-D", "workspace"],
)
def test_open_map_takes_arrays_and_workspaces(array):
    workspace = open_map(array)
    assert isinstance(workspace, GridWorkspace)
    np.testing.assert_array_equal(workspace.free, np.asarray(getattr(array, "free", array)) != 0)


def test_open_map_takes_level_and_label_of_arrays():
    numbers = np.arange(6).reshape(2, 3)
    assert open_map(numbers, level=np.float32(4)).n_free == 2
    assert open_map(numbers, label=np.int64(3)).cells.tolist() == [[1, 0]]
    with pytest.raises(
        InvalidInputError, match="expected a 2-D or 3-D array of cells, got 1 dimensions"
    ):
        open_map(np.arange(6))


def test_thresholds_of_the_vessel_finder_reach_it(tmp_path):
    pytest.importorskip("skimage")  # an extra
    photograph = np.full((120, 160), 220, dtype=np.uint8)
    photograph[20:100, 60:66] = photograph[55:60, 20:140] = 60
    Image.fromarray(photograph).save(tmp_path / "eye.png")
    with pytest.raises(
        InvalidInputError, match=r"eye.png: expected thresholds with 0 < low <= high <= 1"
    ):
        open_map(tmp_path / "eye.png", vessels=True, low=0.6, high=0.5)
    with pytest.raises(InvalidInputError, match=r"eye.png: thickest: expected a number"):
        open_map(tmp_path / "eye.png", vessels=True, thickest=0.9)
    assert open_map(tmp_path / "eye.png", vessels=True, bright=False, low=0.2, high=0.3).n_free > 50


def test_a_slice_that_is_a_link_to_nothing_is_named(tmp_path):
    write_map(GridWorkspace(np.eye(3) == 0), tmp_path / "1.png")
    (tmp_path / "2.png").symlink_to(tmp_path / "gone.png")
    with pytest.raises(InvalidInputError, match=r"2\.png"):
        read_map(tmp_path)


def test_pages_are_counted_no_further_than_the_limit(tmp_path, monkeypatch):
    from shoal.swarm.maps import pages, pictures, reading

    monkeypatch.setattr(reading, "MAX_LAYERS", 3)
    monkeypatch.setattr(pictures, "MAX_LAYERS", 3)
    monkeypatch.setattr(pages, "MAX_LAYERS", 3)
    for layers in (3, 5):
        write_map(GridWorkspace(np.ones((layers, 4, 4))), tmp_path / f"{layers}.tif")
    assert read_map(tmp_path / "3.tif").shape == (3, 4, 4)
    with pytest.raises(InvalidInputError, match="expected at most 3 layers, got more"):
        read_map(tmp_path / "5.tif")


def test_compressed_zeros_are_no_volume_and_are_not_unfolded(tmp_path):
    pytest.importorskip("nibabel")
    (tmp_path / "bomb.nii.gz").write_bytes(gzip.compress(bytes(1 << 24)))
    with pytest.raises(
        InvalidInputError, match="expected a NIfTI volume, got a damaged, truncated or other file"
    ):
        read_map(tmp_path / "bomb.nii.gz")


@pytest.mark.parametrize("sides", [(2.0, 0.5, 0.25), (0.5, 0.1)])
def test_a_tiff_keeps_the_size_of_a_cell(tmp_path, sides):
    free = np.zeros((3, 4, 5)[-len(sides) :], dtype=bool)
    free[..., 1:3, 1:4] = True
    write_map(GridWorkspace(free, spacing=sides), tmp_path / "cells.tif")
    read = read_map(tmp_path / "cells.tif")
    assert np.array_equal(read.free, free)
    assert read.spacing == pytest.approx(sides)


def test_a_file_that_loses_the_size_of_a_cell_says_so(tmp_path, capsys):
    write_map(GridWorkspace(np.ones((3, 4), dtype=bool), spacing=(2.0, 1.0)), tmp_path / "a.tif")
    for name, lost in (("b.tif", False), ("b.npy", True)):
        assert run(["maps", str(tmp_path / "a.tif"), "--out", str(tmp_path / name)]) == 0
        assert ("cannot hold the size of a cell" in capsys.readouterr().err) is lost


@pytest.mark.parametrize(
    ("names", "missing"),
    [
        (["s0", "s1", "s2", "s4"], 3),
        (["a2_010", "a2_020", "a2_040"], 30),
        (["s1", "s2", "s3"], None),
        (["s10", "s20", "s30"], None),
    ],
)
def test_a_slice_that_is_missing_is_told(tmp_path, monkeypatch, names, missing):
    told = []
    monkeypatch.setattr(notices, "listeners", [told.append])
    for name in names:
        write_map(GridWorkspace(np.ones((3, 4), dtype=bool)), tmp_path / f"{name}.png")
    assert read_map(tmp_path).shape == (len(names), 3, 4)
    said = [f"no picture has the number {missing};" in text for text in told]
    assert said == ([] if missing is None else [True])


def test_masked_cells_and_wrong_sizes_of_cells_are_refused():
    free = np.ones((3, 4), dtype=bool)
    GridWorkspace(np.ma.masked_array(free, mask=False))
    with pytest.raises(InvalidInputError, match=r"got a masked one at \(0, 1\)"):
        GridWorkspace(np.ma.masked_array(free, mask=np.eye(3, 4, k=1, dtype=bool)))
    for sides in (2.0, "abc", (1.0,), (1.0, 0.0)):
        with pytest.raises(InvalidInputError, match="spacing: expected 2 sizes above 0"):
            GridWorkspace(free, spacing=sides)
