"""Links that carry MAVLink, and our side of them: a ground station that hears vehicles and speaks
to each under its own address.

The module has its own sockets instead of pymavlink's `mavutil`, which keeps one peer a port: with
two vehicles on one port it answers whichever was heard last.
"""

from __future__ import annotations

import re
import select
import socket
import struct
import threading
import time
from collections import defaultdict, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import field
from typing import IO, Any, Protocol, Self

from shoal.core.checks import check_number, check_text
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, ShoalError, import_extra
from shoal.search.regions.formats.flight_logs import dialect

ARDUPILOT, PX4, NO_AUTOPILOT = 3, 12, 8  # MAV_AUTOPILOT
AUTOPILOTS = {ARDUPILOT: "ArduPilot", PX4: "PX4"}
GROUND_STATION = 6  # MAV_TYPE
ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED
STATION = (255, 190)  # system and component of ground stations: MAV_COMP_ID_MISSIONPLANNER
AUTOPILOT_COMPONENT = 1
BAUD = 57600
KINDS_OF_TYPES: dict[int, frozenset[str]] = {
    **dict.fromkeys((2, 3, 4, 13, 14, 15, 29, 35), frozenset({"multirotor"})),
    1: frozenset({"fixed-wing"}),
    **dict.fromkeys((19, 20, 21, 22, 23, 24, 25), frozenset({"multirotor", "fixed-wing"})),  # VTOL
    **dict.fromkeys((10, 11), frozenset({"rover"})),
}
"""For each MAV_TYPE of a vehicle, the kinds of missions that it can fly. A type that is missing
here, such as 0 (generic), is no vehicle or does not say what it is.
"""
_WARNING = 4  # MAV_SEVERITY: smaller numbers are worse
_DATAGRAM = 65535
_STANDS = 30.0  # seconds for which an uneven clock may stand still
_POLL = 0.02  # seconds between two looks at an uneven clock
_MOST_WAITING = 4096  # messages that nobody has asked for

Address = Any
"""Where a link's datagram came from; None where a link has one peer."""


class LinkError(ShoalError, ConnectionError):
    """Raised if a vehicle is not heard, does not answer, or if its link is lost."""


class VehicleLink(Protocol):
    """What carries bytes of MAVLink to and from one or more vehicles.

    ``at_once`` is the number of vehicles that it serves well at the same time.
    """

    name: str
    at_once: int

    def send(self, data: bytes, to: Address = None) -> None:
        """Send bytes to an address that was heard, or to all that the link knows."""

    def receive(self, timeout: float) -> list[tuple[bytes, Address]]:
        """Return what came, each with its address; nothing after ``timeout`` seconds."""

    def now(self) -> float:
        """Return the time in seconds, on a clock that never goes back."""

    def close(self) -> None:
        """Close the link."""


class UdpLink:
    """MAVLink over UDP: `udpin` waits on an address of this computer, `udpout` speaks first."""

    at_once = 8

    def __init__(self, name: str, host: str, port: int, *, listens: bool) -> None:
        self.name = name
        family, kind, number, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        self._socket = socket.socket(family, kind, number)
        self._known: dict[Address, None] = {}
        try:
            if listens:
                self._socket.bind(address)
            else:
                # connected: nobody but this peer is heard
                self._socket.connect(address)
        except OSError:
            self._socket.close()
            raise
        self._connected = not listens
        self._socket.setblocking(False)

    def send(self, data: bytes, to: Address = None) -> None:
        """Send a datagram. What cannot be sent is lost, as a datagram may be."""
        with suppress(OSError):
            if self._connected:
                self._socket.send(data)
                return
            for address in [to] if to is not None else list(self._known):
                self._socket.sendto(data, address)

    def receive(self, timeout: float) -> list[tuple[bytes, Address]]:
        """Return the datagrams that have come."""
        select.select([self._socket], [], [], max(0.0, timeout))
        came: list[tuple[bytes, Address]] = []
        while len(came) < 64:
            try:
                data, address = self._socket.recvfrom(_DATAGRAM)
            except ConnectionRefusedError:  # nobody listens there yet
                time.sleep(min(0.05, max(0.0, timeout)))
                break
            except OSError:
                break
            self._known[address] = None
            came.append((data, address))
        return came

    def now(self) -> float:
        """Return the time in seconds."""
        return time.monotonic()

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class FastLink:
    """A link on which time passes faster, as in a rehearsal.

    Parameters
    ----------
    link : VehicleLink
    speed_up : float
        Number of seconds that pass on this link in a second.
    clock : callable, optional
        Function that returns the time in seconds, if it passes unevenly.
    """

    def __init__(
        self, link: VehicleLink, speed_up: float, clock: Callable[[], float] | None = None
    ) -> None:
        self._link, self._speed_up, self._clock = link, speed_up, clock
        self.name, self.at_once = link.name, link.at_once
        self.send, self.close = link.send, link.close
        self._last, self._moved = -1.0, time.monotonic()

    def receive(self, timeout: float) -> list[tuple[bytes, Address]]:
        """Return what came within ``timeout`` fast seconds, or less if their clock is uneven.

        Raises
        ------
        LinkError
            If the clock has stood still for long: who has set it is gone.
        """
        if self.now() != self._last:
            self._last, self._moved = self.now(), time.monotonic()
        elif self._clock is not None and time.monotonic() - self._moved > _STANDS:
            raise LinkError(f"{self.name}: the clock of the rehearsal stands still")
        seconds = timeout / self._speed_up
        return self._link.receive(seconds if self._clock is None else min(seconds, _POLL))

    def now(self) -> float:
        """Return the fast time in seconds."""
        return self._link.now() * self._speed_up if self._clock is None else self._clock()


