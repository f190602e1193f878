"""Commands for sweeps: run, status, summary, export, check."""
