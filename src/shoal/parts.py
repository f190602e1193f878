"""Functions for all three parts (swarm, steering, search): run a problem, and load a problem or an
episode.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from shoal.core.checks import as_path, parse_json, read_text, shortened
from shoal.core.episode import Episode
from shoal.core.errors import InvalidInputError
from shoal.core.problem import Problem, check_known

PARTS = ("swarm", "search", "steering")
"""The parts of Shoal, in the order in which `problem_for` tries the parts."""

LARGEST_PROBLEM = 20_000_000
"""Maximum size of a problem file, in bytes."""

_LARGEST_EPISODE = 2**31


def problem_type(part: str) -> type[Problem]:
    """Return the problem class of a part.

    The function `problem_type` imports the part on its first call, because each part imports heavy
    libraries.
    """
    if part == "swarm":
        from shoal.swarm.problem import SwarmProblem

        return SwarmProblem
    if part == "search":
        from shoal.search.problem import SearchProblem

        return SearchProblem
    from shoal.steering.problem import SteeringProblem

    return SteeringProblem


def _run_module(part: str) -> Any:
    """Return the module of a part with the functions ``run`` and ``check``."""
    if part == "swarm":
        from shoal.swarm import run as swarm_run

        return swarm_run
    if part == "search":
        from shoal.search import run as search_run

        return search_run
    from shoal.steering import run as steering_run

    return steering_run


def _episode_type(part: str) -> type[Episode]:
    if part == "swarm":
        from shoal.swarm.episode import SwarmEpisode

        return SwarmEpisode
    if part == "search":
        from shoal.search.episode import SearchEpisode

        return SearchEpisode
    from shoal.steering.episode import SteeringEpisode

    return SteeringEpisode


def problem_of(data: Mapping[str, Any], *, where: str = "problem") -> Problem:
    """Build a problem from a mapping of its fields. The entry ``kind`` of the mapping names the
    part: swarm, steering or search.

    Examples
    --------
    >>> problem_of({"kind": "swarm", "map": "line:9", "particles": 3}).particles
    3
    """
    return _type_named_in(data, where=where).from_dict(data, where=where)


def _type_named_in(data: Any, *, where: str) -> type[Problem]:
    kind = data.get("kind") if isinstance(data, Mapping) else data
    if kind not in PARTS:
        raise InvalidInputError(
            f"{where}: expected a kind, one of {', '.join(PARTS)}, got {shortened(kind)}"
        )
    return problem_type(kind)


def read_problem(path: str | os.PathLike[str]) -> Any:
    """Read a problem file and return its JSON data."""
    return parse_json(
        read_text(as_path(path), what="problem file", most=LARGEST_PROBLEM), where=str(path)
    )


def load_problem(path: str | os.PathLike[str], *, trust: bool = False) -> Problem:
    """Read a problem from a JSON file. `problem_of` explains the format of problem files.

    Parameters
    ----------
    path : path
    trust : bool
        Whether Shoal may run code that the file names as MODULE:ATTRIBUTE.
    """
    data = read_problem(path)
    return _type_named_in(data, where=str(path)).from_file(data, str(path), trust=trust)


def problem_for(place: Any, fields: Mapping[str, Any]) -> Problem:
    """Make a problem of the first part whose problem class has all given fields.

    The order of the parts is swarm, search, steering. ``place`` is the map, the region or the
    workspace of the problem.

    Raises
    ------
    InvalidInputError
        Raised if no part has all given fields.

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
    check_known(fields, known, where="problem")
    raise InvalidInputError(
        f"problem: expected fields of one part ({', '.join(PARTS)}), got {', '.join(fields)}"
    )


def run(problem: Any, /, *, seed: int = 0, **fields: Any) -> Episode:
    """Run a problem and return its episode.

    Parameters
    ----------
    problem : SwarmProblem, SteeringProblem or SearchProblem, or a place
        A problem, or a place: a map, workspace or region, given as a name, a path or an object. An
        array counts as a map. If ``problem`` is a place, ``fields`` contains the other fields of
        the problem. Missing fields get their default values.
    seed : int
        Seed of the random numbers. Two runs with equal problems and equal seeds give equal
        episodes.
    **fields
        Fields of the problem, as keyword arguments. The keyword arguments replace the fields of a
        given problem. For a swarm, the keyword arguments ``trial``, ``stepwise``, ``on_moves`` and
        ``on_trace`` of `shoal.swarm.run.run` are valid in addition to the fields.

    Returns
    -------
    Episode
        The record of the run. ``bool(episode)`` is true if the run completed the task of the
        problem.

    Raises
    ------
    InvalidInputError, UnknownNameError
        Raised if the requested options do not fit the problem. Shoal never replaces a requested
        policy or planner by another one.

    Examples
    --------
    >>> run("vessels:300", particles=30).status.done
    True
    >>> run("ring:60x30", robots=3, footprint=10).status.done
    True
    >>> run("square", start=[(0.2, 0.5), (0.4, 0.5)], goal=[(0.3, 0.5), (0.4, 0.5)]).moves
    2
    """
    options = {
        name: fields.pop(name)
        for name in ("trial", "stepwise", "on_moves", "on_trace")
        if name in fields
    }
    if not isinstance(problem, Problem):
        problem = problem_for(problem, fields)
    elif fields:
        problem = problem.replaced(**fields)
    episode: Episode = _run_module(problem.part).run(problem, seed=seed, **options)
    return episode


def check(problem: Problem) -> None:
    """Refuse a problem that cannot run, without running it."""
    _run_module(problem.part).check(problem)


def load(path: str | os.PathLike[str], *, trust: bool = False) -> Episode:
    """Read an episode file of any part.

    Parameters
    ----------
    path : path
    trust : bool
        Whether Shoal may import and run third-party code that the file names, such as a task given
        as MODULE:ATTRIBUTE.

    Raises
    ------
    InvalidInputError
        Raised if the file is missing or damaged, or does not contain an episode.
    """
    source = as_path(path)
    part = "swarm"
    if source.suffix.lower() == ".json":
        data = parse_json(
            read_text(source, what="episode", most=_LARGEST_EPISODE), where=str(source)
        )
        problem = data.get("problem") if isinstance(data, dict) else None
        part = problem.get("kind", "") if isinstance(problem, dict) else ""
        if part not in PARTS:
            raise InvalidInputError(
                f"{source}: expected an episode of swarm, steering or search, got JSON of another"
                " kind"
            )
    return _episode_type(part).load(source, trust=trust)
