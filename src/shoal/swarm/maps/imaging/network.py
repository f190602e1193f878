"""Networks of vessels: centre lines, parts, and the map that a network becomes."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import one_line
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import partial_sums, step_lengths
from shoal.jit.kernels.connected import connected_parts
from shoal.swarm.maps.imaging.segmentation import find_vessels, imaging_module
from shoal.swarm.maps.reading import HIGH, LOW, Mask
from shoal.swarm.maps.resampling import Box, box_of, crop, largest_part

Points = NDArray[np.float64]
Indices = NDArray[np.int64]
Links = list[list[int]]

# a branch with an open end is noise if it is shorter than this many distances from its junction to
# the vessel's edge
SPUR = 1.5
# standard deviation of the smoothing along a centre line, in pixels: it removes the steps of the
# pixels
SMOOTHING = 2.0


class Segment(NamedTuple):
    """The centre line of a vessel between two nodes, which are junctions or ends.

    Attributes
    ----------
    points : ndarray, float64, shape (k, 2)
        Points of the smoothed centre line as (row, column) in pixels, from the first node to the
        last node.
    along : ndarray, float64, shape (k,)
        Length of the centre line from the first node to each point, in pixels.
    area : ndarray, float64, shape (k,)
        For each point, the number of vessel pixels that are nearer to the point than to any other
        point of a centre line.
    nodes : tuple of int
        Indices of the first and the last node of the segment in the array ``places`` of
        `CentreLines`.
    """

    points: Points
    along: Points
    area: Points
    nodes: tuple[int, int]

    def __repr__(self) -> str:
        return one_line(self)

    @property
    def length(self) -> float:
        """Length of the segment's centre line, in pixels."""
        return float(self.along[-1])

    def width(self, first: float, last: float) -> float:
        """Return the mean width of the vessel, in pixels, between two distances along the segment.

        If fewer than two points of the centre line lie between the two distances, return NaN.
        """
        indices = np.flatnonzero((self.along >= first) & (self.along <= last))
        if len(indices) < 2:
            return float("nan")
        ends = (
            self.area[indices[0]] + self.area[indices[-1]]
        ) / 2  # half of the area of the first and of the last point lies outside
        return float(
            (self.area[indices].sum() - ends) / (self.along[indices[-1]] - self.along[indices[0]])
        )

    def backward(self) -> Segment:
        """Return the reversed segment, which runs from the last node to the first node."""
        return Segment(
            self.points[::-1], self.length - self.along[::-1], self.area[::-1], self.nodes[::-1]
        )


class CentreLines(NamedTuple):
    """The centre lines of the vessels in a mask.

    Attributes
    ----------
    segments : list of Segment
        All segments between two nodes. The list of segments omits closed curves without a junction.
    places : ndarray, float64, shape (nodes, 2)
        Row and column of each node (a junction or an end), in pixels.
    radii : ndarray, float64, shape (nodes,)
        Radius of the largest disc around each node inside the vessels, in pixels.
    skeleton : ndarray of bool, shape (H, W)
        True for pixels on the centre lines.
    """

    segments: list[Segment]
    places: Points
    radii: Points
    skeleton: Mask

    def __repr__(self) -> str:
        return one_line(self)

    def branches(self) -> list[list[Segment]]:
        """Return, for each node, all segments that end at the node, directed away from the node.

        A segment whose two ends are the same node occurs twice in the node's list.
        """
        branches: list[list[Segment]] = [[] for _ in self.places]
        for segment in self.segments:
            branches[segment.nodes[0]].append(segment)
            branches[segment.nodes[1]].append(segment.backward())
        return branches


