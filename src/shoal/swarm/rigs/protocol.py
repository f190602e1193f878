"""The interface of rigs: devices that carry out commands and observe the positions of particles."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import RigError

LARGEST_VIEW = 2**22
"""Maximum number of cells in the field of view of a rig, such as 2048 times 2048: a drive then needs less than 1 GiB."""


class PositionError(RigError):
    """Raised if a position is not a cell of the field of view: not two or three whole numbers, or outside."""


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
