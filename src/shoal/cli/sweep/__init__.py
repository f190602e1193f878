"""Commands of sweeps: run, status, summary, export, check."""
