"""Regions of other programs: ground control stations, hidden and closed shapes, encodings, and
budgets.
"""

from __future__ import annotations

import json
import math
import sqlite3
import zipfile
from contextlib import closing

import numpy as np
import pytest
import shapely
from tests.unit.search.test_regions import (
    FIELD,
    POND,
    collection,
    feature,
    geodesic_area,
    kml,
    placemark,
    polygon,
    saved,
    words,
)

from shoal.core.errors import InvalidInputError
from shoal.search import SearchProblem, open_region
from shoal.search.regions import outline as outline_checks
from shoal.search.regions.formats import geodata, tables
from shoal.search.regions.outline import check_overlaps
from shoal.search.regions.places import read_points


def latitudes(ring):
    return [[y, x] for x, y in ring]


def plan(*, survey=None, inside=None, outside=None, circle=None):
    items = (
        [{"type": "ComplexItem", "complexItemType": "survey", "polygon": latitudes(survey)}]
        if survey
        else []
    )
    polygons = [
        {"inclusion": inclusion, "polygon": latitudes(ring), "version": 1}
        for inclusion, ring in ((True, inside), (False, outside))
        if ring
    ]
    circles = (
        [{"circle": {"center": [circle[1], circle[0]], "radius": circle[2]}, "inclusion": False}]
        if circle
        else []
    )
    fence = {"polygons": polygons, "circles": circles, "version": 2}
    return {"fileType": "Plan", "version": 1, "geoFence": fence, "mission": {"items": items}}


# Ground control stations


def test_plans_of_qgroundcontrol(tmp_path):
    corners, pond = FIELD[:-1], POND[:-1]
    survey = open_region(saved(tmp_path, "a.plan", plan(survey=corners, outside=pond)))
    assert survey.area_m2 == pytest.approx(geodesic_area(FIELD, POND), rel=1e-6)
    assert survey.no_go_zones == 1
    assert open_region(saved(tmp_path, "b.plan", plan(inside=corners))).area_m2 == pytest.approx(
        geodesic_area(FIELD), rel=1e-6
    )
    both = saved(tmp_path, "c.plan", plan(survey=pond, inside=corners))
    with pytest.raises(
        InvalidInputError,
        match=r"got survey polygons and a fence; choose with --layer survey or --layer fence",
    ):
        open_region(both)
    assert open_region(both, layer="survey").area_m2 < open_region(both, layer="fence").area_m2 / 4
    field = saved(tmp_path, "a.geojson", polygon(FIELD))
    zones = saved(tmp_path, "d.plan", plan(inside=corners, outside=pond))
    assert open_region(field, no_go=zones).area_m2 == pytest.approx(
        geodesic_area(FIELD, POND), rel=1e-6
    )
    for name, content, words_ in (
        ("e.plan", plan(), "expected a survey polygon or an inclusion in the fence, got neither"),
        (
            "f.plan",
            {"fileType": "Mission"},
            'expected a plan of QGroundControl, with "fileType": "Plan"',
        ),
        (
            "g.plan",
            plan(survey=[(8.5, 47.4), (8.6, "x"), (8.5, 47.5)]),
            "polygon: vertex 2: expected .latitude, longitude., got",
        ),
        (
            "h.plan",
            plan(inside=corners, circle=(8.51, 47.405, -3)),
            "circle: expected a radius above 0",
        ),
    ):
        with pytest.raises(InvalidInputError, match=words_):
            open_region(saved(tmp_path, name, content))
    with pytest.raises(InvalidInputError, match="expected a survey polygon, got fence"):
        open_region(tmp_path / "b.plan", layer="survey")
    with pytest.raises(
        InvalidInputError, match="--layer: expected one of survey, fence, got 'fences'"
    ):
        open_region(tmp_path / "b.plan", layer="fences")


def test_an_excluded_circle_lies_inside_its_no_go_zone(tmp_path):
    region = open_region(
        saved(tmp_path, "a.plan", plan(inside=FIELD[:-1], circle=(8.51, 47.405, 100.0)))
    )
    middle = shapely.Point(region.frame.to_metres([(8.51, 47.405)])[0])
    assert region.no_go.buffer(1e-3).covers(middle.buffer(100.0, quad_segs=64))
    assert region.no_go.area == pytest.approx(math.pi * 100**2, rel=2e-3)


