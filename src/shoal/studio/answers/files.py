"""Answers that all pages of the studio use: episodes for the player, and a problem as Python code,
command or file.
"""

from __future__ import annotations

from typing import Any

import shoal
from shoal.core.errors import InvalidInputError
from shoal.core.files import atomic
from shoal.studio.folder import Folder
from shoal.studio.forms import checked_problem, checked_seed, copies_of


def page(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Read an episode file in the folder, and return the episode as data for the player."""
    from importlib import import_module

    name = str(about["file"])
    episode: Any = shoal.load(folder.path(name))
    data: dict[str, Any] = import_module(f"shoal.views.{episode.part}.page").page_data(episode)
    fields = episode.problem.to_dict()
    return {
        "part": episode.part,
        "data": data,
        "problem": fields,
        "seed": episode.seed,
        "sentence": episode.sentence,
    }


def copies(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Return a problem, or the problem of an episode file, in three forms: as Python code, as a
    command and as the text of a file.

    The seed of an episode is the episode's own.
    """
    if (about.get("file") is None) == (about.get("problem") is None):
        raise InvalidInputError(
            "copies: expected either a problem or the file of an episode, got both or none"
        )
    if about.get("file") is None:
        problem, seed = checked_problem(about["problem"], folder), checked_seed(about)
    else:
        episode: Any = shoal.load(folder.path(about["file"]))
        problem, seed = episode.problem, episode.seed
        if seed is None:
            raise InvalidInputError(
                f"{about['file']}: expected an episode with a seed, got one that no seed repeats"
            )
    return copies_of(problem, seed=seed) | {"problem": problem.to_dict(), "seed": str(seed)}


def save_problem(folder: Folder, about: dict[str, Any]) -> dict[str, Any]:
    """Write a problem file, and return the name of the file."""
    problem = checked_problem(about["problem"], folder)
    name = folder.new_name(str(about.get("name") or problem.part), ".json")
    with atomic(folder.path(name)) as temporary:
        temporary.write_text(copies_of(problem, seed=checked_seed(about))["file"], encoding="utf-8")
    return {"file": name}
