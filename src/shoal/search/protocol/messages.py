"""Content of the robots' messages, and its encoding as bytes.

A beacon, which a robot broadcasts regularly, contains facts. A robot understands each fact without any other message, so the
protocol tolerates lost, duplicated and reordered messages. A beacon that is too long for one message is divided into several
messages. In a message, small numbers take fewer bytes than large numbers, and intervals of cells represent a set of cells.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Literal, get_args

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.cells.footprint import WIDEST
from shoal.search.tours.bitset import bits_of_intervals, intervals

Status = Literal["listening", "searching", "waiting", "complete"]
LONGEST = 1200  # default maximum length of a message in bytes, which networks transmit in one piece
SHORTEST = 64  # smallest maximum length of a message that a user may choose, in bytes
MOST_CELLS = 1 << 26  # maximum number of cells of a tour
MOST_ROBOTS = 1 << 16
LAG_UNIT = 1 / 16


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """The report of a robot about itself.

    The attribute ``robot`` is the robot's number, and ``count`` is the number of beacons that the robot has sent. The attribute
    ``start`` is the robot's start cell, and ``rate`` is its declared speed. The attribute ``width`` is the width of the robot's
    footprint in cells. The attribute ``place`` is the robot's target cell, or its current cell if it has no target. The attribute
    ``lag`` is the real duration of all paths of the robot so far, minus the duration of these paths at the declared speed.
    """

    robot: int
    count: int
    start: int
    rate: float
    status: Status
    width: int = 1
    place: int = 0
    lag: float = 0.0


@dataclass(frozen=True, slots=True)
class Beacon:
    """The regular broadcast of a robot. Later beacons repeat the facts of a beacon, so that the loss of one message does no harm.

    Parameters
    ----------
    sender : int
        Number of the robot that sends the beacon.
    heartbeats : tuple of Heartbeat
        Heartbeat of the sender, followed by heartbeats that the sender has received from other robots.
    searched : tuple of (int, int)
        Pairs of a robot's number and the bitset of cells that this robot reports as searched.
    found : tuple of (int, int)
        Pairs of the tour index of a cell and the bitset of the robots that found something in this cell.
    closed : tuple of (int, int)
        Pairs of a robot's number and the bitset of cells that this robot reports as blocked.
    """

    sender: int
    heartbeats: tuple[Heartbeat, ...]
    searched: tuple[tuple[int, int], ...] = ()
    found: tuple[tuple[int, int], ...] = ()
    closed: tuple[tuple[int, int], ...] = ()


_STATUSES: tuple[Status, ...] = get_args(Status)
_FASTEST, _LATEST = 1e9, 1 << 40
_WIDTHS = range(1, WIDEST + 1, 2)
_HEARTBEAT, _SEARCHED, _FOUND, _CLOSED = range(4)  # kinds of facts
_RATED, _WIDE = 4, 8  # flags beside the status


def encode_beacon(beacon: Beacon, most: int = LONGEST) -> list[bytes]:
    r"""Return a beacon as the bodies of one or several messages. Each body is at most ``most`` bytes long.

    Parameters
    ----------
    beacon : Beacon
    most : int
        Maximum length of a body in bytes, at least 40.

    Examples
    --------
    >>> beacon = Beacon(1, (Heartbeat(1, 0, 5, 1.0, "listening"),), ((1, 0b111100000),))
    >>> encode_beacon(beacon)
    [b'\x00\x01\x00\x00\x05\x00\x00\x01\x01\x01\x05\x04']
    >>> decode_beacon(1, encode_beacon(beacon)[0]) == beacon
    True
    """
    bodies, body = [], bytearray()
    for fact in _facts(beacon):
        if len(body) + len(fact) > most and body:
            bodies.append(bytes(body))
            body = bytearray()
        body += fact
    return [*bodies, bytes(body)]


def _facts(beacon: Beacon) -> Iterator[bytes]:
    """Yield the content of a beacon as byte strings. A receiver understands each byte string without the others."""
    for heartbeat in beacon.heartbeats:
        yield _told(heartbeat)
    for kind, sets in ((_SEARCHED, beacon.searched), (_FOUND, beacon.found), (_CLOSED, beacon.closed)):
        for number, bits in sets:
            yield from _pieces(_numbers(kind, number), intervals(bits))


def _told(heartbeat: Heartbeat) -> bytes:
    flags = _STATUSES.index(heartbeat.status) | _RATED * (heartbeat.rate != 1.0) | _WIDE * (heartbeat.width > 1)
    lag = round(heartbeat.lag / LAG_UNIT)
    told = _numbers(_HEARTBEAT, heartbeat.robot, heartbeat.count, flags, heartbeat.start, heartbeat.place, lag)
    if heartbeat.rate != 1.0:
        told += struct.pack("<d", heartbeat.rate)
    return told + _numbers(heartbeat.width) if heartbeat.width > 1 else told


_PIECE = 32  # maximum bytes of intervals in a byte string, which must fit into the shortest message


def _pieces(head: bytes, found: Iterable[tuple[int, int]]) -> Iterator[bytes]:
    """Yield short byte strings that together encode a set of intervals. Each byte string begins with the bytes ``head``.

    An interval is encoded as two numbers: its distance from the end of the previous interval in the same byte string, and its
    length.
    """
    body, count, end = bytearray(), 0, 0
    for first, length in found:
        if len(body) > _PIECE - 10:
            yield head + _numbers(count) + bytes(body)
            body, count, end = bytearray(), 0, 0
        body += _numbers(first - end, length)
        count, end = count + 1, first + length
    yield head + _numbers(count) + bytes(body)


def _numbers(*numbers: int) -> bytes:
    """Return whole numbers, 0 or more, as bytes: the base-128 digits of each number, with the lowest digit first.

    Each byte of a number except its last byte has the high bit set.
    """
    body = bytearray()
    for number in numbers:
        rest = number
        while rest > 0x7F:
            body.append(rest & 0x7F | 0x80)
            rest >>= 7
        body.append(rest)
    return bytes(body)


@lru_cache(maxsize=256)  # in a simulation, all robots decode the same bytes
def decode_beacon(sender: int, body: bytes, *, cells: int = MOST_CELLS, robots: int = MOST_ROBOTS) -> Beacon:
    """Return the beacon, or the part of a beacon, that the body of a message contains.

    Parameters
    ----------
    sender : int
        Number of the robot that sent the message.
    body : bytes
        The message without its envelope.
    cells : int
        Number of cells of the tour. Cell numbers in the message must be smaller than ``cells``.
    robots : int
        Robot numbers in the message must be smaller than ``robots``.

    Raises
    ------
    InvalidInputError
        If the body of the message is incomplete, or contains a number that is out of range.
    """
    reader, heartbeats = _Reader(body), []
    sets: dict[int, dict[int, int]] = {_SEARCHED: {}, _FOUND: {}, _CLOSED: {}}
    while reader.at < len(body):
        kind = reader.number(_CLOSED)
        if kind == _HEARTBEAT:
            heartbeats.append(_heartbeat(reader, cells, robots))
            continue
        keys, members = (cells, robots) if kind == _FOUND else (robots, cells)
        number = reader.number(keys - 1)
        bits = bits_of_intervals(reader.intervals(members))
        sets[kind][number] = sets[kind].get(number, 0) | bits
    return Beacon(sender, tuple(heartbeats), *(tuple(sets[kind].items()) for kind in (_SEARCHED, _FOUND, _CLOSED)))


def _heartbeat(reader: _Reader, cells: int, robots: int) -> Heartbeat:
    robot, count, flags = reader.number(robots - 1), reader.number(_LATEST), reader.number(15)
    start, place, lag = reader.number(cells - 1), reader.number(cells - 1), reader.number(_LATEST) * LAG_UNIT
    rate = reader.real() if flags & _RATED else 1.0
    width = reader.number(WIDEST) if flags & _WIDE else 1
    if not 0 < rate <= _FASTEST or width not in _WIDTHS:
        raise InvalidInputError(f"beacon: expected a rate above 0, at most {_FASTEST:g}, and an odd width, got {rate} and {width}")
    return Heartbeat(robot, count, start, rate, _STATUSES[flags & 3], width, place, lag)


class _Reader:
    """An object that reads the body of a message from its beginning to its end."""

    def __init__(self, body: bytes) -> None:
        self.body, self.at = body, 0

    def number(self, most: int) -> int:
        number, shift = 0, 0
        for byte in self.body[self.at : self.at + 10]:
            number |= (byte & 0x7F) << shift
            shift, self.at = shift + 7, self.at + 1
            if byte < 0x80:
                if number > most:
                    raise InvalidInputError(f"beacon: expected a number of at most {most}, got {number}")
                return number
        raise InvalidInputError(f"beacon: expected a number at byte {self.at}, got the end of the message")

    def real(self) -> float:
        if len(self.body) < self.at + 8:
            raise InvalidInputError("beacon: expected a rate, got the end of the message")
        self.at += 8
        return float(struct.unpack_from("<d", self.body, self.at - 8)[0])

    def intervals(self, most: int) -> list[tuple[int, int]]:
        """Read and return intervals of whole numbers below ``most``, as pairs (first number, length)."""
        found, end = [], 0
        for _ in range(self.number(len(self.body))):
            first = end + self.number(most - 1)
            end = first + self.number(most)
            if end > most:
                raise InvalidInputError(f"beacon: expected numbers less than {most}, got {end - 1}")
            found.append((first, end - first))
        return found
