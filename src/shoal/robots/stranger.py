"""A stranger on the radio of a search: forged, replayed and broken packets, for rehearsals."""

from __future__ import annotations

import socket
import time
from collections import Counter, deque
from collections.abc import Sequence
from contextlib import ExitStack
from random import Random
from types import TracebackType
from typing import Self

from shoal.search.protocol.messages import Beacon, Heartbeat, Sender
from shoal.search.tours.masks import bitset_of

_MEMORY = 200  # packets that the stranger keeps to send again
_OLD = 90.0  # seconds after which a packet is certainly too old
_SOCKETS = 3  # sources of the stranger


class Stranger:
    """Somebody who hears all messages on UDP, does not know the key, and sends packets to all.

    Parameters
    ----------
    ear : tuple of (str, int)
        Address to which the robots' messages come, too.
    robots : sequence of (str, int)
        Addresses of the robots' radios.
    cells : int
        Number of cells.
    seed : int

    Attributes
    ----------
    sent : Counter of str
        Numbers of packets sent: "forged", "replayed", "changed", "cut" and "noise".
    """

    def __init__(
        self, ear: tuple[str, int], robots: Sequence[tuple[str, int]], cells: int, *, seed: int = 0
    ) -> None:
        self._robots, self._cells, self._random = robots, cells, Random(seed)
        self.sent: Counter[str] = Counter()
        self._packets: deque[bytes] = deque(maxlen=_MEMORY)
        with ExitStack() as stack:
            self._ear = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            self._ear.bind(ear)
            self._ear.setblocking(False)
            self._mouths = []
            for _ in range(_SOCKETS):
                mouth = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                mouth.bind((ear[0], 0))
                self._mouths.append(mouth)
            self._stack = stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.close()

    def speak(self) -> None:
        """Hear what has come, and send one packet of each kind to a robot each."""
        while True:
            try:
                self._packets.append(self._ear.recv(65_535))
            except OSError:
                break
        packets = {"forged": self._forge_message(), "noise": self._random.randbytes(60)}
        if self._packets:
            real = self._random.choice(self._packets)
            bit = self._random.randrange(8 * len(real))
            changed = bytearray(real)
            changed[bit // 8] ^= 1 << bit % 8
            packets |= {"replayed": real, "changed": bytes(changed), "cut": real[: len(real) // 2]}
        for kind, packet in packets.items():
            mouth = self._random.choice(self._mouths)
            mouth.sendto(packet, self._random.choice(self._robots))
            self.sent[kind] += 1

    def _forge_message(self) -> bytes:
        """Return a message with a key of the stranger's own: that all is searched."""
        number = self._random.randrange(len(self._robots)) + 1
        heartbeat = Heartbeat(number, 1 << 20, 0, 1.0, "complete")
        everything = bitset_of(range(self._cells))
        beacon = Beacon(number, (heartbeat,), ((number, everything),))
        late = _OLD if self._random.random() < 0.5 else 0.0
        clock = round(1000 * (time.time() - late))
        return Sender(number, b"a key of the stranger").messages(beacon, clock)[0]
