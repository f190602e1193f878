"""SQLite as stores and the studio use it: files that appear whole, commits that last, and errors
in one sentence.
"""

from __future__ import annotations

import errno
import os
import secrets
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path

from shoal.core.checks import describe_missing_file, shortened
from shoal.core.errors import InvalidInputError, OutputError
from shoal.core.interruption import half_written
from shoal.core.version import __version__

APPLICATION = 0x53484F41  # "SHOA"
FORMAT = 1
_NAMES = ("sweeps", "points", "batches", "trials", "failures")
# a damaged file may have any type in a column, and a text compares larger than every number
_RANGES: dict[str, dict[str, tuple[float, float]]] = {
    "sweeps": {"trials": (0, 10**18), "points": (0, 10**18)},
    "points": {"id": (0, 10**18), "number": (0, 10**18)},
    "batches": {"trials": (0, 10**18), "seconds": (0, 1e12), "finished": (0, 1e12)},
}
_TEXTS = {
    "sweeps": ("name", "spec", "inputs", "measures", "version"),
    "points": ("key", "axes"),
    "batches": ("spec", "version", "worker"),
}
_AT_ONCE = 2**16  # bytes
_WAIT = 30.0  # seconds to wait for another process's commit

TABLES = """
CREATE TABLE sweeps (
  id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE, spec TEXT NOT NULL, inputs TEXT NOT NULL, measures TEXT NOT NULL,
  trials INTEGER NOT NULL, points INTEGER NOT NULL, created REAL NOT NULL, version TEXT NOT NULL
);
CREATE TABLE points (
  id INTEGER PRIMARY KEY, sweep INTEGER NOT NULL REFERENCES sweeps (id), number INTEGER NOT NULL, key TEXT NOT NULL,
  axes TEXT NOT NULL, UNIQUE (sweep, key)
);
CREATE TABLE batches (
  id INTEGER PRIMARY KEY, sweep INTEGER NOT NULL REFERENCES sweeps (id), spec TEXT NOT NULL, seed INTEGER NOT NULL,
  version TEXT NOT NULL, worker TEXT NOT NULL, trials INTEGER NOT NULL, failures INTEGER NOT NULL, seconds REAL NOT NULL,
  finished REAL NOT NULL
);
CREATE TABLE trials (
  point INTEGER NOT NULL REFERENCES points (id), trial INTEGER NOT NULL, seed INTEGER NOT NULL,
  batch INTEGER NOT NULL REFERENCES batches (id), result TEXT NOT NULL, PRIMARY KEY (point, trial)
) WITHOUT ROWID;
CREATE TABLE failures (
  point INTEGER NOT NULL REFERENCES points (id), trial INTEGER NOT NULL, seed INTEGER NOT NULL,
  batch INTEGER NOT NULL REFERENCES batches (id), error TEXT NOT NULL, PRIMARY KEY (point, trial)
) WITHOUT ROWID;
CREATE INDEX batches_of_sweep ON batches (sweep, finished);
"""


def connect(path: Path, *, write: bool, damaged: bool = False) -> sqlite3.Connection:
    """Open a store. If ``write`` is true, create a missing store. If ``damaged`` is true, open also
    a store with damaged rows.

    Raises
    ------
    InvalidInputError
        Raised if the file is not a store, is damaged, or comes from a newer version of Shoal.
    OutputError
        Raised if Shoal cannot write the file.
    """
    try:
        existing = path.exists()
    except OSError as error:
        raise InvalidInputError(
            f"{path}: expected a store in a readable folder, got the error: {error.strerror}"
        ) from None
    missing = describe_missing_file(path)
    if missing and (existing or not write):
        raise InvalidInputError(f"{path}: expected a store, got {missing}")
    if existing and path.stat().st_size == 0:
        raise InvalidInputError(
            f"{path}: expected a store or the name of a new file, got an empty file (remove the"
            " empty file)"
        )
    if write and existing and not os.access(path, os.W_OK):
        raise OutputError(f"cannot write {path}: it is read-only; nothing was changed")
    if not existing:
        _create(path)
    with sqlite_errors_at(path):
        connection = _opened(path, write=write)
        try:
            connection.execute("PRAGMA trusted_schema = OFF")
            _check(connection, path)
            fault = None if damaged else next(row_faults(connection), None)
            if fault is not None:
                raise InvalidInputError(f"{path}: {fault}")
            if write:
                _make_durable(connection)
        except BaseException:
            connection.close()
            raise
    return connection


