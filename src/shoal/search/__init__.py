"""Exhaustive search by robots without a coordinator, along one closed tour."""

from __future__ import annotations

from shoal.search.allocation.allocate import Allocation, Sweep, allocate
from shoal.search.allocation.plan import SearchPlan, plan_search
from shoal.search.allocation.tour_cost import Course
from shoal.search.cells.grid import CellGrid, cells_of
from shoal.search.cells.routing import GroundPaths, Route, merge_collinear
from shoal.search.episode import SearchEpisode
from shoal.search.regions.builder import open_region
from shoal.search.regions.coverage import Coverage, coverage_check
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import SearchRegion, region_of
from shoal.search.run import search
from shoal.search.simulation.trace import RobotLog
from shoal.search.tours import (
    Tour,
    TourMaker,
    TourMetrics,
    components,
    hilbert_decode,
    hilbert_encode,
    make_tour,
    moore_decode,
    moore_encode,
)

__all__ = [
    "Allocation",
    "CellGrid",
    "Course",
    "Coverage",
    "GroundPaths",
    "LocalFrame",
    "RobotLog",
    "Route",
    "SearchEpisode",
    "SearchPlan",
    "SearchRegion",
    "Sweep",
    "Tour",
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
    "search",
]
