"""Figures, timelines and films of searches: what is drawn is what the episode tells."""

from __future__ import annotations

import json
from base64 import b64decode
from functools import cache
from itertools import pairwise
from math import inf

import numpy as np
import pytest
import shapely
from docs.make_images import expected_time_figure
from PIL import Image
from tests.search_episodes import search

from shoal.core.errors import InvalidInputError
from shoal.search import LocalFrame, SearchEpisode, SearchProblem, region_of
from shoal.search.episode import duration_text
from shoal.search.problem.network import Battery, Crash, Liar, Pause, Slow, WrongPosition
from shoal.search.run import run
from shoal.views import figure, film
from shoal.views.drawing.canvas import rings_of
from shoal.views.drawing.charts import save_figure
from shoal.views.search.figures import cell_colours, routes_figure, spread_out
from shoal.views.search.films import SearchFilm
from shoal.views.search.history import SearchHistory
from shoal.views.search.missions import label_offsets
from shoal.views.search.page import page_data, simplify
from shoal.views.search.timeline import timeline_figure

TWO = shapely.MultiPolygon([shapely.box(0, 0, 40, 30), shapely.box(70, 10, 100, 40)])
CASES = {
    "ring": lambda: search(
        "ring:60x40",
        robots=4,
        footprint=10,
        allocation="hop",
        loss=0.2,
        faults=[Crash(2, 9.0), Pause(3, 5, 12)],
        targets=3,
        seed=3,
    ),
    "one robot, one cell": lambda: search("square:5", robots=1, footprint=10),
    "reserve": lambda: search("square:20", robots=7, footprint=10, starts="line"),
    "all dead": lambda: search(
        "rectangle:90x40",
        robots=3,
        footprint=10,
        faults=[Crash(1, 0.0), Crash(2, 7.0), Crash(3, 9.5)],
        targets=1,
    ),
    "two parts": lambda: search(
        region_of(TWO, name="two $parts$"),
        robots=2,
        footprint=10,
        transit=True,
        vehicle="ideal,cruise_speed=3",
    ),
    "as planned": lambda: search(
        "square:60", robots=3, footprint=10, simulate=False, allocation="hop"
    ),
    "many": lambda: search(
        "square:100",
        robots=30,
        footprint=10,
        starts="clustered",
        faults=[Crash(k, 2.0) for k in range(2, 9)],
    ),
    "a liar": lambda: search(
        "square:60",
        robots=3,
        footprint=10,
        multiplicity=2,
        faults=[Liar(2), Slow(1, 2.0, 5.0), WrongPosition(3, 4), Battery(1, 9.0)],
    ),
}


@cache
def episode(name: str) -> SearchEpisode:
    return CASES[name]()


@pytest.fixture(params=CASES)
def history(request: pytest.FixtureRequest) -> SearchHistory:
    return SearchHistory(episode(request.param))


def test_stretches_follow_one_another(history):
    for robot, activities in enumerate(history.activities):
        assert activities[0].begin == 0
        assert activities[-1].end == history.end
        assert all(one.end == two.begin for one, two in pairwise(activities))
        log = history.logs[robot]
        for time, other in zip(log.times, history.foreign_owners(robot), strict=True):
            doing = [one for one in activities if one.begin < max(time, 1e-9) <= one.end]
            assert [(one.kind, one.other) for one in doing] == [
                ("taken", other) if other else ("own", 0)
            ]


def test_robots_are_in_each_cell_when_they_have_searched_it(history):
    plan = history.episode.plan
    for robot, (log, trajectory) in enumerate(zip(history.logs, history.trajectories, strict=True)):
        assert (np.diff(trajectory.times) >= 0).all()
        np.testing.assert_array_equal(trajectory.at(0.0), plan.places[robot])
        ends = (
            history.episode.routes[robot].points[history.routes.stop_ends(robot)[1:]]
            if len(log.cells)
            else np.zeros((0, 2))
        )
        for time, place in zip(log.times, ends, strict=True):
            np.testing.assert_allclose(trajectory.at(time), place, atol=1e-6)
        far = np.hypot(*np.diff(trajectory.points, axis=0).T)
        if not history.liars and len(log.cells):
            np.testing.assert_allclose(far.sum(), history.episode.routes[robot].length)
        # what the player is told is the same, to a millimetre or so
        for time in np.linspace(0, history.end, 60):
            np.testing.assert_allclose(
                simplify(trajectory, 1e-3).at(time), trajectory.at(time), atol=0.05
            )


