"""Robots without a coordinator that search a region along one closed tour."""

from __future__ import annotations

from shoal.search.cells import CellGrid, cells_of
from shoal.search.coverage import Coverage, coverage_check
from shoal.search.ground import GroundPaths, Route, merge_collinear
from shoal.search.projection import LocalFrame
from shoal.search.region import SearchRegion, open_region, region_of

__all__ = [
    "CellGrid",
    "Coverage",
    "GroundPaths",
    "LocalFrame",
    "Route",
    "SearchRegion",
    "cells_of",
    "coverage_check",
    "merge_collinear",
    "open_region",
    "region_of",
]
