"""The two ports of a rig that is made of devices: an actuator, which moves the particles, and a
sensor, which sees them. `BenchRig` makes a rig of the two.

One device may be both. Directions are angles in degrees, counterclockwise from the x axis of
`shoal.rigs.Plant`: the command r leads to 0, u to 90, l to 180 and d to 270.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from math import floor, isfinite
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import (
    check_choice,
    check_number,
    check_points,
    check_text,
    count_text,
    shape_text,
)
from shoal.core.errors import InvalidInputError, RigError, describe_error
from shoal.core.registry import Registry, configured
from shoal.rigs.cameras import CAMERAS, open_camera
from shoal.rigs.physics import ANGLES, Plant
from shoal.rigs.remote import RemoteRig, open_rig
from shoal.rigs.rig import Frame, Rig
from shoal.rigs.trim import PulseTrim
from shoal.swarm.grid.board import RULES

Points = NDArray[np.float64]
Pulses = Mapping[str, tuple[float, float]]
"""Angle in degrees and time in seconds of the pulse that carries out each command."""
PATIENCE = 5.0  # seconds without a new picture after which the camera counts as frozen
POLLING = 0.002  # seconds between two looks for a new picture
REMOTE = ("serial", "tcp", "exec")


@runtime_checkable
class Sensor(Protocol):
    """A device that sees particles. `shoal.testing.check_sensor` checks one."""

    @property
    def name(self) -> str:
        """Name of the device, as written in summaries and error messages."""

    def observe(self) -> Frame:
        """Return what the newest picture shows. Raise RigError if there is none."""

    def close(self) -> None:
        """Release the device."""


@runtime_checkable
class Actuator(Protocol):
    """A device that moves particles. `shoal.testing.check_actuator` checks one.

    An actuator may also have the attribute ``pulses`` (`Pulses`): the angle and the time of the
    pulse that carries out each command; a true attribute ``whole``, if it carries out these pulses
    only; a true attribute ``only``, if it knows only their directions; and ``longest``, the longest
    pulse in seconds.
    """

    @property
    def name(self) -> str:
        """Name of the device, as written in summaries and error messages."""

    def push(self, angle: float, seconds: float) -> None:
        """Push the particles for some seconds, and return when the field is off and the particles
        are at rest. The angle is in degrees, counterclockwise from the x axis.
        """

    def stop(self) -> None:
        """Turn the field off at once. After `stop`, the actuator refuses further pushes with
        RigError.
        """

    def close(self) -> None:
        """Turn the field off and release the device."""


class Calibration(Protocol):
    """The way from what a sensor sees to cells."""

    def to_cells(self, points: Points) -> Points:
        """Return (row, column) of each point. The cell (r, c) has its centre at (r, c)."""


class GridCalibration:
    """The calibration of a sensor that is in line with the cells.

    Parameters
    ----------
    pixels : float
        Pixels a cell.
    origin : tuple of float
        Pixel (x, y) in the upper left corner of cell (0, 0).

    Examples
    --------
    >>> GridCalibration(20).to_cells(np.array([[30.0, 10.0]])).tolist()
    [[0.0, 1.0]]
    """

    def __init__(self, pixels: float, *, origin: tuple[float, float] = (0.0, 0.0)) -> None:
        self.pixels = check_number(pixels, what="pixels", above=0)
        self.origin: Points = check_points([origin], what="origin", dimensions=2, count=1)[0]

    def to_cells(self, points: Points) -> Points:
        """Return (row, column) of each pixel (x, y)."""
        return ((points - self.origin) / self.pixels - 0.5)[:, ::-1]


class CellCalibration:
    """The calibration of a sensor that gives cells (row, column)."""

    def to_cells(self, points: Points) -> Points:
        """Return the points."""
        return points


class BenchRig:
    """A rig of one actuator and one sensor.

    Parameters
    ----------
    actuator : Actuator
    sensor : Sensor
        May be the actuator itself.
    calibration : Calibration, optional
        From the points of the sensor to cells. By default the sensor's attribute ``calibration``.
    shape : tuple of int, optional
        Rows and columns of the area that the sensor sees, in cells. By default the sensor's
        attribute ``shape``.
    pulses : mapping, optional
        Angle in degrees and time in seconds of the pulse that carries out each command. By default
        the actuator's attribute ``pulses``.
    rule : str
        Move rule: "block" or "merge".
    name : str
        By default the names of the two devices.
    latency : float
        Age of a picture when it arrives, in seconds. What shows the particles after a push arrives
        at least so long after its end.
    patience : float
        Time without a new picture after which the drive ends, in seconds.
    trim : PulseTrim, optional
        Corrects the pulses of the commands, instead of ``pulses``, by what the sensor shows.

    Raises
    ------
    InvalidInputError
        Raised if a value is out of range, or given by nobody.

    Examples
    --------
    >>> from shoal.rigs import Plant, PlantPorts, PlantProperties
    >>> from shoal.swarm import GridWorkspace
    >>> vessel = GridWorkspace([[1, 1, 1, 1]])
    >>> ports = PlantPorts(Plant(vessel, [(0.5, 0.5)], PlantProperties(), np.random.default_rng(1)))
    >>> rig = BenchRig(ports, ports)
    >>> rig.send("r")
    >>> rig.observe().tolist()
    [[0, 1]]
    """

    def __init__(
        self,
        actuator: Actuator,
        sensor: Sensor,
        calibration: Calibration | None = None,
        *,
        shape: tuple[int, ...] | None = None,
        pulses: Pulses | None = None,
        rule: str = "block",
        name: str = "",
        latency: float = 0.0,
        patience: float = PATIENCE,
        trim: PulseTrim | None = None,
    ) -> None:
        self.actuator, self.sensor, self.trim = actuator, sensor, trim
        calibration = calibration or getattr(sensor, "calibration", None)
        if calibration is None:
            raise InvalidInputError(
                f"calibration: expected one for the sensor {sensor.name}, which gives pixels and"
                " not cells, got none"
            )
        self.calibration: Calibration = calibration
        view = shape or getattr(sensor, "shape", None)
        if view is None:
            raise InvalidInputError(
                f"shape: expected the rows and columns that the sensor {sensor.name} sees, got none"
            )
        self.shape: tuple[int, ...] = tuple(view)
        if len(self.shape) != 2:
            raise InvalidInputError(
                f"shape: expected rows and columns, got {self.shape}: a rig of two devices has two"
                " dimensions"
            )
        self.pulses: dict[str, tuple[float, float]] = dict(
            check_pulses(pulses or getattr(actuator, "pulses", None), actuator.name)
        )
        self.rule = check_choice(
            rule, what="rule", choices=[name for name in RULES if name != "tilt"]
        )
        same = actuator.name == sensor.name
        self.name = name or (sensor.name if same else f"{actuator.name} and {sensor.name}")
        self.latency = check_number(latency, what="latency", least=0)
        self.patience = check_number(patience, what="patience", above=0)
        self._last = -1  # number of the last picture that was looked at
        self._stale = -1  # number of the last picture before the last push
        self._ended = -np.inf  # when the last push had ended
        self._stopped = False
        self._looks = self._outside = 0  # pictures, and points outside the grid in all of them
        self._unseen = trim is not None  # no picture since the last pulse

    def push(self, angle: float, seconds: float) -> None:
        """Push the particles in a direction (degrees) for some seconds.

        Raises
        ------
        InvalidInputError
            Raised if the actuator cannot do that, or if it exceeds one of its limits.
        RigError
            Raised if the rig has been stopped, or the actuator has failed.
        """
        if self._stopped:
            raise RigError(f"{self.name}: the rig has been stopped")
        self._stale = self._last
        self.actuator.push(angle, seconds)
        self._ended = time.monotonic()

    def send(self, command: str) -> None:
        """Push the particles by one cell: a letter of ``lurd``."""
        if self._stopped:
            raise RigError(f"{self.name}: the rig has been stopped")
        check_choice(command, what="command", choices=self.pulses)
        if self.trim is None:
            self.push(*self.pulses[command])
            return
        if self._unseen:  # each pulse is learnt from by itself
            self.look()
        self.push(*self.trim.pulse(command))
        if (late := getattr(self.actuator, "late", None)) is not None:
            self.trim.note_duration(late)
        self._unseen = True

    @property
    def values(self) -> dict[str, float]:
        """What was commanded and measured at the last push, by name, if the actuator says so."""
        return dict(getattr(self.actuator, "values", {}))

    @property
    def true_cells(self) -> Points | None:
        """Where the particles are, as (row, column) (float64, shape (n, 2)), if the sensor, as that of
        a plant, knows it.
        """
        return getattr(self.sensor, "true_cells", None)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of the pulses and pictures so far, in sentences."""
        notes = tuple(getattr(self.actuator, "notes", ()))
        if self._outside:
            spots = count_text(self._outside, "spot")
            notes += (
                f"{self.sensor.name}: {spots} outside the grid left out, in {count_text(self._looks, 'picture')}",
            )
        return notes

    def look(self) -> Frame:
        """Return the first picture of the particles at rest after the last push. Its points are in
        cells (row, column), as floats.

        Raises
        ------
        RigError
            Raised if no such picture arrives within ``patience`` seconds, or the sensor has failed.
        """
        until = time.monotonic() + self.patience
        frame = self.sensor.observe()
        while frame.number <= self._stale or frame.time < self._ended + self.latency:
            if time.monotonic() > until:
                raise RigError(
                    f"{self.sensor.name}: no new picture for {self.patience:g} s after the last"
                    " push: the camera shows an old picture"
                )
            time.sleep(POLLING)
            frame = self.sensor.observe()
        self._last = frame.number
        points = np.asarray(frame.points, dtype=np.float64).reshape(-1, len(self.shape))
        cells = self.calibration.to_cells(points)
        if self.trim is not None:
            self._unseen = False
            self.trim.see(cells)
        return Frame(cells, frame.time, frame.number)

    def observe(self) -> NDArray[np.int64]:
        """Return the cell of each particle that the sensor sees (int64, shape (k, ndim)), in the
        order of the cells. Several particles can be in one cell.

        A camera may see more than the grid. What it sees beyond the rim of the grid is left out,
        unless it is most of what it sees.

        Raises
        ------
        RigError
            As `look` does, or if most points are outside the grid.
        """
        cells = np.floor(self.look().points + 0.5).astype(np.int64)
        cells = cells[np.lexsort(cells.T[::-1])]
        inside = ((cells >= -1) & (cells <= np.array(self.shape))).all(axis=1)
        outside = cells[~inside]
        if len(outside) > inside.sum():
            raise RigError(
                f"{self.sensor.name}: expected particles in the {shape_text(self.shape)} of the grid,"
                f" got {len(outside)} of {len(cells)} outside, such as in {tuple(outside[0].tolist())}:"
                " the calibration is wrong, or the vessel was moved"
            )
        self._looks += 1
        self._outside += len(outside)
        return cells[inside]

    def stop(self) -> None:
        """Turn the field off. The rig then refuses further commands."""
        self._stopped = True
        self.actuator.stop()

    def close(self) -> None:
        """Release both devices."""
        try:
            self.actuator.close()
        finally:
            self.sensor.close()


