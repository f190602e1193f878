"""Staggering: the choice of altitude layers and start delays that keep vehicles separated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.search.flight.separation import conflicts, merged_intervals
from shoal.search.flight.timing import Floats, Trajectory

HORIZONTAL, VERTICAL, DELAY = 10.0, 5.0, 10.0
"""Defaults of the horizontal and vertical separation in metres, and of a vehicle's maximum unplanned delay in seconds."""

_WORTH = 0.05  # relative to the longest flight: time that another layer must save
_AFTER = 1.0  # seconds: distance of delays from a conflict, so that delays can be rounded to whole seconds

Flights = Callable[[int], Sequence[Trajectory]]
Started = tuple[Sequence[Trajectory], float]


@dataclass(frozen=True)
class Separation:
    """The required horizontal and vertical distance of vehicles in flight.

    Two vehicles must always keep the horizontal or the vertical distance.

    Parameters
    ----------
    horizontal, vertical : float
        Required horizontal and vertical distance in metres.
    delay : float
        Maximum unplanned delay of each vehicle in seconds. The unplanned delays of different vehicles are independent.
    """

    horizontal: float = HORIZONTAL
    vertical: float = VERTICAL
    delay: float = DELAY


def staggered(
    flights: Sequence[Flights],
    separation: Separation,
    layers: Sequence[int] | None = None,
    earliest: Floats | None = None,
    before: Sequence[Started] = (),
) -> tuple[NDArray[np.int64], Floats]:
    """Return an altitude layer and a start delay for each vehicle, with which all vehicles in flight keep the separation.

    The longest flight starts first, in the lowest layer. Each of the other flights uses the layer in which this
    flight can end earliest. A new layer must save at least a twentieth of the longest flight's duration, because a higher layer
    costs a longer climb.

    Parameters
    ----------
    flights : sequence of callable
        For each vehicle, a function that returns the vehicle's trajectories in a given layer. The lowest layer has the number 0.
        Several trajectories are alternative estimates of the vehicle's times. The separation holds between trajectories of
        different vehicles that have equal indices. A vehicle without trajectories stays on the ground.
    separation : Separation
    layers : sequence of int, optional
        Layer of each vehicle. With given layers, the function computes only the delays.
    earliest : ndarray of float64, shape (m,), optional
        Lower bound on the delay of each vehicle in seconds.
    before : sequence of (sequence of Trajectory, float)
        Trajectories and delays of vehicles whose delays are already fixed.

    Returns
    -------
    layers : ndarray of int64, shape (m,)
        Layer of each vehicle, counted from 0.
    delays : ndarray of float64, shape (m,)
        Delay of each vehicle in whole seconds.

    Examples
    --------
    >>> way = np.array([(0.0, 0.0, 0.0), (0.0, 0.0, 30.0), (100.0, 0.0, 30.0), (0.0, 0.0, 30.0), (0.0, 0.0, 0.0)])
    >>> flight = Trajectory(np.array([0.0, 10.0, 30.0, 50.0, 60.0]), way)
    >>> layers, delays = staggered([lambda layer: [flight]] * 2, Separation())
    >>> layers.tolist(), delays.tolist()
    ([0, 0], [0.0, 71.0])
    """
    flown = [cache(flight) for flight in flights]
    lasting = np.array([max((one.duration for one in flight(0)), default=0.0) for flight in flown])
    chosen, delays = np.zeros(len(flights), dtype=np.int64), np.zeros(len(flights))
    least = np.zeros(len(flights)) if earliest is None else earliest
    settled: list[int] = []
    end, opened = float(lasting.max(initial=0.0)), 1
    for vehicle in np.argsort(-lasting, kind="stable").tolist():
        if not flown[vehicle](0):
            continue
        options = range(opened + 1) if layers is None else [layers[vehicle]]
        others = [*before, *((flown[one](int(chosen[one])), float(delays[one])) for one in settled)]
        found: list[tuple[float, int, float]] = []
        for layer in options:
            delay = _earliest(flown[vehicle](layer), others, separation, float(least[vehicle]))
            dear = _WORTH * float(lasting.max()) if layer == opened and layers is None else 0.0
            found.append((max(delay + lasting[vehicle], end) + dear, layer, delay))
            if found[-1][0] <= end:
                break
        _, chosen[vehicle], delays[vehicle] = min(found)
        end, opened = max(end, float(delays[vehicle] + lasting[vehicle])), max(opened, int(chosen[vehicle]) + 1)
        settled.append(vehicle)
    return chosen, delays


def _earliest(mine: Sequence[Trajectory], others: Sequence[Started], separation: Separation, delay: float) -> float:
    """Return the smallest delay, at least ``delay``, with which a vehicle keeps apart from vehicles with fixed delays."""
    barred = [np.zeros((0, 2))]
    for theirs, started in others:
        if started + max(one.duration for one in theirs) + separation.delay < delay:
            continue  # it has landed, however late it is
        for one, other in zip(mine, theirs, strict=True):
            apart = conflicts(one, other, horizontal=separation.horizontal, vertical=separation.vertical)
            # With both uncertainties, the start differs by delay - started, plus or minus the tolerance.
            barred.append(started - apart[:, ::-1] + separation.delay * np.array([-1.0, 1.0]))
    for low, high in merged_intervals(np.concatenate(barred)).tolist():
        if low - _AFTER < delay < high + _AFTER:
            delay = high + _AFTER
    return float(np.ceil(delay))
