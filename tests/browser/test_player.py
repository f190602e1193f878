"""The player plays: what it shows is what a slow and obvious simulation says, and every control
works.
"""

from __future__ import annotations

import base64
import json
import random
import re
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page
from tests.browser.waiting import settle, until

from shoal.swarm import TASKS, SwarmProblem
from shoal.swarm.run import run as run_swarm
from shoal.views.player import render
from shoal.views.swarm.page import page_data

pytestmark = pytest.mark.browser

STEPS = {"l": (0, -1), "u": (-1, 0), "r": (0, 1), "d": (1, 0)}
Cell = tuple[int, int]


# ---- data, and the reference
# -----------------------------------------------------------------------


def packed(shape: tuple[int, int], cells: set[Cell]) -> str:
    board = np.zeros(shape, dtype=bool)
    for cell in cells:
        board[cell] = True
    return base64.b64encode(np.packbits(board.ravel()).tobytes()).decode()


def episode(
    free: set[Cell], shape: tuple[int, int], start: list[Cell], commands: str, **more: Any
) -> dict[str, object]:
    flat = np.array([r * shape[1] + c for r, c in start], dtype="<u4")
    data: dict[str, object] = {
        "title": "A test",
        "task": "mapping",
        "policy": "by-hand",
        "rule": "block",
        "shape": list(shape),
        "free": packed(shape, free),
        "start": base64.b64encode(flat.tobytes()).decode(),
        "targets": None,
        "commands": commands,
        "status": "limit",
        "seed": 1,
        "version": "0",
        "map": "hand-made",
    }
    targets = more.pop("targets", None)
    if targets is not None:
        data["targets"] = packed(shape, targets)
    return data | more


def ahead(cell: Cell, command: str) -> Cell:
    return cell[0] + STEPS[command][0], cell[1] + STEPS[command][1]


def neighbours(cell: Cell) -> list[Cell]:
    return [ahead(cell, command) for command in STEPS]


def moved(particles: list[Cell], free: set[Cell], command: str, *, merge: bool) -> list[Cell]:
    """The particles after one step: one stays if a wall is ahead, or (unless merging) one that
    stays.
    """

    def stays(cell: Cell) -> bool:
        cell = ahead(cell, command)
        return cell not in free or (not merge and cell in particles and stays(cell))

    return [cell if stays(cell) else ahead(cell, command) for cell in particles]


def reference(
    free: set[Cell],
    shape: tuple[int, int],
    start: list[Cell],
    commands: str,
    rule: str,
    targets: set[Cell] | None,
    scanned: list[bool] | None = None,
) -> list[dict[str, object]]:
    """What snapshot() should return after each move, 0 included. A mapping shows what was known at
    the last scan.
    """
    particles, known, obstacles = list(start), set(start), set()
    left = set(targets or ()) - set(start)

    def observe(command: str) -> bool:
        nonlocal particles
        attempted = {ahead(cell, command) for cell in particles}
        after = moved(particles, free, command, merge=rule == "merge")
        known.update(after)
        obstacles.update(attempted - known)
        left.difference_update(after)
        particles, before = after, particles
        return particles != before

    def snapshot() -> dict[str, object]:
        if targets is None:
            frontier = {cell for k in known for cell in neighbours(k)} - known - obstacles
            counts = (len(frontier), len(known), len(obstacles))
        else:
            counts = (len(left), len(free), (shape[0] + 2) * (shape[1] + 2) - len(free))
        cells = sorted({r * shape[1] + c for r, c in particles})
        return dict(zip(("frontier", "free", "obstacle"), counts, strict=True)) | {
            "particles": len(start),
            "cells": cells,
        }

    snapshots = [snapshot() | {"scans": 1}]
    for scan, command in zip(scanned or [True] * len(commands), commands, strict=True):
        while observe(command) and rule == "tilt":
            pass
        now, before = snapshot(), snapshots[-1]
        if not scan and targets is None:
            now |= {name: before[name] for name in ("frontier", "free", "obstacle")}
        snapshots.append(now | {"scans": before["scans"] + scan})
    return snapshots


