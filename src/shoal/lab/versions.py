"""The versions on which results may depend: Shoal, the libraries for computation, and a digest of
Shoal's code.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from shoal.core.errors import InvalidInputError
from shoal.core.version import code_digest, versions


class MixedVersionsWarning(UserWarning):
    """Warning that other versions of Shoal or its libraries wrote the existing rows of a sweep."""


def worker_versions() -> dict[str, str]:
    """Return the versions on which results of the current process depend, and a digest of Shoal's
    code.
    """
    return versions() | {"code": code_digest()}


def check_versions(theirs: Mapping[str, str], *, worker: str) -> None:
    """Refuse a worker whose versions differ from the versions of the current process.

    Raises
    ------
    InvalidInputError
    """
    ours = worker_versions()
    wrong = [
        f"{name} {theirs.get(name, 'none')} instead of {ours[name]}"
        for name in ours
        if theirs.get(name) != ours[name]
    ]
    if wrong:
        raise InvalidInputError(
            f"worker {worker}: expected the versions of this process, got {', '.join(wrong)}"
        )


def written(found: Mapping[str, str]) -> str:
    """Return a set of versions as the text that a store contains.

    Examples
    --------
    >>> written({"shoal": "0.1.0", "code": "5f0c"})
    'shoal 0.1.0, code 5f0c'
    """
    return ", ".join(f"{name} {value}" for name, value in found.items())


def parsed(text: str) -> dict[str, str]:
    """Return the set of versions that a text in a store describes.

    Examples
    --------
    >>> parsed("shoal 0.1.0, code 5f0c")
    {'shoal': '0.1.0', 'code': '5f0c'}
    """
    pairs = [part.partition(" ") for part in text.split(", ")]
    return (
        {name: value for name, _, value in pairs}
        if all(value for _, _, value in pairs)
        else {"shoal": text}
    )


def told_apart(texts: Iterable[str]) -> dict[str, str]:
    """Return a short name for each of several sets of versions.

    Each name contains Shoal's version, and the versions of all libraries that differ between the
    sets.

    Examples
    --------
    >>> list(told_apart(["shoal 1, code a, numpy 2.1", "shoal 1, code a, numpy 2.2"]).values())
    ['shoal 1, numpy 2.1', 'shoal 1, numpy 2.2']
    """
    all_of = {text: parsed(text) for text in texts}
    names = dict.fromkeys(name for found in all_of.values() for name in found)
    kept = [
        name
        for name in names
        if name == "shoal" or len({found.get(name) for found in all_of.values()}) > 1
    ]
    return {
        text: written({name: found.get(name, "unknown") for name in kept})
        for text, found in all_of.items()
    }


def mixture(rows: Mapping[str, int]) -> str:
    """Return a text with the number of rows per set of versions, or an empty text if the current
    versions wrote all rows.

    Examples
    --------
    >>> mixture({written(worker_versions()): 5})
    ''
    >>> mixture({"shoal 0.0.9, code 5f0c": 5, written(worker_versions()): 2}).startswith("5 rows by shoal 0.0.9, code 5f0c")
    True
    """
    ours = written(worker_versions())
    names = told_apart([*rows, ours])
    if not any(text != ours for text in rows):
        return ""
    counted = ", ".join(f"{count} rows by {names[text]}" for text, count in rows.items())
    return f"{counted}; this is {names[ours]}"