def test_polygons_and_fences_of_mission_planner(tmp_path):
    lines = "#saved by Mission Planner 1.3.80\n" + "".join(f"{y} {x}\n" for x, y in FIELD[:-1])
    expected = pytest.approx(geodesic_area(FIELD), rel=1e-6)
    assert open_region(saved(tmp_path, "a.poly", lines)).area_m2 == expected
    fence = "#saved by APM Planner 1.3.80\n47.405 8.51\n" + "".join(
        f"{y} {x}\n" for x, y in FIELD
    )  # the point of return first
    assert open_region(saved(tmp_path, "a.fen", fence)).area_m2 == expected
    rows = [
        (5000, 0, 8.51, 47.405),
        *((5001, 4, *p) for p in FIELD[:-1]),
        *((5002, 4, *p) for p in POND[:-1]),
    ]
    items = "QGC WPL 110\n" + "".join(
        f"{k} 0 3 {c} {n} 0 0 0 {y} {x} 0 1\n" for k, (c, n, x, y) in enumerate(rows)
    )
    for name in ("a.waypoints", "fence.txt"):
        assert open_region(saved(tmp_path, name, items)).area_m2 == pytest.approx(
            geodesic_area(FIELD, POND), rel=1e-6
        )
    for name, content, words_ in (
        ("b.poly", "47.4 8.5\n47.4\n", "line 2: expected a latitude and a longitude, got '47.4'"),
        ("c.poly", "# nothing\n", "expected lines with a latitude and a longitude, got none"),
        (
            "d.poly",
            "147.4 8.5\n147.4 8.6\n147.5 8.6\n",
            "line 1: expected a longitude within ±180 and then a latitude within ±90",
        ),
        (
            "e.waypoints",
            items.replace(" 5001 4", " 5001 5", 1),
            "expected a polygon of 5 vertices, got 4",
        ),
        (
            "f.waypoints",
            "QGC WPL 110\n0 1 0 16 0 0 0 0 47 8 0 1\n1 0 3 16 0 0 0 0 47 8 30 1\n",
            "got the command 16",
        ),
    ):
        with pytest.raises(InvalidInputError, match=words_):
            open_region(saved(tmp_path, name, content))


def test_the_fence_that_shoal_writes_is_a_region(tmp_path):
    from shoal.missions.fence import Fence
    from shoal.missions.formats.fences import fence_text

    text = fence_text(Fence(np.array(FIELD[:-1]), (np.array(POND[:-1]),)))
    expected = pytest.approx(geodesic_area(FIELD, POND), rel=1e-6)
    assert open_region(saved(tmp_path, "fence.txt", text)).area_m2 == expected


# Hidden shapes and closed lines


def test_a_hidden_polygon_is_asked_for(tmp_path):
    hidden = f"<Folder><visibility>0</visibility>{placemark(words(POND))}</Folder>"
    path = saved(tmp_path, "a.kml", kml(placemark(words(FIELD)), hidden))
    with pytest.raises(
        InvalidInputError,
        match=(
            r"polygon 2 \(line \d+\): expected a visible polygon, .* line \d+\); choose with"
            r" --hidden use or"
        ),
    ):
        open_region(path)
    assert open_region(path, hidden="skip").area_m2 == pytest.approx(geodesic_area(FIELD), rel=1e-6)
    assert open_region(path, hidden="use", inner="no-go").area_m2 == pytest.approx(
        geodesic_area(FIELD, POND), rel=1e-6
    )
    only = saved(tmp_path, "b.kml", kml(placemark(words(FIELD), more="<visibility>0</visibility>")))
    with pytest.raises(InvalidInputError, match="expected a Polygon, got 1 hidden ones"):
        open_region(only, hidden="skip")
    plain = saved(
        tmp_path, "c.kml", kml(placemark(words(FIELD), more="<visibility>1</visibility>"))
    )
    with pytest.raises(
        InvalidInputError, match="--hidden: expected a KML file with a hidden polygon, got none in"
    ):
        open_region(plain, hidden="skip")


