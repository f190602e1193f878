"""Mapping and coverage by a swarm of particles on a grid. One command moves all particles.

The package `shoal.swarm` imports each public name when it is first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from shoal.core.registry import loaded_on_use

if TYPE_CHECKING:
    from shoal.swarm.episode import SwarmEpisode
    from shoal.swarm.grid.belief import Belief
    from shoal.swarm.grid.board import Board, GridLayout
    from shoal.swarm.grid.commands import RULES
    from shoal.swarm.grid.placements import PLACEMENTS, place
    from shoal.swarm.grid.state import SwarmState
    from shoal.swarm.grid.tasks import TASKS, Coverage, Mapping, SubsetCoverage, Task, make_task
    from shoal.swarm.grid.world import GridWorld
    from shoal.swarm.maps.workspace import GridWorkspace
    from shoal.swarm.policies import POLICIES, Policy, View, make_policy
    from shoal.swarm.problem import SwarmProblem

_HOMES = {
    "episode": ("SwarmEpisode",),
    "grid.belief": ("Belief",),
    "grid.board": ("Board", "GridLayout"),
    "grid.commands": ("RULES",),
    "grid.placements": ("PLACEMENTS", "place"),
    "grid.state": ("SwarmState",),
    "grid.tasks": ("TASKS", "Coverage", "Mapping", "SubsetCoverage", "Task", "make_task"),
    "grid.world": ("GridWorld",),
    "maps.workspace": ("GridWorkspace",),
    "policies": ("POLICIES", "Policy", "View", "make_policy"),
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
