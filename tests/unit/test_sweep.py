"""Sweeps: what they declare, that results depend on nothing but it, and that a store survives."""

from __future__ import annotations

import errno
import json
import os
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.unit.sweep_functions import versions_at_the_second_start

import shoal
from shoal.cli import run as command
from shoal.core.errors import InvalidInputError, OutputError, UnknownNameError
from shoal.core.version import digest_of_folder
from shoal.lab import Store, Sweep, run_sweep, sweep_of
from shoal.lab.batches import MixedVersionsWarning, check_versions, versions_text, worker_versions
from shoal.lab.database import FORMAT
from shoal.lab.exchange import export, frame
from shoal.lab.statistics import number_text
from shoal.lab.store import ResultTexts, faults_of, is_locked, locked, trial_numbers
from shoal.lab.sweep import differences, trial_seed
from shoal.lab.workers import Processes

HERE = "tests.unit.sweep_functions"
NUMBER = {"kind": "function", "function": f"{HERE}:number"}
SWARM = {"kind": "swarm", "map": "maze:9x7"}


def numbers(**changes):
    return Sweep(
        **{
            "name": "numbers",
            "problem": NUMBER,
            "axes": {"factor": [1, 2, 3]},
            "trials": 7,
            "seed": 5,
        }
        | changes
    )


def rows_of(path, name="numbers"):
    with Store(path) as store:
        assert faults_of(store) == []
        return [*store.rows(name)]


# What a sweep declares


def test_file_and_object_are_the_same_sweep(tmp_path):
    file = tmp_path / "sweep.toml"
    file.write_text(
        'name = "s"\ntrials = 3\nseed = 4\npaired = ["policy"]\n[problem]\nkind = "swarm"\nmap ='
        ' "maze:9x7"\n[axes]\npolicy = ["closest-frontier", "random-moves"]\nparticles = { from ='
        " 2, to = 6, step = 2 }\n"
    )
    axes = {"policy": ["closest-frontier", "random-moves"], "particles": [2, 4, 6]}
    written = Sweep(name="s", problem=SWARM, axes=axes, trials=3, seed=4, paired=("policy",))
    assert Sweep.load(file) == written == sweep_of(json.loads(json.dumps(written.describe())))
    assert [point.values["particles"] for point in written.points] == [2, 4, 6] * 2
    assert written.total == 18


def test_seeds_depend_on_the_problem_and_not_on_its_place():
    axes = {"policy": ["closest-frontier", "random-moves"], "particles": [2, 4]}
    one = Sweep(name="a", problem=SWARM, axes=axes, seed=1)
    other = Sweep(
        name="b",
        problem=SWARM | {"rule": "block"},
        axes={"particles": [9, 4, 2], "policy": [*axes["policy"]]},
        seed=1,
    )
    seeds = {tuple(sorted(point.values.items())): point.seeds for point in other.points}
    assert all(seeds[tuple(sorted(point.values.items()))] == point.seeds for point in one.points)
    assert len({point.seeds for point in one.points}) == 4
    paired = Sweep(name="a", problem=SWARM, axes=axes, seed=1, paired=("policy",))
    assert len({point.seeds for point in paired.points}) == 2
    assert len({point.key for point in paired.points}) == 4
    many = {
        trial_seed(seed, text, trial)
        for seed in range(20)
        for text in ("a", "b")
        for trial in range(200)
    }
    assert len(many) == 8000
    assert max(many) < 2**63


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"name": "../x"}, "name: expected at most 80 letters, digits"),
        ({"trials": 0}, "trials: expected a whole number from 1"),
        ({"seed": -1}, "seed: expected a whole number from 0"),
        ({"axes": {"factor": []}}, "axes.factor: expected one value or more, got none"),
        ({"axes": {"factor": 3}}, "axes.factor: expected a list of values or a range, got 3"),
        (
            {"axes": {"factor": [1, 1]}},
            "expected points that differ, got factor = 1 and factor = 1",
        ),
        (
            {"axes": {"factor": {"from": 1, "to": 5}}},
            "axes.factor: expected either step or count, got neither",
        ),
        (
            {"axes": {"factor": {"from": 1, "to": 5, "step": -1}}},
            "expected a step that leads from 1 to 5, got -1",
        ),
        (
            {"axes": {"factor": {"from": 0, "to": 5, "count": 3, "scale": "log"}}},
            "between numbers above 0, got 0 to 5",
        ),
        (
            {"axes": {"factor": {"from": 0, "to": 5, "steps": 3}}},
            "axes.factor: steps: expected no such field",
        ),
        ({"axes": {"factor": {"from": 0, "to": 500000, "step": 1}}}, "expected at most 100000"),
        ({"axes": {"factor": [float("nan")]}}, "expected finite numbers, got nan"),
        ({"paired": ("nothing",)}, r"paired: expected names of axes \(factor\), got 'nothing'"),
        ({"problem": {"kind": "poetry"}}, "expected a kind, one of swarm, search, steering, line"),
        ({"problem": {"map": "line:5"}}, "expected a kind"),
        (
            {"problem": SWARM, "axes": {"particles": ["few"]}},
            (
                "problem at particles = few: particles: expected a whole number from 1 to"
                " 268435456, got 'few'"
            ),
        ),
        (
            {"problem": SWARM, "axes": {"legs": [4]}},
            "problem at legs = 4: legs: expected no such field, got 4",
        ),
        ({"problem": {"kind": "swarm"}, "axes": {}}, "problem: map: expected this field, got none"),
    ],
)
def test_wrong_sweeps_are_refused(changes, words):
    with pytest.raises(InvalidInputError, match=words):
        numbers(**changes)


