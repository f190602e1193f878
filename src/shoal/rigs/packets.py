"""Packets between Shoal and a device, by template: lines of text, `struct` packets, or packets of
pySerialTransfer (COBS with a CRC).

A template names the values that it sends. A template of an answer names what is read from it
(``temperature``), what must be as it was sent (all other names), and ``any`` for what does not
matter.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Iterator, Mapping
from string import Formatter
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from shoal.core.checks import shortened, suggestion
from shoal.core.errors import InvalidInputError

Form = Literal["text", "struct", "cobs"]
READ = ("temperature", "any")
"""Names that stand for what an answer says; every other name must be as it was sent."""
START, STOP = 0x7E, 0x81  # of a packet of pySerialTransfer
LONGEST_PAYLOAD = 0xFE
LONGEST_BUFFER = 2**16  # bytes without a packet among them, of which the older half is dropped
WHOLE = tuple("bcdoxX")  # formats of whole numbers
LARGEST = {"b": 127, "B": 255, "c": 255, "h": 32767, "H": 65535, "e": 2048, "i": 2**24, "?": 1}
"""Largest whole number of a place in a struct. A float holds whole numbers up to 2^24."""
NUMBER = r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"


def _crc_table(polynomial: int) -> bytes:
    table = bytearray()
    for byte in range(256):
        remainder = byte
        for _ in range(8):
            remainder = (remainder << 1 ^ polynomial) & 0xFF if remainder & 0x80 else remainder << 1
        table.append(remainder)
    return bytes(table)


CRC_TABLE = _crc_table(0x9B)


def crc8(data: bytes) -> int:
    """Return the CRC-8 of bytes with the polynomial 0x9B, as pySerialTransfer computes it.

    Examples
    --------
    >>> hex(crc8(b"123456789"))
    '0xea'
    """
    crc = 0
    for byte in data:
        crc = CRC_TABLE[crc ^ byte]
    return crc


def cobs_packet(payload: bytes, identity: int = 0) -> bytes:
    """Return a payload of 1 to 254 bytes as a packet of pySerialTransfer.

    The packet is: start byte 0x7E, identity, overhead, length, payload, CRC of the payload, stop
    byte 0x81. In the payload, each byte 0x7E is replaced by the distance to the next one, and the
    last one by 0; the overhead is the place of the first one, or 255 if there is none.

    Examples
    --------
    >>> cobs_packet(bytes([0x7E, 1, 0x7E])).hex()
    '7e000003020100aa81'
    """
    if not 1 <= len(payload) <= LONGEST_PAYLOAD:
        raise InvalidInputError(
            f"expected a payload of 1 to {LONGEST_PAYLOAD} bytes, got {len(payload)}"
        )
    stuffed = bytearray(payload)
    places = [at for at, byte in enumerate(payload) if byte == START]
    following = 0
    for at in reversed(places):
        stuffed[at] = following - at if following else 0
        following = at
    overhead = places[0] if places else 0xFF
    head = bytes([START, identity, overhead, len(stuffed)])
    return head + bytes(stuffed) + bytes([crc8(bytes(stuffed)), STOP])


def _unstuff(stuffed: bytes, overhead: int) -> bytes | None:
    """Return the payload with its bytes 0x7E, or None if the distances lead out of it."""
    payload, at = bytearray(stuffed), overhead
    while at != 0xFF:
        if at >= len(payload):
            return None
        distance, payload[at] = payload[at], START
        at = at + distance if distance else 0xFF
    return bytes(payload)


class Template(BaseModel):
    """How a packet is made: ``text``, or ``struct`` and ``values``.

    Parameters
    ----------
    text : str, optional
        A line of text (of a packet that is sent, also several) with names and formats of Python
        in braces, as in ``"P {number:d} {milliseconds:.1f}"``. A newline is added if there is none
        at its end.
    struct : str, optional
        Format of Python's module `struct`, as in ``"<Hhh"``.
    values : list of str or float
        One name or number for each value of ``struct``. Whole numbers are rounded.
    id : int
        Identity of a packet of pySerialTransfer.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    text: str | None = None
    struct: str | None = None
    values: list[str | float] | None = None
    id: int = Field(default=0, ge=0, le=255)


