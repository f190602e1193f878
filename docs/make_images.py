"""Draw the pictures of the documentation: mapping, the theory's figures, tours, searches, steering
and the figures of paper W.

Run: python -m docs.make_images [mapping] [vessels] [theory] [tours] [searches] [steering], without
a name for all. (pareto.png takes longer: python -m benchmarks.scanning --trials 20 --pareto
docs/images/pareto.png) (learning-curve.png, too: python examples/reinforce_mapping.py --plot
docs/images/learning-curve.png)
"""

from __future__ import annotations

import argparse
import io
import sys
from collections.abc import Mapping, Sequence
from math import pi
from pathlib import Path

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image
from tests.goal_sweeps import sweep_goals
from tests.swarm_runs import run

from shoal import open_map
from shoal.core.errors import InvalidInputError
from shoal.papers.mapping.line import DECADES, simultaneous
from shoal.papers.recipe import published_curve
from shoal.papers.steering.figures import (
    antipode_errors,
    disk_fractions,
    disk_sets,
    fraction_curves,
    goal_maps,
    largest_two_move_fraction,
    polygon_fractions,
    reachable_sets,
    swap_antipodes,
)
from shoal.papers.steering.shortest_paths import DISK_GOALS, DISK_START, SQUARE_CASES
from shoal.search import SearchProblem, make_tour
from shoal.search.allocation.costs import expected_time, stay_share
from shoal.search.problem.network import Crash, Pause
from shoal.search.run import run as run_search
from shoal.steering import (
    SteeringProblem,
    disk,
    open_workspace,
    polygon_reach,
    region,
    regular_polygon,
)
from shoal.steering.run import run as steer
from shoal.swarm.grid.tasks import Inlet
from shoal.swarm.maps.imaging import network as centre_lines
from shoal.swarm.noise import Noise
from shoal.swarm.theory.one_dimension import Line, sample
from shoal.swarm.theory.scan_schedules import EveryStep, Hyperexponential, Powers
from shoal.views.drawing.charts import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    new_figure,
    plain_axes,
    save_figure,
    set_title,
)
from shoal.views.search.figures import routes_figure
from shoal.views.search.timeline import timeline_figure
from shoal.views.search.tour import tour_figure
from shoal.views.steering.figures import plan_figure, reach_figure
from shoal.views.swarm.figures import frontier_figure, map_figure, map_panels
from shoal.views.swarm.theory import (
    gap_distributions,
    move_distributions,
    schedule_ratios,
    simultaneous_ratios,
)

FOLDER = Path(__file__).parent / "images"
MAP, PARTICLES, SEED = "vessels:5000", 300, 1
TRIALS = 1_000_000


def main() -> None:
    parts = {
        "mapping": mapping,
        "gathering": gathering,
        "vessels": vessels,
        "theory": theory,
        "tours": tours,
        "searches": searches,
        "steering": steering,
        "calibration": calibration,
    }
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "parts", nargs="*", metavar="PART", help=f"{', '.join(parts)}; default: all"
    )
    given = parser.parse_args()
    if unknown := set(given.parts) - set(parts):
        parser.error(f"expected {', '.join(parts)}, got {', '.join(sorted(unknown))}")
    for name in given.parts or parts:
        parts[name]()


