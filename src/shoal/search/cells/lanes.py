"""Lanes: the cells of a long region along a line, such as a road, a river or a power line."""

from __future__ import annotations

from dataclasses import field
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import cross, left_of, partial_sums
from shoal.search.cells.clipping import (
    MAX_CELLS,
    SPECK,
    Clipped,
    Lattice,
    Portals,
    rotate,
    rotate_shape,
)
from shoal.search.cells.grid import CellGrid, grid_of_pieces
from shoal.search.cells.viewpoints import difference, viewpoints_of
from shoal.search.regions.coverage import Image
from shoal.search.regions.margin import visible_region
from shoal.search.regions.outline import Points
from shoal.search.regions.region import SearchRegion

Numbers = NDArray[np.int64]

_SAMPLES = 8  # points of the line per footprint, which divide the region among the stations
_BENT = 0.02  # footprints: bends of a given line that are smaller are not flown
_FLICKER = 4  # stations: for a narrower stretch that is shorter, no lane ends
_HAIR = 1e-6  # relative to a footprint: pieces that are closer touch each other
_BEYOND = 4  # diagonals of a region: to points outside that close a Voronoi diagram
_BORDER_POINTS = 4_000  # most points of a border from which a centre line is derived


@dataclass(frozen=True, eq=False)
class LineLattice(Lattice):
    """Cells along a line. Its rows are lanes beside the line and its columns are stations along the
    line.

    Parameters
    ----------
    middles : ndarray of float64, shape (lanes, stations, 2)
        Middle of each cell in the frame of the lattice, in metres.
    stations : ndarray of Shapely geometries, shape (stations,)
        The part of the region that belongs to each station.
    """

    middles: Points = field(default_factory=lambda: np.zeros((0, 0, 2)))
    stations: Any = field(default_factory=lambda: np.array([], dtype=object))

    def centers(self, rows: Numbers, cols: Numbers) -> NDArray[np.float64]:
        """Return the middles of cells in the lattice's frame, in metres; float64, shape (n, 2)."""
        return np.asarray(self.middles[rows, cols])

    def cells_at(self, points: Points) -> tuple[Numbers, Numbers]:
        """Return the row and the column of the cell with the nearest middle in the station that
        contains each point of the lattice's frame, or that is nearest to it.
        """
        import shapely

        cols = np.asarray(shapely.STRtree(self.stations).nearest(shapely.points(points)))
        away = np.linalg.norm(self.middles[:, cols] - points, axis=-1)
        return np.asarray(np.nan_to_num(away, nan=np.inf).argmin(axis=0)), cols


