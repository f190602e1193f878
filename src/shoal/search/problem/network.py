"""What fails in a search: robots that die, and a radio that loses, delays and repeats messages."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, fields, replace
from math import inf
from typing import Any, Literal, NamedTuple, cast

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.core.checks import check_integer, check_number, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Copy:
    """A copy of a message in the network: its delay, whether it is damaged, and whether an attacker
    replayed or forged it.
    """

    delay: float = 0.0
    damaged: bool = False
    other: Literal["", "replay", "forgery"] = ""


@dataclass(frozen=True, slots=True)
class Link:
    """The sender and the receiver of a message, the time of sending, and the distance from sender
    to receiver in cells.
    """

    sender: int
    receiver: int
    time: float
    distance: float


@dataclass(frozen=True)
class Medium:
    """A network model and its parameters. The model delays, loses, changes or multiplies copies of
    a message; see `network_of`.
    """

    kind: str
    numbers: tuple[float, ...]


@dataclass(frozen=True)
class RadioNetwork:
    """A sequence of network models. Each message passes through all models, one after another.

    In a network without models, every message arrives without delay.
    """

    media: tuple[Medium, ...] = ()

    def has(self, kind: str) -> bool:
        """Return whether the network contains a model of a given kind, such as "loss"."""
        return any(medium.kind == kind for medium in self.media)

    def send(self, link: Link, rng: Generator, bad: BadLinks) -> list[Copy]:
        """Return the copies of a message that arrive at the receiver.

        For each model ``bursts``, the argument ``bad`` maps the index of the model in `media` to
        the set of bad links. A link is a pair (sender, receiver). The method updates the sets.
        Before the first message, no link is bad.
        """
        copies = [Copy()]
        for number, medium in enumerate(self.media):
            own = (bad[number],) if medium.kind == "bursts" else ()
            copies = _MODELS[medium.kind].carry(copies, link, rng, *own, *medium.numbers)
            if not copies:
                break
        return copies


BadLinks = defaultdict[int, set[tuple[int, int]]]


def _loss(copies: list[Copy], link: Link, rng: Generator, probability: float) -> list[Copy]:
    return [copy for copy in copies if rng.random() >= probability]


def _bursts(
    copies: list[Copy],
    link: Link,
    rng: Generator,
    bad: set[tuple[int, int]],
    worsen: float,
    mend: float,
) -> list[Copy]:
    ends = (link.sender, link.receiver)
    is_bad = rng.random() >= mend if ends in bad else rng.random() < worsen
    (bad.add if is_bad else bad.discard)(ends)
    return [] if is_bad else copies


def _range(copies: list[Copy], link: Link, rng: Generator, cells: float) -> list[Copy]:
    return copies if link.distance <= cells else []


def _partition(
    copies: list[Copy], link: Link, rng: Generator, since: float, until: float
) -> list[Copy]:
    return [] if (link.sender - link.receiver) % 2 and since <= link.time < until else copies


def _delay(copies: list[Copy], link: Link, rng: Generator, mean: float) -> list[Copy]:
    return [replace(copy, delay=copy.delay + 2 * mean * float(rng.random())) for copy in copies]


def _duplicates(copies: list[Copy], link: Link, rng: Generator, probability: float) -> list[Copy]:
    again = [
        replace(copy, delay=copy.delay + float(rng.random()))
        for copy in copies
        if rng.random() < probability
    ]
    return copies + again


def _corruption(copies: list[Copy], link: Link, rng: Generator, probability: float) -> list[Copy]:
    return [replace(copy, damaged=copy.damaged or rng.random() < probability) for copy in copies]


def _replays(copies: list[Copy], link: Link, rng: Generator, probability: float) -> list[Copy]:
    return [*copies, Copy(other="replay")] if rng.random() < probability else copies


def _forgeries(copies: list[Copy], link: Link, rng: Generator, probability: float) -> list[Copy]:
    return [*copies, Copy(other="forgery")] if rng.random() < probability else copies


class _Model(NamedTuple):
    """A kind of network model: the function that carries messages, the names of its parameters, and
    their ranges.
    """

    carry: Callable[..., list[Copy]]
    form: str
    limits: Sequence[tuple[float, float]]


_MODELS = {
    "loss": _Model(_loss, "P", [(0, 1)]),
    "bursts": _Model(_bursts, "WORSEN:MEND", [(0, 1), (0, 1)]),
    "range": _Model(_range, "CELLS", [(0, inf)]),
    "partition": _Model(_partition, "SINCE:UNTIL", [(0, inf), (0, inf)]),
    "delay": _Model(_delay, "MEAN", [(0, inf)]),
    "duplicates": _Model(_duplicates, "P", [(0, 1)]),
    "corruption": _Model(_corruption, "P", [(0, 1)]),
    "replays": _Model(_replays, "P", [(0, 1)]),
    "forgeries": _Model(_forgeries, "P", [(0, 1)]),
}


def damage(data: bytes, rng: Generator) -> bytes:
    """Change one to three random bytes of a message, and return the damaged message."""
    array: NDArray[np.uint8] = np.frombuffer(data, dtype=np.uint8).copy()
    places = rng.integers(0, len(array), size=int(rng.integers(1, 4)))
    array[places] ^= rng.integers(1, 256, size=len(places)).astype(np.uint8)
    return array.tobytes()


def network_of(text: str = "", *, loss: float = 0.0) -> RadioNetwork:
    """Return the network that a text describes. The text lists network models with their
    parameters, separated by commas.

    - ``loss:P``: each copy of a message is lost with probability P. In paper H, P_c is the
      probability 1 - P that a copy arrives.
    - ``bursts:WORSEN:MEND``: the model of Gilbert and Elliott, in which a bad link loses every
      message. With each message, a good link becomes bad with probability WORSEN, and a bad link
      becomes good with probability MEND.
    - ``range:CELLS``: messages are lost if sender and receiver are more than CELLS cells apart.
    - ``partition:SINCE:UNTIL``: between the times SINCE and UNTIL, no message passes between a
      robot with an even number and a robot with an odd number.
    - ``delay:MEAN``: each copy of a message has a random delay, from 0 to twice the mean. A later
      message may overtake an earlier message.
    - ``duplicates:P``: with probability P, a copy of a message arrives a second time, at most one
      unit of time later.
    - ``corruption:P``: each copy of a message is damaged with probability P.
    - ``replays:P``: for each message, with probability P, an attacker sends a recorded message of
      any robot again.
    - ``forgeries:P``: for each message, with probability P, an attacker without the key sends a
      message in the name of a robot. A forged message declares that all cells are searched.

    Parameters
    ----------
    text : str
        The network models, with times in units of the time in which a robot of speed 1 searches one
        cell. With the text "" or "perfect", every message arrives without delay.
    loss : float
        Probability that a message is lost, in addition to the losses of the models in ``text``.

    Examples
    --------
    >>> network_of("range:8,delay:0.5", loss=0.1).media
    (Medium(kind='loss', numbers=(0.1,)), Medium(kind='range', numbers=(8.0,)), Medium(kind='delay', numbers=(0.5,)))
    """
    if not 0 <= loss <= 1:
        raise InvalidInputError(f"loss: expected a probability from 0 to 1, got {loss!r}")
    media = [Medium("loss", (loss,))] if loss else []
    for part in filter(None, (entry.strip() for entry in text.split(","))):
        name, *words = part.split(":")
        if name == "perfect" and not words:
            continue
        try:
            limits = _MODELS[name].limits
            numbers = tuple(float(word) for word in words)
            if len(numbers) != len(limits) or not all(
                low <= n <= high for n, (low, high) in zip(numbers, limits, strict=True)
            ):
                raise ValueError
        except (KeyError, ValueError):
            forms = ", ".join(f"{kind}:{model.form}" for kind, model in _MODELS.items())
            raise InvalidInputError(
                f"network: expected perfect or some of {forms}, got {part[:60]!r}"
            ) from None
        media.append(Medium(name, numbers))
    return RadioNetwork(tuple(media))


@dataclass(frozen=True, slots=True)
class Crash:
    """Fault: at the time ``time``, the robot stops for ever. After this time, it sends
    no messages.
    """

    robot: int
    time: float


@dataclass(frozen=True, slots=True)
class Pause:
    """Fault: between two times, the robot does not move, receive or send. After a pause, the robot
    continues where it stopped.
    """

    robot: int
    time: float
    until: float


@dataclass(frozen=True, slots=True)
class Slow:
    """Fault: beginning at the time ``time``, the speed of the robot is its declared speed divided
    by ``factor``.
    """

    robot: int
    factor: float
    time: float = 0.0


@dataclass(frozen=True, slots=True)
class Battery:
    """Fault: the robot stops for ever when its paths and searches since the last recharge have cost
    more than ``energy`` cells.

    The robot itself does not know the limit ``energy``, and plans with the endurance of its
    vehicle.
    """

    robot: int
    energy: float


@dataclass(frozen=True, slots=True)
class WrongPosition:
    """Fault: the robot believes that its start cell is ``off`` cells after its true start cell on
    the tour.

    As soon as the robot has moved to another cell, it knows its true position.
    """

    robot: int
    off: int


@dataclass(frozen=True, slots=True)
class Liar:
    """Fault: the robot does not search, but reports cells as searched, and reports false findings
    (paper H, footnote 5).
    """

    robot: int


Fault = Crash | Pause | Slow | Battery | WrongPosition | Liar
KINDS: dict[str, type[Fault]] = {
    "crash": Crash,
    "pause": Pause,
    "slow": Slow,
    "battery": Battery,
    "wrong-position": WrongPosition,
    "liar": Liar,
}
_SPELLING = re.compile(r"([a-z-]+):([0-9]{1,9})(?:@([^:@]+))?(?::([^:@]+))?")


def check_faults(value: Any) -> tuple[Fault, ...]:
    """Return the fault objects that a list or a text describes.

    Each entry of the list is a fault object, or a text such as ``crash:2@30``. A text may contain
    several faults, separated by commas.

    Examples
    --------
    >>> check_faults(["crash:2@10.5,liar:3", Slow(1, 2.0)])
    (Crash(robot=2, time=10.5), Liar(robot=3), Slow(robot=1, factor=2.0, time=0.0))
    """
    if isinstance(value, str):
        value = [value]
    if not isinstance(value, list | tuple):
        raise InvalidInputError(
            f"faults: expected a list such as ['crash:2@30'], got {shortened(value)}"
        )
    faults: list[Fault] = []
    for entry in value:
        if not isinstance(entry, str):
            faults.append(_check_fault(entry))
            continue
        faults += [_parse(word.strip()) for word in entry.split(",") if word.strip()]
    return tuple(faults)


def fault_text(fault: Fault) -> str:
    """Return a text that describes a fault. The function `check_faults` turns the text back into
    the fault.

    Examples
    --------
    >>> fault_text(Pause(3, 5.0, 40.0)), fault_text(WrongPosition(1, -2))
    ('pause:3@5:40', 'wrong-position:1:-2')
    """
    kind = next(name for name, cls in KINDS.items() if isinstance(fault, cls))
    numbers = {name: str(value).removesuffix(".0") for name, value in asdict(fault).items()}
    time = f"@{numbers.pop('time')}" if "time" in numbers else ""
    return ":".join([kind, numbers.pop("robot") + time, *numbers.values()])


def _parse(text: str) -> Fault:
    match = _SPELLING.fullmatch(text)
    kind = None if match is None else KINDS.get(match[1])
    if match is None or kind is None:
        raise InvalidInputError(
            "faults: expected KIND:ROBOT@TIME, as in crash:2@30, with a kind of"
            f" {', '.join(KINDS)}, got {text[:60]!r}"
        )
    names = [field.name for field in fields(kind)]
    values: dict[str, Any] = {"robot": int(match[2])}
    parameters = [name for name in names if name not in ("robot", "time")]
    try:
        for name, word in zip(["time", *parameters], [match[3], match[4]], strict=False):
            if word is not None:
                values[name] = int(word) if name == "off" else float(word)
        if match[4] is not None and not parameters:
            raise ValueError
        return _check_fault(kind(**values))
    except (TypeError, ValueError):
        numbers = "".join(":" + name.upper() for name in parameters)
        form = f"{match[1]}:ROBOT{'@TIME' * ('time' in names)}{numbers}"
        raise InvalidInputError(f"faults: expected {form}, got {text[:60]!r}") from None


def _check_fault(fault: Any) -> Fault:
    if not isinstance(fault, tuple(KINDS.values())):
        raise InvalidInputError(
            f"faults: expected faults such as crash:2@30, got {shortened(fault)}"
        )
    for name, value in asdict(cast("Fault", fault)).items():
        label = f"faults: {name}"
        if name in ("robot", "off"):
            check_integer(value, what=label, least=1 if name == "robot" else -inf)
        else:
            check_number(value, what=label, least=0)
    return cast("Fault", fault)


def true_rate(rate: float, faults: Iterable[Fault], robot: int, time: float) -> float:
    """Return the true speed of a robot at a time. After a fault `Slow`, the true speed is below the
    declared speed ``rate``.

    Examples
    --------
    >>> true_rate(2.0, [Slow(1, 4.0, time=10.0)], 1, 9.0), true_rate(2.0, [Slow(1, 4.0, time=10.0)], 1, 10.0)
    (2.0, 0.5)
    """
    for fault in faults:
        if isinstance(fault, Slow) and fault.robot == robot and time >= fault.time:
            rate /= fault.factor
    return rate
