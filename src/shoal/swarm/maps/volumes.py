"""Maps from volumes: NIfTI files (by nibabel), NRRD files (by pynrrd), and DICOM files and series
(by pydicom).
"""

from __future__ import annotations

import bz2
import gzip
import io
import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from math import isfinite, prod
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_file, shortened
from shoal.core.errors import InvalidInputError, import_extra
from shoal.core.notices import tell_once
from shoal.swarm.maps.reading import (
    LARGEST_DATA,
    MAX_LAYERS,
    PIECE,
    AxisChoices,
    Cells,
    MapOptions,
    Mask,
    check_data,
    check_layers,
    check_size,
    index_of,
    millimetres,
    reading,
)
from shoal.swarm.maps.values import free_by_number, free_in_array
from shoal.swarm.maps.workspace import GridWorkspace

NIFTI = (".nii", ".nii.gz")
NRRD = (".nrrd", ".nhdr")
DICOM = (".dcm",)
DICOM_COLOURS = ["red", "green", "blue"]
NRRD_NUMBERS = {
    "signed char": "i1",
    "int8": "i1",
    "uchar": "u1",
    "unsigned char": "u1",
    "uint8": "u1",
    "short": "i2",
    "short int": "i2",
    "signed short": "i2",
    "signed short int": "i2",
    "int16": "i2",
    "ushort": "u2",
    "unsigned short": "u2",
    "unsigned short int": "u2",
    "uint16": "u2",
    "int": "i4",
    "signed int": "i4",
    "int32": "i4",
    "uint": "u4",
    "unsigned int": "u4",
    "uint32": "u4",
    "longlong": "i8",
    "long long": "i8",
    "long long int": "i8",
    "signed long long": "i8",
    "signed long long int": "i8",
    "int64": "i8",
    "ulonglong": "u8",
    "unsigned long long": "u8",
    "unsigned long long int": "u8",
    "uint64": "u8",
    "float": "f4",
    "double": "f8",
}
"""Names of the types of numbers in a NRRD header, and NumPy's names of the types."""

CHUNK = 1 << 20  # bytes
OBLIQUE = 5.0
"""Angle in degrees from which a difference of the axes of a volume and the body is told."""


# NIfTI


def read_nifti(path: Path, options: MapOptions) -> Cells:
    """Return the free cells (layers, rows, columns) of a NIfTI file, and the voxel size along each
    axis in millimetres.

    The function uses the file's header to rotate the volume into the view of a person in front of
    the body. Layer 0 is at the front of the body, and row 0 is at the head. The columns run from
    the body's right side to its left side. The option ``frame`` chooses a point in time of the
    fourth axis, and ``channel`` an entry of the fifth axis, or of the colours of a voxel.

    Raises
    ------
    InvalidInputError
        Raised if the file is damaged or truncated, or if the volume has too many voxels, contains
        infinite values, or has a time axis or channels of which none is chosen.
    MissingExtraError
    """
    nibabel = import_extra("nibabel", "NIfTI volumes need nibabel", extra="volumes")
    with _silent(nibabel.imageglobals.logger), reading(path, "a NIfTI volume"):
        image = _nifti_kind(path, nibabel).from_filename(path)
        shape = tuple(int(side) for side in image.shape)
        while len(shape) > 3 and shape[-1] == 1:
            shape = shape[:-1]
        dtype = image.get_data_dtype()
        colours = list(dtype.names or [])
        number = dtype[0] if colours else dtype
        if len(shape) not in (3, 4, 5) or number.kind not in "biuf" or min(shape) < 1:
            raise InvalidInputError(
                f"{path}: expected a volume of numbers in 3 dimensions, got {dtype} {shape}"
            )
        check_size(path, *shape[:3])
        size = prod(shape[:3]) * dtype.itemsize
        total = prod(shape) * dtype.itemsize
        check_data(path, total if path.name.lower().endswith(".gz") else size)
        times, channels = (*shape[3:], 1, 1)[:2]
        choices = AxisChoices(path, options)
        time = choices.index("frame", [""] * times)
        # the colours of a voxel are channels, too
        channel = 0 if colours and channels == 1 else choices.index("channel", [""] * channels)
        skipped = size * (time + times * channel)
        colour = index_of(colours, options.channel, where=str(path)) if colours else None
        slope, shift = (
            1.0 if factor is None else float(factor)
            for factor in (image.dataobj.slope, image.dataobj.inter)
        )
        begin = int(image.dataobj.offset)

        def pieces() -> Iterator[NDArray[Any]]:
            for values in _stream(path, begin, skipped, size, total, dtype):
                numbers = values if colour is None else values[colours[colour]]
                yield numbers if (slope, shift) == (1.0, 0.0) else numbers * slope + shift

        free = np.concatenate(free_by_number(pieces, options, where=str(path))).reshape(
            shape[:3], order="F"
        )
        # in a header without a unit, lengths count as millimetres
        unit = millimetres(image.header.get_xyzt_units()[0]) or 1.0
        sides = tuple(float(side) * unit for side in image.header.get_zooms()[:3])
        if not np.isfinite(image.affine).all():
            raise ValueError("the place of the volume in space is not finite")
        oriented, sides = in_front_of_body(free, sides, image.affine[:3, :3], where=path)
    return oriented, _check_sides(path, sides)


