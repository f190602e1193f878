"""Paths of one particle through known free cells, to the frontier."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import Board, GridLayout, decode, encode, letters_of
from shoal.swarm.grid.state import Belief, new_field
from shoal.swarm.kernels import search as kernels

ORDERS = {"column-major": kernels.COLUMN_MAJOR, "row-major": kernels.ROW_MAJOR}
# The order in which a search looks for the previous cell of a path, as the commands from the
# previous cell. For column-major order, the search looks left, up, in, out, down and right of a
# cell.
_PARENTS = {"column-major": "rdoiul", "row-major": "droilu"}


def path_to_frontier(
    belief: Belief,
    sources: Board,
    *,
    rule: str = "block",
    mapping: bool = True,
    ties: str = "column-major",
    neighbours: str = "lurd",
) -> str:
    """Return the shortest sequence of commands that moves a particle from ``sources`` to the
    frontier, or "" if no path exists.

    The breadth-first search passes through cells that are known to be free and ends at the first
    frontier cell found.

    Parameters
    ----------
    belief : Belief
    sources : Board
        The start cells of the search.
    rule : str
        The move rule: "block", "merge" or "tilt". Under "tilt", the path has the smallest possible
        number of tilts.
    mapping : bool
        True for a mapping, whose frontier cells are unknown. False for a coverage, whose frontier
        cells are known to be free. Only the rule "tilt" uses ``mapping``.
    ties : str
        The order in which the search expands cells of equal distance: "column-major" (leftmost
        column first, each column from top to bottom) or "row-major".
    neighbours : str
        The order in which the search visits the neighbours of a cell, as command letters.

    Notes
    -----
    Source: paper M, algorithm 3. The page docs/concepts/policies.md explains the rule for cells of
    equal distance.

    Examples
    --------
    >>> from shoal.swarm import GridWorkspace, GridWorld, Mapping
    >>> world = GridWorld(GridWorkspace([[1, 1, 1]]))
    >>> state = world.initial([(0, 1)])
    >>> path_to_frontier(Mapping().begin(world, state), state.occupied)
    'l'
    """
    return route_to_frontier(
        belief, sources, rule=rule, mapping=mapping, ties=ties, neighbours=neighbours
    )[0]


def route_to_frontier(
    belief: Belief, sources: Board, *, rule: str, mapping: bool, ties: str, neighbours: str
) -> tuple[str, tuple[int, ...]]:
    """Return the path that `path_to_frontier` finds, and the start cell of the path.

    Under the rule "tilt", the returned start cell has no meaning.
    """
    layout = sources.layout
    space = search_of(layout, ties=ties, neighbours=neighbours, plan_size=len(belief.open) + 2)
    field = new_field(
        layout,
        occupied=sources.words.ravel(),
        open=belief.open.words.ravel(),
        known=belief.known.words.ravel(),
        frontier=belief.frontier.words.ravel(),
    )
    if rule == "tilt":
        length = kernels.nearest_by_tilts(field, space, slides_of(layout), field.occupied, mapping)
    else:
        length = kernels.nearest(field, space, field.occupied)
    row, column = (int(i) for i in space.origin)
    cell = (row // layout.rows - 1, row % layout.rows - 1, column - 1)
    return decode(space.plan[:length]), cell[3 - layout.ndim :]


def check_neighbours(neighbours: str, ndim: int) -> NDArray[np.int8]:
    """Return the numeric codes of the command letters in ``neighbours``. In 3-D, "lurd" means
    "lurdio".
    """
    text = neighbours + "io" if ndim == 3 and len(neighbours) == 4 else neighbours
    if sorted(text) != sorted(letters_of(ndim)):
        raise InvalidInputError(
            f"neighbours: expected an order of {letters_of(ndim)!r}, got {neighbours!r}"
        )
    return encode(text, ndim=ndim)


def search_of(layout: GridLayout, *, ties: str, neighbours: str, plan_size: int) -> kernels.Search:
    """Return the working memory of a search for the nearest frontier cell."""
    if ties not in ORDERS:
        raise InvalidInputError(f"ties: expected one of {', '.join(ORDERS)}, got {ties!r}")
    parents = "".join(letter for letter in _PARENTS[ties] if letter in letters_of(layout.ndim))
    return kernels.Search(
        planes=np.zeros((7, layout.words[0] * layout.words[1]), dtype=np.uint64),
        plan=np.zeros(plan_size, dtype=np.int8),
        neighbours=check_neighbours(neighbours, layout.ndim),
        parents=encode(parents, ndim=layout.ndim),
        columns=np.zeros(layout.words[1], dtype=np.uint64),
        origin=np.zeros(2, dtype=np.int64),
        order=ORDERS[ties],
    )


def slides_of(layout: GridLayout, *, used: bool = True) -> kernels.Slides:
    """Return the working memory of a search for the nearest frontier cell under the move rule
    ``tilt``, which is empty for a search that is not used.
    """
    rows, words = layout.words
    size = rows * words * 64 * used
    return kernels.Slides(
        np.zeros(size, np.int64), np.zeros(size, np.int8), np.zeros(size, np.int64)
    )


_STEPS = {
    "l": (0, 0, -1),
    "u": (0, -1, 0),
    "r": (0, 0, 1),
    "d": (0, 1, 0),
    "i": (-1, 0, 0),
    "o": (1, 0, 0),
}
OPPOSITE = {"l": "r", "r": "l", "u": "d", "d": "u", "i": "o", "o": "i"}


def step_from(cell: tuple[int, ...], command: str) -> tuple[int, ...]:
    """Return the cell next to ``cell`` in the direction of ``command``.

    Examples
    --------
    >>> step_from((3, 4), "u")
    (2, 4)
    """
    step = _STEPS[command][3 - len(cell) :]
    return tuple(a + b for a, b in zip(cell, step, strict=True))
