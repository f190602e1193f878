"""Simulation of steering: the apparatus for closed-loop planners, and replay of inputs."""
