"""The errors that Shoal raises for bad input.

Every one of them is a `ShoalError` and also the built-in error that a Python programmer would expect, so
``except ValueError`` keeps working. Their text is one sentence that says what was expected, what came, and where.
A planner that finds nothing does not raise: its result says so.
"""

from __future__ import annotations

import re
from typing import Any

LONGEST_ECHO = 200
"""Characters of one word or quotation in a message: what came may be a stranger's, and of any length."""

_LONG = re.compile(rf"'(?:[^'\\\n]|\\.){{{LONGEST_ECHO},}}'|[^\s']{{{LONGEST_ECHO + 1},}}")


class ShoalError(Exception):
    """Base of all errors raised on purpose by Shoal. Of words longer than `LONGEST_ECHO` it tells beginning and end."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*(_LONG.sub(_ends, one) if isinstance(one, str) else one for one in arguments))


def _ends(found: re.Match[str]) -> str:
    return f"{found[0][: LONGEST_ECHO // 2]}...{found[0][3 - LONGEST_ECHO // 2 :]}"


class InvalidInputError(ShoalError, ValueError):
    """A value, map or file does not fit what was expected."""


class UnknownNameError(ShoalError, LookupError):
    """No object is registered under the given name."""


class OutputError(ShoalError, OSError):
    """A result could not be written."""


class MissingExtraError(ShoalError, ImportError):
    """An optional dependency (an extra) is needed and not installed."""


class RigError(ShoalError, ConnectionError):
    """A rig does not answer, has stopped, or does what no rig of its kind can do."""
