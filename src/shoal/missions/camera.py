"""What the cameras of missions see: by the commands in mission files or, where a format has none, by
the vehicle.
"""

from __future__ import annotations

from math import nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.missions.diagnostics import Sheet
from shoal.missions.rules import inside_of, metres_of, search_slice
from shoal.search.flight.imaging import (
    GIMBAL,
    PITCH_ERROR,
    TRIGGER,
    planned_items,
    views_of,
)
from shoal.search.flight.terrain import Terrain, ground_profile
from shoal.search.flight.vehicle import Vehicle
from shoal.search.regions.region import SearchRegion

_ROUNDED = 0.002  # metres: rounding of distances in files
_TURNED = 1.0  # degrees by which a heading may differ
_FINE = 0.5  # metres: largest error of the height of the ground between two points


def check_camera(sheet: Sheet, vehicle: Vehicle) -> None:
    """Add diagnostics if the camera of a vehicle takes no images on a mission, takes them too far
    apart, or aims elsewhere. Files of a format without commands to a camera have none of them.
    """
    items, wanted = sheet.camera_items, vehicle.trigger_distance
    if items is None or wanted is None:
        return
    base = (sheet.elevation or 0.0) if sheet.altitude_frame == "sea" else 0.0
    highest = max((up - base for up in sheet.altitudes), default=0.0)  # where an image is largest
    wanted *= max(highest / vehicle.height, 1.0)
    pitch = -90.0 if vehicle.gimbal_pitch is None else vehicle.gimbal_pitch
    distances = [item for item in items if item.command == TRIGGER and item.value > 0]
    if not distances:
        sheet.add(
            "images",
            "",
            f"expected images every {wanted:g} m (206), as the vehicle has a camera, got none",
        )
    for item in distances:
        if item.value > wanted + _ROUNDED:
            sheet.add(
                "images",
                item.place,
                f"expected at most {wanted:g} m between images, for the overlap of the vehicle,"
                f" got {item.value:g} m",
            )
    pitches = [item for item in items if item.command == GIMBAL]
    for item in pitches:
        if not abs(item.value - pitch) <= PITCH_ERROR:
            sheet.add(
                "images",
                item.place,
                f"expected a camera pitch of {pitch:g}°, as the vehicle has, got {item.value:g}°",
            )
    if not pitches and distances and sheet.kind != "rover":
        sheet.add(
            "camera",
            "",
            f"expected the pitch of the camera (205), got none: the check assumes {pitch:g}°",
        )
    if sheet.headings is not None and sheet.kind == "multirotor":
        for place, heading in zip(sheet.places, sheet.headings, strict=True):
            if _differs(heading, vehicle.yaw):
                got, expected = (
                    "the direction of flight" if one is None else f"{one:g}°"
                    for one in (heading, vehicle.yaw)
                )
                sheet.add(
                    "camera",
                    place,
                    f"expected the heading of the vehicle, {expected}, got {got}: the check measures"
                    " coverage with the heading in the file",
                )
                break  # mostly, all have the same heading


def _differs(heading: float | None, other: float | None) -> bool:
    if heading is None or other is None:
        return heading is not other
    return abs((heading - other + 180.0) % 360.0 - 180.0) > _TURNED


