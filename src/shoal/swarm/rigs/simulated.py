"""A simulated rig, without noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.errors import RigError
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.maps.workspace import GridWorkspace


class SimulatedRig:
    """Simulated particles in a workspace. This rig moves and observes particles without errors.

    Parameters
    ----------
    workspace : GridWorkspace
    start : array_like of int, shape (n, ndim)
    rule : str

    Raises
    ------
    InvalidInputError, UnknownNameError

    Examples
    --------
    >>> rig = SimulatedRig(GridWorkspace([[1, 1, 1]]), [(0, 0)])
    >>> rig.send("r")
    >>> rig.observe().tolist()
    [[0, 1]]
    """

    def __init__(self, workspace: GridWorkspace, start: ArrayLike, *, rule: str = "block") -> None:
        self._world = GridWorld(workspace, rule)
        self._state = self._world.initial(start)
        self._stopped = False

    @property
    def name(self) -> str:
        """Name of the workspace."""
        return self._world.workspace.name

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the workspace."""
        return self._world.workspace.shape

    @property
    def rule(self) -> str:
        """The move rule."""
        return self._world.rule

    def send(self, command: str) -> None:
        """Carry out one command."""
        if self._stopped:
            raise RigError("the simulated rig has been stopped")
        self._state = self._world.step(self._state, command)

    def observe(self) -> NDArray[np.int64]:
        """Return the cells of the particles; int64, shape (n, ndim)."""
        return self._state.cells

    def stop(self) -> None:
        """Refuse all further commands."""
        self._stopped = True
