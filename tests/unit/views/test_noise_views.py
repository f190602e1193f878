"""Films, figures and the player's data of episodes with noise, and of drives of rigs that fail."""

from __future__ import annotations

import base64
import json

import numpy as np
import pytest
from PIL import Image
from tests.swarm_runs import run

from shoal import GridWorkspace, InvalidInputError, open_map
from shoal.cli import run as shoal
from shoal.rigs import DriveLog, NoisyRig, drive, replay_log
from shoal.swarm import noise as moments
from shoal.swarm.noise import Noise
from shoal.views import film
from shoal.views.swarm import page
from shoal.views.swarm.colours import NOISY, PLAIN, codes_after, codes_by_move
from shoal.views.swarm.figures import map_figure
from shoal.views.swarm.films import film_frames
from shoal.views.swarm.page import page_data

NOISE = Noise(slip=0.2, misplace=0.1, miss=0.1)


@pytest.fixture(scope="module")
def episode():
    return run(open_map("maze:9x7"), particles=4, noise=NOISE, confidence=0.8, seed=3)


def test_looks_say_what_the_belief_says(episode):
    truth, wrong = np.pad(episode.workspace.free, 1), 0
    for moment, (_, belief) in zip(episode.moments(), episode.frames(), strict=True):
        looks, free, obstacles = moment.looks, belief.open.mask, belief.obstacles.mask
        np.testing.assert_array_equal((looks == moments.FREE) | (looks == moments.FALSE_FREE), free)
        np.testing.assert_array_equal(
            (looks == moments.OBSTACLE) | (looks == moments.FALSE_OBSTACLE), obstacles
        )
        np.testing.assert_array_equal(
            looks >= moments.FALSE_FREE, (free & ~truth) | (obstacles & truth)
        )
        np.testing.assert_array_equal(
            (looks >= moments.FRONTIER) & (looks < moments.FALSE_FREE), belief.frontier.mask
        )
        assert moment.particles.sum() == 4
        assert truth[moment.particles].all()
        wrong += int((looks >= moments.FALSE_FREE).sum())
    assert wrong > 0  # else nothing of it was tested


def test_shades_go_from_obstacle_over_unknown_to_free():
    bright = NOISY.rgb[: moments.FREE + 1].astype(int).sum(axis=1)
    assert (np.diff(bright) > 0).all()
    for mine, plain in (
        (moments.OBSTACLE, 3),
        (moments.UNKNOWN, 0),
        (moments.FREE, 2),
        (NOISY.particle, PLAIN.particle),
    ):
        np.testing.assert_array_equal(NOISY.rgb[mine], PLAIN.rgb[plain])
    assert len(NOISY.rgb) == moments.LOOKS + 1


def test_frames_and_figures_show_particles_and_what_is_wrong(episode):
    codes = list(codes_by_move(episode))
    frames = list(film_frames(episode, np.arange(episode.moves + 1)))
    for code, frame, moment in zip(codes, frames, episode.moments(), strict=True):
        np.testing.assert_array_equal(frame, NOISY.rgb[code])
        assert (code[moment.particles] == NOISY.particle).all()
    np.testing.assert_array_equal(codes_after(episode, episode.moves), codes[-1])
    labels = [text.get_text() for text in map_figure(episode).axes[0].get_legend().get_texts()]
    assert labels[-2:] == ["wrongly free", "wrongly an obstacle"]
    patches = map_figure(episode).axes[0].get_legend().get_patches()
    colours = [(255 * np.array(patch.get_facecolor()[:3])).round() for patch in patches]
    for colour in colours:  # of some cells
        assert np.abs(NOISY.rgb - colour).max(axis=1).min() <= 1


def numbers(data):
    number, shift = 0, 0
    for byte in data:
        number, shift = number | (byte & 127) << shift, shift + 7
        if byte < 128:
            return number
    raise AssertionError("breaks off")


def unpacked(data, size):
    """Yield (particles, looks) of each moment, one number after another: written from the
    docstring.
    """
    data, looks = iter(data), np.full(size, moments.UNKNOWN)
    while True:
        try:
            count = numbers(data)
        except AssertionError:
            return
        cells = np.cumsum([numbers(data) for _ in range(count)], dtype=int)
        cell = 0
        for _ in range(numbers(data)):
            cell += numbers(data)
            looks[cell] = next(data)
        yield cells, looks.copy()


