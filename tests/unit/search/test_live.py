"""Live search: robots as processes. Nothing here looks at how long anything takes."""

from __future__ import annotations

import fcntl
import os
import select
import signal
import subprocess
import sys
import tempfile
import textwrap
import threading
import time
from pathlib import Path
from random import Random

import pytest

from shoal.core.errors import InvalidInputError, ShoalError
from shoal.search import TourCost, make_tour
from shoal.search.cells.distances import CellDistances
from shoal.search.problem import SearchProblem
from shoal.search.problem.network import Crash, Pause, Slow, network_of
from shoal.search.protocol.messages import Beacon, Heartbeat, Receiver, Sender
from shoal.search.protocol.robot import advance
from shoal.search.protocol.state import Begin, Brief, Declare, Heard, Robot, Wake
from shoal.search.run import run as run_search
from shoal.search.simulation.live import (
    LiveEvent,
    LiveOutcome,
    process,
    radio,
    run_live,
    supervisor,
)
from shoal.search.simulation.live import vehicle as cell_locks
from shoal.search.simulation.live.radio import LiveTask
from shoal.search.simulation.live.supervisor import covered_share, searched_by
from shoal.search.simulation.live.vehicle import MovingPoint
from shoal.search.simulation.scenario import Scenario


def brief_of(rows: int, columns: int, **options: object) -> Brief:
    """Return a brief that needs nothing compiled: the processes are ready sooner."""
    return Brief(
        TourCost(make_tour("hilbert-rectangle", (rows, columns))),
        **{"allocator": "stay", **options},
    )


def scenario_in(brief: Brief, starts, *, network: str = "", loss: float = 0.0, **more) -> Scenario:
    return Scenario(brief, tuple(starts), network=network_of(network, loss=loss), **more)


def live(brief: Brief, starts, **options) -> LiveOutcome:
    """Run a live search; the options are those of a scenario and of `run_live`."""
    own = {
        name: options.pop(name)
        for name in ("speed", "channel", "port", "key", "timeout", "on_event")
        if name in options
    }
    return run_live(scenario_in(brief, starts, **options), **own)


def radio_of(channel, number=1, *, key=b"", **options):
    receiver = Receiver(key, robots=3, cells=100)
    port = options.pop("port", 0)
    on_air = radio.LoopbackRadio(channel, port)
    return radio.Messenger(on_air, Sender(number, key), receiver, random=Random(0), **options)


def left_over(ids: list[int]) -> list[int]:
    """Return which processes still run; wait a while for them to end, as a machine that is busy
    needs it.
    """
    limit = time.monotonic() + 30
    while running_now := [one for one in ids if runs(one)]:
        if time.monotonic() > limit:
            break
        time.sleep(0.02)
    return running_now


def runs(number: int) -> bool:
    try:  # the state comes after the name, which is in brackets
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return False


def children() -> set[int]:
    """Return all processes that run a robot or started one."""
    found = set()
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
            starter = (folder / "stat").read_text().rpartition(")")[2].split()[1]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if (
            b"shoal.search.simulation.live.process" in words
            and runs(int(folder.name))
            and mine(int(starter))
        ):
            found.add(int(folder.name))
    return found


def mine(number: int) -> bool:
    """Tell whether a process descends from this one; other searches may run on the machine."""
    while number not in (0, 1, os.getpid()):
        try:
            number = int(Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[1])
        except (FileNotFoundError, ProcessLookupError):
            return False
    return number == os.getpid()


def udp_ports() -> set[int]:
    return {
        int(line.split()[1].split(":")[1], 16)
        for line in Path("/proc/net/udp").read_text().splitlines()[1:]
    }


def descriptors() -> int:
    return len(os.listdir("/proc/self/fd"))


