"""Heights of the ground: files, and missions that keep their height above it."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, TiffImagePlugin
from pyproj import Transformer
from tests.missions import flight_of, missions_of
from tests.reference.flight import (
    bilinear,
    ground_speed,
    legs_of,
    seconds_of,
    usable_seconds,
    way_of_plan,
)
from tests.reference.missions import READERS

from shoal.cli import run
from shoal.core.errors import InvalidInputError
from shoal.missions import Mission, MissionOptions, MissionSet, lint, read_mission, write_missions
from shoal.missions.approach import clearance_of
from shoal.search import LocalFrame, SearchProblem
from shoal.search.flight import terrain as terrain_files
from shoal.search.flight.terrain import Terrain, open_grid, open_terrain
from shoal.search.flight.vehicle import vehicle_of

FRAME = LocalFrame(8.5, 47.4)
TO_UTM = Transformer.from_crs(4326, 32632, always_xy=True)
EAST, NORTH = TO_UTM.transform(8.5, 47.4)
CELL, SIDE = 25.0, 61
LANES = [(-500 + 1000 * (k // 2 % 2 != k % 2), -400 + 100 * (k // 2)) for k in range(18)]


def mountain():
    """Return heights of a rugged cone, first row southernmost."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:SIDE, :SIDE] - SIDE // 2
    return np.maximum(900 - 14.0 * np.hypot(x, y), 500) + rng.uniform(-6, 6, (SIDE, SIDE))


def write_geotiff(
    path,
    heights,
    *,
    code=32632,
    no_data=None,
    model=1,
    points=False,
    cell=CELL,
    corner=None,
    **more,
):
    """Write heights, first row southernmost, with the tags of a GeoTIFF."""
    tags = TiffImagePlugin.ImageFileDirectory_v2()
    half = CELL / 2
    west, north = corner or (
        EAST - SIDE // 2 * CELL - (0 if points else half),
        NORTH + SIDE // 2 * CELL + (0 if points else half),
    )
    tags[33550], tags.tagtype[33550] = (cell, cell, 0.0), 12
    tags[33922], tags.tagtype[33922] = (0.0, 0.0, 0.0, west, north, 0.0), 12
    keys = [
        (1024, model),
        (1025, 2 if points else 1),
        *([(3072 if model == 1 else 2048, code)] if code else []),
        *more.get("keys", []),
    ]
    tags[34735], tags.tagtype[34735] = (
        (1, 1, 0, len(keys), *(value for key, number in keys for value in (key, 0, 1, number))),
        3,
    )
    if no_data is not None:
        tags[42113] = str(no_data)
    if "notes" in more:
        tags[42112], tags.tagtype[42112] = more["notes"], 2
    for tag in more.get("without", ()):
        del tags[tag]
    Image.fromarray(np.asarray(heights, dtype=np.float32)[::-1]).save(
        path, tiffinfo=tags, compression="tiff_deflate"
    )


