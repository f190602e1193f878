"""A robot's vehicle behind MAVLink, on simulated time: what is checked before take-off, guided
flight, and what happens when something is lost.
"""

from __future__ import annotations

import re

import numpy as np
import pytest

pytest.importorskip("pymavlink")

from shoal.robots import modes
from shoal.robots.companion import Companion
from shoal.robots.guided import FLIGHT, GROUND, GuidedVehicle
from shoal.robots.journal import Journal
from shoal.robots.mavlink import ARDUPILOT, AUTOPILOTS, PX4, LinkError, Station
from shoal.robots.mission_protocol import FENCE, FENCE_CORNERS, RALLY, MissionItem
from shoal.robots.settings import safe_parameters
from shoal.robots.simulated import SimulatedLink, SimulatedVehicle
from shoal.robots.tasks import RobotLimits, read_task, write_task
from shoal.search import SearchProblem
from shoal.search.regions.formats.flight_logs import dialect
from shoal.search.run import run
from shoal.search.simulation.live.ports import Leg
from shoal.search.simulation.live.radio import LoopbackRadio
from shoal.testing import check_vehicle

BOTH = pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
NUMBERS = {name.lower(): number for number, name in AUTOPILOTS.items()}


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    folder = tmp_path_factory.mktemp("task")
    problem = SearchProblem(
        region="rectangle:60x40", robots=2, footprint=20, vehicle="multirotor,altitude=30"
    )
    write_task(run(problem, seed=1), folder, RobotLimits(apart_s=4.0))
    return read_task(folder)


def fence_around(task, metres=40.0):
    low, high = task.cells.min(axis=0) - metres, task.cells.max(axis=0) + metres
    ring = np.array([low, [high[0], low[1]], high, [low[0], high[1]]])
    degrees = task.frame.to_degrees(ring)
    return [
        MissionItem(0, FENCE_CORNERS[0], (4.0, 0.0, 0.0, 0.0), round(y * 1e7), round(x * 1e7), 0.0)
        for x, y in degrees.tolist()
    ]


class Robot:
    """A robot's vehicle and its simulated autopilot, on one link."""

    def __init__(self, task, autopilot="px4", *, number=1, arm=True, accepted=(), **changes):
        home = task.frame.to_degrees(task.cells[task.scenario.starts[number - 1]][None, :2])[0]
        told = safe_parameters(NUMBERS[autopilot], task.kind, task.height(number)) | changes
        self.autopilot = SimulatedVehicle(
            number,
            autopilot=autopilot,
            home=tuple(home.tolist()),
            parameters={name: value for name, value in told.items() if value is not None},
        )
        self.autopilot.stored[FENCE] = fence_around(task)
        self.strangers = []
        self.link = SimulatedLink([self.autopilot], strangers=self.strangers)
        self.said = []
        self.station = Station(self.link)
        self.vehicle = GuidedVehicle(
            self.station, task, number, arm=arm, accepted=accepted, say=self.said.append
        )
        self.task = task

    def go_to(self, cell):
        points = self.task.plan.tour_cost.points[cell]
        self.vehicle.go(Leg(cell, tuple(points.tolist()), 1.0, 1.0), 0.0)

    def step_until(self, condition, seconds=120.0):
        """Let the companion work until a condition is true; return whether it became true."""
        end = self.link.now() + seconds
        while self.link.now() < end:
            arrived = self.vehicle.step(0.0)
            if condition(arrived):
                return True
            self.wait(0.1)
        return False

    def wait(self, seconds, *, dead=False):
        """Let time pass; a dead companion neither speaks nor listens."""
        end = self.link.now() + seconds
        while self.link.now() < end:
            if dead:
                self.link.receive(end - self.link.now())
            else:
                self.station.listen(end)

    def fly_to(self, cell):
        self.go_to(cell)
        assert self.step_until(lambda arrived: arrived), self.vehicle.fault
        self.vehicle.enter()
        assert self.step_until(lambda arrived: arrived), self.vehicle.fault


