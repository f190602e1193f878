"""Errata of the papers: printed statements that are wrong, their corrections, and programs that
check the corrections.

The command ``shoal reproduce --all`` runs the checks, and writes a page with the results. The
command ``python -m docs.errata`` runs the checks, and records the results in the library. Without
the folder ``docs``, an installed Shoal shows the recorded results.
"""

from __future__ import annotations

from shoal.papers.errata import Erratum

from . import algorithm_2, disks, mapping, one_dimension, polygons, search


def check_all() -> list[Erratum]:
    """Run the checks of all errata, ordered by paper (M with its draft D, W, H), and return the
    checked errata.
    """
    parts = (one_dimension, mapping, polygons, algorithm_2, disks, search)
    return [check() for part in parts for check in part.CHECKS]
