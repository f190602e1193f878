"""Driving rigs: the protocol, lines that are cut and damage messages, the stop command, the log."""

from __future__ import annotations

import importlib.util
import json
import os
import queue
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest
from tests.swarm_runs import run

from shoal import GridWorkspace, InvalidInputError, OutputError, open_map
from shoal.cli import run as shoal
from shoal.core.errors import RigError
from shoal.rigs import (
    ConnectionCutError,
    DriveLog,
    RecordedRig,
    RemoteRig,
    SimulatedRig,
    Transport,
    decode_message,
    drive,
    encode_message,
    open_rig,
    open_transport,
    read_log,
    replay_log,
)
from shoal.rigs.protocol import Command, Positions, Refusal, Stop
from shoal.swarm.problem import SwarmProblem

ROOT = Path(__file__).parents[3]


def load_rig():
    """Import examples/rig.py."""
    spec = importlib.util.spec_from_file_location("example_rig", ROOT / "examples" / "rig.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


example = load_rig()


def free_of(workspace):
    return {tuple(cell) for cell in workspace.cells.tolist()}


class BenchTransport(Transport):
    """A line to a rig in this process; ``wear(data)`` returns what comes through, or raises
    ConnectionCutError.
    """

    def __init__(self, rig_, wear=lambda data: data):
        super().__init__("bench")
        self.rig, self.wear, self.came, self.opened = rig_, wear, queue.Queue(), 0

    def _open(self):
        self.opened += 1
        self.came = queue.Queue()

    def _write(self, data):
        for line in self.wear(data).split(b"\n"):
            answer = self.rig.reply(line)
            if answer:
                self.came.put(self.wear(answer))

    def _read(self, timeout):
        try:
            return self.came.get(timeout=min(timeout, 0.01))
        except queue.Empty:
            return b""

    def close(self):
        self.came = queue.Queue()


def bench(workspace, particles=5, wear=lambda data: data, seed=2):
    return BenchTransport(
        example.Rig(
            example.Swarm(free_of(workspace), particles, seed), workspace.shape, name="bench"
        ),
        wear,
    )


# -------------------------------------------------------------------------------------------------
# drive


@pytest.mark.parametrize("every", ["1", "3", "doubling", "adaptive"])
@pytest.mark.parametrize("rule", ["block", "merge", "tilt"])
def test_a_simulated_rig_is_driven_as_an_episode_is_run(every, rule):
    if rule == "tilt" and every != "1":
        return
    workspace = open_map("cave:24x18:2")
    episode = run(workspace, particles=9, seed=3, rule=rule, scan_every=every)
    rig = SimulatedRig(workspace, episode.start, rule=rule)
    driven = drive(rig, policy="closest-frontier", scan_every=every, test_move=False)
    assert (driven.commands, driven.status) == (episode.commands, episode.status)
    assert driven.episode.trace.difference(episode.trace) is None
    assert driven.episode.verify()
    assert driven.compared(workspace) == {"false_free": 0, "false_obstacles": 0}


def test_three_dimensions():
    workspace = GridWorkspace(np.random.default_rng(5).random((3, 4, 5)) < 0.8).largest_component()
    driven = drive(SimulatedRig(workspace, workspace.cells[:3]))
    assert driven.status == "complete"
    assert driven.episode.workspace == workspace


class Faulty(SimulatedRig):
    """Shows one particle elsewhere after some scans."""

    def __init__(self, *arguments, wrong, **options):
        super().__init__(*arguments, **options)
        self.scans, self.wrong, self.stops = 0, wrong, 0

    def observe(self):
        self.scans += 1
        cells = super().observe().copy()
        return self.wrong(cells) if self.scans == 4 else cells

    def stop(self):
        self.stops += 1


@pytest.mark.parametrize(
    ("wrong", "kind", "words"),
    [
        (lambda cells: cells[:-1], "number", "3 particles before, 2 now"),
        (lambda cells: cells[:0], "number", "3 particles before, none now"),
        (lambda cells: np.concatenate([cells, [[3, 8]]]), "number", "3 particles before, 4 now"),
        (
            lambda cells: cells - [[0, 0], [0, 0], [1, 0]],
            "drift",
            "against the command or to the side",
        ),
        (
            lambda cells: np.subtract(cells, [0, 2]),
            "direction",
            "the particles moved as command 'l' moves them",
        ),
        (
            lambda cells: np.add(cells, [0, 1]),
            "twice",
            "a particle moved by more than 1 cell: the command was carried out twice",
        ),
        (
            lambda cells: np.subtract(cells, [0, 1]),
            "still",
            "nothing moved although a particle has a free cell ahead",
        ),
        (
            lambda cells: cells - [[0, 0], [0, 1], [0, 0]],
            "rule",
            "expected every particle to move as rule block requires",
        ),
    ],
)
def test_positions_that_contradict_a_command_are_an_alarm_and_nothing_found_is_lost(
    wrong, kind, words
):
    """The scan after the third command lies. All three particles have known free cells
    ahead then.
    """
    rig = Faulty(GridWorkspace(np.ones((4, 9))), [(1, 2), (2, 4), (3, 6)], wrong=wrong)
    driven = drive(rig, policy="manual:rlr")
    assert rig.stops == 1
    assert (str(driven.status), driven.commands, bool(driven)) == ("alarm", "rl", False)
    assert [alarm.kind for alarm in driven.alarms] == [kind]
    assert words in driven.alarms[0].text
    assert words in driven.reason
    assert driven.trust.level == ("none" if kind == "direction" else "limited")
    assert driven.episode.verify()
    assert {(1, 2), (1, 3), (2, 4), (3, 7)} <= set(driven.belief.open)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (lambda cells: np.subtract(cells, [2, 0]), "got (-1, 3)"),
        (lambda cells: np.add(cells, [0, 99]), "expected cells inside (4, 9), got (1, 102)"),
        (lambda cells: np.subtract(cells, [0, 99]), "expected cells inside (4, 9), got (1, -96)"),
        (lambda cells: cells + np.nan, "expected integer cells of shape (n, 2), got float64"),
        (lambda cells: cells + 0.5, "expected integer cells of shape (n, 2), got float64"),
        (
            lambda cells: [[1, 3], [2]],
            "expected integer cells of shape (n, 2), got rows of different lengths",
        ),
        (lambda cells: [[1, 2**70]], "expected integer cells of shape (n, 2), got float64"),
        (
            lambda cells: np.array([[1, 2**63]], dtype=np.uint64),
            "expected cells inside (4, 9), got (1, 9223372036854775808)",
        ),
        (lambda cells: cells[:, :1], "expected integer cells of shape (n, 2), got int64 (3, 1)"),
        (lambda cells: None, "expected integer cells of shape (n, 2), got None"),
    ],
)
def test_a_position_outside_the_field_is_an_error_of_the_rig_which_keeps_the_map(wrong, words):
    rig = Faulty(GridWorkspace(np.ones((4, 9))), [(1, 2), (2, 4), (3, 6)], wrong=wrong)
    with pytest.raises(RigError, match=re.escape(words)) as raised:
        drive(rig, policy="manual:rlr")
    assert rig.stops == 1
    assert raised.value.drive.commands == "rl"
    assert raised.value.drive.status == "interrupted"
    assert raised.value.drive.episode.verify()


