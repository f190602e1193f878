"""The first page: its examples, and the page that opens each kind of file."""

from __future__ import annotations

import json
import re
import zipfile
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import shoal
from shoal.core.errors import InvalidInputError
from shoal.studio.answers.welcome import EXAMPLES, PLACES, example, open_
from shoal.studio.folder import Folder
from shoal.studio.forms import checked_problem

STATIC = Path(str(resources.files("shoal.studio") / "static"))
SQUARE = {
    "type": "Polygon",
    "coordinates": [[[8.5, 47.4], [8.504, 47.4], [8.504, 47.402], [8.5, 47.402], [8.5, 47.4]]],
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_example_is_a_problem_of_its_page(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = example(Folder(tmp_path), {"name": name})
    if "problem" in found["given"]:
        parts = {place: part for part, place in PLACES.items()}
        checked_problem(
            {"kind": parts[found["place"]], **found["given"]["problem"]}, Folder(tmp_path)
        )
    with Image.open(STATIC / f"places/welcome/{name}.png") as picture:
        assert picture.size == (480, 300)


def test_the_page_shows_all_examples():
    text = (STATIC / "places/welcome.js").read_text()
    shown = re.findall(r'^  \[\s*"(\w+)",\s*"', text, re.M)
    assert shown == list(EXAMPLES)


def test_the_photograph_is_written_once(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    example(Folder(tmp_path), {"name": "eye"})
    before = (tmp_path / "eye.png").stat().st_mtime_ns
    example(Folder(tmp_path), {"name": "eye"})
    assert (tmp_path / "eye.png").stat().st_mtime_ns == before
    with pytest.raises(InvalidInputError, match="example: expected one of eye"):
        example(Folder(tmp_path), {"name": "lung"})


VEHICLE = {"vehicle": {"preset": "multirotor"}}


def test_each_kind_of_file_is_opened_where_it_belongs(tmp_path):
    folder = Folder(tmp_path)
    Image.fromarray(np.full((9, 9), 200, dtype=np.uint8)).save(tmp_path / "eye.png")
    (tmp_path / "maze.map").write_text("..#\n...\n")
    (tmp_path / "field.geojson").write_text(json.dumps(SQUARE))
    (tmp_path / "field.json").write_text(json.dumps(SQUARE))
    (tmp_path / "corners.csv").write_text("x,y\n0,0\n40,0\n40,40\n")
    (tmp_path / "cells.csv").write_text("0,1\n1,1\n")
    (tmp_path / "room.svg").write_text("<svg/>")
    (tmp_path / "sweep.toml").write_text("name = 'x'\n")
    (tmp_path / "store.sqlite").write_bytes(b"")
    (tmp_path / "problem.json").write_text('{"kind": "steering", "workspace": "square"}')
    (tmp_path / "run.episode.json").write_text("{}")
    expected = {
        "eye.png": ("vessels", {"problem": {"map": "eye.png", "vessels": True}}),
        "maze.map": ("vessels", {"problem": {"map": "maze.map"}}),
        "field.geojson": ("search", {"problem": {"region": "field.geojson"} | VEHICLE}),
        "field.json": ("search", {"problem": {"region": "field.json"} | VEHICLE}),
        "corners.csv": ("search", {"problem": {"region": "corners.csv"} | VEHICLE}),
        "cells.csv": ("vessels", {"problem": {"map": "cells.csv"}}),
        "room.svg": ("steering", {"problem": {"workspace": "room.svg"}}),
        "sweep.toml": ("lab", {"tab": "new", "toml": "name = 'x'\n"}),
        "store.sqlite": ("lab", {"tab": "sweeps", "store": "store.sqlite"}),
        "problem.json": (
            "steering",
            {"problem": {"kind": "steering", "workspace": "square"}, "seed": 0},
        ),
        "run.episode.json": ("lab", {"tab": "episodes", "episode": "run.episode.json"}),
    }
    for name, (place, given) in expected.items():
        assert open_(folder, {"file": name}) == {"place": place, "given": given}


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("film.mp4", "x", "got a file that no page opens"),
        ("list.json", "[1]", "expected a problem with its kind"),
        ("other.json", '{"kind": "house"}', "expected a problem with its kind"),
        ("bad.json", "{", "line 1"),
    ],
)
def test_what_no_page_opens_is_said_in_a_sentence(name, content, told, tmp_path):
    (tmp_path / name).write_text(content)
    with pytest.raises(InvalidInputError, match=told):
        open_(Folder(tmp_path), {"file": name})
    with pytest.raises(InvalidInputError, match="no such file"):
        open_(Folder(tmp_path), {"file": f"missing-{name}"})


@pytest.mark.parametrize(
    ("files", "told"),
    [
        (None, "File is not a zip file"),
        ({"missions/map.png": "x"}, "no item named 'studio.json'"),
        ({"missions/map.png": "x", "studio.json": "{"}, "line 1"),
        (
            {"missions/map.png": "x", "studio.json": '{"problem": {}}'},
            "missions with their problem",
        ),
    ],
)
def test_an_archive_without_the_studios_missions_is_refused(files, told, tmp_path):
    path = tmp_path / "other.missions.zip"
    if files is None:
        path.write_text("no archive")
    else:
        with zipfile.ZipFile(path, "w") as archive:
            for name, text in files.items():
                archive.writestr(name, text)
    with pytest.raises(InvalidInputError, match=told):
        open_(Folder(tmp_path), {"file": "other.missions.zip"})
    assert list(tmp_path.iterdir()) == [path]


def test_an_episode_of_the_folder_names_its_problem(tmp_path, monkeypatch):
    from shoal.studio.answers.files import page

    monkeypatch.chdir(tmp_path)
    shoal.run(shoal.swarm.SwarmProblem("line:5", particles=2), seed=3).save(tmp_path / "run.npz")
    found = page(Folder(tmp_path), {"file": "run.npz"})
    assert (found["problem"]["map"], found["seed"]) == ("line:5", 3)
