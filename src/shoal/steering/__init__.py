"""Steering of particles by one shared input, between walls that hold particles.

The package imports the module of a public name when a program first uses the name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from shoal.core.registry import loaded_on_use

if TYPE_CHECKING:
    from shoal.steering.contact.world import ContactWorld, RegionWorld
    from shoal.steering.delta_space import (
        Crossing,
        DiskReach,
        PolygonReach,
        disk_reach,
        polygon_reach,
        reached_in_two_moves,
    )
    from shoal.steering.episode import SteeringEpisode
    from shoal.steering.planners import PLANNERS, Planner, make_planner
    from shoal.steering.planners.task import SteeringTask
    from shoal.steering.problem import SteeringProblem
    from shoal.steering.workspaces.convex import (
        ConvexWorkspace,
        cylinder,
        disk,
        polygon,
        prism,
        regular_polygon,
    )
    from shoal.steering.workspaces.formats import open_workspace
    from shoal.steering.workspaces.region import Region, region

_HOMES = {
    "contact.world": (
        "ContactWorld",
        "RegionWorld",
    ),
    "delta_space": (
        "Crossing",
        "DiskReach",
        "PolygonReach",
        "disk_reach",
        "polygon_reach",
        "reached_in_two_moves",
    ),
    "episode": ("SteeringEpisode",),
    "planners": (
        "PLANNERS",
        "Planner",
        "make_planner",
    ),
    "planners.task": ("SteeringTask",),
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
