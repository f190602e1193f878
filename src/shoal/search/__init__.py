"""Exhaustive search by robots without a coordinator, along one closed tour."""

from __future__ import annotations

from shoal.search.allocation import Allocation, Sweep, allocate
from shoal.search.cells import CellGrid, cells_of
from shoal.search.course import Course
from shoal.search.coverage import Coverage, coverage_check
from shoal.search.episode import RobotLog, SearchEpisode
from shoal.search.ground import GroundPaths, Route, merge_collinear
from shoal.search.planning import SearchPlan, plan_search
from shoal.search.projection import LocalFrame
from shoal.search.region import SearchRegion, open_region, region_of
from shoal.search.running import search
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
