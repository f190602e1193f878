"""Regions from names and files: what is read, and one clear sentence for each that is no region."""

from __future__ import annotations

import json
import re
import sqlite3
from contextlib import closing

import numpy as np
import pytest
import shapely
from pyproj import Geod

from shoal.core.errors import InvalidInputError, UnknownNameError
from shoal.core.geometry import unit_vectors
from shoal.search import LocalFrame, cells_of, coverage_check, open_region, region_of
from shoal.search.regions.outline import RegionOutline, Ring, check_polygon, check_polygons

FIELD = [(8.50, 47.40), (8.52, 47.40), (8.52, 47.41), (8.50, 47.41), (8.50, 47.40)]
POND = [(8.505, 47.403), (8.505, 47.406), (8.509, 47.406), (8.509, 47.403), (8.505, 47.403)]
FIELD_M2 = 1509.3 * 1112.0  # roughly; the geodesic area is asked below


def polygon(*rings, **more):
    return {"type": "Polygon", "coordinates": [list(map(list, ring)) for ring in rings]} | more


def feature(geometry, **properties):
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def collection(*features):
    return {"type": "FeatureCollection", "features": list(features)}


def kml(*placemarks, head='<?xml version="1.0"?>\n'):
    return (
        head
        + '<kml xmlns="http://www.opengis.net/kml/2.2"><Document>\n'
        + "\n".join(placemarks)
        + "\n</Document></kml>\n"
    )


def placemark(coordinates, *, inner=None, more=""):
    hole = (
        f"<innerBoundaryIs><LinearRing><coordinates>{inner}</coordinates></LinearRing></innerBoundaryIs>"
        if inner
        else ""
    )
    return (
        f"<Placemark>{more}<Polygon><outerBoundaryIs><LinearRing><coordinates>{coordinates}</coordinates></LinearRing>"
        f"</outerBoundaryIs>{hole}</Polygon></Placemark>"
    )


def words(ring, *, altitude=",12"):
    return "\n".join(f"{x},{y}{altitude}" for x, y in ring)


def saved(folder, name, content):
    path = folder / name
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def geodesic_area(*rings):
    areas = [
        abs(Geod(ellps="WGS84").polygon_area_perimeter(*np.array(ring).T)[0]) for ring in rings
    ]
    return areas[0] - sum(areas[1:])


# What is read


@pytest.mark.parametrize(
    ("name", "area"),
    [
        ("square:100", 1e4),
        ("rectangle:20x10m", 200),
        ("circle:50", np.pi * 2500),
        ("ring:50x20", np.pi * 2100),
    ],
)
def test_named(name, area):
    region = open_region(name)
    assert region.area_m2 == pytest.approx(area, rel=1e-3)
    assert region.frame is None
    assert region.name == name


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.geojson", polygon(FIELD, POND)),
        ("a.json", feature(polygon(FIELD, POND))),
        (
            "b.geojson",
            collection(
                feature(None),
                feature({"type": "Point", "coordinates": [8, 47]}),
                feature(polygon(FIELD, POND)),
            ),
        ),
        ("c.geojson", collection(feature(polygon(FIELD)), feature(polygon(POND), no_go=True))),
        (
            "d.geojson",
            {
                "type": "MultiPolygon",
                "coordinates": [[list(map(list, FIELD)), list(map(list, POND))]],
            },
        ),
        ("e.geojson", polygon([(*p, 400.0) for p in FIELD], POND)),
        ("f.geojson", {"type": "GeometryCollection", "geometries": [polygon(FIELD, POND)]}),
        (
            "g.geojson",
            polygon(
                FIELD,
                POND,
                crs={"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}},
            ),
        ),
        ("a.kml", kml(placemark(words(FIELD), inner=words(POND, altitude="")))),
        (
            "b.kml",
            kml(placemark(words(FIELD)), placemark(words(POND), more="<name>No-go: pond</name>")),
        ),
        (
            "c.kml",
            kml(
                "<Placemark><Point><coordinates>8,47</coordinates></Point></Placemark>",
                placemark(words(FIELD)),
                placemark(
                    words(POND),
                    more='<ExtendedData><Data name="no_go"><value>1</value></Data></ExtendedData>',
                ),
            ),
        ),
    ],
)
def test_the_same_field_in_many_files(tmp_path, name, content):
    region = open_region(saved(tmp_path, name, content))
    assert region.area_m2 == pytest.approx(geodesic_area(FIELD, POND), rel=1e-6)
    assert [len(part.interiors) for part in region.parts] == [1]
    middle = region.frame.to_metres([(8.507, 47.4045), (8.515, 47.4045)])
    assert region.contains(middle).tolist() == [False, True]
    assert np.allclose(
        region.frame.to_degrees(region.frame.to_metres(FIELD)), FIELD, atol=1e-10, rtol=0
    )


