"""Valid files made hostile: by bytes, by words, by values of JSON, and within archives and
databases.
"""

from __future__ import annotations

import contextlib
import gzip
import io
import json
import random
import re
import sqlite3
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

HUGE = "1" + "0" * 400
STRANGER = "stranger_of_the_tests"
"""A module that no reader may ask for."""

WORDS = [
    HUGE,
    "-" + HUGE,
    "9" * 5000,
    "1e999",
    "-1e308",
    "1e308",
    "1e-308",
    "NaN",
    "Infinity",
    "-0",
    "0",
    "-1",
    "2",
    "2.5",
    "1e9",
    "4294967296",
    "9223372036854775808",
    "true",
    "null",
    '""',
    "²",
    "٣",
    "1_0",
    "0x10",
    "\ud800".encode("utf-8", "surrogatepass").decode("latin-1"),
    "\\ud800",
    "\x1b[31m",
    "\0",
    "\u2028",
    "\ufeff",
    "[" * 200,
    "[" * 60_000,
    "(" * 2000,
    "GEOMETRYCOLLECTION(" * 3000,
    "{" * 200,
    "a" * 70_000,
    "../../x",
    "/etc/passwd",
    "/vsicurl/http://127.0.0.1/x",
    "/dev/zero",
    f"{STRANGER}:run",
    "os:system",
    "EPSG:4326",
    "EPSG:99999999",
    "=1+1",
    "<!DOCTYPE a [<!ENTITY b 'c'>]>",
    "&b;",
    "<a>" * 300,
    "]]>",
    "'",
    '"',
    "\\",
    ",",
    ";",
    "\t",
    "\n",
    "\r",
]
VALUES: list[Any] = [
    None,
    True,
    False,
    0,
    -1,
    1,
    2.5,
    10**400,
    -(10**400),
    1e308,
    -1e308,
    1e-308,
    2**31,
    2**63,
    2**64,
    float("nan"),
    float("inf"),
    "",
    "x",
    "\ud800",
    "a" * 70_000,
    [],
    {},
    [[]],
    [None],
    [1, 2],
    [[1, 2]],
    [[0, 0], [1, 1]],
    {"a": 1},
    {"type": "Polygon"},
    f"{STRANGER}:run",
    "os:system",
    "/dev/zero",
    "nan",
    "1e999",
    "line:9",
    "\x1b[2J",
    [10**400, 1],
    ["\ud800"],
    {"\ud800": 1},
    "POLYGON ((0 0, 1e308 0, 1 1, 0 0))",
]
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(rb'[A-Za-z_][\w:.-]*|"[^"\n]*"')


def damaged(name: str, content: bytes, chance: random.Random) -> bytes:
    """Return the content of a file with one to three damages, of a kind that suits it."""
    if name == "store" or name.endswith(".gpkg"):
        return chance.choice([_in_database, _in_database, _in_bytes])(content, chance)
    for kind, of_kind in _ARCHIVES.items():
        if name.endswith(kind) and chance.random() < 0.7:
            with contextlib.suppress(Exception):  # damaged before
                return of_kind(content, chance)
    text = b"\0" not in content[:200] and content[:1] not in b"\x89\xff\x1f"
    ways: list[Callable[[bytes, random.Random], bytes]] = [_in_bytes]
    if text:
        ways += (
            [_in_words, _in_words, _encoded_otherwise]
            if chance.random() < 0.9
            else [_encoded_otherwise]
        )
        if content.lstrip()[:1] in (b"{", b"["):
            ways += [_in_json] * 5
    for _ in range(chance.choice([1, 1, 1, 2, 3])):
        content = chance.choice(ways)(content, chance)
    return content


def _in_bytes(content: bytes, chance: random.Random) -> bytes:
    found = bytearray(content)
    at = chance.randrange(len(found) + 1)
    length = chance.choice([1, 1, 2, 4, 8, 30])
    match chance.randrange(7):
        case 0 if at < len(found):
            found[at] ^= 1 << chance.randrange(8)
        case 1:
            found[at : at + length] = bytes(
                chance.choice([0, 1, 0x7F, 0x80, 0xFF]) for _ in range(length)
            )
        case 2:
            del found[at:]
        case 3:
            del found[at : at + length]
        case 4:
            found[at:at] = found[at : at + 10 * length] * chance.choice([1, 1, 2, 1000])
        case 5:
            found[at : at + 4] = chance.choice([0, 1, 2**31 - 1, 2**31, 2**32 - 1]).to_bytes(
                4, chance.choice(["little", "big"])
            )
        case _:
            found[at:at] = chance.randbytes(length)
    return bytes(found)


def _in_words(content: bytes, chance: random.Random) -> bytes:
    found = [*chance.choice([_NUMBER, _NUMBER, _WORD]).finditer(content)]
    lines = content.split(b"\n")
    if not found or chance.random() < 0.15:
        chosen = chance.randrange(len(lines))
        lines[chosen : chosen + 1] = chance.choice(
            [[], [lines[chosen]] * 2, [chance.choice(WORDS).encode("utf-8", "surrogatepass")]]
        )
        return b"\n".join(lines)
    one = chance.choice(found)
    return (
        content[: one.start()]
        + chance.choice(WORDS).encode("utf-8", "surrogatepass")
        + content[one.end() :]
    )


def _encoded_otherwise(content: bytes, chance: random.Random) -> bytes:
    text = content.decode("utf-8", "replace")
    ways = (
        lambda: text.encode("utf-16"),
        lambda: text.encode("utf-32"),
        lambda: b"\xef\xbb\xbf" * 2 + content,
        lambda: content + b"\xe9",
        lambda: content.replace(b"UTF-8", b"ISO-8859-1"),
        lambda: content.replace(b"UTF-8", b"x" * 3000),
        lambda: b"\xff\xfe" + content,
        lambda: content.replace(b"\n", b"\r"),
        lambda: content.replace(b" ", b"\xc2\xa0"),
    )
    return chance.choice(ways)()


