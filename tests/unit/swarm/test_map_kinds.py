"""Map files as other programs write them: bit depths, masks, opacity, orientation, polarity, axes,
and the sizes of voxels.
"""

from __future__ import annotations

import bz2
import gzip
import io

import numpy as np
import pytest
from PIL import Image
from scipy.io import savemat
from tests.unit.swarm.map_samples import (
    GREYS,
    LINES,
    VOLUME,
    as_json,
    write_dicom,
    write_nrrd,
    write_tiffs,
)

from shoal.cli import run as shoal
from shoal.core import notices
from shoal.core.errors import InvalidInputError
from shoal.swarm.maps.files import open_map, read_map

FREE = LINES.astype(bool)


@pytest.fixture
def said(monkeypatch):
    """The notices of a test."""
    heard = []
    monkeypatch.setattr(notices, "listeners", [heard.append])
    monkeypatch.setattr(notices, "_told", set())
    return heard


def is_lines(path, **options):
    np.testing.assert_array_equal(read_map(path, **options).free, FREE)


# Masks and bit depths


@pytest.mark.parametrize("top", [1, 2, 7, 127, 128, 200, 255])
@pytest.mark.parametrize("suffix", [".png", ".bmp", ".tif", ".gif"])
def test_a_picture_of_two_values_is_a_mask(tmp_path, said, suffix, top):
    Image.fromarray(LINES * np.uint8(top)).save(tmp_path / f"mask{suffix}")
    is_lines(tmp_path / f"mask{suffix}")
    np.testing.assert_array_equal(read_map(tmp_path / f"mask{suffix}", invert=True).free, ~FREE)
    is_lines(tmp_path / f"mask{suffix}", label=top)
    is_lines(tmp_path / f"mask{suffix}", level=top)
    dark = [
        text
        for text in said
        if f"two brightnesses, 0 and {top} of 255; it is read as a mask" in text
    ]
    assert bool(dark) == (top < 128)


@pytest.mark.parametrize("top", [1, 4095, 65535])
@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_sixteen_bit_masks(tmp_path, suffix, top):
    Image.fromarray(LINES * np.uint16(top)).save(tmp_path / f"mask{suffix}")
    is_lines(tmp_path / f"mask{suffix}")
    is_lines(tmp_path / f"mask{suffix}", label=top)
    is_lines(tmp_path / f"mask{suffix}", level=top)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_dark_pictures_of_many_values_are_a_question(tmp_path, suffix):
    Image.fromarray(GREYS.astype(np.uint16) * 18).save(tmp_path / f"deep{suffix}")  # 12 bits of 16
    with pytest.raises(
        InvalidInputError,
        match=r"brightness of at least 0\.5 .*got values from 0 to 3960 .*--level N",
    ):
        read_map(tmp_path / f"deep{suffix}")
    with pytest.raises(InvalidInputError, match="got values from 0 to 3960"):
        read_map(tmp_path / f"deep{suffix}", invert=True)  # not everything
    assert read_map(tmp_path / f"deep{suffix}", level=1800).n_free == np.count_nonzero(GREYS)
    assert read_map(tmp_path / f"deep{suffix}", threshold=1800 / 65535).n_free == np.count_nonzero(
        GREYS
    )