def centre_lines(mask: Mask) -> CentreLines:
    """Return the centre lines of a mask of shape (H, W), which is True on vessels.

    The skeleton of two crossing vessels may have two junctions of three segments. The function
    therefore finds the largest disc inside the vessels around each junction, and joins two
    connected junctions if their discs overlap. Two crossing vessels then have one junction of four
    segments.

    Raises
    ------
    MissingExtraError
        Raised if scikit-image is not installed.
    """
    from scipy import ndimage

    vessels = np.pad(mask, 1)
    depth = ndimage.distance_transform_edt(vessels)
    skeleton = np.asarray(imaging_module("morphology").skeletonize(vessels), dtype=np.bool_)
    while True:
        at = np.argwhere(skeleton)
        links = _links(skeleton, at)
        chains, node_of = _chains(links)
        spurs = [spur for chain in chains if (spur := _spur(chain, links, depth[tuple(at.T)]))]
        if not spurs:
            break
        skeleton[tuple(at[np.concatenate(spurs)].T)] = False
    nearest = ndimage.distance_transform_edt(~skeleton, return_distances=False, return_indices=True)
    owner = np.ravel_multi_index(tuple(nearest[:, vessels]), vessels.shape)
    area = np.bincount(owner, minlength=vessels.size).astype(np.float64)[
        np.ravel_multi_index(tuple(at.T), vessels.shape)
    ]
    segments = [_segment(chain, node_of, at, area) for chain in chains]
    return _join_junctions(segments, node_of, at, depth[tuple(at.T)], skeleton[1:-1, 1:-1])


def _links(skeleton: Mask, at: Indices) -> Links:
    """Return the neighbours of each skeleton pixel. A diagonal neighbour counts only if no third
    pixel is beside both pixels.
    """
    index = np.full(skeleton.shape, -1)
    index[tuple(at.T)] = np.arange(len(at))
    links: Links = [[] for _ in at]
    rows, columns = at.T
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        linked = skeleton[rows + down, columns + right]
        if down and right:
            linked &= ~(skeleton[rows + down, columns] | skeleton[rows, columns + right])
        for first, second in zip(
            np.flatnonzero(linked),
            index[rows + down, columns + right][linked].tolist(),
            strict=True,
        ):
            links[first].append(second)
            links[second].append(int(first))
    return links


def _chains(links: Links) -> tuple[list[list[int]], dict[int, int]]:
    """Return the chains of pixels between nodes, and the index of the node for each pixel at a
    junction or an end.
    """
    node_of: dict[int, int] = {}
    nodes = 0
    for pixel, near in enumerate(links):
        if pixel in node_of or len(near) == 2 or not near:
            continue
        group, node, nodes = [pixel], nodes, nodes + 1
        node_of[pixel] = node
        for member in group if len(near) > 2 else ():
            new = [
                neighbour
                for neighbour in links[member]
                if len(links[neighbour]) > 2 and neighbour not in node_of
            ]
            node_of.update(dict.fromkeys(new, node))
            group += new
    chains = []
    for pixel, node in node_of.items():
        for step in links[pixel]:
            chain = [pixel, step]
            while chain[-1] not in node_of:
                first, second = links[chain[-1]]
                chain.append(second if first == chain[-2] else first)
            inside = len(chain) == 2 and node_of[step] == node  # both in the same junction
            # once, not from both of its ends
            if not inside and (chain[0], chain[1]) <= (chain[-1], chain[-2]):
                chains.append(chain)
    return chains, node_of


def _spur(chain: list[int], links: Links, depth: Points) -> list[int]:
    """Return the pixels of a spur (a short branch with an open end), except its junction.

    For a chain that is not a spur, return an empty list.
    """
    first_degree, last_degree = len(links[chain[0]]), len(links[chain[-1]])
    if min(first_degree, last_degree) != 1 or max(first_degree, last_degree) < 3:
        return []
    chain = chain if first_degree == 1 else chain[::-1]
    return chain[:-1] if len(chain) - 1 < SPUR * depth[chain[-1]] else []


def _join_junctions(
    segments: list[Segment], node_of: dict[int, int], at: Indices, depth: Points, skeleton: Mask
) -> CentreLines:
    """Return the centre lines after joining all connected junctions with overlapping discs."""
    from scipy import sparse

    pixels = np.array(list(node_of), dtype=np.int64)
    nodes = np.array(list(node_of.values()), dtype=np.int64)
    count = int(nodes.max(initial=-1)) + 1
    radii = np.zeros(count)
    np.maximum.at(radii, nodes, depth[pixels] - 0.5)
    ends = np.array([segment.nodes for segment in segments], dtype=np.int64).reshape(-1, 2)
    junction = np.bincount(ends.ravel(), minlength=count) > 2
    close = junction[ends].all(axis=1) & (
        np.array([segment.length for segment in segments]) < radii[ends].sum(axis=1)
    )
    links = sparse.coo_matrix((np.ones(close.sum()), tuple(ends[close].T)), shape=(count, count))
    joints, joint = sparse.csgraph.connected_components(links, directed=False)
    places = np.zeros((joints, 2))
    np.add.at(places, joint[nodes], at[pixels])
    places /= np.bincount(joint[nodes], minlength=joints)[:, None]
    largest = np.zeros(joints)
    np.maximum.at(largest, joint, radii)
    remaining = [
        segment._replace(nodes=(int(joint[segment.nodes[0]]), int(joint[segment.nodes[1]])))
        for segment, gone in zip(segments, close.tolist(), strict=True)
        if not gone
    ]
    return CentreLines(remaining, places - 1, largest, skeleton)


