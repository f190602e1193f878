"""Simulation of steering: the simulated apparatus for closed-loop planners, and replays of stored inputs."""
