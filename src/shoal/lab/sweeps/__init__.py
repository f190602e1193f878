"""Sweeps as declared: their axes, points, seeds, batches and progress."""
