"""The commands of Shoal by name; each command loads only the libraries that it needs."""

from __future__ import annotations

import ast
import importlib
import os
import re
from collections.abc import Callable
from contextlib import nullcontext
from functools import cache
from importlib.util import find_spec
from math import inf
from pathlib import Path
from typing import Annotated, Any, NamedTuple, cast

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

from shoal.cli.output import only_json
from shoal.core.errors import InvalidInputError
from shoal.core.files import keep_inputs
from shoal.core.version import __version__


class _Entry(NamedTuple):
    """The location of a command: its module in `shoal.cli`, its function, and the name of the
    constant with its example.
    """

    module: str
    function: str
    example: str = "EXAMPLE"


COMMANDS = {
    "map": _Entry("swarm.exploration", "map_", "MAP_EXAMPLE"),
    "cover": _Entry("swarm.exploration", "cover", "COVER_EXAMPLE"),
    "gather": _Entry("swarm.exploration", "gather", "GATHER_EXAMPLE"),
    "maps": _Entry("swarm.maps", "maps"),
    "drive": _Entry("swarm.driving", "drive"),
    "line": _Entry("swarm.theory", "line", "LINE_EXAMPLE"),
    "schedule": _Entry("swarm.theory", "schedule", "SCHEDULE_EXAMPLE"),
    "adversary": _Entry("swarm.theory", "adversary", "ADVERSARY_EXAMPLE"),
    "steer": _Entry("steering", "steer", "STEER_EXAMPLE"),
    "reach": _Entry("steering", "reach", "REACH_EXAMPLE"),
    "search": _Entry("search.searching", "search", "SEARCH_EXAMPLE"),
    "tour": _Entry("search.tour", "tour", "TOUR_EXAMPLE"),
    "robot": _Entry("search.robot", "robot", "ROBOT_EXAMPLE"),
    "rehearse": _Entry("search.rehearsing", "rehearse", "REHEARSE_EXAMPLE"),
    "missions check": _Entry("search.missions", "check", "CHECK_EXAMPLE"),
    "missions upload": _Entry("search.robots", "upload", "UPLOAD_EXAMPLE"),
    "missions start": _Entry("search.robots", "start", "START_EXAMPLE"),
    "missions watch": _Entry("search.robots", "watch", "WATCH_EXAMPLE"),
    "missions flown": _Entry("search.robots", "flown", "FLOWN_EXAMPLE"),
    "sweep run": _Entry("sweep", "run", "RUN_EXAMPLE"),
    "sweep status": _Entry("sweep", "status", "STATUS_EXAMPLE"),
    "sweep summary": _Entry("sweep", "summary", "SUMMARY_EXAMPLE"),
    "sweep plot": _Entry("sweep", "plot", "PLOT_EXAMPLE"),
    "sweep export": _Entry("sweep", "export_", "EXPORT_EXAMPLE"),
    "sweep merge": _Entry("sweep", "merge", "MERGE_EXAMPLE"),
    "sweep check": _Entry("sweep", "check", "CHECK_EXAMPLE"),
    "bench run": _Entry("bench", "run", "RUN_EXAMPLE"),
    "bench table": _Entry("bench", "table", "TABLE_EXAMPLE"),
    "reproduce": _Entry("reproduce", "reproduce"),
    "replay": _Entry("replay", "replay"),
    "figure": _Entry("figure", "figure"),
    "studio": _Entry("studio", "studio"),
    "demo": _Entry("demo", "demo"),
}
GROUPS = {
    "missions": "Check mission files, bring them on board of vehicles, start them, and read flight logs.",
    "sweep": (
        "Run sweeps of trials that can be continued after any interruption, and examine their"
        " results."
    ),
    "bench": "Compare policies on suites of problems that never change (Shoal-Bench).",
}
PANELS = {
    "swarm": "Swarm",
    "steering": "Steering",
    "search": "Search",
    "sweep": "Experiments",
    "bench": "Experiments",
    "reproduce": "Experiments",
}
"""Headings in the list of all commands. A command appears under the heading for the first word of
its module's name.
"""
SETTINGS: dict[str, Any] = {"help_option_names": ["-h", "--help"]}


