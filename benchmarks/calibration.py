"""Calibration and pulse trim on physical plants: python -m benchmarks.calibration [--seeds N]

The camera is turned by any angle, sheared by up to .2, and mirrored in every second case; its
positions have an error of .3 pixels at 20 pixels a cell. The coils have gains of .8 to 1.2, and
particles roll up to 15 degrees askew. Seven marks are read with an error of .3 pixels. One row for
each way to drive: with the stated pulses, calibrated, calibrated and trimmed, and (for the trim
alone) with raw gains.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from shoal import GridWorkspace, RigError, open_map
from shoal.rigs import (
    BenchRig,
    Frame,
    PlantPorts,
    PulseTrim,
    Responses,
    calibrate,
    drive,
    tie_by_marks,
)
from shoal.rigs.calibration import BenchCalibration, transform_points
from shoal.rigs.physics import TOLD, Plant, PlantProperties
from shoal.swarm.grid.board import noise_rng, trial_rng
from shoal.swarm.grid.tasks import place
from shoal.swarm.noise import MapErrors

MAP, PARTICLES = "vessels:300", 20
CELL, ERROR = 20.0, 0.3  # pixels a cell, and of a position
WAYS = ("stated", "calibrated", "trimmed", "calibrated and trimmed")
MARKS = 7


class TurnedCamera(PlantPorts):
    """Both ports of a plant, under a camera that is turned, sheared and perhaps mirrored."""

    def __init__(self, plant: Plant, seed: int) -> None:
        super().__init__(plant)
        self.rng = np.random.default_rng(seed)
        turn, shear = self.rng.uniform(0, 2 * np.pi), self.rng.uniform(-0.2, 0.2)
        mirror = np.diag([-1.0 if seed % 2 else 1.0, 1.0])
        rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        self.matrix = np.eye(3)
        self.matrix[:2, :2] = CELL * rotation @ [[1, shear], [0, 1]] @ mirror @ [[0, 1], [1, 0]]
        self.matrix[:2, 2] = 1000

    def observe(self) -> Frame:
        """Return the positions in turned pixels."""
        frame = super().observe()
        pixels = transform_points(self.matrix, self.calibration.to_cells(frame.points))
        pixels += self.rng.normal(0, ERROR, pixels.shape)
        return Frame(pixels, frame.time, frame.number)

    def marks(self) -> np.ndarray:
        """Return pixels and cells of marked points, read with an error."""
        rows, columns = self.plant.workspace.shape
        cells = self.rng.uniform(0, (rows - 1, columns - 1), (MARKS, 2)).round()
        pixels = transform_points(self.matrix, cells)
        return np.hstack([pixels + self.rng.normal(0, ERROR, pixels.shape), cells])


def bench_of(vessel: GridWorkspace, seed: int, kind: str, radius: float) -> TurnedCamera:
    """Return a bench with gains of .8 to 1.2 and a heading of up to 15 degrees."""
    start = place(vessel, PARTICLES, "uniform", trial_rng(seed))
    points = np.column_stack([start[:, 1] + 0.5, vessel.shape[0] - start[:, 0] - 0.5])
    heading = 15.0 if kind == "roll" else 0.0
    about = PlantProperties.of(kind, radius=radius, heading=heading, camera_error=0.0)
    plant = Plant(vessel, points, about, noise_rng(seed))
    plant.coil_gains[:] = np.random.default_rng(seed).uniform(0.8, 1.2, (2, 2))
    return TurnedCamera(plant, seed)


def drive_bench(
    vessel: GridWorkspace, seed: int, kind: str, radius: float, way: str
) -> tuple[dict[str, float], BenchCalibration | None]:
    """Drive one bench, and return its numbers and its calibration."""
    bench = bench_of(vessel, seed, kind, radius)
    start = place(vessel, PARTICLES, "uniform", trial_rng(seed))
    tie = tie_by_marks(bench.marks())
    corners = np.array([(0, 0), (0, vessel.shape[1]), (vessel.shape[0], 0), vessel.shape], float)
    away = transform_points(tie.matrix, transform_points(bench.matrix, corners)) - corners
    about = {"residual": tie.residual or 0.0, "corner": float(np.linalg.norm(away, axis=1).max())}
    found = calibrate(bench, bench, pulses=bench.pulses, tie=tie, shape=vessel.shape)
    about["pulses"] = found.responses.residual
    pulses = found.pulses if "calibrated" in way else bench.pulses
    responses = found.responses if "calibrated" in way else Responses.from_pulses(bench.pulses)
    noise = 2**0.5 * found.noise / found.pixels_per_cell
    trim = PulseTrim(responses, noise=noise) if "trimmed" in way else None
    rig = BenchRig(bench, bench, found, shape=vessel.shape, pulses=pulses, trim=trim)
    result = drive(rig, policy="closest-frontier", **TOLD)
    errors = MapErrors.of(vessel, start, result.belief)
    about |= {
        "right": errors.right,
        "false_free": float(errors.false_free),
        "moves": float(result.moves),
        "alarms": float(result.status == "alarm"),
        "slip": result.rates["slip"].observed,
    }
    return about, found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--kinds", default="roll,pull")
    parser.add_argument("--radii", default=".35,.15")
    parser.add_argument("--ways", default=",".join(WAYS))
    given = parser.parse_args()
    vessel = open_map(MAP)
    for kind in given.kinds.split(","):
        for radius in map(float, given.radii.split(",")):
            for way in given.ways.split(","):
                began, rows, refused = time.process_time(), [], []
                for seed in range(given.seeds):
                    try:
                        rows.append(drive_bench(vessel, seed, kind, radius, way)[0])
                    except RigError as error:
                        refused.append(str(error))
                mean = {name: np.mean([row[name] for row in rows]) for name in rows[0]}
                print(
                    f"{kind}, radius {radius:g}, {way}: {mean['right']:.4f} right (least"
                    f" {min(row['right'] for row in rows):.4f}),"
                    f" {sum(row['false_free'] for row in rows):.0f} walls called free,"
                    f" {mean['moves']:.0f} moves, {sum(row['alarms'] for row in rows):.0f} ended by an"
                    f" alarm, slip {mean['slip']:.3f}; residual {mean['residual']:.3f} (most"
                    f" {max(row['residual'] for row in rows):.3f}), corners"
                    f" {max(row['corner'] for row in rows):.3f}, pulses"
                    f" {max(row['pulses'] for row in rows):.3f}; {len(refused)} refused;"
                    f" {time.process_time() - began:.0f} s",
                    flush=True,
                )
                for text in refused:
                    print(f"  {text}")


if __name__ == "__main__":
    main()
