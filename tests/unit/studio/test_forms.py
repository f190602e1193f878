"""Forms come from the declarations; what is copied from the screen gives the same episode
elsewhere.
"""

from __future__ import annotations

import json
import random
import re
import shlex

import numpy as np
import pytest
from tests.soak import often

import shoal
from shoal.cli import run as run_command
from shoal.core.errors import InvalidInputError
from shoal.parts import PARTS, load_problem, problem_type
from shoal.studio.folder import Folder
from shoal.studio.forms import checked_problem, copies_of, schema_of


@pytest.mark.parametrize("part", PARTS)
def test_schema_has_every_field_with_its_default(part):
    schema, declared = schema_of(problem_type(part)), problem_type(part).declarations()
    assert list(schema["properties"]) == list(declared)
    json.dumps(schema, allow_nan=False)
    for name, one in declared.items():
        assert (name in schema["required"]) == one.required
        told = schema["properties"][name]["description"]
        assert told.split()[0] == one.help.split()[0]
        # words of the command
        assert not re.search("--[a-z]|MODULE:ATTRIBUTE|can be repeated", told)


def random_swarm(rng: random.Random) -> dict[str, object]:
    fields: dict[str, object] = {
        "kind": "swarm",
        "map": rng.choice(["maze:9x7", "rectangle:4x6", "line:12", "cave:9x9:1"]),
    }
    fields["particles"] = rng.randint(1, 5)
    choices = {
        "task": ["coverage", "subset-coverage:fraction=0.5"],
        "placement": ["uniform", "region-fill"],
        "rule": ["block", "merge"],
        "policy": ["closest-frontier", "closest-frontier:ties=row-major", "best", "random-moves"],
        "max_moves": [40, 300],
        "move_cost": [0.1, 2.5],
        "scan_cost": [1.25],
        "largest_component": [True],
        "cell_size": [0.07],
    }
    for name, values in choices.items():
        if rng.random() < 0.5:
            fields[name] = rng.choice(values)
    if rng.random() < 0.3:
        fields |= {"map": "rectangle:4x6", "start": [[0, 1], [2, 3]]}
        del fields["particles"]
    if (
        fields.get("task", "mapping") == "mapping"
        and rng.random() < 0.3
        and fields.get("policy", "best") == "closest-frontier"
    ):
        fields |= {"slip": 0.05, "confidence": 0.95, "rule": "block"}
    if "start" in fields:  # it stands in place of a placement
        fields.pop("placement", None)
    return fields


def random_steering(rng: random.Random) -> dict[str, object]:
    points = [[round(rng.uniform(-0.25, 0.25), 3) for _ in range(2)] for _ in range(4)]
    fields: dict[str, object] = {
        "kind": "steering",
        "workspace": rng.choice(["hexagon", "disk", "regular:5"]),
        "planner": "greedy",
    }
    if rng.random() < 0.2:
        fields["planner"] = "shortest"
    if rng.random() < 0.7:
        fields |= {"start": points[:2], "goal": points[2:]}
    choices = {
        "interchangeable": [True],
        "tolerance": [1e-5],
        "max_moves": [30],
        "execution": [0.001],
    }
    for name, values in choices.items():
        if rng.random() < 0.4:
            fields[name] = rng.choice(values)
    return fields


def random_search(rng: random.Random) -> dict[str, object]:
    fields: dict[str, object] = {
        "kind": "search",
        "region": rng.choice(["square:40", "rectangle:60x30", "field.csv", "field.geojson"]),
    }
    fields["robots"] = robots = rng.randint(2, 4)
    launch = "8.5,47.4;8.5004,47.4002" if fields["region"] == "field.geojson" else "5,5;20,12.5"
    choices = {
        "footprint": ["10", 7.5, ",".join(["10"] * robots)],
        "vehicle": [{"preset": "multirotor", "cruise_speed": 7.5}, "rover,turn_time=2"],
        "angle": ["30", "0"],
        "margin": [2.5],
        "launch": [launch if robots == 2 else launch.partition(";")[0]],
        "loss": [0.2],
        "faults": ["crash:1@5.25", ["crash:2@3", "slow:1@4:2"]],
        "crashes": [1],
        "targets": ["2"],
        "tour": ["boustrophedon"],
        "allocation": ["hop", "stay"],
        "rates": [",".join(["1", "2", "1", "0.5"][:robots])],
        "network": ["delay:0.5"],
    }
    for name, values in choices.items():
        if rng.random() < 0.4:
            fields[name] = rng.choice(values)
    if "vehicle" in fields and "rates" in fields:
        del fields["rates"]
    return fields


