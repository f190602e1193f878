"""The page of results: one self-contained HTML file with all figures, their numbers, and the errata
with their checks.
"""

from __future__ import annotations

import base64
import os
from collections import Counter
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

from shoal.core.files import write_text
from shoal.lab.versions import worker_versions
from shoal.papers.claims import Claim, Verdict
from shoal.papers.errata import CHECKS, Erratum
from shoal.papers.recipe import Result, Table, capital

_STYLE = Path(__file__).with_suffix(".css")
_NAMES = {"shoal": "Shoal", "python": "Python", "numpy": "NumPy", "numba": "Numba"}
_PAPERS = {
    "D": "Mapping and coverage: papers M and D",
    "M": "Mapping and coverage: papers M and D",
    "W": "Two particles and walls: paper W",
    "H": "Search along a closed curve: paper H",
}
_LONG = 14  # rows of a table that are shown unfolded


def write_page(
    results: Sequence[Result], errata: Sequence[Erratum], path: str | os.PathLike[str]
) -> Path:
    """Write the page of results as an HTML file, and return the path of the file.

    Raises
    ------
    OutputError
    """
    target = Path(path)
    counts = Counter(
        claim.verdict for result in results if result.outcome for claim in result.outcome.claims
    )
    answers = ", ".join(
        f"{counts[verdict]}"
        f" {'agree' if verdict == 'agrees' else 'differ' if verdict == 'differs' else f'are {verdict}'}"
        for verdict in Verdict
    )
    failed = sum(result.outcome is None for result in results)
    shown = sum(erratum.shown for erratum in errata)
    trials, seconds = (
        sum(result.trials for result in results),
        sum(result.seconds for result in results),
    )
    made = ", ".join(
        f"{_NAMES[name]} {value}" for name, value in worker_versions().items() if name in _NAMES
    )
    parts = [
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>",
        "<meta name='viewport' content='width=device-width, initial-scale=1'>",
        (
            "<title>Shoal: the papers'"
            f" figures</title><style>{_STYLE.read_text(encoding='utf-8')}</style></head><body><main>"
        ),
        "<h1>The papers' figures, reproduced</h1>",
        (
            f"<p class='lead'>{counts.total()} claims of {len(results)} figures: {answers}."
            f" {f'{failed} figures could not be made. ' if failed else ''}{shown} of {len(errata)}"
            f" errata are shown by their checks. {trials:,} trials, {_time(seconds)} for this page;"
            f" {escape(made)}.</p>"
        ),
        _contents(results, errata),
        *(_figure(result) for result in results),
        _errata(errata),
        "</main></body></html>",
    ]
    write_text(target, "\n".join(parts))
    return target


_MARKS = {
    Verdict.AGREES: ("good", "✓"),
    Verdict.DIFFERS: ("bad", "✗"),
    Verdict.NOT_COMPARABLE: ("open", "?"),
    None: ("failed", "!"),
}


def _mark(verdict: Verdict | None) -> str:
    name, sign = _MARKS[verdict]
    return f"<span class='mark {name}' title='{verdict or 'could not be made'}'>{sign}</span>"


def _verdict(result: Result) -> Verdict | None:
    return result.outcome.verdict if result.outcome else None


def _time(seconds: float) -> str:
    return f"{seconds:.0f} seconds" if seconds < 100 else f"{seconds / 60:.0f} minutes"


def _contents(results: Sequence[Result], errata: Sequence[Erratum]) -> str:
    links = [
        f"<a href='#{result.recipe.name}'>{_mark(_verdict(result))}"
        f"{escape(capital(result.recipe.source))}: {escape(result.recipe.title)}</a>"
        for result in results
    ]
    return (
        f"<nav>{''.join(links)}<a href='#errata'><span class='mark'></span>{len(errata)} errata,"
        " with their checks</a></nav>"
    )


def _figure(result: Result) -> str:
    recipe, outcome = result.recipe, result.outcome
    also = f"; also {escape(recipe.also)}" if recipe.also else ""
    head = (
        f"<section id='{recipe.name}'><h2>{_mark(_verdict(result))} {escape(recipe.title)}</h2><p"
        f" class='source'>{escape(capital(recipe.source))}{also} · {result.trials:,} trials · shoal"
        f" reproduce {recipe.name}</p>"
    )
    if outcome is None:
        return (
            f"{head}<p class='error'>This figure could not be made:"
            f" {escape(result.error)}</p></section>"
        )
    picture = base64.b64encode(result.files[0].read_bytes()).decode()
    files = ", ".join(
        f"<a href='{escape(path.name)}'>{escape(path.name)}</a>" for path in result.files
    )
    return (
        f"{head}<div class='picture'><img alt='{escape(recipe.title)}'"
        f" src='data:image/png;base64,{picture}'></div>{_claims(outcome.claims)}<p>{escape(outcome.sentence)}</p>{''.join(_table(table) for table in outcome.tables if table.shown and table.rows)}<p"
        f" class='files'>Beside this page: {files}</p></section>"
    )


def _claims(claims: Sequence[Claim]) -> str:
    rows = "".join(
        f"<tr><td>{_mark(one.verdict)} {one.verdict}</td>"
        f"{''.join(f'<td>{escape(text)}</td>' for text in (one.what, one.printed, one.ours, one.criterion))}</tr>"
        for one in claims
    )
    head = "".join(
        f"<th>{name}</th>"
        for name in ("", "claim", "printed", "ours", "agrees if, or why it cannot be compared")
    )
    return (
        "<div class='scroll"
        f" claims'><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>"
    )


def _table(table: Table) -> str:
    head = "".join(f"<th>{escape(str(column))}</th>" for column in table.columns)
    rows = "".join(
        f"<tr>{''.join(f'<td>{escape(_cell(value))}</td>' for value in row)}</tr>"
        for row in table.rows
    )
    drawn = (
        "<div"
        f" class='scroll'><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>"
    )
    title = escape(capital(table.title))
    if len(table.rows) > _LONG:
        return f"<details open><summary>{title}, {len(table.rows)} rows</summary>{drawn}</details>"
    return f"<details open><summary>{title}</summary>{drawn}</details>"


def _cell(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) and value == round(value) else str(value)


def _errata(errata: Sequence[Erratum]) -> str:
    parts, paper = [], ""
    when = (
        "computed when this page was written"
        if CHECKS.exists()
        else "recorded with this version of Shoal"
    )
    for erratum in errata:
        of = _PAPERS[erratum.source.removeprefix("papers ").removeprefix("paper ")[0]]
        if of != paper:
            parts.append(f"<h3>{escape(of)}</h3>")
            paper = of
        parts.append(_erratum(erratum))
    return (
        "<section id='errata'><h2>Errata, with their checks</h2><p>What the papers print and does"
        " not hold, or needs saying. What the checks found was"
        f" {when}.</p>{''.join(parts)}</section>"
    )


def _erratum(erratum: Erratum) -> str:
    told = (
        ("printed", erratum.printed),
        ("holds", erratum.holds),
        ("check", erratum.check),
        ("found", erratum.found),
    )
    rows = "".join(f"<div><dt>{name}</dt><dd>{escape(text)}</dd></div>" for name, text in told)
    mark = _mark(Verdict.AGREES if erratum.shown else Verdict.DIFFERS)
    return f"<article><h4>{mark} {escape(capital(erratum.source))}</h4><dl>{rows}</dl></article>"
