"""The command line: a thin skin over the public calls."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from typing import Annotated, NoReturn

import typer

from shoal.cli import demo, maps, swarm
from shoal.cli.output import say
from shoal.errors import ShoalError
from shoal.version import __version__

app = typer.Typer(
    name="shoal",
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("map", epilog=swarm.MAP_EXAMPLE)(swarm.map_)
app.command("cover", epilog=swarm.COVER_EXAMPLE)(swarm.cover)
app.command("maps", epilog=maps.EXAMPLE)(maps.maps)
app.command("replay", epilog=swarm.REPLAY_EXAMPLE)(swarm.replay)
app.command("demo", epilog=demo.EXAMPLE)(demo.demo)


@app.callback()
def _shoal(
    version: Annotated[bool, typer.Option("--version", help="Print the version.", is_eager=True)] = False,
) -> None:
    """Plan, simulate and measure groups of simple bodies that must explore a space exhaustively."""
    if version:
        print(__version__)
        raise typer.Exit


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code: 0, 1 (a check failed), 2 (bad input or output), 130 (interrupted)."""
    command = typer.main.get_command(app)
    try:
        code = command(args=arguments, prog_name="shoal", standalone_mode=False)
    except ShoalError as error:
        return _refuse(str(error))
    except typer.TyperException as error:
        return _refuse(error.format_message())
    except (KeyboardInterrupt, typer.Abort):
        say("shoal: interrupted")
        return 130
    except BrokenPipeError:  # the reader of our output has gone, as in `shoal maps | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except MemoryError:
        return _refuse("out of memory: the map or the episode is too large for this machine")
    return code if isinstance(code, int) else 0


def _refuse(text: str) -> int:
    say(f"shoal: {' '.join(text.split())}")
    return 2


def main() -> NoReturn:
    """Entry point of the ``shoal`` command."""
    sys.exit(run())
