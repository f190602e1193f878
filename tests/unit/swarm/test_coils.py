"""Actuation files, and coils behind pseudo-terminals and TCP."""

from __future__ import annotations

import copy
import importlib.util
import itertools
import json
import os
import signal
import struct
import subprocess
import sys
import threading
import time
import tomllib
from math import pi
from pathlib import Path

import numpy as np
import pytest
from tests.coil_devices import Controller, Server, Terminal, lines

from shoal import GridWorkspace, InvalidInputError
from shoal.cli import run as shoal
from shoal.core.errors import RigError
from shoal.rigs.actuation import read_actuation
from shoal.rigs.calibration import Responses
from shoal.rigs.coils import CoilActuator
from shoal.rigs.packets import Packet, Splitter, Template, cobs_packet, crc8
from shoal.rigs.ports import BenchRig, CellCalibration
from shoal.rigs.rig import Frame
from shoal.rigs.trim import PulseTrim
from shoal.testing import check_actuator

pytest.importorskip("serial")
ROOT = Path(__file__).parents[3]

PULLER = {
    "kind": "pull",
    "field": {"magnitude": 100.0, "unit": "mA"},
    "pulse": {"seconds": 0.02},
    "coils": {
        "names": ["right", "up", "left", "down"],
        "matrix": [[1, 0], [0, 1], [-1, 0], [0, -1]],
        "one_sided": True,
    },
    "device": {
        "connection": "tcp:127.0.0.1:9",
        "packets": "text",
        "pulse": {"text": "SET {right:.0f} {up:.0f} {left:.0f} {down:.0f}"},
        "off": {"text": "SET 0 0 0 0"},
    },
}
ROLLER = {
    "kind": "roll",
    "field": {"magnitude": 8.0, "frequency": 10.0},
    "pulse": {"seconds": 0.02},
    "device": {
        "connection": "tcp:127.0.0.1:9",
        "packets": "cobs",
        "pulse": {
            "struct": "<7f",
            "values": ["magnitude", "axis_rad", "tilt_rad", "frequency", 0, 0, "seconds"],
        },
        "off": {"struct": "<7f", "values": [0, 0, 0, 0, 0, 0, 0]},
        "timed": True,
    },
}
OFF = "SET 0 0 0 0"


def changed(base, **values):
    """Return a copy with values at dotted places; None removes."""
    data = copy.deepcopy(base)
    for place, value in values.items():
        *path, last = place.split("__")
        at = data
        for name in path:
            at = at.setdefault(name, {})
        if value is None:
            del at[last]
        else:
            at[last] = value
    return data


def written(folder, base, **values):
    path = folder / "actuation.json"
    path.write_text(json.dumps(changed(base, **values)))
    return path


# -------------------------------------------------------------------------------------------------
# packets


def test_packets_of_pyserialtransfer_are_those_of_its_own_package():
    crc = pytest.importorskip("pySerialTransfer.CRC").CRC()
    transfer = pytest.importorskip("pySerialTransfer.pySerialTransfer").SerialTransfer

    class Wire:
        is_open, data = True, b""

        def write(self, data):
            self.data += data

    rng = np.random.default_rng(1)
    for turn in range(200):
        size = int(rng.choice([1, 2, 7, 253, 254]))
        payload = bytes(rng.choice([0x7E, 0x81, 0, 1, 0xFF], size=size).astype(np.uint8))
        if turn % 2:
            payload = rng.bytes(size)
        link = transfer("nowhere", restrict_ports=False)
        link.connection = Wire()
        link.tx_struct_obj(payload)
        assert link.send(size, packet_id=turn)
        assert cobs_packet(payload, turn) == link.connection.data
        assert crc8(payload) == crc.calculate(list(payload))
        splitter = Splitter("cobs", [])
        stream = b"\x00\x81" + link.connection.data + b"\x00" + link.connection.data
        found = [one for byte in stream for one in splitter.messages(bytes([byte]))]
        assert found[-1] == bytes([turn]) + payload


def test_damaged_packets_are_left_out_and_the_next_one_is_found():
    good = cobs_packet(b"hello \x7e \x7e", 3)
    for at in range(len(good)):
        for change in (1, 0x80):
            bad = bytearray(good)
            bad[at] ^= change
            found = list(Splitter("cobs", []).messages(bytes(bad) + b"\x00" * 260 + good * 2))
            assert found[-1] == b"\x03hello \x7e \x7e"
            assert all(one in (b"\x03hello \x7e \x7e",) or at in (1, 2) for one in found)


def test_answers_as_text():
    packet = Packet("text", Template(text="done {number} at {temperature} {any}"), ANSWER)
    sent = {"number": 7.0}
    assert packet.read(b"done 7 at 21.5 C", sent) == {"temperature": 21.5}
    assert packet.read(b"done 8 at 21.5 C", sent) is None
    assert packet.read(b"done 7 at warm C", sent) is None
    assert list(Splitter("text", []).messages(b"a\r\n\nb\rc")) == [b"a", b"b"]
    several = Packet("text", Template(text="A {number:03d}\nB {number:x}\r"), ANSWER)
    assert several.encode({"number": 31.0}) == b"A 031\nB 1f\r"


