"""The policies for the task gathering: pairwise and gather-beam."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_choice, check_integer
from shoal.core.dataclass import dataclass
from shoal.swarm.grid.board import RULES, decode
from shoal.swarm.grid.pairs import MOST_CELLS, PairGrid, pair_grid
from shoal.swarm.grid.state import RULE_CODES
from shoal.swarm.kernels import gathering as kernels
from shoal.swarm.policies.protocol import Decision, View

if TYPE_CHECKING:
    from numpy.random import Generator

CHOICES = {"closest": kernels.CLOSEST, "farthest": kernels.FARTHEST}
WIDTH = 64
PATIENCE = 200  # moves without a smaller estimate after which a pair is brought together
LEVELS = 4096  # moves of a beam search
NAMES = 1 << 18  # room for the names of the swarms that a beam search has met


@dataclass(frozen=True)
class Pairwise:
    """Bring two particles together, then two others, until all are in one cell; then bring this cell
    into the region.

    One of the two particles follows a shortest path to the other one, which obeys the same commands.
    Each command that moves the other particle makes the path longer by one, and each command that
    does not makes it shorter. The particles meet after O(D² L) moves, where D is the length of the
    longest shortest path of the map, and L is its longer side. Sources: the algorithms of Mahadev
    and others (2016) and of Becker and others (2020); docs/concepts/gathering.md.

    Parameters
    ----------
    pair : str
        The pair that is brought together next: "closest" or "farthest".
    path : str
        "dynamic": a shorter path replaces the path after each command; or "static": at its end.
    """

    kind: ClassVar[str] = "pairwise"
    gathers: ClassVar[bool] = True
    rules: ClassVar[frozenset[str]] = frozenset({"merge"})
    pair: str = "closest"
    path: str = "dynamic"

    def __post_init__(self) -> None:
        check_choice(self.pair, what="pair", choices=CHOICES)
        check_choice(self.path, what="path", choices=("dynamic", "static"))

    @property
    def name(self) -> str:
        """The registered name of the policy, with all options that differ from their defaults."""
        changed = [
            f"{name}={value}"
            for name, value, usual in (
                ("pair", self.pair, "closest"),
                ("path", self.path, "dynamic"),
            )
            if value != usual
        ]
        return self.kind + (":" + ",".join(changed) if changed else "")

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the commands that bring two particles together, or the last one to the region."""
        grid = pair_grid(view.belief.open, view.targets, view.rule, 1, pairs=False)
        swarm = grid.swarm(view.occupied)
        return bring_together(grid, swarm, self.pair, replans=self.path == "dynamic"), None


def bring_together(grid: PairGrid, swarm: NDArray[np.int64], pair: str, *, replans: bool) -> str:
    """Return the commands that bring two particles together, or "" if no two can meet."""
    capacity = 1024
    steps, queue, mark = (np.zeros(grid.cells.size, dtype=np.int64) for _ in range(3))
    while True:
        plan = np.zeros(capacity, dtype=np.int8)
        length = kernels.unite_pair(
            grid.ahead,
            swarm,
            swarm.size,
            grid.goal,
            CHOICES[pair],
            replans,
            steps,
            queue,
            mark,
            plan,
        )
        if length >= 0:
            return decode(plan[:length])
        capacity *= 4


@dataclass(frozen=True)
class GatherBeam:
    """Plan with a beam search how all particles are brought together.

    For each pair of cells, a breadth-first search over pairs computes how many commands two
    particles there need to meet. A swarm is estimated by the most commands that each of its cells
    needs with any other, on average. The beam search keeps the swarms with the smallest estimates,
    move by move. Where the estimate does not get smaller, two particles are brought together like
    the policy `Pairwise` does, so that every episode under the rule merge ends. On maps with more
    than `MOST_CELLS` free cells, paths of single particles replace the pairs.

    Parameters
    ----------
    width : int
        Number of swarms that the search keeps. With 1, the search is greedy.
    """

    kind: ClassVar[str] = "gather-beam"
    gathers: ClassVar[bool] = True
    rules: ClassVar[frozenset[str]] = frozenset(RULES)
    width: int = WIDTH

    def __post_init__(self) -> None:
        check_integer(self.width, what="width", least=1, most=100_000)

    @property
    def name(self) -> str:
        """The registered name of the policy. A width that differs from the default is part of the
        name.
        """
        return self.kind if self.width == WIDTH else f"{self.kind}:width={self.width}"

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the commands up to the end, or up to the next pair that is brought together."""
        merges = view.rule == "merge"
        grid = pair_grid(
            view.belief.open,
            view.targets,
            view.rule,
            1 if merges else len(view.occupied),
            pairs=view.rule != "tilt" and len(view.belief.open) <= MOST_CELLS,
        )
        swarm = grid.swarm(view.occupied)
        if grid.fewest.size and (grid.fewest[swarm[:, None] * grid.cells.size + swarm] < 0).any():
            return "", None
        plan, gathered = plan_with_beam(grid, swarm, view.rule, self.width)
        if not merges and not gathered:  # nothing is lost with another estimate
            alone = replace(grid, fewest=grid.fewest[:0])
            plan, gathered = plan_with_beam(alone, swarm, view.rule, self.width)
        if gathered or not merges:
            return decode(plan), None
        for code in plan.tolist():
            swarm = np.unique(np.where(grid.ahead[code, swarm] < 0, swarm, grid.ahead[code, swarm]))
        return decode(plan) + bring_together(grid, swarm, "closest", replans=True), None


def plan_with_beam(
    grid: PairGrid, swarm: NDArray[np.int64], rule: str, width: int
) -> tuple[NDArray[np.int8], bool]:
    """Return the commands that a beam search finds, and whether they gather the swarm."""
    commands, m = grid.ahead.shape
    n, successors = swarm.size, width * commands
    plan = np.zeros(LEVELS + 1, dtype=np.int8)
    names = np.random.default_rng(0).integers(1, 2**63, size=m, dtype=np.uint64)
    length, gathered = kernels.search_plan(
        grid.ahead,
        RULE_CODES[rule],
        grid.goal,
        grid.fewest,
        grid.near,
        swarm,
        np.zeros((width, n), dtype=np.int64),
        np.zeros(width, dtype=np.int64),
        np.zeros((successors, n), dtype=np.int64),
        np.zeros(successors, dtype=np.int64),
        np.zeros(successors, dtype=np.float64),
        np.zeros(2 * successors, dtype=np.int64),
        np.zeros((LEVELS, width), dtype=np.int32),
        np.zeros((LEVELS, width), dtype=np.int8),
        names,
        np.zeros(NAMES, dtype=np.uint64),
        np.zeros(m, dtype=np.int64),
        PATIENCE,
        plan,
    )
    return plan[:length], bool(gathered)
