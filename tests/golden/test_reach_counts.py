"""Reach counts: how many configurations there are after exactly k commands; the test of the rules,
as perft is in chess.

Two independent implementations, the packed world and the tuples of tests/reference/reach.py, must
give the stored numbers. To store them anew: ``python -m tests.golden.test_reach_counts``.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from tests.golden.cases import CASES, start_of
from tests.reference.reach import reach_counts

from shoal.swarm import GridWorld
from shoal.swarm.grid.board import letters_of

RULES = ("block", "merge", "tilt")
FILE = Path(__file__).parent / "reach_counts.json"


def packed_counts(name: str, placement: str, n: int, depth: int, rule: str) -> list[int]:
    """Count with the packed world."""
    workspace, start = start_of(name, placement, n)
    world = GridWorld(workspace, rule)
    level, counts = {world.initial(start)}, [1]
    for _ in range(depth):
        level = {
            world.step(state, command) for state in level for command in letters_of(workspace.ndim)
        }
        counts.append(len(level))
    return counts


def key_of(name: str, placement: str, n: int, rule: str) -> str:
    return f"{name}, {placement} {n}, {rule}"


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize(("name", "placement", "n", "depth"), CASES)
def test_reach_counts(name, placement, n, depth, rule):
    stored = json.loads(FILE.read_text())[key_of(name, placement, n, rule)]
    workspace, start = start_of(name, placement, n)
    assert packed_counts(name, placement, n, depth, rule) == stored
    assert reach_counts(workspace.free, start, depth, rule) == stored


def test_all_cases_are_stored():
    assert set(json.loads(FILE.read_text())) == {
        key_of(c[0], c[1], c[2], rule) for c in CASES for rule in RULES
    }
    assert len(CASES) >= 12


if __name__ == "__main__":
    table = {
        key_of(*case[:3], rule): packed_counts(*case, rule) for case in CASES for rule in RULES
    }
    FILE.write_text(
        "{\n" + ",\n".join(f" {json.dumps(k)}: {json.dumps(v)}" for k, v in table.items()) + "\n}\n"
    )
