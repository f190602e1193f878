"""Map tiles of the user's own: folders and PMTiles files."""

from __future__ import annotations

import gzip
import io
import resource

import numpy as np
import pytest
from PIL import Image
from pmtiles.tile import Compression, TileType, deserialize_header, serialize_header, zxy_to_tileid
from pmtiles.writer import Writer

from shoal.core.errors import InvalidInputError
from shoal.search.regions.projection import LocalFrame
from shoal.studio.answers import answer
from shoal.studio.folder import Folder
from shoal.studio.tiles import NO_TILE, tile, tiles

COLUMNS, ROWS, ZOOM = (8578, 8579), (5736, 5737), 14


def picture(colour: str, kind: str = "PNG") -> bytes:
    made = io.BytesIO()
    Image.new("RGB", (8, 8), colour).save(made, kind)
    return made.getvalue()


def write_folder(path, *, from_south: bool = False):
    for column in COLUMNS:
        for row in ROWS:
            number = 2**ZOOM - 1 - row if from_south else row
            file = path / str(ZOOM) / str(column) / f"{number}.png"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(picture(f"#{column % 256:02x}{row % 256:02x}00"))
    if from_south:
        (path / "tilemapresource.xml").write_text("<TileMap/>")


def write_archive(path, kind=TileType.PNG):
    header = {"tile_type": kind, "tile_compression": Compression.NONE, "version": 3}
    west, north, east, south = 8.5, 47.4, 8.52, 47.39
    for name, value in (("lon", west), ("lat", south)):
        header[f"min_{name}_e7"] = int(value * 1e7)
    for name, value in (("lon", east), ("lat", north)):
        header[f"max_{name}_e7"] = int(value * 1e7)
    header |= {"center_zoom": ZOOM, "center_lon_e7": 0, "center_lat_e7": 0}
    with path.open("wb") as file:
        writer = Writer(file)
        for row in ROWS:
            for column in COLUMNS:
                writer.write_tile(
                    zxy_to_tileid(ZOOM, column, row),
                    picture(f"#{column % 256:02x}{row % 256:02x}00"),
                )
        writer.finalize(header, {"attribution": "<a href='x'>&copy; Somebody</a>"})


def colour_of(given: tuple[bytes, str]) -> tuple[int, ...]:
    data, kind = given
    assert kind == "image/png"
    return Image.open(io.BytesIO(data)).convert("RGB").getpixel((0, 0))


@pytest.mark.parametrize("kind", ["folder", "from the south", "archive"])
def test_each_tile_is_where_its_name_says(tmp_path, kind):
    name = "town.pmtiles" if kind == "archive" else "maps/town"
    if kind == "archive":
        write_archive(tmp_path / name)
    else:
        write_folder(tmp_path / name, from_south=kind == "from the south")
    folder = Folder(tmp_path)
    about = tiles(folder, {"file": name})
    assert about["zooms"] == [ZOOM, ZOOM]
    if kind == "archive":
        assert about["bounds"] == [8.5, 47.39, 8.52, 47.4]
        assert about["attribution"] == "© Somebody"
    else:
        west, south, east, north = about["bounds"]
        columns, rows = np.array([west, east]), np.radians([north, south])
        scale = 2**ZOOM
        assert (columns + 180) / 360 * scale == pytest.approx([COLUMNS[0], COLUMNS[1] + 1])
        assert (1 - np.arcsinh(np.tan(rows)) / np.pi) / 2 * scale == pytest.approx(
            [ROWS[0], ROWS[1] + 1]
        )
    for column in COLUMNS:
        for row in ROWS:
            found = tile(folder, name, ZOOM, column, row)
            assert colour_of(found) == (column % 256, row % 256, 0)
    assert tile(folder, name, ZOOM, 3, 3) == (NO_TILE, "image/png")
    assert tile(folder, name, 2, 9, 9) == (NO_TILE, "image/png")
    assert Image.open(io.BytesIO(NO_TILE)).convert("RGBA").getpixel((0, 0))[3] == 0
    # the tiles are one thing in the list, and no maps
    assert [(one["name"], one["kind"]) for one in folder.files()] == [(name, "tiles")]


