"""Deterministic simulation of a search, with one thread and one clock. Two simulations of the same
scenario give equal traces.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from dataclasses import field
from math import inf
from typing import Any

import numpy as np
from numpy.random import Generator

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.kernels.protocol.numbers import LOOK, RECORDED, RETRY, STAMPS_APART, TRIES
from shoal.search.problem.network import (
    BadLinks,
    Battery,
    Crash,
    Liar,
    Link,
    Pause,
    WrongPosition,
    damage,
    true_rate,
)
from shoal.search.protocol.messages import LONGEST, Beacon, Heartbeat, Receiver, Sender
from shoal.search.protocol.robot import Decision, advance
from shoal.search.protocol.state import (
    Action,
    Begin,
    Blocked,
    Declare,
    Event,
    Go,
    GoHome,
    Heard,
    Obstructed,
    Recharged,
    Robot,
    Send,
    Sensed,
    Wake,
    WakeAt,
    is_live,
    step_cost,
)
from shoal.search.simulation.scenario import Scenario
from shoal.search.tours.masks import members

_KEY, _OTHER_KEY = b"of the robots", b"of somebody else"


@dataclass
class SimulatedRobot:
    """A simulated robot: its state machine, its true position and energy, and whether it still
    works.
    """

    robot: Robot
    place: int  # tour index of the robot's true cell
    true_rate: float
    energy: float = inf  # true remaining energy, in the unit of `Brief.energy`
    alive: bool = True
    paused_until: float = 0.0
    liar: bool = False
    searching: int | None = None  # the cell that the robot occupies for its search
    going: int | None = None
    aimed: int | None = None  # `Robot.aim` of the latest search
    tries: int = 0
    wake: float = inf
    travelled: float = 0.0
    waited: float = 0.0  # total time of waiting for other robots to leave a cell
    visits: list[tuple[float, int]] = field(default_factory=list)  # time and cell of each search
    passing: tuple[int, ...] = ()  # the cells passed since the latest search
    # for each search, the cells passed on the way to it
    detours: list[tuple[int, ...]] = field(default_factory=list)
    # time and cell of each discovery of an obstacle
    obstructed: list[tuple[float, int]] = field(default_factory=list)
    states: list[tuple[float, str]] = field(default_factory=list)


class SearchWorld:
    """The simulation of one scenario.

    Parameters
    ----------
    scenario : Scenario
    check : callable, optional
        Function that the simulation calls after every event, with the world and the number of the
        robot, for example to test invariants.
    decide : callable, optional
        Function that chooses the next actions of idle robots instead of the protocol; see
        `advance`. With ``decide``, robots start without listening, and do not divide the tour.

    Attributes
    ----------
    covered : int
        Bitset of the cells that honest robots have searched.
    covered_at : float
        Time at which honest robots had searched all reachable cells, or infinity if a reachable
        cell remained unsearched.
    declared : dict of int to float
        Time at which each robot declared completion.
    vehicles : dict of int to SimulatedRobot
        The simulated robots, by the number of the robot.
    finds : list of (int, int)
        Number of the robot and cell of each detection of a target by a robot that tells the truth,
        in order.
    takeovers : int
        Number of times that a robot began to search the part of another robot that it presumed
        dead.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        check: Callable[[SearchWorld, int], None] | None = None,
        decide: Callable[[Robot, float], Decision] | None = None,
    ) -> None:
        self.scenario, self.check, self.decide = scenario, check, decide
        self.rng = np.random.default_rng(scenario.seed)
        self.time = 0.0
        self.covered = 0
        self.goal = scenario.goal
        self.searched: dict[int, int] = {}  # for each robot, the cells that it really searched
        self.covered_at = inf
        self.declared: dict[int, float] = {}
        self.finds: list[tuple[int, int]] = []  # robot and cell of each true detection
        self.takeovers = 0
        self.air = Air(scenario, self.rng)
        self._queue: list[tuple[float, int, int, str, Any]] = []
        self._number = 0
        self.vehicles = {
            number: self._vehicle(number) for number in range(1, len(scenario.starts) + 1)
        }
        for fault in scenario.faults:
            if isinstance(fault, Crash | Pause):
                self._post(fault.time, fault.robot, "fault", fault)
        for number in self.vehicles:
            self._post(0.0, number, "event", Begin(0.0))

    def _vehicle(self, number: int) -> SimulatedRobot:
        scenario, brief = self.scenario, self.scenario.brief
        start, rate, width = (
            scenario.starts[number - 1],
            scenario.rates[number - 1],
            scenario.widths[number - 1],
        )
        believed = start
        body = SimulatedRobot(
            Robot(number, brief, start, rate, width), start, rate, energy=brief.energy
        )
        for fault in scenario.faults:
            if fault.robot != number:
                continue
            if isinstance(fault, WrongPosition):
                believed = (start + fault.off) % len(brief.tour_cost)
                body.robot = Robot(number, brief, believed, rate, width)
            elif isinstance(fault, Battery):
                body.energy = fault.energy
            elif isinstance(fault, Liar):
                body.liar = True
        if self.decide is not None:
            body.robot = body.robot.replaced(status="waiting")
        self.searched[number] = 0
        return body

    def prompt(self, number: int, time: float) -> None:
        """Let an idle robot decide again at a given time."""
        self._post(time, number, "event", Wake(time))

    def _post(self, time: float, robot: int, kind: str, payload: Any) -> None:
        self._number += 1
        heapq.heappush(self._queue, (time, self._number, robot, kind, payload))

    def run(self, *, until: float = inf) -> SearchWorld:
        """Simulate all events up to the time ``until``, and return the world itself."""
        while self._queue and self._queue[0][0] <= until:
            self.time, _, number, kind, payload = heapq.heappop(self._queue)
            vehicle = self.vehicles[number]
            if not vehicle.alive:
                continue
            if kind == "fault":
                self._fail(vehicle, payload)
                continue
            if self.time < vehicle.paused_until:
                if kind != "heard":  # a paused robot loses messages; all other events wait
                    self._post(vehicle.paused_until, number, kind, payload)
                continue
            getattr(self, f"_do_{kind}")(vehicle, payload)
            if self.check is not None:
                self.check(self, number)
        return self

    def _fail(self, vehicle: SimulatedRobot, fault: Crash | Pause) -> None:
        vehicle.searching = None  # other robots can avoid a robot that does not move
        if isinstance(fault, Crash):
            self._die(vehicle)
        else:
            vehicle.paused_until = max(vehicle.paused_until, fault.until)
            vehicle.states.append((self.time, "paused"))

    def _die(self, vehicle: SimulatedRobot) -> None:
        vehicle.alive, vehicle.searching = False, None
        vehicle.states.append((self.time, "dead"))

    # The handlers of the events in the queue, by kind.

    def _do_event(self, vehicle: SimulatedRobot, event: Event) -> None:
        vehicle.robot, actions = advance(vehicle.robot, event, self.decide)
        state = vehicle.robot.status
        if not vehicle.states or vehicle.states[-1][1] != state:
            vehicle.states.append((self.time, state))
        if state in ("waiting", "complete"):
            vehicle.searching = None  # the robot stands aside
        for action in actions:
            self._act(vehicle, action)

    def _do_wake(self, vehicle: SimulatedRobot, time: float) -> None:
        if time == vehicle.wake:  # the robot has made no newer request
            vehicle.wake = inf
            self._do_event(vehicle, Wake(self.time))

    def _do_heard(self, vehicle: SimulatedRobot, message: Beacon | bytes) -> None:
        beacon = self.air.open(vehicle.robot.number, message, self.time)
        if beacon is not None:
            self._do_event(vehicle, Heard(self.time, beacon))

    def _do_enter(self, vehicle: SimulatedRobot, cell: int) -> None:
        """Let a robot enter a cell and search it, or wait in front of the cell while another robot
        is in it.
        """
        live_robots = (
            other for other in self.vehicles.values() if other is not vehicle and other.alive
        )
        rate = self._rate(vehicle)
        if any(other.searching == cell for other in live_robots):
            vehicle.searching = None
            if vehicle.tries < TRIES:
                vehicle.tries += 1
                vehicle.waited += RETRY / rate
                self._post(self.time + RETRY / rate, vehicle.robot.number, "enter", cell)
            else:
                vehicle.place, vehicle.going = cell, None
                vehicle.passing += vehicle.robot.through
                self._do_event(vehicle, Blocked(self.time, cell))
            return
        vehicle.searching = vehicle.place = cell
        self._post(self.time + 1.0 / rate, vehicle.robot.number, "sense", cell)

    def _do_sense(self, vehicle: SimulatedRobot, cell: int) -> None:
        # a pause has interrupted the search, so the robot must enter the cell again
        if vehicle.searching != cell:
            self._do_enter(vehicle, cell)
            return
        scenario, number = self.scenario, vehicle.robot.number
        detected = self._finds(vehicle, cell)
        visible = scenario.visible_cells(number, cell)
        beside = (
            ()
            if visible == 1 << cell
            else tuple(
                neighbour
                for neighbour in members(visible)
                if neighbour != cell and self._finds(vehicle, neighbour)
            )
        )
        if not vehicle.liar:
            self.searched[number] |= visible
            if visible & ~self.covered:
                self.covered |= visible
                if self.covered_at == inf and not self.goal & ~self.covered:
                    self.covered_at = self.time
        vehicle.visits.append((self.time, cell))
        vehicle.detours.append(vehicle.passing + vehicle.robot.through[:-1])
        vehicle.passing = ()
        vehicle.going, vehicle.aimed = None, vehicle.robot.aim
        self._do_event(vehicle, Sensed(self.time, cell, detected, beside))

    def _finds(self, vehicle: SimulatedRobot, cell: int) -> bool:
        """Decide at random whether a robot reports a target in a cell. The probability is a sensor
        rate, or 0.5 for a liar.
        """
        has_target = cell in self.scenario.targets
        chance = self.scenario.detection if has_target else self.scenario.false_alarm
        reported = bool(chance or vehicle.liar) and bool(
            self.rng.random() < (0.5 if vehicle.liar else chance)
        )
        if reported and has_target and not vehicle.liar:
            self.finds.append((vehicle.robot.number, cell))
        return reported

    def _do_obstructed(self, vehicle: SimulatedRobot, contact: tuple[int, int]) -> None:
        cell, vehicle.place = contact
        vehicle.going = None
        vehicle.obstructed.append((self.time, cell))
        self._do_event(vehicle, Obstructed(self.time, cell, vehicle.place))

    def _do_home(self, vehicle: SimulatedRobot, _: None) -> None:
        vehicle.place, vehicle.energy = vehicle.robot.start, self._full(vehicle.robot.number)
        self._do_event(vehicle, Recharged(self.time))

    # The handlers of the robots' actions.

    def _act(self, vehicle: SimulatedRobot, action: Action) -> None:
        number = vehicle.robot.number
        match action:
            case Go(cell, through):
                self._go(vehicle, cell, through)
            case GoHome(through):
                away = self.scenario.path_length(vehicle.place, through or (vehicle.robot.start,))
                away += self.scenario.brief.from_launch(number, vehicle.robot.start, vehicle.place)
                vehicle.searching = None
                vehicle.passing += through
                if self._spend(vehicle, away):
                    self._post(
                        self.time + away / self._rate(vehicle) + self.scenario.brief.recharge,
                        number,
                        "home",
                        None,
                    )
            case Send(beacon):
                self._broadcast(vehicle, beacon)
            case WakeAt(time):
                if time < inf and time != vehicle.wake:
                    self._post(max(time, self.time), number, "wake", time)
                vehicle.wake = time
            case Declare():
                self.declared[number] = self.time

    def _go(self, vehicle: SimulatedRobot, cell: int, through: tuple[int, ...]) -> None:
        robot, tour_cost = vehicle.robot, self.scenario.brief.tour_cost
        if self._takes_over(vehicle):
            self.takeovers += 1
        vehicle.going, vehicle.tries = cell, 0
        obstacle, free = self.scenario.obstacle_on(vehicle.place, through)
        if obstacle is not None:
            self._stop_before(vehicle, obstacle, through[:free])
            return
        cost = (
            robot.cost
            if through
            else step_cost(tour_cost, vehicle.place, cell, robot.fresh)
            + self._launch_cost(vehicle, cell)
        )
        if not self._spend(vehicle, cost):
            return
        if cost > 1.0 + 1e-12:
            vehicle.searching = None  # during the motion the robot occupies no cell
        self._post(self.time + (cost - 1.0) / self._rate(vehicle), robot.number, "enter", cell)

    def _stop_before(self, vehicle: SimulatedRobot, obstacle: int, path: tuple[int, ...]) -> None:
        cost = (
            self.scenario.path_length(vehicle.place, path)
            + LOOK
            + self._launch_cost(vehicle, vehicle.place)
        )
        vehicle.searching = None
        if self._spend(vehicle, cost):
            at = path[-1] if path else vehicle.place
            vehicle.passing += path
            self._post(
                self.time + cost / self._rate(vehicle),
                vehicle.robot.number,
                "obstructed",
                (obstacle, at),
            )

    def _launch_cost(self, vehicle: SimulatedRobot, cell: int) -> float:
        """Return the extra distance to a cell for a robot that is still at its launch point, and 0
        for all other robots.
        """
        robot = vehicle.robot
        return (
            self.scenario.brief.from_launch(robot.number, vehicle.place, cell)
            if robot.at_launch
            else 0.0
        )

    def _takes_over(self, vehicle: SimulatedRobot) -> bool:
        """Return whether a robot begins to search the part of another robot that it
        presumes dead.
        """
        robot = vehicle.robot
        part = next(
            (part for part in robot.parts if robot.aim is not None and part.bits >> robot.aim & 1),
            None,
        )
        if part is None:
            return False
        again = vehicle.aimed is not None and bool(part.bits >> vehicle.aimed & 1)
        return not again and not is_live(robot, part.robot, self.time)

    def _spend(self, vehicle: SimulatedRobot, cost: float) -> bool:
        """Consume energy of a robot, and return whether the energy was enough. Otherwise, the robot
        stops for ever on its way.
        """
        vehicle.energy -= cost
        vehicle.travelled += cost
        if vehicle.energy >= -1e-9:
            return True
        self._die(vehicle)
        return False

    def _full(self, number: int) -> float:
        limits = [
            fault.energy
            for fault in self.scenario.faults
            if isinstance(fault, Battery) and fault.robot == number
        ]
        return min([self.scenario.brief.energy, *limits])

    def _rate(self, vehicle: SimulatedRobot) -> float:
        return true_rate(vehicle.true_rate, self.scenario.faults, vehicle.robot.number, self.time)

    def _broadcast(self, sender: SimulatedRobot, beacon: Beacon) -> None:
        tour_cost, number = self.scenario.brief.tour_cost, sender.robot.number
        messages = self.air.messages(number, beacon, self.time)
        for other, receiver in self.vehicles.items():
            if other != number:
                link = Link(
                    number, other, self.time, tour_cost.between(sender.place, receiver.place)
                )
                for message in messages:
                    for delay, arrived in self.air.carry(message, link, reaches=receiver.alive):
                        self._post(self.time + delay, other, "heard", arrived)


