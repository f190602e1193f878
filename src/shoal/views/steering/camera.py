"""A virtual camera for drawings of three-dimensional workspaces."""

from __future__ import annotations

from math import cos, sin
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from shoal.core.dataclass import dataclass
from shoal.steering import ConvexWorkspace

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
        return np.array([cos(self.elevation) * cos(self.azimuth), cos(self.elevation) * sin(self.azimuth), sin(self.elevation)])

    @property
    def eye(self) -> NDArray[np.float64]:
        """Position of the camera, in coordinates of the workspace."""
        return np.asarray(self.center + FAR * self.reach * self.toward)

    def project(self, points: ArrayLike) -> NDArray[np.float64]:
        """Return the picture coordinates x (right) and y (up) of each point, and its magnification; shape (..., 3).

        The magnification is 1 at the centre of the scene, and larger for points nearer to the camera.
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
        Whether the corners approximate a circle. For a circle, drawings omit the vertical edges between the sides.
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
            base = workspace.center + workspace.radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        else:
            base = workspace.vertices
        low, high = (np.column_stack([base, np.full(len(base), level)]) for level in (0.0, workspace.height))
        return cls(low, high, workspace.round, workspace.open_ends)

    def facing(self, eye: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which sides of the workspace show their outer face to a camera at ``eye``; bool, shape (n,)."""
        along = np.roll(self.floor, -1, axis=0) - self.floor
        outward = np.stack([along[:, 1], -along[:, 0]], axis=1)
        return np.asarray(np.sum(outward * (eye - self.floor)[:, :2], axis=1) > 0)

    def edges(self, eye: NDArray[np.float64]) -> tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]]:
        """Return the workspace's edges behind and in front of the particles, seen from ``eye``; each float64, shape (2, 3)."""
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
                (front if facing[k] or before else behind).append(np.stack([self.floor[k], self.ceiling[k]]))
        return behind, front


def camera_for(workspace: ConvexWorkspace, states: Any, *, azimuth: float) -> Camera:
    """Return a camera that sees the whole workspace and all particles at all positions in ``states``."""
    low, high = min(0.0, float(states[..., 2].min())), max(workspace.height, float(states[..., 2].max()))
    reach_flat = workspace.radius if workspace.round else float(np.hypot(*(workspace.vertices - workspace.center).T).max())
    center = np.array([*workspace.center, (low + high) / 2])
    return Camera(center, float(np.hypot(reach_flat, (high - low) / 2)), azimuth)


def picture_extent(workspace: ConvexWorkspace, states: Any) -> tuple[float, float, float]:
    """Return the largest extents of a workspace in a picture (to the right, upwards and downwards) over all directions of view."""
    frame = Frame3D.of(workspace)
    corners = np.concatenate([frame.floor, frame.ceiling, states.reshape(-1, 3)])
    turns = np.linspace(0, 2 * np.pi, 49)
    cameras = [camera_for(workspace, states, azimuth=turn) for turn in turns]
    seen = np.concatenate([camera.project(corners) for camera in cameras])
    return float(np.abs(seen[:, 0]).max()), float(seen[:, 1].max()), float(-seen[:, 1].min())


def flattened(points: ArrayLike) -> NDArray[np.float64]:
    """Return ``points`` after a vertical projection onto the floor z = 0; shape (..., 3)."""
    return np.asarray(np.asarray(points) * np.array([1.0, 1.0, 0.0]))
