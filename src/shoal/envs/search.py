"""Searches in compiled code: `SearchEnv` with one simulated search, `SearchVectorEnv` with many. Each
step has one action for each robot.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv
from numpy.typing import NDArray

from shoal.core.checks import shortened
from shoal.envs.forms import observation_form
from shoal.envs.options import (
    TARGETS,
    OptionError,
    SearchEnvOptions,
    check_no_options,
    option_errors,
)
from shoal.envs.search_v0 import (
    DIRECTIONS,
    PLANES,
    search_picture,
    search_text,
    split_search_fields,
)
from shoal.envs.worlds import WorldEnv, Worlds, WorldsVectorEnv
from shoal.search.problem import SearchProblem
from shoal.search.simulation.agents import SearchBatch


class SearchWorlds(Worlds):
    """The simulated searches of an environment.

    Parameters
    ----------
    count : int
        Number of simulated searches.
    **fields
        Fields of the classes `SearchProblem` and `SearchEnvOptions`.

    Raises
    ------
    OptionError
        If a field is unknown or invalid, or if compiled code cannot simulate the problem.
    """

    batch: SearchBatch
    action_space: gymnasium.spaces.MultiDiscrete

    def __init__(self, count: int, *, pictured: bool = False, **fields: Any) -> None:
        self.problem, self.options = split_search_fields(fields)
        if self.options.reward != "shared":
            raise OptionError(
                "reward: expected shared, because a step has one reward for all robots (info"
                f' "rewards" has one for each), got {shortened(self.options.reward)}'
            )
        asked = next((name for name in TARGETS if name in self.options.given), None)
        if asked is not None:
            raise OptionError(
                f"{asked}: expected no such option, because only search_v0 knows targets, got"
                f" {shortened(getattr(self.options, asked))}"
            )
        with option_errors():
            self.batch = SearchBatch(
                self.problem,
                count,
                directions=DIRECTIONS if self.options.action == "direction" else (),
                max_steps=self.options.max_cycles,
            )
        shape, robots = self.batch.tour.position.shape, self.problem.robots
        cells, most = len(self.batch.tour), self.options.max_cycles
        last = np.broadcast_to(np.array(shape) - 1, (robots, len(shape)))
        box = gymnasium.spaces.Box
        spaces: dict[str, gymnasium.Space[Any]] = {
            "planes": box(0, 1, (robots, len(PLANES), *shape), np.uint8),
            "position": box(np.zeros_like(last), last, dtype=np.int64),
            "heard": box(-1.0, float(most), (robots, robots), np.float32),
            "told": box(0, cells, (robots, robots), np.int64),
            "energy": box(0.0, 1.0, (robots, 1), np.float32),
            "time": box(0, most, (robots, 1), np.int64),
        }
        self.form = observation_form(
            self.options.observation, gymnasium.spaces.Dict(spaces), dimensions=len(shape)
        )
        self.action_space = gymnasium.spaces.MultiDiscrete([self.batch.choices] * robots)
        self._rewards = np.zeros((count, robots))

    def reset(
        self,
        where: NDArray[np.bool_] | None = None,
        *,
        seed: Any = None,
        options: dict[str, Any] | None = None,
    ) -> None:
        """Start episodes as `SearchBatch.reset` does. Searches have no reset options."""
        check_no_options(options)
        with option_errors():
            self.batch.reset(where, seed=seed)
        self._rewards[slice(None) if where is None else where] = 0.0

    def step(
        self, actions: Any, where: NDArray[np.bool_] | None = None
    ) -> tuple[NDArray[np.float64], None]:
        """Send an action to each robot of each world, and return the rewards and None."""
        batch, options = self.batch, self.options
        batch.step(self._checked(actions, where), where)
        present, alive = batch.present, batch.alive
        price = options.final_bonus * (batch.complete[:, None] & alive) - options.step_price
        shares = options.searched_reward * batch.new + price
        chosen = slice(None) if where is None else where
        self._rewards[chosen] = np.where(present, shares, 0.0)[chosen]
        rewards = np.zeros(len(batch))
        rewards[chosen] = (self._rewards.sum(axis=1) / present.sum(axis=1).clip(1))[chosen]
        return rewards, None

    def _checked(self, actions: Any, where: NDArray[np.bool_] | None) -> NDArray[np.int64]:
        shape, last = (len(self.batch), self.problem.robots), self.batch.choices - 1
        try:
            given = np.asarray(actions)
        except ValueError:
            given = np.zeros(0)
        chosen = slice(None) if where is None else where
        if (
            given.shape != shape
            or given.dtype.kind not in "iu"
            or ((given < 0) | (given > last))[chosen].any()
        ):
            raise gymnasium.error.InvalidAction(
                f"actions: expected {shape[1]} whole numbers from 0 to {last} per environment, of"
                f" shape {shape}, got {shortened(actions)}"
            )
        return np.ascontiguousarray(given, dtype=np.int64)

    def seen(
        self, where: NDArray[np.bool_] | None = None, out: Any = None
    ) -> dict[str, NDArray[Any]]:
        """Return the observations by name, as new arrays with a row for each world and robot; the
        argument ``out`` has no effect.
        """
        return self.batch.observed(where)

    def info(self, where: NDArray[np.bool_] | None = None) -> dict[str, NDArray[Any]]:
        """Return for each world the actions that its robots can take (``action_mask``), which of
        them work (``alive``), the reward of each (``rewards``), and the seed.
        """
        batch = self.batch
        chosen = batch.chosen(where)
        return {
            "action_mask": batch.masks(where),
            "alive": batch.alive[chosen],
            "rewards": self._rewards[chosen].copy(),
            "seed": batch.seeds[chosen].copy(),
        }

    def action_masks(self) -> NDArray[np.bool_]:
        """Return which actions the robots of each world can take."""
        return np.asarray(self.batch.masks(), dtype=np.bool_)

    def characters(self, world: int) -> str:
        """Return a search as text, with one character for each cell."""
        return search_text(self.batch.codes(world), self.problem.robots)

    def picture(self, world: int) -> NDArray[np.uint8]:
        """Return a picture of a search; uint8, shape (height, width, 3)."""
        return search_picture(self.batch.codes(world), self.problem.robots)


class SearchEnv(WorldEnv, gymnasium.Env[Any, Any]):
    """An environment for the search of a region by robots: an action tells all robots where to go.

    The cells, messages, faults and observations are those of `shoal.envs.search_v0`, but one
    policy gets what all robots know, and each array has a row for each robot. So a policy with
    shared parameters treats the rows as a batch. The simulation is compiled code; the numbers are
    the same. The reward is the mean of the rewards of the robots that worked before the step, and
    ``info["rewards"]`` has them all. A robot that fails keeps its last observation, its actions
    have no effect, and ``info["alive"]`` is false. The episode terminates when all cells are
    searched, or when no robot works any more, and is truncated after ``max_cycles`` steps.

    Parameters
    ----------
    render_mode : str, optional
        Render mode of the environment: "rgb_array" (pictures), "ansi" (texts) or "human" (a
        window).
    **fields
        Fields of the classes `SearchProblem` and `SearchEnvOptions`. Compiled code simulates one
        footprint for all robots, no obstacles, and no key, packet, replays or forgeries.

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
    >>> env = SearchEnv(region="square:30", robots=2, loss=0.5)
    >>> observation, info = env.reset(seed=1)
    >>> observation["planes"].shape, info["action_mask"].tolist()
    ((2, 5, 3, 3), [[1, 1, 1, 1, 1, 1], [1, 1, 1, 1, 1, 1]])
    >>> observation, reward, terminated, truncated, info = env.step([1, 1])
    >>> round(reward, 2), info["rewards"].tolist()
    (0.4, [0.9, -0.1])
    """

    worlds = SearchWorlds
    _worlds: SearchWorlds
    problem: SearchProblem
    options: SearchEnvOptions

    def action_masks(self) -> NDArray[np.bool_]:
        """Return which actions each robot can take, as ``info["action_mask"]`` does; bool, shape
        (robots, actions).
        """
        return np.asarray(self._worlds.action_masks()[0])


class SearchVectorEnv(WorldsVectorEnv, VectorEnv[Any, Any, Any]):
    """A vector of environments, each of which behaves exactly like a `shoal.envs.SearchEnv` with
    the same seed.

    The function `gymnasium.make_vec` returns a SearchVectorEnv.

    Parameters
    ----------
    num_envs : int
    autoreset_mode, render_mode : str, optional
        Autoreset mode and render mode, as in `SwarmVectorEnv`.
    copy : bool
        The parameter has no effect, because observations of searches are always new arrays.
    **fields
        The options of `SearchEnv`.

    Examples
    --------
    >>> envs = gymnasium.make_vec("shoal/Search-v0", num_envs=3, robots=4)
    >>> observations, infos = envs.reset(seed=1)
    >>> observations["planes"].shape
    (3, 4, 5, 10, 10)
    >>> observations["planes"].reshape(12, 5, 10, 10).shape  # a row for each robot
    (12, 5, 10, 10)
    """

    worlds = SearchWorlds
    _worlds: SearchWorlds
    problem: SearchProblem
    options: SearchEnvOptions

    def action_masks(self) -> NDArray[np.bool_]:
        """Return which actions each robot can take; bool, shape (num_envs, robots, actions)."""
        return np.asarray(self._worlds.action_masks())
