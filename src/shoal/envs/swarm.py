"""SwarmEnv: a Gymnasium environment for mapping and coverage by a swarm."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError
from shoal.envs.options import SwarmEnvOptions, check_running, option_errors
from shoal.envs.single import WorldEnv
from shoal.envs.worlds import SwarmWorlds
from shoal.swarm.grid.board import LETTERS
from shoal.swarm.policies.protocol import View
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.run import run


class SwarmEnv(WorldEnv):
    """An environment for exploration: commands to a swarm must map or cover a workspace.

    An action is one command to all particles, as an index from 0 into the text ``lurd`` (in three
    dimensions ``lurdio``).

    After ``reset(seed=s)``, the particles, targets and noise equal those of ``shoal.run(problem,
    seed=s)``. A later reset without a seed draws a new seed, and returns the new seed in
    ``info["seed"]``. If ``scan_every`` is above 1, an action sends its command several times before
    a scan follows.

    Parameters
    ----------
    render_mode : str, optional
        Render mode of the environment: "rgb_array" (pictures), "ansi" (texts) or "human" (a
        window).
    **fields
        Fields of the classes `SwarmProblem` and `SwarmEnvOptions`.

    Raises
    ------
    OptionError
        If an option is invalid. OptionError is a subclass of ValueError and of
        gymnasium.error.Error.

    Notes
    -----
    See docs/how-to/environments.md.

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
            raise gymnasium.error.InvalidAction(
                f"action: expected a whole number from 0 to {last}, got {shortened(action)}"
            )
        return [action]

    @property
    def planes(self) -> NDArray[np.uint8]:
        """The known states of all cells, as uint8 planes of shape (4, ...) in the order of
        `shoal.envs.options.PLANES`.
        """
        return np.asarray(self._worlds.batch.planes()[0])

    @property
    def view(self) -> View:
        """The present view of the swarm, in the form that a policy of `shoal.swarm` receives."""
        batch, rule = self._worlds.batch, self.problem.rule
        mapping = bool(getattr(self.problem.chosen_task, "mapping", True))
        last = (
            (0, 0)
            if self._effects is None
            else (int(self._effects.travelled[0]), int(self._effects.classified[0]))
        )
        return View(
            batch.belief(0), batch.state(0).occupied, rule, mapping, int(batch.moves[0]), *last
        )

    def expert_actions(self, policy: Any) -> list[int]:
        """Return the actions with which a policy solves the present episode from its start.

        Parameters
        ----------
        policy : str or Policy

        Raises
        ------
        OptionError
            If the policy does not support the task, or if ``scan_every`` is not 1, because a policy
            itself chooses when to scan.
        """
        check_running(self._running)
        with option_errors():
            if not self._worlds.scanning.every_move:
                raise InvalidInputError(
                    "scan_every: expected 1, because a policy chooses when to scan, got"
                    f" {self._worlds.scanning.every}"
                )
            batch = self._worlds.batch
            problem = batch.problems[int(batch.maps[0])].replaced(policy=policy)
            return [
                LETTERS.index(letter) for letter in run(problem, seed=int(batch.seeds[0])).commands
            ]
