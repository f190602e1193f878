"""Kernels for whole episodes without noise: decisions of a policy, moves of the particles, and the trace."""
