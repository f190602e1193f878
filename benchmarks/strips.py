"""Plans of Shoal beside those of a plain strip planner: python -m benchmarks.strips [--prefer rows]

40 seeded regions of many kinds, footprints of 10 to 60 m, 1 and 3 robots. The strip planner divides
the region into equal strips at each of 180 angles, flies the middle of each strip from end to end,
the nearest end next, and keeps the fastest plan; it may leave the region, but flies around zones
and holes. Several robots share its strips by length. "Kept inside" is the same plan with its points
moved into the region and its legs led around corners: it stays inside as Shoal's plans do, but no
longer sees everything. Time is that of the whole search, with the way out and home, at 1 m/s and
with a turn that takes as long as a footprint (``--turn``); a turn is a change of direction of more
than a degree. With --pictures, a picture of each pair is written. With --beside CHECKOUT, the command
`shoal search` plans each region with this code and with that of another checkout of Shoal, and the
turns that both report are compared. With --limits, all tours at all orientations are planned in
full, and the fewest turns are printed that any choice among these plans has at a time.
"""

from __future__ import annotations

import argparse
import heapq
import json
import tempfile
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from scipy.optimize import linear_sum_assignment
from shapely.affinity import rotate, scale, translate

from benchmarks.plans import seconds_of
from benchmarks.timing import ROOT
from benchmarks.turns import own_outlines
from shoal.search import SearchProblem, SearchRegion, coverage_check, plan_search, region_of
from shoal.search.cells.grid import cells_of
from shoal.search.cells.routing import RegionPaths
from shoal.search.flight.timing import turns_of
from shoal.search.planning import orientation
from shoal.search.planning import plan as planning

INNER = 0.005  # metres: so far from the border are points that are moved inside
_METRES = 111_194.9  # per degree at the equator
_LONGEST = 300.0  # seconds of a plan
SHORT = 2.0  # footprints: a shorter leg within a search is counted as short


def kinds() -> dict[str, Any]:
    """Return polygons of 20 kinds, of any size, by name."""
    return own_outlines() | {
        "rectangle": shapely.box(0, 0, 3, 2),
        "square": shapely.box(0, 0, 1, 1),
        "ring": shapely.Point(0, 0).buffer(2).difference(shapely.Point(0, 0).buffer(1.1)),
        "corridor": shapely.LineString([(0, 0), (3, 0.4), (4, 2.5), (7, 3)]).buffer(0.35),
        "T": shapely.union_all([shapely.box(0, 2, 4, 3), shapely.box(1.5, 0, 2.5, 2)]),
        "cross": shapely.union_all([shapely.box(0, 1, 3, 2), shapely.box(1, 0, 2, 3)]),
        "Z": shapely.Polygon(
            [(0, 0), (3, 0), (3, 1.6), (5, 1.6), (5, 2.6), (2, 2.6), (2, 1), (0, 1)]
        ),
        "quarters": shapely.box(0, 0, 4, 3).difference(shapely.box(1.8, 1.2, 2.4, 1.9)),
        "lens": shapely.Point(0, 0).buffer(2).intersection(shapely.Point(1.8, 0).buffer(2)),
        "wedge": shapely.Polygon([(0, 0), (5, 0), (5, 0.6), (0, 2)]),
    }


def outlines(count: int) -> list[tuple[str, Any, float]]:
    """Return names, polygons in metres and footprints."""
    shapes = kinds()
    found = []
    for number in range(count):
        rng = np.random.default_rng(7000 + number)
        name = list(shapes)[number % len(shapes)]
        shape = rotate(shapes[name], float(rng.uniform(0, 180)) if number >= len(shapes) else 0.0)
        shape = scale(shape, 1.0, float(rng.uniform(0.8, 1.25)))
        footprint = float(np.round(rng.uniform(10, 60)))
        cells = float(rng.uniform(120, 700))
        grown = scale(shape, *[(cells * footprint**2 / shape.area) ** 0.5] * 2, origin=(0, 0))
        low = np.array(grown.bounds[:2])
        grown = translate(grown, *-low)
        for _ in range(number % 3 if number % 2 else 0):
            x, y = rng.uniform(0, 1, 2) * np.array(grown.bounds[2:])
            sides = footprint * rng.uniform(1.5, 4, 2)
            zone = rotate(shapely.box(x, y, x + sides[0], y + sides[1]), float(rng.uniform(0, 90)))
            grown = max(shapely.get_parts(grown.difference(zone)), key=lambda part: part.area)
        found.append((f"{number} {name}", grown, footprint))
    return found


