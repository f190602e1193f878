"""Open a map by what a user types: a file, or the name of a generated one."""

from __future__ import annotations

import os
from pathlib import Path

from shoal.errors import InvalidInputError
from shoal.swarm.maps.workspace import GridWorkspace


def open_map(
    text: str,
    *,
    vessels: bool = False,
    width: int | None = None,
    low: float = 0.24,
    high: float = 0.42,
    bright: bool | None = None,
    thickest: float = 0.035,
    threshold: float = 0.5,
    invert: bool = False,
    scale: float = 1.0,
    level: float | None = None,
    label: int | None = None,
) -> GridWorkspace:
    """Return the workspace that ``text`` names.

    Parameters
    ----------
    text : str
        A generated map ("vessels:5000"; see ``shoal maps``) or the path of a file (see `shoal.swarm.maps.files.read_map`).
    vessels : bool
        The file is a photograph: segment its vessels (needs the extra ``shoal[imaging]``).
    width : int, optional
        With ``vessels``: the larger side of the map, in cells.
    low, high, bright, thickest
        With ``vessels``; see `shoal.swarm.imaging.segment_vessels`.
    threshold, invert, scale
        For pictures that are maps already.
    level, label
        For arrays and volumes of numbers; see `shoal.swarm.maps.volumes.VolumeOptions`.

    Raises
    ------
    InvalidInputError, UnknownNameError, MissingExtraError
        If there is no such map, or it cannot be read.

    Examples
    --------
    >>> open_map("line:7")
    <GridWorkspace 'line:7': 1x7, 7 free cells>
    """
    from shoal.swarm.maps import generators
    from shoal.swarm.maps.files import PictureOptions, name_of, read_map, read_pixels

    PictureOptions(threshold, invert, scale)  # refuses values out of range whatever the map is
    if width is not None and not vessels:
        raise InvalidInputError(f"width: expected it only together with vessels (a photograph to segment), got {width}")
    path = Path(text)
    named = generators.is_spec(text) and not os.path.isfile(path)  # unlike Path.is_file it takes names of any length
    if vessels:
        if named:
            raise InvalidInputError(f"vessels: expected a photograph to segment, got the generated map {text!r}")
        from shoal.swarm.maps.imaging import segment_vessels

        pixels = read_pixels(path)
        try:
            return GridWorkspace(
                segment_vessels(pixels, width=width, low=low, high=high, bright=bright, thickest=thickest), name=name_of(path)
            )
        except InvalidInputError as error:
            raise InvalidInputError(f"{path}: {error}") from None
    if named or (not path.suffix and not os.path.exists(path)):
        from shoal.swarm.maps.generators.remembered import remembered

        return GridWorkspace(remembered(text), name=text)
    return read_map(path, threshold=threshold, invert=invert, scale=scale, level=level, label=label)
