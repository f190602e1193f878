"""Plain values of options.

Typer converts values with the library Pydantic, whose import takes a fifth of the start time of a
command.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any


class _PlainFirst:
    """Convert a value like Typer, but without Pydantic if the value is missing, a text, a whole
    number, or converted already.
    """

    def __init__(self, parameter: Any) -> None:
        self._others = parameter.get_runtime_param
        info, self._kind = (
            parameter.type_descriptor.parameter_info,
            parameter.type_descriptor.annotation,
        )
        self._plain = (
            self._kind in {str, int, float, bool} and info.parser is info.min is info.max is None
        )

    def coerce(self, value: Any, param: Any, ctx: Any) -> Any:
        """Return a converted value; the method has the interface of Typer's own converters."""
        if value is None:
            return () if param.multiple or param.nargs == -1 else None
        if self._plain and type(value) is self._kind:
            return value
        if (
            self._plain
            and self._kind is int
            and isinstance(value, str)
            and value.isascii()
            and value.isdecimal()
        ):
            return int(value)
        return self._others().coerce(value, param=param, ctx=ctx)

    def itself(self) -> _PlainFirst:
        """Return the converter itself, in place of a converter that Typer would build."""
        return self


def parse_plain_values(options: list[Any]) -> list[Any]:
    """Return the arguments and options of a command, changed so that they read plain values without
    Pydantic.

    If a version of Typer does not let Shoal replace its converters, Typer itself converts all
    values.
    """
    for one in options:
        with suppress(AttributeError):
            if not isinstance(one.get_runtime_param.__self__, _PlainFirst):
                one.get_runtime_param = _PlainFirst(one).itself
    return options
