"""What plans cost: python -m benchmarks.plans [CASE…] [--beside CHECKOUT] [--pairs N] [--parts]

CPU seconds (user and system, with all child processes) of one plan in a fresh process, the start of
Python included, with a warm cache of kernels and with Python's cache of bytecode, as after an
installation. With --beside, each case also runs with the code of another checkout of Shoal, such as
that of the commit before, in turn with its own. The fewest of the seconds of some runs count, and
the machine's load is printed. With --parts, only what the first case cannot do without is measured.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.timing import ROOT

_SHORT = 10.0  # CPU seconds of cases that run again
_METRES = 111_194.9  # per degree of latitude, and of longitude at the equator


@dataclass(frozen=True)
class Case:
    """One command, its aim in CPU seconds (0 if it is there to be compared), and its region."""

    aim: float
    arguments: tuple[str, ...]
    region: Callable[[], list[np.ndarray]] | str
    zones: Callable[[], list[np.ndarray]] | None = None


def rectangle(width: float, height: float) -> list[np.ndarray]:
    return [np.array([(0, 0), (width, 0), (width, height), (0, height)], dtype=np.float64)]


def field() -> list[np.ndarray]:
    """A field of 20 ha with five corners."""
    corners = np.array([(0, 0), (520, 40), (560, 330), (300, 470), (-30, 400)], dtype=np.float64)
    x, y = corners.T
    area = abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2
    return [corners * np.sqrt(200_000 / area)]


def lake(cells: int, corners: int) -> list[np.ndarray]:
    """A round lake with bays of all lengths, of about so many cells of 10 m."""
    rng = np.random.default_rng(corners)
    angles = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    radii = np.ones(corners)
    for wave in (2, 3, 5, 8, 13, 21, 34, 55, 89):
        radii += 0.25 / wave * np.sin(wave * angles + rng.uniform(0, 2 * np.pi))
    radii *= 1 + rng.uniform(-0.5, 0.5, corners) * np.pi / corners
    radius = 10 * np.sqrt(cells / np.pi)
    return [radius * radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])]


def zones(count: int) -> list[np.ndarray]:
    """No-go zones of eight corners in a square, one in each 40 m by 40 m, at random places."""
    rng = np.random.default_rng(count)
    side = int(np.ceil(np.sqrt(count)))
    angles = np.arange(8) * np.pi / 4
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    found = []
    for k in range(count):
        radius = rng.uniform(2, 8)
        middle = 40 * np.array(divmod(k, side)) + rng.uniform(radius + 1, 39 - radius, 2)
        found.append(middle + radius * ring)
    return found


def among_zones(count: int, *more: str) -> Case:
    side = 40.0 * np.ceil(np.sqrt(count))
    arguments = ("--robots", "6", "--footprint", "20", "--no-simulate", *more)
    return Case(10.0, arguments, lambda: rectangle(side, side), zones=lambda: zones(count))


def plan(robots: int, *more: str) -> tuple[str, ...]:
    return ("--robots", str(robots), "--footprint", "10", "--no-simulate", *more)


def flown(robots: int, formats: str) -> tuple[str, ...]:
    return plan(robots, "--missions", "MISSIONS", *(("--format", formats) if formats else ()))


SIMULATED = ("--robots", "10", "--footprint", "10", "--simulate")

LIKELY = ("--prior", "ring:150,250:0.25=40,0.5=80,0.95=160", "--at-most", "1.25")
SQUARE = ("--robots", "4", "--footprint", "10", "--starts", "random")

CASES = {
    "field-missions": Case(
        0.7,
        ("--robots", "3", "--footprint", "20", "--missions", "MISSIONS"),
        field,
    ),
    "field-wings": Case(
        0.0,
        ("--robots", "2", "--footprint", "30", "--vehicle", "fixed-wing", "--missions", "MISSIONS"),
        field,
        zones=lambda: [
            rectangle(60, 40)[0] + place for place in ((120, 100), (330, 220), (180, 290))
        ],
    ),
    "cells-3e3": Case(0.8, plan(6), lambda: lake(3_000, 100)),
    "cells-3e3-flown": Case(0.8, plan(6, "--vehicle", "multirotor"), lambda: lake(3_000, 100)),
    "cells-1e5": Case(2.0, plan(6), lambda: lake(100_000, 100)),
    "cells-1e6": Case(10.0, plan(1000), lambda: rectangle(10_000, 10_000)),
    "corners-1e4": Case(2.0, plan(6), lambda: lake(3_000, 10_000)),
    "corners-1e5": Case(10.0, plan(6), lambda: lake(3_000, 100_000)),
    "zones-1e3": among_zones(1_000),
    "zones-1e3-flown": among_zones(1_000, "--vehicle", "multirotor"),
    "zones-1e4": among_zones(10_000),
    "simulated-1e5": Case(10.0, SIMULATED, lambda: lake(100_000, 100)),
    "square": Case(0.0, SQUARE, "square:400"),
    "square-prior": Case(0.0, (*SQUARE, *LIKELY), "square:400"),
    "square-planned": Case(0.0, (*SQUARE, "--no-simulate"), "square:400"),
    "square-prior-planned": Case(0.0, (*SQUARE, *LIKELY, "--no-simulate"), "square:400"),
    "missions-10": Case(3.0, flown(10, ""), lambda: lake(3_000, 100)),
    "missions-50": Case(10.0, flown(50, "plan"), lambda: lake(3_000, 100)),
}


PARTS = {
    "Python": "",
    "NumPy, Shapely, pyproj": "import numpy, shapely, pyproj",
    "Typer, llvmlite, Pydantic": "import typer, llvmlite.binding, pydantic",
    "Shoal's modules": (
        "import shoal.cli.search.searching, shoal.missions.mission_set, shoal.search.run\n"
        "import shoal.missions.formats.plan_form"
    ),
    "Matplotlib": "from shoal.cli.output import import_matplotlib; import_matplotlib()",
    "an empty picture as large as the map": (
        "import shoal.views.search.missions as views; figure = views.new_figure(7.4, 7.1);"
        " figure.add_subplot(); views.save_figure(figure, 'empty.png')"
    ),
}
"""What a command with missions needs, whatever the plan: each runs after those before it."""


def parts(repeat: int) -> None:
    """Print the CPU seconds of each of `PARTS`: how much longer than those before it a process
    takes that also runs it, each the fewest of several.
    """
    texts = ["\n".join([*PARTS.values()][: k + 1]) for k in range(len(PARTS))]
    fewest = [np.inf] * len(texts)
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(repeat):
            for k, text in enumerate(texts):
                fewest[k] = min(fewest[k], seconds_of(["-c", text], folder, ROOT, 60.0)[0])
    for name, used in zip(PARTS, np.diff(fewest, prepend=0.0), strict=True):
        print(f"{name:<40} {used:>6.3f} s")
    print(f"{'together':<40} {fewest[-1]:>6.3f} s", flush=True)


def write(polygons: list[np.ndarray], to: Path) -> None:
    """Write polygons in metres as GeoJSON in degrees, so that Shoal chooses the angle of rows."""
    rings = [(ring / _METRES).round(9).tolist() for ring in polygons]
    shapes = [{"type": "Polygon", "coordinates": [[*ring, ring[0]]]} for ring in rings]
    features = [{"type": "Feature", "properties": {}, "geometry": shape} for shape in shapes]
    to.write_text(json.dumps({"type": "FeatureCollection", "features": features}))


def measure(case: Case, checkout: Path, limit: float) -> tuple[float, dict[str, object]]:
    """Return the CPU seconds of a case with the code of a checkout, and what it printed."""
    with tempfile.TemporaryDirectory() as folder:
        at = Path(folder)
        region = case.region if isinstance(case.region, str) else str(at / "region.geojson")
        if not isinstance(case.region, str):
            write(case.region(), Path(region))
        arguments = ["search", region, *case.arguments, "--json"]
        if case.zones is not None:
            write(case.zones(), at / "zones.geojson")
            arguments += ["--no-go", str(at / "zones.geojson")]
        arguments = [str(at / "missions") if one == "MISSIONS" else one for one in arguments]
        used, printed = seconds_of(["-m", "shoal", *arguments], folder, checkout, limit)
    return used, json.loads(printed)


def seconds_of(
    arguments: list[str], folder: str, checkout: Path, limit: float
) -> tuple[float, str]:
    """Return the CPU seconds of a Python process in a folder, with the code of a checkout, and what
    it printed.
    """
    environment = os.environ | {"PYTHONPATH": str(checkout / "src")}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=limit,
        check=False,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise SystemExit(done.stderr or done.stdout)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, done.stdout


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "cases", nargs="*", choices=[*CASES, []], metavar="CASE", help=f"one of {', '.join(CASES)}"
    )
    parser.add_argument("--beside", type=Path, help="another checkout of Shoal")
    parser.add_argument("--limit", type=float, default=300.0, help="longest wall time of a case, s")
    parser.add_argument("--pairs", type=int, default=2, help="number of runs of quick cases")
    parser.add_argument("--parts", action="store_true", help="measure what no plan can do without")
    options = parser.parse_args()
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    if options.parts:
        parts(options.pairs)
        return
    checkouts = [ROOT] if options.beside is None else [options.beside.resolve(), ROOT]
    print(f"{'':<20} {'aim':>5}" + "".join(f"{checkout.name:>28}" for checkout in checkouts))
    for name in options.cases or CASES:
        case = CASES[name]
        words = dict.fromkeys(checkouts, f"{f'over {options.limit:.0f} s':>28}")
        fewest = dict.fromkeys(checkouts, np.inf)
        for run in range(options.pairs):
            for checkout in checkouts:
                if run and not fewest[checkout] < _SHORT:  # the first may have filled the caches
                    continue
                try:
                    used, report = measure(case, checkout, options.limit)
                except subprocess.TimeoutExpired:
                    continue
                fewest[checkout] = min(used, fewest[checkout])
                words[checkout] = (
                    f"{fewest[checkout]:>9.2f} s, makespan {report['makespan_s']:>7.0f}"
                )
        print(f"{name:<20} {case.aim or '':>5}{''.join(words.values())}", flush=True)


if __name__ == "__main__":
    main()
