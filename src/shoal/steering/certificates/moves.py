"""Least numbers of moves: proofs that no plan in a convex polygon has fewer."""

from __future__ import annotations

from collections.abc import Callable
from math import frexp
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import import_extra
from shoal.steering.certificates.programs import Variables, equality, solver_settings
from shoal.steering.certificates.relaxation import STEP

FREE, UNKNOWN = -1, -2  # of a particle in a move; otherwise the wall that stops it
QUADRANTS = ((1, 0), (0, 1), (-1, 0), (0, -1))
_NARROW = 4096  # length of the directions between which no sector is divided again
MOST_MOVES = 100  # of a proof
_CLEAR = 1e-8  # least violation of constraints that counts

Direction = tuple[int, int]


class Move(NamedTuple):
    """What is known of a move: the wall that stops each particle, and two directions, at most a
    quarter of a turn apart, between which the move is.
    """

    walls: tuple[int, int] = (UNKNOWN, UNKNOWN)
    sector: tuple[Direction, Direction] | None = None


class MovePrograms:
    """The linear programs of all plans with a number of moves.

    Parameters
    ----------
    corners : ndarray of float64, shape (n, 2)
        Corners of a convex polygon, counter-clockwise.
    start, goal : ndarray of float64, shape (2, 2)
    tolerance : float
        Largest error of each coordinate at the end.

    Raises
    ------
    MissingExtraError
        If Clarabel is not installed.
    """

    def __init__(
        self,
        corners: NDArray[np.float64],
        start: NDArray[np.float64],
        goal: NDArray[np.float64],
        tolerance: float,
    ) -> None:
        self._clarabel = import_extra("clarabel", "certificates need Clarabel", extra="certify")
        origin = corners[0]
        self.scale = 2.0 ** frexp(float(np.ptp(corners, axis=0).max()))[1]
        self._corners = (corners - origin) / self.scale
        along = np.roll(self._corners, -1, axis=0) - self._corners
        self._normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
        self._offsets = np.sum(self._normals * self._corners, axis=1)
        self._start, self._goal = (start - origin) / self.scale, (goal - origin) / self.scale
        self._tolerance = tolerance / self.scale
        self._extent = np.ptp(self._corners, axis=0)
        self._settings = solver_settings(self._clarabel)

    def contradiction(self, moves: tuple[Move, ...]) -> NDArray[np.float64] | None:
        """Return multipliers of the constraints that no plan with such moves can meet, or None if
        there are none.
        """
        from scipy.sparse import csc_matrix

        rows, low, high = self._program(moves)
        count = len(low)
        # the variables, and the largest violation of a constraint, which is least
        system = np.zeros((len(rows) + 2 * count, count + 2))
        system[: len(rows), :count], system[: len(rows), -2] = rows[:, :-1], 1.0
        system[: len(rows), -1] = rows[:, -1]
        box = system[len(rows) :]
        box[:count, :count], box[:count, -1] = np.eye(count), -low
        box[count:, :count], box[count:, -1] = -np.eye(count), high
        solution = self._clarabel.DefaultSolver(
            csc_matrix((count + 1, count + 1)),
            np.append(np.zeros(count), 1.0),
            csc_matrix(-system[:, :-1]),
            system[:, -1],
            [self._clarabel.NonnegativeConeT(len(system))],
            self._settings,
        ).solve()
        slacks = np.maximum(np.array(solution.z)[: len(rows)], 0.0)
        slacks = np.round(slacks / STEP) * STEP
        if not np.isfinite(slacks).all():
            return None
        total = -(slacks @ rows)
        value = total[-1] + np.minimum(total[:-1] * low, total[:-1] * high).sum()
        return slacks if value > _CLEAR else None

    def _program(
        self, moves: tuple[Move, ...]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        variables = Variables(
            4 + sum(2 + 2 * sum(wall != FREE for wall in move.walls) for move in moves), 2
        )
        vector = variables.vector
        goals = [vector(spot - self._tolerance, spot + self._tolerance) for spot in self._goal]
        places = [variables.constant(spot) for spot in self._start]
        rows = []
        for move in moves:
            displacement = vector(-self._extent, self._extent)
            directed = [displacement]
            for particle, wall in enumerate(move.walls):
                translation = displacement
                if wall != FREE:
                    loss = vector(-self._extent, self._extent)
                    translation = displacement - loss
                    directed += [loss, translation]
                places[particle] = places[particle] + translation
                inside = self._normals @ places[particle]
                inside[:, -1] -= self._offsets
                rows.append(inside)
                if wall >= 0:
                    normal = self._normals[wall : wall + 1]
                    rows += [-inside[wall : wall + 1], -(normal @ loss), -(normal @ translation)]
            if move.sector is not None:
                (a, b), (c, d) = move.sector
                for along in directed:
                    rows += [
                        (a * along[1] - b * along[0])[None],
                        (d * along[0] - c * along[1])[None],
                    ]
        rows += equality(places, goals)
        return np.concatenate(rows), variables.low, variables.high


def prove_more_moves(
    programs: MovePrograms, count: int, walls: int, late: Callable[[], bool]
) -> list[dict[str, Any]] | None:
    """Return a proof, as JSON, that no plan has ``count`` moves or fewer; None if the search is
    late, or finds moves that it cannot exclude.

    The nodes of the proof come before their parts. The walls of the last move are divided first,
    because a particle that is stopped there must have its goal at this wall.
    """
    nodes: list[dict[str, Any]] = []
    stack = [(Move(),) * count]
    while stack:
        if late():
            return None
        moves = stack.pop()
        slacks = programs.contradiction(moves)
        if slacks is not None:
            nodes.append({"slacks": [[int(k), float(slacks[k])] for k in np.flatnonzero(slacks)]})
            continue
        unknown = [(k, p) for k in range(count) for p in (0, 1) if moves[k].walls[p] == UNKNOWN]
        if unknown:
            number, particle = unknown[-1]
            nodes.append({"move": number, "particle": particle})
            move = moves[number]
            cases = []
            for wall in range(FREE, walls):
                stops = list(move.walls)
                stops[particle] = wall
                cases.append(move._replace(walls=(stops[0], stops[1])))
        else:
            holding = [k for k in range(count) if moves[k].walls != (FREE, FREE)]
            number = max(holding, key=lambda k: -_length(moves[k]), default=-1)
            if number < 0 or _length(moves[number]) > _NARROW:
                return None
            nodes.append({"move": number})
            cases = [moves[number]._replace(sector=half) for half in _halves(moves[number].sector)]
        stack += [(*moves[:number], case, *moves[number + 1 :]) for case in cases[::-1]]
    return nodes


def _halves(
    sector: tuple[Direction, Direction] | None,
) -> list[tuple[Direction, Direction]]:
    """Return the quadrants, or the halves of a sector."""
    if sector is None:
        return list(zip(QUADRANTS, (*QUADRANTS[1:], QUADRANTS[0]), strict=True))
    (a, b), (c, d) = sector
    middle = a + c, b + d
    return [(sector[0], middle), (middle, sector[1])]


def _length(move: Move) -> float:
    """Return the length of the directions of a sector, which grows as the sector becomes narrow."""
    return (
        0.0 if move.sector is None else max(max(map(abs, direction)) for direction in move.sector)
    )
