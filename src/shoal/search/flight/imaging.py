"""The images of a vehicle's camera: where it takes them, and what they see of the ground."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import cos, hypot, isfinite, radians, sin, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.geometry import left_of
from shoal.search.flight.vehicle import Vehicle
from shoal.search.regions.outline import Points

_BEND = np.cos(np.radians(1.0))  # cosine of the turn from which on a waypoint is a bend
_SAME = 0.005  # metres: images that leave a narrower gap touch
_LONG = 2.0  # trigger distances: a fixed wing takes images at the ends of legs as long as this
_HIGHEST = 10_000.0  # metres: no vehicle is higher, and a file that says so has a mistake
_MOST_IMAGES = 1_000_000  # of one mission
_ALIGNED = np.cos(np.radians(0.5))  # cosine of the angle up to which an image lies along a leg
PITCH_ERROR = 1.0
"""Degrees by which the pitch of a camera may differ from that of its vehicle."""


class CameraItem(NamedTuple):
    """A command of a mission to the camera.

    Parameters
    ----------
    after : int
        Number of waypoints before the command: it is obeyed at the last of them.
    command : int
        MAVLink command.
    value : float
        Its first parameter: the distance between images in metres, or the pitch in degrees.
    at_once : bool
        Whether the vehicle takes an image at once.
    place : str
        Place of the command in its file.
    """

    after: int
    command: int
    value: float
    at_once: bool = False
    place: str = ""


GIMBAL, TRIGGER = 205, 206  # MAV_CMD_DO_MOUNT_CONTROL, MAV_CMD_DO_SET_CAM_TRIGG_DIST


def image_waypoints(path: Points, distance: float, kind: str) -> NDArray[np.int64]:
    """Return the numbers of the waypoints of a search, from 0, at which a vehicle takes an image:
    both ends and, between them, all bends.

    On a leg, images are ``distance`` metres apart, so that the last one may be as far before the
    leg's end. The arcs of a fixed wing, whose legs are short, need no such images.

    Parameters
    ----------
    path : ndarray of float64, shape (k, 2)
        The waypoints in metres.
    distance : float
        Distance between images in metres.
    kind : str
        The kind of the vehicle.

    Examples
    --------
    >>> path = np.array([(0.0, 0.0), (50.0, 0.0), (90.0, 0.0), (90.0, 60.0)])
    >>> image_waypoints(path, 18.0, "multirotor").tolist()
    [0, 2, 3]
    """
    legs = np.diff(path[:, :2], axis=0)
    lengths = np.hypot(*legs.T)
    turns = (legs[:-1] * legs[1:]).sum(axis=1) < _BEND * lengths[:-1] * lengths[1:]
    turns |= (lengths[:-1] == 0) | (lengths[1:] == 0)
    if kind == "fixed-wing":
        turns &= np.maximum(lengths[:-1], lengths[1:]) >= _LONG * distance
    inner = np.flatnonzero(turns) + 1
    return np.unique(np.concatenate([[0], inner, [len(path) - 1]])).astype(np.int64)


def image_sides(vehicle: Vehicle, heights: Any) -> NDArray[np.float64]:
    """Return width across the path and length along the path, in metres, of images from heights in
    metres above the ground; float64, shape (n, 2). At or below the ground, a camera sees nothing.

    Examples
    --------
    >>> from shoal.search.flight.vehicle import vehicle_of
    >>> camera = vehicle_of("multirotor,sensor_width=13.2,sensor_height=8.8,focal_length=8.8")
    >>> image_sides(camera, [60.0, 20.0, -1.0]).round(6).tolist()
    [[90.0, 60.0], [30.0, 20.0], [0.0, 0.0]]
    """
    assert vehicle.sensor_width
    assert vehicle.sensor_height
    assert vehicle.focal_length
    sensor = np.array([vehicle.sensor_width, vehicle.sensor_height]) / vehicle.focal_length
    # from an unknown height, an image shows nothing that is known
    above = np.clip(np.nan_to_num(heights, posinf=_HIGHEST, nan=0.0), 0.0, _HIGHEST)
    return np.asarray(above[..., None] * sensor)


def planned_items(waypoints: Points, first: int, distance: float, kind: str) -> list[CameraItem]:
    """Return the commands with which a vehicle takes images on its search: the waypoints
    ``waypoints`` in metres, after ``first`` waypoints on the way out.

    PX4 measures the distance to the next image from the last image that the distance brought. Where
    that would be too late after a sharp turn, the images end and begin again.
    """
    at = image_waypoints(waypoints, distance, kind).tolist()
    bends, items, mark = {*at}, [], tuple(waypoints[0, :2].tolist())
    places = waypoints[:, :2].tolist()
    for number, (x, y) in enumerate(places):
        to_x, to_y = places[min(number + 1, len(places) - 1)]
        length = hypot(to_x - x, to_y - y)
        ahead = ((to_x - x) / length, (to_y - y) / length) if length else (1.0, 0.0)
        next_image = _next_image(mark, (x, y), ahead, distance)
        if number in bends:
            if next_image > distance + _SAME and length > distance:
                items.append(CameraItem(first + number + 1, TRIGGER, 0.0))
                mark, next_image = (x, y), distance
            items.append(CameraItem(first + number + 1, TRIGGER, distance, at_once=True))
        if next_image <= length and length:
            last = next_image + int((length - next_image) / distance) * distance
            mark = x + last * ahead[0], y + last * ahead[1]
    return [*items, CameraItem(first + len(places), TRIGGER, 0.0)]


def views_of(
    path: NDArray[np.float64],
    items: Sequence[CameraItem],
    vehicle: Vehicle,
    headings: Sequence[float | None] | None = None,
) -> tuple[Any, NDArray[np.int64]]:
    """Return what the images see that a vehicle takes on its path by the commands of its mission:
    polygons in metres, each of one image or of images that follow each other without a gap, and the
    number of the leg of each, from 0.

    The autopilots measure the distance between images as the crow flies: ArduPilot from the last
    image, PX4 from the last image that was not taken at once. Where they differ, the later image
    counts. An image at a waypoint faces the way to the waypoint, and the first image after a
    command that begins them faces the way ahead.

    Parameters
    ----------
    path : ndarray of float64, shape (n, 3)
        Positions in metres with heights above the ground: home, the waypoints and the end. A
        position may be infinite, which no image sees.
    items : sequence of CameraItem
    vehicle : Vehicle
        A vehicle with a camera.
    headings : sequence of float or None, optional
        Heading in degrees clockwise from north on the way to each position after the first, or None
        where the vehicle faces its direction of motion.
    """
    pitch = -90.0 if vehicle.gimbal_pitch is None else vehicle.gimbal_pitch
    by_waypoint: dict[int, list[CameraItem]] = {}
    for item in items:
        by_waypoint.setdefault(item.after, []).append(item)
    sides = image_sides(vehicle, [1.0])[0].tolist()
    rows: list[tuple[int, float, float]] = []  # leg, and the first and the last image on it
    distance, aimed, count = 0.0, True, 0
    marks: list[tuple[float, float]] = []  # from which the next distance is measured
    before: tuple[int, float, float] | None = None  # last leg, its length and image length
    places = path.tolist()
    for leg, ((x, y, up), (to_x, to_y, to_up)) in enumerate(pairwise(places)):
        known = all(map(isfinite, (x, y, to_x, to_y)))
        length = hypot(to_x - x, to_y - y) if known else 0.0
        ahead = ((to_x - x) / length, (to_y - y) / length) if length else (1.0, 0.0)
        running = distance > 0 and before is not None
        for item in by_waypoint.get(leg, ()):
            if item.command == GIMBAL:
                aimed = abs(item.value - pitch) <= PITCH_ERROR
            if item.command not in (GIMBAL, TRIGGER):
                aimed = False  # nobody knows what the camera sees, until it is aimed again
            if item.command != TRIGGER:
                continue
            begins, distance = distance <= 0, item.value if item.value > 0 else 0.0
            if not distance:
                marks = []
                continue
            if begins:
                marks = [(x, y)]
            elif item.at_once and marks:
                marks = [marks[0], (x, y)]
            if not (item.at_once and aimed):
                continue
            if not running or before is None:
                rows += [(leg, 0.0, 0.0)] if length else []
                continue
            number, far, reach = before
            if rows and rows[-1][0] == number and far - rows[-1][2] <= reach:
                rows[-1] = (number, rows[-1][1], far)
            else:
                rows.append((number, far, far))
        if not known:
            marks, before = [], None
            continue
        if not length:
            continue
        heading = None if headings is None else headings[leg]
        reach = max(min(up, to_up), 0.0) * _length_along(ahead, heading, sides) + _SAME
        before = leg, length, reach
        if not distance:
            continue
        marks = marks or [(x, y)]
        first = max(_next_image(mark, (x, y), ahead, distance) for mark in marks)
        if first > length:
            continue
        more = int((length - first) / distance)
        last = first + more * distance
        marks = [(x + last * ahead[0], y + last * ahead[1])]
        if not aimed:
            continue
        if distance <= reach:
            rows.append((leg, first, last))
            continue
        count += more + 1
        if count > _MOST_IMAGES:
            break  # millimetres apart, of a camera that sees less
        rows += [(leg, first + k * distance, first + k * distance) for k in range(more + 1)]
    return _views(path, rows, vehicle, headings)


def _length_along(
    ahead: tuple[float, float], heading: float | None, sides: Sequence[float]
) -> float:
    """Return the length of an image in a direction of flight, or 0 if the image lies slanted, so
    that images that follow each other see less than a strip.
    """
    if heading is None:
        return sides[1]
    turned = radians(90.0 - heading)
    along = abs(ahead[0] * cos(turned) + ahead[1] * sin(turned))
    return sides[1] if along > _ALIGNED else sides[0] if along < sqrt(1 - _ALIGNED**2) else 0.0


def _next_image(
    mark: tuple[float, float], start: tuple[float, float], ahead: tuple[float, float], far: float
) -> float:
    """Return the distance from a leg's start at which it is ``far`` metres from a mark."""
    x, y = start[0] - mark[0], start[1] - mark[1]
    along, beyond = x * ahead[0] + y * ahead[1], x * x + y * y - far * far
    return 0.0 if beyond >= 0 else sqrt(along * along - beyond) - along


