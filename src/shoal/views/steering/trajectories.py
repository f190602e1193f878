"""What happens within each move of a steering episode, and when a film shows it."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.steering import ConvexWorkspace, Region, SteeringEpisode
from shoal.steering.delta_space.two_moves import two_move_pieces
from shoal.steering.simulation.apparatus import executed_moves
from shoal.steering.workspaces.convex_geometry import Points

FINE = 1e-4  # of the size: straight pieces stay so near to the way
_LEAST = 2.0**-30  # shortest part of a move that is looked at
_TOUCH = 1e-6  # of the size: who is nearer to a wall than this is shown on it
_PUSHED = 1e-9  # of the length of a move
_SPEED = 0.62  # sizes a second
_REST, _FIRST_REST, _LAST_REST = 0.35, 0.7, 2.0  # seconds after each move, before the first, after the last
_QUICKEST = 0.25  # seconds for a short move
_LONGEST = 36.0  # seconds: episodes of many moves are shown faster


@dataclass(frozen=True, eq=False)
class MoveTrajectory:
    """One move: the way of each particle in straight pieces, and what holds it.

    Parameters
    ----------
    sent : ndarray of float64, shape (d,)
        The move that was sent.
    shares : ndarray of float64, shape (keys,)
        From 0 to 1.
    points : ndarray of float64, shape (keys, n, d)
        Where the particles are when that share of the move is done.
    held : tuple of tuple of (int, int)
        For each piece the pairs (particle, wall) where a wall holds a particle or has it slide. Walls are numbered as in
        the workspace.
    """

    sent: Points
    shares: NDArray[np.float64]
    points: Points
    held: tuple[tuple[tuple[int, int], ...], ...]

    @property
    def length(self) -> float:
        """Of the move that was sent."""
        return float(np.linalg.norm(self.sent))

    def at(self, share: float) -> Points:
        """Return where the particles are when a share of the move is done; float64, shape (n, d)."""
        piece = self._piece(share)
        first, last = self.shares[piece], self.shares[piece + 1]
        part = min(max((share - first) / (last - first), 0.0), 1.0)
        return np.asarray(self.points[piece] + part * (self.points[piece + 1] - self.points[piece]))

    def until(self, share: float) -> Points:
        """Return the way up to a share of the move; float64, shape (keys, n, d)."""
        return np.concatenate([self.points[: self._piece(share) + 1], self.at(share)[None]])

    def holders(self, share: float) -> tuple[tuple[int, int], ...]:
        """Return the pairs (particle, wall) where a wall holds when a share of the move is done."""
        return self.held[self._piece(share)]

    def _piece(self, share: float) -> int:
        return min(max(bisect_right(self.shares, share) - 1, 0), len(self.shares) - 2)


def trajectories_of(episode: SteeringEpisode) -> list[MoveTrajectory]:
    """Return what happens within each move, from the world of the episode and the noise that its seed draws.

    Examples
    --------
    >>> from shoal.steering import SteeringProblem
    >>> from shoal.steering.run import run
    >>> plan = run(SteeringProblem("square", [(0.2, 0.5), (0.4, 0.5)], [(0.3, 0.5), (0.4, 0.5)]))
    >>> trajectory = trajectories_of(plan)[0]
    >>> bool((trajectory.at(1) == plan.states[1]).all())
    True
    """
    problem, workspace = episode.problem, episode.problem.place
    world = problem.world(seed=episode.seed)
    executed = executed_moves(problem, episode.inputs, seed=episode.seed)
    trajectories = []
    for sent, moved, (before, after) in zip(episode.inputs, executed, pairwise(episode.states), strict=True):

        def at(share: float, before: Points = before, after: Points = after, moved: Points = moved) -> Points:
            return after if share == 1 else np.asarray(world.step(before, share * moved))

        shares, points = _in_pieces(at, before, FINE * workspace.size)
        touches = [_touching(workspace, state, moved, problem.particle_radius) for state in points]
        held = tuple(tuple(sorted(one & other)) for one, other in pairwise(touches))
        trajectories.append(MoveTrajectory(sent, shares, points, held))
    return trajectories


def _in_pieces(at: Callable[[float], Points], start: Points, fine: float) -> tuple[NDArray[np.float64], Points]:
    """Return shares and the points there, so many that straight pieces between them stay within ``fine`` of the way."""
    known = {0.0: start} | {share: at(share) for share in np.linspace(0, 1, 9)[1:].tolist()}
    open_ = list(pairwise(sorted(known)))
    while open_:
        first, last = open_.pop()
        middle = (first + last) / 2
        point = at(middle)
        if np.abs(point - (known[first] + known[last]) / 2).max() > fine and last - first > _LEAST:
            known[middle] = point
            open_ += [(first, middle), (middle, last)]
    shares = sorted(known)
    kept, dropped = [shares[0]], [shares[1]]
    for here, following in pairwise(shares[1:]):
        chord = (known[following] - known[kept[-1]]) / (following - kept[-1])
        if any(np.abs(known[kept[-1]] + (one - kept[-1]) * chord - known[one]).max() > fine / 50 for one in dropped):
            kept.append(here)
            dropped = []
        dropped.append(following)
    kept.append(shares[-1])
    return np.array(kept), np.array([known[share] for share in kept])


def _touching(workspace: ConvexWorkspace | Region, points: Points, move: Points, radius: float) -> set[tuple[int, int]]:
    """Return the pairs (particle, wall) where a particle is on a wall and the move does not lead away from it."""
    reach, least = radius + _TOUCH * workspace.size, _PUSHED * float(np.linalg.norm(move))
    if isinstance(workspace, Region):
        ends = workspace.edges.reshape(-1, 2, 2)
        along = ends[:, 1] - ends[:, 0]
        normals = np.stack([-along[:, 1], along[:, 0]], axis=1)
        part = np.sum((points[:, None] - ends[:, 0]) * along, axis=-1) / np.sum(along * along, axis=-1)
        nearest = ends[:, 0] + np.clip(part, 0, 1)[..., None] * along
        away = np.linalg.norm(points[:, None] - nearest, axis=-1)
        pushes = normals @ move <= least * np.linalg.norm(normals, axis=1)
        return {(int(p), int(w)) for p, w in np.argwhere((away <= reach) & pushes)}
    pushes = workspace.normals @ move <= least
    found = {(int(p), int(w)) for p, w in np.argwhere((workspace.wall_distances(points) <= reach) & pushes)}
    outward = points[:, :2] - workspace.center
    round_ = (workspace.circle_distance(points) <= reach) & (outward @ move[:2] >= -least * np.linalg.norm(outward, axis=1))
    return found | {(int(p), len(workspace.normals)) for p in np.flatnonzero(round_)}


@dataclass(frozen=True)
class FilmMoment:
    """A moment of a film: in which move, from 0, and what share of it is done."""

    move: int
    share: float


class FilmSchedule:
    """When a film shows what: each move takes as long as it is long, with a rest after it and a longer one at the end.

    Parameters
    ----------
    trajectories : list of MoveTrajectory
    size : float
        Of the workspace.

    Examples
    --------
    >>> trajectory = MoveTrajectory(np.array([0.62, 0.0]), np.array([0.0, 1.0]), np.zeros((2, 2, 2)), ((),))
    >>> schedule = FilmSchedule([trajectory, trajectory], size=1.0)
    >>> schedule.seconds, schedule.at(1.2), schedule.at(schedule.seconds)
    (5.05, FilmMoment(move=0, share=0.5), FilmMoment(move=1, share=1.0))
    """

    def __init__(self, trajectories: list[MoveTrajectory], *, size: float) -> None:
        lengths = [max(trajectory.length / size / _SPEED, _QUICKEST) for trajectory in trajectories]
        pace = min(1.0, _LONGEST / max(sum(lengths) + _REST * len(lengths), 1e-9))
        self.lasting = [pace * length for length in lengths]
        rests = [pace * _REST] * max(len(trajectories) - 1, 0) + [_LAST_REST]
        self.starts = list(
            accumulate((a + b for a, b in zip(self.lasting, rests, strict=False)), initial=_FIRST_REST)
        )  # the last is the film's end
        self.seconds = self.starts[-1] if trajectories else _FIRST_REST + _LAST_REST

    def at(self, seconds: float) -> FilmMoment:
        """Return what is shown then; moves begin and end gently."""
        if not self.lasting:
            return FilmMoment(0, 0.0)
        move = min(max(bisect_right(self.starts, seconds) - 1, 0), len(self.lasting) - 1)
        part = min(max((seconds - self.starts[move]) / self.lasting[move], 0.0), 1.0)
        return FilmMoment(move, part * part * (3 - 2 * part))

    def moments(self, rate: float, at_most: int) -> tuple[list[FilmMoment], float]:
        """Return what the frames of a film show, and how many there are in a second: ``rate``, or less for long films."""
        count = max(2, min(round(self.seconds * rate), at_most))
        return [self.at(self.seconds * k / (count - 1)) for k in range(count)], count / self.seconds


def room_of(episode: SteeringEpisode) -> Any:
    """Return where the centres of the particles can be."""
    return episode.problem.world(seed=episode.seed).room


def has_delta(episode: SteeringEpisode) -> bool:
    """Tell whether there is a Δ configuration space to draw: two particles in a convex workspace in the plane."""
    workspace = episode.problem.place
    return isinstance(workspace, ConvexWorkspace) and workspace.dimensions == 2 and episode.problem.n_particles == 2


def delta_outline(episode: SteeringEpisode) -> ConvexWorkspace:
    """Return the Δ configuration space of an episode."""
    space: ConvexWorkspace = room_of(episode).differences
    return space


def two_move_rings(episode: SteeringEpisode) -> list[list[Points]]:
    """Return for Δ at the start of each move what two moves make of it: outlines and holes, to be filled even-odd.

    Nothing where walls do not hold without slipping: the set is that of the ideal world.
    """
    from shapely import Polygon, union_all

    if episode.problem.friction < np.inf:
        return [[] for _ in episode.inputs]
    room = room_of(episode)
    rings: list[list[Points]] = []
    states = episode.states[:-1] if episode.moves else episode.states[:1]
    for before, state in pairwise([None, *states]):
        assert state is not None
        if before is not None and np.abs((state[1] - state[0]) - (before[1] - before[0])).max() < FINE * room.size / 10:
            rings.append(rings[-1])
            continue
        pieces = [Polygon(piece) for piece in two_move_pieces(room, state[1] - state[0]) if len(piece) > 2]
        whole = union_all([piece.buffer(0) for piece in pieces if piece.area > 0]).simplify(room.size / 1000)
        parts = [part for part in getattr(whole, "geoms", [whole]) if part.geom_type == "Polygon" and not part.is_empty]
        rings.append([np.asarray(ring.coords)[:-1] for part in parts for ring in (part.exterior, *part.interiors)])
    return rings
