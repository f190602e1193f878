"""What belongs on board of each vehicle: the items of its mission, its fence and its rally points,
read from mission files, and the vehicle that each robot is.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from shoal.core.checks import (
    as_path,
    check_integer,
    check_kind,
    check_list,
    check_text,
    read_text,
    shortened,
)
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.notices import tell_once
from shoal.missions.diagnostics import Sheet
from shoal.missions.files import mission_of, open_sheets
from shoal.missions.formats import FORMATS, formats_by_suffix
from shoal.missions.formats.fences import FENCE as FENCE_FILE
from shoal.missions.formats.fences import RALLY as RALLY_FILE
from shoal.missions.formats.fences import read_fence, read_rally, table_items
from shoal.missions.formats.items import Item
from shoal.missions.formats.plan import items_on_board
from shoal.missions.mission import Mission
from shoal.robots.mavlink import check_link
from shoal.robots.mission_protocol import FENCE, MISSION, RALLY
from shoal.search.regions.outline import LARGEST_FILE

FORMATS_WITH_ITEMS = ("plan", "wpl")
"""Formats that hold what an autopilot stores, the better one first: WPL cannot leave a heading
open.
"""
_PAIR = re.compile(r"([0-9]{1,6})=([0-9]{1,6})(?:@(\S+))?")


@dataclass(frozen=True)
class Cargo:
    """What belongs on board of one robot's vehicle.

    Parameters
    ----------
    robot, sortie : int
    file : Path
        The file that it was read from.
    mission : Mission
        The mission, with its kind of vehicle, home and start time.
    items : dict of str to tuple of Item
        The items of the "mission" (without home), the "fence" and the "rally" points.
    home : Item
        Home as a waypoint, which ArduPilot has as the first item.
    """

    robot: int
    sortie: int
    file: Path
    mission: Mission
    items: Mapping[str, tuple[Item, ...]]
    home: Item


def read_cargos(folder: str | os.PathLike[str], *, sortie: int = 1) -> dict[int, Cargo]:
    """Read what belongs on board of each robot's vehicle in one sortie, from the ``.plan`` files of
    a folder or, if there are none, from its ``.waypoints`` files and the files beside them.

    Raises
    ------
    InvalidInputError
        If no such file exists, if a file cannot be read or is missing, or if two files have the
        same robot.
    """
    source = as_path(folder, what="folder")
    suffixes = formats_by_suffix()
    sheets = open_sheets(source)
    for mistake in (mistake for sheet in sheets for mistake in sheet.diagnostics):
        if mistake.rule == "file-missing":  # an upload would clear the fence on board
            raise InvalidInputError(f"{source}: {mistake.place}: {mistake.sentence}")
        if mistake.rule == "no-manifest":
            tell_once(f"shoal: warning: {source}: {mistake.sentence}")
    by_format: dict[str, list[Sheet]] = {}
    for sheet in sheets:
        by_format.setdefault(suffixes[Path(sheet.file).suffix.lower()], []).append(sheet)
    form = next((name for name in FORMATS_WITH_ITEMS if name in by_format), None)
    if form is None:
        expected = " or ".join(FORMATS.get(name).suffix for name in FORMATS_WITH_ITEMS)
        raise InvalidInputError(
            f"{source}: expected missions for autopilots ({expected}), got"
            f" {', '.join(FORMATS.get(name).suffix for name in by_format)} alone"
        )
    cargos: dict[int, Cargo] = {}
    for sheet in by_format[form]:
        path = source / sheet.file if source.is_dir() else source
        if sheet.robot is None:
            raise InvalidInputError(
                f"{path}: expected a name with the number of the robot, such as robot-01{path.suffix}"
            )
        if (sheet.sortie or 1) != sortie:
            continue
        mission = mission_of(sheet, path)
        if mission.robot in cargos:
            raise InvalidInputError(
                f"{path}: expected each robot once, got robot {mission.robot} in"
                f" {cargos[mission.robot].file.name} too"
            )
        cargos[mission.robot] = _read_cargo(path, form, mission, beside=source.is_dir())
    for sheet in sheets:  # other formats of the same missions
        if (sheet.sortie or 1) == sortie and sheet.robot is not None and sheet.robot not in cargos:
            raise InvalidInputError(
                f"{source}: expected a file {FORMATS.get(form).suffix} of each robot, got"
                f" {sheet.file} alone of robot {sheet.robot}"
            )
    if not cargos:
        sorties = sorted({sheet.sortie or 1 for sheet in by_format[form]})
        raise InvalidInputError(f"sortie: expected one of {sorties} in {source}, got {sortie}")
    return dict(sorted(cargos.items()))


def _read_cargo(path: Path, form: str, mission: Mission, *, beside: bool) -> Cargo:
    text = read_text(path, what="file that belongs to missions", most=LARGEST_FILE)
    if form == "plan":
        flown, fence, rally = items_on_board(text)
    else:
        flown = table_items(text)[1:]  # without home
        fence, rally = (
            _table_beside(path.parent / name, check) if beside else []
            for name, check in ((FENCE_FILE, read_fence), (RALLY_FILE, read_rally))
        )
    longitude, latitude = mission.home
    home = Item(16, 0, (0.0, 0.0, 0.0, 0.0, latitude, longitude, mission.elevation or 0.0))
    items = {MISSION: tuple(flown), FENCE: tuple(fence), RALLY: tuple(rally)}
    return Cargo(mission.robot, mission.sortie, path, mission, items, home)


def _table_beside(path: Path, check: Callable[[str, str], object]) -> list[Item]:
    """Return the items of a file that all missions share; none if it does not exist."""
    if not path.is_file():
        return []
    text = read_text(path, what="file that belongs to missions", most=LARGEST_FILE)
    check(text, str(path))
    return table_items(text)


@dataclass(frozen=True)
class Seat:
    """The vehicle of a robot: its MAVLink system id and, if it is given, its link."""

    robot: int
    system: int
    link: str | None = None

    @property
    def text(self) -> str:
        """The vehicle in words."""
        return f"system {self.system}" + (f" on {self.link}" if self.link else "")


def read_seats(text: str) -> dict[int, Seat]:
    """Read which vehicle each robot is, from a text such as ``1=1,2=7`` or from a file with one
    ``ROBOT=SYSTEM`` a line. ``ROBOT=SYSTEM@LINK`` names the link, too, for vehicles with equal
    system ids on several links.

    Raises
    ------
    InvalidInputError
        If an entry cannot be read, or if a robot or a vehicle comes twice.
    """
    where = "systems"
    if "=" in check_text(text, what=where):
        entries = [(where, part.strip()) for part in text.split(",")]
    else:
        path = Path(text)
        content = read_text(
            path,
            what="list such as 1=1,2=7, or a file with one ROBOT=SYSTEM a line",
            most=LARGEST_FILE,
        )
        lines = [line.partition("#")[0].strip() for line in content.splitlines()]
        entries = [(f"{path}: line {number}", line) for number, line in enumerate(lines, 1) if line]
    seats: dict[int, Seat] = {}
    for place, entry in entries:
        match = _PAIR.fullmatch(entry)
        if match is None or int(match[1]) < 1 or not 1 <= int(match[2]) <= 255:
            raise InvalidInputError(
                f"{place}: expected ROBOT=SYSTEM with a system id from 1 to 255, such as 1=1, got"
                f" {entry!r}"
            )
        seat = Seat(int(match[1]), int(match[2]), match[3])
        if seat.link is not None:
            check_link(seat.link)
        if seat.robot in seats:
            raise InvalidInputError(
                f"{place}: expected each robot once, got robot {seat.robot} again"
            )
        for other in seats.values():
            if other.system == seat.system and (
                other.link == seat.link or None in (other.link, seat.link)
            ):
                raise InvalidInputError(
                    f"{place}: expected each vehicle once, got {seat.text} for robots"
                    f" {other.robot} and {seat.robot}"
                )
        seats[seat.robot] = seat
    if not seats:
        raise InvalidInputError(
            f"systems: expected ROBOT=SYSTEM, such as 1=1, got none in {text!r}"
        )
    return seats


def check_pairs(pairs: Sequence[tuple[Cargo, Seat]]) -> list[tuple[Cargo, Seat]]:
    """Check pairs of what belongs on board and its vehicle, as `pair` returns them."""
    checked = [check_list(each, what="pairs") for each in check_list(pairs, what="pairs")]
    for each in checked:
        if list(map(type, each)) != [Cargo, Seat]:
            raise InvalidInputError(
                f"pairs: expected pairs of a Cargo and a Seat, got {shortened(each)}"
            )
    return [(cargo, seat) for cargo, seat in checked]


def pair(
    cargos: Mapping[int, Cargo],
    seats: Mapping[int, Seat],
    *,
    robots: Sequence[int] = (),
) -> list[tuple[Cargo, Seat]]:
    """Return each robot's cargo with its vehicle.

    Parameters
    ----------
    robots : sequence of int
        The robots that are meant; all robots if it is empty.

    Raises
    ------
    InvalidInputError
        If a robot has no mission or no vehicle, or an argument is none of these.
    """
    for by_robot, kind, what in ((cargos, Cargo, "cargos"), (seats, Seat, "seats")):
        if not isinstance(by_robot, Mapping):
            raise InvalidInputError(
                f"{what}: expected a mapping from the numbers of robots, got {shortened(by_robot)}"
            )
        for robot, each in by_robot.items():
            check_integer(robot, what=f"{what}: robot")
            check_kind(each, kind, what=what)
    robots = [check_integer(robot, what="robots") for robot in check_list(robots, what="robots")]
    robot_numbers = sorted({*robots} or {*cargos} | {*seats})
    for robot in robot_numbers:
        if robot not in cargos:
            raise InvalidInputError(
                f"systems: expected robots of the missions ({_numbers(cargos)}), got robot {robot}"
            )
        if robot not in seats:
            raise InvalidInputError(
                f"systems: expected a system id for each robot ({_numbers(cargos)}), got none for"
                f" robot {robot}"
            )
    return [(cargos[robot], seats[robot]) for robot in robot_numbers]


def _numbers(by_robot: Mapping[int, object]) -> str:
    return ", ".join(map(str, sorted(by_robot)))