@pytest.mark.parametrize(
    ("problem", "words"),
    [
        (
            SWARM | {"particles": 40},
            "sweep s: particles: expected 1 to 39 .the free cells of maze:9x7., got 40",
        ),
        (SWARM | {"policy": "closest"}, "problem: unknown policy 'closest': did you mean"),
        ({"kind": "schedule", "schedule": "one-jump:5"}, "schedule M=5|one"),
        ({"kind": "steering", "goal_x": 0.5}, "goal_x, goal_y: expected both or none, got one"),
        (
            {"kind": "search", "region": "square:50", "robots": 1, "crashes": 2},
            "crashes: expected at most 1",
        ),
        (NUMBER | {"arguments": {"speed": 3}}, "got an unexpected keyword argument 'speed'"),
        ({"kind": "function", "function": "os:getcwd"}, "function os:getcwd: "),
    ],
)
def test_what_no_trial_could_play_is_refused_before_any_work(problem, words, tmp_path):
    with pytest.raises((InvalidInputError, UnknownNameError), match=words):
        run_sweep(Sweep(name="s", problem=problem), tmp_path / "store.sqlite", workers=0)


SEARCH = {"kind": "search", "region": "square:60", "robots": 2, "footprint": 10}


@pytest.mark.parametrize(
    ("problem", "axes", "words"),
    [
        (
            SEARCH,
            {"tour": ["auto", "tests.unit.sweep_functions:number"]},
            "at tour = tests.unit.* expected name, dimensions and make",
        ),
        (SEARCH, {"tour": ["comb", "nope"]}, "at tour = nope: unknown tour 'nope'"),
        (
            SEARCH,
            {"allocation": ["hop", "tests.unit.sweep_functions:number"]},
            "at allocation = tests.*: expected arcs for each of 2",
        ),
        (
            SEARCH,
            {"allocation": ["hop", "hops"]},
            "at allocation = hops: unknown allocation 'hops'",
        ),
        (
            SEARCH,
            {"starts": ["random", "none.csv"]},
            "at starts = none.csv: none.csv: expected a table of start positions",
        ),
        (
            SEARCH,
            {"launch": ["5,5", "1,1;2,2;3,3"]},
            "at launch = 1,1;2,2;3,3: launch: expected one point for all, or 2",
        ),
        (
            SEARCH,
            {"land": ["5,5", "none.csv"]},
            "at land = none.csv: none.csv: expected a table of landing points",
        ),
        (
            SEARCH,
            {"targets": [36, 37]},
            (
                "at targets = 37: targets: expected a number from 0 to 36, one per cell without an"
                " obstacle, got 37"
            ),
        ),
        (
            SEARCH,
            {"obstacles": [3, 36]},
            (
                "at obstacles = 36: obstacles: expected a number from 0 to 3., no obstacle at the"
                " start"
            ),
        ),
        (
            SEARCH,
            {"footprint": [10, 0.01]},
            "at footprint = 0.01: footprint: expected at most 4000000 cells",
        ),
        (
            SEARCH,
            {"margin": [0, 40]},
            "sweep s, at margin = 40: margin: expected a margin that leaves some area",
        ),
        (SEARCH, {"key": ["none"]}, "at key = none: none: expected a readable file with a key"),
        (
            SEARCH,
            {"network": ["perfect", "forgeries:0.5"]},
            "at network = forgeries:0.5: network: expected a key",
        ),
        (
            SEARCH | {"simulate": False},
            {"loss": [0, 0.5]},
            "at loss = 0.5: search: loss or a network: expected a simulation",
        ),
        (
            SWARM | {"particles": 3},
            {"placement": ["uniform", "json:dumps"]},
            "at placement = json:dumps: .*",
        ),
        (
            SWARM | {"particles": 3},
            {"policy": ["best", "json:dumps"]},
            "at policy = json:dumps: policy: expected a name, or an",
        ),
        (
            {"kind": "steering"},
            {"planner": ["shortest", "json:dumps"]},
            "at planner = json:dumps: planner: expected a name",
        ),
        (
            {"kind": "steering"},
            {"workspace": ["square", "none.json"]},
            "at workspace = none.json: none.json: expected a workspace",
        ),
    ],
)
def test_a_point_that_cannot_run_is_refused_before_the_first_trial(problem, axes, words, tmp_path):
    store = tmp_path / "store.sqlite"
    with pytest.raises((InvalidInputError, UnknownNameError), match=words):
        run_sweep(Sweep(name="s", problem=problem, axes=axes), store, workers=0)
    assert not store.exists()


def test_an_extension_that_cannot_run_adds_nothing(tmp_path):
    store = tmp_path / "store.sqlite"
    run_sweep(Sweep(name="s", problem=SEARCH, axes={"targets": [1]}), store, workers=0)
    with pytest.raises(InvalidInputError, match="at targets = 37: "):
        run_sweep(
            Sweep(name="s", problem=SEARCH, axes={"targets": [1, 2, 37]}),
            store,
            workers=0,
            extend=True,
        )
    with Store(store) as opened:
        assert [values for _, values in opened.points("s")] == [{"targets": 1}]
        assert opened.status("s").complete


