"""Never wrong in silence: what the studio takes back, asks before, keeps, and says of what is older
than the form.
"""

from __future__ import annotations

import json
import os
import re
import zipfile
from typing import Any

import pytest
from playwright.sync_api import Page, expect
from tests.browser.studio import Studio, on_plane, run_and_load, tab
from tests.browser.waiting import until

import shoal
from shoal.search import open_region
from shoal.steering import SteeringProblem
from shoal.swarm import SwarmProblem

pytestmark = pytest.mark.browser
FIELD = [[-90, -60], [90, -60], [90, 60], [-90, 60]]
ZONE = [[-20, -20], [20, -20], [20, 15]]
DRAWN = {"frame": None, "parts": [FIELD], "zones": []}
FAST = {"robots": 2, "footprint": "20", "vehicle": {"preset": "multirotor"}}
MAZE = {"map": "maze:9x7", "particles": 4, "policy": "closest-frontier"}


def drawn(page: Page, studio: Studio, drawing: Any = DRAWN, **more: Any) -> None:
    studio.open(page, "search", {"problem": FAST | more, "drawing": drawing, "seed": 1})
    planned(page)


def planned(page: Page) -> None:
    page.locator(".search-place .facts:has-text('searched in'):not(.loading)").wait_for()


def told(page: Page) -> Any:
    """What the address says: all that is set."""
    return page.evaluate("JSON.parse(decodeURIComponent(location.hash.split(/\\?(.*)/s)[1]))")


def add_zone(page: Page) -> None:
    """By numbers, as one step."""
    page.get_by_text("By numbers").click()
    page.get_by_label("Which outline").select_option("zones 0")
    page.locator("#cornersText").fill("\n".join(f"{x}, {y}" for x, y in ZONE))
    page.get_by_role("button", name="Apply").click()
    page.get_by_role("button", name="No-go zone 1, corner 1").wait_for()
    page.get_by_text("By numbers").click()


def click_at(page: Page, *points: tuple[float, float]) -> None:
    """Click on the canvas of an opened drawing, which shows FIELD whole."""
    for x, y in on_plane(page, (180, 120), *points):
        page.mouse.click(x, y)


@pytest.mark.forms(0)
def test_undo_takes_back_the_last_thing_whatever_it_was(page: Page, studio: Studio) -> None:
    drawn(page, studio)
    states = [told(page)]

    def done() -> None:
        until(
            page,
            "decodeURIComponent(location.hash.split(/\\?(.*)/s)[1]) !=="
            f" {json.dumps(json.dumps(states[-1]))}",
        )
        assert told(page) != states[-1]
        states.append(told(page))

    states[0] = told(page)
    add_zone(page)
    done()
    page.get_by_role("button", name="Launch", exact=True).click()
    click_at(page, (-60, 30))
    done()
    page.locator("[data-field=robots] input").fill("1")
    page.locator("[data-field=robots] input").fill("13")  # one field, one step
    page.locator("[data-field=robots] input").press("Tab")
    done()
    page.locator("[data-field=margin] input").fill("2.5")
    page.locator("[data-field=margin] input").press("Tab")
    done()
    page.get_by_label("Seed").fill("7")
    page.get_by_label("Seed").press("Tab")
    done()
    page.get_by_role("button", name="Region 1, corner 2").press("ArrowLeft")
    done()
    page.get_by_role("button", name="No-go zone 1, corner 1").press("Delete")
    done()
    assert told(page)["drawing"]["zones"] == []
    for state in states[-2::-1]:
        page.keyboard.press("Control+z")
        assert told(page) == state
    page.keyboard.press("Control+z")  # nothing is left to take back
    assert told(page) == states[0]
    assert page.get_by_role("button", name="Undo").is_disabled()
    for state in states[1:]:
        page.keyboard.press("Control+Shift+z")
        assert told(page) == state
    planned(page)


