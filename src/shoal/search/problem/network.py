"""Models of the radio network between robots. Several models can act on a message, one after another."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf
from typing import Literal, NamedTuple

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Copy:
    """A copy of a message in the network: its delay, whether it is damaged, and whether an attacker replayed or forged it."""

    delay: float = 0.0
    damaged: bool = False
    other: Literal["", "replay", "forgery"] = ""


@dataclass(frozen=True, slots=True)
class Link:
    """The sender and the receiver of a message, the time of sending, and the distance from sender to receiver in cells."""

    sender: int
    receiver: int
    time: float
    distance: float


@dataclass(frozen=True)
class Medium:
    """A network model and its parameters. The model delays, loses, changes or multiplies copies of a message; see `network_of`."""

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

        For each model ``bursts``, the argument ``bad`` maps the index of the model in `media` to the set of bad links. A link is a
        pair (sender, receiver). The method updates the sets. Before the first message, no link is bad.
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


def _bursts(copies: list[Copy], link: Link, rng: Generator, bad: set[tuple[int, int]], worsen: float, mend: float) -> list[Copy]:
    ends = (link.sender, link.receiver)
    is_bad = rng.random() >= mend if ends in bad else rng.random() < worsen
    (bad.add if is_bad else bad.discard)(ends)
    return [] if is_bad else copies


def _range(copies: list[Copy], link: Link, rng: Generator, cells: float) -> list[Copy]:
    return copies if link.distance <= cells else []


def _partition(copies: list[Copy], link: Link, rng: Generator, since: float, until: float) -> list[Copy]:
    return [] if (link.sender - link.receiver) % 2 and since <= link.time < until else copies


def _delay(copies: list[Copy], link: Link, rng: Generator, mean: float) -> list[Copy]:
    return [replace(copy, delay=copy.delay + 2 * mean * float(rng.random())) for copy in copies]


def _duplicates(copies: list[Copy], link: Link, rng: Generator, probability: float) -> list[Copy]:
    again = [replace(copy, delay=copy.delay + float(rng.random())) for copy in copies if rng.random() < probability]
    return copies + again


def _corruption(copies: list[Copy], link: Link, rng: Generator, probability: float) -> list[Copy]:
    return [replace(copy, damaged=copy.damaged or rng.random() < probability) for copy in copies]


def _replays(copies: list[Copy], link: Link, rng: Generator, probability: float) -> list[Copy]:
    return [*copies, Copy(other="replay")] if rng.random() < probability else copies


def _forgeries(copies: list[Copy], link: Link, rng: Generator, probability: float) -> list[Copy]:
    return [*copies, Copy(other="forgery")] if rng.random() < probability else copies


class _Model(NamedTuple):
    """A kind of network model: the function that carries messages, the names of its parameters, and their ranges."""

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
    """Return the network that a text describes. The text lists network models with their parameters, separated by commas.

    - ``loss:P``: each copy of a message is lost with probability P. In paper H, P_c is the probability 1 - P that a copy arrives.
    - ``bursts:WORSEN:MEND``: the model of Gilbert and Elliott, in which a bad link loses every message. With each message, a good
      link becomes bad with probability WORSEN, and a bad link becomes good with probability MEND.
    - ``range:CELLS``: messages are lost if sender and receiver are more than CELLS cells apart.
    - ``partition:SINCE:UNTIL``: between the times SINCE and UNTIL, no message passes between a robot with an even
      number and a robot with an odd number.
    - ``delay:MEAN``: each copy of a message has a random delay, from 0 to twice the mean. A later message may overtake an earlier
      message.
    - ``duplicates:P``: with probability P, a copy of a message arrives a second time, at most one unit of time later.
    - ``corruption:P``: each copy of a message is damaged with probability P.
    - ``replays:P``: for each message, with probability P, an attacker sends a recorded message of any robot again.
    - ``forgeries:P``: for each message, with probability P, an attacker without the key sends a message in the name of a robot. A
      forged message declares that all cells are searched.

    Parameters
    ----------
    text : str
        The network models, with times in units of the time in which a robot of speed 1 searches one cell. With the text "" or
        "perfect", every message arrives without delay.
    loss : float
        Probability that a message is lost, in addition to the losses of the models in ``text``.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> network_of("range:8,delay:0.5", loss=0.1).media
    (Medium(kind='loss', numbers=(0.1,)), Medium(kind='range', numbers=(8.0,)), Medium(kind='delay', numbers=(0.5,)))
    """
    if not 0 <= loss <= 1:
        raise InvalidInputError(f"loss: expected a probability from 0 to 1, got {loss!r}")
    media = [Medium("loss", (loss,))] if loss else []
    for part in filter(None, (piece.strip() for piece in text.split(","))):
        name, *words = part.split(":")
        if name == "perfect" and not words:
            continue
        try:
            limits = _MODELS[name].limits
            numbers = tuple(float(word) for word in words)
            if len(numbers) != len(limits) or not all(low <= n <= high for n, (low, high) in zip(numbers, limits, strict=True)):
                raise ValueError
        except (KeyError, ValueError):
            known = ", ".join(f"{kind}:{model.form}" for kind, model in _MODELS.items())
            raise InvalidInputError(f"network: expected perfect or some of {known}, got {part[:60]!r}") from None
        media.append(Medium(name, numbers))
    return RadioNetwork(tuple(media))
