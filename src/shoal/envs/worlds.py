"""What swarm and steering environments share: an environment with one simulated world, a vector of
many, and pictures.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import partial
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, iterate
from numpy.typing import NDArray

from shoal.core.checks import check_integer, shortened
from shoal.envs.forms import Form
from shoal.envs.options import OptionError, check_running, option_errors
from shoal.envs.rendering import MODES, Picture, check_render_mode, close_window, rendered

MOST_ENVS = 1_000_000
"""Largest number of environments in a vector."""

Infos = dict[str, Any]
Stepped = tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Infos]


class Worlds(ABC):
    """The simulated worlds behind an environment, stepped together by compiled code.

    Parameters
    ----------
    count : int
        Number of simulated worlds.
    pictured : bool
        Whether the environment needs pictures of the worlds.
    **fields
        Fields of the problem and additional fields of the environment.

    Attributes
    ----------
    problem, options
        What the fields describe.
    batch
        The batch that simulates the worlds.
    form : Form
        The form of the observations.
    action_space : gymnasium.Space
        The space of the actions of one world.
    """

    problem: Any
    options: Any
    batch: Any
    form: Form
    action_space: gymnasium.Space[Any]

    @abstractmethod
    def __init__(self, count: int, *, pictured: bool = False, **fields: Any) -> None: ...

    @abstractmethod
    def reset(
        self,
        where: NDArray[np.bool_] | None = None,
        *,
        seed: Any = None,
        options: dict[str, Any] | None = None,
    ) -> None:
        """Start episodes in the worlds that the mask ``where`` selects, or in all."""

    @abstractmethod
    def step(
        self, actions: Any, where: NDArray[np.bool_] | None = None
    ) -> tuple[NDArray[np.float64], Any]:
        """Send one action to each world. Return the rewards, and the effects of the actions if the
        batch tells them.
        """

    @property
    def observation_space(self) -> gymnasium.Space[Any]:
        """The space of the observations of one world."""
        return self.form.space

    def observed(self, where: NDArray[np.bool_] | None = None, out: Any = None) -> Any:
        """Return the observations of the worlds, if possible in the array ``out``."""
        return self.form(self.seen(where, out if self.form.same else None))

    @abstractmethod
    def seen(self, where: NDArray[np.bool_] | None = None, out: Any = None) -> Any:
        """Return the observations of the worlds before they get their form."""

    @abstractmethod
    def info(self, where: NDArray[np.bool_] | None = None) -> dict[str, NDArray[Any]]:
        """Return the infos of the worlds, by name."""

    @abstractmethod
    def picture(self, world: int) -> Picture:
        """Return a picture of a world; uint8, shape (height, width, 3)."""

    @abstractmethod
    def characters(self, world: int) -> str:
        """Return a world as text."""


class WorldEnv(gymnasium.Env[Any, Any]):
    """One simulated world with the interface of Gymnasium; a subclass sets the class of its worlds.

    Subclasses of this class and of `WorldsVectorEnv` also name Gymnasium's class as their base,
    because skrl recognizes an environment by the direct bases of its class.

    Parameters
    ----------
    render_mode : str, optional
        Render mode of the environment: "rgb_array" (pictures), "ansi" (texts) or "human" (a
        window).
    **fields
        Fields of the problem, and additional fields of the environment.
    """

    metadata: dict[str, Any] = {"render_modes": MODES, "render_fps": 10}
    worlds: ClassVar[type[Worlds]]
    problem: Any
    options: Any

    def __init__(self, *, render_mode: str | None = None, **fields: Any) -> None:
        self._worlds = self.worlds(1, pictured=True, **fields)
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
            If an option or a seed is invalid.
        """
        super().reset(seed=seed)
        self._worlds.reset(seed=[seed], options=options)
        self._begun = self._running = True
        self._effects = None
        return self._observe()

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
        rewards, self._effects = self._worlds.step([action])
        batch = self._worlds.batch
        terminated, truncated = bool(batch.terminated[0]), bool(batch.truncated[0])
        self._running = not (terminated or truncated)
        observation, info = self._observe()
        return observation, float(rewards[0]), terminated, truncated, info

    def _observe(self) -> tuple[Any, dict[str, Any]]:
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


