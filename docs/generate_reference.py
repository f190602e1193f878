"""Write docs/reference/ from the code: commands and problems from their declarations, rules of the
linter from their table.

A test fails if these files are not up to date.

Run: python docs/generate_reference.py
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path
from typing import Any

from typer.core import TyperCommand

from shoal.cli.commands import COMMANDS, command
from shoal.core.problem import Declaration, Problem
from shoal.envs import REGISTERED
from shoal.envs.options import ENVIRONMENTS, EnvOptions
from shoal.lab.problems import KINDS, trial_problem_type
from shoal.missions import RULES
from shoal.search.flight.vehicle import Vehicle

TARGET = Path(__file__).parent / "reference"
OPTION = re.compile(r"(?<![`\w-])--[a-z][a-z-]*")
TYPES = {int: "whole number", float: "number", bool: "true or false", str: "text"}
INTRO = """# Commands

Shoal's commands print results on stdout, and messages and progress on stderr. A command ends with one of five exit codes:

- Exit code 0 means that the command succeeded.
- Exit code 1 means that a check failed or a task was not completed, as the help of the command states.
- Exit code 2 means that the input is wrong, or that Shoal could not write a result. After wrong input or a failed
  write, a command prints an error message of one sentence on stderr, and leaves no incomplete file.
- Exit code 70 means an error in Shoal itself, or in a policy, planner or tour that you wrote. The command prints the
  traceback on stderr.
- Exit code 130 means that the user interrupted the command.

Each command has the option `--help`, in short `-h`, which prints the help of the command. The command `shoal --version` prints the
version of Shoal.

| command | what it does |
|---|---|
"""
# headings of tables; other options have the heading of their fields
ARGUMENTS, OPTIONS = "Arguments", "Options"


def commands() -> str:
    """Return the text of docs/reference/commands.md."""
    made = {name: command(name) for name in COMMANDS}
    rows = (
        cells(f"[`shoal {name}`](#shoal-{name.replace(' ', '-')})", said(one.help)[0])
        for name, one in made.items()
    )
    return INTRO + "".join(rows) + "".join(command_section(name, one) for name, one in made.items())


def command_section(name: str, one: TyperCommand) -> str:
    """Return how a command is written, what it does, an example, and the tables of its arguments
    and options.
    """
    tables: dict[str, list[str]] = {ARGUMENTS: [], OPTIONS: []}
    shown = [parameter for parameter in one.params if not getattr(parameter, "hidden", False)]
    for parameter in shown:
        heading = ARGUMENTS if is_argument(parameter) else parameter.rich_help_panel or OPTIONS
        tables.setdefault(heading, []).append(parameter_row(parameter))
    arguments = [
        (names_of(parameter)[0], parameter.required)
        for parameter in shown
        if is_argument(parameter)
    ]
    usage = " ".join(
        [
            "shoal",
            name,
            *(text if required else f"[{text}]" for text, required in arguments),
            "[OPTIONS]",
        ]
    )
    example = f"Example: `{one.epilog.removeprefix('Example: ')}`"
    parts = [f"## shoal {name}", f"`{usage}`", *said(one.help), example]
    for heading, rows in tables.items():
        if rows:
            parts += [
                f"**{heading}**",
                f"| name | type | default | meaning |\n|---|---|---|---|\n{''.join(rows)}".rstrip(),
            ]
    return "\n" + "\n\n".join(parts) + "\n"


def is_argument(parameter: Any) -> bool:
    """Return whether a parameter of a command is an argument, which has no name on the command
    line.
    """
    return not parameter.opts[0].startswith("-")


def names_of(parameter: Any) -> list[str]:
    """Return the names of an option, or the name of an argument in the help."""
    if is_argument(parameter):
        return [parameter.metavar or parameter.name.upper()]
    return [*parameter.opts, *parameter.secondary_opts]


def said(help_: str) -> list[str]:
    """Return the paragraphs of a help, each on one line."""
    return [" ".join(paragraph.split()) for paragraph in help_.split("\n\n")]


def parameter_row(parameter: Any) -> str:
    """Return the row of one argument or option."""
    typed = parameter.metavar or TYPES.get(parameter.type_descriptor.annotation, "value")
    shown = parameter.default if parameter.show_default is True else parameter.show_default
    without = shown is None or shown is False or shown == ""
    default = "required" if parameter.required else "" if without else f"`{shown}`"
    return cells(
        ", ".join(f"`{name}`" for name in names_of(parameter)),
        typed,
        default,
        " ".join(parameter.help.split()),
    )


def cells(*texts: str) -> str:
    """Return a row of a table, with the names of options as code."""
    row = " | ".join(OPTION.sub(r"`\g<0>`", text.replace("|", " or ")) for text in texts)
    return f"| {row} |\n"


PROBLEMS = """# Problems