@pytest.mark.parametrize("crs", ["EPSG:4326", "EPSG:32632", "EPSG:3857"])
@pytest.mark.parametrize(("suffix", "driver"), [("gpkg", "GPKG"), ("shp", "ESRI Shapefile")])
def test_layers(tmp_path, crs, suffix, driver):
    import pyogrio
    from pyproj import Transformer

    to = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    rings = [np.stack(to.transform(*np.array(ring).T), axis=1) for ring in (FIELD, POND)]
    shapes = np.array([shapely.to_wkb(shapely.Polygon(ring)) for ring in rings], dtype=object)
    path = tmp_path / f"field.{suffix}"
    pyogrio.raw.write(
        path,
        shapes,
        [np.array([0, 1])],
        ["no_go"],
        crs=crs,
        geometry_type="Polygon",
        driver=driver,
        layer="field",
    )
    region = open_region(path, layer="field")
    assert region.area_m2 == pytest.approx(geodesic_area(FIELD, POND), rel=1e-5)
    assert region.contains(
        region.frame.to_metres([(8.507, 47.4045), (8.515, 47.4045)])
    ).tolist() == [False, True]


def test_geojson_in_another_system(tmp_path):
    from pyproj import Transformer

    ring = np.stack(
        Transformer.from_crs("EPSG:4326", "EPSG:2056", always_xy=True).transform(
            *np.array(FIELD).T
        ),
        axis=1,
    ).tolist()
    region = open_region(
        saved(
            tmp_path,
            "a.geojson",
            polygon(ring, crs={"type": "name", "properties": {"name": "EPSG:2056"}}),
        )
    )
    assert region.area_m2 == pytest.approx(geodesic_area(FIELD), rel=1e-5)


def test_table_with_holes_and_islands(tmp_path):
    rows = [
        "# a yard",
        "x,y",
        "0,0",
        "10,0",
        "10,10",
        "0,10",
        "",
        "2,2",
        "8,2",
        "8,8",
        "2,8",
        "2,2",
        "",
        "4,4",
        "5,4",
        "5,5",
    ]
    region = open_region(saved(tmp_path, "yard.csv", "\n".join(rows)))
    assert region.area_m2 == 100 - 36 + 0.5
    assert len(region.parts) == 2
    labelled = [
        f"{x},{y},{ring}"
        for ring, side in (("a", 4), ("b", 1))
        for x, y in ((0, 5 * side), (side, 5 * side), (side, 6 * side))
    ]
    assert (
        open_region(saved(tmp_path, "two.csv", "x,y,ring\n" + "\n".join(labelled))).area_m2 == 8.5
    )


def test_parts_that_overlap_are_taken_together(tmp_path):
    twice = {"type": "MultiPolygon", "coordinates": [[list(map(list, FIELD))]] * 2}
    assert open_region(saved(tmp_path, "a.geojson", twice)).area_m2 == pytest.approx(
        geodesic_area(FIELD), rel=1e-6
    )


def test_zones_beside_the_region(tmp_path):
    path, pond = (
        saved(tmp_path, "a.geojson", polygon(FIELD)),
        saved(tmp_path, "pond.kml", kml(placemark(words(POND)))),
    )
    expected = geodesic_area(FIELD, POND)
    for zone in (POND, np.array(POND[:-1]), shapely.Polygon(POND), pond, [POND, pond]):
        assert open_region(path, no_go=zone).area_m2 == pytest.approx(expected, rel=1e-6)


