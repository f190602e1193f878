"""Exploration with one particle: the adversary of a corridor, SmartDFS, Hamiltonian paths, and the
laws of the largest gap, each against an own small computation.
"""

from __future__ import annotations

import itertools
import json
from fractions import Fraction

import numpy as np
import pytest

from shoal.cli import run as command
from shoal.core.errors import InvalidInputError
from shoal.swarm import SwarmProblem
from shoal.swarm.adversary import play_adversary
from shoal.swarm.run import run
from shoal.swarm.theory.exploration import (
    coverage_instance,
    least_corridor_ratio,
    smart_dfs,
)
from shoal.swarm.theory.one_dimension import Line

STEPS = ((-1, 0), (0, 1), (1, 0), (0, -1))


class Doubling:
    """Go 1 cell to the right, 2 to the left, 4 to the right, ...; touch the walls on the way."""

    name = "doubling"

    def decide(self, view, memory, rng):
        turn = 0 if memory is None else memory
        far = 2**turn + (2 ** (turn - 1) if turn else 0)
        return ("ud" if turn == 0 else "") + ("rud" if turn % 2 == 0 else "lud") * far, turn + 1


def test_the_adversary_punishes_doubling():
    """It finds a corridor worse than twice the optimum, which an own count of moves confirms."""
    game = play_adversary(Doubling(), 20)
    assert game.status == "complete"
    turns = moves = place = 0
    low = high = False
    while not (low and high):
        for _ in range(2**turns + (2 ** (turns - 1) if turns else 0)):
            moves += not (low and high)
            place += 1 if turns % 2 == 0 else -1
            low, high = low or place < -game.left, high or place > game.right
            place = min(max(place, -game.left), game.right)
        turns += 1
    # the last decision is carried out whole
    assert moves <= game.moves <= 3 * moves
    assert game.least == 2 * min(game.left, game.right) + max(game.left, game.right) + 2
    assert game.ratio > 2


@pytest.mark.parametrize("cells", [1, 2, 3])
def test_least_corridor_ratio_by_the_whole_game(cells):
    ends = [*itertools.product(range(cells + 1), repeat=2)]

    def kept(ratio, left_of, place, low, high, moves):
        """Whether a policy keeps the ratio in all corridors ``left_of`` that fit what it has seen;
        ``low`` and ``high`` are the explored cells, negative if they are known to be the ends.
        """
        if any(moves > ratio * (2 * min(a, b) + max(a, b) + 2) for a, b in left_of):
            return False
        if len(left_of) and all(end is True for end in (low[1], high[1])):
            return True
        for step in (-1, 1):
            there = place + step
            groups = {}
            for a, b in left_of:
                groups.setdefault(-a <= there <= b, []).append((a, b))
            answers = []
            for free, group in groups.items():
                if free:
                    state = (
                        there,
                        (min(low[0], there), low[1]),
                        (max(high[0], there), high[1]),
                    )
                else:
                    state = (
                        place,
                        (low[0], low[1] or step < 0),
                        (high[0], high[1] or step > 0),
                    )
                answers.append((group, state))
            if all(kept(ratio, group, *state, moves + 1) for group, state in answers):
                return True
        return False

    found = least_corridor_ratio(cells)
    assert kept(found, ends, 0, (0, False), (0, False), 0)
    assert not kept(found - Fraction(1, 1000), ends, 0, (0, False), (0, False), 0)


def _grown(rng, size):
    """Return a region without holes: a cell is added only where it closes no ring."""
    cells = {(0, 0)}
    ring = ((-1, 0), (-1, 1), (0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1))
    while len(cells) < size:
        row, column = sorted(cells)[rng.integers(len(cells))]
        step = STEPS[rng.integers(4)]
        there = (row + step[0], column + step[1])
        around = [(there[0] + r, there[1] + c) in cells for r, c in ring]
        if there not in cells and sum(around[k] != around[k - 1] for k in range(8)) <= 2:
            cells.add(there)
    top, left = (min(values) for values in zip(*cells, strict=True))
    return {(row - top, column - left) for row, column in cells}


