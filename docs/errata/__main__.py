"""Run the checks of all errata; record what they find, and write the page of the documentation."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from docs.errata import check_all

from shoal.papers.errata import Erratum, record

PAGE = Path(__file__).parent / "index.md"
HEAD = """# Errata of the papers

What the papers print and does not hold, or needs saying. M: mapping and coverage with a particle swarm (2017); D: its draft; W: two
particles with non-slip wall contacts; H: exhaustive search along a space-filling curve (1998). Each erratum has a check; they lie
in `docs/errata` of the repository, and `shoal reproduce --all` runs them. `python -m docs.errata` writes this page.
"""


def page(errata: Iterable[Erratum]) -> str:
    """Return the text of the page."""
    parts = [HEAD]
    for one in errata:
        parts.append(f"## {one.source[0].upper()}{one.source[1:]}\n")
        parts.append(f"- Printed: {one.printed}.\n- Holds: {one.holds}.\n- Check: {one.check}.\n- Found by it: {one.found}.\n")
    return "\n".join(parts)


if __name__ == "__main__":
    found = check_all()
    record(found)
    PAGE.write_text(page(found), encoding="utf-8")
