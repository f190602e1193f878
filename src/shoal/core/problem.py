"""The class Problem: all settings of a run. A subclass declares each setting with its type,
default, unit, range and help.
"""

from __future__ import annotations

import json
import os
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field, field, fields, replace
from functools import cache, cached_property
from math import inf
from typing import Any, ClassVar, Self, Union, get_args, get_origin, get_type_hints

from shoal.core.checks import (
    check_bool,
    check_choice,
    check_integer,
    check_number,
    check_text,
    range_text,
    shortened,
    suggestion,
)
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, errors_at

__all__ = ["Declaration", "Problem", "check_known", "option", "option_of"]

_OPEN = 8  # number of maps, workspaces and regions that a process keeps open
_places: dict[tuple[Any, ...], Any] = {}


@dataclass(frozen=True)
class Option:
    """The arguments that declare one field of a problem.

    Parameters
    ----------
    help : str
        Help text for the user, in one or two sentences.
    unit : str
    least, most, above, below : float
        Limits of a numeric field. Each value must be at least ``least``, at most ``most``, more
        than ``above`` and less than ``below``.
    choices : tuple of str
        All valid values of a text field. If ``choices`` is empty, any text is valid.
    metavar : str
        Placeholder for the field's value in the help of a command.
    short : str
        Short form of the command line option, such as ``-n``.
    argument : bool
        Whether the field is a positional argument of commands. If ``argument`` is false, the field
        is a command line option.
    repeated : bool
        Whether users may repeat the command line option. The function ``parse`` of a repeated
        option receives a list of texts.
    parse : callable, optional
        Function that converts a command line text to the field's value. Fields for texts, numbers
        and booleans need no function ``parse``.
    check : callable, optional
        Function that checks the field's value and returns the checked value. ``check`` replaces the
        default check for the type of the field.
    dump : callable, optional
        Function that converts the field's value to JSON data.
    names : iterable of str, or callable, optional
        The built-in values of a field that also accepts third-party code, named as
        MODULE:ATTRIBUTE: for example a registry, or a function that returns it, for a registry
        whose import takes long. ``{names}`` in the help text stands for them.
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
    names: Iterable[str] | Callable[[], Iterable[str]] | None = None


@dataclass(frozen=True)
class Declaration:
    """The complete declaration of one field of a problem, for commands, files and the tables of the
    documentation.

    Parameters
    ----------
    name : str
    type : type
        The type of the field's value: int, float, bool or str. For any other type, ``type`` is
        ``object``, and ``option.check`` checks the values.
    optional : bool
        Whether None is a valid value of the field.
    default : object
        The default value of the field, or `REQUIRED` for a field without a default value.
    option : Option
    heading : str
        Heading above the field in the help of commands, or an empty text for a field without a
        heading.
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
    def names(self) -> tuple[str, ...] | None:
        """The built-in values of a field that also accepts third-party code, otherwise None."""
        names = self.option.names
        return None if names is None else tuple(names() if callable(names) else names)

    @property
    def help(self) -> str:
        """The help text, with the names of the built-in values in place."""
        text = self.option.help
        return text.replace("{names}", ", ".join(self.names or ())) if "{names}" in text else text

    @property
    def range(self) -> str:
        """The range of the field's values as text, such as "from 0 to 1". For a field without a
        range, the text is empty.
        """
        option = self.option
        return range_text(option.least, option.most, option.above, option.below)

    def checked(self, value: Any) -> Any:
        """Check a value and return it in the form that the field stores."""
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
            return (
                " ".join(self.text(one) for one in value) if deep else ",".join(map(_plain, value))
            )
        return str(value)

    def value_of(self, text: Any) -> Any:
        """Return the value that a text on the command line describes."""
        if self.option.parse is None:
            return text
        try:
            return self.option.parse(text)
        except InvalidInputError:
            raise
        except ValueError as error:
            # Python's own words, such as "invalid literal for int()", say neither what is expected
            # nor what came
            why = (
                str(error)
                if "expected" in str(error)
                else f"expected {self.option.metavar or 'numbers'}, got {shortened(text)}"
            )
            raise InvalidInputError(f"{self.flag}: {why}") from None


def _plain(value: Any) -> str:
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)


REQUIRED: Any = MISSING
"""A marker that stands for the missing default of a required field."""


def option(default: Any = REQUIRED, *, help: str, **more: Any) -> Any:  # noqa: A002 - as in argparse
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


def option_of(kind: type[Problem], name: str, **changes: Any) -> Any:
    """Declare a field as the problem ``kind`` declares its field ``name``, except for changes such
    as ``help`` or ``default``.
    """
    declared = kind.declarations()[name]
    default = changes.pop("default", declared.default)
    return field(default=default, metadata={"option": replace(declared.option, **changes)})