@pytest.mark.parametrize("dtype", ["u1", "u2", "u4", "i1", "i2", "i4", "f2", "f4", "f8", "?"])
@pytest.mark.parametrize("order", ["<", ">"])
def test_tiff_of_every_number(tmp_path, dtype, order):
    tifffile = pytest.importorskip("tifffile")
    tifffile.imwrite(
        tmp_path / "mask.tif", LINES.astype(dtype), byteorder=order, photometric="minisblack"
    )
    is_lines(tmp_path / "mask.tif")
    is_lines(tmp_path / "mask.tif", label=1)
    many = (GREYS // 10).astype("u1" if dtype == "?" else dtype)
    tifffile.imwrite(tmp_path / "many.tif", many, byteorder=order, photometric="minisblack")
    assert read_map(tmp_path / "many.tif", level=10).n_free == np.count_nonzero(GREYS)
    assert read_map(tmp_path / "many.tif", label=10).n_free == np.count_nonzero(GREYS == 100)


@pytest.mark.parametrize("dtype", ["i2", "i4", "u4"])
def test_whole_numbers_without_white_are_a_question(tmp_path, dtype):
    tifffile = pytest.importorskip("tifffile")
    tifffile.imwrite(tmp_path / "labels.tif", (GREYS // 10).astype(dtype))
    with pytest.raises(
        InvalidInputError,
        match=(
            r"expected a picture whose white is known, got u?int\d+ values from 0 to 22 \(--level"
        ),
    ):
        read_map(tmp_path / "labels.tif")
    assert read_map(tmp_path / "labels.tif", threshold=0.9).n_free == np.count_nonzero(GREYS == 220)


@pytest.mark.parametrize("bits", [1, 2, 4])
def test_few_bits(tmp_path, bits):
    image = Image.fromarray(FREE) if bits == 1 else Image.fromarray(GREYS // 100).convert("P")
    if bits > 1:
        image.putpalette([0, 0, 0, 85, 85, 85, 170, 170, 170])
    image.save(tmp_path / "few.png", bits=bits)
    np.testing.assert_array_equal(
        read_map(tmp_path / "few.png", level=1 if bits == 1 else 85).free,
        FREE if bits == 1 else GREYS > 0,
    )


@pytest.mark.parametrize("planar", ["contig", "separate"])
@pytest.mark.parametrize("dtype", ["u1", "u2", "f4"])
def test_colours_of_every_depth(tmp_path, planar, dtype):
    tifffile = pytest.importorskip("tifffile")
    factor = {"u1": 1, "u2": 257, "f4": 1 / 255}[dtype]
    colours = np.zeros((20, 30, 3))
    colours[FREE] = (250, 250, 0)
    colours[~FREE] = (0, 100, 250)
    stored = (colours * factor).astype(dtype)
    stored = stored if planar == "contig" else np.moveaxis(stored, -1, 0)
    tifffile.imwrite(tmp_path / "colour.tif", stored, photometric="rgb", planarconfig=planar)
    is_lines(tmp_path / "colour.tif")
    is_lines(tmp_path / "colour.tif", channel="red")
    is_lines(tmp_path / "colour.tif", channel=1)
    np.testing.assert_array_equal(read_map(tmp_path / "colour.tif", channel="blue").free, ~FREE)
    with pytest.raises(
        InvalidInputError,
        match=r"label: expected one number for each pixel, got the channels red, green, blue",
    ):
        read_map(tmp_path / "colour.tif", label=1)


def test_pages_of_floats_are_layers(tmp_path):
    tifffile = pytest.importorskip("tifffile")
    with tifffile.TiffWriter(tmp_path / "pages.tif") as writer:
        for layer in VOLUME:
            writer.write(layer.astype(np.float64), contiguous=False)
    np.testing.assert_array_equal(read_map(tmp_path / "pages.tif", level=100).free, VOLUME >= 100)
    with tifffile.TiffWriter(tmp_path / "sizes.tif") as writer:
        for layer in (VOLUME[0], VOLUME[1, :9]):
            writer.write(layer.astype(np.float64), contiguous=False)
    with pytest.raises(
        InvalidInputError, match="expected pages of one picture, got 2 pictures of 20x30 and 9x30"
    ):
        read_map(tmp_path / "sizes.tif", level=100)


@pytest.mark.parametrize("dtype", ["u1", "f4"])
def test_axes_without_a_microscope(tmp_path, dtype):
    tifffile = pytest.importorskip("tifffile")
    tifffile.imwrite(
        tmp_path / "film.tif",
        VOLUME.astype(dtype),
        photometric="minisblack",
        metadata={"axes": "TYX"},
    )
    with pytest.raises(InvalidInputError, match=r"one frame \(--frame\), got 3"):
        read_map(tmp_path / "film.tif", level=100)
    np.testing.assert_array_equal(
        read_map(tmp_path / "film.tif", level=100, frame=3).free, VOLUME[2] >= 100
    )
    tifffile.imwrite(
        tmp_path / "four.tif", np.stack([VOLUME, VOLUME]).astype(dtype), photometric="minisblack"
    )
    with pytest.raises(
        InvalidInputError, match="expected rows, columns, layers, channels and time, got an axis"
    ):
        read_map(tmp_path / "four.tif", level=100)


def test_many_channels_are_a_question(tmp_path):
    tifffile = pytest.importorskip("tifffile")
    channels = np.stack([GREYS * 0, LINES * 255, 255 - LINES * 255, GREYS, GREYS], axis=-1).astype(
        np.uint8
    )
    tifffile.imwrite(
        tmp_path / "many.tif", channels, photometric="minisblack", planarconfig="contig"
    )
    with pytest.raises(
        InvalidInputError,
        match=(
            r"expected a grey or a colour picture, got the channels .* \(choose one by --channel\)"
        ),
    ):
        read_map(tmp_path / "many.tif")
    is_lines(tmp_path / "many.tif", channel=2)
    is_lines(tmp_path / "many.tif", channel=3, invert=True)
    assert read_map(tmp_path / "many.tif", channel=5, level=150).n_free == np.count_nonzero(
        GREYS == 220
    )


# Polarity, opacity, orientation


@pytest.mark.parametrize("dtype", ["?", "u1", "u2"])
def test_min_is_white(tmp_path, said, dtype):
    tifffile = pytest.importorskip("tifffile")
    stored = FREE if dtype == "?" else LINES.astype(dtype) * np.iinfo(dtype).max
    tifffile.imwrite(tmp_path / "white.tif", stored, photometric="miniswhite")
    # small numbers are white
    np.testing.assert_array_equal(read_map(tmp_path / "white.tif").free, ~FREE)
    assert ["MinIsWhite" in text and "--invert" in text for text in said] == [True]
    is_lines(tmp_path / "white.tif", invert=True)
    is_lines(tmp_path / "white.tif", label=int(stored.max()))  # the number that the file stores


@pytest.mark.parametrize("mode", ["LA", "RGBA", "P"])
@pytest.mark.parametrize("ink", [0, 255])
@pytest.mark.parametrize("hidden", [0, 255])
@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_lines_on_transparent_ground(tmp_path, said, mode, ink, hidden, suffix):
    """White lines are free, and black lines are obstacles, whatever colour the transparent pixels
    hide.
    """
    if mode == "P" and suffix == ".tif":
        suffix = ".gif"
    path = tmp_path / f"lines{suffix}"
    grey = np.where(FREE, ink, hidden).astype(np.uint8)
    if mode == "P":
        image = Image.fromarray(LINES).convert("P")
        image.putpalette([hidden] * 3 + [ink] * 3)
        image.save(path, transparency=0)
    else:
        colour = [grey] if mode == "LA" else [grey] * 3
        Image.fromarray(np.stack([*colour, LINES * 255], axis=-1)).save(path)
    np.testing.assert_array_equal(read_map(path).free, FREE if ink else ~FREE)
    assert any(
        "transparent pixels count as " + ("black" if ink else "white") in text for text in said
    )
    is_lines(path, channel="alpha")


@pytest.mark.parametrize(
    ("mode", "option"),
    [("LA", "level"), ("LA", "label"), ("RGBA", "level"), ("RGBA", "label"), ("P", "level")],
)
def test_numbers_that_transparent_pixels_hide_do_not_count(tmp_path, mode, option):
    """White lines on transparent white were free everywhere."""
    path = tmp_path / "lines.png"
    white = np.full_like(LINES, 255)
    if mode == "P":
        image = Image.fromarray(LINES).convert("P")
        image.putpalette([255] * 6)
        image.save(path, transparency=0)
    else:
        Image.fromarray(np.stack([white] * (len(mode) - 1) + [LINES * 255], axis=-1)).save(path)
    with pytest.raises(InvalidInputError, match=f"{option}: expected opaque pixels"):
        read_map(path, **{option: 50})
    is_lines(path, channel="alpha", level=50)


@pytest.mark.parametrize("ink", [0, 255])
def test_faint_lines_stand_out_from_their_ground(tmp_path, ink):
    """The ground of lines that are less than half opaque was always white."""
    path = tmp_path / "faint.png"
    grey = np.full_like(LINES, ink)
    Image.fromarray(np.stack([grey, grey, grey, LINES * 100], axis=-1)).save(path)
    np.testing.assert_array_equal(read_map(path).free, FREE if ink else ~FREE)


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_a_wholly_transparent_picture_is_refused(tmp_path, suffix):
    from shoal.swarm.maps.pictures import read_pixels

    path = tmp_path / f"nothing{suffix}"
    Image.fromarray(np.stack([LINES * 255, LINES * 0], axis=-1)).save(path)
    for read in (read_map, read_pixels):
        with pytest.raises(InvalidInputError, match=r"nothing.*expected pixels that can be seen"):
            read(path)
    assert read_map(path, channel=1).n_free == np.count_nonzero(FREE)


def test_the_ground_of_a_stack_is_that_of_all_its_pages(tmp_path):
    for number in range(3):  # on the first page, nothing is drawn
        drawn = LINES if number else LINES * 0
        Image.fromarray(np.stack([drawn * 255, drawn * 255], axis=-1)).save(
            tmp_path / f"{number}.png"
        )
    assert read_map(tmp_path).n_free == 2 * np.count_nonzero(FREE)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("suffix", [".jpg", ".png", ".tif"])
def test_pictures_are_turned_as_they_are_seen(tmp_path, orientation, suffix):
    from shoal.swarm.maps.pictures import read_pixels

    ways = {
        1: lambda a: a,
        2: np.fliplr,
        3: lambda a: np.rot90(a, 2),
        4: np.flipud,
        5: lambda a: a.T,
        6: lambda a: np.rot90(a, -1),
        7: lambda a: np.rot90(a.T, 2),
        8: np.rot90,
    }
    stored = np.kron(LINES[:, :20], np.ones((8, 8), np.uint8)) * 255
    image = Image.fromarray(stored)
    exif = Image.Exif()
    exif[0x0112] = orientation
    image.save(tmp_path / f"turned{suffix}", exif=exif)
    seen = ways[orientation](stored) > 127
    np.testing.assert_array_equal(read_map(tmp_path / f"turned{suffix}").free, seen)
    np.testing.assert_array_equal(read_pixels(tmp_path / f"turned{suffix}") > 127, seen)


def test_cmyk(tmp_path):
    colours = Image.fromarray(np.stack([LINES * 255] * 3, axis=-1)).convert("CMYK")
    for suffix in (".tif", ".jpg"):
        colours.save(tmp_path / f"ink{suffix}", **({"quality": 100} if suffix == ".jpg" else {}))
        is_lines(tmp_path / f"ink{suffix}")
    tifffile = pytest.importorskip("tifffile")
    inks = np.stack(
        [np.zeros_like(LINES), np.zeros_like(LINES), np.zeros_like(LINES), 1 - LINES], axis=-1
    ).astype(np.uint16)
    tifffile.imwrite(tmp_path / "deep.tif", inks * np.uint16(65535), photometric="separated")
    is_lines(tmp_path / "deep.tif")
    is_lines(tmp_path / "deep.tif", channel="black", invert=True)


def test_sixteen_bits_a_channel_are_not_cut_in_silence(tmp_path):
    import struct
    import zlib

    rows = np.stack([GREYS.astype(">u2") * 290] * 3, axis=-1).astype(">u2")
    raw = b"".join(b"\0" + row.tobytes() for row in rows)
    chunks = [
        (b"IHDR", struct.pack(">IIBBBBB", 30, 20, 16, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(raw)),
        (b"IEND", b""),
    ]
    body = b"".join(
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        for kind, data in chunks
    )
    (tmp_path / "deep.png").write_bytes(b"\x89PNG\r\n\x1a\n" + body)
    assert read_map(tmp_path / "deep.png").n_free == np.count_nonzero(GREYS == 220)
    with pytest.raises(
        InvalidInputError,
        match="level: expected 8 bits for each channel of a colour picture, got 16",
    ):
        read_map(tmp_path / "deep.png", level=30000)


# Text and arrays


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("blanks.txt", b"1 1 0\n0 1 1\n"),
        ("tabs.txt", b"1\t1\t0\n0\t1\t1\n"),
        ("digits.txt", b"110\n011\n"),
        ("commas.txt", b"1,1,0\n0,1,1\n"),
        ("wide.txt", b"  1   1   0\n  0   1   1\n"),
        ("saved.txt", b"# maze\n1.000000000000000000e+00 1.0e+00 0.0\n0.0 1.0 1.0\n"),
        ("semicolons.csv", b"1;1;0\n0;1;1\n"),
        ("blanks.csv", b"1 1 0\r\n0 1 1\r\n"),
        ("mixed.csv", b"1, 1.0, 0\n0, 1, 1\n"),
        ("nan.csv", b"1,1,nan\nnan,1,1\n"),
        ("mask.csv", b"255,255,0\n0,255,255\n"),
        ("twos.txt", b"220\n022\n"),
    ],
)
def test_tables(tmp_path, name, text):
    (tmp_path / name).write_bytes(text)
    assert read_map(tmp_path / name).free.astype(int).tolist() == [[1, 1, 0], [0, 1, 1]]


@pytest.mark.parametrize("name", ["maze.txt", "maze.csv"])
def test_mazes_of_three_numbers(tmp_path, name):
    separator = "," if name.endswith("csv") else " "
    np.savetxt(tmp_path / name, [[2, 0, 1], [1, 0, 0]], fmt="%d", delimiter=separator)
    with pytest.raises(
        InvalidInputError,
        match=r"line 1, column 3: expected 0 or 2, got '1' \(--level and --label take other",
    ):
        read_map(tmp_path / name)
    assert read_map(tmp_path / name, label=0).n_free == 3
    assert read_map(tmp_path / name, label=1, invert=True).n_free == 4
    assert read_map(tmp_path / name, level=1).n_free == 3


def test_long_texts_are_refused_before_the_work(tmp_path, monkeypatch):
    from shoal.swarm.maps import text

    monkeypatch.setattr(text, "MOST_LINES", 4)
    monkeypatch.setattr(text, "LONGEST_LINE", 20)
    (tmp_path / "high.csv").write_text("1\n" * 5)
    (tmp_path / "wide.csv").write_text("1.0," * 9 + "1")
    for name, words in (
        ("high.csv", "at most 4 lines, got 5"),
        ("wide.csv", "at most 20 characters, got 37"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            read_map(tmp_path / name)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("piece", [7, 1 << 20])
def test_arrays_in_pieces(tmp_path, monkeypatch, order, piece):
    from shoal.swarm.maps import text as arrays
    from shoal.swarm.maps import values

    monkeypatch.setattr(arrays, "PIECE", piece)
    monkeypatch.setattr(values, "PIECE", piece)
    np.save(tmp_path / "volume.npy", np.asarray(VOLUME, dtype=">f4", order=order))
    for value in (100, 220):
        np.testing.assert_array_equal(
            read_map(tmp_path / "volume.npy", label=value).free, value == VOLUME
        )


def test_matlab(tmp_path):
    savemat(tmp_path / "maze.mat", {"maze": LINES.astype(bool), "size": 0.5, "about": "a maze"})
    is_lines(tmp_path / "maze.mat")
    savemat(tmp_path / "volume.mat", {"v": VOLUME.transpose(1, 2, 0)}, do_compression=True)
    np.testing.assert_array_equal(read_map(tmp_path / "volume.mat", level=100).free, VOLUME >= 100)
    savemat(tmp_path / "two.mat", {"a": LINES, "b": LINES})
    with pytest.raises(
        InvalidInputError,
        match="expected one matrix of numbers in 2 or 3 dimensions, got a 20x30, b 20x30",
    ):
        read_map(tmp_path / "two.mat")
    savemat(tmp_path / "none.mat", {"about": "a maze"})
    with pytest.raises(
        InvalidInputError,
        match="expected one matrix of numbers in 2 or 3 dimensions, got about 1 \\(char\\)",
    ):
        read_map(tmp_path / "none.mat")
    (tmp_path / "new.mat").write_bytes(
        b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(99)
    )
    with pytest.raises(InvalidInputError, match=r"got version 7\.3 \(save"):
        read_map(tmp_path / "new.mat")


# Axes and sizes


def test_a_film_is_no_volume(tmp_path):
    frames = [Image.fromarray(np.roll(LINES, shift, axis=1) * 255) for shift in range(3)]
    frames[0].save(tmp_path / "film.gif", save_all=True, append_images=frames[1:])
    with pytest.raises(
        InvalidInputError, match=r"expected the choice of one frame \(--frame\), got 3"
    ):
        read_map(tmp_path / "film.gif")
    np.testing.assert_array_equal(
        read_map(tmp_path / "film.gif", frame=3).free, np.roll(FREE, 2, axis=1)
    )
    with pytest.raises(InvalidInputError, match="frame: expected one of 1, 2, 3, got 4"):
        read_map(tmp_path / "film.gif", frame=4)


@pytest.mark.parametrize(
    ("name", "spacing"),
    [("imagej.tif", (0.002, 0.00025, 0.00025)), ("cells.ome.tif", (0.003, 0.00025, 0.0005))],
)
def test_channels_and_times_of_microscopes(tmp_path, name, spacing):
    pytest.importorskip("tifffile")
    write_tiffs(tmp_path)
    with pytest.raises(
        InvalidInputError, match=r"expected the choice of one frame \(--frame\), got 2"
    ):
        read_map(tmp_path / name, channel=1)
    with pytest.raises(
        InvalidInputError, match=r"expected the choice of one channel \(--channel\), got 2"
    ):
        read_map(tmp_path / name, frame=1)
    for frame in (1, 2):
        for channel in (1, 2):
            workspace = read_map(tmp_path / name, frame=frame, channel=channel)
            expected = np.roll(VOLUME, (channel - 1, 4 * (frame - 1)), axis=(1, 2))
            np.testing.assert_array_equal(workspace.free, expected >= 128)
            assert workspace.spacing == pytest.approx(spacing)
    scaled = read_map(tmp_path / name, frame=1, channel=1, scale=2.0)
    assert scaled.shape == (3, 40, 60)
    assert scaled.spacing == pytest.approx((spacing[0], spacing[1] / 2, spacing[2] / 2))
    if name == "cells.ome.tif":
        assert read_map(tmp_path / name, frame=1, channel="gfp") == read_map(
            tmp_path / name, frame=1, channel=2
        )
        with pytest.raises(
            InvalidInputError, match=r"channel: expected one of 1 \(DAPI\), 2 \(GFP\), got 'red'"
        ):
            read_map(tmp_path / name, frame=1, channel="red")


@pytest.mark.parametrize("encoding", ["raw", "gzip", "bzip2", "ascii"])
def test_nrrd(tmp_path, encoding):
    pytest.importorskip("nrrd")
    write_nrrd(tmp_path / "v.nrrd", VOLUME, encoding=encoding, spacings=[0.25, 0.5, 2.0])
    workspace = read_map(tmp_path / "v.nrrd", label=220)
    np.testing.assert_array_equal(workspace.free, VOLUME == 220)
    assert workspace.spacing == (2.0, 0.5, 0.25)
    write_nrrd(tmp_path / "p.nrrd", LINES, encoding=encoding)
    is_lines(tmp_path / "p.nrrd")


def test_nrrd_in_the_space_of_a_body_is_turned_as_nifti(tmp_path):
    nibabel, _ = pytest.importorskip("nibabel"), pytest.importorskip("nrrd")
    stored = VOLUME.transpose(2, 0, 1)
    nibabel.save(nibabel.Nifti1Image(stored, np.diag([2.0, 3.0, 4.0, 1.0])), tmp_path / "v.nii")
    directions = {
        "right-anterior-superior": np.diag([2.0, 3.0, 4.0]),
        "left-posterior-superior": np.diag([-2.0, -3.0, 4.0]),
    }
    for space, vectors in directions.items():
        header = {"space": space, "space directions": vectors, "space units": ["mm"] * 3}
        write_nrrd(tmp_path / "v.nrrd", stored.T, **header)
        one, other = (
            read_map(tmp_path / "v.nrrd", label=100),
            read_map(tmp_path / "v.nii", label=100),
        )
        assert one == other
        assert one.spacing == pytest.approx(other.spacing)


def test_nrrd_axes_of_time_and_colour(tmp_path):
    pytest.importorskip("nrrd")
    film = np.stack([VOLUME, np.roll(VOLUME, 1, axis=1)])
    write_nrrd(tmp_path / "film.nrrd", film, kinds=["domain", "domain", "domain", "time"])
    with pytest.raises(
        InvalidInputError,
        match=r"expected the choice of one frame \(--frame\), got 2: 1, 2",
    ):
        read_map(tmp_path / "film.nrrd", label=220)
    np.testing.assert_array_equal(
        read_map(tmp_path / "film.nrrd", label=220, frame=2).free, film[1] == 220
    )
    colours = np.stack([VOLUME, VOLUME // 2, VOLUME * 0], axis=-1)
    write_nrrd(
        tmp_path / "colours.nrrd", colours, kinds=["RGB-color", "domain", "domain", "domain"]
    )
    with pytest.raises(InvalidInputError, match=r"choice of one channel \(--channel\), got 3"):
        read_map(tmp_path / "colours.nrrd", label=220)
    np.testing.assert_array_equal(
        read_map(tmp_path / "colours.nrrd", label=110, channel=2).free, VOLUME == 220
    )


def test_nrrd_that_is_wrong(tmp_path):
    pytest.importorskip("nrrd")
    head = b"NRRD0004\ntype: %s\ndimension: 3\nsizes: %s\nencoding: %s\nendian: little\n\n"
    bad = {
        "huge": (head % (b"float", b"9000 9000 9000", b"gzip"), "expected at most 268435456 cells"),
        "wide": (
            head % (b"double", b"640 640 400", b"gzip"),
            "expected at most 1073741824 bytes of data",
        ),
        "short": (
            head % (b"uchar", b"2 2 2", b"raw") + bytes(4),
            "expected 8 bytes of data, got 4",
        ),
        "hex": (
            head % (b"uchar", b"2 2 2", b"hex") + bytes(8),
            "expected the encoding raw, gzip, bzip2 or ascii, got 'hex'",
        ),
        "block": (
            head % (b"block", b"2 2 2", b"raw") + bytes(8),
            "expected numbers, got the type 'block'",
        ),
        "cut": (
            head % (b"uchar", b"2 2 2", b"gzip") + gzip.compress(bytes(8))[:9],
            "damaged or truncated",
        ),
        "bomb": (
            head % (b"uchar", b"2 2 2", b"bzip2") + bz2.compress(bytes(1 << 24)),
            "at least one free cell, got 8 obstacles",
        ),
        "outside": (
            b"NRRD0004\ntype: uchar\ndimension: 1\nsizes: 2\nencoding: raw\ndata file: ../x\n",
            "in 2 or 3 dimensions",
        ),
        "away": (
            head[:-1] % (b"uchar", b"2 2 2", b"raw") + b"data file: ../x\n",
            "a file of data in the folder of the header",
        ),
        "other": (b"P5\n", "expected a NRRD file, got a damaged or truncated file"),
    }
    for name, (content, words) in bad.items():
        (tmp_path / f"{name}.nrrd").write_bytes(content)
        with pytest.raises(InvalidInputError, match=words):
            read_map(tmp_path / f"{name}.nrrd")


def test_dicom_series(tmp_path, said):
    """Layers lie in the order of space, whatever the files are called, and are seen from the front
    as NIfTI is.
    """
    nibabel, _ = pytest.importorskip("nibabel"), pytest.importorskip("pydicom")
    write_dicom(tmp_path, VOLUME)
    workspace = read_map(tmp_path / "series", label=220)
    # the same volume in NIfTI: x to the left, y to the back, z to the foot
    stored = VOLUME.transpose(2, 1, 0)
    nibabel.save(nibabel.Nifti1Image(stored, np.diag([-0.25, -0.5, -2.5, 1.0])), tmp_path / "v.nii")
    other = read_map(tmp_path / "v.nii", label=220)
    assert workspace == other
    assert workspace.shape == (20, 3, 30)
    assert workspace.spacing == other.spacing == (0.5, 2.5, 0.25)
    one = next((tmp_path / "series").iterdir())
    assert read_map(one, level=100).shape == (20, 30)
    assert read_map(one, level=100).spacing == (0.5, 0.25)
    write_dicom(tmp_path, VOLUME, name="hounsfield", RescaleSlope=2, RescaleIntercept=-100)
    assert read_map(tmp_path / "hounsfield", level=340).n_free == np.count_nonzero(VOLUME == 220)
    assert not said


def test_a_dicom_series_without_the_size_of_a_pixel_is_turned_too(tmp_path):
    write_dicom(tmp_path, VOLUME)
    write_dicom(tmp_path, VOLUME, name="bare", PixelSpacing=None)
    whole, bare = (read_map(tmp_path / name, level=20) for name in ("series", "bare"))
    np.testing.assert_array_equal(bare.free, whole.free)
    assert bare.spacing is None


def test_dicom_series_that_are_wrong(tmp_path, said):
    pydicom = pytest.importorskip("pydicom")
    write_dicom(tmp_path, VOLUME)
    write_dicom(tmp_path, VOLUME, name="other")
    for file in (tmp_path / "other").iterdir():
        file.rename(tmp_path / "series" / f"again-{file.name}")
    with pytest.raises(
        InvalidInputError,
        match=r"expected one series, got 2 \(3 of ….*, 3 of ….*\); give each series a folder",
    ):
        read_map(tmp_path / "series", label=220)
    write_dicom(tmp_path, np.stack([*VOLUME, *VOLUME]), name="gap")
    sorted((tmp_path / "gap").iterdir(), key=lambda path: path.name[-5])[2].unlink()
    read_map(tmp_path / "gap", label=220)
    assert any("the distances of the images differ from 2.5 to 5 mm" in text for text in said)
    for name, key, value in (
        ("pixels", "PixelSpacing", [0.5, 0.5]),
        ("tilted", "ImagePositionPatient", [0, 1.0, 0]),
    ):
        write_dicom(tmp_path, VOLUME, name=name)
        file = next((tmp_path / name).glob("?0.dcm"))
        image = pydicom.dcmread(file)
        setattr(image, key, value)
        image.save_as(file)
    with pytest.raises(InvalidInputError, match=r"expected pixels of 0.5x\S+ mm as in the first"):
        read_map(tmp_path / "pixels", label=220)
    read_map(tmp_path / "tilted", label=220)
    assert "the images are shifted against each other by up to 1 mm" in said[-1]
    write_dicom(tmp_path, VOLUME, name="same", step=0.0)
    with pytest.raises(InvalidInputError, match="expected one image at each place"):
        read_map(tmp_path / "same", label=220)
    (tmp_path / "no.dcm").write_bytes(b"no DICOM at all" * 20)
    with pytest.raises(
        InvalidInputError, match="expected a DICOM file, got a damaged or other file"
    ):
        read_map(tmp_path / "no.dcm")


# Volumes and stacks


def test_nan_is_not_free(tmp_path, said):
    nibabel = pytest.importorskip("nibabel")
    values = VOLUME.astype(np.float32)
    values[0] = np.nan
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), tmp_path / "nan.nii.gz")
    assert read_map(tmp_path / "nan.nii.gz", level=100).n_free == np.count_nonzero(values >= 100)
    assert read_map(tmp_path / "nan.nii.gz", level=100, invert=True).n_free == np.count_nonzero(
        values < 100
    )
    assert "600 cells have no number (NaN) and count as not free" in said[0]


def test_nifti_with_slope_frames_and_vectors(tmp_path):
    nibabel = pytest.importorskip("nibabel")
    stored = VOLUME.transpose(2, 0, 1)
    data = np.stack(
        [
            np.stack([stored, np.roll(stored, 1, axis=0)], axis=-1),
            np.stack([stored * 0, stored], axis=-1),
        ],
        axis=-1,
    )
    image = nibabel.Nifti1Image(data, np.eye(4))
    image.header.set_slope_inter(0.5, 10)
    for suffix in (".nii", ".nii.gz"):
        nibabel.save(image, tmp_path / f"five{suffix}")
        five = nibabel.load(tmp_path / f"five{suffix}").get_fdata()
        nibabel.save(nibabel.Nifti1Image(five[..., 1, 0], np.eye(4)), tmp_path / "plain.nii")
        level = float(np.median(five[..., 1, 0][five[..., 1, 0] > five.min()]))
        assert read_map(tmp_path / f"five{suffix}", frame=2, channel=1, level=level) == read_map(
            tmp_path / "plain.nii", level=level
        )
        with pytest.raises(InvalidInputError, match=r"choice of one channel \(--channel\), got 2"):
            read_map(tmp_path / f"five{suffix}", frame=2, level=level)


def test_labels_of_a_stack(tmp_path, said):
    pages = [
        Image.fromarray(np.where(FREE & (number > 0), 3, 0).astype(np.uint8)) for number in range(4)
    ]
    pages[0].save(tmp_path / "labels.tif", save_all=True, append_images=pages[1:])
    # the first page is empty, and the mask is that of all pages
    for options in {"label": 3}, {"level": 1}, {}:
        assert read_map(tmp_path / "labels.tif", **options).n_free == 3 * np.count_nonzero(FREE)
    assert any("0 and 3 of 255; it is read as a mask" in text for text in said)
    with pytest.raises(
        InvalidInputError,
        match=r"expected cells of label 2, got none \(the labels in the map are 0, 3\)",
    ):
        read_map(tmp_path / "labels.tif", label=2)


def test_names_of_slices_may_have_any_digits(tmp_path):
    for number, name in enumerate(["1.png", "10.png", "2.png", "3².png", "٣.png"]):
        Image.fromarray(np.full((2, 2), 255 * (number % 2 == 0), np.uint8)).save(tmp_path / name)
    # 1, 2, 3², 10, and a name without digits
    assert read_map(tmp_path).free[:, 0, 0].tolist() == [True, True, False, False, True]


def test_limits_count_after_scaling(tmp_path, monkeypatch):
    from shoal.swarm.maps import pages, reading

    monkeypatch.setattr(reading, "MAX_CELLS", 200)
    Image.fromarray(LINES * 255).save(tmp_path / "large.png")
    with pytest.raises(InvalidInputError, match="expected at most 200 cells, got 20x30"):
        read_map(tmp_path / "large.png")
    assert read_map(tmp_path / "large.png", scale=0.5).shape == (10, 15)
    with pytest.raises(InvalidInputError, match="expected at most 200 cells, got 40x60"):
        read_map(tmp_path / "large.png", scale=2.0)
    monkeypatch.setattr(pages, "LARGEST_PICTURE", 300)
    with pytest.raises(InvalidInputError, match="expected at most 300 bytes of data, got 600"):
        read_map(tmp_path / "large.png", scale=0.5)


# What is said about a file


def test_maps_says_what_it_reads(tmp_path, capsys):
    parts = np.zeros((12, 30), dtype=np.uint8)
    parts[3:6, 2:14] = parts[8:10, 20:28] = parts[2, 20:27] = 255
    path = tmp_path / "three.png"
    Image.fromarray(parts).save(path)
    assert shoal(["maps", str(path)]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "12 rows × 30 columns, 59 free cells" in told
    assert (
        "3 parts: the largest has 61.02 % of the free cells; --largest-component keeps only it"
        in told
    )
    assert (
        "the free cells lie in rows 2 to 9, columns 2 to 27 of the picture, counted from 0" in told
    )
    assert shoal(["maps", str(path), "--largest-component", "--json"]) == 0
    told = as_json(capsys)
    assert (told["free_cells"], told["parts"], told["largest_share"]) == (
        36,
        3,
        pytest.approx(36 / 59),
    )
    assert told["free_share"] == pytest.approx(told["free_cells"] / 360)
    assert told["place"] == {"rows": [3, 5], "columns": [2, 13]}
    assert shoal(["maps", str(path), "--largest-component", "--scale", "2", "--json"]) == 0
    told = as_json(capsys)
    assert told["shape"] == [24, 60]
    assert told["place"] == {"rows": [3, 5], "columns": [2, 13]}  # in pixels of the picture
    assert shoal(["maps", str(path), "--seed", "3"]) == 2
    assert "seed: expected no seed for a map file, got 3" in capsys.readouterr().err


def test_maps_and_map_take_the_same_options(tmp_path, capsys):
    Image.fromarray(GREYS).save(tmp_path / "grey.png")
    for options in (
        ["--level", "50"],
        ["--label", "220"],
        ["--threshold", "0.2", "--invert"],
        ["--scale", "0.5"],
    ):
        assert shoal(["maps", str(tmp_path / "grey.png"), *options, "--json"]) == 0
        shown = as_json(capsys)
        words = {"--level": float, "--label": int, "--threshold": float, "--scale": float}
        given = {
            name[2:]: words[name](value)
            for name, value in zip(options[::2], options[1::2], strict=False)
        }
        workspace = open_map(tmp_path / "grey.png", **given, invert="--invert" in options)
        assert (shown["shape"], shown["free_cells"]) == (list(workspace.shape), workspace.n_free)
    for command in ("map", "maps"):
        assert shoal([command, str(tmp_path / "grey.png"), "--frame", "2"]) == 2
        assert (
            "frame: expected no frame for a file without a time axis, got 2"
            in capsys.readouterr().err
        )


@pytest.mark.parametrize("suffix", ["png", "npy"])
def test_parts_of_large_maps_are_not_counted(tmp_path, monkeypatch, capsys, suffix):
    from shoal.swarm.maps import resampling as parts

    monkeypatch.setattr(parts, "MOST_COUNTED", 10)
    path = tmp_path / f"large.{suffix}"
    Image.fromarray(LINES * 255).save(path) if suffix == "png" else np.save(path, LINES)
    assert shoal(["maps", str(path)]) == 0
    assert "not counted in a map of this size" in capsys.readouterr().out


@pytest.mark.parametrize("top", [1, 4095])
def test_twelve_bits_that_are_packed(tmp_path, top):
    import struct

    values = LINES.astype(int) * top
    pairs = values.reshape(-1, 2)
    data = b"".join(bytes([a >> 4, (a & 15) << 4 | b >> 8, b & 255]) for a, b in pairs.tolist())
    tags = [
        (256, 4, 30),
        (257, 4, 20),
        (258, 3, 12),
        (259, 3, 1),
        (262, 3, 1),
        (273, 4, 8),
        (277, 3, 1),
        (278, 4, 20),
        (279, 4, len(data)),
    ]
    entries = b"".join(struct.pack("<HHII", tag, size, 1, value) for tag, size, value in tags)
    header = struct.pack("<2sHI", b"II", 42, 8 + len(data))
    (tmp_path / "packed.tif").write_bytes(
        header + data + struct.pack("<H", len(tags)) + entries + bytes(4)
    )
    is_lines(tmp_path / "packed.tif")
    is_lines(tmp_path / "packed.tif", label=top)


def test_a_colour_array_is_not_taken_for_layers_in_silence(tmp_path, said):
    np.save(tmp_path / "colour.npy", np.stack([LINES * 255] * 3, axis=-1))
    assert read_map(tmp_path / "colour.npy").shape == (20, 30, 3)
    assert "20 layers of 30 rows and 3 columns (--channel" in said[0]
    is_lines(tmp_path / "colour.npy", channel=1)


def test_films_and_compressed_images_of_scanners(tmp_path):
    pytest.importorskip("pydicom")
    film = np.stack([LINES, np.roll(LINES, 2, axis=1)]).reshape(1, 40, 30)
    more = {"NumberOfFrames": 2, "Rows": 20}
    write_dicom(tmp_path, film, name="film", FrameTime=40, **more)
    one = next((tmp_path / "film").iterdir())
    with pytest.raises(
        InvalidInputError, match=r"expected the choice of one frame \(--frame\), got 2"
    ):
        read_map(one)
    np.testing.assert_array_equal(read_map(one, frame=2).free, np.roll(FREE, 2, axis=1))
    write_dicom(tmp_path, film, name="volume", SpacingBetweenSlices=2, **more)
    volume = read_map(next((tmp_path / "volume").iterdir()))
    assert (volume.shape, volume.spacing) == ((2, 20, 30), (2.0, 0.5, 0.25))
    with pytest.raises(
        InvalidInputError,
        match="frame: expected no frame for a file without a time axis, got 2",
    ):
        read_map(next((tmp_path / "volume").iterdir()), frame=2)


def test_numbers_of_a_file_of_several_images_have_the_scale_of_each_image(tmp_path):
    """Enhanced files state slope and intercept for all images, or for each image."""
    pydicom = pytest.importorskip("pydicom")

    def group(slope, shift):
        scale, group = pydicom.Dataset(), pydicom.Dataset()
        scale.RescaleSlope, scale.RescaleIntercept = slope, shift
        group.PixelValueTransformationSequence = [scale]
        return group

    counts = np.array([[10, 20], [30, 40], [10, 20], [30, 40]])
    more = {"NumberOfFrames": 2, "Rows": 2, "SpacingBetweenSlices": 2}
    groups = {
        "shared": {"SharedFunctionalGroupsSequence": [group(2, -5)]},
        "each": {"PerFrameFunctionalGroupsSequence": [group(2, -5), group(4, 0)]},
    }
    free = {}
    for name, own in groups.items():
        write_dicom(tmp_path, counts[None], name=name, **more, **own)
        free[name] = read_map(next((tmp_path / name).iterdir()), level=70).free.astype(int).tolist()
    assert free == {
        "shared": [[[0, 0], [0, 1]], [[0, 0], [0, 1]]],
        "each": [[[0, 0], [0, 1]], [[0, 1], [1, 1]]],
    }
    table = pydicom.Dataset()
    write_dicom(tmp_path, counts[None, :2], name="table", ModalityLUTSequence=[table])
    with pytest.raises(InvalidInputError, match="got a table of their meanings"):
        read_map(next((tmp_path / "table").iterdir()))
    write_dicom(tmp_path, counts[None, :2], name="endless", RescaleSlope="1e999")
    with pytest.raises(InvalidInputError, match="expected a finite slope"):
        read_map(next((tmp_path / "endless").iterdir()))


@pytest.mark.parametrize(("kind", "planar"), [("RGB", 0), ("RGB", 1), ("YBR_FULL", 0)])
def test_colour_images_of_scanners(tmp_path, kind, planar):
    pixels = pytest.importorskip("pydicom.pixels")
    colours = np.stack([LINES * 200, 200 - LINES * 200, LINES * 0 + 90], axis=-1).astype(np.uint8)
    stored = colours if kind == "RGB" else pixels.convert_color_space(colours, "RGB", kind)
    more = {
        "SamplesPerPixel": 3,
        "PhotometricInterpretation": kind,
        "PlanarConfiguration": planar,
        "BitsAllocated": 8,
        "BitsStored": 8,
        "HighBit": 7,
        "PixelData": (stored.transpose(2, 0, 1) if planar else stored).tobytes(),
    }
    write_dicom(tmp_path, [LINES], name="one", **more)
    one = next((tmp_path / "one").iterdir())
    with pytest.raises(
        InvalidInputError,
        match=r"choice of one channel \(--channel\), got 3: 1 \(red\), 2 \(green\), 3 \(blue\)",
    ):
        read_map(one)
    np.testing.assert_array_equal(read_map(one, channel="red", level=100).free, FREE)
    np.testing.assert_array_equal(read_map(one, channel=2, level=100).free, ~FREE)
    write_dicom(tmp_path, [LINES, LINES], name="several", **more)
    # seen from the front
    assert read_map(tmp_path / "several", channel="red", level=100).shape == (20, 2, 30)
    with pytest.raises(InvalidInputError, match=r"channel: expected one of 1 \(red\), .*, got 4"):
        read_map(one, channel=4)
    write_dicom(tmp_path, [LINES], name="grey")
    with pytest.raises(
        InvalidInputError,
        match="channel: expected no channel for a file without channels, got 1",
    ):
        read_map(next((tmp_path / "grey").iterdir()), channel=1)


def nrrd_bytes(*more, dimension=2, kind="uchar"):
    head = [
        "NRRD0004",
        f"type: {kind}",
        f"dimension: {dimension}",
        "sizes: 4 4",
        "encoding: raw",
        *more,
    ]
    return ("\n".join(head) + "\n\n").encode() + bytes([1] * 64)


def matlab_bytes(name, value):
    from scipy.io import savemat

    written = io.BytesIO()
    savemat(written, {name: value})
    return written.getvalue()


# Strange files, and a word of the one sentence that says what is wrong
STRANGE = {
    "skipped.nrrd": (
        lambda: nrrd_bytes("line skip: 999999999999"),
        "expected 999999999999 lines before the data, got fewer",
    ),
    "dimensions.nrrd": (lambda: nrrd_bytes(dimension=999999), "expected 999999 sizes, got 2"),
    "order.nrrd": (
        lambda: nrrd_bytes("endian: middle", kind="short"),
        "endian: expected little or big, got 'middle'",
    ),
    "report.dcm": (
        lambda: bytes(128) + b"DICM",
        "expected a DICOM image, got a DICOM file without rows and columns",
    ),
    "cells.mat": (
        lambda: matlab_bytes("m", np.array([LINES, 1], dtype=object)),
        r"got m 1x2 \(cell\)",
    ),
    "four.mat": (
        lambda: matlab_bytes("m", np.ones((2, 2, 2, 2))),
        r"in 2 or 3 dimensions, got m 2x2x2x2 \(double\)",
    ),
    "underscore.csv": (lambda: b"1_0,0\n0,0\n", "line 1, column 1: expected 0 or 1, got '1_0'"),
}


@pytest.mark.parametrize("name", STRANGE)
def test_strange_files_get_one_sentence(tmp_path, name):
    made, words = STRANGE[name]
    (tmp_path / name).write_bytes(made())
    with pytest.raises(InvalidInputError, match=words) as refused:
        read_map(tmp_path / name)
    assert "\n" not in str(refused.value)


def test_the_size_of_a_film_is_checked_before_its_frames_are_decoded(tmp_path):
    from shoal.swarm.maps.pictures import read_pixels

    head = b"GIF89a" + bytes([255] * 4) + b"\xf0\0\0" + bytes(6)
    frame = b"," + bytes(4) + bytes([255] * 4) + b"\0\x02\x02\x4c\x01\0"
    (tmp_path / "large.gif").write_bytes(head + frame + frame + b";")
    for read in (read_map, read_pixels):
        with pytest.raises(
            InvalidInputError, match="expected at most 268435456 cells, got 65535x65535"
        ):
            read(tmp_path / "large.gif")


def test_a_compression_that_no_library_knows_is_no_damage(tmp_path):
    import struct

    tags = [
        (256, 4, 5),
        (257, 4, 5),
        (258, 3, 8),
        (259, 3, 34712),
        (262, 3, 1),
        (273, 4, 200),
        (277, 3, 1),
        (278, 4, 5),
        (279, 4, 25),
    ]
    entries = b"".join(struct.pack("<HHII", tag, size, 1, value) for tag, size, value in tags)
    (tmp_path / "map.tif").write_bytes(
        struct.pack("<2sHIH", b"II", 42, 8, len(tags)) + entries + bytes(200)
    )
    with pytest.raises(
        InvalidInputError, match="got another compression together with numbers that need tifffile"
    ):
        read_map(tmp_path / "map.tif")


# Memory: about the size of the map, whatever the numbers of the file


def nifti_bytes(values):
    nibabel = pytest.importorskip("nibabel")
    return gzip.compress(nibabel.Nifti1Image(values, np.eye(4)).to_bytes(), 1)


@pytest.mark.parametrize(
    "name", ["map.npy", "fortran.npy", "map.nii.gz", "map.png", "map.tif", "map.csv"]
)
def test_reading_needs_about_the_memory_of_the_map(tmp_path, monkeypatch, name):
    import tracemalloc

    from shoal.swarm.maps import pages as reader
    from shoal.swarm.maps import text as arrays
    from shoal.swarm.maps import values, volumes

    for module in (arrays, reader, values, volumes):
        monkeypatch.setattr(module, "PIECE", 1 << 14)
    path = tmp_path / name
    cells = np.zeros((64, 128, 256))
    cells[5, 5:60] = 1
    if name == "map.tif":
        pages = [Image.fromarray(layer.astype(np.uint16) * np.uint16(65535)) for layer in cells]
        pages[0].save(path, save_all=True, append_images=pages[1:])
    elif name == "map.png":
        Image.fromarray(
            np.repeat(cells.reshape(-1, 256, 1) * 255, 3, axis=2).astype(np.uint8)
        ).save(path)
    elif name == "map.csv":
        path.write_text(
            "\n".join(
                ",".join("1" if one else "0" for one in row) for row in cells.reshape(-1, 256)
            )
        )
    elif name == "map.nii.gz":
        path.write_bytes(nifti_bytes(cells))
    else:
        np.save(path, np.asfortranarray(cells) if name == "fortran.npy" else cells)
    read_map(path)  # imports
    tracemalloc.start()
    try:
        read_map(path)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    text = path.stat().st_size if name == "map.csv" else 0
    assert peak < 3 * cells.size + 4 * text + 2_000_000
    assert peak < 8 * cells.size or text  # the size of its floats


def test_data_are_measured_before_they_are_unfolded(tmp_path):
    nibabel = pytest.importorskip("nibabel")
    header = nibabel.Nifti1Header()
    header.set_data_shape((640, 640, 640))
    header.set_data_dtype(np.float64)
    header["vox_offset"], header["magic"] = 352, b"n+1"
    (tmp_path / "large.nii.gz").write_bytes(gzip.compress(header.binaryblock + bytes(4)))
    with pytest.raises(
        InvalidInputError, match="expected at most 1073741824 bytes of data, got 2097152000"
    ):
        read_map(tmp_path / "large.nii.gz")
    head = b"\x93NUMPY\x01\x00" + (118).to_bytes(2, "little")
    head += (
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (16384, 16384), }".ljust(117) + b"\n"
    )
    (tmp_path / "large.npy").write_bytes(head + bytes(99))
    with pytest.raises(
        InvalidInputError, match="expected at most 1073741824 bytes of data, got 2147483648"
    ):
        read_map(tmp_path / "large.npy")
    savemat(tmp_path / "small.mat", {"a": LINES})
    assert read_map(tmp_path / "small.mat").shape == (20, 30)


def test_commands_show_what_is_said_about_a_file(tmp_path):
    """Commands silence libraries while they open a map, but not the notices about it. A process of
    its own has a real stderr.
    """
    import subprocess
    import sys

    Image.fromarray(LINES).save(tmp_path / "mask.png")
    done = subprocess.run(
        [sys.executable, "-m", "shoal", "maps", str(tmp_path / "mask.png")],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "the picture has two brightnesses, 0 and 1 of 255" in done.stderr
    assert "20 rows × 30 columns" in done.stdout
