"""Hilbert codec against two libraries, tours of a million cells, a table of metrics: python -m
benchmarks.tours [--metrics]

The libraries are in the extra 'bench': numpy-hilbert-curve and hilbertcurve.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from benchmarks.timing import best_seconds, row
from shoal import open_map
from shoal.search import hilbert_decode, hilbert_encode, make_tour
from shoal.search.tours import TOURS

POINTS, ORDER = 1_000_000, 10
CAVE = "cave:128x96:1"


def bench_codec() -> None:
    """Decode and encode the same million points with each library, in one run."""
    import hilbert
    from hilbertcurve.hilbertcurve import HilbertCurve

    indices = np.random.default_rng(0).integers(0, 4**ORDER, POINTS)
    cells = hilbert_decode(indices, order=ORDER)
    ours = (
        best_seconds(lambda: hilbert_decode(indices, order=ORDER)),
        best_seconds(lambda: hilbert_encode(cells, order=ORDER)),
    )
    unsigned = indices.astype(np.uint64)
    places = hilbert.decode(unsigned, 2, ORDER)
    assert np.array_equal(hilbert.encode(places, 2, ORDER), unsigned)
    theirs = (
        best_seconds(lambda: hilbert.decode(unsigned, 2, ORDER), repeat=2),
        best_seconds(lambda: hilbert.encode(places, 2, ORDER), repeat=2),
    )
    curve, some = HilbertCurve(ORDER, 2), POINTS // 10
    listed = indices[:some].tolist()
    points = curve.points_from_distances(listed)
    plain = (
        10 * best_seconds(lambda: curve.points_from_distances(listed), repeat=1),
        10 * best_seconds(lambda: curve.distances_from_points(points), repeat=1),
    )
    for what, mine, numpy_curve, python_curve in zip(
        ("decode", "encode"), ours, theirs, plain, strict=True
    ):
        figure = f"{1e3 * mine:.1f} ms, {numpy_curve / mine:.0f} times"
        row(
            f"{what} 10^6 points of order {ORDER}",
            figure,
            "30 times numpy-hilbert-curve",
            numpy_curve >= 30 * mine,
        )
        print(
            f"    numpy-hilbert-curve {numpy_curve:.2f} s, hilbertcurve {python_curve:.2f} s (from"
            f" {some} points)",
            flush=True,
        )


def bench_tours() -> None:
    """Lay each tour through a million cells, checks included."""
    grids = {
        "1000 x 1000": (1000, 1000),
        "1200 x 1200, 30 % holes": rough(1200, 0.7),
        "100 x 100 x 100": (100, 100, 100),
    }
    for name, maker in TOURS_OF.items():
        for title, grid in grids.items():
            dimensions = len(grid) if isinstance(grid, tuple) else grid.ndim
            if dimensions in maker.dimensions:
                seconds = best_seconds(lambda name=name, grid=grid: make_tour(name, grid), repeat=3)
                row(f"{name}, {title}", f"{seconds:.2f} s", "under 1 s", seconds < 1)


TOURS_OF = {name: TOURS.get(name) for name in TOURS}


def rough(side: int, share: float) -> np.ndarray:
    """Return a mask of that share, with holes some ten cells wide."""
    from scipy.ndimage import gaussian_filter

    field = gaussian_filter(np.random.default_rng(0).standard_normal((side, side)), 8)
    return field > np.quantile(field, 1 - share)


def metrics() -> None:
    """Print the table of docs/concepts/tours.md."""
    regions = {
        "64 × 64": (64, 64),
        "65 × 65": (65, 65),
        "64 × 48": (48, 64),
        f"`{CAVE}`": open_map(CAVE).free,
        "16 × 16 × 16": (16,) * 3,
    }
    print(
        "| region | tour | cells | length | closing edge | turns a cell | longest step | stretch |"
        " dilation |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for title, grid in regions.items():
        for name, maker in TOURS_OF.items():
            if (len(grid) if isinstance(grid, tuple) else grid.ndim) in maker.dimensions:
                m = make_tour(name, grid).metrics()
                print(
                    f"| {title} | {name} | {m.cells} | {m.length:.1f} | {m.closing_edge:.1f} |"
                    f" {m.turns_per_cell:.3f} | {m.longest_step:.1f} | {m.neighbour_stretch:.1f} |"
                    f" {m.dilation:.1f} |"
                )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--metrics", action="store_true", help="only the table of metrics")
    began = time.perf_counter()
    if not parser.parse_args().metrics:
        bench_codec()
        bench_tours()
    metrics()
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
