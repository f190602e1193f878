"""Flight logs of vehicles: the tracks in a ``.tlog`` (MAVLink, of a ground station), a ``.bin``
(ArduPilot) or a ``.ulg`` (PX4).
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import as_path, check_file
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, import_extra
from shoal.core.notices import quiet, tell_once

LARGEST_LOG = 2**32  # bytes
_SINCE_1970 = 1e9  # seconds: a smaller time is one since the vehicle was switched on
_DATAFLASH = b"\xa3\x95\x80"  # a message that describes messages
_NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID: a camera or a ground station
_MAVLINK_1, _MAVLINK_2, _SIGNED = 0xFE, 0xFD, 1


@dataclass(frozen=True, eq=False)
class Track:
    """Where a vehicle was.

    Parameters
    ----------
    file : str
    system : int or None
        MAVLink system id, if the log names it.
    times : ndarray of float64, shape (n,)
        Seconds since 1970 if ``absolute``, otherwise since the vehicle was switched on; increasing.
    places : ndarray of float64, shape (n, 2)
        Longitude and latitude in degrees.
    heights : ndarray of float64, shape (n,)
        Metres above home.
    absolute : bool
    stepped_back : float
        Seconds by which the clock of the log steps back in all. The times continue there.
    """

    file: str
    system: int | None
    times: NDArray[np.float64]
    places: NDArray[np.float64]
    heights: NDArray[np.float64]
    absolute: bool
    stepped_back: float = 0.0


Row = tuple[float, float, float, float]
"""Time, longitude, latitude and height."""

LOGS = (".tlog", ".bin", ".ulg")
"""Suffixes of flight logs."""

ALOFT = 1.0
"""Height above home in metres from which on a vehicle is in flight."""

GAP = 3.0
"""Seconds without a position after which a track is interrupted."""

# of a step to a position that counts: times the greatest speed that lasts, and m/s, at least and at
# most
_FASTER, _SLOWEST, _FASTEST = 3.0, 10.0, 100.0
_LASTS = 5  # steps between positions, most of which a wrong position leaves alone
_DEGREE = 111_195.0  # metres of a degree of latitude, about


HIGH_ENOUGH = 0.8
"""Share of the height of a search from which on a vehicle sees what it searches."""


def search_lines(
    path: str | os.PathLike[str], *, flies: bool = True, altitude: float | None = None
) -> list[NDArray[np.float64]]:
    """Return the uninterrupted tracks of all vehicles in a flight log while they were high enough to
    search, or, of a vehicle that never was in flight, such as a rover, all its tracks; longitude and
    latitude in degrees, float64, each of shape (k, 2).

    High enough is `HIGH_ENOUGH` of the ``altitude`` in metres above home. By default, this altitude
    is the height above which a vehicle flew half of its way. A notice tells of ways that were lower.
    """
    lines: list[NDArray[np.float64]] = []
    for track in read_tracks(path):
        aloft = track.heights > ALOFT
        counts = aloft | (not (flies and aloft.any()))
        if flies and aloft.any():
            steps = _steps(track.places)
            ways = np.where(aloft[1:] & aloft[:-1], np.hypot(*steps.T), 0.0)
            usual = _median(track.heights[1:], ways) if altitude is None else altitude
            counts = track.heights >= max(HIGH_ENOUGH * usual, ALOFT)
            low = float(ways[~(counts[1:] & counts[:-1])].sum())
            if low > 0.0:
                tell_once(
                    f"searched: {track.file}: {100 * low / ways.sum():.2g} % of the way in flight"
                    f" count as climbs and descents, not as searched: lower than"
                    f" {HIGH_ENOUGH * usual:.3g} m above home, {HIGH_ENOUGH:g} times the height of the"
                    " search"
                )
        ends = interruptions(track.times, track.places)
        ends = np.union1d(ends, np.flatnonzero(counts[1:] != counts[:-1]) + 1)
        parts = np.split(np.arange(len(counts)), ends)
        lines += [track.places[part] for part in parts if counts[part[0]]]
    if not lines and altitude is not None:
        raise InvalidInputError(
            f"searched: {path}: expected a flight of {HIGH_ENOUGH * altitude:.3g} m above home or more,"
            f" {HIGH_ENOUGH:g} times the altitude of the vehicle with its camera, got none"
        )
    return lines


def _median(values: NDArray[np.float64], weights: NDArray[np.float64]) -> float:
    """Return the value above which half of the weights lie; without weights, the largest value."""
    order = np.argsort(values)
    sums = np.cumsum(weights[order])
    if not sums[-1] > 0:
        return float(values.max())
    return float(values[order][np.searchsorted(sums, sums[-1] / 2)])


def _steps(places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the steps between places in degrees as metres east and north; float64, (k - 1, 2)."""
    steps = _DEGREE * np.diff(places, axis=0)
    steps[:, 0] *= np.cos(np.radians(places[1:, 1]))
    return np.asarray(steps)


