"""Hostile files for every reader, by kind: what a stranger may send under the name of a
valid file.
"""

from __future__ import annotations

import gzip
import io
import json
import os
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

from tests.hostile.damages import HUGE, STRANGER

Change = Callable[[bytes], bytes]


def _bomb() -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in ("doc.kml", "header.npy", "free.npy"):
            archive.writestr(name, bytes(6_000_000))
    return buffer.getvalue()


def _pickle() -> bytes:
    return b"\x80\x04c" + STRANGER.encode() + b"\nrun\n)R."


def _digits(content: bytes, number: bytes) -> bytes:
    """Put a number in place of every digit."""
    return b"".join(number if byte in b"123456789" else bytes([byte]) for byte in content)


_OBJECTS = b"{'descr': '|O', 'fortran_order': False, 'shape': (1,)}"
_VIRTUAL = (
    b'<OGRVRTDataSource><OGRVRTLayer name="a"><SrcDataSource>/vsicurl/http://127.0.0.1/</SrcDataSource></OGRVRTLayer>'
    b"</OGRVRTDataSource>"
)
CONTENTS: dict[str, Change] = {
    "nothing": lambda _: b"",
    "one byte": lambda _: b"\0",
    "a newline": lambda _: b"\n",
    "blanks": lambda _: b" \t\r\n" * 99,
    "zeros": lambda content: bytes(len(content)),
    "ones": lambda content: b"\xff" * len(content),
    "the first half": lambda content: content[: len(content) // 2],
    "the second half": lambda content: content[len(content) // 2 :],
    "all but the last byte": lambda content: content[:-1],
    "twice": lambda content: content * 2,
    "a hundred times": lambda content: content[:1000] * 100,
    "backwards": lambda content: content[::-1],
    "in UTF-16": lambda content: content.decode("latin-1").encode("utf-16"),
    "after a mark": lambda content: b"\xef\xbb\xbf" + content,
    "without lines": lambda content: content.replace(b"\n", b""),
    "lines of the old Mac": lambda content: content.replace(b"\n", b"\r"),
    "zero bytes within": lambda content: content.replace(b"e", b"\0"),
    "Latin letters": lambda content: content.replace(b"a", b"\xe4"),
    "numbers of 400 digits": lambda content: _digits(content, HUGE.encode()),
    "numbers of 5,000 digits": lambda content: content.replace(b"1", b"9" * 5000).replace(
        b"2", b"9" * 5000
    ),
    "negative numbers": lambda content: _digits(content, b"-1"),
    "not a number": lambda content: _digits(content, b"NaN"),
    "1e308": lambda content: content.replace(b"1", b"1e308"),
    "superscripts": lambda content: _digits(content, "²".encode()),
    "lists without end": lambda _: b"[" * 100_000,
    "objects without end": lambda _: b'{"type":' * 50_000,
    "lists in lists": lambda _: b"[" * 2000 + b"]" * 2000,
    "geometries in geometries": lambda _: b"GEOMETRYCOLLECTION(" * 50_000,
    "tags without end": lambda _: b"<kml>" * 20_000,
    "entities": lambda _: (
        b'<!DOCTYPE a [<!ENTITY b "c"><!ENTITY d SYSTEM "file:///etc/passwd">]><kml>&b;&d;</kml>'
    ),
    "control characters": lambda content: content.replace(b"n", b"\x1b]0;x\x07\x1b[2J"),
    "half of a pair of surrogates": lambda content: content.replace(b'"a', b'"\\ud800'),
    "one long line": lambda _: b"a" * 150_000,
    "9,000 lines": lambda _: b"1,1\n" * 9_000,
    "a web page": lambda _: b"<!DOCTYPE html><html><script>alert(1)</script></html>",
    "an archive": lambda _: b"PK\x05\x06" + bytes(18),
    "an archive that unfolds": lambda _: _BOMB,
    "a stream that unfolds": lambda _: gzip.compress(bytes(6_000_000), 9),
    "a pickle": lambda _: _pickle(),
    "an array of pickles": lambda _: (
        b"\x93NUMPY\x01\x00v\x00" + _OBJECTS.ljust(117) + b"\n" + _pickle()
    ),
    "a virtual layer": lambda _: _VIRTUAL,
    "a picture of 60,000 x 60,000": lambda _: (
        b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\xea\x60\0\0\xea\x60\x08\0\0\0\0\0\0\0\0"
    ),
    "a database of others": lambda _: b"SQLite format 3\0" + bytes(84),
    "code that is named": lambda content: re.sub(
        rb"random-moves|line:9", f"{STRANGER}:run".encode(), content
    ),
    "a problem of code": lambda _: json.dumps(
        {"kind": "swarm", "map": "line:9", "task": f"{STRANGER}:run"}
    ).encode(),
    "a program": lambda _: b"#!/bin/sh\ntouch /tmp/ran\n",
}
"""What becomes of the content of a file."""

_BOMB = _bomb()


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


def _link(path: Path, to: str) -> None:
    path.unlink()
    path.symlink_to(to)


def _pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


PLACES: dict[str, Callable[[Path], None]] = {
    "a folder": _folder,
    "nothing there": Path.unlink,
    "a link to itself": lambda path: _link(path, path.name),
    "a link to nothing": lambda path: _link(path, "nowhere"),
    "a pipe": _pipe,
    "a device": lambda path: _link(path, "/dev/zero"),
    "a terminal": lambda path: _link(path, "/dev/full"),
}
"""What becomes of the file."""
