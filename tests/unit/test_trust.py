"""Files of strangers run no code: what they name as MODULE:ATTRIBUTE is refused, unless they are
trusted.
"""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
import pytest

import shoal
from shoal import parts
from shoal.cli import run as command
from shoal.core.errors import InvalidInputError
from shoal.missions import FORMATS
from shoal.missions.options import CheckOptions, MissionOptions
from shoal.rigs.log import read_log
from shoal.search.allocation.allocate import ALLOCATORS
from shoal.search.tours import TOURS
from shoal.steering.planners import PLANNERS
from shoal.studio.folder import Folder
from shoal.studio.forms import checked_fields
from shoal.swarm.grid.tasks import PLACEMENTS, TASKS
from shoal.swarm.policies import POLICIES

MODULE = """
import pathlib
pathlib.Path({mark!r}).touch()
from shoal.search.allocation.allocate import ALLOCATORS
from shoal.search.tours import TOURS
from shoal.steering.planners import PLANNERS
from shoal.swarm.grid.tasks import PLACEMENTS
from shoal.swarm.grid.tasks import TASKS
from shoal.swarm.policies import POLICIES
Task, Policy, Placement = TASKS.get("mapping"), POLICIES.get("closest-frontier"), PLACEMENTS.get("uniform")
Planner, Tour, Allocation = PLANNERS.get("greedy"), TOURS.get("comb"), ALLOCATORS.get("hop")
"""
STEER = {"kind": "steering", "start": [[0.2, 0.3], [0.5, 0.35]], "goal": [[0.8, 0.2], [0.3, 0.75]]}
PROBLEMS = [
    ("task", {"kind": "swarm", "map": "line:9", "particles": 3, "task": "foreign:Task"}),
    (
        "policy",
        {
            "kind": "swarm",
            "map": "line:9",
            "particles": 3,
            "policy": "foreign:Policy:ties=row-major",
        },
    ),
    (
        "placement",
        {"kind": "swarm", "map": "line:9", "particles": 3, "placement": "foreign:Placement"},
    ),
    ("planner", STEER | {"planner": "foreign:Planner"}),
    ("tour", {"kind": "search", "region": "square:60", "robots": 3, "tour": "foreign:Tour"}),
    (
        "allocation",
        {"kind": "search", "region": "square:60", "robots": 3, "allocation": "foreign:Allocation"},
    ),
]
RUN_BY_A_REPLAY = ("task", "tour", "allocation")


@pytest.fixture
def mark(tmp_path, monkeypatch):
    """The file that a module of a stranger makes when it is imported."""
    (tmp_path / "foreign.py").write_text(MODULE.format(mark=str(tmp_path / "mark")))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(__import__("sys").modules, "foreign", raising=False)
    return tmp_path / "mark"


def test_the_names_of_the_declarations_are_those_of_the_registries():
    registries = {
        "task": TASKS,
        "policy": POLICIES,
        "placement": PLACEMENTS,
        "planner": PLANNERS,
        "tour": TOURS,
        "allocation": ALLOCATORS,
        "format": FORMATS,
    }
    kinds = [*map(parts.problem_type, parts.PARTS), MissionOptions, CheckOptions]
    declared = {
        name: one.names
        for kind in kinds
        for name, one in kind.declarations().items()
        if one.names is not None
    }
    assert {name: sorted(names) for name, names in declared.items()} == {
        name: sorted(found) for name, found in registries.items()
    }
    for kind in kinds:  # whoever adds a field that takes code must say so
        for name, one in kind.declarations().items():
            assert ("MODULE:ATTRIBUTE" in one.help) == (one.names is not None), name


@pytest.mark.parametrize("formats", ["foreign:form", "plan, foreign:form", ["foreign:form"]])
def test_formats_of_missions_in_the_studio(formats, mark, tmp_path):
    """A field with a list of names, from a browser."""
    with pytest.raises(InvalidInputError, match="code of the Python module 'foreign'"):
        checked_fields(MissionOptions, {"format": formats}, Folder(tmp_path))
    assert not mark.exists()


@pytest.mark.parametrize(("field", "problem"), PROBLEMS, ids=[field for field, _ in PROBLEMS])
def test_problem_files_and_episodes(field, problem, mark, tmp_path, capsys):
    path = tmp_path / "problem.json"
    path.write_text(json.dumps(problem))
    with pytest.raises(
        InvalidInputError,
        match=rf"problem.json: {field}: .*code of the Python module 'foreign'.*--trust",
    ):
        shoal.load_problem(path)
    verb = {"swarm": "map", "steering": "steer", "search": "search"}[problem["kind"]]
    assert command([verb, str(path)]) == 2
    assert "--trust" in capsys.readouterr().err
    assert not mark.exists()
    # trusted, it runs; and so does what its author wrote in Python
    episode = shoal.run(shoal.load_problem(path, trust=True), seed=1)
    assert mark.exists()
    assert episode
    saved = tmp_path / ("e.npz" if problem["kind"] == "swarm" else "e.json")
    episode.save(saved)
    if field != "task":
        assert command([verb, str(path), "--trust", "--seed", "1", "--json"]) == 0
        assert {"status", "reason"} & set(json.loads(capsys.readouterr().out))
    # the episode: refused where a replay would run the code, opened where it would not
    if field in RUN_BY_A_REPLAY:
        with pytest.raises(
            InvalidInputError,
            match=rf"{field}: .*runs the code of the Python module 'foreign'.*trust=True",
        ):
            shoal.load(saved)
        assert command(["replay", str(saved)]) == 2
        capsys.readouterr()
        assert command(["replay", str(saved), "--trust", "--json"]) == 0
    else:
        assert shoal.load(saved).verify()
        assert command(["replay", str(saved), "--json"]) == 0
    assert shoal.load(saved, trust=True).verify()


