"""Small worlds whose sets of cells are integers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray


class SmallWorld:
    """A small world in which each set of cells is an integer with one bit per cell."""

    def __init__(self, free: NDArray[np.bool_], offsets: NDArray[np.int64], rule: str) -> None:
        self.free, self.offsets, self.rule = self.number(free), offsets.tolist(), rule

    @staticmethod
    def number(mask: NDArray[np.bool_]) -> int:
        """Return a mask of cells as an integer with one bit per cell."""
        return int.from_bytes(np.packbits(mask, bitorder="little").tobytes(), "little")

    @staticmethod
    def shifted(cells: int, offset: int) -> int:
        """Return a set of cells, shifted by a number of bits."""
        return cells << offset if offset > 0 else cells >> -offset

    def push(self, particles: int, command: int, free: int | None = None) -> int:
        """Return the cells that hold particles after a push by at most one cell."""
        offset = self.offsets[command]
        moving = particles & self.shifted(self.free if free is None else free, -offset)
        staying = particles & ~moving
        while self.rule != "merge":
            blocked = moving & self.shifted(staying, -offset)
            if not blocked:
                break
            staying |= blocked
            moving &= ~blocked
        return staying | self.shifted(moving, offset)

    def step(self, particles: int, remaining: int, command: int, mapping: bool) -> tuple[int, int]:
        """Return the cells that hold particles after one command, and the cells that stay
        unclassified of ``remaining``. Under the rule tilt, a command is pushes until all stop.
        """
        while True:
            after = self.push(particles, command)
            remaining &= ~(
                after | (self.shifted(particles, self.offsets[command]) if mapping else 0)
            )
            if self.rule != "tilt" or after == particles:
                return after, remaining
            particles = after

    def reached_by(self, particles: int) -> int:
        """Return all cells with a path from a particle, and the walls beside these cells."""
        reached = particles
        while True:
            around = reached
            for offset in self.offsets:
                around |= self.shifted(reached, offset)
            if around & self.free == reached:
                return around
            reached = around & self.free


def set_bits(number: int) -> Iterator[int]:
    """Yield the index of each 1 bit in an integer."""
    while number:
        low = number & -number
        yield low.bit_length() - 1
        number ^= low
