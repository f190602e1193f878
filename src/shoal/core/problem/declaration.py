"""Declarations of the fields of problems: type, default, unit, range, help text, check, and conversion to text."""

from __future__ import annotations

import types
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, field
from math import inf
from typing import Any, Union, get_args, get_origin

from shoal.core.checks import check_bool, check_choice, check_integer, check_number, check_text, range_text, shortened
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError


@dataclass(frozen=True)
class Option:
    """The arguments that declare one field of a problem.

    Parameters
    ----------
    help : str
        Help text for the user, in one or two sentences.
    unit : str
    least, most, above, below : float
        Limits of a numeric field. Each value must be at least ``least``, at most ``most``, more than ``above`` and less than
        ``below``.
    choices : tuple of str
        All valid values of a text field. If ``choices`` is empty, any text is valid.
    metavar : str
        Placeholder for the field's value in the help of a command.
    short : str
        Short form of the command line option, such as ``-n``.
    argument : bool
        Whether the field is a positional argument of commands. If ``argument`` is false, the field is a command line option.
    repeated : bool
        Whether users may repeat the command line option. The function ``parse`` of a repeated option receives a list of texts.
    parse : callable, optional
        Function that converts a command line text to the field's value. Fields for texts, numbers and booleans need no function
        ``parse``.
    check : callable, optional
        Function that checks the field's value and returns the checked value. ``check`` replaces the default check for the type of
        the field.
    dump : callable, optional
        Function that converts the field's value to JSON data.
    names : tuple of str, optional
        The built-in values of a field that also accepts third-party code, named as MODULE:ATTRIBUTE.
    """

    help: str
    unit: str = ""
    least: float = -inf
    most: float = inf
    above: float = -inf
    below: float = inf
    choices: tuple[str, ...] = ()
    metavar: str = ""
    short: str = ""
    argument: bool = False
    repeated: bool = False
    parse: Callable[[Any], Any] | None = None
    check: Callable[[Any], Any] | None = None
    dump: Callable[[Any], Any] | None = None
    names: tuple[str, ...] | None = None


@dataclass(frozen=True)
class Declaration:
    """The complete declaration of one field of a problem, for commands, files and the tables of the documentation.

    Parameters
    ----------
    name : str
    type : type
        The type of the field's value: int, float, bool or str. For any other type, ``type`` is ``object``, and ``option.check``
        checks the values.
    optional : bool
        Whether None is a valid value of the field.
    default : object
        The default value of the field, or `REQUIRED` for a field without a default value.
    option : Option
    heading : str
        Heading above the field in the help of commands, or an empty text for a field without a heading.
    """

    name: str
    type: Any
    optional: bool
    default: Any
    option: Option
    heading: str

    @property
    def flag(self) -> str:
        """The name of the field's command line option, such as ``--scan-every``."""
        return "--" + self.name.replace("_", "-")

    @property
    def required(self) -> bool:
        """Whether the field has no default."""
        return self.default is REQUIRED

    @property
    def range(self) -> str:
        """The range of the field's values as text, such as "from 0 to 1". For a field without a range, the text is empty."""
        option = self.option
        return range_text(option.least, option.most, option.above, option.below)

    def checked(self, value: Any) -> Any:
        """Check a value and return it in the form that the field stores.

        Raises
        ------
        InvalidInputError
        """
        option = self.option
        if value is None and self.optional:
            return None
        if option.check is not None:
            return option.check(value)
        if self.type is bool:
            return check_bool(value, what=self.name)
        if self.type is int:
            return check_integer(value, what=self.name, least=option.least, most=option.most)
        if self.type is float:
            limits = {name: getattr(option, name) for name in ("least", "most", "above", "below")}
            return check_number(value, what=self.name, **limits)
        if option.choices:
            return check_choice(value, what=self.name, choices=option.choices)
        return check_text(value, what=self.name)

    def text(self, value: Any) -> str:
        """Return a value as command line text, such as '1,2' for numbers or '1,2 3,4' for points.

        In the text of a mapping, such as 'multirotor,cruise_speed=5', the first value has no name.
        """
        if isinstance(value, Mapping):
            first, *others = value.items()
            return ",".join([str(first[1]), *(f"{name}={_plain(one)}" for name, one in others)])
        if isinstance(value, list | tuple):
            deep = any(isinstance(one, list | tuple) for one in value)
            return " ".join(self.text(one) for one in value) if deep else ",".join(map(_plain, value))
        return str(value)

    def value_of(self, text: Any) -> Any:
        """Return the value that a text on the command line describes.

        Raises
        ------
        InvalidInputError
        """
        if self.option.parse is None:
            return text
        try:
            return self.option.parse(text)
        except InvalidInputError:
            raise
        except ValueError as error:
            # Python's own words, such as "invalid literal for int()", say neither what is expected nor what came
            why = str(error) if "expected" in str(error) else f"expected {self.option.metavar or 'numbers'}, got {shortened(text)}"
            raise InvalidInputError(f"{self.flag}: {why}") from None


def _plain(value: Any) -> str:
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)


REQUIRED: Any = MISSING
"""A marker that stands for the missing default of a required field."""


def option(default: Any = REQUIRED, *, help: str, **more: Any) -> Any:  # noqa: A002 - the word that every reader expects
    """Declare a field of a problem. `Option` lists the keyword arguments.

    Examples
    --------
    >>> from shoal.core.problem import Problem
    >>> @dataclass(frozen=True)
    ... class Walk(Problem):
    ...     part = "walk"
    ...     steps: int = option(10, help="How many steps.", least=1)
    >>> Walk(steps=3).to_dict()
    {'kind': 'walk', 'steps': 3}
    >>> Walk(steps=0)
    Traceback (most recent call last):
    ...
    shoal.core.errors.InvalidInputError: steps: expected a whole number, 1 or more, got 0
    """
    return field(default=default, metadata={"option": Option(help=help, **more)})


def declaration_of(one: Field[Any], value_type: Any, heading: str) -> Declaration:
    """Return the declaration of a dataclass field made by `option`, including the field's type and heading."""
    parts = get_args(value_type) if get_origin(value_type) in (Union, types.UnionType) else (value_type,)
    kinds = [part for part in parts if part is not type(None)]
    kind = kinds[0] if len(kinds) == 1 and kinds[0] in (int, float, bool, str) else object
    made: Option = one.metadata["option"]
    if kind is object and made.check is None:
        raise TypeError(f"{one.name}: expected int, float, bool, str or an option with its own check, got {value_type}")
    return Declaration(one.name, kind, len(kinds) < len(parts), one.default, made, heading)
