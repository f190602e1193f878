"""The linter of missions: what is wrong in their files, and between them."""

from __future__ import annotations

import math
import os
from collections import defaultdict
from collections.abc import Iterable, Iterator
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from shoal.core.checks import check_choice, check_integer, check_number, count_text
from shoal.core.errors import InvalidInputError
from shoal.core.geometry import angles_of, step_lengths
from shoal.missions.approach import constant_speed, near_homes
from shoal.missions.camera import check_camera
from shoal.missions.diagnostics import RULES, Diagnostic, Sheet
from shoal.missions.files import MANIFEST, fastest_of, mission_of, number_apart, open_sheets
from shoal.missions.formats.fences import FENCE
from shoal.missions.mission import CAPS
from shoal.missions.rules import ROUNDING, check_elsewhere, check_place, check_sense, path_of
from shoal.search.flight.timing import leg_seconds
from shoal.search.flight.vehicle import Vehicle
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import SearchRegion

_SAME_PLACE = 1e-7  # degrees
_SAME_METRES = 0.01
_STEEPEST = 12.0  # degrees: an approach
_ALIKE = 1e-6  # relative: speeds as files round them
_ROUGH = 0.01  # relative to the time: what rounded coordinates change on short legs


class Limits(NamedTuple):
    """What missions must keep to.

    Parameters
    ----------
    cap : int, optional
        Maximum number of mission items, including home. By default, the limit of the autopilot
        applies.
    autopilot : "px4" or "ardupilot", optional
        Expected autopilot of the missions.
    vehicle : Vehicle, optional
        Vehicle of the missions. Turns of a fixed wing must not be narrower than the turning radius
        of ``vehicle``.
    airspace : float, optional
        Distance in metres by which turns of fixed wings may leave the allowed area, which is the
        region without its margin and its no-go zones. By default, turns may leave the allowed area
        by any distance, and a warning reports the distance.
    separation : float, optional
        Distance in metres that homes and landing points of different vehicles should keep. By
        default, the linter does not compare the homes of vehicles.
    fence_distance : float, optional
        Distance in metres that all paths and rally points must keep from the fence. By default,
        they must only stay inside it.
    """

    cap: int | None = None
    autopilot: str | None = None
    vehicle: Vehicle | None = None
    airspace: float | None = None
    separation: float | None = None
    fence_distance: float | None = None


def lint(
    source: str | os.PathLike[str],
    region: SearchRegion | None = None,
    **limits: Any,
) -> list[Diagnostic]:
    """Return the mistakes in a mission file, or in all mission files of a folder, including
    contradictions between files.

    Parameters
    ----------
    source : path
        A mission file, or a folder of mission files.
    region : SearchRegion, optional
        The region that the missions search.
    **limits
        The fields of `Limits`.

    Returns
    -------
    list of Diagnostic
        The mistakes that the linter has found. The mapping `shoal.missions.RULES` lists all kinds
        of mistakes.

    Raises
    ------
    InvalidInputError
        If no mission file exists, or if the region is in degrees and a mission in metres, or the
        reverse.
    """
    sheets, together = open_sheets(source), Path(source).is_dir()
    if together:
        number_apart(sheets)
    lint_sheets(sheets, region, Limits(**limits), together=together)
    return [diagnostic for sheet in sheets for diagnostic in sheet.diagnostics]


