"""Pictures whose numbers are not what a picture library returns: palettes, few bits, films, packed numbers, and mixed masks."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from shoal.core import notices
from shoal.core.errors import InvalidInputError
from shoal.swarm.maps.files import read_map

RANDOM = np.random.default_rng(7)


@pytest.fixture
def said(monkeypatch):
    """The notices of a test."""
    heard = []
    monkeypatch.setattr(notices, "listeners", [heard.append])
    monkeypatch.setattr(notices, "_told", set())
    return heard


def with_palette(entries, colours):
    picture = Image.fromarray(entries.astype(np.uint8), mode="P")
    picture.putpalette([part for colour in colours for part in (colour if isinstance(colour, tuple) else (colour,) * 3)])
    return picture


def test_a_label_is_an_entry_of_the_palette_on_all_slices(tmp_path, said):
    colours = [0, 255, (255, 0, 0), 90]
    slices = [RANDOM.integers(0, 4, (6, 9)), RANDOM.integers(0, 2, (6, 9))]  # the second shows greys only
    pages = [with_palette(one, colours) for one in slices]
    folder = tmp_path / "slices"
    folder.mkdir()
    for number, page in enumerate(pages):
        page.save(folder / f"{number}.png")
    pages = [with_palette(one, colours) for one in slices]  # Pillow keeps the settings of the last format in a picture
    pages[0].save(tmp_path / "slices.tif", save_all=True, append_images=pages[1:])
    for label in range(4):
        for place in (folder, tmp_path / "slices.tif"):
            np.testing.assert_array_equal(read_map(place, label=label).free, np.array(slices) == label)
    assert any("the labels are the entries of the palette" in text for text in said)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp"])
@pytest.mark.parametrize("greys", [(0, 2, 1), (0, 200, 100), (0, 255, 255)])
def test_entries_and_greys_of_a_palette_are_two_things(tmp_path, said, suffix, greys):
    entries = RANDOM.integers(0, 3, (6, 9))
    path = tmp_path / f"greys{suffix}"
    with_palette(entries, greys).save(path)
    for label in range(3):
        np.testing.assert_array_equal(read_map(path, label=label).free, entries == label)
    np.testing.assert_array_equal(read_map(path, level=2).free, np.array(greys)[entries] >= 2)
    assert any("the levels are the greys of the palette" in text for text in said)


def test_a_gif_of_greys_is_a_grey_picture(tmp_path):
    greys = np.array([0, 7, 40])[RANDOM.integers(0, 3, (6, 9))]
    Image.fromarray(greys.astype(np.uint8)).save(tmp_path / "greys.gif")
    for label in (0, 7, 40):
        np.testing.assert_array_equal(read_map(tmp_path / "greys.gif", label=label).free, greys == label)
    entries = RANDOM.integers(0, 3, (6, 9))
    with_palette(entries, [(1, 2, 3), 0, 255]).save(tmp_path / "colours.gif")
    with Image.open(tmp_path / "colours.gif") as picture:
        stored = np.array(picture)
    np.testing.assert_array_equal(read_map(tmp_path / "colours.gif", label=1).free, stored == 1)


def bmp(entries, bits, greys):
    height, width = entries.shape
    rows = [np.packbits((row[:, None] >> np.arange(bits)[::-1] & 1).astype(np.uint8)).tobytes() for row in entries[::-1]]
    data = b"".join(row + bytes(-len(row) % 4) for row in rows)
    palette = b"".join(bytes([grey] * 3 + [0]) for grey in greys)
    info = struct.pack("<IiiHHIIiiII", 40, width, height, 1, bits, 0, len(data), 0, 0, len(greys), 0)
    begin = 14 + len(info) + len(palette)
    return struct.pack("<2sIII", b"BM", begin + len(data), 0, begin) + info + palette + data


@pytest.mark.parametrize(("bits", "greys"), [(1, (0, 255)), (4, (0, 255)), (8, (0, 255)), (4, range(16)), (8, range(256))])
def test_bmp_files_of_greys(tmp_path, bits, greys):
    entries = RANDOM.integers(0, len(greys), (6, 9))
    entries[0, :2] = 1, len(greys) - 1
    (tmp_path / "greys.bmp").write_bytes(bmp(entries, bits, greys))
    np.testing.assert_array_equal(read_map(tmp_path / "greys.bmp", label=1).free, entries == 1)
    if len(greys) == 2:
        np.testing.assert_array_equal(read_map(tmp_path / "greys.bmp").free, entries == 1)
    else:
        np.testing.assert_array_equal(read_map(tmp_path / "greys.bmp", level=9).free, entries >= 9)


def png(values, bits, nothing):
    def chunk(name, data):
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    height, width = values.shape
    rows = [np.packbits((row[:, None] >> np.arange(bits)[::-1] & 1).astype(np.uint8)).tobytes() for row in values]
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0))
        + chunk(b"tRNS", struct.pack(">H", nothing))
        + chunk(b"IDAT", zlib.compress(b"".join(b"\0" + row for row in rows)))
        + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize("bits", [1, 2, 4, 8, 16])
@pytest.mark.parametrize("nothing", [0, 1])
def test_few_bits_with_a_transparent_number(tmp_path, bits, nothing):
    values = RANDOM.integers(0, 2**bits, (12, 18))
    values[0, :2] = 0, 2**bits - 1
    (tmp_path / "grey.png").write_bytes(png(values, bits, nothing))
    for number in (1, 2**bits // 2, 2**bits - 1):
        np.testing.assert_array_equal(read_map(tmp_path / "grey.png", level=number).free, values >= number)
    label = int(values[3, 4])
    np.testing.assert_array_equal(read_map(tmp_path / "grey.png", label=label).free, values == label)
    np.testing.assert_array_equal(read_map(tmp_path / "grey.png", channel="alpha").free, values != values.dtype.type(nothing))
    opaque = values[values != nothing] / (2**bits - 1)
    ground = 0.0 if (opaque >= 0.5).sum() > (opaque < 0.5).sum() else 1.0
    seen = np.where(values == nothing, ground, values / (2**bits - 1))
    assert bits == 1 or np.array_equal(read_map(tmp_path / "grey.png").free, seen >= 0.5)


@pytest.mark.parametrize("suffix", [".gif", ".png"])
def test_frames_of_films_contain_only_what_changes(tmp_path, suffix):
    base = np.zeros((20, 30), dtype=bool)
    base[3:9, 2:25] = base[8:17, 12] = True
    frames = [np.roll(base, shift, axis=1) for shift in range(3)]
    first, *others = [Image.fromarray(frame * np.uint8(255)) for frame in frames]
    first.save(tmp_path / f"film{suffix}", save_all=True, append_images=others)
    with pytest.raises(InvalidInputError, match=r"expected the choice of one frame \(--frame\), got 3"):
        read_map(tmp_path / f"film{suffix}")
    for number, frame in enumerate(frames, start=1):
        np.testing.assert_array_equal(read_map(tmp_path / f"film{suffix}", frame=number).free, frame)
    with pytest.raises(InvalidInputError, match="frame: expected one of 1, 2, 3, got 4"):
        read_map(tmp_path / f"film{suffix}", frame=4)
