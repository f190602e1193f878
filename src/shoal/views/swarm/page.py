"""The player's data of a swarm episode."""

from __future__ import annotations

import base64

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm import SwarmEpisode
from shoal.swarm.noise import Noise, moments
from shoal.views.player import render
from shoal.views.swarm.cell_colours import FRONTIER_TINT
from shoal.views.swarm.recording import packed_moments

LARGEST = 2_000_000_000
"""Maximum number of cells times moves that a page plays smoothly."""


def player_page(episode: SwarmEpisode) -> str:
    """Return the HTML page that plays an episode.

    Raises
    ------
    InvalidInputError
        If map and episode together are too large for a browser.
    """
    work = episode.workspace.free.size * max(1, episode.moves)
    if work > LARGEST or episode.workspace.free.size > LARGEST // 100:
        raise InvalidInputError(
            f"the HTML player: expected a number of cells times a number of moves of at most {LARGEST:.0e}, got {work:.1e} "
            "(use .gif or .mp4)"
        )
    return render("swarm", page_data(episode))


def page_data(episode: SwarmEpisode) -> dict[str, object]:
    """Return the data of the page for JSON.

    Returns
    -------
    dict
        - ``title``, ``map``, ``policy``, ``version`` : str, shown literally; ``seed`` : int or None.
        - ``task`` : ``"mapping"``, ``"coverage"`` or ``"subset-coverage"``.
        - ``rule`` : ``"block"``, ``"merge"`` or ``"tilt"``.
        - ``shape`` : ``[H, W]`` or ``[D, H, W]``; ``spacing`` : the size of a cell along each axis, or None or missing.
        - ``free`` : base64 of ``numpy.packbits(free.ravel())``; a set bit is a free cell.
        - ``start`` : base64 of the particles as little-endian uint32 indices ``r * W + c``, in 3-D ``(l * H + r) * W + c``.
        - ``targets`` : None, or the cells to cover in the form of ``free``. In the task ``"coverage"``, None means all free cells.
        - ``commands`` : str of the letters ``lurd``, in 3-D ``lurdio``.
        - ``scanned`` : None or missing if a scan followed every command; otherwise base64 of ``numpy.packbits`` of one flag per
          command.
        - ``status`` : ``"complete"``, ``"stalled"`` or ``"limit"``; ``unreachable`` : number of free cells that no particle can
          reach.
        - ``playing`` : whether the page starts to play at once. For users who prefer reduced motion, it shows the end instead.
        - With noise, instead of ``start`` and ``targets``: ``moments`` : base64 of `shoal.views.swarm.recording.packed_moments`;
          ``looks`` : meaning of their numbers; ``noise`` : probabilities by name; ``goal`` : number of cells to classify; ``truth``
          : whether classification errors are known; ``seen`` : whether the positions of particles are observed instead of true.
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
    """Return the data that a page needs to simulate an episode."""
    flat = np.ravel_multi_index(tuple(episode.start.T), episode.workspace.shape)
    return {
        "start": base64.b64encode(flat.astype("<u4").tobytes()).decode(),
        "targets": None if episode.targets is None else _packed(episode.targets),
    }


def _recorded(episode: SwarmEpisode) -> dict[str, object]:
    """Return the recorded data of an episode with noise, which a page cannot simulate."""
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
        "noise": {**vars(episode.problem.noise or Noise()), "confidence": episode.problem.confidence},
        "goal": goal,
        "seen": seen,
        "truth": truth,
    }


def _packed(mask: NDArray[np.bool_]) -> str:
    return base64.b64encode(np.packbits(mask.ravel()).tobytes()).decode()
