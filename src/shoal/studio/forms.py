"""Forms and copies. A form is the JSON schema of a problem's fields. A copy is a problem as Python
code, a command or a file.
"""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from shoal.core.checks import check_integer, shortened
from shoal.core.errors import InvalidInputError
from shoal.core.files import write_text
from shoal.core.problem import Declaration, Problem
from shoal.lab.problems import KINDS, trial_problem_type
from shoal.lab.statistics import first_measure
from shoal.lab.sweep import Sweep, sweep_in
from shoal.missions.options import MissionOptions
from shoal.parts import PARTS, problem_type
from shoal.studio.folder import Folder
from shoal.studio.words import as_in_forms, label_of

Declared = TypeVar("Declared", bound=Problem)

_JSON_TYPES = {int: "integer", float: "number", bool: "boolean", str: "string"}
_COMMANDS = {"steering": "steer", "search": "search"}


def schema_of(kind: type[Problem]) -> dict[str, Any]:
    """Return the JSON schema of a class with declared fields: a problem, a vehicle, or the options
    of missions.

    A property may have five entries that JSON Schema does not define: ``unit``, ``place`` (true for
    the map, workspace or region), ``repeated``, ``names`` and ``several``. The entry ``names`` lists the
    built-in names of a field whose value is a name, such as a policy, or, with the entry
    ``several``, a list of names, such as formats of missions.

    Examples
    --------
    >>> schema_of(problem_type("swarm"))["properties"]["particles"]["minimum"]
    1
    """
    declared = kind.declarations()
    return {
        "type": "object",
        "title": kind.part,
        "properties": {name: _property(one, declared) for name, one in declared.items()},
        "required": [name for name, one in declared.items() if one.required],
        "additionalProperties": False,
    }


def _property(declared: Declaration, fields: Iterable[str]) -> dict[str, Any]:
    option = declared.option
    schema: dict[str, Any] = {
        "title": label_of(declared.name),
        "description": as_in_forms(declared.help, fields),
    }
    kind = _JSON_TYPES.get(declared.type)
    if kind is not None:
        schema["type"] = [kind, "null"] if declared.optional else kind
    if not declared.required:
        text = kind is None and not isinstance(declared.default, str | None)
        schema["default"] = (
            None
            if declared.default == math.inf
            else declared.text(declared.default)
            if text
            else declared.default
        )
    limits = {
        "minimum": option.least,
        "maximum": option.most,
        "exclusiveMinimum": option.above,
        "exclusiveMaximum": option.below,
    }
    schema |= {word: limit for word, limit in limits.items() if math.isfinite(limit)}
    if option.choices:
        schema["enum"] = list(option.choices)
    if declared.names is not None:
        schema["names"] = [*(["auto"] if declared.default == "auto" else []), *declared.names]
        if isinstance(declared.default, tuple):
            schema["several"] = True
    if option.unit:
        schema["unit"] = option.unit
    schema |= {
        word: True
        for word, is_so in (("place", option.argument), ("repeated", option.repeated))
        if is_so
    }
    return schema


def checked_problem(data: Any, folder: Folder, *, part: str | None = None) -> Problem:
    """Return the problem that a browser describes. Refuse a problem with files outside the folder
    or with third-party code.

    With ``part``, also refuse a problem of another part.
    """
    kind = data.get("kind") if isinstance(data, Mapping) else None
    if not isinstance(kind, str) or kind not in PARTS:
        got = f"the kind {shortened(kind)}" if isinstance(data, Mapping) else shortened(data)
        raise InvalidInputError(
            f"problem: expected fields and a kind, one of {', '.join(PARTS)}, got {got}"
        )
    if part not in (None, kind):
        raise InvalidInputError(f"problem: expected the kind {part}, got {kind}")
    return checked_fields(problem_type(kind), data, folder)


def checked_fields(kind: type[Declared], data: Any, folder: Folder) -> Declared:
    """Return the object that the fields of a form describe.

    The function parses the text of a field as the command line does. The function refuses files
    outside the folder, and third-party code.
    """
    if not isinstance(data, Mapping):
        raise InvalidInputError(f"{kind.part}: expected fields with values, got {shortened(data)}")
    kind.refuse_code(data, where=kind.part)
    folder.check_fields(data)
    known = kind.declarations()
    read = dict(data)
    for name in known.keys() & {name for name, value in data.items() if isinstance(value, str)}:
        read[name] = known[name].value_of(
            [data[name]] if known[name].option.repeated else data[name]
        )
    return kind.from_dict(read)


