"""The words of forms: the label and the help of a field, and what is said about a wrong value, at
its field and without words of the command line.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from shoal.core.errors import ShoalError
from shoal.core.problem import Problem
from shoal.parts import PARTS, problem_type

LONGEST = 600
"""Maximum length of a sentence about what is wrong, in characters. A sentence may contain the name
of a file.
"""

_COMMAND_WORDS: dict[str, str | Callable[[re.Match[str]], str]] = {
    r": allow it with --trust .*": ": commands run your own code, the studio does not",
    r"--([a-z][a-z-]*)": lambda found: f"“{found[1].replace('-', ' ')}”",
    r"\b(MAP|REGION|WORKSPACE)\b": lambda found: f"the {found[1].lower()}",
    r"[,;]? or MODULE:ATTRIBUTE": "",
    r"the option can be repeated": "separate several values by semicolons",
    r" \((?:needs the extra '\w+'|see 'shoal \w+')\)": "",
    r"\bexpected MM\b": "expected a number of millimetres",
    r"\bDEGREES\|auto\b": "a number of degrees, or auto",
    r"'no number'": "no number",
}


def label_of(name: str) -> str:
    """Return the label of a field. Forms, help and messages all take it from here.

    Examples
    --------
    >>> label_of("max_moves")
    'max moves'
    """
    return name.replace("_", " ")


def as_in_forms(text: str, fields: Iterable[str] = ()) -> str:
    """Return a help text or message for a form. Replace flags and the names of ``fields`` in code
    by labels, and omit parts that concern the command line.

    Examples
    --------
    >>> as_in_forms("With --cell-size: read MAP. Task: mapping or MODULE:ATTRIBUTE.")
    'With “cell size”: read the map. Task: mapping.'
    >>> as_in_forms("expected less than the cruise_speed, got 50", ["cruise_speed"])
    'expected less than the cruise speed, got 50'
    """
    for pattern, words in _COMMAND_WORDS.items():
        text = re.sub(pattern, words, text)
    coded = "|".join(name for name in fields if "_" in name)
    # in quotation marks, or with a dot or a slash, it is a name of a file
    return (
        re.sub(rf"(?<![\w'./-])(?:{coded})(?![\w'/-]|\.\w)", lambda found: label_of(found[0]), text)
        if coded
        else text
    )


class FieldError(ShoalError):
    """Raised for a request whose fault belongs to a field of the page's form.

    Parameters
    ----------
    fault : dict
        What `fault_of` returns.
    """

    def __init__(self, fault: dict[str, Any]) -> None:
        self.fault = fault
        super().__init__(fault["error"])


def fault_of(error: ShoalError, about: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a form says about an error: the sentence ``error``, and the ``field`` at which
    it stands with its ``label``, or None for both.

    A message names its place: the field before a colon, or the value of a field, such as a file.
    ``about`` is the request, with the fields of its form in ``problem`` and ``missions``. A field
    of the form inside of a field follows a dot, as in vehicle.cruise_speed.

    Examples
    --------
    >>> from shoal.core.errors import InvalidInputError
    >>> request = {"problem": {"kind": "swarm", "map": "attic", "max_moves": -1}}
    >>> fault_of(InvalidInputError("max_moves: expected 0 or more, got -1"), request)
    {'error': 'Expected 0 or more, got -1.', 'field': 'max_moves', 'label': 'max moves'}
    >>> fault_of(InvalidInputError("unknown map generator 'attic'"), request)["field"]
    'map'
    """
    if isinstance(error, FieldError):
        return error.fault
    from shoal.missions.options import MissionOptions
    from shoal.search.flight.vehicle import Vehicle

    problem = about.get("problem")
    given = dict(problem) if isinstance(problem, Mapping) else {}
    kind = given.pop("kind", None)
    # forms inside of the form
    forms: dict[str, type[Problem]] = {"vehicle": Vehicle, "missions": MissionOptions}
    declared: set[str] = {"seed"}
    if isinstance(kind, str) and kind in PARTS:
        declared |= problem_type(kind).declarations().keys()
    missions = about.get("missions")
    if isinstance(missions, Mapping):
        given |= {f"missions.{name}": value for name, value in missions.items()}
        declared |= {f"missions.{name}" for name in MissionOptions.declarations()}
    names = {name for form in forms.values() for name in form.declarations()} | declared

    text, field = " ".join(str(error).split()), None
    while True:
        head, _, rest = text.partition(": ")
        name = head.partition(", ")[0].removeprefix("--").replace("-", "_")
        if rest and name in ("problem", "request", kind) and name not in declared:
            text = rest
        elif rest and field is None and f"missions.{name}" in declared and name not in declared:
            text, field = rest, f"missions.{name}"
        elif rest and field is None and label_of(name) in map(label_of, declared):
            field = name.replace(" ", "_")
            if ", " in head:  # several fields, of which the sentence speaks
                break
            text = rest
        elif rest and field in forms and name in forms[field].declarations():
            text, field = rest, f"{field}.{name}"
        else:
            break
    if field is None and (named := re.match(r"(?:unknown|the) (\w+) '", text)):
        field = named[1] if named[1] in declared else None
    if field is None:
        field = _field_of_value(text, given)
    sentence = as_in_forms(text, names)[:LONGEST]
    if re.match(r"[a-z]+ ", sentence):  # a name of a file keeps its letters
        sentence = sentence.capitalize()[0] + sentence[1:]
    return {
        "error": sentence + "." * (sentence[-1:] not in ".?!…"),
        "field": field,
        "label": None if field is None else label_of(field.rpartition(".")[2]),
    }


def _field_of_value(text: str, given: Mapping[str, Any]) -> str | None:
    """Return the field whose value a message begins with, or else quotes."""
    found = []
    for name, value in given.items():
        for one in value if isinstance(value, list | tuple) else [value]:
            if isinstance(one, str) and one:
                word = one.partition(",")[0] if name == "vehicle" else one
                found += [(0, name)] * text.startswith((f"{word}: ", f"{word}, "))
                found += [(1, name)] * (repr(word) in text)
    return min(found)[1] if found else None
