"""Read and write volumes: NIfTI (by nibabel), and what turns numbers of voxels into free cells."""

from __future__ import annotations

import gzip
import logging
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError, MissingExtraError
from shoal.swarm.maps.workspace import MAX_CELLS, GridWorkspace

NIFTI = (".nii", ".nii.gz")
EVEN = 1e-3  # so much may sides of a voxel differ and yet count as those that the header says
CHUNK = 1 << 20  # bytes


@dataclass(frozen=True)
class VolumeOptions:
    """How the numbers of an array or volume become free cells; with neither there may be 0 and one other number only.

    Parameters
    ----------
    level : float, optional
        Voxels of at least this number are free.
    label : int, optional
        Voxels of exactly this number are free.

    Raises
    ------
    InvalidInputError
        If both are given, or the level is not finite.
    """

    level: float | None = None
    label: int | None = None

    def __post_init__(self) -> None:
        if self.level is not None and self.label is not None:
            raise InvalidInputError(f"level: expected a level or a label, got {self.level:g} and {self.label}")
        if self.level is not None and not isfinite(self.level):
            raise InvalidInputError(f"level: expected a finite number, got {self.level}")

    def free(self, array: NDArray[Any], path: Path) -> NDArray[Any]:
        """Return the free cells of an array of numbers.

        Raises
        ------
        InvalidInputError
            If a number is not finite, no voxel has the label, or without level and label there are more than two numbers.
        """
        chosen = self.level is not None or self.label is not None
        if chosen and np.issubdtype(array.dtype, np.floating) and not np.isfinite(array).all():
            bad = tuple(int(i) for i in np.argwhere(~np.isfinite(array))[0])
            raise InvalidInputError(f"{path}: expected finite numbers, got {array[bad]} at cell {bad}")
        if self.level is not None:
            return np.asarray(array >= self.level)
        if self.label is not None:
            found = np.asarray(array == self.label)
            if not found.any():
                there = ", ".join(f"{value:g}" for value in np.unique(array)[:8])
                raise InvalidInputError(f"{path}: expected cells of label {self.label}, got none (there are {there})")
            return found
        return two_valued(path, array)


def two_valued(path: Path, array: NDArray[Any]) -> NDArray[Any]:
    """Return an array of 0 and one other number; intensities and probabilities are no map until somebody sets a level."""
    other = array[array != 0]
    if other.size and np.isfinite(other).all() and (other != other[0]).any():
        odd = next(value for value in other if value != other[0])
        cell = tuple(int(i) for i in np.argwhere(array == odd)[0])
        raise InvalidInputError(
            f"{path}: expected 0 for obstacles and one other number for free cells, got {other[0]} and {odd} at cell {cell} "
            "(say from which level on cells are free, or which label they have)"
        )
    return array


def suffix_of(path: Path) -> str:
    """Return the suffix of a file, in small letters; of ``x.nii.gz`` both.

    >>> suffix_of(Path("brain.NII.gz")), suffix_of(Path("map.png"))
    ('.nii.gz', '.png')
    """
    name = path.name.lower()
    return next((suffix for suffix in reversed(NIFTI) if name.endswith(suffix)), path.suffix.lower())


def _nibabel() -> Any:
    try:
        import nibabel
    except ImportError:
        raise MissingExtraError("NIfTI volumes need nibabel: pip install 'shoal[volumes]'") from None
    return nibabel


