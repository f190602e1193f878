"""The supervisor of a live search starts robots, kills the robots that are to crash, records
reports, and ends all processes.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import secrets
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import field, replace
from math import inf
from typing import Any, Literal, get_args

import numpy as np

from shoal.core.checks import check_function, check_integer, count_text
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.notices import tell_once
from shoal.search.allocation.allocate import partition
from shoal.search.problem.network import Crash, Slow
from shoal.search.protocol.messages import LONGEST, SHORTEST, Status
from shoal.search.protocol.state import Brief
from shoal.search.simulation.live.process import Member, ProcessPool, Report
from shoal.search.simulation.live.radio import LARGEST, Channel, LiveTask, reserve
from shoal.search.simulation.scenario import Scenario
from shoal.search.simulation.trace import RobotLog, SearchTrace, search_times
from shoal.search.tours.masks import at_least, bitset_of


@dataclass(frozen=True, slots=True)
class LiveEvent:
    """An event that a robot reported, or an event that the supervisor caused.

    Parameters
    ----------
    time : float
        Time of the event, in units of the time in which a robot of speed 1 searches one cell.
    robot : int
        Number of the robot.
    kind : str
        The robot's new status ("listening", "searching", "waiting" or "complete"), or an event.
        Events with a cell are "enters", "leaves", "searched", "blocked" (by another robot) and
        "obstructed". Events without a cell are "home", "recharged" and "declared". The supervisor
        adds the events "killed", "stopped" (at the time limit) and "failed" (with a reason).
    cell : int or None
        Tour index of the cell of the event.
    found : bool
        Whether the robot found something in the cell.
    place : tuple of float
        Position of the robot in cell sides, as in `TourCost.points`. For an event by the
        supervisor, the position is an empty tuple.
    reason : str
        For an event "failed", the reason for which the process failed.
    through : tuple of int
        The cells that the robot has passed since its last search, if robots move from cell to cell.
    around : tuple of int
        The cells around ``cell`` that the robot also sees, because its footprint is wider than one
        cell.
    beside : tuple of int
        The cells of ``around`` in which the robot found something.
    """

    time: float
    robot: int
    kind: str
    cell: int | None = None
    found: bool = False
    place: tuple[float, ...] = ()
    reason: str = ""
    through: tuple[int, ...] = ()
    around: tuple[int, ...] = ()
    beside: tuple[int, ...] = ()


@dataclass(frozen=True)
class LiveOutcome:
    """The result of a live search.

    Parameters
    ----------
    complete : bool
        Whether robots really searched every reachable cell, and all surviving robots (at least one)
        declared completion.
    covered : float
        Fraction of the reachable cells that robots really searched.
    declared, killed : dict of int to float
        Time at which each robot declared completion, and time at which the supervisor killed each
        crashed robot.
    failed : dict of int to str
        Reason for which the process of a robot ended too early: a program error, or a kill from
        outside.
    sent, heard, lost, dropped : int
        Numbers of messages that were sent, received, lost and dropped, in total for all robots.
        Robots drop a message if it comes from no robot of the search or contains impossible values.
        Messages that a killed robot sends after its last report do not count.
    channel : str
        Channel of the messages: "multicast" or "unicast".
    port : int
        Port of the multicast group, or 0 with unicast.
    startup, seconds : float
        Duration of the start of all processes, and duration of the search after this start, in
        seconds.
    timed_out : bool
        Whether the search reached its time limit.
    events : tuple of LiveEvent
        All events of the search, sorted by time.
    """

    complete: bool
    covered: float
    declared: dict[int, float]
    killed: dict[int, float]
    failed: dict[int, str]
    sent: int
    heard: int
    lost: int
    dropped: int
    channel: str
    port: int
    startup: float
    seconds: float
    timed_out: bool
    events: tuple[LiveEvent, ...] = field(repr=False)


def searched_by(events: Sequence[LiveEvent]) -> dict[int, int]:
    """Return a bitset of the cells that each robot really searched, by the number of the robot.

    Examples
    --------
    >>> searched_by([LiveEvent(1.0, 7, "searched", 2), LiveEvent(2.0, 7, "searched", 3)])
    {7: 12}
    """
    searched: dict[int, int] = {}
    for event in events:
        if event.kind == "searched" and event.cell is not None:
            searched[event.robot] = searched.get(event.robot, 0) | bitset_of(
                (event.cell, *event.around)
            )
    return searched


def covered_share(events: Sequence[LiveEvent], goal: int) -> float:
    """Return the fraction of the cells in the bitset ``goal`` that robots really searched."""
    return (at_least(list(searched_by(events).values()), 1) & goal).bit_count() / goal.bit_count()


_STARTUP = 120.0  # seconds
_AHEAD = 0.1  # seconds from the order to start until the start, so that all robots start at once
_LAST = ("declared", "killed", "stopped", "failed")  # events after which a process may end
# time limit: seconds, plus this multiple of the time that one robot needs for the whole search
_SLACK = 60.0, 10.0


def run_live(
    scenario: Scenario,
    *,
    speed: float = 10.0,
    channel: Literal["auto", "multicast", "unicast"] = "auto",
    port: int = 0,
    key: bytes = b"",
    timeout: float | None = None,
    on_event: Callable[[LiveEvent], None] | None = None,
) -> LiveOutcome:
    """Run a search in real time, with one process for each robot and messages over UDP.

    Parameters
    ----------
    scenario : Scenario
        The search. The supervisor sends SIGKILL to the process of a robot that is to crash. Each
        radio discards received messages with the probability of the network model ``loss``. If
        ``brief.hello`` is ``0.3 * speed`` or more, robots listen for at least 0.3 s, and find each
        other even on a busy machine. With a ``brief.hello`` below ``0.3 * speed``, the search may
        take longer, but is still complete.
    speed : float
        Number of cells that a robot of speed 1 searches per second of real time.
    channel : str
        Channel of the messages: "multicast", "unicast" or "auto". With "unicast", a robot sends
        each message to the port of every other robot. With "auto", robots use unicast only if
        multicast is not available.
    port : int
        Port of the multicast group 239.83.72.76, or 0 for a free port.
    key : bytes
        Secret of the search. The secret, the tour and the start cells together determine the key
        that signs messages. By default, Shoal creates a new random secret.
    timeout : float, optional
        Time limit in seconds after the start of the search, at which the supervisor kills all
        running processes.
    on_event : callable, optional
        Function that the supervisor calls with each `LiveEvent` when the event arrives. An
        exception in ``on_event`` ends the search.

    Raises
    ------
    InvalidInputError
        If an option is out of range, or if the scenario has faults or network models that a live
        search does not support. A live search supports crashes, slow robots and the network model
        ``loss``.
    ShoalError
        If the supervisor cannot start a process.

    Notes
    -----
    When the search ends, no process, socket or file remains, even after an exception or Ctrl-C. If
    somebody kills the calling process, the robots notice and end. The order of messages depends on
    the operating system, so two runs always differ.

    Examples
    --------
    >>> from shoal.search import TourCost, make_tour
    >>> from shoal.search.protocol.robot import Brief
    >>> scenario = Scenario(Brief(TourCost(make_tour("moore", (4, 4)))), (0, 8))
    >>> outcome = run_live(scenario, speed=50.0)
    >>> outcome.complete, outcome.covered, sorted(outcome.declared)
    (True, 1.0, [1, 2])
    """
    check_function(on_event, what="on_event")
    _check(scenario, speed=speed, port=port)
    brief = scenario.brief
    # compiled once, not in each process
    partition(brief.tour_cost, brief.allocator, ((1, scenario.starts[0], 1.0, 1),))
    if timeout is None:
        slowest = min(scenario.rates) / max(
            [1.0, *(fault.factor for fault in scenario.faults if isinstance(fault, Slow))]
        )
        timeout = _SLACK[0] + _SLACK[1] * brief.tour_cost.whole / slowest / speed
    with ExitStack() as stack:
        used, port = _reserve_channel(channel, port, stack)
        task = LiveTask(scenario, speed, used, port, _key_of(brief, scenario.starts, key))
        began = time.monotonic()
        with ProcessPool(task) as pool:
            pool.wait_ready(_STARTUP)
            return _Watch(pool, task, on_event, time.monotonic() - began).run(timeout)


def _check(scenario: Scenario, *, speed: float, port: int) -> None:
    if os.name != "posix":
        raise InvalidInputError(
            f"live search: expected a POSIX system (Linux, macOS), got {os.name}"
        )
    if not 0 < speed < inf:
        raise InvalidInputError(f"speed: expected cells a second, above 0, got {speed!r}")
    for fault in scenario.faults:
        if not isinstance(fault, Crash | Slow) or not 0 <= fault.time < inf:
            raise InvalidInputError(
                "live: expected only crashes and slow robots as faults, at times of 0 or more, got"
                f" {fault}"
            )
    for medium in scenario.network.media:
        if medium.kind != "loss":
            raise InvalidInputError(
                f"live: expected no network, because a live search has only loss, got {medium}"
            )
    check_integer(scenario.packet or LONGEST, what="packet", least=SHORTEST, most=LARGEST)
    if not 0 <= port <= 65_535:
        raise InvalidInputError(
            f"port: expected a number from 1 to 65535, or 0 for a free one, got {port!r}"
        )


def _key_of(brief: Brief, starts: Sequence[int], key: bytes) -> bytes:
    """Return the key that signs the messages of one search. Different searches get different keys
    from the same secret ``key``.
    """
    digest = hashlib.sha256(brief.tour_cost.tour.cells.tobytes())
    digest.update(repr((brief.allocator, brief.multiplicity, tuple(starts))).encode())
    return hmac.digest(key or secrets.token_bytes(32), digest.digest(), "sha256")


def _reserve_channel(channel: str, port: int, stack: ExitStack) -> tuple[Channel, int]:
    """Choose the channel, and reserve a port of the multicast group. Return the channel and the
    port.
    """
    if channel not in ("auto", "multicast", "unicast"):
        raise InvalidInputError(f"channel: expected auto, multicast or unicast, got {channel!r}")
    if channel != "unicast":
        group_socket = reserve(port=port)
        if group_socket is not None:
            stack.callback(group_socket.close)
            return "multicast", int(group_socket.getsockname()[1])
        if channel == "multicast":
            raise InvalidInputError(
                "channel: expected multicast on the loopback interface, which this system does not"
                " have"
            )
    return "unicast", 0


class _Watch:
    """An observer of a search. The observer only kills processes and records events."""

    def __init__(
        self,
        pool: ProcessPool,
        task: LiveTask,
        on_event: Callable[[LiveEvent], None] | None,
        startup: float,
    ) -> None:
        self._pool, self._task, self._on_event, self._startup = pool, task, on_event, startup
        self._events: list[LiveEvent] = []
        self._epoch = time.monotonic() + _AHEAD

    @property
    def _now(self) -> float:
        return (time.monotonic() - self._epoch) * self._task.speed

    def run(self, timeout: float) -> LiveOutcome:
        """Observe the search until all processes have ended, or until the time limit of ``timeout``
        seconds.
        """
        pool, speed = self._pool, self._task.speed
        pool.begin(self._epoch)
        crashes = [fault for fault in self._task.scenario.faults if isinstance(fault, Crash)]
        due = sorted(crashes, key=lambda crash: crash.time)
        last = timeout * speed
        while pool.running and self._now < last:
            pool.collect(
                (min([last, *(crash.time for crash in due[:1])]) - self._now) / speed, self._take
            )
            while due and due[0].time <= self._now:
                pool.collect(0.0, self._take)  # the process may have ended by itself
                self._kill(due.pop(0).robot, "killed")
        seconds = self._now / speed
        timed_out = bool(pool.running)
        for number in pool.members:
            self._kill(number, "stopped")
        while pool.running:
            pool.collect(1.0, self._take)
        return self._outcome(seconds, timed_out)

    def _kill(self, number: int, kind: str) -> None:
        if self._pool.kill(number):
            self._note(LiveEvent(self._now, number, kind))

    def _take(self, member: Member, report: Report) -> None:
        if report["kind"] == "ended":
            if not any(
                event.robot == member.number and event.kind in _LAST for event in self._events
            ):
                self._note(
                    LiveEvent(
                        self._now,
                        member.number,
                        "failed",
                        reason="its process ended without a report",
                    )
                )
            return
        fields: dict[str, Any] = {
            name: report[name] for name in ("cell", "found", "reason") if name in report
        }
        fields |= {
            name: tuple(report[name])
            for name in ("place", "through", "around", "beside")
            if name in report
        }
        self._note(
            LiveEvent(report.get("time", self._now), member.number, report["kind"], **fields)
        )

    def _note(self, event: LiveEvent) -> None:
        self._events.append(event)
        if self._on_event is not None:
            self._on_event(event)

    def _outcome(self, seconds: float, timed_out: bool) -> LiveOutcome:
        members = self._pool.members
        declared, killed = (
            {event.robot: event.time for event in self._events if event.kind == kind}
            for kind in ("declared", "killed")
        )
        failed = {event.robot: event.reason for event in self._events if event.kind == "failed"}
        events = tuple(sorted(self._events, key=lambda event: event.time))
        covered = covered_share(events, self._task.scenario.goal)
        survivors = members.keys() - killed.keys() - failed.keys()
        sent, heard, lost, dropped = (
            sum(member.counts[k] for member in members.values()) for k in range(4)
        )
        return LiveOutcome(
            complete=covered == 1.0 and bool(declared) and survivors <= declared.keys(),
            covered=covered,
            declared=declared,
            killed=killed,
            failed=failed,
            sent=sent,
            heard=heard,
            lost=lost,
            dropped=dropped,
            channel=self._task.channel,
            port=self._task.port,
            startup=self._startup,
            seconds=seconds,
            timed_out=timed_out,
            events=events,
        )


# seconds: minimum listening time of live robots, and minimum interval of their beacons
_HELLO, _BEAT = 0.3, 0.05
_MESSAGE = 0.2e-3  # seconds that a core needs for a message: to send, receive, check and act on it
_BUSY = 0.5  # share of the cores' time for messages
_HELLOS = 8  # beacons that a robot sends while it listens
_STATES = {status: status for status in get_args(Status)} | dict.fromkeys(
    ("killed", "stopped", "failed"), "dead"
)


def live_beat(robots: int, *, cores: int | None = None) -> float:
    """Return the time in seconds between two beacons of a live robot: 0.05 s, or what the cores of
    this computer can keep up with, as each beacon is a message for each other robot.

    Examples
    --------
    >>> live_beat(4, cores=2), round(live_beat(30, cores=2), 3)
    (0.05, 0.174)
    """
    if cores is None:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return max(_BEAT, robots * (robots - 1) * _MESSAGE / (_BUSY * (cores or 1)))


def live_trace(
    scenario: Scenario, *, live: float, key: bytes = b"", makespan: float | None = None
) -> tuple[Scenario, SearchTrace]:
    """Run a live search, in which a robot of speed 1 searches ``live`` cells per second.

    Live robots listen for at least 0.3 s, and send beacons at least `live_beat` seconds apart. The first result is the scenario with these times. The second result is the trace of the
    search. If the planned ``makespan`` in cells is given, a notice tells beforehand how long the
    search takes.

    Raises
    ------
    InvalidInputError
        If the scenario contains faults other than crashes and slow robots.
    """
    robots = len(scenario.starts)
    least = live_beat(robots)
    beat = max(scenario.brief.beat, least * live)
    # a robot sends several beacons while it listens, which take the cores just as long
    listening = _HELLO if least == _BEAT else max(_HELLO, _HELLOS * least)
    hello = max(scenario.brief.hello, listening * live)
    brief = replace(scenario.brief, hello=hello, beat=beat)
    scenario = replace(scenario, brief=brief)
    if makespan is not None:
        tell_once(
            f"{count_text(robots, 'live robot')} at {live:g} cells a second: about"
            f" {(brief.hello + makespan) / live:.2g} s if nothing fails, with a beacon of each"
            f" robot every {beat / live:.2g} s"
        )
    outcome = run_live(scenario, speed=live, key=key)
    logs = [_log_of(number, outcome.events) for number in range(1, len(scenario.starts) + 1)]
    covered_at = float(search_times(scenario, logs).max())
    return scenario, SearchTrace(
        tuple(logs),
        covered_at,
        outcome.declared,
        outcome.heard,
        outcome.lost,
        takeovers_of(scenario, logs),
        outcome.dropped,
    )


def _log_of(number: int, events: Sequence[LiveEvent]) -> RobotLog:
    """Return the log of the robot with a given number, made from its reports."""
    own = [event for event in events if event.robot == number]
    searched = [event for event in own if event.kind == "searched" and event.cell is not None]
    detours = tuple(event.through for event in searched)
    findings = {event.cell for event in searched if event.found and event.cell is not None}
    findings |= {cell for event in searched for cell in event.beside}
    return RobotLog(
        cells=np.array([event.cell for event in searched], dtype=np.int64),
        times=np.array([event.time for event in searched]),
        states=tuple((event.time, _STATES[event.kind]) for event in own if event.kind in _STATES),
        found=tuple((cell, (number,)) for cell in sorted(findings)),
        detours=detours if any(detours) else (),
        obstructed=tuple(
            (event.time, event.cell)
            for event in own
            if event.kind == "obstructed" and event.cell is not None
        ),
    )


def takeovers_of(scenario: Scenario, logs: list[RobotLog]) -> int:
    """Return the number of times that a robot began to search the part of a dead robot."""
    brief = scenario.brief
    numbers = range(1, len(logs) + 1)
    robots = tuple(zip(numbers, scenario.starts, scenario.rates, scenario.widths, strict=True))
    parts = partition(brief.tour_cost, brief.allocator, robots)
    deaths = [next((time for time, state in log.states if state == "dead"), inf) for log in logs]
    count = 0
    for number, log in zip(numbers, logs, strict=True):
        whose = [
            next(part.robot for part in parts if part.bits >> cell & 1)
            for cell in log.cells.tolist()
        ]
        for before, other, moment in zip([number, *whose], whose, log.times.tolist(), strict=False):
            count += other not in (before, number) and deaths[other - 1] < moment
    return count
