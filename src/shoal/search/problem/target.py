"""Where a target may be, and what looks of robots at the ground find."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.search.cells.grid import CellGrid
from shoal.search.cells.lanes import LineLattice
from shoal.search.cells.layers import Grid, layers_of
from shoal.search.regions.outline import Points
from shoal.search.tours import Tour

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

_AT_ONCE = 40_000  # positions of particles
_FEW = 1_000  # particles, of which none is left out


@dataclass(frozen=True, eq=False)
class Looks:
    """Looks that may find a target.

    Parameters
    ----------
    pieces : ndarray of int64, shape (k,)
        Increasing numbers of pieces of the ground, or of particles.
    cells : ndarray of int64, shape (k,)
        Tour index of the cell that a robot searches.
    times : ndarray of float64, shape (k,)
        The times of the looks, which increase for each piece.
    earlier : ndarray of int64, shape (k,)
        Number of earlier looks at the same piece.
    """

    pieces: Numbers
    cells: Numbers
    times: Floats
    earlier: Numbers

    def chances(self, detection: float) -> Floats:
        """Return, for a target in the piece of each look, the probability that this look finds it:
        d (1 - d)^j after j others in vain, with the probability d of detection; float64, shape (k,).
        """
        return np.asarray(detection * (1.0 - detection) ** self.earlier)


def _sort_looks(pieces: Numbers, cells: Numbers, times: Floats) -> Looks:
    """Return looks sorted by piece and time."""
    order = np.lexsort((times, pieces))
    pieces = pieces[order]
    earlier = np.arange(len(pieces)) - np.searchsorted(pieces, pieces)
    return Looks(pieces, cells[order], times[order], earlier)


def looks_from(
    ground: Ground | MovingGround,
    cells_of_stops: Sequence[Sequence[Numbers]],
    times: Sequence[Floats],
) -> Looks:
    """Return the looks of robots at the ground.

    Parameters
    ----------
    ground : Ground or MovingGround
    cells_of_stops : sequence of sequence of ndarray of int64
        For each stop of each robot, the cells that it searches, as tour indices.
    times : sequence of ndarray of float64
        For each robot, when it is at each of its stops, in seconds.
    """
    cells = [np.zeros(0, dtype=np.int64)] + [
        stop_cells for own in cells_of_stops for stop_cells in own
    ]
    moments = [np.zeros(0)] + [
        np.repeat(own, [len(stop_cells) for stop_cells in stops])
        for own, stops in zip(times, cells_of_stops, strict=True)
    ]
    return ground.looks(np.concatenate(cells), np.concatenate(moments))


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
    cells: Numbers

    def along(self, before: Tour, grid: Grid, tour: Tour, again: Numbers) -> Ground:
        """Return the same ground along another tour, through the layers of the tour ``before`` and
        then through layers with some of their cells.

        Parameters
        ----------
        before : Tour
        grid, tour
            The grid and the tour with further layers.
        again : ndarray of int64, shape (G,)
            Index on the tour ``before`` of the cell that further looks at each piece search.
        """
        layers, columns = layers_of(grid), []
        for up, layer in enumerate(layers):
            if layer.whole is None:
                numbers, base = self.cells[:, up], up
            else:
                numbers, base = again, layers.index(layer.whole)
            cells = before.cells[numbers]
            present = numbers >= 0
            if cells.shape[1] == 3:
                present &= cells[:, 0] == base
            columns.append(np.where(present, tour.position[(up, *cells[:, -2:].T)], -1))
        return Ground(self.masses, np.stack(columns, axis=1))

    def shares(self, n: int, detection: float) -> Floats:
        """Return the probability that the search of each of n cells is the one that finds the
        target, if each piece is searched in the order of its cells, again and again; float64,
        shape (n,).

        Of k looks with the probability d of detection, the look after j others finds the target
        with the probability d (1 - d)^j / (1 - (1 - d)^k).
        """
        present = self.cells >= 0
        earlier: Numbers = np.cumsum(present, axis=1) - present.astype(np.int64)
        shares = present * (1.0 - detection) ** earlier
        shares *= (self.masses / np.maximum(shares.sum(axis=1), 1e-300))[:, None]
        return np.bincount(self.cells[present], shares[present], minlength=n).astype(np.float64)

    def looks(self, cells: Numbers, times: Floats) -> Looks:
        """Return the looks at each piece, in the order of their times, if robots search cells at
        given times; both of shape (k,).
        """
        pieces, numbers = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        for column in self.cells.T:
            order = np.argsort(column, kind="stable")
            low, high = (np.searchsorted(column[order], cells, side) for side in ("left", "right"))
            counts = high - low
            within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
            pieces.append(order[np.repeat(low, counts) + within])
            numbers.append(np.repeat(np.arange(len(cells)), counts))
        look = np.concatenate(numbers)
        return _sort_looks(np.concatenate(pieces), cells[look], times[look])

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
        covered, missed = counts > 0, (1.0 - detection) ** counts
        chances = looks.chances(detection)
        sums = np.bincount(looks.pieces, chances * looks.times, minlength=len(counts))
        with np.errstate(divide="ignore", over="ignore"):  # of a sure detection, or next to none
            # 1 - (1 - d)^k, of which subtraction leaves nothing if d is tiny
            success = -np.expm1(counts[covered] * np.log1p(-detection))
            each = (sums + missed * period)[covered] / success
            total = float(self.masses[covered].sum())
            return float(self.masses[covered] @ each) / total if total > 0 else inf


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

    def thinned(self, step: int) -> Drift:
        """Return every ``step``-th particle."""
        return Drift(self.points[::step], self.velocities[::step])

    def at(self, times: Floats) -> Floats:
        """Return the positions at k times in seconds; float64, shape (k, M, 2)."""
        return np.asarray(self.points + times[:, None, None] * self.velocities)


@dataclass(frozen=True, eq=False)
class Tracks:
    """Particles whose positions are known at some times, and that move straight in between.

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

    def thinned(self, step: int) -> Tracks:
        """Return every ``step``-th particle."""
        return Tracks(self.times, self.points[::step])

    def at(self, times: Floats) -> Floats:
        """Return the positions at k times in seconds; float64, shape (k, M, 2)."""
        rows = self.points.transpose(1, 0, 2)
        if len(self.times) == 1:
            return np.repeat(rows, len(times), axis=0)
        segment = np.clip(np.searchsorted(self.times, times, "right") - 1, 0, len(self.times) - 2)
        span = self.times[segment + 1] - self.times[segment]
        share = np.clip((times - self.times[segment]) / span, 0.0, 1.0)[:, None, None]
        return np.asarray(rows[segment] * (1.0 - share) + rows[segment + 1] * share)


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

    def thinned(self, step: int) -> MovingGround:
        """Return the ground with every ``step``-th particle, or with all if they are few."""
        if len(self.masses) < step * _FEW:
            return self
        masses = self.masses[::step]
        return MovingGround(masses / masses.sum(), self.motion.thinned(step), self.grid, self.tour)

    def still(self, time: float) -> Ground:
        """Return the ground on which the particles would stand if they stopped at a time in
        seconds. Particles beside all cells have no cell.
        """
        position = self.tour.position if self.tour.position.ndim == 3 else self.tour.position[None]
        cells = []
        for up, layer in enumerate(layers_of(self.grid)):
            number = self._squares(np.array([time]), layer)[0]
            rows, columns = np.divmod(np.maximum(number, 0), layer.shape[1])
            cells.append(np.where(number >= 0, position[up, rows, columns], -1))
        return Ground(self.masses, np.stack(cells, axis=1))

    def outside(self, time: float) -> float:
        """Return the probability that the target is outside the region's area at a time in
        seconds.
        """
        import shapely

        area = layers_of(self.grid)[0].region.area
        shapely.prepare(area)
        places = self.motion.at(np.array([time]))[0]
        return float(self.masses @ ~shapely.contains_xy(area, *places.T))

    def looks(self, cells: Numbers, times: Floats) -> Looks:
        """Return the looks that meet each particle, in the order of their times, if robots search
        cells at given times in seconds; both of shape (k,).
        """
        own = self.tour.cells[cells]
        up = own[:, 0] if own.shape[1] == 3 else np.zeros(len(own), dtype=np.int64)
        particles, numbers = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
        strip = max(1, _AT_ONCE // len(self.masses))
        for layer, grid in enumerate(layers_of(self.grid)):
            squares = own[:, -2] * grid.shape[1] + own[:, -1]
            these = np.flatnonzero(up == layer)
            for low in range(0, len(these), strip):
                part = these[low : low + strip]
                met, particle = np.nonzero(self._squares(times[part], grid) == squares[part, None])
                particles.append(particle)
                numbers.append(part[met])
        look = np.concatenate(numbers)
        return _sort_looks(np.concatenate(particles), cells[look], times[look])

    def _squares(self, times: Floats, grid: CellGrid) -> Numbers:
        """Return the number of the square of a lattice in which each particle is at k times, row by
        row, or -1 beside the lattice; int64, shape (k, M).
        """
        places = self.motion.at(times).reshape(-1, 2)
        rows, columns = grid.lattice.cells_at(grid.lattice.from_region(places))
        height, width = grid.shape
        inside = (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)
        if isinstance(grid.lattice, LineLattice):  # which knows the nearest cell of any point
            import shapely

            shapely.prepare(grid.region.area)
            inside &= shapely.contains_xy(grid.region.area, *places.T)
        return np.where(inside, rows * width + columns, -1).reshape(len(times), -1)

    def expected_time(self, looks: Looks, detection: float, horizon: float) -> float:
        """Return the mean of the time until the target is found and, if it is not found before, of
        the ``horizon``.

        A search is not repeated until it finds a moving target: the target may have left.
        """
        probabilities = looks.chances(detection) * self.masses[looks.pieces]
        times = np.minimum(looks.times, horizon)
        return float(probabilities @ times + max(1.0 - probabilities.sum(), 0.0) * horizon)
