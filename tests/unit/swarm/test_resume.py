"""Drives that go on after an interruption."""

import json
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from shoal import open_map
from shoal.__main__ import main as shoal
from shoal.core.errors import InvalidInputError, RigError
from shoal.rigs import (
    ConnectionCutError,
    DriveError,
    DriveInterrupted,
    NoisyRig,
    RemoteRig,
    SimulatedRig,
    Transport,
    drive,
    read_log,
    replay_log,
)
from shoal.rigs.resume import rebuild
from shoal.swarm.noise import Noise
from tests.unit.swarm.test_rigs import BenchTransport, bench, example, free_of

MAZE = open_map("maze:13x9:2")


class Interrupting:
    """Ends a drive at a message to or from the rig, as Ctrl-C, a cut cable or SIGKILL would."""

    def __init__(self, kind, at):
        self.kind, self.left = kind, at

    def __call__(self, data):
        if self.kind is None or b'"type":"hello"' in data or b"stop" in data or b"welcome" in data:
            return data
        self.left -= 1
        if self.left == 0:
            kind, self.kind = self.kind, None
            raise {"ctrl-c": KeyboardInterrupt, "kill": MemoryError, "cable": EOFError}[kind]
        return data


class Killed(BenchTransport):
    """After SIGKILL, nothing more gets through, and no stop either."""

    dead = False

    def _write(self, data):
        if self.dead:
            raise ConnectionCutError("dead")
        try:
            super()._write(data)
        except MemoryError:
            self.dead = True
            raise


def counted(rig):
    """Count the commands that a rig carries out."""
    move, rig.carried_out = rig.swarm.move, ""

    def carry_out(command):
        rig.carried_out += command
        move(command)

    rig.swarm.move = carry_out
    return rig


def interrupted_drive(log, rig, kinds, every, **settings):
    """Drive and interrupt again and again, and return the last result."""
    luck = random.Random(7)
    for turn, kind in enumerate([*kinds, None]):
        wear = Interrupting(kind, luck.randint(2, 60))
        line = (Killed if kind == "kill" else BenchTransport)(rig, wear)
        past = read_log(log) if log.exists() else None
        remote = RemoteRig(
            line,
            repeat_after=0.05,
            end_after=0.1,
            resume=None if past is None else past.session,
        )
        go_on = {"resume": log} if turn else {"log": log, "scan_every": every, **settings}
        try:
            return drive(remote, **go_on), turn
        except (DriveInterrupted, DriveError):
            pass
    return None


@pytest.mark.parametrize("every", ["1", "3", "adaptive"])
def test_a_drive_that_is_interrupted_ten_times_finds_the_same_map(tmp_path, every):
    log, kinds = tmp_path / "log.jsonl", random.Random(3).choices(["ctrl-c", "kill", "cable"], k=10)
    rig = counted(bench(MAZE, particles=4).rig)
    result, turns = interrupted_drive(log, rig, kinds, every, policy="closest-frontier")
    assert turns >= 3
    assert (result.status, result.compared(MAZE)) == (
        "complete",
        {"false_free": 0, "false_obstacles": 0},
    )
    assert result.commands == rig.carried_out
    assert result.episode.verify().ok
    again, verified = replay_log(log)
    assert verified, verified.message
    assert (again.commands, again.belief) == (result.commands, result.belief)
    events = [event["event"] for event in read_log(log).events]
    assert events.count("resumed") == turns
