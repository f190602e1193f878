"""The motion of the particles within each move of a steering episode, and the schedule
of a film.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from itertools import accumulate, pairwise
from math import cos, sin
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.core.geometry import left_of, unit_vectors
from shoal.steering import ConvexWorkspace, Region, SteeringEpisode
from shoal.steering.delta_space import two_move_pieces
from shoal.steering.simulation import executed_moves
from shoal.steering.workspaces.convex import Points
from shoal.views.drawing.canvas import rings_of

FINE = 1e-4  # relative to the size: deviation of straight segments from the path
_LEAST = 2.0**-30  # shortest fraction of a move that is evaluated
_TOUCH = 1e-6  # relative to the size: contact tolerance for drawing
_PUSHED = 1e-9  # relative to the length of a move
_SPEED = 0.62  # sizes per second
# seconds of pause after each move, before the first and after the last
_REST, _FIRST_REST, _LAST_REST = (0.35, 0.7, 1.0)
_QUICKEST = 0.25  # seconds for a short move
_LONGEST = 36.0  # seconds: longer episodes are shown faster


@dataclass(frozen=True, eq=False)
class MoveTrajectory:
    """The motion during one move: the path of each particle in straight segments, and the contacts
    of particles with walls.

    Parameters
    ----------
    sent : ndarray of float64, shape (d,)
        The move (displacement) that was sent to all particles.
    shares : ndarray of float64, shape (keys,)
        Increasing fractions of the move, from 0 to 1, at which the segments begin and end.
    points : ndarray of float64, shape (keys, n, d)
        Positions of the particles at the fractions in ``shares``.
    held : tuple of tuple of (int, int)
        For each segment, all pairs (particle, wall) in which the wall holds the particle or the
        particle slides along the wall. Walls have the same indices as in the workspace.
    """

    sent: Points
    shares: NDArray[np.float64]
    points: Points
    held: tuple[tuple[tuple[int, int], ...], ...]

    @property
    def length(self) -> float:
        """Length of the move, in the workspace's unit of length."""
        return float(np.linalg.norm(self.sent))

    def at(self, share: float) -> Points:
        """Return the positions of all particles after a given fraction of the move; float64, shape
        (n, d).
        """
        segment = self._piece(share)
        first, last = self.shares[segment], self.shares[segment + 1]
        fraction = min(max((share - first) / (last - first), 0.0), 1.0)
        return np.asarray(
            self.points[segment] + fraction * (self.points[segment + 1] - self.points[segment])
        )

    def until(self, share: float) -> Points:
        """Return the end points of all path segments up to a given fraction of the move; float64,
        shape (keys, n, d).
        """
        return np.concatenate([self.points[: self._piece(share) + 1], self.at(share)[None]])

    def holders(self, share: float) -> tuple[tuple[int, int], ...]:
        """Return all pairs (particle, wall) that are in contact after a given fraction
        of the move.
        """
        return self.held[self._piece(share)]

    def _piece(self, share: float) -> int:
        return min(max(bisect_right(self.shares, share) - 1, 0), len(self.shares) - 2)


