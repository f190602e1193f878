"""Rehearsals: real processes of robots, and simulated autopilots over UDP."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("pymavlink")

from shoal.cli import run
from shoal.robots.checklist import report_of, write_checklist
from shoal.robots.rehearsal import Happening, Rehearsal
from shoal.robots.tasks import RobotLimits, read_task, write_task
from shoal.search import SearchProblem
from shoal.search.run import run as run_search

SPEED_UP = 15.0


@pytest.fixture(scope="module")
def prepared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("prepared")
    problem = SearchProblem(
        "rectangle:60x20",
        robots=2,
        footprint=20,
        vehicle="multirotor,altitude=8",
        starts=((10.0, 10.0), (50.0, 10.0)),
        loss=0.1,
    )
    write_task(run_search(problem, seed=1), folder, RobotLimits(apart_s=3.0, vertical_m=5.0))
    return folder


def test_a_killed_robot_is_replaced_comes_home_and_goes_on(prepared, tmp_path):
    rehearsal = Rehearsal(
        read_task(prepared), tmp_path / "runs", speed_up=SPEED_UP, autopilot="ardupilot"
    )
    happened = []
    result = rehearsal.run(
        "killed",
        [Happening(0.3, "kill", 1), Happening(0.6, "restart", 1)],
        on_event=happened.append,
        stranger=True,
    )
    assert [one.split(" (")[0] for one in happened] == [
        "robot 1: its program is killed",
        "robot 1: its program is started again",
    ]
    assert result.record.covered_fraction == 1.0
    assert result.record.hovering == ()
    assert result.record.shared == ()
    _, second = result.robots
    assert second["status"] == "complete"
    assert second["refused"] > 0  # of the stranger
    assert (tmp_path / "runs/killed/robot-01.journal").exists()
    json_, markdown, html = write_checklist(rehearsal, [result], tmp_path)
    told = json.loads(json_.read_text())
    assert told["covered_fraction"] == 1.0
    assert told == json.loads(json.dumps(report_of(rehearsal, [result])))
    assert "| robot | ended as | battery left |" in markdown.read_text()
    assert "kill robot 1 after" in html.read_text()
    assert "FS_GCS_ENABLE" in markdown.read_text()


def test_ctrl_c_leaves_no_process(prepared, tmp_path):
    rehearsing = subprocess.Popen(
        [sys.executable, "-m", "shoal", "rehearse", str(prepared), "--out", str(tmp_path)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        process_group=0,
    )
    state = tmp_path / "rehearsal/all robots"
    wait_for(lambda: len([*state.glob("*.journal")]) == 2, rehearsing)
    os.killpg(rehearsing.pid, signal.SIGINT)
    assert rehearsing.wait(20) == 130
    assert b"shoal: interrupted" in rehearsing.stderr.read()
    rehearsing.stderr.close()
    left = subprocess.run(
        ["pgrep", "-f", str(state)], capture_output=True, text=True, check=False
    ).stdout
    assert left == ""


def wait_for(condition, process, seconds=60):
    end = time.monotonic() + seconds
    while not condition():
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (["--without", "3"], "without: expected a robot from 1 to 2, got 3"),
        (["--speed-up", "100"], "speed-up: expected a number from 0.1 to 20, got 100"),
        (["--loss", "2"], "loss: expected a number from 0 to 1, got 2"),
    ],
)
def test_bad_options_of_rehearsals_are_refused(prepared, capsys, options, sentence):
    assert run(["rehearse", str(prepared), *options]) == 2
    told = capsys.readouterr().err
    assert sentence in told
    assert len(told.splitlines()) == 1
    assert not (prepared / "rehearsal.json").exists()


def test_what_is_no_task_is_refused(tmp_path, capsys):
    assert run(["rehearse", str(tmp_path)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    (tmp_path / "task.json").write_text("{}")
    assert run(["rehearse", str(tmp_path)]) == 2
    assert "expected a task of the format" in capsys.readouterr().err