def height_there(grid, longitude, latitude):
    """Return the height of the ground as other code has it."""
    x, y = TO_UTM.transform(longitude, latitude)
    return bilinear(grid, (x - EAST) / CELL + SIDE // 2, (y - NORTH) / CELL + SIDE // 2)


@pytest.fixture(scope="module")
def hills(tmp_path_factory):
    path = tmp_path_factory.mktemp("hills") / "hills.tif"
    grid = np.asarray(mountain(), dtype=np.float32).astype(float)
    write_geotiff(path, grid)
    return path, grid.tolist()


@pytest.mark.parametrize(
    ("vehicle", "error"),
    [
        ("multirotor,endurance=500", 2.0),
        ("fixed-wing,climb_speed=30,sink_speed=30", 5.0),
        ("multirotor,endurance=25", 1.0),
    ],
)
def test_missions_keep_their_height_above_a_mountain(vehicle, error, hills, tmp_path):
    """Every metre of every leg of the files, as computed from the grid by other code."""
    path, grid = hills
    options = {
        "vehicle": vehicle,
        "altitude_frame": "ground",
        "terrain": open_terrain(path),
        "terrain_error": error,
    }
    missions = missions_of(LANES, FRAME, home=(-600, -450), link=101.0, **options)
    wanted = vehicle_of(vehicle).height
    files = write_missions(missions, tmp_path, formats=["plan"])
    assert len(files) == len(missions)
    worst, checked = 0.0, 0
    for file in files:
        way = way_of_plan(file)
        base = height_there(grid, *way[0][:2])
        # up over home and down to it apart
        for (x, y, z), (east, north, top) in pairwise(way[1:-1]):
            count = max(1, round(math.hypot((east - x) * 75_000, (north - y) * 111_000)))
            for step in range(count + 1):
                share = step / count
                ground = height_there(grid, x + share * (east - x), y + share * (north - y))
                worst = max(worst, abs(z + share * (top - z) + base - ground - wanted))
                checked += 1
    assert worst <= error
    ground = open_terrain(path)
    read = clearance_of([read_mission(file) for file in files], ground, FRAME)
    assert max(read.highest - wanted, wanted - read.lowest) == pytest.approx(worst, abs=0.03)
    asked = clearance_of(missions, ground, FRAME)
    assert asked.error == pytest.approx(worst, abs=0.03)
    assert (asked.lowest, asked.highest) == pytest.approx((read.lowest, read.highest), abs=0.03)
    assert worst > error / 2, "no more waypoints than are needed"
    assert checked > 9000


def test_a_fixed_wing_rises_before_the_mountain_as_fast_as_it_can_and_no_faster(hills, tmp_path):
    path, _ = hills
    wing, ground = (
        vehicle_of("fixed-wing,turn_radius=20,wind_speed=4,wind_from=250"),
        open_terrain(path),
    )
    asked = {"vehicle": wing, "altitude_frame": "ground", "terrain": ground, "terrain_error": 5.0}
    missions = missions_of(LANES, FRAME, home=(-600, -600), link=101.0, **asked)
    told = {name: value for name, value in wing.to_dict(defaults=True).items() if value is not None}
    for file in write_missions(missions, tmp_path, formats=["plan"]):
        way = way_of_plan(file)
        for (bearing, _, length, up), leg in zip(legs_of(way[:-1]), pairwise(way), strict=False):
            lasting = length / ground_speed(bearing, 16.0, 4.0, 250.0) if length else 0.0
            assert -2.0 * lasting - 0.02 <= up <= 3.0 * lasting + 0.02, leg
        assert seconds_of(way, told) <= usable_seconds(told)
    seen = clearance_of(missions, ground, FRAME)
    # lowest where it climbs in circles after take-off
    assert 8 < seen.lowest < 80 < 120 < seen.highest
    ups = missions[0].altitudes  # heights above ground differ: files say so
    assert ups[np.argmax(ups >= 75) :].min() >= 75
    assert not [one for one in lint(tmp_path, vehicle=wing) if one.severity == "error"]
    write_missions(
        missions_of(
            LANES,
            FRAME,
            home=(-600, -600),
            link=101.0,
            **asked | {"vehicle": "fixed-wing,climb_speed=30,sink_speed=30"},
        ),
        tmp_path,
    )
    found = lint(tmp_path, vehicle=wing)
    assert {one.rule for one in found if one.severity == "error"} == {"climb"}


def test_formats_say_what_altitudes_count_from(hills, tmp_path):
    path, grid = hills
    terrain = open_terrain(path)
    base = height_there(grid, *FRAME.to_degrees([(-500, -400)])[0])
    level = {"vehicle": "multirotor,altitude=450,endurance=500", "terrain": terrain}
    cases = {
        "ground": {"vehicle": "multirotor", "altitude_frame": "ground", "terrain": terrain},
        "sea": {"vehicle": "multirotor,altitude=1000,endurance=500", "altitude_frame": "sea"},
        "sea over terrain": {
            **level,
            "vehicle": "multirotor,altitude=1000,endurance=500",
            "altitude_frame": "sea",
        },
        "home over terrain": level,
        "home": {},
    }
    said = {}
    for name, options in cases.items():
        mission = missions_of(LANES[:4], FRAME, **options)[0]
        write_missions([mission], tmp_path / name)
        assert not [one for one in lint(tmp_path / name) if one.severity == "error"]
        for file in (tmp_path / name).glob("robot-*"):
            assert len(READERS[file.suffix](file)[1]) == len(mission.waypoints)
            again = read_mission(file)
            if file.suffix in (".plan", ".waypoints"):
                assert np.abs(again.heights_above_home - mission.heights_above_home).max() < 1e-6
            else:
                assert again.altitude == pytest.approx(mission.altitude)
                assert again.altitude_frame == mission.altitude_frame
        kml, gpx = (
            (tmp_path / name / f"robot-01{suffix}").read_text() for suffix in (".kml", ".gpx")
        )
        plan = json.loads((tmp_path / name / "robot-01.plan").read_text())["mission"]
        mode = kml.split("<altitudeMode>")[1].split("<")[0]
        first = float(kml.split("<coordinates>\n")[1].split("\n")[0].split(",")[2])
        raised = float(gpx.split("<ele>")[1].split("<")[0]) if "<ele>" in gpx else None
        said[name] = (
            mode,
            round(first),
            None if raised is None else round(raised),
            plan["globalPlanAltitudeMode"],
        )
    assert said == {
        "ground": ("relativeToGround", 30, round(base + 30), 1),
        "sea": ("absolute", 1000, 1000, 2),
        "sea over terrain": ("absolute", 1000, 1000, 2),
        "home over terrain": ("absolute", round(base + 450), round(base + 450), 1),
        "home": ("clampToGround", 0, None, 1),
    }
    assert plan["plannedHomePosition"][2] == 0


def test_level_ways_that_meet_the_ground_are_refused(hills):
    with pytest.raises(
        InvalidInputError,
        match=(
            r"altitude: expected more than .* m above home, the height of the ground at .*, got 80"
        ),
    ):
        missions_of(
            LANES,
            FRAME,
            vehicle="multirotor,altitude=80,endurance=100",
            terrain=open_terrain(hills[0]),
        )
    with pytest.raises(
        InvalidInputError, match="expected heights of the ground under the whole path, got none at"
    ):
        missions_of(
            [(0, 0), (9000, 0)], FRAME, altitude_frame="ground", terrain=open_terrain(hills[0])
        )


def test_grids_of_both_formats_are_one(hills, tmp_path):
    tiff = open_terrain(hills[0])
    lines = [
        f"ncols {SIDE}",
        f"nrows {SIDE}",
        f"xllcenter {EAST - SIDE // 2 * CELL!r}",
        f"yllcenter {NORTH - SIDE // 2 * CELL!r}",
        f"cellsize {CELL}",
    ]
    rows = [" ".join(map(repr, row)) for row in hills[1][::-1]]
    (tmp_path / "hills.asc").write_text("\n".join([*lines, "NODATA_value -9999", *rows, ""]))
    (tmp_path / "hills.prj").write_text("EPSG:32632")
    grid = open_terrain(tmp_path / "hills.asc")
    points = np.random.default_rng(1).uniform(-600, 600, (200, 2))
    heights = tiff.at(points, FRAME)
    assert np.abs(heights - grid.at(points, FRAME)).max() < 1e-6
    other = [height_there(hills[1], *place) for place in FRAME.to_degrees(points)]
    assert np.abs(heights - other).max() < 1e-6
    write_geotiff(tmp_path / "points.tif", hills[1], points=True)
    assert np.abs(open_terrain(tmp_path / "points.tif").at(points, FRAME) - heights).max() < 1e-6


def test_heights_where_none_are(tmp_path):
    (tmp_path / "flat.asc").write_text(
        "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\n1 2 3\n4 -9999 6\n"
    )
    terrain = open_terrain(tmp_path / "flat.asc")
    assert terrain.at([(5, 5), (15, 15), (5, 10)], None).tolist() == [4, 2, 2.5]
    with pytest.raises(
        InvalidInputError, match=r"flat.asc: expected heights .*, got none at \(10, 5\)"
    ):
        terrain.at([(10, 5)], None)
    with pytest.raises(
        InvalidInputError,
        match=(
            "expected a position on Earth, as in the region, got metres without a position on Earth"
        ),
    ):
        Terrain(np.zeros((2, 2)), 0, 0, (1, 1), None).at([(0, 0)], FRAME)


def notes_of(**said):
    """Return what GDAL notes of the first band of a GeoTIFF."""
    items = [
        f'<Item name="{name.upper()}" sample="0" role="{name}">{text}</Item>'
        for name, text in said.items()
    ]
    return f"<GDALMetadata>{''.join(items)}</GDALMetadata>"


def beside_of(**said):
    """Return what GDAL writes into a file beside a grid."""
    notes = "".join(f"<{name}>{text}</{name}>" for name, text in said.items())
    return f'<PAMDataset><PAMRasterBand band="1">{notes}</PAMRasterBand></PAMDataset>'


def test_scale_and_offset_of_a_geotiff_are_those_of_its_heights(tmp_path):
    numbers = np.array([[4000.0, 4400.0], [-9999.0, 0.0], [3999.5, 1.0]])
    other_band = '<Item name="SCALE" sample="1" role="scale">7</Item><Item name="SCALE">8</Item>'
    notes = notes_of(offset="-5", scale="0.1", unittype="m")
    write_geotiff(
        tmp_path / "scaled.tif",
        numbers,
        no_data=-9999,
        notes=notes.replace("</GDALMetadata>", other_band + "\n</GDALMetadata>\n"),
    )
    read = open_terrain(tmp_path / "scaled.tif").heights[::-1]
    expected = np.where(numbers == -9999, np.nan, numbers / 10 - 5)
    assert np.allclose(read, expected, equal_nan=True, atol=1e-4)
    write_geotiff(tmp_path / "same.tif", numbers, no_data=-9999, notes=notes_of(AREA="Area"))
    read = open_terrain(tmp_path / "same.tif").heights[::-1]
    assert np.array_equal(read, np.where(numbers == -9999, np.nan, numbers), equal_nan=True)


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ({"Scale": "0.1", "Offset": "3"}, "got a scale of 0.1 and an offset of 3; write"),
        ({"NoDataValue": "4"}, "got the missing number 4; write it"),
        ({"Scale": "0"}, "expected a scale that is not 0, got '0'"),
        ({"UnitType": "ft"}, "expected heights in metres, got the unit 'ft'"),
        ({"UnitType": "m", "Scale": "1", "NoDataValue": "-9999"}, None),
    ],
)
@pytest.mark.parametrize("suffix", [".tif", ".asc"])
def test_a_file_beside_a_grid_does_not_change_heights_in_silence(said, told, suffix, tmp_path):
    path = tmp_path / f"grid{suffix}"
    if suffix == ".asc":
        path.write_text(ascii_grid())
    else:
        write_geotiff(path, np.array([[1.0, 2.0], [3.0, 4.0]]))
    Path(f"{path}.aux.xml").write_text(beside_of(**said))
    if told is None:
        assert open_terrain(path).heights.max() == 4
        return
    with pytest.raises(InvalidInputError, match=told):
        open_terrain(path)


