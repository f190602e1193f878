"""The centre lines of a vascular network, grown by space colonisation.

Attraction points fill the outline of an organ; the network grows towards the points that are near it and removes those
it has reached. Three rounds, each with points closer together than the last, give trunks, branches and twigs. Twigs that end
close to another vessel are then joined to it, which gives the closed loops of a leaf or a capillary bed.

Coordinates here are real (x, y) pairs in units of a cell, the centre of the organ at the origin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Indices = NDArray[np.int64]

STEP = 1.5  # length of one piece of vessel, in cells: short enough for smooth bends
SPACING = 7.5  # distance between neighbouring twigs, in cells
ROUNDS = (6.0, 2.6, 1.0)  # spacing of the attraction points of each round, in units of SPACING
JOIN_REACH = 1.9  # how far a twig looks for a vessel to join, in units of SPACING
JOINED_SHARE = 0.72  # of the twigs; the others stay dead ends


@dataclass(frozen=True)
class Network:
    """A vascular network as a tree of nodes and the joints that close loops.

    Attributes
    ----------
    points : ndarray, float64, shape (nodes, 2)
        Position of each node.
    parents : ndarray, int64, shape (nodes,)
        Node that each node grew from, always an earlier one; a root is its own parent.
    joints : tuple of ndarray, float64, shape (k, 2)
        Curves from the tip of a twig to another vessel.
    """

    points: Points
    parents: Indices
    joints: tuple[Points, ...]


@dataclass(frozen=True)
class Outline:
    """A smooth closed curve around the origin: radius as a function of the angle."""

    radius: float
    stretch: float
    waves: Points

    def limit(self, angle: Points) -> Points:
        """Return the radius of the outline at each angle (radians)."""
        order = np.arange(2, 2 + len(self.waves))
        wave = (self.waves[:, 0, None] * np.cos(order[:, None] * angle + self.waves[:, 1, None])).sum(axis=0)
        return np.asarray(self.radius * (1 + wave))

    def at(self, angle: float, share: float) -> Points:
        """Return the point at ``share`` of the way from the centre to the outline."""
        limit = share * self.limit(np.array([angle]))
        return np.array([limit[0] * np.cos(angle) * self.stretch, limit[0] * np.sin(angle) / self.stretch])

    def scatter(self, spacing: float, rng: np.random.Generator) -> Points:
        """Return random points inside, one for each square of side ``spacing``."""
        half = 1.6 * self.radius
        points = rng.uniform(-half, half, (int((2 * half / spacing) ** 2) + 8, 2))
        flat = points / (self.stretch, 1 / self.stretch)
        inside = np.hypot(flat[:, 0], flat[:, 1]) < self.limit(np.arctan2(flat[:, 1], flat[:, 0]))
        return np.asarray(points[inside])


def random_outline(area: float, rng: np.random.Generator) -> Outline:
    """Return a blob of about the given area (in cells)."""
    amplitude = rng.uniform(0.3, 1.0, 4) * (0.085, 0.06, 0.035, 0.02)
    waves = np.column_stack([amplitude, rng.uniform(0, 2 * np.pi, 4)])
    return Outline(float(np.sqrt(area / np.pi)), float(rng.uniform(1.02, 1.12)), waves)


def grow_network(area: float, rng: np.random.Generator) -> Network:
    """Grow a network that fills a random blob of about ``area`` cells."""
    outline = random_outline(area, rng)
    points, parents = _roots(outline, rng)
    for coarseness in ROUNDS:
        spacing = coarseness * SPACING
        targets = outline.scatter(max(0.45 * spacing, 1.0), rng)
        points, parents = _colonise(points, parents, targets, spacing, rng)
    points = _smooth(points, parents)
    return Network(points, parents, _join_tips(points, parents, rng))


def leaf_counts(parents: Indices) -> Indices:
    """Return how many tips each node feeds, shape (nodes,); a tip feeds itself."""
    counts = np.zeros(len(parents), dtype=np.int64)
    counts[tips(parents)] = 1
    for node in range(len(parents) - 1, 0, -1):
        if parents[node] != node:
            counts[parents[node]] += counts[node]
    return counts


def tips(parents: Indices) -> Indices:
    """Return the nodes that nothing grew from."""
    grown_from = parents[parents != np.arange(len(parents))]
    return np.flatnonzero(np.bincount(grown_from, minlength=len(parents)) == 0)


def _roots(outline: Outline, rng: np.random.Generator) -> tuple[Points, Indices]:
    """Return the first nodes: where one vessel, or two that meet, enter the organ."""
    angle = float(rng.uniform(0, 2 * np.pi))
    entry = outline.at(angle, 1.0)
    inward = outline.at(angle, 0.8)
    pieces = max(2, int(np.hypot(*(entry - inward)) / STEP))
    share = np.linspace(0, 1, pieces)[:, None]
    parents = np.maximum(np.arange(pieces) - 1, 0)
    return entry + share * (inward - entry), parents


def _colonise(
    points: Points, parents: Indices, targets: Points, spacing: float, rng: np.random.Generator
) -> tuple[Points, Indices]:
    """Grow towards ``targets`` until each one is reached or out of the network's sight."""
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(points).query(targets)
    sight = max(5 * spacing, float(distance.min()) + spacing) if len(targets) else 0.0
    while True:
        far = distance > 0.55 * spacing
        targets, distance, nearest = targets[far], distance[far], nearest[far]
        seen = distance < sight
        if not seen.any():
            return points, parents
        growing, heading = _headings(points, targets[seen], nearest[seen], rng)
        new = points[growing] + STEP * heading
        closer, which = cKDTree(new).query(targets)
        better = closer < distance - 0.05 * STEP
        # A target that pulls without getting closer is balanced by others: drop it, so that growth ends.
        keep = better | ~seen
        nearest = np.where(better, which + len(points), nearest)[keep]
        distance, targets = np.minimum(closer, distance)[keep], targets[keep]
        points, parents = np.concatenate([points, new]), np.concatenate([parents, growing])