def lint_sheets(
    sheets: list[Sheet], region: SearchRegion | None, limits: Limits, *, together: bool = True
) -> None:
    """Add to sheets the diagnostics that `lint` returns.

    With ``together``, the sheets are all missions of a search, and are compared with each other.
    """
    if limits.autopilot is not None:
        check_choice(limits.autopilot, what="autopilot", choices=CAPS)
    if limits.cap is not None:
        check_integer(limits.cap, what="cap", least=1)
    if limits.fence_distance is not None:
        check_number(limits.fence_distance, what="fence_distance", least=0)
        hidden = any(
            not sheet.readable
            or any(diagnostic.rule == "beside" for diagnostic in sheet.diagnostics)
            for sheet in sheets
        )
        if not hidden and not any(sheet.fence is not None for sheet in sheets):
            raise InvalidInputError(
                "fence_distance: expected missions with a fence (.plan, or .waypoints beside a"
                f" {FENCE}), got none in {', '.join(sheet.file for sheet in sheets[:3])}"
            )
    vehicle = limits.vehicle
    for sheet in sheets:
        if sheet.readable:
            if vehicle is not None and vehicle.preset != "ideal":
                _compare_kinds(sheet, vehicle)
            check_sense(
                sheet,
                cap=limits.cap,
                autopilot=limits.autopilot,
                fence_distance=limits.fence_distance,
            )
            _check_curves(sheet, 0.0 if vehicle is None else vehicle.ground_radius)
            if vehicle is not None:
                _check_speeds(sheet, vehicle)
                _check_duration(sheet, vehicle)
                check_camera(sheet, vehicle)
            if vehicle is not None and vehicle.radius:
                _check_climbs(sheet, vehicle)
            if region is not None:
                check_place(sheet, region, limits.airspace)
            _check_whole(sheet)
    _check_sea(sheets)
    if together:
        _check_homes(sheets)
        _check_autopilots(sheets)
        _check_sorties(sheets)
        _check_formats(sheets)
        _check_fences(sheets)
        _check_overlaps(sheets, vehicle)
        if limits.separation is not None:
            _check_near_homes(sheets, limits.separation)
            _check_starts(sheets)
            _check_elevations(sheets)


def _compare_kinds(sheet: Sheet, vehicle: Vehicle) -> None:
    """Take the kind of a vehicle for a mission that states none, or add a diagnostic if the mission
    states another kind.
    """
    if not sheet.kind_is_stated:
        sheet.kind = vehicle.kind
    elif sheet.kind not in (None, vehicle.kind):
        sheet.add(
            "vehicle",
            "",
            f"expected a mission of a {vehicle.kind}, as the vehicle of the check is, got one of a"
            f" {sheet.kind}",
        )


def _check_whole(sheet: Sheet) -> None:
    """Add a diagnostic for a mission that cannot be flown for a reason that no other rule has
    reported.
    """
    try:
        mission_of(sheet, sheet.file)
        if sheet.geographic and sheet.home is not None:
            LocalFrame(*sheet.home).to_metres(
                np.vstack([sheet.points, sheet.landing or sheet.home])
            )
    except InvalidInputError as error:
        if not any(RULES[diagnostic.rule].severity == "error" for diagnostic in sheet.diagnostics):
            _, _, reason = str(error).partition(": expected ")
            sheet.add("invalid", "", f"expected {reason}")


def _check_curves(sheet: Sheet, radius: float) -> None:
    """Add diagnostics for turns of a fixed wing that are too narrow, and for a landing that is too
    steep.
    """
    path = path_of(sheet) if sheet.kind == "fixed-wing" else None
    if path is None:
        return
    if (
        sheet.landing is not None
        and sheet.loiter is None
        and sheet.altitudes
        and sheet.altitude_frame != "sea"
    ):
        distance = float(np.hypot(*(path[-1] - path[-2])))
        if sheet.altitudes[-1] > distance * math.tan(math.radians(_STEEPEST)):
            message = (
                f"expected an approach of at most {_STEEPEST:g} degrees, got"
                f" {sheet.altitudes[-1]:g} m down over {distance:.4g} m"
            )
            sheet.add("approach", sheet.places[-1], message)
    numbers = np.flatnonzero(step_lengths(path) > ROUNDING)
    legs = np.diff(path, axis=0)[numbers]
    lengths, bearings = np.hypot(*legs.T), angles_of(legs)
    bends = np.abs((np.diff(bearings) + math.pi) % (2 * math.pi) - math.pi)
    # a circle that touches both legs begins at this distance before their vertex
    needs = np.pad(radius * np.tan(bends / 2), 1)
    # change of leg directions due to rounded coordinates
    turned = np.pad(radius * ROUNDING / lengths, 1)
    short = (
        needs[:-1] + needs[1:] - lengths - turned[1:-1] - (turned[:-2] + turned[2:]) / 2 - ROUNDING
    )
    if radius and len(short) and short.max() > 0:
        worst = int(np.argmax(short))
        widest = radius * lengths[worst] / (needs[worst] + needs[worst + 1])
        place = sheet.places[min(int(numbers[worst]), len(sheet.places) - 1)]
        sheet.add(
            "turn-radius",
            place,
            f"expected a radius of at least {radius:.4g} m, got at most {widest:.3g} m",
        )


