"""python -m benchmarks.certificates: gaps of certificates by class of problems, and whether a bound
is above any plan of any planner.

Options: --problems N (a class), --seconds S (ascending, for example 10,60; the search goes on to the
last one), --workers N (threads; with one, seconds are those of the processor), --seed K, --only CLASS, --first N (number of the first problem),
--plans N (other plans with which each bound is compared), --runs (how far the programs of runs are
below the plans of disks that certificates find, if the arcs of all contacts are known), --limits
(at round walls, what potentials prove if the first and the last contact are those of the plan that a
certificate finds: no division of these contacts proves more), --results FILE (one JSON object a line,
appended as they come; problems in the file are not run again), --figure FILE (drawn from all
results in the file).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from fractions import Fraction
from itertools import groupby
from pathlib import Path
from time import monotonic, process_time
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.steering import SteeringProblem, certify, check_certificate, polygon
from shoal.steering.certificates.check_contacts import Contacts, Sector
from shoal.steering.certificates.check_potential import DEGREES
from shoal.steering.certificates.potential import contact_potential
from shoal.steering.certificates.relaxation import ROUND_WALLS, Hold, Relaxation
from shoal.steering.episode import SteeringEpisode
from shoal.steering.planners.chains import Chain, refine_chain
from shoal.steering.planners.task import SteeringTask, path_length, plan_chain
from shoal.steering.run import run
from shoal.steering.workspaces.convex import hull

SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
LIMITS = (1e-3, 0.01, 0.05, 0.25, np.inf)
_SLIVER = 0.004  # angle of a sector that is nearly one direction
_SOLVED = 1e-4  # relative: what a solver leaves
_SLACK = 1e-9  # relative: rounding errors of the length of a plan


def _irregular(rng: Generator) -> Any:
    while True:
        corners = hull(rng.normal(size=(12, 2)))
        if 5 <= len(corners) <= 8:
            return polygon(corners)


def _in_corners(rng: Generator) -> dict[str, Any]:
    """Return starts and goals within 0.1 of corners of the square."""
    corners = rng.integers(0, 2, size=(2, 2, 2))
    places = np.abs(corners - rng.uniform(0.005, 0.1, size=(2, 2, 2)))
    return {"workspace": polygon(SQUARE), "start": places[0], "goal": places[1]}


def _antipodes(rng: Generator) -> dict[str, Any]:
    """Return starts near antipodes of the disk, and goals near these places changed over."""
    angle = rng.uniform(0, 2 * np.pi)
    angles = angle + np.array([[0, np.pi], [np.pi, 0]]) + rng.uniform(-0.1, 0.1, size=(2, 2))
    radii = 0.5 * (1 - rng.uniform(0.005, 0.1, size=(2, 2)))
    places = radii[:, :, None] * np.stack([np.cos(angles), np.sin(angles)], axis=2)
    return {"workspace": "disk", "start": places[0], "goal": places[1]}


CLASSES: dict[str, Callable[[Generator], dict[str, Any]]] = {
    "square": lambda rng: {"workspace": "square"},
    "regular": lambda rng: {"workspace": f"regular:{rng.integers(3, 9)}"},
    "irregular": lambda rng: {"workspace": _irregular(rng)},
    "thin triangle": lambda rng: {
        "workspace": polygon([(0, 0), (1, 0), (rng.uniform(0, 1), rng.uniform(0.03, 0.2))])
    },
    "corners": _in_corners,
    "interchangeable": lambda rng: {"workspace": "square", "interchangeable": True},
    "60-gon": lambda rng: {"workspace": "regular:60"},
    "disk": lambda rng: {"workspace": "disk"},
    "antipodes": _antipodes,
}


def result_of(
    name: str, number: int, *, seed: int, seconds: list[float], plans: int, workers: int
) -> dict[str, Any] | None:
    """Return the gaps of one problem after each time, and check the certificate and the bound."""
    rng = np.random.default_rng([seed, number, list(CLASSES).index(name)])
    fields = CLASSES[name](rng)
    drawn = int(rng.integers(1 << 30))
    problem = SteeringProblem(**fields)
    episode = run(problem, seed=drawn)
    if not episode:
        return None
    bounds: list[tuple[float, float]] = []
    clock = process_time if workers == 1 else monotonic
    begun = clock()
    found = certify(
        episode,
        seconds=seconds[-1],
        progress=lambda passed, bound: bounds.append((passed, bound)),
        clock=clock,
        workers=workers,
    )
    spent = clock() - begun
    assert found.proof is not None
    assert check_certificate(found.proof)
    # the last bound before each time; the last one is that of the certificate
    early = [[bound for passed, bound in bounds if passed <= end] for end in seconds[:-1]]
    gaps = [
        found.episode.length / before[-1] - 1 if before and spent > end else found.gap
        for before, end in zip(early, seconds[:-1], strict=True)
    ]
    shortest, compared = np.inf, 0
    for length in _lengths(problem, fields, drawn, plans, rng):
        shortest, compared = min(shortest, length), compared + 1
    assert shortest >= found.lower_bound * (1 - _SLACK), (name, number, shortest)
    return {
        "class": name,
        "number": number,
        "seconds": seconds,
        "gaps": [*gaps, found.gap],
        "length": episode.length,
        "certified length": found.episode.length,
        "lower bound": found.lower_bound,
        "spent": spent,
        "cases": sum(
            len([node for node in tree["proof"] if "norms" in node])
            for tree in found.proof["trees"]
        ),
        "plans": compared,
        "shortest other": shortest,
    }


def _lengths(
    problem: SteeringProblem, fields: dict[str, Any], seed: int, plans: int, rng: Generator
) -> Iterator[float]:
    """Yield the lengths of plans by other planners, and of plans with random chains of holds."""
    if not plans:
        return
    for planner in ("greedy", "fewest-moves"):
        other = run(SteeringProblem(**fields, planner=planner), seed=seed)
        if other:
            yield other.length
    start, goal = problem.endpoints(seed)
    orders = [[0, 1], [1, 0]] if problem.interchangeable else [[0, 1]]
    for number in range(plans):
        task = SteeringTask(
            problem.world(gain=0.0),
            start,
            goal[orders[number % len(orders)]],
            problem.tolerance,
            problem.max_moves,
            seed,
            clearance=problem.clearance,
            margin=problem.clearance,
        )
        first, query = task.departures()[0]
        count = int(rng.integers(1, 5))
        touchers = rng.integers(0, 2, size=count)
        walls = rng.integers(0, max(len(problem.place.vertices), 1), size=count)
        unknowns = query.guess(count)
        length = query.optimize(unknowns, touchers, walls, enough=1e-9)
        if not length < np.inf:
            continue
        chain = refine_chain(query, Chain(touchers, walls, unknowns, length))
        for plan in plan_chain(task, first, chain, query):
            if task.error(task.world.play(start, plan)[-1]) <= task.tolerance:
                yield path_length(plan)


def print_runs(given: argparse.Namespace) -> None:
    """Print how much longer the plans of disks are than the bounds of their patterns, with runs of
    contacts, and with each contact for itself; all contacts are with known arcs.
    """
    print("| problem | contacts | longer than the bound of runs | than that of single contacts |")
    print("|---|---|---|---|")
    for number in range(given.first, given.first + given.problems):
        rng = np.random.default_rng([given.seed, number, list(CLASSES).index("disk")])
        problem = SteeringProblem(**CLASSES["disk"](rng))
        found = run(problem, seed=int(rng.integers(1 << 30)))
        seconds = float(given.seconds.split(",")[-1])
        episode = certify(found, seconds=seconds, clock=process_time).episode
        contacts = _contacts(problem, episode)
        start, goal = problem.endpoints(episode.seed)
        relaxation = Relaxation(
            problem.place, start, goal, problem.tolerance, episode.length * (1 + _SLACK)
        )
        runs = [
            (particle, [arc for _, arc in run_of])
            for particle, run_of in groupby(contacts, key=lambda contact: contact[0])
        ]
        each = [(particle, [arc]) for particle, arcs in runs for arc in arcs]
        gaps = [
            episode.length / relaxation.bound(tuple(_hold(*one) for one in holds)).value - 1
            for holds in (runs, each)
        ]
        shown = ", ".join(f"{'12'[particle]}: {len(arcs)}" for particle, arcs in runs)
        print(f"| {number} | {shown} | {100 * gaps[0]:.2f} % | {100 * gaps[1]:.2f} % |", flush=True)


def print_limits(given: argparse.Namespace) -> None:
    """Print what potentials prove for the plans whose first and last contacts are nearly those of the
    plan that a certificate finds, relative to the length that would prove a gap of 5 or 1 %.
    """
    print("| class | problem | 5 % | 1 % |")
    print("|---|---|---|---|")
    short: dict[tuple[str, float], int] = {}
    for name in [given.only] if given.only else ("60-gon", "disk"):
        for number in given.numbers or range(given.first, given.first + given.problems):
            rng = np.random.default_rng([given.seed, number, list(CLASSES).index(name)])
            problem = SteeringProblem(**CLASSES[name](rng))
            episode = run(problem, seed=int(rng.integers(1 << 30)))
            if not episode:
                continue
            episode = certify(episode, seconds=2, workers=1).episode
            shown = ""
            for gap in LIMITS[2:0:-1]:
                share = _share_proven(problem, episode, gap)
                short[name, gap] = short.get((name, gap), 0) + (share < 1 - _SOLVED)
                shown += f" {share:.4f} |"
            print(f"| {name} | {number} |{shown}", flush=True)
    for (name, gap), count in short.items():
        print(f"{name}: {count} problems cannot have a gap of {100 * gap:g} % in this way")


def _share_proven(problem: SteeringProblem, episode: SteeringEpisode, gap: float) -> float:
    """Return the bound of a potential for the plans with nearly the first and the last contact of a
    plan, divided by the length that would prove a gap; infinity if there are no shorter plans.
    """
    relaxation = Relaxation(
        problem.place, episode.states[0], episode.states[-1], problem.tolerance, episode.length
    )
    walls = relaxation.walls
    unit, ring = walls.rings or (0.0, 0.0)
    start, goal = (
        [Fraction(float(x)) for x in ((ends - walls.middle) / unit).ravel()]
        for ends in (relaxation.start, relaxation.goal)
    )
    limit = relaxation.limit / unit / (1 + gap)
    sizes = [Fraction(x) for x in (relaxation.tolerance / unit, limit, ring / unit**2)]
    contacts = Contacts(start, goal, *sizes)
    stops = _stops(episode)
    if not stops:
        return np.inf
    middle = episode.states[0, 0] + (walls.middle - relaxation.start[0]) * relaxation.scale
    ends = [(k, np.arctan2(*(place - middle)[::-1])) for k, place in (stops[0], stops[-1])]
    first, last = (
        Sector(particle, *(_direction(angle + side * _SLIVER) for side in (-0.5, 0.5)))
        for particle, angle in ends
    )
    around = contacts.region(first, last)
    if around is None:
        return np.inf
    degree, accuracy = DEGREES[-1], 1e-6
    bound, _ = contact_potential(contacts, (first, last), around, degree, accuracy)
    return bound / limit


def _direction(angle: float) -> tuple[Fraction, Fraction]:
    return Fraction(float(np.cos(angle))), Fraction(float(np.sin(angle)))


def _stops(episode: SteeringEpisode) -> list[tuple[int, NDArray[np.float64]]]:
    """Return the particle and the place of each contact of a plan."""
    found, places = [], episode.states
    for move, before, after in zip(episode.inputs, places, places[1:], strict=False):
        stopped = np.linalg.norm(after - before - move, axis=1) > 1e-7 * np.linalg.norm(move)
        found += [(k, after[k]) for k in np.flatnonzero(stopped).tolist()]
    return found


def _contacts(problem: SteeringProblem, episode: SteeringEpisode) -> list[tuple[int, int]]:
    """Return the particle and the arc of each contact of a plan in a disk; an arc is at most half a
    turn from the one before.
    """
    found: list[tuple[int, int]] = []
    for particle, place in _stops(episode):
        x, y = place - problem.place.center
        arc = int(np.floor(np.arctan2(y, x) / (2 * np.pi) * ROUND_WALLS))
        if found:
            arc -= ROUND_WALLS * round((arc - found[-1][1]) / ROUND_WALLS)
        found.append((particle, arc))
    return found


def _hold(particle: int, arcs: list[int]) -> Hold:
    """Return the run of contacts with some arcs."""
    least, most = min(arcs), max(arcs)
    order = np.sign(arcs.index(most) - arcs.index(least))
    ends = [(arc, arc + 1) for arc in (arcs[0], arcs[-1], least, most)]
    return Hold(particle, *ends, int(order))


def main() -> None:
    """Print the shares of gaps below some limits, and draw them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--problems", type=int, default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", default="10")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=tuple(CLASSES))
    parser.add_argument("--plans", type=int, default=10)
    parser.add_argument("--runs", action="store_true")
    parser.add_argument("--limits", action="store_true")
    parser.add_argument("--numbers", type=int, nargs="*", help="of the problems for --limits")
    parser.add_argument("--results", type=Path)
    parser.add_argument("--figure", type=Path)
    given = parser.parse_args()
    if given.runs:
        print_runs(given)
        return
    if given.limits:
        print_limits(given)
        return
    seconds = [float(part) for part in given.seconds.split(",")]
    lines = (
        given.results.read_text().splitlines() if given.results and given.results.exists() else []
    )
    results = [json.loads(line) for line in lines]
    known = {(one["class"], one["number"]) for one in results}
    for number in range(given.first, given.first + given.problems):
        for name in [given.only] if given.only else CLASSES:
            if (name, number) in known:
                continue
            result = result_of(
                name,
                number,
                seed=given.seed,
                seconds=seconds,
                plans=given.plans,
                workers=given.workers,
            )
            if result is None:
                continue
            results.append(result)
            if given.results:
                with given.results.open("a") as file:
                    file.write(json.dumps(result) + "\n")
    print_table(results)
    if given.figure is not None:
        _draw(results, given.figure)