_SIMPLE = {
    str: re.compile(".*", re.DOTALL).fullmatch,
    int: re.compile("[0-9]{1,18}").fullmatch,
    float: re.compile(r"[0-9]{1,18}(\.[0-9]{1,18})?").fullmatch,
    Path: re.compile(".*", re.DOTALL).fullmatch,
}
"""By type, which texts are simple values: those that Python reads exactly as Pydantic does. No path
of a command is looked up before the command runs.
"""


def _process(parameter: Any, ctx: Any, value: Any, by_typer: Callable[..., Any]) -> Any:
    """Return the value of a parameter: a missing or simple value as it is, any other by Typer,
    which imports the library Pydantic. That import takes a fifth of a small command's time.
    """
    kind = getattr(getattr(parameter, "type_descriptor", None), "annotation", None)
    if value is None and not parameter.required:
        value = () if parameter.multiple or parameter.nargs == -1 else None
    elif kind in _SIMPLE and isinstance(value, str) and _SIMPLE[kind](value):
        value = kind(value)
        least, most = getattr(parameter, "min", None), getattr(parameter, "max", None)
        if least is not None or most is not None:
            from shoal.core.checks import check_number  # which loads numpy

            check_number(
                value,
                what=parameter.opts[0],
                least=-inf if least is None else least,
                most=inf if most is None else most,
            )
    elif kind not in _SIMPLE or type(value) is not kind:  # other than a default
        return by_typer(ctx, value)
    return value if parameter.callback is None else parameter.callback(ctx, parameter, value)


class _Argument(TyperArgument):
    """An argument of which Typer reads only what is not simple."""

    def process_value(self, ctx: Any, value: Any) -> Any:
        """Return the value, converted and checked."""
        return _process(self, ctx, value, super().process_value)


class _Option(TyperOption):
    """An option of which Typer reads only what is not simple."""

    def process_value(self, ctx: Any, value: Any) -> Any:
        """Return the value, converted and checked."""
        return _process(self, ctx, value, super().process_value)


def _ours(parameters: list[Any]) -> list[Any]:
    """Turn the parameters, which Typer has made, into `_Argument` and `_Option` objects."""
    for parameter in parameters:
        if type(parameter) in _OURS:
            parameter.__class__ = _OURS[type(parameter)]
    return parameters


_OURS: dict[Any, Any] = {TyperArgument: _Argument, TyperOption: _Option}


OUTPUTS = ("out", "film", "calibrate", "prepare", "missions")
"""Names of parameters with files or folders that a command writes anew; a log is never overwritten."""


def _files_of(value: Any) -> list[str]:
    """Return the existing files that the value of a parameter names."""
    return [
        str(one)
        for one in (value if isinstance(value, list | tuple) else [value])
        if isinstance(one, str | os.PathLike) and os.path.isfile(one)
    ]


