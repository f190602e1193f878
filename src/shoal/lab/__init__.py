"""Many runs: the same result for any number of workers."""

from __future__ import annotations

from shoal.lab.trials import run_trials

__all__ = ["run_trials"]
