"""Experiments with many runs: trials of one problem, and sweeps over many problems.

The results of trials do not depend on the number of workers.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from shoal.core.registry import loaded_on_use

if TYPE_CHECKING:
    from shoal.lab.batches import SweepProgress, SweepStatus
    from shoal.lab.coordinator import run_sweep
    from shoal.lab.exchange import merge_stores
    from shoal.lab.store import Store
    from shoal.lab.sweep import Point, Sweep, sweep_of
    from shoal.lab.trials import run_trials

# Names are imported on first use, because `shoal map` needs only trials and the studio's server
# only a lock.
_HOMES = {
    "batches": (
        "SweepProgress",
        "SweepStatus",
    ),
    "coordinator": ("run_sweep",),
    "exchange": ("merge_stores",),
    "store": ("Store",),
    "sweep": (
        "Point",
        "Sweep",
        "sweep_of",
    ),
    "trials": ("run_trials",),
}

__all__ = [
    "Point",
    "Store",
    "Sweep",
    "SweepProgress",
    "SweepStatus",
    "merge_stores",
    "run_sweep",
    "run_trials",
    "sweep_of",
]


__getattr__ = loaded_on_use(__name__, _HOMES)
