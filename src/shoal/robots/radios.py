"""Radios of robots: UDP on one named interface, and serial lines.

A radio broadcasts bytes and receives what others broadcast (`shoal.search.simulation.live.ports`).
It listens on the address that was named, and nowhere else.
"""

from __future__ import annotations

import ipaddress
import os
import re
import socket
import struct
import time
from collections import deque
from contextlib import ExitStack
from functools import cache
from math import inf
from typing import Any
from zlib import crc32

from shoal.core.errors import InvalidInputError, import_extra
from shoal.search.protocol.messages import SHORTEST
from shoal.search.simulation.live.radio import LARGEST, receive_from_others, send_to_all

RADIOS = (
    "udp:HOST:PORT,HOST:PORT,... (own address, then those of the others, a broadcast address or a"
    " multicast group) or serial:DEVICE[,BAUD][,duty=FRACTION]"
)
_ADDRESS = re.compile(r"([^:,\s]+):([0-9]{1,5})")
_SERIAL = re.compile(r"([^@,\s]+)(?:[@,]([1-9][0-9]{2,6}))?(?:,duty=(0?\.[0-9]+|1(?:\.0*)?))?")
_LOOPBACK_BROADCAST = "127.255.255.255"  # to all robots on one computer
_HOPS = 1  # multicast stays on the link of the interface
_DUTY, _CHANNEL = 0.1, 0.5  # largest share of the time in which one robot, and all robots, send
_GIVE_UP = 10.0  # seconds without one message sent after which the radio has a fault


class UdpRadio:
    """A radio over UDP.

    Parameters
    ----------
    host : str
        Address of this computer, or the name of one of its interfaces.
    port : int
    others : sequence of (str, int)
        Addresses of the other robots, one broadcast address, or one multicast group.
    give_up : float
        Seconds without one message sent after which the radio has a fault.

    Attributes
    ----------
    recipients : float
        Number of addresses that it sends to; infinite for a group or a broadcast address.
    """

    most = LARGEST
    rate = inf

    def __init__(
        self, host: str, port: int, others: list[tuple[str, int]], *, give_up: float = _GIVE_UP
    ) -> None:
        own = interface_address(host)
        self.fault, self._others, self._give_up = "", others, give_up
        self._sent_at = time.monotonic()
        groups = [address for address in others if ipaddress.IPv4Address(address[0]).is_multicast]
        casts = [address for address in others if address[0] == _broadcast_of(own)]
        if (groups or casts) and len(others) > 1:
            raise InvalidInputError(
                "radio: expected one multicast group or broadcast address alone, got"
                f" {len(others)} addresses"
            )
        self.recipients = inf if groups or casts else len({*others})
        if (own, port) in others:
            raise InvalidInputError(
                f"radio: expected the addresses of other robots, got the own one again, {own}:{port}"
            )
        with ExitStack() as stack:
            self._mouth = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            self._ear = self._mouth
            if groups or casts:
                # a socket that is bound to a group or a broadcast address hears nothing else
                self._mouth.bind((own, 0))
                self._ear = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                self._ear.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                self._ear.bind(others[0])
            else:
                self._mouth.bind((own, port))
            if casts:
                self._mouth.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            if groups:
                at = socket.inet_aton(own)
                self._mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, at)
                self._mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, _HOPS)
                member = struct.pack("4s4s", socket.inet_aton(groups[0][0]), at)
                self._ear.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
                if hasattr(socket, "IP_MULTICAST_ALL"):
                    self._ear.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_ALL, 0)
            self._ear.setblocking(False)
            stack.pop_all()
        self._own = self._mouth.getsockname()

    def fileno(self) -> int:
        """Return the file descriptor of the socket that listens."""
        return self._ear.fileno()

    def broadcast(self, message: bytes) -> int:
        """Send a message to all others."""
        refused = send_to_all(self._mouth, message, self._others)
        now = time.monotonic()
        if refused < len(self._others) or not self._others:
            self._sent_at = now
        elif now - self._sent_at > self._give_up:
            self.fault = f"radio: no message could be sent for {now - self._sent_at:.0f} s"
        return refused

    def receive(self) -> tuple[bytes, object] | None:
        """Return a message from another."""
        return receive_from_others(self._ear, self._own)

    def close(self) -> None:
        """Close the sockets."""
        self._ear.close()
        self._mouth.close()


def interface_address(host: str) -> str:
    """Return the IPv4 address of this computer that a host name, an address or the name of an
    interface means.

    Raises
    ------
    InvalidInputError
    """
    if host in {name for _, name in socket.if_nameindex()}:
        own = _ask_interface(host, 0x8915)  # SIOCGIFADDR
        if own is None:
            raise InvalidInputError(f"radio: expected an interface with an address, got {host}")
        return own
    try:
        address = str(socket.getaddrinfo(host, None, socket.AF_INET)[0][4][0])
    except OSError:
        raise InvalidInputError(
            f"radio: expected an address or an interface of this computer, got {host!r}"
        ) from None
    if ipaddress.IPv4Address(address).is_unspecified:
        raise InvalidInputError(
            f"radio: expected the address or the name of one interface, got {host}, which means all"
        )
    return address


