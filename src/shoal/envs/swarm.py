"""SwarmEnv: mapping and coverage of a map by a swarm as a Gymnasium environment, one command a step."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from shoal.checks import shortened
from shoal.envs import observations
from shoal.envs.options import (
    OptionError,
    SwarmEnvOptions,
    check_no_options,
    check_render_mode,
    check_running,
    option_errors,
    split_fields,
)
from shoal.envs.rendering import MODES, close_window, enlarged, rendered
from shoal.errors import InvalidInputError
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.commands import LETTERS
from shoal.swarm.grid.placements import place
from shoal.swarm.grid.randomness import noise_rng, trial_rng
from shoal.swarm.grid.world import GridWorld, check_start
from shoal.swarm.maps.raster import PARTICLE
from shoal.swarm.noise.simulated import noisy_belief
from shoal.swarm.policies.paths import route_to_frontier, step_from
from shoal.swarm.policies.protocol import View
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.run import run
from shoal.swarm.simulation.exact import ExactSwarm
from shoal.swarm.simulation.noisy import NoisySwarm

_SEEDS = 2**31


class SwarmEnv(gymnasium.Env[NDArray[Any], Any]):
    """A swarm that maps or covers a map; an action is one command to all particles, ``lurd`` (in 3-D ``lurdio``) from 0 on.

    After ``reset(seed=s)`` particles, targets and noise are those of ``shoal.run(problem, seed=s)``; later resets draw their seeds,
    which ``info["seed"]`` tells. With ``scan_every`` an action is a run of so many equal commands, with a scan after it.

    Parameters
    ----------
    render_mode : str, optional
        "rgb_array", "ansi" or "human".
    **fields
        Of `SwarmProblem` and `SwarmEnvOptions`.

    Raises
    ------
    OptionError
        For options that cannot be; a ValueError and a gymnasium.error.Error.

    Notes
    -----
    Docs: docs/how-to/learning.md.

    Examples
    --------
    >>> env = SwarmEnv(map="line:9", particles=3, observation="compact")
    >>> observation, info = env.reset(seed=1)
    >>> observation.shape, info["action_mask"].tolist(), info["frontier"]
    ((21,), [1, 1, 1, 1], 11)
    """

    metadata: dict[str, Any] = {"render_modes": MODES, "render_fps": 10}  # noqa: RUF012 - as in its base

    def __init__(self, *, render_mode: str | None = None, **fields: Any) -> None:
        if "map" not in fields and fields.get("maps"):
            fields = {"map": fields["maps"][0], **fields}
        if "map" not in fields:
            raise OptionError("map: expected a map, or maps, got none")
        self.problem, self.options = split_fields(fields, SwarmProblem, SwarmEnvOptions)
        self.render_mode = check_render_mode(render_mode, MODES)
        self._problems = self._opened()
        self._worlds = [GridWorld(one.place, one.rule) for one in self._problems]
        self.window = tuple(max(sizes) for sizes in zip(*(world.layout.window for world in self._worlds), strict=True))
        self.observation_space = observations.observation_space(self.window, self.options, rule=self.problem.rule)
        self.action_space = gymnasium.spaces.Discrete(2 * len(self.window))
        self._scanning, self._mapping = self.problem.scanning, getattr(self.problem.chosen_task, "mapping", True)
        self._swarm: Any = None
        self._running = False

    def _opened(self) -> list[SwarmProblem]:
        """Return the problem of each map."""
        with option_errors():
            if self.problem.scan_every == "adaptive":
                raise InvalidInputError("scan_every: expected a number, doubling or hyper, as actions are commands, got adaptive")
            problems = [self.problem.replaced(map=name) for name in self.options.maps] or [self.problem]
            for one in problems:
                one.check_at_place()
            if len({len(one.place.shape) for one in problems}) > 1:
                raise InvalidInputError("maps: expected all of 2 dimensions or all of 3, got both")
        return problems

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begin an episode.

        Parameters
        ----------
        seed : int, optional
        options : dict, optional
            ``{"map": k}`` takes map k of ``maps`` instead of a random one.

        Raises
        ------
        OptionError
        """
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(_SEEDS)) if seed is None else seed
        index = self._chosen_map(options or {})
        problem, world, rng = self._problems[index], self._worlds[index], trial_rng(drawn, 0)
        with option_errors():
            if problem.start is None:
                start = place(problem.place, problem.particles, problem.placement, rng)
            else:
                start = check_start(problem.place, problem.start, rule=problem.rule)
            targets = problem.chosen_task.choose_targets(problem.place, rng)
            if problem.noise is None:
                state = world.initial(start)
                self._swarm = ExactSwarm(world, problem.chosen_task, state, problem.chosen_task.begin(world, state, targets))
            else:
                luck = noise_rng(drawn, 0)
                noisy = noisy_belief(problem.place, start, problem.noise, problem.confidence, luck)
                self._swarm = NoisySwarm(noisy, luck)
        self.moves, self._streak, self._last, self._last_row = 0, 0, -1, (0, 0)
        self._drawn = {"seed": drawn, "map": index}
        self._running = True
        self._layout: GridLayout = world.layout
        return self._told()

    def _chosen_map(self, options: dict[str, Any]) -> int:
        check_no_options(options, ("map",))
        chosen = options.get("map")
        if chosen is None:
            return int(self.np_random.integers(len(self._problems)))
        if not isinstance(chosen, int | np.integer) or not 0 <= chosen < len(self._problems):
            raise OptionError(f"reset: map: expected a number from 0 to {len(self._problems) - 1}, got {shortened(chosen)}")
        return int(chosen)

    def step(self, action: Any) -> tuple[NDArray[Any], float, bool, bool, dict[str, Any]]:
        """Send one command, or a run of equal ones, and look.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before a reset, and after the end of an episode.
        gymnasium.error.InvalidAction
        """
        check_running(self._running)
        if not self.action_space.contains(action):
            last = 2 * len(self.window) - 1
            raise gymnasium.error.InvalidAction(f"action: expected a whole number from 0 to {last}, got {shortened(action)}")
        self._streak, self._last = (self._streak + 1 if action == self._last else 0), int(action)
        steps = min(self._scanning.interval(self._streak), max(1, self.problem.max_moves - self.moves))
        rows, _ = self._swarm.carry_out(LETTERS[self._last], steps, scan=True)
        self.moves += steps
        self._last_row = (rows[-1][2], rows[-1][0])
        classified = sum(row[0] for row in rows)
        done = bool(self._swarm.finished)
        terminated = done or bool(self._swarm.belief.complete)
        truncated = not terminated and self.moves >= self.problem.max_moves
        reward = observations.rewards_of(np.array([classified]), np.array([steps]), np.array([done]), self.options)[0]
        self._running = not (terminated or truncated)
        observation, info = self._told()
        return observation, float(reward), terminated, truncated, info

    def _told(self) -> tuple[NDArray[Any], dict[str, Any]]:
        """Return observation and info, and show them to people who watch."""
        if self.render_mode == "human":
            self.render()
        planes = self.planes[None]
        mask = observations.action_masks(planes, rule=self.problem.rule, noisy=self.problem.noise is not None)[0]
        info = {"action_mask": mask, "moves": self.moves, "frontier": len(self._swarm.belief.frontier), **self._drawn}
        return self._observed(planes), info

    def _observed(self, planes: observations.Planes) -> NDArray[Any]:
        options = self.options
        if options.observation == "planes":
            return np.asarray(planes[0])
        if options.observation == "window" and options.center == "particles":
            centers = np.rint(observations.centers_of(planes)).astype(np.int64)
            return np.asarray(observations.windows_of(planes, centers, options.window)[0])
        path, nearest = self._nearest()
        if options.observation == "window":
            return np.asarray(observations.windows_of(planes, nearest, options.window)[0])
        commands, lengths = np.array([LETTERS.index(path[0]) if path else 0]), np.array([len(path)])
        moved = np.array([min(1.0, self.moves / max(1, self.problem.max_moves))])
        return np.asarray(observations.compact_of(planes, nearest, commands, lengths, moved)[0])

    def _nearest(self) -> tuple[str, NDArray[np.int64]]:
        """Return the shortest path of a particle to a frontier cell, and that cell's indices into planes."""
        belief, occupied = self._swarm.belief, self._swarm.state.occupied
        path, cell = route_to_frontier(
            belief, occupied, rule="block", mapping=self._mapping, ties="column-major", neighbours="lurd"
        )  # fmt: skip
        for command in path:
            cell = step_from(cell, command)
        return path, np.array([cell]) + 1 if path else np.zeros((1, len(self.window)), dtype=np.int64)

    @property
    def planes(self) -> observations.Planes:
        """What is known of all cells; uint8, shape (4, *window), one plane after another `shoal.envs.observations.PLANES`."""
        belief, state = self._swarm.belief, self._swarm.state
        planes = np.zeros((len(observations.PLANES), *self.window), dtype=np.uint8)
        planes[observations.OBSTACLES] = 1  # beyond the map, where another one is larger
        own = planes[(slice(None), *(slice(size) for size in self._layout.window))]
        own[observations.PARTICLES] = state.occupied.mask if state.counts is None else np.minimum(state.counts, 255)
        own[observations.FREE], own[observations.OBSTACLES] = belief.open.mask, belief.obstacles.mask
        own[observations.FRONTIER] = belief.frontier.mask
        return planes

    @property
    def view(self) -> View:
        """What a policy of `shoal.swarm` may see now."""
        occupied = self._swarm.state.occupied
        return View(self._swarm.belief, occupied, self.problem.rule, self._mapping, self.moves, *self._last_row)

    def expert_actions(self, policy: Any) -> list[int]:
        """Return the actions of a policy's whole episode, for the episode that has just begun.

        Parameters
        ----------
        policy : str or Policy

        Raises
        ------
        OptionError
            For a policy that cannot do it, and with ``scan_every``, since policies choose the lengths of their runs.
        """
        check_running(self._running)
        with option_errors():
            if not self._scanning.every_move:
                raise InvalidInputError(f"scan_every: expected 1 for the actions of a policy, got {self._scanning.every}")
            problem = self._problems[self._drawn["map"]].replaced(policy=policy)
            return [LETTERS.index(letter) for letter in run(problem, seed=self._drawn["seed"]).commands]

    def render(self) -> Any:
        """Return a picture (rgb_array), a text (ansi) or None (human: a window shows it).

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first reset.
        """
        check_running(self._swarm is not None)
        belief, occupied = self._swarm.belief, self._swarm.state.occupied
        return rendered(self, lambda: enlarged(belief.picture(occupied)), lambda: characters_of(belief, occupied))

    def close(self) -> None:
        """Close the window, if there is one."""
        close_window(self)


def characters_of(belief: Belief, occupied: Board) -> str:
    """Return what is known, one character a cell, rim included: o particle, . free, # obstacle, ? frontier, blank unknown."""
    codes = belief.states
    codes[occupied.mask] = PARTICLE
    layers = codes.reshape(-1, *codes.shape[-2:])
    return "\n\n".join("\n".join("".join(row) for row in np.array(list(" ?.#o"))[layer]) for layer in layers)
