"""SearchProblem: one declaration for the command, run(), files and episodes."""

from __future__ import annotations

import json

import numpy as np
import pytest
import shapely

from shoal.cli import run as command
from shoal.core.errors import InvalidInputError, UnknownNameError
from shoal.search import LocalFrame, SearchEpisode, SearchProblem, plan_search, region_of
from shoal.search.problem.network import (
    Battery,
    Crash,
    Liar,
    Pause,
    Slow,
    WrongPosition,
    check_faults,
    fault_text,
)
from shoal.search.run import run
from shoal.search.simulation.scenario import scenario_of

FIELD = {
    "type": "Polygon",
    "coordinates": [[[7.0, 50.0], [7.003, 50.0], [7.003, 50.002], [7.0, 50.002], [7.0, 50.0]]],
}
FAULTS = (
    Crash(2, 10.5),
    Pause(3, 5.0, 40.0),
    Slow(1, 2.0, 0.25),
    Battery(1, 1e-7),
    WrongPosition(4, -2),
    Liar(4),
)


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"faults": FAULTS, "loss": 0.25, "network": "range:8,delay:0.5"},
        {
            "robots": 3,
            "footprint": [2, 2, 6.5],
            "rates": (1, 2, 0.1),
            "starts": [(5, 5), (0.1, 1 / 3), (9, 9)],
        },
        {"no_go": [shapely.box(20, 20, 40, 30), [(50, 50), (60, 50), (60, 60)], "zones.json"]},
        {"no_go": [(50, 50), (60, 50), (60, 60)]},
        {
            "targets": 3,
            "obstacles": [(15, 15)],
            "vehicle": "ideal,endurance=5,recharge=2",
            "multiplicity": 2,
            "live": 20,
            "crashes": 1,
        },
        {
            "region": region_of(
                shapely.box(0, 0, 1 / 3, 20), frame=LocalFrame(8.5, 47.4), name="field"
            )
        },
        {
            "robots": np.int64(2),
            "vehicle": {"preset": "rover", "cruise_speed": np.float32(0.5)},
            "targets": np.int32(4),
            "simulate": False,
        },
    ],
)
def test_a_problem_goes_through_json(fields):
    problem = SearchProblem(**({"region": "square:100"} | fields))
    again = SearchProblem.from_dict(json.loads(json.dumps(problem.to_dict())))
    assert again == problem
    assert hash(again) == hash(problem)
    assert again.to_dict() == problem.to_dict()


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_spelled(fault):
    assert check_faults(fault_text(fault)) == (fault,)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"footprint": [2, 3]}, "footprint: expected one length, or 4, one per robot, got 2"),
        ({"rates": [1, 2]}, "rates: expected 4 speeds, one per robot, got 2"),
        ({"starts": [(1, 2)]}, "starts: expected 4 points, one per robot, got 1"),
        ({"faults": "crash:5@1"}, "faults: expected a robot from 1 to 4, got crash:5@1"),
        ({"faults": "crash:0@1"}, "faults: expected crash:ROBOT@TIME, got 'crash:0@1'"),
        ({"faults": "pause:1@5"}, "faults: expected pause:ROBOT@TIME:UNTIL, got 'pause:1@5'"),
        ({"faults": "liar:1@5"}, "faults: expected liar:ROBOT, got 'liar:1@5'"),
        ({"faults": "sleep:1"}, "faults: expected KIND:ROBOT@TIME"),
        ({"faults": [7]}, "faults: expected faults such as crash:2@30, got 7"),
        ({"crashes": 5}, "crashes: expected at most 4, one per robot, got 5"),
        ({"network": "wifi"}, "network: expected perfect or some of"),
        (
            {"live": 20, "network": "delay:1"},
            "live: expected no network, because a live search has only loss, got 'delay:1'",
        ),
        ({"live": 20, "faults": "liar:1"}, "live: expected only crashes and slow robots"),
        ({"multiplicity": 0}, "multiplicity: expected a whole number, 1 or more, got 0"),
        ({"loss": 1.5}, "loss: expected a number from 0 to 1, got 1.5"),
        ({"region": 7}, "region: expected a name, the path of a file or a SearchRegion, got 7"),
        ({"region": {"name": "x"}}, "region: expected name, area and frame"),
        (
            {"region": {"name": "x", "area": "POLYGON", "frame": None}},
            "region: area: expected well-known text",
        ),
        (
            {"region": region_of(shapely.box(0, 0, 9, 9)), "closed_lines": True},
            "region: expected a name or a file",
        ),
        (
            {"no_go": 5},
            "no-go zone 1: expected a file, a Shapely polygon or points of shape (n, 2), got 5",
        ),
        (
            {"no_go": ["a.json", [1, 2]]},
            "no-go zone 2: expected a file, a Shapely polygon or points",
        ),
        ({"targets": -1}, "targets: expected a whole number, 0 or more, got -1"),
        ({"robots": True}, "robots: expected a whole number from 1 to 1000, got True"),
    ],
)
def test_bad_fields_are_refused_in_a_sentence(fields, words):
    with pytest.raises(InvalidInputError) as caught:
        SearchProblem(**({"region": "square:100"} | fields))
    assert words in str(caught.value)


