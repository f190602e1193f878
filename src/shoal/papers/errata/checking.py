"""A finding, and how a check becomes one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True)
class Finding:
    """An erratum, checked.

    Parameters
    ----------
    source : str
        Paper and place.
    printed, holds : str
    check : str
        How it was checked.
    found : str
        The numbers of the check.
    shown : bool
        Whether the check shows it.
    """

    source: str
    printed: str
    holds: str
    check: str
    found: str
    shown: bool


Check = Callable[[], Finding]
Numbers = Callable[[], tuple[str, bool]]
"""Returns the numbers of a check, and whether they show the erratum."""


def into(checks: list[Check]) -> Callable[[str, str, str, str], Callable[[Numbers], Check]]:
    """Return what makes a decorator of (source, printed, holds, check); it enters the function it decorates into ``checks``."""

    def erratum(source: str, printed: str, holds: str, check: str) -> Callable[[Numbers], Check]:
        def register(function: Numbers) -> Check:
            def checked() -> Finding:
                found, shown = function()
                return Finding(source, printed, holds, check, found, shown)

            checks.append(checked)
            return checked

        return register

    return erratum