def mapping() -> None:
    """Draw a map and its frontier."""
    episode = run(open_map(MAP), particles=PARTICLES, seed=SEED)
    middle = episode.moves // 4
    save("mapping-middle.png", map_figure(episode, moves=middle))
    save("mapping-frontier.png", frontier_figure([episode]))
    tree = run(open_map("vessels3d:6000"), particles=600, seed=SEED)
    save("volume.png", map_figure(tree, moves=tree.moves // 4), colours=256)
    hazy = run(
        open_map("vessels:1000"),
        particles=60,
        seed=2,
        noise=Noise(slip=0.1, misplace=0.05),
        confidence=0.8,
    )
    save("noise-map.png", map_figure(hazy, moves=hazy.moves // 3))


def gathering() -> None:
    """Draw a gathering in a region at its start, on the way and at its end."""
    workspace = open_map("vessels:1000")
    inlet = Inlet(tuple(workspace.cells[0].tolist()))
    region = inlet(workspace, 20, np.random.default_rng(0)).tolist()
    about = {"task": "gathering", "region": region, "rule": "merge", "policy": "gather-beam"}
    episode = run(workspace, particles=100, seed=SEED, **about)
    moments = [(episode, move) for move in (0, episode.moves // 3, episode.moves)]
    save("gathering.png", map_panels(moments, columns=3))


def vessels() -> None:
    """Draw the centre lines of generated vessels beside those of an eye."""
    from benchmarks.vessel_statistics import photograph

    maps = {
        "vessels:2000:1": open_map("vessels:2000:1").free,
        "vessels found in a photograph of a retina": photograph()[0],
    }
    save("vessel-trees.png", centre_lines_figure(maps), colours=64)


def calibration() -> None:
    """Calibrate the bench of examples/bench.py, whose camera is turned, sheared and mirrored."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
    from bench import Bench
    from shoal.rigs import Frame, PlantPorts, calibrate, tie_by_map
    from shoal.rigs.cameras import Detector, Vision
    from shoal.views.calibration import calibration_figure

    vessel = open_map("vessels:100")
    bench = Bench(vessel, 8, 0, radius=0.35)
    bench.look(160.0, 0.1, True)
    bench.plant.coil_gains[:] = (0.8, 1.15), (1.2, 0.9)
    vision = Vision(threshold="145", min_area=40)

    class Camera(PlantPorts):
        def observe(self) -> Frame:
            frame = super().observe()
            return Frame(Detector(vision).find(self.picture()), frame.time, frame.number)

        def picture(self) -> NDArray[np.uint8]:
            bench.draw()
            return np.asarray(Image.open(io.BytesIO(bench.picture)).convert("L"))

    camera = Camera(bench.plant)
    tie = tie_by_map(camera.picture(), vessel.free)
    found = calibrate(camera, camera, pulses=camera.pulses, tie=tie, shape=vessel.shape)
    picture, points = camera.picture(), camera.observe().points
    figure = calibration_figure(found, points=points, picture=picture)
    save("calibration.png", figure, colours=64)


def tours() -> None:
    """Draw tours of a rectangle, of a cave and of a box."""
    save("tour-rectangle.png", tour_figure(make_tour("hilbert-rectangle", (24, 32))))
    save(
        "tour-spanning-tree.png",
        tour_figure(make_tour("spanning-tree", open_map("cave:64x48:1").free)),
    )
    save("tour-space.png", tour_figure(make_tour("hilbert-rectangle", (6, 8, 10))))


def searches() -> None:
    """Draw a search in which a robot dies, what each robot did, and the expected time of paper H,
    Fig. 5.
    """
    faults = (Crash(2, 20.0), Pause(3, 5, 40))
    episode = run_search(
        SearchProblem("ring:200x150", robots=6, footprint=10, loss=0.3, faults=faults, targets=5),
        seed=3,
    )
    save("search-ring.png", routes_figure(episode), colours=256)
    box = SearchProblem(
        "box:200x120x30", robots=4, vehicle="multirotor", faults=(Crash(2, 60.0),), targets=3
    )
    save("search-box.png", routes_figure(run_search(box, seed=1)), colours=256)
    save("search-timeline.png", timeline_figure(episode), colours=256)
    save("search-expected-time.png", expected_time_figure())


def theory() -> None:
    """Draw the figures of one dimension."""
    save("line-gaps.png", gap_distributions(Line(1000, 10), sample(Line(1000, 10), TRIALS)))
    save("line-moves.png", move_distributions(Line(1000, 100), sample(Line(1000, 100), TRIALS)))
    curve = published_curve("line-full-coverage-m5000.csv")
    published = dict(zip(curve.x.astype(int).tolist(), curve.mean.tolist(), strict=True))
    save("line-coverage.png", coverage_curve(5000, published))
    save(
        "schedules.png",
        schedule_ratios(
            [EveryStep(), Powers(2), Powers(4), Hyperexponential()], max_distance=10**100
        ),
    )
    save("theorem.png", simultaneous_ratios(DECADES, *simultaneous(DECADES)))


def steering() -> None:
    """Draw a plan, a set that is reached, and the figures of paper W; print what is measured."""
    problem = SteeringProblem(
        open_workspace("square"),
        np.array([(0.2, 0.3), (0.5, 0.35)]),
        np.array([(0.8, 0.2), (0.3, 0.75)]),
    )
    save("steering-plan.png", plan_figure(steer(problem)))
    outline = [(0, 0), (4, 0), (4, 1), (1, 1), (1, 3), (0, 3)]
    corner = SteeringProblem(region(outline), [(0.4, 2.5), (0.6, 2.0)], [(3.5, 0.4), (2.6, 0.8)])
    save("steering-corner.png", plan_figure(steer(corner)), colours=64)
    points = np.array([(-0.1, 0.0), (0.1, 0.1)])
    sets = polygon_reach(open_workspace("hexagon"), points[1] - points[0], moves=6)
    save("steering-reach.png", reach_figure(sets, points=points), colours=64)
    fillings = [polygon_fractions(regular_polygon(n), (0.13, 0.06), moves=8) for n in range(3, 9)]
    save("steering-fig4.png", reachable_sets(fillings), colours=64)
    disk_figures()
    square = open_workspace("square")
    alone, either = (
        [
            sweep_goals(square, start, goal, varied=1, interchangeable=both)
            for start, goal in SQUARE_CASES
        ]
        for both in (False, True)
    )
    rows = [
        [(sweep, "length") for sweep in alone],
        [(sweep, "moves") for sweep in alone],
        [(sweep, "length") for sweep in either],
    ]
    save("steering-fig16.png", goal_maps(rows), colours=256)
    for one, other in zip(alone, either, strict=True):
        longest = [float(np.nanmax(sweep.lengths)) for sweep in (one, other)]
        saved = 100 * (1 - longest[1] / longest[0])
        print(
            f"Fig. 16: longest {longest[0]:.2f}, interchangeable {longest[1]:.2f}, {saved:.0f} %"
            " less",
            end="; ",
        )
        print(f"at most {np.nanmax(one.moves):g} moves, unsolved {one.unsolved}")


def disk_figures() -> None:
    """Draw Figs. 8, 9, 14 and 15."""
    distances = np.concatenate([[0.001], (1 - np.cos(pi * np.arange(1, 65) / 64)) / 2])
    save("steering-fig8.png", fraction_curves(disk_fractions(distances)), colours=128)
    save("steering-fig9.png", disk_sets(), colours=64)
    for row in (100 * disk_fractions([0.1, 0.001]).fractions).round(2).tolist():
        print("Fig. 8: % reached in 2, 4, ... 14 moves:", row)
    print("Fig. 8: most in two moves (distance, fraction):", largest_two_move_fraction())
    sweeps = [sweep_goals(disk(), DISK_START, goal, samples=61) for goal in DISK_GOALS]
    save(
        "steering-fig14.png",
        goal_maps([[(sweep, "moves"), (sweep, "length")] for sweep in sweeps]),
        colours=256,
    )
    for sweep in sweeps:
        print(
            f"Fig. 14: at most {np.nanmax(sweep.moves):g} moves, length"
            f" {np.nanmax(sweep.lengths):.2f}, unsolved {sweep.unsolved}"
        )
    second, nearer, across = (
        swap_antipodes(toucher="second"),
        swap_antipodes(),
        swap_antipodes(turn=pi / 2),
    )
    save(
        "steering-fig15.png",
        antipode_errors(second, nearer, (across, "the nearer touches, Δ at the start across")),
    )
    for name, swap in (
        ("particle 2", second),
        ("the nearer", nearer),
        ("the nearer, across", across),
    ):
        print(f"Fig. 15: {name} touches: within 0.01 at length {swap.length_to(0.01):.2f}")
    print("Fig. 15: a / length^b through what particle 2 does, a and b:", second.law())


def coverage_curve(cells: int, published: Mapping[int, float]) -> Figure:
    """Return mean full coverage against the number of particles: exact, the printed formula, and
    published means.

    Parameters
    ----------
    cells : int
    published : mapping from number of particles to moves
    """
    particles = sorted(published)
    lines = [Line(cells, n) for n in particles]
    data = np.array([published[n] for n in particles])
    exact = np.array([float(line.coverage.exact) for line in lines])
    printed = np.array([float(line.coverage.printed) for line in lines])
    positions = np.array([float(line.published_coverage) for line in lines])
    figure = new_figure(6.8, 5.6)
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    curves = (
        (exact, BLUE, "-", "exact"),
        (printed, ORANGE, "--", "printed formula"),
        (positions, PURPLE, ":", "printed formula, gap as difference of positions"),
    )
    for values, colour, style, name in curves:
        above.plot(particles, values, color=colour, ls=style, lw=1.8, label=name)
        below.plot(particles, values - exact, color=colour, ls=style, lw=1.8)
    above.plot(particles, data, "o", color=INK, ms=3.5, mfc="none", label="published")
    below.plot(particles, data - exact, "o", color=INK, ms=3.5, mfc="none")
    above.set(ylabel="mean moves", yscale="log")
    below.set(xlabel="particles", ylabel="moves more than exact", ylim=(-0.6, 3.2))
    above.legend(frameon=False, fontsize=9)
    set_title(above, f"Full coverage of {cells} cells in a line")
    for axes in (above, below):
        plain_axes(axes)
    return figure


def centre_lines_figure(masks: Mapping[str, NDArray[np.bool_]]) -> Figure:
    """Return vessels side by side with their centre lines, bifurcations, larger junctions and dead
    ends.

    Parameters
    ----------
    masks : mapping from title to ndarray, bool, shape (H, W)
    """
    figure = new_figure(4.6 * len(masks), 4.9)
    kinds = (
        (1, BLUE, "end"),
        (3, ORANGE, "bifurcation"),
        (4, GREEN, "larger junction or crossing"),
    )
    for axes, (title, mask) in zip(
        figure.subplots(1, len(masks), squeeze=False)[0], masks.items(), strict=True
    ):
        axes.imshow(mask, cmap=ListedColormap(["white", "#d5d9de"]), interpolation="nearest")
        lines = centre_lines(mask)
        for one in lines.segments:
            ends = lines.places[list(one.nodes)]
            axes.plot(*np.vstack([ends[:1], one.points, ends[1:]]).T[::-1], color=INK, lw=0.9)
        degrees = np.minimum([len(branches) for branches in lines.branches()], 4)
        for degree, colour, name in kinds:
            axes.plot(
                *lines.places[degrees == degree].T[::-1], "o", color=colour, ms=3.4, label=name
            )
        set_title(axes, title)
        axes.set(anchor="N")
        axes.set_axis_off()
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=len(kinds),
        frameon=False,
        fontsize=9,
        labelcolor=INK,
    )
    return figure


def expected_time_figure(
    *,
    robots: Sequence[int] = (1, 2, 3, 5, 7, 10, 15, 20, 30, 50),
    cells: int = 1024,
    dead: int = 5,
    trials: int = 10_000,
    seed: int = 0,
) -> Figure:
    """Return the expected time of robots that stay where they are against their number, as paper H,
    Fig. 5.

    Marks are Monte Carlo, with two standard errors; lines are theory: H_m/m, the same for those
    that live if ``dead`` of them never start, and the bound 1/m.

    Parameters
    ----------
    robots : sequence of int
        Numbers of robots, one or more.
    cells, trials, seed
        As `shoal.search.allocation.costs.expected_time` takes them.
    dead : int
        0 for no second curve.

    Raises
    ------
    InvalidInputError
    """
    if not len(robots):
        raise InvalidInputError("expected time: expected at least one number of robots, got none")
    figure = new_figure(6.8, 4.2)
    axes = figure.add_subplot()
    numbers = np.arange(1, max(robots) + 1)
    cases = [(0, BLUE, "o", "all live: H$_m$/m")]
    if 0 < dead < max(robots):
        cases.append((dead, ORANGE, "s", f"{dead} dead on arrival: H$_{{m-{dead}}}$/(m-{dead})"))
    for lost, colour, marker, words in cases:
        shown = [count for count in robots if count > lost]
        found = [
            expected_time(cells, count, dead=lost, trials=trials, seed=seed) for count in shown
        ]
        curve = [
            (count, 100 * stay_share(int(count), dead=lost)) for count in numbers if count > lost
        ]
        axes.plot(*np.array(curve).T, color=colour, lw=1.5, label=words)
        axes.errorbar(
            shown,
            [100 * one.mean for one in found],
            [200 * one.error for one in found],
            fmt=marker,
            mfc="white",
            mec=colour,
            ecolor=colour,
            mew=1.5,
            ms=5.5,
            capsize=2.5,
            lw=1.2,
        )
    axes.plot(
        numbers,
        100 / numbers,
        color=MUTED,
        lw=1.3,
        ls=(0, (4, 2)),
        label="no search is faster: 1/m",
    )
    if max(robots) >= 20:
        axes.annotate(
            f"20 robots: {100 * stay_share(20):.1f} %",
            (20, 100 * stay_share(20)),
            xytext=(-4, -15),
            textcoords="offset points",
            fontsize=9,
            color=BLUE,
            ha="center",
        )
    axes.set(
        xlabel="robots m",
        ylabel="T$_E$ as % of one robot's time",
        ylim=(0, 104),
        xlim=(0, max(robots) * 1.02 + 0.5),
    )
    set_title(axes, f"Robots that stay where they are: {cells:,} cells, {trials:,} trials a mark")
    plain_axes(axes)
    axes.legend(frameon=False, fontsize=9, labelcolor=INK)
    return figure


def save(name: str, figure: Figure, *, colours: int = 32) -> None:
    """Write a figure with few colours, so that the file is small; a map whose colours are a scale
    needs 256.
    """
    path = FOLDER / name
    save_figure(figure, path)
    # Between the two, colours furthest apart are kept: a marker must not take on the colour of what
    # is around it.
    method = Image.Quantize.MAXCOVERAGE if 32 < colours < 256 else Image.Quantize.MEDIANCUT
    Image.open(path).convert("RGB").quantize(colours, method=method, dither=Image.Dither.NONE).save(
        path, optimize=True
    )
    print(path.name, path.stat().st_size // 1024, "KiB")


if __name__ == "__main__":
    main()
