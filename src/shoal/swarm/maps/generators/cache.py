"""Disk cache of generated maps. Reading a map from the cache is faster than generating the map again."""

from __future__ import annotations

import hashlib
import io
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from shoal.core.errors import OutputError
from shoal.core.files import atomic, users_cache, with_checksum, without_checksum
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
    path = users_cache() / f"maps-{_fingerprint()}" / f"{hashlib.sha256(spec.encode()).hexdigest()[:16]}.map"
    try:
        return np.ascontiguousarray(np.load(io.BytesIO(without_checksum(path.read_bytes())), allow_pickle=False))
    except (OSError, ValueError):
        pass  # missing or damaged: generate the map again
    free = generate(spec)
    try:
        with atomic(path) as temporary:
            content = io.BytesIO()
            np.save(content, free)
            temporary.write_bytes(with_checksum(content.getvalue()))
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
