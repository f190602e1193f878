"""What the scans of a rig with noise say about the stated noise: motion, observed error rates, and
the number of particles.
"""

from __future__ import annotations

import itertools
from collections import Counter, deque
from collections.abc import Callable, Sequence
from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import count_text
from shoal.core.dataclass import dataclass
from shoal.rigs.checks import Alarm
from shoal.swarm.grid.board import letters_of
from shoal.swarm.grid.scans import AXES
from shoal.swarm.noise import Noise

# Probabilities. An alarm that stops a drive must not hit one honest drive in many thousands, a mark
# may hit a few in a thousand.
CRITICAL = 1e-9  # of the scans under the stated rates, from which on the rates cannot be true
DEMONSTRATED = 1e-3  # of the scans if a command moved nothing, from which on it moves particles
CHANGED = 0.02  # of the scans if the number of particles is constant, from which on it is not
DECEPTION = 1e-3  # of the scans if all commands were carried out, from which on some were not
DECISIVE = 1e3  # the most that one scan counts for in this
# in place of the logarithm of 0: what the stated rates exclude, however it came about, is no evidence
IMPOSSIBLE = -1e6
SHARES = np.array([0.02, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5])  # of such commands
# of a particle: from which on a cell surely holds one, up to which it has none
SURE, EMPTY = 0.9, 0.1

SIGMAS = 4.0  # standard deviations from which on a motion is established
INTERVAL_SIGMAS = 3.29  # of a 99.9 % interval
PLAUSIBLE = 7.0  # log-likelihood ratio up to which a cell may still hold a particle at rest
FEW = 30  # observations from which on a rate is judged
LEAST = 8  # observations of other particles from which on they say how many stay
MISSES, SURPLUS = (0.003, 0.01, 0.03, 0.1, 0.3), (0.01, 0.1, 0.3, 1.0, 3.0)  # tried rates
FEW_GHOSTS = 5  # detections without a particle up to which scans may show no ghosts
WINDOW = 30  # scans that suggest a number of particles at the start and at the end
NEAR = 2  # cells within which a particle can be confused with another one in two scans
JAMMED = 3  # pushes of one particle in one direction from which on more of them show nothing new
RECENT = 100  # commands of which it is remembered whether they moved particles
# share of motions that lead two cells far, up to which particles may do so by themselves
LEAPS = 0.3


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
    def too_low(self) -> bool:
        """Whether the rate was surely stated too low."""
        return self.wrong and self.low > self.stated

    @property
    def wrong(self) -> bool:
        """Whether the interval lies far from the stated rate: more than half above it, or a third
        below it, and a hundredth.
        """
        return self.trials >= FEW and (
            self.low > 1.5 * self.stated + 0.01 or self.high < self.stated / 1.5 - 0.01
        )


@dataclass
class Tally:
    """Number of events in a number of trials."""

    events: int = 0
    trials: int = 0

    def add(self, events: int, trials: int = 1) -> None:
        """Add events and the trials in which they happened or did not happen."""
        self.events += events
        self.trials += trials


