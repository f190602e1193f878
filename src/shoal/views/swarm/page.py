"""The data of a swarm episode for the player page."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm import SwarmEpisode, noise
from shoal.swarm.noise import Moment, Noise
from shoal.views.player import render
from shoal.views.swarm.colours import FRONTIER_TINT

LARGEST = 2_000_000_000
"""Maximum product of the numbers of particles and moves of an episode, which a page simulates within a
minute; for recorded episodes, of the numbers of cells and moves.
"""

LONGEST = 10_000_000
"""Maximum number of moves, of which a page keeps some numbers each."""

WIDEST = 20_000_000
"""Maximum number of cells of a page's map."""

HEAVIEST = 40_000_000
"""Maximum size, in bytes, of the encoded moments of an episode. A page loads moments of this size
quickly.
"""


def player_page(episode: SwarmEpisode) -> str:
    """Return the HTML page that plays a swarm episode.

    Raises
    ------
    InvalidInputError
        If the data of the map and the episode together are too large for a browser.
    """
    check_page(episode)
    return render("swarm", page_data(episode))


def check_page(episode: SwarmEpisode) -> None:
    """Refuse an episode that is too large for a browser, without a replay of its moves.

    Raises
    ------
    InvalidInputError
    """
    cells = episode.workspace.free.size
    parts, unit = (cells, "cells") if _is_recorded(episode) else (len(episode.start), "particles")
    for kind, most, count in (
        ("cells", WIDEST, cells),
        ("moves", LONGEST, episode.moves),
        (f"{unit} times a number of moves", LARGEST, parts * episode.moves),
    ):
        if count > most:
            raise InvalidInputError(
                f"the HTML player: expected a number of {kind} of at most {most}, got {count} (use"
                " .gif or .mp4)"
            )


def _is_recorded(episode: SwarmEpisode) -> bool:
    """Return whether a page cannot simulate an episode: one with noise, or a drive after whose
    interruption the particles were elsewhere.
    """
    return bool(episode.noisy or episode.placed)


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
        ``targets``. ``moments`` is the base64 text of `pack_moments`, and
        ``looks`` explains the colour codes of the cells. ``noise`` holds the probabilities of the
        noise by name, and ``goal`` is the number of cells to classify. ``truth`` states whether the
        true map is known, so that the page can show classification errors. ``seen`` states whether
        the positions of the particles are observed positions instead of true positions. ``points``,
        where it is present, is the base64 text of where the particles truly were, for each moment:
        their number, and row and column of each in hundredths of a cell, as little-endian int32.
    """
    return {
        "title": f"{episode.task.capitalize()} of {episode.workspace.name}",
        "map": episode.workspace.name,
        "task": episode.task,
        "policy": episode.policy,
        "rule": episode.rule,
        "shape": list(episode.workspace.shape),
        "spacing": None if episode.workspace.spacing is None else list(episode.workspace.spacing),
        "free": _pack(episode.workspace.free),
        "commands": episode.commands,
        "scanned": None if episode.trace.scanned.all() else _pack(episode.trace.scanned),
        "status": str(episode.status),
        "unreachable": episode.unreachable,
        "playing": True,
        "seed": episode.seed,
        "version": episode.versions["shoal"],
    } | (_recorded_data(episode) if _is_recorded(episode) else _simulation_data(episode))


def _simulation_data(episode: SwarmEpisode) -> dict[str, object]:
    """Return the data that a player page needs to simulate an episode without noise."""
    flat = np.ravel_multi_index(tuple(episode.start.T), episode.workspace.shape)
    return {
        "start": base64.b64encode(flat.astype("<u4").tobytes()).decode(),
        "targets": None if episode.targets is None else _pack(episode.targets),
    }


def _recorded_data(episode: SwarmEpisode) -> dict[str, object]:
    """Return the recorded data of an episode that a player page cannot simulate."""
    errors = episode.errors
    if errors is None:
        seen, truth, goal = True, episode.truth is not None, len(episode.final()[1].known)
    else:
        seen, truth, goal = False, True, errors.free + errors.walls
    return {
        "moments": base64.b64encode(pack_moments(episode.moments())).decode(),
        "looks": {
            "unknown": noise.UNKNOWN,
            "free": noise.FREE,
            "frontier": noise.FRONTIER,
            "wrong": noise.FALSE_FREE,
            "tint": FRONTIER_TINT,
        },
        "noise": {
            **vars(episode.problem.noise or Noise()),
            "confidence": episode.problem.confidence,
        },
        "goal": goal,
        "seen": seen and episode.true_cells is None,
        "truth": truth,
    } | (
        {}
        if episode.true_cells is None
        else {"points": base64.b64encode(_pack_points(episode)).decode()}
    )


def _pack_points(episode: SwarmEpisode) -> bytes:
    """Return where the particles were at each moment, as `page_data` describes."""
    assert episode.true_cells is not None
    parts, points = [], np.empty((0, 2))
    for move in range(episode.moves + 1):
        points = episode.true_cells.get(move, points)  # without a scan, those of the scan before
        parts.append(np.array([len(points)]))
        parts.append(np.rint(100 * points).ravel())
    return np.concatenate(parts).astype("<i4").tobytes()


def _pack(mask: NDArray[np.bool_]) -> str:
    return base64.b64encode(np.packbits(mask.ravel()).tobytes()).decode()


def pack_moments(frames: Iterable[Moment]) -> bytes:
    """Return the moments of an episode as bytes.

    For each moment, the bytes contain two lists: the cells of the particles, and the cells whose
    colour code changed. In the second list, the new colour code follows each cell. Each list begins
    with its length. A cell is an index into the grid with its rim, encoded as the difference from
    the previous index of the list. Lengths and index differences are base-128 numbers, with the
    lowest bits first. The high bit of a byte is set if another byte of the same number follows.
    Before the first moment, all cells have the colour code of unknown cells.

    Raises
    ------
    InvalidInputError
        If the encoded moments are too large for a browser.

    Examples
    --------
    >>> looks = np.array([[8, 16, 8]], dtype=np.uint8)
    >>> list(pack_moments([Moment(looks == 16, looks), Moment(looks == 16, looks)]))
    [1, 1, 1, 1, 16, 1, 1, 0]
    """
    data, before = bytearray(), None
    for moment in frames:
        looks = moment.looks.ravel()
        if before is None:
            before = np.full_like(looks, noise.UNKNOWN)
        changed = np.flatnonzero(looks != before)
        _write(data, np.flatnonzero(moment.particles.ravel()))
        _write(data, changed, looks[changed])
        before = looks
        if len(data) > HEAVIEST:
            raise InvalidInputError(
                f"the HTML player: expected at most {HEAVIEST // 10**6} MB of moments with noise,"
                " got more (use .gif or .mp4)"
            )
    return bytes(data)


def _write(
    data: bytearray, cells: NDArray[np.int64], looks: NDArray[np.uint8] | None = None
) -> None:
    data += bytes(_seven_bits(len(cells)))
    steps = np.diff(cells, prepend=0).tolist()
    for i, step in enumerate(steps):
        if step < 128:
            data.append(step)
        else:
            data += bytes(_seven_bits(step))
        if looks is not None:
            data.append(looks[i])


def _seven_bits(number: int) -> Iterator[int]:
    while number > 127:
        yield number & 127 | 128
        number >>= 7
    yield number