def _check_speeds(sheet: Sheet, vehicle: Vehicle) -> None:
    """Add a diagnostic for the first leg that is faster than the vehicle."""
    if sheet.speed is None:
        return
    fastest, speeds = fastest_of(vehicle, sheet), sheet.speeds or [sheet.speed]
    over = [number for number, speed in enumerate(speeds) if speed > fastest * (1 + _ALIKE)]
    if over:
        place = "" if sheet.speeds is None else [*sheet.places, ""][over[0]]
        sheet.add(
            "too-fast",
            place,
            f"expected at most {fastest:g} m/s, the cruise speed of the vehicle, got"
            f" {max(speeds):g} m/s: the check counts {fastest:g} m/s there",
        )


def _check_duration(sheet: Sheet, vehicle: Vehicle) -> None:
    """Add a diagnostic for a mission that takes longer than the vehicle's endurance without its
    reserve, with the climb of a return.
    """
    try:
        mission = mission_of(sheet, sheet.file, vehicle)
        duration, needed = mission.duration(vehicle), mission.battery_seconds(vehicle)
    except InvalidInputError as error:
        if str(error).startswith("wind_speed"):  # too slow a flight for the wind
            sheet.add("speed", "", f"expected{str(error).partition('expected')[2]}")
        return  # other rules report what else is invalid, and heights above ground give no climbs
    if needed > vehicle.usable_seconds:
        message = (
            f"expected a mission of at most {vehicle.usable_seconds / 60:.4g} min, the endurance"
            f" without the reserve, got {needed / 60:.4g} min"
            + " with the climb of its return"
            * (needed > duration)
        )
        sheet.add("endurance", "", message)


def _check_climbs(sheet: Sheet, vehicle: Vehicle) -> None:
    """Add a diagnostic for the steepest leg of a fixed wing if the vehicle cannot climb or sink so
    fast.
    """
    path = (
        path_of(sheet)
        if sheet.kind == "fixed-wing" and len(sheet.altitudes) == len(sheet.points)
        else None
    )
    if path is None or sheet.altitude_frame == "ground":
        return
    base = sheet.elevation or 0.0 if sheet.altitude_frame == "sea" else 0.0
    glides = sheet.landing is not None and sheet.loiter is None
    ups = np.diff(np.array([base, *sheet.altitudes, *[base] * glides]))
    level = np.column_stack([path[: len(ups) + 1], np.zeros(len(ups) + 1)])
    cruise = vehicle.cruise if sheet.speed is None else sheet.speed
    speeds = np.array(sheet.speeds or [cruise] * (len(ups) + 1))[: len(ups)]
    durations = leg_seconds(level, vehicle, rate=speeds / vehicle.cruise)
    extra = vehicle.vertical_seconds(
        np.sign(ups) * np.maximum(np.abs(ups) - ROUNDING, 0.0)
    ) - durations * (1 + _ROUGH)
    worst = int(np.argmax(extra))
    if extra[worst] > 0:
        rate, most = (
            ups[worst] / max(durations[worst], ROUNDING),
            vehicle.climb_speed if ups[worst] > 0 else vehicle.sink_speed,
        )
        verb = "climb" if ups[worst] > 0 else "sink"
        place = sheet.places[min(worst, len(sheet.places) - 1)]
        sheet.add(
            "climb",
            place,
            f"expected legs on which the vehicle {verb}s by at most {most:g} m/s, got"
            f" {abs(rate):.3g} m/s",
        )


def _check_homes(sheets: list[Sheet]) -> None:
    """Add diagnostics for files in which longitude and latitude seem to be swapped, compared with
    most other files.
    """
    readable = [sheet for sheet in sheets if sheet.readable and sheet.geographic]
    if len(readable) < 3:
        return
    median_home = np.median([sheet.home for sheet in readable if sheet.home is not None], axis=0)
    for sheet in readable:
        assert sheet.home is not None
        check_elsewhere(sheet, sheet.home, median_home, "the other missions' home", "home")


