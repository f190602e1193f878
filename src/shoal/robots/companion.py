"""The program of a robot's companion computer: the agent of the search with a real vehicle, a real
radio, and its state on disk.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import reduce
from math import ceil, inf
from operator import or_
from pathlib import Path
from typing import Any

from shoal.core.dataclass import dataclass
from shoal.robots.guided import GuidedVehicle
from shoal.robots.journal import Journal
from shoal.robots.right_of_way import RadioSensor
from shoal.robots.tasks import RobotTask
from shoal.search.protocol.messages import LONGEST, Beacon, Heartbeat, Sender
from shoal.search.protocol.robot import RELAYED
from shoal.search.protocol.state import Event
from shoal.search.simulation.live.agent import Agent
from shoal.search.simulation.live.ports import Radio
from shoal.search.simulation.live.vehicle import PointVehicle
from shoal.search.simulation.scenario import Scenario

_TOLD = 10.0  # seconds between two lines that tell the operator how the robot is
_HELLO_BEATS = 4  # time of listening: the eight first beacons say half as much
_LANDING = 300.0  # seconds after a robot's turn within which its vehicle must be down


@dataclass
class CompanionResult:
    """What came of a robot's part of a search.

    Parameters
    ----------
    robot : int
    complete : bool
        Whether the robot knows that everything is searched, and has told so.
    status, fault : str
        Its last status, and why it gave up.
    landed : bool
        Whether its vehicle is on the ground.
    searched : int
        Number of cells that it has searched.
    cells : int
        Number of all cells.
    counts : tuple of int
        Numbers of messages sent, heard, lost and refused.
    refused : mapping of str to int
        Numbers of refused messages by reason.
    broken : int
        Number of frames that came so broken that the radio could not repair them.
    """

    robot: int
    complete: bool
    status: str
    fault: str
    landed: bool
    searched: int
    cells: int
    counts: tuple[int, int, int, int]
    refused: dict[str, int]
    broken: int = 0

    def report(self) -> dict[str, Any]:
        """Return the result as a mapping for JSON."""
        names = ("sent", "heard", "lost", "refused")
        fields = {name: value for name, value in vars(self).items() if name != "counts"}
        messages = dict(zip(names, self.counts, strict=True))
        messages |= {
            "refused_by_reason": fields.pop("refused"),
            "broken_frames": fields.pop("broken"),
        }
        return fields | {"messages": messages}


def journal_path(folder: Path, number: int) -> Path:
    """Return the path of a robot's state in a folder."""
    return folder / f"robot-{number:02}.journal"


def beacon_bytes(scenario: Scenario, most: int) -> int:
    """Return the number of bytes, in messages of at most ``most`` bytes each, of a robot's beacon
    in the middle of a search.
    """
    robots = len(scenario.starts)
    heartbeats = [
        Heartbeat(number, 1000, start, rate, "searching", width=width, place=start, lag=10.0)
        for number, (start, rate, width) in enumerate(
            zip(scenario.starts, scenario.rates, scenario.widths, strict=True), 1
        )
    ]
    beacon_heartbeats = heartbeats[: 1 + max(RELAYED, ceil((robots - 1) / 4))]
    searched = tuple((heartbeat.robot, 0b11 << heartbeat.start) for heartbeat in heartbeats)
    sender = Sender(1, b"a key", most)
    return len(sender.messages(Beacon(1, tuple(beacon_heartbeats), searched), 0)) * most


def _limit_beacons(scenario: Scenario, radio: Radio, speed: float) -> Scenario:
    """Return a scenario whose robots send no more than the radio can. All robots of a search have
    the same kind of radio.
    """
    if radio.rate == inf:
        return scenario
    most = min(scenario.packet or LONGEST, radio.most)
    brief, beat = scenario.brief, beacon_bytes(scenario, most) / radio.rate * speed
    hello = max(brief.hello, _HELLO_BEATS * beat)
    return replace(scenario, brief=replace(brief, beat=max(brief.beat, beat), hello=hello))