def test_ctrl_c_stops_the_rig_and_ends_the_log(tmp_path):
    rig = Faulty(
        open_map("maze:9x7"),
        open_map("maze:9x7").cells[:1],
        wrong=lambda cells: (_ for _ in ()).throw(KeyboardInterrupt),
    )
    with pytest.raises(KeyboardInterrupt):
        drive(rig, policy="closest-frontier", log=DriveLog(tmp_path / "log.jsonl"))
    assert rig.stops == 1
    result, verified = replay_log(tmp_path / "log.jsonl")
    assert result.moves == 2
    assert (result.status, result.episode.status) == ("interrupted", "interrupted")
    assert result.episode.verify()
    assert "was interrupted" in verified.message


# ----------------------------------------------------------------------------------------------
# messages


def test_a_message_comes_back_and_no_single_damage_gets_through():
    line = encode_message(Positions(seq=12, cells=[[3, 4], [-1, 70]]))
    assert json.loads(line)["cells"] == [[3, 4], [-1, 70]]
    assert decode_message(line) == Positions(seq=12, cells=[[3, 4], [-1, 70]])
    for at in range(len(line) - 1):
        for flip in (1, 32, 128):
            changed = line[:at] + bytes([line[at] ^ flip]) + line[at + 1 :]
            assert decode_message(changed) in (None, decode_message(line)), changed
        assert decode_message(line[:at]) is None
    assert example.decode_message(line)["cells"] == [[3, 4], [-1, 70]]
    assert decode_message(example.encode_message({"type": "stop"})) == Stop()


