"""How a command ends when it is asked to: by Ctrl-C, by SIGTERM, by a terminal that is closed.

While it loads it ends at once. While it runs, KeyboardInterrupt is raised, so that everything is put away; but compiled code may
run for minutes before Python sees a signal. So a thread waits for signals, too, and ends the command soon after one.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from contextlib import contextmanager

TYPE_CHECKING = False
if TYPE_CHECKING:  # this is the first module that a command loads: it waits for no others
    from collections.abc import Iterator
    from pathlib import Path
    from types import FrameType

GRACE = 0.7
"""Seconds between a signal and the end of a command that has not ended by itself."""

half_written: set[Path] = set()
"""Files to remove if the command is ended at once."""

_KNOTS = ("importlib._bootstrap", "numba.", "llvmlite.", "shoal.jit.", "weakref")
_running: list[str] = []  # "command" while one runs, "patient" while it must not be ended at once
_begun: list[bool] = []


def begin() -> None:
    """Take the signals that ask this process to end; it is a command's own, and has done nothing yet."""
    if _begun or threading.current_thread() is not threading.main_thread():
        return
    _begun.append(True)
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    for number in numbers:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):  # else somebody wants it ignored, as nohup
            signal.signal(number, _answer)
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)  # the thread keeps that: what the main one blocks, waits
    threading.Thread(target=_wait, args=(reading,), daemon=True).start()
    signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def command_running() -> Iterator[None]:
    """Let signals raise KeyboardInterrupt while the block runs, instead of ending the process there and then."""
    _running.append("command")
    try:
        yield
    finally:
        _running.remove("command")


@contextmanager
def patient() -> Iterator[None]:
    """Never end the process at once while the block runs: it has something to stop first, however long that takes."""
    _running.append("patient")
    try:
        yield
    finally:
        _running.remove("patient")


@contextmanager
def interruption_held() -> Iterator[None]:
    """Let Ctrl-C wait until the block has ended: for short work with code that an interruption leaves in knots.

    A zip archive interrupted while it is written raises another error when it is closed, or swallows the interruption when it
    is thrown away.
    """
    asked = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(asked):
        yield
        return
    came: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _frame: came.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, asked)
    if came:
        asked(came[0], None)


def end(text: str = "shoal: interrupted\n") -> None:
    """End the process and its workers now, with exit code 130 and one line; remove what is half-written."""
    workers = sys.modules.get("multiprocessing")
    for worker in workers.active_children() if workers else ():
        worker.terminate()
    for path in list(half_written):
        try:
            path.unlink(missing_ok=True)
        except OSError:
            continue
    try:
        os.write(2, text.encode())
    finally:
        os._exit(130)


def _answer(_number: int, frame: FrameType | None) -> None:
    if not _running or ("patient" not in _running and _in_knots(frame)):
        end()
    raise KeyboardInterrupt


def _in_knots(frame: FrameType | None) -> bool:
    """Tell whether a frame lies where an interruption is swallowed or told as another error: in imports, compiler, callbacks."""
    while frame is not None:
        if str(frame.f_globals.get("__name__")).startswith(_KNOTS):
            return True
        frame = frame.f_back
    return False


def _wait(reading: int) -> None:
    while os.read(reading, 1)[0] not in {signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGHUP", 0)}:
        continue
    time.sleep(GRACE)
    while "patient" in _running:
        time.sleep(0.05)
    end()
