"""Public names, which `lazy_loader` imports when they are first used."""

from .allocation.allocate import Allocation as Allocation
from .allocation.allocate import Arc as Arc
from .allocation.allocate import allocate as allocate
from .allocation.costs import TourCost as TourCost
from .cells.grid import CellGrid as CellGrid
from .cells.grid import cells_of as cells_of
from .cells.routing import RegionPaths as RegionPaths
from .cells.routing import Route as Route
from .cells.visibility_graph import merge_collinear as merge_collinear
from .episode import SearchEpisode as SearchEpisode
from .planning.comparison import PlanFigures as PlanFigures
from .planning.comparison import compare_plans as compare_plans
from .planning.plan import SearchPlan as SearchPlan
from .planning.plan import plan_search as plan_search
from .problem import SearchProblem as SearchProblem
from .protocol.markers import marker_rule as marker_rule
from .regions.builder import open_region as open_region
from .regions.choice import affordable_rectangle as affordable_rectangle
from .regions.coverage import AreaCoverage as AreaCoverage
from .regions.coverage import coverage_check as coverage_check
from .regions.formats.flight_logs import Track as Track
from .regions.formats.flight_logs import read_tracks as read_tracks
from .regions.projection import LocalFrame as LocalFrame
from .regions.region import (
    SearchRegion as SearchRegion,
)
from .regions.region import (
    region_of as region_of,
)
from .simulation.trace import RobotLog as RobotLog
from .simulation.trace import SearchTrace as SearchTrace
from .tours import (
    Tour as Tour,
)
from .tours import (
    TourMaker as TourMaker,
)
from .tours import (
    TourMetrics as TourMetrics,
)
from .tours import (
    components as components,
)
from .tours import (
    make_tour as make_tour,
)
from .tours.tour import (
    hilbert_decode as hilbert_decode,
)
from .tours.tour import (
    hilbert_encode as hilbert_encode,
)
from .tours.tour import (
    moore_decode as moore_decode,
)
from .tours.tour import (
    moore_encode as moore_encode,
)
