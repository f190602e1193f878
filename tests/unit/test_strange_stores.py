"""Stores of strangers, damaged ones, and functions that return what no store can take."""

from __future__ import annotations

import json
import shutil
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest

from shoal.cli import run as command
from shoal.core.errors import InvalidInputError, OutputError
from shoal.lab import Store, Sweep, run_sweep


def test_what_no_store_can_take_is_a_failure_of_its_trial(tmp_path):
    kinds = ["exit", "huge", "list", "surrogate", "long", "nan"]
    problem = {"kind": "function", "function": "tests.unit.sweep_functions:strange"}
    sweep = Sweep(name="s", problem=problem, axes={"kind": kinds}, trials=2)
    status = run_sweep(sweep, tmp_path / "s", workers=0)
    assert (status.done, status.failures) == (0, 12)
    with Store(tmp_path / "s") as store:
        errors = {values["kind"]: error for values, _, _, error in store.failures("s")}
        assert errors.pop("exit") == "SystemExit: 0"
        assert all(
            "expected finite numbers, truth values, short texts or None" in error
            for error in errors.values()
        )
        assert all(len(error) < 200 for error in errors.values())


def changed_store(tmp_path, *statements):
    """Return a small store in which something was changed by hand."""
    run_sweep(
        Sweep(name="s", problem={"kind": "swarm", "map": "line:9"}, axes={"particles": [2, 9]}),
        tmp_path / "s",
        workers=0,
    )
    with closing(sqlite3.connect(tmp_path / "s")) as connection:
        for statement in statements:
            connection.execute(statement)
        connection.commit()
    return tmp_path / "s"


@pytest.mark.parametrize(
    "damage",
    [
        "UPDATE sweeps SET spec = '{'",
        "UPDATE sweeps SET spec = '[1]'",
        "UPDATE sweeps SET spec = '{\"name\": 3}'",
        f"UPDATE sweeps SET spec = '{'[' * 90000}'",
        "UPDATE sweeps SET inputs = '3'",
        "UPDATE sweeps SET name = 'a' || char(0)",
        "UPDATE sweeps SET name = '../a'",
        "UPDATE sweeps SET name = x'61'",
        "UPDATE sweeps SET measures = '7'",
        "UPDATE sweeps SET measures = '[]'",
        "UPDATE sweeps SET measures = x'ff'",
        "UPDATE sweeps SET trials = 'many'",
        "UPDATE batches SET version = x'00'",
        "UPDATE points SET axes = '[1, 2]'",
        "UPDATE points SET axes = '}'",
        "UPDATE trials SET result = '[1'",
        "UPDATE trials SET result = '[1]'",
        "UPDATE trials SET result = '3'",
        f"UPDATE trials SET result = '{'[' * 90000}'",
        f"UPDATE trials SET result = '[\"complete\", {'9' * 400}, 1, 1, 1]'",
        "UPDATE trials SET result = '[1, [2], 1, 1, 1]'",
        "DELETE FROM points",
        "CREATE TRIGGER t AFTER INSERT ON trials BEGIN SELECT 1; END",
        "ALTER TABLE points RENAME TO old",
    ],
)
def test_damaged_stores_get_one_sentence(damage, tmp_path, capsys):
    path = changed_store(tmp_path, damage)
    for verb in ("summary", "plot", "export", "status", "check"):
        out = {
            "export": ["--out", str(tmp_path / "table.csv")],
            "plot": ["--out", str(tmp_path / "plot.png")],
        }.get(verb, [])
        code = command(["sweep", verb, str(path), *out])
        printed = capsys.readouterr()
        assert code in (0, 1, 2)
        if code == 2:
            assert printed.err.startswith("shoal: ")
            assert printed.err.count("\n") == 1
            assert len(printed.err) < 600
    assert code != 0, "the check must see it"


