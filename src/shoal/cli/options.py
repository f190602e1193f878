"""The options of commands: the options that many commands share, and the options that the fields of
a problem declare.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from shoal.core.checks import shortened
from shoal.core.errors import InvalidInputError
from shoal.core.notices import tell_once
from shoal.core.problem import Declaration, Problem
from shoal.parts import read_problem

Trials = Annotated[
    int,
    typer.Option(
        "--trials",
        help=(
            "Number of trials, each with its own random start cells. A film shows the first trial."
        ),
    ),
]
Seed = Annotated[
    int,
    typer.Option(
        "--seed",
        help=(
            "Seed of all random numbers. The same seed gives the same result for any number of"
            " workers."
        ),
    ),
]


def is_given(ctx: typer.Context, name: str) -> bool:
    """Return whether an option or argument was given on the command line."""
    return getattr(ctx.get_parameter_source(name), "name", "") == "COMMANDLINE"


def _tell_unused(ctx: typer.Context, seed: int) -> int:
    if seed >= 0 and is_given(ctx, "seed"):  # a wrong one is refused
        tell_once(f"shoal: --seed has no effect on {ctx.info_name}, in which nothing is random")
    return seed


UnusedSeed = Annotated[int, typer.Option("--seed", hidden=True, callback=_tell_unused)]
"""An option without effect, for scripts that pass ``--seed`` to every command. A notice says so,
and help does not show it.
"""
Workers = Annotated[
    int | None,
    typer.Option(
        "--workers",
        help="Number of trials that run at the same time. Default: one for each processor.",
    ),
]
Processes = Annotated[
    int | None,
    typer.Option(
        "--workers",
        help=(
            "Number of worker processes. Default: one for each processor. With 0, all trials run in"
            " the process of the command."
        ),
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out",
        metavar="FOLDER",
        help="Folder for map.png, frontier.png, summary.json and the episodes.",
    ),
]
Film = Annotated[
    list[Path] | None,
    typer.Option(
        "--film",
        metavar="FILE",
        help="Write a film: .gif, .mp4 or .html (the player); the option can be repeated.",
    ),
]
Trust = Annotated[
    bool,
    typer.Option(
        "--trust",
        help=(
            "Run code that a file names as MODULE:ATTRIBUTE. Use --trust for no file except files"
            " that you trust."
        ),
    ),
]
Json = Annotated[
    bool,
    typer.Option(
        "--json",
        help="Print the result as one JSON object on stdout, without any other text on stdout.",
    ),
]


def takes_problem(
    kind: type[Problem],
    *,
    from_file: bool = False,
    only: tuple[str, ...] = (),
    options: type[Problem] | None = None,
    **fixed: Any,
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that replaces a command's first parameter (a problem) by one option for
    each field of the problem.

    Parameters
    ----------
    kind : type
    from_file : bool
        Whether the argument of the command may name a problem file. Options on the command line
        replace fields of the problem file.
    only : tuple of str
        Names of the fields that become options; an empty tuple means all fields.
    options : type, optional
        Class of the command's second parameter, if the command has one. The fields of this class
        become options, too.
    **fixed
        Fields that the command sets itself, with their values. These fields do not become options.

    Examples
    --------
    >>> from shoal.core.problem import option
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
    known = {
        name: declared for name, declared in kind.declarations().items() if not only or name in only
    }
    taken = {name: declared for name, declared in known.items() if name not in fixed}
    beside = {} if options is None else dict(options.declarations())

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        own = list(inspect.signature(command, eval_str=True).parameters.values())[
            1 + (options is not None) :
        ]

        @functools.wraps(command)
        def wrapped(**given: Any) -> None:
            texts = {name: given.pop(name) for name in taken if name in given}
            if options is not None:
                given["options"] = options(
                    **_values(beside, {name: given.pop(name) for name in beside})
                )
            if from_file:
                command(
                    _problem_of(kind, taken, texts, fixed, trust=given.pop("trust", False)), **given
                )
                return
            command(kind(**fixed, **_values(taken, texts)), **given)

        made = [_parameter(declared, from_file=from_file) for declared in taken.values()]
        if from_file:
            made.append(
                inspect.Parameter(
                    "trust", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Trust
                )
            )
        made += [_parameter(declared) for declared in beside.values()]
        # the command's own arguments come first, as in ``shoal missions check DIR REGION``
        required = [one for one in own if one.default is inspect.Parameter.empty]
        made = [*required, *made, *(one for one in own if one not in required)]
        made = [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in made]
        vars(wrapped)["__signature__"] = inspect.Signature(made)
        wrapped.__annotations__ = {one.name: one.annotation for one in made}
        # otherwise Typer reads the signature of the command itself
        del vars(wrapped)["__wrapped__"]
        return wrapped

    return decorate


def _values(known: dict[str, Declaration], texts: dict[str, Any]) -> dict[str, Any]:
    """Return the values of the options that the user has given."""
    return {
        name: parsed(known[name], text)
        for name, text in texts.items()
        if text is not None and text != []
    }


def _problem_of(
    kind: type[Problem],
    taken: dict[str, Declaration],
    texts: dict[str, Any],
    fixed: dict[str, Any],
    *,
    trust: bool,
) -> Problem:
    """Return the problem that the options define, alone or together with a problem file.

    Options replace fields of the problem file.
    """
    given = _values(taken, texts)
    place = next(name for name, declared in taken.items() if declared.option.argument)
    source = given.get(place)
    if isinstance(source, str) and Path(source).suffix == ".json":
        data = read_problem(source)
        if isinstance(data, dict) and (place in data or "kind" in data):
            for name in set(fixed) & set(data):
                if data[name] != fixed[name]:
                    raise InvalidInputError(
                        f"{source}: {name}: expected {shortened(fixed[name])}, which this command"
                        f" requires, got {shortened(data[name])}"
                    )
            options = {name: value for name, value in given.items() if name != place}
            return kind.from_file(data, source, trust=trust).replaced(
                **_other_than_defaults(kind, fixed), **options
            )
    return kind(**_other_than_defaults(kind, fixed), **given)


def _other_than_defaults(kind: type[Problem], fixed: dict[str, Any]) -> dict[str, Any]:
    """Return the fixed fields without those at their defaults, which no user has given."""
    return {
        name: value for name, value in fixed.items() if value != kind.declarations()[name].default
    }


def _parameter(declared: Declaration, *, from_file: bool = False) -> inspect.Parameter:
    option = declared.option
    by_text = option.parse is not None or declared.type is object
    kind: Any = str if by_text else declared.type
    if option.repeated:
        kind = list[str]
    default = inspect.Parameter.empty if declared.required else _default(declared)
    shown: Any = default not in (None, "", inspect.Parameter.empty)
    help_, metavar = help_of(declared), option.metavar
    if from_file and option.argument:
        default = inspect.Parameter.empty
        shown = False
        help_ = f"{help_} The argument may also be a problem file (JSON)."
    elif not option.argument:  # None: the user has not given the option
        default, shown = None, str(default) if shown and default is not False else False
    if declared.optional or default is None:
        kind = kind | None
    arguments: dict[str, Any] = {"help": help_, "show_default": shown}
    if metavar:
        arguments["metavar"] = metavar
    if option.argument:
        info: Any = typer.Argument(**arguments)
    else:
        arguments["rich_help_panel"] = declared.heading or None
        info = typer.Option(
            *([option.short] if option.short else []), _flags(declared), **arguments
        )
    return inspect.Parameter(
        declared.name,
        inspect.Parameter.KEYWORD_ONLY,
        default=default,
        annotation=Annotated[kind, info],
    )


def help_of(declared: Declaration) -> str:
    """Return the help text of an option: its description, its possible values and its unit."""
    option = declared.option
    unit = f" Unit: {option.unit}." if option.unit else ""
    choices = f" One of {', '.join(option.choices)}." if option.choices else ""
    return f"{declared.help}{choices}{unit}"


def _flags(declared: Declaration) -> str:
    return f"{declared.flag}/--no-{declared.flag[2:]}" if declared.type is bool else declared.flag


def _default(declared: Declaration) -> Any:
    """Return an option's default value in the form of the command line, or None if the default has
    no such form.
    """
    option, default = declared.option, declared.default
    if option.parse is None or isinstance(default, str):
        return default
    return None if default is None or default == () else declared.text(default)


def parsed(declared: Declaration, given: Any) -> Any:
    """Return the value of a field, converted from the text on the command line. For a missing text,
    return the default.
    """
    if given is None or (declared.option.repeated and not given):
        return None if declared.required else declared.default
    if (
        isinstance(given, str)
        and not declared.required
        and declared.option.parse is not None
        and given == _default(declared)
    ):
        return declared.default
    return declared.value_of(given)
