"""Noisy particles, the belief from noisy scans, and whole episodes with noise."""