def trajectories_of(episode: SteeringEpisode) -> list[MoveTrajectory]:
    """Return the motion within each move of an episode, simulated with the noise of the episode's
    seed.

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
    for sent, moved, (before, after) in zip(
        episode.inputs, executed, pairwise(episode.states), strict=True
    ):

        def at(
            share: float, before: Points = before, after: Points = after, moved: Points = moved
        ) -> Points:
            return after if share == 1 else np.asarray(world.step(before, share * moved))

        shares, points = _sample_move(at, before, FINE * workspace.size)
        touches = [_contacts(workspace, state, moved, problem.particle_radius) for state in points]
        held = tuple(tuple(sorted(begin & end)) for begin, end in pairwise(touches))
        trajectories.append(MoveTrajectory(sent, shares, points, held))
    return trajectories


def _sample_move(
    at: Callable[[float], Points], start: Points, fine: float
) -> tuple[NDArray[np.float64], Points]:
    """Return increasing fractions of a move, and the positions of the particles at these fractions.

    The fractions are so close together that straight segments between the positions deviate from
    the true path by at most ``fine``.
    """
    positions = {0.0: start} | {share: at(share) for share in np.linspace(0, 1, 9)[1:].tolist()}
    open_ = list(pairwise(sorted(positions)))
    while open_:
        first, last = open_.pop()
        middle = (first + last) / 2
        point = at(middle)
        if (
            np.abs(point - (positions[first] + positions[last]) / 2).max() > fine
            and last - first > _LEAST
        ):
            positions[middle] = point
            open_ += [(first, middle), (middle, last)]
    shares = sorted(positions)
    corners, between = [shares[0]], [shares[1]]
    for key, following in pairwise(shares[1:]):
        chord = (positions[following] - positions[corners[-1]]) / (following - corners[-1])
        if any(
            np.abs(positions[corners[-1]] + (inner - corners[-1]) * chord - positions[inner]).max()
            > fine / 50
            for inner in between
        ):
            corners.append(key)
            between = []
        between.append(following)
    corners.append(shares[-1])
    return np.array(corners), np.array([positions[share] for share in corners])


def _contacts(
    workspace: ConvexWorkspace | Region, points: Points, move: Points, radius: float
) -> set[tuple[int, int]]:
    """Return all pairs (particle, wall) in which the particle touches the wall and the move does
    not lead away from the wall.
    """
    reach, least = radius + _TOUCH * workspace.size, _PUSHED * float(np.linalg.norm(move))
    if isinstance(workspace, Region):
        ends = workspace.edges.reshape(-1, 2, 2)
        along = ends[:, 1] - ends[:, 0]
        normals = left_of(along)
        fraction = np.sum((points[:, None] - ends[:, 0]) * along, axis=-1) / np.sum(
            along * along, axis=-1
        )
        nearest = ends[:, 0] + np.clip(fraction, 0, 1)[..., None] * along
        away = np.linalg.norm(points[:, None] - nearest, axis=-1)
        pushes = normals @ move <= least * np.linalg.norm(normals, axis=1)
        return {(int(p), int(w)) for p, w in np.argwhere((away <= reach) & pushes)}
    pushes = workspace.normals @ move <= least
    touches = {
        (int(p), int(w))
        for p, w in np.argwhere((workspace.wall_distances(points) <= reach) & pushes)
    }
    outward = points[:, :2] - workspace.center
    round_ = (workspace.circle_distance(points) <= reach) & (
        outward @ move[:2] >= -least * np.linalg.norm(outward, axis=1)
    )
    return touches | {(int(p), len(workspace.normals)) for p in np.flatnonzero(round_)}


@dataclass(frozen=True)
class FilmMoment:
    """A moment of a film: the index of the present move, counted from 0, and its completed
    fraction.
    """

    move: int
    share: float


class FilmSchedule:
    """The schedule of a film of a steering episode: the start and the duration of each move.

    The duration of a move is proportional to its length, but short moves have a minimum duration. A
    pause follows each move, and a longer pause follows the last move.

    Parameters
    ----------
    trajectories : list of MoveTrajectory
    size : float
        Size of the workspace (its largest extent), in its unit of length.

    Examples
    --------
    >>> trajectory = MoveTrajectory(np.array([0.62, 0.0]), np.array([0.0, 1.0]), np.zeros((2, 2, 2)), ((),))
    >>> schedule = FilmSchedule([trajectory, trajectory], size=1.0)
    >>> schedule.seconds, schedule.at(1.2), schedule.at(schedule.seconds)
    (4.05, FilmMoment(move=0, share=0.5), FilmMoment(move=1, share=1.0))
    """

    def __init__(self, trajectories: list[MoveTrajectory], *, size: float) -> None:
        lengths = [max(trajectory.length / size / _SPEED, _QUICKEST) for trajectory in trajectories]
        pace = min(1.0, _LONGEST / max(sum(lengths) + _REST * len(lengths), 1e-9))
        self.lasting = [pace * length for length in lengths]
        rests = [pace * _REST] * max(len(trajectories) - 1, 0) + [_LAST_REST]
        # the last value is the end of the film
        self.starts = list(
            accumulate(
                (a + b for a, b in zip(self.lasting, rests, strict=False)), initial=_FIRST_REST
            )
        )
        self.seconds = self.starts[-1] if trajectories else _FIRST_REST + _LAST_REST

    def at(self, seconds: float) -> FilmMoment:
        """Return the moment of the film at a time in seconds. Moves begin and end smoothly."""
        if not self.lasting:
            return FilmMoment(0, 0.0)
        move = min(max(bisect_right(self.starts, seconds) - 1, 0), len(self.lasting) - 1)
        fraction = min(max((seconds - self.starts[move]) / self.lasting[move], 0.0), 1.0)
        return FilmMoment(move, fraction * fraction * (3 - 2 * fraction))

    def moments(self, rate: float, at_most: int) -> tuple[list[FilmMoment], float]:
        """Return the moments of a film's frames, and the frame rate. For a long film, the frame
        rate is lower than ``rate``.
        """
        count = max(2, min(round(self.seconds * rate), at_most))
        return [self.at(self.seconds * k / (count - 1)) for k in range(count)], count / self.seconds


def free_space_of(episode: SteeringEpisode) -> Any:
    """Return the set of possible positions of the particles' centres, as a workspace."""
    return episode.problem.world(seed=episode.seed).free_space


