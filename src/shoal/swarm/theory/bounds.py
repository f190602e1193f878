"""Lower bounds on the number of moves of a mapping or coverage on any map."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.commands import offsets_of
from shoal.swarm.grid.world import check_start
from shoal.swarm.maps.workspace import GridWorkspace

_AXES = ((0, 2), (1, 3), (4, 5))  # commands with opposite directions


@dataclass(frozen=True)
class LowerBound:
    """Three lower bounds on the number of moves of any plan. The property ``moves`` is the largest of the three bounds.

    Parameters
    ----------
    count : int
        Counting bound: a lower bound that follows from the fact that each move classifies at most one cell per particle.
    distance : int
        Distance bound: if N of the cells to classify are more than d moves away from all particles, a plan needs at least d moves
        plus the counting bound of these N cells. The distance bound is the largest of these sums over all d.
    axes : int
        Axis bound: the minimum number of commands along each axis, summed over all axes. The minimum number of commands along
        an axis follows from cells that need many commands along the axis, and from walls that particles can probe along this
        axis only.
    """

    count: int
    distance: int
    axes: int

    @property
    def moves(self) -> int:
        """The largest of the three lower bounds."""
        return max(self.count, self.distance, self.axes)


def flat_cells(workspace: GridWorkspace) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Return the mask of free cells as a flat array with a rim of one cell, and the index offset of each command."""
    padded = np.pad(workspace.free, 1)
    return padded.ravel(), offsets_of(padded.shape)


def flat_mask(workspace: GridWorkspace, cells: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return the mask of a set of cells as a flat array with a rim of one cell, in the layout of `flat_cells`."""
    mask = np.zeros(workspace.shape, dtype=np.bool_)
    mask[tuple(cells.T)] = True
    return np.pad(mask, 1).ravel()


def check_case(
    workspace: GridWorkspace, start: ArrayLike, task: str, targets: NDArray[np.bool_] | None, rule: str
) -> NDArray[np.int64]:
    """Return the start cells of the particles. Refuse a task, targets or a move rule for which no lower bounds are known."""
    if rule not in ("block", "merge"):
        raise InvalidInputError(
            f"rule: expected block or merge, under which a particle moves at most one cell per command, got {rule}"
        )
    if task not in ("mapping", "coverage"):
        raise InvalidInputError(f"task: expected mapping or coverage (of targets, if given), got {task!r}")
    if targets is not None and (task == "mapping" or np.shape(targets) != workspace.shape):
        raise InvalidInputError(f"targets: expected a mask of shape {workspace.shape} for coverage, got {np.shape(targets)}")
    return check_start(workspace, start, rule=rule)


def lower_bound(
    workspace: GridWorkspace,
    start: ArrayLike,
    *,
    task: str = "coverage",
    targets: NDArray[np.bool_] | None = None,
    rule: str = "block",
) -> LowerBound:
    """Return lower bounds on the number of moves of any plan, even of a plan made with the complete map.

    Parameters
    ----------
    workspace : GridWorkspace
    start : array_like of int, shape (n, ndim)
        Start cells of the particles.
    task : str
        "coverage" or "mapping". In a mapping, the particles must classify all free cells that they can reach, and all walls beside
        reachable cells.
    targets : ndarray of bool, the shape of the workspace, optional
        For a coverage: the cells that the particles must cover. By default, the particles must cover all free cells.
    rule : str
        The move rule: "block" or "merge".

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> line = GridWorkspace([[1, 1, 1, 1, 1, 1]])
    >>> lower_bound(line, [(0, 2)])
    LowerBound(count=5, distance=5, axes=5)

    Notes
    -----
    The page docs/concepts/bounds.md proves the lower bounds.
    """
    from shoal.swarm.kernels.theory.command_costs import FAR, fewest_both_ways, fewest_paid

    cells = check_case(workspace, start, task, targets, rule)
    free, offsets = flat_cells(workspace)
    particles = flat_mask(workspace, cells)
    distances = np.where(particles, 0, FAR).astype(np.int64)
    stack = np.zeros(free.size, dtype=np.int64)
    fewest_paid(free, offsets, -1, -1, distances, stack)
    if task == "mapping":
        wanted = (distances > 0) & (distances < FAR)
    else:
        chosen = free if targets is None else np.pad(np.asarray(targets, dtype=np.bool_), 1).ravel()
        wanted = chosen & ~particles & (distances < FAR)
    n, left = len(cells), np.bincount(distances[wanted]) if wanted.any() else np.zeros(1, dtype=np.int64)
    beyond = left.sum() - np.cumsum(left)  # cells farther than d
    farthest = max((d + -(-int(more) // n) for d, more in enumerate(beyond) if more), default=0)
    axes = 0
    for back, forth in _AXES[: workspace.ndim]:
        costs, before = np.zeros(free.size, dtype=np.int64), np.zeros(free.size, dtype=np.int64)
        reach = int(fewest_both_ways(free, offsets, wanted, particles, back, forth, costs, before, stack))
        axes += max(reach, sum(-(-_only_by(free, offsets, wanted, way) // n) for way in (back, forth)))
    return LowerBound(count=-(-int(left.sum()) // n), distance=max(farthest, len(left) - 1), axes=axes)


def _only_by(free: NDArray[np.bool_], offsets: NDArray[np.int64], wanted: NDArray[np.bool_], command: int) -> int:
    """Return the number of wanted walls with a single free neighbour, from which particles probe the wall by ``command``."""
    walls = np.flatnonzero(wanted & ~free)
    inside = [(walls - offset >= 0) & (walls - offset < free.size) for offset in offsets]
    entered = [ok & free[np.clip(walls - offset, 0, free.size - 1)] for ok, offset in zip(inside, offsets, strict=True)]
    return int(np.count_nonzero(entered[command] & (np.sum(entered, axis=0) == 1)))
