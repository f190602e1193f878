"""Drives that go on after an interruption."""

import contextlib
import csv
import json
import random
import shlex
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from tests.unit.swarm.test_rigs import ROOT, BenchTransport, bench, example

from shoal import open_map
from shoal.cli import run as shoal
from shoal.cli.swarm.camera_film import _drawn, write_camera_film
from shoal.core.errors import InvalidInputError, OutputError
from shoal.rigs import (
    DriveError,
    DriveInterrupted,
    DriveLog,
    NoisyRig,
    RemoteRig,
    SimulatedRig,
    drive,
    read_log,
    replay_log,
)
from shoal.rigs.ports import BenchRig, RemoteActuator, RemoteSensor
from shoal.rigs.records import write_frames
from shoal.rigs.resume import rebuild
from shoal.swarm.maps.files import read_map
from shoal.swarm.noise import Noise
from shoal.views import film

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


class Ending(BenchTransport):
    """After SIGKILL or a pulled cable, nothing more gets through, and no stop either."""

    dead = False

    def _open(self):
        if self.dead:
            raise OSError("no carrier")
        super()._open()

    def _write(self, data):
        if self.dead:
            raise OSError("no carrier")
        try:
            super()._write(data)
        except (MemoryError, EOFError):
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
        line = Ending(rig, wear)
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


SLIPS = {"slip": 0.02, "misplace": 0.01, "miss": 0.01}


@pytest.mark.parametrize(("every", "noise"), [("1", {}), ("3", {}), ("adaptive", {}), ("1", SLIPS)])
def test_a_drive_that_is_interrupted_ten_times_finds_the_same_map(tmp_path, every, noise):
    log, kinds = tmp_path / "log.jsonl", random.Random(3).choices(["ctrl-c", "kill", "cable"], k=10)
    rig = counted(bench(MAZE, particles=4).rig)
    result, turns = interrupted_drive(log, rig, kinds, every, policy="closest-frontier", **noise)
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


@pytest.mark.parametrize("noise", [None, Noise(0.02, 0.01, 0.02)])
def test_a_rig_that_has_forgotten_the_session_goes_on_where_its_particles_are(tmp_path, noise):
    """The rig restarts each time, with its particles elsewhere."""
    log, luck = tmp_path / "log.jsonl", random.Random(5)
    settings = {} if noise is None else dict(vars(noise))
    sent = 0
    for turn in range(6):
        rig = counted(bench(MAZE, particles=6, seed=turn).rig)
        kind = None if turn == 5 else luck.choice(["kill", "cable"])
        line = Ending(rig, Interrupting(kind, 50))
        past = read_log(log) if turn else None
        remote = RemoteRig(
            line, repeat_after=0.05, end_after=0.1, resume=None if past is None else past.session
        )
        with contextlib.suppress(DriveError):
            result = drive(
                remote,
                **({"resume": log} if turn else {"log": log, "policy": "closest-frontier"}),
                **({} if turn else settings),
            )
        sent += len(rig.carried_out)
    assert (result.status, result.compared(MAZE)) == (
        "complete",
        {"false_free": 0, "false_obstacles": 0},
    )
    past = read_log(log)
    unknown = sum(event.get("carried_out", True) is None for event in past.events)
    assert sent <= len(result.commands) <= sent + unknown
    assert len(past.placed) >= 2
    episode = result.episode
    assert episode.verify().ok, episode.verify().message
    _state, belief = episode.final()
    assert belief == result.belief
    assert len(list(episode.frames())) == 1 + result.moves
    film(episode, tmp_path / "film.html")
    assert '"moments"' in (tmp_path / "film.html").read_text()
    with pytest.raises(InvalidInputError, match="expected an episode of a simulation, got a drive"):
        episode.save(tmp_path / "episode.npz")
    again, verified = replay_log(log)
    assert verified, verified.message
    assert (again.commands, again.belief) == (result.commands, result.belief)
    assert len(again.episode.placed) == len(episode.placed)


def drive_interrupted(log, moves, **fields):
    """Drive a simulated rig in this process up to an interruption."""

    def interrupt(made, _frontier):
        if made >= moves:
            raise KeyboardInterrupt

    noise = Noise(**fields) if fields else None
    rig = simulated(noise)
    with pytest.raises(DriveInterrupted):
        drive(rig, log=log, on_moves=interrupt, policy="closest-frontier", **fields)


