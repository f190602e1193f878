"""The adversary of a corridor, which shows that no policy with one particle is better than twice the
optimum. Source: paper M, section III.B.1.
"""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from typing import Any

import numpy as np

from shoal.core.checks import check_integer
from shoal.core.dataclass import dataclass
from shoal.swarm.grid.board import letters_of
from shoal.swarm.problem import SwarmProblem
from shoal.swarm.run import run


@dataclass(frozen=True)
class CorridorGame:
    """The result of a policy in the corridor that an adversary has chosen for it.

    Only the commands l and r count: along a corridor, u and d only touch walls.

    Parameters
    ----------
    policy : str
    left, right : int
        Numbers of free cells to the left and to the right of the start.
    moves : int
        Number of commands l and r until the policy had found both ends, or until it gave up.
    status : str
        Status of the episode; if it is not "complete", the ratio is a lower bound.
    """

    policy: str
    left: int
    right: int
    moves: int
    status: str

    @property
    def least(self) -> int:
        """Least number of commands l and r for one who knows the corridor: first to the nearer end,
        with one more move that touches it, then to the other end.
        """
        return 2 * min(self.left, self.right) + max(self.left, self.right) + 2

    @property
    def ratio(self) -> float:
        """The competitive ratio: ``moves`` by ``least``."""
        return self.moves / self.least


def play_adversary(
    policy: Any, cells: int, *, seed: int = 0, max_moves: int = 1_000_000
) -> CorridorGame:
    """Let an adversary choose a corridor against a policy with one particle, and return the result.

    The adversary of paper M, section III.B.1, decides where the corridor ends while the policy
    explores it: the corridor ends where the policy has come to on one side, and on the other side
    where it turned back without having touched the end. As a policy decides by what it has seen and by its seed, the
    adversary may first watch it in a corridor without near ends, and then choose the ends.

    Parameters
    ----------
    policy : str or Policy
    cells : int
        Largest number of free cells on each side of the start, at least 1.
    seed : int
        Seed of the policy.
    max_moves : int
        Number of commands after which a policy is stopped.

    Examples
    --------
    >>> game = play_adversary("closest-frontier", 40)
    >>> (game.left, game.right), game.moves, game.least, round(game.ratio, 3)
    ((40, 0), 82, 42, 1.952)
    """
    cells = check_integer(cells, what="cells", least=1, most=100_000)
    check_integer(max_moves, what="max_moves", least=1)
    long_corridor = _run_corridor(policy, cells, cells, seed, max_moves)
    games = []
    for left, right in _chosen_ends(_steps(long_corridor), cells):
        episode = _run_corridor(policy, left, right, seed, max_moves)
        moves = len(_steps(episode))
        games.append(CorridorGame(episode.policy, left, right, moves, str(episode.status)))
    return max(games, key=lambda game: game.ratio)


def _run_corridor(policy: Any, left: int, right: int, seed: int, max_moves: int) -> Any:
    ground = np.ones((1, left + 1 + right), dtype=np.bool_)
    problem = SwarmProblem(ground, start=((0, left),), policy=policy, max_moves=max_moves)
    return run(problem, seed=seed)


def _steps(episode: Any) -> list[int]:
    """Return the commands l and r of an episode as -1 and 1."""
    letters = letters_of(2)
    sides = {letters.index("l"): -1, letters.index("r"): 1}
    commands = episode.trace.commands[: episode.moves].tolist()
    return [sides[command] for command in commands if command in sides]


def _chosen_ends(steps: Iterable[int], cells: int) -> list[tuple[int, int]]:
    """Return the few corridors (left, right) that promise the largest ratios, from the steps of a
    policy in a corridor whose ends it does not meet.

    When the policy has first reached a cell, the corridor ends there, and at the last explored cell
    of the other side. After c moves the policy still has to touch this end, to go to the other and
    to touch it.
    """
    place, low, high = 0, 0, 0
    candidates: list[tuple[Fraction, tuple[int, int]]] = []
    for count, step in enumerate(steps, start=1):
        place += step
        if place in (low - 1, high + 1):
            low, high = min(low, place), max(high, place)
            left, right = -low, high
            if max(left, right) > cells:
                break
            least = 2 * min(left, right) + max(left, right) + 2
            candidates.append((Fraction(count + 1 + left + right + 1, least), (left, right)))
    candidates.sort(reverse=True)
    return [ends for _, ends in candidates[:3]] or [(1, 1)]
