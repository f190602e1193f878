"""SwarmEnv: mapping and coverage by a swarm as a Gymnasium environment, one command per step."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError
from shoal.envs.options import check_render_mode, check_running, option_errors
from shoal.envs.rendering import MODES, close_window, rendered
from shoal.envs.swarm_worlds import SwarmWorlds
from shoal.swarm.grid.commands import LETTERS
from shoal.swarm.policies.protocol import View
from shoal.swarm.run import run


class SwarmEnv(gymnasium.Env[NDArray[Any], Any]):
    """The task: explore a map with a swarm.

    An action is one command to all particles: its index in ``lurd`` (in 3-D ``lurdio``), from 0.

    After ``reset(seed=s)``, the particles, targets and noise equal those of ``shoal.run(problem, seed=s)``. Each later reset
    without a seed draws one, and returns it in ``info["seed"]``. With ``scan_every``, an action is a run of equal commands followed
    by a scan.

    Parameters
    ----------
    render_mode : str, optional
        "rgb_array", "ansi" or "human".
    **fields
        Fields of `SwarmProblem` and `SwarmEnvOptions`.

    Raises
    ------
    OptionError
        If an option is invalid. OptionError is a ValueError and a gymnasium.error.Error.

    Notes
    -----
    Docs: docs/how-to/environments.md.

    Examples
    --------
    >>> env = SwarmEnv(map="line:9", particles=3, observation="compact")
    >>> observation, info = env.reset(seed=1)
    >>> observation.shape, info["action_mask"].tolist(), info["frontier"]
    ((21,), [1, 1, 1, 1], 11)
    """

    metadata: dict[str, Any] = {"render_modes": MODES, "render_fps": 10}  # noqa: RUF012 - as in its base

    def __init__(self, *, render_mode: str | None = None, **fields: Any) -> None:
        self._worlds = SwarmWorlds(1, **fields)
        self.render_mode = check_render_mode(render_mode, MODES)
        self.problem, self.options = self._worlds.problem, self._worlds.options
        self.observation_space, self.action_space = self._worlds.observation_space, self._worlds.action_space
        self._begun = self._running = False
        self._last_row = (0, 0)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begin an episode.

        Parameters
        ----------
        seed : int, optional
        options : dict, optional
            ``{"map": k}`` selects map k of ``maps`` instead of a random one.

        Raises
        ------
        OptionError
        """
        super().reset(seed=seed)
        self._worlds.reset(seed=[seed], options=options)
        self._begun = self._running = True
        self._last_row = (0, 0)
        return self._told()

    def step(self, action: Any) -> tuple[NDArray[Any], float, bool, bool, dict[str, Any]]:
        """Send one command, or a run of equal commands, and observe.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before a reset, and after the end of an episode.
        gymnasium.error.InvalidAction
        """
        check_running(self._running)
        if not self.action_space.contains(action):
            last = int(self._worlds.action_space.n) - 1
            raise gymnasium.error.InvalidAction(f"action: expected a whole number from 0 to {last}, got {shortened(action)}")
        reward, trace = self._worlds.step([action])
        self._last_row = int(trace.travelled[0]), int(trace.classified[0])
        batch = self._worlds.batch
        terminated, truncated = bool(batch.terminated[0]), bool(batch.truncated[0])
        self._running = not (terminated or truncated)
        observation, info = self._told()
        return observation, float(reward[0]), terminated, truncated, info

    def _told(self) -> tuple[NDArray[Any], dict[str, Any]]:
        """Return observation and info, and update the window."""
        if self.render_mode == "human":
            self.render()
        info = {name: values[0] if values.ndim > 1 else int(values[0]) for name, values in self._worlds.info().items()}
        return self._worlds.observed()[0], info

    @property
    def planes(self) -> NDArray[np.uint8]:
        """The belief about all cells, as uint8 planes of shape (4, ...) in the order of `shoal.envs.observations.PLANES`."""
        return np.asarray(self._worlds.batch.planes()[0])

    @property
    def view(self) -> View:
        """The current view of the swarm, as a policy of `shoal.swarm` gets it."""
        batch, rule = self._worlds.batch, self.problem.rule
        mapping = bool(getattr(self.problem.chosen_task, "mapping", True))
        return View(batch.belief(0), batch.state(0).occupied, rule, mapping, int(batch.moves[0]), *self._last_row)

    def expert_actions(self, policy: Any) -> list[int]:
        """Return the actions with which a policy solves the episode that has just begun.

        Parameters
        ----------
        policy : str or Policy

        Raises
        ------
        OptionError
            If the policy cannot do the task, or ``scan_every`` is not 1, because policies choose the lengths of their runs.
        """
        check_running(self._running)
        with option_errors():
            if not self._worlds.scanning.every_move:
                raise InvalidInputError(f"scan_every: expected 1 for the actions of a policy, got {self._worlds.scanning.every}")
            batch = self._worlds.batch
            problem = batch.problems[int(batch.maps[0])].replaced(policy=policy)
            return [LETTERS.index(letter) for letter in run(problem, seed=int(batch.seeds[0])).commands]

    def render(self) -> Any:
        """Return a picture (rgb_array), a text (ansi) or None (human: the picture is shown in a window).

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before the first reset.
        """
        check_running(self._begun)
        return rendered(self, lambda: self._worlds.picture(0), lambda: self._worlds.characters(0))

    def close(self) -> None:
        """Close the window if it exists."""
        close_window(self)
