"""Full disks, many jobs, sweeps that are killed: nothing is lost, and what cannot be
done is said.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal

import pytest

from shoal.core.errors import OutputError
from shoal.lab import Store
from shoal.lab.sweep import as_toml
from shoal.studio import jobs as queue_module
from shoal.studio.folder import Folder
from shoal.studio.jobs import ENDED, JobQueue, JobStore
from shoal.studio.processes import Worker
from shoal.studio.work import JOBS

SHORT = {
    "problem": {"kind": "swarm", "map": "line:9", "particles": 1, "policy": "closest-frontier"},
    "seed": 0,
}


def test_an_episode_that_a_full_disk_does_not_take_is_said_and_not_half_written(tmp_path):
    worker = Worker("tests.studio_work:play_on_a_full_disk", str(tmp_path), SHORT)
    try:
        told = []
        while not told or told[-1][0] not in ("done", "failed"):
            told.append(worker.connection.recv())
    finally:
        worker.end()
    assert told[-1][0] == "failed"
    assert "Cannot write" in told[-1][1]["error"]
    assert list(tmp_path.iterdir()) == []


def fill(store: JobStore) -> None:
    """Let a store of jobs not grow, as on a full disk."""
    (pages,) = store._connection.execute("PRAGMA page_count").fetchone()
    store._connection.execute(f"PRAGMA max_page_count = {pages}")


def test_jobs_on_a_full_disk_are_refused_and_ends_are_kept_until_there_is_room(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(queue_module, "PAUSE", 0.01)
    told = []

    async def scenario():
        queue = JobQueue(Folder(tmp_path), told.append)
        monkeypatch.setattr(queue, "go_on", lambda: None)
        number = queue.add("play", SHORT, urgent=False)["id"]
        queue.store.begin_next()
        fill(queue.store)
        with pytest.raises(OutputError, match="full"):
            queue.add("play", SHORT | {"padding": "x" * 50_000}, urgent=False)
        queue._end(number, "failed", {"error": "x" * 50_000})
        assert queue.describe(number)["state"] == "failed"  # what browsers see
        assert queue.store.job(number)["state"] == "running"  # what the disk took
        queue.store._connection.execute("PRAGMA max_page_count = 1000000")
        queue._save_ends()
        assert queue.store.job(number)["state"] == "failed"
        await queue.close()

    asyncio.run(scenario())


def test_long_jobs_leave_a_processor_for_what_somebody_looks_at(tmp_path, monkeypatch):
    monkeypatch.setattr(queue_module, "count_processors", lambda: 4)
    begun = []

    async def follow(_queue, running):
        begun.append((running.job["kind"], running.processors))

    monkeypatch.setattr(JobQueue, "_follow", follow)

    async def scenario():
        queue = JobQueue(Folder(tmp_path), lambda _: None)
        for kind in ("sweep", "sweep", "reproduce", "play"):
            queue.add(kind, SHORT, urgent=False)
        await queue.close()

    asyncio.run(scenario())
    assert begun == [("sweep", 3), ("play", 1)]
    assert {"sweep", "reproduce"} == {kind for kind, job in JOBS.items() if job.long}


PROBLEM = {"kind": "line", "cells": 30, "placements": 200}
SWEEP = {
    "name": "killed",
    "trials": 40,
    "seed": 1,
    "problem": PROBLEM,
    "axes": {"particles": [2, 3]},
}


def test_a_sweep_that_is_killed_goes_on_with_what_is_missing(tmp_path):
    text, told = as_toml(SWEEP), []

    async def until(queue, number, *, done):
        while (
            queue.describe(number)["state"] != "done"
            and queue.describe(number).get("done", 0) <= done
        ):
            await asyncio.sleep(0.005)

    async def scenario():
        queue = JobQueue(Folder(tmp_path), told.append)
        number = queue.add(
            "sweep", {"toml": text, "store": "killed.sqlite", "sweep": "killed"}, urgent=True
        )["id"]
        await until(queue, number, done=0.01)
        if number in queue._running:
            os.kill(queue._running[number].worker._process.pid, signal.SIGKILL)
        while queue.describe(number)["state"] not in ENDED:
            await asyncio.sleep(0.005)
        again = queue.add(
            "sweep", {"toml": text, "store": "killed.sqlite", "sweep": "killed"}, urgent=True
        )["id"]
        while queue.describe(again)["state"] not in ENDED:
            await asyncio.sleep(0.005)
        found = queue.describe(again)
        await queue.close()
        return found

    found = asyncio.run(asyncio.wait_for(scenario(), 90))
    assert (found["state"], found["result"]["done"]) == ("done", 80), json.dumps(found)
    assert (tmp_path / "killed.toml").read_text() == text
    with Store(tmp_path / "killed.sqlite") as store:
        assert store.status("killed").complete