def test_answers_as_structs_are_found_among_other_bytes():
    template = Template(struct="<BHe", values=[0xAA, "number", "temperature"])
    packet = Packet("struct", template, ANSWER)
    message = struct.pack("<BHe", 0xAA, 7, 21.5)
    found = list(Splitter("struct", [packet]).messages(b"\x00\xab" + message + b"\x01" + message))
    assert found == [message, message]
    assert packet.read(message, {"number": 7.0}) == {"temperature": 21.5}
    assert packet.read(message, {"number": 8.0}) is None


ANSWER = ("number", "temperature", "any")


@pytest.mark.parametrize(
    ("form", "template", "words"),
    [
        ("text", {"struct": "B"}, "expected text"),
        ("text", {"text": "a", "values": [1]}, "expected text, and neither"),
        ("text", {"text": "{nmber}"}, "got 'nmber' (did you mean 'number'?)"),
        ("text", {"text": "{number.real}"}, "got 'number.real'"),
        ("text", {"text": "{number:q}"}, "formats of Python"),
        ("text", {"text": "{number!r}"}, "no conversion"),
        ("text", {"text": "{number"}, "names and formats of Python in braces"),
        ("text", {"text": "a\nb\n"}, "expected one line"),
        ("text", {"text": "\n"}, "expected one line"),
        ("text", {"text": "{number:.2d}"}, "Precision not allowed"),
        ("struct", {"text": "a"}, "expected struct and values"),
        ("struct", {"struct": "<Y", "values": []}, "a format of Python's struct"),
        ("struct", {"struct": "<4s", "values": [1]}, "formats of numbers"),
        ("struct", {"struct": "<2BH", "values": [1, 2]}, "values: expected 3"),
        ("struct", {"struct": "<B", "values": ["x"]}, "names out of number"),
        ("cobs", {"struct": "<255B", "values": [0] * 255}, "1 to 254 bytes, got 255"),
    ],
)
def test_wrong_templates(form, template, words):
    with pytest.raises(InvalidInputError) as error:
        Packet(form, Template(**template), ANSWER, answer=True)
    assert words in str(error.value)


# -------------------------------------------------------------------------------------------------
# actuation


@pytest.mark.parametrize("name", ["four_coil_puller", "helmholtz_roller"])
def test_the_examples_are_right(name):
    actuation = read_actuation(ROOT / "examples" / "actuation" / f"{name}.toml")
    assert actuation.pulses["u"] == (90.0, 0.083)
    assert actuation.packet(0.0, 0.05, number=3) != actuation.packet(90.0, 0.05, number=3)


def test_a_pull_needs_the_coils_on_its_side(tmp_path):
    path = written(tmp_path, PULLER, coils__polynomial=[10.0, 0.5], commands={"u": {"angle": 100}})
    actuation = read_actuation(path)
    assert actuation.packet(0.0, 0.02, number=1) == b"SET 60 0 0 0\n"
    assert actuation.packet(270.0, 0.02, number=1) == b"SET 0 0 0 60\n"
    values = actuation.values(60.0, 0.02, number=1)
    assert (values["right"], values["left"]) == (pytest.approx(35.0), 0.0)
    assert values["up"] == pytest.approx(10 + 0.5 * 100 * np.sqrt(3) / 2)
    assert actuation.pulses["u"] == (100, 0.02)


def test_a_particle_rolls_to_where_the_field_carries_its_top(tmp_path):
    path = written(tmp_path, ROLLER, field__heading=20.0)
    actuation = read_actuation(path)
    values = actuation.values(10.0, 0.02, number=1)
    assert (values["angle"], values["axis"], values["tilt"]) == (30.0, 120.0, 90.0)
    turning = [
        [actuation.values(10.0, 0.02, number=1, time=t)[name] for name in ("bx", "by", "bz")]
        for t in (0.0, 0.001)
    ]
    omega = np.cross(*turning)  # the direction about which the field turns
    omega /= np.linalg.norm(omega)
    motion = np.cross(omega, [0, 0, 1])  # omega x r, with r from the floor to the top
    assert motion == pytest.approx([np.cos(pi / 6), 0.5, 0.0])
    assert np.linalg.norm(turning, axis=1) == pytest.approx([8.0, 8.0])
    assert np.dot(*turning) / 64 == pytest.approx(np.cos(2 * pi * 10 * 0.001))


def test_a_particle_swims_along_the_axis(tmp_path):
    actuation = read_actuation(written(tmp_path, ROLLER, kind="swim", field__tilt=60.0))
    values = actuation.values(30.0, 0.02, number=1)
    turning = [
        [actuation.values(30.0, 0.02, number=1, time=t)[name] for name in ("bx", "by", "bz")]
        for t in (0.0, 0.001)
    ]
    omega = np.cross(*turning)
    expected = np.array([np.cos(pi / 6), 0.5, 0]) * np.sin(pi / 3) + [0, 0, 0.5]
    assert omega / np.linalg.norm(omega) == pytest.approx(expected)
    assert values["axis_rad"] == pytest.approx(pi / 6)


