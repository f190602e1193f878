"""Generated vessels of two dimensions, which grow like the veins of a leaf."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.geometry import angles_of
from shoal.jit.kernels.connected import connected_parts
from shoal.swarm.kernels.search import nearest_cells
from shoal.swarm.maps.reading import Mask
from shoal.swarm.maps.resampling import crop

Points = NDArray[np.float64]
Indices = NDArray[np.int64]

STEP = 1.5  # length of one vessel segment, in cells: short enough for smooth bends
WANDER = 0.22  # random part of each segment's direction
SPACING = 5.2  # distance between neighbouring twigs, in cells
ROUNDS = (6.0, 3.0, 1.6, 1.0)  # spacing of the attraction points of each round, in units of SPACING
# maximum distance between the tip of a twig and a vessel that it joins, in units of SPACING
JOIN_REACH = 1.9
JOINED_SHARE = 0.6  # fraction of twigs that are joined; the others stay dead ends


@dataclass(frozen=True)
class VesselNetwork:
    """A network of blood vessels: trees of nodes, and the joints that close loops.

    Attributes
    ----------
    points : ndarray, float64, shape (nodes, 2)
        Position (x, y) of each node, in cells.
    parents : ndarray, int64, shape (nodes,)
        Index of the parent of each node. A parent has a smaller index than its children. The parent
        of a root is the root itself.
    joints : tuple of ndarray, float64, shape (k, 2)
        Curves from the tip of a twig to another vessel, as points (x, y) in cells.
    """

    points: Points
    parents: Indices
    joints: tuple[Points, ...]


@dataclass(frozen=True)
class OrganOutline:
    """The outline of an organ: a smooth closed curve around the origin.

    A radius for each angle defines the curve. The curve is then stretched along one axis and
    compressed along the other axis.
    """

    radius: float
    stretch: float
    waves: Points

    def limit(self, angle: Points) -> Points:
        """Return the radius of the outline before it is stretched, in cells, at each angle in
        radians.
        """
        order = np.arange(2, 2 + len(self.waves))
        wave = (
            self.waves[:, 0, None] * np.cos(order[:, None] * angle + self.waves[:, 1, None])
        ).sum(axis=0)
        return np.asarray(self.radius * (1 + wave))

    def at(self, angle: float, share: float) -> Points:
        """Return the point at the fraction ``share`` of the radius of the outline, in the direction
        ``angle`` (radians).
        """
        limit = share * self.limit(np.array([angle]))
        return np.array(
            [limit[0] * np.cos(angle) * self.stretch, limit[0] * np.sin(angle) / self.stretch]
        )

    def scatter(self, spacing: float, rng: np.random.Generator) -> Points:
        """Return random points inside the outline: on average, one point for each square with sides
        of ``spacing`` cells.
        """
        half = 1.6 * self.radius
        points = rng.uniform(-half, half, (int((2 * half / spacing) ** 2) + 8, 2))
        flat = points / (self.stretch, 1 / self.stretch)
        inside = np.hypot(flat[:, 0], flat[:, 1]) < self.limit(angles_of(flat))
        return np.asarray(points[inside])


def random_outline(area: float, rng: np.random.Generator) -> OrganOutline:
    """Return a random smooth outline with an area of about ``area`` cells."""
    amplitude = rng.uniform(0.3, 1.0, 4) * (0.085, 0.06, 0.035, 0.02)
    waves = np.column_stack([amplitude, rng.uniform(0, 2 * np.pi, 4)])
    return OrganOutline(float(np.sqrt(area / np.pi)), float(rng.uniform(1.02, 1.12)), waves)


def grow_network(area: float, rng: np.random.Generator) -> VesselNetwork:
    """Grow a vessel network that fills a random outline with an area of about ``area`` cells."""
    outline = random_outline(area, rng)
    points, parents = _roots(outline, rng)
    for coarseness in ROUNDS:
        spacing = coarseness * SPACING
        targets = outline.scatter(max(0.45 * spacing, 1.0), rng)
        points, parents = _colonise(points, parents, targets, spacing, rng)
    points = _smooth(points, parents)
    return VesselNetwork(points, parents, _join_tips(points, parents, rng))


def subtrees(parents: Indices) -> tuple[Indices, Indices]:
    """Return two arrays of shape (nodes,): each node's index in depth-first order, and the number
    of nodes in the node's subtree.

    A node with the index ``first`` in depth-first order, and its descendants, have the indices
    ``first`` to ``first + size - 1``.
    """
    up = parents.tolist()
    size, first, offset = [1] * len(up), [0] * len(up), [1] * len(up)
    for node in range(len(up) - 1, -1, -1):
        if up[node] != node:
            size[up[node]] += size[node]
    roots_end = 0
    for node, parent in enumerate(up):
        if parent == node:
            first[node] = roots_end
            roots_end += size[node]
        else:
            first[node] = first[parent] + offset[parent]
            offset[parent] += size[node]
    return np.array(first), np.array(size)


def _tips(parents: Indices) -> Indices:
    """Return the indices of the nodes without children."""
    grown_from = parents[parents != np.arange(len(parents))]
    return np.flatnonzero(np.bincount(grown_from, minlength=len(parents)) == 0)


def _roots(outline: OrganOutline, rng: np.random.Generator) -> tuple[Points, Indices]:
    """Return the first nodes of the network: one vessel that enters the organ, or two vessels from
    different sides.
    """
    angles = rng.uniform(0, 2 * np.pi) + np.array([0, rng.uniform(0.6, 1.4) * np.pi])
    stems = [_stem(outline, float(angle)) for angle in angles[: rng.integers(1, 3)]]
    starts = np.cumsum([0] + [len(stem) for stem in stems])
    parents = [
        start + np.maximum(np.arange(len(stem)) - 1, 0)
        for start, stem in zip(starts, stems, strict=False)
    ]
    return np.concatenate(stems), np.concatenate(parents)


def _stem(outline: OrganOutline, angle: float) -> Points:
    """Return the nodes of a straight vessel from the outline towards the inside of the organ."""
    entry, inner = outline.at(angle, 1.0), outline.at(angle, 0.8)
    pieces = max(2, int(np.hypot(*(entry - inner)) / STEP))
    return np.asarray(entry + np.linspace(0, 1, pieces)[:, None] * (inner - entry))


def _colonise(
    points: Points, parents: Indices, targets: Points, spacing: float, rng: np.random.Generator
) -> tuple[Points, Indices]:
    """Grow the network towards ``targets``, until each target has been reached or has no node
    within range.
    """
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(points).query(targets)
    sight = max(5 * spacing, float(distance.min()) + spacing) if len(targets) else 0.0
    patience = np.full(len(targets), 6)
    fresh = len(points)  # nodes from this index on grew in the last step
    while True:
        # Opposing targets can cancel each other. Remove a target that no vessel approaches, so that
        # growth ends.
        active = (distance > 0.6 * spacing) & (patience > 0)
        targets = targets[active]
        distance = distance[active]
        nearest = nearest[active]
        patience = patience[active]
        visible = distance < sight
        if not visible.any():
            return points, parents
        growing, pulls = np.unique(nearest[visible], return_counts=True)
        growing = _thin_out(
            points[growing], growing, pulls + 1000 * (growing >= fresh), 0.5 * spacing
        )
        pulling = visible & np.isin(nearest, growing)
        new = points[growing] + STEP * _headings(points, targets[pulling], nearest[pulling], rng)
        closer, which = cKDTree(new).query(targets)
        better = closer < distance - 0.05 * STEP
        patience -= pulling & ~better
        fresh = len(points)
        nearest = np.where(better, which + fresh, nearest)
        distance = np.minimum(closer, distance)
        points, parents = np.concatenate([points, new]), np.concatenate([parents, growing])


def _thin_out(places: Points, nodes: Indices, rank: Indices, clearance: float) -> Indices:
    """For every two nodes that are at most ``clearance`` cells apart, drop the node of lower rank.
    Return the remaining nodes.

    Dropping nodes prevents dense rows of parallel vessels.
    """
    from scipy.spatial import cKDTree

    first, second = cKDTree(places).query_pairs(clearance, output_type="ndarray").T
    loser = np.where(rank[first] >= rank[second], second, first)
    return nodes[~np.isin(np.arange(len(nodes)), loser)]


def _headings(
    points: Points, targets: Points, nearest: Indices, rng: np.random.Generator
) -> Points:
    """Return the unit vector of the growth direction of each attracted node, in ascending order of
    the node index.

    ``nearest`` is the index of the node that each target attracts.
    """
    slot = np.unique(nearest, return_inverse=True)[1]
    pull = _unit(targets - points[nearest])
    total = np.column_stack(
        [np.bincount(slot, pull[:, axis]).astype(np.float64) for axis in (0, 1)]
    )
    return _unit(_unit(total) + rng.normal(0, WANDER, total.shape))


def _unit(vectors: Points) -> Points:
    """Return vectors of shape (k, 2) scaled to length 1. Zero vectors stay unchanged."""
    return np.asarray(vectors / (np.hypot(vectors[:, 0], vectors[:, 1]) + 1e-9)[:, None])


def _smooth(points: Points, parents: Indices) -> Points:
    """Return the nodes, each shifted towards the mean of its neighbours. Forks, roots and tips stay
    in place.
    """
    nodes = np.arange(len(parents))
    is_root = parents == nodes
    grown = np.bincount(parents[~is_root], minlength=len(parents))
    child = np.zeros(len(parents), dtype=np.int64)
    child[parents[~is_root]] = nodes[~is_root]
    inner = (grown == 1) & ~is_root
    points = points.copy()
    for _ in range(3):
        middle = (points[parents[inner]] + points[child[inner]]) / 2
        points[inner] = (points[inner] + middle) / 2
    return points


def _join_tips(points: Points, parents: Indices, rng: np.random.Generator) -> tuple[Points, ...]:
    """Return curves that connect most tips to a nearby vessel of another branch."""
    from scipy.spatial import cKDTree

    first, size = subtrees(parents)
    tree = cKDTree(points)
    joined: set[int] = set()
    curves = _bridge(points, first < size[0])
    kin_steps = int(1.6 * SPACING / STEP)
    for tip in rng.permutation(_tips(parents)):
        if tip in joined or rng.random() > JOINED_SHARE:
            continue
        near = np.sort(
            np.asarray(tree.query_ball_point(points[tip], JOIN_REACH * SPACING), dtype=np.int64)
        )
        branch = _ancestor(parents, int(tip), kin_steps)
        unrelated = near[
            (first[near] < first[branch]) | (first[near] >= first[branch] + size[branch])
        ]
        heading = points[tip] - points[_ancestor(parents, int(tip), 3)]
        target = _best_target(points, int(tip), heading, unrelated)
        if target is not None:
            joined |= {int(tip), target}
            curves.append(_bend(points[tip], points[target], heading))
    return tuple(curves)


def _bridge(points: Points, in_first_tree: NDArray[np.bool_]) -> list[Points]:
    """Return the shortest segment between the two trees of a network. For a network with a single
    tree, return an empty list.
    """
    from scipy.spatial import cKDTree

    first, second = points[in_first_tree], points[~in_first_tree]
    if not len(second):
        return []
    distance, nearest = cKDTree(first).query(second)
    end = int(np.argmin(distance))
    return [np.linspace(first[nearest[end]], second[end], int(distance[end] / STEP) + 2)]


def _best_target(points: Points, tip: int, heading: Points, candidates: Indices) -> int | None:
    """Return the candidate node with the lowest cost, or None if no candidate lies ahead of the
    tip.

    The cost of a node grows with the distance between the node and the tip. The cost also grows
    with the angle between the heading of the tip and the direction from the tip to the node.
    """
    if not len(candidates):
        return None
    vectors = points[candidates] - points[tip]
    length = np.hypot(vectors[:, 0], vectors[:, 1]) + 1e-9
    ahead = vectors @ heading / (length * (np.hypot(*heading) + 1e-9))
    cost = np.where(ahead > -0.2, length * (1.8 - ahead), np.inf)
    best = int(np.argmin(cost))
    return int(candidates[best]) if np.isfinite(cost[best]) else None


def _bend(start: Points, end: Points, heading: Points) -> Points:
    """Return a curve from ``start`` to ``end`` with the initial direction ``heading``, as points of
    shape (k, 2).
    """
    length = float(np.hypot(*(end - start)))
    control = start + heading / (np.hypot(*heading) + 1e-9) * 0.5 * length
    share = np.linspace(0, 1, int(length / STEP) + 2)[:, None]
    return np.asarray((1 - share) ** 2 * start + 2 * share * (1 - share) * control + share**2 * end)


def _ancestor(parents: Indices, node: int, steps: int) -> int:
    """Return the ancestor ``steps`` generations above a node. If the node has fewer generations of
    ancestors, return the root.
    """
    for _ in range(steps):
        node = int(parents[node])
    return node


AREA_PER_CELL = 1.65  # area of the organ per free cell, before the network is scaled
TIP_WIDTH = 1.5  # width at the end of a twig, in cells
TRUNK_WIDTH = 4.8  # width of the trunk at 5000 free cells, in cells
THIN = 1.7  # narrower segments are drawn as a line of single cells
SAMPLES = 9  # points drawn per segment, which is one or two cells long
SPECK = 2  # largest hole that is filled, in cells: such holes appear where two vessels touch


def draw_vessels(count: int, *, seed: int = 0) -> Mask:
    """Return a map of a blood vessel network with exactly ``count`` free cells.

    The network has one or two inlets, vessels that narrow at each fork, closed loops and dead ends.

    Parameters
    ----------
    count : int
        Number of free cells.
    seed : int
        Seed of the random numbers. Equal sizes and equal seeds give equal maps.

    Returns
    -------
    ndarray, bool, shape (H, W)
        True at free cells. The free cells are 4-connected, and the map has no border rows or
        columns of obstacles.
    """
    rng = np.random.default_rng([seed, count])
    network = grow_network(AREA_PER_CELL * count, rng)
    return crop(_trim(_fit(network, count), count, rng))


def _fit(network: VesselNetwork, count: int) -> Mask:
    """Return a map of the vessel network at the scale that gives ``count`` free cells or slightly
    more.
    """
    start, end, width = _pieces(network, TRUNK_WIDTH * (count / 5000) ** (1 / 6))
    scale, best, best_excess = 1.0, None, count
    for attempt in range(40):
        free = _fill_specks(_draw(start * scale, end * scale, width))
        excess = int(np.count_nonzero(free)) - count
        if excess >= 0 and (best is None or excess < best_excess):
            best, best_excess = free, excess
        if best is not None and (best_excess <= max(2, count // 300) or attempt > 10):
            break
        # Aim slightly high, because removing free cells is easier than adding them.
        scale *= ((count + max(1.0, count / 600)) / (count + excess)) ** 0.8
    assert best is not None, "a larger scale gives more free cells"
    return best


def _pieces(network: VesselNetwork, trunk_width: float) -> tuple[Points, Points, Points]:
    """Return the start points (n, 2), end points (n, 2) and widths in cells (n,) of the n straight
    segments of the vessels.

    The width of a segment is a power of the total length of the vessels that the segment supplies.
    The exponent of the power is such that the widest segment has the width ``trunk_width``, and the
    ends of twigs have the width ``TIP_WIDTH``.
    """
    points, parents = network.points, network.parents
    size = subtrees(parents)[1]
    power = np.log(trunk_width / TIP_WIDTH) / np.log(max(size.max(), 2))
    grown = np.flatnonzero(parents != np.arange(len(parents)))
    curves = network.joints
    start = np.concatenate([points[parents[grown]], *(curve[:-1] for curve in curves)])
    end = np.concatenate([points[grown], *(curve[1:] for curve in curves)])
    width = np.full(len(start), TIP_WIDTH)
    width[: len(grown)] *= size[grown] ** power
    return start, end, width


def _draw(start: Points, end: Points, width: Points) -> Mask:
    """Return the cells that the vessel segments cover. The cells of each segment are
    4-connected.
    """
    share = np.linspace(0, 1, SAMPLES)[None, :, None]
    at = start[:, None] + share * (end - start)[:, None]
    margin = int(np.ceil(width.max() / 2)) + 1
    at -= np.floor(at.min(axis=(0, 1))) - margin
    cell = np.floor(at).astype(np.int64)
    free = np.zeros((cell.max(axis=(0, 1)) + margin + 1)[::-1], dtype=np.bool_)
    free[cell[..., 1], cell[..., 0]] = True
    free[cell[:, 1:, 1], cell[:, :-1, 0]] = True  # the corner cell of each diagonal step
    wide = width >= THIN
    radius = np.repeat(width[wide] / 2, SAMPLES)
    _paint_discs(free, at[wide].reshape(-1, 2), cell[wide].reshape(-1, 2), radius)
    return free


def _paint_discs(free: Mask, centre: Points, cell: Indices, radius: Points) -> None:
    """Mark as free all cells whose centre lies within ``radius`` of a disc's centre."""
    reach = int(np.ceil(radius.max(initial=0)))
    for right in range(-reach, reach + 1):
        for down in range(-reach, reach + 1):
            offset = cell + (right, down) + 0.5 - centre
            inside = cell[offset[:, 0] ** 2 + offset[:, 1] ** 2 <= radius**2]
            free[inside[:, 1] + down, inside[:, 0] + right] = True