def _segment(chain: list[int], node_of: dict[int, int], at: Indices, area: Points) -> Segment:
    """Smooth a chain of pixels and return it as a segment. Smoothing leaves the ends of the segment
    in place.
    """
    from scipy import ndimage

    beyond = min(int(3 * SMOOTHING), len(chain) - 1)
    line = np.pad(
        at[chain].astype(np.float64), ((beyond, beyond), (0, 0)), mode="reflect", reflect_type="odd"
    )
    points = ndimage.gaussian_filter1d(line, min(SMOOTHING, len(chain) / 6), axis=0)[beyond:-beyond]
    steps = step_lengths(points)
    return Segment(
        points - 1,
        partial_sums(steps),
        area[chain],
        (node_of[chain[0]], node_of[chain[-1]]),
    )


DEFAULT_WIDTH = 160  # cells
MUCH = 0.1  # share of the vessel pixels outside the map from which a notice is a warning


def segment_vessels(
    image: ArrayLike,
    *,
    width: int | None = None,
    low: float = LOW,
    high: float = HIGH,
    bright: bool | None = None,
    thickest: float | None = None,
) -> Mask:
    """Return the largest connected vessel network of a picture as a map.

    Parameters
    ----------
    image : array_like, shape (H, W), (H, W, 3) or (H, W, 4)
        Greyscale or colour picture with any range of values.
    width : int, optional
        Larger side of the map in cells. The default is 160 cells. If the vessels extend over fewer
        than ``width`` pixels, each cell of the map is one pixel.
    low, high, bright, thickest
        Options ``low``, ``high``, ``bright`` and ``thickest`` of the function `find_vessels`.

    Returns
    -------
    ndarray, bool, shape (H, W)
        True at free cells. The map contains one 4-connected network, and has no border rows or
        columns of obstacles.

    Raises
    ------
    InvalidInputError
        Raised if the array is not a picture, if an option is out of range, or if the picture shows
        no vessels.
    MissingExtraError
        Raised if scikit-image is not installed.
    """
    return map_of_vessels(
        find_vessels(image, low=low, high=high, bright=bright, thickest=thickest).mask, width=width
    )


def map_of_vessels(mask: Mask, *, width: int | None = None) -> Mask:
    """Return the largest connected network of a mask of shape (H, W) as a map of cells.
    `VesselMap` explains the arguments.
    """
    return VesselMap(mask, width=width).free