def simulated(noise):
    start = MAZE.cells[::11]
    return (
        SimulatedRig(MAZE, start)
        if noise is None
        else NoisyRig(MAZE, start, noise, np.random.default_rng(4))
    )


@pytest.mark.parametrize("fields", [{}, {"slip": 0.05, "misplace": 0.01, "miss": 0.05}])
def test_a_simulation_is_rebuilt_from_its_log(tmp_path, fields):
    """It comes out as the drive that was not interrupted, also with noise."""
    log, noise = tmp_path / "log.jsonl", Noise(**fields) if fields else None
    drive_interrupted(log, 20, **fields)
    rig, past = simulated(noise), read_log(log)
    rebuild(rig, past)
    result = drive(rig, resume=past)
    straight = drive(simulated(noise), policy="closest-frontier", **fields)
    assert result.status == straight.status == "complete"
    assert result.commands[:20] == straight.commands[:20]
    assert result.belief.open == straight.belief.open
    assert result.commands == straight.commands
    assert replay_log(log)[1]
    other = SimulatedRig(MAZE, MAZE.cells[1::11])
    with pytest.raises(InvalidInputError, match="got other positions after move 0"):
        rebuild(other, read_log(log))


def test_a_log_that_has_lost_its_last_lines(tmp_path):
    """Each cut of the log's end goes on, and the commands of the rig are in the log."""
    log = tmp_path / "log.jsonl"
    for cut in (1, 2, 4):
        log.unlink(missing_ok=True)
        rig = counted(bench(MAZE, particles=4).rig)
        line = Ending(rig, Interrupting("kill", 45))
        with pytest.raises(DriveError):
            drive(RemoteRig(line, repeat_after=0.05, end_after=0.1), log=log)
        written = log.read_bytes().splitlines(keepends=True)
        last = next(i for i, row in enumerate(written) if b'"event":"stop"' in row)
        log.write_bytes(b"".join(written[: last - cut + 1]) + written[last - cut + 1][:9])
        line = BenchTransport(rig)
        past = read_log(log)
        remote = RemoteRig(line, repeat_after=0.05, end_after=0.1, resume=past.session)
        result = drive(remote, resume=log)
        assert result.status == "complete"
        assert result.compared(MAZE) == {"false_free": 0, "false_obstacles": 0}
        again, verified = replay_log(log)
        assert verified, verified.message
        assert again.belief == result.belief
        lost = len(rig.carried_out) - len(result.commands)
        assert lost == 0 if cut < 3 else lost >= 0, cut


def test_logs_with_which_a_drive_does_not_go_on(tmp_path):
    log = tmp_path / "log.jsonl"
    drive_interrupted(log, 20)
    whole = log.read_text()

    def refused(words, rig=None, **fields):
        with pytest.raises(InvalidInputError, match=words):
            drive(rig or simulated(None), resume=log, **fields)

    refused("with the name maze:13x9:2, got maze:9x7", SimulatedRig(open_map("maze:9x7"), [(0, 0)]))
    refused("with the rule block, got merge", SimulatedRig(MAZE, [(0, 0)], rule="merge"))
    refused("policy: expected closest-frontier as in", policy="sweep")
    refused("seed: expected 0 as in", seed=3)
    log.write_text(whole.replace('"version":"', '"version":"0.', 1))
    refused("which may have decided otherwise")
    log.write_text(whole.replace('"status":"interrupted"', '"status":"alarm"'))
    refused("one that ended with an alarm")
    log.write_text(whole)
    drive(simulated(None), resume=log)
    assert drive(simulated(None), resume=log).status == "complete"  # nothing is sent
    assert log.read_text().count('"resumed"') == 1


def test_more_moves_after_the_limit(tmp_path):
    log = tmp_path / "log.jsonl"
    first = drive(simulated(None), log=log, max_moves=9, policy="closest-frontier")
    assert (first.status, first.moves) == ("limit", 9)
    with pytest.raises(InvalidInputError, match="expected --max-moves above 9"):
        drive(simulated(None), resume=log)
    rig, past = simulated(None), read_log(log)
    rebuild(rig, past)
    assert drive(rig, resume=past, max_moves=1000).status == "complete"
    assert replay_log(log)[0].status == "complete"


