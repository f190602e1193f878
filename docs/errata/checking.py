"""The decorator that turns a function that computes numbers into the check of an erratum."""

from __future__ import annotations

from collections.abc import Callable

from shoal.papers.errata import Erratum

Check = Callable[[], Erratum]
Numbers = Callable[[], tuple[str, bool]]
"""A function that computes the numbers of an erratum. It returns a text with the numbers, and
whether these confirm the erratum.
"""


def into(checks: list[Check]) -> Callable[[str, str, str, str], Callable[[Numbers], Check]]:
    """Return the function ``erratum``, which makes a decorator from the texts (source, printed,
    holds, check) of an erratum.

    The decorator turns a function that computes numbers into a check, and appends the check to the
    list ``checks``.
    """

    def erratum(source: str, printed: str, holds: str, check: str) -> Callable[[Numbers], Check]:
        def register(function: Numbers) -> Check:
            def checked() -> Erratum:
                try:
                    found, shown = function()
                except Exception as error:  # the other checks must still run
                    found, shown = f"the check failed: {type(error).__name__}: {error}", False
                return Erratum(source, printed, holds, check, found, bool(shown))

            checks.append(checked)
            return checked

        return register

    return erratum
