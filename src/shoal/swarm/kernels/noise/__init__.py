"""Kernels for particles that slip, for the belief from noisy scans, and for whole episodes with noise."""
