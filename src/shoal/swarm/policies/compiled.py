"""Policies that compiled code can play: closest-frontier, elect-particle and random-moves."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, ClassVar

from numpy.random import Generator

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import RULES, Board, GridLayout, letters_of
from shoal.swarm.grid.scans import ScanRule
from shoal.swarm.policies.protocol import (
    ORDERS,
    Decision,
    Policy,
    View,
    check_neighbours,
    path_to_frontier,
    route_to_frontier,
    step_from,
)


@dataclass(frozen=True)
class Compiled:
    """Base class of the built-in policies that kernels can run without Python code."""

    kind: ClassVar[str]
    code: ClassVar[int]  # the policy's constant in shoal.swarm.kernels.episodes
    rules: ClassVar[frozenset[str]] = frozenset(RULES)
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    runs: ClassVar[bool] = True  # whether the policy works with one scan after several commands

    @property
    def name(self) -> str:
        """The registered name of the policy, with all options that differ from their defaults."""
        changed = [
            f"{f.name}={getattr(self, f.name)}"
            for f in fields(self)
            if getattr(self, f.name) != f.default
        ]
        return self.kind + (":" + ",".join(changed) if changed else "")

    def check(self, layout: GridLayout, rule: str) -> None:
        """Refuse a move rule or a number of dimensions that the policy does not support.

        Raises
        ------
        InvalidInputError
        """
        _check_stated(self, layout, rule)


@dataclass(frozen=True)
class Searching(Compiled):
    """Base class of the policies that search for the nearest frontier cell.

    Parameters
    ----------
    ties : str
        The order in which the search expands cells of equal distance: "column-major" or
        "row-major".
    neighbours : str
        The order in which the search visits the neighbours of a cell, as command letters.
    """

    ties: str = "column-major"
    neighbours: str = "lurd"

    def __post_init__(self) -> None:
        if self.ties not in ORDERS:
            raise InvalidInputError(f"ties: expected {' or '.join(ORDERS)}, got {self.ties!r}")
        check_neighbours(self.neighbours, 2 if len(self.neighbours) <= 4 else 3)


def check_rules(policy: Policy, layout: GridLayout, rule: str) -> None:
    """Refuse a move rule that the policy's ``rules`` omit, or a number of dimensions that the
    policy's ``dimensions`` omit.

    A policy without the attributes ``rules`` and ``dimensions`` supports all move rules, and two
    and three dimensions.

    Raises
    ------
    InvalidInputError
    """
    if isinstance(policy, Compiled):
        policy.check(layout, rule)
    else:
        _check_stated(policy, layout, rule)


def _check_stated(policy: Policy | Compiled, layout: GridLayout, rule: str) -> None:
    name, rules, dimensions = (
        getattr(policy, "kind", policy.name),
        getattr(policy, "rules", RULES),
        getattr(policy, "dimensions", (2, 3)),
    )
    if rule not in rules:
        raise InvalidInputError(
            f"policy {name}: expected rule {' or '.join(sorted(rules))}, got {rule}"
        )
    if layout.ndim not in dimensions:
        able = " or ".join(f"{number}-D" for number in dimensions)
        raise InvalidInputError(f"policy {name}: expected a {able} workspace, got {layout.ndim}-D")


def check_scanning(scanning: ScanRule, policy: Policy, rule: str) -> None:
    """Refuse a scan rule that the policy or the move rule does not support.

    Raises
    ------
    InvalidInputError
    """
    if scanning.every_move:
        return
    if rule == "tilt":
        raise InvalidInputError(
            "scan-every: expected 1 under rule tilt, whose commands are runs of pushes, got"
            f" {scanning.every}"
        )
    if not getattr(policy, "runs", True):
        raise InvalidInputError(
            f"scan-every: expected 1 for policy {policy.name}, which must see the particles after"
            f" each move, got {scanning.every}"
        )
    if scanning.kind == "adaptive" and getattr(policy, "kind", "") != "closest-frontier":
        raise InvalidInputError(
            "scan-every: expected a number, or the policy closest-frontier for adaptive scans, got"
            f" {policy.name} with adaptive scans"
        )


@dataclass(frozen=True)
class ClosestFrontier(Searching):
    """Find the shortest path from any particle to any frontier cell, send the commands of the path,
    and repeat.

    The commands of a path always classify the frontier cell at its end. If another particle blocks
    the moving particle, the blocking particle follows the rest of the path. In 2-D, the policy
    needs at most m(3m + 1) moves, where m is the number of free cells. Theorem 2 of paper M states
    a bound of m(m+1)/2 moves, which ignores the moves that probe walls. Source: paper M, algorithm
    3. The page docs/concepts/policies.md explains the choice between equally short paths.
    """

    kind: ClassVar[str] = "closest-frontier"
    code: ClassVar[int] = 2

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the commands of the path to the nearest frontier cell."""
        path = path_to_frontier(
            view.belief,
            view.occupied,
            rule=view.rule,
            mapping=view.mapping,
            ties=self.ties,
            neighbours=self.neighbours,
        )
        return path, None