def test_motion_stays_inside_and_is_no_faster_than_robots_are(history):
    region, size = history.episode.plan.grid.region, history.episode.plan.grid.size
    for robot, trajectory in enumerate(map(history.routes.trajectory, range(history.n_robots))):
        points = np.array([trajectory.at(time) for time in np.linspace(0, history.end, 100)])
        if not history.episode.plan.transit:
            assert region.contains(points).all()
        log = history.episode.trace.robots[robot]
        # from cell to cell: ways around corners are longer than reckoned
        if history.episode.simulated and len(log.cells) > 1:
            way = trajectory.times >= log.times[0] - 1e-9
            speeds = (
                np.hypot(*np.diff(trajectory.points[way], axis=0).T)
                / np.maximum(np.diff(trajectory.times[way]), 1e-12)
                / size
            )
            assert np.median(speeds) <= history.episode.scenario.rates[robot] + 1e-6


def test_robots_go_home_to_recharge():
    found = SearchHistory(
        search(
            "square:80",
            robots=2,
            footprint=10,
            vehicle="ideal,endurance=3,reserve=0,recharge=1",
            seed=2,
        )
    )
    for robot, trajectory in enumerate(map(found.routes.trajectory, range(2))):
        log, home = found.episode.trace.robots[robot], found.episode.plan.places[robot]
        gaps = np.flatnonzero(np.diff(log.times) > 6.0)  # recharging lasts six cells
        resting = [
            pair
            for pair in pairwise(zip(trajectory.times, trajectory.points, strict=True))
            if pair[1][0] - pair[0][0] > 5.9
        ]
        at_home = [
            pair
            for pair in resting
            if np.allclose(pair[0][1], home) and np.allclose(pair[1][1], home)
        ]
        assert len(at_home) >= 1
        assert len(at_home) == sum(
            1 for k in gaps if any(log.times[k] < pair[0][0] < log.times[k + 1] for pair in at_home)
        )
        assert (np.diff(trajectory.times) >= 0).all()
        speeds = (
            np.hypot(*np.diff(trajectory.points, axis=0).T)
            / np.maximum(np.diff(trajectory.times), 1e-12)
            / 10
        )
        assert speeds.max() < 1 + 1e-6
        for time, cell in zip(log.times, log.cells, strict=True):
            np.testing.assert_allclose(
                trajectory.at(time), found.episode.plan.tour_cost.points[cell] * 10, atol=1e-6
            )


def test_robots_from_outside_may_die_on_their_way_in():
    died = SearchHistory(
        search("square:60", robots=2, launch="-15,-5", faults="crash:2@2", footprint=10, seed=0)
    )
    (home, *_), last = died.trajectories[1].points.tolist(), died.trajectories[1].times[-1]
    assert (home, last) == ([-15.0, -5.0], 2.0)
    fallen = search(
        "box:40x40x20", robots=2, launch="-15,-5", faults="crash:2@3", footprint=10, seed=0
    )
    assert SearchHistory(fallen).trajectories[1].times[-1] == 3.0


def test_first_searched_is_what_the_logs_tell(history):
    times, by = history.first
    logs = history.logs
    for cell in range(history.n_cells):
        found = [
            (log.times[k], number)
            for number, log in enumerate(logs, start=1)
            if number not in history.liars
            for k in np.flatnonzero(log.cells == cell)
        ]
        told = min(found) if found else (inf, 0)
        if history.episode.plan.flies:  # a vehicle may see a cell on its way between two others
            assert times[cell] <= told[0]
            assert history.episode.clock(times[cell]) == pytest.approx(
                history.episode.visits.times[cell]
            )
        else:
            assert (times[cell], by[cell] if found else 0) == told
    if history.episode.simulated and not history.episode.plan.flies:
        assert (times.max() == pytest.approx(history.episode.trace.covered_at)) == (
            history.episode.problem.multiplicity == 1
        )
    assert history.searched(history.end) == np.isfinite(times).sum()


