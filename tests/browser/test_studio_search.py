"""The place Search: regions dropped, named and drawn; plans, simulations and missions are the
library's.
"""

from __future__ import annotations

import json
import re
import shlex
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from PIL import Image
from playwright.sync_api import Locator, Page, expect
from tests.browser.studio import Studio, on_plane, run_and_load, tab, written_by
from tests.browser.waiting import settle, until

import shoal
from shoal.cli import run as run_command
from shoal.missions import MissionSet
from shoal.search import SearchEpisode, SearchProblem, open_region
from shoal.search.planning.plan import end_of
from shoal.search.regions.projection import LocalFrame

pytestmark = pytest.mark.browser
FIELD = [(8.5, 47.4), (8.5008, 47.4), (8.5008, 47.4004), (8.5003, 47.40055)]
FAST = {"robots": 2, "footprint": "10", "vehicle": {"preset": "multirotor"}}


def planned(page: Page) -> Locator:
    return page.locator(".search-place .facts:has-text('searched in'):not(.loading)")


def opened(page: Page, studio: Studio, region: str = "square:40", **more: Any) -> None:
    studio.open(page, "search", {"problem": {"region": region, **FAST, **more}, "seed": 1})
    planned(page).wait_for()


def simulated(problem: SearchProblem) -> SearchEpisode:
    """A search as the page plans it: for missions."""
    return MissionSet.from_problem(problem, seed=1).run()


def lasting(seconds: float) -> str:
    if seconds < 59.5:
        return f"{float(f'{seconds:.3g}'):g} s"
    return f"{round(seconds) // 60}:{round(seconds) % 60:02d} min"


def shown(page: Page, **fields: Any) -> None:
    """The plan on the page is that of the library: its time, and each robot's."""
    problem = SearchProblem(**{"footprint": 10, "robots": 2, "vehicle": "multirotor", **fields})
    plan = MissionSet.from_problem(problem, seed=1).scheduled
    planned(page).get_by_text(f"searched in {lasting(plan.planned_seconds)}").wait_for()
    for sorties, row in zip(plan.sorties, page.locator(".fleet button").all(), strict=True):
        assert lasting(end_of(sorties)) in row.inner_text()


def shapefile(folder: Path) -> list[Path]:
    import pyogrio

    shapes = np.array([shapely.to_wkb(shapely.Polygon(FIELD))], dtype=object)
    pyogrio.raw.write(
        folder / "meadow.shp",
        shapes,
        [],
        [],
        crs="EPSG:4326",
        geometry_type="Polygon",
        driver="ESRI Shapefile",
    )
    return sorted(folder.glob("meadow.*"))


@pytest.mark.parametrize("kind", ["geojson", "kml", "shapefile", "zip"])
def test_a_region_is_brought(page: Page, studio: Studio, tmp_path: Path, kind: str) -> None:
    ring = [*FIELD, FIELD[0]]
    if kind == "geojson":
        files = [tmp_path / "meadow.geojson"]
        files[0].write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    elif kind == "kml":
        files = [tmp_path / "meadow.kml"]
        corners = " ".join(f"{x},{y}" for x, y in ring)
        edge = f"<outerBoundaryIs><LinearRing><coordinates>{corners}</coordinates></LinearRing></outerBoundaryIs>"
        files[0].write_text(f"<kml><Placemark><Polygon>{edge}</Polygon></Placemark></kml>")
    else:
        files = shapefile(tmp_path)
        if kind == "zip":
            with zipfile.ZipFile(tmp_path / "packed.zip", "w") as archive:
                for file in files:
                    archive.write(file, f"inside/{file.name}")
            files = [tmp_path / "packed.zip"]
    opened(page, studio)
    page.locator(".search-place .chooser input[type=file]").set_input_files(files)
    page.locator(
        ".search-place .source", has_text="meadow" if kind != "zip" else "packed"
    ).wait_for()
    name = page.locator(".search-place .source").inner_text()
    assert open_region(studio.folder / name).area_m2 == pytest.approx(
        open_region(str(files[-1 if len(files) == 1 else -2])).area_m2
    )
    shown(page, region=str(studio.folder / name))


def test_a_region_is_named_and_simulated_by_keys_alone(page: Page, studio: Studio) -> None:
    opened(page, studio)
    page.get_by_label("By name").focus()
    page.keyboard.press("Control+a")
    page.keyboard.type("rectangle:60x30\n")
    page.locator(".search-place .source", has_text="rectangle:60x30").wait_for()
    shown(page, region="rectangle:60x30")
    episode = run_and_load(page, studio, "Simulate", by_keys=True)
    expected = simulated(SearchProblem("rectangle:60x30", **(FAST | {"footprint": 10})))
    assert episode.trace.covered_at == expected.trace.covered_at


@pytest.mark.forms(0, 3)
def test_a_region_a_zone_and_a_launch_point_are_drawn(page: Page, studio: Studio) -> None:
    opened(page, studio)
    page.get_by_role("button", name="Draw a region", exact=True).click()
    shown = 500.0, 300.0  # an empty canvas

    def click(*points: tuple[float, float]) -> None:
        for spot in on_plane(page, shown, *points):
            page.mouse.click(*spot)

    click((-90, -60), (90, -60), (90, 60), (-90, 60))
    # what closes it is beside the canvas: a corner may be anywhere on it
    closing = page.get_by_role("button", name="Close", exact=True)
    assert closing.evaluate("button => !button.closest('.metric')")
    until(page, "getComputedStyle(document.querySelector('.guide')).pointerEvents === 'none'")
    closing.click()
    planned(page).wait_for()
    page.locator(".zooms").get_by_role("button", name="Show all of it").click()
    shown = 180.0, 120.0
    page.get_by_role("button", name="No-go").click()
    click((-20, -20), (20, -20), (20, 15), (-20, -20))
    page.get_by_role("button", name="Launch").click()
    click((-60, 30))
    page.get_by_role("button", name="Launch point 1").wait_for()
    planned(page).get_by_text("searched in").wait_for()
    episode = run_and_load(page, studio, "Simulate")
    region = episode.plan.grid.region
    assert region.area_m2 == pytest.approx(180 * 120 - 40 * 35 / 2, rel=0.03)
    assert region.no_go_zones == 1
    assert np.abs(episode.plan.places - (-60, 30)).max() < 3
    assert list(studio.folder.glob("drawn-region*.csv"))