@dataclass(frozen=True)
class _Elected:
    cell: tuple[int, ...]
    plan: str
    target: tuple[int, ...]


@dataclass(frozen=True)
class ElectParticle(Searching):
    """Elect a random particle and move it along the shortest path to a frontier cell.

    The policy plans a new path when the frontier cell at the end of the path is classified. If
    another particle blocks the elected particle, the other particle becomes the elected particle.
    The algorithm of paper M never changes the elected particle, and can therefore repeat a sequence
    of moves forever. Sources: paper M, algorithm 2, and docs/concepts/policies.md.
    """

    kind: ClassVar[str] = "elect-particle"
    code: ClassVar[int] = 3
    runs: ClassVar[bool] = False
    rules: ClassVar[frozenset[str]] = frozenset({"block", "merge"})

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next command of the elected particle's path."""
        plan = ""
        target: tuple[int, ...] = ()
        if memory is None and not view.occupied:  # only with noise
            return "", None
        if memory is None:
            cells = view.occupied.cells
            cell = tuple(cells[rng.integers(0, len(cells))].tolist())
        else:
            intended = step_from(memory.cell, memory.plan[0])
            entered = intended in view.occupied
            cell = intended if entered else memory.cell
            plan, target = memory.plan[1:] if entered else "", memory.target
            if cell not in view.occupied:  # only with noise: the particle was lost from view
                cells = view.occupied.cells
                cell = tuple(cells[rng.integers(0, len(cells))].tolist()) if len(cells) else cell
                plan = ""
        if not plan or target not in view.belief.frontier:
            plan, cell = self._plan(view, cell)
            target = cell
            for command in plan:
                target = step_from(target, command)
        return plan[:1], _Elected(cell, plan, target)

    def _plan(self, view: View, cell: tuple[int, ...]) -> tuple[str, tuple[int, ...]]:
        """Return a path to a frontier cell, and the start cell of the path.

        If the particle at ``cell`` can reach no frontier cell, return the path of the particle that
        is nearest to the frontier.
        """
        plan, start = "", cell
        for sources in (Board.of_cells(view.occupied.layout, [cell]), view.occupied):
            plan, start = route_to_frontier(
                view.belief,
                sources,
                rule="block",
                mapping=view.mapping,
                ties=self.ties,
                neighbours=self.neighbours,
            )
            if plan:
                break
        return plan, start


@dataclass(frozen=True)
class RandomMoves(Compiled):
    """Send uniformly random commands. Source: paper M, algorithm 1."""

    kind: ClassVar[str] = "random-moves"
    code: ClassVar[int] = 1

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return one random command."""
        letters = letters_of(view.occupied.layout.ndim)
        return letters[rng.integers(0, len(letters))], None
