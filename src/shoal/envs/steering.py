"""SteeringEnv: a Gymnasium environment in which one continuous shared input steers two or more particles, one move per step."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from shoal.core.checks import shortened
from shoal.envs.options import OptionError, SteeringEnvOptions, check_running, option_errors
from shoal.envs.single import WorldEnv
from shoal.envs.steering_worlds import SteeringWorlds
from shoal.steering.problem import SteeringProblem
from shoal.steering.run import run
from shoal.steering.workspaces.convex_geometry import Points


class SteeringEnv(WorldEnv):
    """The task: bring the particles in a workspace to their goals with one shared input.

    An action is a move, with one number from -1 to 1 per axis, where 1 means ``longest_move`` times the size of the workspace.
    After ``reset(seed=s)``, the starts, goals and noise equal those of ``shoal.run(problem, seed=s)``. Each later reset without a
    seed draws a seed, and returns this seed in ``info["seed"]``. Observations are the camera's view as a dict of float64 arrays.
    ``particles`` and ``goals`` have shape (particles, dimensions). ``delta`` and ``goal_delta``, shape (particles - 1, dimensions),
    are the positions of all other particles relative to the first particle, now and at the goals. Only walls can change these
    differences.

    Parameters
    ----------
    render_mode : str, optional
        "rgb_array", "ansi" or "human".
    **fields
        Fields of `SteeringProblem` and `SteeringEnvOptions`.

    Raises
    ------
    OptionError
        If an option is invalid. OptionError is a ValueError and a gymnasium.error.Error.

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
            raise gymnasium.error.InvalidAction(f"action: expected {d} numbers from -1 to 1, got {shortened(action)}")
        return chosen[None]

    def expert_actions(self, planner: Any) -> list[Points]:
        """Return the actions with which a planner solves the episode that has just begun.

        Raises
        ------
        OptionError
            If the planner cannot do the task, or a move is longer than an action can be.
        """
        check_running(self._running)
        with option_errors():
            episode = run(self.problem.replaced(planner=planner), seed=int(self._worlds.batch.seeds[0]))
        longest = self.options.longest_move * self.problem.place.size
        far = float(np.abs(episode.inputs).max(initial=0.0) / longest)
        if far > 1:
            raise OptionError(
                f"longest_move: expected {far * self.options.longest_move:.3g} or more for the moves of the planner "
                f"{episode.planner}, "
                f"got {self.options.longest_move:g}"
            )
        return list(episode.inputs / longest)