def test_a_region_on_two_utm_zones_needs_no_option_because_nothing_is_lost(tmp_path):
    across = [(x - 2.51, y) for x, y in FIELD]
    assert min(x for x, _ in across) < 6 < max(x for x, _ in across)
    region = open_region(saved(tmp_path, "a.geojson", polygon(across)))
    assert region.area_m2 == pytest.approx(geodesic_area(FIELD), rel=1e-6)
    assert 0 < region.scale_error < 1e-8
    assert Geod(ellps="WGS84").line_length(*np.transpose(across)) == pytest.approx(
        region.area.length, rel=1e-6
    )
    wide = open_region([(5.0, 47.0), (7.0, 47.0), (7.0, 47.4), (5.0, 47.4)], geographic=True)
    # measured, and within what the page on regions says for 100 km
    assert 5e-5 < wide.scale_error < 1.2e-4


def test_the_frame_keeps_lengths():
    frame = LocalFrame(8.5, 47.4)
    line = frame.to_degrees([(20_000.0, -5_000.0), (20_000.0, -4_000.0)])
    assert Geod(ellps="WGS84").line_length(*line.T) == pytest.approx(1000.0, rel=5.1e-6)
    assert LocalFrame(frame.longitude, frame.latitude) == frame
    assert LocalFrame.around([(8.1234567, 47.0), (8.2, 47.1)]).longitude == 8.161728


# What is no region

BOW = [(8.50, 47.40), (8.52, 47.41), (8.52, 47.40), (8.50, 47.41), (8.50, 47.40)]
FAR = [(x, y + 3) for x, y in FIELD]


def moved(ring, index, point):
    ring = list(ring)
    ring[index] = point
    return ring


