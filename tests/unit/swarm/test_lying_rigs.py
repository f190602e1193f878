"""Rigs that lie: what a drive must notice, and what an honest rig must not be accused of."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from scipy.stats import binom
from tests.soak import SOAK, often

from shoal import GridWorkspace, open_map
from shoal.cli import run as shoal
from shoal.core.errors import InvalidInputError, OutputError, RigError
from shoal.rigs import (
    DriveError,
    DriveInterrupted,
    DriveLog,
    NoisyRig,
    SimulatedRig,
    drive,
    replay_log,
)
from shoal.rigs.driving import check_number_seen
from shoal.rigs.monitor import NoiseMonitor, find_change, find_misdeed
from shoal.swarm.grid.tasks import place
from shoal.swarm.noise import Noise

OPPOSITE = dict(zip("lurdio", "rdluoi", strict=True))
NOISE = Noise(0.05, 0.01, 0.02)
STATED = {"slip": 0.05, "misplace": 0.01, "miss": 0.02}


class Lying:
    """Wraps a rig. From command number ``since`` on, ``command`` changes what is sent, and ``seen``
    what a scan shows.
    """

    def __init__(
        self, rig, *, since=0, command=lambda letter: letter, seen=lambda cells, moves: cells
    ):
        self.rig, self.since, self.command, self.seen = rig, since, command, seen
        self.name, self.shape, self.rule = "liar", rig.shape, rig.rule
        self.exact = getattr(rig, "exact", False)
        self.sent, self.stops = [], 0

    def send(self, letter):
        self.sent.append(letter)
        for one in self.command(letter) if len(self.sent) > self.since else letter:
            self.rig.send(one)

    def observe(self):
        cells = self.rig.observe()
        return self.seen(cells, len(self.sent)) if len(self.sent) >= self.since else cells

    def stop(self):
        self.stops += 1


def exact(workspace, particles=4, seed=1):
    return SimulatedRig(
        workspace, place(workspace, particles, "uniform", np.random.default_rng(seed))
    )


def noisy(workspace, particles=12, seed=1, noise=NOISE):
    start = place(workspace, particles, "uniform", np.random.default_rng(seed))
    return NoisyRig(workspace, start, noise, np.random.default_rng(seed))


def frozen():
    kept = []
    return lambda cells, moves: (kept.append(cells), kept[0])[1]


MAZE = open_map("maze:15x11:1")

# -------------------------------------------------------------------------------------------------
# dead from the start


@pytest.mark.parametrize("test_move", [True, False])
@pytest.mark.parametrize(
    "policy", ["closest-frontier", "best", "random-moves", "sweep", "manual:lurdlurd"]
)
@pytest.mark.parametrize(
    "lie", [{"command": lambda _letter: ""}, {"seen": None}], ids=["dead magnet", "frozen frame"]
)
def test_a_map_drawn_from_particles_that_never_moved_is_never_complete(policy, test_move, lie):
    lie = {name: what or frozen() for name, what in lie.items()}
    rig = Lying(exact(MAZE), **lie)
    driven = drive(rig, policy=policy, test_move=test_move, max_moves=60)
    assert driven.status in (
        {"alarm"} if "manual" not in policy and test_move else {"alarm", "limit", "stalled"}
    )
    assert not driven
    assert driven.trust.level == "none"
    assert rig.stops == 1
    if driven.status == "alarm":
        assert [alarm.kind for alarm in driven.alarms] == ["still"]
        assert "no particle moved" in driven.reason
    if test_move and "manual" not in policy:
        assert driven.commands == "lurd"  # no more than one command in each direction


@pytest.mark.parametrize("rule", ["merge", "tilt"])
def test_a_dead_magnet_is_noticed_under_every_rule(rule):
    rig = Lying(SimulatedRig(MAZE, MAZE.cells[:3], rule=rule), command=lambda _letter: "")
    assert drive(rig, policy="closest-frontier").status == "alarm"


def test_a_dead_magnet_in_three_dimensions():
    workspace = GridWorkspace(np.ones((2, 3, 3)))
    driven = drive(Lying(SimulatedRig(workspace, [(0, 0, 0)]), command=lambda _letter: ""))
    assert (driven.status, driven.moves) == ("alarm", 6)


@pytest.mark.parametrize("particles", [1, 12, 60])
def test_a_dead_magnet_under_noise_is_noticed(particles):
    for seed in range(2):
        driven = drive(
            Lying(noisy(MAZE, particles, seed), command=lambda _letter: ""),
            **STATED,
            policy="closest-frontier",
        )
        assert driven.status == "alarm", (seed, driven.reason)
        assert driven.trust.level == "none"
        driven = drive(
            Lying(noisy(MAZE, particles, seed), command=lambda _letter: ""),
            **STATED,
            policy="closest-frontier",
            test_move=False,
            max_moves=600,
        )
        assert driven.status in {"alarm", "stalled", "limit"}, (seed, driven.reason)
        assert not driven
        assert driven.trust.level == "none"


def test_a_vessel_without_any_room_cannot_be_told_from_a_dead_magnet():
    for test_move in (True, False):
        driven = drive(
            SimulatedRig(GridWorkspace([[1, 1], [1, 0]]), [(0, 0), (0, 1), (1, 0)]),
            test_move=test_move,
        )
        assert driven.status == "alarm"
        assert "no particle has room to move" in driven.reason


# -------------------------------------------------------------------------------------------------
# failures on the way


@pytest.mark.parametrize("policy", ["closest-frontier", "best", "greedy-classify"])
@pytest.mark.parametrize("particles", [1, 4])
def test_a_magnet_that_dies_on_the_way_never_completes_a_map(policy, particles):
    """Wherever it dies: each death is either noticed, or comes after the last cell was found."""
    maze = open_map("maze:9x7")
    honest = drive(exact(maze, particles), policy=policy)
    assert honest.status == "complete"
    for since in range(1, honest.moves, often(15, 9)):
        rig = Lying(exact(maze, particles), since=since, command=lambda _letter: "")
        driven = drive(rig, policy=policy)
        assert driven.status == "alarm", since
        assert driven.alarms[-1].kind == "still"
        assert driven.trust.level == ("limited" if driven.trace.travelled.any() else "none")
        assert driven.moves >= since
        assert driven.episode.verify(), since


def test_a_magnet_that_dies_before_the_last_walls_is_noticed_by_the_closing_move():
    """After 'r' in a corridor of two cells, only walls are left to find, which a dead magnet
    'finds' as well.
    """
    workspace = GridWorkspace([[1, 1]])
    honest = drive(SimulatedRig(workspace, [(0, 0)]), policy="closest-frontier")
    last = int(np.flatnonzero(honest.trace.travelled[:-1])[-1]) + 1  # the closing move left out
    assert (honest.status, honest.trust.level) == ("complete", "high")
    for test_move, status in ((True, "alarm"), (False, "complete")):
        rig = Lying(SimulatedRig(workspace, [(0, 0)]), since=last, command=lambda _letter: "")
        driven = drive(rig, policy="closest-frontier", test_move=test_move)
        assert (driven.status, driven.trust.level) == (status, "limited")
    assert "at which nothing was seen to move" in driven.trust.why


def test_a_magnet_that_dies_under_noise_is_noticed():
    noticed = 0
    for seed in range(6):
        rig = Lying(noisy(MAZE, 12, seed), since=30, command=lambda _letter: "")
        driven = drive(rig, **STATED, policy="closest-frontier")
        noticed += driven.status == "alarm"
        assert driven.status != "complete" or driven.alarms, (seed, driven.reason)
    assert noticed >= 5


def test_a_frozen_frame_on_the_way_is_noticed():
    driven = drive(Lying(exact(MAZE), since=20, seen=frozen()), policy="closest-frontier")
    assert (driven.status, driven.alarms[-1].kind) == ("alarm", "still")


# ------------------------------------------------------------------------------------- wrong
# directions, drift, doubling


TURN = dict(zip("lurd", "uldr", strict=True))


@pytest.mark.parametrize(
    "lie",
    [
        {"command": OPPOSITE.get},
        {"command": lambda letter: OPPOSITE[letter] if letter in "lr" else letter},
        {"command": lambda letter: OPPOSITE[letter] if letter in "ud" else letter},
        {"command": TURN.get},
        {"seen": lambda cells, _moves: np.array([MAZE.shape[0] - 1, 0]) + cells * [-1, 1]},
        {"seen": lambda cells, _moves: np.array([0, MAZE.shape[1] - 1]) + cells * [1, -1]},
    ],
    ids=["both axes", "columns", "rows", "quarter turn", "picture upside down", "picture mirrored"],
)
@pytest.mark.parametrize("noise", [False, True])
def test_directions_that_are_not_the_commands_are_noticed(lie, noise):
    for seed in range(2):
        rig = Lying(noisy(MAZE, 12, seed) if noise else exact(MAZE, 6, seed), **lie)
        driven = drive(rig, policy="closest-frontier", **(STATED if noise else {}))
        assert driven.status == "alarm"
        assert driven.alarms[-1].kind == "direction", driven.alarms[-1].text
        assert driven.trust.level == "none"


def test_a_drift_is_noticed():
    drifting = {"command": lambda letter: letter + "d"}
    for seed in range(2):
        driven = drive(Lying(exact(MAZE, 6, seed), **drifting), policy="closest-frontier")
        assert driven.status == "alarm"
        rig = noisy(open_map("cave:24x18:3"), 15, seed)
        rng = np.random.default_rng(seed)
        slowly = {"command": lambda letter, rng=rng: letter + "d" * int(rng.random() < 0.4)}
        driven = drive(Lying(rig, **slowly), policy="closest-frontier", **STATED, max_moves=600)
        assert driven.alarms, driven.reason
        assert driven.trust.level != "high"


def test_a_command_that_is_carried_out_twice_is_noticed():
    driven = drive(
        Lying(exact(MAZE), since=9, command=lambda letter: 2 * letter), policy="closest-frontier"
    )
    assert (driven.status, driven.alarms[-1].kind) == ("alarm", "twice")


# ---------------------------------------------------------------------------------------------------
# rates and numbers


@pytest.mark.parametrize("name", ["slip", "miss", "misplace"])
def test_rates_far_from_the_stated_ones_are_said_with_an_interval(name):
    true = {"slip": 0.02, "miss": 0.02, "misplace": 0.02} | {name: 0.25}
    rig = noisy(open_map("cave:24x18:3"), 12, 7, Noise(**true))
    driven = drive(rig, **dict.fromkeys(true, 0.02), policy="closest-frontier", max_moves=600)
    rate = driven.rates[name]
    assert rate.low < 0.25 < rate.high
    assert rate.stated == 0.02
    assert rate.wrong
    assert any(alarm.kind == "rates" and alarm.text.startswith(name) for alarm in driven.alarms)
    assert driven.trust.level == "limited"


def test_the_number_of_particles_is_counted_under_noise():
    workspace = open_map("vessels:300:1")
    rig = noisy(workspace, 20, 1)

    def lose_one(letter):
        if len(liar.sent) == 60:
            there = np.flatnonzero(rig._noisy.state.occupied)
            rig._noisy.state.occupied[there[7]] = False
        return letter

    liar = Lying(rig, command=lose_one)
    driven = drive(liar, **STATED, policy="closest-frontier")
    assert driven.status == "complete"
    numbers = [alarm.text for alarm in driven.alarms if alarm.kind == "number"]
    assert len(numbers) == 1
    assert "about 20 particles at the start, about 19 now" in numbers[0]
    assert driven.trust.level == "limited"


class Losing(NoisyRig):
    """Loses one particle for good, or one at every so many moves."""

    def __init__(self, *arguments, at=None, every=None):
        super().__init__(*arguments)
        self.at, self.every, self.sent, self.luck = at, every, 0, np.random.default_rng(1)

    def send(self, command):
        super().send(command)
        self.sent += 1
        there = np.flatnonzero(self._noisy.state.occupied)
        if len(there) and (self.sent == self.at or (self.every and self.sent % self.every == 0)):
            self._noisy.state.occupied[self.luck.choice(there)] = False


@pytest.mark.parametrize("loss", [{"at": 20}, {"every": 10}], ids=str)
def test_losses_under_noise_keep_what_the_confidence_promises(loss):
    """The benchmark benchmarks/rigs.py measures more places and noises."""
    wrong = known = said = 0
    for seed in range(3):
        for noise in (Noise(0.1, 0.02, 0.3), Noise(0.2, 0.05, 0.1)):
            workspace = open_map(f"cave:16x12:{seed}")
            start = place(workspace, 8, "uniform", np.random.default_rng(seed))
            rig = Losing(workspace, start, noise, np.random.default_rng(seed), **loss)
            driven = drive(
                rig, **vars(noise), confidence=0.99, policy="closest-frontier", max_moves=700
            )
            wrong += sum(driven.compared(workspace).values())
            known += len(driven.belief.known)
            said += any(alarm.kind == "number" for alarm in driven.alarms)
            if not rig._noisy.state.occupied.any():
                assert driven.status != "complete"
                assert driven.trust.level == "limited"
    assert wrong <= 0.01 * known
    assert said >= (4 if "every" in loss else 1)


def test_a_drive_is_complete_only_if_every_cell_that_particles_may_enter_is_classified():
    """With few particles and many errors, no cell may be classified as free for a while: nothing is
    complete then.
    """
    for seed in range(4):
        workspace = open_map(f"cave:24x18:{seed}")
        start = place(workspace, 3, "uniform", np.random.default_rng(seed))
        rig = NoisyRig(workspace, start, Noise(0.2, 0.05, 0.1), np.random.default_rng(1000 + seed))
        driven = drive(
            rig,
            slip=0.2,
            misplace=0.05,
            miss=0.1,
            policy="closest-frontier",
            seed=seed,
            max_moves=300,
        )
        assert len(driven.belief.open) > 10
        if driven:
            inside = {tuple(cell) for cell in driven.cells.tolist()}
            assert inside <= set(driven.belief.open)
            frontier = driven.belief.open.dilated() - driven.belief.known
            assert not frontier


def test_an_honest_rig_is_not_accused():
    false = []
    for seed in range(3):
        noises = Noise(0.05, 0.01, 0.02), Noise(0, 0, 0.1), Noise(0.2, 0.05, 0.1), Noise(0.1, 0, 0)
        # each noise in one map at least
        for noise in noises if SOAK else noises[seed % 2 :: 2]:
            workspace = open_map(("maze:15x11", "cave:24x18", "vessels:200")[seed % 3] + f":{seed}")
            rig = noisy(workspace, (8, 20, 40)[seed % 3], seed, noise)
            driven = drive(rig, **vars(noise), policy="closest-frontier", max_moves=400)
            false += [(seed, noise, alarm.kind, alarm.text) for alarm in driven.alarms]
        driven = drive(exact(open_map(f"maze:15x11:{seed}"), 1 + seed))
        assert (driven.status, driven.trust.level, driven.alarms) == ("complete", "high", ())
    assert not false


# ------------------------------------------------------------------------------------------ stop,
# Ctrl-C, the compiler


class Unstoppable(SimulatedRig):
    def stop(self):
        raise OSError("the relay does not answer")


def test_a_stop_that_raises_loses_no_result(tmp_path):
    rig = Unstoppable(MAZE, MAZE.cells[:4])
    driven = drive(rig, policy="closest-frontier", log=DriveLog(tmp_path / "log.jsonl"))
    assert (driven.status, driven.episode.workspace) == ("complete", MAZE)
    assert [alarm.kind for alarm in driven.alarms] == ["stop"]
    assert "the relay does not answer" in driven.alarms[0].text
    assert driven.trust.level == "limited"
    replayed, verified = replay_log(tmp_path / "log.jsonl")
    assert verified, verified.message
    assert replayed.belief == driven.belief


def test_an_error_of_a_rig_of_others_keeps_the_map():
    rig = SimulatedRig(MAZE, MAZE.cells[:4])
    rig.send = lambda letter, sent=[]: (
        sent.append(letter) or (1 / 0 if len(sent) > 9 else SimulatedRig.send(rig, letter))
    )
    with pytest.raises(DriveError, match="ZeroDivisionError") as raised:
        drive(rig, policy="closest-frontier")
    assert raised.value.drive.moves == 9
    assert raised.value.drive.episode.verify()
    assert rig._stopped


def test_ctrl_c_keeps_the_map():
    def interrupt(letter):
        if len(rig.sent) > 20:
            raise KeyboardInterrupt
        return letter

    rig = Lying(exact(MAZE), command=interrupt)
    with pytest.raises(DriveInterrupted) as raised:
        drive(rig, policy="closest-frontier")
    assert (raised.value.drive.status, raised.value.drive.moves, rig.stops) == (
        "interrupted",
        20,
        1,
    )
    assert raised.value.drive.episode.verify()


class Cancelled(BaseException):
    """As in a framework that ends a task: no subclass of Exception."""


@pytest.mark.parametrize("error", [SystemExit(3), Cancelled("now"), GeneratorExit()], ids=repr)
@pytest.mark.parametrize("method", ["send", "observe"])
def test_whatever_ends_a_drive_keeps_the_map(method, error, tmp_path):
    rig, calls = Lying(exact(MAZE)), []
    call = getattr(rig, method)

    def fail(*arguments):
        calls.append(arguments)
        if len(calls) > 12:
            raise error
        return call(*arguments)

    setattr(rig, method, fail)
    with pytest.raises(type(error)) as raised:
        drive(rig, policy="closest-frontier", log=DriveLog(tmp_path / "log.jsonl"))
    assert raised.value is error
    driven = error.drive
    assert (driven.status, driven.moves, rig.stops) == (
        "interrupted",
        {"send": 12, "observe": 11}[method],
        1,
    )
    assert driven.alarms[0].kind == "failure"
    assert driven.trust.level == "limited"
    assert driven.episode.verify()
    assert (
        json.loads((tmp_path / "log.jsonl").read_text().splitlines()[-1])["status"] == "interrupted"
    )


def test_an_error_of_a_policy_or_of_the_log_keeps_the_map(tmp_path):
    class Broken:
        name, tasks, rules = "broken", ("mapping",), ("block",)

        def decide(self, view, memory, rng):
            return ("lurd"[view.moves % 4], None) if view.moves < 9 else 1 / 0

    rig = Lying(exact(MAZE))
    with pytest.raises(InvalidInputError, match="ZeroDivisionError") as raised:
        drive(rig, policy=Broken())
    assert (raised.value.drive.moves, rig.stops) == (9, 1)
    log = DriveLog(tmp_path / "log.jsonl")

    write = log._write

    def fill(entry):
        if entry["kind"] == "end" or entry.get("move", 0) > 9:
            raise OutputError("the disk is full")
        write(entry)

    log._write = fill
    rig = Lying(exact(MAZE))
    with pytest.raises(OutputError, match="the disk is full") as raised:
        drive(rig, policy="closest-frontier", log=log)
    assert (raised.value.drive.moves, rig.stops) == (9, 1)


def test_the_command_writes_the_map_after_a_system_exit(monkeypatch, tmp_path, capsys):
    sent, send = [], SimulatedRig.send

    def leave(rig, command):
        sent.append(command)
        if len(sent) > 9 and isinstance(rig, Leaving):
            raise SystemExit(5)
        send(rig, command)

    class Leaving(SimulatedRig):
        send = leave

    from shoal.rigs import remote

    monkeypatch.setattr(remote, "open_rig", lambda spec, **options: Leaving(MAZE, MAZE.cells[:4]))
    with pytest.raises(SystemExit) as raised:
        shoal(
            [
                "drive",
                "--rig",
                "tcp:localhost:1",
                "--policy",
                "closest-frontier",
                "--json",
                "--out",
                str(tmp_path / "out"),
            ]
        )
    assert raised.value.code == 5
    printed = capsys.readouterr()
    assert json.loads(printed.out)["moves"] == 9
    assert (tmp_path / "out" / "map.png").exists()
    assert f"the map so far is in {tmp_path / 'out'}" in printed.err


@pytest.mark.parametrize(
    "fields", [{}, {"policy": "closest-frontier", "scan_every": "adaptive"}, STATED], ids=str
)
def test_kernels_are_compiled_before_the_rig_is_connected(fields, monkeypatch):
    from shoal.jit import entry
    from shoal.rigs import load_drive_kernels
    from shoal.swarm.problem import SwarmProblem

    if not hasattr(entry, "load_machine_code") or os.environ.get("NUMBA_DISABLE_JIT") == "1":
        pytest.skip("kernels are not compiled")
    loaded, load = [], entry.load_machine_code
    volume = GridWorkspace(np.ones((3, 4, 70)))
    load_drive_kernels(SwarmProblem("rig", **fields))
    monkeypatch.setattr(
        entry,
        "load_machine_code",
        lambda *about: loaded.append(about[0].__qualname__) or load(*about),
    )
    drive(noisy(MAZE) if "slip" in fields else exact(MAZE), max_moves=60, **fields)
    if "slip" not in fields:
        drive(SimulatedRig(volume, volume.cells[:5]), max_moves=60, **fields)
        drive(SimulatedRig(volume, volume.cells[:5], rule="merge"), max_moves=60, **fields)
    assert loaded == []


def test_the_command_prepares_before_it_connects(monkeypatch, tmp_path, capsys):
    from shoal.rigs import driving, remote

    order = []
    monkeypatch.setattr(
        driving, "load_drive_kernels", lambda problem: order.append("load_drive_kernels")
    )
    monkeypatch.setattr(
        remote, "open_rig", lambda spec, **options: order.append("open") or exact(MAZE)
    )
    assert shoal(["drive", "--rig", "tcp:localhost:1", "--json", "--max-moves", "2"]) == 1
    assert order[:2] == ["load_drive_kernels", "open"]
    capsys.readouterr()


def test_a_rig_that_claims_a_huge_field_is_refused(tmp_path):
    rig = SimulatedRig(MAZE, MAZE.cells[:2])
    huge = Lying(rig)
    huge.shape = (16384, 16384)
    with pytest.raises(RigError, match="expected a field of view of at most 4194304 cells, got"):
        drive(huge)
    assert huge.sent == []


# -------------------------------------------------------------------------------------------------
# over the command line

LIAR = """
import json, sys, zlib
how, session, seq, sent = sys.argv[1], "", 0, 0
free = {(row, column) for row in range(3) for column in range(7)} - {(1, 3)}
cells, shape = [(0, 0), (2, 5)], [16384, 16384] if how == "huge" else [3, 7]
def say(**message):
    text = json.dumps(message, separators=(",", ":"))[:-1]
    print(f'{text},"crc":"{zlib.crc32(text.encode()):08x}"}}', flush=True)
