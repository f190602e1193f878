"""The check of written missions: what their files say, against a region and a vehicle."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import count_text
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.files import write_json
from shoal.core.geometry import angles_of, partial_sums, step_lengths
from shoal.missions.approach import (
    Clearance,
    MissionApproach,
    clearance_of,
    heights_along,
    missions_approach,
)
from shoal.missions.camera import base_of, camera_views, ground_at, heights_of
from shoal.missions.diagnostics import Diagnostic, Sheet, group_mistakes
from shoal.missions.files import UNCOVERED, format_of, mission_of
from shoal.missions.formats import FORMATS
from shoal.missions.linting import Limits, lint_sheets
from shoal.missions.mission import Mission
from shoal.missions.options import CheckOptions
from shoal.missions.rules import ROUNDING, inside_of, metres_of, path_of, search_slice
from shoal.search.flight.deviation import deviate
from shoal.search.flight.imaging import swept_views
from shoal.search.flight.terrain import Terrain
from shoal.search.flight.vehicle import Vehicle, image_of
from shoal.search.regions.coverage import (
    TURNING,
    AreaCoverage,
    Image,
    combine_coverages,
    coverage_check,
)
from shoal.search.regions.margin import visible_region, without_margin
from shoal.search.regions.projection import ROUNDED
from shoal.search.regions.region import SearchRegion

Floats = NDArray[np.float64]

_SEEN_WITH_ERRORS = 0.9995  # share of the region, below which a caution says so
_RAISED = 0.1  # metres: tolerance for being below a band
_HAIR = 0.01  # metres: rounding of altitudes in files
_ROUNDED = 0.05  # tenths of a degree: error of leg directions due to rounded coordinates


@dataclass(frozen=True)
class SmallestImage:
    """The image that is smallest in comparison with its planned size, over a terrain.

    Parameters
    ----------
    height : float
        Height above ground in metres from which the camera takes it.
    planned : float
        Height for which the camera is planned.
    file : str
        Name of the mission file.
    """

    height: float
    planned: float
    file: str

    def __str__(self) -> str:
        return (
            f"{self.file} is only {self.height:.3g} m above the ground, where images have"
            f" {max(100 * self.height / self.planned, 0):.3g} % of the width and length for which a"
            f" height of {self.planned:g} m is planned"
        )


@dataclass(frozen=True, eq=False)
class MissionCheck:
    """The result of `MissionSet.check` and of the function `check_missions`.

    Parameters
    ----------
    options : CheckOptions
        What the missions were compared with.
    region : SearchRegion
        The region without what no vehicle can see.
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
    missions : tuple of Mission
        The checked missions.
    approach : MissionApproach or None
        The nearest approach of two vehicles. The approach is None without a required separation, or
        if all vehicles always keep the vertical separation.
    uncompared : tuple of str
        Files of missions that the nearest approach does not include; diagnostics say why.
    bands : tuple of float
        Altitudes in metres from each of which vehicles must see the whole region.
    clearance : Clearance or None
        Smallest and largest height of vehicles above ground, or None without a terrain.
    flights : tuple of dict
        Duration and usable fraction of each mission in ``missions``, as in `Mission.flight_report`;
        empty without a vehicle.
    with_errors : AreaCoverage or None
        The coverage of all altitude bands together if the vehicles cut corners and are wrong about
        their positions, as `deviate` flies them, and what they then fly outside the region without
        its margin. It is None without a footprint, and for a vehicle without such errors.
    distance : float or None
        Smallest distance in metres of paths from no-go zones and, for the legs between waypoints in
        the region, from its border. Fixed wings turn outside the region, so that only zones count
        for them. It is None without a vehicle, or if there is nothing to keep a distance from.
    smallest : SmallestImage or None
        The smallest image over a terrain, or None without a terrain or a camera. The coverage then
        counts images by the least height above ground.
    """

    options: CheckOptions
    region: SearchRegion
    format: str
    files: tuple[str, ...]
    diagnostics: tuple[Diagnostic, ...]
    coverages: tuple[AreaCoverage, ...]
    n_waypoints: int
    missions: tuple[Mission, ...] = ()
    approach: MissionApproach | None = None
    uncompared: tuple[str, ...] = ()
    bands: tuple[float, ...] = ()
    clearance: Clearance | None = None
    flights: tuple[dict[str, Any], ...] = ()
    with_errors: AreaCoverage | None = None
    distance: float | None = None
    smallest: SmallestImage | None = None

    @property
    def cautions(self) -> tuple[str, ...]:
        """Sentences that say by how much vehicles may leave the region or enter a no-go zone because
        of their errors, and how much of the region may stay unseen.
        """
        sentences: list[str] = []
        vehicle = self.options.chosen_vehicle
        if self.distance is not None and vehicle is not None:
            sentences += cautions_about_distance(self.distance, vehicle)
        separation = self.options.required_separation
        if separation is not None and vehicle is not None:
            sentences += cautions_about_circling(self.missions, vehicle, separation.delay)
        low = self.smallest
        if low is not None and low.height < low.planned - self.options.terrain_error:
            sentences.append(
                f"{low}: altitudes above ground (--altitude-frame ground) keep the size"
            )
        if self.with_errors is not None and self.with_errors.covered_fraction < _SEEN_WITH_ERRORS:
            sentences.append(
                f"with errors of positions and cut corners, vehicles see only"
                f" {100 * self.with_errors.covered_fraction:.4g} % of the region: rows are too far"
                " apart for these errors, or paths too far from the border"
            )
        return tuple(sentences)

    @property
    def images(self) -> str | None:
        """What tells which images a camera takes: the commands in the files (``"files"``) or, if
        their format has none, the vehicle (``"vehicle"``); None if no camera sees the region.
        """
        sides, vehicle = self.options.sides, self.options.chosen_vehicle
        if vehicle is None or vehicle.image_size is None or sides != vehicle.row_spacing:
            return None
        return "files" if FORMATS.get(self.format).camera else "vehicle"

    @property
    def coverage(self) -> AreaCoverage | None:
        """The coverage of all altitude bands together, or None without a footprint."""
        return combine_coverages(self.coverages) if self.coverages else None

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        """The diagnostics that are errors, without the warnings."""
        return tuple(
            diagnostic for diagnostic in self.diagnostics if diagnostic.severity == "error"
        )

    @property
    def faults(self) -> list[str]:
        """The reasons why the missions fail the check, one clause for each reason."""
        faults = []
        if self.errors:
            faults.append(
                f"{count_text(len(group_mistakes(self.errors)), 'mistake')} in the mission files"
            )
        if self.coverage is not None and self.coverage.covered_fraction < self.options.least:
            faults.append(
                f"{100 * self.coverage.covered_fraction:.5g} % of the region is seen, less than"
                f" {100 * self.options.least:g} %"
            )
        near, low, separation = self.approach, self.clearance, self.options.required_separation
        if (
            near is not None
            and separation is not None
            and near.horizontal < separation.horizontal - ROUNDING
        ):
            known = near.vertical is not None
            faults.append(
                f"robots {near.robots[0]} and {near.robots[1]} come within {near.horizontal:.3g} m"
                f"{'' if known else ', and their difference in height is unknown'}"
            )
        if low is not None and low.lowest <= 0:
            faults.append(f"{low.missions[0]} meets the ground")
        if low is not None and low.error > self.options.terrain_error:
            faults.append(
                "heights above ground differ from the altitudes asked for by up to"
                f" {low.error:.3g} m"
            )
        return faults

    def report(self) -> dict[str, Any]:
        """Return the whole result as a mapping that can be written as JSON, without geometries."""
        seen, separation, sides = (
            self.coverage,
            self.options.required_separation,
            self.options.sides,
        )
        return {
            "region": self.region.name,
            "area_m2": self.region.area_m2,
            "margin_m": self.region.margin,
            "unseen_m2": self.region.unseen_m2,
            "no_go_zones": self.region.no_go_zones,
            "format": self.format,
            "files": list(self.files),
            "waypoints": self.n_waypoints,
            "footprint_m": list(sides) if isinstance(sides, tuple) else sides,
            "images": self.images,
            **{
                name: getattr(seen, name, None)
                for name in ("length_m", "covered_fraction", "uncovered_m2", "outside_m")
            },
            "with_errors": (
                None
                if self.with_errors is None
                else {
                    name: getattr(self.with_errors, name)
                    for name in ("covered_fraction", "uncovered_m2", "outside_m")
                }
            ),
            "distance_m": self.distance,
            "cautions": list(self.cautions),
            "bands": [
                {
                    "altitude_m": up,
                    "covered_fraction": coverage.covered_fraction,
                    "uncovered_m2": coverage.uncovered_m2,
                }
                for up, coverage in zip(self.bands, self.coverages, strict=False)
            ],
            "separation_m": (
                None if separation is None else [separation.horizontal, separation.vertical]
            ),
            "delay_tolerance_s": None if separation is None else separation.delay,
            "nearest_approach": (
                None if self.approach is None else self.approach.report(self.region.frame)
            ),
            "not_compared": list(self.uncompared),
            "above_ground": (
                None if self.clearance is None else self.clearance.report(self.region.frame)
            ),
            "flights": list(self.flights),
            "errors": len(self.errors),
            "warnings": len(self.diagnostics) - len(self.errors),
            "diagnostics": [diagnostic.report() for diagnostic in self.diagnostics],
        }

    def write(self, folder: str | os.PathLike[str]) -> list[Path]:
        """Write the report as ``check.json`` and, if the coverage was measured, the uncovered areas
        as ``uncovered.geojson``. Return the written files.
        """
        paths = [Path(folder) / "check.json"]
        write_json(paths[0], self.report())
        if self.coverage is not None:
            paths.append(Path(folder) / UNCOVERED)
            self.write_uncovered(paths[1])
        return paths

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


def check_sheets(sheets: list[Sheet], options: CheckOptions) -> MissionCheck:
    """Lint mission files, and measure how much of a region the vehicles see.

    The check does not depend on the planner, because it uses only the waypoints in the files, and
    computes areas with Shapely. The check includes what vehicles see between the first and the last
    waypoint of the search. The check does not include what vehicles see on the paths from home and
    back home, because cameras take no images there.

    Raises
    ------
    InvalidInputError, UnknownNameError
        If there are no files of the asked format, if a robot has no footprint, or if the region is
        in degrees and a mission in metres, or the reverse.
    """
    region: SearchRegion = options.place
    vehicle, separation, terrain = (
        options.chosen_vehicle,
        options.required_separation,
        options.open_terrain(),
    )
    lint_sheets(
        sheets,
        region,
        Limits(
            options.cap,
            options.autopilot,
            vehicle,
            options.airspace,
            None if separation is None else separation.horizontal,
            options.fence_distance,
        ),
    )
    if terrain is not None:  # it tells the height above ground
        for sheet in sheets:
            _check_rally_heights(sheet, terrain, region)
            sheet.diagnostics = [
                diagnostic for diagnostic in sheet.diagnostics if diagnostic.rule != "below-home"
            ]
    present = [format_of(Path(sheet.file)) for sheet in sheets]
    if options.format is not None:
        FORMATS.get(options.format)
    chosen = options.format or present[0]
    if chosen not in present:
        raise InvalidInputError(f"missions: expected files of the format {chosen!r}, got none")
    flown = [
        sheet
        for sheet, name in zip(sheets, present, strict=True)
        if name == chosen and sheet.readable
    ]
    _check_chosen_format(sheets, present, chosen)
    smallest = _smallest_image(flown, region, options, terrain)
    coverages, errors, bands, region = _coverages(flown, region, options, terrain)
    read = [
        mission for sheet in flown if (mission := _read_mission(sheet, region, vehicle)) is not None
    ]
    missions = tuple(sorted(read, key=lambda mission: (mission.robot, mission.sortie)))
    clearance = (
        None
        if terrain is None
        else _clearance(
            missions, terrain, region, wrong={diagnostic.file for diagnostic in _errors(sheets)}
        )
    )
    flights: tuple[dict[str, Any], ...] = ()
    if vehicle is not None:
        reports = {mission: _flight_report(mission, vehicle) for mission in missions}
        missions = tuple(mission for mission, report in reports.items() if report is not None)
        flights = tuple(report for report in reports.values() if report is not None)
    compared = {(mission.robot, mission.sortie) for mission in missions}
    left_out = {
        (sheet.robot, sheet.sortie): sheet.file
        for sheet in reversed(sheets)
        if (sheet.robot, sheet.sortie) not in compared
    }
    return MissionCheck(
        options=options,
        region=region,
        format=chosen,
        files=tuple(sheet.file for sheet in flown),
        diagnostics=tuple(diagnostic for sheet in sheets for diagnostic in sheet.diagnostics),
        coverages=coverages,
        n_waypoints=sum(len(sheet.points) for sheet in flown),
        missions=missions,
        approach=(
            None
            if separation is None
            else missions_approach(missions, separation, region.frame, vehicle=vehicle)
        ),
        uncompared=tuple(sorted(left_out.values())),
        bands=bands,
        clearance=clearance,
        flights=flights,
        with_errors=errors,
        distance=(
            None
            if vehicle is None
            else distance_of([metres_of(sheet, region) for sheet in flown], vehicle.kind, region)
        ),
        smallest=smallest,
    )


def _check_rally_heights(sheet: Sheet, terrain: Terrain, region: SearchRegion) -> None:
    """Add diagnostics for rally points that are not above the ground of a terrain."""
    if not sheet.readable or not sheet.rally or sheet.kind == "rover" or sheet.home is None:
        return
    for number, (x, y, up) in enumerate(sheet.rally, start=1):
        points = np.array([sheet.home, (x, y)])
        try:
            places = points if region.frame is None else region.frame.to_metres(points)
            base, ground = terrain.at(places, region.frame).tolist()
        except InvalidInputError:
            got = "one beside it"
        else:
            got = f"one {base + up - ground:.3g} m above it"
            if base + up > ground:
                continue
        sheet.add(
            "rally", f"rally point {number}", f"expected rally points above the ground, got {got}"
        )


def seen_over_ground(
    sheets: list[Sheet], options: CheckOptions
) -> tuple[float, float, SmallestImage] | None:
    """Return which share of a region a camera sees over the terrain of ``options``, the share over
    flat ground, and the smallest image; or None where no image is smaller than planned.
    """
    terrain, region = options.open_terrain(), options.place
    smallest = _smallest_image(sheets, region, options, terrain)
    if smallest is None or smallest.height >= smallest.planned - _HAIR:
        return None
    over, flat = (
        combine_coverages(_coverages(sheets, region, options, ground)[0]).covered_fraction
        for ground in (terrain, None)
    )
    return over, flat, smallest


def _check_chosen_format(sheets: Sequence[Sheet], formats: Sequence[str], chosen: str) -> None:
    """Add diagnostics for missions that have files only in other formats than the chosen one."""
    found = {
        (sheet.robot, sheet.sortie)
        for sheet, name in zip(sheets, formats, strict=True)
        if name == chosen
    }
    for sheet in sheets:
        if (sheet.robot, sheet.sortie) not in found:
            found.add((sheet.robot, sheet.sortie))
            sheet.add(
                "format-missing",
                "",
                f"expected a file of this mission in the format {chosen!r}, which the check"
                " measures, got none: nothing of it is measured",
            )


def cautions_about_distance(distance: float, vehicle: Vehicle) -> list[str]:
    """Return a sentence that says how far vehicles may be outside, or none if paths keep so far from
    borders and no-go zones that the errors of the vehicles do not matter.

    Examples
    --------
    >>> from shoal.search.flight.vehicle import vehicle_of
    >>> cautions_about_distance(3.0, vehicle_of("multirotor"))
    []
    >>> len(cautions_about_distance(1.0, vehicle_of("multirotor")))
    1
    """
    beyond = vehicle.clearance - distance
    if beyond <= ROUNDED:
        return []
    return [
        f"paths come within {distance:.3g} m of a border or a no-go zone, and with errors of positions"
        f" and cut corners, a vehicle may be {vehicle.clearance:g} m off its path: up to"
        f" {beyond:.3g} m outside of the region or in the zone"
    ]


def cautions_about_circling(
    missions: Sequence[Mission], vehicle: Vehicle, tolerance: float
) -> list[str]:
    """Return a sentence about the vehicle that would circle longest beyond its battery, or none.

    A vehicle whose mission ends with loitering circles until somebody lands it. Separation holds as
    long as it circles, which is until all others have landed.
    """
    if not np.isfinite(vehicle.usable_seconds) or all(one.loiter is None for one in missions):
        return []
    down = [(one.start or 0.0) + one.duration(vehicle) + tolerance for one in missions]
    aloft, robot = max(
        (max(down) - (one.start or 0.0), one.robot) for one in missions if one.loiter is not None
    )
    if aloft <= vehicle.usable_seconds:
        return []
    return [
        f"robot {robot} circles until the last vehicle is down, up to {aloft / 60:.3g} min after its"
        f" start, and its battery allows {vehicle.usable_seconds / 60:.3g} min: earlier landings are"
        " not kept apart from other vehicles, unless all have landing points (--land)"
    ]


def distance_of(
    paths: Sequence[NDArray[np.float64]], kind: str | None, region: SearchRegion
) -> float | None:
    """Return the smallest distance in metres of missions from what vehicles must not cross, as in
    `MissionCheck`, or None if there is nothing.

    Parameters
    ----------
    paths : sequence of ndarray of float64, shape (n, 2)
        Home, the waypoints and the end of each mission in metres.
    kind : str or None
        The kind of the vehicles.
    region : SearchRegion
    """
    import shapely

    outline = without_margin(region).free
    allowed = outline.buffer(ROUNDING)
    shapely.prepare(allowed)
    distances = [np.inf]
    for path in paths:
        ends = np.stack([path[:-1], path[1:]], axis=1)
        finite = np.asarray(np.isfinite(ends).all(axis=(1, 2)))
        if not region.no_go.is_empty:
            distances += shapely.distance(shapely.linestrings(ends[finite]), region.no_go).tolist()
        if kind != "fixed-wing":
            legs = shapely.linestrings(ends[1:-1][finite[1:-1]])
            legs = legs[np.asarray(shapely.covers(allowed, legs))]
            distances += shapely.distance(legs, outline.boundary).tolist()
            # a mission of one waypoint has no legs, and legs that leave the region have no distance
            waypoints = path[1:-1]
            waypoints = shapely.points(waypoints[np.isfinite(waypoints).all(axis=1)])
            inside = np.asarray(shapely.covers(allowed, waypoints))
            distances += shapely.distance(waypoints[inside], outline.boundary).tolist()
            distances += [0.0] * int(np.count_nonzero(~inside))
    least = min(distances)
    return None if least == np.inf else least


def _coverages(
    flown: list[Sheet],
    region: SearchRegion,
    options: CheckOptions,
    terrain: Terrain | None = None,
) -> tuple[tuple[AreaCoverage, ...], AreaCoverage | None, tuple[float, ...], SearchRegion]:
    """Return the coverage of each altitude band, the coverage with the errors of the vehicles, the
    bands, and the region that can be seen.
    """
    footprint, vehicle, bands = options.sides, options.chosen_vehicle, options.bands
    if footprint is None:
        return (), None, (), region
    image = None if vehicle is None or footprint != vehicle.row_spacing else image_of(vehicle)
    sides = np.broadcast_to(_footprints(flown, footprint), (len(flown),))
    paths = [
        _search_path(sheet, region, side, terrain)
        for sheet, side in zip(flown, sides.tolist(), strict=True)
    ]
    facing = options.angle
    if facing is None:
        facing = next((sheet.footprint_angle for sheet in flown), None)
    angle, image = facing_of(facing, image, [run[:, :2] for path in paths for run in _runs(path)])
    least = float(np.min(sides if flown else footprint))
    region = visible_region(region, least, angle)
    if bands is None and region.height:
        bands = region.layer_altitudes(least)
    stretches = [*_by_band(paths, sides, bands)]
    checked: dict[str, Any] = {"tolerance": ROUNDING, "angle": angle, "image": image}
    views: Sequence[Any] = [None] * len(stretches)
    if vehicle is not None and vehicle.image_size is not None and image is not None:
        views = _views_by_band(flown, region, vehicle, bands, terrain)
    coverages = tuple(
        coverage_check(
            region, [path[:, :2] for path in own], widths or least, **checked, views=seen
        )
        for (own, widths), seen in zip(stretches, views, strict=True)
    )
    errors = None
    if vehicle is not None and vehicle.cross_track:
        camera = views[0] is not None
        errors = _coverage_with_errors(stretches, vehicle, region, least, checked, camera=camera)
        if camera:
            errors = _seen_in_both(errors, combine_coverages(coverages))
    return coverages, errors, tuple(bands or ()), region


class _Heights(NamedTuple):
    """The heights of a mission above the ground of a terrain, between points of its search: the
    least ones, and those for which the camera is planned; each float64, shape (m,).
    """

    number: int
    above: NDArray[np.float64]
    planned: NDArray[np.float64]


def _heights_over(
    flown: Sequence[Sheet],
    paths: Sequence[NDArray[np.float64]],
    region: SearchRegion,
    vehicle: Vehicle,
    bands: Sequence[float] | None,
    terrain: Terrain,
) -> Iterator[_Heights]:
    """Yield the heights above ground of the search path of each mission."""
    planned = np.array(bands or (vehicle.height,))
    for number, (sheet, path) in enumerate(zip(flown, paths, strict=True)):
        base: Any = base_of(sheet, ground_at(terrain, metres_of(sheet, region)[0], region))
        for near in _runs(path[:, :3]):
            if not len(near):
                continue
            run = np.repeat(near, 2, axis=0) if len(near) == 1 else near.copy()
            if not sheet.altitudes:
                run[:, 2] = planned[0]
            try:
                if sheet.altitude_frame == "ground":
                    base = terrain.at(run[:, :2], region.frame)
                if not np.isfinite(base).all():
                    continue  # home beside the terrain
                raised = run + np.multiply.outer(base, (0, 0, 1))
                points, above = heights_along(raised, terrain, region.frame)
            except InvalidInputError:
                continue  # beside the terrain: it counts as unseen, and the clearance says so
            far, own = (partial_sums(step_lengths(one[:, :2])) for one in (points, run))
            levels = np.interp(far, own, run[:, 2])
            band = np.searchsorted(planned, levels[:-1] + _RAISED, side="right") - 1
            yield _Heights(number, above, planned[np.maximum(band, 0)])


def _smallest_image(
    flown: Sequence[Sheet], region: SearchRegion, options: CheckOptions, terrain: Terrain | None
) -> SmallestImage | None:
    """Return the image over a terrain that is smallest in comparison with its planned size, or None
    without a terrain or a camera.
    """
    vehicle, bands = options.chosen_vehicle, options.bands
    side = None if vehicle is None or vehicle.image_size is None else vehicle.row_spacing
    if terrain is None or vehicle is None or side is None or options.sides != side:
        return None
    if bands is None and region.height:
        bands = region.layer_altitudes(side)
    paths = [_search_path(sheet, region, side, terrain) for sheet in flown]
    smallest: SmallestImage | None = None
    for one in _heights_over(flown, paths, region, vehicle, bands, terrain):
        worst = int(np.argmin(one.above / one.planned))
        height, planned = float(one.above[worst]), float(one.planned[worst])
        if smallest is None or height / planned < smallest.height / smallest.planned:
            smallest = SmallestImage(height, planned, flown[one.number].file)
    return smallest


def _views_by_band(
    flown: Sequence[Sheet],
    region: SearchRegion,
    vehicle: Vehicle,
    bands: Sequence[float] | None,
    terrain: Terrain | None,
) -> list[Any]:
    """Return what the camera sees from each band, or from everywhere without bands."""
    seen: list[list[Any]] = [[np.zeros(0, dtype=object)] for _ in bands or (0.0,)]
    for sheet in flown:
        shapes, ups = camera_views(sheet, region, vehicle, terrain)
        if not bands:
            seen[0].append(shapes)
            continue
        lower, upper = (np.searchsorted(bands, end + _RAISED, side="right") - 1 for end in ups.T)
        for number, own in enumerate(seen):
            own.append(shapes[(lower == number) & (upper == number)])
    return [np.concatenate(own) for own in seen]


def _seen_in_both(errors: AreaCoverage, coverage: AreaCoverage) -> AreaCoverage:
    """Return a coverage with errors, without what a camera does not see without them either: it
    takes no image, or none there.
    """
    import shapely

    uncovered = shapely.union(errors.uncovered, coverage.uncovered)
    area = max(float(uncovered.area), errors.uncovered_m2, coverage.uncovered_m2)
    return replace(
        errors,
        uncovered=uncovered,
        uncovered_m2=area,
        covered_fraction=1 - area / errors.area_m2,
    )


def _coverage_with_errors(
    stretches: Sequence[tuple[list[NDArray[np.float64]], list[float]]],
    vehicle: Vehicle,
    region: SearchRegion,
    least: float,
    checked: dict[str, Any],
    *,
    camera: bool,
) -> AreaCoverage:
    """Return the coverage of paths that a vehicle flies with its errors. Outside is what paths that
    are planned inside the region fly outside of it.
    """
    import shapely

    rng, inside = np.random.default_rng(0), without_margin(region).free.buffer(ROUNDING)
    shapely.prepare(inside)
    coverages, outside = [], 0.0
    for own, widths in stretches:
        flown = [deviate(path[:, :2], vehicle, rng) for path in own]
        for planned, path in zip(own, flown, strict=True):
            if len(path) > 1 and inside.covers(shapely.linestrings(planned[:, :2])):
                line = shapely.linestrings(path)
                if not inside.covers(line):
                    outside += float(line.difference(inside).length)
        seen = None
        if camera:  # its view without interruption, as corners are at other places
            seen = _swept([*zip(own, flown, strict=True)], vehicle)
        coverages.append(coverage_check(region, flown, widths or least, **checked, views=seen))
    return replace(combine_coverages(coverages), outside_m=outside)


def _swept(paths: Sequence[tuple[Floats, Floats]], vehicle: Vehicle) -> Any:
    """Return what a camera sees along each leg of deviating paths, from the heights of the paths
    that they deviate from.
    """
    starts, ends = [np.zeros((0, 3))], [np.zeros((0, 3))]
    for planned, path in paths:
        far, along = (partial_sums(step_lengths(one[:, :2])) for one in (planned, path))
        ups = np.interp(along / max(along[-1], 1e-9) * far[-1], far, planned[:, 3])
        raised = np.column_stack([path, ups])
        starts.append(raised[:-1] if len(raised) > 1 else raised)
        ends.append(raised[1:] if len(raised) > 1 else raised)
    return swept_views(np.concatenate(starts), np.concatenate(ends), vehicle)


def facing_of(
    facing: float | str | None, image: Image | None, paths: Sequence[NDArray[np.float64]]
) -> tuple[float, Image | None]:
    """Return the angle of footprints, and the image of a camera or of footprints that turn with
    their vehicles.

    The angle ``facing`` is a number of degrees, `TURNING`, or None for the direction of most legs
    of ``paths``.
    """
    if facing == TURNING and image is None:
        image = Image(1.0, 1.0)
    angle = angle_of(paths) if facing is None or isinstance(facing, str) else facing
    return angle, image


def _read_mission(sheet: Sheet, region: SearchRegion, vehicle: Vehicle | None) -> Mission | None:
    """Return the mission of a sheet, or None if a value is impossible, such as a speed of 0 or a
    waypoint on another continent.

    Diagnostics report such values.
    """
    if path_of(sheet) is None or not np.isfinite(metres_of(sheet, region)).all():
        return None
    try:
        return mission_of(sheet, sheet.file, vehicle)
    except InvalidInputError:
        return None


def _errors(sheets: Sequence[Sheet]) -> Iterator[Diagnostic]:
    return (
        diagnostic
        for sheet in sheets
        for diagnostic in sheet.diagnostics
        if diagnostic.severity == "error"
    )


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


def _flight_report(mission: Mission, vehicle: Vehicle) -> dict[str, Any] | None:
    """Return the duration of a mission, or None if it is too slow for the wind, as diagnostics
    report.
    """
    try:
        return mission.flight_report(vehicle)
    except InvalidInputError:
        return None


def _runs(path: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return the sections of a path between its points that are too far from the region to be in
    its frame; at least one.
    """
    near = np.isfinite(path).all(axis=1)
    return [run[np.isfinite(run).all(axis=1)] for run in np.split(path, np.flatnonzero(~near))]


