"""What the papers print and what holds: each erratum with the check that shows it, run when the page of results is written."""

from __future__ import annotations

from shoal.papers.errata.checking import Finding

__all__ = ["Finding", "check_all"]


def check_all() -> list[Finding]:
    """Run the checks of all errata, in the order of the papers: M and its draft D, W, H."""
    from shoal.papers.errata import disks, line, mapping, polygons, reachable, search

    return [check() for part in (line, mapping, polygons, reachable, disks, search) for check in part.CHECKS]
