"""Scenario: all data that determine the simulation of a search."""

from __future__ import annotations

from dataclasses import field, replace
from functools import cached_property
from itertools import pairwise
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.search.cells.distances import CellDistances
from shoal.search.cells.footprint import check_widths
from shoal.search.cells.layers import LayeredGrid, layers_of
from shoal.search.flight.timing import climbing_seconds, working_seconds
from shoal.search.planning.plan import SearchPlan
from shoal.search.problem import SearchProblem
from shoal.search.problem.network import (
    Crash,
    Fault,
    RadioNetwork,
    WrongPosition,
    network_of,
)
from shoal.search.problem.target import Ground
from shoal.search.protocol.state import Brief
from shoal.search.regions.places import points_inside
from shoal.search.tours.masks import bitset_of


@dataclass(frozen=True)
class Scenario:
    """All data that determine the simulation of a search.

    Parameters
    ----------
    brief : Brief
    starts : tuple of int
        Tour index of each robot's start cell. The first start cell belongs to robot 1.
    rates : tuple of float
        Speed of each robot, relative to the common speed.
    network : RadioNetwork
    faults : tuple of Fault
    targets : tuple of int
        Tour indices of the cells that contain a target.
    detection : float
        Probability that a robot that searches a cell detects the target in this cell.
    false_alarm : float
        Probability that a robot reports a target in a cell without a target.
    obstacles : tuple of int
        Tour indices of blocked cells. A robot discovers a blocked cell when it reaches the cell.
        Obstacles require that robots move from cell to cell.
    widths : tuple of int
        Width of each robot's footprint, as an odd number of cells.
    signed : bool
        Whether robots sign their messages with a secret key.
    packet : int
        Maximum length of a message in bytes. With 0, the maximum is 1200 bytes, but in a simulation
        without signatures and without replays, every beacon is one message.
    seed : int
        Seed of all random numbers in the simulation.
    """

    brief: Brief
    starts: tuple[int, ...]
    rates: tuple[float, ...] = ()
    network: RadioNetwork = field(default_factory=RadioNetwork)
    faults: tuple[Fault, ...] = ()
    targets: tuple[int, ...] = ()
    detection: float = 1.0
    false_alarm: float = 0.0
    obstacles: tuple[int, ...] = ()
    widths: tuple[int, ...] = ()
    signed: bool = False
    packet: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        m, n = len(self.starts), len(self.brief.tour_cost)
        if not m or any(not 0 <= start < n for start in self.starts):
            raise InvalidInputError(
                f"starts: expected one or more cells from 0 to {n - 1}, got"
                f" {list(self.starts)!r:.200}"
            )
        if not self.rates:
            object.__setattr__(self, "rates", (1.0,) * m)
        if len(self.rates) != m or any(not 0 < rate < inf for rate in self.rates):
            raise InvalidInputError(
                f"rates: expected {m} speeds above 0, got {list(self.rates)!r:.200}"
            )
        if not self.widths:
            object.__setattr__(self, "widths", (1,) * m)
        check_widths(np.asarray(self.widths), m)
        for fault in self.faults:
            if not 1 <= fault.robot <= m:
                raise InvalidInputError(f"fault: expected a robot from 1 to {m}, got {fault}")
        if not self.signed and self.network.has("forgeries"):
            raise InvalidInputError(
                "network: expected a key together with forged messages, because robots without a"
                " key believe them, got none"
            )
        for name, cells in (("targets", self.targets), ("obstacles", self.obstacles)):
            if any(not 0 <= cell < n for cell in cells):
                raise InvalidInputError(
                    f"{name}: expected cells from 0 to {n - 1}, got {list(cells)!r:.200}"
                )
        self._check_obstacles()

    def _check_obstacles(self) -> None:
        if self.obstacles and not self.brief.tour_cost.stepwise:
            raise InvalidInputError(
                "obstacles: expected a tour with paths from cell to cell, got a tour with straight"
                " paths"
            )
        for number, start in enumerate(self.starts, start=1):
            if start in self.obstacles:
                raise InvalidInputError(
                    f"obstacles: expected no obstacle at the start of a robot, got cell {start},"
                    f" the start of robot {number}"
                )
        if self.brief.tour_cost.stepwise and any(
            isinstance(fault, WrongPosition) for fault in self.faults
        ):
            raise InvalidInputError(
                "fault: expected no wrong positions of robots that go from cell to cell, got a"
                " wrong position"
            )

    @property
    def size(self) -> int:
        """Size of the search: the number of robots, times the number of cells or half the square of
        the number of robots, whichever is larger.
        """
        robots = len(self.starts)
        return robots * max(len(self.brief.tour_cost), robots**2 // 2)

    @property
    def uncertain(self) -> bool:
        """Whether something can go wrong: faults, lost or changed messages, or obstacles."""
        return bool(self.faults or self.network.media or self.obstacles)

    @cached_property
    def blocked(self) -> int:
        """Bitset of the cells with obstacles."""
        return bitset_of(self.obstacles)

    def obstacle_on(self, source: int, through: tuple[int, ...]) -> tuple[int | None, int]:
        """Return the first obstacle on the path from ``source`` through the cells ``through``, and
        the number of cells before it.

        If the path is free, return None and the number of cells of the path.
        """
        distances = self.brief.tour_cost.distances
        if self.blocked and isinstance(distances, CellDistances):
            for index, (start, end) in enumerate(pairwise((source, *through))):
                for cell in (end, *distances.beside(start, end)):
                    if self.blocked >> cell & 1:
                        return cell, index
        return None, len(through)

    def path_length(self, source: int, through: tuple[int, ...]) -> float:
        """Return the length, in cell sides, of the path from the cell ``source`` through the cells
        ``through``.
        """
        total = 0.0
        for start, end in pairwise((source, *through)):
            total += self.brief.tour_cost.length(start, end)  # not sum, which rounds otherwise
        return total

    @cached_property
    def goal(self) -> int:
        """Bitset of the cells that at least one robot can reach."""
        reachable = 0
        for number in range(1, len(self.starts) + 1):
            reachable |= self.reach(number)
        return reachable

    def visible_cells(self, number: int, cell: int) -> int:
        """Return the bitset of cells that the robot with a given number sees from a cell."""
        width = self.widths[number - 1]
        return (
            1 << cell
            if width == 1
            else bitset_of(self.brief.tour_cost.visible_cells(cell, width).tolist())
        )

    def reach(self, number: int) -> int:
        """Return the bitset of cells that the robot with a given number can reach."""
        distances = self.brief.tour_cost.distances
        if not isinstance(distances, CellDistances):
            return self.brief.everything
        return distances.reach(self.starts[number - 1], self.blocked)


def scenario_of(problem: SearchProblem, plan: SearchPlan, seed: int) -> Scenario:
    """Return the scenario in which robots carry out a plan.

    Lengths in a scenario are in cell sides. A time of 1 in a scenario is the time in which a robot
    of speed 1 searches one cell.
    """
    vehicle, cell = problem.chosen_vehicle, plan.cell_seconds
    brief = Brief(
        plan.tour_cost,
        plan.allocation.allocator,
        multiplicity=problem.multiplicity,
        energy=working_seconds(vehicle) * float(plan.rates.min()) / cell,
        recharge=(vehicle.recharge_seconds + climbing_seconds(vehicle)) / cell,
        launch_distances=plan.launch_distances,
        delays=(
            tuple((plan.delays / cell).tolist())
            if plan.delays.any() or plan.schedule is not None
            else ()
        ),
    )
    cells = np.arange(len(plan.tour_cost))
    obstacles = _cells_of(
        plan, problem.obstacles, "obstacles", np.setdiff1d(cells, plan.starts), [seed, 2]
    )
    clear = np.setdiff1d(cells, obstacles)  # robots look from these cells
    scenario = Scenario(
        brief,
        tuple(plan.starts.tolist()),
        tuple(plan.rates.tolist()),
        network=network_of(problem.network, loss=problem.loss),
        faults=problem.faults + _crashes(problem, plan, seed),
        targets=_cells_of(plan, problem.targets, "targets", clear, [seed, 1]),
        detection=problem.chosen_detection,
        false_alarm=problem.false_alarm,
        obstacles=obstacles,
        widths=tuple(plan.widths.tolist()),
        signed=problem.key is not None,
        packet=problem.packet or 0,
        seed=seed,
    )
    if plan.flies and not scenario.uncertain and problem.live is None:
        return replace(scenario, brief=replace(brief, helping=False))
    return scenario


def _crashes(problem: SearchProblem, plan: SearchPlan, seed: int) -> tuple[Fault, ...]:
    """Return crashes of different robots. The robots and the times of their crashes are random.

    The latest possible time of a crash is twice the time in which a robot searches an equal share
    of the cells.
    """
    rng = np.random.default_rng([seed, 2])
    dead = rng.choice(problem.robots, size=problem.crashes, replace=False) + 1
    layers = layers_of(plan.grid)
    cells_each = sum(layer.region.area_m2 / layer.footprint**2 for layer in layers) / problem.robots
    return tuple(
        Crash(int(robot), float(rng.uniform(0, 2 * cells_each))) for robot in np.sort(dead)
    )


def _cells_of(
    plan: SearchPlan, value: Any, what: str, allowed: NDArray[np.int64], seed: list[int]
) -> tuple[int, ...]:
    """Return the tour indices of cells that are given as a number of random cells, as points, or as
    a file of points.

    A given point selects a cell in each layer that has one there. A random obstacle lies in all
    layers. A random target lies in one layer or, with a prior, where all layers show the same place.
    """
    if isinstance(value, int):
        columns = what == "obstacles" and isinstance(plan.grid, LayeredGrid)
        if columns:
            allowed = allowed[plan.tour.cells[allowed, 0] == 0]
        if value > len(allowed):
            where = (
                "one per cell without an obstacle"
                if what == "targets"
                else "no obstacle at the start of a robot"
            )
            raise InvalidInputError(
                f"{what}: expected a number from 0 to {len(allowed)}, {where}, got {value}"
            )
        if what == "targets" and isinstance(plan.ground, Ground):
            return _targets_of(plan.ground, value, allowed, seed)
        chosen = np.random.default_rng(seed).choice(allowed, size=value, replace=False)
        if not columns:
            return tuple(sorted(int(cell) for cell in chosen))
        inside = plan.positions(chosen)[:, :2]
    else:
        inside = points_inside(value, plan.grid.region, what=what)
    cells_by_layer = [(layer.whole or layer).cell_of(inside) for layer in layers_of(plan.grid)]
    if isinstance(plan.grid, LayeredGrid):
        cells_by_layer = [
            np.column_stack([np.full(len(cells), up), cells])
            for up, cells in enumerate(cells_by_layer)
        ]
    numbers = {
        int(number) for cells in cells_by_layer for number in plan.tour.position[tuple(cells.T)]
    }
    return tuple(sorted(numbers - {-1}))


def _targets_of(
    ground: Ground, count: int, allowed: NDArray[np.int64], seed: list[int]
) -> tuple[int, ...]:
    """Return the cells from which robots see so many random places of the ground, each of which
    they see from an allowed cell.
    """
    if count == 0:
        return ()
    masses = ground.masses * np.isin(ground.cells, allowed).any(axis=1)
    most = np.count_nonzero(masses)
    if count > most:
        raise InvalidInputError(
            f"targets: expected at most {most}, the places that may hold one by the prior and are"
            f" seen from a cell without an obstacle, got {count}"
        )
    rng = np.random.default_rng(seed)
    pieces = rng.choice(len(ground.masses), size=count, replace=False, p=masses / masses.sum())
    cells = np.unique(ground.cells[pieces])
    return tuple(cells[cells >= 0].tolist())
