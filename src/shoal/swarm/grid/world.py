"""GridWorld: what a command does to the particles."""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.errors import InvalidInputError, UnknownNameError
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.commands import RULES, encode
from shoal.swarm.grid.fields import pushed
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.maps.workspace import GridWorkspace


def check_start(workspace: GridWorkspace, cells: ArrayLike, *, rule: str = "block") -> NDArray[np.int64]:
    """Return start cells as an int64 array (n, ndim), sorted in row-major order.

    Raises
    ------
    InvalidInputError
        If a cell is outside, an obstacle, or (but for rule merge) given twice; or there is none.
    """
    try:
        array = np.asarray(cells)
    except ValueError:  # rows of several lengths
        expected = f"start: expected integer cells of shape (n, {workspace.ndim})"
        raise InvalidInputError(f"{expected}, got rows of different lengths") from None
    if array.ndim != 2 or array.shape[1] != workspace.ndim or not np.issubdtype(array.dtype, np.integer):
        raise InvalidInputError(f"start: expected integer cells of shape (n, {workspace.ndim}), got {array.dtype} {array.shape}")
    if len(array) == 0:
        raise InvalidInputError("start: expected at least one particle, got none")
    outside = ((array < 0) | (array >= np.array(workspace.shape))).any(axis=1)
    if outside.any():
        cell = tuple(int(i) for i in array[outside][0])
        raise InvalidInputError(f"start: expected cells inside {workspace.shape}, got {cell}")
    blocked = ~workspace.free[tuple(array.T)]
    if blocked.any():
        cell = tuple(int(i) for i in array[blocked][0])
        raise InvalidInputError(f"start: expected free cells, got the obstacle {cell}")
    flat = np.sort(np.ravel_multi_index(tuple(array.T), workspace.shape))
    twice = flat[1:][flat[1:] == flat[:-1]]
    if rule != "merge" and len(twice):
        cell = tuple(int(i) for i in np.unravel_index(twice[0], workspace.shape))
        raise InvalidInputError(f"start: expected one particle a cell under rule {rule}, got two at {cell}")
    return np.stack(np.unravel_index(flat, workspace.shape), axis=1).astype(np.int64)


@dataclass(frozen=True)
class GridWorld:
    """The dynamics of particles in a workspace under one shared command.

    Parameters
    ----------
    workspace : GridWorkspace
    rule : str
        "block", "merge" or "tilt".

    Raises
    ------
    UnknownNameError
        If there is no such rule.

    Notes
    -----
    Source: paper M, section I (rule block); docs/concepts/world.md. Nothing here is changed in place.

    Examples
    --------
    A train of three moves together; against the wall it queues.

    >>> world = GridWorld(GridWorkspace([[1, 1, 1, 1, 1]]))
    >>> state = world.initial([(0, 1), (0, 2), (0, 3)])
    >>> [tuple(cell) for cell in world.step(state, "r").cells.tolist()]
    [(0, 2), (0, 3), (0, 4)]
    >>> world.step(world.step(state, "r"), "r") == world.step(state, "r")
    True
    """

    workspace: GridWorkspace
    rule: str = "block"

    def __post_init__(self) -> None:
        if self.rule not in RULES:
            near = difflib.get_close_matches(self.rule, RULES, n=1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise UnknownNameError(f"unknown move rule {self.rule!r}: {hint}(known: {', '.join(RULES)})")

    @cached_property
    def layout(self) -> GridLayout:
        """The window of the workspace's boards."""
        return GridLayout(self.workspace.shape)

    @cached_property
    def free(self) -> Board:
        """The free cells as a board."""
        return Board.of_mask(self.workspace.free)

    def initial(self, cells: ArrayLike) -> SwarmState:
        """Return the state with particles at ``cells``, int, shape (n, ndim), in any order.

        Raises
        ------
        InvalidInputError
            See `check_start`.
        """
        checked = check_start(self.workspace, cells, rule=self.rule)
        return SwarmState.of_cells(self.layout, checked, shared=self.rule == "merge")

    def step(self, state: SwarmState, command: str) -> SwarmState:
        """Return the state after one command, a letter out of ``lurd`` (3-D: ``lurdio``)."""
        *_, last = self.pushes(state, command)
        return last

    def pushes(self, state: SwarmState, command: str) -> Iterator[SwarmState]:
        """Yield the states after each push of one command.

        Under block and merge a command is one push. A tilt is pushes until nothing moves; the last one, at which
        everything stays, is yielded too: it is what tells the walls. Particles of a row keep their order, so an observer who
        sees only the first and the last of these states knows all between.
        """
        letters = encode(command, ndim=self.workspace.ndim)
        if len(letters) != 1:
            raise InvalidInputError(f"expected one command, got {command!r}")
        while True:
            after = self._push(state, int(letters[0]))
            yield after
            if self.rule != "tilt" or after.occupied == state.occupied:
                return
            state = after

    def _push(self, state: SwarmState, code: int) -> SwarmState:
        return pushed(self.layout, self.free.words, state, code, self.rule)
