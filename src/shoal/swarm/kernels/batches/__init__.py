"""Kernels for many worlds at once: starts, steps with one command per world, and observations as bytes."""
