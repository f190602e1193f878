"""Shared by all tests."""

from __future__ import annotations

import gc
import os
import signal

# A shell starts what runs in its background with Ctrl-C ignored, and the tests' programs would
# inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Fences and rally points need MAVLink 2, and pymavlink knows one version in a process.
os.environ["MAVLINK20"] = "1"


# What is imported and collected stays to the end, so the garbage collector need not search it again
# and again.
gc.disable()


def pytest_collection_finish() -> None:
    gc.freeze()
    # The usual thresholds suit a small program: here each collection searches what many modules hold.
    gc.set_threshold(20_000, 20, 20)
    gc.enable()
