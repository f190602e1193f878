"""The player of steering episodes: it shows the episode's states, and every control works."""

from __future__ import annotations

import json
import re
from functools import cache

import numpy as np
import pytest
from playwright.sync_api import Page
from tests.browser.waiting import settle, stays_drawn, until
from tests.steering import steer, thrown

from shoal.steering import SteeringProblem, open_workspace, prism, region, regular_polygon
from shoal.views.player import render
from shoal.views.steering.page import page_data, player_page
from shoal.views.steering.trajectories import FilmSchedule, trajectories_of

pytestmark = pytest.mark.browser

SQUARE = open_workspace("square")
START, GOAL = np.array([(0.2, 0.3), (0.5, 0.35)]), np.array([(0.8, 0.2), (0.3, 0.75)])


@cache
def plan():
    return steer(SteeringProblem(SQUARE, START, GOAL), planner="greedy")


def tall():
    moves = np.random.default_rng(2).normal(scale=0.4, size=(5, 3))
    return thrown(
        prism(regular_polygon(7), 0.8), np.array([(0.1, 0.2, 0.3), (0.0, 0.1, 0.6)]), moves
    )


def yard():
    """Seven particles among obstacles, and 40 moves."""
    room = region([(0, 0), (4, 0), (4, 3), (0, 3)], [[(1, 1), (2, 1), (2, 2), (1, 2)]])
    rng = np.random.default_rng(4)
    start = np.array(
        [(0.3, 0.3), (0.5, 2.5), (3.0, 1.0), (2.5, 0.5), (3.5, 2.5), (0.5, 1.5), (2.5, 1.5)]
    )
    return thrown(room, start, rng.normal(size=(40, 2)))


def noisy():
    moves = np.random.default_rng(1).normal(scale=0.4, size=(6, 2))
    return thrown(SQUARE, START, moves, execution=0.01, gain=0.3)


def done(page: Page) -> int:
    return int(page.evaluate("shoalPlayer.done"))


@pytest.mark.parametrize("make", [plan, tall, yard, noisy])
def test_states_after_each_move(make, open_player):
    episode = make()
    page = open_player(player_page(episode))
    assert page.evaluate("shoalPlayer.length") == episode.moves
    shown = page.evaluate("""Array.from({ length: shoalPlayer.length + 1 }, (_, move) => {
        shoalPlayer.seek(move);
        return [shoalPlayer.done, shoalPlayer.points];
    })""")
    assert [entry[0] for entry in shown] == list(range(episode.moves + 1))
    np.testing.assert_array_equal([entry[1] for entry in shown], episode.states)
    page.evaluate("shoalPlayer.seek(1)")
    held = {tuple(pair) for pair in page.evaluate("shoalPlayer.held")}
    assert held == set(trajectories_of(episode)[0].holders(1))
    assert page.inner_text("#move") == "1"
    assert page.inner_text("#length") == f"length {np.linalg.norm(episode.inputs[0]):.3f}"


def test_moments_are_those_of_films(open_player):
    episode = noisy()
    trajectories = trajectories_of(episode)
    schedule = FilmSchedule(trajectories, size=1.0)
    page = open_player(player_page(episode))
    times = np.linspace(0, schedule.seconds, 40)
    shown = page.evaluate(
        """times => times.map((time) => {
            const scrub = document.getElementById('scrub');
            scrub.value = 1000 * time;
            scrub.dispatchEvent(new Event('input'));
            return [shoalPlayer.time, shoalPlayer.points];
        })""",
        times.tolist(),
    )
    np.testing.assert_allclose([entry[0] for entry in shown], times, atol=1e-3)
    for time, points in shown:
        moment = schedule.at(time)
        np.testing.assert_allclose(points, trajectories[moment.move].at(moment.share), atol=1e-12)


def test_plays_and_steps(open_player):
    episode = plan()
    page = open_player(player_page(episode))
    page.select_option("#speed", "8")
    page.click("#play")
    assert page.get_attribute("#play", "aria-label") == "Pause"
    until(page, "!shoalPlayer.playing")
    assert done(page) == episode.moves
    assert page.inner_text("#distance0") == "at its goal"
    page.keyboard.press("Home")
    assert (done(page), page.evaluate("shoalPlayer.time")) == (0, 0)
    page.select_option("#speed", "0.25")
    page.locator("#speed").blur()
    page.keyboard.press("ArrowRight")  # is shown moving, and stops by itself
    assert page.evaluate("shoalPlayer.playing")
    page.select_option("#speed", "8")
    page.locator("#speed").blur()
    until(page, "!shoalPlayer.playing")
    np.testing.assert_array_equal(page.evaluate("shoalPlayer.points"), episode.states[1])
    page.select_option("#speed", "0.25")
    page.locator("#speed").blur()
    page.click("#forward")
    page.click("#forward")  # at once
    assert done(page) == 2
    page.keyboard.press("ArrowLeft")
    assert done(page) == 1
    page.keyboard.press("End")
    np.testing.assert_array_equal(page.evaluate("shoalPlayer.points"), episode.final)
    page.keyboard.press("Space")  # from the beginning
    until(page, "shoalPlayer.time > 0 && shoalPlayer.done < 2")
    page.keyboard.press("Space")
    assert not page.evaluate("shoalPlayer.playing")


