"""Network models of the robots' radio messages. Several models can act on each message, one after another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import field, replace
from math import inf
from typing import Literal, Protocol

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Copy:
    """A copy of a message on its way: its delay, whether it is damaged, and whether it is an attacker's replay or forgery."""

    delay: float = 0.0
    damaged: bool = False
    other: Literal["", "replay", "forgery"] = ""


@dataclass(frozen=True, slots=True)
class Link:
    """The sender and the receiver of a message, the time at which it is sent, and the distance between both robots in cells."""

    sender: int
    receiver: int
    time: float
    distance: float


class Medium(Protocol):
    """A model that delays, loses, changes or multiplies the copies of a message."""

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies of a message that the model lets through."""
        ...


@dataclass(frozen=True)
class Loss:
    """Each copy of a message is lost with the same probability. One minus this probability is P_c of paper H."""

    probability: float

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies of a message that the model lets through."""
        return [copy for copy in copies if rng.random() >= self.probability]


@dataclass
class Bursts:
    """Gilbert and Elliott's model: each link is good or bad, and a bad link loses every message.

    Parameters
    ----------
    worsen, mend : float
        Probability per message that a good link becomes bad, and that a bad link becomes good.
    """

    worsen: float
    mend: float
    bad: dict[tuple[int, int], bool] = field(default_factory=dict)

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies of a message that the model lets through."""
        key = (link.sender, link.receiver)
        was = self.bad.get(key, False)
        self.bad[key] = rng.random() >= self.mend if was else rng.random() < self.worsen
        return [] if self.bad[key] else copies


@dataclass(frozen=True)
class Range:
    """Messages are lost beyond a distance given in cells."""

    cells: float

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies of a message that the model lets through."""
        return copies if link.distance <= self.cells else []


@dataclass(frozen=True)
class Partition:
    """During a time interval, no messages pass between robots with even numbers and robots with odd numbers."""

    since: float = 0.0
    until: float = inf

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies of a message that the model lets through."""
        apart = (link.sender - link.receiver) % 2 and self.since <= link.time < self.until
        return [] if apart else copies


@dataclass(frozen=True)
class Delay:
    """The delay of each copy is random, up to twice the mean. Therefore later messages may overtake earlier ones."""

    mean: float

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies of a message that the model lets through."""
        return [replace(copy, delay=copy.delay + 2 * self.mean * float(rng.random())) for copy in copies]


@dataclass(frozen=True)
class Duplicates:
    """With a probability, a copy arrives a second time, with an additional delay of at most the time for one cell."""

    probability: float

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies of a message that the model lets through."""
        again = [replace(copy, delay=copy.delay + float(rng.random())) for copy in copies if rng.random() < self.probability]
        return copies + again


@dataclass(frozen=True)
class Corruption:
    """With a probability, a copy is damaged on the way."""

    probability: float

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies of a message that the model lets through."""
        return [replace(copy, damaged=copy.damaged or rng.random() < self.probability) for copy in copies]


@dataclass(frozen=True)
class Replays:
    """With a probability for each message, an attacker sends a recorded message of any robot again."""

    probability: float

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies of a message that the model lets through."""
        return [*copies, Copy(other="replay")] if rng.random() < self.probability else copies


@dataclass(frozen=True)
class Forgeries:
    """With a probability for each message, an attacker without the key sends a message in the name of a robot.

    The attacker's message declares that all cells are searched.
    """

    probability: float

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies of a message that the model lets through."""
        return [*copies, Copy(other="forgery")] if rng.random() < self.probability else copies


@dataclass(frozen=True)
class RadioNetwork:
    """A sequence of network models. Each message passes through all models in order.

    Without models, every message arrives without delay.
    """

    media: tuple[Medium, ...] = ()

    def send(self, link: Link, rng: Generator) -> list[Copy]:
        """Return the copies of a message that arrive at the receiver."""
        copies = [Copy()]
        for medium in self.media:
            copies = medium.carry(copies, link, rng)
            if not copies:
                break
        return copies


def damage(data: bytes, rng: Generator) -> bytes:
    """Return a message in which one to three random bytes are changed."""
    array: NDArray[np.uint8] = np.frombuffer(data, dtype=np.uint8).copy()
    places = rng.integers(0, len(array), size=int(rng.integers(1, 4)))
    array[places] ^= rng.integers(1, 256, size=len(places)).astype(np.uint8)
    return array.tobytes()


_KINDS: dict[str, tuple[Callable[..., Medium], str, Sequence[tuple[float, float]]]] = {
    "loss": (Loss, "P", [(0, 1)]),
    "bursts": (Bursts, "WORSEN:MEND", [(0, 1), (0, 1)]),
    "range": (Range, "CELLS", [(0, inf)]),
    "partition": (Partition, "SINCE:UNTIL", [(0, inf), (0, inf)]),
    "delay": (Delay, "MEAN", [(0, inf)]),
    "duplicates": (Duplicates, "P", [(0, 1)]),
    "corruption": (Corruption, "P", [(0, 1)]),
    "replays": (Replays, "P", [(0, 1)]),
    "forgeries": (Forgeries, "P", [(0, 1)]),
}


def network_of(text: str = "", *, loss: float = 0.0) -> RadioNetwork:
    """Return the network that a text describes: models with their parameters, separated by commas.

    Parameters
    ----------
    text : str
        ``loss:P``, ``bursts:WORSEN:MEND``, ``range:CELLS``, ``partition:SINCE:UNTIL``, ``delay:MEAN``, ``duplicates:P``,
        ``corruption:P``, ``replays:P`` and ``forgeries:P``. Times are in units of the time that a robot of speed 1 needs for one
        cell. With the text "" or "perfect", every message arrives without delay.
    loss : float
        Additional probability that a message is lost.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> network_of("range:8,delay:0.5", loss=0.1).media
    (Loss(probability=0.1), Range(cells=8.0), Delay(mean=0.5))
    """
    if not 0 <= loss <= 1:
        raise InvalidInputError(f"loss: expected a probability from 0 to 1, got {loss!r}")
    media: list[Medium] = [Loss(loss)] if loss else []
    for part in filter(None, (piece.strip() for piece in text.split(","))):
        name, *words = part.split(":")
        if name == "perfect" and not words:
            continue
        try:
            make, _, limits = _KINDS[name]
            numbers = [float(word) for word in words]
            if len(numbers) != len(limits) or not all(low <= n <= high for n, (low, high) in zip(numbers, limits, strict=True)):
                raise ValueError
        except (KeyError, ValueError):
            known = ", ".join(":".join((kind, shape)) for kind, (_, shape, _) in _KINDS.items())
            raise InvalidInputError(f"network: expected perfect or some of {known}, got {part[:60]!r}") from None
        media.append(make(*numbers))
    return RadioNetwork(tuple(media))