class WorldsVectorEnv(VectorEnv[Any, NDArray[Any], NDArray[Any]]):
    """The common base class of the vector environments `SwarmVectorEnv` and `SteeringVectorEnv`.

    The class `SwarmVectorEnv` describes the parameters of all vector environments.
    """

    worlds: ClassVar[type[Worlds]]

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        copy: bool = True,
        render_mode: str | None = None,
        **fields: Any,
    ) -> None:
        modes = [mode for mode in MODES if mode != "human"]
        with option_errors():
            self.num_envs = check_integer(num_envs, what="num_envs", least=1, most=MOST_ENVS)
        if autoreset_mode not in [*AutoresetMode, *(mode.value for mode in AutoresetMode)]:
            names = ", ".join(mode.value for mode in AutoresetMode)
            raise OptionError(
                f"autoreset_mode: expected one of {names}, got {shortened(autoreset_mode)}"
            )
        self.autoreset_mode, self.copy = AutoresetMode(autoreset_mode), copy
        self.render_mode = check_render_mode(render_mode, modes)
        self.metadata = {
            "render_modes": modes,
            "render_fps": 10,
            "autoreset_mode": self.autoreset_mode,
        }
        try:
            self._worlds = self.worlds(self.num_envs, pictured=render_mode is not None, **fields)
        except MemoryError:
            raise OptionError(
                "num_envs: expected a number of environments that fits into the memory, got"
                f" {self.num_envs}"
            ) from None
        self.problem, self.options, self.batch = (
            self._worlds.problem,
            self._worlds.options,
            self._worlds.batch,
        )
        self.single_observation_space, self.single_action_space = (
            self._worlds.observation_space,
            self._worlds.action_space,
        )
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._ended = np.zeros(self.num_envs, dtype=np.bool_)
        self._begun = False
        self._last: Any = None

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[Any], Infos]:
        """Start episodes in all environments, or in the environments that a mask selects.

        Parameters
        ----------
        seed : int, or sequence of int or None, optional
            One integer, or one seed for each environment. If ``seed`` is an integer, environment i
            gets the seed ``seed + i``.
        options : dict, optional
            ``reset_mask``: mask of the environments to reset, ndarray of bool, shape (num_envs,).
            ``map`` (only for swarms): one index of a map for all environments, or one index for
            each environment.

        Raises
        ------
        OptionError
            If an option or a seed is invalid.
        gymnasium.error.ResetNeeded
            If the first reset has a mask.
        """
        super().reset(seed=seed if isinstance(seed, int) else None)
        settings = dict(options or {})
        mask = settings.pop("reset_mask", None)
        if mask is not None and not (
            isinstance(mask, np.ndarray)
            and mask.dtype == np.bool_
            and mask.shape == (self.num_envs,)
        ):
            got = f"{mask.dtype} {mask.shape}" if isinstance(mask, np.ndarray) else shortened(mask)
            raise OptionError(
                f"reset: reset_mask: expected an array of {self.num_envs} booleans, got {got}"
            )
        check_running(self._begun or mask is None)
        self._worlds.reset(mask, seed=seed, options=settings)
        self._ended[slice(None) if mask is None else mask] = False
        self._begun = True
        return self._observed(), self._infos(mask)

    def step(self, actions: NDArray[Any]) -> Stepped:
        """Send one action to each environment.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the method is called before a reset, or if an episode has ended and the autoreset
            mode is "Disabled".
        gymnasium.error.InvalidAction
            If an action is outside the action space.
        """
        check_running(self._begun)
        resetting = None
        if self._ended.any():
            if self.autoreset_mode == AutoresetMode.DISABLED:
                over = int(np.argmax(self._ended))
                raise gymnasium.error.ResetNeeded(
                    f"step: expected a reset of environment {over} first, because its episode has"
                    " ended, got an action"
                )
            resetting = self._ended.copy()
        rewards, _ = self._worlds.step(actions, None if resetting is None else ~resetting)
        if resetting is not None:
            self._worlds.reset(resetting)
            rewards[resetting] = 0.0
        terminated, truncated = self.batch.terminated.copy(), self.batch.truncated.copy()
        if resetting is not None:
            terminated[resetting] = truncated[resetting] = False
        ended = terminated | truncated
        infos: Infos = {}
        if self.autoreset_mode == AutoresetMode.SAME_STEP:
            if ended.any():
                infos = self._final(ended)
                self._worlds.reset(ended)
        else:
            self._ended = ended
        return self._observed(), rewards, terminated, truncated, infos | self._infos(None)

    def _observed(self) -> Any:
        self._last = self._worlds.observed(out=None if self.copy else self._last)
        return self._last

    def _infos(self, mask: NDArray[np.bool_] | None) -> Infos:
        """Return infos in the vector form of Gymnasium: for each name, an array of values and a
        mask of the environments.

        For environments outside ``mask``, the values are zero.
        """
        infos: Infos = {}
        there = np.ones(self.num_envs, dtype=np.bool_) if mask is None else mask.copy()
        for name, values in self._worlds.info(mask).items():
            infos[name] = np.zeros((self.num_envs, *values.shape[1:]), dtype=values.dtype)
            infos[name][there] = values
            infos[f"_{name}"] = there.copy()
        return infos

    def _final(self, ended: NDArray[np.bool_]) -> Infos:
        """Return the final observations and infos of the episodes that have just ended."""
        last = np.full(self.num_envs, None, dtype=object)
        each = iterate(
            batch_space(self.single_observation_space, int(ended.sum())),
            self._worlds.observed(ended),
        )
        for world, observation in zip(np.flatnonzero(ended), each, strict=True):
            last[world] = observation
        return {
            "final_obs": last,
            "_final_obs": ended.copy(),
            "final_info": self._infos(ended),
            "_final_info": ended.copy(),
        }

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call the method ``render`` or ``action_masks`` of each environment, as Gymnasium's own
        vector environments do.

        Raises
        ------
        AttributeError
            If environments have no such method.
        """
        if name not in ("render", "action_masks") or not hasattr(self, name):
            raise AttributeError(
                f"call: expected the name of a method of environments, got {shortened(name)}"
            )
        return tuple(getattr(self, name)(*args, **kwargs))

    def render(self) -> tuple[Any, ...]:
        """Return one picture (mode "rgb_array") or one text (mode "ansi") for each environment."""
        check_running(self._begun)
        worlds = self._worlds
        return tuple(
            rendered(self, partial(worlds.picture, i), partial(worlds.characters, i))
            for i in range(self.num_envs)
        )