def cells_along(region: SearchRegion, footprint: float, line: Points) -> CellGrid:
    """Divide a region into cells along a line, for robots whose footprint turns with their path.

    Stations follow each other along the line, at most one footprint apart, with one at each bend.
    A station whose part of the region is at most as wide as the footprint has one cell, and a wider
    one has cells side by side, which form lanes. A line that ends before the region continues
    straight on.

    Parameters
    ----------
    region : SearchRegion
    footprint : float
        Side in metres of the square that a robot sees. Two sides of the square are parallel to the
        path of the robot.
    line : ndarray of float64, shape (k, 2)
        The line in metres, inside or beside the region.

    Raises
    ------
    InvalidInputError
        If the line is shorter than a footprint, or with more than a million cells.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> cells_along(open_region("rectangle:100x18"), 20, np.array([(0.0, 9.0), (100.0, 9.0)]))
    <CellGrid 1x5, 5 cells of 20 m, 5 viewpoints>
    """
    import shapely

    side = check_number(footprint, what="footprint", above=0)
    path = _simplify_line(line, side)
    turn = float(np.degrees(np.arctan2(*(path[-1] - path[0])[::-1]))) % 180.0
    region = visible_region(region, side, turn)
    area, path = rotate_shape(region.area, -turn), rotate(path, -turn)
    free = rotate_shape(region.free, -turn) if region.restricted else area
    shapely.prepare(free)
    stops, ahead = _stations(path, area, side)
    parts = _nearest_parts(area, stops, side)
    spans = [
        _span(part, stop, before) for part, stop, before in zip(parts, stops, ahead, strict=True)
    ]
    counts = _lane_counts(np.array([high - low for low, high in spans]), side)
    lanes = int(counts.max())
    middles = np.full((lanes, len(stops), 2), np.nan)
    placed_pieces: list[tuple[int, int, Any]] = []
    beside: dict[int, float] = {}
    for col, (part, stop, before, (low, high), count) in enumerate(
        zip(parts, stops, ahead, spans, counts.tolist(), strict=True)
    ):
        remainder = part
        edges = np.linspace(low, high, count + 1)
        lowest = (lanes - count) // 2
        miter = _miter(before)
        for k in range(count):
            # the lane goes straight on where its footprint still sees the whole lane
            least, most = sorted((edges[k + 1] - side / 2, edges[k] + side / 2))
            offset = float(
                np.clip(beside.get(lowest + k, _first_offset(k, count, side)), least, most)
            )
            beside[lowest + k] = offset
            middles[lowest + k, col] = stop + offset * miter
            if k == count - 1:
                piece = remainder
            else:
                piece = shapely.intersection(
                    remainder, _half_plane(stop, before, edges[k + 1], side + high - low)
                )
                remainder = shapely.difference(remainder, piece)
            placed_pieces += [
                (lowest + k, col, polygon)
                for polygon in shapely.get_parts(piece)
                if polygon.geom_type == "Polygon" and polygon.area > SPECK * side**2
            ]
    placed_pieces.sort(key=lambda placed: placed[:2])
    rows, cols = (
        np.array([placed[axis] for placed in placed_pieces], dtype=np.int64) for axis in (0, 1)
    )
    pieces = np.array([placed[2] for placed in placed_pieces], dtype=object)
    lattice = LineLattice(
        float(stops[:, 0].min()),
        float(stops[:, 1].max()),
        side,
        (lanes, len(stops)),
        turn,
        middles,
        parts,
    )
    clipped = Clipped(np.zeros(lattice.shape, dtype=np.bool_), rows, cols, pieces)
    points, index = _viewpoints(clipped, lattice, ahead, free, side)
    return grid_of_pieces(region, side, lattice, clipped, _portals(clipped, lattice), points, index)


def _simplify_line(line: Points, side: float) -> Points:
    """Return a line without bends that are smaller than the robots' footprints matter."""
    import shapely

    path = shapely.get_coordinates(shapely.simplify(shapely.linestrings(line), _BENT * side))
    length = float(np.hypot(*np.diff(path, axis=0).T).sum())
    if length < side:
        raise InvalidInputError(
            f"along: expected a line of at least one footprint, {side:g} m, got {length:.3g} m"
        )
    if np.allclose(path[0], path[-1]):
        raise InvalidInputError("along: expected a line with two ends, got a closed one")
    return np.asarray(path)


def _stations(path: Points, area: Any, side: float) -> tuple[Points, NDArray[np.float64]]:
    """Return the stations along a line, and the directions in which the path reaches and leaves
    each; float64, shapes (n, 2) and (n, 2, 2).
    """
    import shapely

    low, high = np.array(area.bounds).reshape(2, 2)
    beyond = float(np.hypot(*(high - low))) + float(
        shapely.distance(area, shapely.linestrings(path))
    )
    steps = np.diff(path, axis=0)
    steps /= np.hypot(*steps.T)[:, None]
    path = np.vstack([path[0] - beyond * steps[0], path[1:-1], path[-1] + beyond * steps[-1]])
    line = shapely.linestrings(path)
    border = shapely.points(shapely.get_coordinates(shapely.segmentize(area, side)))
    far = shapely.line_locate_point(line, border)
    begin, end = float(far.min()), float(far.max())
    corners = partial_sums(np.hypot(*np.diff(path, axis=0).T))
    # from its first and its last station, a robot sees the ends of the region
    first, last = (
        (begin + side / 2, end - side / 2) if end - begin > side else ((begin + end) / 2,) * 2
    )
    knots = np.concatenate([[first], corners[(corners > first) & (corners < last)], [last]])
    if len(knots) + (end - begin) / side > MAX_CELLS:
        raise InvalidInputError(
            f"footprint: expected at most {MAX_CELLS} cells, got {(end - begin) / side:.0f} stations"
            f" along the line"
        )
    between = [
        np.linspace(a, b, max(1, int(np.ceil((b - a) / side - _HAIR))) + 1)[:-1]
        for a, b in pairwise(knots.tolist())
        if b - a > _HAIR * side
    ]
    places = np.concatenate([*between, knots[-1:]])
    stops = shapely.get_coordinates(shapely.line_interpolate_point(line, places))
    hair = _HAIR * side
    leg = np.clip(
        np.stack(
            [np.searchsorted(corners, places - hair), np.searchsorted(corners, places + hair)], 1
        )
        - 1,
        0,
        len(steps) - 1,
    )
    return stops, steps[leg]


