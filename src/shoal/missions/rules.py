"""Checks of missions that apply to all file formats."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.core.geometry import segments_of
from shoal.missions.diagnostics import Sheet
from shoal.missions.fence import Fence
from shoal.missions.mission import CAPS, FASTEST, OVERHEAD, circle_around
from shoal.search.regions.margin import grow
from shoal.search.regions.outline import Points, text_of
from shoal.search.regions.projection import REACH, LocalFrame
from shoal.search.regions.region import SearchRegion

ROUNDING = 0.005  # metres: tolerance of a waypoint's position, because 8 decimals are 1.1 mm

_RADIUS = 6_371_000.0  # metres: radius of the Earth
_FAR_HOME = 5_000.0
ELSEWHERE = 50_000.0  # metres: larger than the distance of any search from its home or its region
_HIGHEST, _HIGH = 10_000.0, 120.0
_LOWEST_HOME, _HIGHEST_HOME = -500.0, 9_000.0  # metres above the sea
_OPEN = 0.1  # metres: what is thinner of a zone may be outside of its exclusion polygon
_SAME_HEIGHT = 0.01  # metres
_SAME = 1e-8  # degrees


def check_coordinates(sheet: Sheet) -> None:
    """Add diagnostics for coordinates that describe no position on Earth or in the plane."""
    if not sheet.readable:
        return
    if len(sheet.points) == 0:
        sheet.add("zero-waypoints", "", "expected waypoints, got none")
    if sheet.home is None:
        sheet.add("no-home", "", "expected a home position, got none")
    _check_numbers(sheet)
    if not sheet.readable or not sheet.geographic or sheet.home is None:
        return
    for place, point in [
        ("home", sheet.home),
        *zip(sheet.places, sheet.points.tolist(), strict=True),
    ]:
        longitude, latitude = point
        if abs(longitude) <= 180 and abs(latitude) <= 90:
            continue
        swapped = abs(longitude) <= 90 and abs(latitude) <= 180
        message = (
            f"expected a longitude within ±180 and a latitude within ±90, got {longitude:.10g} and"
            f" {latitude:.10g}"
        )
        sheet.add("axes-swapped" if swapped else "out-of-range", place, message)
    if sheet.readable:
        check_elsewhere(sheet, sheet.points[0], sheet.home, "home", sheet.places[0])
        _check_meridian(sheet)


def _check_numbers(sheet: Sheet) -> None:
    """Add diagnostics for coordinates, altitudes and speeds that are NaN or infinite."""
    for place, point in zip(sheet.places, sheet.points.tolist(), strict=True):
        if not all(map(math.isfinite, point)):
            sheet.add("not-a-number", place, f"expected finite coordinates, got {text_of(point)}")
    for place, altitude in zip(sheet.places, sheet.altitudes, strict=True):
        if not math.isfinite(altitude):
            sheet.add("not-a-number", place, f"expected a finite altitude, got {altitude}")
    if sheet.home is not None and not all(map(math.isfinite, sheet.home)):
        sheet.add("not-a-number", "home", f"expected finite coordinates, got {text_of(sheet.home)}")
    if sheet.elevation is not None and not math.isfinite(sheet.elevation):
        sheet.add(
            "not-a-number",
            "home",
            f"expected a finite height of home above the sea, got {sheet.elevation}",
        )
    if sheet.speed is not None and not math.isfinite(sheet.speed):
        sheet.add("not-a-number", "", f"expected a finite speed, got {sheet.speed}")
    for number, rally in enumerate(sheet.rally, start=1):
        if not all(map(math.isfinite, rally)):
            sheet.add(
                "not-a-number",
                f"rally point {number}",
                f"expected finite coordinates, got {text_of(rally)}",
            )
    if sheet.not_json and not sheet.diagnostics:
        sheet.add(
            "not-a-number", "", f"expected finite numbers, as JSON has, got {sheet.not_json[0]}"
        )


def check_elsewhere(sheet: Sheet, point: Any, reference: Any, name: str, place: str) -> None:
    """Add a diagnostic if a point is far from a known position, but near this position after a swap
    of longitude and latitude.
    """
    distance = _metres_between(point, reference)
    swapped_distance = _metres_between(point[::-1], reference)
    if distance > ELSEWHERE and swapped_distance < ELSEWHERE:
        sheet.add(
            "axes-swapped",
            place,
            f"expected longitude and latitude near {name} {text_of(reference)}, got"
            f" {text_of(point)},"
            f" {distance / 1000:.0f} km away: the two swapped are near it",
        )


def _check_meridian(sheet: Sheet) -> None:
    assert sheet.home is not None
    path = np.vstack([sheet.home, sheet.points])
    for index in np.flatnonzero(np.abs(np.diff(path[:, 0])) > 180).tolist():
        message = (
            f"expected no leg across the 180° meridian, got a leg from {text_of(path[index])} to"
            f" {text_of(path[index + 1])}"
        )
        sheet.add("antimeridian", sheet.places[index], message)


def check_sense(
    sheet: Sheet,
    *,
    cap: int | None = None,
    autopilot: str | None = None,
    fence_distance: float | None = None,
) -> None:
    """Add diagnostics for implausible values in a mission, such as heights and speeds, and for an
    unexpected autopilot.

    With ``fence_distance``, the function also adds diagnostics for paths that are nearer to the
    fence than this distance in metres.
    """
    if autopilot is not None and sheet.autopilot is not None and sheet.autopilot != autopilot:
        sheet.add(
            "firmware",
            "",
            f"expected a mission for {autopilot!r}, got a mission for {sheet.autopilot!r}",
        )
    _check_cap(sheet, cap, autopilot)
    _check_altitude(sheet)
    _check_acceptance(sheet)
    _check_rally(sheet)
    if sheet.fence is not None and (path := path_of(sheet)) is not None:
        _check_fence(sheet, path, sheet.fence)
        if fence_distance is not None:
            _check_near_fence(sheet, fence_distance)
    if sheet.speed is not None and not 0 < sheet.speed <= FASTEST:
        sheet.add(
            "speed",
            "",
            f"expected a speed above 0 and at most {FASTEST:g} m/s, got {sheet.speed:g}",
        )
    if sheet.geographic and sheet.decimals is not None and sheet.decimals < 7:
        sheet.add(
            "few-decimals",
            "",
            f"expected coordinates with at least 7 decimals, got {sheet.decimals}",
        )
    repeats = np.all(np.abs(np.diff(sheet.points, axis=0)) <= _SAME, axis=1)
    if len(sheet.altitudes) == len(sheet.points):
        repeats &= np.abs(np.diff(sheet.altitudes)) <= _SAME_HEIGHT
    for index in np.flatnonzero(repeats).tolist():
        sheet.add(
            "duplicate",
            sheet.places[index + 1],
            f"expected a new position, got {text_of(sheet.points[index + 1])} again",
        )
    assert sheet.home is not None
    nearest = float(_distances(sheet, sheet.home).min())
    if nearest > _FAR_HOME:
        sheet.add(
            "home-far",
            "home",
            f"expected home within {_FAR_HOME / 1000:g} km of a waypoint, got"
            f" {nearest / 1000:.1f} km",
        )


def _check_cap(sheet: Sheet, cap: int | None, autopilot: str | None) -> None:
    items = sheet.n_items or len(sheet.points) + OVERHEAD[sheet.kind or "multirotor"]
    autopilot = sheet.autopilot or autopilot
    most = (
        cap if cap is not None else CAPS[autopilot] if autopilot is not None else max(CAPS.values())
    )
    if items > most:
        sheet.add("cap", "", f"expected at most {most} items, home included, got {items}")
    elif cap is None and autopilot is None and items > CAPS["ardupilot"]:
        sheet.add(
            "cap-ardupilot",
            "",
            f"expected at most {CAPS['ardupilot']} items for ArduPilot, home included, got {items}",
        )


def _check_altitude(sheet: Sheet) -> None:
    flies = sheet.kind != "rover"
    base = (sheet.elevation or 0.0) if sheet.altitude_frame == "sea" else 0.0
    # otherwise the height of home is unknown
    comparable = sheet.altitude_frame != "sea" or sheet.elevation is not None
    if not _LOWEST_HOME <= (sheet.elevation or 0.0) <= _HIGHEST_HOME:
        sheet.add(
            "altitude",
            "home",
            f"expected a home from {_LOWEST_HOME:g} to {_HIGHEST_HOME:g} m above the sea, got"
            f" {sheet.elevation:g} m",
        )
    lowest = min(sheet.altitudes, default=0.0)
    if flies and comparable and lowest <= base:
        place, at = sheet.places[sheet.altitudes.index(lowest)], f"{lowest - base:g} m above home"
        # A mission over a valley goes below home, and is above home elsewhere.
        if lowest == base or max(sheet.altitudes) <= base or sheet.altitude_frame == "ground":
            sheet.add(
                "altitude",
                place,
                f"expected a height above 0 and at most {_HIGHEST:g} m, got {lowest - base:g}",
            )
            return
        sheet.add(
            "below-home", place, f"expected heights above home, or a check with --terrain, got {at}"
        )
    reached = [*zip(sheet.places, sheet.altitudes, strict=True)]
    if sheet.take_off is not None:
        reached.insert(0, ("take-off", sheet.take_off))
    for place, altitude in reached:
        if flies and altitude > _HIGHEST:
            sheet.add(
                "altitude",
                place,
                f"expected a height above 0 and at most {_HIGHEST:g} m, got {altitude:g}",
            )
            return
        if not flies and altitude != 0:
            sheet.add("altitude", place, f"expected a height of 0 m for a rover, got {altitude:g}")
            return
        if flies and altitude > _HIGH and sheet.altitude_frame != "sea":
            sheet.add(
                "altitude-high",
                place,
                f"expected a height of at most {_HIGH:g} m, got {altitude:g}",
            )
            return
    # A waypoint between two other heights, or before or after several others, is a layer of which a
    # robot searches one cell.
    levels = [round(altitude, 1) for altitude in sheet.altitudes]
    often = Counter(levels)
    passed = {
        level
        for before, level, after in zip(levels, levels[1:], levels[2:], strict=False)
        if before != after
    }
    passed |= {levels[0], levels[-1]} if len(often) > 2 else set()
    rare, count = min(
        ((up, count) for up, count in often.items() if up not in passed),
        key=lambda entry: entry[1],
        default=(0.0, 0),
    )
    if (
        sheet.kind != "fixed-wing"
        and sheet.altitude_frame != "sea"
        and len(often) > 1
        and count == 1
    ):  # wings climb on the way
        low, high = min(sheet.altitudes), max(sheet.altitudes)
        message = (
            f"expected one height, or several waypoints at each, got {rare:g} m once among heights"
            f" from {low:g} to {high:g} m"
        )
        sheet.add("altitude-varies", "", message)


def _check_acceptance(sheet: Sheet) -> None:
    """Add a diagnostic for acceptance radii that contain the next waypoint."""
    # their turns have waypoints at short distances
    if not any(sheet.acceptance_radii) or len(sheet.points) < 2 or sheet.kind == "fixed-wing":
        return
    metres = (
        np.radians(np.diff(sheet.points, axis=0)) * _RADIUS
        if sheet.geographic
        else np.diff(sheet.points, axis=0)
    )
    if sheet.geographic:
        metres[:, 0] *= np.cos(np.radians(sheet.points[:-1, 1]))
    lengths, radii = np.hypot(*metres.T), np.array(sheet.acceptance_radii[:-1])
    near = np.flatnonzero((lengths <= radii) & (lengths > 0))
    if len(near):
        first = int(near[0])
        place, length, radius = sheet.places[first], lengths[first], radii[first]
        sheet.add(
            "acceptance",
            place,
            f"expected a radius below {length:.3g} m, the distance to the next waypoint, got"
            f" {radius:g} m",
        )


def path_of(sheet: Sheet) -> Points | None:
    """Return home, the waypoints and the end point in metres, or None if these points are too far
    apart for a local frame.
    """
    assert sheet.home is not None
    path = np.vstack([sheet.home, sheet.points, sheet.landing or sheet.home])
    try:
        return LocalFrame(*sheet.home).to_metres(path) if sheet.geographic else path
    except InvalidInputError:
        return None


def _check_fence(sheet: Sheet, path: Points, fence: Fence) -> None:
    """Add diagnostics for legs that leave the fence, including the legs from home and to the
    landing point.
    """
    import shapely

    assert sheet.home is not None
    try:
        frame = LocalFrame(*sheet.home) if sheet.geographic else None
        area = fence.area(frame).buffer(ROUNDING)
        apart = len(fence.outlines) > 1 and fence.common(frame).is_empty
    except InvalidInputError:
        return  # too far from home
    if apart and sheet.autopilot == "ardupilot":
        sheet.add(
            "fence",
            "",
            "expected inclusion polygons that overlap, because ArduPilot needs vehicles inside all of"
            f" them, got {len(fence.outlines)} that do not",
        )
    shapely.prepare(area)
    lines = shapely.linestrings(segments_of(path))
    names = [
        "from home",
        *(f"to {place}" for place in sheet.places[1:]),
        "to its end",
        "in its last circle",
    ]
    circle = circle_around(sheet.landing or sheet.home, sheet.loiter, frame)
    if len(circle):
        lines = np.append(lines, shapely.linestrings(circle))
    for index in np.flatnonzero(~shapely.covers(area, lines)).tolist():
        message = (
            "expected paths inside the fence, got a path that leaves the fence or enters a zone,"
            f" {names[index]}"
        )
        sheet.add("fence", sheet.places[min(index, len(sheet.places) - 1)], message)


def fence_clearances(sheet: Sheet, fence: Fence) -> tuple[list[str], NDArray[np.float64]]:
    """Return the legs, the last circle and the rally points of a mission, and their distances from
    a fence in metres.

    A distance is negative outside the fence or in an exclusion zone, as in `Fence.clearances`. If
    the mission is too far away for a local frame, the result is empty.
    """
    assert sheet.home is not None
    path = path_of(sheet)
    if path is None:
        return [], np.zeros(0)
    frame = LocalFrame(*sheet.home) if sheet.geographic else None
    names = [
        f"{sheet.places[0]}, from home",
        *(f"{place}, the path to it" for place in sheet.places[1:]),
        "the path to its end",
    ]
    paths = [path[k : k + 2] for k in range(len(path) - 1)]
    circle = circle_around(sheet.landing or sheet.home, sheet.loiter, frame)
    rally = np.array(sheet.rally, dtype=np.float64).reshape(-1, 3)[:, :2]
    try:
        points = rally if frame is None else frame.to_metres(rally)
        paths += [circle] * bool(len(circle)) + [point[None] for point in points]
        names += ["the last circle"] * bool(len(circle)) + [
            f"rally point {k}" for k in range(1, len(rally) + 1)
        ]
        return names, fence.clearances(paths, frame)
    except InvalidInputError:
        return [], np.zeros(0)


def _check_near_fence(sheet: Sheet, least: float) -> None:
    """Add diagnostics for paths and rally points that are nearer to the fence than a distance, but
    do not leave the fence.
    """
    assert sheet.fence is not None
    for name, distance in zip(*fence_clearances(sheet, sheet.fence), strict=True):
        if -ROUNDING <= distance < least - ROUNDING:
            place, _, detail = name.partition(", ")
            message = (
                f"expected at least {least:g} m between all paths and the fence, got"
                f" {max(distance, 0.0):.3g} m"
            )
            sheet.add("fence-near", place if detail else "", f"{message}, {detail or name}")


def _check_rally(sheet: Sheet) -> None:
    """Add diagnostics for rally points outside the fence or in an exclusion zone of the fence, at an
    impossible height or far away, and for a mission that would return to one.
    """
    import shapely

    if not sheet.rally:
        return
    if sheet.landing is None:
        sheet.add(
            "rally",
            "",
            "expected a landing or a hold (21 or 17) at the end of a mission with rally points, got a"
            " return (20), on which an autopilot may take the nearest rally point",
        )
    flies, home = sheet.kind != "rover", sheet.home
    for number, (x, y, up) in enumerate(sheet.rally, start=1):
        if not (0 < up <= _HIGHEST if flies else math.isfinite(up)):
            above = f"above 0 and at most {_HIGHEST:g} m" if flies else "in metres"
            sheet.add(
                "rally",
                f"rally point {number}",
                f"expected a height {above} above home, got {up:g}",
            )
        if sheet.geographic and _metres_between((x, y), home) > ELSEWHERE:
            sheet.add(
                "rally",
                f"rally point {number}",
                f"expected rally points near home, got {text_of((x, y))}",
            )
    if sheet.fence is None:
        return
    try:
        points = np.array(sheet.rally)[:, :2]
        frame = LocalFrame(*points[0]) if sheet.geographic else None
        area = sheet.fence.area(frame).buffer(ROUNDING)
        inside = shapely.intersects_xy(
            area, *(points if frame is None else frame.to_metres(points)).T
        )
    except InvalidInputError:
        inside = np.zeros(len(sheet.rally), dtype=np.bool_)  # too far away for one local frame
    for number in np.flatnonzero(~inside).tolist():
        message = (
            "expected rally points inside the fence and outside its zones, got"
            f" {text_of(sheet.rally[number][:2])}"
        )
        sheet.add("rally", f"rally point {number + 1}", message)


def _distances(sheet: Sheet, place: tuple[float, float]) -> NDArray[np.float64]:
    """Return the distances in metres from a point to each waypoint."""
    if not sheet.geographic:
        return np.asarray(np.hypot(*(sheet.points - place).T))
    return np.array([_metres_between(point, place) for point in sheet.points.tolist()])


def _metres_between(first: Any, second: Any) -> float:
    """Return the distance in metres between two points in degrees, on a sphere. For an invalid
    point, return infinity.
    """
    if max(abs(first[1]), abs(second[1])) > 90:
        return math.inf
    low, high = math.radians(first[1]), math.radians(second[1])
    width = math.radians(second[0] - first[0])
    chord = (
        math.sin((high - low) / 2) ** 2 + math.cos(low) * math.cos(high) * math.sin(width / 2) ** 2
    )
    return 2 * _RADIUS * math.asin(min(1.0, math.sqrt(chord)))


def _in_plane(point: tuple[float, float], region: SearchRegion) -> tuple[float, float]:
    """Return a point in metres of a region's local frame, or infinity if it is too far away."""
    try:
        x, y = (
            np.array([point]) if region.frame is None else region.frame.to_metres(np.array([point]))
        )[0].tolist()
    except InvalidInputError:
        return math.inf, math.inf
    return x, y


