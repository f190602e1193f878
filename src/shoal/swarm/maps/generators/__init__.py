"""Generated maps with names such as ``line:5000``, ``htree:5000``, ``vessels:5000:7``, ``maze:61x41:3``.

A name is ``NAME:SIZE`` or ``NAME:SIZE:SEED``. The default seed is 0. The same name always gives the same map. Every map is
4-connected. Add further generators to `GENERATORS`.
"""

from __future__ import annotations

from shoal.swarm.maps.generators.cache import generate_cached
from shoal.swarm.maps.generators.catalogue import GENERATORS, Generator
from shoal.swarm.maps.generators.names import generate, is_spec

__all__ = ["GENERATORS", "Generator", "generate", "generate_cached", "is_spec"]