def has_delta(episode: SteeringEpisode) -> bool:
    """Return whether the Δ configuration space of an episode can be drawn.

    The drawing is possible for two particles in a convex plane workspace.
    """
    workspace = episode.problem.place
    return (
        isinstance(workspace, ConvexWorkspace)
        and workspace.dimensions == 2
        and episode.problem.n_particles == 2
    )


def delta_outline(episode: SteeringEpisode) -> ConvexWorkspace:
    """Return the Δ configuration space of an episode (all position differences of the two
    particles), as a workspace.
    """
    space: ConvexWorkspace = free_space_of(episode).differences
    return space


def two_move_rings(episode: SteeringEpisode) -> list[list[Points]]:
    """Return, for each move, the position differences that two moves can reach from the start of
    the move, as a list of rings.

    The rings are closed lines. A point belongs to the set if it lies inside an odd number of rings.
    If the friction is finite, particles slide along walls, and the list of rings is empty for each
    move.
    """
    from shapely import Polygon, union_all

    if episode.problem.friction < np.inf:
        return [[] for _ in episode.inputs]
    space = free_space_of(episode)
    rings: list[list[Points]] = []
    states = episode.states[:-1] if episode.moves else episode.states[:1]
    for before, state in pairwise([None, *states]):
        assert state is not None
        if (
            before is not None
            and np.abs((state[1] - state[0]) - (before[1] - before[0])).max()
            < FINE * space.size / 10
        ):
            rings.append(rings[-1])
            continue
        polygons = [
            Polygon(corners)
            for corners in two_move_pieces(space, state[1] - state[0])
            if len(corners) > 2
        ]
        union = union_all([corners.buffer(0) for corners in polygons if corners.area > 0]).simplify(
            space.size / 1000
        )
        rings.append([ring[:-1] for polygon in rings_of(union) for ring in polygon])
    return rings


FAR = 4.5  # distance of the camera, relative to the radius of the scene
CORNERS = 72  # number of corners that approximate a circle
ABOVE = 0.42  # elevation of the camera in radians