def test_taken_over_is_from_the_dead():
    found = SearchHistory(episode("ring"))
    taken = {
        one.other for activities in found.activities for one in activities if one.kind == "taken"
    }
    assert taken == {2}
    assert found.taken_over.any()
    assert (found.owners[0][found.taken_over] == 2).all()
    assert found.death(1) == 9.0
    takers = [robot for robot in range(4) if len(found.outline(robot))]
    around = np.concatenate([found.outline(robot) for robot in takers])
    assert np.allclose(
        np.abs(around[:, 1] - around[:, 0]).sum(axis=1), found.episode.plan.grid.size
    )


def test_outline_goes_round_the_cells():
    found = SearchHistory(episode("ring"))
    for robot in range(found.n_robots):
        mask = found.raster((found.first[1] == robot + 1) & found.taken_over, False)
        padded = np.pad(mask, 1)
        sides = sum(
            int((padded & ~np.roll(padded, step, axis)).sum())
            for axis in (0, 1)
            for step in (1, -1)
        )
        assert len(found.outline(robot)) == sides


@pytest.mark.parametrize(
    "name", sorted(CASES.keys() - {"as planned", "ring"})
)  # which other tests draw
def test_figures_are_drawn(name, tmp_path):
    told = episode(name)
    for make in (routes_figure, timeline_figure):
        figure = make(told)
        figure.set_dpi(60)
        save_figure(figure, tmp_path / "figure.png")
        assert len(np.unique(np.asarray(Image.open(tmp_path / "figure.png").convert("L")))) > 20


def texts(figure) -> list[str]:
    return [text.get_text() for axes in figure.axes for text in axes.texts]


def test_figure_numbers_every_robot_and_shows_the_dead_and_what_nobody_saw():
    figure = routes_figure(episode("all dead"))
    words = texts(figure)
    # starts and deaths
    assert sorted(word for word in words if word in "123") == ["1", "1", "2", "2", "3", "3"]
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "died" in legend
    assert f"not seen: {episode('all dead').coverage.uncovered_m2:.4g} m²" in legend
    whole = [
        text.get_text() for text in routes_figure(episode("as planned")).legends[0].get_texts()
    ]
    assert set(whole) <= {"start", "way to a cell farther off"}


@pytest.mark.parametrize("name", ["ring", "box"])
def test_heading_and_summary_of_a_figure_stand_apart(name):
    figure = routes_figure(
        search("box:60x36x30", robots=2, footprint=10) if name == "box" else episode(name)
    )
    summary = figure.axes[0]._left_title.get_window_extent()
    assert figure._suptitle.get_window_extent().y0 > summary.y1 + 5
    assert summary.y0 > figure.axes[0].get_window_extent().y1


def test_timeline_names_whose_part_and_when():
    figure = timeline_figure(episode("ring"))
    words = texts(figure)
    assert "2" in words
    assert any(f"{episode('ring').trace.covered_at:.4g}" in word for word in words)
    lines = [
        line.get_xdata()[0]
        for line in figure.axes[0].lines
        if len(set(line.get_xdata())) == 1 and len(line.get_xdata()) == 2
    ]
    assert max(episode("ring").trace.declared.values()) in lines
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == ["1", "2", "3", "4"]


def test_numbers_are_moved_apart():
    places = np.random.default_rng(2).normal(size=(30, 2))
    moved = spread_out(places, 10.0, 100 * np.array([(-1.0, -1.0), (1.0, 1.0)]))
    apart = np.hypot(*(moved[:, None] - moved[None]).transpose(2, 0, 1)) + 99 * np.eye(30)
    assert apart.min() > 9
    far = np.array([(0.0, 0.0), (50.0, 0.0)])
    np.testing.assert_allclose(spread_out(far, 10.0, np.array([(-1, -1), (60, 9)])), far, atol=0.01)
    kept = spread_out(far, 10.0, np.array([(10.0, 2.0), (40.0, 9.0)]))
    assert kept.min() >= 2.0  # a number at the edge is not cut
    np.testing.assert_allclose(kept[:, 0], [10.0, 40.0], atol=0.01)


