"""Observations and action masks of swarms, made of planes, for any number of worlds at once.

Planes are uint8 arrays of shape (worlds, 4, *window), one plane after another `PLANES`, over all cells and one cell of rim: the
window of `shoal.swarm.GridLayout`. All functions here read planes only, so one environment and thousands share them.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from shoal.envs.options import SwarmEnvOptions

Planes = NDArray[np.uint8]
Floats = NDArray[np.float32]

PLANES = ("particles", "free", "obstacles", "frontier")
"""Particles of each cell; known to be free; known to be obstacles; left to do: unknown beside free ones, or not yet covered."""

PARTICLES, FREE, OBSTACLES, FRONTIER = range(4)
_STEPS = [(-1, -1), (-2, -1), (-1, 1), (-2, 1), (-3, -1), (-3, 1)]  # axis and step of each command: lurdio


def n_commands(planes: Planes) -> int:
    """Return the number of commands: 4 in two dimensions, 6 in three."""
    return 2 * (planes.ndim - 2)


def observation_space(window: tuple[int, ...], options: SwarmEnvOptions, *, rule: str) -> gymnasium.spaces.Box:
    """Return the space of one world's observations; ``window`` is the shape of its planes, rim included."""
    if options.observation == "compact":
        count = 3 * 2 * len(window) + 3 + 3 * len(window)
        return gymnasium.spaces.Box(-1.0, 1.0, (count,), np.float32)
    shape = window if options.observation == "planes" else (options.window,) * len(window)
    return gymnasium.spaces.Box(0, 255 if rule == "merge" else 1, (len(PLANES), *shape), np.uint8)


def action_masks(planes: Planes, *, rule: str, noisy: bool = False) -> NDArray[np.int8]:
    """Return which commands can change anything, int8, shape (worlds, commands).

    Under block and tilt that is a command at which some particle's next cell is no known obstacle and holds no particle, under
    merge one at which it is no known obstacle. This follows from what is known, so it tells nothing that the observation does not.
    With noise where particles are is not known for sure, so every command may change something.
    """
    masks = np.ones((len(planes), n_commands(planes)), dtype=np.int8)
    if not noisy:
        particles = planes[:, PARTICLES] > 0
        stopped = planes[:, OBSTACLES] > 0 if rule == "merge" else (planes[:, OBSTACLES] > 0) | particles
        for command, entered in enumerate(_entered(particles)):
            masks[:, command] = (entered & ~stopped).reshape(len(planes), -1).any(axis=1)
    return masks


def _entered(particles: NDArray[Any]) -> list[NDArray[Any]]:
    """Return for each command the cells that particles would enter; none leaves the rim, as none stands in it."""
    return [np.roll(particles, step, axis=axis) for axis, step in _STEPS[: 2 * (particles.ndim - 1)]]


def windows_of(planes: Planes, centers: NDArray[np.int64], side: int) -> Planes:
    """Return the planes of the cells around one of each world; cells outside of the planes show as obstacles.

    Parameters
    ----------
    planes : ndarray of uint8, shape (worlds, 4, *window)
    centers : ndarray of int64, shape (worlds, ndim)
        Indices into the planes.
    side : int
        Odd.

    Returns
    -------
    ndarray of uint8, shape (worlds, 4, side, side), in three dimensions one side more
    """
    ndim = planes.ndim - 2
    offsets = np.arange(side) - side // 2
    places, inside = [], np.ones((len(planes),) + (1,) * ndim, dtype=np.bool_)
    for axis in range(ndim):
        size = planes.shape[2 + axis]
        shape = [len(planes)] + [1] * ndim
        shape[1 + axis] = side
        place = (centers[:, axis, None] + offsets).reshape(shape)
        inside = inside & (place >= 0) & (place < size)
        places.append(place.clip(0, size - 1))
    worlds = np.arange(len(planes)).reshape((-1,) + (1,) * ndim)
    found = np.stack([planes[(worlds, plane, *places)] for plane in range(len(PLANES))], axis=1)
    found *= inside[:, None]
    found[:, OBSTACLES] |= ~inside
    return found


