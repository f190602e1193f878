"""Shortest paths of particles: to the frontier, by tilts, and in order of distance."""
