"""Commands for sweeps: run, status, summary, plot, export, merge, check."""
