"""Vehicle: speeds, turns, battery, camera and wind of a searching robot, in physical units."""

from __future__ import annotations

import os
from collections.abc import Mapping
from math import atan, cos, degrees, hypot, inf, radians, sin, tan
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_choice, parse_json, parse_toml, read_text, shortened, suggestion
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.problem import Problem, option
from shoal.search.regions.coverage import Image

PRESETS: dict[str, dict[str, float]] = {
    "ideal": {"cruise_speed": 1.0, "altitude": 30.0},
    "multirotor": {
        "cruise_speed": 5.0,
        "climb_speed": 2.5,
        "sink_speed": 1.5,
        "acceleration": 2.5,
        "altitude": 30.0,
        "endurance": 25.0,
        "reserve": 0.2,
        "acceptance_radius": 1.0,
        "position_error": 2.0,
    },
    "fixed-wing": {
        "cruise_speed": 16.0,
        "climb_speed": 3.0,
        "sink_speed": 2.0,
        "turn_radius": 40.0,
        "altitude": 80.0,
        "endurance": 60.0,
        "reserve": 0.2,
        "acceptance_radius": 5.0,
        "position_error": 3.0,
    },
    "rover": {
        "cruise_speed": 1.0,
        "acceleration": 0.5,
        "altitude": 0.0,
        "endurance": 120.0,
        "reserve": 0.2,
        "acceptance_radius": 0.5,
        "position_error": 1.0,
    },
}
"""Values that each preset of a vehicle sets. Fields that a preset does not set are 0 or
unlimited.
"""

GRAVITY = 9.80665
STEEPEST_BANK = 60.0  # degrees: maximum bank angle of fixed wings in a turn
LARGEST_VEHICLE = 100_000  # bytes of a vehicle file
_LENS = ("sensor_width", "sensor_height", "focal_length")


