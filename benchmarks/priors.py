"""Expected time to find a target with a prior, beside the plan without: python -m benchmarks.priors

Seeded priors on a square of 40 x 40 cells, four robots: of ten priors, four or five are mixtures of
one to four normal distributions, as many are rings around a point with log-normal distances, and one
is the same everywhere. Robots start at random or clustered places and are simulated with the
protocol.

With the detection 1, both times come from the first searches of all cells (visits.csv), and the
probabilities from the prior itself. Beside them stands a central greedy plan without messages, whose
robots go on to the cell with the largest probability over distance, and a lower bound for any plan
from the same starts. With another ``--detection``, targets are drawn and looked for in
all searches of their squares, again and again, until one search detects them.

With ``--drifts N``, targets move. Of three seeded priors, one is a mixture of normal distributions, one
a ring, and one a normal distribution around a last known position, with a standard deviation of 3 to
10 % of the side. Velocities have a random direction and 0.1 to 0.3 times the speed of the robots, and
each target deviates from it by a fifth of that. The plan that knows the drift stands beside the one
that knows the prior alone. Targets are drawn and followed; one that no robot meets until the longest
time of the plan counts with that time.

With ``--kicks``, the local search for orders makes other numbers of kicks than its own, one after
the other.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from shoal.search import SearchEpisode, SearchProblem, plan_search
from shoal.search.allocation import likely as ordering
from shoal.search.run import run

SIDE, CELL = 40, 10.0
SPEED = 1.0  # of robots, in metres per second
HELLO = 1.0  # times of a cell in which robots listen to each other before they search
SLOW, FAST, DEVIATION = 0.1, 0.3, 0.2
AT_ONCE = 16  # looks
NEVER = 1e6  # larger than any sum of probabilities times moments

Floats = NDArray[np.float64]


def prior(number: int) -> tuple[str, Floats]:
    """Return the family of a seeded prior, and its probabilities with row 0 in the north."""
    rng = np.random.default_rng([46, number])
    family = "uniform" if number % 10 == 9 else ("normal", "ring")[number % 2]
    return family, drawn(family, rng)


def drawn(family: str, rng: np.random.Generator) -> Floats:
    """Return a random prior of a family."""
    rows, columns = np.mgrid[:SIDE, :SIDE] + 0.5
    values = np.ones((SIDE, SIDE))
    if family == "normal":
        values = np.zeros((SIDE, SIDE))
        for _ in range(int(rng.integers(1, 5))):
            row, column = rng.uniform(0, SIDE, 2)
            spread = rng.uniform(0.05, 0.2) * SIDE
            near = ((rows - row) ** 2 + (columns - column) ** 2) / spread**2
            values += rng.uniform(0.3, 1.0) * np.exp(-near / 2) / spread**2
    elif family == "ring":
        row, column = rng.uniform(0.2 * SIDE, 0.8 * SIDE, 2)
        away = np.hypot(rows - row, columns - column) + 0.3
        middle, spread = np.log(rng.uniform(0.1, 0.4) * SIDE), rng.uniform(0.3, 0.9)
        values = np.exp(-(((np.log(away) - middle) / spread) ** 2) / 2) / away**2
    elif family == "position":
        row, column = rng.uniform(0.2 * SIDE, 0.8 * SIDE, 2)
        spread = rng.uniform(0.03, 0.1) * SIDE
        values = np.exp(-((rows - row) ** 2 + (columns - column) ** 2) / spread**2 / 2)
    return values / values.sum()


def problem_of(number: int) -> SearchProblem:
    """Return the search of a prior without it."""
    starts = ("random", "clustered")[number // 2 % 2]
    return SearchProblem(f"square:{SIDE * CELL:g}", robots=4, footprint=CELL, starts=starts)


def targets(values: Floats, count: int, rng: np.random.Generator) -> Floats:
    """Return random places by a prior, in metres; float64, shape (count, 2)."""
    rows, columns = np.divmod(rng.choice(values.size, size=count, p=values.ravel()), SIDE)
    corners = np.column_stack([columns, SIDE - 1 - rows])
    return (corners + rng.random((count, 2))) * CELL


def looks(episode: SearchEpisode) -> tuple[Floats, Floats]:
    """Return the places and times of all searches, the earliest first."""
    logs = [
        (episode.plan.positions(log.cells)[:, :2], episode.clock(log.times, robot))
        for robot, log in enumerate(episode.trace.robots)
    ]
    places, times = (np.concatenate(column) for column in zip(*logs, strict=True))
    order = np.argsort(times, kind="stable")
    return places[order], times[order]


def judged(episode: SearchEpisode, values: Floats) -> tuple[float, float]:
    """Return the expected time to find and the time of the last first search, in seconds."""
    visits, plan = episode.visits, episode.plan
    places = plan.positions(np.arange(len(plan.tour)))
    rows = SIDE - 1 - (places[:, 1] // CELL).astype(int)
    odds = values[rows, (places[:, 0] // CELL).astype(int)]
    return float(odds @ visits.times), float(visits.times.max())


def greedy(starts: Floats, values: Floats) -> tuple[float, float]:
    """Return the expected time to find and the time of the last search, in seconds, if each robot
    goes on to the cell with the largest probability over distance, from ``starts`` in metres.
    """
    cells = middles()
    odds = values.ravel()
    likely = odds + 1e-6 * odds.max()
    places, busy, first = starts.copy(), np.zeros(len(starts)), np.full(len(cells), np.inf)
    for _ in cells:
        robot = int(busy.argmin())
        away = np.hypot(*(cells - places[robot]).T)
        open_ = np.where(np.isinf(first), likely / np.maximum(away, 1e-3 * CELL), -1.0)
        cell = int(open_.argmax())
        busy[robot] += away[cell] / SPEED
        first[cell], places[robot] = busy[robot], cells[cell]
    return float(odds @ first), float(busy.max())


def least(starts: Floats, values: Floats) -> float:
    """Return a lower bound on the expected time to find of any plan from ``starts``, in seconds.

    Robots first listen to each other for the time ``hello``, and stand still meanwhile.
    Each search takes a robot at least as long as the way of one cell. A robot therefore ends at most
    one search from k to k + 1 such times after the start, and none of a cell to which its way from
    the start is longer. Of all assignments of cells to such times of the robots that keep to that
    alone, the best one is the bound: ways between cells do not count.
    """
    cells, odds = middles(), values.ravel()
    ways = np.hypot(*(cells[:, None] - starts[None]).transpose(2, 0, 1)) / CELL
    first = np.floor(ways + 1.0 + 1e-9)
    # from the first of these moments on, every robot reaches every cell
    count = int(first.max()) + -(-len(cells) // len(starts))
    moments = np.tile(np.arange(1, count + 1), len(starts))
    robots = np.repeat(np.arange(len(starts)), count)
    costs = np.where(first[:, robots] <= moments, odds[:, None] * moments, NEVER)
    cell, moment = linear_sum_assignment(costs)
    return (float(costs[cell, moment].sum()) + HELLO) * CELL / SPEED


def middles() -> Floats:
    """Return the middles of all cells in metres, from the north-west, row by row."""
    along = (np.arange(SIDE) + 0.5) * CELL
    return np.column_stack([axis.ravel() for axis in np.meshgrid(along, along[::-1])])


def planning_time(problem: SearchProblem, seed: int) -> float:
    """Return the processor time of planning, in seconds."""
    begun = time.process_time()
    plan_search(problem, seed=seed)
    return time.process_time() - begun


def repeated(
    episode: SearchEpisode,
    values: Floats,
    detection: float,
    count: int,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """Return the mean time until drawn targets are detected in searches that are repeated, and the
    time of the last search, in seconds.
    """
    places, times = looks(episode)
    squares = (places // CELL).astype(int) @ (1, SIDE)
    mine = (targets(values, count, rng) // CELL).astype(int) @ (1, SIDE)
    total = 0.0
    for square in mine.tolist():
        own = times[squares == square]
        look = int(rng.geometric(detection)) - 1
        total += own[look % len(own)] + look // len(own) * times[-1]
    return total / count, float(times[-1])


def met(
    episode: SearchEpisode, begins: Floats, velocities: Floats, horizon: float
) -> tuple[float, float]:
    """Return the mean time until robots first search the square in which each target is then, at most
    ``horizon``, and the share of targets that they meet until then.
    """
    places, times = looks(episode)
    first = np.full(len(begins), np.inf)
    for low in range(0, len(times), AT_ONCE):
        some = times[low : low + AT_ONCE]
        moved = begins[None] + some[:, None, None] * velocities[None]
        there = (np.abs(moved - places[low : low + AT_ONCE, None]) <= CELL / 2).all(axis=2)
        when = np.where(there, some[:, None], np.inf).min(axis=0)
        first = np.minimum(first, when)
    return float(np.minimum(first, horizon).mean()), float((first <= horizon).mean())


Rows = dict[tuple[str, float], list[tuple[float, ...]]]


def compare(numbers: Iterable[int], limits: list[float], detection: float, count: int) -> Rows:
    """Compare plans with and without priors."""
    found: Rows = {}
    with TemporaryDirectory() as folder:
        for number in numbers:
            family, values = prior(number)
            file = Path(folder) / "prior.npy"
            np.save(file, values)
            rng = np.random.default_rng([48, number])

            def judge(
                episode: SearchEpisode, values: Floats = values, rng: np.random.Generator = rng
            ) -> tuple[float, float]:
                if detection == 1:
                    return judged(episode, values)
                return repeated(episode, values, detection, count, rng)

            problem = problem_of(number)
            begun = time.process_time()
            without = run(problem, seed=number)
            before, plain = judge(without)
            spent = time.process_time() - begun
            starts = without.plan.positions(without.plan.starts)[:, :2]
            other, latest = greedy(starts, values) if detection == 1 else (np.nan, np.nan)
            bound = least(starts, values) / before if detection == 1 else np.nan
            planned = planning_time(problem, number)
            for at_most in limits:
                likely = problem.replaced(prior=(str(file),), at_most=at_most, detection=detection)
                begun = time.process_time()
                episode = run(likely, seed=number)
                after, last = judge(episode)
                cost = (time.process_time() - begun) / spent
                own = planning_time(likely, number) / planned
                stated = (episode.expected_find or 0.0) / after
                success = episode.success.probability if episode.success else 0.0
                for name in ("all", family):
                    row: tuple[float, ...] = (
                        after / before,
                        last / plain,
                        cost,
                        own,
                        success,
                        stated,
                    )
                    if detection == 1:
                        row = (*row, other / before, latest / plain, bound)
                    found.setdefault((name, at_most), []).append(row)
    return found


def drift(numbers: Iterable[int], at_most: float, count: int) -> Rows:
    """Compare plans that know how a target drifts with plans that know the prior alone."""
    found: Rows = {}
    with TemporaryDirectory() as folder:
        for number in numbers:
            rng = np.random.default_rng([49, number])
            family = ("normal", "ring", "position")[number % 3]
            values = drawn(family, rng)
            file = Path(folder) / "prior.npy"
            np.save(file, values)
            angle, speed = rng.uniform(0, 2 * np.pi), rng.uniform(SLOW, FAST) * SPEED
            east, north = float(speed * np.cos(angle)), float(speed * np.sin(angle))
            begins = targets(values, count, rng)
            spread = DEVIATION * speed
            velocities = np.array([east, north]) + spread * rng.normal(size=begins.shape)
            problem = problem_of(number).replaced(
                prior=(str(file),), at_most=at_most, simulate=False
            )
            still = run(problem, seed=number)
            horizon = at_most * float(still.plan.plain_seconds or 0.0)
            before, success = met(still, begins, velocities, horizon)
            moving = run(problem.replaced(drift=(east, north, spread)), seed=number)
            after, found_share = met(moving, begins, velocities, horizon)
            last = moving.plan.planned_seconds / float(still.plan.plain_seconds or 0.0)
            stated = (moving.expected_find or 0.0) / after
            for name in ("all", family, f"{'up to' if speed < 0.2 else 'above'} 0.2"):
                row = (after / before, last, success, found_share, stated)
                found.setdefault((name, at_most), []).append(row)
    return found


def show(found: Rows, columns: list[str]) -> None:
    """Print a table of means, and of the longest time for all."""
    heads = ["priors", "number", "at most", "time to find", "time for all: mean (most)", *columns]
    print("| " + " | ".join(heads) + " |")
    print("|" + "---|" * len(heads))
    for (name, at_most), rows in sorted(found.items(), key=lambda one: (-one[0][1], one[0][0])):
        find, last, *rest = np.mean(rows, axis=0)
        most = np.max(rows, axis=0)[1]
        more = " | ".join(f"{value:.3g}" for value in rest)
        print(
            f"| {name} | {len(rows)} | {at_most:g} | {find:.3f} | {last:.3f} ({most:.3f}) | {more} |"
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--priors", type=int, default=200)
    parser.add_argument("--drifts", type=int, default=0)
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--at-most", type=float, nargs="+", default=[1.25, 1.05])
    parser.add_argument("--detection", type=float, default=1.0)
    parser.add_argument("--targets", type=int, default=10_000)
    parser.add_argument("--only", help="family of the priors")
    parser.add_argument("--kicks", type=int, nargs="+")
    options = parser.parse_args()
    if options.drifts:
        numbers = range(options.first, options.first + options.drifts)
        found = drift(numbers, options.at_most[0], options.targets)
        show(found, ["found without drift", "found with it", "stated time over judged"])
        return
    numbers = [
        number
        for number in range(options.first, options.first + options.priors)
        if options.only in (None, prior(number)[0])
    ]
    columns = ["CPU", "of planning", "probability of success", "stated time over judged"]
    beside = ["greedy: time to find", "time for all", "bound"] if options.detection == 1 else []
    for kicks in options.kicks or [ordering._KICKS]:
        ordering._KICKS = kicks
        if options.kicks:
            ordering._KICKS_PER_BLOCK = kicks
        print(f"{kicks} kicks")
        found = compare(numbers, options.at_most, options.detection, options.targets)
        show(found, [*columns, *beside])


if __name__ == "__main__":
    main()