def test_closed_lines_are_polygons_on_request(tmp_path):
    import pyogrio

    line = {"type": "LineString", "coordinates": [list(p) for p in FIELD]}
    several = {
        "type": "MultiLineString",
        "coordinates": [[list(p) for p in FIELD], [[8.5, 47.4], [8.6, 47.4]]],
    }
    named = (
        f"<Placemark><LineString><coordinates>{words(FIELD)}</coordinates></LineString></Placemark>"
    )
    pyogrio.raw.write(
        tmp_path / "a.shp",
        np.array([shapely.to_wkb(shapely.LineString(FIELD))], dtype=object),
        [],
        [],
        crs="EPSG:4326",
        geometry_type="LineString",
    )
    for path in (
        saved(tmp_path, "a.geojson", line),
        saved(tmp_path, "b.geojson", several),
        saved(tmp_path, "a.kml", kml(named)),
        tmp_path / "a.shp",
    ):
        with pytest.raises(
            InvalidInputError, match="String; --closed-lines reads closed lines as polygons"
        ):
            open_region(path)
        assert open_region(path, closed_lines=True).area_m2 == pytest.approx(
            geodesic_area(FIELD), rel=1e-6
        )
    zone = feature(line | {"coordinates": [list(p) for p in POND]}, no_go=True)
    path = saved(tmp_path, "c.geojson", collection(feature(polygon(FIELD)), zone))
    assert open_region(path).area_m2 == pytest.approx(geodesic_area(FIELD), rel=1e-6)
    assert open_region(path, closed_lines=True).area_m2 == pytest.approx(
        geodesic_area(FIELD, POND), rel=1e-6
    )
    problem = SearchProblem(str(path), closed_lines=True, footprint=50.0)
    assert problem.place.no_go_zones == 1
    assert "closed_lines" in problem.place_key()
    for source in ("square:100", str(saved(tmp_path, "d.geojson", polygon(FIELD)))):
        with pytest.raises(
            InvalidInputError,
            match="--closed-lines: expected a file with a closed line, got none in",
        ):
            open_region(source, closed_lines=True)


# Encodings


@pytest.mark.parametrize(
    "encoding", ["utf-16", "utf-16-le", "iso-8859-1", "windows-1252", "utf-32", "utf-8", "us-ascii"]
)
def test_xml_in_the_encoding_that_it_declares(encoding, tmp_path):
    name = "No-go: pond" if encoding == "us-ascii" else "No-go: Weiher süd"
    text = kml(
        placemark(words(FIELD)),
        placemark(words(POND), more=f"<name>{name}</name>"),
        head=f'<?xml version="1.0" encoding="{encoding}"?>\n',
    )
    region = open_region(saved(tmp_path, "a.kml", text.encode(encoding)))
    assert region.area_m2 == pytest.approx(geodesic_area(FIELD, POND), rel=1e-6)


@pytest.mark.parametrize(
    ("declared", "raw", "words_"),
    [
        ("nonsense", None, "expected a known encoding of XML, got 'nonsense'"),
        ("zlib", None, "expected a known encoding of XML, got 'zlib'"),
        ("utf-16", None, "expected text in UTF-8, got byte 0xfc in line 2"),
        (
            "utf-8",
            b"\xff\xfe<\x00k",
            "expected text in utf-16, as the file declares, got something else: truncated data",
        ),
        (
            "iso-8859-1",
            b'<?xml version="1.0" encoding="iso-8859-1"?>\n<kml>\n\x00</kml>',
            "expected text, got a zero byte in line 3",
        ),
    ],
)
def test_wrong_encodings_are_told(declared, raw, words_, tmp_path):
    text = kml(
        placemark(words(FIELD)),
        head=f'<?xml version="1.0" encoding="{declared}"?>\n<!-- Weiher süd -->',
    )
    with pytest.raises(InvalidInputError, match=words_):
        open_region(saved(tmp_path, "a.kml", text.encode("latin-1") if raw is None else raw))


# Budgets, which are checked before the work


def square(x, y, side):
    return [(x, y), (x + side, y), (x + side, y + side), (x, y + side), (x, y)]