def check_pulses(pulses: Pulses | None, name: str) -> Pulses:
    """Check that each of the four commands has a pulse."""
    if pulses is None:
        raise InvalidInputError(
            f"pulses: expected angle and time of each command for the actuator {name}, got none"
        )
    for letter in ANGLES:
        if letter not in pulses:
            raise InvalidInputError(f"pulses: expected the commands l, u, r and d, got no {letter}")
        angle, seconds = pulses[letter]
        if not (isfinite(angle) and isfinite(seconds) and seconds > 0):
            raise InvalidInputError(
                f"pulses: expected an angle and a time above 0 for {letter}, got {angle} and"
                f" {seconds}"
            )
    return pulses


class PlantPorts:
    """Both ports of a physical plant. The points are pixels (column, row) of its camera.

    Parameters
    ----------
    plant : Plant
    """

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.calibration = GridCalibration(plant.apparatus.pixels)
        self.pulses = {letter: (angle, plant.apparatus.pulse) for letter, angle in ANGLES.items()}
        self._ended, self._stopped = 0.0, False
        self._seen: Frame | None = None

    @property
    def frame_rate(self) -> float:
        """Pictures a second of the plant's clock, which is not that of this computer."""
        return self.plant.apparatus.frame_rate

    @property
    def name(self) -> str:
        """Name of the vessel."""
        return self.plant.workspace.name

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the vessel, in cells."""
        return self.plant.workspace.shape

    @property
    def true_cells(self) -> Points:
        """Where the particles are, as (row, column) (float64, shape (n, 2))."""
        return self.plant.true_cells

    def push(self, angle: float, seconds: float) -> None:
        """Pulse the field in a direction for some seconds of the plant's clock."""
        if self._stopped:
            raise RigError("the physical plant has been stopped")
        check_number(angle, what="angle")
        check_number(seconds, what="seconds", least=0, most=60)
        self.plant.push(angle, seconds=seconds)
        self._ended = self.plant.clock

    def observe(self) -> Frame:
        """Return the first picture that was taken after the last push, and then one picture after
        the other.
        """
        apparatus, plant = self.plant.apparatus, self.plant
        arrives = self._ended + 1 / apparatus.frame_rate + apparatus.late
        if self._ended and plant.clock < arrives:
            plant.wait(arrives - plant.clock)
        if self._seen is not None and self._seen.number == self._number_now():
            plant.wait(1 / apparatus.frame_rate)
        _, centroids = plant.picture()
        pixels = (centroids * [1, -1] + [0, self.shape[0]]) * apparatus.pixels
        self._seen = Frame(pixels, time.monotonic(), self._number_now())
        return self._seen

    def _number_now(self) -> int:
        apparatus = self.plant.apparatus
        return max(0, floor((self.plant.clock - apparatus.late) * apparatus.frame_rate + 1e-9))

    def stop(self) -> None:
        """Turn the field off. The plant then refuses further pushes."""
        self._stopped = True

    def close(self) -> None:
        """Turn the field off."""
        self._stopped = True


