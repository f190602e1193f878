"""Vascular maps: a grown network drawn on cells, with an exact number of free cells."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.swarm.generators.venation import Network, Points, grow_network, leaf_counts

Mask = NDArray[np.bool_]


def vessels(count: int, *, seed: int = 0) -> Mask:
    rng = np.random.default_rng([seed, count])
    network = grow_network(2.3 * count, rng)
    free = fit(network, count)
    return trim(free, count, rng)


def samples(network, trunk):
    # pieces: start, end, wstart, wend
    pts, par = network.points, network.parents
    leaves = leaf_counts(par)
    width = np.minimum(leaves ** (1 / 2.6), trunk)
    child = np.flatnonzero(par != np.arange(len(par)))
    starts = [pts[par[child]]]; ends = [pts[child]]; widths = [np.minimum(width[child]+0,width[par[child]])]
    for curve in network.joints:
        starts.append(curve[:-1]); ends.append(curve[1:]); widths.append(np.ones(len(curve) - 1))
    return np.concatenate(starts), np.concatenate(ends), np.concatenate(widths)


def draw(start, end, width):
    t = np.linspace(0, 1, 9)[:, None, None]
    p = (start + t * (end - start)).transpose(1, 0, 2)  # piece, sample, xy
    margin = int(np.ceil(width.max() / 2)) + 2
    low = np.floor(p.min(axis=(0, 1))).astype(int) - margin
    cell = np.floor(p).astype(int) - low
    shape = cell.max(axis=(0, 1)) + margin + 1
    m = np.zeros((shape[1], shape[0]), bool)
    m[cell[..., 1], cell[..., 0]] = True
    m[cell[:, 1:, 1], cell[:, :-1, 0]] = True
    wide = width >= 1.5
    q = p[wide].reshape(-1, 2) - low
    c = cell[wide].reshape(-1, 2)
    rad = np.repeat(width[wide] / 2, 9)
    k = margin - 1
    for dx in range(-k, k + 1):
        for dy in range(-k, k + 1):
            ok = (c[:, 0] + dx + .5 - q[:, 0]) ** 2 + (c[:, 1] + dy + .5 - q[:, 1]) ** 2 <= rad ** 2
            m[c[ok, 1] + dy, c[ok, 0] + dx] = True
    return m


def fill_tiny(m, size=2):
    from scipy import ndimage
    lab, n = ndimage.label(~m, np.ones((3, 3)))
    area = np.bincount(lab.ravel())
    area[0] = 0
    small = (area <= size) & (area > 0)
    return m | small[lab]


def fit(network, count):
    trunk = max(4.0, 4.0 * (count / 5000) ** .25)
    s, e, w = samples(network, trunk)
    scale = 1.0
    best = None
    for _ in range(10):
        m = fill_tiny(draw(s * scale, e * scale, w))
        c = int(m.sum())
        if c >= count and (best is None or c < best.sum()):
            best = m
        if c >= count and c - count <= max(2, .003 * count):
            break
        scale *= ((count + max(1, .0015 * count)) / c) ** (.8)
    return best


def trim(m, count, rng):
    from scipy import ndimage
    m = np.pad(m, 1)
    while True:
        extra = int(m.sum()) - count
        if extra <= 0: break
        nb = m[:-2, 1:-1].astype(int) + m[2:, 1:-1] + m[1:-1, :-2] + m[1:-1, 2:]
        r, c = np.nonzero(m[1:-1, 1:-1] & (nb == 1))
        pick = rng.permutation(len(r))[:extra]
        m[r[pick] + 1, c[pick] + 1] = False
    r, c = np.nonzero(m)
    return np.ascontiguousarray(m[r.min():r.max() + 1, c.min():c.max() + 1])
