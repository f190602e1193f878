"""The first page of the studio: examples by a click, and any file opened where it belongs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page
from tests.browser.studio import Form, Studio
from tests.browser.waiting import until

import shoal
from shoal.search.problem import SearchProblem
from shoal.steering import SteeringProblem
from shoal.swarm import SwarmProblem

pytestmark = pytest.mark.browser
REGION = {
    "type": "Polygon",
    "coordinates": [[[8.5, 47.4], [8.502, 47.4], [8.502, 47.401], [8.5, 47.401], [8.5, 47.4]]],
}


def test_the_first_page_needs_twelve_files_at_most(
    chromium: Browser, page: Page, studio: Studio
) -> None:
    context = chromium.new_context(storage_state=page.context.storage_state())
    other, asked = context.new_page(), set[str]()
    other.on("request", lambda request: asked.add(request.url))
    other.goto(studio.root)
    other.wait_for_selector("body[data-ready]")
    other.locator(".welcome .card img").last.wait_for()
    context.close()
    files = {address for address in asked if "/api/" not in address}
    assert {f"{studio.root}studio.js", f"{studio.root}studio.css"} < files
    assert len(files) <= 12


def test_an_example_runs_by_a_click(page: Page, studio: Studio, form: Form) -> None:
    studio.open(page)
    assert page.title().startswith("Start")
    page.get_by_role("button", name="Dying robots").click()
    page.locator(".panel:not([hidden]) .exports").wait_for()
    page.get_by_text("complete: all 841 cells").wait_for()
    page.get_by_role("link", name="Start", exact=True).click()
    page.get_by_role("button", name="A race").click()
    page.wait_for_selector(".pad:not([hidden])")


def test_files_of_the_folder_are_on_the_first_page(page: Page, studio: Studio) -> None:
    episode = shoal.run(SwarmProblem("line:7", particles=1), seed=2)
    episode.save(studio.folder / "found.npz")
    studio.open(page, "start")
    page.get_by_role("button", name="found.npz episode").click()
    page.locator(".watching", has_text=episode.sentence).wait_for()
    page.get_by_role("link", name="Start", exact=True).click()
    page.locator(".welcome .file").first.wait_for()


def test_any_file_is_opened_where_it_belongs(page: Page, studio: Studio, tmp_path: Path) -> None:
    field, problem, other = tmp_path / "plot.json", tmp_path / "steer.json", tmp_path / "x.json"
    field.write_text(json.dumps(REGION))
    problem.write_text(json.dumps({"kind": "swarm", "map": "line:6", "particles": 2}))
    other.write_text("[]")
    for file, place in ((field, "#search?"), (problem, "#vessels?")):
        studio.open(page, "start")
        page.locator(".welcome input[type=file]").set_input_files(file)
        until(page, f"location.hash.startsWith('{place}')")
    page.locator(".underStage .facts", has_text="6 free").wait_for()
    studio.open(page, "start")
    page.locator(".welcome input[type=file]").set_input_files(other)
    page.locator(".note.bad", has_text="expected a problem with its kind").wait_for()
    part = tmp_path / "plot.dbf"
    part.write_bytes(b"x")
    page.locator(".welcome input[type=file]").set_input_files(part)
    page.locator(".note.bad", has_text="needs its .shp file").wait_for()
    assert not list(studio.folder.glob("plot*.dbf"))


def test_somebodys_episode_is_changed_and_run_again(
    page: Page, studio: Studio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Episodes as commands save them, and none of the files that they were made from."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "maze.txt").write_text("#####\n#...#\n#.#.#\n#####\n")
    (tmp_path / "field.json").write_text(json.dumps(REGION))
    (tmp_path / "room.wkt").write_text("POLYGON ((0 0, 4 0, 4 2, 0 2, 0 0))")
    pair = {"start": [[0.2, 0.7], [0.4, 0.9]], "goal": [[0.3, 0.7], [0.9, 0.5]]}
    problems = {
        "one.npz": SwarmProblem("maze.txt", particles=2, policy="closest-frontier"),
        "two.npz": SwarmProblem("line:7", particles=1),
        "found.json": SearchProblem("field.json", robots=2, footprint=40.0),
        "room.json": SteeringProblem(workspace="room.wkt", planner="greedy", **pair),
        "square.json": SteeringProblem(planner="greedy", **pair),
        "random.json": SteeringProblem(planner="greedy"),
    }
    for name, problem in problems.items():
        shoal.run(problem, seed=4).save(tmp_path / name)

    def change(name: str) -> None:
        page.get_by_role("link", name="Start", exact=True).click()
        page.locator(".welcome input[type=file]").set_input_files(tmp_path / name)
        page.locator(".watching h2", has_text=name).wait_for()
        until(
            page,
            "!!document.querySelector('.watching iframe:not([hidden])')?.contentWindow.shoalPlayer",
        )
        page.get_by_role("button", name="Change and run again").click()

    studio.open(page, "start")
    change("one.npz")
    page.locator(".underStage .facts", has_text="5 free cells, 2 particles").wait_for()
    assert page.locator(".source:visible").inner_text() == "maze-map.map"
    assert page.locator("#vesselsSeed").input_value() == "4"
    change("two.npz")  # a second one in the same player
    page.locator(".underStage .facts", has_text="7 free cells, 1 particles").wait_for()
    change("found.json")
    page.locator(".underStage .facts", has_text="1.67").wait_for()
    assert page.locator(".search-place [data-field=robots] input").input_value() == "2"
    for name, workspace in (("room.json", "POLYGON (("), ("square.json", "square")):
        change(name)
        until(
            page, f"document.getElementById('steeringWorkspace')?.value.startsWith('{workspace}')"
        )
        assert page.locator("[data-field=start] input:visible").input_value() == "0.2,0.7 0.4,0.9"
    # random points stay those of the episode, whatever else is changed
    change("random.json")
    start, goal = problems["random.json"].endpoints(4)
    points = [
        page.get_by_role("button", name=f"{what} {k + 1} at {round(x, 4):g}, {round(y, 4):g}")
        for what, places in (("Particle", start), ("Goal", goal))
        for k, (x, y) in enumerate(places)
    ]
    radius = page.locator("[data-field=particle_radius] input:visible")
    radius.fill("0.01")
    radius.press("Tab")
    page.locator(".plan[aria-checked=true]", has_text="moves").wait_for()
    assert [point.count() for point in points] == [1, 1, 1, 1]
    assert page.locator(".note.bad").count() == 0
