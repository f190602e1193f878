"""shoal steer and shoal reach: statuses, fields, formats, noise, friction, figures."""

from __future__ import annotations

import json
from dataclasses import replace
from math import atan, inf, sin

import numpy as np
import pytest
from tests.soak import often
from tests.steering import steer

from shoal import load_problem
from shoal.cli import run
from shoal.core.episode import Status
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.steering import (
    ContactWorld,
    SteeringEpisode,
    SteeringProblem,
    cylinder,
    disk,
    disk_reach,
    open_workspace,
    polygon,
    polygon_reach,
    prism,
    regular_polygon,
)
from shoal.steering.contact.friction import friction_limit
from shoal.steering.contact.world import stop_at_others
from shoal.steering.planners.chain_search import antipodal_chain
from shoal.steering.planners.chains import ChainQuery
from shoal.steering.workspaces.walls import normalize_walls
from shoal.views.steering.figures import plan_figure, reach_figure

SQUARE = polygon([(0, 0), (1, 0), (1, 1), (0, 1)])
FORM = {"type": "polygon", "vertices": [[0, 0], [1, 0], [1, 1], [0, 1]]}
FIELDS = [
    "status",
    "planner",
    "moves",
    "inputs",
    "length",
    "final",
    "error",
    "lower_bound",
    "seconds",
]
PROBLEM = {"workspace": FORM, "start": [[0.2, 0.3], [0.5, 0.35]], "goal": [[0.8, 0.2], [0.3, 0.75]]}


def written(folder, **changes):
    path = folder / "problem.json"
    path.write_text(json.dumps(PROBLEM | changes))
    return path