def read_nifti(path: Path, options: VolumeOptions) -> tuple[NDArray[Any], tuple[float, ...]]:
    """Return the free cells (layers, rows, columns) of a NIfTI file and the size of a voxel along each, in millimetres.

    Turned as the header says, to what one sees who stands before the body: layer 0 is its front, row 0 the head, and columns run
    from its right to its left.

    Raises
    ------
    InvalidInputError
        If it is damaged, cut off, has another number of dimensions, too many voxels, or numbers that are not finite.
    MissingExtraError
    """
    nibabel = _nibabel()
    with warnings.catch_warnings(), _hushed(nibabel.imageglobals.logger):
        warnings.simplefilter("ignore")
        try:
            image = nibabel.Nifti1Image.from_filename(path) if _is_first(path, nibabel) else nibabel.load(path)
            shape = tuple(int(side) for side in image.shape)
            while len(shape) > 3 and shape[-1] == 1:
                shape = shape[:-1]
            _check_shape(path, shape, image.get_data_dtype())
            _check_archive(path, getattr(image.dataobj, "offset", 0) + int(np.prod(shape)) * image.get_data_dtype().itemsize)
            image = nibabel.as_closest_canonical(image)
            data = np.asanyarray(image.dataobj).reshape(image.shape[:3])
            sides = tuple(float(side) for side in image.header.get_zooms()[:3])
            sides = tuple(side * _unit(image.header) for side in sides)
        except InvalidInputError:
            raise
        except Exception as error:  # damaged headers, cut off archives: nibabel, zlib and gzip raise many kinds
            raise InvalidInputError(f"{path}: expected a NIfTI volume, got a damaged or cut off one: {_one_line(error)}") from None
    if not all(isfinite(side) and side > 0 for side in sides):
        raise InvalidInputError(f"{path}: expected voxels with sides above 0, got {sides}")
    free = options.free(np.ascontiguousarray(data[::-1, ::-1, ::-1].transpose(1, 2, 0)), path)
    return free, (sides[1], sides[2], sides[0])


@contextmanager
def _hushed(logger: logging.Logger) -> Iterator[None]:
    """Keep a library from saying on stderr what our error says."""
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)


def _check_archive(path: Path, expected: int) -> None:
    """Read a compressed volume to its end, where the checksum of all of it is: nibabel stops before."""
    if not path.name.lower().endswith(".gz"):
        return
    with gzip.open(path) as file:
        size = 0
        while piece := file.read(CHUNK):
            size += len(piece)
            if size > expected + CHUNK:
                raise InvalidInputError(f"{path}: expected {expected} bytes of a volume, as its header says, got more")


def _is_first(path: Path, nibabel: Any) -> bool:
    """Tell whether a file is NIfTI of the first version, so that it is read as what its name says and as nothing else."""
    opener = nibabel.openers.Opener
    with opener(path) as file:
        head = file.read(4)
    return head in {(348).to_bytes(4, "little"), (348).to_bytes(4, "big")}


def _check_shape(path: Path, shape: tuple[int, ...], dtype: Any) -> None:
    if len(shape) != 3 or dtype.kind not in "biuf":
        raise InvalidInputError(f"{path}: expected a volume of numbers in 3 dimensions, got {dtype} {shape}")
    cells = int(np.prod(shape, dtype=object))
    if min(shape) < 1 or cells > MAX_CELLS:
        raise InvalidInputError(f"{path}: expected 1 to {MAX_CELLS} voxels, got {shape}")


def _unit(header: Any) -> float:
    """Return millimetres of a header's unit of length; one that is not said is taken for millimetres."""
    units = {"meter": 1000.0, "micron": 0.001}
    return units.get(header.get_xyzt_units()[0], 1.0) if hasattr(header, "get_xyzt_units") else 1.0


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split())[:160] or type(error).__name__


def nifti_bytes(workspace: GridWorkspace, *, compressed: bool) -> bytes:
    """Return a 3-D workspace as a NIfTI file of zeros and ones, with its voxel size."""
    nibabel = _nibabel()
    data = workspace.free.transpose(2, 0, 1)[::-1, ::-1, ::-1].astype(np.uint8)
    sides = workspace.spacing or (1.0, 1.0, 1.0)
    image = nibabel.Nifti1Image(data, np.diag([sides[2], sides[0], sides[1], 1.0]))
    image.header.set_xyzt_units("mm")
    plain: bytes = image.to_bytes()
    return gzip.compress(plain, mtime=0) if compressed else plain


def slices_of(folder: Path, suffixes: tuple[str, ...]) -> list[Path]:
    """Return the pictures in a folder, in the order of the numbers in their names.

    Raises
    ------
    InvalidInputError
        If there are none, or they are of several kinds.
    """
    files = [path for path in folder.iterdir() if path.is_file() and not path.name.startswith(".")]
    pictures = [path for path in files if path.suffix.lower() in suffixes]
    if not pictures:
        known = " ".join(suffixes)
        raise InvalidInputError(f"{folder}: expected a map file, got a folder without slices ({known})")
    kinds = sorted({path.suffix.lower() for path in pictures})
    if len(kinds) > 1:
        raise InvalidInputError(f"{folder}: expected slices of one kind, got {' and '.join(kinds)}")
    return sorted(pictures, key=lambda path: [int(part) if part.isdigit() else part for part in re.split("([0-9]+)", path.name)])