BAD_FILES = {
    "crossing.geojson": (
        polygon(BOW),
        r"ring 1: expected a ring that does not cross.*at \(8.51, 47.405\)",
    ),
    "unclosed.geojson": (
        polygon(FIELD[:-1]),
        r"ring 1, vertex 4: expected a closed ring.*\(8.5, 47.4\), got \(8.5, 47.41\)",
    ),
    "two-points.geojson": (
        polygon([FIELD[0], FIELD[1], FIELD[0]]),
        r"ring 1: expected a ring of 3 different vertices.*got 2",
    ),
    "range.geojson": (
        polygon(moved(FIELD, 2, (208.0, 47.4))),
        r"ring 1, vertex 3: expected a longitude within.*got \(208, 47.4\)",
    ),
    "swapped.geojson": (
        polygon([(y - 57, 151 + x) for x, y in FIELD]),
        r"vertex 1: expected a longitude.*are the two swapped\?",
    ),
    "metres.geojson": (
        polygon([(0, 0), (500, 0), (500, 50), (0, 0)]),
        r"vertex 2: .*is this in metres\?",
    ),
    "nan.geojson": (
        polygon(moved(FIELD, 1, (float("nan"), 47.4))),
        r"ring 1, vertex 2: expected finite coordinates, got \(nan",
    ),
    "infinity.geojson": (
        polygon(moved(FIELD, 1, (8.5, float("inf")))),
        r"ring 1, vertex 2: expected",
    ),
    "empty.geojson": (polygon(), r"expected a polygon with a ring, got an empty one"),
    "empty-ring.geojson": (
        polygon([]),
        r"ring 1: expected a ring of vertices, got an empty one|expected a region with vertices",
    ),
    "no-features.geojson": (collection(), r"expected a Polygon or MultiPolygon, got none"),
    "line.geojson": (
        {"type": "LineString", "coordinates": [[0, 0], [1, 1]]},
        r"expected a Polygon.*got only LineString",
    ),
    "type.geojson": ({"type": "Topology"}, r"expected a GeoJSON Polygon.*got the type 'Topology'"),
    "no-type.geojson": ({"a": 1}, r"expected a GeoJSON Polygon.*got no type"),
    "list.geojson": ([1, 2], r"expected a GeoJSON object, got \[1, 2\]"),
    "hole-outside.geojson": (
        polygon(FIELD, FAR),
        r"ring 2: expected a hole inside its outline, got one outside, at \(",
    ),
    "hole-across.geojson": (
        polygon(FIELD, [(x + 0.014, y) for x, y in POND]),
        r"ring 2: expected a hole inside its outline, got one that crosses it, at \(8.52",
    ),
    "holes-cross.geojson": (
        polygon(FIELD, POND, [(x + 0.001, y + 0.001) for x, y in POND]),
        r"expected holes apart.*at \(8.5",
    ),
    "apart.geojson": (
        collection(feature(polygon(FIELD)), feature(polygon(FAR))),
        r"feature 1, ring 1, vertex 1: .*within 100 km of",
    ),
    "antimeridian.geojson": (
        polygon([(179.9, 10), (-179.9, 10), (-179.9, 10.1), (179.9, 10)]),
        (
            r"ring 1, vertex 2: expected a region that does not cross the 180° meridian, got a step"
            r" from \(179.9, 10\)"
        ),
    ),
    "two-sides.geojson": (
        collection(
            *(feature(polygon([(x, 0), (x + 0.1, 0), (x, 0.1), (x, 0)])) for x in (179.9, -180))
        ),
        r"expected a region that does not cross the 180° meridian, got longitudes from -180 to 180",
    ),
    "pole.geojson": (
        polygon([(0, 89.95), (120, 89.95), (-120, 89.95), (0, 89.95)]),
        r"vertex 1: expected a region away from the poles",
    ),
    "flat.geojson": (
        polygon([(8, 47), (8.1, 47.1), (8.2, 47.2), (8, 47)]),
        r"ring 1: expected a ring with an area inside.*on one line",
    ),
    "broken.geojson": (
        '{"type": "Polygon",\n "coordinates": [[[8, 47], }',
        r"expected JSON, got something else in line 2, column 28",
    ),
    "crs.geojson": (
        polygon(FIELD, crs={"type": "name", "properties": {"name": "EPSG:999999"}}),
        r"expected a known coord.*'EPSG:999999'",
    ),
    "crs-link.geojson": (polygon(FIELD, crs={"type": "link"}), r'expected a "crs" with the name'),
    "word.geojson": (
        polygon(moved(FIELD, 1, ("8.5", 47.4))),
        r"ring 1, vertex 2: expected \[longitude, latitude\], got \['8.5', 47.4\]",
    ),
    "one-number.geojson": (
        polygon(moved(FIELD, 1, (8.5,))),
        r"ring 1, vertex 2: expected \[longitude, latitude\], got \[8.5\]",
    ),
    "no-coordinates.geojson": ({"type": "Polygon"}, r"expected a list of coordinates, got none"),
    "deep.geojson": ("[" * 100_000, r"nested too deeply"),
    "binary.geojson": (
        b"\x89PNG\r\n\x1a\n\x00",
        r"expected text in UTF-8, got byte 0x89 in line 1",
    ),
    "zero.geojson": (b"{}\n\0", r"expected text, got a zero byte in line 2"),
    "nothing.geojson": (b"", r"expected a region file, got an empty file"),
    "zones-only.geojson": (
        feature(polygon(FIELD), no_go=True),
        r"expected a polygon to search, got only no-go zones",
    ),
    "covered.geojson": (
        collection(feature(polygon(FIELD)), feature(polygon(FIELD), no_go=True)),
        r"the no-go zones cover wholly",
    ),
    "columns.csv": (
        "0,0\n1,0,a,b\n1,1\n",
        r"line 2: expected x,y or x,y,ring in metres, got '1,0,a,b' \(4 columns\)",
    ),
    "tabs.csv": ("0\t0\n1\t0\n", r"line 1: .*got '0\\t0' \(1 column\)"),
    "word.csv": (
        "0,0\n1,east\n1,1\n",
        r"line 2: expected two numbers, x,y in metres, got '1,east'",
    ),
    "nan.csv": ("0,0\n1,nan\n1,1\n", r"line 2: expected finite coordinates, got \(1, nan\)"),
    "blank.csv": ("# nothing\n\n", r"expected vertices, one x,y a line, got none"),
    "crossing.csv": (
        "0,0\n2,2\n2,0\n0,2\n",
        r"ring 1 \(from line 1\): expected a ring that does not cross.*at \(1, 1\)",
    ),
    "rings-cross.csv": (
        "0,0\n2,0\n2,2\n0,2\n\n1,1\n3,1\n3,3\n",
        r"ring 2 \(from line 6\): .*crosses ring 1 at \(",
    ),
    "large.csv": ("0,0\n1e12,0\n1,1\n", r"line 2: expected coordinates of at most 1e\+09 m"),
    "no-coordinates.kml": (
        kml("<Placemark><Polygon></Polygon></Placemark>"),
        r"line 3: expected a Polygon with coordinates, got none",
    ),
    "empty-coordinates.kml": (
        kml(placemark(" ")),
        r"polygon 1 \(line 3\), outline: expected coordinates, got none",
    ),
    "altitude.kml": (
        kml(placemark(words(FIELD, altitude=",high"))),
        r"line 3: expected longitude,latitude.*got '8.5,47.4,high'",
    ),
    "blanks.kml": (
        kml(placemark("8.5, 47.4\n8.6, 47.4")),
        r"line 3: .*no blanks beside commas.*'8.5,'",
    ),
    "unclosed.kml": (kml(placemark(words(FIELD[:-1]))), r"line 6: expected a closed ring"),
    "point.kml": (
        kml("<Placemark><Point><coordinates>8,47</coordinates></Point></Placemark>"),
        r"expected a Polygon, got only Point",
    ),
    "tags.kml": (kml("<Placemark>"), r"line 4: expected XML, got something else: mismatched tag"),
    "html.kml": ("<html></html>", r"line 1: expected <kml>, got <html>"),
    "bomb.kml": (
        kml(placemark("&a;"), head='<!DOCTYPE k [<!ENTITY a "x">]>\n'),
        r"line 1: expected XML without a document type, got <!DOCTYPE",
    ),
    "damaged.gpkg": (b"SQLite format 3\0 and no more", r"expected a GeoPackage, got a damaged one"),
    "lonely.shp": (
        b"\0\0\x27\x0a",
        r"expected its index beside it in lonely.shx, got no such file",
    ),
    "field.xyz": ("", r"expected a region file \(.geojson .json .kml .*\), got the suffix '.xyz'"),
    "field.kmz": (b"PK", r"expected a KMZ archive, got a damaged one"),
    "field.zip": (b"PK", r"expected a zip archive, got a damaged one"),
}


