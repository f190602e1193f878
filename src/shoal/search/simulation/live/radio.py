"""A robot's radio: UDP on the loopback interface, to a multicast group, or to each robot's port where multicast cannot be had.

Anybody on the machine can send to it. So each message carries a signature (HMAC-SHA-256) by a key that only the robots of one
search have; what has none is dropped and counted.
"""

from __future__ import annotations

import hmac
import socket
import struct
import sys
from collections.abc import Sequence
from contextlib import closing
from random import Random
from typing import Literal

Channel = Literal["multicast", "unicast"]
GROUP = "239.83.72.76"  # within the block for private use (RFC 2365, section 6.2)
LOOPBACK = "127.0.0.1"
SIGNATURE = 32  # bytes before each message
LARGEST = 65_507 - SIGNATURE  # bytes of a message: what a datagram holds besides
_WAITING = 1 << 20  # bytes that wait to be heard
_AT_ONCE = 1000  # messages that are taken before the robot does something else


def listener(group: str, port: int) -> socket.socket:
    """Return a socket that hears a multicast group on the loopback interface; others may listen beside it."""
    ear = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        ear.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if sys.platform != "linux":  # there the option above does not let several listen at one port
            ear.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        ear.bind((group, port))
        member = struct.pack("4s4s", socket.inet_aton(group), socket.inet_aton(LOOPBACK))
        ear.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
    except BaseException:
        ear.close()
        raise
    return ear


def speaker(channel: Channel) -> socket.socket:
    """Return a socket at a port of its own that sends on the loopback interface and no farther."""
    mouth = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        mouth.bind((LOOPBACK, 0))
        if channel == "multicast":
            mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(LOOPBACK))
            mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
            mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
    except BaseException:
        mouth.close()
        raise
    return mouth


def reserve(group: str = GROUP, port: int = 0) -> socket.socket | None:
    """Return a socket on a port of the group, 0 for one that nobody else uses, or None where multicast cannot be had.

    The port stays taken until the socket is closed. One datagram was sent to it and heard there.
    """
    try:
        if not port:
            with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
                probe.bind((group, 0))
                port = int(probe.getsockname()[1])
        ear = listener(group, port)
    except OSError:
        return None
    try:
        with closing(speaker("multicast")) as mouth:
            mouth.sendto(b"?", (group, port))
            ear.settimeout(1.0)
            ear.recv(1)
            return ear
    except OSError:
        ear.close()
        return None


class Radio:
    """The radio of one robot.

    Parameters
    ----------
    channel : str
        "multicast" or "unicast".
    group : str
    port : int
        Of the group; with unicast the robot takes a free port of its own.
    loss : float
        Probability that a message that has come is thrown away unread.
    random : random.Random
        Decides which.
    key : bytes
        By which messages are signed.
    """

    def __init__(
        self, channel: Channel, *, group: str = GROUP, port: int = 0, loss: float = 0.0, random: Random, key: bytes = b""
    ) -> None:
        self._loss, self._random, self._key = loss, random, key
        self._mouth = speaker(channel)
        self._ear = listener(group, port) if channel == "multicast" else self._mouth
        self._ear.setblocking(False)
        self._ear.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _WAITING)
        self._own = self._mouth.getsockname()
        self.port = int(self._own[1])
        self._channel = channel
        self._others: list[tuple[str, int]] = [(group, port)] if channel == "multicast" else []
        self.sent = self.heard = self.lost = self.dropped = 0

    def fileno(self) -> int:
        """Return the descriptor on which messages come."""
        return self._ear.fileno()

    def tell(self, ports: Sequence[int]) -> None:
        """Take note of the ports of all robots; only without multicast they are needed."""
        if self._channel == "unicast":
            self._others = [(LOOPBACK, port) for port in ports if port != self.port]

    def send(self, message: bytes) -> None:
        """Broadcast; what the system does not take is lost."""
        self.sent += 1
        message = self._signature(message) + message
        for other in self._others:
            try:
                self._mouth.sendto(message, other)
            except OSError:
                self.lost += 1

    def receive(self) -> list[bytes]:
        """Return the messages that have come from robots of this search and are not lost; drop those of others."""
        messages: list[bytes] = []
        for _ in range(_AT_ONCE):
            try:
                data, sender = self._ear.recvfrom(SIGNATURE + LARGEST)
            except BlockingIOError:
                return messages
            except ConnectionError:  # a system may report here that another robot's port is closed
                continue
            if sender == self._own:
                continue
            signature, message = data[:SIGNATURE], data[SIGNATURE:]
            if not hmac.compare_digest(signature, self._signature(message)):
                self.dropped += 1
                continue
            self.heard += 1
            if self._random.random() < self._loss:
                self.lost += 1
            else:
                messages.append(message)
        return messages

    def _signature(self, message: bytes) -> bytes:
        return hmac.digest(self._key, message, "sha256")

    def close(self) -> None:
        """Close the sockets."""
        self._ear.close()
        self._mouth.close()
