"""The search for potentials between the first and the last contact, by parts of both."""

from __future__ import annotations

import heapq
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
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

    Several parts can be tried at once, because the solver works without Python's lock.

    Parameters
    ----------
    pool : Executor
        Its threads try the parts.
    start, goal : ndarray of float64, shape (2, 2)
        In units of the radius, around the middle.
    tolerance, limit, ring : float
        As in `check_potential.potential_value`.
    """

    def __init__(
        self,
        pool: Executor,
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
        self._pool = pool
        self._heap: list[tuple[float, int, _Part]] = []
        self._running: dict[Future[tuple[float, dict[str, Any] | None]], tuple[_Part, int]] = {}
        self._made = 0
        self.tried = 0
        self.roots = [_Part(pair, 0.0) for pair in (self.contacts.roots() if self.possible else [])]
        for part in self.roots:
            self._push(part)

    @property
    def lower(self) -> float:
        """Lower bound on the length of all plans, at most the limit."""
        if not self.possible:
            return 0.0
        running = [part.least for part, _ in self._running.values()]
        return min(*running, self._heap[0][0] if self._heap else inf, self.limit)

    def step(self, workers: int, *, patient: bool) -> None:
        """Try parts in as many threads as ``workers``, and take what they have found; ``patient``
        waits until one has found something.
        """
        while len(self._running) < workers and (found := self._next()) is not None:
            self._running[self._pool.submit(self._potential, *found)] = found
        done, _ = wait(self._running, timeout=None if patient else 0, return_when=FIRST_COMPLETED)
        for future in done:
            part, degree = self._running.pop(future)
            value, proof = future.result()
            part.degree = degree
            self.tried += value < inf
            if value > part.own:
                part.own, part.proof = value, proof
            part.least = max(part.least, value)
            self._push(part)

    def _next(self) -> tuple[_Part, int] | None:
        """Return the part with the least bound, and the degree of a potential to try for it; None if
        all bounds are enough. A part without such a degree is divided.
        """
        while self._heap and self._heap[0][0] < self.limit:
            part = heapq.heappop(self._heap)[-1]
            widths = [_width(sector) for sector in part.pair]
            if not part.degree:
                return part, DEGREES[0]
            if max(widths) <= _WIDEST and part.degree < DEGREES[-1]:
                return part, DEGREES[-1]
            end = int(widths[1] > widths[0])
            part.cut = ("first", "last")[end], _middle(part.pair[end])
            part.children = [_Part(pair, part.least) for pair in split(part.pair, *part.cut)]
            for child in part.children:
                self._push(child)
        return None

    def _potential(self, part: _Part, degree: int) -> tuple[float, dict[str, Any] | None]:
        """Return the bound of a potential for the plans of a part, with its proof; infinity if it has
        no plans.
        """
        around = self.contacts.region(*part.pair)
        if around is None:
            return inf, None
        accuracy = _ACCURACIES[max(map(_width, part.pair)) < _NARROW]
        return contact_potential(self.contacts, part.pair, around, degree, accuracy)

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