@pytest.mark.parametrize("name", BAD_FILES)
def test_bad_files(tmp_path, name):
    content, sentence = BAD_FILES[name]
    path = saved(tmp_path, name, content)
    with pytest.raises(InvalidInputError, match=f"(?s).*{sentence}") as caught:
        open_region(path)
    text = str(caught.value)
    assert str(path) in text
    assert "\n" not in text
    assert len(text) < 400 + len(str(path))


NOTHING_INSIDE = {
    "kmz": "a .kml file in the archive, got none",
    "zip": "an archive with one Shapefile, got 0",
}


@pytest.mark.parametrize("suffix", NOTHING_INSIDE)
def test_an_archive_without_a_region_is_not_called_damaged(tmp_path, suffix):
    path = saved(tmp_path, f"empty.{suffix}", b"PK\5\6" + bytes(18))
    with pytest.raises(InvalidInputError) as caught:
        open_region(path)
    assert str(caught.value) == f"{path}: expected {NOTHING_INSIDE[suffix]}"


def test_shapefile_without_a_system(tmp_path):
    import pyogrio

    path = tmp_path / "field.shp"
    shapes = np.array([shapely.to_wkb(shapely.Polygon(FIELD))], dtype=object)
    pyogrio.raw.write(
        path, shapes, [], [], crs="EPSG:4326", geometry_type="Polygon", driver="ESRI Shapefile"
    )
    path.with_suffix(".prj").unlink()
    with pytest.raises(
        InvalidInputError,
        match=r"expected its coordinate reference system beside it in field.prj, got no such file",
    ):
        open_region(path)


