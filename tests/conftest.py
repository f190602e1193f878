"""Shared by all tests."""

from __future__ import annotations

import signal
from pathlib import Path

import shoal


def _drop_stale_kernels() -> None:
    """Remove what was compiled before any kernel was edited.

    Numba's cache looks at the file of a kernel, not at the files of the kernels that it calls: after one is edited, its callers
    in other files would go on with the old code. And an index of the cache that names a class which is gone cannot be read.
    """
    root = Path(shoal.__file__).parent
    newest = max(file.stat().st_mtime for file in root.glob("*/kernels/**/*.py"))
    for index in root.glob("*/kernels/**/*.nbi"):
        if index.stat().st_mtime < newest:
            index.unlink(missing_ok=True)


_drop_stale_kernels()

# A shell starts what runs in its background with Ctrl-C ignored, and the tests' programs would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
