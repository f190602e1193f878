"""Obvious tours: the Hilbert curve by its L-system, the walk round a spanning tree, metrics by
their definitions.
"""

from __future__ import annotations

import itertools
import math

import numpy as np


def hilbert_by_rewriting(order):
    """Return the places (x, y) of the Hilbert curve from the lower left, first step up: A ->
    -BF+AFA+FB-, B -> +AF-BFB-FA+.
    """
    text = "A"
    rules = {"A": "-BF+AFA+FB-", "B": "+AF-BFB-FA+"}
    for _ in range(order):
        text = "".join(rules.get(letter, letter) for letter in text)
    return walk(text, (1, 0), (0, 0))


def moore_by_rewriting(order):
    """Return the places (x, y) of the Moore curve, first step up: axiom LFL+F+LFL, L ->
    -RF+LFL+FR-, R -> +LF-RFR-FL+.
    """
    text = "LFL+F+LFL"
    rules = {"L": "-RF+LFL+FR-", "R": "+LF-RFR-FL+"}
    for _ in range(order - 1):
        text = "".join(rules.get(letter, letter) for letter in text)
    return walk(text, (0, 1), (2 ** (order - 1) - 1, 0))


def walk(text, heading, place):
    """Follow a turtle: F a step ahead, + a quarter to the right, - to the left."""
    places = [place]
    for letter in text:
        if letter == "F":
            place = (place[0] + heading[0], place[1] + heading[1])
            places.append(place)
        elif letter == "+":
            heading = (heading[1], -heading[0])
        elif letter == "-":
            heading = (-heading[1], heading[0])
    return places


def hilbert_in_space(order, place):
    """Return the index of (x, y, z), bit by bit, with the states spelled out: C. Hamilton's
    algorithm as it is printed.
    """
    index = entry = direction = 0
    for level in range(order - 1, -1, -1):
        part = sum((coordinate >> level & 1) << axis for axis, coordinate in enumerate(place))
        part ^= entry
        for _ in range((direction + 1) % 3):
            part = part >> 1 | (part & 1) << 2
        rank = part ^ part >> 1 ^ part >> 2
        index = index * 8 + rank
        inner = [0, 0, 0, 3, 3, 6, 6, 5][rank]
        for _ in range((direction + 1) % 3):
            inner = inner << 1 & 7 | inner >> 2
        entry ^= inner
        direction = (direction + [0, 1, 1, 2, 2, 1, 1, 0][rank] + 1) % 3
    return index


