"""Comparisons that take long: how far they are, and the best so far after Ctrl-C."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from threading import Event
from typing import TypeVar

from shoal.core.interruption import patient, stop_on_interruption
from shoal.core.notices import tell_once

One = TypeVar("One")
_EVERY = 4.0  # seconds between two words about progress


class _Comparison:
    """What all comparisons of one command share: who hears of them, and whether they go on."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self.say, self.stop, self.ended = say, Event(), False
        self.told = time.monotonic()


_present: ContextVar[_Comparison | None] = ContextVar("present", default=None)


@contextmanager
def stoppable_comparisons(say: Callable[[str], None]) -> Iterator[None]:
    """Tell ``say`` how far comparisons inside the ``with`` block are and, after a first Ctrl-C,
    take the best of what they have compared so far.

    Before there is anything to take, and outside comparisons, Ctrl-C ends the command as usual. A
    second Ctrl-C ends it, too.
    """
    token = _present.set(_Comparison(say))
    try:
        yield
    finally:
        _present.reset(token)


@contextmanager
def one_by_one(choices: Sequence[One], what: str) -> Iterator[Iterator[One]]:
    """Give the choices of a comparison to the ``with`` block, one after another: all or, after
    Ctrl-C, those up to then, but always the first.

    Parameters
    ----------
    choices : sequence
    what : str
        What is compared, in the plural, for messages.
    """
    with ExitStack() as stack:
        yield _each(choices, what, stack)


def _each(choices: Sequence[One], what: str, stack: ExitStack) -> Iterator[One]:
    comparison = _present.get()
    for number, choice in enumerate(choices):
        if comparison is not None and number:
            if number == 1:
                stack.enter_context(patient())
                stack.enter_context(stop_on_interruption(comparison.stop, goes_on=True))
            if comparison.stop.is_set():
                if not comparison.ended:  # what follows takes its first choices
                    tell_once(
                        f"plan: interrupted: the best of {number} {what}, of {len(choices)} to"
                        " compare"
                    )
                comparison.ended = True
                return
            now = time.monotonic()
            if now - comparison.told > _EVERY:
                comparison.told = now
                comparison.say(
                    f"{number} of {len(choices)} {what} are compared; Ctrl-C takes the best so far"
                )
        yield choice
