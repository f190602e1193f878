"""Shortest paths of particles: to frontier cells, by tilts to frontier cells, and to all cells in the order of path length."""