def _in_json(content: bytes, chance: random.Random) -> bytes:
    """Change one value of JSON, or of one line of JSON lines."""
    lines = content.split(b"\n") if b"\n{" in content.strip() else [content]
    chosen = chance.randrange(len(lines))
    try:
        root = [json.loads(lines[chosen])]
    except (ValueError, RecursionError):
        return _in_bytes(content, chance)
    _change(root, chance)
    with contextlib.suppress(ValueError, RecursionError):
        lines[chosen] = json.dumps(root[0]).encode() if root else b""
    return b"\n".join(lines)


def _change(root: list[Any], chance: random.Random) -> None:
    places: list[tuple[Any, Any]] = [(root, 0)]
    for holder, key in places:
        inner = holder[key]
        places += [(inner, k) for k in inner] if isinstance(inner, dict) else []
        places += (
            [(inner, k) for k in range(min(len(inner), 40))] if isinstance(inner, list) else []
        )
    holder, key = chance.choice(places)
    match chance.randrange(8):
        case 0:
            del holder[key]
        case 1 if isinstance(holder, list):
            holder[key:key] = [holder[key]] * chance.choice([1, 2, 500])
        case 1 | 2 if isinstance(holder, dict):
            holder[chance.choice(["x", "type", "kind", "\ud800", ""])] = holder.pop(key)
        case 3 if isinstance(holder[key], list):
            chance.shuffle(holder[key])
        case 4:
            holder[key] = [holder[key]]
        case 5 if isinstance(holder[key], int | float) and not isinstance(holder[key], bool):
            with contextlib.suppress(OverflowError):
                holder[key] *= chance.choice([-1, 0, 10, 1e-9, 1e9, 1e150])
        case _:
            holder[key] = chance.choice(VALUES)


# Within archives


def _in_zip(content: bytes, chance: random.Random) -> bytes:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = chance.choice([*members])
    # the header of an array stays what it is
    ahead = 128 if name.endswith(".npy") and chance.random() < 0.7 else 0
    if name.startswith("header"):  # of an episode: JSON as an array of bytes
        body = damaged("a.json", members[name][128:], chance)
        array = io.BytesIO()
        import numpy as np

        np.save(array, np.frombuffer(body, np.uint8))
        members[name] = array.getvalue()
    else:
        members[name] = members[name][:ahead] + damaged(
            name.removesuffix(".npy"), members[name][ahead:], chance
        )
    if chance.random() < 0.1:
        members[chance.choice(["../../x", "/x", "a.kml", "", "x" * 60_000])] = members.pop(name)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for one, inner in members.items():
            archive.writestr(one, inner)
    return buffer.getvalue()


def _in_gzip(content: bytes, chance: random.Random) -> bytes:
    return gzip.compress(_in_bytes(gzip.decompress(content), chance), mtime=0)


_ARCHIVES: dict[str, Callable[[bytes, random.Random], bytes]] = {
    ".npz": _in_zip,
    ".kmz": _in_zip,
    ".zip": _in_zip,
    ".gz": _in_gzip,
}


def _in_database(content: bytes, chance: random.Random) -> bytes:
    """Change a value, a table or the schema of an SQLite file by a statement."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a"
        path.write_bytes(content)
        with (
            contextlib.closing(sqlite3.connect(path)) as database,
            contextlib.suppress(sqlite3.Error, UnicodeError, OverflowError),
        ):
            database.execute("PRAGMA journal_mode=DELETE")
            database.execute("PRAGMA writable_schema=ON")
            for (name,) in database.execute(
                "SELECT name FROM sqlite_master WHERE type = 'trigger'"
            ).fetchall():
                database.execute(f'DROP TRIGGER "{name}"')  # they need functions of GeoPackages
            tables = [
                row[0]
                for row in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
            ]
            table = chance.choice(tables)
            columns = [row[1] for row in database.execute(f'PRAGMA table_info("{table}")')]
            column = chance.choice(columns)
            value: Any = chance.choice(
                [
                    None,
                    "",
                    "x",
                    0,
                    -1,
                    2**62,
                    1e308,
                    "a" * 70_000,
                    b"\xff\xfe",
                    "[" * 60_000,
                    "9" * 400,
                    "[1, [2]]",
                    "{}",
                ]
            )
            now = database.execute(f'SELECT "{column}" FROM "{table}" LIMIT 1').fetchone()
            if now and isinstance(now[0], bytes) and now[0]:
                value = _in_bytes(now[0], chance)
            elif now and isinstance(now[0], str) and now[0] and chance.random() < 0.7:
                value = damaged("a.json", now[0].encode(), chance).decode("utf-8", "replace")
            match chance.randrange(8):
                case 0:
                    database.execute(f'DROP TABLE "{table}"')
                case 1:
                    database.execute(f'ALTER TABLE "{table}" RENAME TO other')
                    database.execute(
                        f'CREATE VIEW "{table}" AS WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL'
                        " SELECT k + 1 FROM n) SELECT k FROM n"
                    )
                case 2:
                    database.execute(f'ALTER TABLE "{table}" RENAME COLUMN "{column}" TO other')
                case 3:
                    database.execute(f'DELETE FROM "{table}"')
                case _:
                    database.execute(f'UPDATE "{table}" SET "{column}" = ?', (value,))
            database.commit()
        return path.read_bytes()
