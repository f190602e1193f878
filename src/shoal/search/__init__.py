"""Exhaustive search of a region by robots without a coordinator, along one closed tour.

Python imports a name of this package only when a program first uses the name, because the import of
Numba takes long. The function `shoal.search.run.run` runs a `SearchProblem`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from shoal.core.registry import loaded_on_use

if TYPE_CHECKING:
    from shoal.search.allocation.allocate import Allocation, Arc, allocate
    from shoal.search.allocation.costs import TourCost
    from shoal.search.cells.grid import CellGrid, cells_of
    from shoal.search.cells.routing import RegionPaths, Route
    from shoal.search.cells.visibility_graph import merge_collinear
    from shoal.search.episode import SearchEpisode
    from shoal.search.planning.plan import SearchPlan, plan_search
    from shoal.search.problem import SearchProblem
    from shoal.search.regions.builder import open_region
    from shoal.search.regions.projection import LocalFrame
    from shoal.search.regions.region import AreaCoverage, SearchRegion, coverage_check, region_of
    from shoal.search.simulation.trace import RobotLog, SearchTrace
    from shoal.search.tours import Tour, TourMaker, TourMetrics, components, make_tour
    from shoal.search.tours.tour import hilbert_decode, hilbert_encode, moore_decode, moore_encode

_HOMES = {
    "allocation.allocate": (
        "Allocation",
        "Arc",
        "allocate",
    ),
    "allocation.costs": ("TourCost",),
    "cells.grid": (
        "CellGrid",
        "cells_of",
    ),
    "cells.routing": (
        "RegionPaths",
        "Route",
        "merge_collinear",
    ),
    "episode": ("SearchEpisode",),
    "planning.plan": (
        "SearchPlan",
        "plan_search",
    ),
    "problem": ("SearchProblem",),
    "regions.builder": ("open_region",),
    "regions.projection": ("LocalFrame",),
    "regions.region": (
        "AreaCoverage",
        "SearchRegion",
        "coverage_check",
        "region_of",
    ),
    "simulation.trace": (
        "RobotLog",
        "SearchTrace",
    ),
    "tours": (
        "Tour",
        "TourMaker",
        "TourMetrics",
        "components",
        "make_tour",
    ),
    "tours.tour": (
        "hilbert_decode",
        "hilbert_encode",
        "moore_decode",
        "moore_encode",
    ),
}

__all__ = [
    "Allocation",
    "Arc",
    "AreaCoverage",
    "CellGrid",
    "LocalFrame",
    "RegionPaths",
    "RobotLog",
    "Route",
    "SearchEpisode",
    "SearchPlan",
    "SearchProblem",
    "SearchRegion",
    "SearchTrace",
    "Tour",
    "TourCost",
    "TourMaker",
    "TourMetrics",
    "allocate",
    "cells_of",
    "components",
    "coverage_check",
    "hilbert_decode",
    "hilbert_encode",
    "make_tour",
    "merge_collinear",
    "moore_decode",
    "moore_encode",
    "open_region",
    "plan_search",
    "region_of",
]


__getattr__ = loaded_on_use(__name__, _HOMES)


def __dir__() -> list[str]:
    return __all__
