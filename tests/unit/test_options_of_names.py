"""MODULE:ATTRIBUTE:OPTION=VALUE: a user's own policy, task, placement, planner, tour and allocation
take options.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import shoal
from shoal.cli import run as command
from shoal.core.errors import InvalidInputError
from shoal.core.registry import Registry, configured
from shoal.search import problem
from shoal.search.tours import TOURS
from shoal.steering.planners import PLANNERS, make_planner

MODULE = """
from shoal.search.allocation.allocate import hop, stay
from shoal.search.tours import TOURS
from shoal.steering.planners import PLANNERS, make_planner
from shoal.swarm.grid.tasks import left_wall, uniform
from shoal.swarm.grid.tasks import TASKS
from shoal.swarm.policies import POLICIES

seen = []


class Dither(POLICIES.get("random-moves")):
    def __init__(self, p=0.5, name="dither", loud: bool = False, steps: "int" = 1, extra=None):
        seen.append(("policy", p, name, loud, steps, extra))


class Needy:
    name = "needy"

    def __init__(self, p: float):
        self.p = p / 0


class Task(TASKS.get("mapping")):
    def __init__(self, share=1.0):
        seen.append(("task", share))
        super().__init__()


class Corner:
    def __init__(self, side="left"):
        self.side = side

    def __call__(self, workspace, n, rng):
        seen.append(("corner", self.side))
        return left_wall(workspace, n, rng)


def placement(workspace, n, rng, *, side="left"):
    seen.append(("placement", side))
    return left_wall(workspace, n, rng)


class Planner(PLANNERS.get("greedy")):
    def __init__(self, tries=3):
        seen.append(("planner", tries))


class Tour(TOURS.get("comb")):
    def __init__(self, turned=False):
        seen.append(("tour", turned))


def allocation(tour_cost, team, *, lazy=False):
    seen.append(("allocation", lazy))
    return (stay if lazy else hop)(tour_cost, team)
"""
SWARM = ("map", "cave:12x9", "-n", "5", "--max-moves", "20")
STEER = ("steer", "square", "--start", "0.2,0.5 0.4,0.5", "--goal", "0.3,0.5 0.4,0.5")
UNFINISHED = {SWARM: 1}  # exit code: 20 moves are too few
SEARCH = ("search", "square:60", "--robots", "3")
CASES = [
    (SWARM, "policy", "Dither", ("policy", 0.5, "dither", False, 1, None)),
    (SWARM, "policy", "Dither:p=0.3", ("policy", 0.3, "dither", False, 1, None)),
    (
        SWARM,
        "policy",
        "Dither:0.3,loud=true,steps=7,extra=2.5",
        ("policy", 0.3, "dither", True, 7, 2.5),
    ),
    (SWARM, "policy", "Dither:name=x,extra=far", ("policy", 0.5, "x", False, 1, "far")),
    (SWARM, "task", "Task:share=0.25", ("task", 0.25)),
    (SWARM, "placement", "placement:side=right", ("placement", "right")),
    (SWARM, "placement", "placement:right", ("placement", "right")),
    (SWARM, "placement", "Corner:side=right", ("corner", "right")),
    (STEER, "planner", "Planner:tries=5", ("planner", 5)),
    (SEARCH, "tour", "Tour:turned=true", ("tour", True)),
    (SEARCH, "allocation", "allocation:lazy=true", ("allocation", True)),
    (SEARCH, "allocation", "allocation", ("allocation", False)),
]
REFUSED = [
    (
        "Dither:q=1",
        "the policy 'own_things:Dither' has no option 'q' (it has p, name, loud, steps, extra)",
    ),
    ("Dither:p=high", "the policy 'own_things:Dither': p: expected a number, got 'high'"),
    ("Dither:p=1,p=2", "expected the option 'p' once"),
    ("Dither:steps=0.5", "steps: expected a whole number, got '0.5'"),
    ("Dither:loud=yes", "loud: expected true or false, got 'yes'"),
    ("Needy", "expected a class without arguments: missing a required argument: 'p'"),
    (
        "Needy:p=2",
        "cannot create the policy 'own_things:Needy': ZeroDivisionError: float division by zero",
    ),
    ("Nobody:p=2", "cannot import the policy 'own_things:Nobody'"),
]


@pytest.fixture
def own_things(tmp_path, monkeypatch):
    (tmp_path / "own_things.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(__import__("sys").modules, "own_things", raising=False)
    return __import__("own_things")


@pytest.mark.parametrize(
    ("words", "field", "name", "made"),
    CASES,
    ids=[f"{field} {name}" for _, field, name, _ in CASES],
)
def test_options_reach_what_is_named(words, field, name, made, own_things, tmp_path, capsys):
    if field != "task":  # of commands it is their name
        assert command(
            [
                *words,
                f"--{field}",
                f"own_things:{name}",
                "--out",
                str(tmp_path / "out"),
                "--json",
            ]
        ) == UNFINISHED.get(words, 0)
        assert own_things.seen[0] == made
        json.loads(capsys.readouterr().out)
    fields = {
        "map": {"particles": 5, "max_moves": 20},
        "search": {"robots": 3, "footprint": 10},
    }.get(words[0])
    if fields is not None:
        episode = shoal.run(words[1], **fields, **{field: f"own_things:{name}"})
        file = tmp_path / ("episode.npz" if words is SWARM else "episode.json")
        episode.save(file)
        again = type(episode).load(file, trust=True)
        assert getattr(again.problem, field) == f"own_things:{name}"
        assert again.verify()
        assert made in own_things.seen


@pytest.mark.parametrize(
    ("policy", "shown"),
    [
        ("own_things:Dither:p=0.5", "random-moves:p=0.5"),
        ("own_things:Dither", "random-moves"),
        ("closest-frontier:ties=row-major", "closest-frontier:ties=row-major"),
    ],
)
def test_a_policy_is_shown_with_its_options(policy, shown, own_things, capsys):
    assert command([*SWARM, "--policy", policy]) == 1
    assert f"policy     {shown} " in capsys.readouterr().out
    assert command([*SWARM, "--policy", policy, "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["policy"] == shown


@pytest.mark.parametrize(("name", "words"), REFUSED)
def test_what_does_not_fit_is_one_sentence(name, words, own_things, capsys):
    assert command([*SWARM, "--policy", f"own_things:{name}"]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert len(said.splitlines()) == 1


def test_functions_take_options_only_where_the_objects_are_functions():
    made = configured(Registry("count"), "textwrap:shorten:text=abc,width=9")
    assert made == "abc"
    with pytest.raises(InvalidInputError, match="has no option 'text'"):
        configured(Registry("count", functions=True), "textwrap:shorten:text=abc,width=9")


def test_help_names_all_that_is_registered():
    assert set(problem.TOURS) == set(TOURS)
    page = (Path(__file__).parents[2] / "docs/concepts/steering/planners.md").read_text()
    for name in PLANNERS:
        assert make_planner(name).name == name
        assert f"| `{name}` |" in page