def _fill_specks(free: Mask) -> Mask:
    """Return a copy of the map without the smallest holes."""
    holes = connected_parts(~free, corners=True)[0]
    area = np.bincount(holes.ravel())
    return np.asarray(free | ((area <= SPECK) & (area > 0))[holes] & (holes > 0))


def _trim(free: Mask, count: int, rng: np.random.Generator) -> Mask:
    """Reduce the map to ``count`` free cells: shorten dead ends, one cell after another."""
    free = np.pad(free, 1)
    excess = int(np.count_nonzero(free)) - count
    while excess > 0:
        ends = _dead_ends(free)
        if not len(ends):
            return _nearest_cells(free, count)
        gone = rng.permutation(ends)[:excess]
        for (
            row,
            column,
        ) in gone:  # one at a time, because the neighbour of a dead end may be a dead end itself
            if _free_neighbours(free, row, column) == 1:
                free[row, column] = False
                excess -= 1
    return free


def _dead_ends(free: Mask) -> Indices:
    """Return the free cells with exactly one free neighbour, shape (k, 2). All border cells of the
    map must be obstacles.
    """
    neighbours = np.zeros(free.shape, dtype=np.int64)
    neighbours[1:-1, 1:-1] = (
        free[:-2, 1:-1].astype(np.int64) + free[2:, 1:-1] + free[1:-1, :-2] + free[1:-1, 2:]
    )
    return np.argwhere(free & (neighbours == 1))


def _free_neighbours(free: Mask, row: int, column: int) -> int:
    sides = (
        free[row - 1, column],
        free[row + 1, column],
        free[row, column - 1],
        free[row, column + 1],
    )
    return sum(map(int, sides))


def _nearest_cells(free: Mask, count: int) -> Mask:
    """Return the ``count`` free cells with the shortest paths to the first free cell of the map."""
    component = np.zeros_like(free)
    offsets = np.array([-1, -free.shape[1], 1, free.shape[1]])
    component.ravel()[nearest_cells(free.ravel(), offsets, int(np.argmax(free)), count)] = True
    return component
