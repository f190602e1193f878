"""The "complex" map of paper M, or the one that a user gives instead."""

from __future__ import annotations

from typing import Any

from shoal.lab.sweeps.sweep import Sweep
from shoal.papers.recipe import Settings, counts_of

OTHER_MAP = "the picture of the paper's complex map is not published; this is another one of its kind"


def free_cells(name: str) -> int:
    """Return the number of free cells of a map."""
    from shoal.swarm.maps.open import open_map

    return open_map(name).n_free


def slug(name: str) -> str:
    """Return a map's name as part of the name of a sweep."""
    from shoal.lab.sweeps.sweep import digest_of

    plain = "".join(c if c.isascii() and c.isalnum() else "-" for c in name)[:30]
    return f"{plain}-{digest_of(name)[:6]}"


def on_complex(name: str, settings: Settings, **axes: Any) -> Sweep:
    """Return a sweep on the complex map over numbers of particles, all axes but these paired."""
    chosen = settings.complex
    return Sweep(
        name=f"{name}.{slug(chosen)}", problem={"kind": "swarm", "map": chosen},
        axes=axes | {"particles": counts_of(free_cells(chosen))},
        trials=settings.of(100, 20), seed=settings.seed, paired=tuple(axes),
    )  # fmt: skip


def note_of(settings: Settings) -> str:
    """Return what is to be said of the map."""
    return f"map {settings.complex}: {OTHER_MAP}" if settings.map is None else f"map {settings.map}, not the paper's"
