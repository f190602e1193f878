"""Placements: where the particles are at the start."""

from __future__ import annotations

import inspect
from collections.abc import Callable

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.errors import InvalidInputError
from shoal.registry import Registry
from shoal.swarm.grid.board import GridLayout
from shoal.swarm.grid.world import check_start
from shoal.swarm.maps.workspace import GridWorkspace

Placement = Callable[[GridWorkspace, int, Generator], NDArray[np.int64]]
PLACEMENTS: Registry[Placement] = Registry("placement")


def place(workspace: GridWorkspace, n: int, placement: str | Placement, rng: Generator) -> NDArray[np.int64]:
    """Return the start cells of ``n`` particles.

    Parameters
    ----------
    workspace : GridWorkspace
    n : int
        1 to ``workspace.n_free``.
    placement : str or callable
        "uniform", "flood-fill", "region-fill", "left-wall", "module:attribute", or a function
        (workspace, n, rng) -> cells.
    rng : numpy.random.Generator

    Returns
    -------
    ndarray of int64, shape (n, ndim)
        Different free cells, in row-major order.

    Raises
    ------
    InvalidInputError
        If the workspace, or the part of it that the placement chose, has fewer than ``n`` free cells.

    Examples
    --------
    >>> workspace = GridWorkspace([[1, 1, 0, 1]])
    >>> place(workspace, 3, "uniform", np.random.default_rng(1)).tolist()
    [[0, 0], [0, 1], [0, 3]]
    """
    if not 1 <= n <= workspace.n_free:
        raise InvalidInputError(f"particles: expected 1 to {workspace.n_free} (the free cells of {workspace.name}), got {n}")
    function = PLACEMENTS.get(placement) if isinstance(placement, str) else placement
    if not _takes(function, workspace, n, rng):
        raise InvalidInputError(f"placement {_name(placement)}: expected a function (workspace, n, rng) -> cells, got {function!r}")
    cells = function(workspace, n, rng)
    try:
        checked = check_start(workspace, cells)
    except InvalidInputError as error:
        raise InvalidInputError(f"placement {_name(placement)}: {error}") from None
    if len(checked) != n:
        raise InvalidInputError(f"placement {_name(placement)}: expected {n} cells, got {len(checked)}")
    return checked


def _takes(function: object, *arguments: object) -> bool:
    """Tell whether something can be called with these arguments; some built-in functions do not say."""
    if not callable(function):
        return False
    try:
        inspect.signature(function).bind(*arguments)
    except TypeError:
        return False
    except ValueError:
        pass
    return True


def _name(placement: str | Placement) -> str:
    return placement if isinstance(placement, str) else getattr(placement, "__name__", "custom")


@PLACEMENTS.register("uniform")
def uniform(workspace: GridWorkspace, n: int, rng: Generator) -> NDArray[np.int64]:
    """Draw n free cells without replacement."""
    return workspace.cells[rng.choice(workspace.n_free, size=n, replace=False)]


@PLACEMENTS.register("flood-fill")
def flood_fill(workspace: GridWorkspace, n: int, rng: Generator) -> NDArray[np.int64]:
    """Take the n cells nearest to a random free cell by path length, in breadth-first order."""
    from shoal.swarm.kernels.search import breadth_first

    layout = GridLayout(workspace.shape)
    start = tuple(int(i) for i in workspace.cells[rng.integers(workspace.n_free)])
    free = layout.pack(layout.rim(workspace.free)).ravel()
    queue = np.zeros((n, 2), dtype=np.int32)
    state = breadth_first.Flood(free, np.zeros_like(free), queue, layout.layers, layout.rows, layout.words[1])
    layer = start[0] + 1 if workspace.ndim == 3 else 0
    size = breadth_first.flood(state, layer * layout.rows + start[-2] + 1, start[-1] + 1)
    if size < n:
        raise InvalidInputError(
            f"flood-fill: expected {n} connected free cells around {start} of {workspace.name}, got {size} (its connected part)"
        )
    rows, columns = queue[:, 0] % layout.rows - 1, queue[:, 1] - 1
    axes = [rows, columns] if workspace.ndim == 2 else [queue[:, 0] // layout.rows - 1, rows, columns]
    return np.stack(axes, axis=1).astype(np.int64)


@PLACEMENTS.register("region-fill")
def region_fill(workspace: GridWorkspace, n: int, rng: Generator) -> NDArray[np.int64]:
    """Take the n free cells nearest by Manhattan distance to a random cell of the map, walls ignored."""
    center = np.array([rng.integers(size) for size in workspace.shape])
    distance = np.abs(workspace.cells - center).sum(axis=1)
    return workspace.cells[np.argsort(distance, kind="stable")[:n]]


@PLACEMENTS.register("left-wall")
def left_wall(workspace: GridWorkspace, n: int, rng: Generator) -> NDArray[np.int64]:
    """Take the n leftmost free cells, top to bottom: the start of policy sweep (paper D, section III.B.2)."""
    cells = workspace.cells
    return cells[np.lexsort((*cells.T[:-1][::-1], cells[:, -1]))[:n]]
