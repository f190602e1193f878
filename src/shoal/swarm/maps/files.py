"""Reading and writing of map files. To add a file format, add an entry to `FORMATS`."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_file
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, errors_at
from shoal.core.files import atomic
from shoal.swarm.maps.arrays import encode_npy, read_npy
from shoal.swarm.maps.pictures import LARGEST_FILE, PICTURES, encode_picture, read_picture, read_slices
from shoal.swarm.maps.reading import MapOptions
from shoal.swarm.maps.resampling import join_diagonals
from shoal.swarm.maps.text import encode_csv, encode_movingai, encode_rows, read_csv, read_movingai, read_rows
from shoal.swarm.maps.volumes import NIFTI, encode_nifti, read_nifti
from shoal.swarm.maps.workspace import GridWorkspace

Cells = tuple[NDArray[Any], tuple[float, ...] | None]
"""The content of a map file: the free cells, and the size of a cell along each axis (mm).

The size of a cell is None if the file does not contain the size.
"""


@dataclass(frozen=True)
class MapFormat:
    """A file format for maps.

    Parameters
    ----------
    read : callable
        Function that is called with (path, options), and returns the free cells and the size of a cell.
    encode : callable
        Function that converts a workspace to the bytes of a map file.
    dimensions : tuple of int
        Numbers of dimensions of the workspaces that the format can store: (2,), (3,) or (2, 3).
    """

    read: Callable[[Path, MapOptions], Cells]
    encode: Callable[[GridWorkspace], bytes]
    dimensions: tuple[int, ...] = (2,)


def _unsized(read: Callable[[Path, MapOptions], NDArray[Any]]) -> Callable[[Path, MapOptions], Cells]:
    return lambda path, options: (read(path, options), None)


FORMATS: dict[str, MapFormat] = {
    **{
        suffix: MapFormat(
            _unsized(read_picture), partial(encode_picture, suffix=suffix), (2, 3) if suffix.startswith(".tif") else (2,)
        )
        for suffix in PICTURES
    },
    ".txt": MapFormat(_unsized(read_rows), encode_rows),
    ".map": MapFormat(_unsized(read_movingai), encode_movingai),
    ".csv": MapFormat(_unsized(read_csv), encode_csv),
    ".npy": MapFormat(_unsized(read_npy), encode_npy, (2, 3)),
    **{suffix: MapFormat(read_nifti, partial(encode_nifti, suffix=suffix), (3,)) for suffix in NIFTI},
}
"""All map formats, keyed by file suffix."""


def read_map(path: str | os.PathLike[str], **options: Any) -> GridWorkspace:
    """Read a workspace from a map file. The suffix of the file name determines the format.

    Parameters
    ----------
    path : path
        Path of a map file. In pictures (``.png .tif .tiff .bmp .jpg .jpeg``), bright pixels are free cells. In text files
        (``.txt``), ``.`` is free and ``#`` is an obstacle. In MovingAI files (``.map``), ``.``, ``G`` and ``S`` are free. In CSV
        files (``.csv``), 1 is free and 0 is an obstacle. In NumPy files (``.npy``, 2-D or 3-D) and NIfTI files (``.nii``,
        ``.nii.gz``, 3-D), nonzero values are free. The workspace of a NIfTI file keeps the file's voxel size. A TIFF file of
        several pages is a 3-D map with one layer per page. A folder of pictures is a 3-D map with one layer per picture.
    **options
        Options threshold, invert and scale for pictures, options level and label for NumPy and NIfTI files, and join_diagonals.
        `shoal.swarm.maps.reading.MapOptions` explains the options for reading a map file.

    Returns
    -------
    GridWorkspace
        A workspace whose name is the file name without the suffix.

    Raises
    ------
    InvalidInputError
        Raised if the file is missing, unreadable, damaged or too large, has a wrong format, or contains no free cell. The error
        message gives the location of the fault.
    MissingExtraError
        Raised if the file is a NIfTI file and the library nibabel is not installed.
    """
    source, chosen = Path(path), MapOptions(**options)
    suffix = _suffix(source)
    folder = bool(source.name) and os.path.isdir(source)  # unlike Path.is_dir, it accepts names of any length
    if not folder and suffix not in FORMATS:
        raise InvalidInputError(f"{source}: expected a map file ({' '.join(FORMATS)}), got the suffix {suffix!r}")
    try:
        if folder:
            free, spacing = read_slices(source, chosen), None
        else:
            check_file(source, what="map", most=LARGEST_FILE)
            free, spacing = FORMATS[suffix].read(source, chosen)
    except OSError as error:
        raise InvalidInputError(f"{source}: cannot be read: {error.strerror or error}") from None
    return named_after(source, join_diagonals(np.asarray(free) != 0) if chosen.join_diagonals else free, spacing=spacing)


def named_after(path: Path, free: NDArray[Any], *, spacing: tuple[float, ...] | None = None) -> GridWorkspace:
    """Return a workspace whose name is the file name without the suffix. Error messages contain the file name."""
    stem = path.name[: len(path.name) - len(_suffix(path))]
    with errors_at(path):
        # undecodable bytes of a name become "?"
        return GridWorkspace(free, name=stem.encode("utf-8", "replace").decode(), spacing=spacing)


def _suffix(path: Path) -> str:
    """Return the suffix of a file in lower case. For example, the file ``x.nii.gz`` has the suffix ``.nii.gz``."""
    return ".nii.gz" if path.name.lower().endswith(".nii.gz") else path.suffix.lower()


def write_map(workspace: GridWorkspace, path: str | os.PathLike[str]) -> None:
    """Write a workspace to a map file. The function `read_map` reads equal free cells from the file.

    Parameters
    ----------
    workspace : GridWorkspace
    path : path
        Path of the output file. The suffix of the file name determines the format, as in `read_map`.

    Raises
    ------
    InvalidInputError
        Raised if the suffix is unknown, or if the format does not support the number of dimensions of the workspace.
    MissingExtraError
        Raised if the file is a NIfTI file and the library nibabel is not installed.
    OutputError
        Raised if Shoal cannot write the file. A failed write leaves no partial file.
    """
    target = Path(path)
    suffix = _suffix(target)
    if suffix not in FORMATS:
        raise InvalidInputError(f"{target}: expected one of the suffixes {' '.join(FORMATS)}, got {suffix!r}")
    if workspace.ndim not in FORMATS[suffix].dimensions:
        others = [other for other, form in FORMATS.items() if workspace.ndim in form.dimensions]
        raise InvalidInputError(f"{target}: expected {', '.join(others)} for a {workspace.ndim}-D workspace, got {suffix!r}")
    with atomic(target) as temporary:
        # Encode in memory first, because Pillow does not detect a partial write on a full disk.
        temporary.write_bytes(FORMATS[suffix].encode(workspace))
