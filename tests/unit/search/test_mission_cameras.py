"""What the cameras of written missions see: the images that the commands in the files bring."""

from __future__ import annotations

import json
import math
import re

import numpy as np
import pytest
import shapely
from shapely.affinity import rotate, translate

from shoal.missions import RULES, MissionOptions, MissionSet, check_missions, read_mission
from shoal.search import SearchProblem, region_of
from shoal.search.flight.imaging import (
    GIMBAL,
    TRIGGER,
    CameraItem,
    image_waypoints,
    planned_items,
    views_of,
)
from shoal.search.flight.vehicle import vehicle_of
from shoal.search.regions.projection import LocalFrame

FRAME = LocalFrame(8.5, 47.4)
FIELD = region_of(shapely.box(0, 0, 300, 200), frame=FRAME)
LENS = "multirotor,altitude=60,sensor_width=13.2,sensor_height=8.8,focal_length=8.8"
CAMERA = f"{LENS},side_overlap=0.3,front_overlap=0.7"
WIDE, LONG = 1.5, 1.0  # sides of an image from 1 m


def fly(items, home, *, step=0.05):
    """Return the images (position, heading, height) that an autopilot takes on a mission: an image
    whenever it is the trigger distance away from the last one, and where a command says so.
    """
    here, heading, up = FRAME.to_metres([home])[0], None, 0.0
    distance, last, images = 0.0, here, []
    waiting = False
    for item in items:
        command, params = item["command"], item["params"]
        if command == TRIGGER:
            begins, distance = not distance, params[0]
            if distance and params[2]:
                last = here
                if begins:
                    waiting = True
                else:
                    images.append((here, heading, up))
        if command != 16:
            continue
        there, up = FRAME.to_metres([(params[5], params[4])])[0], params[6]
        length = math.dist(here, there)
        heading = math.atan2(*(there - here)[::-1]) if length else heading
        if waiting:
            images.append((here, heading, up))
            waiting = False
        for share in np.linspace(0, 1, max(int(length / step), 1) + 1) if distance else ():
            place = here + share * (there - here)
            if math.dist(place, last) >= distance - 1e-6:
                images.append((place, heading, up))
                last = place
        here = there
    return images


def seen_by(images):
    """Return the share of the field that images see."""
    shapes = []
    for (x, y), heading, up in images:
        box = shapely.box(-LONG * up / 2, -WIDE * up / 2, LONG * up / 2, WIDE * up / 2)
        shapes.append(translate(rotate(box, math.degrees(heading), origin=(0, 0)), x, y))
    return shapely.union_all(shapes).intersection(FIELD.area).area / FIELD.area_m2


