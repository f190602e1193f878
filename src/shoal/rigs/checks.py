"""What a drive checks about its rig: alarms in plain words, observed error rates, and how far the
map can be trusted.

Shoal infers walls from particles that do not move. A magnet that does nothing, a camera that shows
an old picture, or an axis that is inverted therefore gives a map, and a wrong one. A drive compares
what the rig shows with what the commands must have done.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from math import log, sqrt
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import count_text
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.swarm.grid.board import Board, letters_of
from shoal.swarm.grid.scans import AXES, states_of_run
from shoal.swarm.grid.state import SwarmState
from shoal.swarm.noise.model import Noise

NOISY = "if particles slip or are observed wrongly, give the probabilities slip, misplace and miss"
Level = Literal["high", "limited", "none"]
KINDS = {
    "still": "nothing moved although it should",
    "direction": "the particles move in other directions than the commands",
    "number": "the number of particles changed",
    "outside": "a position lies outside the field of view",
    "twice": "a command was carried out or answered twice",
    "drift": "the particles move without a command",
    "rule": "a position does not follow from the command and the known free cells",
    "rates": "the observed rates of errors are far from the stated rates",
    "stop": "the rig has not confirmed the stop command",
    "failure": "the rig does not answer, or reports an error",
}
"""The kinds of alarms, and what each kind means."""
CRITICAL = 1e-9  # probability under the stated rates from which on the rates cannot be true
# probability of what scans show, if a command moved nothing, from which on the command moves
# particles
DEMONSTRATED = 1e-3
PLAUSIBLE = (
    7.0  # logarithm of the likelihood ratio up to which a cell may still hold a particle at rest
)
# upper bound of the probability of the motions by two cells from which on they mark the result
LEAPING = 1e-2
# probability that all particles are there, but no scan shows all of them, from which on one is gone
GONE = 1e-4
SIGMAS = 4.0  # standard deviations from which on a motion is established
INTERVAL_SIGMAS = 3.29  # of a 99.9 % interval
FEW = 30  # observations from which on a rate is judged
WINDOW, LEAST = (
    30,
    8,
)  # scans over which a number of particles is averaged, and the fewest on each side of a change
# standard errors from which the number of particles has changed, at the most likely of all moments
CHANGE = 4.0
SURE, EMPTY = (
    0.9,
    0.1,
)  # probabilities of a particle in a cell that surely holds one, and in cells that hold none
NEAR = 2  # cells within which a particle can be confused with another one in two scans
RECENT = 100  # particles with a free cell ahead whose motion is remembered


@dataclass(frozen=True)
class Alarm:
    """Something that a rig did although it should not, or did not do although it should.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    move : int
        Number of commands sent before the alarm.
    text : str
        What was expected, what came, and the likely causes, for people.
    """

    kind: str
    move: int
    text: str


class AlarmRaised(Exception):  # noqa: N818
    """Ends a drive whose rig contradicts the commands. The function `drive` turns the exception
    into the status ``alarm``.
    """

    def __init__(self, alarm: Alarm) -> None:
        super().__init__(alarm.text)
        self.alarm = alarm


@dataclass(frozen=True)
class Rate:
    """An error rate as the user stated it and as the drive observed it.

    Parameters
    ----------
    stated, observed : float
    low, high : float
        Bounds of the 99.9 % confidence interval (Wilson's) of the rate.
    trials : int
        Number of observations.
    """

    stated: float
    observed: float
    low: float
    high: float
    trials: int

    @property
    def wrong(self) -> bool:
        """Whether the interval lies far from the stated rate: more than half above it, or a third
        below it, and a hundredth.
        """
        return self.trials >= FEW and (
            self.low > 1.5 * self.stated + 0.01 or self.high < self.stated / 1.5 - 0.01
        )


@dataclass(frozen=True)
class Trust:
    """How far the map of a drive can be trusted.

    Parameters
    ----------
    level : str
        "high": every check was made and passed. "limited": an alarm was raised, or a check could
        not be made. "none": the map says nothing about the apparatus.
    why : str
        The reason for the level, in one sentence.
    """

    level: Level
    why: str


# --------------------------------------------------------------------------------------------- rigs
# without noise


def explain_contradiction(
    before: SwarmState,
    after: SwarmState,
    command: str,
    steps: int,
    *,
    free: Board,
    move: int,
    otherwise: str,
) -> Alarm:
    """Return the alarm for positions that a command cannot explain, with the most likely cause.

    Parameters
    ----------
    before, after : SwarmState
        What the scans before and after the command show.
    command : str
    steps : int
        Number of cells that the command (or the run of equal commands) may move a particle.
    free : Board
        The cells known to be free.
    move : int
        Number of commands sent.
    otherwise : str
        The text of the alarm if no cause is likelier than a slip or a wrong observation.
    """
    where = f"move {move}, command {command!r}"
    if before.n_particles != after.n_particles:
        text = (
            f"{before.n_particles} particles before, {after.n_particles} now: a particle was lost,"
            " was not seen or came in"
        )
        return Alarm("number", move, f"{where}: {text}; {NOISY}")
    if before == after:
        text = (
            "nothing moved although a particle has a free cell ahead: the magnets do nothing, or"
            " the camera shows an old picture"
        )
        return Alarm("still", move, f"{where}: {text}")
    for letter in letters_of(before.occupied.layout.ndim):
        # a single particle that drifts leaves others behind that have room in its direction
        behind = (before.occupied & after.occupied).shifted(letter) & free
        if (
            letter != command
            and explains(before, after, letter, steps)
            and behind <= after.occupied
        ):
            text = (
                f"the particles moved as command {letter!r} moves them: the picture or the magnets"
                " are turned or mirrored"
            )
            return Alarm("direction", move, f"{where}: {text}, or the particles drift")
    if explains(before, after, command, 2 * steps) and not explains(before, after, command, steps):
        text = (
            f"a particle moved by more than {count_text(steps, 'cell')}: the command was carried"
            " out twice, or particles drift"
        )
        return Alarm("twice", move, f"{where}: {text}")
    sideways = len(after.occupied - before.occupied) > 0 and not explains(
        before, after, command, max(before.occupied.layout.shape)
    )
    if sideways:
        text = (
            "a particle moved against the command or to the side: the particles drift, or were"
            " observed wrongly"
        )
        return Alarm("drift", move, f"{where}: {text} ({otherwise}); {NOISY}")
    return Alarm("rule", move, f"{where}: {otherwise}; {NOISY}")


def explains(before: SwarmState, after: SwarmState, command: str, steps: int) -> bool:
    """Return whether ``steps`` equal commands may lead from one state to the other, in some map."""
    try:
        states: Iterator[SwarmState] = states_of_run(before, after, command, steps)
        return any(True for _ in states)
    except InvalidInputError:
        return False


# ------------------------------------------------------------------------------------------------
# rigs with noise


class NoiseMonitor:
    """Compares pairs of scans with one command between them with the stated noise.

    Each pair of scans gives three kinds of evidence. (1) Motion along an axis: the number of pairs
    of detections one cell ahead minus the number of pairs one cell behind. If nothing moves, the
    two scans are exchangeable, so that the difference is 0 on average, however dense the particles
    are. (2) The fate of particles that no other particle is near: missed, moved, stayed, or
    displaced to the side. (3) The number of detections in each scan.

    Parameters
    ----------
    shape : tuple of int
    noise : Noise
        The stated probabilities.
    """

    def __init__(self, shape: tuple[int, ...], noise: Noise) -> None:
        self.noise, self.shape, self.ndim = noise, np.array(shape), len(shape)
        sizes = [size + 8 for size in shape]  # no neighbour of a rim cell wraps around
        self._strides = np.array(
            [int(np.prod(sizes[axis + 1 :])) for axis in range(self.ndim)], dtype=np.int64
        )
        self.missed, self.stayed, self.aside, self.leapt = (
            [0, 0],
            [0, 0],
            [0, 0],
            [0, 0],
        )  # events, trials
        # by the axis of the command and the axis of the motion; positive along the command
        self.advance, self.variance = (
            np.zeros((self.ndim, self.ndim)),
            np.zeros((self.ndim, self.ndim)),
        )
        self.drift = np.zeros(
            self.ndim
        )  # sum of the displacements of single particles across the axis of the command
        self.recent: deque[bool] = deque(
            maxlen=RECENT
        )  # whether a particle with a free cell ahead stayed
        letters = letters_of(self.ndim)
        self.stays: dict[str, list[bool]] = {
            letter: [] for letter in letters
        }  # the same for each command, all of them
        # pairs ahead minus pairs behind for each command, and the variance of this number if
        # nothing moves
        self._surplus = {letter: [0.0, 0.0] for letter in letters}
        self._numbers: list[int] = []
        self._cells = int(np.prod([size + 2 for size in shape]))  # the workspace and its rim
        self._seen, self._scans = (
            np.zeros(int(np.prod(sizes)), dtype=np.int32),
            0,
        )  # since motion was last established

    @property
    def hit(self) -> float:
        """Probability that a scan shows a particle in its own cell, if it shows the particle."""
        return 1 - self.noise.misplace

    @property
    def share(self) -> float:
        """Probability that a scan shows a particle in one given neighbouring cell, if it shows the
        particle.
        """
        return self.noise.misplace / (2 * self.ndim)

    def compare(
        self,
        command: str,
        before: NDArray[np.int64],
        after: NDArray[np.int64],
        inside: NDArray[np.float64],
        free: NDArray[np.bool_],
    ) -> None:
        """Take one pair of scans into account.

        Parameters
        ----------
        command : str
            The command between the scans.
        before, after : ndarray of int64, shape (k, ndim)
        inside : ndarray of float64
            For each cell of the workspace and three cells around it: the probability of a particle,
            before the command.
        free : ndarray of bool
            The cells of the workspace and its rim that have ever been classified as free. Walls do
            not grow, so later doubts do not count.
        """
        axis, sign = AXES[command]
        axis += self.ndim
        first, second = self._flat(before), self._flat(after)
        for other in range(self.ndim):
            step = sign * self._strides[other]
            surplus = int(np.isin(first + step, second).sum()) - int(
                np.isin(first - step, second).sum()
            )
            self.advance[axis, other] += surplus
            touching = np.isin(first + step, first).sum()
            variance = 4 * (self.noise.miss + self.noise.misplace) * touching
            variance += (2 * self.noise.misplace / self.ndim + 1e-4) * len(first)
            self.variance[axis, other] += variance
            if other == axis:
                self._surplus[command][0] += surplus
                self._surplus[command][1] += variance
        within = ((before >= 0) & (before < self.shape)).all(axis=1)
        cells = before[within & (inside[tuple((before + 3).T)] > SURE)]
        if len(cells):
            ahead = np.zeros(self.ndim, dtype=np.int64)
            ahead[axis] = sign
            self.stays[command] += self._see_motion(cells, ahead, first, second, inside, free)
            if len(after):
                self._follow(cells, after, ahead, inside)

    def _flat(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        flat: NDArray[np.int64] = (cells + 4) @ self._strides
        return flat

    def _see_motion(
        self,
        cells: NDArray[np.int64],
        ahead: NDArray[np.int64],
        first: NDArray[np.int64],
        second: NDArray[np.int64],
        inside: NDArray[np.float64],
        free: NDArray[np.bool_],
    ) -> list[bool]:
        """Return which particles stayed, and count them, of those with a free cell ahead and no
        other particle in their line.
        """
        able = np.ones(len(cells), dtype=bool)
        for distance in (-1, 1, 2):
            able &= inside[tuple((cells + distance * ahead + 3).T)] < EMPTY
            able &= ~np.isin(self._flat(cells + distance * ahead), first)
        there = np.isin(self._flat(cells + ahead), second)
        far = np.isin(self._flat(cells + 2 * ahead), second)
        leapt = far[able & (there ^ far) & ~np.isin(self._flat(cells), second)]
        self.leapt[0] += int(leapt.sum())
        self.leapt[1] += len(leapt)
        able &= free[tuple((cells + ahead + 1).T)]
        there, here = there[able], np.isin(self._flat(cells[able]), second)
        stayed = here[here ^ there]
        self.stayed[0] += int(stayed.sum())
        self.stayed[1] += len(stayed)
        found: list[bool] = stayed.tolist()
        self.recent.extend(found)
        return found

    def _follow(
        self,
        cells: NDArray[np.int64],
        after: NDArray[np.int64],
        ahead: NDArray[np.int64],
        inside: NDArray[np.float64],
    ) -> None:
        """Count the single particles that were missed, and that were seen to one side of their
        line.
        """
        from scipy.spatial import KDTree

        boxes = np.lib.stride_tricks.sliding_window_view(inside, (2 * NEAR + 1,) * self.ndim)
        crowd = (
            boxes[tuple((cells + 3 - NEAR).T)].reshape(len(cells), -1).sum(axis=1)
            - inside[tuple((cells + 3).T)]
        )
        singles = cells[crowd < EMPTY]
        if not len(singles):
            return
        for cell, near in zip(
            singles, KDTree(after).query_ball_point(singles, NEAR, p=np.inf), strict=True
        ):
            if len(near) > 1:
                continue
            self.missed[1] += 1
            if not near:
                self.missed[0] += 1
                continue
            way = after[near[0]] - cell
            way[ahead != 0] = 0
            self.aside[0] += int(way.any())
            self.aside[1] += 1
            self.drift += way

    def count(self, cells: NDArray[np.int64]) -> bool:
        """Take one scan into account. Return whether the scans since motion was last established
        show motion again.

        As long as nothing moves, a cell with a particle shows it in each scan with one and the same
        high probability, and a cell without one, with a low one: the stated rates of misses and
        misplacements bound both. Where particles move, cells are occupied for a part of the time.
        The likelihood ratio compares a free probability for each cell (Krichevsky and Trofimov's
        mixture) with the bounds. It tests scans at any time, whatever commands a policy chooses:
        the probability that particles at rest ever reach 1 / `CRITICAL` is at most `CRITICAL`
        (Ville's inequality).
        """
        self._numbers.append(len(cells))
        self._seen[self._flat(cells)] += 1
        self._scans += 1
        if self._evidence() < -log(CRITICAL):
            return False
        self._seen[:] = 0
        self._seen[self._flat(cells)] = 1
        self._scans = 1
        return True

    def _evidence(self) -> float:
        """Return the logarithm of the likelihood ratio of motion to rest, for the scans since
        motion was last established.
        """
        from scipy.special import betaln, xlog1py, xlogy

        at = np.flatnonzero(self._seen)
        seen, scans = self._seen[at].astype(float), self._scans
        share = min(
            0.2, max(1.0, seen.sum() / scans) / self._cells
        )  # of the cells that may be occupied for a while

        def likelihood(
            counts: NDArray[np.float64], chance: NDArray[np.float64]
        ) -> NDArray[np.float64]:
            found: NDArray[np.float64] = xlogy(counts, chance) + xlog1py(scans - counts, -chance)
            return found

        often, counts = (1 - self.noise.miss) * self.hit, np.arange(scans + 1.0)
        held = likelihood(
            counts, np.maximum(counts / scans, often)
        )  # if a particle rests in the cell
        bare = likelihood(counts, np.minimum(counts / scans, self.noise.misplace))  # if none does
        likely = (
            held >= bare - PLAUSIBLE
        )  # a cell that may hold a particle, which scans may show in the cells beside
        beside = np.sum(
            [likely[self._seen[at + way * step]] for step in self._strides for way in (-1, 1)],
            axis=0,
        )
        rarely = np.minimum(self.noise.misplace, self.share * beside + 1e-3)
        rest = np.maximum(held[self._seen[at]], likelihood(seen, np.minimum(seen / scans, rarely)))
        motion = betaln(seen + 0.5, scans - seen + 0.5) - betaln(0.5, 0.5)
        ratios = np.logaddexp(np.log1p(-share), np.log(share) + motion - rest)
        return float(ratios.sum() + (self._cells - len(seen)) * np.log1p(-share))

    @property
    def change(self) -> tuple[float, float] | None:
        """Number of particles before and after the most likely moment of a change, or None if the
        number did not change.

        Unlike the number of particles in the belief, the number of detections has the same bias in
        known and in unknown regions.
        """
        told = np.array(self._numbers) / (1 - self.noise.miss)
        before = np.arange(LEAST, len(told) - LEAST + 1)
        if not len(before):
            return None
        after = len(told) - before
        sums, squares = np.cumsum(told), np.cumsum(told**2)
        left, right = sums[before - 1] / before, (sums[-1] - sums[before - 1]) / after
        spread = squares[-1] - before * left**2 - after * right**2  # around the two means
        errors = np.sqrt(np.maximum(spread, 0.1) / len(told) * (1 / before + 1 / after))
        best = int(np.argmax(np.abs(left - right) / errors))
        if abs(left[best] - right[best]) < max(0.5, CHANGE * errors[best]):
            return self._fewer
        window = min(WINDOW, int(before[best]), int(after[best]))
        return float(told[:window].mean()), float(told[-window:].mean())

    @property
    def _fewer(self) -> tuple[float, float] | None:
        """Largest number of detections and the number now, if no scan for long showed as many, or
        None.

        A scan never shows more detections than there are particles. It shows every particle with a
        known probability.
        """
        most, numbers = max(self._numbers), np.array(self._numbers)
        since = len(numbers) - 1 - int(np.flatnonzero(numbers == most)[-1])
        if since * np.log1p(-(((1 - self.noise.miss) * self.hit) ** most) + 1e-12) > log(GONE):
            return None
        return most, min(most - 1, round(float(numbers[-since:].mean()) / (1 - self.noise.miss)))

    @property
    def along(self) -> bool:
        """Whether the scans show more motion along the commands than against them. Chance misses
        may show as much, rarely.
        """
        along = float(np.trace(self.advance))
        return along > max(0.5, SIGMAS * sqrt(np.trace(self.variance)))

    def shows_motion(self, letter: str) -> bool:
        """Return whether the scans before and after this command establish that it moves particles.

        Either more single particles are seen one cell ahead than wrong observations explain, or
        there are more pairs of detections ahead than behind, by more than wrong observations
        explain.
        """
        stays, (surplus, variance) = self.stays[letter], self._surplus[letter]
        moves = len(stays) - sum(stays)
        if (
            moves > 1
            and tail(moves, len(stays), self.share / (self.hit + self.share) + 0.02) < DEMONSTRATED
        ):
            return True
        return surplus > max(3.0, SIGMAS * sqrt(variance))

    @property
    def staying(self) -> float:
        """Expected share of particles seen to stay although the cell ahead is free."""
        slip = self.noise.slip
        return (slip * self.hit + (1 - slip) * self.share) / (self.hit + self.share)

    def _expected_stay(self, run: int) -> float:
        """Return the share of stays to expect in a run of stays: as stated, or as observed before,
        if more particles slip.
        """
        events, trials = self.stayed[0] - run, self.stayed[1] - run
        return max(self.staying, 0.1, events / trials if trials > LEAST else 0.0)

    def rates(self) -> dict[str, Rate]:
        """Return the stated and observed rates of the errors that the drive could observe."""
        found = {}
        spread = self.hit - self.share
        for name, (events, trials), undo in (
            (
                "slip",
                self.stayed,
                lambda seen: (
                    (seen * (self.hit + self.share) - self.share) / spread if spread > 0.1 else seen
                ),
            ),
            ("miss", self.missed, lambda seen: seen),
            # a particle is seen aside if either of the two scans misplaced it to one of the sides
            (
                "misplace",
                self.aside,
                lambda seen: (1 - sqrt(max(0.0, 1 - seen))) * self.ndim / (self.ndim - 1),
            ),
        ):
            if trials:
                low, high = wilson(events, trials)
                observed, low, high = (
                    min(1.0, max(0.0, undo(value))) for value in (events / trials, low, high)
                )
                found[name] = Rate(getattr(self.noise, name), observed, low, high, trials)
        return found

    @property
    def _leaping(self) -> float:
        """Probability of as many motions by two cells as scans show, if particles are misplaced as
        stated or surely seen aside.
        """
        leaps, trials = self.leapt
        seen = self.rates().get("misplace")
        share = self.share if seen is None else max(self.share, seen.low / (2 * self.ndim))
        return tail(leaps, trials, 2 * share + 1e-3) if leaps > 1 else 1.0

    @property
    def _leaps(self) -> str:
        leaps, trials = self.leapt
        return (
            f"{leaps} of {count_text(trials, 'particle')} that moved alone moved by two cells:"
            " commands are carried out twice"
        )

    def contradiction(self, move: int) -> Alarm | None:
        """Return the alarm that must stop the drive, or None."""
        for axis in range(self.ndim):
            if self.advance[axis, axis] < -max(SIGMAS * sqrt(self.variance[axis, axis]), 3.0):
                text = (
                    "the particles move against the commands: an axis of the camera or of the"
                    " magnets is inverted"
                )
                return Alarm(
                    "direction", move, f"move {move}: {text} (the {axis_name(axis, self.ndim)})"
                )
        run = next(
            (i for i, stayed in enumerate(reversed(self.recent)) if not stayed), len(self.recent)
        )
        if self._expected_stay(run) ** run < CRITICAL:
            text = (
                f"of the last {count_text(run, 'particle')} with a free cell ahead, none moved,"
                " which slips do not explain: the magnets do nothing, or the camera shows an old"
                " picture"
            )
            return Alarm("still", move, f"move {move}: {text}")
        for letter, stays in self.stays.items():
            others = [
                stayed for other, seen in self.stays.items() if other != letter for stayed in seen
            ]
            expected = max(
                self.staying, 0.2, sum(others) / len(others) if len(others) > LEAST else 0.0
            )
            run = next((i for i, stayed in enumerate(reversed(stays)) if not stayed), len(stays))
            if expected**run < CRITICAL or tail(sum(stays), len(stays), expected) < CRITICAL:
                text = (
                    f"command {letter!r}: of {count_text(len(stays), 'particle')} with a free cell"
                    f" ahead, {sum(stays)} stayed, the last {run} in a row, which slips do not"
                    " explain: this direction of the magnets does nothing"
                )
                return Alarm("still", move, f"move {move}: {text}")
        if self._leaping < CRITICAL:
            return Alarm("twice", move, f"move {move}: {self._leaps}")
        # as long as nothing moves along the commands, the scans are exchangeable, and motion to the
        # sides shows as well
        across = np.abs(self.advance) > np.maximum(SIGMAS * np.sqrt(self.variance), 3.0)
        if not self.along and (across & ~np.eye(self.ndim, dtype=bool)).any():
            text = (
                "the particles move at a right angle to the commands: the picture or the magnets"
                " are turned"
            )
            return Alarm("direction", move, f"move {move}: {text}")
        return None

    def marks(self, move: int) -> list[Alarm]:
        """Return the alarms that mark the result, but stop nothing: rates far from the stated ones,
        drift, numbers.
        """
        alarms = []
        for name, rate in self.rates().items():
            if rate.wrong:
                text = (
                    f"{name}: stated {rate.stated:g}, observed {rate.observed:.3f} (99.9 % interval"
                    f" {rate.low:.3f} to {rate.high:.3f},"
                    f" {count_text(rate.trials, 'observation')}): the confidence of the map does"
                    " not hold"
                )
                alarms.append(Alarm("rates", move, text))
        if self._leaping < LEAPING:
            alarms.append(Alarm("twice", move, self._leaps))
        trials = max(1, self.aside[1])
        axis = int(np.argmax(np.abs(self.drift)))
        if (
            abs(self.drift[axis]) > (SIGMAS + 1) * sqrt(self.noise.misplace * trials + 1)
            and abs(self.drift[axis]) > 0.02 * trials
        ):
            amount = self.drift[axis] / trials
            text = (
                f"the particles drift along the {axis_name(axis, self.ndim)} by {amount:+.2f} cells"
                " a move, whatever the command"
            )
            alarms.append(Alarm("drift", move, text))
        if self.change is not None:
            first, last = (round(number) for number in self.change)
            text = f"about {first} particles at the start, about {last} now"
            if first > last:
                text += (
                    ": particles that scans did not show for longer than the miss rate explains"
                    " were taken out of the belief"
                )
            elif first < last:
                text += ": scans show more particles than at the start"
            else:
                text += ", and other numbers in between"
            alarms.append(Alarm("number", move, text))
        return alarms


def axis_name(axis: int, ndim: int) -> str:
    """Return the name of an axis for people."""
    return ("layers", "rows", "columns")[axis + 3 - ndim] + " axis"


def wilson(events: int, trials: int, sigmas: float = INTERVAL_SIGMAS) -> tuple[float, float]:
    """Return Wilson's confidence interval of a probability.

    Examples
    --------
    >>> [round(bound, 3) for bound in wilson(5, 100)]
    [0.013, 0.175]
    """
    share, square = events / trials, sigmas * sigmas
    centre = (share + square / (2 * trials)) / (1 + square / trials)
    half = (
        sigmas
        * sqrt(share * (1 - share) / trials + square / (4 * trials * trials))
        / (1 + square / trials)
    )
    return max(0.0, centre - half), min(1.0, centre + half)


def tail(events: int, trials: int, probability: float) -> float:
    """Return the probability of at least ``events`` events in ``trials`` trials."""
    from scipy.special import bdtrc

    return float(bdtrc(events - 1, trials, probability)) if events else 1.0


def trust_of(alarms: list[Alarm], *, moved: bool, doubts: list[str]) -> Trust:
    """Return how far a map can be trusted.

    Parameters
    ----------
    alarms : list of Alarm
    moved : bool
        Whether particles moved at all.
    doubts : list of str
        Other reasons to doubt the map, such as walls that rest on commands without any motion.
    """
    if not moved:
        return Trust(
            "none", "no particle was seen to move, so that the map says nothing about the walls"
        )
    fatal = [alarm for alarm in alarms if alarm.kind == "direction"]
    if fatal:
        return Trust("none", f"every wall was inferred from a wrong direction: {fatal[0].text}")
    reasons = [alarm.text for alarm in alarms] + doubts
    if reasons:
        return Trust("limited", "; ".join(reasons))
    return Trust(
        "high",
        "the particles moved as the commands and the known free cells require, and no alarm was"
        " raised",
    )


def alarms_as_json(alarms: tuple[Alarm, ...]) -> list[dict[str, Any]]:
    """Return alarms as JSON objects."""
    return [dict(vars(alarm)) for alarm in alarms]
