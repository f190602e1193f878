"""Data of the planners: tuning, the memory between two moves, working arrays of the kernels, and
the measured computing time.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from shoal.swarm.grid.board import GridLayout, letters_of
from shoal.swarm.grid.state import RULE_CODES, Belief, empty_boards
from shoal.swarm.kernels.moves import new_record, record_type
from shoal.swarm.kernels.planning import forward_model, plan_search, prediction
from shoal.swarm.policies.planners.learned_weights import learned_prior_of

if TYPE_CHECKING:
    from numpy.random import Generator


class Tuning(NamedTuple):
    """The tuning parameters of a planner. The page docs/concepts/planners.md explains the values of
    the tuning parameters.
    """

    end_frontier: float  # largest frontier for which plans are simulated to the end, in cells
    # prediction error below which plans are simulated to the end for any size of frontier
    end_surprise: float
    horizon: float  # in moves
    discount: float
    far_surprise: (
        float  # prediction error below which the next two numbers apply to plans to the end
    )
    far_horizon: float
    far_discount: float
    frontier_worth: float  # value of classifying all cells immediately, in moves
    surprise_weight: float  # additional weight of early classification at 100 % prediction error
    future_weight: float  # weight of a cell that joins the frontier if the prediction is correct
    beam_width: float  # number of states that the beam keeps at each depth
    beam_depth: float  # depth of the beam, in commands
    beam_leaves: float  # number of leaves of the beam that are completed
    run_candidates: float  # 1: runs in one direction are also candidates
    variations: float  # number of random variations of the incumbent
    free_threshold: float  # probability from which a cell is predicted to be free
    prediction_layers: float  # range of predictions, in cells
    joint_chance: float  # probability that all cells up to a predicted cell are free
    learned: float  # 1: the trained network contributes to the prediction
    force_after: float  # number of moves without classification after which a whole path is sent


OPTIONS = record_type(
    np.float64, "budget", *Tuning._fields
)  # budget: mean number of simulated moves per move sent
# number of states that a beam may keep on any board; limit on the words of all boards of one kind
# in a wider beam
BEAM_WIDTH, BEAM_WORDS = 24, 2**20
LONGEST_PLAN = 2_000
FIRST_RATE = 200.0  # simulated moves per millisecond, before the machine's speed has been measured
ADVANCE = 10  # moves whose time may be spent in advance, because the first moves need most planning


def new_prior(layout: GridLayout, *, learned: bool = False) -> prediction.OccupancyPrior:
    """Return the occupancy prior at the start of an episode, before it has learned from any
    classified cell.

    If ``learned`` is true, the prior contains the trained neural network in addition to the counts.
    """
    return prediction.OccupancyPrior(
        tallies=np.zeros((prediction.TALLIES, 2), dtype=np.int64),
        weights=np.array([0.5, 0.5] if learned else [1.0, 0.0]),
        forecasts=np.full(prediction.EXPERTS, 0.5),
        before=empty_boards(layout, 1)[0],
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

    predicted_map = prediction.OccupancyPrediction(
        open=boards(),
        known=boards(),
        inner=layout.pack(np.pad(np.ones(layout.shape, dtype=np.bool_), 1)).ravel(),
        cells=np.zeros(64 * size, dtype=np.int64),
        following=np.zeros(64 * size, dtype=np.int64),
        verdicts=np.zeros(64 * size, dtype=np.int8),
        learned_chances=np.zeros(64 * size),
        chances=np.zeros(prediction.FINE),
        **extents,
    )
    values = dict(zip(OPTIONS.names or (), options, strict=False))
    if "beam_width" in values:
        values["beam_width"] = min(int(values["beam_width"]), max(BEAM_WIDTH, BEAM_WORDS // size))
    learned = mapping and layout.ndim == 2 and values.get("learned", 0) > 0
    memory = new_record(plan_search.MEMORY)
    memory.random = seed
    memory.remaining = len(belief.frontier)
    memory.surprise = (
        plan_search.WHOLE // 4 if mapping else 0
    )  # a known map has no prediction errors
    return plan_search.Planner(
        memory=memory,
        options=new_record(OPTIONS, **values),
        scene=forward_model.Scene(
            ground=predicted_map.open,
            tried=boards(),
            moving=boards(),
            rule=RULE_CODES[rule],
            mapping=mapping,
            **extents,
        ),
        root=boards(forward_model.BOARDS),
        state=boards(forward_model.BOARDS),
        planes=boards(forward_model.PLANES),
        gains=np.zeros(directions, dtype=np.int64),
        incumbent=np.zeros(longest, dtype=np.int8),
        trial=np.zeros(longest, dtype=np.int8),
        beam=beam_of(size, int(values.get("beam_width", 0)), int(values.get("beam_depth", 0))),
        prior=new_prior(layout, learned=learned),
        prediction=predicted_map,
        learned=learned_prior_of(predicted_map.inner, layout.words[1], used=learned),
    )


def beam_of(size: int, width: int, depth: int) -> plan_search.Beam:
    """Return memory for a beam search of ``width`` states and ``depth`` commands. Each board takes
    ``size`` words of 64 bits.
    """
    return plan_search.Beam(
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
        planner.memory.credit = int(min(plan_search.SAVINGS * budget, saved))
        before, began = int(planner.memory.simulated), time.perf_counter()
        yield
        self.spent += (time.perf_counter() - began) * 1e3
        self.simulated += int(planner.memory.simulated) - before
        self.moves += moves
