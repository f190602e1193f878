"""Films of steering plans: whole files, and positions within the moves that the world
would give.
"""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace

import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image
from tests.steering import steer, thrown

from shoal.cli import run
from shoal.core.errors import InvalidInputError
from shoal.steering import (
    SteeringProblem,
    cylinder,
    disk,
    open_workspace,
    prism,
    region,
    regular_polygon,
)
from shoal.steering.delta_space import reached_in_two_moves
from shoal.views import film
from shoal.views.drawing.encoding import palette_of
from shoal.views.steering import films
from shoal.views.steering.figures import plan_figure
from shoal.views.steering.films import SteeringFilm
from shoal.views.steering.page import page_data
from shoal.views.steering.trajectories import (
    FilmMoment,
    FilmSchedule,
    Frame3D,
    MoveTrajectory,
    camera_for,
    trajectories_of,
    two_move_rings,
)

SQUARE = open_workspace("square")
PLANE = [(0.2, 0.3), (0.5, 0.35)], [(0.8, 0.2), (0.3, 0.75)]
SPACE = [(0.1, 0.2, 0.3), (0.0, 0.1, 0.6)], [(-0.2, 0.1, 0.7), (0.1, -0.1, 0.2)]
YARD = region([(0, 0), (4, 0), (4, 3), (0, 3)], [[(1, 1), (2, 1), (2, 2), (1, 2)]])


def planned(workspace, ends, *, planner="greedy", tolerance=1e-6, **noise):
    problem = SteeringProblem(workspace, np.array(ends[0]), np.array(ends[1]), tolerance)
    return steer(problem, planner=planner, **noise)


ANY = np.random.default_rng(5).normal(scale=0.5, size=(6, 3))
EPISODES = {
    "square": lambda: planned(SQUARE, PLANE),
    "prism": lambda: planned(prism(regular_polygon(7), 0.8), SPACE),
    "cylinder": lambda: thrown(cylinder(0.5, 0.8), SPACE[0], ANY),
    "noise": lambda: thrown(SQUARE, PLANE[0], ANY[:, :2], execution=0.01, gain=0.4),
    "slides": lambda: thrown(disk(0.5), [(0.2, 0.2), (-0.1, -0.1)], ANY[:, :2], friction=0.4),
    "spheres": lambda: thrown(SQUARE, PLANE[0], ANY[:, :2], particle_radius=0.05),
    "region": lambda: thrown(YARD, [(0.3, 0.3), (0.5, 2.5), (3.0, 1.0)], 3 * ANY[:, :2]),
}


@pytest.fixture(scope="module")
def episodes():
    return {name: make() for name, make in EPISODES.items()}


@pytest.mark.parametrize("name", EPISODES)
def test_within_a_move_particles_are_where_the_world_has_them(name, episodes):
    episode = episodes[name]
    workspace, size = episode.problem.place, episode.problem.place.size
    world = episode.problem.world(seed=episode.seed)
    trajectories = trajectories_of(episode)
    assert len(trajectories) == episode.moves
    rng = np.random.default_rng(np.random.SeedSequence(episode.seed).spawn(4)[1])
    for trajectory, before, after in zip(
        trajectories, episode.states, episode.states[1:], strict=False
    ):
        moved = trajectory.sent + rng.normal(
            scale=episode.problem.execution, size=trajectory.sent.shape
        ) * bool(episode.problem.execution)
        np.testing.assert_array_equal(trajectory.at(0), before)
        np.testing.assert_array_equal(trajectory.at(1), after)
        assert (np.diff(trajectory.shares) > 0).all()
        for share in np.linspace(0, 1, 41):
            here = trajectory.at(share)
            assert workspace.contains(here).all()
            np.testing.assert_allclose(here, world.step(before, share * moved), atol=2e-4 * size)
            depth = workspace.depth(here) - episode.problem.particle_radius
            for particle, _ in trajectory.holders(share):
                assert depth[particle] < 1e-3 * size  # who is held is on a wall
                if episode.problem.friction == np.inf:
                    # and stays there
                    np.testing.assert_allclose(here[particle], after[particle], atol=1e-6 * size)


def test_a_wall_is_shown_while_it_holds(episodes):
    square = episodes["square"]
    first, second = trajectories_of(square)[:2]
    assert first.holders(0) == ()
    (particle, wall), *_ = second.holders(0.5)
    assert square.problem.place.wall_distances(square.states[1][particle])[wall] < 1e-9
    sliding = [
        held
        for trajectory in trajectories_of(episodes["slides"])
        for held in trajectory.held
        if held
    ]
    assert {wall for held in sliding for _, wall in held} == {0}  # the circle


