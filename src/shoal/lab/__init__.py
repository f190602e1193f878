"""Many runs: trials of one problem, sweeps over many; the same result for any number of workers."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from shoal.lab.trials import run_trials

if TYPE_CHECKING:
    from shoal.lab.running import run_sweep
    from shoal.lab.status import Progress, Status
    from shoal.lab.store import Store
    from shoal.lab.sweep import Point, Sweep, sweep_of

# Loaded when first used: `shoal map` needs trials only, and its start is felt.
_HOMES = {"Point": "sweep", "Progress": "status", "Status": "status", "Store": "store", "Sweep": "sweep"}
_HOMES |= {"run_sweep": "running", "sweep_of": "sweep"}

__all__ = ["Point", "Progress", "Status", "Store", "Sweep", "run_sweep", "run_trials", "sweep_of"]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(f"shoal.lab.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'shoal.lab' has no attribute {name!r}")
