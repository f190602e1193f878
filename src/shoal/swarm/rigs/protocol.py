"""What a rig is: whatever carries out commands and sees particles."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray


@runtime_checkable
class Rig(Protocol):
    """What moves particles and sees them.

    Between two commands a rig is at rest, so a policy may take any time.
    """

    @property
    def name(self) -> str:
        """Name for summaries and files."""

    @property
    def shape(self) -> tuple[int, ...]:
        """The cells that it can see: (rows, columns) or (layers, rows, columns)."""

    @property
    def rule(self) -> str:
        """Its move rule: "block", "merge" or "tilt"."""

    def send(self, command: str) -> None:
        """Carry out one command, a letter out of ``lurd`` (3-D: ``lurdio``), once."""

    def observe(self) -> NDArray[np.int64]:
        """Return the cells of the particles; int64, shape (n, ndim)."""

    def stop(self) -> None:
        """Come to rest at once and take no further commands."""
