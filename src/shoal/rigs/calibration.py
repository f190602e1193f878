"""The calibration of a bench: where a pixel of the camera lies in the grid, and how far and in which
direction a pulse of the actuator moves particles.

Pixels are (x, y) = (column, row) of the picture, as in OpenCV. Positions in the grid are float (row,
column); the cell (r, c) has its centre at (r, c). Motions are vectors (x, y) in cells with y up, and
angles are in degrees counterclockwise from the x axis, as in `shoal.rigs.physics.Plant.push`.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from math import atan2, cos, degrees, hypot, inf, radians, sin
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from shoal.core.checks import parse_json, parse_toml, read_text, validation_message
from shoal.core.errors import InvalidInputError
from shoal.core.files import atomic
from shoal.rigs.physics import ANGLES

Points = NDArray[np.float64]
AIM = 1.07
"""Length, in cells, of a pulse that must move particles by one cell: a pulse that is a little too
short turns free cells into walls, one that is a little too long is stopped by the walls.
"""
RESIDUAL = 0.1  # largest error of positions and of pulses, in cells


class _Form(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


Positive = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(ge=0)]
TieKind = Literal["marks", "map", "scale", "sensor"]
Row = tuple[float, float, float]
Vector = tuple[float, float]


class Responses(_Form):
    """How particles answer to pulses.

    A pulse between the directions of two commands moves particles by (s - dead) times a velocity,
    which has the same shares of their velocities as the direction of the pulse has of theirs. With
    commands at 0, 90, 180 and 270 degrees, it is max(cos a, 0) r + max(-cos a, 0) l + max(sin a, 0) u
    + max(-sin a, 0) d.

    Parameters
    ----------
    r, u, l, d : tuple of float
        Velocity (x, y) in cells a second, x to the right and y up, of a pulse in this direction.
    angles : dict of str to float
        Angle of the pulse of each command, in degrees.
    only : bool
        Whether the actuator knows these directions only.
    dead : float
        Part of a pulse that moves nothing, in seconds; below 0 if particles move on after it.
    residual : float
        Root mean square error of this formula for the test pulses, in cells.
    counts : dict of str to int
        Number of free motions from which each velocity was found.
    """

    r: Vector
    u: Vector
    l: Vector  # noqa: E741  # a command
    d: Vector
    angles: dict[str, float] = ANGLES
    only: bool = False
    dead: float = 0.0
    residual: Share = 0.0
    counts: dict[str, int] = {}

    def displacement(self, angle: float, seconds: float) -> Points:
        """Return the motion (x, y) in cells that a pulse causes in the open."""
        towards = unit_at(angle)
        _, shares, velocities = max(
            (self._shares(towards, pair, of="angles") for pair in PAIRS),
            key=lambda solution: solution[0],
        )
        return shares @ velocities * (seconds - self.dead)

    def pulse_for(self, motion: ArrayLike) -> tuple[float, float]:
        """Return angle (degrees, 0 to 360) and seconds of the pulse that causes a motion (x, y) in
        cells; if only the directions of the commands exist, of the one that comes nearest.

        Raises
        ------
        InvalidInputError
            Raised if no pulse causes the motion.
        """
        vector = np.asarray(motion, dtype=np.float64)
        if not vector.any():
            raise InvalidInputError("pulse: expected a motion other than 0")
        if self.only:
            lengths = {
                letter: float(vector @ getattr(self, letter)) / hypot(*getattr(self, letter))
                for letter in ANGLES
            }
            nearest = max(lengths, key=lambda letter: lengths[letter])
            seconds = lengths[nearest] / hypot(*getattr(self, nearest))
            return self.angles[nearest], seconds + self.dead
        outside, shares, directions = max(
            (self._shares(vector, pair, of="velocities") for pair in PAIRS),
            key=lambda solution: solution[0],
        )
        if outside < -1e-6 * max(1.0, float(np.abs(shares).max())):
            raise InvalidInputError("pulse: the measured directions do not reach all around")
        x, y = shares @ directions
        return degrees(atan2(y, x)) % 360, max(hypot(x, y) + self.dead, 0.0)

    def _shares(self, vector: Points, pair: str, *, of: str) -> tuple[float, Points, Points]:
        """Return the shares of two neighbouring commands that make a vector: their least (below 0
        outside the quadrant), both, and what they are shares of otherwise (shape (2, 2)).
        """
        directions = np.array([unit_at(self.angles[letter]) for letter in pair])
        velocities = np.array([getattr(self, letter) for letter in pair])
        basis, others = (directions, velocities) if of == "angles" else (velocities, directions)
        if abs(np.linalg.det(basis)) < 1e-12:
            return -inf, np.zeros(2), others
        shares = np.linalg.solve(basis.T, vector)
        return float(shares.min()), shares, others

    @classmethod
    def from_pulses(
        cls, pulses: Mapping[str, tuple[float, float]], *, only: bool = False
    ) -> Responses:
        """Return the answers of particles that each pulse (angle, seconds) of a command moves by
        exactly one cell.
        """
        sides = {
            letter: tuple((unit_at(angle) / pulses[letter][1]).tolist())
            for letter, angle in ANGLES.items()
        }
        angles = {letter: pulses[letter][0] % 360 for letter in ANGLES}
        return cls.model_validate({**sides, "angles": angles, "only": only})

    def heading(self, command: str) -> float:
        """Return the angle between a command and its motion, in degrees counterclockwise."""
        x, y = getattr(self, command)
        return (degrees(atan2(y, x)) - ANGLES[command] + 180) % 360 - 180


PAIRS = ("ru", "lu", "ld", "rd")  # neighbouring commands


def unit_at(angle: float) -> Points:
    """Return the unit vector (x, y) at an angle in degrees."""
    return np.array([cos(radians(angle)), sin(radians(angle))])


class Speed(_Form):
    """The speed of particles against the frequency of a rotating field.

    Up to the step-out frequency f0, the speed is slope · f; above it, particles lose the field in
    each turn, and the speed falls as slope · (f - sqrt(f² - f0²)).
    """

    frequencies: list[Positive]
    speeds: list[Share]
    slope: Positive
    step_out: Positive | None


class BenchCalibration(_Form):
    """What `shoal drive --calibrate` measures, and ``--calibration`` uses.

    Parameters
    ----------
    format : str
        Name and number of the file format.
    shape : tuple of int
        Rows and columns of the grid.
    tie : str
        How pixels were tied to cells: "marks", "map" (the picture of a known map), "scale" (the
        stated size of a cell, along the directions of the pulses), or "sensor" (the sensor knows).
    matrix : tuple of tuple of float, shape (3, 3)
        Maps the pixel (x, y, 1) to (row, column, 1), up to a factor.
    residual : float or None
        Root mean square error of positions in cells; each mark counts by its distance from where
        the other marks put it. None if nothing can show an error: three marks, or a scale.
    cell_size : float or None
        Side of a cell in mm.
    noise : float
        Standard deviation of an observed position along each axis, in pixels.
    latency : float
        Time from the end of a pulse until the camera shows the particles at rest, in seconds.
    own_gain : float
        Standard deviation of the speeds of the particles, as a share of the speed.
    responses : Responses
    stated : dict of str to float
        Duration of the pulse of each command before the calibration, in seconds.
    whole : bool
        Whether the actuator carries out whole commands only, which stay as they are.
    aim : float
        Length of the pulse of a command, in cells.
    speed : Speed or None
        The speed against the frequency of the field.
    notes : list of str
        What the user should know.
    """

    format: Literal["shoal-calibration 1"] = "shoal-calibration 1"
    shape: tuple[Annotated[int, Field(ge=1)], Annotated[int, Field(ge=1)]]
    tie: TieKind
    matrix: tuple[Row, Row, Row]
    residual: Share | None = None
    cell_size: Positive | None = None
    noise: Share = 0.0
    latency: Share = 0.0
    own_gain: Share = 0.0
    responses: Responses
    stated: dict[str, Positive] = {}
    whole: bool = False
    aim: Positive = AIM
    speed: Speed | None = None
    notes: list[str] = []

    def to_cells(self, points: ArrayLike) -> Points:
        """Return pixels (x, y) as float (row, column) (both of shape (n, 2))."""
        return transform_points(np.array(self.matrix), points)

    def to_pixels(self, cells: ArrayLike) -> Points:
        """Return float (row, column) as pixels (x, y) (both of shape (n, 2))."""
        return transform_points(np.linalg.inv(np.array(self.matrix)), cells)

    def pulse(self, command: str) -> tuple[float, float]:
        """Return angle and seconds of the pulse for a command (a letter of ``lurd``)."""
        if self.whole:
            return self.responses.angles[command], self.stated[command]
        return self.responses.pulse_for(self.aim * unit_at(ANGLES[command]))

    @property
    def pulses(self) -> dict[str, tuple[float, float]]:
        """Angle in degrees and time in seconds of the pulse of each command."""
        return {letter: self.pulse(letter) for letter in ANGLES}

    @property
    def pixels_per_cell(self) -> float:
        """Side of a cell in the middle of the grid, in pixels."""
        return cell_in_pixels(np.array(self.matrix), self.shape)

    def gain(self, command: str) -> float | None:
        """Return how far, in cells, the stated pulse of a command moves particles."""
        if command not in self.stated:
            return None
        motion = self.responses.displacement(self.responses.angles[command], self.stated[command])
        return float(np.linalg.norm(motion))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the calibration as a JSON file.

        Raises
        ------
        OutputError
        """
        text = json.dumps(self.model_dump(mode="json", exclude_none=True), indent=1)
        with atomic(Path(path)) as temporary:
            temporary.write_text(text + "\n", encoding="utf-8")

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> BenchCalibration:
        """Read a calibration file (JSON, or TOML with the suffix ``.toml``).

        Raises
        ------
        InvalidInputError
        """
        where = str(path)
        text = read_text(Path(path), what="calibration")
        parse = parse_toml if where.endswith(".toml") else parse_json
        data = parse(text, where=where)
        try:
            calibration = cls.model_validate(data)
        except ValidationError as error:
            raise InvalidInputError(validation_message(error, where=where)) from None
        if abs(np.linalg.det(np.array(calibration.matrix))) < 1e-12:
            raise InvalidInputError(f"{where}: matrix: expected one that can be inverted")
        return calibration


def transform_points(matrix: Points, points: ArrayLike) -> Points:
    """Return points (shape (n, 2)) under a projective map of shape (3, 3)."""
    flat = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    mapped = np.column_stack([flat, np.ones(len(flat))]) @ matrix.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:], dtype=np.float64)


def cell_in_pixels(matrix: Points, shape: tuple[int, int]) -> float:
    """Return the mean side of a cell in the middle of a grid, in pixels."""
    middle = np.array([(shape[0] - 1) / 2, (shape[1] - 1) / 2])
    around = middle + np.array([(0, 0), (0, 1), (1, 0)])
    corner, *sides = transform_points(np.asarray(np.linalg.inv(matrix)), around)
    return float(np.mean([np.linalg.norm(side - corner) for side in sides]))