@BOTH
def test_a_vehicle_flies_to_its_cell_halts_before_it_and_returns(task, autopilot):
    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []
    goal = task.cells[-1]
    robot.go_to(len(task.cells) - 1)
    assert robot.step_until(lambda arrived: arrived)
    away = np.linalg.norm(robot.autopilot.position[:2] - robot_frame(robot, goal))
    assert away == pytest.approx(task.plan.grid.size, abs=robot.vehicle.near + 1)
    robot.vehicle.enter()
    assert robot.step_until(lambda arrived: arrived)
    assert np.linalg.norm(robot.autopilot.position[:2] - robot_frame(robot, goal)) < 4
    assert robot.autopilot.position[2] == pytest.approx(task.height(1), abs=1)
    assert robot.vehicle.bring_home(120)
    assert not robot.autopilot.armed
    assert np.linalg.norm(robot.autopilot.position) < 2  # home


@BOTH
def test_it_is_a_vehicle_of_the_port(task, autopilot):
    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []

    def clock():
        robot.wait(1.0)
        return robot.link.now() * task.speed

    last = len(task.cells) - 1
    near = task.arrival_m / task.plan.grid.size + 0.1
    goal = task.plan.tour_cost.points[last]
    check_vehicle(robot.vehicle, last, goal, near=near, clock=clock)


@BOTH
def test_a_vehicle_that_waits_before_its_cell_may_still_enter(task, autopilot):
    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []
    robot.go_to(len(task.cells) - 1)
    robot.vehicle.stop(0.0)  # on the ground: it does not take off for nothing
    assert not robot.step_until(lambda _arrived: robot.autopilot.armed, 20)
    robot.go_to(len(task.cells) - 1)
    assert robot.step_until(lambda arrived: arrived)
    robot.vehicle.stop(0.0)
    assert robot.step_until(lambda arrived: arrived)
    robot.vehicle.enter()
    assert robot.step_until(lambda arrived: arrived)
    robot.go_to(2)
    robot.step_until(lambda _arrived: False, 2)
    robot.vehicle.stop(0.0)  # on the way: it gives up its leg
    assert not robot.step_until(lambda arrived: arrived, 20)
    assert np.linalg.norm(robot.autopilot.velocity) < 0.1


def robot_frame(robot, point):
    """Return a point of the region in metres from the robot's home."""
    home = robot.task.cells[robot.task.scenario.starts[robot.vehicle.number - 1]]
    return point[:2] - home[:2]


@BOTH
def test_it_flies_home_to_recharge_and_takes_off_again(task, autopilot):
    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []
    robot.fly_to(len(task.cells) - 1)
    start = task.scenario.starts[0]
    goal = tuple(task.plan.tour_cost.points[start].tolist())
    robot.vehicle.go(Leg(start, goal, 1.0, 2.0, home=True), 0.0)
    assert robot.step_until(lambda arrived: arrived)
    assert not robot.autopilot.armed
    assert np.linalg.norm(robot.autopilot.position) < 2
    robot.vehicle.stop(0.0)  # while the battery is changed
    assert robot.step_until(lambda arrived: arrived, 5)
    robot.wait(200)
    robot.fly_to(len(task.cells) - 1)


@BOTH
def test_without_arm_it_never_arms_and_waits_for_the_pilot(task, autopilot):
    robot = Robot(task, autopilot, arm=False)
    assert robot.vehicle.prepare() == []
    robot.go_to(len(task.cells) - 1)
    assert not robot.step_until(lambda _arrived: robot.autopilot.armed, 30)
    assert robot.said == ["waiting until somebody arms the vehicle, because --arm was not given"]
    robot.autopilot._arm()  # the pilot
    assert robot.step_until(lambda arrived: arrived)


