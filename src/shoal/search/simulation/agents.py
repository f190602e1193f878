"""Many simulated searches whose robots are sent from cell to cell by agents, for environments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.core.random import world_generators
from shoal.search.cells.layers import layers_of
from shoal.search.kernels.protocol import agents
from shoal.search.planning.plan import plan_search, start_points
from shoal.search.problem import SearchProblem
from shoal.search.simulation.compiled import CompiledSearches, can_compile
from shoal.search.simulation.scenario import Scenario, scenario_of

PLANES = 5
SEEDS = 2**31
"""Exclusive upper limit of the seeds that are drawn for episodes without a given seed."""


class SearchBatch:
    """Simulated searches in which somebody else tells each robot where to go.

    World i starts like ``shoal.run(problem, seed=seed + i)``. A step takes the time that the fastest
    robot needs for one cell.

    Parameters
    ----------
    problem : SearchProblem
        A problem without obstacles, with one footprint.
    worlds : int
        Number of worlds.
    directions : array_like of int, shape (D, 3)
        Steps of the actions 1 to D: layers, rows and columns. In a grid of one layer, steps to
        other layers are left out. Without directions, action 1 + i selects cell i of the tour.
    max_steps : int
        Number of steps after which an episode is truncated.

    Attributes
    ----------
    terminated, truncated : ndarray of bool, shape (worlds,)
        An episode terminates when all cells are searched, or all robots have failed.
    seeds, steps : ndarray of int64, shape (worlds,)
    new : ndarray of int64, shape (worlds, robots)
        Number of cells that each robot searched in the latest step, and that too few robots had
        searched before.
    present, alive : ndarray of bool, shape (worlds, robots)
        Whether each robot worked before, and after, the latest step.

    Raises
    ------
    InvalidInputError
        If the problem is invalid, or if compiled code cannot simulate it.
    """

    def __init__(
        self, problem: SearchProblem, worlds: int, *, directions: Any = (), max_steps: int = 10_000
    ) -> None:
        self.problem, self.plan = problem, plan_search(problem)
        self.tour, self.max_steps = self.plan.tour, max_steps
        scenario = scenario_of(problem, self.plan, 0)
        if not can_compile(scenario) or scenario.brief.tour_cost.stepwise:
            raise InvalidInputError(
                "search: expected footprints of one cell and no obstacles in many worlds at once,"
                " got another problem, which shoal.envs.search_v0 simulates"
            )
        self._searches = CompiledSearches([scenario] * worlds, ordered=True)
        position, cells = self.tour.position, self.tour.cells
        n, m = len(cells), problem.robots
        flat = np.ravel_multi_index(tuple(cells.T), position.shape)
        offsets = np.asarray(directions, dtype=np.int64).reshape(-1, 3)
        if cells.shape[1] == 2:
            offsets = offsets[offsets[:, 0] == 0, 1:]
        around = cells[:, None] + offsets
        inside = np.all((around >= 0) & (around < position.shape), axis=2)
        beside = np.where(
            inside, position[tuple(np.moveaxis(np.where(inside[..., None], around, 0), 2, 0))], -1
        )
        self._lattice = agents.Lattice(
            np.ascontiguousarray(flat, dtype=np.int64),
            np.ascontiguousarray(beside, dtype=np.int64),
        )
        self._agents = agents.Agents(
            np.zeros(worlds, dtype=np.int64),
            np.zeros((worlds, n), dtype=np.int32),
            np.full(worlds, n, dtype=np.int64),
            np.zeros((worlds, m), dtype=np.int64),
            np.ones((worlds, m), dtype=np.uint8),
        )
        self.choices = 1 + (beside.shape[1] or n)
        self._views = agents.Views(
            np.zeros((worlds, m, PLANES, position.size), dtype=np.uint8),
            np.zeros((worlds, m, (n + 63) // 64), dtype=np.uint64),
            np.zeros((worlds, m), dtype=np.int64),
            np.zeros((worlds, m)),
            np.zeros((worlds, m, m), dtype=np.float32),
            np.zeros((worlds, m, self.choices), dtype=np.int8),
        )
        self.seeds = np.zeros(worlds, dtype=np.int64)
        self.terminated = np.zeros(worlds, dtype=np.bool_)
        self.truncated = np.zeros(worlds, dtype=np.bool_)
        self._length = 1 / max(scenario.rates)
        self._all = np.arange(worlds)
        self._rngs: list[Generator] = []

    def __len__(self) -> int:
        return len(self._all)

    @property
    def steps(self) -> NDArray[np.int64]:
        """Number of steps of each world."""
        return self._agents.steps

    @property
    def new(self) -> NDArray[np.int64]:
        """Number of cells that each robot searched anew in the latest step."""
        return self._agents.new

    @property
    def present(self) -> NDArray[np.bool_]:
        """Whether each robot worked before the latest step."""
        return self._agents.present.astype(np.bool_)

    @property
    def alive(self) -> NDArray[np.bool_]:
        """Whether each robot works."""
        return np.asarray(self._searches.worlds.robots["alive"] != 0)

    @property
    def complete(self) -> NDArray[np.bool_]:
        """Whether enough robots have searched every cell of each world; bool, shape (worlds,)."""
        return np.asarray(self._agents.left == 0)

    def chosen(self, where: NDArray[np.bool_] | None) -> NDArray[np.int64]:
        """Return the indices of the worlds that a mask selects; by default, of all."""
        return self._all if where is None else np.flatnonzero(where)

    def reset(
        self,
        where: NDArray[np.bool_] | None = None,
        *,
        seed: int | Sequence[int | None] | None = None,
    ) -> None:
        """Begin a new episode in all worlds, or in the worlds that ``where`` selects.

        From one integer ``seed``, world i gets the seed ``seed + i``. Without a seed, each world
        draws the seed of its next episode from its own random generator.

        Raises
        ------
        InvalidInputError
            If a seed is invalid, or a start lies outside the region.
        """
        chosen = self.chosen(where)
        rngs = world_generators(seed, chosen, len(self), self._rngs)
        seeds = [own if own is not None else int(rng.integers(SEEDS)) for own, rng in rngs]
        scenarios = [self._scenario(own) for own in seeds]
        if not self._rngs:
            self._rngs = [rng for _, rng in rngs]
        for world, own, scenario, (_, rng) in zip(
            chosen.tolist(), seeds, scenarios, rngs, strict=True
        ):
            self._rngs[world], self.seeds[world] = rng, own
            self._searches.begin(world, scenario)
            self._searches.run(world, 0.0)
        state, n = self._agents, len(self.tour)
        state.steps[chosen], state.scored[chosen], state.left[chosen] = 0, 0, n
        state.new[chosen], state.present[chosen] = 0, 1
        self.terminated[chosen] = self.truncated[chosen] = False
        views = self._views
        views.planes[chosen], views.shown[chosen] = 0, 0
        region = np.zeros(views.planes.shape[3], dtype=np.uint8)
        region[self._lattice.flat] = 1
        views.planes[chosen, :, 0] = region
        agents.look(self._lattice, self._searches.worlds, state, views, chosen, self._length)

    def _scenario(self, seed: int) -> Scenario:
        """Return the scenario of ``shoal.run(problem, seed=seed)``."""
        plan = self.plan
        places = start_points(self.problem, layers_of(plan.grid)[0], np.random.default_rng(seed))
        starts = self.tour.position[tuple(plan.grid.cell_of(places).T)]
        return scenario_of(self.problem, replace(plan, places=places, starts=starts), seed)

    def step(self, actions: NDArray[np.int64], where: NDArray[np.bool_] | None = None) -> None:
        """Let the selected worlds advance by a step.

        Parameters
        ----------
        actions : ndarray of int64, shape (worlds, robots)
            0 for a robot that continues or waits. Robots ignore an action that `masks` excludes.
        where : ndarray of bool, shape (worlds,), optional
        """
        chosen, searches, progress, begun = self.chosen(where), self._searches, 0, False
        while True:
            progress = agents.step(
                searches.tour,
                searches.rules,
                searches.partitions,
                self._lattice,
                searches.worlds,
                self._agents,
                self._views,
                chosen,
                actions,
                self._length,
                progress,
                begun,
            )
            if progress == len(chosen):
                break
            searches.serve(int(chosen[progress]))
            begun = True
        self.terminated[chosen] = (self._agents.left[chosen] == 0) | ~self.alive[chosen].any(axis=1)
        self.truncated[chosen] = ~self.terminated[chosen] & (
            self._agents.steps[chosen] >= self.max_steps
        )

    def masks(self, where: NDArray[np.bool_] | None = None) -> NDArray[np.int8]:
        """Return which actions the robots can take; int8, shape (worlds, robots, choices)."""
        return self._seen(self._views.masks, where)

    def _seen(self, values: NDArray[Any], where: NDArray[np.bool_] | None) -> NDArray[Any]:
        """Return a copy of the values of the selected worlds."""
        return values.copy() if where is None else values[where]

    def observed(self, where: NDArray[np.bool_] | None = None) -> dict[str, NDArray[Any]]:
        """Return what the robots of the selected worlds know, by name: for each world and robot the
        entries of an observation of `shoal.envs.search_v0`.
        """
        views, m = self._views, self.problem.robots
        planes, cells = self._seen(views.planes, where), self._seen(views.cells, where)
        full, steps = self._searches.rules.energy, self._seen(self._agents.steps, where)
        energy_share = np.ones(cells.shape) if full == inf else self._seen(views.left, where) / full
        return {
            "planes": planes.reshape(len(cells), m, PLANES, *self.tour.position.shape),
            "position": self.tour.cells[cells].astype(np.int64),
            "heard": self._seen(views.heard, where),
            "told": self._seen(self._searches.worlds.told, where),
            "energy": energy_share[..., None].astype(np.float32).clip(0, 1),
            "time": np.repeat(steps, m).reshape(-1, m, 1),
        }

    def codes(self, world: int) -> NDArray[np.int64]:
        """Return a code for each cell: 0 outside, 1 unsearched, 2 searched, 2 + k for a live robot
        k of n robots, and 2 + k + n for a dead robot, counted from 1.
        """
        w, m = self._searches.worlds, self.problem.robots
        codes = (self.tour.position >= 0).astype(np.int64)
        searched = self._agents.scored[world] >= self.problem.multiplicity
        codes[tuple(self.tour.cells[searched].T)] = 2
        for i in range(m):
            robot = w.robots[world, i]
            codes[tuple(self.tour.cells[int(robot.place)])] = 3 + i + m * (not robot.alive)
        return codes
