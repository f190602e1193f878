"""Where a target may be, and what looks of robots at the ground find."""

from __future__ import annotations

from math import inf
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.search.cells.layers import Grid, layers_of
from shoal.search.regions.outline import Points
from shoal.search.tours import Tour

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

_AT_ONCE = 500_000  # positions of particles


@dataclass(frozen=True, eq=False)
class Looks:
    """Looks at pieces of the ground.

    Parameters
    ----------
    pieces : ndarray of int64, shape (k,)
        Increasing numbers of pieces.
    times : ndarray of float64, shape (k,)
        The times of the looks, which increase for each piece.
    earlier : ndarray of int64, shape (k,)
        Number of earlier looks at the same piece.
    """

    pieces: NDArray[np.int64]
    times: Floats
    earlier: NDArray[np.int64]


def looks_in_order(pieces: Numbers, times: Floats) -> Looks:
    """Return looks at pieces of the ground, sorted by piece and time."""
    order = np.lexsort((times, pieces))
    pieces, times = pieces[order], times[order]
    return Looks(pieces, times, np.arange(len(pieces)) - np.searchsorted(pieces, pieces))


@dataclass(frozen=True, eq=False)
class Ground:
    """Where a target may stand: pieces of the ground, and the cells from which robots look at them.

    Parameters
    ----------
    masses : ndarray of float64, shape (G,)
        Probability of each piece. Together, they are 1.
    cells : ndarray of int64, shape (G, L)
        Tour indices of the cells in which robots look at each piece, or -1.
    """

    masses: Floats
    cells: NDArray[np.int64]

    def shares(self, n: int, detection: float) -> Floats:
        """Return the probability that the search of each of n cells is the one that finds the
        target, if each piece is searched in the order of its cells, again and again; float64,
        shape (n,). Together, they are 1.

        Of k looks with the probability d of detection, the look after j others finds the target
        with the probability d (1 - d)^j / (1 - (1 - d)^k).
        """
        there = self.cells >= 0
        earlier = np.cumsum(there, axis=1) - there
        shares = there * (1.0 - detection) ** earlier
        shares *= (self.masses / shares.sum(axis=1))[:, None]
        return np.bincount(self.cells[there], shares[there], minlength=n)

    def looks(self, cells: NDArray[np.int64], times: Floats) -> Looks:
        """Return the looks at each piece, in the order of their times, if robots search cells at
        given times; both of shape (k,).
        """
        pieces, moments = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
        for column in self.cells.T:
            order = np.argsort(column, kind="stable")
            low, high = (np.searchsorted(column[order], cells, side) for side in ("left", "right"))
            counts = high - low
            within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
            pieces.append(order[np.repeat(low, counts) + within])
            moments.append(np.repeat(times, counts))
        return looks_in_order(np.concatenate(pieces), np.concatenate(moments))

    def expected_time(self, looks: Looks, detection: float, period: float) -> float:
        """Return the expected time until the target is found if robots repeat the search each
        ``period`` until then, provided that the target is in a piece at which they look; infinity
        if nothing is found.

        After k looks at the times t_0 to t_(k-1) with the probability d of detection, the time is

            (d sum_j (1 - d)^j t_j + (1 - d)^k period) / (1 - (1 - d)^k)

        because after a search in vain, the same begins anew.
        """
        if not (detection > 0 and len(looks.pieces)):
            return inf
        counts = np.bincount(looks.pieces, minlength=len(self.masses))
        seen, missed = counts > 0, (1.0 - detection) ** counts
        chances = detection * (1.0 - detection) ** looks.earlier
        found = np.bincount(looks.pieces, chances * looks.times, minlength=len(counts))
        each = (found + missed * period)[seen] / (1.0 - missed[seen])
        total = float(self.masses[seen].sum())
        return float(self.masses[seen] @ each) / total if total > 0 else inf


@dataclass(frozen=True, eq=False)
class Drift:
    """Particles that move with a velocity of their own.

    Parameters
    ----------
    points : ndarray of float64, shape (M, 2)
        Positions at the start of the search, in metres.
    velocities : ndarray of float64, shape (M, 2)
        Velocities in metres per second.
    """

    points: Points
    velocities: Points

    def at(self, times: Floats) -> Floats:
        """Return the positions at k times in seconds; float64, shape (k, M, 2)."""
        return self.points + times[:, None, None] * self.velocities


