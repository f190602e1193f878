"""Forms and copies: a problem's declarations as a JSON schema, and a problem as Python, as a command, as a file."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Mapping
from typing import Any

from shoal.errors import InvalidInputError
from shoal.lab.problems import trial_problem_type
from shoal.parts import PARTS, problem_of, problem_type
from shoal.problem import Declaration, Problem
from shoal.studio.folder import Folder

_JSON_TYPES = {int: "integer", float: "number", bool: "boolean", str: "string"}
_COMMANDS = {"steering": "steer", "search": "search"}


def schema_of(part: str) -> dict[str, Any]:
    """Return the JSON schema of problems of a part, or of a kind that sweeps have besides, made from their declarations.

    Beyond the words of JSON Schema a property has ``unit``, ``place`` (whether it is the map, workspace or region) and ``names``:
    of a field whose value is a name, with options after a colon, the names.

    Examples
    --------
    >>> schema_of("swarm")["properties"]["particles"]["minimum"]
    1
    """
    declared = trial_problem_type(part).declarations()
    return {
        "type": "object",
        "title": part,
        "properties": {name: _property(one) for name, one in declared.items()},
        "required": [name for name, one in declared.items() if one.required],
        "additionalProperties": False,
    }


def _property(declared: Declaration) -> dict[str, Any]:
    option = declared.option
    told: dict[str, Any] = {"title": declared.name.replace("_", " "), "description": option.help}
    kind = _JSON_TYPES.get(declared.type)
    if kind is not None:
        told["type"] = [kind, "null"] if declared.optional else kind
    if not declared.required:
        told["default"] = None if declared.default == math.inf else declared.default
    limits = {"minimum": option.least, "maximum": option.most, "exclusiveMinimum": option.above, "exclusiveMaximum": option.below}
    told |= {word: limit for word, limit in limits.items() if math.isfinite(limit)}
    if option.choices:
        told["enum"] = list(option.choices)
    if option.names is not None:
        told["names"] = [*(["auto"] if declared.default == "auto" else []), *option.names]
    if option.unit:
        told["unit"] = option.unit
    if option.argument:
        told["place"] = True
    return told


def checked_problem(data: Any, folder: Folder) -> Problem:
    """Return the problem that a browser describes; it names no file outside of the folder and runs nobody's code.

    Raises
    ------
    InvalidInputError, UnknownNameError
    """
    if not isinstance(data, Mapping) or data.get("kind") not in PARTS:
        raise InvalidInputError(f"problem: expected a kind, one of {', '.join(PARTS)}")
    problem_type(data["kind"]).refuse_code(data, where="problem")
    folder.check_fields(data)
    return problem_of(data)


def copies_of(problem: Problem, *, seed: int) -> dict[str, str]:
    """Return what gives the same result outside of the studio: ``python``, ``command`` and ``file``."""
    return {"python": as_python(problem, seed=seed), "command": as_command(problem, seed=seed), "file": as_file(problem)}


def as_python(problem: Problem, *, seed: int) -> str:
    """Return a script that runs a problem.

    Examples
    --------
    >>> from shoal.swarm import SwarmProblem
    >>> print(as_python(SwarmProblem("line:9", particles=3), seed=1))
    import shoal
    from shoal.swarm import SwarmProblem
    <BLANKLINE>
    problem = SwarmProblem(
        map='line:9',
        particles=3,
    )
    episode = shoal.run(problem, seed=1)
    print(episode.sentence)
    <BLANKLINE>
    """
    name = type(problem).__name__
    fields = "".join(f"    {field}={value!r},\n" for field, value in _fields(problem).items())
    return (
        f"import shoal\nfrom shoal.{problem.part} import {name}\n\nproblem = {name}(\n{fields})\n"
        f"episode = shoal.run(problem, seed={seed})\nprint(episode.sentence)\n"
    )


def as_command(problem: Problem, *, seed: int) -> str:
    """Return the command line that runs a problem.

    Examples
    --------
    >>> from shoal.swarm import SwarmProblem
    >>> as_command(SwarmProblem("line:9", particles=3, vessels=False), seed=1)
    'shoal map line:9 --particles=3 --seed=1'
    """
    fields, known = _fields(problem), problem.declarations()
    words = ["shoal", _COMMANDS.get(problem.part, "map")]
    if fields.get("task") == "coverage" or "subset" in fields:  # `shoal map` takes all other tasks
        words[1] = "cover"
        fields.pop("task", None)
    place = next(name for name, declared in known.items() if declared.option.argument)
    words.append(_text(fields.pop(place, known[place].default)))
    for name, value in fields.items():
        flag = known[name].flag
        if isinstance(value, bool):
            words.append(flag if value else f"--no-{flag[2:]}")
        elif known[name].option.repeated:
            words += [f"{flag}={_text(one)}" for one in value]
        else:
            words.append(f"{flag}={_text(value)}")
    return shlex.join([*words, f"--seed={seed}"])


def as_file(problem: Problem) -> str:
    """Return the problem file, JSON; commands take it in place of a map, workspace or region."""
    return json.dumps(problem.to_dict(), indent=1, allow_nan=False) + "\n"


def _fields(problem: Problem) -> dict[str, Any]:
    return {name: value for name, value in problem.to_dict().items() if name != "kind"}


def _text(value: Any) -> str:
    """Return a value as commands take it: points and cells as '1,2 3,4'."""
    if isinstance(value, list):
        return " ".join(",".join(map(repr, point)) if isinstance(point, list) else str(point) for point in value)
    return value if isinstance(value, str) else repr(value)
