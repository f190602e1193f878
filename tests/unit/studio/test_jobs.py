"""Jobs are found again, and processes end with what they started."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sqlite3
import time
from types import SimpleNamespace

import pytest

from shoal.core.errors import InvalidInputError
from shoal.studio.application import Studio
from shoal.studio.folder import Folder
from shoal.studio.jobs import ENDED, JobQueue, JobStore
from shoal.studio.processes import Worker


def test_a_job_that_was_cut_off_is_begun_again_and_then_marked(tmp_path):
    store = JobStore(tmp_path)
    first, second = store.add("play", {"seed": 1}), store.add("play", {"seed": 2}, urgent=True)
    assert store.begin_next()["id"] == second
    store.close()  # a server that is killed says no more
    store = JobStore(tmp_path)
    assert [store.job(number)["state"] for number in (first, second)] == ["queued", "queued"]
    assert store.begin_next()["id"] == second
    store.close()
    store = JobStore(tmp_path)
    assert store.job(second)["state"] == "interrupted"
    assert store.begin_next()["id"] == first
    store.end(first, "done", {"file": "x.npz"})
    store.close()
    store = JobStore(tmp_path)
    assert store.job(first)["result"] == {"file": "x.npz"}
    assert store.begin_next() is None
    store.close()


def test_five_hundred_jobs_wait_in_order(tmp_path):
    store = JobStore(tmp_path)
    numbers = [store.add("play", {"seed": seed}) for seed in range(500)]
    assert store.counts() == {"queued": 500}
    assert store.cancel_queued(numbers[0])
    assert not store.cancel_queued(numbers[0])
    assert [store.begin_next()["id"] for _ in range(3)] == numbers[1:4]
    store.close()


def test_another_database_is_left_alone(tmp_path):
    with sqlite3.connect(tmp_path / ".studio.sqlite") as other:
        other.execute("CREATE TABLE notes (text)")
    with pytest.raises(InvalidInputError, match="got another SQLite database"):
        JobStore(tmp_path)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("UPDATE jobs SET spec = '[1'", "job 1: spec: expected JSON"),
        ("UPDATE jobs SET result = '[]'", "job 1: result: expected an object, got \\[\\]"),
        ("UPDATE jobs SET spec = x'00'", "job 1: spec: expected a text"),
        ("UPDATE jobs SET state = 'x'", "job 1: state: expected one of queued, .* got 'x'"),
        ("UPDATE jobs SET created = 9e999", "job 1: created: expected a number, got inf"),
        (
            "ALTER TABLE jobs RENAME TO x; CREATE VIEW jobs AS SELECT * FROM x",
            "nothing else, got the table 'x'",
        ),
        ("DROP TABLE jobs; CREATE VIEW jobs AS SELECT 1", "nothing else, got the view 'jobs'"),
    ],
)
def test_jobs_that_a_stranger_wrote_are_one_sentence(tmp_path, change, said):
    store = JobStore(tmp_path)
    store.add("play", {"seed": 1})
    store.close()
    with sqlite3.connect(tmp_path / ".studio.sqlite") as damaged:
        damaged.executescript(change)
    with pytest.raises(InvalidInputError, match=said):
        JobStore(tmp_path)


def gone(pid):
    until = time.monotonic() + 5
    while time.monotonic() < until:
        try:
            os.kill(pid, 0)
            with open(f"/proc/{pid}/stat") as stat:
                if stat.read().rpartition(")")[2].split()[0] == "Z":
                    return True
        except (ProcessLookupError, FileNotFoundError):
            return True
        time.sleep(0.01)
    return False


def test_processes_have_a_limit_of_memory_and_end_with_what_they_started():
    eater, crasher, parent = (
        Worker(f"tests.studio_work:{name}") for name in ("eat_memory", "crash", "wait_with_child")
    )
    try:
        assert eater.connection.recv() == "refused"
        with pytest.raises(EOFError):
            crasher.connection.recv()
        child = parent.connection.recv()
    finally:
        for worker in (eater, crasher, parent):
            worker.kill()
            worker.end()
    assert gone(child)
    assert not parent.alive


def test_a_job_that_crashes_fails_alone_and_one_that_is_cancelled_ends(tmp_path):
    told = []

    def spec(seed, **fields):
        return {
            "problem": {"kind": "swarm", "map": "maze:301x301", "particles": 40} | fields,
            "seed": seed,
        }

    async def until_running(queue, number):
        while (running := queue._running.get(number)) is None or running.worker is None:
            await asyncio.sleep(0.01)
        return running.worker

    async def scenario():
        queue = JobQueue(Folder(tmp_path), told.append)
        crashing = queue.add("play", spec(1), urgent=False)["id"]
        os.kill((await until_running(queue, crashing))._process.pid, signal.SIGKILL)
        cancelled = queue.add("play", spec(2), urgent=False)["id"]
        await until_running(queue, cancelled)
        queue.cancel(cancelled)
        short = {"map": "maze:9x7", "particles": 4, "policy": "closest-frontier"}
        good = queue.add("play", spec(3, **short), urgent=True)["id"]
        bad = queue.add("play", spec(3, map="no-such:9"), urgent=True)["id"]
        while not all(
            queue.describe(number)["state"] in ENDED for number in (crashing, cancelled, good, bad)
        ):
            await asyncio.sleep(0.01)
        found = [queue.describe(number) for number in (crashing, cancelled, good, bad)]
        pieces = [message["piece"] for message in told if message.get("of") == good]
        assert queue.pieces(good) == pieces  # also for a browser that asks after the end
        await queue.close()
        return found, pieces

    (crashed, cancelled, good, bad), pieces = asyncio.run(asyncio.wait_for(scenario(), 60))
    assert (crashed["state"], cancelled["state"], good["state"], bad["state"]) == (
        "failed",
        "cancelled",
        "done",
        "failed",
    )
    assert "crashed" in crashed["result"]["error"]
    assert "no-such" in bad["result"]["error"]
    assert sorted(path.name for path in tmp_path.glob("*.npz")) == [good["result"]["file"]]
    assert "begin" in pieces[0]
    assert pieces[-1]["end"] == "complete"
    assert (
        len("".join(piece.get("commands", "") for piece in pieces))
        == good["result"]["report"]["moves"]
    )


class SlowSocket:
    """A browser that is not ready for messages yet."""

    def __init__(self):
        self.asked = asyncio.Queue()
        self.ready = asyncio.Event()
        self.got = []

    async def accept(self):
        pass

    async def receive(self):
        return await self.asked.get()

    async def send_text(self, text):
        await self.ready.wait()
        self.got.append(json.loads(text))


def test_pieces_that_come_before_a_browser_watches_are_told_once(tmp_path):
    async def scenario():
        studio, socket = Studio(tmp_path), SlowSocket()
        live = asyncio.create_task(studio.live(socket))
        await asyncio.sleep(0)
        running = SimpleNamespace(job={"id": 7}, pieces=[], size=0, n_pieces=0)
        studio.queue._running[7] = running
        studio.tell({"files": True})  # which keeps the browser busy
        await asyncio.sleep(0)
        studio.queue._piece(running, {"begin": {}})
        watch = {"type": "websocket.receive", "text": '{"watch": 7}'}
        socket.asked.put_nowait(watch)
        while not socket.asked.empty():
            await asyncio.sleep(0)
        studio.queue._piece(running, {"commands": "lu"})
        socket.asked.put_nowait(watch)  # once more, which tells it nothing new
        while not socket.asked.empty():
            await asyncio.sleep(0)
        studio.queue._piece(running, {"end": "complete"})
        socket.ready.set()
        del studio.queue._running[7]
        socket.asked.put_nowait({"type": "websocket.disconnect"})
        while len(socket.got) < 5:
            await asyncio.sleep(0.01)
        live.cancel()
        await studio.close()
        return [(one["nth"], one["piece"]) for one in socket.got if "piece" in one]

    pieces = asyncio.run(asyncio.wait_for(scenario(), 60))
    assert pieces == [(0, {"begin": {}}), (1, {"commands": "lu"}), (2, {"end": "complete"})]