def test_a_zipped_shapefile_is_that_of_its_files_and_leads_nowhere(tmp_path):
    import zipfile

    import pyogrio

    path = tmp_path / "field.shp"
    shapes = np.array([shapely.to_wkb(shapely.Polygon(FIELD))], dtype=object)
    pyogrio.raw.write(
        path, shapes, [], [], crs="EPSG:4326", geometry_type="Polygon", driver="ESRI Shapefile"
    )
    packed = tmp_path / "packed.zip"
    with zipfile.ZipFile(packed, "w") as archive:
        for part in tmp_path.glob("field.*"):
            archive.write(part, f"../deep/{part.name.upper()}")
        archive.writestr("readme.txt", "a field")
    assert open_region(packed).area.equals(open_region(path).area)
    assert {one.name for one in tmp_path.parent.iterdir() if one.name == "deep"} == set()
    with zipfile.ZipFile(packed, "a") as archive:
        archive.writestr("another.shp", b"")
    with pytest.raises(
        InvalidInputError, match=r"packed.zip: expected an archive with one Shapefile, got 2"
    ):
        open_region(packed)
    with zipfile.ZipFile(packed, "w") as archive:
        archive.write(path, "a/field.shp")
    with pytest.raises(
        InvalidInputError, match=r"packed.zip: a/field.shp: expected its index beside it"
    ):
        open_region(packed)


def test_layers_that_are_none(tmp_path):
    import pyogrio

    path = tmp_path / "field.gpkg"
    field, line = (
        np.array([shapely.to_wkb(s)], dtype=object)
        for s in (shapely.Polygon(FIELD), shapely.LineString(FIELD))
    )
    pyogrio.raw.write(
        path, field, [], [], crs="EPSG:4326", geometry_type="Polygon", driver="GPKG", layer="field"
    )
    with pytest.raises(InvalidInputError, match=r"expected one of the layers field, got 'meadow'"):
        open_region(path, layer="meadow")
    pyogrio.raw.write(
        path,
        line,
        [],
        [],
        crs="EPSG:4326",
        geometry_type="LineString",
        driver="GPKG",
        layer="fence",
        append=True,
    )
    with pytest.raises(
        InvalidInputError,
        match=r"expected one layer of shapes, got 2: field, fence; choose with --layer NAME",
    ):
        open_region(path)
    with pytest.raises(
        InvalidInputError, match="expected a Polygon or MultiPolygon, got only LineString"
    ):
        open_region(path, layer="fence")