def test_heights_in_feet_of_the_system_beside_an_ascii_grid_are_refused(tmp_path):
    (tmp_path / "grid.asc").write_text(ascii_grid())
    (tmp_path / "grid.prj").write_text("EPSG:26910+6360")
    with pytest.raises(InvalidInputError, match="in metres, got the unit 'US survey foot'"):
        open_terrain(tmp_path / "grid.asc")
    (tmp_path / "grid.prj").write_text("EPSG:26910+5703")
    assert open_terrain(tmp_path / "grid.asc").heights.max() == 4


def test_probabilities_have_scales_but_no_unit(tmp_path):
    numbers = np.array([[1.0, 2.0], [3.0, 4.0]])
    notes = notes_of(scale="2", offset="-1", unittype="%")
    write_geotiff(tmp_path / "likely.tif", numbers, notes=notes)
    read = open_grid(tmp_path / "likely.tif", what="probabilities")
    assert read.heights[::-1].tolist() == (numbers * 2 - 1).tolist()


def ascii_grid(**changes):
    head = {
        "ncols": "2",
        "nrows": "2",
        "xllcorner": "0",
        "yllcorner": "0",
        "cellsize": "1",
    } | changes
    body = head.pop("body", "1 2\n3 4\n")
    return "".join(f"{name} {value}\n" for name, value in head.items() if value is not None) + body


