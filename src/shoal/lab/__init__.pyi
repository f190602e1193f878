"""Public names, which `lazy_loader` imports when they are first used."""

from .batches import SweepProgress as SweepProgress
from .batches import SweepStatus as SweepStatus
from .bench import Score as Score
from .bench import Suite as Suite
from .bench import find_suite as find_suite
from .bench import run_suite as run_suite
from .bench import scores as scores
from .bench import suites as suites
from .coordinator import run_sweep as run_sweep
from .exchange import merge_stores as merge_stores
from .store import Store as Store
from .sweep import Point as Point
from .sweep import Sweep as Sweep
from .sweep import sweep_of as sweep_of
from .trials import run_trials as run_trials
