"""The radio of a live search, and the task that each process gets."""

from __future__ import annotations

import socket
import struct
import sys
import time
from collections import Counter, deque
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from math import inf
from random import Random
from typing import Literal

from shoal.core.checks import shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.protocol.messages import LONGEST, Beacon, Receiver, Sender, stamp_of
from shoal.search.protocol.state import Robot
from shoal.search.simulation.live.ports import Radio
from shoal.search.simulation.scenario import Scenario

Channel = Literal["multicast", "unicast"]
GROUP = "239.83.72.76"  # within the block for private use (RFC 2365, section 6.2)
LOOPBACK = "127.0.0.1"
LARGEST = 65_507  # maximum bytes of a datagram
_WAITING = 1 << 20  # bytes of the receive buffer
_AT_ONCE = 1000  # maximum number of messages processed before the robot does something else
# Number of refused messages after which the radio rests, and seconds without listening then. No source
# is ignored: an attacker could forge the address of a robot, and so silence it.
_REFUSED, _REST = 50, 0.01
_OWN = 10_000  # messages that a robot has sent and knows again: more than are sent in a minute


def listener(group: str, port: int) -> socket.socket:
    """Return a socket that listens to a multicast group on the loopback interface. Several sockets
    can share the port.
    """
    with ExitStack() as stack:
        ear = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        ear.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # on this system, the option above does not allow several listeners on one port
        if sys.platform != "linux":
            ear.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        ear.bind((group, port))
        member = struct.pack("4s4s", socket.inet_aton(group), socket.inet_aton(LOOPBACK))
        ear.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        stack.pop_all()
    return ear


def speaker(channel: Channel) -> socket.socket:
    """Return a socket that has its own port and sends only on the loopback interface."""
    with ExitStack() as stack:
        mouth = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        mouth.bind((LOOPBACK, 0))
        if channel == "multicast":
            mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(LOOPBACK))
            mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        stack.pop_all()
    return mouth


def reserve(group: str = GROUP, port: int = 0) -> socket.socket | None:
    """Return a socket on a port of a multicast group, or None if multicast is not available.

    If ``port`` is 0, the function chooses a free port. The port stays reserved until the caller
    closes the socket. The function sends a datagram to the port to test multicast.
    """
    with ExitStack() as stack, suppress(OSError):
        if not port:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
                probe.bind((group, 0))
                port = int(probe.getsockname()[1])
        ear = stack.enter_context(listener(group, port))
        with speaker("multicast") as mouth:
            mouth.sendto(b"?", (group, port))
        ear.settimeout(1.0)
        ear.recv(1)
        stack.pop_all()
        return ear
    return None


class LoopbackRadio:
    """A radio on the loopback interface.

    Parameters
    ----------
    channel : str
        Channel of the messages: "multicast" or "unicast".
    port : int
        Port of the multicast group. With unicast, the robot uses a free port of its own.
    """

    most = LARGEST
    rate = inf
    fault = ""

    def __init__(self, channel: Channel, port: int = 0) -> None:
        self._mouth = speaker(channel)
        self._ear = listener(GROUP, port) if channel == "multicast" else self._mouth
        self._ear.setblocking(False)
        self._ear.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _WAITING)
        self._own = self._mouth.getsockname()
        self.port = int(self._own[1])
        self._channel = channel
        self._others: list[tuple[str, int]] = [(GROUP, port)] if channel == "multicast" else []

    def fileno(self) -> int:
        """Return the file descriptor of the socket on which messages arrive."""
        return self._ear.fileno()

    def tell(self, ports: Sequence[int]) -> None:
        """Store the ports of all robots, which the radio uses only with unicast."""
        if self._channel == "unicast":
            self._others = [(LOOPBACK, port) for port in ports if port != self.port]

    def broadcast(self, message: bytes) -> int:
        """Send a message to all others. Return the number of copies that the operating system
        refused to send.
        """
        return send_to_all(self._mouth, message, self._others)

    def receive(self) -> tuple[bytes, object] | None:
        """Return a message from another, and where it came from."""
        return receive_from_others(self._ear, self._own)

    def close(self) -> None:
        """Close the sockets of the radio."""
        self._ear.close()
        self._mouth.close()


def send_to_all(mouth: socket.socket, message: bytes, addresses: Sequence[tuple[str, int]]) -> int:
    """Send a datagram to each address. Return the number of datagrams that the operating system
    refused to send.
    """
    refused = 0
    for address in addresses:
        try:
            mouth.sendto(message, address)
        except OSError:
            refused += 1
    return refused


def receive_from_others(ear: socket.socket, own: object) -> tuple[bytes, object] | None:
    """Return a datagram that is not our own, and its source; None if there is none."""
    while True:
        try:
            data, source = ear.recvfrom(LARGEST + 1)
        except BlockingIOError:
            return None
        except ConnectionError:  # some systems report here that another robot's port is closed
            continue
        if source != own:
            return data, source


