"""The built-in policies that do not plan, which compiled code can play: closest-frontier,
elect-particle, random-moves, depth-first, sweep and manual.
"""

from __future__ import annotations

from dataclasses import field, fields
from typing import TYPE_CHECKING, Any, ClassVar

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import RULES, Board, GridLayout, encode, letters_of
from shoal.swarm.grid.paths import (
    OPPOSITE,
    ORDERS,
    check_neighbours,
    path_to_frontier,
    route_to_frontier,
    step_from,
)
from shoal.swarm.grid.scans import ScanRule
from shoal.swarm.kernels import episodes as kernels
from shoal.swarm.policies.protocol import Decision, Policy, View

if TYPE_CHECKING:
    from numpy.random import Generator


@dataclass(frozen=True)
class Compiled:
    """Base class of the built-in policies that kernels can run without Python code."""

    kind: ClassVar[str]
    code: ClassVar[int]  # the policy's constant in the kernels
    rules: ClassVar[frozenset[str]] = frozenset(RULES)
    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    runs: ClassVar[bool] = True  # whether the policy works with one scan after several commands
    gathers: ClassVar[bool | None] = False  # None: for gathering and for all other tasks

    @property
    def name(self) -> str:
        """The registered name of the policy, with all options that differ from their defaults."""
        changed = [
            f"{f.name}={getattr(self, f.name)}"
            for f in fields(self)
            if getattr(self, f.name) != f.default
        ]
        return self.kind + (":" + ",".join(changed) if changed else "")


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
    code: ClassVar[int] = kernels.CLOSEST

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
    code: ClassVar[int] = kernels.ELECT
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
    code: ClassVar[int] = kernels.RANDOM
    gathers: ClassVar[bool | None] = None

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return one random command."""
        letters = letters_of(view.occupied.layout.ndim)
        return letters[rng.integers(0, len(letters))], None


@dataclass
class _Trail:
    cell: tuple[int, ...]
    visited: set[tuple[int, ...]]
    commands: list[str] = field(default_factory=list)
    last: str = ""
    backtracking: bool = False


@dataclass(frozen=True)
class DepthFirst(Compiled):
    """Move one particle through the workspace: the first particle in row-major order.

    The particle tries to enter each neighbouring cell that is unknown, or that is free and not yet
    visited. If the particle has visited all free neighbours of its cell, the particle goes back by
    one cell.

    In a workspace of m free cells, the particle makes at most 2(m - 1) moves between cells, and one
    blocked move for each wall that the particle finds. The number of moves between cells is at most
    twice the number of moves of the optimal tour of all free cells. On general grid graphs, no
    strategy has a better competitive ratio than 2. All particles obey the commands, and each
    particle can classify cells. Source: paper M, section III.B.1.
    """

    kind: ClassVar[str] = "depth-first"
    code: ClassVar[int] = kernels.DEPTH_FIRST
    runs: ClassVar[bool] = False
    rules: ClassVar[frozenset[str]] = frozenset({"block", "merge"})

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next command: a probe of a neighbour, a step, or a step back."""
        if memory is None and not view.occupied:  # only with noise
            return "", None
        if memory is None:
            cell = tuple(view.occupied.cells[0].tolist())
            trail = _Trail(cell, {cell})
        else:
            trail = self._notice_move(memory, view)
        for command in letters_of(view.occupied.layout.ndim):
            ahead = step_from(trail.cell, command)
            unknown = ahead not in view.belief.known
            if unknown or (ahead in view.belief.open and ahead not in trail.visited):
                return command, _Trail(trail.cell, trail.visited, trail.commands, command)
        if not trail.commands:
            return "", trail
        back = OPPOSITE[trail.commands[-1]]
        return back, _Trail(trail.cell, trail.visited, trail.commands, back, backtracking=True)

    @staticmethod
    def _notice_move(trail: _Trail, view: View) -> _Trail:
        intended = step_from(trail.cell, trail.last)
        if intended not in view.occupied:
            return trail
        if trail.backtracking:
            trail.commands.pop()
        else:
            trail.commands.append(trail.last)
            trail.visited.add(intended)
        return _Trail(intended, trail.visited, trail.commands)