def nobody_shared_a_cell(outcome: LiveOutcome) -> bool:
    """Tell whether no two robots were in a cell at once, by what they wrote down when they were in
    it for certain.
    """
    stays: dict[int, list[tuple[float, float]]] = {}
    inside: dict[int, tuple[int, float]] = {}
    for event in outcome.events:
        if event.robot in inside and event.kind in ("enters", "leaves"):
            cell, since = inside.pop(event.robot)
            stays.setdefault(cell, []).append((since, event.time))
        if event.kind == "enters":
            assert event.cell is not None
            inside[event.robot] = (event.cell, event.time)
    return all(
        one[1] <= other[0]
        for each in stays.values()
        for one, other in zip(sorted(each), sorted(each)[1:], strict=False)
    )


@pytest.mark.parametrize("channel", ["multicast", "unicast"])
def test_two_of_four_killed_and_a_third_of_the_messages_lost(channel):
    before = descriptors()
    outcome = live(
        brief_of(6, 6),
        [0, 9, 18, 27],
        loss=0.3,
        faults=[Crash(2, 2.0), Crash(4, 4.5)],
        speed=40.0,
        channel=channel,
    )
    assert outcome.complete
    assert outcome.covered == 1.0
    assert sorted(outcome.killed) == [2, 4]
    assert sorted(outcome.declared) == [1, 3]
    assert not outcome.failed
    assert not outcome.timed_out
    assert outcome.channel == channel
    assert 0 < outcome.lost < outcome.heard
    assert nobody_shared_a_cell(outcome)
    last = min(event.time for event in outcome.events if event.kind == "declared")
    assert (
        covered_share([event for event in outcome.events if event.time <= last], (1 << 36) - 1)
        == 1.0
    )  # nobody declares too early
    assert children() == set()
    assert descriptors() == before
    assert outcome.port not in udp_ports()


def test_robots_killed_from_outside_are_dead_and_the_others_take_over(monkeypatch):
    """Nobody tells the supervisor: it once took them for robots that still search, and so the
    search was not completed.
    """
    begin = process.ProcessPool.begin

    def begin_and_kill(pool, epoch):
        begin(pool, epoch)
        doomed = [pool.members[number].process for number in (2, 5)]
        threading.Timer(
            epoch - time.monotonic() + 0.5, lambda: [os.kill(one, signal.SIGKILL) for one in doomed]
        ).start()

    monkeypatch.setattr(process.ProcessPool, "begin", begin_and_kill)
    episode = run_search(
        SearchProblem("square:60", robots=6, footprint=10, starts="line", live=10.0), seed=1
    )
    assert episode.status == "complete", episode.reason
    assert [
        number for number, log in enumerate(episode.trace.robots, start=1) if log.status == "dead"
    ] == [2, 5]
    assert set(episode.trace.declared) == {1, 3, 4, 6}
    assert episode.coverage.covered_fraction == 1.0


def test_strangers_on_the_port_are_dropped_and_counted(monkeypatch):
    ports = []

    def reserve(**options):
        kept = radio.reserve(**options)
        ports.append(kept.getsockname()[1])
        return kept

    monkeypatch.setattr(supervisor, "reserve", reserve)
    everything = (1 << 16) - 1
    invented = [
        Beacon(2, (Heartbeat(2, 10**6, 8, 1.0, "complete"),), ((1, everything), (2, everything)))
    ]
    invented += [
        Beacon(number, (Heartbeat(number, 1, 0, 1.0, "searching"),), ()) for number in range(3, 200)
    ]

    def lie(event):
        if event.kind == "searching":
            for key in (b"another", b""):
                stranger = radio_of("multicast", 2, key=key, port=ports[0])
                for beacon in invented:
                    stranger.send(beacon)
                stranger.close()

    outcome = live(brief_of(4, 4), [0, 8], speed=20.0, channel="multicast", on_event=lie)
    assert outcome.complete
    assert outcome.covered == 1.0
    assert outcome.dropped >= 2 * len(invented)