class Messenger:
    """What turns the beacons of a robot into messages on its radio, and messages into beacons.

    Parameters
    ----------
    radio : Radio
    sender : Sender
        Object that creates the robot's messages.
    receiver : Receiver
        Object that opens messages of other robots.
    loss : float
        Probability that a message of another robot is discarded, to simulate loss.
    random : random.Random
        Generator of the random numbers that decide which messages are lost.

    Attributes
    ----------
    sent, heard, lost : int
        Numbers of messages.
    refused : Counter of str
        Numbers of refused messages by reason.
    twin : bool
        Whether another robot has sent a message in the name of this one: both would do the same
        work, in the same cells and at the same height.
    """

    def __init__(
        self,
        radio: Radio,
        sender: Sender,
        receiver: Receiver,
        *,
        loss: float = 0.0,
        random: Random,
    ) -> None:
        self.radio = radio
        self._sender, self._receiver, self._loss, self._random = sender, receiver, loss, random
        self.sent = self.heard = self.lost = 0
        self.refused: Counter[str] = Counter()
        self.rest_until = 0.0
        self.twin = False
        # what an earlier process of this robot has sent is older
        self._begun, self._sent = _clock(), deque[int](maxlen=_OWN)

    @property
    def fault(self) -> str:
        """Why the robot cannot go on with its radio; empty as long as it can."""
        if self.twin:
            return f"radio: another robot has the number {self._sender.number}, too"
        return self.radio.fault

    @property
    def dropped(self) -> int:
        """Number of refused messages."""
        return self.refused.total()

    @property
    def counts(self) -> tuple[int, int, int, int]:
        """Numbers of messages sent, heard, lost and refused."""
        return self.sent, self.heard, self.lost, self.dropped

    def fileno(self) -> int:
        """Return the radio's file descriptor."""
        return self.radio.fileno()

    def refuse(self, reason: str) -> None:
        """Count a refused message."""
        self.refused[reason] += 1

    def send(self, beacon: Beacon) -> None:
        """Broadcast a beacon. Messages that the radio cannot send count as lost."""
        for message in self._sender.messages(beacon, _clock()):
            self._sent.append(stamp_of(message))
            self.sent += 1
            self.lost += self.radio.broadcast(message)

    def receive(self) -> list[Beacon]:
        """Return the beacons in messages that have arrived from other robots of this search, and
        drop all other messages.

        After many dropped messages, the radio pauses until the time ``rest_until``, so that a flood
        of messages costs the robot little time.
        """
        beacons: list[Beacon] = []
        clock, now = _clock(), time.monotonic()
        last = self.dropped + _REFUSED
        for _ in range(_AT_ONCE):
            if self.dropped >= last:
                self.rest_until = now + _REST
                break
            came = self.radio.receive()
            if came is None:
                break
            try:
                beacon = self._receiver.open(came[0], clock)
            except InvalidInputError as error:
                self.refuse(getattr(error, "reason", "content"))
                continue
            # who sends nothing, and only watches, is no robot
            if self.sent and beacon.sender == self._sender.number:
                stamp = stamp_of(came[0])
                self.twin |= stamp > self._begun and stamp not in self._sent
                self.refuse("own number")
                continue
            self.heard += 1
            if self._random.random() < self._loss:
                self.lost += 1
            else:
                beacons.append(beacon)
        return beacons

    def close(self) -> None:
        """Close the radio."""
        self.radio.close()


def _clock() -> int:
    """Return the system's time in milliseconds since 1970. The system's clock goes on while a robot
    is switched off.
    """
    return time.time_ns() // 1_000_000


@dataclass(frozen=True)
class LiveTask:
    """The data that the processes of all live robots receive at their start.

    Parameters
    ----------
    scenario : Scenario
        The scenario of the search. Obstacles in the scenario block the vehicles, but the robots do
        not know the obstacles.
    speed : float
        Number of cells that a robot of speed 1 searches per second of real time.
    channel : str
        Channel of the messages: "multicast" or "unicast".
    port : int
        Port of the multicast group.
    key : bytes
        Key that signs the messages of this search. Robots drop messages without a signature by this
        key.
    """

    scenario: Scenario
    speed: float
    channel: Channel
    port: int
    key: bytes = b""

    def check(self, beacon: Beacon) -> None:
        """Refuse a beacon that no robot of this search can have sent."""
        robots, cells = len(self.scenario.starts), len(self.scenario.brief.tour_cost)
        for heartbeat in beacon.heartbeats:
            is_member = 1 <= heartbeat.robot <= robots
            if not is_member or (heartbeat.start, heartbeat.rate, heartbeat.width) != self._of(
                heartbeat.robot
            ):
                raise InvalidInputError(
                    "beacon: expected a robot of this search with its start, speed and width, got"
                    f" {shortened(heartbeat)}"
                )
        numbers = {beacon.sender, *(number for number, _ in (*beacon.searched, *beacon.closed))}
        sets = [bits >> cells for _, bits in (*beacon.searched, *beacon.closed)]
        sets += [bits >> robots + 1 | bits & 1 for _, bits in beacon.found]
        if (
            not numbers <= set(range(1, robots + 1))
            or any(sets)
            or any(cell >= cells for cell, _ in beacon.found)
        ):
            raise InvalidInputError(
                f"beacon: expected {robots} robots and {cells} cells, got other numbers"
            )

    def _of(self, number: int) -> tuple[int, float, int]:
        return (
            self.scenario.starts[number - 1],
            self.scenario.rates[number - 1],
            self.scenario.widths[number - 1],
        )

    def messenger(self, number: int, radio: Radio) -> Messenger:
        """Return the messenger of the robot with a given number."""
        scenario, most = self.scenario, min(self.scenario.packet or LONGEST, radio.most)
        receiver = Receiver(
            self.key, robots=len(scenario.starts), cells=len(scenario.brief.tour_cost), most=most
        )
        random = Random(f"{scenario.seed} {number}")
        loss = next(
            (medium.numbers[0] for medium in scenario.network.media if medium.kind == "loss"), 0.0
        )
        return Messenger(radio, Sender(number, self.key, most), receiver, loss=loss, random=random)

    def robot(self, number: int) -> Robot:
        """Return the initial state of the robot with a given number."""
        return Robot(number, self.scenario.brief, *self._of(number))
