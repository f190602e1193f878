"""Maps as numeric arrays: NumPy's ``.npy`` files and MATLAB's ``.mat`` files."""

from __future__ import annotations

import io
from collections.abc import Iterator
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.core.notices import tell_once
from shoal.swarm.maps.reading import PIECE, MapOptions, check_data, check_size, index_of, reading
from shoal.swarm.maps.values import Mask, free_by_number, in_pieces
from shoal.swarm.maps.workspace import GridWorkspace

MATLAB_NUMBERS = {
    "logical": 1, "int8": 1, "uint8": 1, "int16": 2, "uint16": 2, "int32": 4, "uint32": 4, "int64": 8, "uint64": 8, "single": 4,
    "double": 8,
}  # fmt: skip
"""MATLAB's classes of numbers, with the bytes of a number."""

MOST_CHANNELS = 16
"""Maximum length of the last axis of an array of which a channel is chosen: a longer axis has the columns of a map."""


def read_npy(path: Path, options: MapOptions) -> Mask:
    """Read a ``.npy`` file and return the free cells of the map.

    With a channel, the last axis of the array has the channels, as in an array of a colour picture.
    """
    with path.open("rb") as file, reading(path, "a NumPy array file (.npy)"):
        shape, fortran, dtype = _npy_header(file)
        axes = len(shape) - (options.channel is not None)
        if options.channel is not None and (axes not in (2, 3) or not 2 <= shape[-1] <= MOST_CHANNELS):
            raise InvalidInputError(
                f"{path}: channel: expected a last axis of 2 to {MOST_CHANNELS} channels, got an array of shape {shape}"
            )
        if axes not in (2, 3) or dtype.kind not in "biuf" or min(shape, default=0) < 0:
            raise InvalidInputError(f"{path}: expected a 2-D or 3-D array of booleans or numbers, got {dtype} {shape}")
        check_size(path, *shape[:axes])
        begin, size = file.tell(), prod(shape) * dtype.itemsize
        check_data(path, size)
        if path.stat().st_size - begin < size:
            raise ValueError(f"the length of the data, {size} bytes, is greater than file size")
        channel = None
        if options.channel is not None:
            channel = index_of([""] * shape[-1], options.channel, where=str(path))

        def pieces() -> Iterator[NDArray[Any]]:
            file.seek(begin)
            step = max(1, PIECE // max(1, row)) * row
            for first in range(0, prod(shape), max(1, step)):
                numbers = file.read(min(step, prod(shape) - first) * dtype.itemsize)
                yield np.frombuffer(numbers, dtype=dtype).reshape(-1, *stored[1:])

        stored = shape[::-1] if fortran else shape
        row = prod(stored[1:])
        if channel is None and axes == 3 and shape[-1] in (3, 4) and dtype == np.uint8 and min(shape[:2]) > 2 * shape[-1]:
            tell_once(
                f"shoal: {path}: the array is read as {shape[0]} layers of {shape[1]} rows and {shape[2]} columns (--channel reads "
                "one channel of a colour picture)"
            )
        if channel is None:
            free = np.concatenate([np.zeros((0, *stored[1:]), np.bool_), *free_by_number(pieces, options, where=str(path))])
            return np.ascontiguousarray(free.T) if fortran else free
        whole = np.concatenate([*pieces()]).reshape(stored)
        chosen = np.ascontiguousarray((whole.T if fortran else whole)[..., channel])
        return np.concatenate(free_by_number(lambda: in_pieces(chosen), options, where=str(path)))


def read_matlab(path: Path, options: MapOptions) -> Mask:
    """Read a MATLAB file and return the free cells of the only matrix in it. The third index of a matrix counts the layers.

    Numbers that belong to the matrix, such as the size of a cell, may stand beside it: only an array of more than one row and
    more than one column counts, unless there is no other.
    """
    from scipy.io import loadmat, whosmat

    with reading(path, "a MATLAB file (.mat)"):
        try:
            stored = whosmat(path)
            found = [one for one in stored if one[2] in MATLAB_NUMBERS and len(one[1]) in (2, 3) and prod(one[1]) > 0]
        except NotImplementedError:
            raise InvalidInputError(
                f"{path}: expected a MATLAB file up to version 7, got version 7.3 (save(..., '-v7') in MATLAB writes version 7)"
            ) from None
        large = [one for one in found if sum(side > 1 for side in one[1]) > 1] or found
        if len(large) != 1:
            sizes = [(f"{name} {'x'.join(map(str, shape))}", kind) for name, shape, kind in large[:8] or stored[:8]]
            names = ", ".join(words if large else f"{words} ({kind})" for words, kind in sizes) or "none"
            raise InvalidInputError(f"{path}: expected one matrix of numbers in 2 or 3 dimensions, got {names}")
        name, shape, kind = large[0]
        check_size(path, *shape)
        check_data(path, prod(shape) * MATLAB_NUMBERS[kind])
        array = np.asarray(loadmat(path, variable_names=[name])[name])
        if array.dtype.kind not in "biuf":
            raise InvalidInputError(f"{path}: expected a matrix of real numbers, got {array.dtype}")
        array = array if array.ndim == 2 else array.transpose(2, 0, 1)
        return np.concatenate(free_by_number(lambda: in_pieces(array), options, where=str(path)))


def encode_npy(workspace: GridWorkspace) -> bytes:
    """Return a workspace as the bytes of a ``.npy`` file."""
    buffer = io.BytesIO()
    np.save(buffer, workspace.free)
    return buffer.getvalue()


def free_in_array(array: NDArray[Any], options: MapOptions, *, where: str) -> Mask:
    """Return the free cells of an array in memory: `free_by_number` for each piece."""
    if array.ndim not in (2, 3) or array.dtype.kind not in "biuf":
        raise InvalidInputError(f"{where}: expected a 2-D or 3-D array of cells, got {array.ndim} dimensions of {array.dtype}")
    return np.concatenate(
        [np.zeros((0, *array.shape[1:]), np.bool_), *free_by_number(lambda: in_pieces(array), options, where=where)]
    )


def _npy_header(file: io.BufferedReader) -> tuple[tuple[int, ...], bool, np.dtype[Any]]:
    """Return the shape, the order (True for Fortran's) and the dtype of a ``.npy`` file, and stop at its data."""
    version = np.lib.format.read_magic(file)
    if version not in {(1, 0), (2, 0), (3, 0)}:
        raise ValueError(f"version {version}")
    # Version 3 allows names of fields with any letters; the header of an array of plain numbers equals that of version 2.
    read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran, dtype = read(file)
    if dtype.hasobject:
        raise ValueError("Python objects in dtype")
    return tuple(int(side) for side in shape), bool(fortran), dtype
