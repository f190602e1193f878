"""SB3VecEnv: the vector environments of Shoal in the form of Stable-Baselines3."""

from __future__ import annotations

import time
from abc import ABCMeta
from functools import cache
from itertools import repeat
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import shortened
from shoal.core.errors import MissingExtraError
from shoal.envs.options import OptionError, check_running
from shoal.envs.worlds import WorldsVectorEnv


class SB3VecEnv:
    """Environments of Shoal as a vector environment of Stable-Baselines3 (SB3).

    Compiled code steps all environments together. The objects are also of SB3's class ``VecEnv``;
    SB3 is imported when the first is made. As SB3 prescribes, an environment starts its next
    episode in the step that ends one, whatever the autoreset mode of ``envs`` is. The info of
    this step then has the entries ``terminal_observation``, ``TimeLimit.truncated``, and, as from
    SB3's Monitor, ``episode``. ``env_method("action_masks")`` returns the masks for MaskablePPO of
    sb3-contrib.

    Parameters
    ----------
    envs : str or gymnasium.vector.VectorEnv
        The id of an environment, or a vector environment of Shoal from `gymnasium.make_vec`.
    num_envs : int, optional
        Number of environments, with an id. The default is 1.
    **options
        With an id, the options of `gymnasium.make_vec`.

    Raises
    ------
    OptionError
        If an option is invalid, or ``envs`` is no vector environment of Shoal.
    MissingExtraError
        If Stable-Baselines3 is not installed.

    Notes
    -----
    See docs/how-to/clients.md.
    """

    # of SB3's VecEnv
    num_envs: int
    reset_infos: list[dict[str, Any]]
    _seeds: list[int | None]
    _options: list[dict[str, Any]]

    def __new__(cls, *_args: Any, **_fields: Any) -> SB3VecEnv:
        """Make an object of a class that also inherits from SB3's VecEnv."""
        made: SB3VecEnv = object.__new__(_joined(cls))  # type: ignore[arg-type]  # it has a hash
        return made

    def __init__(self, envs: Any, num_envs: int | None = None, **options: Any) -> None:
        if isinstance(envs, str):
            envs = gymnasium.make_vec(envs, num_envs=1 if num_envs is None else num_envs, **options)
        elif num_envs is not None or options:
            raise OptionError(
                "envs: expected the id of an environment together with options, got"
                f" {shortened(envs)}"
            )
        self.envs: Any = getattr(envs, "unwrapped", envs)
        if not isinstance(self.envs, WorldsVectorEnv):
            raise OptionError(
                "envs: expected the id of an environment or a vector environment of Shoal, got"
                f" {shortened(envs)}"
            )
        if self.envs is not envs:
            raise OptionError(
                f"envs: expected a vector environment without wrappers, got {shortened(envs)}"
            )
        _vec_env().__init__(
            self,
            self.envs.num_envs,
            self.envs.single_observation_space,
            self.envs.single_action_space,
        )
        self._worlds, self._batch = self.envs._worlds, self.envs.batch
        self._actions: Any = None
        self._returns = np.zeros(self.num_envs)
        self._lengths = np.zeros(self.num_envs, dtype=np.int64)
        self._began = time.monotonic()

    def reset(self) -> Any:
        """Start episodes in all environments, with the seeds and options that SB3 has set."""
        self.envs.reset(seed=list(self._seeds), options=self._joint_options())
        vec_env: Any = self
        vec_env._reset_seeds()
        vec_env._reset_options()
        self.reset_infos = self._infos()
        self._returns[:], self._lengths[:] = 0.0, 0
        return self._worlds.observed()

    def _joint_options(self) -> dict[str, Any]:
        """Return the options of all environments as one dict, with a list for each name."""
        names = {name for options in self._options for name in options}
        if any(set(options) != names for options in self._options):
            raise OptionError(
                "reset: options: expected the same names for all environments, got"
                f" {shortened(self._options)}"
            )
        return {name: [options[name] for options in self._options] for name in names}

    def step_async(self, actions: NDArray[Any]) -> None:
        """Take one action for each environment, for the next call of `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[Any, NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Send the actions, and return observations, rewards, ends and infos.

        Raises
        ------
        gymnasium.error.ResetNeeded
            If the method is called before a reset.
        gymnasium.error.InvalidAction
            If an action is outside the action space.
        """
        check_running(self.envs._begun)
        worlds, batch = self._worlds, self._batch
        rewards, _ = worlds.step(self._actions)
        self._returns += rewards
        self._lengths += 1
        truncated = batch.truncated.copy()
        ended = batch.terminated | truncated
        infos = self._infos(**{"TimeLimit.truncated": truncated})
        if ended.any():
            self._finish(ended, infos)
        return worlds.observed(), rewards.astype(np.float32), ended, infos

    def _finish(self, ended: NDArray[np.bool_], infos: list[dict[str, Any]]) -> None:
        """Add the last observations and the sums of the ended episodes to their infos, and start
        the next episodes.
        """
        last = self._worlds.observed(ended)
        seconds = round(time.monotonic() - self._began, 6)
        chosen = np.flatnonzero(ended).tolist()
        for k, world in enumerate(chosen):
            infos[world]["terminal_observation"] = (
                {name: values[k] for name, values in last.items()}
                if isinstance(last, dict)
                else last[k]
            )
            infos[world]["episode"] = {
                "r": round(float(self._returns[world]), 6),
                "l": int(self._lengths[world]),
                "t": seconds,
            }
        self._returns[ended], self._lengths[ended] = 0.0, 0
        self._worlds.reset(ended)
        for world, info in zip(chosen, self._infos(ended), strict=True):
            self.reset_infos[world] = info

    def _infos(
        self, where: NDArray[np.bool_] | None = None, **more: NDArray[Any]
    ) -> list[dict[str, Any]]:
        """Return the infos of the selected environments, as single environments return them, and
        more entries.
        """
        columns = self._worlds.info(where) | more
        values = [
            list(column) if column.ndim > 1 else column.tolist() for column in columns.values()
        ]
        rows = map(zip, repeat(tuple(columns)), zip(*values, strict=True))
        return list(map(dict, rows))  # a third faster than a loop

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the vector environment, once for each environment."""
        return [getattr(self.envs, attr_name)] * len(self._chosen(indices))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse to set an attribute, because an environment has none that can be changed.

        Raises
        ------
        AttributeError
        """
        raise AttributeError(
            f"set_attr: expected no call, because environments are set by their options, got"
            f" {shortened(attr_name)}"
        )

    def env_method(
        self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any
    ) -> list[Any]:
        """Call the method ``action_masks`` or ``render`` of environments.

        Raises
        ------
        AttributeError
            If environments have no such method.
        """
        values = self.envs.call(method_name, *method_args, **method_kwargs)
        return [values[world] for world in self._chosen(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each environment, because environments have no wrappers."""
        return [False] * len(self._chosen(indices))

    def get_images(self) -> list[Any]:
        """Return a picture of each environment."""
        return list(self.envs.render())

    def _chosen(self, indices: Any) -> list[int]:
        vec_env: Any = self
        return list(vec_env._get_indices(indices))


def _vec_env() -> Any:
    """Return SB3's class VecEnv."""
    try:
        from stable_baselines3.common.vec_env import VecEnv
    except ImportError:
        raise MissingExtraError(
            "SB3VecEnv needs Stable-Baselines3: pip install stable-baselines3"
        ) from None
    return VecEnv


@cache
def _joined(cls: type) -> type:
    """Return a class that inherits from ``cls`` and from SB3's VecEnv."""
    names = {"__module__": cls.__module__, "__doc__": cls.__doc__}
    return ABCMeta(cls.__name__, (cls, _vec_env()), names)
