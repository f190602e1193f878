"""The data of a swarm episode for the player page."""

from __future__ import annotations

import base64

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm import SwarmEpisode
from shoal.swarm.noise import Noise
from shoal.swarm.noise import belief as moments
from shoal.views.player import render
from shoal.views.swarm.films import packed_moments
from shoal.views.swarm.volume import FRONTIER_TINT

LARGEST = 2_000_000_000
"""Maximum product of the numbers of cells and moves with which a page plays smoothly."""


def player_page(episode: SwarmEpisode) -> str:
    """Return the HTML page that plays a swarm episode.

    Raises
    ------
    InvalidInputError
        If the data of the map and the episode together are too large for a browser.
    """
    work = episode.workspace.free.size * max(1, episode.moves)
    if work > LARGEST or episode.workspace.free.size > LARGEST // 100:
        raise InvalidInputError(
            "the HTML player: expected a number of cells times a number of moves of at most"
            f" {LARGEST:.0e}, got {work:.1e} (use .gif or .mp4)"
        )
    return render("swarm", page_data(episode))


def page_data(episode: SwarmEpisode) -> dict[str, object]:
    """Return the data of a swarm episode for the player page, as JSON data.

    Returns
    -------
    dict
        ``title``, ``map``, ``policy`` and ``version`` are texts, which the page shows literally;
        ``seed`` is an integer or None. ``task`` is ``"mapping"``, ``"coverage"`` or
        ``"subset-coverage"``. ``rule``, the move rule, is ``"block"``, ``"merge"`` or ``"tilt"``.
        ``shape`` is ``[H, W]`` or ``[D, H, W]``, in cells; ``spacing`` is the size of a cell along
        each axis in millimetres, or None, or missing.

        ``free`` is the base64 text of ``numpy.packbits(free.ravel())``, in which a set bit is a
        free cell. ``start`` is the base64 text of the particles' start cells as little-endian
        uint32 indices ``r * W + c`` (row, column), in 3-D ``(l * H + r) * W + c`` (layer, row,
        column). ``targets`` is None, or the cells to cover, encoded like ``free``. In the task
        ``"coverage"``, None means all free cells.

        ``commands`` is a text of the letters ``lurd``, in 3-D of the letters ``lurdio``.
        ``scanned`` is the base64 text of ``numpy.packbits`` of one flag for each command: whether a
        scan followed the command. If a scan followed every command, ``scanned`` is None or missing.
        ``status`` is ``"complete"``, ``"stalled"`` or ``"limit"``; ``unreachable`` is the number of
        free cells that no particle can reach.

        ``playing`` states whether the page starts to play at once. If a user prefers reduced
        motion, the page shows the end of the episode and does not play at once.

        Only the data of an episode with noise contain ``moments``, ``looks``, ``noise``, ``goal``,
        ``truth`` and ``seen``. The data of an episode with noise contain no ``start`` and no
        ``targets``. ``moments`` is the base64 text of `shoal.views.swarm.films.packed_moments`, and
        ``looks`` explains the colour codes of the cells. ``noise`` holds the probabilities of the
        noise by name, and ``goal`` is the number of cells to classify. ``truth`` states whether the
        true map is known, so that the page can show classification errors. ``seen`` states whether
        the positions of the particles are observed positions instead of true positions.
    """
    return {
        "title": f"{episode.task.capitalize()} of {episode.workspace.name}",
        "map": episode.workspace.name,
        "task": episode.task,
        "policy": episode.policy,
        "rule": episode.rule,
        "shape": list(episode.workspace.shape),
        "spacing": None if episode.workspace.spacing is None else list(episode.workspace.spacing),
        "free": _packed(episode.workspace.free),
        "commands": episode.commands,
        "scanned": None if episode.trace.scanned.all() else _packed(episode.trace.scanned),
        "status": str(episode.status),
        "unreachable": episode.unreachable,
        "playing": True,
        "seed": episode.seed,
        "version": episode.versions["shoal"],
    } | (_recorded(episode) if episode.noisy else _simulated(episode))


def _simulated(episode: SwarmEpisode) -> dict[str, object]:
    """Return the data that a player page needs to simulate an episode without noise."""
    flat = np.ravel_multi_index(tuple(episode.start.T), episode.workspace.shape)
    return {
        "start": base64.b64encode(flat.astype("<u4").tobytes()).decode(),
        "targets": None if episode.targets is None else _packed(episode.targets),
    }


def _recorded(episode: SwarmEpisode) -> dict[str, object]:
    """Return the recorded data of an episode with noise, which a player page cannot simulate."""
    errors = episode.errors
    if errors is None:
        seen, truth, goal = True, episode.truth is not None, len(episode.final()[1].known)
    else:
        seen, truth, goal = False, True, errors.free + errors.walls
    return {
        "moments": base64.b64encode(packed_moments(episode.moments())).decode(),
        "looks": {
            "unknown": moments.UNKNOWN,
            "free": moments.FREE,
            "frontier": moments.FRONTIER,
            "wrong": moments.FALSE_FREE,
            "tint": FRONTIER_TINT,
        },
        "noise": {
            **vars(episode.problem.noise or Noise()),
            "confidence": episode.problem.confidence,
        },
        "goal": goal,
        "seen": seen,
        "truth": truth,
    }


def _packed(mask: NDArray[np.bool_]) -> str:
    return base64.b64encode(np.packbits(mask.ravel()).tobytes()).decode()
