"""Many runs: trials of one problem, sweeps over many; the same result for any number of workers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from shoal.core.registry import loaded_on_use
from shoal.lab.trials import run_trials

if TYPE_CHECKING:
    from shoal.lab.coordinator import run_sweep
    from shoal.lab.storage.merging import merge_stores
    from shoal.lab.storage.store import Store
    from shoal.lab.sweeps.progress import SweepProgress, SweepStatus
    from shoal.lab.sweeps.sweep import Point, Sweep, sweep_of

# Loaded when first used: `shoal map` needs trials only, and its start is felt.
_HOMES = {
    "Point": "sweeps.sweep",
    "Store": "storage.store",
    "Sweep": "sweeps.sweep",
    "SweepProgress": "sweeps.progress",
    "SweepStatus": "sweeps.progress",
    "merge_stores": "storage.merging",
    "run_sweep": "coordinator",
    "sweep_of": "sweeps.sweep",
}

__all__ = ["Point", "Store", "Sweep", "SweepProgress", "SweepStatus", "merge_stores", "run_sweep", "run_trials", "sweep_of"]


__getattr__ = loaded_on_use(__name__, _HOMES)