@pytest.mark.parametrize("planner", ["greedy", "shortest", "fewest-moves", "robust"])
def test_json_of_steer(planner, tmp_path, capsys):
    assert run(["steer", str(written(tmp_path)), "--planner", planner, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert set(FIELDS) <= set(result)
    assert result["status"] == "solved"
    assert result["planner"] == planner
    assert result["moves"] == len(result["inputs"])
    assert result["length"] == pytest.approx(sum(np.hypot(*move) for move in result["inputs"]))
    assert result["length"] >= result["lower_bound"]
    end = ContactWorld(SQUARE).play(PROBLEM["start"], result["inputs"])[-1]
    np.testing.assert_allclose(end, result["final"], atol=1e-12)
    assert np.hypot(*(end - PROBLEM["goal"]).T).max() == pytest.approx(result["error"], abs=1e-12)
    assert result["error"] <= 1e-6


def test_steer_writes_and_prints(tmp_path, capsys):
    out = tmp_path / "plan"
    assert run(["steer", str(written(tmp_path)), "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {"plan.png", "episode.json", "summary.json"}
    assert "lower bound" in capsys.readouterr().out
    episode = SteeringEpisode.load(out / "episode.json")
    assert episode.verify()
    assert episode.report() == json.loads((out / "summary.json").read_text())
    assert not replace(episode, states=episode.states + 0.01).verify()
    assert not replace(episode, status="limit").verify()
    assert not replace(episode, inputs=episode.inputs * 1.01).verify()
    above = replace(episode, lower_bound=1.01 * episode.length).verify()
    assert not above
    assert "the lower bound is" in str(above)


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        (
            {"start": [[0.1, 0.2], [0.1, 0.2]]},
            "start: expected particles at different points, got (0.1, 0.2) for particles 1 and 2",
        ),
        (
            {"start": [[0.1, 0.2], [1.1, 0.2]]},
            "start: expected points inside the polygon, got (1.1, 0.2) at point 2",
        ),
        (
            {"goal": [[0.1, -0.2], [0.1, 0.2]]},
            "goal: expected points inside the polygon, got (0.1, -0.2) at point 1",
        ),
        (
            {"start": [[0.1, float("nan")], [0.1, 0.2]]},
            "start: expected finite numbers, got (0.1, nan) at point 1",
        ),
        ({"start": [[0.1, 0.2]]}, "start"),
        ({"goal": [[0.1, 0.2], [0.3, 0.4], [0.5, 0.6]]}, "goal: expected 2 points of 2 numbers"),
        ({"tolerance": 0}, "tolerance: expected a number of at least 1e-08"),
        (
            {"workspace": {"type": "polygon", "vertices": [[0, 0], [1, 0], [2, 0]]}},
            "got a flat one",
        ),
        (
            {"workspace": {"type": "polygon", "vertices": [[0, 0], [1, 1], [0, 1], [1, 0]]}},
            "does not cross itself",
        ),
        (
            {"workspace": {"type": "polygon", "vertices": [[0, 0], [2, 0], [1, 0.2], [1, 2]]}},
            "bends inward at vertex 3",
        ),
        ({"workspace": {"type": "disk", "radius": -1}}, "radius: expected a number, above 0"),
        (
            {"workspace": {"type": "torus"}},
            "workspace: type: expected one of polygon, regular, disk, prism, cylinder",
        ),
        (
            {"workspace": {"type": "region", "vertices": [[0, 0], [1, 0], [1, 1]]}},
            (
                "workspace: expected the fields of a region, which are outline, obstacles"
                " (optional), got 'vertices'"
            ),
        ),
        ({"workspace": "octogon"}, "unknown workspace 'octogon'"),
        ({"extra": 1}, "extra: expected no such field, got 1"),
    ],
)
def test_bad_problems_get_one_sentence(changes, wanted, tmp_path, capsys):
    assert run(["steer", str(written(tmp_path, **changes)), "--json"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert wanted in printed.err
    assert printed.err.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "wanted"),
    [
        (["--execution", "wide"], "--execution: expected a number"),
        (["--gain", "3"], "gain: expected a number, 0 or more and below 2, got 3"),
        (["--planner", "quickest"], "unknown planner 'quickest'"),
        (["--friction", "-1"], "friction: expected a number, 0 or more"),
        (["--particle-radius", "0.6"], "particle radius: expected a distance that leaves room"),
        (["--particle-radius", "0.1", "--friction", "1"], "particle radius: expected no friction"),
        (["--max-moves", "0"], "max_moves: expected a whole number, 1 or more"),
    ],
)
def test_bad_options_of_steer(options, wanted, tmp_path, capsys):
    assert run(["steer", str(written(tmp_path)), *options]) == 2
    assert wanted in capsys.readouterr().err


def test_files_that_are_none(tmp_path, capsys):
    assert run(["steer", str(tmp_path / "none.json")]) == 2
    (tmp_path / "cut.json").write_text('{"workspace": ')
    assert run(["steer", str(tmp_path / "cut.json")]) == 2
    assert "line 1, column 15" in capsys.readouterr().err
    with pytest.raises(InvalidInputError, match="expected a steering episode"):
        SteeringEpisode.load(written(tmp_path))


def test_approachable_and_unreachable(tmp_path, capsys):
    # What ends within the tolerance is solved, and the reason says what cannot be had.
    wide = ["--tolerance", "1e-5"]
    assert run(["steer", str(written(tmp_path, goal=[[0.3, 0], [0.6, 1]])), "--json", *wide]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["status"] == "solved"
    assert result["error"] <= 1e-5
    assert "can only be approached" in result["reason"]
    assert (
        run(
            [
                "steer",
                str(written(tmp_path, goal=[[0.3, 0], [0.6, 1]])),
                "--max-moves",
                "1",
                "--json",
            ]
        )
        == 1
    )
    printed = capsys.readouterr()
    assert json.loads(printed.out)["status"] == "approachable"
    assert "opposite parallel walls" in printed.err
    antipodes = SteeringProblem(disk(0.5), [(0.1, 0), (0.2, 0.1)], [(0.5, 0), (-0.5, 0)])
    for planner in ("greedy", "shortest"):
        episode = steer(antipodes, planner=planner)
        assert episode.status == "solved"
        assert episode.error <= 1e-6
        assert episode.verify()
        near = steer(antipodes, planner=planner, max_moves=4)
        assert near.status == "approachable"
        assert not near
        assert "opposite each other" in near.reason
    tube = cylinder(0.5, 1.0, open_ends=True)
    episode = steer(
        SteeringProblem(
            tube, [(0.1, 0.2, 0.3), (0.1, 0.2, 0.6)], [(0.3, 0.3, 0.3), (0.1, 0.1, 0.7)]
        )
    )
    assert (episode.status, episode.moves) == ("unreachable", 0)
    assert "open tube" in episode.reason
    short = steer(SteeringProblem.from_dict(PROBLEM), max_moves=2)
    assert short.status == "limit"
    assert "moves" in short.reason


@pytest.mark.parametrize(
    "space", [prism(SQUARE, 1.0), cylinder(0.5, 1.0)], ids=["prism", "cylinder"]
)
@pytest.mark.parametrize(
    ("start", "goal"),
    [
        # above each other: by an end cap
        ([(0.1, 0.2, 0.3), (0.1, 0.2, 0.6)], [(0.3, 0.3, 0.3), (0.1, 0.1, 0.7)]),
        # goals above each other
        ([(0.1, 0.2, 0.3), (0.3, 0.1, 0.6)], [(0.3, 0.3, 0.3), (0.3, 0.3, 0.7)]),
        # the heights alone
        ([(0.1, 0.2, 0.3), (0.3, 0.1, 0.6)], [(0.2, 0.2, 0.8), (0.4, 0.1, 0.2)]),
        # no height fits one contact
        ([(0.1, 0.2, 0.05), (0.3, 0.1, 0.9)], [(0.2, 0.2, 0.9), (0.1, 0.3, 0.1)]),
        # on both end caps
        ([(0.1, 0.2, 0.0), (0.3, 0.1, 1.0)], [(0.2, 0.2, 0.9), (0.1, 0.3, 0.1)]),
    ],
)
@pytest.mark.parametrize("planner", ["greedy", "shortest", "fewest-moves"])
def test_degenerate_cases_in_space(space, start, goal, planner):
    episode = steer(SteeringProblem(space, start, goal), planner=planner)
    assert episode.status == "solved", episode.reason
    assert episode.verify()


@pytest.mark.parametrize(
    ("start", "goal"),
    [
        ([(0, 0.3), (1, 0.4)], [(0.5, 0.5), (0.7, 0.2)]),
        ([(0.2, 0), (0.7, 0)], [(0.7, 0), (0.2, 0)]),
        # a translation that starts on a wall needs a lift
        ([(0.2, 0), (0.3, 0.4)], [(0.6, 0), (0.7, 0.4)]),
        ([(0.3, 0.3), (0.7, 0.4)], [(0, 0), (1, 0)]),
        ([(0.2, 0.2), (0.6, 0.7)], [(0.4, 0.4), (0.4, 0.4)]),
        ([(0.2, 0), (0.3, 0.4)], [(0.2, 0), (0.3, 0.4)]),
    ],
)
@pytest.mark.parametrize("planner", ["greedy", "shortest", "fewest-moves"])
def test_degenerate_cases_in_the_square(start, goal, planner):
    episode = steer(SteeringProblem(SQUARE, start, goal), planner=planner)
    assert episode.status == "solved", episode.reason
    assert episode.verify()


@pytest.mark.parametrize(
    ("start", "goal", "fields"),
    [
        ([(0, 0), (1, 1)], [(1, 1), (0, 0)], {"tolerance": 1e-4}),  # no move lifts both
        ([(0.2, 0.2), (0.2 + 1e-6, 0.2)], [(0.9, 0.9), (0.1, 0.2)], {"clearance": 1e-8}),
    ],
)
@pytest.mark.parametrize("planner", ["shortest", "fewest-moves"])
def test_where_the_clearance_has_no_room_a_plan_is_sensitive(start, goal, fields, planner):
    narrow = steer(SteeringProblem(SQUARE, start, goal), planner=planner, time=0.2)
    assert (narrow.status, bool(narrow), narrow.sensitive) == ("sensitive", False, True)
    assert narrow.error <= 1e-6
    assert "only in exact arithmetic: with " in narrow.reason
    assert narrow.verify()
    assert not replace(narrow, status=Status.SOLVED).verify()
    wide = steer(SteeringProblem(SQUARE, start, goal), planner=planner, **fields)
    assert (wide.status, wide.sensitive) == ("solved", False), wide.reason
    assert wide.verify()


def test_interchangeable_particles_take_the_better_way():
    start, goal = [(0.2, 0.2), (0.7, 0.6)], [(0.8, 0.7), (0.25, 0.3)]
    fixed, free = (
        steer(SteeringProblem(SQUARE, start, goal, interchangeable=both)) for both in (False, True)
    )
    assert free.length < 0.5 * fixed.length
    assert free.order.tolist() == [1, 0]
    assert free.error <= 1e-6


def test_robust_survives_noise():
    rng = np.random.default_rng(7)
    noise = {"execution": 1e-3, "measurement": 1e-3, "gain": 0.2}
    solved = {"robust": 0, "shortest": 0}
    for seed in range(10):
        points = rng.random((4, 2))
        problem = SteeringProblem(SQUARE, points[:2], points[2:], 0.01)
        for planner in solved:
            episode = steer(problem, planner=planner, **noise, seed=seed, max_moves=40)
            solved[planner] += episode.status == "solved"
            assert episode.verify()
            assert SQUARE.contains(episode.states.reshape(-1, 2)).all()
    assert solved["robust"] >= 9
    assert solved["shortest"] <= 4


def test_no_ladder_leads_to_goals_so_far_apart_that_each_push_undoes_a_rung():
    walls = normalize_walls(disk(0.5))
    start, goal = np.array([(-0.1, 0.0), (0.1, 0.0)]), np.array([(-0.48, 0.0), (0.48, 0.0)])
    assert antipodal_chain(ChainQuery(walls, start, goal), cycles=20) is not None
    assert antipodal_chain(ChainQuery(walls, start, goal, push=0.05), cycles=20) is None


def test_robust_sends_no_more_moves_than_it_may():
    """A lift before a translation is a move, too."""
    noise = {"execution": 1e-3, "measurement": 1e-3, "gain": 0.2}
    problem = SteeringProblem(SQUARE, [(0.2, 0.2), (0.7, 0.4)], [(0.3, 0.8), (0.5, 0.1)], 0.01)
    longest = steer(problem, planner="robust", **noise).moves
    assert [
        steer(problem, planner="robust", **noise, max_moves=k).moves for k in range(1, longest)
    ] == [*range(1, longest)]


def test_friction_slides_and_limits():
    world = ContactWorld(SQUARE, friction=0.5)
    # by |T u| - friction |N u|
    np.testing.assert_allclose(world.step([(0, 0.5)], (-0.2, 0.3)), [[0, 0.7]])
    # inside of the cone
    np.testing.assert_allclose(world.step([(0, 0.5)], (-0.2, 0.1)), [[0, 0.5]])
    # slides on after the contact
    np.testing.assert_allclose(world.step([(0.1, 0.2)], (-0.2, 0.2)), [[0, 0.35]])
    # into the corner, and stays
    np.testing.assert_allclose(world.step([(0, 0.9)], (-0.1, 0.5)), [[0, 1]])
    ring = ContactWorld(disk(1.0), friction=0.5)
    moved = ring.step([(1.0, 0.0)], (0.01, 2.0))[0]
    assert np.hypot(*moved) == pytest.approx(1)
    # The angle between push and normal shrinks to arctan(0.5) as tan((a - atan 0.5) / 2) by
    # exp(-|u| sqrt(1 + 0.25) / r).
    push = np.arctan2(2.0, 0.01)
    slowed = np.tan((push - atan(0.5)) / 2) * np.exp(-np.hypot(0.01, 2.0) * np.sqrt(1.25))
    assert push - np.arctan2(moved[1], moved[0]) == pytest.approx(
        atan(0.5) + 2 * atan(slowed), abs=2e-3
    )
    far = 2 * 0.5 * sin(atan(0.5))
    assert friction_limit(disk(0.5), 0.5, np.array([0.1, 0]), np.array([far + 0.01, 0])) is not None
    assert friction_limit(disk(0.5), 0.5, np.array([0.1, 0]), np.array([far - 0.01, 0])) is None
    assert friction_limit(SQUARE, 1.0, np.array([0.3, 0.3]), np.array([0.35, 0.3])) is not None
    assert friction_limit(SQUARE, 1.5, np.array([0.3, 0.3]), np.array([0.35, 0.3])) is None
    assert (
        friction_limit(regular_polygon(6), 0.5, np.array([0.3, 0.0]), np.array([0.4, 0.0]))
        is not None
    )
    problem = SteeringProblem(SQUARE, [(0.3, 0.3), (0.4, 0.35)], [(0.1, 0.1), (0.8, 0.9)])
    assert steer(problem, friction=1.0).status == "unreachable"
    assert steer(problem, friction=2.0).status == "solved"


def test_no_way_of_moving_beats_the_gauges():
    rng = np.random.default_rng(8)
    for space, friction in ((SQUARE, 0.8), (regular_polygon(6), 0.5), (disk(0.5), 0.4)):
        world = ContactWorld(space, friction=friction)
        for _ in range(often(6, 20)):
            points = np.array([space.center + 0.2 * rng.normal(size=2) for _ in range(2)])
            if not space.contains(points).all():
                continue
            first = points[1] - points[0]
            for _ in range(30):
                points = world.step(points, rng.normal(size=2) * 0.5)
                delta = (points[1] - points[0]) * (1 - 1e-6)
                assert friction_limit(space, friction, first, delta) is None


def test_gain_and_spheres():
    world = ContactWorld(SQUARE, gradient=(0.2, 0))
    before = np.array([(0.2, 0.5), (0.6, 0.5)])
    after = world.step(before, (0.1, 0))
    assert (after[1] - after[0])[0] > 0.4  # the one to the right goes faster
    np.testing.assert_allclose(world.step(after, (-0.1, 0)), before, atol=1e-12)
    spheres = ContactWorld(SQUARE, radius=0.1)
    np.testing.assert_allclose(
        spheres.step([(0.2, 0.5), (0.5, 0.5)], (-0.5, 0)), [[0.1, 0.5], [0.3, 0.5]]
    )
    np.testing.assert_allclose(
        spheres.step([(0.1, 0.5), (0.3, 0.5)], (-0.5, 0)), [[0.1, 0.5], [0.3, 0.5]]
    )
    # they meet at an angle, and stay
    slanted = spheres.step([(0.1, 0.5), (0.31, 0.5)], (-0.2, 0.1))
    assert np.linalg.norm(slanted[1] - slanted[0]) == pytest.approx(0.2)
    assert slanted[0].tolist() == [0.1, 0.5]
    # and both lift off
    np.testing.assert_allclose(spheres.step(slanted, (0.1, 0.1)), slanted + 0.1)
    with pytest.raises(InvalidInputError, match="do not overlap"):
        spheres.initial([(0.3, 0.5), (0.4, 0.5)])
    still = np.array([[0.5, 0.5], [0.7, 0.5]])
    stop_at_others(still, np.zeros(2), np.array([0.0, 1.0]), 0.2, still)  # no move at all
    assert still.tolist() == [[0.5, 0.5], [0.7, 0.5]]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("space.json", json.dumps(FORM)),
        ("problem.json", json.dumps(PROBLEM)),
        (
            "space.geojson",
            json.dumps(
                {
                    "type": "Feature",
                    "properties": {},
                    "geometry": {
                        "type": "Polygon",
                        "coordinates": [[[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]]],
                    },
                }
            ),
        ),
        ("space.wkt", "POLYGON ((0 0, 0 1, 1 1, 1 0, 0 0))"),
        (
            "space.svg",
            (
                '<svg xmlns="http://www.w3.org/2000/svg"><rect x="0" y="-1" width="1"'
                ' height="1"/></svg>'
            ),
        ),
        ("path.svg", '<svg xmlns="http://www.w3.org/2000/svg"><path d="M0 0 H1 V-1 H0 Z"/></svg>'),
    ],
)
def test_formats(name, text, tmp_path):
    path = tmp_path / name
    path.write_text(text)
    problem = tmp_path / "task.json"  # a problem file may give its workspace relative to itself
    problem.write_text(json.dumps(PROBLEM | {"kind": "steering", "workspace": name}))
    for space in (open_workspace(path), load_problem(problem).place):
        assert sorted(map(tuple, space.vertices.round(12).tolist())) == [
            (0, 0),
            (0, 1),
            (1, 0),
            (1, 1),
        ]


def test_more_workspaces(tmp_path):
    circle = tmp_path / "circle.svg"
    circle.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg"><circle cx="2" cy="-3" r="0.5"/></svg>'
    )
    assert open_workspace(circle).center.tolist() == [2, 3]
    bean = open_workspace({"type": "svg", "text": "M 0 0 C 0 1 1 1 1 0 Z"})
    assert len(bean.vertices) > 20
    for name, sides in (("triangle", 3), ("regular:11", 11), ("hexagon", 6), ("square", 4)):
        assert len(open_workspace(name).vertices) == sides
    assert open_workspace("disk:2").radius == 2
    ring = open_workspace("POLYGON ((0 0, 4 0, 4 4, 0 4, 0 0), (1 1, 2 1, 2 2, 1 2, 1 1))")
    assert len(ring.obstacles) == 1
    tall = open_workspace({"type": "prism", "base": {"type": "regular", "sides": 5}, "height": 2})
    assert (tall.kind, tall.height) == ("prism", 2)