def _nearest_parts(area: Any, stops: Points, side: float) -> Any:
    """Return the part of an area that is nearest to each station, along the line through all of
    them; Shapely geometries, shape (n,).
    """
    import shapely

    if len(stops) == 1:
        return np.array([area], dtype=object)
    points, owner = [], []
    legs = np.diff(stops, axis=0)
    for k, (stop, leg) in enumerate(zip(stops[:-1], legs, strict=True)):
        half = max(1, int(np.ceil(np.hypot(*leg) / side * _SAMPLES / 2)))
        shares = (np.arange(2 * half) + 0.5) / (2 * half)  # none on the border between two stations
        points.append(stop + shares[:, None] * leg)
        owner.append(k + (shares > 0.5))
    nearest, of = np.concatenate(points), np.concatenate(owner)
    nearest, first = np.unique(nearest, axis=0, return_index=True)
    of = of[first]
    cells = _voronoi_cells(nearest, area)
    order = np.argsort(of, kind="stable")
    begins = np.searchsorted(of[order], np.arange(len(stops) + 1))
    groups = [
        shapely.union_all(cells[order[begin:end]]) for begin, end in pairwise(begins.tolist())
    ]
    return shapely.intersection(area, np.array(groups, dtype=object))


def _voronoi_cells(points: Points, area: Any) -> Any:
    """Return the Voronoi cells of points near an area; Shapely polygons, shape (n,).

    Points are often on one line, where the cells of GEOS 3.13 may overlap.
    """
    import shapely
    from scipy.spatial import Voronoi

    low, high = points.min(axis=0), points.max(axis=0)
    bounds = np.array(area.bounds)
    low, high = np.minimum(low, bounds[:2]), np.maximum(high, bounds[2:])
    middle, beyond = (low + high) / 2, _BEYOND * float(np.hypot(*(high - low)))
    # cells of four further points, none of which reaches the area, enclose the others
    around = middle + beyond * np.array([(1, 0), (0, 1), (-1, 0), (0, -1)])
    diagram = Voronoi(np.concatenate([points - middle, around - middle]))
    regions = [diagram.regions[k] for k in diagram.point_region[: len(points)]]
    owner = np.repeat(np.arange(len(points)), [len(region) for region in regions])
    corners = diagram.vertices[np.concatenate(regions)] + middle
    return shapely.convex_hull(shapely.multipoints(shapely.points(corners), indices=owner))


