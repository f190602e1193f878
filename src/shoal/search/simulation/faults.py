"""What can go wrong with a robot."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import inf

from shoal.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Crash:
    """The robot dies at a time and is never heard of again."""

    robot: int
    time: float


@dataclass(frozen=True, slots=True)
class Pause:
    """The robot neither moves, hears nor sends from one time to another, and then goes on where it was."""

    robot: int
    time: float
    until: float


@dataclass(frozen=True, slots=True)
class Slow:
    """The robot takes ``factor`` times as long as it says, from a time on."""

    robot: int
    factor: float
    time: float = 0.0


@dataclass(frozen=True, slots=True)
class Battery:
    """The robot dies when it has moved for so long since it was last recharged, whatever it believes."""

    robot: int
    energy: float


@dataclass(frozen=True, slots=True)
class WrongPosition:
    """The robot takes its start for another cell, ``off`` cells further along the tour; afterwards it knows where it is."""

    robot: int
    off: int


@dataclass(frozen=True, slots=True)
class Liar:
    """The robot does not search, but says it has, and reports what is not there (paper H, footnote 5)."""

    robot: int


Fault = Crash | Pause | Slow | Battery | WrongPosition | Liar
_KILL = re.compile(r"(\d+)@([0-9.]+(?:e[0-9]+)?)")


def crashes_of(words: list[str], *, robots: int) -> tuple[Crash, ...]:
    """Return the crashes that ``ROBOT@TIME`` words tell; robots count from 1, times are those of a cell.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> crashes_of(["2@10.5"], robots=3)
    (Crash(robot=2, time=10.5),)
    """
    found = []
    for word in words:
        match = _KILL.fullmatch(word.strip())
        if match is None or not 1 <= int(match[1]) <= robots or not float(match[2]) < inf:
            raise InvalidInputError(f"--kill: expected ROBOT@TIME with a robot from 1 to {robots}, as in 2@30, got {word[:60]!r}")
        found.append(Crash(int(match[1]), float(match[2])))
    return tuple(found)