def in_front_of_body(
    free: Mask, sides: tuple[float, ...], directions: NDArray[Any], *, where: Path
) -> tuple[Mask, tuple[float, ...]]:
    """Turn a volume into the view of a person in front of the body.

    Parameters
    ----------
    free : ndarray of bool, shape (i, j, k)
    sides : tuple of float
        Size of a voxel along each axis.
    directions : ndarray, shape (3, 3)
        For each axis of the volume, a column with its direction in space: to the left, to the back
        and to the head of the body are -1, -1 and 1 (RAS, as in NIfTI).
    where : Path
        The file or folder, in a warning about axes that are oblique to those of the body.

    Returns
    -------
    ndarray of bool, shape (layers, rows, columns)
        Layer 0 is at the front, row 0 at the head, and column 0 at the right side of the body.
    tuple of float
        Size of a voxel along each axis of the returned array.
    """
    # Each axis of space belongs to the axis of the volume that is nearest to it, strongest pair
    # first, as in nibabel.
    strength = np.abs(directions / np.maximum(np.linalg.norm(directions, axis=0), 1e-30))
    axis_of: dict[int, int] = {}
    angle = 0.0
    for _ in range(3):
        space, axis = (int(i) for i in np.unravel_index(np.argmax(strength), strength.shape))
        axis_of[space] = axis
        angle = max(angle, float(np.degrees(np.arccos(min(1.0, max(0.0, strength[space, axis]))))))
        strength[space, :] = strength[:, axis] = -1
    if angle > OBLIQUE:
        tell_once(
            f"shoal: warning: {where}: the axes of the volume differ from those of the body by up"
            f" to {angle:.0f} degrees; the map keeps the axes of the volume"
        )
    order = [axis_of[1], axis_of[2], axis_of[0]]  # front to back, head to foot, right to left
    oriented = free.transpose(order)
    # The view is towards the back: layers, rows and columns run against the axes of space (front,
    # head, right).
    steps = tuple(
        slice(None, None, -1 if directions[space, axis_of[space]] >= 0 else 1)
        for space in (1, 2, 0)
    )
    return np.ascontiguousarray(oriented[steps]), tuple(sides[axis] for axis in order)


def encode_nifti(workspace: GridWorkspace, suffix: str) -> bytes:
    """Return a map as the bytes of a NIfTI file, with 1 for each free cell, 0 for each obstacle,
    and the voxel size.
    """
    nibabel = import_extra("nibabel", "NIfTI volumes need nibabel", extra="volumes")
    data = workspace.free.transpose(2, 0, 1)[::-1, ::-1, ::-1].astype(np.uint8)
    sides = workspace.spacing or (1.0, 1.0, 1.0)
    image = nibabel.Nifti1Image(data, np.diag([sides[2], sides[0], sides[1], 1.0]))
    image.header.set_xyzt_units("mm")
    plain: bytes = image.to_bytes()
    return gzip.compress(plain, mtime=0) if suffix.endswith(".gz") else plain


def _nifti_kind(path: Path, nibabel: Any) -> Any:
    """Return the NIfTI image class that matches the first bytes of the file, so that nibabel tries
    no other format.
    """
    with nibabel.openers.Opener(path) as file:
        begin = file.read(4)
    for length, kind in ((348, nibabel.Nifti1Image), (540, nibabel.Nifti2Image)):
        if begin in {length.to_bytes(4, "little"), length.to_bytes(4, "big")}:
            return kind
    raise InvalidInputError(
        f"{path}: expected a NIfTI volume, got a damaged, truncated or other file (it begins with"
        f" {begin!r})"
    )


