"""Deterministic simulation of a search: the world, the network, robot faults, and the trace of each
robot.
"""
