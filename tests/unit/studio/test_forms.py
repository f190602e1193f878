"""Forms come from the declarations; what is copied from the screen gives the same episode elsewhere."""

from __future__ import annotations

import json
import random
import shlex

import numpy as np
import pytest

import shoal
from shoal.cli import run as run_command
from shoal.errors import InvalidInputError
from shoal.parts import PARTS, load_problem, problem_type
from shoal.studio.folder import Folder
from shoal.studio.forms import checked_problem, copies_of, schema_of


@pytest.mark.parametrize("part", PARTS)
def test_schema_has_every_field_with_its_default(part):
    schema, declared = schema_of(part), problem_type(part).declarations()
    assert list(schema["properties"]) == list(declared)
    json.dumps(schema, allow_nan=False)
    for name, one in declared.items():
        assert (name in schema["required"]) == one.required
        assert schema["properties"][name]["description"] == one.option.help


def random_swarm(rng: random.Random) -> dict[str, object]:
    fields: dict[str, object] = {"kind": "swarm", "map": rng.choice(["maze:9x7", "rectangle:4x6", "line:12", "cave:9x9:1"])}
    fields["particles"] = rng.randint(1, 5)
    choices = {
        "task": ["coverage", "subset-coverage:fraction=0.5"], "placement": ["uniform", "region-fill"], "rule": ["block", "merge"],
        "policy": ["closest-frontier", "closest-frontier:ties=row-major", "best", "random-moves"], "max_moves": [40, 300],
        "move_cost": [0.1, 2.5], "scan_cost": [1.25], "largest_component": [True], "cell_size": [0.07],
    }  # fmt: skip
    for name, values in choices.items():
        if rng.random() < 0.5:
            fields[name] = rng.choice(values)
    if rng.random() < 0.3:
        fields |= {"map": "rectangle:4x6", "start": [[0, 1], [2, 3]]}
        del fields["particles"]
    if fields.get("task", "mapping") == "mapping" and rng.random() < 0.3 and fields.get("policy", "best") == "closest-frontier":
        fields |= {"slip": 0.05, "confidence": 0.95, "rule": "block"}
    return fields


def random_steering(rng: random.Random) -> dict[str, object]:
    points = [[round(rng.uniform(-0.25, 0.25), 3) for _ in range(2)] for _ in range(4)]
    fields: dict[str, object] = {"kind": "steering", "workspace": rng.choice(["hexagon", "disk", "regular:5"]), "planner": "greedy"}
    if rng.random() < 0.2:
        fields["planner"] = "shortest"
    if rng.random() < 0.7:
        fields |= {"start": points[:2], "goal": points[2:]}
    choices = {"interchangeable": [True], "tolerance": [1e-5], "max_moves": [30], "execution": [0.001]}
    for name, values in choices.items():
        if rng.random() < 0.4:
            fields[name] = rng.choice(values)
    return fields


RANDOM_FORMS = {"swarm": random_swarm, "steering": random_steering}


def deeds(episode):
    return episode.commands if episode.part == "swarm" else np.asarray(episode.inputs).tolist()


@pytest.mark.parametrize("part", RANDOM_FORMS)
def test_python_command_and_file_give_the_same_episode_for_20_random_forms(part, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for drawing in ("figure", "save_figure"):  # of these episodes nobody looks at the figures
        monkeypatch.setattr(f"shoal.views.{drawing}", lambda *_args, **_more: None)
    rng = random.Random(part)
    for seed in range(20):
        problem = checked_problem(RANDOM_FORMS[part](rng), Folder(tmp_path))
        expected = shoal.run(problem, seed=seed)
        copies = copies_of(problem, seed=seed)
        names: dict[str, object] = {}
        exec(copies["python"], names)
        assert deeds(names["episode"]) == deeds(expected)
        (tmp_path / "problem.json").write_text(copies["file"])
        assert load_problem("problem.json") == problem
        words = shlex.split(copies["command"])
        assert words[0] == "shoal"
        assert run_command([*words[1:], "--out", "out", "--json"]) == (0 if expected or part == "swarm" else 1)
        episode = shoal.load(next((tmp_path / "out").glob("episode.*")))
        assert episode.problem == problem
        assert deeds(episode) == deeds(expected)
        capsys.readouterr()


@pytest.mark.parametrize(
    "fields",
    [
        {"kind": "swarm", "map": "/etc/passwd"},
        {"kind": "swarm", "map": "../secret.png"},
        {"kind": "swarm", "map": "link.png"},
        {"kind": "swarm", "map": "folder/x.png"},
        {"kind": "steering", "workspace": "~/secret.svg"},
        {"kind": "search", "region": "a/../../secret.geojson"},
        {"kind": "swarm", "map": "line:9", "policy": "os:system"},
        {"kind": "swarm", "map": "line:9", "task": "os:system"},
        {"kind": "no", "map": "line:9"},
        [],
        None,
    ],
)
def test_no_path_leaves_the_folder_and_no_code_is_run(fields, tmp_path):
    (tmp_path / "secret.png").write_bytes(b"")
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "link.png").symlink_to(tmp_path / "secret.png")
    (inside / "folder").symlink_to(tmp_path)
    with pytest.raises(InvalidInputError):
        checked_problem(fields, Folder(inside))