class StreamLink:
    """MAVLink over a stream of bytes, TCP or a serial line, which is opened again if it breaks."""

    def __init__(self, name: str, connect: Callable[[], Any], *, at_once: int) -> None:
        self.name, self._connect, self.at_once = name, connect, at_once
        self._stream: Any = connect()

    def send(self, data: bytes, to: Address = None) -> None:
        """Send bytes."""
        try:
            if self._stream is not None:
                self._stream.sendall(data)
        except OSError:
            self._drop()

    def receive(self, timeout: float) -> list[tuple[bytes, Address]]:
        """Return the bytes that have come."""
        if self._stream is None:
            time.sleep(min(0.25, max(0.0, timeout)))
            with suppress(OSError):
                self._stream = self._connect()
            return []
        try:
            if not select.select([self._stream], [], [], max(0.0, timeout))[0]:
                return []
            data = self._stream.recv(4096)
        except (OSError, ValueError):
            data = b""
        if not data:
            self._drop()
            return []
        return [(data, None)]

    def _drop(self) -> None:
        with suppress(OSError):
            self._stream.close()
        self._stream = None

    def now(self) -> float:
        """Return the time in seconds."""
        return time.monotonic()

    def close(self) -> None:
        """Close the stream."""
        if self._stream is not None:
            self._drop()


class _SerialStream:
    """A serial line with the methods of a socket."""

    def __init__(self, device: str, baud: int) -> None:
        serial = import_extra("serial", f"the link serial:{device} needs pyserial", extra="serial")
        self._port = serial.Serial(device, baud, timeout=0, write_timeout=2)
        self.fileno = self._port.fileno
        self.close = self._port.close

    def sendall(self, data: bytes) -> None:
        self._port.write(data)

    def recv(self, most: int) -> bytes:
        return bytes(self._port.read(most))


LINKS = (
    "udpin:HOST:PORT (or udp:HOST:PORT), udpout:HOST:PORT, tcp:HOST:PORT or serial:DEVICE[@BAUD]"
)


def check_link(text: str) -> Callable[[], VehicleLink]:
    """Return a function that opens the link ``text``.

    Raises
    ------
    InvalidInputError
        If the text names no link.
    """
    kind, _, endpoint = check_text(text, what="link").partition(":")
    if kind == "serial" and endpoint:
        device, _, baud = endpoint.partition("@")
        if device and re.fullmatch("([1-9][0-9]{2,7})?", baud):
            rate = int(baud or BAUD)
            return lambda: StreamLink(text, lambda: _SerialStream(device, rate), at_once=1)
    match = re.fullmatch(r"(\[[0-9a-fA-F:.%\w]+\]|[^:\s]+):([0-9]{1,5})", endpoint)
    if kind in ("udpin", "udpout", "tcp") and match and 0 < int(match[2]) < 65536:
        host, port = match[1].strip("[]"), int(match[2])
        if kind == "tcp":
            return lambda: StreamLink(
                text, lambda: socket.create_connection((host, port), timeout=5), at_once=8
            )
        return lambda: UdpLink(text, host, port, listens=kind == "udpin")
    raise InvalidInputError(f"connect: expected {LINKS}, got {text!r}")


def open_link(text: str) -> VehicleLink:
    """Open a link such as ``udpin:0.0.0.0:14550``.

    Raises
    ------
    InvalidInputError
        If the text names no link, or if the link cannot be opened.
    """
    opened = check_link(text)
    try:
        return opened()
    except OSError as error:
        if isinstance(error, ShoalError):
            raise
        raise InvalidInputError(
            f"connect: expected a link that opens, got {text}: {error.strerror or error}"
        ) from None


