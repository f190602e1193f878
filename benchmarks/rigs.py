"""Rigs: how right maps stay when particles disappear, how often an honest rig is accused, and how
often a liar is found.

python -m benchmarks.rigs            20 drives for each row
python -m benchmarks.rigs --seeds 100
python -m benchmarks.rigs --only small --seeds 2    lies now and then and early losses, small maps
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from shoal import GridWorkspace, open_map
from shoal.rigs import Drive, NoisyRig, drive
from shoal.swarm.grid.tasks import place
from shoal.swarm.noise import Noise

NOISES = (
    Noise(0.05, 0.01, 0),
    Noise(0.05, 0.01, 0.05),
    Noise(0.2, 0.05, 0.1),
    Noise(0.1, 0.02, 0.3),
)
PLACES = (("maze:21x15", 8), ("cave:24x18", 20), ("vessels:300", 20), ("vessels:1000", 100))
CONFIDENCE = 0.99
MOST_MOVES = 3000


class LosingRig(NoisyRig):
    """A rig with noise from which particles disappear: one for good, or one every so many moves."""

    def __init__(
        self,
        *arguments: Any,
        at: int | None = None,
        every: int | None = None,
        luck: int | None = None,
    ) -> None:
        super().__init__(*arguments)
        self._at, self._every, self._sent = at, every, 0
        self._luck = np.random.default_rng(len(self.observe()) if luck is None else luck)

    def _move(self, command: str) -> None:
        super()._move(command)
        self._sent += 1
        if self._sent == self._at or (self._every and self._sent % self._every == 0):
            there = np.flatnonzero(self._noisy.state.occupied)
            if len(there):
                self._noisy.state.occupied[self._luck.choice(there)] = False


LIES: dict[str, Callable[[int, str], str]] = {
    "dead magnet": lambda sent, command: "",
    "dies after 40 moves": lambda sent, command: "" if sent > 40 else command,
    "columns inverted": lambda sent, command: {"l": "r", "r": "l"}.get(command, command),
    "both axes inverted": lambda sent, command: {"l": "r", "r": "l", "u": "d", "d": "u"}[command],
    "quarter turn": lambda sent, command: {"l": "u", "u": "l", "r": "d", "d": "r"}[command],
    "every command twice": lambda sent, command: 2 * command,
    "drifts down every third move": lambda sent, command: command + "d" * (sent % 3 == 0),
}


class LyingRig(NoisyRig):
    """A rig with noise that carries out other commands than it gets."""

    def __init__(self, *arguments: Any, lie: Callable[[int, str], str]) -> None:
        super().__init__(*arguments)
        self._lie, self._sent = lie, 0

    def _move(self, command: str) -> None:
        self._sent += 1
        for letter in self._lie(self._sent, command):
            super()._move(letter)


def driven(
    kind: type[NoisyRig], name: str, particles: int, noise: Noise, seed: int, **lie: Any
) -> tuple[Drive, int, int]:
    """Return one drive, and the numbers of wrong and of classified cells."""
    workspace = open_map(f"{name}:{seed}")
    start = place(workspace, particles, "uniform", np.random.default_rng([seed, 1]))
    rig = kind(workspace, start, noise, np.random.default_rng([seed, 2]), **lie)
    fields: dict[str, Any] = dict(vars(noise)) | {
        "confidence": CONFIDENCE,
        "max_moves": MOST_MOVES,
        "policy": "closest-frontier",
    }
    result = drive(rig, seed=seed, **fields)
    return result, sum(result.compared(workspace).values()), len(result.belief.known)


def measure_losses(seeds: int) -> int:
    """Print the share of wrong cells when particles disappear; return how many rows exceed what the
    confidence promises.
    """
    broken = 0
    print(
        f"wrong cells of the classified ones, confidence {CONFIDENCE}, and drives that say a loss:"
        " no loss, one particle after 20 moves, one after 60 moves, one every 10 moves"
    )
    for name, particles in PLACES:
        for noise in NOISES:
            shares, said = [], []
            for loss in ({}, {"at": 20}, {"at": 60}, {"every": 10}):
                drives = [
                    driven(LosingRig, name, particles, noise, seed, **loss) for seed in range(seeds)
                ]
                shares.append(
                    sum(wrong for _, wrong, _ in drives) / sum(known for *_, known in drives)
                )
                said.append(
                    sum(
                        any(alarm.kind == "number" for alarm in result.alarms)
                        for result, *_ in drives
                    )
                )
            broken += sum(share > 1 - CONFIDENCE for share in shares)
            told = "  ".join(
                f"{100 * share:.3f} % ({number})"
                for share, number in zip(shares, said, strict=True)
            )
            print(
                f"  {name}, {particles} particles, {told_noise(noise)}: {told}  of {seeds} drives",
                flush=True,
            )
    return broken


def measure_honesty(seeds: int) -> int:
    """Print how often an honest rig raises an alarm; return the number of drives that were stopped
    by one.
    """
    alarms: Counter[str] = Counter()
    stopped = drives = 0
    for name, particles in PLACES:
        for noise in NOISES:
            for seed in range(seeds):
                result, *_ = driven(NoisyRig, name, particles, noise, seed)
                drives += 1
                stopped += result.status == "alarm"
                alarms.update(alarm.kind for alarm in result.alarms)
    print(
        f"honest rigs: {drives} drives, {stopped} stopped by an alarm, marks {dict(alarms)}",
        flush=True,
    )
    return stopped


def measure_lies(seeds: int) -> int:
    """Print how often each lie is found; return the number of lies that gave a map which is
    complete and has no alarm.
    """
    missed = 0
    for lie, carried_out in LIES.items():
        kinds: Counter[str] = Counter()
        silent = drives = 0
        for name, particles in PLACES[:3]:
            for noise in NOISES:
                for seed in range(seeds):
                    result, *_ = driven(LyingRig, name, particles, noise, seed, lie=carried_out)
                    drives += 1
                    kinds.update(
                        {alarm.kind for alarm in result.alarms} or {f"none, {result.status}"}
                    )
                    silent += bool(result) and not result.alarms
        missed += silent
        print(
            f"{lie}: {drives} drives, {silent} complete without an alarm; {dict(kinds)}", flush=True
        )
    return missed


SMALL_PLACES = (("room", 3), ("maze:9x7", 4), ("cave:12x9:1", 6))
SMALL_NOISES = (Noise(0.1, 0.02, 0.1), Noise(0.02, 0.05, 0), Noise(0.05, 0, 0.02))
OTHER_NOISES = (Noise(0.1, 0.02, 0.3), Noise(0.4, 0, 0), Noise(0.2, 0.05, 0.1))
LOSING_PLACES = (("cave:16x12", 8), ("maze:15x11", 4), ("vessels:300", 12))
LOST_AT = (5, 8, 12, 16, 20, None)
TURNED = dict(zip("lurd", "urdl", strict=True))


class SometimesLyingRig(NoisyRig):
    """A rig with noise that carries out every so many commands in another way."""

    def __init__(self, *arguments: Any, lie: str, every: int) -> None:
        super().__init__(*arguments)
        self._lie, self._every, self._sent, self._held = lie, every, 0, ""

    def _move(self, command: str) -> None:
        self._sent += 1
        carried_out = self._held + command
        self._held = ""
        if self._lie and self._sent % self._every == 0:
            if self._lie == "late":
                self._held, carried_out = carried_out, ""
            else:
                carried_out = {"dropped": "", "twice": 2 * command, "turned": TURNED[command]}[
                    self._lie
                ]
        for letter in carried_out:
            super()._move(letter)


def driven_in_small(
    place_: tuple[str, int], noise: Noise, seed: int, lie: str, every: int
) -> Drive:
    """Return one drive in a small map."""
    name, particles = place_
    workspace = GridWorkspace(np.ones((5, 7))) if name == "room" else open_map(name)
    start = place(workspace, particles, "uniform", np.random.default_rng(seed))
    rig = SometimesLyingRig(
        workspace, start, noise, np.random.default_rng(seed), lie=lie, every=every
    )
    return drive(rig, **vars(noise), policy="closest-frontier", max_moves=800)


def driven_with_loss(name: str, particles: int, noise: Noise, seed: int, lost: int | None) -> Drive:
    """Return one drive of a rig that loses a particle at a move."""
    workspace = open_map(name)
    start = place(workspace, particles, "uniform", np.random.default_rng([seed, 1]))
    scans = np.random.default_rng([seed, 2, lost or 0])
    rig = LosingRig(workspace, start, noise, scans, at=lost, luck=1)
    return drive(rig, **vars(noise), policy="closest-frontier", max_moves=600)


def measure_small(seeds: int) -> int:
    """Print how often lies now and then, and losses within the first moves, pass without an alarm,
    and how often honest rigs are accused; return the number of accusations.
    """
    for lie in ("twice", "dropped", "turned", "late"):
        passed = {}
        for every in range(3, 11):
            levels = [
                driven_in_small(at, noise, seed, lie, every).trust.level
                for at in SMALL_PLACES
                for noise in SMALL_NOISES
                for seed in range(1, seeds + 1)
            ]
            passed[every] = levels.count("high")
        print(f"{lie}, every 3rd to 10th command: trust high {passed} of {len(levels)}", flush=True)
    accused = 0
    for noise in (OTHER_NOISES[0], SMALL_NOISES[0]):
        said: Counter[int | None] = Counter()
        for lost in LOST_AT:
            for name, particles in LOSING_PLACES:
                for seed in range(2 * seeds):
                    result = driven_with_loss(f"{name}:{seed}", particles, noise, seed, lost)
                    said[lost] += any(alarm.kind == "number" for alarm in result.alarms)
        accused += said[None]
        print(
            f"{told_noise(noise)}: losses said, by the move of the loss {dict(said)} of"
            f" {6 * seeds}",
            flush=True,
        )
    alarms: Counter[str] = Counter()
    drives = 0
    for at in (*SMALL_PLACES, ("maze:15x11:1", 2), ("cave:16x12:2", 12), ("room", 1)):
        for noise in (*SMALL_NOISES, *OTHER_NOISES):
            for seed in range(100, 100 + 7 * seeds // 2):
                drives += 1
                alarms.update(
                    alarm.kind for alarm in driven_in_small(at, noise, seed, "", 1).alarms
                )
    print(f"honest rigs: {drives} drives, alarms {dict(alarms)}", flush=True)
    return accused + alarms.total()


def told_noise(noise: Noise) -> str:
    """Return the rates of a noise as a text."""
    return ", ".join(f"{name} {rate:g}" for name, rate in vars(noise).items())


def main() -> int:
    """Measure, and return 1 if a promise is broken."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--only", choices=("losses", "honesty", "lies", "small"))
    given = parser.parse_args()
    parts = {"losses": measure_losses, "honesty": measure_honesty, "lies": measure_lies}
    parts["small"] = measure_small
    broken = [part(given.seeds) for name, part in parts.items() if given.only in (None, name)]
    return int(any(broken))


if __name__ == "__main__":
    sys.exit(main())
