"""The firmware of the examples, compiled for an atmega2560 and run on libsimavr. Times are cycles of
the chip.
"""

from __future__ import annotations

import copy
import json
import os
import queue
import select
import shutil
import signal
import subprocess
import sys
import threading
import tomllib
from pathlib import Path

import pytest

from shoal.core.errors import InvalidInputError, RigError
from shoal.rigs.actuation import read_actuation
from shoal.rigs.coils import CoilActuator
from shoal.rigs.packets import Splitter, cobs_packet

pytest.importorskip("serial")
ROOT = Path(__file__).parents[3]
FIRMWARE = ROOT / "examples" / "coils_firmware"
MILLISECOND = 16_000  # cycles
SILENCE = 100 * MILLISECOND  # SILENCE_MS of the firmware
TICK = 2 * MILLISECOND  # it looks at its clock once a millisecond


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    if not (shutil.which("avr-gcc") and shutil.which("gcc")):
        pytest.skip("needs gcc and gcc-avr")
    if not Path("/usr/include/simavr/sim_avr.h").exists():
        pytest.skip("needs libsimavr-dev")
    folder = tmp_path_factory.mktemp("avr")
    compile_avr = ["-mmcu=atmega2560", "-DF_CPU=16000000UL", "-Os", "-Wall", "-Wextra", "-Werror"]
    source = str(FIRMWARE / "coils.c")
    for compiler in (["avr-gcc", "-std=gnu99"], ["avr-g++", "-x", "c++"]):  # and the Arduino IDE
        subprocess.run([*compiler, *compile_avr, "-o", folder / "coils.elf", source], check=True)
    runner = ["gcc", "-O2", "-o", folder / "runner", ROOT / "tests" / "avr_runner.c"]
    if subprocess.run([*runner, "-lsimavr", "-lutil"], check=False).returncode:
        pytest.skip("libsimavr cannot be linked")
    return folder


