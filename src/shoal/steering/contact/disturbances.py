"""What a real apparatus adds to the ideal world: friction that gives way, particles with a radius, a field that is not uniform."""

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
    """Return the world of a workspace: a `ContactWorld`, or a `RegionWorld` where there are obstacles.

    Parameters
    ----------
    workspace : ConvexWorkspace or Region
    friction : float
        Coefficient of friction between particle and wall; infinite if nothing that is pushed into a wall slides.
    radius : float
        Of the particles.
    gain : float
        By how much of itself the response to the input varies over the workspace, along a direction that the seed draws.
    seed : int

    Raises
    ------
    InvalidInputError
    """
    if isinstance(workspace, Region):
        if friction < inf or gain or radius:
            raise InvalidInputError(
                "a region with obstacles: expected no friction, gain or particle radius; those are for convex ones"
            )
        return RegionWorld(workspace)
    gradient = None
    if gain:
        direction = generators(seed)[0].normal(size=workspace.dimensions)
        gradient = direction * (gain / 2 / workspace.extent(direction))
    return ContactWorld(workspace, friction=friction, gradient=gradient, radius=radius)


def generators(seed: int) -> tuple[Generator, Generator, Generator, Generator]:
    """Return the generators of the field, of execution, of the camera and of the planner."""
    spawned = np.random.SeedSequence(seed).spawn(4)
    return tuple(np.random.default_rng(child) for child in spawned)  # type: ignore[return-value]  # four children, four generators
