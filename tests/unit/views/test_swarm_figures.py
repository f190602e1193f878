"""Figures, films and what notebooks show: that they are there, whole, and show what they should."""

from __future__ import annotations

import base64
import io
import json
import re
import subprocess
from dataclasses import replace

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image
from tests.swarm_runs import run, run_trials

from shoal import GridWorkspace, InvalidInputError, open_map
from shoal.swarm.maps.workspace import PALETTE, in_strips
from shoal.views import film
from shoal.views.drawing.charts import save_figure
from shoal.views.swarm import films, page
from shoal.views.swarm.colours import LEGEND
from shoal.views.swarm.figures import frontier_figure, map_figure
from shoal.views.swarm.films import CAPTION, film_frames, frame_moves, pictures_with_legend
from shoal.views.swarm.page import player_page


@pytest.fixture(scope="module")
def episode():
    return run(open_map("maze:9x7"), particles=4, seed=2)


def picture_of(state, belief):
    return belief.picture(state.occupied)


def colour(name):
    return tuple(int(PALETTE[name][i : i + 2], 16) for i in (1, 3, 5))


def test_raster_shows_every_state(episode):
    state, belief = next(iter(episode.frames()))
    raster = belief.picture(state.occupied)
    assert raster.shape == (9, 11, 3)
    for cell in state.cells.tolist():
        assert tuple(raster[cell[0] + 1, cell[1] + 1]) == colour("particle")
    shown = {tuple(pixel) for pixel in raster.reshape(-1, 3).tolist()}
    assert shown == {colour("particle"), colour("frontier"), colour("unknown")}
    last = picture_of(*episode.final())
    assert {tuple(p) for p in last.reshape(-1, 3).tolist()} >= {
        colour("particle"),
        colour("free"),
        colour("obstacle"),
    }


def test_wide_maps_are_cut_into_strips():
    sheet = in_strips(open_map("line:5000").picture)
    assert max(sheet.shape[:2]) < 500
    assert (sheet == colour("free")).all(axis=2).sum() >= 5000


def test_notebooks(episode):
    image = Image.open(io.BytesIO(episode.workspace._repr_png_()))
    assert image.width > 300
    html = episode._repr_html_()
    assert "complete after" in html
    assert "shoalPlayer" in html
    picture = Image.open(
        io.BytesIO(base64.b64decode(re.search(r"data:image/png;base64,([^\"]+)", html).group(1)))
    )
    assert min(picture.size) > 300


def test_a_volume_in_a_notebook_is_a_view_with_slices_and_no_strip_of_layers():
    episode = run(open_map("vessels3d:60"), particles=9, policy="closest-frontier")
    for data in (
        episode.workspace._repr_png_(),
        base64.b64decode(re.search(r"base64,([^\"]+)", episode._repr_html_()).group(1)),
    ):
        picture = Image.open(io.BytesIO(data))
        assert 0.5 < picture.width / picture.height < 2
        assert min(picture.size) > 400


def test_a_player_too_large_for_a_page_is_left_out(episode, monkeypatch):
    monkeypatch.setattr(page, "LARGEST", 0)
    assert "iframe" not in episode._repr_html_()
    assert "base64," in episode._repr_html_()


def test_three_dimensions_side_by_side():
    workspace = GridWorkspace(np.ones((3, 4, 5), bool))
    assert workspace.picture.shape == (4, 3 * 5 + 2, 3)
    figure = map_figure(run(workspace, particles=6))
    assert figure.axes


def test_figures(episode, tmp_path):
    for suffix in (".png", ".svg", ".pdf"):
        save_figure(map_figure(episode), tmp_path / f"map{suffix}")
        assert (tmp_path / f"map{suffix}").stat().st_size > 1000
    many = run_trials(open_map("maze:15x11"), trials=5, particles=10)
    axes = frontier_figure(many).axes[0]
    assert len(axes.lines) == 6  # each trial, and the median
    single = frontier_figure([episode]).axes[0].lines[0].get_ydata()
    np.testing.assert_array_equal(single, [episode.first_frontier, *episode.trace.frontier])
    with pytest.raises(InvalidInputError, match="at least one"):
        frontier_figure([])
    with pytest.raises(InvalidInputError, match=f"0 to {episode.moves}"):
        map_figure(episode, moves=episode.moves + 1)


def test_gif_shows_each_move(episode, tmp_path):
    film(episode, tmp_path / "film.gif")
    with Image.open(tmp_path / "film.gif") as picture:
        assert picture.n_frames == episode.moves + 1
        picture.seek(picture.n_frames - 1)
        assert min(picture.size) >= 720
        cells = picture.convert("RGB").crop((0, 0, 11 * 80, 9 * 80))
        last = np.asarray(cells.resize((11, 9), Image.Resampling.NEAREST))
    np.testing.assert_array_equal(last, picture_of(*episode.final()))


