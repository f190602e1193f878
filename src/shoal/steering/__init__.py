"""Steering of particles by one shared input, with walls that hold particles. Names are imported when they are first used."""

from __future__ import annotations

from typing import TYPE_CHECKING

from shoal.core.registry import loaded_on_use

if TYPE_CHECKING:
    from shoal.steering.contact.region_world import RegionWorld
    from shoal.steering.contact.world import ContactWorld
    from shoal.steering.delta_space.disk_reach import DiskReach, disk_reach
    from shoal.steering.delta_space.polygon_reach import PolygonReach, polygon_reach
    from shoal.steering.delta_space.two_moves import Crossing, reached_in_two_moves
    from shoal.steering.episode import SteeringEpisode
    from shoal.steering.planners import PLANNERS, Planner, make_planner
    from shoal.steering.planners.task import SteeringTask
    from shoal.steering.problem import SteeringProblem
    from shoal.steering.workspaces.convex import ConvexWorkspace, cylinder, disk, polygon, prism, regular_polygon
    from shoal.steering.workspaces.formats import open_workspace
    from shoal.steering.workspaces.region import Region, region

_HOMES = {
    "PLANNERS": "planners",
    "ContactWorld": "contact.world",
    "ConvexWorkspace": "workspaces.convex",
    "Crossing": "delta_space.two_moves",
    "DiskReach": "delta_space.disk_reach",
    "Planner": "planners",
    "PolygonReach": "delta_space.polygon_reach",
    "Region": "workspaces.region",
    "RegionWorld": "contact.region_world",
    "SteeringEpisode": "episode",
    "SteeringProblem": "problem",
    "SteeringTask": "planners.task",
    "cylinder": "workspaces.convex",
    "disk": "workspaces.convex",
    "disk_reach": "delta_space.disk_reach",
    "make_planner": "planners",
    "open_workspace": "workspaces.formats",
    "polygon": "workspaces.convex",
    "polygon_reach": "delta_space.polygon_reach",
    "prism": "workspaces.convex",
    "reached_in_two_moves": "delta_space.two_moves",
    "region": "workspaces.region",
    "regular_polygon": "workspaces.convex",
}

__all__ = [
    "PLANNERS",
    "ContactWorld",
    "ConvexWorkspace",
    "Crossing",
    "DiskReach",
    "Planner",
    "PolygonReach",
    "Region",
    "RegionWorld",
    "SteeringEpisode",
    "SteeringProblem",
    "SteeringTask",
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
]


__getattr__ = loaded_on_use(__name__, _HOMES)


def __dir__() -> list[str]:
    return __all__