class NoiseMonitor:
    """Compares pairs of scans with one command between them with the stated noise.

    Each pair of scans gives three kinds of evidence. (1) Motion along an axis: the number of pairs
    of detections one cell ahead minus the number of pairs one cell behind. If nothing moves, the
    two scans are exchangeable, so that the difference is 0 on average, however dense the particles
    are. (2) The fate of particles that no other particle is near: missed, moved, stayed, or
    displaced to the side. (3) How often each cell shows a particle.

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
        letters = letters_of(self.ndim)
        # of single particles: not seen; seen to stay although the cell ahead is free; seen beside
        # their line; seen to move by two cells
        self.missed, self.stayed, self.aside, self.leapt = Tally(), Tally(), Tally(), Tally()
        # detections where neither the belief before nor the scan after shows a particle
        self.ghosts, self._expected = 0, np.zeros(0)
        # since a command last moved particles: how often each cell kept one, by command
        self._held: dict[str, Counter[int]] = {letter: Counter() for letter in letters}
        self._leaps_by_command: list[tuple[int, int]] = []  # and motions, where there are any
        # by the axis of the command and the axis of the motion; positive along the command
        self.advance = np.zeros((self.ndim, self.ndim))
        self.variance = np.zeros((self.ndim, self.ndim))
        # sum of the displacements of single particles across the axis of the command
        self.drift = np.zeros(self.ndim)
        # of particles with a free cell ahead, how many stayed and how many there were: at the latest
        # commands that had any, and at all commands by letter
        self.recent: deque[tuple[str, int, int]] = deque(maxlen=RECENT)
        self.stays: dict[str, list[tuple[int, int]]] = {letter: [] for letter in letters}
        # pairs ahead minus pairs behind for each command, and the variance of this number if
        # nothing moves
        self._surplus = {letter: [0.0, 0.0] for letter in letters}
        self._cells = int(np.prod([size + 2 for size in shape]))  # the workspace and its rim
        # since motion was last established: scans that show each cell, and all scans
        self._seen, self._scans = np.zeros(int(np.prod(sizes)), dtype=np.int32), 0

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
        # np.isin sorts, which takes longer than all the rest
        first = self._flat(before)
        old, new = self._mask(first), self._mask(self._flat(after))
        for direction in range(self.ndim):
            step = sign * self._strides[direction]
            surplus = int(new[first + step].sum()) - int(new[first - step].sum())
            self.advance[axis, direction] += surplus
            touching = old[first + step].sum()
            variance = 4 * (self.noise.miss + self.noise.misplace) * touching
            variance += (2 * self.noise.misplace / self.ndim + 1e-4) * len(first)
            self.variance[axis, direction] += variance
            if direction == axis:
                self._surplus[command][0] += surplus
                self._surplus[command][1] += variance
        self._count_ghosts(before, after)
        self._expected = inside.copy()
        within = ((before >= 0) & (before < self.shape)).all(axis=1)
        cells = before[within & (inside[tuple((before + 3).T)] > SURE)]
        if len(cells):
            ahead = np.zeros(self.ndim, dtype=np.int64)
            ahead[axis] = sign
            cells_held, able = self._see_motion(cells, ahead, old, new, inside, free)
            self._remember_stays(command, cells_held, able)
            self._follow(cells, before, after, ahead, inside)

    def _flat(self, cells: NDArray[np.int64]) -> NDArray[np.int64]:
        flat: NDArray[np.int64] = (cells + 4) @ self._strides
        return flat

    def _mask(self, flat: NDArray[np.int64]) -> NDArray[np.bool_]:
        mask = np.zeros(len(self._seen), dtype=bool)
        mask[flat] = True
        return mask

    def _count_ghosts(self, cells: NDArray[np.int64], after: NDArray[np.int64]) -> None:
        """Count the detections of a scan that nobody expected, and that the scan after does not
        confirm.
        """
        from scipy.spatial import KDTree

        if self._expected.size:
            boxes = np.lib.stride_tricks.sliding_window_view(
                self._expected, (2 * NEAR + 1,) * self.ndim
            )
            inner = cells[((cells >= 0) & (cells < self.shape)).all(axis=1)]
            beside = tuple(range(1, 1 + self.ndim))
            around = boxes[tuple((inner + 3 - NEAR).T)].sum(axis=beside)
            alone = inner[around < EMPTY]
            if len(after) and len(alone):
                near = KDTree(after).query(alone, p=np.inf)[0] <= NEAR
                alone = alone[~near]
            self.ghosts += len(alone)

    def _see_motion(
        self,
        cells: NDArray[np.int64],
        ahead: NDArray[np.int64],
        old: NDArray[np.bool_],
        new: NDArray[np.bool_],
        inside: NDArray[np.float64],
        free: NDArray[np.bool_],
    ) -> tuple[list[int], int]:
        """Return in which cells particles stayed, and of how many, and count them: those with a
        free cell ahead and no other particle in their line. ``old`` and ``new`` are what the scans
        before and after the command show, by flat index.
        """
        able = np.ones(len(cells), dtype=bool)
        for distance in (-1, 1, 2):
            able &= inside[tuple((cells + distance * ahead + 3).T)] < EMPTY
            able &= ~old[self._flat(cells + distance * ahead)]
        there, here = new[self._flat(cells + ahead)], new[self._flat(cells)]
        far = new[self._flat(cells + 2 * ahead)]
        leapt = far[able & (there ^ far) & ~here]
        self.leapt.add(int(leapt.sum()), len(leapt))
        if len(leapt):
            self._leaps_by_command.append((int(leapt.sum()), len(leapt)))
        able &= free[tuple((cells + ahead + 1).T)]
        there, here = there[able], here[able]
        stayed = here[here ^ there]
        self.stayed.add(int(stayed.sum()), len(stayed))
        return self._flat(cells[able])[here & ~there].tolist(), len(stayed)

    def _remember_stays(self, letter: str, stays: list[int], able: int) -> None:
        """Remember in which cells particles stayed at a command, of those that were able to move.

        A particle that is jammed at a corner stays at each push, and is in the end the only one
        with room ahead. As long as a command moves nothing, each cell therefore counts once for the
        command, and `JAMMED` times for the apparatus.
        """
        if not able:
            return
        held, once, often = self._held[letter], able, able
        if len(stays) < able:
            held.clear()
        else:
            held.update(stays)
            once = sum(held[cell] <= 1 for cell in stays)
            often = sum(held[cell] <= JAMMED for cell in stays)
        self.stays[letter].append((min(len(stays), once), once))
        self.recent.append((letter, min(len(stays), often), often))

    def _follow(
        self,
        cells: NDArray[np.int64],
        before: NDArray[np.int64],
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
        shown = KDTree(before).query_ball_point(cells, NEAR, p=np.inf, return_length=True)
        singles = cells[(crowd < EMPTY) & (shown == 1)]
        if not len(singles):
            return
        if not len(after):
            self.missed.add(len(singles), len(singles))
            return
        for cell, near in zip(
            singles, KDTree(after).query_ball_point(singles, NEAR, p=np.inf), strict=True
        ):
            # two cells behind, only another one can appear, which came from farther behind
            close = [i for i in near if (after[i] - cell) @ ahead > -NEAR]
            if len(close) > 1:
                continue
            self.missed.add(not close)
            if not close:
                continue
            shift = after[close[0]] - cell
            shift[ahead != 0] = 0
            self.aside.add(bool(shift.any()))
            self.drift += shift

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
        # of the cells that may be occupied for a while
        share = min(0.2, max(1.0, seen.sum() / scans) / self._cells)

        def likelihood(
            counts: NDArray[np.float64], chance: NDArray[np.float64]
        ) -> NDArray[np.float64]:
            logs: NDArray[np.float64] = xlogy(counts, chance) + xlog1py(scans - counts, -chance)
            return logs

        often, counts = (1 - self.noise.miss) * self.hit, np.arange(scans + 1.0)
        # if a particle rests in the cell
        held = likelihood(counts, np.maximum(counts / scans, often))
        bare = likelihood(counts, np.minimum(counts / scans, self.noise.misplace))  # if none does
        # a cell that may hold a particle, which scans may show in the cells beside
        likely = held >= bare - PLAUSIBLE
        beside = np.sum(
            [likely[self._seen[at + sign * step]] for step in self._strides for sign in (-1, 1)],
            axis=0,
        )
        rarely = np.minimum(self.noise.misplace, self.share * beside + 1e-3)
        rest = np.maximum(held[self._seen[at]], likelihood(seen, np.minimum(seen / scans, rarely)))
        motion = betaln(seen + 0.5, scans - seen + 0.5) - betaln(0.5, 0.5)
        ratios = np.logaddexp(np.log1p(-share), np.log(share) + motion - rest)
        return float(ratios.sum() + (self._cells - len(seen)) * np.log1p(-share))

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
        (stays, trials), (surplus, variance) = total(self.stays[letter]), self._surplus[letter]
        if (
            trials - stays > 1
            and tail(trials - stays, trials, self.share / (self.hit + self.share) + 0.02)
            < DEMONSTRATED
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
        events, trials = self.stayed.events - run, self.stayed.trials - run
        return max(self.staying, 0.1, events / trials if trials > LEAST else 0.0)

    def rates(self) -> dict[str, Rate]:
        """Return the stated and observed rates of the errors that the drive could observe."""
        spread = self.hit - self.share
        counted: dict[str, tuple[Tally, Callable[[float], float]]] = {
            # a particle is also seen to stay or to move if a scan misplaces it along its line
            "slip": (
                self.stayed,
                lambda seen: (
                    (seen * (self.hit + self.share) - self.share) / spread if spread > 0.1 else seen
                ),
            ),
            "miss": (self.missed, lambda seen: seen),
            # the belief knows where the particle was: it is seen aside if the second scan misplaced
            # it to one of the sides
            "misplace": (self.aside, lambda seen: seen * self.ndim / (self.ndim - 1)),
        }
        rates = {}
        for name, (tally, undo) in counted.items():
            if tally.trials:
                shares = (
                    tally.events / tally.trials,
                    *wilson(tally.events, tally.trials),
                )
                observed, low, high = (min(1.0, max(0.0, undo(share))) for share in shares)
                stated = getattr(self.noise, name)
                rates[name] = Rate(stated, observed, low, high, tally.trials)
        return rates

    @property
    def _leaping(self) -> float:
        """Probability of as many motions by two cells as scans show, if particles are misplaced as
        often as stated, or as they may be according to what was observed.
        """
        seen = self.rates().get("misplace")
        misplace = max(self.noise.misplace, 0.0 if seen is None else seen.high)
        leaps = self.leapt.events
        return tail(leaps, self.leapt.trials, misplace / self.ndim + 1e-3) if leaps > 1 else 1.0

    @property
    def leaps_together(self) -> float:
        """Logarithm of the ratio of two probabilities of the motions by two cells: if a share of
        the commands is carried out twice, and if particles leap one by one.

        Near a strong coil, a particle that stands in the front of its cell may be pulled over two
        borders: at the same command, some particles leap and most do not. If a command is carried
        out twice, all particles leap that have room. With k_t leaps among n_t motions at command t,
        and the binomial probabilities B(k, n, p), both are the product over t of
        (1 - s) B(k_t, n_t, e) + s B(k_t, n_t, q), averaged over s, e and q: for commands that are
        carried out twice, e is the probability that a scan misplaces a particle along its line and q
        is at least one half; for particles that leap by themselves, both are at most `LEAPS`.
        """
        counted = np.array(self._leaps_by_command, dtype=np.float64).reshape(-1, 2)
        leaps, stays = counted[:, 0], counted[:, 1] - counted[:, 0]

        def weigh(usual: list[float], sometimes: list[float]) -> float:
            logs = {p: leaps * log(p) + stays * log(1 - p) for p in (*usual, *sometimes)}
            sums = [
                float(np.logaddexp(log(1 - share) + logs[e], log(share) + logs[q]).sum())
                for e in usual
                for q in sometimes
                for share in SHARES
            ]
            return float(np.logaddexp.reduce(sums)) - log(len(sums))

        wrong = self.noise.misplace / self.ndim + 1e-3
        twice = weigh([wrong, wrong / 10], [0.5, 0.75, 0.95])  # walls hold the other particles
        return twice - weigh([wrong, wrong / 10, LEAPS / 10], [LEAPS / 5, LEAPS / 2, LEAPS])

    @property
    def leap_alone(self) -> bool:
        """Whether the scans show that particles leap by themselves, and not with the command."""
        return self.leaps_together < log(DEMONSTRATED)

    @property
    def _leaps(self) -> str:
        return (
            f"{self.leapt.events} of {count_text(self.leapt.trials, 'particle')} that moved alone moved by two cells:"
            " commands are carried out twice, or move particles too far"
        )

    @property
    def _still_directions(self) -> int:
        """Number of different commands among the last ones, at which no particle moved."""
        still = itertools.takewhile(lambda entry: entry[1] == entry[2], reversed(self.recent))
        return len({letter for letter, _, _ in still})

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
        run = last_stays([(stays, trials) for _, stays, trials in self.recent])
        if self._still_directions > 1 and self._expected_stay(run) ** run < CRITICAL:
            text = (
                f"of the last {count_text(run, 'particle')} with a free cell ahead, none moved,"
                " which slips do not explain: the magnets do nothing, or the camera shows an old"
                " picture"
            )
            return Alarm("still", move, f"move {move}: {text}")
        for letter, seen in self.stays.items():
            stays, trials = total(seen)
            others = total(
                [pair for other in self.stays if other != letter for pair in self.stays[other]]
            )
            expected = max(self.staying, 0.2, others[0] / others[1] if others[1] > LEAST else 0.0)
            run = last_stays(seen)
            # a weak coil, or one far away, moves some of the particles
            if expected**run < CRITICAL or tail(stays, trials, max(expected, 0.5)) < CRITICAL:
                text = (
                    f"command {letter!r}: of {count_text(trials, 'particle')} with a free cell"
                    f" ahead, {stays} stayed, the last {run} in a row, which slips do not"
                    " explain: this direction of the magnets does nothing"
                )
                return Alarm("still", move, f"move {move}: {text}")
        if self._leaping < CRITICAL and (
            self.leaps_together > -log(DEMONSTRATED)
            or tail(self.leapt.events, self.leapt.trials, LEAPS) < CRITICAL
        ):
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
        if self._leaping < CRITICAL and not self.leap_alone:
            alarms.append(Alarm("twice", move, self._leaps))
        trials = max(1, self.aside.trials)
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
        return alarms


def find_change(
    likelihoods: dict[int, NDArray[np.float64]], counts: NDArray[np.int64], *, ghosts: bool = False
) -> tuple[int, int, float] | None:
    """Return the number of particles at the start and now, and the evidence, or None if the scans
    do not show that the number has changed.

    Let L_n(t) be the probability of scan t if there are n particles all the time. The probability
    of all scans if the number is n before some moment and m from then on, averaged over the
    moments, is compared with the probability for the best constant number. The evidence is the
    logarithm of the ratio of the two. If the number has not changed, the ratio exceeds 1 /
    `CHANGED` with at most the probability `CHANGED` (Ville's inequality). One scan never decides:
    its ratio counts for at most `DECISIVE`.

    Parameters
    ----------
    likelihoods : dict of int to ndarray of float64, shape (scans - 1,)
        The logarithm of L_n for each number n that comes into question, without the first scan.
    counts : ndarray of int64, shape (scans,)
        The number of cells that each scan shows.
    ghosts : bool
        Whether a scan may show more cells than there are particles.

    Examples
    --------
    >>> counts = np.full(80, 3)
    >>> counts[:6] = 4
    >>> likelihoods = {3: np.zeros(79), 4: np.zeros(79) - 0.5}
    >>> find_change(likelihoods, counts)[:2]
    (4, 3)
    >>> find_change(likelihoods, np.full(80, 3))
    """
    limit, best, change = log(DECISIVE), -log(CHANGED), None
    possible = {
        number: np.where(
            (counts[1:] > number) & (not ghosts), IMPOSSIBLE, np.maximum(of_number, IMPOSSIBLE)
        )
        for number, of_number in likelihoods.items()
    }
    for last, of_last in possible.items():
        sums = {  # of the logarithms of L_n / L_last, up to each moment
            number: np.cumsum(np.clip(of_number - of_last, -limit, limit))
            for number, of_number in possible.items()
        }
        if not len(of_last):
            return None
        constant = max(float(total[-1]) for total in sums.values())
        for first, before in sums.items():
            changed = np.logaddexp.reduce(before) - log(len(before)) - constant
            if first != last and changed > best:
                best, change = changed, (first, last, float(changed))
    return change


def numbers_in_question(counts: NDArray[np.int64], miss: float) -> list[int]:
    """Return the numbers of particles that the numbers of cells in scans suggest: on average, one
    more and one less, and in the first and the last `WINDOW` scans.

    Examples
    --------
    >>> numbers_in_question(np.array([7] * 40 + [4] * 80), miss=0.0)
    [4, 5, 6, 7]
    """
    mean, first, last = (
        round(float(part.mean()) / (1 - miss))
        for part in (counts, counts[:WINDOW], counts[-WINDOW:])
    )
    return sorted({max(0, number) for number in (mean - 1, mean, mean + 1, first, last)})


def weigh_counts(counts: NDArray[np.int64]) -> dict[int, NDArray[np.float64]]:
    """Return the log-likelihood of the number of detections in each scan after the first, for each
    number of particles that comes into question, if a scan shows each particle by itself, also
    where several are in one cell.

    Of n particles, a scan shows each one with the probability 1 - m, and besides a number of ghosts
    from a Poisson distribution with the mean g. The values m and g of `MISSES` and `SURPLUS` are
    those that explain the scans best with a constant number of particles.

    Examples
    --------
    >>> {n: round(float(of.sum())) for n, of in weigh_counts(np.array([5, 5, 5, 4, 5, 5])).items()}
    {2: -73, 3: -45, 4: -19, 5: -3, 6: -12}
    """
    from scipy.special import gammaln, xlogy

    least, most = int(np.quantile(counts, 0.05)) - 2, int(np.quantile(counts, 0.95)) + 2
    best: dict[int, NDArray[np.float64]] = {}
    seen = np.arange(counts.max() + 1)
    for miss in MISSES:
        for surplus in SURPLUS:
            ghosts = xlogy(seen, surplus) - surplus - gammaln(seen + 1)
            of_numbers = {}
            for number in range(max(0, least), most):
                shown = np.full(len(seen), -np.inf)
                k = seen[: number + 1]
                shown[k] = (
                    gammaln(number + 1)
                    - gammaln(k + 1)
                    - gammaln(number - k + 1)
                    + xlogy(k, 1 - miss)
                    + xlogy(number - k, miss)
                )
                log_sums = [np.logaddexp.reduce(shown[: c + 1] + ghosts[c::-1]) for c in seen]
                of_numbers[number] = np.array(log_sums)[counts[1:]]
            if not best or _best_sum(of_numbers) > _best_sum(best):
                best = of_numbers
    return best


def _best_sum(likelihoods: dict[int, NDArray[np.float64]]) -> float:
    return max(float(np.maximum(of, IMPOSSIBLE).sum()) for of in likelihoods.values())


def with_number(chances: NDArray[np.float64], number: int) -> None:
    """Change independent probabilities of particles in cells, so that their sum is a given number.

    All odds are multiplied by one factor, as if the number were known in addition: p' = x p / (1 -
    p + x p), and x solves sum(p') = number (Newton's method on log x, between shrinking bounds).

    Examples
    --------
    >>> chances = np.array([0.9, 0.5, 0.1, 0.0])
    >>> with_number(chances, 2)
    >>> np.round(chances, 2).tolist()
    [0.97, 0.77, 0.27, 0.0]
    """
    from scipy.special import expit, logit

    at = np.flatnonzero(chances)
    if len(at) <= number or not number:
        chances[at] = np.minimum(1.0, number)
        return
    odds, low, high, shift = logit(np.minimum(chances[at], 1 - 1e-9)), -40.0, 40.0, 0.0
    for _ in range(40):
        held = expit(odds + shift)
        excess = float(held.sum()) - number
        if abs(excess) < 1e-3:
            break
        low, high = (low, shift) if excess > 0 else (shift, high)
        shift -= excess / max(float((held * (1 - held)).sum()), 1e-12)
        if not low < shift < high:
            shift = (low + high) / 2
    chances[at] = expit(odds + shift)


@dataclass(frozen=True)
class Misdeed:
    """What a rig did with some of its commands instead of carrying them out once.

    Parameters
    ----------
    kind : str
        The kind of the alarm.
    share : float
        The likeliest share of such commands.
    text : str
        The alarm, for people.
    evidence : float
        Logarithm of the ratio that `find_misdeed` describes.
    """

    kind: str
    share: float
    text: str
    evidence: float


MISDEEDS = (
    ("commands", "not carried out"),
    ("twice", "carried out twice"),
    ("commands", "carried out in another direction"),
    ("commands", "carried out late, together with the next command"),
)


def find_misdeed(deeds: NDArray[np.float64]) -> Misdeed | None:
    """Return what the rig did with some of its commands instead of carrying them out once, or None.

    Let L_i(t) be the probability of scan t if the command before it was carried out in the way i,
    and L_0(t) if it was carried out once. If the rig is honest, L_i(t) / L_0(t) is 1 on average,
    and so is the product over t of 1 - s + s L_i(t) / L_0(t) for every share s of such commands:
    the average of these products over shares and ways exceeds 1 / `DECEPTION` with at most the
    probability `DECEPTION` (Ville's inequality). One scan never decides: its ratio counts for at
    most `DECISIVE`, because the belief may have lost a particle.

    Parameters
    ----------
    deeds : ndarray of float64, shape (scans, 5)
        Log-likelihoods as `NoisyBelief.weigh_deeds` returns them.

    Examples
    --------
    >>> honest = np.zeros((60, 5)) - [0, 9, 9, 9, 9]  # each scan explained by "once"
    >>> find_misdeed(honest)
    >>> honest[::5, 2] = 4  # each fifth by "twice"
    >>> find_misdeed(honest).text
    'about 20 % of the commands were carried out twice, or the stated error rates are too low'
    """
    if not len(deeds):
        return None
    deeds = np.maximum(deeds, IMPOSSIBLE)
    ratios = np.exp(np.minimum(deeds[:, 1:] - deeds[:, :1], log(DECISIVE)))
    products = np.log1p(SHARES[:, None, None] * (ratios - 1)).sum(axis=1)  # shares, ways
    ways = np.logaddexp.reduce(products, axis=0) - log(len(SHARES))
    evidence = float(np.logaddexp.reduce(ways)) - log(len(ways))
    if evidence < -log(DECEPTION):
        return None
    kind, description = MISDEEDS[index := int(np.argmax(ways))]
    share = float(SHARES[np.argmax(products[:, index])])
    text = (
        f"about {100 * share:.0f} % of the commands were {description}, or the stated error rates"
        " are too low"
    )
    return Misdeed(kind, share, text, evidence)


def change_text(first: int, last: int) -> str:
    """Return what a change of the number of particles means, for people."""
    why = (
        "scans stopped showing a particle, for longer than the miss rate explains, unless two"
        " particles share a cell"
        if first > last
        else "scans show more particles than at the start"
    )
    return f"about {first} particles at the start, about {last} now: {why}"


def total(stays: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """Return the sums of pairs: how many particles stayed, and of how many."""
    return sum(stayed for stayed, _ in stays), sum(trials for _, trials in stays)


def last_stays(stays: Sequence[tuple[int, int]]) -> int:
    """Return how many particles stayed at the last commands at which none moved.

    Particles near each other may stay at one command, where the field is weak, so that whole
    commands count.

    Examples
    --------
    >>> last_stays([(3, 3), (8, 20), (5, 5), (2, 2)])
    7
    """
    return sum(
        trials
        for _, trials in itertools.takewhile(lambda pair: pair[0] == pair[1], reversed(stays))
    )


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