for line in filter(str.strip, sys.stdin):
    message = json.loads(line)
    if message["type"] == "hello":
        say(type="welcome", protocol=1, session=message["session"], seq=0, shape=shape, rule="block", name="liar")
    elif message["type"] == "observe":
        seen = cells[:-1] if how == "loses" and sent > 5 else cells
        say(type="positions", seq=message["seq"], cells=[[-9, 0]] if how == "outside" and sent > 5 else seen)
    elif message["type"] == "command":
        sent += 1
        if how != "dead" and not (how == "dies" and sent > 5):
            row, column = {"l": (0, -1), "r": (0, 1), "u": (-1, 0), "d": (1, 0)}[message["command"]]
            for i in sorted(range(2), key=lambda i: -(cells[i][0] * row + cells[i][1] * column)):
                ahead = cells[i][0] + row, cells[i][1] + column
                if ahead in free and ahead not in cells:
                    cells[i] = ahead
        say(type="done", seq=message["seq"])
        if how == "twice":
            say(type="done", seq=message["seq"])
        if how == "slow" and sent == 9:
            print("now", file=open(sys.argv[2], "w"), flush=True)
            sys.stdin.readline()
            say(type="stopped")
    elif message["type"] == "stop":
        say(type="stopped")
"""


@pytest.mark.parametrize(
    ("how", "code", "status", "kinds", "level"),
    [
        ("honest", 0, "complete", [], "high"),
        ("dead", 1, "alarm", ["still"], "none"),
        ("dies", 1, "alarm", ["still"], "limited"),
        ("loses", 1, "alarm", ["number"], "limited"),
        ("twice", 0, "complete", ["twice"], "limited"),
        ("outside", 2, "interrupted", ["outside"], "limited"),
        ("huge", 2, None, [], None),
    ],
)
def test_liars_over_a_pipe(how, code, status, kinds, level, tmp_path, capsys):
    (tmp_path / "liar.py").write_text(LIAR)
    words = [
        "drive",
        "--rig",
        f"exec:{sys.executable} {tmp_path / 'liar.py'} {how}",
        "--policy",
        "closest-frontier",
    ]
    log = tmp_path / "log.jsonl"
    words += ["--exact", "--end-after", "20", "--cell-size", "0.5", "--log", str(log)]
    assert shoal([*words, "--json", "--out", str(tmp_path / "out")]) == code
    printed = capsys.readouterr()
    if status is None:
        assert "at most 4194304 cells" in printed.err
        assert len(printed.err.strip().splitlines()) == 1
        return
    told = json.loads(printed.out)
    assert (
        told["status"],
        [alarm["kind"] for alarm in told["alarms"]],
        told["trust"]["level"],
    ) == (status, kinds, level)
    assert told["trust"]["why"]
    assert (told["cell_mm"], told["cell_m"]) == ([0.5, 0.5], [0.0005, 0.0005])
    assert told["seconds_per_command"] > 0
    assert told["seconds_per_scan"] > 0
    assert (tmp_path / "out" / "map.png").exists()
    if status != "interrupted":
        shoal(["replay", str(log), "--json"])
        again = json.loads(capsys.readouterr().out)
        assert again["verified"] is True
        assert again["status"] == status
        assert again["cell_m"] == [0.0005, 0.0005]
    else:
        assert "expected cells inside (3, 7), got (-9, 0)" in printed.err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            ["--rig", "tcp:localhost:1", "--start", "0,0"],
            "start: expected the rig simulated or physics, because the particles of a real rig are where",
        ),
        (
            ["--rig", "tcp:localhost:1", "--placement", "uniform"],
            "placement: expected the rig simulated",
        ),
        (["line:5", "--end-after", "3"], "end-after: expected a rig behind a connection"),
    ],
)
def test_options_without_effect_on_the_rig_are_refused(words, told, capsys):
    assert shoal(["drive", *words]) == 2
    assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--particles", "9"], "particles: expected 9, got 2 in the first scan of the rig liar"),
        (
            ["--particles", "3", "--exact"],
            "particles: expected 3, got 2 in the first scan of the rig liar",
        ),
        (["--particles", "1"], "particles: expected 1, got 2 in the first scan of the rig liar"),
        (
            ["--particles", "30", "--miss", "0.3"],
            "particles: expected 30, got 2 in the first scan of the rig liar, too few for the"
            " stated noise",
        ),
        (["--particles", "1", "--miss", "0.3"], "particles: expected 1, got 2"),
        (["--rule", "tilt"], "rule: expected tilt, got block from the rig liar"),
    ],
)
def test_another_number_of_particles_or_rule_than_expected_ends_the_drive_before_the_first_move(
    words, told, tmp_path, capsys
):
    (tmp_path / "liar.py").write_text(LIAR)
    log = tmp_path / "log.jsonl"
    rig = f"exec:{sys.executable} {tmp_path / 'liar.py'} honest"
    assert shoal(["drive", "--rig", rig, "--log", str(log), *words, "--json"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert told in printed.err
    assert len(printed.err.strip().splitlines()) == 1
    assert not log.exists()


def test_what_is_expected_of_a_real_rig_may_be_so(tmp_path, capsys):
    (tmp_path / "liar.py").write_text(LIAR)
    rig = f"exec:{sys.executable} {tmp_path / 'liar.py'} honest"
    assert shoal(["drive", "--rig", rig, "--particles", "2", "--rule", "block", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["status"] == "complete"


def test_under_noise_the_expected_number_is_compared_as_chance_allows():
    for seen, expected, miss in ((9, 12, 0.3), (4, 12, 0.3), (12, 12, 0.3), (3, 3, 0)):
        check_number_seen(exact(MAZE), expected, seen, Noise(0.1, 0, miss) if miss else None)
    for seen, expected, miss in ((2, 12, 0.3), (13, 12, 0.3), (2, 3, 0), (4, 3, 0)):
        with pytest.raises(InvalidInputError, match=f"particles: expected {expected}, got {seen}"):
            check_number_seen(exact(MAZE), expected, seen, Noise(0.1, 0, miss) if miss else None)


def test_the_table_says_how_far_a_map_can_be_trusted(tmp_path, capsys):
    (tmp_path / "liar.py").write_text(LIAR)
    assert shoal(["drive", "--rig", f"exec:{sys.executable} {tmp_path / 'liar.py'} dead"]) == 1
    printed = capsys.readouterr().out
    assert "none: no particle was seen to move" in " ".join(printed.split())
    assert "the magnets do nothing" in " ".join(printed.split())


@pytest.mark.skipif(os.name != "posix", reason="signals are Unix's")
def test_ctrl_c_writes_the_map_and_says_how_to_go_on(tmp_path):
    (tmp_path / "liar.py").write_text(LIAR)
    spec = f"exec:{sys.executable} {tmp_path / 'liar.py'} slow {tmp_path / 'now'}"
    out, log = tmp_path / "out", tmp_path / "log.jsonl"
    words = [
        sys.executable,
        "-c",
        "from shoal.__main__ import main; main()",
        "drive",
        "--rig",
        spec,
        "--json",
    ]
    words += ["--policy", "closest-frontier", "--out", str(out), "--log", str(log)]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        while not (tmp_path / "now").exists():
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        told, said = process.communicate(timeout=60)
    assert process.returncode == 130
    assert json.loads(told)["status"] == "interrupted"
    assert json.loads(told)["moves"] in (8, 9)
    assert (out / "map.png").exists()
    assert (out / "summary.json").exists()
    assert f"the map so far is in {out}" in said
    assert f"to go on: 'shoal drive --resume {log} --rig " in said
    assert "Traceback" not in said


# ------------------------------------------------------------------------------------------- small
# liars under noise

ROOM = GridWorkspace(np.ones((5, 7)))
SMALL = [(ROOM, 3), (open_map("maze:9x7"), 4)]
NOISES = [Noise(0.1, 0, 0.3), Noise(0.05, 0, 0.02), Noise(0.02, 0.05, 0)]


@pytest.mark.parametrize("noise", NOISES, ids=str)
@pytest.mark.parametrize("since", [0, 1, 25])
@pytest.mark.parametrize("lie", ["dead", "frozen"])
def test_no_map_is_complete_whose_walls_rest_on_particles_at_rest(noise, since, lie):
    for number, (workspace, particles) in enumerate(SMALL):
        for seed in range(often(1, 2)):
            change = {"command": lambda _letter: ""} if lie == "dead" else {"seen": frozen()}
            rig = Lying(noisy(workspace, particles, seed, noise), since=since, **change)
            driven = drive(
                rig,
                **vars(noise),
                policy="closest-frontier",
                max_moves=400,
                test_move=bool((number + seed) % 2),
            )
            assert driven.status != "complete" or len(rig.sent) <= since, (seed, driven.trust)
            assert not driven
            assert driven.trust.level != "high"


def test_neighbours_of_which_scans_miss_one_each_are_no_motion():
    """Two particles at rest side by side, the first missed in one scan and the second
    in the next.
    """
    monitor = NoiseMonitor((5, 7), Noise(0.1, 0, 0.3))
    rng = np.random.default_rng(3)
    cells = np.array([(2, 2), (2, 3), (2, 4), (3, 2)])
    assert not any(monitor.count(cells[rng.random(4) > 0.3]) for _ in range(300))
    rows = [np.array([(2, 2 + turn % 4), (3, 5 - turn % 4)]) for turn in range(40)]
    assert any(monitor.count(row[rng.random(2) > 0.3]) for row in rows)


@pytest.mark.parametrize(
    "noise", [Noise(0.4, 0, 0), Noise(0.02, 0.05, 0), Noise(0.1, 0, 0.3)], ids=str
)
def test_one_direction_that_does_nothing_is_noticed(noise):
    for workspace, particles in SMALL:
        for seed in range(often(1, 2)):
            rig = Lying(
                noisy(workspace, particles, seed, noise),
                command=lambda letter: "" if letter == "u" else letter,
            )
            driven = drive(rig, **vars(noise), policy="closest-frontier", max_moves=500)
            assert not driven, (seed, driven.trust)
            assert driven.trust.level != "high"


@pytest.mark.parametrize("noise", [Noise(0.1, 0.02, 0.1), Noise(0.05, 0, 0.02)], ids=str)
def test_commands_carried_out_twice_now_and_then_mark_the_result(noise):
    for seed in range(2):
        rig = Lying(noisy(open_map("cave:20x13:2"), 12, seed, noise))
        rig.command = lambda letter, rig=rig: letter * (2 if len(rig.sent) % 5 == 0 else 1)
        driven = drive(rig, **vars(noise), policy="closest-frontier", max_moves=800)
        assert "twice" in {alarm.kind for alarm in driven.alarms}, (seed, driven.trust)
        assert driven.trust.level != "high"


@pytest.mark.parametrize("noise", [Noise(0.02, 0.05, 0), Noise(0.1, 0.02, 0.1)], ids=str)
def test_commands_carried_out_twice_now_and_then_mark_small_maps(noise):
    """Few motions are seen in a small map: an upper bound of their probability must not ask for as
    much as an exact one.
    """
    for (workspace, particles), seeds in zip(SMALL, ((4, 5, 0, 2, 1), (4, 1)), strict=True):
        for seed in seeds:
            rig = Lying(noisy(workspace, particles, seed, noise))
            rig.command = lambda letter, rig=rig: letter * (2 if len(rig.sent) % 5 == 0 else 1)
            driven = drive(rig, **vars(noise), policy="closest-frontier", max_moves=800)
            assert driven.trust.level != "high", (seed, driven.trust)
            assert not driven or "twice" in {alarm.kind for alarm in driven.alarms}


def test_honest_rigs_with_few_particles_finish_without_alarms():
    for noise in (*NOISES, Noise(0.4, 0, 0), Noise(0.1, 0.02, 0.1)):
        for workspace, particles in SMALL:
            for seed in range(often(1, 2)):
                driven = drive(
                    noisy(workspace, particles, seed, noise),
                    **vars(noise),
                    policy="closest-frontier",
                    max_moves=900,
                )
                assert (driven.status, driven.trust.level, driven.alarms) == (
                    "complete",
                    "high",
                    (),
                ), (noise, seed)


@pytest.mark.parametrize(("miss", "particles"), [(0.3, 8), (0.3, 6), (0.1, 8)])
def test_a_particle_that_no_scan_shows_any_more_is_said(miss, particles):
    """The benchmark benchmarks/rigs.py measures more places, noises and moments."""
    noise = Noise(0.1, 0.02, miss)
    for seed in range(often(1, 2)):
        workspace = open_map(f"cave:16x12:{seed}")
        start = place(workspace, particles, "uniform", np.random.default_rng([seed, 1]))
        for lost in (60, None):
            rig = Losing(workspace, start, noise, np.random.default_rng([seed, 2]), at=lost)
            driven = drive(rig, **vars(noise), policy="closest-frontier", max_moves=500)
            texts = [alarm.text for alarm in driven.alarms if alarm.kind == "number"]
            if lost is None:
                assert texts == []
                assert driven.trust.level == "high"
                continue
            assert len(texts) == 1
            assert texts[0].startswith(
                f"about {particles} particles at the start, about {particles - 1} now:"
            )
            assert driven.trust.level == "limited"


@pytest.mark.parametrize(
    ("miss", "lost"), [(0.1, 5), (0.3, 20), (0.1, 12), (0.3, 16)][: often(2, 4)]
)
def test_a_particle_that_is_lost_within_the_first_moves_is_said(miss, lost):
    """Before the number of particles has settled in the belief of the drive."""
    noise, workspace = Noise(0.1, 0.02, miss), open_map("maze:15x11:1")
    start = place(workspace, 4, "uniform", np.random.default_rng([1, 1]))
    rig = Losing(workspace, start, noise, np.random.default_rng([1, 2, lost]), at=lost)
    driven = drive(rig, **vars(noise), policy="closest-frontier", max_moves=400)
    texts = [alarm.text for alarm in driven.alarms if alarm.kind == "number"]
    assert [text[:53] for text in texts] == [
        "about 4 particles at the start, about 3 now: scans st"
    ], driven.trust
    assert driven.trust.level == "limited"


def test_a_particle_that_comes_in_is_said():
    noise, workspace = Noise(0.1, 0.02, 0.1), open_map("maze:15x11:1")
    start = place(workspace, 4, "uniform", np.random.default_rng([1, 1]))
    rig = NoisyRig(workspace, start, noise, np.random.default_rng([1, 2]))

    def let_in(letter):
        if len(liar.sent) == 40:
            there, truth = rig._noisy.state.occupied, rig._noisy.state.truth
            there[np.flatnonzero(truth & ~there)[0]] = True
        return letter

    liar = Lying(rig, command=let_in)
    driven = drive(liar, **vars(noise), policy="closest-frontier", max_moves=400)
    assert any(
        alarm.text.startswith("about 4 particles at the start, about 5 now: scans show more")
        for alarm in driven.alarms
    ), driven.trust


def test_a_number_that_scans_leave_open_is_no_change():
    """Numbers of cells vary by chance, and no moment is special if the number is constant."""
    rng, found = np.random.default_rng(1), 0
    for _ in range(300):
        counts = rng.binomial(8, 0.7, 60)
        chances = {n: np.log(binom.pmf(counts[1:], n, 0.7) + 1e-300) for n in (7, 8, 9)}
        found += find_change(chances, counts) is not None
    assert found <= 6
    assert find_change({3: np.zeros(0), 4: np.zeros(0)}, np.array([3])) is None


def test_the_misses_of_a_single_particle_are_counted():
    """Scans that show nothing are scans, too."""
    for seed in range(often(1, 2)):
        noise = Noise(0.1, 0.02, 0.3)
        rig = noisy(ROOM, 1, seed, noise)
        driven = drive(rig, **vars(noise), policy="closest-frontier", max_moves=400)
        assert driven.rates["miss"].low < 0.3 < driven.rates["miss"].high
        assert driven.alarms == ()


LATE = {
    "dropped": ("commands", "not carried out"),
    "twice": ("twice", "carried out twice"),
    "turned": ("commands", "carried out in another direction"),
    "late": ("commands", "carried out late, together with the next command"),
}


@pytest.mark.parametrize("lie", LATE)
@pytest.mark.parametrize("every", [3, 8, 6][: often(2, 3)])
def test_commands_that_are_not_carried_out_as_sent_now_and_then_are_said(lie, every):
    """The benchmark benchmarks/rigs.py measures more places, noises and intervals."""
    noise = Noise(0.1, 0.02, 0.1)
    for seed in range(often(1, 2)):
        rig = Lying(noisy(open_map("maze:9x7"), 4, seed, noise))

        def carry_out(letter, rig=rig):
            now, before = len(rig.sent) % every == 0, (len(rig.sent) - 1) % every == 0
            if lie == "late":
                held = rig.sent[-2] if before and len(rig.sent) > 1 else ""
                return "" if now else held + letter
            return (
                {"dropped": "", "twice": 2 * letter, "turned": TURN[letter]}[lie] if now else letter
            )

        rig.command = carry_out
        driven = drive(rig, **vars(noise), policy="closest-frontier", max_moves=600)
        assert driven.trust.level != "high"
        kind, text = LATE[lie]
        alarms = [alarm for alarm in driven.alarms if alarm.kind in {"commands", "twice"}]
        if driven.alarms[0].kind == "direction":  # the first commands looked like swapped axes
            assert (lie, driven.status) == ("turned", "alarm")
            continue
        if lie != "late":  # which is also "not carried out" at one command, and "twice" at the next
            assert [alarm.kind for alarm in alarms] == [kind]
            assert text in alarms[0].text
        assert alarms or driven.status == "alarm"


@pytest.mark.parametrize("shape", ["abc", (14.0, 20.0), (0, 3), (4,)], ids=str)
def test_a_shape_that_is_none_is_an_error_of_the_rig(shape):
    rig = Lying(exact(MAZE))
    rig.shape = shape
    with pytest.raises(RigError, match="expected as shape two or three positive integers, got"):
        drive(rig)


@pytest.mark.parametrize(
    ("error", "told"),
    [
        (SystemExit(3), "SystemExit: 3"),
        (KeyError("x"), "KeyError: 'x'"),
        (Cancelled("now"), "Cancelled: now"),
    ],
    ids=["exit", "error", "cancelled"],
)
def test_a_stop_that_raises_anything_names_its_type(error, told):
    rig = Lying(exact(MAZE))
    rig.stop = lambda: (_ for _ in ()).throw(error)
    driven = drive(rig, policy="closest-frontier")
    assert (driven.status, [alarm.kind for alarm in driven.alarms]) == ("complete", ["stop"])
    assert driven.alarms[0].text.endswith(told)


def test_scans_that_the_stated_rates_exclude_are_no_evidence():
    """With misplace 0, a misplaced particle has probability 0 whatever the rig did."""
    excluded = np.full((60, 5), -np.inf)
    assert find_misdeed(excluded) is None
    counts = np.full(61, 3)
    assert find_change({3: np.full(60, -np.inf), 4: np.full(60, -np.inf)}, counts) is None
    excluded[::3, 2] = -1.0  # "twice" explains each third
    misdeed = find_misdeed(excluded)
    assert misdeed is not None
    assert misdeed.kind == "twice"