def declaration_of(class_field: Field[Any], value_type: Any, heading: str) -> Declaration:
    """Return the declaration of a dataclass field made by `option`, including the field's type and
    heading.
    """
    parts = (
        get_args(value_type)
        if get_origin(value_type) in (Union, types.UnionType)
        else (value_type,)
    )
    kinds = [part for part in parts if part is not type(None)]
    kind = kinds[0] if len(kinds) == 1 and kinds[0] in (int, float, bool, str) else object
    declared: Option = class_field.metadata["option"]
    if kind is object and declared.check is None:
        raise TypeError(
            f"{class_field.name}: expected int, float, bool, str or an option with its own check, got"
            f" {value_type}"
        )
    return Declaration(
        class_field.name, kind, len(kinds) < len(parts), class_field.default, declared, heading
    )


def check_known(given: Mapping[str, Any], known: Iterable[str], *, where: str) -> None:
    """Refuse a mapping with a field whose name is not in ``known``. The error message suggests the
    nearest known name.
    """
    for name in given:
        if name not in known:
            near = suggestion(name, known)
            raise InvalidInputError(
                f"{where}: {name}: expected no such field, got {shortened(given[name])}{near}"
            )


@dataclass(frozen=True, eq=False)
class Problem:
    """All settings of a run except its seed. Subclasses are frozen dataclasses with fields made by
    `option`.
    """

    part: ClassVar[str]
    """The kind of the problem, as written in files, such as "swarm", "steering" or "search"."""

    headings: ClassVar[Mapping[str, str]] = {}
    """Headings in the help of commands. The key of each heading is the name of the first field
    under the heading.
    """

    measures: ClassVar[tuple[str, ...]] = ()
    """Names of the metrics that a sweep stores for each episode."""

    censored: ClassVar[tuple[str, ...]] = ()
    """Names of the measures that grow until the task is done.

    In an unfinished episode, the value of such a measure is only a lower bound.
    """

    def __new__(cls, *values: Any, **given: Any) -> Self:
        """Keep which fields the caller gives: a field at its default is also refused where it would
        have no effect. Who gives all fields, as `dataclasses.replace` does, means those that differ
        from their defaults.
        """
        problem = super().__new__(cls)
        names = cls.declarations()
        values_of = dict(zip(names, values, strict=False)) | given
        if len(values_of) == len(names):
            values_of = {
                name: value
                for name, value in values_of.items()
                if not _same(value, names[name].default)
            }
        problem.__dict__["_given"] = frozenset(values_of)
        return problem

    @property
    def given(self) -> frozenset[str]:
        """Names of the fields that the maker of the problem gave, at their defaults or at other
        values.
        """
        names: frozenset[str] = self.__dict__["_given"]
        return names

    def __post_init__(self) -> None:
        for name, declared in self.declarations().items():
            object.__setattr__(self, name, declared.checked(getattr(self, name)))
        self.check_together()

    def check_together(self) -> None:
        """Refuse a problem whose fields contradict each other. Do not open the files that the
        fields name.
        """

    @classmethod
    def declarations(cls) -> Mapping[str, Declaration]:
        """Return the declarations of all fields, keyed by field name, in the order of
        declaration.
        """
        # classes are hashable, whatever their instances are
        return _declarations(cls)  # type: ignore[arg-type]

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], *, where: str = "problem") -> Self:
        """Return the problem for a mapping of fields. Missing fields get their default values.

        Raises
        ------
        InvalidInputError
            Raised if a field is unknown or invalid. The error message gives the location of the
            field.
        """
        if not isinstance(data, Mapping):
            raise InvalidInputError(f"{where}: expected fields with values, got {shortened(data)}")
        values = {name: value for name, value in data.items() if name != "kind"}
        known = cls.declarations()
        check_known(values, known, where=where)
        for name, declared in known.items():
            if declared.required and name not in values:
                raise InvalidInputError(f"{where}: {name}: expected this field, got none")
        with errors_at(where):
            return cls(**values)

    @classmethod
    def from_file(cls, data: Any, path: str, *, trust: bool) -> Self:
        """Return the problem for the JSON data of the file ``path``.

        Raises
        ------
        InvalidInputError
            Raised if the data are invalid, or if ``trust`` is false and a field names third-party
            code.
        """
        if isinstance(data, Mapping):
            if "problem" in data:
                raise InvalidInputError(
                    f"{path}: expected a problem, got an episode, whose field problem is one"
                )
            if data.get("kind", cls.part) != cls.part:
                raise InvalidInputError(
                    f"{path}: kind: expected {cls.part}, got {shortened(data['kind'])}"
                )
        if not trust:
            cls.refuse_code(data, where=path)
        return cls.from_dict(data, where=path)

    @classmethod
    def refuse_code(cls, data: Any, *, where: str, names: Iterable[str] | None = None) -> None:
        """Raise an error if a field of a file names third-party code, because opening the file
        would run the code.

        ``data`` contains the fields of a problem file. ``names`` lists the fields to check; by
        default, the method checks all fields.

        Raises
        ------
        InvalidInputError
            Raised if a field names third-party code. The error message contains the name of the
            module.
        """
        for name in cls.declarations() if names is None else names:
            value = data.get(name) if isinstance(data, Mapping) else None
            if (one := cls.names_code(name, value)) is not None:
                raise InvalidInputError(
                    f"{where}: {name}: expected a built-in {name}, got {shortened(one)}, which"
                    f" runs the code of the Python module {shortened(one.partition(':')[0])}: allow"
                    " it with --trust (in Python trust=True) if you trust the author"
                )

    @classmethod
    def names_code(cls, name: str, value: Any) -> str | None:
        """Return the part of a field's value that names third-party code, or None.

        Of the fields of a file, such a value runs the code of a Python module.
        """
        declared = cls.declarations()[name]
        if value is None or (built_in := declared.names) is None:
            return None
        given = declared.value_of(value) if isinstance(value, str) else value
        for one in given if isinstance(given, list | tuple) else (given,):
            module, colon, _ = one.partition(":") if isinstance(one, str) else ("", "", "")
            if colon and module not in built_in:
                return str(one)
        return None

    def to_dict(self, *, defaults: bool = False) -> dict[str, Any]:
        """Return the problem's fields and its ``kind`` as JSON data. Include fields with default
        values if ``defaults`` is true.
        """
        data: dict[str, Any] = {"kind": self.part}
        for name, declared in self.declarations().items():
            value = getattr(self, name)
            if defaults or declared.required or not _same(value, declared.default):
                data[name] = (
                    value
                    if declared.option.dump is None or value is None
                    else declared.option.dump(value)
                )
        return data

    def canonical(self, *, without: tuple[str, ...] = ()) -> str:
        """Return the problem as a JSON text that omits default values. Equal problems give equal
        JSON texts.
        """
        data = {name: value for name, value in self.to_dict().items() if name not in without}
        return json.dumps(data, sort_keys=True, separators=(",", ":"), allow_nan=False)

    def replaced(self, **changes: Any) -> Self:
        """Return a copy of the problem with new values for some fields."""
        check_known(changes, self.declarations(), where="problem")
        given_values = {
            name: getattr(self, name) for name in self.declarations() if name in self.given
        }
        return type(self)(**given_values | changes)

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash(self.canonical())

    # The place of a problem, opened once. Problems without a place have none of these methods.

    @cached_property
    def place(self) -> Any:
        """The place of the problem: its map, workspace or region. The problem opens the place on
        first use.
        """
        return self.open_place()

    def open_place(self) -> Any:
        """Open and return the problem's map, workspace or region."""
        return None

    def place_key(self) -> str | None:
        """Return a text that identifies the problem's place, or None for a place without a name.
        Equal places give equal texts.
        """
        return None

    def place_files(self) -> tuple[str, ...]:
        """Return the existing files and folders from which the problem reads its place. A worker
        process on another machine may not have them.
        """
        return ()

    def place_is_file(self) -> bool:
        """Return whether the problem's place, or a part of it, is a file or a folder."""
        return bool(self.place_files())

    def place_digest(self) -> bytes:
        """Return a digest of the place's content. A sweep compares digests to detect a changed
        file.
        """
        return b""

    def other_files(self) -> dict[str, bytes]:
        """Return the contents of the files that the problem reads besides its place, each by the
        text that names the file.
        """
        return {}

    def at_place(self, place: Any) -> Self:
        """Return a copy of the problem with ``place`` as its opened place."""
        same = self.replaced()
        same.__dict__["place"] = place
        return same

    def opened(self) -> Self:
        """Return the problem with its place opened. Problems with equal places share an opened
        place, as long as its files are unchanged.
        """
        name = self.place_key()
        if name is None:
            return self
        key = (self.part, name, *map(_stamp, self.place_files()))
        if key not in _places:
            if len(_places) >= _OPEN:
                del _places[next(iter(_places))]
            _places[key] = self.open_place()
        return self.at_place(_places[key])

    def check_at_place(self) -> None:
        """Refuse settings of the problem that are impossible on its map, workspace or region."""


@cache
def _declarations(cls: type[Problem]) -> Mapping[str, Declaration]:
    hints, declarations, heading = get_type_hints(cls), {}, ""
    for class_field in fields(cls):
        heading = cls.headings.get(class_field.name, heading)
        declarations[class_field.name] = declaration_of(
            class_field, hints[class_field.name], heading
        )
    return declarations


def _stamp(path: str) -> tuple[int, ...]:
    """Return the times at which a file, or a folder and its files, were last written."""
    inside = os.scandir(path) if os.path.isdir(path) else ()
    times = sorted(entry.stat(follow_symlinks=False).st_mtime_ns for entry in inside)
    return os.stat(path).st_mtime_ns, *times


def _same(value: Any, default: Any) -> bool:
    try:
        return type(value) is type(default) and bool(value == default)
    except ValueError:  # arrays
        return False
