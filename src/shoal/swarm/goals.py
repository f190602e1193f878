"""What a drive is to do: a task, with the map that is known beforehand. Under noise, a cell of a
known map counts as visited once a scan surely showed a particle in it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import Board
from shoal.swarm.grid.state import Belief, SwarmState
from shoal.swarm.grid.tasks import Mapping, Task
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.kernels import noise as kernels
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise import LOSS, Noise, NoisyBelief, bound_of, inner_of

PAUSE = 12  # scans after which a free cell of the known map that became a wall is tried again
TRIES = 2  # times that it is tried again
CHECKED = 0.9  # probability that a cell of the known map is right, if the task is to map


def prior_of(workspace: GridWorkspace, confidence: float, *, mapping: bool) -> NDArray[np.float64]:
    """Return the log-odds that each cell is free before the first scan (float64), for the cells of
    a known map and of a rim that is one cell wide.

    For a mapping, no cell of the known map counts as classified before scans have confirmed it.
    For other tasks, all cells are classified, until scans contradict.

    Examples
    --------
    >>> odds = prior_of(GridWorkspace([[1, 0]]), 0.99, mapping=True)
    >>> np.round(odds[1], 1).tolist()
    [-2.2, 2.2, -2.2, -2.2]
    """
    likely = float(np.log(CHECKED / (1 - CHECKED)))
    odds = min(likely, bound_of(confidence) / 2) if mapping else kernels.SURE
    return np.where(np.pad(workspace.free, 1), odds, -odds)


class NoisyVisits(NoisyBelief):
    """The belief of a swarm under noise, for a task on a known map.

    A cell counts as visited if a scan shows a particle in it, and the cell holds a particle with at
    least the probability ``confidence``. Scans that contradict the known map change the map. A
    particle may be jammed, though, and then stays at many commands: a free cell that has become a
    wall is tried again, `PAUSE` scans later.

    Parameters
    ----------
    known : GridWorkspace
    seen : Board
        The cells in which the first scan shows particles.
    noise : Noise
    confidence : float
    task : Task
        A task whose map is known, such as a coverage.
    targets : ndarray of bool, or None
        The target cells of the task.
    loss : float
    rule : str

    Attributes
    ----------
    visited : Board
        The cells in which scans surely showed particles.
    """

    def __init__(
        self,
        known: GridWorkspace,
        seen: Board,
        noise: Noise,
        confidence: float,
        *,
        task: Any,
        targets: NDArray[np.bool_] | None,
        loss: float = 0.0,
        rule: str = "block",
    ) -> None:
        prior = prior_of(known, confidence, mapping=False)
        settings: dict[str, Any] = {"loss": loss, "prior": prior, "rule": rule}
        super().__init__(known.shape, seen, noise, confidence, **settings)
        self.task = task
        self.visited = self._surely_seen(seen)
        self._held = self.visited
        self._prior, self._scans = prior, 0
        self._closed: dict[tuple[int, ...], list[int]] = {}  # times at which cells became walls
        world = GridWorld(known, rule)
        self._known_free = world.free
        # a task asks where the particles are: where the first scan shows them, surely or not
        state = SwarmState(seen & world.free)
        belief = task.begin(world, state, targets)
        # but a cell is visited only if a particle is surely in it
        unsure = (state.occupied - self.visited) & (
            belief.frontier if targets is None else Board.of_mask(targets)
        )
        self._goal = Belief(belief.open, belief.known, belief.frontier | unsure)

    def update(self, command: str, seen: Board) -> int:
        """Update the belief after one command and one scan. Return the number of cells visited for
        the first time, of those that the task requires.
        """
        super().update(command, seen)
        self._scans += 1
        self._try_again()
        return self._visit(command, seen)

    def _try_again(self) -> None:
        """Open free cells of the known map that became walls some time ago."""
        opened = False
        for cell in map(tuple, (super().belief.obstacles & self._known_free).cells.tolist()):
            times = self._closed.setdefault(cell, [])
            if not times or times[-1] < 0:
                times.append(self._scans)
            elif len(times) <= TRIES and self._scans - times[-1] >= PAUSE:
                at = tuple(index + 1 for index in cell)
                inner_of(self.state.logit, self.layout.shape, rim=1)[at] = self._prior[at]
                times[-1] *= -1
                opened = True
        if opened:
            kernels.refresh(self.state, self._field, self.guard)

    def place(self, seen: Board) -> None:
        """Believe that the particles were put elsewhere, and that a scan then shows ``seen``."""
        super().place(seen)
        self._held = self._surely_seen(seen)

    def _visit(self, command: str, seen: Board) -> int:
        occupied, remaining = self._surely_seen(seen), len(self._goal.frontier)
        self._goal = self.task.update(self._goal, command, self._held, occupied)
        self._held, self.visited = occupied, self.visited | occupied
        return remaining - len(self._goal.frontier)

    def _surely_seen(self, seen: Board) -> Board:
        sure = inner_of(self.state.inside >= self.confidence, self.layout.shape, rim=1)
        return Board(self.layout, self.layout.pack(np.array(sure, dtype=np.bool_))) & seen

    @property
    def belief(self) -> Belief:
        """The known map as scans have changed it, and the target cells that no particle has visited
        and that are no walls.
        """
        belief = super().belief
        # what scans leave open is as the known map has it
        doubted = self._known_free - belief.known
        return Belief(
            belief.open | doubted, belief.known | doubted, self._goal.frontier - belief.obstacles
        )

    @property
    def unvisited(self) -> Board:
        """The target cells that no particle has visited, including those that turned out to be
        walls.
        """
        return self._goal.frontier

    @property
    def confirmed(self) -> Board:
        """The cells in which scans surely showed particles."""
        return self.visited

    @property
    def remaining(self) -> int:
        """Number of target cells that no particle has visited and that are no walls."""
        return len(self.belief.frontier)

    @property
    def finished(self) -> bool:
        """Whether particles have visited all target cells."""
        return not self._goal.frontier

    @property
    def hopeless(self) -> bool:
        """Whether the target cells that are left turned out to be walls."""
        cells = map(tuple, self.unvisited.cells.tolist())
        closed_often = (len(self._closed.get(cell, ())) > TRIES for cell in cells)
        return bool(self.unvisited) and not self.belief.frontier and all(closed_often)

    @property
    def progress(self) -> int:
        """Number of cells that scans surely showed particles in."""
        return len(self.visited)

    @property
    def closed(self) -> bool:
        """False, because the particles need not classify any cell."""
        return False

    @property
    def weak_walls(self) -> Board:
        """No cell, because the task does not rest on walls."""
        return Board.empty(self.layout)


@dataclass(frozen=True, eq=False)
class Goal:
    """What a drive is to do.

    Parameters
    ----------
    task : Task
    known : GridWorkspace or None
        The map that is known beforehand. A mapping may go without one.
    targets : ndarray of bool, or None
        The target cells of the task.
    """

    task: Task
    known: GridWorkspace | None = None
    targets: NDArray[np.bool_] | None = None

    @property
    def mapping(self) -> bool:
        """Whether the task is to find out the map."""
        return bool(getattr(self.task, "mapping", True))

    def noisy(
        self,
        seen: Board,
        noise: Noise,
        confidence: float,
        *,
        rule: str = "block",
    ) -> NoisyBelief:
        """Return the belief under noise after the first scan.

        Raises
        ------
        InvalidInputError
            Raised if a particle is missing in a part of the known map with target cells, or if the
            task is a mapping of others, which noise does not support.
        """
        if not self.mapping:
            assert self.known is not None
            visits: dict[str, Any] = {"task": self.task, "targets": self.targets}
            return NoisyVisits(self.known, seen, noise, confidence, loss=LOSS, rule=rule, **visits)
        if not isinstance(self.task, Mapping):
            raise InvalidInputError(
                f"noise: expected the task mapping or a task on a known map, got {self.task.name}"
            )
        prior = None if self.known is None else prior_of(self.known, confidence, mapping=True)
        settings: dict[str, Any] = {"loss": LOSS, "prior": prior, "rule": rule}
        return NoisyBelief(seen.layout.shape, seen, noise, confidence, **settings)
