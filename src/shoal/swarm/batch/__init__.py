"""Simulation of thousands of worlds at once in compiled code, so that programs can learn policies."""

from shoal.swarm.batch.inspection import PLANES, Boards
from shoal.swarm.batch.worlds import WorldBatch

__all__ = ["PLANES", "Boards", "WorldBatch"]