def metres_of(sheet: Sheet, region: SearchRegion) -> Points:
    """Return home, the waypoints and the end point of a mission in metres of a region's local
    frame.

    Coordinates of points that are too far away for the local frame become infinite.

    Raises
    ------
    InvalidInputError
        If the mission is in degrees and the region in metres, or the reverse.
    """
    path = np.vstack(
        [np.array([sheet.home]), sheet.points, np.array([sheet.landing or sheet.home])]
    )
    if sheet.geographic != (region.frame is not None):
        units = ["metres", "degrees"]
        raise InvalidInputError(
            f"{sheet.file}: expected a mission in {units[region.frame is not None]}, as the region"
            f" {region.name!r} is, got one in {units[sheet.geographic]}"
        )
    if region.frame is None:
        return path
    origin = (region.frame.longitude, region.frame.latitude)
    near = np.array([_metres_between(point, origin) < 1.5 * REACH for point in path.tolist()])
    metres = np.full(path.shape, np.inf)
    metres[near] = region.frame.to_metres(path[near])
    return metres


def inside_of(region: SearchRegion, path: Points) -> NDArray[np.bool_]:
    """Return, for each point, whether robots may be there, with a tolerance for rounded
    coordinates; bool, shape (n,).
    """
    import shapely

    near = np.asarray(np.isfinite(path).all(axis=1))
    allowed = region.free.buffer(ROUNDING)
    shapely.prepare(allowed)
    return np.asarray(near & shapely.intersects_xy(allowed, *np.where(near[:, None], path, 0.0).T))


