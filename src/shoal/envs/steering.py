"""SteeringEnv: a Gymnasium environment in which one continuous shared input steers two or more particles, one move per step."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np

from shoal.core.checks import shortened
from shoal.envs.options import OptionError, check_render_mode, check_running, option_errors
from shoal.envs.rendering import MODES, close_window, rendered
from shoal.envs.steering_worlds import Observation, SteeringWorlds
from shoal.steering.run import run
from shoal.steering.workspaces.convex_geometry import Points


class SteeringEnv(gymnasium.Env[Observation, Any]):
    """The task: bring the particles in a workspace to their goals with one shared input.

    An action is a move, with one number from -1 to 1 per axis, where 1 means ``longest_move`` times the size of the workspace.
    After ``reset(seed=s)``, the starts, goals and noise equal those of ``shoal.run(problem, seed=s)``. Each later reset without a
    seed draws one, and returns it in ``info["seed"]``. Observations are the camera's view as a dict of float64 arrays.
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

    metadata: dict[str, Any] = {"render_modes": MODES, "render_fps": 10}  # noqa: RUF012 - as in its base

    def __init__(self, *, render_mode: str | None = None, **fields: Any) -> None:
        self._worlds = SteeringWorlds(1, pictured=True, **fields)
        self.render_mode = check_render_mode(render_mode, MODES)
        self.problem, self.options = self._worlds.problem, self._worlds.options
        self.observation_space = self._worlds.observation_space  # type: ignore[assignment]  # arrays by name are its elements
        self.action_space = self._worlds.action_space
        self._begun = self._running = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observation, dict[str, Any]]:
        """Start an episode. ``options`` must be empty.

        Raises
        ------
        OptionError
        """
        super().reset(seed=seed)
        self._worlds.reset(seed=[seed], options=options)
        self._begun = self._running = True
        return self._told()

    def step(self, action: Any) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Move the particles and observe.

        Raises
        ------
        gymnasium.error.ResetNeeded
            Before a reset, and after the end of an episode.
        gymnasium.error.InvalidAction
        """
        check_running(self._running)
        d = self.problem.place.dimensions
        try:
            chosen = np.asarray(action, dtype=np.float64)
        except (TypeError, ValueError):
            chosen = np.zeros(0)
        if chosen.shape != (d,) or not (np.abs(chosen) <= 1).all():
            raise gymnasium.error.InvalidAction(f"action: expected {d} numbers from -1 to 1, got {shortened(action)}")
        rewards, _ = self._worlds.step(chosen[None])
        batch = self._worlds.batch
        terminated, truncated = bool(batch.terminated[0]), bool(batch.truncated[0])
        self._running = not (terminated or truncated)
        observation, info = self._told()
        return observation, float(rewards[0]), terminated, truncated, info

    def _told(self) -> tuple[Observation, dict[str, Any]]:
        """Return the observation and the info. In the mode "human", show the picture too."""
        if self.render_mode == "human":
            self.render()
        observation = {name: values[0] for name, values in self._worlds.observed().items()}
        return observation, {name: values[0].item() for name, values in self._worlds.info().items()}

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
                f"longest_move: expected {far * self.options.longest_move:.3g} for the moves of {episode.planner}, "
                f"got {self.options.longest_move:g}"
            )
        return list(episode.inputs / longest)

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