CUSTOM = changed(
    PULLER, kind="custom", field=None, coils=None, device__pulse={"text": "GO {way}"},
    commands={letter: {"values": {"way": at}} for at, letter in enumerate("lurd")},
)  # fmt: skip


def test_custom_commands_have_values_of_their_own(tmp_path):
    actuation = read_actuation(written(tmp_path, CUSTOM))
    assert actuation.packet(180.0, 0.01, number=1) == b"GO 0\n"
    assert actuation.packet(-90.0, 0.01, number=1) == b"GO 3\n"
    with pytest.raises(InvalidInputError, match=r"custom commands \(0, 90, 180, 270 degrees\), g"):
        actuation.packet(45.0, 0.01, number=1)


TEXT = {"packets": "text", "off": {"text": "0"}, "timed": False}


@pytest.mark.parametrize(
    ("base", "values", "words"),
    [
        (PULLER, {"kind": "push"}, "kind: expected 'pull', 'roll', 'swim' or 'custom', got 'push'"),
        (PULLER, {"kind": None}, "kind: expected this field, got none"),
        (PULLER, {"colour": 1}, "colour: expected no such field, got 1"),
        (PULLER, {"field__magnitude": "8"}, "field.magnitude: expected a number, got '8'"),
        (PULLER, {"field__magnitude": 0}, "field.magnitude: expected greater than 0, got 0"),
        (PULLER, {"field__frequency": 5}, "field.frequency: expected none for the kind pull, got"),
        (PULLER, {"field__tilt": 5}, "field.tilt: expected none for the kind pull, got 5"),
        (PULLER, {"field": None}, "field: expected one for the kind pull, got none"),
        (PULLER, {"pulse__seconds": True}, "pulse.seconds: expected a number, got True"),
        (PULLER, {"pulse__seconds": -1}, "pulse.seconds: expected greater than 0, got -1"),
        (PULLER, {"commands": {"x": {}}}, "commands.x"),
        (PULLER, {"commands": {"l": {"values": {"a": 1}}}}, "commands.l.values: expected no values"),
        (PULLER, {"coils__names": ["a", "b"]}, "coils.matrix: expected 2 rows of 2 or 3 numbers"),
        (PULLER, {"coils__matrix": [[1, 0], [0, 1, 2], [1, 1], [1, 1]]}, "coils.matrix: expected 4"),
        (PULLER, {"coils__names": ["a", "a", "b", "c"]}, "coils.names: expected a name that is fr"),
        (PULLER, {"coils__names": ["bx", "a", "b", "c"]}, "coils.names: expected a name that is f"),
        (PULLER, {"coils__names": ["a b", "a", "b", "c"]}, "coils.names: expected names of letter"),
        (PULLER, {"coils__polynomial": [[1.0]]}, "coils.polynomial: expected coefficients, or a l"),
        (PULLER, {"coils__polynomial": []}, "coils.polynomial: expected coefficients"),
        (PULLER, {"limits": {"field": 5}}, "limits.field: expected a field in mT, got none to lim"),
        (PULLER, {"limits": {"duty": 5}}, "limits.duty: expected coils with a polynomial, got non"),
        (PULLER, {"limits": {"current": 99}}, "expected at most 99 mA (limits.current), got 100"),
        (PULLER, {"limits": {"duty": 50}, "coils__polynomial": [10, 0.5]},
         "command r: device.pulse: right: expected at most 50 (limits.duty), got 60"),
        (PULLER, {"limits": {"pulse": 0.01}}, "expected a pulse of at most 0.01 s (limits.pulse)"),
        (PULLER, {"limits": {"temperature": 60}}, "limits.temperature: expected the name temperat"),
        (PULLER, {"limits": {"duty_cycle": 2}}, "limits.duty_cycle: expected less than or equal t"),
        (PULLER, {"device__connection": "usb"}, "device.connection: expected serial:DEVICE[@BAUD]"),
        (PULLER, {"device__pulse": {"text": "GO"}}, "device.pulse: expected a name out of angle"),
        (PULLER, {"device__pulse": {"text": "{rigt}"}}, "(did you mean 'right'?)"),
        (PULLER, {"device__off": {"text": "{right}"}}, "device.off: text: expected names out of n"),
        (PULLER, {"device__timed": True}, "device.timed: expected a time (such as milliseconds)"),
        (PULLER, {"device__reply": {"text": "OK", "when": "end"}}, "device.reply.when: expected be"),
        (PULLER, {"device__off_reply": {"text": "OK", "when": "end"}}, "device.off_reply.when: exp"),
        (PULLER, {"device__repeat": 2}, "device.repeat: expected the name number"),
        (PULLER, {"device__reply": {"text": "OK"}, "device__pulse": {"text": "A {right}\nB {up}"}},
         "device.reply: expected the name number, as the answers to the 2 lines of a packet look"),
        (PULLER, {"device__updates": 50}, "device.updates: expected a field that turns"),
        (PULLER, {"device__keep_alive": 0.001}, "device.keep_alive: expected greater than or equa"),
        (PULLER, {"device__alive": {"text": "A"}}, "device.alive.every: expected this field"),
        (PULLER, {"device__pulse": {"struct": "B", "values": ["right"]}}, "device.pulse: expected t"),
        (ROLLER, {"device__pulse": {"struct": "<b2H", "values": ["magnitude", "frequency", "axis"]},
                  "field__magnitude": 200.0, "device__timed": False},
         "command r: device.pulse: expected values that fit the format <b2H, got [200, 10, 90]"),
        (ROLLER, {"field__frequency": None}, "field.frequency: expected one for the kind roll"),
        (ROLLER, {"field__tilt": 200}, "field.tilt: expected less than or equal to 180, got 200"),
        (ROLLER, {"limits": {"field": 5}}, "field.magnitude: expected at most 5 mT (limits.field)"),
        (ROLLER, {"limits": {"current": 5}}, "limits.current: expected coils, or a field in mA"),
        (ROLLER, {"coils": {"names": ["a"], "matrix": [[1, 2]]}}, "rows of 3 numbers for a field"),
        (ROLLER, {"coils": {"names": ["a"], "matrix": [[1, 2, 3]], "one_sided": True}},
         "coils.one_sided: expected false for the kind roll"),
        (ROLLER, {"coils": {"names": ["a"], "matrix": [[1, 0, 0]]}, "limits": {"current": 7}},
         "a: expected at most 7 mA (limits.current), got 8"),
        (ROLLER, {"device": TEXT | {"connection": "tcp:x:1", "pulse": {"text": "{bx}"}}},
         "device.updates: expected packets a second, as device.pulse has no frequency"),
        (ROLLER, {"device": TEXT | {"connection": "tcp:x:1", "pulse": {"text": "{bx}"},
                                    "updates": 30}},
         "device.updates: expected at least 4 packets a turn (40 a second), got 30"),
        (CUSTOM, {"field": {"magnitude": 1}}, "field: expected none for the kind custom, got one"),
        (CUSTOM, {"commands__l": {}}, "commands.l.values: expected the values of each command"),
        (CUSTOM, {"commands__l": {"values": {"b": 1}}}, "commands.l.values: expected the names way"),
        (CUSTOM, {"device__pulse": {"text": "{seconds}"}}, "device.pulse: expected a name out of w"),
    ],
)  # fmt: skip
def test_wrong_actuation_files(base, values, words, tmp_path):
    path = written(tmp_path, base, **values)
    with pytest.raises(InvalidInputError) as error:
        read_actuation(path)
    assert str(error.value).startswith(f"{path}: ")
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_pushes_beyond_a_limit_are_refused(tmp_path):
    limits = {"current": 100.0, "pulse": 0.05}
    actuation = read_actuation(written(tmp_path, PULLER, limits=limits))
    with pytest.raises(InvalidInputError, match=r"seconds: expected at most 0.05 \(limits.pulse\)"):
        actuation.packet(45.0, 0.06, number=1)


