"""Simulation of thousands of worlds at once in compiled code, for learning policies. Each step sends one command to each world."""

from shoal.swarm.batch.inspection import PLANES, Boards
from shoal.swarm.batch.worlds import WorldBatch

__all__ = ["PLANES", "Boards", "WorldBatch"]