def test_a_geopackage_is_read_with_the_changes_beside_it(tmp_path):
    """A program that still has the file open keeps its last changes in a second file."""
    import pyogrio

    path, small, large = (
        tmp_path / "field.gpkg",
        shapely.box(8.5, 47.4, 8.501, 47.401),
        shapely.box(8.5, 47.4, 8.502, 47.401),
    )
    wkb = np.array([shapely.to_wkb(small)], dtype=object)
    pyogrio.raw.write(
        path, wkb, [], [], crs="EPSG:4326", geometry_type="Polygon", driver="GPKG", layer="field"
    )
    before = open_region(path).area_m2
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("PRAGMA journal_mode=wal")
        for (name,) in other.execute(
            "SELECT name FROM sqlite_master WHERE type = 'trigger'"
        ).fetchall():
            other.execute(f'DROP TRIGGER "{name}"')
        (blob,) = other.execute("SELECT geom FROM field").fetchone()
        other.execute(
            "UPDATE field SET geom = ?",
            (blob[: -len(wkb[0]) - 32] + bytes(32) + shapely.to_wkb(large),),
        )
        assert path.with_name("field.gpkg-wal").stat().st_size
        assert open_region(path).area_m2 == pytest.approx(2 * before, rel=1e-6)
    assert open_region(path).area_m2 == pytest.approx(2 * before, rel=1e-6)
    with closing(
        sqlite3.connect(path, isolation_level=None)
    ) as other:  # an unfinished change, as after a crash
        other.execute("PRAGMA journal_mode=delete")
        other.execute("PRAGMA cache_size=1")
        other.execute("BEGIN")
        other.execute("UPDATE field SET geom = ?", (blob,))
        other.execute("CREATE TABLE more AS SELECT zeroblob(300000)")
        for name in ("field.gpkg", "field.gpkg-journal"):
            (tmp_path / f"left-{name}").write_bytes((tmp_path / name).read_bytes())
    with pytest.raises(
        InvalidInputError,
        match=r"got one that another program .* with changes in left-field.gpkg-journal",
    ):
        open_region(tmp_path / "left-field.gpkg")


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: open_region("no/such.geojson"), "expected a region file, got no such file"),
        (
            lambda: open_region("square:-3"),
            r"expected square:SIDE with lengths in metres, above 0 .*got '-3'",
        ),
        (lambda: open_region("square:nan"), r"expected square:SIDE with lengths"),
        (lambda: open_region("rectangle:3"), r"expected rectangle:WIDTHxHEIGHT"),
        (lambda: open_region("ring:2x3"), "expected an inner radius below the outer one, 2, got 3"),
        (
            lambda: open_region("square:5", layer="a"),
            "--layer: expected a GeoPackage or a plan of QGroundControl",
        ),
        (
            lambda: open_region("square:5", no_go=[(0, 0), (9, 0), (9, 9), (-9, 9), (-9, -9)]),
            "cover wholly",
        ),
        (
            lambda: open_region("square:5", no_go=[(0, 0), (1, 1)]),
            "no-go zone 1: expected a ring of 3 different vertices or more, got 2",
        ),
        (
            lambda: open_region("square:5", no_go=shapely.Point(0, 0)),
            "no-go zone 1: expected a polygon, got Point",
        ),
        (lambda: open_region("square:5", no_go=7), "no-go zone 1: expected"),
        (
            lambda: region_of(shapely.Point(0, 0)),
            "expected a Shapely Polygon or MultiPolygon, got Point",
        ),
        (
            lambda: region_of(shapely.Polygon()),
            "expected a region with an area to search, got an empty one",
        ),
        (
            lambda: region_of(shapely.Polygon([(0, 0), (2, 2), (2, 0), (0, 2)])),
            r"self-intersection at \(1, 1\) in part 1",
        ),
        (
            lambda: region_of(shapely.box(0, 0, 9, 9), no_go=shapely.box(2, 2, 5, 5)).check_inside(
                [(3, 3)]
            ),
            r"start: .*got \(3, 3\) m at point 1, 1 m inside the no-go zone around \(3.5, 3.5\)",
        ),
        (
            lambda: open_region("square:5").check_inside([(1, 1), (6, 1)]),
            r"start: .*got \(6, 1\) m at point 2, 1 m outside",
        ),
        (
            lambda: open_region("square:5").contains([(1, np.nan)]),
            r"expected finite numbers, got \(1.0, nan\) at point 1",
        ),
        (
            lambda: cells_of(open_region("square:5"), 0),
            "footprint: expected a number, above 0, got 0",
        ),
        (
            lambda: cells_of(open_region("square:5"), float("nan")),
            "footprint: expected a number, above 0",
        ),
        (lambda: cells_of(open_region("square:5"), -2), "footprint: expected a number, above 0"),
        (
            lambda: cells_of(open_region("square:5"), 1, size=2),
            "cell size: expected at most the footprint, 1 m, got 2 m",
        ),
        (
            lambda: cells_of(open_region("square:50000"), 1),
            "at most 4000000 cells, got 50000 times 50000 .*needs about 25 m or more",
        ),
        (lambda: cells_of(open_region("square:50"), 1e-300), "at most 4000000 cells"),
        (
            lambda: cells_of(open_region("square:50"), 10).viewpoints_in((5, 0)),
            r"expected cells of the region, got \(5, 0\) at place 1",
        ),
        (
            lambda: coverage_check(open_region("square:5"), [], -1),
            "footprint: expected a length above 0",
        ),
        (
            lambda: coverage_check(open_region("square:5"), [[(0, np.inf)]], 1),
            "route 1: expected finite numbers",
        ),
        (lambda: LocalFrame(0, 95), "latitude: expected a number from -89.9 to 89.9, got 95"),
        (
            lambda: LocalFrame(0, 0).to_metres([(9, 9)]),
            r"within 200 km of the origin \(0, 0\), got \(9, 9\)",
        ),
    ],
)
def test_bad_values(call, sentence):
    with pytest.raises(InvalidInputError, match=sentence):
        call()


def test_unknown_names():
    with pytest.raises(
        UnknownNameError, match=r"unknown region 'sqare:5': did you mean 'square'\?"
    ):
        open_region("sqare:5")


