"""Functions for the observations and rewards of the swarm environments `SwarmEnv` and `SwarmVectorEnv`."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from shoal.envs.options import SwarmEnvOptions
from shoal.swarm.batch import WorldBatch

PLANES = ("particles", "free", "obstacles", "frontier")
"""Planes of an observation: particles per cell; known free cells; known obstacles; frontier cells.

In mapping, frontier cells are unknown cells beside known free cells. In coverage, frontier cells are cells not yet visited.
"""

PARTICLES, FREE, OBSTACLES, FRONTIER = range(4)


def observation_space(window: tuple[int, ...], options: SwarmEnvOptions, *, rule: str) -> gymnasium.spaces.Box:
    """Return the observation space of one simulated world.

    The parameter ``window`` is the shape of the map with a rim of one cell on each side. If the option ``observation`` is "planes",
    each plane of an observation has the shape ``window``.
    """
    if options.observation == "compact":
        count = 3 * 2 * len(window) + 3 + 3 * len(window)
        return gymnasium.spaces.Box(-1.0, 1.0, (count,), np.float32)
    shape = window if options.observation == "planes" else (options.window,) * len(window)
    return gymnasium.spaces.Box(0, 255 if rule == "merge" else 1, (len(PLANES), *shape), np.uint8)


def observed(batch: WorldBatch, options: SwarmEnvOptions, where: NDArray[np.bool_] | None = None, out: Any = None) -> NDArray[Any]:
    """Return the observation of each world, in the form that the option ``observation`` selects.

    If the form is "planes" and the array ``out`` is given, the function writes the observations into ``out``.
    """
    if options.observation == "planes":
        return batch.planes(PLANES, where=where, out=out)
    if options.observation == "compact":
        return compact_of(batch, where)
    if options.center == "particles":
        centers = np.rint(batch.measures(where=where).middle).astype(np.int64)
    else:
        centers = batch.nearest_frontier(where=where)[2]
    return batch.windows(PLANES, centers, options.window, where=where)


def compact_of(batch: WorldBatch, where: NDArray[np.bool_] | None = None) -> NDArray[np.float32]:
    """Return the compact observation of each world: for a map with ndim dimensions, 9 ndim + 3 numbers from -1 to 1.

    Returns
    -------
    ndarray of float32, shape (worlds, 9 ndim + 3)
        The values of a world form nine groups. Group 1 holds, for each command, the fraction of particles that would enter a
        frontier cell. Group 2 holds, for each command, the fraction of particles whose next cell is neither a known obstacle nor
        occupied. Group 3 holds 1 for the command that begins the shortest path to the frontier, and 0 for all other commands. Group
        4 is 1 divided by the length of the shortest path to the frontier, in cells. Without a path to the frontier, groups 3 to 5
        are 0. Group 5 is the vector from the particles' mean position to the frontier cell at the end of the shortest path. Group 6
        is the particles' mean position, and group 7 is the standard deviation of their positions along each axis. Groups 5 to 7 are
        divided by the size of the map with its rim. Group 8 is the number of frontier cells divided by the number of known or
        frontier cells. Group 9 is the used fraction of the maximum number of moves.
    """
    sums, (lengths, commands, ends) = batch.measures(where=where), batch.nearest_frontier(where=where)
    size, count = np.array(batch.layout.window, dtype=np.float64), np.maximum(sums.particles, 1)[:, None]
    first = (np.arange(sums.probing.shape[1]) == commands[:, None]) & (lengths[:, None] > 0)
    moves = batch.moves if where is None else batch.moves[where]
    limits = np.maximum(1, batch.limits if where is None else batch.limits[where])
    parts = [
        sums.probing / count, sums.moving / count, first, np.where(lengths > 0, 1 / np.maximum(lengths, 1), 0)[:, None],
        np.where(lengths[:, None] > 0, (ends - sums.middle) / size, 0), sums.middle / size, sums.spread / size,
        (sums.frontier / np.maximum(sums.known, 1))[:, None], np.minimum(1.0, moves / limits)[:, None],
    ]  # fmt: skip
    return np.concatenate(parts, axis=1, dtype=np.float32).clip(-1, 1)


def rewards_of(
    classified: NDArray[Any], moves: NDArray[Any], done: NDArray[np.bool_], options: SwarmEnvOptions
) -> NDArray[np.float64]:
    """Return the reward of each world for one step.

    The reward is the number of newly classified cells times ``classified_reward``, minus ``move_price`` for each sent command. In
    the step that completes the task, the reward increases by ``final_bonus``.
    """
    return np.asarray(options.classified_reward * classified - options.move_price * moves + options.final_bonus * done)