def _stream(
    path: Path, begin: int, skipped: int, size: int, total: int, dtype: np.dtype[Any]
) -> Iterator[NDArray[Any]]:
    """Return the numbers of a volume piece by piece, and read a compressed file to its end, which
    verifies its checksum.

    Parameters
    ----------
    begin, skipped, size, total : int
        Bytes before the data, bytes of other volumes before the volume, bytes of the volume, and
        bytes of all data.
    """
    packed = path.name.lower().endswith(".gz")
    with gzip.open(path) if packed else path.open("rb") as file:
        offset = begin + skipped
        if packed:  # seeking in a compressed file would unfold it without a limit
            while offset and (piece := file.read(min(offset, CHUNK))):
                offset -= len(piece)
        else:
            file.seek(offset)
        for first in range(0, size, PIECE * dtype.itemsize):
            length = min(PIECE * dtype.itemsize, size - first)
            piece = file.read(length)
            if len(piece) < length:
                raise ValueError(f"expected {size} bytes of data, got {first + len(piece)}")
            yield np.frombuffer(piece, dtype=dtype)
        if packed:
            more, most = skipped + size, total + CHUNK
            while piece := file.read(CHUNK):
                more += len(piece)
                if more > most:
                    raise InvalidInputError(
                        f"{path}: expected {begin + total} bytes of a volume according to the"
                        " header, got more"
                    )


# NRRD


def read_nrrd(path: Path, options: MapOptions) -> Cells:
    """Return the free cells of a NRRD file, in two or three dimensions, and the size of a cell in
    millimetres, if the file has it.

    A volume whose header names the space of a body is turned as a NIfTI volume. Any other volume
    keeps the order of its axes: the first axis of the header, which changes fastest, counts the
    columns. An axis of the kind ``vector`` or ``RGB-color`` has channels, and an axis of the kind
    ``time`` or ``list`` has points in time.

    Raises
    ------
    InvalidInputError
        Raised if the file is damaged or truncated, or if its data are in several files or in an
        unknown encoding.
    MissingExtraError
    """
    nrrd = import_extra("nrrd", "NRRD volumes need pynrrd", extra="volumes")
    with reading(path, "a NRRD file"):
        with path.open("rb") as file:
            # a header ends at an empty line, and other files may have lines without end
            start = io.BytesIO(file.read(CHUNK))
        header = nrrd.read_header(start)
        begin = start.tell()
        sides = [int(side) for side in header["sizes"]]
        if len(sides) != header.get("dimension"):
            raise ValueError(f"expected {header.get('dimension')} sizes, got {len(sides)}")
        kinds = [str(kind).lower() for kind in header.get("kinds", [])] or ["domain"] * len(sides)
        domain: list[int] = []
        selection: dict[int, int] = {}
        choices = AxisChoices(path, options)
        for axis, (side, kind) in enumerate(zip(sides, kinds, strict=True)):
            if kind in {"domain", "space", "none", "???"}:
                domain.append(axis)
                continue
            name = "frame" if kind in {"time", "list"} else "channel"
            selection[axis] = choices.index(name, [""] * side)
        choices.check_used()
        if len(domain) not in (2, 3) or min(sides, default=0) < 1:
            raise InvalidInputError(
                f"{path}: expected a picture or a volume in 2 or 3 dimensions, got {len(domain)}"
                f" {sides}"
            )
        check_size(path, *(sides[axis] for axis in domain))
        data = _nrrd_data(path, header, begin, prod(sides)).reshape(sides, order="F")
        data = data[tuple(selection.get(axis, slice(None)) for axis in range(len(sides)))]
        free = free_in_array(data.T, options, where=str(path)).T
        lengths, directions = _nrrd_space(header, domain)
        if directions is not None and len(domain) == 3:
            assert lengths is not None
            oriented, lengths = in_front_of_body(free, lengths, directions, where=path)
        else:
            oriented, lengths = np.ascontiguousarray(free.T), lengths and lengths[::-1]
    return oriented, lengths and _check_sides(path, lengths)


