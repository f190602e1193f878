"""The test pulses of a calibration.

Test pulses go back and forth. What a wall holds or deflects at the first pulse of a pair it lets go
at the second, so that after one pair nearly all particles move freely in both directions. Motions of
the others differ from the most frequent motion and are left out.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from math import ceil
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, RigError
from shoal.rigs.calibration import (
    AIM,
    RESIDUAL,
    BenchCalibration,
    Responses,
    Speed,
    cell_in_pixels,
    transform_points,
    unit_at,
)
from shoal.rigs.following import BAND, free_motion, likely_shift, match
from shoal.rigs.physics import ANGLES
from shoal.rigs.registration import TURNED, Tie, tie_by_scale

Points = NDArray[np.float64]

LEAST_FREE = 0.15  # share of the motions in a direction that must be free
UNEQUAL = 2.0  # ratio of the speeds of two commands from which on walls have held the particles
CONTRADICTION = 0.2  # share by which corrected pulses may differ from what they are made for
FEWEST = 3  # free motions that measure a direction
SHORTEST = 0.95  # cells that the pulse of a command is made for at least
LEAP = 1.3  # cells, from which on a particle may come to lie two cells ahead
DRIFT = 0.05  # cells a second, from which on a drift is told
LONGEST = 1.15  # cells that a command may move particles without a note
ASKEW = 5.0  # degrees that it may lead aside without a note
ROUNDS = 3  # of corrected pulses, until they move particles as foreseen
PATIENCE = 10.0  # seconds without a new picture
CYCLES = 3, 8  # least and most pairs of pulses that are measured
FEW = 7  # particles, below which pulses back and forth begin at both sides
ENOUGH = 20  # motions in each direction for which few particles need more pairs
LONGER = 6  # times that a first pulse is doubled until particles move
_AS_PIXELS = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, 1]])  # (x, y) as (row, column) = (y, x)


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
class MeasuredPulse:
    """One test pulse, with the positions of the particles that were followed, in pixels.

    Parameters
    ----------
    command : str
    angle, seconds : float
    before, after : ndarray of float64, shape (n, 2)
    ids : ndarray of int64, shape (n,)
        Numbers of the particles, the same from pulse to pulse.
    preparation : str
        Command that was sent before the pulses back and forth, if any.
    """

    command: str
    angle: float
    seconds: float
    before: Points
    after: Points
    ids: NDArray[np.int64]
    preparation: str = ""


class PulseRun:
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
    few : bool
        Whether there are so few particles that all may stand at walls.
    pairs : int
        Number of pairs of pulses that are measured along each axis.
    latencies : list of float
        For each pulse, the time until the camera showed the particles at rest.
    """

    def __init__(self, actuator: _Actuator, sensor: _Sensor, cell: float, wait: float) -> None:
        self.actuator, self.sensor, self.cell, self.wait = actuator, sensor, cell, wait
        self.latencies: list[float] = []
        # a simulated camera has a clock of its own, which its pictures count
        self._rate: float | None = getattr(sensor, "frame_rate", None)
        frames = self._frames(max(wait, 0.3))
        while len(frames) < 6:
            frames.append(self._next_frame(frames[-1].number))
        self._last = frames[-1]
        if not len(self._last.points):
            raise RigError("calibration: expected particles in the picture, got none")
        self.noise, self.drift = self._at_rest(frames)
        self.few = len(self._last.points) < FEW
        self.pairs = int(np.clip(-(-ENOUGH // len(self._last.points)), *CYCLES))
        self.pairs = -(-self.pairs // 2) if self.few else self.pairs  # of each order
        self._ids = np.arange(len(self._last.points))
        self._next_id = len(self._ids)

    def _clock(self, frame: Any) -> float:
        return float(frame.number / self._rate if self._rate else frame.time)

    def _next_frame(self, number: int | None) -> Any:
        """Return a picture that is not the one with the number given."""
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
        frames = [self._next_frame(None if last is None else last.number)]
        while self._clock(frames[-1]) - self._clock(frames[0]) < wait:
            frames.append(self._next_frame(frames[-1].number))
        return frames

    def _at_rest(self, frames: list[Any]) -> tuple[float, Points]:
        steps = []
        for before, after in pairwise(frames):
            pairs = match(before.points, after.points, (0, 0), self.cell / 3)
            steps.append(after.points[pairs[:, 1]] - before.points[pairs[:, 0]])
        first, last = frames[0], frames[-1]
        pairs = match(first.points, last.points, (0, 0), self.cell / 3)
        moved = last.points[pairs[:, 1]] - first.points[pairs[:, 0]]
        motions = np.vstack(steps)
        if not len(motions) or not len(moved):
            raise RigError(
                "calibration: expected particles that are seen again in the next picture"
            )
        # 1.4826 times the median of the magnitudes is the standard deviation of a normal variable
        noise = 1.4826 * float(np.median(np.abs(motions))) / 2**0.5
        drift = np.median(moved, axis=0)
        chance = 6 * noise / len(moved) ** 0.5  # four standard errors of a median of differences
        if float(np.linalg.norm(drift)) < chance:
            drift = np.zeros(2)
        return noise, drift / max(self._clock(last) - self._clock(first), 1e-9)

    def push(
        self, command: str, angle: float, seconds: float, expected: ArrayLike | None
    ) -> MeasuredPulse:
        """Carry out a pulse that moves particles by about the expected motion in pixels. None means
        about a cell in any direction.
        """
        before, ids = self._last, self._ids
        self.actuator.push(angle, seconds)
        frames = self._frames(self.wait)
        after = self._last = frames[-1]
        if expected is None:
            expected = likely_shift(before.points, after.points, self.cell / 2, 1.5 * self.cell)
        pairs = match(before.points, after.points, expected, self.cell / 2)
        self._ids = np.full(len(after.points), -1)
        self._ids[pairs[:, 1]] = ids[pairs[:, 0]]
        new = np.flatnonzero(self._ids < 0)
        self._ids[new] = self._next_id + np.arange(len(new))
        self._next_id += len(new)
        self._add_latency(frames)
        return MeasuredPulse(
            command,
            angle,
            seconds,
            before.points[pairs[:, 0]],
            after.points[pairs[:, 1]] - self.drift * (self._clock(after) - self._clock(before)),
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
            offsets = last.points[pairs[:, 1]] - frame.points[pairs[:, 0]]
            offset = float(np.median(np.linalg.norm(offsets, axis=1)))
            if offset > 4 * self.noise + 0.02 * self.cell:
                since = self._clock(frame) + between
                break
        self.latencies.append(since - first + between)

    def cycles(
        self, pulses: dict[str, tuple[float, float]], expected: dict[str, Points]
    ) -> list[MeasuredPulse]:
        """Carry out pulses back and forth along both axes. The first pair of each axis frees the
        particles and is not returned.
        """
        measured_pulses = []
        for pair in ("rl", "ud"):
            for preparation in self._preparations(pair):
                for letter in preparation * 2:
                    self.push(letter, *pulses[letter], expected[letter])
                cycle, cycles = 0, 1 + self.pairs
                while cycle < cycles:
                    late = False
                    for letter in pair:
                        pulse = self.push(letter, *pulses[letter], expected[letter])
                        late = late or self.late is not None
                        if cycle and self.late is None:
                            measured_pulses.append(replace(pulse, preparation=preparation))
                    cycle += 1
                    cycles += late and cycles < 2 * (1 + self.pairs)  # again
        if missing := set(pulses) - {pulse.command for pulse in measured_pulses}:
            raise RigError(
                f"calibration: expected pulses as long as asked at {' and '.join(sorted(missing))}, got"
                " none, because this computer is busy"
            )
        return measured_pulses

    @property
    def late(self) -> float | None:
        """How long the last pulse was if this computer made it too long, in seconds."""
        return getattr(self.actuator, "late", None)

    def _preparations(self, pair: str) -> tuple[str, ...]:
        """Return the commands before pulses back and forth. Few particles may all stand at walls,
        which then stop the stronger of the two commands each time: both orders are tried.
        """
        return (pair[1], pair[0]) if self.few else ("",)

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
        velocities: dict[str, Points] = {}
        for pair in ("rl", "ud"):
            for power in range(1 if whole else LONGER):
                share = 1.0 if whole else 2**power / 4
                moved = {letter: (np.full(2, np.nan), np.zeros(0, dtype=bool)) for letter in pair}
                for preparation in self._preparations(pair):
                    for letter, new in self._push_shortly(
                        pair, preparation, stated, share, whole
                    ).items():
                        # walls make motions shorter, never longer
                        if _length(new[0]) > 1.1 * _length(moved[letter][0]):
                            moved[letter] = new
                enough = [
                    letter
                    for letter, (motion, free) in moved.items()
                    if free.sum() >= FEWEST - 1 and np.linalg.norm(motion) >= self.cell / 10
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
                velocities[letter] = moved[letter][0] / (share * stated[letter][1])
        return velocities

    def _push_shortly(
        self,
        pair: str,
        preparation: str,
        stated: Mapping[str, tuple[float, float]],
        share: float,
        whole: bool,
    ) -> dict[str, tuple[Points, NDArray[np.bool_]]]:
        """Return the free motions, in pixels, of short pulses back and forth."""
        steps: dict[str, list[Points]] = {letter: [] for letter in pair}
        for letter in preparation * 2 + pair * CYCLES[0]:
            angle, seconds = stated[letter]
            pulse = self.push(letter, angle, share * seconds, None if whole else (0, 0))
            shorter = 1.0 if self.late is None else share * seconds / self.late
            steps[letter].append((pulse.after - pulse.before) * shorter)
        for letter in preparation:
            del steps[letter][:2]
        return {
            letter: free_motion(np.vstack(motions), self.noise * 2**0.5)
            for letter, motions in steps.items()
        }


def _length(motion: Points) -> float:
    """Return the length of a motion, and 0 for none."""
    return 0.0 if np.isnan(motion).any() else float(np.linalg.norm(motion))


@dataclass(frozen=True, eq=False)
class _Group:
    """The free motions of all equal pulses, in cells."""

    command: str
    angle: float
    seconds: float
    motion: Points
    error: float  # standard error
    count: int


def _groups(pulses: Sequence[MeasuredPulse], matrix: Points, noise: float) -> list[_Group]:
    """Return the free motions of the pulses of each angle and duration."""
    motions_by_pulse: dict[tuple[str, float, float], dict[str, list[Points]]] = {}
    for pulse in pulses:
        by_preparation = motions_by_pulse.setdefault(
            (pulse.command, pulse.angle, pulse.seconds), {}
        )
        by_preparation.setdefault(pulse.preparation, []).append(motions_of(pulse, matrix))
    groups = []
    for (command, angle, seconds), by_preparation in motions_by_pulse.items():
        stacks = [np.vstack(parts) for parts in by_preparation.values()]
        lengths = [_length(free_motion(motions, noise)[0]) for motions in stacks]
        # walls make motions shorter, never longer
        motions = np.vstack(
            [
                part
                for part, length in zip(stacks, lengths, strict=True)
                if length > 0.9 * max(lengths)
            ]
        )
        motion, free = free_motion(motions, noise)
        count, least = int(free.sum()), max(FEWEST, LEAST_FREE * len(motions))
        if count < least:
            raise RigError(
                f"calibration: expected at least {ceil(least)} free motions at the command {command},"
                f" got {count} of {len(motions)}; put the particles where they have room"
            )
        spread = float(np.std(motions[free] - motion))
        groups.append(
            _Group(command, angle, seconds, motion, max(spread, noise) / count**0.5, count)
        )
    return groups


def motions_of(pulse: MeasuredPulse, matrix: Points) -> Points:
    """Return the motions (x, y) in cells, y up (shape (n, 2))."""
    step = transform_points(matrix, pulse.after) - transform_points(matrix, pulse.before)
    return np.column_stack([step[:, 1], -step[:, 0]])


def fit_responses(groups: Sequence[_Group], stated: Responses) -> Responses:
    """Return the velocities and the dead time that fit the motions best (least squares), with the
    angles of the stated responses.
    """
    from scipy.optimize import least_squares

    letters = list(ANGLES)
    durations = {group.seconds for group in groups}
    several = len(durations) > len(letters)  # pulses of different lengths show the dead time

    def unpack(values: Points) -> Responses:
        sides = dict(zip(letters, map(tuple, values[:8].reshape(4, 2).tolist()), strict=True))
        return stated.model_copy(
            update={**sides, "dead": float(values[8]) * scale if several else 0.0}
        )

    scale = max(durations)
    weights = np.array([1 / max(group.error, 1e-4) for group in groups])

    def errors(values: Points) -> Points:
        responses = unpack(values)
        residuals = np.array(
            [responses.displacement(g.angle, g.seconds) - g.motion for g in groups]
        )
        return np.asarray((residuals * weights[:, None]).ravel(), dtype=np.float64)

    first = np.zeros(9)
    for at, letter in enumerate(letters):
        same = [g for g in groups if g.command == letter]
        first[2 * at : 2 * at + 2] = np.mean([g.motion / g.seconds for g in same], axis=0)
    fitted = least_squares(errors, first[: 9 if several else 8])
    values = fitted.x
    residuals = errors(values) / np.repeat(weights, 2)
    counts = {
        letter: sum(group.count for group in groups if group.command == letter)
        for letter in letters
    }
    responses = unpack(values)
    return responses.model_copy(
        update={"residual": float(np.sqrt(2 * np.mean(residuals**2))), "counts": counts}
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
    aim: float | None = None,
    wait: float = 0.5,
    limit: float = RESIDUAL,
    frequencies: Sequence[float] = (),
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
    aim : float, optional
        Length of the pulse of a command, in cells. By default `AIM`, or less if the field is so uneven
        that one particle in twenty would move by more than `LEAP`.
    wait : float
        Time after a pulse until particles are at rest and the camera shows it, in seconds.
    limit : float
        Largest root mean square error of the motions, in cells.
    frequencies : sequence of float
        Frequencies of a field that turns, in Hz, at which the speed is measured as well. The
        actuator needs the attribute ``frequency`` and the method ``set_frequency(frequency)``.

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
    if frequencies:
        check_frequencies(actuator, frequencies)
    whole = bool(getattr(actuator, "whole", False))
    stated_responses = Responses.from_pulses(
        pulses, only=whole or bool(getattr(actuator, "only", False))
    )
    run = PulseRun(actuator, sensor, cell, wait)
    speeds = run.speeds(pulses, whole=whole)
    half = {
        letter: (
            stated_responses.angles[letter],
            pulses[letter][1] if whole else cell / 2 / float(np.linalg.norm(speed)),
        )
        for letter, speed in speeds.items()
    }
    test_pulses = run.cycles(half, {letter: speeds[letter] * half[letter][1] for letter in ANGLES})
    if tie is None:
        assert size is not None
        pixels = _groups(test_pulses, _AS_PIXELS, run.noise * 2**0.5)
        motions = {group.command: group.motion * (1, -1) for group in pixels}
        seen = np.vstack([pulse.after for pulse in test_pulses])
        tie, shape = tie_by_scale(motions, cell, size, seen)
    assert shape is not None
    noise = run.noise * 2**0.5 / cell
    responses = fit_responses(_groups(test_pulses, tie.matrix, noise), stated_responses)
    _check_plausible(responses)
    if aim is None:
        aim = max(SHORTEST, min(AIM, LEAP / _fastest(test_pulses, tie.matrix, responses)))
    target_motions = {letter: aim * unit_at(angle) for letter, angle in ANGLES.items()}
    for _ in range(0 if whole else ROUNDS):  # with corrected pulses of full length
        full = {letter: responses.pulse_for(motion) for letter, motion in target_motions.items()}
        corrected_pulses = run.cycles(full, _in_pixels(target_motions, tie.matrix, shape))
        surprise = _surprise(_groups(corrected_pulses, tie.matrix, noise), responses)
        test_pulses = corrected_pulses if surprise else test_pulses + corrected_pulses
        responses = fit_responses(_groups(test_pulses, tie.matrix, noise), stated_responses)
        _check_plausible(responses)
        if not surprise:
            break
    else:
        if not whole:
            raise RigError(
                f"calibration: expected corrected pulses to move particles as foreseen, got {surprise}:"
                " walls hold the particles, or the pulses differ from each other"
            )
    if responses.residual > limit:
        raise RigError(
            f"calibration: expected test pulses that agree within {limit:g} cells, got"
            f" {responses.residual:.2g}"
        )
    drift = float(np.linalg.norm(run.drift)) / cell
    notes = list(tie.notes)
    if drift > DRIFT:
        notes.append(f"without a pulse, particles drift by {drift:.2g} cells a second")
    speed = (
        measure_speed(run, actuator, responses, tie.matrix, frequencies) if frequencies else None
    )
    calibration = BenchCalibration(
        shape=shape,
        tie=tie.kind,
        matrix=tie.matrix.tolist(),
        residual=tie.residual,
        cell_size=cell_size,
        noise=run.noise,
        latency=max(run.latencies),
        own_gain=_own_gain(test_pulses, tie.matrix, responses, noise),
        responses=responses,
        stated={letter: seconds for letter, (_, seconds) in pulses.items()},
        whole=whole,
        aim=aim,
        speed=speed,
        notes=notes,
    )
    if whole:
        calibration.notes.extend(_whole_command_notes(calibration))
    return calibration


def check_frequencies(actuator: Any, frequencies: Sequence[float]) -> None:
    """Refuse frequencies that show nothing, or an actuator without them."""
    if len(set(frequencies)) < FEWEST:
        raise InvalidInputError(
            f"frequency: expected at least {FEWEST} different ones, got {len(set(frequencies))}"
        )
    for frequency in frequencies:
        check_number(frequency, what="frequency", above=0)
    if getattr(actuator, "frequency", None) is None:
        raise InvalidInputError(
            f"frequency: expected an actuator whose field turns, got {actuator.name}"
        )


def measure_speed(
    run: PulseRun,
    actuator: Any,
    responses: Responses,
    matrix: Points,
    frequencies: Sequence[float],
) -> Speed:
    """Measure the speed of particles against the frequency of the field, with pulses to the right
    and to the left, and fit the step-out frequency. The frequency of before is restored.
    """
    frequency_before = float(actuator.frequency)
    noise = run.noise * 2**0.5 / run.cell
    speeds = []
    try:
        for frequency in sorted(frequencies):
            actuator.set_frequency(frequency)
            magnitudes = []
            velocities: dict[str, list[Points]] = {"r": [], "l": []}
            for letter in "rl" * (1 + run.pairs):
                velocity = np.array(getattr(responses, letter))
                # half a cell, if the speed is proportional to the frequency
                seconds = 0.5 / float(np.linalg.norm(velocity)) * frequency_before / frequency
                pulse = run.push(letter, responses.angles[letter], seconds, (0, 0))
                velocities[letter].append(motions_of(pulse, matrix) / seconds)
            for letter_velocities in velocities.values():
                rates = np.vstack(letter_velocities[1:])
                motion, free = free_motion(rates, noise / seconds)
                magnitudes.append(float(np.linalg.norm(motion)) if free.any() else 0.0)
            speeds.append(float(np.mean(magnitudes)))
    finally:
        actuator.set_frequency(frequency_before)
    return fit_speed(sorted(frequencies), speeds)


def fit_speed(frequencies: Sequence[float], speeds: Sequence[float]) -> Speed:
    """Return the slope and the step-out frequency that fit measured speeds best (least squares).

    Examples
    --------
    >>> fit_speed([1, 2, 4], [3, 6, 12]).step_out is None
    True
    """
    at, seen = np.array(frequencies, dtype=np.float64), np.array(speeds, dtype=np.float64)
    best: tuple[float, float, float | None] | None = None
    for step_out in (None, *np.geomspace(at.min(), at.max(), 400).tolist()):
        over = at if step_out is None else np.minimum(at, step_out)
        turns = at - (0 if step_out is None else np.sqrt(np.maximum(at**2 - over**2, 0)))
        slope = float(turns @ seen / (turns @ turns))
        error = float(np.sum((slope * turns - seen) ** 2))
        if best is None or error < best[0] * (1 - 1e-6):
            best = error, slope, step_out
    assert best is not None
    _, slope, step_out = best
    if step_out is not None and step_out >= at.max() * (1 - 1e-6):
        step_out = None
    if slope <= 0:
        raise RigError("calibration: expected particles that move at some frequency, got none")
    return Speed(frequencies=at.tolist(), speeds=seen.tolist(), slope=slope, step_out=step_out)


def _in_pixels(
    motions: dict[str, Points], matrix: Points, shape: tuple[int, int]
) -> dict[str, Points]:
    """Return motions (x, y) in cells as motions in pixels in the middle of the grid."""
    to_pixels = np.asarray(np.linalg.inv(matrix), dtype=np.float64)
    centre = np.array([(shape[0] - 1) / 2, (shape[1] - 1) / 2])
    origin = transform_points(to_pixels, centre)[0]
    return {
        letter: transform_points(to_pixels, centre + np.array([-y, x]))[0] - origin
        for letter, (x, y) in motions.items()
    }


def _whole_command_notes(calibration: BenchCalibration) -> list[str]:
    """Return what is wrong with commands that cannot be corrected."""
    notes = []
    for letter in ANGLES:
        length, heading = calibration.gain(letter), calibration.responses.heading(letter)
        if length is not None and not 1.0 <= length <= LONGEST:
            notes.append(
                f"the command {letter} moves particles by {length:.2f} cells; set the actuator to"
                f" 1.05 to 1.1"
            )
        if abs(heading) > ASKEW:
            notes.append(f"the command {letter} leads {heading:+.1f} degrees aside")
    return notes


def _surprise(groups: Sequence[_Group], responses: Responses) -> str:
    """Return a direction in which pulses do not move particles as foreseen, or nothing."""
    for group in groups:
        expected = responses.displacement(group.angle, group.seconds)
        length = float(np.linalg.norm(expected))
        if np.linalg.norm(group.motion - expected) > CONTRADICTION * length:
            return f"{np.linalg.norm(group.motion):.2f} instead of {length:.2f} cells at {group.command}"
    return ""


def _check_plausible(responses: Responses) -> None:
    """Refuse axes that are turned or mirrored, and directions in which particles had no room."""
    speeds = {letter: float(np.linalg.norm(getattr(responses, letter))) for letter in ANGLES}
    slow, fast = (
        min(speeds, key=lambda letter: speeds[letter]),
        max(speeds, key=lambda letter: speeds[letter]),
    )
    if speeds[fast] > UNEQUAL * speeds[slow]:
        raise RigError(
            f"calibration: expected commands of about equal speed, got {speeds[slow]:.3g} cells a"
            f" second at {slow} and {speeds[fast]:.3g} at {fast}: a coil is weak, or walls hold the"
            " particles"
        )
    for letter, angle in ANGLES.items():
        heading = responses.heading(letter)
        if abs(heading) > TURNED:
            raise RigError(
                f"calibration: expected the command {letter} to move particles within"
                f" {TURNED:g} degrees of {angle:g}, got {angle + heading:.0f}: the"
                " marks or the actuator are turned or mirrored"
            )


def _fastest(pulses: Sequence[MeasuredPulse], matrix: Points, responses: Responses) -> float:
    """Return the speed that one particle in twenty exceeds, as a share of the usual one, of all
    particles that moved by at least half.
    """
    shares = []
    for pulse in pulses:
        motion = responses.displacement(pulse.angle, pulse.seconds)
        along = motions_of(pulse, matrix) @ motion / float(motion @ motion)
        shares.append(along[along > 0.5])
    return max(1.0, float(np.quantile(np.concatenate(shares), 0.95)))


def _own_gain(
    pulses: Sequence[MeasuredPulse], matrix: Points, responses: Responses, noise: float
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
    for by_command in shares.values():
        if len(by_command) == len(ANGLES):
            means.append(np.mean([np.mean(values) for values in by_command.values()]))
            errors.append(noise**2 / sum(map(len, by_command.values())))
    if len(means) < FEWEST:
        return 0.0
    return float(np.sqrt(max(np.var(means, ddof=1) - np.mean(errors), 0.0)))
