"""Disturbances of a real apparatus: finite friction, particles with a radius, and a nonuniform field."""

from __future__ import annotations

from math import inf
from typing import Any

import numpy as np
from numpy.random import Generator

from shoal.core.errors import InvalidInputError
from shoal.steering.contact.region_world import RegionWorld
from shoal.steering.contact.world import ContactWorld
from shoal.steering.workspaces.region import Region


def make_world(workspace: Any, *, friction: float = inf, radius: float = 0.0, gain: float = 0.0, seed: int = 0) -> Any:
    """Return the simulated world for a workspace: a `ContactWorld`, or a `RegionWorld` if the workspace has obstacles.

    Parameters
    ----------
    workspace : ConvexWorkspace or Region
    friction : float
        Coefficient of friction between particles and walls. With an infinite friction coefficient, a particle that is pushed into a
        wall never slides.
    radius : float
        Radius of each particle, in the workspace's unit of length.
    gain : float
        Largest gain minus smallest gain in the workspace, divided by the mean gain. The gain of a particle is its displacement
        divided by the input. The gain grows along a random direction, which ``seed`` determines.
    seed : int

    Raises
    ------
    InvalidInputError
    """
    if isinstance(workspace, Region):
        if friction < inf or gain or radius:
            raise InvalidInputError(
                "a region with obstacles: expected no friction, gain or particle radius, which only convex workspaces allow"
            )
        return RegionWorld(workspace)
    gradient = None
    if gain:
        direction = generators(seed)[0].normal(size=workspace.dimensions)
        gradient = direction * (gain / 2 / workspace.extent(direction))
    return ContactWorld(workspace, friction=friction, gradient=gradient, radius=radius)


def generators(seed: int) -> tuple[Generator, Generator, Generator, Generator]:
    """Return four random generators: for the direction of the gain's growth, for noise of moves, for camera noise, for planners."""
    spawned = np.random.SeedSequence(seed).spawn(4)
    return tuple(np.random.default_rng(child) for child in spawned)  # type: ignore[return-value]  # four children, four generators