class Packet:
    """The packets of one template.

    Parameters
    ----------
    form : str
        "text", "struct" or "cobs".
    template : Template
    names : iterable of str
        The names that the template may contain.
    answer : bool
        Whether the packet is an answer, of one line.

    Raises
    ------
    InvalidInputError
        Raised if the template does not fit the form, or contains an unknown name.
    """

    def __init__(
        self, form: Form, template: Template, names: Iterable[str], *, answer: bool = False
    ) -> None:
        self.form, self.template, self._answer = form, template, answer
        choices = list(names)
        if form == "text":
            self._parts = self._text_parts(template, choices)
            self.names = [name for _, name, _ in self._parts if name is not None]
            return
        self.lines = 1
        if template.text is not None or template.struct is None or template.values is None:
            raise InvalidInputError(f"expected struct and values for the packets {form}")
        try:
            self._struct = struct.Struct(template.struct)
        except struct.error as error:
            raise InvalidInputError(
                f"struct: expected a format of Python's struct, got {shortened(template.struct)}:"
                f" {error}"
            ) from None
        self._codes = _codes(template.struct)
        if any(code in "spnNP" for code in self._codes):
            raise InvalidInputError(
                f"struct: expected formats of numbers, got {shortened(template.struct)}"
            )
        if len(self._codes) != len(template.values):
            raise InvalidInputError(
                f"values: expected {len(self._codes)} for the format"
                f" {shortened(template.struct)}, got {len(template.values)}"
            )
        if form == "cobs" and not 1 <= self._struct.size <= LONGEST_PAYLOAD:
            raise InvalidInputError(
                f"struct: expected 1 to {LONGEST_PAYLOAD} bytes, got {self._struct.size}"
            )
        self.names = [value for value in template.values if isinstance(value, str)]
        for name in self.names:
            _check_name(name, choices, "values")

    def _text_parts(self, template: Template, choices: list[str]) -> list[tuple[str, Any, str]]:
        if template.text is None or template.struct is not None or template.values is not None:
            raise InvalidInputError("expected text, and neither struct nor values")
        self.lines = len(template.text.strip().splitlines())
        if self.lines == 0 or (self._answer and self.lines > 1):
            raise InvalidInputError(f"text: expected one line, got {shortened(template.text)}")
        parts = []
        try:
            for literal, name, spec, conversion in Formatter().parse(template.text):
                if conversion:
                    raise ValueError(f"no conversion !{conversion}")
                if name is not None:
                    _check_name(name, choices, "text")
                    _format_value(1.0, spec or "")
                parts.append((literal, name, spec or ""))
        except ValueError as error:
            if isinstance(error, InvalidInputError):
                raise
            raise InvalidInputError(
                f"text: expected names and formats of Python in braces, got"
                f" {shortened(template.text)}: {error}"
            ) from None
        return parts

    def encode(self, values: Mapping[str, float]) -> bytes:
        """Return the packet with the given values.

        Raises
        ------
        InvalidInputError
            Raised if a value does not fit its place in a struct.
        """
        if self.form == "text":
            line = "".join(
                literal + ("" if name is None else _format_value(values[name], spec))
                for literal, name, spec in self._parts
            )
            return (line if line.endswith(("\n", "\r")) else line + "\n").encode()
        packed = [
            _pack_value(values[value] if isinstance(value, str) else value, code)
            for value, code in zip(self.template.values or (), self._codes, strict=True)
        ]
        try:
            payload = self._struct.pack(*packed)
        except (struct.error, OverflowError) as error:
            raise InvalidInputError(
                f"expected values that fit the format {self.template.struct}, got {packed}: {error}"
            ) from None
        return payload if self.form == "struct" else cobs_packet(payload, self.template.id)

    def rounded(self, name: str, value: float) -> list[float]:
        """Return a value as each place of its name carries it; a value that does not fit is left
        out.
        """
        if self.form == "text":
            return [_as_written(value, spec) for _, own, spec in self._parts if own == name]
        places = zip(self.template.values or (), self._codes, strict=True)
        sent = [_round_trip(value, code) for own, code in places if own == name]
        return [float(one) for one in sent if isinstance(one, int | float)]

    def read(self, message: bytes, sent: Mapping[str, float]) -> dict[str, float] | None:
        """Return what an answer says, or None if the message is not this answer.

        Parameters
        ----------
        message : bytes
            A line without its end, a struct, or the identity and the payload of a packet of
            pySerialTransfer.
        sent : mapping
            The values that the answer must repeat.
        """
        if self.form == "text":
            return self._read_text(message, sent)
        if self.form == "cobs":
            if message[:1] != bytes([self.template.id]):
                return None
            message = message[1:]
        if len(message) != self._struct.size:
            return None
        values: dict[str, float] = {}
        for got, value, code in zip(
            self._struct.unpack(message), self.template.values or (), self._codes, strict=True
        ):
            if value in READ:
                if value != "any":
                    values[str(value)] = float(got)
            elif got != _round_trip(sent[value] if isinstance(value, str) else value, code):
                return None
        return values

    def _read_text(self, message: bytes, sent: Mapping[str, float]) -> dict[str, float] | None:
        pattern, read = "", []
        for literal, name, spec in self._parts:
            pattern += re.escape(literal)
            if name == "any":
                pattern += ".*"
            elif name in READ:
                pattern += NUMBER
                read.append(name)
            elif name is not None:
                pattern += re.escape(_format_value(sent[name], spec))
        match = re.fullmatch(pattern.strip(), message.decode(errors="replace").strip())
        return match and {
            name: float(text) for name, text in zip(read, match.groups(), strict=True)
        }

    def is_like(self, message: bytes) -> bool:
        """Return whether a struct may be this answer: its fixed numbers are in their places."""
        if len(message) < self._struct.size:
            return False
        got = self._struct.unpack(message[: self._struct.size])
        return all(
            isinstance(value, str) or number == _round_trip(value, code)
            for number, value, code in zip(
                got, self.template.values or (), self._codes, strict=True
            )
        )

    def largest(self, name: str) -> int:
        """Return the largest whole number that fits all places of a name."""
        if self.form == "text":
            return LARGEST["i"]
        places = zip(self.template.values or (), self._codes, strict=True)
        return min(
            (LARGEST.get(code, LARGEST["i"]) for value, code in places if value == name),
            default=LARGEST["i"],
        )

    @property
    def size(self) -> int:
        """Number of bytes of a struct."""
        return self._struct.size