def random_world(
    rng: random.Random, shape: tuple[int, int], rule: str
) -> tuple[set[Cell], list[Cell]]:
    cells = [(r, c) for r in range(shape[0]) for c in range(shape[1])]
    free = set(rng.sample(cells, k=max(2, len(cells) * rng.randint(4, 9) // 10)))
    choose = rng.choices if rule == "merge" else rng.sample
    return free, choose(sorted(free), k=rng.randint(1, len(free)))


def pond(moves: int = 40) -> dict[str, object]:
    """A room of 6 by 9 with a pillar, three particles, and some moves."""
    free = {(r, c) for r in range(6) for c in range(9)} - {(2, 4), (3, 4)}
    return episode(free, (6, 9), [(0, 0), (3, 3), (5, 8)], ("rdlurrd" * moves)[:moves])


# ---- helpers
# -----------------------------------------------------------------------------------------


def move(page: Page) -> int:
    return int(page.evaluate("shoalPlayer.move"))


# ---- what is shown
# -------------------------------------------------------------------------------------


@pytest.mark.parametrize("rule", ["block", "merge", "tilt"])
@pytest.mark.parametrize("task", ["mapping", "coverage", "subset-coverage"])
def test_every_move_agrees_with_the_slow_simulation(open_player, rule, task):
    rng = random.Random(f"{rule} {task}")
    for shape in [(rng.randint(4, 9), rng.randint(4, 9)), rng.choice([(1, 40), (40, 1), (2, 31)])]:
        free, start = random_world(rng, shape, rule)
        commands = "".join(rng.choices("lurd", k=60))
        targets = {"mapping": None, "coverage": free}.get(
            task, set(rng.sample(sorted(free), len(free) // 2))
        )
        page = open_player(
            episode(free, shape, start, commands, rule=rule, task=task, targets=targets)
        )
        order = rng.sample(range(61), 61)  # forwards and backwards over keyframes
        shown = page.evaluate(
            "(ns) => ns.map((n) => (shoalPlayer.seek(n), shoalPlayer.snapshot()))", order
        )
        expected = reference(free, shape, start, commands, rule, targets)
        assert shown == [expected[n] for n in order]


FIELDS = {
    "target": [{"target": [(0, 8), (5, 0)]}],
    "gathering": [
        {"rule": "merge"},
        {"rule": "merge", "region": [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0)]},
    ],
}
"""What a problem of a task needs, for each episode to try."""


@pytest.mark.parametrize("task", [name for name in TASKS if name != "mapping"])
def test_an_episode_of_each_task_shows_how_many_cells_are_left(open_player, task):
    for fields in FIELDS.get(task, [{}]):
        problem = SwarmProblem("rectangle:6x9", task=task, particles=5, **fields)
        played = run_swarm(problem, seed=3)
        page = open_player(page_data(played))
        shown = page.evaluate(
            "(ns) => ns.map((n) => (shoalPlayer.seek(n), shoalPlayer.snapshot().frontier))",
            list(range(played.moves + 1)),
        )
        assert shown == [played.first_frontier, *played.trace.frontier.tolist()]
        assert shown[0] > shown[-1] == 0
        word = "gathered" if task == "gathering" else "covered"
        assert page.locator("#shareWord").inner_text() == word


@pytest.mark.parametrize("task", ["mapping", "coverage"])
def test_what_is_known_waits_for_the_scan(open_player, task):
    rng = random.Random(f"scans {task}")
    for rule in ("block", "merge"):
        free, start = random_world(rng, (6, 9), rule)
        commands, scanned = (
            "".join(rng.choices("lurd", k=60)),
            rng.choices([True, False, False], k=60),
        )
        targets = free if task == "coverage" else None
        packed_scans = base64.b64encode(np.packbits(scanned).tobytes()).decode()
        page = open_player(
            episode(
                free,
                (6, 9),
                start,
                commands,
                rule=rule,
                task=task,
                targets=targets,
                scanned=packed_scans,
            )
        )
        order = rng.sample(range(61), 61)
        shown = page.evaluate(
            "(ns) => ns.map((n) => (shoalPlayer.seek(n), shoalPlayer.snapshot()))", order
        )
        expected = reference(free, (6, 9), start, commands, rule, targets, scanned)
        assert shown == [expected[n] for n in order]
        page.evaluate("shoalPlayer.seek(60)")
        assert page.locator("#scans").inner_text() == str(expected[60]["scans"])
        assert page.locator("#scansRow").is_visible()


def test_no_scans_are_shown_where_each_move_has_one(open_player):
    page = open_player(pond())
    assert page.locator("#scansRow").is_hidden()


def test_coverage_without_targets_means_all_free_cells(open_player):
    free = {(0, c) for c in range(6)}
    page = open_player(episode(free, (1, 6), [(0, 2)], "llrr", task="coverage"))
    left = page.evaluate(
        "[0, 1, 2, 3, 4].map((n) => (shoalPlayer.seek(n), shoalPlayer.snapshot().frontier))"
    )
    assert left == [5, 4, 3, 3, 3]


def test_header_count_and_share(open_player):
    page = open_player(pond() | {"title": "<b>Pond</b> & </script>", "status": "complete"})
    assert page.title() == page.inner_text("h1") == "<b>Pond</b> & </script>"
    facts = page.inner_text("#facts")
    assert all(
        word in facts for word in ("hand-made", "mapping", "by-hand", "3 particles", "complete")
    )
    assert re.search(r"\d+ rows × \d+ columns", page.text_content("#details"))
    page.evaluate("shoalPlayer.seek(12)")
    assert page.inner_text("#count") == "move 12 of 40"
    assert re.fullmatch(r"\d+\.\d % classified", page.inner_text(".share"))
    assert page.get_attribute("#compass", "aria-label") == "Command: right"
    assert page.locator("#compass .on").count() == 1
    snapshot = page.evaluate("shoalPlayer.snapshot()")
    assert page.inner_text("#frontier") == str(snapshot["frontier"])
    assert page.inner_text("#obstacle") == str(snapshot["obstacle"])


def test_shared_cells_are_counted_under_merge(open_player):
    row = {(0, c) for c in range(4)}
    page = open_player(episode(row, (1, 4), [(0, 0), (0, 1), (0, 3), (0, 3)], "llu", rule="merge"))
    shared = []
    for n in range(4):
        page.evaluate("(n) => shoalPlayer.seek(n)", n)
        shared.append(page.inner_text("#shared"))
    assert shared == ["1", "2", "2", "2"]


def test_full_mapping_reaches_100_percent(open_player):
    page = open_player(episode({(0, 0), (0, 1)}, (1, 2), [(0, 0)], "ludrurd", status="complete"))
    page.keyboard.press("End")
    assert page.inner_text("#share") == "100 %"
    assert page.evaluate("shoalPlayer.snapshot().frontier") == 0


def test_the_picture_has_the_colours_of_the_legend(open_player):
    page = open_player(pond())
    page.evaluate("shoalPlayer.seek(20)")
    settle(page)
    seen = page.evaluate("""() => {
        const canvas = document.getElementById("picture"), { width, height } = canvas;
        const { data } = canvas.getContext("2d").getImageData(0, 0, width, height), seen = new Set();
        for (let i = 0; i < data.length; i += 4) {
            if (data[i + 3] === 255) seen.add(data.slice(i, i + 3).join(", "));
        }
        return [...document.querySelectorAll(".swatch:not(.shared, .scan, .wrong, .ramp)")].map(
            (s) => [...seen].some((rgb) => getComputedStyle(s).backgroundColor === `rgb(${rgb})`));
    }""")
    assert seen == [True] * 5


def test_an_empty_film(open_player):
    page = open_player(pond(0))
    page.evaluate("shoalPlayer.play()")
    page.keyboard.press("ArrowRight")
    assert page.evaluate("[shoalPlayer.length, shoalPlayer.move, shoalPlayer.playing]") == [
        0,
        0,
        False,
    ]


# ---- the controls
# -----------------------------------------------------------------------------------------


def test_play_runs_to_the_end_and_begins_again(open_player):
    page = open_player(pond(120))
    page.wait_for_timeout(150)
    assert page.evaluate("[shoalPlayer.move, shoalPlayer.playing]") == [0, False]
    page.select_option("#speed", "60")
    page.click("#play")
    assert page.get_attribute("#play", "aria-label") == "Pause"
    until(page, "shoalPlayer.move > 3")
    page.click("#play")
    assert page.evaluate("shoalPlayer.playing") is False
    stopped = move(page)
    page.wait_for_timeout(100)
    assert move(page) == stopped < 120
    page.evaluate("shoalPlayer.play()")
    until(page, "!shoalPlayer.playing")
    assert move(page) == 120
    page.evaluate("shoalPlayer.play()")
    until(page, "shoalPlayer.move < 100 && shoalPlayer.playing")
    page.evaluate("shoalPlayer.pause()")


def test_buttons(open_player):
    page = open_player(pond())
    moves = []
    for button in (
        "#forward",
        "#forward",
        "#back",
        "#last",
        "#forward",
        "#back",
        "#first",
        "#back",
    ):
        page.click(button)
        moves.append(move(page))
    assert moves == [1, 2, 1, 40, 40, 39, 0, 0]


def test_keys(open_player):
    page = open_player(pond())
    moves = []
    for key in ("ArrowRight", "Shift+ArrowRight", "ArrowLeft", "End", "Shift+ArrowLeft", "Home"):
        page.keyboard.press(key)
        moves.append(move(page))
    assert moves == [1, 11, 10, 40, 30, 0]
    page.click("#forward")
    page.keyboard.press("Space")  # a click does not take the focus, so this plays
    assert page.evaluate("shoalPlayer.playing") is True
    page.keyboard.press("Space")
    assert page.evaluate("shoalPlayer.playing") is False


def test_arrow_keys_on_the_scrub_bar_move_once(open_player):
    page = open_player(pond())
    page.focus("#scrub")
    page.keyboard.press("ArrowRight")
    assert move(page) == 1
    page.keyboard.press("Shift+ArrowRight")
    assert move(page) == 11


def test_speed(open_player):
    page = open_player(pond())
    assert (
        page.input_value("#speed") == "1"
    )  # 40 moves: 40 s at 1/s, 8 s at 5/s, and 40 is nearer to 20
    page.keyboard.press("+")
    assert page.input_value("#speed") == "5"
    for _ in range(9):
        page.keyboard.press("+")
    assert page.input_value("#speed") == "1000"
    page.keyboard.press("-")
    assert page.input_value("#speed") == "240"
    page.select_option("#speed", "20")
    assert page.input_value("#speed") == "20"


def test_scrub_bar_and_chart_seek(open_player):
    page = open_player(pond())
    page.fill("#scrub", "17")
    assert move(page) == 17
    box = page.locator("#chart").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 20)
    assert move(page) == 20
    page.mouse.move(box["x"] + 1, box["y"] + 20)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] - 1, box["y"] + 20)
    page.mouse.up()
    assert move(page) == 40
    assert page.inner_text("#hover").startswith("move 40: ")
    assert page.input_value("#scrub") == "40"


def test_zoom_pan_and_fit(open_player):
    page = open_player(pond())
    drawn = "picture.toDataURL()"
    settle(page)
    fitted = page.evaluate(drawn)
    assert page.is_hidden("#fit")
    page.mouse.move(400, 300)
    page.mouse.wheel(0, -300)
    page.wait_for_selector("#fit", state="visible")
    page.mouse.down()
    page.mouse.move(460, 340)
    page.mouse.up()
    settle(page)
    assert page.evaluate(drawn) != fitted
    page.keyboard.press("f")
    settle(page)
    assert page.evaluate(drawn) == fitted
    assert page.is_hidden("#fit")


@pytest.mark.chromium("system theme")
def test_theme_follows_the_system_until_toggled(open_player):
    page = open_player(pond(), color_scheme="dark")
    ground = "getComputedStyle(document.body).backgroundColor"
    dark = page.evaluate(ground)
    page.keyboard.press("d")
    light = page.evaluate(ground)
    assert (dark, light) == ("rgb(20, 24, 30)", "rgb(245, 246, 248)")
    assert page.get_attribute("#theme", "aria-pressed") == "false"
    page.click("#theme")
    assert page.evaluate(ground) == dark


def test_help(open_player):
    page = open_player(pond())
    page.keyboard.press("?")
    assert page.is_visible("#keys")
    page.keyboard.press("End")
    assert move(page) == 0  # the film waits
    page.keyboard.press("Escape")
    assert page.is_hidden("#keys")
    page.click("#help")
    page.click("#keys button")
    assert page.is_hidden("#keys")


def test_moves_are_announced_only_when_paused(open_player):
    page = open_player(pond())
    page.keyboard.press("ArrowRight")
    until(page, "document.getElementById('live').textContent === 'Move 1 of 40'")
    page.keyboard.press("Space")
    page.wait_for_timeout(400)
    assert page.text_content("#live") == ""


def test_every_control_has_a_name(open_player):
    page = open_player(pond())
    nameless = page.evaluate(
        """() => [...document.querySelectorAll("button, input, select")].filter(
        (e) => !(e.getAttribute("aria-label") || e.textContent.trim())).length"""
    )
    assert nameless == 0


# ---- any size
# --------------------------------------------------------------------------------------------


def test_nothing_overflows_sideways(open_player):
    data = pond(2000) | {
        "title": "A title that is rather long for a narrow telephone",
        "rule": "merge",
    }
    page = open_player(data, viewport={"width": 360, "height": 740}, is_mobile=True, has_touch=True)
    page.evaluate("shoalPlayer.seek(2000)")
    for width, height in [
        (360, 740),
        (320, 568),
        (740, 360),
        (820, 1180),
        (1280, 800),
        (3840, 2160),
    ]:
        page.set_viewport_size({"width": width, "height": height})
        outside = page.evaluate("""() => {
            const wide = document.documentElement.clientWidth;
            return [...document.querySelectorAll("#player *")]
                .filter((e) => e.getClientRects().length && !e.closest(".unseen"))
                .map((e) => [e.outerHTML.slice(0, 80), e.getBoundingClientRect()])
                .filter(([, box]) => box.right > wide + 0.5 || box.left < -0.5)
                .map(([html]) => html);
        }""")
        assert outside == [], (width, height)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.locator("#stage").bounding_box()["height"] >= 220
        assert (
            page.locator("#controls").bounding_box()["height"]
            < 2 * page.locator("#play").bounding_box()["height"]
        )
        if (width, height) == (360, 740):  # nothing to scroll, either
            assert page.evaluate("document.documentElement.scrollHeight") <= 740


def test_the_canvas_has_the_pixels_of_the_screen(open_player):
    page = open_player(pond(), device_scale_factor=3, viewport={"width": 360, "height": 740})
    pixels, css = page.evaluate("[picture.width, picture.clientWidth]")  # the element, by its id
    assert pixels == 3 * css


@pytest.mark.parametrize("shape", [(1, 5000), (5000, 1)])
def test_a_long_line_is_wrapped(open_player, shape):
    free = {(r, c) for r in range(shape[0]) for c in range(shape[1])}
    page = open_player(episode(free, shape, sorted(free)[::50], "lurdrrll"))
    settle(page)
    painted = page.evaluate("""() => {
        const canvas = document.getElementById("picture"), { width, height } = canvas;
        const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
        let count = 0;
        for (let i = 3; i < data.length; i += 4) count += data[i] > 0;
        return count / (width * height);
    }""")
    assert painted > 0.3  # as one strip, it would be far less than 1 %


def test_seeking_is_instant(open_player):
    rng = random.Random(7)
    shape = (132, 112)
    free = {(r, c) for r in range(132) for c in range(112) if rng.random() < 0.7}
    start = rng.sample(sorted(free), 2000)
    page = open_player(episode(free, shape, start, "".join(rng.choices("lurd", k=3000))))
    until(page, "shoalPlayer.built === shoalPlayer.length")
    times = page.evaluate(
        """(ns) => ns.map((n) => {
            const begin = performance.now();
            shoalPlayer.seek(n);
            return performance.now() - begin;
        })""",
        [rng.randint(0, 3000) for _ in range(60)],
    )
    assert np.median(times) < 30


# ---- bad data
# ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"free": "%%%"}, "The field “free” is not valid base64."),
        ({"free": "AAAA"}, "The field “free” should hold 7 bytes and holds 3."),
        ({"free": None}, "The field “free” is missing."),
        ({"commands": "lurx"}, "Command 4 is “x”, not one of l, u, r, d."),
        ({"rule": "push"}, "The field “rule” is “push”, not one of block, merge, tilt."),
        ({"task": "napping"}, "The field “task” is “napping”, not one of"),
        (
            {"shape": [6]},
            "The field “shape” should be two or three positive whole numbers, not “6”.",
        ),
        ({"start": base64.b64encode(b"\xff\0\0\0").decode()}, "Particle 0 starts outside the map."),
        ({"start": base64.b64encode(b"\x16\0\0\0").decode()}, "Particle 0 starts on an obstacle."),
        ({"start": base64.b64encode(bytes(8)).decode()}, "Particle 1 starts where another one is."),
        ({"task": "subset-coverage"}, "The field “targets” is missing."),
        ({"task": "coverage", "targets": "/////////w=="}, "A target cell is an obstacle."),
    ],
)
def test_bad_data_gets_one_sentence(open_player, change, sentence):
    page = open_player(pond() | change)
    assert page.inner_text("body").strip().startswith(f"This film cannot be shown. {sentence}")
    assert page.evaluate("'shoalPlayer' in window") is False


