"""Conversion between boards or states and the flat arrays of kernels. The function `pushed` simulates one push."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board, GridLayout, Words
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.kernels.dynamics import moves

RULE_CODES = {"block": moves.BLOCK, "merge": moves.MERGE, "tilt": moves.TILT}


def pushed(layout: GridLayout, free: Words, state: SwarmState, code: int, rule: str) -> SwarmState:
    """Return the state of the swarm after one push in the direction of the command with the number ``code``."""
    everything = np.full(free.size, np.uint64(2**64 - 1))
    field = new_field(layout, free=free.ravel(), occupied=state.occupied.words.flatten(), known=everything, counts=_counts(state))
    moves.push(field, code, RULE_CODES[rule])
    return state_of(layout, field)


def field_of(free: Words, state: SwarmState, belief: Belief) -> moves.Field:
    """Copy a state and a belief into flat arrays for kernels. Kernels change the copies in place."""
    return new_field(
        state.occupied.layout,
        free=free.ravel(),
        occupied=state.occupied.words.flatten(),
        open=belief.open.words.flatten(),
        known=belief.known.words.flatten(),
        frontier=belief.frontier.words.flatten(),
        counts=_counts(state),
    )


def new_field(layout: GridLayout, *, counts: NDArray[np.int32] | None = None, **boards: Words) -> moves.Field:
    """Return the flat arrays for kernels: the given boards, an empty board for each missing board, and working memory."""
    block = max(moves.BLOCK_WORDS, layout.words[1])
    work = {name: np.zeros(block, dtype=np.uint64) for name in ("tried", "moving")}
    missing = [name for name in ("free", "occupied", "open", "known", "frontier") if name not in boards]
    return moves.Field(
        **boards,
        **dict(zip(missing, empty_boards(layout, len(missing)), strict=True)),
        **work,
        counts=np.zeros((0, 0), dtype=np.int32) if counts is None else counts,
        layers=layout.layers,
        rows=layout.rows,
        width=layout.words[1],
    )


def empty_boards(layout: GridLayout, count: int) -> list[Words]:
    """Return ``count`` empty boards as flat arrays."""
    return [np.zeros(layout.words[0] * layout.words[1], dtype=np.uint64) for _ in range(count)]


def _counts(state: SwarmState) -> NDArray[np.int32] | None:
    """Return the number of particles per cell in the layout of kernels: flat rows, with 64 columns for each word."""
    if state.counts is None:
        return None
    layout = state.occupied.layout
    rows, words = layout.words
    wide = np.zeros((rows, 64 * words), dtype=np.int32)
    wide[:, : layout.columns] = state.counts.reshape(rows, layout.columns)
    return wide


def board_of(layout: GridLayout, flat: Words) -> Board:
    """Convert a flat array of a kernel to a board."""
    return Board(layout, flat.reshape(layout.words))


def state_of(layout: GridLayout, field: moves.Field) -> SwarmState:
    """Return the state of the swarm that the flat arrays of kernels hold."""
    counts = None
    if field.counts.size:
        counts = field.counts[:, : layout.columns].reshape(layout.window).copy()
    return SwarmState(board_of(layout, field.occupied), counts)
