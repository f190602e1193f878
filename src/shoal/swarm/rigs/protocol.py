"""What a rig is, and opening one by what a user types."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError

if TYPE_CHECKING:
    from shoal.swarm.rigs.remote import OnEvent, RemoteRig

TIMEOUT, PATIENCE = 5.0, 60.0  # seconds


@runtime_checkable
class Rig(Protocol):
    """What moves particles and sees them.

    Between two commands a rig is at rest: whoever drives it may think as long as it takes.
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


def open_rig(spec: str, *, timeout: float = TIMEOUT, patience: float = PATIENCE, on_event: OnEvent | None = None) -> RemoteRig:
    """Connect to the rig that ``spec`` names.

    Parameters
    ----------
    spec : str
        ``serial:/dev/ttyUSB0`` (``serial:/dev/ttyUSB0@9600`` for another speed than 115200), ``tcp:HOST:PORT``, or
        ``exec:COMMAND``: a program that speaks the protocol on its standard input and output.
    timeout : float
        Seconds to wait for an answer before the request is sent again.
    patience : float
        Seconds without any answer after which the rig is given up.
    on_event : callable, optional
        Told what happens on the line.

    Raises
    ------
    InvalidInputError
        For a spec that is none of these.
    MissingExtraError
        For a serial line without pyserial (``pip install 'shoal[serial]'``).
    RigError
        If the rig does not answer, or speaks another version.
    """
    from shoal.swarm.rigs.remote import RemoteRig
    from shoal.swarm.rigs.transports import open_line

    return RemoteRig(open_line(spec), timeout=timeout, patience=patience, on_event=on_event)


def check_cells(cells: object, shape: tuple[int, ...], *, what: str) -> NDArray[np.int64]:
    """Return the cells that a rig has told as int64, shape (n, ndim), in row-major order.

    Raises
    ------
    InvalidInputError
        If they are no cells, or one lies outside ``shape`` and the rim around it.
    """
    try:
        array = np.asarray(cells)
    except ValueError:
        raise InvalidInputError(f"{what}: expected cells of {len(shape)} numbers, got rows of different lengths") from None
    if array.size == 0:
        return np.zeros((0, len(shape)), dtype=np.int64)
    if array.ndim != 2 or array.shape[1] != len(shape) or not np.issubdtype(array.dtype, np.integer):
        raise InvalidInputError(f"{what}: expected integer cells of shape (n, {len(shape)}), got {array.dtype} {array.shape}")
    outside = ((array < -1) | (array > np.array(shape))).any(axis=1)
    if outside.any():
        cell = tuple(int(i) for i in array[outside][0])
        raise InvalidInputError(f"{what}: expected cells inside {shape}, got {cell}")
    ordered: NDArray[np.int64] = array[np.lexsort(array.T[::-1])].astype(np.int64)
    return ordered
