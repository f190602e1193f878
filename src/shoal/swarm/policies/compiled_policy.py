"""Base classes of the built-in policies.

The base classes define the number by which kernels identify each policy. They also define the order in which a search visits
equally near cells.
"""

from __future__ import annotations

from dataclasses import fields
from typing import ClassVar

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import GridLayout
from shoal.swarm.grid.commands import RULES
from shoal.swarm.grid.scans import ScanRule
from shoal.swarm.policies.paths import ORDERS, check_neighbours
from shoal.swarm.policies.protocol import Policy


@dataclass(frozen=True)
class Compiled:
    """Base class of the built-in policies that kernels can run without Python code."""

    kind: ClassVar[str]
    code: ClassVar[int]  # the policy's constant in shoal.swarm.kernels.episodes.policy_episode
    rules: ClassVar[frozenset[str]] = frozenset(RULES)
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    runs: ClassVar[bool] = True  # whether the policy works with one scan after several commands

    @property
    def name(self) -> str:
        """The registered name of the policy, with all options that differ from their defaults."""
        changed = [f"{f.name}={getattr(self, f.name)}" for f in fields(self) if getattr(self, f.name) != f.default]
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
        The order in which the search expands cells of equal distance: "column-major" or "row-major".
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
    """Refuse a move rule that the policy's ``rules`` omit, or a number of dimensions that the policy's ``dimensions`` omit.

    A policy without the attributes ``rules`` and ``dimensions`` supports all move rules, and two and three dimensions.

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
        raise InvalidInputError(f"policy {name}: expected rule {' or '.join(sorted(rules))}, got {rule}")
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
        raise InvalidInputError(f"scan-every: expected 1 under rule tilt, whose commands are runs of pushes, got {scanning.every}")
    if not getattr(policy, "runs", True):
        raise InvalidInputError(
            f"scan-every: expected 1 for policy {policy.name}, which must see the particles after each move, got {scanning.every}"
        )
    if scanning.kind == "adaptive" and getattr(policy, "kind", "") != "closest-frontier":
        raise InvalidInputError(
            f"scan-every: expected a number, or the policy closest-frontier for adaptive scans, got {policy.name} with "
            "adaptive scans"
        )
