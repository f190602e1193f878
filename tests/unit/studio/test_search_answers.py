"""The place Search: what is drawn is what its file says; plans and missions are the library's."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest
import shapely

import shoal
from shoal.cli import run as run_command
from shoal.core.errors import InvalidInputError
from shoal.core.files import as_json
from shoal.missions import MissionOptions, MissionSet
from shoal.search import SearchProblem, open_region
from shoal.search.planning.plan import end_of, plan_search
from shoal.search.regions.projection import LocalFrame
from shoal.studio.answers import files, search
from shoal.studio.answers.welcome import open_
from shoal.studio.folder import Folder
from shoal.studio.forms import checked_problem
from shoal.studio.work import missions_zip, play

PARTS = [[[-40, -30], [50, -35], [60, 20], [-35, 40]]]
ZONES = [[[0, 0], [12, 0], [12, 10], [0, 10]]]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return Folder(tmp_path)


def about(frame, **more):
    drawing = {"frame": frame, "parts": PARTS, "zones": ZONES}
    problem = {
        "kind": "search",
        "robots": 3,
        "footprint": "10",
        "vehicle": {"preset": "multirotor"},
        "angle": "0",
    }
    return {"problem": problem | more, "drawing": drawing, "frame": frame, "seed": 2}


def test_a_zone_may_be_a_file_where_the_region_is_a_name(folder):
    asked = {"problem": {"kind": "search", "region": "square:100", "robots": 2, "footprint": "10"}}
    asked["problem"]["no_go"] = ["zone.csv"]
    areas = []
    for side in (20, 30):
        corners = [(30, 30), (30 + side, 30), (30 + side, 30 + side), (30, 30 + side)]
        rows = "".join(f"{x},{y}\n" for x, y in corners)
        (folder.root / "zone.csv").write_text("x_m,y_m\n" + rows)
        areas.append(search.plan(folder, asked)["area"])
    assert areas == pytest.approx([100**2 - 20**2, 100**2 - 30**2])


@pytest.mark.parametrize("frame", [None, [8.5, 47.4]])
def test_a_drawn_region_is_planned_as_its_file_is(folder, frame):
    asked = about(frame)
    drawn = search.plan(folder, asked)
    name = search.draw(folder, asked)["file"]
    assert (folder.root / name).suffix == (".csv" if frame is None else ".geojson")
    read = search.plan(
        folder, asked | {"drawing": None, "problem": asked["problem"] | {"region": name}}
    )
    assert read["robots"] == drawn["robots"]
    assert read["makespan"] == drawn["makespan"]
    region = open_region(name)
    assert region.no_go_zones == 1
    assert region.area_m2 == pytest.approx(drawn["area"])
    outline = np.array(drawn["outline"][0][0])
    # where it was drawn
    assert np.abs(outline[:, None] - np.array(PARTS[0])).max(axis=2).min(axis=0).max() < 0.011
    expected = shoal.run(
        SearchProblem(name, robots=3, footprint=10, vehicle="multirotor", angle=0), seed=2
    )
    assert drawn["makespan"] == expected.metrics["planned"]


@pytest.mark.parametrize("frame", [None, [8.5, 47.4]])
def test_a_part_in_another_part_is_searched_too(folder, frame):
    """It is drawn with the tool of regions, and zones have one of their own."""
    over = [[20, -10], [90, -10], [90, 20], [20, 20]]  # more than half of it is in the other part
    asked = about(frame, footprint="20")
    asked["drawing"] |= {"parts": [*PARTS, over], "zones": []}
    drawn = search.plan(folder, asked)
    assert drawn["problem"] is None
    together = shapely.union(shapely.Polygon(PARTS[0]), shapely.Polygon(over))
    assert drawn["area"] == pytest.approx(together.area, abs=0.5)
    name = search.draw(folder, asked)["file"]
    assert open_region(name).area_m2 == pytest.approx(drawn["area"])
    # who says that inner polygons are holes is taken at his word
    asked["problem"]["inner"] = "no-go"
    assert search.plan(folder, asked)["zones"] == 1


@pytest.mark.parametrize("frame", [None, [8.5, 47.4]])
def test_holes_of_a_region_stay_holes_and_its_zones_zones(folder, frame):
    asked = about(frame, footprint="20")
    hole = [[-20, -10], [-10, -10], [-10, 0], [-20, 0]]
    asked["drawing"] |= {"holes": [hole]}
    drawn = search.plan(folder, asked)
    assert drawn["area"] == pytest.approx(shapely.Polygon(PARTS[0]).area - 220, abs=0.5)
    name = search.draw(folder, asked)["file"]
    region = open_region(name)
    assert (region.no_go_zones, len(region.holes)) == (1, 2)  # a zone in it is a hole, too
    opened = asked | {"drawing": None, "problem": asked["problem"] | {"region": name}}
    found = search.outlines(folder, opened)
    assert found["frame"] == (frame and pytest.approx(frame))
    for kind, rings in (("parts", PARTS), ("holes", [hole]), ("zones", ZONES)):
        given, (kept,) = shapely.Polygon(rings[0]), map(shapely.Polygon, found[kind])
        assert shapely.symmetric_difference(given, kept).area < 0.1
    again = search.plan(folder, asked | {"drawing": found})
    assert again["area"] == pytest.approx(drawn["area"], abs=0.1)
    asked["drawing"]["holes"] = [[[200, 0], [210, 0], [210, 10]]]
    with pytest.raises(InvalidInputError, match="hole of part 1: expected a hole inside"):
        search.plan(folder, asked)


def test_zones_are_drawn_over_a_region_that_is_there(folder):
    asked = about(None, region="rectangle:60x40") | {
        "drawing": {"frame": None, "parts": [], "zones": ZONES}
    }
    drawn = search.plan(folder, asked)
    assert drawn["area"] == 60 * 40 - 120
    name = search.draw(folder, asked)["file"]
    assert open_region("rectangle:60x40", no_go=[name]).area_m2 == drawn["area"]


def test_what_is_wrong_is_said_beside_the_region(folder):
    told = search.plan(folder, about(None, launch="900,900", robots=2, vehicle={"preset": "rover"}))
    assert told["outline"]
    assert "problem" in told
    with pytest.raises(InvalidInputError, match="drawn part 1"):
        search.plan(
            folder,
            about(None)
            | {
                "drawing": {"frame": None, "parts": [[[0, 0], [9, 9], [9, 0], [0, 9]]], "zones": []}
            },
        )


def test_polynomials_are_the_projection():
    told = search.earth(None, {"frame": [8.5, 47.4]})
    points = np.random.default_rng(0).uniform(-30_000, 30_000, (50, 2))
    degrees = LocalFrame(8.5, 47.4).to_degrees(points)

    def at(terms, given):
        return sum(np.outer(given[:, 0] ** i * given[:, 1] ** j, [a, b]) for i, j, a, b in terms)

    assert (
        np.abs(at(told["degrees"], points / told["reach"]) - (degrees - (8.5, 47.4))).max() < 1e-9
    )
    assert np.abs(told["reach"] * at(told["metres"], degrees - (8.5, 47.4)) - points).max() < 1e-4


def test_simulations_go_on_as_before_until_a_robot_dies(folder):
    """Who lets a robot die at a moment sees the same search until then."""
    asked = about(None, loss=0.3)
    before = search.simulate(folder, asked)["data"]
    asked["problem"]["faults"] = ["crash:2@6.5"]
    after = search.simulate(folder, asked)["data"]
    early = [one for one in before["robots"][0]["activities"] if one[1] < 6.5]
    assert early == after["robots"][0]["activities"][: len(early)]
    assert after["robots"][1]["activities"][-1][2] == "dead"
    assert after["robots"][1]["activities"][-1][0] == pytest.approx(6.5)


def test_missions_are_a_zip_with_the_report_of_the_check(folder, capsys, monkeypatch):
    name = search.draw(folder, about([8.5, 47.4]))["file"]
    problem = about(None, region=name)["problem"]
    foretold = search.plan(
        folder, {"problem": problem, "missions": {"separation": "20,6"}, "seed": 2}
    )
    done = as_json(
        missions_zip(
            folder,
            {"problem": problem, "missions": {"separation": "20,6"}, "seed": 2},
            lambda *_: None,
        )
    )
    with zipfile.ZipFile(done["file"]) as archive:
        archive.extractall("out")
        assert {"missions/robot-01.plan", "missions/map.png", "check/check.json"} <= {
            *archive.namelist()
        }
    assert json.loads((folder.root / "out/check/check.json").read_text()) == done["check"]
    page = open_(folder, {"file": done["file"]})
    assert page["place"] == "search"
    assert page["given"]["written"] == done
    assert (page["given"]["missions"], page["given"]["seed"]) == ({"separation": "20,6"}, 2)
    assert checked_problem(page["given"]["problem"], folder) == checked_problem(problem, folder)
    figures = sorted(folder.root.glob("*-missions-figure*.png"))
    assert [figure.name for figure in figures] == [done["map"]]  # written once
    assert done["check"]["errors"] == 0
    for ours, theirs in zip(
        foretold["missions"]["starts"], done["missions"]["starts"], strict=True
    ):
        assert {name: ours[name] for name in theirs} == theirs
    monkeypatch.setattr("shoal.views.search.missions.save_figure", lambda *_: None)
    assert run_command([*done["command"].split()[1:], "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["missions"] == done["missions"]
    ours, theirs = (
        sorted(path.glob("*.plan"))
        for path in (folder.root / "missions", folder.root / "out/missions")
    )
    assert [path.read_text() for path in ours] == [path.read_text() for path in theirs]


def test_what_is_shown_is_what_is_simulated_written_and_repeated(folder, monkeypatch):
    """Missions keep a reserve, a margin and start times: the plan that is shown has them too."""
    name = search.draw(folder, about([8.5, 47.4]))["file"]
    problem = about(None, region=name, launch="8.4994,47.3996")["problem"] | {"footprint": "20"}
    asked = {"problem": problem, "missions": {"separation": "20,6"}, "seed": 2}
    shown = search.plan(folder, asked)
    ends = [robot["seconds"] for robot in shown["robots"]]
    assert max(ends) == shown["makespan"]
    written = missions_zip(folder, asked, lambda *_: None)
    starts = [one["start_s"] for one in written["missions"]["starts"]]
    assert max(starts) > 0  # they wait at the launch point that they share
    assert [one["start_s"] for one in shown["missions"]["starts"]] == starts
    assert [one["times"][-1] for one in written["profiles"]] == pytest.approx(ends, abs=0.06)
    assert search.simulate(folder, asked)["makespan"] == pytest.approx(shown["makespan"])
    kept = shoal.load(play(folder, asked, lambda *_: None)["file"])
    assert [end_of(sorties) for sorties in kept.plan.sorties] == pytest.approx(ends)
    names: dict[str, object] = {}
    told = files.copies(folder, asked)
    exec(told["python"], names)
    assert [end_of(sorties) for sorties in names["episode"].plan.sorties] == pytest.approx(ends)
    assert told["command"] == written["command"]
    # without missions, the plan is that of a search alone
    alone = search.plan(folder, asked | {"missions": None})
    assert (
        alone["makespan"]
        == plan_search(checked_problem(problem, folder).opened(), seed=2).planned_seconds
    )
    assert alone["missions"] is None
    assert alone["makespan"] < shown["makespan"]


@pytest.mark.parametrize("made", ["no vehicle", "no missions", "missions", "own margin"])
def test_an_episode_that_is_run_again_has_its_times_and_its_tour(folder, made):
    fields = {"robots": 3, "footprint": 20}
    if made != "no vehicle":
        fields |= {"vehicle": "multirotor", "launch": ((-20.0, -20.0),)}
    if made == "own margin":
        fields |= {"margin": 5.0, "region": "circle:100"}
    problem = SearchProblem(**{"region": "rectangle:300x200", **fields})
    if made in ("missions", "own margin"):
        episode = MissionSet.from_problem(problem, seed=1).run()
    else:
        episode = shoal.run(problem, seed=1)
    episode.save("run.episode.json")
    told = files.settings(folder, {"file": "run.episode.json"})
    assert "note" not in told
    about = {name: told.get(name) for name in ("problem", "drawing", "missions", "seed")}
    again = search.plan(folder, about)
    assert again["tour"] == episode.plan.tour.name
    assert again["makespan"] == pytest.approx(episode.plan.planned_seconds)
    assert search.simulate(folder, about)["makespan"] == pytest.approx(episode.makespan)
    # start times that missions chose are not set: another number of robots has others
    assert told["problem"].keys() <= {"kind", "region", "tour", "allocation", *fields}
    assert search.plan(folder, about | {"problem": told["problem"] | {"robots": 5}})["robots"][4]


def test_an_episode_of_other_missions_says_that_its_plan_is_another(folder):
    problem = SearchProblem(
        "rectangle:300x200", robots=3, footprint=20, vehicle="multirotor", launch=((-20.0, -20.0),)
    )
    options = MissionOptions(separation=60)
    MissionSet.from_problem(problem, options, seed=1).run().save("run.episode.json")
    told = files.settings(folder, {"file": "run.episode.json"})
    assert "delays" in told["problem"]
    plan = search.plan(folder, {name: told.get(name) for name in ("problem", "missions", "seed")})
    same = plan["makespan"] == pytest.approx(shoal.load("run.episode.json").makespan)
    assert same != ("note" in told)


def test_ways_are_corners_in_layers_and_their_length_is_that_of_the_plan(folder, monkeypatch):
    asked = about(None) | {"drawing": None}
    asked["problem"] |= {"region": "box:60x40x20", "robots": 2}
    told = search.plan(folder, asked)
    plan = plan_search(
        SearchProblem("box:60x40x20", robots=2, footprint=10, vehicle="multirotor", angle=0), seed=2
    )
    assert told["layers"] == plan.altitudes
    assert {piece["layer"] for robot in told["robots"] for piece in robot["way"]} == {0, 1}
    for robot, shown in enumerate(told["robots"]):
        points = plan.route(robot, plan.stops(robot)).points
        assert shown["length"] == pytest.approx(
            np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        )
        for piece in shown["way"]:
            level = points[points[:, 2] == plan.altitudes[piece["layer"]], :2]
            corners = np.array(piece["points"])
            assert np.abs(corners[:, None] - level).max(axis=2).min(axis=1).max() < 0.006
            steps = np.diff(corners, axis=0)
            units = steps / np.linalg.norm(steps, axis=1)[:, None]
            assert (np.sum(units[1:] * units[:-1], axis=1) < 0.999).all()
    monkeypatch.setattr(search, "MOST_DRAWN", 3)
    many = search.plan(folder, asked)
    assert (many["drawn"], many["robots"][0]["way"]) == (False, [])
    assert many["robots"][0]["length"] == told["robots"][0]["length"]