A problem and a seed define a run completely. This page lists the fields of all kinds of problems. A field has the same name and
the same default in commands, sweep files, problem files and Python. As an option of a command, the field `max_moves` has the
name `--max-moves`. A problem file is a JSON object with the fields of a problem and its `kind`. A sweep file has the fields of
its problem under `[problem]` or `[axes]`.
"""


def problems() -> str:
    """Return the text of docs/reference/problems.md."""
    sections = "".join(section(kind, trial_problem_type(kind)) for kind in KINDS)
    return f"{PROBLEMS}{sections}\n## Vehicles\n\n{table(Vehicle)}"


def section(kind: str, problem: type[Problem]) -> str:
    """Return the table of one kind of problem."""
    measures = problem.measures if isinstance(problem.measures, tuple) else ()
    measured = (
        f"\nFor each trial, a sweep stores {', '.join(f'`{name}`' for name in measures)}.\n"
        if measures
        else ""
    )
    return f'\n## kind = "{kind}"\n\n{table(problem)}{measured}'


def table(problem: type[Problem]) -> str:
    """Return what a problem is, and the table of its fields."""
    summary = " ".join((problem.__doc__ or "").partition("\n\n")[0].split())
    rows = "".join(row(declared) for declared in problem.declarations().values())
    return f"{summary}\n\n| field | type | default | meaning |\n|---|---|---|---|\n{rows}"


ENVIRONMENT_PAGE = """# Environments

An environment accepts almost all fields of its [problem](problems.md) as options. The tables of this page list the options that
environments have in addition to the fields of problems. The line below each table lists the fields of the problem that are not
options of the environment. For example, `policy` is not an option, because the agent makes the decisions. [Use the
environments](../how-to/environments.md) shows examples of environments.

| id | class | options whose default differs from the field's default |
|---|---|---|
"""


def environments() -> str:
    """Return the text of docs/reference/environments.md."""
    rows = [
        f"| `{name}` | `{entry.partition(':')[2]}` |"
        f" {', '.join(f'`{key}={value!r}`' for key, value in options.items())} |\n"
        for name, (entry, options) in REGISTERED.items()
    ]
    return (
        ENVIRONMENT_PAGE + "".join(rows) + "".join(environment(options) for options in ENVIRONMENTS)
    )


def environment(options: type[EnvOptions]) -> str:
    """Return the table of one kind of environment."""
    kind = options.part.partition("-")[0]
    without = ", ".join(f"`{name}`" for name in options.decided)
    return (
        f"\n## {kind.capitalize()}\n\n{table(options)}\nFields of the problem that are not options"
        f" of the environment: {without}.\n"
    )


def row(declared: Declaration) -> str:
    """Return the row of one field."""
    option = declared.option
    kind = TYPES.get(declared.type, option.metavar or "value")
    default = (
        "" if declared.required else "none" if declared.default is None else f"`{declared.default}`"
    )
    limits = [
        f"one of {', '.join(f'`{choice}`' for choice in option.choices)}" if option.choices else "",
        f"range: {declared.range}" if declared.range else "",
        f"unit: {option.unit}" if option.unit else "",
    ]
    told = "; ".join(filter(None, limits))
    meaning = (
        re.sub(r"\.( |$)", lambda end: f" ({told}){end[0]}", declared.help, count=1)
        if told
        else declared.help
    )
    return cells(f"`{declared.name}`", kind, default, meaning)


LINTER = """# Rules of the mission linter

The mission linter reads mission files and reports mistakes. To run the linter, use the command `shoal missions check` or the
function `shoal.missions.lint(path_or_folder, region)`. For each mistake, the linter names the file, the place in the
file, the rule, the expected value and the value in the file. The function `read_mission` refuses a file with an error that is
marked * in the table. [Missions](../concepts/missions.md) explains how Shoal writes mission files.

If possible, pass the region of the search to the linter. Without the region, the linter cannot detect that latitude and longitude
are exchanged in all coordinates of a file, because such a file looks like a mission in another place. The option `--autopilot px4`
states the expected autopilot. The option `--cap 250` states the number of mission items that the autopilot can store. The option
`--separation` of `shoal missions check`, or the argument `separation` of `lint`, sets the smallest distance between homes and
landing points of different vehicles (rule `homes-near`).

| rule | severity | what is wrong |
|---|---|---|
"""


def linter() -> str:
    """Return the text of docs/reference/mission-linter.md."""
    rows = (
        f"| `{name}` | {rule.severity} | {rule.meaning}{' *' * rule.fatal} |\n"
        for name, rule in RULES.items()
    )
    return LINTER + "".join(rows)


PAGES = {
    "commands.md": commands,
    "problems.md": problems,
    "environments.md": environments,
    "mission-linter.md": linter,
}

if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    for name, made in PAGES.items():
        (TARGET / name).write_text(made(), encoding="utf-8")