def _gaps(results: list[dict[str, Any]], seconds: float) -> dict[str, Any]:
    """Return the gaps of each class after a time; only of searches with this time."""
    found: dict[str, list[float]] = {name: [] for name in CLASSES}
    for one in results:
        for time, gap in zip(one["seconds"], one["gaps"], strict=True):
            if time == seconds:
                found[one["class"]].append(gap)
    return {name: np.array(gaps) for name, gaps in found.items() if gaps}


def _times(results: list[dict[str, Any]]) -> list[float]:
    return sorted({time for one in results for time in one["seconds"]})


def print_table(results: list[dict[str, Any]]) -> None:
    """Print the shares of gaps below some limits by class, and what all plans have shown."""
    for seconds in _times(results):
        print(f"{seconds:g} s")
        print("| class | problems | at most 0.1 % | 1 % | 5 % | mean gap | largest |")
        print("|---|---|---|---|---|---|---|")
        gaps = _gaps(results, seconds)
        for name, values in {**gaps, "all": np.concatenate(list(gaps.values()))}.items():
            shares = "".join(f" {100 * np.mean(values <= limit):.0f} % |" for limit in LIMITS[:3])
            print(
                f"| {name} | {len(values)} |{shares} {100 * values.mean():.2f} % |"
                f" {100 * values.max():.1f} % |"
            )
    for one in results:
        if one["length"] > one["certified length"] * 1.001:
            print(
                f"{one['class']} {one['number']}: {one['length']:.6f} became"
                f" {one['certified length']:.6f}"
            )
    closest = min(one["shortest other"] / one["lower bound"] for one in results)
    print(
        f"{sum(one['plans'] for one in results)} other plans; the shortest is {closest:.9f} times"
        " the bound"
    )