UNSAFE = [
    ("px4", {"COM_OBL_RC_ACT": 0}, "failsafe: expected COM_OBL_RC_ACT 3 or 4 (return or land"),
    ("px4", {"COM_OBL_RC_ACT": 5}, "got 5"),  # hold: a dead companion leaves it hovering
    ("px4", {"COM_OBL_RC_ACT": None}, "failsafe: expected COM_OBL_RC_ACT 3 or 4, got none"),
    ("px4", {"COM_OF_LOSS_T": 60.0}, "failsafe: expected COM_OF_LOSS_T 0 to 10"),
    ("px4", {"NAV_DLL_ACT": 6}, "failsafe: expected NAV_DLL_ACT 0, 2 or 3"),
    ("px4", {"GF_ACTION": 2}, "fence: expected GF_ACTION 3 or 5"),
    ("px4", {"GF_MAX_VER_DIST": 20.0}, "fence: expected GF_MAX_VER_DIST 0 or more than 32"),
    ("px4", {"RTL_RETURN_ALT": 60.0}, "return: expected RTL_RETURN_ALT 30"),
    ("px4", {"RTL_LAND_DELAY": -1.0}, "return: expected RTL_LAND_DELAY 0 to 60"),
    ("ardupilot", {"FS_GCS_ENABLE": 0}, "failsafe: expected FS_GCS_ENABLE 1, 3, 4, 5, 6 or 7"),
    ("ardupilot", {"FS_GCS_TIMEOUT": 120}, "failsafe: expected FS_GCS_TIMEOUT 1 to 30"),
    ("ardupilot", {"SYSID_MYGCS": None}, "failsafe: expected SYSID_MYGCS 1 to 255, got none"),
    ("ardupilot", {"FENCE_ENABLE": 0}, "fence: expected FENCE_ENABLE 1"),
    ("ardupilot", {"FENCE_ACTION": 0}, "fence: expected FENCE_ACTION 1 to 5"),
    ("ardupilot", {"FENCE_TYPE": 3}, "fence: expected FENCE_TYPE a value with bit 4"),
    ("ardupilot", {"FENCE_TYPE": 7, "FENCE_ALT_MAX": 25}, "fence: expected FENCE_ALT_MAX above 32"),
    ("ardupilot", {"RTL_ALT": 1500}, "return: expected RTL_ALT 30 m"),
    ("ardupilot", {"RTL_ALT_FINAL": 500}, "return: expected RTL_ALT_FINAL 0 (it lands"),
]


@pytest.mark.parametrize(("autopilot", "changes", "sentence"), UNSAFE)
def test_an_autopilot_without_its_failsafes_is_refused(task, autopilot, changes, sentence):
    (fault,) = Robot(task, autopilot, **changes).vehicle.prepare()
    assert sentence in fault
    accepted = fault.partition(":")[0]
    assert Robot(task, autopilot, accepted=(accepted,), **changes).vehicle.prepare() == []


def test_newer_names_of_parameters_are_read_too(task):
    robot = Robot(task, "ardupilot", RTL_ALT=None, RTL_ALT_M=30.0, SYSID_MYGCS=None)
    robot.autopilot.parameters |= {"MAV_GCS_SYSID": 200, "MAV_GCS_SYSID_HI": 0}
    assert robot.vehicle.prepare() == []


@BOTH
def test_what_is_on_board_is_checked(task, autopilot):
    robot = Robot(task, autopilot)
    robot.autopilot.stored[FENCE] = []
    robot.autopilot.stored[RALLY] = [MissionItem(3, 5100, (0.0,) * 4, 0, 0, 20.0)] * 2
    assert robot.vehicle.prepare() == [
        "fence: expected a fence on board, got none",
        "return: expected no rally points on board, to which several robots would return, got 2",
    ]


def heartbeats_of(system):
    """Return a stranger that sends heartbeats of a ground station once a second."""
    messages = dialect()
    sender, last = messages.MAVLink(None, system, 190), [-1.0]

    def speak(now):
        if now - last[0] < 1.0:
            return []
        last[0] = now
        return [bytes(messages.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(sender))]

    return speak


def test_another_station_that_would_hide_a_dead_companion_is_refused(task):
    robot = Robot(task, "ardupilot", SYSID_MYGCS=255)
    robot.strangers.append(heartbeats_of(255))
    (fault,) = robot.vehicle.prepare()
    assert fault.startswith("failsafe: expected no other station with the system id 255, got one")
    # one with another system id is welcome
    robot = Robot(task, "ardupilot", SYSID_MYGCS=254)
    robot.strangers.append(heartbeats_of(255))
    assert robot.vehicle.prepare() == []


