"""Samples of particles on a line, and the fewest commands of each direction."""
