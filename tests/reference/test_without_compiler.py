"""The kernels give the same episodes with the compiler off, where a shift or an overflow might behave otherwise."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
SCRIPT = """
import numpy as np
from shoal.swarm import GridWorkspace, run
np.seterr(over="ignore")  # words wrap around on purpose
rng = np.random.default_rng(21)
for width in (1, 5, 62, 63, 64, 65, 126, 128):
    for shape in ((3, width), (2, 2, min(width, 65))):
        free = rng.random(shape) < 0.75
        free.flat[0] = True
        cells = np.argwhere(free)
        start = cells[rng.choice(len(cells), size=max(1, len(cells) // 4), replace=False)]
        for rule in ("block", "merge", "tilt"):
            for policy in ("closest-frontier", "elect-particle", "depth-first", "random-moves"):
                if rule == "tilt" and policy in ("elect-particle", "depth-first"):
                    continue
                for task in ("mapping", "subset-coverage:fraction=1"):
                    if task != "mapping" and len(start) < len(cells) and GridWorkspace(free).components.max() > 1:
                        continue
                    e = run(GridWorkspace(free), task=task, policy=policy, start=start, rule=rule, max_moves=25)
                    if policy == "closest-frontier" and rule != "tilt":
                        for every in ("3", "doubling", "hyper", "adaptive"):
                            scans = run(GridWorkspace(free), task=task, start=start, rule=rule, max_moves=20, scan_every=every)
                            print(every, scans.commands, scans.status, scans.scanned.tolist())
                    print(width, rule, policy, task, e.commands, e.status, e.done.tolist(), e.travelled.tolist())
"""


def episodes(*, compiled: bool) -> str:
    environment = dict(os.environ, NUMBA_DISABLE_JIT="0" if compiled else "1")
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=ROOT, env=environment, check=True, capture_output=True, text=True, timeout=300
    )
    return done.stdout


def test_same_episodes_with_the_compiler_off():
    compiled = episodes(compiled=True)
    assert len(compiled.splitlines()) > 60
    assert episodes(compiled=False) == compiled
