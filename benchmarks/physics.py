"""Mapping on physical plants: python -m benchmarks.physics [--seeds N] [--kinds roll,pull]

One row for each map, kind of plant and radius: the share of cells classified rightly, walls called
free, moves beside those of the grid with the same stated noise, the observed error rates, alarms
that ended a drive, and how much faster than the plant's own clock it runs (CPU time). The last lines
compute the field of a pulling coil and of a pair of Helmholtz coils, from which the usual values
come.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.special import ellipe, ellipk

from shoal import GridWorkspace, open_map
from shoal.rigs import Drive, NoisyRig, Rig, drive
from shoal.rigs.physics import TOLD, USUAL, PhysicsRig, PlantProperties
from shoal.swarm.grid.board import noise_rng, trial_rng
from shoal.swarm.grid.tasks import place
from shoal.swarm.noise import MapErrors, Noise

MAPS = (("vessels:300", 20), ("vessels:1000", 100))
RADII = (0.35, 0.15)


def measure(seeds: int, kinds: list[str]) -> None:
    """Print a row for each map, kind and radius."""
    for name, particles in MAPS:
        vessel = open_map(name)
        grid = [
            _drive(
                NoisyRig(vessel, _start(vessel, particles, seed), Noise(**TOLD), noise_rng(seed))
            )
            for seed in range(seeds)
        ]
        moves = np.mean([result.moves for result in grid])
        print(f"{name}, {particles} particles, grid with the stated noise: {moves:.0f} moves")
        for kind in kinds:
            for radius in RADII:
                print(_row(vessel, particles, kind, radius, seeds, float(moves)), flush=True)


def _row(
    vessel: GridWorkspace, particles: int, kind: str, radius: float, seeds: int, grid: float
) -> str:
    right, false_free, moves, alarms, rates = [], 0, [], 0, []
    clock = spent = 0.0
    for seed in range(seeds):
        start = _start(vessel, particles, seed)
        rig = PhysicsRig(vessel, start, PlantProperties.of(kind, radius=radius), noise_rng(seed))
        pushing = _timed(rig)
        result = _drive(rig)
        errors = MapErrors.of(vessel, start, result.belief)
        right.append(errors.right)
        false_free += errors.false_free
        alarms += result.status == "alarm"
        moves.append(result.moves)
        rates.append({name: rate.observed for name, rate in result.rates.items()})
        clock, spent = clock + rig.plant.clock, spent + pushing[0]
    shown = ", ".join(f"{name} {np.mean([each[name] for each in rates]):.3f}" for name in TOLD)
    return (
        f"  {kind}, radius {radius:g}: {np.mean(right):.4f} right (least {min(right):.4f}),"
        f" {false_free} walls called free, {np.mean(moves):.0f} moves ({np.mean(moves) / grid:.2f}),"
        f" {alarms} of {seeds} ended by an alarm, {shown}, {clock / spent:.0f} times its clock"
    )


def _timed(rig: PhysicsRig) -> list[float]:
    """Let the rig add up the CPU time of its plant, in the list that is returned."""
    spent, push = [0.0], rig.plant.push

    def timed(angle: float, *, seconds: float, strength: float = 1.0) -> None:
        began = time.process_time()
        push(angle, seconds=seconds, strength=strength)
        spent[0] += time.process_time() - began

    rig.plant.push = timed  # type: ignore[method-assign]
    return spent


def _start(vessel: GridWorkspace, particles: int, seed: int) -> np.ndarray:
    return place(vessel, particles, "uniform", trial_rng(seed))


def _drive(rig: Rig) -> Drive:
    return drive(rig, policy="closest-frontier", **TOLD)


def pulling_field() -> tuple[float, float, float]:
    """Return the weakest and the strongest gradient across the field of view, over that in the
    middle, and the angle at its edges, for a coil at 6.7 times the width of the view.

    A coil far away acts as a dipole, |B| ~ sqrt(1 + 3 cos(t)^2) / r^3, and pulls a particle that is
    aligned with its field by the gradient of |B|: ~ r^-4 on the axis, and at a small angle t from
    the axis in a direction 1.25 t from it.
    """
    distance = 6.7
    weakest, strongest = ((distance + 0.5) / distance) ** -4, ((distance - 0.5) / distance) ** -4
    return weakest, strongest, float(np.degrees(1.25 * np.arctan(0.5 / distance)))


def rolling_field(reach: float = 0.23) -> tuple[float, float]:
    """Return the largest deviation of magnitude and of angle (degrees) of the field of two Helmholtz
    coils of radius 1, within a distance ``reach`` from the middle.
    """
    angles = np.linspace(0, np.pi / 2, 91)
    radius, height = np.maximum(reach * np.sin(angles), 1e-9), reach * np.cos(angles)
    middle = np.array(_coils(np.array([1e-9]), np.array([0.0])))[1, 0]
    radial, axial = _coils(radius, height)
    magnitude = np.hypot(radial, axial) / middle - 1
    return float(np.abs(magnitude).max()), float(
        np.degrees(np.arctan2(radial, axial)).__abs__().max()
    )


def _coils(radius: np.ndarray, height: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the radial and axial field of two current loops at z = -1/2 and 1/2 (Biot-Savart, in
    elliptic integrals), up to a constant.
    """
    radial, axial = np.zeros_like(radius), np.zeros_like(radius)
    for z in (height - 0.5, height + 0.5):
        outer, inner = (1 + radius) ** 2 + z**2, (1 - radius) ** 2 + z**2
        first, second = ellipk(4 * radius / outer), ellipe(4 * radius / outer)
        axial += (first + second * (1 - radius**2 - z**2) / inner) / np.sqrt(outer)
        radial += z / radius * (-first + second * (1 + radius**2 + z**2) / inner) / np.sqrt(outer)
    return radial, axial


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--kinds", default=",".join(USUAL))
    given = parser.parse_args()
    measure(given.seeds, given.kinds.split(","))
    weakest, strongest, angle = pulling_field()
    print(
        f"a pulling coil at 6.7 widths of the view: {weakest:.2f} to {strongest:.2f} of the gradient"
        f" in the middle, {angle:.1f} degrees at the edges"
    )
    magnitude, angle = rolling_field()
    print(
        f"Helmholtz coils, within .23 of their radius: magnitude within {100 * magnitude:.2f} %,"
        f" direction within {angle:.2f} degrees"
    )


if __name__ == "__main__":
    main()
