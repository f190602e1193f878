"""Two particles, one shared input, and walls that hold what is pushed into them. Names are loaded when they are first used."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from shoal.steering.contact.region_world import RegionWorld
    from shoal.steering.contact.world import ContactWorld
    from shoal.steering.delta_space.disk_reach import DiskReach, disk_reach
    from shoal.steering.delta_space.polygon_reach import PolygonReach, polygon_reach
    from shoal.steering.delta_space.two_moves import Crossing, reached_in_two_moves
    from shoal.steering.episode import SteeringEpisode
    from shoal.steering.planners import PLANNERS, Planner, make_planner
    from shoal.steering.planners.task import Task
    from shoal.steering.problem import SteeringProblem
    from shoal.steering.workspaces.convex import ConvexWorkspace, cylinder, disk, polygon, prism, regular_polygon
    from shoal.steering.workspaces.formats import open_workspace
    from shoal.steering.workspaces.region import Region, region

_HOMES = {
    "contact.world": ("ContactWorld",),
    "contact.region_world": ("RegionWorld",),
    "delta_space.disk_reach": (
        "DiskReach",
        "disk_reach",
    ),
    "delta_space.polygon_reach": (
        "PolygonReach",
        "polygon_reach",
    ),
    "delta_space.two_moves": (
        "Crossing",
        "reached_in_two_moves",
    ),
    "episode": ("SteeringEpisode",),
    "planners": (
        "PLANNERS",
        "Planner",
        "make_planner",
    ),
    "planners.task": ("Task",),
    "problem": ("SteeringProblem",),
    "workspaces.convex": (
        "ConvexWorkspace",
        "cylinder",
        "disk",
        "polygon",
        "prism",
        "regular_polygon",
    ),
    "workspaces.formats": ("open_workspace",),
    "workspaces.region": (
        "Region",
        "region",
    ),
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
]


def __getattr__(name: str) -> Any:
    for module, names in _HOMES.items():
        if name in names:
            return getattr(importlib.import_module(f"shoal.steering.{module}"), name)
    raise AttributeError(f"module 'shoal.steering' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