def test_a_start_outside_says_where_on_earth(tmp_path):
    region = open_region(saved(tmp_path, "a.geojson", polygon(FIELD)))
    with pytest.raises(
        InvalidInputError,
        match=(
            r"start: .*\(longitude and latitude \(8.53\d*, 47.405\d*\)\) at point 1, 75\d m outside"
        ),
    ):
        region.check_inside(region.frame.to_metres([(8.53, 47.405)]))


def test_folder(tmp_path):
    with pytest.raises(InvalidInputError, match="expected a region file, got a folder"):
        open_region(tmp_path)


def test_a_ring_that_is_cut_where_it_only_touches_is_measured():
    """The area is cut into blocks; a cut through the ring's extreme points left lines beside
    polygons, which GEOS refused.
    """
    ring = open_region("ring:60x30")
    ways = [[(x, y) for y in range(-60, 61)] for x in range(-60, 61)]
    assert coverage_check(ring, ways, 10).covered_fraction == 1.0


def test_polygons_are_points_or_shapes_in_metres_or_degrees():
    corners, hole = (
        [(8.5, 47.4), (8.504, 47.4), (8.504, 47.402), (8.5, 47.402)],
        [(8.501, 47.4005), (8.502, 47.4005), (8.502, 47.401)],
    )
    region = open_region(corners, holes=[hole], geographic=True, name="field")
    same = open_region(shapely.Polygon(corners, [hole]), geographic=True, name="field")
    assert (region.name, len(region.parts[0].interiors)) == ("field", 1)
    assert region.frame is not None
    assert region.area.equals(same.area)
    assert region.area_m2 == pytest.approx(67_000 - 2_100, rel=0.01)
    shapes, hole = (
        [np.array([(0, 0), (9, 0), (9, 9)]), shapely.box(20, 0, 30, 10)],
        [(21, 1), (22, 1), (22, 2)],
    )
    two = open_region(shapes, holes=hole, no_go=[shapely.box(25, 0, 26, 1)])
    assert (len(two.parts), two.no_go_zones, two.area_m2) == (2, 1, 40.5 + 100 - 0.5 - 1)
    with pytest.raises(InvalidInputError, match="hole 1: expected a hole inside a polygon"):
        open_region([(0, 0), (9, 0), (9, 9)], holes=[(20, 20), (21, 20), (21, 21)])
    with pytest.raises(InvalidInputError, match="polygon 1: expected a Shapely polygon or points"):
        open_region([1, 2, 3])
    with pytest.raises(InvalidInputError, match="polygon 1: expected a Shapely polygon or points"):
        open_region([(0, 0), (10**400, 0), (9, 9)])
    with pytest.raises(InvalidInputError, match="footprint: expected a length above 0"):
        coverage_check(two, [[(1, 1)]], 10**400)
    with pytest.raises(InvalidInputError, match="polygon, vertex 1: expected"):
        open_region([(500, 0), (9, 0), (9, 9)], geographic=True)
    with pytest.raises(InvalidInputError, match="expected polygons together with holes"):
        open_region("square:10", geographic=True)


@pytest.mark.parametrize("closed", [True, False])
def test_many_polygons_are_checked_as_one_by_one(closed):
    rng = np.random.default_rng(1)
    outlines = []
    for k in range(400):
        count = int(rng.integers(3, 12))
        around = unit_vectors(np.sort(rng.uniform(0, 2 * np.pi, count)))
        points = around * rng.uniform(0.5, 3, (count, 1)) + rng.uniform(0, 100, 2)
        points = np.insert(points, 1, points[1], axis=0) if k % 9 == 1 else points
        points = np.vstack([points, points[:1]]) if closed or k % 9 == 2 else points
        points[2] = np.nan if k % 50 == 3 else points[2]
        points[1:-1] = points[0] if k % 50 == 4 else points[1:-1]
        outlines.append(RegionOutline(Ring(points, f"ring {k}")))
    good = []
    for outline in outlines:
        try:
            good.append((outline, check_polygon(outline, closed=closed)))
        except InvalidInputError as error:
            with pytest.raises(InvalidInputError, match=re.escape(str(error))):
                check_polygons([outlines[0], outline], closed=closed)
    together = check_polygons([outline for outline, _ in good], closed=closed)
    assert 300 < len(good) < 400
    assert all(
        shapely.equals_exact(one, other, 0) for one, (_, other) in zip(together, good, strict=True)
    )
