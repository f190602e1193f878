"""The ports of a robot's agent, and what it does when what stands behind them fails."""

from __future__ import annotations

import os
import tempfile
import time
from math import inf
from random import Random

import pytest

from shoal.search import TourCost, make_tour
from shoal.search.protocol.messages import Beacon, Heartbeat, Receiver, Sender
from shoal.search.protocol.robot import advance
from shoal.search.protocol.state import Begin, Brief, Go, Heard, Wake, is_late
from shoal.search.simulation.live.agent import Agent
from shoal.search.simulation.live.ports import CellFinding
from shoal.search.simulation.live.radio import LiveTask, LoopbackRadio
from shoal.search.simulation.live.vehicle import PointVehicle, ScenarioSensor
from shoal.search.simulation.scenario import Scenario
from shoal.testing import check_radio, check_search_sensor, check_vehicle

SPEED = 500.0  # cells a second
KEY = b"0123456789abcdef"


def task_of(robots=1, rows=3, columns=4, **more):
    brief = Brief(TourCost(make_tour("hilbert-rectangle", (rows, columns))), "stay")
    starts = tuple(range(0, rows * columns, rows * columns // robots))[:robots]
    return LiveTask(Scenario(brief, starts, **more), SPEED, "unicast", 0, KEY)


def point(task, number=1):
    start = task.robot(number).start
    place = tuple(float(x) for x in task.scenario.brief.tour_cost.points[start])
    return PointVehicle(place, lambda _time: 1.0)


class DeafRadio:
    """A radio that keeps what is sent, and hears nothing."""

    most, rate, fault = 1200, inf, ""

    def __init__(self):
        self.messages = []
        self._ends = os.pipe()

    def fileno(self):
        return self._ends[0]

    def broadcast(self, message):
        self.messages.append(message)
        return 0

    def receive(self):
        return None

    def close(self):
        for end in self._ends:
            os.close(end)


@pytest.fixture
def ground():
    with tempfile.TemporaryFile() as file:
        yield file.fileno()


@pytest.fixture
def radio():
    made = DeafRadio()
    yield made
    made.close()


def agent_of(task, ground, radio, *, robot=None, vehicle=None, begin=None, **more):
    begin = time.monotonic() if begin is None else begin
    return Agent(
        task,
        task.robot(1) if robot is None else robot,
        task.messenger(1, radio),
        point(task) if vehicle is None else vehicle,
        ScenarioSensor(task.scenario, 1, ground),
        clock=lambda: (time.monotonic() - begin) * SPEED,
        **{"tell": lambda _report: None, **more},
    )


@pytest.mark.parametrize("loss", [0.0, 0.5])
def test_radios_of_live_robots(loss):
    class Lossy(LoopbackRadio):
        def broadcast(self, message):
            return 0 if random.random() < loss else super().broadcast(message)

    random = Random(3)
    one, other = Lossy("unicast"), Lossy("unicast")
    for each in (one, other):
        each.tell([one.port, other.port])
    check_radio(one, other, seconds=0.05)
    for each in (one, other):
        each.close()


def test_vehicles_and_sensors_of_live_robots(ground):
    task = task_of(obstacles=(), targets=(0, 5), widths=(3,))
    check_vehicle(point(task), 9, (0.0, 3.0))
    check_search_sensor(ScenarioSensor(task.scenario, 1, ground), (0, 1, 5))


class Hasty(PointVehicle):
    """It does not wait before a cell."""

    def go(self, leg, time):
        super().go(leg, time)
        self.enter()


class Restless(PointVehicle):
    """It says that it has arrived as soon as it sets out."""

    def step(self, time):
        super().step(time)
        return True


@pytest.mark.parametrize(("kind", "fault"), [(Hasty, "a halt one cell"), (Restless, "without a")])
def test_a_vehicle_that_breaks_the_contract_is_found(kind, fault):
    with pytest.raises(AssertionError, match=fault):
        check_vehicle(kind((0.0, 0.0), lambda _time: 1.0), 1, (0.0, 3.0))


def test_a_vehicle_that_never_arrives_is_found():
    with pytest.raises(AssertionError, match="expected that it halted"):
        check_vehicle(PointVehicle((0.0, 0.0), lambda _time: 1e-6), 1, (0.0, 3.0), most=20.0)


def test_a_radio_that_hears_itself_or_spoils_messages_is_found():
    class Echo(DeafRadio):
        def __init__(self, peer=None, spoil=bytes):
            super().__init__()
            self.inbox, self.peer, self.spoil = [], peer, spoil

        def broadcast(self, message):
            for each in (self, self.peer):
                each.inbox.append(self.spoil(message))
            return 0

        def receive(self):
            return (self.inbox.pop(0), "air") if self.inbox else None

    for spoil, fault in ((bytes, "no message of its own"), (lambda some: some + b"!", "unchanged")):
        one, other = Echo(spoil=spoil), Echo(spoil=spoil)
        one.peer, other.peer = other, one
        with pytest.raises(AssertionError, match=fault):
            check_radio(one, other, tries=2, seconds=0.0)
        one.close()
        other.close()


def test_a_sensor_that_contradicts_itself_is_found(ground):
    class Wrong(ScenarioSensor):
        def search(self, cell):
            return CellFinding(False, (1, 2), (3,))

    with pytest.raises(AssertionError, match="expected in beside cells of around"):
        check_search_sensor(Wrong(task_of().scenario, 1, ground), (0, 5))


@pytest.mark.parametrize("where", ["vehicle", "radio"])
def test_others_hear_of_a_fault_and_are_told_to_help(where, ground, radio):
    """After its third cell, the robot has a fault: it brings its vehicle to safety, and says so."""
    task, seen, secured = task_of(robots=2), [], []

    class Failing(PointVehicle):
        def secure(self):
            secured.append(self.where())

    vehicle = Failing(point(task).where(), lambda _time: 1.0)

    def tell(report):
        seen.append(report)
        if sum(one["kind"] == "searched" for one in seen) == 3:
            (vehicle if where == "vehicle" else radio).fault = "autopilot: not heard"

    agent = agent_of(task, ground, radio, vehicle=vehicle, tell=tell)
    assert not agent.run()
    assert agent.fault == "autopilot: not heard"
    assert len(secured) == 1
    assert [one["reason"] for one in seen if one["kind"] == "fault"] == ["autopilot: not heard"]
    # the other robot: it hears the first beacon, and then one of the last ones alone
    receiver = Receiver(KEY, robots=2, cells=12)
    beacons = [receiver.open(one, time.time_ns() // 1_000_000) for one in radio.messages]
    other, _ = advance(task.robot(2), Begin(0.0))
    other, _ = advance(other, Heard(0.5, beacons[0]))
    other, _ = advance(other, Wake(1.0))
    assert not is_late(other, 1, 1.5)
    for last in beacons[-8:]:
        told, _ = advance(other, Heard(1.5, last))
        assert is_late(told, 1, 1.5)
        assert told.searched[1].bit_count() == 3


def test_a_robot_goes_on_where_its_process_ended(ground, radio):
    """The events that it recorded give its state again: it searches no cell twice."""
    task, events, searched = task_of(), [], []
    begin = time.monotonic()

    def stop_after_five(report):
        if report["kind"] == "searched":
            if len(searched) == 5:
                raise KeyboardInterrupt
            searched.append(report["cell"])

    agent = agent_of(task, ground, radio, begin=begin, tell=stop_after_five, record=events.append)
    with pytest.raises(KeyboardInterrupt):
        agent.run()
    robot = task.robot(1)
    for event in events:
        robot, _ = advance(robot, event)
    assert robot == agent.robot
    assert robot.mine.bit_count() == 5

    def tell(report):
        if report["kind"] == "searched":
            searched.append(report["cell"])

    assert agent_of(task, ground, radio, robot=robot, begin=begin, tell=tell).run()
    assert sorted(searched) == list(range(12))


def test_refused_messages_are_counted_by_their_reason(radio):
    task = task_of(robots=2)
    beacon = Beacon(2, (Heartbeat(2, 1, 6, 1.0, "listening"),))
    now = time.time_ns() // 1_000_000
    good = Sender(2, KEY).messages(beacon, now)[0]
    came = [
        good,
        good,
        Sender(2, b"another key, same length").messages(beacon, now + 1)[0],
        Sender(2, KEY).messages(beacon, now - 120_000)[0],
        Sender(3, KEY).messages(beacon, now)[0],
        b"noise",
    ]
    radio.receive = lambda: (came.pop(0), "air") if came else None
    messenger = task.messenger(1, radio)
    assert messenger.receive() == [beacon]
    assert dict(messenger.refused) == {
        "repeated": 1,
        "another key or search": 1,
        "time stamp": 1,
        "unknown robot": 1,
        "broken": 1,
    }
    assert messenger.dropped == 5


def test_two_robots_with_one_number_notice_each_other(radio):
    """As after a memory card was copied: both would fly to the same cells at the same height."""
    task = task_of(robots=2)
    beacon = Beacon(1, (Heartbeat(1, 1, 0, 1.0, "listening"),))
    air = []
    radio.broadcast = lambda message: air.append(message) or 0
    radio.receive = lambda: (air.pop(0), "air") if air else None
    before = Sender(1, KEY).messages(beacon, time.time_ns() // 1_000_000 - 1000)
    messenger = task.messenger(1, radio)
    messenger.send(beacon)
    messenger.send(beacon)
    air += before  # sent by this robot before its program was started again
    air *= 2  # a radio that hears itself, and a stranger who repeats
    assert messenger.receive() == []
    assert messenger.fault == ""
    air += Sender(1, b"another key, same length").messages(beacon, time.time_ns() // 1_000_000 + 9)
    assert messenger.receive() == []
    assert messenger.fault == ""
    air += Sender(1, KEY).messages(beacon, time.time_ns() // 1_000_000 + 9)
    assert messenger.receive() == []
    assert messenger.fault == "radio: another robot has the number 1, too"


def test_nobody_is_silenced_by_packets_that_have_a_forged_address(radio):
    """A stranger sends noise and replays with the address of robot 2, whose message comes last."""
    task = task_of(robots=2)
    now = time.time_ns() // 1_000_000
    sender = Sender(2, KEY)
    first, last = (
        sender.messages(Beacon(2, (Heartbeat(2, count, 6, 1.0, "listening"),)), now)[0]
        for count in (1, 2)
    )
    came = [first, *[b"noise", first] * 200, last]
    radio.receive = lambda: (came.pop(0), "the address of robot 2") if came else None
    messenger = task.messenger(1, radio)
    beacons = [messenger.receive() for _ in range(10)]  # the radio rests after each 50 refusals
    assert [beacon.heartbeats[0].count for some in beacons for beacon in some] == [1, 2]
    assert messenger.refused == {"broken": 200, "repeated": 200}
    assert messenger.rest_until > 0


def test_a_robot_that_waits_has_nothing_to_do(ground, radio):
    """After its last cell, it does nothing more; before a cell that another robot is in, it looks
    again at times, and not all the time.
    """
    agent = agent_of(task_of(), ground, radio)
    assert agent.run()
    assert agent._due() == inf
    agent._clock = lambda: 1000.0
    agent._going, agent._rest = Go(3), 1000.25  # its vehicle has arrived
    assert agent._due() == 1000.25
    agent._rest = 1000.0
    assert agent._due() <= 1000.0
