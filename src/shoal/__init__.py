"""Shoal: groups of simple bodies that must explore a space exhaustively, under the control that real ones have.

Names are loaded when they are first used, so that ``import shoal`` is quick.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from shoal.version import __version__

if TYPE_CHECKING:
    from shoal.episode import Episode
    from shoal.errors import InvalidInputError, MissingExtraError, OutputError, ShoalError, UnknownNameError
    from shoal.lab import run_trials
    from shoal.swarm import Board, GridWorkspace, GridWorld
    from shoal.swarm.maps.files import read_map, write_map
    from shoal.swarm.maps.open import open_map
    from shoal.swarm.run import run

_HOMES = {
    "Board": "shoal.swarm",
    "Episode": "shoal.episode",
    "GridWorkspace": "shoal.swarm",
    "GridWorld": "shoal.swarm",
    "InvalidInputError": "shoal.errors",
    "MissingExtraError": "shoal.errors",
    "OutputError": "shoal.errors",
    "ShoalError": "shoal.errors",
    "UnknownNameError": "shoal.errors",
    "open_map": "shoal.swarm.maps.open",
    "read_map": "shoal.swarm.maps.files",
    "run": "shoal.swarm.run",
    "run_trials": "shoal.lab",
    "write_map": "shoal.swarm.maps.files",
}

__all__ = [
    "Board",
    "Episode",
    "GridWorkspace",
    "GridWorld",
    "InvalidInputError",
    "MissingExtraError",
    "OutputError",
    "ShoalError",
    "UnknownNameError",
    "__version__",
    "open_map",
    "read_map",
    "run",
    "run_trials",
    "write_map",
]


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'shoal' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
