"""The player of a 3-D workspace: what it shows is what the library says; it turns, and slices can
be chosen.
"""

from __future__ import annotations

import base64
import io

import numpy as np
import pytest
from PIL import Image
from tests.browser.waiting import settle, stays_drawn, until
from tests.swarm_runs import run

from shoal import GridWorkspace
from shoal.swarm.maps.generators import generate
from shoal.views.swarm.page import page_data

pytestmark = pytest.mark.browser


@pytest.mark.parametrize("rule", ["block", "merge", "tilt"])
def test_every_move_is_what_the_library_says(open_player, rule):
    free = np.random.default_rng(4).random((4, 5, 6)) < 0.75
    workspace = GridWorkspace(free).largest_component()
    episode = run(workspace, particles=9, rule=rule, policy="random-moves", max_moves=60)
    page = open_player(page_data(episode))
    counts = np.concatenate([[episode.first_frontier], episode.trace.frontier])
    for move, (state, belief) in enumerate(episode.frames()):
        if move % 7 and move != episode.moves:
            continue
        shown = page.evaluate(f"shoalPlayer.seek({move}), shoalPlayer.snapshot()")
        flat = sorted({int(i) for i in np.ravel_multi_index(tuple(state.cells.T), workspace.shape)})
        assert shown["cells"] == flat
        assert (shown["frontier"], shown["free"]) == (counts[move], len(belief.open))
        assert shown["obstacle"] == len(belief.obstacles)


def test_it_turns_and_slices(open_player):
    episode = run(GridWorkspace(generate("vessels3d:400")), particles=40)
    page = open_player(page_data(episode) | {"playing": False})
    settle(page)
    picture = "document.getElementById('picture').toDataURL()"
    cut = "document.getElementById('slice').toDataURL()"
    before = page.evaluate(picture)
    assert page.locator("#fit").is_hidden()
    page.mouse.move(300, 350)
    page.mouse.down()
    page.mouse.move(420, 380, steps=3)
    page.mouse.up()
    until(page, f"{picture} !== {before!r}")
    page.locator("#fit").click()
    until(page, f"{picture} === {before!r}")
    one = page.evaluate(cut)
    page.locator("#axis").select_option("1")
    assert page.evaluate(cut) != one
    page.evaluate(
        "document.getElementById('cut').value = 0; document.getElementById('cut').dispatchEvent(new"
        " Event('input'))"
    )
    assert page.locator("#cutAt").inner_text() == "-1"
    settle(page)
    light = page.evaluate(picture)
    page.locator("#axis").blur()  # a list has its own use for keys
    page.keyboard.press("d")
    until(page, f"{picture} !== {light!r}")
    assert stays_drawn(page)


def test_particles_shine_through_the_wall_of_a_wide_vessel(open_player):
    block = GridWorkspace(np.ones((9, 9, 9)))
    colours = []
    for start in ([(4, 4, 4)], [(0, 0, 0)]):  # in the middle; at a corner
        episode = run(block, start=start, task="coverage", policy="random-moves", max_moves=0)
        page = open_player(page_data(episode) | {"playing": False})
        url = page.evaluate("document.getElementById('picture').toDataURL()")
        shown = np.asarray(
            Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2]))), dtype=int
        )
        colours.append(int((shown[..., 0] > shown[..., 2]).sum()))  # cells to cover are blue
    assert min(colours) > 100
