"""What the policies that drive one particle share."""

from __future__ import annotations

_STEPS = {"l": (0, 0, -1), "u": (0, -1, 0), "r": (0, 0, 1), "d": (0, 1, 0), "i": (-1, 0, 0), "o": (1, 0, 0)}
OPPOSITE = {"l": "r", "r": "l", "u": "d", "d": "u", "i": "o", "o": "i"}


def step_from(cell: tuple[int, ...], command: str) -> tuple[int, ...]:
    """Return the cell next to ``cell`` in the direction of ``command``.

    Examples
    --------
    >>> step_from((3, 4), "u")
    (2, 4)
    """
    step = _STEPS[command][3 - len(cell) :]
    return tuple(a + b for a, b in zip(cell, step, strict=True))
