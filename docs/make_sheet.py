"""Draw the two sheets of docs/gallery.md: twenty figures as wide as a column of a journal, and four
moments of each of six films.

Run: python docs/make_sheet.py; some seconds. The sheets are written to docs/images/gallery.
"""

from __future__ import annotations

import argparse
import io
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image
from shapely import Polygon

import shoal
from shoal.search import make_tour, region_of
from shoal.steering import region
from shoal.swarm.maps.imaging.samples import retina
from shoal.swarm.theory.one_dimension import Line, sample
from shoal.swarm.theory.scan_schedules import EveryStep, Hyperexponential, Powers
from shoal.views import search, steering, swarm
from shoal.views.drawing.charts import check_layout, printed
from shoal.views.drawing.stage import Stage
from shoal.views.search.tour import tour_figure
from shoal.views.swarm.theory import gap_distributions, schedule_ratios

FOLDER = Path(__file__).parent / "images" / "gallery"
WIDTH = 85.0  # millimetres: a column of a journal
DPI = 110.0
COLUMNS = 5
GAP = 24  # pixels
MOMENTS = 4  # of each film
FIELD = [(0, 0), (170, 60), (150, 120), (70, 95), (55, 140), (-20, 110)]
HOLES = [
    [(1, 1), (2, 1), (2, 2), (1, 2)],
    [(2.7, 0.6), (3.3, 0.6), (3.3, 1.8), (2.7, 1.8)],
]