@pytest.mark.parametrize("angle", [174.8, 90.0, -95.0, 180.0, 81.0])
def test_north_is_up_in_drawings_whatever_the_angle_of_the_rows(angle):
    region = region_of(shapely.box(0, 0, 70, 40), frame=LocalFrame(8.5, 47.4))
    found = SearchHistory(search(region, robots=2, footprint=10, angle=angle, seed=1))
    panels, tour, grid = found.panels, found.episode.plan.tour, found.episode.plan.grid
    assert found.north == 0
    places = np.array([(0.0, 0.0), (0.0, 1.0)])
    np.testing.assert_array_equal(panels.place(places, np.zeros(2, dtype=np.int64)), places)
    assert panels.alike == (angle % 90 == 0)
    rows, cols = np.nonzero(panels.numbers >= 0)
    left, _, _, top = panels.extent
    squares = np.stack(
        [left + (cols + 0.5) * panels.step, top - (rows + 0.5) * panels.step], axis=1
    )
    middles = grid.lattice.to_region(
        grid.lattice.centers(*tour.cells[panels.numbers[rows, cols]].T)
    )
    assert np.hypot(*(middles - squares).T).max() <= grid.size / 2**0.5 + 1e-9
    area = len(squares) * panels.step**2
    assert area == pytest.approx(grid.n_cells * grid.size**2, rel=0.03)
    assert panels.shape_of(region.area, 0).equals(region.area)


def test_obstacles_are_not_unseen_in_a_turned_drawing():
    figure = routes_figure(
        search("rectangle:60x40", robots=2, footprint=10, angle=180, obstacles=3, seed=1)
    )
    words = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "obstacle, found on the way" in words
    assert not any("not seen" in word for word in words)


def test_legend_tells_holes_from_no_go_zones():
    ring, zone = (
        shapely.Polygon(
            TWO.geoms[0].exterior.coords, [shapely.box(10, 10, 20, 20).exterior.coords]
        ),
        shapely.box(28, 5, 33, 9),
    )
    for region, names in (
        (region_of(ring), {"hole"}),
        (region_of(shapely.box(0, 0, 40, 30), no_go=zone), {"no-go zone"}),
        (region_of(ring, no_go=zone), {"hole or no-go zone"}),
        (region_of(shapely.box(0, 0, 40, 30), no_go=shapely.box(60, 5, 63, 9)), set()),  # outside
    ):
        figure = routes_figure(search(region, robots=2, footprint=10))
        words = {text.get_text() for text in figure.legends[0].get_texts()}
        assert {word for word in words if "hole" in word or "zone" in word} == names


def test_numbers_of_robots_stay_in_the_figure():
    figure = routes_figure(search("rectangle:80x20", robots=3, footprint=10, launch="80,10"))
    (axes,) = figure.axes
    for text in axes.texts:
        if text.get_text() in "123":
            box = text.get_window_extent()
            assert 0 < box.x0 < box.x1 < figure.bbox.width


def test_timeline_of_a_vehicle_is_in_minutes():
    told = search("square:60", robots=3, footprint=10, vehicle="multirotor")
    figure = timeline_figure(told)
    (axes,) = figure.axes
    assert axes.get_xlabel() == "time, in minutes"
    assert axes.get_xlim()[1] == pytest.approx(1.015 * told.clock(SearchHistory(told).end) / 60)
    assert any(duration_text(told.makespan) in word for word in texts(figure))
    assert timeline_figure(episode("ring")).axes[0].get_xlabel() == "time, in cells"


def test_expected_time_figure():
    figure = expected_time_figure(robots=(1, 5, 20), dead=3, trials=500)
    lines = {line.get_label(): np.array(line.get_data()) for line in figure.axes[0].lines}
    theory = next(data for label, data in lines.items() if label.startswith("all live"))
    np.testing.assert_allclose(theory[1, [0, 19]], [100, 17.9887], atol=1e-3)
    with pytest.raises(InvalidInputError, match="expected at least one number of robots"):
        expected_time_figure(robots=())
    assert len(expected_time_figure(robots=(1,), dead=0, trials=10).axes[0].lines) >= 2