def interruptions(
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    *,
    gap: float = GAP,
    exact: float = 0.1,
) -> NDArray[np.int64]:
    """Return the numbers of the positions before which a track is interrupted, int64: none came for
    longer than ``gap`` seconds, or it is farther away than the vehicle can have come meanwhile.

    Parameters
    ----------
    times : ndarray of float64, shape (n,)
        Seconds.
    places : ndarray of float64, shape (n, 2)
        Longitude and latitude in degrees.
    gap : float
    exact : float
        Seconds to which times are exact.

    Examples
    --------
    >>> places = np.array([(8.5, 47.4), (8.5001, 47.4), (8.6, 47.4), (8.5002, 47.4)])
    >>> interruptions(np.arange(4.0), places).tolist()
    [2, 3]
    """
    seconds, metres, fastest = np.abs(np.diff(times)), np.hypot(*_steps(places).T), _FASTEST
    if len(metres) >= _LASTS:
        speeds = np.lib.stride_tricks.sliding_window_view(metres / (seconds + exact), _LASTS)
        fastest = min(max(_FASTER * float(np.median(speeds, axis=1).max()), _SLOWEST), _FASTEST)
    return np.flatnonzero((seconds > gap) | (metres > fastest * (seconds + exact))) + 1


def read_tracks(path: str | os.PathLike[str]) -> list[Track]:
    """Read the track of each vehicle in a flight log.

    Parameters
    ----------
    path : path-like
        A log of a ground station (``.tlog``), of ArduPilot (``.bin``) or of PX4 (``.ulg``).

    Raises
    ------
    InvalidInputError
        If the file is no flight log, or if it has no position.
    MissingExtraError
        If the library that reads the log is not installed.
    """
    source = as_path(path)
    readers: dict[str, Callable[[Path], dict[int | None, list[Row]]]] = dict(
        zip(LOGS, (_read_tlog, _read_dataflash, _read_ulog), strict=True)
    )
    reader = readers.get(source.suffix.lower())
    if reader is None:
        raise InvalidInputError(
            f"{source}: expected a flight log ({' '.join(readers)}), got the suffix"
            f" {source.suffix!r}"
        )
    check_file(source, what="flight log", most=LARGEST_LOG)
    tracks = [
        _track(source.name, system, rows)
        for system, rows in sorted(reader(source).items(), key=str)
    ]
    tracks = [track for track in tracks if len(track.times) > 1]
    if not tracks:
        raise InvalidInputError(f"{source}: expected positions of a vehicle, got none")
    return tracks


def _track(file: str, system: int | None, rows: list[Row]) -> Track:
    """Return the track of rows, without those that have no fix or come late by up to `GAP`.

    Where the clock steps back by more, the times continue from there.
    """
    table = np.array(rows, dtype=np.float64).reshape(-1, 4)
    fixed = np.isfinite(table).all(axis=1) & (np.abs(table[:, 1:3]).sum(axis=1) > 1e-6)
    fixed &= (np.abs(table[:, 1]) <= 180) & (np.abs(table[:, 2]) <= 90)
    table = table[fixed]
    steps = np.diff(table[:, 0])
    back = np.where(steps < -GAP, -steps, 0.0)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    table[1:, 0] += np.cumsum(back + usual * (back > 0))
    latest = np.maximum.accumulate(table[:, 0])
    table = table[np.diff(latest, prepend=-np.inf) > 0]
    absolute = len(table) > 0 and bool(table[0, 0] > _SINCE_1970)
    stepped = float(back.sum())
    return Track(file, system, table[:, 0], table[:, 1:3], table[:, 3], absolute, stepped)


def _read_tlog(path: Path) -> dict[int | None, list[Row]]:
    """Read a log of a ground station: packets of MAVLink, each after its time in microseconds."""
    rows: dict[int | None, list[Row]] = {}
    vehicles: set[tuple[int, int]] = set()
    for stamp, message in _messages(path.read_bytes()):
        source = message.get_srcSystem(), message.get_srcComponent()
        if message.get_type() == "HEARTBEAT" and message.autopilot != _NO_AUTOPILOT:
            vehicles.add(source)
        elif message.get_type() == "GLOBAL_POSITION_INT":
            rows.setdefault(source[0], []).append(
                (stamp / 1e6, message.lon / 1e7, message.lat / 1e7, message.relative_alt / 1000)
            )
    systems = {system for system, _ in vehicles}
    return {system: track for system, track in rows.items() if system in systems or not systems}