def _ask_interface(name: str, request: int) -> str | None:
    try:
        import fcntl

        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            reply = fcntl.ioctl(probe.fileno(), request, struct.pack("256s", name.encode()[:15]))
        return socket.inet_ntoa(reply[20:24])
    except (ImportError, OSError):
        return None


def _broadcast_of(own: str) -> str | None:
    """Return the broadcast address of the interface with an address."""
    if ipaddress.IPv4Address(own).is_loopback:
        return _LOOPBACK_BROADCAST
    for _, name in socket.if_nameindex():
        if _ask_interface(name, 0x8915) == own:
            broadcast = _ask_interface(name, 0x8919)  # SIOCGIFBRDADDR
            return None if broadcast in (None, "0.0.0.0") else broadcast
    return None


class SerialRadio:
    """A radio on a serial line, which all robots hear, as through radio modems.

    A message travels in a frame of its own: the message and its CRC-32, Reed-Solomon parity that
    repairs broken bytes, and COBS, so that zero bytes occur between frames alone. Messages are cut
    to fit a frame by the protocol, and each part says something without the others.

    Parameters
    ----------
    device : str
    baud : int
    duty : float
        Largest fraction of the time in which the radio sends, on average over a few beacons.
    give_up : float
        Seconds without one frame written after which the radio has a fault.

    Attributes
    ----------
    bytes_sent, broken, overdue : int
        Numbers of bytes sent, of frames that were broken beyond repair, and of messages that were
        given up because too many others waited.
    """

    most = SHORTEST
    recipients = inf

    def __init__(
        self, device: str, baud: int = 57600, *, duty: float = 0.1, give_up: float = _GIVE_UP
    ) -> None:
        serial = import_extra("serial", f"the radio serial:{device} needs pyserial", extra="serial")
        _codec()  # it, too, must be there before the search
        self.fault, self._give_up = "", give_up
        try:
            self._port: Any = serial.Serial(device, baud, timeout=0, write_timeout=0)
        except (OSError, ValueError) as error:
            raise InvalidInputError(
                f"radio: expected a serial line that opens, got {device}: {error}"
            ) from None
        self._line_rate = duty * baud / 10  # bytes a second with start and stop bits
        self.rate = self._line_rate * SHORTEST / LONGEST_FRAME
        self._waiting: deque[bytes] = deque()
        self._credit, self._counted_at = 0.0, time.monotonic()
        self._sent_at = self._counted_at
        self._rest = self._frame = b""  # the beginnings of frames that come, and the end of one
        self._frames: deque[bytes] = deque()
        self.bytes_sent = self.broken = self.overdue = 0

    def fileno(self) -> int:
        """Return the file descriptor of the line."""
        return int(self._port.fileno())

    def broadcast(self, message: bytes) -> int:
        """Send a message as soon as the duty cycle allows. Return 1 if an older message is given up
        for it, because too many wait, and 0 otherwise.
        """
        self._waiting.append(message)
        given_up = len(self._waiting) > _QUEUE
        if given_up:  # the oldest, whose news later messages repeat
            self._waiting.popleft()
            self.overdue += 1
        self._send_due()
        return int(given_up)

    def _send_due(self) -> None:
        now = time.monotonic()
        earned = (now - self._counted_at) * self._line_rate
        self._credit = min(self._credit + earned, _QUEUE * LONGEST_FRAME)
        self._counted_at = now
        while self._frame or (self._waiting and self._credit >= LONGEST_FRAME):
            if not self._frame:
                self._frame = encode_frame(self._waiting.popleft())
                self._credit -= len(self._frame)
            try:  # not by pyserial, which waits for a line that takes nothing
                written = os.write(self.fileno(), self._frame)
            except OSError as error:
                if now - self._sent_at > self._give_up:
                    self.fault = f"radio: the serial line cannot be written: {error.strerror}"
                return
            self._frame, self._sent_at = self._frame[written:], now
            self.bytes_sent += written
        if not self._waiting:
            self._sent_at = now

    def receive(self) -> tuple[bytes, object] | None:
        """Return a message that has come."""
        self._send_due()
        if not self._frames:
            try:
                data = self._port.read(4096)
            except OSError as error:
                self.fault = f"radio: the serial line cannot be read: {error}"
                return None
            *frames, self._rest = (self._rest + data).split(b"\0")
            self._rest = self._rest[-2 * LONGEST_FRAME :]
            self._frames.extend(frame for frame in frames if frame)
        while self._frames:
            message = decode_frame(self._frames.popleft())
            if message is not None:
                return message, "serial"
            self.broken += 1
        return None

    def close(self) -> None:
        """Close the line."""
        self._port.close()


