"""Commands whose options are made from the declarations of a problem."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Annotated, Any

import typer

from shoal.errors import InvalidInputError
from shoal.problem import Declaration, Problem


def takes_problem(kind: type[Problem], **fixed: Any) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator for a command: its first parameter, a problem, becomes an option for each field of ``kind``.

    Parameters
    ----------
    kind : type
    **fixed
        Fields that the command settles itself; they are no options.

    Examples
    --------
    >>> from shoal.problem import option
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True, eq=False)
    ... class Walk(Problem):
    ...     part = "walk"
    ...     steps: int = option(10, help="How many steps.", least=1)
    >>> @takes_problem(Walk)
    ... def walk(problem, loud: bool = False): print(problem.steps)
    >>> list(inspect.signature(walk).parameters)
    ['steps', 'loud']
    >>> walk(steps=3)
    3
    """
    taken = {name: declared for name, declared in kind.declarations().items() if name not in fixed}

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        own = list(inspect.signature(command, eval_str=True).parameters.values())[1:]

        @functools.wraps(command)
        def wrapped(**given: Any) -> None:
            values = {name: _parsed(declared, given.pop(name)) for name, declared in taken.items() if name in given}
            command(kind(**fixed, **values), **given)

        made = [_parameter(declared) for declared in taken.values()]
        made = [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in [*made, *own]]
        vars(wrapped)["__signature__"] = inspect.Signature(made)
        wrapped.__annotations__ = {one.name: one.annotation for one in made}
        del vars(wrapped)["__wrapped__"]  # else the signature of the command itself would be read
        return wrapped

    return decorate


def _parameter(declared: Declaration) -> inspect.Parameter:
    option = declared.option
    by_text = option.parse is not None or declared.type is object
    kind: Any = str if by_text else declared.type
    if option.repeated:
        kind = list[str]
    default = inspect.Parameter.empty if declared.required else _default(declared)
    if declared.optional or default is None:
        kind = kind | None
    told: dict[str, Any] = {"help": help_of(declared), "show_default": default not in (None, "", inspect.Parameter.empty)}
    if option.metavar:
        told["metavar"] = option.metavar
    if option.argument:
        info: Any = typer.Argument(**told)
    else:
        info = typer.Option(*([option.short] if option.short else []), _flags(declared), **told)
    return inspect.Parameter(declared.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, info])


def help_of(declared: Declaration) -> str:
    """Return the help of an option: what it is, its values, its unit and its range."""
    option = declared.option
    unit = f" Unit: {option.unit}." if option.unit else ""
    choices = f" One of {', '.join(option.choices)}." if option.choices else ""
    return f"{option.help}{choices}{unit}"


def _flags(declared: Declaration) -> str:
    return (
        f"{declared.flag}/--no-{declared.flag[2:]}" if declared.type is bool and declared.default in (None, True) else declared.flag
    )


def _default(declared: Declaration) -> Any:
    """Return the default as the command line writes it; None for one that has no text."""
    option, default = declared.option, declared.default
    if option.parse is None or isinstance(default, str):
        return default
    return None if default is None or default == () else str(default)


def _parsed(declared: Declaration, given: Any) -> Any:
    """Return the value that a text of the command line means."""
    if given is None or (declared.option.repeated and not given):
        return None if declared.required else declared.default
    parse = declared.option.parse
    if parse is None or (isinstance(given, str) and not declared.required and given == _default(declared)):
        return declared.default if parse is not None else given
    try:
        return parse(given)
    except InvalidInputError:
        raise
    except ValueError as error:
        raise InvalidInputError(f"{declared.flag}: {error}") from None