@dataclass(frozen=True)
class LinkLimits:
    """Times in seconds, and numbers of tries, of what is asked of a vehicle.

    Parameters
    ----------
    heartbeat : float
        Time between two of our heartbeats.
    find_within : float
        Time within which a vehicle must be heard.
    settle : float
        Time for which a link is listened to at least: a second vehicle with the same system id
        sends its heartbeat within a second.
    repeat_after : float
        Time without an answer after which a request is repeated, until the delay of the link is
        known.
    end_after : float
        Silence after which a vehicle counts as lost.
    unanswered : int
        Number of repeats of one request, to which a vehicle that is heard gives no answer, after
        which it counts as not answering.
    refusals : int
        Number of refusals for a passing reason (busy, cancelled) after which a refusal counts.
    attempts : int
        Number of uploads of the same items before what is on board is restored or cleared.
    """

    heartbeat: float = 1.0
    find_within: float = 20.0
    settle: float = 1.2
    repeat_after: float = 0.5
    end_after: float = 30.0
    unanswered: int = 15
    refusals: int = 10
    attempts: int = 3

    def __post_init__(self) -> None:
        for name in ("heartbeat", "find_within", "settle", "repeat_after", "end_after"):
            check_number(getattr(self, name), what=name, above=0)


@dataclass
class HeardVehicle:
    """A vehicle as it was last heard.

    Parameters
    ----------
    system, component : int
        Its MAVLink address.
    type, autopilot : int
        MAV_TYPE and MAV_AUTOPILOT of its heartbeat.
    base_mode, custom_mode : int
        Its mode, as its heartbeat says it.
    address : object
        Where on the link it was heard last.
    heard : int
        Number of messages from it.
    heard_at : float
        Time of the last message, on the link's clock.
    delay : float or None
        Measured time between a request and its answer in seconds.
    texts : list of str
        Warnings and errors that it has sent as text, each once.
    """

    system: int
    component: int
    type: int
    autopilot: int
    base_mode: int = 0
    custom_mode: int = 0
    address: Address = None
    heard: int = 0
    heard_at: float = 0.0
    delay: float | None = None
    texts: list[str] = field(default_factory=list)

    @property
    def armed(self) -> bool:
        """Whether its motors may turn."""
        return bool(self.base_mode & ARMED)


