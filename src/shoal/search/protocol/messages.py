"""The messages of the protocol, and the envelope that carries them."""

from __future__ import annotations

import hmac
import struct
from collections.abc import Iterable, Iterator
from functools import lru_cache
from typing import Literal, get_args
from zlib import crc32

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.cells.footprint import WIDEST
from shoal.search.kernels.protocol.numbers import FULL_PIECE, LAG_UNIT, REMEMBERED, SHARE
from shoal.search.tours.masks import bits_of_intervals, intervals

Status = Literal["listening", "searching", "waiting", "complete"]
LONGEST = 1200  # default maximum length of a message in bytes, which networks transmit in one piece
SHORTEST = 64  # smallest maximum length of a message that a user may choose, in bytes
MOST_CELLS = 1 << 26  # maximum number of cells of a tour
MOST_ROBOTS = 1 << 16


@dataclass(frozen=True, slots=True)
class Heartbeat:
    """The report of a robot about itself.

    The attribute ``robot`` is the robot's number, and ``count`` is the number of beacons that the
    robot has sent. The attribute ``start`` is the robot's start cell, and ``rate`` is its declared
    speed. The attribute ``width`` is the width of the robot's footprint in cells. The attribute
    ``place`` is the robot's target cell, or its current cell if it has no target. The attribute
    ``lag`` is the real duration of all paths of the robot so far, minus the duration of these paths
    at the declared speed.
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
    """The regular broadcast of a robot. Later beacons repeat the facts of a beacon, so that the
    loss of one message does no harm.

    Parameters
    ----------
    sender : int
        Number of the robot that sends the beacon.
    heartbeats : tuple of Heartbeat
        Heartbeat of the sender, followed by heartbeats that the sender has received from other
        robots.
    searched : tuple of (int, int)
        Pairs of a robot's number and the bitset of cells that this robot reports as searched.
    found : tuple of (int, int)
        Pairs of the tour index of a cell and the bitset of the robots that found something in this
        cell.
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
    r"""Return a beacon as the bodies of one or several messages. Each body is at most ``most``
    bytes long.

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
    """Yield the content of a beacon as byte strings. A receiver understands each byte string
    without the others.
    """
    for heartbeat in beacon.heartbeats:
        yield _encode_heartbeat(heartbeat)
    for kind, sets in (
        (_SEARCHED, beacon.searched),
        (_FOUND, beacon.found),
        (_CLOSED, beacon.closed),
    ):
        for number, bits in sets:
            yield from _pieces(_numbers(kind, number), intervals(bits))


def _encode_heartbeat(heartbeat: Heartbeat) -> bytes:
    flags = (
        _STATUSES.index(heartbeat.status)
        | _RATED * (heartbeat.rate != 1.0)
        | _WIDE * (heartbeat.width > 1)
    )
    lag = round(heartbeat.lag / LAG_UNIT)
    body = _numbers(
        _HEARTBEAT, heartbeat.robot, heartbeat.count, flags, heartbeat.start, heartbeat.place, lag
    )
    if heartbeat.rate != 1.0:
        body += struct.pack("<d", heartbeat.rate)
    return body + _numbers(heartbeat.width) if heartbeat.width > 1 else body


def _pieces(head: bytes, spans: Iterable[tuple[int, int]]) -> Iterator[bytes]:
    """Yield short byte strings that together encode a set of intervals. Each byte string begins
    with the bytes ``head``.

    An interval is encoded as two numbers: its distance from the end of the previous interval in the
    same byte string, and its length.
    """
    body, count, end = bytearray(), 0, 0
    for first, length in spans:
        if len(body) > FULL_PIECE:
            yield head + _numbers(count) + bytes(body)
            body, count, end = bytearray(), 0, 0
        body += _numbers(first - end, length)
        count, end = count + 1, first + length
    yield head + _numbers(count) + bytes(body)


def _numbers(*numbers: int) -> bytes:
    """Return whole numbers, 0 or more, as bytes: the base-128 digits of each number, with the
    lowest digit first.

    Each byte of a number except its last byte has the high bit set.
    """
    body = bytearray()
    for number in numbers:
        remainder = number
        while remainder > 0x7F:
            body.append(remainder & 0x7F | 0x80)
            remainder >>= 7
        body.append(remainder)
    return bytes(body)


@lru_cache(maxsize=256)  # in a simulation, all robots decode the same bytes
def decode_beacon(
    sender: int, body: bytes, *, cells: int = MOST_CELLS, robots: int = MOST_ROBOTS
) -> Beacon:
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
    return Beacon(
        sender,
        tuple(heartbeats),
        *(tuple(sets[kind].items()) for kind in (_SEARCHED, _FOUND, _CLOSED)),
    )


def _heartbeat(reader: _Reader, cells: int, robots: int) -> Heartbeat:
    robot, count, flags = reader.number(robots - 1), reader.number(_LATEST), reader.number(15)
    start, place, lag = (
        reader.number(cells - 1),
        reader.number(cells - 1),
        reader.number(_LATEST) * LAG_UNIT,
    )
    rate = reader.real() if flags & _RATED else 1.0
    width = reader.number(WIDEST) if flags & _WIDE else 1
    if not 0 < rate <= _FASTEST or width not in _WIDTHS:
        raise InvalidInputError(
            f"beacon: expected a rate above 0, at most {_FASTEST:g}, and an odd width, got {rate}"
            f" and {width}"
        )
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
                    raise InvalidInputError(
                        f"beacon: expected a number of at most {most}, got {number}"
                    )
                return number
        raise InvalidInputError(
            f"beacon: expected a number at byte {self.at}, got the end of the message"
        )

    def real(self) -> float:
        if len(self.body) < self.at + 8:
            raise InvalidInputError("beacon: expected a rate, got the end of the message")
        self.at += 8
        return float(struct.unpack_from("<d", self.body, self.at - 8)[0])

    def intervals(self, most: int) -> list[tuple[int, int]]:
        """Read and return intervals of whole numbers below ``most``, as pairs (first number,
        length).
        """
        pairs, end = [], 0
        for _ in range(self.number(len(self.body))):
            first = end + self.number(most - 1)
            end = first + self.number(most)
            if end > most:
                raise InvalidInputError(f"beacon: expected numbers less than {most}, got {end - 1}")
            pairs.append((first, end - first))
        return pairs


VERSION = 2
_HEAD = 9  # bytes: version, sender (2), stamp (6)
_SIGNATURE, _CHECKSUM = 8, 4  # bytes


def _seal(key: bytes, message: bytes) -> bytes:
    """Return the last bytes of a message: a shortened HMAC-SHA-256, or a CRC-32 checksum if the key
    is empty.
    """
    return (
        hmac.digest(key, message, "sha256")[:_SIGNATURE]
        if key
        else crc32(message).to_bytes(_CHECKSUM, "little")
    )


def longest_body(most: int, *, signed: bool) -> int:
    """Return the maximum length of a message's body in bytes."""
    return most - _HEAD - (_SIGNATURE if signed else _CHECKSUM)