@dataclass(frozen=True, eq=False)
class Tracks:
    """Particles whose positions are known at some times, and move straight in between.

    Parameters
    ----------
    times : ndarray of float64, shape (T,)
        Increasing times in seconds since the start of the search. Before the first and after the
        last, particles stand still.
    points : ndarray of float64, shape (M, T, 2)
        Positions in metres.
    """

    times: Floats
    points: Floats

    def at(self, times: Floats) -> Floats:
        """Return the positions at k times in seconds; float64, shape (k, M, 2)."""
        if len(self.times) == 1:
            return np.repeat(self.points.transpose(1, 0, 2), len(times), axis=0)
        piece = np.clip(np.searchsorted(self.times, times, "right") - 1, 0, len(self.times) - 2)
        span = self.times[piece + 1] - self.times[piece]
        share = np.clip((times - self.times[piece]) / span, 0.0, 1.0)[:, None, None]
        rows = self.points.transpose(1, 0, 2)
        return np.asarray(rows[piece] * (1.0 - share) + rows[piece + 1] * share)


@dataclass(frozen=True, eq=False)
class MovingGround:
    """Where a moving target may be: particles, each as likely as its mass.

    Parameters
    ----------
    masses : ndarray of float64, shape (M,)
        Probability of each particle. Together, they are 1.
    motion : Drift or Tracks
    grid : CellGrid or LayeredGrid
    tour : Tour
    """

    masses: Floats
    motion: Drift | Tracks
    grid: Grid
    tour: Tour

    def along(self, grid: Grid, tour: Tour) -> MovingGround:
        """Return the same particles over other cells."""
        return MovingGround(self.masses, self.motion, grid, tour)

    def cells_at(self, time: float) -> Numbers:
        """Return the tour index of the cell of the first layer in which each particle is at a time
        in seconds, or -1; int64, shape (M,).
        """
        (found,) = self._numbers(np.array([time]))
        position = self.tour.position if self.tour.position.ndim == 2 else self.tour.position[0]
        flat = position.ravel()
        size = layers_of(self.grid)[0].mask.size
        columns = layers_of(self.grid)[0].shape[1]
        rows, cols = np.divmod(np.where(found >= 0, found, 0), columns)
        assert size
        return np.where(found >= 0, flat[rows * position.shape[1] + cols], -1)

    def _numbers(self, times: Floats, layer: int = 0) -> Numbers:
        """Return the number of the square of a layer in which each particle is at k times, row by
        row, or -1 beside the lattice; int64, shape (k, M).
        """
        grid = layers_of(self.grid)[layer]
        places = self.motion.at(times)
        rows, columns = grid.lattice.cells_at(grid.lattice.from_region(places.reshape(-1, 2)))
        height, width = grid.shape
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        return np.where(inside, rows * width + columns, -1).reshape(len(times), -1)

    def looks(self, cells: Numbers, times: Floats) -> Looks:
        """Return the looks that meet each particle, in the order of their times, if robots search
        cells at given times in seconds; both of shape (k,).
        """
        layers = layers_of(self.grid)
        own = self.tour.cells[cells]
        up = own[:, 0] if own.shape[1] == 3 else np.zeros(len(own), dtype=np.int64)
        pieces, moments = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
        strip = max(1, _AT_ONCE // max(len(self.masses), 1))
        for layer, grid in enumerate(layers):
            numbers = own[:, -2] * grid.shape[1] + own[:, -1]
            these = np.flatnonzero(up == layer)
            for low in range(0, len(these), strip):
                part = these[low : low + strip]
                met, particle = np.nonzero(
                    self._numbers(times[part], layer) == numbers[part, None]
                )
                pieces.append(particle)
                moments.append(times[part][met])
        return looks_in_order(np.concatenate(pieces), np.concatenate(moments))

    def shares(self, looks: Looks, cells: Numbers) -> Floats:
        raise NotImplementedError

    def expected_time(self, looks: Looks, detection: float, period: float) -> float:
        first = detection * (1.0 - detection) ** looks.earlier * self.masses[looks.pieces]
        return float(first @ looks.times + (1.0 - first.sum()) * period)
