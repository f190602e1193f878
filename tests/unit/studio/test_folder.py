"""The folder: no name leads out, nothing large is decoded, what is brought is whole or
not there.
"""

from __future__ import annotations

import asyncio
import os
import struct
import zlib

import pytest
from tests.soak import often

from shoal.core.errors import InvalidInputError
from shoal.studio.folder import MOST_LISTED, Folder, check_pixels

MANY = often(2_000, 10_000)


def png_header(width, height):
    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    header = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b"\0" * 800))
        + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize(
    "name",
    [
        "../x.png",
        "/etc/passwd",
        "a/../../x",
        ".studio.sqlite",
        "a/.hidden",
        "",
        "x\0.png",
        "..\\x.png",
        "link",
        "loop/x",
        "out/x.png",
        "x" * 600,
    ],
)
def test_names_that_lead_out_are_refused(tmp_path, name):
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "link").symlink_to(tmp_path / "secret")
    (inside / "out").symlink_to(tmp_path)
    (inside / "loop").symlink_to(inside / "loop")
    with pytest.raises(InvalidInputError, match="expected a name inside the folder"):
        Folder(inside).path(name)


def test_files_outside_are_not_listed(tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "secret.png").write_bytes(b"x")
    (inside / "link.png").symlink_to(tmp_path / "secret.png")
    (inside / ".hidden.png").write_bytes(b"x")
    (inside / "a.png").write_bytes(b"x")
    (inside / "notes.docx").write_bytes(b"x")
    assert [file["name"] for file in Folder(inside).files()] == ["a.png"]


async def pieces(*given):
    for piece in given:
        yield piece


def brought(folder, name, *given):
    return asyncio.run(Folder(folder).take(name, pieces(*given)))


def test_a_picture_of_3600_megapixels_in_a_kilobyte_is_refused_and_not_kept(tmp_path):
    data = png_header(60_000, 60_000)
    assert len(data) < 1024
    with pytest.raises(InvalidInputError, match="at most 50 megapixels, got 60000 x 60000"):
        brought(tmp_path, "bomb.png", data)
    (tmp_path / "there.png").write_bytes(data)
    with pytest.raises(InvalidInputError, match="megapixels"):
        Folder(tmp_path).check_fields({"map": "there.png"})
    assert [path.name for path in tmp_path.iterdir()] == ["there.png"]


@pytest.mark.parametrize("name", ["page.html.exe", "a", "code.py", "x.zip/../../y", "<b>.js"])
def test_only_files_of_shoal_are_taken(tmp_path, name):
    with pytest.raises(InvalidInputError, match="expected one of"):
        brought(tmp_path, name, b"x")
    assert list(tmp_path.iterdir()) == []


def test_what_is_brought_keeps_its_name_and_replaces_nothing(tmp_path):
    assert brought(tmp_path, "a map.txt", b"..", b"#") == "a-map.txt"
    assert brought(tmp_path, "../../a map.txt", b"##") == "a-map-2.txt"
    assert (tmp_path / "a-map.txt").read_bytes() == b"..#"
    assert (
        brought(tmp_path, "<img src=x onerror=alert(1)>.csv", b"1")
        == "img-src-x-onerror-alert-1.csv"
    )


def test_a_file_that_stops_coming_is_not_kept(tmp_path):
    async def broken():
        yield b"x"
        raise ConnectionError

    with pytest.raises(OSError, match=r"cannot write|"):
        asyncio.run(Folder(tmp_path).take("a.txt", broken()))
    assert list(tmp_path.iterdir()) == []


def test_a_damaged_picture_is_refused(tmp_path):
    (tmp_path / "a.png").write_bytes(b"no picture")
    with pytest.raises(InvalidInputError, match="damaged or other file"):
        check_pixels(tmp_path / "a.png")


def test_of_thousands_of_files_the_newest_are_listed_and_all_are_reached(tmp_path):
    (tmp_path / "inside").mkdir()
    (tmp_path / "a.npz").write_bytes(b"x")
    for k in range(MANY):
        os.link(tmp_path / "a.npz", tmp_path / f"episode-{k:05d}.npz")
    os.utime(tmp_path / "a.npz", (1, 1))
    for name, time in (
        ("newest.npz", 9e9),
        ("inside/second.npz", 8e9),
        ("old.png", 0),
        ("old.sqlite", 0),
    ):
        (tmp_path / name).write_bytes(b"x")
        os.utime(tmp_path / name, (time, time))
    folder = Folder(tmp_path)
    told = folder.list_files()
    assert told["counts"] == {"episode": MANY + 3, "map": 1, "store": 1}
    names = [file["name"] for file in told["files"]]
    assert names[:2] == ["newest.npz", "inside/second.npz"]
    assert {"old.png", "old.sqlite"} <= {*names}  # many episodes leave nothing else out
    assert len(names) == MOST_LISTED + 2
    reached = [
        file["name"]
        for skip in range(0, MANY + 3, MOST_LISTED)
        for file in folder.list_files("episode", after=skip)["files"]
    ]
    assert len(reached) == len({*reached}) == MANY + 3
    found = folder.list_files("episode", name="EPISODE-01234")
    assert ([file["name"] for file in found["files"]], found["counts"]) == (
        ["episode-01234.npz"],
        {"episode": 1},
    )
    assert len(folder.files()) == MANY + 5
