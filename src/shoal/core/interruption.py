"""How a command ends after Ctrl-C, after SIGTERM, or after its terminal is closed.

While the modules of a command are loading, a signal ends the command at once. Later, a signal raises KeyboardInterrupt, so that
the command can clean up. Compiled code can delay a KeyboardInterrupt for minutes, because Python handles signals only between its
own instructions. Therefore a thread also waits for signals and ends the command shortly after a signal.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from contextlib import contextmanager

TYPE_CHECKING = False
if TYPE_CHECKING:  # a command imports this module first, so this module imports no others
    from collections.abc import Iterator
    from pathlib import Path
    from types import FrameType

GRACE = 0.7
"""Seconds between a signal and the forced end of a command."""

half_written: set[Path] = set()
"""Files to remove if the command is ended at once."""

_KNOTS = ("importlib._bootstrap", "numba.", "llvmlite.", "shoal.jit.", "weakref")
_running: list[str] = []  # "command" while a command runs, "patient" while the process must not be ended at once
_begun: list[bool] = []


def begin() -> None:
    """Start handling the signals that end a process. Call this function at the start of a command."""
    if _begun or threading.current_thread() is not threading.main_thread():
        return
    _begun.append(True)
    numbers = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    for number in numbers:
        # otherwise the signal is ignored on purpose, as with nohup
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, _answer)
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    # the thread inherits this mask: signals blocked in the main thread wait for the thread
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    threading.Thread(target=_wait, args=(reading,), daemon=True).start()
    signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def command_running() -> Iterator[None]:
    """Let signals raise KeyboardInterrupt inside the block, instead of ending the process at once."""
    _running.append("command")
    try:
        yield
    finally:
        _running.remove("command")


@contextmanager
def patient() -> Iterator[None]:
    """Prevent a forced end of the process while the block stops other processes or hardware."""
    _running.append("patient")
    try:
        yield
    finally:
        _running.remove("patient")


@contextmanager
def interruption_held() -> Iterator[None]:
    """Delay Ctrl-C until the block has ended. Use this block for short calls of libraries that do not survive an interruption.

    For example, an interrupted write of a zip archive raises an unrelated error when the archive is closed, or loses the Ctrl-C.
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
    """End the process and its workers now: print one line, exit with code 130, and remove partial files."""
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
    """Return whether a frame runs code that hides a KeyboardInterrupt: an import, the compiler or a callback."""
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
