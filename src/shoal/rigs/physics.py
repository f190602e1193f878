"""A physical plant: round particles in a continuous vessel, moved by a field with errors, and seen
by a camera that is late, blurred and incomplete. The engine is pymunk (extra ``physics``).

Lengths are in cells and times in seconds. Points are (x, y) with y up, as in `shoal.steering`: in a
vessel of n rows the cell (row, col) is the unit square around (col + 1/2, n - row - 1/2).

At low Reynolds numbers a particle has hardly any inertia: after the short time `PlantProperties.lag` its
velocity is that which the force on it causes in the open. Forces are therefore given as these
velocities. Walls and other particles take away what leads into them, with Coulomb friction along
the wall.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from math import ceil, exp, radians
from typing import Any, Literal

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from shoal.core.checks import check_array, check_choice, check_kind, check_number, check_points
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, MissingExtraError, RigError, errors_at
from shoal.swarm.grid.world import check_start
from shoal.swarm.maps.workspace import GridWorkspace

Points = NDArray[np.float64]
Kind = Literal["roll", "pull"]
ANGLES = {"r": 0.0, "u": 90.0, "l": 180.0, "d": 270.0}
"""Direction of each command, in degrees counterclockwise from the x axis."""

STEP = 0.3  # of its radius that a particle may move between two looks for contacts
SLOP = 1e-3  # overlap that the engine tolerates, in cells
# overlap with a wall that is tolerated at all, in radii: a crowd that wedges a particle between
# others and a wall would press it through the wall
WEDGED = 0.3
RESTING = 1e-6  # velocity, in cells a second, below which a particle is at rest
TOUCHING = 0.02  # distance from a wall, in cells, up to which a particle sticks to it
REACH = 4.0  # distance, in diameters, up to which particles attract each other
BETWEEN = 0.1  # coefficient of friction between two particles
MOST = 5000  # particles
TOLD = {"slip": 0.05, "misplace": 0.05, "miss": 0.01}
"""Error rates that a drive of a plant expects if the user states none. The usual plants show .01 to
.06, .00 to .01 and 0 (`python -m benchmarks.physics`).
"""


@dataclass(frozen=True)
class PlantProperties:
    """The properties of a physical plant. `PlantProperties.of` gives the usual ones of a kind.

    Errors that are constant for an apparatus are drawn once, from a normal distribution if they are
    called a standard deviation.

    Parameters
    ----------
    kind : str
        "roll": a rotating uniform field rolls or propels particles. "pull": the coil on the side to
        which a command leads pulls the particles by a gradient.
    radius : float
        Radius of the particles in cells. A value of at most .5 fits through every passage.
    own_radius : float
        Standard deviation of the relative radius of each particle, constant. No radius exceeds .5.
    pulse : float
        Time that the field is on for one command, in seconds.
    length : float
        Distance by which a command moves a particle without errors, in cells.
    settle : float
        Time after a pulse until the next command or scan, in seconds.
    delay : float
        Time from a command until the field is on, in seconds.
    lag : float
        Relaxation time of the velocity (mass over drag), in seconds.
    magnitude, direction : float
        Standard deviation of the relative magnitude and of the angle (in degrees) of each pulse.
    pulse_error : float
        Standard deviation of the relative duration of each pulse.
    coil_gain : float
        Standard deviation of the relative gain of each coil (left, up, right, down), constant.
    own_gain : float
        Standard deviation of the relative speed of each particle, constant.
    heading : float
        Largest angle, in degrees, between the command and the motion of all particles, constant.
        The angle is drawn uniformly from both signs.
    weakest, strongest : float
        Relative strength of the field at the side far from the active coil and at the side near it.
    convergence : float
        Angle, in degrees, by which the field at the edges points towards the axis of the coil.
    friction : float
        Coefficient of friction between particles and walls.
    adhesion : float
        Velocity, as a share of that in a pulse, below which a particle that touches a wall stays.
    attraction : float
        Velocity, in cells a second, with which the dipoles of two touching particles attract each
        other while the field is on.
    spin : float
        Velocity with which a spinning particle rolls along a wall that it touches while the field is
        on, as a share of that of a command, with the wall on its right. Negative values: on its left.
    flow_x, flow_y : float
        Background flow in cells a second, at all times, in the middle of a vessel of one cell. At
        the distance d from a wall it is 4 d (1 - d) times as fast, up to d = 1/2.
    pixels : float
        Resolution of the camera in pixels a cell.
    camera_error : float
        Standard deviation of the observed positions along each axis, in pixels.
    blur : float
        Distance in pixels below which two particles appear as one, at their middle.
    miss, double, ghosts : float
        Probability that a particle is not seen, that it is seen twice (once at a distance of one
        radius), and the mean number of particles seen where there is none, in each picture.
    frame_rate : float
        Pictures a second.
    late : float
        Age of a picture when it arrives, in seconds.

    Raises
    ------
    InvalidInputError
        Raised if a value is outside its range.
    """

    kind: Kind = "roll"
    radius: float = 0.35
    own_radius: float = 0.0
    pulse: float = 0.083
    length: float = 1.0
    settle: float = 0.1
    delay: float = 0.02
    lag: float = 0.002
    magnitude: float = 0.0
    direction: float = 0.0
    pulse_error: float = 0.0
    coil_gain: float = 0.0
    own_gain: float = 0.0
    heading: float = 0.0
    weakest: float = 1.0
    strongest: float = 1.0
    convergence: float = 0.0
    friction: float = 0.0
    adhesion: float = 0.0
    attraction: float = 0.0
    spin: float = 0.0
    flow_x: float = 0.0
    flow_y: float = 0.0
    pixels: float = 20.0
    camera_error: float = 0.0
    blur: float = 0.0
    miss: float = 0.0
    double: float = 0.0
    ghosts: float = 0.0
    frame_rate: float = 24.0
    late: float = 0.05

    def __post_init__(self) -> None:
        check_choice(self.kind, what="kind", choices=USUAL)
        for field in dataclasses.fields(self)[1:]:
            least, most = RANGES[field.name]
            value = check_number(getattr(self, field.name), what=field.name, least=least, most=most)
            object.__setattr__(self, field.name, value)
        if self.weakest > self.strongest:
            raise InvalidInputError(
                f"weakest: expected at most strongest ({self.strongest:g}), got {self.weakest:g}"
            )

    @classmethod
    def of(cls, kind: str, **values: float) -> PlantProperties:
        """Return the usual apparatus of a kind, with some values changed.

        docs/concepts/physics.md names the sources of the usual values.

        Raises
        ------
        InvalidInputError, UnknownNameError

        Examples
        --------
        >>> PlantProperties.of("roll").own_gain, PlantProperties.of("roll", own_gain=0).own_gain
        (0.1, 0.0)
        """
        check_choice(kind, what="physics", choices=("exact", *USUAL))
        names = [field.name for field in dataclasses.fields(cls)[1:]]
        for name in values:
            check_choice(name, what="physics", choices=names)
        defaults = USUAL.get(kind, {})
        moves: Kind = "pull" if kind == "pull" else "roll"
        return cls(moves, **{**defaults, **values})

    @classmethod
    def parse(cls, text: str) -> PlantProperties:
        """Return the apparatus that a text such as ``pull,radius=0.15,ghosts=1`` describes.

        Raises
        ------
        InvalidInputError, UnknownNameError

        Examples
        --------
        >>> PlantProperties.parse("pull,own-gain=0.2").own_gain
        0.2
        """
        kind, *pairs = text.split(",")
        values: dict[str, float] = {}
        for pair in pairs:
            name, equals, value = pair.strip().partition("=")
            name = name.replace("-", "_")
            try:
                number = float(value)
            except ValueError:
                equals = ""
            if not equals:
                raise InvalidInputError(
                    f"physics: expected NAME=NUMBER after the kind, got {pair[:60]!r}"
                )
            if name in values:
                raise InvalidInputError(f"physics: expected each name once, got {name!r} twice")
            values[name] = number
        return cls.of(kind.strip() or "roll", **values)


RANGES: dict[str, tuple[float, float]] = {
    "radius": (0.02, 0.5),
    "own_radius": (0.0, 0.5),
    "pulse": (1e-4, 60.0),
    "length": (1e-3, 100.0),
    "settle": (0.0, 60.0),
    "delay": (0.0, 60.0),
    "lag": (0.0, 1.0),
    "magnitude": (0.0, 0.5),
    "direction": (0.0, 90.0),
    "pulse_error": (0.0, 0.5),
    "coil_gain": (0.0, 0.5),
    "own_gain": (0.0, 0.5),
    "heading": (0.0, 90.0),
    "weakest": (1e-3, 10.0),
    "strongest": (1e-3, 10.0),
    "convergence": (0.0, 45.0),
    "friction": (0.0, 10.0),
    "adhesion": (0.0, 1.0),
    "attraction": (0.0, 100.0),
    "spin": (-10.0, 10.0),
    "flow_x": (-100.0, 100.0),
    "flow_y": (-100.0, 100.0),
    "pixels": (1.0, 1e4),
    "camera_error": (0.0, 1e3),
    "blur": (0.0, 1e3),
    "miss": (0.0, 1.0),
    "double": (0.0, 1.0),
    "ghosts": (0.0, 1e3),
    "frame_rate": (1.0, 1e4),
    "late": (0.0, 10.0),
}
"""Least and largest value of each property."""
USUAL: dict[str, dict[str, float]] = {
    "roll": {
        "magnitude": 0.003,
        "direction": 0.1,
        "pulse_error": 0.03,
        "coil_gain": 0.02,
        "own_gain": 0.1,
        "heading": 5.0,
        "friction": 0.2,
        "camera_error": 1.0,
    },
    "pull": {
        "pulse_error": 0.03,
        "coil_gain": 0.02,
        "own_gain": 0.05,
        "weakest": 0.74,
        "strongest": 1.36,
        "convergence": 5.3,
        "friction": 0.2,
        "camera_error": 1.0,
    },
}


class Plant:
    """Round particles in a vessel, with a clock of its own.

    Parameters
    ----------
    workspace : GridWorkspace
        The vessel, in two dimensions. Its edge is a wall.
    points : array_like of float, shape (n, 2)
        The particles' centres, (x, y).
    apparatus : PlantProperties
    rng : Generator

    Attributes
    ----------
    clock : float
        Time since the start, in seconds.
    heading : float
        Angle between command and motion, in degrees.
    coil_gains : ndarray of float64, shape (2, 2)
        Gain of the coils towards negative and positive values of x and of y.
    own_gains, radii : ndarray of float64, shape (n,)

    Raises
    ------
    InvalidInputError
        Raised if the vessel is not two-dimensional, or a particle touches a wall or another one.
    MissingExtraError
        Raised if pymunk is not installed.

    Examples
    --------
    >>> plant = Plant(GridWorkspace([[1, 1, 1, 1]]), [(0.5, 0.5)], PlantProperties(), np.random.default_rng(1))
    >>> plant.push(0.0, seconds=plant.apparatus.pulse)
    >>> plant.points.round(2).tolist()
    [[1.5, 0.5]]
    """

    def __init__(
        self,
        workspace: GridWorkspace,
        points: ArrayLike,
        apparatus: PlantProperties,
        rng: Generator,
    ) -> None:
        try:
            import pymunk
            import pymunk.batch
        except ImportError:
            raise MissingExtraError(
                "a physical plant needs pymunk: pip install 'shoal[physics]'"
            ) from None
        check_kind(workspace, GridWorkspace, what="workspace")
        check_kind(apparatus, PlantProperties, what="apparatus")
        check_kind(rng, np.random.Generator, what="rng")
        if workspace.ndim != 2:
            raise InvalidInputError(
                f"physics: expected a vessel in two dimensions, got {workspace.name} in"
                f" {workspace.ndim}"
            )
        self.workspace, self.apparatus, self._rng = workspace, apparatus, rng
        array = check_array(points, expected="points: expected points of 2 numbers")
        start = check_points(
            array if array.size else array.reshape(0, 2), what="points", dimensions=2
        ).copy()
        n = len(start)
        if not 1 <= n <= MOST:
            raise InvalidInputError(f"physics: expected 1 to {MOST} particles, got {n}")
        self._size = np.array(workspace.shape[::-1], dtype=np.float64)
        self.clock, self.field_on = 0.0, False
        self.heading = float(rng.uniform(-1, 1)) * apparatus.heading
        self.coil_gains = np.clip(rng.normal(1, apparatus.coil_gain, (2, 2)), 0.1, None)
        self.own_gains = np.clip(rng.normal(1, apparatus.own_gain, n), 0.1, None)
        self._flow = np.array([apparatus.flow_x, apparatus.flow_y])
        self._fastest = float(np.linalg.norm(self._flow))
        self.radii = self._draw_radii(n)
        self._longest = STEP * self._smallest / max(float(np.abs(self._flow).max()), 1.0)
        # the engine: without gravity; only the velocities that forces cause stay
        self._space, self._everything = pymunk.Space(), pymunk.ShapeFilter()
        self._space.collision_slop, self._space.iterations = SLOP, 20
        # overlaps vanish by half in each step
        self._space.collision_bias = 0.5**60
        between = BETWEEN**0.5  # the engine multiplies the coefficients of two bodies
        padded = np.pad(workspace.free, 1)
        # whether a wall is on the sides -x, +x, -y and +y of a cell
        self._walls = ~np.stack(
            [padded[1:-1, :-2], padded[1:-1, 2:], padded[2:, 1:-1], padded[:-2, 1:-1]], axis=-1
        )
        ground = self._space.static_body
        for a, b in wall_segments(workspace.free):
            wall = pymunk.Segment(ground, a, b, 0.0)
            wall.friction = apparatus.friction / between
            self._space.add(wall)
        self._bodies: list[Any] = []
        for point, radius in zip(start, self.radii.tolist(), strict=True):
            self._add(point, radius)
        # all bodies at once: those that move, in the order in which they were added, and the walls'
        self._exchange, self._batch = pymunk.batch, pymunk.batch.Buffer()
        self._given, self._forces = pymunk.batch.Buffer(), np.zeros((n + 1, 2))
        self._given.set_float_buf(self._forces)
        self._check_free(start)
        self._seen: deque[tuple[float, Points]] = deque([(0.0, start)])

    def _draw_radii(self, n: int) -> Points:
        mean, spread = self.apparatus.radius, self.apparatus.own_radius
        least, most = (RANGES["radius"][0], RANGES["radius"][1])
        if not spread:
            return np.full(n, mean)
        return np.clip(mean * self._rng.normal(1, spread, n), least, most)

    @property
    def _smallest(self) -> float:
        return float(self.radii.min())

    def _add(self, point: Points, radius: float) -> None:
        import pymunk

        body = pymunk.Body(1.0, float("inf"))  # particles do not roll along walls
        body.position = (float(point[0]), float(point[1]))
        body.velocity = (self.apparatus.flow_x, self.apparatus.flow_y)
        disk = pymunk.Circle(body, radius)
        disk.friction = BETWEEN**0.5  # the engine multiplies the coefficients of two bodies
        self._space.add(body, disk)
        self._bodies.append(body)

    def enter(self, point: ArrayLike) -> bool:
        """Let a particle come in at a point, and return whether there was room for it."""
        at = np.array(point, dtype=np.float64)
        radius = self._draw_radii(1)
        if (np.linalg.norm(self.points - at, axis=1) < self.radii + radius).any():
            return False
        self._add(at, radius.item())
        self.radii = np.append(self.radii, radius)
        gain = float(self._rng.normal(1, self.apparatus.own_gain))
        self.own_gains = np.append(self.own_gains, max(gain, 0.1))
        self._forces = np.zeros((len(self.own_gains) + 1, 2))
        self._given.set_float_buf(self._forces)
        self._remember()
        return True

    def _check_free(self, points: Points) -> None:
        for at, (point, radius) in enumerate(zip(points, self.radii.tolist(), strict=True)):
            hits = self._space.point_query(
                (float(point[0]), float(point[1])),
                radius - 2 * SLOP,
                self._everything,
            )
            cell = self.cells_of(points[at : at + 1])[0]
            inside = ((cell >= 0) & (cell < self.workspace.shape)).all()
            if len(hits) > 1 or not (inside and self.workspace.free[tuple(cell)]):
                x, y = point.round(3).tolist()
                raise InvalidInputError(
                    "physics: expected particles that touch neither walls nor each other, got one"
                    f" of radius {radius:g} at ({x:g}, {y:g})"
                )

    @property
    def points(self) -> Points:
        """The centres of all particles now (float64, shape (n, 2))."""
        return self._read(self._exchange.BodyFields.POSITION)

    @property
    def true_cells(self) -> Points:
        """The centres of all particles now as (row, column) (float64, shape (n, 2)). The centre of a
        cell is at whole numbers.
        """
        points = self.points - 0.5
        return np.column_stack([self.workspace.shape[0] - 1 - points[:, 1], points[:, 0]])

    def _read(self, field: Any) -> Points:
        self._batch.clear()
        self._exchange.get_space_bodies(self._space, field, self._batch)
        values = np.frombuffer(self._batch.float_buf()).reshape(-1, 2)
        return values[: len(self.own_gains)].copy()

    def cells_of(self, points: Points) -> NDArray[np.int64]:
        """Return the cells (row, col) in which points lie (int64, shape (n, 2))."""
        cells = np.floor(points).astype(np.int64)
        return np.column_stack([self.workspace.shape[0] - 1 - cells[:, 1], cells[:, 0]])

    def push(self, angle: float, *, seconds: float, strength: float = 1.0) -> None:
        """Turn the field on for a time, and let the particles settle.

        Parameters
        ----------
        angle : float
            Direction in degrees, counterclockwise from the x axis.
        seconds : float
        strength : float
            Strength of the field, as a share of that of a command.
        """
        apparatus, rng = self.apparatus, self._rng
        self.wait(apparatus.delay)
        angle = angle + self.heading + apparatus.direction * float(rng.normal())
        strength *= max(0.0, 1 + apparatus.magnitude * float(rng.normal()))
        seconds *= max(0.0, 1 + apparatus.pulse_error * float(rng.normal()))
        speed = strength * apparatus.length / apparatus.pulse
        command = speed * np.array([np.cos(radians(angle)), np.sin(radians(angle))])
        most = speed * apparatus.strongest * float(self.coil_gains.max() * self.own_gains.max())
        most += (
            apparatus.attraction + float(np.linalg.norm(self._flow)) + abs(apparatus.spin) * speed
        )
        steps = max(1, ceil(seconds * most / (STEP * self._smallest)))
        self._fastest = most
        self.field_on, self._longest = True, max(seconds / steps, 1e-9)
        for _ in range(steps):
            self._step(self._longest, command)
        self.field_on = False
        self.wait(apparatus.settle)

    def wait(self, seconds: float) -> None:
        """Let time pass without a field."""
        until, none = self.clock + seconds, np.zeros(2)
        flowing = bool(self._flow.any())
        while self.clock < until - 1e-12:
            speeds = self._read(self._exchange.BodyFields.VELOCITY)
            if not flowing and (np.abs(speeds) < RESTING).all():
                self.clock = until
                self._remember()
                return
            # the engine moves bodies by the velocities of the step before: with steps as long as
            # those of the pulse, a pulse moves a particle by exactly velocity times duration
            self._step(min(until - self.clock, self._longest), none)

    def _step(self, seconds: float, command: Points) -> None:
        """Let the engine move the particles for a short time."""
        velocities = self._velocities(self.points, command)
        # v' = (v_wanted - v) / lag, exactly over the step: v keeps the share e^(-t/lag)
        lag = self.apparatus.lag
        decay = exp(-seconds / lag) if lag else 0.0
        self._space.damping = decay ** (1 / seconds) if decay else 0.0
        self._forces[:-1] = velocities * ((1 - decay) / seconds)
        self._exchange.set_space_bodies(self._space, self._exchange.BodyFields.FORCE, self._given)
        self._space.step(seconds)
        self._calm()
        self.clock += seconds
        self._remember()

    def _remember(self) -> None:
        """Keep the positions that a picture may still show."""
        self._seen.append((self.clock, self.points))
        oldest = self.clock - self.apparatus.late - 1 / self.apparatus.frame_rate
        while len(self._seen) > 1 and self._seen[1][0] <= oldest:
            self._seen.popleft()

    def _velocities(self, points: Points, command: Points) -> Points:
        """Return the velocity that each particle has in the open (shape (n, 2))."""
        apparatus = self.apparatus
        velocities = np.zeros_like(points)
        for axis, along in enumerate(command.tolist()):
            if along:
                velocities += self._coil(points, axis, along)
        velocities *= self.own_gains[:, None]
        if apparatus.attraction and self.field_on:
            velocities += self._attraction(points, command)
        if apparatus.spin and self.field_on:
            velocities += self._rolling(points, float(np.linalg.norm(command)))
        if self._flow.any():
            near = np.minimum(self._gaps(points).min(axis=1), 0.5)
            velocities += self._flow * (4 * near * (1 - near))[:, None]
        if apparatus.adhesion:
            self._stick(points, velocities)
        return velocities

    def _coil(self, points: Points, axis: int, along: float) -> Points:
        """Return the velocities that one coil causes. Its field grows towards it, from the weakest
        to the strongest, and points to its axis.
        """
        apparatus, other = self.apparatus, 1 - axis
        near = points[:, axis] / self._size[axis]  # 0 at one side and 1 at the other
        near = near if along > 0 else 1 - near
        strength = apparatus.weakest + (apparatus.strongest - apparatus.weakest) * near
        beside = 2 * points[:, other] / self._size[other] - 1  # -1 to 1
        angle = -radians(apparatus.convergence) * beside
        speed = abs(along) * self.coil_gains[axis, int(along > 0)] * strength
        velocities = np.empty_like(points)
        velocities[:, axis] = np.sign(along) * speed * np.cos(angle)
        velocities[:, other] = speed * np.sin(angle)
        return velocities

    def _rolling(self, points: Points, speed: float) -> Points:
        """Return the velocities with which spinning particles roll along walls."""
        touches = self._gaps(points) < self.radii[:, None] + TOUCHING
        # with the wall -x on the right, the motion leads to -y, and so on around
        along = np.array([[0.0, -1.0], [0.0, 1.0], [1.0, 0.0], [-1.0, 0.0]])
        velocities: Points = self.apparatus.spin * speed * (touches.astype(np.float64) @ along)
        return velocities

    def _attraction(self, points: Points, command: Points) -> Points:
        """Return the velocities by which magnetic dipoles attract each other.

        With the distance d in mean diameters and the angle t between the line of the two centres and the
        field, aligned dipoles cause the radial velocity (1 - 3 cos(t)^2) / (2 d^4), times that of
        two touching particles in line, and the tangential one -sin(2 t) / (2 d^4). In a field that
        rotates in the plane the mean is radial, -1 / d^4 times half of 1/2.
        """
        from scipy.spatial import KDTree

        reach = REACH * 2 * float(self.radii.max())
        pairs = KDTree(points).query_pairs(reach, output_type="ndarray")
        velocities = np.zeros_like(points)
        if not len(pairs):
            return velocities
        line = points[pairs[:, 1]] - points[pairs[:, 0]]
        diameter = self.radii[pairs].sum(axis=1)
        distance = np.maximum(np.linalg.norm(line, axis=1), diameter)
        line /= distance[:, None]
        fall = self.apparatus.attraction * (diameter / distance) ** 4
        if self.apparatus.kind == "roll":
            pull = (0.25 * fall)[:, None] * line
        else:
            field = command / np.linalg.norm(command)
            cosine = line @ field
            across = np.column_stack([-line[:, 1], line[:, 0]])
            sine = across @ field
            radial = 0.5 * (3 * cosine**2 - 1) * fall
            pull = radial[:, None] * line + (cosine * sine * fall)[:, None] * across
        np.add.at(velocities, pairs[:, 0], pull)
        np.add.at(velocities, pairs[:, 1], -pull)
        return velocities

    def _stick(self, points: Points, velocities: Points) -> None:
        """Hold the particles that touch a wall and are too slow to leave it or to slide."""
        apparatus = self.apparatus
        least = apparatus.adhesion * apparatus.length / apparatus.pulse
        touches = (self._gaps(points) < self.radii[:, None] + TOUCHING).any(axis=1)
        velocities[touches & (np.linalg.norm(velocities, axis=1) < least)] = 0.0

    def _gaps(self, points: Points) -> Points:
        """Return the distances of points from the walls on the sides -x, +x, -y and +y of their
        cells (shape (n, 4)), inf where there is none.
        """
        offsets = points - np.floor(points)
        gaps = np.column_stack([offsets[:, 0], 1 - offsets[:, 0], offsets[:, 1], 1 - offsets[:, 1]])
        return np.where(self._walls[tuple(self.cells_of(points).T)], gaps, np.inf)

    def _calm(self) -> None:
        """Slow down and take back particles that a crowd squeezes.

        The engine can only tell bodies with inertia apart: those wedged between others and a wall
        get impulses that throw them through the wall. Without inertia, nothing is faster than the
        field moves it in the open.
        """
        speeds = np.linalg.norm(self._read(self._exchange.BodyFields.VELOCITY), axis=1)
        for at in np.flatnonzero(speeds > self._fastest).tolist():
            body = self._bodies[at]
            body.velocity *= self._fastest / speeds[at]
        points, least = self.points, (1 - WEDGED) * self.radii[:, None]
        back = np.maximum(0.0, least - self._gaps(points))
        for at in np.flatnonzero(back.any(axis=1)).tolist():
            x, y = points[at] + back[at, ::2] - back[at, 1::2]
            self._bodies[at].position = (float(x), float(y))

    def picture(self) -> tuple[float, Points]:
        """Return the time of the newest picture that has arrived, and the centroids in it.

        Returns
        -------
        time : float
        centroids : ndarray of float64, shape (k, 2)
        """
        apparatus, rng = self.apparatus, self._rng
        rate = apparatus.frame_rate
        time = max(0.0, np.floor((self.clock - apparatus.late) * rate + 1e-9) / rate)
        points = next(
            (seen for taken, seen in reversed(self._seen) if taken <= time + 1e-9), self._seen[0][1]
        )
        shown = rng.random(len(points)) >= apparatus.miss
        points, radii = points[shown], self.radii[: len(points)][shown]
        doubled = rng.random(len(points)) < apparatus.double
        twice = points[doubled]
        turn = rng.uniform(0, 2 * np.pi, len(twice))
        twice = twice + radii[doubled, None] * np.column_stack([np.cos(turn), np.sin(turn)])
        ghosts = rng.uniform(0, 1, (int(rng.poisson(apparatus.ghosts)), 2)) * self._size
        points = _blur(points, apparatus.blur / apparatus.pixels)
        points = np.vstack([points, twice, ghosts])
        points = points + rng.normal(0, apparatus.camera_error / apparatus.pixels, points.shape)
        return float(time), np.clip(points, 0, np.nextafter(self._size, 0))


class PhysicsRig:
    """A rig of particles on a grid, whose apparatus is a `Plant`.

    Parameters
    ----------
    workspace : GridWorkspace
    start : array_like of int, shape (n, 2)
        Cells of the particles, which begin in the middle of their cells.
    apparatus : PlantProperties
    rng : Generator

    Raises
    ------
    InvalidInputError, MissingExtraError

    Examples
    --------
    >>> vessel = GridWorkspace([[1, 1, 1, 1]])
    >>> rig = PhysicsRig(vessel, [(0, 0), (0, 1)], PlantProperties(), np.random.default_rng(1))
    >>> rig.send("r")
    >>> rig.observe().tolist()
    [[0, 1], [0, 2]]
    """

    rule = "block"

    def __init__(
        self, workspace: GridWorkspace, start: ArrayLike, apparatus: PlantProperties, rng: Generator
    ) -> None:
        with errors_at("start"):
            cells = check_start(workspace, start)
        points = np.column_stack([cells[:, 1] + 0.5, workspace.shape[0] - cells[:, 0] - 0.5])
        self.plant = Plant(workspace, points, apparatus, rng)
        self._stopped = False

    @property
    def name(self) -> str:
        """Name of the vessel."""
        return self.plant.workspace.name

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the vessel, in cells."""
        return self.plant.workspace.shape

    def send(self, command: str) -> None:
        """Pulse the field in the direction of a command (a letter of ``lurd``)."""
        if self._stopped:
            raise RigError("the physical plant has been stopped")
        check_choice(command, what="command", choices=ANGLES)
        self.plant.push(ANGLES[command], seconds=self.plant.apparatus.pulse)

    def enter(self, cell: tuple[int, ...]) -> bool:
        """Let a particle come in at a free cell, and return whether there was room for it."""
        return self.plant.enter((cell[1] + 0.5, self.shape[0] - cell[0] - 0.5))

    def observe(self) -> NDArray[np.int64]:
        """Return the cell of each particle that the camera sees (int64, shape (k, 2)). Several
        particles can be in one cell.
        """
        _, centroids = self.plant.picture()
        return self.plant.cells_of(centroids)

    @property
    def true_cells(self) -> Points:
        """Where the particles are, as (row, column) (float64, shape (n, 2)). The centre of a cell is
        at whole numbers.
        """
        return self.plant.true_cells

    def stop(self) -> None:
        """Turn the field off. The rig then refuses further commands."""
        self._stopped = True