def stamp_of(message: bytes) -> int:
    """Return the stamp of a message, the time in milliseconds at which it was made."""
    return int.from_bytes(message[3:9], "little")


class RefusedMessageError(InvalidInputError):
    """Raised for a message that a receiver refuses.

    Attributes
    ----------
    reason : str
        The reason in a few words, by which refused messages are counted.
    """

    def __init__(self, text: str, reason: str) -> None:
        super().__init__(text)
        self.reason = reason


class Sender:
    """An object that creates the messages of one robot.

    Parameters
    ----------
    number : int
        Number of the robot.
    key : bytes
        Key that signs the messages. With the empty key b"", messages have a checksum instead of a
        signature.
    most : int
        Maximum length of a message in bytes.
    """

    def __init__(self, number: int, key: bytes = b"", most: int = LONGEST) -> None:
        self.number, self._key, self._most, self._stamp = number, key, most, -1

    def messages(self, beacon: Beacon, clock: int) -> list[bytes]:
        """Return the messages that transmit a beacon. ``clock`` is the present time of the sender's
        clock in milliseconds.
        """
        longest = longest_body(self._most, signed=bool(self._key))
        return [self._message(body, clock) for body in encode_beacon(beacon, longest)]

    def _message(self, body: bytes, clock: int) -> bytes:
        self._stamp = max(self._stamp + 1, clock)
        message = (
            bytes([VERSION])
            + self.number.to_bytes(2, "little")
            + self._stamp.to_bytes(6, "little")
            + body
        )
        return message + _seal(self._key, message)


