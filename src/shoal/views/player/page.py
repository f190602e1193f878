"""From an episode to the data of the player."""

from __future__ import annotations

import base64

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError
from shoal.swarm import Episode
from shoal.swarm.noise import NoisyEpisode
from shoal.views.player import render

LARGEST = 2_000_000_000
"""Cells times moves that a page still plays smoothly enough."""


def player_page(episode: Episode) -> str:
    """Return the HTML page that plays an episode.

    Raises
    ------
    InvalidInputError
        If map and episode together are too large for a browser, or the episode has noise.
    """
    if isinstance(episode, NoisyEpisode):
        raise InvalidInputError("the HTML player: expected an episode without noise, which a page can simulate (use .gif or .mp4)")
    work = episode.workspace.free.size * max(1, episode.moves)
    if work > LARGEST or episode.workspace.free.size > LARGEST // 100:
        raise InvalidInputError(
            f"the HTML player: expected at most {LARGEST:.0e} cells times moves, got {work:.1e} (use .gif or .mp4)"
        )
    return render(player_data(episode))


def player_data(episode: Episode) -> dict[str, object]:
    """Return the data contract of `shoal.views.player.render` for an episode."""
    flat = np.ravel_multi_index(tuple(episode.start.T), episode.workspace.shape)
    return {
        "title": f"{episode.task.capitalize()} of {episode.workspace.name}",
        "map": episode.workspace.name,
        "task": episode.task,
        "policy": episode.policy,
        "rule": episode.rule,
        "shape": list(episode.workspace.shape),
        "spacing": None if episode.workspace.spacing is None else list(episode.workspace.spacing),
        "free": _packed(episode.workspace.free),
        "start": base64.b64encode(flat.astype("<u4").tobytes()).decode(),
        "targets": None if episode.targets is None else _packed(episode.targets),
        "commands": episode.commands,
        "scanned": None if episode.scanned.all() else _packed(episode.scanned),
        "status": episode.status,
        "seed": episode.seed,
        "version": episode.version,
    }


def _packed(mask: NDArray[np.bool_]) -> str:
    return base64.b64encode(np.packbits(mask.ravel()).tobytes()).decode()
