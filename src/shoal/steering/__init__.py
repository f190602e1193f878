"""Two particles, one shared input, and walls that hold what is pushed into them."""

from __future__ import annotations

from shoal.steering.delta import Crossing, delta_space, reached_in_two_moves
from shoal.steering.disturbance import Disturbance
from shoal.steering.episode import SteeringEpisode
from shoal.steering.formats import open_workspace
from shoal.steering.planners import Planner, make_planner
from shoal.steering.polygon_reach import PolygonReach, polygon_reach
from shoal.steering.problem import SteeringProblem
from shoal.steering.reachability import DiskReach, disk_reach
from shoal.steering.region import Region, region
from shoal.steering.running import steer
from shoal.steering.task import Task
from shoal.steering.workspace import ConvexWorkspace, cylinder, disk, polygon, prism, regular_polygon
from shoal.steering.world import ContactWorld

__all__ = [
    "ContactWorld",
    "ConvexWorkspace",
    "Crossing",
    "DiskReach",
    "Disturbance",
    "Planner",
    "PolygonReach",
    "Region",
    "SteeringEpisode",
    "SteeringProblem",
    "Task",
    "cylinder",
    "delta_space",
    "disk",
    "disk_reach",
    "make_planner",
    "open_workspace",
    "polygon",
    "polygon_reach",
    "prism",
    "reached_in_two_moves",
    "region",
    "regular_polygon",
    "steer",
]
