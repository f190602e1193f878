"""Kernels that the swarm, steering and search parts all use."""