@pytest.mark.forms(0)
def test_the_corners_of_an_open_outline_are_taken_back_one_by_one_and_a_closed_one_whole(
    page: Page, studio: Studio
) -> None:
    drawn(page, studio)
    page.get_by_role("button", name="No-go", exact=True).click()
    click_at(page, (-20, -20), (20, -20), (20, 15))
    expect(page.locator("circle.corner.draft")).to_have_count(3)
    page.keyboard.press("Control+z")
    expect(page.locator("circle.corner.draft")).to_have_count(2)
    click_at(page, (30, 25), (-20, -20))
    page.get_by_role("button", name="No-go zone 1, corner 1").wait_for()
    page.keyboard.press("Control+z")
    expect(page.locator("circle.corner.draft")).to_have_count(0)
    assert told(page)["drawing"]["zones"] == []
    assert told(page)["drawing"]["parts"] == [FIELD]


@pytest.mark.parametrize("how", ["draw", "file", "name"])
def test_a_drawing_is_replaced_at_once_and_comes_back(
    page: Page, studio: Studio, tmp_path: Any, how: str
) -> None:
    drawn(page, studio, launch="-60,30")
    before = told(page)

    if how == "draw":
        page.get_by_role("button", name="Draw a region", exact=True).click()
    elif how == "file":
        (tmp_path / "other.csv").write_text("x_m,y_m\n0,0\n50,0\n50,50\n")
        page.locator(".search-place .chooser input[type=file]").set_input_files(
            tmp_path / "other.csv"
        )
    else:
        page.get_by_label("By name").fill("square:40")
        page.get_by_label("By name").press("Enter")
    page.locator(".note", has_text="The drawing is not lost: Ctrl Z brings it back.").wait_for()
    until(
        page,
        "!location.hash.includes('parts') ||"
        " decodeURIComponent(location.hash).includes('\"parts\":[]')",
    )
    page.locator(".plane").focus()
    page.keyboard.press("Control+z")
    assert told(page) == before
    planned(page)
    page.get_by_role("button", name="Region 1, corner 4").wait_for(state="attached")


@pytest.mark.forms(0)
def test_missions_of_older_settings_are_not_handed_out(page: Page, studio: Studio) -> None:
    drawn(
        page,
        studio,
        {"frame": [8.5, 47.4], "parts": [[[0, 0], [60, 0], [60, 40], [0, 40]]], "zones": []},
    )
    tab(page, "Missions")
    page.get_by_label("format", exact=True).fill("plan")
    page.get_by_label("format", exact=True).press("Tab")
    page.get_by_role("button", name="Write missions").click()
    link = page.get_by_role("link", name="Download the zip")
    link.wait_for(timeout=60_000)
    tab(page, "Plan")
    page.get_by_text("By numbers").click()
    page.get_by_label("Which outline").select_option("zones 0")
    page.locator("#cornersText").fill("8.5002, 47.4001\n8.5004, 47.4001\n8.5004, 47.4002")
    page.get_by_role("button", name="Apply").click()
    page.get_by_role("button", name="No-go zone 1, corner 1").wait_for()
    page.get_by_text("By numbers").click()
    tab(page, "Missions")
    page.locator(
        ".missions .warning",
        has_text="The settings have changed since drawn-region.missions.zip was written",
    ).wait_for()
    assert link.count() == 0
    assert page.locator(".missions img").count() == 0
    page.keyboard.press("Control+z")
    link.wait_for()  # they are of these settings again
    page.keyboard.press("Control+Shift+z")
    page.get_by_role("button", name="Write missions").click()
    link.wait_for(timeout=60_000)
    region = open_region(studio.folder / "drawn-region-2.geojson")
    assert region.no_go_zones == 1
    assert zipfile.is_zipfile(studio.folder / "drawn-region-2.missions.zip")


@pytest.mark.forms(0)
def test_a_plan_is_not_shown_over_settings_that_have_none(page: Page, studio: Studio) -> None:
    drawn(page, studio)
    assert page.locator(".ways path").count() == 2
    page.get_by_label("By name").fill("nothing:40")
    page.get_by_label("By name").press("Enter")
    page.locator(".search-place .warning", has_text="nothing:40").wait_for()
    expect(page.locator(".ways path")).to_have_count(0)
    assert page.locator(".fleet li:visible").count() == 0
    assert page.locator(".search-place .facts").inner_text() == ""
    page.locator(".plane").focus()
    page.keyboard.press("Control+z")
    planned(page)
    expect(page.locator(".ways path")).to_have_count(2)


