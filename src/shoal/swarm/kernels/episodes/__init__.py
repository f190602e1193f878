"""Whole episodes without noise: decisions of a policy, moves of the world, and the trace."""
