"""Commands in all directions that look for the particles where a policy has no commands although the mapping is not complete."""

from __future__ import annotations

from shoal.swarm.kernels.noise.noisy_episode import PATIENCE


class Lookout:
    """Chooses commands that show where the particles are.

    A policy sees a particle only where the belief is surer than 0.5, and plans only through cells that are classified as free. If
    errors are frequent or particles are few, it may therefore find no path although particles may still enter unclassified cells.
    Commands in all directions in turn then show where the particles are. After `PATIENCE` commands that classify no further cell,
    the lookout gives up, so that every episode ends.

    Examples
    --------
    >>> lookout = Lookout()
    >>> [lookout.next(5, ndim=2) for _ in range(5)]
    [0, 1, 2, 3, 0]
    >>> sum(lookout.next(5, ndim=2) is not None for _ in range(1000))
    45
    """

    def __init__(self) -> None:
        self._known, self._sent = 0, 0

    def next(self, known: int, *, ndim: int) -> int | None:
        """Return the number of the next command, or None to give up. ``known`` is the number of classified cells."""
        if known > self._known:  # looking for the particles was worth it
            self._known, self._sent = known, 0
        if self._sent >= PATIENCE:
            return None
        self._sent += 1
        return (self._sent - 1) % (2 * ndim)
