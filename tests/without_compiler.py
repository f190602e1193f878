"""Scripts for tests, in a process of their own, with the compiler of kernels or without it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def printed(script: str, *, compiled: bool = False, given: str = "") -> str:
    """Return what a script prints. The script reads the text ``given`` from its standard input.

    A script compares a kernel with its plain counterpart, or prints results that a test compares
    with those of the compiler. Without the compiler, NumPy warns of words that wrap around unless
    the script begins with ``np.seterr(over="ignore")``.
    """
    # what is not set is not in the environment: the cache of kernels knows each setting of Numba
    # apart
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_DISABLE_JIT"}
    done = subprocess.run(
        [sys.executable, "-c", script],
        input=given,
        cwd=ROOT,
        env=environment if compiled else environment | {"NUMBA_DISABLE_JIT": "1"},
        check=True,
        stdout=subprocess.PIPE,  # pytest shows the errors of a script that fails
        text=True,
        timeout=300,
    )
    return done.stdout
