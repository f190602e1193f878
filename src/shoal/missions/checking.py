"""The check of written missions, against their files and the region."""

from __future__ import annotations

import json
import math
import os
from collections import defaultdict
from collections.abc import Iterator, Sequence
from itertools import count, pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_choice, check_integer, check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.files import write_json
from shoal.missions.approach import (
    Clearance,
    MissionApproach,
    clearance_of,
    missions_approach,
    near_homes,
)
from shoal.missions.diagnostics import RULES, Diagnostic, Sheet
from shoal.missions.files import (
    FORMATS,
    footprint_angle,
    format_of,
    mission_files,
    mission_of,
    open_sheet,
    take_beside,
)
from shoal.missions.formats.fences import FENCE
from shoal.missions.mission import Mission
from shoal.missions.rules import (
    ROUNDING,
    check_elsewhere,
    check_place,
    check_sense,
    inside_of,
    metres_of,
    searching,
    way_of,
)
from shoal.search.flight.separation import Separation
from shoal.search.flight.terrain import Terrain
from shoal.search.flight.timing import leg_seconds
from shoal.search.flight.vehicle import Vehicle, image_of, vehicle_of
from shoal.search.problem import SearchProblem
from shoal.search.problem.mission_options import CAPS
from shoal.search.regions.margin import visible_region
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import AreaCoverage, SearchRegion, coverage_check, together

_SAME_PLACE = 1e-7  # degrees
_SAME_METRES = 0.01
_STEEPEST = 12.0  # degrees: an approach
_ROUGH = 0.01  # relative to the time: what rounded coordinates change on short legs


