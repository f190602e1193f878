"""The versions of Shoal and of the libraries on which results depend, and the number of processors."""

from __future__ import annotations

import os
import sys
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

__version__ = "0.1.0"

_SHOWN = ("cli", "studio", "views")
"""Parts of Shoal that show results and compute none."""

_READ = (".py", ".npz", ".csv", ".json")
"""Suffixes of the files on which results can depend: code, learned weights and published values."""


@cache
def versions() -> dict[str, str]:
    """Return the versions of Shoal, Python, NumPy and Numba in the current process.

    Examples
    --------
    >>> list(versions())
    ['shoal', 'python', 'numpy', 'numba']
    """
    from importlib.metadata import version  # slow to import, and `import shoal` must be fast

    python = f"{sys.version_info.major}.{sys.version_info.minor}"
    return {
        "shoal": __version__,
        "python": python,
        "numpy": version("numpy"),
        "numba": version("numba"),
    }


@cache
def code_digest() -> str:
    """Return a digest of the code and the data of Shoal on which results can depend.

    The digest covers everything in the package ``shoal`` except `_SHOWN`, and archives of compiled
    kernels, which are made from the same code. Two processes with equal digests and equal versions
    compute equal results.
    """
    from pathlib import Path  # slow to import

    return digest_of_folder(Path(__file__).parent.parent)


def digest_of_folder(root: Path) -> str:
    """Return the digest of the code and the data in a copy of the package ``shoal``."""
    import hashlib  # slow to import

    digest = hashlib.blake2b(digest_size=8)
    for file in sorted(root.rglob("*")):
        part = file.relative_to(root)
        if part.parts[0] not in _SHOWN and file.suffix in _READ and file.is_file():
            digest.update(part.as_posix().encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()


def count_processors() -> int:
    """Return the number of processors that the current process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
