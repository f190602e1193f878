"""A rig behind a connection that may be cut and may damage messages."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_number
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, RigError
from shoal.swarm.grid.commands import RULES, letters_of
from shoal.swarm.grid.state import check_cells
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
    decode_message,
    encode_message,
)
from shoal.swarm.rigs.transports import ConnectionCutError, Transport, open_transport

OnEvent = Callable[[str, dict[str, Any]], None]
"""Called with what has happened on the connection, "cut", "reconnected", "damaged" or "resent", and details."""
TIMEOUT, PATIENCE = 5.0, 60.0  # seconds
FIRST_PAUSE, LONGEST_PAUSE = 0.02, 1.0  # seconds between attempts to open a connection again
STOP_EVERY = 0.5  # seconds between two stop commands until one is confirmed


@dataclass
class LinkCounts:
    """What happened on a connection so far.

    Parameters
    ----------
    requests, resent : int
        Requests, and how often one was sent again.
    damaged : int
        Lines that came with a wrong checksum, and those of which the rig said so.
    reconnects : int
        How often the connection was taken up again after a cut.
    """

    requests: int = 0
    resent: int = 0
    damaged: int = 0
    reconnects: int = 0


class RemoteRig:
    """A rig that speaks the protocol of `shoal.swarm.rigs.messages` over a connection.

    Requests are numbered. One that is not answered is sent again, under the same number, until ``patience`` seconds have gone
    by without any answer; a connection that is cut is opened again and the session taken up. A rig carries out no number twice.

    Parameters
    ----------
    transport : Transport
    timeout : float
        Seconds to wait for an answer.
    patience : float
        Seconds without an answer, cuts included, after which the rig is given up.
    on_event : callable, optional
        Told what happens on the connection.
    session : str, optional
        By default a random word.

    Raises
    ------
    RigError
        If the rig does not answer or speaks another version.

    Notes
    -----
    It is a context manager: at its end the connection is closed. That stops nothing: `stop` does.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        timeout: float = TIMEOUT,
        patience: float = PATIENCE,
        on_event: OnEvent | None = None,
        session: str | None = None,
    ) -> None:
        self.transport = transport
        self.timeout = check_number(timeout, what="timeout", above=0)
        self.patience = check_number(patience, what="patience", above=0)
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
        """Close the connection."""
        self.transport.close()

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
            return check_cells(answer.cells, self.shape, what=f"{self.transport.name}: positions")
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
                self.transport.write(
                    b"\n" + encode_message(Stop())
                )  # the newline ends what an interruption may have left half-written
                if self._stopped(min(STOP_EVERY, self.timeout)):
                    return
            except ConnectionCutError:
                pause = self._reopen(pause)
        raise RigError(f"{self.transport.name}: the rig has not confirmed the stop command within {self.patience:g} s")

    def _messages(self, timeout: float) -> Iterator[Message | None]:
        """Yield the messages that come within some seconds; None for a damaged one.

        Raises
        ------
        RigError
            If one is whole and yet none of the protocol.
        """
        until = time.monotonic() + timeout
        while (left := until - time.monotonic()) > 0:
            line = self.transport.read(left)
            if line is None:
                return
            if line.strip():
                try:
                    yield decode_message(line)
                except InvalidInputError as error:
                    raise RigError(f"{self.transport.name}: {error}") from None

    def _stopped(self, timeout: float) -> bool:
        """Wait until the rig confirms the stop; return False to ask again. Nothing else that it says is worth an error now."""
        try:
            for message in self._messages(timeout):
                if isinstance(message, Stopped | Again):
                    return isinstance(message, Stopped)
        except RigError:
            pass
        return False

    def _ask(self, request: Command | Observe, kind: type[Any]) -> Any:
        """Send a request until it is answered."""
        self.counts.requests += 1
        self._heard = time.monotonic()
        while True:
            try:
                self.transport.write(encode_message(request))
                answer = self._answer(request.seq)
            except ConnectionCutError as error:
                self._reconnect(str(error))
                answer = None
            if isinstance(answer, kind):
                return answer
            if answer is not None:
                raise RigError(f"{self.transport.name}: expected the answer {kind.__name__.lower()!r}, got {answer.type!r}")
            self._check_patience()
            self.counts.resent += 1
            self.on_event("resent", {"seq": request.seq})

    def _answer(self, seq: int) -> Any:
        """Return the answer to a request, None if it is to be sent again."""
        for message in self._messages(self.timeout):
            if message is None or isinstance(message, Again):
                self.counts.damaged += 1
                self.on_event("damaged", {"seq": seq, "by": "rig" if message is None else "us"})
                return None
            self._check_refusal(message, seq)
            if getattr(message, "seq", None) == seq and not isinstance(message, Welcome):
                self._heard = time.monotonic()
                return message
        return None

    def _check_refusal(self, message: Message, seq: int | None) -> None:
        if isinstance(message, Refusal) and (seq is None or message.seq in {None, seq}):
            raise RigError(f"{self.transport.name}: the rig refuses: {message.text[:200]}")

    def _check_patience(self, why: str = "") -> None:
        if time.monotonic() - self._heard > self.patience:
            raise RigError(f"{self.transport.name}: no answer from the rig for {self.patience:g} s{f' ({why})' if why else ''}")

    def _reconnect(self, why: str) -> None:
        self.on_event("cut", {"seq": self._seq, "why": why[:200]})
        self.transport.close()
        self._connect(new=False)
        self.counts.reconnects += 1
        self.on_event("reconnected", {"seq": self._seq})

    def _reopen(self, pause: float) -> float:
        """Try once to open the connection again after a pause; return the next pause."""
        self.transport.close()
        time.sleep(pause)
        try:
            self.transport.open()
        except ConnectionCutError:
            return min(2 * pause, LONGEST_PAUSE)
        return FIRST_PAUSE

    def _connect(self, *, new: bool) -> Welcome:
        """Open the connection and say hello until the rig answers."""
        pause = FIRST_PAUSE
        while True:
            why = ""
            try:
                self.transport.open()
                welcome = self._greet()
                if welcome is not None:
                    return self._accepted(welcome, new=new)
            except ConnectionCutError as error:
                why = str(error)
            except BaseException:
                self.transport.close()
                raise
            self.transport.close()
            self._check_patience(why)
            time.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    def _greet(self) -> Welcome | None:
        """Say hello; return the answer, None if none comes in time."""
        for _ in range(3):
            self.transport.write(b"\n" + encode_message(Hello(session=self._session)))
            for message in self._messages(self.timeout):
                if message is None or isinstance(message, Again):
                    break
                self._check_refusal(message, None)
                if isinstance(message, Welcome):
                    return message
        return None

    def _accepted(self, welcome: Welcome, *, new: bool) -> Welcome:
        """Check that this is the rig, and the session, that we know."""
        if welcome.protocol != PROTOCOL:
            raise RigError(f"{self.transport.name}: expected a rig that speaks protocol {PROTOCOL}, got {welcome.protocol}")
        if welcome.rule not in RULES or int(np.prod(welcome.shape, dtype=object)) > MAX_CELLS:
            raise RigError(
                f"{self.transport.name}: expected a rule out of {', '.join(RULES)} and at most {MAX_CELLS} cells, "
                f"got {welcome.rule!r} and {tuple(welcome.shape)}"
            )
        if new:
            if welcome.seq != 0 or welcome.session != self._session:
                raise RigError(f"{self.transport.name}: expected a new session, got one with {welcome.seq} requests")
        elif welcome.session != self._session or welcome.seq not in {self._seq - 1, self._seq}:
            raise RigError(
                f"{self.transport.name}: expected the rig to go on at request {self._seq}, got {welcome.seq}: "
                "it has been started anew, and what it did with the last command is not known"
            )
        return welcome


def open_rig(spec: str, *, timeout: float = TIMEOUT, patience: float = PATIENCE, on_event: OnEvent | None = None) -> RemoteRig:
    """Connect to the rig that ``spec`` names.

    Parameters
    ----------
    spec : str
        ``serial:/dev/ttyUSB0`` (``serial:/dev/ttyUSB0@9600`` for another speed than 115200), ``tcp:HOST:PORT``, or
        ``exec:COMMAND``: a program that speaks the protocol on its standard input and output.
    timeout : float
        Seconds to wait for an answer before the request is sent again.
    patience : float
        Seconds without any answer after which the rig is given up.
    on_event : callable, optional
        Told what happens on the connection.

    Raises
    ------
    InvalidInputError
        For a spec that is none of these.
    MissingExtraError
        For a serial line without pyserial (``pip install 'shoal[serial]'``).
    RigError
        If the rig does not answer, or speaks another version.
    """
    return RemoteRig(open_transport(spec), timeout=timeout, patience=patience, on_event=on_event)
