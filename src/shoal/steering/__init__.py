"""Two particles, one shared input, and walls that hold what is pushed into them."""

from __future__ import annotations

from shoal.steering.delta import Crossing, delta_space, reached_in_two_moves
from shoal.steering.reachability import DiskReach, disk_reach
from shoal.steering.workspace import ConvexWorkspace, cylinder, disk, polygon, prism, regular_polygon
from shoal.steering.world import ContactWorld

__all__ = [
    "ContactWorld",
    "ConvexWorkspace",
    "Crossing",
    "DiskReach",
    "cylinder",
    "delta_space",
    "disk",
    "disk_reach",
    "polygon",
    "prism",
    "reached_in_two_moves",
    "regular_polygon",
]
