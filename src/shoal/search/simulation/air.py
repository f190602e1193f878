"""Radio transmission in a simulation: which messages reach which robots, and what the robots can read in them."""

from __future__ import annotations

from collections.abc import Iterator

from numpy.random import Generator

from shoal.core.errors import InvalidInputError
from shoal.search.problem.network import BadLinks, Link, damage
from shoal.search.protocol.envelope import Receiver, Sender
from shoal.search.protocol.messages import LONGEST, Beacon, Heartbeat
from shoal.search.simulation.scenario import Scenario

_RECORDED = 1000  # number of recorded messages for replay attacks
_WINDOW = 100  # cells: maximum difference between a message's stamp and the receiver's clock
_KEY, _OTHER_KEY = b"of the robots", b"of somebody else"

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
        self._split = scenario.signed or scenario.packet > 0 or scenario.network.has("replays")
        self._bad = BadLinks(set)
        self._recorded: list[bytes] = []
        numbers = range(1, len(scenario.starts) + 1)
        key, most = _KEY if scenario.signed else b"", scenario.packet or LONGEST
        self._senders = {number: Sender(number, key, most) for number in numbers}
        options = {"robots": len(numbers), "cells": len(scenario.brief.tour_cost), "most": most, "window": 1000 * _WINDOW}
        self._receivers = {number: Receiver(key, **options) for number in numbers}

    def messages(self, sender: int, beacon: Beacon, time: float) -> list[Message]:
        """Return the messages that transmit a beacon."""
        if not self._split:
            return [beacon]
        found = self._senders[sender].messages(beacon, _clock(time))
        self._recorded = (self._recorded + found)[-_RECORDED:]
        return list(found)

    def carried(self, message: Message, link: Link, *, reaches: bool) -> Iterator[tuple[float, Message]]:
        """Yield pairs of a delay and a copy of a message that arrives at one receiver. If ``reaches`` is false, no copy arrives."""
        self.sent += 1
        copies = self._scenario.network.send(link, self._rng, self._bad) if reaches else []
        self.lost += all(copy.damaged or copy.other for copy in copies)
        for copy in copies:
            come = message
            if copy.other == "replay" and self._recorded:
                come = self._recorded[int(self._rng.integers(len(self._recorded)))]
            elif copy.other == "forgery":
                come = self._forged(link)
            if copy.damaged:
                whole = come if isinstance(come, bytes) else self._senders[link.sender].messages(come, _clock(link.time))[0]
                come = damage(whole, self._rng)
            yield copy.delay, come

    def _forged(self, link: Link) -> bytes:
        """Return a forged message by an attacker without the key. The message reports that all robots have searched all cells."""
        everything, robots = self._scenario.brief.everything, range(1, len(self._scenario.starts) + 1)
        heartbeat = Heartbeat(link.sender, 1 << 30, 0, 1.0, "complete")
        lie = Beacon(link.sender, (heartbeat,), tuple((number, everything) for number in robots))
        return Sender(link.sender, _OTHER_KEY).messages(lie, _clock(link.time) + 1)[0]

    def open(self, receiver: int, message: Message, time: float) -> Beacon | None:
        """Return the beacon that a robot reads in a message, or None if the robot refuses the message."""
        if isinstance(message, Beacon):
            return message
        try:
            return self._receivers[receiver].open(message, _clock(time))
        except InvalidInputError:
            return None


def _clock(time: float) -> int:
    """Convert a time to milliseconds, as if a robot of speed 1 searched one cell per second."""
    return int(1000 * time)
