"""The commands for sweeps: shoal sweep run, status, summary, plot, export, merge and check."""