def _by_band(
    paths: Sequence[NDArray[np.float64]],
    sides: NDArray[np.float64],
    bands: Sequence[float] | None,
) -> Iterator[tuple[list[NDArray[np.float64]], list[float]]]:
    """Yield, for each band, the sections of paths in this band and the footprint on each section.

    Without bands, the function yields all paths together.
    """
    runs = [
        (run, side)
        for path, side in zip(paths, sides.tolist(), strict=True)
        for run in _runs(path)
        if len(run)
    ]
    if not bands:
        yield [run for run, _ in runs], [side for _, side in runs]
        return
    sections: list[tuple[list[NDArray[np.float64]], list[float]]] = [([], []) for _ in bands]
    for run, side in runs:
        band = np.searchsorted(bands, run[:, 2] + _RAISED, side="right") - 1
        borders = [0, *(np.flatnonzero(np.diff(band)) + 1).tolist(), len(run)]
        for begin, end in pairwise(borders):
            if begin < end and band[begin] >= 0:
                sections[band[begin]][0].append(run[begin:end])
                sections[band[begin]][1].append(side)
    yield from sections


def _search_path(
    sheet: Sheet, region: SearchRegion, side: float, terrain: Terrain | None
) -> NDArray[np.float64]:
    """Return the waypoints of a mission as positions, altitudes and heights above the ground in
    metres; float64, shape (k, 4).

    The result leaves out waypoints outside the region on the paths from home and back (see
    `search_slice`). In their place, the result contains the points where these paths cross the
    region's border. If the sheet gives the numbers of waypoints on these paths, the result leaves
    out only these waypoints. Fixed wings turn outside the region, so that both ends of a leg that
    searches can be outside: their result is the path from the first to the last leg that sees any
    of the region with a footprint ``side`` metres wide.
    """
    import shapely

    path = metres_of(sheet, region)
    near = np.asarray(np.isfinite(path).all(axis=1))
    inside = inside_of(region, path)
    searched = search_slice(inside, sheet.kind)
    path = np.column_stack([path, *heights_of(sheet, path, terrain, region)])
    if sheet.waypoints_out is not None:
        return path[1 + sheet.waypoints_out : len(path) - 1 - (sheet.waypoints_home or 0)]
    if sheet.kind == "fixed-wing":
        usable = near[1:-2] & near[2:-1]
        legs = np.where(
            usable[:, None, None], np.stack([path[1:-2, :2], path[2:-1, :2]], axis=1), 0.0
        )
        seeing = np.flatnonzero(
            usable & shapely.dwithin(region.free, shapely.linestrings(legs), side / 2 + ROUNDING)
        )
        if len(seeing):
            return path[1:-1][seeing[0] : seeing[-1] + 2]
    pieces = [path[1:-1][searched]]
    if searched.start > 0 and inside[searched.start + 1] and near[searched.start]:
        pieces.insert(
            0, _border_crossing(region, path[searched.start + 1], path[searched.start])[::-1]
        )
    if searched.stop < len(path) - 2 and inside[searched.stop] and near[searched.stop + 1]:
        pieces.append(_border_crossing(region, path[searched.stop], path[searched.stop + 1]))
    return np.concatenate(pieces)


