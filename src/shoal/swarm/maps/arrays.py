"""Maps as numeric arrays: NumPy's ``.npy`` format, and the conversion of numbers to free cells."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.swarm.maps.reading import MapOptions, check_size, reading
from shoal.swarm.maps.workspace import GridWorkspace, check_finite


def read_npy(path: Path, options: MapOptions) -> NDArray[Any]:
    """Read a ``.npy`` file and return the free cells of the map."""
    with path.open("rb") as file, reading(path, "a NumPy array file (.npy)"):
        np.lib.format.read_magic(file)  # for other files NumPy's message suggests pickled objects
        # Memory mapping checks the length of the file before any data is read.
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        if not isinstance(array, np.ndarray) or array.ndim not in (2, 3) or array.dtype.kind not in "biuf":
            found = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else "an archive"
            raise InvalidInputError(f"{path}: expected a 2-D or 3-D array of booleans or numbers, got {found}")
        check_size(path, *array.shape)
        return free_by_number(np.array(array), options, where=str(path))


def encode_npy(workspace: GridWorkspace) -> bytes:
    """Return a workspace as the bytes of a ``.npy`` file."""
    buffer = io.BytesIO()
    np.save(buffer, workspace.free)
    return buffer.getvalue()


def free_by_number(array: NDArray[Any], options: MapOptions, *, where: str) -> NDArray[Any]:
    """Return the free cells of a numeric array.

    If ``level`` is given, a cell is free if its number is at least ``level``. If ``label`` is given, a cell is free if its number
    equals ``label``. If neither ``level`` nor ``label`` is given, all obstacles must have the number 0, and all free cells must
    have one common number other than 0.

    Raises
    ------
    InvalidInputError
        Raised if a number is not finite, or if no cell has the number ``label``. InvalidInputError is raised if neither ``level``
        nor ``label`` is given for an array of more than two different numbers, such as intensities or probabilities.
    """
    if options.level is not None:
        check_finite(array, what=where)
        return np.asarray(array >= options.level)
    if options.label is not None:
        check_finite(array, what=where)
        found = np.asarray(array == options.label)
        if not found.any():
            there = ", ".join(f"{value:g}" for value in np.unique(array)[:8])
            raise InvalidInputError(
                f"{where}: expected cells of label {options.label}, got none (the labels in the map are {there})"
            )
        return found
    other = array[array != 0]
    if other.size and np.isfinite(other).all() and (other != other[0]).any():
        odd = next(value for value in other if value != other[0])
        cell = tuple(int(i) for i in np.argwhere(array == odd)[0])
        raise InvalidInputError(
            f"{where}: expected 0 for obstacles and one other number for free cells, got {other[0]} and {odd} at cell {cell} "
            "(choose the level from which cells are free, or the label of free cells)"
        )
    return array
