"""One declaration of a problem: command, sweep, file and reference have every field, with the same
default.
"""

from __future__ import annotations

import json
import pickle
import re
from pathlib import Path

import numpy as np
import pytest

import shoal
from shoal import parts
from shoal.cli import run
from shoal.cli.commands import command
from shoal.core.errors import InvalidInputError
from shoal.lab import problems

ROOT = Path(__file__).parents[2]
REFERENCE = (ROOT / "docs" / "reference" / "problems.md").read_text()
SMALLEST = {
    "swarm": {"map": "maze:9x7", "particles": 4},
    "steering": {
        "workspace": "square",
        "start": [[0.2, 0.3], [0.5, 0.35]],
        "goal": [[0.8, 0.2], [0.3, 0.75]],
    },
    "search": {"region": "square:60", "robots": 3, "footprint": 10.0},
}
NEEDED = {
    "confidence": {"slip": 0.0},
    "detection": {"targets": 0},
    "elsewhere": {"prior": ["ring:5,5:0.5=9"]},
    "at_most": {"prior": ["ring:5,5:0.5=9"]},
    "order": {"prior": ["ring:5,5:0.5=9"]},
    "drift": {"prior": ["ring:5,5:0.5=9"]},
    "varied": {"goal_x": 0.3, "goal_y": 0.4},
}
"""What a problem must state beside a field that has an effect on some problems only."""
COMMANDS = {"swarm": ("map", "cover"), "steering": ("steer",), "search": ("search",)}
FIELDS = [(part, name) for part in parts.PARTS for name in parts.problem_type(part).declarations()]


@pytest.mark.parametrize(("part", "name"), FIELDS)
def test_every_field_is_everywhere_with_one_default(part, name):
    kind = parts.problem_type(part)
    declared = kind.declarations()[name]
    smallest = kind(**SMALLEST[part])
    value = smallest.to_dict(defaults=True)[name]
    # the command; map and cover are named by the task, and each offers what its task has
    offered = [
        one
        for name_of_command in COMMANDS[part]
        for one in command(name_of_command).params
        if one.name == name
    ]
    assert offered or (part, name) == ("swarm", "task"), f"no command has an option for {name}"
    for one in offered:
        if declared.option.argument:  # a command asks for its map, workspace or region
            assert one.required
            continue
        shown = one.show_default if isinstance(one.show_default, str) else one.default
        unsaid = (None, False, "", ())  # no default that a command's help could show
        assert (
            declared.required
            or str(shown) == str(declared.default)
            or (shown in unsaid and declared.default in unsaid)
        )
    # a sweep and a file
    fields = {"kind": part} | SMALLEST[part] | NEEDED.get(name, {})
    assert problems.trial_problem(fields) == problems.trial_problem(fields | {name: value})
    assert kind.from_dict(json.loads(json.dumps(fields | {name: value}))) == kind.from_dict(fields)
    # the reference
    section = REFERENCE.partition(f'## kind = "{part}"')[2].partition("\n## ")[0]
    row = re.search(rf"^\| `{name}` \|[^|]*\|([^|]*)\|", section, re.M)
    assert row is not None, "run: python docs/generate_reference.py"
    assert declared.required or row[1].strip() == (
        "none" if declared.default is None else f"`{declared.default}`"
    )


