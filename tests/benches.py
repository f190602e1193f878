"""Benches for tests: a physical plant under a camera that is turned, sheared and mirrored."""

from __future__ import annotations

import time

import numpy as np

from shoal.rigs import Frame, PlantPorts
from shoal.rigs.calibration import transform_points
from shoal.rigs.physics import Plant, PlantProperties
from shoal.swarm.grid.board import noise_rng, trial_rng
from shoal.swarm.grid.tasks import place


def view_of(shape, *, cell=20.0, turn=0.0, shear=0.0, mirror=False, room=20.0):
    """Return the matrix from (row, column, 1) to pixels, and width and height of the picture."""
    angle = np.radians(turn)
    rotation = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    flip = np.diag([-1.0, 1.0]) if mirror else np.eye(2)
    linear = cell * np.array(rotation) @ [[1, shear], [0, 1]] @ flip @ [[0, 1], [1, 0]]
    ends = [(-0.5, -0.5), (-0.5, shape[1] - 0.5), (shape[0] - 0.5, -0.5), np.subtract(shape, 0.5)]
    corners = np.array(ends) @ linear.T
    matrix = np.eye(3)
    matrix[:2, :2], matrix[:2, 2] = linear, room - corners.min(0)
    width, height = np.ceil(np.ptp(corners, axis=0) + 2 * room).astype(int).tolist()
    return matrix, (width, height)


def plant_of(vessel, particles, seed=0, **properties):
    start = place(vessel, particles, "uniform", trial_rng(seed))
    points = np.column_stack([start[:, 1] + 0.5, vessel.shape[0] - start[:, 0] - 0.5])
    kind = properties.pop("kind", "roll")
    return Plant(vessel, points, PlantProperties.of(kind, **properties), noise_rng(seed))


class SeenPlant(PlantPorts):
    """Both ports of a plant, seen in pixels under a matrix, with an error in pixels. The sensor does
    not know its calibration.
    """

    calibration = shape = None

    def __init__(self, plant, matrix, size, *, error=0.3, seed=0):
        super().__init__(plant)
        del self.calibration
        self.matrix, self.size, self.error = matrix, size, error
        self.rng = np.random.default_rng(seed)

    def observe(self):
        rows = self.plant.workspace.shape[0]
        if self._ended:
            about = self.plant.apparatus
            self.plant.wait(
                max(0.0, self._ended + 1 / about.frame_rate + about.late - self.plant.clock)
            )
        if self._seen is not None and self._seen.number == self._number_now():
            self.plant.wait(1 / self.plant.apparatus.frame_rate)
        _, points = self.plant.picture()
        cells = np.column_stack([rows - 0.5 - points[:, 1], points[:, 0] - 0.5])
        pixels = transform_points(self.matrix, cells)
        pixels = self.rng.permutation(pixels + self.rng.normal(0, self.error, pixels.shape))
        self._seen = Frame(pixels, time.monotonic(), self._number_now())
        return self._seen

    def marks(self, cells, error=0.0):
        pixels = transform_points(self.matrix, cells)
        return np.hstack([pixels + self.rng.normal(0, error, pixels.shape), cells])


def render(vessel, points, matrix, size, rng, *, radius=0.35, bright=True, noise=4.0):
    """Return the picture (uint8) of a vessel with particles at (row, column)."""
    import cv2

    side = 16
    drawn = np.kron(vessel.free, np.ones((side, side), dtype=np.float32))
    to_cells = np.array(
        [[0, 1 / side, 0.5 / side - 0.5], [1 / side, 0, 0.5 / side - 0.5], [0, 0, 1]]
    )
    picture = cv2.warpPerspective(drawn, matrix @ to_cells, size, flags=cv2.INTER_AREA)
    picture = cv2.GaussianBlur(150 * picture + 60, (3, 3), 0)
    cell = abs(np.linalg.det(matrix[:2, :2])) ** 0.5
    for x, y in transform_points(matrix, points) if len(points) else ():
        at = round(float(x) * 16), round(float(y) * 16)
        cv2.circle(picture, at, round(radius * cell * 16), 15, -1, cv2.LINE_AA, 4)
    if not bright:
        picture = 255 - picture
    return np.clip(picture + rng.normal(0, noise, picture.shape), 0, 255).astype(np.uint8)
