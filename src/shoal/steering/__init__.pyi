"""Public names, which `lazy_loader` imports when they are first used."""

from .certificates import Certificate as Certificate
from .certificates import certify as certify
from .certificates.verdict import check_certificate as check_certificate
from .contact.world import ContactWorld as ContactWorld
from .contact.world import RegionWorld as RegionWorld
from .delta_space import (
    Crossing as Crossing,
)
from .delta_space import (
    DiskReach as DiskReach,
)
from .delta_space import (
    PolygonReach as PolygonReach,
)
from .delta_space import (
    disk_reach as disk_reach,
)
from .delta_space import (
    polygon_reach as polygon_reach,
)
from .delta_space import (
    reached_in_two_moves as reached_in_two_moves,
)
from .episode import SteeringEpisode as SteeringEpisode
from .planners import PLANNERS as PLANNERS
from .planners import make_planner as make_planner
from .planners.chains import ReflectedPath as ReflectedPath
from .planners.chains import reflection_quartic as reflection_quartic
from .planners.chains import shortest_reflected_path as shortest_reflected_path
from .planners.task import Planner as Planner
from .planners.task import SteeringTask as SteeringTask
from .problem import SteeringProblem as SteeringProblem
from .workspaces.convex import (
    ConvexWorkspace as ConvexWorkspace,
)
from .workspaces.convex import (
    cylinder as cylinder,
)
from .workspaces.convex import (
    disk as disk,
)
from .workspaces.convex import (
    polygon as polygon,
)
from .workspaces.convex import (
    prism as prism,
)
from .workspaces.convex import (
    regular_polygon as regular_polygon,
)
from .workspaces.formats import open_workspace as open_workspace
from .workspaces.region import Region as Region
from .workspaces.region import region as region
