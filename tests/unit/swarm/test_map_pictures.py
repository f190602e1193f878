"""Pictures whose numbers are not what a picture library returns: palettes, few bits, films, packed
numbers, and mixed masks.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin

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
    picture.putpalette(
        [
            part
            for colour in colours
            for part in (colour if isinstance(colour, tuple) else (colour,) * 3)
        ]
    )
    return picture


def test_a_label_is_an_entry_of_the_palette_on_all_slices(tmp_path, said):
    colours = [0, 255, (255, 0, 0), 90]
    # the second shows greys only
    slices = [RANDOM.integers(0, 4, (6, 9)), RANDOM.integers(0, 2, (6, 9))]
    pages = [with_palette(one, colours) for one in slices]
    folder = tmp_path / "slices"
    folder.mkdir()
    for number, page in enumerate(pages):
        page.save(folder / f"{number}.png")
    # Pillow keeps the settings of the last format in a picture
    pages = [with_palette(one, colours) for one in slices]
    pages[0].save(tmp_path / "slices.tif", save_all=True, append_images=pages[1:])
    for label in range(4):
        for place in (folder, tmp_path / "slices.tif"):
            np.testing.assert_array_equal(
                read_map(place, label=label).free, np.array(slices) == label
            )
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
        np.testing.assert_array_equal(
            read_map(tmp_path / "greys.gif", label=label).free, greys == label
        )
    entries = RANDOM.integers(0, 3, (6, 9))
    with_palette(entries, [(1, 2, 3), 0, 255]).save(tmp_path / "colours.gif")
    with Image.open(tmp_path / "colours.gif") as picture:
        stored = np.array(picture)
    np.testing.assert_array_equal(read_map(tmp_path / "colours.gif", label=1).free, stored == 1)


def bmp(entries, bits, greys):
    height, width = entries.shape
    rows = [
        np.packbits((row[:, None] >> np.arange(bits)[::-1] & 1).astype(np.uint8)).tobytes()
        for row in entries[::-1]
    ]
    data = b"".join(row + bytes(-len(row) % 4) for row in rows)
    palette = b"".join(bytes([grey] * 3 + [0]) for grey in greys)
    info = struct.pack(
        "<IiiHHIIiiII", 40, width, height, 1, bits, 0, len(data), 0, 0, len(greys), 0
    )
    begin = 14 + len(info) + len(palette)
    return struct.pack("<2sIII", b"BM", begin + len(data), 0, begin) + info + palette + data


@pytest.mark.parametrize(
    ("bits", "greys"),
    [(1, (0, 255)), (4, (0, 255)), (8, (0, 255)), (4, range(16)), (8, range(256))],
)
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
        return (
            struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        )

    height, width = values.shape
    rows = [
        np.packbits((row[:, None] >> np.arange(bits)[::-1] & 1).astype(np.uint8)).tobytes()
        for row in values
    ]
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
        np.testing.assert_array_equal(
            read_map(tmp_path / "grey.png", level=number).free, values >= number
        )
    label = int(values[3, 4])
    np.testing.assert_array_equal(
        read_map(tmp_path / "grey.png", label=label).free, values == label
    )
    np.testing.assert_array_equal(
        read_map(tmp_path / "grey.png", channel="alpha").free, values != values.dtype.type(nothing)
    )
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
    with pytest.raises(
        InvalidInputError, match=r"expected the choice of one frame \(--frame\), got 3"
    ):
        read_map(tmp_path / f"film{suffix}")
    for number, frame in enumerate(frames, start=1):
        np.testing.assert_array_equal(
            read_map(tmp_path / f"film{suffix}", frame=number).free, frame
        )
    with pytest.raises(InvalidInputError, match="frame: expected one of 1, 2, 3, got 4"):
        read_map(tmp_path / f"film{suffix}", frame=4)


def packed_tiff(values, bits, *, photometric=1, order="<", compression=1, strip=5, fill=1):
    def packed(row):
        numbers = (row[:, None] >> np.arange(bits)[::-1] & 1).astype(np.uint8)
        return np.packbits(numbers, bitorder="little" if fill == 2 else "big").tobytes()

    height, width = values.shape
    strips = [
        b"".join(packed(row) for row in values[first : first + strip])
        for first in range(0, height, strip)
    ]
    strips = [zlib.compress(one) if compression == 8 else one for one in strips]
    offsets = np.cumsum([8, *map(len, strips)])[:-1].tolist()
    data = b"".join(strips)
    data += bytes(len(data) % 2)
    place = 8 + len(data)
    lists = struct.pack(f"{order}{2 * len(strips)}I", *offsets, *map(len, strips))
    entries = [
        (256, 1, width),
        (257, 1, height),
        (258, 1, bits),
        (259, 1, compression),
        (262, 1, photometric),
        (266, 1, fill),
        (273, len(strips), place),
        (277, 1, 1),
        (278, 1, strip),
        (279, len(strips), place + 4 * len(strips)),
    ]
    header = struct.pack(f"{order}2sHI", b"II" if order == "<" else b"MM", 42, place + len(lists))
    told = b"".join(
        struct.pack(f"{order}HHII", tag, 4, count, value) for tag, count, value in entries
    )
    return header + data + lists + struct.pack(f"{order}H", len(entries)) + told + bytes(4)


@pytest.mark.parametrize("bits", [2, 4, 6, 10, 12, 14])
@pytest.mark.parametrize(
    "more", [{}, {"photometric": 0}, {"order": ">", "compression": 8}, {"fill": 2}, {"strip": 7}]
)
def test_tiff_numbers_of_odd_bits(tmp_path, bits, more):
    pytest.importorskip("tifffile")
    values = RANDOM.integers(0, 2**bits, (12, 19))
    values[0, :2] = 0, 2**bits - 1
    (tmp_path / "packed.tif").write_bytes(packed_tiff(values, bits, **more))
    half = 2 ** (bits - 1)
    np.testing.assert_array_equal(
        read_map(tmp_path / "packed.tif", level=half).free, values >= half
    )
    np.testing.assert_array_equal(
        read_map(tmp_path / "packed.tif", label=int(values[3, 4])).free, values == values[3, 4]
    )
    bright = values < half if more.get("photometric") == 0 else values >= half
    np.testing.assert_array_equal(read_map(tmp_path / "packed.tif").free, bright)


def test_tiff_numbers_of_24_bits(tmp_path):
    pytest.importorskip("tifffile")
    values = RANDOM.integers(0, 2**24, (12, 19))
    (tmp_path / "wide.tif").write_bytes(packed_tiff(values, 24, order=">"))
    np.testing.assert_array_equal(
        read_map(tmp_path / "wide.tif", level=2**23).free, values >= 2**23
    )
    (tmp_path / "wide.tif").write_bytes(packed_tiff(values, 24))
    with pytest.raises(
        InvalidInputError,
        match="got 24 bits in the order of bytes II, which programs read in different orders",
    ):
        read_map(tmp_path / "wide.tif", level=2**23)
    (tmp_path / "short.tif").write_bytes(packed_tiff(values % 64, 6)[:60])
    with pytest.raises(InvalidInputError, match="damaged or truncated"):
        read_map(tmp_path / "short.tif")


def test_notices_about_min_is_white_name_the_numbers_of_the_file(tmp_path, said):
    """The notices once named brightnesses that `label` refuses, and said that white is free."""
    tifffile = pytest.importorskip("tifffile")
    path = tmp_path / "mask.tif"
    lines = RANDOM.random((12, 19)) < 0.4
    tifffile.imwrite(path, np.where(lines, 4095, 0).astype("u2"), photometric="miniswhite")
    for invert, label in ((False, 0), (True, 4095)):
        said.clear()
        free = read_map(path, invert=invert).free
        np.testing.assert_array_equal(free, read_map(path, label=label).free)
        mask, polarity = said[:2]
        assert f"two brightnesses, 0 and 4095 of 65535; it is read as a mask, in which {label}" in (
            mask
        )
        assert ("white is free" in polarity) == (not invert)
        assert "large numbers as free" in polarity
    pages = [np.where(lines, 65535, number).astype("u2") for number in (60000, 61000)]
    tifffile.imwrite(path, np.stack(pages), photometric="miniswhite")
    said.clear()
    np.testing.assert_array_equal(read_map(path).free, [~lines, ~lines])
    assert "two brightnesses, 65535 and one" in said[0]
    assert "every brightness below 65535 is free" in said[0]
    tifffile.imwrite(path, RANDOM.integers(50000, 60001, (9, 9)).astype("u2") | 1, photometric=0)
    with pytest.raises(InvalidInputError, match=r"\(32767 of 65535\), got values from 5.* to 5"):
        read_map(path)


def test_notices_about_negative_numbers_name_no_white(tmp_path, said):
    """A picture of -3 and -0.5 was once said to be "of 1e-30"."""
    tifffile = pytest.importorskip("tifffile")
    path = tmp_path / "negative.tif"
    values = np.where(np.eye(7, dtype=bool), -0.5, -3).astype("f4")
    tifffile.imwrite(path, values)
    np.testing.assert_array_equal(read_map(path).free, values == -0.5)
    assert "two brightnesses, -3 and -0.5; it is read as a mask, in which -0.5 is free" in said[0]
    values[0, 1] = -2
    tifffile.imwrite(path, values)
    assert read_map(path, invert=True).free.all()
    assert "from -3 to -0.5 have no white of their own; 0 or less is free" in said[1]


@pytest.mark.parametrize("dtype", ["i1", "i2", "i4", "u4", "f2", "f4", "f8"])
@pytest.mark.parametrize("low", [0, 3])
def test_min_is_white_in_masks_without_a_number_of_white(tmp_path, said, dtype, low):
    tifffile = pytest.importorskip("tifffile")
    free = RANDOM.random((12, 19)) < 0.4
    path = tmp_path / "mask.tif"
    tifffile.imwrite(path, np.where(free, 5, low).astype(dtype), photometric="miniswhite")
    np.testing.assert_array_equal(read_map(path).free, ~free)
    assert any("MinIsWhite" in text for text in said)
    np.testing.assert_array_equal(read_map(path, invert=True).free, free)
    np.testing.assert_array_equal(read_map(path, label=5).free, free)
    if dtype[0] == "f":
        values = np.where(free, 5, low).astype(dtype)
        values[0, :3] = np.nan
        tifffile.imwrite(path, values, photometric="miniswhite")
        assert not read_map(path).free[0, :3].any()
        assert not read_map(path, invert=True).free[0, :3].any()
    tifffile.imwrite(
        path, RANDOM.permutation(12 * 19).reshape(12, 19).astype("i4"), photometric="miniswhite"
    )
    with pytest.raises(
        InvalidInputError, match="expected a mask of two numbers, or a known number of white"
    ):
        read_map(path)


@pytest.mark.parametrize("kind", ["folder", "pages"])
def test_masks_of_one_stack_may_have_different_numbers(tmp_path, said, kind):
    free = RANDOM.random((4, 12, 19)) < 0.4
    free[2], free[3] = False, True
    tops = np.array([255, 1, 1, 200], dtype=np.uint8)
    pages = [Image.fromarray(one * top) for one, top in zip(free, tops, strict=True)]
    path = tmp_path / ("masks" if kind == "folder" else "masks.tif")
    if kind == "folder":
        path.mkdir()
        for number, page in enumerate(pages):
            page.save(path / f"{number}.png")
    else:
        pages[0].save(path, save_all=True, append_images=pages[1:])
    np.testing.assert_array_equal(read_map(path).free, free)
    assert (
        len(
            [
                text
                for text in said
                if "each picture has at most two brightnesses, 0 and one that differs" in text
            ]
        )
        == 1
    )
    np.testing.assert_array_equal(read_map(path, invert=True).free, ~free)
    np.testing.assert_array_equal(
        read_map(path, threshold=0.5).free, free & (tops > 127)[:, None, None]
    )
    np.testing.assert_array_equal(read_map(path, label=1).free, free & (tops == 1)[:, None, None])


def test_grey_pictures_of_a_stack_are_no_masks(tmp_path, said):
    folder = tmp_path / "greys"
    folder.mkdir()
    greys = RANDOM.integers(0, 256, (2, 12, 19)).astype(np.uint8)
    greys[1] = np.where(greys[1] > 100, 1, 0)  # one of the two pictures has many values
    for number, grey in enumerate(greys):
        Image.fromarray(grey).save(folder / f"{number}.png")
    np.testing.assert_array_equal(read_map(folder).free, greys > 127)
    assert not any("read as masks" in text for text in said)


def test_notices_and_refusals_are_short_and_count_well(tmp_path, said):
    values = np.array([[0, 1, 1], [0, 1, np.nan]])
    np.save(tmp_path / "values.npy", values)
    read_map(tmp_path / "values.npy")
    assert any(
        "values.npy: 1 cell has no number (NaN) and counts as not free" in text for text in said
    )
    for invert in (False, True):
        with pytest.raises(InvalidInputError) as refused:
            read_map(tmp_path / "values.npy", label=int("9" * 400), invert=invert)
        assert len(str(refused.value).replace(str(tmp_path), "")) < 200


def of_gdal(path, numbers, *, way, metadata="", no_data=None):
    """Write a TIFF with notes of GDAL, read by Pillow or by tifffile."""
    if way == "tifffile":
        pytest.importorskip("tifffile").imwrite(
            path,
            numbers,
            metadata=None,
            extratags=[
                (number, 2, None, text)
                for number, text in ((42112, metadata), (42113, no_data))
                if text
            ],
        )
        return
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    for number, text in ((42112, metadata), (42113, no_data)):
        if text:
            tags[number], tags.tagtype[number] = text, 2
    Image.fromarray(numbers).save(path, tiffinfo=tags)


WAYS = [("Pillow", np.uint8), ("Pillow", np.float32), ("tifffile", np.float64)]


@pytest.mark.parametrize(("way", "dtype"), WAYS)
def test_a_scale_or_an_offset_of_gdal_is_refused(tmp_path, way, dtype):
    path, numbers = tmp_path / "map.tif", np.where(np.arange(20).reshape(4, 5) > 8, 40, 0)
    items = '<Item name="{0}" sample="0" role="{1}">{2}</Item>'
    for role, number, got in (
        ("scale", "0.1", "the scale 0.1 in"),
        ("scale", "-1", "the scale -1 in"),
        ("offset", "5", "the offset 5 in"),
        ("scale", "many", "'many'"),
    ):
        notes = f"<GDALMetadata>{items.format(role.upper(), role, number)}</GDALMetadata>"
        of_gdal(path, numbers.astype(dtype), way=way, metadata=notes)
        with pytest.raises(InvalidInputError, match=rf"map.tif: expected .*, got {got}"):
            read_map(path, level=30)
    notes = items.format("SCALE", "scale", "1.0") + items.format("OFFSET", "offset", "0")
    of_gdal(path, numbers.astype(dtype), way=way, metadata=f"<GDALMetadata>{notes}</GDALMetadata>")
    np.testing.assert_array_equal(read_map(path, level=30).free, numbers == 40)
    beside = tmp_path / "map.tif.aux.xml"
    beside.write_text("<PAMDataset><PAMRasterBand><Scale>2</Scale></PAMRasterBand></PAMDataset>")
    with pytest.raises(InvalidInputError, match="got the scale 2 in the notes of GDAL"):
        read_map(path, level=30)


def test_long_notes_of_gdal_take_no_longer_than_their_length(tmp_path):
    """Items that never end took hours: the time grew with the square of the length."""
    path, numbers = tmp_path / "map.tif", np.repeat([[0, 40]], 4, axis=0).astype(np.uint8)
    of_gdal(path, numbers, way="Pillow", metadata="<GDALMetadata>" + "<Item " * 300_000)
    with pytest.raises(
        InvalidInputError, match=r"map.tif: expected what GDAL notes .*, got a text"
    ):
        read_map(path, level=30)


@pytest.mark.parametrize(("way", "dtype"), WAYS)
@pytest.mark.parametrize("inside", [True, False])
def test_the_missing_number_of_gdal_is_not_free(tmp_path, said, way, dtype, inside):
    path, numbers = tmp_path / "map.tif", RANDOM.permutation(np.repeat([0, 1, 255], 8))
    numbers = numbers.reshape(4, 6).astype(dtype)
    of_gdal(path, numbers, way=way, no_data="255" if inside else None)
    if not inside:
        text = (
            "<PAMDataset><PAMRasterBand><NoDataValue>255</NoDataValue></PAMRasterBand></PAMDataset>"
        )
        (tmp_path / "map.tif.aux.xml").write_text(text)
    np.testing.assert_array_equal(read_map(path).free, numbers == 1)
    assert any("8 cells have no number (NaN) and count as not free" in text for text in said)
    np.testing.assert_array_equal(read_map(path, invert=True).free, numbers == 0)
    np.testing.assert_array_equal(read_map(path, level=1).free, numbers == 1)


def test_masks_whose_missing_number_is_0_are_masks(tmp_path, said):
    numbers = RANDOM.integers(0, 2, (4, 6)).astype(np.uint8)
    of_gdal(tmp_path / "map.tif", numbers, way="Pillow", no_data="0")
    np.testing.assert_array_equal(read_map(tmp_path / "map.tif").free, numbers == 1)
    np.testing.assert_array_equal(read_map(tmp_path / "map.tif", invert=True).free, numbers == 0)
    assert not any("NaN" in text for text in said)
