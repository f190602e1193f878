"""Objects by name with options: ``closest-frontier:ties=row-major``."""

from __future__ import annotations

import inspect
from typing import Any, TypeVar, cast

from shoal.errors import InvalidInputError
from shoal.registry import Registry

T = TypeVar("T")


def configured(registry: Registry[type[T]], text: str) -> T:
    """Return the object that ``NAME``, ``NAME:option=value,option=value`` or ``module:attribute`` means.

    A value without ``option=`` goes to the first option. Options are converted to the type of their default.

    Raises
    ------
    UnknownNameError
        If there is no such name.
    InvalidInputError
        If there is no such option, or its value does not fit.
    """
    name, _, options = text.partition(":")
    if name not in registry:
        found: Any = registry.get(text)
        try:
            instance: Any = found() if inspect.isclass(found) else found
        except TypeError as error:
            raise InvalidInputError(f"the {registry.kind} {text!r}: expected a class without arguments: {error}") from None
        return cast("T", instance)
    kind = registry.get(name)
    parameters = inspect.signature(kind).parameters
    chosen: dict[str, Any] = {}
    for part in filter(None, options.split(",")):
        key, equals, value = part.partition("=")
        if not equals:
            key, value = next(iter(parameters), part), part
        if key not in parameters:
            has = f"has {', '.join(parameters)}" if parameters else "has none"
            raise InvalidInputError(f"the {registry.kind} {name!r} has no option {key!r} (it {has})")
        if key in chosen:
            raise InvalidInputError(f"the {registry.kind} {name!r}: expected the option {key!r} once, got it again in {text!r}")
        chosen[key] = _converted(f"{name}: {key}", value, parameters[key].default)
    return kind(**chosen)


def _converted(what: str, value: str, default: object) -> object:
    if isinstance(default, float):
        try:
            return float(value)
        except ValueError:
            raise InvalidInputError(f"{what}: expected a number, got {value!r}") from None
    return value
