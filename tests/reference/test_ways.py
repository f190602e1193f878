"""Shortest paths around corners, against Dijkstra's algorithm on all lines of sight."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra
from tests.without_compiler import printed

from shoal.core.geometry import cross
from shoal.search import region_of
from shoal.search.cells.bends import with_fewer_bends
from shoal.search.cells.visibility_graph import (
    VisibilityGraph,
    inside,
    leg_lengths,
    length_of,
    pull_string,
)


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
    region = blocks()
    graph = VisibilityGraph(region)
    ends = np.array([[1.0, 4.0], [63.0, 60.0]])
    way = graph.shortest(*ends, np.arange(len(graph.corners)))
    assert length_of(way) == pytest.approx(plain_length(region, *ends), abs=1e-6)


def plain_pulled(region, way):
    """From each point, straight to the last visible one of the next 64."""
    kept = [0]
    while kept[-1] < len(way) - 1:
        here = kept[-1]
        ahead = np.arange(here + 1, min(here + 65, len(way)))
        seen = inside(region, np.broadcast_to(way[here], (len(ahead), 2)), way[ahead])
        seen[0] = True
        kept.append(int(ahead[np.flatnonzero(seen)[-1]]))
    return way[kept]


def plain_with_fewer_bends(region, way, price):
    """All pairs of legs at once, and dynamic programming over those that can be joined."""
    count, lengths = len(way) - 1, leg_lengths(way)
    starts, ends = way[:-1], way[1:]
    units = (ends - starts) / lengths[:, None]
    one, other = np.triu_indices(count, 2)
    gap, sine = starts[other] - ends[one], cross(units[one], units[other])
    ahead = np.abs(sine) > 1e-9
    one, other, gap, sine = one[ahead], other[ahead], gap[ahead], sine[ahead]
    a, b = cross(gap, units[other]) / sine, cross(units[one], gap) / sine
    past = np.append(0.0, np.cumsum(lengths))
    longer = a + b - (past[other] - past[one + 1])
    good = (a >= 0) & (b >= 0) & (longer < price * (other - one - 1))
    one, other, a, b = one[good], other[good], a[good], b[good]
    crossings = ends[one] + a[:, None] * units[one]
    free = inside(region, ends[one], crossings)
    free[free] = inside(region, crossings[free], starts[other[free]])
    costs, before, at = np.full(count, np.inf), np.full(count, -1), way[:-1].copy()
    costs[0] = lengths[0]
    for leg in range(1, count):
        costs[leg], before[leg] = costs[leg - 1] + price, leg - 1
        for k in np.flatnonzero(free & (other == leg)):
            cost = costs[one[k]] + price + a[k] + b[k]
            if cost < costs[leg]:
                costs[leg], before[leg], at[leg] = cost, one[k], crossings[k]
        costs[leg] += lengths[leg]
    bends, leg = [], count - 1
    while leg > 0:
        bends.append(at[leg])
        leg = before[leg]
    return np.vstack([way[:1], *bends[::-1], way[-1:]])


def blocks():
    """Return a square with square zones in rows, beside which lines of sight are doubtful."""
    zones = [shapely.box(x, y, x + 4, y + 4) for x in range(2, 60, 8) for y in range(2, 60, 8)]
    return region_of(shapely.box(0, 0, 64, 64), no_go=shapely.union_all(zones))


def lakes():
    zones = [shapely.Point(x, y).buffer(9) for x in (12, 34, 56) for y in (11, 32, 53)]
    return region_of(shapely.box(0, 0, 64, 64), no_go=shapely.union_all(zones))


@pytest.mark.parametrize("region", [yard(1), yard(2), blocks(), lakes()], ids=str)
def test_straightened_paths(region):
    graph, rng = VisibilityGraph(region), np.random.default_rng(5)
    corners, fewer, shorter = np.arange(len(graph.corners)), 0, 0
    for ends in rng.uniform(0, 64, (60, 2, 2)):
        way = graph.shortest(*ends, corners) if region.contains(ends).all() else None
        if way is None:
            continue
        # on the way, on and beside straight lines
        dense = np.vstack([np.linspace(*leg, 7) for leg in np.stack([way[:-1], way[1:]], axis=1)])
        for path in (way, dense, dense[::-1]):
            found = pull_string(region, path)
            shorter += len(found) < len(path)
            assert found.tolist() == plain_pulled(region, path).tolist()
        if len(way) > 4:
            for price in (0.0, 3.0, 30.0):
                found = with_fewer_bends(region, way, price)
                fewer += len(found) < len(way)
                assert found.tolist() == plain_with_fewer_bends(region, way, price).tolist()
    assert shorter
    assert fewer


def test_without_the_compiler():
    script = """
import numpy as np
from tests.reference.test_ways import (
    VisibilityGraph, length_of, pull_string, with_fewer_bends, yard
)
region = yard(3)
graph = VisibilityGraph(region)
for end in ((95.0, 90.0), (3.0, 97.0), (97.0, 4.0)):
    ends = np.array([(2.0, 2.0), end])
    way = graph.shortest(*ends, np.arange(len(graph.corners)))
    print(way if way is None else way.tolist())
    if way is not None:
        print(pull_string(region, way), with_fewer_bends(region, way, 30.0), len(graph.around(way, 5.0)))
"""
    told = printed(script)
    assert told == printed(script, compiled=True)
    assert told.count("[[") == 9


@pytest.mark.parametrize("count", [1, 2, 3, 60])
@pytest.mark.parametrize("flat", [False, True])
def test_corners_within_a_box_and_around_points(count, flat):
    rng = np.random.default_rng(count)
    region = region_of(
        shapely.box(0, 0, 200, 200),
        no_go=shapely.union_all(
            [
                shapely.Polygon([(x, y), (x + 0.1, y + 0.4), (x - 0.1, y + 0.4)])
                for x, y in np.column_stack(
                    [rng.uniform(5, 150, count), np.full(count, 80.0)]
                    if flat
                    else rng.uniform(5, 150, (2, count))
                )
            ]
        ),
    )
    graph = VisibilityGraph(region)
    corners = graph.corners
    # boxes inside, around and far beside the corners, also without an end
    lows = np.concatenate([rng.uniform(-50, 200, (40, 2)), rng.uniform(-1e9, 1e9, (20, 2))])
    for low in lows:
        high = low + rng.choice([0.0, 0.5, 30.0, 400.0, 1e9, np.inf], 2)
        inside_box = ((corners >= low) & (corners <= high)).all(axis=1)
        assert np.array_equal(graph.within(low, high), np.flatnonzero(inside_box))
        assert len(graph.within(low, high, 1)) == min(1, inside_box.sum())
        distance = float(rng.choice([0.5, 20.0, 300.0]))
        near = np.hypot(*(corners - low).T) <= distance
        assert np.array_equal(graph.around(low[None], distance), np.flatnonzero(near))
    for corner in corners:
        assert len(graph.within(corner, corner)) >= 1