def _create(path: Path) -> None:
    """Create an empty store under a temporary name, then rename it to ``path``.

    The renaming ensures that no other process sees an incomplete store, and that only one process
    creates the store.

    Raises
    ------
    OutputError
        Raised if Shoal cannot write the file. A failed write leaves no partial file.
    """
    with (
        unfinished_store(path, shared=True) as temporary,
        sqlite_errors_at(path),
        closing(_connected(temporary)) as connection,
    ):
        _make_durable(connection)
        with transaction(connection):
            for statement in TABLES.split(";"):
                connection.execute(statement)
            connection.execute(f"PRAGMA application_id = {APPLICATION}")
            connection.execute(f"PRAGMA user_version = {FORMAT}")


@contextmanager
def unfinished_store(path: Path, *, shared: bool = False) -> Iterator[Path]:
    """Yield a temporary file name for a new store. At the end of the ``with`` block, rename the
    temporary file to ``path``.

    If the ``with`` block raises an error, remove the temporary file.

    Raises
    ------
    OutputError
        Raised if Shoal cannot write the file, or if ``shared`` is false and another process has
        created ``path`` in the meantime. If ``shared`` is true, a store that another process has
        created is kept.
    """
    temporary = path.with_name(f".{path.name[:40]}-{secrets.token_hex(6)}")
    made = {temporary.with_name(temporary.name + end) for end in ("", "-wal", "-shm", "-journal")}
    half_written.update(made)
    try:
        yield temporary
        # Data that does not fit on the disk stays in the log, and SQLite reports no error when it
        # closes.
        if any(file.stat().st_size for file in made - {temporary} if file.exists()):
            raise OSError(errno.ENOSPC, "the disk is full")
        with suppress(*[FileExistsError] * shared):
            _named(temporary, path)
    except OutputError:
        raise
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        for file in made:
            file.unlink(missing_ok=True)
        half_written.difference_update(made)


def _named(temporary: Path, path: Path) -> None:
    """Rename the file ``temporary`` to ``path``, unless the file ``path`` exists."""
    try:
        os.link(temporary, path)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links
        if not path.exists():
            temporary.rename(path)


def _connected(path: Path, *, options: str = "") -> sqlite3.Connection:
    where = f"{path.resolve().as_uri()}?{options}"
    connection = sqlite3.connect(
        where, uri=True, timeout=_WAIT, isolation_level=None, check_same_thread=False
    )
    connection.set_progress_handler(lambda: 0, 100_000)  # Python code, in which Ctrl-C takes effect
    return connection


def _opened(path: Path, *, write: bool) -> sqlite3.Connection:
    if write:
        return _connected(path, options="mode=rw")
    connection = _connected(path, options="mode=ro")
    try:
        connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except sqlite3.Error as error:
        connection.close()
        if error.sqlite_errorcode & 0xFF not in {sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY}:
            raise
        # In a read-only folder, SQLite cannot create shared memory beside the file. Then no other
        # process writes the file either.
        log = path.with_name(f"{path.name}-wal")
        if not log.exists() or not log.stat().st_size:
            return _connected(path, options="immutable=1")
        # the file may disappear as soon as the copy is open
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / "store"
            shutil.copyfile(path, copy)
            shutil.copyfile(log, copy.with_name("store-wal"))
            connection = _connected(copy)
            connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
    return connection


def remove_empty_log(path: Path) -> None:
    """Let SQLite remove the write-ahead log and the shared memory beside a store that nobody has
    open, if the log is empty. A connection that only reads makes both files and cannot remove them.
    """
    with suppress(OSError, sqlite3.Error):
        if not path.with_name(f"{path.name}-wal").stat().st_size:
            with closing(_connected(path, options="mode=rw")) as connection:
                connection.execute("SELECT count(*) FROM sqlite_master").fetchone()


def _check(connection: sqlite3.Connection, path: Path) -> None:
    """Refuse a file that is not a store, a damaged store, and a store from a newer version of
    Shoal.
    """
    application, number = (
        connection.execute(f"PRAGMA {name}").fetchone()[0]
        for name in ("application_id", "user_version")
    )
    if application != APPLICATION:
        raise InvalidInputError(f"{path}: expected a store of Shoal, got another SQLite database")
    # Views and triggers could run arbitrary code in place of our queries, even endless loops.
    strange = connection.execute(
        "SELECT type, name FROM sqlite_master WHERE NOT (type = 'table' AND name IN"
        f" ({', '.join('?' * len(_NAMES))})) AND NOT (type = 'index' AND (name = 'batches_of_sweep'"
        " OR name LIKE 'sqlite_autoindex_%')) LIMIT 1",
        _NAMES,
    ).fetchone()
    virtual = connection.execute(
        "SELECT name FROM sqlite_master WHERE sql LIKE 'CREATE VIRTUAL%' LIMIT 1"
    ).fetchone()
    if strange or virtual:
        kind, name = strange or ("virtual table", virtual[0])
        raise InvalidInputError(
            f"{path}: expected the tables of a store and nothing else, got the {kind}"
            f" {shortened(name)}"
        )
    if number > FORMAT:
        raise InvalidInputError(
            f"{path}: expected a store of format {FORMAT} or below, got format {number} of a Shoal"
            f" that is newer than {__version__}; upgrade Shoal, nothing was changed"
        )


