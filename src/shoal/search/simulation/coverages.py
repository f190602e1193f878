"""Coverage of each layer, computed from the paths of the robots and not from cells."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from shoal.search.allocation.layers import layers_of
from shoal.search.allocation.plan import SearchPlan
from shoal.search.cells.grid import CellGrid
from shoal.search.cells.routing import Route
from shoal.search.regions.coverage import AreaCoverage, coverage_check
from shoal.search.simulation.trace import RobotLog, SearchTrace


def coverages(plan: SearchPlan, trace: SearchTrace, routes: Sequence[Route], robots: Sequence[int]) -> tuple[AreaCoverage, ...]:
    """Return, for each layer from the lowest to the highest, the coverage by the robots with the numbers ``robots`` (from 0)."""
    layers, found = layers_of(plan.grid), []
    sides = plan.footprints / layers[0].footprint
    for number, layer in enumerate(layers):
        ways = [(way, sides[robot] * layer.footprint) for robot in robots for way in _ways(plan, trace, routes, robot, number)]
        footprints = [side for _, side in ways] or layer.footprint
        found.append(coverage_check(layer.region, [way for way, _ in ways], footprints, angle=layer.angle, image=plan.image))
    return tuple(found)


def _ways(plan: SearchPlan, trace: SearchTrace, routes: Sequence[Route], robot: int, layer: int) -> list[NDArray[np.float64]]:
    """Return a robot's paths inside a layer, without its path from a launch point outside the region and without climbs."""
    route, log = routes[robot], trace.robots[robot]
    if isinstance(plan.grid, CellGrid):
        inside = len(route.stops) < 2 or plan.grid.region.contains(route.points[:1])[0]
        return [route.points if inside else route.points[route.stops[1] :]]
    spans, there = cell_spans(plan, route, log), plan.tour.cells[log.cells, 0]
    borders = [0, *(np.flatnonzero(np.diff(there)) + 1).tolist(), len(there)]
    return [route.points[spans[begin, 0] : spans[end - 1, 1] + 1, :2] for begin, end in pairwise(borders) if there[begin] == layer]


def cell_spans(plan: SearchPlan, route: Route, log: RobotLog) -> NDArray[np.int64]:
    """Return, for each cell of a robot's log, the indices of the cell's first and last point on the route; int64, shape (k, 2).

    If a robot passes other cells on its way to a cell, the first point of the cell lies in the first of the passed cells.
    """
    index = plan.grid.ordinals(plan.tour.cells[log.cells])
    counts = plan.grid.viewpoint_starts[index + 1] - plan.grid.viewpoint_starts[index]
    if any(log.detours):
        counts = counts + np.array([len(passed) for passed in log.detours], dtype=np.int64)
    last = np.cumsum(counts)
    return np.asarray(route.stops[np.stack([last - counts + 1, last], axis=1)])