BAD = [
    ("a.asc", ascii_grid(body="1 2\n3 x\n"), "a.asc, line 7: expected numbers, got '3 x'"),
    ("a.asc", ascii_grid(body="1 2\n3\n"), "a.asc: expected 4 heights, ncols times nrows, got 3"),
    (
        "a.asc",
        ascii_grid(ncols=None),
        "a.asc: expected ncols above 0 in the head of an ESRI ASCII grid, got none",
    ),
    ("a.asc", ascii_grid(cellsize="-1"), "a.asc: expected cellsize above 0"),
    (
        "a.asc",
        ascii_grid(cellsize="wide"),
        "a.asc, line 5: expected a number as 'cellsize', got 'wide'",
    ),
    (
        "a.asc",
        ascii_grid(xllcorner=None),
        "a.asc: expected xllcorner and yllcorner, or xllcenter and yllcenter, got none",
    ),
    (
        "a.asc",
        ascii_grid(ncols="100000", nrows="100000"),
        "a.asc: expected at most 40000000 heights, got 100000 x 100000",
    ),
    (
        "a.asc",
        ascii_grid(ncols="1", nrows="4"),
        "a.asc: expected at least 2 rows and 2 columns of heights, got 4 and 1",
    ),
    (
        "a.asc",
        ascii_grid(body="1 2\n3 1e30\n"),
        "a.asc: expected heights of at most 20000 m, got 1e+30; the file may lack a NODATA value",
    ),
    (
        "a.asc",
        ascii_grid(body="-9999 -9999\n-9999 nan\n"),
        "a.asc: expected heights, got a grid in which all numbers are missing",
    ),
    (
        "a.asc",
        "ncols 2\nNCOLS 2\n" + ascii_grid(),
        "a.asc: expected nrows above 0 in the head of an ESRI ASCII grid, got none",
    ),
    ("a.asc", "hills", "a.asc: expected ncols above 0"),
    ("a.txt", "", "a.txt: expected heights in a file .tif or .asc, got the suffix '.txt'"),
    ("a.tif", "II*\0", "a.tif: expected a GeoTIFF, got one that cannot be read"),
    ("a.tif", "", "a.tif: expected a file of heights, got an empty file"),
    (
        "a.tif",
        {"code": 32767},
        "a.tif: expected the EPSG code of a coordinate reference system, got 32767",
    ),
    (
        "a.tif",
        {"code": None},
        "a.tif: expected the EPSG code of a coordinate reference system, got none",
    ),
    ("a.tif", {"code": 9}, "a.tif: expected a known coordinate reference system, got 'EPSG:9'"),
    (
        "a.tif",
        {"code": 4978, "model": 2},
        "a.tif: expected a geographic or projected coordinate reference system",
    ),
    ("a.tif", {"without": (34735,)}, "a.tif: expected a GeoTIFF, got a TIFF without the keys"),
    (
        "a.tif",
        {"without": (33922,)},
        "a.tif: expected the position of the grid (tags 33550 and 33922, or 34264), got none",
    ),
    ("a.tif", {"cell": 0.0}, "a.tif: expected cells with sides above 0, got 0 x 0"),
    (
        "a.tif",
        {"keys": [(4099, 9002)]},
        "a.tif: expected heights in metres, got the unit 'EPSG:9002'",
    ),
    (
        "a.tif",
        {"keys": [(4096, 6360)]},
        "a.tif: expected heights in metres, got the unit 'US survey foot'",
    ),
    (
        "a.tif",
        {"keys": [(4096, 5715)]},
        "a.tif: expected heights in metres, got the unit 'metre of depth'",
    ),
    (
        "a.tif",
        {"notes": notes_of(unittype="US survey foot")},
        "a.tif: expected heights in metres, got the unit 'US survey foot'",
    ),
    (
        "a.tif",
        {"notes": notes_of(scale="0")},
        "a.tif: expected a scale that is not 0, got '0'",
    ),
    ("a.tif", {"notes": notes_of(scale="many")}, "a.tif: expected a scale that is not 0"),
    ("a.tif", {"notes": notes_of(offset="nan")}, "a.tif: expected an offset, got 'nan'"),
    (
        "a.tif",
        {"notes": "<GDALMetadata><Item>"},
        "a.tif: expected what GDAL notes of the numbers of a raster, got a text that cannot be read",
    ),
    (
        "a.tif",
        {"notes": "<!DOCTYPE a [<!ENTITY b 'bb'>]>" + notes_of(scale="&b;")},
        "a.tif: expected what GDAL notes of the numbers of a raster, got a text that cannot be read",
    ),
]