class RemoteActuator:
    """An actuator behind a connection that speaks the protocol of rigs.

    Parameters
    ----------
    rig : RemoteRig

    Attributes
    ----------
    pulses : dict
        Angle in degrees and time in seconds of each command.
    whole : bool
        Whether it carries out these pulses only, in the time that it takes.
    """

    def __init__(self, rig: RemoteRig) -> None:
        self.rig = rig
        self.name, self.counts, self.pulses = rig.name, rig.counts, rig.pulses
        self.whole = "push" not in rig.can

    @property
    def values(self) -> dict[str, float]:
        """The newest values that the device has reported, by name."""
        return self.rig.values

    def push(self, angle: float, seconds: float) -> None:
        """Push the particles, or carry out the command in the direction of ``angle``."""
        check_number(angle, what="angle")
        check_number(seconds, what="seconds", least=0)
        letter = next(
            (command for command, pulse in self.pulses.items() if pulse == (angle % 360, seconds)),
            None,
        )
        if not self.whole:
            self.rig.push(angle, seconds)
        elif letter is not None:
            self.rig.send(letter)
        else:
            raise InvalidInputError(
                f"{self.name}: expected whole commands ({self.pulses['r'][1]:g} s to 0, 90, 180 or"
                f" 270 degrees), got {seconds:g} s to {angle:g} degrees"
            )

    def stop(self) -> None:
        """Turn the field off, and wait until the device confirms it."""
        self.rig.stop()

    def close(self) -> None:
        """Close the connection."""
        self.rig.close()


