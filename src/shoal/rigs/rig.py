"""What a rig is, and simulated rigs with and without noise."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_kind
from shoal.core.dataclass import dataclass
from shoal.core.errors import RigError
from shoal.swarm.grid.world import GridWorld
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.noise import Noise, NoisyWorld

LARGEST_VIEW = 2**22
"""Maximum number of cells in the field of view of a rig, such as 2048 times 2048: a drive then
needs less than 1 GiB.
"""


class PositionError(RigError):
    """Raised if a position is not a cell of the field of view: not two or three whole numbers, or
    outside.
    """


@dataclass(frozen=True, eq=False)
class Frame:
    """What a sensor has seen.

    Parameters
    ----------
    points : ndarray of float64, shape (n, ndim)
        Centroids of the particles, in the sensor's own unit (of a camera, pixels: column and row).
    time : float
        When the picture arrived, in seconds of the monotonic clock of this computer.
    number : int
        Number of the picture. It counts up; two frames with the same number are the same picture.
    """

    points: NDArray[np.float64]
    time: float
    number: int


@runtime_checkable
class Rig(Protocol):
    """A real or simulated device that moves particles and observes the particles' positions.

    A rig is at rest between two commands, so that a policy may take any time to compute a command.
    """

    @property
    def name(self) -> str:
        """Name of the rig, as written in summaries and files."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the rig's field of view in cells: (rows, columns) or (layers, rows, columns)."""

    @property
    def rule(self) -> str:
        """The rig's move rule: "block", "merge" or "tilt"."""

    def send(self, command: str) -> None:
        """Carry out one command: a letter of ``lurd`` in 2-D, or a letter of ``lurdio`` in 3-D."""

    def observe(self) -> NDArray[np.int64]:
        """Return the cells of all observed particles (int64, shape (n, ndim))."""

    def stop(self) -> None:
        """Stop all motion at once. After `stop`, the rig refuses further commands."""


class SimulatedRig:
    """A simulated rig that makes no errors when it moves and observes particles in a workspace.

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
        """Name of the rig: the name of the simulated workspace."""
        return self._world.workspace.name

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the simulated workspace, in cells."""
        return self._world.workspace.shape

    @property
    def rule(self) -> str:
        """Name of the move rule: "block", "merge" or "tilt"."""
        return self._world.rule

    @property
    def exact(self) -> bool:
        """True: the rig makes no errors, so that a drive need not expect any."""
        return True

    def send(self, command: str) -> None:
        """Move all particles by one command."""
        if self._stopped:
            raise RigError("the simulated rig has been stopped")
        self._move(command)

    def _move(self, command: str) -> None:
        self._state = self._world.step(self._state, command)

    def enter(self, cell: tuple[int, ...]) -> bool:
        """Let a particle come in at a free cell, and return whether there was room for it."""
        if cell in self._state.occupied and self.rule != "merge":
            return False
        self._state = self._world.initial([*self._state.cells.tolist(), cell])
        return True

    def observe(self) -> NDArray[np.int64]:
        """Return the cells of all particles (int64, shape (n, ndim))."""
        return self._state.cells

    def stop(self) -> None:
        """Stop the rig. A stopped rig refuses all further commands."""
        self._stopped = True


class NoisyRig(SimulatedRig):
    """A simulated rig with noise, under the move rule block. Particles may slip, remain unseen, or
    appear in a neighbouring cell.

    Each call of `observe` draws new random errors.

    Parameters
    ----------
    workspace : GridWorkspace
    start : array_like of int, shape (n, ndim)
    noise : Noise
    rng : Generator

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> rig = NoisyRig(GridWorkspace([[1, 1, 1]]), [(0, 0)], Noise(miss=0.5), np.random.default_rng(1))
    >>> rig.send("r")
    >>> [len(rig.observe()) for _ in range(6)]
    [1, 0, 1, 0, 0, 1]
    """

    def __init__(
        self, workspace: GridWorkspace, start: ArrayLike, noise: Noise, rng: Generator
    ) -> None:
        super().__init__(workspace, start)
        check_kind(noise, Noise, what="noise")
        check_kind(rng, np.random.Generator, what="rng")
        self._noisy = NoisyWorld(workspace, self._state.cells, noise, rng)

    @property
    def exact(self) -> bool:
        """False: the rig makes errors."""
        return False

    def _move(self, command: str) -> None:
        self._noisy.step(command)

    def enter(self, cell: tuple[int, ...]) -> bool:
        """Let a particle come in at a free cell, and return whether there was room for it."""
        return self._noisy.enter(cell)

    def observe(self) -> NDArray[np.int64]:
        """Return the cells in which the rig observes particles, also in the rim around the
        workspace (int64, shape (k, ndim)).
        """
        return self._noisy.scan()


class EnteringRig:
    """A simulated rig into which particles come at an inlet, one after another.

    Parameters
    ----------
    rig : SimulatedRig, NoisyRig or PhysicsRig
        With the first particle, or the first ones.
    inlet : tuple of int
        The cell in which particles come in, as soon as it is empty.
    every : int
        Number of commands from one particle to the next.
    most : int
        Number of particles that come in, at most.

    Examples
    --------
    >>> rig = SimulatedRig(GridWorkspace([[1, 1, 1, 1]]), [(0, 0)])
    >>> rig = EnteringRig(rig, (0, 0), every=2, most=1)
    >>> for command in "rrrr":
    ...     rig.send(command)
    >>> rig.observe().tolist()
    [[0, 2], [0, 3]]
    """

    def __init__(self, rig: Any, inlet: tuple[int, ...], *, every: int, most: int) -> None:
        self._rig, self._inlet, self._every, self._left, self._due = rig, inlet, every, most, 0
        self.name, self.shape, self.rule = rig.name, rig.shape, rig.rule
        self.exact: bool = getattr(rig, "exact", False)

    def send(self, command: str) -> None:
        """Move all particles by one command, and then let a particle come in if it is time."""
        self._rig.send(command)
        self._due += 1
        if self._left and self._due >= self._every and self._rig.enter(self._inlet):
            self._due, self._left = 0, self._left - 1

    def observe(self) -> NDArray[np.int64]:
        """Return the cells in which the rig observes particles (int64, shape (n, ndim))."""
        cells: NDArray[np.int64] = self._rig.observe()
        return cells

    def stop(self) -> None:
        """Stop the rig."""
        self._rig.stop()