@pytest.mark.parametrize("other", [{}, {"silent": True}])
def test_no_or_another_vehicle_is_refused(task, other):
    robot = Robot(task)
    robot.autopilot.silent = bool(other)
    if other:
        with pytest.raises(LinkError, match="expected a heartbeat of an autopilot"):
            robot.vehicle.prepare()
    else:
        robot.autopilot.kind = "rover"
        assert robot.vehicle.prepare() == [
            "expected a multirotor as in the task, got a rover with PX4"
        ]


@BOTH
def test_a_dead_companion_leaves_no_vehicle_hovering(task, autopilot):
    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []
    robot.fly_to(len(task.cells) - 1)
    robot.wait(60, dead=True)
    assert not robot.autopilot.armed
    assert np.linalg.norm(robot.autopilot.position) < 2


@pytest.mark.parametrize(
    ("autopilot", "changes"),
    [
        ("px4", {"COM_OBL_RC_ACT": 0, "NAV_DLL_ACT": 0}),
        ("ardupilot", {"FS_GCS_ENABLE": 0}),
    ],
)
def test_without_the_failsafe_it_would_hover(task, autopilot, changes):
    """The simulated autopilots really have the failsafes: this one does not, and hovers."""
    robot = Robot(task, autopilot, accepted=("failsafe",), **changes)
    assert robot.vehicle.prepare() == []
    robot.fly_to(len(task.cells) - 1)
    robot.wait(120, dead=True)
    assert robot.autopilot.armed
    assert robot.autopilot.position[2] > 20


@BOTH
def test_a_silent_autopilot_is_a_fault_and_its_watchdog_acts(task, autopilot):
    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []
    robot.fly_to(len(task.cells) - 1)
    robot.autopilot.silent = True
    assert robot.step_until(lambda _arrived: robot.vehicle.fault, 10)
    assert robot.vehicle.fault.startswith("autopilot: not heard for")
    robot.vehicle.secure()
    assert not robot.vehicle.bring_home(60)  # nothing more can be done
    robot.wait(60, dead=True)
    assert not robot.autopilot.armed


@BOTH
def test_a_lost_position_ends_in_a_landing(task, autopilot):
    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []
    robot.fly_to(len(task.cells) - 1)
    robot.autopilot.lost_position = True
    assert robot.step_until(lambda _arrived: robot.vehicle.fault, 10)
    assert robot.vehicle.fault.startswith("position: none for")
    robot.vehicle.secure()
    assert robot.vehicle.bring_home(60)
    assert robot.autopilot.mode == modes.LAND
    assert robot.autopilot.position[2] == 0


@BOTH
def test_an_unknown_battery_ends_the_search(task, autopilot):
    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []
    robot.fly_to(1)
    robot.autopilot.charge_unknown = True
    assert robot.step_until(lambda _arrived: robot.vehicle.fault, 20)
    assert re.fullmatch("battery: its charge has been unknown for [56] s", robot.vehicle.fault)
    robot.vehicle.secure()
    assert robot.vehicle.bring_home(60)

    robot = Robot(task, autopilot)
    robot.autopilot.charge_unknown = True
    assert robot.vehicle.prepare() == ["expected a battery above 20 %, got an unknown charge"]


@BOTH
def test_a_low_battery_and_the_pilot_end_the_search(task, autopilot):
    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []
    robot.fly_to(1)
    robot.autopilot.charge = 0.19
    assert robot.step_until(lambda _arrived: robot.vehicle.fault, 10)
    assert robot.vehicle.fault == "battery: 19 % left, and the robot returns at 20 %"
    robot.vehicle.secure()
    assert robot.vehicle.bring_home(60)

    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []
    robot.fly_to(1)
    robot.autopilot.mode = modes.HOLD  # the pilot
    assert robot.step_until(lambda _arrived: robot.vehicle.fault, 10)
    assert robot.vehicle.fault == "pilot or autopilot: the mode was changed to hold"
    robot.vehicle.secure()
    landing = robot.link.now() + 30  # longer than the watchdogs wait
    seen = set()

    def pilot(now):
        if robot.autopilot.armed:
            seen.add(robot.autopilot.mode)
        if now > landing:
            robot.autopilot.mode = modes.LAND
        return []

    robot.strangers.append(pilot)
    assert robot.vehicle.bring_home(10)  # it waits for the pilot, however long
    assert seen == {modes.HOLD, modes.LAND}  # nobody took the vehicle out of the pilot's hands
    assert robot.said == ["the vehicle is the pilot's; heartbeats go on until it is disarmed"]


