"""The kinds of mistakes that the linter can find in a mission file, and the diagnostics that report
mistakes.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import field
from pathlib import Path
from typing import Literal

import numpy as np

from shoal.core.dataclass import dataclass
from shoal.core.xml import Element, XmlError, parse_xml
from shoal.missions.fence import Fence
from shoal.search.flight.imaging import CameraItem
from shoal.search.regions.outline import Points

Severity = Literal["error", "warning"]


@dataclass(frozen=True)
class Rule:
    """A kind of mistake that the linter can find in a mission file.

    Parameters
    ----------
    severity : "error" or "warning"
    meaning : str
        Description of the mistake.
    fatal : bool
        Whether a mission with this mistake cannot be read.
    """

    severity: Severity
    meaning: str
    fatal: bool = False


RULES: dict[str, Rule] = {
    "unreadable": Rule(
        "error",
        "the file is not text in its encoding (UTF-8, except in XML), or not valid JSON, XML or a"
        " table",
        fatal=True,
    ),
    "missing-key": Rule(
        "error", "a key, column or element that the format needs is missing", fatal=True
    ),
    "wrong-value": Rule(
        "error", "a value has a wrong type, or is none of the allowed values", fatal=True
    ),
    "wrong-header": Rule("error", "the first line is not `QGC WPL 110`", fatal=True),
    "field-count": Rule("error", "a line has too many or too few fields", fatal=True),
    "params-count": Rule("error", "an item has more or fewer than seven `params`", fatal=True),
    "no-home": Rule("error", "the mission has no home position", fatal=True),
    "zero-waypoints": Rule("error", "the mission has no waypoint", fatal=True),
    "not-a-number": Rule(
        "error",
        "a coordinate, an altitude, the height of home or a speed is NaN, infinite or null, or any"
        " number in a JSON file is NaN or infinite",
        fatal=True,
    ),
    "out-of-range": Rule(
        "error", "a longitude is beyond ±180° or a latitude is beyond ±90°", fatal=True
    ),
    "axes-swapped": Rule("error", "latitude and longitude are exchanged", fatal=True),
    "antimeridian": Rule("error", "a leg crosses the 180° meridian", fatal=True),
    "sequence": Rule("error", "the items are not numbered 0, 1, 2, ..."),
    "do-jump-id": Rule("error", "the values of `doJumpId` are not 1, 2, 3, ..."),
    "frame": Rule(
        "error",
        "altitudes have different references, or an item without a position has an altitude"
        " reference",
    ),
    "take-off": Rule(
        "error",
        "a flight has no take-off before its first waypoint or takes off to no height, takes off"
        " again later, or a rover has a take-off",
    ),
    "armed-wait": Rule(
        "error",
        "a wait (93, 112, 17, 18 or 19) before the take-off; an autopilot disarms a vehicle that"
        " waits on the ground, so it never takes off",
    ),
    "no-return": Rule("error", "the last item is not a return, a landing or (for rovers) a hold"),
    "stay": Rule(
        "error",
        "the vehicle stays on its way: a holding time at a waypoint (16), or a wait (93, 112, 17, 18"
        " or 19) after the take-off; the check counts no such time",
    ),
    "ends-early": Rule(
        "error",
        "a return (20) or a landing (21) before the last waypoint; the check flies all waypoints",
    ),
    "autocontinue": Rule(
        "warning",
        "the vehicle stops and waits at an item, because the item does not continue automatically",
    ),
    "current": Rule("warning", "an item other than the first is marked as the current item"),
    "unknown-command": Rule(
        "warning",
        "a command that a search does not need and that leaves the path and the view as they are;"
        " the mission check ignores it",
    ),
    "unchecked-command": Rule(
        "error",
        "a command that may move the vehicle, turn its camera or change its mode, such as a jump"
        " (177), another kind of landing, a landing of a rover or a change of altitude; the check does"
        " not know what the vehicle does there",
    ),
    "firmware": Rule(
        "error", "a mission for PX4 where a mission for ArduPilot is expected, or the reverse"
    ),
    "vehicle": Rule(
        "error",
        "a mission of one kind of vehicle, where `--vehicle` is of another kind; a `.waypoints` file"
        " states no kind, and is a mission of the kind of `--vehicle`",
    ),
    "firmware-mixed": Rule(
        "warning", "one folder contains missions for PX4 and missions for ArduPilot"
    ),
    "cap": Rule("error", "a mission has more items than the autopilot can store"),
    "cap-ardupilot": Rule(
        "warning",
        "a mission has more items than ArduPilot can store, and the file does not name its"
        " autopilot",
    ),
    "altitude": Rule(
        "error",
        "a flight is nowhere above its home or is above 10 km, ends with a hold at another height"
        " than that of its last waypoint, or has a home that is nowhere on Earth; or a rover is not"
        " on the ground",
    ),
    "below-home": Rule(
        "warning",
        "a waypoint is below home, as over a valley; `--terrain` checks the height above ground",
    ),
    "terrain-frame": Rule(
        "warning",
        "altitudes are above the terrain (frame 10); the check of separation counts them as any"
        " height",
    ),
    "spline": Rule(
        "warning",
        "the path to a waypoint is a curve (82); the check measures the straight line instead",
    ),
    "altitude-high": Rule(
        "warning", "an altitude is above 120 m; many countries forbid flights above 120 m"
    ),
    "altitude-varies": Rule("warning", "a waypoint has an altitude that no other waypoint has"),
    "camera": Rule(
        "warning",
        "a series of images has no beginning or no end, or the check does not know the pitch or the"
        " heading of the vehicle's camera",
    ),
    "images": Rule(
        "error",
        "the images of the vehicle's camera are too far apart, or there are none, or the camera"
        " aims elsewhere",
    ),
    "gimbal": Rule(
        "error", "the pitch of a camera is beyond ±90°, or a gimbal item does not aim by angles"
    ),
    "acceptance": Rule(
        "warning",
        "an acceptance radius is as large as the distance to the next waypoint, on a mission"
        " without curves",
    ),
    "approach": Rule("error", "a fixed wing would have to dive to reach its landing point"),
    "turn-radius": Rule("error", "a turn is narrower than the turn radius of the vehicle"),
    "climb": Rule("error", "on a leg, a fixed wing would have to climb or sink faster than it can"),
    "endurance": Rule(
        "error", "a mission takes longer than the endurance of the vehicle without the reserve"
    ),
    "invalid": Rule(
        "error",
        "a value of the mission is impossible, so no duration, height or separation of it is"
        " measured",
    ),
    "airspace": Rule(
        "error", "turns of a fixed wing leave the region farther than the airspace allows"
    ),
    "speed": Rule("error", "a speed is 0 or less, or above 100 m/s"),
    "too-fast": Rule(
        "warning",
        "a speed is above the cruise speed of the vehicle, so that times and the battery are those"
        " at the cruise speed",
    ),
    "home-far": Rule("warning", "home is more than 5 km from the nearest waypoint"),
    "homes-near": Rule(
        "warning",
        "homes or landing points of different vehicles are nearer to each other than the horizontal"
        " separation",
    ),
    "few-decimals": Rule(
        "warning",
        "coordinates have fewer than 7 decimals; the sixth decimal of a degree stands for 0.11 m",
    ),
    "duplicate": Rule("warning", "a waypoint has the position of the previous waypoint"),
    "outside-region": Rule("error", "a waypoint of a multirotor or a rover is outside the region"),
    "no-go": Rule("error", "a waypoint is in a no-go zone, or a leg crosses a no-go zone"),
    "beside": Rule(
        "error", "a file of the fence or of rally points beside `.waypoints` files is unreadable"
    ),
    "manifest": Rule(
        "error",
        "`missions.json`, which has the start times, is unreadable, or contradicts a mission file",
        fatal=True,
    ),
    "no-manifest": Rule(
        "warning", "several missions have no `missions.json`, so that all start at the same time"
    ),
    "no-start": Rule(
        "warning",
        "missions of several vehicles have no start times, so that the check of separation starts"
        " them at 0 s",
    ),
    "format-missing": Rule(
        "error",
        "a mission has no file of the format that the check measures, so nothing of it is measured",
    ),
    "elevation-missing": Rule(
        "warning",
        "altitudes are above the sea, and the height of home is unknown; or some missions state the"
        " height of home above the sea and others do not, and the check of separation compares them"
        " as if all homes were equally high",
    ),
    "sorties-overlap": Rule(
        "error", "a sortie starts before the earlier sortie of the same robot has ended"
    ),
    "file-missing": Rule(
        "error",
        "`missions.json` lists a mission without a file, or a file of the fence or of rally points"
        " that is missing",
    ),
    "file-gone": Rule(
        "warning",
        "`missions.json` lists a file that is missing: the table of start times, or a file of a"
        " mission that has files of other formats",
    ),
    "unlisted": Rule("warning", "`missions.json` does not list a mission of its folder"),
    "fence-differs": Rule(
        "warning", "some missions of a folder have a fence, and others have none"
    ),
    "fence": Rule("error", "a path leaves the fence, or enters an exclusion zone of the fence"),
    "fence-open": Rule(
        "warning",
        "the fence allows a part of a no-go zone; where polygons have no room on board, `shoal search`"
        " leaves out the smallest zones, and says so",
    ),
    "fence-near": Rule(
        "error",
        "a path, or a rally point, is nearer to the fence than the required distance"
        " (`--fence-distance`)",
    ),
    "rally": Rule(
        "error",
        "a rally point is in a no-go zone, outside the fence, or in an exclusion zone of the fence, at"
        " an impossible height, below the ground of `--terrain` or far from home; or a mission with"
        " rally points ends with a return (20), on which an autopilot may take the nearest one",
    ),
    "leg-outside": Rule(
        "error",
        "a leg of a rover leaves the region, or a path of a rover from or to home leaves the"
        " region",
    ),
    "transit": Rule("warning", "a leg of a flight leaves the region"),
    "formats-differ": Rule(
        "error", "two files of one sortie in different formats have different contents"
    ),
    "same-robot": Rule(
        "error",
        "two files of one format are the same sortie of the same robot; the check compares them as"
        " two vehicles",
    ),
    "sortie-missing": Rule("warning", "the sorties of a robot are not numbered 1, 2, 3, ..."),
}


@dataclass(frozen=True)
class Diagnostic:
    """A mistake in a mission file.

    Parameters
    ----------
    file : str
        Name of the file.
    place : str
        Line or item of the mistake in the file, or an empty text if the mistake concerns the whole
        file.
    rule : str
        Kind of mistake, as a key of `RULES`.
    sentence : str
        A sentence that states the expected and the actual content of the file.
    """

    file: str
    place: str
    rule: str
    sentence: str

    @property
    def severity(self) -> Severity:
        """Whether the mistake is an error or a warning."""
        return RULES[self.rule].severity

    def __str__(self) -> str:
        place = f", {self.place}" if self.place else ""
        return f"{self.file}{place}: {self.severity}: {self.sentence} [{self.rule}]"

    def report(self) -> dict[str, str]:
        """Return the diagnostic as a mapping that can be written as JSON."""
        return {"severity": self.severity, **vars(self)}


def group_mistakes(diagnostics: tuple[Diagnostic, ...]) -> list[list[Diagnostic]]:
    """Return the diagnostics in groups, one group for each mistake in a mission.

    A mission may have several files, one for each file format. A group contains one diagnostic from
    each file that has the mistake. If a file has several diagnostics with the same rule and
    sentence, the k-th of these diagnostics from each file form one group.
    """
    groups: dict[tuple[str, str, str, int], list[Diagnostic]] = {}
    so_far: Counter[tuple[str, str, str]] = Counter()
    for diagnostic in diagnostics:
        # formats round differently
        sentence = re.sub(r"\d+\.\d+", lambda match: f"{float(match[0]):.6f}", diagnostic.sentence)
        so_far[diagnostic.file, diagnostic.rule, sentence] += 1
        number = so_far[diagnostic.file, diagnostic.rule, sentence]
        groups.setdefault(
            (Path(diagnostic.file).stem, diagnostic.rule, sentence, number), []
        ).append(diagnostic)
    return list(groups.values())


@dataclass
class Sheet:
    """The raw content of a mission file before it is checked. Readers of files fill the sheet, and
    checks add diagnostics.

    The array ``points`` holds (x, y) in metres if ``geographic`` is false, and otherwise
    (longitude, latitude) in degrees, even if the file has the opposite order. The rally points hold
    their heights above home, too. For error messages, the list ``places`` names the place of each point in the file. A field is None if the file does
    not contain it.
    """

    file: str
    points: Points = field(default_factory=lambda: np.zeros((0, 2)))
    places: list[str] = field(default_factory=list)
    altitudes: list[float] = field(default_factory=list)
    home: tuple[float, float] | None = None
    landing: tuple[float, float] | None = None
    loiter: float | None = None
    start: float | None = None
    cruise: float | None = None
    takeover: float | None = None
    take_off: float | None = None
    fence: Fence | None = None
    rally: tuple[tuple[float, ...], ...] = ()
    robot: int | None = None
    sortie: int | None = None
    kind: str | None = None
    kind_is_stated: bool = True
    autopilot: str | None = None
    altitude_frame: str | None = None
    elevation: float | None = None
    trigger_distance: float | None = None
    gimbal_pitch: float | None = None
    yaw: float | None = None
    headings: list[float | None] | None = None
    camera_items: list[CameraItem] | None = None
    acceptance_radius: float | None = None
    acceptance_radii: list[float] = field(default_factory=list)
    speed: float | None = None
    speeds: list[float] | None = None
    geographic: bool = True
    waypoints_out: int | None = None
    waypoints_home: int | None = None
    decimals: int | None = None
    n_items: int | None = None
    footprint_angle: float | str | None = None
    not_json: list[str] = field(default_factory=list)  # NaN and infinities of a JSON file
    diagnostics: list[Diagnostic] = field(default_factory=list)

    def add(self, rule: str, place: str, sentence: str) -> None:
        """Add a diagnostic to the sheet."""
        assert rule in RULES
        self.diagnostics.append(Diagnostic(self.file, place, rule, sentence))

    @property
    def readable(self) -> bool:
        """Whether the mission can be read in spite of the mistakes found so far."""
        return not any(RULES[diagnostic.rule].fatal for diagnostic in self.diagnostics)


def parse_root(text: str, root: str, sheet: Sheet) -> Element | None:
    """Return the root element of an XML text. If the text is invalid or has another root, add a
    diagnostic and return None.
    """
    try:
        return parse_xml(text, root=root)
    except XmlError as error:
        sheet.add(
            "wrong-value" if error.readable else "unreadable", f"line {error.line}", str(error)
        )
        return None


def decimals_of(text: str) -> int:
    """Return the number of decimals in a text that represents a number.

    Examples
    --------
    >>> [decimals_of(text) for text in ("8.12345678", "47", "1.5e-3", "12.")]
    [8, 0, 4, 0]
    """
    mantissa, _, exponent = text.strip().lower().partition("e")
    digits = len(mantissa.partition(".")[2])
    return max(
        0, digits - (int(exponent) if exponent.lstrip("+-").isdigit() and len(exponent) < 5 else 0)
    )
