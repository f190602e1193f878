"""The command-line interface of Shoal: a thin layer over the public functions."""

from __future__ import annotations

import gc
import io
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import NoReturn

import typer

from shoal.cli.commands import app
from shoal.cli.output import say
from shoal.core.errors import ShoalError
from shoal.core.interruption import command_running, end
from shoal.core.notices import listeners
from shoal.core.registry import look_in

INTERRUPTED = 130
INTERNAL = 70
"""Exit code after an error in Shoal itself (EX_SOFTWARE of sysexits.h), so that 1 always means a
finding.
"""


def run(arguments: Sequence[str] | None = None) -> int:
    """Run one command of Shoal and return its exit code.

    The exit code is 0 for success, 1 for a failed check, 2 for bad input or output, 70 for an error
    in Shoal itself, and 130 after an interruption.
    """
    command = typer.main.get_command(app)
    if say not in listeners:
        listeners.append(say)
    given = list(sys.argv[1:] if arguments is None else arguments) or ["--help"]
    try:
        # Not command(...), which would turn an interruption or a closed pipe into a silent exit.
        with command_running(), command.make_context("shoal", given) as context:
            command.invoke(context)
        if sys.stdout is not None:
            sys.stdout.flush()  # a full disk is detected here, not when Python ends
    except typer.Exit as ended:
        return ended.exit_code
    except ShoalError as error:
        return _refuse(str(error))
    except typer.TyperException as error:
        return _refuse(_usage(error))
    except (KeyboardInterrupt, typer.Abort):
        say("shoal: interrupted")
        return INTERRUPTED
    except BrokenPipeError:
        # the reader of our output has closed the pipe, as in `shoal maps | head`
        _drop_output()
        return 0
    except OSError as error:
        if error.filename is None:
            _drop_output()
        return _refuse(
            f"cannot read or write {error.filename or 'the standard output'}:"
            f" {error.strerror or error}"
        )
    except MemoryError:
        return _refuse("out of memory: the map or the episode is too large for this machine")
    except Exception as error:
        # a mistake in Shoal, or in a policy, planner or tour that the user wrote
        import traceback

        say(traceback.format_exc().rstrip())
        say(f"shoal: internal error: {type(error).__name__}: {' '.join(str(error).split())[:200]}")
        return INTERNAL
    return 0


def _usage(error: typer.TyperException) -> str:
    """Return a message about an error in the command line.

    If an option's value cannot be converted, the message names the expected value and the given
    value.
    """
    from pydantic import ValidationError

    if not (
        isinstance(error, typer.BadParameter)
        and error.param
        and isinstance(error.__cause__, ValidationError)
    ):
        # without a command, the help text is the message, and printed already
        return error.format_message() or "expected a command, one of those above"
    first = error.__cause__.errors()[0]
    numbers = {"int_parsing": "expected a whole number", "float_parsing": "expected a number"}
    return (
        f"{error.param.opts[-1]}: {numbers.get(first['type'], first['msg'])}, got"
        f" {str(first['input'])[:80]!r}"
    )


def _drop_output() -> None:
    """Redirect standard output to the null device, so that Python does not try to write the
    remaining text again at exit.
    """
    # a caller's own stdout may have no descriptor
    with (
        suppress(OSError),
        open(os.devnull, "w") as nowhere,
    ):
        os.dup2(nowhere.fileno(), sys.stdout.fileno())


def _refuse(text: str) -> int:
    say(f"shoal: {' '.join(text.split())}")
    return 2


def main() -> NoReturn:
    """Run one command of the program ``shoal``, and exit with the exit code of the command."""
    # Typer uses pydantic, which otherwise reads the records of all installed packages to find
    # extensions of itself
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    # OpenBLAS otherwise starts a thread for each processor, which waits in a busy loop for up to
    # 0.06 s; no large matrices here
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with suppress(OSError):  # the folder may have been deleted
        look_in(os.getcwd())  # a user's own policy, MODULE:ATTRIBUTE, may be in the current folder
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # characters that a terminal or a pipe cannot encode must not stop a command
            stream.reconfigure(errors="backslashreplace")
    code = run()
    if code == INTERRUPTED:
        # Python's own exit takes a while, and after some interruptions it uses another code
        end("")
    gc.freeze()  # nor does Python scan them as it exits, which takes a quarter of a start
    sys.exit(code)
