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
