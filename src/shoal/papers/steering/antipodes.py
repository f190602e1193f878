"""Approach to antipodal (opposite) goals on a disk: the data for figure 15 of paper W."""

from __future__ import annotations

from math import pi
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_choice, check_integer, check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.steering.planners.chains.chain import ChainQuery
from shoal.steering.planners.chains.cycles import nearest_cycles
from shoal.steering.workspaces.convex import disk
from shoal.steering.workspaces.convex_geometry import Points
from shoal.steering.workspaces.normalized_walls import normalize_walls

Toucher = Literal["nearer", "second"]


@dataclass(frozen=True, eq=False)
class AntipodeSwap:
    """The approach of two particles on a disk to antipodal (opposite) goals, cycle by cycle.

    In a cycle, the first move brings one particle to the wall (contact), and the second move moves the other particle (adjustment).

    Parameters
    ----------
    toucher : str
        "second": particle 2 touches the wall in all cycles. "nearer": in each cycle, the particle that is nearer to its possible
        contact touches the wall.
    start, goal : ndarray of float64, shape (2, 2)
    moves : ndarray of float64, shape (2 cycles, 2)
        The moves of the plan, in which contacts and adjustments alternate.
    lengths : ndarray of float64, shape (cycles,)
        For each cycle, the length of the plan that ends after this cycle, including the final translation, in diameters of the
        disk.
    errors : ndarray of float64, shape (cycles,)
        The error δ after each cycle: the remaining distance of each particle from its goal after the final translation, in
        diameters of the disk.
    """

    toucher: Toucher
    start: Points
    goal: Points
    moves: Points
    lengths: NDArray[np.float64]
    errors: NDArray[np.float64]

    def law(self, *, below: float = 0.25) -> tuple[float, float]:
        """Return the constants a and b of the law error = a / length^b.

        The method fits the law as a straight line in logarithms, to all errors smaller than ``below``.

        Raises
        ------
        InvalidInputError
            If fewer than two errors are smaller than ``below``.
        """
        low = self.errors < below
        if np.count_nonzero(low) < 2:
            raise InvalidInputError(f"law: expected two errors or more below {below:g}, got {np.count_nonzero(low)}")
        slope, level = np.polyfit(np.log(self.lengths[low]), np.log(self.errors[low]), 1)
        return float(np.exp(level)), -float(slope)

    def length_to(self, error: float) -> float:
        """Return the length of the shortest plan whose error is at most ``error``, or NaN if every plan has a larger error."""
        near = self.lengths[self.errors <= error]
        return float(near.min()) if near.size else np.nan


def swap_antipodes(*, toucher: Toucher = "nearer", cycles: int = 60, apart: float = 0.8, turn: float = 0.0) -> AntipodeSwap:
    """Return the approach of two particles on a disk of diameter 1 to antipodal (opposite) goals, with algorithm 1 of paper W.

    Each cycle brings the position difference Δ of the particles as near as possible to the position difference of the goals. If the
    initial Δ had the length of one diameter and pointed exactly opposite to the difference of the goals, the nearest reachable
    difference would be Δ = 0. No move changes a position difference of zero. To avoid a position difference of zero, the particles
    start less than one diameter apart.

    Parameters
    ----------
    toucher : str
        The particle that touches the wall: "nearer" (the particle nearer to its contact) or "second" (always particle 2). The
        choice of the touching particle does not change the position differences.
    cycles : int
        Number of cycles (contact and adjustment), at least 1.
    apart : float
        Initial distance of the particles in diameters of the disk, above 0 and below 1. Both particles start equally far from the
        centre of the disk.
    turn : float
        Angle, in radians, between the initial position difference and the line through the goals. With the angle 0, the particles
        exchange sides.

    Raises
    ------
    InvalidInputError

    Notes
    -----
    Source: figure 15 in section VI of paper W.

    Examples
    --------
    >>> [round(swap_antipodes(toucher=who).length_to(0.01), 1) for who in ("second", "nearer")]
    [9.3, 4.4]
    """
    check_choice(toucher, what="toucher", choices=("nearer", "second"))
    check_integer(cycles, what="cycles", least=1)
    check_number(apart, what="apart", above=0, below=1)
    radius = 0.5
    ahead = apart / 2 * np.array([np.cos(turn), np.sin(turn)])
    query = ChainQuery(normalize_walls(disk(radius)), np.stack([-ahead, ahead]), np.array([[radius, 0.0], [-radius, 0.0]]))
    state, moves, lengths, errors = query.start, [], [], []
    for _ in range(cycles):
        cycle = nearest_cycles(query, state[1] - state[0], query.after)[0]  # Δ is not zero, so some contact is possible
        delta = cycle.after
        who, contact = _contact(state, cycle.low / radius, radius, toucher)
        moves += [contact - state[who], (delta - (state[1] - state[0])) * (1 if who == 0 else -1)]
        state = np.stack([contact, contact + delta] if who == 0 else [contact - delta, contact])
        left = query.goal - state
        lengths.append(float(np.linalg.norm(moves, axis=1).sum() + np.linalg.norm(left.mean(axis=0))))
        errors.append(float(np.linalg.norm(left[1] - left[0]) / 2))
    return AntipodeSwap(toucher, query.start, query.goal, np.array(moves), np.array(lengths), np.array(errors))


def _contact(state: Points, angle: float, radius: float, toucher: Toucher) -> tuple[int, Points]:
    """Return the index of the touching particle, counted from 0, and the point at which this particle touches the wall.

    Particle 0 touches the wall at the angle ``angle``, and particle 1 touches the wall at the opposite point.
    """
    places = radius * np.array([[np.cos(angle + turn), np.sin(angle + turn)] for turn in (0.0, pi)])
    who = 1 if toucher == "second" else int(np.argmin(np.linalg.norm(places - state, axis=1)))
    return who, places[who]