def heights_of(
    sheet: Sheet, places: NDArray[np.float64], terrain: Terrain | None, region: SearchRegion
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the altitudes in a file and the heights above the ground in metres of home, the
    waypoints and the end, whose positions in metres are ``places``; each float64, shape (n,).

    Without a terrain, the ground is as high as home. Beside a terrain, heights are unknown (NaN).
    """
    count = len(sheet.points)
    ups = np.resize(np.array(sheet.altitudes or [0.0]), count)
    ups = ups[np.clip(np.arange(count + 2) - 1, 0, count - 1)]
    if sheet.altitude_frame == "ground":
        return ups, ups
    if terrain is not None and np.isfinite(places).all():
        try:
            ground = terrain.at(places, region.frame)
        except InvalidInputError:  # the check of heights above the ground tells
            ground = np.array([ground_at(terrain, place, region) for place in places])
        return ups, ups + base_of(sheet, float(ground[0])) - ground
    return ups, ups - (sheet.elevation or 0.0) if sheet.altitude_frame == "sea" else ups


def ground_at(terrain: Terrain, place: NDArray[np.float64], region: SearchRegion) -> float:
    """Return the height of the ground at a place above the sea, or NaN beside the terrain."""
    try:
        return float(terrain.at(place[None], region.frame)[0])
    except InvalidInputError:
        return nan


def base_of(sheet: Sheet, ground: float) -> float:
    """Return how high above the sea the altitudes of a file begin, if the ground at home is
    ``ground`` high and altitudes do not count from the ground below.

    If the file says how high home is, the ground there decides, and what the file says for home
    counts as 0.
    """
    if sheet.altitude_frame != "sea":
        return ground
    return 0.0 if sheet.elevation is None else ground - sheet.elevation


def camera_views(
    sheet: Sheet, region: SearchRegion, vehicle: Vehicle, terrain: Terrain | None
) -> tuple[Any, NDArray[np.float64]]:
    """Return what the images of a mission see, as polygons in metres, and the altitudes in the file
    at both ends of the leg of each, shape (n, 2).

    The size of an image follows the height above the ground: above the terrain or, without one,
    above home.
    """
    places = metres_of(sheet, region)
    count = len(sheet.points)
    ups, heights = heights_of(sheet, places, None, region)
    items = sheet.camera_items
    if items is None:
        first, last = sheet.waypoints_out, sheet.waypoints_home
        if first is None:
            searched = search_slice(inside_of(region, places), sheet.kind)
        else:
            searched = slice(first, count - (last or 0))
        run = places[1:-1][searched]
        run = np.where(np.isfinite(run), run, 0.0)
        items = planned_items(
            run, searched.start, vehicle.trigger_distance or 0.0, sheet.kind or vehicle.kind
        )
    headings: list[float | None] | None = None
    if (sheet.kind or vehicle.kind) == "multirotor":
        own = [vehicle.yaw] * count if sheet.headings is None else sheet.headings
        if any(heading is not None for heading in own):
            headings = [*own, own[-1]]
    path = np.column_stack([places, heights])
    at = np.arange(count + 2)
    if terrain is not None and sheet.altitude_frame != "ground" and np.isfinite(path).all():
        path[:, 2] = ups
        path, at = _above_terrain(sheet, path, terrain, region)
        items = [item._replace(after=int(at[item.after])) for item in items]
        if headings is not None:
            headings = [headings[leg] for leg in np.repeat(np.arange(count + 1), np.diff(at))]
    shapes, legs = views_of(path, items, vehicle, headings)
    leg = np.searchsorted(at, legs, side="right") - 1
    return shapes, np.column_stack([ups[leg], ups[leg + 1]])


def _above_terrain(
    sheet: Sheet, path: NDArray[np.float64], terrain: Terrain, region: SearchRegion
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return a path with heights above the ground in place of the altitudes of the file, with more
    points where the ground bends, and the numbers of its points among them.
    """
    try:
        profile = ground_profile(terrain, path[:, :2], region.frame, error=_FINE)
    except InvalidInputError:  # the check of heights above the ground tells
        _, heights = heights_of(sheet, path[:, :2], terrain, region)
        return np.column_stack([path[:, :2], heights]), np.arange(len(path))
    far = np.append(0.0, np.cumsum(np.hypot(*np.diff(profile.points, axis=0).T)))
    vertices = np.asarray(profile.vertices, dtype=np.int64)
    ups = np.interp(far, far[vertices], path[:, 2]) + base_of(sheet, float(profile.heights[0]))
    return np.column_stack([profile.points, ups - profile.heights]), vertices