def test_list_chart_and_themes(open_player):
    episode = yard()
    page = open_player(player_page(episode))
    assert page.locator("#moves button").count() == 40
    page.locator("#moves button").nth(29).click()
    assert done(page) == 30
    assert page.get_attribute("#moves li:nth-child(30) button", "aria-current") == "step"
    assert page.locator("#moves [aria-current]").count() == 1
    box = page.locator("#chart").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 10)
    seconds = FilmSchedule(trajectories_of(episode), size=4.0).seconds
    assert abs(page.evaluate("shoalPlayer.time") - seconds / 2) < 0.1
    assert page.locator("#deltaStage").is_hidden()
    before = page.screenshot()
    page.keyboard.press("d")
    assert page.get_attribute("html", "data-theme") in ("dark", "light")
    assert page.screenshot() != before
    assert stays_drawn(page)


def test_view_in_space_turns(open_player):
    page = open_player(player_page(tall()))
    first = page.evaluate("shoalPlayer.view")
    box = page.locator("#picture").bounding_box()
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 260, box["y"] + 230, steps=3)
    page.mouse.up()
    turned = page.evaluate("shoalPlayer.view")
    assert turned["azimuth"] < first["azimuth"]
    assert turned["elevation"] > first["elevation"]
    page.mouse.wheel(0, -300)
    until(page, "shoalPlayer.view.zoom > 1")
    page.keyboard.press("j")
    assert page.evaluate("shoalPlayer.view.azimuth") > turned["azimuth"]
    page.keyboard.press("f")
    assert page.evaluate("shoalPlayer.view") == first
    assert page.locator("#fit").is_hidden()


def test_drawn_is_where_the_walls_are(open_player):
    """The goals' white rings lie where the plane is mapped to: read from the canvas."""
    page = open_player(player_page(plan()))
    settle(page)
    colour = page.evaluate("""(() => {
        const canvas = document.getElementById('picture'), { width, height } = canvas;
        const unit = devicePixelRatio * parseFloat(getComputedStyle(document.documentElement).fontSize) / 16;
        const side = Math.min(width - 44 * unit, height - 64 * unit), left = width / 2 - side / 2;
        const top = 42 * unit + (height - 64 * unit) / 2 - side / 2;
        const pixels = canvas.getContext('2d').getImageData(0, 0, width, height).data;
        const at = (x, y) => {
            const first = 4 * (Math.round(top + (1 - y) * side) * width + Math.round(left + x * side));
            return [...pixels.slice(first, first + 4)];
        };
        return [at(0.8 + 6 * unit / side, 0.2), at(0.2 + 6 * unit / side, 0.3), at(0.5 + 6 * unit / side, 0.35)];
    })()""")
    assert colour == [[255, 255, 255, 255], [0, 114, 178, 255], [213, 94, 0, 255]]


@pytest.mark.parametrize("size", [(1400, 900), (390, 844), (844, 390)])
def test_fits_every_screen(size, open_player):
    page = open_player(player_page(plan()), viewport={"width": size[0], "height": size[1]})
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    for name in ("#picture", "#play", "#scrub", "#forward"):
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
    page = open_player(player_page(plan()))
    for button in page.locator("button:visible").all():
        name = button.get_attribute("aria-label") or button.inner_text().strip()
        assert name
        button.focus()
        assert button.evaluate("element => element === document.activeElement")


def test_no_moves(open_player):
    page = open_player(player_page(thrown(SQUARE, START, np.zeros((0, 2)))))
    page.keyboard.press("Space")
    page.keyboard.press("ArrowRight")
    assert done(page) == 0
    np.testing.assert_array_equal(page.evaluate("shoalPlayer.points"), START)


def test_nothing_in_the_data_can_close_the_script(open_player):
    hostile = "</script><script>alert(1)</script><img src=x onerror=alert(1)> \u2028"
    page = render(
        "steering", page_data(plan()) | {"planner": hostile, "reason": hostile, "title": hostile}
    )
    assert hostile not in page
    block = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert block is not None
    assert json.loads(block[1])["planner"] == hostile
    assert "<img src=x" in open_player(page).inner_text("h1")


def test_damaged_data_gets_one_sentence(visitor, tmp_path):
    (tmp_path / "player.html").write_text(render("steering", {"title": "x"}), encoding="utf-8")
    page = visitor.plain
    page.goto((tmp_path / "player.html").as_uri())
    assert page.inner_text("body").strip() == "This film cannot be shown. Its data is damaged."
    visitor.messages.clear()
