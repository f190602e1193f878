"""Combs: the commands of one who knows, the bound on scans, and the exact game of policies."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from shoal.core.errors import InvalidInputError
from shoal.swarm import GridWorkspace, GridWorld, SwarmProblem
from shoal.swarm.run import run
from shoal.swarm.theory.combs import (
    comb_map,
    comb_start,
    confirming_commands,
    least_comb_moves,
    least_comb_scans,
)


@pytest.mark.parametrize("places", [1, 2, 3, 4])
def test_one_who_knows_needs_three_scans(places):
    """By the simulated world: what the second and the third scan show fits one comb only."""
    combs = [*product((False, True), repeat=places)]
    worlds = [GridWorld(GridWorkspace(comb_map(teeth))) for teeth in combs]
    for k, teeth in enumerate(combs):
        shown = []
        for world in worlds:
            state, scans = world.initial([comb_start(places)]), []
            for part in confirming_commands(teeth):
                for letter in part:
                    state = world.step(state, letter)
                scans.append(state.cells.tolist())
            shown.append(scans)
        assert shown.count(shown[k]) == 1
    assert max(len("".join(confirming_commands(teeth))) for teeth in combs) <= 7 * places + 2


def told_apart(group, scans, left):
    """Whether some policy tells combs apart by trying everything; ``group`` has pairs of a map and
    a place.
    """
    parts = {}
    for free, place in group:
        parts.setdefault(place, []).append((free, place))
    if len(parts) == len(group):
        return True  # one more scan is enough
    if (
        scans > 1
        and len(parts) > 1
        and all(len(part) == 1 or told_apart(part, scans - 1, left) for part in parts.values())
    ):
        return True
    if not left:
        return False
    for row, column in ((-1, 0), (1, 0), (0, -1), (0, 1)):
        after = [
            (free, there if (there := (r + row, c + column)) in free else (r, c))
            for free, (r, c) in group
        ]
        if after != group and told_apart(after, scans, left - 1):
            return True
    return False


@pytest.mark.parametrize(("places", "scans", "moves"), [(1, 1, 1), (2, 1, 9), (2, 2, 5)])
def test_fewest_moves_by_trying_everything(places, scans, moves):
    assert least_comb_moves(places, scans) == moves
    group = [
        ({*map(tuple, np.argwhere(comb_map(teeth)).tolist())}, comb_start(places))
        for teeth in product((False, True), repeat=places)
    ]
    assert told_apart(group, scans, moves)
    assert not told_apart(group, scans, moves - 1)


def test_more_scans_save_moves_and_more_places_cost_them():
    assert least_comb_moves(3, 3) == 9
    assert least_comb_moves(2, 1) > least_comb_moves(2, 2) == least_comb_moves(2, 3)


def test_bound_on_scans():
    """A scan of one particle shows one of 4 k + 3 cells, so that it halves the combs that often."""
    for places in (1, 5, 6, 7, 50, 400):
        scans = least_comb_scans(places)
        assert (4 * places + 3) ** scans >= 2**places
        assert (4 * places + 3) ** (scans - 1) < 2**places
    assert least_comb_scans(200, 3) < least_comb_scans(200, 2) < least_comb_scans(200)
    # a comb of k places has at most that many cells
    assert comb_map([True] * 9).sum() == 4 * 9 + 3


def test_policies_of_shoal_are_not_below_the_bound():
    rng = np.random.default_rng(2)
    for places in (20, 80):
        free = comb_map((rng.random(places) < 0.5).tolist())
        for every in ("1", "hyper"):
            problem = SwarmProblem(
                free, start=(comb_start(places),), policy="closest-frontier", scan_every=every
            )
            episode = run(problem, seed=1)
            assert episode.status == "complete"
            assert episode.scans - 1 >= least_comb_scans(places)


def test_refusals():
    with pytest.raises(InvalidInputError, match="places: expected a whole number"):
        least_comb_scans(0)
    with pytest.raises(InvalidInputError, match="particles: expected a whole number from 1 to 6"):
        least_comb_scans(1, 7)
    with pytest.raises(InvalidInputError, match="scans: expected a whole number, 2 or more"):
        least_comb_moves(3, 1)
