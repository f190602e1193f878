"""Data of the planners: the memory between two moves, the working arrays of the kernels, and the
measured computing time.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.random import Generator

from shoal.swarm.grid.board import GridLayout, letters_of
from shoal.swarm.grid.state import RULE_CODES, Belief, empty_boards
from shoal.swarm.kernels.moves import new_record, record_type
from shoal.swarm.kernels.planning import beam, completion, frontier_paths, planner_state
from shoal.swarm.kernels.planning.rollout import SAVINGS
from shoal.swarm.kernels.prediction import forward_model, occupancy_prediction, occupancy_prior
from shoal.swarm.policies.planners.learned_weights import learned_prior_of
from shoal.swarm.policies.planners.tuning import Tuning

OPTIONS = record_type(
    np.float64, "budget", *Tuning._fields
)  # budget: mean number of simulated moves per move sent
# number of states that a beam may keep on any board; limit on the words of all boards of one kind
# in a wider beam
BEAM_WIDTH, BEAM_WORDS = 24, 2**20
KEPT_PLACES, KEPT_WORDS = (
    64,
    2**21,
)  # maximum number of kept states of a plan; maximum number of words of their boards of one kind
KEPT_RESULTS = 128  # number of places for which the results of a plan are kept
LONGEST_PLAN = 2_000
FIRST_RATE = 200.0  # simulated moves per millisecond, before the machine's speed has been measured
ADVANCE = 10  # moves whose time may be spent in advance, because the first moves need most planning


def new_prior(
    layout: GridLayout, *, lattices: int = 0, learned: bool = False
) -> occupancy_prior.OccupancyPrior:
    """Return the occupancy prior at the start of an episode, before it has learned from any
    classified cell.

    ``lattices`` is the number of lattice models in the occupancy prior. If ``learned`` is true, the
    prior contains the trained neural network in addition to the lattice models.
    """
    weights = np.zeros(occupancy_prior.EXPERTS)
    weights[: lattices + 1] = (0.5 if learned else 1.0) / (lattices + 1)
    weights[occupancy_prior.LEARNED] = 0.5 if learned else 0.0
    return occupancy_prior.OccupancyPrior(
        tallies=np.zeros((occupancy_prior.size_of(layout.layers), 2), dtype=np.int64),
        weights=weights,
        told=np.full(occupancy_prior.EXPERTS, 0.5),
        before=empty_boards(layout, 1)[0],
        layers=layout.layers,
        rows=layout.rows,
        width=layout.words[1],
    )


def planner_of(
    layout: GridLayout,
    belief: Belief,
    *,
    rule: str,
    mapping: bool,
    seed: int,
    options: tuple[float, ...] = (),
) -> Any:
    """Return the memory and the working arrays of a planner before its first decision."""
    size, directions = layout.words[0] * layout.words[1], len(letters_of(layout.ndim))
    longest = int(np.prod(layout.shape)) + LONGEST_PLAN
    extents: Any = {"layers": layout.layers, "rows": layout.rows, "width": layout.words[1]}

    def boards(*shape: int) -> Any:
        return np.zeros((*shape, size), dtype=np.uint64)

    foreseen = occupancy_prediction.OccupancyPrediction(
        open=boards(),
        known=boards(),
        inner=layout.pack(np.pad(np.ones(layout.shape, dtype=np.bool_), 1)).ravel(),
        cells=np.zeros(64 * size, dtype=np.int64),
        following=np.zeros(64 * size, dtype=np.int64),
        verdicts=np.zeros(64 * size, dtype=np.int8),
        told=np.zeros(64 * size),
        chances=np.zeros(
            occupancy_prior.FINE
            << ((occupancy_prior.MODELS - 1) * (2 if layout.layers == 1 else 3))
        ),
        **extents,
    )
    given = dict(zip(OPTIONS.names or (), options, strict=False))
    if "beam_width" in given:
        given["beam_width"] = min(int(given["beam_width"]), max(BEAM_WIDTH, BEAM_WORDS // size))
    learned = mapping and layout.ndim == 2 and given.get("learned", 0) > 0
    memory = new_record(planner_state.MEMORY)
    memory.random = seed
    memory.remaining = len(belief.frontier)
    memory.surprise = (
        planner_state.WHOLE // 4 if mapping else 0
    )  # a known map has no prediction errors
    return planner_state.Planner(
        memory=memory,
        options=new_record(OPTIONS, **given),
        scene=forward_model.Scene(
            ground=foreseen.open,
            tried=boards(),
            moving=boards(),
            rule=RULE_CODES[rule],
            mapping=mapping,
            **extents,
        ),
        root=boards(forward_model.BOARDS),
        state=boards(forward_model.BOARDS),
        ahead=boards(),
        planes=boards(frontier_paths.PLANES),
        gains=np.zeros(directions, dtype=np.int64),
        incumbent=np.zeros(longest, dtype=np.int8),
        trial=np.zeros(longest, dtype=np.int8),
        kept=kept_states_of(size),
        beam=beam_of(size, int(given.get("beam_width", 0)), int(given.get("beam_depth", 0))),
        prior=new_prior(layout, lattices=int(given.get("lattices", 0)), learned=learned),
        prediction=foreseen,
        learned=learned_prior_of(foreseen.inner, layout.words[1], used=learned),
    )


def kept_states_of(size: int) -> completion.KeptStates:
    """Return memory for the states of two plans. Each board (a set of cells) takes ``size`` words
    of 64 bits.
    """
    places = max(1, min(KEPT_PLACES, KEPT_WORDS // size))
    return completion.KeptStates(
        states=np.zeros((2, places, forward_model.BOARDS, size), dtype=np.uint64),
        progress=np.rec.array(np.zeros((2, KEPT_RESULTS), dtype=completion.PROGRESS)),
    )


def beam_of(size: int, width: int, depth: int) -> beam.Beam:
    """Return memory for a beam search of ``width`` states and ``depth`` commands. Each board takes
    ``size`` words of 64 bits.
    """
    return beam.Beam(
        states=np.zeros((2, width, forward_model.BOARDS, size), dtype=np.uint64),
        plans=np.zeros((2, width, depth), dtype=np.int8),
        values=np.zeros((2, width)),
        marks=np.zeros((2, width), dtype=np.uint64),
        child=np.zeros((forward_model.BOARDS, size), dtype=np.uint64),
    )


def seed_of(rng: Generator) -> int:
    """Draw a seed for the random generator of a planner."""
    return int(rng.integers(1, 2**62))


class Pace:
    """Converts a time limit per move into a budget of simulated moves. The conversion uses the
    simulation speed measured so far.
    """

    def __init__(self, milliseconds: float) -> None:
        self.milliseconds, self.spent, self.simulated, self.moves = milliseconds, 0.0, 0, 0

    @contextmanager
    def timed(self, planner: Any, moves: int) -> Iterator[None]:
        """Set the planner's budget for a number of ``moves``, and measure the computing time of the
        ``with`` block.
        """
        if not self.milliseconds:
            yield
            return
        rate = self.simulated / self.spent if self.simulated else FIRST_RATE
        budget = max(1.0, self.milliseconds * rate)
        planner.options.budget = budget
        # The time that earlier moves have saved or overdrawn, converted into simulated moves,
        # replaces the planner's own count.
        saved = (self.milliseconds * (self.moves + ADVANCE) - self.spent) * rate
        planner.memory.credit = int(min(SAVINGS * budget, saved))
        before, began = int(planner.memory.simulated), time.perf_counter()
        yield
        self.spent += (time.perf_counter() - began) * 1e3
        self.simulated += int(planner.memory.simulated) - before
        self.moves += moves
