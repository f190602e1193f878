"""Declarations of sweeps: axes, points, seeds, batches and progress."""