def test_reading_an_episode_imports_nothing(mark, tmp_path):
    episode = shoal.run("line:9", particles=3, policy="closest-frontier", seed=1)
    episode.save(tmp_path / "e.npz")
    with np.load(tmp_path / "e.npz") as archive:
        arrays = dict(archive)
    header = json.loads(arrays["header"].tobytes())
    header["problem"]["task"] = "foreign:Task"
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    np.savez(tmp_path / "e.npz", **arrays)
    with pytest.raises(InvalidInputError, match="'foreign'"):
        shoal.load(tmp_path / "e.npz")
    assert not mark.exists()


def test_logs_of_drives(mark, tmp_path):
    assert (
        command(["drive", "line:9", "-n", "3", "--log", str(tmp_path / "log.jsonl"), "--json"]) == 0
    )
    lines = (tmp_path / "log.jsonl").read_text().splitlines()
    header = json.loads(lines[0])
    header["problem"]["task"] = "foreign:Task"
    (tmp_path / "log.jsonl").write_text("\n".join([json.dumps(header), *lines[1:]]) + "\n")
    with pytest.raises(InvalidInputError, match=r"line 1: task: .*'foreign'"):
        read_log(tmp_path / "log.jsonl")
    assert not mark.exists()
    assert read_log(tmp_path / "log.jsonl", trust=True)
    assert command(["replay", str(tmp_path / "log.jsonl")]) == 2
    assert not mark.exists()
    assert command(["replay", str(tmp_path / "log.jsonl"), "--trust"]) == 0


@pytest.mark.parametrize(
    "arguments",
    [
        ["search", "square:60", "--robots", "3", "--allocation", "os:system"],
        ["search", "square:60", "--robots", "3", "--allocation", "sys:exit"],
        ["search", "square:60", "--robots", "3", "--tour", "os:system"],
        ["steer", "square", "--planner", "os:getcwd"],
        ["map", "line:9", "-n", "3", "--policy", "os:system"],
        ["map", "line:9", "-n", "3", "--placement", "os:system"],
    ],
)
def test_what_is_none_of_its_kind_gets_one_sentence(arguments, capfd):
    assert command(arguments) == 2
    printed = capfd.readouterr().err
    assert printed.startswith("shoal: ")
    assert printed.count("\n") == 1
    assert "expected" in printed


# as the installed command begins
SCRIPT = "import sys; sys.path.pop(0); from shoal.__main__ import main; main()"
MINE = """
from shoal.swarm.policies import ClosestFrontier

class Mine(ClosestFrontier):
    name = "mine"

    def decide(self, *given):
        return super().decide(*given)
"""


@pytest.mark.parametrize("begin", [["-m", "shoal"], ["-c", SCRIPT]], ids=["module", "script"])
def test_files_in_the_current_folder_are_not_taken_for_modules_of_others(begin, tmp_path):
    """A folder of downloads runs nothing; the user's own module in it is found, also by worker
    processes.
    """
    for name in (
        "email",
        "numba",
        "PIL",
        "secrets",
        "calendar",
        "typing",
        "scipy",
        "pydantic",
        "rich",
        "typer",
    ):
        (tmp_path / f"{name}.py").write_text(
            f"import pathlib; pathlib.Path('ran-{name}').touch()\n"
        )
    (tmp_path / "mine.py").write_text(MINE)
    for options in ([], ["--policy", "mine:Mine", "--trials", "2"]):
        words = [*begin, "map", "line:9", "-n", "2", *options, "--json"]
        ended = subprocess.run(
            [sys.executable, *words], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert ended.returncode == 0, ended.stderr
        assert json.loads(ended.stdout)["policy"] == "mine" or not options
    assert not list(tmp_path.glob("ran-*"))


@pytest.mark.parametrize(("options", "exit_code"), [(["--json"], 0), (["--out", "there"], 2)])
def test_in_a_working_folder_that_was_deleted(options, exit_code, tmp_path):
    """What writes nothing there runs, all else gets one sentence."""
    code = (
        f"import os; os.mkdir('gone'); os.chdir('gone'); os.rmdir({str(tmp_path / 'gone')!r});"
        f" {SCRIPT}"
    )
    words = [sys.executable, "-c", code, "map", "line:9", "-n", "2", *options]
    ended = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == exit_code
    assert ended.stderr.count("\n") == (exit_code == 2)


def test_names_of_strangers_do_not_reach_the_terminal_raw(tmp_path, capfd):
    """Neither in a sentence nor in a table: escape sequences, bells, and letters that turn the line
    round.
    """
    folder = tmp_path / "a\x1b[31m\u202eb"
    folder.mkdir()
    field = {
        "type": "Polygon",
        "coordinates": [
            [[13.4, 52.5], [13.402, 52.5], [13.402, 52.501], [13.4, 52.501], [13.4, 52.5]]
        ],
    }
    (folder / "field.json").write_text(json.dumps(field))
    assert command(["search", str(folder / "none.json"), "--footprint", "50"]) == 2
    assert (
        command(
            [
                "search",
                str(folder / "field.json"),
                "--footprint",
                "50",
                "--out",
                str(folder / "out"),
            ]
        )
        == 0
    )
    told = capfd.readouterr()
    assert not {"\x1b", "\u202e"} & set(told.err)
    assert "\\x1b[31m\\u202e" in told.err
    assert "\u202e" not in told.out
