"""What an autopilot must be set to before a robot takes off, so that its own watchdogs bring the
vehicle home when the companion computer is lost.

The names, values and units are those of the parameter descriptions of PX4 (1.12 to 1.16) and of
ArduPilot Copter and Rover (4.0 to 4.7).
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

from shoal.core.dataclass import dataclass
from shoal.robots.mavlink import PX4

CHECKS = ("failsafe", "fence", "return")
"""What an operator can check instead of the program."""
MY_STATION, LAST_STATION = ("SYSID_MYGCS", "MAV_GCS_SYSID"), "MAV_GCS_SYSID_HI"
"""System id, or first and last id, of the stations whose heartbeats ArduPilot waits for."""
_CLOSE = 0.5  # metres between a height that is set and the one that is expected
_ABOVE = 2.0  # metres above its height that a robot needs
_FENCE_HEIGHT, _FENCE_POLYGON = 1, 4  # bits of FENCE_TYPE


@dataclass(frozen=True)
class Setting:
    """A parameter of an autopilot that must be right before take-off.

    Parameters
    ----------
    check : str
        What it belongs to: "failsafe", "fence" or "return".
    names : tuple of str
        Names of the parameter in several versions of the autopilot.
    expected : str
        The right values in words.
    why : str
        What the autopilot does with a right value.
    fits : callable
        Function that returns whether a value is right.
    usual : float
        A right value.
    needed : bool
        Whether an autopilot without this parameter is refused.
    """

    check: str
    names: tuple[str, ...]
    expected: str
    why: str
    fits: Callable[[float], bool]
    usual: float
    needed: bool = True


def _one_of(*allowed: int) -> Callable[[float], bool]:
    return lambda value: value in allowed


def _between(least: float, most: float) -> Callable[[float], bool]:
    return lambda value: least <= value <= most


def settings_for(autopilot: int, kind: str, height: float) -> list[Setting]:
    """Return what an autopilot must be set to before a vehicle of a kind takes off.

    Parameters
    ----------
    autopilot : int
        MAV_AUTOPILOT of PX4 or ArduPilot.
    kind : str
        Kind of vehicle: "multirotor" or "rover".
    height : float
        Height in metres above home at which this robot returns, and no other.
    """
    settings = _px4(kind, height) if autopilot == PX4 else _ardupilot(kind, height)
    return [setting for setting in settings if kind != "rover" or setting.check != "return"]


def _px4(kind: str, height: float) -> list[Setting]:
    why = "return or land when the set-points end"
    stops = (3, 4, 5) if kind == "rover" else (3, 4)  # return, land, hold
    return [
        Setting("failsafe", ("COM_OBL_RC_ACT",), _join_numbers(stops), why, _one_of(*stops), 3),
        # before version 1.14, without a remote control
        Setting("failsafe", ("COM_OBL_ACT",), "0 or 2", why, _one_of(0, 2), 2, needed=False),
        Setting(
            "failsafe",
            ("COM_OF_LOSS_T",),
            "0 to 10",
            "seconds without set-points",
            _between(0, 10),
            5.0,
        ),
        Setting(
            "failsafe",
            ("NAV_DLL_ACT",),
            "0, 2 or 3",
            "without heartbeats return or land, or leave it to the set-points",
            _one_of(0, 2, 3),
            2,
        ),
        Setting("fence", ("GF_ACTION",), "3 or 5", "return or land", _one_of(3, 5), 3),
        Setting(
            "fence",
            ("GF_MAX_VER_DIST",),
            f"0 or more than {height + _ABOVE:g}",
            "this robot's height is inside the fence",
            lambda value: value <= 0 or value > height + _ABOVE,
            0.0,
            needed=False,
        ),
        Setting(
            "return",
            ("RTL_RETURN_ALT",),
            f"{height:g}",
            "this robot returns at a height of its own",
            _between(height - _CLOSE, height + _CLOSE),
            height,
        ),
        Setting(
            "return",
            ("RTL_LAND_DELAY",),
            "0 to 60",
            "it lands after its return; with -1, it would hover",
            _between(0, 60),
            0.0,
            needed=False,
        ),
    ]


def _ardupilot(kind: str, height: float) -> list[Setting]:
    why = "return or land when the companion's heartbeats end"
    seconds = "seconds without a heartbeat"
    polygon = Setting(
        "fence",
        ("FENCE_TYPE",),
        f"a value with bit {_FENCE_POLYGON}",
        "the polygons count",
        lambda value: bool(int(value) & _FENCE_POLYGON),
        _FENCE_POLYGON,
    )
    on = Setting("fence", ("FENCE_ENABLE",), "1", "the fence is on", _one_of(1), 1)
    stations = Setting(
        "failsafe",
        MY_STATION,
        "1 to 255",
        "the system id that the companion takes",
        _between(1, 255),
        254,
    )
    if kind == "rover":
        return [
            Setting("failsafe", ("FS_GCS_ENABLE",), "1 or 2", why, _one_of(1, 2), 1),
            Setting("failsafe", ("FS_ACTION",), "1 to 6", "it acts", _between(1, 6), 1),
            Setting(
                "failsafe", ("FS_GCS_TIMEOUT", "FS_TIMEOUT"), "1 to 30", seconds, _between(1, 30), 5
            ),
            stations,
            on,
            Setting("fence", ("FENCE_ACTION",), "1 to 4", "return or hold", _between(1, 4), 1),
            polygon,
        ]
    acts = (1, 3, 4, 5, 6, 7)  # 2 went on with the mission, and was removed in 4.0
    return [
        Setting("failsafe", ("FS_GCS_ENABLE",), _join_numbers(acts), why, _one_of(*acts), 1),
        # before version 4.1, always 5 s
        Setting(
            "failsafe", ("FS_GCS_TIMEOUT",), "1 to 30", seconds, _between(1, 30), 5, needed=False
        ),
        stations,
        on,
        Setting("fence", ("FENCE_ACTION",), "1 to 5", "return or land", _between(1, 5), 1),
        polygon,
        Setting(
            "return",
            ("RTL_ALT", "RTL_ALT_M"),  # since version 4.7 in metres
            f"{height:g} m",
            "this robot returns at a height of its own",
            _between(height - _CLOSE, height + _CLOSE),
            height,
        ),
        Setting(
            "return",
            ("RTL_ALT_FINAL", "RTL_ALT_FINAL_M"),
            "0",
            "it lands after its return; with more, it would hover",
            _one_of(0),
            0,
            needed=False,
        ),
    ]


_CENTIMETRES = ("RTL_ALT", "RTL_ALT_FINAL")


def _join_numbers(numbers: Collection[int]) -> str:
    *first, last = map(str, numbers)
    return f"{', '.join(first)} or {last}"


def names_to_read(settings: Collection[Setting]) -> tuple[set[str], set[str]]:
    """Return the names of all parameters that are read, and of those without which one waits."""
    names = {name for setting in settings for name in setting.names}
    needed = {
        setting.names[0] for setting in settings if setting.needed and len(setting.names) == 1
    }
    return names | ({LAST_STATION, "FENCE_ALT_MAX"} if "FENCE_TYPE" in names else set()), needed


def wrong_settings(
    settings: Collection[Setting],
    values: Mapping[str, float],
    height: float,
    *,
    accepted: Collection[str] = (),
) -> list[str]:
    """Return what is wrong with the values of an autopilot's parameters, a clause each.

    Parameters
    ----------
    settings : collection of Setting
    values : mapping of str to float
        The parameters that the autopilot has.
    height : float
        The robot's height in metres above home.
    accepted : collection of str
        Checks that the operator has made instead.
    """
    faults = []
    for setting in settings:
        readings = [(name, values[name]) for name in setting.names if name in values]
        if setting.check in accepted or (not readings and not setting.needed):
            continue
        if not readings:
            faults.append(
                f"{setting.check}: expected {setting.names[0]} {setting.expected}, got none"
            )
            continue
        name, value = readings[0]
        if not setting.fits(value / 100 if name in _CENTIMETRES else value):
            faults.append(
                f"{setting.check}: expected {name} {setting.expected} ({setting.why}), got"
                f" {value:g}" + (" cm" if name in _CENTIMETRES else "")
            )
    highest = values.get("FENCE_ALT_MAX", height + 2 * _ABOVE)
    if (
        "fence" not in accepted
        and int(values.get("FENCE_TYPE", 0)) & _FENCE_HEIGHT
        and highest <= height + _ABOVE
    ):
        faults.append(
            f"fence: expected FENCE_ALT_MAX above {height + _ABOVE:g} (this robot's height is"
            f" inside the fence), got {highest:g}"
        )
    return faults


def safe_parameters(autopilot: int, kind: str, height: float) -> dict[str, float]:
    """Return parameters that are right, such as those of simulated autopilots.

    Examples
    --------
    >>> safe_parameters(PX4, "rover", 0.0)["COM_OBL_RC_ACT"]
    3
    """
    return {
        setting.names[0]: setting.usual * 100 if setting.names[0] in _CENTIMETRES else setting.usual
        for setting in settings_for(autopilot, kind, height)
        if setting.needed or setting.check == "return"
    }
