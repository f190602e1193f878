"""Calibration of a bench: where a pixel of the camera lies in the grid, and how far and in which
direction a pulse of the actuator moves particles.

Pixels are (x, y) = (column, row) of the picture, as in OpenCV. Positions in the grid are float (row,
column); the cell (r, c) has its centre at (r, c). Motions are vectors (x, y) in cells with y up, and
angles are in degrees counterclockwise from the x axis, as in `shoal.rigs.physics.Plant.push`.

Test pulses go back and forth. What a wall holds or deflects at the first pulse of a pair it lets go
at the second, so that after one pair nearly all particles move freely in both directions. Motions of
the others differ from the most frequent motion and are left out.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import atan2, cos, degrees, hypot, inf, radians, sin
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from shoal.core.checks import parse_json, parse_toml, read_text, validation_message
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, RigError
from shoal.rigs.physics import ANGLES

Points = NDArray[np.float64]
AIM = 1.07
"""Length, in cells, of a pulse that must move particles by one cell: a pulse that is a little too
short turns free cells into walls, one that is a little too long is stopped by the walls.
"""
RESIDUAL = 0.1  # largest error of positions and of pulses, in cells
TURNED = 45.0  # angle, in degrees, between command and motion, from which on an axis is another one
OUTLIER = 0.5  # distance, in cells, from which on a mark contradicts the others
FLAT = 0.05  # width over length of a set of marks, below which the marks lie on one line
BAND = 0.2  # half width of the most frequent motion, as a share of its length
FEWEST = 3  # free motions that measure a direction


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
        towards = _unit_at(angle)
        _, shares, velocities = max(
            (self._shares(towards, pair, of="angles") for pair in PAIRS), key=lambda one: one[0]
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
        wanted = np.asarray(motion, dtype=np.float64)
        if not wanted.any():
            raise InvalidInputError("pulse: expected a motion other than 0")
        if self.only:
            lengths = {
                letter: float(wanted @ getattr(self, letter)) / hypot(*getattr(self, letter))
                for letter in ANGLES
            }
            nearest = max(lengths, key=lambda letter: lengths[letter])
            seconds = lengths[nearest] / hypot(*getattr(self, nearest))
            return self.angles[nearest], seconds + self.dead
        outside, shares, directions = max(
            (self._shares(wanted, pair, of="velocities") for pair in PAIRS), key=lambda one: one[0]
        )
        if outside < -1e-6 * max(1.0, float(np.abs(shares).max())):
            raise InvalidInputError("pulse: the measured directions do not reach all around")
        x, y = shares @ directions
        return degrees(atan2(y, x)) % 360, max(hypot(x, y) + self.dead, 0.0)

    def _shares(self, wanted: Points, pair: str, *, of: str) -> tuple[float, Points, Points]:
        """Return the shares of two neighbouring commands that make a vector: their least (below 0
        outside the quadrant), both, and what they are shares of otherwise (shape (2, 2)).
        """
        directions = np.array([_unit_at(self.angles[letter]) for letter in pair])
        velocities = np.array([getattr(self, letter) for letter in pair])
        basis, others = (directions, velocities) if of == "angles" else (velocities, directions)
        if abs(np.linalg.det(basis)) < 1e-12:
            return -inf, np.zeros(2), others
        shares = np.linalg.solve(basis.T, wanted)
        return float(shares.min()), shares, others

    @classmethod
    def stated(cls, pulses: Mapping[str, tuple[float, float]], *, only: bool = False) -> Responses:
        """Return the answers of particles that each pulse (angle, seconds) of a command moves by
        exactly one cell.
        """
        sides = {
            letter: tuple((_unit_at(angle) / pulses[letter][1]).tolist())
            for letter, angle in ANGLES.items()
        }
        angles = {letter: pulses[letter][0] % 360 for letter in ANGLES}
        return cls(**sides, angles=angles, only=only)

    def heading(self, command: str) -> float:
        """Return the angle between a command and its motion, in degrees counterclockwise."""
        x, y = getattr(self, command)
        return (degrees(atan2(y, x)) - ANGLES[command] + 180) % 360 - 180


PAIRS = ("ru", "lu", "ld", "rd")  # neighbouring commands


def _unit_at(angle: float) -> Points:
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
        return transformed(np.array(self.matrix), points)

    def to_pixels(self, cells: ArrayLike) -> Points:
        """Return float (row, column) as pixels (x, y) (both of shape (n, 2))."""
        return transformed(np.linalg.inv(np.array(self.matrix)), cells)

    def pulse(self, command: str) -> tuple[float, float]:
        """Return angle and seconds of the pulse for a command (a letter of ``lurd``)."""
        if self.whole:
            return self.responses.angles[command], self.stated[command]
        return self.responses.pulse_for(self.aim * _unit_at(ANGLES[command]))

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
        """Write the calibration as a JSON file."""
        text = json.dumps(self.model_dump(mode="json", exclude_none=True), indent=1)
        Path(path).write_text(text + "\n", encoding="utf-8")

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
            found = cls.model_validate(data)
        except ValidationError as error:
            raise InvalidInputError(validation_message(error, where=where)) from None
        if abs(np.linalg.det(np.array(found.matrix))) < 1e-12:
            raise InvalidInputError(f"{where}: matrix: expected one that can be inverted")
        return found


def transformed(matrix: Points, points: ArrayLike) -> Points:
    """Return points (shape (n, 2)) under a projective map of shape (3, 3)."""
    flat = np.asarray(points, dtype=np.float64).reshape(-1, 2)
    mapped = np.column_stack([flat, np.ones(len(flat))]) @ matrix.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:], dtype=np.float64)


# ------------------------------------------------------------------ pixels to cells


@dataclass(frozen=True, eq=False)
class Tie:
    """How pixels lie in the grid: a matrix as in `BenchCalibration`, with its error in cells."""

    kind: TieKind
    matrix: Points
    residual: float | None
    notes: tuple[str, ...] = ()


def tie_by_marks(marks: ArrayLike, *, limit: float = RESIDUAL) -> Tie:
    """Return the map from pixels to cells that fits marked points: affine, or a homography if the
    marks show that the camera looks askew. A mark that contradicts the others is left out.

    Parameters
    ----------
    marks : array_like of float, shape (n, 4)
        Pixel x, y and the row and column there, of at least three points that are not on a line.
    limit : float
        Largest residual in cells.

    Raises
    ------
    InvalidInputError
        Raised if there are too few marks, if they lie on a line, or if the residual is too large.

    Examples
    --------
    >>> marks = [(0, 0, 0, 0), (100, 0, 0, 5), (0, 100, 5, 0), (100, 100, 5, 5)]
    >>> tie = tie_by_marks(marks)
    >>> transformed(tie.matrix, [(40, 20)]).round(3).tolist(), round(tie.residual, 6)
    ([[1.0, 2.0]], 0.0)
    """
    table = np.asarray(marks, dtype=np.float64)
    if table.ndim != 2 or table.shape[1] != 4 or not np.isfinite(table).all():
        raise InvalidInputError("mark: expected numbers x, y, row, column for each mark")
    if len(table) < 3:
        raise InvalidInputError(f"mark: expected at least 3 marks, got {len(table)}")
    notes = []
    for name, points in (("pixels", table[:, :2]), ("cells", table[:, 2:])):
        _check_spread(points, f"mark: expected {name} that are not on one line")
    kept = _agreeing(table) if len(table) >= 6 else np.ones(len(table), dtype=bool)
    for at in np.flatnonzero(~kept).tolist():
        x, y, row, col = table[at]
        notes.append(f"the mark {x:g},{y:g}={row:g},{col:g} contradicts the others: left out")
    table = table[kept]
    _check_spread(table[:, :2], "mark: expected pixels that are not on one line")
    matrix, residual = _fit(table, projective=False), _left_out(table, projective=False)
    if len(table) >= 6 and residual is not None:
        projective = _left_out(table, projective=True)
        if projective is not None and projective < residual / 2:
            matrix, residual = _fit(table, projective=True), projective
    if residual is not None and residual > limit:
        raise InvalidInputError(
            f"mark: expected marks that agree within {limit:g} cells, got a residual of"
            f" {residual:.2g}"
        )
    if residual is None:
        notes.append("three marks cannot show an error; give four or more")
    return Tie("marks", matrix, residual, tuple(notes))


def _check_spread(points: Points, expected: str) -> None:
    long, short = np.linalg.svd(points - points.mean(0), compute_uv=False)[:2]
    if not long or short / long < FLAT:
        raise InvalidInputError(
            f"{expected}, got {', '.join(f'({x:g}, {y:g})' for x, y in points[:4].tolist())}"
        )


def _fit(table: Points, *, projective: bool) -> Points:
    """Return the least-squares map from pixels to cells."""
    pixels, cells = table[:, :2], table[:, 2:]
    middle, size = pixels.mean(0), float(np.abs(pixels - pixels.mean(0)).max())
    scaled = (pixels - middle) / size
    ones = np.column_stack([scaled, np.ones(len(scaled))])
    affine = np.vstack([np.linalg.lstsq(ones, cells, rcond=None)[0].T, [0, 0, 1]])
    if projective:
        from scipy.optimize import least_squares

        def errors(entries: Points) -> Points:
            return (transformed(np.append(entries, 1.0).reshape(3, 3), scaled) - cells).ravel()

        affine = np.append(least_squares(errors, affine.ravel()[:8]).x, 1.0).reshape(3, 3)
    shrink = np.array(
        [[1 / size, 0, -middle[0] / size], [0, 1 / size, -middle[1] / size], [0, 0, 1]]
    )
    matrix = affine @ shrink
    return np.asarray(matrix / matrix[2, 2], dtype=np.float64)


def _left_out(table: Points, *, projective: bool) -> float | None:
    """Return the root mean square distance of each mark from where the others put it, in cells."""
    if len(table) < (6 if projective else 4):
        return None
    errors = []
    for at in range(len(table)):
        others = np.delete(table, at, axis=0)
        try:
            _check_spread(others[:, :2], "")
        except InvalidInputError:  # this mark alone shows one direction
            continue
        matrix = _fit(others, projective=projective)
        errors.append(float(np.sum((transformed(matrix, table[at, :2])[0] - table[at, 2:]) ** 2)))
    return float(np.sqrt(np.mean(errors))) if errors else None


def _agreeing(table: Points) -> NDArray[np.bool_]:
    """Return which marks agree with most others (least median of squares over all triples)."""
    from itertools import combinations, islice

    best, kept = inf, np.ones(len(table), dtype=bool)
    order = np.random.default_rng(0).permutation(len(table))
    for triple in islice(combinations(order.tolist(), 3), 2000):
        some = table[list(triple)]
        try:
            _check_spread(some[:, :2], "")
        except InvalidInputError:
            continue
        away = np.linalg.norm(
            transformed(_fit(some, projective=False), table[:, :2]) - table[:, 2:], axis=1
        )
        if (middle := float(np.median(away))) < best:
            # a camera that looks askew bends all marks a little; an error of reading is larger
            best, kept = middle, away <= max(OUTLIER, 5 * middle)
    return kept


def tie_by_sensor(sensor: Any) -> Tie:
    """Return the map of a sensor that knows it (its attribute ``calibration``)."""
    pixels = np.array([(0.0, 0), (100, 0), (0, 100), (100, 100)])
    table = np.hstack([pixels, sensor.calibration.to_cells(pixels)])
    return Tie("sensor", _fit(table, projective=False), None)


def cell_in_pixels(matrix: Points, shape: tuple[int, int]) -> float:
    """Return the mean side of a cell in the middle of a grid, in pixels."""
    middle = np.array([(shape[0] - 1) / 2, (shape[1] - 1) / 2])
    around = middle + np.array([(0, 0), (0, 1), (1, 0)])
    corner, *sides = transformed(np.linalg.inv(matrix), around)
    return float(np.mean([np.linalg.norm(side - corner) for side in sides]))


def tie_by_scale(
    motions: dict[str, Points], cell: float, size: tuple[int, int]
) -> tuple[Tie, tuple[int, int]]:
    """Return a grid over the whole picture, whose axes are the directions of the pulses.

    Parameters
    ----------
    motions : dict of str to ndarray of float64, shape (2,)
        Motion of each command in pixels.
    cell : float
        Side of a cell in pixels.
    size : tuple of int
        Width and height of the picture in pixels.

    Returns
    -------
    tie : Tie
    shape : tuple of int
        Rows and columns of the grid.

    Raises
    ------
    InvalidInputError
        Raised if the directions of two commands are nearly the same.
    """
    right = _unit(motions["r"]) - _unit(motions["l"])
    down = _unit(motions["d"]) - _unit(motions["u"])
    right, down = _unit(right), _unit(down)
    if abs(right[0] * down[1] - right[1] * down[0]) < sin(radians(TURNED)):
        raise InvalidInputError(
            "calibration: expected commands to the right and up to move particles in directions that"
            f" differ by {TURNED:g} to {180 - TURNED:g} degrees, got"
            f" {degrees(atan2(right[1], right[0])):.0f} and {degrees(atan2(-down[1], -down[0])):.0f}"
        )
    to_pixels = cell * np.column_stack([down, right])  # of one row, of one column
    linear = np.linalg.inv(to_pixels)
    width, height = size
    corners = np.array([(0, 0), (width - 1, 0), (0, height - 1), (width - 1, height - 1)], float)
    reached = corners @ linear.T
    least = reached.min(0)
    rows, columns = np.maximum(np.ceil(reached.max(0) - least), 1).astype(int).tolist()
    matrix = np.eye(3)
    matrix[:2, :2], matrix[:2, 2] = linear, -least - 0.5
    return Tie("scale", matrix, None), (rows, columns)


def _unit(vector: Points) -> Points:
    return np.asarray(vector / np.linalg.norm(vector), dtype=np.float64)


# ------------------------------------------------------------------ tracking


def match(before: Points, after: Points, expected: ArrayLike, reach: float) -> NDArray[np.int64]:
    """Return pairs of rows (before, after) that show the same particle (int64, shape (k, 2)).

    A particle moves by any part of the expected motion, because a wall may hold it: its distance
    from that segment counts, and a little its distance from the full motion. The assignment has the
    smallest sum of distances (Hungarian method); pairs farther away than ``reach`` are left out.
    """
    from scipy.optimize import linear_sum_assignment

    if not len(before) or not len(after):
        return np.empty((0, 2), dtype=np.int64)
    step = np.asarray(expected, dtype=np.float64)
    length = float(step @ step)
    moved = after[None, :, :] - before[:, None, :]
    share = np.clip(moved @ step / length, 0, 1) if length else np.zeros(moved.shape[:2])
    aside = np.linalg.norm(moved - share[..., None] * step, axis=2)
    short = np.linalg.norm(moved - step, axis=2)
    # what is out of reach costs the same everywhere, so that it cannot bend the other pairs
    cost = np.where(aside > reach, 10 * reach, aside + 0.1 * np.minimum(short, 2 * reach))
    first, second = linear_sum_assignment(cost)
    near = aside[first, second] <= reach
    return np.column_stack([first[near], second[near]]).astype(np.int64)


def free_motion(motions: Points, noise: float) -> tuple[Points, NDArray[np.bool_]]:
    """Return the motion of the particles that no wall held, and which ones these are.

    Particles that hardly moved are left out. Of the others, the most frequent motion counts: the
    one with most motions within `BAND` of its length (or three times the noise), and the median of
    these.

    Parameters
    ----------
    motions : ndarray of float64, shape (n, 2)
    noise : float
        Standard deviation of a motion along each axis.

    Returns
    -------
    motion : ndarray of float64, shape (2,)
        NaN if nothing moved.
    free : ndarray of bool, shape (n,)
    """
    lengths = np.linalg.norm(motions, axis=1)
    most = float(np.quantile(lengths, 0.95)) if len(lengths) else 0.0
    moving = np.flatnonzero(lengths > max(most / 2, 2 * noise))
    free = np.zeros(len(motions), dtype=bool)
    if not len(moving):
        return np.full(2, np.nan), free
    some = motions[moving]
    band = max(BAND * most, 3 * noise)
    near = np.linalg.norm(some[:, None] - some[None], axis=2) <= band
    middle = np.median(some[near[near.sum(1).argmax()]], axis=0)
    inside = np.linalg.norm(some - middle, axis=1) <= band
    free[moving[inside]] = True
    return np.median(some[inside], axis=0), free


# ------------------------------------------------------------------ test pulses


class _Actuator(Protocol):
    def push(self, angle: float, seconds: float) -> object: ...


class _Frame(Protocol):
    @property
    def points(self) -> Points: ...
    @property
    def time(self) -> float: ...
    @property
    def number(self) -> int: ...


class _Sensor(Protocol):
    def observe(self) -> Any: ...


@dataclass(frozen=True, eq=False)
class TestPulse:
    """One test pulse, with the positions of the particles that were followed, in pixels.

    Parameters
    ----------
    command : str
    angle, seconds : float
    before, after : ndarray of float64, shape (n, 2)
    ids : ndarray of int64, shape (n,)
        Numbers of the particles, the same from pulse to pulse.
    """

    command: str
    angle: float
    seconds: float
    before: Points
    after: Points
    ids: NDArray[np.int64]


DRIFT = 0.05  # cells a second, from which on a drift is told
LONGEST = 1.15  # cells that a command may move particles without a note
ASKEW = 5.0  # degrees that it may lead aside without a note
PATIENCE = 10.0  # seconds without a new picture
CYCLES = 3  # pairs of pulses that are measured, after one that frees the particles
LONGER = 6  # times that a first pulse is doubled until particles move


class TestRun:
    """Carries out test pulses, and follows the particles in the pictures.

    Parameters
    ----------
    actuator : Actuator
    sensor : Sensor
    cell : float
        Side of a cell in pixels.
    wait : float
        Time after a pulse in which particles come to rest and the camera shows it, in seconds.

    Attributes
    ----------
    noise : float
        Standard deviation of an observed position along each axis, in pixels.
    drift : ndarray of float64, shape (2,)
        Velocity without a pulse, in pixels a second; 0 if chance explains it.
    latencies : list of float
        For each pulse, the time until the camera showed the particles at rest.
    """

    __test__ = False  # no test of pytest

    def __init__(self, actuator: _Actuator, sensor: _Sensor, cell: float, wait: float) -> None:
        self.actuator, self.sensor, self.cell, self.wait = actuator, sensor, cell, wait
        self.latencies: list[float] = []
        # a simulated camera has a clock of its own, which its pictures count
        rate: float | None = getattr(sensor, "frame_rate", None)
        self._clock = (lambda f: f.number / rate) if rate else (lambda f: f.time)
        frames = self._frames(max(wait, 0.3))
        while len(frames) < 6:
            frames.append(self._fresh(frames[-1].number))
        self._last = frames[-1]
        if not len(self._last.points):
            raise RigError("calibration: expected particles in the picture, got none")
        self.noise, self.drift = self._at_rest(frames)
        self._ids = np.arange(len(self._last.points))
        self._next_id = len(self._ids)

    def _fresh(self, number: int | None) -> Any:
        """Return a picture that is not the one with the number given."""
        import time

        until = time.monotonic() + PATIENCE
        while True:
            frame = self.sensor.observe()
            if frame.number != number:
                return frame
            if time.monotonic() > until:
                raise RigError(
                    f"calibration: expected a new picture within {PATIENCE:g} s, got the same one"
                    " again and again"
                )
            time.sleep(0.001)

    def _frames(self, wait: float) -> list[Any]:
        """Return the pictures of the next seconds."""
        last = getattr(self, "_last", None)
        frames = [self._fresh(None if last is None else last.number)]
        while self._clock(frames[-1]) - self._clock(frames[0]) < wait:
            frames.append(self._fresh(frames[-1].number))
        return frames

    def _at_rest(self, frames: list[Any]) -> tuple[float, Points]:
        steps = []
        for before, after in pairwise(frames):
            pairs = match(before.points, after.points, (0, 0), self.cell / 3)
            steps.append(after.points[pairs[:, 1]] - before.points[pairs[:, 0]])
        first, last = frames[0], frames[-1]
        pairs = match(first.points, last.points, (0, 0), self.cell / 3)
        moved = last.points[pairs[:, 1]] - first.points[pairs[:, 0]]
        every = np.vstack(steps)
        if not len(every) or not len(moved):
            raise RigError(
                "calibration: expected particles that are seen again in the next picture"
            )
        # 1.4826 times the median of the magnitudes is the standard deviation of a normal variable
        noise = 1.4826 * float(np.median(np.abs(every))) / 2**0.5
        drift = np.median(moved, axis=0)
        chance = 6 * noise / len(moved) ** 0.5  # four standard errors of a median of differences
        if float(np.linalg.norm(drift)) < chance:
            drift = np.zeros(2)
        return noise, drift / max(self._clock(last) - self._clock(first), 1e-9)

    def push(self, command: str, angle: float, seconds: float, expected: ArrayLike) -> TestPulse:
        """Carry out a pulse that moves particles by about the expected motion in pixels."""
        before, ids = self._last, self._ids
        self.actuator.push(angle, seconds)
        frames = self._frames(self.wait)
        after = self._last = frames[-1]
        pairs = match(before.points, after.points, expected, self.cell / 2)
        self._ids = np.full(len(after.points), -1)
        self._ids[pairs[:, 1]] = ids[pairs[:, 0]]
        new = np.flatnonzero(self._ids < 0)
        self._ids[new] = self._next_id + np.arange(len(new))
        self._next_id += len(new)
        self._add_latency(frames)
        return TestPulse(
            command,
            angle,
            seconds,
            before.points[pairs[:, 0]],
            after.points[pairs[:, 1]],
            ids[pairs[:, 0]],
        )

    def _add_latency(self, frames: list[Any]) -> None:
        """Note when the last motion was seen: from the first picture on, and one picture later,
        because the first one may have come at any time after the pulse.
        """
        last = frames[-1]
        since = first = self._clock(frames[0])
        between = (self._clock(last) - first) / max(len(frames) - 1, 1)
        for frame in reversed(frames):
            pairs = match(frame.points, last.points, (0, 0), 1.5 * self.cell)
            if not len(pairs):
                break
            away = last.points[pairs[:, 1]] - frame.points[pairs[:, 0]]
            if float(np.median(np.linalg.norm(away, axis=1))) > 4 * self.noise + 0.02 * self.cell:
                since = self._clock(frame) + between
                break
        self.latencies.append(since - first + between)

    def cycles(
        self, pulses: dict[str, tuple[float, float]], expected: dict[str, Points]
    ) -> list[TestPulse]:
        """Carry out pulses back and forth along both axes. The first pair of each axis frees the
        particles and is not returned.
        """
        done = []
        for pair in ("rl", "ud"):
            for cycle in range(1 + CYCLES):
                for letter in pair:
                    pulse = self.push(letter, *pulses[letter], expected[letter])
                    if cycle:
                        done.append(pulse)
        return done

    def speeds(
        self, stated: Mapping[str, tuple[float, float]], *, whole: bool = False
    ) -> dict[str, Points]:
        """Return the velocity in pixels a second that each command causes, from short pulses that
        are made longer until particles move by a tenth of a cell (or from whole commands).

        Parameters
        ----------
        stated : mapping of str to tuple
            Angle and about the seconds of the pulse of each command.
        whole : bool
            Whether the pulses must be those stated.
        """
        found: dict[str, Points] = {}
        for pair in ("rl", "ud"):
            for power in range(1 if whole else LONGER):
                share = 1.0 if whole else 2**power / 4
                steps: dict[str, list[Points]] = {letter: [] for letter in pair}
                for letter in pair * 2:
                    angle, seconds = stated[letter]
                    pulse = self.push(letter, angle, share * seconds, (0, 0))
                    steps[letter].append(pulse.after - pulse.before)
                moved = {
                    letter: free_motion(np.vstack(steps[letter]), self.noise * 2**0.5)
                    for letter in pair
                }
                enough = [
                    letter
                    for letter, (motion, free) in moved.items()
                    if free.sum() >= FEWEST and np.linalg.norm(motion) >= self.cell / 10
                ]
                if len(enough) == 2:
                    break
                longest = max(
                    (
                        float(np.linalg.norm(motion))
                        for motion, free in moved.values()
                        if free.any()
                    ),
                    default=0.0,
                )
                if longest > self.cell / 2:
                    break
            for letter in pair:
                if letter not in enough:
                    raise RigError(
                        f"calibration: expected particles that move freely at the command {letter},"
                        f" got none in pulses of up to {share * stated[letter][1]:.3g} s; put them"
                        " where they have room"
                    )
                found[letter] = moved[letter][0] / (share * stated[letter][1])
        return found


@dataclass(frozen=True, eq=False)
class _Group:
    """The free motions of all equal pulses, in cells."""

    command: str
    angle: float
    seconds: float
    motion: Points
    error: float  # standard error
    count: int


def _groups(pulses: Sequence[TestPulse], matrix: Points, noise: float) -> list[_Group]:
    """Return the free motions of the pulses of each angle and duration."""
    together: dict[tuple[str, float, float], list[Points]] = {}
    for pulse in pulses:
        key = pulse.command, pulse.angle, pulse.seconds
        together.setdefault(key, []).append(motions_of(pulse, matrix))
    groups = []
    for (command, angle, seconds), parts in together.items():
        motions = np.vstack(parts)
        motion, free = free_motion(motions, noise)
        count = int(free.sum())
        if count < FEWEST:
            raise RigError(
                f"calibration: expected at least {FEWEST} free motions at the command {command}, got"
                f" {count}; put the particles where they have room"
            )
        spread = float(np.std(motions[free] - motion))
        groups.append(
            _Group(command, angle, seconds, motion, max(spread, noise) / count**0.5, count)
        )
    return groups


def motions_of(pulse: TestPulse, matrix: Points) -> Points:
    """Return the motions (x, y) in cells, y up (shape (n, 2))."""
    step = transformed(matrix, pulse.after) - transformed(matrix, pulse.before)
    return np.column_stack([step[:, 1], -step[:, 0]])


def fit_responses(groups: Sequence[_Group], known: Responses) -> Responses:
    """Return the velocities and the dead time that fit the motions best (least squares), with the
    angles of the stated responses.
    """
    from scipy.optimize import least_squares

    letters = list(ANGLES)
    durations = {group.seconds for group in groups}
    several = len(durations) > len(letters)  # pulses of different lengths show the dead time

    def unpacked(values: Points) -> Responses:
        sides = dict(zip(letters, map(tuple, values[:8].reshape(4, 2).tolist()), strict=True))
        return known.model_copy(
            update={**sides, "dead": float(values[8]) * scale if several else 0.0}
        )

    scale = max(durations)
    weights = np.array([1 / max(group.error, 1e-4) for group in groups])

    def errors(values: Points) -> Points:
        found = unpacked(values)
        away = np.array([found.displacement(g.angle, g.seconds) - g.motion for g in groups])
        return np.asarray((away * weights[:, None]).ravel(), dtype=np.float64)

    first = np.zeros(9)
    for at, letter in enumerate(letters):
        same = [g for g in groups if g.command == letter]
        first[2 * at : 2 * at + 2] = np.mean([g.motion / g.seconds for g in same], axis=0)
    fitted = least_squares(errors, first[: 9 if several else 8])
    values = fitted.x
    away = errors(values) / np.repeat(weights, 2)
    counts = {
        letter: sum(group.count for group in groups if group.command == letter)
        for letter in letters
    }
    found = unpacked(values)
    return found.model_copy(
        update={"residual": float(np.sqrt(2 * np.mean(away**2))), "counts": counts}
    )


def pulses_of(actuator: Any) -> dict[str, tuple[float, float]]:
    """Return angle and seconds of the pulse of each command, as an actuator states them.

    Raises
    ------
    InvalidInputError
    """
    pulses = getattr(actuator, "pulses", None)
    if pulses is None:
        raise InvalidInputError(
            f"calibrate: expected an actuator that states its pulses, got {actuator.name}"
        )
    return dict(pulses)


def calibrate(
    actuator: _Actuator,
    sensor: _Sensor,
    *,
    pulses: Mapping[str, tuple[float, float]],
    tie: Tie | None = None,
    shape: tuple[int, int] | None = None,
    cell: float | None = None,
    size: tuple[int, int] | None = None,
    cell_size: float | None = None,
    aim: float = AIM,
    wait: float = 0.5,
    limit: float = RESIDUAL,
) -> BenchCalibration:
    """Measure with test pulses how particles move, and return the calibration of the bench.

    Parameters
    ----------
    actuator, sensor : Actuator and Sensor
        An actuator with a true attribute ``whole`` carries out whole commands only: their length and
        heading are measured, and stay. One with a true attribute ``only`` knows no other directions
        than those of the commands.
    pulses : mapping
        Angle in degrees and about the seconds of the pulse of each command. The first pulses are a
        quarter of it.
    tie : Tie, optional
        How pixels lie in the grid. Without it, the grid covers the picture, and its axes are the
        directions of the pulses.
    shape : tuple of int, optional
        Rows and columns of the grid of the tie.
    cell, size : float and tuple of int, optional
        Without a tie: side of a cell, and width and height of the picture, in pixels.
    cell_size : float, optional
        Side of a cell in mm.
    aim : float
        Length of the pulse of a command, in cells.
    wait : float
        Time after a pulse until particles are at rest and the camera shows it, in seconds.
    limit : float
        Largest root mean square error of the motions, in cells.

    Raises
    ------
    InvalidInputError
        Raised if an argument is missing.
    RigError
        Raised if particles do not move or are not seen, if an axis is turned or mirrored, or if the
        motions contradict each other.
    """
    if tie is not None:
        if shape is None:
            raise InvalidInputError("calibration: expected the shape of the grid, got none")
        cell = cell_in_pixels(tie.matrix, shape)
    elif cell is None or size is None:
        raise InvalidInputError("calibration: expected marks, a known map or the size of a cell")
    assert cell is not None
    whole = bool(getattr(actuator, "whole", False))
    known = Responses.stated(pulses, only=whole or bool(getattr(actuator, "only", False)))
    run = TestRun(actuator, sensor, cell, wait)
    speeds = run.speeds(pulses, whole=whole)
    half = {
        letter: (
            known.angles[letter],
            pulses[letter][1] if whole else cell / 2 / float(np.linalg.norm(speed)),
        )
        for letter, speed in speeds.items()
    }
    done = run.cycles(half, {letter: speeds[letter] * half[letter][1] for letter in ANGLES})
    if tie is None:
        assert size is not None
        pixels = _groups(done, _AS_PIXELS, run.noise * 2**0.5)
        motions = {group.command: group.motion * (1, -1) for group in pixels}
        tie, shape = tie_by_scale(motions, cell, size)
    assert shape is not None
    noise = run.noise * 2**0.5 / cell
    responses = fit_responses(_groups(done, tie.matrix, noise), known)
    _check_headings(responses)
    if not whole:  # once more with corrected pulses of full length
        wanted = {letter: aim * _unit_at(angle) for letter, angle in ANGLES.items()}
        full = {letter: responses.pulse_for(motion) for letter, motion in wanted.items()}
        done += run.cycles(full, _in_pixels(wanted, tie.matrix, shape))
        responses = fit_responses(_groups(done, tie.matrix, noise), known)
        _check_headings(responses)
    if responses.residual > limit:
        raise RigError(
            f"calibration: expected test pulses that agree within {limit:g} cells, got"
            f" {responses.residual:.2g}"
        )
    drift = float(np.linalg.norm(run.drift)) / cell
    notes = list(tie.notes)
    if drift > DRIFT:
        notes.append(f"without a pulse, particles drift by {drift:.2g} cells a second")
    found = BenchCalibration(
        shape=shape,
        tie=tie.kind,
        matrix=tuple(map(tuple, tie.matrix.tolist())),
        residual=tie.residual,
        cell_size=cell_size,
        noise=run.noise,
        latency=max(run.latencies),
        own_gain=_own_gain(done, tie.matrix, responses, noise),
        responses=responses,
        stated={letter: seconds for letter, (_, seconds) in pulses.items()},
        whole=whole,
        aim=aim,
        notes=notes,
    )
    if whole:
        found.notes.extend(_told_of_whole(found))
    return found


def _in_pixels(
    motions: dict[str, Points], matrix: Points, shape: tuple[int, int]
) -> dict[str, Points]:
    """Return motions (x, y) in cells as motions in pixels in the middle of the grid."""
    to_pixels = np.linalg.inv(matrix)
    centre = np.array([(shape[0] - 1) / 2, (shape[1] - 1) / 2])
    here = transformed(to_pixels, centre)[0]
    return {
        letter: transformed(to_pixels, centre + np.array([-y, x]))[0] - here
        for letter, (x, y) in motions.items()
    }


def _told_of_whole(found: BenchCalibration) -> list[str]:
    """Return what is wrong with commands that cannot be corrected."""
    notes = []
    for letter in ANGLES:
        length, heading = found.gain(letter), found.responses.heading(letter)
        if length is not None and not 1.0 <= length <= LONGEST:
            notes.append(
                f"the command {letter} moves particles by {length:.2f} cells; set the actuator to"
                f" 1.05 to 1.1"
            )
        if abs(heading) > ASKEW:
            notes.append(f"the command {letter} leads {heading:+.1f} degrees aside")
    return notes


_AS_PIXELS = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])  # (x, y) as (row, column) = (y, x)


def _check_headings(responses: Responses) -> None:
    for letter, angle in ANGLES.items():
        heading = responses.heading(letter)
        if abs(heading) > TURNED:
            raise RigError(
                f"calibration: expected the command {letter} to move particles within"
                f" {TURNED:g} degrees of {angle:g}, got {angle + heading:.0f}: the"
                " marks or the actuator are turned or mirrored"
            )


def _own_gain(
    pulses: Sequence[TestPulse], matrix: Points, responses: Responses, noise: float
) -> float:
    """Return the standard deviation of the particles' speeds, without the errors of the pictures.

    The speed of a particle is its mean over all directions, so that a field that grows towards a
    coil does not count as a property of the particle.
    """
    shares: dict[int, dict[str, list[float]]] = {}
    for pulse in pulses:
        motion = responses.displacement(pulse.angle, pulse.seconds)
        length = float(np.linalg.norm(motion))
        moved = motions_of(pulse, matrix)
        free = np.linalg.norm(moved - motion, axis=1) < 2 * BAND * length + 3 * noise
        along = moved @ motion / length**2
        for name, share in zip(pulse.ids[free].tolist(), along[free].tolist(), strict=True):
            shares.setdefault(name, {}).setdefault(pulse.command, []).append(share)
    means, errors = [], []
    for each in shares.values():
        if len(each) == len(ANGLES):
            means.append(np.mean([np.mean(values) for values in each.values()]))
            errors.append(noise**2 / sum(map(len, each.values())))
    if len(means) < FEWEST:
        return 0.0
    return float(np.sqrt(max(np.var(means, ddof=1) - np.mean(errors), 0.0)))
