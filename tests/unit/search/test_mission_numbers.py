"""Missions with numbers that no vehicle can fly to, and missions as XML in other encodings."""

from __future__ import annotations

import re

import pytest

from shoal.cli import run
from shoal.missions.files import open_sheet, read_mission


@pytest.fixture(scope="module")
def missions(tmp_path_factory):
    folder = tmp_path_factory.mktemp("missions")
    region = folder / "f.geojson"
    ring = [[8.5, 47.4], [8.502, 47.4], [8.502, 47.401], [8.5, 47.401], [8.5, 47.4]]
    region.write_text(f'{{"type": "Polygon", "coordinates": [{ring}]}}')
    for form in ("kml", "gpx"):
        assert (
            run(
                [
                    "search",
                    str(region),
                    "--robots",
                    "1",
                    "--footprint",
                    "40",
                    "--missions",
                    str(folder / form),
                    "--format",
                    form,
                ]
            )
            == 0
        )
    return folder


@pytest.mark.parametrize("form", ["kml", "gpx"])
@pytest.mark.parametrize("number", ["Infinity", "-1e999", "9" * 400])
def test_a_number_without_end_is_one_sentence_wherever_it_stands(
    form, number, missions, tmp_path, capsys
):
    source = missions / form / f"robot-01.{form}"
    text = source.read_text()
    places = [*re.finditer(r"(?<![\w.-])\d+\.\d+(?![\w.])", text)]
    assert len(places) >= 20
    for place in [
        one for one in places if "landing" in text[one.start() - 30 : one.start()]
    ] + places[-3:]:
        (tmp_path / source.name).write_text(text[: place.start()] + number + text[place.end() :])
        capsys.readouterr()
        code = run(["missions", "check", str(tmp_path), str(missions / "f.geojson")])
        printed = capsys.readouterr()
        assert code in (0, 1), printed.err
        assert code == 1 or "<coordinates>" in text, (
            "only heights of a line on the ground have no effect"
        )
    sheet = open_sheet(tmp_path / source.name)
    assert all(len(str(one)) < 300 for one in sheet.diagnostics)


@pytest.mark.parametrize("form", ["kml", "gpx"])
def test_missions_in_the_encoding_that_they_declare(form, missions, tmp_path):
    source = missions / form / f"robot-01.{form}"
    text = source.read_text()
    for encoding in ("UTF-16", "ISO-8859-1"):
        declared = text.replace('encoding="UTF-8"', f'encoding="{encoding}"', 1)
        assert declared != text
        (tmp_path / source.name).write_bytes(declared.encode(encoding))
        assert (
            read_mission(tmp_path / source.name).waypoints == read_mission(source).waypoints
        ).all()
    (tmp_path / source.name).write_bytes(text.encode("utf-16")[:-1])
    (found,) = open_sheet(tmp_path / source.name).diagnostics
    assert (found.rule, found.place) == ("unreadable", "")