@pytest.mark.parametrize(("name", "content", "said"), BAD)
def test_bad_files_of_heights_are_one_sentence(name, content, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    if isinstance(content, str):
        (tmp_path / name).write_text(content)
    else:
        write_geotiff(tmp_path / name, np.zeros((3, 3)), **content)
    assert run(["search", "square:100", "--missions", "m", "--terrain", name]) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith(f"shoal: {said}")
    assert captured.err.count("\n") == 1
    assert not (tmp_path / "m").exists()


CAMERA = "sensor_width=13.2,sensor_height=8.8,focal_length=8.8,side_overlap=0.3"  # 1.5 x 1 heights


def field_over(folder, heights, vehicle, **options):
    """Return a field of 300 m by 200 m, the missions of its search and their check over a terrain of
    cells of 10 m around it, whose first row is southernmost.
    """
    rows = "\n".join(" ".join(map(repr, row)) for row in heights[::-1].tolist())
    path = folder / "field.asc"
    path.write_text(
        f"ncols {heights.shape[1]}\nnrows {heights.shape[0]}\nxllcenter -50\nyllcenter -50\n"
        f"cellsize 10\n{rows}\n"
    )
    problem = SearchProblem("rectangle:300x200", vehicle=vehicle, launch=[(20.0, 100.0)])
    missions = MissionSet.from_problem(problem, MissionOptions(terrain=str(path), **options))
    return missions, missions.check(missions.check_options.replaced(terrain=str(path)))


def hill(height):
    """Return ground that is 400 m high in the west, and higher in the east."""
    heights = np.full((31, 41), 400.0)
    heights[:, 21:] += height
    return heights


def seen_by_images(missions, heights, between):
    """Return the share of the field that images see, at places ``between`` metres apart, by the
    heights of the ground below them.
    """
    y, x = (axis.ravel() for axis in np.mgrid[0.5:200, 0.5:300])
    seen = np.zeros(len(x), dtype=bool)
    for mission in missions.missions:
        path = mission.waypoints[mission.searched]
        for begin, end in pairwise(path):
            length = math.dist(begin, end)
            ahead = (end - begin) / length
            for far in [*np.arange(0, length, between), length]:
                place = begin + far * ahead
                ground = bilinear(heights, *(place + 50) / 10)
                up = (
                    mission.altitude
                    + bilinear(heights, *(np.array(mission.home) + 50) / 10)
                    - ground
                )
                off = np.stack([x, y], axis=1) - place
                along = np.abs(off @ ahead) <= up / 2
                seen |= along & (np.abs(off @ (-ahead[1], ahead[0])) <= 1.5 * up / 2)
    return seen.mean()


@pytest.mark.parametrize(("overlap", "most"), [(0.7, 0.03), (0.4, 0.08)])
def test_a_camera_sees_less_over_a_hill(overlap, most, tmp_path, monkeypatch):
    """Over the hill, images are a third as large; with a small overlap there are gaps between them."""
    heights, vehicle = hill(40.0), f"multirotor,altitude=60,{CAMERA},front_overlap={overlap}"
    told = (
        r"altitude_frame: expected altitudes from which the camera sees 100 % .* got \d\d\.\d+ % .*"
        r" only 20 m above the ground, where images have 33.3 % .*; give altitude_frame ground"
    )
    with pytest.raises(InvalidInputError, match=told):
        field_over(tmp_path, heights, vehicle)
    monkeypatch.setattr(MissionSet, "_check_sees_ground", lambda _: None)
    missions, check = field_over(tmp_path, heights, vehicle)
    counted = check.coverage.covered_fraction
    seen = seen_by_images(missions, heights, 1.0 if overlap == 0.7 else 60 * (1 - overlap))
    assert counted < 0.85
    assert (-0.005 if overlap == 0.7 else -most) < seen - counted < most
    assert "% of the region is seen, less than" in check.faults[0]
    assert "only 20 m above the ground" in check.cautions[-2] + check.cautions[-1]
    assert any(f"sees {100 * counted:.6g} % of the region over" in one for one in missions.cautions)


@pytest.mark.parametrize("roughness", [0.2, 1.0, 8.0])
@pytest.mark.parametrize("kind", ["multirotor", "fixed-wing"])
def test_a_camera_above_ground_is_nowhere_lower_than_planned(roughness, kind, tmp_path):
    heights = 400 + np.random.default_rng(2).uniform(-roughness, roughness, (91, 101))
    heights = np.roll(heights, 30, axis=(0, 1))
    path = tmp_path / "wide.asc"
    rows = "\n".join(" ".join(map(repr, row)) for row in heights.tolist())
    path.write_text(f"ncols 101\nnrows 91\nxllcenter -350\nyllcenter -350\ncellsize 10\n{rows}\n")
    vehicle = f"{kind},altitude=60,{CAMERA},front_overlap=0.7"
    # wings climb in circles above their first cell, and pass it twice before they are up
    place = {"tour": "headland", "angle": 0.0, "starts": [(150.0, 30.0)]}
    problem = SearchProblem("rectangle:300x200", robots=1, vehicle=vehicle, **place)
    options = MissionOptions(terrain=str(path), altitude_frame="ground")
    missions = MissionSet.from_problem(problem, options)
    check = missions.check(missions.check_options.replaced(terrain=str(path)))
    assert check.smallest.height > 60 - 0.01
    assert check.coverage.covered_fraction == pytest.approx(1, abs=1e-6)
    if kind == "multirotor":
        assert check.clearance.highest < 62.01
    assert not [one for one in missions.cautions if "camera" in one]


def test_a_mission_beside_the_terrain_keeps_its_mistakes(tmp_path):
    """The mission sees nothing, and its mistakes are told, not the first missing height."""
    missions, check = field_over(tmp_path, hill(0.0), f"multirotor,altitude=60,{CAMERA}")
    missions.write(tmp_path / "missions")
    first = min((tmp_path / "missions").glob("*.csv"))
    first.write_text(first.read_text().replace("272.23599994", "769.9"))
    wrong = MissionSet.read(tmp_path / "missions").check(
        missions.check_options.replaced(terrain=str(tmp_path / "field.asc"))
    )
    assert wrong.errors
    assert wrong.coverage.covered_fraction < check.coverage.covered_fraction - 0.1


def test_altitudes_above_the_sea_need_no_height_of_home():
    terrain = Terrain(np.full((3, 3), 400.0), -100.0, 200.0, (100.0, 100.0), None)
    for elevation, altitude in ((None, 460.0), (390.0, 450.0)):
        mission = Mission(
            [(0.0, 0.0), (50.0, 0.0)],
            (0.0, 0.0),
            geographic=False,
            altitude_frame="sea",
            altitude=altitude,
            take_off=altitude,
            elevation=elevation,
        )
        clearance = clearance_of([mission], terrain, None)
        assert (clearance.lowest, clearance.highest) == pytest.approx((60, 60))


def test_heights_above_the_ground_matter_to_cameras_alone(tmp_path):
    missions, check = field_over(tmp_path, hill(40.0), "multirotor,altitude=60,detector_width=40")
    assert check.smallest is None
    assert check.coverage.covered_fraction == pytest.approx(1)
    assert check.clearance.lowest == pytest.approx(20)
    camera = f"multirotor,altitude=460,{CAMERA}"  # above the sea, and no image is 690 m wide
    with pytest.raises(InvalidInputError, match=r"with altitudes above sea: .* is only 60 m above"):
        field_over(tmp_path, hill(0.0), camera, altitude_frame="sea")
    # the launch is in the valley of negative hills: all images are as large as planned, or larger
    missions, check = field_over(
        tmp_path, hill(-10.0), f"multirotor,altitude=60,{CAMERA},front_overlap=0.7"
    )
    assert check.coverage.covered_fraction == pytest.approx(1)
    assert not [one for one in missions.cautions if "camera" in one]


def test_a_flight_needs_what_its_altitude_counts_from():
    with pytest.raises(
        InvalidInputError, match="altitude_frame: expected home or sea without a terrain"
    ):
        flight_of(vehicle=vehicle_of("multirotor"), home=np.zeros(2), altitude_frame="ground")
    rover = flight_of(vehicle=vehicle_of("rover"), home=np.zeros(2), altitude_frame="ground")
    assert rover.waypoints(np.array([(5.0, 0.0)])).tolist() == [[5.0, 0.0, 0.0]]


def test_an_ascii_grid_is_read_piece_by_piece(tmp_path, monkeypatch):
    head = "ncols 3\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 10\nNODATA_value -9999\n"
    path = tmp_path / "a.asc"
    path.write_text(head + "1 22.25 333\n-9999\t5\n6" + "\n" * 2_000_000)
    whole = open_terrain(path).heights
    monkeypatch.setattr(terrain_files, "_AT_ONCE", 20)
    pieces = open_terrain(path).heights
    assert np.array_equal(whole, [[1, 22.25, 333], [np.nan, 5, 6]], equal_nan=True)
    assert np.array_equal(whole, pieces, equal_nan=True)
    for numbers, words in (
        ("1 2 3\n4 5 x6\n", "line 8: expected numbers, got "),
        ("1 2 3\n4 5 6 7", "expected 6 heights, ncols times nrows, got more"),
        ("1 2 3\n4 5", "expected 6 heights, ncols times nrows, got 5"),
        ("1" * 100, "line 7: expected numbers, got '1111"),
    ):
        path.write_text(head + numbers)
        with pytest.raises(InvalidInputError, match=words):
            open_terrain(path)
