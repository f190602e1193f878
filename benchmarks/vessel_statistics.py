"""Statistics of generated vessels, beside those of an eye: branching angles, ratios of widths,
lengths, density, dead ends.

    python -m benchmarks.vessel_statistics [--seeds 20] [--eyes 12] [MASK.png ...]

Prints a Markdown table: for each measure the mean over the networks of a column and their standard
deviation. The photograph is that of scikit-image with the vessels that `find_vessels` finds. The
drawn eyes are those of benchmarks.vessels_from_photographs. Further columns are pictures of your
own, in which bright pixels are vessels.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from skimage import data

from benchmarks.vessels_from_photographs import Eye, Mask
from shoal.swarm.maps.files import read_map
from shoal.swarm.maps.generators import generate
from shoal.swarm.maps.imaging import (
    VesselStatistics,
    find_vessels,
    map_of_vessels,
    vessel_statistics,
)
from shoal.swarm.maps.imaging.segmentation import read_photograph, resize

COUNTS = (1000, 5000, 20_000)
PUBLISHED = {
    "branching_angle": "78",
    "area_ratio": "1.26 to 1.28",
    "exponent": "1.95 to 3",
    "area_density": "0.12",
    "fractal_dimension": "1.7",
}
"""Of healthy human retinas; docs/concepts/vessel-trees.md names the sources."""


def photograph() -> tuple[Mask, Mask]:
    """Return the vessels of scikit-image's photograph of a retina, and its field of view."""
    picture = data.retina()  # type: ignore[no-untyped-call]
    mask = find_vessels(picture).mask
    return mask, resize(read_photograph(picture).view, mask.shape) > 0.5


def columns(
    seeds: int, eyes: int, files: list[Path]
) -> Iterator[tuple[str, list[VesselStatistics]]]:
    """Yield the name of a column and the statistics of its networks."""
    for count in COUNTS:
        yield (
            f"`vessels:{count}`",
            [vessel_statistics(generate(f"vessels:{count}:{seed}")) for seed in range(seeds)],
        )
    mask, view = photograph()
    yield "photograph as a map", [vessel_statistics(map_of_vessels(mask))]
    yield "photograph", [vessel_statistics(mask, view=view)]
    yield (
        "drawn eyes",
        [vessel_statistics(eye.truth, view=eye.view) for eye in map(Eye, range(eyes))],
    )
    for path in files:
        yield path.name, [vessel_statistics(read_map(path).free)]


def entry(values: list[float]) -> str:
    """Return the mean and the standard deviation of a measure as text, with at least two digits."""
    mean = float(np.nanmean(values))
    digits = 0 if mean >= 10 else 1 if mean >= 2 else 2
    return f"{mean:.{digits}f}" + (f" ± {np.nanstd(values):.{digits}f}" if len(values) > 1 else "")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--eyes", type=int, default=12)
    parser.add_argument("files", nargs="*", type=Path)
    options = parser.parse_args()
    named = dict(columns(options.seeds, options.eyes, options.files))
    print("| | " + " | ".join(named) + " | published |")
    print("|---" * (len(named) + 2) + "|")
    told = {
        name: [
            one.summary()
            | {"bifurcations_measured": float(len(one.angles)), "segments": float(len(one.lengths))}
            for one in networks
        ]
        for name, networks in named.items()
    }
    for measure in next(iter(told.values()))[0]:
        cells = [entry([row[measure] for row in rows]) for rows in told.values()]
        print(
            f"| {measure.replace('_', ' ')} | "
            + " | ".join(cells)
            + f" | {PUBLISHED.get(measure, '')} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
