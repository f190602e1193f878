"""Maps from medical volumes in NIfTI format, read by the library nibabel."""

from __future__ import annotations

import gzip
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from math import isfinite, prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError, MissingExtraError
from shoal.swarm.maps.arrays import free_by_number
from shoal.swarm.maps.reading import MapOptions, check_size, reading
from shoal.swarm.maps.workspace import GridWorkspace

NIFTI = (".nii", ".nii.gz")
CHUNK = 1 << 20  # bytes


def read_nifti(path: Path, options: MapOptions) -> tuple[NDArray[Any], tuple[float, ...]]:
    """Return the free cells (layers, rows, columns) of a NIfTI file, and the voxel size along each axis in millimetres.

    The function uses the file's header to rotate the volume into the view of a person in front of the body. Layer 0 is at the front
    of the body, and row 0 is at the head. The columns run from the body's right side to its left side.

    Raises
    ------
    InvalidInputError
        Raised if the file is damaged or truncated, or if the volume is not three-dimensional, has too many voxels, or contains
        infinite values or NaN.
    MissingExtraError
    """
    nibabel = _nibabel()
    with _silent(nibabel.imageglobals.logger), reading(path, "a NIfTI volume"):
        image = _kind(path, nibabel).from_filename(path)
        shape = tuple(int(side) for side in image.shape)
        while len(shape) > 3 and shape[-1] == 1:
            shape = shape[:-1]
        dtype = image.get_data_dtype()
        if len(shape) != 3 or dtype.kind not in "biuf" or min(shape) < 1:
            raise InvalidInputError(f"{path}: expected a volume of numbers in 3 dimensions, got {dtype} {shape}")
        check_size(path, *shape)
        _check_archive(path, getattr(image.dataobj, "offset", 0) + prod(shape) * dtype.itemsize)
        image = nibabel.as_closest_canonical(image)
        data = np.asanyarray(image.dataobj).reshape(image.shape[:3])
        sides = tuple(float(side) * _unit(image.header) for side in image.header.get_zooms()[:3])
    if not all(isfinite(side) and side > 0 for side in sides):
        raise InvalidInputError(f"{path}: expected voxels with sides above 0, got {sides}")
    free = free_by_number(np.ascontiguousarray(data[::-1, ::-1, ::-1].transpose(1, 2, 0)), options, where=str(path))
    return free, (sides[1], sides[2], sides[0])


def encode_nifti(workspace: GridWorkspace, suffix: str) -> bytes:
    """Return a map as the bytes of a NIfTI file, with 1 for each free cell, 0 for each obstacle, and the voxel size."""
    nibabel = _nibabel()
    data = workspace.free.transpose(2, 0, 1)[::-1, ::-1, ::-1].astype(np.uint8)
    sides = workspace.spacing or (1.0, 1.0, 1.0)
    image = nibabel.Nifti1Image(data, np.diag([sides[2], sides[0], sides[1], 1.0]))
    image.header.set_xyzt_units("mm")
    plain: bytes = image.to_bytes()
    return gzip.compress(plain, mtime=0) if suffix.endswith(".gz") else plain


def _nibabel() -> Any:
    try:
        import nibabel
    except ImportError:
        raise MissingExtraError("NIfTI volumes need nibabel: pip install 'shoal[volumes]'") from None
    return nibabel


@contextmanager
def _silent(logger: logging.Logger) -> Iterator[None]:
    """Suppress a library's log messages inside the ``with`` block, because Shoal's own error message repeats them."""
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)


def _check_archive(path: Path, expected: int) -> None:
    """Read a compressed volume to its end, which verifies the checksum. The library nibabel stops reading before the checksum."""
    if not path.name.lower().endswith(".gz"):
        return
    with gzip.open(path) as file:
        size = 0
        while piece := file.read(CHUNK):
            size += len(piece)
            if size > expected + CHUNK:
                raise InvalidInputError(f"{path}: expected {expected} bytes of a volume according to the header, got more")


def _kind(path: Path, nibabel: Any) -> Any:
    """Return the NIfTI image class that matches the first bytes of the file, so that nibabel tries no other format."""
    with nibabel.openers.Opener(path) as file:
        begin = file.read(4)
    for length, kind in ((348, nibabel.Nifti1Image), (540, nibabel.Nifti2Image)):
        if begin in {length.to_bytes(4, "little"), length.to_bytes(4, "big")}:
            return kind
    raise InvalidInputError(f"{path}: expected a NIfTI volume, got a damaged, truncated or other file (it begins with {begin!r})")


def _unit(header: Any) -> float:
    """Return the length unit of a NIfTI header, in millimetres. In a header without a unit, lengths count as millimetres."""
    units = {"meter": 1000.0, "micron": 0.001}
    return units.get(header.get_xyzt_units()[0], 1.0) if hasattr(header, "get_xyzt_units") else 1.0