def test_corners_are_written_as_a_list_and_taken_back(page: Page, studio: Studio) -> None:
    opened(page, studio)
    page.get_by_role("button", name="Draw a region", exact=True).click()
    page.get_by_text("By numbers").click()
    page.get_by_label("Longitude").fill("8.5")
    page.get_by_label("Latitude").fill("47.4")
    page.get_by_role("button", name="Place it").click()
    page.get_by_text("one longitude, latitude per line").wait_for()
    page.locator("#cornersText").fill("\n".join(f"{x}, {y}" for x, y in FIELD))
    page.get_by_role("button", name="Apply").click()
    planned(page).wait_for()
    page.get_by_label("Which outline").select_option("zones 0")
    page.locator("#cornersText").fill("8.5003, 47.4001\n8.5005, 47.4001\n8.5005, 47.4002")
    page.get_by_role("button", name="Apply").click()
    page.get_by_role("button", name="No-go zone 1, corner 1").wait_for()
    page.get_by_text("By numbers").click()
    page.get_by_role("button", name="Undo").click()
    page.get_by_role("button", name="No-go zone 1, corner 1").wait_for(state="detached")
    page.get_by_role("button", name="Redo").click()
    page.get_by_role("button", name="No-go zone 1, corner 1").wait_for()
    episode = run_and_load(page, studio, "Simulate")
    frame = LocalFrame.around(FIELD)
    zone = shapely.Polygon(
        frame.to_metres([(8.5003, 47.4001), (8.5005, 47.4001), (8.5005, 47.4002)])
    )
    # without the corners that cannot be seen with the margin
    region = episode.plan.grid.region
    assert region.area_m2 + region.unseen_m2 == pytest.approx(
        shapely.Polygon(frame.to_metres(FIELD)).area - zone.area, abs=0.1
    )


def drawn(page: Page) -> dict[str, Any]:
    """What is drawn, as the address has it."""
    told = page.evaluate("JSON.parse(decodeURIComponent(location.hash.split('?')[1])).drawing")
    assert isinstance(told, dict)
    return told


def on_canvas(page: Page, *points: tuple[float, float]) -> list[tuple[float, float]]:
    """Pixels of points in metres: the canvas is measured by its marks in one go."""
    spots = page.evaluate("""[...document.querySelectorAll('.plane .handle')].map((mark) => {
        const box = mark.querySelector('.touch').getBoundingClientRect();
        return [mark.dataset.mark, box.x + box.width / 2, box.y + box.height / 2];
    })""")
    at = {name: (x, y) for name, x, y in spots}
    (ax, ay), (bx, by) = at["launch0"], at["launch1"]  # at (0, 0) and (60, 40)
    return [(ax + x / 60 * (bx - ax), ay + y / 40 * (by - ay)) for x, y in points]


ZONES = [[[5, 5], [15, 5], [15, 15]], [[25, 5], [35, 5], [35, 15]], [[45, 25], [55, 25], [55, 35]]]
PLOT = {
    "problem": {**FAST, "launch": "0,0;60,40"},
    "drawing": {"parts": [[[0, 0], [60, 0], [60, 40], [0, 40]]], "zones": ZONES},
    "seed": 1,
}


@pytest.mark.forms(0)
def test_several_outlines_are_chosen_moved_copied_and_removed(page: Page, studio: Studio) -> None:
    studio.open(page, "search", PLOT)
    planned(page).wait_for()
    page.get_by_role("button", name="Select", exact=True).click()
    begun, ended = on_canvas(page, (2, 2), (40, 20))
    page.mouse.move(*begun)
    page.mouse.down()
    page.mouse.move(*ended, steps=3)
    page.mouse.up()
    page.locator(".guide .hint", has_text="2 outlines, 100 m²").wait_for()
    page.get_by_role("button", name="No-go zone 2, all of it").press("ArrowUp")
    moved = drawn(page)["zones"]
    up = moved[0][0][1] - 5
    assert up > 0
    assert moved == [
        *([[x, round(y + up, 3)] for x, y in zone] for zone in ZONES[:2]),  # type: ignore[misc]
        ZONES[2],
    ]
    page.locator(".plane").press("Control+c")
    page.locator(".plane").press("Control+v")
    copied = drawn(page)["zones"]
    assert len(copied) == 5
    assert [shapely.Polygon(zone).area for zone in copied[3:]] == pytest.approx([50, 50])
    page.locator(".guide").get_by_role("button", name="Delete", exact=True).click()
    assert drawn(page)["zones"] == moved
    page.locator(".plane").press("Control+z")
    assert drawn(page)["zones"] == copied
    for _ in range(2):
        page.locator(".plane").press("Control+z")
    assert drawn(page)["zones"] == ZONES
    page.get_by_role("button", name="No-go zone 3, all of it").press("Space")
    page.get_by_role("button", name="No-go zone 3, all of it", pressed=True).wait_for()