def _messages(data: bytes) -> Iterator[tuple[int, Any]]:
    """Yield the messages of a log with their times. Skip bytes where no whole message begins."""
    make = dialect()
    parser = make.MAVLink(None)
    place = 0
    while place + 16 <= len(data):
        magic, size = data[place + 8], data[place + 9]
        length = 0
        if magic == _MAVLINK_2:
            length = size + 12 + 13 * (data[place + 10] & _SIGNED)
        elif magic == _MAVLINK_1:
            length = size + 8
        packet = data[place + 8 : place + 8 + length]
        try:
            message = parser.decode(bytearray(packet)) if length and len(packet) == length else None
        except make.MAVError:
            message = None  # a wrong checksum, or a message that nobody knows
        if message is None:
            place += 1
            continue
        (stamp,) = struct.unpack_from(">Q", data, place)
        yield stamp, message
        place += 8 + length


@contextmanager
def _restore_environment() -> Iterator[None]:
    """Undo what importing pymavlink's `mavutil` changes in the environment."""
    before = os.environ.get("MAVLINK_DIALECT")
    os.environ["MAVLINK_DIALECT"] = "ardupilotmega"
    try:
        yield
    finally:
        if before is None:
            os.environ.pop("MAVLINK_DIALECT", None)
        else:
            os.environ["MAVLINK_DIALECT"] = before


def _read_dataflash(path: Path) -> dict[int | None, list[Row]]:
    """Read a log of ArduPilot: its estimated positions or, without them, those of the receiver."""
    with _restore_environment():
        reader = import_extra(
            "pymavlink.DFReader", "logs of ArduPilot need pymavlink", extra="mavlink"
        )
    with open(path, "rb") as file:
        head = file.read(len(_DATAFLASH))
    if head != _DATAFLASH:  # the reader would leave the file open
        raise InvalidInputError(
            f"{path}: expected a log of ArduPilot, which begins with {_DATAFLASH.hex()}, got"
            f" {head.hex()}"
        )
    estimated: list[Row] = []
    received: list[Row] = []
    log = object.__new__(reader.DFReader_binary)  # its files are closed even if it cannot begin
    try:
        # it prints what it skips, partly from C
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()), quiet():
            log.__init__(str(path))
            for message in iter(lambda: log.recv_match(type=["POS", "GPS"]), None):
                place = message._timestamp, message.Lng, message.Lat
                if message.get_type() == "POS":
                    estimated.append((*place, message.RelHomeAlt))
                elif message.Status >= 3:
                    received.append((*place, message.Alt))
    except Exception as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InvalidInputError(
            f"{path}: expected a log of ArduPilot, got the error: {reason}"
        ) from None
    finally:
        for name in ("filehandle", "data_map"):
            # a view of the map may be left where the reader has failed
            with suppress(AttributeError, BufferError):
                getattr(log, name).close()
    if estimated:
        return {None: estimated}
    ground = received[0][3] if received else 0.0
    return {None: [(*row[:3], row[3] - ground) for row in received]}


def _read_ulog(path: Path) -> dict[int | None, list[Row]]:
    """Read a log of PX4: its global position."""
    module = import_extra("pyulog", "logs of PX4 need pyulog", extra="mavlink")
    names = ["vehicle_global_position", "vehicle_gps_position", "sensor_gps", "home_position"]
    try:
        with open(path, "rb") as file, redirect_stdout(StringIO()):
            log = module.ULog(file, names)
    except Exception as error:
        message = " ".join(str(error).split()) or type(error).__name__
        raise InvalidInputError(
            f"{path}: expected a log of PX4, got the error: {message}"
        ) from None
    topics: dict[str, Any] = {}
    for topic in log.data_list:
        topics.setdefault(topic.name, topic.data)
    place = topics.get("vehicle_global_position")
    if place is None or not len(place["timestamp"]):
        return {}
    home = topics.get("home_position")
    ground = place["alt"][0] if home is None or not len(home["alt"]) else home["alt"][-1]
    times = place["timestamp"] / 1e6 + _clock_of(topics)
    table = np.column_stack([times, place["lon"], place["lat"], place["alt"] - float(ground)])
    return {None: [tuple(row) for row in table.tolist()]}


def _clock_of(topics: dict[str, Any]) -> float:
    """Return the time since 1970 at which PX4 was switched on, by its receiver; 0 if unknown."""
    for name in ("vehicle_gps_position", "sensor_gps"):
        data = topics.get(name)
        if data is not None and "time_utc_usec" in data:
            valid = data["time_utc_usec"] > _SINCE_1970 * 1e6
            if valid.any():
                first = int(np.argmax(valid))
                return float(data["time_utc_usec"][first] - data["timestamp"][first]) / 1e6
    return 0.0


def dialect() -> Any:
    """Import MAVLink's messages, which pymavlink generates, in version 2.

    Raises
    ------
    MissingExtraError
        If pymavlink is not installed.
    """
    return import_extra(
        "pymavlink.dialects.v20.ardupilotmega", "MAVLink needs pymavlink", extra="mavlink"
    )