@BOTH
def test_a_restarted_companion_takes_over_what_still_flies_and_lets_land_what_returns(
    task, autopilot
):
    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []
    robot.fly_to(len(task.cells) - 1)
    again = GuidedVehicle(robot.station, task, 1, arm=True)
    robot.vehicle = again
    if autopilot == "ardupilot":  # within the 5 s of its watchdog; PX4 returns, too, after 5 s
        assert again.prepare() == []
        assert again.phase == FLIGHT
        robot.fly_to(0)
        assert robot.autopilot.mode == modes.GUIDED
    robot.wait(8, dead=True)
    assert robot.autopilot.mode == modes.RETURN
    again = robot.vehicle = GuidedVehicle(robot.station, task, 1, arm=True)
    assert again.prepare() == []
    robot.go_to(len(task.cells) - 1)
    assert robot.step_until(lambda _arrived: again.phase == GROUND)  # it is not turned round
    assert robot.autopilot.position[2] == 0
    assert robot.step_until(lambda arrived: arrived)


@BOTH
def test_who_cannot_take_off_gives_up_so_that_others_do_not_wait(task, autopilot):
    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []
    robot.autopilot.refuses_to_arm = "compass"
    robot.go_to(1)
    assert robot.step_until(lambda _arrived: robot.vehicle.fault, 200)
    assert robot.vehicle.fault.startswith("take-off: not in the air after 120 s; the vehicle says")
    assert "compass" in robot.vehicle.fault
    robot.vehicle.secure()
    assert robot.vehicle.bring_home(10)
    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []
    robot.autopilot.lost_position = True
    robot.go_to(1)
    assert robot.step_until(lambda _arrived: robot.vehicle.fault, 20)
    assert robot.vehicle.fault.startswith("position: none for")
    assert robot.vehicle.bring_home(10)


@BOTH
def test_ctrl_c_brings_the_vehicle_home(task, autopilot, tmp_path, monkeypatch):
    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []
    robot.fly_to(len(task.cells) - 1)
    journal, radio = (
        Journal(tmp_path / "state", task.search, 1, epoch=0.0),
        LoopbackRadio("unicast"),
    )
    companion = Companion(task, 1, radio, journal, robot.vehicle, clock=robot.link.now)

    def interrupted():
        raise KeyboardInterrupt

    monkeypatch.setattr(companion.agent, "run", interrupted)
    said = []
    result = companion.run(said.append)
    assert said[0] == "interrupted: the vehicle returns"
    assert (result.complete, result.landed) == (False, True)
    assert result.fault == "interrupted by the operator"
    assert not robot.autopilot.armed
    assert np.linalg.norm(robot.autopilot.position) < 2
    radio.close()
    journal.close()


def test_heights_and_turns_keep_robots_apart(task):
    first, second = Robot(task, number=1), Robot(task, number=2)
    for robot in (first, second):
        assert robot.vehicle.prepare() == []
        robot.go_to(3)
        assert robot.step_until(lambda arrived: arrived)
    assert second.vehicle.height - first.vehicle.height == task.limits.vertical_m
    # the highest takes off first, and returns last
    up = [robot.autopilot.armed_at for robot in (first, second)]
    assert up[0] - up[1] == pytest.approx(task.limits.apart_s, abs=1.5)
    took = []
    for robot in (first, second):
        began = robot.link.now()
        assert robot.vehicle.bring_home(120)
        took.append(robot.link.now() - began)
    assert took[1] > took[0] + task.limits.apart_s - 2


def test_an_autopilot_that_is_neither_px4_nor_ardupilot_is_refused(task):
    robot = Robot(task)
    robot.autopilot.autopilot = 0
    (fault,) = robot.vehicle.prepare()
    assert fault.startswith("expected PX4 or ArduPilot, got a multirotor with MAV_AUTOPILOT 0")


