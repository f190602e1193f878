"""Shortest paths of particles: to the frontier, by tilts, and in the order of distance."""
