"""The command line: a thin skin over the public calls."""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import Annotated, NoReturn

import typer

from shoal.cli import demo, replay, reproduce, steering
from shoal.cli.output import say
from shoal.cli.search import missions, searching, tour
from shoal.cli.swarm import driving, exploration, maps, theory
from shoal.cli.sweep import running
from shoal.errors import ShoalError
from shoal.version import __version__

app = typer.Typer(
    name="shoal",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("map", epilog=exploration.MAP_EXAMPLE)(exploration.map_)
app.command("cover", epilog=exploration.COVER_EXAMPLE)(exploration.cover)
app.command("maps", epilog=maps.EXAMPLE)(maps.maps)
app.command("replay", epilog=replay.EXAMPLE)(replay.replay)
app.command("drive", epilog=driving.EXAMPLE)(driving.drive)
app.command("line", epilog=theory.LINE_EXAMPLE)(theory.line)
app.command("schedule", epilog=theory.SCHEDULE_EXAMPLE)(theory.schedule)
app.command("steer", epilog=steering.STEER_EXAMPLE)(steering.steer)
app.command("reach", epilog=steering.REACH_EXAMPLE)(steering.reach)
app.command("search", epilog=searching.SEARCH_EXAMPLE)(searching.search)
app.command("tour", epilog=tour.TOUR_EXAMPLE)(tour.tour)
app.add_typer(missions.app, name="missions")
app.add_typer(running.app, name="sweep")
app.command("reproduce", epilog=reproduce.EXAMPLE)(reproduce.reproduce)
app.command("demo", epilog=demo.EXAMPLE)(demo.demo)


def command_names() -> list[str]:
    """Return the names of all commands, those of groups after the others with the group's name before them.

    Examples
    --------
    >>> command_names()[:2], command_names()[-1].startswith("sweep ")
    (['map', 'cover'], True)
    """
    groups = [(str(group.name), group.typer_instance) for group in app.registered_groups]
    grouped = [f"{name} {command.name}" for name, group in groups if group is not None for command in group.registered_commands]
    return [str(command.name) for command in app.registered_commands] + grouped


def _print_version(wanted: bool) -> None:
    if wanted:
        print(__version__)
        raise typer.Exit


@app.callback()
def _shoal(
    version: Annotated[bool, typer.Option("--version", help="Print the version.", is_eager=True, callback=_print_version)] = False,
) -> None:
    """Plan, simulate and measure groups of simple bodies that must explore a space exhaustively."""


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code: 0, 1 (a check failed), 2 (bad input or output), 130 (interrupted)."""
    command = typer.main.get_command(app)
    given = list(sys.argv[1:] if arguments is None else arguments) or ["--help"]
    try:
        # Not command(...): that would turn an interruption or a closed pipe into an exit without a word from us.
        with command.make_context("shoal", given) as context:
            command.invoke(context)
        if sys.stdout is not None:
            sys.stdout.flush()  # a full disk shows here, not when Python ends
    except typer.Exit as ended:
        return ended.exit_code
    except ShoalError as error:
        return _refuse(str(error))
    except typer.TyperException as error:
        return _refuse(_usage(error))
    except (KeyboardInterrupt, typer.Abort):
        say("shoal: interrupted")
        return 130
    except BrokenPipeError:  # the reader of our output has gone, as in `shoal maps | head`
        _drop_output()
        return 0
    except OSError as error:
        if error.filename is None:
            _drop_output()
        return _refuse(f"cannot read or write {error.filename or 'the standard output'}: {error.strerror or error}")
    except MemoryError:
        return _refuse("out of memory: the map or the episode is too large for this machine")
    return 0


def _usage(error: typer.TyperException) -> str:
    """Return what is wrong with the command line; for a value that does not convert what was expected and what came."""
    from pydantic import ValidationError

    if not (isinstance(error, typer.BadParameter) and error.param and isinstance(error.__cause__, ValidationError)):
        return error.format_message()
    first = error.__cause__.errors()[0]
    numbers = {"int_parsing": "expected a whole number", "float_parsing": "expected a number"}
    return f"{error.param.opts[-1]}: {numbers.get(first['type'], first['msg'])}, got {str(first['input'])[:80]!r}"


def _drop_output() -> None:
    """Send what is left of the standard output nowhere, so that Python does not try again when it ends."""
    with suppress(OSError), open(os.devnull, "w") as nowhere:  # a caller's own stdout may have no descriptor
        os.dup2(nowhere.fileno(), sys.stdout.fileno())


def _refuse(text: str) -> int:
    say(f"shoal: {' '.join(text.split())}")
    return 2


def main() -> NoReturn:
    """Entry point of the ``shoal`` command."""
    sys.path.insert(0, os.getcwd())  # a user's own policy, MODULE:ATTRIBUTE, lies where the command is typed
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # letters that a terminal or a pipe cannot take are no reason to stop
    sys.exit(run())