def comb(teeth, *, turned):
    points = [(0.0, 0.0)]
    for k in range(teeth):
        points += [
            (k / teeth, 1.0),
            ((k + 0.5) / teeth, 1.0),
            ((k + 0.5) / teeth, 0.1),
            ((k + 1) / teeth, 0.1),
        ]
    points += [(1.0, 0.0)]
    return shapely.Polygon([(y, x) if turned else (x, y) for x, y in points])


def test_equal_polygons_are_read_once(tmp_path):
    path = saved(tmp_path, "a.geojson", collection(*[feature(polygon(FIELD))] * 1500))
    region = open_region(path)
    assert region.area_m2 == pytest.approx(geodesic_area(FIELD), rel=1e-6)
    assert len(region.parts) == 1


def test_polygons_that_meet_too_often_are_refused_before_they_are_united(tmp_path, monkeypatch):
    shifted = [feature(polygon(square(8.5 + k * 1e-6, 47.4, 0.01))) for k in range(700)]
    with pytest.raises(
        InvalidInputError, match="expected at most 200000 pairs of polygons that meet, got"
    ):
        open_region(saved(tmp_path, "a.geojson", collection(*shifted)))
    with pytest.raises(
        InvalidInputError,
        match="expected polygons with at most 2000000 sides that may cross each other",
    ):
        check_overlaps([comb(800, turned=False), comb(800, turned=True)], "a")
    # equal combs hardly cross
    check_overlaps([comb(800, turned=False), comb(800, turned=False)], "a")
    monkeypatch.setattr(outline_checks, "_FEW", 0)
    check_overlaps([comb(20, turned=False), comb(20, turned=True)], "a")


def test_neighbours_with_long_common_borders_are_no_crossing():
    turns = np.linspace(0, 20, 20_000)
    border = np.stack([turns, np.sin(turns)], axis=1)
    left, right = ([*border, (20, y), (0, y)] for y in (9, -9))
    check_overlaps([shapely.Polygon(left), shapely.Polygon(right)], "a")


@pytest.mark.parametrize(
    ("name", "content", "words_"),
    [
        ("a.kml", kml(placemark("1,1 " * 700_000)), "expected at most 600000 commas, got 700000"),
        (
            "b.kml",
            kml(placemark("1,1 " * 250_000)),
            "polygon 1 .*: expected at most 200000 vertices, got 200001",
        ),
        (
            "c.kml",
            kml("<a " + " ".join(f'b{k}=""' for k in range(600_001)) + "/>"),
            "at most 300000 elements and attributes",
        ),
        (
            "b.geojson",
            "[" + "{}," * 4_000_000 + "{}]",
            "expected JSON of at most 600000000 bytes in memory, got about",
        ),
        (
            "c.geojson",
            "[" * 100_000,
            "expected JSON, got lists and objects that are nested too deeply",
        ),
        (
            "d.geojson",
            '{"type": "Point", "type": "Polygon"}',
            "expected each name once, got 'type' again, with 'Polygon'",
        ),
    ],
)
def test_files_over_a_budget_are_refused_in_one_sentence(name, content, words_, tmp_path):
    with pytest.raises(InvalidInputError, match=words_):
        open_region(saved(tmp_path, name, content))


def test_blank_lines_of_a_table_cost_nothing_and_points_have_a_budget(tmp_path, monkeypatch):
    lines = "x_m,y_m\n" + "\n" * 100_000 + "0,0\n9,0\n9,9\n" + "\n" * 100_000
    assert open_region(saved(tmp_path, "a.csv", lines)).area_m2 == 40.5
    monkeypatch.setattr(tables, "MOST_CORNERS", 1000)
    path = saved(tmp_path, "b.csv", "1,1\n" * 1_000_000)
    for read in (
        open_region,
        lambda path: read_points(path, open_region("square:9"), what="launch"),
    ):
        with pytest.raises(InvalidInputError, match="expected at most 1000 points, got 1001"):
            read(path)


def test_nested_placemarks_are_read_once_each(tmp_path):
    many = (
        "<Polygon><outerBoundaryIs><LinearRing><coordinates>"
        + words(FIELD)
        + "</coordinates></LinearRing></outerBoundaryIs></Polygon>"
    )
    nested = "<Placemark>" * 80 + "<name>NFZ 3</name>" + many * 2000 + "</Placemark>" * 80
    with pytest.raises(
        InvalidInputError, match="expected a polygon to search, got only no-go zones"
    ):
        open_region(saved(tmp_path, "a.kml", kml(nested)))


