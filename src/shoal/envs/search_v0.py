"""A search as a parallel PettingZoo environment: each robot is an agent, messages can be lost, and
robots can fail.

The function ``search_v0.parallel_env(**options)`` creates the parallel environment, and
``search_v0.env(**options)`` creates its turn-based form.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import reduce
from math import inf
from operator import or_
from typing import Any

import gymnasium
import numpy as np
import pettingzoo
from numpy.typing import NDArray

from shoal.core.checks import check_integer, shortened
from shoal.envs.forms import observation_form
from shoal.envs.options import (
    SEEDS,
    TARGETS,
    OptionError,
    SearchEnvOptions,
    check_running,
    option_errors,
    split_fields,
)
from shoal.envs.rendering import MODES, check_render_mode, close_window, enlarged, rendered
from shoal.search.cells.layers import layers_of
from shoal.search.planning.plan import plan_search, start_points
from shoal.search.problem import SearchProblem
from shoal.search.protocol.robot import Decision, head_for
from shoal.search.protocol.state import Robot, obstacles, reachable_cells
from shoal.search.simulation.scenario import scenario_of
from shoal.search.simulation.world import SearchWorld
from shoal.search.tours.masks import at_least, bits_to_array, bitset_of

PLANES = ("region", "own", "searched", "obstacles", "found")
"""Planes of an agent's observation: the cells of the region, the agent's position, and what the
agent knows.

