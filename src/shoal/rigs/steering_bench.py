"""A bench as a rig for steering: it looks at particles in the unit of a problem, and moves them by
vectors.
"""

from __future__ import annotations

from math import ceil, hypot, inf
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_number, check_points
from shoal.core.errors import InvalidInputError
from shoal.rigs.calibration import Responses
from shoal.rigs.ports import BenchRig
from shoal.rigs.remote import RemoteRig

Points = NDArray[np.float64]
SHORTEST = 1e-3  # cells: a shorter move is none


class SteeringBench:
    """A rig for steering made of a bench.

    Parameters
    ----------
    rig : BenchRig or RemoteRig
        A remote rig must be able to push and to look (`RemoteRig.can`).
    responses : Responses
        How the particles answer to pulses. `Responses.from_pulses` takes the pulses as exact.
    unit : float
        Length of a cell in the unit of the problem.
    origin : array_like of float, shape (2,)
        Where the lower left corner of the field of view lies, in the unit of the problem.

    Raises
    ------
    InvalidInputError
        Raised if the actuator knows only some directions.

    Examples
    --------
    >>> from shoal.rigs import Plant, PlantPorts, PlantProperties
    >>> from shoal.swarm import GridWorkspace
    >>> plant = Plant(
    ...     GridWorkspace(np.ones((5, 5))), [(1.5, 1.5)], PlantProperties(), np.random.default_rng(1)
    ... )
    >>> ports = PlantPorts(plant)
    >>> bench = SteeringBench(BenchRig(ports, ports), Responses.from_pulses(ports.pulses), unit=0.2)
    >>> bench.send((0.3, 0.3))
    >>> bench.look().round(2).tolist()
    [[0.6, 0.6]]
    """

    def __init__(
        self,
        rig: BenchRig | RemoteRig,
        responses: Responses,
        *,
        unit: float = 1.0,
        origin: ArrayLike = (0.0, 0.0),
    ) -> None:
        if responses.only:
            raise InvalidInputError(
                f"steering: expected an actuator that pushes in every direction, got {rig.name},"
                " which carries out the commands only"
            )
        if isinstance(rig, RemoteRig) and not {"push", "look"} <= set(rig.can):
            raise InvalidInputError(
                f"steering: expected a rig that can push and look, got {rig.name}, which can"
                f" {' and '.join(rig.can) or 'neither'}"
            )
        self.rig, self.responses = rig, responses
        self.unit = check_number(unit, what="unit", above=0)
        self.origin = check_points([origin], what="origin", dimensions=2, count=1)[0]
        self._longest: float = getattr(getattr(rig, "actuator", rig), "longest", inf)

    @property
    def name(self) -> str:
        """Name of the rig."""
        return self.rig.name

    @property
    def values(self) -> dict[str, float]:
        """What was commanded and measured at the last push, by name."""
        return self.rig.values

    def look(self) -> Points:
        """Return the points (x, y) that the sensor sees, in the unit of the problem (float64, shape
        (n, 2)).
        """
        row, col = self.rig.look().points.T
        cells = np.column_stack([col + 0.5, self.rig.shape[0] - row - 0.5])
        points: Points = cells * self.unit + self.origin
        return points

    def send(self, move: Any) -> None:
        """Move the particles by (dx, dy) in the unit of the problem, by several pulses if one would
        be too long.

        Raises
        ------
        InvalidInputError
            Raised beyond a limit of the actuator.
        RigError
            Raised if the rig has been stopped, or the actuator has failed.
        """
        cells = check_points([move], what="move", dimensions=2, count=1)[0] / self.unit
        if hypot(*cells) < SHORTEST:
            return
        angle, seconds = self.responses.pulse_for(cells)
        dead = self.responses.dead  # of each pulse
        pulses = 1 if seconds <= self._longest else ceil((seconds - dead) / (self._longest - dead))
        if pulses > 1:
            angle, seconds = self.responses.pulse_for(cells / pulses)
        for _ in range(pulses):
            self.rig.push(angle, seconds)

    def stop(self) -> None:
        """Turn the field off. The rig then refuses further moves."""
        self.rig.stop()

    def close(self) -> None:
        """Release the devices."""
        self.rig.close()
