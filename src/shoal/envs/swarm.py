"""SwarmEnv: mapping and coverage by a swarm as a Gymnasium environment, one command per step."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError
from shoal.envs.options import SwarmEnvOptions, check_running, option_errors
from shoal.envs.single import WorldEnv
from shoal.envs.swarm_worlds import SwarmWorlds
from shoal.swarm.grid.commands import LETTERS
from shoal.swarm.policies.protocol import View
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.run import run


class SwarmEnv(WorldEnv):
    """The task: explore a map with a swarm.

    An action is one command to all particles, as an index of ``lurd`` (in three dimensions ``lurdio``). The first index is 0.

    After ``reset(seed=s)``, the particles, targets and noise equal those of ``shoal.run(problem, seed=s)``. Each later reset
    without a seed draws a seed, and returns this seed in ``info["seed"]``. With ``scan_every``, an action sends its command
    several times, and a scan follows.

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

    worlds = SwarmWorlds
    problem: SwarmProblem
    options: SwarmEnvOptions

    def _checked(self, action: Any) -> list[Any]:
        if not self.action_space.contains(action):
            last = int(self._worlds.action_space.n) - 1
            raise gymnasium.error.InvalidAction(f"action: expected a whole number from 0 to {last}, got {shortened(action)}")
        return [action]

    @property
    def planes(self) -> NDArray[np.uint8]:
        """The belief about all cells, as uint8 planes of shape (4, ...) in the order of `shoal.envs.observations.PLANES`."""
        return np.asarray(self._worlds.batch.planes()[0])

    @property
    def view(self) -> View:
        """The current view of the swarm, as a policy of `shoal.swarm` gets it."""
        batch, rule = self._worlds.batch, self.problem.rule
        mapping = bool(getattr(self.problem.chosen_task, "mapping", True))
        last = (0, 0) if self._effects is None else (int(self._effects.travelled[0]), int(self._effects.classified[0]))
        return View(batch.belief(0), batch.state(0).occupied, rule, mapping, int(batch.moves[0]), *last)

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
                raise InvalidInputError(
                    f"scan_every: expected 1, because a policy chooses when to scan, got {self._worlds.scanning.every}"
                )
            batch = self._worlds.batch
            problem = batch.problems[int(batch.maps[0])].replaced(policy=policy)
            return [LETTERS.index(letter) for letter in run(problem, seed=int(batch.seeds[0])).commands]
