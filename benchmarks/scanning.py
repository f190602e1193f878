"""python -m benchmarks.scanning: what scanning costs on the standard maps, adaptive against a scan
after every move.

With --pareto FILE it also draws the Pareto fronts of moves and scans over all scan rules
(docs/images/pareto.png).
"""

from __future__ import annotations

import argparse
import statistics
from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.transforms import Bbox
from tests.swarm_runs import run_trials

from shoal import open_map
from shoal.swarm import SwarmEpisode
from shoal.views.drawing.charts import (
    BLUE,
    GRID,
    MUTED,
    ORANGE,
    new_figure,
    plain_axes,
    save_figure,
    set_title,
)

MAPS = {
    "line": "line:5000",
    "rectangle": "rectangle:50x100",
    "H-tree": "htree:5000",
    "vessels": "vessels:5000",
}
COUNTS = (100, 1000)
FIXED = ("1", "2", "3", "4", "6", "8", "12", "16", "doubling", "hyper")
SIDES = ((1, 1), (-1, -1), (1, 0), (0, 1), (0, -1), (-1, 0), (1, -1), (-1, 1))  # of a point
SCAN_COSTS = (0.0, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)  # of adaptive rules; a move costs 1


def same_map(one: SwarmEpisode, other: SwarmEpisode) -> bool:
    """Tell whether two episodes found the same cells."""
    found, again = one.final()[1], other.final()[1]
    return found.known == again.known and found.open == again.open


def table(trials: int) -> None:
    """Print costs of both rules at 10 a scan and 1 a move, and their ratio; on the same seeds."""
    print(
        "| map | particles | every move: moves, cost | adaptive: moves, scans, cost | ratio | same"
        " maps | time a trial |"
    )
    print("|---|---|---|---|---|---|---|")
    for name in MAPS.values():
        workspace = open_map(name)
        for n in COUNTS:
            every, adaptive = (
                run_trials(workspace, trials=trials, particles=n, scan_every=rule)
                for rule in ("1", "adaptive")
            )
            costs = [statistics.fmean(e.cost for e in episodes) for episodes in (every, adaptive)]
            same = sum(same_map(a, b) for a, b in zip(every, adaptive, strict=True))
            moves, scans = means(adaptive)
            milliseconds = 1000 * statistics.fmean(e.seconds for e in adaptive)
            print(
                f"| `{name}` | {n} | {means(every)[0]:.0f}, {costs[0]:.0f} | {moves:.0f},"
                f" {scans:.0f}, {costs[1]:.0f} | **{costs[1] / costs[0]:.2f}** | {same} of {trials}"
                f" | {milliseconds:.0f} ms |",
                flush=True,
            )


def means(episodes: list[SwarmEpisode]) -> tuple[float, float]:
    """Return mean moves and scans."""
    return statistics.fmean(e.moves for e in episodes), statistics.fmean(e.scans for e in episodes)


def pareto(trials: int, path: Path) -> None:
    """Draw mean scans against mean moves: fixed rules by name, adaptive rules by their price of a
    scan, and the front of all.
    """
    figure = new_figure(8.4, 11)
    drawn: list[tuple[Axes, Line2D, dict[str, dict[str, tuple[float, float]]]]] = []
    for row, (title, name) in zip(
        figure.subplots(len(MAPS), len(COUNTS)), MAPS.items(), strict=True
    ):
        workspace = open_map(name)
        for axes, n in zip(row, COUNTS, strict=True):
            problem = {"trials": trials, "particles": n}
            fixed = {
                rule: means(run_trials(workspace, **problem, scan_every=rule)) for rule in FIXED
            }
            adaptive = {
                f"{cost:g}": means(
                    run_trials(workspace, **problem, scan_every="adaptive", scan_cost=cost)
                )
                for cost in SCAN_COSTS
            }
            front = pareto_front([*fixed.values(), *adaptive.values()])
            (line,) = axes.step(
                *np.array(front).T, where="post", color=MUTED, lw=0.8, ls="--", label="Pareto front"
            )
            axes.set(xscale="log", yscale="log", xlabel="moves", ylabel="scans")
            for axis in (axes.xaxis, axes.yaxis):
                axis.set_major_formatter("{x:g}")
                axis.set_minor_formatter("")
            axes.margins(0.14)
            set_title(axes, f"{title}, {n} particles")
            plain_axes(axes)
            axes.grid(which="minor", color=GRID, lw=0.4)
            for points, shape, colour, label in (
                (fixed, "o", BLUE, "fixed rules"),
                (adaptive, "s", ORANGE, "adaptive, by price of a scan"),
            ):
                axes.plot(
                    *np.array(list(points.values())).T,
                    shape,
                    color=colour,
                    ms=4,
                    mfc="none",
                    label=label,
                )
            drawn.append((axes, line, {BLUE: fixed, ORANGE: adaptive}))
    figure.legend(
        *axes.get_legend_handles_labels(),
        loc="outside upper right",
        ncols=3,
        fontsize=8,
        frameon=False,
    )
    figure.draw_without_rendering()  # the layout is final: only now is it known where points lie
    figure.set_layout_engine("none")
    for axes, line, points in drawn:
        name_points(axes, line, points)
    save_figure(figure, path)


def name_points(
    axes: Axes, line: Line2D, points: dict[str, dict[str, tuple[float, float]]]
) -> None:
    """Write the names of the points of each colour beside them, where a name covers no point, no
    other name, no axis and no part of the line, and is nearest to its own point. A point whose
    name fits nowhere gets none.
    """
    to_pixels = axes.transData.transform
    marks = to_pixels([point for named in points.values() for point in named.values()])
    radius = 2.5 * axes.figure.dpi / 72  # of a mark, in pixels
    front = to_pixels(np.column_stack(line.get_data()))
    corners = np.column_stack([front[1:, 0], front[:-1, 1]])  # the line goes right, then down
    covered = [Bbox([mark, mark]).padded(radius) for mark in marks]
    for begins, ends in ((front[:-1], corners), (corners, front[1:])):
        covered += [Bbox(pair).padded(1) for pair in zip(begins, ends, strict=True)]
    for colour, named in points.items():
        for name, point in named.items():
            for distance, (right, up) in product((3, 6, 10, 15), SIDES):
                text = axes.annotate(
                    name,
                    point,
                    xytext=(distance * right, distance * up),
                    textcoords="offset points",
                    ha={1: "left", 0: "center", -1: "right"}[right],
                    va={1: "bottom", 0: "center", -1: "top"}[up],
                    fontsize=7,
                    color=colour,
                )
                box = text.get_window_extent().padded(1)
                middle = box.get_points().mean(axis=0)
                nearest = marks[np.hypot(*(marks - middle).T).argmin()]
                if (
                    axes.bbox.containsx(box.x0)
                    and np.allclose(nearest, to_pixels(point))
                    and not box.count_overlaps(covered)
                ):
                    covered.append(box)
                    break
                text.remove()


def pareto_front(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points that no other beats in both, by moves."""
    return [
        p
        for p in sorted(points)
        if not any(q != p and q[0] <= p[0] and q[1] <= p[1] for q in points)
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--pareto", type=Path)
    given = parser.parse_args()
    if given.pareto is None:
        table(given.trials)
    else:
        pareto(given.trials, given.pareto)


if __name__ == "__main__":
    main()
