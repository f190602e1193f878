"""Coils behind a serial line or TCP, by the templates of an actuation file.

The packet that turns the field off follows each pulse, and is sent at a stop, after each error, and
when the program ends.
"""

from __future__ import annotations

import atexit
import math
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Protocol

from shoal.core.checks import check_number, count_text
from shoal.core.errors import InvalidInputError, RigError
from shoal.core.interruption import interruption_held
from shoal.rigs.actuation import Actuation, read_actuation
from shoal.rigs.packets import Packet, Splitter
from shoal.rigs.transports import ConnectionCutError, Transport, open_transport

OFF_TIMES, OFF_PAUSE = 3, 0.02  # how often a stop says "off" without an answer, seconds between
CONVERTED = ("milliseconds", "microseconds", "angle_rad", "tilt_rad", "axis_rad")
REOPENING = 3.0  # seconds for which a lost line is opened again to turn the field off
PAUSE = 0.05  # seconds between two attempts
PINGS = 4  # messages to the keep-alive process in the silence that it allows
LATE = 1.25  # share of the time asked for, from which on a pulse counts as too long
SLACK = 0.5  # seconds beyond the longest pulse after which the keep-alive process steps in


Acts = list[tuple[Callable[[], None], float]]


class CoilLine(Protocol):
    """A line to coils. ``why`` says why somebody else has turned the field off, or is empty."""

    name: str
    why: str

    def open(self) -> None:
        """Open the line."""

    def write(self, data: bytes, *, on: bool) -> None:
        """Send a packet, after which the field is on or off."""

    def ping(self) -> None:
        """Say that the drive is alive."""

    def read(self, timeout: float) -> bytes:
        """Return what the device has sent, at the latest after ``timeout`` seconds."""

    def close(self) -> None:
        """Close the line."""


class PlainLine:
    """A line to coils that this process itself holds.

    Parameters
    ----------
    transport : Transport
    """

    def __init__(self, transport: Transport) -> None:
        self.transport, self.name, self.why = transport, transport.name, ""

    def open(self) -> None:
        """Open the line."""
        self.transport.open()

    def write(self, data: bytes, *, on: bool) -> None:
        """Send a packet."""
        self.transport.write(data)

    def ping(self) -> None:
        """Do nothing."""

    def read(self, timeout: float) -> bytes:
        """Return what the device has sent."""
        return self.transport.receive(timeout)

    def close(self) -> None:
        """Close the line."""
        self.transport.close()