@pytest.mark.parametrize(
    "source",
    [
        "disk:wide",
        "regular:2",
        "POLYGON ((0 0, 1 0))",
        "POLYGON EMPTY",
        {"type": "svg", "text": "M x"},
        {"type": "wkt", "text": "POINT (1 2)"},
        {"type": "Polygon", "coordinates": [[["a", 0]]]},
        {"type": "FeatureCollection", "features": []},
        {"type": "region", "outline": [[0, 0], [1, 1], [0, 1], [1, 0]]},
    ],
)
def test_workspaces_that_are_refused(source):
    with pytest.raises(ShoalError) as caught:
        open_workspace(source)
    assert "\n" not in str(caught.value)


def test_reach(tmp_path, capsys):
    assert (
        run(
            [
                "reach",
                "square",
                "--start",
                "0.4,0.5 0.6,0.6",
                "--moves",
                "6",
                "--json",
                "--out",
                str(tmp_path / "r"),
            ]
        )
        == 0
    )
    result = json.loads(capsys.readouterr().out)
    assert result["moves"] == [2, 4, 6]
    assert result["fractions"] == sorted(result["fractions"])
    assert result["fractions"][2] == pytest.approx(1, abs=1e-3)
    assert (tmp_path / "r" / "reach.png").exists()
    assert run(["reach", "disk", "--start", "0 0 0.1 0", "--moves", "4", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["fractions"] == pytest.approx(
        [0.0634, 0.301], abs=0.004
    )
    for words, wanted in (
        (["disk", "--start", "0 0 0.1"], "start: expected points, as in '0.1,0.2 0.3,0.4'"),
        (["disk", "--start", "0 0 0.9 0"], "start: expected points inside the disk"),
        (["square", "--start", "0 0 0.9 0", "--moves", "3"], "moves: expected an even number"),
        (["nowhere", "--start", "0 0 0.9 0"], "unknown workspace"),
    ):
        assert run(["reach", *words]) == 2
        assert wanted in capsys.readouterr().err


def test_k_move_sets_of_polygons_are_exact_enough():
    rng = np.random.default_rng(9)
    space = regular_polygon(5)
    sets = polygon_reach(space, (0.2, 0.1), moves=4)
    points = np.array(
        [point for point in rng.random((60, 2)) * 2 - 1 if space.differences.contains(point)]
    )
    exact = np.array([sets[1].reaches(point) for point in points])
    sampled = sets[1].contains(points)
    assert not (sampled & ~exact).any()
    assert (exact & ~sampled).sum() <= 1
    from shapely import Polygon

    area = Polygon(sets[1].outline).area
    assert area / Polygon(space.differences.vertices).area == pytest.approx(sets[1].fraction())


def test_the_square_misses_a_corner_after_four_moves():
    """Spec, section 3: R_4 misses a corner of area |Δx Δy|."""
    sets = polygon_reach(SQUARE, (0.3, 0.2), moves=6)
    assert 4 * (1 - sets[1].fraction()) == pytest.approx(0.3 * 0.2, rel=0.05)
    assert sets[2].fraction() == pytest.approx(1, abs=1e-6)


def test_figures():
    problem = SteeringProblem(SQUARE, PROBLEM["start"], PROBLEM["goal"])
    assert len(plan_figure(steer(problem)).axes) == 2
    tall = SteeringProblem(
        prism(SQUARE, 1.0), [(0.1, 0.2, 0.3), (0.3, 0.1, 0.6)], [(0.3, 0.3, 0.3), (0.3, 0.3, 0.7)]
    )
    assert len(plan_figure(steer(tall)).axes) == 2
    sets = polygon_reach(SQUARE, (0.3, 0.2), moves=4)
    assert len(reach_figure(sets, points=[(0.1, 0.1), (0.4, 0.3)]).axes) == 2
    assert len(reach_figure(disk_reach(0.2, moves=4)).axes) == 1
    with pytest.raises(InvalidInputError, match="at least one set"):
        reach_figure([])


def test_disturbances_are_checked():
    for bad in (
        {"execution": -1},
        {"measurement": inf},
        {"gain": 2},
        {"particle_radius": float("nan")},
    ):
        with pytest.raises(InvalidInputError):
            SteeringProblem("square", **bad)


def test_robust_reaches_corners_in_a_world_without_noise_and_says_what_noise_it_stands():
    """14 of 60 such goals, before."""
    for start, goal in (
        ([(0.8, 0.3), (0.6, 0.9)], [(1, 1), (0, 0)]),
        ([(0.5, 0.3), (0.2, 0.2)], [(1, 0), (0, 0)]),
    )[: often(1, 2)]:
        episode = steer(SteeringProblem(SQUARE, start, goal), planner="robust")
        assert episode.status == "solved"
        assert "execution noise" in episode.reason
        assert episode.length <= steer(SteeringProblem(SQUARE, start, goal)).length
        assert episode.verify()
    inside = SteeringProblem.from_dict(PROBLEM | {"kind": "steering"})
    episode = steer(inside, planner="robust")
    assert "runs with execution noise 2.5e-07 the loop also reaches the goals" in episode.reason
    assert steer(inside, planner="robust", execution=2.5e-7, seed=3)
