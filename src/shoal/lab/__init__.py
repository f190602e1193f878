"""Many runs: trials of one problem, sweeps over many; the same result for any number of workers."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from shoal.lab.trials import run_trials

if TYPE_CHECKING:
    from shoal.lab.coordinator import run_sweep
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
    "run_sweep": "coordinator",
    "sweep_of": "sweeps.sweep",
}

__all__ = ["Point", "Store", "Sweep", "SweepProgress", "SweepStatus", "run_sweep", "run_trials", "sweep_of"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f"shoal.lab.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'shoal.lab' has no attribute {name!r}")