def test_smart_dfs_keeps_its_bound():
    """C + E/2 - 3 moves at most (Icking et al.), of which 4/3 of the optimum is a consequence."""
    rng = np.random.default_rng(8)
    for size in (2, 5, 20, 60, 120):
        for _ in range(12):
            cells = _grown(rng, size)
            free = np.zeros(np.array([*cells]).max(axis=0) + 1, dtype=bool)
            free[tuple(np.array([*cells]).T)] = True
            edges = sum((r + a, c + b) not in cells for r, c in cells for a, b in STEPS)
            beside_walls = [
                (r, c) for r, c in cells if any((r + a, c + b) not in cells for a, b in STEPS)
            ]
            start = sorted(beside_walls)[rng.integers(len(beside_walls))]
            path = smart_dfs(free, start)
            assert set(path) == cells
            assert path[0] == path[-1] == start
            assert np.abs(np.diff(path, axis=0)).sum(axis=1).tolist() == [1] * (len(path) - 1)
            assert len(path) - 1 <= len(cells) + edges / 2 - 3


def test_smart_dfs_winds_into_a_square():
    """A spiral to cell (3, 2), and the shortest way back."""
    path = smart_dfs(np.ones((6, 6)), (0, 0))
    assert path[35] == (3, 2)
    assert len(path) - 1 == 35 + 5
    with pytest.raises(InvalidInputError, match="start: expected a free cell"):
        smart_dfs([[1, 0]], (0, 1))


def test_hamiltonian_paths_are_coverages_and_coverages_paths():
    """Both ways: by permutations of the vertices, and by all commands of m - 1 letters."""
    graphs = [
        [(0, 0), (0, 1), (0, 2), (1, 1)],
        [(3, 4), (3, 5), (4, 4), (4, 5), (5, 4)],
        [(0, 0), (0, 1), (0, 2), (1, 0), (1, 2)],
    ]
    answers = []
    for vertices in graphs:
        for start in vertices:
            instance = coverage_instance(vertices, start)
            paths = [
                order
                for order in itertools.permutations(vertices)
                if order[0] == start
                and all(
                    abs(a - c) + abs(b - d) == 1 for (a, b), (c, d) in itertools.pairwise(order)
                )
            ]
            covers = [
                commands
                for commands in map("".join, itertools.product("lurd", repeat=instance.moves))
                if _covers(instance.free, instance.start, commands)
            ]
            assert sorted(instance.commands(path) for path in paths) == sorted(covers)
            answers.append(bool(paths))
            for commands in covers[:1]:  # and by Shoal
                problem = SwarmProblem(
                    instance.free,
                    start=(instance.start,),
                    task="coverage",
                    policy=f"manual:{commands}",
                )
                episode = run(problem)
                assert (str(episode.status), episode.moves) == ("complete", instance.moves)
    assert {True, False} == set(answers)
    with pytest.raises(InvalidInputError, match="start: expected one of the vertices"):
        coverage_instance([(0, 0)], (0, 1))
    with pytest.raises(InvalidInputError, match="path: expected neighbouring cells"):
        coverage_instance([(0, 0), (0, 1)], (0, 0)).commands([(0, 0), (2, 0)])


def _covers(free, place, commands):
    visited = {place}
    for letter in commands:
        step = STEPS["urdl".index(letter)]
        there = (place[0] + step[0], place[1] + step[1])
        if not all(0 <= x < n for x, n in zip(there, free.shape, strict=True)) or not free[there]:
            continue
        place = there
        visited.add(place)
    return len(visited) == free.sum()


def test_the_harmonic_law_of_the_largest_gap():
    """Against the exact mean of ever longer lines, whose ratio tends to 1; the printed law's does
    not.
    """
    lines = [Line(m, 6) for m in (60, 600, 6000)]
    laws = [abs(line.largest_gap_law / float(line.largest_gap.exact) - 1) for line in lines]
    assert laws == sorted(laws, reverse=True)
    assert laws[-1] < 1e-3
    many = Line(10**9, 4 * 10**8)  # of which no array fits into memory
    assert many.largest_gap_law == pytest.approx(1.5 * (np.log(4e8) + np.euler_gamma))
    printed = [line.printed_largest_gap_law / float(line.largest_gap.exact) for line in lines]
    assert printed == sorted(printed, reverse=True)
    assert printed[-1] < 0.45


def test_adversary_command(capsys):
    assert command(["adversary", "depth-first", "--cells", "12", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["least"] == 2 * min(result["left"], result["right"]) + 12 + 2
    assert result["ratio"] == result["moves"] / result["least"] > 1.8
    assert command(["adversary", "depth-first", "--cells", "0"]) == 2
    assert "cells: expected" in capsys.readouterr().err
