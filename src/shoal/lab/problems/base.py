"""Problem: what every kind of trial has; and what is wrong with fields, in one sentence."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, ValidationError

KINDS = ("swarm", "line", "schedule", "steering", "search", "function")
Values = list[Any]


class Problem(BaseModel, ABC):
    """One problem, whole; a subclass is a kind.

    Notes
    -----
    Sources of what trials do: `shoal.swarm.run`, `shoal.swarm.theory.one_dimension.sample`,
    `shoal.swarm.theory.scan_schedules.ScanSchedule.cost`,
    `shoal.steering.steer`, `shoal.search.search`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)
    measures: ClassVar[tuple[str, ...]] = ()

    kind: str

    @property
    def columns(self) -> tuple[str, ...]:
        """The names of what a trial measures."""
        return self.measures

    def canonical(self, without: tuple[str, ...] = ()) -> str:
        """Return the problem as JSON that is the same for equal problems; what has its default is left out.

        Examples
        --------
        >>> from shoal.lab.problems import SwarmProblem
        >>> SwarmProblem(kind="swarm", map="line:9", particles=3, rule="block").canonical()
        '{"kind":"swarm","map":"line:9","particles":3}'
        """
        fields = {name: value for name, value in self.model_dump(mode="json", exclude_defaults=True).items() if name not in without}
        return json.dumps(fields | {"kind": self.kind}, sort_keys=True, separators=(",", ":"), allow_nan=False)

    def source(self) -> str | None:
        """Return the name of the map, workspace or region that it opens; None if there is none."""
        return None

    def opened(self) -> Any:
        """Return what `source` names."""
        return None

    def digest(self, opened: Any) -> bytes:
        """Return what tells what is opened from anything else: a file may hold another map tomorrow."""
        return b""

    def is_file(self) -> bool:
        """Tell whether it opens a file: then what it opens must be sent to workers, who may not have it."""
        return False

    def check(self, opened: Any) -> None:
        """Refuse what no trial could play."""

    @abstractmethod
    def play(self, opened: Any, seed: int) -> Values:
        """Play one trial; return what `columns` names: texts, whole numbers, finite floats, truth values or None."""


_EXPECTED = {
    "extra_forbidden": "expected no such field", "missing": "expected this field", "int_type": "expected a whole number",
    "int_parsing": "expected a whole number", "int_from_float": "expected a whole number", "string_type": "expected a text",
    "float_type": "expected a number", "float_parsing": "expected a number", "bool_type": "expected true or false",
    "bool_parsing": "expected true or false", "dict_type": "expected fields with values", "list_type": "expected a list",
    "tuple_type": "expected a list",
}  # fmt: skip


def said(error: ValidationError, *, where: str) -> str:
    """Return the first thing that is wrong, in one sentence."""
    every = error.errors()
    first = next((one for one in every if one["type"] == "extra_forbidden"), every[0])  # a slip in a name is missing elsewhere, too
    if first["type"] in {"union_tag_not_found", "union_tag_invalid"}:
        given = first["input"].get("kind") if isinstance(first["input"], dict) else first["input"]
        return f"{where}: expected a kind, one of {', '.join(KINDS)}, got {given!r:.80}"
    at = ".".join(str(part) for part in first["loc"] if part not in KINDS)
    what = _EXPECTED.get(first["type"], first["msg"].replace("Input should be ", "expected "))
    came = "none" if first["type"] == "missing" else repr(first["input"])[:80]
    return f"{where}{': ' * bool(at)}{at}: {what[0].lower()}{what[1:]}, got {came}"


def is_file(name: str) -> bool:
    """Tell whether a name is that of a file."""
    try:
        return Path(name).is_file()
    except (OSError, ValueError):  # a name too long for a file
        return False
