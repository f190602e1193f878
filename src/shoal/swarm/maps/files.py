"""Reading and writing of map files. A new format needs one entry in `FORMATS`."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from shoal.core.checks import check_file
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, errors_at
from shoal.core.files import atomic
from shoal.swarm.maps.arrays import encode_npy, read_npy
from shoal.swarm.maps.pictures import LARGEST_FILE, PICTURES, encode_picture, read_picture, read_slices
from shoal.swarm.maps.reading import MapOptions
from shoal.swarm.maps.text import encode_csv, encode_movingai, encode_rows, read_csv, read_movingai, read_rows
from shoal.swarm.maps.volumes import NIFTI, encode_nifti, read_nifti
from shoal.swarm.maps.workspace import GridWorkspace

Cells = tuple[NDArray[Any], tuple[float, ...] | None]
"""Free cells, and the size of a cell along each axis if the file contains it."""


@dataclass(frozen=True)
class MapFormat:
    """A format of map files.

    Parameters
    ----------
    read : callable
        Function (path, options) that returns the free cells and the size of a cell.
    encode : callable
        Function that converts a workspace to the bytes of a file of this format.
    dimensions : tuple of int
        The supported numbers of dimensions of a workspace: (2,), (3,) or (2, 3).
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
"""The map formats by file suffix."""


def read_map(path: str | os.PathLike[str], **options: Any) -> GridWorkspace:
    """Read a workspace from a map file. The suffix determines the format.

    Parameters
    ----------
    path : path
        A file with one of these suffixes: ``.png .tif .tiff .bmp .jpg .jpeg`` (bright is free), ``.txt`` (``.`` free, ``#``
        obstacle), ``.map`` (MovingAI: ``.``, ``G``, ``S`` free), ``.npy`` (2-D or 3-D, nonzero is free), ``.csv`` (1 free, 0
        obstacle), or ``.nii .nii.gz`` (3-D, nonzero is free; the voxel size is kept). A TIFF of several pages and a folder of
        pictures are 3-D maps with one layer per picture.
    **options
        Options threshold, invert, scale (pictures), level, label (``.npy`` and NIfTI); see `shoal.swarm.maps.reading.MapOptions`.

    Returns
    -------
    GridWorkspace
        The workspace. The name of the workspace is the file name without the suffix.

    Raises
    ------
    InvalidInputError
        If the file is missing, unreadable, damaged, of another format, too large, or has no free cell. The message gives the
        location of the fault.
    MissingExtraError
        If nibabel is not installed and the file is NIfTI.
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
    return named_after(source, free, spacing=spacing)


def named_after(path: Path, free: NDArray[Any], *, spacing: tuple[float, ...] | None = None) -> GridWorkspace:
    """Return a workspace named after its file without the suffix. Error messages name the file."""
    stem = path.name[: len(path.name) - len(_suffix(path))]
    with errors_at(path):
        # undecodable bytes of a name become "?"
        return GridWorkspace(free, name=stem.encode("utf-8", "replace").decode(), spacing=spacing)


def _suffix(path: Path) -> str:
    """Return the suffix of a file in lower case. ``x.nii.gz`` has the suffix ``.nii.gz``."""
    return ".nii.gz" if path.name.lower().endswith(".nii.gz") else path.suffix.lower()


def write_map(workspace: GridWorkspace, path: str | os.PathLike[str]) -> None:
    """Write a workspace to a map file. The function `read_map` reads the same cells from this file.

    Parameters
    ----------
    workspace : GridWorkspace
    path : path
        The output file. The suffix of the file determines the format, as in `read_map`.

    Raises
    ------
    InvalidInputError
        If the suffix is unknown, or the format does not support the workspace's number of dimensions.
    MissingExtraError
        If nibabel is not installed and the file is NIfTI.
    OutputError
        If the file cannot be written. No partial file remains.
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
