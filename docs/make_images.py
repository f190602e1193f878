"""Draw the pictures of the documentation: a mapping after a quarter of its moves, and its frontier by move.

Run: python docs/make_images.py
"""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

from shoal import open_map, run
from shoal.views.figures import frontier_plot, map_figure, save_figure

FOLDER = Path(__file__).parent / "images"
MAP, PARTICLES, SEED = "vessels:5000", 300, 1


def main() -> None:
    episode = run(open_map(MAP), particles=PARTICLES, seed=SEED)
    middle = episode.moves // 4
    save("mapping-middle.png", map_figure(episode, moves=middle))
    save("mapping-frontier.png", frontier_plot([episode]))


def save(name: str, figure: Figure) -> None:
    """Write a figure with few colours, so that the file is small."""
    path = FOLDER / name
    save_figure(figure, path)
    Image.open(path).convert("RGB").quantize(32, dither=Image.Dither.NONE).save(path, optimize=True)
    print(path.name, path.stat().st_size // 1024, "KiB")


if __name__ == "__main__":
    main()
