"""The envelope of a message: version, sender and time stamp before the content, and a signature or checksum after the content.

A stamp is the time of the sender's clock in milliseconds. If a sender's clock has not advanced since its previous message, the
stamp is the previous stamp plus 1. A receiver opens only one message with a given sender and stamp. A receiver refuses a message
whose stamp is too far from the receiver's clock, or older than the 64 newest stamps of the same sender. The clock of a receiver
goes on while the receiver is switched off, so even after a pause the receiver refuses old messages that an attacker sends again.
"""

from __future__ import annotations

import hmac
from zlib import crc32

from shoal.core.errors import InvalidInputError
from shoal.search.protocol.messages import LONGEST, Beacon, decode_beacon, encode_beacon

VERSION = 2
_HEAD = 9  # bytes: version, sender (2), stamp (6)
_SIGNATURE, _CHECKSUM = 8, 4  # bytes
_SHARE = 1000  # maximum number of messages per sender and second
_REMEMBERED = 64  # number of stamps that a receiver remembers for each sender


def _seal(key: bytes, message: bytes) -> bytes:
    """Return the last bytes of a message: a shortened HMAC-SHA-256, or a CRC-32 checksum if the key is empty."""
    return hmac.digest(key, message, "sha256")[:_SIGNATURE] if key else crc32(message).to_bytes(_CHECKSUM, "little")


class Sender:
    """An object that creates the messages of one robot.

    Parameters
    ----------
    number : int
        Number of the robot.
    key : bytes
        Key that signs the messages. With the empty key b"", messages have a checksum instead of a signature.
    most : int
        Maximum length of a message in bytes.
    """

    def __init__(self, number: int, key: bytes = b"", most: int = LONGEST) -> None:
        self._number, self._key, self._most, self._stamp = number, key, most, -1

    def messages(self, beacon: Beacon, clock: int) -> list[bytes]:
        """Return the messages that transmit a beacon. ``clock`` is the present time of the sender's clock in milliseconds."""
        room = self._most - _HEAD - (_SIGNATURE if self._key else _CHECKSUM)
        return [self._message(body, clock) for body in encode_beacon(beacon, room)]

    def _message(self, body: bytes, clock: int) -> bytes:
        self._stamp = max(self._stamp + 1, clock)
        message = bytes([VERSION]) + self._number.to_bytes(2, "little") + self._stamp.to_bytes(6, "little") + body
        return message + _seal(self._key, message)


class Receiver:
    """An object that opens or refuses the messages that arrive at one robot.

    Parameters
    ----------
    key : bytes
        Key that signs the messages. With the empty key b"", messages have a checksum instead of a signature.
    robots, cells : int
        Number of robots and number of cells. The numbers of robots begin with 1, and the numbers of cells begin with 0.
    most : int
        Maximum length of a message in bytes. The receiver refuses longer messages without reading them.
    window : int
        Maximum difference in milliseconds between a message's stamp and the receiver's clock.
    """

    def __init__(self, key: bytes = b"", *, robots: int, cells: int, most: int = LONGEST, window: int = 60_000) -> None:
        self.most = most
        self._key, self._robots, self._cells, self._window = key, robots, cells, window
        self._stamps: dict[int, set[int]] = {}
        self._floors: dict[int, int] = {}
        self._counts: dict[int, tuple[int, int]] = {}

    def open(self, message: bytes, clock: int) -> Beacon:
        """Return the content of a message. ``clock`` is the present time of the receiver's clock in milliseconds.

        Raises
        ------
        InvalidInputError
            If the message is damaged, too long, too old or already opened, has no valid signature, or belongs to another search or
            version. The receiver also refuses a message if its sender has sent too many messages in the current second.
        """
        end = len(message) - (_SIGNATURE if self._key else _CHECKSUM)
        if not end >= _HEAD or len(message) > self.most or message[0] != VERSION:
            raise InvalidInputError(
                f"message: expected at most {self.most} bytes of version {VERSION}, got {len(message)} bytes of another "
                "version or length"
            )
        sender, stamp = int.from_bytes(message[1:3], "little"), int.from_bytes(message[3:9], "little")
        if not 1 <= sender <= self._robots or abs(stamp - clock) > self._window:
            raise InvalidInputError(
                f"message: expected a present time and a robot from 1 to {self._robots}, got another time or robot {sender}"
            )
        if stamp <= self._floors.get(sender, -1) or stamp in self._stamps.get(sender, ()):
            raise InvalidInputError(f"message: expected a new message, got an old message of robot {sender}")
        if not hmac.compare_digest(message[end:], _seal(self._key, message[:end])):
            raise InvalidInputError("message: expected a signature by the key of this search, or a correct checksum, got another")
        self._count(sender, clock)
        self._remember(sender, stamp)
        return decode_beacon(sender, message[_HEAD:end], cells=self._cells, robots=self._robots + 1)

    def _count(self, sender: int, clock: int) -> None:
        """Refuse a message if its sender has already sent the maximum number of messages in the current second."""
        second, count = self._counts.get(sender, (-1, 0))
        count = count + 1 if second == clock // 1000 else 1
        self._counts[sender] = clock // 1000, count
        if count > _SHARE:
            raise InvalidInputError(f"message: expected at most {_SHARE} messages per second of robot {sender}, got more")

    def _remember(self, sender: int, stamp: int) -> None:
        stamps = self._stamps.setdefault(sender, set())
        stamps.add(stamp)
        if len(stamps) > _REMEMBERED:
            self._floors[sender] = min(stamps)
            stamps.remove(self._floors[sender])
