"""Parameters that tune the planners."""

from __future__ import annotations

from typing import NamedTuple


class Tuning(NamedTuple):
    """The tuning parameters of a planner. The page docs/concepts/planners.md explains the values of
    the tuning parameters.
    """

    end_frontier: float  # largest frontier for which plans are simulated to the end, in cells
    horizon: float  # horizon of plans to the end, in moves
    discount: float
    near_horizon: float  # horizon with a larger frontier, in moves
    frontier_worth: float  # value of classifying all cells immediately, in moves
    beam_width: float  # number of states that the beam keeps at each depth
    beam_depth: float  # depth of the beam, in commands
    beam_leaves: float  # number of leaves of the beam that are completed
    variations: float  # number of variations of the incumbent
    # charge for one cell left behind, in classified cells; 0 means greedy completions only
    left_behind_cost: float
    free_threshold: float  # probability from which a cell is predicted to be free
    prediction_layers: float  # range of predictions, in cells
    run_candidates: float  # 1: runs in one direction are also candidates
    force_after: float  # number of moves without classification after which a whole path is sent
    joint_chance: float  # probability that all cells up to a predicted cell are free
    future_weight: float  # weight of a cell that joins the frontier if the prediction is correct
    surprise_weight: float  # additional weight of early classification at 100 % prediction error
    # rate at which the horizon shrinks towards the near horizon with prediction errors; 0: constant
    # horizon
    surprise_shrink: float
    # prediction error below which plans are simulated to the end for any size of frontier
    end_surprise: float
    far_surprise: float  # prediction error below which the next two numbers limit plans to the end
    far_horizon: float
    far_discount: float
    lattices: float  # number of lattice models, which have the periods 2, 4, ...
    learned: float  # 1: the trained network contributes to the prediction
