"""Between planners and their kernels: work space, one decision step by step, many in compiled code."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.random import Generator

from shoal.swarm.engine import new_log
from shoal.swarm.grid.belief import Belief
from shoal.swarm.grid.board import Board, GridLayout
from shoal.swarm.grid.commands import letters_of
from shoal.swarm.grid.fields import RULE_CODES, field_of
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.kernels import beam, experience, foresight, guess, moves, planned, planner, play, ways
from shoal.swarm.kernels.rollout import SAVINGS

if TYPE_CHECKING:
    from shoal.swarm.policies import PlannerPolicy, View

BEAM_WIDTH, BEAM_DEPTH = 24, 12
LONGEST_PLAN = 2_000
PIECE = 8  # moves after which the time taken is looked at
FIRST_RATE = 200.0  # imagined moves a millisecond, while nothing is known of the machine
ADVANCE = 10  # moves whose time may be spent before they are sent: most is to be thought about in the first ones


def planner_of(layout: GridLayout, belief: Belief, *, rule: str, mapping: bool, seed: int, options: tuple[float, ...] = ()) -> Any:
    """Return the memory and the work space of a planner that has not decided anything yet."""
    size, directions = layout.words[0] * layout.words[1], len(letters_of(layout.ndim))
    longest = int(np.prod(layout.shape)) + LONGEST_PLAN
    extents: Any = {"layers": layout.layers, "rows": layout.rows, "width": layout.words[1]}

    def boards(*shape: int) -> Any:
        return np.zeros((*shape, size), dtype=np.uint64)

    foreseen = guess.Guess(
        open=boards(),
        known=boards(),
        inner=layout.pack(layout.rim(np.ones(layout.shape, dtype=np.bool_))).ravel(),
        cells=np.zeros(64 * size, dtype=np.int64),
        following=np.zeros(64 * size, dtype=np.int64),
        verdicts=np.zeros(64 * size, dtype=np.int8),
        chances=np.zeros(experience.FINE << ((experience.MANNERS - 1) * (2 if layout.layers == 1 else 3))),
        **extents,
    )
    memory = np.zeros(planner.MEMORY, dtype=np.int64)
    memory[planner.RANDOM] = seed
    memory[planner.REMAINING] = len(belief.frontier)
    memory[planner.SURPRISE] = planner.WHOLE // 4 if mapping else 0  # of a known map nothing is a surprise
    return planner.Planner(
        memory=memory,
        options=np.array(options, dtype=np.float64),
        scene=foresight.Scene(
            ground=foreseen.open,
            tried=boards(),
            before=boards(),
            staying=boards(),
            rule=RULE_CODES[rule],
            mapping=mapping,
            **extents,
        ),
        root=boards(foresight.BOARDS),
        state=boards(foresight.BOARDS),
        ahead=boards(),
        planes=boards(ways.PLANES),
        gains=np.zeros(directions, dtype=np.int64),
        incumbent=np.zeros(longest, dtype=np.int8),
        trial=np.zeros(longest, dtype=np.int8),
        beam=beam.Beam(
            states=boards(2, BEAM_WIDTH, foresight.BOARDS),
            plans=np.zeros((2, BEAM_WIDTH, BEAM_DEPTH), dtype=np.int8),
            values=np.zeros((2, BEAM_WIDTH)),
            ranks=np.zeros((2, BEAM_WIDTH)),
            marks=np.zeros((2, BEAM_WIDTH), dtype=np.uint64),
            child=boards(foresight.BOARDS),
        ),
        experience=experience.Experience(
            tallies=np.zeros((experience.size_of(layout.layers), 2), dtype=np.int64),
            losses=np.zeros(experience.MANNERS),
            before=boards(),
            **extents,
        ),
        guess=foreseen,
    )


def seed_of(rng: Generator) -> int:
    """Draw the seed of a planner's own generator."""
    return int(rng.integers(1, 2**62))


