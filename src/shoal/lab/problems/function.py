"""Trials of anybody's function."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, Literal

from pydantic import Field

from shoal.errors import InvalidInputError
from shoal.lab.problems.base import Problem, Values
from shoal.registry import Registry


class FunctionProblem(Problem):
    """Anybody's function, "module:attribute": called with ``seed`` and ``arguments``, it returns a dict of what it measured.

    The function names its measures: it has an attribute ``measures``, a tuple of the keys of what it returns.
    """

    kind: Literal["function"]
    function: str
    arguments: dict[str, Any] = Field(default_factory=dict)

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of what the function measures."""
        found = getattr(self.opened(), "measures", ())
        if not found or not all(isinstance(name, str) for name in found):
            raise InvalidInputError(
                f"function {self.function}: expected an attribute measures that names what it returns, got none"
            )
        return tuple(found)

    def opened(self) -> Callable[..., Any]:
        """Return the function."""
        found = Registry[Callable[..., Any]]("function").get(self.function)
        if not callable(found):
            raise InvalidInputError(f"function {self.function}: expected something to call, got {found!r:.80}")
        return found

    def check(self, opened: Any) -> None:
        """Refuse arguments that the function does not take."""
        try:
            inspect.signature(opened).bind(seed=0, **self.arguments)
        except TypeError as error:
            raise InvalidInputError(f"function {self.function}: {error}") from None

    def play(self, opened: Any, seed: int) -> Values:
        """Call it."""
        found = opened(seed=seed, **self.arguments)
        if not isinstance(found, dict) or {*found} != {*self.columns}:
            raise InvalidInputError(f"function {self.function}: expected a dict of {', '.join(self.columns)}, got {found!r:.80}")
        return [found[name] for name in self.columns]
