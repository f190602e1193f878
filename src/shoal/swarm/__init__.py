"""Particles on a lattice: one command moves all of them."""

from __future__ import annotations

from shoal.swarm.episode import Episode, Verification
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.placements import PLACEMENTS, place
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.grid.tasks import TASKS, Coverage, Mapping, SubsetCoverage, Task, make_task
from shoal.swarm.grid.world import RULES, GridWorld
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.policies import POLICIES, Policy, View, make_policy
from shoal.swarm.running import run

__all__ = [
    "PLACEMENTS",
    "POLICIES",
    "RULES",
    "TASKS",
    "Belief",
    "Board",
    "Coverage",
    "Episode",
    "GridLayout",
    "GridWorkspace",
    "GridWorld",
    "Mapping",
    "Policy",
    "SubsetCoverage",
    "SwarmState",
    "Task",
    "Verification",
    "View",
    "make_policy",
    "make_task",
    "place",
    "run",
]
