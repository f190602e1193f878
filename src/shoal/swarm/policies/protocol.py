"""What a policy is: its view of the swarm, its decision, and paths through known cells."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import Board, GridLayout, decode, encode, letters_of
from shoal.swarm.grid.state import Belief, new_field
from shoal.swarm.kernels import search as frontier_search

Decision = tuple[str, Any]
"""The result of one decision of a policy: commands, and the policy's memory for its
next decision.
"""


@dataclass(frozen=True)
class View:
    """All information that a policy may use for a decision.

    Each cell is a tuple of indices: (row, column) in two dimensions, and (layer, row, column) in
    three dimensions. Row 0 is on top.

    Parameters
    ----------
    belief : Belief
        The belief of the task. The belief's frontier contains the cells that the particles must
        still classify or cover.
    occupied : Board
        The cells that hold particles at the time of the decision.
    rule : str
        The move rule: "block", "merge" or "tilt".
    mapping : bool
        True for a mapping, whose frontier cells are unknown. False for a coverage, whose frontier
        cells are known to be free.
    moves : int
        Number of commands sent since the start of the episode.
    travelled : int
        Distance that all particles together travelled during the last command or the last run of
        equal commands, in cells.
    classified : int
        Number of frontier cells that the last command or the last run of equal commands classified.
    """

    belief: Belief
    occupied: Board
    rule: str = "block"
    mapping: bool = True
    moves: int = 0
    travelled: int = 0
    classified: int = 0


@runtime_checkable
class Policy(Protocol):
    """The interface of policies. `shoal.testing.check_policy` tests whether a policy follows the
    interface.

    ``decide(view, memory, rng)`` returns ``(commands, memory)``. Shoal sends all returned commands
    before the next decision, unless the task is complete earlier. If the policy can make no
    progress, ``commands`` is an empty text. ``memory`` is None at the first decision of an episode.
    A policy object never changes, so that one policy object can serve many episodes.

    A policy may have the attributes ``rules`` and ``dimensions``, such as ``rules = ("block",)``
    and ``dimensions = (2,)``. They state the move rules and the numbers of dimensions that the
    policy supports. Shoal refuses a problem with another move rule or another number of dimensions.
    A policy without these attributes supports all move rules, and two and three dimensions.
    """

    @property
    def name(self) -> str:
        """Name of the policy with its options, as written in summaries and files."""

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next commands, and the policy's memory for its next decision."""


ORDERS = {"column-major": frontier_search.COLUMN_MAJOR, "row-major": frontier_search.ROW_MAJOR}
# The order in which a search looks for the previous cell of a path, as the commands from the
# previous cell. For column-major order, the search looks left, up, in, out, down and right of a
# cell.
_PARENTS = {"column-major": "rdoiul", "row-major": "droilu"}


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


def search_of(
    layout: GridLayout, *, ties: str, neighbours: str, plan_size: int
) -> frontier_search.Search:
    """Return the working memory of a search for the nearest frontier cell."""
    if ties not in ORDERS:
        raise InvalidInputError(f"ties: expected one of {', '.join(ORDERS)}, got {ties!r}")
    parents = "".join(letter for letter in _PARENTS[ties] if letter in letters_of(layout.ndim))
    return frontier_search.Search(
        planes=np.zeros((7, layout.words[0] * layout.words[1]), dtype=np.uint64),
        plan=np.zeros(plan_size, dtype=np.int8),
        neighbours=check_neighbours(neighbours, layout.ndim),
        parents=encode(parents, ndim=layout.ndim),
        columns=np.zeros(layout.words[1], dtype=np.uint64),
        origin=np.zeros(2, dtype=np.int64),
        order=ORDERS[ties],
    )


def slides_of(layout: GridLayout) -> frontier_search.Slides:
    """Return the working memory of a search for the nearest frontier cell under the move rule
    ``tilt``.
    """
    rows, words = layout.words
    size = rows * words * 64
    return frontier_search.Slides(
        np.zeros(size, np.int64), np.zeros(size, np.int8), np.zeros(size, np.int64)
    )


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
        length = frontier_search.nearest_by_tilts(
            field, space, slides_of(layout), field.occupied, mapping
        )
    else:
        length = frontier_search.nearest(field, space, field.occupied)
    row, column = (int(i) for i in space.origin)
    cell = (row // layout.rows - 1, row % layout.rows - 1, column - 1)
    return decode(space.plan[:length]), cell[3 - layout.ndim :]


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
