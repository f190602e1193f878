"""Between boards and kernels: work space for a running episode, and single pushes for the step-by-step world."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError
from shoal.swarm.belief import Belief
from shoal.swarm.boards import Board, Frame, Words
from shoal.swarm.commands import decode, encode, letters_of
from shoal.swarm.kernels import moves, play, prospect, runs, search, slide, survey
from shoal.swarm.scanning.runs import EVERY_MOVE, ScanRule
from shoal.swarm.state import SwarmState

if TYPE_CHECKING:
    from numpy.random import Generator

    from shoal.swarm.policies import View

RUNNING, COMPLETE, STALLED = play.RUNNING, play.COMPLETE, play.STALLED
RULE_CODES = {"block": moves.BLOCK, "merge": moves.MERGE, "tilt": moves.TILT}
KINDS = {"equal": runs.EQUAL, "doubling": runs.DOUBLING, "hyper": runs.HYPER, "adaptive": runs.ADAPTIVE}
LONGEST_RUN = 500  # that an adaptive policy weighs
ORDERS = {"column-major": search.COLUMN_MAJOR, "row-major": search.ROW_MAJOR}
# The cell from which a command comes, in the order in which such cells are expanded; column-major: left, up, in, out, down, right.
_PARENTS = {"column-major": "rdoiul", "row-major": "droilu"}


def pushed(frame: Frame, free: Words, state: SwarmState, code: int, rule: str) -> SwarmState:
    """Return the state after one push; the world's own bookkeeping, so nothing is observed."""
    everything = np.full(free.size, np.uint64(2**64 - 1))
    field = _field(frame, free=free.ravel(), occupied=state.occupied.words.flatten(), known=everything, counts=_counts(state))
    moves.push(field, code, RULE_CODES[rule])
    return state_of(frame, field)


def field_of(free: Words, state: SwarmState, belief: Belief) -> moves.Field:
    """Return the kernels' boards for a state and a belief: copies, as they are changed in place."""
    return _field(
        state.occupied.frame,
        free=free.ravel(),
        occupied=state.occupied.words.flatten(),
        open=belief.open.words.flatten(),
        known=belief.known.words.flatten(),
        frontier=belief.frontier.words.flatten(),
        counts=_counts(state),
    )


def _field(frame: Frame, *, counts: NDArray[np.int32] | None = None, **boards: Words) -> moves.Field:
    """Return the kernels' boards: the given ones, flat, empty ones for all others, and blocks of work space."""
    block = max(moves.BLOCK_WORDS, frame.words[1])
    work = {name: np.zeros(block, dtype=np.uint64) for name in ("tried", "before", "staying")}
    missing = [name for name in ("free", "occupied", "open", "known", "frontier") if name not in boards]
    return moves.Field(
        **boards,
        **dict(zip(missing, _work(frame, len(missing)), strict=True)),
        **work,
        counts=np.zeros((0, 0), dtype=np.int32) if counts is None else counts,
        layers=frame.layers,
        rows=frame.rows,
        width=frame.words[1],
    )


def _work(frame: Frame, count: int) -> list[Words]:
    """Return so many empty boards, flat."""
    return [np.zeros(frame.words[0] * frame.words[1], dtype=np.uint64) for _ in range(count)]


def _counts(state: SwarmState) -> NDArray[np.int32] | None:
    """Return counts in the layout of the kernels: rows flattened, 64 columns a word."""
    if state.counts is None:
        return None
    frame = state.occupied.frame
    rows, words = frame.words
    wide = np.zeros((rows, 64 * words), dtype=np.int32)
    wide[:, : frame.columns] = state.counts.reshape(rows, frame.columns)
    return wide


def check_neighbours(neighbours: str, ndim: int) -> NDArray[np.int8]:
    """Return the codes of an order of neighbours; "lurd" stands for "lurdio" in 3-D."""
    text = neighbours + "io" if ndim == 3 and len(neighbours) == 4 else neighbours
    if sorted(text) != sorted(letters_of(ndim)):
        raise InvalidInputError(f"neighbours: expected an order of {letters_of(ndim)!r}, got {neighbours!r}")
    return encode(text, ndim=ndim)


def search_of(frame: Frame, *, ties: str, neighbours: str, plan_size: int) -> search.Search:
    """Return the work space of a frontier search."""
    if ties not in ORDERS:
        raise InvalidInputError(f"ties: expected one of {', '.join(ORDERS)}, got {ties!r}")
    parents = "".join(letter for letter in _PARENTS[ties] if letter in letters_of(frame.ndim))
    return search.Search(
        planes=np.zeros((7, frame.words[0] * frame.words[1]), dtype=np.uint64),
        plan=np.zeros(plan_size, dtype=np.int8),
        neighbours=check_neighbours(neighbours, frame.ndim),
        parents=encode(parents, ndim=frame.ndim),
        columns=np.zeros(frame.words[1], dtype=np.uint64),
        origin=np.zeros(2, dtype=np.int64),
        order=ORDERS[ties],
    )


def slides_of(frame: Frame, rule: str) -> slide.Slides:
    """Return the work space of the tilt search; empty for other rules."""
    rows, words = frame.words
    size = rows * words * 64 if rule == "tilt" else 0
    return slide.Slides(np.zeros(size, np.int64), np.zeros(size, np.int8), np.zeros(size, np.int64))


