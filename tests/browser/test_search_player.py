"""The player of searches: it shows what the episode tells, and every control works."""

from __future__ import annotations

import json
import re
from functools import cache

import numpy as np
import pytest
import shapely
from playwright.sync_api import Page
from tests.browser.waiting import settle, stays_drawn, until
from tests.search_episodes import search

from shoal.search import SearchEpisode, SearchProblem, region_of
from shoal.search.problem.network import Crash, Liar, Pause
from shoal.search.run import run
from shoal.views.player import render
from shoal.views.search.history import SearchHistory
from shoal.views.search.page import page_data, player_page

pytestmark = pytest.mark.browser

TWO = shapely.MultiPolygon([shapely.box(0, 0, 40, 30), shapely.box(70, 10, 100, 40)])


@cache
def ring() -> SearchEpisode:
    return search(
        "ring:60x40",
        robots=4,
        footprint=10,
        loss=0.2,
        faults=[Crash(2, 9.0), Pause(3, 5, 12)],
        targets=3,
        seed=3,
    )


CASES = {
    "ring": ring,
    "one cell": lambda: search("square:5", robots=1, footprint=10),
    "reserve": lambda: search("square:20", robots=7, footprint=10, starts="line"),
    "all dead": lambda: search(
        "rectangle:90x40", robots=2, footprint=10, faults=[Crash(1, 0.0), Crash(2, 7.0)]
    ),
    "two parts, a liar": lambda: search(
        region_of(TWO), robots=3, footprint=10, transit=True, faults=[Liar(1)]
    ),
}


def played(page: Page, times: list[float]) -> list[list[object]]:
    return page.evaluate(
        """times => times.map((time) => {
            shoalPlayer.seek(time);
            return [shoalPlayer.searched, shoalPlayer.points, shoalPlayer.doing, document.getElementById('searched').textContent];
        })""",
        times,
    )


@pytest.mark.parametrize("name", CASES)
def test_shows_what_the_episode_tells(name, open_player):
    history = SearchHistory(CASES[name]())
    page = open_player(player_page(history.episode))
    rng = np.random.default_rng(1)
    moments = np.sort(np.concatenate([[0.0, history.end], rng.uniform(0, history.end, 40)]))
    rng.shuffle(moments)  # backwards, too
    for time, (count, points, doing, words) in zip(
        moments, played(page, moments.tolist()), strict=True
    ):
        assert count == history.searched(time + 1e-3)
        assert words == f"{count:,}"
        places = np.array([trajectory.at(time) for trajectory in history.trajectories])
        np.testing.assert_allclose(points, places, atol=0.05)
        kinds = [
            [one.kind for one in activities if one.begin <= time + 1e-3][-1]
            for activities in history.activities
        ]
        assert doing == kinds
    page.keyboard.press("End")
    assert page.evaluate("shoalPlayer.searched") == history.searched(history.end)
    assert page.locator("#robots button .done").all_inner_texts() == [
        f"{len(log.cells):,}" for log in history.episode.trace.robots
    ]


def test_plays_and_steps(open_player):
    page = open_player(player_page(ring()))
    page.select_option("#speed", "8")
    page.click("#play")
    assert page.get_attribute("#play", "aria-label") == "Pause"
    until(page, "!shoalPlayer.playing")
    assert page.evaluate("shoalPlayer.time") == page.evaluate("shoalPlayer.length")
    page.keyboard.press("Home")
    assert page.evaluate("shoalPlayer.time") == 0
    page.locator("#speed").blur()
    page.keyboard.press("ArrowRight")
    page.click("#forward")
    page.keyboard.press("Shift+ArrowRight")
    assert page.evaluate("shoalPlayer.time") == 12
    page.click("#back")
    assert page.evaluate("shoalPlayer.time") == 11
    page.keyboard.press("Space")
    until(page, "shoalPlayer.time > 11")
    page.keyboard.press("Space")
    assert not page.evaluate("shoalPlayer.playing")


def test_rows_seek_and_tell(open_player):
    page = open_player(player_page(ring()))
    box = page.locator("#chart").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 5)
    assert page.evaluate("shoalPlayer.time / shoalPlayer.length") == pytest.approx(0.5, abs=0.01)
    page.mouse.move(box["x"] + box["width"] * 0.95, box["y"] + box["height"] * 3 / 8)
    assert "robot 2 dead" in page.inner_text("#hover")
    page.evaluate(
        "const s = document.getElementById('scrub'); s.value = 3000; s.dispatchEvent(new"
        " Event('input'))"
    )
    assert page.evaluate("shoalPlayer.time") == 3


