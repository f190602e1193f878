"""Maps of any source: files, names of generated maps, arrays and workspaces; and the writing of
maps.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import as_path, check_array, check_file, check_integer, check_kind
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, errors_at
from shoal.core.files import atomic
from shoal.core.notices import tell_once
from shoal.swarm.maps import imaging
from shoal.swarm.maps.generators import generate_cached, is_spec
from shoal.swarm.maps.pages import LARGEST_FILE, PICTURES, scale_of_width
from shoal.swarm.maps.pictures import (
    encode_picture,
    read_picture,
    read_pixels,
    read_slices,
)
from shoal.swarm.maps.reading import (
    HIGH,
    KINDS,
    LOW,
    Cells,
    Kind,
    MapOptions,
    Mask,
    check_used,
    map_options,
)
from shoal.swarm.maps.resampling import (
    factors_of_width,
    join_diagonals,
    scale_cells,
    tell_of_contacts,
)
from shoal.swarm.maps.text import (
    encode_csv,
    encode_movingai,
    encode_npy,
    encode_rows,
    read_csv,
    read_matlab,
    read_movingai,
    read_npy,
    read_rows,
)
from shoal.swarm.maps.values import free_in_array
from shoal.swarm.maps.volumes import (
    DICOM,
    NIFTI,
    NRRD,
    dicom_files,
    encode_nifti,
    read_dicom,
    read_nifti,
    read_nrrd,
    read_series,
)
from shoal.swarm.maps.workspace import GridWorkspace


@dataclass(frozen=True)
class MapFormat:
    """A file format for maps.

    Parameters
    ----------
    read : callable
        Function that is called with (path, options), and returns the free cells and the size of a
        cell.
    encode : callable, optional
        Function that converts a workspace to the bytes of a map file. Without this function, Shoal
        only reads the format.
    dimensions : tuple of int
        Numbers of dimensions of the workspaces that the format can store: (2,), (3,) or (2, 3).
    sized : bool
        Whether a written file holds the size of a cell.
    kind : Kind
        The reading options that the reader uses. All other reading options are refused. By default,
        the reader uses none.
    """

    read: Callable[[Path, MapOptions], Cells]
    encode: Callable[[GridWorkspace], bytes] | None = None
    dimensions: tuple[int, ...] = (2,)
    kind: Kind = Kind("a file of this format")
    sized: bool = False


def _without_spacing(
    read: Callable[[Path, MapOptions], Mask],
) -> Callable[[Path, MapOptions], Cells]:
    return lambda path, options: (read(path, options), None)


def _picture_format(suffix: str) -> MapFormat:
    encode = None if suffix == ".gif" else partial(encode_picture, suffix=suffix)
    tiff = suffix.startswith(".tif")
    return MapFormat(read_picture, encode, (2, 3) if tiff else (2,), KINDS["picture"], sized=tiff)


FORMATS: dict[str, MapFormat] = {
    **{suffix: _picture_format(suffix) for suffix in PICTURES},
    ".txt": MapFormat(_without_spacing(read_rows), encode_rows, kind=KINDS["table"]),
    ".map": MapFormat(_without_spacing(read_movingai), encode_movingai, kind=KINDS["letters"]),
    ".csv": MapFormat(_without_spacing(read_csv), encode_csv, kind=KINDS["table"]),
    ".npy": MapFormat(_without_spacing(read_npy), encode_npy, (2, 3), KINDS["array"]),
    ".mat": MapFormat(_without_spacing(read_matlab), kind=KINDS["table"]),
    **{
        suffix: MapFormat(
            read_nifti, partial(encode_nifti, suffix=suffix), (3,), KINDS["volume"], sized=True
        )
        for suffix in NIFTI
    },
    **{suffix: MapFormat(read_nrrd, kind=KINDS["volume"]) for suffix in NRRD},
    **{suffix: MapFormat(read_dicom, kind=KINDS["volume"]) for suffix in DICOM},
}
"""All map formats, keyed by file suffix."""


def read_map(path: str | os.PathLike[str], **options: Any) -> GridWorkspace:
    """Read a workspace from a map file. The suffix of the file name determines the format.

    Parameters
    ----------
    path : path
        Path of a map file. In pictures (``.png .tif .tiff .bmp .jpg .jpeg .gif``), bright pixels
        are free cells. In text files (``.txt``), ``.`` is free and ``#`` is an obstacle, or the
        file is a table of numbers. In MovingAI files (``.map``), ``.``, ``G`` and ``S`` are free.
        In tables (``.csv``), 1 is free and 0 is an obstacle. In NumPy files (``.npy``, 2-D or 3-D),
        MATLAB files (``.mat``), NIfTI files (``.nii``, ``.nii.gz``, 3-D), NRRD files (``.nrrd``,
        ``.nhdr``) and DICOM files (``.dcm``), nonzero values are free. The workspace keeps the
        file's voxel size. A TIFF file of several pages is a 3-D map with one layer per page. A
        folder of pictures or of DICOM files is a 3-D map with one layer per file.
    **options
        Reading options. `shoal.swarm.maps.reading.MapOptions` explains them, and the table
        `shoal.swarm.maps.reading.KINDS` lists the options of each kind of file.

    Returns
    -------
    GridWorkspace
        A workspace whose name is the file name without the suffix.

    Raises
    ------
    InvalidInputError
        Raised if the file is missing, unreadable, damaged or too large, has a wrong format, or
        contains no free cell. The error message gives the location of the fault. InvalidInputError
        is also raised for an option without effect on the file.
    MissingExtraError
        Raised if the file needs a library that is not installed.
    """
    source, settings = as_path(path), map_options(options)
    suffix = _suffix(source)
    # unlike Path.is_dir, it accepts names of any length
    folder = bool(source.name) and os.path.isdir(source)
    if not folder and suffix not in FORMATS:
        raise InvalidInputError(
            f"{source}: expected a map file ({' '.join(FORMATS)}), got the suffix {suffix!r}"
        )
    try:
        if folder and (files := dicom_files(source)):
            check_used(KINDS["volume"], settings.given_values, where=str(source))
            free, spacing = read_series(source, files, settings)
        elif folder:
            check_used(KINDS["slices"], settings.given_values, where=str(source))
            free, spacing = read_slices(source, settings), None
        else:
            check_used(FORMATS[suffix].kind, settings.given_values, where=str(source))
            check_file(source, what="map", most=LARGEST_FILE)
            free, spacing = FORMATS[suffix].read(source, settings)
    except OSError as error:
        raise InvalidInputError(f"{source}: cannot be read: {error.strerror or error}") from None
    return name_workspace(
        source,
        join_diagonals(np.asarray(free) != 0) if settings.join_diagonals else free,
        spacing=spacing,
    )


def name_workspace(
    path: Path, free: NDArray[Any], *, spacing: tuple[float, ...] | None = None
) -> GridWorkspace:
    """Return a workspace whose name is the file name without the suffix. Error messages contain the
    file name.
    """
    stem = path.name[: len(path.name) - len(_suffix(path))]
    with errors_at(path):
        # undecodable bytes of a name become "?"
        return GridWorkspace(free, name=stem.encode("utf-8", "replace").decode(), spacing=spacing)


def keeps_spacing(path: str | os.PathLike[str]) -> bool:
    """Return whether a map file that `write_map` writes holds the size of a cell."""
    return FORMATS[_suffix(Path(path))].sized


def _suffix(path: Path) -> str:
    """Return the suffix of a file in lower case. For example, the file ``x.nii.gz`` has the suffix
    ``.nii.gz``.
    """
    return ".nii.gz" if path.name.lower().endswith(".nii.gz") else path.suffix.lower()


def write_map(workspace: GridWorkspace, path: str | os.PathLike[str]) -> None:
    """Write a workspace to a map file. The function `read_map` reads equal free cells from the
    file.

    Parameters
    ----------
    workspace : GridWorkspace
    path : path
        Path of the output file. The suffix of the file name determines the format, as in
        `read_map`.

    Raises
    ------
    InvalidInputError
        Raised if the suffix is unknown, or if the format does not support the number of dimensions
        of the workspace.
    MissingExtraError
        Raised if the file is a NIfTI file and the library nibabel is not installed.
    OutputError
        Raised if Shoal cannot write the file. A failed write leaves no partial file.
    """
    check_kind(workspace, GridWorkspace, what="workspace")
    target = as_path(path)
    suffix = _suffix(target)
    writers = {ending: form for ending, form in FORMATS.items() if form.encode is not None}
    if suffix not in writers:
        raise InvalidInputError(
            f"{target}: expected one of the suffixes {' '.join(writers)}, got {suffix!r}"
        )
    if workspace.ndim not in writers[suffix].dimensions:
        suffixes = [ending for ending, form in writers.items() if workspace.ndim in form.dimensions]
        raise InvalidInputError(
            f"{target}: expected {', '.join(suffixes)} for a {workspace.ndim}-D workspace, got"
            f" {suffix!r}"
        )
    encode = writers[suffix].encode
    assert encode is not None
    with atomic(target) as temporary:
        # Encode in memory first, because Pillow does not detect a partial write on a full disk.
        temporary.write_bytes(encode(workspace))


def open_map(
    place: str | os.PathLike[str] | GridWorkspace | ArrayLike,
    *,
    vessels: bool | None = None,
    width: int | None = None,
    low: float | None = None,
    high: float | None = None,
    bright: bool | None = None,
    thickest: float | None = None,
    **options: Any,
) -> GridWorkspace:
    """Open a workspace from a name, a file or an array.

    Parameters
    ----------
    place : str, path, GridWorkspace or array_like
        The name of a generated map (such as "vessels:5000"), the path of a map file, an array, or a
        workspace. The function returns a workspace unchanged. An array contains booleans or
        numbers, and has the shape (H, W) or (D, H, W). The command ``shoal maps`` lists the
        generated maps. The documentation of `shoal.swarm.maps.files.read_map` lists the file
        formats.
    vessels : bool
        Whether the file is a photograph whose vessels form the map; by default not. Finding vessels
        needs the extra ``shoal[imaging]``.
    width : int, optional
        Maximum number of cells along the larger side of the map of a photograph, a file or an
        array. A larger map is scaled down, and what was connected stays connected.
        `shoal.swarm.maps.resampling.scale_cells` states what a smaller map keeps.
    low, high, bright, thickest
        Options for finding vessels in a photograph. `shoal.swarm.maps.imaging.segment_vessels`
        explains the options.
    **options
        Options for reading a map file: threshold, invert, scale, level, label, channel, frame and
        join_diagonals. `shoal.swarm.maps.reading.MapOptions` explains the options for reading a map
        file. An option without effect on the map is refused, also at its default value; None stands
        for an option that is not given.

    Raises
    ------
    InvalidInputError, UnknownNameError, MissingExtraError
        Raised if the map does not exist, or if Shoal cannot read the map.

    Examples
    --------
    >>> open_map("line:7")
    <GridWorkspace 'line:7': 1x7, 7 free cells>
    >>> print(open_map(np.eye(2) == 0))
    #.
    .#
    """
    settings = map_options(options)  # checks all values, whatever the source of the map
    if width is not None:
        check_integer(width, what="width", least=1)
    of_vessels = {
        "vessels": vessels,
        "width": width,
        "low": low,
        "high": high,
        "bright": bright,
        "thickest": thickest,
    }
    values = {name: value for name, value in of_vessels.items() if value is not None} | dict(
        settings.given_values
    )
    if isinstance(place, GridWorkspace):
        check_used(KINDS["workspace"], values)
        return place
    if not isinstance(place, str | os.PathLike):
        check_used(KINDS["numbers"], values)
        array = check_array(place, expected="map: expected rows of booleans or numbers")
        if settings.by_number or settings.invert or settings.join_diagonals:
            if array.ndim not in (2, 3):
                raise InvalidInputError(
                    f"map: expected a 2-D or 3-D array of cells, got {array.ndim} dimensions"
                )
            array = free_in_array(array, settings, where="map")
        workspace = GridWorkspace(array)
        if settings.join_diagonals:
            workspace = GridWorkspace(join_diagonals(workspace.free))
        return fit_width(workspace, width)
    text = os.fspath(place)
    path = Path(text)
    # unlike Path.is_file, it accepts names of any length
    generated = is_spec(text) and not os.path.isfile(path)
    if generated or (not path.suffix and not os.path.exists(path)):
        check_used(Kind(f"the generated map {text!r}"), values)
        return GridWorkspace(generate_cached(text), name=text)
    if vessels:
        check_used(KINDS["photograph"], values, where=text)
        vessel_network = vessel_map(path, **values)
        tell_once(vessel_network.notice(str(path)))
        return name_workspace(path, vessel_network.free)
    is_picture = path.suffix.lower() in PICTURES and not os.path.isdir(path)
    # the reader of the file checks the other options
    beside = "width", *(["vessels"] if is_picture else [])
    check_used(
        Kind(
            "a file that is no picture" if "vessels" in values else "a map file",
            frozenset((*settings.given_values, *beside)),
        ),
        values,
        where=text,
    )
    if width is not None and (scale := scale_of_width(path, width, settings.scale)) is not None:
        options = options | {"scale": scale}
    workspace = fit_width(read_map(path, **options), width, where=str(path))
    tell_of_contacts(
        workspace.free,
        f"{path}:",
        "parts of the map, because particles cannot move diagonally (--join-diagonals opens one cell"
        " at each contact)",
    )
    return workspace


def fit_width(workspace: GridWorkspace, width: int | None, *, where: str = "map") -> GridWorkspace:
    """Return a workspace with at most ``width`` cells along its larger side, in which connected
    cells stay connected.

    The spacing grows with the cells. If ``width`` is None, or if the workspace is small enough,
    return the workspace unchanged. Notices name the map by ``where``.
    """
    if width is None:
        return workspace
    factors = factors_of_width(workspace.shape, width, workspace.spacing)
    free = scale_cells(workspace.free, factors, where=where)
    if free.shape == workspace.shape:
        return workspace
    spacing = workspace.spacing and tuple(
        size * before / after
        for size, before, after in zip(workspace.spacing, workspace.shape, free.shape, strict=True)
    )
    return GridWorkspace(free, name=workspace.name, spacing=spacing)


def vessel_map(
    path: str | os.PathLike[str],
    *,
    width: int | None = None,
    vessels: bool = True,
    bright: bool | None = None,
    thickest: float | None = None,
    channel: int | str | None = None,
    frame: int | None = None,
    **limits: float,
) -> imaging.VesselMap:
    """Return the map of the vessels in a photograph, which knows where it is in the photograph. The
    options are those of `open_map`.
    """
    assert vessels
    axes: dict[str, Any] = {"channel": channel, "frame": frame}
    mask = vessels_in(path, **limits, bright=bright, thickest=thickest, **axes).mask
    return imaging.VesselMap(mask, width=width)


def vessels_in(
    path: str | os.PathLike[str],
    *,
    low: float = LOW,
    high: float = HIGH,
    **options: Any,
) -> imaging.Vessels:
    """Return the vessels in a photograph. Reuse the last result if the file and the options have
    not changed.

    Parameters
    ----------
    path : path
        Path of the photograph, a picture file.
    low, high, **options
        Options of the function `shoal.swarm.maps.imaging.find_vessels`, including ``bright`` and
        ``thickest``, and the options ``channel`` and ``frame`` of
        `shoal.swarm.maps.pictures.read_pixels`.

    Raises
    ------
    InvalidInputError, MissingExtraError
        Raised if the file is not a picture, or if the picture shows no vessels.
    """
    return _vessels_in(Path(path), _stamp(path), low, high, tuple(sorted(options.items())))


def finder_of(
    path: str | os.PathLike[str],
    *,
    bright: bool | None = None,
    thickest: float | None = None,
    channel: int | str | None = None,
    frame: int | None = None,
) -> imaging.VesselFinder:
    """Return the vessel finder of a photograph. Reuse the last finder if the file and the options
    have not changed.

    Raises
    ------
    InvalidInputError, MissingExtraError
        Raised if the file is not a picture.
    """
    options = {"bright": bright, "channel": channel, "frame": frame, "thickest": thickest}
    return _finder_of(Path(path), _stamp(path), tuple(sorted(options.items())))


def _stamp(path: str | os.PathLike[str]) -> int:
    return os.stat(path).st_mtime_ns if os.path.isfile(path) else 0


@lru_cache(maxsize=1)
def _vessels_in(
    path: Path, stamp: int, low: float, high: float, options: tuple[tuple[str, Any], ...]
) -> imaging.Vessels:
    finder = _finder_of(path, stamp, options)
    with errors_at(path):
        return finder.find(low=low, high=high)


@lru_cache(maxsize=1)
def _finder_of(
    path: Path, _stamp: int, options: tuple[tuple[str, Any], ...]
) -> imaging.VesselFinder:
    settings = dict(options)
    pixels = read_pixels(
        path, channel=settings.pop("channel", None), frame=settings.pop("frame", None)
    )
    with errors_at(path):
        return imaging.VesselFinder(pixels, **settings)
