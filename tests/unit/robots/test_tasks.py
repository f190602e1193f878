"""Task files and journals: what was changed, broken or belongs to another search is refused, and a
robot goes on from its journal.
"""

from __future__ import annotations

import json
import os
import shutil
import stat

import pytest

from shoal import InvalidInputError
from shoal.robots.companion import Companion, journal_path
from shoal.robots.journal import Journal
from shoal.robots.tasks import KEY, TASK, RobotLimits, read_task, write_task
from shoal.search import SearchProblem
from shoal.search.run import run


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("task")
    problem = SearchProblem(region="rectangle:40x30", robots=3, footprint=10)
    write_task(run(problem, seed=1), folder)
    return folder


@pytest.fixture
def copy(folder, tmp_path):
    return shutil.copytree(folder, tmp_path / "copy")


class Silence:
    """A radio on which nobody answers."""

    most, fault = 400, ""

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


def test_another_key_and_other_files_are_refused(copy):
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