def test_rings_of_parts_with_holes():
    area = TWO.difference(shapely.box(10, 10, 20, 20))
    assert [[len(ring) for ring in part] for part in rings_of(area)] == [[5, 5], [5]]
    assert rings_of(shapely.GeometryCollection()) == []


def test_film_shows_what_is_searched():
    told = episode("ring")
    film = SearchFilm(told, height=240)
    times = film.times(10, 100)
    assert len(times) <= 100
    assert (times[0], times[-1]) == (0.0, SearchHistory(told).end)
    frames = list(film.frames(np.array([0.0, told.trace.covered_at / 2, SearchHistory(told).end])))
    assert {frame.shape for frame in frames} == {(240, film.width, 3)}
    middle = slice(24, 200)
    coloured = [int((np.ptp(frame[middle].astype(int), axis=2) > 10).sum()) for frame in frames]
    assert coloured[0] < 0.7 * coloured[1] < 0.7 * coloured[2]
    again = list(film.frames(np.array([told.trace.covered_at / 2, 0.0])))  # backwards
    np.testing.assert_array_equal(again[0], frames[1])
    np.testing.assert_array_equal(again[1], frames[0])


@pytest.mark.parametrize("name", ["one robot, one cell", "all dead", "two parts"])
def test_gif(name, tmp_path, monkeypatch):
    monkeypatch.setattr("shoal.views.search.films._SHORTEST", 0.6)
    monkeypatch.setattr("shoal.views.search.films.SECONDS", 0.6)
    told: list[tuple[int, int]] = []
    film(
        episode(name),
        tmp_path / "film.gif",
        on_frame=lambda done, total: told.append((done, total)),
    )
    with Image.open(tmp_path / "film.gif") as picture:
        assert picture.n_frames > 1
    assert told == [(k + 1, len(told)) for k in range(len(told))]


def test_mp4_and_html(tmp_path, monkeypatch):
    monkeypatch.setattr("shoal.views.search.films._SHORTEST", 0.4)
    monkeypatch.setattr("shoal.views.search.films.SECONDS", 0.4)
    film(episode("ring"), tmp_path / "film.mp4")
    assert (tmp_path / "film.mp4").read_bytes()[4:8] == b"ftyp"
    film(episode("ring"), tmp_path / "film.html")
    assert "<!doctype html>" in (tmp_path / "film.html").read_text(encoding="utf-8")
    with pytest.raises(InvalidInputError, match="expected a film"):
        film(episode("ring"), tmp_path / "film.txt")
    assert len(list(tmp_path.iterdir())) == 2


def test_too_many_visits_for_a_page(monkeypatch):
    monkeypatch.setattr("shoal.views.search.page.LARGEST", 10)
    with pytest.raises(InvalidInputError, match="at most 10 visits of cells, got"):
        page_data(episode("ring"))


def test_findings_appear_when_they_were_found():
    """The first robot that passes may miss what is there: the page once showed it when that one
    came by.
    """
    told = search(
        "square:60", robots=3, footprint=10, targets=4, detection=0.5, multiplicity=3, seed=5
    )
    data = page_data(told)
    late = 0
    for (_, _, moment, _), finding in zip(data["findings"], told.findings, strict=True):
        logs = [told.trace.robots[robot - 1] for robot in finding.found_by]
        assert moment == min(float(log.times[log.cells == finding.cell].min()) for log in logs)
        first = min(float(log.times[log.cells == finding.cell].min()) for log in told.trace.robots)
        late += moment > first
    assert late > 0
    assert data["north"] is None


def test_a_map_has_a_scale_bar_and_all_its_signs(tmp_path):
    field = tmp_path / "field.json"
    ring = [[8.5, 47.4], [8.504, 47.4], [8.504, 47.402], [8.5, 47.402], [8.5, 47.4]]
    field.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    told = search(
        str(field),
        robots=2,
        footprint=40,
        no_go=[[(8.502, 47.4008), (8.503, 47.4008), (8.503, 47.4013)]],
        seed=1,
    )
    drawn = routes_figure(told)
    texts = [text.get_text() for text in drawn.axes[0].texts]
    assert any(getattr(text, "arrow_patch", None) is not None for text in drawn.axes[0].texts)
    assert {"N    20 m", "N    50 m"} & set(texts)  # by the angle of the rows
    signs = {text.get_text() for text in drawn.legends[0].get_texts()}
    assert {"start", "no-go zone"} <= signs
    assert "way to a cell farther off" in {
        text.get_text() for text in routes_figure(episode("as planned")).legends[0].get_texts()
    }


