"""Errata of the papers: what they print and what holds, each with a check that computes it.

``shoal reproduce --all`` runs the checks for its page of results; ``python -m docs.errata`` runs them and records what they find
for the page of an installed Shoal, which has no checks beside it.
"""

from __future__ import annotations

from shoal.papers.errata import Erratum

from . import algorithm_2, disks, mapping, one_dimension, polygons, search


def check_all() -> list[Erratum]:
    """Run all checks, in the order of the papers: M and its draft D, W, H."""
    parts = (one_dimension, mapping, polygons, algorithm_2, disks, search)
    return [check() for part in parts for check in part.CHECKS]
