"""The clock of a rehearsal, which other processes read."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

from shoal.core.errors import InvalidInputError
from shoal.robots import mavlink
from shoal.robots.clock import SharedClock

READER = """
import sys
import time
from pathlib import Path
from shoal.robots import mavlink
from shoal.robots.clock import SharedClock
clock, last = SharedClock(Path(sys.argv[1])), 0.0
print("ready", flush=True)
while last < 1.0:
    now = clock.now()
    assert last <= now <= last + 0.5 or last == 0.0, (last, now)
    last = now
"""


def test_another_process_never_reads_half_a_time(tmp_path):
    clock = SharedClock.create(tmp_path / "clock")
    reading = subprocess.Popen(
        [sys.executable, "-c", READER, str(tmp_path / "clock")], stdout=subprocess.PIPE
    )
    assert reading.stdout.readline() == b"ready\n"
    for number in range(1, 200_001):
        clock.set(number / 200_000)
    assert reading.wait(20) == 0
    reading.stdout.close()
    assert clock.now() == 1.0
    clock.close()


def test_a_link_whose_clock_stands_still_is_lost(monkeypatch):
    monkeypatch.setattr(mavlink, "_STANDS", 0.05)
    now = [0.0]
    link = mavlink.FastLink(mavlink.open_link("udpout:127.0.0.1:9"), 2.0, lambda: now[0])
    assert link.receive(0.01) == []
    time.sleep(0.1)
    now[0] = 1.0
    assert link.receive(0.01) == []  # it goes on
    time.sleep(0.1)
    with pytest.raises(mavlink.LinkError, match="the clock of the rehearsal stands still"):
        link.receive(0.01)
    link.close()


def test_what_is_no_clock_is_refused(tmp_path):
    with pytest.raises(InvalidInputError, match="expected the clock of a rehearsal"):
        SharedClock(tmp_path / "none")
    (tmp_path / "empty").write_bytes(b"")
    with pytest.raises(InvalidInputError, match="expected the clock of a rehearsal"):
        SharedClock(tmp_path / "empty")