def _check_near_homes(sheets: list[Sheet], separation: float) -> None:
    """Add a diagnostic for each format in which homes or landing points of two vehicles are nearer
    than ``separation`` metres.
    """
    for alike in _by_format(sheet for sheet in sheets if sheet.robot is not None):
        try:
            frame = (
                LocalFrame(*alike[0].home)
                if alike[0].geographic and alike[0].home is not None
                else None
            )
            homes = near_homes(_homes(alike), separation, frame)
        except InvalidInputError:
            continue  # homes too far apart for a local frame; other rules report them
        if homes is not None:
            sheet = min(
                (sheet for sheet in alike if sheet.robot == homes.robots[1]),
                key=lambda sheet: sheet.sortie or 0,
            )
            sheet.add("homes-near", "", str(homes))


def _homes(sheets: list[Sheet]) -> Iterator[tuple[int, tuple[float, float]]]:
    for sheet in sheets:
        places = (sheet.home, sheet.landing if sheet.loiter is None else None)
        yield from (
            (sheet.robot, place)
            for place in places
            if sheet.robot is not None and place is not None
        )


def _check_autopilots(sheets: list[Sheet]) -> None:
    """If the missions are for two autopilots, add diagnostics to the missions for the less frequent
    autopilot.
    """
    by_autopilot: dict[str, list[Sheet]] = defaultdict(list)
    for sheet in sheets:
        if sheet.autopilot is not None:
            by_autopilot[sheet.autopilot].append(sheet)
    if len(by_autopilot) == 2:
        (rare, few), (usual, _) = sorted(by_autopilot.items(), key=lambda entry: len(entry[1]))
        for sheet in few:
            sheet.add(
                "firmware-mixed",
                "",
                f"expected a mission for {usual!r}, as in most files, got a mission for {rare!r}",
            )


def _check_sorties(sheets: list[Sheet]) -> None:
    """For each file format, add a diagnostic for each robot whose sortie numbers have a gap, and for
    each file of a sortie that another file has.
    """
    numbers: dict[tuple[str, int], dict[int, Sheet]] = defaultdict(dict)
    for sheet in sheets:
        if sheet.robot is not None and sheet.sortie is not None:
            by_sortie = numbers[Path(sheet.file).suffix, sheet.robot]
            same = by_sortie.setdefault(sheet.sortie, sheet)
            if same is not sheet:
                sheet.add(
                    "same-robot",
                    "",
                    f"expected one file of robot {sheet.robot}, sortie {sheet.sortie}, got one"
                    f" besides {same.file}",
                )
    for (_, robot), by_sortie in numbers.items():
        missing = next(number for number in count(1) if number not in by_sortie)
        if missing < max(by_sortie):
            sheet = by_sortie[max(by_sortie)]
            sheet.add(
                "sortie-missing",
                "",
                f"expected sorties 1 to {max(by_sortie)} of robot {robot}, got none with number"
                f" {missing}",
            )


def _by_format(sheets: Iterable[Sheet]) -> Iterable[list[Sheet]]:
    """Return the readable sheets of each format."""
    by_format: dict[str, list[Sheet]] = defaultdict(list)
    for sheet in sheets:
        if sheet.readable:
            by_format[Path(sheet.file).suffix].append(sheet)
    return by_format.values()


def _check_overlaps(sheets: list[Sheet], vehicle: Vehicle | None) -> None:
    """Add diagnostics for sorties that start before the earlier sortie of their robot has ended."""
    for alike in _by_format(sheets):
        ends: dict[int, list[tuple[int, float, str]]] = defaultdict(list)  # by robot
        for sheet in sorted(alike, key=lambda sheet: sheet.sortie or 1):
            if sheet.robot is None or sheet.sortie is None or sheet.start is None:
                continue
            earlier = [(end, file) for k, end, file in ends[sheet.robot] if k < sheet.sortie]
            end, before = max(earlier, default=(0.0, ""))
            if sheet.start < end - ROUNDING:
                sheet.add(
                    "sorties-overlap",
                    "",
                    f"expected a start after {end:.4g} s, the end of {before}, got"
                    f" {sheet.start:.4g} s",
                )
            try:
                mission = mission_of(sheet, sheet.file, vehicle)
                lasts = mission.battery_seconds(vehicle or constant_speed(mission))
            except InvalidInputError:
                continue  # other rules report what is invalid
            ends[sheet.robot].append((sheet.sortie, sheet.start + lasts, sheet.file))