PULSE = "device__pulse"
DUTY = {"coils__polynomial": [0, 0.5], "limits": {"current": 99.2, "duty": 60}}


@pytest.mark.parametrize(
    ("base", "values", "words"),
    [
        (PULLER, {"pulse__seconds": 0.6, "limits": {"pulse": 0.6}, PULSE: {"text": "P {angle:.0f} {seconds:.0f}"}},
         "seconds: expected at most 0.6 (limits.pulse) as the packet rounds it, got 1 for 0.6"),
        (PULLER, {"limits": {"current": 99.6}, "field__magnitude": 99.6},
         "right: expected at most 99.6 (limits.current) as the packet rounds it, got 100 for 99.6"),
        (PULLER, {"field__magnitude": 99.2, **DUTY},
         "right: expected at most 49.6 (limits.current) as the packet rounds it, got 50 for 49.6"),
        (ROLLER, {"limits": {"field": 8.4}, "field__magnitude": 8.4,
                  PULSE: {"struct": "<hbbb", "values": ["angle", "frequency", "milliseconds", "magnitude"]}}, ""),
        (ROLLER, {"limits": {"field": 8.6}, "field__magnitude": 8.6,
                  PULSE: {"struct": "<hbbb", "values": ["angle", "frequency", "milliseconds", "magnitude"]}},
         "magnitude: expected at most 8.6 (limits.field) as the packet rounds it, got 9 for 8.6"),
        (PULLER, {"field": {"magnitude": 7.6, "unit": "mT"}, "limits": {"field": 7.6},
                  PULSE: {"text": "B {bx:.0f} {by:.0f}"}},
         "bx, by, bz: expected a field of at most 7.6 (limits.field) as the packet rounds it, got 8"),
    ],
)  # fmt: skip
def test_what_a_packet_rounds_beyond_a_limit_is_refused(tmp_path, base, values, words):
    path = written(tmp_path, base, **values)
    if not words:
        read_actuation(path)
        return
    with pytest.raises(InvalidInputError) as error:
        read_actuation(path)
    assert words in str(error.value)


# -------------------------------------------------------------------------------------------------
# coils


@pytest.fixture(params=[Terminal, Server])
def line(request):
    return request.param()