def test_every_way_to_the_same_search(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "field.json").write_text(json.dumps(FIELD))
    problem = SearchProblem(
        "field.json", robots=3, footprint=20, faults="crash:2@5", targets=2, loss=0.2
    )
    episode = run(problem, seed=5)
    (tmp_path / "problem.json").write_text(json.dumps(problem.to_dict()))
    words = [
        "--robots",
        "3",
        "--footprint",
        "20",
        "--faults",
        "crash:2@5",
        "--targets",
        "2",
        "--loss",
        "0.2",
    ]
    for arguments in (["search", "field.json", *words], ["search", "problem.json"]):
        assert command([*arguments, "--seed", "5", "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told | {"seconds": 0} == episode.report() | {"seconds": 0}
    episode.save("episode.json")
    (tmp_path / "field.json").unlink()  # an episode needs no other file
    again = SearchEpisode.load("episode.json")
    assert again.verify()
    assert again.metrics == episode.metrics


def test_an_episode_says_what_auto_chose_and_what_came_of_it():
    episode = run(SearchProblem("square:60", robots=2))
    assert (episode.problem.tour, episode.problem.allocation) == ("auto", "auto")
    report = episode.report()
    assert (report["tour"], report["status"]) == ("spanning-tree", "complete")
    times = {one["allocation"]: one["cells"] for one in report["compared"]}
    assert len(times) == 7
    assert times[report["allocation"]] == min(times.values()) == report["planned_cells"]
    assert list(episode.metrics)[: len(SearchProblem.measures)] == list(SearchProblem.measures)
    assert episode.makespan == episode.metrics["makespan"] == report["makespan_s"]
    assert episode.reason.startswith("all 36 cells that robots can reach were searched after ")
    assert not run(
        SearchProblem("square:40", robots=127, footprint=8)
    ).simulated  # each tells each of a share of all
    assert run(SearchProblem("square:60", robots=2, simulate=False)).reason.endswith(
        "nothing was simulated"
    )
    dead = run(SearchProblem("square:60", robots=2, faults="crash:1@3,crash:2@4"))
    assert not dead
    assert dead.makespan is None
    searched = {int(cell) for log in dead.trace.robots for cell in log.cells}
    assert (
        dead.reason == f"{36 - len(searched)} of 36 cells that robots can reach were never searched"
    )


@pytest.mark.parametrize("fields", [{"tour": "hilbrt"}, {"allocation": "hope"}])
def test_names_that_there_are_not(fields):
    with pytest.raises(UnknownNameError, match="did you mean"):
        run(SearchProblem("square:60", **fields))


def test_random_crashes_follow_from_the_seed():
    problem = SearchProblem("square:60", robots=4, crashes=2)
    one, other = (run(problem, seed=seed).scenario.faults for seed in (1, 2))
    assert one == run(problem, seed=1).scenario.faults != other
    assert all(isinstance(fault, Crash) for fault in one)
    assert len({fault.robot for fault in one}) == 2


def test_a_damaged_trace_is_refused(tmp_path):
    path = tmp_path / "episode.json"
    run(SearchProblem("square:60", robots=2)).save(path)
    good = json.loads(path.read_text())
    for change in (
        lambda data: data["trace"]["robots"].pop(),
        lambda data: data["trace"]["robots"][0]["cells"].append(36),
        lambda data: data["trace"]["robots"][0]["times"].pop(),
        lambda data: data["trace"]["robots"][0]["states"].append(["x", 1]),
        lambda data: data["trace"]["robots"][0].pop("found"),
        lambda data: data["trace"]["declared"].update({"3": 1.0}),
        lambda data: data["trace"]["declared"].update({"x": 1.0}),
        lambda data: data["trace"].pop("sent"),
        lambda data: data["problem"].update(region="nowhere.json"),
        lambda data: data.update(versions=3),
        lambda data: data.update(seed=-1),
    ):
        data = json.loads(json.dumps(good))
        change(data)
        path.write_text(json.dumps(data))
        with pytest.raises(InvalidInputError, match=r"episode\.json"):
            SearchEpisode.load(path)


@pytest.mark.parametrize("prior", [None, ["ring:3,3:0.25=1,0.5=2,0.95=3"]])
def test_no_random_target_stands_in_an_obstacle(prior):
    problem = SearchProblem(
        "square:6", footprint=1, robots=2, targets=10, obstacles=12, prior=prior
    )
    plan = plan_search(problem, seed=1)
    for seed in range(20):
        scenario = scenario_of(problem, plan, seed)
        assert len(scenario.targets) == 10
        assert not {*scenario.targets} & {*scenario.obstacles}


def test_liars_are_not_counted_among_those_who_searched():
    problem = SearchProblem(
        "rectangle:80x60", robots=4, footprint=10, faults="liar:2", multiplicity=2
    )
    episode = run(problem)
    honest = np.zeros(48, dtype=int)
    for number, log in enumerate(episode.trace.robots, start=1):
        if number != 2:
            honest[np.unique(log.cells)] += 1
    assert honest.min() == 1
    assert "searched by 2 robots, at some cells only 1 of them honest, after" in episode.reason
    assert "honest" not in run(problem.replaced(faults="")).reason
