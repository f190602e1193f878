"""Pause, take-over and stop by keys on a terminal."""

import json
import os
import subprocess
import sys
import threading
import time

import pytest
from tests.unit.swarm.test_rigs import ROOT, BenchTransport, bench

from shoal import open_map
from shoal.cli.swarm.keyboard import Keyboard, keyboard
from shoal.rigs import DriveInterrupted, RemoteRig, SimulatedRig, drive, read_log, replay_log

pytestmark = pytest.mark.skipif(not hasattr(os, "openpty"), reason="terminals are Unix's")
MAZE = open_map("maze:13x9:2")


class TakingItsTime(BenchTransport):
    """A rig that takes ten seconds for its fifth command."""

    sent, began = 0, 0.0

    def _write(self, data):
        self.sent += b'"type":"command"' in data
        if self.sent == 5 and b'"type":"command"' in data:
            self.press()
        elif not (self.sent == 5 and b'"observe"' in data):
            super()._write(data)


@pytest.fixture
def keys():
    """Return a keyboard and the end of the terminal into which a user types."""
    user, terminal = os.openpty()
    made = Keyboard(terminal, "lurd")
    thread = threading.Thread(target=made.listen)
    thread.start()
    yield made, lambda text: os.write(user, text)
    made.end()
    thread.join()
    os.close(user)
    os.close(terminal)


@pytest.mark.parametrize("every", ["1", "3", "adaptive"])
def test_commands_of_the_user_are_in_the_belief_and_in_the_log(tmp_path, capsys, keys, every):
    made, press = keys
    log, plan = tmp_path / "log.jsonl", ["p\n", "lz\n", "dd\n", " \n"]

    def rest(moves, send):
        if moves >= 20 and plan:
            for text in plan:
                press(text.encode())
            plan.clear()
            while not made._pauses.is_set():
                time.sleep(0.001)
        made.rest(moves, send)

    rig = SimulatedRig(MAZE, MAZE.cells[::11])
    result = drive(rig, log=log, on_rest=rest, policy="closest-frontier", scan_every=every)
    assert result.status == "complete"
    assert result.compared(MAZE) == {"false_free": 0, "false_obstacles": 0}
    manual = [event["move"] for event in read_log(log).events if event["event"] == "manual"]
    assert len(manual) == made.sent == 3
    assert "".join(result.commands[move - 1] for move in manual) == "ldd"
    again, verified = replay_log(log)
    assert verified, verified.message
    assert again.belief == result.belief
    said = capsys.readouterr().err
    assert f"paused after {manual[0] - 1} moves: l u r d" in said
    assert "the drive goes on" in said


@pytest.mark.parametrize("key", ["q", "x"])
def test_keys_that_end_a_drive_act_while_a_command_is_carried_out(keys, key, tmp_path):
    """The rig takes ten seconds for its fifth command, and the stop command ends it."""
    made, press = keys
    line = TakingItsTime(bench(MAZE).rig)
    line.press = lambda: press(f"{key}\n".encode())
    began = time.monotonic()
    with pytest.raises(DriveInterrupted) as ended:
        drive(RemoteRig(line, repeat_after=20, end_after=20), on_rest=made.rest)
    assert time.monotonic() - began < 9
    assert line.rig.stopped
    assert made.emergency == (key == "x")
    assert ended.value.drive.moves == 4


def test_a_terminal_is_left_as_it_was_and_a_pipe_left_alone(monkeypatch):
    termios = pytest.importorskip("termios")
    user, terminal = os.openpty()
    with os.fdopen(terminal) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(os, "tcgetpgrp", lambda _terminal: os.getpgrp())
        before = termios.tcgetattr(terminal)
        with keyboard("lurd") as made:
            assert made is not None
            assert not termios.tcgetattr(terminal)[3] & termios.ICANON
        assert termios.tcgetattr(terminal) == before
        monkeypatch.setattr(os, "tcgetpgrp", lambda _terminal: 1)
        with keyboard("lurd") as made:  # the terminal belongs to another program
            assert made is None
    reading, writing = os.pipe()
    with os.fdopen(reading) as pipe:
        monkeypatch.setattr(sys, "stdin", pipe)
        with keyboard("lurd") as made:
            assert made is None
    os.close(user)
    os.close(writing)


def test_the_command_listens_to_its_terminal(tmp_path):
    """In a session of its own, whose terminal is a pseudo-terminal."""
    (tmp_path / "map.txt").write_text(f"{MAZE}\n")
    log = tmp_path / "log.jsonl"
    run = f"{sys.executable} {ROOT / 'examples' / 'rig.py'} {tmp_path / 'map.txt'} --duration 0.05"
    own = "import fcntl, os, sys, termios; os.setsid(); fcntl.ioctl(0, termios.TIOCSCTTY, 0)"
    words = [sys.executable, "-c", f"{own}; from shoal.__main__ import main; main()", "drive"]
    words += ["--rig", f"exec:{run}", "--log", str(log), "--json"]
    user, terminal = os.openpty()
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(words, stdin=terminal, **pipes) as process:
        os.close(terminal)
        while b"space pauses" not in (said := process.stderr.readline()):
            assert said
        for key, answer in ((b" ", b"paused after"), (b"l", b"sent l"), (b"x", b"to go on")):
            os.write(user, key)
            while answer not in (said := process.stderr.readline()):
                assert said
        told = process.communicate(timeout=20)[0]
    os.close(user)
    assert process.returncode == 130
    assert json.loads(told)["status"] == "interrupted"
    past = read_log(log)
    assert [event["event"] for event in past.events if event["event"] == "manual"] == ["manual"]
