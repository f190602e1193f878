"""The studio, used as people use it: each flow ends in a file, or in numbers that the library
gives, too.
"""

from __future__ import annotations

import json
import os
import re
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from playwright.sync_api import Page, expect
from tests.browser.studio import HOSTILE, Studio, run_and_load, tab, tab_to
from tests.browser.waiting import PATIENCE, settle, until

import shoal
from shoal.papers.reproduce import recipes
from shoal.steering import SteeringProblem
from shoal.swarm import SwarmProblem
from shoal.swarm.maps.files import vessel_map

pytestmark = pytest.mark.browser


def test_the_address_opens_the_page_and_keeps_no_secret(page: Page, studio: Studio) -> None:
    assert "token" not in page.url
    assert page.locator("#folder").inner_text() == studio.folder.name


@pytest.mark.chromium("reduced motion")
def test_a_run_is_played_and_is_the_episode_of_the_library(page: Page, studio: Studio) -> None:
    given = {"map": "maze:9x7", "particles": 4, "policy": "closest-frontier"}
    studio.open(page, "vessels", {"problem": given, "seed": 3})
    episode = run_and_load(page, studio)
    expected = shoal.run(SwarmProblem(**given), seed=3)
    assert (episode.problem, episode.commands) == (expected.problem, expected.commands)
    frame = page.frame_locator(".panel:not([hidden]) iframe:not([hidden])")
    assert frame.locator("#of").inner_text() == f"of {expected.moves}"
    assert frame.locator("#share").inner_text() == "100 %"
    for name in ("PNG", "HTML"):
        page.locator(".panel:not([hidden]) .exports").get_by_text(name, exact=True).click()
        page.locator(".note", has_text=f".{name.lower()}").wait_for()
    assert {path.suffix for path in studio.folder.iterdir()} >= {".png", ".html", ".npz"}