def _check_starts(sheets: list[Sheet]) -> None:
    """Add a diagnostic for vehicles without start times, which the check starts at 0 s."""
    told = any(one.rule == "no-manifest" for sheet in sheets for one in sheet.diagnostics)
    for alike in _by_format(sheets):
        without = [sheet for sheet in alike if sheet.start is None and (sheet.sortie or 1) == 1]
        if without and len({sheet.robot for sheet in alike}) > 1 and not told:
            without[0].add(
                "no-start",
                "",
                f"expected start times in {MANIFEST} or in the files, got none for"
                f" {len(without)} of {count_text(len(alike), 'mission')}: a first sortie without one"
                " starts at 0 s",
            )


def _check_sea(sheets: list[Sheet]) -> None:
    """Add a diagnostic for missions with altitudes above the sea of which no file states the height
    of home.
    """
    flown = [sheet for sheet in sheets if sheet.readable and sheet.kind != "rover"]
    known = {(sheet.robot, sheet.sortie) for sheet in flown if sheet.elevation is not None}
    for sheet in flown:
        mission = sheet.robot, sheet.sortie
        if sheet.altitude_frame == "sea" and mission not in known:
            known.add(mission)
            sheet.add(
                "elevation-missing",
                "home",
                "expected the height of home above the sea beside altitudes above the sea, got none:"
                " how high the mission is above home, the check cannot tell",
            )


def _check_elevations(sheets: list[Sheet]) -> None:
    """Add a diagnostic for homes of unknown height beside homes of known height."""
    for alike in _by_format(sheets):
        known = next((sheet for sheet in alike if sheet.elevation is not None), None)
        unknown = [
            sheet
            for sheet in alike
            if sheet.elevation is None and sheet.altitude_frame in (None, "home")
        ]
        if known is not None and unknown:
            unknown[0].add(
                "elevation-missing",
                "home",
                f"expected the height of home above the sea, as {known.file} has one, got none:"
                " the check compares heights as if both homes were equally high",
            )


def _check_formats(sheets: list[Sheet]) -> None:
    """Add diagnostics for files that contradict another file of the same sortie."""
    first: dict[tuple[int, int], Sheet] = {}
    for sheet in sheets:
        if not sheet.readable or sheet.robot is None or sheet.sortie is None:
            continue
        reference = first.setdefault((sheet.robot, sheet.sortie), sheet)
        difference = _difference(reference, sheet)
        if difference:
            sheet.add(
                "formats-differ", "", f"expected the content of {reference.file}, got {difference}"
            )


def _check_fences(sheets: list[Sheet]) -> None:
    """Add diagnostics for missions without a fence, if others of the same format have one."""
    for alike in _by_format(sheets):
        fenced = next((sheet.file for sheet in alike if sheet.fence is not None), None)
        for sheet in alike:
            if fenced is not None and sheet.fence is None:
                sheet.add("fence-differs", "", f"expected a fence, as {fenced} has one, got none")


def _difference(sheet: Sheet, other: Sheet) -> str:
    """Return a text about the difference between two sheets of one sortie, or an empty text if the
    sheets agree.
    """
    same = _SAME_PLACE if sheet.geographic else _SAME_METRES
    if sheet.geographic != other.geographic:
        return "metres beside degrees"
    if len(sheet.points) != len(other.points):
        return f"{len(other.points)} waypoints instead of {len(sheet.points)}"
    apart = np.abs(
        np.vstack([sheet.points, np.array([sheet.home])])
        - np.vstack([other.points, np.array([other.home])])
    ).max(axis=1)
    if apart[-1] > same:
        return "another home"
    if (apart > same).any():
        return f"another place at {other.places[int(np.argmax(apart > same))]}"
    for name in ("autopilot", "kind", "speed", "waypoints_out", "waypoints_home"):
        value, other_value = getattr(sheet, name), getattr(other, name)
        if None not in (value, other_value) and value != other_value:
            return f"{other_value!r} as {name} instead of {value!r}"
    if sheet.speeds != other.speeds and None not in (sheet.speed, other.speed):
        return "other speeds on some legs"
    same_frame = (sheet.altitude_frame or "home") == (other.altitude_frame or "home")
    if same_frame and sheet.altitudes and len(sheet.altitudes) == len(other.altitudes):
        for value, other_value in zip(sheet.altitudes, other.altitudes, strict=True):
            if abs(value - other_value) > 0.011:
                return f"a height of {other_value:g} m instead of {value:g} m"
    return ""
