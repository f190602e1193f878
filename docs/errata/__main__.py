"""Run the checks of all errata, record the results in the library, and write the page of errata."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from docs.errata import check_all

from shoal.papers.errata import Erratum, record

PAGE = Path(__file__).parent / "index.md"
HEAD = """# Errata of the papers

This page is for people who compare their own numbers with the four papers on which Shoal is based. The page lists statements in
the papers that are wrong or need a remark. For each statement, a program checks the correction and computes the numbers under
"Result". The folder `docs/errata` of the repository contains the programs that check the statements. The command
`shoal reproduce --all` runs all programs of this folder. The command `python -m docs.errata` writes this page.

| letter | paper | errata |
|---|---|---|
"""
PAPERS = {
    "M": "Mapping and coverage with a particle swarm controlled by uniform inputs (2017)",
    "D": "Mapping, foraging, and coverage with a particle swarm controlled by uniform inputs (draft, 2017)",
    "W": "Exploiting nonslip wall contacts to position two particles using the same control input",
    "H": "Exhaustive geographic search with mobile robots along space-filling curves (1998)",
}


def page(errata: Iterable[Erratum]) -> str:
    """Return the Markdown text of the page of errata."""
    errata = list(errata)
    papers = [set(re.findall(r"\b[MDWH]\b", one.source[:12])) for one in errata]
    rows = (f"| {letter} | {title} | {sum(letter in named for named in papers)} |\n" for letter, title in PAPERS.items())
    parts = [HEAD + "".join(rows)]
    for one in errata:
        parts.append(f"## {one.source[0].upper()}{one.source[1:]}\n")
        parts.append(f"- Printed: {one.printed}.\n- Correct: {one.holds}.\n- Check: {one.check}.\n- Result: {one.found}.\n")
    return "\n".join(parts)


if __name__ == "__main__":
    found = check_all()
    record(found)
    PAGE.write_text(page(found), encoding="utf-8")