def swept_views(starts: NDArray[np.float64], ends: NDArray[np.float64], vehicle: Vehicle) -> Any:
    """Return the area that a camera sees without interruption on legs, whose ends have heights
    above the ground, shape (n, 3).
    """
    steps = ends - starts
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    if vehicle.yaw is not None and vehicle.kind == "multirotor":
        headings = np.full(len(steps), np.radians(90.0 - vehicle.yaw))
    return strips(starts, ends, vehicle, headings)


def strips(
    starts: NDArray[np.float64],
    ends: NDArray[np.float64],
    vehicle: Vehicle,
    headings: NDArray[np.float64],
) -> Any:
    """Return the area that images see between positions with heights above ground, shape (n, 3):
    the convex hull of the images at both ends. The heading is in radians counter-clockwise from
    east.
    """
    import shapely

    ahead = np.column_stack([np.cos(headings), np.sin(headings)])
    beside = left_of(ahead)
    corners = []
    for end in (starts, ends):
        across, along = (image_sides(vehicle, end[:, 2]) / 2).T[:, :, None]
        corners += [
            end[:, :2] + front * along * ahead + left * across * beside
            for front in (-1, 1)
            for left in (-1, 1)
        ]
    return shapely.convex_hull(shapely.multipoints(np.stack(corners, axis=1)))


def _views(
    path: NDArray[np.float64],
    rows: list[tuple[int, float, float]],
    vehicle: Vehicle,
    headings: Sequence[float | None] | None,
) -> tuple[Any, NDArray[np.int64]]:
    if not rows:
        return np.zeros(0, dtype=object), np.zeros(0, dtype=np.int64)
    table = np.array(rows, dtype=np.float64)
    legs = table[:, 0].astype(np.int64)
    steps = path[legs + 1] - path[legs]
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    facing = np.arctan2(steps[:, 1], steps[:, 0])
    if headings is not None:
        kept = np.array([np.nan if one is None else one for one in headings], dtype=np.float64)
        facing = np.where(np.isfinite(kept[legs]), np.radians(90.0 - kept[legs]), facing)
    shares = table[:, 1:] / np.where(lengths > 0, lengths, 1.0)[:, None]
    starts, ends = (path[legs] + share[:, None] * steps for share in shares.T)
    shapes = strips(starts, ends, vehicle, facing)
    import shapely

    seen = shapely.area(shapes) > 0
    return shapes[seen], legs[seen]
