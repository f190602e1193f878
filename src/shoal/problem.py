"""Problem: everything that defines a run, each field declared once with its type, default, unit, range and help.

The options of commands, the fields of sweeps and problem files and the tables of the documentation are made from these
declarations, so their defaults cannot differ.
"""

from __future__ import annotations

import json
import types
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, Field, field, fields, replace
from functools import cache, cached_property
from math import inf
from pathlib import Path
from typing import Any, ClassVar, Self, Union, get_args, get_origin, get_type_hints

from shoal.checks import (
    check_bool,
    check_choice,
    check_integer,
    check_number,
    check_text,
    parse_json,
    range_text,
    read_text,
    shortened,
    suggestion,
)
from shoal.dataclass import dataclass
from shoal.errors import InvalidInputError, UnknownNameError

LARGEST_PROBLEM = 20_000_000
"""Bytes of a problem file."""


@dataclass(frozen=True)
class Option:
    """What is declared of one field of a problem.

    Parameters
    ----------
    help : str
        One sentence or two.
    unit : str
    least, most, above, below : float
        The range of a number: from ``least`` to ``most``, above ``above``, below ``below``.
    finite : bool
        Whether a number must be finite.
    choices : tuple of str
        All values that a text may have; empty if any.
    metavar : str
        What stands for the value in the help of a command.
    short : str
        A short form of the command's option, as ``-n``.
    argument : bool
        Whether commands take it by position.
    repeated : bool
        Whether commands take the option several times; ``parse`` then gets a list of texts.
    parse : callable, optional
        Makes the value of a command line's text, where that is no text, number or truth value.
    check : callable, optional
        Takes the value, returns the checked one; in place of the check that the type implies.
    dump : callable, optional
        Makes of the value what JSON can hold.
    names : tuple of str, optional
        For a field whose value may name somebody's code, MODULE:ATTRIBUTE: the names that are built in.
    """

    help: str
    unit: str = ""
    least: float = -inf
    most: float = inf
    above: float = -inf
    below: float = inf
    finite: bool = True
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
    """A field of a problem, as commands, files and tables need it.

    Parameters
    ----------
    name : str
    type : type
        int, float, bool, str, or ``object`` where the option has a ``check`` of its own.
    optional : bool
        Whether None is a value.
    default : object
        `REQUIRED` if there is none.
    option : Option
    """

    name: str
    type: Any
    optional: bool
    default: Any
    option: Option

    @property
    def flag(self) -> str:
        """The option of commands."""
        return "--" + self.name.replace("_", "-")

    @property
    def required(self) -> bool:
        """Whether there is no default."""
        return self.default is REQUIRED

    @property
    def range(self) -> str:
        """The range of a number for people; empty if it has none."""
        option = self.option
        return range_text(option.least, option.most, option.above, option.below)

    def checked(self, value: Any) -> Any:
        """Return the value as the field holds it.

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
            limits = {name: getattr(option, name) for name in ("least", "most", "above", "below", "finite")}
            return check_number(value, what=self.name, **limits)
        if option.choices:
            return check_choice(value, what=self.name, choices=option.choices)
        return check_text(value, what=self.name)

    def text(self, value: Any) -> str:
        """Return a value as the command line takes it: numbers as '1,2', points and cells as '1,2 3,4', fields as 'a=1,b=2'."""
        if isinstance(value, Mapping):
            first, *others = value.items()
            return ",".join([str(first[1]), *(f"{name}={_plain(one)}" for name, one in others)])
        if isinstance(value, list | tuple):
            deep = any(isinstance(one, list | tuple) for one in value)
            return " ".join(self.text(one) for one in value) if deep else ",".join(map(_plain, value))
        return str(value)

    def value_of(self, text: Any) -> Any:
        """Return the value that a text of the command line means.

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
            raise InvalidInputError(f"{self.flag}: {error}") from None


def _plain(value: Any) -> str:
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)


REQUIRED: Any = MISSING
"""The default of a field that has none."""