class Chip:
    """The firmware, running; ``events`` are the changes of the field."""

    def __init__(self, folder, millivolts=250):
        self._process = subprocess.Popen(
            [folder / "runner", folder / "coils.elf", str(millivolts)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
        )  # fmt: skip
        self.address = f"serial:{self._process.stdout.readline().strip()}"
        self.events = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self._process.stdout:
            kind, cycle, heard, *duty = line.split()
            self.events.put((kind, int(cycle), int(heard), tuple(map(int, duty))))

    def pulse(self):
        """Return the next pulse: cycles that the field was on, cycles from the last byte to its end,
        duty.
        """
        kind, began, _, duty = self.events.get(timeout=60)
        assert kind == "on"
        kind, ended, heard, _ = self.events.get(timeout=60)
        assert kind == "off"
        return ended - began, ended - heard, duty

    def close(self):
        self._process.stdin.close()
        self._process.wait(10)
        self._process.stdout.close()


@pytest.fixture
def chip(built):
    running = Chip(built)
    yield running
    running.close()


def actuation_file(folder, chip, **limits):
    data = copy.deepcopy(tomllib.loads((FIRMWARE / "coils.toml").read_text()))
    data["device"] |= {"connection": chip.address, "ready": 0.0}
    for reply in ("reply", "off_reply"):
        data["device"][reply]["within"] = 20.0  # this computer may be busy
    data["limits"] |= {"duty_cycle": 1.0, **limits}
    path = folder / "coils.json"
    path.write_text(json.dumps(data))
    return path


def test_the_firmware_ends_pulses_itself_after_their_time(tmp_path, chip):
    actuator = CoilActuator(actuation_file(tmp_path, chip))
    assert actuator.temperature == 24  # 250 mV are 25 degrees, in steps of 5 V / 1024
    for angle, seconds, duty in (
        (0.0, 0.083, (180, 0, 0, 0)),
        (90.0, 0.02, (0, 180, 0, 0)),
        (225.0, 0.05, (0, 0, 131, 131)),
    ):
        actuator.push(angle, seconds)
        lasted, _, seen = chip.pulse()
        assert seen == duty
        assert abs(lasted - 1e3 * seconds * MILLISECOND) <= TICK
    with pytest.raises(InvalidInputError, match=r"limits.pulse"):
        actuator.push(0.0, 1.1)
    actuator.close()
    assert chip.events.empty()


DRIVE = """
import sys
from shoal.rigs.coils import CoilActuator
actuator = CoilActuator(sys.argv[1])
actuator.push(0.0, 0.95)
"""


def test_the_field_is_off_within_the_stated_time_after_the_drive_was_killed(tmp_path, chip):
    path = actuation_file(tmp_path, chip)
    drive = subprocess.Popen(
        [sys.executable, "-c", DRIVE, str(path)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    kind, began, _, _ = chip.events.get(timeout=60)
    drive.send_signal(signal.SIGKILL)
    drive.wait()
    ended_as, ended, heard, _ = chip.events.get(timeout=60)
    assert (kind, ended_as) == ("on", "off")
    assert ended - heard <= SILENCE + TICK
    assert ended - began < 900 * MILLISECOND
    # a new drive begins where the old one was cut off
    actuator = CoilActuator(path)
    actuator.push(180.0, 0.02)
    assert chip.pulse()[2] == (0, 0, 180, 0)
    actuator.close()


class Raw:
    """A line on which packets are written byte by byte."""

    def __init__(self, address):
        self._fd = os.open(address.partition(":")[2], os.O_RDWR | os.O_NOCTTY)
        self._splitter = Splitter("cobs", [])

    def ask(self, packet, expected=1):
        os.write(self._fd, packet)
        found = []
        while len(found) < expected:
            assert select.select([self._fd], [], [], 60)[0]
            found += self._splitter.messages(os.read(self._fd, 100))
        return [(one[0], one[1] + 256 * one[2], one[3] + 256 * one[4]) for one in found]

    def close(self):
        os.close(self._fd)


def pulse(number, milliseconds, *duty):
    words = number.to_bytes(2, "little") + milliseconds.to_bytes(2, "little")
    return cobs_packet(words + bytes(duty), 0)


OFF, DONE, IS_OFF, REFUSED = cobs_packet(b"\0\0", 1), 8, 9, 10


def test_what_the_firmware_refuses(chip):
    line = Raw(chip.address)
    assert line.ask(pulse(1, 1001, 100, 0, 0, 0)) == [(REFUSED, 1, 1)]
    assert line.ask(pulse(2, 20, 0, 231, 0, 0)) == [(REFUSED, 2, 1)]
    assert line.ask(pulse(3, 0, 100, 0, 0, 0)) == [(REFUSED, 3, 1)]
    damaged = bytearray(pulse(4, 20, 100, 0, 0, 0))
    damaged[6] ^= 1
    assert line.ask(bytes(damaged) + OFF) == [(IS_OFF, 0, 24)]
    assert chip.events.empty()
    # in silence the field goes off, and stays off until the computer says "off"
    assert line.ask(pulse(5, 900, 100, 0, 0, 0)) == [(REFUSED, 5, 4)]
    lasted, silent, _ = chip.pulse()
    assert SILENCE - TICK <= silent <= SILENCE + TICK
    assert lasted <= silent + TICK
    assert line.ask(pulse(6, 20, 100, 0, 0, 0)) == [(REFUSED, 6, 3)]
    assert line.ask(OFF) == [(IS_OFF, 0, 24)]
    # a pulse that is sent again is answered again, and carried out once
    packet = pulse(0x7E7E, 20, 0x7E, 0, 0x7E, 0)
    assert line.ask(packet) == line.ask(packet) == [(DONE, 0x7E7E, 24)]
    assert chip.pulse()[2] == (0x7E, 0, 0x7E, 0)
    assert chip.events.empty()
    line.close()


def test_hot_coils_stay_off(tmp_path, built):
    chip = Chip(built, millivolts=800)
    actuator = CoilActuator(actuation_file(tmp_path, chip))
    with pytest.raises(RigError, match=r"at most 70 °C \(limits.temperature\), got 79"):
        actuator.push(0.0, 0.02)
    actuator.close()
    line = Raw(chip.address)
    assert line.ask(pulse(1, 20, 100, 0, 0, 0)) == [(REFUSED, 1, 2)]
    line.close()
    assert chip.events.empty()
    chip.close()


def test_the_actuation_file_of_the_firmware_has_its_limits():
    form = read_actuation(FIRMWARE / "coils.toml").form
    source = (FIRMWARE / "coils.c").read_text()
    for name, value in (
        ("LARGEST_DUTY", form.limits.duty),
        ("LONGEST_MS", 1e3 * form.limits.pulse),
        ("HOTTEST", form.limits.temperature),
    ):
        assert f"#define {name} {value:g}" in source
    assert form.device.alive.every * 3 <= 0.1
