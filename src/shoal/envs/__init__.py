"""Environments for reinforcement learning: Gymnasium for swarms and steering, PettingZoo for
searches (extra ``envs``).

The import of ``shoal.envs`` registers the environments ``shoal/Mapping-v0``, ``shoal/Coverage-v0``,
``shoal/SubsetCoverage-v0``, ``shoal/Gathering-v0``, ``shoal/Search-v0`` and ``shoal/Steering-v0``. A call such as
``gymnasium.make("shoal.envs:shoal/Mapping-v0")`` imports ``shoal.envs`` itself.
"""

from __future__ import annotations

from typing import Any

from shoal.core.errors import MissingExtraError

try:
    import gymnasium
    import pettingzoo  # noqa: F401 - of search_v0
except ImportError:
    raise MissingExtraError(
        'environments need the extra "envs": pip install "shoal[envs]"'
    ) from None

from shoal.envs.dataset import record_episodes
from shoal.envs.options import OptionError, SteeringEnvOptions, SwarmEnvOptions
from shoal.envs.sb3 import SB3VecEnv
from shoal.envs.search import SearchEnv, SearchVectorEnv
from shoal.envs.steering import SteeringEnv, SteeringVectorEnv
from shoal.envs.swarm import SwarmEnv, SwarmVectorEnv
from shoal.envs.video import RecordVideo

__all__ = [
    "REGISTERED",
    "OptionError",
    "RecordVideo",
    "SB3VecEnv",
    "SearchEnv",
    "SearchVectorEnv",
    "SteeringEnv",
    "SteeringEnvOptions",
    "SteeringVectorEnv",
    "SwarmEnv",
    "SwarmEnvOptions",
    "SwarmVectorEnv",
    "record_episodes",
]

_SWARM: dict[str, Any] = {"map": "vessels:1000", "max_moves": 1000}

REGISTERED: dict[str, tuple[str, dict[str, Any]]] = {
    "shoal/Mapping-v0": ("shoal.envs.swarm:SwarmEnv", {**_SWARM, "task": "mapping"}),
    "shoal/Coverage-v0": ("shoal.envs.swarm:SwarmEnv", {**_SWARM, "task": "coverage"}),
    "shoal/Gathering-v0": ("shoal.envs.swarm:SwarmEnv", {**_SWARM, "task": "gathering"}),
    "shoal/SubsetCoverage-v0": ("shoal.envs.swarm:SwarmEnv", {**_SWARM, "task": "subset-coverage"}),
    "shoal/Search-v0": ("shoal.envs.search:SearchEnv", {"region": "square:100"}),
    "shoal/Steering-v0": ("shoal.envs.steering:SteeringEnv", {"tolerance": 0.01}),
}
"""The class of each environment, by id, and the options whose default differs from the default of
the field of the problem.

A call of `gymnasium.make` can change each option.
"""

for _name, (_entry, _options) in REGISTERED.items():
    gymnasium.register(
        id=_name,
        entry_point=_entry,
        vector_entry_point=_entry.replace("Env", "VectorEnv"),
        kwargs=_options,
    )