@pytest.mark.forms(0)
@pytest.mark.forms(0, 3)
def test_holes_of_a_file_stay_holes_and_move_with_their_region(page: Page, studio: Studio) -> None:
    def rectangle(x: float, y: float, wide: float, high: float) -> list[list[float]]:
        return [[x, y], [x + wide, y], [x + wide, y + high], [x, y + high]]

    outlines = [("field", 0, 0, 90, 60), ("hole", 20, 20, 20, 20), ("no-go", 60, 20, 20, 20)]
    rows = [f"{x},{y},{name}" for name, *box in outlines for x, y in rectangle(*box)]
    (studio.folder / "holed.csv").write_text("\n".join(["x_m,y_m,ring", *rows]) + "\n")
    opened(page, studio, "holed.csv")
    facts = page.locator(".search-place .facts").inner_text()
    page.get_by_role("button", name="Edit its corners").click()
    page.get_by_role("button", name="Hole 1, corner 1").wait_for(state="attached")
    planned(page).wait_for()
    assert page.locator(".search-place .facts").inner_text() == facts
    told = drawing_of(page)
    assert [len(told[kind]) for kind in ("parts", "holes", "zones")] == [1, 1, 1]
    page.get_by_role("button", name="Region 1, all of it").press("Shift+ArrowRight")
    moved = drawing_of(page)
    by = moved["parts"][0][0][0] - told["parts"][0][0][0]
    assert by > 0
    for kind, far in (("parts", by), ("holes", by), ("zones", 0)):
        assert np.subtract(moved[kind][0], told[kind][0]) == pytest.approx(
            np.array([[far, 0]] * 4), abs=2e-3
        )
    page.get_by_role("button", name="Region 1, all of it").press("Delete")
    assert [len(drawing_of(page)[kind]) for kind in ("parts", "holes", "zones")] == [0, 0, 1]
    for _ in range(3):
        page.keyboard.press("Control+z")
    page.locator(".search-place .source", has_text="holed.csv").wait_for()


def test_a_ruler_measures_between_two_points(page: Page, studio: Studio) -> None:
    studio.open(page, "search", PLOT)
    planned(page).wait_for()
    page.get_by_role("button", name="Ruler", exact=True).click()
    for spot in on_canvas(page, (0, 0), (60, 40)):  # two corners, to which it snaps
        page.mouse.click(spot[0] + 4, spot[1] - 4)
    assert drawn(page)["zones"] == ZONES
    page.locator(".guide .hint", has_text="72.11 m, bearing 56°").wait_for()
    page.get_by_role("button", name="Ruler, end 2").press("Delete")
    page.locator(".guide .hint", has_text="Click where the distance begins").wait_for()


def test_nothing_is_drawn_before_its_place_on_earth_is_known(page: Page, studio: Studio) -> None:
    page.route("**/api/ask/earth", lambda _: None)  # an answer that does not come
    studio.open(page, "search")
    page.get_by_role("button", name="Region 1, corner 1").wait_for(state="attached")
    settle(page)
    assert page.locator("[data-mark^=launch]").count() == 0
    assert page.locator(".graticule path").count() == 0
    page.unroute("**/api/ask/earth")
    planned(page).wait_for()
    assert page.locator("[data-mark=launch0]").count() == 1
    until(page, "document.querySelectorAll('.graticule path').length > 3")


def test_a_launch_point_is_moved_by_keys(page: Page, studio: Studio) -> None:
    opened(page, studio, launch="-10,-10")
    mark = page.get_by_role("button", name="Launch point 1")
    mark.press("Shift+ArrowUp")
    until(page, "document.querySelector('[data-field=launch] input').value !== '-10,-10'")
    moved = page.locator("[data-field=launch] input").input_value()
    assert moved.startswith("-10,-")
    shown(page, region="square:40", launch=moved)
    page.get_by_role("button", name="Launch point 1").press("Delete")
    shown(page, region="square:40")


def player(page: Page) -> Any:
    page.wait_for_selector(".panel:not([hidden]) iframe:not([hidden])")
    found = [
        frame
        for frame in page.frames
        if frame.url.endswith("/play/search") and frame.evaluate("!!window.shoalPlayer")
    ]
    return found[-1]


def test_a_robot_dies_by_a_click_and_messages_are_lost(page: Page, studio: Studio) -> None:
    opened(page, studio)
    run_and_load(page, studio, "Simulate")
    inside = player(page)
    inside.evaluate("shoalPlayer.pause(); shoalPlayer.seek(20.25); shoalPlayer.drawNow()")
    x, y = inside.evaluate("""() => {
        const box = document.getElementById('picture').getBoundingClientRect(), [x, y] = shoalPlayer.points[1];
        // the cells lie over 2.112 m beyond the region
        const scale = Math.min(box.width - 44, box.height - 44) / 44.224;
        return [box.left + box.width / 2 + (x - 20) * scale, box.top + box.height / 2 - (y - 20) * scale];
    }""")
    frame = page.locator(".panel:not([hidden]) iframe:not([hidden])").bounding_box()
    assert frame is not None
    page.mouse.click(frame["x"] + x, frame["y"] + y)
    page.locator(".faults .chip", has_text="Robot 2 dies").wait_for()
    page.get_by_role("button", name="Keep this run").wait_for()
    assert player(page).evaluate("shoalPlayer.time") == 20.25
    page.locator("#searchLoss").fill("0.3")
    page.get_by_text(" messages did not arrive, ").wait_for()
    episode = run_and_load(page, studio, "Keep this run")
    assert episode.problem.to_dict()["faults"] == ["crash:2@20.25"]
    expected = simulated(
        SearchProblem("square:40", faults="crash:2@20.25", loss=0.3, **(FAST | {"footprint": 10}))
    )
    assert (episode.trace.sent, episode.trace.lost) == (expected.trace.sent, expected.trace.lost)
    page.get_by_role("button", name="As Python").click()
    names: dict[str, Any] = {}
    exec(page.locator(".code:visible").inner_text(), names)
    page.keyboard.press("Escape")
    assert names["episode"].trace.covered_at == expected.trace.covered_at
    assert written_by(page, studio, "Player page as HTML").stat().st_size > 50_000
    page.get_by_role("button", name="Take back: Robot 2 dies").click()
    until(page, "!document.querySelector('.faults .chip')")


