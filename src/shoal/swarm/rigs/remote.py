"""A rig behind a line that may be cut and may damage messages."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.errors import InvalidInputError, RigError
from shoal.swarm.grid.commands import RULES, letters_of
from shoal.swarm.maps.reading import MAX_CELLS
from shoal.swarm.rigs.messages import (
    PROTOCOL,
    Again,
    Command,
    Done,
    Hello,
    Message,
    Observe,
    Positions,
    Refusal,
    Stop,
    Stopped,
    Welcome,
    seal,
    unseal,
)
from shoal.swarm.rigs.protocol import PATIENCE, TIMEOUT, check_cells
from shoal.swarm.rigs.transports import Line, LineCutError

OnEvent = Callable[[str, dict[str, Any]], None]
"""Called with what has happened on the line, "cut", "reconnected", "damaged" or "resent", and details."""
FIRST_PAUSE, LONGEST_PAUSE = 0.02, 1.0  # seconds between attempts to open a line again
STOP_EVERY = 0.5  # seconds between two stop commands that nobody has confirmed


@dataclass
class LinkCounts:
    """What happened on a line so far.

    Parameters
    ----------
    requests, resent : int
        Requests, and how often one was sent again.
    damaged : int
        Lines that came with a wrong checksum, and those of which the rig said so.
    reconnects : int
        How often the line was taken up again after a cut.
    """

    requests: int = 0
    resent: int = 0
    damaged: int = 0
    reconnects: int = 0


class RemoteRig:
    """A rig that speaks the protocol of `shoal.swarm.rigs.messages` over a line.

    Requests are numbered. One that is not answered is sent again, under the same number, until ``patience`` seconds have gone
    by without any answer; a line that is cut is opened again and the session taken up. A rig carries out no number twice.

    Parameters
    ----------
    line : Line
    timeout : float
        Seconds to wait for an answer.
    patience : float
        Seconds without an answer, cuts included, after which the rig is given up.
    on_event : callable, optional
        Told what happens on the line.
    session : str, optional
        By default a random word.

    Raises
    ------
    RigError
        If the rig does not answer or speaks another version.

    Notes
    -----
    It is a context manager: at its end the line is closed. That stops nothing: `stop` does.
    """

    def __init__(
        self,
        line: Line,
        *,
        timeout: float = TIMEOUT,
        patience: float = PATIENCE,
        on_event: OnEvent | None = None,
        session: str | None = None,
    ) -> None:
        for name, value in (("timeout", timeout), ("patience", patience)):
            if not (isfinite(value) and value > 0):
                raise InvalidInputError(f"{name}: expected seconds above 0, got {value:g}")
        self.line, self.timeout, self.patience = line, timeout, patience
        self.on_event: OnEvent = on_event or (lambda _what, _details: None)
        self.counts = LinkCounts()
        self._session, self._seq = session or secrets.token_hex(8), 0
        self._heard = time.monotonic()
        self._welcome = self._connect(new=True)

    @property
    def name(self) -> str:
        """What the rig calls itself."""
        return self._welcome.name

    @property
    def shape(self) -> tuple[int, ...]:
        """The cells that the rig can see."""
        return tuple(self._welcome.shape)

    @property
    def rule(self) -> str:
        """The rig's move rule."""
        return self._welcome.rule

    def __enter__(self) -> RemoteRig:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the line."""
        self.line.close()

    def send(self, command: str) -> None:
        """Have the rig carry out one command, and wait until it has.

        Raises
        ------
        InvalidInputError
            If it is no command.
        RigError
            If the rig does not answer or refuses.
        """
        if len(command) != 1 or command not in letters_of(len(self.shape)):
            raise InvalidInputError(f"expected one command out of {letters_of(len(self.shape))!r}, got {command!r}")
        self._seq += 1
        self._ask(Command(seq=self._seq, command=command), Done)

    def observe(self) -> NDArray[np.int64]:
        """Return the cells of the particles; int64, shape (n, ndim).

        Raises
        ------
        RigError
            If the rig does not answer or tells what are no cells.
        """
        self._seq += 1
        answer = self._ask(Observe(seq=self._seq), Positions)
        try:
            return check_cells(answer.cells, self.shape, what=f"{self.line.name}: positions")
        except InvalidInputError as error:
            raise RigError(str(error)) from None

    def stop(self) -> None:
        """Stop the rig, whatever else is going on; sent again until the rig confirms it.

        Raises
        ------
        RigError
            If it does not within ``patience`` seconds.
        """
        until, pause = time.monotonic() + self.patience, FIRST_PAUSE
        while time.monotonic() < until:
            try:
                self.line.write(b"\n" + seal(Stop()))  # the newline ends what an interruption may have left half-written
                if self._stopped(min(STOP_EVERY, self.timeout)):
                    return
            except LineCutError:
                pause = self._reopen(pause)
        raise RigError(f"{self.line.name}: the rig has not confirmed the stop command within {self.patience:g} s")

    def _stopped(self, timeout: float) -> bool:
        until = time.monotonic() + timeout
        while (left := until - time.monotonic()) > 0:
            line = self.line.read(left)
            message = _message_of(line) if line else None
            if isinstance(message, Stopped):
                return True
            if isinstance(message, Again):
                return False
        return False

    def _ask(self, request: Command | Observe, kind: type[Any]) -> Any:
        """Send a request until it is answered."""
        self.counts.requests += 1
        self._heard = time.monotonic()
        while True:
            try:
                self.line.write(seal(request))
                answer = self._answer(request.seq, self.timeout)
            except LineCutError as error:
                self._reconnect(str(error))
                answer = None
            if isinstance(answer, kind):
                return answer
            if answer is not None:
                raise RigError(f"{self.line.name}: expected the answer {kind.__name__.lower()!r}, got {answer.type!r}")
            self._check_patience()
            self.counts.resent += 1
            self.on_event("resent", {"seq": request.seq})

    def _answer(self, seq: int, timeout: float) -> Any:
        """Return the answer to a request, None if it is to be sent again."""
        until = time.monotonic() + timeout
        while (left := until - time.monotonic()) > 0:
            line = self.line.read(left)
            if line is None:
                return None
            if not line.strip():
                continue
            message = self._checked(line)
            if message is None or isinstance(message, Again):
                self.counts.damaged += 1
                self.on_event("damaged", {"seq": seq, "by": "rig" if message is None else "us"})
                return None
            if isinstance(message, Refusal) and message.seq in {None, seq}:
                raise RigError(f"{self.line.name}: the rig refuses: {message.text[:200]}")
            if getattr(message, "seq", None) == seq and not isinstance(message, Welcome):
                self._heard = time.monotonic()
                return message
        return None

    def _checked(self, line: bytes) -> Message | None:
        try:
            return unseal(line)
        except InvalidInputError as error:
            raise RigError(f"{self.line.name}: {error}") from None

    def _check_patience(self, why: str = "") -> None:
        if time.monotonic() - self._heard > self.patience:
            raise RigError(f"{self.line.name}: no answer from the rig for {self.patience:g} s{f' ({why})' if why else ''}")

    def _reconnect(self, why: str) -> None:
        self.on_event("cut", {"seq": self._seq, "why": why[:200]})
        self.line.close()
        self._connect(new=False)
        self.counts.reconnects += 1
        self.on_event("reconnected", {"seq": self._seq})

    def _reopen(self, pause: float) -> float:
        """Try once to open the line again after a pause; return the next pause."""
        self.line.close()
        time.sleep(pause)
        try:
            self.line.open()
        except LineCutError:
            return min(2 * pause, LONGEST_PAUSE)
        return FIRST_PAUSE

    def _connect(self, *, new: bool) -> Welcome:
        """Open the line and say hello until the rig answers."""
        pause = FIRST_PAUSE
        while True:
            why = ""
            try:
                self.line.open()
                welcome = self._greet()
                if welcome is not None:
                    return self._accepted(welcome, new=new)
            except LineCutError as error:
                why = str(error)
            except BaseException:
                self.line.close()
                raise
            self.line.close()
            self._check_patience(why)
            time.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    def _greet(self) -> Welcome | None:
        """Say hello; return the answer, None if none comes in time."""
        for _ in range(3):
            self.line.write(b"\n" + seal(Hello(session=self._session)))
            until = time.monotonic() + self.timeout
            while (left := until - time.monotonic()) > 0:
                line = self.line.read(left)
                message = self._checked(line) if line and line.strip() else None
                if isinstance(message, Welcome):
                    return message
                if isinstance(message, Refusal):
                    raise RigError(f"{self.line.name}: the rig refuses: {message.text[:200]}")
                if isinstance(message, Again) or (line and line.strip() and message is None):
                    break
        return None

    def _accepted(self, welcome: Welcome, *, new: bool) -> Welcome:
        """Check that this is the rig, and the session, that we know."""
        if welcome.protocol != PROTOCOL:
            raise RigError(f"{self.line.name}: expected a rig that speaks protocol {PROTOCOL}, got {welcome.protocol}")
        if welcome.rule not in RULES or int(np.prod(welcome.shape, dtype=object)) > MAX_CELLS:
            raise RigError(
                f"{self.line.name}: expected a rule out of {', '.join(RULES)} and at most {MAX_CELLS} cells, "
                f"got {welcome.rule!r} and {tuple(welcome.shape)}"
            )
        if new:
            if welcome.seq != 0 or welcome.session != self._session:
                raise RigError(f"{self.line.name}: expected a new session, got one with {welcome.seq} requests")
        elif welcome.session != self._session or welcome.seq not in {self._seq - 1, self._seq}:
            raise RigError(
                f"{self.line.name}: expected the rig to go on at request {self._seq}, got {welcome.seq}: "
                "it has been started anew, and what it did with the last command is not known"
            )
        return welcome


def _message_of(line: bytes) -> Message | None:
    """Return a message, None for anything else: while stopping nothing is worth an error."""
    try:
        return unseal(line)
    except InvalidInputError:
        return None