RANDOM_FORMS = {"swarm": random_swarm, "steering": random_steering, "search": random_search}


def deeds(episode):
    if episode.part == "search":
        return (
            episode.plan.tour.name,
            episode.trace.sent,
            [(log.cells.tolist(), log.times.tolist(), log.status) for log in episode.trace.robots],
        )
    return episode.commands if episode.part == "swarm" else np.asarray(episode.inputs).tolist()


@pytest.mark.parametrize("part", RANDOM_FORMS)
def test_python_command_and_file_give_the_same_episode_for_random_forms(
    part, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    for drawing in ("figure", "save_figure"):  # of these episodes nobody looks at the figures
        monkeypatch.setattr(f"shoal.views.{drawing}", lambda *_args, **_more: None)
    outline = [(-20, -15), (25, -18), (30, 12), (-15, 20)]
    (tmp_path / "field.csv").write_text("x_m,y_m\n" + "".join(f"{x},{y}\n" for x, y in outline))
    degrees = [[8.5 + x / 75_000, 47.4 + y / 111_000] for x, y in (*outline, outline[0])]
    (tmp_path / "field.geojson").write_text(
        json.dumps({"type": "Polygon", "coordinates": [degrees]})
    )
    rng = random.Random(part)
    for seed in range(often(8, 20)):
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
        assert run_command([*words[1:], "--out", "out", "--json"]) == (0 if expected else 1), (
            copies["command"]
        )
        episode = shoal.load(next((tmp_path / "out").glob("episode.*")))
        # an episode of a search holds its region and where robots set out, for whoever has no such
        # files
        if part != "search":
            assert episode.problem == problem
        assert deeds(episode) == deeds(expected)
        capsys.readouterr()


def test_what_the_command_line_cannot_say_it_takes_from_the_file(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    fields = {"kind": "search", "region": "square:40", "robots": 2, "starts": [[5, 5], [20, 12.5]]}
    problem = checked_problem(fields, Folder(tmp_path))
    copies = copies_of(problem, seed=1)
    assert copies["command"] == "shoal search problem.json --seed=1"
    (tmp_path / "problem.json").write_text(copies["file"])
    assert run_command([*shlex.split(copies["command"])[1:], "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["makespan_s"] == shoal.run(problem, seed=1).makespan


def test_texts_of_a_form_are_read_as_the_command_reads_them(tmp_path):
    fields = {
        "kind": "search",
        "region": "square:40",
        "robots": 2,
        "footprint": "10,12",
        "angle": "30",
        "faults": "crash:1@2,liar:2",
    }
    problem = checked_problem(fields, Folder(tmp_path))
    assert (problem.footprint, problem.angle) == ((10.0, 12.0), 30.0)
    assert problem.to_dict()["faults"] == ["crash:1@2", "liar:2"]
    with pytest.raises(InvalidInputError, match="angle"):
        checked_problem(fields | {"angle": "steep"}, Folder(tmp_path))


@pytest.mark.parametrize(
    "fields",
    [
        {"kind": "search", "region": "square:9", "vehicle": "link.toml,altitude=3"},
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
    (inside / "link.toml").symlink_to(tmp_path / "secret.toml")
    (inside / "folder").symlink_to(tmp_path)
    with pytest.raises(InvalidInputError):
        checked_problem(fields, Folder(inside))
