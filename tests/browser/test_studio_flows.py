"""More of what people do in the studio's vessels and steering: each flow ends in a file or in the
library's numbers.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw
from playwright.sync_api import Page, Route, expect
from tests.browser.studio import Studio, run_and_load, tab, written_by
from tests.browser.waiting import until

import shoal
from shoal.steering import SteeringProblem
from shoal.swarm import SwarmProblem
from shoal.swarm.maps.files import vessels_in

pytestmark = pytest.mark.browser
MAZE = {"map": "maze:9x7", "particles": 4, "policy": "closest-frontier"}
PAIR = {
    "workspace": "square",
    "start": [[0.2, 0.3], [0.5, 0.35]],
    "goal": [[0.8, 0.2], [0.3, 0.75]],
}


@pytest.fixture(scope="module")
def photograph(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Dark vessels on a pale ground, 120 x 90 pixels."""
    image = Image.new("L", (120, 90), 200)
    pen = ImageDraw.Draw(image)
    for line in ([(5, 45), (60, 40), (115, 50)], [(60, 40), (80, 5)], [(40, 42), (30, 85)]):
        pen.line(line, fill=70, width=6)
    path = tmp_path_factory.mktemp("pictures") / "retina.png"
    image.save(path)
    return path


@pytest.mark.forms(0)
def test_from_a_photograph_to_its_film(page: Page, studio: Studio, photograph: Path) -> None:
    studio.open(page, "vessels", {"problem": MAZE, "seed": 0})
    before = set(studio.folder.glob("retina*.png"))
    page.locator(".chooser input[type=file]").set_input_files(photograph)
    facts = page.locator(".underStage .facts")
    facts.get_by_text("confidence").wait_for()
    low = page.locator("[data-field=low] input[type=number]")
    low.fill("0.6")
    low.press("Tab")
    (brought,) = set(studio.folder.glob("retina*.png")) - before
    found = vessels_in(str(brought), low=0.6)
    facts.get_by_text(
        f"{100 * found.mask.mean():.1f} % of the pixels are vessel, confidence"
    ).wait_for()
    # what was found anew is not out of date
    assert page.locator(".editor").get_attribute("data-aged") is None
    page.locator("[data-field=particles] input").fill("5")
    page.locator("[data-field=policy] select").select_option("closest-frontier")
    episode = run_and_load(page, studio)
    expected = shoal.run(
        SwarmProblem(str(brought), vessels=True, low=0.6, particles=5, policy="closest-frontier"),
        seed=0,
    )
    assert episode.commands == expected.commands
    assert written_by(page, studio, "Film as GIF").read_bytes()[:6] == b"GIF89a"


def test_a_volume_is_turned_and_run(page: Page, studio: Studio) -> None:
    given = {"map": "vessels3d:60:7", "particles": 3, "policy": "closest-frontier"}
    studio.open(page, "vessels", {"problem": given, "seed": 1})
    page.locator(".underStage .facts", has_text="60 free").wait_for()
    assert run_and_load(page, studio).commands == shoal.run(SwarmProblem(**given), seed=1).commands


