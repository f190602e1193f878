"""Thousands of worlds at once, one command each a step, in compiled code on all processors: for those who learn policies."""

from shoal.swarm.batch.inspection import PLANES, Boards
from shoal.swarm.batch.worlds import WorldBatch

__all__ = ["PLANES", "Boards", "WorldBatch"]
