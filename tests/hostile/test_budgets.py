"""Files that would need gigabytes or minutes are refused before the work, or read, in a process of
1 GiB.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import zipfile

import pytest

from shoal.core.checks import parse_json, parse_toml
from shoal.core.errors import InvalidInputError
from shoal.lab import Sweep
from shoal.search.flight.vehicle import vehicle_of

KML = (
    '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document>{}</Document></kml>'
)
SQUARE = [[8.5, 47.4], [8.51, 47.4], [8.51, 47.41], [8.5, 47.41], [8.5, 47.4]]
RUN = """
import resource, sys
from shoal.cli import run
resource.setrlimit(resource.RLIMIT_DATA, (2**30, 2**30))
resource.setrlimit(resource.RLIMIT_CPU, (100, 100))
for path in sys.argv[1:]:
    print("==", path, file=sys.stderr)
    command = ["sweep", "run", path, "--store", path + ".sqlite"] if path.endswith(".toml") else ["search", path]
    command += ["--workers", "0"] if path.endswith(".toml") else ["--robots", "1", "--footprint", "300"]
    print("=> ", run(command), file=sys.stderr)
"""


def star(spikes):
    points = []
    for k in range(2 * spikes):
        far, way = (0.001, 0.01)[k % 2], math.pi * k / spikes
        points.append([8.5 + far * math.cos(way), 47.4 + far * math.sin(way)])
    return [*points, points[0]]


def test_each_hostile_file_needs_less_than_a_gibibyte(tmp_path):
    def collection(rings):
        shapes = [{"type": "Polygon", "coordinates": [ring]} for ring in rings]
        return json.dumps({"type": "GeometryCollection", "geometries": shapes})

    files = {
        "dotted.toml": 'name = "a"\n' + ".".join(["a"] * 50_000) + " = 1\n",
        "header.toml": "[" + ".".join(["a"] * 50_000) + "]\n",
        "equal.geojson": collection([SQUARE] * 2000),
        "spikes.geojson": collection([star(3000)]),
        "spikes-100000.geojson": collection([star(50_000)]),
        "deep.geojson": "[" * 1_000_000,
        "objects.geojson": "[" + "{}," * 4_000_000 + "{}]",
        "corners.kml": KML.format(
            "<Polygon><coordinates>" + "1,1 " * 1_000_000 + "</coordinates></Polygon>"
        ),
        "attributes.kml": KML.format("<a " + " ".join(f'b{k}=""' for k in range(700_000)) + "/>"),
        "points.csv": "x_m,y_m\n" + "0,0\n" * 1_000_000,
    }
    paths = []
    for name, text in files.items():
        (tmp_path / name).write_text(text)
        paths.append(str(tmp_path / name))
    for name, inside in (("bomb.kmz", "doc.kml"), ("bomb.zip", "a.shp")):
        with zipfile.ZipFile(tmp_path / name, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr(inside, b" " * 100_000_000)
        paths.append(str(tmp_path / name))
    done = subprocess.run(
        [sys.executable, "-c", RUN, *paths], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    blocks = done.stderr.split("== ")[1:]
    assert len(blocks) == len(paths)
    for block in blocks:
        path, *said, code = block.splitlines()
        if path.endswith("equal.geojson"):
            assert code.split() == ["=>", "0"], block
        else:
            assert code.split() == ["=>", "2"], block
            assert len(said) == 1, block
            assert said[0].startswith("shoal: "), block
            assert "out of memory" not in said[0]


def test_keys_of_toml_have_a_budget_and_texts_have_not(tmp_path):
    deep = ".".join(["a"] * 11)
    for text in (
        f"{deep} = 1",
        f"x = {{{deep} = 1}}",
        f"[{deep}]",
        'a."b.c".' + deep + " = 1",
        "a = 1\n[[" + deep + "]]",
    ):
        with pytest.raises(InvalidInputError, match="a: expected keys of at most 10 parts, got"):
            parse_toml(text, where="a")
    kept = (
        f'a = "{deep}" # {deep}\nb = \'{deep}\'\nc = """\n{deep} \\" {deep}\n"""\nd.e.f.g ='
        f' 1.5\n"{deep}" = [0.1, 1e-3]'
    )
    assert parse_toml(kept, where="a")["d"] == {"e": {"f": {"g": 1.5}}}
    with pytest.raises(
        InvalidInputError, match="a: expected at most 100000 keys, tables and lists, got 100001"
    ):
        parse_toml("a=1\n" * 100_001, where="a")
    with pytest.raises(
        InvalidInputError, match="a: expected at most 500000 values in lists, got 500001 or more"
    ):
        parse_toml("a=[" + "1," * 500_001 + "]", where="a")
    (tmp_path / "v.toml").write_text(f'preset = "multirotor"\n{deep} = 1\n')
    with pytest.raises(InvalidInputError, match=r"v\.toml: expected keys of at most 10 parts"):
        vehicle_of(str(tmp_path / "v.toml"))


def test_repeated_names_are_refused_in_every_file_of_a_user(tmp_path):
    for name, text, read in (
        ("a.toml", 'name = "a"\nseed = 1\nseed = 2\n', Sweep.load),
        ("b.toml", 'preset = "rover"\npreset = "multirotor"\n', lambda path: vehicle_of(str(path))),
        (
            "c.json",
            '{"preset": "rover", "cruise_speed": 1, "cruise_speed": 2}',
            lambda path: vehicle_of(str(path)),
        ),
    ):
        (tmp_path / name).write_text(text)
        with pytest.raises(InvalidInputError, match=r"each (key|name) once, got") as told:
            read(tmp_path / name)
        assert "\n" not in str(told.value)
    assert parse_json('{"a": {"b": 1}, "c": {"b": 1}}', where="a") == {"a": {"b": 1}, "c": {"b": 1}}