class Splitter:
    """Splits the bytes that a device sends into messages.

    Parameters
    ----------
    form : str
        "text", "struct" or "cobs".
    answers : iterable of Packet
        The answers that the device may give; the size of structs follows from them.
    """

    def __init__(self, form: Form, answers: Iterable[Packet]) -> None:
        self._form, self._answers = form, list(answers)
        self._came = bytearray()

    def clear(self) -> None:
        """Forget what has come."""
        self._came.clear()

    def messages(self, data: bytes) -> Iterator[bytes]:
        """Yield the messages that are complete once these bytes have come. What is damaged is left
        out.
        """
        self._came += data
        if len(self._came) > LONGEST_BUFFER:
            del self._came[: len(self._came) // 2]
        split = {"text": self._line, "struct": self._structure, "cobs": self._packet}[self._form]
        while (message := split()) is not None:
            if message:
                yield message

    def _line(self) -> bytes | None:
        end = re.search(rb"[\r\n]", self._came)
        if end is None:
            return None
        line = bytes(self._came[: end.start()])
        del self._came[: end.end()]
        return line.strip()

    def _structure(self) -> bytes | None:
        if not self._answers:
            self._came.clear()
        while self._came:
            for answer in self._answers:
                if answer.is_like(bytes(self._came)):
                    message = bytes(self._came[: answer.size])
                    del self._came[: answer.size]
                    return message
            if len(self._came) < max(answer.size for answer in self._answers):
                return None
            del self._came[0]
        return None

    def _packet(self) -> bytes | None:
        while True:
            begin = self._came.find(START)
            if begin < 0:
                self._came.clear()
                return None
            del self._came[:begin]
            if len(self._came) < 4:
                return None
            identity, overhead, length = self._came[1:4]
            if not 1 <= length <= LONGEST_PAYLOAD:
                del self._came[0]
                continue
            if len(self._came) < length + 6:
                return None
            stuffed = bytes(self._came[4 : 4 + length])
            crc, stop = self._came[4 + length : 6 + length]
            payload = _unstuff(stuffed, overhead)
            if stop != STOP or crc != crc8(stuffed) or payload is None:
                del self._came[0]
                continue
            del self._came[: length + 6]
            return bytes([identity]) + payload


def _check_name(name: str, choices: list[str], what: str) -> None:
    if name not in choices:
        raise InvalidInputError(
            f"{what}: expected names out of {', '.join(choices)}, got"
            f" {shortened(name)}{suggestion(name, choices)}"
        )


def _format_value(value: float, spec: str) -> str:
    """Return a value as a text. Whole numbers have no decimal point, if no format asks for one."""
    value += 0.0  # -0.0 is 0
    whole = spec[-1:] in WHOLE if spec else value.is_integer()
    return format(round(value) if whole else value, spec)


def _as_written(value: float, spec: str) -> float:
    """Return a value as a text in a format says it."""
    text = _format_value(value, spec)
    try:
        return float(text)
    except ValueError:  # with percent signs, separators, or in another base
        return float(round(value)) if spec[-1:] in WHOLE else value


def _codes(form: str) -> str:
    """Return one letter for each value of a format of `struct`."""
    codes = ""
    for count, code in re.findall(r"(\d*)([a-zA-Z?])", form):
        codes += "" if code == "x" else code if code in "sp" else code * int(count or 1)
    return codes


def _pack_value(value: float, code: str) -> Any:
    """Return a value as the type of its place in a struct."""
    if code in "efd":
        return float(value)
    if code == "?":
        return bool(value)
    return bytes([round(value)]) if code == "c" else round(value)


def _round_trip(value: float, code: str) -> Any:
    """Return a value as it comes back from its place in a struct."""
    try:
        return struct.unpack("<" + code, struct.pack("<" + code, _pack_value(value, code)))[0]
    except (struct.error, OverflowError, ValueError):
        return None