def test_fields_of_the_form_make_the_problem(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": MAZE, "seed": 0})
    page.locator("[data-field=task] select").select_option("coverage")
    page.locator("[data-field=rule] select").select_option("merge")
    page.get_by_text("Scans and prices").click()
    page.locator("[data-field=move_cost] input[type=number]").last.fill("2.5")
    episode = run_and_load(page, studio)
    assert episode.problem == SwarmProblem(**MAZE, task="coverage", rule="merge", move_cost=2.5)


def test_a_link_opens_the_same_problem_again(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": MAZE, "seed": 0})
    page.locator("[data-field=particles] input").fill("6")
    page.get_by_label("Seed").fill("7")
    page.get_by_label("Seed").press("Tab")
    until(page, "decodeURIComponent(location.hash).includes('\"seed\":7')")
    link = page.url
    page.goto("about:blank")
    page.goto(link)
    page.locator(".underStage .facts", has_text="6 particles").wait_for()
    assert (
        run_and_load(page, studio).commands
        == shoal.run(SwarmProblem(**(MAZE | {"particles": 6})), seed=7).commands
    )


def test_a_run_is_stopped_and_leaves_nothing(page: Page, studio: Studio) -> None:
    minutes = {"map": "maze:201x201", "particles": 10, "policy": "best"}
    studio.open(page, "vessels", {"problem": minutes, "seed": 0})
    late: list[Route] = []

    def hold(route: Route) -> None:
        late.append(route)

    page.route("**/api/jobs", hold)
    run = page.get_by_role("button", name="Run", exact=True)
    before = run.bounding_box()
    with page.expect_request("**/api/jobs"):
        run.click()
    page.get_by_role("button", name="Stop").wait_for()
    # a second click of the same hand meets the button, which is off
    assert (run.is_disabled(), run.bounding_box()) == (True, before)
    page.get_by_role("button", name="Stop").click()  # before the studio knows of the run
    late[0].continue_()
    page.unroute("**/api/jobs", hold)
    until(page, "!document.querySelector('.bottom .main').disabled")
    assert list(studio.folder.glob("maze-201*")) == []
    page.get_by_role("button", name="Jobs").click()
    page.locator(".job", has_text="cancelled").first.wait_for()
    page.keyboard.press("Escape")


def test_cells_are_painted_by_keys(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": {"map": "rectangle:5x5", "particles": 2}, "seed": 0})
    page.locator(".underStage .facts", has_text="25 free").wait_for()
    page.get_by_role("button", name="Erase").click()
    page.locator(".editor canvas").focus()
    for key in ("ArrowRight", "ArrowDown", "Space"):
        page.keyboard.press(key)
    until(page, "!document.querySelector('.underStage .facts').textContent.includes('25 free')")
    page.keyboard.press("Control+z")
    until(page, "document.querySelector('.underStage .facts').textContent.includes('25 free')")


def test_an_episode_of_the_folder_is_opened_again(page: Page, studio: Studio) -> None:
    episode = shoal.run(SwarmProblem(**MAZE), seed=4)
    episode.save(studio.folder / "earlier.npz")
    studio.open(page, "vessels", {"problem": MAZE, "seed": 0})
    tab(page, "Episode")
    page.get_by_label("Episodes of the folder").select_option("earlier.npz")
    page.frame_locator(".panel:not([hidden]) iframe:not([hidden])").locator(
        "#of", has_text=f"of {episode.moves}"
    ).wait_for()
    assert b"<svg" in written_by(page, studio, "Figure as SVG").read_bytes()[:800]
    page.get_by_role("button", name="Figure for print", exact=True).click()
    page.get_by_label("Width in mm").fill("60")
    page.get_by_label("Moment").fill("2")
    page.get_by_role("button", name="Figure for print as PDF").click()
    note = page.locator(".note", has_text="Written into the folder").last
    note.wait_for()
    printed = studio.folder / note.locator("span").inner_text().partition(": ")[2]
    assert printed.read_bytes().startswith(b"%PDF")
    assert "Map at moves 2." in printed.with_suffix(".caption.txt").read_text(encoding="utf-8")


def test_the_swarm_is_run_by_keys_alone(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": MAZE, "seed": 11})
    page.locator(".underStage .facts", has_text="free").wait_for()
    assert (
        run_and_load(page, studio, by_keys=True).commands
        == shoal.run(SwarmProblem(**MAZE), seed=11).commands
    )


def test_a_browser_that_is_closed_changes_nothing_and_two_see_the_same(
    page: Page, studio: Studio
) -> None:
    other = page.context.new_page()
    studio.open(other, "vessels")
    studio.open(page, "vessels", {"problem": MAZE, "seed": 21})
    page.locator(".underStage .facts", has_text="free").wait_for()
    with page.expect_response(
        lambda answer: answer.request.method == "POST" and "jobs" in answer.url
    ):
        page.get_by_role("button", name="Run", exact=True).click()
    page.goto("about:blank")
    until(
        other,
        "[...document.querySelectorAll('select option')].some((one) =>"
        " one.value.includes('seed21'))",
    )
    (kept,) = studio.folder.glob("*seed21*.npz")
    assert shoal.load(kept).verify()
    page.bring_to_front()  # Firefox would leave it without the focus
    other.close()


@pytest.mark.chromium("files of downloads")
def test_a_film_for_a_talk_is_exported(page: Page, studio: Studio) -> None:
    given = {"map": "line:6", "particles": 1, "policy": "closest-frontier"}
    studio.open(page, "vessels", {"problem": given, "seed": 0})
    page.get_by_role("button", name="Run", exact=True).click()
    page.locator(".panel:not([hidden]) .exports").wait_for()
    page.get_by_role("button", name="Film for a talk", exact=True).click()
    page.locator("#filmSize").select_option("square")
    button = page.get_by_role("button", name="Film for a talk as GIF")
    button.evaluate("""button => {
        button.said = [];
        new MutationObserver(() => button.said.push(button.textContent)).observe(button, { childList: true });
    }""")
    with page.expect_download(timeout=30_000) as download:
        button.click()
    assert re.fullmatch(r"GIF \d+ %", button.evaluate("button => button.said[0]"))
    assert button.inner_text() == "GIF"
    with Image.open(download.value.path()) as film:
        assert film.size[0] == film.size[1]


def test_the_shortest_plan_is_chosen_and_played(page: Page, studio: Studio) -> None:
    studio.open(page, "steering", {"problem": PAIR, "seed": 0})
    plan = page.locator(".plan", has_text="shortest")
    plan.get_by_text("length").wait_for()
    plan.click()
    episode = run_and_load(page, studio, "Play")
    assert episode.problem.planner == "shortest"
    assert np.array_equal(
        episode.inputs, shoal.run(SteeringProblem(**PAIR, planner="shortest", time=3)).inputs
    )


@pytest.mark.forms(0, 3)
def test_a_plan_that_does_not_arrive_looks_failed(page: Page, studio: Studio) -> None:
    slippery = PAIR | {"friction": 0.3, "planner": "shortest"}
    studio.open(page, "steering", {"problem": slippery, "seed": 0})
    plan = page.locator(".plan.failed", has_text="shortest")
    plan.get_by_text("unreachable: with friction 0.3").wait_for()
    page.get_by_text("Shortest: no plan that arrives").wait_for()
    assert page.locator(".room .way:not(.failed)").count() == 0
    page.locator("[data-field=friction] input").evaluate(
        "one => one.closest('details').open = true"
    )
    page.locator("[data-field=friction] input").fill("")
    page.get_by_text("Workspace: drag particles and goals").wait_for()
    page.locator(".plan:not(.failed)", has_text="shortest").get_by_text("length").wait_for()
    page.locator(".room .way:not(.failed)").first.wait_for()


def test_a_particle_is_dragged_and_the_plan_follows(page: Page, studio: Studio) -> None:
    studio.open(page, "steering", {"problem": PAIR, "seed": 0})
    # each plan that comes draws the points anew
    expect(page.locator(".plan", has_text="moves, length")).to_have_count(3)
    page.get_by_role("button", name="Goal 1 at").scroll_into_view_if_needed()
    box = page.get_by_role("button", name="Goal 1 at").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(box["x"] - 40, box["y"] - 30, steps=4)
    page.mouse.up()
    episode = run_and_load(page, studio, "Play")
    assert not np.array_equal(episode.problem.goal[0], PAIR["goal"][0])
    assert episode.verify()


def test_a_workspace_is_drawn_by_clicks(page: Page, studio: Studio) -> None:
    studio.open(page, "steering", {"problem": PAIR, "seed": 0})
    page.get_by_role("button", name="Draw a workspace").click()
    page.locator(".room").first.scroll_into_view_if_needed()
    box = page.locator(".room").first.bounding_box()
    assert box is not None
    for x, y in ((0.3, 0.2), (0.7, 0.2), (0.7, 0.8), (0.3, 0.8)):
        page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
    page.mouse.dblclick(box["x"] + 0.2 * box["width"], box["y"] + 0.5 * box["height"])
    until(page, "decodeURIComponent(location.hash).includes('POLYGON')")
    page.locator(".plan", has_text="greedy").get_by_text("moves").wait_for()
    assert len(run_and_load(page, studio, "Play").problem.place.vertices) == 5


def test_a_workspace_is_brought_as_a_file(page: Page, studio: Studio, tmp_path: Path) -> None:
    (tmp_path / "room.wkt").write_text("POLYGON ((0 0, 4 0, 4 2, 0 2, 0 0))")
    studio.open(page, "steering", {"problem": PAIR, "seed": 0})
    page.locator(".chooser input[type=file]").set_input_files(tmp_path / "room.wkt")
    page.locator(".plan", has_text="greedy").get_by_text("moves").wait_for()
    until(page, "decodeURIComponent(location.hash).includes('room.wkt')")
    corners = run_and_load(page, studio, "Play").problem.place.vertices
    assert corners.max(axis=0).tolist() == [4, 2]


def test_noise_of_moves_is_in_the_plan(page: Page, studio: Studio) -> None:
    given = PAIR | {"execution": 0.001, "planner": "greedy"}
    studio.open(page, "steering", {"problem": given, "seed": 2})
    page.locator(".plan", has_text="greedy").get_by_text("moves").wait_for()
    episode = run_and_load(page, studio, "Play")
    # fields of JSON
    assert np.array_equal(episode.states, shoal.run(SteeringProblem(**given), seed=2).states)  # type: ignore[arg-type]


@pytest.mark.forms(0, 3)
def test_keys_go_everywhere_and_are_listed(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": MAZE, "seed": 0})
    particles = page.locator("[data-field=particles] input")
    particles.press("3")  # typed, and no way to another page
    assert "#vessels" in page.url
    page.locator(".brand").click()
    page.keyboard.press("3")
    page.locator(".place:visible .room").first.wait_for()
    page.keyboard.press("2")
    particles.wait_for()
    page.keyboard.press("?")
    sheet = page.locator(".sheet")
    sheet.get_by_text("take back the last thing").wait_for()
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.keyboard.press("Escape")
    particles.fill("5")
    particles.press("Control+Enter")
    page.locator(".panel:not([hidden]) .exports").wait_for()
    (episode,) = studio.folder.glob("*.npz")
    assert shoal.load(episode).problem.particles == 5


@pytest.mark.forms(0)
def test_a_job_that_ends_elsewhere_says_so(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": MAZE, "seed": 0})
    # at once, because the job may be over before the next message to the browser
    run = page.get_by_role("button", name="Run", exact=True)
    run.evaluate("button => { button.click(); location.hash = 'lab'; }")
    note = page.locator(".note", has_text="Episode maze:9x7 is done.")
    note.get_by_role("link", name="Show it").click()
    page.locator(".place:visible .exports").wait_for()


@pytest.mark.forms(0, 3)
def test_a_failed_job_looks_failed_and_a_page_that_loads_says_so(
    page: Page, studio: Studio
) -> None:
    (studio.folder / "gone.txt").write_text("#####\n#...#\n#####\n")
    studio.open(page, "vessels", {"problem": {"map": "gone.txt", "particles": 1}, "seed": 0})
    page.locator(".underStage .facts", has_text="3 free").wait_for()
    (studio.folder / "gone.txt").unlink()
    page.get_by_role("button", name="Run", exact=True).click()
    page.locator(".note.bad", has_text="gone.txt").wait_for()
    assert page.locator(".note.bad").count() == 1
    assert page.locator(".panel:not([hidden]) .exports").count() == 0
    page.get_by_role("button", name="Jobs").click()
    job = page.locator(".job.failed", has_text="gone.txt").first
    job.get_by_text("No such file").wait_for()
    assert job.get_by_role("button", name="Cancel").count() == 0
    bad = page.locator(".note.bad").evaluate("note => getComputedStyle(note).color")
    assert job.locator("p").evaluate("words => getComputedStyle(words).color") == bad
    page.keyboard.press("Escape")
    # it is not said any more when its cause is gone
    (studio.folder / "gone.txt").write_text("#####\n#...#\n#####\n")
    page.get_by_role("button", name="Run", exact=True).click()
    page.locator(".panel:not([hidden]) .exports").wait_for()
    assert page.locator(".note.bad").count() == 0

    studio.open(page, "start")
    page.route("**/api/ask/**", lambda _: None)  # an answer that does not come
    for place in ("vessels", "steering", "search", "lab", "papers"):
        page.evaluate(f"location.hash = '{place}'")
        page.locator(".place:visible, .lab:visible, .papers:visible").get_by_text(
            re.compile("^(opening|planning|Reading) .*…$")
        ).first.wait_for()
    page.evaluate("location.hash = 'lab'")
    tab(page, "New sweep")
    page.get_by_text("Reading the fields of sweeps …").wait_for()
    page.unroute("**/api/ask/**")
