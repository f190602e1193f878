"""SteeringEnv: a Gymnasium environment in which one shared input steers two or more particles. Each
step is one move.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from shoal.core.checks import shortened
from shoal.envs.options import OptionError, SteeringEnvOptions, check_running, option_errors
from shoal.envs.single import WorldEnv
from shoal.envs.worlds import SteeringWorlds
from shoal.steering.problem import SteeringProblem
from shoal.steering.run import run
from shoal.steering.workspaces.convex import Points


class SteeringEnv(WorldEnv):
    """An environment for steering: one shared input must bring all particles of a workspace to
    their goals.

    An action is a move, with one number from -1 to 1 for each axis. The number 1 is a displacement
    of ``longest_move`` times the size of the workspace. After ``reset(seed=s)``, the starts, goals
    and noise equal those of ``shoal.run(problem, seed=s)``. A later reset without a seed draws a
    new seed, and returns the new seed in ``info["seed"]``. An observation is the view of the
    camera, as a dict of float64 arrays. The arrays ``particles`` and ``goals`` have the shape
    (particles, dimensions). The array ``delta``, shape (particles - 1, dimensions), holds the
    positions of particles 2, 3, ... relative to particle 1. The array ``goal_delta`` holds the
    positions of goals 2, 3, ... relative to goal 1. If the gain is uniform, only wall contacts
    change the true relative positions of the particles.

    Parameters
    ----------
    render_mode : str, optional
        Render mode of the environment: "rgb_array" (pictures), "ansi" (texts) or "human" (a
        window).
    **fields
        Fields of the classes `SteeringProblem` and `SteeringEnvOptions`.

    Raises
    ------
    OptionError
        If an option is invalid. OptionError is a subclass of ValueError and of
        gymnasium.error.Error.

    Notes
    -----
    Source: paper W; docs/how-to/environments.md.

    Examples
    --------
    >>> env = SteeringEnv(start=[(0.2, 0.5), (0.4, 0.5)], goal=[(0.3, 0.5), (0.4, 0.5)])
    >>> observation, info = env.reset(seed=1)
    >>> observation["delta"].tolist(), round(info["error"], 3)
    ([[0.2, 0.0]], 0.1)
    >>> observation, reward, terminated, truncated, info = env.step([-0.3, 0.0])
    >>> observation["delta"].round(3).tolist(), terminated
    ([[0.1, 0.0]], False)
    """

    worlds = SteeringWorlds
    problem: SteeringProblem
    options: SteeringEnvOptions

    def _checked(self, action: Any) -> Points:
        d = self.problem.place.dimensions
        try:
            chosen = np.asarray(action, dtype=np.float64)
        except (TypeError, ValueError):
            chosen = np.zeros(0)
        if chosen.shape != (d,) or not (np.abs(chosen) <= 1).all():
            raise gymnasium.error.InvalidAction(
                f"action: expected {d} numbers from -1 to 1, got {shortened(action)}"
            )
        return chosen[None]

    def expert_actions(self, planner: Any) -> list[Points]:
        """Return the actions with which a planner solves the present episode from its start.

        Raises
        ------
        OptionError
            If the planner does not support the task, or if a move of the plan is longer than the
            longest possible action.
        """
        check_running(self._running)
        with option_errors():
            episode = run(
                self.problem.replaced(planner=planner), seed=int(self._worlds.batch.seeds[0])
            )
        longest = self.options.longest_move * self.problem.place.size
        far = float(np.abs(episode.inputs).max(initial=0.0) / longest)
        if far > 1:
            raise OptionError(
                f"longest_move: expected {far * self.options.longest_move:.3g} or more for the"
                f" moves of the planner {episode.planner}, got {self.options.longest_move:g}"
            )
        return list(episode.inputs / longest)