def lint(
    source: str | os.PathLike[str],
    region: SearchRegion | None = None,
    *,
    cap: int | None = None,
    autopilot: str | None = None,
    vehicle: Vehicle | None = None,
    airspace: float | None = None,
    separation: float | None = None,
    fence_distance: float | None = None,
) -> list[Diagnostic]:
    """Return the mistakes in a mission file, or in all mission files of a folder, including
    contradictions between files.

    Parameters
    ----------
    source : path
        A mission file, or a folder of mission files.
    region : SearchRegion, optional
        The region that the missions search.
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
    sheets = examine(
        source,
        region,
        cap=cap,
        autopilot=autopilot,
        vehicle=vehicle,
        airspace=airspace,
        separation=separation,
        fence_distance=fence_distance,
    )
    return [diagnostic for sheet in sheets for diagnostic in sheet.diagnostics]


def examine(
    source: str | os.PathLike[str],
    region: SearchRegion | None = None,
    *,
    cap: int | None = None,
    autopilot: str | None = None,
    vehicle: Vehicle | None = None,
    airspace: float | None = None,
    separation: float | None = None,
    fence_distance: float | None = None,
) -> list[Sheet]:
    """Return the content of each mission file as a sheet, with the diagnostics that `lint` returns
    for this file.
    """
    if autopilot is not None:
        check_choice(autopilot, what="autopilot", choices=CAPS)
    if cap is not None:
        check_integer(cap, what="cap", least=1)
    folder = Path(source).is_dir()
    paths = mission_files(source) if folder else [Path(source)]
    if not paths:
        raise InvalidInputError(
            f"{source}: expected a folder with mission files, got a folder without mission files"
        )
    sheets = [open_sheet(path) for path in paths]
    if folder:
        take_beside(source, sheets)
    if fence_distance is not None:
        check_number(fence_distance, what="fence_distance", least=0)
        hidden = any(
            not sheet.readable or any(one.rule == "beside" for one in sheet.diagnostics)
            for sheet in sheets
        )
        if not hidden and not any(sheet.fence is not None for sheet in sheets):
            raise InvalidInputError(
                "fence_distance: expected missions with a fence (.plan, or .waypoints beside a"
                f" {FENCE}), got none in {source}"
            )
    for sheet in sheets:
        if sheet.readable:
            check_sense(sheet, cap=cap, autopilot=autopilot, fence_distance=fence_distance)
            _check_curves(sheet, 0.0 if vehicle is None else vehicle.ground_radius)
            if vehicle is not None:
                _check_duration(sheet, vehicle)
            if vehicle is not None and vehicle.radius:
                _check_climbs(sheet, vehicle)
            if region is not None:
                check_place(sheet, region, airspace)
            _check_whole(sheet)
    if folder:
        _check_homes(sheets)
        _check_autopilots(sheets)
        _check_sorties(sheets)
        _check_formats(sheets)
        if separation is not None:
            _check_near_homes(sheets, separation)
    return sheets


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
        if not any(RULES[one.rule].severity == "error" for one in sheet.diagnostics):
            _, _, said = str(error).partition(": expected ")
            sheet.add("invalid", "", f"expected {said}")


def _check_curves(sheet: Sheet, radius: float) -> None:
    """Add diagnostics for turns of a fixed wing that are too narrow, and for a landing that is too
    steep.
    """
    way = way_of(sheet) if sheet.kind == "fixed-wing" else None
    if way is None:
        return
    if (
        sheet.landing is not None
        and sheet.loiter is None
        and sheet.altitudes
        and sheet.altitude_frame != "sea"
    ):
        away = float(np.hypot(*(way[-1] - way[-2])))
        if sheet.altitudes[-1] > away * math.tan(math.radians(_STEEPEST)):
            said = (
                f"expected an approach of at most {_STEEPEST:g} degrees, got"
                f" {sheet.altitudes[-1]:g} m down over {away:.4g} m"
            )
            sheet.add("approach", sheet.places[-1], said)
    numbers = np.flatnonzero(np.hypot(*np.diff(way, axis=0).T) > ROUNDING)
    legs = np.diff(way, axis=0)[numbers]
    lengths, bearings = np.hypot(*legs.T), np.arctan2(legs[:, 1], legs[:, 0])
    bends = np.abs((np.diff(bearings) + math.pi) % (2 * math.pi) - math.pi)
    needs = np.pad(
        radius * np.tan(bends / 2), 1
    )  # a circle that touches both legs begins at this distance before their vertex
    turned = np.pad(
        radius * ROUNDING / lengths, 1
    )  # change of leg directions due to rounded coordinates
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


def _check_duration(sheet: Sheet, vehicle: Vehicle) -> None:
    """Add a diagnostic for a mission that takes longer than the vehicle's endurance without its
    reserve.
    """
    try:
        lasting = mission_of(sheet, sheet.file).duration(vehicle)
    except InvalidInputError as error:
        if str(error).startswith("wind_speed"):  # too slow a flight for the wind
            sheet.add("speed", "", f"expected{str(error).partition('expected')[2]}")
        return  # other rules report what else is invalid, and heights above ground give no climbs
    if lasting > vehicle.usable_seconds:
        said = (
            f"expected a mission of at most {vehicle.usable_seconds / 60:.4g} min, the endurance"
            f" without the reserve, got {lasting / 60:.4g} min"
        )
        sheet.add("endurance", "", said)


def _check_climbs(sheet: Sheet, vehicle: Vehicle) -> None:
    """Add a diagnostic for the steepest leg of a fixed wing if the vehicle cannot climb or sink so
    fast.
    """
    way = (
        way_of(sheet)
        if sheet.kind == "fixed-wing" and len(sheet.altitudes) == len(sheet.points)
        else None
    )
    if way is None or sheet.altitude_frame == "ground":
        return
    base = sheet.elevation or 0.0 if sheet.altitude_frame == "sea" else 0.0
    glides = sheet.landing is not None and sheet.loiter is None
    ups = np.diff(np.array([base, *sheet.altitudes, *[base] * glides]))
    level = np.column_stack([way[: len(ups) + 1], np.zeros(len(ups) + 1)])
    usual = vehicle.cruise if sheet.speed is None else sheet.speed
    speeds = np.array(sheet.speeds or [usual] * (len(ups) + 1))[: len(ups)]
    lasting = leg_seconds(level, vehicle, rate=speeds / vehicle.cruise)
    extra = vehicle.vertical_seconds(
        np.sign(ups) * np.maximum(np.abs(ups) - ROUNDING, 0.0)
    ) - lasting * (1 + _ROUGH)
    worst = int(np.argmax(extra))
    if extra[worst] > 0:
        rate, most = (
            ups[worst] / max(lasting[worst], ROUNDING),
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
    usual = np.median([sheet.home for sheet in readable if sheet.home is not None], axis=0)
    for sheet in readable:
        assert sheet.home is not None
        check_elsewhere(sheet, sheet.home, usual, "the other missions' home", "home")


def _check_near_homes(sheets: list[Sheet], separation: float) -> None:
    """Add a diagnostic for each format in which homes or landing points of two vehicles are nearer
    than ``separation`` metres.
    """
    by_format: dict[str, list[Sheet]] = defaultdict(list)
    for sheet in sheets:
        if sheet.readable and sheet.robot is not None:
            by_format[Path(sheet.file).suffix].append(sheet)
    for alike in by_format.values():
        try:
            frame = (
                LocalFrame(*alike[0].home)
                if alike[0].geographic and alike[0].home is not None
                else None
            )
            found = near_homes(_homes(alike), separation, frame)
        except InvalidInputError:
            continue  # homes too far apart for a local frame; other rules report them
        if found is not None:
            sheet = min(
                (sheet for sheet in alike if sheet.robot == found.robots[1]),
                key=lambda sheet: sheet.sortie or 0,
            )
            sheet.add("homes-near", "", str(found))


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
    """For each file format, add a diagnostic for each robot whose sortie numbers have a gap."""
    numbers: dict[tuple[str, int], dict[int, Sheet]] = defaultdict(dict)
    for sheet in sheets:
        if sheet.robot is not None and sheet.sortie is not None:
            numbers[Path(sheet.file).suffix, sheet.robot][sheet.sortie] = sheet
    for (_, robot), found in numbers.items():
        missing = next(number for number in count(1) if number not in found)
        if missing < max(found):
            sheet = found[max(found)]
            sheet.add(
                "sortie-missing",
                "",
                f"expected sorties 1 to {max(found)} of robot {robot}, got none with number"
                f" {missing}",
            )


def _check_formats(sheets: list[Sheet]) -> None:
    """Add diagnostics for files that contradict another file of the same sortie."""
    first: dict[tuple[int, int], Sheet] = {}
    for sheet in sheets:
        if not sheet.readable or sheet.robot is None or sheet.sortie is None:
            continue
        known = first.setdefault((sheet.robot, sheet.sortie), sheet)
        what = _difference(known, sheet)
        if what:
            sheet.add("formats-differ", "", f"expected the content of {known.file}, got {what}")


def _difference(one: Sheet, other: Sheet) -> str:
    """Return a text about the difference between two sheets of one sortie, or an empty text if the
    sheets agree.
    """
    same = _SAME_PLACE if one.geographic else _SAME_METRES
    if one.geographic != other.geographic:
        return "metres beside degrees"
    if len(one.points) != len(other.points):
        return f"{len(other.points)} waypoints instead of {len(one.points)}"
    apart = np.abs(
        np.vstack([one.points, np.array([one.home])])
        - np.vstack([other.points, np.array([other.home])])
    ).max(axis=1)
    if apart[-1] > same:
        return "another home"
    if (apart > same).any():
        return f"another place at {other.places[int(np.argmax(apart > same))]}"
    for name in ("autopilot", "kind", "speed", "waypoints_out", "waypoints_home"):
        mine, theirs = getattr(one, name), getattr(other, name)
        if None not in (mine, theirs) and mine != theirs:
            return f"{theirs!r} as {name} instead of {mine!r}"
    if one.speeds != other.speeds and None not in (one.speed, other.speed):
        return "other speeds on some legs"
    same_frame = (one.altitude_frame or "home") == (other.altitude_frame or "home")
    if same_frame and one.altitudes and len(one.altitudes) == len(other.altitudes):
        for mine, theirs in zip(one.altitudes, other.altitudes, strict=True):
            if abs(mine - theirs) > 0.011:
                return f"a height of {theirs:g} m instead of {mine:g} m"
    return ""


_RAISED = 0.1  # metres: tolerance for being below a band
_ROUNDED = 0.05  # tenths of a degree: error of leg directions due to rounded coordinates


@dataclass(frozen=True, eq=False)
class MissionCheck:
    """The result of the function `check_missions`.

    Parameters
    ----------
    region : SearchRegion
    format : str
        Format of the mission files whose coverage was checked.
    files : tuple of str
        Names of the checked files: all readable mission files of the format ``format``.
    diagnostics : tuple of Diagnostic
        The diagnostics of all mission files in the folder.
    coverages : tuple of AreaCoverage
        The coverage of each altitude band or, without bands, a single coverage. Without a
        footprint, the tuple is empty.
    n_waypoints : int
        Number of waypoints in all checked files.
    footprint : float, tuple of float or None
        Side of the footprint in metres: one number for all robots, or one number for each robot.
    missions : tuple of Mission
        The checked missions, except for missions whose altitudes are given above ground.
    separation : Separation or None
        The required separation of vehicles in flight.
    approach : MissionApproach or None
        The nearest approach of two vehicles. The approach is None without a required separation, or
        if all vehicles always keep the vertical separation.
    bands : tuple of float
        Altitudes in metres from each of which vehicles must see the whole region.
    clearance : Clearance or None
        Smallest and largest height of vehicles above ground, or None without a terrain.
    flights : tuple of dict
        Duration and usable fraction of each mission in ``missions``, as in `Mission.flight_report`;
        empty without a vehicle.
    """

    region: SearchRegion
    format: str
    files: tuple[str, ...]
    diagnostics: tuple[Diagnostic, ...]
    coverages: tuple[AreaCoverage, ...]
    n_waypoints: int
    footprint: float | tuple[float, ...] | None
    missions: tuple[Mission, ...] = ()
    separation: Separation | None = None
    approach: MissionApproach | None = None
    bands: tuple[float, ...] = ()
    clearance: Clearance | None = None
    flights: tuple[dict[str, Any], ...] = ()

    @property
    def coverage(self) -> AreaCoverage | None:
        """The coverage of all altitude bands together, or None without a footprint."""
        return together(self.coverages) if self.coverages else None

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        """The diagnostics that are errors, without the warnings."""
        return tuple(
            diagnostic for diagnostic in self.diagnostics if diagnostic.severity == "error"
        )

    def report(self) -> dict[str, Any]:
        """Return the whole result as a mapping that can be written as JSON, without geometries."""
        seen = self.coverage
        return {
            "region": self.region.name,
            "area_m2": self.region.area_m2,
            "margin_m": self.region.margin,
            "unseen_m2": self.region.unseen_m2,
            "no_go_zones": self.region.no_go_zones,
            "format": self.format,
            "files": list(self.files),
            "waypoints": self.n_waypoints,
            "footprint_m": (
                list(self.footprint) if isinstance(self.footprint, tuple) else self.footprint
            ),
            **{
                name: getattr(seen, name, None)
                for name in ("length_m", "covered_fraction", "uncovered_m2", "outside_m")
            },
            "bands": [
                {
                    "altitude_m": up,
                    "covered_fraction": one.covered_fraction,
                    "uncovered_m2": one.uncovered_m2,
                }
                for up, one in zip(self.bands, self.coverages, strict=False)
            ],
            "separation_m": (
                None
                if self.separation is None
                else [self.separation.horizontal, self.separation.vertical]
            ),
            "delay_tolerance_s": None if self.separation is None else self.separation.delay,
            "nearest_approach": (
                None if self.approach is None else self.approach.report(self.region.frame)
            ),
            "above_ground": (
                None if self.clearance is None else self.clearance.report(self.region.frame)
            ),
            "flights": list(self.flights),
            "errors": len(self.errors),
            "warnings": len(self.diagnostics) - len(self.errors),
            "diagnostics": [diagnostic.report() for diagnostic in self.diagnostics],
        }

    def write_uncovered(self, path: str | os.PathLike[str]) -> None:
        """Write the uncovered areas as GeoJSON features with the property ``area_m2``, from the
        largest to the smallest.

        Coordinates in the file are in degrees, or in metres for a region in metres. Map programs
        cannot show a file in metres.

        Raises
        ------
        InvalidInputError
            If `check_missions` was called without a footprint.
        OutputError
        """
        import shapely

        if self.coverage is None:
            raise InvalidInputError(
                "uncovered area: expected a check with a footprint, got a check without a footprint"
            )
        parts = [
            part
            for part in shapely.get_parts(self.coverage.uncovered)
            if part.geom_type == "Polygon" and part.area > 0
        ]
        features = []
        for part in sorted(parts, key=lambda part: (-part.area, part.bounds)):
            shape = (
                part
                if self.region.frame is None
                else shapely.transform(part, self.region.frame.to_degrees)
            )
            geometry = json.loads(shapely.to_geojson(shapely.orient_polygons(shape)))
            features.append(
                {"type": "Feature", "properties": {"area_m2": part.area}, "geometry": geometry}
            )
        write_json(path, {"type": "FeatureCollection", "features": features}, indent=None)


def check_missions(
    folder: str | os.PathLike[str],
    region: SearchRegion | str | os.PathLike[str],
    footprint: float | Sequence[float] | None,
    *,
    angle: float | None = None,
    format: str | None = None,  # noqa: A002  # what it is called everywhere else
    cap: int | None = None,
    autopilot: str | None = None,
    separation: Separation | None = None,
    vehicle: Vehicle | str | None = None,
    bands: float | Sequence[float] | None = None,
    airspace: float | None = None,
    terrain: Terrain | None = None,
    fence_distance: float | None = None,
) -> MissionCheck:
    """Read mission files, and measure how much of a region the vehicles see.

    The check does not depend on the planner, because it uses only the waypoints in the files, and
    computes areas with Shapely. The check includes what vehicles see between the first and the last
    waypoint of the search. The check does not include what vehicles see on the paths from home and
    back home, because cameras take no images there.

    Parameters
    ----------
    folder : path
        Folder of mission files.
    region : SearchRegion, str or path
        The region, or a name or file of a region, as in the field ``region`` of a search problem.
    footprint : float, sequence of float or None
        Side in metres of the square that a vehicle sees: one number, or one number for each robot
        in the order of robot numbers. With None, the function only lints the files. If it is the
        row spacing of the camera of ``vehicle``, the vehicle sees the images of this camera, which
        turn with the vehicle.
    angle : float, optional
        Angle of the footprint's sides in degrees, counter-clockwise from east. By default, the
        angle is the one for which the missions were planned according to ``missions.json``, or the
        one that `angle_of` finds.
    format : str, optional
        Format of the files to check. By default, the function checks the first format of
        ``FORMATS`` with a file in ``folder``.
    cap, autopilot, airspace, fence_distance : optional
        The arguments ``cap``, ``autopilot``, ``airspace`` and ``fence_distance`` of `lint`, which
        also receives ``vehicle``.
    separation : Separation, optional
        Required separation of vehicles in flight. With a separation, the function computes the
        nearest approach of two vehicles, and compares the homes and landing points of different
        vehicles.
    vehicle : Vehicle, optional
        Vehicle that gives the speeds of climb and descent, and the duration of turns, for the
        nearest approach. By default, vehicles fly and climb at the speed in the file, and turn in
        no time.
    bands : float or sequence of float, optional
        Altitudes in metres, ascending, from each of which vehicles must see the whole region. A
        section of a flight belongs to the highest band that is not above this section. The argument
        ``footprint`` applies to the lowest band. In higher bands, the footprint grows like the view
        of the vehicle's camera. By default, the bands of a volume are the altitudes of its layers.
    terrain : Terrain, optional
        Terrain from which the function computes heights above ground along all paths.

    Raises
    ------
    InvalidInputError, UnknownNameError
        If the folder has no mission files (of the given format), if a robot has no footprint, or if
        the region is in degrees and a mission in metres, or the reverse.
    """
    if not Path(folder).is_dir():
        raise InvalidInputError(
            f"{folder}: expected a folder of mission files, got"
            f" {'a file' if Path(folder).exists() else 'none'}"
        )
    region = region if isinstance(region, SearchRegion) else SearchProblem(region).place
    vehicle = None if vehicle is None else vehicle_of(vehicle)
    bands = (bands,) if isinstance(bands, int | float) else bands
    apart = None if separation is None else separation.horizontal
    sheets = examine(
        folder,
        region,
        cap=cap,
        autopilot=autopilot,
        vehicle=vehicle,
        airspace=airspace,
        separation=apart,
        fence_distance=fence_distance,
    )
    if terrain is not None:  # it tells the height above ground
        for sheet in sheets:
            sheet.diagnostics = [one for one in sheet.diagnostics if one.rule != "below-home"]
    present = [format_of(Path(sheet.file)) for sheet in sheets]
    if format is not None:
        FORMATS.get(format)
    chosen = present[0] if format is None else format
    if chosen not in present:
        raise InvalidInputError(f"{folder}: expected files of the format {chosen!r}, got none")
    flown = [
        sheet
        for sheet, name in zip(sheets, present, strict=True)
        if name == chosen and sheet.readable
    ]
    coverages: tuple[AreaCoverage, ...] = ()
    if footprint is not None:
        image = None if vehicle is None or footprint != vehicle.row_spacing else image_of(vehicle)
        sides = np.broadcast_to(_footprints(flown, footprint), (len(flown),))
        ways = [
            _searching_way(sheet, region, side)
            for sheet, side in zip(flown, sides.tolist(), strict=True)
        ]
        planned = footprint_angle(folder) if angle is None else angle
        turned_by = (
            angle_of([run[:, :2] for way in ways for run in _runs(way)])
            if planned is None
            else planned
        )
        least = float(np.min(sides if flown else footprint))
        region = visible_region(region, least, turned_by)
        bands = region.layer_altitudes(least) if bands is None and region.height else bands
        coverages = tuple(
            coverage_check(
                region,
                stretches,
                widths if stretches else least,
                tolerance=ROUNDING,
                angle=turned_by,
                image=image,
            )
            for stretches, widths in _by_band(ways, sides, bands, _spread(bands, vehicle), least)
        )
    found = [mission for sheet in flown if (mission := _mission(sheet, region)) is not None]
    missions = tuple(sorted(found, key=lambda one: (one.robot, one.sortie)))
    low = (
        None
        if terrain is None
        else _clearance(missions, terrain, region, wrong={one.file for one in _errors(sheets)})
    )
    missions = tuple(mission for mission in missions if mission.altitude_frame != "ground")
    flights = {one: None if vehicle is None else _flight(one, vehicle) for one in missions}
    missions = tuple(one for one, told in flights.items() if vehicle is None or told is not None)
    near = (
        None
        if separation is None
        else missions_approach(missions, separation, region.frame, vehicle=vehicle)
    )
    return MissionCheck(
        missions=missions,
        separation=separation,
        approach=near,
        clearance=low,
        flights=tuple(told for told in flights.values() if told is not None),
        region=region,
        format=chosen,
        files=tuple(sheet.file for sheet in flown),
        diagnostics=tuple(diagnostic for sheet in sheets for diagnostic in sheet.diagnostics),
        coverages=coverages,
        bands=tuple(bands or ()),
        n_waypoints=sum(len(sheet.points) for sheet in flown),
        footprint=tuple(footprint) if isinstance(footprint, Sequence) else footprint,
    )


def _mission(sheet: Sheet, region: SearchRegion) -> Mission | None:
    """Return the mission of a sheet, or None if a value is impossible, such as a speed of 0 or a
    waypoint on another continent.

    Diagnostics report such values.
    """
    if way_of(sheet) is None or not np.isfinite(metres_of(sheet, region)).all():
        return None
    try:
        return mission_of(sheet, sheet.file)
    except InvalidInputError:
        return None


def _errors(sheets: Sequence[Sheet]) -> Iterator[Diagnostic]:
    return (one for sheet in sheets for one in sheet.diagnostics if one.severity == "error")


def _clearance(
    missions: Sequence[Mission], terrain: Terrain, region: SearchRegion, *, wrong: set[str]
) -> Clearance | None:
    """Return the clearance of missions above a terrain. A mission of the files ``wrong`` need not
    be above it.
    """
    try:
        return clearance_of(missions, terrain, region.frame)
    except InvalidInputError:
        names = {Path(name).stem for name in wrong}
        right = [mission for mission in missions if mission.name not in names]
        if len(right) == len(missions):
            raise
        return clearance_of(right, terrain, region.frame)


def _flight(mission: Mission, vehicle: Vehicle) -> dict[str, Any] | None:
    """Return the duration of a mission, or None if it is too slow for the wind, as diagnostics
    report.
    """
    try:
        return mission.flight_report(vehicle)
    except InvalidInputError:
        return None


def _runs(way: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return the sections of a path between its points that are too far from the region to be in
    its frame; at least one.
    """
    near = np.isfinite(way).all(axis=1)
    return [run[np.isfinite(run).all(axis=1)] for run in np.split(way, np.flatnonzero(~near))]