def mission_options(about: Mapping[str, Any], folder: Folder) -> MissionOptions | None:
    """Return the options of the missions that a search is planned for, or None for a plan without
    missions.
    """
    given = about.get("missions")
    return None if given is None else checked_fields(MissionOptions, given, folder)


def checked_seed(about: Mapping[str, Any]) -> int:
    """Return the seed from a browser, or 0 without a seed. A large seed arrives as text, because
    numbers in browsers have 53 bits.
    """
    given = about.get("seed")
    if isinstance(given, str) and given.isascii() and given.isdecimal() and len(given) < 20:
        given = int(given)
    return check_integer(0 if given is None else given, what="seed", least=0)


def copies_of(
    problem: Problem, *, seed: int, missions: MissionOptions | None = None
) -> dict[str, str]:
    """Return the texts ``python``, ``command`` and ``file``, with which a user can repeat a run
    outside the studio. With the options of ``missions``, the run follows the plan of the missions,
    and ``beside`` has the words that a command with the file needs.
    """
    words = [] if missions is None else ["--missions=missions", *mission_words(missions)]
    return {
        "python": as_python(problem, seed=seed, missions=missions),
        "command": " ".join([as_command(problem, seed=seed), *words]),
        "file": as_file(problem),
        "beside": " ".join([f"--seed={seed}", *words]),
    }


def as_python(problem: Problem, *, seed: int, missions: MissionOptions | None = None) -> str:
    """Return a Python script that runs a problem, or the missions of a search.

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
    imports, run = ["import shoal"], f"episode = shoal.run(problem, seed={seed})\n"
    if missions is not None:
        given = "".join(f"{field}={value!r}, " for field, value in _fields(missions).items())
        options = f"MissionOptions({given.removesuffix(', ')}), " if given else ""
        imports = [f"from shoal.missions import {'MissionOptions, ' * bool(given)}MissionSet"]
        run = (
            f"missions = MissionSet.from_problem(problem, {options}seed={seed})\n"
            "episode = missions.run()\n"
        )
    imports.append(f"from shoal.{problem.part} import {name}")
    return "\n".join(imports) + f"\n\nproblem = {name}(\n{fields})\n{run}print(episode.sentence)\n"


def as_command(problem: Problem, *, seed: int, file: str = "problem.json") -> str:
    """Return the command line that runs a problem.

    If some field cannot be written as text, the command reads the problem from the problem file
    ``file`` (see `as_file`).

    Examples
    --------
    >>> from shoal.swarm import SwarmProblem
    >>> as_command(SwarmProblem("line:9", particles=3, vessels=False), seed=1)
    'shoal map line:9 --particles=3 --seed=1'
    """
    fields, known = _fields(problem), problem.declarations()
    words = ["shoal", _COMMANDS.get(problem.part, "map")]
    # `shoal map` accepts all other tasks
    if fields.get("task") == "coverage" or "subset" in fields:
        words[1] = "cover"
        fields.pop("task", None)
    if not _is_text(problem):
        return shlex.join([*words, file, f"--seed={seed}"])
    place = next(name for name, declared in known.items() if declared.option.argument)
    words.append(known[place].text(fields.pop(place, known[place].default)))
    return shlex.join([*words, *_flags(problem, fields), f"--seed={seed}"])


def command_beside(problem: Problem, path: Path, *, seed: int) -> tuple[str, list[Path]]:
    """Return the command line that runs a problem, and the file that it needs, if any: a problem
    file, which the function writes beside ``path`` as NAME.problem.json.
    """
    if _is_text(problem):
        return as_command(problem, seed=seed), []
    file = path.with_suffix(".problem.json")
    write_text(file, as_file(problem))
    return as_command(problem, seed=seed, file=str(file)), [file]


def mission_words(options: Problem) -> list[str]:
    """Return the words of a command line that set the options of missions."""
    return [shlex.quote(word) for word in _flags(options, _fields(options))]


def _flags(problem: Problem, fields: Mapping[str, Any]) -> list[str]:
    known, words = problem.declarations(), []
    for name, value in fields.items():
        flag = known[name].flag
        if isinstance(value, bool):
            words.append(flag if value else f"--no-{flag[2:]}")
        elif known[name].option.repeated:
            words += [f"{flag}={known[name].text(one)}" for one in value]
        else:
            words.append(f"{flag}={known[name].text(value)}")
    return words


def _is_text(problem: Problem) -> bool:
    """Return whether the command line can express all fields of a problem."""
    known = problem.declarations()
    return all(_has_text(problem, known[name], value) for name, value in _fields(problem).items())


def _has_text(problem: Problem, declared: Declaration, value: Any) -> bool:
    """Return whether the command line can express a value, that is, whether parsing the value's
    text gives an equal value.
    """
    if declared.type is not object:
        return True
    try:
        text = (
            [declared.text(one) for one in value]
            if declared.option.repeated
            else declared.text(value)
        )
        return bool(declared.checked(declared.value_of(text)) == getattr(problem, declared.name))
    except (InvalidInputError, ValueError):
        return False


def as_file(problem: Problem) -> str:
    """Return the text of a problem file in JSON. Commands accept a problem file in place of a map,
    workspace or region.
    """
    return json.dumps(problem.to_dict(), indent=1, allow_nan=False) + "\n"


def _fields(problem: Problem) -> dict[str, Any]:
    return {name: value for name, value in problem.to_dict().items() if name != "kind"}


PLAYED = tuple(kind for kind in KINDS if kind != "function")
"""Kinds of problems for which the studio can run sweeps.