class Pace:
    """Turns a time for each move into a budget of imagined moves, from what they have taken so far."""

    def __init__(self, milliseconds: float) -> None:
        self.milliseconds, self.spent, self.imagined, self.moves = milliseconds, 0.0, 0, 0

    @contextmanager
    def timed(self, mind: Any, moves: int) -> Iterator[None]:
        """Set the budget for so many moves, and time the block, which plays them."""
        if not self.milliseconds:
            yield
            return
        rate = self.imagined / self.spent if self.imagined else FIRST_RATE
        budget = max(1.0, self.milliseconds * rate)
        mind.options[planner.BUDGET] = budget
        # What earlier moves have saved or overdrawn is known in milliseconds: it replaces what the planner has counted itself.
        saved = (self.milliseconds * (self.moves + ADVANCE) - self.spent) * rate
        mind.memory[planner.CREDIT] = int(min(SAVINGS * budget, saved))
        before, began = int(mind.memory[planner.IMAGINED]), time.perf_counter()
        yield
        self.spent += (time.perf_counter() - began) * 1e3
        self.imagined += int(mind.memory[planner.IMAGINED]) - before
        self.moves += moves


class Game:
    """A planner at play, in pieces as long as the logs that it is given."""

    cut_within_run = False  # there is a scan after every move

    def __init__(
        self, policy: PlannerPolicy, state: SwarmState, belief: Belief, *, rule: str, mapping: bool, rng: Generator
    ) -> None:
        seed = 0 if belief.complete else seed_of(rng)
        self.code, self.rule, self.mapping, self.pace = policy.code, RULE_CODES[rule], mapping, Pace(policy.milliseconds)
        options = policy.settings(len(state.occupied))
        self.mind = planner_of(belief.open.layout, belief, rule=rule, mapping=mapping, seed=seed, options=options)

    def play_on(self, field: moves.Field, log: play.Log) -> tuple[int, int]:
        """Play until the log is full; return (moves, status code)."""
        if not self.pace.milliseconds:
            played, status = planned.play_planned(self.code, field, self.rule, self.mapping, self.mind, log)
            return int(played), int(status)
        moves, status = 0, play.RUNNING
        while moves < len(log.commands) and status == play.RUNNING:
            columns: Any = [column[moves : moves + PIECE] for column in log]
            piece = play.Log(*columns)
            with self.pace.timed(self.mind, len(piece.commands)):
                played, status = planned.play_planned(self.code, field, self.rule, self.mapping, self.mind, piece)
            moves += int(played)
        return moves, int(status)

    @property
    def remaining(self) -> int:
        """Number of frontier cells left."""
        return int(self.mind.memory[planner.REMAINING])


@cache
def load_kernels() -> None:
    """Load the kernel of planners, or compile it if this installation has not yet; takes effect once in a process."""
    layout = GridLayout((1, 1))
    here = Board.of_cells(layout, [(0, 0)])
    state, belief = SwarmState(here), Belief(here, here, here)
    mind = planner_of(layout, belief, rule="block", mapping=True, seed=1)
    planned.play_planned(planned.GREEDY, field_of(here.words, state, belief), RULE_CODES["block"], True, mind, new_log(0))


@dataclass(frozen=True)
class Remembered:
    """What a planner that is played step by step hands to its next decision."""

    planner: Any
    command: int
    pace: Pace


def decide(policy: PlannerPolicy, view: View, memory: Any, rng: Generator) -> tuple[str, Any]:
    """Return the next command of a planner and its memory, which is changed in place."""
    belief, layout = view.belief, view.occupied.layout
    field = field_of(belief.open.words, SwarmState(view.occupied), belief)  # the truth is not looked at
    if memory is None:
        options = policy.settings(len(view.occupied))
        mind = planner_of(layout, belief, rule=view.rule, mapping=view.mapping, seed=seed_of(rng), options=options)
        pace = Pace(policy.milliseconds)
    else:
        mind, pace = memory.planner, memory.pace
        mind.memory[planner.REMAINING] = len(belief.frontier)
        planned.heed(field, view.mapping, mind, memory.command, view.done)
    with pace.timed(mind, 1):
        command = int(planned.choose(policy.code, field, view.mapping, mind))
    if command < 0:
        return "", None
    mind.experience.before[:] = field.known
    return letters_of(layout.ndim)[command], Remembered(mind, command, pace)
