"""Vector environments: many simulated worlds with the vector interface of Gymnasium, moved together
by compiled code.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space, iterate
from numpy.typing import NDArray

from shoal.core.checks import check_integer, shortened
from shoal.envs.options import (
    MODES,
    OptionError,
    check_render_mode,
    check_running,
    option_errors,
    rendered,
)
from shoal.envs.worlds import SteeringWorlds, SwarmWorlds

Infos = dict[str, Any]
Stepped = tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], Infos]


class WorldsVectorEnv(VectorEnv[Any, NDArray[Any], NDArray[Any]]):
    """The common base class of the vector environments `SwarmVectorEnv` and `SteeringVectorEnv`.

    The class `SwarmVectorEnv` describes the parameters of all vector environments.
    """

    worlds: ClassVar[type[SwarmWorlds | SteeringWorlds]]

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
            self.num_envs = check_integer(num_envs, what="num_envs", least=1)
        if autoreset_mode not in {*AutoresetMode, *(mode.value for mode in AutoresetMode)}:
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
        self._worlds = self.worlds(self.num_envs, pictured=render_mode is not None, **fields)
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
        """
        super().reset(seed=seed if isinstance(seed, int) else None)
        given = dict(options or {})
        mask = given.pop("reset_mask", None)
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
        self._worlds.reset(mask, seed=seed, options=given)
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
        told: Infos = {}
        there = np.ones(self.num_envs, dtype=np.bool_) if mask is None else mask.copy()
        for name, values in self._worlds.info(mask).items():
            told[name] = np.zeros((self.num_envs, *values.shape[1:]), dtype=values.dtype)
            told[name][there] = values
            told[f"_{name}"] = there.copy()
        return told

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

    def render(self) -> tuple[Any, ...]:
        """Return one picture (mode "rgb_array") or one text (mode "ansi") for each environment."""
        check_running(self._begun)
        worlds = self._worlds
        return tuple(
            rendered(self, partial(worlds.picture, i), partial(worlds.characters, i))
            for i in range(self.num_envs)
        )


class SwarmVectorEnv(WorldsVectorEnv):
    """A vector of environments, each of which behaves exactly like a `shoal.envs.SwarmEnv` with the
    same seed.

    The function `gymnasium.make_vec` returns a SwarmVectorEnv.

    Parameters
    ----------
    num_envs : int
    autoreset_mode : str or gymnasium.vector.AutoresetMode
        The rule that determines when an environment starts its next episode after the end of an
        episode: "NextStep", "SameStep", or "Disabled". In the mode "Disabled", a call of ``reset``
        with the option ``reset_mask`` starts the next episode, as in Gymnasium's own vector
        environments.
    copy : bool
        Whether each observation is a separate array. If ``copy`` is false and the option
        ``observation`` is "planes", each step overwrites the array of the previous observation.
        Other observations are always separate arrays.
    render_mode : str, optional
        Render mode of the environments: "rgb_array" (pictures) or "ansi" (texts).
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
    >>> envs = gymnasium.make_vec("shoal.envs:shoal/Mapping-v0", num_envs=3, map="line:9", particles=4)
    >>> observations, infos = envs.reset(seed=1)
    >>> observations.shape, infos["seed"].tolist()
    ((3, 4, 3, 11), [1, 2, 3])
    >>> rewards = envs.step([0, 1, 2])[1]
    """

    worlds = SwarmWorlds


class SteeringVectorEnv(WorldsVectorEnv):
    """A vector of environments, each of which behaves exactly like a `shoal.envs.SteeringEnv` with
    the same seed.

    The function `gymnasium.make_vec` returns a SteeringVectorEnv.

    Parameters
    ----------
    num_envs : int
    autoreset_mode, render_mode : str, optional
        Autoreset mode and render mode, as in `SwarmVectorEnv`.
    copy : bool
        The parameter has no effect, because observations of steering are always separate arrays.
    **fields
        Fields of the classes `SteeringProblem` and `SteeringEnvOptions`.

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
    >>> envs = gymnasium.make_vec("shoal.envs:shoal/Steering-v0", num_envs=3, workspace="disk")
    >>> observations, infos = envs.reset(seed=1)
    >>> observations["delta"].shape, infos["seed"].tolist()
    ((3, 1, 2), [1, 2, 3])
    >>> rewards = envs.step(np.zeros((3, 2)))[1]
    """

    worlds = SteeringWorlds
