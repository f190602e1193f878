"""No-go zones in files: in whatever way they are marked, they are kept out of, and counted."""

import json
import zipfile

import numpy as np
import pytest
import shapely

from shoal.cli import run
from shoal.core.errors import InvalidInputError
from shoal.core.xml import DEEPEST, MOST_ELEMENTS
from shoal.search import open_region, region_of
from shoal.search.problem import SearchProblem

FIELD = [(8.50, 47.40), (8.52, 47.40), (8.52, 47.41), (8.50, 47.41), (8.50, 47.40)]
POND = [(8.505, 47.403), (8.509, 47.403), (8.509, 47.406), (8.505, 47.406), (8.505, 47.403)]


def feature(ring, properties=None, **more):
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": "Polygon", "coordinates": [ring]},
        **more,
    }


def geojson(path, *features, **more):
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features, **more}))
    return path


def placemark(ring, more=""):
    words = " ".join(f"{x},{y}" for x, y in ring)
    return (
        f"<Placemark>{more}<Polygon><outerBoundaryIs><LinearRing><coordinates>{words}</coordinates></LinearRing></outerBoundaryIs>"
        "</Polygon></Placemark>"
    )


def kml(*inside):
    return (
        '<?xml version="1.0"?><kml'
        f' xmlns="http://www.opengis.net/kml/2.2"><Document>{"".join(inside)}</Document></kml>'
    )


def is_zone(region):
    """The pond is cut out, and counted."""
    assert [len(part.interiors) for part in region.parts] == [1]
    assert region.no_go_zones == 1
    assert "1 no-go zones" in repr(region)
    return True


PROPERTIES = [
    *(
        {key: True}
        for key in (
            "no_go",
            "no-go",
            "noGo",
            "nogo",
            "NoGo",
            "NO GO",
            "no_fly",
            "noFly",
            "exclusion",
            "nfz",
            "isNoGo",
        )
    ),
    *({"no_fly_zone": value} for value in (1, "yes", "true", "Y", "on", 1.0)),
    *({key: "No-Go"} for key in ("type", "kind", "zone_type", "class", "category", "role")),
    *(
        {"name": name}
        for name in (
            "No-Go pond",
            "NFZ 3",
            "No fly zone",
            "Exclusion",
            "NOGO1",
            "no\u2011go",
            "Airport no-fly zone",
        )
    ),
    {"Name": "Exclusion zone north"},
    {"exclusionZone": True},
    {"type": "exclusion"},
]


@pytest.mark.parametrize("properties", PROPERTIES, ids=str)
def test_properties_of_geojson(tmp_path, properties):
    assert is_zone(
        open_region(geojson(tmp_path / "a.geojson", feature(FIELD), feature(POND, properties)))
    )


def test_geojson_by_id_and_by_collection(tmp_path):
    assert is_zone(
        open_region(
            geojson(tmp_path / "a.geojson", feature(FIELD), feature(POND, None, id="nfz-1"))
        )
    )
    zones = geojson(tmp_path / "zones.geojson", feature(POND), name="No-go zones")
    with pytest.raises(InvalidInputError, match="got only no-go zones"):
        open_region(zones)


@pytest.mark.parametrize("properties", PROPERTIES, ids=str)
def test_properties_of_kml(tmp_path, properties):
    (key, value), path = next(iter(properties.items())), tmp_path / "a.kml"
    marked = [f'<ExtendedData><Data name="{key}"><value>{value}</value></Data></ExtendedData>']
    marked += [
        "<ExtendedData><SchemaData><SimpleData"
        f' name="{key}">{value}</SimpleData></SchemaData></ExtendedData>'
    ]
    if key == "name":
        marked = [f"<name> {value}</name>"]
    for more in marked:
        path.write_text(kml(placemark(FIELD), placemark(POND, more)))
        assert is_zone(open_region(path))


