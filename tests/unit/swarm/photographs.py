"""Photographs drawn from generated vessels, with known truth: light, texture, noise, disc, fovea,
exudates, reflexes.
"""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageDraw
from scipy import ndimage


def branches(rng, start, angle, width, length, side):
    """Return a vessel's branches, polylines with their width; thinner ones fork off
    (Murray's law).
    """
    todo, done = [(np.array(start, float), angle, width)], []
    while todo:
        at, heading, wide = todo.pop()
        if wide < 1.5:
            continue
        points, bend = [at], rng.normal(0, 0.012)
        for _ in range(max(4, int(length * (0.5 + rng.random()) * wide**0.5))):
            bend = 0.97 * (bend + rng.normal(0, 0.004))
            heading += bend + rng.normal(0, 0.05)
            at = at + 2 * np.array([np.cos(heading), np.sin(heading)])
            points.append(at)
            if not (at.min() > -20 and at.max() < side + 20):
                break
        else:
            share, turn = rng.uniform(0.1, 0.5), rng.choice([-1, 1])
            todo.append((at, heading - turn * share / 2, wide * (1 - share) ** (1 / 2.7)))
            todo.append((at, heading + turn * rng.uniform(0.5, 1.1), wide * share ** (1 / 2.7)))
        done.append((np.array(points), wide))
    return done


def coverage(points, width, shape):
    """Return the pixels near a line, as an index, and the share of each that the line covers;
    float64.
    """
    low = np.maximum(0, np.floor(points.min(axis=0) - width - 3)).astype(int)
    high = np.maximum(
        low + 1, np.minimum(shape[::-1], np.ceil(points.max(axis=0) + width + 4)).astype(int)
    )
    columns, rows = (int(side) for side in high - low)
    picture = Image.new("L", (3 * columns, 3 * rows))
    line = [tuple(map(float, 3 * (point - low))) for point in points]
    ImageDraw.Draw(picture).line(line, fill=255, width=max(1, round(3 * width)), joint="curve")
    covered = np.asarray(picture.resize((columns, rows), Image.Resampling.BOX)) / 255
    at = np.s_[low[1] : high[1], low[0] : high[0]]
    return at, covered[: max(0, shape[0] - low[1]), : max(0, shape[1] - low[0])]


def fundus(
    seed, *, contrast=38.0, texture=1.8, noise=3.0, blur=1.1, exudates=0, height=584, width=565
):
    """Return a photograph of an eye, uint8 (H, W, 3), and where its vessels are, bool (H, W)."""
    rng = np.random.default_rng(seed)
    shape, middle = (height, width), np.array([width, height]) / 2
    row, column = np.mgrid[:height, :width]
    left = rng.random() < 0.5
    disc = middle + np.array([(-1 if left else 1) * rng.uniform(150, 200), rng.uniform(-40, 40)])
    away = 0 if left else np.pi
    vessels = []
    for up in (-1, 1, rng.choice([-1, 1])):
        for starts, length, thick in (
            ((0.8, 1.4), 38, (5, 8.5)),
            ((2.0, 2.9), 30, (3, 6)),
            ((0.1, 0.6), 30, (2, 3.2)),
        ):
            for _ in range(2):
                start = disc + rng.normal(0, 5, 2)
                vessels += branches(
                    rng,
                    start,
                    away + up * rng.uniform(*starts),
                    rng.uniform(*thick),
                    length,
                    height,
                )
    depth, truth = np.zeros(shape), np.zeros(shape, bool)
    for points, wide in vessels:
        at, covered = coverage(points, wide, shape)
        truth[at] |= covered >= 0.45
        strength = contrast * np.clip((wide / 7) ** 0.75, 0.25, 1) * rng.uniform(0.7, 1.1)
        depth[at] = np.maximum(depth[at], strength * covered)
        if wide > 4:  # the central reflex
            at, covered = coverage(points, 0.3 * wide, shape)
            depth[at] -= 0.3 * strength * covered
    x, y = column / middle[0] - 1, row / middle[1] - 1
    green = 105 * (1 + 0.15 * (rng.normal() * x + rng.normal() * y) - 0.2 * (x**2 + y**2))
    for scale, share in ((1.5, 0.45), (3, 0.45), (8, 0.5), (25, 0.8)):
        field = ndimage.gaussian_filter(rng.normal(size=shape), scale)
        green += texture * share * field / field.std()
    green -= 22 * np.exp(-((column - middle[0]) ** 2 + (row - middle[1]) ** 2) / 2 / 28**2)
    away_from_disc = np.hypot(column - disc[0], row - disc[1])
    green += 60 / (1 + np.exp((away_from_disc - 36) / 2.5)) + 20 * np.exp(
        -(away_from_disc**2) / 7200
    )
    for _ in range(exudates):
        at = rng.uniform(120, 440, 2)
        green += rng.uniform(20, 60) / (
            1 + np.exp(np.hypot(column - at[0], row - at[1]) - rng.uniform(1.5, 8))
        )
    green = ndimage.gaussian_filter(green - depth * green / 105, blur)
    green += 0.6 * rng.normal(0, noise, shape) + 1.6 * noise * ndimage.gaussian_filter(
        rng.normal(size=shape), 0.7
    )
    picture = np.dstack([0.8 * ndimage.gaussian_filter(green, 4) + 110, green, 0.35 * green])
    inside = np.hypot(column - middle[0], row - middle[1]) - 270
    picture = picture / (1 + np.exp(inside / 0.8))[..., None] + np.abs(
        rng.normal(2, 1.5, (*shape, 3))
    )
    return np.clip(picture, 0, 255).astype(np.uint8), truth & (inside < 0)


def angiogram(seed, shape, *, widest, contrast=75.0, noise=9.0):
    """Return a noisy grey picture of dark vessels, uint8 (H, W), and where they are."""
    rng = np.random.default_rng(seed)
    height, width = shape
    depth = np.zeros(shape)
    for angle in (-0.5, 0.0, 0.5):
        for points, wide in branches(
            rng, (0.1 * width, height / 2), angle, widest, width / (2 * widest), max(shape)
        ):
            at, covered = coverage(points, wide, shape)
            depth[at] = np.maximum(depth[at], covered)
    light = 180 + 20 * np.linspace(-1, 1, width) - contrast * ndimage.gaussian_filter(depth, 1)
    return np.clip(light + rng.normal(0, noise, shape), 0, 255).astype(np.uint8), depth > 0.5


def dice(one, other):
    """Return the Dice coefficient of two masks."""
    return 2 * np.count_nonzero(one & other) / (np.count_nonzero(one) + np.count_nonzero(other))
