"""A search rehearsed on one computer: each robot is the process that will run on its companion
computer, with an autopilot of its own that is simulated and speaks MAVLink over UDP.

The rehearsal runs the autopilots, reads what the robots write, lets things happen to both, and
judges by the robots' logs and by the positions of the simulated vehicles, which no robot knows.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import field
from itertools import combinations
from pathlib import Path
from typing import Any, Literal
from zlib import crc32

import numpy as np

from shoal.core.checks import check_function
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, ShoalError
from shoal.robots.clock import SharedClock
from shoal.robots.mavlink import AUTOPILOTS, Station, open_link
from shoal.robots.mission_protocol import FENCE, FENCE_CORNERS, MissionItem
from shoal.robots.onboard import Seat, pair, read_cargos
from shoal.robots.records import RobotRecord, SearchRecord, search_record
from shoal.robots.settings import safe_parameters
from shoal.robots.simulated import SimulatedLink, SimulatedVehicle
from shoal.robots.stranger import Stranger
from shoal.robots.tasks import MISSIONS, RobotTask
from shoal.robots.uploading import upload_missions

_STEP = 0.05  # seconds of simulated time between two steps of the autopilots
_LOOK = 0.25  # seconds between two looks at the robots
_LANDING = 300.0  # simulated seconds within which vehicles are down when all programs have ended
_SLACK = 300.0, 6.0  # time limit: simulated seconds, and times what the plan takes
_ENDLESS = 24 * 3600.0  # seconds that the battery of a vehicle without endurance lasts
_SPEED, _ACCELERATION = 5.0, 2.0  # m/s and m/s² of a vehicle that does not say its own
_CLOCK = "clock"  # file of the simulated time
_MOST_AT_ONCE = 0.1  # simulated seconds by which time goes on at once
_BEHIND = 1.5  # simulated seconds without a sign of a robot's program, in which time waits for it
_PATIENCE = 3.0  # seconds for which time waits
_LATE = 3.0  # simulated seconds without a sign of a program that goes on
_NUMBERS = {name.lower(): number for number, name in AUTOPILOTS.items()}
_QUIET = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}

What = Literal["kill", "restart", "silence", "blind"]


@dataclass(frozen=True)
class Happening:
    """Something that happens in a rehearsal.

    Parameters
    ----------
    at : float
        Fraction of the cells that are searched when it happens.
    what : str
        "kill" ends the robot's program with SIGKILL, "restart" starts it again from its state on
        disk, "silence" lets the autopilot send nothing any more, and "blind" takes its position.
    robot : int
        Number of the robot.
    """

    at: float
    what: What
    robot: int


@dataclass
class RehearsalResult:
    """What came of one run of a rehearsal.

    Parameters
    ----------
    name : str
    happened : list of mapping
        What happened when: "what", "robot" and "time_s".
    record : SearchRecord
    robots : list of mapping
        For each robot the "robot", the "status" it reported last, the "exit" code of its program,
        its "fault", and the numbers of messages that it "sent", "heard", "lost" and "refused".
    wall_s : float
        Duration in real seconds.
    late_s : float
        Largest time without a sign of a robot's program that went on, in simulated seconds, beyond
        what the rehearsal has waited for.
    timed_out : bool
    stranger : mapping of str to int
        Numbers of packets that a stranger has sent.
    crowded : list of str
        Sentences about robots that start, and land, too near to each other.
    """

    name: str
    happened: list[dict[str, Any]]
    record: SearchRecord
    robots: list[dict[str, Any]]
    wall_s: float
    late_s: float
    timed_out: bool
    stranger: dict[str, int]
    crowded: list[str]

    @property
    def late(self) -> bool:
        """Whether this computer was too slow for the rehearsal to tell anything."""
        return self.late_s > _LATE

    @property
    def faults(self) -> list[str]:
        """What was not as it should be, a sentence each."""
        faults = [*self.record.faults, *self.crowded]
        hit = {event["robot"] for event in self.happened}
        faults += [
            f"robot {robot['robot']}:"
            f" {robot['fault'] or 'its program ended with ' + str(robot['exit'])}"
            for robot in self.robots
            if robot["robot"] not in hit and (robot["fault"] or robot["exit"] != 0)
        ]
        if self.timed_out:
            faults.append("the search did not end in time")
        if self.late:
            faults.append(
                f"this computer was {self.late_s:.1f} s late: rehearse again with a smaller"
                " --speed-up"
            )
        return faults

    def report(self) -> dict[str, Any]:
        """Return the run as a mapping for JSON."""
        fields = {name: value for name, value in vars(self).items() if name != "record"}
        return fields | self.record.report() | {"faults": self.faults, "passed": not self.faults}


@dataclass
class _Robot:
    """The process of a robot, and what it has written."""

    number: int
    vehicle: SimulatedVehicle
    link: Any
    command: list[str]
    journal: Path
    output: Path
    process: subprocess.Popen[bytes] | None = None
    reports: list[dict[str, Any]] = field(default_factory=list)
    epoch: float = 0.0
    offset: int = 0
    heard: float | None = None  # when its program last spoke to its autopilot
    exit: int | None = None


class Rehearsal:
    """A rehearsal of a prepared search.

    Parameters
    ----------
    task : RobotTask
    folder : Path
        Folder for the robots' states and outputs.
    loss : float, optional
        Share of the messages that each radio loses; by default, that of the task.
    speed_up : float
        Number of simulated seconds in a second.
    autopilot : "px4" or "ardupilot"
    parameters : mapping of str to float
        Parameters of the autopilots that differ from safe ones.

    Raises
    ------
    InvalidInputError
        If vehicles of the task cannot be rehearsed.
    """

    def __init__(
        self,
        task: RobotTask,
        folder: Path,
        *,
        loss: float | None = None,
        speed_up: float = 4.0,
        autopilot: str = "px4",
        parameters: Mapping[str, float] | None = None,
    ) -> None:
        if task.kind not in ("multirotor", "rover"):
            raise InvalidInputError(
                f"{task.path}: expected vehicles that can stand still (multirotor or rover), got"
                f" {task.kind}"
            )
        self.task, self.folder = task, folder
        self.loss = task.loss if loss is None else loss
        self.speed_up, self.autopilot = speed_up, autopilot
        self.parameters = dict(parameters or {})
        self.numbers = range(1, len(task.scenario.starts) + 1)
        self.addresses: dict[int, tuple[str, int]] = {}  # of the robots' radios
        self.ear = ("", 0)  # an address that hears all messages, too

    # -- what the robots have ------------------------------------------------------------------

    def vehicles(self) -> dict[int, SimulatedVehicle]:
        """Return a vehicle for each robot, with its missions, its fence and safe parameters on
        board.
        """
        task = self.task
        plan, vehicle_data = task.plan, task.plan.vehicle
        homes = task.frame.to_degrees(plan.places)
        vehicles = {}
        for number in self.numbers:
            parameters = safe_parameters(_NUMBERS[self.autopilot], task.kind, task.height(number))
            vehicles[number] = SimulatedVehicle(
                number,
                kind=task.kind,
                autopilot=self.autopilot,
                home=tuple(homes[number - 1].tolist()),
                speed=vehicle_data.cruise_speed or _SPEED,
                acceleration=vehicle_data.acceleration or _ACCELERATION,
                battery=_ENDLESS if vehicle_data.endurance is None else 60 * vehicle_data.endurance,
                parameters=parameters | self.parameters,
            )
        missions = task.path.parent / MISSIONS
        if missions.is_dir():
            self._upload(vehicles, missions)
        else:
            for vehicle in vehicles.values():
                vehicle.stored[FENCE] = self._fence()
        return vehicles

    def _upload(self, vehicles: Mapping[int, SimulatedVehicle], missions: Path) -> None:
        """Upload the fall-back missions as an operator does."""
        cargos = read_cargos(missions)
        seats = {number: Seat(number, number) for number in cargos}
        link = SimulatedLink([*vehicles.values()], at_once=len(vehicles))
        for delivery in upload_missions(pair(cargos, seats), [Station(link)]):
            if delivery.status != "equal":
                raise ShoalError(f"rehearsal: {delivery.sentence}")
        for vehicle in vehicles.values():
            vehicle.forget_time()

    def _fence(self) -> list[MissionItem]:
        """Return a fence around the region, and around launch points outside of it."""
        import shapely

        region = self.task.plan.grid.region
        around = shapely.union_all([region.outline, *map(shapely.Point, self.task.plan.places)])
        ring = around.convex_hull.buffer(self.task.plan.grid.size, join_style="mitre").exterior
        corners = self.task.frame.to_degrees(np.array(ring.coords[:-1])).tolist()
        return [
            MissionItem(
                0,
                FENCE_CORNERS[0],
                (float(len(corners)), 0.0, 0.0, 0.0),
                round(1e7 * latitude),
                round(1e7 * longitude),
                0.0,
            )
            for longitude, latitude in corners
        ]

    # -- a run ----------------------------------------------------------------------------------

    def run(
        self,
        name: str,
        happenings: Sequence[Happening] = (),
        *,
        on_progress: Callable[[float, float], None] = lambda _fraction, _seconds: None,
        on_event: Callable[[str], None] = lambda _text: None,
        stranger: bool = False,
        seed: int = 0,
    ) -> RehearsalResult:
        """Run the search once, from the take-off to the last landing.

        Parameters
        ----------
        name : str
            Name of the run, and of its folder.
        happenings : sequence of Happening
        on_progress : callable
            Function that receives the fraction of cells searched and the simulated seconds.
        on_event : callable
            Function that receives a sentence about what happens.
        stranger : bool
            Whether a `Stranger` sends packets to the robots several times a second.
        seed : int
            Seed of the stranger.
        """
        check_function(on_progress, what="on_progress", optional=False)
        check_function(on_event, what="on_event", optional=False)
        with ExitStack() as stack:
            run = _Run(self, name, happenings, stack)
            if stranger:
                robots = [*self.addresses.values()]
                run.stranger = stack.enter_context(
                    Stranger(self.ear, robots, len(self.task.cells), seed=seed)
                )
            run.go_on(on_progress, on_event)
            return run.result()

    def command(self, number: int, link: str, state: Path) -> list[str]:
        """Return the command of a robot's program."""
        own = self.addresses[number]
        others = [self.addresses[other] for other in self.numbers if other != number]
        radio = ",".join(f"{host}:{port}" for host, port in [own, *others, self.ear])
        return [
            sys.executable,
            "-m",
            "shoal",
            "robot",
            str(self.task.path),
            "--id",
            str(number),
            "--radio",
            f"udp:{radio}",
            "--vehicle",
            f"mavlink:{link}",
            "--state",
            str(state),
            "--arm",
            "--loss",
            str(self.loss),
            "--speed-up",
            str(self.speed_up),
            "--clock",
            str(state / _CLOCK),
        ]