def test_moves_last_as_long_as_they_are_long():
    trajectories = [
        MoveTrajectory(np.array([x, 0.0]), np.array([0.0, 1.0]), np.zeros((2, 2, 2)), ((),))
        for x in (1.0, 2.0, 0.01)
    ]
    schedule = FilmSchedule(trajectories, size=1.0)
    assert schedule.lasting[1] == pytest.approx(2 * schedule.lasting[0])
    assert schedule.at(0) == FilmMoment(0, 0.0)
    assert schedule.at(schedule.seconds) == FilmMoment(2, 1.0)
    moments, rate = schedule.moments(30, 60)
    assert (len(moments), rate) == (60, pytest.approx(60 / schedule.seconds))
    assert [(m.move, m.share) for m in moments] == sorted((m.move, m.share) for m in moments)
    assert FilmSchedule(trajectories * 200, size=1.0).seconds < 60


def test_shaded_is_what_two_moves_reach(episodes):
    from shapely import Point, Polygon

    square = episodes["square"]
    before = square.states[0][1] - square.states[0][0]
    (ring,) = two_move_rings(square)[0]
    shape = Polygon(ring)
    for point in np.random.default_rng(0).uniform(-1, 1, size=(300, 2)):
        if shape.exterior.distance(Point(point)) > 2e-3:
            assert shape.contains(Point(point)) == (
                reached_in_two_moves(SQUARE, before, point) is not None
            )
    assert two_move_rings(episodes["slides"]) == [[]] * 6


@pytest.mark.parametrize(("name", "width"), [("square", 768), ("cylinder", 576)])
def test_gif(name, width, episodes, tmp_path, monkeypatch):
    monkeypatch.setitem(films.LONGEST, ".gif", 16)
    told = []
    film(
        episodes[name],
        tmp_path / "film.gif",
        on_frame=lambda done, total: told.append((done, total)),
    )
    assert told == [(k, 16) for k in range(1, 17)]
    seconds = FilmSchedule(
        trajectories_of(episodes[name]), size=episodes[name].problem.place.size
    ).seconds
    with Image.open(tmp_path / "film.gif") as picture:
        assert picture.size == (width, 432)
        assert 6 <= picture.n_frames <= 16  # what rests is one frame that lasts
        lasting = 0
        for frame in range(picture.n_frames):
            picture.seek(frame)
            lasting += picture.info["duration"] / 1000
        assert lasting == pytest.approx(seconds, rel=0.05)
        assert picture.convert("RGB").getpixel((2, 2)) == (255, 255, 255)


def test_mp4(episodes, tmp_path, monkeypatch):
    monkeypatch.setitem(films.LONGEST, ".mp4", 12)
    film(episodes["square"], tmp_path / "film.mp4")
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
    frames = np.frombuffer(decoded, np.uint8).reshape(-1, 720, 1280, 3)
    assert len(frames) == 12
    drawn = next(
        SteeringFilm(episodes["square"], trajectories_of(episodes["square"])).frames(
            [FilmMoment(0, 0.0)]
        )
    )
    assert np.abs(frames[0].astype(int) - drawn).mean() < 3  # a lossy format


def test_particles_are_drawn_where_they_are(episodes):
    """The discs of the first particle and their numbers lie where the view says."""
    episode = episodes["region"]
    trajectories = trajectories_of(episode)
    film = SteeringFilm(episode, trajectories, height=720)
    frame = next(film.frames([FilmMoment(2, 0.5)]))
    blue = np.argwhere((frame == (0, 114, 178)).all(axis=2))
    here = trajectories[2].at(0.5)[0]
    scale = min(880 / 4, (720 - 86 - 124) / 3)
    place = np.array([480 + (here[0] - 2) * scale, 86 + 255 - (here[1] - 1.5) * scale])
    assert np.abs(blue - place[::-1]).sum(axis=1).min() < 12


def test_nothing_to_play(tmp_path):
    still = thrown(SQUARE, PLANE[0], np.zeros((0, 2)))
    film(still, tmp_path / "film.html")
    assert len(list(SteeringFilm(still, []).frames([FilmMoment(0, 0.0)]))) == 1
    assert page_data(still)["trajectories"] == []


def test_nothing_is_left_behind(episodes, tmp_path, monkeypatch):
    def stop(done, total):
        if done == 3:
            raise KeyboardInterrupt

    for suffix in (".gif", ".mp4"):
        with pytest.raises(KeyboardInterrupt):
            film(episodes["square"], tmp_path / f"film{suffix}", on_frame=stop)
    with pytest.raises(
        InvalidInputError,
        match=r"film.avi: expected a film \(.gif .mp4 .html\), got the suffix '.avi'",
    ):
        film(episodes["square"], tmp_path / "film.avi")
    assert list(tmp_path.iterdir()) == []