def test_a_folder_of_kml_and_kmz(tmp_path):
    text = kml(
        placemark(FIELD, "<name>Search area</name>"),
        f"<Folder><name>No-go zones</name>{placemark(POND)}</Folder>",
    )
    (tmp_path / "a.kml").write_text(text)
    assert is_zone(open_region(tmp_path / "a.kml"))
    with zipfile.ZipFile(tmp_path / "a.kmz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("files/icon.png", b"")
        archive.writestr("doc.kml", text)
    assert is_zone(open_region(tmp_path / "a.kmz"))


def test_layers_and_tables(tmp_path):
    import pyogrio

    path = tmp_path / "a.gpkg"
    for number, (name, ring) in enumerate((("field", FIELD), ("no_go", POND))):
        shapes = np.array([shapely.to_wkb(shapely.Polygon(ring))], dtype=object)
        more = {"append": True} if number else {}
        pyogrio.raw.write(
            path,
            shapes,
            [],
            [],
            crs="EPSG:4326",
            geometry_type="Polygon",
            driver="GPKG",
            layer=name,
            **more,
        )
    assert is_zone(open_region(path))
    assert is_zone(open_region(path, layer="field"))
    with pytest.raises(InvalidInputError, match="cover wholly"):  # given as zones, all layers are
        open_region(geojson(tmp_path / "f.geojson", feature(FIELD)), no_go=path)
    for driver, suffix in (("GPKG", "gpkg"), ("ESRI Shapefile", "shp")):
        shapes = np.array(
            [shapely.to_wkb(shapely.Polygon(ring)) for ring in (FIELD, POND)], dtype=object
        )
        names, target = np.array(["field", "NFZ pond"], dtype=object), tmp_path / f"names.{suffix}"
        pyogrio.raw.write(
            target,
            shapes,
            [names],
            ["Name"],
            crs="EPSG:4326",
            geometry_type="Polygon",
            driver=driver,
            layer="names",
        )
        assert is_zone(open_region(target))
    rows = [
        f"{x},{y},{ring}" for ring, points in (("a", FIELD), ("no-go", POND)) for x, y in points
    ]
    (tmp_path / "a.csv").write_text("\n".join(["longitude,latitude,ring", *rows]))
    assert is_zone(open_region(tmp_path / "a.csv"))


def test_what_says_no_is_no_zone(tmp_path):
    for properties in (
        {"no_go": False, "name": "No-go?"},
        {"noFly": "no"},
        {"exclusion": None},
        {"name": "Nogoya"},
        {"name": "Pond"},
    ):
        path = geojson(tmp_path / "a.geojson", feature(FIELD), feature(POND, properties))
        assert open_region(path, inner="search").no_go_zones == 0


def test_an_unmarked_polygon_inside_another_is_a_question(tmp_path):
    path = geojson(tmp_path / "a.geojson", feature(FIELD), feature(POND, {"name": "Pond"}))
    with pytest.raises(
        InvalidInputError,
        match=(
            r"a.geojson: feature 2, ring 1: .*expected a mark.*choose with --inner no-go or --inner"
            r" search"
        ),
    ):
        open_region(path)
    assert is_zone(open_region(path, inner="no-go"))
    whole = open_region(path, inner="search")
    assert whole.no_go_zones == 0
    assert whole.area_m2 == pytest.approx(
        open_region(geojson(tmp_path / "b.geojson", feature(FIELD))).area_m2
    )
    mostly = [(x + 0.0117, y) for x, y in POND]  # a little of it is outside
    with pytest.raises(InvalidInputError, match="expected a mark"):
        open_region(geojson(tmp_path / "c.geojson", feature(FIELD), feature(mostly)))
    island = {"type": "Polygon", "coordinates": [FIELD, POND]}
    in_a_hole = [(8.507 + (x - 8.507) / 2, 47.4045 + (y - 47.4045) / 2) for x, y in POND]
    two = geojson(
        tmp_path / "d.geojson",
        {"type": "Feature", "properties": {}, "geometry": island},
        feature(in_a_hole),
    )
    assert len(open_region(two).parts) == 2


def test_the_command_counts_zones(tmp_path, capsys):
    path = geojson(tmp_path / "a.geojson", feature(FIELD), feature(POND))
    words = ["search", str(path), "--footprint", "200", "--robots", "2"]
    assert run([*words, "--json"]) == 2
    assert "--inner" in capsys.readouterr().err
    assert run([*words, "--inner", "no-go", "--json", "--out", str(tmp_path / "out")]) == 0
    assert json.loads(capsys.readouterr().out)["region"]["no_go_zones"] == 1
    assert run(["replay", str(tmp_path / "out" / "episode.json"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["region"]["no_go_zones"] == 1
    assert run([*words, "--inner", "search"]) == 0
    assert "no-go" not in capsys.readouterr().out


def test_a_region_with_zones_goes_through_json():
    region = region_of(
        shapely.box(0, 0, 20, 10),
        no_go=shapely.MultiPolygon([shapely.box(5, 5, 9, 8), shapely.box(12, 2, 14, 4)]),
    )
    again = SearchProblem.from_dict(SearchProblem(region).to_dict()).region
    assert again.no_go_zones == 2
    assert again.no_go.equals(region.no_go)
    assert again.area.equals_exact(region.area)


HOSTILE = {
    **{
        f"{encoding}.kml": kml(placemark(FIELD)).replace('"1.0"?', f'"1.0" encoding="{encoding}"?')
        for encoding in (
            "utf-7",
            "rot13",
            "zlib",
            "idna",
            "big5",
            "gb2312",
            "utf-32",
            "undefined",
            "no-such",
        )
    },
    "surrogate.geojson": (
        '{"type": "Polygon", "coordinates": [], "crs": {"type": "name", "properties": {"name":'
        ' "\\ud800"}}}'
    ),
    "definition.geojson": (
        '{"type": "Polygon", "coordinates": [[[8, 47], [9, 47], [9, 48], [8, 47]]], "crs":'
        ' {"properties": {"name": "' + '{\\"a\\":' * 500 + '"}}}'
    ),
    "deep.kml": "<kml>" + "<Folder>" * (DEEPEST + 5) + "</Folder>" * (DEEPEST + 5) + "</kml>",
    "deep.geojson": '{"type":"GeometryCollection","geometries":[' * 400 + "]}" * 400,
    "entities.kml": '<!DOCTYPE kml [<!ENTITY a "b">]><kml>&a;</kml>',
    "many.kml": "<kml>" + "<a/>" * (MOST_ELEMENTS + 1) + "</kml>",
    "corners.csv": "\n".join(f"{x},{x % 7}" for x in range(200_001)),
    "large.csv": "# " + " " * 20_000_000 + "\n0,0\n1,0\n1,1\n",
    "degrees.csv": "8.50123,47.40123\n8.52123,47.40123\n8.52123,47.41123\n",
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_files_are_read_or_refused_in_a_sentence(tmp_path, name):
    path = tmp_path / name
    path.write_text(HOSTILE[name])
    if name.endswith(".kml") and "encoding" in HOSTILE[name]:
        # what an encoding is called does not matter: the text is UTF-8
        assert open_region(path).no_go_zones == 0
        return
    with pytest.raises(InvalidInputError, match=name) as caught:
        open_region(path)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


def test_a_bomb_in_a_kmz(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.kmz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", b" " * 30_000_000)
    with pytest.raises(InvalidInputError, match="expected at most 20000000 bytes, got more"):
        open_region(tmp_path / "a.kmz")


ENDLESS = (
    "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x AS fid, x AS geom"
    " FROM c"
)


@pytest.mark.parametrize(
    "table", ["field", "gpkg_contents", "gpkg_geometry_columns", "gpkg_spatial_ref_sys"]
)
def test_a_geopackage_with_an_endless_view(tmp_path, table):
    import sqlite3

    import pyogrio

    path = tmp_path / "a.gpkg"
    shapes = np.array([shapely.to_wkb(shapely.Polygon(FIELD))], dtype=object)
    pyogrio.raw.write(
        path, shapes, [], [], crs="EPSG:4326", geometry_type="Polygon", driver="GPKG", layer="field"
    )
    with sqlite3.connect(path) as database:
        for (name,) in database.execute(
            "SELECT name FROM sqlite_master WHERE type = 'trigger'"
        ).fetchall():
            database.execute(f'DROP TRIGGER "{name}"')
        columns = ", ".join(
            f"x AS {row[1]}" for row in database.execute(f"PRAGMA table_info({table})")
        )
        database.execute(f"ALTER TABLE {table} RENAME TO aside")
        database.execute(
            f"CREATE VIEW {table} AS WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM"
            f" c) SELECT {columns} FROM c"
        )
    database.close()
    with pytest.raises(
        InvalidInputError,
        match=rf"a.gpkg: expected a GeoPackage, with the table '{table}', got a view",
    ):
        open_region(path)


@pytest.mark.parametrize(
    "text",
    [
        "POLYGON ((0 0, 1e400 0, 1 1, 0 0))",
        "POLYGON ((0 0, 1e200 0, 1 1e200, 0 0))",
        "GEOMETRYCOLLECTION (" * 5000,
        "POINT (0 0)",
        "POLYGON \ud800",
    ],
)
def test_well_known_text_in_problem_files(text):
    with pytest.raises(InvalidInputError, match=r"^problem: region.*expected"):
        SearchProblem.from_dict({"region": {"name": "region", "area": text, "frame": None}})


def test_tables_in_degrees(tmp_path):
    table = tmp_path / "a.csv"
    ring = [(8.5, 47.4), (8.51, 47.4), (8.51, 47.41), (8.5, 47.41)]
    expected = open_region(geojson(tmp_path / "a.geojson", feature([*ring, ring[0]]))).area_m2
    for heading, order in (("longitude,latitude", 1), ("lat,lon", -1)):
        table.write_text(
            "\n".join([heading, *(",".join(map(str, point[::order])) for point in ring)])
        )
        assert open_region(table).area_m2 == pytest.approx(expected)
    table.write_text("\n".join(["x,y", *(f"{x + 1e-5},{y}" for x, y in ring)]))
    with pytest.raises(
        InvalidInputError,
        match=r"look like degrees; name the columns longitude,latitude or x_m,y_m",
    ):
        open_region(table)
    table.write_text("\n".join(["x_m,y_m", *(f"{x + 1e-5},{y}" for x, y in ring)]))
    assert open_region(table).area_m2 == pytest.approx(1e-4)


def test_swapped_starts_are_named(tmp_path, capsys):
    path, starts = geojson(tmp_path / "a.geojson", feature(FIELD)), tmp_path / "starts.csv"
    starts.write_text("47.405,8.505\n47.406,8.506\n")
    assert (
        run(["search", str(path), "--robots", "2", "--footprint", "200", "--starts", str(starts)])
        == 2
    )
    assert (
        "starts.csv: expected longitude first and then latitude, got (47.405, 8.505), which lies in"
        in capsys.readouterr().err
    )
    starts.write_text("lat,lon\n47.405,8.505\n47.406,8.506\n")
    assert (
        run(
            [
                "search",
                str(path),
                "--robots",
                "2",
                "--footprint",
                "200",
                "--starts",
                str(starts),
                "--json",
            ]
        )
        == 0
    )


def test_a_star_of_many_corners():
    """Ways between its points, around a thousand corners: minutes if each asked anew which
    corners see each other.
    """
    from shoal.search import RegionPaths, cells_of

    angles = 2 * np.pi * np.arange(1000) / 1000
    radius = np.where(np.arange(1000) % 2, 40.0, 100.0)
    region = region_of(
        shapely.Polygon(np.stack([radius * np.cos(angles), radius * np.sin(angles)], axis=1))
    )
    grid = cells_of(region, 40.0)
    route = RegionPaths(grid).route(grid.cells[5:10])
    assert region.reach.covers(shapely.LineString(route.points))
    assert len(route.points) > len(route.stops)


def test_swapped_launch_points_outside_the_region_are_named(tmp_path, capsys):
    path = geojson(tmp_path / "a.geojson", feature(FIELD))
    command = ["search", str(path), "--robots", "1", "--footprint", "200", "--launch"]
    assert run([*command, "47.399,8.499"]) == 2
    said = (
        "launch: expected longitude first and then latitude, got (47.399, 8.499), which lies near"
        " the region if the two"
    )
    assert said in capsys.readouterr().err
    assert run([*command, "120.5,8.499"]) == 2
    assert "within 200 km" in capsys.readouterr().err


def test_a_zone_along_the_border_leaves_no_sliver():
    field = shapely.box(0, 0, 200, 100)
    zone = shapely.Polygon([(50, -30), (150, -30), (150, 30), (50, 30), (50, -1e-5)])
    beside = shapely.Polygon([(0, 2e-6), (0, 100), (-30, 100), (-30, 0)])
    top = shapely.Polygon([(200, 99.9999), (0, 100.0001), (0, 99.99995), (100, 99.99995)])
    region = region_of(field, no_go=shapely.union_all([zone, beside, top.buffer(0)]))
    assert len(region.parts) == 1
    assert region.area_m2 == pytest.approx(200 * 100 - 100 * 30, rel=1e-5)
