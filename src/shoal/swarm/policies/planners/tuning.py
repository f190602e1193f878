"""Tuning: what planners weigh."""

from __future__ import annotations

from typing import NamedTuple


class Tuning(NamedTuple):
    """What a planner weighs; docs/concepts/planners.md says why these numbers."""

    end_frontier: float  # frontier cells up to which plans are simulated to the end
    horizon: float  # moves, of plans to the end
    discount: float
    near_horizon: float  # moves, while there are more frontier cells
    frontier_worth: float  # moves that classifying all at once is worth
    beam_width: float  # of the beam
    beam_depth: float
    beam_leaves: float  # of the beam that are completed
    variations: float  # of the incumbent
    left_behind_cost: float  # cells classified that a cell left behind offsets; 0: greedy completions alone
    free_threshold: float  # chance from which a cell is predicted to be free
    prediction_layers: float  # cells that predictions go on
    run_candidates: float  # 1: runs in one direction are candidates, too
    force_after: float  # moves that classify nothing, after which a whole way is played
    joint_chance: float  # chance that all cells up to a predicted one are free
    future_weight: float  # what a cell counts that will join the frontier if all is as predicted
    surprise_weight: float  # how much more classifying early is worth if all that is found is a surprise
    surprise_shrink: float  # how fast the horizon shrinks towards the near one with surprises; 0: not at all
    end_surprise: float  # share of surprises below which plans are simulated to the end, however many frontier cells there are
    far_surprise: float  # share of surprises below which plans to the end are simulated as far as the next two say
    far_horizon: float
    far_discount: float
    lattices: float  # that the free cells may lie on, of periods 2, 4, ...
    learned: float  # 1: an expert that has seen maps has a say in what is predicted
