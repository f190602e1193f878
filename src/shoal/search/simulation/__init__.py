"""Deterministic simulation of a search: world, network, robot faults, and the trace of the robots."""