class CoilActuator:
    """An actuator of coils, described by an actuation file.

    Parameters
    ----------
    actuation : Actuation or path
        The actuation, or the name of its file.

    Attributes
    ----------
    pulses : dict
        Angle in degrees and time in seconds of each command.
    only : bool
        Whether it knows no other directions than those of the commands.
    longest : float
        Longest pulse in seconds.
    temperature : float or None
        Last temperature that the device has reported, in degrees Celsius.
    last : dict
        The values of the last push by name, and "on": how long the field was on by our clock, in
        seconds.
    late : float or None
        How long the field was on at the last push, in seconds, if our clock ended the pulse more
        than a quarter too late, because this computer was busy.

    Raises
    ------
    InvalidInputError
        Raised if the file is wrong.
    RigError
        Raised if the line cannot be opened.
    """

    def __init__(self, actuation: Actuation | str | Path) -> None:
        actuation = actuation if isinstance(actuation, Actuation) else read_actuation(actuation)
        self.actuation, self.pulses, self.name = actuation, dict(actuation.pulses), actuation.name
        device = actuation.device
        self.only = actuation.form.field is None  # custom commands have no directions between them
        self.longest = actuation.limits.pulse
        self.temperature: float | None = None
        self.last: dict[str, float] = {}
        self.late: float | None = None
        self._all_late: list[tuple[float, float]] = []  # seconds, and those asked for
        self._number, self._most = 0, actuation.largest_number
        self._stopped = self._closed = False
        # when the last pulse ended, and how long the coils must cool; another process may have
        # ended its longest pulse just now
        self._ended, self._pause = time.monotonic(), self._cooling(actuation.limits.pulse)
        self._writing, self._pusher = threading.Lock(), 0
        answers = [
            packet
            for packet in (actuation.error, actuation.reply, actuation.off_reply)
            if packet is not None
        ]
        self._splitter = Splitter(device.packets, answers)
        self._line = self._make_line(device.connection)
        try:
            self._line.open()
        except BaseException as error:
            self._line.close()
            if isinstance(error, ConnectionCutError):
                raise RigError(f"{self.name}: cannot open {self._line.name}: {error}") from None
            raise
        atexit.register(self.close)
        try:
            if device.ready:  # a device that begins anew may not hear the first packet
                self._write(actuation.off.encode({"number": 0.0}), on=False)
                time.sleep(device.ready)
            self._turn_off()
        except BaseException as error:
            self.close()
            if isinstance(error, ConnectionCutError):
                raise RigError(
                    f"{self.name}: the line {self._line.name} is lost: {error}"
                ) from None
            raise

    @property
    def frequency(self) -> float | None:
        """Turns of the field a second, or None if it does not turn."""
        field = self.actuation.form.field
        return None if field is None else field.frequency

    def set_frequency(self, frequency: float) -> None:
        """Turn the field at another frequency (in Hz) from the next push on.

        Raises
        ------
        InvalidInputError
            Raised if the field does not turn, or the device cannot turn it so fast.
        """
        form = self.actuation.form
        if form.field is None or form.field.frequency is None:
            raise InvalidInputError(f"frequency: expected a field that turns, got {self.name}")
        field = form.field.model_copy(
            update={"frequency": check_number(frequency, what="frequency", above=0)}
        )
        self.actuation = Actuation(form.model_copy(update={"field": field}))

    def _make_line(self, address: str) -> CoilLine:
        device, limits = self.actuation.device, self.actuation.limits
        # its errors come before a process is started
        transport = open_transport(address, what="device.connection")
        if device.keep_alive is None:
            return PlainLine(transport)
        from shoal.rigs.keepalive import KeeperLine

        within = device.reply.within if device.reply else 0.0
        return KeeperLine(
            address,
            off=self.actuation.off.encode({"number": 0.0}),
            silence=device.keep_alive,
            longest=(device.repeat + 1) * (limits.pulse + within) + SLACK,
        )

    def push(self, angle: float, seconds: float) -> None:
        """Turn the field on in a direction (degrees) for some seconds, and off again, and let the
        particles settle.

        Raises
        ------
        InvalidInputError
            Raised beyond a limit, before anything is sent.
        RigError
            Raised if the coils have been stopped, are too hot, do not answer, or report an error.
        """
        check_number(seconds, what="seconds", above=0)
        number = self._number % self._most + 1
        values = self.actuation.values(angle, seconds, number=number)
        packet = self.actuation.packet(angle, seconds, number=number)
        self._check_usable()
        time.sleep(max(0.0, self._ended + self._pause - time.monotonic()))
        self._number, self.last = number, values
        self._forget_answers()
        self._pusher, began = threading.get_ident(), time.monotonic()
        failure: BaseException | None = None
        try:
            self._pulse(angle, seconds, packet)
        except ConnectionCutError as error:
            failure = error
            raise RigError(f"{self.name}: the line {self._line.name} is lost: {error}") from None
        except BaseException as error:
            failure = error
            raise
        finally:
            try:
                with interruption_held():
                    self._turn_off(failure)
            finally:
                self._pusher, self._ended = 0, time.monotonic()
                self.last["on"] = on = self._ended - began
                self.late = on if not self.actuation.device.timed and on > LATE * seconds else None
                if self.late is not None:
                    self._all_late.append((on, seconds))
                self._pause = self._cooling(on)
        time.sleep(self.actuation.form.pulse.settle)

    def _cooling(self, seconds: float) -> float:
        """Return how long the coils must be off after a pulse of some seconds."""
        share = self.actuation.limits.duty_cycle
        return 0.0 if share is None else seconds * (1 / share - 1)

    @property
    def values(self) -> dict[str, float]:
        """What was commanded and measured at the last push, by name; each value in one unit."""
        readings = self.last | (
            {} if self.temperature is None else {"temperature": self.temperature}
        )
        return {name: round(value, 6) for name, value in readings.items() if name not in CONVERTED}

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of the pulses so far, in sentences."""
        if not self._all_late:
            return ()
        on, seconds = max(self._all_late)
        pulses = count_text(len(self._all_late), "pulse")
        return (
            f"{self.name}: {pulses} lasted more than a quarter too long, the longest {on:.2g} s instead"
            f" of {seconds:.2g} s, because this computer was busy: particles may have gone two cells"
            " far. A controller that ends pulses itself (timed) would not mind",
        )

    def _pulse(self, angle: float, seconds: float, packet: bytes) -> None:
        """Turn the field on and keep it on, until the time is over or the device says so."""
        device, answer = self.actuation.device, self.actuation.reply
        for _ in range(1 + device.repeat):
            began = time.monotonic()
            acts = self._acts(began, angle, seconds)
            self._write(packet, on=True)
            if device.reply is None:
                break
            at_end = device.reply.when == "end"
            if self._await(answer, began + seconds * at_end + device.reply.within, acts):
                if at_end:
                    return
                break
        else:
            assert device.reply is not None
            raise RigError(
                f"{self.name}: no answer to pulse {self._number} within {device.reply.within:g} s:"
                f" expected {device.reply.text or device.reply.values}"
            )
        self._await(None, began + seconds, acts)

    def _acts(self, began: float, angle: float, seconds: float) -> Acts:
        """Return what must be done while the field is on, and how often (in seconds)."""
        actuation, device = self.actuation, self.actuation.device

        def say_alive() -> None:
            assert actuation.alive is not None
            self._write(actuation.alive.encode({"number": float(self._number)}), on=True)

        def update() -> None:
            passed = min(time.monotonic() - began, seconds)
            self._write(actuation.packet(angle, seconds, number=self._number, time=passed), on=True)

        acts: Acts = []
        if device.keep_alive is not None:
            acts.append((self._line.ping, device.keep_alive / PINGS))
        if device.alive is not None:
            acts.append((say_alive, device.alive.every))
        if device.updates is not None:
            acts.append((update, 1 / device.updates))
        return acts

    def _await(self, answer: Packet | None, until: float, acts: Acts) -> bool:
        """Wait for an answer, and return whether it came. Meanwhile, carry out acts again and
        again.
        """
        due = [time.monotonic() + gap for _, gap in acts]
        while (now := time.monotonic()) < until:
            for at, (act, gap) in enumerate(acts):
                if due[at] <= now:
                    act()
                    due[at] = max(due[at] + gap, now)
            if self._read_answer(answer, max(0.0, min([until, *due]) - time.monotonic())):
                return True
            if self._stopped and acts:
                break
        return False

    def _read_answer(self, answer: Packet | None, timeout: float) -> bool:
        """Read what the device sends for some time. Return whether the answer is among it."""
        answered = False
        sent = self.last | {"number": float(self._number)}
        for message in self._splitter.messages(self._line.read(timeout)):
            if self.actuation.error is not None:
                wrong = self.actuation.error.read(message, sent)
                if wrong is not None:
                    raise RigError(f"{self.name}: the coils report {_message_text(message)}")
            reading = None if answer is None else answer.read(message, sent)
            if reading is not None:
                answered = True
                self.temperature = reading.get("temperature", self.temperature)
        why, self._line.why = self._line.why, ""
        if why and not answered:
            raise RigError(f"{self.name}: the keep-alive process has turned the field off: {why}")
        return answered

    def _write(self, data: bytes, *, on: bool) -> None:
        with self._writing:
            if on:
                self._check_usable()
            self._line.write(data, on=on)

    def _check_usable(self) -> None:
        if self._stopped:
            raise RigError(f"{self.name}: the coils have been stopped")
        limit = self.actuation.limits.temperature
        if limit is None or self.temperature is None:
            return
        if not math.isfinite(self.temperature):  # as of a broken sensor
            raise RigError(
                f"{self.name}: expected a temperature of the coils in °C (limits.temperature), got"
                f" {self.temperature:g}"
            )
        if self.temperature > limit:
            raise RigError(
                f"{self.name}: expected coils of at most {limit:g} °C (limits.temperature), got"
                f" {self.temperature:g}"
            )

    def _forget_answers(self) -> None:
        """Forget answers that came late. A line that was lost in the meantime is opened again."""
        try:
            while self._line.read(0.0):
                continue
        except ConnectionCutError:
            self._turn_off()
        self._splitter.clear()

    def _turn_off(self, failure: BaseException | None = None, *, times: int = 1) -> None:
        """Send the packet that turns the field off, and wait for its answer if there is one. Open a
        lost line again for it.
        """
        actuation, reply = self.actuation, self.actuation.device.off_reply
        packet = actuation.off.encode({"number": float(self._number)})
        until, why = time.monotonic() + REOPENING, ""
        tries = OFF_TIMES if reply is not None else times
        while tries:
            try:
                self._line.read(0.0)  # a line that is lost takes bytes, but can be read no more
                self._write(packet, on=False)
                tries, why = tries - 1, ""
                if reply is None:
                    time.sleep(OFF_PAUSE if tries else 0.0)
                elif self._await(actuation.off_reply, time.monotonic() + reply.within, []):
                    return
                else:
                    why = f"no answer within {reply.within:g} s"
            except RigError as error:  # the device has heard it, and reports an error
                why = str(error)
            except ConnectionCutError as error:
                why = str(error)
                if time.monotonic() > until:
                    break
                time.sleep(PAUSE)
                with suppress(ConnectionCutError):
                    self._reopen()
        if why:
            raise RigError(f"{self.name}: the field may still be on: {why}") from failure

    def _reopen(self) -> None:
        """Open a lost line again. A keep-alive process that lives does so itself."""
        if getattr(self._line, "alive", False):
            return
        self._line.close()
        if not isinstance(self._line, PlainLine):
            self._line = PlainLine(open_transport(self.actuation.device.connection))
        self._line.open()

    def stop(self) -> None:
        """Turn the field off at once. The coils then refuse further pushes. Another thread may call
        it during a push.

        Raises
        ------
        RigError
            Raised if the line is lost, or the device does not confirm it: the field may still be on.
        """
        self._stopped = True
        if self._closed:
            return
        if self._pusher not in (0, threading.get_ident()):  # the push itself waits for the answer
            with suppress(ConnectionCutError):
                self._write(self.actuation.off.encode({"number": float(self._number)}), on=False)
            return
        with interruption_held():
            self._turn_off(times=OFF_TIMES)

    def close(self) -> None:
        """Turn the field off, and close the line."""
        if self._closed:
            return
        try:
            self.stop()
        except (RigError, ConnectionCutError):
            pass  # said by stop() before, or there is no line
        finally:
            self._closed = True
            atexit.unregister(self.close)
            self._line.close()


def _message_text(message: bytes) -> str:
    """Return a message of a device for people."""
    text = message.decode(errors="replace")
    return repr(text[:80]) if text.isprintable() else message[:40].hex(" ")