class VesselMap:
    """The largest connected network of vessels in a mask, as a map of cells. Thin vessels stay
    connected.

    The map covers the bounding box of the vessel network. The longer side of the map has at most
    ``width`` cells, or at most 160 cells if ``width`` is None.

    Parameters
    ----------
    mask : ndarray of bool, shape (H, W)
        Mask that is True on vessels.
    width : int, optional

    Attributes
    ----------
    network : ndarray of bool, shape (H, W)
        The pixels of the network, after the bridging of gaps.
    pixels_a_cell : float
        Side of one cell in pixels.

    Raises
    ------
    InvalidInputError
        Raised if ``width`` is less than 1 cell.
    """

    def __init__(self, mask: Mask, *, width: int | None = None) -> None:
        if width is not None and width < 1:
            raise InvalidInputError(f"expected a width of at least 1 cell, got {width}")
        self.mask, self.network = mask, _join_parts(mask)
        largest = max(last - first + 1 for first, last in self.box)
        self.pixels_a_cell = max(1.0, largest / (DEFAULT_WIDTH if width is None else width))

    @property
    def box(self) -> Box:
        """First and last row and column of the network."""
        return box_of(self.network)

    @property
    def share(self) -> float:
        """Share of the network among all vessel pixels."""
        return float((self.mask & self.network).sum() / max(1, self.mask.sum()))

    @cached_property
    def free(self) -> Mask:
        """The free cells of the map, shape (rows, columns)."""
        return crop(self._cells)

    @property
    def picture_box(self) -> tuple[float, float, float, float]:
        """The left, top, right and bottom edge of the map in the photograph, in pixels."""
        (top, _), (left, _) = self.box
        (row, last_row), (column, last_column) = box_of(self._cells)
        side = self.pixels_a_cell
        return (
            left + side * column,
            top + side * row,
            left + side * (last_column + 1),
            top + side * (last_row + 1),
        )

    @cached_property
    def _cells(self) -> Mask:
        """The free cells in the box of the network."""
        vessels, factor = crop(self.network), 1 / self.pixels_a_cell
        rows, columns = (
            np.floor(np.arange(length) * factor).astype(np.int64) for length in vessels.shape
        )
        shape = (int(rows[-1]) + 1, int(columns[-1]) + 1)
        cell = (rows[:, None] * shape[1] + columns).ravel()
        pixels = np.bincount(cell, minlength=shape[0] * shape[1])
        share = (np.bincount(cell, vessels.ravel(), shape[0] * shape[1]) / pixels).reshape(shape)
        skeleton = imaging_module("morphology").skeletonize(vessels)
        return largest_part((share > 0.5) | _trace(skeleton, rows, columns, share))

    @property
    def dropped(self) -> tuple[int, float]:
        """What the map drops from the mask: the number of connected parts, and their share of the
        vessel pixels. Cells that share only a corner are connected.
        """
        dropped = self.mask & ~self.network
        pixels = int(np.count_nonzero(self.mask)) or 1
        return connected_parts(dropped, corners=True)[1], int(np.count_nonzero(dropped)) / pixels

    def notice(self, name: str) -> str:
        """Return a notice about the vessels that are not in the map of a photograph, or '' if all
        are.
        """
        parts, share = self.dropped
        if not parts:
            return ""
        which = (
            f"1 other part with {100 * share:.2g} % of the vessel pixels is"
            if parts == 1
            else f"{parts} other parts with {100 * share:.2g} % of the vessel pixels are"
        )
        kind = "warning" if share > MUCH else "notice"
        return (
            f"shoal: {kind}: {name}: the map has the largest network of vessels; {which} dropped (a"
            " smaller --low connects more)"
        )


def _join_parts(mask: Mask) -> Mask:
    """Bridge gaps of up to 1 % of the mask's larger side, and return the largest connected network
    of the mask.
    """
    from scipy import ndimage

    reach = max(mask.shape) / 200
    wide = np.pad(mask, int(reach) + 2)
    wide = ndimage.distance_transform_edt(~wide) <= reach
    component = largest_part(wide, corners=True)
    inner = slice(int(reach) + 2, -int(reach) - 2)
    closed = (ndimage.distance_transform_edt(component) > reach)[inner, inner]
    return largest_part(
        (mask & component[inner, inner])
        | imaging_module("morphology").skeletonize(closed | mask) & component[inner, inner],
        corners=True,
    )


def _trace(
    skeleton: Mask, rows: NDArray[np.int64], columns: NDArray[np.int64], share: NDArray[np.float64]
) -> Mask:
    """Return the cells through which a skeleton passes. A corner cell at each diagonal step makes
    the cells 4-connected.
    """
    free = np.zeros(share.shape, dtype=np.bool_)
    at = np.argwhere(skeleton)
    free[rows[at[:, 0]], columns[at[:, 1]]] = True
    padded = np.pad(skeleton, 1)
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        pair = at[padded[at[:, 0] + 1 + down, at[:, 1] + 1 + right]]
        row_one, column_one = rows[pair[:, 0]], columns[pair[:, 1]]
        row_two, column_two = rows[pair[:, 0] + down], columns[pair[:, 1] + right]
        # If only the row or only the column changes, the corner cell equals one of the two cells.
        upper = share[row_one, column_two] >= share[row_two, column_one]
        free[np.where(upper, row_one, row_two), np.where(upper, column_two, column_one)] = True
    return free
