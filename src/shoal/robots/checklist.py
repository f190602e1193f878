"""The report of a rehearsal: a check list for the operator, as Markdown and as HTML."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple

from shoal.core.files import write_json, write_text
from shoal.robots.mavlink import AUTOPILOTS
from shoal.robots.rehearsal import Rehearsal, RehearsalResult
from shoal.robots.settings import safe_parameters

NAME = "rehearsal"
_STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem}"
    "table{border-collapse:collapse;margin:1rem 0}td,th{border:1px solid #bbb;padding:.2rem .6rem;"
    "text-align:left}li.check{list-style:'\\2610  '}"
)


class _Section(NamedTuple):
    """A part of the report: paragraphs, a table with its head, and points to check."""

    title: str
    paragraphs: Sequence[str] = ()
    table: Sequence[Sequence[object]] = ()
    points: Sequence[str] = ()


def write_checklist(
    rehearsal: Rehearsal, runs: Sequence[RehearsalResult], folder: Path
) -> list[Path]:
    """Write ``rehearsal.json``, ``rehearsal.md`` and ``rehearsal.html``, and return their paths."""
    title = f"Rehearsal of {rehearsal.task.path.parent.name}"
    sections = _sections(rehearsal, runs)
    paths = [folder / f"{NAME}.{suffix}" for suffix in ("json", "md", "html")]
    write_json(paths[0], report_of(rehearsal, runs))
    write_text(paths[1], _markdown(title, sections))
    write_text(paths[2], _html(title, sections))
    return paths


def report_of(rehearsal: Rehearsal, runs: Sequence[RehearsalResult]) -> dict[str, object]:
    """Return a rehearsal as a mapping for JSON.

    The key "covered_fraction" is the smallest of all runs, and "passed" tells whether nothing was
    wrong in any.
    """
    return {
        "search": rehearsal.task.search,
        "robots": len(rehearsal.numbers),
        "autopilot": rehearsal.autopilot,
        "loss": rehearsal.loss,
        "speed_up": rehearsal.speed_up,
        "covered_fraction": min(run.record.covered_fraction for run in runs),
        "passed": not any(run.faults for run in runs),
        "runs": [run.report() for run in runs],
    }


def _sections(rehearsal: Rehearsal, runs: Sequence[RehearsalResult]) -> list[_Section]:
    return [
        *(_run_section(run) for run in runs),
        _settings_section(rehearsal),
        _before_section(rehearsal),
    ]


def _run_section(run: RehearsalResult) -> _Section:
    record = run.record
    happened = "; ".join(
        f"{happening['what']} robot {happening['robot']} after {happening['time_s']:.0f} s"
        for happening in run.happened
    )
    near = record.approach
    horizontal, vertical = record.required_m
    approach = "no two vehicles came near each other at the same height"
    if near is not None:
        approach = (
            f"robots {near['robots'][0]} and {near['robots'][1]}: {near['horizontal_m']:.1f} m, and"
            f" {near['vertical_m']:.1f} m in height, after {near['time_s']:.0f} s; required:"
            f" {horizontal:g} m, or {vertical:g} m in height"
        )
    rows: list[list[object]] = [["robot", "ended as", "battery left", "fault", "messages lost"]]
    for robot in run.robots:
        total = robot["heard"]
        share = f"{100 * robot['lost'] / total:.0f} % of {total}" if total else "none heard"
        charge = f"{100 * record.battery[robot['robot']]:.0f} %"
        rows.append([robot["robot"], robot["status"], charge, robot["fault"] or "-", share])
    return _Section(
        f"Run: {run.name}",
        [
            "Passed." if not run.faults else "Not passed: " + "; ".join(run.faults) + ".",
            (
                f"Searched: {100 * record.covered_fraction:.4g} % of {record.cells} cells in"
                f" {record.seconds / 60:.1f} min in flight."
            ),
            f"Nearest approach: {approach}.",
            *([f"What happened: {happened}."] if happened else []),
        ],
        rows,
    )


def _settings_section(rehearsal: Rehearsal) -> _Section:
    """Return a table of the parameters of each autopilot, as the rehearsal had them."""
    task = rehearsal.task
    autopilot = {name.lower(): value for value, name in AUTOPILOTS.items()}[rehearsal.autopilot]
    tables = [
        safe_parameters(autopilot, task.kind, task.height(number)) for number in rehearsal.numbers
    ]
    rows: list[list[object]] = [["parameter", *(f"robot {number}" for number in rehearsal.numbers)]]
    rows += [[name, *(f"{table[name]:g}" for table in tables)] for name in tables[0]]
    return _Section(
        f"Parameters of the autopilots ({AUTOPILOTS[autopilot]})",
        [
            (
                "The rehearsal had these values. Before each take-off, the program of a robot reads"
                " them from the autopilot, and refuses values with which a lost companion computer"
                " would leave the vehicle in the air."
            )
        ],
        rows,
    )


def _before_section(rehearsal: Rehearsal) -> _Section:
    task = rehearsal.task
    low, high = task.height(1), task.height(len(rehearsal.numbers))
    rover = task.kind == "rover"
    return _Section(
        "Before you go out",
        points=[
            "Every robot has the task, its key file and the same version of Shoal.",
            "The clocks of all companion computers agree within one minute.",
            "The fence is on board of each autopilot, and its corners are right on the map.",
            "No other ground station has the system id that an autopilot waits for.",
            *(
                []
                if rover
                else [
                    f"You may fly at {low:g} to {high:g} m above the launch points, and nothing"
                    " stands as high as that in the region and on the ways home.",
                    "Each vehicle stands at its launch point: it returns to where it was armed.",
                ]
            ),
            "A pilot with a remote control can take over each vehicle.",
            "The radio reaches across the whole region; its loss there is at most"
            f" {100 * rehearsal.loss:.0f} %, as in this rehearsal.",
            "Everybody knows that a robot whose program or radio fails returns by itself.",
        ],
    )


def _markdown(title: str, sections: Sequence[_Section]) -> str:
    lines = [f"# {title}", ""]
    for section in sections:
        lines += [f"## {section.title}", ""]
        for paragraph in section.paragraphs:
            lines += [paragraph, ""]
        for number, row in enumerate(section.table):
            lines.append("| " + " | ".join(str(value).replace("|", "\\|") for value in row) + " |")
            if number == 0:
                lines.append("|" + " --- |" * len(row))
        lines += [""] * bool(section.table)
        lines += [f"- [ ] {point}" for point in section.points]
        lines += [""] * bool(section.points)
    return "\n".join(lines)


def _html(title: str, sections: Sequence[_Section]) -> str:
    parts = [
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>",
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>",
        f"<h1>{escape(title)}</h1>",
    ]
    for section in sections:
        parts.append(f"<h2>{escape(section.title)}</h2>")
        parts += [f"<p>{escape(paragraph)}</p>" for paragraph in section.paragraphs]
        if section.table:
            head, *rows = ([escape(str(value)) for value in row] for row in section.table)
            parts.append("<table><tr>" + "".join(f"<th>{value}</th>" for value in head) + "</tr>")
            parts += [
                "<tr>" + "".join(f"<td>{value}</td>" for value in row) + "</tr>" for row in rows
            ]
            parts.append("</table>")
        if section.points:
            parts += [
                "<ul>",
                *(f"<li class='check'>{escape(point)}</li>" for point in section.points),
            ]
            parts.append("</ul>")
    return "\n".join([*parts, "</body></html>\n"])