@dataclass(frozen=True)
class _Phase:
    phase: int = 0  # 0 towards the left wall, 1 up and right, 2 down and left, 3 one cycle finished
    second: bool = False
    gain: int = 0


@dataclass(frozen=True)
class WallSweep(Compiled):
    """Sweep a column of particles across a rectangle, to the right and back to the left.

    The policy first pushes all particles to the left, against the wall. On the way to the right,
    the policy alternates the commands up and right until no particle moves right. On the way back,
    the policy alternates the commands down and left. The way to the right and the way back form one
    cycle. The policy repeats the cycle until a whole cycle classifies no cell. The episode then
    ends as stalled.

    Consider a rectangle with m free cells and a height of k cells. If k particles start along the
    left wall (placement left-wall), the policy needs 4m/k moves. The policy sweep is suitable for
    rectangles only. Source: paper D, section III.B.2.
    """

    kind: ClassVar[str] = "sweep"
    code: ClassVar[int] = kernels.SWEEP
    runs: ClassVar[bool] = False
    dimensions: ClassVar[tuple[int, ...]] = (2,)

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return the next command of the sweep's cycle."""
        now = _Phase() if memory is None else self._notice_move(memory, view)
        if now.phase == 3:
            if now.gain == 0:
                return "", now
            now = _Phase(phase=1)
        return ("l", "ur", "dl")[now.phase][now.second], now

    @staticmethod
    def _notice_move(now: _Phase, view: View) -> _Phase:
        gain = now.gain + view.classified
        if now.phase == 0 or now.second:
            return _Phase(now.phase + (view.travelled == 0), False, gain)
        return _Phase(now.phase, True, gain)


@dataclass(frozen=True)
class Manual(Compiled):
    """Send the given commands. If the commands end before the task is complete, the episode is
    stalled.

    Parameters
    ----------
    commands : str
        Command letters, for example "llurr".
    """

    kind: ClassVar[str] = "manual"
    code: ClassVar[int] = kernels.MANUAL
    gathers: ClassVar[bool | None] = None
    commands: str = ""

    def decide(self, view: View, memory: Any, rng: Generator) -> Decision:
        """Return all commands at the first decision, and no commands at later decisions."""
        return (self.commands if memory is None else ""), "sent"


def check_rules(policy: Policy, layout: GridLayout, rule: str) -> None:
    """Refuse a move rule that the policy's ``rules`` omit, a number of dimensions that the
    policy's ``dimensions`` omit, or letters of the policy ``manual`` that are not commands.

    A policy without the attributes ``rules`` and ``dimensions`` supports all move rules, and two
    and three dimensions.
    """
    name = getattr(policy, "kind", policy.name)
    rules = getattr(policy, "rules", RULES)
    dimensions = getattr(policy, "dimensions", (2, 3))
    if rule not in rules:
        raise InvalidInputError(
            f"policy {name}: expected rule {' or '.join(sorted(rules))}, got {rule}"
        )
    if layout.ndim not in dimensions:
        able = " or ".join(f"{number}-D" for number in dimensions)
        raise InvalidInputError(f"policy {name}: expected a {able} workspace, got {layout.ndim}-D")
    if isinstance(policy, Manual):
        encode(policy.commands, ndim=layout.ndim)


def check_gathers(policy: Policy, *, gathering: bool) -> None:
    """Refuse a policy that cannot gather for the task gathering, and a policy of this task for any
    other task.
    """
    able = getattr(policy, "gathers", None)
    if able is not None and able != gathering:
        name = getattr(policy, "kind", policy.name)
        expected = "the task gathering" if able else "a task other than gathering"
        raise InvalidInputError(
            f"policy {name}: expected {expected}, got"
            f" {'gathering' if gathering else 'another task'}"
        )


def check_scanning(scanning: ScanRule, policy: Policy, rule: str) -> None:
    """Refuse a scan rule that the policy or the move rule does not support."""
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
