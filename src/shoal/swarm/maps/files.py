"""Read and write map files; a new format is one entry in `FORMATS`."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from shoal.core.checks import check_file
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.files import atomic
from shoal.swarm.maps.arrays import encode_npy, read_npy
from shoal.swarm.maps.pictures import LARGEST_FILE, PICTURES, encode_picture, read_picture, read_slices
from shoal.swarm.maps.reading import MapOptions
from shoal.swarm.maps.text import encode_csv, encode_movingai, encode_rows, read_csv, read_movingai, read_rows
from shoal.swarm.maps.volumes import NIFTI, encode_nifti, read_nifti
from shoal.swarm.maps.workspace import GridWorkspace

Cells = tuple[NDArray[Any], tuple[float, ...] | None]
"""Free cells, and the size of a cell along each axis where the file says it."""


@dataclass(frozen=True)
class MapFormat:
    """A format of map files.

    Parameters
    ----------
    read : callable
        Takes the path and the options, returns free cells and the size of a cell.
    encode : callable
        Takes a workspace, returns the bytes of a file that ``read`` reads.
    dimensions : tuple of int
        Of the workspaces that it holds.
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
"""The formats by suffix."""


def read_map(path: str | os.PathLike[str], **options: Any) -> GridWorkspace:
    """Read a workspace from a file; the suffix gives the format.

    Parameters
    ----------
    path : path
        ``.png .tif .tiff .bmp .jpg .jpeg`` (bright is free), ``.txt`` (``.`` free, ``#`` obstacle), ``.map`` (MovingAI: ``.``,
        ``G``, ``S`` free), ``.npy`` (2-D or 3-D, not zero is free), ``.csv`` (1 free, 0 obstacle), or ``.nii .nii.gz`` (3-D, not
        zero is free; the size of a voxel is kept). A TIFF of several pages and a folder of pictures are 3-D: a layer each.
    **options
        threshold, invert, scale (pictures), level, label (``.npy`` and NIfTI); see `shoal.swarm.maps.reading.MapOptions`.

    Returns
    -------
    GridWorkspace
        Named as the file, without its suffix.

    Raises
    ------
    InvalidInputError
        If the file is missing, unreadable, damaged, of another format, too large, or has no free cell; the message says where.
    MissingExtraError
        For NIfTI without nibabel.
    """
    source, chosen = Path(path), MapOptions(**options)
    suffix = _suffix(source)
    folder = bool(source.name) and os.path.isdir(source)  # unlike Path.is_dir it takes names of any length
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
    """Return free cells as a workspace that is named as its file, without the suffix; errors name the file."""
    stem = path.name[: len(path.name) - len(_suffix(path))]
    try:  # bytes of a name that are no text become "?"
        return GridWorkspace(free, name=stem.encode("utf-8", "replace").decode(), spacing=spacing)
    except InvalidInputError as error:
        raise InvalidInputError(f"{path}: {error}") from None


def _suffix(path: Path) -> str:
    """Return the suffix of a file in small letters; of ``x.nii.gz`` both."""
    return ".nii.gz" if path.name.lower().endswith(".nii.gz") else path.suffix.lower()


def write_map(workspace: GridWorkspace, path: str | os.PathLike[str]) -> None:
    """Write a workspace; `read_map` reads the same cells back.

    Parameters
    ----------
    workspace : GridWorkspace
    path : path
        The suffix says the format, as for `read_map`.

    Raises
    ------
    InvalidInputError
        For another suffix, or a workspace of dimensions that the format does not take.
    MissingExtraError
        For NIfTI without nibabel.
    OutputError
        If the file cannot be written; nothing is left behind.
    """
    target = Path(path)
    suffix = _suffix(target)
    if suffix not in FORMATS:
        raise InvalidInputError(f"{target}: expected one of the suffixes {' '.join(FORMATS)}, got {suffix!r}")
    if workspace.ndim not in FORMATS[suffix].dimensions:
        others = [other for other, form in FORMATS.items() if workspace.ndim in form.dimensions]
        raise InvalidInputError(f"{target}: expected {', '.join(others)} for a {workspace.ndim}-D workspace, got {suffix!r}")
    with atomic(target) as temporary:
        # Encoded in memory first: Pillow does not notice when a full disk takes only a part of what it writes.
        temporary.write_bytes(FORMATS[suffix].encode(workspace))