def test_the_names_of_the_autopilots_are_known():
    assert {PX4, ARDUPILOT} == {*NUMBERS.values()}


@BOTH
def test_a_position_on_another_continent_is_none(task, autopilot):
    """It ended the program in flight, with one sentence and nothing else."""
    robot = Robot(task, autopilot)
    assert robot.vehicle.prepare() == []
    robot.go_to(len(task.cells) - 1)
    assert robot.step_until(lambda _: robot.vehicle.phase == FLIGHT)
    before = robot.vehicle.position.copy()
    message = dialect().MAVLink_global_position_int_message(0, 10**8, 0, 0, 30000, 0, 0, 0, 0)
    robot.vehicle._take(robot.vehicle.vehicle, message)
    assert (robot.vehicle.position == before).all()
    assert robot.vehicle.fault == ""


def test_two_polygons_around_the_cells_hold_together_or_each(task):
    """PX4 stays inside any of them, ArduPilot inside all."""
    west, east = fence_around(task), fence_around(task)
    middle = round((west[0].y + west[1].y) / 2)
    half = {True: (west, west[1].y), False: (east, west[0].y)}
    for items, border in half.values():
        items[:] = [
            MissionItem(
                item.frame,
                item.command,
                item.params,
                item.x,
                middle if item.y == border else item.y,
                0.0,
            )
            for item in items
        ]
    told = {}
    for autopilot in ("px4", "ardupilot"):
        robot = Robot(task, autopilot)
        robot.autopilot.stored[FENCE] = [*west, *east]
        told[autopilot] = robot.vehicle.prepare()
    assert told["px4"] == []
    assert [fault.partition(",")[0] for fault in told["ardupilot"]] == [
        "fence: expected a fence around all cells"
    ]


def test_a_fence_elsewhere_and_a_fence_of_two_corners_are_faults(task):
    robot = Robot(task)
    far = [MissionItem(0, FENCE_CORNERS[0], (3.0, 0.0, 0.0, 0.0), 5 * 10**8, 0, 0.0)] * 3
    robot.autopilot.stored[FENCE] = [*fence_around(task), *far]
    (fault,) = robot.vehicle.prepare()
    assert fault.startswith("fence: ")
    ring = fence_around(task)[:2]
    robot = Robot(task)
    robot.autopilot.stored[FENCE] = [
        MissionItem(0, FENCE_CORNERS[0], (2.0, 0.0, 0.0, 0.0), one.x, one.y, 0.0) for one in ring
    ]
    (fault,) = robot.vehicle.prepare()
    assert fault.startswith("fence: ")


def autopilot_heartbeats(system, since):
    """Return a stranger: another autopilot with a system id, which is switched on at a time."""
    messages = dialect()
    sender, last = messages.MAVLink(None, system, 1), [-1.0]

    def speak(now):
        if now < since or now - last[0] < 1.0:
            return []
        last[0] = now
        beat = messages.MAVLink_heartbeat_message(2, ARDUPILOT, 81, 0, 4, 3)
        return [bytes(beat.pack(sender))]

    return speak


def test_two_autopilots_with_one_system_id_are_refused(task):
    """Each is 1 as delivered: set-points went to the one that was heard last."""
    robot = Robot(task, "ardupilot")
    robot.strangers.append(autopilot_heartbeats(1, 0.0))
    with pytest.raises(LinkError, match="one autopilot with the system id 1 on simulated, got"):
        robot.vehicle.prepare()


def test_an_autopilot_that_is_switched_on_with_the_same_id_ends_the_flight(task):
    robot = Robot(task, "ardupilot")
    assert robot.vehicle.prepare() == []
    robot.go_to(len(task.cells) - 1)
    assert robot.step_until(lambda _: robot.vehicle.phase == FLIGHT)
    robot.strangers.append(autopilot_heartbeats(1, robot.link.now()))
    assert robot.step_until(lambda _: robot.vehicle.fault, 20.0)
    assert robot.vehicle.fault.startswith("autopilot: another one has the system id 1")
    robot.vehicle.secure()
    assert robot.vehicle._silent