@pytest.mark.forms(0, 3)
def test_a_long_seed_is_seen_whole(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": {"map": "maze:9x7", "particles": 2}, "seed": 1})
    seed = page.get_by_label("Seed", exact=True)
    widths = []
    for value in ("1", str(2**63 - 1)):
        seed.fill(value)
        box = seed.bounding_box()
        assert box is not None
        widths.append(box["width"])
        assert box["x"] + box["width"] <= page.viewport_size["width"]
    assert widths[1] > widths[0] + 18 * 6  # as many digits more


def test_noise_is_shown_at_the_end(page: Page, studio: Studio) -> None:
    given = {"map": "maze:9x7", "particles": 4, "policy": "closest-frontier", "slip": 0.1}
    studio.open(page, "vessels", {"problem": given, "seed": 1})
    assert run_and_load(page, studio).commands == shoal.run(SwarmProblem(**given), seed=1).commands


def test_cells_painted_by_numbers_are_undone_and_kept(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": {"map": "rectangle:6x8", "particles": 3}, "seed": 0})
    page.get_by_text("By numbers").click()
    page.get_by_label("What to paint").select_option("wall")
    for name, value in (("row", 1), ("column", 2), ("rows", 2), ("columns", 3)):
        page.locator(f".numbers input[name={name}]").fill(str(value))
    page.get_by_role("button", name="Apply").click()
    page.locator(".underStage .facts").get_by_text("6 rows × 8 columns, 42 free").wait_for()
    page.get_by_role("button", name="Undo").click()
    page.locator(".underStage .facts").get_by_text("48 free").wait_for()
    page.get_by_role("button", name="Redo").click()
    episode = run_and_load(page, studio)
    free = np.ones((6, 8), dtype=bool)
    free[1:3, 2:5] = False
    assert np.array_equal(episode.workspace.free, free)
    assert episode.problem.map == "rectangle-painted.png"
    # by hand, on an empty canvas: what is set besides the map stays
    page.get_by_label("A new map").select_option("canvas")
    page.locator(".underStage .facts").get_by_text("0 free").wait_for()
    hint = page.locator(".warning", has_text="Paint free cells")
    hint.wait_for()
    tab(page, "Episode")
    assert not hint.is_visible()  # a hint about the map lies over no button of a run
    tab(page, "Map")
    page.get_by_label("What to paint").select_option("free")
    page.get_by_role("button", name="Apply").click()
    page.locator(".underStage .facts").get_by_text(" 6 free cells, 3 particles").wait_for()
    page.get_by_role("button", name="Apply").press("Escape")
    until(page, "!document.querySelector('details.by[open]')")
    assert not page.locator(".stage-side > .warning").is_visible()
    episode = run_and_load(page, studio)
    assert np.argwhere(episode.workspace.free).tolist() == [
        [row, column] for row in (1, 2) for column in (2, 3, 4)
    ]


def test_an_inlet_is_where_particles_start(page: Page, studio: Studio) -> None:
    studio.open(
        page,
        "vessels",
        {
            "problem": {"map": "rectangle:6x8", "particles": 4, "policy": "closest-frontier"},
            "seed": 0,
        },
    )
    page.get_by_text("By numbers").click()
    page.get_by_label("What to paint").select_option("inlet")
    for name, value in (("row", 0), ("column", 0), ("rows", 2), ("columns", 2)):
        page.locator(f".numbers input[name={name}]").fill(str(value))
    page.get_by_role("button", name="Apply").click()
    assert run_and_load(page, studio).start.tolist() == [[0, 0], [0, 1], [1, 0], [1, 1]]


@pytest.mark.parametrize("limit", [{}, {"max_moves": 1}])
def test_a_race_driven_by_keys_is_kept(page: Page, studio: Studio, limit: dict[str, int]) -> None:
    problem = {"map": "line:4", "particles": 1} | limit
    studio.open(page, "vessels", {"problem": problem, "seed": 1})
    start = shoal.run(SwarmProblem("line:4", particles=1), seed=1).start[0, 1]
    # the plan has ended before the studio hears that somebody watches it
    page.evaluate("""() => {
        const { send } = WebSocket.prototype;
        WebSocket.prototype.send = function (words) { setTimeout(() => send.call(this, words), 800); };
    }""")
    tab(page, "Drive")
    page.get_by_role("button", name="Start the race").click()
    page.wait_for_selector(".pad:not([hidden])")
    for key in (
        ["ArrowLeft"] * (int(start) + 1)
        + ["ArrowRight"] * 4
        + ["ArrowUp", "ArrowDown"]
        + ["ArrowUp", "ArrowLeft"] * 3
    ):
        page.keyboard.press(key)
    for key in ["ArrowDown", "ArrowUp", "ArrowLeft"] * 4 + [
        "ArrowDown",
        "ArrowUp",
        "ArrowRight",
    ] * 4:
        page.keyboard.press(key)
    page.wait_for_selector(".race .exports")
    verdict = page.locator(".race .verdict").inner_text()
    if limit:
        assert verdict.endswith("did not finish: its run ended after 1 move. You win.")
    else:
        assert re.search(
            r"Done in \d+ moves?; \S+ needed \d+\. (A draw|You win|The ghost wins)\.$", verdict
        )
    kept = [shoal.load(path) for path in studio.folder.glob("line-4-manual*.npz")]
    assert [bool(episode) for episode in kept] == [True]
    assert kept[0].start.tolist() == [[0, start]]


def test_policies_are_compared_from_the_same_starts(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": {"map": "maze:9x7", "particles": 3}, "seed": 2})
    tab(page, "Compare")
    page.locator("#compareTrials").fill("4")
    page.get_by_role("button", name="Compare", exact=True).click()
    page.wait_for_selector(".quad iframe:not([hidden])", timeout=60_000)
    cells = page.locator(".compare tbody tr").all()
    for row, policy in zip(cells, ("best", "closest-frontier"), strict=True):
        episodes = [
            shoal.run(SwarmProblem("maze:9x7", particles=3, policy=policy), seed=2, trial=trial)
            for trial in range(4)
        ]
        assert (
            row.locator("td").first.inner_text()
            == f"{np.mean([one.moves for one in episodes]):.4g}"
        )
    # all players share their zoom
    tab(page, "Drive")
    page.get_by_role("button", name="Start the race").click()
    page.wait_for_selector(".pad:not([hidden])")
    tab(page, "Compare")
    view = playing(page).evaluate("""() => {
        shoalPlayer.picture.zoomAt(3, 60, 60);
        return shoalPlayer.picture.view;
    }""")
    assert view["wide"] < 1
    tab(page, "Drive")
    assert playing(page).evaluate("shoalPlayer.picture.view") == pytest.approx(view)


def test_names_are_text(page: Page, studio: Studio) -> None:
    studio.open(
        page,
        "vessels",
        {"problem": {"map": f"{HOSTILE}.txt", "particles": 1, "policy": "<b>x"}, "seed": 0},
    )
    page.wait_for_timeout(300)
    studio.open(page, "vessels", {"problem": {"map": f"{HOSTILE}.txt", "particles": 1}, "seed": 0})
    until(page, "document.querySelector('.source').textContent.includes('<img')")
    assert page.locator("img[src=x]").count() == 0


def test_a_script_from_the_page_is_that_of_the_library(page: Page, studio: Studio) -> None:
    studio.open(page, "vessels", {"problem": {"map": "maze:9x7", "particles": 4}, "seed": 5})
    page.get_by_role("button", name="As Python").click()
    page.wait_for_selector(".sheet[open]")
    names: dict[str, Any] = {}
    exec(page.locator(".code").inner_text(), names)
    page.get_by_role("tab", name="As command").click()
    assert page.locator(".code").inner_text() == "shoal map maze:9x7 --particles=4 --seed=5"
    page.keyboard.press("Escape")
    assert (
        names["episode"].commands
        == shoal.run(SwarmProblem("maze:9x7", particles=4), seed=5).commands
    )


def test_particles_are_steered_by_keys_and_the_plan_is_the_librarys(
    page: Page, studio: Studio
) -> None:
    given = {
        "workspace": "square",
        "start": [[0.2, 0.3], [0.5, 0.35]],
        "goal": [[0.8, 0.2], [0.3, 0.75]],
        "planner": "greedy",
    }
    studio.open(page, "steering", {"problem": given, "seed": 0})
    tab_to(page, "Particle 1 at 0.2, 0.3")
    page.keyboard.press("ArrowUp")
    moved = given | {"start": [[0.2, 0.31], [0.5, 0.35]]}
    expected = shoal.run(SteeringProblem(**moved))
    page.locator(".plan", has_text="greedy").get_by_text(
        f"{expected.moves} moves, length {expected.length:.4g}"
    ).wait_for()
    page.locator(".reach").nth(1).wait_for(state="attached")
    episode = run_and_load(page, studio, "Play", by_keys=True)
    assert np.array_equal(episode.inputs, expected.inputs)
    page.wait_for_selector(".panel:not([hidden]) iframe:not([hidden])")


def test_a_figure_of_a_paper_is_run_again(page: Page, studio: Studio) -> None:
    studio.open(page, "papers", {})
    until(page, f"document.querySelectorAll('.paper h3').length === {len(list(recipes()))}")
    assert page.locator(".note.bad").count() == 0
    tab_to(page, "Run quickly: m-theorem1")
    page.keyboard.press("Enter")
    verdict = page.locator(".verdictChip")
    verdict.wait_for()
    summary = json.loads((studio.folder / "papers" / "m-theorem1.json").read_text())
    assert verdict.inner_text() == summary["verdict"]
    until(
        page,
        "document.querySelector('.paper img').complete && document.querySelector('.paper"
        " img').naturalWidth > 100",
    )
    assert page.locator(".paper tbody tr").count() == len(summary["claims"])


def test_jobs_of_a_killed_server_are_found_again_and_no_process_is_left(
    page: Page, studio: Studio
) -> None:
    ask = """async (job) => (await fetch('/api/jobs', job === null ? {} : {
      method: 'POST', headers: {'content-type': 'application/json'}, body: JSON.stringify(job),
    })).json()"""
    sweep = (
        'name = "kept"\ntrials = 100000\n[problem]\nkind = "line"\ncells = 99\nparticles ='
        " 9\nplacements = 999\n"
    )
    jobs: list[dict[str, Any]] = [
        {"kind": "sweep", "spec": {"toml": sweep, "store": "kept.sqlite", "sweep": "kept"}}
    ]
    problem = {"kind": "swarm", "map": "maze:301x301", "particles": 40, "policy": "best"}
    jobs += [{"kind": "play", "spec": {"problem": problem, "seed": seed}} for seed in (1, 2)]
    numbers = [page.evaluate(ask, job)["id"] for job in jobs]
    until(page, "document.getElementById('jobsWord').textContent.startsWith('3')")
    patience = time.monotonic() + 30
    while not (studio.folder / "kept.sqlite").exists() and time.monotonic() < patience:
        time.sleep(0.02)
    below = descendants(studio.process.pid)
    page.goto("about:blank")
    studio.end(signal.SIGKILL)
    assert below
    gone_by = time.monotonic() + 5
    while (
        left := [pid for pid in below if os.path.exists(f"/proc/{pid}") and not zombie(pid)]
    ) and time.monotonic() < gone_by:
        time.sleep(0.02)
    assert left == []
    studio.begin()
    page.goto(studio.address)
    page.wait_for_selector("body[data-ready]")
    states = {job["id"]: job["state"] for job in page.evaluate(ask, None)["jobs"]}
    assert all(states[number] in ("queued", "running", "done") for number in numbers)
    for number in numbers:
        page.evaluate(f"fetch('/api/jobs/{number}', {{method: 'DELETE'}})")
    until(page, "document.getElementById('jobsWord').textContent === 'Jobs'")


def descendants(pid: int) -> list[int]:
    parents = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                parents[int(entry.name)] = int(
                    (entry / "stat").read_text().rpartition(")")[2].split()[1]
                )
            except (FileNotFoundError, ProcessLookupError):
                continue
    found = [pid]
    for one in found:
        found += [child for child, parent in parents.items() if parent == one]
    return found[1:]


def zombie(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def column(page: Page) -> NDArray[np.float64]:
    """The colours in the middle of the map's canvas, from above to below."""
    settle(page)
    found = page.locator(".editor canvas").evaluate(
        """(canvas) => {
            const copy = document.createElement("canvas"), pen = copy.getContext("2d");
            [copy.width, copy.height] = [1, canvas.height];
            pen.drawImage(canvas, -(canvas.width >> 1), 0);
            return [...pen.getImageData(0, 0, 1, canvas.height).data];
        }"""
    )
    return np.array(found, dtype=np.float64).reshape(-1, 4)[:, :3]


def luminance(colour: NDArray[np.float64]) -> float:
    linear = np.where(colour <= 10, colour / 255 / 12.92, ((colour / 255 + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


@pytest.mark.forms(0)
def test_a_photograph_lies_below_its_map_and_its_vessels_stand_out(
    page: Page, studio: Studio
) -> None:
    image = Image.new("RGB", (240, 240), (190, 70, 55))
    pen = ImageDraw.Draw(image)
    for line in ((10, 90, 120, 80, 230, 100), (120, 80, 160, 10), (80, 84, 60, 230)):
        pen.line(line, (110, 25, 25), 12)
    image.save(studio.folder / "tissue.png")
    given = {"map": "tissue.png", "vessels": True, "width": 60, "particles": 5}
    studio.open(page, "vessels", {"problem": given | {"policy": "closest-frontier"}, "seed": 1})
    page.locator(".facts", has_text="confidence").wait_for()
    seen = column(page)
    seen = seen[len(seen) // 9 : -len(seen) // 9]  # the photograph without what is around it
    tissue = luminance(np.array([190.0, 70.0, 55.0])) + 0.05
    assert max(luminance(colour) + 0.05 for colour in seen) / tissue > 3
    page.locator(".editor canvas").hover()
    page.locator(".where", has_text=re.compile(r"^pixel 1[12]\d, 1[12]\d$")).wait_for()
    said = page.locator(".underStage .facts", has_text="of the photograph").inner_text()
    found = vessel_map(str(studio.folder / "tissue.png"), width=60)
    left, top, right, bottom = found.picture_box
    taken = f"{(right - left) * (bottom - top) / 240**2:.1%}".replace("%", " %")
    assert f"the map: {taken} of the photograph" in said
    assert ("separate part" in said) == (found.dropped[0] > 0)

    # cells and photograph share their zoom
    canvas = page.locator(".editor canvas")
    places = []
    for name in ("Cells", "Photograph", "Cells"):
        page.get_by_role("button", name=name, exact=True).click()
        kind, fact = ("row", "free cells") if name == "Cells" else ("pixel", "confidence")
        page.locator(".facts", has_text=fact).wait_for()
        if not places:
            canvas.hover(position={"x": 420, "y": 200})
            page.mouse.wheel(0, -600)
        settle(page)
        canvas.hover(position={"x": 300, "y": 210})
        where = page.locator(".where", has_text=re.compile(f"^{kind}"))
        where.wait_for()
        places.append([float(part) for part in re.findall(r"\d+", where.inner_text())])
    assert places[2] == places[0]
    cells = np.array(places[1]) / 240 * 60  # of the whole photograph
    assert np.abs(cells - places[0]).max() < 4
    page.keyboard.press("0")
    canvas.focus()
    page.keyboard.press("0")

    page.get_by_role("button", name="Cells", exact=True).click()
    below, share = page.get_by_label("Photograph below"), page.get_by_label("How much of the")
    below.wait_for()
    row = int(0.7 * len(seen))
    half = column(page)[row]
    share.fill("0.95")
    most = column(page)[row]
    below.uncheck()
    none = column(page)[row]
    assert np.abs(most - (190, 70, 55)).max() < 16
    assert (most - none)[0] > 1.5 * (half - none)[0] > 60
    page.locator(".editor canvas").hover()
    page.locator(".where", has_text=re.compile(r"^row \d+, column \d+$")).wait_for()

    below.check()
    run_and_load(page, studio)
    player = page.frame_locator(".frames iframe:not([hidden])")
    assert player.locator("body").evaluate("() => shoalPlayer.picture.below.share") == 0.95

    def obstacle() -> str:
        swatch = player.locator(".swatch.obstacle")
        return str(swatch.evaluate("(one) => getComputedStyle(one).backgroundColor"))

    red, green, blue = (int(part) for part in re.findall(r"\d+", obstacle()))
    assert red > 150 > green > blue  # as it is drawn on the tissue
    page.get_by_label("Photograph below").uncheck()
    assert player.locator("body").evaluate("() => shoalPlayer.picture.below") is None
    assert obstacle() == "rgb(27, 34, 44)"
    # with the zoom of the cells
    tab(page, "Map")
    page.get_by_role("button", name="Cells", exact=True).click()
    canvas.hover(position={"x": 300, "y": 210})
    page.mouse.wheel(0, -600)
    settle(page)
    wanted = page.locator(".where", has_text="row").inner_text()
    tab(page, "Episode")
    view = player.locator("body").evaluate("() => shoalPlayer.picture.view")
    assert view["wide"] < 1.5
    tab(page, "Map")
    canvas.hover(position={"x": 300, "y": 210})
    assert page.locator(".where", has_text="row").inner_text() == wanted
    tab(page, "Episode")
    player.locator("#picture").hover()
    assert re.fullmatch(r"row \d+, column \d+", player.locator("#where").inner_text())

    # as under a race and under all films of a comparison
    tab(page, "Drive")
    page.get_by_role("button", name="Start the race").click()
    page.wait_for_selector(".pad:not([hidden])")
    tab(page, "Compare")
    page.locator("#compareTrials").fill("2")
    page.get_by_role("button", name="Compare", exact=True).click()
    page.wait_for_selector(".quad iframe:not([hidden])", timeout=60_000)
    for place, count in ((".race", 1), (".quad", 2)):
        frames = page.locator(f"{place} iframe:not([hidden])")
        expect(frames).to_have_count(count)
        players = [frame.content_frame.locator("body") for frame in frames.all()]
        for checked, share in ((True, 0.95), (False, None)):
            page.get_by_label("Photograph below").set_checked(checked)
            for player in players:
                below = player.evaluate("() => shoalPlayer.picture.below?.share ?? null")
                assert below == share

    # what moves stands out from any photograph, light or dark: from one of them by a line around it
    page.get_by_role("button", name="Run", exact=True).click()
    page.locator(".panel:not([hidden]) .exports").wait_for()
    marks(page, None, (0, 0, 0))
    tab(page, "Drive")
    page.get_by_role("button", name="Start the race").click()
    page.locator(".pad:not([hidden])").wait_for()
    until(page, "document.activeElement?.tagName === 'IFRAME'")
    for key in ["ArrowLeft"] * 3 + ["ArrowDown"] * 4 + ["ArrowRight"] * 3:
        page.keyboard.press(key)
    page.get_by_text("at move 10").wait_for()
    marks(page, DARK_GHOST, (255, 255, 255))


def playing(page: Page) -> Any:
    """The frame of the player on the stage."""
    shown = page.locator(".panel:not([hidden]) iframe:not([hidden])").first.element_handle()
    frame = shown.content_frame()
    assert frame is not None
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        if frame.evaluate("!!window.shoalPlayer?.picture"):
            return frame
        page.wait_for_timeout(20)
    raise AssertionError("no player")


DARK_GHOST = (58, 36, 120)
MARKS = """async ([photograph, colour, line]) => {
    const {picture} = shoalPlayer, image = new OffscreenCanvas(8, 8), pen = image.getContext("2d");
    pen.fillStyle = photograph;
    pen.fillRect(0, 0, 8, 8);
    if (!colour) shoalPlayer.goTo(1);
    picture.setBelow({image, box: [0, 0, 1, 1], share: 1});
    shoalPlayer.redraw();
    await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    const {width, height} = picture.canvas, copy = new OffscreenCanvas(width, height).getContext("2d");
    copy.drawImage(picture.canvas, 0, 0);
    const {data} = copy.getImageData(0, 0, width, height);
    const is = ([r, g, b], i) => data[4 * i] === r && data[4 * i + 1] === g && data[4 * i + 2] === b;
    const mark = colour ?? picture.palette.frontier;
    let marked = 0, beside = 0, lined = 0;
    for (let i = 0; i < data.length / 4; i++) {
        lined += [0, 1, 2].every((k) => Math.abs(data[4 * i + k] - line[k]) < 20);
        if (!is(mark, i)) continue;
        marked += 1;
        for (const j of [i - 1, i + 1, i - width, i + width])
            beside += is([128, 128, 128], j);
    }
    return {mark, marked, beside, lined};
}"""


def marks(page: Page, colour: tuple[int, ...] | None, line: tuple[int, ...]) -> None:
    """Check that marks of a colour (None: the frontier) have at least 3:1 to a white and to a black
    photograph, or a line around them that has.
    """
    for grey in (255, 0, 128):
        below = (grey, grey, grey)
        found = playing(page).evaluate(MARKS, [f"rgb{below}", colour, line])
        assert min(found["marked"], found["lined"]) > 10
        if grey == 128:  # nothing but the line is between a mark and the photograph
            assert found["beside"] == 0
        assert max(apart(found["mark"], below), apart(line, below)) >= 3
        assert apart(line, found["mark"]) >= 3


def apart(*colours: tuple[int, ...]) -> float:
    """The contrast of two colours, as WCAG 2 defines it."""
    low, high = sorted(luminance(np.array(colour, dtype=np.float64)) for colour in colours)
    return (high + 0.05) / (low + 0.05)
