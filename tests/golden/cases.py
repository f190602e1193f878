"""The small cases whose reach counts are kept, by name: map, start cells, depth."""

from __future__ import annotations

import numpy as np

from shoal.swarm import GridWorkspace, place
from shoal.swarm.grid.board import trial_rng
from shoal.swarm.maps.generators import generate

MAPS: dict[str, np.ndarray] = {
    "corridor": np.ones((1, 7), bool),
    "corner": np.array([[1, 1, 1], [1, 0, 0], [1, 0, 0]], bool),
    "room": np.ones((4, 5), bool),
    "ring": np.array([[1, 1, 1, 1], [1, 0, 0, 1], [1, 1, 1, 1]], bool),
    "comb": np.array([[1, 1, 1, 1, 1], [1, 0, 1, 0, 1], [1, 0, 1, 0, 1]], bool),
    "word edge": np.ones((2, 64), bool)[:, :64] & (np.arange(64) > 58),
    "maze": generate("maze:9x7:2"),
    "cave": generate("cave:8x6:1"),
    "htree": generate("htree:25"),
    "cube": np.ones((2, 2, 3), bool),
    "stairs 3-D": np.array(
        [[[1, 1, 0], [0, 1, 0]], [[0, 1, 1], [0, 0, 1]], [[0, 0, 1], [1, 1, 1]]], bool
    ),
    "vessels 3-D": generate("vessels3d:60:1"),
    "tower 3-D": np.random.default_rng(5).random((3, 3, 4)) < 0.75,
}
CASES = [
    (name, placement, n, depth)
    for name in MAPS
    for placement, n, depth in (("uniform", 3, 6), ("flood-fill", 4, 5))
]


def start_of(name: str, placement: str, n: int) -> tuple[GridWorkspace, np.ndarray]:
    """Return the workspace (its largest part) and the start cells of a case."""
    workspace = GridWorkspace(MAPS[name], name=name).largest_component()
    return workspace, place(workspace, min(n, workspace.n_free), placement, trial_rng(1))