def option(default: Any = REQUIRED, *, help: str, **more: Any) -> Any:  # noqa: A002 - the word that every reader expects
    """Declare a field of a problem; see `Option`.

    Examples
    --------
    >>> @dataclass(frozen=True)
    ... class Walk(Problem):
    ...     part = "walk"
    ...     steps: int = option(10, help="How many steps.", least=1)
    >>> Walk(steps=3).to_dict()
    {'kind': 'walk', 'steps': 3}
    >>> Walk(steps=0)
    Traceback (most recent call last):
    ...
    shoal.errors.InvalidInputError: steps: expected a whole number, 1 or more, got 0
    """
    return field(default=default, metadata={"option": Option(help=help, **more)})


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that defines a run but its seed. Subclasses are frozen dataclasses whose fields are made by `option`."""

    part: ClassVar[str]
    """The kind of problem, as files name it: "swarm", "steering", "search", ..."""

    measures: ClassVar[tuple[str, ...]] = ()
    """The metrics of an episode that a sweep stores."""

    censored: ClassVar[tuple[str, ...]] = ()
    """Those that grow until the task is done: of an episode that ended before they are lower bounds."""

    def __post_init__(self) -> None:
        for name, declared in self.declarations().items():
            object.__setattr__(self, name, declared.checked(getattr(self, name)))
        self.check_together()

    def check_together(self) -> None:
        """Refuse fields that do not go together; nothing is opened yet."""

    @classmethod
    def declarations(cls) -> Mapping[str, Declaration]:
        """Return what is declared of each field, by name, in order."""
        return _declarations(cls)  # type: ignore[arg-type]  # classes are hashable, whatever their instances are

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], *, where: str = "problem") -> Self:
        """Return the problem that fields describe; those that are missing have their defaults.

        Raises
        ------
        InvalidInputError
            In one sentence that says where.
        """
        if not isinstance(data, Mapping):
            raise InvalidInputError(f"{where}: expected fields with values, got {shortened(data)}")
        given = {name: value for name, value in data.items() if name != "kind"}
        known = cls.declarations()
        for name, value in given.items():
            if name not in known:
                near = suggestion(name, known)
                raise InvalidInputError(f"{where}: {name}: expected no such field, got {shortened(value)}{near}")
        for name, declared in known.items():
            if declared.required and name not in given:
                raise InvalidInputError(f"{where}: {name}: expected this field, got none")
        try:
            return cls(**given)
        except (InvalidInputError, UnknownNameError) as error:
            raise type(error)(f"{where}: {error}") from None

    @classmethod
    def load(cls, path: Any, *, trust: bool = False) -> Self:
        """Read a problem file (JSON). Code that it names, MODULE:ATTRIBUTE, is run only if ``trust`` is true.

        Raises
        ------
        InvalidInputError
        """
        source = Path(path)
        data = parse_json(read_text(source, what="problem file", most=LARGEST_PROBLEM), where=str(source))
        if not trust:
            cls.refuse_code(data, where=str(source))
        return cls.from_dict(data, where=str(source))

    @classmethod
    def refuse_code(cls, data: Any, *, where: str, names: Iterable[str] | None = None) -> None:
        """Refuse fields of a file that name somebody's code, which would be imported and run.

        ``data`` has the fields as in the file; ``names`` are those whose code would run, if not all.

        Raises
        ------
        InvalidInputError
            It says whose code.
        """
        known = cls.declarations()
        for name in known if names is None else names:
            built_in, value = known[name].option.names, data.get(name) if isinstance(data, Mapping) else None
            module, colon, _ = value.partition(":") if isinstance(value, str) else ("", "", "")
            if built_in is not None and colon and module not in built_in:
                raise InvalidInputError(
                    f"{where}: {name}: expected a built-in one, got {shortened(value)}, which runs the code of the Python module "
                    f"{shortened(module)}: allow it with --trust (in Python trust=True) if you know whose it is"
                )

    def to_dict(self, *, defaults: bool = False) -> dict[str, Any]:
        """Return the fields as JSON holds them, with ``kind``; those at their default only if asked for."""
        told: dict[str, Any] = {"kind": self.part}
        for name, declared in self.declarations().items():
            value = getattr(self, name)
            if defaults or declared.required or not _same(value, declared.default):
                told[name] = value if declared.option.dump is None or value is None else declared.option.dump(value)
        return told

    def canonical(self, *, without: tuple[str, ...] = ()) -> str:
        """Return the problem as JSON that is the same for equal problems; what has its default is left out."""
        told = {name: value for name, value in self.to_dict().items() if name not in without}
        return json.dumps(told, sort_keys=True, separators=(",", ":"), allow_nan=False)

    def replaced(self, **changes: Any) -> Self:
        """Return the problem with other fields.

        Raises
        ------
        InvalidInputError
        """
        for name, value in changes.items():
            if name not in (known := self.declarations()):
                near = suggestion(name, known)
                raise InvalidInputError(f"problem: {name}: expected no such field, got {shortened(value)}{near}")
        return replace(self, **changes)

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash(self.canonical())

    # What a problem is about, opened once. Problems without a place have none of it.

    @cached_property
    def place(self) -> Any:
        """The opened map, workspace or region; opened once."""
        return self.open_place()

    def open_place(self) -> Any:
        """Open the map, workspace or region."""
        return None

    def place_key(self) -> str | None:
        """Return a text that is equal for problems about the same place; None if there is no place, or none that has a name."""
        return None

    def place_is_file(self) -> bool:
        """Tell whether the place is a file: then it must be sent to workers, who may not have it."""
        return False

    def place_digest(self) -> bytes:
        """Return what tells the opened place from any other: a file may hold another one tomorrow."""
        return b""

    def at_place(self, place: Any) -> Self:
        """Return the problem with its place opened already."""
        same = replace(self)
        same.__dict__["place"] = place
        return same

    def check_at_place(self) -> None:
        """Refuse what no run could do at the opened place.

        Raises
        ------
        InvalidInputError, UnknownNameError
        """


@cache
def _declarations(cls: type[Problem]) -> Mapping[str, Declaration]:
    hints = get_type_hints(cls)
    return {one.name: _declared(one, hints[one.name]) for one in fields(cls)}


def _declared(one: Field[Any], hint: Any) -> Declaration:
    parts = get_args(hint) if get_origin(hint) in (Union, types.UnionType) else (hint,)
    kinds = [part for part in parts if part is not type(None)]
    kind = kinds[0] if len(kinds) == 1 and kinds[0] in (int, float, bool, str) else object
    made: Option = one.metadata["option"]
    if kind is object and made.check is None:
        raise TypeError(f"{one.name}: expected int, float, bool, str or an option with its own check, got {hint}")
    return Declaration(one.name, kind, len(kinds) < len(parts), one.default, made)


def _same(value: Any, default: Any) -> bool:
    try:
        return type(value) is type(default) and bool(value == default)
    except ValueError:  # arrays
        return False