@pytest.mark.parametrize("part", parts.PARTS)
def test_one_result_through_every_door(part, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    problem = parts.problem_type(part)(**SMALLEST[part])
    called = shoal.run(problem, seed=3)
    (tmp_path / "problem.json").write_text(json.dumps(problem.to_dict()))
    arguments = {
        "swarm": ["map", "maze:9x7", "-n", "4"],
        "steering": ["steer", "problem.json"],
        "search": ["search", "square:60", "--robots", "3", "--footprint", "10"],
    }[part]
    assert run([*arguments, "--seed", "3", "--out", "out", "--json"]) == 0
    saved = shoal.load(next(Path("out").glob("episode.*")))
    assert problems.trial(problem, 3) == [called.metrics[name] for name in problem.measures]
    for other in (saved, shoal.run(parts.load_problem("problem.json"), seed=3)):
        assert other.problem == problem
        assert what_was_done(other) == what_was_done(called)
        assert other.verify()


@pytest.mark.parametrize("part", ["steering", "search"])
def test_an_episode_or_a_file_of_another_part_is_no_problem_file(part, tmp_path, capsys):
    command = {"steering": "steer", "search": "search"}
    problem = parts.problem_type(part)(**SMALLEST[part])
    episode, other = tmp_path / "episode.json", tmp_path / "other.json"
    shoal.run(problem, seed=3).save(episode)
    with pytest.raises(InvalidInputError, match="expected a problem, got an episode"):
        parts.load_problem(episode)
    assert run([command[part], str(episode)]) == 2
    assert capsys.readouterr().err == (
        f"shoal: {episode}: expected a problem, got an episode, whose field problem is one\n"
    )
    other.write_text(json.dumps(problem.to_dict()))
    (wrong,) = {*command} - {part}
    assert run([command[wrong], str(other)]) == 2
    assert capsys.readouterr().err == f"shoal: {other}: kind: expected {wrong}, got '{part}'\n"


def what_was_done(episode):
    if episode.part == "swarm":
        return episode.commands
    if episode.part == "steering":
        return episode.inputs.tolist()
    return [log.cells.tolist() for log in episode.trace.robots]


def test_short_forms():
    assert shoal.run("vessels:300", particles=5, policy="closest-frontier").status == "complete"
    assert shoal.run(np.ones((3, 9), dtype=bool), particles=np.int64(3)).status == "complete"
    with pytest.raises(InvalidInputError, match=r"partcles: .* \(did you mean 'particles'\?\)"):
        shoal.run("vessels:300", partcles=5)
    with pytest.raises(InvalidInputError, match="expected fields of one part"):
        shoal.run("vessels:300", particles=5, robots=3)
    with pytest.raises(
        InvalidInputError,
        match=r"vesels: expected no such field, got True \(did you mean 'vessels'\?\)",
    ):
        shoal.run("maze:9x7", vesels=True)


def test_a_field_that_is_none_of_the_problem_is_refused_with_the_nearest():
    with pytest.raises(
        InvalidInputError,
        match=r"problem: partcles: expected no such field, got 3 \(did you mean 'particles'\?\)",
    ):
        parts.problem_of({"kind": "swarm", "map": "line:9", "partcles": 3})


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["map", "line:7", "--cell-size", "a"], "--cell-size: expected MM, got 'a'"),
        (
            ["map", "line:7", "--start", "a,b"],
            "--start: expected row,column pairs such as '0,3 0,4', inlet:ROW,COLUMN or the file of"
            " a map, got 'a,b'",
        ),
        (
            ["map", "line:7", "--start", "0,1", "--placement", "uniform"],
            "placement: expected no placement together with start",
        ),
        (
            ["map", "line:7", "--start", "0,1", "-n", "100"],
            "particles: expected 1, the number of start cells, got 100",
        ),
        (
            ["map", "line:7", "--confidence", "0.99"],
            "confidence: expected a confidence only together with noise",
        ),
        (
            ["drive", "line:7", "--rig", "simulated", "--end-after", "60"],
            "end-after: expected a rig behind a connection",
        ),
        (["search", "square:60", "--detection", "1"], "detection: expected targets"),
        (
            ["search", "square:60", "--launch", "1,1", "--starts", "random"],
            "starts: expected no starts together with launch",
        ),
        (
            ["search", "square:60", "--live", "9", "--simulate"],
            "simulate: expected no choice for a live search",
        ),
        (
            ["search", "square:60", "--autopilot", "px4"],
            "--autopilot: expected --missions DIR together with it, or --prepare FOLDER",
        ),
        (
            ["search", "square:60", "--separation", "10,5"],
            "--separation: expected --missions DIR together with it, or --prepare FOLDER",
        ),
        (
            ["search", "square:60", "--missions", "m", "--terrain-error", "1"],
            "terrain_error: expected a terrain file",
        ),
        (
            ["missions", "check", ".", "square:60", "--least", "0.999"],
            "least: expected a footprint, or a vehicle",
        ),
        (
            ["missions", "check", ".", "square:60", "--terrain-error", "1"],
            "terrain_error: expected a terrain file",
        ),
        (
            ["missions", "check", ".", "square:60", "--separation", "0", "--delay-tolerance", "10"],
            "delay_tolerance: expected a",
        ),
        (
            ["steer", "square", "--varied", "2"],
            "varied: expected goal_x and goal_y together with varied",
        ),
    ],
)
def test_an_option_without_effect_is_refused_at_its_default(
    words, said, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert run(words) == 2
    told = capsys.readouterr().err
    assert said in told
    assert told.count("\n") == 1


def test_a_problem_knows_which_fields_were_given():
    from shoal.swarm import SwarmProblem

    problem = SwarmProblem("line:7", particles=100, scale=1.0)
    assert problem.given == {"map", "particles", "scale"}
    assert problem.replaced(slip=0.0).given == {"map", "particles", "scale", "slip"}
    assert problem.at_place(None).given == problem.given
    assert pickle.loads(pickle.dumps(problem)).given == problem.given
    assert problem == SwarmProblem("line:7")
    assert problem.canonical() == SwarmProblem("line:7").canonical()
    assert SwarmProblem("line:7", "mapping").given == {"map", "task"}
    started = SwarmProblem("line:7", start=[[0, 1]])
    assert started.replaced(start=[[0, 1], [0, 2]]).particles == 2  # the number was not given
