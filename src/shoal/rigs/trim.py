"""Pulse trim: while a rig is driven, the pulses of the commands are corrected by what the camera
shows, in length and in heading.
"""

from __future__ import annotations

from math import cos, inf, radians, sin

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import InvalidInputError
from shoal.rigs.calibration import Responses
from shoal.rigs.following import free_motion, match
from shoal.rigs.physics import ANGLES

Points = NDArray[np.float64]

RATE = 0.3  # share of the error of one pulse by which the velocity of its direction is corrected
USUAL = 3.0  # number of free particles whose motion counts as much as what was known before
BACK = 0.7  # share of the offset from the centres that the next pulse takes back
AIM = 1.0  # cells: the offsets are corrected, so that no pulse need be too long
REACH = 0.5  # cells from the expected motion within which a particle is looked for
MOST = 0.35  # largest correction of one pulse, in cells
NOISE = 0.05  # usual error of a motion, in cells, that does not show whether a particle was held


class PulseTrim:
    """Corrects the pulses of commands while a rig is driven.

    After each command, the particles are followed from the picture before to the picture after.
    Particles that a wall or another particle held are left out (`free_motion`). The others show by
    their motion how fast particles are in this direction, and by their median offset from the
    centres of cells what the next pulse must add or take back.

    Parameters
    ----------
    responses : Responses
        The answers of particles to pulses, as calibrated or as stated.
    aim : float
        Length of the pulse of a command, in cells.
    noise : float
        Standard deviation of an observed motion along each axis, in cells.
    longest : float
        Longest pulse of the actuator, in seconds.

    Attributes
    ----------
    offset : ndarray of float64, shape (2,)
        Median offset (x, y) of the free particles from the centres of cells, y up.
    """

    def __init__(
        self, responses: Responses, *, aim: float = AIM, noise: float = NOISE, longest: float = inf
    ) -> None:
        self.responses, self.aim, self.noise, self.longest = responses, aim, noise, longest
        self.offset = np.zeros(2)
        self._before: Points | None = None
        self._sent: list[tuple[str, float, float]] = []

    def pulse(self, command: str) -> tuple[float, float]:
        """Return angle and seconds of the pulse for a command."""
        turn = radians(ANGLES[command])
        ahead = np.array([cos(turn), sin(turn)])
        motion = self.aim * ahead - np.clip(BACK * self.offset, -MOST, MOST)
        try:
            angle, seconds = self.responses.pulse_for(motion)
        except InvalidInputError:
            angle, seconds = self.responses.pulse_for(self.aim * ahead)
        seconds = min(seconds, self.longest)
        self._sent.append((command, angle, seconds))
        return angle, seconds

    def note_duration(self, seconds: float) -> None:
        """Take over that the last pulse was not as long as `pulse` has said, but so many seconds."""
        command, angle, _ = self._sent[-1]
        self._sent[-1] = (command, angle, seconds)

    def see(self, cells: Points) -> None:
        """Learn from the picture after the last pulse: float (row, column) of the particles."""
        after = np.column_stack([cells[:, 1], -cells[:, 0]])
        before, self._before, sent = self._before, after, self._sent
        if not sent:
            return
        self._sent = []
        if before is None or len(sent) != 1:
            self.offset = np.zeros(2)
            return
        command, angle, seconds = sent[0]
        expected = self.responses.displacement(angle, seconds)
        pairs = match(before, after, expected, REACH)
        motions = after[pairs[:, 1]] - before[pairs[:, 0]]
        # what moved by less than half was held
        length = float(np.linalg.norm(expected))
        along = motions @ expected / length
        moving = np.flatnonzero(along > length / 2)
        motion, apart = free_motion(motions[moving], self.noise)
        free = moving[apart]
        if not len(free):
            self.offset = np.zeros(2)
            return
        self._learn(command, seconds, motion - expected, len(free))
        ends = after[pairs[free, 1]]
        self.offset = np.median(ends - np.round(ends), axis=0) * len(free) / (len(free) + 1)

    def _learn(self, command: str, seconds: float, error: Points, count: int) -> None:
        active = max(seconds - self.responses.dead, 1e-9)
        step = RATE * count / (count + USUAL) * error / active
        x, y = getattr(self.responses, command)
        self.responses = self.responses.model_copy(
            update={command: (x + float(step[0]), y + float(step[1]))}
        )