def test_a_robot_is_followed_and_let_go(open_player):
    page = open_player(player_page(ring()))
    page.evaluate("shoalPlayer.seek(10)")
    settle(page)
    plain = page.locator("#picture").screenshot()
    button = page.locator("#robots button").nth(2)
    button.click()
    assert page.evaluate("shoalPlayer.chosen") == 2
    assert button.get_attribute("aria-pressed") == "true"
    settle(page)
    assert page.locator("#picture").screenshot() != plain
    button.click()
    assert page.evaluate("shoalPlayer.chosen") == -1
    settle(page)
    assert page.locator("#picture").screenshot() == plain
    assert page.locator("#robots button .state").all_inner_texts()[1:3] == ["dead", "paused"]


def test_themes_and_zoom(open_player):
    page = open_player(player_page(ring()))
    before = page.screenshot()
    page.keyboard.press("d")
    settle(page)
    assert page.screenshot() != before
    box = page.locator("#picture").bounding_box()
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.wheel(0, -300)
    until(page, "shoalPlayer.zoom > 1")
    assert page.locator("#fit").is_visible()
    page.keyboard.press("f")
    assert page.evaluate("shoalPlayer.zoom") == 1
    assert stays_drawn(page)


def test_cells_have_the_colours_of_their_robots(open_player):
    """Pixels of the canvas are compared with the figure's rule, at the end, in the middle between
    ways.
    """
    history = SearchHistory(search("square:40", robots=1, footprint=20))
    page = open_player(player_page(history.episode))
    page.keyboard.press("End")
    settle(page)
    colour = page.evaluate("""(() => {
        const canvas = document.getElementById('picture'), { width, height } = canvas;
        const unit = devicePixelRatio * parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;
        const side = Math.min(width, height) - 44 * unit;
        const [x, y] = [width, height].map((length) => Math.round(length / 2 - side * 0.45));
        const pixel = canvas.getContext('2d').getImageData(x, y, 1, 1);
        return [...pixel.data];
    })()""")
    wanted = [round(255 + 0.18 * (part - 255)) for part in (0x00, 0x72, 0xB2)]
    np.testing.assert_allclose(colour[:3], wanted, atol=2)


@pytest.mark.parametrize("size", [(1400, 900), (390, 844), (844, 390)])
def test_fits_every_screen(size, open_player):
    page = open_player(player_page(ring()), viewport={"width": size[0], "height": size[1]})
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    for name in ("#picture", "#play", "#scrub", "#forward", "#robots", "#chart"):
        box = page.locator(name).bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= size[0] + 1
    box = page.locator("#play").bounding_box()
    assert box["y"] + box["height"] <= size[1]  # what plays it is in sight
    assert (
        min(
            page.evaluate(
                "[document.getElementById('picture').width,"
                " document.getElementById('picture').height]"
            )
        )
        > 200
    )


def test_every_button_has_a_name_and_can_be_focused(open_player):
    page = open_player(player_page(ring()))
    for button in page.locator("button:visible").all():
        assert button.get_attribute("aria-label") or button.inner_text().strip()
        button.focus()
        assert button.evaluate("element => element === document.activeElement")


def test_nothing_in_the_data_can_close_the_script(open_player):
    hostile = "</script><script>alert(1)</script><img src=x onerror=alert(1)> \u2028"
    page = render("search", page_data(ring()) | {"tour": hostile, "title": hostile})
    assert hostile not in page
    block = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert block is not None
    assert json.loads(block[1])["tour"] == hostile
    assert "<img src=x" in open_player(page).inner_text("h1")


def test_damaged_data_gets_one_sentence(visitor, tmp_path):
    (tmp_path / "player.html").write_text(render("search", {"title": "x"}), encoding="utf-8")
    page = visitor.plain
    page.goto((tmp_path / "player.html").as_uri())
    assert page.inner_text("body").strip() == "This film cannot be shown. Its data is damaged."
    visitor.messages.clear()


def test_heat_and_the_probability_of_success(open_player):
    problem = SearchProblem("square:80", robots=2, prior=["ring:20,60:0.5=15"], detection=0.7)
    history = SearchHistory(run(problem, seed=1))
    page = open_player(player_page(history.episode))
    for time in (history.end, history.end / 3, 0.0):
        page.evaluate(f"shoalPlayer.seek({time})")
        assert page.evaluate("shoalPlayer.success") == pytest.approx(
            history.success_at(time), abs=1e-5
        )
        words = f"{round(100 * history.success_at(time))} %"
        until(page, f"document.getElementById('details').innerText.includes('{words}')")


def test_every_look_cools_the_ground(open_player):
    ring = {"prior": ["ring:20,60:0.5=15"], "detection": 0.7, "at_most": 1.4}
    history = SearchHistory(run(SearchProblem("square:80", robots=2, **ring), seed=1))
    assert len(history.panels.labels) > 1  # layers of further looks
    page = open_player(player_page(history.episode))
    for time in (history.end, history.end / 3, 0.0):
        page.evaluate(f"shoalPlayer.seek({time})")
        page.evaluate("shoalPlayer.drawNow()")
        heat = 255 * history.raster(history.heat(time), 0.0).ravel()
        assert np.abs(np.array(page.evaluate("shoalPlayer.heat")) - heat).max() < 0.6