def _offsets(points: Points, stop: Points, before: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how far to the left of the line points near a station are, in metres."""
    away = points - stop
    entering, leaving = (cross(step, away) for step in before)
    return np.where(away @ before.sum(axis=0) < 0, entering, leaving)


def _span(part: Any, stop: Points, before: NDArray[np.float64]) -> tuple[float, float]:
    """Return how far the part of a station reaches to the right of the line and to its left."""
    import shapely

    points = shapely.get_coordinates(part)
    if not len(points):
        return 0.0, 0.0
    offsets = _offsets(points, stop, before)
    return float(offsets.min()), float(offsets.max())


def _lane_counts(widths: NDArray[np.float64], side: float) -> Numbers:
    """Return the number of lanes at each station. Lanes do not end for a few stations."""
    from scipy.ndimage import grey_closing

    counts = np.maximum(1, np.ceil(widths / side - _HAIR)).astype(np.int64)
    if counts.max() == 1 or len(counts) <= _FLICKER:
        return counts
    return np.asarray(grey_closing(counts, size=_FLICKER + 1, mode="nearest"))


def _first_offset(lane: int, count: int, side: float) -> float:
    return (lane - (count - 1) / 2) * side


def _miter(before: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the vector to the place at a bend where a path one metre to the left bends; float64,
    shape (2,).
    """
    left = left_of(before)
    middle = left.sum(axis=0)
    size = float(middle @ left[0])
    return np.asarray(middle / size if size > 0.2 else left[0])  # not far out of a hairpin bend


def _half_plane(stop: Points, before: NDArray[np.float64], offset: float, reach: float) -> Any:
    """Return the area up to ``reach`` metres around a station that is less than ``offset`` to the
    left of the line.
    """
    import shapely

    bend = stop + offset * _miter(before)
    begin, end = bend - 4 * reach * before[0], bend + 4 * reach * before[1]
    down = 4 * reach * left_of(before)
    return shapely.make_valid(
        shapely.polygons(
            [begin, bend, end, end - down[1], bend - down.mean(axis=0), begin - down[0]]
        )
    )


def _viewpoints(
    clipped: Clipped, lattice: LineLattice, ahead: NDArray[np.float64], free: Any, side: float
) -> tuple[Points, Numbers]:
    """Return the viewpoints of all pieces, as `viewpoints_of` does: the middle of the cell if a
    robot may be there, and otherwise places with the footprint along the line.

    What a robot does not see on its way along the lane, such as the far end of a cell outside of a
    sharp bend, has viewpoints of its own, from which it sees it whatever its heading.
    """
    import shapely

    middles = lattice.centers(clipped.rows, clipped.cols)
    good = shapely.intersects_xy(free, *middles.T)
    beyond = difference(clipped.pieces, _views_along_lanes(clipped, lattice, ahead, side))
    hidden = good & (shapely.area(beyond) > _HAIR * side**2)
    points, index = [], []
    for k, (piece, middle, fits) in enumerate(
        zip(clipped.pieces, middles, good.tolist(), strict=True)
    ):
        if fits:
            points.append(middle[None])
            if hidden[k]:
                places = viewpoints_of(
                    beyond[k : k + 1],
                    middle[None],
                    footprint=side / np.sqrt(2),
                    size=side,
                    free=shapely.intersection(free, piece.buffer(side)),
                )[0]
                points[-1] = np.concatenate([points[-1], places])
        else:
            step = ahead[clipped.cols[k]].sum(axis=0)
            turn = float(np.degrees(np.arctan2(step[1], step[0])))
            near = shapely.intersection(free, piece.buffer(side))
            places = viewpoints_of(
                np.array([rotate_shape(piece, -turn)], dtype=object),
                rotate(middle[None], -turn),
                footprint=side,
                size=side,
                free=rotate_shape(near, -turn),
            )[0]
            points.append(rotate(places, turn))
        index.append(np.full(len(points[-1]), k))
    return np.concatenate(points), np.concatenate(index)


def _views_along_lanes(
    clipped: Clipped, lattice: LineLattice, ahead: NDArray[np.float64], side: float
) -> Any:
    """Return what a robot sees near the middle of each piece's cell on its way along the lane, from
    the middle of the cell before to the middle of the next one; Shapely geometries, shape (n,).
    """
    import shapely

    middles, rows, cols = lattice.middles, clipped.rows, clipped.cols
    here, n = middles[rows, cols], middles.shape[1]
    views = []
    for step, facing in ((-1, ahead[cols, 0]), (1, ahead[cols, 1])):
        there = middles[rows, np.clip(cols + step, 0, n - 1)]
        legs = step * (np.where(np.isnan(there), here, there) - here)
        lengths = np.hypot(*legs.T)[:, None]
        directions = np.where(lengths > 0, legs / np.where(lengths > 0, lengths, 1.0), facing)
        views.append(Image(1.0, 1.0).along_legs(here, here + step * legs, side, 0.0, directions))
    return shapely.union(*views)


def _portals(clipped: Clipped, lattice: LineLattice) -> Portals:
    """Return the openings between pieces that touch each other."""
    import shapely

    hair = _HAIR * lattice.size
    first, second = shapely.STRtree(clipped.pieces).query(
        clipped.pieces, predicate="dwithin", distance=hair
    )
    first, second = first[first < second], second[first < second]
    common = shapely.intersection(
        shapely.buffer(clipped.pieces[first], hair), clipped.pieces[second]
    )
    widths = shapely.area(common) / hair
    wide = widths > 4 * hair
    middles = shapely.get_coordinates(shapely.point_on_surface(common[wide])).reshape(-1, 2)
    return Portals(
        np.stack([first[wide], second[wide]], axis=1), lattice.to_region(middles), widths[wide]
    )


def center_line(region: SearchRegion, footprint: float) -> Points:
    """Return the line along the middle of a long region, in metres; float64, shape (k, 2).

    The line is the longest path in the Voronoi diagram of the region's border, without the branches
    into the corners at its ends, and as straight as the footprint allows.

    Raises
    ------
    InvalidInputError
        If the region has several parts.

    Examples
    --------
    >>> from shoal.search import open_region
    >>> line = center_line(open_region("rectangle:300x10"), 12)
    >>> bool(np.ptp(line, axis=0)[0] > 250), bool(np.allclose(line[:, 1], 5, atol=1))
    (True, True)
    """
    import shapely
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra
    from shapely.ops import substring

    if len(region.parts) > 1:
        raise InvalidInputError(
            f"along: expected a line, because the region {region.name!r} has {len(region.parts)}"
            " parts, got centre"
        )
    area = region.area
    length = float(shapely.length(area.boundary))
    width = 2 * area.area / length  # of a long strip
    step = max(min(width, footprint) / 4, length / _BORDER_POINTS)
    border = shapely.get_coordinates(shapely.segmentize(area.boundary, step))
    edges = shapely.get_parts(
        shapely.voronoi_polygons(shapely.multipoints(border), only_edges=True)
    )
    points, of = shapely.get_coordinates(edges, return_index=True)
    same = of[1:] == of[:-1]
    begins, stops = points[:-1][same], points[1:][same]
    shapely.prepare(area)
    inner = shapely.contains_xy(area, *begins.T) & shapely.contains_xy(area, *stops.T)
    begins, stops = begins[inner], stops[inner]
    nodes, number = np.unique(
        np.round(np.concatenate([begins, stops]), 6), axis=0, return_inverse=True
    )
    number = number.reshape(2, -1)
    none = InvalidInputError(
        f"along: expected a line, because the region {region.name!r} has no middle line, got centre"
    )
    if number.shape[1] == 0:
        raise none
    graph = coo_array(
        (np.hypot(*(begins - stops).T), tuple(number)), shape=(len(nodes),) * 2
    ).tocsr()

    def farthest(node: int) -> tuple[int, NDArray[np.int64], NDArray[np.float64]]:
        far, before = dijkstra(graph, directed=False, indices=node, return_predecessors=True)
        far[np.isinf(far)] = -1.0
        return int(far.argmax()), before, far

    begin = farthest(int(number[0, 0]))[0]
    end, before, far = farthest(begin)
    path = [end]
    while path[-1] != begin:
        path.append(int(before[path[-1]]))
    if len(path) < 2:  # a circle has a middle point
        raise none
    line = shapely.linestrings(nodes[path])
    # at its ends, it runs into a corner
    cut = min(
        float(shapely.distance(shapely.points(nodes[path]), area.boundary).max()) * 1.5,
        far[end] / 4,
    )
    inner_line = substring(line, cut, far[end] - cut)
    tolerance = max((footprint - width) / 4, 0.05 * footprint, 0.08 * (width - footprint))
    return np.asarray(shapely.get_coordinates(shapely.simplify(inner_line, tolerance)))