def test_a_zip_that_unpacks_to_gigabytes_is_refused(tmp_path):
    for name, inside in (("a.kmz", "doc.kml"), ("a.zip", "a.shp")):
        with zipfile.ZipFile(tmp_path / name, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(inside, b" " * 30_000_000)
        with pytest.raises(InvalidInputError, match="at most 20000000 bytes"):
            open_region(tmp_path / name)


def test_a_problem_file_with_a_repeated_field_is_refused(tmp_path):
    from shoal.parts import load_problem

    text = (
        json.dumps({"kind": "search", "region": "square:100", "robots": 2})[:-1] + ', "robots": 3}'
    )
    with pytest.raises(
        InvalidInputError, match=r"a.json: expected each name once, got 'robots' again, with 3"
    ):
        load_problem(saved(tmp_path, "a.json", text))


def star(spikes, inner, outer):
    ways = np.arange(2 * spikes) * np.pi / spikes
    far = np.where(np.arange(2 * spikes) % 2, outer, inner)
    return shapely.Polygon(np.stack([far * np.cos(ways), far * np.sin(ways)], axis=1))


def test_a_ring_whose_sides_all_meet_is_refused_before_it_is_checked(monkeypatch):
    monkeypatch.setattr(outline_checks, "MOST_CONTACTS", 1_000_000)
    with pytest.raises(
        InvalidInputError,
        match=r"expected at most 1000000 pairs of sides .* got more, with 10000 vertices",
    ):
        open_region(star(5000, 100, 1000))
    assert open_region(shapely.Point(0, 0).buffer(300, quad_segs=2500)).area_m2 > 0


def test_a_ring_of_spikes_is_refused_before_it_is_planned():
    for shape, footprint in ((star(3000, 100, 1000), 50.0), (star(3000, 100, 110), 10.0)):
        problem = SearchProblem(open_region(shape), robots=2, footprint=footprint)
        with pytest.raises(
            InvalidInputError, match=r"wider than its footprint .* got 6000 sides and a mean width"
        ):
            problem.check_at_place()
    corridor = shapely.LineString([(k * 20.0, 40 * (k % 2)) for k in range(1000)]).buffer(2.5)
    round_field = shapely.Point(0, 0).buffer(300, quad_segs=20_000)
    for shape, footprint in (
        (star(40, 300, 500), 20.0),
        (corridor, 20.0),
        (round_field, 20.0),
        (shapely.box(0, 0, 0.3, 400), 20.0),
    ):
        SearchProblem(open_region(shape), robots=2, footprint=footprint).check_at_place()


def test_shapes_of_a_geopackage_have_a_budget_and_are_never_computed(tmp_path, monkeypatch):
    import pyogrio

    path = tmp_path / "a.gpkg"
    shapes = np.array([shapely.to_wkb(shapely.Polygon(FIELD))] * 20, dtype=object)
    pyogrio.raw.write(
        path, shapes, [], [], crs="EPSG:4326", geometry_type="Polygon", driver="GPKG", layer="a"
    )
    assert open_region(path).area_m2 == pytest.approx(geodesic_area(FIELD), rel=1e-6)
    with closing(sqlite3.connect(path)) as database:
        (column,) = database.execute("SELECT column_name FROM gpkg_geometry_columns").fetchone()
        database.execute(
            "ALTER TABLE a ADD COLUMN huge BLOB GENERATED ALWAYS AS (zeroblob(19000000)) VIRTUAL"
        )
        database.execute("UPDATE gpkg_geometry_columns SET column_name = 'huge'")
        database.commit()
        with pytest.raises(
            InvalidInputError,
            match="layer 'a': expected a stored column 'huge' of shapes, got none",
        ):
            open_region(path)
        database.execute("UPDATE gpkg_geometry_columns SET column_name = ?", (column,))
        database.commit()
    monkeypatch.setattr(geodata, "LARGEST_FILE", 1000)
    with pytest.raises(
        InvalidInputError, match="layer 'a': expected at most 1000 bytes of shapes, got"
    ):
        open_region(path)
