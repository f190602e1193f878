"""Start positions of the robots: launch points, given points, or a layout of start cells such as ``random``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import shapely
from numpy.random import Generator

from shoal.search.cells.grid import CellGrid
from shoal.search.problem import SearchProblem
from shoal.search.regions.outline_checks import Points
from shoal.search.regions.places import places_of, read_points

LAYOUTS = ("random", "clustered", "line")
_CLUSTER = 0.05  # relative to the larger side: standard deviation of clustered starts


def start_points(problem: SearchProblem, grid: CellGrid, rng: Generator) -> Points:
    """Return the robots' start positions in metres; float64, shape (robots, 2).

    Parameters
    ----------
    problem : SearchProblem
        The problem, whose fields ``launch`` and ``starts`` define the start positions.
    grid : CellGrid
        The cells of the lowest layer.
    rng : Generator
        Generator of random numbers for the layouts ``random`` and ``clustered``.

    Raises
    ------
    InvalidInputError
        If a start position lies outside the region. Launch points may lie outside the region.
    """
    region, robots, starts = grid.region, problem.robots, problem.starts
    if problem.launch is not None:
        return places_of(problem.launch, region, robots, what="launch")
    if not isinstance(starts, str):
        return region.check_inside(starts, what="starts")
    if starts not in LAYOUTS:
        return region.check_inside(read_points(Path(starts), region, what="starts", count=robots), what=starts)
    middles = grid.waypoints()
    if starts == "random":
        return np.asarray(middles[rng.integers(0, len(middles), size=robots)])
    if starts == "clustered":
        middle = middles[rng.integers(len(middles))]
        spread = max(_CLUSTER * max(np.ptp(middles, axis=0)), grid.size)
        wanted = middle + rng.normal(0, spread, size=(robots, 2))
    else:
        low, high = middles.min(axis=0), middles.max(axis=0)
        wanted = np.column_stack([np.full(robots, low[0]), np.linspace(low[1], high[1], robots)])
    return np.asarray(middles[shapely.STRtree(shapely.points(middles)).nearest(shapely.points(wanted))])
