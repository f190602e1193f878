"""Films for presentations: their size, moves between cells, the photograph, the card at the end,
and options without effect.
"""

from __future__ import annotations

import re
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image, ImageDraw
from tests.search_episodes import search

from shoal.cli import run
from shoal.core.errors import InvalidInputError
from shoal.steering import SteeringProblem
from shoal.steering.run import run as run_steering
from shoal.swarm import GridWorkspace, SwarmProblem
from shoal.swarm.maps.imaging import VesselMap
from shoal.swarm.maps.workspace import PALETTE
from shoal.swarm.run import run as run_swarm
from shoal.views import film, steering, swarm
from shoal.views import search as search_views
from shoal.views.drawing.encoding import palette_of, write_gif
from shoal.views.drawing.stage import SIZES, Stage, end_card
from shoal.views.swarm.colours import rgb_of
from shoal.views.swarm.presentation import PresentedSwarm


def corridor(**fields):
    workspace = GridWorkspace(np.ones((1, 12)))
    return run_swarm(SwarmProblem(workspace, particles=2, **fields), seed=1)


@pytest.fixture(scope="module")
def episodes():
    points = [(0.2, 0.3), (0.5, 0.35)], [(0.8, 0.2), (0.3, 0.75)]
    return {
        "swarm": (swarm.films, corridor()),
        "steering": (
            steering.films,
            run_steering(SteeringProblem("square", *points, planner="greedy")),
        ),
        "search": (search_views.films, search("square:30", robots=2, footprint=10)),
    }


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("part", ["swarm", "steering", "search"])
def test_every_part_fills_the_picture_and_ends_with_its_card(part, size, episodes):
    films, episode = episodes[part]
    stage = Stage(size, 30)
    clip = films.clip_of(episode, ".mp4", stage)
    assert clip.rate == 30
    assert len(clip.moments) >= 4 * 30
    first, last = clip.frames([clip.moments[0], clip.moments[-1]])
    width, height = SIZES[size]
    assert first.shape == last.shape == (height, width, 3)
    for edge in (first[:5], first[-5:], first[:, :5], first[:, -5:]):
        assert (edge > 240).all()  # nothing is cut off
    assert (last != first).any()
    assert last.min() < 60  # the sentence of the episode


def test_the_card_says_how_the_episode_ended(monkeypatch, episodes):
    from shoal.views.drawing.canvas import Canvas

    said = []
    write = Canvas.text
    monkeypatch.setattr(
        Canvas, "text", lambda *args, **more: said.append(args[2]) or write(*args, **more)
    )
    episode = episodes["swarm"][1]
    end_card(Stage("square", 30), episode, "a corridor")
    assert said[0] == "a corridor"
    told = " ".join(said[1:-1])
    assert told.lower().rstrip(".") == episode.sentence.lower()
    assert "seed 1" in said[-1]
    assert episode.versions["shoal"] in said[-1]


@pytest.mark.parametrize("rule", ["block", "merge", "tilt"])
def test_particles_pass_through_all_places_between_two_cells(rule):
    episode = corridor(rule=rule, task="coverage")
    shown = PresentedSwarm(episode, Stage("wide", 30))
    steps = list(shown._steps())
    for move, ((_, before), after) in enumerate(pairwise(steps)):
        places = [
            shown._between(before, after, move, share)[:, 1] for share in np.linspace(0, 1, 9)
        ]
        assert sorted(places[0]) == sorted(before[:, 1])
        assert sorted(places[-1]) == sorted(after[1][:, 1])
        forward = {"l": -1, "r": 1}[episode.commands[move]]
        # none goes backwards, and each goes half its way in half the time
        assert (forward * np.diff(places, axis=0) >= 0).all()
        np.testing.assert_allclose(places[4], (places[0] + places[-1]) / 2)


def test_pictures_show_particles_where_they_are():
    episode = corridor()
    shown = PresentedSwarm(episode, Stage("wide", 30))
    colour = np.array(rgb_of(PALETTE["particle"]))
    for moment in (0.0, 0.5, 1.0):
        (picture,) = shown.frames([moment])
        (left, top), (width, height) = shown._corner, shown._size
        inside = picture[top : top + height, left : left + width]
        rows, columns = np.nonzero((inside == colour).all(axis=-1))
        steps = list(shown._steps())
        before, after = steps[int(moment)], steps[int(moment) + 1]
        wanted = shown._between(before[1], after, int(moment), moment % 1)
        middles = (wanted[:, 1] + 1.5) * shown._scale
        away = np.abs(columns[:, None] - middles).min(axis=1)
        assert away.max() <= 0.5 * shown._scale
        assert (np.abs(columns - middles[:, None]).min(axis=1) <= 1).all()
        assert abs(rows.mean() - 1.5 * shown._scale) < 1