@pytest.mark.parametrize(
    ("damage", "fault"),
    [
        ("UPDATE sweeps SET trials = 'many'", "table sweeps, row 1: trials: expected 0 to 1e+18"),
        ("UPDATE batches SET version = x'00'", "table batches, row 1: version: expected a text"),
        ("UPDATE sweeps SET name = '../a'", "name of a sweep: expected"),
        (
            "UPDATE trials SET result = x'00' WHERE point = 2",
            "sweep s, point 1, trial 0: its result has not 5 numbers or texts",
        ),
        (
            "UPDATE trials SET trial = 'b', seed = 'c' WHERE point = 2",
            "sweep s, point 1, trial 'b': a trial that is not of the sweep",
        ),
    ],
)
def test_the_check_names_damaged_rows(damage, fault, tmp_path, capsys):
    path = changed_store(tmp_path, damage)
    assert command(["sweep", "check", str(path), "--json"]) == 1
    assert fault in json.loads(capsys.readouterr().out)["faults"][0]


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (
            "UPDATE points SET axes = '[2]'",
            "expected points that differ, got two points with the axis values '[2]'",
        ),
        (
            "UPDATE points SET axes = '[7]' WHERE number = 1",
            "expected the 2 points of the sweep's axes, got 2 points",
        ),
        ("UPDATE points SET number = 1 - number", "expected the 2 points of the sweep's axes"),
        (
            "DELETE FROM points WHERE number = 1",
            "expected the 2 points of the sweep's axes, got 1 points",
        ),
    ],
)
def test_points_that_are_not_those_of_the_axes_are_refused_by_every_command(
    damage, words, tmp_path, capsys
):
    path = changed_store(tmp_path, damage)
    spec = tmp_path / "s.toml"
    spec.write_text(
        'name = "s"\n[problem]\nkind = "swarm"\nmap = "line:9"\n[axes]\nparticles = [2, 9]\n'
    )
    for arguments in (
        ["summary", path],
        ["status", path],
        ["plot", path, "--out", tmp_path / "a.png"],
        ["export", path, "--out", tmp_path / "a.csv"],
        ["merge", path, "--out", tmp_path / "merged"],
        ["run", spec, "--store", path, "--workers", 0],
    ):
        capsys.readouterr()
        assert command(["sweep", *map(str, arguments)]) == 2, arguments
        assert words in capsys.readouterr().err
    assert not {"a.png", "a.csv", "merged"} & {file.name for file in tmp_path.iterdir()}
    assert command(["sweep", "check", str(path)]) == 1
    with Store(path) as store, pytest.raises(InvalidInputError, match="points"):
        next(store.rows("s"))


