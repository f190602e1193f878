"""Mission files: their formats, their names, and functions that write and read them."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import fields
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from shoal.core.checks import (
    as_path,
    check_integer,
    check_list,
    check_number,
    count_text,
    describe_missing_file,
    fault_place,
    parse_json,
    read_text,
)
from shoal.core.errors import InvalidInputError, errors_at
from shoal.core.files import atomic
from shoal.core.xml import decode_xml
from shoal.missions.diagnostics import RULES, Sheet
from shoal.missions.formats import FORMATS, MissionFormat, formats_by_suffix
from shoal.missions.formats.fences import (
    FENCE,
    RALLY,
    fence_text,
    rally_text,
    read_fence,
    read_rally,
)
from shoal.missions.mission import KINDS, Mission
from shoal.missions.rules import ROUNDING, check_coordinates, fence_clearances
from shoal.search.flight.vehicle import PRESETS, Vehicle
from shoal.search.regions.coverage import TURNING
from shoal.search.regions.outline import LARGEST_FILE

UNCOVERED = "uncovered.geojson"  # not a mission: the areas that the check found uncovered
MANIFEST = "missions.json"  # the manifest: the names of the written files
ANGLE = "footprint_angle_degrees"  # a key of the manifest
# a key of the manifest: for each mission, the numbers of its waypoints in all, out and home
_WAYS = "ways"
_FILES, _STARTS, _CRUISES = "files", "starts_s", "cruise_speeds"  # further keys of the manifest
_SAME_START = 0.01  # seconds by which rounded starts may differ
STARTS = "starts.txt"  # the table of start times, for the people who start the vehicles

_NAMED = 3  # missing files of one format that are named

_HOW_TO_START = """\
Start times in hours, minutes and seconds after the start of the search.
Upload each mission, and let its vehicle wait on the ground, disarmed.
Arm the vehicle and start its mission at its start time, not earlier:
an autopilot disarms a vehicle that is armed and does not take off.
"""

_NAME = re.compile(r"robot-(\d+)(?:-(\d+))?")


def write_missions(
    missions: Sequence[Mission],
    folder: str | os.PathLike[str],
    *,
    formats: Sequence[str] | None = None,
    vehicle: Vehicle | None = None,
    angle: float | str | None = None,
) -> list[Path]:
    """Write a file for each mission in each format, such as ``robot-01.plan``, or
    ``robot-01-2.plan`` for a second sortie.

    If start times are known, the file ``starts.txt`` lists them in their order, for the people who
    start the vehicles. The file ``missions.json`` lists all written files. The function removes
    mission files that an older ``missions.json`` in the folder lists, so that the folder contains
    missions of only one search. The function keeps all other files in the folder.

    Parameters
    ----------
    missions : sequence of Mission
    folder : path
        The output folder. If the output folder does not exist, the function creates it.
    formats : sequence of str, optional
        Names of formats ("plan", "wpl", "geojson", "kml", "gpx", "csv"), or ``MODULE:ATTRIBUTE``
        for a third-party `MissionFormat`. By default, the function writes all formats except
        third-party formats. For missions in metres, the function writes only "csv", because the
        other formats need positions on Earth.
    vehicle : Vehicle, optional
        If a vehicle is given, the file ``missions.json`` also lists the duration and the usable
        fraction of each mission.
    angle : float, optional
        Angle of the sides of the footprints for which the missions are planned, in degrees
        counter-clockwise from east. The file ``missions.json`` stores it, and the check of the
        missions uses it.

    Returns
    -------
    list of Path
        The written files.

    Raises
    ------
    InvalidInputError, UnknownNameError
        If an argument is invalid, or if a path or a rally point, rounded as in a file, leaves the
        fence or enters an exclusion polygon of the fence, rounded as in the file. In these cases,
        the function writes no file.
    OutputError
        If a file cannot be written. After an `OutputError`, no partly written file remains.
    """
    folder = as_path(folder, what="folder")
    texts = mission_texts(missions, formats=formats, vehicle=vehicle, angle=angle)
    with ExitStack() as stack:
        for name, text in texts.items():
            if name != MANIFEST:
                stack.enter_context(atomic(folder / name)).write_text(
                    text, encoding="utf-8", newline="\n"
                )
    for name in _read_file_list(folder) - {*texts}:
        (folder / name).unlink(missing_ok=True)
    with atomic(folder / MANIFEST) as temporary:
        temporary.write_text(texts[MANIFEST], encoding="utf-8", newline="\n")
    return [folder / name for name in texts if name != MANIFEST]


def mission_texts(
    missions: Sequence[Mission],
    *,
    formats: Sequence[str] | None = None,
    vehicle: Vehicle | None = None,
    angle: float | str | None = None,
) -> dict[str, str]:
    """Return the texts of the files that `write_missions` writes, by file name: the missions, then
    the files beside them, and the manifest.
    """
    missions = check_list(missions, Mission, what="missions")
    in_metres = any(not mission.geographic for mission in missions)
    if formats is None:
        formats = [name for name in FORMATS if FORMATS.get(name).metres or not in_metres]
    formats = check_list(formats, str, what="formats")
    if len(formats) == 0:
        raise InvalidInputError("formats: expected names such as plan and gpx, got none")
    if len(missions) == 0:
        raise InvalidInputError("missions: expected at least one mission to write, got none")
    chosen = {name: FORMATS.get(name) for name in formats}
    texts: dict[str, str] = {}
    for name, form in chosen.items():
        for mission in missions:
            if not mission.geographic and not form.metres:
                raise InvalidInputError(
                    f"format {name!r}: expected missions in degrees, got {mission.name} in metres,"
                    " because its region has no position on Earth"
                )
            file = f"{mission.name}{form.suffix}"
            if file in texts:
                raise InvalidInputError(
                    f"missions: expected each robot and sortie once, got {mission.name} again"
                )
            texts[file] = form.write(mission)
    if any(mission.start is not None for mission in missions):
        texts[STARTS] = _starts_text(missions, vehicle)
    if any(form.fence == "beside" for form in chosen.values()):
        texts |= _texts_beside(missions)
    _check_written(missions, texts)
    ways = {
        mission.name: {
            "waypoints": len(mission.waypoints),
            "waypoints_out": mission.waypoints_out,
            "waypoints_home": mission.waypoints_home,
        }
        for mission in missions
        if None not in (mission.waypoints_out, mission.waypoints_home)
    }
    manifest = (
        {_FILES: sorted(texts)}
        | ({} if angle is None else {ANGLE: angle})
        | ({_WAYS: ways} if ways else {})
        | _times(missions, vehicle)
    )
    return texts | {MANIFEST: json.dumps(manifest, indent=1, allow_nan=False) + "\n"}


def _check_written(missions: Sequence[Mission], texts: Mapping[str, str]) -> None:
    """Refuse missions whose paths or rally points leave the fence, according to the texts of the
    files.

    The function reads each text as an autopilot would: it compares rounded coordinates of paths
    with rounded corners of polygons.
    """
    from shapely import Polygon

    fences = {mission.name: mission.fence for mission in missions}
    fenced = {name: text for name, text in texts.items() if fences.get(Path(name).stem) is not None}
    for sheet in sheets_of_texts(texts, fenced):
        fence = sheet.fence or fences[Path(sheet.file).stem]
        if sheet.home is None or not len(sheet.points) or fence is None:
            continue  # the file of a third-party format
        if sheet.geographic:  # autopilots compare longitudes as numbers
            places = np.vstack([[sheet.home], sheet.points, *fence.rings])[:, 0]
            if np.ptp(places) > 180:
                raise InvalidInputError(
                    f"{sheet.file}: expected paths and a fence that do not cross the 180° meridian,"
                    f" got longitudes from {places.min():.6f} to {places.max():.6f}; no file was"
                    " written"
                )
        for number, ring in enumerate(fence.rings):
            if not Polygon(ring).is_valid:
                which = (
                    "the outline" if number < len(fence.outlines) else f"exclusion polygon {number}"
                )
                raise InvalidInputError(
                    f"{sheet.file}: expected fence polygons that neither touch nor cross themselves"
                    f" as the file contains them, got {which}, which does"
                    f"{fault_place(Polygon(ring))}; no file was written"
                )
        for name, distance in zip(*fence_clearances(sheet, fence), strict=True):
            if distance < -ROUNDING:
                raise InvalidInputError(
                    f"{sheet.file}: expected paths and rally points inside the fence as the file"
                    f" contains it, got {name} {-distance:.3g} m outside the fence or in an"
                    " exclusion polygon; no file was written"
                )


def _times(missions: Sequence[Mission], vehicle: Vehicle | None) -> dict[str, dict[str, float]]:
    """Return the known start times, durations and usable fractions of missions, and the cruise speeds
    of robots that are faster than the vehicle of their team, as mappings from the mission's name.
    """
    flights = [] if vehicle is None else [mission.flight_report(vehicle) for mission in missions]
    times = {
        _STARTS: {mission.name: mission.start for mission in missions if mission.start is not None},
        _CRUISES: {
            mission.name: mission.speed
            for mission in missions
            if vehicle is not None and mission.speed > vehicle.cruise
        },
        "durations_s": {flight["mission"]: flight["duration_s"] for flight in flights},
        "usable_fractions": {
            flight["mission"]: flight["usable_fraction"]
            for flight in flights
            if flight["usable_fraction"] is not None
        },
    }
    return {name: values for name, values in times.items() if values}


def _starts_text(missions: Sequence[Mission], vehicle: Vehicle | None) -> str:
    """Return a table of the start times of missions, in the order of these times."""
    rows = [("start", "mission", "lasts", "altitude")]
    for mission in sorted(
        missions,
        key=lambda mission: (
            inf if mission.start is None else mission.start,
            mission.robot,
            mission.sortie,
        ),
    ):
        start = "when its vehicle is back" if mission.start is None else _clock(mission.start)
        lasts = "" if vehicle is None else _clock(mission.duration(vehicle))
        rows.append((start, mission.name, lasts, f"{mission.altitude:g} m"))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    table = [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
    return "\n".join([_HOW_TO_START, *table, ""])


def _clock(seconds: float) -> str:
    minutes, remainder = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{remainder:02d}"


def _texts_beside(missions: Sequence[Mission]) -> dict[str, str]:
    """Return the texts of the two files that all missions share, by file name: the fence and the
    rally points.
    """
    first = missions[0]
    texts = {} if first.fence is None else {FENCE: fence_text(first.fence)}
    if first.rally:
        highest: dict[tuple[float, ...], float] = {}
        for *place, up in (point for mission in missions for point in mission.rally):
            highest[tuple(place)] = max(up, highest.get(tuple(place), up))
        texts[RALLY] = rally_text(tuple((*place, up) for place, up in highest.items()))
    return texts


ReadBeside = Callable[[str], str | None]
"""A function that returns the text of a file beside mission files, or None if there is none."""


def _texts_in(folder: Path) -> ReadBeside:
    """Return a function that reads files of a folder."""

    def read(name: str) -> str | None:
        path = folder / name
        return (
            read_text(path, what="file that belongs to missions", most=LARGEST_FILE)
            if path.is_file()
            else None
        )

    return read


def _take_beside(sheets: Sequence[Sheet], read: ReadBeside) -> None:
    """Add data from the files beside mission files to the sheets of these missions.

    All sheets get start times, cruise speeds and the footprint angle from the manifest
    ``missions.json``. Sheets without the numbers of waypoints on the ways out and home get them
    from there too, if their number of waypoints is the one in the manifest. Sheets of formats whose
    fence is beside them get the fence and the rally points. Mistakes in these files become
    diagnostics. A manifest with a mistake is not used at all: a wrong start time could bring
    vehicles together.
    """
    try:
        manifest = _read_manifest(read)
    except InvalidInputError as error:
        place, _, sentence = str(error).partition(": expected")
        for sheet in sheets:
            sheet.add("manifest", place, f"expected{sentence}")
        manifest = {}
    starts, counts = manifest.get(_STARTS, {}), manifest.get(_WAYS, {})
    cruises = manifest.get(_CRUISES, {})
    for sheet in sheets:
        mission = Path(sheet.file).stem
        start = starts.get(mission)
        if None not in (start, sheet.start) and abs(start - sheet.start) > _SAME_START:
            sheet.add(
                "manifest",
                f"{MANIFEST}, {_STARTS}, {mission}",
                f"expected {sheet.start:g} s, the start in {sheet.file}, got {start:g} s",
            )
        sheet.start = sheet.start if start is None else float(start)
        sheet.cruise = cruises.get(mission)
        sheet.footprint_angle = manifest.get(ANGLE, sheet.footprint_angle)
        count = counts.get(mission, {})
        if sheet.waypoints_out is None and count.get("waypoints") == len(sheet.points):
            sheet.waypoints_out, sheet.waypoints_home = (
                count["waypoints_out"],
                count["waypoints_home"],
            )
    suffixes = formats_by_suffix()
    beside = [
        sheet
        for sheet in sheets
        if (name := suffixes.get(Path(sheet.file).suffix.lower())) is not None
        and FORMATS.get(name).fence == "beside"
    ]
    for name, parse, field in (
        (
            (FENCE, read_fence, "fence"),
            (RALLY, read_rally, "rally"),
        )
        if beside
        else ()
    ):
        try:
            text = read(name)
            if text is None:
                continue
            content = parse(text, name)
        except InvalidInputError as error:
            place, _, reason = str(error).rpartition(": expected")
            beside[0].add("beside", place, f"expected{reason}")
            continue
        for sheet in beside:
            setattr(sheet, field, content)


def _read_manifest(read: ReadBeside) -> dict[str, Any]:
    """Return the content of the manifest ``missions.json``, or an empty mapping if there is none.

    Raises
    ------
    InvalidInputError
        If the manifest cannot be read, or if a value in it cannot be right.
    """
    text = read(MANIFEST)
    if text is None:
        return {}
    content = parse_json(text, where=MANIFEST)
    if not isinstance(content, dict):
        raise InvalidInputError(f"{MANIFEST}: expected an object, got {content!r:.60}")
    for key, kind, expected in (
        (_FILES, list, "a list of file names"),
        (_STARTS, dict, "an object with a start time for each mission"),
        (_CRUISES, dict, "an object with a cruise speed for each mission"),
        (_WAYS, dict, "an object with numbers of waypoints for each mission"),
    ):
        if not isinstance(content.get(key, kind()), kind):
            raise InvalidInputError(
                f"{MANIFEST}, {key}: expected {expected}, got {content[key]!r:.60}"
            )
    for mission, start in content.get(_STARTS, {}).items():
        check_number(start, what=f"{MANIFEST}, {_STARTS}, {mission}", least=0)
    for mission, speed in content.get(_CRUISES, {}).items():
        check_number(speed, what=f"{MANIFEST}, {_CRUISES}, {mission}", above=0)
    for mission, count in content.get(_WAYS, {}).items():
        where = f"{MANIFEST}, {_WAYS}, {mission}"
        if not isinstance(count, dict):
            raise InvalidInputError(f"{where}: expected an object, got {count!r:.60}")
        whole, out, home = (
            check_integer(count.get(key), what=f"{where}, {key}", least=0)
            for key in ("waypoints", "waypoints_out", "waypoints_home")
        )
        if out + home >= whole:
            raise InvalidInputError(
                f"{where}: expected fewer waypoints out and home than {whole}, got {out + home}"
            )
    if content.get(ANGLE, TURNING) != TURNING:
        check_number(content[ANGLE], what=f"{MANIFEST}, {ANGLE}", least=-360, most=360)
    return content


def _read_file_list(folder: Path) -> set[str]:
    """Return the names of the mission files that a folder's manifest lists. Without a valid
    manifest, return an empty set.
    """
    try:
        listed = _read_manifest(_texts_in(folder)).get(_FILES, [])
    except InvalidInputError:
        listed = []
    names = {name for name in listed if isinstance(name, str)}
    suffixes = formats_by_suffix()
    paths = {Path(name) for name in names if Path(name).name == name}
    ours = {path.name for path in paths if _NAME.fullmatch(path.stem) and path.suffix in suffixes}
    return ours | {name for name in (FENCE, RALLY, STARTS) if name in names}


def mission_files(folder: str | os.PathLike[str]) -> list[Path]:
    """Return all mission files in a folder except ``uncovered.geojson``, sorted by
    format and name.
    """
    order = list(formats_by_suffix())
    try:
        files = [
            path
            for path in as_path(folder, what="folder").iterdir()
            if path.suffix.lower() in order and path.is_file()
        ]
    except OSError as error:
        raise InvalidInputError(
            f"{folder}: expected a folder of mission files, got none: {error.strerror or error}"
        ) from None
    files = [path for path in files if path.name != UNCOVERED and not path.name.startswith(".")]
    return sorted(files, key=lambda path: (order.index(path.suffix.lower()), path.name))


def format_of(path: Path) -> str:
    """Return the name of the format of a mission file."""
    formats = formats_by_suffix()
    if path.suffix.lower() not in formats:
        raise InvalidInputError(
            f"{path}: expected a mission file ({' '.join(formats)}), got the suffix {path.suffix!r}"
        )
    return formats[path.suffix.lower()]


def open_sheet(path: str | os.PathLike[str]) -> Sheet:
    """Read a mission file, and return its sheet, with diagnostics about its syntax and its
    coordinates.

    Raises
    ------
    InvalidInputError
        If the file does not exist or has an unknown format.
    """
    source = as_path(path)
    form = FORMATS.get(format_of(source))
    sheet = Sheet(source.name)
    try:
        if (missing := describe_missing_file(source)) and source.exists():
            raise InvalidInputError(f"{source}: expected a mission file, got {missing}")
        if source.stat().st_size > LARGEST_FILE:
            raise InvalidInputError(
                f"{source}: expected a file of at most {LARGEST_FILE} bytes, got"
                f" {source.stat().st_size}"
            )
        content = source.read_bytes()
    except OSError as error:
        raise InvalidInputError(
            f"{source}: expected a mission file, got the error: {error.strerror or error}"
        ) from None
    try:
        text = decode_xml(content, where="") if form.xml else content.decode("utf-8-sig")
    except InvalidInputError as error:
        sheet.add("unreadable", "", str(error).removeprefix(": "))
        return sheet
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        sheet.add(
            "unreadable",
            f"line {line}",
            f"expected text in UTF-8, got byte 0x{content[error.start]:02x}",
        )
        return sheet
    return _scan(sheet, form, text)


def _scan(sheet: Sheet, form: MissionFormat, text: str) -> Sheet:
    """Read the text of a mission file into its sheet, and return the sheet."""
    form.scan(text, sheet)
    named = _NAME.fullmatch(Path(sheet.file).stem)
    if named is not None and sheet.robot is None:
        sheet.robot, sheet.sortie = int(named[1]), int(named[2] or 1)
    check_coordinates(sheet)
    return sheet


def sheets_of_texts(texts: Mapping[str, str], names: Iterable[str] | None = None) -> list[Sheet]:
    """Return the sheets of mission files that are texts by file name, as `mission_texts` returns
    them; of all mission files, or of those with given names.
    """
    suffixes = formats_by_suffix()
    sheets = [
        _scan(Sheet(name), FORMATS.get(suffixes[Path(name).suffix]), texts[name])
        for name in (texts if names is None else names)
        if Path(name).suffix in suffixes
    ]
    _take_beside(sheets, texts.get)
    return sheets


def open_sheets(source: str | os.PathLike[str]) -> list[Sheet]:
    """Return the sheets of a mission file, or of all mission files in a folder with what the files
    beside them say.

    Raises
    ------
    InvalidInputError
        If no mission file exists.
    """
    folder = as_path(source)
    if not folder.is_dir():
        return [open_sheet(folder)]
    sheets = [open_sheet(path) for path in mission_files(folder)]
    if not sheets:
        raise InvalidInputError(
            f"{source}: expected a folder with mission files, got a folder without mission files"
        )
    _take_beside(sheets, _texts_in(folder))
    _check_folder(sheets, folder)
    return sheets


def number_apart(sheets: Sequence[Sheet]) -> None:
    """Give each mission whose files state no robot a robot of its own: the smallest free number, in
    the order of the files.

    Files of one name in several formats are one mission.
    """
    numbers = {
        Path(sheet.file).stem: (sheet.robot, sheet.sortie)
        for sheet in reversed(sheets)
        if sheet.robot is not None
    }
    taken = {robot for robot, _ in numbers.values()}
    free = (k for k in range(1, len(sheets) + len(taken) + 1) if k not in taken)
    for sheet in sheets:
        if sheet.robot is None:
            stem = Path(sheet.file).stem
            if stem not in numbers:
                numbers[stem] = next(free), 1
            sheet.robot, sheet.sortie = numbers[stem]


def _check_folder(sheets: Sequence[Sheet], folder: Path) -> None:
    """Add diagnostics for files that the manifest of a folder lists and that are missing, for
    missions that it does not list, and for several missions without a manifest.
    """
    names, manifest = {Path(sheet.file).stem for sheet in sheets}, folder / MANIFEST
    if missing := describe_missing_file(manifest):
        if manifest.exists():
            sheets[0].add("manifest", MANIFEST, f"expected a file, got {missing}")
        elif len(names) > 1 and all(sheet.start is None for sheet in sheets):
            sheets[0].add(
                "no-manifest",
                "",
                f"expected a file {MANIFEST} with the start times, got none: all missions start at"
                " 0 s",
            )
        return
    listed = _read_file_list(folder)
    gone = sorted(file for file in listed if not (folder / file).is_file())
    others: dict[str, list[str]] = {}  # by suffix: of missions with files of other formats
    for file in gone:
        if file == STARTS:
            sheets[0].add(
                "file-gone",
                MANIFEST,
                f"expected the file {STARTS}, the table of the start times, got none",
            )
        elif Path(file).stem not in names or file in (FENCE, RALLY):
            sheets[0].add("file-missing", MANIFEST, f"expected the file {file}, got none")
        else:
            others.setdefault(Path(file).suffix, []).append(file)
    for suffix, files in others.items():
        if len(files) == sum(file.endswith(suffix) for file in listed - {STARTS, FENCE, RALLY}):
            missing = f"{suffix} files of {count_text(len(files), 'mission')}"
        else:
            missing = f"file{'s' * (len(files) > 1)} {', '.join(files[:_NAMED])}"
            missing += f" and {len(files) - _NAMED} more" * (len(files) > _NAMED)
        sheets[0].add("file-gone", MANIFEST, f"expected the {missing}, got none")
    missions = {Path(file).stem for file in listed}
    for sheet in sheets:
        if missions and Path(sheet.file).stem not in missions:
            sheet.add("unlisted", "", f"expected a mission that {MANIFEST} lists, got another one")


def read_mission(path: str | os.PathLike[str]) -> Mission:
    """Read a mission from a file in any format.

    A ``.plan`` or WPL file does not contain the numbers of the robot and the sortie, so the
    function takes both numbers from the file name. If the file name gives no numbers, the mission
    counts as the first sortie of robot 1. A WPL file does not contain the autopilot or the kind of
    vehicle. For a WPL file, the function assumes PX4. It assumes a vehicle that flies if a waypoint
    is above 0 m or if the file contains a take-off, and otherwise a rover. The start time comes
    from ``missions.json`` beside the file, and the fence and the rally points of a WPL file come
    from the files beside it.

    Parameters
    ----------
    path : path
        The mission file, whose suffix determines its format.

    Raises
    ------
    InvalidInputError
        If the file cannot be read. The error message gives the place of the mistake in the file.
    """
    sheet = open_sheet(path)
    _take_beside([sheet], _texts_in(Path(path).parent))
    return mission_of(sheet, path)


def mission_of(
    sheet: Sheet, path: str | os.PathLike[str], vehicle: Vehicle | None = None
) -> Mission:
    """Convert the sheet of a mission file to a mission.

    With a vehicle, no leg is faster than `fastest_of` says, and a mission that states no speed has
    the cruise speed of the vehicle.
    """
    for diagnostic in sheet.diagnostics:
        if RULES[diagnostic.rule].fatal:
            raise InvalidInputError(
                f"{path}{', ' * bool(diagnostic.place)}{diagnostic.place}: {diagnostic.sentence}"
            )
    kind = sheet.kind if sheet.kind in KINDS else "multirotor"
    defaults, fastest = Vehicle(preset=kind), fastest_of(vehicle, sheet)
    usual = fastest if isfinite(fastest) else defaults.cruise
    base = (sheet.elevation or 0.0) if sheet.altitude_frame == "sea" else 0.0
    varied, above_ground = len({*sheet.altitudes}) > 1, sheet.altitude_frame == "ground"
    same = {field.name for field in fields(Sheet)} & {field.name for field in fields(Mission)}
    values = {name: getattr(sheet, name) for name in same} | {
        "robot": sheet.robot or 1,
        "sortie": sheet.sortie or 1,
        "kind": kind,
        "autopilot": "ardupilot" if sheet.autopilot == "ardupilot" else "px4",
        "altitude": sheet.altitudes[0] if sheet.altitudes else defaults.height,
        "speed": usual if sheet.speed is None else min(sheet.speed, fastest),
        "altitude_frame": sheet.altitude_frame or "home",
        "speeds": None if sheet.speeds is None else np.minimum(sheet.speeds, fastest),
        "heights": np.array(sheet.altitudes) - base if varied and not above_ground else None,
        "altitudes": np.array(sheet.altitudes) if varied and above_ground else None,
    }
    with errors_at(path):
        return Mission(sheet.points, **values)


def fastest_of(vehicle: Vehicle | None, sheet: Sheet) -> float:
    """Return the speed in m/s that a mission of a vehicle does not exceed: the cruise speed of the
    vehicle, or of this robot if the manifest states one, as for a team with rates; infinity without a
    vehicle, and for an ideal vehicle whose speed nobody has given.
    """
    if vehicle is None or (
        vehicle.preset == "ideal" and vehicle.cruise == PRESETS["ideal"]["cruise_speed"]
    ):
        return inf
    return vehicle.cruise if sheet.cruise is None else sheet.cruise