def _nrrd_data(path: Path, header: Any, begin: int, count: int) -> NDArray[Any]:
    """Return the numbers of a NRRD file in the order of the file. The size is checked before
    anything is unfolded.
    """
    kind = NRRD_NUMBERS.get(str(header["type"]).lower().replace("_t", ""))
    if kind is None:
        raise InvalidInputError(
            f"{path}: expected numbers, got the type {str(header['type'])[:40]!r}"
        )
    if np.dtype(kind).itemsize > 1 and header.get("endian", "little") not in {"little", "big"}:
        raise InvalidInputError(
            f"{path}: endian: expected little or big, got {str(header['endian'])[:20]!r}"
        )
    dtype = np.dtype(kind).newbyteorder("big" if header.get("endian") == "big" else "little")
    size = count * dtype.itemsize
    check_data(path, size)
    source = path
    if detached := header.get("data file", header.get("datafile")):
        if (
            not isinstance(detached, str)
            or detached.startswith("LIST")
            or (" " in detached and "%" in detached)
        ):
            raise InvalidInputError(
                f"{path}: expected one file of data, got {str(detached)[:40]!r}"
            )
        if Path(detached).is_absolute() or ".." in Path(detached).parts:
            raise InvalidInputError(
                f"{path}: expected a file of data in the folder of the header, got"
                f" {detached[:40]!r}"
            )
        source, begin = path.parent / detached, 0
        check_file(source, what="data file", most=LARGEST_DATA)
    skip_lines, skip_bytes = (
        int(header.get(f"{unit} skip", header.get(f"{unit}skip", 0))) for unit in ("line", "byte")
    )
    encoding = str(header.get("encoding", "raw")).lower()
    openers: dict[str, Callable[[BinaryIO], Any]] = {
        "raw": lambda file: file,
        **dict.fromkeys(("gzip", "gz"), lambda file: gzip.GzipFile(fileobj=file)),
        **dict.fromkeys(("bzip2", "bz2"), bz2.BZ2File),
    }
    with source.open("rb") as file:
        file.seek(begin)
        for _ in range(skip_lines):
            if not file.readline(CHUNK):
                raise ValueError(f"expected {skip_lines} lines before the data, got fewer")
        if encoding in {"ascii", "text", "txt"}:
            words = file.read(64 * count + CHUNK).split()
            numbers = np.array(words[:count], dtype=np.float64)
            if len(words) != count:
                raise ValueError(f"expected {count} numbers, got {len(words)}")
            return numbers if dtype.kind == "f" else numbers.astype(dtype)
        if encoding not in openers:
            raise InvalidInputError(
                f"{path}: expected the encoding raw, gzip, bzip2 or ascii, got {encoding[:20]!r}"
            )
        opened = openers[encoding](file)
        if skip_bytes == -1 and encoding == "raw":
            file.seek(-size, 2)
        elif skip_bytes > 0:
            opened.read(min(skip_bytes, LARGEST_DATA))
        content = opened.read(size)
        if len(content) < size:
            raise ValueError(f"expected {size} bytes of data, got {len(content)}")
        return np.frombuffer(content, dtype=dtype)


def _nrrd_space(
    header: Any, domain: list[int]
) -> tuple[tuple[float, ...] | None, NDArray[Any] | None]:
    """Return the size of a cell along each axis of the header in millimetres, and the directions of
    the axes in space (RAS).
    """
    units = header.get("space units", header.get("units"))
    factor = (
        (millimetres(str(units[0]).strip('"')) or 1.0) if units is not None and len(units) else 1.0
    )
    header_vectors = header.get("space directions")
    if header_vectors is None:
        spacings = header.get("spacings")
        if spacings is None:
            return None, None
        lengths = tuple(abs(float(spacings[axis])) * factor for axis in domain)
        return (
            lengths if all(isfinite(length) and length > 0 for length in lengths) else None
        ), None
    vectors = np.array([np.asarray(header_vectors[axis], dtype=np.float64) for axis in domain])
    if not np.isfinite(vectors).all():
        raise ValueError("a direction of an axis is not finite")
    lengths = tuple(float(np.linalg.norm(vector)) * factor for vector in vectors)
    space = str(header.get("space", "")).lower()
    words = {
        "left": (0, -1),
        "right": (0, 1),
        "posterior": (1, -1),
        "anterior": (1, 1),
        "superior": (2, 1),
        "inferior": (2, -1),
    }
    short = {
        "lps": "left-posterior-superior",
        "ras": "right-anterior-superior",
        "las": "left-anterior-superior",
    }
    names = short.get(space, space).split("-")[:3]
    if len(names) != 3 or any(name not in words for name in names) or vectors.shape != (3, 3):
        return lengths, None
    directions = np.zeros((3, 3))
    for row, name in enumerate(names):
        place, sign = words[name]
        directions[place] = sign * vectors[:, row]
    return lengths, directions