IMPOSSIBLE = {
    "stranger": Beacon(3, (Heartbeat(3, 1, 0, 1.0, "searching"),), ()),
    "sender": Beacon(0, (), ()),
    "rate": Beacon(1, (Heartbeat(1, 1, 0, 2.0, "searching"),), ()),
    "start": Beacon(1, (Heartbeat(1, 1, 5, 1.0, "searching"),), ()),
    "width": Beacon(1, (Heartbeat(1, 1, 0, 1.0, "searching", 3),), ()),
    "robots that searched": Beacon(1, (), ((3, 1),)),
    "cells": Beacon(1, (), ((1, 1 << 16),)),
    "obstacles": Beacon(1, (), (), (), ((1, 1 << 16),)),
    "found nowhere": Beacon(1, (), (), ((16, 2),)),
    "found by nobody": Beacon(1, (), (), ((3, 8),)),
}


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_what_no_robot_of_the_search_can_say(name):
    task = LiveTask(scenario_in(brief_of(4, 4), (0, 8)), 10.0, "unicast", 0)
    task.check(
        Beacon(
            1,
            (Heartbeat(1, 1, 0, 1.0, "searching"), Heartbeat(2, 7, 8, 1.0, "waiting")),
            ((2, 3),),
            ((3, 6),),
        )
    )
    with pytest.raises(InvalidInputError, match="beacon: expected"):
        task.check(IMPOSSIBLE[name])


def test_they_help_one_another():
    """Robots that hear nothing each search everything; these hear."""
    outcome = live(brief_of(4, 8, hello=8.0), [0, 0, 16, 16], speed=40.0)
    assert outcome.complete
    assert outcome.heard > 0
    assert outcome.lost == 0
    searched = searched_by(outcome.events)
    assert all(bits.bit_count() < 32 for bits in searched.values())
    assert nobody_shared_a_cell(outcome)


def test_a_slow_robot_is_helped_and_messages_are_short_and_signed():
    starts = [0, 24, 48, 72]
    outcome = live(
        brief_of(8, 12, hello=6.0),
        starts,
        faults=[Slow(2, 8.0)],
        key=b"of the robots",
        packet=64,
        speed=30.0,
    )
    assert outcome.complete
    assert outcome.covered == 1.0
    searched = searched_by(outcome.events)
    assert searched[2].bit_count() < 14
    assert max(outcome.declared.values()) < 24 * 8 / 2.5
    assert nobody_shared_a_cell(outcome)


def test_without_any_message_each_searches_everything():
    outcome = live(brief_of(3, 4), [0, 5], loss=1.0, speed=100.0)
    assert outcome.complete
    assert [bits.bit_count() for bits in searched_by(outcome.events).values()] == [12, 12]
    assert outcome.lost == outcome.heard
    assert nobody_shared_a_cell(outcome)


def test_a_robot_finds_things_and_goes_home_in_between():
    seen: list[LiveEvent] = []
    brief = brief_of(4, 4, energy=10.0, recharge=1.0)
    outcome = live(brief, [0], targets=(5,), rates=(2.0,), speed=100.0, on_event=seen.append)
    assert outcome.complete
    assert [event.cell for event in outcome.events if event.found] == [5]
    assert sorted(seen, key=lambda event: event.time) == list(outcome.events)
    assert seen[-1].kind == "declared"
    home = tuple(brief.tour_cost.points[0])
    assert [event.place for event in outcome.events if event.kind == "recharged"] == [home] * 3