def test_a_whole_line_that_is_no_message_is_the_rigs_fault():
    with pytest.raises(InvalidInputError, match="expected a message of protocol 1, got"):
        decode_message(example.encode_message({"type": "wave"}))
    with pytest.raises(InvalidInputError, match=r"command\.seq"):
        decode_message(example.encode_message({"type": "command", "seq": -1, "command": "l"}))


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("usb", r"rig: expected serial:DEVICE\[@BAUD\], tcp"),
        ("tcp:here", "tcp:HOST:PORT"),
        ("tcp:here:70000", "tcp:HOST:PORT"),
        ("exec:", "exec:COMMAND"),
        ('exec:"', "No closing quotation"),
        (
            "serial:/dev/no-such-port",
            "expected a serial port, got '/dev/no-such-port', which does not exist",
        ),
        ("serial:/dev/x@fast", "expected a speed in baud after '@', got 'fast'"),
    ],
)
def test_specs(spec, words):
    with pytest.raises(InvalidInputError, match=words):
        open_transport(spec)


# -----------------------------------------------------------------------------------------------
# the link


def test_a_damaged_request_or_answer_is_asked_for_again_and_carried_out_once():
    workspace = open_map("maze:9x7")
    for kind in ("changed", "lost", "cut short", "twice"):
        bad = example.BadLine(cuts=0, damage=0.3, every=1, seed=5)
        bad.random.choice = lambda _kinds, kind=kind: kind
        line = bench(workspace, wear=bad.carry)
        rig = RemoteRig(line, repeat_after=0.02, end_after=20)
        driven = drive(rig, policy="closest-frontier")
        assert driven.episode.workspace == workspace
        assert driven.episode.verify()
        assert bad.damaged > 20
        assert line.rig.stopped


def test_a_command_is_carried_out_once_if_the_line_is_cut_before_its_answer():
    wall = GridWorkspace(np.ones((1, 30)))
    cut = [False]

    def wear(data):
        if b'"done"' in data and not cut[0]:
            cut[0] = True
            raise ConnectionCutError("pulled")
        cut[0] = cut[0] and b'"done"' not in data
        return data

    line = bench(wall, particles=1, wear=wear)
    rig = RemoteRig(line, repeat_after=0.05, end_after=5)
    before = rig.observe()[0, 1]
    rig.send("r" if before < 20 else "l")
    assert abs(rig.observe()[0, 1] - before) == 1
    assert (rig.counts.reconnects, line.opened) == (1, 2)