class _Command(TyperCommand):
    """A command that checks its option ``--seed``, even if the command uses no random numbers, and
    keeps the files that it reads.
    """

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters, including the option ``--help``."""
        return _ours(super().get_params(ctx))

    def invoke(self, ctx: Any) -> Any:
        """Check the seed and the outputs, and run the command.

        Raises
        ------
        InvalidInputError
            If the seed is no seed, or an output is an input.
        """
        if ctx.params.get("seed") is not None:
            from shoal.core.checks import (
                check_integer,  # NumPy is slow to import, and help does not need it
            )

            check_integer(ctx.params["seed"], what="seed", least=0)
        read = [
            file
            for name, value in ctx.params.items()
            if name not in OUTPUTS
            for file in _files_of(value)
        ]
        for name in OUTPUTS:
            for file in _files_of(ctx.params.get(name)):
                if any(os.path.samefile(file, one) for one in read):
                    raise InvalidInputError(
                        f"--{name}: expected a file other than those that the command reads, got"
                        f" {file}"
                    )
        with keep_inputs(read), only_json() if ctx.params.get("json_") else nullcontext():
            return super().invoke(ctx)


def command(name: str) -> TyperCommand:
    """Import the module of the command with the full name ``name``, such as "sweep run", and return
    the command.
    """
    module, function, example = COMMANDS[name]
    home = importlib.import_module(f"shoal.cli.{module}")
    alone = typer.Typer(add_completion=False, rich_markup_mode="rich", context_settings=SETTINGS)
    alone.command(name.rsplit(maxsplit=1)[-1], cls=_Command, epilog=getattr(home, example))(
        getattr(home, function)
    )
    return cast("TyperCommand", typer.main.get_command(alone))


def _summary(name: str) -> str:
    """Return the first paragraph of a command's help, read from the command's source file without
    importing the file.
    """
    module, function, _ = COMMANDS[name]
    return (ast.get_docstring(_functions(module)[function]) or "").partition("\n\n")[0]


@cache
def _functions(module: str) -> dict[str, ast.FunctionDef]:
    """Return the functions that the source file of a module in `shoal.cli` defines."""
    spec = find_spec(f"shoal.cli.{module}")
    tree = ast.parse(Path(spec.origin).read_bytes())  # type: ignore[union-attr, arg-type]
    return {one.name: one for one in tree.body if isinstance(one, ast.FunctionDef)}


def _panel(name: str) -> str:
    """Return the heading under which help lists a command or a group. A group has the heading of
    its first command.
    """
    first = next(
        entry for command, entry in COMMANDS.items() if f"{command} ".startswith(f"{name} ")
    )
    return PANELS.get(first.module.partition(".")[0], "General")


class _Commands(TyperGroup):
    """A group of commands: all commands whose full names begin with ``prefix``."""

    prefix = ""
    listing = False

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters, including the option ``--help``."""
        return _ours(super().get_params(ctx))

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands and groups in this group, in the order of `COMMANDS`."""
        names = [
            name.removeprefix(self.prefix) for name in COMMANDS if name.startswith(self.prefix)
        ]
        return list(dict.fromkeys(name.split()[0] for name in names))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return the command or group with a given name.

        While help lists all commands, the result has only a name and a summary, so that help
        imports no module.
        """
        whole = self.prefix + cmd_name
        if whole in GROUPS:
            group = _Commands(
                name=cmd_name,
                help=GROUPS[whole],
                no_args_is_help=True,
                rich_markup_mode="rich",
                context_settings=SETTINGS,
            )
            group.prefix, group.rich_help_panel = f"{whole} ", _panel(whole)
            return group
        if whole not in COMMANDS:
            return None
        if self.listing:
            return TyperCommand(
                cmd_name,
                help=_summary(whole),
                rich_help_panel=None if self.prefix else _panel(whole),
            )
        return command(whole)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the name of a command, the command, and its arguments. The error for a wrong name
        suggests similar names.
        """
        self.commands = dict.fromkeys(self.list_commands(ctx), cast("Any", None))
        return super().resolve_command(ctx, args)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help of the group, with the names and summaries of its commands."""
        self.listing = True
        try:
            super().format_help(ctx, formatter)
        finally:
            self.listing = False


app = typer.Typer(
    name="shoal",
    cls=_Commands,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings=SETTINGS,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        print(__version__)
        raise typer.Exit


@app.callback()
def _shoal(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", is_eager=True, callback=_print_version
        ),
    ] = False,
) -> None:
    """Plan, simulate and measure how groups of simple robots explore a space completely.

    Exit codes: 0 success, 1 a failed check or a task that was not completed, 2 wrong input or
    output, 70 an error in Shoal itself, 130 interrupted.
    """
