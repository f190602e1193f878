"""Between boards and kernels: work space for a running episode, and single pushes for the step-by-step world."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.commands import decode, encode, letters_of
from shoal.swarm.grid.fields import RULE_CODES, empty_boards, field_of, new_field
from shoal.swarm.grid.scans import EVERY_MOVE, ScanRule
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.kernels import moves, play, prospect, runs, search, slide, survey

if TYPE_CHECKING:
    from numpy.random import Generator

    from shoal.swarm.policies import View

RUNNING, COMPLETE, STALLED = play.RUNNING, play.COMPLETE, play.STALLED
KINDS = {"equal": runs.EQUAL, "doubling": runs.DOUBLING, "hyper": runs.HYPER, "adaptive": runs.ADAPTIVE}
LONGEST_RUN = 500  # that an adaptive policy weighs
ORDERS = {"column-major": search.COLUMN_MAJOR, "row-major": search.ROW_MAJOR}
# The cell from which a command comes, in the order in which such cells are expanded; column-major: left, up, in, out, down, right.
_PARENTS = {"column-major": "rdoiul", "row-major": "droilu"}


def check_neighbours(neighbours: str, ndim: int) -> NDArray[np.int8]:
    """Return the codes of an order of neighbours; "lurd" stands for "lurdio" in 3-D."""
    text = neighbours + "io" if ndim == 3 and len(neighbours) == 4 else neighbours
    if sorted(text) != sorted(letters_of(ndim)):
        raise InvalidInputError(f"neighbours: expected an order of {letters_of(ndim)!r}, got {neighbours!r}")
    return encode(text, ndim=ndim)


def search_of(layout: GridLayout, *, ties: str, neighbours: str, plan_size: int) -> search.Search:
    """Return the work space of a frontier search."""
    if ties not in ORDERS:
        raise InvalidInputError(f"ties: expected one of {', '.join(ORDERS)}, got {ties!r}")
    parents = "".join(letter for letter in _PARENTS[ties] if letter in letters_of(layout.ndim))
    return search.Search(
        planes=np.zeros((7, layout.words[0] * layout.words[1]), dtype=np.uint64),
        plan=np.zeros(plan_size, dtype=np.int8),
        neighbours=check_neighbours(neighbours, layout.ndim),
        parents=encode(parents, ndim=layout.ndim),
        columns=np.zeros(layout.words[1], dtype=np.uint64),
        origin=np.zeros(2, dtype=np.int64),
        order=ORDERS[ties],
    )


def slides_of(layout: GridLayout, rule: str) -> slide.Slides:
    """Return the work space of the tilt search; empty for other rules."""
    rows, words = layout.words
    size = rows * words * 64 if rule == "tilt" else 0
    return slide.Slides(np.zeros(size, np.int64), np.zeros(size, np.int8), np.zeros(size, np.int64))


def scanning_of(scanning: ScanRule | None) -> runs.Scanning:
    """Return a scan rule as kernels know it; without one the log gives the scans."""
    return runs.Scanning(runs.GIVEN, 1) if scanning is None else runs.Scanning(KINDS[scanning.kind], scanning.step)


def scout_of(layout: GridLayout, scanning: ScanRule | None) -> runs.Scout | None:
    """Return what an adaptive scan rule works in; None for all others."""
    if scanning is None or KINDS[scanning.kind] != runs.ADAPTIVE:
        return None
    words = layout.words[0] * layout.words[1]
    longest = min(max(layout.window), LONGEST_RUN)
    boards = [np.zeros(words, dtype=np.uint64) for _ in range(3)]
    return runs.Scout(
        survey=survey.Survey(
            prices=np.array((scanning.scan_cost, scanning.move_cost), dtype=np.float64),
            tallies=np.zeros((survey.TALLIES, 2), dtype=np.int64),
            gains=np.zeros((len(letters_of(layout.ndim)), longest + 1), dtype=np.float64),
            known=boards[0],
            columns=layout.columns,
        ),
        prospect=prospect.Prospect(boards[1], boards[2], np.zeros((0, 0), np.int32), np.zeros(5, np.int64)),
    )


def mind_of(
    layout: GridLayout,
    n_free: int,
    belief: Belief,
    *,
    rule: str,
    ties: str,
    neighbours: str,
    plan: str,
    scanning: ScanRule | None = EVERY_MOVE,
) -> play.Mind:
    """Return the memory of a built-in policy that has not decided anything yet, or follows ``plan``."""
    space = search_of(layout, ties=ties, neighbours=neighbours, plan_size=max(n_free + 2, len(plan), prospect.LONGEST_PLAN))
    memory = np.zeros(play.MEMORY, dtype=np.int64)
    memory[play.RUN_COMMAND], memory[play.SCANNED] = -1, 1
    memory[play.REMAINING] = len(belief.frontier)
    if plan:
        space.plan[: len(plan)] = encode(plan, ndim=layout.ndim)
        memory[play.PLAN_LENGTH] = len(plan)
    single, visited = empty_boards(layout, 2)
    trail = np.zeros(n_free + 2, dtype=np.int8)
    return play.Mind(memory, space, slides_of(layout, rule), single, visited, trail, scanning_of(scanning))


def path_to_frontier(
    belief: Belief,
    sources: Board,
    *,
    rule: str = "block",
    mapping: bool = True,
    ties: str = "column-major",
    neighbours: str = "lurd",
) -> str:
    """Return the shortest commands that bring a particle from ``sources`` onto a frontier cell, "" if none do.

    Breadth-first search through known-free cells. At each distance cells are expanded in the order of ``ties``, their neighbours in
    the order of ``neighbours``; the first frontier cell met is the target.

    Parameters
    ----------
    belief : Belief
    sources : Board
        The cells to start from.
    rule : str
        Under "tilt" the path is over stop cells and has the fewest tilts.
    mapping : bool
        Matters under "tilt" only: whether frontier cells are unknown (mapping) or known to be free (coverage).
    ties : str
        "column-major" (leftmost column first, top to bottom) or "row-major".
    neighbours : str
        An order of the commands.

    Notes
    -----
    Source: paper M, algorithm 3; tie rule: docs/concepts/policies.md.

    Examples
    --------
    >>> from shoal.swarm import GridWorkspace, GridWorld, Mapping
    >>> world = GridWorld(GridWorkspace([[1, 1, 1]]))
    >>> state = world.initial([(0, 1)])
    >>> path_to_frontier(Mapping().begin(world, state), state.occupied)
    'l'
    """
    return route_to_frontier(belief, sources, rule=rule, mapping=mapping, ties=ties, neighbours=neighbours)[0]


def route_to_frontier(
    belief: Belief, sources: Board, *, rule: str, mapping: bool, ties: str, neighbours: str
) -> tuple[str, tuple[int, ...]]:
    """Return the path of `path_to_frontier` and the cell from which it starts (meaningless under "tilt")."""
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
        length = slide.nearest_by_tilts(field, space, slides_of(layout, rule), field.occupied, mapping)
    else:
        length = search.nearest(field, space, field.occupied)
    row, column = (int(i) for i in space.origin)
    cell = (row // layout.rows - 1, row % layout.rows - 1, column - 1)
    return decode(space.plan[:length]), cell[3 - layout.ndim :]


def choose_driven(code: int, state: SwarmState, mind: play.Mind, rng: Generator) -> None:
    """Choose the particle that a policy drives: elect-particle a random one, depth-first the first; others drive none."""
    if code not in {play.ELECT, play.DEPTH_FIRST}:
        return
    layout, cells = state.occupied.layout, state.occupied.cells
    cell = cells[rng.integers(0, len(cells)) if code == play.ELECT else 0] + 1
    layer = int(cell[0]) if layout.ndim == 3 else 0
    mind.memory[play.ROW], mind.memory[play.COLUMN] = layer * layout.rows + cell[-2], cell[-1]


def new_log(moves_at_most: int) -> play.Log:
    """Return an empty log with room for that many moves."""
    return play.Log(
        np.zeros(moves_at_most, np.int8),
        np.zeros(moves_at_most, np.int32),
        np.zeros(moves_at_most, np.int32),
        np.zeros(moves_at_most, np.int64),
        np.zeros(moves_at_most, np.bool_),
    )


@cache
def load_kernels() -> None:
    """Load the episode kernel, or compile it if this installation has not yet; takes effect once in a process."""
    layout = GridLayout((1, 1))
    here = Board.of_cells(layout, [(0, 0)])
    state, belief = SwarmState(here), Belief(here, here, here)
    mind = mind_of(layout, 1, belief, rule="block", ties="column-major", neighbours="lurd", plan="")
    game = Game(play.MANUAL, mind, None, rule="block", mapping=True, rng=np.random.default_rng(0))
    game.play_on(field_of(here.words, state, belief), new_log(0))


@dataclass(frozen=True)
class Game:
    """A built-in policy at play, in pieces as long as the logs that it is given."""

    code: int
    mind: play.Mind
    scout: runs.Scout | None
    rule: str
    mapping: bool
    rng: Generator

    def play_on(self, field: moves.Field, log: play.Log) -> tuple[int, int]:
        """Play until the log is full; return (moves, status code). What is random is drawn here, outside the kernel."""
        if self.code == play.RANDOM:
            log.commands[:] = self.rng.integers(0, len(self.mind.search.neighbours), size=len(log.commands))
        played, status = play.play(self.code, field, RULE_CODES[self.rule], self.mapping, self.mind, self.scout, log)
        return int(played), int(status)

    @property
    def remaining(self) -> int:
        """Number of frontier cells left."""
        return int(self.mind.memory[play.REMAINING])

    @property
    def cut_within_run(self) -> bool:
        """Whether an episode that was stopped has sent a part of a run whose outcome is still to be looked at."""
        known = self.mind.scanning.kind == runs.ADAPTIVE and self.mind.memory[play.LEARNT] == 0
        return bool(self.mind.memory[play.RUN_LEFT] > 0 and not known)


class AdaptiveRuns:
    """The adaptive scan rule for episodes that are played step by step: the same kernels choose the runs.

    Parameters
    ----------
    belief : Belief
        At the start.
    rule : str
    mapping : bool
    scanning : ScanRule
    options : ties and neighbours of closest-frontier
    """

    def __init__(self, belief: Belief, *, rule: str, mapping: bool, scanning: ScanRule, **options: str) -> None:
        layout = belief.open.layout
        size = int(np.prod(layout.window))
        self.rule, self.mapping = rule, mapping
        self.mind = mind_of(layout, size, belief, rule=rule, plan="", scanning=scanning, **options)
        self.scout = scout_of(layout, scanning)

    def next(self, view: View, state: SwarmState, idle: int) -> tuple[str, int] | None:
        """Return the next run, a command and how often, or None."""
        memory, belief = self.mind.memory, view.belief
        memory[play.REMAINING], memory[play.IDLE], memory[play.RUN_LEFT] = len(belief.frontier), idle, 0
        field = field_of(belief.open.words, state, belief)  # the truth is what is believed: no kernel called here moves there
        if not play.begin_run(play.CLOSEST, field, RULE_CODES[self.rule], self.mapping, self.mind, self.scout, np.int8(0)):
            return None
        return decode(memory[play.RUN_COMMAND : play.RUN_COMMAND + 1].astype(np.int8)), int(memory[play.RUN_LEFT])

    def scan_after(self, belief: Belief, state: SwarmState, learnt: int) -> bool:
        """Tell whether the run is to be scanned, and learn from it."""
        self.mind.memory[play.LEARNT] = learnt
        return bool(play.end_run(field_of(belief.open.words, state, belief), self.mind, self.scout, False))