def test_obstacles_are_met_and_told_of():
    """Two robots, one of them with a wide footprint; neither knows of the wall, which leaves one
    cell behind it out of reach.
    """
    tour = make_tour("hilbert-rectangle", (5, 6))
    wall = [int(tour.position[row, col]) for row, col in ((0, 1), (1, 1), (1, 0), (3, 3))]
    brief = Brief(TourCost(tour, distances=CellDistances(tour)), "stay", hello=8.0)
    starts = [int(tour.position[4, 0]), int(tour.position[4, 5])]
    outcome = live(brief, starts, obstacles=tuple(wall), widths=(1, 3), loss=0.2, speed=100.0)
    assert outcome.complete
    assert outcome.covered == 1.0
    met = {event.cell for event in outcome.events if event.kind == "obstructed"}
    assert met
    assert met <= set(wall)
    for event in outcome.events:
        if event.kind == "searched":
            assert not {event.cell, *event.through} & set(wall)
    assert any(len(event.around) > 2 for event in outcome.events if event.robot == 2)
    assert nobody_shared_a_cell(outcome)
    with pytest.raises(InvalidInputError, match="expected a tour with paths from cell to cell"):
        live(brief_of(3, 4), [0], obstacles=(2,))


def test_all_killed():
    outcome = live(brief_of(6, 6), [0, 18], faults=[Crash(1, 0.0), Crash(2, 3.0)], speed=20.0)
    assert not outcome.complete
    assert outcome.covered < 1.0
    assert sorted(outcome.killed) == [1, 2]
    assert not outcome.timed_out


def test_time_limit():
    outcome = live(brief_of(6, 6), [0, 18], speed=0.01, timeout=0.2)
    assert outcome.timed_out
    assert not outcome.complete
    assert [event.kind for event in outcome.events].count("stopped") == 2
    assert not outcome.failed
    assert children() == set()


def test_where_multicast_cannot_be_had_it_is_unicast(monkeypatch):
    assert radio.reserve("127.0.0.1") is None  # no multicast group: the system refuses
    monkeypatch.setattr(supervisor, "reserve", lambda port: radio.reserve("127.0.0.1", port))
    outcome = live(brief_of(3, 4), [0, 6], speed=100.0)
    assert outcome.channel == "unicast"
    assert outcome.complete
    with pytest.raises(InvalidInputError, match="multicast on the loopback interface"):
        live(brief_of(3, 4), [0, 6], channel="multicast")


def test_an_exception_of_the_caller_leaves_nothing_behind():
    before = descriptors()

    def fail(event: LiveEvent) -> None:
        if event.kind == "searched":
            raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        live(brief_of(6, 6), [0, 18], speed=40.0, on_event=fail)
    assert children() == set()
    assert descriptors() == before


