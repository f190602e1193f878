"""Run the checks of all errata, record the results in the library, and write the page of errata."""

from __future__ import annotations

import argparse
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

An erratum of two papers is listed under the first paper.

| letter | paper | errata |
|---|---|---|
"""
ORDINALS = ("first", "second", "third", "fourth", "fifth")
PAPERS = {
    "M": "Mapping and coverage with a particle swarm controlled by uniform inputs (2017)",
    "D": (
        "Mapping, foraging, and coverage with a particle swarm controlled by uniform inputs (draft,"
        " 2017)"
    ),
    "W": "Exploiting nonslip wall contacts to position two particles using the same control input",
    "H": "Exhaustive geographic search with mobile robots along space-filling curves (1998)",
}


def page(errata: Iterable[Erratum]) -> str:
    """Return the Markdown text of the page of errata."""
    errata = list(errata)
    rows = (
        f"| {letter} | {title} | {sum(letter in papers(one) for one in errata)} |\n"
        for letter, title in PAPERS.items()
    )
    parts = [HEAD + "".join(rows)]
    for letter in PAPERS:
        parts.append(f"## Paper {letter}\n")
        sources: list[str] = []
        for one in errata:
            if papers(one)[0] == letter:
                parts += [f"### {title(one, sources.count(one.source))}\n", said(one)]
                sources.append(one.source)
    return "\n".join(parts)


def papers(one: Erratum) -> list[str]:
    """Return the letters of the papers that contain an erratum."""
    return re.findall(r"\b[MDWH]\b", one.source[:12])


def title(one: Erratum, before: int) -> str:
    """Return the heading of an erratum.

    ``before`` is the number of errata with the same source that are already on the page.
    """
    number = f", {ORDINALS[before]} statement" if before else ""
    return f"{one.source[0].upper()}{one.source[1:]}{number}"


def said(one: Erratum) -> str:
    """Return an erratum as a Markdown list: the printed statement, the correct statement, the check
    and the result.
    """
    told = {"Printed": one.printed, "Correct": one.holds, "Check": one.check, "Result": one.found}
    return "".join(f"- **{label}**: {text}.\n" for label, text in told.items())


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    found = check_all()
    record(found)
    PAGE.write_text(page(found), encoding="utf-8")
