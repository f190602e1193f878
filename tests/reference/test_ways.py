"""Shortest paths around corners, against Dijkstra's algorithm on all lines of sight."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from tests.without_compiler import printed

from shoal.search import region_of
from shoal.search.cells.visibility_graph import VisibilityGraph, length_of


def yard(seed):
    """Return a square with random triangles as no-go zones, some of which overlap."""
    rng = np.random.default_rng(seed)
    zones = shapely.polygons(rng.uniform(5, 95, (12, 1, 2)) + rng.uniform(-14, 14, (12, 3, 2)))
    return region_of(shapely.box(0, 0, 100, 100), no_go=shapely.union_all(zones.tolist()))


def plain_length(region, start, end):
    """Return the length of the shortest path, or infinity if there is none."""
    free = region.free.buffer(1e-7)
    points = np.vstack([start, end, shapely.get_coordinates(region.free)])
    one, other = np.triu_indices(len(points), 1)
    lines = shapely.linestrings(np.stack([points[one], points[other]], axis=1))
    seen = shapely.covers(free, lines)
    ways = shapely.length(lines[seen]), (one[seen], other[seen])
    graph = coo_array(ways, shape=(len(points), len(points))).tocsr()
    return float(dijkstra(graph, directed=False, indices=0)[1])


@pytest.mark.parametrize("seed", range(12))
def test_shortest_paths(seed):
    region, rng = yard(seed), np.random.default_rng(seed)
    graph = VisibilityGraph(region)
    corners = np.arange(len(graph.corners))
    places = rng.uniform(0, 100, (200, 2))
    places = places[region.contains(places)]
    for start, end in places[:16].reshape(-1, 2, 2):
        least = plain_length(region, start, end)
        straight = float(np.hypot(*(end - start)))
        if least <= straight + 1e-6:
            continue  # no corner is passed
        way = graph.shortest(start, end, corners)
        if least == np.inf:
            assert way is None
            continue
        assert length_of(way) == pytest.approx(least, abs=1e-6)
        assert region.free.buffer(1e-6).covers(shapely.linestrings(way))
        assert graph.shortest(start, end, corners, most=least + 1e-6).tolist() == way.tolist()
        assert graph.shortest(start, end, corners, most=0.999 * least) is None


def test_along_collinear_corners():
    # lines of sight that pass corners are doubtful to the compiled test
    zones = [shapely.box(x, y, x + 4, y + 4) for x in range(2, 60, 8) for y in range(2, 60, 8)]
    region = region_of(shapely.box(0, 0, 64, 64), no_go=shapely.union_all(zones))
    graph = VisibilityGraph(region)
    ends = np.array([[1.0, 4.0], [63.0, 60.0]])
    way = graph.shortest(*ends, np.arange(len(graph.corners)))
    assert length_of(way) == pytest.approx(plain_length(region, *ends), abs=1e-6)


def test_without_the_compiler():
    script = """
import numpy as np
from tests.reference.test_ways import VisibilityGraph, length_of, yard
region = yard(3)
graph = VisibilityGraph(region)
for end in ((95.0, 90.0), (3.0, 97.0), (97.0, 4.0)):
    ends = np.array([(2.0, 2.0), end])
    way = graph.shortest(*ends, np.arange(len(graph.corners)))
    print(way if way is None else way.tolist())
"""
    told = printed(script)
    assert told == printed(script, compiled=True)
    assert told.count("[[") == 3
