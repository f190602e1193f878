"""The best strategies of mapping in very small windows, by search over states of knowledge."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from shoal.core.checks import check_number
from shoal.core.errors import InvalidInputError
from shoal.swarm.maps.workspace import GridWorkspace
from shoal.swarm.theory.bounds import (
    MOST_STATES,
    check_case,
    flat_cells,
    flat_mask,
)
from shoal.swarm.theory.small_world import SmallWorld, set_bits


@dataclass(frozen=True)
class MappingOptimum:
    """What the best strategy of mapping needs when it does not know the map.

    Parameters
    ----------
    worst : float
        Moves in the worst case, of the strategy that is best in this respect.
    mean : float
        Expected moves under the prior, of the strategy that is best in that respect.
    states : int
        States of knowledge and particles that were looked at.
    """

    worst: float
    mean: float
    states: int


def mapping_optimum(
    shape: tuple[int, ...],
    start: ArrayLike,
    *,
    chance_free: float = 0.5,
    rule: str = "block",
    most_states: int = MOST_STATES,
) -> MappingOptimum:
    """Return what the best strategies of mapping need, in the worst case and on average, by search
    over states of knowledge.

    The prior: in a window of the given shape each cell without a particle is free with
    ``chance_free``, independently; outside are walls, and those beside free cells have to be probed
    as all others.

    Parameters
    ----------
    shape : tuple of int
        Of the window; a very small one: 1 x 6, 2 x 2 or 2 x 3.
    start : array_like of int, shape (n, ndim)
    chance_free : float
        Between 0 and 1.
    rule : str
        "block" or "merge".
    most_states : int
        Give up after so many.

    Raises
    ------
    InvalidInputError

    """
    check_number(chance_free, what="chance_free", least=0, most=1)
    workspace = GridWorkspace(np.ones(shape, dtype=np.bool_))
    assert rule != "tilt", "a push is one command here"
    cells = check_case(workspace, start, "mapping", None, rule)
    window, offsets = flat_cells(workspace)
    world = SmallWorld(window, offsets, rule)
    particles = world.number(flat_mask(workspace, cells))
    states = 0
    answers = []
    for worst in (True, False):
        game = _Game(world, chance_free, worst, most_states)
        answers.append(game.value(particles, particles, particles))
        states = max(states, len(game.values))
    return MappingOptimum(answers[0], answers[1], states)


class _Game:
    """Mapping against chance or against an adversary."""

    def __init__(
        self, world: SmallWorld, chance_free: float, worst: bool, most_states: int
    ) -> None:
        self.world, self.chance, self.worst, self.most_states = (
            world,
            chance_free,
            worst,
            most_states,
        )
        self.values: dict[tuple[int, int, int], float] = {}

    def value(self, opened: int, known: int, particles: int) -> float:
        """Return the moves still needed when ``opened`` cells are known to be free and ``known``
        ones are known.
        """
        key = opened, known, particles
        if key not in self.values:
            if len(self.values) >= self.most_states:
                raise InvalidInputError(
                    f"mapping_optimum: expected a case with at most {self.most_states} states, this"
                    " has more"
                )
            self.values[key] = self._best(opened, known, particles)
        return self.values[key]

    def _frontier(self, opened: int, known: int) -> int:
        around = 0
        for offset in self.world.offsets:
            around |= self.world.shifted(opened, offset)
        return around & ~known

    def _best(self, opened: int, known: int, particles: int) -> float:
        """Walk where the outcome is known, to each place from which something can be learnt."""
        if not self._frontier(opened, known):
            return 0.0
        best, moves, wave, seen = float("inf"), 0, {particles}, {particles}
        while wave and moves + 1 < best:
            following = set()
            for here in wave:
                for command, offset in enumerate(self.world.offsets):
                    tried = self.world.shifted(here, offset) & ~known
                    if tried:
                        best = min(
                            best,
                            moves
                            + 1
                            + self._learn(opened, known, here, command, tried, best - moves - 1),
                        )
                    else:
                        following.add(self.world.push(here, command, opened))
            wave = following - seen
            seen |= wave
            moves += 1
        return best

    def _learn(
        self, opened: int, known: int, here: int, command: int, tried: int, bound: float
    ) -> float:
        """Return the moves needed after a command that settles the cells ``tried``: the worst
        outcome, or the mean.
        """
        uncertain = [1 << bit for bit in set_bits(tried & self.world.free)]
        mean = most = 0.0
        for outcome in product((False, True), repeat=len(uncertain)):
            found = sum(bit for bit, is_free in zip(uncertain, outcome, strict=True) if is_free)
            share = self.chance ** sum(outcome) * (1 - self.chance) ** (len(outcome) - sum(outcome))
            if share == 0:
                continue
            after = self.world.push(here, command, opened | found)
            value = self.value(opened | found, known | tried, after)
            most, mean = max(most, value), mean + share * value
            if (most if self.worst else mean) >= bound:
                break
        return most if self.worst else mean
