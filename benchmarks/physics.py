"""Mapping on physical plants: python -m benchmarks.physics [--seeds N] [--eye-seeds N] [--store FILE]

Three first drives of each plant with generous rates show its errors. All other drives are told half
of them, while the camera shows one ghost a picture. One row of a table for each map, kind of plant and
radius: the share of cells classified rightly, walls called free, moves over those of the grid with
the noise that is told and over those of the exact grid (same policy, same starts; each under the
rules block and merge, because particles that are small for their cells share them), drives that an
alarm ended and drives with another alarm than that of a rate, and how much faster than the plant's
own clock it runs (CPU time). With --store, the file keeps what came of each drive: a run that was
interrupted goes on, and one with more seeds adds to it. The last lines compute the field of a pulling coil and of a pair of
Helmholtz coils, from which the usual values come.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from scipy.special import ellipe, ellipk

from shoal import GridWorkspace, open_map
from shoal.rigs import Drive, NoisyRig, Rig, SimulatedRig, drive
from shoal.rigs.physics import TOLD, USUAL, PhysicsRig, PlantProperties
from shoal.swarm.grid.board import noise_rng, trial_rng
from shoal.swarm.grid.tasks import place
from shoal.swarm.maps.imaging import find_vessels, map_of_vessels
from shoal.swarm.maps.imaging.samples import retina
from shoal.swarm.noise import MapErrors, Noise

MAPS = (("vessels:300", 20), ("vessels:1000", 100), ("eye", 300))
RADII = (0.35, 0.15)
GHOSTS = 1.0  # a picture
MOST = 4000  # moves
STEPS = {"l": (0, -1), "u": (-1, 0), "r": (0, 1), "d": (1, 0)}
FIRST = (1000, 1001, 1002)  # seeds of the drives that show the errors
HEADER = (
    "| map, particles | kind | radius | told slip, misplace | right (least) | walls called free |"
    " moves | over the grid's told, rules block and merge | over the exact grid's | ended by an alarm | other alarms |"
    " times its clock |"
)


def measure(seeds: dict[str, int], kinds: list[str], kept: Results) -> None:
    """Print a row for each map, kind and radius."""
    print(HEADER + "\n" + "|---" * (HEADER.count("|") - 1) + "|", flush=True)
    for name, particles in MAPS:
        if not seeds[name]:
            continue
        vessel = eye() if name == "eye" else open_map(name)
        starts = [_start(vessel, particles, seed) for seed in range(seeds[name])]

        def moves_on_grid(rule: str, seed: int, vessel=vessel, starts=starts) -> dict[str, float]:  # type: ignore[no-untyped-def]
            return {"moves": _drive(SimulatedRig(vessel, starts[seed], rule=rule), {}).moves}

        exact = {
            rule: np.mean(
                [
                    kept.of([name, rule, seed], partial(moves_on_grid, rule, seed))["moves"]
                    for seed in range(len(starts))
                ]
            ).item()
            for rule in ("block", "merge")
        }
        for kind in kinds:
            for radius in RADII:
                row = _row(name, vessel, starts, kind, radius, exact, kept)
                print(f"| `{name}`, {particles} | {kind} | {radius} | {row} |", flush=True)


class Results:
    """What came of each drive, by its name, in a file of JSON lines if there is one."""

    def __init__(self, path: Path | None) -> None:
        self.path, self.known = path, dict[str, dict[str, float]]()
        if path is not None and path.exists():
            for line in path.read_text().splitlines():
                key, values = json.loads(line)
                self.known[json.dumps(key)] = values

    def of(self, key: list[object], drive: Callable[[], dict[str, float]]) -> dict[str, float]:
        """Return what came of a drive, which is driven if nobody has yet."""
        name = json.dumps(key)
        if name not in self.known:
            self.known[name] = drive()
            if self.path is not None:
                with self.path.open("a") as file:
                    file.write(json.dumps([key, self.known[name]]) + "\n")
        return self.known[name]


class MergingRig:
    """A rig with slips and misplaced particles under the rule merge."""

    rule, exact = "merge", False

    def __init__(
        self, vessel: GridWorkspace, start: np.ndarray, rng: np.random.Generator, **noise: float
    ) -> None:
        self.name, self.shape, self._free = vessel.name, vessel.shape, np.pad(vessel.free, 1)
        self._cells, self._rng, self._noise = np.array(start), rng, noise

    def send(self, command: str) -> None:
        """Move each particle that does not slip and has a free cell ahead."""
        ahead = self._cells + STEPS[command]
        goes = self._rng.random(len(ahead)) >= self._noise["slip"]
        self._cells = np.where((goes & self._free[tuple(ahead.T + 1)])[:, None], ahead, self._cells)

    def observe(self) -> np.ndarray:
        """Return the cells in which particles are seen, some beside their own."""
        beside = np.array(list(STEPS.values()))[self._rng.integers(4, size=len(self._cells))]
        wrong = self._rng.random(len(beside)) < self._noise["misplace"]
        return np.unique(self._cells + wrong[:, None] * beside, axis=0)

    def stop(self) -> None:
        """Do nothing."""


def eye() -> GridWorkspace:
    """Return the map of `shoal demo`: the vessels in a photograph of an eye."""
    return GridWorkspace(map_of_vessels(find_vessels(retina()).mask), name="eye")


def _row(
    name: str,
    vessel: GridWorkspace,
    starts: list[np.ndarray],
    kind: str,
    radius: float,
    exact: dict[str, float],
    kept: Results,
) -> str:
    def plant(seed: int, start: int) -> PhysicsRig:
        properties = PlantProperties.of(kind, radius=radius, ghosts=GHOSTS)
        return PhysicsRig(vessel, starts[start], properties, noise_rng(seed))

    def first(seed: int) -> dict[str, float]:
        rates = _drive(plant(seed, seed % len(starts)), TOLD).rates
        return {what: rates[what].observed for what in ("slip", "misplace")}

    seen = [kept.of([name, kind, radius, "first", seed], partial(first, seed)) for seed in FIRST]
    told = {
        what: round(float(np.mean([one[what] for one in seen])) / 2, 3)
        for what in ("slip", "misplace")
    }

    def on_grid(rule: str, seed: int) -> dict[str, float]:
        rig: Rig = (
            NoisyRig(vessel, starts[seed], Noise(**told), noise_rng(seed))
            if rule == "block"
            else MergingRig(vessel, starts[seed], noise_rng(seed), **told)
        )
        return {"moves": _drive(rig, told).moves}

    def on_plant(seed: int) -> dict[str, float]:
        rig = plant(seed, seed)
        pushing = _timed(rig)
        result = _drive(rig, told)
        errors = MapErrors.of(vessel, starts[seed], result.belief)
        return {
            "right": errors.right,
            "false_free": errors.false_free,
            "ended": result.status == "alarm",
            "others": any(alarm.kind != "rates" for alarm in result.alarms),
            "moves": result.moves,
            "clock": rig.plant.clock,
            "spent": pushing[0],
        }

    n, about = len(starts), [name, kind, radius]
    grid = {
        rule: np.mean(
            [
                kept.of([*about, word, told, seed], partial(on_grid, rule, seed))["moves"]
                for seed in range(n)
            ]
        ).item()
        for rule, word in (("block", "grid"), ("merge", "merging grid"))
    }
    rows = [kept.of([*about, "plant", told, seed], partial(on_plant, seed)) for seed in range(n)]
    of = {what: np.array([row[what] for row in rows], dtype=float) for what in rows[0]}
    ended, mean = int(of["ended"].sum()), of["moves"].mean()
    return (
        f"{told['slip']}, {told['misplace']} | {of['right'].mean():.4f} ({of['right'].min():.4f}) |"
        f" {of['false_free'].sum():.0f} | {mean:.0f} | {mean / grid['block']:.2f}, {mean / grid['merge']:.2f} |"
        f" {mean / exact['block']:.2f}, {mean / exact['merge']:.2f} | {ended} of {n} |"
        f" {int(of['others'].sum()) - ended} of {n} | {of['clock'].sum() / of['spent'].sum():.0f}"
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


def _drive(rig: Rig, told: dict[str, float]) -> Drive:
    return drive(rig, policy="closest-frontier", max_moves=MOST, **told)


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
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--eye-seeds", type=int, help="for the largest map; as --seeds if missing")
    parser.add_argument("--kinds", default=",".join(USUAL))
    parser.add_argument("--only", help="one of the maps")
    parser.add_argument("--store", type=Path, help="JSON lines of all drives")
    given = parser.parse_args()
    seeds = {name: given.seeds * (given.only in (None, name)) for name, _ in MAPS}
    if given.eye_seeds is not None and seeds["eye"]:
        seeds["eye"] = given.eye_seeds
    measure(seeds, given.kinds.split(","), Results(given.store))
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