@pytest.mark.parametrize("size", [(7, 9), (20, 30)])
def test_packed_moments(size):
    """Cells more than 127 apart, too."""
    workspace = GridWorkspace(np.ones(size, bool))
    episode = run(workspace, particles=3, noise=NOISE, seed=1, max_moves=30)
    data = base64.b64decode(page_data(episode)["moments"])
    for (cells, looks), moment in zip(
        unpacked(data, (size[0] + 2) * (size[1] + 2)), episode.moments(), strict=True
    ):
        np.testing.assert_array_equal(cells, np.flatnonzero(moment.particles))
        np.testing.assert_array_equal(looks, moment.looks.ravel())


def test_too_much_for_a_page(episode, monkeypatch):
    monkeypatch.setattr(page, "HEAVIEST", 50)
    with pytest.raises(InvalidInputError, match="at most 0 MB of moments with noise"):
        page_data(episode)


def test_a_drive_is_drawn_as_it_was_seen(tmp_path):
    workspace = open_map("maze:9x7")
    log = DriveLog(tmp_path / "drive.jsonl")
    rig = NoisyRig(workspace, workspace.cells[::8], NOISE, np.random.default_rng(2))
    driven = drive(rig, **vars(NOISE), scan_every=3, log=log)
    seen = driven.episode
    assert seen.observations is not None
    assert (seen.commands, seen.scans, seen.moves) == (driven.commands, driven.scans, driven.moves)
    assert len(seen.observations) == driven.scans
    assert seen.verify()
    assert seen.final()[1].known == driven.belief.known
    replayed = replay_log(tmp_path / "drive.jsonl")[0].episode
    for mine, theirs in zip(seen.moments(), replayed.moments(), strict=True):
        np.testing.assert_array_equal(mine.looks, theirs.looks)
        np.testing.assert_array_equal(mine.particles, theirs.particles)
    film(seen, tmp_path / "film.gif")
    with Image.open(tmp_path / "film.gif") as picture:
        assert picture.n_frames > 10
    data = page_data(seen)
    assert (data["seen"], data["truth"], data["goal"]) == (True, False, len(driven.belief.known))
    with pytest.raises(InvalidInputError, match=r"the log of the rig contains"):
        seen.save(tmp_path / "episode.npz")
    seen.trace.frontier[2] += 1
    assert "frontier differs at move 3" in seen.verify().message


def test_nothing_found_nothing_drawn():
    rig = NoisyRig(GridWorkspace([[1, 1]]), [(0, 0)], Noise(miss=0.5), np.random.default_rng(2))
    assert drive(rig, miss=0.5, max_moves=0).episode is None


def test_commands(tmp_path, capsys):
    words = [
        "drive",
        "maze:9x7",
        "-n",
        "4",
        "--slip",
        "0.1",
        "--miss",
        "0.1",
        "--log",
        str(tmp_path / "drive.jsonl"),
    ]
    out, page = tmp_path / "out", tmp_path / "drive.html"
    assert shoal([*words, "--out", str(out), "--film", str(page)]) == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "frames.csv",
        "frontier.png",
        "map.png",
        "map.txt",
        "summary.json",
    ]
    assert "episode.npz" not in capsys.readouterr().out
    data = json.loads(page.read_text().split('id="data">')[1].split("</script>")[0])
    assert data["truth"] is True
    assert (
        shoal(["replay", str(tmp_path / "drive.jsonl"), "--film", str(tmp_path / "again.html")])
        == 0
    )
    again = json.loads(
        (tmp_path / "again.html").read_text().split('id="data">')[1].split("</script>")[0]
    )
    assert (again["truth"], again["commands"]) == (False, data["commands"])
    film = tmp_path / "none.gif"
    assert (
        shoal(
            [
                "drive",
                "maze:9x7",
                "-n",
                "1",
                "--miss",
                "0.5",
                "--max-moves",
                "0",
                "--seed",
                "3",
                "--film",
                str(film),
            ]
        )
        == 1
    )
    assert "nothing to draw or film" in capsys.readouterr().err
    assert not film.exists()
