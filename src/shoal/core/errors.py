"""The exceptions that Shoal raises for bad input.

Every exception class of Shoal is a subclass of `ShoalError` and of the matching built-in class, so
``except ValueError`` works as usual. The message of an exception is one sentence with the expected
value, the given value and the location of the given value. A planner that finds no plan raises no
exception: the status of the episode reports the failure.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

LONGEST_ECHO = 200
"""Maximum length of one word or quotation in an error message, in characters. Texts from input
files can be of any length.
"""

_LONG = re.compile(rf"'(?:[^'\\\n]|\\.){{{LONGEST_ECHO},}}'|[^\s']{{{LONGEST_ECHO + 1},}}")


class ShoalError(Exception):
    """Base class of all exceptions that Shoal raises on purpose.

    The constructor shortens each word and each quotation of more than `LONGEST_ECHO` characters in
    the message.
    """

    def __init__(self, *arguments: Any) -> None:
        super().__init__(
            *(_LONG.sub(_ends, one) if isinstance(one, str) else one for one in arguments)
        )


def _ends(found: re.Match[str]) -> str:
    return f"{found[0][: LONGEST_ECHO // 2]}...{found[0][3 - LONGEST_ECHO // 2 :]}"


class InvalidInputError(ShoalError, ValueError):
    """Raised for a value, a map or a file that is not valid."""


class UnknownNameError(ShoalError, LookupError):
    """Raised if no object is registered under a given name."""


@contextmanager
def errors_at(where: object) -> Iterator[None]:
    """Put ``where`` in front of the message of an `InvalidInputError` or `UnknownNameError` raised
    inside the ``with`` block.
    """
    try:
        yield
    except (InvalidInputError, UnknownNameError) as error:
        raise type(error)(f"{where}: {error}") from None


def describe_error(error: BaseException, *, most: int = 500) -> str:
    """Return an exception in one line: the message of an error of Shoal, and the class and the
    first ``most`` characters of the message of any other exception.
    """
    text = " ".join(str(error).split())[:most]
    return text if isinstance(error, ShoalError) else f"{type(error).__name__}: {text}"


class OutputError(ShoalError, OSError):
    """Raised if Shoal cannot write an output file."""


class MissingExtraError(ShoalError, ImportError):
    """Raised if a function needs an optional dependency (an extra) that is not installed."""


def import_extra(module: str, needed: str, *, extra: str) -> Any:
    """Import a library of an extra. ``needed`` says what needs it, such as "NRRD volumes need
    pynrrd".
    """
    try:
        return import_module(module)
    except ImportError:
        raise MissingExtraError(f"{needed}: pip install 'shoal[{extra}]'") from None


class RigError(ShoalError, ConnectionError):
    """Raised if a rig does not answer, has stopped, or violates its protocol."""
