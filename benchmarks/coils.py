"""How long pulses of coils last, and how soon the field is off after the drive has died. The coils are
lines of text on a pseudo-terminal, and hold their last level.

    python -m benchmarks.coils
"""

from __future__ import annotations

import argparse
import json
import os
import select
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import tty
from pathlib import Path

from shoal.rigs.coils import CoilActuator

PULSES, SECONDS = 60, 0.083
DIE = "import sys; from shoal.rigs.coils import CoilActuator as A; A(sys.argv[1]).push(0.0, 50.0)"


class Coils:
    """The other side of the line: it notes when the field goes on and off."""

    def __init__(self) -> None:
        self._terminal, other = os.openpty()
        tty.setraw(self._terminal)
        tty.setraw(other)
        self.path, self.changes = os.ttyname(other), list[tuple[bool, float]]()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        came, on = b"", False
        while True:
            select.select([self._terminal], [], [])
            came += os.read(self._terminal, 4096)
            now = time.monotonic()
            *lines, came = came.split(b"\n")
            for line in lines:
                if (line != b"0") != on:
                    on = not on
                    self.changes.append((on, now))

    def wait(self, count: int) -> float:
        """Wait for a change of the field, and return when it was."""
        while len(self.changes) < count:
            time.sleep(0.001)
        return self.changes[count - 1][1]


def actuation(folder: Path, coils: Coils, keep_alive: float | None) -> Path:
    """Write an actuation file."""
    device = {"connection": f"serial:{coils.path}", "packets": "text"}
    device |= {"pulse": {"text": "{angle:.0f}9"}, "off": {"text": "0"}}
    device |= {} if keep_alive is None else {"keep_alive": keep_alive}
    form = {"kind": "pull", "field": {"magnitude": 1.0}, "pulse": {"seconds": SECONDS}}
    path = folder / "coils.json"
    path.write_text(json.dumps(form | {"device": device}))
    return path


def main() -> None:
    """Print both tables."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for keep_alive in (None, 0.2):
            coils = Coils()
            actuator = CoilActuator(actuation(folder, coils, keep_alive))
            for _ in range(PULSES):
                actuator.push(0.0, SECONDS)
            actuator.close()
            times = [at for _, at in coils.changes]
            lasted = [1e3 * (b - a) for a, b in zip(times[::2], times[1::2], strict=True)]
            print(
                f"keep_alive {keep_alive}: {PULSES} pulses of {1e3 * SECONDS:g} ms lasted"
                f" {statistics.mean(lasted):.2f} ms, standard deviation"
                f" {statistics.stdev(lasted):.2f}, largest {max(lasted):.2f}"
            )
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL, signal.SIGSTOP):
            delays = []
            for _ in range(5):
                coils = Coils()
                path = actuation(folder, coils, 0.2)
                drive = subprocess.Popen(
                    [sys.executable, "-c", DIE, str(path)], stderr=subprocess.DEVNULL
                )
                coils.wait(1)
                time.sleep(0.1)
                sent = time.monotonic()
                drive.send_signal(number)
                delays.append(1e3 * (coils.wait(2) - sent))
                drive.kill()
                drive.wait()
            print(f"{number.name}: the field was off after {max(delays):.1f} ms at most, of 5")


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
