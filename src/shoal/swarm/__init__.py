"""Mapping and coverage by a swarm of particles on a grid. One command moves all particles.

The package `shoal.swarm` imports each public name when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from shoal.core.registry import loaded_on_use

if TYPE_CHECKING:
    from shoal.swarm.episode import SwarmEpisode
    from shoal.swarm.grid.board import RULES, Board, GridLayout
    from shoal.swarm.grid.state import Belief, SwarmState
    from shoal.swarm.grid.tasks import (
        PLACEMENTS,
        TASKS,
        Coverage,
        Mapping,
        SubsetCoverage,
        Task,
        make_task,
        place,
    )
    from shoal.swarm.grid.world import GridWorld
    from shoal.swarm.maps.workspace import GridWorkspace
    from shoal.swarm.policies import POLICIES, Policy, View, make_policy
    from shoal.swarm.problem import SwarmProblem

_HOMES = {
    "episode": ("SwarmEpisode",),
    "grid.board": (
        "Board",
        "GridLayout",
        "RULES",
    ),
    "grid.state": (
        "Belief",
        "SwarmState",
    ),
    "grid.tasks": (
        "Coverage",
        "Mapping",
        "PLACEMENTS",
        "SubsetCoverage",
        "TASKS",
        "Task",
        "make_task",
        "place",
    ),
    "grid.world": ("GridWorld",),
    "maps.workspace": ("GridWorkspace",),
    "policies": (
        "POLICIES",
        "Policy",
        "View",
        "make_policy",
    ),
    "problem": ("SwarmProblem",),
}

__all__ = [
    "PLACEMENTS",
    "POLICIES",
    "RULES",
    "TASKS",
    "Belief",
    "Board",
    "Coverage",
    "GridLayout",
    "GridWorkspace",
    "GridWorld",
    "Mapping",
    "Policy",
    "SubsetCoverage",
    "SwarmEpisode",
    "SwarmProblem",
    "SwarmState",
    "Task",
    "View",
    "make_policy",
    "make_task",
    "place",
]


__getattr__ = loaded_on_use(__name__, _HOMES)


def __dir__() -> list[str]:
    return __all__