@dataclass(frozen=True, eq=False)
class Camera:
    """A virtual camera with a central projection, which points at ``center``.

    Parameters
    ----------
    center : ndarray of float64, shape (3,)
    reach : float
        Radius of the scene around ``center``, in the workspace's unit of length.
    azimuth, elevation : float
        Direction from ``center`` to the camera, in radians.

    Examples
    --------
    >>> camera = Camera(np.zeros(3), 1.0, azimuth=0.0, elevation=0.0)
    >>> camera.project([(0, 0.5, 0.25)]).tolist()
    [[0.5, 0.25, 1.0]]
    """

    center: NDArray[np.float64]
    reach: float
    azimuth: float
    elevation: float = ABOVE

    @property
    def toward(self) -> NDArray[np.float64]:
        """The unit vector that points from the centre of the scene to the camera."""
        return np.array(
            [
                cos(self.elevation) * cos(self.azimuth),
                cos(self.elevation) * sin(self.azimuth),
                sin(self.elevation),
            ]
        )

    @property
    def eye(self) -> NDArray[np.float64]:
        """Position of the camera, in coordinates of the workspace."""
        return np.asarray(self.center + FAR * self.reach * self.toward)

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the picture coordinates x (right) and y (up) of each point, and its magnification;
        shape (..., 3).

        The magnification is 1 at the centre of the scene, and larger for points nearer to the
        camera.
        """
        away = np.asarray(points, dtype=np.float64) - self.center
        right = np.array([-sin(self.azimuth), cos(self.azimuth), 0.0])
        toward = self.toward
        up = np.cross(toward, right)
        larger = FAR * self.reach / (FAR * self.reach - away @ toward)
        return np.stack([larger * (away @ right), larger * (away @ up), larger], axis=-1)


@dataclass(frozen=True, eq=False)
class Frame3D:
    """A prism or cylinder, described by its floor and its ceiling as polygons in 3-D, for drawing.

    Parameters
    ----------
    floor, ceiling : ndarray of float64, shape (n, 3)
        Corners of the floor, and corners of the ceiling.
    round : bool
        Whether the corners approximate a circle. For a circle, drawings omit the vertical edges
        between the sides.
    open_ends : bool
        Whether the ends are open, so that the floor and the ceiling are no walls.
    """

    floor: NDArray[np.float64]
    ceiling: NDArray[np.float64]
    round: bool
    open_ends: bool

    @classmethod
    def of(cls, workspace: ConvexWorkspace) -> Frame3D:
        """Return the floor and the ceiling of a three-dimensional workspace as a Frame3D."""
        if workspace.round:
            angles = 2 * np.pi * np.arange(CORNERS) / CORNERS
            base = workspace.center + workspace.radius * unit_vectors(angles)
        else:
            base = workspace.vertices
        low, high = (
            np.column_stack([base, np.full(len(base), level)]) for level in (0.0, workspace.height)
        )
        return cls(low, high, workspace.round, workspace.open_ends)

    def facing(self, eye: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which sides of the workspace show their outer face to a camera at ``eye``; bool,
        shape (n,).
        """
        along = np.roll(self.floor, -1, axis=0) - self.floor
        outward = np.stack([along[:, 1], -along[:, 0]], axis=1)
        return np.asarray(np.sum(outward * (eye - self.floor)[:, :2], axis=1) > 0)

    def edges(
        self, eye: NDArray[np.float64]
    ) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
        """Return the workspace's edges behind and in front of the particles, seen from ``eye``;
        each float64, shape (2, 3).
        """
        facing = self.facing(eye)
        above = bool(eye[2] > self.ceiling[0, 2]) and not self.open_ends
        behind: list[NDArray[np.float64]] = []
        front: list[NDArray[np.float64]] = []
        for k in range(len(self.floor)):
            following = (k + 1) % len(self.floor)
            upper = np.stack([self.ceiling[k], self.ceiling[following]])
            lower = np.stack([self.floor[k], self.floor[following]])
            (front if facing[k] or above else behind).append(upper)
            (front if facing[k] else behind).append(lower)
            before = facing[k - 1]
            silhouette = facing[k] != before
            if silhouette or not self.round:
                (front if facing[k] or before else behind).append(
                    np.stack([self.floor[k], self.ceiling[k]])
                )
        return behind, front


def camera_for(workspace: ConvexWorkspace, states: Any, *, azimuth: float) -> Camera:
    """Return a camera that sees the whole workspace and all particles at all positions in
    ``states``.
    """
    low = min(0.0, float(states[..., 2].min()))
    high = max(workspace.height, float(states[..., 2].max()))
    reach_flat = (
        workspace.radius
        if workspace.round
        else float(np.hypot(*(workspace.vertices - workspace.center).T).max())
    )
    center = np.array([*workspace.center, (low + high) / 2])
    return Camera(center, float(np.hypot(reach_flat, (high - low) / 2)), azimuth)


def picture_extent(workspace: ConvexWorkspace, states: Any) -> tuple[float, float, float]:
    """Return the largest extents of a workspace in a picture (to the right, upwards and downwards)
    over all directions of view.
    """
    frame = Frame3D.of(workspace)
    corners = np.concatenate([frame.floor, frame.ceiling, states.reshape(-1, 3)])
    turns = np.linspace(0, 2 * np.pi, 49)
    cameras = [camera_for(workspace, states, azimuth=turn) for turn in turns]
    projected = np.concatenate([camera.project(corners) for camera in cameras])
    return (
        float(np.abs(projected[:, 0]).max()),
        float(projected[:, 1].max()),
        float(-projected[:, 1].min()),
    )


def project_to_floor(points: ArrayLike) -> NDArray[np.float64]:
    """Return ``points`` after a vertical projection onto the floor z = 0; shape (..., 3)."""
    return np.asarray(np.asarray(points) * np.array([1.0, 1.0, 0.0]))