def _by_band(
    ways: Sequence[NDArray[np.float64]],
    sides: NDArray[np.float64],
    bands: Sequence[float] | None,
    spread: NDArray[np.float64],
    least: float,
) -> Iterator[tuple[list[NDArray[np.float64]], list[float] | float]]:
    """Yield, for each band, the sections of paths in this band and the footprint on each section.

    For a band without paths, the footprint is ``least``. Without bands, the function yields all
    paths together.
    """
    if not bands:
        runs = [
            (run[:, :2], side)
            for way, side in zip(ways, sides.tolist(), strict=True)
            for run in _runs(way)
            if len(run)
        ]
        yield [run for run, _ in runs], [side for _, side in runs]
        return
    found: list[tuple[list[NDArray[np.float64]], list[float]]] = [([], []) for _ in bands]
    for run, side in (
        (run, side) for way, side in zip(ways, sides.tolist(), strict=True) for run in _runs(way)
    ):
        band = np.searchsorted(bands, run[:, 2] + _RAISED, side="right") - 1
        borders = [0, *(np.flatnonzero(np.diff(band)) + 1).tolist(), len(run)]
        for begin, end in pairwise(borders):
            if begin < end and band[begin] >= 0:
                found[band[begin]][0].append(run[begin:end, :2])
                found[band[begin]][1].append(side * float(spread[band[begin]]))
    for flown, footprints in found:
        yield flown, footprints if flown else least