def test_a_drive_may_go_on_in_another_log(tmp_path):
    log, other = tmp_path / "log.jsonl", tmp_path / "other.jsonl"
    drive_interrupted(log, 20)
    before = log.read_bytes()
    rig, past = simulated(None), read_log(log)
    rebuild(rig, past)
    result = drive(rig, resume=past, log=other)
    assert log.read_bytes() == before
    assert replay_log(other)[0].commands == result.commands


def test_the_command_goes_on_after_sigkill_and_ctrl_c(tmp_path):
    """Over TCP, with a rig that takes its time. What the rig counts is in the log."""
    (tmp_path / "map.txt").write_text(f"{MAZE}\n")
    log, count = tmp_path / "log.jsonl", tmp_path / "count.txt"
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    served = ["--tcp", str(port), "--count", str(count), "--duration", "0.005", "--particles", "4"]
    words = [sys.executable, str(ROOT / "examples" / "rig.py"), str(tmp_path / "map.txt"), *served]
    drive_it = [sys.executable, "-c", "from shoal.__main__ import main; main()", "drive"]
    first = [str(tmp_path / "map.txt"), "--rig", f"tcp:127.0.0.1:{port}", "--log", str(log)]
    with subprocess.Popen(words) as rig:
        try:
            for number, options in (
                (signal.SIGKILL, first),
                (signal.SIGINT, ["--resume", str(log)]),
            ):
                before = log.stat().st_size if log.exists() else 0
                with subprocess.Popen([*drive_it, *options], stderr=subprocess.PIPE) as process:
                    while not log.exists() or log.stat().st_size < before + 3000:
                        assert process.poll() is None
                        time.sleep(0.002)
                    process.send_signal(number)
                    said = process.communicate(timeout=20)[1].decode()
            assert f"to go on: 'shoal drive --resume {log}'" in said
            done = subprocess.run(
                [*drive_it, "--resume", str(log), "--json"], capture_output=True, check=True
            )
        finally:
            rig.terminate()
    result = json.loads(done.stdout)
    assert (result["status"], result["wrong"]["false_free"]) == ("complete", 0)
    assert count.read_text().split() == list(result["commands"])
    assert replay_log(log)[0].commands == result["commands"]


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("rig", "exec:touch pwned"),
        ("rig", "antigravity:x"),
        ("actuator", "antigravity:x"),
        ("sensor", "pymmcore:x.cfg"),
        ("policy", "antigravity:x"),
        ("task", "antigravity:x"),
        ("placement", "antigravity:x"),
        ("out", "/elsewhere"),
        ("film", ["/elsewhere/film.html"]),
    ],
)
def test_a_log_alone_makes_shoal_run_no_code(tmp_path, option, value, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log = tmp_path / "log.jsonl"
    assert (
        shoal(["drive", "maze:9x7", "--particles", "4", "--log", str(log), "--max-moves", "3"]) == 1
    )
    header, *rest = log.read_text().splitlines(keepends=True)
    stranger = json.loads(header)
    stranger["options"][option] = value
    if option == "policy":
        stranger["policy"] = stranger["problem"]["policy"] = value
    log.write_text("".join([json.dumps(stranger) + "\n", *rest]))
    capsys.readouterr()
    assert shoal(["drive", "--resume", str(log), "--max-moves", "99"]) == 2
    value = value[0] if isinstance(value, list) else value
    assert f"{option}: expected --{option} {shlex.quote(value)} beside --resume, as no file" in (
        capsys.readouterr().err
    )
    if option == "policy":
        with pytest.raises(InvalidInputError, match="beside the log"):
            drive(SimulatedRig(open_map("maze:9x7"), [(0, 0)]), resume=log)
    assert not (tmp_path / "pwned").exists()
    assert "antigravity" not in sys.modules


def test_the_command_takes_its_options_from_the_log(tmp_path, capsys):
    log = tmp_path / "log.jsonl"
    words = ["drive", "maze:13x9:2", "--particles", "4", "--slip", "0.02", "--log", str(log)]
    assert shoal([*words, "--max-moves", "20", "--json"]) == 1
    capsys.readouterr()
    assert shoal(["drive", "--resume", str(log)]) == 2
    assert "expected --max-moves above 20" in capsys.readouterr().err
    for more, said in (
        (["maze:9x7"], "map-name: expected maze:13x9:2 as in"),
        (["--slip", "0.3"], "slip: expected 0.02 as in"),
        (["--particles", "5"], "particles: expected 4 as in"),
        (["--rule", "merge"], "rule: expected block as in"),
    ):
        assert shoal(["drive", *more, "--resume", str(log), "--max-moves", "9999"]) == 2
        assert said in capsys.readouterr().err
    # the same options again, and the same log
    words = [*words[:-2], "--resume", str(log), "--log", f"{tmp_path}/../{tmp_path.name}/log.jsonl"]
    assert shoal([*words, "--max-moves", "9999", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["status"], result["particles"]) == ("complete", 4)
    size = log.stat().st_size
    assert shoal(["drive", "--resume", str(log), "--max-moves", "9999", "--json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["wrong"] == {"false_free": 0, "false_obstacles": 0}
    assert "the drive was finished" in said.err
    assert log.stat().st_size == size


def test_one_folder_holds_the_records_of_a_drive(tmp_path, capsys):
    out = tmp_path / "out"
    words = ["drive", "maze:13x9:2", "--particles", "4", "--out", str(out), "--json"]
    assert shoal([*words, "--policy", "closest-frontier"]) == 0
    result = json.loads(capsys.readouterr().out)
    made = {"log.jsonl", "frames.csv", "map.txt", "map.png", "summary.json", "film.html"}
    assert made <= {path.name for path in out.iterdir()}
    assert read_map(out / "map.txt") == MAZE
    rows = list(csv.DictReader((out / "frames.csv").read_text().splitlines()))
    assert len(rows) == 4 * result["scans"]
    assert "".join(row["commands"] for row in rows[::4]) == result["commands"]
    last = sorted((int(row["row"]), int(row["column"])) for row in rows[-4:])
    scans = read_log(out / "log.jsonl").scans
    assert last == sorted(map(tuple, scans[max(scans)]))
    assert shoal([*words]) == 0  # the log of another drive is not overwritten
    assert (out / "log-2.jsonl").exists()
    words[-2] = str(tmp_path / "other")
    assert shoal([*words, "--particles", "999"]) == 2
    assert not (tmp_path / "other").exists()  # nothing was driven


def test_values_that_a_rig_reports_are_in_the_table_of_frames(tmp_path):
    log, rig = tmp_path / "log.jsonl", bench(MAZE, particles=2).rig
    reply = rig.reply

    def with_current(line):
        answer = example.decode_message(reply(line))
        if answer is not None and answer["type"] in ("done", "positions"):
            answer["values"] = {"current_A": 0.25} if answer["type"] == "done" else {"field_mT": 3}
        return b"" if answer is None else example.encode_message(answer)

    rig.reply = with_current
    drive(RemoteRig(BenchTransport(rig), repeat_after=0.05, end_after=1), log=log, max_moves=3)
    rows = list(csv.DictReader(write_frames(log, tmp_path / "f.csv").read_text().splitlines()))
    assert [row["field_mT"] for row in rows] == ["3.0"] * len(rows)
    assert [row["current_A"] for row in rows[:3]] == ["", "", "0.25"]


def test_a_rig_of_two_devices_goes_on(tmp_path):
    """The actuator knows which command it has carried out; the sensor only looks."""
    log, rig = tmp_path / "log.jsonl", counted(bench(MAZE, particles=4).rig)
    eye = example.Rig(rig.swarm, MAZE.shape, name="eye")
    kinds = ["kill", "ctrl-c", "cable", "kill", None]
    for turn, kind in enumerate(kinds):
        past = read_log(log) if turn else None
        line = Ending(rig, Interrupting(kind, 15 + turn))
        session = None if past is None else past.session
        actuator = RemoteRig(line, repeat_after=0.05, end_after=0.1, resume=session)
        sensor = RemoteRig(BenchTransport(eye), repeat_after=0.05, end_after=0.1)
        made = BenchRig(RemoteActuator(actuator), RemoteSensor(sensor), name="bench")
        with contextlib.suppress(DriveError, DriveInterrupted):
            result = drive(made, **({"resume": log} if turn else {"log": log}))
    assert (result.status, result.compared(MAZE)["false_free"]) == ("complete", 0)
    assert result.compared(MAZE)["false_obstacles"] == 0
    assert result.commands == rig.carried_out
    assert replay_log(log)[1]


def test_two_drives_do_not_write_one_log(tmp_path):
    log = tmp_path / "log.jsonl"
    drive_interrupted(log, 20)

    def second(_moves, _send):
        rig, past = simulated(None), read_log(log)
        rebuild(rig, past)
        with pytest.raises(OutputError, match="another drive writes it at the moment"):
            drive(rig, resume=past)
        raise KeyboardInterrupt

    rig, past = simulated(None), read_log(log)
    rebuild(rig, past)
    with pytest.raises(DriveInterrupted):
        drive(rig, resume=past, on_rest=second)


@pytest.mark.parametrize(
    ("rule", "fields"),
    [
        ("merge", {}),
        ("block", {"scan_every": "adaptive"}),
        ("block", {"task": "coverage"}),
        ("block", {"task": "coverage", **SLIPS}),
    ],
)
def test_particles_may_be_elsewhere_each_time(tmp_path, rule, fields):
    """A rig in this process, whose particles somebody has moved after each interruption."""
    log, luck = tmp_path / "log.jsonl", random.Random(2)
    noise = Noise(**SLIPS) if "slip" in fields else None
    for turn in range(5):
        start = MAZE.cells[luck.sample(range(MAZE.n_free), 5)]
        rng = np.random.default_rng(turn)
        rig = SimulatedRig(MAZE, start, rule=rule)
        rig = rig if noise is None else NoisyRig(MAZE, start, noise, rng)
        calls = iter(range(luck.randint(3, 12) if turn < 4 else 10**6))

        def interrupt(_moves, _frontier, calls=calls):
            if next(calls, None) is None:
                raise KeyboardInterrupt

        first = {"log": log, "known": MAZE if "task" in fields else None, **fields}
        with contextlib.suppress(DriveInterrupted):
            result = drive(rig, **({"resume": log} if turn else first), on_moves=interrupt)
    assert (result.status, result.compared(MAZE)["false_free"]) == ("complete", 0)
    assert result.visited in (None, MAZE.n_free)
    assert len(result.episode.placed) == 4
    assert result.episode.verify(), result.episode.verify().message
    again, verified = replay_log(log)
    assert verified, verified.message
    assert again.belief == result.belief


class Watched(SimulatedRig):
    """A simulated rig whose camera shows each particle as a bright square of eight pixels."""

    @property
    def sensor(self):
        return self

    def picture(self):
        shown = np.zeros((8 * MAZE.shape[0], 8 * MAZE.shape[1], 3), np.uint8)
        for row, column in self._state.cells:
            shown[8 * row : 8 * row + 8, 8 * column : 8 * column + 8] = (255, 128, 0)
        return shown

    @property
    def calibration(self):
        return self

    def to_pixels(self, cells):
        return 8 * np.asarray(cells)[:, ::-1] + 3.5


def test_the_pictures_of_the_camera_become_a_film(tmp_path):
    count = pytest.importorskip("imageio_ffmpeg").count_frames_and_secs
    log = DriveLog(tmp_path / "log.jsonl")
    log.pictures = tmp_path / "pictures"
    rig = Watched(MAZE, MAZE.cells[::11])
    result = drive(rig, log=log, policy="closest-frontier", max_moves=30)
    scans = read_log(log.path).scans
    assert len(list(log.pictures.iterdir())) == len(scans)
    about = log.pictures, tmp_path / "camera.mp4", result.episode, scans, rig.to_pixels
    assert count(write_camera_film(*about))[0] == len(scans)
    layers = [(result.belief.obstacles, (0, 0, 255, 255))]
    shown = _drawn(log.pictures / "000030.jpg", layers, scans[30], rig.to_pixels)
    walls = result.belief.obstacles.inner
    for cell in np.ndindex(MAZE.shape):
        if list(cell) not in scans[30]:
            assert (shown[8 * cell[0] + 4, 8 * cell[1] + 4, 2] > 250) == walls[cell]
    row, column = (8 * np.array(scans[30][0]) + 3).tolist()
    np.testing.assert_allclose(shown[row, column], (0, 128, 255), atol=60)  # not blue-green-red