# DICOM


def is_dicom(path: Path) -> bool:
    """Return whether a file begins as a DICOM file: 128 bytes of any content, and the
    letters DICM.
    """
    try:
        with path.open("rb") as file:
            return file.read(132)[128:] == b"DICM"
    except OSError:
        return False


def read_dicom(path: Path, options: MapOptions) -> Cells:
    """Return the free cells of one DICOM file, and the size of a cell. A file of one image is a map
    in two dimensions.
    """
    pydicom = import_extra("pydicom", "DICOM files need pydicom", extra="volumes")
    with _silent(logging.getLogger("pydicom")), reading(path, "a DICOM file"):
        header = _dicom_header(path, pydicom)
        return _dicom_cells(path, [path], [header], pydicom, options)


def dicom_files(folder: Path) -> list[Path]:
    """Return the DICOM files of a folder: the files with the suffix ``.dcm``, and files without a
    suffix that begin as DICOM.
    """
    entries = (
        path
        for path in folder.iterdir()
        if path.name[0] != "." and path.name.upper() != "DICOMDIR" and not path.is_dir()
    )
    files = [
        path
        for path in islice(entries, 4 * MAX_LAYERS)
        # names in DICOM folders are unique identifiers, of digits with dots
        if path.suffix.lower() in DICOM
        or ((not path.suffix or path.suffix[1:].isdigit()) and is_dicom(path))
    ]
    check_layers(folder, len(files))
    return sorted(files)


def read_series(folder: Path, files: list[Path], options: MapOptions) -> Cells:
    """Return the free cells of a DICOM series, one image a layer, in the order of the places of the
    images in space.

    Raises
    ------
    InvalidInputError
        Raised if the files belong to several series, or if their sizes or distances differ.
    MissingExtraError
    """
    pydicom = import_extra("pydicom", "DICOM files need pydicom", extra="volumes")
    with _silent(logging.getLogger("pydicom")), reading(folder, "a DICOM series"):
        heads = []
        for file in files:
            check_file(file, what="slice", most=LARGEST_DATA)
            heads.append(_dicom_header(file, pydicom))
        series = list(dict.fromkeys(str(head.get("SeriesInstanceUID", "")) for head in heads))
        if len(series) > 1:
            counts = ", ".join(
                f"{sum(str(head.get('SeriesInstanceUID', '')) == uid for head in heads)} of"
                f" {uid if len(uid) < 16 else f'…{uid[-12:]}'}"  # the part that differs
                for uid in series[:4]
            )
            raise InvalidInputError(
                f"{folder}: expected one series, got {len(series)} ({counts}); give each series a"
                " folder"
            )
        return _dicom_cells(folder, files, heads, pydicom, options)


def _dicom_header(path: Path, pydicom: Any) -> Any:
    if not is_dicom(path):
        with path.open("rb") as file:
            raise InvalidInputError(
                f"{path}: expected a DICOM file, got a damaged or other file (it begins with"
                f" {file.read(8)!r})"
            )
    header = pydicom.dcmread(path, stop_before_pixels=True)
    if "Rows" not in header or "Columns" not in header:
        raise InvalidInputError(
            f"{path}: expected a DICOM image, got a DICOM file without rows and columns of pixels"
        )
    return header