def _spread(bands: Sequence[float] | None, vehicle: Vehicle | None) -> NDArray[np.float64]:
    """Return the width of the camera's view from each band, divided by the width of the view from
    the lowest band.
    """
    if vehicle is None or vehicle.image_size is None:
        return np.ones(len(bands or ()))
    seen = np.array([vehicle.replaced(altitude=up).row_spacing or 0.0 for up in bands or ()])
    return np.asarray(seen / seen[:1])


def _searching_way(sheet: Sheet, region: SearchRegion, side: float) -> NDArray[np.float64]:
    """Return the waypoints of a mission as positions and altitudes in metres; float64, shape (k,
    3).

    The result leaves out waypoints outside the region on the paths from home and back (see
    `searching`). In their place, the result contains the points where these paths cross the
    region's border. If the sheet gives the numbers of waypoints on these paths, the result leaves
    out only these waypoints. Fixed wings turn outside the region, so that both ends of a leg that
    searches can be outside: their result is the path from the first to the last leg that sees any
    of the region with a footprint ``side`` metres wide.
    """
    import shapely

    way = metres_of(sheet, region)
    near = np.asarray(np.isfinite(way).all(axis=1))
    inside = inside_of(region, way)
    here = searching(inside, sheet.kind)
    ups = np.resize(np.array(sheet.altitudes or [0.0]), len(sheet.points))
    way = np.column_stack([way, ups[np.clip(np.arange(len(way)) - 1, 0, len(ups) - 1)]])
    if sheet.waypoints_out is not None:
        return way[1 + sheet.waypoints_out : len(way) - 1 - (sheet.waypoints_home or 0)]
    if sheet.kind == "fixed-wing":
        usable = near[1:-2] & near[2:-1]
        legs = np.where(
            usable[:, None, None], np.stack([way[1:-2, :2], way[2:-1, :2]], axis=1), 0.0
        )
        seeing = np.flatnonzero(
            usable & shapely.dwithin(region.free, shapely.linestrings(legs), side / 2 + ROUNDING)
        )
        if len(seeing):
            return way[1:-1][seeing[0] : seeing[-1] + 2]
    kept = [way[1:-1][here]]
    if here.start > 0 and inside[here.start + 1] and near[here.start]:
        kept.insert(0, _inner(region, way[here.start + 1], way[here.start])[::-1])
    if here.stop < len(way) - 2 and inside[here.stop] and near[here.stop + 1]:
        kept.append(_inner(region, way[here.stop], way[here.stop + 1]))
    return np.concatenate(kept)