def _border_crossing(
    region: SearchRegion, start: NDArray[np.float64], end: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the first point at which a leg that starts inside the region leaves the region;
    float64, shape (1, 4).

    The result has the altitude of the leg's start.
    """
    import shapely

    pieces = shapely.get_parts(
        shapely.intersection(
            shapely.linestrings([start[:2], end[:2]]), region.free.buffer(0.99 * ROUNDING)
        )
    )
    nearest = pieces[int(np.argmin(shapely.distance(pieces, shapely.points(start[:2]))))]
    ends = shapely.get_coordinates(nearest)
    farthest = ends[int(np.argmax(np.hypot(*(ends - start[:2]).T)))]
    return np.append(farthest, start[2:])[None]


def angle_of(paths: Sequence[NDArray[np.float64]]) -> float:
    """Return the angle of the rows of cells: the direction with the largest total length of legs,
    from 0 to below 90 degrees.

    If rounding of coordinates can explain the difference between the angle and a multiple of 0.1
    degrees, the result is this multiple.

    Examples
    --------
    >>> angle_of([np.array([(0.0, 0.0), (100.0, 0.001), (100.0, 10.0), (0.0, 10.0)])])
    0.0
    """
    legs = np.concatenate([np.zeros((0, 2)), *(np.diff(path, axis=0) for path in paths)])
    lengths, tenths = np.hypot(*legs.T), np.degrees(angles_of(legs)) % 90.0 * 10
    if not lengths.sum():
        return 0.0
    mode = float(np.bincount(np.rint(tenths).astype(np.int64) % 900, weights=lengths).argmax())
    deviations = (tenths - mode + 450) % 900 - 450
    near = np.abs(deviations) <= 1
    mean = mode + float(np.average(deviations[near], weights=lengths[near]))
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
