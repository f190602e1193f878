"""Draw the pictures of the documentation: a mapping after a quarter of its moves, its frontier by move, the theory's figures,
and tours.

Run: python docs/make_images.py (pareto.png takes longer: python -m benchmarks.scanning --trials 20 --pareto docs/images/pareto.png)
"""

from __future__ import annotations

import csv
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

from shoal import open_map, run
from shoal.search import make_tour
from shoal.swarm.line import Line, sample
from shoal.swarm.scanning import EveryStep, Hyperexponential, Powers
from shoal.views.figures import frontier_plot, map_figure, save_figure
from shoal.views.theory import coverage_curve, gap_distributions, move_distributions, schedule_ratios, theorem_chart
from shoal.views.tours import tour_figure

FOLDER = Path(__file__).parent / "images"
PUBLISHED = Path(__file__).parents[1] / "tests" / "golden" / "published" / "line-full-coverage-m5000.csv"
MAP, PARTICLES, SEED = "vessels:5000", 300, 1
TRIALS = 1_000_000


def main() -> None:
    episode = run(open_map(MAP), particles=PARTICLES, seed=SEED)
    middle = episode.moves // 4
    save("mapping-middle.png", map_figure(episode, moves=middle))
    save("mapping-frontier.png", frontier_plot([episode]))
    theory()
    tours()


def tours() -> None:
    """Draw tours of a rectangle, of a cave and of a box."""
    save("tour-rectangle.png", tour_figure(make_tour("hilbert-rectangle", (24, 32))))
    save("tour-spanning-tree.png", tour_figure(make_tour("spanning-tree", open_map("cave:64x48:1").free)))
    save("tour-space.png", tour_figure(make_tour("hilbert-rectangle", (6, 8, 10))))


def theory() -> None:
    """Draw the figures of one dimension."""
    save("line-gaps.png", gap_distributions(Line(1000, 10), sample(Line(1000, 10), TRIALS)))
    save("line-moves.png", move_distributions(Line(1000, 100), sample(Line(1000, 100), TRIALS)))
    with PUBLISHED.open() as file:
        published = {int(row["n"]): float(row["mean_moves"]) for row in csv.DictReader(file)}
    save("line-coverage.png", coverage_curve(5000, published))
    save("schedules.png", schedule_ratios([EveryStep(), Powers(2), Powers(4), Hyperexponential()], max_distance=10**100))
    save("theorem.png", theorem_chart([1, 2, 3, 4, 6, 8, 12, 16, 20, 30, 40, 50, 60, 70, 80, 90, 100]))


def save(name: str, figure: Figure) -> None:
    """Write a figure with few colours, so that the file is small."""
    path = FOLDER / name
    save_figure(figure, path)
    Image.open(path).convert("RGB").quantize(32, dither=Image.Dither.NONE).save(path, optimize=True)
    print(path.name, path.stat().st_size // 1024, "KiB")


if __name__ == "__main__":
    main()