def wall_segments(free: NDArray[np.bool_]) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """Return the edges between free cells and obstacles as straight segments, as long as possible.

    Examples
    --------
    >>> len(wall_segments(np.ones((3, 4), dtype=bool)))
    4
    """
    rows = free.shape[0]
    padded = np.pad(free, 1)
    across = padded[1:, 1:-1] != padded[:-1, 1:-1]  # edge above row i, at column j
    along = padded[1:-1, 1:] != padded[1:-1, :-1]  # edge left of column j, in row i
    segments = []
    for i, first, end in _runs(across):
        segments.append(((float(first), float(rows - i)), (float(end), float(rows - i))))
    for j, first, end in _runs(along.T):
        segments.append(((float(j), float(rows - first)), (float(j), float(rows - end))))
    return segments


def _runs(edges: NDArray[np.bool_]) -> list[tuple[int, int, int]]:
    """Return (line, first, end) of each run of true values in the lines of an array."""
    steps = np.diff(np.pad(edges, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    lines, firsts = np.nonzero(steps == 1)
    _, ends = np.nonzero(steps == -1)
    return list(zip(lines.tolist(), firsts.tolist(), ends.tolist(), strict=True))


def _blur(points: Points, reach: float) -> Points:
    """Return points, with those that are nearer to each other than ``reach`` as one, at their
    middle.
    """
    if not reach or len(points) < 2:
        return points
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import KDTree

    pairs = KDTree(points).query_pairs(reach, output_type="ndarray")
    near = coo_array((np.ones(len(pairs)), pairs.T), shape=(len(points), len(points)))
    count, labels = connected_components(near, directed=False)
    sums = np.zeros((count, 2))
    np.add.at(sums, labels, points)
    return sums / np.bincount(labels)[:, None]