_QUEUE = 16  # messages that wait for the duty cycle, and that may be sent at once
PARITY = 28  # bytes of a frame, half as many of which may be broken
_LONGEST = SHORTEST + 4 + PARITY  # bytes, of the 254 that COBS takes with one byte more
LONGEST_FRAME = _LONGEST + 3  # bytes with that one, and a zero at both ends


def encode_frame(message: bytes) -> bytes:
    """Return a message of at most 64 bytes as a frame.

    Examples
    --------
    >>> frame = encode_frame(b"where are you?")
    >>> len(frame), decode_frame(b"spoiled" + frame[8:-1])
    (49, b'where are you?')
    """
    content = message + crc32(message).to_bytes(4, "little")
    return b"\0" + _stuff(bytes(_codec().encode(content))) + b"\0"


def decode_frame(frame: bytes) -> bytes | None:
    """Return the message in a frame without its zero bytes; None if it is broken beyond repair."""
    content = _unstuff(frame)
    # a zero byte beside the frame that was broken is one byte too much
    for candidate in (content, content[:-1], _unstuff(frame[1:])):
        if not PARITY + 4 < len(candidate) <= _LONGEST:
            continue
        try:
            repaired = bytes(_codec().decode(candidate)[0])
        except (_decoding_error(), ZeroDivisionError):
            continue
        if crc32(repaired[:-4]).to_bytes(4, "little") == repaired[-4:]:
            return repaired[:-4]
    return None


@cache
def _codec() -> Any:
    reedsolo = import_extra("reedsolo", "serial radios need reedsolo", extra="serial")
    return reedsolo.RSCodec(PARITY)


@cache
def _decoding_error() -> type[Exception]:
    reedsolo = import_extra("reedsolo", "serial radios need reedsolo", extra="serial")
    error: type[Exception] = reedsolo.ReedSolomonError
    return error


def _stuff(content: bytes) -> bytes:
    """Return at most 254 bytes without their zeros: before each piece between zeros its length and
    one (COBS: Cheshire and Baker 1999).
    """
    return b"".join(bytes([len(piece) + 1]) + piece for piece in content.split(b"\0"))


def _unstuff(frame: bytes) -> bytes:
    """Undo `_stuff` as far as it makes sense. A broken length misplaces single zeros alone, which
    the parity repairs.
    """
    content, at = bytearray(), 0
    while at < len(frame):
        length = max(frame[at], 1)
        content += frame[at + 1 : at + length]
        at += length
        content.append(0)
    return bytes(content[: max(len(frame) - 1, 0)])


def open_radio(text: str, *, robots: int = 1, give_up: float = _GIVE_UP) -> UdpRadio | SerialRadio:
    """Open a radio such as ``udp:192.168.1.7:9000,192.168.1.8:9000``.

    Parameters
    ----------
    text : str
    robots : int
        Number of robots that share the channel of a serial radio. By default, a radio sends a tenth
        of the time, or less, so that all together send half of the time at most.
    give_up : float
        Seconds without one message sent after which the radio has a fault.

    Raises
    ------
    InvalidInputError
        If the text names no radio, or if the radio cannot be opened.
    """
    kind, _, endpoint = text.partition(":")
    if kind == "serial" and (serial := _SERIAL.fullmatch(endpoint)):
        if serial[3] and float(serial[3]) == 0:
            raise InvalidInputError(f"radio: expected a duty above 0, got {text!r}")
        duty = float(serial[3]) if serial[3] else min(_DUTY, _CHANNEL / robots)
        return SerialRadio(serial[1], int(serial[2] or 57600), duty=duty, give_up=give_up)
    matches = [_ADDRESS.fullmatch(part) for part in endpoint.split(",")]
    if kind != "udp" or not all(match and 0 < int(match[2]) < 65536 for match in matches):
        raise InvalidInputError(f"radio: expected {RADIOS}, got {text!r}")
    own, *others = [(match[1], int(match[2])) for match in matches if match]
    if not others:
        raise InvalidInputError(
            f"radio: expected the addresses of other robots after the own one, got {text!r}"
        )
    resolved = []
    for host, port in others:
        try:
            address = str(socket.getaddrinfo(host, None, socket.AF_INET)[0][4][0])
        except OSError:
            raise InvalidInputError(f"radio: expected an address, got {host!r}") from None
        resolved.append((address, port))
    try:
        return UdpRadio(*own, resolved, give_up=give_up)
    except OSError as error:
        raise InvalidInputError(
            f"radio: expected an address of this computer that is free, got {own[0]}:{own[1]}:"
            f" {error.strerror or os.strerror(error.errno or 0)}"
        ) from None