def _draw(results: list[dict[str, Any]], path: Path) -> None:
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    from shoal.views import save_figure

    # made for all kinds of colour vision; from dark to light in print, too
    shades = colormaps["cividis"](np.linspace(0, 1, len(LIMITS)))
    times = _times(results)
    figure = Figure(figsize=(8, 3.2), layout="constrained")
    names = list(_gaps(results, times[0]))[::-1]
    rows = np.atleast_1d(figure.subplots(1, len(times), sharey=True))
    for axes, seconds in zip(rows, times, strict=True):
        gaps = _gaps(results, seconds)
        shown = [name for name in names if name in gaps]
        left = np.zeros(len(shown))
        for limit, shade in zip(LIMITS, shades, strict=True):
            share = np.array([100 * np.mean(gaps[name] <= limit) for name in shown]) - left
            label = f"at most {100 * limit:g} %" if np.isfinite(limit) else "more"
            axes.barh(
                [names.index(name) for name in shown],
                share,
                left=left,
                color=shade,
                edgecolor="white",
                label=label,
            )
            left = left + share
        axes.set_xlabel("share of problems, %")
        axes.set_title(f"{seconds:g} s")
        axes.set_xlim(0, 100)
        axes.set_yticks(range(len(names)), names)
    axes.legend(title="gap", loc="center left", bbox_to_anchor=(1, 0.5))
    save_figure(figure, path)


if __name__ == "__main__":
    main()
