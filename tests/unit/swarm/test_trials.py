"""Several drives after one another, with their success rate."""

import csv
import io
import json
import sys

import pytest
from tests.unit.swarm.test_rigs import ROOT

from shoal import open_map
from shoal.cli import run as shoal
from shoal.rigs import read_log

SMALL = ["drive", "maze:9x7", "--particles", "3", "--policy", "closest-frontier"]


def rig(tmp_path):
    """Return the options that name the reference rig."""
    (tmp_path / "map.txt").write_text(f"{open_map('maze:9x7')}\n")
    run = f"{sys.executable} {ROOT / 'examples' / 'rig.py'} {tmp_path / 'map.txt'} --particles 3"
    return ["--rig", f"exec:{run}"]


def test_trials_of_a_simulation(tmp_path, capsys):
    out = tmp_path / "out"
    assert shoal([*SMALL, "--trials", "2", "--seed", "5", "--out", str(out), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["trials"], result["successes"], result["success_rate"]) == (2, 2, 1)
    assert result["success_interval"] == pytest.approx([0.025**0.5, 1])  # both
    moves = [row["moves"] for row in result["each"]]
    assert result["moves"]["mean"] == pytest.approx(sum(moves) / 2)
    rows = list(csv.DictReader((out / "trials.csv").read_text().splitlines()))
    assert [int(row["moves"]) for row in rows] == moves
    assert (out / "frames.png").exists()
    for number, made in enumerate(moves, start=1):
        log = read_log(out / f"trial-{number:03d}" / "log.jsonl")
        assert (len(log.commands), log.seed) == (made, 4 + number)
    # each trial is the drive of its seed
    assert shoal([*SMALL, "--seed", "6", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["moves"] == moves[1]


def test_trials_go_on(tmp_path, capsys):
    whole, out = tmp_path / "whole", tmp_path / "out"
    words = [*SMALL, "--seed", "5", "--json"]
    assert shoal([*words, "--trials", "3", "--out", str(whole)]) == 0
    expected = json.loads(capsys.readouterr().out)
    assert shoal([*words, "--trials", "2", "--out", str(out)]) == 0
    capsys.readouterr()
    # the second one was interrupted, and the rest never begun
    log = out / "trial-002" / "log.jsonl"
    log.write_text("".join(log.read_text().splitlines(keepends=True)[:20]))
    first = (out / "trial-001" / "log.jsonl").read_bytes()
    assert shoal(["drive", "--resume", str(out), "--trials", "3", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    compared = ("trial", "seed", "status", "success", "moves", "scans", "free_cells")
    for mine, other in zip(result["each"], expected["each"], strict=True):
        assert [mine[name] for name in compared] == [other[name] for name in compared]
    assert (out / "trial-001" / "log.jsonl").read_bytes() == first
    assert len(list(csv.DictReader((out / "trials.csv").read_text().splitlines()))) == 3
    for number in range(1, 4):
        assert [one.name for one in (out / f"trial-{number:03d}").glob("log*")] == ["log.jsonl"]


def test_trials_that_cannot_go_on(tmp_path, capsys):
    out = tmp_path / "out"
    assert shoal([*SMALL, "--trials", "2", "--seed", "5", "--out", str(out)]) == 0
    capsys.readouterr()
    for words, why in (
        (["--resume", str(tmp_path), "--trials", "2"], "in which no trial was begun"),
        (["--resume", str(out), "--trials", "2", "--seed", "6"], "seed: expected 5 as in"),
        (["--resume", str(out)], "expected a log, got a folder"),
        (["--resume", str(out), "--trials", "2", "--out", "there"], "where the trials go on"),
    ):
        assert shoal(["drive", *words]) == 2
        assert why in capsys.readouterr().err.lower().replace("\n", " ")


def test_a_trial_that_fails_counts(tmp_path, capsys):
    assert shoal([*SMALL, "--trials", "2", "--max-moves", "5"]) == 1
    said = capsys.readouterr()
    assert "0 of 2 trials (0 %, 95 % interval 0 to 84 %)" in said.out
    assert "trial 2 of 2: limit after 5 moves" in said.err


def test_a_real_rig_is_reset_between_trials(tmp_path, capsys, monkeypatch):
    reset = tmp_path / "reset.py"
    reset.write_text(f"open({str(tmp_path / 'resets')!r}, 'a').write('.')")
    words = [*SMALL, *rig(tmp_path), "--trials", "3"]
    assert shoal([*words, "--between", f"{sys.executable} {reset}", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["successes"] == 3
    assert (tmp_path / "resets").read_text() == ".."
    answers = io.StringIO("\n")
    monkeypatch.setattr(answers, "isatty", lambda: True)
    monkeypatch.setattr(sys, "stdin", answers)
    assert shoal([*words[:-1], "2", "--json"]) == 0
    said = capsys.readouterr()
    assert "trial 2 of 2: reset the particles, then press Enter" in said.err
    assert json.loads(said.out)["trials"] == 2


def test_options_of_trials_that_make_no_sense(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    for words, said in (
        (["--trials", "0"], "trials: expected a whole number, 1 or more"),
        (["--between", "true"], "between: expected several --trials beside it, got 1"),
        (["--trials", "2", "--log", "x.jsonl"], "log: expected one drive"),
        ([*rig(tmp_path), "--trials", "2"], "trials: expected --between COMMAND"),
        (["--trials", "2", "--between", "'"], "between: expected a command"),
        (["--trials", "2", "--between", "false"], "'false' resets the rig before trial 2"),
    ):
        assert shoal([*SMALL, *words]) == 2, words
        err = capsys.readouterr().err.splitlines()[-1]
        assert said in err
