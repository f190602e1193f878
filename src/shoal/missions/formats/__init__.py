"""The formats of mission files. A format is a module of this folder and its entry in `FORMATS`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from shoal.core.dataclass import dataclass
from shoal.core.registry import Registry
from shoal.missions.diagnostics import Sheet
from shoal.missions.formats import geojson, gpx, kml, plan, table, wpl
from shoal.missions.mission import Mission


@dataclass(frozen=True)
class MissionFormat:
    """A format of mission files.

    Parameters
    ----------
    suffix : str
        Suffix of the names of files in the format, such as ``.plan``.
    write : callable
        Function that converts a `Mission` to the text of a file.
    scan : callable
        Function that reads the text of a file into a `shoal.missions.diagnostics.Sheet`. It fills
        at least ``home``, ``points``, ``places`` and ``altitudes``, the latter two with an entry
        for each point, ``kind`` at least for rovers, and ``geographic`` for missions in metres.
    metres : bool
        Whether the format supports missions in metres.
    fence : "inside", "beside" or "none"
        Where the fence and the rally points of a mission are: in its file, or in two files that all
        missions of a folder share.
    xml : bool
        Whether files of the format are XML, whose encoding the file names.
    camera : bool
        Whether files of the format contain the commands to a camera.
    """

    suffix: str
    write: Callable[[Mission], str]
    scan: Callable[[str, Sheet], None]
    metres: bool = False
    fence: Literal["inside", "beside", "none"] = "none"
    xml: bool = False
    camera: bool = False


FORMATS: Registry[MissionFormat] = Registry("mission format")
FORMATS.add("plan", MissionFormat(".plan", plan.write, plan.scan, fence="inside", camera=True))
FORMATS.add("wpl", MissionFormat(".waypoints", wpl.write, wpl.scan, fence="beside", camera=True))
FORMATS.add("geojson", MissionFormat(".geojson", geojson.write, geojson.scan))
FORMATS.add("kml", MissionFormat(".kml", kml.write, kml.scan, xml=True))
FORMATS.add("gpx", MissionFormat(".gpx", gpx.write, gpx.scan, xml=True))
FORMATS.add("csv", MissionFormat(".csv", table.write, table.scan, metres=True))


def formats_by_suffix() -> dict[str, str]:
    """Return the name of the format for each file suffix. If two formats have equal suffixes, the
    first format applies.
    """
    names: dict[str, str] = {}
    for name in FORMATS:
        names.setdefault(FORMATS.get(name).suffix, name)
    return names