The kind "function" is excluded, because a browser must not start third-party code.
"""


def sweep_forms(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the forms of sweeps: for each kind of problem, the schema of the fields and the
    measures of a trial.
    """
    made = {kind: trial_problem_type(kind) for kind in PLAYED}
    return {
        kind: {"schema": schema_of(one), "measures": list(one.measures)}
        for kind, one in made.items()
    }


def checked_sweep(text: str, folder: Folder) -> Sweep:
    """Return the sweep that a TOML text from a browser describes.

    The function refuses a sweep with files outside the folder or with third-party code.

    Raises
    ------
    InvalidInputError, UnknownNameError
        Raised if the TOML text is invalid. The error message contains the line number and the wrong
        field.
    """
    return sweep_in(text, where="sweep", check=partial(_check, folder))


def _check(folder: Folder, data: Mapping[str, Any]) -> None:
    problem, axes = data.get("problem"), data.get("axes", {})
    if not isinstance(problem, Mapping) or not isinstance(axes, Mapping):
        return  # an error is raised when the sweep is created
    kind = problem.get("kind")
    if kind in KINDS and kind not in PLAYED:
        raise InvalidInputError(
            f"problem: kind: expected one of {', '.join(PLAYED)}, got {kind!r}, which runs your own"
            " code: use the command shoal sweep run"
        )
    if kind in PLAYED:
        made = trial_problem_type(kind)
        made.refuse_code(problem, where="problem")
        for name, values in axes.items():
            for value in values if isinstance(values, list) else []:
                made.refuse_code({name: value}, where=f"axes.{name}")
    for fields in (problem, axes):
        folder.check_fields(fields)


def sweep_copies(sweep: Sweep, store: str, text: str) -> dict[str, str]:
    """Return the texts ``python``, ``command`` and ``file``, with which a user can repeat a sweep
    outside the studio.
    """
    measure, axis = first_measure(sweep.measures), next(iter(sweep.paired), None)
    file = store.removesuffix(".sqlite") + ".toml"
    shown = f" --compare {axis}" * bool(axis)
    return {
        "python": (
            "from shoal.lab import Store, Sweep, run_sweep\nfrom shoal.lab.statistics import"
            " summarise\n\n"
            f'sweep = Sweep.load("{file}")\n'
            f'run_sweep(sweep, "{store}", workers=0)\n'
            f'with Store("{store}") as store:\n'
            f'    for row in summarise(store, sweep.name, "{measure}"):\n        print(row.values,'
            " row)\n"
        ),
        "command": (
            f"shoal sweep run {file} --store {store}\nshoal sweep summary {store} --measure"
            f" {measure}{shown}"
        ),
        "file": text,
    }
