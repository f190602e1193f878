"""Generators of maps with names such as ``line:5000``, ``htree:5000``, ``vessels:5000:7`` and
``maze:61x41:3``.

The name of a generated map has the form ``NAME:SIZE`` or ``NAME:SIZE:SEED``. The default seed of a
generated map is 0. Generated maps with equal names are equal. In every generated map, the free
cells are connected: 4-connected in 2-D and 6-connected in 3-D. To add a generator, add an entry to
`GENERATORS`.
"""

from __future__ import annotations

from shoal.swarm.maps.generators.catalogue import (
    GENERATORS,
    Generator,
    generate,
    generate_cached,
    is_spec,
)

__all__ = ["GENERATORS", "Generator", "generate", "generate_cached", "is_spec"]
