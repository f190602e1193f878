"""How messages fare on the air: models that can be put one after another."""

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
    """One copy of a message on its way: how long it takes, whether it is damaged, and what another message comes in its place."""

    delay: float = 0.0
    damaged: bool = False
    other: Literal["", "replay", "forgery"] = ""


@dataclass(frozen=True, slots=True)
class Link:
    """From whom to whom a message goes, when, and how far that is, in cells."""

    sender: int
    receiver: int
    time: float
    distance: float


class Medium(Protocol):
    """What becomes of the copies of a message."""

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies that go on."""
        ...


@dataclass(frozen=True)
class Loss:
    """Each copy is lost with a probability: the paper's P_c is one minus it."""

    probability: float

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies that go on."""
        return [copy for copy in copies if rng.random() >= self.probability]


@dataclass
class Bursts:
    """Gilbert and Elliott's model: each link is good or bad, and when it is bad nothing passes.

    Parameters
    ----------
    worsen, mend : float
        Probability, each time that a message is sent, that a good link turns bad, and a bad one good.
    """

    worsen: float
    mend: float
    bad: dict[tuple[int, int], bool] = field(default_factory=dict)

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies that go on."""
        key = (link.sender, link.receiver)
        was = self.bad.get(key, False)
        self.bad[key] = rng.random() >= self.mend if was else rng.random() < self.worsen
        return [] if self.bad[key] else copies


@dataclass(frozen=True)
class Range:
    """Nothing passes farther than so many cells."""

    cells: float

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies that go on."""
        return copies if link.distance <= self.cells else []


@dataclass(frozen=True)
class Partition:
    """From one time to another nothing passes between robots with even and with odd numbers."""

    since: float = 0.0
    until: float = inf

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies that go on."""
        apart = (link.sender - link.receiver) % 2 and self.since <= link.time < self.until
        return [] if apart else copies


@dataclass(frozen=True)
class Delay:
    """Each copy takes a random time up to twice the mean, so that later ones may overtake earlier ones."""

    mean: float

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies that go on."""
        return [replace(copy, delay=copy.delay + 2 * self.mean * float(rng.random())) for copy in copies]


@dataclass(frozen=True)
class Duplicates:
    """Each copy comes a second time, a little later, with a probability."""

    probability: float

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies that go on."""
        again = [replace(copy, delay=copy.delay + float(rng.random())) for copy in copies if rng.random() < self.probability]
        return copies + again


@dataclass(frozen=True)
class Corruption:
    """Each copy is damaged on the way with a probability."""

    probability: float

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies that go on."""
        return [replace(copy, damaged=copy.damaged or rng.random() < self.probability) for copy in copies]


@dataclass(frozen=True)
class Replays:
    """With a probability, somebody sends a message again that he has recorded before, of any robot."""

    probability: float

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies that go on."""
        return [*copies, Copy(other="replay")] if rng.random() < self.probability else copies


@dataclass(frozen=True)
class Forgeries:
    """With a probability, somebody without the key sends a message under a robot's number: that all is searched."""

    probability: float

    def carry(self, copies: list[Copy], link: Link, rng: Generator) -> list[Copy]:
        """Return the copies that go on."""
        return [*copies, Copy(other="forgery")] if rng.random() < self.probability else copies


@dataclass(frozen=True)
class RadioNetwork:
    """Media that each message passes one after another; none: all arrives at once."""

    media: tuple[Medium, ...] = ()

    def send(self, link: Link, rng: Generator) -> list[Copy]:
        """Return the copies of a message that arrive."""
        copies = [Copy()]
        for medium in self.media:
            copies = medium.carry(copies, link, rng)
            if not copies:
                break
        return copies


def damage(data: bytes, rng: Generator) -> bytes:
    """Return a message with some of its bytes changed."""
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
    """Return the network that a text describes: models and their numbers, separated by commas.

    Parameters
    ----------
    text : str
        ``loss:P``, ``bursts:WORSEN:MEND``, ``range:CELLS``, ``partition:SINCE:UNTIL``, ``delay:MEAN``, ``duplicates:P``,
        ``corruption:P``, ``replays:P`` and ``forgeries:P``; times in those of a cell. "" or "perfect": all arrives at once.
    loss : float
        Probability that a message is lost, besides.

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
