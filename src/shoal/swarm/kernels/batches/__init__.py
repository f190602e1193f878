"""Kernels for many worlds at once: starts, steps with one command for each world, and observations as bytes."""
