"""The exceptions that Shoal raises for bad input.

Every exception is a `ShoalError` and also the matching built-in exception, so ``except ValueError`` works as usual. The message of
an exception is one sentence with the expected value, the given value and the location of the given value. If a planner finds no
plan, the status of the episode reports this, and no exception is raised.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

LONGEST_ECHO = 200
"""Maximum length in characters of one word or quotation in a message, because input from files can be of any length."""

_LONG = re.compile(rf"'(?:[^'\\\n]|\\.){{{LONGEST_ECHO},}}'|[^\s']{{{LONGEST_ECHO + 1},}}")


class ShoalError(Exception):
    """Base class of all exceptions that Shoal raises on purpose.

    Words of a message that are longer than `LONGEST_ECHO` characters are shortened.
    """

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*(_LONG.sub(_ends, one) if isinstance(one, str) else one for one in arguments))


def _ends(found: re.Match[str]) -> str:
    return f"{found[0][: LONGEST_ECHO // 2]}...{found[0][3 - LONGEST_ECHO // 2 :]}"


class InvalidInputError(ShoalError, ValueError):
    """Raised for a value, a map or a file that is not valid."""


class UnknownNameError(ShoalError, LookupError):
    """Raised if no object is registered under a given name."""


@contextmanager
def errors_at(where: object) -> Iterator[None]:
    """Put ``where`` in front of the message of an `InvalidInputError` or `UnknownNameError` that the block raises."""
    try:
        yield
    except (InvalidInputError, UnknownNameError) as error:
        raise type(error)(f"{where}: {error}") from None


class OutputError(ShoalError, OSError):
    """Raised if a result cannot be written."""


class MissingExtraError(ShoalError, ImportError):
    """Raised if an optional dependency (an extra) is needed but not installed."""


class RigError(ShoalError, ConnectionError):
    """Raised if a rig does not answer, has stopped, or violates its protocol."""