def test_tiles_that_are_none_are_said(tmp_path):
    folder = Folder(tmp_path)
    write_archive(tmp_path / "vector.pmtiles", TileType.MVT)
    write_archive(tmp_path / "whole.pmtiles")
    whole = (tmp_path / "whole.pmtiles").read_bytes()
    (tmp_path / "none.pmtiles").write_bytes(b"")
    (tmp_path / "other.pmtiles").write_bytes(b"PK" * 200)
    (tmp_path / "cut.pmtiles").write_bytes(whole[:140])
    (tmp_path / "2026/10").mkdir(parents=True)
    (tmp_path / "2026/10/3.png").write_bytes(picture("red"))
    for name in ("none", "other", "cut", "vector"):
        state, fault = answer(folder, "tiles", {"file": f"{name}.pmtiles"})
        assert state == "error", name
        assert name in fault["error"]
    assert "expected tiles that are pictures" in fault["error"]
    for name in ("2026", "nowhere"):
        with pytest.raises(InvalidInputError, match=r"expected a folder of z/x/y\.png"):
            tiles(folder, {"file": name})
    for name in ("../x", "nowhere", "cut.pmtiles"):
        with pytest.raises(InvalidInputError):
            tile(folder, name, ZOOM, COLUMNS[0], ROWS[0])
    assert "2026/10/3.png" in [one["name"] for one in folder.files()]


@pytest.mark.parametrize("piece", ["root", "metadata"])
def test_a_decompression_bomb_is_refused_before_it_is_unfolded(tmp_path, piece):
    """The library unfolds directories and the metadata without a limit."""
    path = tmp_path / "bomb.pmtiles"
    write_archive(path)
    header = deserialize_header(path.read_bytes()[:127])
    # a hundred members of 10 MB each, of which a whole would need memory here, too
    bomb = 100 * gzip.compress(bytes(10**7))
    header[f"{piece}_offset"], header[f"{piece}_length"] = path.stat().st_size, len(bomb)
    path.write_bytes(serialize_header(header) + path.read_bytes()[127:] + bomb)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    folder = Folder(tmp_path)
    with pytest.raises(InvalidInputError, match=r"bomb.pmtiles': expected .* at most 4194304"):
        _ = (
            tile(folder, "bomb.pmtiles", ZOOM, COLUMNS[0], ROWS[0])
            if piece == "root"
            else tiles(folder, {"file": "bomb.pmtiles"})
        )
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


@pytest.mark.parametrize("latitude", [0.0, 47.4, 70.0])
@pytest.mark.parametrize("zoom", [10, 14, 18])
def test_over_a_tile_the_projections_differ_by_little(latitude, zoom):
    """Why the canvas needs no library of maps: each tile is turned, stretched and shifted as its
    four corners say.
    """
    frame = LocalFrame(8.5, latitude)
    scale = 2.0**zoom

    def metres(columns, rows):
        lat = np.degrees(np.arctan(np.sinh(np.pi * (1 - 2 * rows / scale))))
        return frame.to_metres(np.column_stack([columns / scale * 360 - 180, lat]))

    # a tile about 20 km to the east and north of the place of the canvas
    east, north = frame.to_degrees([(20_000, 20_000)])[0]
    column = np.floor((east + 180) / 360 * scale)
    row = np.floor((1 - np.arcsinh(np.tan(np.radians(north))) / np.pi) / 2 * scale)
    across, down = (one.ravel() for one in np.meshgrid(*2 * [np.linspace(0, 1, 17)]))
    exact = metres(column + across, row + down)
    nw, ne, sw, se = metres(column + np.array([0, 1, 0, 1]), row + np.array([0, 0, 1, 1]))
    right, below = (ne - nw + se - sw) / 2, (sw - nw + se - ne) / 2
    drawn = (
        (nw + ne + sw + se) / 4 + (across - 0.5)[:, None] * right + (down - 0.5)[:, None] * below
    )
    pixel = np.linalg.norm(right) / 256
    assert np.linalg.norm(drawn - exact, axis=1).max() / pixel < MOST[zoom]


MOST = {10: 0.4, 14: 0.025, 18: 0.002}  # pixels of a tile
