"""Kernels for theory: random samples of particles on a line, and minimum numbers of commands for lower bounds."""
