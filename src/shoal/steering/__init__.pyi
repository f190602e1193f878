"""Public names, which `lazy_loader` imports when they are first used."""

from .contact.world import ContactWorld as ContactWorld, RegionWorld as RegionWorld
from .delta_space import (
    Crossing as Crossing,
    DiskReach as DiskReach,
    PolygonReach as PolygonReach,
    disk_reach as disk_reach,
    polygon_reach as polygon_reach,
    reached_in_two_moves as reached_in_two_moves,
)
from .episode import SteeringEpisode as SteeringEpisode
from .planners import PLANNERS as PLANNERS, Planner as Planner, make_planner as make_planner
from .planners.task import SteeringTask as SteeringTask
from .problem import SteeringProblem as SteeringProblem
from .workspaces.convex import (
    ConvexWorkspace as ConvexWorkspace,
    cylinder as cylinder,
    disk as disk,
    polygon as polygon,
    prism as prism,
    regular_polygon as regular_polygon,
)
from .workspaces.formats import open_workspace as open_workspace
from .workspaces.region import Region as Region, region as region
