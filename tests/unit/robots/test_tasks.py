"""Task files and journals: what was changed, broken or belongs to another search is refused, and a
robot goes on from its journal.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
import stat
import threading
from dataclasses import replace
from math import inf
from zlib import crc32

import pytest

from shoal import InvalidInputError
from shoal.cli import run as shoal_run
from shoal.robots import tasks
from shoal.robots.companion import Companion, beacon_bytes, journal_path
from shoal.robots.journal import Journal
from shoal.robots.radios import open_radio
from shoal.robots.right_of_way import RadioSensor
from shoal.robots.tasks import KEY, TASK, RobotLimits, read_task, write_task
from shoal.search import SearchProblem
from shoal.search.protocol.messages import Sender
from shoal.search.protocol.robot import with_beacon
from shoal.search.run import run
from shoal.testing import check_search_sensor


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("task")
    problem = SearchProblem(region="rectangle:40x30", robots=3, footprint=10)
    write_task(run(problem, seed=1), folder)
    return folder


@pytest.fixture
def copy(folder, tmp_path):
    return shutil.copytree(folder, tmp_path / "copy")


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Silence:
    """A radio on which nobody answers."""

    most, rate, fault = 400, inf, ""

    def __init__(self):
        self._pipe = os.pipe()

    def fileno(self):
        return self._pipe[0]

    def broadcast(self, message):
        return 0

    def receive(self):
        return None

    def close(self):
        pass


def test_a_task_says_the_plan_and_its_key_is_private(folder):
    task = read_task(folder)
    assert len(task.cells) == 12
    assert task.limits == RobotLimits()
    assert stat.S_IMODE((folder / KEY).stat().st_mode) == 0o600
    assert (folder / KEY).read_text().strip() not in (folder / TASK).read_text()
    assert read_task(folder / TASK).key == task.key


@pytest.mark.parametrize("name", ["cells", "limits", "loss", "seed", "search", "problem"])
def test_a_task_that_was_changed_is_refused(copy, name):
    body = json.loads((copy / TASK).read_text())
    value = body[name]
    body[name] = {**value, "more": 1} if isinstance(value, dict) else [value]
    (copy / TASK).write_text(json.dumps(body))
    with pytest.raises(InvalidInputError, match="the file was changed"):
        read_task(copy)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"limits": {"fuel": 1}}, "a task of this version"),
        ({"limits": {"battery": 2}}, "battery"),
        ({"problem": None}, "expected fields with values"),
        ({"seed": "one"}, "seed: expected a whole number"),
        ({"cells": [[0, 0]]}, "from planning the search on this computer"),
        ({"rates": [1.0, 1.0, 2.0]}, "from planning the search on this computer"),
    ],
)
def test_a_signed_task_of_another_version_is_refused(copy, changes, expected):
    body = json.loads((copy / TASK).read_text()) | changes
    body["signature"] = tasks._sign((copy / KEY).read_bytes().strip(), body)
    (copy / TASK).write_text(json.dumps(body))
    with pytest.raises(InvalidInputError, match=expected):
        read_task(copy)


def test_another_key_and_other_files_are_refused(copy):
    body = json.loads((copy / TASK).read_text())
    (copy / TASK).write_text(json.dumps(body | {"signature": "\ud800"}))
    with pytest.raises(InvalidInputError, match="the file was changed"):
        read_task(copy)
    (copy / KEY).write_text("0" * 64)
    with pytest.raises(InvalidInputError, match="another"):
        read_task(copy)
    (copy / TASK).write_text("[1, 2]")
    with pytest.raises(InvalidInputError, match="expected a task of the format"):
        read_task(copy)
    (copy / TASK).write_text("{")
    with pytest.raises(InvalidInputError, match=TASK):
        read_task(copy)


def test_a_robot_that_is_not_in_the_search_is_refused(folder):
    with pytest.raises(InvalidInputError, match="expected a robot from 1 to 3, got 4"):
        read_task(folder).live(4)


def test_a_robot_alone_searches_everything_and_goes_on_from_its_journal(folder, tmp_path):
    task = read_task(folder)
    journal = Journal(journal_path(tmp_path, 1), task.search, 1)
    result = Companion(task, 1, Silence(), journal, speed_up=400.0).run()
    journal.close()
    assert result.complete
    assert result.searched == len(task.cells)

    text = journal.path.read_bytes()
    lines = text.split(b"\n")
    for share in (0.3, 0.6, 0.9):  # killed at some event, in the middle of a line
        cut = b"\n".join(lines[: int(share * len(lines))]) + b"\n" + lines[-2][:7]
        journal.path.write_bytes(cut)
        again = Journal(journal.path, task.search, 1)
        done = again.replay(task.live(1).robot(1)).mine.bit_count()
        assert len(again.events) > 0
        result = Companion(task, 1, Silence(), again, speed_up=400.0).run()
        again.close()
        assert result.complete
        assert result.searched == len(task.cells) >= done


def test_a_journal_of_another_robot_or_that_is_broken_is_refused(folder, tmp_path):
    task = read_task(folder)
    path = journal_path(tmp_path, 1)
    journal = Journal(path, task.search, 1)
    for number in range(5):
        journal.report({"number": number})
    journal.close()
    with pytest.raises(InvalidInputError, match="robot 2"):
        Journal(path, task.search, 2)
    with pytest.raises(InvalidInputError, match="this search"):
        Journal(path, "another", 1)
    lines = path.read_bytes().split(b"\n")
    lines[2] = lines[2].replace(b"1", b"7")
    path.write_bytes(b"\n".join(lines))
    with pytest.raises(InvalidInputError, match="line 3"):
        Journal(path, task.search, 1)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ({"event": "Dance", "time": 1.0}, "line 2: expected an event of this version"),
        ({"event": "Wake", "time": 1.0, "more": 2}, "line 2: expected an event of this version"),
        ({"event": "Heard", "time": 1.0, "sender": 1, "beacon": "?"}, "line 2: expected an event"),
        ([1, 2], "line 2: expected an event of this version"),
        (
            {"event": "Sensed", "time": 1.0, "cell": 10**6},
            "event 1: expected an event of this search",
        ),
        ({"event": "Begin", "time": "now"}, "event 1: expected an event of this search"),
    ],
)
def test_a_journal_of_another_version_is_refused(folder, tmp_path, line, said):
    task = read_task(folder)
    path = journal_path(tmp_path, 1)
    head = {"search": task.search, "robot": 1, "epoch": 0.0}
    texts = [json.dumps(one).encode() for one in (head, line)]
    path.write_bytes(b"".join(b"%08x %s\n" % (crc32(text), text) for text in texts))
    with pytest.raises(InvalidInputError, match=said):
        Journal(path, task.search, 1).replay(task.live(1).robot(1))


def test_what_beacons_say_is_a_sensor(folder):
    task = read_task(folder)
    robot = task.live(1).robot(1)
    sensor = RadioSensor(
        replace(task.scenario, starts=(0,), rates=(), widths=()), lambda: robot, float
    )
    check_search_sensor(sensor, (0, 1, 5), through=(1, 2))


def test_a_slow_radio_sends_whole_beacons_and_no_more(folder, tmp_path):
    task = read_task(folder)
    slow, fast = Silence(), Silence()
    slow.most, slow.rate = 64, 20.0
    journals = [Journal(journal_path(tmp_path, number), task.search, number) for number in (1, 2)]
    robots = [
        Companion(task, number, radio, journal).agent.robot
        for number, radio, journal in zip((1, 2), (slow, fast), journals, strict=True)
    ]
    seconds = robots[0].brief.beat / task.speed
    assert seconds == pytest.approx(beacon_bytes(task.scenario, 64) / 20.0)
    assert robots[0].brief.hello >= 4 * robots[0].brief.beat
    assert robots[1].brief == task.scenario.brief
    # a beacon in the middle of a search takes no more than that
    robot = robots[0].replaced(
        searched={number: 0b11 << number for number in (1, 2, 3)}, count=1000, status="searching"
    )
    _, beacon = with_beacon(robot, 100.0)
    assert 64 * len(Sender(1, b"key", 64).messages(beacon, 0)) <= beacon_bytes(task.scenario, 64)
    for journal in journals:
        journal.close()


def test_two_programs_cannot_be_the_same_robot(tmp_path):
    path = journal_path(tmp_path, 1)
    first = Journal(path, "search", 1)
    with pytest.raises(InvalidInputError, match="no other program is this robot"):
        Journal(path, "search", 1)
    first.close()
    Journal(path, "search", 1).close()


def test_a_robot_whose_disk_is_full_goes_on_and_says_so(folder, tmp_path, monkeypatch):
    task, write, said = read_task(folder), os.write, []
    journal = Journal(journal_path(tmp_path, 1), task.search, 1)
    room = [2000]

    def write_while_there_is_room(file, data):
        data = data[: room[0]]
        room[0] -= len(data)
        return write(file, data)

    monkeypatch.setattr("shoal.robots.journal.os.write", write_while_there_is_room)
    result = Companion(task, 1, Silence(), journal, speed_up=400.0).run(said.append)
    journal.close()
    assert result.complete
    assert [text for text in said if "No space left" in text] == said[:1]
    monkeypatch.undo()
    again = Journal(journal.path, task.search, 1)
    robot = again.replay(task.live(1).robot(1), time=1000.0)
    assert 0 < robot.mine.bit_count() < len(task.cells)
    assert robot.count > 1000.0 / robot.brief.beat  # later than any beacon that was sent
    again.close()


def test_a_robot_tells_from_time_to_time_how_it_is(folder, tmp_path, monkeypatch):
    task, said = read_task(folder), []
    monkeypatch.setattr("shoal.robots.companion._TOLD", 0.0)

    class Noisy(Silence):
        broken = 3

        def __init__(self):
            super().__init__()
            os.write(self._pipe[1], b"!")
            self.came = [b"noise", b"noise"]

        def receive(self):
            return (self.came.pop(), "air") if self.came else None

    journal = Journal(journal_path(tmp_path, 1), task.search, 1)
    result = Companion(task, 1, Noisy(), journal, speed_up=400.0).run(said.append)
    journal.close()
    assert result.report()["messages"]["refused_by_reason"] == {"broken": 2}
    assert result.report()["messages"]["broken_frames"] == 3
    first = r"(listening|searching), knows 0 of 12 cells as searched, 0 by itself; messages: "
    assert re.match(first, said[0])
    assert said[-1].endswith(" 2 refused (2 broken); 3 frames beyond repair")


def test_prepared_limits_are_in_the_signed_task(tmp_path):
    limits = ["--limits", "battery=0.3, apart_s=20"]
    assert (
        shoal_run(["search", "square:30", "--robots", "2", "--prepare", str(tmp_path), *limits])
        == 0
    )
    assert read_task(tmp_path).limits == RobotLimits(battery=0.3, apart_s=20.0)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--limits", "battery=0.3"], "limits: expected --prepare FOLDER"),
        (["--prepare", "P", "--limits", "battery=2"], "limits: battery: expected a number"),
        (["--prepare", "P", "--limits", "fuel=2"], "limits: expected each of battery"),
        (["--prepare", "P", "--limits", "battery=low"], "limits: expected a number as battery"),
        (["--prepare", "P", "--autopilot", "px4"], "a region with a place on Earth"),
    ],
)
def test_bad_options_of_preparations_are_refused(tmp_path, monkeypatch, capsys, options, sentence):
    monkeypatch.chdir(tmp_path)
    assert shoal_run(["search", "rectangle:40x30", "--robots", "2", *options]) == 2
    told = capsys.readouterr().err
    assert sentence in told
    assert len(told.splitlines()) == 1
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--id", "4"], "id: expected a robot from 1 to 3, got 4"),
        ([], "id: expected the number of this robot, got none"),
        (["--id", "1", "--vehicle", "balloon:"], "vehicle: expected mavlink:LINK or simulated:"),
        (["--id", "1", "--arm"], "arm: expected --vehicle mavlink:"),
        (["--id", "1", "--seconds", "3"], "seconds: expected --watch"),
        (["--id", "1", "--loss", "2"], "loss: expected a number from 0 to 1"),
    ],
)
def test_bad_options_of_robots_are_refused(folder, capsys, options, sentence):
    command = ["robot", str(folder), "--radio", f"udp:127.0.0.1:{free_port()},127.0.0.1:9"]
    assert shoal_run([*command, *options]) == 2
    told = capsys.readouterr().err
    assert sentence in told
    assert len(told.splitlines()) == 1
    assert sorted(path.name for path in folder.iterdir()) == [TASK, KEY]


def test_robots_meet_over_udp_and_refuse_those_of_another_search(folder, tmp_path, capsys):
    """Two robots of a search, and one with the key of another, at three addresses."""
    others = tmp_path / "others"
    problem = SearchProblem(region="rectangle:40x30", robots=3, footprint=10)
    write_task(run(problem, seed=1), others)
    ports = [free_port() for _ in range(3)]
    results = {}

    def search(number, home):
        task = read_task(home)
        own, *rest = (f"127.0.0.1:{port}" for port in [ports[number - 1], *ports])
        rest.remove(own)
        radio = open_radio(f"udp:{own},{','.join(rest)}")
        journal = Journal(journal_path(tmp_path, number), task.search, number)
        results[number] = Companion(task, number, radio, journal, loss=0.3, speed_up=60.0).run()
        radio.close()
        journal.close()

    robots = [
        threading.Thread(target=search, args=(number, home), daemon=True)
        for number, home in ((1, folder), (2, folder), (3, others))
    ]
    for robot in robots:
        robot.start()
    for robot in robots:
        robot.join(60)
    assert all(results[number].complete for number in (1, 2, 3))
    for number in (1, 2):
        assert results[number].searched < 12
        assert results[number].refused["another key or search"] > 0
    assert results[3].searched == 12
    assert results[3].counts[1] == 0
