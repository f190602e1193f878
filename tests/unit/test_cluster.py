"""A Dask cluster gives what processes give, also when a worker is killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import warnings
from pathlib import Path

import pytest

from shoal.core.errors import InvalidInputError, MissingExtraError
from shoal.core.notices import listeners
from shoal.lab import Store, Sweep, run_sweep
from shoal.lab.store import faults_of

distributed = pytest.importorskip("distributed")  # an extra

PROBLEM = {
    "kind": "function",
    "function": "tests.unit.sweep_functions:number",
    "arguments": {"pause": 0.01},
}


def sweep(trials=60):
    return Sweep(
        name="numbers", problem=PROBLEM, axes={"factor": [1, 2, 3, 4]}, trials=trials, seed=8
    )


@pytest.fixture(scope="module")
def cluster():
    """Three worker processes on this machine, without a page to watch them."""
    root = str(Path(__file__).parents[2])
    with pytest.MonkeyPatch.context() as patch, warnings.catch_warnings():
        patch.syspath_prepend(root)
        patch.setenv("PYTHONPATH", os.pathsep.join([root, os.environ.get("PYTHONPATH", "")]))
        warnings.simplefilter("ignore")
        made = distributed.LocalCluster(
            n_workers=3,
            threads_per_worker=1,
            processes=True,
            dashboard_address=None,
            silence_logs=50,
            memory_limit=None,
        )
        yield made
        made.close()


def rows_of(path):
    with Store(path) as store:
        assert faults_of(store) == []
        return [*store.rows("numbers")]


@pytest.mark.filterwarnings("ignore")  # of Dask's own, when a worker is killed
def test_a_cluster_with_a_killed_worker_gives_the_same_rows(cluster, tmp_path):
    processes = {worker.process.process.pid for worker in cluster.workers.values()}
    assert len(processes) == 3
    victim = sorted(processes)[0]

    def kill_midway(progress):
        if progress.done > 60 and not killed.is_set():
            killed.set()
            os.kill(victim, signal.SIGKILL)

    killed = threading.Event()
    status = run_sweep(
        sweep(),
        tmp_path / "dask",
        dask=cluster.scheduler_address,
        on_progress=kill_midway,
        batch_seconds=0.05,
    )
    assert killed.is_set()
    assert status.complete
    for name, workers in (("here", 0), ("two", 2)):
        run_sweep(sweep(), tmp_path / name, workers=workers, batch_seconds=0.05)
        assert rows_of(tmp_path / "dask") == rows_of(tmp_path / name), name
    with Store(tmp_path / "dask") as store:
        workers = {worker for (worker,) in store.ask("SELECT DISTINCT worker FROM batches")}
    # who gets how much is Dask's choice; the one killed may not have given anything yet
    assert len(workers) >= 2


@pytest.mark.filterwarnings("ignore")
def test_a_worker_that_alone_fails_everything_is_set_aside(cluster, tmp_path):
    problem = {
        "kind": "function",
        "function": "tests.unit.sweep_functions:sick",
        "arguments": {"mark": str(tmp_path / "mark")},
    }
    named = Sweep(name="numbers", problem=problem, axes={"factor": [1, 2, 3]}, trials=30)
    before, told = set(cluster.scheduler_info["workers"]), []
    listeners.append(told.append)
    try:
        status = run_sweep(
            named, tmp_path / "s", dask=cluster.scheduler_address, batch_seconds=0.05
        )
    finally:
        listeners.remove(told.append)
    assert (status.done, status.failures) == (90, 0)
    assert len(before - set(cluster.scheduler_info["workers"])) == 1
    (sentence,) = [text for text in told if "no more trials" in text]
    assert "succeeded on another worker (OSError: no room on this machine); the worker" in sentence
    failing = Sweep(
        name="other",
        problem=PROBLEM | {"arguments": {"pause": "x"}},
        axes={"factor": [1, 2]},
        trials=9,
    )
    status = run_sweep(failing, tmp_path / "s", dask=cluster.scheduler_address, batch_seconds=0.05)
    assert (status.done, status.failures) == (0, 18)  # of themselves: nobody is set aside for that


@pytest.mark.filterwarnings("ignore")
def test_modules_of_the_user_reach_the_workers(cluster, tmp_path, monkeypatch):
    (tmp_path / "mine_alone.py").write_text(
        "def half(*, seed, of):\n    return {'share': of / 2}\n\n\nhalf.measures = ('share',)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    named = Sweep(
        name="numbers",
        problem={"kind": "function", "function": "mine_alone:half"},
        axes={"of": [1, 3]},
        trials=2,
    )
    status = run_sweep(named, tmp_path / "s", dask=cluster.scheduler_address)
    assert (status.done, status.failures) == (4, 0)
    (tmp_path / "theirs").mkdir()
    (tmp_path / "theirs" / "alone.py").write_text((tmp_path / "mine_alone.py").read_text())
    named = Sweep(
        name="other",
        problem={"kind": "function", "function": "theirs.alone:half"},
        axes={"of": [1, 3]},
        trials=2,
    )
    with pytest.raises(
        InvalidInputError,
        match=(
            r"expected the same module theirs\.alone as in this process, got none; put the"
            r" module on"
        ),
    ):
        run_sweep(named, tmp_path / "s", dask=cluster.scheduler_address)


def test_nobody_at_the_address(tmp_path):
    with pytest.raises(InvalidInputError, match="expected a scheduler at"):
        run_sweep(sweep(), tmp_path / "s", dask="nonsense address")
    with pytest.raises(
        InvalidInputError,
        match="expected no number of workers for a Dask cluster, which has its own workers, got 3",
    ):
        run_sweep(sweep(), tmp_path / "s", dask="tcp://127.0.0.1:1", workers=3)


def test_without_dask_the_sentence_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'shoal\[cluster\]'"):
        run_sweep(sweep(), tmp_path / "s", dask="tcp://127.0.0.1:1")


def test_workers_end_with_their_coordinator():
    """As after kill -9 of it: a worker watches its parent, and does not wait for work for ever."""
    # in a program of its own: a process of this one would import the tests, and its worker too
    coordinator = subprocess.Popen([sys.executable, "-c", COORDINATOR], stdout=subprocess.PIPE)
    assert coordinator.stdout is not None
    worker = int(coordinator.stdout.readline())
    coordinator.kill()
    coordinator.wait()
    coordinator.stdout.close()
    for _ in range(500):
        if (
            not Path(f"/proc/{worker}").exists()
            or ") Z " in Path(f"/proc/{worker}/stat").read_text()
        ):
            return
        threading.Event().wait(0.02)
    raise AssertionError("the worker is still there")


COORDINATOR = """
import os, threading
from shoal.lab.workers import Processes
if __name__ == "__main__":
    print(Processes(1).submit(os.getpid).result(), flush=True)
    threading.Event().wait()
"""