The planes ``searched``, ``obstacles`` and ``found`` show the searched cells, the obstacles and the
cells with findings that the agent knows.
"""

STATE_PLANES = ("region", "searched", "obstacles", "targets")
"""Planes of the state of a search: the cells of the region, the cells that enough robots have
searched, all obstacles, and the cells with a target.
"""

DIRECTIONS = ((0, 0, 0), (0, 0, -1), (0, -1, 0), (0, 0, 1), (0, 1, 0), (1, 0, 0), (-1, 0, 0))
"""Meaning of the actions 1 to 5: stay, left, up, right, down. With several layers, 6 and 7 move to
the layer above and below.
"""

Observation = dict[str, NDArray[Any]]


# PettingZoo has no types
class SearchParallelEnv(pettingzoo.ParallelEnv[str, Observation, Any]):  # type: ignore[misc]
    """An environment in which robots search a region without a coordinator; the agents are
    ``robot_1``, ``robot_2``, ....

    A step of the environment takes the time that the fastest robot needs for one cell. Action 0
    lets an idle robot wait, and lets a moving or searching robot continue. With the option
    ``action="direction"``, each other action selects the next cell that the robot searches: its
    present cell or a neighbouring cell (see `DIRECTIONS`). With the option ``action="cell"``,
    action 1 + i selects cell i of the tour, counted from 0. An action that
    ``infos[agent]["action_mask"]`` excludes counts as action 0. The environment simulates occupied
    cells, obstacles, energy, faults and messages as `shoal.search` does. After ``reset(seed=s)``,
    the start cells and the faults equal those of ``shoal.run(problem, seed=s)``.

    The observation of an agent contains only what its robot knows. The entry ``planes`` is uint8,
    shape (5, H, W) or (5, L, H, W), with the planes that `PLANES` names. The entry ``position``
    holds the row and the column of the robot's cell, after the layer if the grid has several
    layers. The entry ``heard`` holds, for each robot, the number of steps since a message last
    brought new data about the robot. In ``heard``, the agent's own robot has the value 0, and a
    robot without any message has the value -1. The entry ``told`` holds, for each robot, the number
    of cells that the robot has reported as searched. The entry ``energy`` is the remaining fraction
    of the robot's energy, and the entry ``time`` is the number of steps since the start. With the
    option ``observation``, an observation is one array (`shoal.envs.forms`). When a
    robot fails, its agent is terminated and leaves ``agents``. All agents are terminated when all
    reachable cells are searched, or with the option ``until="found"``, when all targets are found.
    All agents are truncated after ``max_cycles`` steps.

    With the field ``prior``, observations have the entry ``likely``, float32, shape (H, W) or (L, H,
    W): the probability that a target is in each cell, given all searches that the robot knows of.
    Each own search multiplies it by one minus the detection rate, and so does a search of another
    robot when a message first tells of it. Targets that move (option ``target_moves``) spread it.

    The attribute ``missing`` lists the cells of the targets that nobody has found, as tour indices.

    Parameters
    ----------
    render_mode : str, optional
        Render mode of the environment: "rgb_array" (pictures), "ansi" (texts) or "human" (a
        window).
    **fields
        Fields of the classes `SearchProblem` and `SearchEnvOptions`.

    Raises
    ------
    OptionError
        If an option is invalid. OptionError is a subclass of ValueError and of
        gymnasium.error.Error.

    Notes
    -----
    Source: paper H; docs/how-to/environments.md.

    Examples
    --------
    >>> env = parallel_env(region="square:30", robots=2, loss=0.5)
    >>> observations, infos = env.reset(seed=1)
    >>> env.agents, observations["robot_1"]["planes"].shape, infos["robot_1"]["action_mask"].tolist()
    (['robot_1', 'robot_2'], (5, 3, 3), [1, 1, 1, 1, 1, 1])
    """

    metadata: dict[str, Any] = {
        "name": "shoal_search_v0",
        "render_modes": MODES,
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(self, *, render_mode: str | None = None, **fields: Any) -> None:
        self.problem, self.options = split_search_fields({"region": "square:100", **fields})
        self.render_mode = check_render_mode(render_mode, MODES)
        with option_errors():
            self._plan = plan_search(self.problem)
            self._scenario = scenario_of(self.problem, self._plan, 0)
            asked = next((name for name in TARGETS if name in self.options.given), None)
            if asked is not None and not self._scenario.targets:
                raise OptionError(f"{asked}: expected targets together with it, got none")
            if self.options.target_moves and self.problem.obstacles not in (0, ()):
                raise OptionError(
                    "target_moves: expected no obstacles together with it, because targets move"
                    f" without regard to them, got {shortened(self.problem.obstacles)}"
                )
        self._tour = self._plan.tour
        self._numbers = {f"robot_{number}": number for number in range(1, self.problem.robots + 1)}
        self.possible_agents = list(self._numbers)
        self.agents: list[str] = []
        cells, robots, shape, most = (
            len(self._tour),
            self.problem.robots,
            self._tour.position.shape,
            self.options.max_cycles,
        )
        spaces: dict[str, gymnasium.Space[Any]] = {
            "planes": gymnasium.spaces.Box(0, 1, (len(PLANES), *shape), np.uint8),
            "position": gymnasium.spaces.Box(
                np.zeros(len(shape), np.int64), np.array(shape) - 1, dtype=np.int64
            ),
            "heard": gymnasium.spaces.Box(-1.0, float(most), (robots,), np.float32),
            "told": gymnasium.spaces.Box(0, cells, (robots,), np.int64),
            "energy": gymnasium.spaces.Box(0.0, 1.0, (1,), np.float32),
            "time": gymnasium.spaces.Box(0, most, (1,), np.int64),
        }
        self._odds = self._plan.tour_cost.odds
        if self._odds is not None:
            spaces["likely"] = gymnasium.spaces.Box(0.0, 1.0, shape, np.float32)
        self._beside = _beside(self._tour.position) if self.options.target_moves else []
        self._spread = _spread(self._beside, self.options.target_moves) if self._beside else None
        self._count = 1 + (
            cells if self.options.action == "cell" else len(DIRECTIONS) - 2 * (len(shape) == 2)
        )
        self._form = observation_form(
            self.options.observation, gymnasium.spaces.Dict(spaces), dimensions=len(shape)
        )
        self.observation_spaces = dict.fromkeys(self.possible_agents, self._form.space)
        self.action_spaces = {
            agent: gymnasium.spaces.Discrete(self._count) for agent in self.possible_agents
        }
        numbers = len(STATE_PLANES) * self._tour.position.size + robots * (len(shape) + 2) + 1
        self.state_space = gymnasium.spaces.Box(0.0, 1.0, (numbers,), np.float32)
        self._rng = np.random.default_rng()
        self._world: SearchWorld | None = None

    def observation_space(self, agent: str) -> gymnasium.Space[Any]:
        """Return the space of the observations of an agent."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> gymnasium.Space[Any]:
        """Return the space of the actions of an agent."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Start an episode; the argument ``options`` has no effect.

        Options are not refused, because PettingZoo's own check of environments passes one that
        no environment knows.

        Raises
        ------
        OptionError
            If the seed is no seed, or a start position lies outside the region.
        """
        if seed is not None:
            with option_errors():
                seed = check_integer(seed, what="seed", least=0)
            self._rng = np.random.default_rng(seed)
        self._drawn = int(self._rng.integers(SEEDS)) if seed is None else seed
        plan, problem = self._plan, self.problem
        with option_errors():
            places = start_points(
                problem, layers_of(plan.grid)[0], np.random.default_rng(self._drawn)
            )
            starts = self._tour.position[tuple(plan.grid.cell_of(places).T)]
            self._scenario = scenario_of(
                problem, replace(plan, places=places, starts=starts), self._drawn
            )
        self._orders: dict[int, int] = {}
        self._masks: dict[int, NDArray[np.int8]] = {}
        self.missing = list(self._scenario.targets)
        self._moves = np.random.default_rng([self._drawn, 3])
        self._world = SearchWorld(self._scenario, decide=self._decide)
        self._beliefs = {
            number: _Belief(self._odds.copy())
            for number in self._numbers.values()
            if self._odds is not None
        }
        self.steps, self._length = 0, 1 / max(self._scenario.rates)
        self.agents = list(self.possible_agents)
        self._world.run(until=0.0)
        self._watch()
        return self._observations(self.agents), self._infos(self.agents)

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[
        dict[str, Observation],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Apply the actions of all agents, and advance the simulation by one step.

        When no agents are left, a step without actions changes nothing and returns empty dicts, as
        SuperSuit's ``black_death`` expects.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the method is called before a reset, or with actions when no agents are left.
        gymnasium.error.InvalidAction
            If the action of an agent is invalid or missing, or if no agent has such a name.
        """
        if self._world is not None and not self.agents and actions == {}:
            return {}, {}, {}, {}, {}
        check_running(bool(self.agents))
        assert self._world is not None
        if isinstance(actions, dict) and (unknown := actions.keys() - self._numbers.keys()):
            raise gymnasium.error.InvalidAction(
                f"actions: expected names from {self.possible_agents[0]} to"
                f" {self.possible_agents[-1]}, got {shortened(min(unknown, key=str))}"
            )
        world, agents, time = self._world, self.agents, self.steps * self._length
        for agent in agents:
            number, choice = self._numbers[agent], self._checked(agent, actions)
            if choice and self._masks[number][choice]:
                self._orders[number] = self._cell(number, choice)
                world.prompt(number, time)
        before = dict(world.searched)
        self.steps += 1
        world.run(until=self.steps * self._length + 1e-9)
        found = self._found()
        done = not self._scenario.goal & ~at_least(
            list(world.searched.values()), self.problem.multiplicity
        )
        if self.options.until == "found":
            done = not self.missing
        dead = {agent: not world.vehicles[self._numbers[agent]].alive for agent in agents}
        late = self.steps >= self.options.max_cycles
        rewards = self._rewards(agents, before, found)
        self._move_targets()
        self._learn()
        for agent in agents:
            rewards[agent] += (
                self.options.final_bonus * (done and not dead[agent]) - self.options.step_price
            )
        terminations = {agent: done or dead[agent] for agent in agents}
        truncations = {agent: late and not terminations[agent] for agent in agents}
        self.agents = [agent for agent in agents if not (terminations[agent] or truncations[agent])]
        self._watch()
        return self._observations(agents), rewards, terminations, truncations, self._infos(agents)

    def _checked(self, agent: str, actions: Any) -> int:
        last = self._count - 1
        choice: Any = actions.get(agent) if isinstance(actions, dict) else actions
        if not isinstance(actions, dict) or not self.action_spaces[agent].contains(choice):
            raise gymnasium.error.InvalidAction(
                f"{agent}: expected an action from 0 to {last}, got {shortened(choice)}"
            )
        return int(choice)

    def _found(self) -> dict[int, int]:
        """Return how many missing targets each robot has found in a step, and miss them no more."""
        assert self._world is not None
        found = dict.fromkeys(self._numbers.values(), 0)
        for number, cell in self._world.finds:
            while cell in self.missing:
                self.missing.remove(cell)
                found[number] += 1
        self._world.finds.clear()
        return found

    def _move_targets(self) -> None:
        """Move the targets that nobody has found yet."""
        assert self._world is not None
        if not self.options.target_moves:
            return
        for index, cell in enumerate(self.missing):
            near = self._beside[cell]
            if len(near) and self._moves.random() < self.options.target_moves:
                self.missing[index] = int(self._moves.choice(near))
        self._world.scenario = replace(self._world.scenario, targets=tuple(self.missing))

    def _learn(self) -> None:
        """Update what each robot believes by what it has learned in a step."""
        assert self._world is not None
        detection, n = self.problem.chosen_detection, len(self._tour)
        for number, belief in self._beliefs.items():
            robot, visits = self._robot(number), self._world.vehicles[number].visits
            own = 0
            for _, cell in visits[belief.visits :]:
                seen = self._world.scenario.visible_cells(number, cell)
                belief.odds[bits_to_array(seen, n)] *= 1.0 - detection
                own |= seen
            known = reduce(or_, robot.searched.values(), 0)
            others = known & ~belief.known & ~own
            belief.odds[bits_to_array(others, n)] *= 1.0 - detection
            belief.known, belief.visits = known | belief.known, len(visits)
            if self._spread is not None:
                belief.odds = self._spread @ belief.odds

    def _rewards(
        self, agents: list[str], before: dict[int, int], found: dict[int, int]
    ) -> dict[str, float]:
        """Return the reward of each agent for newly searched cells and found targets, or the mean of
        all rewards if the reward is shared.
        """
        assert self._world is not None
        rewards: dict[str, float] = {}
        for agent in agents:
            number = self._numbers[agent]
            searched = self._world.searched[number]
            new = (
                searched
                & ~before[number]
                & ~at_least(list(before.values()), self.problem.multiplicity)
            )
            before[number] = searched
            rewards[agent] = (
                self.options.searched_reward * new.bit_count()
                + self.options.found_reward * found[number]
            )
        mean = sum(rewards.values()) / len(agents)
        return dict.fromkeys(agents, mean) if self.options.reward == "shared" else rewards

    # Decisions and knowledge of the agents.

    def _decide(self, robot: Robot, time: float) -> Decision:
        """Return the decision to go to the cell that the agent has chosen, or to wait (see
        `shoal.search.protocol.robot`).
        """
        cell = self._orders.pop(robot.number, None)
        return (
            (robot.replaced(status="waiting"), None, inf)
            if cell is None
            else head_for(robot.replaced(aim=cell), cell, time)
        )

    def _robot(self, number: int) -> Robot:
        assert self._world is not None
        return self._world.vehicles[number].robot

    def _cell(self, number: int, choice: int) -> int:
        """Return the tour index of the cell that an action selects, or -1 if the action selects no
        cell.
        """
        if self.options.action == "cell":
            return choice - 1
        position = self._tour.position
        cell = self._tour.cells[self._robot(number).cell] + np.array(
            DIRECTIONS[choice - 1][-position.ndim :]
        )
        inside = (cell >= 0).all() and (cell < position.shape).all()
        return int(position[tuple(cell)]) if inside else -1

    def _mask(self, number: int) -> NDArray[np.int8]:
        """Return a mask of the actions that an agent can take; int8, shape (actions,)."""
        assert self._world is not None
        robot, vehicle = self._robot(number), self._world.vehicles[number]
        mask = np.zeros(self._count, dtype=np.int8)
        mask[0] = 1
        if (
            vehicle.alive
            and robot.target is None
            and vehicle.paused_until <= self.steps * self._length
        ):
            there = reachable_cells(robot, -inf)[0] & ~obstacles(robot)
            cells = [self._cell(number, choice) for choice in range(1, len(mask))]
            mask[1:] = [cell >= 0 and there >> cell & 1 for cell in cells]
        return mask

    def _observations(self, agents: list[str]) -> dict[str, Any]:
        if not agents:
            return {}
        each = [self._seen(self._numbers[agent]) for agent in agents]
        if self._form.same:
            return dict(zip(agents, each, strict=True))
        stacked = {name: np.stack([seen[name] for seen in each]) for name in each[0]}
        return dict(zip(agents, self._form(stacked), strict=True))

    def _seen(self, number: int) -> Observation:
        """Return the observation of an agent before it gets its form."""
        robot, robots = self._robot(number), self.problem.robots
        known = at_least(list(robot.searched.values()), self.problem.multiplicity)
        sets = (
            robot.brief.everything,
            1 << robot.cell,
            known,
            obstacles(robot),
            sum(1 << cell for cell in robot.found),
        )
        heard = np.full(robots, -1.0, dtype=np.float32)
        for other, peer in robot.peers.items():
            if other <= robots:
                heard[other - 1] = self.steps - peer.heard / self._length
        heard[number - 1] = 0.0
        reported = np.array(
            [robot.searched.get(other, 0).bit_count() for other in range(1, robots + 1)],
            dtype=np.int64,
        )
        left = 1.0 if robot.brief.energy == inf else robot.left / robot.brief.energy
        told: Observation = {}
        if number in self._beliefs:
            odds = self._beliefs[number].odds
            likely = np.zeros(self._tour.position.shape, dtype=np.float32)
            likely[tuple(self._tour.cells.T)] = odds / max(float(odds.sum()), 1e-300)
            told["likely"] = likely
        return told | {
            "planes": self._planes(sets),
            "position": self._tour.cells[robot.cell].astype(np.int64),
            "heard": heard.clip(-1, None),
            "told": reported,
            "energy": np.array([left], dtype=np.float32).clip(0, 1),
            "time": np.array([self.steps], dtype=np.int64),
        }

    def state(self) -> NDArray[np.float32]:
        """Return what is true of the whole search, which no agent knows, for critics that are
        trained with the state.

        Returns
        -------
        ndarray of float32, one axis, numbers from 0 to 1
            First the planes of `STATE_PLANES`, cell by cell. Then for each robot: whether it works,
            its true cell (layer, row and column as shares of the last layer, row and column), and
            the remaining share of its energy. Last the share of ``max_cycles`` that is over.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the method is called before the first reset.
        """
        check_running(self._world is not None)
        assert self._world is not None
        world, tour, n = self._world, self._tour, len(self._tour)
        done = at_least(list(world.searched.values()), self.problem.multiplicity)
        sets = ((1 << n) - 1, done, self._scenario.blocked, bitset_of(self._scenario.targets))
        planes = self._planes(sets).astype(np.float32)
        last = np.maximum(np.array(tour.position.shape) - 1, 1)
        full = self._scenario.brief.energy
        robots = [
            [
                vehicle.alive,
                *(tour.cells[vehicle.place] / last),
                1.0 if full == inf else min(max(vehicle.energy / full, 0.0), 1.0),
            ]
            for vehicle in world.vehicles.values()
        ]
        time = min(self.steps / self.options.max_cycles, 1.0)
        return np.concatenate([planes.ravel(), np.ravel(robots), [time]], dtype=np.float32)

    def _planes(self, sets: Sequence[int]) -> NDArray[np.uint8]:
        """Return a plane for each bitset of cells."""
        planes = np.zeros((len(sets), *self._tour.position.shape), dtype=np.uint8)
        for plane, bits in zip(planes, sets, strict=True):
            plane[tuple(self._tour.cells[bits_to_array(bits, len(self._tour))].T)] = 1
        return planes

    def _infos(self, agents: list[str]) -> dict[str, dict[str, Any]]:
        self._masks = {self._numbers[agent]: self._mask(self._numbers[agent]) for agent in agents}
        return {
            agent: {"action_mask": self._masks[self._numbers[agent]].copy(), "seed": self._drawn}
            for agent in agents
        }

    # Rendering.

    def _watch(self) -> None:
        if self.render_mode == "human":
            self.render()

    def render(self) -> Any:
        """Return a picture (mode "rgb_array") or a text (mode "ansi"), or show a picture in a
        window (mode "human").

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the method is called before the first reset.
        """
        check_running(self._world is not None)
        return rendered(self, self._picture, self._text)

    def _codes(self) -> NDArray[np.int64]:
        """Return a code for each cell: 0 outside, 1 unsearched, 2 searched, and other codes for the
        robots.

        A cell has the code 2 + k for live robot k of n robots, and the code 2 + k + n for dead
        robot k, counted from 1.
        """
        assert self._world is not None
        codes = (self._tour.position >= 0).astype(np.int64)
        done = at_least(list(self._world.searched.values()), self.problem.multiplicity)
        codes[tuple(self._tour.cells[bits_to_array(done, len(self._tour))].T)] = 2
        for number, vehicle in self._world.vehicles.items():
            codes[tuple(self._tour.cells[vehicle.place])] = (
                2 + number + self.problem.robots * (not vehicle.alive)
            )
        return codes

    def _text(self) -> str:
        return search_text(self._codes(), self.problem.robots)

    def _picture(self) -> NDArray[np.uint8]:
        return search_picture(self._codes(), self.problem.robots)

    def close(self) -> None:
        """Close the window of the environment if the environment has opened one."""
        close_window(self)


class _Belief:
    """What a robot believes of the target: a weight of each cell, the cells that it knows to be
    searched, as a bitset, and how many of its own searches the weights contain.
    """

    def __init__(self, odds: NDArray[np.float64]) -> None:
        self.odds, self.known, self.visits = odds, 0, 0


def split_search_fields(fields: Mapping[str, Any]) -> tuple[SearchProblem, SearchEnvOptions]:
    """Return the problem and the options of a search environment.

    Raises
    ------
    OptionError
        If a field is unknown or invalid, or a prior is one that agents cannot observe.
    """
    problem, options = split_fields(fields, SearchProblem, SearchEnvOptions)
    if not problem.prior:
        return problem, options
    if problem.moves:
        raise OptionError(
            "prior: expected a target that stands still, or one that moves by target_moves, got one"
            " that drifts"
        )
    if problem.passes > 1 or len(problem.altitudes) > 1:
        raise OptionError(
            "prior: expected one pass at one altitude together with it, got several layers"
        )
    # the agents choose the order, and which cells they search again
    return problem.replaced(at_most=1.0), options


def _beside(position: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Return, for each tour index, those of the cells beside it in the same layer."""
    padded = np.pad(position, [(0, 0)] * (position.ndim - 2) + [(1, 1)] * 2, constant_values=-1)
    inner = [slice(None)] * (position.ndim - 2)
    around = [
        padded[
            (*inner, slice(1 + y, padded.shape[-2] - 1 + y), slice(1 + x, padded.shape[-1] - 1 + x))
        ]
        for y, x in ((-1, 0), (0, -1), (0, 1), (1, 0))
    ]
    near = np.stack(around, axis=-1)[position >= 0]
    order = np.argsort(position[position >= 0])
    return [row[row >= 0] for row in near[order]]


def _spread(beside: list[NDArray[np.int64]], moves: float) -> Any:
    """Return the matrix that moves probabilities to cells beside them; sparse, shape (N, N)."""
    from scipy.sparse import csr_array

    counts = np.array([len(near) for near in beside])
    n = np.arange(len(beside))
    stays = np.where(counts > 0, 1.0 - moves, 1.0)
    shares = np.repeat(moves / np.maximum(counts, 1), counts)
    rows = np.concatenate([n, *beside])
    columns = np.concatenate([n, np.repeat(n, counts)])
    return csr_array((np.concatenate([stays, shares]), (rows, columns)))


def _stacked(codes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return codes in two dimensions: several layers vertically, with the lowest layer on top and
    an empty row between two layers.
    """
    if codes.ndim == 2:
        return codes
    return np.pad(codes, ((0, 0), (0, 1), (0, 0))).reshape(-1, codes.shape[2])[:-1]


def search_text(codes: NDArray[np.int64], robots: int) -> str:
    """Return one character per cell: blank outside, ? unsearched, . searched, a digit for a robot,
    x for a dead robot.
    """
    signs = np.array(
        [*" ?.", *(str(number % 10) for number in range(1, robots + 1)), *"x" * robots]
    )
    return "\n".join("".join(row) for row in signs[_stacked(codes)])


def search_picture(codes: NDArray[np.int64], robots: int) -> NDArray[np.uint8]:
    """Return a picture of a search; uint8, shape (height, width, 3)."""
    from shoal.views.drawing.charts import MUTED
    from shoal.views.search.history import robot_colour

    colours = [
        "#ffffff",
        "#b9c0ca",
        "#e8f1e4",
        *(robot_colour(k) for k in range(robots)),
        *[MUTED] * robots,
    ]
    rgb = np.array([tuple(bytes.fromhex(colour[1:])) for colour in colours], dtype=np.uint8)
    return enlarged(rgb[_stacked(codes)])


def parallel_env(**fields: Any) -> SearchParallelEnv:
    """Return the parallel environment with the options of `SearchParallelEnv`."""
    return SearchParallelEnv(**fields)


def env(**fields: Any) -> Any:
    """Return the environment in the turn-based form of PettingZoo, with the options of
    `SearchParallelEnv`.
    """
    from pettingzoo.utils.conversions import parallel_to_aec

    return parallel_to_aec(parallel_env(**fields))