@pytest.mark.forms(0)
def test_a_search_of_older_settings_is_not_exported_as_if_it_were_of_these(
    page: Page, studio: Studio
) -> None:
    drawn(page, studio)
    run_and_load(page, studio, "Simulate")
    page.locator("[data-field=footprint] input").fill("25")
    page.locator("[data-field=footprint] input").press("Tab")
    page.get_by_role(
        "button", name="Keep this run"
    ).wait_for()  # it was simulated anew, and is not saved yet
    assert page.locator(".panel:not([hidden]) .exports").count() == 0
    page.locator("[data-field=launch] input").fill("1,2;3,4;5,6")
    page.locator("[data-field=launch] input").press("Tab")
    page.locator(
        ".panel:not([hidden]) .warning",
        has_text="before the change: the settings cannot be simulated",
    ).wait_for()
    assert page.get_by_role("button", name="Keep this run").is_hidden()


@pytest.mark.forms(0)
def test_painting_inlets_and_fields_are_taken_back_in_their_order(
    page: Page, studio: Studio
) -> None:
    studio.open(
        page,
        "vessels",
        {
            "problem": {"map": "rectangle:6x8", "particles": 3, "policy": "closest-frontier"},
            "seed": 0,
        },
    )
    facts = page.locator(".underStage .facts")
    facts.get_by_text("48 free").wait_for()

    def paint(what: str, *numbers: int) -> None:
        if not page.get_by_label("What to paint").is_visible():
            page.get_by_text("By numbers").click()
        page.get_by_label("What to paint").select_option(what)
        for name, value in zip(("row", "column", "rows", "columns"), numbers, strict=True):
            page.locator(f".numbers input[name={name}]").fill(str(value))
        page.get_by_role("button", name="Apply").click()

    paint("wall", 0, 0, 2, 2)
    facts.get_by_text("44 free").wait_for()
    page.locator("[data-field=particles] input").fill("5")
    page.locator("[data-field=particles] input").press("Tab")
    facts.get_by_text("5 particles").wait_for()
    paint("inlet", 4, 4, 1, 2)
    until(page, "document.querySelector('[data-field=start] input').value === '4,4 4,5'")
    run_and_load(page, studio)  # writes the painted map
    tab(page, "Map")
    page.locator(".editor canvas").focus()
    page.keyboard.press("Control+z")
    assert page.locator("[data-field=start] input").input_value() == ""
    assert page.locator("[data-field=particles] input").input_value() == "5"
    facts.get_by_text("44 free cells, 5 particles").wait_for()
    page.keyboard.press("Control+z")
    facts.get_by_text("44 free cells, 3 particles").wait_for()
    page.keyboard.press("Control+z")
    facts.get_by_text("48 free cells, 3 particles").wait_for()
    for _ in range(2):
        page.keyboard.press("Control+y")
    facts.get_by_text("44 free cells, 5 particles").wait_for()
    page.locator(".chooser input[type=text]").fill("maze:9x7")
    page.locator(".chooser input[type=text]").press("Enter")
    page.locator(".note", has_text="The painted cells are not lost").wait_for()
    page.locator(".underStage .source", has_text="maze:9x7").wait_for()
    page.locator(".editor canvas").focus()
    page.keyboard.press("Control+z")
    facts.get_by_text("44 free cells, 5 particles").wait_for()
    page.get_by_label("A new map").select_option("canvas")
    facts.get_by_text("80 columns, 0 free cells").wait_for()
    page.locator(".editor canvas").focus()
    page.keyboard.press("Control+z")
    facts.get_by_text("44 free cells, 5 particles").wait_for()
    paint("wall", 5, 7, 1, 1)
    facts.get_by_text("43 free cells, 5 particles").wait_for()
    page.locator("[data-field=invert] input").evaluate("one => one.closest('details').open = true")
    page.locator("[data-field=invert] input").check()
    until(page, "decodeURIComponent(location.hash).includes('invert')")
    page.locator(".editor canvas").focus()
    page.keyboard.press("Control+z")
    facts.get_by_text("43 free cells, 5 particles").wait_for()


