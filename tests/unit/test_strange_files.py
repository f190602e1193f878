"""Problem and sweep files with anything in them: one sentence, no traceback, no long wait."""

from __future__ import annotations

import os
import signal
import stat

import numpy as np
import pytest

import shoal
from shoal import parts
from shoal.cli import run
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.lab import Sweep
from shoal.lab.coordinator import prepare
from shoal.lab.database import connect
from shoal.missions import read_mission
from shoal.robots.journal import Journal

HUGE = "1" + "0" * 400
PLACES = {
    "swarm": '"map": "line:9"',
    "steering": '"workspace": "square"',
    "search": '"region": "square:60"',
}
VALUES = [
    HUGE,
    "-" + HUGE,
    "9" * 5000,
    "1e999",
    "NaN",
    "Infinity",
    '"\\ud800"',
    "[" * 60 + "]" * 60,
    "[" * 50_000,
    '{"a": 1}',
    "null",
    "true",
    "[1, 2, 3]",
    '""',
    '"x:y:z"',
    "[null]",
    '[["\\ud800"]]',
    f"[[{HUGE}, 1]]",
    '"' + "a" * 100_000 + '"',
]
TOML = """
name = "x"
trials = {0}
seed = {1}
paired = {2}
[problem]
kind = {3}
map = "line:9"
particles = {4}
[axes]
max_moves = {5}
"""
GOOD = ["1", "0", "[]", '"swarm"', "3", "[5]"]
TOML_VALUES = [
    HUGE,
    "-" + HUGE,
    "9" * 5000,
    "1e999",
    "nan",
    "inf",
    '"\\ud800"',
    "[" * 60 + "]" * 60,
    "[" * 3000 + "]" * 3000,
    "{a = 1}",
    "true",
    '""',
    f"{{from = 1, to = {HUGE}, step = 1}}",
    "{from = 1, to = 1e300, step = 1}",
    f"{{from = 1, to = {HUGE}, count = 5}}",
    f'{{from = {HUGE}, to = {HUGE}, count = 3, scale = "log"}}',
    "{from = 1, to = 9, step = 0}",
    "1979-05-27T07:32:00Z",
    '"os:system"',
]


def is_taken_or_refused(load):
    """Tell whether something is taken, or refused in one short sentence."""
    try:
        load()
    except ShoalError as error:
        return len(str(error)) < 700 and "\n" not in str(error)
    return True


@pytest.mark.parametrize("part", parts.PARTS)
def test_problem_files(part, tmp_path):
    path = tmp_path / "problem.json"
    for name, declared in parts.problem_type(part).declarations().items():
        for value in VALUES:
            place = "" if declared.required or name == "workspace" else f", {PLACES[part]}"
            path.write_text(f'{{"kind": "{part}"{place}, "{name}": {value}}}')
            assert is_taken_or_refused(lambda: shoal.load_problem(path)), (name, value[:60])


def test_sweep_files(tmp_path):
    path = tmp_path / "sweep.toml"
    for number in range(len(GOOD)):
        for value in TOML_VALUES:
            path.write_text(TOML.format(*GOOD[:number], value, *GOOD[number + 1 :]))
            assert is_taken_or_refused(lambda: prepare(Sweep.load(path))), (number, value[:60])
    for raw in (
        b"\xff\xfe",
        b'name = "\xe9"',
        b"\0",
        b"a = " + b"[" * 100_000,
        b"a." * 5000 + b"a = 1",
        b"",
        b"x" * 11_000_000,
    ):
        path.write_bytes(raw)
        with pytest.raises(ShoalError):
            Sweep.load(path)


def test_an_episode_that_unfolds_to_millions_of_commands_is_not_unfolded(tmp_path, monkeypatch):
    path = tmp_path / "episode.npz"
    shoal.run("line:9", particles=3, policy="closest-frontier").save(path)
    with np.load(path) as archive:
        arrays = dict(archive)
    np.savez_compressed(path, **arrays | {"commands": np.zeros(30_000_000, dtype=np.int8)})
    monkeypatch.setattr(np, "load", None)  # what would unfold it
    with pytest.raises(
        InvalidInputError, match="commands: expected at most 20000000 bytes, got 30000128"
    ):
        shoal.load(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes have names on POSIX only")
def test_pipes_are_neither_read_nor_replaced(tmp_path, capsys):
    """A reader of a pipe waits until somebody writes, and a file in its place was no pipe any
    more. The alarm ends what waits.
    """
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    onnx, plan, text = (tmp_path / name for name in ("n.onnx", "robot-01.plan", "map.txt"))
    for name in (onnx, plan, text, tmp_path / "task.key"):
        os.mkfifo(name)
    search = "search square:60 --robots 1 --footprint 20 --vehicle multirotor --prepare"
    signal.alarm(60)
    try:
        with pytest.raises(InvalidInputError, match="state of a robot, got a pipe or a device"):
            Journal(pipe, "search", 1)
        with pytest.raises(InvalidInputError, match="mission file, got a pipe or a device"):
            read_mission(plan)
        with pytest.raises(InvalidInputError, match="a store, got a pipe or a device"):
            connect(pipe, write=True)
        for words, said in (
            (f"map line:9 --policy model:{onnx}", "expected a file, got"),
            (f"{search} {tmp_path}", "task.key: it is a pipe or a device"),
            (f"maps line:9 --out {text}", "map.txt: it is a pipe or a device"),
            (f"maps {text} --out {tmp_path / 'other.txt'}", "map, got a pipe or a device"),
        ):
            assert run(words.split()) == 2, words
            assert said in " ".join(capsys.readouterr().err.split())
    finally:
        signal.alarm(0)
    assert all(stat.S_ISFIFO(one.stat().st_mode) for one in (pipe, onnx, plan, text))
