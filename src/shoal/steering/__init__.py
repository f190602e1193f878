"""Two particles, one shared input, and walls that hold what is pushed into them."""

from __future__ import annotations

from shoal.steering.contact.disturbances import Disturbance
from shoal.steering.contact.world import ContactWorld
from shoal.steering.delta_space.disk_reach import DiskReach, disk_reach
from shoal.steering.delta_space.polygon_reach import PolygonReach, polygon_reach
from shoal.steering.delta_space.two_moves import Crossing, reached_in_two_moves
from shoal.steering.episode import SteeringEpisode
from shoal.steering.planners import Planner, make_planner
from shoal.steering.planners.task import Task
from shoal.steering.problem import SteeringProblem
from shoal.steering.run import steer
from shoal.steering.workspaces.convex import ConvexWorkspace, cylinder, disk, polygon, prism, regular_polygon
from shoal.steering.workspaces.formats import open_workspace
from shoal.steering.workspaces.region import Region, region

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
