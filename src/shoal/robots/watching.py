"""Who does what in a search that is under way, from what is on the air.

A watch sends nothing. It needs the task and its key, as the robots do, and a radio of its own to
which the robots' messages come: it is one more address in their lists, or a member of their
multicast group.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import reduce
from operator import or_
from typing import Any

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.robots.tasks import RobotTask
from shoal.search.problem.target import Ground
from shoal.search.protocol.messages import Beacon, Heartbeat
from shoal.search.simulation.live.ports import Radio
from shoal.search.tours.masks import bits_to_array

_SILENT = 10.0  # seconds after which a robot counts as silent


@dataclass
class ObservedRobot:
    """What is known of one robot.

    Parameters
    ----------
    heartbeat : Heartbeat
        The newest one that was heard, from the robot itself or from another that has heard it.
    heard : float or None
        Time at which the robot itself was heard last.
    messages : int
        Number of its messages.
    """

    heartbeat: Heartbeat
    heard: float | None = None
    messages: int = 0


class SearchWatch:
    """A listener that puts together what all robots tell.

    Parameters
    ----------
    task : RobotTask
    radio : Radio

    Attributes
    ----------
    robots : dict of int to ObservedRobot
    searched : dict of int to int
        Bitset of the cells that each robot has searched, as the robots tell.
    found : int
        Bitset of the cells in which something was found.
    """

    def __init__(self, task: RobotTask, radio: Radio) -> None:
        self.task, self.radio = task, radio
        self._live = task.live(1)
        self._messenger = self._live.messenger(1, radio)
        self.robots: dict[int, ObservedRobot] = {}
        self.searched: dict[int, int] = {}
        self.found = 0

    @property
    def refused(self) -> Mapping[str, int]:
        """Numbers of messages that were refused, by reason."""
        return self._messenger.refused

    def listen(self, now: float) -> None:
        """Take all messages that have come by the time ``now``."""
        for beacon in self._messenger.receive():
            try:
                self._live.check(beacon)
            except InvalidInputError:
                self._messenger.refuse("other robots, starts or cells")
            else:
                self._take(beacon, now)

    def _take(self, beacon: Beacon, now: float) -> None:
        for heartbeat in beacon.heartbeats:
            robot = self.robots.setdefault(heartbeat.robot, ObservedRobot(heartbeat))
            if heartbeat.count >= robot.heartbeat.count:
                robot.heartbeat = heartbeat
        if beacon.sender in self.robots:
            self.robots[beacon.sender].heard = now
            self.robots[beacon.sender].messages += 1
        for number, bits in beacon.searched:
            self.searched[number] = self.searched.get(number, 0) | bits
        for cell, _ in beacon.found:
            self.found |= 1 << cell

    @property
    def covered_fraction(self) -> float:
        """Fraction of the cells that robots say they have searched."""
        return self._known.bit_count() / len(self.task.cells)

    @property
    def success(self) -> float | None:
        """With a prior, the probability that the target is found, if it is in the region: each cell
        that robots say they have searched counts as searched once. None for a target that moves,
        because robots do not say when they searched a cell.
        """
        ground = self.task.plan.ground
        if not isinstance(ground, Ground):
            return None
        searched = np.zeros(len(self.task.plan.tour) + 1)  # the last for no cell, -1
        searched[bits_to_array(self._known, len(searched))] = 1
        looks = searched[ground.cells].sum(axis=1)
        return float(ground.masses @ (1.0 - (1.0 - self.task.scenario.detection) ** looks))

    @property
    def _known(self) -> int:
        return reduce(or_, self.searched.values(), 0)

    def report(self, now: float) -> dict[str, Any]:
        """Return what is known at a time, as a mapping for JSON."""
        rows = [self._row(number, now) for number in range(1, len(self.task.scenario.starts) + 1)]
        return {
            "search": self.task.search,
            "covered_fraction": self.covered_fraction,
            "cells": len(self.task.cells),
            "success": self.success,
            "complete": bool(self.robots) and self.covered_fraction == 1.0,
            "found": [cell for cell in range(len(self.task.cells)) if self.found >> cell & 1],
            "refused": dict(self.refused),
            "robots": rows,
        }

    def _row(self, number: int, now: float) -> dict[str, Any]:
        robot = self.robots.get(number)
        empty = ("heard_s", "cell", "x", "y", "longitude", "latitude", "late_s")
        row: dict[str, Any] = {"robot": number, "status": "not heard", **dict.fromkeys(empty)}
        row |= {"searched": 0, "messages": 0}
        if robot is None:
            return row
        heartbeat = robot.heartbeat
        silent = robot.heard is None or now - robot.heard > _SILENT
        # a robot that gives up tells a lag beyond all others
        gave_up = heartbeat.lag >= 1 << 29
        row |= {
            "status": "gave up" if gave_up else "silent" if silent else heartbeat.status,
            "heard_s": None if robot.heard is None else round(now - robot.heard, 1),
            "cell": heartbeat.place,
            "late_s": None if gave_up else round(max(0.0, heartbeat.lag) / self.task.speed, 1),
            "searched": self.searched.get(number, 0).bit_count(),
            "messages": robot.messages,
        }
        x, y = self.task.cells[heartbeat.place, :2].tolist()
        row |= {"x": round(x, 2), "y": round(y, 2)}
        if self.task.geographic:
            longitude, latitude = self.task.frame.to_degrees(
                self.task.cells[[heartbeat.place], :2]
            )[0]
            row |= {"longitude": round(float(longitude), 7), "latitude": round(float(latitude), 7)}
        return row