class Receiver:
    """An object that opens or refuses the messages that arrive at one robot.

    Parameters
    ----------
    key : bytes
        Key that signs the messages. With the empty key b"", messages have a checksum instead of a
        signature.
    robots, cells : int
        Number of robots and number of cells. The numbers of robots begin with 1, and the numbers of
        cells begin with 0.
    most : int
        Maximum length of a message in bytes. The receiver refuses longer messages without reading
        them.
    window : int
        Maximum difference in milliseconds between a message's stamp and the receiver's clock.
    """

    def __init__(
        self,
        key: bytes = b"",
        *,
        robots: int,
        cells: int,
        most: int = LONGEST,
        window: int = 60_000,
    ) -> None:
        self.most = most
        self._key, self._robots, self._cells, self._window = key, robots, cells, window
        self._stamps: dict[int, set[int]] = {}
        self._forgotten: dict[int, int] = {}
        self._counts: dict[int, tuple[int, int]] = {}

    def open(self, message: bytes, clock: int) -> Beacon:
        """Return the content of a message. ``clock`` is the present time of the receiver's clock in
        milliseconds.

        Raises
        ------
        InvalidInputError
            If the message is damaged, too long, too old or already opened, has no valid signature,
            or belongs to another search or version. The receiver also refuses a message if its
            sender has sent too many messages in the current second.
        """
        end = len(message) - (_SIGNATURE if self._key else _CHECKSUM)
        if not end >= _HEAD or len(message) > self.most or message[0] != VERSION:
            raise RefusedMessageError(
                f"message: expected at most {self.most} bytes of version {VERSION}, got"
                f" {len(message)} bytes of another version or length",
                "broken",
            )
        sender, stamp = int.from_bytes(message[1:3], "little"), stamp_of(message)
        if not 1 <= sender <= self._robots or abs(stamp - clock) > self._window:
            raise RefusedMessageError(
                f"message: expected a present time and a robot from 1 to {self._robots}, got"
                f" another time or robot {sender}",
                "time stamp" if 1 <= sender <= self._robots else "unknown robot",
            )
        if stamp <= self._forgotten.get(sender, -1) or stamp in self._stamps.get(sender, ()):
            raise RefusedMessageError(
                f"message: expected a new message, got an old message of robot {sender}", "repeated"
            )
        if not hmac.compare_digest(message[end:], _seal(self._key, message[:end])):
            raise RefusedMessageError(
                "message: expected a signature by the key of this search, or a correct checksum,"
                " got another",
                "another key or search",
            )
        self._count(sender, clock)
        self._remember(sender, stamp)
        return decode_beacon(sender, message[_HEAD:end], cells=self._cells, robots=self._robots + 1)

    def _count(self, sender: int, clock: int) -> None:
        """Refuse a message if its sender has already sent the maximum number of messages in the
        current second.
        """
        second, count = self._counts.get(sender, (-1, 0))
        count = count + 1 if second == clock // 1000 else 1
        self._counts[sender] = clock // 1000, count
        if count > SHARE:
            raise RefusedMessageError(
                f"message: expected at most {SHARE} messages per second of robot {sender}, got"
                " more",
                "too many",
            )

    def _remember(self, sender: int, stamp: int) -> None:
        stamps = self._stamps.setdefault(sender, set())
        stamps.add(stamp)
        if len(stamps) > REMEMBERED:
            self._forgotten[sender] = min(stamps)
            stamps.remove(self._forgotten[sender])
