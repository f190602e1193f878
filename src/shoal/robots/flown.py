"""What was flown beside what was planned: the region that vehicles have seen on their real tracks,
and the rest as a new region.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations, product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.files import write_json
from shoal.core.geometry import partial_sums, step_lengths
from shoal.missions.approach import MissionApproach, common_levels, raised
from shoal.missions.checking import facing_of
from shoal.missions.mission import Mission
from shoal.missions.options import CheckOptions
from shoal.missions.rules import ROUNDING
from shoal.search.flight.imaging import swept_views
from shoal.search.flight.legs import merge_straight_legs
from shoal.search.flight.separation import Approach, nearest_approach
from shoal.search.flight.timing import Trajectory
from shoal.search.flight.vehicle import image_of
from shoal.search.regions.coverage import AreaCoverage, coverage_check
from shoal.search.regions.formats.flight_logs import ALOFT, GAP, HIGH_ENOUGH, Track
from shoal.search.regions.margin import visible_region
from shoal.search.regions.projection import LocalFrame
from shoal.search.regions.region import SearchRegion

_LEFT = 3.0  # metres from its first position, from which on a rover is on its way
_STRAIGHT = 0.05  # metres: positions of a track nearer to a straight line are left out
_LEVEL = 0.02  # share of a height by which heights differ that count as one
_ADVANCE = 1e-3  # metres: less progress on a path is rounding, as of a vehicle that climbs
_END = 1.0  # metres before the end of a path, which a vehicle cuts
_FASTEST = 2.0  # times the planned speed, at which progress on a path may go
_THIN = 0.02  # footprints: half the width of parts of the rest that are left out
_SMALL = 0.02  # footprints squared: area of such parts

Floats = NDArray[np.float64]


class FlownPart(NamedTuple):
    """A part of a flight: a way from the time ``begin`` on, either with positions, or between two
    positions without any. The latter has the distance in metres by which the vehicle may have been
    off a straight way as its ``circle``.
    """

    begin: float
    way: Trajectory
    known: bool


@dataclass(frozen=True)
class FlownHeights:
    """How much of a search was flown far below or above its planned heights above home.

    Parameters
    ----------
    far : float
        The difference in metres from which on a height is far from the planned one: one minus
        `HIGH_ENOUGH`, times the median of the planned heights.
    lower_m, higher_m : float
        Length of the search that was flown so.
    lower, higher : tuple of (float, float)
        The lowest and the highest height above home there, in metres.
    """

    far: float
    lower_m: float
    higher_m: float
    lower: tuple[float, float]
    higher: tuple[float, float]


@dataclass(frozen=True, eq=False)
class FlownMission:
    """What one robot has flown.

    Parameters
    ----------
    mission : Mission
    track : Track
    stretches : list of ndarray of float64, shape (k, 3)
        The parts of the track on which it followed the search of its mission, in metres, with
        heights above home.
    searched_m, planned_m : float
        Length of the search of the mission that it followed, and in all.
    farthest_m : float
        Largest distance of these parts from the mission's path.
    heights : FlownHeights or None
        None for a rover, and if the mission states no heights above home.
    aloft : Trajectory or None
        Its way from the first to the last moment in flight, in metres east, north and up above
        home.
    begin : float
        Time of the first moment in flight, as in the track.
    parts : tuple of FlownPart
        The parts of this way with and without positions.
    """

    mission: Mission
    track: Track
    stretches: list[Floats]
    searched_m: float
    planned_m: float
    farthest_m: float
    heights: FlownHeights | None
    aloft: Trajectory | None
    begin: float
    parts: tuple[FlownPart, ...] = ()

    def report(self) -> dict[str, Any]:
        """Return what was flown as a mapping for JSON."""
        length = 0.0 if self.aloft is None else float(step_lengths(self.aloft.points[:, :2]).sum())
        return {
            "robot": self.mission.robot,
            "sortie": self.mission.sortie,
            "log": self.track.file,
            "system": self.track.system,
            "duration_s": 0.0 if self.aloft is None else self.aloft.duration,
            "length_m": length,
            "planned_length_m": self.mission.length,
            "searched_m": self.searched_m,
            "planned_search_m": self.planned_m,
            "farthest_m": self.farthest_m,
            "lower_m": None if self.heights is None else self.heights.lower_m,
            "higher_m": None if self.heights is None else self.heights.higher_m,
            "begin": self.begin if self.track.absolute else None,
        }


@dataclass(frozen=True, eq=False)
class FlownCheck:
    """What all robots have flown.

    Parameters
    ----------
    flown : tuple of FlownMission
    coverage : AreaCoverage or None
        What was seen of the region, or None without a region or a footprint.
    region : SearchRegion or None
    approach : MissionApproach or None
        The nearest approach of two vehicles in flight while the positions of both are known; its
        time counts from the first take-off.
    notes : tuple of str
    unmeasured : tuple of str
        Sentences that say where two vehicles may have come nearer than the required separation,
        because their positions or times are unknown.
    unknown_s : float
        Seconds of flight without positions, while another vehicle flew.
    uncovered : shapely geometry or None
        What is uncovered without thin and small parts, in metres.
    """

    flown: tuple[FlownMission, ...]
    coverage: AreaCoverage | None
    region: SearchRegion | None
    approach: MissionApproach | None
    notes: tuple[str, ...]
    unmeasured: tuple[str, ...]
    unknown_s: float
    uncovered: Any

    def report(self) -> dict[str, Any]:
        """Return the result as a mapping for JSON."""
        seen, region = self.coverage, self.region
        frame = None if region is None else region.frame
        return {
            "robots": [flight.report() for flight in self.flown],
            "region": None if region is None else region.name,
            "covered_fraction": None if seen is None else seen.covered_fraction,
            "uncovered_m2": None if seen is None else seen.uncovered_m2,
            "rest_m2": None if self.uncovered is None else float(self.uncovered.area),
            "nearest_approach": None if self.approach is None else self.approach.report(frame),
            "without_positions_s": self.unknown_s,
            "notes": [*self.notes, *self.unmeasured],
        }

    def write_uncovered(self, path: str | Path) -> bool:
        """Write the rest as a region file for ``shoal search``; return whether there is any."""
        import shapely

        if self.uncovered is None or self.uncovered.is_empty or self.region is None:
            return False
        frame = self.region.frame
        shape = (
            self.uncovered if frame is None else shapely.transform(self.uncovered, frame.to_degrees)
        )
        feature = {
            "type": "Feature",
            "properties": {"name": f"rest of {self.region.name}"},
            "geometry": json.loads(shapely.to_geojson(shapely.orient_polygons(shape))),
        }
        write_json(path, feature, indent=None)
        return True


def check_flown(
    pairs: Sequence[tuple[Mission, Track]],
    options: CheckOptions | None,
    *,
    angle: float | str | None,
) -> FlownCheck:
    """Compare tracks with missions, and measure what was seen of a region.

    A vehicle sees while it follows the search of its mission: from when it comes within a footprint
    of its first waypoint, forwards along the path, within a footprint of it. What it flies over on
    its ways out and home, or after it has left its path, does not count.
    The images of a camera follow the height; a footprint is the same at any height, and notes tell how
    much of a search was far below or above its planned height.

    Parameters
    ----------
    pairs : sequence of (Mission, Track)
    options : CheckOptions, optional
        Region, footprint and separation; without them, only the tracks are compared.
    angle : float, optional
        Angle of the footprints that the mission files give.

    Raises
    ------
    InvalidInputError
        If a mission is in metres.
    """
    for mission, _ in pairs:
        if not mission.geographic:
            raise InvalidInputError(
                f"{mission.name}: expected a mission in degrees, as flight logs are, got metres"
            )
    region: SearchRegion | None = None if options is None else options.place
    if region is not None and region.frame is None:
        raise InvalidInputError(
            f"region: expected a region with a position on Earth, got {region.name} in metres"
        )
    frame = LocalFrame(*pairs[0][0].home) if region is None else region.frame
    assert frame is not None
    sides = {mission.robot: _footprint_side(options, mission) for mission, _ in pairs}
    flown = tuple(
        _match_flight(mission, track, frame, sides[mission.robot]) for mission, track in pairs
    )
    coverage, uncovered = None, None
    if region is not None and options is not None and options.sides is not None:
        stretches = [part for flight in flown for part in flight.stretches]
        widths = [sides[flight.mission.robot] for flight in flown for _ in flight.stretches]
        region, coverage, uncovered = _check_coverage(
            region, options, stretches, widths, angle, flown, frame
        )
    required = None if options is None else options.required_separation
    approach = _nearest_approach(flown, np.inf if required is None else required.vertical)
    gaps, unknown = _unknown_distances(flown, np.inf if required is None else required.horizontal)
    gaps += _unknown_ends(flown)
    reasons = _unknown_times(flown)
    return FlownCheck(
        flown,
        coverage,
        region,
        None if reasons else approach,
        tuple(_notes(flown)),
        tuple(reasons or gaps),
        unknown,
        uncovered,
    )


_USUAL_SIDE = 10.0  # metres: how near to its path a vehicle must be, if no footprint is known


def _footprint_side(options: CheckOptions | None, mission: Mission) -> float:
    sides = None if options is None else options.sides
    if sides is None:
        return _USUAL_SIDE
    if isinstance(sides, tuple):
        if mission.robot > len(sides):
            raise InvalidInputError(
                f"footprint: expected one for each robot, got {len(sides)} and robot {mission.robot}"
            )
        return sides[mission.robot - 1]
    return sides


def _planned_heights(mission: Mission) -> Floats | None:
    """Return the heights above home of the waypoints of a search, or None if the mission does not
    state any, or if most of them are below home.
    """
    above_sea = mission.altitude_frame == "sea" and mission.elevation is None
    above_ground = mission.altitude_frame == "ground" and mission.heights is None
    if mission.kind == "rover" or above_sea or above_ground:
        return None
    heights = mission.heights_above_home[mission.searched]
    return heights if np.median(heights) > 0 else None


def _match_flight(mission: Mission, track: Track, frame: LocalFrame, side: float) -> FlownMission:
    path = frame.to_metres(mission.waypoints[mission.searched])
    points = frame.to_metres(track.places)
    # what a receiver says of a rover's height is an error, and would count as a distance
    heights = track.heights * (mission.kind != "rover")
    raised = np.column_stack([points, heights])
    planned_heights = _planned_heights(mission)
    stretches, searched, farthest, flown_heights = _follow_path(
        path, planned_heights, raised, track.times, side, mission.speed
    )
    if mission.kind == "rover":
        moving = np.hypot(*(points - points[0]).T) > _LEFT
    else:
        moving = track.heights > ALOFT
    aloft, begin = None, float(track.times[0])
    parts: tuple[FlownPart, ...] = ()
    if moving.any():
        first = int(np.argmax(moving))
        last = len(moving) - int(np.argmax(moving[::-1]))
        if last - first > 1:
            begin = float(track.times[first])
            aloft = Trajectory(track.times[first:last] - begin, raised[first:last])
            # it took off or landed in a gap
            first -= bool(first) and bool(track.times[first] - track.times[first - 1] > GAP)
            last += bool(last < len(moving) and track.times[last] - track.times[last - 1] > GAP)
            parts = _parts(track.times[first:last], raised[first:last], _FASTEST * mission.speed)
    planned = float(step_lengths(path).sum())
    return FlownMission(
        mission,
        track,
        stretches,
        searched,
        planned,
        farthest,
        flown_heights,
        aloft,
        begin,
        parts,
    )


def _parts(times: Floats, way: Floats, fastest: float) -> tuple[FlownPart, ...]:
    """Return the parts of a flight with and without positions, in the order of time.

    In a gap of t seconds, a vehicle of the speed v is at most v t / 2 from where a straight and
    steady flight would be.
    """
    parts = []
    gaps = np.flatnonzero(np.diff(times) > GAP)
    for part in np.split(np.arange(len(times)), gaps + 1):
        if len(part) > 1:
            known = Trajectory(times[part] - times[part[0]], way[part])
            parts.append(FlownPart(float(times[part[0]]), known, True))
    for gap in gaps.tolist():
        lasts = float(times[gap + 1] - times[gap])
        length = float(np.hypot(*(way[gap + 1] - way[gap])[:2]))
        reach = max(fastest * lasts, length) / 2
        ends = Trajectory(np.array([0.0, lasts]), way[gap : gap + 2], reach)
        parts.append(FlownPart(float(times[gap]), ends, False))
    return tuple(sorted(parts, key=lambda part: part.begin))


def _follow_path(
    path: Floats,
    planned_heights: Floats | None,
    points: Floats,
    times: Floats,
    side: float,
    speed: float,
) -> tuple[list[Floats], float, float, FlownHeights | None]:
    """Return the parts of a track that follow a path forwards, how far on the path the track came,
    the largest distance between them, and how far the heights differ.

    The progress on the path only grows, and only as far as the vehicle may have flown meanwhile.
    """
    import shapely

    lengths = partial_sums(step_lengths(path))
    far = 0.0 if planned_heights is None else (1 - HIGH_ENOUGH) * float(np.median(planned_heights))
    lower_m = higher_m = 0.0
    lower: list[float] = []
    higher: list[float] = []

    line = shapely.LineString(path) if len(path) > 1 else shapely.Point(path[0])
    total = float(line.length)
    progress: float | None = None
    reached_at = 0.0
    searched = farthest = 0.0
    nearest = np.inf  # to the beginning of the path, and then to its end
    stretches: list[list[Floats]] = []
    before: float | None = None  # time of the last position that followed the path
    for point, now in zip(points, times.tolist(), strict=True):
        position = shapely.Point(point[:2])
        if progress is None:
            end_distance = float(np.hypot(*(point[:2] - path[0])))
            if end_distance > side / 2 or end_distance < nearest:
                nearest = end_distance  # on its way out, the camera takes no images
                begin = point
                continue
            progress, reached_at, before, nearest = 0.0, now, now, np.inf
            stretches.append([begin])
        ahead = side + _FASTEST * speed * (now - reached_at)
        window = _subline(line, max(0.0, progress - side), min(total, progress + ahead))
        distance = float(window.distance(position))
        if distance > side:
            before = None
            continue
        at = max(0.0, progress - side) + (float(window.project(position)) if total else 0.0)
        advance, progress = max(at - progress, 0.0), max(at, progress)
        if total - progress < _END:
            end_distance = float(np.hypot(*(point[:2] - path[-1])))
            if end_distance > nearest:
                break  # the search is over: what follows is the way home
            nearest = end_distance
        reached_at = now
        searched, farthest = max(searched, progress), max(farthest, distance)
        if planned_heights is not None and advance > _ADVANCE:
            up, planned = float(point[2]), float(np.interp(progress, lengths, planned_heights))
            if up < planned - far:
                lower_m += advance
                lower.append(up)
            elif up > planned + far:
                higher_m += advance
                higher.append(up)
        if before is None or now - before > GAP:
            stretches.append([])
        stretches[-1].append(point)
        before = now
    parts = [np.array(part) for part in stretches]
    heights = None
    if planned_heights is not None:
        ranges = [(min(ups, default=0.0), max(ups, default=0.0)) for ups in (lower, higher)]
        heights = FlownHeights(far, lower_m, higher_m, *ranges)
    return (
        [_thinned(part) if len(part) > 2 else part for part in parts],
        searched,
        farthest,
        heights,
    )


def _thinned(part: Floats) -> Floats:
    """Return a part of a track without positions on straight lines at almost the same height, in
    place of which it has the mean height.
    """
    heights, begin = part[:, 2].copy(), 0
    low = high = float(part[0, 2])
    for k, up in enumerate([*part[:, 2].tolist(), np.inf]):
        low, high = min(low, up), max(high, up)
        if high - low > _LEVEL * max(abs(low), 1.0):
            heights[begin:k] = part[begin:k, 2].mean()
            begin, low, high = k, up, up
    return merge_straight_legs(np.column_stack([part[:, :2], heights]), _STRAIGHT)


def _subline(line: Any, begin: float, end: float) -> Any:
    from shapely.ops import substring

    return substring(line, begin, end) if line.length else line


def _check_coverage(
    region: SearchRegion,
    options: CheckOptions,
    stretches: list[Floats],
    widths: list[float],
    angle: float | str | None,
    flown: Sequence[FlownMission],
    frame: LocalFrame,
) -> tuple[SearchRegion, AreaCoverage, Any]:
    """Return the region that can be seen, what was seen of it, and the rest."""
    import shapely

    footprint, vehicle = options.sides, options.chosen_vehicle
    least = float(np.min(np.array(footprint, dtype=np.float64)))
    image = None if vehicle is None or footprint != vehicle.row_spacing else image_of(vehicle)
    planned = [
        frame.to_metres(flight.mission.waypoints[flight.mission.searched]) for flight in flown
    ]
    facing = options.angle if options.angle is not None else angle
    angle, image = facing_of(facing, image, planned)
    region = visible_region(region, least, angle)
    views = None
    if vehicle is not None and vehicle.image_size is not None and footprint == vehicle.row_spacing:
        legs = [
            *zip((part[:-1] for part in stretches), (part[1:] for part in stretches), strict=True)
        ]
        starts, ends = (
            (np.concatenate([np.zeros((0, 3)), *own]) for own in zip(*legs, strict=True))
            if legs
            else (np.zeros((0, 3)),) * 2
        )
        views = swept_views(starts, ends, vehicle)
    coverage = coverage_check(
        region,
        [part[:, :2] for part in stretches],
        widths if stretches else least,
        tolerance=ROUNDING,
        angle=angle,
        image=image,
        views=views,
    )
    opened = coverage.uncovered.buffer(-_THIN * least, join_style="mitre")
    opened = opened.buffer(_THIN * least, join_style="mitre").intersection(region.free)
    parts = [
        part
        for part in shapely.get_parts(opened)
        if part.geom_type == "Polygon" and part.area > _SMALL * least**2
    ]
    return region, coverage, shapely.MultiPolygon(parts)


def _notes(flown: Sequence[FlownMission]) -> Iterator[str]:
    for flight in flown:
        heights = flight.heights
        if heights is None and flight.mission.kind != "rover":
            yield (
                f"robot {flight.mission.robot}: its heights were not compared with those of its"
                " mission, which are not above home"
            )
        if heights is not None:
            for length, (least, most), where in (
                (heights.lower_m, heights.lower, "below"),
                (heights.higher_m, heights.higher, "above"),
            ):
                if length >= _END:
                    yield (
                        f"robot {flight.mission.robot}: {length:.0f} m of its search were flown"
                        f" {least:.3g} to {most:.3g} m above home, more than {heights.far:.2g} m"
                        f" {where} the planned height"
                    )
        if flight.aloft is None:
            yield f"robot {flight.mission.robot}: its log shows no flight"
        if flight.track.stepped_back:
            yield (
                f"robot {flight.mission.robot}: the clock of its log steps back by"
                f" {flight.track.stepped_back:.3g} s"
            )


def _unknown_times(flown: Sequence[FlownMission]) -> list[str]:
    """Return why the flights of several vehicles have no common time, if so."""
    aloft = [flight for flight in flown if flight.aloft is not None]
    if len(aloft) < 2:
        return []
    if any(flight.track.stepped_back for flight in aloft):
        return ["the nearest approach is not known, because the clock of a log steps back"]
    one_log = len({flight.track.file for flight in aloft}) == 1
    if not one_log and not all(flight.track.absolute for flight in aloft):
        return ["the nearest approach is not known, because a log has no time of day"]
    return []


def _part_approaches(
    flight: FlownMission, other: FlownMission, vertical: float
) -> Iterator[tuple[FlownPart, FlownPart, Approach]]:
    """Yield the nearest approach on each two parts of two flights. Where a position is unknown, the
    height is any height.
    """
    levels = common_levels(flight.mission, other.mission) or (0.0, 0.0)
    for mine, theirs in product(flight.parts, other.parts):
        later = theirs.begin - mine.begin
        if not -theirs.way.duration <= later <= mine.way.duration:
            continue
        near = nearest_approach(
            raised(mine.way, levels[0]),
            raised(theirs.way, levels[1]),
            vertical=vertical if mine.known and theirs.known else np.inf,
            later=later,
        )
        if near is not None:
            yield mine, theirs, near


def _pairs(flown: Sequence[FlownMission]) -> Iterator[tuple[FlownMission, FlownMission]]:
    for flight, other in combinations(flown, 2):
        if flight.mission.robot != other.mission.robot:
            yield flight, other


def _nearest_approach(flown: Sequence[FlownMission], vertical: float) -> MissionApproach | None:
    """Return the nearest approach of two vehicles in flight, while the positions of both are
    known.
    """
    best: MissionApproach | None = None
    begin = min((flight.begin for flight in flown if flight.aloft is not None), default=0.0)
    for flight, other in _pairs(flown):
        for mine, theirs, near in _part_approaches(flight, other, vertical):
            if mine.known and theirs.known and (best is None or near.horizontal < best.horizontal):
                best = MissionApproach(
                    (flight.mission.robot, other.mission.robot),
                    (flight.mission.sortie, other.mission.sortie),
                    near.horizontal,
                    near.vertical,
                    mine.begin - begin + near.times[0],
                    near.places[0],
                )
    return best


def _unknown_distances(flown: Sequence[FlownMission], required: float) -> tuple[list[str], float]:
    """Return where vehicles without positions may have come nearer to another one than a required
    distance, and the seconds without positions while another vehicle flew.
    """
    nearest: dict[int, tuple[float, int]] = {}  # by robot: the distance and the other robot
    lasts: dict[tuple[int, float], float] = {}  # by robot and begin of the gap
    for flight, other in _pairs(flown):
        for mine, theirs, near in _part_approaches(flight, other, np.inf):
            begin = max(mine.begin, theirs.begin)
            end = min(mine.begin + mine.way.duration, theirs.begin + theirs.way.duration)
            for part, one, another in ((mine, flight, other), (theirs, other, flight)):
                if part.known:
                    continue
                robot, beside = one.mission.robot, another.mission.robot
                key = robot, part.begin
                lasts[key] = min(lasts.get(key, 0.0) + end - begin, part.way.duration)
                if near.horizontal < required:
                    nearest[robot] = min(
                        (near.horizontal, beside), nearest.get(robot, (np.inf, beside))
                    )
    sentences = []
    for robot, (distance, beside) in sorted(nearest.items()):
        unknown = sum(seconds for (one, _), seconds in lasts.items() if one == robot)
        sentences.append(
            f"robot {robot}: its log has no positions for {unknown:.3g} s while others flew, in"
            f" which it may have come within {distance:.3g} m of robot {beside}"
        )
    return sentences, sum(lasts.values())


def _unknown_ends(flown: Sequence[FlownMission]) -> list[str]:
    """Return which logs begin or end in flight while another vehicle flew before or after."""
    sentences = []
    for flight in flown:
        others = [part for one in flown if one is not flight for part in one.parts]
        track = flight.track
        first, last = float(track.times[0]), float(track.times[-1])
        if flight.mission.kind == "rover" or not flight.parts:
            continue
        for aloft, beside, verb in (
            (track.heights[0] > ALOFT, any(part.begin < first - GAP for part in others), "begins"),
            (
                track.heights[-1] > ALOFT,
                any(part.begin + part.way.duration > last + GAP for part in others),
                "ends",
            ),
        ):
            if aloft and beside:
                sentences.append(
                    f"robot {flight.mission.robot}: its log {verb} in flight, while others flew"
                )
    return sentences


def assign_tracks(
    missions: Mapping[int, Mission],
    logs: Sequence[tuple[int | None, Sequence[Track]]],
    systems: Mapping[int, int],
) -> list[tuple[Mission, Track]]:
    """Return each track with the mission of its robot.

    Parameters
    ----------
    missions : mapping of int to Mission
        By robot.
    logs : sequence of (int or None, sequence of Track)
        The robot that is named for a log, if any, and the tracks in the log.
    systems : mapping of int to int
        Robot by MAVLink system id, for logs with several vehicles.

    Raises
    ------
    InvalidInputError
        If a track belongs to no robot or to several, or if no track belongs to any.
    """
    pairs: list[tuple[Mission, Track]] = []
    for named, tracks in logs:
        for track in tracks:
            robot = named
            if named is not None and len(tracks) > 1:
                raise InvalidInputError(
                    f"{track.file}: expected one vehicle in a log of robot {named}, got"
                    f" {len(tracks)}; give --systems instead"
                )
            if robot is None and track.system is not None:
                robot = systems.get(track.system)
                if robot is None and systems:
                    continue  # another vehicle on the link
            if robot is None and len(missions) == 1 and len(tracks) == 1:
                (robot,) = missions
            if robot is None:
                raise InvalidInputError(
                    f"{track.file}: expected to know its robot, got none: write ROBOT={track.file},"
                    " or give --systems for a .tlog"
                )
            if robot not in missions:
                raise InvalidInputError(
                    f"{track.file}: expected a robot of the missions"
                    f" ({', '.join(map(str, sorted(missions)))}), got robot {robot}"
                )
            if any(mission.robot == robot for mission, _ in pairs):
                raise InvalidInputError(
                    f"{track.file}: expected one track for each robot, got robot {robot} again"
                )
            pairs.append((missions[robot], track))
    if not pairs:
        raise InvalidInputError("logs: expected a track of a robot, got none")
    return sorted(pairs, key=lambda pair: pair[0].robot)