Message = Beacon | bytes


class Air:
    """The radio channel between simulated robots.

    The channel encodes beacons as bytes only if messages are signed, divided, recorded or damaged.

    Parameters
    ----------
    scenario : Scenario
    rng : Generator
        Generator of the random numbers of the network.
    """

    def __init__(self, scenario: Scenario, rng: Generator) -> None:
        self.sent = self.lost = 0
        self._scenario, self._rng = scenario, rng
        # a generator of its own, so that the bytes of a message do not decide what else happens
        self._damage_rng = np.random.default_rng([scenario.seed, 4])
        self._split = scenario.signed or scenario.packet > 0 or scenario.network.has("replays")
        self._bad = BadLinks(set)
        self._recorded: list[bytes] = []
        numbers = range(1, len(scenario.starts) + 1)
        key, most = _KEY if scenario.signed else b"", scenario.packet or LONGEST
        self._senders = {number: Sender(number, key, most) for number in numbers}
        options = {
            "robots": len(numbers),
            "cells": len(scenario.brief.tour_cost),
            "most": most,
            "window": STAMPS_APART,
        }
        self._receivers = {number: Receiver(key, **options) for number in numbers}

    def messages(self, sender: int, beacon: Beacon, time: float) -> list[Message]:
        """Return the messages that transmit a beacon."""
        if not self._split:
            return [beacon]
        messages = self._senders[sender].messages(beacon, _clock(time))
        self._recorded = (self._recorded + messages)[-RECORDED:]
        return list(messages)

    def carry(
        self, message: Message, link: Link, *, reaches: bool
    ) -> Iterator[tuple[float, Message]]:
        """Yield pairs of a delay and a copy of a message that arrives at one receiver. If
        ``reaches`` is false, no copy arrives.
        """
        self.sent += 1
        copies = self._scenario.network.send(link, self._rng, self._bad) if reaches else []
        self.lost += all(copy.damaged or copy.other for copy in copies)
        for copy in copies:
            come = message
            if copy.other == "replay" and self._recorded:
                come = self._recorded[int(self._rng.random() * len(self._recorded))]
            elif copy.other == "forgery":
                come = self._forge(link)
            if copy.damaged:
                whole = (
                    come
                    if isinstance(come, bytes)
                    else self._senders[link.sender].messages(come, _clock(link.time))[0]
                )
                come = damage(whole, self._damage_rng)
            yield copy.delay, come

    def _forge(self, link: Link) -> bytes:
        """Return a forged message by an attacker without the key. The message reports that all
        robots have searched all cells.
        """
        everything, robots = (
            self._scenario.brief.everything,
            range(1, len(self._scenario.starts) + 1),
        )
        heartbeat = Heartbeat(link.sender, 1 << 30, 0, 1.0, "complete")
        lie = Beacon(link.sender, (heartbeat,), tuple((number, everything) for number in robots))
        return Sender(link.sender, _OTHER_KEY).messages(lie, _clock(link.time) + 1)[0]

    def open(self, receiver: int, message: Message, time: float) -> Beacon | None:
        """Return the beacon that a robot reads in a message, or None if the robot refuses the
        message.
        """
        if isinstance(message, Beacon):
            return message
        try:
            return self._receivers[receiver].open(message, _clock(time))
        except InvalidInputError:
            return None


def _clock(time: float) -> int:
    """Convert a time to milliseconds, as if a robot of speed 1 searched one cell per second."""
    return int(1000 * time)