def test_the_north_arrow_has_the_true_angle_and_axes_their_names():
    region = region_of(shapely.box(0, 0, 70, 40), frame=LocalFrame(8.5, 47.4))
    figure = routes_figure(search(region, robots=2, footprint=10, angle=176.9, seed=1))
    axes = figure.axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("metres", "")
    (arrow,) = [text for text in axes.texts if getattr(text, "arrow_patch", None) is not None]
    figure.draw_without_rendering()
    tail, tip = arrow.arrow_patch.get_path().vertices[[0, -1]]
    way = np.subtract(arrow.xy, arrow.get_position())
    assert np.degrees(np.arctan2(way[0], way[1])) == pytest.approx(0.0, abs=0.01)
    assert not np.allclose(tail, tip)


@pytest.mark.parametrize("drawing", [routes_figure, timeline_figure])
def test_titles_begin_at_the_left_edge_of_the_axes(drawing):
    figure = drawing(search("ring:60x40", robots=3, footprint=10, seed=1))
    figure.draw_without_rendering()
    (title,) = [text for text in figure.texts if text.get_fontweight() == "bold"]
    assert title.get_window_extent().x0 == pytest.approx(
        figure.axes[0].get_window_extent().x0, abs=2.5
    )


def test_labels_stand_nearer_to_their_own_place_than_to_any_other():
    for places in (
        np.array([(0.0, 0), (7, 0), (14, 0)]),
        np.array([(0.0, 0), (0, 7), (0, 14)]),
        np.array([(3.0, 4.0)]),
    ):
        labels = places + np.array(label_offsets(places))
        apart = np.hypot(*np.moveaxis(labels[:, None] - places, -1, 0))
        assert (apart.argmin(axis=1) == np.arange(len(places))).all()
        between = np.hypot(*np.moveaxis(labels[:, None] - labels, -1, 0)) + 99 * np.eye(len(places))
        assert between.min() > 8


def test_heat_cools_where_robots_look():
    ring = {"prior": ["ring:20,60:0.5=15,0.9=30"], "detection": 0.7, "at_most": 1.0}
    episode = run(SearchProblem("square:80", robots=2, **ring), seed=1)
    history, odds = SearchHistory(episode), episode.plan.tour_cost.odds
    first, middle = history.first[0], history.end / 3
    np.testing.assert_allclose(history.probabilities(-np.inf), odds)
    left = np.where(first <= middle, 0.3, 1.0)
    np.testing.assert_allclose(history.probabilities(middle), odds * left)
    assert history.success_at(middle) == pytest.approx(0.7 * odds[first <= middle].sum())
    assert history.success_at(history.end) == pytest.approx(episode.success.probability)
    warm, cold = cell_colours(history, -1.0), cell_colours(history, middle)
    hottest = int(np.argmax(odds))
    assert warm[hottest].sum() < 3 - 0.3
    assert np.abs(warm - cold)[first > middle].max() == 0
    ground, _, scale = figure(episode, kind="success").axes
    assert scale.get_ylabel() == "probability of a cell"
    (shown,) = ground.images
    assert shown.colorbar.ax is scale
    assert shown.get_clim() == (0, history.strongest)
    assert np.nanmax(shown.get_array()) == odds.max()
    data = page_data(episode)
    heat = np.frombuffer(b64decode(data["heat"]), dtype=np.uint8)
    assert heat.max() == 255
    plain = page_data(run(SearchProblem("square:80", robots=2), seed=1))
    assert plain["heat"] is None


