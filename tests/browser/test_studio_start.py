"""The first page of the studio: examples by a click, and any file opened where it belongs."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page
from tests.browser.studio import Form, Studio
from tests.browser.waiting import until

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
    page.get_by_text("complete: all 400 cells").wait_for()
    page.get_by_role("link", name="Start", exact=True).click()
    page.get_by_role("button", name="A race").click()
    page.wait_for_selector(".pad:not([hidden])")


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


def test_the_settings_of_an_opened_episode_are_a_click_away(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": {"map": "line:7", "particles": 1}, "seed": 4})
    page.get_by_role("button", name="Run", exact=True).click()
    page.locator(".panel:not([hidden]) .exports").wait_for()
    studio.open(page, "lab", {"tab": "episodes"})
    page.locator(".shelf .card").first.click()
    page.get_by_role("link", name="Its settings").click()
    page.locator(".underStage .facts", has_text="7 free").wait_for()
    assert page.locator("#vesselsSeed").input_value() == "4"