def _dicom_cells(
    where: Path, files: list[Path], heads: list[Any], pydicom: Any, options: MapOptions
) -> Cells:
    """Return the free cells of images with equal sizes, and the size of a cell."""
    first = heads[0]
    rows, columns = int(first.Rows), int(first.Columns)
    samples = int(first.get("SamplesPerPixel", 1))
    if samples not in (1, len(DICOM_COLOURS)):
        raise InvalidInputError(
            f"{files[0]}: expected 1 or 3 numbers for each pixel, got {samples}"
        )
    for file, head in zip(files, heads, strict=True):
        if (int(head.Rows), int(head.Columns)) != (rows, columns):
            raise InvalidInputError(
                f"{file}: expected {columns}x{rows} pixels as in the first slice, got"
                f" {head.Columns}x{head.Rows}"
            )
        if int(head.get("SamplesPerPixel", 1)) != samples:
            raise InvalidInputError(
                f"{file}: expected {samples} numbers for each pixel as in the first slice, got"
                f" {head.SamplesPerPixel}"
            )
    frames = [int(head.get("NumberOfFrames", 1) or 1) for head in heads]
    if len(files) > 1 and max(frames) > 1:
        raise InvalidInputError(
            f"{where}: expected one image in each file, got a file of {max(frames)} images"
        )
    check_layers(where, len(files) * frames[0])
    check_size(where, len(files) * frames[0], rows, columns)
    check_data(
        where,
        frames[0] * rows * columns * samples * (int(first.get("BitsAllocated", 16)) // 8 or 1),
    )
    # The images of a film, such as ultrasound, have times; the images of a volume do not.
    film = frames[0] > 1 and any(
        name in first for name in ("FrameTime", "FrameTimeVector", "CineRate")
    )
    choices = AxisChoices(where, options)
    moment = choices.index("frame", [""] * frames[0]) if film else None
    colour = choices.index("channel", DICOM_COLOURS) if samples > 1 else None
    choices.check_used()
    order, distance, directions = _dicom_order(where, files, heads)

    def pieces() -> Iterator[NDArray[Any]]:
        for index in order:
            image = pydicom.dcmread(files[index])
            pixels = _dicom_pixels(files[index], image)
            pixels = pixels if colour is None else pixels[..., colour]
            scales = _dicom_scales(files[index], image, frames[0])
            if moment is not None:
                pixels, scales = pixels[moment], scales[moment : moment + 1]
            if (scales != (1.0, 0.0)).any():
                slope, shift = scales[0] if len(scales) == 1 else scales.T[:, :, None, None]
                pixels = pixels * slope + shift
            yield pixels

    within = _dicom_pixel(first)
    for file, head in zip(files, heads, strict=True):
        if within and (other := _dicom_pixel(head)) and not np.allclose(other, within, rtol=1e-3):
            raise InvalidInputError(
                f"{file}: expected pixels of {within[0]:g}x{within[1]:g} mm as in the first slice,"
                f" got {other[0]:g}x{other[1]:g} mm"
            )
    layers = free_by_number(pieces, options, where=str(where))
    free = layers[0] if len(layers) == 1 else np.stack(layers)
    sides: tuple[float, ...] | None = within
    if free.ndim == 3:
        sides = None if within is None or distance is None else (distance, *within)
    if directions is not None and free.ndim == 3:
        free, oriented = in_front_of_body(free, sides or (1.0, 1.0, 1.0), directions, where=where)
        sides = sides and oriented  # without a size of pixels, the map has none
    return free, sides and _check_sides(where, sides)


def _dicom_pixel(head: Any) -> tuple[float, float] | None:
    """Return the height and width of a pixel, in millimetres."""
    spacing = head.get("PixelSpacing") or head.get("ImagerPixelSpacing")
    return None if spacing is None else (float(spacing[0]), float(spacing[1]))


def _dicom_scales(path: Path, image: Any, frames: int) -> NDArray[np.float64]:
    """Return the slope and the intercept of the numbers of each image in a DICOM file, shape
    (frames, 2). A file of several images has them for each image, or once for all.
    """
    if "ModalityLUTSequence" in image:
        raise InvalidInputError(
            f"{path}: expected numbers with a slope and an intercept, got a table of their meanings"
            " (ModalityLUTSequence)"
        )
    shared, own = (
        image.get(f"{name}FunctionalGroupsSequence") or [] for name in ("Shared", "PerFrame")
    )
    scales = np.empty((frames, 2))
    for number in range(frames):
        groups = [*own[number : number + 1], *shared[:1]]
        said = [
            found
            for group in groups
            for found in group.get("PixelValueTransformationSequence") or []
        ]
        one = said[0] if said else image
        scales[number] = one.get("RescaleSlope", 1) or 1, one.get("RescaleIntercept", 0) or 0
    if not np.isfinite(scales).all():
        raise InvalidInputError(
            f"{path}: expected a finite slope and intercept of numbers, got"
            f" {shortened(scales[~np.isfinite(scales).all(axis=1)][0].tolist())}"
        )
    return scales


def _dicom_pixels(path: Path, image: Any) -> NDArray[Any]:
    """Return the pixels of a DICOM image, of which pydicom turns luminance and chrominance into
    red, green and blue.

    For a compression that pydicom cannot unfold here, the error says which one it is.
    """
    syntax = image.file_meta.TransferSyntaxUID
    try:
        return np.asarray(image.pixel_array)
    except (RuntimeError, NotImplementedError) as error:
        if not syntax.is_compressed:
            raise
        raise InvalidInputError(
            f"{path}: expected DICOM pixels without compression, got {syntax.name}, which needs"
            " another library of pydicom (pip install 'pydicom[pixeldata]'):"
            f" {' '.join(str(error).split())[:80]}"
        ) from None


def _dicom_order(
    where: Path, files: list[Path], heads: list[Any]
) -> tuple[list[int], float | None, NDArray[Any] | None]:
    """Return the order of the images, their distance in millimetres, and the directions of layers,
    rows and columns (RAS).
    """
    thick = heads[0].get("SpacingBetweenSlices") or heads[0].get("SliceThickness")
    thickness = None if thick is None else float(thick)
    if len(heads) == 1:
        return [0], thickness, None
    turns = [head.get("ImageOrientationPatient") for head in heads]
    places = [head.get("ImagePositionPatient") for head in heads]
    if any(value is None for value in (*turns, *places)):
        if any(head.get("InstanceNumber") is None for head in heads):
            raise InvalidInputError(
                f"{where}: expected the place or the number of each image, got images without them"
            )
        order = sorted(range(len(heads)), key=lambda index: int(heads[index].InstanceNumber))
        return order, thickness, None
    axes = np.array(turns, dtype=np.float64)
    if not np.allclose(axes, axes[0], atol=1e-3):
        raise InvalidInputError(
            f"{where}: expected parallel images, got images in several directions (a localizer is"
            " no slice)"
        )
    along_row, along_column = axes[0, :3], axes[0, 3:]
    normal = np.cross(along_row, along_column)
    depth = np.array(places, dtype=np.float64) @ normal
    order = [int(index) for index in np.argsort(depth, kind="stable")]
    steps = np.diff(depth[order])
    if (steps < 1e-4).any():
        k = int(np.argmin(steps))
        raise InvalidInputError(
            f"{where}: expected one image at each place, got {files[order[k]].name} and"
            f" {files[order[k + 1]].name} at the same place (several points in time need a folder"
            " each)"
        )
    distance = float(np.median(steps))
    if (np.abs(steps - distance) > 0.1 * distance).any():
        tell_once(
            f"shoal: warning: {where}: the distances of the images differ from {steps.min():.4g} to"
            f" {steps.max():.4g} mm; the map counts each as {distance:.4g} mm (is an image"
            " missing?)"
        )
    pixel = _dicom_pixel(heads[0])
    corners = np.array(places, dtype=np.float64) @ np.column_stack([along_column, along_row])
    shift = np.ptp(corners, axis=0)
    if pixel is not None and (shift > 0.5 * np.array(pixel)).any():
        tell_once(
            f"shoal: warning: {where}: the images are shifted against each other by up to"
            f" {shift.max():.4g} mm; the map stacks them straight (was the gantry tilted?)"
        )
    # DICOM's axes run to the left, the back and the head of the body; those of RAS to the right,
    # the front and the head.
    to_ras = np.array([[-1.0], [-1.0], [1.0]])
    return order, distance, to_ras * np.column_stack([normal, along_column, along_row])


# What all volumes share


@contextmanager
def _silent(logger: logging.Logger) -> Iterator[None]:
    """Suppress a library's log messages inside the ``with`` block, because Shoal's own error
    message repeats them.
    """
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)


def _check_sides(path: Path, sides: tuple[float, ...]) -> tuple[float, ...]:
    if not all(isfinite(side) and side > 0 for side in sides):
        raise InvalidInputError(f"{path}: expected voxels with sides above 0, got {sides}")
    return sides
