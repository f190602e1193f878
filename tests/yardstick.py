"""How slow the machine is: tests of budgets of CPU time allow what the same work takes there."""

from __future__ import annotations

import time

_USUAL = 0.036  # CPU seconds of the loop on a quiet core at 2.8 GHz, for which the bounds hold


def slowness() -> float:
    """Return how many times the CPU time of a quiet core the same work takes now, at least 1."""
    fewest = float("inf")
    for _ in range(3):
        begun, total = time.process_time(), 0
        for number in range(10**6):
            total += number
        fewest = min(fewest, time.process_time() - begun)
    return max(1.0, fewest / _USUAL)