@pytest.mark.forms(0)
def test_particles_that_were_moved_and_drawn_workspaces_come_back(
    page: Page, studio: Studio
) -> None:
    pair = {
        "workspace": "square",
        "start": [[0.2, 0.3], [0.5, 0.35]],
        "goal": [[0.8, 0.2], [0.3, 0.75]],
    }
    studio.open(page, "steering", {"problem": pair, "seed": 0})
    page.get_by_role("button", name="Particle 1 at").press("ArrowUp")
    page.get_by_role("button", name="Particle 1 at 0.2, 0.31").wait_for()
    page.get_by_label("max moves").fill("9")
    page.get_by_label("max moves").press("Tab")
    page.get_by_role("button", name="Draw a workspace").click()
    box = page.locator(".room").first.bounding_box()
    assert box is not None
    for x, y in ((0.3, 0.2), (0.7, 0.2), (0.7, 0.8)):
        page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
    page.get_by_role("button", name="Close the outline").click()
    until(page, "decodeURIComponent(location.hash).includes('POLYGON')")
    page.locator(".plan", has_text="greedy").get_by_text("moves").wait_for()
    page.locator("select[aria-label=Workspace]").select_option("hexagon")
    until(page, "location.hash.includes('hexagon')")
    page.keyboard.press("Control+z")
    assert "POLYGON" in told(page)["problem"]["workspace"]
    page.keyboard.press("Control+z")
    assert told(page)["problem"] == pair | {
        "start": "0.2,0.31 0.5,0.35",
        "goal": "0.8,0.2 0.3,0.75",
        "max_moves": 9,
    }
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    assert told(page)["problem"] == pair
    page.get_by_role("button", name="Particle 1 at 0.2, 0.3").wait_for()


@pytest.mark.forms(0)
def test_a_workspace_of_a_micrometre_keeps_its_digits(page: Page, studio: Studio) -> None:
    small = "POLYGON ((0 0, 0.000002 0, 0.000002 0.000001, 0 0.000001, 0 0))"
    start, goal = [[2e-7, 3e-7], [5e-7, 3.5e-7]], [[1.6e-6, 2e-7], [3e-7, 7.5e-7]]
    studio.open(
        page,
        "steering",
        {
            "problem": {"workspace": small, "start": start, "goal": goal, "tolerance": 1e-9},
            "seed": 0,
        },
    )
    page.locator(".plan", has_text="greedy").get_by_text("length").wait_for()
    expected = shoal.run(SteeringProblem(small, start, goal, planner="greedy", tolerance=1e-9))
    assert (
        f"length {expected.length:.4g}".replace("e-0", "e-")
        in page.locator(".plan", has_text="greedy").inner_text()
    )
    page.get_by_role("button", name="Particle 1 at 2e-7, 3e-7").press("ArrowUp")
    page.get_by_role("button", name="Particle 1 at 2e-7, 3.2").wait_for()
    assert told(page)["problem"]["goal"] == goal


