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
from shoal.swarm.maps.arrays import encode_npy, read_matlab, read_npy
from shoal.swarm.maps.pictures import LARGEST_FILE, PICTURES, encode_picture, read_picture, read_slices
from shoal.swarm.maps.reading import KINDS, Kind, MapOptions, check_used
from shoal.swarm.maps.resampling import join_diagonals
from shoal.swarm.maps.text import encode_csv, encode_movingai, encode_rows, read_csv, read_movingai, read_rows
from shoal.swarm.maps.volumes import DICOM, NIFTI, NRRD, dicom_files, encode_nifti, read_dicom, read_nifti, read_nrrd, read_series
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
    encode : callable, optional
        Function that converts a workspace to the bytes of a map file. Without this function, Shoal only reads the format.
    dimensions : tuple of int
        Numbers of dimensions of the workspaces that the format can store: (2,), (3,) or (2, 3).
    kind : Kind
        The reading options that the reader uses. All other reading options are refused. By default, the reader uses none.
    """

    read: Callable[[Path, MapOptions], Cells]
    encode: Callable[[GridWorkspace], bytes] | None = None
    dimensions: tuple[int, ...] = (2,)
    kind: Kind = Kind("a file of this format")


def _unsized(read: Callable[[Path, MapOptions], NDArray[Any]]) -> Callable[[Path, MapOptions], Cells]:
    return lambda path, options: (read(path, options), None)


def _picture_format(suffix: str) -> MapFormat:
    encode = None if suffix == ".gif" else partial(encode_picture, suffix=suffix)
    return MapFormat(read_picture, encode, (2, 3) if suffix.startswith(".tif") else (2,), KINDS["picture"])


FORMATS: dict[str, MapFormat] = {
    **{suffix: _picture_format(suffix) for suffix in PICTURES},
    ".txt": MapFormat(_unsized(read_rows), encode_rows, kind=KINDS["table"]),
    ".map": MapFormat(_unsized(read_movingai), encode_movingai, kind=KINDS["letters"]),
    ".csv": MapFormat(_unsized(read_csv), encode_csv, kind=KINDS["table"]),
    ".npy": MapFormat(_unsized(read_npy), encode_npy, (2, 3), KINDS["array"]),
    ".mat": MapFormat(_unsized(read_matlab), kind=KINDS["table"]),
    **{suffix: MapFormat(read_nifti, partial(encode_nifti, suffix=suffix), (3,), KINDS["volume"]) for suffix in NIFTI},
    **{suffix: MapFormat(read_nrrd, kind=KINDS["volume"]) for suffix in NRRD},
    **{suffix: MapFormat(read_dicom, kind=KINDS["volume"]) for suffix in DICOM},
}
"""All map formats, keyed by file suffix."""


def read_map(path: str | os.PathLike[str], **options: Any) -> GridWorkspace:
    """Read a workspace from a map file. The suffix of the file name determines the format.

    Parameters
    ----------
    path : path
        Path of a map file. In pictures (``.png .tif .tiff .bmp .jpg .jpeg .gif``), bright pixels are free cells. In text files
        (``.txt``), ``.`` is free and ``#`` is an obstacle, or the file is a table of numbers. In MovingAI files (``.map``), ``.``,
        ``G`` and ``S`` are free. In tables (``.csv``), 1 is free and 0 is an obstacle. In NumPy files (``.npy``, 2-D or 3-D),
        MATLAB files (``.mat``), NIfTI files (``.nii``, ``.nii.gz``, 3-D), NRRD files (``.nrrd``, ``.nhdr``) and DICOM files
        (``.dcm``), nonzero values are free. The workspace keeps the file's voxel size. A TIFF file of several pages is a 3-D map
        with one layer per page. A folder of pictures or of DICOM files is a 3-D map with one layer per file.
    **options
        Reading options. `shoal.swarm.maps.reading.MapOptions` explains them, and the table `shoal.swarm.maps.reading.KINDS` lists
        the options of each kind of file.

    Returns
    -------
    GridWorkspace
        A workspace whose name is the file name without the suffix.

    Raises
    ------
    InvalidInputError
        Raised if the file is missing, unreadable, damaged or too large, has a wrong format, or contains no free cell. The error
        message gives the location of the fault. InvalidInputError is also raised for an option without effect on the file.
    MissingExtraError
        Raised if the file needs a library that is not installed.
    """
    source, chosen = Path(path), MapOptions(**options)
    suffix = _suffix(source)
    folder = bool(source.name) and os.path.isdir(source)  # unlike Path.is_dir, it accepts names of any length
    if not folder and suffix not in FORMATS:
        raise InvalidInputError(f"{source}: expected a map file ({' '.join(FORMATS)}), got the suffix {suffix!r}")
    try:
        if folder and (files := dicom_files(source)):
            check_used(KINDS["volume"], chosen.given, where=str(source))
            free, spacing = read_series(source, files, chosen)
        elif folder:
            check_used(KINDS["slices"], chosen.given, where=str(source))
            free, spacing = read_slices(source, chosen), None
        else:
            check_used(FORMATS[suffix].kind, chosen.given, where=str(source))
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
    written = {known: form for known, form in FORMATS.items() if form.encode is not None}
    if suffix not in written:
        raise InvalidInputError(f"{target}: expected one of the suffixes {' '.join(written)}, got {suffix!r}")
    if workspace.ndim not in written[suffix].dimensions:
        others = [other for other, form in written.items() if workspace.ndim in form.dimensions]
        raise InvalidInputError(f"{target}: expected {', '.join(others)} for a {workspace.ndim}-D workspace, got {suffix!r}")
    encode = written[suffix].encode
    assert encode is not None
    with atomic(target) as temporary:
        # Encode in memory first, because Pillow does not detect a partial write on a full disk.
        temporary.write_bytes(encode(workspace))
