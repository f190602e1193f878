"""Kernels that all parts need."""