@pytest.mark.parametrize(
    "clip_of",
    [
        lambda episode: swarm.films.clip_of(episode, ".mp4", Stage("wide", 30)),
        lambda episode: swarm.films.clip_of(episode, ".gif", None),
    ],
    ids=["for talks", "plain"],
)
def test_a_photograph_lies_under_its_map(clip_of, tmp_path):
    picture = Image.new("RGB", (120, 90), (180, 120, 90))
    ImageDraw.Draw(picture).line([(5, 45), (60, 25), (115, 50)], (90, 20, 20), 7)
    picture.save(tmp_path / "vessel.png")
    problem = SwarmProblem(str(tmp_path / "vessel.png"), particles=2, vessels=True, width=60)
    episode = run_swarm(problem, seed=1)
    clip = clip_of(episode)
    with_it = next(iter(clip.frames(clip.moments[:1]))).copy()
    middle = clip.moments[len(clip.moments) // 2 : len(clip.moments) // 2 + 1]
    ends = {True: next(iter(clip.frames(middle))).copy()}
    (tmp_path / "vessel.png").unlink()
    clip = clip_of(episode)
    without = next(iter(clip.frames(clip.moments[:1]))).copy()
    ends[False] = next(iter(clip.frames(middle)))
    assert with_it.shape == without.shape
    # the ground beside the vessel is unknown: grey without the photograph, else in its colour
    unknown = (without == rgb_of(PALETTE["unknown"])).all(axis=-1)
    unknown[-200:] = False  # the legend
    assert unknown.sum() > 1000
    red, green, blue = np.median(with_it[unknown], axis=0)
    assert red > green > blue
    # the legend has each colour as it is drawn on the photograph
    plain, seen = ends[False], ends[True]
    for name in ("obstacle", "free", "unknown"):
        there = (plain == rgb_of(PALETTE[name])).all(axis=-1)
        there[-200:] = False
        drawn = np.median(seen[there], axis=0)
        assert (np.abs(seen[-200:] - drawn).max(axis=-1) < 16).sum() > 60, name


def test_a_map_knows_where_it_is_in_its_photograph():
    mask = np.zeros((90, 120), dtype=bool)
    mask[40:46, 10:110] = True
    mask[20:70, 60:66] = True
    mapped = VesselMap(mask, width=50)
    left, top, right, bottom = mapped.picture_box
    side = mapped.pixels_a_cell
    assert mapped.free.shape == (round((bottom - top) / side), round((right - left) / side))
    rows, columns = np.nonzero(mapped.free)
    pixels = (top + side * (rows + 0.5)).astype(int), (left + side * (columns + 0.5)).astype(int)
    assert mask[pixels].all()


def test_pixels_that_do_not_change_cost_nothing_in_a_gif(tmp_path):
    rng = np.random.default_rng(1)
    ground = rng.choice(np.arange(0, 250, 25, dtype=np.uint8), (60, 80, 1)).repeat(3, axis=2)
    frames = [ground.copy() for _ in range(20)]
    for k, frame in enumerate(frames):
        frame[10, k] = (250, 0, 0)
        frame[50, 79 - k] = (0, 0, 250)
    write_gif(tmp_path / "a.gif", iter(frames), 10, palette=palette_of(frames))
    write_gif(tmp_path / "b.gif", iter(frames[:1]), 10, palette=palette_of(frames))
    assert (tmp_path / "a.gif").stat().st_size < 3 * (tmp_path / "b.gif").stat().st_size
    with Image.open(tmp_path / "a.gif") as film_:
        for k, frame in enumerate(frames):
            film_.seek(k)
            assert np.abs(np.asarray(film_.convert("RGB")).astype(int) - frame).max() <= 4


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        ("a.html", {"size": "wide"}, "size: expected none for the player (.html), got wide"),
        ("a.mp4", {"size": "tall"}, "size: expected one of wide, square, got 'tall'"),
        ("a.mp4", {"rate": 60}, "rate: expected a size beside it, got 60 alone"),
        ("a.gif", {"size": "wide", "rate": 60}, "rate: expected none for a .gif film, got 60"),
        ("a.mp4", {"size": "wide", "rate": 25}, "rate: expected 30 or 60 frames per second, got"),
    ],
)
def test_options_without_effect_are_refused(name, options, words, episodes, tmp_path, capsys):
    episode = episodes["swarm"][1]
    with pytest.raises(InvalidInputError, match=re.escape(words)):
        film(episode, tmp_path / name, **options)
    episode.save(tmp_path / "episode.npz")
    more = [word for key, value in options.items() for word in (f"--{key}", str(value))]
    command = ["replay", str(tmp_path / "episode.npz"), "--film", str(tmp_path / name), *more]
    assert run(command) == 2
    assert words in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["episode.npz"]


def test_a_size_needs_a_film_of_a_plane_map(episodes, tmp_path, capsys):
    volume = SwarmProblem(GridWorkspace(np.ones((2, 3, 3))), particles=2)
    with pytest.raises(InvalidInputError, match="size: expected none for the film of a volume"):
        film(run_swarm(volume, seed=1), tmp_path / "a.mp4", size="wide")
    episodes["swarm"][1].save(tmp_path / "episode.npz")
    assert run(["replay", str(tmp_path / "episode.npz"), "--size", "wide"]) == 2
    assert "--size: expected a film beside it (--film), got wide alone" in capsys.readouterr().err