def scanning_of(scanning: ScanRule | None) -> runs.Scanning:
    """Return a scan rule as kernels know it; without one the log gives the scans."""
    return runs.Scanning(runs.GIVEN, 1) if scanning is None else runs.Scanning(KINDS[scanning.kind], scanning.step)


def scout_of(frame: Frame, scanning: ScanRule | None) -> runs.Scout | None:
    """Return what an adaptive scan rule works in; None for all others."""
    if scanning is None or KINDS[scanning.kind] != runs.ADAPTIVE:
        return None
    words = frame.words[0] * frame.words[1]
    longest = min(max(frame.window), LONGEST_RUN)
    boards = [np.zeros(words, dtype=np.uint64) for _ in range(3)]
    return runs.Scout(
        survey=survey.Survey(
            prices=np.array((scanning.scan_cost, scanning.move_cost), dtype=np.float64),
            tallies=np.zeros((survey.TALLIES, 2), dtype=np.int64),
            gains=np.zeros((len(letters_of(frame.ndim)), longest + 1), dtype=np.float64),
            known=boards[0],
            columns=frame.columns,
        ),
        prospect=prospect.Prospect(boards[1], boards[2], np.zeros((0, 0), np.int32), np.zeros(5, np.int64)),
    )


def mind_of(
    frame: Frame,
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
    space = search_of(frame, ties=ties, neighbours=neighbours, plan_size=max(n_free + 2, len(plan), prospect.LONGEST_PLAN))
    memory = np.zeros(play.MEMORY, dtype=np.int64)
    memory[play.RUN_COMMAND], memory[play.SCANNED] = -1, 1
    memory[play.REMAINING] = len(belief.frontier)
    if plan:
        space.plan[: len(plan)] = encode(plan, ndim=frame.ndim)
        memory[play.PLAN_LENGTH] = len(plan)
    single, visited = _work(frame, 2)
    trail = np.zeros(n_free + 2, dtype=np.int8)
    return play.Mind(memory, space, slides_of(frame, rule), single, visited, trail, scanning_of(scanning))


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
    frame = sources.frame
    space = search_of(frame, ties=ties, neighbours=neighbours, plan_size=len(belief.open) + 2)
    field = _field(
        frame,
        occupied=sources.words.ravel(),
        open=belief.open.words.ravel(),
        known=belief.known.words.ravel(),
        frontier=belief.frontier.words.ravel(),
    )
    if rule == "tilt":
        length = slide.nearest_by_tilts(field, space, slides_of(frame, rule), field.occupied, mapping)
    else:
        length = search.nearest(field, space, field.occupied)
    row, column = (int(i) for i in space.origin)
    cell = (row // frame.rows - 1, row % frame.rows - 1, column - 1)
    return decode(space.plan[:length]), cell[3 - frame.ndim :]


def choose_driven(code: int, state: SwarmState, mind: play.Mind, rng: Generator) -> None:
    """Choose the particle that a policy drives: elect-particle a random one, depth-first the first; others drive none."""
    if code not in {play.ELECT, play.DEPTH_FIRST}:
        return
    frame, cells = state.occupied.frame, state.occupied.cells
    cell = cells[rng.integers(0, len(cells)) if code == play.ELECT else 0] + 1
    layer = int(cell[0]) if frame.ndim == 3 else 0
    mind.memory[play.ROW], mind.memory[play.COLUMN] = layer * frame.rows + cell[-2], cell[-1]


def new_log(moves_at_most: int) -> play.Log:
    """Return an empty log with room for that many moves."""
    return play.Log(
        np.zeros(moves_at_most, np.int8),
        np.zeros(moves_at_most, np.int32),
        np.zeros(moves_at_most, np.int32),
        np.zeros(moves_at_most, np.int64),
        np.zeros(moves_at_most, np.bool_),
    )


def board_of(frame: Frame, flat: Words) -> Board:
    """Return the board that the kernels hold flat."""
    return Board(frame, flat.reshape(frame.words))


def state_of(frame: Frame, field: moves.Field) -> SwarmState:
    """Return the state that the kernels' boards hold now."""
    counts = None
    if field.counts.size:
        counts = field.counts[:, : frame.columns].reshape(frame.window).copy()
    return SwarmState(board_of(frame, field.occupied), counts)


@cache
def load_kernels() -> None:
    """Load the episode kernel, or compile it if this installation has not yet; takes effect once in a process."""
    frame = Frame((1, 1))
    here = Board.of_cells(frame, [(0, 0)])
    state, belief = SwarmState(here), Belief(here, here, here)
    mind = mind_of(frame, 1, belief, rule="block", ties="column-major", neighbours="lurd", plan="")
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
        frame = belief.open.frame
        size = int(np.prod(frame.window))
        self.rule, self.mapping = rule, mapping
        self.mind = mind_of(frame, size, belief, rule=rule, plan="", scanning=scanning, **options)
        self.scout = scout_of(frame, scanning)

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


def empty_field(frame: Frame) -> moves.Field:
    """Return the kernels' boards, all empty."""
    return _field(frame)
