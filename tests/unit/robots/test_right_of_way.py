"""No two robots are ever in one cell, by what beacons say alone: robots with lossy radios that
start late, die and start again, in a simulation of their state machines.
"""

from __future__ import annotations

import heapq
import random
from math import inf

import pytest

from shoal.robots import right_of_way
from shoal.robots.right_of_way import RadioSensor
from shoal.search import TourCost, make_tour
from shoal.search.kernels.protocol.numbers import RETRY, TRIES
from shoal.search.protocol.robot import Brief, advance
from shoal.search.protocol.state import (
    Begin,
    Blocked,
    Go,
    Heard,
    Robot,
    Send,
    Sensed,
    Wake,
    WakeAt,
)
from shoal.search.simulation.scenario import Scenario

CELLS = 36


class Field:
    """All robots, their radio, and who is in which cell."""

    def __init__(self, seed, robots=6, loss=0.3, beat=0.25):
        self.chance = random.Random(seed)
        brief = Brief(TourCost(make_tour("moore", (6, 6))), hello=1.5, beat=beat)
        starts = tuple(self.chance.sample(range(CELLS), robots))
        self.scenario = Scenario(brief, starts)
        self.loss, self.now, self.queue, self.order = loss, 0.0, [], 0
        self.inside, self.shared, self.entered, self.waited = {}, [], 0, 0
        self.robots = [Onboard(self, number) for number in range(1, robots + 1)]
        for one in self.robots:
            self.at(self.chance.uniform(0.0, 0.4), one.feed_event, Begin)

    def at(self, delay, act, *about):
        self.order += 1
        heapq.heappush(self.queue, (self.now + delay, self.order, act, about))

    def broadcast(self, sender, beacon):
        for other in self.robots:
            if other is not sender and self.chance.random() >= self.loss:
                self.at(0.01, other.hear, beacon)

    def enter(self, number, cell):
        self.entered += 1
        if cell in self.inside:
            self.shared.append((self.now, cell, number, self.inside[cell]))
        self.inside[cell] = number

    def leave(self, number):
        self.inside = {cell: other for cell, other in self.inside.items() if other != number}

    def run(self, until):
        while self.queue and self.queue[0][0] <= until:
            self.now, _, act, about = heapq.heappop(self.queue)
            act(*about)

    @property
    def searched(self):
        bits = 0
        for one in self.robots:
            bits |= one.robot.searched.get(one.robot.number, 0)
        return bits.bit_count()


class Onboard:
    """The program of one robot, with a vehicle that is not always on time."""

    def __init__(self, field, number):
        self.field, self.alive, self.life = field, True, 0
        self.robot = Robot(number, field.scenario.brief, field.scenario.starts[number - 1])
        self.sensor = self.new_sensor(restarted=False)
        self.leg, self.wake = 0, inf

    def new_sensor(self, *, restarted):
        return RadioSensor(
            self.field.scenario, lambda: self.robot, lambda: self.field.now, restarted=restarted
        )

    def feed_event(self, kind, *about):
        self.feed(kind(self.field.now, *about))

    def feed(self, event):
        if not self.alive:
            return
        self.sensor.note(event)
        self.robot, actions = advance(self.robot, event)
        if self.robot.status in ("waiting", "complete"):
            self.field.leave(self.robot.number)
        for action in actions:
            match action:
                case Go(cell):
                    self.leg += 1
                    late = 3.0 if self.robot.number % 2 else 1.0  # and others help
                    way = (self.robot.cost - 1) * late * self.field.chance.uniform(0.8, 1.6)
                    if way > 0.3:  # else it stands before the cell at once
                        self.field.leave(self.robot.number)
                    self.field.at(max(0.0, way), self.come, self.life, self.leg, cell, 0)
                case Send(beacon):
                    self.field.broadcast(self, beacon)
                case WakeAt(moment):
                    self.wake = moment
                    if moment < inf:
                        self.field.at(max(0.0, moment - self.field.now), self.alarm, moment)

    def alarm(self, moment):
        if self.alive and moment == self.wake:
            self.wake = inf
            self.feed(Wake(self.field.now))

    def hear(self, beacon):
        self.feed(Heard(self.field.now, beacon))

    def come(self, life, leg, cell, tries):
        """Stand before a cell: enter it, wait, or give up."""
        if not self.alive or life != self.life or leg != self.leg:
            return
        if self.sensor.enter(cell):
            self.field.leave(self.robot.number)
            self.field.enter(self.robot.number, cell)
            pace = 3.0 if self.robot.number % 2 else 1.0
            self.field.at(pace, self.search, life, leg, cell)
            return
        self.field.waited += 1
        self.field.leave(self.robot.number)
        if tries < TRIES:
            self.field.at(RETRY, self.come, life, leg, cell, tries + 1)
        else:
            self.feed(Blocked(self.field.now, cell))

    def search(self, life, leg, cell):
        if self.alive and life == self.life and leg == self.leg:
            self.feed(Sensed(self.field.now, cell))

    def die(self):
        self.alive = False
        self.field.leave(self.robot.number)

    def start_again(self):
        self.alive, self.life = True, self.life + 1
        self.robot = self.robot.replaced(count=self.robot.count + 64)
        self.sensor = self.new_sensor(restarted=True)
        self.feed(Wake(self.field.now))
        if self.robot.target is not None:
            self.leg += 1
            self.field.at(2.0, self.come, self.life, self.leg, self.robot.target, 0)


def run_field(seed, **about):
    field = Field(seed, **about)
    first, second, *_ = field.chance.sample(field.robots, len(field.robots))
    for victim, again in ((first, field.chance.uniform(2.0, 12.0)), (second, None)):
        when = field.chance.uniform(1.0, 10.0)
        field.at(when, victim.die)
        if again is not None:
            field.at(when + again, victim.start_again)
    field.run(300.0)
    return field


@pytest.mark.parametrize(("loss", "stuck"), [(0.0, 30), (0.3, 30), (0.6, 30), (0.3, 4)])
def test_no_two_robots_are_in_one_cell_and_all_is_searched(loss, stuck, monkeypatch):
    monkeypatch.setattr(right_of_way, "_STUCK", stuck)  # as with long ways
    for seed in range(12):
        field = run_field(seed, loss=loss)
        assert field.shared == [], (seed, field.shared)
        assert field.searched == CELLS, seed


def test_without_the_rule_robots_would_meet(monkeypatch):
    monkeypatch.setattr(RadioSensor, "enter", lambda _self, _cell: True)
    assert sum(len(run_field(seed).shared) for seed in range(12)) > 5


def test_a_robot_alone_need_not_wait():
    field = Field(1, robots=1)
    field.run(300.0)
    assert field.searched == CELLS
    assert field.waited == 0
