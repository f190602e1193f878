"""How a check becomes an erratum that was checked."""

from __future__ import annotations

from collections.abc import Callable

from shoal.papers.errata import Erratum

Check = Callable[[], Erratum]
Numbers = Callable[[], tuple[str, bool]]
"""Returns the numbers of a check, and whether they show the erratum."""


def into(checks: list[Check]) -> Callable[[str, str, str, str], Callable[[Numbers], Check]]:
    """Return what makes a decorator of (source, printed, holds, check); it enters the function it decorates into ``checks``."""

    def erratum(source: str, printed: str, holds: str, check: str) -> Callable[[Numbers], Check]:
        def register(function: Numbers) -> Check:
            def checked() -> Erratum:
                try:
                    found, shown = function()
                except Exception as error:  # the other checks are run
                    found, shown = f"the check failed: {type(error).__name__}: {error}", False
                return Erratum(source, printed, holds, check, found, bool(shown))

            checks.append(checked)
            return checked

        return register

    return erratum