def test_a_store_with_a_view_is_refused_and_one_that_claims_many_trials_is_read(tmp_path, capsys):
    endless = (
        "CREATE VIEW trials AS WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n)"
        " SELECT k FROM n"
    )
    path = changed_store(tmp_path, "UPDATE sweeps SET trials = 1000000000000000000")
    assert command(["sweep", "summary", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["points"][0]["trials"] == 1
    path = changed_store(
        tmp_path, "UPDATE sweeps SET trials = 1", "ALTER TABLE trials RENAME TO others", endless
    )
    assert command(["sweep", "summary", str(path)]) == 2
    assert (
        "expected the tables of a store and nothing else, got the table 'others'"
        in capsys.readouterr().err
    )


def test_reading_a_store_never_runs_code_that_it_names(tmp_path, capsys, monkeypatch):
    (tmp_path / "evil.py").write_text(
        f"import pathlib\npathlib.Path({str(tmp_path / 'ran')!r}).touch()\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    run_sweep(
        Sweep(
            name="s",
            problem={"kind": "function", "function": "tests.unit.sweep_functions:number"},
            trials=3,
        ),
        tmp_path / "s",
        workers=0,
    )
    with closing(sqlite3.connect(tmp_path / "s")) as connection:
        connection.execute(
            "UPDATE sweeps SET spec = replace(spec, 'tests.unit.sweep_functions:number',"
            " 'evil:number')"
        )
        connection.commit()
    for verb in ("summary", "status", "export", "check"):
        out = ["--out", str(tmp_path / "table.csv")] if verb == "export" else []
        assert command(["sweep", verb, str(tmp_path / "s"), *out]) in (0, 1)
    assert not (tmp_path / "ran").exists()


def test_stores_are_merged(tmp_path, capsys):
    def stored(name, *, trials=3, seed=0, fails=()):
        problem = {"kind": "function", "function": "tests.unit.sweep_functions:number"}
        run_sweep(
            Sweep(name="s", problem=problem, trials=trials, seed=seed), tmp_path / name, workers=0
        )
        with closing(sqlite3.connect(tmp_path / name)) as connection:
            for statement in fails:
                connection.execute(statement)
            connection.commit()
        return str(tmp_path / name)

    whole = stored("whole")
    first = stored("first", fails=["DELETE FROM trials WHERE trial = 1"])
    second = stored(
        "second",
        fails=[
            "DELETE FROM trials WHERE trial = 0",
            "INSERT INTO failures SELECT id, 0, 7, 1, '' FROM points",
        ],
    )
    assert (
        command(["sweep", "merge", first, second, "--out", str(tmp_path / "both"), "--json"]) == 0
    )
    assert json.loads(capsys.readouterr().out)["sweeps"] == [{"name": "s", "done": 3, "total": 3}]
    with Store(tmp_path / "both") as merged, Store(whole) as expected:
        assert [*merged.rows("s")] == [*expected.rows("s")]
        assert not merged.failures("s")
    assert command(["sweep", "check", str(tmp_path / "both")]) == 0
    wrong = stored("wrong", fails=["UPDATE trials SET result = '[99]' WHERE trial = 2"])
    for others, words in (
        (
            [first, wrong],
            "trial 2: expected the same result as in the stores before, got another result",
        ),
        (
            [first, stored("other", seed=1)],
            "expected the same sweep as in the stores before, got changes: seed",
        ),
        ([first, str(tmp_path / "none")], "expected a store, got no such file"),
    ):
        capsys.readouterr()
        assert command(["sweep", "merge", *others, "--out", str(tmp_path / "bad")]) == 2
        assert words in capsys.readouterr().err
        assert not [path.name for path in tmp_path.iterdir() if "bad" in path.name]
    assert command(["sweep", "merge", first, "--out", whole]) == 2


def test_a_store_beside_a_link_and_one_whose_disk_is_full(tmp_path, monkeypatch):
    from shoal.lab import database
    from shoal.lab.store import locked

    (tmp_path / "theirs").write_text("kept")
    (tmp_path / ".s.x.lock").symlink_to(tmp_path / "theirs")
    with pytest.raises(OutputError, match="symbolic link"), locked(tmp_path / "s", "x"):
        pass
    assert (tmp_path / "theirs").read_text() == "kept"
    monkeypatch.setattr(
        database,
        "TABLES",
        "CREATE TABLE a (b); PRAGMA page_count; " + "INSERT INTO a VALUES (zeroblob(9999));" * 9,
    )
    monkeypatch.setattr(
        database,
        "_make_durable",
        lambda connection: connection.execute("PRAGMA max_page_count = 2"),
    )
    with pytest.raises(OutputError, match="the disk is full"):
        Store(tmp_path / "new", write=True)
    assert sorted(path.name for path in tmp_path.iterdir()) == [".s.x.lock", "theirs"]


def test_a_system_without_shared_memory(tmp_path, monkeypatch):
    """As where /dev/shm cannot be written."""

    def refused(*_arguments, **_options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("shoal.lab.workers.ProcessPoolExecutor", refused)
    sweep = Sweep(
        name="s", problem={"kind": "swarm", "map": "line:9"}, axes={"particles": [2]}, trials=2
    )
    with pytest.raises(
        InvalidInputError, match="processes that share memory, got the error: Permission denied"
    ):
        run_sweep(sweep, tmp_path / "s", workers=2)
    assert run_sweep(sweep, tmp_path / "s", workers=0).complete


ON_SMALL_DISKS = """
import subprocess, sys
from pathlib import Path
from shoal.core.errors import OutputError
from shoal.lab import Store, Sweep, merge_stores, run_sweep
from shoal.lab.store import faults_of
folder = Path(sys.argv[1])
problem = {"kind": "function", "function": "tests.unit.sweep_functions:number", "arguments": {"pause": 0.0}}
sweep = Sweep(name="s", problem=problem, axes={"factor": [1, 2]}, trials=1000)
run_sweep(sweep, folder / "whole", workers=0)
for room in (4096, 15000, 57000, 100000, 130000):
    disk = folder / str(room)
    disk.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={room}", "tmpfs", disk], check=True)
    try:
        run_sweep(sweep, disk / "store", workers=0)
    except OutputError as error:
        print(str(error).split(": ")[1].split(";")[0], end="; ")
    try:
        merge_stores([folder / "whole"], disk / "merged")
    except OutputError as error:
        print(str(error).split(": ")[1].split(";")[0], end="; ")
    left = {one.name for one in disk.iterdir()}
    assert left <= {"store", "store-wal", "store-shm"}, left
    subprocess.run(["mount", "-o", "remount,size=9m", disk], check=True)
    run_sweep(sweep, disk / "store", workers=0)
    with Store(disk / "store") as one, Store(folder / "whole") as other:
        assert [*one.rows("s")] == [*other.rows("s")] and not faults_of(one)
"""


def test_disks_that_are_full_at_any_stage(tmp_path):
    alone = ["unshare", "--map-root-user", "--mount"]
    if (
        not shutil.which("unshare")
        or subprocess.run([*alone, "true"], capture_output=True, check=False).returncode
    ):
        pytest.skip("needs a mount namespace of its own")
    ended = subprocess.run(
        [*alone, sys.executable, "-c", ON_SMALL_DISKS, str(tmp_path)],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout == "the disk is full; " * 10


def test_coordinators_that_make_one_store_at_once(tmp_path):
    with ThreadPoolExecutor(8) as pool:
        for store in pool.map(lambda _: Store(tmp_path / "s", write=True), range(8)):
            store.close()
    assert [path.name for path in tmp_path.iterdir()] == ["s"]
