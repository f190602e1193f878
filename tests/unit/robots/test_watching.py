"""Who does what from what is on the air: `SearchWatch`, shoal robot --watch, and the studio."""

from __future__ import annotations

import io
import json
import socket
import threading
import time

import pytest
from rich.console import Console

from shoal.cli import run
from shoal.cli.search.watching import table_of, title_of
from shoal.robots.radios import open_radio
from shoal.robots.tasks import read_task, write_task
from shoal.robots.watching import SearchWatch
from shoal.search import SearchProblem
from shoal.search.protocol.messages import Beacon, Heartbeat, Sender
from shoal.search.run import run as run_search
from shoal.studio.answers import answer
from shoal.studio.folder import Folder

PLANE = SearchProblem("rectangle:60x40", robots=2, footprint=20, vehicle="multirotor")


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    folder = tmp_path_factory.mktemp("task")
    write_task(run_search(PLANE, seed=1), folder)
    return read_task(folder)


class Air:
    """Robots that send beacons to one address."""

    def __init__(self, task):
        self.task = task
        self.mouth = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.mouth.bind(("127.0.0.1", 0))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self.ear = probe.getsockname()
        self.radio = f"udp:127.0.0.1:{self.ear[1]},127.0.0.1:9"
        self.senders = {number: Sender(number, task.key) for number in (1, 2)}

    def heartbeat(self, number, count, status="searching", place=0, lag=0.0):
        scenario = self.task.scenario
        about = scenario.starts[number - 1], scenario.rates[number - 1], status
        return Heartbeat(number, count, *about, scenario.widths[number - 1], place, lag)

    def send(self, number, count, *, searched=0, found=(), key=None, **about):
        beacon = Beacon(
            number, (self.heartbeat(number, count, **about),), ((number, searched),), found
        )
        sender = self.senders[number] if key is None else Sender(number, key)
        for message in sender.messages(beacon, time.time_ns() // 1_000_000):
            self.mouth.sendto(message, self.ear)

    def close(self):
        self.mouth.close()


@pytest.fixture
def air(task):
    made = Air(task)
    yield made
    made.close()


@pytest.fixture
def watch(task, air):
    radio = open_radio(air.radio)
    yield SearchWatch(task, radio)
    radio.close()


def rows(report):
    return {row["robot"]: row for row in report["robots"]}


def test_what_robots_tell_is_put_together(watch, air, task):
    assert [row["status"] for row in watch.report(0.0)["robots"]] == ["not heard"] * 2
    air.send(1, 5, place=3, searched=0b111, lag=2.5)
    air.send(2, 7, place=4, searched=0b100000, found=((5, 0b100),))
    air.send(1, 4, place=0)  # late: the newer heartbeat stays
    time.sleep(0.05)
    watch.listen(10.0)
    report = watch.report(12.0)
    first, second = (rows(report)[number] for number in (1, 2))
    assert (first["status"], first["cell"], first["searched"]) == ("searching", 3, 3)
    assert (first["heard_s"], first["messages"]) == (2.0, 2)
    assert first["late_s"] == pytest.approx(2.5 / task.speed, abs=0.1)
    assert [first["x"], first["y"]] == task.cells[3, :2].round(2).tolist()
    assert (second["cell"], report["found"]) == (4, [5])
    assert report["covered_fraction"] == pytest.approx(4 / 6)
    assert not report["complete"]
    # nobody is heard any more
    assert [row["status"] for row in watch.report(40.0)["robots"]] == ["silent"] * 2
    air.send(2, 8, searched=0b111000, lag=float(1 << 30))
    time.sleep(0.05)
    watch.listen(41.0)
    report = watch.report(41.0)
    assert rows(report)[2]["status"] == "gave up"
    assert report["complete"]
    console = Console(width=140, record=True, file=io.StringIO())
    console.print(table_of(report))
    assert "gave up" in console.export_text()


def test_messages_that_do_not_belong_are_refused_and_shown(watch, air):
    air.send(1, 5, key=b"a key of a stranger, long enough", searched=0b111111)
    air.mouth.sendto(b"noise", air.ear)
    time.sleep(0.05)
    watch.listen(1.0)
    report = watch.report(1.0)
    assert report["covered_fraction"] == 0
    assert report["refused"] == {"another key or search": 1, "broken": 1}
    assert table_of(report).caption == "refused: 1 another key or search, 1 broken"


def test_the_command_watches_until_the_search_is_complete(task, air, capsys, tmp_path):
    def speak():
        for count in range(40):
            air.send(1, count + 1, searched=0b000111)
            air.send(2, count + 1, searched=0b111000 if count > 4 else 0, place=3)
            time.sleep(0.05)

    speaking = threading.Thread(target=speak)
    speaking.start()
    options = ["--watch", "--radio", air.radio, "--out", str(tmp_path / "out")]
    assert run(["robot", str(task.path), *options, "--seconds", "20", "--json"]) == 0
    speaking.join()
    told = json.loads(capsys.readouterr().out)
    assert told["covered_fraction"] == 1.0
    assert json.loads((tmp_path / "out/watch.json").read_text())["complete"] is True
    assert run(["robot", str(task.path), *options[:3], "--seconds", "0.2"]) == 1
    assert "0 % of 6 cells searched: robot 1 not heard" in capsys.readouterr().err


def test_the_studio_watches_and_lets_go(task, air):
    folder = Folder(task.path.parent)
    about = {"task": "task.json", "radio": air.radio, "places": True}
    word, first = answer(folder, "watch", about)
    assert (word, first["covered_fraction"], len(first["places"])) == ("answer", 0.0, 6)
    air.send(1, 5, place=3, searched=0b101)
    time.sleep(0.05)
    word, told = answer(folder, "watch", {**about, "places": None})
    assert (word, told["done"]) == ("answer", [0, 2])
    assert "places" not in told
    assert answer(folder, "watch", {**about, "ends": True}) == ("answer", {"ended": True})
    open_radio(air.radio).close()  # the address is free again
    word, sentence = answer(folder, "watch", {**about, "radio": "udp:1"})
    assert word == "error"
    assert "radio: expected" in sentence["error"]


def test_with_a_prior_a_watch_tells_the_probability_of_success(tmp_path):
    problem = SearchProblem(
        "rectangle:30x20", robots=2, footprint=10, prior=["ring:5,5:0.5=5,0.9=20"], detection=0.8
    )
    write_task(run_search(problem, seed=1), tmp_path)
    prepared = read_task(tmp_path)
    air = Air(prepared)
    radio = open_radio(air.radio)
    try:
        watch = SearchWatch(prepared, radio)
        air.send(1, 5, searched=0b111)
        air.send(2, 5, searched=0b110)
        time.sleep(0.05)
        watch.listen(10.0)
        odds = prepared.plan.tour_cost.odds
        assert watch.report(10.0)["success"] == pytest.approx(0.8 * odds[:3].sum())
        assert "target found with" in title_of(watch.report(10.0))
    finally:
        radio.close()
        air.close()
