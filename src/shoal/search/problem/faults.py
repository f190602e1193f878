"""Robot faults: crashes, pauses, slow motion, batteries that run out, wrong positions and lies."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import asdict, fields
from math import inf
from typing import Any, cast

from shoal.core.checks import check_integer, check_number, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Crash:
    """Fault: at the time ``time``, the robot stops for ever. After this time, it sends no messages."""

    robot: int
    time: float


@dataclass(frozen=True, slots=True)
class Pause:
    """Fault: between two times, the robot does not move, receive or send. After a pause, the robot continues where it stopped."""

    robot: int
    time: float
    until: float


@dataclass(frozen=True, slots=True)
class Slow:
    """Fault: beginning at the time ``time``, the speed of the robot is its declared speed divided by ``factor``."""

    robot: int
    factor: float
    time: float = 0.0


@dataclass(frozen=True, slots=True)
class Battery:
    """Fault: the robot stops for ever when its paths and searches since the last recharge have cost more than ``energy`` cells.

    The robot itself does not know the limit ``energy``, and plans with the endurance of its vehicle.
    """

    robot: int
    energy: float


@dataclass(frozen=True, slots=True)
class WrongPosition:
    """Fault: the robot believes that its start cell is ``off`` cells after its true start cell on the tour.

    As soon as the robot has moved to another cell, it knows its true position.
    """

    robot: int
    off: int


@dataclass(frozen=True, slots=True)
class Liar:
    """Fault: the robot does not search, but reports cells as searched, and reports false findings (paper H, footnote 5)."""

    robot: int


Fault = Crash | Pause | Slow | Battery | WrongPosition | Liar
KINDS: dict[str, type[Fault]] = {
    "crash": Crash, "pause": Pause, "slow": Slow, "battery": Battery, "wrong-position": WrongPosition, "liar": Liar,
}  # fmt: skip
_SPELLING = re.compile(r"([a-z-]+):([0-9]{1,9})(?:@([^:@]+))?(?::([^:@]+))?")


def check_faults(value: Any) -> tuple[Fault, ...]:
    """Return the fault objects that a list or a text describes.

    Each entry of the list is a fault object, or a text such as ``crash:2@30``. A text may contain several faults, separated by
    commas.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> check_faults(["crash:2@10.5,liar:3", Slow(1, 2.0)])
    (Crash(robot=2, time=10.5), Liar(robot=3), Slow(robot=1, factor=2.0, time=0.0))
    """
    if isinstance(value, str):
        value = [value]
    if not isinstance(value, list | tuple):
        raise InvalidInputError(f"faults: expected a list such as ['crash:2@30'], got {shortened(value)}")
    found: list[Fault] = []
    for entry in value:
        if not isinstance(entry, str):
            found.append(_checked(entry))
            continue
        found += [_parsed(word.strip()) for word in entry.split(",") if word.strip()]
    return tuple(found)


def fault_text(fault: Fault) -> str:
    """Return a text that describes a fault. The function `check_faults` turns the text back into the fault.

    Examples
    --------
    >>> fault_text(Pause(3, 5.0, 40.0)), fault_text(WrongPosition(1, -2))
    ('pause:3@5:40', 'wrong-position:1:-2')
    """
    kind = next(name for name, cls in KINDS.items() if isinstance(fault, cls))
    numbers = {name: str(value).removesuffix(".0") for name, value in asdict(fault).items()}
    time = f"@{numbers.pop('time')}" if "time" in numbers else ""
    return ":".join([kind, numbers.pop("robot") + time, *numbers.values()])


def _parsed(text: str) -> Fault:
    match = _SPELLING.fullmatch(text)
    kind = None if match is None else KINDS.get(match[1])
    if match is None or kind is None:
        raise InvalidInputError(
            f"faults: expected KIND:ROBOT@TIME, as in crash:2@30, with a kind of {', '.join(KINDS)}, got {text[:60]!r}"
        )
    names = [one.name for one in fields(kind)]
    values: dict[str, Any] = {"robot": int(match[2])}
    others = [name for name in names if name not in ("robot", "time")]
    try:
        for name, word in zip(["time", *others], [match[3], match[4]], strict=False):
            if word is not None:
                values[name] = int(word) if name == "off" else float(word)
        if match[4] is not None and not others:
            raise ValueError
        return _checked(kind(**values))
    except (TypeError, ValueError):
        form = f"{match[1]}:ROBOT{'@TIME' * ('time' in names)}{''.join(':' + name.upper() for name in others)}"
        raise InvalidInputError(f"faults: expected {form}, got {text[:60]!r}") from None


def _checked(fault: Any) -> Fault:
    if not isinstance(fault, tuple(KINDS.values())):
        raise InvalidInputError(f"faults: expected faults such as crash:2@30, got {shortened(fault)}")
    for name, value in asdict(cast("Fault", fault)).items():
        what = f"faults: {name}"
        if name in ("robot", "off"):
            check_integer(value, what=what, least=1 if name == "robot" else -inf)
        else:
            check_number(value, what=what, least=0)
    return cast("Fault", fault)


def true_rate(rate: float, faults: Iterable[Fault], robot: int, time: float) -> float:
    """Return the true speed of a robot at a time. After a fault `Slow`, the true speed is below the declared speed ``rate``.

    Examples
    --------
    >>> true_rate(2.0, [Slow(1, 4.0, time=10.0)], 1, 9.0), true_rate(2.0, [Slow(1, 4.0, time=10.0)], 1, 10.0)
    (2.0, 0.5)
    """
    for fault in faults:
        if isinstance(fault, Slow) and fault.robot == robot and time >= fault.time:
            rate /= fault.factor
    return rate