def search_slice(inside: NDArray[np.bool_], kind: str | None = None) -> slice:
    """Return the slice of the waypoints that belong to the search, without the paths from home and
    to the end.

    The array ``inside`` tells whether home, each waypoint and the end lie in the region. If home
    lies outside the region, all waypoints before the first waypoint in the region belong to the
    path from home. If the end lies outside the region, all waypoints after the last waypoint in the
    region belong to the path to the end. Fixed wings may leave the region after take-off and before
    landing, even if home lies in the region.

    Examples
    --------
    >>> search_slice(np.array([False, False, True, False, True, False]))
    slice(1, 4, None)
    """
    indices = np.flatnonzero(inside[1:-1])
    if not len(indices):
        return slice(0, len(inside) - 2)
    first, last = inside[[0, -1]] & (kind != "fixed-wing")
    return slice(0 if first else int(indices[0]), len(inside) - 2 if last else int(indices[-1]) + 1)


def check_place(sheet: Sheet, region: SearchRegion, airspace: float | None = None) -> None:
    """Add diagnostics for waypoints and legs outside a region.

    Home, the end of a mission, and the paths from home and to the end may lie outside the region.
    Turns of fixed wings may leave the region by at most ``airspace`` metres, or by any distance if
    ``airspace`` is None.
    """
    path = metres_of(sheet, region)
    if region.frame is not None:
        check_elsewhere(
            sheet,
            sheet.points[0],
            (region.frame.longitude, region.frame.latitude),
            "the region",
            sheet.places[0],
        )
        if not sheet.readable:
            return
    import shapely

    near = np.asarray(np.isfinite(path).all(axis=1))
    allowed = region.free.buffer(ROUNDING)
    forbidden = grow(region.no_go, region.margin).buffer(-ROUNDING)
    shapely.prepare(forbidden)
    zones = region.no_go.buffer(-ROUNDING)
    for number, (*rally, _) in enumerate(sheet.rally, start=1):
        if not zones.is_empty and shapely.intersects_xy(
            zones, *_in_plane((rally[0], rally[1]), region)
        ):
            sheet.add(
                "rally",
                f"rally point {number}",
                f"expected rally points outside the no-go zones, got {text_of(rally)}",
            )
    _check_zones(sheet, region)
    inside = inside_of(region, path)
    barred = near & np.asarray(
        shapely.intersects_xy(forbidden, *np.where(near[:, None], path, 0).T)
    )
    searched = search_slice(inside, sheet.kind)
    passed = _between_parts(sheet, region, path)
    stray = ~inside[1:-1]
    stray[: searched.start] = stray[searched.stop :] = False
    gaps = shapely.distance(region.free, shapely.points(np.where(near[:, None], path, 0.0)))
    elsewhere = ~near | (gaps > ELSEWHERE)
    if elsewhere[-1] and sheet.landing is not None:
        message = (
            f"expected an end of the mission near the region {region.name!r}, got"
            f" {text_of(sheet.landing)}, far outside"
        )
        sheet.add("outside-region", "end", message)
    for index in np.flatnonzero(stray | barred[1:-1] | elsewhere[1:-1]).tolist():
        point, place = text_of(sheet.points[index]), sheet.places[index]
        if elsewhere[index + 1]:
            message = (
                f"expected a waypoint in the region {region.name!r}{region.margin_text}, got"
                f" {point}, far outside"
            )
            x, y = sheet.points[index].tolist()
            swapped_point = _in_plane((y, x), region)
            swapped = region.frame is not None and max(swapped_point) < math.inf
            swapped = swapped and region.free.distance(shapely.Point(swapped_point)) < ELSEWHERE
            sheet.add(
                "outside-region",
                place,
                f"{message}{': latitude and longitude swapped are near it' * swapped}",
            )
        elif barred[index + 1]:
            sheet.add("no-go", place, f"expected a waypoint outside the no-go zones, got {point}")
        else:
            if sheet.kind == "fixed-wing" or passed[index]:
                # the vehicle turns there, or flies from part to part: its legs are reported instead
                continue
            where = region.outside_text(path[index + 1])
            message = (
                f"expected a waypoint in the region {region.name!r}{region.margin_text}, got"
                f" {point}, {where}"
            )
            sheet.add("outside-region", place, message)
    outside = _check_legs(sheet, path, searched, allowed, forbidden)
    if sheet.kind == "fixed-wing" and outside.any():
        ends = path[1:][np.concatenate([outside[:-1] | outside[1:], outside[-1:]])]
        distance = float(shapely.distance(region.free, shapely.points(ends)).max())
        if airspace is None:
            sheet.add(
                "transit",
                "",
                f"expected turns inside the region, got turns up to {distance:.3g} m outside",
            )
        elif distance > airspace + ROUNDING:
            sheet.add(
                "airspace",
                "",
                f"expected turns up to {airspace:g} m outside the region, got {distance:.3g} m",
            )


