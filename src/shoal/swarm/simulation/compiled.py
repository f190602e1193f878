"""The closed loop in compiled code for built-in policies.

The compiled closed loop and the Python closed loop give equal results, move by move.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.core.episode import Status
from shoal.swarm.grid.board import Board, GridLayout, encode, letters_of
from shoal.swarm.grid.paths import search_of, slides_of
from shoal.swarm.grid.scans import EVERY_MOVE, ScanRule, Trace
from shoal.swarm.grid.state import (
    RULE_CODES,
    Belief,
    SwarmState,
    board_of,
    empty_boards,
    field_of,
    state_of,
)
from shoal.swarm.grid.tasks import Coverage, Mapping
from shoal.swarm.kernels import episodes, moves
from shoal.swarm.kernels.moves import BLOCK, COMPLETE, RUNNING, STALLED, TILT, new_record
from shoal.swarm.kernels.planning import adaptive_scans
from shoal.swarm.noise import Lookout, NoisyBelief
from shoal.swarm.policies import PlannerPolicy
from shoal.swarm.policies.planners.state import Pace, new_prior, planner_of, seed_of
from shoal.swarm.simulation.swarms import ExactSwarm

STATUSES = {
    RUNNING: Status.LIMIT,
    COMPLETE: Status.COMPLETE,
    STALLED: Status.STALLED,
}
KINDS = {
    "equal": episodes.EQUAL,
    "doubling": episodes.DOUBLING,
    "hyper": episodes.HYPER,
    "adaptive": episodes.ADAPTIVE,
}
LONGEST_RUN = 500  # maximum number of commands in the runs that the adaptive scan rule compares
# moves of the first piece and seconds of later pieces, if a progress function is given
SHOWN_FIRST, SHOWN_EVERY = 16, 0.1
TIMED_PIECE = 8  # number of moves after which the computing time is checked
NOISY_PIECE = (
    256  # moves with noise between two points at which progress is shown and Ctrl-C takes effect
)


class Game(Protocol):
    """An episode that runs in compiled code, piece by piece.

    Each call of `play_on` computes one piece of the episode and fills a trace.
    """

    def play_on(self, trace: Trace, limit: int) -> tuple[int, int]:
        """Play at most ``limit`` moves, until the trace is full or the episode ends. Return (number
        of moves, status code).
        """

    @property
    def remaining(self) -> int:
        """Number of frontier cells left in the belief."""

    @property
    def largest(self) -> int:
        """Maximum number of moves that one call of `play_on` may compute."""

    def cut(self, trace: Trace) -> Status:
        """Return the status of an episode after its maximum number of moves.

        If the maximum number of moves interrupts a run of commands, record a scan after the last
        command.
        """


def compiled_loop(
    game: Game,
    max_moves: int,
    on_moves: Any = None,
    on_trace: Any = None,
    *,
    scanned: NDArray[np.bool_] | None = None,
    stop: Callable[[], bool] | None = None,
) -> tuple[Trace, Status]:
    """Run an episode in compiled code, in pieces that each take a fraction of a second.

    For a replay, ``scanned`` tells for each command whether a scan follows the command.
    """
    watched = on_moves is not None or on_trace is not None or stop is not None
    # one move of a large swarm may take a second
    first = 2048 if not watched else SHOWN_FIRST if on_trace is not None else 1
    length, moves, ended = min(first, game.largest), 0, RUNNING
    pieces: list[Trace] = []
    stopped = False
    while moves < max_moves and ended == RUNNING:
        if stopped := stop is not None and stop():
            break
        piece = Trace.empty(min(length, max_moves - moves))
        if scanned is not None:
            piece.scanned[:] = scanned[moves : moves + piece.moves]
        began = time.perf_counter()
        played, ended = game.play_on(piece, max_moves - moves)
        pieces.append(piece.part(0, played))
        moves, length = moves + played, min(2 * length, game.largest)
        if on_moves is not None:
            on_moves(moves, game.remaining)
        if on_trace is not None:
            on_trace(pieces[-1])
        if watched:
            length = max(
                1, min(length, round(max(1, played) * SHOWN_EVERY / (time.perf_counter() - began)))
            )
    trace = Trace.joined(pieces)
    status = STATUSES[ended]
    if status is Status.LIMIT and scanned is None:
        status = game.cut(trace)
    return trace, Status.INTERRUPTED if stopped and status is Status.LIMIT else status


class PolicyGame:
    """An episode of a built-in policy in compiled code, for all policies that are not planners.

    Parameters
    ----------
    policy : Compiled
    swarm : ExactSwarm
        The swarm at the start. The game changes no part of it.
    rng : Generator
    scanning : ScanRule or None
        The scan rule, or None for a replay, which takes the scans from the recorded trace.
    """

    def __init__(
        self, policy: Any, swarm: ExactSwarm, rng: Generator, *, scanning: ScanRule | None
    ) -> None:
        state, belief = swarm.state, swarm.belief
        self.code, self.rng = policy.code, rng
        self.rule, self.mapping = RULE_CODES[swarm.rule], swarm.task.mapping
        self.layout = state.occupied.layout
        self.field = field_of(swarm.world.free.words, state, belief)
        self.largest = largest_piece(self.field)
        options = {
            name: getattr(policy, name) for name in ("ties", "neighbours") if hasattr(policy, name)
        }
        plan = getattr(policy, "commands", "")
        self.policy_state = policy_state_of(
            self.layout,
            swarm.world.workspace.n_free,
            belief,
            code=policy.code,
            rule=self.rule,
            plan=plan,
            scanning=scanning,
            **options,
        )
        self.scan_planner = scan_planner_of(self.layout, scanning)
        if not belief.complete:
            choose_driven(policy.code, state, self.policy_state, rng)

    def play_on(self, trace: Trace, limit: int) -> tuple[int, int]:
        """Compute one piece of the episode. For the policy random-moves, first draw the commands of
        the piece.
        """
        if self.code == episodes.RANDOM:
            trace.commands[:] = self.rng.integers(
                0, len(self.policy_state.search.neighbours), size=trace.moves
            )
        played, status = episodes.play(
            self.code,
            self.field,
            self.rule,
            self.mapping,
            self.policy_state,
            self.scan_planner,
            trace,
        )
        return int(played), int(status)

    @property
    def remaining(self) -> int:
        """Number of frontier cells left in the belief."""
        return int(self.policy_state.memory.remaining)

    def cut(self, trace: Trace) -> Status:
        """Return the status of an episode after its maximum number of moves.

        If the maximum number of moves interrupts a run with an uncertain outcome, record a scan
        after the last command.
        """
        certain = (
            self.policy_state.scanning.kind == episodes.ADAPTIVE
            and self.policy_state.memory.learnt == 0
        )
        if self.policy_state.memory.run_left == 0 or certain:
            return Status.LIMIT
        trace.scanned[-1] = True
        return Status.LIMIT if self.remaining else Status.COMPLETE

    @property
    def final(self) -> tuple[SwarmState, Belief]:
        """Return the current state of the swarm and the current belief."""
        boards = (self.field.open, self.field.known, self.field.frontier)
        return state_of(self.layout, self.field), Belief(
            *(board_of(self.layout, words) for words in boards)
        )


class PlannerGame:
    """An episode of a planner in compiled code."""

    def __init__(
        self,
        policy: PlannerPolicy,
        free: Board,
        state: SwarmState,
        belief: Belief,
        *,
        rule: str,
        mapping: bool,
        rng: Generator,
    ) -> None:
        seed = 0 if belief.complete else seed_of(rng)
        self.code = policy.code
        self.rule = RULE_CODES[rule]
        self.mapping = mapping
        self.pace = Pace(policy.milliseconds)
        self.field = field_of(free.words, state, belief)
        self.largest = largest_piece(self.field)
        options = policy.settings(len(state.occupied))
        self.planner = planner_of(
            belief.open.layout, belief, rule=rule, mapping=mapping, seed=seed, options=options
        )

    def play_on(self, trace: Trace, limit: int) -> tuple[int, int]:
        """Compute one piece of the episode, as `Game` describes."""
        moves = 0
        status = RUNNING
        piece = TIMED_PIECE if self.pace.milliseconds else max(1, trace.moves)
        while moves < trace.moves and status == RUNNING:
            section = trace.part(moves, moves + piece)
            with self.pace.timed(self.planner, section.moves):
                played, status = episodes.play_planner(
                    self.code, self.field, self.rule, self.mapping, self.planner, section
                )
            moves += int(played)
        return moves, int(status)

    @property
    def remaining(self) -> int:
        """Number of frontier cells left in the belief."""
        return int(self.planner.memory.remaining)

    def cut(self, trace: Trace) -> Status:
        """Return the status ``limit``. A planner scans after every move and therefore needs no
        additional scan.
        """
        return Status.LIMIT


class NoisyGame:
    """An episode of the policy closest-frontier with noise, in compiled code.

    Parameters
    ----------
    policy : ClosestFrontier
    belief : NoisyBelief
        The belief. The belief's arrays contain the true state of the simulation.
    rng : Generator
        Generator of the random numbers for the noise.
    every : int
        Maximum number of commands before each scan.
    """

    largest = NOISY_PIECE

    def __init__(self, policy: Any, belief: NoisyBelief, rng: Generator, *, every: int) -> None:
        size = int(np.prod(belief.layout.window))
        self.search = search_of(
            belief.layout, ties=policy.ties, neighbours=policy.neighbours, plan_size=size
        )
        self.belief, self.rng, self.every, self.lookout = belief, rng, every, Lookout(belief)

    def play_on(self, trace: Trace, limit: int) -> tuple[int, int]:
        """Compute one piece of the episode, as `Game` describes.

        Where the policy finds no path although the mapping is not complete, a `Lookout` chooses the
        commands.
        """
        belief, moves, status = self.belief, 0, RUNNING
        while moves < trace.moves and status == RUNNING:
            section = trace.part(moves, trace.moves)
            played, status = belief.play(
                self.search, self.rng, section, every=self.every, limit=limit - moves
            )
            moves += played
            if status != RUNNING:
                status = COMPLETE if belief.finished else self._look(trace.part(moves, moves + 1))
                moves += int(status == RUNNING)
        return moves, status

    def _look(self, step: Trace) -> int:
        """Send one command of the lookout, and fill the trace of one move. Return the
        status code.
        """
        code = None if self.belief.undecided else self.lookout.next()
        if code is None:
            return int(STALLED)
        step.commands[0], step.scanned[0] = code, True
        self.belief.follow(self.rng, step)
        self.belief.guard.memory.budget = -1  # of a cell that is found to be no wall
        return int(RUNNING)

    @property
    def remaining(self) -> int:
        """Number of frontier cells left in the belief."""
        return self.belief.remaining

    def cut(self, trace: Trace) -> Status:
        """Return the status ``complete`` if the task is finished, and the status ``limit`` if the
        task is unfinished.
        """
        return Status.COMPLETE if self.belief.finished else Status.LIMIT


def is_compiled(task: Any) -> bool:
    """Return whether kernels support a task: a built-in task, or a subclass that keeps ``begin``,
    ``update`` and ``mapping``.
    """
    methods = ("begin", "update", "mapping")
    builtin = (base for base in (Mapping, Coverage) if isinstance(task, base))
    return any(
        all(getattr(type(task), method) is getattr(base, method) for method in methods)
        for base in builtin
    )


def largest_piece(field: moves.Field) -> int:
    """Return the number of moves that compiled code computes in a fraction of a second."""
    return int(np.clip(2**25 // field.free.size, 64, 2**16))


def scanning_of(scanning: ScanRule | None) -> episodes.Scanning:
    """Return a scan rule in the form that kernels expect. If ``scanning`` is None, the recorded
    trace determines the scans.
    """
    return (
        episodes.Scanning(episodes.GIVEN, 1)
        if scanning is None
        else episodes.Scanning(KINDS[scanning.kind], scanning.step)
    )


def scan_planner_of(layout: GridLayout, scanning: ScanRule | None) -> episodes.ScanPlanner | None:
    """Return the working memory of the adaptive scan rule. For a scan rule that is not adaptive,
    return None.
    """
    if scanning is None or KINDS[scanning.kind] != episodes.ADAPTIVE:
        return None
    longest = min(max(layout.window), LONGEST_RUN)
    boards = empty_boards(layout, 2)
    return episodes.ScanPlanner(
        gain=adaptive_scans.ExpectedGain(
            prices=new_record(
                adaptive_scans.PRICES, scan=scanning.scan_cost, move=scanning.move_cost
            ),
            prior=new_prior(layout),
            gains=np.zeros((len(letters_of(layout.ndim)), longest + 1), dtype=np.float64),
            columns=layout.columns,
        ),
        lookahead=adaptive_scans.Lookahead(
            boards[0], boards[1], np.zeros((0, 0), np.int32), new_record(adaptive_scans.BEST)
        ),
    )


def policy_state_of(
    layout: GridLayout,
    n_free: int,
    belief: Belief,
    *,
    code: int = episodes.CLOSEST,
    rule: int = BLOCK,
    ties: str = "column-major",
    neighbours: str = "lurd",
    plan: str = "",
    scanning: ScanRule | None = EVERY_MOVE,
) -> episodes.PolicyState:
    """Return the initial memory of a built-in policy. A policy with fixed commands follows
    ``plan``.
    """
    search = search_of(
        layout,
        ties=ties,
        neighbours=neighbours,
        plan_size=max(n_free + 2, len(plan), adaptive_scans.LONGEST_PLAN),
    )
    memory = new_record(episodes.MEMORY)
    memory.run_command, memory.scanned = -1, 1
    memory.remaining = len(belief.frontier)
    if plan:
        search.plan[: len(plan)] = encode(plan, ndim=layout.ndim)
        memory.plan_length = len(plan)
    driven = code in {episodes.ELECT, episodes.DEPTH_FIRST}
    trail = int(np.prod(layout.window)) if code == episodes.DEPTH_FIRST else 0
    return episodes.PolicyState(
        memory,
        search,
        scanning_of(scanning),
        board=empty_boards(layout, 1)[0] if driven else np.zeros(0, dtype=np.uint64),
        trail=np.zeros(trail, dtype=np.int8),
        slides=slides_of(layout, used=rule == TILT and code == episodes.CLOSEST),
    )


def choose_driven(
    code: int, state: SwarmState, policy_state: episodes.PolicyState, rng: Generator
) -> None:
    """Choose the particle that a policy moves: a random particle for elect-particle, and the first
    particle for depth-first.
    """
    if code not in {episodes.ELECT, episodes.DEPTH_FIRST}:
        return
    layout, cells = state.occupied.layout, state.occupied.cells
    cell = cells[rng.integers(0, len(cells)) if code == episodes.ELECT else 0] + 1
    layer = int(cell[0]) if layout.ndim == 3 else 0
    policy_state.memory.row, policy_state.memory.column = layer * layout.rows + cell[-2], cell[-1]
