"""MissionOptions: settings for mission files of a search, and for keeping vehicles apart."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from shoal.core.checks import check_number, check_text, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.problem import Problem, option
from shoal.search.flight.flight import ENDINGS, FRAMES, TERRAIN_ERROR
from shoal.search.flight.separation import DELAY, HORIZONTAL, VERTICAL, Separation
from shoal.search.problem import SearchProblem

CAPS: dict[str, int] = {
    "px4": 2000,
    "ardupilot": 700,
}  # maximum number of mission items that an autopilot stores, including home


def _parse_names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]


def _check_names(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list | tuple):
        raise InvalidInputError(f"format: expected names such as plan, gpx, got {shortened(value)}")
    return tuple(check_text(name, what="format") for name in value)


def parse_separation(text: str) -> tuple[float, ...]:
    """Parse a separation in metres from the command line: HORIZONTAL or HORIZONTAL,VERTICAL.

    Raises
    ------
    InvalidInputError
    """
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 2:
        raise InvalidInputError(
            f"--separation: expected HORIZONTAL or HORIZONTAL,VERTICAL in metres, got {text[:40]!r}"
        )
    return check_separation(numbers)


def check_separation(value: Any) -> tuple[float, ...]:
    """Check and return a horizontal and a vertical separation in metres, or (0,) if the horizontal
    separation is 0.

    Raises
    ------
    InvalidInputError
    """
    given = value if isinstance(value, list | tuple | np.ndarray) else (value,)
    if not 1 <= len(given) <= 2:
        raise InvalidInputError(
            "separation: expected a horizontal and a vertical distance in metres, got"
            f" {shortened(value)}"
        )
    horizontal = check_number(given[0], what="separation", least=0)
    if not horizontal:
        return (0.0,)
    return horizontal, (
        check_number(given[1], what="separation, vertically", least=0.1)
        if len(given) > 1
        else VERTICAL
    )


@dataclass(frozen=True, eq=False)
class MissionOptions(Problem):
    """Settings for mission files: the options of ``shoal search`` that have an effect only with
    ``--missions``.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> MissionOptions(separation=20).kept_apart
    Separation(horizontal=20.0, vertical=5.0, delay=10.0)
    """

    part: ClassVar[str] = "missions"
    headings: ClassVar = {"format": "Missions"}

    format: tuple[str, ...] = option(
        (),
        help=(
            "File formats of the missions: plan, wpl, geojson, kml, gpx, csv. Default: all formats"
            " that can describe the region."
        ),
        metavar="NAME,...",
        parse=_parse_names,
        check=_check_names,
    )
    autopilot: str = option("px4", help="Autopilot that flies the missions.", choices=tuple(CAPS))
    altitude_frame: str = option(
        "home", help="Reference of the vehicle's altitude in mission files.", choices=FRAMES
    )
    terrain: str | None = option(
        None, help="Terrain heights: a GeoTIFF file or an ESRI ASCII grid.", metavar="FILE"
    )
    terrain_error: float = option(
        TERRAIN_ERROR,
        help="Maximum error of the height above ground, at waypoints and between waypoints.",
        unit="m",
        least=0.01,
        metavar="METRES",
    )
    separation: tuple[float, ...] = option(
        (HORIZONTAL, VERTICAL),
        help=(
            "Horizontal and vertical separation. Vehicles in flight keep the horizontal distance or"
            " the vertical distance; 0 means no separation."
        ),
        metavar="HORIZONTAL[,VERTICAL]",
        parse=parse_separation,
        check=check_separation,
    )
    delay_tolerance: float = option(
        DELAY,
        help=(
            "Maximum unplanned delay of each vehicle, independent of other vehicles. The separation"
            " holds despite such delays."
        ),
        unit="s",
        least=0,
        metavar="SECONDS",
    )
    airspace: float | None = option(
        None,
        help=(
            "Distance by which turns of fixed wings may leave the area inside --margin. Default: as"
            " far as necessary; the report states the distance."
        ),
        unit="m",
        least=0,
        metavar="METRES",
    )
    ending: str | None = option(
        None,
        help=(
            "End of each mission: return (by the autopilot), land (fixed wings on a straight"
            " approach) or loiter (stay in the air). Default with a separation: multirotors land;"
            " fixed wings loiter, or land if --land is given."
        ),
        choices=ENDINGS,
    )
    rally: str | None = option(
        None,
        help="CSV or GeoJSON file of rally points, where vehicles may land in an emergency.",
        metavar="FILE",
    )
    cap: int | None = option(
        None, help="Maximum number of mission items that the autopilot can store.", least=1
    )

    def check_together(self) -> None:
        """Refuse options without effect."""
        if "terrain_error" in self.given and self.terrain is None:
            raise InvalidInputError(
                "terrain_error: expected a terrain file together with it, got none and"
                f" {self.terrain_error:g}"
            )
        if "delay_tolerance" in self.given and not self.separation[0]:
            raise InvalidInputError(
                "delay_tolerance: expected a separation above 0 together with it, got 0 and"
                f" {self.delay_tolerance:g}"
            )

    @property
    def kept_apart(self) -> Separation | None:
        """The separation of vehicles in flight, or None if the planner does not keep vehicles
        apart.
        """
        horizontal, vertical = (*self.separation, VERTICAL)[:2]
        return Separation(horizontal, vertical, self.delay_tolerance) if horizontal else None

    def check_for(self, problem: SearchProblem) -> None:
        """Refuse options that are impossible for the missions of a given search. The method opens
        the region of the search.

        Raises
        ------
        InvalidInputError
        """
        parts, kind = len(problem.place.parts), problem.chosen_vehicle.kind
        if kind == "rover" and parts > 1:
            raise InvalidInputError(
                f"vehicle: expected a flying vehicle for a region of {parts} parts, because a rover"
                " stays in its part, got a rover; search each part separately"
            )
        if self.altitude_frame == "ground" and self.terrain is None and kind != "rover":
            raise InvalidInputError(
                "altitude_frame: expected home or sea without a terrain file, got ground"
            )