def _check_zones(sheet: Sheet, region: SearchRegion) -> None:
    """Add a diagnostic for a fence that lets a vehicle into no-go zones of a region."""
    if sheet.fence is None or region.no_go.is_empty:
        return
    try:
        area = sheet.fence.area(region.frame)
    except InvalidInputError:
        return  # too far away; other rules report that
    entered = float(area.intersection(region.no_go.buffer(-_OPEN)).area)
    if entered > _OPEN**2:
        sheet.add(
            "fence-open",
            "",
            "expected exclusion polygons over the no-go zones, got a fence that allows"
            f" {entered:.3g} m² of them",
        )


def _between_parts(sheet: Sheet, region: SearchRegion, path: Points) -> NDArray[np.bool_]:
    """Return, for each waypoint, whether a flight may pass it on its way around no-go zones from
    one part of a region to another.

    A flight may leave a region of several parts between its parts. A margin can divide a region of
    one part beside its zones: there it may be where the fence of the mission lets it.
    """
    import shapely

    if sheet.kind == "rover":
        return np.zeros(len(sheet.points), dtype=np.bool_)
    if len(region.parts) > 1 or sheet.fence is None or region.no_go.is_empty:
        return np.full(len(sheet.points), len(region.parts) > 1)
    area = sheet.fence.area(region.frame).buffer(ROUNDING)
    near = np.asarray(np.isfinite(path[1:-1]).all(axis=1))
    return np.asarray(
        near & shapely.intersects_xy(area, *np.where(near[:, None], path[1:-1], 0.0).T)
    )


