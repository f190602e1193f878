"""A rig behind a connection that may break and may damage messages."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from shoal.core.checks import check_function, check_number, check_points
from shoal.core.dataclass import dataclass
from shoal.core.errors import InvalidInputError, RigError
from shoal.rigs.physics import ANGLES
from shoal.rigs.protocol import (
    PROTOCOL,
    Again,
    Command,
    Done,
    Hello,
    Look,
    Message,
    Observe,
    Points,
    Positions,
    Push,
    Refusal,
    Stop,
    Stopped,
    Welcome,
    decode_message,
    encode_message,
)
from shoal.rigs.rig import LARGEST_VIEW, Frame, PositionError
from shoal.rigs.transports import ConnectionCutError, Transport, open_transport
from shoal.swarm.grid.board import RULES, letters_of
from shoal.swarm.grid.state import check_cells

OnEvent = Callable[[str, dict[str, Any]], None]
"""Function that `RemoteRig` calls for an event and its details: "cut", "reconnected", "damaged",
"resent" or "doubled".
"""
Answer = TypeVar("Answer", Done, Positions, Points)
Request = Command | Observe | Push | Look
REPEAT_AFTER, END_AFTER = 5.0, 60.0  # seconds
FIRST_PAUSE, LONGEST_PAUSE = 0.02, 1.0  # seconds between two attempts to reconnect
MOST_DAMAGED = 100  # damaged lines in a row from which on the other end is no rig
READING = 0.1  # seconds for what a closed connection has brought before its end
STOP_EVERY = 0.5  # seconds between two stop commands until the rig confirms one


@dataclass
class LinkCounts:
    """Statistics of the connection to a remote rig.

    Parameters
    ----------
    requests, resent : int
        ``requests`` is the number of requests, and ``resent`` is the number of repetitions of
        requests.
    damaged : int
        Number of damaged lines (lines with a wrong checksum) that Shoal received or the rig
        reported.
    reconnects : int
        Number of times that Shoal opened a lost connection again.
    doubled : int
        Number of answers that came more than once although Shoal sent the request once.
    """

    requests: int = 0
    resent: int = 0
    damaged: int = 0
    reconnects: int = 0
    doubled: int = 0


@dataclass(frozen=True)
class LoggedSession:
    """The session of a drive as far as its log tells, for a drive that goes on.

    Parameters
    ----------
    session : str
        Identifier of the session.
    command : int
        Number of the request for the last command of the log; 0 without commands.
    last : int
        Number of the last request in the log.
    ended : bool
        Whether Shoal has sent the stop command, after which the rig refuses commands.
    carried_out : int or None
        Number of the last request that the rig had carried out when it stopped, if it said so.
    outcome : bool or None
        False if the last command was not carried out in the session before, and was not repeated
        yet; None if nobody knows; otherwise true.
    """

    session: str
    command: int
    last: int
    ended: bool = False
    carried_out: int | None = None
    outcome: bool | None = True


@dataclass(frozen=True)
class Resumption:
    """What the rig knows of the session that a log tells of.

    Parameters
    ----------
    goes_on : bool
        Whether the session goes on. If not, a new one has begun.
    carried_out : bool or None
        Whether the rig has carried out the last command of the log. None if nobody knows, as the
        rig has forgotten the session.
    lost_command : bool
        Whether the rig has carried out a command of which the log does not tell, because the log
        has lost its last lines.
    """

    goes_on: bool
    carried_out: bool | None
    lost_command: bool = False


class UnexpectedAnswerError(RigError):
    """Raised if a rig answers a request with a message of another kind."""


class RigSession:
    """A session with an apparatus over a connection that may break and may damage messages.

    Shoal numbers its requests, and repeats an unanswered request with an unchanged number. The
    apparatus carries out a request once, even if Shoal repeats the request. After ``end_after``
    seconds without an answer, Shoal raises an error. If the connection is lost, Shoal opens the
    connection again and continues the session. Shoal does not wait for a rig that is gone: a first
    connection that cannot be opened or is closed before the rig has answered, and a program that,
    started anew, ends before it answers. A first connection that is refused may belong to a rig
    that is still starting: Shoal tries for ``repeat_after`` seconds.

    Parameters
    ----------
    transport : Transport
    repeat_after : float
        Time without an answer after which Shoal repeats a request, in seconds.
    end_after : float
        Time without an answer after which the rig counts as lost, in seconds. Time without a
        connection counts as time without an answer.
    on_event : callable, optional
        Function that the object calls with the events of the connection.
    session : str, optional
        Identifier of the session. The default identifier of a session is a random word.
    resume : LoggedSession, optional
        The session of a log, which goes on if the rig still knows it and has not been stopped.
        Otherwise, a new session begins. The attribute ``resumption`` tells which.

    Raises
    ------
    RigError
        Raised if the rig does not answer, or if the rig uses another version of the protocol.

    Notes
    -----
    A session is a context manager that closes the connection at the end of the ``with`` block. Closing
    the connection does not stop the rig. To stop the rig, call `stop`.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        repeat_after: float = REPEAT_AFTER,
        end_after: float = END_AFTER,
        on_event: OnEvent | None = None,
        session: str | None = None,
        resume: LoggedSession | None = None,
    ) -> None:
        check_function(on_event, what="on_event")
        self.transport = transport
        self.repeat_after = check_number(repeat_after, what="repeat_after", above=0)
        self.end_after = check_number(end_after, what="end_after", above=0)
        self.on_event: OnEvent = on_event or (lambda _what, _details: None)
        self.counts = LinkCounts()
        self.session, self._seq = session or secrets.token_hex(8), 0
        self._carried_out = 0  # the last request that the rig has answered
        self._before = ""  # the session before, of which a late welcome may still arrive
        self._repeated = 0  # the last request that was sent more than once
        self._looks = 0  # number of the last picture
        self._damaged: list[bytes] = []  # lines in a row that were damaged, here or at the rig
        self._heard = time.monotonic()
        self.resumption: Resumption | None = None
        self.values: dict[str, float] = {}
        """The newest values that the rig has reported, such as currents, by name."""
        if resume is not None:
            self.resumption = self._resume(resume)
        else:
            self._welcome = self._connect(new=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection to the rig."""
        self.transport.close()

    @property
    def requests(self) -> int:
        """Number of the last request of the session."""
        return self._seq

    def _resume(self, logged: LoggedSession) -> Resumption:
        """Ask the rig what it knows of a session, and go on with it or begin a new one."""
        self.session, self._seq = logged.session, logged.last
        self._welcome = self._connect(new=None)
        last_done = self._welcome.seq
        outcome_known = (
            self._welcome.session == logged.session
            and last_done > 0
            and last_done >= max(logged.last, logged.command) - 1
        )
        number = last_done if outcome_known else logged.carried_out
        carried_out = None if number is None else number >= logged.command
        outcome = carried_out if logged.outcome is True else logged.outcome
        if outcome_known and not logged.ended:
            # a command that was not carried out gets its number again
            self._seq = self._carried_out = last_done
            return Resumption(True, outcome, self._lost_command(logged.last))
        self._before, self.session = self.session, secrets.token_hex(8)
        self._seq = self._carried_out = 0
        self._welcome = self._begin_session()
        return Resumption(False, outcome)

    def _lost_command(self, last: int) -> bool:
        """Whether the rig has carried out a command after the last request of the log. The log tells
        of a command before it is sent, but of a scan only after it has come.
        """
        if self._seq <= last:
            return False
        if self._seq > last + 1:
            return True
        self._seq -= 1  # the rig repeats its last answer, whatever the request
        try:
            self.ask(lambda seq: Observe(seq=seq), Positions)
        except UnexpectedAnswerError:
            return True
        return False

    def _begin_session(self) -> Welcome:
        """Begin a new session over the open connection."""
        try:
            welcome = self._greet()
        except ConnectionCutError:
            welcome = None
        if welcome is None:
            self.transport.close()
            return self._connect(new=True)
        return self._check_welcome(welcome, new=True)

    def ask(self, make: Callable[[int], Request], kind: type[Answer]) -> Answer:
        """Send the request that ``make`` returns for the next number, and repeat it until the rig
        answers with a message of the given kind.

        Raises
        ------
        RigError
            Raised if the rig does not answer, refuses, or answers something else.
        """
        self._seq += 1
        request = make(self._seq)
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
                self._carried_out = request.seq
                self.values |= answer.values or {}
                return answer
            if answer is not None:
                raise UnexpectedAnswerError(
                    f"{self.transport.name}: expected the answer {kind.__name__.lower()!r}, got"
                    f" {answer.type!r}"
                )
            self._check_silence()
            self.counts.resent += 1
            self._repeated = request.seq
            self.on_event("resent", {"seq": request.seq})

    def stop(self) -> None:
        """Stop the rig, even after an error. Repeat the stop request until the rig confirms the
        stop.

        Raises
        ------
        RigError
            Raised if the rig does not confirm the stop within ``end_after`` seconds.
        """
        until, pause, reopened, why = time.monotonic() + self.end_after, FIRST_PAUSE, False, ""
        while time.monotonic() < until:
            try:
                # the newline ends a line that an interruption may have left incomplete
                self.transport.write(b"\n" + encode_message(Stop()))
                if self._await_stop(min(STOP_EVERY, self.repeat_after)):
                    return
            except ConnectionCutError as error:
                if reopened and not self.transport.returns:
                    why = f": {error}"
                    break
                pause, reopened = self._reopen(pause), True
        raise RigError(
            f"{self.transport.name}: the rig has not confirmed the stop command"
            f"{why or f' within {self.end_after:g} s'}"
        )

    def carried_out(self) -> int | None:
        """Return the number of the last request that the rig has carried out, or None if the rig
        does not say.

        Ask after `stop`, if an interruption has left open whether the rig has carried out the last
        request.
        """
        if self._carried_out == self._seq:
            return self._seq
        try:
            welcome = self._greet(once=True)
        except (ConnectionCutError, RigError):
            return None
        if welcome is None or welcome.session != self.session or welcome.seq < self._seq - 1:
            return None
        return welcome.seq

    def _check_device(self, welcome: Welcome) -> None:
        """Raise RigError if Shoal cannot work with what the rig says about itself."""

    def _messages(self, timeout: float) -> Iterator[Message | None]:
        """Yield the messages that arrive within ``timeout`` seconds, and None for each damaged
        message.

        Raises
        ------
        RigError
            Raised if an undamaged line is not a message of the protocol, or if very many lines in a
            row were damaged, here or at the rig.
        """
        until = time.monotonic() + timeout
        while (remaining := until - time.monotonic()) > 0:
            line = self.transport.read(remaining)
            if line is None:
                return
            if line.strip():
                try:
                    message = decode_message(line)
                except InvalidInputError as error:
                    raise RigError(f"{self.transport.name}: {error}") from None
                whole = not (message is None or isinstance(message, Again))
                self._damaged = [] if whole else [*self._damaged, line.strip()]
                if len(self._damaged) > MOST_DAMAGED:
                    raise RigError(
                        f"{self.transport.name}: {MOST_DAMAGED} lines in a row were damaged:"
                        f" {self._damage_text}"
                    )
                yield message

    @property
    def _damage_text(self) -> str:
        """What was expected and what came instead, for people."""
        return (
            f"expected messages of protocol {PROTOCOL}, got"
            f" {self._damaged[-1][:60].decode(errors='replace')!r}"
        )

    def _await_stop(self, timeout: float) -> bool:
        """Wait until the rig confirms the stop. Return False if Shoal must repeat the
        stop request.
        """
        try:
            for message in self._messages(timeout):
                if isinstance(message, Stopped | Again):
                    return isinstance(message, Stopped)
        except RigError:
            pass
        return False

    def _answer(self, seq: int) -> Any:
        """Return the rig's answer to a request, or None if Shoal must repeat the request."""
        for message in self._messages(self.repeat_after):
            if message is None or isinstance(message, Again):
                self.counts.damaged += 1
                self.on_event("damaged", {"seq": seq, "by": "rig" if message is None else "us"})
                return None
            self._check_refusal(message, seq)
            if getattr(message, "seq", None) == seq and not isinstance(message, Welcome):
                self._heard = time.monotonic()
                return message
            if (
                isinstance(message, Done | Positions | Points)
                and self._repeated < message.seq < seq
            ):
                self.counts.doubled += 1
                self.on_event("doubled", {"seq": message.seq})
        return None

    def _check_refusal(self, message: Message, seq: int | None) -> None:
        if isinstance(message, Refusal) and (seq is None or message.seq in {None, seq}):
            raise RigError(
                f"{self.transport.name}: the rig refuses the request: {message.text[:200]}"
            )

    def _check_silence(self, why: str = "") -> None:
        if time.monotonic() - self._heard > self.end_after:
            raise RigError(
                f"{self.transport.name}: no answer from the rig for {self.end_after:g}"
                f" s{f' ({why})' if why else ''}"
            )

    def _reconnect(self, why: str) -> None:
        self.on_event("cut", {"seq": self._seq, "why": why[:200]})
        self.transport.close()
        self._connect(new=False)
        self.counts.reconnects += 1
        self.on_event("reconnected", {"seq": self._seq})

    def _reopen(self, pause: float) -> float:
        """Wait ``pause`` seconds, try once to open the connection again, and return the next
        waiting time in seconds.
        """
        self.transport.close()
        time.sleep(pause)
        try:
            self.transport.open()
        except ConnectionCutError:
            return min(2 * pause, LONGEST_PAUSE)
        return FIRST_PAUSE

    def _connect(self, *, new: bool | None) -> Welcome:
        """Open the connection, and send hello messages until the rig answers. ``new`` is None if
        the rig may know the session or not.
        """
        pause = FIRST_PAUSE
        while True:
            why = ""
            try:
                self.transport.open()
                welcome = self._greet()
                if welcome is not None:
                    return self._check_welcome(welcome, new=new)
            except ConnectionCutError as error:
                why = str(error)
                if self._is_gone(error, new=new):
                    raise self._lost_connection_error(why) from None
            except BaseException:
                self.transport.close()
                raise
            self.transport.close()
            self._check_silence(why)
            time.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    def _is_gone(self, error: ConnectionCutError, *, new: bool | None) -> bool:
        """Whether it is pointless to open a connection again that was lost before the rig has
        answered.
        """
        waited = time.monotonic() - self._heard > self.repeat_after
        return not self.transport.returns or (new is not False and (waited or not error.refused))

    def _lost_connection_error(self, why: str) -> RigError:
        """Close a connection that was lost before the rig has answered. Return the error, with what
        the other end has written instead of an answer.
        """
        try:
            with suppress(ConnectionCutError):
                for message in self._messages(READING):
                    if message is not None:
                        self._check_refusal(message, None)
        except RigError as error:
            return error
        finally:
            self.transport.close()
        rubbish = f": {self._damage_text}" if self._damaged else ""
        return RigError(f"{self.transport.name}: no answer from the rig: {why}{rubbish}")

    def _greet(self, *, once: bool = False) -> Welcome | None:
        """Send hello messages, and return the rig's answer. If no answer to three of them (with
        ``once``, to one) arrives in time, return None.
        """
        unanswered = 2 if once else 0
        while unanswered < 3:
            self.transport.write(b"\n" + encode_message(Hello(session=self.session)))
            for message in self._messages(self.repeat_after):
                if message is None or isinstance(message, Again):
                    self._check_silence()
                    break
                self._check_refusal(message, None)
                if isinstance(message, Welcome) and message.session != self._before:
                    return message
            else:
                unanswered += 1
        return None

    def _check_welcome(self, welcome: Welcome, *, new: bool | None) -> Welcome:
        """Check that the answer to the request hello comes from the expected rig and session."""
        if welcome.protocol != PROTOCOL:
            raise RigError(
                f"{self.transport.name}: expected a rig that speaks protocol {PROTOCOL}, got"
                f" {welcome.protocol}"
            )
        self._check_device(welcome)
        if new is None:
            return welcome
        if new:
            if welcome.seq != 0 or welcome.session != self.session:
                raise RigError(
                    f"{self.transport.name}: expected a new session, got a session with"
                    f" {welcome.seq} requests"
                )
        elif welcome.session != self.session or welcome.seq not in {self._seq - 1, self._seq}:
            raise RigError(
                f"{self.transport.name}: expected the rig to continue at request {self._seq}, got"
                f" {welcome.seq}: the rig has restarted, and the effect of the last command is"
                " unknown"
            )
        return welcome


class RemoteRig(RigSession):
    """A rig of particles on a grid behind a connection.

    Parameters
    ----------
    transport, repeat_after, end_after, on_event, session, resume
        The parameters of `RigSession`.
    """

    @property
    def name(self) -> str:
        """Name of the rig, as reported by the rig."""
        return self._welcome.name

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the rig's field of view, in cells."""
        return tuple(self._welcome.shape)

    @property
    def rule(self) -> str:
        """The rig's move rule."""
        return self._welcome.rule

    @property
    def can(self) -> tuple[str, ...]:
        """Requests beyond commands and scans that the rig carries out: "push", "look"."""
        return tuple(self._welcome.can)

    @property
    def pulses(self) -> dict[str, tuple[float, float]]:
        """Angle in degrees and time in seconds of a push by one cell in each direction."""
        return {letter: (angle, self._welcome.pulse) for letter, angle in ANGLES.items()}

    def push(self, angle: float, seconds: float) -> None:
        """Push the particles in a direction (degrees) for some seconds, and wait until it is done.

        Raises
        ------
        InvalidInputError
            Raised if the rig carries out whole commands only.
        RigError
            Raised if the rig does not answer, or refuses the push.
        """
        check_number(angle, what="angle")
        check_number(seconds, what="seconds", least=0)
        if "push" not in self.can:
            raise InvalidInputError(
                f"{self.transport.name}: expected a rig that pushes in every direction (its welcome"
                " says so in can), got one that carries out whole commands only"
            )
        self.ask(lambda seq: Push(seq=seq, angle=angle, seconds=seconds), Done)

    def look(self) -> Frame:
        """Return where the particles are, as floats in cells (row, column). A rig that cannot look
        reports the middles of their cells.

        Raises
        ------
        RigError
            Raised if the rig does not answer, or if its answer contains no points.
        """
        if "look" not in self.can:
            self._looks += 1
            return Frame(self.observe().astype(np.float64), time.monotonic(), self._looks)
        answer = self.ask(lambda seq: Look(seq=seq), Points)
        what, ndim = f"{self.transport.name}: points", len(self.shape)
        try:
            seen = np.zeros((0, ndim))
            if answer.points:
                seen = check_points(answer.points, what=what, dimensions=ndim)
        except InvalidInputError as error:
            raise PositionError(str(error)) from None
        self._looks = self._looks + 1 if answer.number is None else answer.number
        return Frame(seen, time.monotonic(), self._looks)

    def send(self, command: str) -> None:
        """Send one command, and wait until the rig has carried out the command.

        Raises
        ------
        InvalidInputError
            Raised if ``command`` is not a command letter.
        RigError
            Raised if the rig does not answer, or if the rig refuses the command.
        """
        if len(command) != 1 or command not in letters_of(len(self.shape)):
            raise InvalidInputError(
                f"expected one command out of {letters_of(len(self.shape))!r}, got {command!r}"
            )
        self.ask(lambda seq: Command(seq=seq, command=command), Done)

    def observe(self) -> NDArray[np.int64]:
        """Return the cells of all observed particles (int64, shape (n, ndim)).

        Raises
        ------
        RigError
            Raised if the rig does not answer, or if the answer of the rig contains invalid cells.
        """
        answer = self.ask(lambda seq: Observe(seq=seq), Positions)
        try:
            return check_cells(answer.cells, self.shape, what=f"{self.transport.name}: positions")
        except InvalidInputError as error:
            raise PositionError(str(error)) from None

    def _check_device(self, welcome: Welcome) -> None:
        if welcome.rule not in RULES or int(np.prod(welcome.shape, dtype=object)) > LARGEST_VIEW:
            raise RigError(
                f"{self.transport.name}: expected a rule out of {', '.join(RULES)} and at most"
                f" {LARGEST_VIEW} cells, got {welcome.rule!r} and {tuple(welcome.shape)}"
            )


def session_of(rig: Any) -> RigSession | None:
    """Return the session in which a rig gets its commands: the rig itself, or the session of its
    actuator if the rig is made of two devices. Return None for a rig without sessions.
    """
    for candidate in (rig, getattr(getattr(rig, "actuator", None), "rig", None)):
        if isinstance(candidate, RigSession):
            return candidate
    return None


def open_rig(
    spec: str,
    *,
    repeat_after: float = REPEAT_AFTER,
    end_after: float = END_AFTER,
    on_event: OnEvent | None = None,
    resume: LoggedSession | None = None,
) -> RemoteRig:
    """Connect to the rig that the text ``spec`` names.

    Parameters
    ----------
    spec : str
        Address of the rig: ``serial:/dev/ttyUSB0``, ``tcp:HOST:PORT``, or ``exec:COMMAND``. A
        serial line runs at 115200 baud. The address of a serial line may end with another speed in
        baud, as in ``serial:/dev/ttyUSB0@9600``. ``COMMAND`` starts a program that exchanges the
        messages of the protocol on its standard input and output.
    repeat_after, end_after, on_event, resume
        Options of the class `RemoteRig`.

    Raises
    ------
    InvalidInputError
        Raised if ``spec`` does not begin with ``serial:``, ``tcp:`` or ``exec:``.
    MissingExtraError
        Raised if the rig is on a serial line, and pyserial is not installed (``pip install
        'shoal[serial]'``).
    RigError
        Raised if the rig does not answer, or if the rig uses another version of the protocol.
    """
    check_function(on_event, what="on_event")
    return RemoteRig(
        open_transport(spec),
        repeat_after=repeat_after,
        end_after=end_after,
        on_event=on_event,
        resume=resume,
    )
