"""When a wheel is built, the archives of lowered kernels get what they miss (``make kernels``)."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class Kernels(BuildHookInterface):
    """Bring the archives up to date where the dependencies of Shoal are installed.

    An isolated build has none of them. It packs the archives as they are: for each kernel that they
    miss, the first call takes some seconds longer.
    """

    def initialize(self, version, build_data):
        installed = all(importlib.util.find_spec(name) for name in ("numba", "scipy", "typer"))
        if version == "editable" or not installed:
            return
        source = str(Path(self.root, "src"))
        environment = {**os.environ, "PYTHONPATH": source}
        command = [sys.executable, "-m", "benchmarks.first_calls", "--archives"]
        subprocess.run(command, cwd=self.root, env=environment, stdout=sys.stderr, check=True)
