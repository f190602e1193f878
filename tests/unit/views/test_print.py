"""Figures for print: their size, text and moment, the caption beside them, and bad options."""

from __future__ import annotations

import json
import re
import shlex

import numpy as np
import pytest
from matplotlib.text import Text
from PIL import Image
from shapely import box

from shoal.cli import run
from shoal.core.errors import InvalidInputError
from shoal.parts import load
from shoal.search import SearchProblem, region_of
from shoal.search.run import run as run_search
from shoal.steering import SteeringProblem
from shoal.steering.run import run as run_steering
from shoal.swarm import GridWorkspace, SwarmProblem
from shoal.swarm.run import run as run_swarm
from shoal.views import figure, figure_kinds, save_figure
from shoal.views.drawing.charts import fit_columns


@pytest.fixture(scope="module")
def episodes():
    points = [(0.2, 0.3), (0.5, 0.35)], [(0.8, 0.2), (0.3, 0.75)]
    fields = {"particles": 3, "policy": "closest-frontier"}
    return {
        "swarm": run_swarm(SwarmProblem("maze:11x9", **fields), seed=1),
        "volume": run_swarm(SwarmProblem(GridWorkspace(np.ones((3, 4, 5))), **fields), seed=1),
        "steering": run_steering(SteeringProblem("square", *points, planner="greedy")),
        "search": run_search(
            SearchProblem("square:50", robots=3, footprint=10, prior=["ring:5,5:0.5=9"]), seed=2
        ),
    }


@pytest.fixture(scope="module")
def folder(episodes, tmp_path_factory):
    made = tmp_path_factory.mktemp("episodes")
    episodes["swarm"].save(made / "swarm.npz")
    episodes["steering"].save(made / "steering.json")
    episodes["search"].save(made / "search.json")
    return made


@pytest.mark.parametrize("part", ["swarm", "volume", "steering", "search"])
def test_every_figure_fits_a_column_of_a_journal(part, episodes):
    """What is written lies inside the figure, with text of the size that was asked for."""
    for kind in figure_kinds(episodes[part]):
        drawn = figure(episodes[part], kind=kind, width=85, font_size=7)
        assert drawn.get_figwidth() * 25.4 == pytest.approx(85)
        drawn.draw_without_rendering()
        sizes = {text.get_fontsize() for text in drawn.findobj(Text) if text.get_text().strip()}
        assert max(sizes) <= 10 * 7 / 8
        box = drawn.get_tightbbox()
        assert min(box.x0, box.y0) > -0.02, kind
        assert (box.max < drawn.get_size_inches() + 0.02).all(), kind


@pytest.mark.parametrize("part", ["swarm", "volume", "search"])
def test_maps_take_the_width_and_leave_no_empty_stripe(part, episodes):
    drawn = figure(episodes[part], width=85)
    drawn.draw_without_rendering()
    (axes,) = drawn.axes
    room, used = axes.get_position(original=True), axes.get_position()
    assert used.width > 0.97 * room.width
    box = drawn.get_tightbbox()
    assert drawn.get_figheight() - box.height < 0.2  # inches


def test_names_of_slices_are_text(episodes, tmp_path):
    save_figure(figure(episodes["volume"], width=85), tmp_path / "volume.svg")
    written = (tmp_path / "volume.svg").read_text(encoding="utf-8")
    assert all(f">{name} " in written for name in ("layer", "row", "column"))


def test_headings_are_parts_of_captions(episodes):
    swarm = episodes["swarm"]
    assert figure(swarm).axes[0].get_title(loc="left").startswith("maze:11x9 after")
    assert figure(swarm, width=85).axes[0].get_title(loc="left") == ""
    assert figure(episodes["search"], width=85)._suptitle is None


def test_moments(episodes):
    swarm, steering, search = (episodes[part] for part in ("swarm", "steering", "search"))
    early = figure(swarm, moves=[0, 2, swarm.moves])
    assert [axes.get_title(loc="left") for axes in early.axes] == [
        "0 moves",
        "2 moves",
        f"{swarm.moves} moves",
    ]
    assert len(figure(swarm, moves=[0, 1, 2, 3]).axes) == 4  # three in a row, and a shorter row
    begun = figure(steering, moves=1).axes[0].get_title(loc="left")
    assert f"1 of {steering.moves} moves" in begun
    times = sorted(time for log in search.trace.robots for time in search.clock(log.times))
    middle = float(np.mean(times))
    words = figure(search, seconds=middle).axes[0].get_title(loc="left")
    assert int(words.split()[0]) == sum(float(time) <= middle for time in times)