def test_a_rig_that_was_started_anew_is_not_gone_on_with():
    workspace, calls = open_map("maze:9x7"), []

    def wear(data):
        if b'"observe"' in data and not calls:
            calls.append(1)
            line.rig = bench(workspace).rig
            raise ConnectionCutError("power failure")
        return data

    line = bench(workspace, wear=wear)
    rig = RemoteRig(line, repeat_after=0.05, end_after=5)
    rig.send("l")
    with pytest.raises(RigError, match="the rig has restarted"):
        rig.observe()


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (
            {"type": "welcome", "protocol": 2, "session": "s", "seq": 0, "shape": [2, 2]},
            "expected a rig that speaks protocol 1, got 2",
        ),
        (
            {
                "type": "welcome",
                "protocol": 1,
                "session": "s",
                "seq": 0,
                "shape": [2, 2],
                "rule": "hop",
            },
            "expected a rule out of",
        ),
        (
            {"type": "welcome", "protocol": 1, "session": "s", "seq": 0, "shape": [99999, 99999]},
            "at most",
        ),
        (
            {"type": "welcome", "protocol": 1, "session": "other", "seq": 3, "shape": [2, 2]},
            "expected a new session",
        ),
        (
            {"type": "error", "text": "no magnets today"},
            "the rig refuses the request: no magnets today",
        ),
        ({"type": "greetings"}, "expected a message of protocol 1"),
    ],
)
def test_a_rig_that_is_none_of_ours(answer, words):
    line = bench(open_map("line:5"))
    line.rig.reply = lambda data: example.encode_message(answer) if data.strip() else b""
    with pytest.raises(RigError, match=words):
        RemoteRig(line, repeat_after=0.05, end_after=1, session="s")


def test_a_silent_rig_is_given_up():
    line = bench(open_map("line:5"))
    rig = RemoteRig(line, repeat_after=0.02, end_after=0.1)
    line.rig.reply = lambda data: b""
    with pytest.raises(RigError, match=r"bench: no answer from the rig for 0.1 s"):
        rig.send("l")
    with pytest.raises(RigError, match="has not confirmed the stop"):
        rig.stop()
    with pytest.raises(RigError, match="no answer"):
        RemoteRig(line, repeat_after=0.01, end_after=0.05)


def test_a_rig_that_tells_nonsense():
    line = bench(open_map("line:5"))
    rig = RemoteRig(line, repeat_after=0.05, end_after=1)
    line.rig.reply = lambda data: (
        encode_message(Positions(seq=1, cells=[[0, 1, 2]])) if data.strip() else b""
    )
    with pytest.raises(RigError, match="bench: positions: expected integer cells"):
        rig.observe()
    with pytest.raises(InvalidInputError, match="expected one command out of 'lurd'"):
        rig.send("q")


def test_stop_gets_through_damage_cuts_and_half_a_message():
    workspace, bad = open_map("line:9"), example.BadLine(cuts=0, damage=0.0, every=1, seed=1)
    line = bench(workspace, particles=1, wear=bad.carry)
    rig = RemoteRig(line, repeat_after=0.02, end_after=20)
    bad.damage = 0.7
    # an interruption in the middle of a message
    line.write(encode_message(Command(seq=1, command="l"))[:20])
    rig.stop()
    bad.damage = 0.0
    assert line.rig.stopped
    with pytest.raises(RigError, match="the rig has been stopped"):
        rig.send("l")


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="pseudo-terminals are Unix's")
def test_the_example_maps_through_a_pseudo_terminal_that_is_cut_ten_times_and_damages_a_twentieth(
    tmp_path,
):
    workspace = open_map("vessels:200")
    (tmp_path / "map.txt").write_text(f"{workspace}\n")
    link, log = tmp_path / "rig", tmp_path / "log.jsonl"
    options = [
        "--particles",
        "20",
        "--seed",
        "4",
        "--cuts",
        "10",
        "--every",
        "30",
        "--damage",
        "0.05",
        "--pause",
        "0.02",
    ]
    words = [
        sys.executable,
        str(ROOT / "examples" / "rig.py"),
        str(tmp_path / "map.txt"),
        "--pty",
        str(link),
        *options,
    ]
    with subprocess.Popen(words) as process:
        try:
            while not link.exists():
                time.sleep(0.01)
            book = DriveLog(log)
            with open_rig(
                f"serial:{link}", repeat_after=0.05, end_after=30, on_event=book.event
            ) as rig:
                driven = drive(rig, policy="closest-frontier", log=book)
        finally:
            process.terminate()
    assert driven.status == "complete"
    assert driven.compared(workspace) == {"false_free": 0, "false_obstacles": 0}
    assert driven.episode.workspace == workspace
    assert driven.link.reconnects == 10
    assert driven.link.damaged > 5
    assert driven.link.resent >= driven.link.reconnects
    result, verified = replay_log(log)
    assert verified, verified.message
    assert result.commands == driven.commands
    assert len(read_log(log).events) >= 20