class RemoteSensor:
    """A sensor behind a connection that speaks the protocol of rigs, and gives cells.

    Parameters
    ----------
    rig : RemoteRig
    """

    def __init__(self, rig: RemoteRig) -> None:
        self.rig = rig
        self.name, self.shape, self.counts = rig.name, rig.shape, rig.counts
        self.calibration = CellCalibration()

    def observe(self) -> Frame:
        """Ask for the positions."""
        return self.rig.look()

    def close(self) -> None:
        """Close the connection."""
        self.rig.close()


def is_connection(spec: str) -> bool:
    """Return whether a text is the address of a device behind a connection."""
    return check_text(spec, what="device").partition(":")[0] in REMOTE


def runs_code(spec: str) -> bool:
    """Return whether a text that names a device makes Shoal run code that is not Shoal's: a
    program, a module, or the device adapters of a configuration of Micro-Manager.

    Such a text counts only if the user has typed it, and never if a file holds it.
    """
    kind, colon, _ = spec.partition(":")
    return bool(colon) and kind not in ("serial", "tcp", "coils", "physics", "opencv")


def is_camera(spec: str) -> bool:
    """Return whether a text names a camera."""
    return spec.partition(":")[0] in CAMERAS


def open_actuator(spec: str, **options: Any) -> Actuator:
    """Open the actuator that a text names.

    Parameters
    ----------
    spec : str
        ``coils:FILE`` (coils that an actuation file describes), ``serial:DEVICE[@BAUD]``,
        ``tcp:HOST:PORT`` or ``exec:COMMAND`` (a device that speaks the protocol of rigs), or ``MODULE:ATTRIBUTE`` (an actuator of the user, or what makes one when
        it is called without arguments).
    **options
        Options of `shoal.rigs.open_rig`, for a device behind a connection.

    Raises
    ------
    InvalidInputError, UnknownNameError, MissingExtraError, RigError
    """
    if is_connection(spec):
        return RemoteActuator(open_rig(spec, **options))
    if spec.partition(":")[0] == "coils":
        from shoal.rigs.coils import CoilActuator

        path = spec.partition(":")[2]
        if not path:
            raise InvalidInputError("actuator: expected coils:FILE, got no file")
        return CoilActuator(path)
    actuator: Actuator = _open_own(spec, "actuator", Actuator)
    return actuator