@dataclass(frozen=True, eq=False)
class Vehicle(Problem):
    """A vehicle. A field without a given value has the value of the preset, or no effect if the
    preset has no value.

    Raises
    ------
    InvalidInputError
        If a value is out of range, or if two fields contradict each other.

    Notes
    -----
    The page docs/concepts/vehicles.md explains the fields.

    Examples
    --------
    >>> Vehicle(cruise_speed=8.0).turn_seconds
    3.2
    >>> vehicle_of("fixed-wing,wind_speed=6,wind_from=270").ground_speed([(1.0, 0.0), (-1.0, 0.0)])
    array([22., 10.])
    """

    part: ClassVar[str] = "vehicle"

    preset: str = option(
        "multirotor",
        help="Kind of vehicle, which sets the default of every other field.",
        choices=tuple(PRESETS),
    )
    cruise_speed: float | None = option(
        None,
        help="Airspeed of the vehicle; for a rover, speed over ground.",
        unit="m/s",
        above=0,
        most=100,
    )
    climb_speed: float | None = option(
        None, help="Vertical speed of a climb.", unit="m/s", above=0, most=50
    )
    sink_speed: float | None = option(
        None, help="Vertical speed of a descent.", unit="m/s", above=0, most=50
    )
    acceleration: float | None = option(
        None, help="Acceleration before and after a turn.", unit="m/s2", above=0
    )
    turn_time: float | None = option(
        None,
        help="Duration of a turn; by default cruise_speed / acceleration.",
        unit="s",
        least=0,
        most=600,
    )
    turn_radius: float | None = option(
        None,
        help="Smallest turn radius of a fixed wing in still air; 0 for other vehicles.",
        unit="m",
        least=0,
        most=10_000,
    )
    altitude: float | None = option(
        None, help="Altitude of the search flight; 0 for a rover.", unit="m", least=0, most=10_000
    )
    endurance: float | None = option(
        None,
        help="Time from take-off until the battery is empty.",
        unit="min",
        above=0,
        most=100_000,
    )
    reserve: float | None = option(
        None, help="Share of the endurance that no mission may use.", least=0, below=1
    )
    recharge: float | None = option(
        None, help="Time on the ground between two sorties.", unit="min", least=0, most=100_000
    )
    wind_speed: float | None = option(
        None, help="Wind speed, which must be below cruise_speed.", unit="m/s", least=0, most=100
    )
    wind_from: float | None = option(
        None,
        help="Direction from which the wind blows, clockwise from north.",
        unit="degrees",
        least=-360,
        most=360,
    )
    detector_width: float | None = option(
        None,
        help="Width of the strip that a sonar or another detector sees (the row distance).",
        unit="m",
        above=0,
        most=100_000,
    )
    sensor_width: float | None = option(
        None, help="Width of the camera's sensor, across the path.", unit="mm", above=0, most=1000
    )
    sensor_height: float | None = option(
        None, help="Height of the camera's sensor, along the path.", unit="mm", above=0, most=1000
    )
    focal_length: float | None = option(
        None, help="Focal length of the camera.", unit="mm", above=0, most=10_000
    )
    image_width: float | None = option(
        None, help="Width of an image, across the path.", unit="pixels", least=1, most=1_000_000
    )
    image_height: float | None = option(
        None, help="Height of an image, along the path.", unit="pixels", least=1, most=1_000_000
    )
    side_overlap: float | None = option(
        None, help="Overlap of images in neighbouring rows, as a fraction.", least=0, most=0.95
    )
    front_overlap: float | None = option(
        None, help="Overlap of consecutive images in a row, as a fraction.", least=0, most=0.95
    )
    gimbal_pitch: float | None = option(
        None, help="Camera pitch; -90 means straight down.", unit="degrees", least=-90, most=90
    )
    yaw: float | None = option(
        None,
        help=(
            "Heading that a multirotor keeps, clockwise from north. By default, a multirotor faces"
            " its direction of flight."
        ),
        unit="degrees",
        least=-360,
        most=360,
    )
    acceptance_radius: float | None = option(
        None,
        help="Distance at which a waypoint is reached; by default the autopilot's value.",
        unit="m",
        above=0,
        most=1000,
    )

    position_error: float | None = option(
        None,
        help="Largest usual error of the vehicle's own position.",
        unit="m",
        least=0,
        most=1000,
    )

    def __post_init__(self) -> None:
        preset = PRESETS[check_choice(self.preset, what="preset", choices=PRESETS)]
        for name, value in preset.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, value)
        super().__post_init__()

    def check_together(self) -> None:
        """Refuse fields that contradict each other."""
        lens = [name for name in _LENS if getattr(self, name) is not None]
        if lens and len(lens) < len(_LENS):
            missing = next(name for name in _LENS if name not in lens)
            raise InvalidInputError(
                f"{missing}: expected a value together with {lens[0]}, got none"
            )
        if lens and self.detector_width is not None:
            raise InvalidInputError("detector_width: expected a detector or a camera, got both")
        if self.kind == "rover":
            for name in ("altitude", "wind_speed", "turn_radius", "climb_speed", "sink_speed"):
                if getattr(self, name):
                    raise InvalidInputError(
                        f"{name}: expected no value for a rover, got {getattr(self, name):g}"
                    )
        elif not self.altitude:
            raise InvalidInputError(
                "altitude: expected a number of metres above 0 for a vehicle that flies, got"
                f" {self.altitude!r}"
            )
        if lens and not self.altitude:
            raise InvalidInputError(
                "sensor_width: expected no camera for a rover, whose altitude is 0; give"
                " detector_width"
            )
        if self.wind >= self.cruise:
            raise InvalidInputError(
                f"wind_speed: expected less than the cruise_speed of {self.cruise:g} m/s, so that"
                f" the vehicle can return against the wind, got {self.wind:g}"
            )
        if (self.kind == "fixed-wing") != (self.radius > 0):
            raise InvalidInputError(
                "turn_radius: expected a radius above 0 for a fixed-wing, and 0 for a vehicle that"
                f" turns on the spot, got {self.radius:g} for a {self.kind}"
            )
        if (
            needed := float(self.vertical_seconds([self.height, -self.height]).sum())
        ) >= self.usable_seconds:
            raise InvalidInputError(
                f"endurance: expected more than the {needed / 60:.3g} min of climbing and sinking,"
                f" without the reserve, got {self.endurance:g} min with the reserve"
            )
        if self.radius and self.bank > STEEPEST_BANK:
            least = self.cruise**2 / (GRAVITY * tan(radians(STEEPEST_BANK)))
            raise InvalidInputError(
                f"turn_radius: expected at least {least:.3g} m at {self.cruise:g} m/s, where a"
                f" vehicle banks by {STEEPEST_BANK:g} degrees, got {self.radius:g}"
            )

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], *, where: str = "vehicle") -> Self:
        """Return the vehicle that a mapping of fields describes.

        Raises
        ------
        InvalidInputError
            If a field is unknown or invalid. The error message names the field.
        """
        if "kind" in data:
            raise InvalidInputError(
                f"{where}: kind: expected no such field, got {shortened(data['kind'])} (did you"
                " mean 'preset'?)"
            )
        return super().from_dict(data, where=where)

    def to_dict(self, *, defaults: bool = False) -> dict[str, Any]:
        """Return the preset and the fields that differ from the preset, or all fields if
        ``defaults`` is true.
        """
        values = {name: getattr(self, name) for name in self.declarations()}
        return {
            name: value
            for name, value in values.items()
            if defaults or value != PRESETS[self.preset].get(name)
        }

    @property
    def kind(self) -> str:
        """Kind of vehicle: multirotor, fixed-wing or rover. The ideal vehicle counts as a
        multirotor.
        """
        return "multirotor" if self.preset == "ideal" else self.preset

    @property
    def cruise(self) -> float:
        """Cruise speed of the vehicle in m/s."""
        return float(self.cruise_speed or 0.0)

    @property
    def clearance(self) -> float:
        """Distance in metres by which the vehicle may be off its path: its position error and its
        acceptance radius together.
        """
        return float(self.position_error or 0.0) + float(self.acceptance_radius or 0.0)

    @property
    def cross_track(self) -> float:
        """Distance in metres from its path at which the vehicle usually stays: the root of the sum of
        the squares of its position error and its acceptance radius, at which it cuts corners.
        """
        return hypot(self.position_error or 0.0, self.acceptance_radius or 0.0)

    @property
    def height(self) -> float:
        """Altitude of the vehicle in metres."""
        return float(self.altitude or 0.0)

    @property
    def radius(self) -> float:
        """Minimum turning radius without wind in metres, or 0 if the vehicle turns on the spot."""
        return float(self.turn_radius or 0.0)

    @property
    def ground_radius(self) -> float:
        """Smallest turning radius over ground, in metres, that the vehicle can fly in wind from any
        direction.
        """
        return self.radius * (1.0 + self.wind / self.cruise) ** 2

    @property
    def bank(self) -> float:
        """Bank angle of the vehicle in its narrowest turn, in degrees."""
        return degrees(atan(self.cruise**2 / (GRAVITY * self.radius))) if self.radius else 0.0

    @property
    def turn_seconds(self) -> float:
        """Extra time of a turn in seconds; by default 0 for a fixed wing, because its turns are
        part of the path.
        """
        if self.turn_time is not None:
            return float(self.turn_time)
        return self.cruise / self.acceleration if self.acceleration and not self.radius else 0.0

    @property
    def wind(self) -> float:
        """Wind speed in m/s."""
        return float(self.wind_speed or 0.0)

    @property
    def wind_vector(self) -> NDArray[np.float64]:
        """Velocity of the wind to the east and to the north, in m/s; float64, shape (2,)."""
        heading = radians(float(self.wind_from or 0.0))
        return -self.wind * np.array([sin(heading), cos(heading)])

    @property
    def usable_seconds(self) -> float:
        """Endurance minus the reserve in seconds, or infinity if the endurance has no limit."""
        return (
            inf
            if self.endurance is None
            else float(self.endurance) * 60.0 * (1.0 - float(self.reserve or 0.0))
        )

    @property
    def recharge_seconds(self) -> float:
        """Time in seconds that the vehicle spends on the ground between two sorties."""
        return float(self.recharge or 0.0) * 60.0

    def vertical_seconds(self, change: ArrayLike) -> NDArray[np.float64]:
        """Return the time in seconds for a climb by ``change`` metres, or for a descent if
        ``change`` is negative.
        """
        up = np.asarray(change, dtype=np.float64)
        return np.maximum(up, 0.0) / (self.climb_speed or inf) + np.maximum(-up, 0.0) / (
            self.sink_speed or inf
        )

    def ground_speed(self, directions: ArrayLike) -> NDArray[np.float64]:
        """Return the ground speed in m/s along given directions, for a vehicle at cruise speed that
        compensates crosswind.

        The array ``directions`` of shape (k, 2) holds direction vectors (east, north) of any positive
        length.
        """
        along = np.asarray(directions, dtype=np.float64)
        along = along / np.linalg.norm(along, axis=-1, keepdims=True)
        wind = self.wind_vector
        helped, across = along @ wind, along[..., 0] * wind[1] - along[..., 1] * wind[0]
        return np.asarray(np.sqrt(self.cruise**2 - across**2) + helped)

    def mean_speed(self, angle: float) -> float:
        """Return the mean ground speed in m/s on a flight back and forth along rows. The angle is
        in degrees, and 0 means east.
        """
        east, north = cos(radians(angle)), sin(radians(angle))
        return float(2.0 / (1.0 / self.ground_speed([(east, north), (-east, -north)])).sum())

    @property
    def image_size(self) -> tuple[float, float] | None:
        """Width across the path and length along the path of an image on the ground, in metres, or
        None without a camera.
        """
        if not (self.sensor_width and self.sensor_height and self.focal_length):
            return None
        return (
            self.height * self.sensor_width / self.focal_length,
            self.height * self.sensor_height / self.focal_length,
        )

    @property
    def row_spacing(self) -> float | None:
        """Distance between neighbouring rows of cells in metres, or None without a camera or a
        detector.

        For a camera, the row spacing is the width of an image minus the overlap, but at most the
        length of an image. With a row spacing above the length of an image, the camera would miss
        parts of the region at the ends of rows.
        """
        if self.image_size is None:
            return self.detector_width
        across, along = self.image_size
        return min(across * (1.0 - (self.side_overlap or 0.0)), along)

    @property
    def trigger_distance(self) -> float | None:
        """Distance between two images in metres, rounded to a millimetre, or None
        without a camera.

        After a turn, the images before and behind it must meet, so that the distance is at most
        half the sum of the sides of an image.
        """
        if self.image_size is None:
            return None
        across, along = self.image_size
        return round(min(along * (1.0 - (self.front_overlap or 0.0)), (across + along) / 2), 3)

    @property
    def ground_sample(self) -> float | None:
        """Ground sample distance: longer side in metres of the area that a pixel shows, or None if
        camera data are missing.
        """
        sides = [
            side / count
            for side, count in zip(
                self.image_size or (), (self.image_width, self.image_height), strict=False
            )
            if count
        ]
        return max(sides, default=None)


