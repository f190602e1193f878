"""Flight modes of PX4 and ArduPilot: the numbers of each autopilot, and one name for each mode."""

from __future__ import annotations

from shoal.robots.mavlink import ARDUPILOT, KINDS_OF_TYPES, PX4

MISSION, GUIDED, RETURN, LAND, HOLD, MANUAL = (
    "mission",
    "guided",
    "return",
    "land",
    "hold",
    "manual",
)
CUSTOM = 1  # MAV_MODE_FLAG_CUSTOM_MODE_ENABLED

_PX4 = {  # main mode and sub mode
    MISSION: (4, 4),
    GUIDED: (6, 0),  # offboard
    RETURN: (4, 5),
    LAND: (4, 6),
    HOLD: (4, 3),
    MANUAL: (1, 0),
    "take-off": (4, 2),
    "altitude": (2, 0),
    "position": (3, 0),
    "stabilized": (7, 0),
}
_COPTER = {
    MISSION: 3,
    GUIDED: 4,
    RETURN: 6,
    LAND: 9,
    HOLD: 5,
    MANUAL: 0,
    "brake": 17,
    "smart return": 21,
}
_PLANE = {MISSION: 10, GUIDED: 15, RETURN: 11, HOLD: 12, MANUAL: 0, "take-off": 13}
_ROVER = {MISSION: 10, GUIDED: 15, RETURN: 11, HOLD: 4, MANUAL: 0, "smart return": 12}


def custom_modes(autopilot: int, type_: int) -> dict[str, int]:
    """Return the numbers of an autopilot's modes by name; none for an unknown autopilot.

    Parameters
    ----------
    autopilot, type_ : int
        MAV_AUTOPILOT and MAV_TYPE.
    """
    if autopilot == PX4:
        return {name: main << 16 | sub << 24 for name, (main, sub) in _PX4.items()}
    if autopilot != ARDUPILOT:
        return {}
    kinds = KINDS_OF_TYPES.get(type_, frozenset({"multirotor"}))
    if "fixed-wing" in kinds:
        return _PLANE
    return _ROVER if "rover" in kinds else _COPTER


def mode_name(autopilot: int, type_: int, custom_mode: int) -> str:
    """Return the name of a mode, or its number if it has none here.

    Examples
    --------
    >>> mode_name(PX4, 2, 4 << 16 | 5 << 24), mode_name(ARDUPILOT, 2, 3)
    ('return', 'mission')
    """
    for name, number in custom_modes(autopilot, type_).items():
        if number == custom_mode:
            return name
    return f"mode {custom_mode}"
