"""Whole episodes without noise: a policy decides, the world moves, the trace is written."""