class Ways:
    """Shortest ways that avoid the holes of a region, but may leave it."""

    def __init__(self, area: Any) -> None:
        holes = [shapely.Polygon(ring) for ring in area.interiors]
        self.blocked = shapely.union_all(holes).buffer(-0.01) if holes else shapely.Polygon()
        corners = [shapely.get_coordinates(hole.simplify(0.5).buffer(0.02)) for hole in holes]
        self.corners = np.concatenate(corners) if corners else np.zeros((0, 2))
        shapely.prepare(self.blocked)
        self.known: dict[Any, np.ndarray] = {}

    def path(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Return the points of the way between two points, with both."""
        straight = np.stack([start, end])
        if not shapely.intersects(self.blocked, shapely.linestrings(straight)):
            return straight
        key = (*start, *end)
        if key not in self.known:
            self.known[key] = self._around(start, end)
        return self.known[key]

    def _around(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        points = np.vstack([start, end, self.corners])
        best, before, queue = {0: 0.0}, {}, [(0.0, 0)]
        while queue:
            so_far, here = heapq.heappop(queue)
            if here == 1:
                break
            if so_far > best[here]:
                continue
            lines = shapely.linestrings(
                np.stack([np.broadcast_to(points[here], points.shape), points], axis=1)
            )
            free = ~shapely.intersects(self.blocked, lines)
            for there in np.flatnonzero(free).tolist():
                far = so_far + float(np.hypot(*(points[there] - points[here])))
                if far < best.get(there, np.inf) - 1e-9:
                    best[there], before[there] = far, here
                    heapq.heappush(queue, (far, there))
        if 1 not in before:  # an end lies within a zone
            return np.stack([start, end])
        way = [1]
        while way[-1]:
            way.append(before[way[-1]])
        return points[way[::-1]]


def strips_at(area: Any, size: float, angle: float) -> np.ndarray:
    """Return the middle lines of the strips at an angle; shape (n, 2, 2)."""
    flat = rotate(area, -angle, origin=(0, 0))
    left, low, right, high = flat.bounds
    count = max(1, int(np.ceil((high - low) / size - 1e-9)))
    edges = low + (high - low) / 2 + size * (np.arange(count + 1) - count / 2)
    bands = shapely.box(left - 1, edges[:-1], right + 1, edges[1:])
    parts, band = shapely.get_parts(shapely.intersection(flat, bands), return_index=True)
    kept = shapely.area(parts) > 1e-6 * size**2
    bounds, band = shapely.bounds(parts[kept]), band[kept]
    middle, long = (bounds[:, 0] + bounds[:, 2]) / 2, bounds[:, 2] - bounds[:, 0]
    half = np.maximum(long - size, 0.0) / 2 + 1e-6
    y = (edges[:-1] + edges[1:])[band] / 2
    lines = np.stack(
        [np.stack([middle - half, y], axis=1), np.stack([middle + half, y], axis=1)], axis=1
    )
    turn = np.radians(angle)
    matrix = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return np.asarray(lines @ matrix)


def least_turns(area: Any, size: float) -> int:
    """Return two turns for each strip at the angle with the fewest strips: what strips of one angle
    need at least, if no border is slanted to them.
    """
    return 2 * min(len(strips_at(area, size, angle)) for angle in range(180))


def in_turn(lines: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return the lines in the order of the nearest end, from a point."""
    rest, here, order = list(range(len(lines))), start, []
    while rest:
        far = np.hypot(*np.moveaxis(lines[rest] - here, -1, 0))
        row, end = np.unravel_index(int(far.argmin()), far.shape)
        line = lines[rest.pop(int(row))]
        order.append(line if end == 0 else line[::-1])
        here = order[-1][1]
    return np.array(order)


def path(order: np.ndarray, home: np.ndarray, ways: Ways) -> np.ndarray:
    """Return the way from home along lines and back."""
    stops = np.vstack([home[None], order.reshape(-1, 2), home[None]])
    pieces = [ways.path(a, b)[:-1] for a, b in pairwise(stops)]
    return np.vstack([*pieces, stops[-1:]])


def cost(way: np.ndarray, turn: float) -> float:
    """Return the time of a way at 1 m/s."""
    return float(np.hypot(*np.diff(way, axis=0).T).sum()) + turn * int(turns_of(way, 0.01).sum())


def strip_plan(area: Any, size: float, homes: np.ndarray, turn: float) -> list[np.ndarray]:
    """Return the ways of the robots in the fastest plan."""
    ways, best, found = Ways(area), np.inf, []
    ranked: list[tuple[float, int, np.ndarray]] = []
    for angle in range(180):
        lines = strips_at(area, size, angle)
        for start in (homes[0], lines[0, 0], lines[0, 1], lines[-1, 0], lines[-1, 1]):
            order = in_turn(lines, start)
            plain = np.vstack([homes[:1], order.reshape(-1, 2), homes[:1]])
            ranked.append((cost(plain, turn), len(ranked), order))
    for _, _, order in sorted(ranked, key=lambda one: one[:2])[:12]:
        for rows in (order, order[::-1, ::-1]):
            plan = shared(rows, homes, ways, turn)
            latest = max(cost(way, turn) for way in plan)
            if latest < best:
                best, found = latest, plan
    return found


def shared(order: np.ndarray, homes: np.ndarray, ways: Ways, turn: float) -> list[np.ndarray]:
    """Return the ways of robots that share lines by their lengths."""
    robots = len(homes)
    if robots == 1:
        return [path(order, homes[0], ways)]
    work = np.hypot(*(order[:, 1] - order[:, 0]).T) + 2 * turn
    borders = np.searchsorted(np.cumsum(work), work.sum() * np.arange(1, robots) / robots)
    parts = [part for part in np.split(order, borders) if len(part)]
    costs = [[cost(path(part, home, ways), turn) for part in parts] for home in homes]
    robot, part = linear_sum_assignment(costs)
    return [path(parts[p], homes[r], ways) for r, p in zip(robot, part, strict=True)]


def kept_inside(way: np.ndarray, region: SearchRegion, size: float) -> np.ndarray:
    """Return a way with its points moved into the region and its legs led around corners."""
    inner = region.area.buffer(-INNER)
    points = shapely.get_coordinates(shapely.shortest_line(inner, shapely.points(way)))[::2]
    return RegionPaths(cells_of(region, size)).legs(points).points


def short_legs(way: np.ndarray, size: float) -> int:
    """Return the number of legs between two turns that are shorter than two footprints, but longer
    than the step from row to row.
    """
    corners = np.concatenate([[0], 1 + np.flatnonzero(turns_of(way, 0.01)), [len(way) - 1]])
    long = np.hypot(*np.diff(way[corners], axis=0).T)
    return int((long < SHORT * size).sum())


def starts_in(area: Any, robots: int) -> list[tuple[float, float]]:
    """Return random places in an area, which are the same whatever the plan."""
    rng, (low, high) = np.random.default_rng(robots), np.reshape(area.bounds, (2, 2))
    points = rng.uniform(low, high, (1000, 2))
    inside = points[shapely.contains_xy(area.buffer(-INNER), points)]
    return [(x, y) for x, y in inside[:robots].tolist()]


def problem_of(name: str, area: Any, size: float, robots: int, **fields: Any) -> SearchProblem:
    """Return the search of an area from random places in it."""
    return SearchProblem(
        region_of(area, name=name),
        robots=robots,
        footprint=size,
        angle="auto",
        vehicle="ideal",
        starts=starts_in(area, robots),
        **fields,
    )


def ways_of(plan: planning.SearchPlan) -> list[np.ndarray]:
    """Return the ways of all robots that have work, from their starts and back."""
    ways = []
    for robot in range(len(plan.places)):
        stops = plan.stops(robot)
        if len(stops):
            route = plan.route(robot, stops).points
            ways.append(np.vstack([route, plan.leg(route[-1], plan.places[robot])[1:]]))
    return ways


def figures_of(ways: Sequence[np.ndarray], turn: float) -> tuple[float, int]:
    """Return the time of the last robot and the turns of all."""
    turns = sum(int(turns_of(way, 0.01).sum()) for way in ways)
    return max(cost(way, turn) for way in ways), turns


def print_limits(options: argparse.Namespace) -> None:
    """Print the fewest turns that any choice among the plans of all tours at all orientations has,
    beside those of the strip planner, at some times.
    """
    orientation._TRIED = planning._PLANNED = 10**9
    orientation._WORK = 10**9
    found: list[np.ndarray] = []
    teams = []
    for name, area, size in outlines(options.regions)[options.first :]:
        for robots in (int(word) for word in options.robots.split(",")):
            problem, turn = problem_of(name, area, size, robots), options.turn * size
            plans = planning.plans_along(problem, 1)
            figures = np.array([figures_of(ways_of(plan), turn) for plan in plans])
            their = figures_of(strip_plan(area, size, plans[0].places, turn), turn)
            found.append(np.log(figures / their))
            teams.append(robots)
            fastest, fewest = np.exp(found[-1].min(axis=0))
            print(
                f"{name}, {robots} robots: {len(plans)} plans, at least {fastest:.3f} times the"
                f" time and {fewest:.3f} times the turns",
                flush=True,
            )
    for team in (*sorted(set(teams)), None):
        chosen = [one for one, robots in zip(found, teams, strict=True) if team in (robots, None)]
        for time in (0.95, 0.97, 1.0, np.inf):
            turns = np.exp(least_log_turns(chosen, np.log(time)))
            who = "all" if team is None else f"{team} robots"
            print(f"{who}: at {time:.2f} times the time, at least {turns:.3f} times the turns")


def least_log_turns(plans: Sequence[np.ndarray], log_time: float) -> float:
    """Return a lower bound on the mean logarithm of the turns of one plan of each search, if the
    mean logarithm of their times is at most ``log_time``: the dual of the choice, best over prices.

    Each element of ``plans`` has the logarithms of time and turns; shape (n, 2).
    """
    prices = [0.0] if np.isinf(log_time) else np.linspace(0, 20, 401).tolist()
    return max(
        float(np.mean([(one[:, 1] + price * one[:, 0]).min() for one in plans]))
        - (price * log_time if price else 0.0)
        for price in prices
    )


def compare(
    name: str, area: Any, size: float, robots: int, turn: float, **fields: Any
) -> tuple[Any, list[np.ndarray], list[np.ndarray], SearchRegion]:
    """Return times, turns and lengths of both plans, their ways, and the region."""
    problem = problem_of(name, area, size, robots, **fields)
    plan = plan_search(problem, seed=1)
    ours, region = ways_of(plan), problem.place
    theirs = strip_plan(area, size, plan.places, turn * size)
    seen = coverage_check(region, ours, size, angle=plan.grid.angle)
    figures = [
        (
            max(cost(way, turn * size) for way in ways),
            sum(int(turns_of(way, 0.01).sum()) for way in ways),
            sum(float(np.hypot(*np.diff(way, axis=0).T).sum()) for way in ways),
            sum(short_legs(way, size) for way in ways),
        )
        for ways in (ours, theirs, [kept_inside(way, region, size) for way in theirs])
    ]
    return (figures, seen.covered_fraction, seen.outside_m, plan), ours, theirs, region


def reported_turns(checkout: Path, area: Any, size: float, robots: int, more: Sequence[str]) -> int:
    """Return the turns of all routes that the command reports with the code of a checkout."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "region.geojson"
        on_earth = shapely.transform(area, lambda xy: xy / _METRES)
        file.write_text(shapely.to_geojson(on_earth), encoding="utf-8")
        given = ["-m", "shoal", "search", str(file), "--robots", str(robots)]
        given += ["--footprint", str(size), "--vehicle", "ideal", "--angle", "auto", *more]
        given += ["--tour", "auto", "--seed", "1", "--json"]
        _, told = seconds_of(given, folder, checkout, _LONGEST)
    return sum(route["turns"] for route in json.loads(told)["routes"])


def compare_checkouts(options: argparse.Namespace) -> None:
    """Print the turns of this checkout and of another one."""
    more = [] if options.prefer is None else ["--prefer", options.prefer]
    print("| region | robots | turns | turns there |\n|---|---|---|---|")
    ratios: dict[int, list[float]] = {}
    for name, area, size in outlines(options.regions)[options.first :]:
        for robots in (int(word) for word in options.robots.split(",")):
            ours = reported_turns(ROOT, area, size, robots, more)
            theirs = reported_turns(options.beside.resolve(), area, size, robots, [])
            ratios.setdefault(robots, []).append(ours / theirs)
            print(f"| {name} | {robots} | {ours} | {theirs} |", flush=True)
    for robots, found in ratios.items():
        print(f"geometric mean, {robots} robots: {np.exp(np.log(found).mean()):.3f}")


def draw(
    place: Path, region: SearchRegion, plans: Sequence[list[np.ndarray]], titles: Sequence[str]
) -> None:
    """Write a picture of two plans side by side."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(15, 7))
    for axis, ways, title in zip(axes, plans, titles, strict=True):
        for part in region.parts:
            for ring in (part.exterior, *part.interiors):
                axis.fill(*np.asarray(ring.coords).T, facecolor="none", edgecolor="0.5")
        for way in ways:
            axis.plot(*way.T, lw=1.2)
            axis.plot(*way[:1].T, "o")
        axis.set_aspect("equal")
        axis.set_title(title, fontsize=9)
    figure.tight_layout()
    figure.savefig(place, dpi=60)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--regions", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--robots", default="1,3")
    parser.add_argument("--prefer")
    parser.add_argument("--turn", type=float, default=1.0, help="time of a turn, in footprints")
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--beside", type=Path, help="another checkout of Shoal")
    parser.add_argument("--limits", action="store_true")
    options = parser.parse_args()
    if options.beside is not None:
        compare_checkouts(options)
        return
    if options.limits:
        print_limits(options)
        return
    fields = {} if options.prefer is None else {"prefer": options.prefer}
    print(
        "| region | robots | tour | grid | time | turns | of strips | two a strip | length | kept"
        " inside: time | turns | short legs | seen |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|---|---|")
    found_ratios, of_least, of_inside = [], [], []
    for name, area, size in outlines(options.regions)[options.first :]:
        for robots in (int(word) for word in options.robots.split(",")):
            found, ours, theirs, region = compare(name, area, size, robots, options.turn, **fields)
            (our, their, inner), seen, outside, plan = found
            ratio = np.array(our[:3]) / np.array(their[:3])
            found_ratios.append(ratio)
            of_inside.append(np.array(our[:3]) / np.array(inner[:3]))
            least = least_turns(area, size)
            of_least.append([our[1] / least, their[1] / least])
            print(
                f"| {name} | {robots} | {plan.tour.name} | {plan.grid.angle:.1f} | {ratio[0]:.3f} |"
                f" {our[1]} | {their[1]} | {least} | {ratio[2]:.3f} |"
                f" {of_inside[-1][0]:.3f} | {inner[1]} | {our[3]}, {their[3]} |"
                f" {100 * seen:.4f} %, {outside:.1f} m outside |",
                flush=True,
            )
            if options.pictures:
                options.pictures.mkdir(parents=True, exist_ok=True)
                titles = [f"{name}: {one[0]:.0f} s, {one[1]} turns" for one in (our, their)]
                draw(options.pictures / f"{name}-{robots}.png", region, [ours, theirs], titles)
    ratios = np.array(found_ratios)
    mean = np.exp(np.log(ratios).mean(axis=0))
    print(
        f"\ngeometric means: {mean[0]:.3f} times the time (worst {ratios[:, 0].max():.3f}),"
        f" {mean[1]:.3f} times the turns (worst {ratios[:, 1].max():.3f}), {mean[2]:.3f} times the"
        " length"
    )
    own, strips = np.exp(np.log(of_least).mean(axis=0))
    time, turns, length = np.exp(np.log(of_inside).mean(axis=0))
    print(
        f"beside the strip planner kept inside: {time:.3f} times the time, {turns:.3f} times the"
        f" turns, {length:.3f} times the length"
    )
    print(f"turns beside two a strip: {own:.3f} times, of the strip planner {strips:.3f} times")


if __name__ == "__main__":
    main()
