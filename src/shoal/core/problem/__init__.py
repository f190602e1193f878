"""The class Problem: all settings of a run. A subclass declares each setting with its type, default, unit, range and help.

From these declarations, Shoal generates the options of commands, the fields of sweeps and of problem files, and the tables of the
documentation.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import fields
from functools import cache, cached_property
from itertools import islice
from typing import Any, ClassVar, Self, get_type_hints

from shoal.core.checks import shortened, suggestion
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, errors_at
from shoal.core.problem.declaration import Declaration, declaration_of, option

__all__ = ["Declaration", "Problem", "check_known", "option"]


def check_known(given: Mapping[str, Any], known: Iterable[str], *, where: str) -> None:
    """Refuse a mapping with a field whose name is not in ``known``. The error message suggests the nearest known name.

    Raises
    ------
    InvalidInputError
    """
    for name in given:
        if name not in known:
            near = suggestion(name, known)
            raise InvalidInputError(f"{where}: {name}: expected no such field, got {shortened(given[name])}{near}")


@dataclass(frozen=True, eq=False)
class Problem:
    """All settings of a run except its seed. Subclasses are frozen dataclasses with fields made by `option`."""

    part: ClassVar[str]
    """The kind of the problem, as written in files, such as "swarm", "steering" or "search"."""

    headings: ClassVar[Mapping[str, str]] = {}
    """Headings in the help of commands. The key of each heading is the name of the first field under the heading."""

    measures: ClassVar[tuple[str, ...]] = ()
    """Names of the metrics that a sweep stores for each episode."""

    censored: ClassVar[tuple[str, ...]] = ()
    """Names of the measures that grow until the task is done.

    In an unfinished episode, the value of such a measure is only a lower bound.
    """

    def __new__(cls, *values: Any, **given: Any) -> Self:
        """Keep which fields the caller gives: a field at its default is also refused where it would have no effect."""
        problem = super().__new__(cls)
        problem.__dict__["_given"] = frozenset([*islice(cls.declarations(), len(values)), *given])
        return problem

    @property
    def given(self) -> frozenset[str]:
        """Names of the fields that the maker of the problem gave, at their defaults or at other values."""
        found: frozenset[str] = self.__dict__["_given"]
        return found

    def __post_init__(self) -> None:
        for name, declared in self.declarations().items():
            object.__setattr__(self, name, declared.checked(getattr(self, name)))
        self.check_together()

    def check_together(self) -> None:
        """Refuse a problem whose fields contradict each other. Do not open the files that the fields name."""

    @classmethod
    def declarations(cls) -> Mapping[str, Declaration]:
        """Return the declarations of all fields, keyed by field name, in the order of declaration."""
        return _declarations(cls)  # type: ignore[arg-type]  # classes are hashable, whatever their instances are

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], *, where: str = "problem") -> Self:
        """Return the problem for a mapping of fields. Missing fields get their default values.

        Raises
        ------
        InvalidInputError
            Raised if a field is unknown or invalid. The error message gives the location of the field.
        """
        if not isinstance(data, Mapping):
            raise InvalidInputError(f"{where}: expected fields with values, got {shortened(data)}")
        given = {name: value for name, value in data.items() if name != "kind"}
        known = cls.declarations()
        check_known(given, known, where=where)
        for name, declared in known.items():
            if declared.required and name not in given:
                raise InvalidInputError(f"{where}: {name}: expected this field, got none")
        with errors_at(where):
            return cls(**given)

    @classmethod
    def from_file(cls, data: Any, path: str, *, trust: bool) -> Self:
        """Return the problem for the JSON data of the file ``path``.

        Raises
        ------
        InvalidInputError
            Raised if the data are invalid, or if ``trust`` is false and a field names third-party code.
        """
        if not trust:
            cls.refuse_code(data, where=path)
        return cls.from_dict(data, where=path)

    @classmethod
    def refuse_code(cls, data: Any, *, where: str, names: Iterable[str] | None = None) -> None:
        """Raise an error if a field of a file names third-party code, because opening the file would run the code.

        ``data`` contains the fields of a problem file. ``names`` lists the fields to check; by default, the method checks all
        fields.

        Raises
        ------
        InvalidInputError
            Raised if a field names third-party code. The error message contains the name of the module.
        """
        known = cls.declarations()
        for name in known if names is None else names:
            built_in, value = known[name].option.names, data.get(name) if isinstance(data, Mapping) else None
            module, colon, _ = value.partition(":") if isinstance(value, str) else ("", "", "")
            if built_in is not None and colon and module not in built_in:
                raise InvalidInputError(
                    f"{where}: {name}: expected a built-in {name}, got {shortened(value)}, which runs the code of the Python "
                    f"module {shortened(module)}: allow it with --trust (in Python trust=True) if you trust the author"
                )

    def to_dict(self, *, defaults: bool = False) -> dict[str, Any]:
        """Return the problem's fields and its ``kind`` as JSON data. Include fields with default values if ``defaults`` is true."""
        told: dict[str, Any] = {"kind": self.part}
        for name, declared in self.declarations().items():
            value = getattr(self, name)
            if defaults or declared.required or not _same(value, declared.default):
                told[name] = value if declared.option.dump is None or value is None else declared.option.dump(value)
        return told

    def canonical(self, *, without: tuple[str, ...] = ()) -> str:
        """Return the problem as a JSON text that omits default values. Equal problems give equal JSON texts."""
        told = {name: value for name, value in self.to_dict().items() if name not in without}
        return json.dumps(told, sort_keys=True, separators=(",", ":"), allow_nan=False)

    def replaced(self, **changes: Any) -> Self:
        """Return a copy of the problem with new values for some fields.

        Raises
        ------
        InvalidInputError
        """
        check_known(changes, self.declarations(), where="problem")
        kept = {name: getattr(self, name) for name in self.declarations() if name in self.given}
        return type(self)(**kept | changes)

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash(self.canonical())

    # The place of a problem, opened once. Problems without a place have none of these methods.

    @cached_property
    def place(self) -> Any:
        """The place of the problem: its map, workspace or region. The problem opens the place on first use."""
        return self.open_place()

    def open_place(self) -> Any:
        """Open and return the problem's map, workspace or region."""
        return None

    def place_key(self) -> str | None:
        """Return a text that identifies the problem's place, or None for a place without a name. Equal places give equal texts."""
        return None

    def place_is_file(self) -> bool:
        """Return whether the problem's place is a file. A worker process on another machine may not have the file."""
        return False

    def place_digest(self) -> bytes:
        """Return a digest of the place's content. A sweep compares digests to detect a changed file."""
        return b""

    def at_place(self, place: Any) -> Self:
        """Return a copy of the problem with ``place`` as its opened place."""
        same = self.replaced()
        same.__dict__["place"] = place
        return same

    def check_at_place(self) -> None:
        """Refuse settings of the problem that are impossible on its map, workspace or region.

        Raises
        ------
        InvalidInputError, UnknownNameError
        """


@cache
def _declarations(cls: type[Problem]) -> Mapping[str, Declaration]:
    hints, found, heading = get_type_hints(cls), {}, ""
    for one in fields(cls):
        heading = cls.headings.get(one.name, heading)
        found[one.name] = declaration_of(one, hints[one.name], heading)
    return found


def _same(value: Any, default: Any) -> bool:
    try:
        return type(value) is type(default) and bool(value == default)
    except ValueError:  # arrays
        return False