@pytest.fixture(scope="module")
def parted():
    """An episode in two rooms with a wall between; the size of a cell is known."""
    free = np.ones((6, 12), dtype=np.bool_)
    free[:, 8] = False
    return run(
        GridWorkspace(free, name="rooms", spacing=(0.5, 0.5)), start=[(0, 0), (1, 1)], scan_every=2
    )


def caption_of(episode, move):
    (sheet,) = pictures_with_legend(episode, [move], film_frames(episode, np.array([move])))
    return sheet[-CAPTION:].astype(int)


def test_films_count_moves_and_explain_colours(parted):
    captions = [caption_of(parted, move) for move in range(4)]
    words, legend = slice(0, 36), slice(36, CAPTION)
    for number, caption in enumerate(captions):
        for name in LEGEND:
            assert (caption[legend] == colour(name)).all(axis=2).sum() > 100, name
        for other in captions[:number]:
            assert (caption[words] != other[words]).any(), "the counter stands still"
            assert (caption[legend] == other[legend]).all()


def test_films_show_the_arrow_of_the_command(episode, monkeypatch):
    before = caption_of(episode, 3)
    turned = {"l": "r", "r": "l", "u": "d", "d": "u"}
    monkeypatch.setattr(
        films, "ARROWS", {letter: films.ARROWS[turned[letter]] for letter in "lrud"}
    )
    assert (caption_of(episode, 3) != before).any()


def test_films_have_a_scale_bar_where_the_size_of_a_cell_is_known(parted):
    unknown = replace(
        parted,
        problem=parted.problem.replaced(map=GridWorkspace(parted.workspace.free, name="rooms")),
    )
    known, none = (longest_line(caption_of(one, 1)[20]) for one in (parted, unknown))
    assert none < 20
    sheet = next(pictures_with_legend(parted, [0], film_frames(parted, np.array([0]))))
    assert known == pytest.approx(2 * sheet.shape[1] / 14, abs=2)  # 1 mm: two cells of fourteen


def longest_line(row):
    """Return how many pixels side by side are dark."""
    dark = (row == colour("obstacle")).all(axis=1)
    return max(len(run) for run in "".join("x" if one else " " for one in dark).split())


def test_what_is_out_of_reach_is_said_everywhere(parted):
    assert parted.out_of_reach == "18 of 66 free cells"
    assert "18 of 66 free cells are out of reach" in map_figure(parted).axes[0].get_title(
        loc="left"
    )
    assert page.page_data(parted)["unreachable"] == 18
    assert "18 of 66 free cells" in parted._repr_html_()
    whole = replace(
        parted,
        problem=parted.problem.replaced(
            map=GridWorkspace(np.ones((6, 12)), name="rooms", spacing=(0.5, 0.5))
        ),
    )
    assert (caption_of(parted, 1)[:36] != caption_of(whole, 1)[:36]).any()


def test_mp4_can_be_decoded(episode, tmp_path):
    film(episode, tmp_path / "film.mp4")
    height, width = 9 * 80 + CAPTION, 11 * 80
    decoded = subprocess.run(
        [
            imageio_ffmpeg.get_ffmpeg_exe(),
            "-v",
            "error",
            "-i",
            tmp_path / "film.mp4",
            "-f",
            "rawvideo",
            "-pix_fmt",
            "rgb24",
            "-",
        ],
        check=True,
        capture_output=True,
    ).stdout
    frames = np.frombuffer(decoded, np.uint8).reshape(-1, height, width, 3)
    assert len(frames) == episode.moves + 1
    side = 80
    centres = frames[-1][side // 2 :: side, side // 2 :: side][:9, :11].astype(int)
    assert np.abs(centres - picture_of(*episode.final())).mean() < 12  # a lossy format


def test_long_films_show_first_and_last(episode):
    assert frame_moves(10_000, 400)[[0, -1]].tolist() == [0, 10_000]
    assert len(frame_moves(10_000, 400)) == 400
    frames = list(film_frames(episode, frame_moves(episode.moves, 3)))
    np.testing.assert_array_equal(frames[0], picture_of(*next(iter(episode.frames()))))
    np.testing.assert_array_equal(frames[-1], picture_of(*episode.final()))


def test_player_page_holds_the_episode(episode, tmp_path):
    page = player_page(episode)
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert "https://" not in page
    data = json.loads(
        re.search(r'<script[^>]*type="application/json"[^>]*>(.*?)</script>', page, re.S).group(1)
    )
    assert data["commands"] == episode.commands
    assert data["shape"] == [7, 9]
