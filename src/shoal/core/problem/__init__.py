"""The class Problem: all settings of a run. Each setting is declared once, with its type, default, unit, range and help.

The declarations of settings generate the options of commands, the fields of sweeps and problem files, and the tables of the
documentation. Therefore commands, files and tables have the same defaults.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from functools import cache, cached_property
from typing import Any, ClassVar, Self, get_type_hints

from shoal.core.checks import shortened, suggestion
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, errors_at
from shoal.core.problem.declaration import Declaration, declaration_of, option

__all__ = ["Declaration", "Problem", "check_known", "option"]


def check_known(given: Mapping[str, Any], known: Iterable[str], *, where: str) -> None:
    """Refuse fields whose names are not in ``known``. The error message suggests the nearest known name.

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
    """All settings of a run except its seed. Subclasses are frozen dataclasses whose fields are made by `option`."""

    part: ClassVar[str]
    """The kind of problem, as in files: "swarm", "steering", "search", ..."""

    measures: ClassVar[tuple[str, ...]] = ()
    """The metrics of an episode that a sweep stores."""

    censored: ClassVar[tuple[str, ...]] = ()
    """Measures that grow until the task is done. For an unfinished episode, their values are lower bounds."""

    def __post_init__(self) -> None:
        for name, declared in self.declarations().items():
            object.__setattr__(self, name, declared.checked(getattr(self, name)))
        self.check_together()

    def check_together(self) -> None:
        """Refuse fields that contradict each other. No file is opened yet."""

    @classmethod
    def declarations(cls) -> Mapping[str, Declaration]:
        """Return the declarations of all fields by name, in order."""
        return _declarations(cls)  # type: ignore[arg-type]  # classes are hashable, whatever their instances are

    @classmethod
    def from_dict(cls, data: Mapping[str, Any], *, where: str = "problem") -> Self:
        """Return the problem for a mapping of fields. Missing fields get their default values.

        Raises
        ------
        InvalidInputError
            If a field is unknown or invalid. The message gives the location of the field.
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
            If the data are invalid, or a field names third-party code and ``trust`` is false.
        """
        if not trust:
            cls.refuse_code(data, where=path)
        return cls.from_dict(data, where=path)

    @classmethod
    def refuse_code(cls, data: Any, *, where: str, names: Iterable[str] | None = None) -> None:
        """Raise an error if fields of a file name third-party code, because opening the file would run this code.

        ``data`` contains the fields of the file. ``names`` lists the fields to check. By default, all fields are checked.

        Raises
        ------
        InvalidInputError
            If a field names third-party code. The message names the module.
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
        """Return the fields and the part (``kind``) as JSON data. Set ``defaults`` to include fields with default values."""
        told: dict[str, Any] = {"kind": self.part}
        for name, declared in self.declarations().items():
            value = getattr(self, name)
            if defaults or declared.required or not _same(value, declared.default):
                told[name] = value if declared.option.dump is None or value is None else declared.option.dump(value)
        return told

    def canonical(self, *, without: tuple[str, ...] = ()) -> str:
        """Return a JSON text that is equal for equal problems. Fields with default values are left out."""
        told = {name: value for name, value in self.to_dict().items() if name not in without}
        return json.dumps(told, sort_keys=True, separators=(",", ":"), allow_nan=False)

    def replaced(self, **changes: Any) -> Self:
        """Return the problem with some fields replaced.

        Raises
        ------
        InvalidInputError
        """
        check_known(changes, self.declarations(), where="problem")
        return replace(self, **changes)

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self.to_dict() == other.to_dict()

    def __hash__(self) -> int:
        return hash(self.canonical())

    # The place of a problem, opened once. Problems without a place have none of these methods.

    @cached_property
    def place(self) -> Any:
        """The map, workspace or region, which is opened on first use."""
        return self.open_place()

    def open_place(self) -> Any:
        """Open the map, workspace or region."""
        return None

    def place_key(self) -> str | None:
        """Return a text that is equal for problems with the same place, or None for a place without a name."""
        return None

    def place_is_file(self) -> bool:
        """Return whether the place is a file. Workers on other machines may lack the file of a place."""
        return False

    def place_digest(self) -> bytes:
        """Return bytes that differ for places with different content, so that a sweep can detect a changed file."""
        return b""

    def at_place(self, place: Any) -> Self:
        """Return a copy of the problem with an opened place."""
        same = replace(self)
        same.__dict__["place"] = place
        return same

    def check_at_place(self) -> None:
        """Refuse settings that are impossible at the opened place.

        Raises
        ------
        InvalidInputError, UnknownNameError
        """


@cache
def _declarations(cls: type[Problem]) -> Mapping[str, Declaration]:
    hints = get_type_hints(cls)
    return {one.name: declaration_of(one, hints[one.name]) for one in fields(cls)}


def _same(value: Any, default: Any) -> bool:
    try:
        return type(value) is type(default) and bool(value == default)
    except ValueError:  # arrays
        return False