@pytest.mark.forms(0)
def test_small_numbers_keep_their_digits(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels")
    cases = {
        0.0005: "0.0005",
        0.00049: "0.00049",
        3e-9: "3e-9",
        0.0: "0",
        1234567.0: "1,235,000",
        -0.00012: "-0.00012",
    }
    shares = {
        0: "0 %",
        1: "100 %",
        0.9999: "99.99 %",
        0.99996: "99.996 %",
        0.0004: "0.04 %",
        0.25: "25.0 %",
        1e-9: "1e-7 %",
    }
    found = page.evaluate(
        """async ([values, shares]) => {
            const {number, percent} = await import("/static/shared/page.js");
            return [values.map((value) => number(value)), shares.map(percent)];
        }""",
        [list(cases), list(shares)],
    )
    assert found == [list(cases.values()), list(shares.values())]
    # a tie is rounded as commands round it, and so in the player
    ties = [199.25, 199.75, 0.125, -0.375, 2.5, 1234.5, 12345.0, 0.15, 9.9995, 9.5, 2**-20]
    rounded = """({fixed, precise}, ties) => ties.map((x) =>
        [2, 3, 4].flatMap((n) => [Number(precise(x, n)), Number(fixed(x, n - 2))]))"""
    expected = [
        [number for n in (2, 3, 4) for number in (float(f"{x:.{n}g}"), float(f"{x:.{n - 2}f}"))]
        for x in ties
    ]
    assert (
        page.evaluate(
            f"async (ties) => ({rounded})(await import('/static/shared/page.js'), ties)", ties
        )
        == expected
    )
    frame = page.locator("iframe").first.element_handle().content_frame()
    assert frame is not None
    frame.wait_for_load_state()
    assert frame.evaluate(f"(ties) => ({rounded})(ShoalDesk, ties)", ties) == expected


@pytest.mark.forms(0)
def test_python_of_an_opened_episode_is_that_episode(page: Page, studio: Studio) -> None:
    episode = shoal.run(SwarmProblem("maze:11x9", particles=3, policy="closest-frontier"), seed=41)
    episode.save(studio.folder / "opened.npz")
    studio.open(page, "vessels", {"problem": MAZE, "seed": 5})
    page.locator(".underStage .facts", has_text="free").wait_for()
    tab(page, "Episode")
    page.get_by_label("Episodes of the folder").select_option("opened.npz")
    page.locator(".panel:not([hidden]) .exports").wait_for()

    def script(button: str) -> Any:
        page.get_by_role("button", name=button).click()
        page.wait_for_selector(".sheet[open] .code")
        names: dict[str, Any] = {}
        exec(page.locator(".sheet .code").inner_text(), names)
        page.keyboard.press("Escape")
        return names["episode"]

    again = script("As Python …")
    assert (again.problem, again.seed, again.commands) == (episode.problem, 41, episode.commands)
    page.get_by_label("Seed").fill("6")
    page.get_by_label("Seed").press("Tab")
    page.locator(
        ".panel:not([hidden]) .result", has_text="opened.npz: the settings have changed since"
    ).wait_for()
    assert script("As Python …").seed == 6  # what was done last: the form
    assert script("Python script of this episode").commands == episode.commands
    page.get_by_role("button", name="Python script of this episode").click()
    page.get_by_role("tab", name="As command").click()
    assert (
        page.locator(".sheet .code").inner_text()
        == "shoal map maze:11x9 --particles=3 --policy=closest-frontier --seed=41"
    )
    page.keyboard.press("Escape")


def test_players_and_drawings_survive_a_visit_elsewhere(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": MAZE, "seed": 3})
    episode = run_and_load(page, studio)
    inside = page.frame_locator(".panel:not([hidden]) iframe:not([hidden])")
    inside.locator("#of", has_text=f"of {episode.moves}").wait_for()
    address = page.url
    page.get_by_role("link", name="Search", exact=True).click()
    planned(page)
    page.get_by_role("button", name="Draw a region", exact=True).click()
    until(page, "decodeURIComponent(location.hash).includes('\"parts\":[]')")
    page.get_by_role("link", name="Lab", exact=True).click()
    page.get_by_role("tab", name="Episodes").wait_for()
    page.get_by_role("link", name="Vessels", exact=True).click()
    inside.locator("#of", has_text=f"of {episode.moves}").wait_for()
    assert inside.locator("#picture").bounding_box()
    assert page.url == address  # so that a link, and the next visit, are of what is shown
    assert (
        page.get_by_role("tab", name="Episode", exact=True).get_attribute("aria-selected") == "true"
    )
    page.get_by_role("link", name="Search", exact=True).click()
    page.locator(".search-place .plane").wait_for()
    assert told(page)["drawing"]["parts"] == []
    assert page.locator(".search-place .fleet li:visible").count() == 0
    ids = page.evaluate("[...document.querySelectorAll('[id]')].map((one) => one.id)")
    assert len(ids) == len(set(ids))


@pytest.mark.forms(0)
def test_of_many_episodes_the_newest_are_listed_and_all_can_be_reached(
    page: Page, studio: Studio
) -> None:
    episode = shoal.run(SwarmProblem("line:4", particles=1), seed=1)
    episode.save(studio.folder / "episode-0000.npz")
    for k in range(1, 700):
        os.link(studio.folder / "episode-0000.npz", studio.folder / f"episode-{k:04d}.npz")
    episode.save(studio.folder / "the-newest.npz")
    os.utime(studio.folder / "episode-0000.npz", (1e9, 1e9))
    studio.open(page, "vessels", {"problem": MAZE, "seed": 0})
    listed = page.get_by_label("Episodes of the folder").locator("option").all_inner_texts()
    assert listed[1] == "the-newest.npz"
    there = len(list(studio.folder.rglob("*.npz"))) + len(
        list(studio.folder.rglob("*.episode.json"))
    )
    assert listed[-1] == f"{there - 200:,} older ones: in the Lab …"
    tab(page, "Episode")
    page.get_by_label("Episodes of the folder").select_option(listed[-1])
    page.get_by_text(f"The newest 24 of {there:,} episodes.").wait_for()
    assert page.locator(".gallery .card b").first.inner_text() == "the-newest.npz"
    page.get_by_role("button", name="More").click()
    page.get_by_text(f"The newest 48 of {there:,} episodes.").wait_for()
    page.get_by_label("Find").fill("episode-0699")
    page.get_by_text("1 episode.", exact=True).wait_for()
    page.get_by_role("button", name="episode-0699.npz").wait_for()


@pytest.mark.forms(0)
def test_changes_of_a_new_sweep_are_taken_back(page: Page, studio: Studio) -> None:
    studio.open(page, "lab", {"tab": "new"})
    page.get_by_text("2 points, 40 trials").wait_for()
    text = page.get_by_label("The same as a file")
    before = text.input_value()
    page.get_by_label("Trials per point").fill("7")
    page.get_by_label("Trials per point").press("Tab")
    page.get_by_text("2 points, 14 trials").wait_for()
    page.locator(".axes").get_by_role("button", name="Remove").click()
    page.get_by_text("1 point, 7 trials").wait_for()
    page.keyboard.press("Control+z")
    page.get_by_text("2 points, 14 trials").wait_for()
    expect(page.get_by_label("Values")).to_have_value("best closest-frontier")
    page.keyboard.press("Control+z")
    page.get_by_text("2 points, 40 trials").wait_for()
    assert text.input_value() == before
    assert page.locator(".drafting").get_by_role("button", name="Undo").is_disabled()


@pytest.mark.forms(0)
def test_painted_cells_outlast_a_reload_and_comparisons_say_that_they_are_older(
    page: Page, studio: Studio
) -> None:
    studio.open(page, "vessels", {"problem": {"map": "rectangle:5x5", "particles": 2}, "seed": 0})
    facts = page.locator(".underStage .facts")
    facts.get_by_text("25 free").wait_for()
    page.get_by_role("button", name="Erase").click()
    page.locator(".editor canvas").focus()
    page.keyboard.press("Space")
    facts.get_by_text("16 free").wait_for()
    until(page, "location.hash.includes('painted')")  # the folder has it
    page.reload()
    facts.get_by_text("16 free").wait_for()
    studio.open(page, "vessels", {"problem": {"map": "rectangle:5x5", "particles": 2}, "seed": 0})
    facts.get_by_text("25 free").wait_for()  # a link is not a reload
    tab(page, "Compare")
    page.locator("#compareTrials").fill("2")
    page.get_by_role("button", name="Compare", exact=True).click()
    page.wait_for_selector(".quad iframe:not([hidden])", timeout=60_000)
    aged = page.locator(
        ".compare .warning", has_text="The settings have changed since this comparison began."
    )
    assert aged.is_hidden()
    page.locator("[data-field=particles] input").fill("3")
    aged.wait_for()
    page.locator("[data-field=particles] input").fill("2")
    expect(aged).to_be_hidden()


@pytest.mark.forms(0)
def test_what_is_no_number_is_not_the_default_and_typing_takes_no_launch_point(
    page: Page, studio: Studio
) -> None:
    drawn(page, studio, launch="-60,30;60,30", robots=2)
    robots = page.locator("[data-field=robots] input")
    robots.fill("")
    robots.press_sequentially("12")
    robots.press("Tab")
    launch = page.locator("[data-field=launch] input")
    assert launch.input_value() == ";".join(["-60,30", "60,30"] * 6)
    robots.fill("1")
    robots.press("Tab")
    page.locator(".note", has_text="1 launch point is left out").wait_for()
    assert launch.input_value() == "-60,30"
    page.keyboard.press("Control+z")
    assert launch.input_value() == ";".join(["-60,30", "60,30"] * 6)
    assert robots.input_value() == "12"
    planned(page)
    speed = page.locator("[data-field=cruise_speed] input")
    speed.press_sequentially("5e")
    page.locator(".search-place .warning", has_text="got no number").wait_for()
    assert page.locator(".fleet li:visible").count() == 0


WRONG_FIELDS: dict[str, tuple[Any, str, str, str, str]] = {
    "vessels": (
        {"problem": MAZE},
        ".facts",
        "particles",
        "-7",
        "Expected a whole number from 1",
    ),
    "steering": (
        {"problem": {"workspace": "square"}, "seed": 2},
        ".reached .m4",
        "workspace",
        "zzz",
        "Unknown workspace 'zzz'",
    ),
    "search": (
        {"problem": FAST | {"region": "square:100"}},
        ".facts:has-text('searched in'):not(.loading)",
        "cruise_speed",
        "-7",
        "Expected a number, above 0",
    ),
}


@pytest.mark.forms(0, 1)
def test_what_is_wrong_stands_at_its_field_and_nothing_moves(page: Page, studio: Studio) -> None:
    for place, (given, shown, name, value, said) in WRONG_FIELDS.items():
        studio.open(page, place, given)
        room = page.locator(".place:visible")
        room.locator(shown).filter(has_text=re.compile(r"\d")).first.wait_for()
        field = room.locator(f"[data-field={name}]")
        control = field.locator("input")
        control.focus()
        stage = room.locator(".editor, .plane, .room, .main").locator("visible=true")
        before = [one.bounding_box() for one in [control, *stage.all()]]
        control.fill(value)
        control.press("Enter")
        field.locator(".fault", has_text=said).wait_for()
        room.locator(".stage-side > .warning", has_text=said).wait_for()
        if place == "steering":  # the last picture stays, and says that it is another one
            assert room.locator(".workspace .handle").count() == 4
            assert room.locator(".workspace").get_attribute("data-aged") == "not of these settings"
        assert [one.bounding_box() for one in [control, *stage.all()]] == before, name
        assert control.get_attribute("aria-describedby") == f"{control.get_attribute('id')}-fault"
        page.locator(".brand").click()
        room.get_by_role("button", name=re.compile(r"^[A-Z][a-z ]+:$")).click()
        expect(control).to_be_focused()
        page.keyboard.press("Control+z")
        field.locator(".fault").wait_for(state="hidden")


@pytest.mark.forms(0)
def test_captions_are_whole_and_without_words_of_the_command_line(
    page: Page, studio: Studio
) -> None:
    for place in ("vessels", "steering", "search"):
        studio.open(page, place)
        room = page.locator(".place:visible")
        texts = room.locator(".help, label, option").all_text_contents()
        found = re.findall(
            r"--[a-z]\S*|MODULE:ATTRIBUTE|the extra|\b[a-z]+_[a-z]+\b", " ".join(texts)
        )
        assert set(found) == {"spread_m"} & {
            "spread_m" * (place == "search")
        }  # a property of a GeoJSON file
        # captions are whole, in two lines at most
        room.locator("details.section").evaluate_all("all => all.forEach((one) => one.open = true)")
        captions = room.locator(".help.short:visible").evaluate_all(
            "all => all.map((one) => [one.offsetHeight, one.scrollWidth - one.clientWidth])"
        )
        assert len(captions) > 12
        assert max(high for high, _ in captions) < 40
        assert max(wide for _, wide in captions) == 0
    start = page.locator(".place:visible [data-field=launch]")
    start.get_by_role("button", name="Explanation").click()
    start.get_by_text("along which robots start at equal distances").wait_for()


@pytest.mark.forms(0)
def test_defaults_say_what_they_do(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": {"map": "maze:9x7", "particles": 4}})
    page.locator("[data-field=policy] option", has_text=re.compile("^auto: beam-rollout")).wait_for(
        state="attached"
    )
    drawn(page, studio)
    plan = page.locator(".search-place .facts").inner_text()
    tour = page.locator("[data-field=tour] option").first.inner_text()
    assert tour.startswith("auto: ")
    assert tour.removeprefix("auto: ") in plan
    assert page.locator("[data-field=angle] input").get_attribute("placeholder") != "none"


@pytest.mark.forms(0)
def test_play_plays_what_the_form_says(page: Page, studio: Studio) -> None:
    studio.open(page, "steering", {"problem": {"workspace": "square"}, "seed": 2})
    page.locator(".plan[aria-checked=true]", has_text="shortest").get_by_text("moves").wait_for()
    assert run_and_load(page, studio, "Play").planner == "shortest"
    tab(page, "Plan")
    page.locator(".plan", has_text="greedy").click()
    assert page.locator("[data-field=planner] select").input_value() == "greedy"
    assert run_and_load(page, studio, "Play").planner == "greedy"
    tab(page, "Plan")
    page.keyboard.press("Control+z")
    expect(page.locator(".plan[aria-checked=true]")).to_contain_text("shortest")


@pytest.mark.forms(0)
def test_an_outline_that_would_cross_itself_is_refused_at_once(page: Page, studio: Studio) -> None:
    studio.open(page, "steering", {"problem": {"workspace": "square"}, "seed": 2})
    page.get_by_role("button", name="Draw a workspace").click()
    page.get_by_text("Click corners of an outline").wait_for()
    box = page.locator(".room").first.bounding_box()
    assert box is not None

    def click(x: float, y: float) -> None:
        page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])

    for corner in ((0.3, 0.3), (0.6, 0.6), (0.6, 0.3)):
        click(*corner)
    click(0.4, 0.6)  # over the first side
    said = page.locator(".warning", has_text="would cross itself")
    said.wait_for()
    # a corner may lie below the words
    assert said.evaluate("words => getComputedStyle(words).pointerEvents") == "none"
    assert page.locator(".room .corner").count() == 3
    click(0.4, 0.35)  # it bends inward, and crosses nothing
    expect(page.locator(".warning")).to_be_hidden()
    expect(page.locator(".room .corner")).to_have_count(4)
    click(0.3, 0.3)  # the first again closes it
    page.locator(".plan[aria-checked=true]", has_text="sampling").wait_for()
    expect(page.locator(".warning")).to_be_hidden()
    drawn(page, studio, {"frame": None, "parts": [], "zones": []}, region="square:200")
    page.get_by_role("button", name="Region", exact=True).click()
    for corner in ((0.3, 0.3), (0.6, 0.6), (0.6, 0.3), (0.3, 0.6)):
        plane = page.locator(".plane")
        area = plane.bounding_box()
        assert area is not None
        page.mouse.click(
            area["x"] + corner[0] * area["width"], area["y"] + corner[1] * area["height"]
        )
    page.locator(".guide.refuses", has_text="would cross itself").wait_for()
    assert page.locator(".corner.draft").count() == 3


@pytest.mark.forms(0)
def test_a_link_with_a_misspelt_field_says_so(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": MAZE | {"particals": 9}, "seed": 0})
    note = page.locator(".note.bad", has_text="leaves them out: particals.")
    note.wait_for()
    note.get_by_role("button", name="Close").click()
