"""Compiled functions of sweeps."""
