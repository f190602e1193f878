"""Upload missions, fences and rally points to the vehicles of several robots, and read back what is
on board.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import field
from threading import BoundedSemaphore
from typing import Any

from shoal.core.checks import check_function, check_list, count_text
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.robots.mavlink import (
    ARDUPILOT,
    AUTOPILOTS,
    KINDS_OF_TYPES,
    HeardVehicle,
    LinkError,
    LinkLimits,
    Station,
    open_link,
    type_text,
)
from shoal.robots.mission_protocol import (
    FENCE,
    MISSION,
    RALLY,
    ItemComparison,
    MissionItem,
    RefusedError,
    UnansweredError,
    clear_items,
    compare_items,
    download_items,
    item_on_air,
    upload_items,
)
from shoal.robots.onboard import Cargo, Seat, check_pairs

ORDER = (FENCE, RALLY, MISSION)
"""The order of uploads: PX4 judges a mission by the fence that is on board."""
_FEW = 8  # unanswered repeats after which what was on board before stays unknown
_SLICE = 0.02  # seconds for which one of several links is listened to
_NAMES = {MISSION: "mission", FENCE: "fence", RALLY: "rally points"}

_UNKNOWN = "what is on board is not known: upload again before any flight"

EQUAL, DIFFERENT, REFUSED = "equal", "different", "refused"
FAILED, UNSUPPORTED, PLANNED = "failed", "unsupported", "dry-run"


@dataclass
class Delivery:
    """What became of the upload to one robot's vehicle.

    Parameters
    ----------
    robot, system : int
    mission, fence, rally : int
        Numbers of items of the files, without home.
    status : str
        "equal" (all items were read back as they are in the files), "different", "refused" (the
        vehicle is not the one that is meant, is armed, or refused items), "unsupported" (the
        vehicle has no fence or no rally points), "failed" (it was not heard, or did not answer), or
        "dry-run".
    different : int or None
        Number of items that differed when they were read back, None if they were not.
    faults : list of str
        What is wrong, a clause each.
    notes : list of str
        What the operator should know beside that.
    link : str or None
        The vehicle's link, if it was heard.
    """

    robot: int
    system: int
    mission: int
    fence: int
    rally: int
    status: str = FAILED
    different: int | None = None
    faults: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    link: str | None = None

    def report(self) -> dict[str, Any]:
        """Return the delivery as a mapping for JSON."""
        return dict(vars(self))

    @property
    def sentence(self) -> str:
        """One sentence about a delivery that is not equal."""
        return f"robot {self.robot} (system {self.system}): {'; '.join(self.faults)}"


@contextmanager
def open_stations(
    links: Sequence[str], limits: LinkLimits | None = None
) -> Iterator[list[Station]]:
    """Open links and a ground station on each; close them at the end of the ``with`` block.

    Raises
    ------
    InvalidInputError
        If a link comes twice or cannot be opened.
    """
    links = check_list(links, str, what="connect")
    for number, link in enumerate(links):
        if link in links[:number]:
            raise InvalidInputError(f"connect: expected each link once, got {link} again")
    opened: list[Station] = []
    try:
        for link in links:
            station = Station(open_link(link), limits)
            opened.append(station)
        yield opened
    finally:
        for station in opened:
            station.close()


def links_of(connect: Sequence[str], seats: Mapping[int, Seat]) -> list[str]:
    """Return the links of ``--connect`` and those that seats name, each once.

    Raises
    ------
    InvalidInputError
        If there is none.
    """
    named = [seat.link for seat in seats.values() if seat.link is not None]
    links = [*connect, *(link for link in dict.fromkeys(named) if link not in connect)]
    if not links:
        raise InvalidInputError("connect: expected a link, such as udpin:0.0.0.0:14550, got none")
    return links


Vehicles = dict[int, tuple[Station, HeardVehicle]]
"""By robot, its vehicle and the station that hears it."""


def find_vehicles(
    seats: Sequence[Seat], stations: Sequence[Station]
) -> tuple[Vehicles, dict[int, tuple[str, str]]]:
    """Listen until each robot's vehicle is heard, and return them by robot. The second result has
    a status and a clause for each robot whose vehicle is missing or ambiguous.
    """
    ends = {
        id(station): (
            station.now() + station.limits.settle,
            station.now() + station.limits.find_within,
        )
        for station in stations
    }

    def find_candidates(seat: Seat) -> list[tuple[Station, HeardVehicle]]:
        return [
            (station, station.vehicles[seat.system])
            for station in stations
            if seat.system in station.vehicles and seat.link in (None, station.link.name)
        ]

    while True:
        complete = all(find_candidates(seat) for seat in seats)
        waiting = [
            station
            for station in stations
            if station.now() < ends[id(station)][0 if complete else 1]
        ]
        if not waiting:
            break
        for station in waiting:
            station.listen(station.now() + _SLICE)
    vehicles: Vehicles = {}
    missing: dict[int, tuple[str, str]] = {}
    for seat in seats:
        candidates = find_candidates(seat)
        links = " and ".join(station.link.name for station, _ in candidates)
        if not candidates:
            others = sorted({system for station in stations for system in station.vehicles})
            limit = max(station.limits.find_within for station in stations)
            missing[seat.robot] = (
                FAILED,
                f"expected a heartbeat of {seat.text} within {limit:g} s, got"
                + (f" systems {', '.join(map(str, others))}" if others else " none"),
            )
        elif len(candidates) > 1:
            missing[seat.robot] = (
                REFUSED,
                f"expected one vehicle with system id {seat.system}, got one on {links}: name the"
                f" link of each robot, such as"
                f" {seat.robot}={seat.system}@{candidates[0][0].link.name}",
            )
        elif seat.system in candidates[0][0].duplicates:
            missing[seat.robot] = (
                REFUSED,
                f"expected one vehicle with system id {seat.system} on {links}, got heartbeats from"
                f" {len(candidates[0][0].duplicates[seat.system])} addresses at the same time",
            )
        else:
            vehicles[seat.robot] = candidates[0]
    return vehicles, missing


def check_type(cargo: Cargo, vehicle: HeardVehicle) -> str | None:
    """Return a clause if a vehicle is of another kind than its mission, and None if it may fly it.
    A vehicle that does not say what it is counts as the right one. A ``.waypoints`` file does not
    say whether what flies is a multirotor, unless it has an airspeed.
    """
    kinds = KINDS_OF_TYPES.get(vehicle.type)
    fitting_kinds = {cargo.mission.kind}
    if cargo.file.suffix != ".plan" and cargo.mission.kind == "multirotor":
        fitting_kinds.add("fixed-wing")
    if kinds is None or fitting_kinds & kinds:
        return None
    return f"expected a {cargo.mission.kind} for {cargo.file.name}, got a {type_text(vehicle)}"


def items_for(cargo: Cargo, vehicle: HeardVehicle) -> dict[str, list[MissionItem]]:
    """Return the items of a robot as they are sent to its vehicle. ArduPilot's mission begins with
    home.
    """
    items = {kind: [item_on_air(item) for item in cargo.items[kind]] for kind in ORDER}
    if vehicle.autopilot == ARDUPILOT and items[MISSION]:
        items[MISSION].insert(0, item_on_air(cargo.home))
    return items


def new_delivery(cargo: Cargo, seat: Seat, status: str = FAILED) -> Delivery:
    """Return the delivery of a cargo of which nothing is sent yet."""
    mission, fence, rally = (len(cargo.items[kind]) for kind in (MISSION, FENCE, RALLY))
    return Delivery(cargo.robot, seat.system, mission, fence, rally, status)


def upload_missions(
    pairs: Sequence[tuple[Cargo, Seat]],
    stations: Sequence[Station],
    *,
    on_event: Callable[[str], None] = lambda _text: None,
) -> list[Delivery]:
    """Upload what belongs on board of each robot's vehicle, and read it back.

    Each link serves as many vehicles at the same time as it can. If one vehicle is of the wrong type, the mapping is wrong, and nothing is sent to any.
    Nothing is sent to an armed vehicle. If what is read back differs after several attempts, or if
    a vehicle refuses items, what was on board before is restored, or cleared if it is not known.

    Parameters
    ----------
    pairs : sequence of (Cargo, Seat)
    stations : sequence of Station
    on_event : callable, optional
        Function that is called with a text when the upload to a vehicle begins.

    Returns
    -------
    list of Delivery
        One for each pair, in their order.
    """
    check_function(on_event, what="on_event", optional=False)
    pairs = check_pairs(pairs)
    stations = check_list(stations, Station, what="stations")
    deliveries = {cargo.robot: new_delivery(cargo, seat) for cargo, seat in pairs}
    cargos = {cargo.robot: cargo for cargo, _ in pairs}
    vehicles, missing = find_vehicles([seat for _, seat in pairs], stations)
    for station in stations:
        for system in sorted(station.vehicles.keys() - {seat.system for _, seat in pairs}):
            on_event(f"system {system} on {station.link.name} is no robot's: nothing is sent to it")
    wrong = False
    for robot, (status, clause) in missing.items():
        deliveries[robot].status = status
        deliveries[robot].faults.append(clause)
    for robot, (station, vehicle) in vehicles.items():
        delivery, cargo = deliveries[robot], cargos[robot]
        delivery.link = station.link.name
        unfit = check_type(cargo, vehicle)
        if unfit is not None:
            wrong = True
        elif vehicle.armed:
            unfit = "expected a disarmed vehicle, got an armed one"
        if unfit is not None:
            delivery.status = REFUSED
            delivery.faults.append(unfit)
        autopilot = AUTOPILOTS.get(vehicle.autopilot)
        if (
            autopilot is not None
            and autopilot.lower() != cargo.mission.autopilot
            and cargo.file.suffix == ".plan"
        ):
            delivery.notes.append(
                f"{cargo.file.name} is for {cargo.mission.autopilot}, and the vehicle has"
                f" {autopilot}"
            )
    clear = [robot for robot in vehicles if deliveries[robot].status != REFUSED]
    if wrong:
        for robot in clear:
            deliveries[robot].status = REFUSED
            deliveries[robot].faults.append(
                "nothing was sent, because another robot has a vehicle of the wrong type"
            )
        return list(deliveries.values())

    semaphores = {id(station): BoundedSemaphore(station.link.at_once) for station in stations}
    uploads: list[int] = []

    def serve(robot: int) -> None:
        station, vehicle = vehicles[robot]
        with semaphores[id(station)]:
            if station.stopped:
                return
            uploads.append(robot)
            on_event(f"robot {robot}: upload to system {deliveries[robot].system}")
            deliver(station, vehicle, cargos[robot], deliveries[robot])

    try:
        if len(clear) == 1 or (len(stations) == 1 and stations[0].link.at_once == 1):
            for robot in clear:
                serve(robot)
        elif clear:
            with ThreadPoolExecutor(len(clear)) as pool:
                try:
                    list(pool.map(serve, clear))
                except BaseException:
                    for station in stations:
                        station.stopped = True  # the other threads end soon
                    raise
    except BaseException:
        for robot in uploads:
            if deliveries[robot].status != EQUAL:
                on_event(f"robot {robot}: interrupted: {_UNKNOWN}")
        raise
    return list(deliveries.values())


def deliver(station: Station, vehicle: HeardVehicle, cargo: Cargo, delivery: Delivery) -> None:
    """Upload to one vehicle, read back, and note in the delivery what became of it."""
    items = items_for(cargo, vehicle)
    lacking: dict[str, str] = {}
    try:
        before = _read_before(station, vehicle, items, lacking)
    except UnansweredError as error:
        delivery.faults.append(f"{error}; nothing was sent")
        return
    remaining = [kind for kind in ORDER if kind not in lacking]
    sent: set[str] = set()
    comparisons: dict[str, ItemComparison] = {}
    fault: LinkError | None = None
    try:
        for _ in range(station.limits.attempts):
            for kind in remaining:
                patient = before[kind] is not None or before[MISSION] is None
                sent.add(kind)
                try:
                    upload_items(
                        station, vehicle, kind, items[kind], unanswered=None if patient else _FEW
                    )
                except RefusedError as error:
                    if kind == MISSION or not error.unsupported:
                        raise
                    lacking[kind] = str(error)
                except UnansweredError as error:
                    if patient or kind == MISSION or error.silent:
                        raise
                    lacking[kind] = str(error)  # it answers about its mission alone
            remaining = [kind for kind in remaining if kind not in lacking]
            for kind in remaining:
                onboard = download_items(station, vehicle, kind)
                comparisons[kind] = compare_items(
                    kind, items[kind], onboard, autopilot=vehicle.autopilot
                )
            remaining = [kind for kind in remaining if comparisons[kind].different]
            if not remaining:
                break
    except LinkError as error:
        fault = error
    _judge(delivery, vehicle, items, comparisons, lacking, fault)
    if fault is None and not remaining:
        return
    lost = isinstance(fault, UnansweredError) and (fault.silent or before[MISSION] is None)
    delivery.faults.append(
        _UNKNOWN if lost else _put_back(station, vehicle, before, sent - lacking.keys())
    )


def _read_before(
    station: Station,
    vehicle: HeardVehicle,
    items: Mapping[str, Sequence[MissionItem]],
    lacking: dict[str, str],
) -> dict[str, list[MissionItem] | None]:
    """Return what is on board before the upload, None for what cannot be read. Note in ``lacking``
    what the vehicle does not have.
    """
    before: dict[str, list[MissionItem] | None] = {}
    mute = False
    for kind in (MISSION, FENCE, RALLY):
        before[kind] = None
        if mute:
            continue
        try:
            onboard = download_items(station, vehicle, kind, unanswered=_FEW)
            home_alone = kind == MISSION and vehicle.autopilot == ARDUPILOT and len(onboard) == 1
            before[kind] = [] if home_alone else onboard
        except RefusedError as error:
            if error.unsupported and kind != MISSION:
                lacking[kind] = str(error)
        except UnansweredError as error:
            if error.silent:
                raise
            mute = kind == MISSION  # it lets nothing be read
            if kind != MISSION and not items[kind]:
                lacking[kind] = str(error)
    return before


def _judge(
    delivery: Delivery,
    vehicle: HeardVehicle,
    items: Mapping[str, Sequence[MissionItem]],
    comparisons: Mapping[str, ItemComparison],
    lacking: Mapping[str, str],
    fault: LinkError | None,
) -> None:
    """Note the status, the faults and the notes of a delivery after its last attempt."""
    missing = [kind for kind in lacking if items[kind]]
    if comparisons or missing:
        delivery.different = sum(comparison.different for comparison in comparisons.values()) + sum(
            len(items[kind]) for kind in missing
        )
    for kind, comparison in comparisons.items():
        delivery.faults += comparison.sentences
        if comparison.dropped:
            fields = [
                f"{name} ({count_text(count, 'item')})"
                for name, count in comparison.dropped.items()
            ]
            delivery.notes.append(f"{kind}: the autopilot does not keep {', '.join(fields)}")
        if comparison.rounded:
            delivery.notes.append(f"{kind}: the vehicle tells positions as float32 (to about 1 m)")
    for kind in missing:
        delivery.faults.append(f"the vehicle has no {_NAMES[kind]}: {lacking[kind]}")
    if fault is not None:
        delivery.faults.append(str(fault))
        delivery.status = REFUSED if isinstance(fault, RefusedError) else FAILED
    elif any(comparison.different for comparison in comparisons.values()):
        delivery.status = DIFFERENT
    else:
        delivery.status = UNSUPPORTED if missing else EQUAL
    if delivery.status != EQUAL:
        delivery.faults += [f"the vehicle says {text!r}" for text in vehicle.texts[-3:]]


def _put_back(
    station: Station,
    vehicle: HeardVehicle,
    before: Mapping[str, list[MissionItem] | None],
    kinds: Collection[str],
) -> str:
    """Restore what was on board before, or clear what is not known, and return a clause that says
    what is on board now, as it was read back.
    """
    outcomes: dict[str, list[str]] = {}
    for kind in (kind for kind in ORDER if kind in kinds):
        outcomes.setdefault(_put_back_kind(station, vehicle, kind, before[kind]), []).append(
            _NAMES[kind]
        )
    return "; ".join(f"{', '.join(names)}: {outcome}" for outcome, names in outcomes.items())


def _put_back_kind(
    station: Station, vehicle: HeardVehicle, kind: str, items: list[MissionItem] | None
) -> str:
    for content, outcome in (
        (items, "restored as before" if items else "empty as before"),
        ([], "cleared"),
    ):
        if content is None:
            continue
        try:
            if content:
                upload_items(station, vehicle, kind, content)
            else:
                clear_items(station, vehicle, kind)
            onboard = download_items(station, vehicle, kind)
        except LinkError:
            continue
        if not compare_items(kind, content, onboard, autopilot=vehicle.autopilot).different:
            return outcome
    return _UNKNOWN