def centers_of(planes: Planes) -> NDArray[np.float64]:
    """Return the mean place of each world's particles, as indices into its planes; float64, shape (worlds, ndim)."""
    return _moments(planes)[0]


def _moments(planes: Planes) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return mean and standard deviation of where particles are; float64, shape (worlds, ndim)."""
    particles = planes[:, PARTICLES].astype(np.float64)
    total = np.maximum(particles.reshape(len(planes), -1).sum(axis=1), 1.0)
    means, spreads = [], []
    for axis in range(1, particles.ndim):
        others = tuple(other for other in range(1, particles.ndim) if other != axis)
        along, places = particles.sum(axis=others), np.arange(particles.shape[axis])
        mean = along @ places / total
        means.append(mean)
        spreads.append(np.sqrt(np.maximum(along @ places**2 / total - mean**2, 0.0)))
    return np.stack(means, axis=1), np.stack(spreads, axis=1)


def compact_of(
    planes: Planes, nearest: NDArray[np.int64], commands: NDArray[np.int64], lengths: NDArray[np.int64], moved: NDArray[np.float64]
) -> Floats:
    """Return a few numbers from -1 to 1 for each world.

    Parameters
    ----------
    planes : ndarray of uint8, shape (worlds, 4, *window)
    nearest : ndarray of int64, shape (worlds, ndim)
        The frontier cell that is nearest to a particle by path, as indices into the planes.
    commands, lengths : ndarray of int64, shape (worlds,)
        First command and length of that path; length 0 if there is none.
    moved : ndarray of float64, shape (worlds,)
        Share of the moves that are used up.

    Returns
    -------
    ndarray of float32, shape (worlds, 9 ndim + 3)
        By command the share of particles that would enter a frontier cell; by command the share whose next cell is no known
        obstacle and holds no particle; by command 1 for the first one of the shortest path to the frontier; 1 over the length of
        that path; from the particles' middle to that frontier cell, the middle, and the spread, by axis, over the size of the map;
        the share of the frontier among all cells that are known or frontier; the share of moves used up.
    """
    worlds, size = len(planes), np.array(planes.shape[2:], dtype=np.float64)
    particles = planes[:, PARTICLES].astype(np.float64)
    total = np.maximum(particles.reshape(worlds, -1).sum(axis=1), 1.0)
    frontier, stopped = planes[:, FRONTIER], (planes[:, OBSTACLES] > 0) | (planes[:, PARTICLES] > 0)
    probing, moving = [], []
    for entered in _entered(particles):
        probing.append((entered * frontier).reshape(worlds, -1).sum(axis=1) / total)
        moving.append((entered * ~stopped).reshape(worlds, -1).sum(axis=1) / total)
    first = (np.arange(n_commands(planes)) == commands[:, None]) & (lengths[:, None] > 0)
    middle, spread = _moments(planes)
    left = frontier.reshape(worlds, -1).sum(axis=1, dtype=np.int64)
    known = (planes[:, FREE] | planes[:, OBSTACLES] | frontier).reshape(worlds, -1).sum(axis=1, dtype=np.int64)
    parts = [
        np.stack(probing, axis=1), np.stack(moving, axis=1), first, np.where(lengths > 0, 1 / np.maximum(lengths, 1), 0)[:, None],
        np.where(lengths[:, None] > 0, (nearest - middle) / size, 0), middle / size, spread / size,
        (left / np.maximum(known, 1))[:, None], moved[:, None],
    ]  # fmt: skip
    return np.concatenate(parts, axis=1, dtype=np.float32).clip(-1, 1)


def rewards_of(
    classified: NDArray[np.int64], moves: NDArray[np.int64], done: NDArray[np.bool_], options: SwarmEnvOptions
) -> NDArray[np.float64]:
    """Return the rewards of a step: for the cells classified, less the price of its commands, and a bonus at the end."""
    return np.asarray(options.classified_reward * classified - options.move_price * moves + options.final_bonus * done)
