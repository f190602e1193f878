"""Disk cache of generated maps. Reading a map from the cache is faster than generating the map again."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import OutputError
from shoal.core.files import atomic, users_cache
from shoal.swarm.maps.generators.catalogue import GENERATORS
from shoal.swarm.maps.generators.names import generate


def generate_cached(spec: str) -> NDArray[np.bool_]:
    """Return the generated map with the given name. Read the map from the user's cache folder, or generate and store it.

    Shoal caches the maps of slow generators, in a folder inside the folder that `shoal.core.files.users_cache` returns. A
    cached map from another version of the generators is ignored. If the cache folder is read-only, Shoal generates every map
    anew.
    """
    name = spec.partition(":")[0]
    if name not in GENERATORS or not GENERATORS.get(name).slow:
        return generate(spec)
    path = users_cache() / f"maps-{_fingerprint()}" / f"{hashlib.sha256(spec.encode()).hexdigest()[:16]}.npy"
    try:
        kept = np.load(path, allow_pickle=False)
        if kept.dtype == np.bool_ and kept.ndim in {2, 3}:
            return np.ascontiguousarray(kept)
    except (OSError, ValueError, EOFError):
        pass  # missing or damaged: generate the map again
    free = generate(spec)
    try:
        with atomic(path) as temporary:
            np.save(temporary, free)
    except OutputError:
        pass
    return free


@cache
def _fingerprint() -> str:
    """Return a digest of the source code of the map generators. A change of the code may change the generated maps."""
    digest = hashlib.sha256(np.__version__.encode())
    for file in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]