def metrics(cells, *, closed):
    """Return (length, turns, neighbour_stretch, dilation) by their definitions."""
    cells = [tuple(cell) for cell in np.asarray(cells).tolist()]
    n = len(cells)
    round_trip = cells + cells[:1] if closed else cells
    length = sum(math.dist(a, b) for a, b in itertools.pairwise(round_trip))
    walked = [*round_trip, cells[1 % n]] if closed else cells
    turns = 0
    for a, b, c in zip(walked, walked[1:], walked[2:], strict=False):
        before, after = np.subtract(b, a), np.subtract(c, b)
        size = np.linalg.norm(before) * np.linalg.norm(after)
        turns += bool(size > 0 and before @ after < size * (1 - 1e-12))
    number = {cell: k for k, cell in enumerate(cells)}
    gaps = []
    for cell, k in number.items():
        for axis in range(len(cell)):
            other = tuple(c + (axis == i) for i, c in enumerate(cell))
            if other in number:
                gap = abs(number[other] - k)
                gaps.append(min(gap, n - gap) if closed else gap)
    ladder = [
        d for d in range(1, n) if d & (d - 1) == 0 or (d % 3 == 0 and (d // 3) & (d // 3 - 1) == 0)
    ]
    worst = 0.0
    for apart in ladder:
        if apart > (n // 2 if closed else n - 1):
            break
        pairs = [(k, (k + apart) % n) for k in range(n if closed else n - apart)]
        worst = max(worst, *(math.dist(cells[i], cells[j]) ** 2 / apart for i, j in pairs))
    return length, turns, sum(gaps) / len(gaps) if gaps else 0.0, worst


def round_a_tree(full):
    """Return the cells round a spanning tree of full 2 x 2 blocks, as Gabriely and Rimon draw it:
    keep the tree at your right hand.

    ``full`` is a connected boolean array of blocks; the tree is found depth first. The tour is not
    ours, but as long.
    """
    root = tuple(int(i) for i in np.argwhere(full)[0])
    tree, stack = set(), [root]
    seen = {root}
    while stack:
        block = stack.pop()
        for step in ((0, 1), (1, 0), (0, -1), (-1, 0)):
            other = (block[0] + step[0], block[1] + step[1])
            inside = 0 <= other[0] < full.shape[0] and 0 <= other[1] < full.shape[1]
            if inside and full[other] and other not in seen:
                seen.add(other)
                tree.add(frozenset((block, other)))
                stack.append(other)
    cell, heading = (2 * root[0], 2 * root[1]), (0, 1)
    cells = []
    while not cells or cell != cells[0]:
        cells.append(cell)
        for turn in (right(heading), heading, right(right(right(heading))), right(right(heading))):
            ahead = (cell[0] + turn[0], cell[1] + turn[1])
            if may_pass(cell, ahead, full, tree):
                cell, heading = ahead, turn
                break
    return cells


def right(heading):
    return heading[1], -heading[0]


def may_pass(cell, ahead, full, tree):
    """Return whether a step crosses no link of the tree and leaves no block but along a link."""
    here, there = (cell[0] // 2, cell[1] // 2), (ahead[0] // 2, ahead[1] // 2)
    if min(ahead) < 0 or there[0] >= full.shape[0] or there[1] >= full.shape[1] or not full[there]:
        return False
    if here != there:
        return frozenset((here, there)) in tree
    if cell[0] == ahead[0]:  # along the row: the link up or down lies between
        beyond = (here[0] + (1 if cell[0] % 2 else -1), here[1])
    else:
        beyond = (here[0], here[1] + (1 if cell[1] % 2 else -1))
    return frozenset((here, beyond)) not in tree


def cost_of_round(points, order, turn):
    """Return the length of a closed tour, and ``turn`` for each place where the direction changes
    by more than a degree.
    """
    way = [points[k] for k in order]
    return cost_of_path([way[-1], *way, way[0]], turn) + math.dist(way[-1], way[0])


def cost_of_path(path, turn):
    """Return the length of a path without its first and last leg, and ``turn`` for each turn of
    more than a degree.
    """
    total = sum(math.dist(one, other) for one, other in itertools.pairwise(path[1:-1]))
    for before, here, after in zip(path, path[1:], path[2:], strict=False):
        (x, y), (u, v) = np.subtract(here, before), np.subtract(after, here)
        if math.hypot(x, y) * math.hypot(u, v) > 1e-9 and abs(
            math.atan2(x * v - y * u, x * u + y * v)
        ) > math.radians(1.0):
            total += turn
    return total


def exchanges_of_cells(order, beside, straight):
    """Yield each order after one exchange: two links replaced, or up to three cells moved beside
    another cell.
    """
    n = len(order)
    place = {cell: k for k, cell in enumerate(order)}
    for here in order:
        for other in {int(cell) for cell in beside[here] if cell >= 0} - {int(here)}:
            for side in (1, -1):
                low, high = sorted((place[here], place[other]))
                first, last = (low + 1, high) if side > 0 else (low, high - 1)
                new = [order[(place[cell] + side) % n] for cell in (here, other)]
                if last > first and other != new[0] and here != new[1] and straight(*new):
                    yield np.concatenate(
                        [order[:first], order[first : last + 1][::-1], order[last + 1 :]]
                    )
    for first, count in itertools.product(range(n), (1, 2, 3)):
        turned = np.roll(order, -first)
        moved, rest = turned[:count], turned[count:]
        if not straight(rest[-1], rest[0]):
            continue
        for k in range(1, len(rest)):
            for part in (moved, moved[::-1]):
                ends = (rest[k - 1], part[0]), (part[-1], rest[k])
                near = [one in beside[other] for one, other in ends]
                if any(near) and all(near[i] or straight(*ends[i]) for i in range(2)):
                    yield np.concatenate([rest[:k], part, rest[k:]])


def shorter_paths(path, targets, half, turn, steps):
    """Return all paths after one change that cost less and pass over all targets, as (cost, path),
    sorted by cost.
    """
    most = cost_of_path(path, turn) - 1e-3 * turn
    found = []
    for changed in changed_paths([tuple(point) for point in path], steps):
        cost = cost_of_path(changed, turn)
        ways = [np.array(leg) for leg in itertools.pairwise(changed[1:-1])]
        if cost < most and all(
            any(passes(one, other, target, half) for one, other in ways) for target in targets
        ):
            found.append((cost, changed))
    return sorted(found)


def changed_paths(path, steps):
    """Yield each path after one change of one or two points between the fixed ones."""
    last = len(path) - 3

    def towards(one, other, step):
        return tuple(np.add(one, np.subtract(other, one) * step / math.dist(one, other)))

    for v in range(2, last + 1):
        before, here, after = path[v - 1 : v + 2]
        yield path[:v] + path[v + 1 :]
        yield [*path[:v], tuple(np.array(here) / 2 + np.add(before, after) / 4), *path[v + 1 :]]
        for step in steps:
            for other in (before, after):
                if step < math.dist(here, other):
                    yield [*path[:v], towards(here, other, step), *path[v + 1 :]]
            if v < last and 0 < step < min(math.dist(here, before), math.dist(after, path[v + 2])):
                yield [
                    *path[:v],
                    towards(here, before, step),
                    towards(after, path[v + 2], step),
                    *path[v + 2 :],
                ]
        if v < last:
            ahead, back = np.subtract(here, before), np.subtract(after, path[v + 2])
            if abs(np.linalg.det(np.array([ahead, back]))) > 1e-9:
                one, other = np.linalg.solve(
                    np.array([ahead, -back]).T, np.subtract(path[v + 2], before)
                )
                if one > 0 and other > 0:
                    yield [*path[:v], tuple(before + one * ahead), *path[v + 2 :]]


def passes(one, other, target, half):
    """Return whether a square passes over a target on the way from one point to another: where its
    sides reach the target.
    """
    shares = [0.0, 1.0]
    for axis in range(2):
        if other[axis] != one[axis]:
            shares += [
                (target[axis] + sign * half - one[axis]) / (other[axis] - one[axis])
                for sign in (-1, 1)
            ]
    places = [one + min(max(share, 0.0), 1.0) * (other - one) for share in shares]
    return any(np.abs(place - target).max() <= half + 1e-6 for place in places)
