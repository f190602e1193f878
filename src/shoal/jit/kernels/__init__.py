"""Kernels that all parts use."""
