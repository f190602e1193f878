"""Reference of the noisy world and of what a scan tells: sets and dictionaries of cells, and Bayes'
rule by listing every case.

Written from docs/concepts/noise.md. A cell is a tuple; the rim around the workspace is part of the
belief.
"""

from __future__ import annotations

import itertools
import math

STEPS = {
    "l": (0, 0, -1),
    "u": (0, -1, 0),
    "r": (0, 0, 1),
    "d": (0, 1, 0),
    "i": (-1, 0, 0),
    "o": (1, 0, 0),
}
PRIOR, LOST, CLUTTER, FAINT, SURE, LEAP = 0.25, 1e-4, 1e-6, 1e-5, 14.0, 8.0


def steps_of(ndim):
    return [STEPS[letter][3 - ndim :] for letter in "lurdio"[: 2 * ndim]]


def plus(cell, step, times=1):
    return tuple(a + times * b for a, b in zip(cell, step, strict=True))


def move(free, particles, step, slip, rng):
    """Return the particles after a command; a number is drawn for each, those ahead first and else
    in order of the array.
    """
    towards = sum(step)
    left = sorted(particles, reverse=towards > 0)
    now = set(particles)
    for cell in left:
        slipped = rng.random() < slip
        ahead = plus(cell, step)
        if not slipped and ahead in free and ahead not in now:
            now.remove(cell)
            now.add(ahead)
    return now


def look(particles, misplace, miss, rng):
    """Return where something is seen."""
    seen = set()
    for cell in sorted(particles):
        luck = rng.random()
        if luck < miss:
            continue
        if luck < miss + (1 - miss) * misplace:
            steps = steps_of(len(cell))
            seen.add(plus(cell, steps[int(rng.random() * len(steps))]))
        else:
            seen.add(cell)
    return seen


class Belief:
    """Log-odds of each cell of the window, and the probability of a particle in each."""

    def __init__(self, window, slip, misplace, miss, seen):
        self.window, self.slip, self.misplace, self.miss = set(window), slip, misplace, miss
        self.logit = dict.fromkeys(window, math.log(PRIOR / (1 - PRIOR)))
        self.inside = dict.fromkeys(window, 0.0)
        self.hit = (1 - miss) * (1 - misplace)
        self.share = (1 - miss) * misplace / len(steps_of(len(next(iter(window)))))
        right, wrong = self.hit + CLUTTER, (1 - miss) * misplace + CLUTTER
        for cell in seen:
            held = right / (right + wrong)
            self.inside[cell] = held
            free = held + (1 - held) * PRIOR
            self.logit[cell] = min(SURE, math.log(free / (1 - free)))

    def free(self, cell):
        return 1 / (1 + math.exp(-self.logit[cell])) if cell in self.window else 0.0

    def held(self, cell):
        return self.inside.get(cell, 0.0)

    def stays(self, cell, step, known):
        """Return the probability that a particle in a cell does not get on."""
        if cell not in known:
            ahead = plus(cell, step)
            taken = self.held(ahead)
            room = max(self.free(ahead), taken) - (
                taken * self.stays(ahead, step, known) if taken else 0.0
            )
            known[cell] = 1 - (1 - self.slip) * room
        return known[cell]

    def foreseen(self, step):
        """Return how likely each particle stays at a command, and where particles are after it."""
        known = {}
        staying = {cell: self.stays(cell, step, known) for cell in self.window if self.inside[cell]}
        moved = dict.fromkeys(self.window, 0.0)
        for cell, stay in staying.items():
            moved[cell] += self.inside[cell] * stay
            if plus(cell, step) in self.window:
                moved[plus(cell, step)] += self.inside[cell] * (1 - stay)
        return staying, moved

    def spread(self, step):
        """A command that no scan follows."""
        self.inside = {
            cell: held if held > FAINT else 0.0 for cell, held in self.foreseen(step)[1].items()
        }

    def update(self, step, seen):
        staying, moved = self.foreseen(step)
        logit, inside = dict(self.logit), dict.fromkeys(self.window, 0.0)
        for cell in self.window:
            behind = plus(cell, step, -1)
            if not (self.held(behind) or moved[cell] or cell in seen):
                continue
            gained, held = self.weighed(
                cell, behind, plus(cell, step, -2), staying.get(cell, 0.0), moved, seen
            )
            logit[cell] = max(-SURE, min(SURE, logit[cell] + max(-LEAP, min(LEAP, gained))))
            inside[cell] = held if held > FAINT else 0.0
        self.logit, self.inside = logit, inside

    def strays(self, cell, other, moved):
        none = 1 - CLUTTER
        for step in steps_of(len(cell)):
            if plus(cell, step) != other:
                none *= 1 - moved.get(plus(cell, step), 0.0) * self.share
        return 1 - none

    def weighed(self, cell, behind, second, stay, moved, seen):
        """List every case: is the cell free, who is where, who slips, what of each is seen."""
        free = self.free(cell)
        taken = min(self.inside[cell], free) / free
        coming = self.held(behind)
        following = self.held(second) * (1 - self.slip) if coming else 0.0
        if cell in seen and moved[cell] < LOST * free:
            coming = max(coming, LOST)
        strays = self.strays(behind, cell, moved), self.strays(cell, behind, moved)
        wall = room = particle = 0.0
        for is_behind, slips, follows, occupant, leaves in itertools.product(
            (True, False), repeat=5
        ):
            chance = (coming if is_behind else 1 - coming) * (self.slip if slips else 1 - self.slip)
            chance *= following if follows else 1 - following
            chance *= (taken if occupant else 1 - taken) * (1 - stay if leaves else stay)
            # If it is a wall there is no occupant, and who is behind stays; else it enters unless
            # it slips or is not let in.
            wall += chance * self.seen_so(
                is_behind or follows, False, behind in seen, cell in seen, strays
            )
            blocked = occupant and not leaves
            enters = is_behind and not slips and not blocked
            here = enters or blocked
            stays_behind = (is_behind and not enters) or follows
            likely = chance * self.seen_so(stays_behind, here, behind in seen, cell in seen, strays)
            room += likely
            particle += likely if here else 0.0
        total = free * room + (1 - free) * wall
        return math.log((room + 1e-300) / (wall + 1e-300)), free * particle / (total + 1e-300)

    def seen_so(self, behind, here, seen_behind, seen_here, strays):
        """Return the probability of two detections: each source shows up behind, here, or in
        neither.
        """
        sources = [((True, False), strays[0], None), ((False, True), strays[1], None)]
        if behind:
            sources.append(((True, False), self.hit, self.share))
        if here:
            sources.append(((False, True), self.hit, self.share))
        total = 0.0
        for outcome in itertools.product((0, 1, 2), repeat=len(sources)):
            chance, at_behind, at_here = 1.0, False, False
            for (own, sure, other), what in zip(sources, outcome, strict=True):
                if what == 0:
                    chance *= 1 - sure - (other or 0.0)
                elif what == 1:
                    chance *= sure
                    at_behind, at_here = at_behind or own[0], at_here or own[1]
                else:
                    chance *= other or 0.0
                    at_behind, at_here = at_behind or own[1], at_here or own[0]
            if (at_behind, at_here) == (seen_behind, seen_here):
                total += chance
        return total
