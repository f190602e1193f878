"""Opening of maps from any source: a file, the name of a generated map, an array or a workspace."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from shoal.core import notices
from shoal.core.checks import check_integer
from shoal.core.errors import errors_at
from shoal.core.notices import tell_once
from shoal.swarm.maps import imaging
from shoal.swarm.maps.arrays import free_in_array
from shoal.swarm.maps.files import named_after, read_map
from shoal.swarm.maps.generators import generate_cached, is_spec
from shoal.swarm.maps.parts import MOST_COUNTED
from shoal.swarm.maps.pictures import PICTURES, read_pixels, scale_of_width
from shoal.swarm.maps.reading import KINDS, Kind, MapOptions, check_used
from shoal.swarm.maps.resampling import diagonal_contacts, factors_of_width, join_diagonals, scale_cells
from shoal.swarm.maps.workspace import GridWorkspace


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
        The name of a generated map (such as "vessels:5000"), the path of a map file, an array, or a workspace. The function returns
        a workspace unchanged. An array contains booleans or numbers, and has the shape (H, W) or (D, H, W). The command
        ``shoal maps`` lists the generated maps. The documentation of `shoal.swarm.maps.files.read_map` lists the file formats.
    vessels : bool
        Whether the file is a photograph whose vessels form the map; by default not. Finding vessels needs the extra
        ``shoal[imaging]``.
    width : int, optional
        Maximum number of cells along the larger side of the map of a photograph, a file or an array. A larger map is scaled
        down, and what was connected stays connected. `shoal.swarm.maps.resampling.scale_cells` states what a smaller map keeps.
    low, high, bright, thickest
        Options for finding vessels in a photograph. `shoal.swarm.maps.imaging.segment_vessels` explains the options.
    **options
        Options for reading a map file: threshold, invert, scale, level, label, channel, frame and join_diagonals.
        `shoal.swarm.maps.reading.MapOptions` explains the options for reading a map file. An option without effect on the map is
        refused, also at its default value; None stands for an option that is not given.

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
    chosen = MapOptions(**options)  # checks all values, whatever the source of the map
    if width is not None:
        check_integer(width, what="width", least=1)
    of_vessels = {"vessels": vessels, "width": width, "low": low, "high": high, "bright": bright, "thickest": thickest}
    given = {name: value for name, value in of_vessels.items() if value is not None} | dict(chosen.given)
    if isinstance(place, GridWorkspace):
        check_used(KINDS["workspace"], given)
        return place
    if not isinstance(place, str | os.PathLike):
        check_used(KINDS["numbers"], given)
        array = np.asarray(place)
        decided = chosen.by_number or chosen.invert or chosen.join_diagonals
        workspace = GridWorkspace(free_in_array(array, chosen, where="map") if decided else array)
        if chosen.join_diagonals:
            workspace = GridWorkspace(join_diagonals(workspace.free))
        return fit_width(workspace, width)
    text = os.fspath(place)
    path = Path(text)
    named = is_spec(text) and not os.path.isfile(path)  # unlike Path.is_file, it accepts names of any length
    if named or (not path.suffix and not os.path.exists(path)):
        check_used(Kind(f"the generated map {text!r}"), given)
        return GridWorkspace(generate_cached(text), name=text)
    if vessels:
        check_used(KINDS["photograph"], given, where=text)
        limits = {name: given[name] for name in ("low", "high") if name in given}
        mask = vessels_in(path, **limits, bright=bright, thickest=thickest, **_axes(chosen)).mask
        tell_once(imaging.dropped_text(str(path), mask))
        return named_after(path, imaging.map_of_vessels(mask, width=width))
    is_picture = path.suffix.lower() in PICTURES and not os.path.isdir(path)
    beside = ("width", *(["vessels"] if is_picture else []))  # the reader of the file checks the other options
    check_used(
        Kind("a file that is no picture" if "vessels" in given else "a map file", frozenset((*chosen.given, *beside))),
        given,
        where=text,
    )
    if width is not None and (scale := scale_of_width(path, width, chosen.scale)) is not None:
        options = options | {"scale": scale}
    workspace = fit_width(read_map(path, **options), width, where=str(path))
    counted = notices.listeners and workspace.free.size <= MOST_COUNTED
    if counted and (contacts := diagonal_contacts(workspace.free)):
        separate = "1 diagonal contact separates" if contacts == 1 else f"{contacts} diagonal contacts separate"
        tell_once(
            f"shoal: warning: {path}: {separate} parts of the map, because particles cannot move diagonally "
            "(--join-diagonals opens one cell at each contact)"
        )
    return workspace


def fit_width(workspace: GridWorkspace, width: int | None, *, where: str = "map") -> GridWorkspace:
    """Return a workspace with at most ``width`` cells along its larger side, in which connected cells stay connected.

    The spacing grows with the cells. If ``width`` is None, or if the workspace is small enough, return the workspace unchanged.
    Notices name the map by ``where``.
    """
    if width is None:
        return workspace
    factors = factors_of_width(workspace.shape, width, workspace.spacing)
    free = scale_cells(workspace.free, factors, where=where)
    if free.shape == workspace.shape:
        return workspace
    spacing = workspace.spacing and tuple(
        size * before / after for size, before, after in zip(workspace.spacing, workspace.shape, free.shape, strict=True)
    )
    return GridWorkspace(free, name=workspace.name, spacing=spacing)


def _axes(options: MapOptions) -> dict[str, Any]:
    return {"channel": options.channel, "frame": options.frame}


def vessels_in(
    path: str | os.PathLike[str], *, low: float = imaging.LOW, high: float = imaging.HIGH, **options: Any
) -> imaging.Vessels:
    """Return the vessels in a photograph. Reuse the last result if the file and the options have not changed.

    Parameters
    ----------
    path : path
        Path of the photograph, a picture file.
    low, high, **options
        Options of the function `shoal.swarm.maps.imaging.find_vessels`, including ``bright`` and ``thickest``, and the options
        ``channel`` and ``frame`` of `shoal.swarm.maps.pictures.read_pixels`.

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
    """Return the vessel finder of a photograph. Reuse the last finder if the file and the options have not changed.

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
def _vessels_in(path: Path, stamp: int, low: float, high: float, options: tuple[tuple[str, Any], ...]) -> imaging.Vessels:
    finder = _finder_of(path, stamp, options)
    with errors_at(path):
        return finder.find(low=low, high=high)


@lru_cache(maxsize=1)
def _finder_of(path: Path, _stamp: int, options: tuple[tuple[str, Any], ...]) -> imaging.VesselFinder:
    given = dict(options)
    pixels = read_pixels(path, channel=given.pop("channel", None), frame=given.pop("frame", None))
    with errors_at(path):
        return imaging.VesselFinder(pixels, **given)