class Companion:
    """A robot that searches.

    Parameters
    ----------
    task : RobotTask
    number : int
        Number of the robot.
    radio : Radio
    journal : Journal
        Its state on disk. If the journal has events, the robot goes on after them.
    vehicle : GuidedVehicle, optional
        By default, a moving point.
    loss : float
        Share of the messages that the robot discards, for rehearsals.
    speed_up : float
        Number of seconds that pass in a second, for rehearsals.
    clock : callable, optional
        Function that returns the time in seconds, as the journal counts, if it passes unevenly.
    """

    def __init__(
        self,
        task: RobotTask,
        number: int,
        radio: Radio,
        journal: Journal,
        vehicle: GuidedVehicle | None = None,
        *,
        loss: float = 0.0,
        speed_up: float = 1.0,
        clock: Callable[[], float] | None = None,
    ) -> None:
        live = task.live(number, loss=loss)
        live = replace(live, speed=live.speed * speed_up)
        live = replace(live, scenario=_limit_beacons(live.scenario, radio, live.speed))
        self._clock = clock
        self.task, self.vehicle, self._journal = task, vehicle, journal
        # The computer's time of day may jump when it finds the right one. It counts once, at the
        # start, and never sets a robot back.
        last = journal.events[-1].time / live.speed if journal.events else 0.0
        self._begun = max(time.time() - journal.epoch, last) - time.monotonic()
        self._say: Callable[[str], None] = lambda _text: None
        self._next_told, self._told_fault = time.monotonic() + _TOLD, False
        robot = journal.replay(live.robot(number), self._now(live.speed))
        if vehicle is not None and journal.events:
            vehicle.takes_turns = False  # the others are up, or on the ground again
        start = tuple(float(x) for x in robot.brief.tour_cost.points[robot.start])
        self.agent = Agent(
            live,
            robot,
            live.messenger(number, radio),
            vehicle or PointVehicle(start, lambda _time: robot.rate),
            RadioSensor(
                live.scenario,
                lambda: self.agent.robot,
                lambda: self._now(live.speed),
                restarted=bool(journal.events),
            ),
            clock=lambda: self._now(live.speed),
            tell=journal.report,
            record=self._record,
            pause=self._tell,
        )

    def _now(self, speed: float) -> float:
        """Return the time in cells since the robot was first switched on, as its journal counts."""
        if self._clock is not None:
            return (self._clock() - self._journal.epoch) * self.task.speed
        return (self._begun + time.monotonic()) * speed

    def _record(self, event: Event) -> None:
        self._journal.record(event)
        self.agent.sensor.note(event)  # type: ignore[attr-defined]

    def _tell(self) -> None:
        """Tell the operator from time to time how the robot is."""
        if self._journal.fault and not self._told_fault:
            self._told_fault = True
            self._say(
                f"{self._journal.path}: {self._journal.fault}; a program that is started again"
                " begins from here"
            )
        now = time.monotonic()
        if now >= self._next_told:
            self._next_told = now + _TOLD
            self._say(self.status_text)

    @property
    def status_text(self) -> str:
        """What the robot does, and its messages so far, in one line."""
        robot, messenger = self.agent.robot, self.agent.messenger
        searched = reduce(or_, robot.searched.values(), 0).bit_count()
        sent, heard, lost, refused = messenger.counts
        why = ", ".join(f"{count} {reason}" for reason, count in sorted(messenger.refused.items()))
        broken = f"; {self.broken} frames beyond repair" if self.broken else ""
        return (
            f"{robot.status}, knows {searched} of {len(self.task.cells)} cells as searched,"
            f" {robot.mine.bit_count()} by itself; messages: {sent} sent, {heard} heard, {lost} lost,"
            f" {refused} refused{f' ({why})' if why else ''}{broken}"
        )

    @property
    def broken(self) -> int:
        """Number of frames that came so broken that the radio could not repair them."""
        return getattr(self.agent.messenger.radio, "broken", 0)

    def run(self, say: Callable[[str], None] = lambda _text: None) -> CompanionResult:
        """Search until all cells are searched and reported, and bring the vehicle home. After
        Ctrl-C, bring it home at once.
        """
        complete, self._say = False, say
        if self.agent.robot.brief.beat > self.task.scenario.brief.beat:
            seconds = self.agent.robot.brief.beat / self.task.speed
            say(f"a beacon every {seconds:.3g} s, because the radio can send no more")
        try:
            complete = self.agent.run()
        except KeyboardInterrupt:
            say("interrupted: the vehicle returns")
            if self.vehicle is not None:
                self.vehicle.fault = self.vehicle.fault or "interrupted by the operator"
                self.vehicle.secure()
            self.agent.fault = "interrupted by the operator"
            self.agent.report("fault", reason=self.agent.fault)
        landed = self.vehicle is None or self.vehicle.bring_home(_LANDING)
        if landed and self.vehicle is not None:
            self.agent.report("landed")
        fault = self.agent.fault or ("" if self.vehicle is None else self.vehicle.fault)
        if not landed and not fault:
            fault = f"the vehicle did not land within {_LANDING:g} s"
        if fault:
            say(f"gave up: {fault}")
        robot, messenger = self.agent.robot, self.agent.messenger
        return CompanionResult(
            robot.number,
            complete,
            robot.status,
            fault,
            landed,
            robot.mine.bit_count(),
            len(self.task.cells),
            messenger.counts,
            dict(messenger.refused),
            self.broken,
        )