def test_missions_are_written_and_checked(
    page: Page, studio: Studio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (studio.folder / "paddock.geojson").write_text(
        json.dumps({"type": "Polygon", "coordinates": [[*FIELD, FIELD[0]]]})
    )
    opened(page, studio, "paddock.geojson")
    tab(page, "Missions")
    page.get_by_label("format", exact=True).fill("plan")
    page.get_by_label("format", exact=True).press("Tab")
    page.get_by_role("button", name="Write missions").click()
    with page.expect_download() as download:
        page.get_by_role("link", name="Download the zip").click()
    assert download.value.suggested_filename == "paddock.missions.zip"
    until(page, "document.querySelector('.missionMap img').naturalWidth > 100")
    assert page.locator(".profile .flown").count() == 2
    page.get_by_label("Time", exact=True).fill("0")
    page.locator(".readings", has_text="0 s1sortie 1, 0 m2sortie 1, 0 m").wait_for()
    with zipfile.ZipFile(studio.folder / "paddock.missions.zip") as archive:
        archive.extractall(tmp_path)
    told = json.loads((tmp_path / "check/check.json").read_text())
    assert told["errors"] == 0
    assert (
        f"{float(format(100 * told['covered_fraction'], '.6g')):g} %"
        in page.locator(".measures").inner_text()
    )
    command = shlex.split(page.locator(".missions .code").inner_text())
    measures = page.locator(".measures").inner_text()
    studio.open(page, "start")
    page.locator(".welcome input[type=file]").set_input_files(
        studio.folder / "paddock.missions.zip"
    )
    page.locator(".missions .soft", has_text="paddock-2.missions.zip").wait_for()
    assert page.locator(".measures").inner_text() == measures
    assert page.get_by_label("format", exact=True).input_value() == "plan"
    # a region that is opened is looked at
    page.get_by_role("link", name="Start", exact=True).click()
    page.locator(".welcome input[type=file]").set_input_files(tmp_path / "paddock.geojson")
    page.locator("[role=tab][aria-selected=true]:visible", has_text="Plan").wait_for()
    # the command of the archive runs where it is unpacked: the region is in it
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("shoal.views.search.missions.save_figure", lambda *_: None)
    assert command[-1] == "--format=plan"
    assert run_command([*command[1:], f"--missions={tmp_path / 'again'}"]) == 0
    for name in ("robot-01.plan", "robot-02.plan"):
        assert (tmp_path / "again" / name).read_text() == (tmp_path / "missions" / name).read_text()


ZOOM, FIRST = 17, (68630, 45886)  # column and row of the tile in the north-west of FIELD


def corner_of(column: float, row: float) -> tuple[float, float]:
    """Longitude and latitude of the north-western corner of a tile."""
    turn = np.pi * (1 - 2 * row / 2**ZOOM)
    return 360 * column / 2**ZOOM - 180, float(np.degrees(np.arctan(np.sinh(turn))))


@pytest.mark.forms(0)
def test_map_tiles_of_a_folder_lie_where_they_are_on_earth(page: Page, studio: Studio) -> None:
    for column in (FIRST[0], FIRST[0] + 1):
        place = studio.folder / f"town/{ZOOM}/{column}"
        place.mkdir(parents=True)
        Image.new("RGB", (256, 256), "#88aa66").save(place / f"{FIRST[1]}.png")
    (studio.folder / "paddock.geojson").write_text(
        json.dumps({"type": "Polygon", "coordinates": [[*FIELD, FIELD[0]]]})
    )
    opened(page, studio, "paddock.geojson")
    page.get_by_text("A picture below").click()
    page.get_by_label("Picture below the canvas").select_option("town")
    until(page, "document.querySelectorAll('[data-came=load]').length === 2")
    found = page.evaluate("""(() => {
        const back = document.querySelector('.plane .drawn').getScreenCTM().inverse();
        return [...document.querySelectorAll('[data-tile]')].map((image) => {
            const there = back.multiply(image.getScreenCTM());
            return [image.dataset.tile, [0, 256].map((side) => {
                const point = new DOMPoint(side, side).matrixTransform(there);
                return [point.x, point.y];
            })];
        });
    })()""")
    frame = LocalFrame.around(FIELD)
    for name, corners in found:
        column, row = (int(word) for word in name.split("/")[1:])
        wanted = frame.to_metres([corner_of(column, row), corner_of(column + 1, row + 1)])
        assert np.abs(np.array(corners) - wanted).max() < 0.05
    assert page.get_by_label("Point 1, column of the picture").is_hidden()
    page.locator("#underlayOpacity").fill("0.4")
    expect(page.locator(".plane .tiles")).to_have_attribute("opacity", "0.4")
    page.locator(".plane").press("Control+z")
    expect(page.locator(".plane .tiles")).to_have_attribute("opacity", "0.7")
    studio.open(
        page, "search", {"problem": {"region": "square:40", **FAST}, "under": {"file": "town"}}
    )
    page.get_by_text("A picture below").click()
    page.get_by_text("Tiles have places on Earth, and the region has none").wait_for()
    assert not page.locator(".plane .tiles").is_visible()


def test_a_picture_lies_where_two_points_of_it_are_known(page: Page, studio: Studio) -> None:
    Image.new("RGB", (200, 100), "#88aa66").save(studio.folder / "above.png")
    opened(page, studio)
    page.get_by_text("A picture below").click()
    page.get_by_label("Picture below the canvas").select_option("above.png")
    words = ("column of the picture", "row of the picture", "first coordinate", "second coordinate")
    # 100 pixels to the right are 50 m north
    for point, values in ((1, (20, 80, 0, 0)), (2, (120, 80, 0, 50))):
        for what, value in zip(words, values, strict=True):
            page.get_by_label(f"Point {point}, {what}").fill(str(value))
    page.get_by_role("button", name="Place the picture").click()
    until(
        page,
        "document.querySelector('.plane image').getAttribute('transform')?.startsWith('matrix(0"
        " 0.5')",
    )
    told = page.locator(".plane image").get_attribute("transform")
    assert told is not None
    a, b, c, d, x, y = map(float, told.removeprefix("matrix(").removesuffix(")").split())
    assert np.allclose([a * 20 + c * 80 + x, b * 20 + d * 80 + y], [0, 0])
    assert np.allclose([a * 120 + c * 80 + x, b * 120 + d * 80 + y], [0, 50])
    page.reload()
    page.wait_for_selector("body[data-ready]")
    until(
        page,
        "document.querySelector('.plane image').getAttribute('transform')?.startsWith('matrix(0"
        " 0.5')",
    )


def test_a_vehicle_is_set_or_comes_from_a_file(page: Page, studio: Studio) -> None:
    (studio.folder / "drone.toml").write_text('preset = "multirotor"\ncruise_speed = 7.5\n')
    opened(page, studio)
    page.locator("[data-field=cruise_speed] input").fill("6.5")
    shown(page, region="square:40", vehicle="multirotor,cruise_speed=6.5")
    page.locator("[data-field=cruise_speed] input").fill("")
    page.get_by_label("From a file").select_option("drone.toml")
    shown(page, region="square:40", vehicle="multirotor,cruise_speed=7.5")
    page.get_by_role("button", name="As Python").click()
    page.get_by_role("tab", name="As command").click()
    words = shlex.split(page.locator(".code:visible").inner_text())
    page.keyboard.press("Escape")
    assert "--vehicle=multirotor,cruise_speed=7.5" in words


def test_a_link_opens_the_same_plan(page: Page, studio: Studio) -> None:
    opened(page, studio, "rectangle:80x30", angle="90", margin=2)
    page.get_by_role("button", name="Edit its corners").click()
    page.get_by_role("button", name="Region 1, corner 2").press("Shift+ArrowRight")
    until(page, "document.querySelector('.search-place .source').textContent === 'drawn'")
    page.wait_for_timeout(100)
    planned(page).wait_for()
    told = page.locator(".fleet").inner_text().split("\n")[:2]
    page.reload()
    page.wait_for_selector("body[data-ready]")
    planned(page).wait_for()
    assert page.locator(".fleet").inner_text().split("\n")[:2] == told
    page.get_by_role("button", name="As Python").click()
    page.get_by_role("tab", name="As command").click()
    assert "drawn-region" in page.locator(".code:visible").inner_text()
    page.keyboard.press("Escape")


def test_one_layer_of_a_volume_is_shown_at_a_time(page: Page, studio: Studio) -> None:
    opened(page, studio, "box:60x40x20")
    assert page.get_by_label("Ways of the layer").locator("option").all_inner_texts() == [
        "at 5 m",
        "at 15 m",
        "all together",
    ]
    told = page.evaluate(
        "[...document.querySelectorAll('.ways path')].map((one) => one.getAttribute('d')).join()"
    )
    page.get_by_label("Ways of the layer").select_option("at 15 m")
    above = page.evaluate(
        "[...document.querySelectorAll('.ways path')].map((one) => one.getAttribute('d')).join()"
    )
    page.get_by_label("Ways of the layer").select_option("all together")
    both = page.evaluate(
        "[...document.querySelectorAll('.ways path')].map((one) => one.getAttribute('d')).join()"
    )
    assert len(both) > max(len(told), len(above))
    assert told != above
    opened(page, studio)
    assert page.get_by_label("Ways of the layer").is_hidden()


def test_what_is_wrong_is_said_beside_the_region(page: Page, studio: Studio) -> None:
    opened(page, studio)
    page.locator("[data-field=launch] input").fill("1,2;3,4;5,6")
    page.locator("[data-field=launch] input").press("Tab")
    page.locator(
        ".search-place .warning",
        has_text="launch: expected one point for all, or 2, one per robot, got 3",
    ).wait_for()
    assert page.locator(".plane .land").get_attribute("d")


def test_a_search_of_robots_is_watched(page: Page, studio: Studio) -> None:
    import socket
    import time

    from shoal.robots.tasks import read_task, write_task
    from shoal.search.protocol.messages import Beacon, Heartbeat, Sender
    from shoal.search.run import run

    write_task(run(SearchProblem("rectangle:60x40", robots=2, footprint=20), seed=1), studio.folder)
    task = read_task(studio.folder)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as mouth:
        mouth.bind(("127.0.0.1", 0))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            ear = probe.getsockname()
        opened(page, studio)
        tab(page, "Watch")
        page.get_by_label("Task file in the folder").fill("task.json")
        page.get_by_label("Radio").fill(f"udp:127.0.0.1:{ear[1]},127.0.0.1:9")
        page.get_by_role("button", name="Watch", exact=True).click()
        page.get_by_text("0 % of 6 cells searched").wait_for()
        about = task.scenario.starts[0], task.scenario.rates[0], "searching"
        beacon = Beacon(1, (Heartbeat(1, 5, *about, place=3),), ((1, 0b111),))
        for message in Sender(1, task.key).messages(beacon, time.time_ns() // 1_000_000):
            mouth.sendto(message, ear)
        page.get_by_text("50.0 % of 6 cells searched").wait_for()
        row = page.locator("table:visible tbody tr").first
        assert row.inner_text().split("\t")[:2] == ["1", "searching"]
        assert page.locator("svg.watched rect[fill='#7cc48d']").count() == 3
        page.get_by_role("button", name="Stop watching").click()
        page.get_by_role("button", name="Watch", exact=True).wait_for()


@pytest.mark.chromium("bodies of requests")
def test_a_ring_keeps_its_commas(page, studio):
    """Several values of a field are separated by semicolons."""
    opened(page, studio)
    rings = "ring:10,10:0.5=5,0.9=12; 2*ring:30,30:0.9=8"
    with page.expect_response(lambda reply: reply.url.endswith("/api/ask/plan")) as asked:
        page.evaluate(
            """(text) => {
                const field = document.querySelector("[id^=field-prior-]");
                field.closest("details")?.setAttribute("open", "");
                field.value = text;
                field.dispatchEvent(new Event("change", { bubbles: true }));
            }""",
            rings,
        )
    assert asked.value.request.post_data_json["problem"]["prior"] == rings.split("; ")
    shown(page, region="square:40", prior=rings.split("; "))


def spot_of(page: Page, mark: str) -> tuple[float, float]:
    """The middle of a handle, in pixels of the page."""
    page.locator(f"[data-mark='{mark}']").wait_for()
    # found and measured in one task: a plan that comes replaces all handles
    x, y = page.evaluate(
        "(mark) => { const touch = document.querySelector(`[data-mark='${mark}'] .touch`);"
        " const box = touch.getBoundingClientRect();"
        " return [box.x + box.width / 2, box.y + box.height / 2]; }",
        mark,
    )
    return x, y


def drag(page: Page, start: tuple[float, float], *by: tuple[float, float]) -> None:
    page.mouse.move(*start)
    page.mouse.down()
    for right, down in by:
        page.mouse.move(start[0] + right, start[1] + down)
    page.mouse.up()


def drawing_of(page: Page) -> Any:
    return page.evaluate(
        "JSON.parse(decodeURIComponent(location.hash.split(/\\?(.*)/s)[1])).drawing"
    )


@pytest.mark.forms(0, 1)
def test_shapes_are_dragged_measured_moved_turned_and_snap(page: Page, studio: Studio) -> None:
    field = [[-90, -60], [90, -60], [90, 60], [-90, 60]]
    given = {"robots": 1, "footprint": "20", "vehicle": {"preset": "rover"}}
    drawing = {"frame": None, "parts": [field], "zones": []}
    studio.open(page, "search", {"problem": given, "drawing": drawing})
    page.locator(".search-place .facts:has-text('searched in'):not(.loading)").wait_for()
    size = page.locator(".plane").evaluate("plane => [plane.clientWidth, plane.clientHeight]")
    page.locator(".search-place .facts", has_text="keep apart").wait_for()  # what takes longer
    assert page.locator(".plane").evaluate("one => [one.clientWidth, one.clientHeight]") == size
    page.locator(".plane").scroll_into_view_if_needed()
    for name in ("Farther", "Nearer"):  # from now on the view follows no plan
        page.get_by_role("button", name=name).click()
    settle(page)
    left, _ = spot_of(page, "parts0-3")
    right, there = spot_of(page, "parts0-1")
    scale = (right - left) / 180  # pixels a metre
    # a line more below the canvas moves nothing on it
    facts = page.locator(".search-place .facts")
    facts.evaluate("facts => { facts.style.paddingBottom = '20px'; }")
    settle(page)
    assert spot_of(page, "parts0-1") == pytest.approx((right, there), abs=0.1)
    facts.evaluate("facts => { facts.style.paddingBottom = ''; }")
    settle(page)

    def take_zone(shape: str) -> tuple[float, float]:
        """Where the corner of the field in the north-west is when the tool is in the hand: on a
        phone, the page scrolls to the tool.
        """
        page.get_by_role("button", name="No-go", exact=True).click()
        page.get_by_role("button", name=shape, exact=True).click()
        return spot_of(page, "parts0-3")

    left, top = take_zone("Rectangle")
    start = (left + 40 * scale, top + 70 * scale)
    page.mouse.move(*start)
    page.mouse.down()
    page.mouse.move(start[0] + 40 * scale, start[1] + 20 * scale, steps=3)
    words = page.locator(".measured").inner_text()
    page.mouse.up()
    (zone,) = drawing_of(page)["zones"]
    sides = [abs(zone[0][axis] - zone[2][axis]) for axis in (0, 1)]
    assert sides == pytest.approx([40, 20], abs=0.6)
    found = re.fullmatch(r"([\d.]+) m × ([\d.]+) m, area ([\d.]+) m²", words)
    assert found is not None
    assert [float(word) for word in found.groups()] == pytest.approx([40, 20, 800], abs=25)

    drag(page, spot_of(page, "zones0-all"), (10 * scale, 0), (20 * scale, -10 * scale))
    (moved,) = drawing_of(page)["zones"]
    assert np.array(moved) == pytest.approx(np.add(zone, [20, 10]), abs=0.6)

    page.locator("[data-mark=zones0-all]").focus()
    lever = spot_of(page, "zones0-turn")
    drag(page, lever, (-20, -30), (-44, -44))  # a quarter
    (turned,) = drawing_of(page)["zones"]
    corners = np.array(turned)
    assert np.ptp(corners, axis=0) == pytest.approx([20, 40], abs=0.6)
    assert corners.mean(axis=0) == pytest.approx(np.array(moved).mean(axis=0), abs=0.6)

    corner, goal = spot_of(page, "zones0-0"), spot_of(page, "parts0-2")
    near = (goal[0] - corner[0] - 5, goal[1] - corner[1] + 4)
    drag(page, corner, (near[0] / 2, near[1] / 2), near)
    assert drawing_of(page)["zones"][0][0] == field[2]

    for _ in range(4):
        page.keyboard.press("Control+z")
    assert drawing_of(page)["zones"] == []

    left, top = take_zone("Circle")
    drag(page, (left + 90 * scale, top + 80 * scale), (10, 0), (12 * scale, 0))
    (ring,) = drawing_of(page)["zones"]
    assert np.hypot(*(np.array(ring) - np.mean(ring, axis=0)).T) == pytest.approx(12, abs=0.6)

    left, top = take_zone("Corners")
    for x, y in ((20, 70), (50, 70), (50, 90)):
        page.mouse.click(left + x * scale, top + y * scale)
    page.mouse.move(left + 20 * scale, top + 90 * scale)
    words = page.locator(".measured", has_text="area").inner_text()
    side, bearing, around, size = map(float, re.findall(r"[\d.]+", words)[:4])
    assert [side, bearing, around, size] == pytest.approx([30, 270, 100, 600], rel=0.05)


@pytest.mark.forms(0, 3)
def test_the_plan_that_is_shown_is_written_and_simulated(page: Page, studio: Studio) -> None:
    """With waiting vehicles at one launch point, a plan without missions ends earlier."""
    opened(page, studio, "rectangle:120x80", launch="-10,-10")
    facts = page.locator(".search-place .facts")
    ends = [text.split(" · ")[0] for text in page.locator(".fleet button").all_inner_texts()]
    ends = [end.split("\n")[-1] for end in ends]
    whole = facts.inner_text().partition("searched in ")[2].partition(" ·")[0]
    assert whole in ends
    tab(page, "Missions")
    page.get_by_role("button", name="Write missions").click()
    until(page, "document.querySelector('.missionMap img')?.naturalWidth > 100")
    with zipfile.ZipFile(next(studio.folder.glob("*.missions.zip"))) as archive:
        written = json.loads(archive.read("studio.json"))["written"]
    sorties = written["missions"]["starts"]
    assert [lasting(one["start_s"] + one["duration_s"]) for one in sorties] == ends
    episode = run_and_load(page, studio, "Simulate")
    assert [lasting(end_of(sorties)) for sorties in episode.plan.sorties] == ends
    tab(page, "Missions")
    page.get_by_label("Plan for missions").uncheck()
    tab(page, "Plan")
    planned(page).get_by_text("without the margin, reserve and start times of missions").wait_for()
    alone = shoal.run(
        SearchProblem("rectangle:120x80", **(FAST | {"footprint": 10, "launch": "-10,-10"})), seed=1
    )
    planned(page).get_by_text(f"searched in {lasting(alone.plan.planned_seconds)}").wait_for()
    tab(page, "Missions")
    page.get_by_role("button", name="Write missions").click()
    page.locator(".note", has_text="Switch on “Plan for missions” first").wait_for()


@pytest.mark.forms(0)
def test_a_film_goes_on_while_nobody_looks(page: Page, studio: Studio) -> None:
    """Its frame is hidden then, where Firefox refuses to write on a canvas."""
    opened(page, studio, "rectangle:120x80", robots=3)
    run_and_load(page, studio, "Simulate")
    player(page).evaluate("shoalPlayer.seek(0); shoalPlayer.play()")
    tab(page, "Plan")
    page.wait_for_timeout(300)  # the console stays empty
    tab(page, "Simulate")
    inside = player(page)
    time = inside.evaluate("shoalPlayer.time")
    until(inside, f"shoalPlayer.time > {time}")


@pytest.mark.forms(0)
def test_an_episode_that_is_changed_has_the_settings_that_it_had(
    page: Page, studio: Studio
) -> None:
    problem = SearchProblem("rectangle:120x80", robots=3, footprint=20)
    episode = shoal.run(problem, seed=1)
    episode.save(studio.folder / "field.episode.json")
    studio.open(page, "lab", {"tab": "episodes", "episode": "field.episode.json"})
    page.get_by_role("button", name="Change and run again").click()
    words = f"{episode.plan.tour.name} at 0° from east, {episode.plan.allocation.allocator}"
    planned(page).get_by_text(words).wait_for()
    planned(page).get_by_text(
        f"searched in {lasting(episode.plan.planned_seconds)}, without a vehicle"
    ).wait_for()
    page.locator("[data-field=robots] input").fill("5")
    five = shoal.run(problem.replaced(robots=5), seed=1)
    planned(page).get_by_text(f"searched in {lasting(five.plan.planned_seconds)}").wait_for()
    tab(page, "Missions")
    page.get_by_role("button", name="Write missions").click()
    page.locator(".note", has_text="Choose a vehicle first").wait_for()
    page.locator("[data-field=preset] select").select_option("multirotor")
    page.get_by_role("button", name="Write missions").click()
    until(page, "document.querySelector('.missionMap img')?.naturalWidth > 100")


@pytest.mark.chromium("double clicks")
@pytest.mark.forms(0)
def test_an_outline_is_finished_by_a_double_click_and_outlives_other_tools(
    page: Page, studio: Studio
) -> None:
    studio.open(page, "search")
    planned(page).wait_for()
    begun = drawn(page)
    box = page.locator(".plane").bounding_box()
    assert box is not None

    def at(x: float, y: float) -> tuple[float, float]:
        return box["x"] + x * box["width"], box["y"] + y * box["height"]

    def draft(corners: int) -> None:
        expect(page.locator("circle.corner.draft")).to_have_count(corners)

    page.get_by_role("button", name="Region", exact=True).click()
    page.mouse.click(*at(0.3, 0.3))
    assert drawn(page)["parts"] == []  # the example makes room, with its launch point
    assert page.locator("[data-field=launch] input").input_value() == ""
    assert page.locator(".warning").is_hidden()
    page.mouse.dblclick(*at(0.6, 0.3))
    page.locator(".guide.refuses", has_text="at least three corners").wait_for()
    draft(2)  # and no corner twice
    # another tool sets its point, and the outline is there still
    page.get_by_role("button", name="Launch").click()
    page.locator(".guide", has_text="An outline is still open").wait_for()
    page.mouse.click(*at(0.4, 0.4))
    page.get_by_role("button", name="Launch point 1").wait_for()
    page.get_by_role("button", name="No-go").click()
    page.mouse.click(*at(0.5, 0.5))
    page.locator(".guide.refuses", has_text="An outline is still open").wait_for()
    draft(2)
    page.get_by_role("button", name="Region", exact=True).click()
    page.mouse.click(*at(0.6, 0.6))
    page.mouse.click(*at(0.7, 0.4))
    page.get_by_role("button", name="Close", exact=True).click()  # the pointer moves on the way
    page.locator(".guide .hint:visible", has_text="last side would cross").wait_for()
    page.keyboard.press("Control+z")
    draft(3)
    page.mouse.dblclick(*at(0.3, 0.6))
    planned(page).wait_for()
    assert [len(part) for part in drawn(page)["parts"]] == [4]
    # a region that overlaps another one is added to it
    before = planned(page).inner_text()
    page.get_by_role("button", name="Region", exact=True).click()
    for corner in ((0.6, 0.3), (0.96, 0.3), (0.96, 0.6)):
        page.mouse.click(*at(*corner))
    page.mouse.dblclick(*at(0.6, 0.6))
    until(page, f"!document.querySelector('.facts').textContent.includes({before!r})")
    planned(page).wait_for()
    assert page.locator(".warning").is_hidden()
    assert len(drawn(page)["parts"]) == 2
    for _ in range(5):
        page.keyboard.press("Control+z")
    assert drawn(page) == begun
    planned(page).wait_for()
    page.get_by_role("button", name="Draw a region", exact=True).click()
    page.get_by_role("button", name="Simulate", exact=True).last.click()
    note = page.locator(".note", has_text="Draw a region first")
    note.wait_for()
    assert page.locator(".note.bad").count() == 0


@pytest.mark.forms(0, 1)
def test_nothing_on_the_canvas_covers_the_region_or_its_words(page: Page, studio: Studio) -> None:
    circle = [[-60 + 12 * np.cos(k * np.pi / 24), 12 * np.sin(k * np.pi / 24)] for k in range(48)]
    field = [[-150, -100], [150, -100], [150, 100], [-150, 100]]
    studio.open(
        page,
        "search",
        {
            "problem": FAST | {"footprint": "20"},
            "drawing": {"frame": [8.5, 47.4], "parts": [field], "zones": [circle]},
        },
    )
    planned(page).wait_for()
    boxes = """(names) => [...document.querySelectorAll(names)].map((one) => {
        const box = one.getBoundingClientRect();
        return [box.left, box.top, box.right, box.bottom];
    })"""

    def apart(ours: str, theirs: str) -> bool:
        return not any(
            a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3] and a != b
            for a in page.evaluate(boxes, ours)
            for b in page.evaluate(boxes, theirs)
        )

    settle(page)
    region = "[data-mark^=parts0-]:not([data-mark*='+']):not([data-mark$=all]) .corner"
    assert page.locator(region).count() == 4
    assert apart(region, ".zooms, .scalebar path")
    assert apart(".plane text:not(.head text)", ".plane .words text, .scalebar text")
    # the words of the graticule lie over the region, and not under it
    assert page.evaluate(
        "!!(document.querySelector('.plane .words').compareDocumentPosition("
        "document.querySelector('.plane .part')) & Node.DOCUMENT_POSITION_PRECEDING)"
    )
    # a circle is no necklace of corners, until its cross is chosen
    assert page.locator("[data-mark^=zones0-] .corner").count() == 0
    page.get_by_role("button", name="No-go zone 1, all of it").focus()
    page.get_by_role("button", name="No-go zone 1, corner 1.").wait_for()
    assert page.locator(".marks").inner_text().split("\n") == [
        "start",
        "nearest approach",
        "margin",
    ]
    tab(page, "Missions")
    page.get_by_role("button", name="Write missions").click()
    until(page, "document.querySelector('.missionMap img')?.naturalWidth > 100")
    name = page.locator(".search-place .source").text_content()
    assert page.get_by_label("A file in the folder").input_value() == name


@pytest.mark.forms(0)
def test_no_robot_dies_after_the_end_of_the_search(page: Page, studio: Studio) -> None:
    opened(page, studio)
    run_and_load(page, studio, "Simulate")
    inside = player(page)
    inside.evaluate("shoalPlayer.pause(); shoalPlayer.seek(shoalPlayer.length)")
    page.get_by_role("button", name="Robot 1 dies now").click()
    page.locator(".note", has_text="The search is over").wait_for()
    assert page.locator(".faults .chip").count() == 0
