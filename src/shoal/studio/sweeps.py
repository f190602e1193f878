"""Sweeps that a browser describes: the forms of sweeps, the checks of sweeps, and copies as Python code, commands and files."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from shoal.core.errors import InvalidInputError
from shoal.lab.problems import KINDS, trial_problem_type
from shoal.lab.summaries import first_measure
from shoal.lab.sweeps.sweep import Sweep, sweep_in
from shoal.studio.folder import Folder
from shoal.studio.forms import schema_of

PLAYED = tuple(kind for kind in KINDS if kind != "function")
"""Kinds of problems for which the studio can run sweeps.

The kind "function" is excluded, because a browser must not start third-party code.
"""


def sweep_forms(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return the forms of sweeps: for each kind of problem, the schema of the fields and the measures of a trial."""
    made = {kind: trial_problem_type(kind) for kind in PLAYED}
    return {kind: {"schema": schema_of(one), "measures": list(one.measures)} for kind, one in made.items()}


def checked_sweep(text: str, folder: Folder) -> Sweep:
    """Return the sweep that a TOML text from a browser describes.

    The function refuses a sweep with files outside the folder or with third-party code.

    Raises
    ------
    InvalidInputError, UnknownNameError
        Raised if the TOML text is invalid. The error message contains the line number and the wrong field.
    """
    return sweep_in(text, where="sweep", check=partial(_check, folder))


def _check(folder: Folder, data: Mapping[str, Any]) -> None:
    problem, axes = data.get("problem"), data.get("axes", {})
    if not isinstance(problem, Mapping) or not isinstance(axes, Mapping):
        return  # an error is raised when the sweep is created
    kind = problem.get("kind")
    if kind in KINDS and kind not in PLAYED:
        raise InvalidInputError(
            f"problem: kind: expected one of {', '.join(PLAYED)}, got {kind!r}, which runs your own code: use the command "
            "shoal sweep run"
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
    """Return the texts ``python``, ``command`` and ``file``, with which a user can repeat a sweep outside the studio."""
    measure, axis = first_measure(sweep.measures), next(iter(sweep.paired), None)
    file = store.removesuffix(".sqlite") + ".toml"
    shown = f" --compare {axis}" * bool(axis)
    return {
        "python": (
            "from shoal.lab import Store, Sweep, run_sweep\nfrom shoal.lab.summaries import summarise\n\n"
            f'sweep = Sweep.load("{file}")\n'
            f'run_sweep(sweep, "{store}", workers=0)\n'
            f'with Store("{store}") as store:\n'
            f'    for row in summarise(store, sweep.name, "{measure}"):\n        print(row.values, row)\n'
        ),
        "command": f"shoal sweep run {file} --store {store}\nshoal sweep summary {store} --measure {measure}{shown}",
        "file": text,
    }
