"""A physical plant for steering: round particles in a continuous workspace with straight or round
walls, moved by one shared input with errors. The engine is pymunk (extra ``physics``).

The properties are those of `shoal.rigs.physics.PlantProperties`, whose unit of length, the cell, is
here a share of the size of the workspace.
"""

from __future__ import annotations

from math import ceil
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_points
from shoal.core.errors import InvalidInputError, MissingExtraError, RigError
from shoal.rigs.physics import BETWEEN, PlantProperties

Points = NDArray[np.float64]

CELL = 1 / 40  # of the size: the unit of length of the plant's properties
POINT = 0.004  # relative to the size: radius of particles that stand for points
STEP = 0.2  # of its radius that a particle may move between two looks for contacts
CORNERS = 256  # straight pieces of a round wall
IGNORED = (
    *("ghosts", "miss", "double", "blur"),
    *("attraction", "spin", "flow_x", "flow_y", "own_radius"),
)


class SteeringPlant:
    """A rig for steering: `send` moves all particles by one input, and `look` observes them.

    The errors of `PlantProperties` apply: the length of each input (``pulse_error``,
    ``magnitude``), its angle (``direction``, ``heading``), the gains of coils and of particles
    (``coil_gain``, ``own_gain``, ``weakest``, ``strongest``, ``convergence``), the friction and
    adhesion of walls, and the error of the camera.

    Parameters
    ----------
    workspace : ConvexWorkspace or Region
    points : array_like of float, shape (n, 2)
        Where the particles' centres begin.
    properties : PlantProperties
    rng : Generator
    radius : float
        Radius of the particles in the workspace's unit. Particles with the radius 0 are points: they
        do not push each other, and their centres reach the walls.

    Attributes
    ----------
    moves : int
        Number of inputs carried out.

    Raises
    ------
    InvalidInputError
        If the workspace is not plane, a particle is outside, or a property has no effect here.
    MissingExtraError
        If pymunk is not installed.
    """

    def __init__(
        self,
        workspace: Any,
        points: ArrayLike,
        properties: PlantProperties,
        rng: Generator,
        *,
        radius: float = 0.0,
    ) -> None:
        try:
            import pymunk
        except ImportError:
            raise MissingExtraError(
                "a physical plant needs pymunk: pip install 'shoal[physics]'"
            ) from None
        if workspace.dimensions != 2:
            raise InvalidInputError(f"physics: expected a plane workspace, got a {workspace.kind}")
        for name in IGNORED:
            if getattr(properties, name):
                raise InvalidInputError(
                    f"physics: expected no {name.replace('_', '-')} in a plant for steering, got"
                    f" {getattr(properties, name):g}"
                )
        start = check_points(points, what="start", dimensions=2)
        workspace.check_inside(start, what="start")
        self.workspace, self.properties, self._rng = workspace, properties, rng
        self.size, self.moves, self._stopped = float(workspace.size), 0, False
        self.radius = radius or POINT * self.size
        self.heading = float(rng.uniform(-1, 1)) * properties.heading
        self.coil_gains = np.clip(rng.normal(1, properties.coil_gain, (2, 2)), 0.1, None)
        self.own_gains = np.clip(rng.normal(1, properties.own_gain, len(start)), 0.1, None)
        self._low, self._high = workspace.bounds
        self._space = pymunk.Space()
        self._space.collision_slop = 1e-3 * self.radius
        self._space.iterations = 20
        self._space.collision_bias = 0.2**60
        self._space.damping = 0.0  # without inertia: the velocity is what the force causes
        between = BETWEEN**0.5  # the engine multiplies the coefficients of two bodies
        for ring in _wall_rings(workspace, 0.0 if radius else self.radius):
            for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True):
                wall = pymunk.Segment(self._space.static_body, tuple(a), tuple(b), 0.0)
                wall.friction = properties.friction / between
                self._space.add(wall)
        self._bodies = []
        points_only = pymunk.ShapeFilter(group=0 if radius else 1)
        for point in start:
            body = pymunk.Body(1.0, float("inf"))  # particles do not roll along walls
            body.position = (float(point[0]), float(point[1]))
            disk = pymunk.Circle(body, self.radius)
            disk.friction, disk.filter = between, points_only
            self._space.add(body, disk)
            self._bodies.append(body)

    @property
    def name(self) -> str:
        """Name of the rig, as written in summaries and logs."""
        return f"physics {self.properties.kind} in a {self.workspace.kind}"

    @property
    def points(self) -> Points:
        """True centres of the particles; float64, shape (n, 2)."""
        return np.array([body.position for body in self._bodies], dtype=np.float64)

    def look(self) -> Points:
        """Return the positions that the camera sees; float64, shape (n, 2)."""
        properties, points = self.properties, self.points
        error = properties.camera_error / properties.pixels * CELL * self.size
        return points + self._rng.normal(0, error, points.shape) if error else points

    def send(self, move: ArrayLike) -> None:
        """Move the particles by an input (dx, dy), in the workspace's unit."""
        if self._stopped:
            raise RigError("the physical plant has been stopped")
        properties, rng = self.properties, self._rng
        vector = check_points([move], what="input", dimensions=2, count=1)[0]
        self.moves += 1
        length = (1 + properties.magnitude * rng.normal()) * (
            1 + properties.pulse_error * rng.normal()
        )
        angle = np.radians(self.heading + properties.direction * rng.normal())
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        vector = max(0.0, float(length)) * (turn @ vector)
        longest = float(np.hypot(*vector)) * float(self.own_gains.max() * self.coil_gains.max())
        steps = max(1, ceil(longest * properties.strongest / (STEP * self.radius)))
        share = vector / steps
        for _ in range(steps):
            for body, force in zip(self._bodies, self._displacements(share), strict=True):
                body.force = (float(force[0]), float(force[1]))
            self._space.step(1.0)
        # the engine moves bodies by the velocities of the step before
        self._space.step(1.0)

    def _displacements(self, move: Points) -> Points:
        """Return by how much each particle would move in the open; float64, shape (n, 2)."""
        properties, points = self.properties, self.points
        moved = np.zeros_like(points)
        for axis, along in enumerate(move.tolist()):
            other, span = 1 - axis, self._high - self._low
            near = (points[:, axis] - self._low[axis]) / span[axis]
            near = near if along > 0 else 1 - near
            strength = properties.weakest + (properties.strongest - properties.weakest) * near
            beside = 2 * (points[:, other] - self._low[other]) / span[other] - 1
            angle = -np.radians(properties.convergence) * beside
            speed = abs(along) * self.coil_gains[axis, int(along > 0)] * strength
            moved[:, axis] += np.sign(along) * speed * np.cos(angle)
            moved[:, other] += speed * np.sin(angle)
        return moved * self.own_gains[:, None]

    def stop(self) -> None:
        """Turn the field off. The plant then refuses further inputs."""
        self._stopped = True


def _wall_rings(workspace: Any, outward: float) -> list[Points]:
    """Return the walls as closed lines of corners, moved out of the free space by a distance."""
    if workspace.round:
        angles = 2 * np.pi * np.arange(CORNERS) / CORNERS
        # the polygon lies between the circle and its corners, half a sagitta on each side
        radius = (workspace.radius + outward) * (1 + (np.pi / CORNERS) ** 2 / 4)
        circle = np.column_stack([np.cos(angles), np.sin(angles)])
        return [np.asarray(workspace.center) + radius * circle]
    shape = workspace.shape
    if outward:
        shape = shape.buffer(outward, join_style="mitre", mitre_limit=100)
    return [
        np.asarray(ring.coords)[:-1] for ring in (shape.exterior, *getattr(shape, "interiors", ()))
    ]
