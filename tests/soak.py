"""How often a test repeats what chance varies: few times in the suite, many times in `make soak`."""

from __future__ import annotations

import os

SOAK = "SHOAL_SOAK" in os.environ


def often(usual: int, soak: int) -> int:
    """Return ``usual``, or ``soak`` if the environment variable SHOAL_SOAK is set."""
    return soak if SOAK else usual
