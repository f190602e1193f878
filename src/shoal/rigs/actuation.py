"""The actuation file: from a command, or an angle and a time, to what coils do.

A field of the strength ``magnitude`` points in the direction of the command (``pull``), or rotates
so that particles roll or swim in this direction (``roll``, ``swim``). With the direction a, x to
the right, y up and z towards the eye:

- pull: B = m (cos a, sin a, 0).
- roll, swim: B turns about an axis n with the angle ``tilt`` from z. Rolling particles move
  across the axis, which points to a + 90 degrees (a ball on the floor that rolls along v turns about
  z x v); swimming ones move along it. With u = (-sin p, cos p, 0), p the direction of the axis, and
  w = n x u, B = m (cos(2 pi f t) u + sin(2 pi f t) w).

The current of each coil is the product of its row of ``coils.matrix`` and B. A duty is a polynomial
of the current: sign(i) (c0 + c1 |i| + c2 i^2 + ...), and 0 without current.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import copysign, cos, hypot, pi, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from shoal.core.checks import (
    check_number,
    parse_json,
    parse_toml,
    read_text,
    shortened,
    validation_message,
)
from shoal.core.errors import InvalidInputError, errors_at
from shoal.rigs.actuation_form import ActuationForm, CommandForm
from shoal.rigs.packets import READ, Packet, Template
from shoal.rigs.physics import ANGLES

LARGEST_FILE = 2**20  # bytes
ROUNDING = 1e-9  # by which a value may exceed its limit
SINGLE = 1e-6  # by which a value may do so in a packet, whose numbers may be of single precision
WHOLE = 1e-6  # degrees by which a direction may differ from that of a custom command
PER_TURN = 4  # packets for each turn of a field that the computer rotates, at least
TIMES = ("number", "seconds", "milliseconds", "microseconds")
SCALES = {"seconds": 1.0, "milliseconds": 1e3, "microseconds": 1e6}
FIELD = ("angle", "angle_rad", "magnitude", "bx", "by", "bz")
ROTATION = ("frequency", "tilt", "tilt_rad", "axis", "axis_rad")
COMPONENTS = ("bx", "by", "bz")


class Actuation:
    """What coils do for an angle and a time, within limits.

    Parameters
    ----------
    form : ActuationForm

    Attributes
    ----------
    pulses : dict
        Angle in degrees and time in seconds of each command.
    largest_number : int
        Number of a pulse after which the numbers begin at 1 again.

    Raises
    ------
    InvalidInputError
        Raised if two fields contradict each other, a field has no effect, or a command exceeds a
        limit.
    """

    def __init__(self, form: ActuationForm) -> None:
        self.form = form
        self.name, self.device, self.limits = form.name, form.device, form.limits
        self._check_field()
        self._matrix, self._polynomials = self._check_coils()
        self.pulses = {letter: self._pulse_of(letter) for letter in ANGLES}
        self._check_limits()
        own = self._own_names()
        names = (*TIMES, *own)
        device = form.device
        self.pulse = self._packet("pulse", device.pulse, names)
        self.off = self._packet("off", device.off, ("number",))
        self.alive = self._packet("alive", device.alive, ("number",))
        self.reply = self._packet("reply", device.reply, (*names, *READ))
        self.off_reply = self._packet("off_reply", device.off_reply, ("number", *READ))
        self.error = self._packet("error", device.error, READ)
        self._check_device(own)
        self.largest_number = min(
            packet.largest("number")
            for packet in (self.pulse, self.off, self.alive, self.reply, self.off_reply)
            if packet is not None
        )
        for letter, (angle, seconds) in self.pulses.items():  # refused before anything is sent
            with errors_at(f"command {letter}"):
                self.packet(angle, seconds, number=0)

    def packet(self, angle: float, seconds: float, *, number: int, time: float = 0.0) -> bytes:
        """Return the packet that turns the field on.

        Parameters
        ----------
        angle : float
            Direction in degrees.
        seconds : float
        number : int
        time : float
            Time since the begin of the pulse in seconds, for a field that the computer rotates.

        Raises
        ------
        InvalidInputError
            Raised beyond a limit, also if only the packet's rounding goes beyond it, or if the
            values do not fit the packet.
        """
        with errors_at("device.pulse"):
            values = self.values(angle, seconds, number=number, time=time)
            self._check_rounded(values)
            packet: bytes = self.pulse.encode(values)
            return packet

    def values(
        self, angle: float, seconds: float, *, number: int, time: float = 0.0
    ) -> dict[str, float]:
        """Return the values of the templates for a push, by name (`packet` explains the
        parameters).

        Raises
        ------
        InvalidInputError
            Raised beyond a limit, and for a direction that a custom device does not have.
        """
        angle = check_number(angle, what="angle")
        check_number(seconds, what="seconds", least=0)
        if seconds > self.limits.pulse * (1 + ROUNDING):
            raise InvalidInputError(
                f"seconds: expected at most {self.limits.pulse:g} (limits.pulse), got {seconds:g}"
            )
        values = {
            "number": float(number),
            **{name: scale * seconds for name, scale in SCALES.items()},
        }
        return values | (
            self._custom(angle) if self.form.field is None else self._field(angle, time)
        )

    def _check_rounded(self, values: Mapping[str, float]) -> None:
        """Refuse values that their places in the packet round beyond a limit: what is sent counts."""
        limits, form, coils = self.limits, self.form.field, self.form.coils
        most: list[tuple[str, str, float | None]] = [
            (name, "pulse", scale * limits.pulse) for name, scale in SCALES.items()
        ]
        if form is not None:
            of_field = "current" if form.unit == "mA" else "field"
            ceiling = getattr(limits, of_field)
            if ceiling is not None:
                most.append(("magnitude", of_field, ceiling))
                parts = [self.pulse.rounded(name, values[name]) for name in COMPONENTS]
                length = hypot(*(max(map(abs, part), default=0.0) for part in parts))
                if length > ceiling * (1 + SINGLE):
                    raise InvalidInputError(
                        f"{', '.join(COMPONENTS)}: expected a field of at most {ceiling:g}"
                        f" (limits.{of_field}) as the packet rounds it, got {length:g}"
                    )
        for name, polynomial in zip(coils.names if coils else (), self._polynomials, strict=True):
            if polynomial is None:
                most.append((name, "current", limits.current))
            else:
                most.append((name, "duty", limits.duty))
                if limits.current is not None:
                    current = copysign(limits.current, values[name])
                    most.append((name, "current", abs(_duty(polynomial, current))))
        for name, limit, ceiling in most:
            if ceiling is None:
                continue
            for sent in self.pulse.rounded(name, values[name]):
                if abs(sent) > max(abs(values[name]), ceiling) * (1 + SINGLE):
                    raise InvalidInputError(
                        f"{name}: expected at most {ceiling:g} (limits.{limit}) as the packet"
                        f" rounds it, got {sent:g} for {values[name]:g}"
                    )

    def _custom(self, angle: float) -> dict[str, float]:
        for letter, (at, _) in self.pulses.items():
            if abs((angle - at + 180) % 360 - 180) <= WHOLE:
                return dict(self._command(letter).values or {})
        angles = ", ".join(f"{at:g}" for at, _ in self.pulses.values())
        raise InvalidInputError(
            f"angle: expected a direction of the custom commands ({angles} degrees), got {angle:g}"
        )

    def _field(self, angle: float, time: float) -> dict[str, float]:
        form, kind = self.form.field, self.form.kind
        assert form is not None
        direction = (angle + form.heading) % 360
        values = {
            "angle": direction,
            "angle_rad": radians(direction),
            "magnitude": form.magnitude,
        }
        if kind == "pull":
            vector = form.magnitude * _direction(direction)
            turning = vector[None]
        else:
            assert form.frequency is not None
            tilt = 90.0 if form.tilt is None else form.tilt
            axis = (direction + (90 if kind == "roll" else 0)) % 360
            values |= {
                "frequency": form.frequency,
                "tilt": tilt,
                "tilt_rad": radians(tilt),
                "axis": axis,
                "axis_rad": radians(axis),
            }
            across = form.magnitude * _direction(axis + 90)  # u, and w = n x u
            turning = np.array([across, np.cross(_spherical(axis, tilt), across)], dtype=np.float64)
            phase = 2 * pi * form.frequency * time
            vector = cos(phase) * turning[0] + sin(phase) * turning[1]
        values |= dict(zip(COMPONENTS, vector.tolist(), strict=True))
        return values | self._levels(vector, turning)

    def _levels(
        self, vector: NDArray[np.float64], turning: NDArray[np.float64]
    ) -> dict[str, float]:
        """Return what each coil gets, after checking the largest values in a turn."""
        limits, coils = self.limits, self.form.coils
        assert self.form.field is not None
        if self.form.field.unit == "mA":
            self._check(
                self.form.field.magnitude, limits.current, "current", "field.magnitude", "mA"
            )
        if coils is None:
            return {}
        sides = self._matrix.shape[1]
        currents = self._matrix @ vector[:sides]
        largest = np.array([hypot(*row) for row in self._matrix @ turning[:, :sides].T])
        if coils.one_sided:
            currents = np.maximum(currents, 0.0)
            if len(turning) == 1:
                largest = currents
        levels = {}
        for name, current, most, polynomial in zip(
            coils.names, currents.tolist(), largest.tolist(), self._polynomials, strict=True
        ):
            self._check(most, limits.current, "current", name, "mA")
            levels[name] = current if polynomial is None else _duty(polynomial, current)
            if polynomial is not None:
                self._check(levels[name], limits.duty, "duty", name, "")
                self._check(_duty(polynomial, most), limits.duty, "duty", name, "")
        return levels

    def _check(self, value: float, limit: float | None, what: str, where: str, unit: str) -> None:
        if limit is not None and abs(value) > limit * (1 + ROUNDING):
            raise InvalidInputError(
                f"{where}: expected at most {limit:g}{unit and ' ' + unit} (limits.{what}), got"
                f" {abs(value):g}"
            )

    def _command(self, letter: str) -> CommandForm:
        own = (command for name, command in self.form.commands.items() if name == letter)
        return next(own, CommandForm())

    def _pulse_of(self, letter: str) -> tuple[float, float]:
        own = self._command(letter)
        angle = ANGLES[letter] if own.angle is None else own.angle
        return angle, own.seconds or self.form.pulse.seconds

    def _own_names(self) -> tuple[str, ...]:
        """Return the names that templates may contain besides number and times."""
        if self.form.kind == "custom":
            names: dict[str, tuple[str, ...]] = {}
            for letter in ANGLES:
                own = self._command(letter)
                if own.values is None:
                    raise InvalidInputError(
                        f"commands.{letter}.values: expected the values of each command for the"
                        " kind custom, got none"
                    )
                names[letter] = tuple(own.values)
                if set(names[letter]) != set(names["r"]):
                    raise InvalidInputError(
                        f"commands.{letter}.values: expected the names"
                        f" {', '.join(names['r'])}, got {', '.join(names[letter])}"
                    )
            _check_names(names["r"], "commands.r.values", TIMES)
            return names["r"]
        for letter, own in self.form.commands.items():
            if own.values is not None:
                raise InvalidInputError(
                    f"commands.{letter}.values: expected no values for the kind"
                    f" {self.form.kind}, got {shortened(own.values)}"
                )
        rotation = ROTATION if self.form.kind in ("roll", "swim") else ()
        return (*FIELD, *rotation, *(self.form.coils.names if self.form.coils else ()))

    def _check_field(self) -> None:
        form, kind = self.form.field, self.form.kind
        if kind == "custom":
            for name in ("field", "coils"):
                if getattr(self.form, name) is not None:
                    raise InvalidInputError(f"{name}: expected none for the kind custom, got one")
            return
        if form is None:
            raise InvalidInputError(f"field: expected one for the kind {kind}, got none")
        if kind == "pull":
            for name in ("frequency", "tilt"):
                if getattr(form, name) is not None:
                    raise InvalidInputError(
                        f"field.{name}: expected none for the kind pull, got"
                        f" {getattr(form, name):g}"
                    )
        elif form.frequency is None:
            raise InvalidInputError(f"field.frequency: expected one for the kind {kind}, got none")

    def _check_coils(self) -> tuple[NDArray[np.float64], list[list[float] | None]]:
        coils = self.form.coils
        if coils is None:
            return np.zeros((0, 3)), []
        n = len(coils.names)
        reserved = (*TIMES, *FIELD, *ROTATION, *READ)
        _check_names(coils.names, "coils.names", reserved)
        sides = {len(row) for row in coils.matrix}
        if len(coils.matrix) != n or sides not in ({2}, {3}):
            raise InvalidInputError(
                f"coils.matrix: expected {n} rows of 2 or 3 numbers, one for each coil, got"
                f" {shortened(coils.matrix)}"
            )
        if coils.one_sided and self.form.kind != "pull":
            raise InvalidInputError(
                f"coils.one_sided: expected false for the kind {self.form.kind}, got true"
            )
        if self.form.kind != "pull" and sides == {2}:
            raise InvalidInputError(
                "coils.matrix: expected rows of 3 numbers for a field that turns, got rows of 2"
            )
        polynomial: Any = coils.polynomial
        if polynomial is None:
            return np.array(coils.matrix, dtype=np.float64), [None] * n
        nested = bool(polynomial) and isinstance(polynomial[0], list)
        polynomials = polynomial if nested else [polynomial] * n
        if len(polynomials) != n or not all(polynomials):
            raise InvalidInputError(
                f"coils.polynomial: expected coefficients, or a list of them for each of {n} coils,"
                f" got {shortened(polynomial)}"
            )
        return np.array(coils.matrix, dtype=np.float64), polynomials

    def _check_limits(self) -> None:
        """Refuse limits that would have no effect, and a field beyond its limit."""
        limits, form, coils = self.limits, self.form.field, self.form.coils
        without = {
            "field": (form is None or form.unit != "mT", "a field in mT"),
            "current": (
                coils is None and (form is None or form.unit != "mA"),
                "coils, or a field in mA",
            ),
            "duty": (coils is None or coils.polynomial is None, "coils with a polynomial"),
        }
        for name, (missing, needed) in without.items():
            value = getattr(limits, name)
            if value is not None and missing:
                raise InvalidInputError(f"limits.{name}: expected {needed}, got none to limit")
        if form is not None and form.unit == "mT":
            self._check(form.magnitude, limits.field, "field", "field.magnitude", "mT")
        for letter, (_, seconds) in self.pulses.items():
            if seconds > limits.pulse:
                raise InvalidInputError(
                    f"command {letter}: expected a pulse of at most {limits.pulse:g} s"
                    f" (limits.pulse), got {seconds:g}"
                )

    def _packet(self, name: str, template: Template | None, names: Any) -> Any:
        if template is None:
            return None
        with errors_at(f"device.{name}"):
            answer = name in ("reply", "off_reply", "error")
            return Packet(self.device.packets, template, names, answer=answer)

    def _check_device(self, own: tuple[str, ...]) -> None:
        """Refuse what the device cannot do, and fields without effect."""
        device = self.device
        kind, _, endpoint = device.connection.partition(":")
        if kind not in ("serial", "tcp") or not endpoint:
            raise InvalidInputError(
                "device.connection: expected serial:DEVICE[@BAUD] or tcp:HOST:PORT, got"
                f" {shortened(device.connection)}"
            )
        if not set(own) & set(self.pulse.names):
            raise InvalidInputError(
                f"device.pulse: expected a name out of {', '.join(own)}, got none: every command"
                " would do the same"
            )
        timed = any(name in self.pulse.names for name in TIMES[1:])
        if device.timed and not timed:
            raise InvalidInputError(
                "device.timed: expected a time (such as milliseconds) in device.pulse, got none"
            )
        if device.reply is not None and device.reply.when == "end" and not device.timed:
            raise InvalidInputError(
                "device.reply.when: expected begin for a device that does not end pulses itself"
                " (device.timed), got 'end'"
            )
        if device.off_reply is not None and device.off_reply.when == "end":
            raise InvalidInputError("device.off_reply.when: expected begin, got 'end'")
        if device.repeat and (
            device.reply is None
            or "number" not in self.pulse.names
            or "number" not in self.reply.names
        ):
            raise InvalidInputError(
                "device.repeat: expected the name number in device.pulse and in device.reply, as"
                " no pulse may be carried out twice, got none"
            )
        for name in ("reply", "off_reply"):
            answer, packet = getattr(self, name), self.pulse if name == "reply" else self.off
            if answer is not None and packet.lines > 1 and "number" not in answer.names:
                raise InvalidInputError(
                    f"device.{name}: expected the name number, as the answers to the"
                    f" {packet.lines} lines of a packet look alike, got none"
                )
        reports = [packet for packet in (self.reply, self.off_reply) if packet is not None]
        if self.limits.temperature is not None and not any(
            "temperature" in packet.names for packet in reports
        ):
            raise InvalidInputError(
                "limits.temperature: expected the name temperature in device.reply or"
                " device.off_reply, got none"
            )
        self._check_rotation()

    def _check_rotation(self) -> None:
        """Check that somebody rotates the field: the device, which knows the frequency, or the
        computer, which sends updates.
        """
        device, form = self.device, self.form.field
        turns = self.form.kind in ("roll", "swim")
        if device.updates is None:
            if turns and "frequency" not in self.pulse.names:
                raise InvalidInputError(
                    "device.updates: expected packets a second, as device.pulse has no frequency and"
                    " so nobody rotates the field, got none"
                )
            return
        coils = self.form.coils.names if self.form.coils else []
        if not turns or not {*COMPONENTS, *coils} & set(self.pulse.names):
            raise InvalidInputError(
                "device.updates: expected a field that turns, and its components or coils in"
                f" device.pulse, got {device.updates:g} without"
            )
        assert form is not None
        assert form.frequency is not None
        if device.updates < PER_TURN * form.frequency:
            raise InvalidInputError(
                f"device.updates: expected at least {PER_TURN} packets a turn"
                f" ({PER_TURN * form.frequency:g} a second), got {device.updates:g}"
            )


def read_actuation(path: str | Path) -> Actuation:
    """Read an actuation file.

    Parameters
    ----------
    path : path
        TOML, or JSON if it ends with ``.json``.

    Raises
    ------
    InvalidInputError
        Raised for a wrong field; the message names the file and the field.
    """
    path = Path(path)
    text = read_text(path, what="actuation file", most=LARGEST_FILE)
    parse = parse_json if path.suffix == ".json" else parse_toml
    data = parse(text, where=str(path))
    try:
        form = ActuationForm.model_validate(data)
    except ValidationError as error:
        raise InvalidInputError(validation_message(error, where=str(path))) from None
    with errors_at(path):
        return Actuation(form)


def _check_names(names: Any, what: str, reserved: Any) -> None:
    for at, name in enumerate(names):
        if not re.fullmatch("[A-Za-z_][A-Za-z0-9_]*", name):
            raise InvalidInputError(
                f"{what}: expected names of letters, digits and _, got {shortened(name)}"
            )
        if name in reserved or name in list(names)[:at]:
            raise InvalidInputError(f"{what}: expected a name that is free, got {name!r}")
    if not names:
        raise InvalidInputError(f"{what}: expected names, got none")


def _direction(angle: float) -> NDArray[np.float64]:
    """Return the horizontal unit vector in a direction. Along the axes it is exact."""
    return np.array([_cosine(angle), _cosine(angle - 90), 0.0], dtype=np.float64)


def _spherical(azimuth: float, polar: float) -> NDArray[np.float64]:
    flat = _cosine(polar - 90) * _direction(azimuth)
    return np.array([flat[0], flat[1], _cosine(polar)], dtype=np.float64)


def _cosine(angle: float) -> float:
    """Return the cosine of an angle in degrees, exactly 0 at 90 and 270."""
    return 0.0 if angle % 180 == 90 else cos(radians(angle))


def _duty(polynomial: list[float], current: float) -> float:
    """Return sign(i) (c0 + c1 |i| + c2 i^2 + ...), and 0 without current."""
    if not current:
        return 0.0
    size = sum(factor * abs(current) ** power for power, factor in enumerate(polynomial))
    return size if current > 0 else -size