def coils(folder, line, base=PULLER, **values):
    return CoilActuator(written(folder, base, device__connection=line.address, **values))


def test_coils_keep_the_rules_of_actuators(tmp_path, line):
    with Controller(line, lines()) as device:
        reply = {"text": "OK"}
        check_actuator(coils(tmp_path, line, device__reply=reply, device__off_reply=reply))
        assert device.log[:4] == [OFF, "SET 100 0 0 0", OFF, "SET 71 71 0 0"]
        assert device.log[-1] == OFF


def test_without_an_answer_the_field_is_on_for_as_long_as_asked(tmp_path, line):
    with Controller(line, lines(lambda line: None)) as device:
        actuator = coils(tmp_path, line, pulse__settle=0.01)
        actuator.push(90.0, 0.05)
        device.wait(lambda log: log == [OFF, "SET 0 100 0 0", OFF])
        assert actuator.last["on"] >= 0.05
        actuator.close()


def test_pulses_that_a_busy_computer_makes_too_long_are_told(tmp_path, monkeypatch):
    class Sensor:
        name, shape = "points", (3, 3)
        numbers = itertools.count()

        def observe(self):
            return Frame(np.array([[1.0, 1.0]]), time.monotonic(), next(self.numbers))

        def close(self):
            pass

    line = Terminal()
    with Controller(line, lines(lambda line: None)):
        actuator = coils(tmp_path, line)
        trim = PulseTrim(Responses.from_pulses(actuator.pulses))
        rig = BenchRig(actuator, Sensor(), CellCalibration(), trim=trim)
        rig.observe()
        turn_off = actuator._turn_off
        monkeypatch.setattr(actuator, "_turn_off", lambda *one: (time.sleep(0.3), turn_off(*one)))
        rig.send("r")
        assert actuator.late >= 0.3
        assert "1 pulse lasted more than a quarter too long, the longest 0.3" in rig.notes[0]
        # what did not move by as much as 0.3 s would have moved it was held, and teaches nothing
        rig.observe()
        assert trim.responses == Responses.from_pulses(actuator.pulses)
        monkeypatch.undo()
        monkeypatch.setattr(actuator, "_all_late", [])
        rig.push(0.0, 0.3)
        assert actuator.late is None
        assert rig.notes == ()
        actuator.close()


def test_the_frequency_of_a_turning_field_can_be_changed(tmp_path):
    line = Server()
    text = {"packets": "text", "off": {"text": OFF}, "timed": False, "connection": line.address}
    about = changed(ROLLER, **{f"device__{name}": value for name, value in text.items()})
    about["device"]["pulse"] = {"text": "ROT {axis:.0f} {frequency:.0f}"}
    with Controller(line, lines(lambda line: None)) as device:
        actuator = CoilActuator(written(tmp_path, about))
        actuator.set_frequency(25.0)
        actuator.push(0.0, 0.01)
        device.wait(lambda log: log == [OFF, "ROT 90 25", OFF])
        assert actuator.frequency == 25.0
        with pytest.raises(InvalidInputError, match="frequency: expected a number, above 0"):
            actuator.set_frequency(0.0)
        actuator.close()


def test_what_is_beyond_a_limit_is_not_sent(tmp_path):
    line = Terminal()
    with Controller(line, lines()) as device:
        actuator = coils(tmp_path, line, limits={"pulse": 0.03})
        for push in ((0.0, 0.04), (float("inf"), 0.01), (0.0, 0.0)):
            with pytest.raises(InvalidInputError):
                actuator.push(*push)
        actuator.close()
        device.wait(lambda log: len(log) == 4)
        assert set(device.log) == {OFF}


def test_an_error_of_the_device_turns_the_field_off(tmp_path, line):
    def answer(text):
        return b"OK\n" if text == OFF else b"ERR coil 2 is open\n"

    with Controller(line, lines(answer)) as device:
        actuator = coils(
            tmp_path, line, device__reply={"text": "OK"}, device__error={"text": "ERR {any}"}
        )
        with pytest.raises(RigError, match="the coils report 'ERR coil 2 is open'"):
            actuator.push(0.0, 0.02)
        device.wait(lambda log: log == [OFF, "SET 100 0 0 0", OFF])
        actuator.close()


def test_no_answer_turns_the_field_off_and_is_never_sent_twice(tmp_path):
    line = Terminal()
    with Controller(line, lines(lambda text: None)) as device:
        actuator = coils(tmp_path, line, device__reply={"text": "OK", "within": 0.03})
        with pytest.raises(RigError, match=r"no answer to pulse 1 within 0.03 s: expected OK"):
            actuator.push(0.0, 0.02)
        device.wait(lambda log: log == [OFF, "SET 100 0 0 0", OFF])
        actuator.close()


NUMBERED = {
    "device__pulse": {"text": "P {number} {milliseconds:.0f} {right:.0f}"},
    "device__off": {"text": "OFF {number}"},
    "device__reply": {"text": "DONE {number} {temperature}", "when": "end", "within": 0.3},
    "device__timed": True,
    "device__repeat": 2,
}


