"""Public names, which `lazy_loader` imports when they are first used."""

from .batches import SweepProgress as SweepProgress, SweepStatus as SweepStatus
from .coordinator import run_sweep as run_sweep
from .exchange import merge_stores as merge_stores
from .store import Store as Store
from .sweep import Point as Point, Sweep as Sweep, sweep_of as sweep_of
from .trials import run_trials as run_trials