def test_tcp(tmp_path):
    import socket

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    workspace = open_map("maze:9x7")
    made = example.Rig(example.Swarm(free_of(workspace), 3, 1), workspace.shape, name="tcp")
    bad = example.BadLine(cuts=3, damage=0.0, every=25, seed=0)
    threading.Thread(target=example.serve_tcp, args=(made, port, bad), daemon=True).start()
    with open_rig(f"tcp:127.0.0.1:{port}", repeat_after=1, end_after=20) as rig:
        driven = drive(rig, policy="closest-frontier")
    assert driven.episode.workspace == workspace
    assert driven.link.reconnects == 3


# ------------------------------------------------------------------------------------------------
# the log


@pytest.mark.parametrize("every", ["1", "4", "adaptive"])
@pytest.mark.parametrize("rule", ["block", "merge", "tilt"])
def test_a_log_replays(tmp_path, every, rule):
    if rule == "tilt" and every != "1":
        return
    log, workspace = tmp_path / "log.jsonl", open_map("cave:20x14:1")
    start = workspace.cells[:: workspace.n_free // 5]
    driven = drive(
        SimulatedRig(workspace, start, rule=rule),
        policy="closest-frontier",
        scan_every=every,
        log=DriveLog(log),
        max_moves=150,
    )
    result, verified = replay_log(log)
    assert verified, verified.message
    assert (result.commands, result.belief) == (driven.commands, driven.belief)
    np.testing.assert_array_equal(result.trace.scanned, driven.trace.scanned)
    whole = log.read_bytes()
    lines = whole.splitlines(keepends=True)
    log.write_bytes(b"".join(lines[: len(lines) // 2]) + b'{"kind":"sc')  # the power failed
    result, verified = replay_log(log)
    assert driven.commands.startswith(result.commands)
    assert "breaks off" in verified.message


def test_a_log_may_be_a_path(tmp_path):
    workspace = open_map("maze:9x7")
    drive(SimulatedRig(workspace, workspace.cells[:1]), log=tmp_path / "log.jsonl", max_moves=5)
    assert replay_log(tmp_path / "log.jsonl")[1]
    with pytest.raises(OutputError, match="the file exists already"):
        drive(SimulatedRig(workspace, workspace.cells[:1]), log=str(tmp_path / "log.jsonl"))
    with pytest.raises(InvalidInputError, match="log: expected a DriveLog or a path, got True"):
        drive(SimulatedRig(workspace, workspace.cells[:1]), log=True)


def test_a_changed_log_is_noticed(tmp_path):
    log = tmp_path / "log.jsonl"
    drive(
        SimulatedRig(open_map("maze:9x7"), open_map("maze:9x7").cells[[0, 9]]),
        policy="closest-frontier",
        log=DriveLog(log),
    )
    lines = log.read_text().splitlines()

    def changed(at, old, new):
        assert old in lines[at]
        log.write_text(
            "\n".join([*lines[:at], lines[at].replace(old, new, 1), *lines[at + 1 :]]) + "\n"
        )

    changed(len(lines) - 1, '"free":39', '"free":38')
    assert "free: 38 in the log, 39 replayed" in replay_log(log)[1].message
    changed(0, "shoal-drive", "shoal-dive")
    with pytest.raises(InvalidInputError, match=r"log.jsonl, line 1: log: "):
        read_log(log)
    changed(2, '"command":"l"', '"command":"q"')
    with pytest.raises(
        InvalidInputError, match="line 3: expected command 1, one of 'lurd', got 'q'"
    ):
        read_log(log)
    changed(3, '"move":1', '"move":2')
    with pytest.raises(
        InvalidInputError, match="line 4: expected one scan after move 1, got one of 2"
    ):
        read_log(log)
    changed(4, "{", "[")
    with pytest.raises(
        InvalidInputError, match="line 5: expected JSON, got something else in line 1, column 8"
    ):
        read_log(log)
    with pytest.raises(OutputError, match="the file exists already"):
        DriveLog(log)
    with pytest.raises(RigError, match="move 1: expected the recorded command 'l', got 'r'"):
        RecordedRig("p", (2, 2), SwarmProblem("rig"), "x", 0, "l", {}, [], None).send("r")


# ------------------------------------------------------------------------------------------- the
# command


def test_command_with_a_program_as_rig(tmp_path, capsys):
    workspace = open_map("maze:9x7")
    (tmp_path / "map.txt").write_text(f"{workspace}\n")
    spec = (
        f"exec:{sys.executable} {ROOT / 'examples' / 'rig.py'} {tmp_path / 'map.txt'} --particles 4"
    )
    log = tmp_path / "log.jsonl"
    assert shoal(["drive", "maze:9x7", "--rig", spec, "--log", str(log), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["status"], result["free_cells"], result["particles"]) == ("complete", 39, 4)
    assert result["wrong"] == {"false_free": 0, "false_obstacles": 0}
    assert shoal(["replay", str(log), "--json", "--out", str(tmp_path / "out")]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["verified"] is True
    assert again["commands"] == result["commands"]
    assert (tmp_path / "out" / "map.png").exists()
    assert shoal(["drive", "maze:9x7", "--rig", spec, "--log", str(log)]) == 2
    assert "the file exists already" in capsys.readouterr().err
    assert shoal(["drive", "--size", "7x8", "--rig", spec]) == 2
    assert (
        "size: expected a rig of 7 rows × 8 columns, got map, which sees 7 rows × 9 columns"
        in capsys.readouterr().err
    )
    assert shoal(["drive", "--rig", "simulated"]) == 2
    assert "expected a map, such as vessels:500" in capsys.readouterr().err
    assert shoal(["drive", "--rig", "exec:false", "--end-after", "0.1"]) == 2
    assert "no answer from the rig" in capsys.readouterr().err


DYING = """
import json, pathlib, sys, zlib
def say(**message):
    text = json.dumps(message, separators=(",", ":"))[:-1]
    print(f'{text},"crc":"{zlib.crc32(text.encode()):08x}"}}', flush=True)
with open(sys.argv[1], "a") as heard:
    for line in filter(str.strip, sys.stdin):
        message = json.loads(line)
        print(message["type"], file=heard, flush=True)
        if message["type"] == "hello":
            say(type="welcome", protocol=1, session=message["session"], seq=0, shape=[2, 3], rule="block", name="dying")
        elif message["type"] == "observe":
            say(type="positions", seq=message["seq"], cells=[[0, 0]])
        elif message["type"] == "stop" and sys.argv[2] == "stops":
            say(type="stopped")
        elif message["type"] == "command" and sys.argv[2] == "stops":
            sys.exit(3)
        elif message["type"] == "command":
            say(type="done", seq=message["seq"])
"""


def dying(tmp_path, how):
    (tmp_path / "rig.py").write_text(DYING)
    return f"exec:{sys.executable} {tmp_path / 'rig.py'} {tmp_path / 'heard.txt'} {how}"


def test_a_rig_that_dies_at_a_command_is_told_to_stop_all_the_same(tmp_path, capsys):
    """It comes back as one that knows nothing of what was done: the drive ends, after a stop
    command over a new line.
    """
    assert (
        shoal(
            [
                "drive",
                "--rig",
                dying(tmp_path, "stops"),
                "--repeat-after",
                "0.5",
                "--end-after",
                "2",
            ]
        )
        == 2
    )
    said = capsys.readouterr().err
    assert "the rig has restarted" in said
    assert len(said.strip().splitlines()) == 1
    heard = (tmp_path / "heard.txt").read_text().split()
    once = [message for message, _ in groupby(heard)]  # a rig that starts slowly is asked again
    assert once == ["hello", "observe", "command", "hello", "stop"]


def test_a_log_ends_with_the_map_even_if_the_rig_does_not_confirm_the_stop(tmp_path, capsys):
    words = [
        "drive",
        "--rig",
        dying(tmp_path, "goes on"),
        "--repeat-after",
        "0.1",
        "--end-after",
        "0.3",
        "--max-moves",
        "3",
    ]
    assert shoal([*words, "--log", str(tmp_path / "log.jsonl")]) == 2
    assert "has not confirmed the stop command" in capsys.readouterr().err
    last = json.loads((tmp_path / "log.jsonl").read_text().splitlines()[-1])
    assert (last["kind"], last["status"], last["moves"]) == ("end", "limit", 3)


@pytest.mark.skipif(os.name != "posix", reason="the programs are Unix's")
@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("true", "no answer from the rig: the program has ended with exit code 0"),
        ("sh -c 'exit 7'", "no answer from the rig: the program has ended with exit code 7"),
        ("sh -c 'kill -9 $$'", "no answer from the rig: the program was ended by signal 9"),
        ("/no/such/rig", "the program '/no/such/rig' cannot be started: No such file or directory"),
        ("/etc/passwd", "the program '/etc/passwd' cannot be started: Permission denied"),
        ("echo hello", "expected messages of protocol 1, got 'hello'"),
        ("yes", "100 lines in a row were damaged: expected messages of protocol 1, got 'y'"),
        ("sh -c 'exec >&-; exec sleep 9'", "the program has closed its standard output"),
    ],
)
def test_nobody_waits_for_a_program_that_is_no_rig(command, words):
    with pytest.raises(RigError) as error:
        open_rig(f"exec:{command}", end_after=8)
    assert words in str(error.value)
    assert "for 8 s" not in str(error.value)


def test_the_last_words_of_a_program_are_said(tmp_path):
    (tmp_path / "rig.py").write_text(
        f"print({encode_message(Refusal(text='no camera'))!r}.decode())"
    )
    with pytest.raises(RigError, match="the rig refuses the request: no camera"):
        open_rig(f"exec:{sys.executable} {tmp_path / 'rig.py'}", end_after=8)


def test_nobody_waits_for_a_server_that_closes_each_connection():
    with socket.create_server(("127.0.0.1", 0)) as server:

        def close_all():
            with suppress(OSError):
                while True:
                    server.accept()[0].close()

        threading.Thread(target=close_all, daemon=True).start()
        with pytest.raises(RigError, match=r"no answer from the rig: (?!.*for 8 s)"):
            open_rig(f"tcp:127.0.0.1:{server.getsockname()[1]}", end_after=8)
        server.shutdown(socket.SHUT_RDWR)


def test_a_refused_connection_is_tried_for_as_long_as_a_rig_takes_to_start():
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(RigError, match=r"no answer from the rig: .*refused"):
        open_rig(f"tcp:127.0.0.1:{port}", repeat_after=0.1, end_after=8)
    workspace = open_map("maze:9x7")
    made = example.Rig(example.Swarm(free_of(workspace), 3, 1), workspace.shape, name="late")
    good = example.BadLine(cuts=0, damage=0.0, every=1, seed=0)
    late = threading.Timer(0.3, example.serve_tcp, args=(made, port, good))
    late.daemon = True
    late.start()
    with open_rig(f"tcp:127.0.0.1:{port}", repeat_after=8) as rig:
        assert rig.name == "late"


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="pseudo-terminals are Unix's")
def test_nobody_waits_for_a_pseudo_terminal_whose_other_side_is_gone():
    controller, terminal = os.openpty()
    device = os.ttyname(terminal)

    def hang_up():
        os.read(controller, 1)
        os.close(controller)

    threading.Thread(target=hang_up, daemon=True).start()
    try:
        with pytest.raises(RigError, match=r"no answer from the rig: (?!.*for 8 s)"):
            open_rig(f"serial:{device}", end_after=8)
    finally:
        os.close(terminal)


@pytest.mark.parametrize("ends", ["at once", "after the next hello"])
def test_a_program_that_ends_in_the_middle_for_good_keeps_the_map(ends, tmp_path, capsys):
    """It is started anew once, and again for the stop command."""
    spec = dying(tmp_path, "stops")
    program = tmp_path / "rig.py"
    starts = tmp_path / "starts"
    first = f"import pathlib, sys\nstarts = pathlib.Path({str(starts)!r})\n"
    first += (
        "n = len(starts.read_text()) if starts.exists() else 0\nstarts.write_text('.' * (n + 1))\n"
    )
    first += (
        f"if n:\n    {'sys.stdin.readline()' if ends != 'at once' else 'pass'}\n    sys.exit(5)\n"
    )
    program.write_text(first + DYING)
    out, log = tmp_path / "out", tmp_path / "log.jsonl"
    words = ["drive", "--rig", spec, "--end-after", "8", "--json"]
    assert shoal([*words, "--out", str(out), "--log", str(log)]) == 2
    printed = capsys.readouterr()
    assert "no answer from the rig: the program has ended with exit code 5" in printed.err
    assert len(printed.err.strip().splitlines()) == 1
    result = json.loads(printed.out)
    assert [alarm["kind"] for alarm in result["alarms"]] == ["failure", "stop"]
    stop = "has not confirmed the stop command: the program has ended"
    assert stop in result["alarms"][1]["text"]
    assert (out / "summary.json").exists()
    assert json.loads(log.read_text().splitlines()[-1])["status"] == "interrupted"
    assert starts.read_text() == "..."


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"scan_every": "often"}, "line 1: scan-every: expected 1 to"),
        ({"slip": 0.9, "confidence": 0.99}, "line 1: slip: expected a number from 0 to 0.5"),
        ({"slip": 0.1, "confidence": None}, "line 1: confidence: expected a number"),
    ],
)
def test_headers_with_which_no_drive_began(tmp_path, change, words):
    header = {
        "kind": "header",
        "log": "shoal-drive",
        "format": 1,
        "version": "1",
        "rig": "p",
        "shape": [2, 2],
        "policy": "x",
    }
    header |= {"seed": 1, "problem": {"map": "rig"} | change}
    lines = [header, {"kind": "scan", "move": 0, "cells": [[0, 0]], "time": 0.0}]
    (tmp_path / "log.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    with pytest.raises(InvalidInputError, match=words):
        replay_log(tmp_path / "log.jsonl")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_on_the_command_line_stops_the_rig(tmp_path, number):
    """The rig takes a second for a command; the stop command ends it."""
    (tmp_path / "map.txt").write_text(f"{open_map('maze:9x7')}\n")
    spec = (
        f"exec:{sys.executable} {ROOT / 'examples' / 'rig.py'} {tmp_path / 'map.txt'} --duration 30"
    )
    log = tmp_path / "log.jsonl"
    words = [
        sys.executable,
        "-c",
        "from shoal.__main__ import main; main()",
        "drive",
        "--rig",
        spec,
        "--log",
        str(log),
        "--out",
        str(tmp_path / "out"),
    ]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as process:
        while not (log.exists() and '"command"' in log.read_text()):
            time.sleep(0.02)
        process.send_signal(number)
        said = process.communicate(timeout=20)[1]
    assert process.returncode == 130
    assert "interrupted" in said
    assert json.loads(log.read_text().splitlines()[-1])["status"] == "interrupted"
    made = {path.name for path in (tmp_path / "out").iterdir()}
    whole = {"map.png", "map.txt", "frontier.png", "frames.csv", "summary.json", "film.html"}
    assert whole <= made
