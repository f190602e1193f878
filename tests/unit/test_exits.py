"""How commands end: exit codes, the files that they read, and their JSON."""

from __future__ import annotations

import json

import pytest

from shoal import InvalidInputError
from shoal.cli import run
from shoal.studio.answers.lab import new_sweep
from shoal.studio.folder import Folder
from shoal.studio.work import run_missing_trials

SWEEP = """name = "a"
trials = 2
[problem]
kind = "line"
cells = 9
[axes]
particles = [1, 2]
"""


@pytest.mark.parametrize(
    ("command", "code"),
    [
        ("map line:9 --particles 3", 0),
        ("map line:9 --particles 3 --max-moves 1", 1),
        ("map line:9 --particles 3 --max-moves 1 --trials 2 --workers 1", 1),
        ("map line:9 --particles 1 --policy manual:l", 1),
        ("cover line:9 --particles 2 --max-moves 1", 1),
        ("gather line:9 --particles 3 --max-moves 1 --seed 1", 1),
        ("drive line:9 --particles 3 --max-moves 1", 1),
        ("adversary depth-first --max-moves 1", 1),
        ("adversary closest-frontier --cells 9", 0),
    ],
)
def test_an_unfinished_task_has_the_exit_code_1(command, code, capsys):
    assert run([*command.split(), "--json"]) == code
    assert json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    "command",
    [
        "map line:9 --workers 2",
        "line --cells 9 -n 2 --workers 2",
        "reproduce --quick",
        "reproduce --trials 5",
        "search square:60 --inner search",
        "search square:60 --no-simulate --targets 2",
        "search square:60 --no-simulate --false-alarm 0.1",
    ],
)
def test_options_without_effect_are_refused(command, capsys):
    assert run(command.split()) == 2
    assert "expected" in capsys.readouterr().err


def test_no_output_replaces_an_input(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.toml").write_text(SWEEP)
    assert run(["sweep", "run", "a.toml", "--store", "a.sqlite", "--workers", "0"]) == 0
    kept = (tmp_path / "a.sqlite").read_bytes()
    for verb in ("status", "summary", "check"):
        assert run(["sweep", verb, "a.sqlite", "--out", "./a.sqlite"]) == 2
    assert run(["bench", "table", "a.sqlite", "--out", "a.sqlite"]) == 2
    assert (tmp_path / "a.sqlite").read_bytes() == kept
    assert "--out: expected a file other than" in capsys.readouterr().err

    assert run(["maps", "maze:9x7", "--out", "map.png"]) == 0
    known = (tmp_path / "map.png").read_bytes()
    assert run(["map", "map.png", "--particles", "3", "--out", "."]) == 2, "its own map.png"
    assert (tmp_path / "map.png").read_bytes() == known
    assert "map.png: it is an input" in capsys.readouterr().err


def test_an_episode_is_replayed_in_its_folder(tmp_path, capsys):
    assert run(["map", "line:9", "--particles", "3", "--out", str(tmp_path)]) == 0
    before = (tmp_path / "episode.npz").read_bytes()
    assert run(["replay", str(tmp_path / "episode.npz"), "--out", str(tmp_path)]) == 0
    assert (tmp_path / "episode.npz").read_bytes() == before


def test_the_json_stands_alone_whatever_a_users_policy_prints(tmp_path, monkeypatch, capsys):
    (tmp_path / "talking.py").write_text(
        "from shoal.swarm.policies import ClosestFrontier\n\nprint('loaded')\n"
        "talking = ClosestFrontier()\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    assert run(["map", "line:9", "--particles", "3", "--policy", "talking:talking", "--json"]) == 0
    shown = capsys.readouterr()
    assert json.loads(shown.out)["status"] == ["complete"]
    assert "loaded" in shown.err


def test_targets_that_were_missed_are_counted(capsys):
    told = ["search", "square:60", "--robots", "2", "--targets", "3", "--seed", "1"]
    assert run([*told, "--detection", "0.2", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["targets"] == {"there": 3, "found": 1}
    assert run([*told, "--detection", "0.2"]) == 0
    assert "1 of 3 found" in capsys.readouterr().out


def test_a_sweep_of_the_studio_keeps_the_files_of_others(tmp_path):
    folder, mine = Folder(tmp_path), "# my notes\n" + SWEEP
    (tmp_path / "a.toml").write_text(mine)
    other = SWEEP.replace('"a"', '"b"')
    with pytest.raises(InvalidInputError, match=r"store: expected one whose file a\.toml is free"):
        run_missing_trials(folder, {"toml": other, "store": "a.sqlite"}, lambda *_: None)
    assert (tmp_path / "a.toml").read_text() == mine
    with pytest.raises(InvalidInputError, match="sweep: expected b, got 'c'"):
        run_missing_trials(folder, {"toml": other, "sweep": "c"}, lambda *_: None)


@pytest.mark.parametrize(
    "about",
    [
        {"sweep": {"name": "x", "problem": 5}},
        {"sweep": {"name": "x", "problem": {"kind": "line"}, "axes": [1]}},
        {"toml": SWEEP.replace("[1, 2]", "[2024-01-01]")},
        {"toml": SWEEP.replace("[1, 2]", "[nan]")},
    ],
)
def test_a_draft_of_a_sweep_is_answered_whatever_is_typed(tmp_path, about):
    answer = new_sweep(Folder(tmp_path), about)
    assert "expected" in answer["error"]
    json.dumps(answer, allow_nan=False)
