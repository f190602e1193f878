"""Kernels for one command: operations on words of cells, moves, and classified cells."""
