"""The end of a command after Ctrl-C, after SIGTERM, or after the user closes the terminal.

While the modules of a command are loading, a signal ends the command at once. After loading, a
signal raises KeyboardInterrupt, so that the command can clean up. A second thread waits for signals
and ends the command soon after a signal, because compiled code can delay a KeyboardInterrupt for
minutes.
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
    from threading import Event
    from types import FrameType

GRACE = 0.7
"""Time between a signal and the forced end of a command, in seconds."""

half_written: set[Path] = set()
"""Unfinished files to remove at the forced end of a command."""

error_streams = [2]
"""File descriptors of stderr. The last one is in use: the descriptor 2 itself, or a copy while 2 leads
elsewhere.
"""

_KNOTS = ("importlib._bootstrap", "numba.", "llvmlite.", "shoal.jit.", "weakref")
_running: list[
    str
] = []  # "command" while a command runs, "patient" while the process must not be ended at once
_begun: list[bool] = []
_answered: list[int] = []  # signals after which the command goes on


def begin() -> None:
    """Start handling the signals that end a process. Every command of Shoal calls `begin` first."""
    if _begun or threading.current_thread() is not threading.main_thread():
        return
    _begun.append(True)
    numbers = [
        getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
    ]
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
    """Let signals raise KeyboardInterrupt inside the ``with`` block.

    Outside the ``with`` block, a signal ends the process at once.
    """
    _running.append("command")
    try:
        yield
    finally:
        _running.remove("command")


@contextmanager
def patient() -> Iterator[None]:
    """Prevent the forced end of the process inside the ``with`` block, for example while the block
    stops hardware.
    """
    _running.append("patient")
    try:
        yield
    finally:
        _running.remove("patient")


@contextmanager
def interruption_held() -> Iterator[None]:
    """Delay Ctrl-C until the ``with`` block has ended. The block should be a short library call
    that must not be interrupted.

    An example is the writing of a zip archive: Ctrl-C may be lost, or may cause an unrelated error
    when the archive is closed.
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


@contextmanager
def stop_on_interruption(stop: Event, *, goes_on: bool = False) -> Iterator[None]:
    """Let the first Ctrl-C inside the ``with`` block set ``stop`` instead of raising
    KeyboardInterrupt at an arbitrary place.

    The block then ends its work in good order. A second Ctrl-C has its usual effect. The other
    signals that a command of Shoal handles set ``stop``, too. If ``goes_on`` is true, the command
    goes on after the block; the block must then be `patient`, so that the command is not ended
    meanwhile.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [
        signal.SIGINT,
        *(getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)),
    ]
    asked = {number: handler for number in numbers if callable(handler := signal.getsignal(number))}

    def note(number: int, frame: FrameType | None) -> None:
        if stop.is_set():
            asked[signal.Signals(number)](number, frame)
        elif goes_on:
            _answered.append(number)
        stop.set()

    for number in asked:
        signal.signal(number, note)
    try:
        yield
    finally:
        for number, handler in asked.items():
            signal.signal(number, handler)


def end(text: str = "shoal: interrupted\n") -> None:
    """End the process and its worker processes now: remove partial files, print ``text`` on stderr,
    and exit with code 130.
    """
    workers = sys.modules.get("multiprocessing")
    for worker in workers.active_children() if workers else ():
        worker.terminate()
    for path in list(half_written):
        try:
            path.unlink(missing_ok=True)
        except OSError:
            continue
    try:
        os.write(error_streams[-1], text.encode())
    finally:
        os._exit(130)


def _answer(_number: int, frame: FrameType | None) -> None:
    if not _running or ("patient" not in _running and _in_knots(frame)):
        end()
    raise KeyboardInterrupt


def _in_knots(frame: FrameType | None) -> bool:
    """Return whether code that hides a KeyboardInterrupt is running: an import, the compiler, or a
    weak reference's callback.
    """
    while frame is not None:
        if str(frame.f_globals.get("__name__")).startswith(_KNOTS):
            return True
        frame = frame.f_back
    return False


def _wait(reading: int) -> None:
    while True:
        while os.read(reading, 1)[0] not in {
            signal.SIGINT,
            signal.SIGTERM,
            getattr(signal, "SIGHUP", 0),
        }:
            continue
        time.sleep(GRACE)
        while "patient" in _running:
            time.sleep(0.05)
        if not _answered:
            end()
        _answered.pop()
