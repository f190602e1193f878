"""Placements: rules that choose the start cells of the particles."""

from __future__ import annotations

import inspect
from collections.abc import Callable

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError, errors_at
from shoal.core.registry import Registry, configured
from shoal.swarm.grid.commands import offsets_of
from shoal.swarm.grid.world import check_start
from shoal.swarm.maps.workspace import GridWorkspace

Placement = Callable[[GridWorkspace, int, Generator], NDArray[np.int64]]
PLACEMENTS: Registry[Placement] = Registry("placement", functions=True)


def place(workspace: GridWorkspace, n: int, placement: str | Placement, rng: Generator) -> NDArray[np.int64]:
    """Return the start cells of ``n`` particles.

    Parameters
    ----------
    workspace : GridWorkspace
    n : int
        Number of particles, from 1 to ``workspace.n_free``.
    placement : str or callable
        The placement rule: "uniform", "flood-fill", "region-fill", "left-wall", the name of a function in the form
        "module:attribute", or a function. A placement function is called with (workspace, n, rng) and returns the start cells.
    rng : numpy.random.Generator

    Returns
    -------
    ndarray of int64, shape (n, ndim)
        The start cells: distinct free cells in row-major order.

    Raises
    ------
    InvalidInputError
        Raised if the workspace has fewer than ``n`` free cells, or if the placement chooses a part of the workspace with fewer than
        ``n`` free cells.

    Examples
    --------
    >>> workspace = GridWorkspace([[1, 1, 0, 1]])
    >>> place(workspace, 3, "uniform", np.random.default_rng(1)).tolist()
    [[0, 0], [0, 1], [0, 3]]
    """
    if not 1 <= n <= workspace.n_free:
        raise InvalidInputError(f"particles: expected 1 to {workspace.n_free} (the free cells of {workspace.name}), got {n}")
    function = make_placement(placement)
    try:
        cells = function(workspace, n, rng)
    except TypeError:
        if _takes(function, workspace, n, rng):
            raise
        raise _no_placement(function) from None
    with errors_at(f"placement {_name(placement)}"):
        checked = check_start(workspace, cells)
    if len(checked) != n:
        raise InvalidInputError(f"placement {_name(placement)}: expected {n} cells, got {len(checked)}")
    return checked


def make_placement(placement: str | Placement) -> Placement:
    """Return the placement function for a name. Return a given function unchanged. Other arguments raise InvalidInputError."""
    made: Placement = configured(PLACEMENTS, placement) if isinstance(placement, str) else placement
    if not callable(made):
        raise _no_placement(made)
    return made


def _no_placement(given: object) -> InvalidInputError:
    return InvalidInputError(f"placement: expected a name, or a function (workspace, n, rng) -> cells, got {shortened(given)}")


def _takes(function: Placement, *arguments: object) -> bool:
    """Return whether a function accepts the three arguments of a placement.

    For a function without a signature, such as some built-in functions of Python, return true.
    """
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
    """Draw n different free cells at random, all with equal probability."""
    return workspace.cells[rng.choice(workspace.n_free, size=n, replace=False)]


@PLACEMENTS.register("flood-fill")
def flood_fill(workspace: GridWorkspace, n: int, rng: Generator) -> NDArray[np.int64]:
    """Choose a random free cell, and take the n free cells with the shortest paths to the chosen cell."""
    from shoal.swarm.kernels.search.breadth_first import nearest_cells

    padded, start = np.pad(workspace.free, 1), workspace.cells[rng.integers(workspace.n_free)]
    flat = int(np.ravel_multi_index(tuple(start + 1), padded.shape))
    found = nearest_cells(padded.ravel(), offsets_of(padded.shape), flat, n)
    if len(found) < n:
        raise InvalidInputError(
            f"flood-fill: expected {n} connected free cells around {tuple(start.tolist())} of {workspace.name}, "
            f"got only {len(found)}"
        )
    return np.stack(np.unravel_index(found, padded.shape), axis=1) - 1


@PLACEMENTS.register("region-fill")
def region_fill(workspace: GridWorkspace, n: int, rng: Generator) -> NDArray[np.int64]:
    """Take the n free cells with the smallest Manhattan distance, measured through walls, to a random cell of the map."""
    center = np.array([rng.integers(size) for size in workspace.shape])
    distance = np.abs(workspace.cells - center).sum(axis=1)
    return workspace.cells[np.argsort(distance, kind="stable")[:n]]


@PLACEMENTS.register("left-wall")
def left_wall(workspace: GridWorkspace, n: int, rng: Generator) -> NDArray[np.int64]:
    """Take the n leftmost free cells, column by column from top to bottom, for the policy sweep (paper D, section III.B.2)."""
    cells = workspace.cells
    return cells[np.lexsort((*cells.T[:-1][::-1], cells[:, -1]))[:n]]