def image_of(vehicle: Vehicle) -> Image | None:
    """Return the image of a vehicle's camera, relative to the vehicle's row spacing, or None
    without a camera.
    """
    if vehicle.image_size is None or vehicle.row_spacing is None:
        return None
    lengths = *vehicle.image_size, vehicle.trigger_distance or 0.0
    across, along, spacing = (length / vehicle.row_spacing for length in lengths)
    yaw = vehicle.yaw if vehicle.kind == "multirotor" else None
    return Image(across, along, yaw, spacing)


def vehicle_of(value: Any) -> Vehicle:
    """Return the vehicle that a text, a mapping of fields or a `Vehicle` describes.

    Parameters
    ----------
    value : str, path, mapping or Vehicle
        A preset, or a TOML or JSON file. Changes of fields may follow the preset or the file, for
        example ``"rover"``, ``"drone.toml"`` or ``"multirotor,cruise_speed=8,wind_speed=4"``.

    Raises
    ------
    InvalidInputError
        If the description of the vehicle is invalid. The error message names the file and the
        field.

    Examples
    --------
    >>> vehicle_of("rover").kind, vehicle_of("multirotor,altitude=40").height
    ('rover', 40.0)
    >>> vehicle_of("multirotor,speed=4")
    Traceback (most recent call last):
    ...
    shoal.core.errors.InvalidInputError: vehicle: speed: expected no such field, got 4.0 (did you mean 'wind_speed'?)
    """
    if isinstance(value, Vehicle):
        return value
    if isinstance(value, Mapping):
        return Vehicle.from_dict(value)
    if not isinstance(value, str | os.PathLike) or not os.fspath(value):
        raise InvalidInputError(
            f"vehicle: expected a preset, a file or fields, got {shortened(value)}"
        )
    name, *changes = str(os.fspath(value)).split(",")
    fields = dict(_change(text) for text in changes)
    if name in PRESETS:
        return Vehicle.from_dict({"preset": name} | fields)
    path = Path(name)
    if path.suffix.lower() not in (".toml", ".json"):
        near = suggestion(name, PRESETS)
        raise InvalidInputError(
            f"vehicle: expected one of {', '.join(PRESETS)}, or a file .toml or .json, got"
            f" {shortened(name)}{near}"
        )
    return Vehicle.from_dict(_fields_of(path) | fields, where=name)


def _fields_of(path: Path) -> dict[str, Any]:
    """Return the fields in a vehicle file as a mapping from names to values."""
    text = read_text(path, what="vehicle file", most=LARGEST_VEHICLE)
    data = (parse_json if path.suffix.lower() == ".json" else parse_toml)(text, where=str(path))
    if not isinstance(data, dict):
        raise InvalidInputError(f"{path}: expected fields with values, got {shortened(data)}")
    return data


def _change(text: str) -> tuple[str, Any]:
    """Return the field and the value in a text of the form "field=value". A value that is a number
    becomes a float.
    """
    name, equals, value = text.partition("=")
    if not equals:
        raise InvalidInputError(
            f"vehicle: expected field=value after the preset or file, got {shortened(text)}"
        )
    try:
        return name.strip(), float(value)
    except ValueError:
        return name.strip(), value