def swarms() -> Iterator[Figure]:
    """Yield figures of swarms."""
    vessels = shoal.run("vessels:2000", particles=150, policy="closest-frontier", seed=3)
    early = vessels.moves // 4
    yield shoal.figure(vessels, width=WIDTH, moves=early)
    yield shoal.figure(vessels, width=WIDTH, moves=[early // 2, early, vessels.moves])
    trials = [
        shoal.run("vessels:1000", particles=100, policy="closest-frontier", seed=seed)
        for seed in range(10)
    ]
    yield shoal.figure(trials, kind="frontier", width=WIDTH)
    cave = shoal.run("cave:50x36", task="coverage", subset=0.1, particles=12, seed=1)
    yield shoal.figure(cave, width=WIDTH, moves=cave.moves // 3)
    tree = shoal.run("vessels3d:2000", particles=200, policy="closest-frontier", seed=1)
    yield shoal.figure(tree, width=WIDTH, moves=tree.moves // 4)
    noisy = shoal.run("vessels:500", particles=40, slip=0.1, misplace=0.05, seed=2)
    yield shoal.figure(noisy, width=WIDTH, moves=noisy.moves // 3)
    gathering = shoal.run("maze:11x9", task="gathering", particles=20, seed=1)
    yield shoal.figure(gathering, width=WIDTH, moves=8)
    line = shoal.run("line:400", particles=5, policy="closest-frontier", seed=1)
    yield shoal.figure(line, width=WIDTH, moves=line.moves // 2)


def plans() -> Iterator[Figure]:
    """Yield figures of steering."""
    square = {"start": [(0.63, 0.85), (0.27, 0.6)], "goal": [(0.34, 0.69), (0.68, 0.27)]}
    yield shoal.figure(shoal.run("square", **square), width=WIDTH)
    place = region([(0, 0), (4, 0), (4, 3), (0, 3)], HOLES)
    apart = {"start": [(0.5, 0.5), (0.5, 2.5)], "goal": [(3.6, 2.5), (2.4, 1.5)]}
    yield shoal.figure(shoal.run(place, **apart), width=WIDTH)
    yield shoal.figure(opposite("disk"), width=WIDTH)
    cylinder = {"type": "cylinder", "radius": 0.5, "height": 1}
    high = {
        "start": [(0.1, 0, 0.2), (-0.2, 0.1, 0.4)],
        "goal": [(-0.2, -0.1, 0.7), (0.2, 0.2, 0.3)],
    }
    yield shoal.figure(shoal.run(cylinder, planner="greedy", **high), width=WIDTH)


def opposite(workspace: str) -> Any:
    """Return an episode of two particles whose goals are nearly opposite."""
    points = {"start": [(-0.2, 0.1), (0.2, -0.1)], "goal": [(0.42, 0.1), (-0.42, -0.1)]}
    return shoal.run(workspace, planner="greedy", **points)


def crashing(**more: Any) -> Any:
    """Return a search in which a robot crashes."""
    given = {"robots": 6, "footprint": 10, "loss": 0.3, "faults": ["crash:2@20"], "seed": 3}
    return shoal.run("ring:200x150", **given, **more)


def searches() -> Iterator[Figure]:
    """Yield figures of searches."""
    fleet = crashing(targets=5)
    yield shoal.figure(fleet, width=WIDTH)
    yield shoal.figure(fleet, width=WIDTH, seconds=float(fleet.clock(60.0)))
    yield shoal.figure(fleet, kind="timeline", width=WIDTH)
    field = region_of(Polygon(FIELD), name="field")
    rows = shoal.run(field, robots=3, footprint=10, angle="auto", seed=2)
    yield shoal.figure(rows, width=WIDTH)
    prior = ["ring:60,60:0.5=40"]
    likely = shoal.run("square:200", robots=4, footprint=10, prior=prior, seed=1)
    yield shoal.figure(likely, kind="success", width=WIDTH)


def theory() -> Iterator[Figure]:
    """Yield figures of tours and of the theory."""
    line, schedules = Line(1000, 10), [EveryStep(), Powers(2), Powers(4), Hyperexponential()]
    for draw in (
        lambda: tour_figure(make_tour("spanning-tree", shoal.open_map("cave:40x30:1").free)),
        lambda: gap_distributions(line, sample(line, 100_000)),
        lambda: schedule_ratios(schedules, max_distance=10**40),
    ):
        yield in_print(draw)


def in_print(draw: Callable[[], Figure]) -> Figure:
    """Return a figure that is no episode's, for print; one that does not fit is refused."""
    with printed(WIDTH, None), check_layout("of the theory") as figures:
        figures.append(draw())
    return figures[0]


def picture_of(figure: Figure) -> Image.Image:
    """Return a figure as it is saved."""
    written = io.BytesIO()
    figure.savefig(written, dpi=DPI)
    return Image.open(written).convert("RGB")


def films() -> Iterator[list[Image.Image]]:
    """Yield some moments of each of six films."""
    with TemporaryDirectory() as folder:
        photograph = Path(folder) / "eye.png"
        Image.fromarray(retina()).resize((500, 500)).save(photograph)
        yield from films_of(str(photograph))


def films_of(photograph: str) -> Iterator[list[Image.Image]]:
    """Yield the films; the first is of a swarm in a photograph."""
    eye = shoal.run(photograph, vessels=True, particles=300, policy="closest-frontier", seed=1)
    maze = shoal.run("maze:11x9", particles=4, policy="closest-frontier", seed=2)
    wide, square = Stage("wide", 30), Stage("square", 30)
    for views, episode, stage in (
        (swarm, eye, wide),
        (swarm, maze, square),
        (steering, opposite("disk"), wide),
        (steering, opposite("heptagon"), square),
        (search, crashing(), wide),
        (search, shoal.run("circle:60", robots=4, footprint=10, seed=1), square),
    ):
        clip = views.films.clip_of(episode, ".mp4", stage)
        # the end card lasts for many moments, which are equal
        told = [k for k, moment in enumerate(clip.moments) if moment != clip.moments[-1]]
        chosen = [told[k] for k in np.linspace(0, len(told) - 1, MOMENTS).astype(int)[1:]]
        chosen = [clip.moments[k] for k in [*chosen, -1]]
        yield [Image.fromarray(frame.copy()) for frame in clip.frames(chosen)]


def write_figures() -> None:
    """Lay the figures out in columns, each below the shortest one."""
    pictures = [picture_of(one) for kind in (swarms, plans, searches, theory) for one in kind()]
    assert len(pictures) == 20, len(pictures)
    wide, ends, places = pictures[0].width + GAP, [GAP] * COLUMNS, []
    for picture in pictures:
        column = ends.index(min(ends))
        places.append((GAP + column * wide, ends[column]))
        ends[column] += picture.height + GAP
    sheet = Image.new("RGB", (GAP + COLUMNS * wide, max(ends)), "#c9cdd3")
    for picture, place in zip(pictures, places, strict=True):
        sheet.paste(picture, place)
    write(sheet, "sheet.png")


def write_films() -> None:
    """Lay the moments of each film out in a row."""
    high, rows = 216, list(films())
    small = [
        [one.resize((round(one.width * high / one.height), high)) for one in row] for row in rows
    ]
    width = GAP + max(sum(one.width + GAP for one in row) for row in small)
    sheet = Image.new("RGB", (width, GAP + len(small) * (high + GAP)), "#c9cdd3")
    for k, row in enumerate(small):
        left = GAP
        for one in row:
            sheet.paste(one, (left, GAP + k * (high + GAP)))
            left += one.width + GAP
    write(sheet, "films.png")


def write(sheet: Image.Image, name: str) -> None:
    """Write a sheet, and say how large its file is."""
    sheet.save(FOLDER / name, optimize=True)
    print(name, sheet.size, (FOLDER / name).stat().st_size)


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    write_figures()
    write_films()