@pytest.mark.parametrize(
    ("part", "options", "words"),
    [
        ("swarm", {"width": 10}, "width: expected a number from 30 to 1000, got 10"),
        ("swarm", {"font_size": 7}, "font size: expected a width beside it, got none"),
        ("swarm", {"width": 85, "font_size": 50}, "font size: expected a number from 4 to 20"),
        (
            "swarm",
            {"width": 30, "font_size": 20},
            "figure map: expected a width with room for the text, got 30 mm for text of 20 pt",
        ),
        ("search", {"width": 30, "font_size": 14}, "figure routes: expected a width with room"),
        ("swarm", {"seconds": 3}, "option of the figure map: expected one of moves, got 'seconds'"),
        ("swarm", {"moves": [0, 10**6]}, "moves: expected"),
        ("volume", {"moves": [0, 1]}, "at: expected one number for a volume, got 2"),
        ("steering", {"moves": 999}, "moves: expected"),
        ("search", {"seconds": -1.0}, "seconds: expected"),
        ("search", {"kind": "timeline", "seconds": 3}, "option of the figure timeline"),
    ],
)
def test_bad_options_get_a_sentence(part, options, words, episodes):
    with pytest.raises(InvalidInputError, match=re.escape(words)):
        figure(episodes[part], **options)


def test_text_stays_text_and_equal_figures_give_equal_files(episodes, tmp_path):
    for name in ("a.svg", "b.svg", "a.pdf", "b.pdf"):
        save_figure(figure(episodes["swarm"], kind="frontier", width=85), tmp_path / name)
    assert ">moves</text>" in (tmp_path / "a.svg").read_text(encoding="utf-8")
    assert b"/FontFile2" in (tmp_path / "a.pdf").read_bytes()
    for suffix in ("svg", "pdf"):
        first, second = (tmp_path / f"{name}.{suffix}" for name in "ab")
        assert first.read_bytes() == second.read_bytes()


def test_columns_of_a_legend_fit():
    assert fit_columns(["a", "b", "c"], 3, width=3.0) == 3
    assert fit_columns(["a" * 60, "b" * 60, "c"], 3, width=4.0) == 1
    # rows as even as can be
    assert fit_columns(["a", "b", "c", "d", "e"], 4, width=9.0) == 3


def test_command(folder, capsys):
    out = folder / "map.png"
    command = ["figure", str(folder / "swarm.npz"), "--at", "2", "--width", "85", "--out", str(out)]
    assert run([*command, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    with Image.open(out) as picture:
        assert picture.width == int(85 / 25.4 * 300)
        assert round(picture.info["dpi"][0]) == 300
    caption = (folder / "map.caption.txt").read_text(encoding="utf-8")
    assert told["caption"] == str(folder / "map.caption.txt")
    assert "Map at moves 2." in caption
    assert "shoal map maze:11x9 --particles=3 --policy=closest-frontier --seed=1" in caption
    assert "matplotlib" in caption


def test_the_command_of_a_caption_repeats_the_episode(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    problem = SearchProblem(region_of(box(0, 0, 40, 20), name="own"), robots=2, footprint=10)
    episode = run_search(problem, seed=3)
    episode.save("episode.json")
    assert run(["figure", "episode.json", "--width", "85", "--out", "routes.png"]) == 0
    caption = (tmp_path / "routes.caption.txt").read_text(encoding="utf-8")
    (command,) = re.findall(r"^Problem: shoal (.*)$", caption, re.MULTILINE)
    assert run([*shlex.split(command), "--out", "again"]) == 0
    assert (tmp_path / "routes.problem.json").exists()
    again = load("again/episode.json")
    assert again.trace.to_dict() == episode.trace.to_dict()


@pytest.mark.parametrize(
    ("file", "more", "words"),
    [
        ("swarm.npz", ["--at", "x"], "--at: expected moves, such as 20, got 'x'"),
        ("swarm.npz", ["--kind", "frontier", "--at", "1"], "--at: expected none for the figure"),
        ("steering.json", ["--at", "0,1"], "--at: expected one moment for the figure plan"),
        ("search.json", ["--dpi", "5"], "dpi: expected a number from 20 to 2400, got 5"),
        ("search.json", ["--seed", "1"], "seed"),
    ],
)
def test_bad_commands_write_nothing(file, more, words, folder, tmp_path, capsys):
    out = tmp_path / "bad.svg"
    assert run(["figure", str(folder / file), "--out", str(out), *more]) == 2
    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
