"""Public names, which `lazy_loader` imports when they are first used."""

from .allocation.allocate import Allocation as Allocation, Arc as Arc, allocate as allocate
from .allocation.costs import TourCost as TourCost
from .cells.grid import CellGrid as CellGrid, cells_of as cells_of
from .cells.routing import RegionPaths as RegionPaths, Route as Route
from .cells.visibility_graph import merge_collinear as merge_collinear
from .episode import SearchEpisode as SearchEpisode
from .planning.plan import SearchPlan as SearchPlan, plan_search as plan_search
from .problem import SearchProblem as SearchProblem
from .regions.builder import open_region as open_region
from .regions.projection import LocalFrame as LocalFrame
from .regions.region import (
    AreaCoverage as AreaCoverage,
    SearchRegion as SearchRegion,
    coverage_check as coverage_check,
    region_of as region_of,
)
from .simulation.trace import RobotLog as RobotLog, SearchTrace as SearchTrace
from .tours import (
    Tour as Tour,
    TourMaker as TourMaker,
    TourMetrics as TourMetrics,
    components as components,
    make_tour as make_tour,
)
from .tours.tour import (
    hilbert_decode as hilbert_decode,
    hilbert_encode as hilbert_encode,
    moore_decode as moore_decode,
    moore_encode as moore_encode,
)