class _Run:
    """One run: the autopilots, the processes, and what they have written."""

    def __init__(
        self, rehearsal: Rehearsal, name: str, happenings: Sequence[Happening], stack: ExitStack
    ) -> None:
        self.rehearsal, self.task, self.name = rehearsal, rehearsal.task, name
        self.waiting = sorted(happenings, key=lambda happening: happening.at)
        self.happened: list[dict[str, Any]] = []
        home = rehearsal.folder / name
        shutil.rmtree(home, ignore_errors=True)
        home.mkdir(parents=True)
        vehicles = rehearsal.vehicles()
        ports = _free_ports(2 * len(vehicles) + 1)
        rehearsal.ear = _address(0), ports.pop()
        rehearsal.addresses = {
            number: (_address(number), ports.pop()) for number in rehearsal.numbers
        }
        self.robots: dict[int, _Robot] = {}
        for number, vehicle in vehicles.items():
            port = ports.pop()
            link = open_link(f"udpout:{_address(number)}:{port}")
            stack.callback(link.close)
            command = rehearsal.command(number, f"udpin:{_address(number)}:{port}", home)
            journal, output = home / f"robot-{number:02}.journal", home / f"robot-{number:02}.txt"
            self.robots[number] = _Robot(number, vehicle, link, command, journal, output)
        self.begin, self.now = time.monotonic(), 0.0
        self.clock = SharedClock.create(home / _CLOCK)
        stack.callback(self.clock.close)
        self._held_since: float | None = None
        self.late, self.timed_out = 0.0, False
        self._ended_at: float | None = None
        self.stranger: Stranger | None = None
        stack.callback(self._end)
        for robot in self.robots.values():
            self._start(robot)

    def _start(self, robot: _Robot) -> None:
        robot.heard = None
        package = str(Path(__file__).parents[2])
        path = os.pathsep.join(filter(None, [package, os.environ.get("PYTHONPATH", "")]))
        with robot.output.open("ab") as output:
            robot.process = subprocess.Popen(
                robot.command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=output,
                process_group=0,  # Ctrl-C reaches the rehearsal, which ends the processes
                env={**os.environ, **_QUIET, "PYTHONPATH": path},
            )

    def _end(self) -> None:
        for robot in self.robots.values():
            if robot.process is not None and robot.process.poll() is None:
                robot.process.kill()
        for robot in self.robots.values():
            if robot.process is not None:
                robot.process.wait()

    def go_on(
        self,
        on_progress: Callable[[float, float], None],
        on_event: Callable[[str], None],
    ) -> None:
        """Let the autopilots live, and look at the robots, until all have landed."""
        factor, last, look = self.rehearsal.speed_up, time.monotonic(), 0.0
        plan = self.task.plan
        limit = _SLACK[0] + _SLACK[1] * plan.cell_seconds * len(self.task.cells)
        while True:
            moment = time.monotonic()
            if self._may_go_on(moment):
                self.now += min((moment - last) * factor, _MOST_AT_ONCE)
                self.clock.set(self.now)
            last = moment
            for robot in self.robots.values():
                for data, _ in robot.link.receive(0.0):
                    robot.vehicle.take(data, self.now)
                    robot.heard = self.now
                for data in robot.vehicle.step(self.now):
                    robot.link.send(data)
            if moment >= look:
                look = moment + _LOOK
                self._look(on_event)
                if self.stranger is not None:
                    self.stranger.speak()
                on_progress(self.fraction, self.now)
                if self._has_ended(self.now):
                    return
                if self.now > limit:
                    self.timed_out = True
                    return
            time.sleep(max(0.0, _STEP / factor - (time.monotonic() - moment)))

    def _may_go_on(self, moment: float) -> bool:
        """Return whether time may pass: not while a robot's program is behind, which speaks to its
        autopilot at least once a second. A program that is silent for long is taken as it is.
        """
        behind = max((self._lag(robot) for robot in self.robots.values()), default=0.0)
        if behind <= _BEHIND:
            self._held_since = None
            return True
        if self._held_since is None:
            self._held_since = moment
        if moment - self._held_since < _PATIENCE:
            return False
        self.late = max(self.late, behind)
        return True

    def _lag(self, robot: _Robot) -> float:
        """Return the simulated seconds for which nothing has come from a program that goes on."""
        gave_up = any(report["kind"] == "fault" for report in robot.reports)
        if robot.process is None or robot.heard is None or gave_up:
            return 0.0
        return self.now - robot.heard

    @property
    def fraction(self) -> float:
        """Fraction of the cells that robots have reported as searched."""
        cells = {
            cell
            for robot in self.robots.values()
            for report in robot.reports
            if report["kind"] == "searched"
            for cell in (report["cell"], *report.get("around", ()))
        }
        return len(cells) / len(self.task.cells)

    def _look(self, on_event: Callable[[str], None]) -> None:
        for robot in self.robots.values():
            self._read(robot)
            if robot.process is not None and (code := robot.process.poll()) is not None:
                robot.exit, robot.process = code, None
            self._change_battery(robot)
        while self.waiting and self.fraction >= self.waiting[0].at:
            self._apply(self.waiting.pop(0), on_event)

    def _change_battery(self, robot: _Robot) -> None:
        """Change the battery of a vehicle that has landed to search on, as the operator does."""
        kinds = [report["kind"] for report in robot.reports]
        if "home" in kinds and not robot.vehicle.armed:
            robot.vehicle.charge = 1.0

    def _apply(self, happening: Happening, on_event: Callable[[str], None]) -> None:
        robot = self.robots[happening.robot]
        text = {
            "kill": f"robot {happening.robot}: its program is killed",
            "restart": f"robot {happening.robot}: its program is started again",
            "silence": f"robot {happening.robot}: its autopilot falls silent",
            "blind": f"robot {happening.robot}: its autopilot has lost its position",
        }[happening.what]
        if happening.what == "kill":
            if robot.process is not None:
                with suppress(ProcessLookupError):
                    os.kill(robot.process.pid, signal.SIGKILL)
                robot.exit, robot.process = robot.process.wait(), None
            self._read(robot)
            robot.reports.append({"kind": "ended", "time": self.now})
        elif happening.what == "restart":
            self._start(robot)
        elif happening.what == "silence":
            robot.vehicle.silent = True
        else:
            robot.vehicle.lost_position = True
        self.happened.append(
            {"what": happening.what, "robot": happening.robot, "time_s": round(self.now, 1)}
        )
        on_event(f"{text} ({100 * self.fraction:.0f} % searched)")

    def _read(self, robot: _Robot) -> None:
        """Read what a robot has written to its journal since the last time."""
        try:
            with robot.journal.open("rb") as file:
                file.seek(robot.offset)
                data = file.read()
        except FileNotFoundError:
            return
        whole = data[: data.rfind(b"\n") + 1]
        robot.offset += len(whole)
        for line in whole.splitlines():
            checksum, _, text = line.partition(b" ")
            if checksum != b"%08x" % crc32(text):
                continue  # half written when the program was killed
            entry = json.loads(text)
            if "epoch" in entry:
                robot.epoch = entry["epoch"]
            elif "kind" in entry:
                robot.reports.append(entry | {"time": self._seconds(robot, entry["time"])})

    def _seconds(self, robot: _Robot, time_: float) -> float:
        """Return the simulated seconds of a robot's time, which counts cells since its start."""
        return robot.epoch + time_ / self.task.speed

    def _has_ended(self, now: float) -> bool:
        """Whether all programs have ended, and all vehicles are down or will never be."""
        if any(robot.process is not None for robot in self.robots.values()) or self.waiting:
            if not any(robot.process is not None for robot in self.robots.values()):
                self.waiting.clear()  # nobody is left to whom it could happen
            self._ended_at = None
            return False
        if all(not robot.vehicle.armed for robot in self.robots.values()):
            return True
        if self._ended_at is None:
            self._ended_at = now
        return now - self._ended_at > _LANDING

    def result(self) -> RehearsalResult:
        """Return what came of the run."""
        records, reports = [], []
        for robot in self.robots.values():
            vehicle = robot.vehicle
            track = np.array(vehicle.track, dtype=np.float64).reshape(-1, 5)
            places = self._in_region(vehicle, track[:, 1:4])
            records.append(
                RobotRecord(
                    robot.number,
                    robot.reports,
                    track[:, 0],
                    places,
                    track[:, 4] > 0,
                    vehicle.armed,
                    vehicle.charge,
                    vehicle.breaches,
                )
            )
            reports.append(self._robot_report(robot))
        record = search_record(self.task, records)
        wall = round(time.monotonic() - self.begin, 1)
        return RehearsalResult(
            self.name,
            self.happened,
            record,
            reports,
            wall,
            round(self.late, 2),
            self.timed_out,
            {} if self.stranger is None else dict(self.stranger.sent),
            _launch_conflicts(self.task),
        )

    def _in_region(self, vehicle: SimulatedVehicle, places: Any) -> Any:
        """Return positions in metres from the vehicle's home as metres in the region's frame."""
        degrees = vehicle.frame.to_degrees(places[:, :2])
        return np.column_stack([self.task.frame.to_metres(degrees), places[:, 2]])

    def _robot_report(self, robot: _Robot) -> dict[str, Any]:
        status = next(
            (
                report["kind"]
                for report in reversed(robot.reports)
                if report["kind"] in ("listening", "searching", "waiting", "complete")
            ),
            "not started",
        )
        fault = next(
            (report["reason"] for report in robot.reports if report["kind"] == "fault"), ""
        )
        counts = next(
            (report["counts"] for report in reversed(robot.reports) if "counts" in report),
            (0, 0, 0, 0),
        )
        names = ("sent", "heard", "lost", "refused")
        return {
            "robot": robot.number,
            "status": status,
            "exit": robot.exit,
            "fault": fault,
            **dict(zip(names, counts, strict=True)),
        }


def _launch_conflicts(task: RobotTask) -> list[str]:
    """Return a sentence for each two robots whose launch points are too near to each other."""
    least, places = task.limits.horizontal_m, task.plan.places
    return [
        f"robots {robot + 1} and {other + 1} start"
        f" {np.linalg.norm(places[robot] - places[other]):.1f} m from each other; expected at least"
        f" {least:g} m"
        for robot, other in combinations(range(len(places)), 2)
        if np.linalg.norm(places[robot] - places[other]) < least
    ]


def _address(number: int) -> str:
    """Return a loopback address of a robot's own, where the system has several."""
    return f"127.0.1.{number + 1}" if sys.platform == "linux" and number < 255 else "127.0.0.1"


def _free_ports(count: int) -> list[int]:
    """Return ports that are free at the moment on all loopback addresses."""
    with ExitStack() as stack:
        ports = []
        for _ in range(count):
            probe = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            probe.bind(("", 0))
            ports.append(int(probe.getsockname()[1]))
        return ports