def test_colours_that_fill_much_stay_exact():
    frame = np.full((60, 60, 3), 255, np.uint8)
    frame[:20] = (0, 114, 178)
    frame[20:24] = np.linspace((0, 114, 178), (255, 255, 255), 4 * 60).reshape(4, 60, 3)
    colours = np.frombuffer(palette_of([frame]), np.uint8).reshape(-1, 3)
    assert {(255, 255, 255), (0, 114, 178)} <= set(map(tuple, colours.tolist()))
    assert 10 < len(colours) <= 256


def test_edges_of_a_box_seen_from_the_side():
    box = prism(SQUARE, 1.0)
    camera = replace(camera_for(box, np.full((1, 2, 3), 0.5), azimuth=-np.pi / 2), elevation=0.01)
    behind, front = Frame3D.of(box).edges(camera.eye)
    # Looked at along y: the face y = 0 is in front, three edges of the floor and the ceiling and
    # the two far uprights are behind.
    assert (len(behind), len(front)) == (3 + 3 + 2, 1 + 1 + 2)
    assert all((edge[:, 1] == 0).all() for edge in front)
    above = replace(camera_for(box, np.full((1, 2, 3), 0.5), azimuth=0.3), elevation=1.4)
    assert sum(bool((edge[:, 2] == 1).all()) for edge in Frame3D.of(box).edges(above.eye)[1]) == 4


def test_figure_in_space_shows_more_particles_than_colours():
    start = [(0.1 * k, 0.0, 0.1 + 0.1 * k) for k in range(-3, 4)]
    episode = thrown(cylinder(0.5, 0.8), [(x, y, abs(z)) for x, y, z in start], ANY)
    axes = plan_figure(episode).axes
    assert len(axes[0].get_legend().get_texts()) == 7 + 1  # the goals
    assert len(axes[1].lines) == 14


# ---- the command line
# ------------------------------------------------------------------------------------------


def problem_file(folder):
    vertices = [[0, 0], [1, 0], [1, 1], [0, 1]]
    data = {
        "workspace": {"type": "polygon", "vertices": vertices},
        "start": PLANE[0],
        "goal": PLANE[1],
    }
    (folder / "problem.json").write_text(json.dumps(data))
    return str(folder / "problem.json")


def test_steer_and_replay_write_films(tmp_path, capsys):
    film, out = tmp_path / "a" / "film.html", tmp_path / "plan"
    assert (
        run(
            [
                "steer",
                problem_file(tmp_path),
                "--planner",
                "greedy",
                "--film",
                str(film),
                "--out",
                str(out),
            ]
        )
        == 0
    )
    page = film.read_text()
    assert str(film) in "".join(capsys.readouterr().out.split())
    again = tmp_path / "again.html"
    replay = [
        "replay",
        str(out / "episode.json"),
        "--json",
        "--film",
        str(again),
        "--out",
        str(tmp_path / "figures"),
        "--seed",
        "0",
    ]
    assert run(replay) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["verified"] is True
    assert result["status"] == "solved"
    assert again.read_text() == page
    assert {path.name for path in (tmp_path / "figures").iterdir()} == {
        "plan.png",
        "episode.json",
        "summary.json",
    }


def test_replay_of_what_is_not_what_it_says(tmp_path, capsys):
    episode = planned(SQUARE, PLANE)
    states = episode.states.copy()
    states[2, 1] += 0.01
    replace(episode, states=states).save(tmp_path / "false.json")
    assert (
        run(
            ["replay", str(tmp_path / "false.json"), "--film", str(tmp_path / "film.gif"), "--json"]
        )
        == 1
    )
    said = capsys.readouterr()
    assert json.loads(said.out)["verified"] is False
    assert "after move 2 particle 2 is 0.0141 from its position in the episode" in said.err
    replace(episode, inputs=episode.inputs[:-1], states=episode.states[:-1]).save(
        tmp_path / "short.json"
    )
    assert run(["replay", str(tmp_path / "short.json")]) == 1
    assert "the status is solved, and a particle ends" in capsys.readouterr().err
    assert {path.name for path in tmp_path.iterdir()} == {"false.json", "short.json"}


def test_bad_films_and_episodes_get_one_sentence(tmp_path, capsys):
    problem = problem_file(tmp_path)
    assert run(["steer", problem, "--film", "film.avi"]) == 2
    assert (
        capsys.readouterr().err
        == "shoal: film.avi: expected a film (.gif .mp4 .html), got the suffix '.avi'\n"
    )
    assert run(["replay", problem]) == 2
    assert (
        capsys.readouterr().err
        == f"shoal: {problem}: expected an episode of swarm, steering or search, got JSON of"
        " another kind\n"
    )
    planned(SQUARE, PLANE).save(tmp_path / "episode.json")
    assert run(["replay", str(tmp_path / "episode.json"), "--seed", "4"]) == 2
    assert "expected an episode of seed 4, got seed 0" in capsys.readouterr().err
    assert run(["replay", str(tmp_path / "none.json")]) == 2
    assert "expected an episode, got no such file" in capsys.readouterr().err
