"""Drives with other tasks than mapping, and wrong rigs: python -m benchmarks.tasks [--seeds N]

- plant: coverage of a vessel and a particle brought to a random cell of it, on physical plants whose
  error rates nobody states; beside it the moves in the grid with the noise that is then told.
- known: moves of a mapping under noise with and without a map that is known.
- wrong: at which command a wrong rig is named, and honest rigs that are accused.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

import numpy as np

from shoal import GridWorkspace, open_map
from shoal.rigs import Drive, NoisyRig, Rig, drive
from shoal.rigs.physics import TOLD, PhysicsRig, PlantProperties
from shoal.swarm.grid.board import noise_rng
from shoal.swarm.grid.tasks import place
from shoal.swarm.noise import Noise

KINDS = ("roll", "pull")
RADII = (0.35, 0.15)
FIELDS: dict[str, Any] = {"policy": "closest-frontier", "max_moves": 5000}
LETTERS = "lurd"


def _start(vessel: GridWorkspace, particles: int, seed: int) -> Any:
    return place(vessel, particles, "uniform", np.random.default_rng([seed, 1]))


def _rig(vessel: GridWorkspace, particles: int, seed: int, kind: str, **about: float) -> Rig:
    start = _start(vessel, particles, seed)
    if kind == "grid":
        return NoisyRig(vessel, start, Noise(**TOLD), noise_rng(seed))
    return PhysicsRig(vessel, start, PlantProperties.of(kind, **about), noise_rng(seed))


def measure_plants(seeds: int) -> None:
    """Print a row for each task, number of particles, kind of plant and radius."""
    vessel = open_map("vessels:300")
    for task, particles in (("coverage", 20), ("coverage", 100), ("target", 20)):
        for kind in ("grid", *KINDS):
            for radius in RADII if kind != "grid" else (0.5,):
                driven = []
                for seed in range(seeds):
                    rng = np.random.default_rng([seed, 2])
                    cell = tuple(vessel.cells[rng.integers(vessel.n_free)].tolist())
                    goal: dict[str, Any] = {"task": task} if task == "coverage" else {}
                    goal |= {"target": (cell,)} if task == "target" else {}
                    about = {"radius": radius} if kind != "grid" else {}
                    rig = _rig(vessel, particles, seed, kind, **about)
                    stated = TOLD if kind == "grid" else {}
                    driven.append(drive(rig, known=vessel, **goal, **stated, **FIELDS))
                size = "" if kind == "grid" else f", radius {radius:g}"
                print(f"{task}, {particles} particles, {kind}{size}: {_shown(driven)}", flush=True)


def _shown(driven: list[Drive]) -> str:
    moves = np.mean([each.moves for each in driven])
    kinds = sorted({alarm.kind for each in driven for alarm in each.alarms})
    done = sum(map(bool, driven))
    return f"{done} of {len(driven)} complete, {moves:.0f} moves, alarms {kinds or 'none'}"


def measure_known(seeds: int) -> None:
    """Print the mean number of moves of a mapping, with and without a known map."""
    vessel = open_map("vessels:300")
    for known in (None, vessel):
        driven = [
            drive(_rig(vessel, 20, seed, "grid"), known=known, **TOLD, **FIELDS)
            for seed in range(seeds)
        ]
        wrong = sum(sum(each.compared(vessel).values()) for each in driven)
        print(
            f"mapping with {'the' if known else 'no'} known map: {_shown(driven)},"
            f" {wrong} wrong cells",
            flush=True,
        )


Act = Callable[[int, str], str]
WRONG: dict[str, tuple[str, str, Act | None]] = {
    "honest": ("", "", lambda n, letter: letter),
    "dead l": ("still", "'l'", lambda n, letter: "" if letter == "l" else letter),
    "dead u": ("still", "'u'", lambda n, letter: "" if letter == "u" else letter),
    "dead r": ("still", "'r'", lambda n, letter: "" if letter == "r" else letter),
    "dead d": ("still", "'d'", lambda n, letter: "" if letter == "d" else letter),
    "frozen camera": ("still", "old picture", None),
    "swapped axes": ("direction", "swapped", lambda n, letter: "uldr"[LETTERS.index(letter)]),
    "mirrored": ("direction", "mirrored", lambda n, letter: "ruld"[LETTERS.index(letter)]),
    "upside down": ("direction", "mirrored", lambda n, letter: "ldru"[LETTERS.index(letter)]),
    "every second command": ("commands", "half speed", lambda n, letter: letter if n % 2 else ""),
    "half a cell": ("commands", "half speed", lambda n, letter: letter),
}


class WrongRig:
    """A rig that carries out other commands than it gets, or whose camera is frozen (None)."""

    exact, rule = False, "block"

    def __init__(self, rig: Rig, act: Act | None) -> None:
        self._rig, self._act, self.name, self.shape = rig, act, rig.name, rig.shape
        self._sent, self._first = 0, rig.observe()

    def send(self, command: str) -> None:
        """Carry out a command, or another one."""
        self._sent += 1
        done = command if self._act is None else self._act(self._sent, command)
        if done:
            self._rig.send(done)

    def observe(self) -> Any:
        """Return the cells of the particles, now or at the start."""
        return self._first if self._act is None else self._rig.observe()

    def stop(self) -> None:
        """Stop the rig."""
        self._rig.stop()


def measure_wrong(seeds: int) -> int:
    """Print how often each wrong rig is named, and after how many commands at most; return how
    often one was not, or an honest one was accused.
    """
    failures = 0
    for wrong, (sort, word, act) in WRONG.items():
        named, latest, drives = 0, 0, 0
        for particles, name in ((20, "vessels:300"), (100, "vessels:1000"), (300, "vessels:1000")):
            for kind in ("grid", *KINDS):
                if wrong == "half a cell" and kind == "grid":
                    continue
                for seed in range(seeds):
                    about = {"length": 0.5} if wrong == "half a cell" else {}
                    rig = WrongRig(_rig(open_map(name), particles, seed, kind, **about), act)
                    stated = TOLD if kind == "grid" else {}
                    fields = FIELDS | {"max_moves": 10}
                    result = drive(rig, **stated, **fields)
                    first = next(iter(result.alarms), None)
                    if sort:
                        right = first is not None and first.kind == sort and word in first.text
                        latest = max(latest, 0 if first is None else first.move)
                    else:
                        right = result.status != "alarm"
                    named, drives = named + right, drives + 1
        failures += drives - named
        told = "not accused" if not sort else f"named after at most {latest} commands"
        print(f"{wrong}: {named} of {drives} {told}", flush=True)
    return failures


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--only", choices=("plant", "known", "wrong"))
    given = parser.parse_args()
    parts = {"plant": measure_plants, "known": measure_known, "wrong": measure_wrong}
    for name, part in parts.items():
        if given.only in (None, name):
            part(given.seeds)


if __name__ == "__main__":
    main()
