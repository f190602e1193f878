"""The interface of rigs: devices that carry out commands and observe particles."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray


@runtime_checkable
class Rig(Protocol):
    """A device, or its simulation, that moves particles and observes them.

    A rig is at rest between two commands, so that a policy may compute for any time.
    """

    @property
    def name(self) -> str:
        """Name for summaries and files."""

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape (rows, columns) or (layers, rows, columns) of the field of view, in cells."""

    @property
    def rule(self) -> str:
        """The rig's move rule: "block", "merge" or "tilt"."""

    def send(self, command: str) -> None:
        """Carry out one command once. A command is a letter of ``lurd`` (``lurdio`` in 3-D)."""

    def observe(self) -> NDArray[np.int64]:
        """Return the cells of the particles; int64, shape (n, ndim)."""

    def stop(self) -> None:
        """Stop all motion at once and refuse further commands."""
