"""Pause, take-over and stop of a drive by single keys on a terminal."""

from __future__ import annotations

import os
import queue
import select
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from shoal.cli.output import say
from shoal.core.checks import count_text

HELP = "space pauses, q ends the drive, x stops the rig at once"
PAUSED = "l u r d (in 3-D also i o) send one command, space goes on, q ends, x stops at once"
WAITING = 0.1  # seconds between two looks for a key or for a signal


class Keyboard:
    """The keys that a user presses on a terminal during a drive.

    A thread reads the keys, so that ``q`` and ``x`` act while a command is carried out: they raise
    KeyboardInterrupt in the main thread, as Ctrl-C does, after which the drive stops the rig at
    once.

    Parameters
    ----------
    terminal : int
        File descriptor of the terminal.
    letters : str
        The command letters of the rig.

    Attributes
    ----------
    emergency : bool
        Whether the user has pressed ``x``.
    """

    def __init__(self, terminal: int, letters: str) -> None:
        self.terminal, self.letters = terminal, letters
        self.emergency = False
        self.sent = 0  # commands of the user
        self._keys: queue.Queue[str] = queue.Queue()
        self._pauses = threading.Event()
        self._ends = threading.Event()

    def listen(self) -> None:
        """Read keys until `end` is called. Runs in a thread of its own."""
        while not self._ends.is_set():
            if not select.select([self.terminal], [], [], WAITING)[0]:
                continue
            try:
                pressed = os.read(self.terminal, 64).decode("ascii", "replace")
            except OSError:
                return
            if not pressed:  # the terminal was closed
                return
            for key in pressed:
                self._press(key)

    def _press(self, key: str) -> None:
        if key in "qx":
            self.emergency = self.emergency or key == "x"
            os.kill(os.getpid(), signal.SIGINT)
        elif key in " p" and not self._pauses.is_set():
            self._pauses.set()
        else:
            self._keys.put(key)

    def end(self) -> None:
        """Let the thread end."""
        self._ends.set()

    def rest(self, moves: int, send: Callable[[str], None]) -> None:
        """If the user wants a pause, wait until the user ends it, and send the user's commands."""
        if not self._pauses.is_set():
            if not self._keys.empty():
                self._keys = queue.Queue()
                say(f"shoal: {HELP}")
            return
        say(f"shoal: paused after {count_text(moves, 'move')}: {PAUSED}")
        while True:
            try:
                key = self._keys.get(timeout=WAITING)
            except queue.Empty:
                continue
            if key in " p":
                self._pauses.clear()
                say("shoal: the drive goes on")
                return
            if key in self.letters:
                send(key)
                self.sent += 1
                say(f"shoal: sent {key}")
            elif key.strip():
                say(f"shoal: {PAUSED}")


@contextmanager
def keyboard(letters: str) -> Iterator[Keyboard | None]:
    """Yield the keyboard of the terminal of the standard input while the ``with`` block runs, or None if that is
    no terminal or belongs to another program at the moment.
    """
    try:
        import termios

        terminal = sys.stdin.fileno()
        before: Any = termios.tcgetattr(terminal)
        ours = os.tcgetpgrp(terminal) == os.getpgrp()
    except (ImportError, OSError, ValueError, AttributeError, termios.error):
        ours = False
    if not ours:
        yield None
        return
    keys = Keyboard(terminal, letters)
    single = [*before[:3], before[3] & ~(termios.ICANON | termios.ECHO), *before[4:]]
    single[6] = [*before[6]]
    single[6][termios.VMIN], single[6][termios.VTIME] = 1, 0
    thread = threading.Thread(target=keys.listen, daemon=True)
    termios.tcsetattr(terminal, termios.TCSADRAIN, single)
    try:
        thread.start()
        say(f"shoal: {HELP}")
        yield keys
    finally:
        keys.end()
        with suppress(termios.error):
            termios.tcsetattr(terminal, termios.TCSADRAIN, before)
        thread.join(5 * WAITING)


def stop_until_confirmed(rig: Any) -> bool:
    """Send the stop command until the rig confirms it, or until Ctrl-C. Return whether it has
    confirmed.
    """
    while True:
        say("shoal: the rig has not confirmed the stop command; trying again (Ctrl-C gives up)")
        try:
            rig.stop()
        except KeyboardInterrupt:
            return False
        except Exception as error:
            say(f"shoal: {error}")
            with suppress(KeyboardInterrupt):
                threading.Event().wait(1.0)
                continue
            return False
        return True
