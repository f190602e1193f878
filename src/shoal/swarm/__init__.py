"""Particles on a lattice: one command moves all of them."""

from __future__ import annotations

from shoal.swarm.belief import Belief
from shoal.swarm.boards import Board, Frame
from shoal.swarm.episode import Episode, Verification
from shoal.swarm.placement import PLACEMENTS, place
from shoal.swarm.policies import POLICIES, Policy, View, make_policy
from shoal.swarm.running import run
from shoal.swarm.state import SwarmState
from shoal.swarm.tasks import TASKS, Coverage, Mapping, SubsetCoverage, Task, make_task
from shoal.swarm.workspace import GridWorkspace
from shoal.swarm.world import RULES, GridWorld

__all__ = [
    "PLACEMENTS",
    "POLICIES",
    "RULES",
    "TASKS",
    "Belief",
    "Board",
    "Coverage",
    "Episode",
    "Frame",
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