def open_sensor(spec: str, **options: Any) -> Sensor:
    """Open the sensor that a text names.

    Parameters
    ----------
    spec : str
        As in `open_actuator`, or a camera as in `shoal.rigs.cameras.open_camera`.
    **options
        Those of `open_actuator`.

    Raises
    ------
    InvalidInputError, UnknownNameError, MissingExtraError, RigError
    """
    if is_connection(spec):
        return RemoteSensor(open_rig(spec, **options))
    if is_camera(spec):
        return open_camera(spec)
    sensor: Sensor = _open_own(spec, "sensor", Sensor)
    return sensor


def open_own_rig(spec: str) -> Rig:
    """Return the rig that ``MODULE:ATTRIBUTE`` names: a rig, an object that is both an actuator and
    a sensor, or what makes one of them when it is called without arguments.

    Parameters
    ----------
    spec : str

    Raises
    ------
    InvalidInputError, UnknownNameError
    """
    device = _open_own(spec, "rig", Rig, Actuator)
    if isinstance(device, Rig):
        return device
    if not isinstance(device, Sensor):
        raise InvalidInputError(_type_fault(spec, "rig", device))
    ports: Any = device
    return BenchRig(ports, ports)


KNOWN = {
    "rig": "simulated, physics:KIND, serial:DEVICE[@BAUD], tcp:HOST:PORT, exec:COMMAND or"
    " MODULE:ATTRIBUTE",
    "actuator": "coils:FILE, physics:KIND, serial:DEVICE[@BAUD], tcp:HOST:PORT, exec:COMMAND or"
    " MODULE:ATTRIBUTE",
    "sensor": "physics, opencv:INDEX|FILE|ADDRESS, pymmcore:CONFIG, serial:DEVICE[@BAUD],"
    " tcp:HOST:PORT, exec:COMMAND or MODULE:ATTRIBUTE",
}
MEMBERS = {
    "rig": "name, shape, rule, send, observe and stop",
    "actuator": "name, push, stop and close",
    "sensor": "name, observe and close",
}


def _open_own(spec: str, kind: str, *types: type) -> Any:
    """Return a device of the user, named as MODULE:ATTRIBUTE. Only what the user types gets here."""
    if ":" not in spec:
        raise InvalidInputError(f"{kind}: expected {KNOWN[kind]}, got {spec[:80]!r}")
    device = configured(Registry[Any](kind), spec)
    if callable(device) and not isinstance(device, types):
        try:
            device = device()
        except (Exception, SystemExit) as error:  # code of the user
            raise RigError(f"{kind} {spec}: {describe_error(error)}") from error
    if not isinstance(device, types):
        raise InvalidInputError(_type_fault(spec, kind, device))
    return device


def _type_fault(spec: str, kind: str, device: Any) -> str:
    return (
        f"{kind}: expected an object with {MEMBERS[kind]}, got {type(device).__name__} from"
        f" {spec!r}"
    )