def row_faults(connection: sqlite3.Connection) -> Iterator[str]:
    """Yield one sentence for each damaged row of the tables of sweeps, points and batches."""
    for table, ranges in _RANGES.items():
        damage = {
            column: (f"({column} BETWEEN {least} AND {most}) IS NOT 1", f"{least:g} to {most:g}")
            for column, (least, most) in ranges.items()
        }
        damage |= {column: (f"typeof({column}) != 'text'", "a text") for column in _TEXTS[table]}
        cases = " ".join(f"WHEN {found} THEN '{column}'" for column, (found, _) in damage.items())
        for number, column in connection.execute(
            f"SELECT id, CASE {cases} END AS damaged FROM {table} WHERE damaged IS NOT NULL"
        ):
            yield (
                f"table {table}, row {number}: {column}: expected {damage[column][1]}, got a damaged"
                " value"
            )


def _make_durable(connection: sqlite3.Connection) -> None:
    """Make SQLite write every commit to the disk before the next statement."""
    connection.execute("PRAGMA journal_mode = WAL")
    # with NORMAL, a power failure could lose the last commits
    connection.execute("PRAGMA synchronous = FULL")
    connection.execute("PRAGMA foreign_keys = ON")


@contextmanager
def transaction(connection: sqlite3.Connection) -> Iterator[None]:
    """Run the ``with`` block as one transaction. If the ``with`` block raises an error, SQLite
    undoes all changes of the block.
    """
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
        connection.execute("COMMIT")
    except BaseException:
        with suppress(sqlite3.Error):  # SQLite has already rolled back after some errors
            connection.execute("ROLLBACK")
        raise


@contextmanager
def sqlite_errors_at(path: Path) -> Iterator[None]:
    """Convert SQLite errors inside the ``with`` block to errors with a one-sentence message."""
    try:
        yield
    except (sqlite3.Error, UnicodeError, OverflowError) as error:
        raise _as_own_error(path, error) from error


def _is_full(path: Path) -> bool:
    """Return whether the disk has no space for SQLite's log. SQLite reports a full disk as a
    general disk error.
    """
    with suppress(OSError):
        return shutil.disk_usage(path.parent).free < _AT_ONCE
    return False


def _as_own_error(path: Path, error: Exception) -> Exception:
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code == sqlite3.SQLITE_INTERRUPT:
        raise KeyboardInterrupt from error
    what = " ".join(str(error).split())[:200]  # it may quote the schema, which has several lines
    kept = "every committed batch is kept, and the same command continues from there"
    too_large = getattr(error, "sqlite_errorcode", 0) == sqlite3.SQLITE_IOERR_WRITE
    if (
        code == sqlite3.SQLITE_FULL
        or too_large
        or (code == sqlite3.SQLITE_IOERR and _is_full(path))
    ):
        return OutputError(f"cannot write {path}: the disk is full; {kept}")
    if code == sqlite3.SQLITE_READONLY:
        return OutputError(f"cannot write {path}: it is read-only; nothing was changed")
    if code == sqlite3.SQLITE_CANTOPEN:
        return OutputError(f"cannot open {path}: its folder is missing or cannot be written")
    if code == sqlite3.SQLITE_BUSY:
        return OutputError(
            f"cannot write {path}: another process has been writing it for {_WAIT:g} seconds;"
            f" {kept}"
        )
    if code == sqlite3.SQLITE_IOERR:
        return OutputError(f"cannot read or write {path}: {what}; {kept}")
    if code == sqlite3.SQLITE_NOTADB:
        return InvalidInputError(
            f"{path}: expected a store (an SQLite database), got another kind of file"
        )
    if code == sqlite3.SQLITE_CORRUPT:
        return InvalidInputError(
            f"{path}: expected a whole store, got a damaged or truncated one ({what}); nothing was"
            " changed: restore a copy, or start a new store"
        )
    return InvalidInputError(f"{path}: expected a store, got a damaged one: {what}")