@cache
def flown_prior(**fields):
    """A search with a prior that vehicles fly, in which a look counts when a flight passes."""
    ring = {"prior": ["ring:20,60:0.5=15,0.9=30"], "detection": 0.7, "vehicle": "multirotor"}
    return run(SearchProblem("square:80", robots=2, footprint=10, **ring, **fields), seed=1)


def test_views_of_flown_searches_have_the_times_of_the_episode():
    episode = flown_prior()
    history = SearchHistory(episode)
    known = float(episode.clock(max(episode.trace.declared.values())))
    assert float(episode.clock(history.end)) == pytest.approx(max(known, episode.makespan))
    for robot, log in enumerate(history.logs):
        np.testing.assert_allclose(episode.clock(log.times), episode.sightings[robot].times)
        assert (np.diff(history.trajectories[robot].times) >= 0).all()
    np.testing.assert_allclose(episode.clock(history.first[0]), episode.visits.times)
    success = episode.success
    for time in np.linspace(0.0, history.end, 9):
        told = success.probabilities[success.times <= float(episode.clock(time)) + 1e-9]
        assert history.success_at(time + 1e-9) == pytest.approx(told[-1] if len(told) else 0.0)
    times, found = (np.frombuffer(b64decode(one), "<f4") for one in page_data(episode)["success"])
    np.testing.assert_allclose(episode.clock(times), success.times, rtol=1e-5, atol=1e-3)
    np.testing.assert_allclose(found, success.probabilities, rtol=1e-5)


@pytest.mark.parametrize("fields", [{"at_most": 1.0}, {"at_most": 1.4}, {"passes": 2}])
def test_players_cool_like_films(fields):
    history = SearchHistory(flown_prior(**fields))
    data = page_data(history.episode)
    heat = np.frombuffer(b64decode(data["heat"]), np.uint8).copy()
    times, squares, cooled = (
        np.frombuffer(b64decode(one), kind)
        for one, kind in zip(data["cooled"], ("<f4", "<u4", "u1"), strict=True)
    )
    assert (np.diff(times) >= 0).all()
    done = 0
    for moment in np.unique(times)[:: max(1, len(np.unique(times)) // 20)]:
        time = float(moment) * (1 + 1e-6) + 1e-9
        until = int(np.searchsorted(times, time, "right"))
        heat[squares[done:until]] = cooled[done:until]
        done = until
        expected = 255 * history.raster(history.heat(time), 0.0).ravel()
        assert np.abs(heat - expected).max() <= 0.5 + 1e-3


def test_second_looks_cool_the_ground_again():
    ring = {"prior": ["ring:20,60:0.5=15,0.9=30"], "detection": 0.7, "at_most": 1.4}
    episode = run(SearchProblem("square:80", robots=2, **ring), seed=1)
    history, ground = SearchHistory(episode), episode.plan.ground
    looks = (ground.cells >= 0).sum(axis=1)
    again = looks > 1
    assert again.any()
    before, after = history.probabilities(-np.inf), history.probabilities(history.end)
    cells = ground.cells[again, 0]
    np.testing.assert_allclose(after[cells], 0.3 ** looks[again] * before[cells])
    np.testing.assert_allclose(before[ground.cells[again, 1]], before[cells])
    labels = [words for words, *_ in history.panels.labels]
    assert labels == ["first look", "look 2 where it pays", "look 3 where it pays"]
    assert history.success_at(history.end) == pytest.approx(episode.success.probability)
    assert episode.success.probability == pytest.approx(1 - after[ground.cells[:, 0]].sum())


def test_heat_follows_a_target_that_moves():
    drift = {"prior": ["ring:20,40:0.9=10"], "drift": (0.3, 0.0, 0.0)}
    episode = run(SearchProblem("square:80", robots=2, **drift), seed=1)
    history = SearchHistory(episode)
    across = episode.plan.positions(np.arange(history.n_cells))[:, 0]
    start, late = history.probabilities(-np.inf), history.probabilities(history.end / 8)
    assert across @ late / late.sum() > across @ start / start.sum() + 5
    assert history.success_at(history.end) == pytest.approx(episode.success.probability, abs=0.02)
    assert np.isfinite(cell_colours(history)).all()
    assert page_data(episode)["heat"] is None
    assert len(page_data(episode)["success"][0]) > 0
