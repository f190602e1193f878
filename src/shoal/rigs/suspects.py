"""What may be wrong with a rig, tested with its first commands: each suspicion is a model of what the
rig does instead, and the scans say which model explains them best.

A coil that does nothing, a camera that shows an old picture, exchanged axes, a mirrored picture and
pulses that move only half a cell give a map, and a wrong one. The first test moves of a drive are
chosen so that the models differ: there and back, because a particle that has moved has a free cell
behind it, and twice in the same direction, because a particle that moves by half cells needs two.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.dataclass import dataclass
from shoal.rigs.checks import Alarm
from shoal.swarm.goals import Goal
from shoal.swarm.grid.board import Board, GridLayout, letters_of
from shoal.swarm.noise import LOSS, Noise, NoisyBelief

MOVES = 10  # commands within which what is wrong is said
PROVEN = 14.0  # log-likelihood ratio from which on a model is better than "as commanded": 10^6
CLEARED = 5.0  # the same in the other direction, from which on a model is out of the question
APART = 2.0  # the same between two suspicions, from which on the better one is named
SLIPS = (0.12, 0.2)  # of rigs that slip more often than stated, which is no suspicion
SLOW = 0.4  # about the share of particles that do not move at a command at half speed
BOX = 512  # cells along a side, of the part of a large field that is looked at
REACH = MOVES + 2  # cells around the particles of the first scan

Act = Callable[[int, str], str]
"""What a rig does at its n-th command (1, 2, ...): a letter, or "" for nothing."""


@dataclass(frozen=True, eq=False)
class Suspicion:
    """What may be wrong with a rig.

    Parameters
    ----------
    kind : str
        The kind of the alarm, or "" if nothing is wrong.
    text : str
        The alarm, for people.
    act : callable
    slip : float or None
        Share of the particles that a command does not move, if it is not the stated slip.
    dead : str
        The only command that does nothing, if there is one.
    """

    kind: str
    text: str
    act: Act
    slip: float | None = None
    dead: str = ""


def suspicions(ndim: int) -> list[Suspicion]:
    """Return what may be wrong with a rig in two or three dimensions.

    Examples
    --------
    >>> [each.text[:33] for each in suspicions(2)][:5]
    ['', '', '', 'no command moves any particle', "command 'l' moves no particle: th"]
    """
    letters = letters_of(ndim)
    suspects = [
        Suspicion("", "", lambda _, letter: letter),
        *(Suspicion("", "", lambda _, letter: letter, slip) for slip in SLIPS),
        Suspicion("still", "no command moves any particle", lambda *_: ""),
    ]
    for dead in letters:
        text = f"command {dead!r} moves no particle: this direction of the magnets does nothing"
        suspects.append(Suspicion("still", text, _drop(dead), dead=dead))
    suspects += [
        Suspicion("direction", text, _rename(dict(zip(letters, to, strict=True))))
        for to, text in _exchanges(letters)
    ]
    for parity, which in ((0, "first"), (1, "second")):
        text = f"half speed: every second command moves no particle, beginning with the {which}"
        suspects.append(Suspicion("commands", text, _every_second(parity)))
    text = (
        "half speed: each command moves only about half of the particles that have room, as if"
        " pulses moved less than a cell, or particles slip about that often"
    )
    suspects.append(Suspicion("commands", text, lambda _, letter: letter, SLOW))
    return suspects


def _drop(dead: str) -> Act:
    return lambda _, letter: "" if letter == dead else letter


def _rename(to: dict[str, str]) -> Act:
    return lambda _, letter: to[letter]


def _every_second(parity: int) -> Act:
    return lambda number, letter: letter if number % 2 == parity else ""


def _exchanges(letters: str) -> Iterator[tuple[str, str]]:
    """Yield what each of ``letters`` does if axes are mirrored or exchanged, and the text."""
    mirrors = {
        "l": ("lr", "left and right are exchanged"),
        "u": ("ud", "up and down are exchanged"),
        "i": ("io", "in and out are exchanged"),
    }
    for pair, description in mirrors.values():
        if pair[0] in letters:
            to = letters.translate(str.maketrans(pair, pair[::-1]))
            yield to, f"the picture or the magnets are mirrored: {description}"
    yield (
        letters.translate(str.maketrans("lrud", "rldu")),
        "both axes are inverted: the picture or the magnets are turned by 180 degrees",
    )
    swapped = "the axes are swapped (rows and columns exchanged)"
    yield letters.translate(str.maketrans("lurd", "uldr")), swapped
    yield letters.translate(str.maketrans("lurd", "drul")), f"{swapped} and mirrored"
    for to in ("urdl", "dlur"):
        yield (
            letters.translate(str.maketrans("lurd", to)),
            "the picture or the magnets are turned by 90 degrees: the axes are swapped, one of them"
            " inverted",
        )


class FirstMoves:
    """Follows the first commands and scans of a drive, and says what is wrong with the rig.

    For each suspicion, a belief of its own (`NoisyBelief`) predicts every scan as if the rig did
    what the suspicion says. Let L be the product of the probabilities of the scans. If the rig does
    what it is told, the ratio of the L of a suspicion to that of the stated model exceeds 10^6 with
    at most the probability 10^-6 (Ville's inequality).

    Parameters
    ----------
    shape : tuple of int
        The field of view. Of a large one, only the part around the particles is looked at.
    first_scan : ndarray of int64, shape (k, ndim)
    noise : Noise
        The stated or the usual error rates.
    goal : Goal
        A known map makes the test sharper.
    rule : str
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        first_scan: NDArray[np.int64],
        noise: Noise,
        goal: Goal,
        *,
        rule: str = "block",
    ) -> None:
        ndim = len(shape)
        letters = letters_of(ndim)
        middle = np.median(first_scan, axis=0).astype(np.int64) if len(first_scan) else 0
        low = np.maximum(0, middle - BOX // 2)
        if len(first_scan):
            low = np.maximum(low, first_scan.min(axis=0) - REACH)
        high = np.minimum(np.array(shape), low + BOX)
        if len(first_scan):
            high = np.minimum(high, np.maximum(first_scan.max(axis=0) + 1 + REACH, low + 1))
        self._low, self._shape = low, tuple((high - low).tolist())
        self._layout = GridLayout(self._shape)
        self.cycle = _cycle(letters)
        self.sent, self._times = 0, dict.fromkeys(letters, 0)
        self._frozen, self._last = True, first_scan
        self.suspicions = suspicions(ndim)
        seen = self._seen(first_scan)
        self._beliefs = []
        for suspicion in self.suspicions:
            slip = noise.slip if suspicion.slip is None else max(suspicion.slip, noise.slip)
            assumed_noise = Noise(max(slip, 1e-3), max(noise.misplace, 1e-3), max(noise.miss, 1e-3))
            options: dict[str, Any] = {"prior": self._prior(goal), "rule": rule, "loss": LOSS}
            self._beliefs.append(NoisyBelief(self._shape, seen, assumed_noise, **options))
        self.logs = np.zeros(len(self.suspicions))
        self.noise = noise

    def _prior(self, goal: Goal) -> NDArray[np.float64] | None:
        if goal.known is None:
            return None
        free = np.pad(goal.known.free, 1)
        window = tuple(
            slice(low, low + size + 2) for low, size in zip(self._low, self._shape, strict=True)
        )
        return np.where(free[window], 2.0, -2.0)

    def _seen(self, cells: NDArray[np.int64]) -> Board:
        moved = cells - self._low
        inside = ((moved >= -1) & (moved <= np.array(self._shape))).all(axis=1)
        return Board.of_cells(self._layout, moved[inside])

    def update(self, command: str, cells: NDArray[np.int64]) -> None:
        """Take one command and the scan after it into account."""
        self.sent += 1
        self._times[command] += 1
        seen = self._seen(cells)
        self._frozen = self._frozen and np.array_equal(cells, self._last)
        self._last = cells
        for i, (suspicion, belief) in enumerate(zip(self.suspicions, self._beliefs, strict=True)):
            letter = suspicion.act(self.sent, command)
            self.logs[i] += belief.weigh_scan(letter, seen)
            if letter:
                belief.update(letter, seen)
            else:
                belief.look_again(seen)

    def next(self) -> str | None:
        """Return the next test move, or None if no suspicion is left or the test is over."""
        while self.cycle:
            letter, needed = self.cycle.pop(0)
            if needed(self):
                return letter
        return None

    def cleared(self, dead: str | None = None) -> bool:
        """Return whether a command is known to move particles, or whether no suspicion is left."""
        ratios = self.logs - self._honest
        suspects = [
            i
            for i, suspicion in enumerate(self.suspicions)
            if suspicion.kind and dead in (None, suspicion.dead)
        ]
        return bool((ratios[suspects] < -CLEARED).all())

    @property
    def _honest(self) -> float:
        return float(
            max(self.logs[i] for i, suspicion in enumerate(self.suspicions) if not suspicion.kind)
        )

    def alarm(self, move: int) -> Alarm | None:
        """Return the alarm for what is wrong, or None. Among suspicions that explain the scans
        about equally well, none is named before the test is over.
        """
        order = np.argsort(self.logs)[::-1]
        best = self.suspicions[order[0]]
        if not best.kind or self.logs[order[0]] - self.logs[0] < PROVEN:
            return None
        if best.slip is not None and self.noise.slip > SLOW / 2:
            return None  # the user has said so
        if best.dead and self._times[best.dead] < 2:
            return None  # pulses of half a cell may move nothing once
        second = self.logs[order[1]]
        if self.logs[order[0]] - second < APART and self.sent < MOVES - 1:
            return None
        if best.slip is not None and self.logs[order[0]] - self._honest < APART:
            return None
        text = best.text
        if best.text == "no command moves any particle":
            text = (
                f"frozen: {self.sent + 1} scans show exactly the same cells: the camera shows an"
                " old picture, or the magnets do nothing"
                if self._frozen
                else "no command moves any particle: the magnets do nothing, or the camera shows"
                " an old picture"
            )
        return Alarm(best.kind, move, f"move {move}: {text}")


Needed = Callable[[FirstMoves], bool]


def _cycle(letters: str) -> list[tuple[str, Needed]]:
    """Return the test moves, each with the question whether it is still needed."""

    def unless(dead: str) -> Needed:
        return lambda test: not test.cleared(dead)

    def always(_: FirstMoves) -> bool:
        return True

    def open_(test: FirstMoves) -> bool:
        return not test.cleared()

    moves: list[tuple[str, Needed]] = [("l", always), ("l", always), ("r", always)]
    moves += [("r", unless("r")), ("l", unless("l"))]
    for forth, back in ("ud", "io") if "i" in letters else ("ud",):
        moves += [(forth, always), (back, always), (back, unless(back)), (forth, unless(forth))]
    moves += [(letter, open_) for letter in "rruul"]
    return moves