def content_of(path):
    data = json.loads(path.read_text())
    longitude_last = data["mission"]["plannedHomePosition"]
    return data, data["mission"]["items"], (longitude_last[1], longitude_last[0])


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return a function that plans missions for a vehicle, once, and returns their folder."""
    folders = {}

    def write(vehicle, formats=("plan",)):
        if (vehicle, formats) not in folders:
            folder = tmp_path_factory.mktemp("missions")
            # a plain plan: what changed missions see depends on it
            rows = {"tour": "boustrophedon", "angle": 0.0}
            problem = SearchProblem(FIELD, robots=1, vehicle=vehicle, **rows)
            MissionSet.from_problem(problem, MissionOptions(format=formats)).write(folder)
            folders[vehicle, formats] = folder
        return folders[vehicle, formats]

    return write


def changed(folder, tmp_path, change):
    """Return a folder with the mission of another one after a change of its items."""
    data, items, _ = content_of(folder / "robot-01.plan")
    change(items)
    data["mission"]["items"] = [
        item | {"doJumpId": number} for number, item in enumerate(items, start=1)
    ]
    (tmp_path / "robot-01.plan").write_text(json.dumps(data))
    return tmp_path


def check(folder, vehicle=CAMERA, **options):
    return check_missions(folder, FIELD, vehicle=vehicle, **options)


@pytest.mark.parametrize("front", ["", ",front_overlap=0.3", ",front_overlap=0.7"])
@pytest.mark.parametrize("side", [0.0, 0.1, 0.3])
def test_the_images_of_a_mission_see_the_whole_region(written, front, side):
    """The last image of a row was up to a trigger distance before its end: 95.5 % were seen, and
    the check said 100 %.
    """
    vehicle = f"{LENS},side_overlap={side}{front}"
    folder = written(vehicle)
    _, items, home = content_of(folder / "robot-01.plan")
    # the first image faces the way out in place of the first row
    assert seen_by(fly(items, home)) == pytest.approx(1.0, abs=1e-4)
    result = check(folder, vehicle)
    assert result.coverage.covered_fraction == pytest.approx(1.0, abs=1e-5)
    assert not result.diagnostics
    assert result.report()["images"] == "files"


def alone(items):
    """Leave the first and the last command to the camera: no images at bends."""
    triggers = [item for item in items if item["command"] == TRIGGER]
    items[:] = [
        item
        for item in items
        if item["command"] != TRIGGER or item is triggers[0] or item is triggers[-1]
    ]


def pause(items):
    triggers = [item for item in items if item["command"] == TRIGGER]
    triggers[2]["params"][0:3] = [0, 0, 0]


def every(metres):
    def change(items):
        for item in items:
            if item["command"] == TRIGGER and item["params"][0]:
                item["params"][0] = metres

    return change


def at_height(metres):
    def change(items):
        for item in items:
            if item["command"] in (16, 22):
                item["params"][6] = metres

    return change


@pytest.mark.parametrize(
    ("change", "rules"),
    [
        (alone, set()),
        (pause, set()),
        (every(500), {"images"}),
        (every(75), {"images"}),
        (at_height(20), set()),
        (at_height(40), set()),
    ],
)
def test_the_check_sees_what_the_images_of_a_file_see(written, tmp_path, change, rules):
    """All of these said 100 %: the check took neither the commands to the camera nor the height."""
    folder = changed(written(CAMERA), tmp_path, change)
    _, items, home = content_of(folder / "robot-01.plan")
    seen = seen_by(fly(items, home))
    assert seen < 0.998
    result = check(folder)
    # where autopilots differ, the check takes the later image
    assert seen - 0.01 < result.coverage.covered_fraction < seen + 1e-3
    assert {one.rule for one in result.diagnostics} == rules
    assert result.with_errors.covered_fraction <= result.coverage.covered_fraction
    assert result.faults


def no_images(items):
    items[:] = [item for item in items if item["command"] != TRIGGER]


def horizon(items):
    next(item for item in items if item["command"] == GIMBAL)["params"][0] = 0


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (no_images, r"expected images every 18 m \(206\), as the vehicle has a camera, got none"),
        (horizon, "expected a camera pitch of -90°, as the vehicle has, got 0°"),
    ],
)
def test_a_camera_without_images_sees_nothing(written, tmp_path, change, sentence):
    result = check(changed(written(CAMERA), tmp_path, change))
    (mistake,) = result.errors
    assert mistake.rule == "images"
    assert mistake.severity == RULES["images"].severity == "error"
    assert shapely.area(result.coverage.uncovered) == pytest.approx(FIELD.area_m2)
    assert re.search(sentence, mistake.sentence)


@pytest.mark.parametrize("value", [None, 0, -1, 1e-9, 1e300])
@pytest.mark.parametrize(("command", "number"), [(206, 0), (206, 2), (205, 0), (16, 3), (16, 6)])
def test_strange_values_are_said(written, tmp_path, command, number, value):
    def change(items):
        for item in items:
            if item["command"] == command:
                item["params"][number] = value

    result = check(changed(written(CAMERA), tmp_path, change))
    assert 0 <= result.report()["covered_fraction"] <= 1


def test_commands_that_the_check_does_not_follow_are_mistakes(written, tmp_path):
    def look_aside(items):
        place = next(k for k, item in enumerate(items) if item["command"] == TRIGGER)
        items.insert(place, items[place] | {"command": 201, "params": [3, 0, 0, 0, 47.4, 8.5, 0]})

    result = check(changed(written(CAMERA), tmp_path, look_aside))
    (mistake,) = result.errors
    assert mistake.rule == "unchecked-command"
    assert "got 201 (a region of interest)" in mistake.sentence
    assert result.coverage.covered_fraction < 0.2

    def forget(items):
        items[:] = [item for item in items if item["command"] != GIMBAL]

    result = check(changed(written(CAMERA), tmp_path, forget))
    assert [(one.rule, one.severity) for one in result.diagnostics] == [("camera", "warning")]
    assert "the check assumes -90°" in result.diagnostics[0].sentence


def test_the_heading_in_a_file_counts(written, tmp_path):
    """Images that lie slanted over the rows were measured along them."""

    def turn(items):
        for item in items:
            if item["command"] == 16:
                item["params"][3] = 45

    folder = changed(written(CAMERA), tmp_path, turn)
    _, items, home = content_of(folder / "robot-01.plan")
    images = [(place, math.radians(45), up) for place, _, up in fly(items, home)]
    result = check(folder)
    assert result.coverage.covered_fraction == pytest.approx(seen_by(images), abs=1e-3)
    assert result.coverage.covered_fraction < 0.998
    (warning,) = result.diagnostics
    assert "the direction of flight, got 45°" in warning.sentence
    north = written(f"{CAMERA},yaw=0")
    assert read_mission(north / "robot-01.plan").yaw == 0  # north, and not none
    result = check(north, f"{CAMERA},yaw=0")
    assert not result.diagnostics
    assert result.coverage.covered_fraction == pytest.approx(1.0, abs=1e-5)


def test_formats_without_commands_to_a_camera_are_those_of_the_vehicle(written, tmp_path, capsys):
    folder = written(CAMERA, ("plan", "wpl", "kml", "gpx", "csv", "geojson"))
    for name in ("wpl", "kml", "gpx", "csv", "geojson"):
        result = check(folder, format=name)
        assert result.coverage.covered_fraction == pytest.approx(1.0, abs=1e-5), name
        assert result.report()["images"] == ("files" if name == "wpl" else "vehicle")
        assert not result.diagnostics
    table = (folder / "robot-01.csv").read_text()
    (tmp_path / "robot-01.csv").write_text(table.replace(",60,", ",30,"))
    assert check(tmp_path).coverage.covered_fraction < 0.9


def test_a_footprint_does_not_depend_on_the_height(written, tmp_path):
    detector = "multirotor,altitude=60,detector_width=60"
    folder = changed(written(detector), tmp_path, at_height(20))
    assert check(folder, detector).coverage.covered_fraction == 1.0
    assert check(folder, None, footprint=60).report()["images"] is None


def test_the_height_above_a_terrain_counts(written, tmp_path):
    """Ground that is 40 m higher than home leaves images of a third of the size."""
    west, south, step = 8.49, 47.39, 0.001
    heights = np.where(west + step * np.arange(21) > 8.5008, 40, 0)
    grid = tmp_path / "hill.asc"
    grid.write_text(
        f"ncols 21\nnrows 21\nxllcorner {west}\nyllcorner {south}\ncellsize {step}\n"
        + "\n".join([" ".join(map(str, heights))] * 21)
    )
    _, _, home = content_of(written(CAMERA) / "robot-01.plan")
    assert home[0] > 8.501  # on the hill
    seen = check(written(CAMERA), terrain=str(grid)).coverage
    assert seen.covered_fraction == pytest.approx(1.0, abs=1e-5)
    heights = np.where(np.arange(21) <= 10, 40, 0)  # 37 m from the west of the region, and down
    grid.write_text(
        "\n".join(grid.read_text().splitlines()[:5] + [" ".join(map(str, heights))] * 21)
    )
    seen = check(written(CAMERA), terrain=str(grid)).coverage
    assert seen.covered_fraction < 0.95
    assert shapely.union_all(seen.uncovered).centroid.x < 150


def test_images_at_bends():
    camera = vehicle_of(LENS)
    path = np.array([(0.0, 0.0), (50.0, 0.0), (90.0, 0.0), (90.0, 70.0), (20.0, 0.0)])
    assert image_waypoints(path, 60.0, "multirotor").tolist() == [0, 2, 3, 4]
    assert image_waypoints(path, 60.0, "fixed-wing").tolist() == [0, 4]
    assert image_waypoints(path[:1], 60.0, "multirotor").tolist() == [0]
    items = planned_items(path, 0, 60.0, "multirotor")
    # behind the sharp turn, the distance is measured anew
    assert [(item.after, item.value) for item in items] == [
        (1, 60),
        (3, 60),
        (4, 0),
        (4, 60),
        (5, 60),
        (5, 0),
    ]
    whole = np.vstack([path[:1], path, path[:1]])
    raised = np.column_stack([whole, np.full(len(whole), 60.0)])
    assert shapely.union_all(views_of(raised, items, camera)[0]).area > 90 * 90
    low = np.column_stack([whole, np.full(len(whole), -5.0)])
    assert len(views_of(low, items, camera)[0]) == 0
    assert len(views_of(raised, [], camera)[0]) == 0
    infinite = raised.copy()
    infinite[2, :2] = np.inf
    assert np.isfinite(shapely.bounds(views_of(infinite, items, camera)[0])).all()
    millimetres = [CameraItem(1, TRIGGER, 1e-9, at_once=True)]
    assert len(views_of(raised, millimetres, camera)[0]) < 20


def test_a_portrait_image_leaves_no_gap_behind_a_turn():
    """Images as long as they are wide, twice: behind a turn, the next came too late."""
    portrait = vehicle_of(
        "multirotor,altitude=60,sensor_width=4.4,sensor_height=8.8,focal_length=8.8"
    )
    assert portrait.image_size == pytest.approx((30.0, 60.0))
    assert portrait.trigger_distance == 45.0
