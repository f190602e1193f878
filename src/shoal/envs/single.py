"""The common base class of the environments with one simulated world: `SwarmEnv` and
`SteeringEnv`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

import gymnasium

from shoal.envs.options import MODES, check_render_mode, check_running, close_window, rendered
from shoal.envs.worlds import SteeringWorlds, SwarmWorlds


class WorldEnv(gymnasium.Env[Any, Any], ABC):
    """One simulated world with the interface of Gymnasium; a subclass sets the class of its worlds
    and checks actions.

    Parameters
    ----------
    render_mode : str, optional
        Render mode of the environment: "rgb_array" (pictures), "ansi" (texts) or "human" (a
        window).
    **fields
        Fields of the problem, and additional fields of the environment.
    """

    metadata: dict[str, Any] = {"render_modes": MODES, "render_fps": 10}
    worlds: ClassVar[type[SwarmWorlds | SteeringWorlds]]
    problem: Any
    options: Any

    def __init__(self, *, render_mode: str | None = None, **fields: Any) -> None:
        self._worlds: Any = self.worlds(1, pictured=True, **fields)
        self.render_mode = check_render_mode(render_mode, MODES)
        self.problem, self.options = self._worlds.problem, self._worlds.options
        self.observation_space, self.action_space = (
            self._worlds.observation_space,
            self._worlds.action_space,
        )
        self._begun = self._running = False
        self._effects: Any = None  # of the last step

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode in the environment.

        Parameters
        ----------
        seed : int, optional
        options : dict, optional
            In a swarm environment, ``{"map": k}`` selects map k of ``maps`` instead of a random
            map. A steering environment has no reset options.

        Raises
        ------
        OptionError
        """
        super().reset(seed=seed)
        self._worlds.reset(seed=[seed], options=options)
        self._begun = self._running = True
        self._effects = None
        return self._told()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Send an action to the particles, and observe the particles.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the method is called before a reset, or after the end of an episode.
        gymnasium.error.InvalidAction
            If the action is outside the action space.
        """
        check_running(self._running)
        rewards, self._effects = self._worlds.step(self._checked(action))
        batch = self._worlds.batch
        terminated, truncated = bool(batch.terminated[0]), bool(batch.truncated[0])
        self._running = not (terminated or truncated)
        observation, info = self._told()
        return observation, float(rewards[0]), terminated, truncated, info

    @abstractmethod
    def _checked(self, action: Any) -> Any:
        """Return an action in the form for a batch with one world, or raise InvalidAction."""

    def _told(self) -> tuple[Any, dict[str, Any]]:
        """Return the observation and the info; in the render mode "human", show the picture of the
        world.
        """
        if self.render_mode == "human":
            self.render()
        seen = self._worlds.observed()
        observation = (
            {name: values[0] for name, values in seen.items()}
            if isinstance(seen, dict)
            else seen[0]
        )
        info = self._worlds.info()
        return observation, {
            name: values[0] if values.ndim > 1 else values[0].item()
            for name, values in info.items()
        }

    def render(self) -> Any:
        """Return a picture (mode "rgb_array") or a text (mode "ansi"), or show a picture in a
        window (mode "human").

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the method is called before the first reset.
        """
        check_running(self._begun)
        return rendered(self, lambda: self._worlds.picture(0), lambda: self._worlds.characters(0))

    def close(self) -> None:
        """Close the window of the environment if the environment has opened one."""
        close_window(self)
