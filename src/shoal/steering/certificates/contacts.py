"""The search for potentials between the first and the last contact, by parts of both."""

from __future__ import annotations

import heapq
from fractions import Fraction
from math import atan2, cos, floor, inf, pi, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.steering.certificates.check_contacts import Contacts, Sector, split
from shoal.steering.certificates.check_potential import BITS, DEGREES
from shoal.steering.certificates.potential import contact_potential

_WIDEST = 1.4  # angle of a sector for which a potential of the higher degree is tried
_NARROW = 0.2  # angle of sectors in which a bound is not worth less time of the solver
_ACCURACIES = 1e-5, 1e-6  # of the solver in other sectors, and in these


@dataclass(frozen=False, eq=False)
class _Part:
    """The plans with their first and last contacts in two sectors."""

    pair: tuple[Sector, Sector]
    least: float
    own: float = 0.0
    degree: int = 0  # of the potential that was tried last
    proof: dict[str, Any] | None = None
    cut: tuple[str, list[float]] | None = None
    children: list[_Part] | None = None


class ContactSearch:
    """Best-first search: the part of the plans with the least bound is divided.

    Parameters
    ----------
    start, goal : ndarray of float64, shape (2, 2)
        In units of the radius, around the middle.
    tolerance, limit, ring : float
        As in `check_potential.potential_value`.
    """

    def __init__(
        self,
        start: NDArray[np.float64],
        goal: NDArray[np.float64],
        tolerance: float,
        limit: float,
        ring: float,
    ) -> None:
        first, last = ([Fraction(x) for x in point.ravel().tolist()] for point in (start, goal))
        self.limit: float = floor(limit * 2.0**BITS) / 2.0**BITS
        sizes = [Fraction(x) for x in (tolerance, self.limit, ring)]
        self.contacts = Contacts(first, last, *sizes)
        self.possible = self.contacts.possible
        self._heap: list[tuple[float, int, _Part]] = []
        self._made = 0
        self.tried = 0
        roots = self.contacts.roots() if self.possible else []
        self.roots = [_Part(pair, 0.0) for pair in roots]
        for part in self.roots:
            self._try(part, DEGREES[0])
            self._push(part)

    @property
    def lower(self) -> float:
        """Lower bound on the length of all plans, at most the limit."""
        if not self.possible:
            return 0.0
        return min(self._heap[0][0], self.limit) if self._heap else self.limit

    def step(self) -> None:
        """Find a potential of a higher degree for the part with the least bound, or divide it."""
        part = heapq.heappop(self._heap)[-1]
        widths = [_width(sector) for sector in part.pair]
        if max(widths) <= _WIDEST and part.degree < DEGREES[-1]:
            self._try(part, DEGREES[-1])
            self._push(part)
            return
        end = int(widths[1] > widths[0])
        part.cut = ("first", "last")[end], _middle(part.pair[end])
        part.children = [
            _Part(pair, part.least) for pair in split(part.pair, part.cut[0], part.cut[1])
        ]
        for child in part.children:
            self._try(child, DEGREES[0])
            self._push(child)

    def _try(self, part: _Part, degree: int) -> None:
        around = self.contacts.region(*part.pair)
        if around is None:
            part.least = part.own = inf
            return
        self.tried += 1
        accuracy = _ACCURACIES[max(map(_width, part.pair)) < _NARROW]
        value, proof = contact_potential(self.contacts, part.pair, around, degree, accuracy)
        if value > part.own:
            part.own, part.proof = value, proof
        part.degree, part.least = degree, max(part.least, value)

    def _push(self, part: _Part) -> None:
        if part.least < inf:
            self._made += 1
            heapq.heappush(self._heap, (part.least, self._made, part))

    def proof(self, enough: float) -> dict[str, Any]:
        """Return the proof that no plan is shorter than ``enough``, as JSON."""
        parts, stack = [], self.roots[::-1]
        while stack:
            part = stack.pop()
            if part.own >= enough:
                parts.append(part.proof or {})
                continue
            assert part.cut is not None
            parts.append({"side": part.cut[0], "direction": part.cut[1]})
            stack += (part.children or [])[::-1]
        return {"limit": self.limit, "parts": parts}


def _angles(sector: Sector) -> tuple[float, float]:
    first, last = (atan2(float(y), float(x)) for x, y in sector[1:])
    return first, first + (last - first) % (2 * pi)


def _width(sector: Sector) -> float:
    first, last = _angles(sector)
    return last - first


def _middle(sector: Sector) -> list[float]:
    middle = sum(_angles(sector)) / 2
    return [round(x * 2**BITS) / 2**BITS for x in (cos(middle), sin(middle))]