def _check_legs(
    sheet: Sheet, path: Points, searched: slice, allowed: Any, forbidden: Any
) -> NDArray[np.bool_]:
    """Add diagnostics for legs that leave the allowed area or cross a forbidden area.

    A leg from home or back home may leave the allowed area, unless the vehicle is a rover. If a
    fixed wing leaves the allowed area on a leg of the search, the function adds no diagnostic, and
    the result is true for this leg.
    """
    import shapely

    finite = np.asarray(np.isfinite(path).all(axis=1))
    usable = np.asarray(finite[:-1] & finite[1:])
    lines = shapely.linestrings(np.where(usable[:, None, None], segments_of(path), 0.0))
    outside = usable & ~np.asarray(shapely.covers(allowed, lines))
    through = usable & np.asarray(shapely.intersects(forbidden, lines))
    if searched.start or not shapely.intersects_xy(allowed, *path[0]):
        outside[: searched.start + 1] = False
    if searched.stop < len(sheet.points) or not shapely.intersects_xy(allowed, *path[-1]):
        outside[searched.stop :] = False
    turned = outside & ~through if sheet.kind == "fixed-wing" else np.zeros_like(outside)
    turned[[0, -1]] = False
    outside &= ~turned
    names = ["from home", *(f"to {place}" for place in sheet.places[1:]), "back home"]
    for index in np.flatnonzero(outside | through).tolist():
        place = sheet.places[min(index, len(sheet.places) - 1)]
        if through[index]:
            sheet.add(
                "no-go",
                place,
                f"expected legs around the no-go zones, got a leg through a zone, {names[index]}",
            )
        elif sheet.kind == "rover":
            sheet.add(
                "leg-outside",
                place,
                "expected legs inside the region, got a leg that leaves the region,"
                f" {names[index]}",
            )
        elif 0 < index < len(sheet.points):
            sheet.add(
                "transit",
                place,
                "expected legs inside the region, got a leg that leaves the region,"
                f" {names[index]}",
            )
    return np.asarray(turned)
