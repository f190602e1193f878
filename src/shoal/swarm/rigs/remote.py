"""A remote rig over an unreliable connection. The connection may be lost, and may damage messages."""

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
"""Function that is called with connection events ("cut", "reconnected", "damaged" or "resent") and their details."""
REPEAT_AFTER, END_AFTER = 5.0, 60.0  # seconds
FIRST_PAUSE, LONGEST_PAUSE = 0.02, 1.0  # seconds between two attempts to reconnect
STOP_EVERY = 0.5  # seconds between two stop commands until the rig confirms one


@dataclass
class LinkCounts:
    """Statistics of a connection.

    Parameters
    ----------
    requests, resent : int
        Number of requests, and number of repeated requests.
    damaged : int
        Number of lines with a wrong checksum, as received by Shoal or reported by the rig.
    reconnects : int
        Number of reconnections after a lost connection.
    """

    requests: int = 0
    resent: int = 0
    damaged: int = 0
    reconnects: int = 0


class RemoteRig:
    """A rig that uses the protocol of `shoal.swarm.rigs.messages` over a connection.

    Requests are numbered. An unanswered request is repeated under the same number. After ``end_after`` seconds of silence an error
    is raised. A lost connection is opened again, and the session continues. A rig carries out each request number only once.

    Parameters
    ----------
    transport : Transport
    repeat_after : float
        Seconds to wait for an answer before the request is repeated.
    end_after : float
        Seconds without an answer after which the rig counts as lost. The time without a connection is included.
    on_event : callable, optional
        Function that is called with connection events.
    session : str, optional
        Session identifier. The default is a random word.

    Raises
    ------
    RigError
        If the rig does not answer or uses another protocol version.

    Notes
    -----
    The object is a context manager that closes the connection at the end. Only `stop` stops the rig.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        repeat_after: float = REPEAT_AFTER,
        end_after: float = END_AFTER,
        on_event: OnEvent | None = None,
        session: str | None = None,
    ) -> None:
        self.transport = transport
        self.repeat_after = check_number(repeat_after, what="repeat_after", above=0)
        self.end_after = check_number(end_after, what="end_after", above=0)
        self.on_event: OnEvent = on_event or (lambda _what, _details: None)
        self.counts = LinkCounts()
        self._session, self._seq = session or secrets.token_hex(8), 0
        self._heard = time.monotonic()
        self._welcome = self._connect(new=True)

    @property
    def name(self) -> str:
        """The rig's own name."""
        return self._welcome.name

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the rig's field of view in cells."""
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
        """Send one command, and wait until the rig has carried it out.

        Raises
        ------
        InvalidInputError
            If the letter is not a command.
        RigError
            If the rig does not answer or refuses the command.
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
            If the rig does not answer, or its answer has invalid cells.
        """
        self._seq += 1
        answer = self._ask(Observe(seq=self._seq), Positions)
        try:
            return check_cells(answer.cells, self.shape, what=f"{self.transport.name}: positions")
        except InvalidInputError as error:
            raise RigError(str(error)) from None

    def stop(self) -> None:
        """Stop the rig, even after an error. The request to stop is repeated until the rig confirms the stop.

        Raises
        ------
        RigError
            If the rig does not confirm the stop within ``end_after`` seconds.
        """
        until, pause = time.monotonic() + self.end_after, FIRST_PAUSE
        while time.monotonic() < until:
            try:
                self.transport.write(
                    b"\n" + encode_message(Stop())
                )  # the newline ends a line that an interruption may have left incomplete
                if self._stopped(min(STOP_EVERY, self.repeat_after)):
                    return
            except ConnectionCutError:
                pause = self._reopen(pause)
        raise RigError(f"{self.transport.name}: the rig has not confirmed the stop command within {self.end_after:g} s")

    def _messages(self, timeout: float) -> Iterator[Message | None]:
        """Yield the messages that arrive in time, and None for each damaged message.

        Raises
        ------
        RigError
            If an undamaged line is not a message of the protocol.
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
        """Wait until the rig confirms the stop. Return False if the stop must be repeated. Other messages are ignored."""
        try:
            for message in self._messages(timeout):
                if isinstance(message, Stopped | Again):
                    return isinstance(message, Stopped)
        except RigError:
            pass
        return False

    def _ask(self, request: Command | Observe, kind: type[Any]) -> Any:
        """Send a request and repeat it until the rig answers."""
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
            self._check_silence()
            self.counts.resent += 1
            self.on_event("resent", {"seq": request.seq})

    def _answer(self, seq: int) -> Any:
        """Return the answer to a request, or None if the request must be repeated."""
        for message in self._messages(self.repeat_after):
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
            raise RigError(f"{self.transport.name}: the rig refuses the request: {message.text[:200]}")

    def _check_silence(self, why: str = "") -> None:
        if time.monotonic() - self._heard > self.end_after:
            raise RigError(f"{self.transport.name}: no answer from the rig for {self.end_after:g} s{f' ({why})' if why else ''}")

    def _reconnect(self, why: str) -> None:
        self.on_event("cut", {"seq": self._seq, "why": why[:200]})
        self.transport.close()
        self._connect(new=False)
        self.counts.reconnects += 1
        self.on_event("reconnected", {"seq": self._seq})

    def _reopen(self, pause: float) -> float:
        """Wait, try once to open the connection again, and return the next waiting time."""
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
            self._check_silence(why)
            time.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    def _greet(self) -> Welcome | None:
        """Say hello. Return the answer, or None on timeout."""
        for _ in range(3):
            self.transport.write(b"\n" + encode_message(Hello(session=self._session)))
            for message in self._messages(self.repeat_after):
                if message is None or isinstance(message, Again):
                    break
                self._check_refusal(message, None)
                if isinstance(message, Welcome):
                    return message
        return None

    def _accepted(self, welcome: Welcome, *, new: bool) -> Welcome:
        """Check that the answer comes from the expected rig and session."""
        if welcome.protocol != PROTOCOL:
            raise RigError(f"{self.transport.name}: expected a rig that speaks protocol {PROTOCOL}, got {welcome.protocol}")
        if welcome.rule not in RULES or int(np.prod(welcome.shape, dtype=object)) > MAX_CELLS:
            raise RigError(
                f"{self.transport.name}: expected a rule out of {', '.join(RULES)} and at most {MAX_CELLS} cells, "
                f"got {welcome.rule!r} and {tuple(welcome.shape)}"
            )
        if new:
            if welcome.seq != 0 or welcome.session != self._session:
                raise RigError(f"{self.transport.name}: expected a new session, got a session with {welcome.seq} requests")
        elif welcome.session != self._session or welcome.seq not in {self._seq - 1, self._seq}:
            raise RigError(
                f"{self.transport.name}: expected the rig to continue at request {self._seq}, got {welcome.seq}: the rig has "
                "restarted, and the effect of the last command is unknown"
            )
        return welcome


def open_rig(
    spec: str, *, repeat_after: float = REPEAT_AFTER, end_after: float = END_AFTER, on_event: OnEvent | None = None
) -> RemoteRig:
    """Connect to the rig that the text ``spec`` names.

    Parameters
    ----------
    spec : str
        ``serial:/dev/ttyUSB0``, ``tcp:HOST:PORT``, or ``exec:COMMAND``. A serial line has 115200 baud. The spec may end with
        another speed, as in ``serial:/dev/ttyUSB0@9600``. A command is a program that uses the protocol on its standard input and
        output.
    repeat_after, end_after, on_event
        Options of `RemoteRig`.

    Raises
    ------
    InvalidInputError
        If the spec has none of these forms.
    MissingExtraError
        If pyserial is not installed (``pip install 'shoal[serial]'``) and the rig is on a serial line.
    RigError
        If the rig does not answer, or uses another protocol version.
    """
    return RemoteRig(open_transport(spec), repeat_after=repeat_after, end_after=end_after, on_event=on_event)
