"""A problem whose trials are calls of a third-party function."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

from shoal.core.checks import shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError
from shoal.core.problem import option
from shoal.core.registry import Registry
from shoal.lab.problems.base import MeasuredProblem


def _check_arguments(value: Any) -> dict[str, Any] | None:
    if not isinstance(value, Mapping) or not all(isinstance(name, str) for name in value):
        raise InvalidInputError(f"arguments: expected names with values, got {shortened(value)}")
    return dict(value) or None


@dataclass(frozen=True, eq=False)
class FunctionProblem(MeasuredProblem):
    """A problem whose trials call a Python function that the user names in the form "module:attribute".

    Each trial calls the function with ``seed`` and ``arguments``. The function must return a dict of measures, and must have an
    attribute ``measures``: a tuple of the names of these measures.
    """

    part = "function"

    function: str = option(help="Your function, as MODULE:ATTRIBUTE.", names=())
    arguments: Mapping[str, Any] | None = option(
        None, help="Arguments of the function, in addition to the seed.", check=_check_arguments
    )

    @property
    def measures(self) -> tuple[str, ...]:  # type: ignore[override]  # of other problems a class says it
        """The names of all measures that the third-party function returns."""
        found = getattr(self.called, "measures", ())
        if not found or not all(isinstance(name, str) for name in found):
            raise InvalidInputError(f"function {self.function}: expected an attribute measures that names its results, got none")
        return tuple(found)

    @cached_property
    def called(self) -> Callable[..., Any]:
        """The third-party function as a Python object."""
        found = Registry[Callable[..., Any]]("function").get(self.function)
        if not callable(found):
            raise InvalidInputError(f"function {self.function}: expected a function, got {shortened(found)}")
        return found

    def check_at_place(self) -> None:
        """Refuse arguments that the third-party function does not accept."""
        try:
            inspect.signature(self.called).bind(seed=0, **(self.arguments or {}))
        except TypeError as error:
            raise InvalidInputError(f"function {self.function}: {error}") from None

    def trial(self, seed: int) -> dict[str, Any]:
        """Call the third-party function, and return the measures of the trial."""
        found = self.called(seed=seed, **(self.arguments or {}))
        if not isinstance(found, dict) or {*found} != {*self.measures}:
            raise InvalidInputError(
                f"function {self.function}: expected a dict of {', '.join(self.measures)}, got {shortened(found)}"
            )
        return found
