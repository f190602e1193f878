"""Shared by all tests."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import shoal


def _touch_stale_kernels() -> None:
    """Give all kernel files the time of the newest.

    Numba's cache looks at the file of a kernel, not at the files of the kernels that it calls: after one is edited, its callers
    in other files would go on with the old code.
    """
    files = sorted(Path(shoal.__file__).parent.glob("*/kernels/**/*.py"))
    times = [file.stat().st_mtime for file in files]
    if max(times) - min(times) > 60:
        for file in files:
            os.utime(file)


_touch_stale_kernels()

# A shell starts what runs in its background with Ctrl-C ignored, and the tests' programs would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
