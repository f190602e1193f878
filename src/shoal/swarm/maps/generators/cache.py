"""A cache of generated maps on disk, so that a command need not wait for the same map twice."""

from __future__ import annotations

import hashlib
import os
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import OutputError
from shoal.core.files import atomic
from shoal.swarm.maps.generators.catalogue import GENERATORS
from shoal.swarm.maps.generators.names import generate


def generate_cached(spec: str) -> NDArray[np.bool_]:
    """Return the map with the given name as `generate` does, from the user's cache folder if it is there.

    Only maps that take long to generate are kept. The cache is ``$XDG_CACHE_HOME/shoal`` or ``~/.cache/shoal``; what was made by
    another version of the generators is not used, and a folder that cannot be written does no harm.
    """
    name = spec.partition(":")[0]
    if name not in GENERATORS or not GENERATORS.get(name).slow:
        return generate(spec)
    path = _folder() / f"{hashlib.sha256(spec.encode()).hexdigest()[:16]}.npy"
    try:
        kept = np.load(path, allow_pickle=False)
        if kept.dtype == np.bool_ and kept.ndim in {2, 3}:
            return np.ascontiguousarray(kept)
    except (OSError, ValueError, EOFError):
        pass  # not there yet, or damaged: made again
    free = generate(spec)
    try:
        with atomic(path) as temporary:
            np.save(temporary, free)
    except OutputError:
        pass
    return free


def _folder() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    return Path(base) / "shoal" / f"maps-{_fingerprint()}"


@cache
def _fingerprint() -> str:
    """Return a digest of the generators' own code: another code may make other maps."""
    digest = hashlib.sha256(np.__version__.encode())
    for file in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