SCRIPT = """
    import sys
    from pathlib import Path
    from shoal.search import TourCost, make_tour
    from shoal.search.simulation.live import run_live
    from shoal.search.protocol.robot import Brief
    from shoal.search.simulation.scenario import Scenario

    def show(event):
        if event.kind == "searched":
            print("searched", flush=True)

    if __name__ == "__main__":
        run_live(Scenario(Brief(TourCost(make_tour("moore", (16, 16))), "stay"), (0, 64, 128)), speed=4.0, on_event=show)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_when_the_starter_ends_so_do_the_robots(number, tmp_path):
    script = tmp_path / "search.py"
    script.write_text(textwrap.dedent(SCRIPT))
    starter = subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert starter.stdout is not None
    assert starter.stdout.readline() == "searched\n"
    robots = children()
    assert len(robots) == 4  # three, and the one that split them off
    starter.send_signal(number)
    _, errors = starter.communicate()
    assert starter.returncode == -number
    assert ("KeyboardInterrupt" in errors) == (number == signal.SIGINT)
    assert left_over(sorted(robots)) == []


def test_a_process_that_cannot_start_is_named(monkeypatch):
    monkeypatch.setattr(process.sys, "executable", "/bin/false")
    before = descriptors()
    with pytest.raises(
        ShoalError, match=r"robot 1: its process ended before it was ready: no reason given"
    ):
        live(brief_of(3, 4), [0])
    assert descriptors() == before


def test_a_robot_whose_radio_fails_is_named():
    """The port is none."""
    task = LiveTask(scenario_in(brief_of(3, 4), (0,)), 10.0, "multicast", -1)
    with (
        process.ProcessPool(task) as robots,
        pytest.raises(ShoalError, match=r"robot 1: .*OverflowError"),
    ):
        robots.wait_ready(60.0)
    assert children() == set()


def test_a_robot_that_fails_later_is_named_and_the_others_go_on():
    """The speed of the second one is none: it fails when it wants to tell of it."""
    scenario = scenario_in(brief_of(3, 4), (0, 6))
    object.__setattr__(scenario, "rates", (1.0, "fast"))
    task = LiveTask(scenario, 100.0, "unicast", 0)
    with process.ProcessPool(task) as robots:
        robots.wait_ready(60.0)
        outcome = supervisor._Watch(robots, task, None, 0.0).run(60.0)
    assert list(outcome.failed) == [2]
    assert outcome.failed[2] == "struct.error: required argument is not a float"
    assert outcome.complete
    assert list(outcome.declared) == [1]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"starts": []}, "starts: expected one or more cells"),
        ({"starts": [12]}, "starts: expected one or more cells from 0 to 11"),
        ({"rates": (0.0,)}, "rates: expected 1 speeds above 0"),
        ({"loss": 1.5}, "loss: expected a probability"),
        ({"speed": 0.0}, "speed: expected cells a second"),
        ({"faults": (Crash(2, 1.0),)}, "fault: expected a robot from 1 to 1"),
        (
            {"faults": (Crash(1, -1.0),)},
            "live: expected only crashes and slow robots as faults, at times of 0 or more",
        ),
        ({"faults": (Pause(1, 1.0, 2.0),)}, "live: expected only crashes and slow robots"),
        ({"targets": (12,)}, "targets: expected cells from 0 to 11"),
        ({"packet": 63}, "packet: expected a whole number from 64 to 65507"),
        ({"port": 65536}, "port: expected a number from 1 to 65535"),
        ({"network": "range:3"}, "live: expected no network, because a live search has only loss"),
        ({"channel": "smoke"}, "channel: expected auto, multicast or unicast, got 'smoke'"),
    ],
)
def test_bad_input(options, message):
    with pytest.raises(InvalidInputError, match=message):
        live(brief_of(3, 4), **{"starts": [0], **options})


# The rooms of a robot's process.


def test_vehicle_moves_the_same_in_one_step_or_many():
    leg = MovingPoint(0.0, (0.0, 0.0), (3.0, 4.0)).start_leg((3.0, 4.0), distance=5.0, length=5.0)
    many = MovingPoint(0.0, (0.0, 0.0), (0.0, 0.0)).start_leg((3.0, 4.0), distance=5.0, length=5.0)
    once = many.at(3.0, rate=1.0)
    for tick in range(1, 301):
        many = many.at(tick / 100, rate=1.0)
    assert many.travelled == pytest.approx(once.travelled)
    assert many.speed == pytest.approx(once.speed)
    assert many.place == pytest.approx((many.travelled * 0.6, many.travelled * 0.8))
    assert leg.place == (3.0, 4.0)


def test_vehicle_stops_before_a_cell_until_it_may_enter():
    vehicle = MovingPoint(0.0, (0.0,), (0.0,)).start_leg((5.0,), distance=5.0, length=5.0)
    while not vehicle.arrived:
        vehicle = vehicle.at(vehicle.earliest(rate=1.0), rate=1.0)
    assert vehicle.at(99.0, rate=1.0).travelled == vehicle.travelled == pytest.approx(4.0, abs=1e-3)
    assert vehicle.time >= 4.0


def test_only_one_process_is_in_a_cell_and_death_frees_it():
    with tempfile.TemporaryFile() as ground:
        code = (
            "import os, sys; from shoal.search.simulation.live import vehicle as cell_locks; ground ="
            " int(sys.argv[1])\nprint(cell_locks.enter(ground, 3), cell_locks.enter(ground, 4),"
            " flush=True); sys.stdin.read()"
        )
        assert cell_locks.enter(ground.fileno(), 3)
        words = [sys.executable, "-c", code, str(ground.fileno())]
        other = subprocess.Popen(
            words,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=[ground.fileno()],
            text=True,
        )
        assert other.stdout is not None
        assert other.stdout.readline() == "False True\n"
        assert not cell_locks.enter(ground.fileno(), 4)
        other.kill()
        other.communicate()
        assert cell_locks.enter(ground.fileno(), 4)
        cell_locks.leave(ground.fileno(), 4)
        fcntl.lockf(ground, fcntl.LOCK_UN)


def test_radios_hear_one_another_and_not_themselves():
    one, other = radio_of("unicast", 1), radio_of("unicast", 2)
    deaf = radio_of("unicast", 3, loss=1.0)
    beacon = Beacon(1, (Heartbeat(1, 1, 0, 1.0, "searching"),))
    ports = [each.radio.port for each in (one, other, deaf)]
    for each in (one, other, deaf):
        each.radio.tell(ports)
    one.send(beacon)
    for each in (other, deaf):
        assert select.select([each], [], [], 30)[0]
    assert (one.receive(), other.receive(), deaf.receive()) == ([], [beacon], [])
    assert (deaf.heard, deaf.lost) == (1, 1)
    for each in (one, other, deaf):
        each.close()


def test_a_damaged_message_is_lost_and_orders_may_end():
    reading, writing = os.pipe()
    os.write(writing, b'{"epoch": 1.5, ')
    os.write(writing, b'"ports": [7]}\n')
    assert process._first_line(reading) == {"epoch": 1.5, "ports": [7]}
    os.close(writing)
    assert process._first_line(reading) is None
    os.close(reading)


# What a robot makes of beacons that no robot of ours would send.


def test_cells_that_there_are_not_do_not_keep_a_robot_from_being_done():
    brief = brief_of(2, 2)
    robot, _ = advance(Robot(1, brief, 0), Begin(0.0))
    strange = Beacon(2, (Heartbeat(2, 1, 0, 1.0, "searching"),), ((2, 0b11111),), ((9, 1),))
    robot, _ = advance(robot, Heard(0.5, strange))
    assert robot.found == {}
    robot, actions = advance(robot, Wake(1.0))
    assert any(isinstance(action, Declare) for action in actions)


@pytest.mark.parametrize("cores", [1, 2, 16])
@pytest.mark.parametrize("robots", [1, 2, 12, 30, 60])
def test_robots_send_no_more_than_the_cores_can_take(robots, cores):
    beat = supervisor.live_beat(robots, cores=cores)
    assert beat >= 0.05
    busy = robots * (robots - 1) * supervisor._MESSAGE / beat
    assert busy <= 0.5 * cores + 1e-9
    assert beat == 0.05 or busy >= 0.5 * cores - 1e-9


def test_the_time_that_a_live_search_takes_is_said_before_it_begins(monkeypatch):
    said, began = [], []
    monkeypatch.setattr("shoal.core.notices.listeners", [said.append])
    monkeypatch.setattr(supervisor, "live_beat", lambda _robots: 0.4)
    monkeypatch.setattr(
        supervisor, "run_live", lambda scenario, **_: began.append((scenario, *said)) or 1 / 0
    )
    with pytest.raises(ZeroDivisionError):
        run_search(SearchProblem("rectangle:40x30", robots=3, footprint=10, live=20.0), seed=1)
    (scenario, told), *_ = began
    # the robots listen for eight beacons, and then search four or five cells each
    assert scenario.brief.hello == 8 * 0.4 * 20
    assert scenario.brief.beat == 0.4 * 20
    assert told.startswith("3 live robots at 20 cells a second: about 3.")
    assert told.endswith("with a beacon of each robot every 0.4 s")