def _headings(
    points: Points, targets: Points, nearest: Indices, rng: np.random.Generator
) -> tuple[Indices, Points]:
    """Return the nodes that are pulled and the unit direction each one grows in."""
    pull = targets - points[nearest]
    pull /= np.hypot(pull[:, 0], pull[:, 1])[:, None]
    growing, slot = np.unique(nearest, return_inverse=True)
    total = np.column_stack([np.bincount(slot, pull[:, axis], len(growing)) for axis in (0, 1)])
    total /= np.hypot(total[:, 0], total[:, 1])[:, None] + 1e-9
    total += rng.normal(0, 0.22, total.shape)
    total /= np.hypot(total[:, 0], total[:, 1])[:, None] + 1e-9
    return growing, total


def _smooth(points: Points, parents: Indices) -> Points:
    """Return the nodes moved towards the middle of their neighbours; forks, roots and tips stay."""
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
    """Return curves that lead most tips to a vessel nearby which is not their own branch."""
    from scipy.spatial import cKDTree

    first, size = _subtrees(parents)
    tree = cKDTree(points)
    joined: set[int] = set()
    curves = []
    kin_steps = int(1.6 * SPACING / STEP)
    for tip in rng.permutation(tips(parents)):
        if tip in joined or rng.random() > JOINED_SHARE:
            continue
        near = np.sort(np.asarray(tree.query_ball_point(points[tip], JOIN_REACH * SPACING), dtype=np.int64))
        branch = _ancestor(parents, int(tip), kin_steps)
        other = near[(first[near] < first[branch]) | (first[near] >= first[branch] + size[branch])]
        heading = points[tip] - points[_ancestor(parents, int(tip), 3)]
        target = _best_target(points, int(tip), heading, other)
        if target is not None:
            joined |= {int(tip), target}
            curves.append(_bend(points[tip], points[target], heading))
    return tuple(curves)


def _best_target(points: Points, tip: int, heading: Points, candidates: Indices) -> int | None:
    """Return the candidate that is near and ahead of the tip, or None."""
    if not len(candidates):
        return None
    way = points[candidates] - points[tip]
    length = np.hypot(way[:, 0], way[:, 1]) + 1e-9
    ahead = way @ heading / (length * (np.hypot(*heading) + 1e-9))
    cost = np.where(ahead > -0.2, length * (1.8 - ahead), np.inf)
    best = int(np.argmin(cost))
    return int(candidates[best]) if np.isfinite(cost[best]) else None


def _bend(start: Points, end: Points, heading: Points) -> Points:
    """Return a curve from ``start`` to ``end`` that leaves along ``heading``, shape (k, 2)."""
    length = float(np.hypot(*(end - start)))
    control = start + heading / (np.hypot(*heading) + 1e-9) * 0.5 * length
    share = np.linspace(0, 1, int(length / STEP) + 2)[:, None]
    return np.asarray((1 - share) ** 2 * start + 2 * share * (1 - share) * control + share**2 * end)


def _ancestor(parents: Indices, node: int, steps: int) -> int:
    """Return the node ``steps`` generations back, or the root before that."""
    for _ in range(steps):
        node = int(parents[node])
    return node


def _subtrees(parents: Indices) -> tuple[Indices, Indices]:
    """Return each node's place in depth-first order and the size of its subtree.

    A node's descendants are those whose place is in ``[first, first + size)``.
    """
    size = np.ones(len(parents), dtype=np.int64)
    for node in range(len(parents) - 1, 0, -1):
        size[parents[node]] += size[node]
    first = np.zeros(len(parents), dtype=np.int64)
    taken = np.ones(len(parents), dtype=np.int64)
    for node in range(1, len(parents)):
        parent = parents[node]
        first[node] = first[parent] + taken[parent]
        taken[parent] += size[node]
    return first, size
