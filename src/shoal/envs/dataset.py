"""record_episodes: record episodes of a policy as a Minari dataset, for imitation learning and
offline learning.
"""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from shoal.core.checks import check_integer, shortened
from shoal.core.errors import MissingExtraError, OutputError
from shoal.core.version import __version__
from shoal.envs.options import OptionError

Chooser = Callable[[Any, dict[str, Any]], Any]
"""A function (observation, info) -> action."""


def record_episodes(
    env: gymnasium.Env[Any, Any],
    policy: str | Chooser | Any,
    path: str | os.PathLike[str],
    *,
    episodes: int = 10,
    seed: int = 0,
    name: str | None = None,
) -> Any:
    """Run a policy in an environment, and store the episodes as a dataset in the Minari format
    (HDF5).

    Parameters
    ----------
    env : gymnasium.Env
        An environment of Shoal, made by ``gymnasium.make``.
    policy : str, object or callable
        A policy of `shoal.swarm` or a planner of `shoal.steering`, by name or as an object, or a
        function (observation, info) -> action. If a policy stops before the task is complete, the
        dataset stores the episode as truncated.
    path : path
        Path of the new folder for the dataset. No file or folder may exist at this path.
        `minari.MinariDataset` can open the written folder.
    episodes : int
    seed : int
        Seed of the first episode; episode k, counted from 0, has the seed ``seed + k``.
    name : str, optional
        Name of the dataset, in the form ``NAMESPACE/NAME-v0``.

    Returns
    -------
    minari.MinariDataset
        The written dataset. Each episode of the dataset has ``observations`` (one more than
        actions), ``actions``, ``rewards``, ``terminations``, ``truncations`` and ``infos``.

    Raises
    ------
    OptionError
        If ``env`` is no environment of Shoal, a number is out of range, or the policy does not
        support the task.
    MissingExtraError
        If the library Minari is not installed.
    OutputError
        If ``path`` exists, or cannot be written.

    Examples
    --------
    >>> import gymnasium, tempfile
    >>> env = gymnasium.make("shoal.envs:shoal/Mapping-v0", map="vessels:100", particles=10)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     dataset = record_episodes(env, "closest-frontier", folder + "/frontier", episodes=2)
    ...     [(len(episode), episode.observations.shape) for episode in dataset]
    [(125, (126, 4, 24, 21)), (111, (112, 4, 24, 21))]
    """
    try:
        import minari
        from minari.data_collector import EpisodeBuffer
        from minari.dataset.minari_storage import MinariStorage
    except ImportError:
        raise MissingExtraError(
            'datasets need the extra "envs": pip install "shoal[envs]"'
        ) from None
    episodes, seed = (
        check_integer(episodes, what="episodes", least=1),
        check_integer(seed, what="seed", least=0),
    )
    if not hasattr(getattr(env, "unwrapped", None), "expert_actions"):
        raise OptionError(
            f"env: expected a swarm or steering environment of Shoal, got {shortened(env)}"
        )
    target = Path(path).resolve()  # Minari takes a relative path for one in its own folder
    if target.exists():
        raise OutputError(f"cannot write {target}: expected a folder that does not exist yet")
    label = (
        policy
        if isinstance(policy, str)
        else str(getattr(policy, "name", getattr(policy, "__name__", type(policy).__name__)))
    )
    metadata = {
        "dataset_id": (
            name
            or f"{_plain(env.spec.id if env.spec else type(env.unwrapped).__name__)}/{_plain(label)}-v0"
        ),
        "algorithm_name": label,
        "requirements": [f"shoal=={__version__}"],
        "minari_version": minari.__version__,
    }
    temporary = target.parent / f".{target.name[:40]}-{secrets.token_hex(6)}"
    try:
        temporary.mkdir(parents=True)
        spaces = {
            "observation_space": env.observation_space,
            "action_space": env.action_space,
            "env_spec": _spec_of(env),
        }
        storage = MinariStorage.new(temporary, **spaces, data_format="hdf5", jpeg_encoding=False)
        storage.update_metadata(metadata)
        storage.update_episodes(
            EpisodeBuffer(**_episode(env, policy, seed + k)) for k in range(episodes)
        )
        temporary.replace(target)
    except OSError as error:
        raise OutputError(f"cannot write {target}: {error.strerror or error}") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return minari.MinariDataset(target)


def _episode(env: gymnasium.Env[Any, Any], policy: Any, seed: int) -> dict[str, Any]:
    """Run one episode, and return its data in the form of the library Minari."""
    observation, info = env.reset(seed=seed)
    observations, infos, actions, rewards = [observation], [info], [], []
    ends: list[tuple[bool, bool]] = []
    # all of Shoal's have it
    plan = None if callable(policy) else iter(env.unwrapped.expert_actions(policy))  # type: ignore[attr-defined]
    while not (ends and any(ends[-1])):
        action = _next_action(plan, policy, observation, info)
        if action is None:
            break
        observation, reward, terminated, truncated, info = env.step(action)
        observations.append(observation)
        infos.append(info)
        actions.append(action)
        rewards.append(float(reward))
        ends.append((terminated, truncated))
    if not ends:
        raise OptionError(
            f"policy: expected at least one action in the episode of seed {seed}, got none"
        )
    if not any(ends[-1]):
        ends[-1] = False, True
    terminations, truncations = zip(*ends, strict=True)
    return {
        "seed": seed,
        "observations": _stacked(observations),
        "actions": np.array(actions),
        "rewards": rewards,
        "terminations": list(terminations),
        "truncations": list(truncations),
        "infos": _stacked(infos),
    }


def _next_action(
    plan: Iterator[Any] | None, policy: Any, observation: Any, info: dict[str, Any]
) -> Any:
    return policy(observation, info) if plan is None else next(plan, None)


def _stacked(steps: list[Any]) -> Any:
    """Return the data of all steps of an episode as arrays, whose first axis is the step."""
    return (
        {key: _stacked([step[key] for step in steps]) for key in steps[0]}
        if isinstance(steps[0], dict)
        else np.array(steps)
    )


def _plain(text: str) -> str:
    """Return a text in lower case that contains only characters allowed in dataset names."""
    return (
        "".join(letter if letter.isalnum() or letter in "-_/" else "-" for letter in text)
        .strip("-/")
        .lower()
        or "policy"
    )


def _spec_of(env: gymnasium.Env[Any, Any]) -> Any:
    """Return the spec of an environment, or None if JSON cannot represent the options of the
    environment.

    With the spec, a user of the dataset can create the environment again.
    """
    try:
        if env.spec is not None:
            env.spec.to_json()
    except (TypeError, ValueError, AttributeError):
        return None
    return env.spec
