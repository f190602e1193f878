"""GridWorld: the motion of all particles under one command. `shoal.swarm.kernels.moves` contains
the move rules.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_kind
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import RULES, Board, GridLayout, encode
from shoal.swarm.grid.state import SwarmState, check_cells, pushed
from shoal.swarm.maps.workspace import GridWorkspace


def check_start(
    workspace: GridWorkspace, cells: ArrayLike, *, rule: str = "block"
) -> NDArray[np.int64]:
    """Check start cells and return them as an int64 array of shape (n, ndim) in row-major order.

    Raises
    ------
    InvalidInputError
        Raised if ``cells`` is empty, or if a start cell is not a free cell of the workspace. Under
        the rules block and tilt, InvalidInputError is raised if a start cell is repeated.
    """
    check_kind(workspace, GridWorkspace, what="workspace")
    array = check_cells(cells, workspace.shape, what="start", rim=0)
    if len(array) == 0:
        raise InvalidInputError("start: expected at least one particle, got none")
    blocked = ~workspace.free[tuple(array.T)]
    if blocked.any():
        raise InvalidInputError(
            f"start: expected free cells, got the obstacle {tuple(array[blocked][0].tolist())}"
        )
    twice = (array[1:] == array[:-1]).all(axis=1)
    if rule != "merge" and twice.any():
        cell = tuple(array[1:][twice][0].tolist())
        raise InvalidInputError(
            f"start: expected at most one particle per cell under rule {rule}, got two at {cell}"
        )
    return array


@dataclass(frozen=True)
class GridWorld:
    """The motion of particles in a workspace under a shared command. No method of the class changes
    its arguments.

    Parameters
    ----------
    workspace : GridWorkspace
    rule : str
        The move rule: "block", "merge" or "tilt".

    Raises
    ------
    UnknownNameError
        Raised if no move rule has the given name.

    Notes
    -----
    Sources: paper M, section I, for the rule block, and docs/concepts/world.md.

    Examples
    --------
    In the following example, three particles in a row move together to the right and queue at the
    wall.

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
        RULES.get(self.rule)

    @cached_property
    def layout(self) -> GridLayout:
        """The window of cells that all boards of the workspace share: the workspace and a rim of
        one cell.
        """
        return GridLayout(self.workspace.shape)

    @cached_property
    def free(self) -> Board:
        """The free cells of the workspace, as a board (a set of cells)."""
        return Board.of_mask(self.workspace.free)

    def initial(self, cells: ArrayLike) -> SwarmState:
        """Return the state of a swarm with particles at ``cells``, an int array of shape (n, ndim)
        in any order.

        Raises
        ------
        InvalidInputError
            Raised if `check_start` refuses the start cells.
        """
        checked = check_start(self.workspace, cells, rule=self.rule)
        return SwarmState.of_cells(self.layout, checked, shared=self.rule == "merge")

    def step(self, state: SwarmState, command: str) -> SwarmState:
        """Return the state of the swarm after one command, which is a letter of ``lurd`` in 2-D or
        ``lurdio`` in 3-D.
        """
        *_, last = self.pushes(state, command)
        return last

    def pushes(self, state: SwarmState, command: str) -> Iterator[SwarmState]:
        """Yield the state of the swarm after each push of one command. In a push, all particles try
        to move by one cell.

        Under the move rules block and merge, a command is one push. Under the move rule tilt, a
        command is a series of pushes. In the last push, no particle moves: this push reveals the
        walls. An observer who sees only the first and the last state of a tilt can infer all states
        between them, because particles in one line keep their order.
        """
        letters = encode(command, ndim=self.workspace.ndim)
        if len(letters) != 1:
            raise InvalidInputError(f"expected one command, got {command!r}")
        while True:
            after = pushed(self.layout, self.free.words, state, int(letters[0]), self.rule)
            yield after
            if self.rule != "tilt" or after.occupied == state.occupied:
                return
            state = after