class Station:
    """A ground station on one link: it sends heartbeats, and keeps what it hears of each vehicle.

    Parameters
    ----------
    link : VehicleLink
    limits : LinkLimits
    on_message : callable, optional
        Function that is called with each vehicle and each message from it.

    Attributes
    ----------
    vehicles : dict of int to HeardVehicle
        The autopilots heard, by system id.
    log : binary file or None
        Where each message of a vehicle is written as in a ``.tlog``, with the time of day.
    stopped : bool
        Whether `listen` raises a `LinkError` from now on; another thread may set it.
    duplicates : dict of int to set
        System ids that several addresses use at the same time, with these addresses.
    stations : dict of int to float
        Other ground stations heard, by system id, with the time at which each was heard last.
    """

    def __init__(
        self,
        link: VehicleLink,
        limits: LinkLimits | None = None,
        *,
        on_message: Callable[[HeardVehicle, Any], None] | None = None,
    ) -> None:
        self.link, self.limits = link, limits or LinkLimits()
        self.on_message = on_message
        self.stopped = False
        self.log: IO[bytes] | None = None
        self.dialect = dialect()
        self.vehicles: dict[int, HeardVehicle] = {}
        self.duplicates: dict[int, set[Address]] = {}
        self.stations: dict[int, float] = {}
        self._mav = self.dialect.MAVLink(None, *STATION)
        self._parsers: dict[Address, Any] = {}
        self._places: dict[int, dict[Address, float]] = {}
        self._inboxes: defaultdict[int, deque[Any]] = defaultdict(
            lambda: deque(maxlen=_MOST_WAITING)
        )
        self._turn, self._listening = threading.Condition(), False
        self._sending = threading.Lock()
        self._next_heartbeat = link.now()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the link."""
        self.link.close()

    def now(self) -> float:
        """Return the time in seconds, on the link's clock."""
        return self.link.now()

    def take_system(self, system: int) -> None:
        """Take another system id than that of ground stations by default."""
        self._mav.srcSystem = system

    def send(self, vehicle: HeardVehicle | None, message: Any) -> None:
        """Send a message to a vehicle's address, or to all who are known."""
        with self._sending:
            data = bytes(message.pack(self._mav))
            self._mav.seq = (self._mav.seq + 1) % 256
        self.link.send(data, None if vehicle is None else vehicle.address)

    def receive(self, vehicle: HeardVehicle, until: float) -> Any:
        """Return the next message that a vehicle has sent to us or to all, or None when the time
        ``until`` has come.

        Several threads may receive, each from a vehicle of its own: one of them listens to the
        link for all.
        """
        inbox = self._inboxes[id(vehicle)]
        while True:
            with self._turn:
                if inbox:
                    return inbox.popleft()
                now = self.now()
                if now >= until:
                    return None
                if self._listening:
                    self._turn.wait(until - now)
                    continue
                self._listening = True
            try:
                self.listen(until)
            finally:
                with self._turn:
                    self._listening = False
                    self._turn.notify_all()

    def listen(self, until: float) -> None:
        """Wait for bytes until a time at most, and take what has come. Send heartbeats."""
        if self.stopped:
            raise LinkError(f"{self.link.name}: interrupted")
        now = self.now()
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + self.limits.heartbeat
            self.send(
                None,
                self.dialect.MAVLink_heartbeat_message(GROUND_STATION, NO_AUTOPILOT, 0, 0, 4, 3),
            )
        for data, address in self.link.receive(min(until, self._next_heartbeat) - now):
            parser = self._parsers.get(address)
            if parser is None:
                parser = self._parsers[address] = self.dialect.MAVLink(None)
                parser.robust_parsing = True
            for message in parser.parse_buffer(data) or ():
                self._take(message, address)

    def _take(self, message: Any, address: Address) -> None:
        """Keep what a message says of its vehicle, and put it where `receive` finds it."""
        kind = message.get_type()
        if kind in ("BAD_DATA", "") or kind.startswith("UNKNOWN"):
            return
        system, component = message.get_srcSystem(), message.get_srcComponent()
        now = self.now()
        if kind == "HEARTBEAT" and message.type == GROUND_STATION:
            self.stations[system] = now
        elif kind == "HEARTBEAT" and message.autopilot != NO_AUTOPILOT and system:
            vehicle = self.vehicles.get(system)
            if vehicle is None or (
                component == AUTOPILOT_COMPONENT != vehicle.component
            ):  # the autopilot itself before what else of the vehicle speaks like one
                vehicle = self.vehicles[system] = HeardVehicle(
                    system, component, message.type, message.autopilot
                )
            if component == vehicle.component:
                vehicle.type, vehicle.autopilot = message.type, message.autopilot
                vehicle.base_mode, vehicle.custom_mode = message.base_mode, message.custom_mode
                vehicle.address = address
                self._note_place(system, address, now)
        vehicle = self.vehicles.get(system)
        if vehicle is None or component != vehicle.component:
            return
        to = getattr(message, "target_system", 0), getattr(message, "target_component", 0)
        if to[0] not in (0, self._mav.srcSystem) or to[1] not in (0, self._mav.srcComponent):
            return  # to another ground station
        vehicle.heard += 1
        vehicle.heard_at = now
        if kind == "STATUSTEXT" and message.severity <= _WARNING:
            text = message.text.strip("\0 ")
            if text not in vehicle.texts:
                vehicle.texts.append(text)
        if self.log is not None:
            microseconds = time.time_ns() // 1000
            self.log.write(struct.pack(">Q", microseconds) + bytes(message.get_msgbuf()))
        if self.on_message is not None:
            self.on_message(vehicle, message)
        self._inboxes[id(vehicle)].append(message)

    def _note_place(self, system: int, address: Address, now: float) -> None:
        """Note where a heartbeat came from. Two addresses at the same time are two vehicles."""
        places = self._places.setdefault(system, {})
        places[address] = now
        if len(recent := self.addresses(system)) > 1:
            self.duplicates[system] = recent

    def addresses(self, system: int) -> set[Address]:
        """Return the addresses from which an autopilot's heartbeats come at present."""
        places, now = self._places.get(system, {}), self.now()
        return {place for place, when in places.items() if now - when < self.limits.settle}


def type_text(vehicle: HeardVehicle) -> str:
    """Return what a vehicle says it is, such as "multirotor with PX4"."""
    kinds = " or ".join(sorted(KINDS_OF_TYPES.get(vehicle.type, ())))
    autopilot = AUTOPILOTS.get(vehicle.autopilot, f"MAV_AUTOPILOT {vehicle.autopilot}")
    return f"{kinds or f'MAV_TYPE {vehicle.type}'} with {autopilot}"
