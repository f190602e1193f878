"""The three parts behind one verb: run a problem, open an episode, whatever the part."""

from __future__ import annotations

import importlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from shoal.core.checks import parse_json, read_text, shortened, suggestion
from shoal.core.episode import Episode
from shoal.core.errors import InvalidInputError
from shoal.core.problem import LARGEST_PROBLEM, Problem

PARTS = ("swarm", "search", "steering")
"""In the order in which `problem_for` tries them."""

_LARGEST_EPISODE = 2**31


def problem_type(part: str) -> type[Problem]:
    """Return the class of a part's problems; the part is imported now, since each brings heavy libraries of its own."""
    found: type[Problem] = getattr(importlib.import_module(f"shoal.{part}.problem"), f"{part.capitalize()}Problem")
    return found


def problem_of(data: Mapping[str, Any], *, where: str = "problem") -> Problem:
    """Return the problem that fields describe; ``kind`` names the part.

    Raises
    ------
    InvalidInputError

    Examples
    --------
    >>> problem_of({"kind": "swarm", "map": "line:9", "particles": 3}).particles
    3
    """
    kind = data.get("kind") if isinstance(data, Mapping) else data
    if kind not in PARTS:
        raise InvalidInputError(f"{where}: expected a kind, one of {', '.join(PARTS)}, got {shortened(kind)}")
    return problem_type(kind).from_dict(data, where=where)


def load_problem(path: str | os.PathLike[str], *, trust: bool = False) -> Problem:
    """Read a problem file (JSON) of any part; see `problem_of`.

    Parameters
    ----------
    path : path
    trust : bool
        Whether code that the file names, MODULE:ATTRIBUTE, may run.

    Raises
    ------
    InvalidInputError
    """
    data = parse_json(read_text(Path(path), what="problem file", most=LARGEST_PROBLEM), where=str(path))
    kind = data.get("kind") if isinstance(data, dict) else None
    if kind in PARTS and not trust:
        problem_type(kind).refuse_code(data, where=str(path))
    return problem_of(data, where=str(path))


def problem_for(place: Any, fields: Mapping[str, Any]) -> Problem:
    """Return the problem of the first part that has all of the fields; ``place`` is its map, region or workspace.

    Raises
    ------
    InvalidInputError
        If no part has them all.

    Examples
    --------
    >>> problem_for("line:9", {"particles": 3}).part, problem_for("square:100", {"robots": 2, "footprint": 10}).part
    ('swarm', 'search')
    """
    known: dict[str, None] = {}
    for part in PARTS:
        kind = problem_type(part)
        names = list(kind.declarations())
        if set(fields) <= set(names):
            return kind(**{names[0]: place}, **fields)
        known |= dict.fromkeys(names)
    strange = next((name for name in fields if name not in known), None)
    if strange is not None:
        value = shortened(fields[strange])
        raise InvalidInputError(f"problem: {strange}: expected no such field, got {value}{suggestion(strange, known)}")
    raise InvalidInputError(f"problem: expected fields of one part ({', '.join(PARTS)}), got {', '.join(fields)}")


def run(problem: Any, /, *, seed: int = 0, **fields: Any) -> Episode:
    """Run a problem and return its episode.

    Parameters
    ----------
    problem : SwarmProblem, SteeringProblem or SearchProblem, or what one is about
        In short form a map, workspace or region by name, path or object (or an array as a map); its problem has ``fields``.
    seed : int
        The same problem and seed give the same episode.
    **fields
        Of the problem; others go to the part's own ``run``, as ``trial`` and ``stepwise`` of a swarm.

    Returns
    -------
    Episode
        ``bool(episode)`` says if the task is done.

    Raises
    ------
    InvalidInputError, UnknownNameError
        If the problem cannot be as it is asked for; nothing else is run in its place.

    Examples
    --------
    >>> run("vessels:300", particles=30).status.done
    True
    >>> run("ring:60x30", robots=3, footprint=10).status.done
    True
    >>> run("square", start=[(0.2, 0.5), (0.4, 0.5)], goal=[(0.3, 0.5), (0.4, 0.5)]).moves
    3
    """
    options = {name: fields.pop(name) for name in ("trial", "stepwise", "on_moves", "on_trace") if name in fields}
    if not isinstance(problem, Problem):
        problem = problem_for(problem, fields)
    elif fields:
        problem = problem.replaced(**fields)
    found: Episode = importlib.import_module(f"shoal.{problem.part}.run").run(problem, seed=seed, **options)
    return found


def load(path: str | os.PathLike[str], *, trust: bool = False) -> Episode:
    """Open an episode of any part.

    Parameters
    ----------
    path : path
    trust : bool
        Whether code that the file names, as the task MODULE:ATTRIBUTE, may be imported and run.

    Raises
    ------
    InvalidInputError
        If the file is missing, damaged or no episode.
    """
    source = Path(path)
    part = "swarm"
    if source.suffix.lower() == ".json":
        data = parse_json(read_text(source, what="episode", most=_LARGEST_EPISODE), where=str(source))
        problem = data.get("problem") if isinstance(data, dict) else None
        part = problem.get("kind", "") if isinstance(problem, dict) else ""
        if part not in PARTS:
            raise InvalidInputError(
                f"{source}: expected an episode of {', '.join(PARTS)}, got JSON without a problem of such a kind"
            )
    found: Episode = getattr(importlib.import_module(f"shoal.{part}.episode"), f"{part.capitalize()}Episode").load(
        source, trust=trust
    )
    return found
