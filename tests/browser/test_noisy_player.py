"""The player of an episode with noise: at each move it shows what the library says."""

from __future__ import annotations

import numpy as np
import pytest
from tests.browser.waiting import until
from tests.swarm_runs import run

from shoal import GridWorkspace, open_map
from shoal.rigs import NoisyRig, PhysicsRig, PlantProperties, drive
from shoal.rigs.records import episode_of_log
from shoal.swarm import noise as moments
from shoal.swarm.noise import Noise
from shoal.views.swarm.page import page_data

pytestmark = pytest.mark.browser
NOISE = Noise(slip=0.1, misplace=0.05, miss=0.05)
SHOWN = "({n}) => (shoalPlayer.seek(n), shoalPlayer.snapshot())"


@pytest.mark.parametrize("name", ["maze:15x11", "vessels3d:120"])
def test_every_move_is_what_the_library_says(open_player, name):
    episode = run(open_map(name), particles=8, noise=NOISE, confidence=0.8, seed=2, scan_every=3)
    page = open_player(page_data(episode))
    all_moments, beliefs = list(episode.moments()), [belief for _, belief in episode.frames()]
    for move in [*range(0, episode.moves, 9), episode.moves, 3, 4, 40, 2]:  # there and back
        shown = page.evaluate(SHOWN, {"n": move})
        moment = all_moments[move]
        inner = moment.particles[(slice(1, -1),) * episode.workspace.ndim]
        assert shown["cells"] == np.flatnonzero(inner).tolist()
        assert shown["wrong"] == int((moment.looks >= moments.FALSE_FREE).sum())
        belief = beliefs[move]
        assert (shown["free"], shown["obstacle"]) == (len(belief.open), len(belief.obstacles))
        assert shown["frontier"] == len(belief.frontier)
        assert shown["scans"] == 1 + int(episode.trace.scanned[:move].sum())
    assert page.locator("#wrongRow").is_visible()
    assert page.locator("#rampRow").is_visible()


def test_colours_of_cells(open_player):
    """Settled cells have the colours of the legend, the rest lie in between."""
    episode = run(GridWorkspace([[1, 1, 1, 0, 1, 1]]), particles=2, noise=NOISE, seed=1)
    page = open_player(page_data(episode))
    world = "{world: {looks: {unknown: 8, free: 16, frontier: 17, tint: 0.5}}}"
    grey = "obstacle: [0, 0, 0], unknown: [80, 80, 80], free: [240, 240, 240]"
    palette = f"{{{grey}, frontier: [0, 0, 255], wrong: [200, 0, 100]}}"
    colours = page.evaluate(f"ShoalSim.Timeline.prototype.shades.call({world}, {palette})")
    assert len(colours) == moments.LOOKS
    assert (colours[0], colours[8], colours[16], colours[17]) == (
        [0, 0, 0],
        [80, 80, 80],
        [240, 240, 240],
        [0, 0, 128],
    )


def test_a_drive_says_that_particles_are_where_they_were_seen(open_player):
    workspace = open_map("maze:9x7")
    driven = drive(
        NoisyRig(workspace, workspace.cells[::8], NOISE, np.random.default_rng(2)), **vars(NOISE)
    )
    page = open_player(page_data(driven.episode))
    assert page.locator("#particleWord").inner_text() == "Seen at the last scan"
    assert page.locator("#wrongRow").is_hidden()
    page.keyboard.press("End")
    until(page, "document.getElementById('share').textContent === '100 %'")
    assert page.locator("#particles").inner_text() == str(len(driven.episode.observations[-1]))


def test_particles_of_a_plant_are_where_they_truly_were(open_player, tmp_path):
    pytest.importorskip("pymunk")
    vessel = open_map("vessels:60")
    rig = PhysicsRig(
        vessel, vessel.cells[::12], PlantProperties.of("roll", ghosts=2), np.random.default_rng(1)
    )
    drive(rig, log=tmp_path / "log.jsonl", max_moves=12, **vars(NOISE))
    episode = episode_of_log(tmp_path / "log.jsonl")
    page = open_player(page_data(episode))
    assert page.locator("#particleWord").inner_text() == "Particles"
    for move in (0, 7, episode.moves):
        shown = page.evaluate(SHOWN, {"n": move})
        assert shown["particles"] == len(vessel.cells[::12])
        np.testing.assert_allclose(
            np.reshape(shown["points"], (-1, 2)), episode.true_cells[move], atol=0.006
        )


@pytest.mark.parametrize("text", ["AAAA", "//////8=", ""])
def test_damaged_moments_are_said(open_player, text):
    data = page_data(run(open_map("maze:9x7"), particles=3, noise=NOISE, seed=1)) | {
        "moments": text
    }
    page = open_player(data)
    assert "moments" in page.locator("#problem").inner_text()


def test_a_tall_slice_stays_inside_the_stage(open_player):
    free = np.zeros((4, 60, 5), bool)
    free[1:3, :, 2] = True
    page = open_player(page_data(run(GridWorkspace(free), particles=9, seed=1)))
    for axis in "012":
        page.locator("#axis").select_option(axis)
        stage, panel = page.locator("#stage").bounding_box(), page.locator(".cut").bounding_box()
        assert panel["y"] + panel["height"] <= stage["y"] + stage["height"]
        assert panel["x"] + panel["width"] <= stage["x"] + stage["width"]
