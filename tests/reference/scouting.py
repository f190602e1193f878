"""The adaptive scan rule a second time: sets of cells and dicts, a loop for everything, written to
be read.

A cell is (layer, row, column) in the padded arrays of `tests.reference.plain`, which also moves the
world and finds the nearest frontier cell; a 2-D workspace has the one layer 0. Sums and products of
floats are in the order of the kernels, so that equal rates are equal here, too.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tests.reference import plain

Cell = tuple[int, int, int]
Pair = tuple[int, int]  # two states, the smaller one first
Coarse = tuple[int, Pair]  # of the cell two behind, and of the two beside the cell before
Fine = tuple[int, Pair, Pair]  # and of the two beside the cell itself

UNKNOWN, FREE, WALL = plain.UNKNOWN, plain.FREE, plain.OBSTACLE
LEFT, UP, RIGHT, DOWN, IN, OUT = range(6)
STEPS = tuple(zip(plain.D_LAYER.tolist(), plain.D_ROW.tolist(), plain.D_COL.tolist(), strict=True))
BACK = plain.REVERSE.tolist()
AXIS = (2, 1, 2, 1, 0, 0)
# the sides of a way
ACROSS = (UP, DOWN), (LEFT, RIGHT), (UP, DOWN), (LEFT, RIGHT), (LEFT, RIGHT), (LEFT, RIGHT)

LONGEST_RUN = 500
FIRST_STEPS, SECOND_STEPS = 12, 8
LEAST_CHANCE = 0.01
ALL = "all"  # the tally of all cells classified


def ahead(cell: Cell, command: int) -> Cell:
    """Return the cell that a command leads to."""
    step = STEPS[command]
    return cell[0] + step[0], cell[1] + step[1], cell[2] + step[2]


def all_ahead(cells: set[Cell], command: int) -> set[Cell]:
    """Return the cells that a command leads to from any of some cells."""
    layers, rows, columns = STEPS[command]
    return {(layer + layers, row + rows, column + columns) for layer, row, column in cells}


@dataclass
class View:
    """What is known: where particles are, and which cells are free or walls; all others are
    unknown.
    """

    shape: Cell  # of the padded arrays
    particles: set[Cell]
    free: set[Cell]
    walls: set[Cell]

    @classmethod
    def of(cls, world: plain.World) -> View:
        """Return what is known in a plain world."""
        return cls(
            world.state.shape,
            cells_of(world.counts > 0),
            cells_of(world.state == FREE),
            cells_of(world.state == WALL),
        )

    @property
    def directions(self) -> range:
        """The commands there are."""
        return range(4 if self.shape[0] == 1 else 6)

    @property
    def longest(self) -> int:
        """Steps of the longest run that is weighed."""
        sizes = self.shape if self.shape[0] > 1 else self.shape[1:]
        return min(max(sizes), LONGEST_RUN)

    def state(self, cell: Cell) -> int:
        """Return what is known of a cell."""
        return FREE if cell in self.free else WALL if cell in self.walls else UNKNOWN

    def on_edge(self, cell: Cell) -> bool:
        """Tell whether nobody looks beyond a cell: it is on the rim."""
        layer, row, column = cell
        layers, rows, columns = self.shape
        return (
            row in {0, rows - 1}
            or column in {0, columns - 1}
            or (layers > 1 and layer in {0, layers - 1})
        )


def cells_of(mask: NDArray[np.bool_]) -> set[Cell]:
    """Return the True cells of a padded array."""
    return {(layer, row, column) for layer, row, column in np.argwhere(mask).tolist()}


# ------------------------------------------------------------------------------------ what is
# likely free


def beside(view: View, cell: Cell, command: int) -> Pair:
    """Return the states of the two cells beside one, across the direction of a command; which is
    which does not matter.
    """
    one, other = sorted(view.state(ahead(cell, side)) for side in ACROSS[command])
    return one, other


def surroundings(
    view: View, cell: Cell, command: int, run_through: set[Cell] | frozenset[Cell] = frozenset()
) -> Fine:
    """Return what is around a cell entered by a command; cells that the run found free count so if
    they are behind.
    """
    before = ahead(cell, BACK[command])
    behind = ahead(before, BACK[command])
    state = FREE if behind in run_through else view.state(behind)
    return state, beside(view, before, command), beside(view, cell, command)


class Tallies:
    """How many cells were classified in each surroundings, and how many of them were free."""

    def __init__(self) -> None:
        self.cells: defaultdict[Any, int] = defaultdict(int)
        self.free: defaultdict[Any, int] = defaultdict(int)

    def add(self, around: Fine, is_free: bool) -> None:
        """Count one cell, in its fine and coarse surroundings and in all."""
        for key in (around, around[:2], ALL):
            self.cells[key] += 1
            self.free[key] += is_free

    def chance(self, around: Fine) -> float:
        """Return how likely a cell is free: the coarser share counts like two more cells; at first
        it is one half.
        """
        likely = (self.free[ALL] + 1.0) / (self.cells[ALL] + 2.0)
        for key in (around[:2], around):
            likely = (self.free[key] + 2.0 * likely) / (self.cells[key] + 2.0)
        return likely


def learn_from_run(tallies: Tallies, before: View, after: View, command: int) -> None:
    """Count what a run classified, in the surroundings that were known before it."""
    for cell in (after.free | after.walls) - before.free - before.walls:
        tallies.add(surroundings(before, cell, command, after.free), cell in after.free)


# ----------------------------------------------------------------------------------------- straight
# runs


def expected_gains(view: View, tallies: Tallies, command: int) -> list[float]:
    """Return how many cells each step of a run is expected to settle; entry 0 is none."""
    gains = [0.0] * (view.longest + 1)
    for particle in sorted(view.particles):  # the order in which floats are added
        for step, gain in gains_of_one(view, tallies, particle, command):
            gains[step] += gain
    return gains


def gains_of_one(
    view: View, tallies: Tallies, cell: Cell, command: int
) -> Iterator[tuple[int, float]]:
    """Yield (step, chance to settle a cell there) of one particle, until something known or too
    unlikely is in its way.
    """
    likely, walked = 1.0, set()
    for step in range(1, view.longest + 1):
        cell = ahead(cell, command)
        if cell in view.particles or cell in view.walls:
            return
        if cell in view.free:
            continue
        yield step, likely
        if view.on_edge(cell):
            return
        likely *= tallies.chance(surroundings(view, cell, command, walked))
        if likely < LEAST_CHANCE:
            return
        walked.add(cell)


def best_length(gains: list[float], prices: Prices, least: int) -> tuple[int, float]:
    """Return (steps, cells for their price) of the best run of ``least`` steps or more; the
    shortest of equals.
    """
    settled, best = 0.0, (least, 0.0)
    for step in range(1, len(gains)):
        settled += gains[step]
        rate = settled / prices.of(step)
        if step >= least and rate > best[1]:
            best = step, rate
    return best


@dataclass(frozen=True)
class Prices:
    """Of a scan and of a move."""

    scan: float
    move: float

    def of(self, moves: int) -> float:
        """Return the price of so many moves and one scan."""
        return self.scan + self.move * moves


# ------------------------------------------------------------------------------------------------
# walks


def tried(view: View, particles: set[Cell], command: int) -> int:
    """Return how many unknown cells particles elsewhere would try."""
    return len(all_ahead(particles, command) - view.free - view.walls)


def moved(view: View, particles: set[Cell], command: int, rule: str) -> set[Cell]:
    """Return where particles would be after a command that none of them tries an
    unknown cell with.
    """
    stuck = all_ahead(all_ahead(particles, command) - view.free, BACK[command])
    if rule == "block":  # whoever queues behind one that is stuck is stuck, too
        for first in tuple(stuck):
            cell = ahead(first, BACK[command])
            while cell in particles:
                stuck.add(cell)
                cell = ahead(cell, BACK[command])
    return stuck | all_ahead(particles - stuck, command)


def shifts(
    view: View, particles: set[Cell], command: int, rule: str, most: int
) -> Iterator[set[Cell]]:
    """Yield where particles are after 1, 2, ... equal commands, as long as that is certain and any
    of them moves.
    """
    for _ in range(most):
        if tried(view, particles, command) > 0:
            return
        after = moved(view, particles, command, rule)
        if after == particles:
            return
        yield after
        particles = after


def walks(view: View, rule: str) -> Iterator[tuple[list[int], set[Cell]]]:
    """Yield each walk that is looked at, one leg or two legs across each other, and where particles
    are after it.
    """
    for first in view.directions:
        for length, once in enumerate(
            shifts(view, view.particles, first, rule, FIRST_STEPS), start=1
        ):
            yield [first] * length, once
            for second in view.directions:
                if AXIS[second] != AXIS[first]:
                    for further, twice in enumerate(
                        shifts(view, once, second, rule, SECOND_STEPS), start=1
                    ):
                        yield [first] * length + [second] * further, twice


def explore(view: View, rule: str, prices: Prices, rate: float) -> tuple[list[int], float]:
    """Return the first of the best walks with a last command, none if not better than ``rate``, and
    the rate that is best now.
    """
    plan: list[int] = []
    for walk, particles in walks(view, rule):
        price = prices.of(len(walk) + 1)
        for last in view.directions:
            count = tried(view, particles, last)
            if count > rate * price:  # not count / price > rate, which may round otherwise
                plan, rate = [*walk, last], count / price
    return plan, rate


# ---------------------------------------------------------------------------------------------
# episodes


@dataclass
class Scout:
    """One adaptive mapping."""

    world: plain.World
    rule: str
    prices: Prices
    max_moves: int
    tallies: Tallies = field(default_factory=Tallies)
    commands: list[int] = field(default_factory=list)
    scanned: list[bool] = field(default_factory=list)

    @property
    def running(self) -> bool:
        """Whether there is anything left to do, and a command left to do it."""
        return bool(self.world.frontier.any()) and len(self.commands) < self.max_moves

    def path(self) -> list[int]:
        """Return the commands to the nearest frontier cell."""
        sources = plain.occupied_cells(self.world.counts, plain.COLUMN_MAJOR)
        return plain.find_path(
            sources, self.world.state, self.world.frontier, False, plain.COLUMN_MAJOR
        )[0].tolist()

    def decide(self) -> tuple[list[int], int]:
        """Return a plan, empty if there is none, and the steps of its last run, 0 if those are
        chosen when it comes.
        """
        view, prices = View.of(self.world), self.prices
        plan, steps, rate = [], 0, 0.0
        for direction in view.directions:
            length, reached = best_length(expected_gains(view, self.tallies, direction), prices, 1)
            if reached > rate:
                plan, steps, rate = [direction], length, reached
        # a path of one step is a run that was looked at; one of two may be better
        if rate * (prices.scan + 2 * prices.move) < 1:
            path = self.path()
            if not path:
                return [], 0
            if rate * (prices.scan + len(path) * prices.move) < 1:
                plan, steps, rate = path, 0, 1 / (prices.scan + len(path) * prices.move)
        walk, found = explore(view, self.rule, prices, rate)
        # a walk as good as the plan may have been found by rounding
        return (walk, 0) if found > rate else (plan, steps)

    def last_run(self, command: int, planned: int) -> int:
        """Return how often to send the last command of a plan."""
        gains = expected_gains(View.of(self.world), self.tallies, command)
        return best_length(gains, self.prices, planned)[0]

    def run(self, command: int, steps: int) -> bool:
        """Send equal commands, scan if anything was learnt, and tell so. The limit of moves may cut
        the run, not its scan.
        """
        before, learnt = View.of(self.world), 0
        for _ in range(min(steps, self.max_moves - len(self.commands))):
            learnt += plain.step(*self.world, command, plain.RULES.index(self.rule), plain.MAPPING)[
                1
            ]
            self.commands.append(command)
            self.scanned.append(False)
        if learnt:
            self.scanned[-1] = True
            learn_from_run(self.tallies, before, View.of(self.world), command)
        return learnt > 0

    def follow(self, plan: list[int], steps: int) -> None:
        """Carry out a plan run by run, up to the first scan."""
        while plan and self.running:
            command = plan[0]
            stretch = next((i for i, other in enumerate(plan) if other != command), len(plan))
            plan = plan[stretch:]
            if not plan:
                stretch = steps or self.last_run(command, stretch)
            if self.run(command, stretch):
                return


def scout(
    free: Any, start: Any, *, rule: str, scan_cost: float, move_cost: float, max_moves: int
) -> tuple[str, list[bool], Scout]:
    """Play a whole adaptive mapping; return its commands, which of them were followed by a scan,
    and the end.
    """
    state = Scout(
        plain.make_world(free, start, rule=rule), rule, Prices(scan_cost, move_cost), max_moves
    )
    while state.running:
        plan, steps = state.decide()
        if not plan:
            break
        state.follow(plan, steps)
    return "".join(plain.LETTERS[code] for code in state.commands), state.scanned, state