def test_ranges():
    values = numbers(axes={"factor": {"from": 0, "to": 1, "step": 0.1}}).axes["factor"]
    assert values == (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    assert numbers(axes={"factor": {"from": 0.5, "to": 2, "count": 4}}).axes["factor"] == (
        0.5,
        1.0,
        1.5,
        2.0,
    )


# Every kind of problem


@pytest.mark.parametrize(
    ("problem", "some"),
    [
        (SWARM | {"particles": 5, "task": "subset-coverage:fraction=0.5"}, {"status": "complete"}),
        ({"kind": "line", "cells": 20, "particles": 20}, {"boundary": 2.0, "largest_gap": 0.0}),
        (
            {"kind": "schedule", "schedule": "every-step", "distance": 5},
            {"distance": 5, "moves": 6, "scans": 7},
        ),
        ({"kind": "steering", "tolerance": 1e-3, "planner": "greedy"}, {"status": "solved"}),
        (
            {
                "kind": "steering",
                "workspace": "disk",
                "start": ((0.1, 0), (0.3, 0)),
                "goal": ((0, 0),) * 2,
                "goal_x": 0.4,
                "goal_y": 0.4,
            },
            {"status": "unreachable", "moves": 0},
        ),
        (
            {"kind": "search", "region": "square:60", "robots": 3, "crashes": 2},
            {"status": "complete", "cells": 36},
        ),
        (
            {"kind": "search", "region": "square:60", "robots": 3, "simulate": False},
            {"status": "complete", "sent": 0},
        ),
    ],
    ids=lambda value: value.get("kind") if "kind" in value else "",
)
def test_kinds(problem, some, tmp_path):
    sweep = Sweep(name="numbers", problem=problem, trials=2)
    assert run_sweep(sweep, tmp_path / "s.sqlite", workers=0).failures == 0
    with Store(tmp_path / "s.sqlite") as store:
        columns = store.columns("numbers")
    for row in rows_of(tmp_path / "s.sqlite"):
        found = dict(zip(columns, row, strict=True))
        assert {name: found[name] for name in some} == some


def test_a_row_replays_by_its_seed(tmp_path, capsys):
    run_sweep(
        Sweep(name="numbers", problem=SWARM | {"particles": 4}, trials=3),
        tmp_path / "s.sqlite",
        workers=0,
    )
    for _, seed, status, moves, *_ in rows_of(tmp_path / "s.sqlite"):
        assert command(["map", "maze:9x7", "-n", "4", "--seed", str(seed), "--json"]) == 0
        result = json.loads(capsys.readouterr().out)
        assert (result["status"], result["moves"]) == ([status], [moves])


# Whatever happens


def test_same_rows_for_any_workers_and_batches(tmp_path):
    tables = []
    for name, options in (
        ("a", {"workers": 0}),
        ("b", {"workers": 1, "batch_seconds": 0.001}),
        ("c", {"workers": 2, "batch_seconds": 0.001}),
        ("d", {"workers": 4, "batch_seconds": 0.001}),
        ("e", {"workers": 0, "batch_seconds": 50}),
    ):
        assert run_sweep(numbers(), tmp_path / name, **options).complete
        tables.append(rows_of(tmp_path / name))
    assert all(table == tables[0] for table in tables)
    assert [row[:2] for row in tables[0]] == [
        (factor, trial) for factor in (1, 2, 3) for trial in range(7)
    ]


def test_resume_plays_only_what_is_missing(tmp_path):
    store = tmp_path / "s.sqlite"
    run_sweep(numbers(), store, workers=0)
    whole = rows_of(store)
    with sqlite3.connect(store) as connection:
        connection.execute("DELETE FROM trials WHERE trial IN (0, 3, 4) AND point = 2")
    connection.close()
    told = []
    run_sweep(numbers(), store, workers=0, on_progress=told.append)
    assert rows_of(store) == whole
    assert (told[0].done, told[-1].done, told[-1].fresh) == (18, 21, 3)


def test_several_sweeps_in_one_file_and_a_changed_one_is_refused(tmp_path):
    store = tmp_path / "s.sqlite"
    run_sweep(numbers(), store, workers=0)
    run_sweep(numbers(name="other", trials=2), store, workers=0)
    before = rows_of(store)
    with pytest.raises(
        InvalidInputError,
        match=(
            r"numbers as the store contains it, got changes: axes.factor: \[1, 2, 3\] -> \[1\];"
            r" trials: 7 -> 9"
        ),
    ):
        run_sweep(numbers(axes={"factor": [1]}, trials=9), store, workers=0)
    with pytest.raises(InvalidInputError, match="seed: 5 -> 6"):
        run_sweep(numbers(seed=6), store, workers=0, extend=True)
    assert rows_of(store) == before
    assert (
        run_sweep(
            numbers(axes={"factor": [4, 1, 2, 3]}, trials=9), store, workers=0, extend=True
        ).total
        == 36
    )
    after = rows_of(store)
    assert {*before} < {*after}
    assert len(after) == 36
    with Store(store) as opened:
        assert opened.names == ["numbers", "other"]
        with pytest.raises(InvalidInputError, match="one of numbers, other"):
            opened.only(None)
        with pytest.raises(
            UnknownNameError, match=r"no sweep 'third' \(sweeps of this store: numbers, other\)"
        ):
            opened.only("third")


def test_a_sweep_that_never_began_may_change(tmp_path):
    store = tmp_path / "s.sqlite"
    with pytest.raises(InvalidInputError, match="workers: expected a whole number"):
        run_sweep(numbers(trials=9), store, workers=-1)
    run_sweep(numbers(name="other", trials=2), store, workers=0)
    assert run_sweep(numbers(axes={"factor": [1]}), store, workers=0).total == 7
    with Store(store) as opened:
        assert sorted(opened.names) == ["numbers", "other"]
        assert faults_of(opened) == []


def test_another_map_under_the_same_name_is_refused(tmp_path):
    picture, store = tmp_path / "map.txt", tmp_path / "s.sqlite"
    picture.write_text("....\n....\n")
    sweep = Sweep(name="numbers", problem={"kind": "swarm", "map": str(picture), "particles": 2})
    run_sweep(sweep, store, workers=0)
    picture.write_text("....\n.#..\n")
    with pytest.raises(InvalidInputError, match=r"changes: content\."):
        run_sweep(sweep, store, workers=0)


def test_failures_are_kept_and_tried_again(tmp_path, capsys):
    def sweep(limit):
        return Sweep(
            name="numbers",
            problem={
                "kind": "function",
                "function": f"{HERE}:picky",
                "arguments": {"limit": limit},
            },
            trials=40,
        )

    status = run_sweep(sweep(3), tmp_path / "s", workers=0)
    assert 0 < status.failures < 40
    assert status.done == 40 - status.failures
    with Store(tmp_path / "s") as store:
        values, trial, seed, error = store.failures("numbers")[0]
        assert (values, error) == ({}, f"RuntimeError: seed {seed} is one that I do not like")
        assert seed == trial_seed(0, store.sweep("numbers").points[0].seeds, trial)
    assert run_sweep(sweep(3), tmp_path / "s", workers=0).failures == status.failures
    with sqlite3.connect(tmp_path / "s") as connection:  # as if the function had been mended
        connection.execute("UPDATE failures SET trial = 1000 + trial")
        connection.execute(
            "INSERT INTO trials SELECT point, trial - 1000, seed, batch, '[1]' FROM failures"
        )
        connection.execute("UPDATE failures SET trial = trial - 1000")
    connection.close()
    assert run_sweep(sweep(3), tmp_path / "s", workers=0).complete
    assert (
        run_sweep(
            Sweep(name="inf", problem={"kind": "function", "function": f"{HERE}:endless"}),
            tmp_path / "s",
            workers=0,
        ).failures
        == 1
    )


def test_a_dead_worker_is_replaced_and_a_deadly_trial_given_up(tmp_path, monkeypatch):
    for times, failures in ((1, 0), (99, None)):
        folder = tmp_path / str(times)
        folder.mkdir()
        monkeypatch.chdir(folder)  # a path in the problem would change its seeds
        arguments = {"folder": ".", "times": times}
        sweep = Sweep(
            name="numbers",
            problem={"kind": "function", "function": f"{HERE}:deadly", "arguments": arguments},
            trials=8,
            seed=3,
        )
        told = []
        status = run_sweep(sweep, folder / "s.sqlite", workers=1, on_progress=told.append)
        deadly = sum(trial_seed(3, sweep.points[0].seeds, k) % 10 == 3 for k in range(8))
        assert deadly
        assert told[-1].deaths > 0
        assert status.failures == (deadly if failures is None else 0)
        assert status.done == 8 - status.failures


COORDINATOR = """
import sys
from shoal.lab import Sweep, run_sweep
problem = {"kind": "function", "function": "tests.unit.sweep_functions:number", "arguments": {"pause": 0.004}}
sweep = Sweep(name="numbers", problem=problem, axes={"factor": [1, 2]}, trials=150, seed=5)
run_sweep(sweep, sys.argv[1], workers=2, batch_seconds=0.02)
"""


def test_a_worker_that_is_killed_in_the_middle_of_an_answer_is_seen(tmp_path, monkeypatch):
    monkeypatch.setattr("shoal.lab.coordinator.LOOK", 0.1)
    problem = {"kind": "function", "function": f"{HERE}:torn"}
    arguments = {"mark": [str(tmp_path / "mark")]}
    sweep = Sweep(name="s", problem=problem, axes=arguments, trials=4)
    status = run_sweep(sweep, tmp_path / "s", workers=1)
    assert (status.done, status.failures) == (4, 0)


def test_a_worker_that_is_killed_at_its_start_is_replaced(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("shoal.lab.workers.worker_versions", versions_at_the_second_start)
    assert run_sweep(numbers(), tmp_path / "s", workers=1).complete
    assert (tmp_path / "started").exists()


def test_a_script_without_a_main_guard_is_told(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(COORDINATOR)
    root = str(Path(__file__).parents[2])
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([root, *sys.path])}
    ended = subprocess.run(
        [sys.executable, str(script), str(tmp_path / "s")],
        check=False,
        cwd=root,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 1
    assert "call run_sweep under if __name__ == '__main__'" in ended.stderr.splitlines()[-1]
    assert ended.stderr.count("Traceback") == 1
    assert done_of(tmp_path / "s") == 0


def test_killed_coordinators_lose_nothing(tmp_path):
    """A short form of ``python -m benchmarks.kills``."""
    store, whole = tmp_path / "killed.sqlite", tmp_path / "whole.sqlite"
    root = str(Path(__file__).parents[2])
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([root, *sys.path])}
    for wanted in (20, 140):
        coordinator = subprocess.Popen(
            [sys.executable, "-c", COORDINATOR, str(store)], cwd=root, env=environment
        )
        deadline = time.monotonic() + 60
        while coordinator.poll() is None and (not store.exists() or done_of(store) < wanted):
            assert time.monotonic() < deadline
            time.sleep(0.01)
        if wanted == 20:
            with pytest.raises(
                InvalidInputError,
                match=(
                    rf"no process is running, got .*, which process {coordinator.pid} on .* is"
                    r" running"
                ),
            ):
                run_sweep(numbers(), store, workers=0)
            assert is_locked(store, "numbers")
        coordinator.send_signal(signal.SIGKILL)
        assert coordinator.wait() == -signal.SIGKILL
        with Store(store) as opened:
            assert faults_of(opened) == []
        assert not is_locked(store, "numbers")
    problem = NUMBER | {"arguments": {"pause": 0.004}}
    sweep = numbers(problem=problem, axes={"factor": [1, 2]}, trials=150)
    told = []
    run_sweep(sweep, store, workers=0, on_progress=told.append)
    assert 140 <= told[0].done < 300
    run_sweep(sweep, whole, workers=0)
    assert rows_of(store) == rows_of(whole)


def done_of(store):
    try:
        with Store(store) as opened:
            return opened.status("numbers").done if opened.names else 0
    except InvalidInputError:  # its first page is not written yet
        return 0


def test_workers_with_other_versions_are_refused():
    check_versions(worker_versions(), worker="w")
    with pytest.raises(
        InvalidInputError,
        match=r"worker w: expected the versions of this process, got numpy 1\.0 instead of 2",
    ):
        check_versions(worker_versions() | {"numpy": "1.0"}, worker="w")
    with pytest.raises(InvalidInputError, match="code none instead of"):
        check_versions(
            {name: value for name, value in worker_versions().items() if name != "code"}, worker="w"
        )


@pytest.mark.parametrize(
    "changed",
    [
        "core/a.py",
        "jit/a.py",
        "papers/a.py",
        "papers/b.json",
        "swarm/deep/a.npz",
        "parts.py",
        "cli/a.py",
    ],
)
def test_the_digest_of_the_code_covers_all_on_which_results_depend(changed, tmp_path):
    for name in (
        "core/a.py",
        "jit/a.py",
        "papers/a.py",
        "papers/b.json",
        "swarm/deep/a.npz",
        "parts.py",
        "cli/a.py",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("a = 1")
    before = digest_of_folder(tmp_path)
    (tmp_path / changed).write_text("a = 2")
    assert (digest_of_folder(tmp_path) == before) == changed.startswith("cli")


def test_going_on_with_another_version_is_told(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("sweep.toml").write_text(SPEC)
    go = ["sweep", "run", "sweep.toml", "--store", "s.sqlite", "--workers", "0"]
    assert command(go) == 0
    ours, old = worker_versions(), worker_versions() | {"shoal": "0.0.9", "code": "beef"}
    with Store("s.sqlite") as store:
        assert (
            store.versions("corridors")
            == store.status("corridors").versions
            == {versions_text(ours): 16}
        )
        whole = [*store.rows("corridors")]
    assert "version" not in capsys.readouterr().err
    with sqlite3.connect("s.sqlite") as connection:
        connection.execute("UPDATE batches SET version = ?", (versions_text(old),))
        connection.execute("DELETE FROM trials WHERE point = 2")
    connection.close()
    assert command([*go, "--json"]) == 0
    captured = capsys.readouterr()
    told = f"12 rows by shoal 0.0.9, code beef; this is shoal {ours['shoal']}, code {ours['code']}"
    assert (
        f"shoal: warning: s.sqlite: sweep corridors: expected rows of this version, got {told}."
        in captured.err
    )
    result = json.loads(captured.out)
    assert result["versions"] == [old | {"rows": 12}, ours | {"rows": 4}]
    assert result["other_versions"]
    assert command(["sweep", "status", "s.sqlite"]) == 0
    assert (
        "corridors: 12 rows by shoal 0.0.9, code beef, 4 rows by shoal" in capsys.readouterr().out
    )
    assert command(["sweep", "summary", "s.sqlite"]) == 0
    assert (
        "expected rows of one version, got 12 rows by shoal 0.0.9, code beef, 4 rows by"
        in capsys.readouterr().err
    )
    assert rows_of("s.sqlite", "corridors") == whole
    with sqlite3.connect("s.sqlite") as connection:
        connection.execute("DELETE FROM trials WHERE point = 1")
    connection.close()
    with pytest.warns(MixedVersionsWarning, match="8 rows by shoal 0.0.9, code beef, 4 rows by"):
        run_sweep(Sweep.load("sweep.toml"), "s.sqlite", workers=0)


# Stores that cannot be used


def test_locks_exclude_each_other(tmp_path):
    with locked(tmp_path / "s", "one"), locked(tmp_path / "s", "two"):
        assert is_locked(tmp_path / "s", "one")
        with (
            pytest.raises(InvalidInputError, match=f"process {os.getpid()} on"),
            locked(tmp_path / "s", "one"),
        ):
            pass
    assert not is_locked(tmp_path / "s", "one")
    assert [*tmp_path.iterdir()] == []


def test_a_lock_holds_on_a_full_disk(tmp_path, monkeypatch):
    def full(*_arguments):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with locked(tmp_path / "s", "one"):
        assert is_locked(tmp_path / "s", "one")


def test_workers_never_see_an_interruption():
    """Not even before they are so far as to ignore it: a terminal's Ctrl-C goes to them, too, and
    each would print a traceback.
    """
    pool = Processes(1)
    assert signal.SIGINT in pool.submit(signal.pthread_sigmask, signal.SIG_BLOCK, ()).result()
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    pool.close(at_once=True)


def test_no_other_file_stays_beside_a_store(tmp_path):
    """A connection that only reads makes the files of the log, and SQLite does not remove them."""
    path = tmp_path / "s.sqlite"

    def beside():
        return sorted(file.name for file in tmp_path.iterdir())

    Store(path, write=True).close()
    with Store(path), Store(path) as other:
        other.close()
        assert beside() == ["s.sqlite", "s.sqlite-shm", "s.sqlite-wal"]
    assert beside() == ["s.sqlite"]
    with Store(path, write=True) as writing:
        Store(path).close()
        assert len(beside()) == 3
        assert writing.names == []
    assert beside() == ["s.sqlite"]
    written = path.stat().st_mtime_ns
    assert command(["sweep", "status", str(path)]) == 0
    assert (beside(), path.stat().st_mtime_ns) == (["s.sqlite"], written)


def test_no_store(tmp_path):
    (tmp_path / "empty").touch()
    (tmp_path / "text").write_text(
        "no database at all, but long enough to have a header of its own" * 40
    )
    with sqlite3.connect(tmp_path / "other") as connection:
        connection.execute("CREATE TABLE music (title)")
    connection.close()
    for name, words in (
        ("nothing", "expected a store, got no such file"),
        ("", "expected a store, got a folder"),
        ("empty", "expected a store or the name of a new file, got an empty file"),
        ("text", "expected a store .an SQLite database., got another kind of file"),
        ("other", "expected a store of Shoal, got another SQLite database"),
    ):
        with pytest.raises(InvalidInputError, match=words):
            Store(tmp_path / name)
    with pytest.raises(InvalidInputError, match="another SQLite database"):
        run_sweep(numbers(), tmp_path / "other", workers=0)
    with pytest.raises(OutputError, match="its folder is missing"):
        run_sweep(numbers(), tmp_path / "no" / "folder" / "s", workers=0)


def test_a_store_of_a_newer_version_is_refused_and_kept(tmp_path):
    store = tmp_path / "s"
    run_sweep(numbers(), store, workers=0)
    with sqlite3.connect(store) as connection:
        connection.execute(f"PRAGMA user_version = {FORMAT + 1}")
    connection.close()
    before = store.read_bytes()
    for write in (False, True):
        with pytest.raises(
            InvalidInputError,
            match=f"format {FORMAT} or below, got format {FORMAT + 1} of a Shoal that is newer",
        ):
            Store(store, write=write)
    assert store.read_bytes() == before


@pytest.mark.parametrize("share", [0.02, 0.3, 0.9])
def test_a_truncated_store_is_told_and_not_made_worse(tmp_path, share):
    store = tmp_path / "s"
    run_sweep(numbers(trials=400), store, workers=0)
    content = store.read_bytes()
    store.write_bytes(content[: int(share * len(content)) + 7])
    cut = store.read_bytes()
    with pytest.raises(InvalidInputError, match=r"damaged or truncated|another kind of file"):
        run_sweep(numbers(trials=400), store, workers=0)
    assert store.read_bytes() == cut


def test_a_changed_value_is_found(tmp_path):
    run_sweep(numbers(), tmp_path / "s", workers=0)
    with sqlite3.connect(tmp_path / "s") as connection:
        connection.execute("UPDATE trials SET seed = seed + 1 WHERE point = 2 AND trial = 4")
        connection.execute("UPDATE trials SET result = '[1]' WHERE point = 3 AND trial = 0")
    connection.close()
    with Store(tmp_path / "s") as store:
        faults = faults_of(store)
    assert [fault.partition(":")[0] for fault in faults] == [
        "sweep numbers, point 1, trial 4",
        "sweep numbers, point 2, trial 0",
    ]
    assert command(["sweep", "check", str(tmp_path / "s"), "--json"]) == 1


def test_a_full_disk_keeps_what_was_committed(tmp_path):
    """A limit on the size of files, which is what the process then meets."""
    script = COORDINATOR.replace(
        "import sys",
        "import resource, signal, sys\nsignal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))",
    )
    for old, new in (
        ("trials=150", "trials=2000"),
        ("0.004", "0.0"),
        ("workers=2", "workers=0"),
        ("0.02", "0.01"),
    ):
        script = script.replace(old, new)
    store, root = tmp_path / "s.sqlite", str(Path(__file__).parents[2])
    # Without the last variable, Python would keep compiled modules that are cut off at the limit.
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([root, *sys.path]),
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    ended = subprocess.run(
        [sys.executable, "-c", script, str(store)],
        cwd=root,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 1
    assert "OutputError: cannot write" in ended.stderr
    assert "the disk is full; every committed batch is kept" in ended.stderr
    sweep = numbers(
        problem=NUMBER | {"arguments": {"pause": 0.0}}, axes={"factor": [1, 2]}, trials=2000
    )
    told = []
    run_sweep(sweep, store, workers=0, on_progress=told.append)
    assert 0 < told[0].done < 4000
    run_sweep(sweep, tmp_path / "whole", workers=0)
    assert rows_of(store) == rows_of(tmp_path / "whole")


def test_a_read_only_store_is_read_and_not_written(tmp_path):
    store = tmp_path / "folder" / "s"
    store.parent.mkdir()
    run_sweep(numbers(), store, workers=0)
    before = store.read_bytes()
    script = (
        "import os, sys\nfrom shoal.lab import Store\nfrom shoal.core.errors import OutputError\n"
        # imports all that reading needs: nobody may be unable to read the installation
        "[*Store(sys.argv[1]).rows('numbers')]\n"
        "if os.getuid() == 0:\n    os.setuid(65534)\n"
        "print(len([*Store(sys.argv[1]).rows('numbers')]))\n"
        "try:\n    Store(sys.argv[1], write=True)\nexcept OutputError as error:\n    print(error)\n"
    )
    store.chmod(0o444)
    store.parent.chmod(0o555)
    # up to the one for temporary files, not that
    for folder in tmp_path, *list(tmp_path.parents)[:-2]:
        folder.chmod(0o755)  # that nobody, as whom this runs, may look into
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[2]), *sys.path])
    }
    ended = subprocess.run(
        [sys.executable, "-c", script, str(store)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    store.parent.chmod(0o755)
    assert ended.stdout.splitlines() == [
        "21",
        f"cannot write {store}: it is read-only; nothing was changed",
    ], ended.stderr
    assert store.read_bytes() == before


# Tables


def test_exports_agree(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")  # an extra
    run_sweep(numbers(), tmp_path / "s", workers=0)
    rows = rows_of(tmp_path / "s")
    with Store(tmp_path / "s") as store:
        columns = store.columns("numbers")
        assert columns == ["factor", "trial", "seed", "value", "half", "word"]
        assert (
            export(store, "numbers", tmp_path / "t.csv")
            == export(store, "numbers", tmp_path / "t.parquet")
            == 21
        )
        assert [*frame(store, "numbers").itertuples(index=False, name=None)] == rows
        with pytest.raises(
            InvalidInputError, match=r"expected the suffix .csv or .parquet, got '.xls'"
        ):
            export(store, "numbers", tmp_path / "t.xls")
    table = parquet.read_table(tmp_path / "t.parquet")
    assert table.column_names == columns
    assert [*zip(*(column.to_pylist() for column in table.columns), strict=True)] == rows
    assert json.loads(table.schema.metadata[b"shoal"])["name"] == "numbers"
    lines = (tmp_path / "t.csv").read_text().splitlines()
    assert lines[0] == ",".join(columns)
    assert lines[1:] == [",".join(map(str, row)) for row in rows]


def test_differences_name_what_changed():
    assert [*differences({"a": 1, "b": {"c": [1]}}, {"b": {"c": [2]}, "d": 3})] == [
        "a: 1 -> none",
        "b.c: [1] -> [2]",
        "d: none -> 3",
    ]


SPEC = (
    'name = "corridors"\ntrials = 4\npaired = ["policy"]\n[problem]\nkind = "swarm"\nmap ='
    ' "maze:9x7"\n[axes]\n'
)
SPEC += 'policy = ["closest-frontier", "elect-particle"]\nparticles = [3, 6]\n'


def test_a_long_sweep_tells_its_progress_without_a_terminal(tmp_path, monkeypatch, capsys):
    from shoal.cli import sweep

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sweep, "_APART", 0.0)
    Path("sweep.toml").write_text(SPEC)
    assert command(["sweep", "run", "sweep.toml", "--store", "s.sqlite", "--workers", "0"]) == 0
    told = [line for line in capsys.readouterr().err.splitlines() if "trials" in line]
    assert told[0].startswith("sweep corridors: ")
    assert told[-1].startswith("sweep corridors: 16 of 16 trials, ")
    assert 1 < len(told) <= 10
    assert command(["sweep", "run", "sweep.toml", "--store", "s.sqlite", "--workers", "0"]) == 0
    assert "trials" not in capsys.readouterr().err  # nothing was left to run


def test_commands(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("sweep.toml").write_text(SPEC)
    # that kernels must be compiled is said on stderr
    shoal.run(shoal.open_map("rectangle:3x3"), particles=1)
    assert (
        command(
            [
                "sweep",
                "run",
                "sweep.toml",
                "--store",
                "s.sqlite",
                "--workers",
                "0",
                "--out",
                "t.csv",
                "--json",
            ]
        )
        == 0
    )
    captured = capsys.readouterr()
    result = json.loads(captured.out)
    # a short sweep: not a word
    assert (result["done"], result["total"], result["complete"], captured.err) == (16, 16, True, "")
    assert len(Path("t.csv").read_text().splitlines()) == 17
    assert command(["sweep", "status", "s.sqlite", "--watch", "--out", "status.json"]) == 0
    assert "complete" in capsys.readouterr().out
    assert json.loads(Path("status.json").read_text())["sweeps"][0]["name"] == "corridors"
    assert command(["sweep", "summary", "s.sqlite", "--compare", "policy", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["measure"] == "moves"
    assert [point["estimate"]["count"] for point in result["points"]] == [4] * 4
    assert [pair["policy"] for pair in result["comparisons"]] == [
        ["closest-frontier", "elect-particle"]
    ] * 2
    assert all(
        found["estimate"]["low"] < found["estimate"]["mean"] < found["estimate"]["high"]
        for found in result["points"]
    )
    monkeypatch.setenv("COLUMNS", "80")
    assert command(["sweep", "summary", "s.sqlite", "--compare", "policy"]) == 0
    told = capsys.readouterr().out
    first = result["comparisons"][0]["comparison"]
    assert (
        f"{number_text(first['difference']['mean'])} [{number_text(first['difference']['low'])}, "
        in told
    )
    assert max(map(len, told.splitlines())) <= 80
    assert (
        command(["sweep", "plot", "s.sqlite", "--measure", "moves", "--out", "moves.svg", "--json"])
        == 0
    )
    assert json.loads(capsys.readouterr().out) == {
        "sweep": "corridors",
        "measure": "moves",
        "points": 4,
        "left_out": 0,
        "out": "moves.svg",
    }
    assert "elect-particle" in Path("moves.svg").read_text()
    assert command(["sweep", "plot", "s.sqlite", "--out", "moves.txt"]) == 2
    assert "expected the suffix .png, .svg or .pdf, got '.txt'" in capsys.readouterr().err
    assert command(["sweep", "summary", "s.sqlite", "--compare", "particles"]) == 2
    assert (
        "expected a paired axis (policy), whose points share their seeds" in capsys.readouterr().err
    )
    assert command(["sweep", "summary", "s.sqlite", "--measure", "status"]) == 2
    assert command(["sweep", "run", "sweep.toml", "--store", "s.sqlite", "--trials", "5"]) == 2
    assert "trials: 4 -> 5" in capsys.readouterr().err
    assert (
        command(
            [
                "sweep",
                "run",
                "sweep.toml",
                "--store",
                "s.sqlite",
                "--trials",
                "5",
                "--extend",
                "--workers",
                "0",
            ]
        )
        == 0
    )
    assert command(["sweep", "run", "none.toml", "--store", "s.sqlite"]) == 2
    Path("bad.toml").write_text("name = corridors")
    assert command(["sweep", "run", "bad.toml", "--store", "s.sqlite"]) == 2
    assert "bad.toml: expected TOML" in capsys.readouterr().err
    for old, new, told in (
        ("trials = 4", "trails = 4", "bad.toml, line 2: trails: expected no such field, got 4"),
        (
            "trials = 4",
            'trials = "4"',
            "bad.toml, line 2: trials: expected a whole number, got '4'",
        ),
        (
            'map = "',
            'mpa = "',
            (
                "bad.toml, line 6: problem at policy = closest-frontier, particles = 3: mpa:"
                " expected no such field"
            ),
        ),
        ("[3, 6]", "[]", "bad.toml, line 9: axes.particles: expected one value or more, got none"),
        (
            "[3, 6]",
            "3",
            "bad.toml, line 9: axes.particles: expected a list of values or a range, got 3",
        ),
        (
            "[3, 6]",
            '["few"]',
            (
                "line 9: problem at policy = closest-frontier, particles = few: particles: expected"
                " a whole number"
            ),
        ),
    ):
        Path("bad.toml").write_text(SPEC.replace(old, new))
        assert command(["sweep", "run", "bad.toml", "--store", "none.sqlite"]) == 2
        assert told in capsys.readouterr().err
    assert not Path("none.sqlite").exists()


def test_tables_in_80_columns_keep_their_names_whole(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    policies = ["closest-frontier", "elect-particle", "random-moves", "sweep"]
    axes = {"policy": policies, "placement": ["uniform", "flood-fill"], "particles": [5, 39]}
    run_sweep(
        Sweep(name="s", problem=SWARM, axes=axes, trials=3, paired=("policy",)),
        tmp_path / "s",
        workers=0,
    )
    for method in ("auto", "log"):
        capsys.readouterr()
        assert (
            command(
                ["sweep", "summary", str(tmp_path / "s"), "--compare", "policy", "--method", method]
            )
            == 0
        )
        lines = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
        assert max(map(len, lines)) <= 80
        text = " ".join(" ".join(lines).split())
        for policy in policies[1:]:
            assert (
                f"placement = flood-fill, particles = 5, policy = {policy} less closest-frontier"
                in text
            )
            assert sum(policy in line for line in lines) >= 8
        assert ("ratio [95 % interval]" in text) == (method == "log")
    monkeypatch.setenv("COLUMNS", "200")
    assert command(["sweep", "summary", str(tmp_path / "s")]) == 0
    assert capsys.readouterr().out.splitlines()[1].split() == [
        "policy",
        "placement",
        "particles",
        "mean",
        "[95",
        "%",
        "interval]",
    ]
    assert (
        command(
            [
                "sweep",
                "summary",
                str(tmp_path / "s"),
                "--compare",
                "policy",
                "--method",
                "log",
                "--json",
            ]
        )
        == 0
    )
    compared = json.loads(capsys.readouterr().out)["comparisons"]
    assert any(
        one["comparison"] and one["comparison"]["ratio_low"] < one["comparison"]["ratio"]
        for one in compared
    )


def test_a_spreadsheet_takes_no_text_for_a_formula(tmp_path):
    sweep = Sweep(
        name="words",
        problem={"kind": "function", "function": f"{HERE}:lengths"},
        axes={"word": ["=1+1", "@a", "plain", "-x"]},
        trials=1,
    )
    run_sweep(sweep, tmp_path / "store.sqlite", workers=0)
    with Store(tmp_path / "store.sqlite") as store:
        export(store, "words", tmp_path / "table.csv")
    rows = (tmp_path / "table.csv").read_text().splitlines()
    assert [row.split(",")[0] for row in rows[1:]] == ["'=1+1", "'@a", "plain", "'-x"]


@pytest.mark.parametrize(
    ("rows", "numbers", "columns"),
    [
        (['["complete",1,2.5]', '["lost",3,null]'], [1, 2], [[1, 3], [2.5, None]]),
        (['["a,b",1,2]', '["a]",3,4]'], [0, 2], [["a,b", "a]"], [2, 4]]),
        (['["a\\"",1,2]', '["",true,4]'], [0, 1], [['a"', ""], [1, True]]),
        (["[1]", "[2]"], [0], [[1, 2]]),
        (["[0,123]", "[10,4567890123456789]"], [0, 1], [[0, 10], [123, 4567890123456789]]),
        (["[1,-2]", "[2,10]"], [0, 1], [[1, 2], [-2, 10]]),
        (['["a"]'], [0], [["a"]]),
        (["[1,[2],3]"], [1], [[[2]]]),
    ],
)
def test_columns_are_taken_out_of_the_rows(rows, numbers, columns):
    width = len(json.loads(rows[0]))
    results = ResultTexts(",".join(rows), numbers, len(rows), width, where="a")
    assert [[*results.column(number)] for number in numbers] == columns
    words = ["complete", "a", 'a"']
    for number, column in zip(numbers, columns, strict=True):
        assert results.is_any(number, words).tolist() == [value in words for value in column]


@pytest.mark.parametrize(
    "rows",
    [
        ['["a,b",1]', "[1,2,3]"],
        ["[1,2]", "[1,2,3,4]"],
        ["[1,2,3],[1,2,3]"],
        ['["a,b",1]'],
        ["[,1,2]"],
        ["[01,1,2]"],
        ["[1,2,3"],
        ["1,2,3"],
        ['[",2,"]'],
    ],
)
def test_rows_of_other_widths_are_refused(rows):
    with pytest.raises(InvalidInputError, match="expected"):
        ResultTexts(",".join(rows), [0], len(rows), 3, where="a").column(0)


def test_numbers_of_trials():
    assert trial_numbers("0,7,12", where="a").tolist() == [0, 7, 12]
    for damaged in ("0,a", "1.5", "", "1,,2", "07"):
        with pytest.raises(InvalidInputError, match="a: trials: expected whole numbers"):
            trial_numbers(damaged, where="a")