def _inner(
    region: SearchRegion, here: NDArray[np.float64], there: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the first point at which a leg that starts inside the region leaves the region;
    float64, shape (1, 3).

    The result has the altitude of the leg's start.
    """
    import shapely

    pieces = shapely.get_parts(
        shapely.intersection(
            shapely.linestrings([here[:2], there[:2]]), region.free.buffer(0.99 * ROUNDING)
        )
    )
    nearest = pieces[int(np.argmin(shapely.distance(pieces, shapely.points(here[:2]))))]
    ends = shapely.get_coordinates(nearest)
    farthest = ends[int(np.argmax(np.hypot(*(ends - here[:2]).T)))]
    return np.append(farthest, here[2])[None]


def angle_of(ways: Sequence[NDArray[np.float64]]) -> float:
    """Return the angle of the rows of cells: the direction with the largest total length of legs,
    from 0 to below 90 degrees.

    If rounding of coordinates can explain the difference between the angle and a multiple of 0.1
    degrees, the result is this multiple.

    Examples
    --------
    >>> angle_of([np.array([(0.0, 0.0), (100.0, 0.001), (100.0, 10.0), (0.0, 10.0)])])
    0.0
    """
    legs = np.concatenate([np.zeros((0, 2)), *(np.diff(way, axis=0) for way in ways)])
    lengths, tenths = np.hypot(*legs.T), np.degrees(np.arctan2(legs[:, 1], legs[:, 0])) % 90.0 * 10
    if not lengths.sum():
        return 0.0
    mode = float(np.bincount(np.rint(tenths).astype(np.int64) % 900, weights=lengths).argmax())
    away = (tenths - mode + 450) % 900 - 450
    near = np.abs(away) <= 1
    mean = mode + float(np.average(away[near], weights=lengths[near]))
    return (mode if abs(mean - mode) < _ROUNDED else mean) / 10 % 90.0


def _footprints(flown: list[Sheet], footprint: float | Sequence[float]) -> float | list[float]:
    """Return one footprint for all missions, or the footprint of each mission's
    vehicle, in metres.
    """
    if not isinstance(footprint, Sequence):
        return footprint
    for sheet in flown:
        if not 1 <= (sheet.robot or 1) <= len(footprint):
            raise InvalidInputError(
                f"{sheet.file}: expected a robot from 1 to {len(footprint)}, the number of"
                f" footprints, got robot {sheet.robot}"
            )
    return [footprint[(sheet.robot or 1) - 1] for sheet in flown]
