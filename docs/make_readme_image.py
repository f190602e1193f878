"""Draw the picture of the README: a fundus photograph, and its vessels while 300 particles map
them.

Run: python -m docs.make_readme_image
"""

from __future__ import annotations

import argparse
from itertools import islice
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image
from tests.swarm_runs import run

from shoal import GridWorkspace
from shoal.swarm.maps.imaging import segment_vessels
from shoal.swarm.maps.imaging.samples import retina
from shoal.swarm.maps.workspace import PALETTE

TARGET = Path(__file__).parent / "images" / "retina.png"
MOVES = 60


def picture_of(state, belief):
    return belief.picture(state.occupied)


def main() -> None:
    photograph = retina()
    episode = run(GridWorkspace(segment_vessels(photograph), name="retina"), particles=300)
    middle = picture_of(*next(islice(episode.frames(), MOVES, None)))
    end = picture_of(*episode.final())
    figure = Figure(figsize=(9.6, 3.55), dpi=125, facecolor="white")
    titles = (
        "a photograph of an eye",
        f"after {MOVES} commands",
        f"mapped after {episode.moves} commands",
    )
    for i, (picture, title) in enumerate(zip((photograph, middle, end), titles, strict=True)):
        axes = figure.add_axes((0.005 + i * 0.333, 0.01, 0.325, 0.88))
        axes.imshow(picture, interpolation="antialiased" if i == 0 else "nearest")
        axes.set_axis_off()
        axes.set_title(title, fontsize=10.5, color=PALETTE["obstacle"], pad=5)
    figure.savefig(TARGET)
    Image.open(TARGET).convert("RGB").quantize(128, dither=Image.Dither.NONE).save(
        TARGET, optimize=True
    )
    print(TARGET, TARGET.stat().st_size // 1024, "KiB", np.round(episode.seconds, 3), "s")


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
