"""The versions of Shoal and of the libraries on which results depend."""

from __future__ import annotations

import sys
from functools import cache

__version__ = "0.1.0"


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
    return {"shoal": __version__, "python": python, "numpy": version("numpy"), "numba": version("numba")}


@cache
def code_digest() -> str:
    """Return a digest of the source code in the packages ``swarm``, ``steering``, ``search`` and ``lab``.

    Two processes with equal digests and equal versions compute equal results.
    """
    import hashlib  # both imports are slow
    from pathlib import Path

    digest, root = hashlib.blake2b(digest_size=8), Path(__file__).parent.parent
    for folder in ("swarm", "steering", "search", "lab"):
        for file in sorted((root / folder).rglob("*.py")):
            digest.update(file.relative_to(root).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()