def test_a_numbered_pulse_is_repeated_until_the_device_has_heard_it(tmp_path):
    heard = []

    def answer(text):
        heard.append(text)
        pulse = text.startswith("P ")
        return f"DONE {text.split()[1]} 21.5\n".encode() if pulse and len(heard) > 3 else None

    line = Terminal()
    with Controller(line, lines(answer)) as device:
        actuator = coils(tmp_path, line, **NUMBERED)
        actuator.push(0.0, 0.02)
        assert device.log[:4] == ["OFF 0", "P 1 20 100", "P 1 20 100", "P 1 20 100"]
        assert actuator.temperature == 21.5
        actuator.push(0.0, 0.02)
        assert "P 2 20 100" in device.log
        actuator.close()


def test_coils_that_are_too_hot_are_not_turned_on(tmp_path):
    line = Terminal()

    def answer(text):
        return f"DONE {text.split()[1]} 71.5\n".encode() if text.startswith("P") else None

    with Controller(line, lines(answer)) as device:
        actuator = coils(tmp_path, line, limits={"temperature": 70.0}, **NUMBERED)
        actuator.push(0.0, 0.02)
        with pytest.raises(RigError, match=r"at most 70 °C \(limits.temperature\), got 71.5"):
            actuator.push(0.0, 0.02)
        assert sum(one.startswith("P") for one in device.log) == 1
        actuator.close()


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_a_temperature_that_is_none_is_not_cold(tmp_path, value):
    line = Terminal()

    def answer(_controller, data):
        return struct.pack("<Bf", 170, float(value)) * (len(data) // 3)

    device = {
        "packets": "struct",
        "pulse": {"struct": "<Bh", "values": ["number", "angle"]},
        "off": {"struct": "<Bh", "values": [0, 0]},
        "off_reply": {"struct": "<Bf", "values": [170, "temperature"], "within": 1.0},
    }
    fields = {f"device__{name}": one for name, one in device.items()}
    words = r"temperature of the coils in °C \(limits.temperature\), got -?(nan|inf)"
    with Controller(line, answer):
        actuator = coils(tmp_path, line, limits={"temperature": 70.0}, **fields)
        with pytest.raises(RigError, match=words):
            actuator.push(0.0, 0.02)
        actuator.close()


def test_the_next_pulse_waits_for_the_coils_to_cool(tmp_path):
    line = Terminal()
    with Controller(line, lines()):
        began = time.monotonic()
        # before it, another process may have ended a pulse as long as the limit
        actuator = coils(tmp_path, line, limits={"duty_cycle": 0.25, "pulse": 0.03})
        for _ in range(3):
            actuator.push(0.0, 0.02)
        assert time.monotonic() - began >= 0.03 / 0.25 - 0.03 + 2 * 0.02 / 0.25
        actuator.close()


def test_a_field_that_the_computer_rotates(tmp_path):
    line = Terminal()
    device = TEXT | {
        "pulse": {"text": "{bx:.3f} {by:.3f} {bz:.3f}"}, "updates": 400, "connection": line.address,
    }  # fmt: skip
    with Controller(line, lines()) as controller:
        actuator = CoilActuator(written(tmp_path, ROLLER, device=device))
        actuator.push(90.0, 0.4)  # four turns at 10 Hz
        actuator.close()
        controller.wait(lambda log: log[-1] == "0")
        field = np.array([one.split() for one in controller.log if " " in one], dtype=float)
    assert len(field) >= 10
    assert np.linalg.norm(field, axis=1) == pytest.approx(np.full(len(field), 8.0), abs=0.01)
    assert (
        np.abs(field[:, 0]).max() < 0.01
    )  # rolls along y: the field turns in the plane of y and z
    assert np.ptp(field[:, 2]) > 2


def test_a_device_hears_that_the_drive_is_alive(tmp_path):
    line = Terminal()
    with Controller(line, lines()) as device:
        actuator = coils(tmp_path, line, device__alive={"text": "HERE", "every": 0.01})
        actuator.push(0.0, 0.3)
        actuator.close()
        device.wait(lambda log: log[-1] == OFF)
        assert 1 <= device.log.count("HERE") <= 30
        assert device.log.index(OFF, 1) > max(
            at for at, one in enumerate(device.log) if one == "HERE"
        )


def test_a_line_that_is_lost_is_opened_again_to_turn_the_field_off(tmp_path):
    line = Server()

    def answer(text):
        if text != OFF:
            line.cut()

    with Controller(line, lines(answer)) as device:
        actuator = coils(tmp_path, line, device__reply={"text": "OK"})
        with pytest.raises(RigError, match=r"the line tcp:.* is lost"):
            actuator.push(0.0, 0.02)
        device.wait(lambda log: log[-1] == OFF and len(log) == 3)
        actuator.close()


def test_a_line_that_was_lost_between_two_pulses_is_opened_again_before_the_next(tmp_path):
    line = Server()

    def answer(text):
        if len(device.log) == 3:
            line.cut()

    with Controller(line, lines(answer)) as device:
        actuator = coils(tmp_path, line)
        actuator.push(0.0, 0.02)
        device.wait(lambda log: line._line is None)
        actuator.push(90.0, 0.02)
        device.wait(lambda log: log[3:] == [OFF, "SET 0 100 0 0", OFF])
        assert actuator.values["right"] == pytest.approx(0.0, abs=1e-9)
        assert actuator.values["on"] >= 0.02
        assert actuator.values["seconds"] == 0.02
        assert "milliseconds" not in actuator.values
        actuator.close()


def test_a_stop_that_nobody_confirms_is_said(tmp_path):
    line = Terminal()
    words = r"the field may still be on: no answer within 0.02 s"
    with Controller(line, lines(lambda text: None)), pytest.raises(RigError, match=words):
        coils(tmp_path, line, device__off_reply={"text": "OK", "within": 0.02})


@pytest.mark.parametrize("more", [{}, {"device__keep_alive": 2.0}])
def test_another_thread_may_stop_the_coils_during_a_push(tmp_path, more):
    line = Terminal()
    with Controller(line, lines(lambda text: None)) as device:
        alive = {"text": "HERE", "every": 0.01}
        actuator = coils(tmp_path, line, device__alive=alive, **more)
        pushing = threading.Thread(target=actuator.push, args=(0.0, 30.0))
        pushing.start()
        device.wait(lambda log: "HERE" in log)
        actuator.stop()
        pushing.join(5)
        assert not pushing.is_alive()
        device.wait(lambda log: log[-1] == OFF)
        with pytest.raises(RigError, match="stopped"):
            actuator.push(0.0, 0.02)
        actuator.close()


def test_the_other_side_is_pyserialtransfers_own_package(tmp_path):
    transfer = pytest.importorskip("pySerialTransfer.pySerialTransfer").SerialTransfer
    ours, theirs = Terminal(), Terminal()
    link = transfer(theirs.path, restrict_ports=False, debug=False)
    assert link.open()
    came, going = [], [True]

    def pump():
        while going:
            for one, other in ((ours, theirs), (theirs, ours)):
                if data := one.read(0.002):
                    other.write(data)

    def device():
        while going:
            if link.available():
                fields = [link.rx_obj("f", start_pos=4 * at) for at in range(7)]
                came.append(fields)
                link.tx_struct_obj(struct.pack("<ff", fields[0], 31.5))
                link.send(8, packet_id=9)

    threads = [threading.Thread(target=one, daemon=True) for one in (pump, device)]
    for thread in threads:
        thread.start()
    reply = {"struct": "<ff", "values": ["magnitude", "temperature"], "id": 9}
    off_reply = reply | {"values": [0, "temperature"]}
    actuator = coils(tmp_path, ours, ROLLER, device__reply=reply, device__off_reply=off_reply)
    assert actuator.temperature == 31.5
    actuator.push(30.0, 0.02)
    expected = [8.0, np.radians(120), pi / 2, 10.0, 0.0, 0.0, 0.02]
    assert came[1] == pytest.approx(expected)
    assert came[0] == came[2] == [0.0] * 7
    actuator.close()
    going.clear()
    for thread in threads:
        thread.join()
    link.close()


def test_struct_packets_over_tcp(tmp_path):
    line = Server()

    def take(controller, data):
        packets = [data[at : at + 6] for at in range(0, len(data), 6)]  # perhaps two at once
        controller.log += packets
        return b"".join(b"\xaa" + packet[2:4] for packet in packets)

    device = {
        "packets": "struct",
        "pulse": {"struct": "<HHh", "values": [0xBEEF, "number", "right"]},
        "off": {"struct": "<HHh", "values": [0xBEEF, "number", 0]},
        "reply": {"struct": "<BH", "values": [0xAA, "number"]},
        "connection": line.address,
    }
    with Controller(line, take) as controller:
        actuator = CoilActuator(written(tmp_path, PULLER, device=device))
        actuator.push(0.0, 0.02)
        actuator.push(180.0, 0.02)
        actuator.close()
        controller.wait(lambda log: len(log) >= 8)
        sent = [struct.unpack("<HHh", one) for one in controller.log]
    assert sent[:5] == [
        (0xBEEF, 0, 0), (0xBEEF, 1, 100), (0xBEEF, 1, 0), (0xBEEF, 2, 0), (0xBEEF, 2, 0),
    ]  # fmt: skip


# -------------------------------------------------------------------------------------------------
# the process that keeps the line


def test_coils_with_a_keep_alive_process_keep_the_rules(tmp_path):
    line = Server()
    with Controller(line, lines()) as device:
        reply = {"text": "OK"}
        actuator = coils(
            tmp_path, line, device__reply=reply, device__off_reply=reply, device__keep_alive=5.0
        )
        check_actuator(actuator)
        assert device.log[:2] == [OFF, "SET 100 0 0 0"]
        assert device.log[-1] == OFF
        assert actuator._line._child.returncode == 0


DRIVE = """
import sys, time
from shoal.rigs.calibration import Responses
from shoal.rigs.coils import CoilActuator
actuator = CoilActuator(sys.argv[1])
print("open", flush=True)
actuator.push(0.0, 50.0)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_field_is_off_soon_after_a_drive_has_died_or_stands_still(tmp_path, number):
    line = Terminal()
    with Controller(line, lines()) as device:
        path = written(tmp_path, PULLER, device__connection=line.address, device__keep_alive=0.3)
        drive = subprocess.Popen(
            [sys.executable, "-c", DRIVE, str(path)], stdout=subprocess.PIPE,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
        )  # fmt: skip
        device.wait(lambda log: "SET 100 0 0 0" in log, timeout=60)
        on = len(device.log)
        drive.send_signal(number)
        device.wait(lambda log: len(log) > on)
        assert set(device.log[on:]) == {OFF}
        drive.kill()
        drive.wait()
        drive.stdout.close()
        device.wait(lambda log: len(log) >= on + 3)


def test_a_keep_alive_process_that_is_killed_is_noticed_and_the_field_is_off(tmp_path):
    line = Terminal()
    with Controller(line, lines()) as device:
        actuator = coils(tmp_path, line, device__keep_alive=5.0)

        def kill():
            device.wait(lambda log: "SET 100 0 0 0" in log)
            os.kill(actuator._line.pid, signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        with pytest.raises(RigError, match="the keep-alive process has ended"):
            actuator.push(0.0, 20.0)
        killer.join()
        device.wait(lambda log: log[-1] == OFF)
        actuator.close()


def test_a_keep_alive_process_opens_a_lost_line_again(tmp_path):
    line = Server()

    def answer(text):
        if text != OFF and len(controller.log) < 4:
            line.cut()

    with Controller(line, lines(answer)) as controller:
        actuator = coils(tmp_path, line, device__keep_alive=2.0)
        with pytest.raises(RigError, match=r"the line tcp:.* is lost"):
            actuator.push(0.0, 20.0)
        controller.wait(lambda log: log[:3] == [OFF, "SET 100 0 0 0", OFF])
        assert actuator._line.alive
        actuator.push(90.0, 0.02)  # the line is there again
        controller.wait(lambda log: log[-2:] == ["SET 0 100 0 0", OFF])
        actuator.close()


# -------------------------------------------------------------------------------------------------
# the bench in one program


def test_the_bench_of_the_examples_moves_a_plant(tmp_path):
    pytest.importorskip("cv2")
    pytest.importorskip("pymunk")
    spec = importlib.util.spec_from_file_location("example_bench", ROOT / "examples" / "bench.py")
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    bench = example.Bench(GridWorkspace(np.ones((9, 9))), 1, 4, own_gain=0, coil_gain=0)
    before = bench.plant.points
    pulses, link = [], tmp_path / "coils"
    bench.count = pulses.append
    running = threading.Thread(target=bench.run, args=(str(link), 0.1))
    running.start()
    while not link.exists():
        time.sleep(0.01)
    data = tomllib.loads((ROOT / "examples/actuation/four_coil_puller.toml").read_text())
    data["device"] |= {"connection": f"serial:{link}", "ready": 0.0}
    for reply in ("reply", "off_reply"):
        data["device"][reply]["within"] = 20.0  # this computer may be busy
    del data["device"]["keep_alive"]
    path = tmp_path / "puller.json"
    path.write_text(json.dumps(data))
    actuator = CoilActuator(path)
    for angle, along in ((0.0, [1, 0]), (90.0, [0, 1])):
        actuator.push(angle, 0.083)
        moved = bench.plant.points - before
        ahead, aside = (moved @ along).item(), (moved @ along[::-1]).item()
        assert ahead > 0.3  # as strong as the field is there, in real time
        assert abs(aside) < 0.3 * ahead
        before = bench.plant.points
    bench.pulled = True  # the cable of the coils
    while bench.pulled or link.exists():
        time.sleep(0.01)
    while not link.exists():
        time.sleep(0.01)
    actuator.push(180.0, 0.083)  # over the new line
    actuator.close()
    bench.running = False
    running.join()
    assert [pulse.split(" ", 1)[1] for pulse in pulses] == ["180 0 0 0", "0 180 0 0", "0 0 180 0"]
    assert bench.duty == (0.0, 0.0, 0.0, 0.0)
    bench.draw()
    assert bench.picture.startswith(b"\xff\xd8")  # JPEG


# -------------------------------------------------------------------------------------------------
# on the command line


def test_coils_on_the_command_line(tmp_path, capsys):
    missing = tmp_path / "none.toml"
    for actuator, words in (
        ("coils:", "actuator: expected coils:FILE"),
        (f"coils:{missing}", f"{missing}: expected an actuation file, got no such file"),
        (f"coils:{written(tmp_path, PULLER, kind='x')}", "kind: expected 'pull'"),
    ):
        assert shoal(["drive", "maze:9x7", "--actuator", actuator, "--sensor", "a:b"]) == 2
        out, err = capsys.readouterr()
        assert words in err
        assert err.count("\n") == 1
        assert not out


def test_files_are_toml_or_json(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text('kind = "pull"\n[pulse]\nseconds = x\n')
    with pytest.raises(InvalidInputError, match=r"a.toml: expected TOML"):
        read_actuation(path)
    assert tomllib.loads((ROOT / "examples/actuation/four_coil_puller.toml").read_text())