def test_nothing_in_the_data_can_close_the_script():
    hostile = "</script><script>alert(1)</script><!-- shoal:css --> \u2028"
    page = render("swarm", pond() | {"map": hostile})
    assert hostile not in page
    block = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.DOTALL)
    assert block is not None
    assert json.loads(block[1])["map"] == hostile


@pytest.mark.chromium("reduced motion")
def test_it_plays_at_once_where_that_is_wanted(open_player):
    page = open_player(pond() | {"playing": True})
    until(page, "shoalPlayer.move > 0")
    still = open_player(pond() | {"playing": True}, reduced_motion="reduce")
    until(still, "shoalPlayer.move === shoalPlayer.length")
    assert not still.evaluate("shoalPlayer.playing")
    assert open_player(pond()).evaluate("shoalPlayer.playing") is False


def test_it_says_what_is_out_of_reach_and_how_long_a_cell_is(open_player):
    page = open_player(pond() | {"unreachable": 7, "spacing": [0.25, 0.5]})
    assert "7 free cells out of reach" in page.inner_text("#facts")
    assert page.inner_text("#scaleWord").endswith(" mm")
    millimetres = float(page.inner_text("#scaleWord").split()[0])
    bar = page.locator("#scaleBar").bounding_box()["width"]
    picture = page.locator("#picture").bounding_box()
    assert 20 < bar < 140
    # eleven columns of half a millimetre fit the stage
    assert bar / millimetres * 0.5 * 11 <= picture["width"]
    page.mouse.move(picture["x"] + picture["width"] / 2, picture["y"] + picture["height"] / 2)
    page.mouse.wheel(0, -600)
    until(
        page,
        "document.getElementById('scaleBar').offsetWidth / parseFloat(scaleWord.textContent) >"
        f" {1.2 * bar / millimetres}",
    )
    assert open_player(pond()).locator("#scaleRow").is_hidden()


def test_thousands_of_particles_are_in_the_picture(open_player):
    side = 72
    free = {(r, c) for r in range(side) for c in range(side)}
    # all but the last column: more than are drawn one by one
    start = [(r, c) for r, c in sorted(free) if c < side - 1]
    page = open_player(episode(free, (side, side), start, "r") | {"playing": False})
    orange = """() => {
      const canvas = document.getElementById("picture"), { width, height } = canvas;
      const { data } = canvas.getContext("2d").getImageData(0, 0, width, height);
      let count = 0;
      for (let i = 0; i < data.length; i += 4) count += data[i] > 180 && data[i + 1] > 60 && data[i + 1] < 120 && data[i + 2] < 40;
      return count / shoalPlayer.picture.size ** 2;
    }"""
    settle(page)
    page.evaluate("shoalPlayer.seek(1)")  # read once: Chromium warns of a second time
    settle(page)
    assert page.evaluate(orange) == pytest.approx(len(start), rel=0.01)
    assert len(start) > 5000
